"""What calipers read from a body: length, width and thickness, and the least distance of two jaws.

Length is the greatest distance of two points.  For width and thickness, the greatest size across the length and
the size across both, two readings are in use.  Between jaws (parallel planes, as a proportional caliper of
ASTM D4791 closes on a stone) they are extents; between points (Garboczi 2002, NIST's tables) they are the longest
segments inside the body along such directions, never longer.  Over the 95 stones of NIST's table for FDOT-57 the
second reading gives the printed width and thickness with a median difference of -0.2 and 0.0 %, the first with
+1.4 and +5.3 %; both are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.descriptors.directions import dot, pointed
from lithoform.descriptors.hull import Hull
from lithoform.descriptors.passing import least_width
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["Caliper", "caliper_dimensions"]

wp.set_module_options(MODULE_OPTIONS)

_CUTS: Final = 200
"""Most cutting planes for the longest segment along a direction; 40 stones took 19 at most."""

_SCRATCH: Final = 1 << 21
"""Corners of sections that are held at a time (48 MiB): enough for a stone at once, little for any body."""


@dataclass(frozen=True, eq=False)
class Caliper:
    """Caliper dimensions of a body.

    Attributes
    ----------
    length : float
        Greatest distance of two points [u].
    width : float
        Greatest extent perpendicular to the length [u].
    thickness : float
        Extent perpendicular to both [u].
    axes : numpy.ndarray, shape (3, 3)
        Unit vectors of length, width and thickness as columns, right-handed.
    chord_width : float
        Length of the longest segment in the convex hull perpendicular to the length [u].
    chord_thickness : float
        Length of the longest segment in the convex hull perpendicular to the length and to that segment [u].
    chord_axes : numpy.ndarray, shape (3, 3)
        As `axes`, for the segments.
    minimum_width : float
        Least distance of two parallel planes that hold the body between them [u].
    minimum_width_direction : numpy.ndarray, shape (3,)
        Unit normal of these planes.
    """

    length: float
    width: float
    thickness: float
    axes: np.ndarray
    chord_width: float
    chord_thickness: float
    chord_axes: np.ndarray
    minimum_width: float
    minimum_width_direction: np.ndarray


@wp.kernel(enable_backward=False)
def _farthest_kernel(
    points: wp.array(dtype=wp.vec3d),
    radii: wp.array(dtype=wp.float64),
    bound: wp.float64,
    squares: wp.array(dtype=wp.float64),
    partners: wp.array(dtype=wp.int32),
):
    """Farthest earlier point, of points in the order of falling radius, if it is farther than a bound."""
    i = wp.tid()
    best = wp.float64(0.0)
    partner = wp.int32(0)
    for j in range(i):
        # Radii fall, so that no later point can be far enough either.
        if radii[i] + radii[j] < bound:
            break
        d = points[i] - points[j]
        square = wp.dot(d, d)
        if square > best:
            best = square
            partner = j
    squares[i] = best
    partners[i] = partner


@wp.func
def _farthest(cuts: wp.array2d(dtype=wp.vec3d), k: wp.int32, count: wp.int32, start: wp.vec3d) -> wp.vec3d:
    best = wp.float64(-1.0)
    found = start
    for i in range(count):
        d = cuts[k, i] - start
        square = wp.dot(d, d)
        if square > best:
            best = square
            found = cuts[k, i]
    return found


@wp.kernel(enable_backward=False)
def _section_kernel(
    points: wp.array(dtype=wp.vec3d),
    edges: wp.array(dtype=wp.vec4i),
    levels: wp.array(dtype=wp.float64),
    start: wp.int32,
    cuts: wp.array2d(dtype=wp.vec3d),
    counts: wp.array(dtype=wp.int32),
    bounds: wp.array(dtype=wp.vec2d),
):
    """Corners of the section of the hull at the level of a vertex, and bounds of its diameter."""
    k = wp.tid()
    level = levels[start + k]
    cuts[k, 0] = points[start + k]
    count = wp.int32(1)
    for i in range(edges.shape[0]):
        e = edges[i]
        low = levels[e[0]] - level
        high = levels[e[1]] - level
        if low * high <= wp.float64(0.0):
            a = points[e[0]]
            # An edge in the plane gives its start; its end is the start or end of other edges too.
            s = wp.float64(0.0)
            if low != high:
                s = low / (low - high)
            cuts[k, count] = a + s * (points[e[1]] - a)
            count += 1
    counts[k] = count
    # Twice to the farthest corner: a long chord; no corner is farther from its middle than half the diameter's bound.
    one_end = _farthest(cuts, k, count, cuts[k, 0])
    other_end = _farthest(cuts, k, count, one_end)
    middle = wp.float64(0.5) * (one_end + other_end)
    bounds[k] = wp.vec2d(
        wp.length(other_end - one_end), wp.float64(2.0) * wp.length(_farthest(cuts, k, count, middle) - middle)
    )


@wp.kernel(enable_backward=False)
def _chord_kernel(
    rows: wp.array(dtype=wp.int32),
    cuts: wp.array2d(dtype=wp.vec3d),
    counts: wp.array(dtype=wp.int32),
    squares: wp.array(dtype=wp.float64),
    chords: wp.array(dtype=wp.vec3d),
):
    """Diameter of a section."""
    row = wp.tid()
    k = rows[row]
    best = wp.float64(0.0)
    chord = wp.vec3d()
    for i in range(counts[k]):
        for j in range(i):
            d = cuts[k, i] - cuts[k, j]
            square = wp.dot(d, d)
            if square > best:
                best = square
                chord = d
    squares[row] = best
    chords[row] = chord


def caliper_dimensions(hull: Hull) -> Caliper:
    """Length, width and thickness between jaws and between points, and the least width.

    Parameters
    ----------
    hull : Hull

    Returns
    -------
    Caliper
        Exact for the hull's vertices, to rounding.  Where two lengths are equal (a box has four), one is taken.

    References
    ----------
    ASTM D4791. Standard test method for flat particles, elongated particles, or flat and elongated particles in
    coarse aggregate.
    Garboczi, E. J. (2002). Three-dimensional mathematical analysis of particle shape using X-ray tomography and
    spherical harmonics. Cem. Concr. Res. 32(10), 1621-1638.
    """
    load(_farthest_kernel.module, "cpu")
    points, exponent = hull.of_unit_size
    chord = _diameter(points)
    length = math.sqrt(float((chord**2).sum()))
    along = pointed(chord / length)
    flat = points - dot(points, along)[:, None] * along
    chord = _diameter(flat)
    across = _perpendicular(chord, along)
    through = np.cross(along, across)
    chord_width, chord_across = _widest_section(hull, points, along)
    chord_through = np.cross(along, chord_across)
    minimum, direction = least_width(hull)
    sizes = [length, *(float(np.ptp(dot(points, e))) for e in (across, through))]
    chords = [chord_width, _longest_segment(points, chord_through, math.ldexp(minimum, -exponent))]
    length, width, thickness, chord_width, chord_thickness = (math.ldexp(s, exponent) for s in (*sizes, *chords))
    return Caliper(
        length=length,
        width=width,
        thickness=thickness,
        axes=np.stack([along, across, through], axis=1),
        chord_width=chord_width,
        chord_thickness=chord_thickness,
        chord_axes=np.stack([along, chord_across, chord_through], axis=1),
        minimum_width=minimum,
        minimum_width_direction=direction,
    )


def _diameter(points: np.ndarray) -> np.ndarray:
    """Difference of the two points that are farthest apart, shape (3,)."""
    radii = np.sqrt((points**2).sum(axis=1))
    order = np.argsort(-radii, kind="stable")
    ordered, radii = np.ascontiguousarray(points[order]), radii[order]
    # Twice to the farthest point: a length nearly as great as the greatest.
    bound, start = 0.0, ordered[0]
    for _ in range(2):
        squares = ((ordered - start) ** 2).sum(axis=1)
        start, bound = ordered[np.argmax(squares)], math.sqrt(float(squares.max()))
    squares, partners = (wp.empty(len(points), dtype=d, device="cpu") for d in (wp.float64, wp.int32))
    inputs = [shared_array(ordered, wp.vec3d), shared_array(radii, wp.float64), wp.float64(bound * (1.0 - 1e-12))]
    wp.launch(_farthest_kernel, dim=len(points), inputs=[*inputs, squares, partners], device="cpu")
    best = int(np.argmax(squares.numpy()))
    return ordered[best] - ordered[partners.numpy()[best]]


def _widest_section(hull: Hull, points: np.ndarray, axis: np.ndarray) -> tuple[float, np.ndarray]:
    """Length and direction of the longest segment in the hull across an axis.

    Its ends lie on two edges; between the levels of vertices they move linearly, so that their squared distance is
    convex in the level, and greatest at a vertex.
    """
    levels = dot(points, axis)
    edges = shared_array(hull.edges, wp.vec4i)
    inputs = [shared_array(points, wp.vec3d), edges, shared_array(levels, wp.float64)]
    batch = min(len(points), max(1, _SCRATCH // len(hull.edges)))
    cuts = wp.empty((batch, len(hull.edges) + 1), dtype=wp.vec3d, device="cpu")
    counts, bounds = (wp.empty(batch, dtype=d, device="cpu") for d in (wp.int32, wp.vec2d))
    long, best, direction = 0.0, 0.0, axis
    for start in range(0, len(points), batch):
        size = min(batch, len(points) - start)
        wp.launch(_section_kernel, dim=size, inputs=[*inputs, start, cuts, counts, bounds], device="cpu")
        lower, upper = bounds.numpy()[:size].T
        long = max(long, float(lower.max()))
        rows = np.flatnonzero(upper >= long).astype(np.int32)
        if len(rows) == 0:
            continue
        squares, chords = (wp.empty(len(rows), dtype=d, device="cpu") for d in (wp.float64, wp.vec3d))
        found = [shared_array(rows, wp.int32), cuts, counts, squares, chords]
        wp.launch(_chord_kernel, dim=len(rows), inputs=found, device="cpu")
        place = int(np.argmax(squares.numpy()))
        if squares.numpy()[place] > best:
            best, direction = float(squares.numpy()[place]), chords.numpy()[place].copy()
    return math.sqrt(best), _perpendicular(direction, axis)


def _longest_segment(points: np.ndarray, axis: np.ndarray, least: float) -> float:
    """Length of the longest segment in the hull along an axis t: the least extent along n over all n with n . t = 1.

    The extent is the largest of linear functions of n (one for each chord of the body), so that the least is found by
    cutting planes: a dual simplex over (n . u, n . v, extent), u and v across the axis.
    """
    u = _perpendicular(np.eye(3)[np.argmin(np.abs(axis))], axis)
    rows = [dot(points, e) for e in (axis, u, np.cross(axis, u))]
    height = float(np.ptp(rows[0]))
    # The extent along n is at least |n| times the least width, and at the least no more than that along t.
    reach = 2.0 * height / least
    basis, bounds, x = np.eye(3), np.zeros(3), np.zeros(3)
    for cut in range(_CUTS):
        row, bound = np.zeros(3), -reach
        outside = np.flatnonzero(np.abs(x[:2]) > reach * (1.0 + 1e-9))
        if len(outside):
            row[outside[0]] = -np.sign(x[outside[0]])
        else:
            heights = rows[0] + x[0] * rows[1] + x[1] * rows[2]
            top, bottom = int(np.argmax(heights)), int(np.argmin(heights))
            if cut and heights[top] - heights[bottom] - x[2] <= 1e-14 * height:
                break
            slope = [float(r[top] - r[bottom]) for r in rows]
            row, bound = np.array([-slope[1], -slope[2], 1.0]), slope[0]
        if cut == 0:
            basis = np.diag([1.0 if -r >= 0.0 else -1.0 for r in row[:2]] + [1.0])
            basis[2], bounds = row, np.array([-reach, -reach, bound])
        else:
            inverse = np.linalg.inv(basis)
            along = (row[:, None] * inverse).sum(axis=0)
            ratios = np.where(along > 1e-13, inverse[2] / np.where(along > 1e-13, along, 1.0), math.inf)
            leaving = int(np.argmin(ratios))
            basis[leaving], bounds[leaving] = row, bound
        x = np.linalg.solve(basis, bounds)
    return float(x[2])


def _perpendicular(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Unit vector along the part of a vector that is perpendicular to a unit axis, in the sense of `pointed`."""
    part = vector - float((vector * axis).sum()) * axis
    part = part / math.sqrt(float((part**2).sum()))
    part = part - float((part * axis).sum()) * axis
    return pointed(part / math.sqrt(float((part**2).sum())))
