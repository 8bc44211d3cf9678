"""A mesh under measurement: what several measures share (hull, frames, boxes, spheres) is computed once, when asked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from lithoform.errors import MeshError
from lithoform.lazy import cached_property
from lithoform.mesh import MassProperties, Mesh

if TYPE_CHECKING:
    from lithoform.descriptors.calipers import Caliper
    from lithoform.descriptors.fractal import FractalDimension
    from lithoform.descriptors.hull import Hull
    from lithoform.descriptors.roundness import Roundness
    from lithoform.descriptors.solids import Box, Sphere

__all__ = ["Body", "BoxKind"]

BoxKind = Literal["principal", "solid", "vertices", "minimum"]

_OPEN = 1e-9
"""Largest length of the summed area vectors of a closed surface, as a share of its area; rounding leaves 1e-14."""


class Body:
    """A closed mesh and the intermediate results that its measures share.

    Parameters
    ----------
    mesh : Mesh, or an object with `mesh`, or with `vertices` and `faces`
        Closed and outward, in any unit u; a `Particle` and a trimesh object will do.
    box : {"principal", "solid", "vertices", "minimum"}
        Box whose extents are the principal dimensions: along the principal axes of the surface, of the solid (the axes
        of inertia) or of the vertices, or that of least volume.
    scale : float
        Scale of the roundness: its curvature is that within `scale` times the radius of the inscribed sphere.

    Raises
    ------
    MeshError
        If the mesh is open, inside out or without volume, or a convention is unknown.
    """

    def __init__(self, mesh: Any, *, box: BoxKind = "principal", scale: float = 0.25) -> None:
        if box not in get_args(BoxKind):
            raise MeshError(f"expected a box of {', '.join(get_args(BoxKind))}; got {box!r}.")
        if not 0.02 <= scale <= 1.0:
            raise MeshError(f"expected a scale of roundness from 0.02 to 1 (times the inscribed radius); got {scale}.")
        self.mesh = _as_mesh(mesh)
        self.box_kind: BoxKind = box
        self.scale = float(scale)
        _require_closed(self.mesh)

    @property
    def mass(self) -> MassProperties:
        """Volume, area, centroid and inertia."""
        return self.mesh.mass_properties

    @cached_property
    def hull(self) -> Hull:
        """Convex hull."""
        from lithoform.descriptors.hull import convex_hull

        return convex_hull(self.mesh)

    @cached_property
    def minimum_box(self) -> Box:
        """Box of least volume in any orientation."""
        from lithoform.descriptors.boxes import minimum_box, principal_box

        return minimum_box(self.hull, start=principal_box(self.mesh))

    @cached_property
    def box(self) -> Box:
        """The box of the convention asked for."""
        from lithoform.descriptors.boxes import principal_box

        if self.box_kind == "minimum":
            return self.minimum_box
        return principal_box(self.mesh, weighting="surface" if self.box_kind == "principal" else self.box_kind)

    @property
    def dimensions(self) -> tuple[float, float, float]:
        """Extents of `box`, l_c >= l_b >= l_a [u]."""
        length, width, thickness = self.box.extents.tolist()
        return length, width, thickness

    @cached_property
    def caliper(self) -> Caliper:
        """Caliper dimensions."""
        from lithoform.descriptors.calipers import caliper_dimensions

        return caliper_dimensions(self.hull)

    @cached_property
    def sieve_size(self) -> float:
        """Side of the smallest square opening that the body passes [u]."""
        from lithoform.descriptors.passing import sieve_size

        return sieve_size(self.hull)

    @cached_property
    def inscribed(self) -> Sphere:
        """Largest inscribed sphere."""
        from lithoform.descriptors.inscribed import inscribed_sphere

        return inscribed_sphere(self.mesh)

    @cached_property
    def roundness(self) -> Roundness:
        """Roundness with its corners."""
        from lithoform.descriptors.roundness import roundness

        return roundness(self.mesh, scale=self.scale, inscribed=self.inscribed)

    @cached_property
    def fractal(self) -> FractalDimension:
        """Growth of the relief with the window."""
        from lithoform.descriptors.fractal import fractal_dimension

        return fractal_dimension(self.mesh)

    @cached_property
    def principal_inertia(self) -> tuple[float, float, float]:
        """Principal moments of inertia at unit density, rising [u^5]."""
        low, middle, high = np.linalg.eigvalsh(self.mass.inertia).tolist()
        return low, middle, high


def _as_mesh(given: Any) -> Mesh:
    if isinstance(given, Mesh):
        return given
    if isinstance(getattr(given, "mesh", None), Mesh):
        return given.mesh
    if hasattr(given, "vertices") and hasattr(given, "faces"):
        return Mesh(np.asarray(given.vertices), np.asarray(given.faces))
    raise MeshError(f"expected a mesh, a particle or an object with vertices and faces; got {type(given).__name__}.")


def _require_closed(mesh: Mesh) -> None:
    """Refuse what no measure holds for; a full check of soundness is `lithoform.check`, and takes longer."""
    gap = float(np.linalg.norm(mesh.area_vectors.sum(axis=0)))
    area = float(np.sqrt((mesh.area_vectors**2).sum(axis=1)).sum())
    if not gap <= _OPEN * area:
        raise MeshError("expected a closed surface, but its area vectors do not cancel; repair it with read_scan.")
    if not mesh.volume > 0.0:
        raise MeshError(
            f"expected a positive volume, got {mesh.volume:g}: the mesh is inside out or flat; "
            "repair it with read_scan."
        )
