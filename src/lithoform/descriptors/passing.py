"""What openings a body passes: the square hole of a sieve, the slot of a bar sieve, turned as it likes.

A body that falls through a hole without turning on the way needs the hole to hold its projection along the
way.  The least square that does so in any orientation is the least, over pairs of perpendicular directions,
of the larger of the two extents.  It depends on the convex hull alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.descriptors.directions import dot, half_sphere, pointed
from lithoform.descriptors.hull import Hull
from lithoform.descriptors.outlines import planar_poses
from lithoform.descriptors.poses import SQUARE_SIDE, descend, distinct_best
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["SievePose", "least_width", "sieve_pose", "sieve_size", "slot_width"]

wp.set_module_options(MODULE_OPTIONS)

_DIRECTIONS: Final = 250
"""Ways through the hole, over half the sphere (8 degrees apart), that are tried first."""

_FACETS: Final = 150
"""Of the facets, those of the largest area whose normals are tried as well."""

_STARTS: Final = 24
"""Poses that are followed down to a local minimum; 12 were enough for 40 stones."""

_ARC_SLACK: Final = wp.constant(wp.float64(1e-12))
"""Rounding of a cosine between unit normals, with room."""

_PARALLEL: Final = wp.constant(wp.float64(1e-9))
"""Sine of the angle below which two edges count as parallel."""


@dataclass(frozen=True, eq=False)
class SievePose:
    """How a body passes the smallest square opening.

    Attributes
    ----------
    size : float
        Side of the opening [u].
    axes : numpy.ndarray, shape (3, 3)
        Unit vectors as columns in the frame of the body, right-handed: the sides of the opening, the way through.
    extents : numpy.ndarray, shape (3,)
        Of the body along the axes [u]; the larger of the first two is the size.
    """

    size: float
    axes: np.ndarray
    extents: np.ndarray


@wp.kernel(enable_backward=False)
def _support_kernel(
    points: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    chords: wp.array(dtype=wp.vec3d),
):
    """From the lowest to the highest vertex along each normal."""
    k = wp.tid()
    n = normals[k]
    low = wp.dot(n, points[0])
    high = low
    bottom = wp.int32(0)
    top = wp.int32(0)
    for i in range(1, points.shape[0]):
        x = wp.dot(n, points[i])
        if x < low:
            low = x
            bottom = i
        if x > high:
            high = x
            top = i
    chords[k] = points[top] - points[bottom]


@wp.kernel(enable_backward=False)
def _opposite_edges_kernel(
    points: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    edges: wp.array(dtype=wp.vec4i),
    first: wp.array(dtype=wp.int32),
    last: wp.array(dtype=wp.int32),
    widths: wp.array(dtype=wp.float64),
    directions: wp.array(dtype=wp.vec3d),
):
    """Least width among the pairs of an edge and an opposite one whose planes of support are parallel."""
    k = wp.tid()
    e = edges[k]
    p = points[e[0]]
    along = points[e[1]] - p
    n0 = normals[e[2]]
    n1 = normals[e[3]]
    best = wp.float64(1.0e300)
    direction = wp.vec3d()
    for i in range(first[k], last[k]):
        f = edges[i]
        q = points[f[0]]
        other = points[f[1]] - q
        # On the sphere of normals an edge is an arc between its faces; the two arcs cross after a reflection.
        if wp.dot(n0, other) * wp.dot(n1, other) < wp.float64(0.0):
            m0 = normals[f[2]]
            m1 = normals[f[3]]
            if wp.dot(m0, along) * wp.dot(m1, along) < wp.float64(0.0):
                u = wp.cross(along, other)
                size = wp.length(u)
                # The cross product of parallel edges is noise, and they need no trial: between them the width is least
                # at an end.  Edges inside a flat facet have arcs of no length: u must lie on both arcs.
                if size > _PARALLEL * wp.length(along) * wp.length(other):
                    u = u / size
                    if wp.dot(u, n0 + n1) < wp.float64(0.0):
                        u = -u
                    beyond_e = wp.dot(n0, n1) - wp.min(wp.dot(u, n0), wp.dot(u, n1))
                    beyond_f = wp.dot(m0, m1) + wp.max(wp.dot(u, m0), wp.dot(u, m1))
                    width = wp.dot(u, p - q)
                    if wp.max(beyond_e, beyond_f) <= _ARC_SLACK and width < best:
                        best = width
                        direction = u
    widths[k] = best
    directions[k] = direction


def sieve_pose(hull: Hull) -> SievePose:
    """The pose in which a body passes the smallest square opening.

    Parameters
    ----------
    hull : Hull

    Returns
    -------
    SievePose
        A local minimum to rounding, and in every case tested the global one.

    Notes
    -----
    size = min over orthonormal (u, v) of max(w(u), w(v)), w the extent of the body.  For a box a >= b >= c it is
    min(b, (b + c) / sqrt(2)); for an ellipsoid of semi-axes a >= b >= c, sqrt(2 (b^2 + c^2)).
    """
    poses, values = planar_poses(
        hull, np.concatenate([half_sphere(_DIRECTIONS), hull.largest_normals(_FACETS)]), SQUARE_SIDE
    )
    poses, values = descend(hull, poses[distinct_best(poses, values, _STARTS, SQUARE_SIDE)], SQUARE_SIDE)
    pose = poses[np.argmin(values)]
    points, exponent = hull.of_unit_size
    extents = np.ldexp(np.array([float(np.ptp(dot(points, e))) for e in pose]), exponent)
    return SievePose(float(extents[:2].max()), np.ascontiguousarray(pose.T), extents)


def sieve_size(hull: Hull) -> float:
    """Side of the smallest square opening that a body passes in some orientation [u]; see `sieve_pose`."""
    return sieve_pose(hull).size


def slot_width(hull: Hull) -> float:
    """Width of the narrowest long slot (bar sieve, EN 933-3) that a body passes in some orientation [u]."""
    return least_width(hull)[0]


def least_width(hull: Hull) -> tuple[float, np.ndarray]:
    """Least distance of two parallel planes that hold a body between them, and their unit normal.

    Parameters
    ----------
    hull : Hull

    Returns
    -------
    width : float
        [u]
    direction : numpy.ndarray, shape (3,)

    Notes
    -----
    The planes touch a face and a vertex, or two edges (Houle and Toussaint 1988).  All faces are tried.  Of the
    edges, those whose normals cannot have a width below that of the best face are left out: for any chord d of the
    body w(u) >= d . u, which on an arc between two normals is least at an end.

    References
    ----------
    Houle, M. E., Toussaint, G. T. (1988). Computing the width of a set. IEEE Trans. PAMI 10(5), 761-765.
    """
    load(_support_kernel.module, "cpu")
    points, exponent = hull.of_unit_size
    normals, place = np.unique(hull.normals, axis=0, return_inverse=True)
    normals, place = np.ascontiguousarray(normals), place.ravel()
    found = wp.empty(len(normals), dtype=wp.vec3d, device="cpu")
    inputs = [shared_array(points, wp.vec3d), shared_array(normals, wp.vec3d), found]
    wp.launch(_support_kernel, dim=len(normals), inputs=inputs, device="cpu")
    chords = found.numpy()
    face_widths = (chords * normals).sum(axis=1)
    direction = normals[np.argmin(face_widths)]
    width = float(face_widths.min())

    left, right = (place[hull.edges[:, i]] for i in (2, 3))
    bounds = [
        np.minimum(face_widths[i], (chords[i] * normals[j]).sum(axis=1)) for i, j in ((left, right), (right, left))
    ]
    kept = np.flatnonzero((np.maximum(*bounds) < width) & (left != right))
    candidates = [direction, _across_opposite_edges(points, hull.normals, hull.edges[kept])]
    # Both are measured over all vertices: what is returned holds whatever rounding did to the search.
    widths = [float(np.ptp(dot(points, n))) if n.any() else math.inf for n in candidates]
    best = int(np.argmin(widths))
    return math.ldexp(widths[best], exponent), pointed(candidates[best])


def _across_opposite_edges(points: np.ndarray, normals: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Direction of the least width between two of the edges, shape (3,); 0 where there is none."""
    if len(edges) == 0:
        return np.zeros(3)
    n0, n1 = normals[edges[:, 2]], normals[edges[:, 3]]
    middle = n0 + n1
    middle = middle / np.sqrt((middle**2).sum(axis=1))[:, None]
    half_angle = 0.5 * np.arccos(np.clip((n0 * n1).sum(axis=1), -1.0, 1.0))
    # Sorted by the height of their normals on the sphere, only a band of arcs can be opposite to a given one.
    order = np.argsort(middle[:, 2], kind="stable")
    edges, height, band = np.ascontiguousarray(edges[order]), middle[order, 2], half_angle[order] + half_angle.max()
    first = np.searchsorted(height, -height - band - 1e-9).astype(np.int32)
    last = np.searchsorted(height, -height + band + 1e-9).astype(np.int32)
    widths, directions = (wp.empty(len(edges), dtype=d, device="cpu") for d in (wp.float64, wp.vec3d))
    inputs = [shared_array(points, wp.vec3d), shared_array(normals, wp.vec3d), shared_array(edges, wp.vec4i)]
    inputs += [shared_array(first, wp.int32), shared_array(last, wp.int32), widths, directions]
    wp.launch(_opposite_edges_kernel, dim=len(edges), inputs=inputs, device="cpu")
    return directions.numpy()[np.argmin(widths.numpy())]
