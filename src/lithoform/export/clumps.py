"""Clumps: a stone as overlapping spheres.

The method follows Ferellec and McDowell (2010, Granular Matter 12:459): spheres that lie in the body and touch its
surface are taken one after another until the surface is covered.  Unlike theirs the choice is not random: each time the
sphere is taken that covers the largest part of the surface that is still bare (the greedy cover of sets).  At the end
all radii grow by the same length, so that the union of the spheres has the volume of the stone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from lithoform.dem import Model, Shape
from lithoform.errors import SceneError
from lithoform.lazy import cached_property
from lithoform.mesh import Mesh

__all__ = [
    "MOST_SPHERES",
    "SPHERES",
    "Clump",
    "at_least_two",
    "extremes",
    "make_clump",
    "surface_points",
    "union_moments",
]

SPHERES: Final = 40
"""Spheres of a clump, at most, unless told."""

MOST_SPHERES: Final = 500

# Lengths in radii of the sphere of equal volume. A point of the surface is covered by a sphere whose surface is as near
# as the first of these; where the spheres do not suffice, as the next, and so on, until less than this share is bare:
# else stones would lack their corners.
_COVERED: Final = (0.03, 0.045, 0.07, 0.1, 0.15, 0.22, 0.33)
_BARE: Final = 0.03
# Smaller spheres than that are not taken; centres begin on a grid of this spacing.
_SMALLEST, _SPACING = 0.1, 0.12
# Points of the surface that are covered or bare, and that distances are taken from.
_POINTS: Final = 4000
# Steps of a centre away from the nearest point of the surface, each this share of the one before.
_STEPS, _SHRINK = 24, 0.75
# A further sphere covers at least this share of the surface.
_LEAST_GAIN: Final = 5e-4
# Points across the widest extent of a clump in its integrals: two grids, so that the volume that is told is not
# measured at the points by which it was set.
_FITTED, _MEASURED = 72, 90
_SEED: Final = 0
# Rows of a table of distances at a time.
_BLOCK: Final = 1024
# Points on each sphere at which its distance from the surface is measured.
_ON_SPHERE: Final = 200


@dataclass(frozen=True, eq=False)
class Clump:
    """Spheres in the frame of a shape: the origin is the true centre of mass, the axes are the principal ones.

    Attributes
    ----------
    centres : numpy.ndarray, shape (k, 3)
        [m].
    radii : numpy.ndarray, shape (k,)
        [m].
    volume_error : float
        Volume of the union of the spheres over that of the shape, less 1.
    centre_error : float
        Distance of the centroid of the union from the centre of mass, over the radius of the sphere of equal volume.
    inertia_error : float
        Largest component of the difference of the tensors of inertia, the union's at the mass of the shape, over the
        largest principal moment. What a deck says of a body is not this inertia but that of the shape.
    mean_distance : float
        Of points of the surface of the shape from that of the union, over the radius of the sphere of equal volume.
    max_distance : float
        The largest of these, or of points of the surface of the union from that of the shape.
    """

    centres: np.ndarray
    radii: np.ndarray
    volume_error: float = 0.0
    centre_error: float = 0.0
    inertia_error: float = 0.0
    mean_distance: float = 0.0
    max_distance: float = 0.0

    def __len__(self) -> int:
        return len(self.radii)

    @cached_property
    def reach(self) -> float:
        """Distance of the farthest point of a sphere from the centre of mass [m]."""
        return float((np.linalg.norm(self.centres, axis=1) + self.radii).max())

    def errors(self) -> dict[str, float]:
        """What was lost, by name."""
        names = ("volume_error", "centre_error", "inertia_error", "mean_distance", "max_distance")
        return {name: getattr(self, name) for name in names}


def make_clump(shape: Shape, spheres: int = SPHERES) -> Clump:
    """Clump of a shape; the same shape gives the same clump.

    Parameters
    ----------
    shape : Shape
    spheres : int
        At most.

    Raises
    ------
    SceneError
        If the number of spheres is not from 1 to 500.
    """
    if not 1 <= spheres <= MOST_SPHERES:
        raise SceneError(f"expected 1 to {MOST_SPHERES} spheres in a clump, got {spheres!r}.")
    mesh = shape.mesh
    if mesh is None:
        return Clump(np.zeros((1, 3)), np.array([shape.radius]))
    surface = _Surface.of(mesh)
    centres, radii = _inscribed(surface, shape.radius)
    chosen = _cover(surface.points, centres, radii, shape.radius, spheres)
    centres, radii = centres[chosen], radii[chosen]
    radii = radii + _growth(centres, radii, shape)
    if radii.min() <= 0.0:
        raise SceneError(
            "expected a stone that spheres inside of it can stand for; one of them would vanish when their union gets "
            f"the volume of the stone: give another number of spheres than {spheres}."
        )
    return _with_errors(Clump(centres, radii), shape, surface)


@dataclass(frozen=True, eq=False)
class _Surface:
    """Points spread evenly over a surface, outward normals there, and its area [m^2]."""

    points: np.ndarray
    normals: np.ndarray
    area: float

    @classmethod
    def of(cls, mesh: Mesh) -> _Surface:
        """That of a mesh."""
        return cls(*surface_points(mesh, _POINTS), float(np.linalg.norm(mesh.area_vectors, axis=1).sum()))

    def is_around(self, at: np.ndarray) -> np.ndarray:
        """Whether places are in the body, by the solid angle that the surface takes up there: 4 pi, or 0 outside."""
        inside = np.zeros(len(at), dtype=bool)
        heights = (self.normals * self.points).sum(axis=1)
        for k in range(0, len(at), _BLOCK):
            some = at[k : k + _BLOCK]
            angles = (heights - some @ self.normals.T) / np.maximum(_distances(some, self.points), 1e-300) ** 3
            inside[k : k + _BLOCK] = angles.sum(axis=1) * self.area / len(self.points) > 2.0 * math.pi
        return inside


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    from scipy.spatial.distance import cdist

    return cdist(a, b)


def surface_points(mesh: Mesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over a surface, and the outward normals there, both of shape (count, 3).

    In each triangle by the sequence of Roberts (R2), whose points keep away from each other.
    """
    areas = np.linalg.norm(mesh.area_vectors, axis=1)
    ends = np.cumsum(areas)
    face = np.searchsorted(ends, (np.arange(count) + 0.5) / count * ends[-1])
    plastic = 1.32471795724474602596
    u, v = ((0.5 + np.arange(count) / plastic**k) % 1.0 for k in (1, 2))
    # A unit square onto a triangle, even over it.
    root = np.sqrt(u)
    weights = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)
    points = np.einsum("ij,ijk->ik", weights, mesh.vertices[mesh.faces[face]])
    return points, mesh.area_vectors[face] / areas[face][:, None]


