"""The room that walls enclose, and the volume of blocks below a plane, cut exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from lithoform.dem.model import Model
from lithoform.dem.state import State, rotate_back
from lithoform.dem.walls import Cylinder, Plane
from lithoform.errors import SceneError
from lithoform.mesh import Mesh

__all__ = ["Container", "extents", "solid_below"]

_W = TypeVar("_W", Cylinder, Plane)

# Opposite planes are parallel when their normals differ by less than this.
_PARALLEL = 1e-9


@dataclass(frozen=True, kw_only=True)
class Container:
    """What walls of a model enclose, where they are in a state.

    Attributes
    ----------
    sides : int or tuple of tuple of int
        Number of a cylinder among the walls, or two pairs of opposite planes.
    ends : tuple of int or None
        Numbers of the two planes at the ends; they may be tilted.
    """

    sides: int | tuple[tuple[int, int], tuple[int, int]]
    ends: tuple[int, int] | None = None

    def axis(self, model: Model, state: State) -> np.ndarray:
        """Unit vector along the sides, against gravity where that can be said, shape (3,).

        Raises
        ------
        SceneError
            If the model has no such walls.
        """
        if isinstance(self.sides, int):
            self._wall(model, self.sides, Cylinder)
            axis = state.wall_direction[self.sides].copy()
        else:
            first, second = (self._across(model, state, pair)[0] for pair in self.sides)
            axis = np.cross(first, second)
            if not np.linalg.norm(axis) > _PARALLEL:
                raise SceneError("expected two pairs of planes for the sides of a container, but all are parallel.")
            axis /= np.linalg.norm(axis)
        return -axis if (axis * np.asarray(model.gravity)).sum() > 0.0 else axis

    def area(self, model: Model, state: State) -> float:
        """Area of the cross-section at right angles to the axis [m^2].

        Raises
        ------
        SceneError
            If the model has no such walls, or opposite planes are not parallel.
        """
        if isinstance(self.sides, int):
            return math.pi * self._wall(model, self.sides, Cylinder).radius ** 2
        (a, width, _), (b, depth, _) = (self._across(model, state, pair) for pair in self.sides)
        return width * depth / float(np.linalg.norm(np.cross(a, b)))

    def volume(self, model: Model, state: State) -> float:
        """Volume between the ends [m^3].

        The height is that at the centre of the cross-section: exact for tilted ends too, as long as they do not meet
        inside the sides.

        Raises
        ------
        SceneError
            If no ends were named, the model has no such walls, or opposite planes are not parallel.
        """
        if self.ends is None:
            raise SceneError("expected a container with two ends for its volume: name the planes as ends=(low, high), "
                             "or give two heights.")  # fmt: skip
        axis, centre = self.axis(model, state), self._centre(model, state)
        heights = []
        for end in self.ends:
            self._wall(model, end, Plane)
            normal = state.wall_direction[end]
            across = float((normal * axis).sum())
            if abs(across) < _PARALLEL:
                raise SceneError(f"expected ends across the container, but wall {end} is parallel to its sides.")
            heights.append(float((normal * (state.wall_point[end] - centre)).sum()) / across)
        return self.area(model, state) * abs(heights[1] - heights[0])

    def _centre(self, model: Model, state: State) -> np.ndarray:
        """A point of the line through the centres of the cross-sections."""
        if isinstance(self.sides, int):
            return state.wall_point[self.sides]
        (a, _, at_a), (b, _, at_b) = (self._across(model, state, pair) for pair in self.sides)
        return np.linalg.solve(np.stack([a, b, np.cross(a, b)]), np.array([at_a, at_b, 0.0]))

    def _across(self, model: Model, state: State, pair: tuple[int, int]) -> tuple[np.ndarray, float, float]:
        """Normal of two opposite planes, their distance, and the coordinate half-way [m]."""
        for wall in pair:
            self._wall(model, wall, Plane)
        first, second = state.wall_direction[list(pair)]
        if np.abs(first + second).max() > _PARALLEL:
            raise SceneError(f"expected walls {pair[0]} and {pair[1]} to be parallel and to face each other.")
        low, high = ((state.wall_point[wall] * first).sum() for wall in pair)
        return first, float(high - low), float(0.5 * (low + high))

    @staticmethod
    def _wall(model: Model, wall: int, kind: type[_W]) -> _W:
        found = model.walls[wall] if 0 <= wall < len(model.walls) else None
        if not isinstance(found, kind):
            got = "none" if found is None else f"a {type(found).__name__.lower()}"
            raise SceneError(f"expected wall {wall} of a container to be a {kind.__name__.lower()} of the model, which "
                             f"has {len(model.walls)} walls; got {got}.")  # fmt: skip
        return found


def extents(model: Model, state: State, axis: np.ndarray) -> np.ndarray:
    """Lowest and highest point of each block's true mesh along an axis [m], shape (n, 2).

    Parameters
    ----------
    model : Model
    state : State
    axis : numpy.ndarray, shape (3,)
        Unit vector.
    """
    heights = _along(state.position, axis)
    local = rotate_back(state.orientation, np.tile(axis, (model.count, 1)))
    found = np.empty((model.count, 2))
    for i, shape in enumerate(model.shape.tolist()):
        mesh = model.shapes[shape].mesh
        if mesh is None:
            found[i] = -model.radius[i], model.radius[i]
        else:
            along = _along(mesh.vertices[mesh.connectivity.used_vertices], local[i]) * model.scale[i]
            found[i] = along.min(), along.max()
    return found + heights[:, None]


def solid_below(model: Model, state: State, height: float, axis: np.ndarray) -> np.ndarray:
    """Volume of each block's true mesh below a plane [m^3], shape (n,).

    Exact: by the divergence theorem with the field min(h, 0) axis, h the height over the plane, whose divergence is 1
    below the plane and 0 above it, so that the cut needs no lid.

    Parameters
    ----------
    model : Model
    state : State
    height : float
        Of the plane along the axis, from the origin of the world [m].
    axis : numpy.ndarray, shape (3,)
        Unit vector, the normal of the plane.
    """
    over = _along(state.position, axis) - height
    reach = np.array([
        shape.radius if shape.mesh is None else np.sqrt((shape.mesh.vertices**2).sum(axis=1).max())
        for shape in model.shapes
    ])[model.shape] * model.scale  # fmt: skip
    volume = np.where(over < 0.0, model.volume, 0.0)
    cut = np.flatnonzero(np.abs(over) < reach)
    local = rotate_back(state.orientation[cut], np.tile(axis, (len(cut), 1)))
    for i, direction in zip(cut.tolist(), local, strict=True):
        mesh = model.shapes[model.shape[i]].mesh
        if mesh is None:
            wet = min(max(model.radius[i] - over[i], 0.0), 2.0 * model.radius[i])
            volume[i] = math.pi * wet**2 * (3.0 * model.radius[i] - wet) / 3.0
        else:
            volume[i] = _below(mesh, direction, over[i] / model.scale[i]) * model.scale[i] ** 3
    return volume


def _below(mesh: Mesh, direction: np.ndarray, over: float) -> float:
    """Volume of a closed mesh where direction . x + over < 0."""
    height = _along(mesh.vertices, direction) + over
    corners = np.sort(height[mesh.faces], axis=1)
    wet = (corners < 0.0).sum(axis=1)
    # Mean over each triangle of min(h, 0), h linear, with the corners' heights a <= b <= c.
    a, b, c = corners.T
    mean = np.where(wet >= 2, (a + b + c) / 3.0, 0.0)
    one, two = wet == 1, wet == 2
    mean[one] = a[one] ** 3 / (3.0 * (b[one] - a[one]) * (c[one] - a[one]))
    mean[two] -= c[two] ** 3 / (3.0 * (c[two] - a[two]) * (c[two] - b[two]))
    return float((_along(mesh.area_vectors, direction) * mean).sum())


def _along(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Coordinates along an axis; by sums, not by a matrix product, whose last bits depend on the library's threads."""
    return points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]
