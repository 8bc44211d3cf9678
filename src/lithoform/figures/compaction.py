"""Pictures of a compaction: the specimen, the way there, and its height over the gyrations (Fig. 11 and 13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.figures.packing import Heap, heap_picture, plain_axes
from lithoform.figures.sheet import COLOURS, GREY, MARKERS, sheet

__all__ = [
    "Curve", "Densities", "Trend", "cases_figure", "curve_figure", "densities_figure", "film_strip", "specimen_figure",
    "trends_figure",
]  # fmt: skip

_DPI: Final = 220
_MILLI: Final = 1e3


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """Heights over gyrations.

    Attributes
    ----------
    label : str
    gyrations, heights, densities : numpy.ndarray, shape (n,)
        Heights [m], packing densities.
    fitted : (float, float) or None
        A [m] and B of H = A G^B.
    """

    label: str
    gyrations: np.ndarray
    heights: np.ndarray
    densities: np.ndarray
    fitted: tuple[float, float] | None = None


def specimen_figure(heap: Heap, title: str, lines: Sequence[str]) -> np.ndarray:
    """Picture of a specimen in its mould, with what was measured of it.

    Parameters
    ----------
    heap : Heap
    title : str
    lines : sequence of str

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    with sheet(170.0, 90.0, _DPI) as page:
        page.paste(heap_picture(heap, (page.to_pixels(104.0), page.to_pixels(86.0))), 2.0, 2.0)
        page.text(110.0, 12.0, title, size=10.0, ha="left", weight="bold")
        for i, line in enumerate(lines):
            page.text(110.0, 20.0 + 5.2 * i, line, size=7.0, ha="left")
        return page.pixels()


def film_strip(heaps: Sequence[Heap], captions: Sequence[str]) -> np.ndarray:
    """Pictures of a specimen at one scale, from left to right.

    Parameters
    ----------
    heaps : sequence of Heap
    captions : sequence of str
        One for each; lines are broken at newlines.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    width, tall = 58.0, 78.0
    tallest = max(map(_top, heaps))
    with sheet(width * len(heaps) + 4.0, tall + 16.0, _DPI) as page:
        for i, (heap, caption) in enumerate(zip(heaps, captions, strict=True)):
            picture = heap_picture(heap, (page.to_pixels(width - 2.0), page.to_pixels(tall)), tallest=tallest)
            page.paste(picture, 2.0 + width * i, 1.0)
            for k, line in enumerate(caption.split("\n")):
                page.text(2.0 + width * (i + 0.5), tall + 4.0 + 4.2 * k, line, size=7.5 - 0.5 * k)
        return page.pixels()


def _top(heap: Heap) -> float:
    """Height that no stone exceeds [m]."""
    reach = np.array([np.sqrt((mesh.vertices**2).sum(axis=1).max()) for mesh in heap.meshes])[heap.which]
    return float((heap.places[:, 2] + reach * np.cbrt(np.abs(np.linalg.det(heap.turns)))).max())


def _over_gyrations(axes: Any, name: str) -> None:
    """Axes of a quantity over the gyrations, which are logarithmic and told at 1, 2, 5, 10."""
    plain_axes(axes, "gyrations", name)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
    axes.tick_params(which="minor", labelsize=6.5)


def curve_figure(curves: Sequence[Curve]) -> np.ndarray:
    """Height and packing density over the gyrations, which are on a logarithmic axis, with the fits.

    Parameters
    ----------
    curves : sequence of Curve

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    with sheet(170.0, 80.0, _DPI) as page:
        left, right = page.axes(16.0, 5.0, 62.0, 60.0), page.axes(98.0, 5.0, 62.0, 60.0)
        for axes, name in ((left, "height (mm)"), (right, "packing density")):
            _over_gyrations(axes, name)
        for i, curve in enumerate(curves):
            on = curve.gyrations >= 1.0
            style = {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "markersize": 3.0,
                     "linewidth": 0.0 if curve.fitted else 0.8}  # fmt: skip
            left.plot(curve.gyrations[on], _MILLI * curve.heights[on], label=curve.label, **style)
            right.plot(curve.gyrations[on], curve.densities[on], **style)
            if curve.fitted is not None and on.any():
                a, b = curve.fitted
                line = np.geomspace(1.0, curve.gyrations[on].max(), 100)
                left.plot(line, _MILLI * a * line**b, color=GREY, linewidth=1.0, zorder=0)
        left.legend(fontsize=6.0, frameon=False)
        return page.pixels()


@dataclass(frozen=True, eq=False, kw_only=True)
class Densities:
    """Packing densities of an experiment.

    Attributes
    ----------
    title : str
    scanned : numpy.ndarray, shape (c,)
        A value a case.
    generated : numpy.ndarray, shape (c, k)
    published : (float, float)
        Range in the paper.
    """

    title: str
    scanned: np.ndarray
    generated: np.ndarray
    published: tuple[float, float]


