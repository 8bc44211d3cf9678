"""A design as a picture: where target, prediction and fresh stones lie, and the stones themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.figures.shape import NOTATION
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, Sheet, sheet
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Studio

__all__ = ["ClosedLoop", "closed_loop_figure", "design_figure", "loop_errors_figure"]

_WIDTH: Final = 181.0
_NAMES: Final = ("roundness", "boxiness", "solidity", "true_sphericity")
_PAPER: Final = (0.020, 0.029, 0.018, 0.027)
_TITLE, _TEXT, _SMALL = 8.0, 6.5, 6.0


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Stones of one target.

    Attributes
    ----------
    title : str
    target, tolerance, predicted : numpy.ndarray, shape (4,)
        NaN where nothing is asked.
    achieved : numpy.ndarray, shape (n, 4)
        Of fresh stones.
    meshes : sequence of Mesh
        Some of these stones [m].
    """

    title: str
    target: np.ndarray
    tolerance: np.ndarray
    predicted: np.ndarray
    achieved: np.ndarray
    meshes: Sequence[Mesh]


def design_figure(loop: ClosedLoop, *, dpi: int = DPI) -> np.ndarray:
    """Target, prediction and fresh stones of a design; pixels, shape (height, width, 3), uint8."""
    return closed_loop_figure([loop], dpi=dpi)


