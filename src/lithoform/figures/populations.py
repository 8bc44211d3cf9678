"""Two populations beside each other, in the manner of Fig. 8b, 9 and 10: results come in, pixels come out.

The first population is A and blue, the second B and vermilion; means, indices and intervals are those of the results
that come in.  The curve over a histogram is a Gaussian kernel estimate with Silverman's bandwidth, drawn for the eye.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.errors import LithoformError
from lithoform.figures.shape import NOTATION
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, Sheet, sheet
from lithoform.rendering import load_module
from lithoform.statistics.comparison import SampleComparison

__all__ = ["Effect", "Panel", "distribution_figure", "effects_figure", "heading", "histogram_figure", "require_figures"]

_WIDTH: Final = 181.0  # two columns of a journal [mm]
_GAP, _LEFT, _RIGHT = 6.0, 11.0, 1.5  # between columns; beside the axes [mm]
_PLOT, _LINE, _FOOT = 40.0, 3.4, 9.0  # height of the axes, of a line of text, and of the ticks below [mm]
_LEGEND: Final = 8.0  # [mm]
_TITLE, _TEXT, _SMALL, _TINY = 8.0, 6.5, 6.0, 5.5  # [pt]
_MOST_LABEL: Final = 70  # characters of a label that are shown
_MOST_MEAN: Final = 25  # characters of a mean that fit in the larger type
_TAILS: Final = (0.05, 0.95)
_BRACKETS: Final = "in brackets: by chance, or the interval; p is not adjusted"
_FILL: Final = 0.28
_POINTS: Final = 300  # of a kernel curve
_BINS_ALONE: Final = 12  # where nothing is compared
_FARTHEST: Final = 5.0  # effect sizes are drawn up to so many standard deviations, if need be with an arrow


@dataclass(frozen=True, eq=False)
class Panel:
    """One pair of samples.

    Attributes
    ----------
    title : str
        Plain text.
    values : tuple of numpy.ndarray, shapes (n,) and (m,)
        In one unit; either may be empty where nothing is compared.
    comparison : SampleComparison or None
        Of these values; None draws the values alone.
    symbol : str
        Symbol of the quantity, as Matplotlib writes mathematics.
    notes : tuple of str
        Further lines of plain text below the numbers.
    """

    title: str
    values: tuple[np.ndarray, np.ndarray]
    comparison: SampleComparison | None = None
    symbol: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Effect:
    """A standardised difference of means with its interval; first less second, in standard deviations.

    Attributes
    ----------
    group, name : str
        What is written beside it.
    value, low, high : float
        The ends may be infinite.
    """

    group: str
    name: str
    value: float
    low: float
    high: float


def require_figures() -> None:
    """Make sure, before long work, that figures can be drawn after it; a `LithoformError` says what to install."""
    for module in ("matplotlib.figure", "PIL.Image"):
        load_module(module)


def heading(name: str) -> tuple[str, str]:
    """Words and symbol of a descriptor; the symbol is empty where it is none of the paper's four."""
    return NOTATION.get(name, (name.replace("_", " "), ""))


def histogram_figure(
    panels: Sequence[Panel], labels: tuple[str, str], *, title: str = "", columns: int = 2, dpi: int = DPI
) -> np.ndarray:
    """Histograms of both samples on the bins of the comparison, with kernel curves and means, a panel each.

    Over each panel stand mean, standard deviation and number of both samples, and the three indices of the paper with
    what they score by chance in brackets, and the p of the first of them, not adjusted.

    Parameters
    ----------
    panels : sequence of Panel
    labels : tuple of str
        What the populations are called.
    title : str
    columns : int
        1 or more; two columns of a journal are shared among them.
    dpi : int
        Pixels per inch; the figure is 181 mm wide.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        On one machine, the same results give the same pixels.

    Raises
    ------
    LithoformError
        If there are no panels, a panel has no values at all, or nothing can be drawn.
    """
    lines = 3 + max((len(panel.notes) for panel in panels), default=0)
    return _figure(panels, labels, title, columns, lines, dpi, _draw_histograms)


def distribution_figure(
    panels: Sequence[Panel], labels: tuple[str, str], *, title: str = "", columns: int = 2, dpi: int = DPI
) -> np.ndarray:
    """Empirical distribution functions of both samples, with the 5th and 95th percentiles that the tails are told by.

    Over each panel stand the differences of these percentiles with their bootstrap intervals, and the distance of
    Kolmogorov and Smirnov with what it scores by chance in brackets; parameters, result and errors are those of
    `histogram_figure`.
    """
    lines = 5 + max((len(panel.notes) for panel in panels), default=0)
    return _figure(panels, labels, title, columns, lines, dpi, _draw_distributions)


