"""A convex hull seen along a direction, and the best rectangle or square about its outline: planar calipers."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from lithoform.descriptors.hull import Hull
from lithoform.descriptors.poses import BOX_VOLUME, SQUARE_SIDE, extent
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["planar_poses"]

wp.set_module_options(MODULE_OPTIONS)

_SECTORS: Final = wp.constant(20)
_SECTOR: Final = wp.constant(wp.float64(0.5 * math.pi / 20))
"""Steps over the quarter turn in which crossings of two extents are looked for, and their angle [rad]."""

_SCRATCH: Final = 1 << 21
"""Corners of outlines that are held at a time (64 MiB with their sides)."""


@wp.func
def _plane_extents(outline: wp.array2d(dtype=wp.vec2d), k: wp.int32, count: wp.int32, s: wp.vec2d) -> wp.vec2d:
    """Extents of an outline along a direction of its plane and across it."""
    first = outline[k, 0]
    low_along = s[0] * first[0] + s[1] * first[1]
    high_along = low_along
    low_across = s[0] * first[1] - s[1] * first[0]
    high_across = low_across
    for j in range(1, count):
        p = outline[k, j]
        along = s[0] * p[0] + s[1] * p[1]
        across = s[0] * p[1] - s[1] * p[0]
        low_along = wp.min(low_along, along)
        high_along = wp.max(high_along, along)
        low_across = wp.min(low_across, across)
        high_across = wp.max(high_across, across)
    return wp.vec2d(high_along - low_along, high_across - low_across)


@wp.kernel(enable_backward=False)
def _planar_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    edges: wp.array(dtype=wp.vec4i),
    directions: wp.array(dtype=wp.vec3d),
    measure: wp.int32,
    start: wp.int32,
    outline: wp.array2d(dtype=wp.vec2d),
    sides: wp.array2d(dtype=wp.vec2d),
    poses: wp.array(dtype=wp.mat33d),
    values: wp.array(dtype=wp.float64),
):
    """The best pose that looks along a direction, a side of it flush with the outline (or, of squares, filled)."""
    k = wp.tid()
    w = directions[start + k]
    # Any two axes across the direction.
    helper = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    if wp.abs(w[0]) > wp.float64(0.6):
        helper = wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
    u = wp.normalize(wp.cross(helper, w))
    v = wp.cross(w, u)
    count = wp.int32(0)
    for i in range(edges.shape[0]):
        e = edges[i]
        left = wp.dot(normals[e[2]], w) > wp.float64(0.0)
        right = wp.dot(normals[e[3]], w) > wp.float64(0.0)
        if left != right:
            a = vertices[e[0]]
            b = vertices[e[1]]
            corner = a
            if right:
                corner = b
            outline[k, count] = wp.vec2d(wp.dot(u, corner), wp.dot(v, corner))
            sides[k, count] = wp.normalize(wp.vec2d(wp.dot(u, b - a), wp.dot(v, b - a)))
            count += 1
    height = wp.float64(1.0)
    if measure == BOX_VOLUME:
        height = extent(vertices, w)
    best = wp.float64(1.0e300)
    side = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    for i in range(count):
        s = sides[k, i]
        size = _plane_extents(outline, k, count, s)
        value = size[0] * size[1] * height
        if measure == SQUARE_SIDE:
            value = wp.max(size[0], size[1])
        if value < best and wp.length(s) > wp.float64(0.5):
            best = value
            side = s
    if measure == SQUARE_SIDE:
        # A square can also be least where its extents cross, flush with nothing: a plate on its edge.  The
        # difference of the extents changes sign over a quarter turn.
        last = _plane_extents(outline, k, count, wp.vec2d(wp.float64(1.0), wp.float64(0.0)))
        for i in range(_SECTORS):
            low = wp.float64(i) * _SECTOR
            high = wp.float64(i + 1) * _SECTOR
            size = _plane_extents(outline, k, count, wp.vec2d(wp.cos(high), wp.sin(high)))
            sign = last[0] - last[1]
            if sign * (size[0] - size[1]) <= wp.float64(0.0):
                for _halving in range(20):
                    middle = wp.float64(0.5) * (low + high)
                    s = wp.vec2d(wp.cos(middle), wp.sin(middle))
                    inner = _plane_extents(outline, k, count, s)
                    if wp.max(inner[0], inner[1]) < best:
                        best = wp.max(inner[0], inner[1])
                        side = s
                    if sign * (inner[0] - inner[1]) <= wp.float64(0.0):
                        high = middle
                    else:
                        low = middle
            last = size
    x = side[0] * u + side[1] * v
    poses[start + k] = wp.matrix_from_rows(x, wp.cross(w, x), w)
    values[start + k] = best


def planar_poses(hull: Hull, directions: np.ndarray, measure: int) -> tuple[np.ndarray, np.ndarray]:
    """For each direction of view, the best pose among those with a side flush with the outline of the hull.

    Parameters
    ----------
    hull : Hull
    directions : numpy.ndarray, shape (d, 3)
        Unit vectors.
    measure : int
        `BOX_VOLUME`, for which this is the best of all (Freeman and Shapira 1975), or `SQUARE_SIDE`, for
        which the poses with two equal extents are tried as well.

    Returns
    -------
    poses : numpy.ndarray, shape (d, 3, 3)
        Axes as rows, the third along the direction.
    values : numpy.ndarray, shape (d,)
        [u^3] or [u], of the hull at the size of `Hull.of_unit_size`.
    """
    load(_planar_kernel.module, "cpu")
    points, edges = shared_array(hull.of_unit_size[0], wp.vec3d), shared_array(hull.edges, wp.vec4i)
    views, normals = np.ascontiguousarray(directions), shared_array(hull.normals, wp.vec3d)
    batch = min(len(views), max(1, _SCRATCH // len(hull.edges)))
    outline, sides = (wp.empty((batch, len(hull.edges)), dtype=wp.vec2d, device="cpu") for _ in range(2))
    poses, values = (
        wp.empty(len(views), dtype=wp.mat33d, device="cpu"),
        wp.empty(len(views), dtype=wp.float64, device="cpu"),
    )
    inputs = [points, normals, edges, shared_array(views, wp.vec3d), measure]
    for start in range(0, len(views), batch):
        size = min(batch, len(views) - start)
        wp.launch(_planar_kernel, dim=size, inputs=[*inputs, start, outline, sides, poses, values], device="cpu")
    return poses.numpy(), values.numpy()
