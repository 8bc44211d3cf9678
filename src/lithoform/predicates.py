"""Signs of orientation determinants: certified in float64 for kernels, exact in whole numbers for the rest.

The kernels of :mod:`lithoform.intersections` decide nearly every pair of faces in float64 with the certified
signs below (Shewchuk's static filter: a bound of the rounding error proportional to the permanent).  The
pairs they leave open, touching, coplanar or degenerate ones, come to :func:`faces_meet`.  A float64 is a
whole number times a power of two, so after one common scaling every determinant is a Python integer, free of
rounding; arrays of such integers (NumPy's ``object`` type) settle many pairs at a time.

References
----------
J. R. Shewchuk (1997), "Adaptive precision floating-point arithmetic and fast robust geometric predicates",
Discrete and Computational Geometry 18(3), 305-363: the error bounds.
P. Guigue and O. Devillers (2003), "Fast and robust triangle-triangle overlap test using orientation
predicates", Journal of Graphics Tools 8(1), 25-32: the decision from signs of orientation determinants alone.
I. E. Sutherland and G. W. Hodgman (1974), "Reentrant polygon clipping", Communications of the ACM 17(1),
32-42: the clipping used for faces of zero area.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from lithoform.warp_runtime import wp

__all__ = [
    "certain_sign",
    "faces_meet",
    "gap_between",
    "normal_of",
    "normal_reach",
    "parted_by",
    "side_of",
]

# Relative to the permanent (the same expression with every term positive), a computed orientation determinant
# is off by at most 8 u + O(u^2), u = 2^-53: 1 u from each of three differences, two products and three sums.
# The permanent itself is computed with a relative error of the same order, which makes an O(u^2) here.  12 u
# leaves room for that and for one more sum, and also holds where a compiler fuses multiplications and
# additions.
_ROUNDING = wp.constant(wp.float64(12.0 * 2.0**-53))
# Products of tiny numbers may underflow.  For coordinates of size at most 1, these losses add up to less than
# 1e-320.
_UNDERFLOW = wp.constant(wp.float64(1e-300))

# Pairs decided at a time: each holds some hundred Python integers, so memory stays near 100 MB.
_CHUNK = 16384


@wp.func
def _absolute(u: wp.vec3d) -> wp.vec3d:
    return wp.vec3d(wp.abs(u[0]), wp.abs(u[1]), wp.abs(u[2]))


@wp.func
def certain_sign(value: wp.float64, permanent: wp.float64) -> int:
    """Sign of the exact value, or 0 where rounding leaves it open (a NaN or infinite permanent included)."""
    bound = _ROUNDING * permanent + _UNDERFLOW
    if value > bound:
        return 1
    if value < -bound:
        return -1
    return 0


@wp.func
def normal_of(u: wp.vec3d, v: wp.vec3d) -> wp.vec3d:
    """Cross product, written out so that its rounding is known."""
    return wp.vec3d(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@wp.func
def normal_reach(u: wp.vec3d, v: wp.vec3d) -> wp.vec3d:
    """Permanents of the components of ``normal_of(u, v)``."""
    a = _absolute(u)
    b = _absolute(v)
    return wp.vec3d(a[1] * b[2] + a[2] * b[1], a[2] * b[0] + a[0] * b[2], a[0] * b[1] + a[1] * b[0])


@wp.func
def side_of(normal: wp.vec3d, reach: wp.vec3d, offset: wp.vec3d) -> int:
    """Certain sign of the orientation determinant, the dot product of a ``normal_of`` with an offset."""
    return certain_sign(wp.dot(normal, offset), wp.dot(reach, _absolute(offset)))


@wp.func
def gap_between(
    normal: wp.vec3d,
    a: wp.vec3d, b: wp.vec3d, c: wp.vec3d,
    p: wp.vec3d, q: wp.vec3d, r: wp.vec3d,
) -> bool:  # fmt: skip
    """Whether a plane across ``normal``, an arbitrary vector, certainly has abc below and pqr above it."""
    size = _absolute(normal)
    # Offsets from one corner, so that a far-away mesh is measured as well as one at the origin.
    u = b - a
    v = c - a
    x = p - a
    y = q - a
    z = r - a
    loss_u = _ROUNDING * wp.dot(size, _absolute(u)) + _UNDERFLOW
    loss_v = _ROUNDING * wp.dot(size, _absolute(v)) + _UNDERFLOW
    loss_x = _ROUNDING * wp.dot(size, _absolute(x)) + _UNDERFLOW
    loss_y = _ROUNDING * wp.dot(size, _absolute(y)) + _UNDERFLOW
    loss_z = _ROUNDING * wp.dot(size, _absolute(z)) + _UNDERFLOW
    top = wp.max(wp.float64(0.0), wp.max(wp.dot(normal, u) + loss_u, wp.dot(normal, v) + loss_v))
    bottom = wp.min(
        wp.dot(normal, x) - loss_x,
        wp.min(wp.dot(normal, y) - loss_y, wp.dot(normal, z) - loss_z),
    )
    return top < bottom


@wp.func
def parted_by(normal: wp.vec3d, a: wp.vec3d, b: wp.vec3d, p: wp.vec3d, q: wp.vec3d) -> bool:
    """Whether the plane through the origin across ``normal``, any vector, certainly parts a, b from p, q."""
    size = _absolute(normal)
    return (
        side_of(normal, size, a) > 0
        and side_of(normal, size, b) > 0
        and side_of(normal, size, p) < 0
        and side_of(normal, size, q) < 0
    )


def faces_meet(vertices: np.ndarray, faces: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Decide exactly which pairs of faces share a point besides their common vertices and edge.

    Parameters
    ----------
    vertices : ndarray, shape (vertices, 3), float64
        Finite coordinates, any unit.
    faces : ndarray, shape (faces, 3), integer
        Vertex numbers of each triangle.  Faces of zero area count as the segment or point they cover.
    first, second : ndarray, shape (pairs,), integer
        Face numbers of each pair.

    Returns
    -------
    ndarray, shape (pairs,), bool
        True where the two faces intersect, by the definition of
        :func:`lithoform.intersections.find_self_intersections`.
    """
    verdict = np.zeros(len(first), dtype=bool)
    for start in range(0, len(first), _CHUNK):
        part = slice(start, start + _CHUNK)
        used, local = np.unique(np.stack([faces[first[part]], faces[second[part]]]), return_inverse=True)
        points = _whole_numbers(vertices[used])
        f, g = local.reshape(2, -1, 3)
        verdict[part] = _decide(points, f, g)
    return verdict


