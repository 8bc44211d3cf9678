"""Pictures of measures: what is drawn has the projected size that geometry says, and every number stands clear."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest
from captions import record_captions
from hypothesis import given, settings
from hypothesis import strategies as st
from wavy import is_drawn, stone

from lithoform.descriptors.solids import Box, Sphere
from lithoform.errors import LithoformError
from lithoform.figures.gallery import png_bytes
from lithoform.figures.shape import LAYERS, NOTATION, descriptor_label, shape_picture
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Studio, Surface, view_axes
from lithoform.topology import sphere

DPI = 100
ORB = sphere("octahedral", 24)
SAMPLES = {"roundness": 0.31, "boxiness": 0.52, "solidity": 0.87, "true_sphericity": 0.79}


def turned(angles: tuple[float, float, float]) -> np.ndarray:
    """A rotation about z, then y, then x."""
    matrix = np.eye(3)
    for (i, j), angle in zip(((0, 1), (0, 2), (1, 2)), angles, strict=True):
        step = np.eye(3)
        step[[i, i, j, j], [i, j, i, j]] = math.cos(angle), -math.sin(angle), math.sin(angle), math.cos(angle)
        matrix = step @ matrix
    return matrix


def cuboid(box: Box) -> Mesh:
    """The surface of a box, whose corners count in binary."""
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return Mesh(box.corners, faces)


def results(mesh: Mesh, extents: tuple[float, float, float] = (2.3, 1.8, 1.3), radius: float = 0.4) -> dict[str, Any]:
    """Something for every layer, around a stone about the origin."""
    box = Box(np.zeros(3), np.eye(3), np.array(extents))
    weights = np.clip(mesh.vertices[mesh.faces].mean(axis=1)[:, 2], 0.0, None)
    return {
        "inscribed": Sphere(np.zeros(3), radius),
        "box": box,
        "hull": cuboid(box),
        "corner_weights": weights,
        "equal_volume": Sphere(np.zeros(3), 0.75),
    }


def panels(picture: np.ndarray, count: int) -> list[np.ndarray]:
    """The pictures of the stones in a row, without titles and notes: see the measures at the head of the module."""
    per = DPI / 25.4
    rows = slice(round(7.0 * per) + 1, picture.shape[0] - round(6.5 * per) - 1)
    lefts = [1.0 + i * 47.0 for i in range(count)]
    return [picture[rows, round(left * per) : round((left + 46.0) * per)].astype(int) for left in lefts]


def bluish(panel: np.ndarray) -> int:
    return int((panel[..., 2] - panel[..., 0] > 15).sum())


@pytest.mark.usefixtures("drawing")
class TestShapePicture:
    def test_each_layer_is_a_panel_of_46_mm(self) -> None:
        mesh = stone()
        picture = shape_picture(mesh, show=LAYERS, dpi=DPI, **results(mesh))
        assert picture.dtype == np.uint8
        assert picture.shape[1] == round((5 * 47.0 + 1.0) / 25.4 * DPI)
        single = shape_picture(mesh, show=["box"], dpi=DPI, **results(mesh))
        assert single.shape[1] == round(48.0 / 25.4 * DPI)
        shares = [is_drawn(panel).mean() for panel in panels(picture, 5)]
        assert min(shares) > 0.15
        assert max(shares) < 0.85

    @pytest.mark.parametrize("radius", [0.3, 0.5, 0.8])
    def test_the_inscribed_sphere_covers_its_share_of_the_stone(self, radius: float) -> None:
        picture = shape_picture(ORB, show=["inscribed"], inscribed=Sphere(np.zeros(3), radius), dpi=200)
        # Pixels half covered count, the line around the sphere as well.
        assert bluish(picture.astype(int)) / (is_drawn(picture[60:-60]).sum()) == pytest.approx(radius**2, rel=0.06)

    @pytest.mark.parametrize("radius", [0.3, 0.8])
    def test_the_line_around_a_sphere_is_its_outline(self, radius: float) -> None:
        ball = Sphere(np.array([0.1, 0.0, -0.1]), radius)
        picture = shape_picture(ORB, show=["inscribed"], inscribed=ball, dpi=200).astype(int)
        line = (picture[..., 2] - picture[..., 0] > 100) & is_drawn(picture)  # bluer than what the veil lets through
        disc = is_drawn(picture[60:-60])
        for axis in (0, 1):
            across = np.ptp(np.flatnonzero(line.any(axis=axis)))
            whole = np.ptp(np.flatnonzero(disc.any(axis=axis)))
            assert across / whole == pytest.approx(radius, abs=0.02)  # the line has a width of 0.01 of the stone

    @pytest.mark.parametrize("view", [VIEW, (1.0, 0.4, 0.1), (-0.3, 0.2, -0.8)])
    def test_the_hull_covers_the_projected_area_of_a_box(self, view: tuple[float, float, float]) -> None:
        # A box of extents a, b, c shows bc |x| + ca |y| + ab |z| in the direction (x, y, z); the ball pi r^2.
        mesh, extents = stone(n=8), (2.3, 1.8, 1.3)
        given = results(mesh, extents) | {"equal_volume": Sphere(np.zeros(3), 1.2)}
        picture = shape_picture(mesh, show=["hull", "volume"], view=view, dpi=DPI, **given)
        hull, ball = (is_drawn(panel).sum() for panel in panels(picture, 2))
        towards = np.abs(view_axes(view)[2])
        truth = sum(math.prod(extents) / extents[i] * towards[i] for i in range(3)) / (math.pi * 1.2**2)
        assert hull / ball == pytest.approx(truth, rel=0.03)

    @pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.4, 0.3, -0.5), (1.2, -0.7, 0.2)])
    def test_the_box_is_as_high_as_its_projection(self, angles: tuple[float, float, float]) -> None:
        extents, axes = np.array([2.6, 2.2, 1.5]), turned(angles)
        box = Box(np.zeros(3), axes, extents)
        ball = Sphere(np.zeros(3), 1.0)
        picture = shape_picture(stone(), show=["box", "volume"], box=box, equal_volume=ball, dpi=DPI)
        frame, disc = panels(picture, 2)
        ink = (frame.max(axis=2) < 100) & (np.ptp(frame, axis=2) < 12)
        _, up, _ = view_axes(VIEW)
        truth = float((extents * np.abs(axes.T @ up)).sum()) / 2.0
        high = np.ptp(np.flatnonzero(ink.any(axis=1))) / (np.ptp(np.flatnonzero(is_drawn(disc).any(axis=1))))
        if angles != (0.0, 0.0, 0.0):  # the stone turned out of the box would be taller than it
            assert high == pytest.approx(truth, rel=0.04)
        else:
            assert high == pytest.approx(truth, rel=0.03)

    def test_dimensions_are_written_in_millimetres_from_long_to_short(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        mesh = stone(scale=0.01)
        box = Box(np.zeros(3), np.eye(3), np.array([0.0231, 0.018, 0.0035]))
        shape_picture(mesh, show=["box", "inscribed"], box=box, inscribed=Sphere(np.zeros(3), 0.0035), dpi=DPI)
        shown = [caption.text for caption in captions]
        assert "$L$, $W$, $H$ = 23.1, 18.0, 3.50 mm" in shown
        assert {"$L$", "$W$", "$H$"} <= set(shown)
        assert r"inscribed sphere, $r_\mathrm{in}$ = 3.50 mm" in shown

    @pytest.mark.parametrize(
        ("scale", "unit", "text"),
        [
            (1.0, "m", "2.60, 1.90, 1.05 m"),
            (100.0, "cm", "2.60, 1.90, 1.05 m"),
            (0.1, "m", "260, 190, 105 mm"),
            (1.0, "mm", "2.60, 1.90, 1.05 mm"),
            (20.0, "um", "52.0, 38.0, 21.0 µm"),
            (1.0, None, "2.60, 1.90, 1.05"),
            (1000.0, None, "2600, 1900, 1050"),
            (0.01, None, "0.0260, 0.0190, 0.0105"),
        ],
    )
    def test_the_unit_of_length_suits_the_stone(
        self, monkeypatch: pytest.MonkeyPatch, scale: float, unit: str | None, text: str
    ) -> None:
        captions = record_captions(monkeypatch)
        box = Box(np.zeros(3), np.eye(3), scale * np.array([2.6, 1.9, 1.05]))
        shape_picture(stone(scale=scale, n=4), show=["box"], box=box, unit=unit, dpi=DPI)
        assert f"$L$, $W$, $H$ = {text}" in [caption.text for caption in captions]

    def test_each_letter_is_beside_an_edge_of_its_axis(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        box = Box(np.zeros(3), np.eye(3), np.array([2.6, 2.2, 1.5]))
        picture = shape_picture(stone(), show=["box"], box=box, dpi=DPI)
        right, up, _ = view_axes(VIEW)
        # Places in the picture, in lengths of the box, by the letters' own distances from the panel's middle.
        middle = np.array([24.0, (7.0 + picture.shape[0] * 25.4 / DPI - 6.5) / 2]) * DPI / 25.4
        corner_rows = box.corners @ np.stack([right, up], axis=1)
        scale = 46.0 * DPI / 25.4 / (1.13 * np.ptp(corner_rows[:, 0]))
        for axis, symbol in enumerate("LWH"):
            caption = next(c for c in captions if c.text == f"${symbol}$")
            place = np.array(
                [(caption.left + caption.right) / 2, picture.shape[0] - (caption.bottom + caption.top) / 2]
            )
            others = np.delete(np.eye(3), axis, axis=0) * np.delete(box.extents, axis)[:, None] / 2
            middles = [a * others[0] + b * others[1] for a in (-1, 1) for b in (-1, 1)]
            ends = np.array([middle + scale * np.array([m @ right, -(m @ up)]) for m in middles])
            assert np.hypot(*(ends - place).T).min() < 2.5 * DPI / 25.4

    def test_faces_with_weight_are_dark_and_the_others_pale(self) -> None:
        right, _, _ = view_axes(VIEW)
        weights = (ORB.vertices[ORB.faces].mean(axis=1) @ right > 0.3).astype(float)
        picture = shape_picture(ORB, show=["corners"], corner_weights=weights, dpi=DPI)
        panel = panels(picture, 1)[0]
        disc = is_drawn(panel)
        dark = disc & (panel[..., 1] < 60)  # both ends of the map under any light: green below and above
        # The part of a disc beyond 0.3 of its radius.
        truth = (math.acos(0.3) - 0.3 * math.sqrt(1.0 - 0.3**2)) / math.pi
        assert dark.sum() / disc.sum() == pytest.approx(truth, rel=0.06)  # the rim is half paper
        assert np.nonzero(dark)[1].min() > np.nonzero(disc)[1].mean()

    def test_the_colour_bar_ends_where_the_colours_do(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        weights = np.linspace(0.0, 50.0, len(ORB.faces))
        shape_picture(ORB, show=["corners"], corner_weights=weights, dpi=DPI)
        most = np.quantile(weights[1:], 0.99)
        shown = {caption.text for caption in captions}
        assert {"0", f"{most / 2:.2g}", f"{most:.2g}", "corner weight"} <= shown

    def test_a_stone_without_corners_is_drawn(self) -> None:
        picture = shape_picture(ORB, show=["corners"], corner_weights=np.zeros(len(ORB.faces)), dpi=DPI)
        assert is_drawn(panels(picture, 1)[0]).mean() > 0.3

    def test_a_title_changes_nothing_but_the_head(self) -> None:
        mesh = stone()
        plain, titled = (
            shape_picture(mesh, show=["hull"], labels=labels, dpi=DPI, **results(mesh))
            for labels in (None, {"hull": descriptor_label("solidity", 0.87), "box": "not shown"})
        )
        changed = (plain != titled).any(axis=2)
        assert changed[: round(7.0 * DPI / 25.4)].any()
        assert not changed[round(7.0 * DPI / 25.4) :].any()

    def test_no_text_lies_on_another_or_runs_off(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        mesh = stone(scale=0.0123, n=6)
        titles = dict(
            zip(LAYERS, (descriptor_label(*item) for item in [*SAMPLES.items(), ("roundness", 0.3)]), strict=True)
        )
        for extents in ((2.3, 1.8, 1.3), (2.3, 1.0, 0.3), (2.3, 0.4, 0.3), (2.0, 2.0, 2.0)):
            for view in (VIEW, (1.0, 0.2, 0.3), (0.1, 0.6, 2.0)):
                given = results(mesh, tuple(0.0123 * extent for extent in extents), 0.0044)
                given |= {"equal_volume": Sphere(np.zeros(3), 0.009)}
                shape_picture(mesh, show=LAYERS, labels=titles, view=view, dpi=DPI, **given)
        assert len(captions) == 12 * (5 + 3 + 5 + 3)  # titles, letters, notes, ticks

    def test_a_veil_keeps_the_sight_of_what_is_under_it(self) -> None:
        # Two balls too small to be seen but through the veil: beyond them, half of the stone and half of the paper.
        ball, mesh = Sphere(np.zeros(3), 0.05), stone(n=20)
        show = ["volume", "inscribed"]
        picture = shape_picture(mesh, show=show, equal_volume=ball, inscribed=ball, dpi=DPI)
        opaque, clear = panels(picture, 2)
        rows, columns = np.indices(opaque.shape[:2])
        beyond = np.hypot(rows - opaque.shape[0] / 2, columns - opaque.shape[1] / 2) > 20
        assert np.abs(clear - (0.5 * opaque + 0.5 * 255))[beyond].max() <= 1.0
        assert bluish(clear) > 30

    def test_the_same_results_give_the_same_bytes(self) -> None:
        matplotlib = pytest.importorskip("matplotlib")
        mesh = stone()
        first = png_bytes(shape_picture(mesh, show=LAYERS, dpi=DPI, **results(mesh)))
        with matplotlib.rc_context({"font.size": 20, "lines.linewidth": 7, "figure.facecolor": "red"}):
            assert png_bytes(shape_picture(mesh, show=LAYERS, dpi=DPI, **results(mesh))) == first

    def test_place_and_unit_do_not_touch_the_picture(self) -> None:
        mesh, shift, scale = stone(), np.array([5.0, -3.0, 2.0]), 1e3
        there = mesh.with_vertices(scale * mesh.vertices + shift)
        here = results(mesh)
        box = Box(shift, np.eye(3), scale * here["box"].extents)
        moved = {
            "inscribed": Sphere(shift, scale * here["inscribed"].radius),
            "box": box,
            "hull": cuboid(box),
            "corner_weights": here["corner_weights"],
            "equal_volume": Sphere(shift, scale * here["equal_volume"].radius),
        }
        pictures = [
            shape_picture(mesh, show=LAYERS, unit="m", dpi=DPI, **here),
            shape_picture(there, show=LAYERS, unit="mm", dpi=DPI, **moved),
        ]
        assert np.abs(pictures[0].astype(int) - pictures[1]).mean() < 0.1

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"show": ["hul"]}, "expected layers of inscribed, box, hull, corners, volume; got 'hul'"),
            ({"show": []}, "one or more of the layers inscribed"),
            ({"show": "box"}, "a sequence of one or more"),
            ({"labels": {"roundness": "R"}}, "expected layers of .*; got 'roundness'"),
            ({"show": ["hull"], "hull": None}, "'hull' shows the result 'hull', which is not given"),
            ({"show": ["volume"], "equal_volume": None}, "'volume' shows the result 'equal_volume'"),
            ({"inscribed": Sphere(np.zeros(3), 0.0)}, "positive size of what the layer 'inscribed' shows; got 0"),
            ({"box": Box(np.zeros(3), np.eye(3), np.array([2.0, 1.0, math.nan]))}, "'box' shows; got 2, 1, nan"),
            ({"unit": "inch"}, "expected a unit of m, cm, mm, um or None; got 'inch'"),
            ({"corner_weights": np.ones(7)}, r"one corner weight for each of 1152 faces; got an array of shape \(7,\)"),
            ({"corner_weights": np.full(1152, np.nan)}, "finite and not negative"),
            ({"corner_weights": np.full(1152, -1.0)}, "finite and not negative"),
            ({"view": (0.0, 0.0, 1.0)}, "not along z"),
            ({"dpi": 10}, "50 to 1200 pixels per inch; got 10"),
        ],
    )
    def test_nonsense_is_refused(self, options: dict[str, Any], message: str) -> None:
        mesh = stone()
        with pytest.raises(LithoformError, match=message):
            shape_picture(mesh, **(results(mesh) | options))


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("matplotlib", "matplotlib.style", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(LithoformError, match=r"needs matplotlib.*lithoform\[pictures\]"):
        shape_picture(ORB, show=["volume"], equal_volume=Sphere(np.zeros(3), 1.0))


class TestNotation:
    def test_a_label_has_name_symbol_and_value(self) -> None:
        assert descriptor_label("roundness", 0.3149) == "Roundness $R$ = 0.31"
        assert descriptor_label("solidity", 0.8765, digits=3) == "3D solidity $S_{3D}$ = 0.876"
        assert list(NOTATION) == list(SAMPLES)

    def test_an_unknown_descriptor_is_refused(self) -> None:
        with pytest.raises(LithoformError, match=r"expected a descriptor of roundness, boxiness, .*; got 'beauty'"):
            descriptor_label("beauty", 1.0)


@pytest.mark.usefixtures("drawing")
class TestScene:
    def test_the_nearer_body_hides_the_farther(self) -> None:
        towards = view_axes(VIEW)[2]
        small = ORB.with_vertices(0.4 * ORB.vertices + 2.0 * towards)
        with Studio((80, 80), VIEW, STONE) as studio:
            placement = studio.placement(ORB.vertices, 2.4)
            red = Surface(small, (0.9, 0.1, 0.1), faceting=0.0, cavity=0.0)
            both = studio.scene([Surface(ORB), red], placement).astype(int)
            behind = Surface(small.with_vertices(small.vertices - 4.0 * towards), (0.9, 0.1, 0.1))
            hidden = studio.scene([Surface(ORB), behind], placement)
            alone = studio.scene([Surface(ORB)], placement)
        assert np.array_equal(hidden, alone)
        share = (both[..., 0] - both[..., 1] > 60).sum() / is_drawn(alone).sum()
        assert share == pytest.approx(0.16, rel=0.08)

    def test_a_body_that_reaches_past_the_eye_is_still_whole(self) -> None:
        # Magnified twenty times, a ball reaches beyond the usual place of the camera.
        with Studio((60, 60), VIEW, STONE) as studio:
            picture = studio.scene([Surface(ORB)], studio.placement(ORB.vertices, 0.1))
        assert is_drawn(picture).all()

    @settings(deadline=None, max_examples=25)
    @given(
        view=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
            lambda v: math.hypot(*v[:2]) > 0.05
        ),
    )
    def test_the_axes_of_a_view_are_orthonormal_and_right_handed(self, view: tuple[float, float, float]) -> None:
        axes = np.stack(view_axes(view))
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert axes[0, 2] == pytest.approx(0.0, abs=1e-15)
        assert axes[1, 2] > 0.0

    def test_pixels_are_where_a_body_is_drawn(self) -> None:
        centre = np.array([0.3, -0.2, 0.4])
        with Studio((120, 90), VIEW, STONE) as studio:
            placement = studio.placement(ORB.vertices, 2.6)
            dot = Surface(ORB.with_vertices(0.1 * ORB.vertices + centre))
            rows, columns = np.nonzero(is_drawn(studio.scene([dot], placement)))
        place = placement.pixels(centre[None])[0]
        assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx(tuple(place), abs=0.3)
        assert np.ptp(columns) + 1 == pytest.approx(0.2 * placement.pixels_per_length, abs=1.5)
