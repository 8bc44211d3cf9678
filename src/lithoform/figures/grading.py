"""The mass curve of a gradation: percent passing over the opening of the sieves, with what was drawn to meet it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import LithoformError
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, sheet

__all__ = ["grading_curve"]

_WIDTH, _LEFT, _RIGHT = 120.0, 13.0, 4.0  # [mm]
_AXES, _FOOT, _HEAD, _LEGEND_ROW = 66.0, 16.0, 4.0, 3.6  # [mm]
_TEXT, _SMALL = 7.5, 6.5  # [pt]
_LABEL_PITCH: Final = 2.7  # of the labels of the sieves, which stand upright [mm]
_MILLIMETRES: Final = 1e3
_TINT: Final = "#f4f2ee"
_GRID: Final = "#d8d4cc"


def grading_curve(
    openings: ArrayLike,
    passing: ArrayLike,
    *,
    limits: tuple[ArrayLike, ArrayLike] | None = None,
    drawn: tuple[ArrayLike, ArrayLike] | None = None,
    met: tuple[ArrayLike, ArrayLike] | None = None,
    least: float | None = None,
    title: str | None = None,
    dpi: int = DPI,
) -> np.ndarray:
    """Percent of the mass that passes, upwards, over the opening in a logarithmic scale.

    Parameters
    ----------
    openings : array_like, shape (k,)
        Of the sieves [m], falling.
    passing : array_like, shape (k,)
        Curve that was asked for [percent].
    limits : (array_like, array_like), each of shape (k,), optional
        Lower and upper limit of the standard [percent].
    drawn : (array_like, array_like), each of shape (n,), optional
        Sizes [m] and percent passing of what was drawn, as a line.
    met : (array_like, array_like), each of shape (j,), optional
        Openings [m] and percent passing of what was drawn at the sieves, as points.
    least : float, optional
        Size below which nothing was drawn [m]; the range is tinted and named.
    title : str, optional
    dpi : int
        Pixels per inch: the figure is 120 mm wide in print.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        The same numbers give the same pixels; `lithoform.figures.gallery.png_bytes` makes a file of them.

    Raises
    ------
    LithoformError
        If the openings do not fall, a list has another length than its partner or a value out of range, or
        Matplotlib is not installed.
    """
    sieves, asked = _pair("the curve", openings, passing)
    if len(sieves) < 2 or not (np.diff(sieves) < 0.0).all():
        raise LithoformError(f"expected two openings or more that fall; got {sieves.tolist()}.")
    low_high = None if limits is None else [_pair("the limits", openings, limit)[1] for limit in limits]
    line, points = (None if pair is None else _pair(name, *pair) for name, pair in (("the draw", drawn), ("met", met)))
    rows = 1 + sum(item is not None for item in (low_high, line, points))
    head = _HEAD + _LEGEND_ROW * rows + (3.0 if title else 0.0)
    wide = _WIDTH - _LEFT - _RIGHT
    with sheet(_WIDTH, head + _AXES + _FOOT, dpi) as page:
        room = (sieves[0] / sieves[-1]) ** 0.02
        span = sieves[-1] / room, sieves[0] * room
        axes = page.axes(_LEFT, head, wide, _AXES, xscale="log", xlim=span, ylim=(0, 100))
        _draw_frame(axes, sieves, span, wide)
        if low_high is not None:
            axes.fill_between(sieves, *low_high, color=GREY, alpha=0.22, linewidth=0, zorder=1.0, label="limits")
        if least is not None and least > span[0] * 1.02 * room:
            axes.axvspan(span[0], least, color=_TINT, linewidth=0, zorder=0.2)
            axes.axvline(least, color=GREY, linewidth=0.8, linestyle=(0, (4, 2.5)), zorder=1.5)
            if np.log(least / span[0]) > 0.16 * np.log(span[1] / span[0]):
                paper = {"facecolor": _TINT, "edgecolor": "none", "pad": 1.0}
                axes.text(np.sqrt(span[0] * least), 94.0, "finer: not drawn", fontsize=_SMALL, color=INK, ha="center",
                          va="center", bbox=paper, zorder=4.0)  # fmt: skip
        axes.plot(sieves, asked, "-", color=COLOURS[0], linewidth=1.2, zorder=2.0, label="asked for")
        if line is not None:
            axes.plot(*line, "-", color=COLOURS[1], linewidth=0.8, zorder=2.5, label="drawn")
        if points is not None:
            axes.plot(*points, "o", color="white", markeredgecolor=COLOURS[1], markeredgewidth=0.9, markersize=4.0,
                      zorder=3.0, label="drawn, at the sieves", clip_on=False)  # fmt: skip
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0 + 2.0 / _AXES), frameon=False, fontsize=_SMALL,
                    handlelength=1.8, handletextpad=0.6, borderaxespad=0.0, borderpad=0.0, labelspacing=0.35,
                    labelcolor=INK)  # fmt: skip
        if title:
            page.text(_LEFT, 3.2, title, size=_TEXT + 0.5, ha="left", weight="bold", parse_math=False)
        return page.pixels()


def _draw_frame(axes: Any, sieves: np.ndarray, span: tuple[float, float], wide: float) -> None:
    places = np.log(sieves / span[0]) / np.log(span[1] / span[0]) * wide
    named: list[int] = []
    for i, place in enumerate(places):
        if not named or places[named[-1]] - place >= _LABEL_PITCH:
            named.append(i)
    axes.set_xticks(sieves[named], [f"{_MILLIMETRES * sieves[i]:.4g}" for i in named], rotation=90)
    axes.set_xticks([], minor=True)
    ticks = np.arange(0, 101, 20)
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.tick_params(labelsize=_SMALL, width=0.5, length=2.0, colors=INK, pad=2.0)
    for sieve in sieves:
        axes.axvline(sieve, color=_GRID, linewidth=0.5, zorder=0.5)
    for tick in ticks[1:-1]:
        axes.axhline(tick, color=_GRID, linewidth=0.5, zorder=0.5)
    axes.set_xlabel("opening of the sieve [mm]", fontsize=_TEXT, color=INK, labelpad=3.0)
    axes.set_ylabel("passing [% of the mass]", fontsize=_TEXT, color=INK, labelpad=3.0)
    for spine in axes.spines.values():
        spine.set(linewidth=0.6, color=INK, zorder=3.5)


def _pair(name: str, sizes: ArrayLike, percent: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.asarray(sizes, dtype=np.float64), np.asarray(percent, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape or not len(x):
        raise LithoformError(f"expected one percentage a size for {name}; got shapes {x.shape} and {y.shape}.")
    slack = 1e-9
    if not ((x > 0.0) & (x < np.inf)).all() or not ((y >= -slack) & (y <= 100.0 + slack)).all():
        raise LithoformError(f"expected positive sizes and percentages of 0 to 100 for {name}; got others.")
    return x, y
