"""Zingg's classes at 2/3, and the diagram: every stone counted once, where it belongs."""

from __future__ import annotations

import math
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from captions import record_captions
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform.errors import LithoformError
from lithoform.figures.gallery import png_bytes
from lithoform.figures.zingg import zingg_class, zingg_counts, zingg_diagram
from lithoform.presets import SHAPE_CLASSES, ZINGG_LIMIT, draw_size, shape_class_of

BELOW, ABOVE = math.nextafter(ZINGG_LIMIT, 0.0), math.nextafter(ZINGG_LIMIT, 1.0)
index = st.floats(1e-3, 1.0)


class TestClasses:
    @pytest.mark.parametrize(
        ("elongation", "flatness", "name"),
        [
            (1.0, 1.0, "cube"),
            (0.9, 0.3, "plate"),
            (0.3, 0.9, "column"),
            (0.3, 0.3, "blade"),
            # Exactly 2/3 is not below it; the next number down is.
            (ZINGG_LIMIT, ZINGG_LIMIT, "cube"),
            (ZINGG_LIMIT, BELOW, "plate"),
            (BELOW, ZINGG_LIMIT, "column"),
            (BELOW, BELOW, "blade"),
            (ABOVE, ABOVE, "cube"),
        ],
    )
    def test_they_divide_at_two_thirds(self, elongation: float, flatness: float, name: str) -> None:
        assert zingg_class(elongation, flatness) == name

    @settings(deadline=None, max_examples=100)
    @given(elongation=index, flatness=index)
    def test_they_are_those_of_the_recipes(self, elongation: float, flatness: float) -> None:
        size = (1.0, elongation, elongation * flatness)
        # From dimensions, FI is found again only to the last bit.
        if abs(flatness - ZINGG_LIMIT) > 1e-12:
            assert zingg_class(elongation, flatness) == shape_class_of(size)

    def test_dimensions_drawn_inside_a_class_are_in_it(self) -> None:
        for shape_class in SHAPE_CLASSES:
            a, b, c = np.array([draw_size(shape_class, seed)[::-1] for seed in range(50)]).T
            assert (zingg_class(b / c, a / b) == shape_class).all()

    def test_the_shape_of_the_arrays_is_kept(self) -> None:
        grid = np.linspace(0.1, 1.0, 12).reshape(3, 4)
        assert zingg_class(grid, grid).shape == (3, 4)
        assert zingg_class(0.5, 0.5).shape == ()
        assert zingg_class([], []).shape == (0,)

    def test_every_stone_is_counted_once(self) -> None:
        # 90 x 90 midpoints of cells; a third of each axis is above 2/3.
        middle = (np.arange(90) + 0.5) / 90
        elongation, flatness = (axis.ravel() for axis in np.meshgrid(middle, middle))
        counts = {"cube": 30 * 30, "plate": 30 * 60, "column": 60 * 30, "blade": 60 * 60}
        assert zingg_counts(elongation, flatness) == counts
        assert list(zingg_counts([0.5], [0.5])) == list(SHAPE_CLASSES)

    @pytest.mark.parametrize("wrong", [0.0, -0.5, 1.0000001, math.nan, math.inf])
    @pytest.mark.parametrize("which", ["elongation", "flatness"])
    def test_what_is_no_ratio_is_refused(self, wrong: float, which: str) -> None:
        indices = {"elongation": [0.5, 0.5], "flatness": [0.5, 0.5], which: [0.5, wrong]}
        with pytest.raises(LithoformError, match=rf"at most 1, for every {which} index; got {wrong}"):
            zingg_class(**indices)

    def test_one_of_each_is_needed(self) -> None:
        with pytest.raises(LithoformError, match=r"shapes \(2,\) and \(3,\)"):
            zingg_class([0.5, 0.5], [0.5, 0.5, 0.5])


