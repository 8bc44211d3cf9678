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
    plan = {"files": [[str(file), _size(file)] for file in files], "unit": unit, "triangles": triangles,
            **measures.as_dict()}  # fmt: skip
    size = batch_size(len(files), keep_meshes=True)
    entry = new_source(source, "scanned", len(files), batch=size, keeps_meshes=measures.keep_meshes, plan=plan)
    job = {"files": [str(file.absolute()) for file in files], "told": [str(file) for file in files], "unit": unit,
           "triangles": triangles, "measures": measures}  # fmt: skip
    return carry_out(folder, entry, _scanned_rows, job, workers=workers, scheduler=scheduler)


def _size(file: Path) -> int | None:
    """Size of a file [bytes], by which a later run knows whether it is still the same; None if it cannot be told."""
    try:
        return file.stat().st_size
    except OSError:
        return None


def _scanned_rows(job: dict[str, Any], numbers: Sequence[int]) -> Iterator[tuple[dict[str, Any], Any]]:
    for number in numbers:
        path = Path(job["files"][number - 1])
        row = {"file": job["told"][number - 1]}
        yield guarded(row, lambda path=path: _measured(path, job))


def _measured(path: Path, job: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    digest = hashlib.sha256(read_bytes(path)).hexdigest()
    scan = read_scan(path, unit=job["unit"], triangles=job["triangles"])
    row = job["measures"].row(scan.mesh)
    told = {"file_sha256": digest, "file_format": scan.source_format, "repairs": [*scan.repairs]}
    return {"class": row["zingg_class"], **told, **row}, scan.mesh
