"""The figure of resolutions: every row in its place, every drift written, and nothing missing goes unsaid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from captions import record_captions
from wavy import stone

from lithoform.errors import LithoformError
from lithoform.figures.gallery import png_bytes
from lithoform.figures.resolution import Resolution, _drift, resolution_figure

DPI = 100
SAMPLES = {"roundness": 0.31, "boxiness": 0.52, "solidity": 0.87, "true_sphericity": 0.79}


def study(meshes: bool = True, classes: tuple[str, ...] = ("cube", "plate", "column", "blade")) -> list[Resolution]:
    """Made-up numbers: every descriptor of the i-th class drifts by i and 10 i per mille."""
    rows = []
    for i, shape_class in enumerate(classes):
        for count, n, factor in ((51_200, 20, 1.0), (20_000, 12, 1.0 + 0.001 * i), (5_000, 6, 1.0 + 0.010 * i)):
            values = {name: value * factor * (1.0 - 0.04 * i) for name, value in SAMPLES.items()}
            rows.append(Resolution(shape_class, count, values, stone(n=n) if meshes else None))
    return rows


@pytest.mark.usefixtures("drawing")
class TestResolutionFigure:
    def test_columns_are_classes_and_drifts_are_written(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        picture = resolution_figure(study(), dpi=DPI)
        assert picture.shape[1] == round((15.0 + 4 * 41.0 + 2.0) / 25.4 * DPI)
        shown = [caption.text for caption in captions]
        for i, text in enumerate(("0.0 %", "+0.1 %", "+0.2 %", "+0.3 %")):
            assert shown.count(text) == (8 if i == 0 else 4)
        for text in ("+1.0 %", "+2.0 %", "+3.0 %"):
            assert shown.count(text) == 4
        assert {"0.310", "0.520", "0.870", "0.790"} <= set(shown)
        assert {"cube", "plate", "column", "blade", "51,200\ntriangles"} <= set(shown)
        places = [c.left for name in ("cube", "plate", "column", "blade") for c in captions if c.text == name]
        assert places == sorted(places)

    def test_a_falling_value_has_a_minus_sign(self) -> None:
        assert _drift(-0.0123) == "−1.2 %"
        assert _drift(0.0567) == "+5.7 %"
        assert _drift(-0.0001) == "0.0 %"

    def test_without_stones_it_is_lower_by_three_rows(self) -> None:
        heights = [resolution_figure(study(meshes), dpi=DPI).shape[0] for meshes in (True, False)]
        assert heights[0] - heights[1] == pytest.approx(3 * 21.0 / 25.4 * DPI, abs=1.1)

    def test_a_finer_mesh_shows_more_edges_in_its_lens(self) -> None:
        picture = resolution_figure(study(classes=("cube",)), dpi=200)
        per = 200 / 25.4
        left, width = round((15.0 + 27.3) * per), round(13.0 * per)
        ink = []
        for row in range(3):
            top = round((8.0 + row * 21.0 + 4.0) * per)
            lens = picture[top + width // 5 : top + 4 * width // 5, left + width // 5 : left + 4 * width // 5]
            ink.append(np.abs(np.diff(lens.mean(axis=2), axis=1)).mean())
        assert ink[0] > 1.2 * ink[1] > 1.2**2 * ink[2] > 0.0

    def test_the_order_of_the_rows_of_a_class_and_the_users_settings_do_not_matter(self) -> None:
        matplotlib = pytest.importorskip("matplotlib")
        rows = study(classes=("cube", "blade"))
        plain = png_bytes(resolution_figure(rows, dpi=DPI))
        mixed = [*rows[:3][::-1], *rows[3:][::-1]]
        with matplotlib.rc_context({"font.size": 20, "axes.grid": True}):
            assert png_bytes(resolution_figure(mixed, dpi=DPI)) == plain

    def test_other_descriptors_go_by_their_own_names(self, monkeypatch: pytest.MonkeyPatch) -> None:
        captions = record_captions(monkeypatch)
        rows = [Resolution("cube", count, {"fractal_dimension": 2.1}) for count in (20_000, 5_000)]
        resolution_figure(rows, dpi=DPI)
        assert "fractal dimension" in [caption.text for caption in captions]

    def test_a_row_is_missing_double_or_different(self) -> None:
        rows = study(meshes=False)
        cases = [
            ([], "at least one row"),
            ([Resolution("cube", 5_000, {})], "at least one descriptor"),
            (rows[:-1], r"\('blade', 5000\) is missing"),
            ([*rows, rows[0]], r"\('cube', 51200\) twice"),
            ([*rows[:-1], Resolution("blade", 5_000, {"roundness": 0.3})], r"got roundness for \('blade', 5000\)"),
        ]
        for bad in (math.nan, math.inf, 0.0, -1.0):
            wrong = Resolution("blade", 5_000, SAMPLES | {"boxiness": bad})
            cases.append(([*rows[:-1], wrong], f"positive boxiness in every row; got {bad} for"))
        for given_rows, message in cases:
            with pytest.raises(LithoformError, match=message):
                resolution_figure(given_rows)
