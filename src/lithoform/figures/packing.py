"""A packing as a picture: the stones in their container, which is cut away, with its profile and its way to rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.errors import LithoformError
from lithoform.figures.sheet import COLOURS, GREY, INK, sheet
from lithoform.mesh import Mesh
from lithoform.rendering import STONE, VIEW, Studio, Surface, Vector, view_axes

__all__ = ["Bed", "Heap", "heap_picture", "packing_figure", "plain_axes"]

# Triangles that are drawn in all, and of a stone at least.
_TRIANGLES, _LEAST = 700_000, 200
# Tones of the stones about the house's colour: brightness, and warm to cool.
_BRIGHT, _WARM = (0.80, 1.06), 0.045
_WALL: Final[Vector] = (0.74, 0.79, 0.84)
# Thickness of walls and floor over the width of the container, and how far above the stones they are drawn.
_THICK, _ABOVE = 0.025, 1.15
_SEGMENTS = 240
_DPI = 250
_WIDTH, _HEIGHT = 180.0, 108.0  # [mm]
_PICTURE = (112.0, 100.0)
_MILLI = 1e3


@dataclass(frozen=True, eq=False, kw_only=True)
class Heap:
    """Stones in a container; lengths in metres, the floor at z = 0, the axis at 0, 0.

    Attributes
    ----------
    meshes : sequence of Mesh
        Different stones.
    which : numpy.ndarray of int, shape (n,)
        Mesh of each stone.
    turns : numpy.ndarray, shape (n, 3, 3)
        A point p of its mesh lies at turn @ p + place; the scale of the stone is in it.
    places : numpy.ndarray, shape (n, 3)
    sides : tuple of float
        Diameter of a cylinder, or widths of a box along x and y.
    height : float
        Of the rim.
    """

    meshes: Sequence[Mesh]
    which: np.ndarray
    turns: np.ndarray
    places: np.ndarray
    sides: tuple[float, ...]
    height: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Bed(Heap):
    """Stones in a container, and what was measured of them.

    Attributes
    ----------
    edges, profile : numpy.ndarray, shape (k + 1,) and (k,)
        Heights of layers, and the packing density of each.
    band : (float, float)
        Heights between which the packing density was taken.
    time, kinetic : numpy.ndarray, shape (m,)
        [s], and the mean kinetic energy of a stone over m g d.
    title : str
    lines : sequence of str
        What is written beside the picture.
    """

    edges: np.ndarray
    profile: np.ndarray
    band: tuple[float, float]
    time: np.ndarray
    kinetic: np.ndarray
    title: str
    lines: Sequence[str]


def packing_figure(bed: Bed, *, dpi: int = _DPI) -> np.ndarray:
    """Picture of a packing with its profile of packing density and its kinetic energy over time.

    Parameters
    ----------
    bed : Bed
    dpi : int
        Pixels per inch; the figure is 180 mm wide.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8

    Raises
    ------
    LithoformError
        If the extra "pictures" is not installed, the machine cannot draw, or there are no stones.
    """
    if not len(bed.which):
        raise LithoformError("expected stones to draw; the packing has none.")
    with sheet(_WIDTH, _HEIGHT, dpi) as page:
        picture = heap_picture(bed, (page.to_pixels(_PICTURE[0]), page.to_pixels(_PICTURE[1])))
        page.paste(picture, 2.0, 6.0)
        page.text(122.0, 8.0, bed.title, size=10.0, ha="left", weight="bold")
        for i, line in enumerate(bed.lines):
            page.text(122.0, 14.0 + 4.6 * i, line, size=7.0, ha="left")
        top = 20.0 + 4.6 * len(bed.lines)
        room = 0.5 * (_HEIGHT - top - 29.0)
        _draw_profile(bed, page.axes(134.0, top, 42.0, room))
        _draw_energy(bed, page.axes(134.0, top + room + 16.0, 42.0, room))
        return page.pixels()


def heap_picture(heap: Heap, size: tuple[int, int], *, tallest: float | None = None) -> np.ndarray:
    """Stones in their container, which is cut away.

    Parameters
    ----------
    heap : Heap
    size : (int, int)
        Pixels across and down.
    tallest : float, optional
        Height that the picture has room for [m], so that several are at one scale; by default that of the stones.

    Returns
    -------
    numpy.ndarray, shape (height, width, 3), uint8
    """
    stones = _stones(heap)
    top = float(stones.mesh.vertices[:, 2].max())
    walls = [Surface(Mesh(*patch), _WALL, faceting=0.0, cavity=0.0) for patch in _walls(heap, top)]
    with Studio(size, VIEW, STONE) as studio:
        every = np.concatenate([surface.mesh.vertices for surface in (stones, *walls)])
        if tallest is not None:
            wide = 0.5 * max(heap.sides) * (1.0 + 2.0 * _THICK)
            room = (-_THICK * max(heap.sides), _ABOVE * tallest)
            every = np.array([[x, y, z] for x in (-wide, wide) for y in (-wide, wide) for z in room])
        right, up, _ = view_axes(VIEW)
        span = 1.04 * max(float(np.ptp(every @ up)), float(np.ptp(every @ right)) * size[1] / size[0])
        return studio.scene([stones, *walls], studio.placement(every, span))


def _stones(bed: Heap) -> Surface:
    """All stones as one body, each in a tone of its own."""
    each = max(_LEAST, _TRIANGLES // len(bed.which))
    drawn = [_coarse(mesh, each) for mesh in bed.meshes]
    points, faces, colours, first = [], [], [], 0
    for i, shape in enumerate(bed.which.tolist()):
        vertices, triangles = drawn[shape]
        points.append(vertices @ bed.turns[i].T + bed.places[i])
        faces.append(triangles + first)
        colours.append(np.broadcast_to(_tone(i), (len(triangles), 3)))
        first += len(vertices)
    return Surface(Mesh(np.concatenate(points), np.concatenate(faces)), np.concatenate(colours))


def _tone(number: int) -> np.ndarray:
    # Multiples of irrational numbers spread evenly, and neighbours in number differ.
    bright, warm = math.modf(number * 0.6180339887)[0], math.modf(number * 0.7548776662)[0]
    shift = _WARM * (2.0 * warm - 1.0) * np.array([1.0, 0.0, -1.4])
    return np.clip((_BRIGHT[0] + (_BRIGHT[1] - _BRIGHT[0]) * bright) * np.array(STONE) + shift, 0.0, 1.0)


def _coarse(mesh: Mesh, triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces for a picture: with about so many triangles, if it has more."""
    if len(mesh.faces) <= triangles:
        return mesh.vertices, mesh.faces
    from fast_simplification import simplify

    # Its thresholds are absolute: bodies of unit size.  For a picture its result need not be checked.
    centre, size = mesh.vertices.mean(axis=0), float(np.ptp(mesh.vertices, axis=0).max())
    # A copy of the faces, since it refuses read-only arrays.
    points, faces = simplify((mesh.vertices - centre) / size, mesh.faces.copy(), target_count=triangles)
    return np.asarray(points, dtype=np.float64) * size + centre, np.asarray(faces)


