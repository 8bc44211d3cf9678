"""Single steps of a repair, on plain arrays: merge, drop, cut and turn faces until a surface is a manifold.

Each takes and returns vertices (n, 3), float64, in any unit u, and faces (m, 3), int64; a face is dropped or turned,
but no vertex is moved.  Vertices that no face uses stay until `lithoform.repair.repair` drops them at its end.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lithoform.errors import MeshError
from lithoform.mesh import Connectivity

__all__ = [
    "bow_ties",
    "crowded_faces",
    "distinct_faces",
    "face_areas",
    "flatten_slivers",
    "largest_patch",
    "orient",
    "patches",
    "split_fans",
    "weld_rims",
]

_FLAT_SINE: Final = 1e-12
"""Of the angle of a face whose area is a matter of rounding; of those that `lithoform.soundness` refuses and more."""

_WELD_TOLERANCES: Final = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Of the body's size; the smallest that closes the surface, or leaves the fewest open edges, is taken."""


def weld_rims(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, int, float]:
    """Merge vertices of open edges that lie close together.

    A vertex is merged into the lowest number of its group.  No tolerance above a tenth of the median edge is tried, so
    that no triangle of ordinary size collapses.

    Returns
    -------
    faces : numpy.ndarray, shape (m, 3)
        Some may have lost a corner.
    merged : int
        Vertices that went.
    tolerance : float
        What was needed, as a share of the diagonal of the box about the body.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    table = Connectivity(faces, len(vertices))
    rim = np.unique(table.edges[table.edge_face_counts == 1])
    size = float(np.sqrt((np.ptp(vertices[table.used_vertices], axis=0) ** 2).sum()))
    lengths = np.sqrt(((vertices[table.edges[:, 0]] - vertices[table.edges[:, 1]]) ** 2).sum(axis=1))
    limit = 0.1 * float(np.median(lengths))
    best, fewest, needed = np.arange(len(vertices)), int((table.edge_face_counts == 1).sum()), 0.0
    tree = cKDTree(vertices[rim])
    for tolerance in _WELD_TOLERANCES:
        if fewest == 0 or tolerance * size > limit:
            break
        pairs = tree.query_pairs(tolerance * size, output_type="ndarray")
        if len(pairs) == 0:
            continue
        graph = coo_array((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(rim),) * 2)
        labels = connected_components(graph, directed=False)[1]
        target = np.arange(len(vertices))
        target[rim] = rim[np.unique(labels, return_index=True)[1]][labels]
        merged = Connectivity(target[faces], len(vertices))
        inner = merged.edges[:, 0] != merged.edges[:, 1]
        still_open = int((merged.edge_face_counts[inner] == 1).sum())
        if still_open < fewest:
            best, fewest, needed = target, still_open, tolerance
    return best[faces], int((best != np.arange(len(best))).sum()), needed


def distinct_faces(faces: np.ndarray) -> np.ndarray:
    """The faces of three different corners, of those with the same three the first; in their order."""
    whole = faces[(faces != np.roll(faces, -1, axis=1)).all(axis=1)]
    first = np.unique(np.sort(whole, axis=1), axis=0, return_index=True)[1]
    return whole[np.sort(first)]


def flatten_slivers(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, int]:
    """Resolve faces without area: a short side is collapsed, a long one is flipped with the face across it.

    Dropping such a face would open the surface, as its three corners lie on one line of the faces beside it.

    Returns
    -------
    tuple of numpy.ndarray and int
        Faces, and how many had no area.
    """
    count = 0
    # Each round settles the slivers that do not touch one another; chains of them need several.
    for _ in range(50):
        flat, sides = _flat_faces(vertices, faces)
        if len(flat) == 0:
            return faces, count
        count += len(flat)
        faces = _without_flat(faces, flat, sides, len(vertices))
        if len(faces) == 0:
            return faces, count
    return np.delete(faces, _flat_faces(vertices, faces)[0], axis=0), count


def _flat_faces(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the faces without area, and the lengths of their sides 0-1, 1-2, 2-0."""
    corners = vertices[faces]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # Lengths beside the largest, whose squares neither over- nor underflow.
    scale = np.maximum(abs(u).max(axis=1), abs(v).max(axis=1))
    scale = np.where(scale > 0.0, scale, 1.0)[:, None]
    u, v = u / scale, v / scale
    sides = np.sqrt(np.stack([(u**2).sum(axis=1), ((v - u) ** 2).sum(axis=1), (v**2).sum(axis=1)], axis=1))
    ordered = np.sort(sides, axis=1)
    double_area = np.sqrt((np.cross(u, v) ** 2).sum(axis=1))
    flat = np.flatnonzero(double_area <= _FLAT_SINE * ordered[:, 1] * ordered[:, 2])
    return flat, sides[flat]


