"""Which faces of a triangle mesh intersect: an exact answer, from float64 filters backed by whole numbers.

Broad phase: a bounding volume hierarchy over the faces.  Narrow phase: for each pair of faces whose boxes
touch, a Warp kernel first looks for a plane that separates them, then evaluates orientation determinants in
float64.  Each computed number comes with a bound of its rounding error (Shewchuk's static filter: a multiple
of the permanent), and counts only if it is larger.  Pairs that stay open go to :mod:`lithoform.predicates`,
which decides them exactly.  No tolerance enters the answer.

References
----------
J. R. Shewchuk (1997), "Adaptive precision floating-point arithmetic and fast robust geometric predicates",
Discrete and Computational Geometry 18(3), 305-363: the error bounds.
P. Guigue and O. Devillers (2003), "Fast and robust triangle-triangle overlap test using orientation
predicates", Journal of Graphics Tools 8(1), 25-32: the decision from signs of orientation determinants alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lithoform.errors import MeshError
from lithoform.predicates import (
    certain_sign,
    faces_meet,
    gap_between,
    normal_of,
    normal_reach,
    parted_by,
    side_of,
)
from lithoform.warp_runtime import MODULE_OPTIONS, load, resolve_device, to_device, wp

__all__ = ["find_self_intersections"]

wp.set_module_options(MODULE_OPTIONS)

# What the narrow phase can say of a pair of faces; the order matters where the largest is taken.
_APART = wp.constant(0)
_MEET = wp.constant(1)
_OPEN = wp.constant(2)

# Faces in a leaf of the hierarchy: of 1, 2, 4 and 8, the shortest build and search for 20,000 faces.
_LEAF_SIZE = 4


@wp.func
def _edge_meets(p: wp.vec3d, q: wp.vec3d, side_p: int, side_q: int, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> int:
    """Whether edge pq, whose ends lie on these sides of the plane of abc, meets that triangle."""
    if side_p * side_q > 0:
        return _APART
    along = q - p
    u = a - p
    v = b - p
    w = c - p
    normal = normal_of(along, u)
    reach = normal_reach(along, u)
    turn_0 = side_of(normal, reach, v)
    turn_2 = -side_of(normal, reach, w)
    turn_1 = side_of(normal_of(along, v), normal_reach(along, v), w)
    # The line pq turns both ways about the border of abc: it passes outside, in a common plane or not.
    if wp.max(turn_0, wp.max(turn_1, turn_2)) - wp.min(turn_0, wp.min(turn_1, turn_2)) == 2:
        return _APART
    if side_p * side_q < 0 and wp.abs(turn_0 + turn_1 + turn_2) == 3:
        return _MEET
    return _OPEN


@wp.func
def _classify_separate(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, p: wp.vec3d, q: wp.vec3d, r: wp.vec3d) -> int:
    """Two faces without a common vertex."""
    centres = (p - a) + (q - b) + (r - c)
    if gap_between(centres, a, b, c, p, q, r):
        return _APART
    normal = normal_of(b - a, c - a)
    reach = normal_reach(b - a, c - a)
    side_p = side_of(normal, reach, p - a)
    side_q = side_of(normal, reach, q - a)
    side_r = side_of(normal, reach, r - a)
    if wp.abs(side_p + side_q + side_r) == 3:
        return _APART
    other_normal = normal_of(q - p, r - p)
    other_reach = normal_reach(q - p, r - p)
    side_a = side_of(other_normal, other_reach, a - p)
    side_b = side_of(other_normal, other_reach, b - p)
    side_c = side_of(other_normal, other_reach, c - p)
    if wp.abs(side_a + side_b + side_c) == 3:
        return _APART
    # Long thin triangles in nearly one plane: the line between the centres, in the affine frame of abc.
    along_b = wp.cross(c - a, normal)
    along_c = wp.cross(normal, b - a)
    if gap_between(wp.dot(along_b, centres) * along_b + wp.dot(along_c, centres) * along_c, a, b, c, p, q, r):
        return _APART
    ab = _edge_meets(a, b, side_a, side_b, p, q, r)
    bc = _edge_meets(b, c, side_b, side_c, p, q, r)
    ca = _edge_meets(c, a, side_c, side_a, p, q, r)
    pq = _edge_meets(p, q, side_p, side_q, a, b, c)
    qr = _edge_meets(q, r, side_q, side_r, a, b, c)
    rp = _edge_meets(r, p, side_r, side_p, a, b, c)
    if ab == _MEET or bc == _MEET or ca == _MEET or pq == _MEET or qr == _MEET or rp == _MEET:
        return _MEET
    if wp.max(ab, wp.max(bc, wp.max(ca, wp.max(pq, wp.max(qr, rp))))) == _APART:
        return _APART
    return _OPEN


@wp.func
def _classify_corner(v: wp.vec3d, a: wp.vec3d, b: wp.vec3d, p: wp.vec3d, q: wp.vec3d) -> int:
    """Two faces vab and vpq with one common vertex v."""
    va = a - v
    vb = b - v
    vp = p - v
    vq = q - v
    # Across the difference of the bisectors: this parts nearly all neighbours, flat ones included.
    if parted_by(wp.normalize(va) + wp.normalize(vb) - wp.normalize(vp) - wp.normalize(vq), va, vb, vp, vq):
        return _APART
    normal = normal_of(va, vb)
    reach = normal_reach(va, vb)
    side_p = side_of(normal, reach, vp)
    side_q = side_of(normal, reach, vq)
    if side_p * side_q > 0:
        return _APART
    other_normal = normal_of(vp, vq)
    other_reach = normal_reach(vp, vq)
    side_a = side_of(other_normal, other_reach, va)
    side_b = side_of(other_normal, other_reach, vb)
    if side_a * side_b > 0:
        return _APART
    # Long thin triangles in nearly one plane: the difference of the bisectors, in the affine frame of vab.
    along_a = wp.cross(vb, normal)
    along_b = wp.cross(normal, va)
    flat_p = wp.normalize(wp.vec2d(wp.dot(along_a, vp), wp.dot(along_b, vp)))
    flat_q = wp.normalize(wp.vec2d(wp.dot(along_a, vq), wp.dot(along_b, vq)))
    weight = wp.vec2d(wp.float64(1.0), wp.float64(1.0)) - flat_p - flat_q
    if parted_by(weight[0] * along_a + weight[1] * along_b, va, vb, vp, vq):
        return _APART
    # The common part, if longer than v, ends on an edge opposite v.
    ab = _edge_meets(a, b, side_a, side_b, v, p, q)
    pq = _edge_meets(p, q, side_p, side_q, v, a, b)
    if ab == _MEET or pq == _MEET:
        return _MEET
    if ab == _APART and pq == _APART:
        return _APART
    return _OPEN


@wp.func
def _classify_edge(start: wp.vec3d, end: wp.vec3d, apex: wp.vec3d, other: wp.vec3d) -> int:
    """Two faces on the common edge from ``start`` to ``end``."""
    along = end - start
    normal = normal_of(along, apex - start)
    reach = normal_reach(along, apex - start)
    if side_of(normal, reach, other - start) != 0:
        return _APART
    # Nearly one plane: seen along an axis, the apexes may still certainly lie on opposite sides of the edge.
    other_normal = normal_of(along, other - start)
    other_reach = normal_reach(along, other - start)
    for k in range(3):
        if certain_sign(normal[k], reach[k]) * certain_sign(other_normal[k], other_reach[k]) < 0:
            return _APART
    return _OPEN


@wp.func
def _classify(vertices: wp.array(dtype=wp.vec3d), f: wp.vec3i, g: wp.vec3i) -> int:
    """Decide two faces of a mesh, or leave them open."""
    if f[0] == f[1] or f[1] == f[2] or f[2] == f[0] or g[0] == g[1] or g[1] == g[2] or g[2] == g[0]:
        return _OPEN
    shared = int(0)
    sum_f = int(0)
    sum_g = int(0)
    for k in range(3):
        for m in range(3):
            if f[k] == g[m]:
                shared += 1
                sum_f += k
                sum_g += m
    if shared == 0:
        return _classify_separate(
            vertices[f[0]], vertices[f[1]], vertices[f[2]], vertices[g[0]], vertices[g[1]], vertices[g[2]]
        )
    if shared == 1:
        return _classify_corner(
            vertices[f[sum_f]],
            vertices[f[(sum_f + 1) % 3]],
            vertices[f[(sum_f + 2) % 3]],
            vertices[g[(sum_g + 1) % 3]],
            vertices[g[(sum_g + 2) % 3]],
        )
    if shared == 2:
        # 0 + 1 + 2 less the numbers of the two common corners is the number of the third.
        apex = 3 - sum_f
        return _classify_edge(
            vertices[f[(apex + 1) % 3]],
            vertices[f[(apex + 2) % 3]],
            vertices[f[apex]],
            vertices[g[3 - sum_g]],
        )
    return _MEET


@wp.kernel
def _bound_faces(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    lower: wp.array(dtype=wp.vec3f),
    upper: wp.array(dtype=wp.vec3f),
):
    # Rounding to float32 keeps the order of numbers, so boxes that touch in float64 touch in float32 as well:
    # no pair is lost, and no outward rounding is needed.
    i = wp.tid()
    face = faces[i]
    a = vertices[face[0]]
    b = vertices[face[1]]
    c = vertices[face[2]]
    lower[i] = wp.vec3f(wp.min(a, wp.min(b, c)))
    upper[i] = wp.vec3f(wp.max(a, wp.max(b, c)))


@wp.kernel
def _count_partners(
    hierarchy: wp.uint64,
    lower: wp.array(dtype=wp.vec3f),
    upper: wp.array(dtype=wp.vec3f),
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    meeting: wp.array(dtype=wp.int32),
    undecided: wp.array(dtype=wp.int32),
):
    """For each face, the number of later faces that it meets, and of those left open."""
    i = wp.tid()
    face = faces[i]
    j = int(0)
    meets = int(0)
    opens = int(0)
    query = wp.bvh_query_aabb(hierarchy, lower[i], upper[i])
    while wp.bvh_query_next(query, j):
        if j > i:
            verdict = _classify(vertices, face, faces[j])
            if verdict == _MEET:
                meets += 1
            elif verdict == _OPEN:
                opens += 1
    meeting[i] = meets
    undecided[i] = opens


@wp.kernel
def _list_partners(
    hierarchy: wp.uint64,
    lower: wp.array(dtype=wp.vec3f),
    upper: wp.array(dtype=wp.vec3f),
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    rows: wp.array(dtype=wp.int32),
    starts: wp.array(dtype=wp.int64),
    partners: wp.array(dtype=wp.int32),
    verdicts: wp.array(dtype=wp.int32),
):
    """Write what ``_count_partners`` counted, for the faces in ``rows``, each from its own start."""
    row = wp.tid()
    i = rows[row]
    face = faces[i]
    place = starts[row]
    j = int(0)
    query = wp.bvh_query_aabb(hierarchy, lower[i], upper[i])
    while wp.bvh_query_next(query, j):
        if j > i:
            verdict = _classify(vertices, face, faces[j])
            if verdict != _APART:
                partners[place] = j
                verdicts[place] = verdict
                place += wp.int64(1)


def find_self_intersections(
    vertices: np.ndarray, faces: np.ndarray, *, limit: int | None = None, device: str = "cpu"
) -> np.ndarray:
    """Pairs of faces of a triangle mesh that intersect; the decision is exact for the float64 coordinates.

    Two faces without a common vertex intersect if they share any point: touching counts.  With one common
    vertex, they intersect if they share any other point; with a common edge, if they share any point off it
    (they are folded onto each other); with three common vertices, always.  A face of zero area counts as the
    segment or point that it covers, by the same rules.  Vertices are common if they have one number; equal
    coordinates do not make them so.

    Parameters
    ----------
    vertices : ndarray, shape (vertices, 3), float64
        Finite coordinates, any unit.
    faces : ndarray, shape (faces, 3), integer
        Vertex numbers of each triangle.
    limit : int, optional
        Return no more than this many pairs, the first in order; all by default.
    device : {"cpu", "auto", "cuda"}
        Where the kernels run.  The answer does not depend on it.

    Returns
    -------
    ndarray, shape (pairs, 2), int32
        Face numbers (i, j), i < j, in lexicographic order; empty if the mesh does not intersect itself.

    Raises
    ------
    MeshError
        If an array has another shape or type, a coordinate is not finite, a vertex number is out of range, or
        ``limit`` is negative.
    DeviceError
        If the device is unknown or not there.

    Notes
    -----
    Several threads may call this at the same time.  Pairs that the float64 filter leaves open are decided one
    by one in whole numbers, at some 10 us a pair (0.1 ms if a face has zero area); a mesh in general position
    has none, one with large areas lying exactly on each other may have many.
    """
    points, triangles = _checked_mesh(vertices, faces)
    if limit is not None and limit < 0:
        raise MeshError(f"expected a limit of at least 0 pairs, got {limit}.")
    where = resolve_device(device)
    if len(triangles) < 2 or limit == 0:
        return np.empty((0, 2), dtype=np.int32)
    load(wp.get_module(__name__), where)
    arrays = _bounded_mesh(_scaled(points), triangles, where)

    meeting, undecided = (wp.empty(len(triangles), dtype=wp.int32, device=where) for _ in range(2))
    wp.launch(_count_partners, dim=len(triangles), inputs=arrays[1:], outputs=[meeting, undecided], device=where)
    found = meeting.numpy()
    counts = found.astype(np.int64) + undecided.numpy()
    if limit is not None:
        # Later faces are not needed once the certain pairs of the earlier ones reach the limit.
        counts[np.searchsorted(np.cumsum(found, dtype=np.int64), limit) + 1 :] = 0
    rows = np.flatnonzero(counts)
    if rows.size == 0:
        return np.empty((0, 2), dtype=np.int32)

    ends = np.cumsum(counts[rows])
    partners, verdicts = (wp.empty(int(ends[-1]), dtype=wp.int32, device=where) for _ in range(2))
    inputs = [*arrays[1:], to_device(rows.astype(np.int32), wp.int32, where)]
    inputs.append(to_device(ends - counts[rows], wp.int64, where))
    wp.launch(_list_partners, dim=len(rows), inputs=inputs, outputs=[partners, verdicts], device=where)
    first, second = np.repeat(rows, counts[rows]), partners.numpy()
    accepted = verdicts.numpy() == int(_MEET)
    asked = np.flatnonzero(~accepted)
    accepted[asked] = faces_meet(points, triangles, first[asked], second[asked])
    pairs = np.stack([first[accepted], second[accepted]], axis=1).astype(np.int32)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))][:limit]


def _checked_mesh(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Float64 coordinates and int32 vertex numbers, or a MeshError that says what is wrong."""
    try:
        points = np.ascontiguousarray(vertices, dtype=np.float64)
        triangles = np.asarray(faces)
    except (TypeError, ValueError) as error:
        raise MeshError(f"expected vertices and faces as arrays of numbers, got {error}.") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"expected vertices of shape (vertices, 3), got shape {points.shape}.")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not np.issubdtype(triangles.dtype, np.integer):
        raise MeshError(f"expected faces as integers of shape (faces, 3), got {triangles.dtype}, {triangles.shape}.")
    finite = np.isfinite(points)
    if not finite.all():
        row = int(np.flatnonzero(~finite.all(axis=1))[0])
        raise MeshError(f"expected finite coordinates, got {points[row].tolist()} at vertex {row}.")
    if triangles.size and (triangles.min() < 0 or triangles.max() >= len(points)):
        wrong = triangles[(triangles < 0) | (triangles >= len(points))][0]
        raise MeshError(f"expected vertex numbers from 0 to {len(points) - 1} in faces, got {wrong}.")
    return points, np.ascontiguousarray(triangles, dtype=np.int32)


def _scaled(points: np.ndarray) -> np.ndarray:
    """Coordinates times a power of two (exact, or off by less than 1e-323), none larger than 1 in size."""
    return np.ldexp(points, -int(np.frexp(np.abs(points).max(initial=0.0))[1]))


def _bounded_mesh(points: np.ndarray, triangles: np.ndarray, where: str) -> list[Any]:
    """Return the hierarchy, to be kept while it is used, and the arguments common to the search kernels."""
    count = len(triangles)
    vertices, faces = to_device(points, wp.vec3d, where), to_device(triangles, wp.vec3i, where)
    centred = to_device(points - (points.min(axis=0) + points.max(axis=0)) / 2, wp.vec3d, where)
    lower, upper = (wp.empty(count, dtype=wp.vec3f, device=where) for _ in range(2))
    wp.launch(_bound_faces, dim=count, inputs=[centred, faces], outputs=[lower, upper], device=where)
    hierarchy = wp.Bvh(lower, upper, leaf_size=_LEAF_SIZE)
    return [hierarchy, hierarchy.id, lower, upper, vertices, faces]