def _walls(bed: Heap, top: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Patches of the floor and of the walls that are farther from the eye than the axis."""
    thick = _THICK * max(bed.sides)
    high = min(bed.height, _ABOVE * top)
    inner, outer = (_outline(bed.sides, grow) for grow in (0.0, thick))
    whole = [np.append(outline, outline[:1], axis=0) for outline in (inner, outer)]
    yield _strip(_at(whole[0] * 1e-6, 0.0), _at(whole[0], 0.0), up=True)
    yield _strip(_at(whole[1], -thick), _at(whole[1], 0.0))
    yield _strip(_at(whole[0], 0.0), _at(whole[1], 0.0), up=True)
    for a, b in _far_parts(inner, outer):
        yield _strip(_at(a, 0.0), _at(a, high), inward=True)
        yield _strip(_at(b, 0.0), _at(b, high))
        yield _strip(_at(a, high), _at(b, high), up=True)
        for end in (0, -1):
            yield _strip(_at(np.stack([a[end], b[end]]), 0.0), _at(np.stack([a[end], b[end]]), high))


def _outline(sides: tuple[float, ...], grow: float) -> np.ndarray:
    if len(sides) == 1:
        angle = np.linspace(0.0, 2.0 * math.pi, _SEGMENTS, endpoint=False)
        return (0.5 * sides[0] + grow) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    x, y = (0.5 * side + grow for side in sides)
    return np.array([[x, y], [-x, y], [-x, -y], [x, -y]])


def _far_parts(inner: np.ndarray, outer: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The pieces of the outline that lie behind the stones, inside and outside."""
    toward = np.array(VIEW[:2]) / math.hypot(*VIEW[:2])
    if len(inner) > 4:
        far = np.flatnonzero(inner @ toward < 0.12 * np.abs(inner).max())
        # One run of numbers, round the end of the list.
        start = int(far[np.flatnonzero(np.diff(far) > 1)[0] + 1]) if (np.diff(far) > 1).any() else int(far[0])
        run = (start + np.arange(len(far))) % len(inner)
        return [(inner[run], outer[run])]
    # Sides whose outward normal points away from the eye: at the back, and to the left of it.
    return [(inner[[0, 1]], outer[[0, 1]]), (inner[[1, 2]], outer[[1, 2]])]


def _at(outline: np.ndarray, z: float) -> np.ndarray:
    return np.column_stack([outline, np.full(len(outline), z)])


def _strip(a: np.ndarray, b: np.ndarray, *, up: bool = False, inward: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Surface between two lines of points, seen from above, from inside or, by default, from either side."""
    n = len(a)
    k = np.arange(n - 1)
    faces = np.concatenate([np.stack([k, k + 1, n + k + 1], axis=1), np.stack([k, n + k + 1, n + k], axis=1)])
    vertices = np.concatenate([a, b])
    p, q, r = (vertices[faces[:, c]] for c in range(3))
    normal = np.cross(q - p, r - p).sum(axis=0)
    if up and normal[2] < 0.0:
        faces = faces[:, ::-1]
    if inward or not up:
        centre = (p + q + r) / 3.0
        across = (np.cross(q - p, r - p)[:, :2] * centre[:, :2]).sum()
        if (across > 0.0) == inward:
            faces = faces[:, ::-1]
    return vertices, np.ascontiguousarray(faces)


def _draw_profile(bed: Bed, axes: Any) -> None:
    plain_axes(axes, "packing density", "height (mm)")
    low, high = (_MILLI * x for x in bed.band)
    axes.axhspan(low, high, color=COLOURS[0], alpha=0.10, linewidth=0.0)
    axes.stairs(bed.profile, _MILLI * bed.edges, orientation="horizontal", color=COLOURS[0], linewidth=1.2)
    axes.set_xlim(0.0, max(0.7, 1.1 * float(bed.profile.max())))
    axes.set_ylim(0.0, _MILLI * float(bed.edges[-1]))


def _draw_energy(bed: Bed, axes: Any) -> None:
    plain_axes(axes, "time (s)", "kinetic energy / (m g d)")
    moving = bed.kinetic > 0.0
    axes.semilogy(bed.time[moving], bed.kinetic[moving], color=COLOURS[1], linewidth=1.2)
    axes.set_xlim(0.0, float(bed.time[-1]) or 1.0)


def plain_axes(axes: Any, x: str, y: str) -> None:
    """Labels, and no frame but the two axes."""
    axes.set_xlabel(x, fontsize=7.0, color=INK)
    axes.set_ylabel(y, fontsize=7.0, color=INK)
    axes.tick_params(labelsize=6.5, colors=INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(GREY)
