"""Holes of a triangle mesh: their loops, a surface of least area over each, refined and faired to fit its surroundings.

The first surface is the triangulation of the loop of least area, by dynamic programming (Barequet and Sharir 1995);
it is refined until its triangles are as large as those about it, by centroids and Delaunay flips, and faired so that
it goes on from its rim without a crease (Liepa 2003: the umbrella operator applied twice is zero).

References
----------
Barequet, G. and Sharir, M. (1995). Filling gaps in the boundary of a polyhedron. Comput. Aided Geom. Des. 12, 207-229.
Liepa, P. (2003). Filling holes in meshes. Proc. Eurographics Symposium on Geometry Processing, 200-205.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

__all__ = ["Lid", "boundary_loops", "fill_holes", "lids", "minimum_area_triangulation", "triangulate_polygons"]

_LONGEST_LOOP: Final = 192
"""Vertices of a loop that is triangulated as a whole, at a cost of their number cubed; longer ones are divided."""

_CHORD_WEIGHT: Final = 1e-3
"""Of the squared length of a chord, added to the area: every triangulation of a flat convex loop has one area, and
short chords give the better triangles."""

_FORBIDDEN: Final = 1e12
"""Weight, in squared sizes of the loop, of a chord that is already an edge of the mesh."""

_DENSITY: Final = math.sqrt(2.0)
"""Liepa's alpha: larger makes smaller triangles; this one matches those of the surroundings."""


@dataclass(frozen=True, eq=False)
class Lid:
    """Surface of least area over one hole.

    Attributes
    ----------
    loop : numpy.ndarray of int, shape (n,)
        Vertices of the rim, in the direction of the lid's faces.
    triangles : numpy.ndarray of int, shape (n - 2, 3)
        Vertex indices.
    area : float
        [u^2]
    rim_edges : set of (int, int)
        Edges of the mesh between vertices of the rim, the lower first: a lid may not have them a second time.
    """

    loop: np.ndarray
    triangles: np.ndarray
    area: float
    rim_edges: set[tuple[int, int]]


def boundary_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Closed loops of the open edges, each in the direction in which the faces of a cap must run.

    Parameters
    ----------
    faces : numpy.ndarray of int, shape (m, 3)
        Wound consistently, at most two on an edge, and at most one gap about each vertex.

    Returns
    -------
    list of numpy.ndarray of int
        Vertex indices, from the lowest index of a loop on; loops in the order of that index.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    base = int(faces.max()) + 1
    open_edges = ~np.isin(start * base + end, end * base + start)
    following = dict(zip(end[open_edges].tolist(), start[open_edges].tolist(), strict=True))
    loops = []
    for first in sorted(following):
        if first not in following:
            continue
        loop, here = [first], following.pop(first)
        while here != first:
            loop.append(here)
            here = following.pop(here)
        loops.append(np.array(loop))
    return loops


