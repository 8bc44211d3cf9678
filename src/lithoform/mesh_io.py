"""Meshes to files and back (stl, ply, obj, glb, 3mf); `lithoform.sidecar` says beside each how it was made.

Inside lithoform lengths are metres; a unit of another name exists only here, at the edge.  The same mesh
gives the same bytes on every run.  Reading repairs and drops nothing: what is not whole is an error.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import struct
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from lithoform.atomic import atomic_write
from lithoform.errors import FileFormatError, MeshError
from lithoform.mesh import Mesh, weld
from lithoform.parameters import suggest

__all__ = [
    "FORMATS", "MAGIC", "STL_TRIANGLE", "UNITS", "MeshFormat", "encode_mesh", "file_unit", "format_of", "known_key",
    "read_bytes", "read_mesh", "read_scene", "stored_vertices", "write_mesh",
]  # fmt: skip

_Path = str | os.PathLike[str]


@dataclass(frozen=True)
class MeshFormat:
    """One row of the table of formats.

    Attributes
    ----------
    name, meaning : str
        The extension is the name with a dot.
    dtype : {"float32", "float64"}
        Precision of the stored vertices; float64 is exact, in the texts too.
    unit_rule : {"asked", "declared", "metre"}
        The unit asked for, which the file does not tell; the same, told in the file; always metres.
    welded : bool
        Triangles share vertices, in the mesh's order; otherwise each repeats its corners.
    """

    name: str
    dtype: Literal["float32", "float64"]
    unit_rule: Literal["asked", "declared", "metre"]
    welded: bool
    meaning: str

    @property
    def extension(self) -> str:
        """Ending of the file's name."""
        return f".{self.name}"


FORMATS: Final[dict[str, MeshFormat]] = {row.name: row for row in (
    MeshFormat("stl", "float32", "asked", False, "binary STL"),
    MeshFormat("ply", "float64", "asked", True, "binary little-endian PLY, coordinates as doubles"),
    MeshFormat("obj", "float64", "asked", True, "Wavefront OBJ, the shortest decimals that are exact"),
    MeshFormat("glb", "float32", "metre", True, "binary glTF 2.0, whose standard demands metres"),
    MeshFormat("3mf", "float64", "declared", True, "3MF, the shortest decimals that are exact"),
)}  # fmt: skip

UNITS: Final[dict[str, float]] = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "um": 1e6, "in": 1 / 0.0254}
"""Units per metre."""

_UNITS_3MF: Final = {"m": "meter", "cm": "centimeter", "mm": "millimeter", "um": "micron", "in": "inch"}
# "millimeters" is what trimesh calls the unit of a file that names none: the standard's default.
_PER_METRE_3MF: Final = {_UNITS_3MF[u]: UNITS[u] for u in UNITS} | {"foot": 1 / 0.3048, "millimeters": 1000.0}
MAGIC: Final = {b"glTF": "glb", b"PK\x03\x04": "3mf", b"ply\n": "ply", b"ply\r": "ply"}
STL_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_FACET: Final = ("facet normal 0 0 0 outer loop " + "vertex 0 0 0 " * 3 + "endloop endfacet").split()
_OBJ_HEADER: Final = "# lithoform: {} vertices, {} triangles\n"
_POLYGONS: Final = "expected triangles, but it holds polygons of more corners; triangulate it before."


def format_of(path: _Path) -> str:
    """Key of `FORMATS` that a file's extension tells; a `FileFormatError` that names the nearest if none."""
    try:
        return known_key("mesh format", Path(path).suffix, FORMATS)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None


def file_unit(format: str, unit: str) -> str:
    """Unit that a file really holds when `unit` is asked for: always "m" in glb, as asked in the others."""
    asked = known_key("unit", unit, UNITS)
    return "m" if FORMATS[known_key("mesh format", format, FORMATS)].unit_rule == "metre" else asked