def spread(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return generator.uniform(0.3, 1.0, count), generator.uniform(0.3, 1.0, count)


@pytest.mark.skipif(find_spec("matplotlib") is None, reason="needs matplotlib, of the extra pictures")
class TestDiagram:
    def test_it_has_its_size_in_print(self) -> None:
        picture = zingg_diagram({"stones": spread(0, 20)}, dpi=100)
        assert picture.dtype == np.uint8
        assert picture.shape[1] == round(85.0 / 25.4 * 100)
        assert zingg_diagram({"stones": spread(0, 20)}, dpi=200).shape[1] == round(85.0 / 25.4 * 200)

    @pytest.mark.parametrize(
        ("elongation", "flatness", "columns", "rows"),
        [(0.85, 0.45, 0.45, 0.15), (0.2, 0.8, 0.8, 0.8), (0.5, 0.25, 0.25, 0.5), (0.75, 0.75, 0.75, 0.25)],
    )
    def test_a_point_is_where_its_indices_put_it(
        self, elongation: float, flatness: float, columns: float, rows: float
    ) -> None:
        # FI runs to the right, EI upwards: against a diagram of another stone, two points differ.
        pictures = [
            zingg_diagram({"a": ([e], [f])}, dpi=150).astype(int)
            for e, f in ((elongation, flatness), (elongation, flatness - 0.06))
        ]
        frame = (np.abs(pictures[0] - (43, 42, 40)) < 12).all(axis=2)
        across = np.flatnonzero(frame.sum(axis=0) > 0.5 * frame.shape[0])
        down = np.flatnonzero(frame.sum(axis=1) > 0.5 * frame.shape[1])
        changed = np.abs(pictures[0] - pictures[1]).sum(axis=2) > 30
        y, x = np.nonzero(changed)
        left, right, top, bottom = across.min(), across.max(), down.min(), down.max()
        inside = (x > left) & (x < right) & (y > top) & (y < bottom)
        y, x = y[inside], x[inside]
        side = right - left
        assert bottom - top == pytest.approx(side, abs=1.5)  # one scale for both
        assert (x.max() - left) / side == pytest.approx(columns, abs=0.025)
        assert (x.min() - left) / side == pytest.approx(columns - 0.06, abs=0.025)
        assert (y.mean() - top) / side == pytest.approx(rows, abs=0.02)

    def test_numbers_and_shares_are_written_for_each_population(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        first = [0.9, 0.9, 0.9, 0.5], [0.9, 0.8, 0.5, 0.9]  # 2 cubes, a plate, a column
        zingg_diagram({"generated": first, "scanned": ([0.4, 0.4], [0.4, 0.9])}, title="By $form", dpi=80)
        shown = [caption.text for caption in captions]
        for expected in ("2 (50.0 %)", "1 (25.0 %)", "0 (0.0 %)", "1 (50.0 %)", "generated (n = 4)", "scanned (n = 2)"):
            assert expected in shown
        assert shown.count("0 (0.0 %)") == 1 + 2
        assert set(SHAPE_CLASSES) <= set(shown)
        assert "By $form" in shown

    @pytest.mark.parametrize("count", [1, 2, 6])
    def test_no_text_lies_on_another_or_runs_off(self, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
        captions = record_captions(monkeypatch)
        zingg_diagram({f"crushed limestone {i}": spread(i, 2000) for i in range(count)}, title="A title", dpi=150)
        assert len(captions) == 2 * 6 + 2 + 2 + 1 + 4 + 5 * count  # ticks, 2/3, axes, title, classes, numbers

    def test_a_second_population_has_its_own_colour(self) -> None:
        one = zingg_diagram({"a": spread(1, 200)}, dpi=100).astype(int)
        two = zingg_diagram({"a": spread(1, 200), "b": spread(2, 200)}, dpi=100).astype(int)
        vermilion = [((p[..., 0] - p[..., 2]) > 60).sum() for p in (one, two)]
        assert vermilion[0] == 0
        assert vermilion[1] > 200

    def test_the_bytes_are_the_same_whatever_the_users_settings(self) -> None:
        matplotlib = pytest.importorskip("matplotlib")
        populations = {"a": spread(3, 100), "b": spread(4, 30)}
        plain = png_bytes(zingg_diagram(populations, dpi=80))
        with matplotlib.rc_context({"font.size": 20, "font.family": "serif", "axes.linewidth": 5, "axes.grid": True}):
            assert png_bytes(zingg_diagram(populations, dpi=80)) == plain

    @pytest.mark.parametrize(
        ("populations", "message"),
        [
            ({}, "1 to 6 populations; got 0"),
            ({str(i): ([0.5], [0.5]) for i in range(7)}, "1 to 6 populations; got 7"),
            ({"none": ([], [])}, r"at least one stone.*shape \(0,\) for 'none'"),
            ({"grid": ([[0.5]], [[0.5]])}, "arrays of shape"),
            ({"a": ([0.5], [1.5])}, r"flatness index; got 1\.5"),
        ],
    )
    def test_nonsense_is_refused(self, populations: dict, message: str) -> None:
        with pytest.raises(LithoformError, match=message):
            zingg_diagram(populations)

    @pytest.mark.parametrize("dpi", [0, 49, 1201])
    def test_a_resolution_has_limits(self, dpi: int) -> None:
        with pytest.raises(LithoformError, match=f"50 to 1200 pixels per inch; got {dpi}"):
            zingg_diagram({"a": ([0.5], [0.5])}, dpi=dpi)

    def test_without_matplotlib_it_says_what_to_install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ("matplotlib", "matplotlib.style", "matplotlib.figure"):
            monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(LithoformError, match=r"needs matplotlib.*lithoform\[pictures\]"):
            zingg_diagram({"a": ([0.5], [0.5])})
