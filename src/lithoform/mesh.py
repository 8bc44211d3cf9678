"""A frozen triangle mesh, its connectivity (shared between meshes that differ only in shape), mass properties."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import MeshError
from lithoform.lazy import cached_property

__all__ = ["Connectivity", "MassProperties", "Mesh", "weld"]


class Connectivity:
    """Faces of a mesh and what follows from them alone; computed once for all meshes that share it.

    Parameters
    ----------
    faces : array_like, shape (m, 3)
        Vertex indices of each triangle.
    vertex_count : int
        Number of vertices that the indices refer to.

    Raises
    ------
    MeshError
        If the faces have another shape, are not whole numbers, or point outside the vertices.
    """

    def __init__(self, faces: ArrayLike, vertex_count: int) -> None:
        array = np.asarray(faces)
        if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
            raise MeshError(f"expected faces of shape (m, 3) with m >= 1, got {array.shape}.")
        if not np.issubdtype(array.dtype, np.integer):
            raise MeshError(f"expected faces of whole numbers (vertex indices), got {array.dtype}.")
        if array.min() < 0 or array.max() >= vertex_count:
            raise MeshError(f"expected vertex indices from 0 to {vertex_count - 1} in the faces, "
                            f"got {array.min()} to {array.max()}.")  # fmt: skip
        self.faces = _frozen(array, np.int32)
        self.vertex_count = int(vertex_count)

    def __reduce__(self) -> tuple[type[Connectivity], tuple[np.ndarray, int]]:
        return Connectivity, (self.faces, self.vertex_count)

    @cached_property
    def edges(self) -> np.ndarray:
        """Undirected edges (a < b), shape (e, 2), each once."""
        return self._edge_table[0]

    @cached_property
    def edge_face_counts(self) -> np.ndarray:
        """Number of faces on each edge, shape (e,)."""
        return self._edge_table[1]

    @cached_property
    def edge_windings(self) -> np.ndarray:
        """Faces that run an edge upwards less those that run it downwards, shape (e,): 0 where consistent."""
        return self._edge_table[2]

    @cached_property
    def face_edges(self) -> np.ndarray:
        """Edge index of each side (0-1, 1-2, 2-0) of each face, shape (m, 3)."""
        return self._edge_table[3]

    @cached_property
    def _edge_table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        start = self.faces.astype(np.int64)
        end = np.roll(start, -1, axis=1)
        keys = (np.minimum(start, end) * self.vertex_count + np.maximum(start, end)).ravel()
        unique, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
        sign = np.where(start < end, 1, -1).ravel()
        winding = np.bincount(inverse, weights=sign, minlength=len(unique)).astype(np.int64)
        edges = np.stack([unique // self.vertex_count, unique % self.vertex_count], axis=1)
        table = (edges, counts, winding, inverse.reshape(-1, 3))
        for array in table:
            array.flags.writeable = False
        return table

    @cached_property
    def used_vertices(self) -> np.ndarray:
        """Sorted indices of the vertices that some face uses."""
        return np.unique(self.faces)

    @cached_property
    def euler_characteristic(self) -> int:
        """Vertices in use - edges + faces: 2 for a sphere."""
        return len(self.used_vertices) - len(self.edges) + len(self.faces)

    @cached_property
    def component_count(self) -> int:
        """Number of pieces that share no vertex."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        a, b = self.edges.T
        graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(self.vertex_count, self.vertex_count))
        labels = connected_components(graph, directed=False)[1]
        return len(np.unique(labels[self.used_vertices]))

    @cached_property
    def pinched_vertices(self) -> np.ndarray:
        """Vertices whose faces form more than one fan (the surface touches itself there)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        # Nodes are the corners (face, vertex); two corners of a vertex are linked by a common edge there.
        corners = self.faces.size
        corner = np.arange(corners).reshape(-1, 3)
        edge_end = np.concatenate([self.face_edges.ravel() * 2, self.face_edges.ravel() * 2 + 1])
        start, end = self.faces, np.roll(self.faces, -1, axis=1)
        at_low = np.where(start < end, corner, np.roll(corner, -1, axis=1)).ravel()
        at_high = np.where(start < end, np.roll(corner, -1, axis=1), corner).ravel()
        node = np.concatenate([at_low, at_high])
        graph = coo_array(
            (np.ones(2 * corners, np.int8), (node, corners + edge_end)),
            shape=(corners + 2 * len(self.edges),) * 2,
        )
        labels = connected_components(graph, directed=False)[1][:corners]
        fan_vertex = self.faces.ravel()[np.unique(labels, return_index=True)[1]]
        vertices, fans = np.unique(fan_vertex, return_counts=True)
        return vertices[fans > 1]

    @cached_property
    def neighbour_mean(self) -> Any:
        """One-ring mean W = D^-1 A of eq. 13: scipy sparse array, shape (vertices, vertices).

        A vertex that no face uses is its own mean, so that smoothing leaves it where it is.
        """
        from scipy.sparse import coo_array

        a, b = self.edges.T
        degree = np.bincount(self.edges.ravel(), minlength=self.vertex_count)
        alone = np.flatnonzero(degree == 0)
        degree[alone] = 1
        rows, columns = np.concatenate([a, b, alone]), np.concatenate([b, a, alone])
        return coo_array((1.0 / degree[rows], (rows, columns)), shape=(self.vertex_count,) * 2).tocsr()


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties at unit density, in the mesh's own unit of length u.

    Attributes
    ----------
    volume : float
        [u^3], positive for outward faces.
    area : float
        Surface area [u^2].
    centroid : numpy.ndarray, shape (3,)
        Centre of the solid [u].
    inertia : numpy.ndarray, shape (3, 3)
        Inertia tensor about the centroid in the axes of the mesh [u^5].
    """

    volume: float
    area: float
    centroid: np.ndarray
    inertia: np.ndarray