def densities_figure(panels: Sequence[Densities]) -> np.ndarray:
    """Packing densities of scanned and of generated specimens, case by case (Fig. 12), with the paper's range.

    Parameters
    ----------
    panels : sequence of Densities

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    with sheet(85.0 * len(panels), 78.0, _DPI) as page:
        for i, panel in enumerate(panels):
            axes = page.axes(16.0 + 85.0 * i, 8.0, 64.0, 54.0)
            plain_axes(axes, "case", "packing density")
            axes.set_title(panel.title, fontsize=7.5)
            low, high = panel.published
            axes.axhspan(low, high, color=GREY, alpha=0.25, linewidth=0.0, label="the paper's range")
            cases = np.arange(1, len(panel.scanned) + 1)
            axes.plot(cases - 0.12, panel.scanned, "s", color=COLOURS[0], markersize=4.5, label="scanned")
            for k in range(panel.generated.shape[1]):
                axes.plot(cases + 0.08 + 0.08 * k, panel.generated[:, k], "o", color=COLOURS[1], markersize=3.5,
                          label="generated" if k == 0 else None)  # fmt: skip
            axes.set_xticks(cases)
            axes.set_xlim(0.5, len(cases) + 0.5)
            axes.legend(fontsize=6.0, frameon=False)
        return page.pixels()


def cases_figure(cases: Sequence[Sequence[Curve]]) -> np.ndarray:
    """Height over gyrations, a panel a case (Fig. 13): the first curve is that of the scanned stones.

    Parameters
    ----------
    cases : sequence of sequence of Curve

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    columns = min(3, len(cases))
    rows = -(-len(cases) // columns)
    with sheet(62.0 * columns + 4.0, 56.0 * rows + 4.0, _DPI) as page:
        for i, curves in enumerate(cases):
            axes = page.axes(15.0 + 62.0 * (i % columns), 8.0 + 56.0 * (i // columns), 44.0, 34.0)
            _over_gyrations(axes, "height (mm)")
            axes.set_title(f"case {i + 1}", fontsize=7.5)
            for k, curve in enumerate(curves):
                on = curve.gyrations >= 1.0
                axes.plot(curve.gyrations[on], _MILLI * curve.heights[on], MARKERS[k % len(MARKERS)], markersize=2.4,
                          color=COLOURS[k % len(COLOURS)], label=curve.label)  # fmt: skip
                if curve.fitted is not None and on.any():
                    a, b = curve.fitted
                    line = np.geomspace(1.0, curve.gyrations[on].max(), 60)
                    axes.plot(line, _MILLI * a * line**b, color=COLOURS[k % len(COLOURS)], linewidth=0.6)
            axes.legend(fontsize=5.0, frameon=False)
        return page.pixels()


@dataclass(frozen=True, eq=False, kw_only=True)
class Trend:
    """Packing densities over a number that ends at 0.

    Attributes
    ----------
    title : str
        Of the number.
    values : sequence of (numpy.ndarray, numpy.ndarray)
        Numbers and packing densities, a pair a specimen.
    labels : sequence of str
        Of the specimens.
    slope : float
        Of the lines, one through the mean of each specimen.
    mark : float
        Number of the real case.
    """

    title: str
    values: Sequence[tuple[np.ndarray, np.ndarray]]
    labels: Sequence[str]
    slope: float
    mark: float


def trends_figure(trends: Sequence[Trend]) -> np.ndarray:
    """Packing densities over numbers that end at 0, with lines as far as there.

    Parameters
    ----------
    trends : sequence of Trend

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    with sheet(85.0 * len(trends), 86.0, _DPI) as page:
        for i, trend in enumerate(trends):
            axes = page.axes(16.0 + 85.0 * i, 5.0, 64.0, 57.0)
            plain_axes(axes, trend.title, "packing density")
            for k, ((x, y), label) in enumerate(zip(trend.values, trend.labels, strict=True)):
                colour = COLOURS[k % len(COLOURS)]
                axes.plot(x, y, MARKERS[k % len(MARKERS)], color=colour, markersize=3.5, label=label)
                ends = np.array([0.0, float(x.max())])
                axes.plot(ends, y.mean() + trend.slope * (ends - x.mean()), color=colour, linewidth=0.8)
            axes.axvline(trend.mark, color=GREY, linewidth=0.8, linestyle="--", label="30 a minute, 55 GPa")
            axes.set_xlim(left=0.0)
            axes.ticklabel_format(axis="x", style="sci", scilimits=(-2, 2), useMathText=True)
            axes.xaxis.get_offset_text().set_fontsize(6.5)
            axes.legend(fontsize=6.0, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2)
        return page.pixels()
