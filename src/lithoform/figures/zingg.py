"""Zingg's classes of form, and his diagram (Fig. 4a): how elongated and how flat the stones of a population are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import LithoformError
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, MARKERS, sheet
from lithoform.presets import SHAPE_CLASSES, ZINGG_LIMIT, shape_class_of

__all__ = ["zingg_class", "zingg_counts", "zingg_diagram"]

_WIDTH, _AXES, _LEFT, _FOOT = 85.0, 67.0, 12.0, 10.5  # [mm]
_LEGEND_ROW, _HEAD = 3.4, 5.0  # [mm]
_TEXT, _SMALL = 7.5, 6.5  # [pt]

# Names by (elongation index below the limit, flatness index below the limit): the rule of `presets`, asked at the
# middle of each quarter.
_NAMES: Final = np.array(
    [[shape_class_of((1.0, middle, middle * other)) for other in (5 / 6, 1 / 2)] for middle in (5 / 6, 1 / 2)]
)
# Where each quarter's name and numbers stand in the diagram, and which way they are set from there: in the outer
# corners, where the fewest stones are.
_CORNERS: Final = {
    "cube": (0.985, 0.985, "right", "top"),
    "plate": (0.015, 0.985, "left", "top"),
    "column": (0.985, 0.015, "right", "bottom"),
    "blade": (0.015, 0.015, "left", "bottom"),
}


def zingg_class(elongation: ArrayLike, flatness: ArrayLike) -> np.ndarray:
    """Zingg's class of each stone, divided at 2/3 (eq. 22).

    Parameters
    ----------
    elongation : array_like
        Elongation index EI = l_b / l_c, intermediate over longest dimension, in (0, 1].
    flatness : array_like, of the same shape
        Flatness index FI = l_a / l_b, shortest over intermediate dimension, in (0, 1].

    Returns
    -------
    numpy.ndarray of str, of the same shape
        "cube": neither index below 2/3; "plate": only FI below; "column": only EI below; "blade": both below.
        An index of exactly 2/3 (in float64) is not below.

    Raises
    ------
    LithoformError
        If the shapes differ or an index is not in (0, 1].
    """
    slim, flat = (index < ZINGG_LIMIT for index in _checked(elongation, flatness))
    return _NAMES[slim.astype(np.intp), flat.astype(np.intp)]


def zingg_counts(elongation: ArrayLike, flatness: ArrayLike) -> dict[str, int]:
    """Number of stones in each of Zingg's classes, in the paper's order; arguments as for `zingg_class`."""
    classes = zingg_class(elongation, flatness)
    return {name: int((classes == name).sum()) for name in SHAPE_CLASSES}


def zingg_diagram(
    populations: Mapping[str, tuple[ArrayLike, ArrayLike]], *, title: str | None = None, dpi: int = DPI
) -> np.ndarray:
    """Zingg's diagram: flatness to the right, elongation upwards, a point for each stone.

    The classes' boundaries are drawn at 2/3; each quarter names its class and says how many stones of each
    population, and which share of it, are there.

    Parameters
    ----------
    populations : mapping of str to (array_like, array_like)
        By name, at most 6: elongation indices EI and flatness indices FI of its stones, each of shape (n,).
    title : str, optional
    dpi : int
        Pixels per inch: the diagram is 85 mm wide in print, one column of a journal.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        The same populations give the same pixels; `lithoform.figures.gallery.png_bytes` makes a file of them.

    Raises
    ------
    LithoformError
        If there is no population or too many, one has no stones, an index is not in (0, 1], or Matplotlib is
        not installed.
    """
    if not 0 < len(populations) <= len(COLOURS):
        raise LithoformError(f"a Zingg diagram shows 1 to {len(COLOURS)} populations; got {len(populations)}.")
    indices = {name: _checked(*pair) for name, pair in populations.items()}
    for name, (elongation, _) in indices.items():
        if elongation.ndim != 1 or not len(elongation):
            raise LithoformError(f"a Zingg diagram needs at least one stone, as arrays of shape (n,), in each "
                                 f"population; got shape {elongation.shape} for {name!r}.")  # fmt: skip
    head = _HEAD + _LEGEND_ROW * len(indices) + (5.0 if title else 0.0)
    with sheet(_WIDTH, head + _AXES + _FOOT, dpi) as page:
        axes = page.axes(_LEFT, head, _AXES, _AXES, xlim=(0, 1), ylim=(0, 1))
        _draw_frame(axes)
        for (name, (elongation, flatness)), colour, marker in zip(indices.items(), COLOURS, MARKERS, strict=False):
            # Few stones stand out, many show by how they pile up.
            alpha = min(0.8, max(0.15, 9.0 / math.sqrt(len(elongation))))
            axes.plot(flatness, elongation, marker, color=colour, markersize=2.6, markeredgewidth=0, alpha=alpha,
                      zorder=2.0, label=f"{name} (n = {len(elongation):,})", clip_on=False)  # fmt: skip
        _write_counts(axes, {name: zingg_counts(*pair) for name, pair in indices.items()})
        legend = axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0 + 3.6 / _AXES), frameon=False,
                             fontsize=_SMALL, handlelength=0.8, handletextpad=0.4, borderaxespad=0.0, borderpad=0.0,
                             labelspacing=0.3, labelcolor=INK, markerscale=1.5)  # fmt: skip
        for handle in legend.legend_handles:
            handle.set_alpha(1.0)
        if title:
            page.text(_LEFT, 3.5, title, size=_TEXT + 0.5, ha="left", weight="bold", parse_math=False)
        return page.pixels()


def _draw_frame(axes: Any) -> None:
    axes.set_aspect("equal")
    ticks = np.linspace(0.0, 1.0, 6)
    axes.set_xticks(ticks, [f"{tick:.1f}" for tick in ticks])
    axes.set_yticks(ticks, [f"{tick:.1f}" for tick in ticks])
    axes.tick_params(labelsize=_SMALL, width=0.5, length=2.0, colors=INK, pad=2.0)
    axes.set_xlabel(r"flatness index $FI = l_a\,/\,l_b$", fontsize=_TEXT, color=INK, labelpad=2.5)
    axes.set_ylabel(r"elongation index $EI = l_b\,/\,l_c$", fontsize=_TEXT, color=INK, labelpad=2.5)
    for spine in axes.spines.values():
        spine.set(linewidth=0.6, color=INK, zorder=1.0)
    line = {"color": GREY, "linewidth": 0.8, "linestyle": (0, (4, 2.5)), "zorder": 1.0}
    axes.axhline(ZINGG_LIMIT, **line)
    axes.axvline(ZINGG_LIMIT, **line)
    mark = {"fontsize": _SMALL, "color": INK, "annotation_clip": False}
    axes.annotate("2/3", (1.01, ZINGG_LIMIT), ha="left", va="center", **mark)
    axes.annotate("2/3", (ZINGG_LIMIT, 1.008), ha="center", va="bottom", **mark)


def _write_counts(axes: Any, counts: Mapping[str, Mapping[str, int]]) -> None:
    pitch = 2.9 / _AXES
    for shape_class, (x, y, across, upright) in _CORNERS.items():
        lines = [(shape_class, INK, "bold", _TEXT)]
        for (_, numbers), colour in zip(counts.items(), COLOURS, strict=False):
            number, total = numbers[shape_class], sum(numbers.values())
            lines.append((f"{number:,} ({100.0 * number / total:.1f} %)", colour, "normal", _SMALL))
        top = y if upright == "top" else y + pitch * (len(lines) - 1)
        for i, (text, colour, weight, size) in enumerate(lines):
            paper = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 0.6}
            axes.text(x, top - i * pitch, text, ha=across, va=upright, fontsize=size, weight=weight, color=colour,
                      bbox=paper, zorder=3.0)  # fmt: skip


def _checked(elongation: ArrayLike, flatness: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Both indices as float64 arrays of one shape."""
    pair = {"elongation": np.asarray(elongation, np.float64), "flatness": np.asarray(flatness, np.float64)}
    if pair["elongation"].shape != pair["flatness"].shape:
        raise LithoformError("expected an elongation and a flatness index for each stone; got arrays of shapes "
                             f"{pair['elongation'].shape} and {pair['flatness'].shape}.")  # fmt: skip
    for name, values in pair.items():
        wrong = values[~((values > 0.0) & (values <= 1.0))]
        if wrong.size:
            raise LithoformError(f"expected a ratio of a shorter to a longer dimension, above 0 and at most 1, for "
                                 f"every {name} index; got {float(wrong.flat[0])}.")  # fmt: skip
    return pair["elongation"], pair["flatness"]
