"""One stone with what its descriptors measure, as in Fig. 3: results come in, pixels come out.

Nothing is measured here.  Stones are drawn by `lithoform.rendering`; lines, numbers and colour bars are
Matplotlib's.  What is seen through is mixed from two pictures, with and without the veil: each is opaque, so that
no order of translucent triangles, which differs between graphics drivers, touches the result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from lithoform.descriptors.solids import Box, Sphere
from lithoform.errors import LithoformError
from lithoform.figures.gallery import MILLIMETRES
from lithoform.figures.sheet import COLOURS, DPI, GREY, INK, Sheet, sheet
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Placement, Studio, Surface, Vector, load_module, view_axes
from lithoform.topology import sphere

__all__ = ["LAYERS", "NOTATION", "descriptor_label", "shape_picture"]

LAYERS: Final[tuple[str, ...]] = ("inscribed", "box", "hull", "corners", "volume")
"""What `shape_picture` can show of a stone."""

NOTATION: Final = {
    "roundness": ("Roundness", "R"),
    "boxiness": ("Boxiness", "B"),
    "solidity": ("3D solidity", "S_{3D}"),
    "true_sphericity": ("True sphericity", "TS"),
}
"""Name and symbol (as Matplotlib writes mathematics) of each descriptor of Table 2."""

_RESULTS: Final[dict[str, str]] = dict(
    zip(LAYERS, ("inscribed", "box", "hull", "corner_weights", "equal_volume"), strict=True)
)
_NOTES: Final = {
    "inscribed": r"inscribed sphere, $r_\mathrm{in}$ = ",
    "box": "$L$, $W$, $H$ = ",
    "hull": "convex hull",
    "corners": "corner weight",
    "volume": "sphere of equal volume, $r$ = ",
}

_WIDTH: Final = 46.0  # of each stone's picture [mm]
_FLATTEST, _TALLEST = 0.5, 1.25  # its height over its width, which follows the stone
_HEAD, _FOOT, _EDGE = 7.0, 6.5, 1.0  # [mm]
_ROOM: Final = 1.08  # room around what is drawn
_LABEL_ROOM: Final = 1.13  # and where the box's dimensions are written around it
_TITLE, _NOTE, _LABEL = 7.5, 6.5, 6.5  # sizes of text [pt]
_BALL: Final = 48  # subdivision of a drawn ball: its outline is off by 0.03 % of the radius

_INSCRIBED: Final = (0.10, 0.47, 0.74)
_HULL: Final = (0.98, 0.66, 0.18)
_EQUAL: Final = (0.16, 0.66, 0.50)
_HULL_INK: Final = "#8a5a00"
_LEAST_FOLD: Final = math.radians(9.0)  # smaller folds are the facets of a rounded part, too many to draw
# How much of the nearer picture is seen: stone over sphere, hull over stone, sphere over stone.
_VEILS: Final = {"inscribed": 0.5, "hull": 0.34, "volume": 0.45}
_MAP: Final = ("magma_r", 0.02, 0.86)  # from pale stone to dark, the ends of the map left out
_MOST_SHOWN: Final = 0.99  # quantile of the positive weights at which the colours end: one spike would bleach the rest


def descriptor_label(name: str, value: float, digits: int = 2) -> str:
    """Name, symbol and value of a descriptor of Table 2, such as "Roundness $R$ = 0.31".

    Raises
    ------
    LithoformError
        If the descriptor is not one of `NOTATION`.
    """
    if name not in NOTATION:
        raise LithoformError(f"expected a descriptor of {', '.join(NOTATION)}; got {name!r}.")
    words, symbol = NOTATION[name]
    return f"{words} ${symbol}$ = {value:.{digits}f}"


def shape_picture(
    mesh: Mesh,
    *,
    show: Sequence[str] = ("inscribed", "box", "hull", "corners"),
    inscribed: Sphere | None = None,
    box: Box | None = None,
    hull: Mesh | None = None,
    corner_weights: np.ndarray | None = None,
    equal_volume: Sphere | None = None,
    labels: Mapping[str, str] | None = None,
    unit: str | None = "m",
    view: Vector = VIEW,
    dpi: int = DPI,
) -> np.ndarray:
    """One panel for each thing that a descriptor measures on a stone, in a row, as in Fig. 3.

    All panels have one camera and one scale.

    Parameters
    ----------
    mesh : Mesh
        The stone.
    show : sequence of str
        Layers, in order: "inscribed", the largest inscribed sphere seen through the stone; "box", the bounding
        box with its dimensions L, W, H; "hull", the convex hull as a veil over the stone; "corners", the faces
        coloured by their weight in roundness; "volume", the sphere of equal volume as a veil over the stone.
    inscribed, equal_volume : Sphere, optional
        [unit of the mesh]
    box : Box, optional
        It encloses the stone [unit of the mesh].
    hull : Mesh, optional
        Convex [unit of the mesh].
    corner_weights : numpy.ndarray, shape (m,), optional
        Weight of each face, not negative.  The colours run from 0 to the 99th percentile of the positive weights.
    labels : mapping of str, optional
        Title of each layer, with formulas between dollar signs, such as `descriptor_label` gives.
    unit : {"m", "cm", "mm", "um"} or None
        Unit of the mesh; lengths are written in metres, millimetres or micrometres, whichever suits the stone, or as
        they are where it is None.
    view : (float, float, float)
        Direction from the stone to the eye, not along z.
    dpi : int
        Pixels per inch: a panel is 46 mm wide in print.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
        On one machine, the same results give the same pixels; `lithoform.figures.gallery.png_bytes` makes a file
        of them.

    Raises
    ------
    LithoformError
        If a layer or a unit is unknown, the result that a layer shows is not given or does not fit the mesh, or
        the stone cannot be drawn.
    """
    results = {"inscribed": inscribed, "box": box, "hull": hull, "corners": corner_weights, "volume": equal_volume}
    _check_layers(show, results, labels or {}, unit)
    weights = _checked_weights(corner_weights, mesh) if "corners" in show else np.zeros(0)
    axes = view_axes(view)
    outline = _outline(mesh, [results[layer] for layer in show], axes)
    room = _LABEL_ROOM if "box" in show else _ROOM
    across, upright = (room * float(np.ptp(outline @ axis)) for axis in axes[:2])
    width, height = _WIDTH, _WIDTH * min(max(upright / across, _FLATTEST), _TALLEST)
    span, written = max(upright, across * height / width), _written_unit(unit, max(upright, across))
    with sheet(len(show) * (width + _EDGE) + _EDGE, _HEAD + height + _FOOT, dpi) as page:
        with Studio((page.to_pixels(width), page.to_pixels(height)), view, STONE) as studio:
            panel = _Panel(page, studio, mesh, studio.placement(outline, span), axes[2], (width, height), written)
            for i, layer in enumerate(show):
                left = _EDGE + i * (width + _EDGE)
                getattr(panel, layer)(left, weights if layer == "corners" else results[layer])
                letter = f"({chr(ord('a') + i)}) " if len(show) > 1 else ""
                page.text(left + width / 2, 0.55 * _HEAD, letter + (labels or {}).get(layer, ""), size=_TITLE)
        return page.pixels()


class _Panel:
    """Draws one layer at a time on a sheet; each method takes the panel's left side [mm] and the result."""

    def __init__(
        self,
        page: Sheet,
        studio: Studio,
        mesh: Mesh,
        placement: Placement,
        towards: np.ndarray,
        size: tuple[float, float],
        unit: tuple[float, str],
    ) -> None:
        self._page, self._studio, self._placement, self._unit = page, studio, placement, unit
        self._stone, self._towards, (self._width, self._height) = Surface(mesh), towards, size

    def inscribed(self, left: float, ball: Sphere) -> None:
        body = _ball_surface(ball, _INSCRIBED)
        over = self._paste(left, self._veiled([body], [self._stone], _VEILS["inscribed"]))
        self._circle(over, ball, COLOURS[0])
        self._note(left, _NOTES["inscribed"] + self._length(ball.radius))

    def volume(self, left: float, ball: Sphere) -> None:
        both = [self._stone, _ball_surface(ball, _EQUAL)]
        over = self._paste(left, self._veiled([self._stone], both, _VEILS["volume"]))
        self._circle(over, ball, COLOURS[2])
        self._note(left, _NOTES["volume"] + self._length(ball.radius))

    def hull(self, left: float, hull: Mesh) -> None:
        both = [self._stone, Surface(hull, _HULL, faceting=100.0, cavity=0.0)]
        over = self._paste(left, self._veiled([self._stone], both, _VEILS["hull"]))
        creases, outline = _seen_edges(hull, self._towards)
        places, lines = self._placement.pixels(hull.vertices), load_module("matplotlib.collections").LineCollection
        over.add_collection(lines(places[creases], colors=_HULL_INK, linewidths=0.3, alpha=0.5), autolim=False)
        over.add_collection(lines(places[outline], colors=_HULL_INK, linewidths=0.7, capstyle="round"), autolim=False)
        self._note(left, _NOTES["hull"])

    def box(self, left: float, box: Box) -> None:
        picture = self._studio.scene([self._stone], self._placement)
        over = self._paste(left, picture)
        depth = (box.corners * self._towards).sum(axis=1)
        places = self._placement.pixels(box.corners)
        paper = (picture == picture[0, 0]).all(axis=2)
        for i, j, _ in _BOX_EDGES:
            # The stone is in the box: it hides nothing but the edges that meet in the farthest corner.
            if depth.argmin() in (i, j):
                _dashes(over, places[i], places[j], paper, 0.9 * self._page.pixels_per_millimetre)
            else:
                over.plot(*places[[i, j]].T, color=INK, linewidth=0.7, solid_capstyle="round")
        for axis, symbol in enumerate("LWH"):
            self._beside(over, places[list(_labelled_edge(axis, places, depth))], places.mean(axis=0), f"${symbol}$")
        extents = ", ".join(self._number(float(extent)) for extent in box.extents)
        self._note(left, _NOTES["box"] + extents + self._unit[1])

    def corners(self, left: float, weights: np.ndarray) -> None:
        name, low, high = _MAP
        colours = load_module("matplotlib").colormaps[name](np.linspace(low, high, 256))
        positive = weights[weights > 0.0]
        most = float(np.quantile(positive, _MOST_SHOWN)) if len(positive) else 1.0
        # By the nearest of 256 colours, with no product of large and small numbers.
        shade = np.minimum(weights / most * 255.0 + 0.5, 255.0).astype(np.int64)
        self._paste(left, self._studio.scene([Surface(self._stone.mesh, colours[shade, :3], cavity=0.0)],
                                             self._placement))  # fmt: skip
        bar = self._page.axes(left + 0.42 * self._width, _HEAD + self._height + 1.1, 0.42 * self._width, 1.8)
        module = load_module("matplotlib.colors")
        mappable = load_module("matplotlib.cm").ScalarMappable(
            module.Normalize(0.0, most), module.ListedColormap(colours)
        )
        beyond = "max" if weights.max() > most else "neither"
        colour_bar = self._page.figure.colorbar(mappable, cax=bar, orientation="horizontal", extend=beyond)
        colour_bar.outline.set_linewidth(0.4)
        colour_bar.set_ticks([0.0, 0.5 * most, most], labels=[f"{x:.2g}" for x in (0.0, 0.5 * most, most)])
        bar.tick_params(labelsize=_NOTE - 1.0, width=0.4, length=1.5, pad=1.0, colors=INK)
        self._page.text(
            left + 0.38 * self._width, _HEAD + self._height + 2.0, _NOTES["corners"], size=_NOTE, ha="right"
        )

    def _paste(self, left: float, picture: np.ndarray) -> Any:
        return self._page.paste(picture, left, _HEAD)

    def _veiled(self, under: list[Surface], over: list[Surface], share: float) -> np.ndarray:
        """The picture `under` seen through what `over` adds to it, of which `share` is seen."""
        below, above = (self._studio.scene(bodies, self._placement).astype(np.float64) for bodies in (under, over))
        return (below + share * (above - below) + 0.5).astype(np.uint8)

    def _circle(self, over: Any, ball: Sphere, colour: str) -> None:
        radius = ball.radius * self._placement.pixels_per_length
        centre = self._placement.pixels(ball.center[None])[0]
        circle = load_module("matplotlib.patches").Circle(centre, radius, fill=False, color=colour, linewidth=0.7)
        over.add_patch(circle)

    def _note(self, left: float, text: str) -> None:
        self._page.text(left + self._width / 2, _HEAD + self._height + 2.0, text, size=_NOTE)

    def _beside(self, over: Any, ends: np.ndarray, middle: np.ndarray, text: str) -> None:
        """Write beside the middle of a line, on the side away from `middle`."""
        place, step = ends.mean(axis=0), ends[1] - ends[0]
        across = np.array([-step[1], step[0]]) / max(float(np.hypot(*step)), 1.0)
        outward = across if ((place - middle) * across).sum() > 0.0 else -across
        x, y = place + 1.9 * self._page.pixels_per_millimetre * outward
        over.text(x, y, text, fontsize=_LABEL, color=INK, ha="center", va="center")

    def _length(self, length: float) -> str:
        return self._number(length) + self._unit[1]

    def _number(self, length: float) -> str:
        """A length to three digits, those that are 0 as well, and never with an exponent."""
        shown = length * self._unit[0]
        return f"{shown:.{min(max(2 - math.floor(math.log10(shown)), 0), 6)}f}"


