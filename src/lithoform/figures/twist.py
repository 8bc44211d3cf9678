"""Calibration and twist in the four classes (Fig. 5): a row a class, its stones and its curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.errors import LithoformError
from lithoform.figures.shape import NOTATION
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, MARKERS, Sheet, sheet
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Studio, load_module

__all__ = ["TwistRow", "twist_figure"]

_WIDTH: Final = 181.0  # [mm]
_CELL: Final = (21.0, 16.5)  # of a stone [mm]
_LABEL, _KEY, _CAPTION, _GAP, _FOOT = 9.0, 18.0, 3.4, 5.0, 4.0  # [mm]
_TITLE, _TEXT, _SMALL = 8.5, 7.0, 6.0  # [pt]
_STYLES: Final = ("-", (0, (4, 1.5)))


@dataclass(frozen=True, eq=False)
class TwistRow:
    """Stones and curves of a class.

    Attributes
    ----------
    shape_class : str
    rates : numpy.ndarray, shape (p,)
        [deg per model unit]
    mean, deviation : numpy.ndarray, shape (2, p, 4)
        Of each calibration, in the order of `FOUR`.
    stones : sequence of sequence of (str, Mesh)
        Of each calibration, the stones of one seed and how their rates are written.
    """

    shape_class: str
    rates: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    stones: Sequence[Sequence[tuple[str, Mesh]]]


def twist_figure(
    rows: Sequence[TwistRow], calibrations: Sequence[str], *, title: str, note: str = "", dpi: int = DPI
) -> np.ndarray:
    """Stones of each class at rising twist, calibrated in two ways, beside the curves of the descriptors.

    Parameters
    ----------
    rows : sequence of TwistRow
    calibrations : sequence of str
        What the two are called; the curves of the second are dashed.
    title, note : str
        Over the rows.
    dpi : int
        Pixels per inch.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8

    Raises
    ------
    LithoformError
        If there are no rows, or nothing can be drawn.
    """
    if not rows:
        raise LithoformError("a figure of the twist needs at least one class; got none.")
    strips = len(calibrations)
    tall = strips * (_CELL[1] + _CAPTION)
    pitch = tall + _GAP + _FOOT
    columns = max(len(strip) for row in rows for strip in row.stones)
    with sheet(_WIDTH, _KEY + len(rows) * pitch, dpi) as page:
        page.text(2.0, 4.0, title, size=_TITLE + 1.5, ha="left", weight="bold", parse_math=False)
        page.text(2.0, 8.5, note, size=_TEXT, ha="left", color=GREY, parse_math=False)
        _write_key(page, calibrations)
        size = page.to_pixels(_CELL[0]), page.to_pixels(_CELL[1])
        with Studio(size, VIEW, STONE) as studio:
            for i, row in enumerate(rows):
                top = _KEY + i * pitch
                page.text(2.0, top + 0.5 * _GAP, row.shape_class, size=_TITLE, ha="left", weight="bold")
                span = studio.span([mesh for strip in row.stones for _, mesh in strip])
                for j, (name, strip) in enumerate(zip(calibrations, row.stones, strict=True)):
                    up = top + _GAP + j * (_CELL[1] + _CAPTION)
                    page.text(2.0, up + 0.5 * _CELL[1], name, size=_TEXT, ha="left")
                    for k, (caption, mesh) in enumerate(strip):
                        left = _LABEL + k * _CELL[0]
                        page.paste(studio.picture(mesh, span), left, up)
                        page.text(left + 0.5 * _CELL[0], up + _CELL[1] + 0.4 * _CAPTION, caption, size=_SMALL,
                                  color=GREY)  # fmt: skip
                left = _LABEL + columns * _CELL[0] + 11.0
                _draw(page.axes(left, top + _GAP, _WIDTH - left - 3.0, tall - 3.0), row)
        return page.pixels()


def _draw(axes: Any, row: TwistRow) -> None:
    for i, style in enumerate(_STYLES[: len(row.mean)]):
        for column in range(len(FOUR)):
            mean, deviation, colour = row.mean[i, :, column], row.deviation[i, :, column], COLOURS[column]
            if i == 0:
                axes.fill_between(row.rates, mean - deviation, mean + deviation, color=colour, alpha=0.15, linewidth=0)
            axes.plot(row.rates, mean, color=colour, linestyle=style, marker=MARKERS[column], markersize=2.4,
                      markeredgewidth=0, linewidth=0.9)  # fmt: skip
    axes.set(ylim=(0.0, 1.0), xlim=(row.rates[0] - 1.5, row.rates[-1] + 1.5))
    axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "", "0.5", "", "1"])
    axes.set_xticks(row.rates, [f"{rate:g}°" for rate in row.rates])
    axes.set_xlabel("twist rate $\\rho$", fontsize=_SMALL, color=INK, labelpad=1.0)
    axes.tick_params(labelsize=_SMALL, length=2.0, width=0.5, colors=INK, pad=2.0)
    for side, spine in axes.spines.items():
        spine.set(linewidth=0.5, color=GREY, visible=side in ("left", "bottom"))


def _write_key(page: Sheet, calibrations: Sequence[str]) -> None:
    line = load_module("matplotlib.lines").Line2D
    entries = [(COLOURS[i], MARKERS[i], "-", f"{NOTATION[name][0]} ${NOTATION[name][1]}$") for i, name in
               enumerate(FOUR)]  # fmt: skip
    entries += [(INK, "", style, name) for style, name in zip(_STYLES, calibrations, strict=False)]
    left = 2.0
    for colour, marker, style, text in entries:
        ends = [x / page.width for x in (left, left + 6.0)], [1.0 - 13.5 / page.height] * 2
        artist = line(*ends, color=colour, marker=marker, linestyle=style, markersize=2.8, markeredgewidth=0,
                      linewidth=1.1)  # fmt: skip
        page.figure.add_artist(artist)
        page.text(left + 7.5, 13.5, text, size=_TEXT, ha="left")
        left += 33.0 if marker else 18.0