def _without_flat(faces: np.ndarray, flat: np.ndarray, sides: np.ndarray, vertex_count: int) -> np.ndarray:
    table = Connectivity(faces, vertex_count)
    out, target = faces.copy(), np.arange(vertex_count)
    touched: set[int] = set()
    dropped: list[int] = []
    order = np.argsort(table.face_edges.ravel(), kind="stable")
    first = np.searchsorted(table.face_edges.ravel()[order], np.arange(len(table.edges)))
    for f, lengths in zip(flat.tolist(), sides, strict=True):
        if f in touched:
            continue
        touched.add(f)
        corners = faces[f].tolist()
        short, long = int(lengths.argmin()), int(lengths.argmax())
        if lengths[short] <= 1e-6 * lengths[long]:
            a, b = sorted((corners[short], corners[(short + 1) % 3]))
            target[target == target[b]] = target[a]
            continue
        edge = int(table.face_edges[f, long])
        if table.edge_face_counts[edge] != 2:
            dropped.append(f)
            continue
        other = next(g for g in (order[first[edge] : first[edge] + 2] // 3).tolist() if g != f)
        if other in touched:
            continue
        touched.add(other)
        c, a = corners[long], corners[(long + 1) % 3]
        b = corners[(long + 2) % 3]
        d = next(v for v in faces[other].tolist() if v not in (a, c))
        out[f], out[other] = (a, b, d), (b, c, d)
    return distinct_faces(target[np.delete(out, dropped, axis=0)])


def patches(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Number of the patch of each face, shape (m,): faces joined across edges that have exactly two."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    left, right, _ = _joined_sides(Connectivity(faces, vertex_count))
    graph = coo_array((np.ones(len(left), np.int8), (left // 3, right // 3)), shape=(len(faces),) * 2)
    return connected_components(graph, directed=False)[1]


def _joined_sides(table: Connectivity) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two sides (3 face + side) on each edge of exactly two faces, and whether they run against each other."""
    flat = table.face_edges.ravel()
    order = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[order], np.arange(len(table.edges)))
    two = table.edge_face_counts == 2
    return order[first[two]], order[first[two] + 1], table.edge_windings[two] == 0


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of each face, shape (m,) [u^2]."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return 0.5 * np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1))


def crowded_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces to remove, as a mask (m,), so that no edge has more than two.

    The smallest patches at such edges go first, which takes fins and inner walls and leaves the body; where a patch
    meets itself, all its faces at the edge go.
    """
    removed = np.zeros(len(faces), bool)
    table = Connectivity(faces, len(vertices))
    counts = table.edge_face_counts.copy()
    if (counts <= 2).all():
        return removed
    label = patches(faces, len(vertices))
    area = np.bincount(label, weights=face_areas(vertices, faces))
    crowded = counts[table.face_edges] > 2
    at_fault = np.unique(label[crowded.any(axis=1)])
    for patch in at_fault[np.argsort(area[at_fault], kind="stable")][:-1].tolist():
        members = label == patch
        if (counts[table.face_edges[members]] > 2).any():
            removed[members] = True
            np.subtract.at(counts, table.face_edges[members].ravel(), 1)
    removed[np.any(counts[table.face_edges] > 2, axis=1)] = True
    return removed


def largest_patch(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mask (m,) of the faces of the patch of largest area, and the patch of each face, shape (m,)."""
    label = patches(faces, len(vertices))
    area = np.bincount(label, weights=face_areas(vertices, faces))
    return np.equal(label, area.argmax()), label


def _fans(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Number of the fan of each corner, shape (m, 3): faces about a vertex joined across edges of two faces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    left, right, opposed = _joined_sides(Connectivity(faces, vertex_count))
    after_left, after_right = left - left % 3 + (left + 1) % 3, right - right % 3 + (right + 1) % 3
    # The start of one side is the end of the other where the two run against each other.
    rows = np.concatenate([left, after_left])
    columns = np.concatenate([np.where(opposed, after_right, right), np.where(opposed, right, after_right)])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(faces.size,) * 2)
    return connected_components(graph, directed=False)[1].reshape(-1, 3)


def bow_ties(faces: np.ndarray, vertex_count: int) -> np.ndarray:
    """Mask (m,) of the faces about vertices where two gaps of the surface meet.

    Such a vertex has several open fans.  Its faces are to go, which makes one gap of the two: to split the vertex
    would leave two at one place.
    """
    fan = _fans(faces, vertex_count)
    table = Connectivity(faces, vertex_count)
    is_open = table.edge_face_counts[table.face_edges] == 1
    open_fans = np.unique(np.concatenate([fan[is_open], np.roll(fan, -1, axis=1)[is_open]]))
    vertex_of = np.empty(int(fan.max()) + 1, np.int64)
    vertex_of[fan.ravel()] = faces.ravel()
    count = np.bincount(vertex_of[open_fans], minlength=vertex_count)
    return np.any(count[faces] > 1, axis=1)


def split_fans(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of a vertex its own copy; the first keeps the vertex."""
    fan = _fans(faces, len(vertices))
    number, first = np.unique(fan.ravel(), return_index=True)
    owner = faces.ravel()[first]
    order = np.lexsort((first, owner))
    again = np.zeros(len(number), bool)
    again[order[1:]] = owner[order[1:]] == owner[order[:-1]]
    new_vertex = owner.copy()
    new_vertex[again] = len(vertices) + np.arange(int(again.sum()))
    return np.concatenate([vertices, vertices[owner[again]]]), new_vertex[np.searchsorted(number, fan)]


def orient(faces: np.ndarray, vertex_count: int) -> tuple[np.ndarray, int]:
    """Wind the faces of one patch all one way, with as few turned as possible.

    Returns
    -------
    tuple of numpy.ndarray and int
        Faces, and how many were turned.

    Raises
    ------
    MeshError
        If the surface has only one side.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    table = Connectivity(faces, vertex_count)
    left, right, agree = _joined_sides(table)
    if agree.all():
        return faces, 0
    # Each face twice, as it is and turned; two of them are joined where they fit.
    count = len(faces)
    f, g = left // 3, right // 3
    rows, columns = np.concatenate([f, f + count]), np.concatenate([g, g + count])
    columns = np.where(np.concatenate([agree, agree]), columns, (columns + count) % (2 * count))
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count,) * 2)
    label = connected_components(graph, directed=False)[1]
    if (label[:count] == label[count:]).any():
        raise MeshError("its surface has one side only, like a Moebius strip, so that it bounds no solid.")
    turned = label[:count] != label[0]
    if 2 * int(turned.sum()) > count:
        turned = ~turned
    out = faces.copy()
    out[turned] = out[turned][:, ::-1]
    return out, int(turned.sum())
