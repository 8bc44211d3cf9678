"""Pages of stones: all of them there, at one scale, the same each time, and a clear word where there can be none."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from wavy import is_drawn, stone

from lithoform.errors import LithoformError, OutputError
from lithoform.figures.gallery import Variation, figure_2, gallery, png_bytes
from lithoform.parameters import PARAMETERS, Recipe
from lithoform.reproduce import plates as reproduce
from lithoform.topology import sphere


def read(path: Path) -> np.ndarray:
    image = pytest.importorskip("PIL.Image")
    with image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


@pytest.mark.usefixtures("drawing")
class TestGallery:
    @pytest.mark.parametrize(("count", "cells"), [(1, (1, 1)), (3, (2, 2)), (12, (4, 3))])
    def test_every_stone_and_caption_is_on_the_sheet(self, tmp_path: Path, count: int, cells: tuple[int, int]) -> None:
        path = tmp_path / "gallery.png"
        meshes = [stone(0.02 * i) for i in range(count)]
        assert gallery(meshes, [f"{i} cube\n2 x 1.5 x 1 $" for i in range(count)], path) == path
        sheet = is_drawn(read(path))
        columns, rows = cells
        pitch = 260 + 12 + 2 * 19
        assert sheet.shape == (16 + rows * pitch + 56, columns * 320 + 32)
        for i in range(columns * rows):
            left, top = 16 + (i % columns) * 320, 16 + (i // columns) * pitch
            assert (sheet[top : top + 260, left : left + 320].mean() > 0.1) == (i < count)
            assert sheet[top + 262 : top + 300, left : left + 320].any() == (i < count)
        assert not list(tmp_path.glob(".*"))

    def test_the_same_stones_give_the_same_bytes(self, tmp_path: Path) -> None:
        paths = [gallery([stone(), stone(0.2)], ["a", "b"], tmp_path / name) for name in ("1.png", "2.png")]
        assert paths[0].read_bytes() == paths[1].read_bytes()

    def test_the_scale_bar_is_as_long_as_it_says(self, tmp_path: Path) -> None:
        # A 2 m orb: over 320 pixels goes 320 / 260 of the span, and the bar takes at most 0.6 of that.
        orb = sphere("octahedral", 20)
        sheet = is_drawn(read(gallery([orb], ["orb"], tmp_path / "orb.png")))
        bar = np.ptp(np.nonzero(sheet[-24])[0]) + 1
        disc = np.ptp(np.nonzero(sheet[16 : 16 + 260].any(axis=0))[0]) + 1
        assert 2.0 * bar / disc == pytest.approx(1.0, abs=0.02)

    def test_each_at_its_own_scale_has_no_bar_and_equal_sizes(self, tmp_path: Path) -> None:
        meshes = [stone(), stone(scale=0.1)]
        sheet = is_drawn(read(gallery(meshes, ["a", "b"], tmp_path / "each.png", scale="each", columns=2, title="T")))
        assert not sheet[-12:].any()
        halves = sheet[64 : 64 + 260, 16:336], sheet[64 : 64 + 260, 336:656]
        assert halves[0].sum() == pytest.approx(halves[1].sum(), rel=0.01)

    @pytest.mark.parametrize("count", [0, 2])
    def test_a_caption_for_each_mesh_is_needed(self, tmp_path: Path, count: int) -> None:
        with pytest.raises(LithoformError, match=f"{count} meshes and 1 captions"):
            gallery([stone()] * count, ["only one"], tmp_path / "g.png")
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize("option", [{"scale": "some"}, {"unit": "inch"}, {"columns": 0}])
    def test_unknown_options_are_refused(self, tmp_path: Path, option: dict) -> None:
        with pytest.raises(LithoformError, match="scale of common or each"):
            gallery([stone()], ["a"], tmp_path / "g.png", **option)

    def test_a_folder_that_does_not_exist_is_named(self, tmp_path: Path) -> None:
        with pytest.raises(OutputError, match="nowhere"):
            gallery([stone(n=3)], ["a"], tmp_path / "nowhere" / "g.png")


@pytest.mark.usefixtures("drawing")
class TestPlate:
    def test_nineteen_rows_of_five_fit_and_the_benchmark_is_marked(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        made: list[Recipe] = []
        monkeypatch.setitem(sys.modules, "lithoform.generation", stand_in(made))
        path = reproduce.figure_2(tmp_path, seed=3, triangles=800)
        assert path == tmp_path / "fig2.png"
        assert len(made) == len(set(made)) == 1 + 19 * 4  # the benchmark is made once, not nineteen times
        plate = read(path)
        assert plate.shape[0] > 2000
        assert plate.shape[1] > 3000
        assert path.stat().st_size < 6e6
        # The benchmark's cells are on tinted paper, 300 x 262 less the stone; the palette may shift it a little.
        tint = (np.abs(plate.astype(int) - (250, 240, 219)) < 6).all(axis=2).sum()
        assert 19 * 300 * 262 * 0.4 < tint < 19 * 300 * 262

    def test_a_row_without_stones_is_refused(self, tmp_path: Path) -> None:
        for rows in ([], [Variation("k", [])]):
            with pytest.raises(LithoformError, match="at least one stone"):
                figure_2(rows, tmp_path / "p.png")

    def test_strips_are_small_and_named_after_the_fields(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "lithoform.generation", stand_in([]))
        sweeps = [s for s in reproduce.PARAMETER_PLATES if s.symbol in ("kappa", "size", "n_s", "calibration")]
        paths = reproduce.parameter_plates(tmp_path / "images", triangles=800, sweeps=sweeps)
        assert [p.name for p in paths] == [
            "chip_sharpness.png", "size.png", "smoothing_iterations.png", "calibration.png"
        ]  # fmt: skip
        assert all(p.stat().st_size < 150e3 for p in paths)
        assert 5 * 190 <= read(paths[0]).shape[1] < 5 * 190 + 10

    def test_only_png_is_promised(self, tmp_path: Path) -> None:
        with pytest.raises(LithoformError, match=r"\.png"):
            reproduce.figure_2(tmp_path / "fig2.pdf")

    def test_a_file_in_the_way_of_the_folder_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "taken").write_text("")
        with pytest.raises(OutputError, match="taken"):
            reproduce.parameter_plates(tmp_path / "taken" / "images")


def stand_in(made: list[Recipe]) -> SimpleNamespace:
    """A module `generation` that draws bumps for a recipe at once, and notes what was asked for."""

    def generate_many(recipes, *, device="auto", threads=None):
        for recipe in recipes:
            made.append(recipe)
            yield SimpleNamespace(recipe=recipe, mesh=stone(0.5 * recipe.perturbation, n=6))

    return SimpleNamespace(generate_many=generate_many)


class TestSweeps:
    def test_they_are_the_19_of_table_1_in_its_order(self) -> None:
        symbols = "r k s s_w eta delta O lambda g alpha beta gamma kappa A_L f_L a p0 rho size"
        assert [sweep.symbol for sweep in reproduce.FIGURE_2_VARIATIONS] == symbols.split()

    @pytest.mark.parametrize("sweep", reproduce.FIGURE_2_VARIATIONS, ids=lambda sweep: sweep.symbol)
    def test_five_values_with_the_benchmark_over_the_range_of_table_7(self, sweep: reproduce.Sweep) -> None:
        benchmark = Recipe()
        recipes = sweep.recipes(benchmark)  # a Recipe refuses what is out of range
        assert len(set(recipes)) == len(sweep.texts()) == 5
        assert recipes.count(benchmark) == 1
        parameter = next((p for p in PARAMETERS if p.symbol == sweep.symbol), None)
        if parameter and parameter.kind != "vector":
            spread = (max(sweep.values) - min(sweep.values)) / (parameter.high - parameter.low)
            assert spread > 0.97

    def test_every_plate_of_the_documentation_can_be_made(self) -> None:
        names = [sweep.name for sweep in reproduce.PARAMETER_PLATES]
        assert len(names) == len(set(names))
        for sweep in reproduce.PARAMETER_PLATES:
            assert len(sweep.recipes(Recipe())) == len(sweep.texts()) >= 3

    def test_values_are_written_plainly(self) -> None:
        offsets = next(sweep for sweep in reproduce.FIGURE_2_VARIATIONS if sweep.symbol == "delta")
        assert offsets.texts()[0] == "(\N{MINUS SIGN}6, \N{MINUS SIGN}6, \N{MINUS SIGN}6)"


class TestWithoutTheExtra:
    @pytest.mark.parametrize("package", ["pyvista", "matplotlib"])
    def test_a_missing_package_is_named_with_the_way_to_get_it(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str
    ) -> None:
        for name in [name for name in sys.modules if name.split(".")[0] == package]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(LithoformError, match=rf'needs {package}.*pip install "lithoform\[pictures\]"'):
            gallery([stone(n=2)], ["a"], tmp_path / "g.png")
        assert not list(tmp_path.iterdir())


def test_png_bytes_holds_the_pixels() -> None:
    image = pytest.importorskip("PIL.Image")
    picture = np.arange(5 * 4 * 3, dtype=np.uint8).reshape(5, 4, 3)
    with image.open(io.BytesIO(png_bytes(picture))) as read_back:
        assert np.array_equal(np.asarray(read_back), picture)
    with image.open(io.BytesIO(png_bytes(picture, colours=8))) as read_back:
        assert read_back.mode == "P"
        assert len(read_back.getcolors()) <= 8
