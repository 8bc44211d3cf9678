"""The simple solids that a stone is compared with: its inscribed sphere, its boxes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["Box", "Sphere"]


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball.

    Attributes
    ----------
    center : numpy.ndarray, shape (3,)
        In the frame and unit u of the mesh.
    radius : float
        [u]
    """

    center: np.ndarray
    radius: float


@dataclass(frozen=True, eq=False)
class Box:
    """A rectangular box of any orientation.

    Attributes
    ----------
    center : numpy.ndarray, shape (3,)
        In the frame and unit u of the mesh.
    axes : numpy.ndarray, shape (3, 3)
        Unit vectors as columns, right-handed.
    extents : numpy.ndarray, shape (3,)
        Full side lengths along the columns of `axes` [u], from the longest to the shortest.
    """

    center: np.ndarray
    axes: np.ndarray
    extents: np.ndarray

    @property
    def volume(self) -> float:
        """Product of the three extents [u^3]."""
        return math.prod(self.extents.tolist())

    @property
    def corners(self) -> np.ndarray:
        """The eight corners, shape (8, 3) [u], the last axis running fastest."""
        signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij"), axis=-1).reshape(8, 3)
        return self.center + (signs * self.extents) @ self.axes.T
