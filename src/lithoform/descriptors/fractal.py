"""Fractal dimension of a body's surface by the roughness-length method, D = 3 - H.

The relief of a stone is self-affine, not self-similar: the area of a surface of Hurst exponent H and small slopes
tends to that of its base as the yardstick grows, so that neither yardsticks nor boxes show D at the scales that a
mesh has (Mandelbrot 1985).  What grows by a power law at every scale is the roughness of windows: the root mean
square height about a smooth local surface, sigma(l) ~ l^H in windows of radius l (Malinverno 1990).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.errors import MeshError
from lithoform.mesh import Mesh

__all__ = ["FractalDimension", "fractal_dimension"]

_WINDOWS: Final = 500
_SCALES: Final = 6

# Radii of the windows: from so many edges, where a fit of 6 numbers has some 60 vertices, to this part of the radius
# of the sphere of equal area, where windows begin to see the shape of the body.
_EDGES_IN_A_WINDOW: Final = 4.0
_LARGEST_WINDOW: Final = 0.4

# A face with a side longer than the smallest window is cut into parts of this fraction of the window, if that takes
# no more than so many a side.
_PART_OF_A_WINDOW: Final = 0.25
_MOST_CUTS: Final = 64

# Parts of cut faces in all, above which all are cut less: the long slivers of a prism of 800 faces would make 3e6.
_MOST_PARTS: Final = 50_000

# Faces turned further than this cosine away from the window's centre belong to another side of the body.
_OTHER_SIDE: Final = -0.3

# Heights below this part of the window are rounding.
_ROUNDING: Final = 1e-12


@dataclass(frozen=True, eq=False)
class FractalDimension:
    """Fractal dimension of a surface and what it was read from.

    Attributes
    ----------
    value : float
        D = 3 - H with H brought into 0 to 1: 2 for a surface that is smooth, smooth in pieces, or rough with H >= 1.
    hurst : float
        H as fitted, before it is cut at 0 and 1: about 1.5 for sharp edges between flat faces, above 2 for smooth
        bodies; below 0 for plates thinner than the windows, where it means nothing.
    scales : numpy.ndarray, shape (s,)
        Radii l of the windows [unit of the mesh], rising; the range of scales that the value holds for.
    roughness : numpy.ndarray, shape (s,)
        Root mean square height in windows of these radii [unit of the mesh].
    misfit : float
        Root mean square of ln(roughness) about the fitted line: 0.1 is 10 %.  Large where there is no single power law.
    edge : float
        Side of the equilateral triangle of the mean area of the mesh's triangles [unit of the mesh].
    resolved : bool
        Whether the mesh is fine enough for windows that differ by a factor of 2 at least; otherwise they do so all
        the same, and the smallest hold few vertices.
    """

    value: float
    hurst: float
    scales: np.ndarray
    roughness: np.ndarray
    misfit: float
    edge: float
    resolved: bool


def fractal_dimension(mesh: Mesh) -> FractalDimension:
    """Fractal dimension of the surface of a body, between 2 and 3.

    In windows of radius l about 500 vertices, spread evenly over the surface, the heights of the vertices along the
    mean normal are fitted by a quadric in the plane across it, which takes up the slope and curvature of the body;
    each vertex weighs as much as the area it stands for, and vertices on another side of the body do not count.  The
    residuals have the variance sigma^2, averaged over the windows, and H is the slope of ln(sigma) over ln(l).  The
    flat faces between the vertices are no part of it, or their sag would pass for relief; faces longer than the
    smallest window, as a box has them, are cut and do count.

    Parameters
    ----------
    mesh : Mesh
        Closed or open, any unit; the value does not depend on place, pose and unit.

    Returns
    -------
    FractalDimension

    Raises
    ------
    MeshError
        If the mesh has no area.

    Notes
    -----
    Windows reach from 4 edges to 0.4 of the radius of the sphere of equal area: a factor 2.6 at 20,000 triangles and
    4.2 at 51,200.  Synthetic relief of H = 0.2, 0.4, 0.6, 0.8 is found as 0.30, 0.44, 0.62, 0.82 at 20,000 triangles,
    as 0.31, 0.44, 0.62, 0.81 at 51,200, and as 0.29, 0.42, 0.58, 0.75 at 5,000, where `resolved` is False.  Relief
    means heights above a smooth surface: where slopes are steep, or the body is thinner than the largest window (an
    ellipsoid of 1 : 1 : 0.05), the value means little.  The windows follow the numbering of the vertices and faces:
    another numbering takes other windows.

    Stones of the default recipes are at 2 exactly, with H of 1.2 to 1.6: their octaves fall off with
    H = -ln(gain) / ln(lacunarity) = 1.7, and the ridges between them are edges.

    References
    ----------
    Mandelbrot, B. B. (1982). The Fractal Geometry of Nature. Freeman.
    Mandelbrot, B. B. (1985). Self-affine fractals and fractal dimension. Phys. Scr. 32, 257-260.
    Malinverno, A. (1990). A simple method to estimate the fractal dimension of a self-affine series. Geophys. Res.
    Lett. 17, 1953-1956.
    """
    vectors = mesh.area_vectors
    areas = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
    total = float(areas.sum())
    if not total > 0.0:
        raise MeshError("the mesh has no area and so no fractal dimension; check its vertices.")
    edge = float(np.sqrt(4.0 * total / (np.sqrt(3.0) * len(areas))))
    largest = _LARGEST_WINDOW * float(np.sqrt(total / (4.0 * np.pi)))
    smallest = _EDGES_IN_A_WINDOW * edge
    resolved = 2.0 * smallest <= largest
    if not resolved:
        smallest = 0.5 * largest
    scales = np.geomspace(smallest, largest, _SCALES)
    roughness = _window_roughness(*_weighed_points(mesh, areas, smallest), scales)
    hurst, misfit = _fitted_exponent(scales, roughness)
    for array in (scales, roughness):
        array.flags.writeable = False
    return FractalDimension(3.0 - min(max(hurst, 0.0), 1.0), hurst, scales, roughness, misfit, edge, resolved)


def _weighed_points(mesh: Mesh, areas: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) that stand for the surface, the area vector (n, 3) and the area (n,) of what each stands for.

    They are the vertices, since the flat faces between them are not the surface that was sampled; only faces with a
    side above `longest` are cut into k^2 parts, smaller than that, and stand for themselves.
    """
    corners = [mesh.vertices[mesh.faces[:, i]] for i in range(3)]
    sides = [((corners[i] - corners[i - 1]) ** 2).sum(axis=1) for i in range(3)]
    side = np.sqrt(np.max(sides, axis=0))
    cuts = np.ceil(side / (_PART_OF_A_WINDOW * longest)).clip(1, _MOST_CUTS).astype(np.int64)
    whole = side <= longest
    parts_in_all = int((cuts[~whole] ** 2).sum())
    if parts_in_all > _MOST_PARTS:
        cuts = np.floor(cuts * np.sqrt(_MOST_PARTS / parts_in_all)).clip(1).astype(np.int64)
    owner, share = mesh.faces[whole].ravel(), np.repeat(areas[whole] / 3.0, 3)
    count = len(mesh.vertices)
    vectors = [np.bincount(owner, np.repeat(row[whole] / 3.0, 3), count) for row in mesh.area_vectors.T]
    weight = np.bincount(owner, share, count)
    used = weight > 0.0
    parts = [(mesh.vertices[used], np.stack(vectors, axis=1)[used], weight[used])]
    for k in np.unique(cuts[~whole]):
        faces = np.flatnonzero((cuts == k) & ~whole)
        u, v = _centres_of_parts(int(k))
        a, b, c = (corner[faces][:, None] for corner in corners)
        points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        repeated = np.repeat(faces, len(u))
        parts.append((points.reshape(-1, 3), mesh.area_vectors[repeated] / k**2, areas[repeated] / k**2))
    points, vectors, weights = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return points, vectors, weights


