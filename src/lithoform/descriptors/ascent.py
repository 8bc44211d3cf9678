"""Ascent of the distance to a set of triangles: the kernels behind the inscribed sphere.

The distance d_i to one triangle is a convex function, so that its tangent plane bounds it from below,

    d_i(x + s) >= d_i(x) + g_i . s,    g_i = (x - c_i) / d_i, c_i the closest point.

The linear programme  max_s min_i (d_i + g_i . s),  |s_k| <= tau,  over all triangles within 2 sqrt(3) tau of the
nearest one therefore promises a distance that the step is sure to reach: the ascent is monotone without any step
control, never crosses the surface, solves plane contacts in one step and vertex contacts quadratically (a
concave-convex procedure with an exact inner solution).  A dual simplex method with four basic rows solves it.

A point is a triangle with three equal corners.
"""

from __future__ import annotations

from typing import Final

from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = ["ascent_kernel", "bounds_kernel", "tangent_kernel"]

wp.set_module_options(MODULE_OPTIONS)

_MOST_PIVOTS: Final = wp.constant(80)
_CORNER: Final = wp.constant(wp.float64(3.0**0.5))
"""Half diagonal of the cube |s_k| <= 1."""

_TIED: Final = wp.constant(wp.float64(1.0e-9))
"""Relative difference below which two faces are taken to share the closest point (a common edge or corner)."""


@wp.func
def _closest(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, x: wp.vec3d) -> wp.vec3d:
    """Closest point of a triangle (Ericson 2005, Real-Time Collision Detection, 5.1.5); of any degenerate one too."""
    zero = wp.float64(0.0)
    ab = b - a
    ac = c - a
    ax = x - a
    d1 = wp.dot(ab, ax)
    d2 = wp.dot(ac, ax)
    if d1 <= zero and d2 <= zero:
        return a
    bx = x - b
    d3 = wp.dot(ab, bx)
    d4 = wp.dot(ac, bx)
    if d3 >= zero and d4 <= d3:
        return b
    cx = x - c
    d5 = wp.dot(ab, cx)
    d6 = wp.dot(ac, cx)
    if d6 >= zero and d5 <= d6:
        return c
    # The signed weights by cross products, not by differences of the products above: a sliver loses fewer digits.
    normal = wp.cross(ab, ac)
    vc = wp.dot(normal, wp.cross(ax, bx))
    if vc <= zero and d1 >= zero and d3 <= zero:
        return a + (d1 / (d1 - d3)) * ab
    vb = wp.dot(normal, wp.cross(cx, ax))
    if vb <= zero and d2 >= zero and d6 <= zero:
        return a + (d2 / (d2 - d6)) * ac
    va = wp.dot(normal, wp.cross(bx, cx))
    if va <= zero and d4 - d3 >= zero and d5 - d6 >= zero:
        return b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b)
    total = va + vb + vc
    if total <= zero:
        return a
    return a + (vb / total) * ab + (vc / total) * ac


@wp.kernel(enable_backward=False)
def bounds_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    middles: wp.array(dtype=wp.vec3d),
    reaches: wp.array(dtype=wp.float64),
) -> None:
    """Centroid of each face, and how far its corners are from it."""
    i = wp.tid()
    f = faces[i]
    a = vertices[f[0]]
    b = vertices[f[1]]
    c = vertices[f[2]]
    m = (a + b + c) / wp.float64(3.0)
    middles[i] = m
    reaches[i] = wp.sqrt(wp.max(wp.length_sq(a - m), wp.max(wp.length_sq(b - m), wp.length_sq(c - m))))


@wp.kernel(enable_backward=False)
def tangent_kernel(
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    chosen: wp.array(dtype=wp.int32),
    slack: wp.float64,
    radii: wp.array(dtype=wp.float64),
) -> None:
    """Largest ball that touches a surfel from inside and is entered by no other by more than `slack`.

    From |q + R n|^2 >= (R - slack)^2 for each other surfel at q from this one: R = (q^2 - slack^2) / 2 (-q.n - slack).
    """
    t = wp.tid()
    p = positions[chosen[t]]
    n = normals[chosen[t]]
    best = wp.float64(1.0e300)
    for j in range(positions.shape[0]):
        q = positions[j] - p
        depth = -wp.dot(q, n) - slack
        if depth > wp.float64(0.0):
            best = wp.min(best, wp.float64(0.5) * (wp.length_sq(q) - slack * slack) / depth)
    radii[t] = best


