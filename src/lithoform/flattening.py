"""Give a body a flat support face: blend its lowest band (eq. 18), or cut it, cap it and blend what is above.

The cut goes by the sides of the vertices (above, in, or below the plane), so that what belongs to what is
decided once for a vertex or an edge, never twice.  Rounding enters the places of the new vertices alone.
"""

from __future__ import annotations

import math
from typing import NoReturn

import numpy as np

from lithoform.errors import MeshError
from lithoform.mesh import Connectivity, Mesh

__all__ = ["flatten"]

# A vertex counts as lying in the plane of the cut if it is this near, in median edges: cut points nearer to
# each other than that would only make slivers.
_SNAP_OF_MEDIAN_EDGE = 1e-6
# ... and in edges of its own, so that small details keep their shape and no face collapses.
_SNAP_OF_SHORTEST_EDGE = 1e-3
# Share of the kept volume that all moves of vertices into the plane, or off it, may change together.
_VOLUME_BUDGET = 1e-10
# Heights that are rounding, in largest coordinates; and the least that blending may leave of a height.
_ROUNDING = 8 * np.finfo(np.float64).eps
_BLENDED_ROUNDING = 4096 * np.finfo(np.float64).eps


def flatten(mesh: Mesh, *, depth: float = 0.0, band: float = 0.0, z0: float | None = None) -> Mesh:
    """Give a body a flat support face at its bottom (eq. 18, 19).

    The body is moved along z so that min z = z0.  With a depth, it is then cut by the plane z = z0 + depth:
    what is above is kept, and every loop of the section is capped.  Last, the band above the bottom Z (z0, or
    z0 + depth) is blended towards it by eq. 18: z' = Z + (z - Z)^2 / band for Z <= z < Z + band, flat (slope
    dz'/dz = 0) at the bottom of the band, continuous but of slope 2 at its top.

    Parameters
    ----------
    mesh : Mesh
        Closed, with outward faces, where a depth is given; any for a depth of 0.
    depth : float
        Height of the cut above the lowest point [unit of the mesh]; 0, as printed in the paper, cuts nothing
        and keeps the connectivity.
    band : float
        Thickness h_b of the blended band [unit of the mesh]; 0 blends nothing.
    z0 : float or None
        Level of the lowest point before the cut [unit of the mesh]; None leaves the body where it is.

    Returns
    -------
    Mesh
        With a depth: closed, consistently wound and, for a body without handles, of Euler characteristic 2;
        its lowest faces lie in the plane z = z0 + depth, to the last bit, with normal (0, 0, -1).  If the
        plane parts the body, the piece of largest volume is kept.

    Raises
    ------
    MeshError
        If an argument is negative or not finite; and for a cut, if the body is not closed, not consistently
        wound, inside out, not higher than the depth or pierced by the cut (its kept part is a ring), or if
        the section cannot be triangulated.

    Notes
    -----
    Before the cut, vertices nearer to the plane than a tolerance are moved into it along z; those that would
    pinch the section there (saddles, tips that only touch the plane) are moved off it by as much instead.
    The tolerance is the least of 1e-6 of the median edge, 1e-3 of the shortest edge at these vertices, and
    the distance that changes the volume by 1e-10 of what a convex body would keep; but it is never less than
    rounding, nor, with a band, than the height that blending would squeeze to less than 4096 roundings.
    Blending moves vertices, not the space between: with a thick band, near sheets of a folded body may cross.
    """
    for name, value in (("depth", depth), ("band", band)):
        if not 0.0 <= value < math.inf:
            raise MeshError(f"expected a flattening {name} that is finite and at least 0, got {value}.")
    if z0 is not None and not math.isfinite(z0):
        raise MeshError(f"expected a finite level z0 of the lowest point, or None to leave it, got {z0}.")
    lowest = float(mesh.vertices[:, 2].min())
    level = lowest if z0 is None else float(z0)
    if level != lowest:  # in this order, so that the lowest point comes to z0 to the last bit
        mesh = mesh.with_vertices(_with_heights(mesh.vertices, level + (mesh.vertices[:, 2] - lowest)))
    if depth > 0.0:
        _check_body(mesh, depth, level)
        level += float(depth)
        mesh = _cut(mesh, level, band)
    if band == 0.0:
        return mesh
    height = mesh.vertices[:, 2] - level
    blended = np.where(height < band, level + height * (height / band), mesh.vertices[:, 2])
    return mesh.with_vertices(_with_heights(mesh.vertices, blended))


