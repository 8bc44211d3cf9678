"""Sensitivity of the descriptors: curves over the parameters (Fig. 6), screening, shares of the variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.errors import LithoformError
from lithoform.figures.shape import NOTATION
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, MARKERS, Sheet, sheet
from lithoform.rendering import load_module

__all__ = ["CurvePanel", "curves_figure", "screening_figure", "shares_figure", "sign_of"]

_SIGNS: Final = {
    "base_radius": "r", "perturbation": "k", "main_scale": "s", "warp_scale": "s_w", "warp_strength": r"\eta",
    "phase_offset": r"\delta_i", "octaves": "O", "lacunarity": r"\lambda", "gain": "g", "fbm_weight": r"\alpha",
    "ridge_weight": r"\beta", "chip_weight": r"\gamma", "chip_sharpness": r"\kappa", "layer_amplitude": "A_L",
    "layer_frequency": "f_L", "twist_rate": r"\rho", "smoothing_iterations": "n_s", "elongation": "EI",
    "flatness": "FI",
}  # fmt: skip
"""The paper's symbols as Matplotlib writes mathematics, by the names of the axes."""

_WIDTH: Final = 180.0  # of every sheet [mm]
_TITLE, _TEXT, _SMALL = 8.5, 7.0, 6.0  # [pt]
_LEFT, _RIGHT, _HEAD, _KEY, _FOOT = 9.0, 3.0, 6.0, 15.0, 7.0  # [mm]
_PLOT: Final = 31.0  # height of a panel of curves [mm]
_COLUMNS: Final = 3
_LABELLED: Final = 0.12
"""Share of the greatest mu* from which an input is named in a plot of the screening."""


@dataclass(frozen=True, eq=False)
class CurvePanel:
    """Curves over one parameter.

    Attributes
    ----------
    name : str
        Of an axis.
    values : numpy.ndarray, shape (p,)
    mean, deviation, low, high : numpy.ndarray, shape (p, 4)
        In the order of `FOUR`: mean, standard deviation from stone to stone, 95 % interval of the mean.
    benchmark : float
    is_log : bool
    """

    name: str
    values: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    benchmark: float
    is_log: bool = False


def sign_of(name: str) -> str:
    """Symbol of an axis, as Matplotlib writes mathematics; the name itself if it has none."""
    return f"${_SIGNS[name]}$" if name in _SIGNS else name


