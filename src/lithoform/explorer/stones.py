"""Stones for a page: a mesh and what is told of it, as one run of bytes; and files to keep."""

from __future__ import annotations

import json
import struct
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.errors import LithoformError, MeshError
from lithoform.explorer.state import MAX_TRIANGLES
from lithoform.mesh import Mesh
from lithoform.parameters import Recipe

if TYPE_CHECKING:
    from lithoform.explorer.turns import Ticket
    from lithoform.particle import Particle

__all__ = ["TOLD", "Stone", "file_of", "make_stone", "outline", "pack", "unpack"]

TOLD: Final = (*FOUR, "elongation", "flatness", "zingg_class", "volume", "surface_area", "length", "width", "thickness")
"""Descriptors of a stone of the studio."""

_MIME: Final = {"stl": "model/stl", "ply": "application/octet-stream", "obj": "model/obj", "glb": "model/gltf-binary",
                "3mf": "model/3mf", "json": "application/json", "toml": "application/toml"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stone:
    """A stone as a page shows it.

    Attributes
    ----------
    mesh : Mesh
        [m].
    told : mapping
        Plain values: descriptors, hash, number of triangles, seconds of work.
    """

    mesh: Mesh
    told: Mapping[str, Any]


def make_stone(recipe: Recipe, ticket: Ticket, *, names: tuple[str, ...] = TOLD) -> Stone:
    """Generate and measure a stone, giving up between the two if it is no longer wanted.

    Raises
    ------
    RecipeError, UnsoundMeshError, DeviceError
        As `lithoform.generate`.
    SupersededError
        If a newer request came.
    """
    from lithoform.descriptors.measuring import measure
    from lithoform.generation import generate

    started = time.perf_counter()
    particle = generate(recipe)
    made = time.perf_counter()
    ticket.require()
    measured = measure(particle, names)
    seconds = {"generate": made - started, "measure": time.perf_counter() - made}
    return Stone(particle.mesh, {**outline(particle.mesh), "descriptors": dict(measured), "notes": list(measured.notes),
                                 "certificate": particle.report.certificate, "seconds": seconds})  # fmt: skip


def outline(mesh: Mesh) -> dict[str, Any]:
    """What is told of every mesh."""
    return {"hash": mesh.content_hash, "triangles": len(mesh.faces)}


def pack(stone: Stone) -> bytes:
    """A stone as bytes: lengths of the three parts, then JSON, vertices and faces, all little-endian.

    Returns
    -------
    bytes
        Three uint32: bytes of the JSON (a multiple of 4), number of vertices n, number of faces m.  Then the JSON in
        UTF-8, padded by blanks; n x 3 float32 [m] about the middle of the box; m x 3 int32.

    Raises
    ------
    MeshError
        If the mesh is too large for a page.
    """
    mesh = stone.mesh
    if len(mesh.faces) > MAX_TRIANGLES:
        raise MeshError(f"the explorer draws at most {MAX_TRIANGLES:,} triangles; this mesh has {len(mesh.faces):,}: "
                        "look at it with lithoform picture.")  # fmt: skip
    text = json.dumps(stone.told, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    vertices = (mesh.vertices - middle).astype("<f4")
    head = struct.pack("<3I", len(text), len(vertices), len(mesh.faces))
    return b"".join([head, text, vertices.tobytes(), mesh.faces.astype("<i4").tobytes()])


def unpack(content: bytes) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """What `pack` told, the vertices (n, 3) float32 and the faces (m, 3) int32."""
    text, n, m = struct.unpack_from("<3I", content)
    told = json.loads(content[12 : 12 + text])
    vertices = np.frombuffer(content, "<f4", 3 * n, 12 + text).reshape(n, 3)
    return told, vertices, np.frombuffer(content, "<i4", 3 * m, 12 + text + 12 * n).reshape(m, 3)


def file_of(recipe: Recipe, kind: str, ticket: Ticket) -> tuple[str, str, bytes]:
    """A file to keep: name, media type and content.

    Parameters
    ----------
    recipe : Recipe
    kind : str
        "toml": the recipe; a format of meshes, in millimetres; "json": the sidecar of the STL file, which tells its
        recipe and checksums.
    ticket : Ticket

    Raises
    ------
    LithoformError
        If the kind is unknown, or as `lithoform.generate` and `Particle.save`.
    """
    from lithoform.generation import generate
    from lithoform.recipe_io import to_toml

    if kind not in _MIME:
        raise LithoformError(f"expected a file of {', '.join(_MIME)}; got {str(kind)[:20]!r}.")
    if kind == "toml":
        return "stone.toml", _MIME[kind], to_toml(recipe).encode()
    particle = generate(recipe)
    ticket.require()
    return _saved(particle, kind)


def _saved(particle: Particle, kind: str) -> tuple[str, str, bytes]:
    # The same hash names the mesh and its sidecar, so that they find each other among other downloads.
    stem = f"stone-{particle.mesh.content_hash[:8]}"
    with tempfile.TemporaryDirectory(prefix="lithoform-") as folder:
        particle.save(Path(folder) / f"{stem}.{'stl' if kind == 'json' else kind}", unit="mm")
        return f"{stem}.{kind}", _MIME[kind], (Path(folder) / f"{stem}.{kind}").read_bytes()
