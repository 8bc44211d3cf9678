"""Distance of two convex polyhedra by the Gilbert-Johnson-Keerthi algorithm, warm-started: device functions.

A polyhedron is its vertices and, of each vertex, its neighbours on the hull.  The farthest vertex in a direction is
found by climbing from neighbour to neighbour, which on a convex body ends at the farthest one.  The simplex of a pair,
its at most three pairs of vertices, is kept from step to step, so that most calls end after one iteration.

References: Gilbert, Johnson and Keerthi (1988), IEEE J. Robot. Autom. 4:193; Cameron (1997), ICRA, 3112 (climbing);
van den Bergen (2001), GDC, on when to end; Ericson (2005), Real-Time Collision Detection, 5.1 (regions of a triangle).
"""

from __future__ import annotations

from lithoform.warp_runtime import MODULE_OPTIONS, wp

__all__ = ["Hulls", "Nearest", "Simplex", "distance_pairs", "gjk", "support"]

wp.set_module_options(MODULE_OPTIONS)

_F = wp.float64
_V = wp.vec3d
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_HUGE = wp.constant(wp.float64(1e300))
# The bounds of the distance are at most this share apart when the search ends.
_RELATIVE = wp.constant(wp.float64(1e-13))
# A tetrahedron flatter than this share of the product of its edges has no inside.
_FLAT = wp.constant(wp.float64(1e-13))
_MOST_ITERATIONS = wp.constant(64)
# Iterations without getting nearer before the search ends, and the share by which the square may be farther in them.
_MOST_STALLS = wp.constant(12)
_NO_FARTHER = wp.constant(wp.float64(1.0 + 1e-14))

_Points = wp.types.matrix((4, 3), wp.float64)
_Four = wp.types.vector(4, wp.float64)
_Indices = wp.types.vector(4, wp.int32)


@wp.struct
class Hulls:
    """Convex cores of all shapes, one after the other.

    vertices : frame of the shape [m]; first : of each shape its first vertex, shapes + 1 entries; adjacency_first : of
    each vertex its first entry in adjacency; adjacency : neighbours, counted from the first vertex of the shape.
    """

    vertices: wp.array(dtype=wp.vec3d)
    first: wp.array(dtype=wp.int32)
    adjacency_first: wp.array(dtype=wp.int32)
    adjacency: wp.array(dtype=wp.int32)


@wp.struct
class Simplex:
    """Pairs of vertices of the last simplex: their number (0 at the start), and their indices on both bodies."""

    count: wp.int32
    a0: wp.int32
    a1: wp.int32
    a2: wp.int32
    b0: wp.int32
    b1: wp.int32
    b2: wp.int32


@wp.struct
class Nearest:
    """What the search found, in the frame of body A.

    separation : point of A less point of B where they are nearest [m]; point : that of A; lower : a distance that the
    bodies certainly have [m]; complete : 1 if these are nearest points, 0 if only `lower` is known; overlap : 1 if the
    cores touch or overlap; simplex : to be kept for the next call; iterations.
    """

    separation: wp.vec3d
    point: wp.vec3d
    lower: wp.float64
    complete: wp.int32
    overlap: wp.int32
    simplex: Simplex
    iterations: wp.int32


@wp.func
def support(hulls: Hulls, first: wp.int32, start: wp.int32, direction: wp.vec3d) -> wp.int32:
    """Farthest vertex of a hull in a direction (its number within the shape), climbing from vertex `start`."""
    best = start
    height = wp.dot(hulls.vertices[first + start], direction)
    climbing = bool(True)
    while climbing:
        here = best
        for edge in range(hulls.adjacency_first[first + here], hulls.adjacency_first[first + here + 1]):
            other = hulls.adjacency[edge]
            reached = wp.dot(hulls.vertices[first + other], direction)
            if reached > height:
                height = reached
                best = other
        if best == here:
            climbing = False
    return best


@wp.func
def _on_segment(a: wp.vec3d, b: wp.vec3d) -> wp.vec3d:
    """Weights of (a, b, -) of the point of a segment that is nearest to the origin."""
    along = b - a
    t = -wp.dot(a, along)
    if t <= _ZERO:
        return wp.vec3d(_ONE, _ZERO, _ZERO)
    length = wp.dot(along, along)
    if t >= length:
        return wp.vec3d(_ZERO, _ONE, _ZERO)
    t = t / length
    return wp.vec3d(_ONE - t, t, _ZERO)