def _centres_of_parts(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Barycentric coordinates of the centres of the k^2 equal parts of a triangle, each of shape (k^2,)."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))
    upright, hanging = i + j < k, i + j < k - 1
    u = np.concatenate([i[upright] + 1.0 / 3.0, i[hanging] + 2.0 / 3.0]) / k
    v = np.concatenate([j[upright] + 1.0 / 3.0, j[hanging] + 2.0 / 3.0]) / k
    return u, v


def _window_roughness(points: np.ndarray, vectors: np.ndarray, weights: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Root mean square residual height in windows of each radius, shape (s,)."""
    from scipy.spatial import cKDTree

    ends = np.cumsum(weights)
    centres = np.searchsorted(ends, (np.arange(_WINDOWS) + 0.5) / _WINDOWS * ends[-1]).clip(max=len(weights) - 1)
    pairs = cKDTree(points[centres]).sparse_distance_matrix(cKDTree(points), scales[-1], output_type="ndarray")
    window, point, distance = pairs["i"], pairs["j"], pairs["v"]
    normals = _unit(np.ascontiguousarray(vectors.T))
    facing = _dot(normals[:, centres[window]], normals[:, point]) > _OTHER_SIDE
    window, point, distance = window[facing], point[facing], distance[facing]
    offset = (points.T[:, point] - points.T[:, centres[window]]) / scales[-1]
    roughness = np.empty(len(scales))
    for k in range(len(scales) - 1, -1, -1):
        near = distance <= scales[k]
        window, point, distance, offset = window[near], point[near], distance[near], offset[:, near]
        variance = _residual_variance(window, offset * (scales[-1] / scales[k]), vectors.T[:, point], weights[point])
        roughness[k] = scales[k] * np.sqrt(variance)
    return roughness


def _residual_variance(window: np.ndarray, offset: np.ndarray, vectors: np.ndarray, weights: np.ndarray) -> float:
    """Mean over the windows of the variance about the best quadric, in units of the window's radius squared.

    `window` and `weights` have shape (n,), `offset` and `vectors` (3, n): where each pair's point lies, seen from its
    window's centre, and the area vector it stands for.
    """
    count = np.bincount(window, minlength=_WINDOWS)
    total = np.bincount(window, weights, _WINDOWS)
    axis = _unit(np.stack([np.bincount(window, row, _WINDOWS) for row in vectors]))
    helper = np.where(np.abs(axis[0]) < 0.6, np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [1.0], [0.0]]))
    across = _unit(np.cross(axis, helper, axis=0))
    along = np.cross(axis, across, axis=0)
    x, y, height = (_dot(offset, direction[:, window]) for direction in (across, along, axis))
    weight = weights / np.where(total > 0.0, total, 1.0)[window]
    terms = [np.ones(len(x)), x, y, x * x, x * y, y * y]
    size = len(terms)
    matrix, right = np.empty((_WINDOWS, size, size)), np.empty((_WINDOWS, size))
    for i in range(size):
        weighted = weight * terms[i]
        right[:, i] = np.bincount(window, weighted * height, _WINDOWS)
        for j in range(i, size):
            matrix[:, i, j] = matrix[:, j, i] = np.bincount(window, weighted * terms[j], _WINDOWS)
    # Keeps windows without points, or with all of them on a line, solvable.
    matrix[:, range(size), range(size)] += _ROUNDING
    solution = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    residual = height - sum(solution[window, i] * terms[i] for i in range(size))
    enough = count >= 3 * size
    if not enough.any():
        return _ROUNDING**2
    freedom = count[enough] / (count[enough] - size)
    variance = np.bincount(window, weight * residual * residual, _WINDOWS)[enough] * freedom
    return max(float(variance.mean()), _ROUNDING**2)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Columns of unit length, shape (3, n); a column of 0 stays."""
    length = np.sqrt(_dot(vectors, vectors))
    return vectors / np.where(length > 0.0, length, 1.0)


def _fitted_exponent(scales: np.ndarray, roughness: np.ndarray) -> tuple[float, float]:
    """Slope of ln(roughness) over ln(l) by least squares, and the root mean square about the line."""
    x, y = np.log(scales), np.log(roughness)
    x, y = x - x.mean(), y - y.mean()
    slope = float((x * y).sum() / (x * x).sum())
    return slope, float(np.sqrt(((y - slope * x) ** 2).mean()))
