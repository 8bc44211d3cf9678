"""Scans and NIST coefficient files as rows of a database, measured by the code that measures generated particles."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from lithoform.database.building import Measures, batch_size, carry_out, guarded
from lithoform.database.store import new_source
from lithoform.errors import FileFormatError
from lithoform.mesh_io import UNITS, known_key, read_bytes
from lithoform.scans.reading import find_scans, read_scan
from lithoform.scans.spherical_harmonics import require_possible

__all__ = ["import_scans"]


def import_scans(
    folder: str | Path,
    paths: Iterable[str | os.PathLike[str]],
    measures: Measures | None = None,
    *,
    source: str,
    unit: str = "mm",
    triangles: int = 20_000,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Iterator[int]:
    """Read, repair, measure and store scans that are not there yet.

    Parameters
    ----------
    folder : path-like
        A database, or a new or empty folder.
    paths : iterable of path-like
        Files or folders, as `lithoform.scans.reading.find_scans` takes them; workers elsewhere must see them too.
    measures : Measures, optional
        Meshes are kept by default, since no recipe makes them again.
    source : str
        Name of these particles in the database.
    unit : str
        Of files that do not tell theirs.
    triangles : int
        Of meshes made from spherical harmonics.
    workers, scheduler
        As `lithoform.database.engine.spread`.

    Yields
    ------
    int
        Number of each scan, from 1 in the order of the files, once its row is on the disk.

    Raises
    ------
    FileFormatError, MeshError, OutputError, ClusterError
        If nothing is found, an option is unknown, or the database cannot be written; a scan that cannot be read has a
        row with the reason in the column error.
    """
    measures = (measures or Measures(keep_meshes=True)).resolved()
    unit = known_key("unit", unit, UNITS)
    require_possible(triangles)
    files = find_scans(paths)
    if not files:
        raise FileFormatError("expected at least one scan; the folders hold none.")
    absent = [file for file in files if not file.exists()]
    if absent:
        raise FileFormatError(f"there is no {absent[0]}; name files or folders of scans.")
    # By their content, so that an import that goes on later takes the same files.
    plan = {"files": [[_text(file), _digest(file)] for file in files], "unit": unit, "triangles": triangles,
            **measures.as_dict()}  # fmt: skip
    size = batch_size(len(files), keep_meshes=True)
    entry = new_source(source, "scanned", len(files), batch=size, keeps_meshes=measures.keep_meshes, plan=plan)

    def job(numbers: Sequence[int]) -> dict[str, Any]:
        mine = [(str(files[n - 1].absolute()), _text(files[n - 1])) for n in numbers]
        return {"files": mine, "unit": unit, "triangles": triangles, "measures": measures}

    return carry_out(folder, entry, _scanned_rows, job, workers=workers, scheduler=scheduler)


def _text(file: Path) -> str:
    """Name of a file as a text that every file takes: names may hold bytes that are no text in any coding."""
    return str(file).encode(errors="surrogateescape").decode(errors="backslashreplace")


def _digest(file: Path) -> str | None:
    """SHA-256 of a file's content; None if it cannot be read, which its row will tell."""
    try:
        return hashlib.sha256(read_bytes(file)).hexdigest()
    except FileFormatError:
        return None


def _scanned_rows(job: dict[str, Any], numbers: Sequence[int]) -> Iterator[tuple[dict[str, Any], Any]]:
    for path, told in job["files"]:
        yield guarded({"file": told}, lambda path=path: _measured(Path(path), job))


def _measured(path: Path, job: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    digest = _digest(path)
    scan = read_scan(path, unit=job["unit"], triangles=job["triangles"])
    row = job["measures"].row(scan.mesh)
    told = {"file_sha256": digest, "file_format": scan.source_format, "repairs": [*scan.repairs]}
    return {"class": row["zingg_class"], **told, **row}, scan.mesh
