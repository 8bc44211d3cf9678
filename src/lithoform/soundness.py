"""Is a mesh closed, 2-manifold, outward, a topological sphere, free of zero-area and of crossing faces.

Most stones are certified without a search.  If a closed, consistently wound, connected surface of Euler
characteristic 2 has every face on the positive side as seen from one point, the central projection from
that point is a branched covering of the sphere without folds; if besides one ray from the point meets one
face only, the covering has a single sheet, so that it is one-to-one and no two faces meet.  (The ray is not
idle: a sphere wrapped twice around the point passes the first test.)  Where that fails, an exact
intersection search decides.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.intersections import find_self_intersections
from lithoform.mesh import Mesh
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["SoundnessReport", "check"]

wp.set_module_options(MODULE_OPTIONS)

# Error bound of a 3x3 determinant of rounded differences, relative to its permanent: (7 + 56 u) u with
# u = 2^-53 (Shewchuk 1997, orient3d stage A), doubled, since the other determinant here has a fourth rounding.
_DETERMINANT_ERROR: Final = wp.constant(wp.float64(16.0 * 2.0**-53))

_SINE_ERROR: Final = 16.0 * 2.0**-53
"""A face whose area is below this fraction of the product of two sides cannot be told from a line in float64."""


@wp.kernel(enable_backward=False)
def _star_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    centre: wp.vec3d,
    ray: wp.vec3d,
    state: wp.array(dtype=wp.int8),
):
    """Bit 0: the face is on the positive side of the centre for certain.  Bit 1: the ray may meet it."""
    i = wp.tid()
    f = faces[i]
    a = vertices[f[0]] - centre
    b = vertices[f[1]] - centre
    c = vertices[f[2]] - centre
    bc = wp.cross(b, c)
    permanent = (
        wp.abs(a[0]) * (wp.abs(b[1] * c[2]) + wp.abs(b[2] * c[1]))
        + wp.abs(a[1]) * (wp.abs(b[2] * c[0]) + wp.abs(b[0] * c[2]))
        + wp.abs(a[2]) * (wp.abs(b[0] * c[1]) + wp.abs(b[1] * c[0]))
    )
    flags = wp.int32(0)
    if wp.dot(a, bc) > _DETERMINANT_ERROR * permanent:
        flags = wp.int32(1)
    size = wp.max(wp.max(wp.length(a), wp.length(b)), wp.length(c))
    slack = wp.float64(-4.0) * _DETERMINANT_ERROR * size * size * wp.length(ray)
    if wp.dot(ray, wp.cross(a, b)) >= slack and wp.dot(ray, bc) >= slack and wp.dot(ray, wp.cross(c, a)) >= slack:
        flags = flags + wp.int32(2)
    state[i] = wp.int8(flags)


@dataclass(frozen=True, eq=False)
class SoundnessReport:
    """What `check` found; every array is empty where nothing is wrong.

    Attributes
    ----------
    open_edges, crowded_edges, misoriented_edges : numpy.ndarray, shape (k, 2)
        Vertex pairs of edges with one face, with three or more, and with two faces wound against each other.
    pinched_vertices : numpy.ndarray, shape (k,)
        Vertices whose faces form more than one fan.
    zero_area_faces : numpy.ndarray, shape (k,)
    self_intersections : numpy.ndarray, shape (k, 2)
        Pairs of faces that meet beyond the vertices and edges they share.
    euler_characteristic : int
    components : int
    volume : float
        Signed volume [unit^3]; positive if the faces point outwards.
    certificate : {"star-shaped", "search"}
        How the absence or presence of self-intersections was decided.
    places : dict of str to numpy.ndarray
        For each fault found, the position of its first instance.
    """

    open_edges: np.ndarray
    crowded_edges: np.ndarray
    misoriented_edges: np.ndarray
    pinched_vertices: np.ndarray
    zero_area_faces: np.ndarray
    self_intersections: np.ndarray
    euler_characteristic: int
    components: int
    volume: float
    certificate: str
    places: dict[str, np.ndarray]

    @property
    def closed(self) -> bool:
        """Every edge has at least two faces."""
        return len(self.open_edges) == 0

    @property
    def manifold(self) -> bool:
        """Every edge has exactly two faces, and the faces of every vertex form one fan."""
        return self.closed and len(self.crowded_edges) == 0 and len(self.pinched_vertices) == 0

    @property
    def outward(self) -> bool:
        """The faces are wound consistently, and outwards."""
        return len(self.misoriented_edges) == 0 and self.volume > 0

    @property
    def sound(self) -> bool:
        """No fault of any kind."""
        return not self.problems()

    def problems(self) -> list[str]:
        """The faults in words, with counts and places; empty for a sound mesh."""
        found = []
        for name, text in _FAULTS.items():
            count = len(getattr(self, name))
            if count:
                place = ", ".join(f"{c:.6g}" for c in self.places[name])
                found.append(f"{count} {text} (first at {place})")
        if self.components != 1:
            found.append(f"{self.components} separate pieces instead of 1")
        elif self.euler_characteristic != 2:
            found.append(f"Euler characteristic {self.euler_characteristic} instead of 2")
        if self.volume <= 0:
            found.append("the faces point inwards" if self.volume < 0 else "no volume is enclosed")
        return found

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON: the verdict, the counts, the problems in words."""
        counts = {name: len(getattr(self, name)) for name in _FAULTS}
        return {
            "sound": self.sound,
            "closed": self.closed,
            "manifold": self.manifold,
            "outward": self.outward,
            "euler_characteristic": self.euler_characteristic,
            "components": self.components,
            "certificate": self.certificate,
            **counts,
            "problems": self.problems(),
        }