@wp.func
def _on_triangle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.vec3d:
    """Weights of (a, b, c) of the point of a triangle that is nearest to the origin."""
    u = b - a
    v = c - a
    d1 = -wp.dot(u, a)
    d2 = -wp.dot(v, a)
    if d1 <= _ZERO and d2 <= _ZERO:
        return wp.vec3d(_ONE, _ZERO, _ZERO)
    d3 = -wp.dot(u, b)
    d4 = -wp.dot(v, b)
    if d3 >= _ZERO and d4 <= d3:
        return wp.vec3d(_ZERO, _ONE, _ZERO)
    vc = d1 * d4 - d3 * d2
    if vc <= _ZERO and d1 >= _ZERO and d3 <= _ZERO:
        return _on_segment(a, b)
    d5 = -wp.dot(u, c)
    d6 = -wp.dot(v, c)
    if d6 >= _ZERO and d5 <= d6:
        return wp.vec3d(_ZERO, _ZERO, _ONE)
    vb = d5 * d2 - d1 * d6
    if vb <= _ZERO and d2 >= _ZERO and d6 <= _ZERO:
        on = _on_segment(a, c)
        return wp.vec3d(on[0], _ZERO, on[1])
    va = d3 * d6 - d5 * d4
    if va <= _ZERO and d4 >= d3 and d5 >= d6:
        on = _on_segment(b, c)
        return wp.vec3d(_ZERO, on[0], on[1])
    scale = _ONE / (va + vb + vc)
    y = vb * scale
    z = vc * scale
    return wp.vec3d(_ONE - y - z, y, z)


@wp.func
def _beyond(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d) -> bool:
    """Whether the origin and d are on different sides of the plane abc, or d is on it."""
    normal = wp.cross(b - a, c - a)
    return wp.dot(a, normal) * wp.dot(d - a, normal) >= _ZERO


@wp.func
def _nearest_weights(w: _Points, count: wp.int32) -> _Four:
    """Weights of the point of a simplex that is nearest to the origin; all 0 if the origin is inside a tetrahedron."""
    a = w[0]
    if count == 1:
        return _Four(_ONE, _ZERO, _ZERO, _ZERO)
    b = w[1]
    if count == 2:
        on = _on_segment(a, b)
        return _Four(on[0], on[1], _ZERO, _ZERO)
    c = w[2]
    if count == 3:
        on = _on_triangle(a, b, c)
        return _Four(on[0], on[1], on[2], _ZERO)
    d = w[3]
    u = b - a
    v = c - a
    t = d - a
    product = wp.length(u) * wp.length(v) * wp.length(t)
    flat = wp.abs(wp.dot(wp.cross(u, v), t)) <= _FLAT * product
    best = _HUGE
    weights = _Four(_ZERO, _ZERO, _ZERO, _ZERO)
    if flat or _beyond(a, b, c, d):
        on = _on_triangle(a, b, c)
        p = a * on[0] + b * on[1] + c * on[2]
        square = wp.dot(p, p)
        if square < best:
            best = square
            weights = _Four(on[0], on[1], on[2], _ZERO)
    if flat or _beyond(a, c, d, b):
        on = _on_triangle(a, c, d)
        p = a * on[0] + c * on[1] + d * on[2]
        square = wp.dot(p, p)
        if square < best:
            best = square
            weights = _Four(on[0], _ZERO, on[1], on[2])
    if flat or _beyond(a, d, b, c):
        on = _on_triangle(a, d, b)
        p = a * on[0] + d * on[1] + b * on[2]
        square = wp.dot(p, p)
        if square < best:
            best = square
            weights = _Four(on[0], on[2], _ZERO, on[1])
    if flat or _beyond(b, d, c, a):
        on = _on_triangle(b, d, c)
        p = b * on[0] + d * on[1] + c * on[2]
        square = wp.dot(p, p)
        if square < best:
            best = square
            weights = _Four(_ZERO, on[0], on[2], on[1])
    return weights


