"""The sidecar of a mesh file: JSON that says what made the mesh, what the file holds, and the checksums of both."""

from __future__ import annotations

import json
import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import atomic_write
from lithoform.errors import FileFormatError
from lithoform.mesh import Mesh
from lithoform.mesh_io import FORMATS, UNITS, file_unit, known_key, read_bytes

__all__ = ["build_sidecar", "program_version", "read_sidecar", "sidecar_path", "write_sidecar"]

_SCHEMA: Final = 1
_SIDECAR_KEYS: Final = (
    "lithoform", "schema", "recipe", "seed", "file", "format", "unit", "units", "triangles", "vertices",
    "volume", "area", "centroid", "inertia", "content_sha256", "file_sha256",
)  # fmt: skip


def program_version() -> str:
    """Version of this program, as sidecars and plans record it."""
    try:
        return version("lithoform")
    except PackageNotFoundError:
        return "0+unknown"  # run from a folder, not installed


def build_sidecar(
    *,
    recipe: dict[str, Any],
    mesh: Mesh,
    mesh_file: str,
    file_sha256: str,
    format: str,
    unit: str,
    extra: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """What made a mesh, what is in its file, and the checksums of both.

    Parameters
    ----------
    recipe : dict
        `Recipe.as_dict()`, with its seed.
    mesh : Mesh
        In metres, before the rounding of the file.
    mesh_file, file_sha256 : str
        Name of the file (its folder is dropped), and what `write_mesh` returned.
    format, unit : str
        As given to `write_mesh`; the entry "unit" is that of the file, see `file_unit`.
    extra : dict, optional
        Further entries, plain values.

    Returns
    -------
    dict
        Mass properties (the inertia tensor about the centroid, at unit density) are in the file's unit, as
        "units" tells; "content_sha256" is `Mesh.content_hash`, of vertices and faces in metres.

    Raises
    ------
    FileFormatError
        If the format or the unit is unknown, or `extra` has a key of the sidecar itself.
    MeshError
        If the mesh encloses no volume.
    """
    name, held = known_key("mesh format", format, FORMATS), file_unit(format, unit)
    u, mass = UNITS[held], mesh.mass_properties
    taken = [key for key in extra or {} if key in _SIDECAR_KEYS]
    if taken:
        raise FileFormatError(f"a sidecar has its own {', '.join(taken)}; rename them.")
    values = (
        program_version(), _SCHEMA, recipe, recipe.get("seed"), Path(mesh_file).name, name, held,
        {"volume": f"{held}^3", "area": f"{held}^2", "centroid": held, "inertia": f"{held}^5"},
        len(mesh.faces), len(mesh.vertices), mass.volume * u**3, mass.area * u**2,
        (mass.centroid * u).tolist(), (mass.inertia * u**5).tolist(), mesh.content_hash, file_sha256,
    )  # fmt: skip
    return dict(zip(_SIDECAR_KEYS, values, strict=True)) | (extra or {})


def sidecar_path(mesh_file: str | os.PathLike[str]) -> Path:
    """The JSON file beside a mesh file: 000001.stl -> 000001.json."""
    return Path(mesh_file).with_suffix(".json")


def write_sidecar(path: str | os.PathLike[str], sidecar: dict[str, Any]) -> None:
    """Write a sidecar as JSON, keys in their order, floats and 64-bit integers exact.

    Raises
    ------
    FileFormatError, OutputError
        If a value is not finite or not a plain one; if the file cannot be written.
    """
    try:
        text = json.dumps(sidecar, indent=2, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: expected plain, finite values in the sidecar ({error}).") from None
    atomic_write(path, (text + "\n").encode())


def read_sidecar(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a sidecar; a `FileFormatError` if it is missing or broken, lacks a key, or is too new."""
    path = Path(path)
    try:
        sidecar = json.loads(read_bytes(path), parse_constant=_refuse)
    except FileFormatError:
        raise
    except (ValueError, RecursionError):
        raise FileFormatError(f"{path}: expected a sidecar in JSON; it is truncated or damaged.") from None
    schema = sidecar.get("schema") if isinstance(sidecar, dict) else None
    is_number = type(schema) is int  # True, too, is equal to 1
    if is_number and schema > _SCHEMA:
        raise FileFormatError(f"{path}: its schema {schema} is newer than {_SCHEMA}; update lithoform.")
    missing = [key for key in _SIDECAR_KEYS if not isinstance(sidecar, dict) or key not in sidecar]
    if missing or not is_number or schema != _SCHEMA:
        lacks = f"lacks {', '.join(missing)}" if missing else f"says schema {schema!r}"
        raise FileFormatError(f"{path}: expected a lithoform sidecar of schema {_SCHEMA}, but it {lacks}.")
    return sidecar


def _refuse(constant: str) -> float:
    raise ValueError(constant)