def effects_figure(effects: Sequence[Effect], labels: tuple[str, str], *, dpi: int = DPI) -> np.ndarray:
    """Standardised differences with their intervals, a line each (a forest plot); the band is Cohen's small effect.

    Parameters
    ----------
    effects : sequence of Effect
        Those of one group follow each other.
    labels, dpi
        As `histogram_figure`.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8

    Raises
    ------
    LithoformError
        If there are none, or nothing can be drawn.
    """
    if not effects:
        raise LithoformError("a figure of effect sizes needs at least one; got none.")
    row, gap = 4.4, 2.6
    groups = list(dict.fromkeys(one.group for one in effects))
    places = [-row * i - gap * groups.index(one.group) for i, one in enumerate(effects)]
    tall = -places[-1] + 2.0 * row
    with sheet(_WIDTH, _LEGEND + 4.0 + tall + 12.0, dpi) as page:
        _write_labels(page, labels)
        left, numbers = 52.0, 40.0
        axes = page.axes(left, _LEGEND + 4.0, _WIDTH - left - numbers, tall)
        reach = [abs(x) for one in effects for x in (one.value, one.low, one.high) if math.isfinite(x)]
        limit = min(max(1.15 * max(reach), 0.5), _FARTHEST)
        axes.set(xlim=(-limit, limit), ylim=(places[-1] - row, row))
        axes.axvspan(-0.2, 0.2, color="#f0ede6", zorder=0.5, linewidth=0)
        axes.axvline(0.0, color=GREY, linewidth=0.7, zorder=1.0)
        for one, place in zip(effects, places, strict=True):
            low, high = (min(max(end, -limit), limit) for end in (one.low, one.high))
            axes.plot([low, high], [place, place], color=INK, linewidth=1.0, zorder=2.0, solid_capstyle="butt")
            for end, marker in ((one.low, "<"), (one.high, ">")):
                if abs(end) > limit:
                    x = math.copysign(0.99 * limit, end)
                    axes.plot([x], [place], marker, color=INK, markersize=3.0, markeredgewidth=0, zorder=2.0)
            if abs(one.value) <= limit:
                colour = COLOURS[0] if one.value > 0.0 else COLOURS[1]
                axes.plot([one.value], [place], "o", color=colour, markersize=4.0, markeredgewidth=0, zorder=3.0)
        place_of = {group: places[[one.group for one in effects].index(group)] for group in groups}
        for i, (one, place) in enumerate(zip(effects, places, strict=True)):
            y = _LEGEND + 4.0 + (row - place) * tall / (row - places[-1] + row)
            if place_of[one.group] == place:
                name = _shown(one.group, 16)
                page.text(2.0, y, name, size=_TEXT, ha="left", weight="bold", parse_math=False)
                if i:
                    axes.axhline(place + 0.5 * (row + gap), color="#d8d4cc", linewidth=0.5, zorder=0.6)
            page.text(left - 2.0, y, _shown(one.name, 26), size=_TEXT, ha="right", parse_math=False)
            text = f"{_signed(one.value, '.2f')}  ({_signed(one.low, '.2f')} to {_signed(one.high, '.2f')})"
            page.text(_WIDTH - numbers + 2.0, y, text, size=_TEXT, ha="left")
        axes.set_yticks([])
        _finish(axes, "Hedges' g, A less B [standard deviations]: to the right A is larger, to the left B")
        return page.pixels()