@wp.func
def gjk(
    hulls: Hulls,
    first_a: wp.int32,
    first_b: wp.int32,
    scale_a: wp.float64,
    scale_b: wp.float64,
    rotation: wp.mat33d,
    offset: wp.vec3d,
    cache: Simplex,
    far: wp.float64,
) -> Nearest:
    """Nearest points of two cores.

    Parameters
    ----------
    hulls, first_a, first_b, scale_a, scale_b
        The cores: first vertex of each, and the factor on its vertices.
    rotation, offset
        Pose of B in the frame of A: a point p of B lies at rotation p + offset [m].
    cache
        Simplex to begin with.
    far
        The search may end early once the bodies are known to be farther apart than this and the bound is at least
        half of the distance [m].
    """
    found = Nearest()
    count = cache.count
    ia = _Indices(cache.a0, cache.a1, cache.a2, 0)
    ib = _Indices(cache.b0, cache.b1, cache.b2, 0)
    if count == 0:
        count = wp.int32(1)
    w = _Points()
    pa = _Points()
    for k in range(count):
        p = hulls.vertices[first_a + ia[k]] * scale_a
        pa[k] = p
        w[k] = p - (rotation @ (hulls.vertices[first_b + ib[k]] * scale_b) + offset)
    separation = wp.vec3d(_ZERO, _ZERO, _ZERO)
    point = wp.vec3d(_ZERO, _ZERO, _ZERO)
    square = _ZERO
    # The nearest found so far: what rounding makes worse is not kept.
    best = _F(1e300)
    best_separation = wp.vec3d(_ZERO, _ZERO, _ZERO)
    best_point = wp.vec3d(_ZERO, _ZERO, _ZERO)
    best_count = wp.int32(0)
    best_a = _Indices(0, 0, 0, 0)
    best_b = _Indices(0, 0, 0, 0)
    stalls = wp.int32(0)
    lower = _F(0.0)
    complete = wp.int32(1)
    overlap = wp.int32(0)
    iterations = wp.int32(0)
    polishing = bool(False)
    searching = bool(True)
    back = wp.transpose(rotation)
    while searching:
        if polishing:
            # Of a triangle as thin as those of needles the weights are not enough: what lies in its plane is taken off.
            normal = wp.cross(w[1] - w[0], w[2] - w[0])
            area = wp.dot(normal, normal)
            if area > _ZERO:
                separation = normal * (wp.dot(normal, separation) / area)
        else:
            weights = _nearest_weights(w, count)
            kept = wp.int32(0)
            separation = wp.vec3d(_ZERO, _ZERO, _ZERO)
            point = wp.vec3d(_ZERO, _ZERO, _ZERO)
            for k in range(count):
                if weights[k] > _ZERO:
                    separation += weights[k] * w[k]
                    point += weights[k] * pa[k]
                    if kept != k:
                        w[kept] = w[k]
                        pa[kept] = pa[k]
                        ia[kept] = ia[k]
                        ib[kept] = ib[k]
                    kept += 1
            count = kept
        square = wp.dot(separation, separation)
        iterations += 1
        if count == 0 or square == _ZERO:
            overlap = wp.int32(1)
            searching = False
        elif square < best:
            best = square
            best_separation = separation
            best_point = point
            best_count = count
            best_a = ia
            best_b = ib
            stalls = wp.int32(0)
        else:
            # No nearer than before.  Between faces that are all but parallel the next vertices still lead on, by less
            # than rounding at first; what is farther by more than that is the limit of the arithmetic.
            stalls += 1
            if stalls > _MOST_STALLS or square > best * _NO_FARTHER:
                searching = False
        if iterations >= _MOST_ITERATIONS:
            searching = False
        if searching:
            na = support(hulls, first_a, ia[0], -separation)
            nb = support(hulls, first_b, ib[0], back @ separation)
            p = hulls.vertices[first_a + na] * scale_a
            q = p - (rotation @ (hulls.vertices[first_b + nb] * scale_b) + offset)
            along = wp.dot(separation, q)
            if along > _ZERO:
                lower = wp.max(lower, along / wp.sqrt(square))
            known = bool(False)
            for k in range(count):
                if ia[k] == na and ib[k] == nb:
                    known = True
            if square - along <= _RELATIVE * square:
                searching = False
            elif known:
                searching = count == 3 and not polishing
                polishing = True
            elif lower > far and lower * lower * _F(4.0) > square:
                complete = wp.int32(0)
                searching = False
            else:
                polishing = False
                w[count] = q
                pa[count] = p
                ia[count] = na
                ib[count] = nb
                count += 1
    if overlap == 0:
        separation = best_separation
        point = best_point
        count = best_count
        ia = best_a
        ib = best_b
    found.separation = separation
    found.point = point
    found.lower = lower
    found.complete = complete
    found.overlap = overlap
    found.iterations = iterations
    found.simplex.count = wp.min(count, 3)
    found.simplex.a0 = ia[0]
    found.simplex.a1 = ia[1]
    found.simplex.a2 = ia[2]
    found.simplex.b0 = ib[0]
    found.simplex.b1 = ib[1]
    found.simplex.b2 = ib[2]
    return found


@wp.kernel
def distance_pairs(
    hulls: Hulls,
    shape: wp.array(dtype=wp.int32),
    scale: wp.array(dtype=wp.float64),
    position: wp.array(dtype=wp.vec3d),
    orientation: wp.array(dtype=wp.quatd),
    pairs: wp.array(dtype=wp.vec2i),
    caches: wp.array(dtype=Simplex),
    separation: wp.array(dtype=wp.vec3d),
    overlap: wp.array(dtype=wp.int32),
    iterations: wp.array(dtype=wp.int32),
) -> None:
    """Nearest points of pairs of cores: point of the first less point of the second, in the world's frame."""
    p = wp.tid()
    i = pairs[p][0]
    j = pairs[p][1]
    inverse = wp.quat_inverse(orientation[i])
    rotation = wp.quat_to_matrix(inverse * orientation[j])
    offset = wp.quat_rotate(inverse, position[j] - position[i])
    found = gjk(hulls, hulls.first[shape[i]], hulls.first[shape[j]], scale[i], scale[j], rotation, offset,
                caches[p], _HUGE)  # fmt: skip
    caches[p] = found.simplex
    separation[p] = wp.quat_rotate(orientation[i], found.separation)
    overlap[p] = found.overlap
    iterations[p] = found.iterations
