"""The largest principal curvature of a surface at a chosen scale, from its surfels."""

from __future__ import annotations

from typing import Final

import numpy as np

from lithoform.descriptors.surfels import Surfels
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["SurfelField", "largest_curvatures"]

wp.set_module_options(MODULE_OPTIONS)

_SAME_SIDE: Final = wp.constant(wp.float64(0.3))
"""Least cosine to the mean normal of a place of normals that count as its side of the body: 73 degrees."""

_NOT_OPPOSITE: Final = wp.constant(wp.float64(-0.1))
"""Least cosine to a surfel's own normal of those averaged with it wherever they are: right angles, with a margin."""

_OPPOSITE: Final = wp.constant(wp.float64(-0.9))
"""Cosine down to which normals count where the two planes meet near by, as at the edges of a tetrahedron.

The other side of a thin wall has a plane that meets this one far away or nowhere.  Without these edges a tetrahedron
has none at all.  The values of 24 generated stones at 20,000 and 80,000 triangles differ by 0.81 % rms with them,
0.85 % without.
"""

_FEWEST: Final = wp.constant(10)
"""Neighbours, the surfel itself included, below which the scale is widened for it."""

_WIDENING: Final = wp.constant(wp.float64(1.3))
_MOST_WIDENINGS: Final = wp.constant(9)

_FLAT: Final = wp.constant(wp.float64(1.0e-10))
"""Neighbours are in one line where det / trace^2 of their second moment is below this."""


_MOST_BUCKETS: Final = 400_000
"""Cells of the search grid; they grow for very long bodies, whose bounding box is mostly empty."""


@wp.kernel(enable_backward=False)
def _sort_kernel(
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    areas: wp.array(dtype=wp.float64),
    low: wp.vec3d,
    cell: wp.float64,
    shape: wp.vec3i,
    starts: wp.array(dtype=wp.int32),
    buckets: wp.array(dtype=wp.int32),
    sorted_positions: wp.array(dtype=wp.vec3d),
    sorted_normals: wp.array(dtype=wp.vec3d),
    sorted_areas: wp.array(dtype=wp.float64),
):
    """Counting sort by grid cell (one thread; stable, so that the order is always the same)."""
    n = positions.shape[0]
    for c in range(starts.shape[0]):
        starts[c] = 0
    for i in range(n):
        q = (positions[i] - low) / cell
        c = (wp.int32(q[0]) * shape[1] + wp.int32(q[1])) * shape[2] + wp.int32(q[2])
        buckets[i] = c
        starts[c + 2] = starts[c + 2] + 1
    for c in range(starts.shape[0] - 1):
        starts[c + 1] = starts[c + 1] + starts[c]
    # starts[c + 1] is now the first place of cell c; after the filling it is its end, the start of cell c + 1.
    for i in range(n):
        place = starts[buckets[i] + 1]
        starts[buckets[i] + 1] = place + 1
        sorted_positions[place] = positions[i]
        sorted_normals[place] = normals[i]
        sorted_areas[place] = areas[i]


@wp.func
def _cell_range(x: wp.float64, reach: wp.float64, cell: wp.float64, last: wp.int32):
    """First and last cell of the grid that an interval around x meets."""
    first = wp.int32(wp.max(x - reach, wp.float64(0.0)) / cell)
    end = wp.int32(wp.max(x + reach, wp.float64(0.0)) / cell)
    return wp.min(first, last), wp.min(end, last)


@wp.func
def _tangent(n: wp.vec3d) -> wp.vec3d:
    """A unit vector across n."""
    zero = wp.float64(0.0)
    if wp.abs(n[0]) < wp.float64(0.6):
        return wp.normalize(wp.vec3d(zero, n[2], -n[1]))
    return wp.normalize(wp.vec3d(-n[2], zero, n[0]))


@wp.kernel(enable_backward=False)
def _facing_kernel(
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    areas: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    low: wp.vec3d,
    cell: wp.float64,
    shape: wp.vec3i,
    reach: wp.float64,
    facings: wp.array(dtype=wp.vec3d),
):
    """Mean normal around each surfel: halfway between the faces near a sharp edge.

    Planes through this surfel (normal m) and another at p (normal n, m . n = c) meet at the distance
    p . n / sqrt(1 - c^2) from this one, where the edge between them is convex.
    """
    i = wp.tid()
    centre = positions[i]
    own = normals[i]
    from_low = centre - low
    mean = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    per_square = wp.float64(1.0) / (reach * reach)
    a0, a1 = _cell_range(from_low[0], reach, cell, shape[0] - 1)
    b0, b1 = _cell_range(from_low[1], reach, cell, shape[1] - 1)
    c0, c1 = _cell_range(from_low[2], reach, cell, shape[2] - 1)
    for a in range(a0, a1 + 1):
        for b in range(b0, b1 + 1):
            base = (a * shape[1] + b) * shape[2]
            for j in range(starts[base + c0], starts[base + c1 + 1]):
                p = positions[j] - centre
                nearness = wp.float64(1.0) - wp.length_sq(p) * per_square
                if nearness > wp.float64(0.0):
                    n = normals[j]
                    cosine = wp.dot(n, own)
                    if cosine <= _NOT_OPPOSITE:
                        if cosine > _OPPOSITE and wp.dot(p, own) <= wp.float64(0.0):
                            rise = wp.max(wp.dot(p, n), wp.float64(0.0))
                            square = rise * rise / (wp.float64(1.0) - cosine * cosine)
                            nearness *= wp.max(wp.float64(1.0) - square * per_square, wp.float64(0.0))
                        else:
                            nearness = wp.float64(0.0)
                    mean += (areas[j] * nearness) * n
    facings[i] = wp.normalize(mean)


