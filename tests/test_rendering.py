"""Pictures: of the size asked for, of the stone given, the same each time, and a clear word where there can be none."""

from __future__ import annotations

import math
import os
import sys

import numpy as np
import pytest
from wavy import WHITE, is_drawn, stone

from lithoform import rendering
from lithoform.errors import LithoformError
from lithoform.rendering import Studio, render, require_pictures, to_polydata
from lithoform.topology import sphere


@pytest.mark.usefixtures("drawing")
class TestRender:
    def test_it_has_the_size_asked_for_and_shows_a_shaded_stone_on_white(self) -> None:
        picture = render(stone(), size=(200, 120))
        assert picture.shape == (120, 200, 3)
        assert picture.dtype == np.uint8
        drawn = is_drawn(picture)
        assert 0.2 < drawn.mean() < 0.8
        assert (picture[[0, 0, -1, -1], [0, -1, 0, -1]] == WHITE).all()
        # Relief reads by contrast: lit and shaded parts of the stone differ by a third of the full range.
        low, high = np.percentile(picture[drawn].mean(axis=1), [5, 95])
        assert high - low > 80

    def test_the_same_mesh_gives_the_same_pixels(self) -> None:
        assert np.array_equal(render(stone(), size=(90, 90)), render(stone(), size=(90, 90)))

    def test_another_mesh_view_or_colour_gives_another_picture(self) -> None:
        plain = render(stone(), size=(90, 90))
        others = [
            render(stone(bumps=0.2), size=(90, 90)),
            render(stone(), size=(90, 90), view=(1.0, 0.5, 0.2)),
            render(stone(), size=(90, 90), colour=(0.5, 0.3, 0.3)),
        ]
        for other in others:
            assert np.abs(plain.astype(int) - other).mean() > 2

    def test_neither_unit_nor_place_of_the_mesh_touches_the_picture(self) -> None:
        mesh = stone()
        small = mesh.with_vertices(1e-3 * mesh.vertices + (5.0, -3.0, 2.0))
        difference = np.abs(render(mesh, size=(90, 90)).astype(int) - render(small, size=(90, 90)))
        assert difference.mean() < 0.05  # a rounded corner may fall on another sample

    def test_a_span_sets_the_scale(self) -> None:
        # An orb of radius 1 in a picture 4 high: the disc covers pi / 16 of it.
        orb = sphere("octahedral", 20)
        share = is_drawn(render(orb, size=(400, 400), span=4.0)).mean()
        assert share == pytest.approx(math.pi / 16, rel=0.03)  # pixels half covered count

    def test_it_stands_up_with_z(self) -> None:
        needle = stone().with_vertices(stone().vertices[:, [2, 1, 0]] * (0.2, 0.2, 2.0))
        rows, columns = np.nonzero(is_drawn(render(needle, size=(120, 120))))
        assert np.ptp(rows) > 3 * np.ptp(columns)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"size": (0, 10)}, "at least 1 x 1 pixel"),
            ({"view": (0.0, 0.0, 1.0)}, "not along z"),
            ({"view": (math.nan, 0.0, 1.0)}, "not along z"),
            ({"span": 0.0}, "positive length"),
            ({"span": math.inf}, "positive length"),
        ],
    )
    def test_nonsense_is_refused(self, options: dict, message: str) -> None:
        with pytest.raises(LithoformError, match=message):
            render(stone(), **options)

    def test_a_studio_shows_each_stone_and_not_the_one_before(self) -> None:
        with Studio((80, 80), rendering.VIEW, rendering.STONE) as studio:
            first, second, third = (studio.picture(stone(bumps), 2.5) for bumps in (0.1, 0.3, 0.1))
        assert np.abs(first.astype(int) - second).mean() > 2
        assert np.array_equal(first, third)


class TestWithoutTheExtra:
    def test_render_and_to_polydata_say_the_same(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "pyvista", None)
        for function in (lambda: render(stone(n=2)), lambda: to_polydata(stone(n=2)), require_pictures):
            with pytest.raises(LithoformError, match="needs pyvista"):
                function()

    @pytest.mark.skipif(sys.platform != "linux", reason="elsewhere OpenGL is part of the system")
    def test_a_machine_without_opengl_is_told_what_to_install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        pytest.importorskip("pyvista")
        monkeypatch.delenv("DISPLAY", raising=False)
        monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
        monkeypatch.setattr(rendering, "_has_library", lambda name: False)
        rendering._find_opengl.cache_clear()
        with pytest.raises(LithoformError, match="install Mesa"):
            render(stone(n=2))
        monkeypatch.setattr(rendering, "_has_library", lambda name: "OSMesa" in name)
        rendering._find_opengl()
        assert os.environ["VTK_DEFAULT_OPENGL_WINDOW"] == "vtkOSOpenGLRenderWindow"
        rendering._find_opengl.cache_clear()


def test_polydata_has_the_vertices_and_faces() -> None:
    pytest.importorskip("pyvista")
    mesh = stone(n=3)
    data = to_polydata(mesh)
    assert np.array_equal(data.points, mesh.vertices)
    assert np.array_equal(data.regular_faces, mesh.faces)
    data.points[0] = 9.0  # a copy: the stone stays as it is
    assert not (mesh.vertices[0] == 9.0).any()