_FAULTS: Final = {
    "open_edges": "open edges",
    "crowded_edges": "edges with more than two faces",
    "misoriented_edges": "edges whose two faces are wound against each other",
    "pinched_vertices": "vertices where the surface touches itself",
    "zero_area_faces": "faces without area",
    "self_intersections": "pairs of faces that intersect",
}


def check(mesh: Mesh) -> SoundnessReport:
    """Answer whether a mesh is the boundary of a solid, with counts and places of every fault.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    SoundnessReport
        `report.sound` is the verdict.

    References
    ----------
    Shewchuk, J. R. (1997). Adaptive precision floating-point arithmetic and fast robust geometric predicates.
    Discrete Comput. Geom. 18, 305-363.
    """
    c = mesh.connectivity
    faults: dict[str, np.ndarray] = {
        "open_edges": c.edges[c.edge_face_counts == 1],
        "crowded_edges": c.edges[c.edge_face_counts > 2],
        "misoriented_edges": c.edges[(c.edge_face_counts == 2) & (c.edge_windings != 0)],
        "pinched_vertices": c.pinched_vertices,
        "zero_area_faces": np.empty(0, dtype=np.int64),
        "self_intersections": np.empty((0, 2), dtype=np.int32),
    }
    sphere_like = c.euler_characteristic == 2 and c.component_count == 1 and not any(map(len, faults.values()))
    measured, exponent = _of_ordinary_size(mesh)
    volume = measured.volume
    certificate = "star-shaped"
    if not (sphere_like and volume > 0 and _is_star_shaped(measured)):
        certificate = "search"
        faults["zero_area_faces"] = _zero_area_faces(measured)
        faults["self_intersections"] = find_self_intersections(measured.vertices, measured.faces)
    return SoundnessReport(
        **faults,
        euler_characteristic=c.euler_characteristic,
        components=c.component_count,
        volume=volume if exponent == 0 else float(np.sign(volume)) * _bounded_power(abs(volume), 3 * exponent),
        certificate=certificate,
        places={name: _place(mesh, name, found[0]) for name, found in faults.items() if len(found)},
    )


def _of_ordinary_size(mesh: Mesh) -> tuple[Mesh, int]:
    """The mesh times 2^-exponent: lengths whose squares would over- or underflow are scaled, exactly."""
    largest = float(np.abs(mesh.vertices).max())
    exponent = math.frexp(largest)[1]
    if largest == 0.0 or abs(exponent) < 200:
        return mesh, 0
    return mesh.with_vertices(np.ldexp(mesh.vertices, -exponent)), exponent


def _bounded_power(value: float, exponent: int) -> float:
    """A positive value times 2^exponent, kept within what float64 can hold, so that its sign survives."""
    scaled = math.frexp(value)[1] + exponent
    if scaled > 1023:
        return sys.float_info.max
    return sys.float_info.min if scaled < -1021 else math.ldexp(value, exponent)


def _is_star_shaped(mesh: Mesh) -> bool:
    """Whether the body is certified star-shaped about its centroid (see the module's docstring)."""
    load(_star_kernel.module, "cpu")
    centre = mesh.mass_properties.centroid
    ray = mesh.vertices[mesh.faces[0]].mean(axis=0) - centre
    state = wp.empty(len(mesh.faces), dtype=wp.int8, device="cpu")
    wp.launch(
        _star_kernel,
        dim=len(mesh.faces),
        inputs=[
            shared_array(mesh.vertices, wp.vec3d),
            shared_array(mesh.faces, wp.vec3i),
            wp.vec3d(*centre),
            wp.vec3d(*ray),
            state,
        ],
        device="cpu",
    )
    flags = state.numpy()
    return bool((flags & 1).all()) and int((flags >> 1).sum()) == 1


def _zero_area_faces(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    sides = np.sort(np.stack([((q - p) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))]), axis=0)
    double_area = 2.0 * np.sqrt((mesh.area_vectors**2).sum(axis=1))
    return np.flatnonzero(double_area <= _SINE_ERROR * np.sqrt(sides[1] * sides[2]))


def _place(mesh: Mesh, name: str, first: Any) -> np.ndarray:
    """Position [unit of the mesh] of a fault: a vertex, or the mean of the vertices concerned."""
    if name in ("zero_area_faces", "self_intersections"):
        return mesh.vertices[mesh.faces[first]].reshape(-1, 3).mean(axis=0)
    return np.atleast_2d(mesh.vertices[first]).mean(axis=0)
