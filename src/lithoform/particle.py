"""A particle: its recipe, its mesh, and what is known about how it was made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lithoform import mesh_io
from lithoform.errors import UnsoundMeshError
from lithoform.mesh import MassProperties, Mesh
from lithoform.parameters import Recipe
from lithoform.sidecar import build_sidecar, sidecar_path, write_sidecar
from lithoform.soundness import SoundnessReport, check

if TYPE_CHECKING:
    import pyvista
    import trimesh

__all__ = ["Particle"]


@dataclass(frozen=True, eq=False)
class Particle:
    """A generated stone.

    Attributes
    ----------
    recipe : Recipe
        Makes the same particle again, bit for bit on one platform.
    mesh : Mesh
        Closed surface [m], solid centroid at the origin.
    report : SoundnessReport
        How the mesh was found sound.
    relaxed_vertices : int
        Vertices whose relief was softened because faces crossed there after the twist (0 for most stones).
    relaxation_rounds : int
        Rounds that took, narrowings of the band included.
    flatten_band : float or None
        Thickness of the blended band that was used, as a fraction of the height: below the recipe's where that
        would not have been sound, None without flattening.
    """

    recipe: Recipe
    mesh: Mesh
    report: SoundnessReport
    relaxed_vertices: int = 0
    relaxation_rounds: int = 0
    flatten_band: float | None = None

    @property
    def mass_properties(self) -> MassProperties:
        """Volume [m^3], area [m^2], centroid [m] and inertia at unit density [m^5]."""
        return self.mesh.mass_properties

    @property
    def provenance(self) -> dict[str, Any]:
        """How the mesh came about beyond the recipe."""
        return {
            "certificate": self.report.certificate,
            "relaxed_vertices": self.relaxed_vertices,
            "relaxation_rounds": self.relaxation_rounds,
            "flatten_band": self.flatten_band,
        }

    def save(
        self, path: str | Path, *, unit: str = "mm", format: str | None = None, extra: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        """Write the mesh and, beside it, the JSON sidecar that makes it again.

        Parameters
        ----------
        path : str or Path
            File of the mesh; its extension names the format (stl, ply, obj, glb, 3mf) unless `format` does.
        unit : {"m", "cm", "mm", "um", "in"}
            Unit of length of the file (glTF files are always in metres, as their standard demands).
        format : str, optional
        extra : dict, optional
            Further entries of the sidecar.

        Returns
        -------
        dict
            The sidecar's content.

        Raises
        ------
        FileFormatError
            If the format or the unit is unknown.
        UnsoundMeshError
            If the mesh would not survive the rounding of the format (stl and glb hold 32-bit numbers).
        OutputError
            If a file cannot be written; nothing half-written is left.
        """
        target = Path(path)
        kind = format or mesh_io.format_of(target)
        stored = mesh_io.stored_vertices(self.mesh, kind, unit)
        report = check(self.mesh.with_vertices(stored))
        if not report.sound:
            raise UnsoundMeshError(
                f"rounded to the precision of {kind} files this mesh is not sound ({'; '.join(report.problems())}); "
                f"use --format ply or obj, which keep every digit.  The recipe: {self.recipe}",
                report,
                self.recipe,
            )
        digest = mesh_io.write_mesh(target, self.mesh, unit=unit, format=kind)
        sidecar = build_sidecar(
            recipe=self.recipe.as_dict(),
            mesh=self.mesh,
            mesh_file=target.name,
            file_sha256=digest,
            format=kind,
            unit=unit,
            extra={"provenance": self.provenance, **(extra or {})},
        )
        write_sidecar(sidecar_path(target), sidecar)
        return sidecar

    def to_trimesh(self) -> trimesh.Trimesh:
        """The mesh as a trimesh object [m], vertices and faces in the same order."""
        import trimesh

        return trimesh.Trimesh(self.mesh.vertices.copy(), self.mesh.faces.copy(), process=False)

    def to_pyvista(self) -> pyvista.PolyData:
        """The mesh as a PyVista object [m]; needs the extra ``pictures``."""
        from lithoform.rendering import to_polydata

        return to_polydata(self.mesh)

    def show(self) -> None:
        """Open a window with the stone; needs the extra ``pictures`` and a screen."""
        self.to_pyvista().plot(color="#b9a892", smooth_shading=False)

    def _repr_png_(self) -> bytes | None:
        """Picture for notebooks, where the extra ``pictures`` is installed."""
        from lithoform.errors import LithoformError
        from lithoform.figures.gallery import png_bytes
        from lithoform.rendering import render

        try:
            return png_bytes(render(self.mesh))
        except LithoformError:
            return None

    def __repr__(self) -> str:
        size = " x ".join(f"{1e3 * d:.4g}" for d in self.recipe.size)
        return (
            f"Particle(seed={self.recipe.seed}, {size} mm, {len(self.mesh.faces)} triangles, {self.report.certificate})"
        )