def _with_heights(vertices: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.column_stack([vertices[:, :2], z])


def _check_body(mesh: Mesh, depth: float, lowest: float) -> None:
    """Refuse a body that cannot be cut at this depth."""
    extent = float(mesh.vertices[:, 2].max()) - lowest
    if depth >= extent:
        raise MeshError(f"expected a depth below the extent of the body along z, {extent}, got {depth}.")
    if open_edges := int(np.count_nonzero(mesh.connectivity.edge_face_counts != 2)):
        raise MeshError(f"expected a closed body for a cut, got {open_edges} edges that are not in exactly "
                        "two faces; close it first, or use depth = 0.")  # fmt: skip
    if torn := int(np.count_nonzero(mesh.connectivity.edge_windings)):
        raise MeshError(f"expected consistently wound faces for a cut, got {torn} edges run twice in one "
                        "direction; turn the faces to one side first.")  # fmt: skip
    if _volume_above(mesh.vertices, mesh.faces, lowest).sum() <= 0.0:
        raise MeshError("expected outward faces for a cut, got a body whose volume is not positive; "
                        "turn its faces round.")  # fmt: skip


def _volume_above(vertices: np.ndarray, faces: np.ndarray, level: float) -> np.ndarray:
    """Signed volume between each face and z = level, shape (m,): its shadow times its mean height."""
    corners = vertices[faces]
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    shadow = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    return shadow * (corners[:, :, 2] - level).sum(axis=1) / 6.0


def _cut(mesh: Mesh, level: float, band: float) -> Mesh:
    """The largest piece of the body above z = level, capped."""
    connectivity, faces, n = mesh.connectivity, mesh.faces.astype(np.int64), len(mesh.vertices)
    z, side = _sides(mesh, level, band)
    # A new vertex on every edge that crosses the plane, always from below to above.
    crossing = np.flatnonzero(side[connectivity.edges].prod(axis=1) < 0)
    ends = connectivity.edges[crossing]
    low, high = np.where(side[ends[:, :1]] < 0, ends, ends[:, ::-1]).T
    share = (z[low] - level) / (z[low] - z[high])
    made = mesh.vertices[low] + share[:, None] * (mesh.vertices[high] - mesh.vertices[low])
    made[:, 2] = level
    points = np.concatenate([_with_heights(mesh.vertices, z), made])
    in_plane = np.concatenate([side == 0, np.ones(len(made), dtype=bool)])

    cut_vertex = np.full(len(connectivity.edges), -1)
    cut_vertex[crossing] = n + np.arange(len(crossing))
    kept = (side[faces] > 0).any(axis=1)
    split = kept & (side[faces] < 0).any(axis=1)
    trimmed = _trimmed(faces[split], side, cut_vertex[connectivity.face_edges[split]], points)
    walls = np.concatenate([faces[kept & ~split], trimmed])
    loops = _loops(walls, in_plane, points)
    if not loops:
        raise MeshError(f"expected a plane that cuts a section, but z = {level} touches the body only, "
                        "or misses it by rounding; choose another depth.")  # fmt: skip
    result = _largest_piece(points, np.concatenate([walls, _cap(points[:, :2], loops)]), level)
    characteristic = len(result.vertices) - len(result.faces) // 2
    if characteristic < min(2, connectivity.euler_characteristic):
        raise MeshError(f"expected a cut that leaves no hole through the body, but above z = {level} "
                        f"is a ring (Euler number {characteristic}); choose a smaller depth.")  # fmt: skip
    return result


def _sides(mesh: Mesh, level: float, band: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights z after the moves that `flatten` documents, and sides (-1, 0, 1) of the plane, shape (n,)."""
    heights = mesh.vertices[:, 2] - level
    reach = _tolerance(mesh, heights, band)
    side = np.where(np.abs(heights) <= reach, 0, np.sign(heights)).astype(np.int8)
    z = np.where(side == 0, level, mesh.vertices[:, 2])
    faces, edges, n = mesh.faces, mesh.connectivity.edges, len(z)
    # Around a vertex in the plane, the faces that stay must form one open fan: a closed fan touches the plane
    # with its tip only, two open fans pinch the section.  Open fans are as many as faces less links.  An edge
    # in the plane inside a fan touches it too.  All of these go down, as the ground beside them, or up where
    # there is none: nothing is joined and nothing is pierced.
    while (side == 0).any():
        kept = (side[faces] > 0).any(axis=1)
        faces_kept = np.bincount(faces[kept].ravel(), minlength=n)
        uses = np.bincount(mesh.connectivity.face_edges[kept].ravel(), minlength=len(edges))
        linked = edges[(uses == 2) & (side[edges] >= 0).all(axis=1)]
        fans = faces_kept - np.bincount(linked.ravel(), minlength=n)
        tip = (side == 0) & (faces_kept > 0) & (fans == 0)
        pinch = (side == 0) & (fans > 1)
        touching = linked[(side[linked] == 0).all(axis=1)]
        pinch[touching[~tip[touching].all(axis=1)]] = True
        if pinch.any():
            side[pinch], z[pinch] = -1, level - reach
        elif tip.any():
            side[tip], z[tip] = 1, level + reach
        else:
            break
    return z, side


def _tolerance(mesh: Mesh, heights: np.ndarray, band: float) -> float:
    """Distance from the plane up to which a vertex counts as lying in it [unit of the mesh]."""
    vertices, edges, faces = mesh.vertices, mesh.connectivity.edges, mesh.faces
    scale = float(np.abs(vertices).max())
    least = max(_ROUNDING * scale, math.sqrt(band * _BLENDED_ROUNDING * scale))
    sides = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    lengths = np.sqrt((sides**2).sum(axis=1))
    reach = _SNAP_OF_MEDIAN_EDGE * float(np.median(lengths))
    near = np.abs(heights) <= reach
    reach = min(reach, _SNAP_OF_SHORTEST_EDGE * float(lengths[near[edges].any(axis=1)].min(initial=math.inf)))
    # Moving a vertex by d along z changes the volume by d/3 of the shadow of its faces; it may move twice.
    sensitivity = 2.0 / 3.0 * float((near[faces].sum(axis=1) * np.abs(mesh.area_vectors[:, 2])).sum())
    if sensitivity > 0.0:
        remaining = float(heights.max() / (heights.max() - heights.min()))
        volume = float(_volume_above(vertices, faces, 0.0).sum()) * remaining**3
        reach = min(reach, _VOLUME_BUDGET * volume / sensitivity)
    return max(reach, least)


def _trimmed(faces: np.ndarray, side: np.ndarray, cut: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The parts above the plane of faces that cross it, shape (t, 3)."""
    # Round each face: corner, side, corner, side, corner, side; -1 for what is not there.  3 or 4 are.
    ring = np.stack([np.where(side[faces] >= 0, faces, -1), cut], axis=2).reshape(-1, 6)
    ring = np.take_along_axis(ring, np.argsort(ring < 0, axis=1, kind="stable"), axis=1)[:, :4]
    quad = ring[:, 3] >= 0
    a, b, c, d = ring[quad].T
    diagonals = ((points[c] - points[a]) ** 2).sum(axis=1), ((points[d] - points[b]) ** 2).sum(axis=1)
    across = (diagonals[0] <= diagonals[1])[:, None]
    first = np.where(across, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(across, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.concatenate([ring[~quad, :3], first, second])


def _loops(walls: np.ndarray, in_plane: np.ndarray, points: np.ndarray) -> list[np.ndarray]:
    """Border of the walls: closed loops of vertices, counter-clockwise from above around the section."""
    start, end = walls.ravel(), np.roll(walls, -1, axis=1).ravel()
    flat = in_plane[start] & in_plane[end]
    start, end = start[flat], end[flat]
    single = ~np.isin(start * len(points) + end, end * len(points) + start)
    start, end = start[single], end[single]
    # Begun at their leftmost points and sorted by them: the numbering of the vertices does not enter.
    order = np.lexsort((points[start, 1], points[start, 0]))
    following = dict(zip(start.tolist(), end.tolist(), strict=True))
    if len(following) < len(start) or set(following) != set(end.tolist()):
        _refuse_section("its border touches itself at a vertex")
    loops: list[list[int]] = []
    for vertex in start[order].tolist():
        if vertex in following:
            loops.append([])
        while vertex in following:
            loops[-1].append(vertex)
            vertex = following.pop(vertex)
    return [np.array(loop) for loop in loops]


def _cap(xy: np.ndarray, loops: list[np.ndarray]) -> np.ndarray:
    """Constrained Delaunay triangles of the section, seen from below counter-clockwise, shape (c, 3)."""
    import shapely  # constrained_delaunay_triangles: since shapely 2.1; with all holes right since GEOS 3.12

    # Measured from a point of each loop, so that a body far from the origin loses no digits.
    fans = [(xy[loop[1:-1]] - xy[loop[0]], xy[loop[2:]] - xy[loop[0]]) for loop in loops]
    areas = np.array([float((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum()) for u, v in fans])
    outer = np.flatnonzero(areas > 0.0)
    shells = np.array([shapely.Polygon(xy[loops[i]]) for i in outer], dtype=object)
    holes: dict[int, list[int]] = {int(i): [] for i in outer}
    for hole in np.flatnonzero(~(areas > 0.0)):  # in the smallest of the outer loops around it
        around = outer[shapely.intersects_xy(shells, *xy[loops[hole][0]])]
        if not around.size:
            _refuse_section("a hole lies in no outer loop")
        holes[int(around[np.argmin(areas[around])])].append(int(hole))
    polygons = [shapely.Polygon(xy[loops[i]], [xy[loops[j]] for j in inside]) for i, inside in holes.items()]
    if reasons := [shapely.is_valid_reason(polygon) for polygon in polygons if not polygon.is_valid]:
        _refuse_section(reasons[0])
    try:
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons))
    except shapely.GEOSException as error:
        _refuse_section(str(error))
    corners = np.ascontiguousarray(shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3])

    # Coordinates come back unchanged, so that they tell the vertices.
    members = np.concatenate(loops)
    keys = np.ascontiguousarray(xy[members]).view(np.complex128).ravel()
    order = np.argsort(keys, kind="stable")
    asked = corners.view(np.complex128)[..., 0]
    place = np.minimum(np.searchsorted(keys[order], asked), len(keys) - 1)
    faces = members[order[place]]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if float((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum()) > 0.0:  # GEOS winds all of them one way
        faces = faces[:, ::-1]
    # Together with the loops, every side must be run once each way: nothing is missing, added or doubled.
    start = np.concatenate([faces.ravel(), members])
    end = np.concatenate([np.roll(faces, -1, axis=1).ravel(), *(np.roll(loop, -1) for loop in loops)])
    there, back = start * len(xy) + end, end * len(xy) + start
    if (keys[order[place]] != asked).any() or not np.array_equal(np.unique(there), np.sort(back)):
        _refuse_section("the triangles do not meet its border")
    return faces


def _largest_piece(points: np.ndarray, faces: np.ndarray, level: float) -> Mesh:
    """The connected part of largest volume, without the vertices that it does not use."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = (np.ones(2 * len(faces), np.int8), (faces[:, [0, 0]].ravel(), faces[:, 1:].ravel()))
    labels = connected_components(coo_array(links, shape=(len(points),) * 2), directed=False)[1][faces[:, 0]]
    if (labels != labels[0]).any():
        volumes = np.bincount(labels, weights=_volume_above(points, faces, level))
        faces = faces[labels == np.argmax(volumes)]
    used = np.zeros(len(points), dtype=bool)
    used[faces.ravel()] = True
    return Mesh(points[used], Connectivity((np.cumsum(used) - 1)[faces], int(used.sum())))


def _refuse_section(reason: str) -> NoReturn:
    raise MeshError(f"expected a section of simple loops, but it cannot be triangulated ({reason}); "
                    "check the body for self-intersections, or choose another depth.")  # fmt: skip