def _whole_numbers(points: np.ndarray) -> np.ndarray:
    """Multiply float64 values by one common power of two that makes all of them integers, shape kept."""
    mantissa, exponent = np.frexp(points)
    whole = np.ldexp(mantissa, 53).astype(np.int64)
    # Strip trailing zero bits: coordinates on a grid become short integers, whose products are much faster.
    zeros = np.frexp((whole & -whole).astype(np.float64))[1] - 1
    zeros[whole == 0] = 0
    exponent = exponent.astype(np.int64) + zeros
    return (whole >> zeros).astype(object) << (exponent - exponent.min()).astype(object)


def _decide(points: np.ndarray, f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Sort pairs by the number of common vertices and by degeneracy, and decide each kind."""
    same = f[:, :, None] == g[:, None, :]
    shared_f, shared_g = same.any(axis=2), same.any(axis=1)
    count = shared_f.sum(axis=1)
    # A face that names a vertex twice has fewer than three to share.
    repeats = (f[:, 0] == f[:, 1]) | (f[:, 1] == f[:, 2]) | (f[:, 2] == f[:, 0])
    verdict = (count == 3) & ~repeats

    flat_faces = _has_no_area(points, f) | _has_no_area(points, g)
    for row in np.flatnonzero(flat_faces & ~verdict):
        common = sorted(set(f[row]) & set(g[row]))
        a, b, known = ([tuple(points[k]) for k in numbers] for numbers in (f[row], g[row], common))
        verdict[row] = _clip_meets(a, b, known)

    def corners(rows: np.ndarray, face: np.ndarray, leader: np.ndarray) -> list[np.ndarray]:
        """Coordinates, each of shape (3, rows), of a face's corners in cyclic order from ``leader``."""
        return [points[face[rows, (leader + k) % 3]].T for k in range(3)]

    for number in (0, 1):
        rows = np.flatnonzero((count == number) & ~flat_faces)
        a = corners(rows, f, shared_f[rows].argmax(axis=1))
        b = corners(rows, g, shared_g[rows].argmax(axis=1))
        verdict[rows] = _triangles_meet(a, b, share_corner=number == 1)

    rows = np.flatnonzero((count == 2) & ~flat_faces)
    apex, start, end = corners(rows, f, shared_f[rows].argmin(axis=1))
    other = corners(rows, g, shared_g[rows].argmin(axis=1))[0]
    verdict[rows] = _folded_over(start, end, apex, other)
    return verdict


def _has_no_area(points: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Whether each face has zero area, exactly."""
    p, q, r = (points[face[:, k]].T for k in range(3))
    return (_cross(q - p, r - p) == 0).all(axis=0)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def _side(normal: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Sign (-1, 0, 1) of the dot product of two arrays of shape (d, rows)."""
    return _sign((normal * offset).sum(axis=0))


def _sign(value: np.ndarray) -> np.ndarray:
    return (value > 0).astype(np.int8) - (value < 0).astype(np.int8)


def _triangles_meet(a: list[np.ndarray], b: list[np.ndarray], *, share_corner: bool) -> np.ndarray:
    """Decide for triangles of positive area; with ``share_corner``, ``a[0]`` is ``b[0]`` and does not count.

    Out of one plane, the common part is a segment, each end of which lies on an edge of one triangle that
    crosses the plane of the other.  When it starts at a common corner, its other end is on an edge opposite
    that corner.
    """
    normal_a, normal_b = _cross(a[1] - a[0], a[2] - a[0]), _cross(b[1] - b[0], b[2] - b[0])
    side_b = np.stack([_side(normal_a, p - a[0]) for p in b])
    side_a = np.stack([_side(normal_b, p - b[0]) for p in a])
    verdict = np.zeros(side_a.shape[1], dtype=bool)

    coplanar = ~side_b.any(axis=0)
    rows = np.flatnonzero(coplanar)
    if rows.size:
        flat_a, flat_b = _project(normal_a[:, rows], [p[:, rows] for p in a], [p[:, rows] for p in b])
        verdict[rows] = (_cones_meet if share_corner else _flat_triangles_meet)(flat_a, flat_b)

    apart = (abs(side_a.sum(axis=0)) == 3) | (abs(side_b.sum(axis=0)) == 3)
    rows = np.flatnonzero(~coplanar & ~apart)
    a, b = [p[:, rows] for p in a], [p[:, rows] for p in b]
    side_a, side_b = side_a[:, rows], side_b[:, rows]
    # The edge opposite the common corner is number 1; the others need no test then.
    edges = [1] if share_corner else [0, 1, 2]
    turn = np.zeros((3, 3, len(rows)), dtype=np.int8)
    for i in range(3):
        for j in range(3):
            if i in edges or j in edges:
                p, q, r, s = a[i], a[(i + 1) % 3], b[j], b[(j + 1) % 3]
                turn[i, j] = _side(_cross(q - p, r - p), s - p)
    for k in edges:
        for side, turns in ((side_a, turn[k]), (side_b, turn[:, k])):
            tail, head = side[k], side[(k + 1) % 3]
            crosses_plane = (tail * head <= 0) & (tail != head)
            verdict[rows] |= crosses_plane & ~((turns > 0).any(axis=0) & (turns < 0).any(axis=0))
    return verdict


def _project(normal: np.ndarray, *corner_lists: list[np.ndarray]) -> list[list[np.ndarray]]:
    """Drop, in each row, a coordinate along which the normal is not zero: one-to-one on that plane."""
    axis = (normal != 0).argmax(axis=0)
    rows = np.arange(len(axis))
    return [[np.stack([p[(axis + k) % 3, rows] for k in (1, 2)]) for p in corners] for corners in corner_lists]


def _turn(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Sign of the signed area of the plane triangles p, q, r, each of shape (2, rows)."""
    u, v = q - p, r - p
    return _sign(u[0] * v[1] - u[1] * v[0])


def _flat_triangles_meet(a: list[np.ndarray], b: list[np.ndarray]) -> np.ndarray:
    """Two closed plane triangles are disjoint only if an edge of one has the other strictly outside."""
    separated = np.zeros(a[0].shape[1], dtype=bool)
    for inner, outer in ((a, b), (b, a)):
        winding = _turn(*inner)
        for k in range(3):
            sides = [_turn(inner[k], inner[(k + 1) % 3], p) for p in outer]
            separated |= (np.stack(sides) * winding == -1).all(axis=0)
    return ~separated


def _cones_meet(a: list[np.ndarray], b: list[np.ndarray]) -> np.ndarray:
    """Two plane triangles with a common corner 0 share more iff a side from it lies in the other's angle."""
    meet = np.zeros(a[0].shape[1], dtype=bool)
    for cone, rays in ((a, b), (b, a)):
        winding = _turn(*cone)
        for tip in rays[1:]:
            meet |= (_turn(cone[0], cone[1], tip) * winding >= 0) & (_turn(cone[0], tip, cone[2]) * winding >= 0)
    return meet


def _folded_over(start: np.ndarray, end: np.ndarray, apex: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Two triangles on one edge share more iff both apexes are on one side of it in one plane."""
    normal = _cross(end - start, apex - start)
    normal_other = _cross(end - start, other - start)
    return (_side(normal, other - start) == 0) & (_side(normal, normal_other) > 0)


Point = tuple[int, int, int]


def _clip_meets(a: list[Point], b: list[Point], common: list[Point]) -> bool:
    """Decide one pair, either of which may be a segment or a point: clip ``a`` with half-spaces of ``b``.

    ``common`` holds the zero, one or two common vertices.  Slower than the sign tests, and used where these
    have no plane to refer to.
    """
    if not any(_normal(b)):
        a, b = b, a
    polygon: list = list(a)
    for normal, origin in _half_spaces(b):
        height = [_inner(normal, _minus(p, origin)) for p in polygon]
        clipped = []
        for k, p in enumerate(polygon):
            q, h, h_next = polygon[(k + 1) % len(polygon)], height[k], height[(k + 1) % len(polygon)]
            if h >= 0:
                clipped.append(p)
            if h * h_next < 0:
                t = Fraction(h) / (h - h_next)
                clipped.append(tuple(x + t * (y - x) for x, y in zip(p, q, strict=True)))
        polygon = clipped
    if len(common) < 2:
        return any(p not in common for p in polygon)
    start, end = common
    return any(
        any(_outer(_minus(end, start), _minus(p, start))) or _inner(_minus(p, start), _minus(p, end)) > 0
        for p in polygon
    )


def _half_spaces(corners: list[Point]) -> list[tuple[Point, Point]]:
    """Return (inward normal, point on the border) of half-spaces whose common part is the given shape."""
    normal = _normal(corners)
    if any(normal):
        flat = [(normal, corners[0])]
        border = [(_outer(normal, _minus(corners[k - 2], corners[k])), corners[k]) for k in range(3)]
    else:
        tail, head = max(
            ((corners[k], corners[k - 1]) for k in range(3)),
            key=lambda ends: _inner(_minus(*ends), _minus(*ends)),
        )
        along = _minus(head, tail)
        axes = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        flat = [(_outer(axis, along) if any(along) else axis, tail) for axis in axes]
        border = [(along, tail), (_minus(tail, head), head)]
    return border + flat + [(_minus((0, 0, 0), n), p) for n, p in flat]


def _normal(corners: list[Point]) -> Point:
    return _outer(_minus(corners[1], corners[0]), _minus(corners[2], corners[0]))


def _minus(p: Point, q: Point) -> Point:
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


def _inner(u: Point, v: Point) -> int:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _outer(u: Point, v: Point) -> Point:
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
