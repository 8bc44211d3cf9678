"""Directions in space: even samples of them, coordinates along them, and which of the two senses is meant."""

from __future__ import annotations

import math

import numpy as np

__all__ = ["dot", "half_sphere", "pointed"]


def half_sphere(count: int) -> np.ndarray:
    """Directions spread evenly over the half sphere z > 0 on a golden spiral, shape (count, 3)."""
    number = np.arange(count) + 0.5
    z = 1.0 - number / count
    angle = number * (math.pi * (3.0 - math.sqrt(5.0)))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def dot(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Coordinates of points along an axis; no matrix product, which may round differently with threads."""
    return points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]


def pointed(axis: np.ndarray) -> np.ndarray:
    """An axis in the sense in which its component of largest magnitude is positive."""
    return axis if axis[np.argmax(np.abs(axis))] > 0.0 else -axis
