"""The shape of a rigid block: mass properties of the true mesh, and a rounded convex core for its contacts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lithoform.errors import MeshError
from lithoform.lazy import cached_property
from lithoform.mesh import Connectivity, Mesh, weld

__all__ = ["MARGIN", "Core", "Shape"]

# Margin of the rounding in equal-volume radii.
MARGIN = 0.05
# A convex hull may be concave by this share of its size: what rounding leaves in coordinates of float32 files.
_CONCAVE = 1e-6
# The erosion moves a sharp vertex by at most this many margins; a sharper one is cut less than its faces.
_FARTHEST = 3.0
# Directions whose spread is below this share of the largest do not move an eroded vertex: its faces are one plane.
_SAME_PLANE = 0.05


@dataclass(frozen=True, eq=False)
class Core:
    """A convex polyhedron (or a point) over which a sphere is swept.

    Attributes
    ----------
    vertices : numpy.ndarray, shape (n, 3)
        [m], in the frame of the shape.
    faces : numpy.ndarray of int, shape (m, 3)
        Triangles, outward; none for a point.
    margin : float
        Radius of the sphere [m].
    """

    vertices: np.ndarray
    faces: np.ndarray
    margin: float

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.array(self.faces, dtype=np.int32).reshape(-1, 3)
        vertices.flags.writeable = faces.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        if not (np.isfinite(vertices).all() and len(vertices)):
            raise MeshError("expected a core with finite vertices; check the mesh that it was made from.")
        if not (math.isfinite(self.margin) and self.margin > 0.0):
            raise MeshError(f"expected a positive margin for the rounding of a core, got {self.margin!r}.")
        if len(vertices) > 1:
            self._check_convex()

    def _check_convex(self) -> None:
        mesh = Mesh(self.vertices, self.faces)
        connectivity = mesh.connectivity
        unused = len(self.vertices) - len(connectivity.used_vertices)
        if (connectivity.edge_face_counts != 2).any() or (connectivity.edge_windings != 0).any() or unused:
            raise MeshError("expected a closed core, each edge with two faces and each vertex used; this one is open: "
                            "make it with Shape.from_mesh, which takes the convex hull.")  # fmt: skip
        if mesh.volume <= 0.0:
            raise MeshError("expected a core with outward faces and a volume; this one is inside out or flat.")
        # Neighbours across an edge decide: a closed surface that is convex at all edges is convex.
        size = float(np.ptp(self.vertices, axis=0).max())
        area = np.linalg.norm(mesh.area_vectors, axis=1)
        normals = mesh.area_vectors / np.where(area > 0.0, area, 1.0)[:, None]
        offsets = np.einsum("ij,ij->i", normals, self.vertices[self.faces[:, 0]])
        above = 0.0
        for start in range(0, len(normals), 512):
            heights = normals[start : start + 512] @ self.vertices.T - offsets[start : start + 512, None]
            above = max(above, float(heights[area[start : start + 512] > 1e-9 * size * size].max(initial=0.0)))
        if above > _CONCAVE * size:
            raise MeshError(f"expected a convex core; a vertex lies {above:.3g} m outside a face: make it with "
                            "Shape.from_mesh, which takes the convex hull.")  # fmt: skip

    @cached_property
    def adjacency(self) -> tuple[np.ndarray, np.ndarray]:
        """Neighbours of each vertex along the edges: first entry of each vertex, shape (n + 1,), and the entries."""
        if len(self.vertices) == 1:
            return np.zeros(2, np.int32), np.zeros(0, np.int32)
        edges = Mesh(self.vertices, self.faces).connectivity.edges
        both = np.concatenate([edges, edges[:, ::-1]])
        order = np.lexsort((both[:, 1], both[:, 0]))
        first = np.searchsorted(both[order, 0], np.arange(len(self.vertices) + 1))
        return first.astype(np.int32), both[order, 1].astype(np.int32)


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape that many blocks may use, each with its own scale.

    The frame of a shape has its origin at the centre of mass and its axes along the principal axes of inertia.

    Attributes
    ----------
    core : Core
        What is in contact: a convex polyhedron with a sphere swept over it.
    volume : float
        Of the true mesh [m^3].
    inertia : numpy.ndarray, shape (3,)
        Principal moments at unit density [m^5], ascending.
    hull_volume : float
        Of the convex hull of the mesh [m^3].
    mesh : Mesh or None
        The true mesh in the frame of the shape; None of a sphere.
    centroid : numpy.ndarray, shape (3,)
        Centre of mass in the frame of the mesh that was given [m].
    rotation : numpy.ndarray, shape (3, 3)
        Columns: the principal axes in that frame; a point p of it is rotation.T @ (p - centroid) here.
    """

    core: Core
    volume: float
    inertia: np.ndarray
    hull_volume: float
    mesh: Mesh | None = None
    centroid: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    rotation: np.ndarray = None  # pyright: ignore[reportAssignmentType]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.volume) and self.volume > 0.0):
            raise MeshError(f"expected a block with a positive volume, got {self.volume!r} m^3: without one it has no "
                            "mass; check that its mesh is closed and outward.")  # fmt: skip
        inertia = np.array(self.inertia, dtype=np.float64)
        if inertia.shape != (3,) or not (np.isfinite(inertia).all() and (inertia > 0.0).all()):
            raise MeshError(f"expected three positive principal moments of inertia, got {inertia.tolist()}.")
        for name, value in (("inertia", inertia), ("centroid", np.zeros(3) if self.centroid is None else self.centroid),
                            ("rotation", np.eye(3) if self.rotation is None else self.rotation)):  # fmt: skip
            array = np.array(value, dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def radius(self) -> float:
        """Radius of the sphere of equal volume [m]."""
        return (3.0 * self.volume / (4.0 * math.pi)) ** (1.0 / 3.0)

    @cached_property
    def orientation(self) -> np.ndarray:
        """Quaternion (x, y, z, w) of a block that is turned as the mesh that was given."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_matrix(self.rotation).as_quat()

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of the sphere about the centre of mass that holds the rounded core [m]."""
        return float(np.linalg.norm(self.core.vertices, axis=1).max()) + self.core.margin

    @classmethod
    def sphere(cls, radius: float) -> Shape:
        """A sphere: its core is its centre.

        Parameters
        ----------
        radius : float
            [m], positive.
        """
        if not (math.isfinite(radius) and radius > 0.0):
            raise MeshError(f"expected a positive radius of a sphere, got {radius!r}.")
        volume = 4.0 / 3.0 * math.pi * radius**3
        return cls(Core(np.zeros((1, 3)), np.zeros((0, 3)), radius), volume, np.full(3, 0.4 * volume * radius**2),
                   volume)  # fmt: skip

    @classmethod
    def from_mesh(cls, mesh: Mesh, *, margin: float = MARGIN) -> Shape:
        """Shape of a closed mesh: the core is its convex hull, eroded by the margin.

        Each vertex of the hull moves inwards so that its faces move by the margin (by least squares where more than
        three planes meet): the faces of the rounded core are those of the hull, its edges and corners are round.

        Parameters
        ----------
        mesh : Mesh
            Closed and outward [m].
        margin : float
            Radius of the rounding, in radii of the sphere of equal volume.

        Raises
        ------
        MeshError
            If the mesh has no volume, is open, or is thinner than twice the margin.
        """
        # Its own table of edges: that of the mesh would be kept, a megabyte for each of many shapes.
        if (Connectivity(mesh.faces, len(mesh.vertices)).edge_face_counts != 2).any():
            raise MeshError("expected a closed mesh for a block, but some edges do not have two faces: repair it with "
                            "`lithoform check` as a guide.")  # fmt: skip
        if mesh.volume <= 0.0:
            raise MeshError("expected a mesh with outward faces and a volume; this one is inside out or flat.")
        properties = mesh.mass_properties
        moments, axes = np.linalg.eigh(properties.inertia)
        axes = _fixed_signs(axes)
        # By sums, not by a matrix product, whose last bits depend on the library's threads.
        local = np.einsum("ij,jk->ik", mesh.vertices - properties.centroid, axes)
        radius = (3.0 * properties.volume / (4.0 * math.pi)) ** (1.0 / 3.0)
        if not (math.isfinite(margin) and 0.0 < margin < 1.0):
            raise MeshError(f"expected a margin between 0 and 1 equal-volume radii, got {margin!r}.")
        hull, hull_faces, hull_volume = _hull(local)
        core, core_faces = _eroded(hull, hull_faces, margin * radius)
        return cls(Core(core, core_faces, margin * radius), properties.volume, moments, hull_volume,
                   mesh.with_vertices(local), properties.centroid, axes)  # fmt: skip

    @cached_property
    def rounding(self) -> tuple[float, float]:
        """By how far the rounded core lies inside and outside the hull of the mesh, at most [m].

        In 2,562 directions, by the support of both: the distance of their tangent planes.
        """
        if self.mesh is None:
            return 0.0, 0.0
        from lithoform.topology import sphere

        directions = sphere("icosahedral", 16).vertices
        core = (directions @ self.core.vertices.T).max(axis=1) + self.core.margin
        hull = (directions @ self.mesh.vertices[self._hull_vertices].T).max(axis=1)
        return float((hull - core).max(initial=0.0)), float((core - hull).max(initial=0.0))

    @cached_property
    def _hull_vertices(self) -> np.ndarray:
        from scipy.spatial import ConvexHull

        assert self.mesh is not None
        return ConvexHull(self.mesh.vertices).vertices


def _fixed_signs(axes: np.ndarray) -> np.ndarray:
    """Right-handed axes of which the first two have a positive largest component, so that equal meshes agree."""
    axes = axes.copy()
    for column in (0, 1):
        axes[:, column] *= np.sign(axes[np.abs(axes[:, column]).argmax(), column])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return axes


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Convex hull: its vertices, its outward triangles and its volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError as error:
        raise MeshError("expected a mesh with a volume for a block, but its points lie in a plane.") from error
    order = np.full(len(points), -1)
    used = np.sort(np.unique(hull.simplices))
    order[used] = np.arange(len(used))
    faces = hull.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return points[used], order[faces], float(hull.volume)


def _eroded(vertices: np.ndarray, faces: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Hull of the vertices moved inwards so that their faces move by the margin."""
    mesh = Mesh(vertices, faces)
    length = np.linalg.norm(mesh.area_vectors, axis=1)
    whole = length > 1e-12 * length.max()
    normals = mesh.area_vectors[whole] / length[whole][:, None]
    a, b, c = (vertices[faces[whole][:, k]] for k in range(3))
    # The angle of a face at a vertex weighs its normal, so that the triangles of one plane count as one.
    system = np.zeros((len(vertices), 3, 3))
    right = np.zeros((len(vertices), 3))
    for k, (p, q, r) in enumerate(((a, b, c), (b, c, a), (c, a, b))):
        u, v = q - p, r - p
        angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))
        np.add.at(system, faces[whole][:, k], angle[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(right, faces[whole][:, k], angle[:, None] * normals)
    values, vectors = np.linalg.eigh(system)
    wide = values > _SAME_PLANE * values[:, -1:]
    along = np.einsum("nij,ni->nj", vectors, right)
    move = np.einsum("nij,nj->ni", vectors, np.where(wide, along / np.where(wide, values, 1.0), 0.0))
    distance = np.linalg.norm(move, axis=1)
    move *= np.minimum(1.0, _FARTHEST / np.where(distance > 0.0, distance, 1.0))[:, None]
    inner = vertices - margin * move
    planes = np.einsum("ij,ij->i", normals, a)
    # A body thinner than two margins turns inside out.
    if (np.einsum("ij,ij->i", normals, inner.mean(axis=0)[None]) > planes - margin).any():
        raise MeshError(f"expected a block thicker than twice the margin of its rounding, {margin:.3g} m: give a "
                        "smaller margin.")  # fmt: skip
    core, core_faces, _ = _hull(inner)
    # Vertices that coincide after the erosion are one.
    merged, merged_faces = weld(core, core_faces)
    if len(merged) < len(core):
        core, core_faces, _ = _hull(merged)
        return core, core_faces
    return merged, merged_faces
