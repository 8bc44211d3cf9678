"""Decoding of mesh files from elsewhere: what is in the bytes, with polygons cut into triangles and nothing repaired.

The content decides, not the name: a file that is misnamed is read as what it is, and that is told.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from lithoform.errors import FileFormatError
from lithoform.mesh_io import MAGIC, STL_TRIANGLE, read_scene
from lithoform.scans.hole_filling import triangulate_polygons
from lithoform.scans.ply import parse_numbers, read_ply_polygons
from lithoform.scans.vtp import read_vtp_polygons

__all__ = ["SCAN_EXTENSIONS", "Decoded", "decode", "format_of_content"]

SCAN_EXTENSIONS: Final = {
    ".stl": "stl", ".ply": "ply", ".obj": "obj", ".off": "off", ".gltf": "gltf", ".glb": "glb", ".3mf": "3mf",
    ".vtp": "vtp", ".dat": "anm",
}  # fmt: skip
"""Format that an extension promises; anm are NIST's spherical-harmonic coefficients."""

_OFF: Final = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF\b")
_OBJ: Final = re.compile(rb"^(v|vt|vn|f|o|g|s|mtllib|usemtl)[ \t]\S", re.MULTILINE)


@dataclass(eq=False)
class Decoded:
    """Arrays of a file.

    Attributes
    ----------
    vertices : numpy.ndarray, shape (n, 3), float64
        In the file's unit; may hold what is not finite.
    faces : numpy.ndarray of int64, shape (m, 3)
        Each index points to a vertex.
    per_metre : float or None
        Units per metre, where the file or its format tells it.
    steps : list of str
        What decoding did that is usual.
    alarms : list of str
        What was found that is not as the format promises.
    """

    vertices: np.ndarray
    faces: np.ndarray
    per_metre: float | None = None
    steps: list[str] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)


def format_of_content(data: bytes, suffix: str) -> str | None:
    """Format that a file's bytes tell, else the one that its extension promises; None if neither is known.

    Parameters
    ----------
    data : bytes
    suffix : str
        Extension with its dot.

    Returns
    -------
    str or None
        A value of `SCAN_EXTENSIONS`.
    """
    from lithoform.scans.spherical_harmonics import is_coefficient_text

    promised = SCAN_EXTENSIONS.get(suffix.lower())
    if data[:4] in MAGIC:
        return MAGIC[data[:4]]
    count = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 0
    if count and len(data) == 84 + STL_TRIANGLE.itemsize * count:
        return "stl"
    head = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    if head[:5].lower() == b"solid" and b"facet" in head.lower():
        return "stl"
    if _OFF.match(head):
        return "off"
    if head.startswith(b"<") and b"<VTKFile" in head:
        return "vtp"
    if head.startswith(b"{") and b'"asset"' in data:
        return "gltf"
    if is_coefficient_text(data):
        return "anm"
    if promised not in ("stl", "anm") and _OBJ.search(head):
        return "obj"
    return promised


def decode(data: bytes, name: str, path: Path) -> Decoded:
    """Vertices and triangles of a file's bytes.

    Parameters
    ----------
    data : bytes
    name : str
        A mesh format of `SCAN_EXTENSIONS`: not anm.
    path : Path
        Where a gltf looks for its side files.

    Returns
    -------
    Decoded

    Raises
    ------
    FileFormatError
        If the bytes are not what the format promises, or hold no triangles; the file is not named.
    """
    if name in MAGIC.values() and data[:4] not in MAGIC:
        raise FileFormatError(f"it does not begin as a {name} file does; check what it is, and its name.")
    try:
        # Numbers that are none, or too large, are for the repair to tell.
        with np.errstate(all="ignore"):
            found = _read_scene_files(data, name, path) if name in ("glb", "gltf", "3mf") else _READERS[name](data)
    except (FileFormatError, MemoryError, ImportError):
        raise
    except FileNotFoundError as error:
        raise FileFormatError(f"the file {error} that it names is not there; keep it beside this one.") from None
    except Exception as error:
        # Whatever a reader stumbles on in a broken file: an index, a number, a checksum, a missing name.
        raise FileFormatError(f"it is truncated or is no {name} file; export it again.") from error
    if len(found.faces) == 0:
        raise FileFormatError(
            f"it holds {len(found.vertices):,} points and no triangles; make a surface of them first, for example with "
            "the Poisson reconstruction of MeshLab or CloudCompare."
        )
    low, high = int(found.faces.min()), int(found.faces.max())
    if low < 0 or high >= len(found.vertices):
        raise FileFormatError(
            f"a face names vertex {high if high >= len(found.vertices) else low} of {len(found.vertices)}; the file "
            "may be truncated."
        )
    return found


