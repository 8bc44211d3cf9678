"""A sheet of white paper of so many millimetres, which Matplotlib draws on and which ends as pixels.

Matplotlib's own defaults are in force on it, whatever the user's settings are, so that the same results give
the same bytes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from lithoform.errors import LithoformError
from lithoform.rendering import load_module

__all__ = ["COLOURS", "DPI", "GREY", "INK", "MARKERS", "Sheet", "sheet"]

INK: Final = "#2b2a28"
GREY: Final = "#8f8b84"

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's palette, which the colour-blind tell apart: blue, vermilion, green, purple, orange, sky."""

MARKERS: Final = ("o", "s", "^", "D", "v", "P")
"""A shape of point beside each colour, so that no curve is told by its colour alone."""

DPI: Final = 300
"""Resolution of print [pixels per inch]."""

_MILLIMETRES_PER_INCH: Final = 25.4
_LEAST, _MOST = 50, 1200


class Sheet:
    """Paper with pictures, axes and text on it; places in millimetres from the top left.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    width, height : float
        [mm]
    """

    def __init__(self, figure: Any, width: float, height: float) -> None:
        self.figure, self.width, self.height = figure, width, height
        self.pixels_per_millimetre = figure.dpi / _MILLIMETRES_PER_INCH

    def to_pixels(self, length: float) -> int:
        """Whole pixels nearest to a length [mm]."""
        return round(length * self.pixels_per_millimetre)

    def axes(self, left: float, top: float, width: float, height: float, **options: Any) -> Any:
        """Axes in a rectangle of the sheet [mm]."""
        bottom = 1.0 - (top + height) / self.height
        rectangle = (left / self.width, bottom, width / self.width, height / self.height)
        return self.figure.add_axes(rectangle, **options)

    def paste(self, picture: np.ndarray, left: float, top: float) -> Any:
        """Put a picture down pixel for pixel, and return axes over it whose coordinates are its pixels from the top."""
        height, width = picture.shape[:2]
        rows = round(self.figure.bbox.height)
        x, y = self.to_pixels(left), rows - self.to_pixels(top) - height
        self.figure.figimage(picture, x, y, zorder=-1)
        box = (x / round(self.figure.bbox.width), y / rows, width / round(self.figure.bbox.width), height / rows)
        over = self.figure.add_axes(box, xlim=(0, width), ylim=(height, 0), facecolor="none")
        over.set_axis_off()
        return over

    def text(self, x: float, y: float, text: str, *, size: float, **options: Any) -> None:
        """Write a line at a place [mm], centred there unless the options say otherwise; size in points."""
        style = {"ha": "center", "va": "center", "color": INK, "fontsize": size}
        self.figure.text(x / self.width, 1.0 - y / self.height, text, **(style | options))

    def pixels(self) -> np.ndarray:
        """Return the sheet, shape (height, width, 3), uint8."""
        canvas = load_module("matplotlib.backends.backend_agg").FigureCanvasAgg(self.figure)
        canvas.draw()
        return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


@contextlib.contextmanager
def sheet(width: float, height: float, dpi: int = DPI) -> Iterator[Sheet]:
    """Yield an empty sheet; it is drawn on and turned to pixels while the block lasts.

    Parameters
    ----------
    width, height : float
        [mm]
    dpi : int
        Pixels per inch, 50 to 1200.

    Raises
    ------
    LithoformError
        If Matplotlib is not installed or the resolution is out of its range.
    """
    if not _LEAST <= dpi <= _MOST:
        raise LithoformError(f"a picture is drawn with {_LEAST} to {_MOST} pixels per inch; got {dpi}.")
    style, figure = load_module("matplotlib.style"), load_module("matplotlib.figure").Figure
    with style.context(["default", {"mathtext.fontset": "dejavusans", "axes.unicode_minus": True}]):
        # Whole pixels, so that a pasted picture falls on them.
        size = [round(length * dpi / _MILLIMETRES_PER_INCH) / dpi for length in (width, height)]
        yield Sheet(figure(figsize=size, dpi=dpi, facecolor="white"), width, height)