def curves_figure(panels: Sequence[CurvePanel], *, title: str, note: str = "", dpi: int = DPI) -> np.ndarray:
    """Mean descriptors over each parameter, the benchmark as a dashed line.

    The deviation from stone to stone is a pale band, the interval of the mean a darker one.

    Parameters
    ----------
    panels : sequence of CurvePanel
    title, note : str
        Over the panels; the note says what was made.
    dpi : int
        Pixels per inch.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8

    Raises
    ------
    LithoformError
        If there are no panels, or nothing can be drawn.
    """
    if not panels:
        raise LithoformError("a figure of curves needs at least one parameter; got none.")
    width = _WIDTH / _COLUMNS
    pitch = _HEAD + _PLOT + _FOOT
    rows = math.ceil(len(panels) / _COLUMNS)
    with sheet(_WIDTH, _KEY + rows * pitch + 2.0, dpi) as page:
        _write_key(page, title, note)
        for i, panel in enumerate(panels):
            left, top = (i % _COLUMNS) * width, _KEY + (i // _COLUMNS) * pitch
            axes = page.axes(left + _LEFT, top + _HEAD, width - _LEFT - _RIGHT, _PLOT)
            _draw_curves(axes, panel)
            label = f"{sign_of(panel.name)}  {panel.name.replace('_', ' ').replace('fbm', 'FBM')}"
            page.text(left + _LEFT, top + 0.55 * _HEAD, label, size=_TITLE, ha="left", weight="bold")
        return page.pixels()


def screening_figure(inputs: Sequence[str], mu_star: np.ndarray, half: np.ndarray, sigma: np.ndarray, *, title: str,
                     note: str = "", dpi: int = DPI) -> np.ndarray:  # fmt: skip
    """Scatter of the elementary effects over their mean size, a panel a descriptor (Morris 1991).

    Parameters
    ----------
    inputs : sequence of str
        Names of axes.
    mu_star, half, sigma : numpy.ndarray, shape (d, 4)
        Mean absolute effect, half of its 95 % interval, standard deviation of the effects; in the order of `FOUR`.
    title, note, dpi
        As `curves_figure`.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8

    Raises
    ------
    LithoformError
        If there are no inputs, or nothing can be drawn.
    """
    if not len(inputs):
        raise LithoformError("a figure of a screening needs at least one input; got none.")
    side, head, key = 0.5 * _WIDTH - 16.0, 7.0, 12.0
    with sheet(_WIDTH, key + 2 * (side + head + 10.0), dpi) as page:
        _write_head(page, title, note)
        for column, name in enumerate(FOUR):
            left, top = (column % 2) * 0.5 * _WIDTH + 12.0, key + (column // 2) * (side + head + 10.0)
            axes = page.axes(left, top + head, side, side)
            x, y, reach = mu_star[:, column], sigma[:, column], half[:, column]
            end = 1.08 * max(float((x + reach).max()), float(y.max()), 1e-12)
            axes.plot([0.0, end], [0.0, end], color=GREY, linewidth=0.5, linestyle=(0, (4, 3)), zorder=1.0)
            axes.errorbar(x, y, xerr=reach, fmt=MARKERS[column], color=COLOURS[column], markersize=3.4,
                          markeredgewidth=0, elinewidth=0.6, zorder=2.0)  # fmt: skip
            for i, place in enumerate(zip(x, y, strict=True)):
                if x[i] >= _LABELLED * x.max():
                    axes.annotate(sign_of(inputs[i]), place, xytext=(2.2, 2.2), textcoords="offset points",
                                  fontsize=_TEXT, color=INK, zorder=3.0)  # fmt: skip
            axes.set(xlim=(0.0, end), ylim=(0.0, end))
            axes.set_xlabel("mean absolute effect $\\mu^*$", fontsize=_SMALL, color=INK, labelpad=1.5)
            axes.set_ylabel("standard deviation $\\sigma$", fontsize=_SMALL, color=INK, labelpad=1.5)
            _finish(axes, axes.xaxis, axes.yaxis)
            page.text(left, top + 0.6 * head, _heading(name), size=_TITLE, ha="left", weight="bold")
        return page.pixels()


def shares_figure(inputs: Sequence[str], first: Sequence[np.ndarray], total: Sequence[np.ndarray], *, title: str,
                  note: str = "", dpi: int = DPI) -> np.ndarray:  # fmt: skip
    """First-order and total shares of the variance with their intervals, a column a descriptor (Sobol 1993).

    Parameters
    ----------
    inputs : sequence of str
        Names of axes.
    first, total : sequence of three numpy.ndarray, shape (d, 4)
        Estimate, and low and high end of its 95 % interval; in the order of `FOUR`.
    title, note, dpi
        As `curves_figure`.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8

    Raises
    ------
    LithoformError
        If there are no inputs, or nothing can be drawn.
    """
    if not len(inputs):
        raise LithoformError("a figure of variance shares needs at least one input; got none.")
    row, head, key, names = 5.0, 7.0, 16.0, 13.0
    tall = row * len(inputs)
    width = (_WIDTH - names) / len(FOUR)
    # Constant outputs have none.
    end = 1.05 * max(float(np.nanmax(np.concatenate([total[2], first[2], np.full((1, len(FOUR)), 0.2)]))), 0.2)
    with sheet(_WIDTH, key + head + tall + 11.0, dpi) as page:
        _write_head(page, title, note)
        page.text(2.0, 12.0, "pale: total share; full: share alone; bars: 95 % intervals", size=_TEXT, ha="left",
                  color=GREY)  # fmt: skip
        for i, name in enumerate(inputs):
            page.text(names - 2.0, key + head + (i + 0.5) * row, sign_of(name), size=_TEXT + 1.0, ha="right")
        for column, name in enumerate(FOUR):
            left = names + column * width
            axes = page.axes(left, key + head, width - 5.0, tall)
            places = np.arange(len(inputs)) + 0.5
            for part, place, thick, fill in ((total, places + 0.18, 0.34, 0.35), (first, places - 0.18, 0.34, 1.0)):
                shares, low, high = (array[:, column] for array in part)
                axes.barh(place, shares, height=thick, color=COLOURS[column], alpha=fill, linewidth=0, zorder=2.0)
                axes.hlines(place, low, high, color=INK, linewidth=0.7, zorder=3.0)
            axes.axvline(0.0, color=GREY, linewidth=0.6, zorder=1.0)
            lowest = min(float(np.nanmin(np.append(first[1], 0.0))), 0.0)
            axes.set(xlim=(max(1.05 * lowest, -0.2 * end), end), ylim=(len(inputs), 0.0))
            axes.set_yticks([])
            axes.set_xlabel("share of the variance", fontsize=_SMALL, color=INK, labelpad=1.5)
            _finish(axes, axes.xaxis, left=False)
            page.text(left, key + 0.5 * head, _heading(name), size=_TITLE - 1.0, ha="left", weight="bold")
        return page.pixels()


def _draw_curves(axes: Any, panel: CurvePanel) -> None:
    for column in range(len(FOUR)):
        colour, mean = COLOURS[column], panel.mean[:, column]
        deviation = panel.deviation[:, column]
        axes.fill_between(panel.values, mean - deviation, mean + deviation, color=colour, alpha=0.13, linewidth=0,
                          zorder=1.0)  # fmt: skip
        axes.fill_between(panel.values, panel.low[:, column], panel.high[:, column], color=colour, alpha=0.35,
                          linewidth=0, zorder=1.5)  # fmt: skip
        axes.plot(panel.values, mean, color=colour, marker=MARKERS[column], markersize=2.2, markeredgewidth=0,
                  linewidth=0.9, zorder=2.0)  # fmt: skip
    axes.axvline(panel.benchmark, color=GREY, linewidth=0.7, linestyle=(0, (3, 2)), zorder=0.8)
    axes.set_ylim(0.0, 1.0)
    low, high = float(panel.values[0]), float(panel.values[-1])
    if panel.is_log:
        axes.set_xscale("log")
        room = (high / low) ** 0.03
        axes.set_xlim(low / room, high * room)
    else:
        room = 0.03 * (high - low)
        axes.set_xlim(low - room, high + room)
    axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "", "0.5", "", "1"])
    _finish(axes, *([] if panel.is_log else [axes.xaxis]))
    if panel.is_log:
        ticks = [tick for tick in (0.1, 1.0, 10.0, 100.0) if low <= tick <= high]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xticks([], minor=True)