class Mesh:
    """Vertices and faces, both read-only.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        Positions, float64.
    faces : array_like of int, shape (m, 3), or Connectivity
        Triangles, counter-clockwise seen from outside.

    Raises
    ------
    MeshError
        If a shape is wrong, a coordinate is not finite, or an index points to no vertex.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike | Connectivity) -> None:
        positions = np.asarray(vertices)
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise MeshError(f"expected vertices of shape (n, 3), got {positions.shape}.")
        if positions.dtype.kind not in "fiu":
            raise MeshError(f"expected vertices of real numbers, got {positions.dtype}.")
        self.vertices = _frozen(positions, np.float64)
        if not np.isfinite(self.vertices).all():
            bad = int(np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))[0])
            raise MeshError(f"expected finite vertices, but vertex {bad} is {self.vertices[bad].tolist()}.")
        self.connectivity = faces if isinstance(faces, Connectivity) else Connectivity(faces, len(positions))
        if self.connectivity.vertex_count != len(positions):
            raise MeshError(f"expected {self.connectivity.vertex_count} vertices for this connectivity, "
                            f"got {len(positions)}.")  # fmt: skip

    @property
    def faces(self) -> np.ndarray:
        """Vertex indices of each triangle, shape (m, 3), int32."""
        return self.connectivity.faces

    def with_vertices(self, vertices: ArrayLike) -> Mesh:
        """The same connectivity with other positions."""
        return Mesh(vertices, self.connectivity)

    def __reduce__(self) -> tuple[type[Mesh], tuple[np.ndarray, np.ndarray]]:
        # What is cached is computed again; arrays that were unpickled directly would be writeable.
        return Mesh, (self.vertices, self.faces)

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.faces)} faces)"

    @cached_property
    def area_vectors(self) -> np.ndarray:
        """Half the cross product of two sides of each face (outward, length = area), shape (m, 3)."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        u, v = (b - a).T, (c - a).T
        rows = [0.5 * (u[j] * v[k] - u[k] * v[j]) for j, k in ((1, 2), (2, 0), (0, 1))]
        vectors = np.stack(rows, axis=1)
        vectors.flags.writeable = False
        return vectors

    @cached_property
    def mass_properties(self) -> MassProperties:
        """Volume, area, centroid and inertia by exact integrals over the tetrahedra of the faces.

        Returns
        -------
        MassProperties
            At unit density; the centroid and inertia are those of the solid.

        Raises
        ------
        MeshError
            If the enclosed volume is 0.
        """
        origin, (area, volume, first, second) = self._moments
        if volume == 0.0:
            raise MeshError("the mesh encloses no volume, so that it has no centroid; check that it is closed.")
        offset = first / volume
        central = second - volume * np.outer(offset, offset)
        centroid, inertia = origin + offset, np.trace(central) * np.eye(3) - central
        centroid.flags.writeable = inertia.flags.writeable = False
        return MassProperties(volume, area, centroid, inertia)

    @property
    def volume(self) -> float:
        """Signed volume [u^3], positive for outward faces; of an open surface, that of the cone to its first vertex."""
        return self._moments[1][1]

    @cached_property
    def _moments(self) -> tuple[np.ndarray, tuple[float, float, np.ndarray, np.ndarray]]:
        # Warp is loaded when a mesh is first measured.  Moments are taken about a vertex, so that a body far from
        # the origin loses no digits.
        from lithoform.face_integrals import face_moments

        origin = self.vertices[0]
        return origin, face_moments(self.vertices, self.faces, origin)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of the vertices (little-endian float64) and faces (int32)."""
        digest = hashlib.sha256()
        digest.update(self.vertices.astype("<f8", copy=False).tobytes())
        digest.update(self.faces.astype("<i4", copy=False).tobytes())
        return digest.hexdigest()


def weld(vertices: np.ndarray, faces: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices of equal coordinates, in the order of their first occurrence.

    Parameters
    ----------
    vertices : numpy.ndarray of float, shape (n, 3)
    faces : numpy.ndarray of int, shape (m, 3), optional
        By default every three vertices are the corners of a face, as in an STL.

    Returns
    -------
    tuple of numpy.ndarray
        Vertices, shape (k, 3), and the faces that refer to them.
    """
    # By their bits, as integers sort faster than rows of floats; + 0.0 makes one of the two zeros.
    bits = np.ascontiguousarray(vertices + 0.0).view(f"i{vertices.itemsize}")
    order = np.lexsort(bits.T)
    is_new = np.ones(len(bits), bool)
    is_new[1:] = (bits[order[1:]] != bits[order[:-1]]).any(axis=1)
    group = np.empty(len(bits), np.int64)
    group[order] = np.cumsum(is_new) - 1
    first = order[is_new]  # lexsort is stable, so that this is the lowest index of each group
    merged = np.argsort(np.argsort(first))[group]
    return vertices[np.sort(first)], merged.reshape(-1, 3) if faces is None else merged[faces]


def _frozen(array: np.ndarray, dtype: Any) -> np.ndarray:
    """A read-only, contiguous array; copied only if the given one could still be written to by its owner."""
    out = np.ascontiguousarray(array, dtype=dtype)
    if out is array and _writeable_by_others(out):
        out = out.copy()
    out.flags.writeable = False
    return out


def _writeable_by_others(array: Any) -> bool:
    """Whether some owner of an array's memory may still write to it."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return True
        array = array.base
    return array is not None
