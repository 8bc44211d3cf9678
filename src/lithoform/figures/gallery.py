"""Pages of stones: a contact sheet, the plate of one-parameter variations (Fig. 2).

Meshes come in, PNG files go out; nothing about a stone is computed anew.  Stones are drawn by
`lithoform.rendering`, pages are laid out by Matplotlib, which is loaded where it is used.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from lithoform.atomic import atomic_write
from lithoform.errors import LithoformError
from lithoform.mesh import Mesh
from lithoform.parameters import PARAMETERS
from lithoform.rendering import STONE, VIEW, Studio, Vector, load_module

__all__ = ["MILLIMETRES", "Variation", "figure_2", "gallery", "png_bytes"]

# The paper's symbols as Matplotlib writes mathematics, by their form in ASCII; "size" is L, W and H together.
_MATHTEXT: Final = {
    "eta": r"\eta", "delta": r"\delta_i", "lambda": r"\lambda", "alpha": r"\alpha", "beta": r"\beta",
    "gamma": r"\gamma", "kappa": r"\kappa", "a": r"\mathbf{a}", "p0": r"\mathbf{p}_0", "rho": r"\rho",
    "n": r"\hat{\mathbf{n}}", "size": "[L,W,H]",
}  # fmt: skip
_HIGHLIGHT: Final = "#faf0db"  # paper under the benchmark
_INK: Final = "#2b2a28"
MILLIMETRES: Final = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3}


@dataclass(frozen=True)
class Variation:
    """One row of stones that differ in one parameter.

    Attributes
    ----------
    symbol : str
        Symbol of the parameter in ASCII, or "size".
    stones : sequence of (str, Mesh)
        How the value is written, and the stone that it gives.
    benchmark : int or None
        Which of the stones is the benchmark.
    """

    symbol: str
    stones: Sequence[tuple[str, Mesh]]
    benchmark: int | None = None


def gallery(
    meshes: Sequence[Mesh],
    captions: Sequence[str],
    path: str | Path,
    *,
    columns: int | None = None,
    title: str | None = None,
    scale: Literal["common", "each"] = "common",
    unit: str = "m",
) -> Path:
    """Contact sheet of stones, a PNG file written whole or not at all.

    Parameters
    ----------
    meshes : sequence of Mesh
    captions : sequence of str
        One for each mesh; line breaks are kept.
    path : str or pathlib.Path
    columns : int, optional
        By default a sheet a little wider than high.
    title : str, optional
    scale : {"common", "each"}
        One scale for all, with a scale bar; or each stone as large as its cell.
    unit : {"m", "cm", "mm", "um"}
        Unit of the meshes, for the scale bar.

    Raises
    ------
    LithoformError
        If there is not one caption for each mesh, an option is unknown, or the stones cannot be drawn.
    OutputError
        If the file cannot be written.
    """
    if not meshes or len(captions) != len(meshes):
        raise LithoformError(f"a gallery needs one caption for each mesh; got {len(meshes)} meshes and "
                             f"{len(captions)} captions.")  # fmt: skip
    if scale not in ("common", "each") or unit not in MILLIMETRES or (columns is not None and columns < 1):
        raise LithoformError(f"a gallery needs a scale of common or each, a unit of {', '.join(MILLIMETRES)}, and at "
                             f"least 1 column; got {scale!r}, {unit!r} and {columns}.")  # fmt: skip
    columns = min(columns or math.ceil(math.sqrt(1.2 * len(meshes))), len(meshes))
    width, height = cell = (320, 260)
    pitch = height + 12 + 19 * max(caption.count("\n") + 1 for caption in captions)
    head, foot = (64 if title else 16), (56 if scale == "common" else 12)
    page = _Page(columns * width + 32, head + math.ceil(len(meshes) / columns) * pitch + foot)
    with Studio(cell, VIEW, STONE) as studio:
        span = studio.span(meshes) if scale == "common" else None
        for i, (mesh, caption) in enumerate(zip(meshes, captions, strict=True)):
            left, top = 16 + (i % columns) * width, head + (i // columns) * pitch
            page.paste(studio.picture(mesh, span), left, top)
            page.text(left + width / 2, top + height + 2, caption, size=15, va="top")
    if title:
        page.text(24, 34, title, size=22, ha="left", weight="bold")
    if span is not None:
        millimetres = _round_length(0.6 * span * width / height * MILLIMETRES[unit])
        bar = millimetres / MILLIMETRES[unit] / span * height
        page.line([page.width - 28 - bar, page.width - 28], page.height - 24)
        page.text(page.width - 28 - bar / 2, page.height - 40, f"{millimetres:g} mm", size=15)
    return page.save(path)


def figure_2(
    rows: Sequence[Variation],
    path: str | Path,
    *,
    title: str | None = None,
    cell: tuple[int, int] = (300, 216),
    view: Vector = VIEW,
    symbols: bool = True,
) -> Path:
    """Plate of one-parameter variations as in Fig. 2, a PNG file written whole or not at all.

    Parameters
    ----------
    rows : sequence of Variation
        Drawn at one scale and one view, in two blocks side by side where they are many; the cell of the
        benchmark is tinted and its value bold.
    path : str or pathlib.Path
    title : str, optional
    cell : (int, int)
        Width and height of each picture [pixels]; the text is in proportion.
    view : (float, float, float)
        Direction from the stones to the eye.
    symbols : bool
        Write symbol and name of the parameter before each row.

    Raises
    ------
    LithoformError
        If a row has no stones, there are no rows, or the stones cannot be drawn.
    OutputError
        If the file cannot be written.
    """
    if not rows or not all(row.stones for row in rows):
        raise LithoformError("a plate of variations needs at least one row, and at least one stone in each row.")
    width, height = cell
    unit = height / 216.0
    blocks = 2 if len(rows) > 4 else 1
    deep = math.ceil(len(rows) / blocks)
    label, gap, edge = (round(x * unit) for x in (240 if symbols else 0, 46, 24 if symbols else 4))
    head, rule, gutter = (round(x * unit) for x in (124 if title else 24 if symbols else 4, 14, 64))
    across = label + width * max(len(row.stones) for row in rows)
    bottom = deep * (height + gap + rule) - rule + edge
    page = _Page(blocks * (across + gutter) - gutter + 2 * edge, head + bottom)
    if title:
        page.text(edge, head / 2, title, size=44 * unit, ha="left", weight="bold")
    with Studio(cell, view, STONE) as studio:
        span = studio.span([mesh for row in rows for _, mesh in row.stones])
        for i, row in enumerate(rows):
            left = edge + (i // deep) * (across + gutter)
            top = head + (i % deep) * (height + gap + rule)
            if i % deep:
                page.line([left, left + across], top - rule / 2, width=1.0, colour="#d8d4cc")
            if symbols:
                middle, name = left + label / 2 - 10 * unit, _name(row.symbol)
                size = (36 if row.symbol == "size" else 50) * unit
                page.text(middle, top + 0.36 * height, f"${_MATHTEXT.get(row.symbol, row.symbol)}$", size=size)
                page.text(middle, top + 0.58 * height, name.replace(" ", "\n"), size=25 * unit, va="top")
            for j, (value, mesh) in enumerate(row.stones):
                x, marked = left + label + j * width, j == row.benchmark
                paper = _HIGHLIGHT if marked else "white"
                page.paste(studio.picture(mesh, span, paper), x, top, below=gap if marked else 0)
                weight = "bold" if marked else "normal"
                page.text(x + width / 2, top + height + 0.42 * gap, value, size=28 * unit, weight=weight)
    return page.save(path, colours=256 if symbols else 96)


def png_bytes(picture: np.ndarray, *, colours: int | None = None) -> bytes:
    """PNG file of a picture.

    Parameters
    ----------
    picture : numpy.ndarray, shape (height, width, 3), uint8
    colours : int, optional
        Write a palette of so many colours, 2 to 256: a smaller file.

    Raises
    ------
    LithoformError
        If Pillow, which comes with Matplotlib, is not installed.
    """
    image = load_module("PIL.Image")
    pixels = image.fromarray(picture)
    if colours is not None:
        # No dithering: its noise costs more bytes than smoother gradients gain.
        pixels = pixels.quantize(colours, method=image.Quantize.MEDIANCUT, dither=image.Dither.NONE)
    stream = io.BytesIO()
    pixels.save(stream, format="PNG", optimize=colours is not None)
    return stream.getvalue()


def _name(symbol: str) -> str:
    names = {p.symbol: p.name for p in PARAMETERS} | {"size": "target_size"}
    return names.get(symbol, symbol).replace("_", " ").replace("fbm", "FBM")


def _round_length(room: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above some length."""
    power = 10.0 ** math.floor(math.log10(room))
    return max(step * power for step in (1, 2, 5) if step * power <= room)


