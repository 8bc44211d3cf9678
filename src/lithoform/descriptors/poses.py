"""Poses of a body, what they measure, and the descent to the least.

A pose is three orthonormal axes; its measure is made of the extents of a convex hull along them.  Extents are
largest values of linear functions, so that a measure has its local minima where several vertices or edges touch
at once.  The descent solves for these contacts by successive linear programs over rotations: it ends in a
local minimum to rounding, not to a step size.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from lithoform.descriptors.hull import Hull
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["BOX_VOLUME", "SQUARE_SIDE", "descend", "distinct_best", "extent"]

wp.set_module_options(MODULE_OPTIONS)

BOX_VOLUME: Final = 0
"""Measure of a pose: the product of the three extents."""

SQUARE_SIDE: Final = 1
"""Measure of a pose: the larger of the extents along its first two axes."""

_Counts: Final = wp.types.vector(length=6, dtype=wp.int32)

_REACH: Final = wp.constant(wp.float64(0.1))
"""First radius of trust [rad]: somewhat less than the angle between the first directions of view."""


@wp.func
def _ends(vertices: wp.array(dtype=wp.vec3d), axis: wp.vec3d) -> wp.vec2d:
    low = wp.dot(axis, vertices[0])
    high = low
    for i in range(1, vertices.shape[0]):
        x = wp.dot(axis, vertices[i])
        low = wp.min(low, x)
        high = wp.max(high, x)
    return wp.vec2d(low, high)


@wp.func
def extent(vertices: wp.array(dtype=wp.vec3d), axis: wp.vec3d) -> wp.float64:
    """Length of the projection of points on an axis."""
    ends = _ends(vertices, axis)
    return ends[1] - ends[0]


@wp.func
def _support(
    vertices: wp.array(dtype=wp.vec3d),
    near: wp.array3d(dtype=wp.int32),
    k: wp.int32,
    side: wp.int32,
    count: wp.int32,
    axis: wp.vec3d,
) -> wp.vec3d:
    """The farthest along an axis of the vertices that are near to a side."""
    found = vertices[near[k, side, 0]]
    most = wp.dot(axis, found)
    for j in range(1, count):
        p = vertices[near[k, side, j]]
        h = wp.dot(axis, p)
        if h > most:
            most = h
            found = p
    return found


@wp.func
def _measure(vertices: wp.array(dtype=wp.vec3d), pose: wp.mat33d, measure: wp.int32) -> wp.float64:
    x = extent(vertices, pose[0])
    y = extent(vertices, pose[1])
    if measure == SQUARE_SIDE:
        return wp.max(x, y)
    return x * y * extent(vertices, pose[2])


@wp.func
def _turned(pose: wp.mat33d, angles: wp.vec3d) -> wp.mat33d:
    """The pose turned by a rotation vector (Rodrigues), its rows orthonormal to rounding."""
    angle = wp.length(angles)
    if angle == wp.float64(0.0):
        return pose
    n = angles / angle
    c = wp.cos(angle)
    s = wp.sin(angle)
    x = pose[0]
    y = pose[1]
    x = c * x + s * wp.cross(n, x) + (wp.float64(1.0) - c) * wp.dot(n, x) * n
    y = c * y + s * wp.cross(n, y) + (wp.float64(1.0) - c) * wp.dot(n, y) * n
    x = wp.normalize(x)
    z = wp.normalize(wp.cross(x, y))
    return wp.matrix_from_rows(x, wp.cross(z, x), z)


@wp.kernel(enable_backward=False)
def _descent_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    diameter: wp.float64,
    measure: wp.int32,
    near: wp.array3d(dtype=wp.int32),
    poses: wp.array(dtype=wp.mat33d),
    values: wp.array(dtype=wp.float64),
):
    """Successive linear programs in the rotation vector d of a pose, each solved by a dual simplex with cuts.

    An axis a becomes a + d x a, so that the support of a vertex p is a . p + d . (a x p): each extent, and
    with it the measure (of a volume: the sum of relative changes), is the largest of linear functions of d.
    In units of the radius of trust, x = (d, t): least t over the cuts t >= g . d + b and |d_i| <= 1.
    """
    k = wp.tid()
    one = wp.float64(1.0)
    zero = wp.float64(0.0)
    pose = poses[k]
    value = _measure(vertices, pose, measure)
    reach = wp.float64(_REACH)
    axes = wp.int32(3)
    if measure == SQUARE_SIDE:
        axes = wp.int32(2)
    counts = _Counts()
    for _step in range(80):
        # Only vertices this near to a support can become one inside the radius of trust.
        weights = wp.vec3d(one, one, one)
        for i in range(axes):
            a = pose[i]
            ends = _ends(vertices, a)
            weights[i] = one / (ends[1] - ends[0])
            slack = wp.float64(1.8) * reach * diameter
            above = wp.int32(0)
            below = wp.int32(0)
            for j in range(vertices.shape[0]):
                h = wp.dot(a, vertices[j])
                if h > ends[1] - slack:
                    near[k, 2 * i, above] = j
                    above += 1
                if h < ends[0] + slack:
                    near[k, 2 * i + 1, below] = j
                    below += 1
            counts[2 * i] = above
            counts[2 * i + 1] = below
        scale = one / value
        before = wp.float64(1.0)
        if measure == BOX_VOLUME:
            before = wp.float64(3.0)

        basis = wp.mat44d()
        bounds = wp.vec4d()
        inverse = wp.mat44d()
        solution = wp.vec4d()
        predicted = wp.float64(0.0)
        for pivot in range(100):
            # The row that enters: a bound that is broken, or the cut at the present d.
            row = wp.vec4d()
            bound = wp.float64(0.0)
            broken = wp.int32(-1)
            excess = wp.float64(1.0e-9)
            for i in range(3):
                if wp.abs(solution[i]) - one > excess:
                    excess = wp.abs(solution[i]) - one
                    broken = wp.int32(i)
            if broken >= 0:
                row[broken] = one
                if solution[broken] > zero:
                    row[broken] = -one
                bound = -one
            else:
                d = wp.vec3d(solution[0], solution[1], solution[2]) * reach
                gradient = wp.vec3d()
                offset = wp.float64(0.0)
                largest = wp.float64(-1.0)
                for i in range(axes):
                    a = pose[i]
                    turned = a + wp.cross(d, a)
                    top = _support(vertices, near, k, 2 * i, counts[2 * i], turned)
                    bottom = _support(vertices, near, k, 2 * i + 1, counts[2 * i + 1], -turned)
                    chord = top - bottom
                    width = wp.dot(turned, chord)
                    if measure == BOX_VOLUME:
                        gradient += weights[i] * wp.cross(a, chord)
                        offset += weights[i] * wp.dot(a, chord)
                    elif width > largest:
                        largest = width
                        gradient = scale * wp.cross(a, chord)
                        offset = scale * wp.dot(a, chord)
                gradient = gradient * reach
                level = offset + wp.dot(gradient, wp.vec3d(solution[0], solution[1], solution[2]))
                if pivot > 0:
                    predicted = before - level
                    if level - solution[3] <= wp.float64(0.01) * predicted + wp.float64(1.0e-15):
                        break
                row = wp.vec4d(-gradient[0], -gradient[1], -gradient[2], one)
                bound = offset

            if pivot == 0:
                # Dual feasible from the start: the first cut, and the corner of the bounds that lies down its slope.
                for i in range(3):
                    basis[i, i] = one
                    if row[i] > zero:
                        basis[i, i] = -one
                    bounds[i] = -one
                for i in range(4):
                    basis[3, i] = row[i]
                bounds[3] = bound
            else:
                along = row * inverse
                leaving = wp.int32(-1)
                ratio = wp.float64(1.0e300)
                for i in range(4):
                    if along[i] > wp.float64(1.0e-13) and inverse[3, i] / along[i] < ratio:
                        ratio = inverse[3, i] / along[i]
                        leaving = wp.int32(i)
                if leaving < 0:
                    break
                for i in range(4):
                    basis[leaving, i] = row[i]
                bounds[leaving] = bound
            inverse = wp.inverse(basis)
            solution = inverse * bounds
        if predicted <= wp.float64(1.0e-14):
            break
        trial = _turned(pose, wp.vec3d(solution[0], solution[1], solution[2]) * reach)
        lower = _measure(vertices, trial, measure)
        gained = one - lower * scale
        if measure == BOX_VOLUME:
            gained = -wp.log(lower * scale)
        if gained > zero:
            pose = trial
            value = lower
        if gained > wp.float64(0.7) * predicted:
            reach = wp.min(wp.float64(2.0) * reach, wp.float64(0.2))
        elif gained < wp.float64(0.3) * predicted:
            reach = wp.float64(0.25) * reach
        if reach < wp.float64(1.0e-10):
            break
    poses[k] = pose
    values[k] = value


def descend(hull: Hull, poses: np.ndarray, measure: int) -> tuple[np.ndarray, np.ndarray]:
    """Follow poses down to local minima of a measure.

    Parameters
    ----------
    hull : Hull
    poses : numpy.ndarray, shape (s, 3, 3)
        Orthonormal axes as rows.
    measure : int
        `BOX_VOLUME` or `SQUARE_SIDE`.

    Returns
    -------
    poses : numpy.ndarray, shape (s, 3, 3)
    values : numpy.ndarray, shape (s,)
        [u^3] or [u], of the hull at the size of `Hull.of_unit_size`; never above those of the start.
    """
    load(_descent_kernel.module, "cpu")
    points = hull.of_unit_size[0]
    diameter = 2.0 * math.sqrt(float((points**2).sum(axis=1).max()))
    moved = wp.array(np.ascontiguousarray(poses), dtype=wp.mat33d, device="cpu")
    values = wp.empty(len(poses), dtype=wp.float64, device="cpu")
    near = wp.empty((len(poses), 6, len(points)), dtype=wp.int32, device="cpu")
    inputs = [shared_array(points, wp.vec3d), wp.float64(diameter), measure, near, moved, values]
    wp.launch(_descent_kernel, dim=len(poses), inputs=inputs, device="cpu")
    return moved.numpy(), values.numpy()


def distinct_best(poses: np.ndarray, values: np.ndarray, count: int, measure: int) -> np.ndarray:
    """Numbers of the best poses, rising in value, none within 0.1 rad of a better one.

    Poses that differ in the sense of axes are one; for `BOX_VOLUME` also those that differ in their order, for
    `SQUARE_SIDE` those that differ in the order of the first two.
    """
    chosen: list[int] = []
    open_values = values.copy()
    limit = math.cos(0.1)
    while len(chosen) < count and math.isfinite(open_values.min()):
        best = int(np.argmin(open_values))
        chosen.append(best)
        aligned = np.abs((poses[:, :, None, :] * poses[best][None, None]).sum(axis=3)) > limit
        same = aligned.any(axis=2).all(axis=1)
        open_values[same if measure == BOX_VOLUME else same & aligned[:, 2, 2]] = math.inf
    return np.array(chosen)