def closed_loop_figure(loops: Sequence[ClosedLoop], *, title: str = "", dpi: int = DPI) -> np.ndarray:
    """A row for each target, in the manner of Fig. 7: what was asked and what came, and the stones.

    Parameters
    ----------
    loops : sequence of ClosedLoop
    title : str
    dpi : int
        Pixels per inch; the figure is 181 mm wide.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    head, row = (9.0 if title else 3.0), 42.0
    foot = 9.0
    with sheet(_WIDTH, head + row * len(loops) + foot, dpi) as page:
        if title:
            page.text(4.0, 5.0, title, size=_TITLE, ha="left", weight="bold")
        for i, loop in enumerate(loops):
            _row(page, loop, head + row * i)
        _legend(page, head + row * len(loops) + 3.5)
        return page.pixels()


def _row(page: Sheet, loop: ClosedLoop, top: float) -> None:
    page.text(4.0, top + 2.5, loop.title, size=_TEXT, ha="left", weight="bold")
    left = 16.0
    for d, name in enumerate(_NAMES):
        axes = page.axes(left + 20.0 * d, top + 9.0, 9.0, 26.0)
        word, symbol = NOTATION[name]
        page.text(left + 20.0 * d + 4.5, top + 7.2, f"${symbol}$", size=_TEXT)
        values = loop.achieved[:, d]
        values = values[np.isfinite(values)]
        if np.isfinite(loop.target[d]):
            low, high = loop.target[d] - loop.tolerance[d], loop.target[d] + loop.tolerance[d]
            axes.axhspan(low, high, color=COLOURS[2], alpha=0.18, lw=0.0)
            axes.axhline(loop.target[d], color=COLOURS[2], lw=1.2)
        across = 0.5 + 0.3 * np.linspace(-1.0, 1.0, len(values)) if len(values) > 1 else np.array([0.5])
        axes.plot(across, values, ls="", marker="o", ms=2.2, mfc="none", mec=COLOURS[0], mew=0.6)
        axes.plot([0.5], [values.mean()], marker="D", ms=3.6, color=COLOURS[0], ls="")
        if np.isfinite(loop.predicted[d]):
            axes.plot([0.5], [loop.predicted[d]], marker="_", ms=12.0, mew=1.0, color=COLOURS[1], ls="")
        axes.set_xlim(0.0, 1.0)
        axes.set_xticks([])
        _tidy(axes)
        page.text(left + 20.0 * d + 4.5, top + 38.0, f"{values.mean():.3f} \u00b1 {_spread(values):.3f}", size=_SMALL)
        page.text(left + 20.0 * d + 4.5, top + 40.6, word, size=5.0, color=GREY)
    if not loop.meshes:
        return
    shown = list(loop.meshes)[:3]
    width = page.to_pixels(27.0)
    with Studio((width, page.to_pixels(30.0)), VIEW, STONE) as studio:
        span = studio.span(shown)
        for j, mesh in enumerate(shown):
            page.paste(studio.picture(mesh, span), 97.0 + 27.5 * j, top + 6.0)


def _spread(values: np.ndarray) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else 0.0


def _tidy(axes: Any) -> None:
    axes.tick_params(labelsize=_SMALL, length=2.0, width=0.5, colors=INK)
    axes.margins(y=0.15)
    for name, spine in axes.spines.items():
        spine.set_visible(name == "left")
        spine.set_linewidth(0.5)
    axes.locator_params(axis="y", nbins=5)


def _legend(page: Sheet, y: float) -> None:
    axes = page.axes(4.0, y - 2.5, 173.0, 5.0)
    axes.set_axis_off()
    axes.set_xlim(0.0, 173.0)
    axes.set_ylim(-1.0, 1.0)
    entries = (
        (lambda x: axes.plot([x, x + 5.0], [0, 0], color=COLOURS[2], lw=1.2), "target and its tolerance"),
        (lambda x: axes.plot([x + 2.5], [0], marker="_", ms=9.0, mew=1.0, color=COLOURS[1], ls=""), "predicted mean"),
        (lambda x: axes.plot([x + 2.5], [0], marker="o", ms=2.6, mfc="none", mec=COLOURS[0], mew=0.6, ls=""),
         "stones of fresh seeds"),
        (lambda x: axes.plot([x + 2.5], [0], marker="D", ms=3.6, color=COLOURS[0], ls=""), "their mean"),
    )  # fmt: skip
    for i, (draw, word) in enumerate(entries):
        draw(40.0 * i)
        axes.text(40.0 * i + 6.5, 0.0, word, fontsize=_SMALL, color=INK, va="center")


def loop_errors_figure(errors: dict[str, np.ndarray], goal: float, *, title: str = "", dpi: int = DPI) -> np.ndarray:
    """Absolute errors of the means over several targets, a column a route, beside the paper's.

    Parameters
    ----------
    errors : dict of numpy.ndarray, shape (targets, 4)
        By the name of the route.
    goal : float
        Drawn as a line.
    title : str
    dpi : int

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    with sheet(_WIDTH, 74.0, dpi) as page:
        page.text(4.0, 5.0, title, size=_TITLE, ha="left", weight="bold")
        for d, name in enumerate(_NAMES):
            axes = page.axes(14.0 + 42.5 * d, 14.0, 34.0, 44.0)
            word, symbol = NOTATION[name]
            page.text(14.0 + 42.5 * d + 17.0, 11.0, f"{word} ${symbol}$", size=_TEXT)
            for j, values in enumerate(errors.values()):
                own = np.sort(values[:, d])
                across = j + 0.5 * (np.arange(len(own)) / max(len(own) - 1, 1) - 0.5)
                axes.plot(across, own, ls="", marker="o", ms=2.4, mfc="none", mec=COLOURS[j], mew=0.7)
                axes.plot([j - 0.32, j + 0.32], [own.mean()] * 2, color=COLOURS[j], lw=1.6)
                axes.text(j, -0.06, f"{own.mean():.4f}", fontsize=_SMALL, color=COLOURS[j], ha="center", va="top",
                          transform=axes.get_xaxis_transform())  # fmt: skip
            axes.axhline(goal, color=GREY, lw=0.8, ls="--")
            axes.axhline(_PAPER[d], color=INK, lw=0.8, ls=":")
            axes.set_xlim(-0.6, len(errors) - 0.4)
            axes.set_ylim(bottom=0.0)
            axes.set_xticks([])
            _tidy(axes)
        for j, name in enumerate(errors):
            page.text(14.0 + 40.0 * j, 66.0, f"\u25cb {name}", size=_SMALL, ha="left", color=COLOURS[j])
        page.text(14.0, 70.0, f"Bars and numbers: mean absolute error. Dashed: goal {goal:g}. Dotted: the paper's own "
                  "closed loop (three targets, three seeds).", size=_SMALL, ha="left", color=GREY)  # fmt: skip
        return page.pixels()