def stored_vertices(mesh: Mesh, format: str, unit: str = "mm") -> np.ndarray:
    """Vertices as the file will hold them, after its rounding; for a check of the rounded mesh.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    format, unit : str
        Keys of `FORMATS` and `UNITS`.

    Returns
    -------
    numpy.ndarray, shape (n, 3), float64
        In the unit `file_unit(format, unit)`.

    Raises
    ------
    FileFormatError
        If the format or the unit is unknown.
    MeshError
        If a coordinate is too large for the format.
    """
    name, scale = known_key("mesh format", format, FORMATS), UNITS[file_unit(format, unit)]
    with np.errstate(over="ignore", under="ignore"):
        stored = (mesh.vertices * scale).astype(FORMATS[name].dtype).astype(np.float64)
    if not np.isfinite(stored).all():
        largest = abs(mesh.vertices).max()
        raise MeshError(f"coordinates of {largest:g} m are too large for {name} in {unit}; choose ply in m.")
    return stored


def encode_mesh(mesh: Mesh, format: str, *, unit: str = "mm") -> bytes:
    """Content of a mesh file: the same bytes for the same mesh (3mf: with the same zlib).

    The mesh is in metres; the format, the unit and the errors are those of `stored_vertices`.
    """
    name, held = known_key("mesh format", format, FORMATS), file_unit(format, unit)
    vertices = stored_vertices(mesh, format, unit)
    if name == "ply":
        return _encode_ply(vertices, mesh.faces)
    if name == "obj":
        # Not trimesh: it writes a fixed number of decimals, in which small coordinates lose their digits.
        text = [_OBJ_HEADER.format(len(vertices), len(mesh.faces))]
        text += [f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist()]
        text += [f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist()]
        return "".join(text).encode()
    import trimesh

    options: dict[str, Any] = {"include_normals": False} if name == "glb" else {}
    data: Any = trimesh.Trimesh(vertices, mesh.faces, process=False).export(file_type=name, **options)
    return _fixed_3mf(data, _UNITS_3MF[held]) if name == "3mf" else data


