"""Scanned stones from files: found, read in any usual format, repaired where needed, each with an account of it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from lithoform.errors import FileFormatError, LithoformError, MeshError
from lithoform.mesh import Mesh, weld
from lithoform.mesh_io import UNITS, known_key, read_bytes
from lithoform.scans.formats import SCAN_EXTENSIONS, Decoded, decode, format_of_content
from lithoform.scans.repair import refuse_flat
from lithoform.scans.repair import repair as repair_mesh
from lithoform.scans.spherical_harmonics import (
    is_coefficient_text,
    is_geometry_table,
    parse_coefficients,
    stone_of,
    usable_degree,
)
from lithoform.soundness import check

__all__ = ["Scan", "ScanFailure", "find_scans", "read_scan", "read_scans"]

_Path = str | os.PathLike[str]
_MILLIMETRES: Final = 1000.0


@dataclass(frozen=True, eq=False)
class Scan:
    """A stone read from a file.

    Attributes
    ----------
    mesh : Mesh
        Closed, outward, sound; in metres, in the frame of the file.
    repairs : tuple of str
        What was wrong and was set right, one plain sentence each; empty for a file without fault.
    path : Path
    source_format : str
        What the content is: a value of `lithoform.scans.formats.SCAN_EXTENSIONS`.
    reading : tuple of str
        What reading did that is usual in the format and no fault: corners merged, polygons cut, the degree of a
        series.
    """

    mesh: Mesh
    repairs: tuple[str, ...]
    path: Path
    source_format: str
    reading: tuple[str, ...] = ()


@dataclass(frozen=True)
class ScanFailure:
    """A file that could not be read, in a batch that goes on.

    Attributes
    ----------
    path : Path
    error : str
        One sentence that names the file and the fault.
    """

    path: Path
    error: str


def find_scans(paths: _Path | Iterable[_Path]) -> list[Path]:
    """Files that are, or may be, scans.

    Parameters
    ----------
    paths : path-like, or iterable of path-like
        A folder stands for the files of known extensions in it and below, in the order of their names; of those
        named .dat, for coefficient files alone.  Any other name is kept as it is, so that reading it tells what is
        wrong, unless it is NIST's table of sizes (as a shell's `*.dat` would give).

    Returns
    -------
    list of Path
        Each once, in the order given.

    Raises
    ------
    FileFormatError
        If a folder holds none.
    """
    given = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    found: list[Path] = []
    for path in map(Path, given):
        if os.path.isdir(path):  # noqa: PTH112 (Path.is_dir raises for a name too long)
            inside = sorted(p for p in path.rglob("*") if p.suffix.lower() in SCAN_EXTENSIONS and p.is_file())
            inside = [p for p in inside if p.suffix.lower() != ".dat" or _is_coefficient_file(p)]
            if not inside:
                raise FileFormatError(f"the folder {path} holds no scans ({', '.join(SCAN_EXTENSIONS)}).")
            found += inside
        elif not (path.suffix.lower() == ".dat" and is_geometry_table(_head(path))):
            found.append(path)
    return list(dict.fromkeys(found))


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(4096)
    except OSError:
        return b""


def _is_coefficient_file(path: Path) -> bool:
    # By its name too, so that a broken one is told and not passed over.
    return "-anm-" in path.name or is_coefficient_text(_head(path))


def read_scan(
    path: _Path, *, unit: str = "mm", triangles: int = 20_000, max_degree: int | None = None, repair: bool = True
) -> Scan:
    """Read one stone: STL, PLY, OBJ, OFF, glTF, GLB, 3MF, VTP, or NIST's spherical-harmonic coefficients.

    Parameters
    ----------
    path : path-like
        Its content tells the format; a name that says otherwise is reported.
    unit : str
        A key of `lithoform.mesh_io.UNITS`, for the formats that do not tell it: glTF and GLB are in metres, 3MF
        names its own, coefficients are in millimetres.
    triangles : int
        About how many a series of coefficients is evaluated to, 8 to 8,000,000.
    max_degree : int, optional
        Degree up to which coefficients are used; by default that of the table (``*-geom.dat``) beside the file, and
        all without one.
    repair : bool
        Set right what `lithoform.repair.repair` can; otherwise a mesh that is not sound is refused.

    Returns
    -------
    Scan

    Raises
    ------
    FileFormatError
        If the file is not there, is broken, holds no triangles, or its surface cannot be made that of one solid;
        the message names the file and the fault.
    """
    path = Path(path)
    per_metre = UNITS[known_key("unit", unit, UNITS)]
    data = read_bytes(path)
    try:
        return _read(path, data, per_metre, triangles, max_degree, repair)
    except (FileFormatError, MeshError) as error:
        raise FileFormatError(f"{path}: {error}") from None


def _read(path: Path, data: bytes, per_metre: float, triangles: int, max_degree: int | None, repaired: bool) -> Scan:
    if is_geometry_table(data):
        raise FileFormatError("it is a table of sizes, not a stone; name the files of coefficients beside it.")
    name = format_of_content(data, path.suffix)
    if name is None:
        raise FileFormatError(
            f"neither its name nor its content is that of a known format ({', '.join(SCAN_EXTENSIONS.values())})."
        )
    if name == "anm":
        coefficients = parse_coefficients(data)
        degree = max_degree if max_degree is not None else usable_degree(path)
        degree = len(coefficients) - 1 if degree is None else degree
        stone = stone_of(coefficients, degree=degree, triangles=triangles)
        decoded = Decoded(stone.vertices, stone.faces, _MILLIMETRES)
        decoded.steps.append(f"evaluated the coefficients up to degree {degree}")
    else:
        decoded = decode(data, name, path)
    if SCAN_EXTENSIONS.get(path.suffix.lower()) != name:
        decoded.alarms.append(
            f"its name says {path.suffix or 'nothing'}, but its content is {name}, as which it was read"
        )
    decoded = _joined(decoded)
    vertices = decoded.vertices / (decoded.per_metre or per_metre)
    if not repaired:
        refuse_flat(vertices, decoded.faces)
        mesh = Mesh(vertices, decoded.faces)
        problems = check(mesh).problems()
        if problems:
            raise MeshError(f"{'; '.join(problems)}; read it with repair.")
        return Scan(mesh, tuple(decoded.alarms), path, name, tuple(decoded.steps))
    result = repair_mesh((vertices, decoded.faces))
    return Scan(result.mesh, (*decoded.alarms, *result.notes), path, name, tuple(decoded.steps))


def _joined(decoded: Decoded) -> Decoded:
    """Corners of equal coordinates as one vertex, where the surface is open without: usual in STL, and at seams."""
    start, end = decoded.faces, np.roll(decoded.faces, -1, axis=1)
    keys = np.minimum(start, end).astype(np.int64) * len(decoded.vertices) + np.maximum(start, end)
    if (np.unique(keys, return_counts=True)[1] > 1).all():
        return decoded
    vertices, faces = weld(decoded.vertices, decoded.faces)
    if len(vertices) < len(decoded.vertices):
        decoded.steps.append(f"merged {len(decoded.vertices):,} corners into {len(vertices):,} vertices")
    decoded.vertices, decoded.faces = vertices, faces
    return decoded


def read_scans(
    paths: _Path | Iterable[_Path],
    *,
    unit: str = "mm",
    triangles: int = 20_000,
    max_degree: int | None = None,
    repair: bool = True,
) -> Iterator[Scan | ScanFailure]:
    """Read many stones, one at a time; a file that fails does not stop the others.

    Parameters
    ----------
    paths : path-like, or iterable of path-like
        Files, or folders, which stand for the scans in them (`find_scans`).
    unit, triangles, max_degree, repair
        As `read_scan`.

    Yields
    ------
    Scan or ScanFailure
        One for each file, in order.

    Raises
    ------
    FileFormatError
        If the unit is unknown.
    """
    known_key("unit", unit, UNITS)
    for path in _files(paths):
        try:
            yield read_scan(path, unit=unit, triangles=triangles, max_degree=max_degree, repair=repair)
        except LithoformError as error:
            yield ScanFailure(Path(path), str(error))
        except MemoryError:
            raise
        except Exception as error:
            # A fault of ours or of a library's reader is no reason to lose the rest of a long batch.
            yield ScanFailure(Path(path), f"{path}: reading failed unexpectedly ({type(error).__name__}: {error}).")


def _files(paths: _Path | Iterable[_Path]) -> Iterator[Path]:
    for path in map(Path, [paths] if isinstance(paths, str | os.PathLike) else paths):
        # A folder with the name of a scan was taken for one: reading it tells.
        is_plain_folder = os.path.isdir(path) and path.suffix.lower() not in SCAN_EXTENSIONS  # noqa: PTH112
        yield from find_scans(path) if is_plain_folder else [path]
