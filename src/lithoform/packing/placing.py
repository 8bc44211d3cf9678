"""Where stones start: let down one by one at random places, in random attitudes, without an overlap."""

from __future__ import annotations

import math

import numpy as np

from lithoform.errors import SceneError
from lithoform.packing.container import Container, millimetres
from lithoform.progress import counted

__all__ = ["insert", "random_attitudes", "require_room"]

# The ball about a stone is this much larger here, so that nothing touches at the start.
_ROOM = 1.01
# Each ball is let down at so many random places, and stays at the lowest.
_TRIES = 16
# No ball comes to lie lower than this many of the largest diameters below the top: what is deeper is not looked at.
_DEPTH = 4.0
# The bar moves every so many balls.
_TOLD = 256
# A largest stone so many times too wide for the container may be of a file in another unit.
_OTHER_UNIT = 5.0
# Stones of one kind fill no more of a container than this without being compacted; angular ones fill 0.5 to 0.6.
_FULLEST = 0.68


def insert(radii: np.ndarray, container: Container, rng: np.random.Generator, *, progress: bool = False) -> np.ndarray:
    """Places of balls of which none overlaps another, the floor or the sides.

    Random loose insertion: in their order the balls are let down vertically, each at several random places, until they
    meet the floor or another ball; the lowest place is taken. The column may reach above the rim.

    Parameters
    ----------
    radii : numpy.ndarray, shape (n,)
        Of the balls about the stones [m].
    container : Container
    rng : numpy.random.Generator
    progress : bool
        Whether to show a bar.

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
    largest = float(radii.max(initial=0.0))
    require_room(largest / _ROOM, container)
    placed, tops = np.zeros((len(radii), 3)), np.zeros(len(radii))
    columns = _Columns(container, largest, len(radii))
    top = 0.0
    with counted(len(radii), what="places", enabled=progress) as advance:
        for i, radius in enumerate(radii):
            floor = max(0.0, top - 2.0 * _DEPTH * largest)
            places = container.places(radius, _TRIES, rng)
            near, held = columns.over(places)
            at = placed[near]
            apart = ((places[:, None] - at[..., :2]) ** 2).sum(axis=2)
            reach = (radius + radii[near]) ** 2
            met = held & (tops[near] > floor) & (apart < reach)
            rest = np.where(met, at[..., 2] + np.sqrt(np.maximum(reach - apart, 0.0)), 0.0)
            heights = np.maximum(rest.max(axis=1, initial=0.0), floor + radius)
            lowest = int(heights.argmin())
            placed[i] = (*places[lowest], heights[lowest])
            tops[i] = heights[lowest] + radius
            columns.add(i, places[lowest], tops, floor)
            top = max(top, float(tops[i]))
            if i % _TOLD == _TOLD - 1:
                advance(_TOLD)
        advance(len(radii) % _TOLD)
    return placed


class _Columns:
    """Balls near the top, by the cells of a grid over x and y: each is held by the nine cells about its own.

    So all balls that one at a place can meet are in a single cell.

    Parameters
    ----------
    container : Container
    largest : float
        Radius of the largest ball [m].
    count : int
        Of balls; there are not many more cells, however wide the container is.
    """

    def __init__(self, container: Container, largest: float, count: int) -> None:
        across = np.array([container.sides[0], container.sides[-1]])
        # A little more than the largest diameter, so that rounding puts no two that meet two cells apart.
        self._size = max(2.0 * largest * (1.0 + 1e-9), math.sqrt(float(across.prod()) / max(count, 1)))
        self._corner = -0.5 * across - self._size
        rows, self._stride = (np.ceil(across / self._size).astype(int) + 3).tolist()
        self._around = (np.arange(-1, 2)[:, None] * self._stride + np.arange(-1, 2)).ravel()
        self._held = np.zeros((rows * self._stride, 16), dtype=np.int32)
        self._count = np.zeros(rows * self._stride, dtype=np.int64)

    def over(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Balls that one at each of some places may meet, shape (places, k), and which of the entries are any."""
        cells = self._cells(places)
        count = self._count[cells]
        return self._held[cells, : count.max()], np.arange(count.max()) < count[:, None]

    def add(self, ball: int, place: np.ndarray, tops: np.ndarray, floor: float) -> None:
        """Hold a ball at a place; of full cells, those whose tops are not above the floor are let go for it."""
        cells = self._cells(place) + self._around
        for cell in cells[self._count[cells] == self._held.shape[1]].tolist():
            kept = self._held[cell][tops[self._held[cell]] > floor]
            self._held[cell, : len(kept)] = kept
            self._count[cell] = len(kept)
            # Room for more than one, so that a cell is not gone through at each ball.
            if 2 * len(kept) > self._held.shape[1]:
                self._held = np.pad(self._held, ((0, 0), (0, self._held.shape[1])))
        self._held[cells, self._count[cells]] = ball
        self._count[cells] += 1

    def _cells(self, places: np.ndarray) -> np.ndarray:
        x, y = np.moveaxis(((places - self._corner) / self._size).astype(np.int64), -1, 0)
        return x * self._stride + y


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
        unit = ", or give the unit of their files with --unit" if across > _OTHER_UNIT * least else ""
        raise SceneError(
            f"expected a container at least {millimetres(across)} mm wide and high, so that the largest stone fits in "
            f"any attitude; got a {container.text()}: take a larger one, or smaller stones{unit}."
        )
    if volumes is not None and volumes.sum() > _FULLEST * container.volume:
        fits = int(np.searchsorted(np.cumsum(volumes), _FULLEST * container.volume, side="right"))
        raise SceneError(
            f"expected at most about {fits} of these stones in a {container.text()}, which they would fill to "
            f"{_FULLEST:.0%}; got {len(volumes)}, which are {volumes.sum() / container.volume:.0%} of it: take fewer, "
            "or a larger container."
        )