def _encode_ply(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    # Not trimesh: it knows only float32.
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    return header.encode() + vertices.astype("<f8").tobytes() + rows.tobytes()


def _fixed_3mf(archive: bytes, unit: str) -> bytes:
    """A 3mf of trimesh with its unit named, and without what differs from run to run, system to system."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as source, zipfile.ZipFile(out, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "3D/3dmodel.model":
                # trimesh calls every mesh millimeter; its random UUIDs belong to an extension not needed.
                if content.count(b' unit="millimeter">') != 1:
                    raise FileFormatError("trimesh has changed how it writes 3mf; install trimesh 5.2.")
                content = content.replace(b' unit="millimeter">', f' unit="{unit}">'.encode(), 1)
                content = re.sub(rb' p:UUID="[^"]*"', b"", content)
            # A fresh entry is dated 1980, but tells the system that wrote it.
            entry = zipfile.ZipInfo(name)
            entry.create_system = 0
            target.writestr(entry, content, zipfile.ZIP_DEFLATED, 6)
    return out.getvalue()


def write_mesh(path: _Path, mesh: Mesh, *, unit: str = "mm", format: str | None = None) -> str:
    """Write a mesh file, whole or not at all.

    Parameters
    ----------
    path : path-like
        Its extension tells the format unless `format` does.
    mesh : Mesh
        In metres.
    unit, format : str
        Keys of `UNITS` and `FORMATS`; see `file_unit`.

    Returns
    -------
    str
        SHA-256 of the file's bytes.

    Raises
    ------
    FileFormatError, MeshError
        As `stored_vertices`.
    OutputError
        If the file cannot be written.
    """
    data = encode_mesh(mesh, format or format_of(path), unit=unit)
    atomic_write(path, data)
    return hashlib.sha256(data).hexdigest()


def read_mesh(path: _Path, *, unit: str = "mm") -> Mesh:
    """Read a mesh of triangles as it stands in its file.

    The corners of an STL (binary or text) are merged where their coordinates are equal, in the order of their
    first occurrence.  The bodies of a glb or 3mf scene are placed as the scene says and joined into one mesh.

    Parameters
    ----------
    path : path-like
        Its extension tells the format.
    unit : str
        Unit of an stl, ply or obj; glb is in metres, and 3mf names its own.

    Returns
    -------
    Mesh
        In metres.

    Raises
    ------
    FileFormatError
        If the file is not there, is not what its name says, is truncated, holds polygons or no triangles, or
        has coordinates that are not finite; the message names the file.
    """
    path = Path(path)
    name, per_metre = format_of(path), UNITS[known_key("unit", unit, UNITS)]
    data = read_bytes(path)
    found = MAGIC.get(data[:4], name if name in ("stl", "obj") else "different")
    if found != name:
        raise FileFormatError(f"{path}: its name says {name}, but its content is {found}; rename it.")
    try:
        if name in ("glb", "3mf"):
            vertices, faces, per_metre = read_scene(data, name)
        else:
            vertices, faces = {"stl": _read_stl, "ply": _read_ply, "obj": _read_obj}[name](data)
        if len(faces) == 0:
            raise FileFormatError("it holds no triangles; check how it was exported.")
        return Mesh(np.asarray(vertices, np.float64) / per_metre, faces)
    except (FileFormatError, MeshError) as error:
        raise FileFormatError(f"{path}: {error}") from None
    except (MemoryError, ImportError):
        raise
    except Exception as error:
        # Whatever a reader stumbles on in a broken file: an index, a number, a checksum, a missing name.
        raise FileFormatError(f"{path}: it is truncated or is no {name} file; export it again.") from error


def _read_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    count = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 0
    if len(data) == 84 + STL_TRIANGLE.itemsize * count:
        return weld(np.frombuffer(data[84:], STL_TRIANGLE)["corners"].reshape(-1, 3))
    text = data.decode("latin-1").lower().lstrip()
    if not text.startswith("solid"):
        raise FileFormatError(f"its size is not that of {count} triangles; it is truncated or no stl file.")
    text, begun = re.subn(r"(?m)^[ \t]*solid\b.*$", "", text)
    text, ended = re.subn(r"(?m)^[ \t]*endsolid\b.*$", "", text)
    pattern = np.array(_STL_FACET)
    words, fixed = np.array(text.split()).reshape(-1, len(pattern)), pattern != "0"
    if begun != ended or (words[:, fixed] != pattern[fixed]).any():
        raise ValueError("a solid or a facet is not whole")
    return weld(words[:, ~fixed][:, 3:].astype(np.float64).reshape(-1, 3))


def _read_ply(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    from trimesh.exchange.ply import load_ply

    # Below trimesh.load, which would merge vertices; fix_texture would split them.
    loaded = load_ply(io.BytesIO(data), fix_texture=False, skip_materials=True)
    declared = {name: element["length"] for name, element in loaded["metadata"]["_ply_raw"].items()}
    vertices, faces = loaded.get("vertices", np.empty((0, 3))), loaded.get("faces", np.empty((0, 3), int))
    if faces.shape[1] != 3 or len(faces) > declared.get("face", 0):
        raise FileFormatError(_POLYGONS)
    if len(vertices) != declared.get("vertex", 0) or len(faces) != declared.get("face", 0):
        raise ValueError("a text file with fewer lines than its header promises")
    return vertices, faces


def _read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    # Not trimesh: it splits vertices where textures or normals change, and reverses the order of materials.
    text = data.decode("latin-1")
    vertices: list[tuple[float, float, float]] = []
    faces: list[list[int]] = []
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        match line.partition("#")[0].split():
            case ["v", x, y, z, *_]:
                vertices.append((float(x), float(y), float(z)))
            case ["f", a, b, c]:
                corners = [int(corner.partition("/")[0]) for corner in (a, b, c)]
                faces.append([i + len(vertices) if i < 0 else i - 1 for i in corners])
            case ["f", _, _, _, *_]:
                raise FileFormatError(_POLYGONS)
            case ["v" | "f", *_]:
                raise ValueError("too few numbers")
    # The format itself cannot tell that its end is missing; ours says so in its first line.
    if text.startswith(_OBJ_HEADER[:12]) and not (
        text.startswith(_OBJ_HEADER.format(len(vertices), len(faces))) and text.endswith("\n")
    ):
        raise ValueError("fewer lines than the header promises")
    return np.array(vertices), np.array(faces)


def read_scene(data: bytes, name: str, resolver: Any = None) -> tuple[np.ndarray, np.ndarray, float]:
    """Vertices, faces and units per metre of a glb, gltf or 3mf scene, its bodies placed as it says and joined.

    The resolver is trimesh's, for the files that a gltf refers to.  A `FileFormatError` tells of parts that are no
    plain triangles, of a glb cut short and of unknown units; other broken content raises what the reader meets.
    """
    import trimesh

    if name != "3mf":
        _check_gltf(_gltf_header(data) if name == "glb" else json.loads(data))
    # postprocess would rename bodies, and textures are not wanted.
    options: dict[str, Any] = {"postprocess": False} if name == "3mf" else {"skip_materials": True}
    if resolver is not None:
        options["resolver"] = resolver
    scene = trimesh.load_scene(io.BytesIO(data), file_type=name, process=False, **options)
    unit = scene.metadata["units"] if name == "3mf" else "meter"
    if unit not in _PER_METRE_3MF:
        raise FileFormatError(f"expected a unit of {', '.join(_UNITS_3MF.values())} or foot, got {unit!r}.")
    vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        body = scene.geometry[geometry]
        placed = np.asarray(body.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
        vertices.append(np.asarray(body.vertices) if (matrix == np.eye(4)).all() else placed)
        # A mirror turns a body inside out.
        faces.append(count + np.asarray(body.faces)[:, :: -1 if np.linalg.det(matrix[:3, :3]) < 0 else 1])
        count += len(body.vertices)
    return np.concatenate(vertices), np.concatenate(faces), _PER_METRE_3MF[unit]


def _gltf_header(data: bytes) -> dict[str, Any]:
    """The JSON part of a glb, after a check of its length."""
    length, size = struct.unpack("<8xII", data[:16])
    if length != len(data):
        raise FileFormatError(f"it has {len(data)} bytes, not the {length} it promises; it is truncated.")
    return json.loads(data[20 : 20 + size])


def _check_gltf(header: dict[str, Any]) -> None:
    """Refuse what trimesh would read as less than it is: parts that it skips or fills with zeros."""
    modes = {part.get("mode", 4) for mesh in header.get("meshes", []) for part in mesh["primitives"]}
    sparse = any("sparse" in accessor for accessor in header.get("accessors", []))
    if header.get("extensionsRequired") or sparse or modes - {4}:
        raise FileFormatError("expected plain triangles, got points, lines, strips or packed data.")


def known_key(kind: str, value: str, known: Iterable[str]) -> str:
    """The key of a table that a user's word means, in any case; a `FileFormatError` that names the nearest if none."""
    key = str(value).lower().removeprefix(".")
    if key not in known:
        raise FileFormatError(f"expected a {kind} of {', '.join(known)}, got {value!r}.{suggest(key, known)}")
    return key


def read_bytes(path: Path) -> bytes:
    """Content of a file; a `FileFormatError` if it is not there, cannot be read or is empty."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise FileFormatError(f"{path}: there is no such file; check the name and the folder.") from None
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise FileFormatError(f"{path}: it cannot be read ({reason}); check its name.") from None
    if not data:
        raise FileFormatError(f"{path}: it is empty; the program that wrote it may have been stopped.")
    return data