def union_moments(centres: np.ndarray, radii: np.ndarray, across: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume [m^3], first [m^4] and second moment [m^5] of a union of spheres, by random points of the cells of a grid.

    Parameters
    ----------
    centres : numpy.ndarray, shape (k, 3)
    radii : numpy.ndarray, shape (k,)
    across : int
        Points across the widest extent.
    """
    points, cell = _grid(centres, radii, across, 0.0)
    inside = points[_heights(points, centres, radii) <= 0.0]
    return cell * len(inside), cell * inside.sum(axis=0), cell * np.einsum("ij,ik->jk", inside, inside)


def _inscribed(surface: _Surface, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres and radii of balls in a body that touch its surface at more than one point, or nearly."""
    from scipy.spatial import cKDTree

    points = surface.points
    tree = cKDTree(points)
    step = _SPACING * radius
    low, high = points.min(axis=0), points.max(axis=0)
    counts = np.ceil((high - low) / step).astype(int) + 1
    axes = [0.5 * (a + b) + step * (np.arange(n) - 0.5 * (n - 1)) for a, b, n in zip(low, high, counts, strict=True)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    centres = centres[surface.is_around(centres)]
    for _ in range(_STEPS):
        distance, nearest = tree.query(centres)
        away = (centres - points[nearest]) / np.where(distance > 0.0, distance, 1.0)[:, None]
        centres = centres + step * away
        step *= _SHRINK
    radii = np.asarray(tree.query(centres)[0])
    # Some have left the body across a thin edge, and would grow outside.
    keep = (radii >= _SMALLEST * radius) & surface.is_around(centres)
    if not keep.any():
        # A body thinner than the grid: as few as it has, from the inner side of each point of the surface.
        small = 0.5 * _SMALLEST * radius
        return points - small * surface.normals, np.full(len(points), small)
    return centres[keep], radii[keep]


def _cover(points: np.ndarray, centres: np.ndarray, radii: np.ndarray, radius: float, most: int) -> np.ndarray:
    """Numbers of the balls that cover the surface, to the smallest distance to which so many balls can."""
    gaps = (_distances(points, centres) - radii).astype(np.float32)
    chosen = np.zeros(0, dtype=int)
    for tolerance in _COVERED:
        chosen, bare = _greedy(gaps <= tolerance * radius, radii, most)
        if bare <= _BARE:
            break
    return chosen


def _greedy(covers: np.ndarray, radii: np.ndarray, most: int) -> tuple[np.ndarray, float]:
    """Numbers of the balls, the one that covers most of what is bare first; and the share that stays bare.

    Parameters
    ----------
    covers : numpy.ndarray of bool, shape (points, balls)
    radii : numpy.ndarray, shape (balls,)
    most : int
    """
    bare = np.ones(len(covers), dtype=bool)
    gain = covers.sum(axis=0)
    chosen: list[int] = []
    while len(chosen) < most and bare.any():
        # Of equal ones the larger ball, and of these the first.
        best = int(np.lexsort((-radii, -gain))[0])
        if chosen and gain[best] < max(1.0, _LEAST_GAIN * len(bare)):
            break
        chosen.append(best)
        covered = bare & covers[:, best]
        gain = gain - covers[covered].sum(axis=0)
        bare &= ~covered
    return np.array(chosen), float(bare.mean())


def _growth(centres: np.ndarray, radii: np.ndarray, shape: Shape) -> float:
    """Length by which the radii grow so that the union of the spheres has the volume of the shape [m]."""
    room = 0.5 * shape.radius
    points, cell = _grid(centres, radii, _FITTED, room)
    heights = np.sort(_heights(points, centres, radii))
    # The volume within a height is the number of cells below it; between two of them by the fraction.
    at = min(shape.volume / cell - 0.5, len(heights) - 1.0)
    below = int(at)
    above = min(below + 1, len(heights) - 1)
    return float(heights[below] + (at - below) * (heights[above] - heights[below]))


def _grid(centres: np.ndarray, radii: np.ndarray, across: int, room: float) -> tuple[np.ndarray, float]:
    """A random point in each cell of a grid about spheres, shape (n, 3), and the volume of a cell.

    Points at the middle of each cell would lie like the surface of a symmetric body, and miss its volume by more.
    """
    low = (centres - radii[:, None]).min(axis=0) - room
    high = (centres + radii[:, None]).max(axis=0) + room
    side = float((high - low).max()) / across
    counts = np.ceil((high - low) / side).astype(int)
    corner = 0.5 * (low + high - side * counts)
    cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    return corner + side * (cells + np.random.Generator(np.random.PCG64(_SEED)).random(cells.shape)), side**3


def _heights(points: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """By how much the radii must grow until a sphere reaches each point: negative in the union, shape (n,)."""
    least = np.full(len(points), math.inf)
    for centre, radius in zip(centres, radii, strict=True):
        np.minimum(least, np.linalg.norm(points - centre, axis=1) - radius, out=least)
    return least


def _with_errors(clump: Clump, shape: Shape, surface: _Surface) -> Clump:
    volume, first, second = union_moments(clump.centres, clump.radii, _MEASURED)
    centroid = first / volume
    about = second / volume - np.outer(centroid, centroid)
    inertia = shape.volume * (np.trace(about) * np.eye(3) - about)
    apart = np.abs(_heights(surface.points, clump.centres, clump.radii)) / shape.radius
    return replace(
        clump,
        volume_error=volume / shape.volume - 1.0,
        centre_error=float(np.linalg.norm(centroid)) / shape.radius,
        inertia_error=float(np.abs(inertia - np.diag(shape.inertia)).max() / shape.inertia.max()),
        mean_distance=float(apart.mean()),
        max_distance=max(float(apart.max()), _farthest(clump, surface) / shape.radius),
    )


def _farthest(clump: Clump, surface: _Surface) -> float:
    """Largest distance of a point of the surface of the union from that of the shape [m]."""
    from scipy.spatial import cKDTree

    # A spiral of points that are spread evenly over a sphere.
    k = np.arange(_ON_SPHERE) + 0.5
    heights, turn = 1.0 - 2.0 * k / _ON_SPHERE, math.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - heights**2)
    unit = np.stack([across * np.cos(turn), across * np.sin(turn), heights], axis=1)
    places = (clump.centres[:, None] + clump.radii[:, None, None] * unit).reshape(-1, 3)
    places = places[_heights(places, clump.centres, clump.radii) > -1e-9 * clump.reach]
    distance, nearest = cKDTree(surface.points).query(places)
    # Near the surface from its tangent plane: the nearest of the points lies aside.
    beside = np.abs(((places - surface.points[nearest]) * surface.normals[nearest]).sum(axis=1))
    spacing = math.sqrt(surface.area / len(surface.points))
    return float(np.where(distance < 3.0 * spacing, beside, distance).max())


def extremes(clumps: Sequence[Clump], model: Model) -> tuple[float, float]:
    """Least radius of a sphere of all blocks, and greatest reach of a block [m].

    Parameters
    ----------
    clumps : sequence of Clump
        Of each shape of the model.
    model : Model
    """
    blocks = list(zip(model.shape.tolist(), model.scale.tolist(), strict=True))
    return (min(float(clumps[shape].radii.min()) * scale for shape, scale in blocks),
            max(clumps[shape].reach * scale for shape, scale in blocks))  # fmt: skip


def at_least_two(clump: Clump) -> Clump:
    """The clump with a second sphere where it has one, inside of it, which touches nothing: engines ask for two."""
    if len(clump) > 1:
        return clump
    centre, radius = clump.centres[0], float(clump.radii[0])
    # LAMMPS takes two at one place for one.
    beside = np.array([0.25 * radius, 0.0, 0.0])
    return replace(clump, centres=np.array([centre, centre + beside]), radii=np.array([radius, 0.5 * radius]))
