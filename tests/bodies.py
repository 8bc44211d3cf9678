"""Bodies of known shape as meshes: spheres, ellipsoids, superellipsoids, capsules, rounded and sharp boxes, cylinders.

The smooth ones are star-shaped about the origin: every vertex of a sphere topology is pushed out along its own
direction to the exact surface, so that vertices lie on the surface to rounding and faces have about equal solid
angles.  All are centred on the origin, closed and outward.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from lithoform.mesh import Mesh
from lithoform.topology import sphere as unit_sphere_mesh

__all__ = [
    "bowl",
    "box",
    "capsule",
    "ellipsoid",
    "extruded",
    "octahedron",
    "prism",
    "random_rotation",
    "rounded_box",
    "rounded_cylinder",
    "sphere",
    "star",
    "subdivided_box",
    "superellipsoid",
    "tapered_capsule",
    "tetrahedron",
    "transformed",
    "u_channel",
]

_BASE_FACES = {"octahedral": 8, "icosahedral": 20}


def star(radius: Callable[[np.ndarray], np.ndarray], triangles: int = 20_000, topology: str = "octahedral") -> Mesh:
    """The star-shaped body with r = radius(unit directions, shape (n, 3)) along every vertex of a sphere topology.

    The number of triangles is the nearest that the topology has: 8 n^2 (octahedral) or 20 n^2 (icosahedral).
    """
    n = max(1, round(math.sqrt(triangles / _BASE_FACES[topology])))
    base = unit_sphere_mesh(topology, n)
    return base.with_vertices(base.vertices * radius(base.vertices)[:, None])


def sphere(triangles: int = 20_000, topology: str = "octahedral", *, radius: float = 1.0) -> Mesh:
    """A ball."""
    return star(lambda u: np.full(len(u), radius), triangles, topology)


def ellipsoid(semi_axes: ArrayLike, triangles: int = 20_000, topology: str = "octahedral") -> Mesh:
    """sum (x_i / a_i)^2 = 1."""
    return superellipsoid(semi_axes, 2.0, triangles, topology)


def superellipsoid(
    semi_axes: ArrayLike, exponent: float, triangles: int = 20_000, topology: str = "octahedral"
) -> Mesh:
    """sum |x_i / a_i|^e = 1."""
    a = np.asarray(semi_axes, dtype=np.float64)
    return star(lambda u: (np.abs(u / a) ** exponent).sum(axis=1) ** (-1.0 / exponent), triangles, topology)


def capsule(radius: float, half_length: float, triangles: int = 20_000, topology: str = "octahedral") -> Mesh:
    """All points within `radius` of the segment from -half_length to +half_length along x."""

    def distance(p: np.ndarray) -> np.ndarray:
        beyond = np.maximum(np.abs(p[:, 0]) - half_length, 0.0)
        return np.sqrt(beyond**2 + p[:, 1] ** 2 + p[:, 2] ** 2) - radius

    return _star_of_distance(distance, radius + half_length, triangles, topology)


def rounded_box(
    half_extents: ArrayLike, edge_radius: float, triangles: int = 20_000, topology: str = "octahedral"
) -> Mesh:
    """A box of these outer half extents, its edges and corners rounded with `edge_radius`."""
    core = np.asarray(half_extents, dtype=np.float64) - edge_radius

    def distance(p: np.ndarray) -> np.ndarray:
        q = np.abs(p) - core
        outside = np.sqrt((np.maximum(q, 0.0) ** 2).sum(axis=1))
        return outside + np.minimum(q.max(axis=1), 0.0) - edge_radius

    return _star_of_distance(distance, float(np.linalg.norm(half_extents)), triangles, topology)


def rounded_cylinder(
    radius: float, half_height: float, edge_radius: float, triangles: int = 20_000, topology: str = "octahedral"
) -> Mesh:
    """A cylinder along z of these outer dimensions, its two rims rounded with `edge_radius`."""

    def distance(p: np.ndarray) -> np.ndarray:
        q = np.stack([np.hypot(p[:, 0], p[:, 1]) - radius, np.abs(p[:, 2]) - half_height], axis=1) + edge_radius
        outside = np.sqrt((np.maximum(q, 0.0) ** 2).sum(axis=1))
        return outside + np.minimum(q.max(axis=1), 0.0) - edge_radius

    return _star_of_distance(distance, math.hypot(radius, half_height), triangles, topology)


def tapered_capsule(
    large: float, small: float, distance: float, triangles: int = 20_000, topology: str = "octahedral"
) -> Mesh:
    """The convex hull of a large ball at the origin and a small one at this distance along x."""
    sine = (large - small) / distance
    cosine = math.sqrt(1.0 - sine * sine)
    contact = distance + small * sine

    def radius(u: np.ndarray) -> np.ndarray:
        along, across = u[:, 0], np.hypot(u[:, 1], u[:, 2])
        cone = large / np.maximum(sine * along + cosine * across, 1e-9)
        cap = distance * along + np.sqrt(np.maximum(small**2 - (distance * across) ** 2, 0.0))
        beyond_large = along > sine
        return np.where(beyond_large, np.where(cone * along <= contact, cone, cap), large)

    return star(radius, triangles, topology)


def _star_of_distance(
    distance: Callable[[np.ndarray], np.ndarray], reach: float, triangles: int, topology: str
) -> Mesh:
    """The star-shaped body where a signed distance is negative; `reach` bounds its radius."""

    def radius(u: np.ndarray) -> np.ndarray:
        low, high = np.zeros(len(u)), np.full(len(u), 1.01 * reach)
        for _ in range(56):
            middle = 0.5 * (low + high)
            inside = distance(u * middle[:, None]) < 0.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return 0.5 * (low + high)

    return star(radius, triangles, topology)


_CUBE_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def box(extents: ArrayLike = (1.0, 1.0, 1.0)) -> Mesh:
    """A sharp box of 12 triangles."""
    return Mesh(0.5 * _CUBE_CORNERS * np.asarray(extents, dtype=np.float64), _CUBE_FACES)


def subdivided_box(extents: ArrayLike = (1.0, 1.0, 1.0), n: int = 40) -> Mesh:
    """A sharp box of 12 n^2 triangles; the defaults give 19,200."""
    size = np.asarray(extents, dtype=np.float64)
    index: dict[tuple[int, ...], int] = {}
    faces = []

    def vertex(*key: int) -> int:
        return index.setdefault(key, len(index))

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, n):
            for i in range(n):
                for j in range(n):
                    square = []
                    for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        key = [0, 0, 0]
                        key[axis], key[u], key[v] = side, i + du, j + dv
                        square.append(vertex(*key))
                    a, b, c, d = square if side else square[::-1]
                    faces += [(a, b, c), (a, c, d)]
    return Mesh((np.array(list(index)) / n - 0.5) * size, np.array(faces))


def octahedron(semi_axis: float = 1.0) -> Mesh:
    """The regular octahedron with corners at +-semi_axis; its inscribed sphere has radius semi_axis / sqrt(3)."""
    base = unit_sphere_mesh("octahedral", 1)
    return base.with_vertices(semi_axis * np.round(base.vertices))


def tetrahedron(edge: float = 1.0) -> Mesh:
    """The regular tetrahedron; its inscribed sphere has radius edge / sqrt(24)."""
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * edge / math.sqrt(8.0)
    return Mesh(corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


def prism(sides: int, edge_distance: float, height: float) -> Mesh:
    """A regular prism along z whose sides are `edge_distance` from its axis."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = edge_distance / math.cos(math.pi / sides) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([ring, np.full(sides, -0.5 * height)])
    high = np.column_stack([ring, np.full(sides, 0.5 * height)])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    fan, top = np.arange(1, sides - 1), sides
    faces = [
        np.stack([i, j, top + j], axis=1),
        np.stack([i, top + j, top + i], axis=1),
        np.stack([0 * fan, fan + 1, fan], axis=1),
        np.stack([0 * fan + top, top + fan, top + fan + 1], axis=1),
    ]
    return Mesh(np.concatenate([low, high]), np.concatenate(faces))