def _write_head(page: Sheet, title: str, note: str) -> None:
    page.text(2.0, 4.0, title, size=_TITLE + 1.5, ha="left", weight="bold", parse_math=False)
    page.text(2.0, 8.5, note, size=_TEXT, ha="left", color=GREY, parse_math=False)


def _write_key(page: Sheet, title: str, note: str) -> None:
    _write_head(page, title, note)
    for i, name in enumerate(FOUR):
        left = 3.0 + 34.0 * i
        line = load_module("matplotlib.lines").Line2D(
            [left / page.width, (left + 6.0) / page.width], [1.0 - 12.6 / page.height] * 2, color=COLOURS[i],
            marker=MARKERS[i], markersize=2.6, markeredgewidth=0, linewidth=1.1,
        )  # fmt: skip
        page.figure.add_artist(line)
        page.text(left + 7.5, 12.6, _heading(name), size=_TEXT, ha="left")
    line = load_module("matplotlib.lines").Line2D(
        [(139.0 + x) / page.width for x in (0.0, 6.0)], [1.0 - 12.6 / page.height] * 2, color=GREY, linewidth=0.8,
        linestyle=(0, (3, 2)),
    )  # fmt: skip
    page.figure.add_artist(line)
    page.text(146.5, 12.6, "benchmark", size=_TEXT, ha="left")


def _heading(name: str) -> str:
    words, symbol = NOTATION[name]
    return f"{words} ${symbol}$"


def _finish(axes: Any, *ticked: Any, left: bool = True) -> None:
    """Thin lines and small type; even ticks on the axes named."""
    axes.tick_params(labelsize=_SMALL, length=2.0, width=0.5, colors=INK, pad=2.0)
    locator = load_module("matplotlib.ticker").MaxNLocator(5, steps=[1, 2, 5, 10])
    for axis in ticked:
        low, high = axis.get_view_interval()
        places = [x for x in locator.tick_values(low, high) if low <= x <= high]
        axis.set_ticks(places, [f"{round(x, 9):g}".replace("-", "−") for x in places])
    for side, spine in axes.spines.items():
        spine.set(linewidth=0.5, color=GREY, visible=side == "bottom" or (left and side == "left"))
