"""What the tests of pictures share: a stone of smooth waves, and whether anything is drawn."""

from __future__ import annotations

import numpy as np

from lithoform import Mesh, sphere

WHITE = 255


def stone(bumps: float = 0.1, scale: float = 1.0, n: int = 12) -> Mesh:
    """An ellipsoid of 2 : 1.5 : 1 with waves on it."""
    ball = sphere("octahedral", n)
    x, y, z = ball.vertices.T
    radius = 1.0 + bumps * np.sin(9.0 * x) * np.cos(7.0 * y + 5.0 * z)
    return ball.with_vertices(scale * radius[:, None] * ball.vertices * (1.0, 0.75, 0.5))


def is_drawn(picture: np.ndarray) -> np.ndarray:
    """Pixels that are not paper."""
    return (picture < WHITE - 8).any(axis=2)