def _figure(
    panels: Sequence[Panel], labels: tuple[str, str], title: str, columns: int, lines: int, dpi: int, draw: Any
) -> np.ndarray:
    if not panels or any(len(a) + len(b) == 0 for a, b in (panel.values for panel in panels)):
        raise LithoformError("a figure of two populations needs at least one panel, and a value in each; got none.")
    columns = min(max(columns, 1), len(panels))
    width = (_WIDTH - _GAP * (columns - 1)) / max(columns, 2)
    head = lines * _LINE + 2.0
    pitch = head + _PLOT + _FOOT
    top = _LEGEND + (6.0 if title else 0.0)
    rows = math.ceil(len(panels) / columns)
    with sheet(max(columns, 2) * (width + _GAP) - _GAP, top + rows * pitch, dpi) as page:
        if title:
            page.text(2.0, 4.0, _shown(title, 110), size=_TITLE + 1.0, ha="left", weight="bold", parse_math=False)
        _write_labels(page, labels, top - _LEGEND)
        page.text(page.width - 2.0, top - 2.2, _BRACKETS, size=_SMALL, ha="right", color=GREY)
        for i, panel in enumerate(panels):
            left, up = (i % columns) * (width + _GAP), top + (i // columns) * pitch
            axes = page.axes(left + _LEFT, up + head, width - _LEFT - _RIGHT, _PLOT)
            numbers = draw(axes, panel)
            _write_head(page, panel, numbers, left + _LEFT, up)
        return page.pixels()


def _draw_histograms(axes: Any, panel: Panel) -> list[str]:
    found, everything = panel.comparison, np.concatenate(panel.values)
    low, high = float(everything.min()), float(everything.max())
    room = (high - low) or abs(high) or 1.0
    if found is not None:
        edges, counts = found.edges, found.counts
    else:
        edges = np.linspace(low - 0.01 * room, high + 0.01 * room, _BINS_ALONE + 1)
        counts = np.stack([np.histogram(values, edges)[0] for values in panel.values])
    step = float(edges[1] - edges[0])
    x = np.linspace(edges[0] - 0.06 * room, edges[-1] + 0.06 * room, _POINTS)
    for values, number, colour, style in zip(panel.values, counts, COLOURS, ("-", (0, (5, 1.5))), strict=False):
        if len(values) < 5:
            axes.plot(values, np.full(len(values), 0.02), "|", color=colour, markersize=9.0, markeredgewidth=1.2,
                      transform=axes.get_xaxis_transform(), zorder=4.0, clip_on=False)  # fmt: skip
            continue
        share = 100.0 * number / len(values)
        axes.stairs(share, edges, fill=True, color=colour, alpha=_FILL, linewidth=0, zorder=1.5)
        axes.stairs(share, edges, color=colour, linewidth=0.5, zorder=1.6)
        curve = _kernel_density(values, x)
        if curve is not None:
            axes.plot(x, 100.0 * step * curve, color=colour, linewidth=1.1, linestyle=style, zorder=3.0)
        axes.axvline(float(values.mean()), color=colour, linewidth=0.8, linestyle=(0, (1.5, 1.5)), zorder=2.5)
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("particles [%]", fontsize=_SMALL, color=INK, labelpad=2.0)
    _finish(axes, "")
    if found is None:
        return ["too few to compare"]
    told = [f"{sign} {_index(found.index(name))}" for sign, name in
            (("BC", "bhattacharyya"), ("KL", "kullback_leibler"), ("JS", "jensen_shannon"))]  # fmt: skip
    return [f"{'   '.join(told)}   p of BC {found.index('bhattacharyya').p:.2g}"]


def _draw_distributions(axes: Any, panel: Panel) -> list[str]:
    found, everything = panel.comparison, np.concatenate(panel.values)
    low, high = float(everything.min()), float(everything.max())
    room = 0.03 * ((high - low) or abs(high) or 1.0)
    for values, colour, style in zip(panel.values, COLOURS, ("-", (0, (5, 1.5))), strict=False):
        if not len(values):
            continue
        x = np.concatenate([[low - room], np.sort(values), [high + room]])
        y = np.concatenate([np.arange(len(values) + 1), [len(values)]]) / len(values)
        axes.step(x, 100.0 * y, where="post", color=colour, linewidth=1.0, linestyle=style, zorder=2.0)
        if found is not None:
            tails = np.quantile(values, _TAILS)
            axes.plot(tails, 100.0 * np.array(_TAILS), "o", color=colour, markersize=3.4, markeredgewidth=0, zorder=3.0)
    for level in _TAILS:
        axes.axhline(100.0 * level, color=GREY, linewidth=0.5, linestyle=(0, (3, 2)), zorder=1.0)
    axes.set(xlim=(low - room, high + room), ylim=(0.0, 100.0))
    axes.set_yticks([5, 25, 50, 75, 95])
    axes.set_ylabel("particles below [%]", fontsize=_SMALL, color=INK, labelpad=2.0)
    _finish(axes, "")
    if found is None:
        return ["too few to compare"]
    told = []
    for sign, name in (("P5", "percentile_5_difference"), ("P95", "percentile_95_difference")):
        one = found.estimate(name)
        told.append(f"{sign} {_signed(one.value)} ({_signed(one.low)} to {_signed(one.high)})")
    greatest = found.index("kolmogorov_smirnov")
    return [*told, f"KS {_index(greatest)}   p of KS {greatest.p:.2g}"]


def _write_head(page: Sheet, panel: Panel, numbers: list[str], left: float, top: float) -> None:
    title = _shown(panel.title, 40)
    if panel.symbol:
        title = f"{title} ${panel.symbol}$"
    page.text(left, top + 0.6 * _LINE, title, size=_TITLE, ha="left", weight="bold", parse_math=bool(panel.symbol))
    means = []
    for letter, values in zip("AB", panel.values, strict=False):
        spread = f" ± {values.std(ddof=1):.3g}" if len(values) > 1 else ""
        mean = f"{values.mean():.4g}{spread}" if len(values) else "none"
        means.append(f"{letter}  {mean}  n {len(values):,}")
    size = _TEXT if max(map(len, means)) <= _MOST_MEAN else _TINY
    for i, (text, colour) in enumerate(zip(means, COLOURS, strict=False)):
        page.text(left + 38.0 * i, top + 1.7 * _LINE, text, size=size, ha="left", color=colour)
    for i, text in enumerate((*numbers, *panel.notes)):
        page.text(left, top + (2.7 + i) * _LINE, text, size=_SMALL, ha="left", parse_math=False)


def _write_labels(page: Sheet, labels: tuple[str, str], top: float = 0.0) -> None:
    """The key: which colour is which population."""
    for i, (letter, label, colour) in enumerate(zip("AB", labels, COLOURS, strict=False)):
        y = top + 2.2 + 3.6 * i
        page.text(2.0, y, "■", size=_TEXT, ha="left", color=colour)
        page.text(5.0, y, f"{letter}: {_shown(label, _MOST_LABEL)}", size=_TEXT, ha="left", parse_math=False)


def _finish(axes: Any, label: str) -> None:
    axes.tick_params(labelsize=_SMALL, length=2.0, width=0.5, colors=INK, pad=2.0)
    low, high = axes.get_xlim()
    ticks = load_module("matplotlib.ticker").MaxNLocator(6).tick_values(low, high)
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    axes.set_xticks(ticks, _tick_labels(ticks))
    if label:
        axes.set_xlabel(label, fontsize=_TEXT, color=INK, labelpad=2.0)
    for side, spine in axes.spines.items():
        spine.set(linewidth=0.5, color=GREY, visible=side in ("left", "bottom"))


def _tick_labels(ticks: np.ndarray) -> list[str]:
    """Ticks with as many digits as tell them apart, the same in all."""
    step, largest = float(np.diff(ticks).min(initial=math.inf)), float(np.abs(ticks).max(initial=0.0))
    if not math.isfinite(step) or step < 1e-4 or largest >= 1e6:
        return [f"{tick:.3g}" if tick else "0" for tick in ticks]
    # Steps are 1, 2, 2.5 or 5 times a power of ten.
    digits = next(d for d in range(7) if abs(round(step, d) - step) < 1e-3 * step)
    return [f"{tick:.{digits}f}".replace("-", "−") for tick in ticks]


def _kernel_density(values: np.ndarray, x: np.ndarray) -> np.ndarray | None:
    """Gaussian kernel estimate with Silverman's bandwidth 0.9 min(s, IQR / 1.34) n^(-1/5); None without variation."""
    lower, upper = np.quantile(values, [0.25, 0.75])
    deviation = float(values.std(ddof=1))
    width = 0.9 * min(deviation, float(upper - lower) / 1.34 or deviation) * len(values) ** -0.2
    if width == 0.0:
        return None
    total = np.zeros_like(x)
    for part in np.array_split(values, math.ceil(len(values) / 1000)):
        total += np.exp(-0.5 * ((x[:, None] - part) / width) ** 2).sum(axis=1)
    return total / (len(values) * width * math.sqrt(2.0 * math.pi))


def _index(test: Any) -> str:
    """An index and in brackets what it scores by chance."""
    return f"{test.value:.3f} ({test.floor_mean:.3f})"


def _signed(value: float, form: str = ".2g") -> str:
    if not math.isfinite(value):
        return "−∞" if value < 0 else "∞"
    # Intervals of tiny samples can reach beyond all bounds.
    return f"{value:+{form if abs(value) < 1000.0 else '.1e'}}".replace("-", "−")


def _shown(text: str, most: int) -> str:
    """Text as the font can show it, and not too long."""
    manager = load_module("matplotlib.font_manager")
    font = manager.get_font(manager.findfont("DejaVu Sans"))
    text = "".join(c if c.isprintable() and font.get_char_index(ord(c)) else "□" for c in text)
    return text if len(text) <= most else f"{text[: most - 3]}..."