def minimum_area_triangulation(points: np.ndarray, forbidden: np.ndarray | None = None) -> np.ndarray:
    """Triangulations of least area of closed loops, all of n corners, by dynamic programming over chords.

    W(i, k) = min over i < m < k of W(i, m) + W(m, k) + area(i, m, k) (Barequet and Sharir 1995), with a small weight
    on the length of chords that decides between equal areas.

    Parameters
    ----------
    points : numpy.ndarray, shape (loops, n, 3)
        Corners in order, n >= 3 [u].
    forbidden : numpy.ndarray of bool, shape (n, n), optional
        Chords that are taken only if there is no other way.

    Returns
    -------
    numpy.ndarray of int, shape (loops, n - 2, 3)
        Corners of each triangle, i < m < k.
    """
    loops, n, _ = points.shape
    scale = np.ptp(points, axis=1).max(axis=1)
    x = (points - points[:, :1]) / np.where(scale > 0.0, scale, 1.0)[:, None, None]
    weight = np.zeros((loops, n, n))
    choice = np.zeros((loops, n, n), np.int64)
    for gap in range(2, n):
        i = np.arange(n - gap)
        k = i + gap
        m = i[:, None] + np.arange(1, gap)
        chord = x[:, k] - x[:, i]
        u, v = x[:, m] - x[:, i][:, :, None], chord[:, :, None]
        cross = [u[..., a] * v[..., b] - u[..., b] * v[..., a] for a, b in ((1, 2), (2, 0), (0, 1))]
        total = 0.5 * np.sqrt(cross[0] ** 2 + cross[1] ** 2 + cross[2] ** 2)
        total += weight[:, i[:, None], m] + weight[:, m, k[:, None]]
        best = total.argmin(axis=2)
        choice[:, i, k] = i + 1 + best
        cost = np.take_along_axis(total, best[:, :, None], axis=2)[:, :, 0]
        if gap < n - 1:
            cost = cost + _CHORD_WEIGHT * (chord**2).sum(axis=2)
            if forbidden is not None:
                cost = cost + _FORBIDDEN * forbidden[i, k]
        weight[:, i, k] = cost
    triangles = np.empty((loops, n - 2, 3), np.int64)
    row = np.arange(loops)
    # Every loop has n - 2 triangles, but not in one tree, so that each keeps its own stack of chords.
    stack = np.zeros((loops, n, 2), np.int64)
    stack[:, 0, 1] = n - 1
    depth = np.ones(loops, np.int64)
    for t in range(n - 2):
        depth -= 1
        i, k = stack[row, depth].T
        m = choice[row, i, k]
        triangles[:, t] = np.stack([i, m, k], axis=1)
        for a, b in ((i, m), (m, k)):
            wide = b - a > 1
            stack[row[wide], depth[wide]] = np.stack([a, b], axis=1)[wide]
            depth += wide
    return triangles


