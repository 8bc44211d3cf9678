"""Walls as triangles, for engines that know planes and cylinders along an axis of the box alone."""

from __future__ import annotations

import math

import numpy as np

from lithoform.dem import Cylinder, Plane

__all__ = ["axis_of", "triangles"]

# A direction is along an axis if its largest component is this near to one.
_ALONG = 1e-12


def axis_of(wall: Plane | Cylinder) -> int | None:
    """Number of the axis along which the normal or the axis of a wall is; None where it is inclined."""
    direction = np.abs(wall.direction)
    axis = int(direction.argmax())
    return axis if direction[axis] > 1.0 - _ALONG else None


def triangles(wall: Plane | Cylinder, middle: np.ndarray, room: float, sides: int) -> np.ndarray:
    """Corners of triangles that cover a wall near a place, shape (k, 3, 3).

    A prism stands about a cylinder, not in it, so that no block begins behind a wall; it is wider at its edges by
    1 / cos(pi / sides) - 1 of the radius.

    Parameters
    ----------
    wall : Plane or Cylinder
    middle : numpy.ndarray, shape (3,)
        [m].
    room : float
        How far the triangles reach from there [m].
    sides : int
        Of the prism.
    """
    u, v = _across(np.array(wall.direction))
    point = np.array(wall.point)
    if isinstance(wall, Plane):
        normal = np.array(wall.normal)
        foot = middle - ((middle - point) @ normal) * normal
        a, b, c, d = (foot + room * (s * u + t * v) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
        return np.array([[a, b, c], [a, c, d]])
    axis = np.array(wall.axis)
    foot = point + ((middle - point) @ axis) * axis
    angles = 2.0 * math.pi * np.arange(sides) / sides
    ring = foot + wall.radius / math.cos(math.pi / sides) * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v))
    ahead = np.roll(ring, -1, axis=0)
    low, high = ring - room * axis, ring + room * axis
    low_ahead, high_ahead = ahead - room * axis, ahead + room * axis
    return np.concatenate([np.stack([low, low_ahead, high_ahead], axis=1), np.stack([low, high_ahead, high], axis=1)])


def _across(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that are at right angles to a unit vector and to each other."""
    u = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    u /= np.linalg.norm(u)
    return u, np.cross(direction, u)
