"""How the number of triangles touches the descriptors (Fig. 4b): results come in, pixels come out."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from lithoform.errors import LithoformError
from lithoform.figures.shape import NOTATION
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, Sheet, sheet
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Placement, Studio, Surface, Vector, load_module

__all__ = ["Resolution", "resolution_figure"]

_LEFT, _RIGHT, _TOP, _FOOT = 15.0, 2.0, 8.0, 10.0  # margins [mm]
_COLUMN: Final = 41.0  # width of a class [mm]
_STONE: Final = (27.0, 21.0)  # picture of a stone, with its lens to the right [mm]
_LENS, _SPOT = 13.0, 2.6  # diameters of the lens, and of the spot of the stone that it shows [mm]
_STRIP, _GAP = 20.0, 3.0  # height of a descriptor's strip, and space below it [mm]
_TITLE, _TEXT, _SMALL = 8.0, 7.0, 6.0  # [pt]
_LEAST_RANGE: Final = 0.06  # of the values' mean: a strip never magnifies smaller differences


@dataclasses.dataclass(frozen=True)
class Resolution:
    """One stone at one number of triangles.

    Attributes
    ----------
    shape_class : str
        Name of the column, such as "cube".
    triangles : int
        As asked for; the rows of the figure go from the most to the fewest.
    descriptors : mapping of str to float
        Values by name, the same names in every row.
    mesh : Mesh or None
        The stone itself; where every row has one, the stones are drawn.
    """

    shape_class: str
    triangles: int
    descriptors: Mapping[str, float]
    mesh: Mesh | None = None


def resolution_figure(rows: Sequence[Resolution], *, view: Vector = VIEW, dpi: int = DPI) -> np.ndarray:
    """Stones of several classes at several numbers of triangles, and how their descriptors drift.

    A column for each class; above, the stones, each with a lens that shows its triangles; below, a strip for each
    descriptor, whose drift from the finest mesh is written in percent.

    Parameters
    ----------
    rows : sequence of Resolution
        Every class at every number of triangles, once.
    view : (float, float, float)
        Direction from the stones to the eye.
    dpi : int
        Pixels per inch: with four classes the figure is 181 mm wide in print, two columns of a journal.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        On one machine, the same rows give the same pixels; `lithoform.figures.gallery.png_bytes` makes a file of them.

    Raises
    ------
    LithoformError
        If a row is missing, double or has other descriptors, a value is not finite and positive, or the stones
        cannot be drawn.
    """
    table = _checked_table(rows)
    classes = list(dict.fromkeys(row.shape_class for row in rows))
    counts = sorted({row.triangles for row in rows}, reverse=True)
    meshes = {key: row.mesh for key, row in table.items() if row.mesh is not None}
    pictures = len(counts) * _STONE[1] if len(meshes) == len(table) else 0.0
    names = list(rows[0].descriptors)
    width = _LEFT + len(classes) * _COLUMN + _RIGHT
    height = _TOP + pictures + 2.0 + len(names) * (_STRIP + _GAP) - _GAP + _FOOT
    with sheet(width, height, dpi) as page:
        for i, shape_class in enumerate(classes):
            page.text(_LEFT + (i + 0.5) * _COLUMN, 0.55 * _TOP, shape_class, size=_TITLE, weight="bold")
        if pictures:
            _draw_stones(page, meshes, classes, counts, view)
        for i, name in enumerate(names):
            top = _TOP + pictures + 2.0 + i * (_STRIP + _GAP)
            axes = page.axes(_LEFT, top, len(classes) * _COLUMN, _STRIP)
            values = [[table[shape_class, count].descriptors[name] for count in counts] for shape_class in classes]
            _draw_strip(axes, name, np.array(values, dtype=np.float64))
            if i == len(names) - 1:
                ticks = [f"{count:,}" for _ in classes for count in counts]
                axes.set_xticks(_places(len(classes), len(counts)).ravel(), ticks)
                axes.tick_params(axis="x", labelsize=_SMALL, length=2.0, width=0.5, colors=INK, pad=2.0)
        page.text(_LEFT + len(classes) * _COLUMN / 2, height - 2.6, "triangles", size=_TEXT)
        return page.pixels()


def _draw_stones(
    page: Sheet, meshes: Mapping[tuple[str, int], Mesh], classes: Sequence[str], counts: Sequence[int], view: Vector
) -> None:
    size, lens = tuple(page.to_pixels(length) for length in _STONE), page.to_pixels(_LENS)
    with Studio((size[0], size[1]), view, STONE) as studio, Studio((lens, lens), view, STONE) as magnifier:
        span = studio.span(list(meshes.values()))
        for (j, count), (i, shape_class) in itertools.product(enumerate(counts), enumerate(classes)):
            mesh, left, top = meshes[shape_class, count], _LEFT + i * _COLUMN, _TOP + j * _STONE[1]
            placement = studio.placement(mesh.vertices, span)
            over = page.paste(studio.scene([Surface(mesh)], placement), left, top)
            edges = Surface(mesh, edge_width=0.09 * page.pixels_per_millimetre)
            picture = magnifier.scene([edges], _magnified(placement, lens, _LENS / _SPOT * _STONE[1] / _LENS))
            beside = page.paste(_rounded(picture), left + _STONE[0] + 0.3, top + (_STONE[1] - _LENS) / 2)
            _draw_lens(over, beside, size, lens)
        for j, count in enumerate(counts):
            middle = _TOP + (j + 0.5) * _STONE[1]
            page.text(0.62 * _LEFT, middle, f"{count:,}\ntriangles", size=_TEXT)


def _magnified(placement: Placement, pixels: int, factor: float) -> Placement:
    """The middle of a picture, so many times larger, in a square picture."""
    offsets = tuple(factor * offset for offset in placement.offsets)
    return dataclasses.replace(placement, zoom=factor * placement.zoom, offsets=offsets, size=(pixels, pixels))


def _rounded(picture: np.ndarray) -> np.ndarray:
    """A square picture as a disc on white paper."""
    middle = 0.5 * (len(picture) - 1)
    distance = np.hypot(*np.ogrid[-middle : middle + 0.5, -middle : middle + 0.5])
    cover = np.clip(0.5 * len(picture) - 1.0 - distance, 0.0, 1.0)[..., None]
    return (cover * picture + (1.0 - cover) * 255.0 + 0.5).astype(np.uint8)


def _draw_lens(over: Any, beside: Any, size: tuple[int, ...], lens: int) -> None:
    patches = load_module("matplotlib.patches")
    line = {"color": INK, "linewidth": 0.5, "fill": False}
    small = 0.5 * _SPOT / _LENS * lens
    over.add_patch(patches.Circle((size[0] / 2, size[1] / 2), small, **line))
    beside.add_patch(patches.Circle((lens / 2, lens / 2), lens / 2 - 1.0, clip_on=False, **line))
    for side in (-1.0, 1.0):
        ends = (size[0] / 2, size[1] / 2 + side * small), (lens / 2, lens / 2 + side * (lens / 2 - 1.0))
        over.figure.add_artist(
            patches.ConnectionPatch(*ends, "data", "data", axesA=over, axesB=beside, color=INK, linewidth=0.3)
        )


def _places(classes: int, counts: int) -> np.ndarray:
    """Where each value stands along a strip, shape (classes, counts), in columns."""
    return np.arange(classes)[:, None] + (np.arange(counts) + 0.5) / counts


def _draw_strip(axes: Any, name: str, values: np.ndarray) -> None:
    words, symbol = NOTATION.get(name, (name.replace("_", " "), ""))
    places = _places(*values.shape)
    low, high, least = values.min(), values.max(), _LEAST_RANGE * values.mean()
    room = max(high - low, least)
    middle = 0.5 * (low + high)
    axes.set(xlim=(0, len(values)), ylim=(middle - 0.85 * room, middle + 0.85 * room))
    for group, x in zip(values, places, strict=True):
        axes.plot(x, group, "-", color=COLOURS[0], linewidth=0.8, zorder=2)
        axes.plot(x, group, "o", color=COLOURS[0], markersize=3.2, markeredgewidth=0, zorder=3)
        axes.plot(x[0], group[0], "o", color="white", markeredgecolor=COLOURS[0], markersize=3.2, zorder=4)
        texts = [f"{group[0]:.3f}", *(_drift(value / group[0] - 1.0) for value in group[1:])]
        for k, (place, value, text) in enumerate(zip(x, group, texts, strict=True)):
            # On the side that the line leaves free.
            above = value >= group[max(k - 1, 0) : k + 2].mean()
            axes.annotate(text, (place, value), (0.0, 3.2 if above else -3.2), textcoords="offset points", ha="center",
                          va="bottom" if above else "top", fontsize=_SMALL, color=INK, zorder=5)  # fmt: skip
    for boundary in range(1, len(values)):
        axes.axvline(boundary, color="#d8d4cc", linewidth=0.6, zorder=1)
    axes.set_xticks([])
    axes.yaxis.set_major_locator(load_module("matplotlib.ticker").MaxNLocator(3, prune="both"))
    axes.tick_params(axis="y", labelsize=_SMALL, length=2.0, width=0.5, colors=INK, pad=2.0)
    axes.set_ylabel(f"{words} ${symbol}$" if symbol else words, fontsize=_SMALL + 0.5, color=INK)
    axes.yaxis.set_label_coords(-11.0 / (len(values) * _COLUMN), 0.5)
    for spine in axes.spines.values():
        spine.set(linewidth=0.5, color=GREY)


def _drift(part: float) -> str:
    """A relative change in percent, with its sign; "0.0 %" has none."""
    text = f"{100.0 * part:+.1f} %".replace("-", "−")
    return text[1:] if text[1:] == "0.0 %" else text


def _checked_table(rows: Sequence[Resolution]) -> dict[tuple[str, int], Resolution]:
    if not rows or not rows[0].descriptors:
        raise LithoformError("a figure of resolutions needs at least one row, and at least one descriptor in it.")
    table: dict[tuple[str, int], Resolution] = {}
    for row in rows:
        key = (row.shape_class, row.triangles)
        if key in table:
            raise LithoformError(f"expected each class once at each number of triangles; got {key} twice.")
        if list(row.descriptors) != list(rows[0].descriptors):
            raise LithoformError(f"expected the descriptors {', '.join(rows[0].descriptors)} in every row; got "
                                 f"{', '.join(row.descriptors) or 'none'} for {key}.")  # fmt: skip
        for name, value in row.descriptors.items():
            if not 0.0 < value < np.inf:
                raise LithoformError(f"expected a finite, positive {name} in every row; got {value} for {key}.")
        table[key] = row
    for key in itertools.product({row.shape_class: 0 for row in rows}, {row.triangles: 0 for row in rows}):
        if key not in table:
            raise LithoformError(f"expected every class at every number of triangles; {key} is missing.")
    return table