def _from_polygons(vertices: np.ndarray, sizes: np.ndarray, corners: np.ndarray) -> Decoded:
    vertices = np.ascontiguousarray(vertices, np.float64)
    if corners.size and (corners.min() < 0 or corners.max() >= len(vertices)):
        # As they stand: the caller names the index that points nowhere.
        return Decoded(vertices, np.resize(corners, (-(-corners.size // 3), 3)))
    decoded = Decoded(vertices, triangulate_polygons(vertices, sizes, corners))
    many = int((sizes > 3).sum())
    if many:
        decoded.steps.append(f"cut {many:,} polygons into triangles")
    return decoded


def _read_stl(data: bytes) -> Decoded:
    count = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 0
    held, rest = divmod(max(len(data) - 84, 0), STL_TRIANGLE.itemsize)
    named = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()[:5].lower() == b"solid"
    if named and not (count and len(data) == 84 + STL_TRIANGLE.itemsize * count):
        text = data.lower()
        if b"facet" in text[:4096] or held == 0 or b"endsolid" in text:
            return _read_text_stl(text.removeprefix(b"\xef\xbb\xbf"))
    if held == 0:
        raise FileFormatError("it is no stl file, binary or text; check its name.")
    corners = np.frombuffer(data, STL_TRIANGLE, min(held, count) if rest else held, 84)["corners"]
    decoded = _from_corners(corners.reshape(-1, 3))
    if rest and count > held:
        raise FileFormatError(f"its header promises {count:,} triangles, but it ends within number {held + 1:,}.")
    if rest:
        decoded.alarms.append(f"ignored {len(data) - 84 - count * STL_TRIANGLE.itemsize:,} bytes after the triangles")
    elif count != held:
        decoded.alarms.append(f"its header promises {count:,} triangles, but {held:,} were read")
        _refuse_if_cut(decoded, f"its header promises {count:,} triangles, but it holds {held:,}", count > held)
    return decoded


def _read_text_stl(text: bytes) -> Decoded:
    # A name of a solid may hold any word.
    body = re.sub(rb"(?m)^[ \t]*(end)?solid\b.*$", b"", text)
    words = body.split()
    begins = np.flatnonzero(np.array(words, dtype=bytes) == b"vertex") if words else np.empty(0, np.int64)
    facets = sum(word == b"endfacet" for word in words)
    if len(begins) % 3 or (len(begins) and begins[-1] + 3 >= len(words)):
        raise FileFormatError(f"it ends within triangle {len(begins) // 3 + 1:,}; it is truncated.")
    numbers = parse_numbers([words[i] for start in begins.tolist() for i in range(start + 1, start + 4)])
    decoded = _from_corners(numbers.reshape(-1, 3))
    whole = facets * 3 == len(begins) and b"endsolid" in text
    _refuse_if_cut(decoded, "its last line is missing", not whole)
    return decoded


def _from_corners(corners: np.ndarray) -> Decoded:
    return Decoded(corners.astype(np.float64), np.arange(len(corners), dtype=np.int64).reshape(-1, 3))


def _refuse_if_cut(decoded: Decoded, fault: str, suspect: bool) -> None:
    """A file that seems cut short is whole if its surface closes: then its header or its end was merely wrong."""
    if not suspect or len(decoded.faces) == 0:
        return
    _, numbered = np.unique(decoded.vertices, axis=0, return_inverse=True)
    start = numbered.reshape(-1, 3)
    end = np.roll(start, -1, axis=1)
    keys = np.minimum(start, end) * len(numbered) + np.maximum(start, end)
    if (np.unique(keys, return_counts=True)[1] != 2).any():
        raise FileFormatError(f"{fault}, and the surface is open; it is truncated.")


def _read_ply(data: bytes) -> Decoded:
    return _from_polygons(*read_ply_polygons(data))


def _read_off(data: bytes) -> Decoded:
    text = data.removeprefix(b"\xef\xbb\xbf")
    rows = [row for line in text.splitlines() if (row := line.partition(b"#")[0].split())]
    header = _OFF.fullmatch(rows[0][0]) if rows else None
    if header is None or b"BINARY" in rows[0] or header[4] or header[5]:
        raise FileFormatError("expected a text OFF file of three dimensions.")
    rows[0] = rows[0][1:]
    rows = rows if rows[0] else rows[1:]
    vertex_count, face_count = (int(word) for word in rows[0][:2])
    if len(rows) < 1 + vertex_count + face_count:
        raise FileFormatError(
            f"its header promises {vertex_count:,} vertices and {face_count:,} faces, but there are fewer lines; "
            "it is truncated."
        )
    words = [word for row in rows[1 : 1 + vertex_count] for word in row[:3]]
    polygons = [row[1 : 1 + int(row[0])] for row in rows[1 + vertex_count : 1 + vertex_count + face_count]]
    if any(len(p) != int(row[0]) for p, row in zip(polygons, rows[1 + vertex_count :], strict=False)):
        raise FileFormatError("a face names fewer vertices than it promises; it is truncated.")
    sizes = np.array([len(p) for p in polygons], np.int64)
    return _from_polygons(
        parse_numbers(words).reshape(-1, 3), sizes, np.array([int(w) for p in polygons for w in p], np.int64)
    )


def _read_obj(data: bytes) -> Decoded:
    words: list[bytes] = []
    polygons: list[list[int]] = []
    # A lone carriage return ends a line of an old Macintosh.
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ")
    for line in text.split(b"\n"):
        row = line.partition(b"#")[0].split()
        if row and row[0] == b"v":
            if len(row) < 4:
                raise FileFormatError(
                    f"vertex {len(words) // 3 + 1:,} has {len(row) - 1} numbers; it may be truncated."
                )
            words += row[1:4]
        elif row and row[0] == b"f":
            corners = [int(corner.partition(b"/")[0]) for corner in row[1:]]
            if len(corners) < 3:
                raise FileFormatError(f"face {len(polygons) + 1:,} has {len(corners)} corners; it may be truncated.")
            polygons.append([i + len(words) // 3 if i < 0 else i - 1 for i in corners])
    sizes = np.array([len(p) for p in polygons], np.int64)
    return _from_polygons(
        parse_numbers(words).reshape(-1, 3), sizes, np.array([i for p in polygons for i in p], np.int64)
    )


def _read_vtp(data: bytes) -> Decoded:
    return _from_polygons(*read_vtp_polygons(data))


def _read_scene_files(data: bytes, name: str, path: Path) -> Decoded:
    resolver = None
    if name == "gltf":
        from trimesh.resolvers import FilePathResolver

        resolver = FilePathResolver(str(path))
    vertices, faces, per_metre = read_scene(data, name, resolver)
    return Decoded(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), per_metre)


_READERS: Final[dict[str, Callable[[bytes], Decoded]]] = {
    "stl": _read_stl, "ply": _read_ply, "obj": _read_obj, "off": _read_off, "vtp": _read_vtp,
}  # fmt: skip