def _written_unit(unit: str | None, length: float) -> tuple[float, str]:
    """Factor and name of the unit in which lengths up to `length` [unit of the mesh] are written."""
    if unit is None:
        return 1.0, ""
    millimetres = MILLIMETRES[unit]
    if length * millimetres >= 1000.0:
        return 1e-3 * millimetres, " m"
    return (1e3 * millimetres, " µm") if length * millimetres < 0.1 else (millimetres, " mm")


# Each edge of a box by the numbers of its two corners, which count in binary along the axes, and its axis.
_BOX_EDGES: Final = tuple(
    (i, i | bit, axis) for axis, bit in enumerate((4, 2, 1)) for i in range(8) if not i & bit
)  # fmt: skip


def _seen_edges(hull: Mesh, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges of a convex mesh on the side of the eye, folded by more than a little, and those on its outline."""
    edges, normals = (
        hull.connectivity.face_edges,
        hull.area_vectors / np.linalg.norm(hull.area_vectors, axis=1)[:, None],
    )
    count, facing = len(hull.connectivity.edges), (normals * towards).sum(axis=1) > 0.0
    seen = np.bincount(edges[facing].ravel(), minlength=count)
    # The sum of an edge's two unit normals has the length 2 cos(fold / 2).
    total = np.stack([np.bincount(edges.ravel(), np.repeat(normals[:, k], 3), count) for k in range(3)], axis=1)
    folded = (total**2).sum(axis=1) < (2.0 * math.cos(_LEAST_FOLD / 2.0)) ** 2
    return hull.connectivity.edges[(seen == 2) & folded], hull.connectivity.edges[seen == 1]


def _labelled_edge(axis: int, places: np.ndarray, depth: np.ndarray) -> tuple[int, int]:
    """The edge along an axis that is on the outline of the box and lowest in the picture, or rightmost if upright."""
    ends = [(i, j) for i, j, along in _BOX_EDGES if along == axis]
    outline = [edge for edge in ends if depth.argmin() not in edge and depth.argmax() not in edge]
    step = np.abs(places[ends[0][1]] - places[ends[0][0]])
    side = 0 if step[1] > 2.0 * step[0] else 1
    return max(outline, key=lambda edge: places[list(edge), side].sum())


def _dashes(over: Any, start: np.ndarray, end: np.ndarray, paper: np.ndarray, period: float) -> None:
    """A dashed line [pixels], drawn only where there is paper."""
    count = max(1, round(np.hypot(*(end - start)) / period))
    limit = np.array(paper.shape[::-1]) - 1
    for i in range(count):
        a, b = (start + (end - start) * (i + part) / count for part in (0.2, 0.8))
        ends = [np.clip(place.astype(np.int64), 0, limit) for place in (a, (a + b) / 2, b)]
        if all(paper[y, x] for x, y in ends):
            over.plot(*np.stack([a, b]).T, color=GREY, linewidth=0.6, solid_capstyle="butt")


def _ball_surface(ball: Sphere, colour: Vector) -> Surface:
    unit = sphere("octahedral", _BALL)
    return Surface(unit.with_vertices(ball.center + ball.radius * unit.vertices), colour, faceting=0.0, cavity=0.0)


def _outline(mesh: Mesh, results: Sequence[Any], axes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Points that enclose in the picture all that is drawn, shape (n, 3)."""
    points, (right, up, _) = [mesh.vertices], axes
    for result in results:
        if isinstance(result, Sphere):
            reach = result.radius * np.stack([right, -right, up, -up])
            points.append(result.center + reach)
        elif isinstance(result, Box):
            points.append(result.corners)
        elif isinstance(result, Mesh):
            points.append(result.vertices)
    return np.concatenate(points)


def _check_layers(show: Sequence[str], results: Mapping[str, Any], labels: Mapping[str, str], unit: str | None) -> None:
    known = ", ".join(LAYERS)
    if not show or isinstance(show, str):
        raise LithoformError(f"expected a sequence of one or more of the layers {known}; got {show!r}.")
    for layer in (*show, *labels):
        if layer not in LAYERS:
            raise LithoformError(f"expected layers of {known}; got {layer!r}.")
    for layer in show:
        if results[layer] is None:
            raise LithoformError(f"the layer {layer!r} shows the result {_RESULTS[layer]!r}, which is not given; "
                                 "pass it, or leave the layer out of `show`.")  # fmt: skip
        result = results[layer]
        lengths = (
            [result.radius] if isinstance(result, Sphere) else result.extents if isinstance(result, Box) else [1.0]
        )
        if not all(0.0 < length < math.inf for length in lengths):
            raise LithoformError(f"expected a finite, positive size of what the layer {layer!r} shows; got "
                                 f"{', '.join(f'{length:g}' for length in lengths)}.")  # fmt: skip
    if unit is not None and unit not in MILLIMETRES:
        raise LithoformError(f"expected a unit of {', '.join(MILLIMETRES)} or None; got {unit!r}.")


def _checked_weights(weights: Any, mesh: Mesh) -> np.ndarray:
    array = np.asarray(weights, dtype=np.float64)
    if array.shape != (len(mesh.faces),):
        raise LithoformError(f"expected one corner weight for each of {len(mesh.faces)} faces; got an array of shape "
                             f"{array.shape}.")  # fmt: skip
    if not (np.isfinite(array).all() and array.min() >= 0.0):
        raise LithoformError("expected corner weights that are finite and not negative; check the faces for which "
                             "they are not.")  # fmt: skip
    return array