class _Page:
    """White paper on which pictures are pasted pixel for pixel; places in pixels from the top left."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._pixels = np.full((height, width, 3), 255, dtype=np.uint8)
        self._figure = load_module("matplotlib.figure").Figure(
            figsize=(width / 100, height / 100), dpi=100, facecolor="none"
        )

    def paste(self, picture: np.ndarray, left: int, top: int, below: int = 0) -> None:
        """Put a picture down, and the colour of its corner on so many rows of pixels below it."""
        high, wide = picture.shape[:2]
        self._pixels[top : top + high + below, left : left + wide] = picture[0, 0]
        self._pixels[top : top + high, left : left + wide] = picture

    def text(self, x: float, y: float, text: str, *, size: float, **options: Any) -> None:
        # Only whole formulas are parsed, so that a $ in a caption stays one.  72 points to 100 pixels.
        formula = text.startswith("$") and text.endswith("$")
        style = {"ha": "center", "va": "center", "color": _INK, "fontsize": 0.72 * size, "parse_math": formula}
        self._figure.text(x / self.width, 1 - y / self.height, text, math_fontfamily="stix", **(style | options))

    def line(self, x: list[float], y: float, *, width: float = 3.0, colour: str = _INK) -> None:
        ends = [v / self.width for v in x], [1 - y / self.height] * 2
        self._figure.add_artist(load_module("matplotlib.lines").Line2D(*ends, color=colour, linewidth=0.72 * width))

    def save(self, path: str | Path, colours: int | None = None) -> Path:
        canvas = load_module("matplotlib.backends.backend_agg").FigureCanvasAgg(self._figure)
        canvas.draw()
        # Only the ink goes through Matplotlib, which would resample a picture in float64: slow and large.
        layer = np.asarray(canvas.buffer_rgba())
        inked = layer[..., 3] > 0
        cover = layer[inked][:, 3:] / 255.0
        self._pixels[inked] = (layer[inked][:, :3] * cover + self._pixels[inked] * (1.0 - cover) + 0.5).astype(np.uint8)
        atomic_write(path, png_bytes(self._pixels, colours=colours))
        return Path(path)
