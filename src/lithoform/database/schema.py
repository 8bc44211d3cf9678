"""Columns of a database: one row a particle, generated or scanned, in SI units.

Every batch has all columns, null where they do not apply or were not measured, so that all files of a database read as
one table.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from lithoform.descriptors.table import DESCRIPTORS
from lithoform.parameters import PARAMETERS, Recipe
from lithoform.recipe_io import from_dict

if TYPE_CHECKING:
    import pyarrow as pa

    from lithoform.descriptors.measuring import Measurement
    from lithoform.mesh import Mesh

__all__ = [
    "RECIPE_COLUMNS", "SCHEMA_VERSION", "mesh_row", "mesh_schema", "mesh_table", "particle_schema", "recipe_of",
    "recipe_values", "shape_values",
]  # fmt: skip

SCHEMA_VERSION: Final = 1
"""Of the columns and the folder; raised when an older lithoform could not read what a newer one writes."""

_SIZES: Final = {"length": "target_length", "width": "target_width", "height": "target_height"}

RECIPE_COLUMNS: Final = {f.name: _SIZES.get(f.name, f.name) for f in dataclasses.fields(Recipe)}
"""Column of each field of a recipe: its own name, but target_length for length, which is a descriptor as well."""

_UNITS: Final = {0: "1", 1: "m", 2: "m^2", 3: "m^3", 5: "m^5"}


def particle_schema() -> pa.Schema:
    """Columns of the particles: name, Arrow type, and as metadata of each column its meaning and its unit."""
    import pyarrow as pa

    texts, vector = pa.list_(pa.string()), pa.list_(pa.float64(), 3)
    number, whole, text = pa.float64(), pa.int64(), pa.string()
    kinds = {float: number, int: whole, bool: pa.bool_(), str: text, tuple: vector}
    told = {p.name: (f"{p.symbol}: {p.meaning}", p.unit) for p in PARAMETERS}
    rows: list[tuple[str, Any, str, str]] = [
        ("source", text, "name of the build or import that the particle came with", ""),
        ("number", whole, "of the particle in its source, from 1", ""),
        ("kind", text, "generated or scanned", ""),
        ("class", text, "Zingg class: of the target dimensions if generated, of the measured ones if scanned", ""),
        ("error", text, "why there is no particle of this recipe or file; null where all is well", ""),
        ("content_hash", text, "SHA-256 of the mesh's vertices and faces", ""),
        ("triangles_in_mesh", whole, "number of triangles of the mesh that was measured", "1"),
        ("centroid", vector, "of the solid, in the frame of the mesh", "m"),
        ("inertia", pa.list_(number, 9), "about the centroid at unit density, row by row", "m^5"),
        ("box", text, "box of boxiness and of length, width and thickness", ""),
        ("roundness_scale", number, "scale of the roundness, times the inscribed radius", "1"),
        ("notes", texts, "what a reader should know of the measurements", ""),
        ("certificate", text, "how the generated mesh was found sound", ""),
        ("relaxed_vertices", whole, "vertices whose relief was softened where faces crossed after the twist", "1"),
        ("relaxation_rounds", whole, "rounds that took", "1"),
        ("used_flatten_band", number, "band of the flattening that was used", "height"),
        ("file", text, "that the scan was read from", ""),
        ("file_sha256", text, "of its content", ""),
        ("file_format", text, "what the content is", ""),
        ("repairs", texts, "what was set right in the scan", ""),
        ("lithoform", text, "version of the program that made the row", ""),
    ]
    for name, value in Recipe().as_dict().items():
        meaning, unit = told.get(name, (f"recipe: {name}", ""))
        kind = pa.uint64() if name == "seed" else kinds[type(value)]
        rows.append((RECIPE_COLUMNS[name], kind, f"recipe, {meaning}", unit))
    for d in DESCRIPTORS.values():
        kind = text if d.name == "zingg_class" else number
        rows.append((d.name, kind, f"{d.symbol}: {d.definition}".removeprefix(": "), _UNITS[d.power]))
    return pa.schema([pa.field(n, k, metadata={"meaning": m, "unit": u}) for n, k, m, u in rows])


def mesh_schema() -> pa.Schema:
    """Columns of kept meshes: coordinates x, y, z in turn [m], and vertex numbers, three a face, from 0."""
    import pyarrow as pa

    return pa.schema([
        ("source", pa.string()), ("number", pa.int64()), ("content_hash", pa.string()),
        ("vertices", pa.list_(pa.float64())), ("faces", pa.list_(pa.int32())),
    ])  # fmt: skip


def recipe_values(recipe: Recipe) -> dict[str, Any]:
    """Columns of a recipe."""
    return {RECIPE_COLUMNS[name]: value for name, value in recipe.as_dict().items()}


def recipe_of(row: Mapping[str, Any]) -> Recipe:
    """Recipe of a row, as it was.

    Raises
    ------
    RecipeError
        If the values are not those of a recipe, as in the row of a scan.
    """
    return from_dict({field: row[column] for field, column in RECIPE_COLUMNS.items()})


def shape_values(mesh: Mesh, measured: Measurement, *, box: str, scale: float) -> dict[str, Any]:
    """Columns of a mesh and its measures, which are in metres."""
    mass = mesh.mass_properties
    return {
        "content_hash": mesh.content_hash,
        "triangles_in_mesh": len(mesh.faces),
        "volume": mass.volume,
        "surface_area": mass.area,
        "centroid": mass.centroid.tolist(),
        "inertia": mass.inertia.ravel().tolist(),
        "box": box,
        "roundness_scale": scale,
        "notes": list(measured.notes),
        **measured,
    }


def mesh_row(source: str, number: int, mesh: Mesh) -> tuple[str, int, str, np.ndarray, np.ndarray]:
    """What `mesh_table` takes of one mesh."""
    return source, number, mesh.content_hash, mesh.vertices.ravel(), mesh.faces.ravel()


def mesh_table(rows: Sequence[tuple[str, int, str, np.ndarray, np.ndarray]]) -> pa.Table:
    """Table of kept meshes."""
    import pyarrow as pa

    sources, numbers, hashes, vertices, faces = zip(*rows, strict=True) if rows else ((), (), (), (), ())

    def lists(arrays: Sequence[np.ndarray], dtype: Any) -> Any:
        offsets = np.cumsum([0, *map(len, arrays)], dtype=np.int32)
        return pa.ListArray.from_arrays(offsets, np.concatenate([np.empty(0, dtype), *arrays]))

    columns = [pa.array(sources, pa.string()), pa.array(numbers, pa.int64()), pa.array(hashes, pa.string()),
               lists(vertices, np.float64), lists(faces, np.int32)]  # fmt: skip
    return pa.Table.from_arrays(columns, schema=mesh_schema())
