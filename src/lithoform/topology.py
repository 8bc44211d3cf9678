"""Closed triangulations of the unit sphere: octahedral (8 n^2 triangles) and icosahedral (20 n^2).

Both subdivide each face of a Platonic solid n times.  Vertices are found by their integer barycentric
weights, so that no vertex is made twice and there is no seam.  The octahedron's components p are mapped by
sin(pi p / 2) before normalising, which evens the triangles out: largest to smallest area 1.74 instead of 4.99.
A direction of the octahedral sphere of n is bit for bit a direction of that of 2n, 3n, ...
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lithoform.mesh import Mesh

__all__ = ["sphere"]

_GOLDEN_RATIO = (1.0 + 5.0**0.5) / 2.0

_OCTAHEDRON = (
    np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64),
    np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]),
)
_ICOSAHEDRON = (
    np.array(
        [[s, t * _GOLDEN_RATIO, 0.0] for s in (-1, 1) for t in (-1, 1)]
        + [[0.0, s, t * _GOLDEN_RATIO] for s in (-1, 1) for t in (-1, 1)]
        + [[t * _GOLDEN_RATIO, 0.0, s] for s in (-1, 1) for t in (-1, 1)]
    ),
    # Filled below from the geometry: the twenty triples of vertices at mutual distance 2.
    np.empty((0, 3), dtype=np.int64),
)


def _icosahedron_faces(vertices: np.ndarray) -> np.ndarray:
    near = np.abs(np.linalg.norm(vertices[:, None] - vertices[None], axis=2) - 2.0) < 1e-9
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    outward = [np.linalg.det(vertices[list(f)]) > 0 for f in faces]
    return np.array([f if keep else (f[0], f[2], f[1]) for f, keep in zip(faces, outward, strict=True)])


@lru_cache(maxsize=16)
def sphere(kind: str, n: int) -> Mesh:
    """Unit sphere of a topology.

    Parameters
    ----------
    kind : {"octahedral", "icosahedral"}
    n : int
        Subdivisions of an edge, at least 1.

    Returns
    -------
    Mesh
        Vertices of unit length, shape (4 n^2 + 2, 3) or (10 n^2 + 2, 3); faces counter-clockwise seen from
        outside.  Cached: the same object is returned for the same arguments.

    Raises
    ------
    ValueError
        If the kind is unknown or n is not positive.
    """
    if n < 1 or kind not in ("octahedral", "icosahedral"):
        raise ValueError(f"expected a kind of octahedral or icosahedral and n >= 1, got {kind!r} and {n}.")
    corners, base_faces = _OCTAHEDRON if kind == "octahedral" else _ICOSAHEDRON
    if kind == "icosahedral":
        base_faces = _icosahedron_faces(corners)
    weights, faces = _subdivide(base_faces, len(corners), n)
    points = (weights @ corners) / n
    if kind == "octahedral":
        points = np.sin(0.5 * np.pi * points)
    points /= np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2 + points[:, 2] ** 2)[:, None]
    return Mesh(points, faces)


def _subdivide(base_faces: np.ndarray, corners: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Integer barycentric weights (vertices, corners) and faces (m, 3) of n-fold subdivided base faces."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    inside = i + j <= n
    index = np.full((n + 1, n + 1), -1)
    index.ravel()[inside] = np.arange(inside.sum())
    # A grid point (i, j) weighs the three corners of its base face by n - i - j, i and j.
    i, j = i[inside], j[inside]
    u, v = i[i + j < n], j[i + j < n]
    upright = np.stack([index[u, v], index[u + 1, v], index[u, v + 1]], axis=1)
    u, v = i[i + j < n - 1], j[i + j < n - 1]
    hanging = np.stack([index[u + 1, v], index[u + 1, v + 1], index[u, v + 1]], axis=1)
    local = np.concatenate([upright, hanging])

    grid = np.zeros((len(base_faces), len(i), corners), dtype=np.int32)
    rows = np.arange(len(base_faces))
    grid[rows, :, base_faces[:, 0]] = n - i - j
    grid[rows, :, base_faces[:, 1]] = i
    grid[rows, :, base_faces[:, 2]] = j
    grid = grid.reshape(-1, corners)
    _, first, inverse = np.unique(_encode(grid, n), return_index=True, return_inverse=True)
    offsets = (np.arange(len(base_faces)) * len(i))[:, None, None]
    return grid[first].astype(np.float64), inverse[(local[None] + offsets).reshape(-1, 3)]


def _encode(weights: np.ndarray, n: int) -> np.ndarray:
    """One integer for each row of weights: at most three are not 0, each listed as (corner, weight)."""
    order = np.argsort(-weights, axis=1, kind="stable")[:, :3]
    values = np.take_along_axis(weights, order, axis=1)
    # Equal weights must come out in the same order from every face, and a zero weight names no corner.
    slot = np.where(values > 0, order * (n + 1) + values, 0).astype(np.int64)
    slot.sort(axis=1)
    base = np.int64(weights.shape[1] * (n + 1) + n + 1)
    return (slot[:, 0] * base + slot[:, 1]) * base + slot[:, 2]