@wp.func
def _fit_within(
    reach: wp.float64,
    centre: wp.vec3d,
    facing: wp.vec3d,
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    areas: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    low: wp.vec3d,
    cell: wp.float64,
    shape: wp.vec3i,
):
    """Neighbours within `reach` on the same side, and the largest curvature fitted to them; 0 where they fit none."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    u = _tangent(facing)
    v = wp.cross(facing, u)
    count = wp.int32(0)
    weight = zero
    x_sum = zero
    y_sum = zero
    a_sum = zero
    b_sum = zero
    xx = zero
    xy = zero
    yy = zero
    r_x = zero
    r_xy = zero
    r_y = zero
    square = reach * reach
    per_square = one / square
    from_low = centre - low
    i0, i1 = _cell_range(from_low[0], reach, cell, shape[0] - 1)
    j0, j1 = _cell_range(from_low[1], reach, cell, shape[1] - 1)
    k0, k1 = _cell_range(from_low[2], reach, cell, shape[2] - 1)
    for ci in range(i0, i1 + 1):
        for cj in range(j0, j1 + 1):
            base = (ci * shape[1] + cj) * shape[2]
            for t in range(starts[base + k0], starts[base + k1 + 1]):
                p = positions[t] - centre
                away = wp.length_sq(p)
                if away < square:
                    n = normals[t]
                    if wp.dot(n, facing) > _SAME_SIDE:
                        nearness = one - away * per_square
                        w = areas[t] * nearness * nearness
                        x = wp.dot(p, u)
                        y = wp.dot(p, v)
                        a = wp.dot(n, u)
                        b = wp.dot(n, v)
                        w_x = w * x
                        w_y = w * y
                        count += 1
                        weight += w
                        x_sum += w_x
                        y_sum += w_y
                        a_sum += w * a
                        b_sum += w * b
                        xx += w_x * x
                        xy += w_x * y
                        yy += w_y * y
                        r_x += w_x * a
                        r_xy += w_y * a + w_x * b
                        r_y += w_y * b
    if weight == zero:
        return count, zero
    x_mean = x_sum / weight
    y_mean = y_sum / weight
    xx -= x_sum * x_mean
    xy -= x_sum * y_mean
    yy -= y_sum * y_mean
    r_x -= a_sum * x_mean
    r_xy -= a_sum * y_mean + b_sum * x_mean
    r_y -= b_sum * y_mean
    trace = xx + yy
    det = xx * yy - xy * xy
    if det <= _FLAT * trace * trace:
        return count, zero
    # Least squares for the symmetric map [[k_x, k_xy], [k_xy, k_y]] of positions to normals.
    k_xy = (r_xy * xx * yy - xy * (r_x * yy + r_y * xx)) / (trace * det)
    k_x = (r_x - k_xy * xy) / xx
    k_y = (r_y - k_xy * xy) / yy
    half = wp.float64(0.5)
    return count, half * (k_x + k_y) + wp.sqrt(half * half * (k_x - k_y) * (k_x - k_y) + k_xy * k_xy)


@wp.kernel(enable_backward=False)
def _fit_kernel(
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    areas: wp.array(dtype=wp.float64),
    starts: wp.array(dtype=wp.int32),
    low: wp.vec3d,
    cell: wp.float64,
    shape: wp.vec3i,
    scale: wp.float64,
    facings: wp.array(dtype=wp.vec3d),
    curvatures: wp.array(dtype=wp.float64),
):
    """Curvature at the scale, which is widened where there are too few neighbours."""
    i = wp.tid()
    reach = scale
    curvature = wp.float64(0.0)
    for _ in range(_MOST_WIDENINGS):
        count, curvature = _fit_within(
            reach, positions[i], facings[i], positions, normals, areas, starts, low, cell, shape
        )
        if count >= _FEWEST:
            break
        reach = reach * _WIDENING
    curvatures[i] = curvature


@wp.kernel(enable_backward=False)
def _crest_kernel(
    positions: wp.array(dtype=wp.vec3d),
    normals: wp.array(dtype=wp.vec3d),
    curvatures: wp.array(dtype=wp.float64),
    facings: wp.array(dtype=wp.vec3d),
    starts: wp.array(dtype=wp.int32),
    low: wp.vec3d,
    cell: wp.float64,
    shape: wp.vec3i,
    reach: wp.float64,
    least: wp.float64,
    crests: wp.array(dtype=wp.float64),
):
    """Largest curvature within `reach` on the same side, where the own one is above `least`."""
    i = wp.tid()
    centre = positions[i]
    facing = facings[i]
    crest = curvatures[i]
    if crest > least:
        from_low = centre - low
        a0, a1 = _cell_range(from_low[0], reach, cell, shape[0] - 1)
        b0, b1 = _cell_range(from_low[1], reach, cell, shape[1] - 1)
        c0, c1 = _cell_range(from_low[2], reach, cell, shape[2] - 1)
        for a in range(a0, a1 + 1):
            for b in range(b0, b1 + 1):
                base = (a * shape[1] + b) * shape[2]
                for j in range(starts[base + c0], starts[base + c1 + 1]):
                    higher = curvatures[j] > crest
                    if higher and wp.length_sq(positions[j] - centre) < reach * reach:
                        crest = wp.where(wp.dot(normals[j], facing) > _SAME_SIDE, curvatures[j], crest)
    crests[i] = crest


class SurfelField:
    """Curvatures at one scale on the surfels of a surface.

    Attributes
    ----------
    positions, normals : numpy.ndarray, shape (s, 3)
        The surfels [u, -], sorted by place.
    areas : numpy.ndarray, shape (s,)
        [u^2]
    curvatures : numpy.ndarray, shape (s,)
        Largest principal curvature [1/u], convex positive.
    """

    def __init__(self, surfels: Surfels, scale: float) -> None:
        load(_fit_kernel.module, "cpu")
        n = len(surfels.areas)
        low = surfels.positions.min(axis=0)
        extent = surfels.positions.max(axis=0) - low
        cell = max(0.5 * scale, float(np.prod(np.maximum(extent, scale)) / _MOST_BUCKETS) ** (1.0 / 3.0))
        shape = (extent / cell).astype(np.int64) + 1
        starts = wp.empty(int(shape.prod()) + 2, dtype=wp.int32, device="cpu")
        self._grid = [starts, wp.vec3d(*low), wp.float64(cell), wp.vec3i(*shape.tolist())]
        given = [shared_array(surfels.positions, wp.vec3d), shared_array(surfels.normals, wp.vec3d)]
        given += [shared_array(surfels.areas, wp.float64), *self._grid[1:], starts]
        self._sides = [wp.empty(n, dtype=wp.vec3d, device="cpu") for _ in range(2)]
        areas = wp.empty(n, dtype=wp.float64, device="cpu")
        buckets = wp.empty(n, dtype=wp.int32, device="cpu")
        wp.launch(_sort_kernel, dim=1, inputs=[*given, buckets, *self._sides, areas], device="cpu")
        self._curvatures = wp.empty(n, dtype=wp.float64, device="cpu")
        self._facings = wp.empty(n, dtype=wp.vec3d, device="cpu")
        inputs = [*self._sides, areas, *self._grid, 0.5 * scale, self._facings]
        wp.launch(_facing_kernel, dim=n, inputs=inputs, device="cpu")
        inputs = [*self._sides, areas, *self._grid, scale, self._facings, self._curvatures]
        wp.launch(_fit_kernel, dim=n, inputs=inputs, device="cpu")
        self.positions, self.normals = (side.numpy() for side in self._sides)
        self.areas, self.curvatures = areas.numpy(), self._curvatures.numpy()

    def crests(self, reach: float, least: float) -> np.ndarray:
        """Largest curvature within `reach` of each surfel [1/u], shape (s,); its own where that is below `least`."""
        crests = wp.empty(len(self.areas), dtype=wp.float64, device="cpu")
        inputs = [*self._sides, self._curvatures, self._facings, *self._grid, reach, least, crests]
        wp.launch(_crest_kernel, dim=len(self.areas), inputs=inputs, device="cpu")
        return crests.numpy()


def largest_curvatures(surfels: Surfels, scale: float) -> SurfelField:
    """Fit a symmetric map of normals against positions around every surfel.

    The place of a surfel faces the mean normal within l / 2.  Over the neighbours within the scale l whose normals
    are within 73 degrees of that, with weights A (1 - d^2 / l^2)^2, the part of the normal across it is fitted as
    n = n0 + K x with K symmetric, 2 x 2; the result is the larger eigenvalue of K.  This is exact on planes, spheres
    and cylinders at any scale, where a fit of heights is not.  (With the surfel's own normal in place of the mean,
    both sides of a sharp right angle would look flat.)

    Parameters
    ----------
    surfels : Surfels
        In any frame.
    scale : float
        l [u]; widened by 1.3 at a time where fewer than 10 neighbours are found.

    Returns
    -------
    SurfelField
        In the frame of the surfels.
    """
    return SurfelField(surfels, scale)
