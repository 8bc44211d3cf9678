"""Where stones start: let down one by one at random places, in random attitudes, without an overlap."""

from __future__ import annotations

import numpy as np

from lithoform.errors import SceneError
from lithoform.packing.container import Container

__all__ = ["insert", "random_attitudes", "require_room"]

# The ball about a stone is this much larger here, so that nothing touches at the start.
_ROOM = 1.01
# Each ball is let down at so many random places, and stays at the lowest.
_TRIES = 16
# No ball comes to lie lower than this many of the largest diameters below the top: what is deeper is not looked at.
_DEPTH = 4.0
# Stones of one kind fill no more of a container than this without being compacted; angular ones fill 0.5 to 0.6.
_FULLEST = 0.68


def insert(radii: np.ndarray, container: Container, rng: np.random.Generator) -> np.ndarray:
    """Places of balls of which none overlaps another, the floor or the sides.

    Random loose insertion: in their order the balls are let down vertically, each at several random places, until they
    meet the floor or another ball; the lowest place is taken. The column may reach above the rim.

    Parameters
    ----------
    radii : numpy.ndarray, shape (n,)
        Of the balls about the stones [m].
    container : Container
    rng : numpy.random.Generator

    Returns
    -------
    numpy.ndarray, shape (n, 3)
        Centres [m].

    Raises
    ------
    SceneError
        If the container is too narrow for a ball.
    """
    radii = _ROOM * np.asarray(radii, dtype=np.float64)
    placed = np.zeros((len(radii), 3))
    near = np.zeros(0, dtype=np.int64)
    top, largest = 0.0, float(radii.max(initial=0.0))
    require_room(largest / _ROOM, container)
    for i, radius in enumerate(radii):
        floor = max(0.0, top - 2.0 * _DEPTH * largest)
        near = near[placed[near, 2] + radii[near] > floor]
        places = container.places(radius, _TRIES, rng)
        apart = ((places[:, None] - placed[None, near, :2]) ** 2).sum(axis=2)
        reach = (radius + radii[near]) ** 2
        rest = np.where(apart < reach, placed[near, 2] + np.sqrt(np.maximum(reach - apart, 0.0)), 0.0)
        heights = np.maximum(rest.max(axis=1, initial=0.0), floor + radius)
        lowest = int(heights.argmin())
        placed[i] = (*places[lowest], heights[lowest])
        near = np.append(near, i)
        top = max(top, float(heights[lowest]) + float(radius))
    return placed


def random_attitudes(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit quaternions (x, y, z, w) even over all rotations, shape (count, 4)."""
    q = rng.standard_normal((count, 4))
    return q / np.sqrt((q**2).sum(axis=1, keepdims=True))


def require_room(radius: float, container: Container, volumes: np.ndarray | None = None) -> None:
    """Refuse a container that cannot hold the stones.

    Parameters
    ----------
    radius : float
        Of the ball about the largest stone [m].
    container : Container
    volumes : numpy.ndarray, shape (n,), optional
        Of the stones, in the order in which they are let down [m^3].

    Raises
    ------
    SceneError
        If the largest stone does not fit in any attitude, or the stones fill more than a packing can.
    """
    across, least = 2.0 * _ROOM * radius, min(*container.sides, container.height)
    if across > least:
        raise SceneError(
            f"expected a container at least {1e3 * across:.4g} mm wide and high, so that the largest stone fits in any "
            f"attitude; got a {container.text()}: take a larger one, or smaller stones."
        )
    if volumes is not None and volumes.sum() > _FULLEST * container.volume:
        fits = int(np.searchsorted(np.cumsum(volumes), _FULLEST * container.volume, side="right"))
        raise SceneError(
            f"expected at most about {fits} of these stones in a {container.text()}, which they would fill to "
            f"{_FULLEST:.0%}; got {len(volumes)}, which are {volumes.sum() / container.volume:.0%} of it: take fewer, "
            "or a larger container."
        )