def triangulate_polygons(vertices: np.ndarray, sizes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Triangles of polygons, in the order of the polygons; those of fewer than three corners give none.

    Parameters
    ----------
    vertices : numpy.ndarray, shape (n, 3)
        A polygon with a corner that is not finite is cut from its first corner.
    sizes : numpy.ndarray of int, shape (polygons,)
        Corners of each.
    corners : numpy.ndarray of int, shape (sum of sizes,)
        Vertex indices.

    Returns
    -------
    numpy.ndarray of int64, shape (m, 3)
    """
    sizes, corners = np.asarray(sizes, np.int64), np.asarray(corners, np.int64)
    first = np.cumsum(sizes) - sizes
    rows, parts = [np.empty(0, np.int64)], [np.empty((0, 3), np.int64)]
    for size in np.unique(sizes[sizes >= 3]).tolist():
        which = np.flatnonzero(sizes == size)
        loop = corners[first[which][:, None] + np.arange(size)]
        points = np.nan_to_num(vertices[loop], nan=0.0, posinf=0.0, neginf=0.0)
        local = np.broadcast_to(np.arange(3), (len(which), 1, 3))
        if size > 3:
            local = np.concatenate([_triangulate_equal(points[i : i + 4096]) for i in range(0, len(which), 4096)])
        parts.append(np.take_along_axis(loop, local.reshape(len(which), -1), axis=1).reshape(-1, 3))
        rows.append(np.repeat(which, size - 2))
    return np.concatenate(parts)[np.argsort(np.concatenate(rows), kind="stable")]


def _triangulate_equal(points: np.ndarray) -> np.ndarray:
    if points.shape[1] <= _LONGEST_LOOP:
        return minimum_area_triangulation(points)
    return np.stack([_triangulate_loop(loop, np.arange(len(loop)), set()) for loop in points])


def _triangulate_loop(points: np.ndarray, loop: np.ndarray, existing: set[tuple[int, int]]) -> np.ndarray:
    """Triangles (corners numbered within the loop) of a loop of any length."""
    n = len(loop)
    if n > _LONGEST_LOOP:
        # A coarse loop over every step-th corner, and the strip between each of its sides and the corners skipped.
        step = math.ceil(n / _LONGEST_LOOP) * 2
        picked = np.arange(0, n, step)
        parts = [picked[_triangulate_loop(points[picked], loop[picked], existing)]]
        for a in picked.tolist():
            chain = np.arange(a, min(a + step, n) + 1)
            if len(chain) > 2:
                inside = chain % n
                # The chord that closes a strip runs from the last corner to the first.
                parts.append(inside[_triangulate_loop(points[inside], loop[inside], existing)])
        return np.concatenate(parts)
    forbidden = np.zeros((n, n), bool)
    place = {int(vertex): i for i, vertex in enumerate(loop)}
    for a, b in existing:
        if a in place and b in place:
            i, k = sorted((place[a], place[b]))
            forbidden[i, k] = k - i > 1
    return minimum_area_triangulation(points[None], forbidden)[0]


def lids(vertices: np.ndarray, faces: np.ndarray) -> list[Lid]:
    """Surface of least area over each hole.

    Parameters
    ----------
    vertices : numpy.ndarray, shape (n, 3)
        Finite [u].
    faces : numpy.ndarray of int, shape (m, 3)
        As `boundary_loops` needs them.

    Returns
    -------
    list of Lid
        In the order of `boundary_loops`; empty for a closed surface.
    """
    out = []
    for loop in boundary_loops(faces):
        members = np.zeros(len(vertices), bool)
        members[loop] = True
        near = faces[members[faces].sum(axis=1) >= 2]
        pairs = np.concatenate([near[:, [0, 1]], near[:, [1, 2]], near[:, [2, 0]]])
        pairs = np.sort(pairs[members[pairs].all(axis=1)], axis=1)
        edges = set(map(tuple, pairs.tolist()))
        triangles = loop[_triangulate_loop(vertices[loop], loop, edges)]
        a, b, c = (vertices[triangles[:, i]] for i in range(3))
        area = 0.5 * float(np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1)).sum())
        out.append(Lid(loop, triangles, area, edges))
    return out


def fill_holes(
    vertices: np.ndarray, faces: np.ndarray, holes: list[Lid], *, fair: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Close holes with caps that are refined to the triangles about them.

    Parameters
    ----------
    vertices : numpy.ndarray, shape (n, 3)
        Finite [u].
    faces : numpy.ndarray of int, shape (m, 3)
    holes : list of Lid
        From `lids`.
    fair : bool
        Bend each cap so that it goes on from its rim without a crease; otherwise it stays the surface of least area,
        which crosses its surroundings less easily.

    Returns
    -------
    vertices : numpy.ndarray, shape (n + k, 3)
        Those given, bit for bit, then new ones.
    faces : numpy.ndarray, shape (m + l, 3)
        Those given, then the caps.  Whether they cross is for `lithoform.soundness.check` to say.
    """
    for hole in holes:
        refined, triangles = _refine(vertices, hole)
        faces = np.concatenate([faces, triangles])
        if fair and len(refined) > len(vertices):
            refined = _faired(refined, faces, len(vertices))
        vertices = refined
    return vertices, faces


def _refine(vertices: np.ndarray, hole: Lid) -> tuple[np.ndarray, np.ndarray]:
    """Liepa's refinement of a cap: centroids where a triangle is larger than its corners' scale, and flips."""
    cap = _Cap(vertices, hole)
    cap.relax()
    # Each pass divides triangles by three; the number of passes follows from the largest, and is bounded.
    for _ in range(24):
        if not cap.divide():
            break
        cap.relax()
    new = np.array(cap.new_points).reshape(-1, 3)
    return np.concatenate([vertices, new]), np.array(cap.triangles, np.int64)


class _Cap:
    """Triangles of one cap while it is refined, with the wanted edge length at each vertex."""

    def __init__(self, vertices: np.ndarray, hole: Lid) -> None:
        loop, rim = hole.loop, vertices[hole.loop]
        sides = np.sqrt(((np.roll(rim, -1, axis=0) - rim) ** 2).sum(axis=1))
        lengths = 0.5 * (sides + np.roll(sides, 1))
        self.points = dict(zip(loop.tolist(), map(tuple, rim.tolist()), strict=True))
        self.scale = dict(zip(loop.tolist(), lengths.tolist(), strict=True))
        self.next_vertex = len(vertices)
        self.new_points: list[tuple[float, ...]] = []
        self.triangles: list[list[int]] = hole.triangles.tolist()
        self.existing = hole.rim_edges

    def divide(self) -> bool:
        """Put the centroid into every triangle that is too large; whether there was one."""
        before = self.next_vertex
        for t in range(len(self.triangles)):
            a, b, c = corners = self.triangles[t]
            centre = tuple(sum(self.points[v][i] for v in corners) / 3.0 for i in range(3))
            scale = sum(self.scale[v] for v in corners) / 3.0
            if any(_DENSITY * math.dist(centre, self.points[v]) <= max(scale, self.scale[v]) for v in corners):
                continue
            new = self.next_vertex
            self.next_vertex += 1
            self.points[new], self.scale[new] = centre, scale
            self.new_points.append(centre)
            self.triangles[t] = [a, b, new]
            self.triangles += [[b, c, new], [c, a, new]]
        return self.next_vertex > before

    def relax(self) -> None:
        """Flip inner edges until the two angles opposite each add up to at most 180 degrees."""
        side = {(t[i], t[(i + 1) % 3]): n for n, t in enumerate(self.triangles) for i in range(3)}
        pending = [edge for edge in side if edge[0] < edge[1] and edge[::-1] in side]
        # Flips of a Delaunay sequence end in the plane; on a bent cap the bound makes sure of it.
        for _ in range(20 * len(self.triangles)):
            if not pending:
                return
            a, b = pending.pop()
            if (a, b) not in side or (b, a) not in side:
                continue
            left, right = side[a, b], side[b, a]
            c = next(v for v in self.triangles[left] if v not in (a, b))
            d = next(v for v in self.triangles[right] if v not in (a, b))
            taken = (c, d) in side or (d, c) in side or (min(c, d), max(c, d)) in self.existing
            if taken or self._cotangent(c, a, b) + self._cotangent(d, a, b) >= -1e-9:
                continue
            self.triangles[left], self.triangles[right] = [a, d, c], [d, b, c]
            del side[a, b], side[b, a]
            side.update({(a, d): left, (d, c): left, (c, a): left, (d, b): right, (b, c): right, (c, d): right})
            pending += [(a, d), (d, b), (b, c), (c, a)]

    def _cotangent(self, apex: int, a: int, b: int) -> float:
        o, p, q = self.points[apex], self.points[a], self.points[b]
        u, v = [x - y for x, y in zip(p, o, strict=True)], [x - y for x, y in zip(q, o, strict=True)]
        dot = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
        cross = math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        return dot / cross if cross > 0.0 else math.copysign(math.inf, dot)


def _faired(vertices: np.ndarray, faces: np.ndarray, fixed: int) -> np.ndarray:
    """Vertices with those from number `fixed` on moved to where the umbrella operator applied twice is zero."""
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import spsolve

    # Two rings about the new vertices are all that the operator reaches.
    ring = faces[(faces >= fixed).any(axis=1)]
    for _ in range(2):
        ring = faces[np.isin(faces, ring).any(axis=1)]
    local, numbered = np.unique(ring, return_inverse=True)
    numbered = numbered.reshape(-1, 3)
    a, b = numbered.ravel(), np.roll(numbered, -1, axis=1).ravel()
    rows, columns = np.concatenate([a, b]), np.concatenate([b, a])
    adjacent = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(local),) * 2).tocsr()
    adjacent.data[:] = 1.0
    umbrella = diags_array(np.ones(len(local))) - diags_array(1.0 / adjacent.sum(axis=1)) @ adjacent
    free = local >= fixed
    system = (umbrella @ umbrella).tocsr()[free]
    known = -(system[:, ~free] @ vertices[local[~free]])
    solved = np.asarray(spsolve(system[:, free].tocsc(), known)).reshape(-1, 3)
    rim = vertices[local[~free]]
    slack = np.ptp(rim, axis=0).max()
    if not (np.isfinite(solved).all() and (abs(solved - rim.mean(axis=0)) <= 2.0 * slack).all()):
        return vertices
    moved = vertices.copy()
    moved[local[free]] = solved
    return moved