@wp.func
def _solve(
    row: wp.int32,
    count: wp.int32,
    first: wp.int32,
    tau: wp.float64,
    gaps: wp.array2d(dtype=wp.float64),
    slopes: wp.array2d(dtype=wp.vec3d),
):
    """Step s and promised distance of  max t,  t <= gap_i + slope_i . s,  |s_k| <= tau  (dual simplex).

    Rows r = (slope, -1) of a contact and (-+e_k, 0) of a bound hold  r . (s, t) + b >= 0.  With M the four basic
    rows and columns c_k of its inverse, (s, t) = -sum b_k c_k and the multiplier of a row is -c_k[3] >= 0.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    inverse = wp.mat44d()
    rhs = wp.vec4d(tau, tau, tau, gaps[row, first])
    g = slopes[row, first]
    for k in range(3):
        side = one
        if g[k] < zero:
            side = -one
        inverse[k, k] = -side
        inverse[3, k] = -side * g[k]
    inverse[3, 3] = -one
    y = -(inverse * rhs)
    scale = gaps[row, first]
    for _ in range(_MOST_PIVOTS):
        s = wp.vec3d(y[0], y[1], y[2])
        worst = -wp.float64(1.0e-15) * scale
        enter = wp.int32(-1)
        for i in range(count):
            excess = gaps[row, i] + wp.dot(slopes[row, i], s) - y[3]
            if excess < worst:
                worst = excess
                enter = i
        bound = wp.int32(-1)
        for k in range(3):
            excess = tau - wp.abs(y[k])
            if excess < worst and excess < -wp.float64(1.0e-12) * tau:
                worst = excess
                bound = wp.int32(k)
        if enter < 0 and bound < 0:
            break
        incoming = wp.vec4d(zero, zero, zero, zero)
        value = tau
        if bound >= 0:
            incoming[bound] = one
            if y[bound] > zero:
                incoming[bound] = -one
        else:
            g = slopes[row, enter]
            incoming = wp.vec4d(g[0], g[1], g[2], -one)
            value = gaps[row, enter]
        mu = wp.transpose(inverse) * incoming
        leave = wp.int32(-1)
        ratio = wp.float64(1.0e300)
        for k in range(4):
            if mu[k] > wp.float64(1.0e-11):
                r = wp.max(-inverse[3, k], zero) / mu[k]
                if r < ratio:
                    ratio = r
                    leave = wp.int32(k)
        if leave < 0:
            break
        pivot = wp.vec4d(inverse[0, leave], inverse[1, leave], inverse[2, leave], inverse[3, leave]) / mu[leave]
        for k in range(4):
            for m in range(4):
                if k == leave:
                    inverse[m, k] = pivot[m]
                else:
                    inverse[m, k] = inverse[m, k] - mu[k] * pivot[m]
        rhs[leave] = value
        y = -(inverse * rhs)
    # The promise of the step as it is, should the pivots have run out: clamped to the cube, and the true minimum.
    s = wp.vec3d(wp.clamp(y[0], -tau, tau), wp.clamp(y[1], -tau, tau), wp.clamp(y[2], -tau, tau))
    promise = gaps[row, 0] + wp.dot(slopes[row, 0], s)
    for i in range(count):
        promise = wp.min(promise, gaps[row, i] + wp.dot(slopes[row, i], s))
    return s, promise


@wp.func
def _distance(
    row: wp.int32,
    x: wp.vec3d,
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    middles: wp.array(dtype=wp.vec3d),
    reaches: wp.array(dtype=wp.float64),
    gaps: wp.array2d(dtype=wp.float64),
) -> wp.float64:
    """Distance to the nearest face; leaves a lower bound of the distance to each in `gaps`."""
    upper = wp.float64(1.0e300)
    for i in range(faces.shape[0]):
        away = wp.length(x - middles[i])
        gaps[row, i] = away - reaches[i]
        upper = wp.min(upper, away)
    nearest = wp.float64(1.0e300)
    for i in range(faces.shape[0]):
        if gaps[row, i] <= upper:
            f = faces[i]
            nearest = wp.min(nearest, wp.length(x - _closest(vertices[f[0]], vertices[f[1]], vertices[f[2]], x)))
            upper = wp.min(upper, nearest)
    return nearest


@wp.kernel(enable_backward=False)
def ascent_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    middles: wp.array(dtype=wp.vec3d),
    reaches: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.vec3d),
    first_step: wp.float64,
    tolerance: wp.float64,
    most_steps: wp.int32,
    check_side: wp.bool,
    gaps: wp.array2d(dtype=wp.float64),
    slopes: wp.array2d(dtype=wp.vec3d),
    near: wp.array2d(dtype=wp.int32),
    centres: wp.array(dtype=wp.vec3d),
    radii: wp.array(dtype=wp.float64),
) -> None:
    """Climb from each start to a local maximum of the distance; radius -1 if the start is outside the solid."""
    row = wp.tid()
    x = starts[row]
    tau = wp.float64(-1.0)
    listed_at = x
    listed_reach = wp.float64(-1.0)
    count = wp.int32(0)
    d = wp.float64(0.0)
    outside = wp.bool(False)
    for step in range(most_steps):
        if wp.length(x - listed_at) + _CORNER * tau > listed_reach or step == 0:
            d = _distance(row, x, vertices, faces, middles, reaches, gaps)
            if step == 0:
                tau = first_step * d
            listed_at = x
            listed_reach = wp.float64(2.0) * _CORNER * tau
            limit = d + wp.float64(2.0) * listed_reach
            count = wp.int32(0)
            for i in range(faces.shape[0]):
                if gaps[row, i] <= limit:
                    near[row, count] = i
                    count += 1
        d = wp.float64(1.0e300)
        for k in range(count):
            f = faces[near[row, k]]
            away = x - _closest(vertices[f[0]], vertices[f[1]], vertices[f[2]], x)
            gap = wp.length(away)
            gaps[row, k] = gap
            slopes[row, k] = away / wp.max(gap, wp.float64(1.0e-300))
            d = wp.min(d, gap)
        if step == 0 and check_side:
            # Of the faces that share the closest point, the one that faces x most tells the side.
            facing = wp.float64(0.0)
            for k in range(count):
                if gaps[row, k] <= d * (wp.float64(1.0) + _TIED):
                    f = faces[near[row, k]]
                    a = vertices[f[0]]
                    normal = wp.normalize(wp.cross(vertices[f[1]] - a, vertices[f[2]] - a))
                    cosine = wp.dot(normal, slopes[row, k])
                    if wp.abs(cosine) > wp.abs(facing):
                        facing = cosine
            outside = facing >= wp.float64(0.0)
            if outside:
                break
        limit = d + wp.float64(2.0) * _CORNER * tau
        band = wp.int32(0)
        first = wp.int32(0)
        for k in range(count):
            if gaps[row, k] <= limit:
                gap = gaps[row, k]
                slope = slopes[row, k]
                gaps[row, band] = gap
                slopes[row, band] = slope
                if gap <= gaps[row, first]:
                    first = band
                band += 1
        s, promise = _solve(row, band, first, tau, gaps, slopes)
        if promise <= d * (wp.float64(1.0) + tolerance):
            break
        x += s
        d = promise
        moved = wp.max(wp.abs(s[0]), wp.max(wp.abs(s[1]), wp.abs(s[2])))
        if moved > wp.float64(0.99) * tau:
            tau = wp.min(wp.float64(2.0) * tau, wp.float64(0.25) * d)
        else:
            tau = moved
    centres[row] = x
    radii[row] = d
    if outside:
        radii[row] = wp.float64(-1.0)