def extruded(outline: ArrayLike, caps: ArrayLike, height: float) -> Mesh:
    """A polygon (counter-clockwise, shape (n, 2)) with its triangulation, from z = 0 to the height."""
    ring, cap = np.asarray(outline, dtype=np.float64), np.asarray(caps)
    n = len(ring)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    vertices = [np.column_stack([ring, np.full(n, z)]) for z in (0.0, height)]
    faces = [np.stack([i, j, n + j], axis=1), np.stack([i, n + j, n + i], axis=1), cap[:, ::-1], cap + n]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def u_channel(width: float = 4.0, depth: float = 3.0, wall: float = 1.0, height: float = 1.5) -> Mesh:
    """A U of walls of one thickness; its inscribed sphere lies in a wall or, larger, in one of its inner corners."""
    w, d, t = width, depth, wall
    outline = [(0, 0), (w, 0), (w, d), (w - t, d), (w - t, t), (t, t), (t, d), (0, d)]
    caps = [(0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4), (0, 5, 7), (5, 6, 7)]
    return extruded(outline, caps, height)


def bowl(outer: float = 1.0, wall: float = 0.1, triangles: int = 5_000) -> Mesh:
    """A half of a ball with a half of a ball, smaller by the wall, taken out of it; z <= 0, rim flat."""
    base = unit_sphere_mesh("octahedral", max(2, round(math.sqrt(triangles / 8))))
    below = (base.vertices[base.faces][:, :, 2] < 1e-12).all(axis=1)
    shell = base.faces[below]
    n = len(base.vertices)
    vertices = np.concatenate([outer * base.vertices, (outer - wall) * base.vertices])
    sides = np.concatenate([shell[:, [0, 1]], shell[:, [1, 2]], shell[:, [2, 0]]])
    rim = sides[(np.abs(base.vertices[sides][:, :, 2]) < 1e-12).all(axis=1)]
    a, b = rim.T
    joint = [np.stack([b, a, a + n], axis=1), np.stack([b, a + n, b + n], axis=1)]
    faces = np.concatenate([shell, shell[:, ::-1] + n, *joint])
    used, compact = np.unique(faces, return_inverse=True)
    return Mesh(vertices[used], compact.reshape(-1, 3))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation matrix drawn uniformly, shape (3, 3)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def transformed(
    mesh: Mesh, rotation: ArrayLike | None = None, *, scale: float = 1.0, shift: ArrayLike = (0.0, 0.0, 0.0)
) -> Mesh:
    """The mesh turned, then scaled, then shifted."""
    turned = mesh.vertices if rotation is None else np.einsum("ij,nj->ni", np.asarray(rotation), mesh.vertices)
    return mesh.with_vertices(scale * turned + np.asarray(shift, dtype=np.float64))
