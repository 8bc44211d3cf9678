"""Measure files: every particle a row, whatever is wrong with the others."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lithoform.descriptors.body import Body, BoxKind
from lithoform.descriptors.measuring import Measurement, measure, resolve_names
from lithoform.errors import LithoformError
from lithoform.mesh_io import UNITS, known_key
from lithoform.parallel import in_order
from lithoform.scans.reading import Scan, read_scan
from lithoform.scans.spherical_harmonics import require_possible
from lithoform.topology import sphere

__all__ = ["Row", "rows_to_csv", "survey"]


@dataclass(frozen=True, eq=False)
class Row:
    """What was found of one file.

    Attributes
    ----------
    file : pathlib.Path
    measurement : Measurement or None
        In the unit asked for; None where the file could not be measured.
    repairs : tuple of str
        What had to be repaired before it could be measured.
    error : str
        Why it could not be measured, else "".
    """

    file: Path
    measurement: Measurement | None
    repairs: tuple[str, ...] = ()
    error: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Plain values: `file`, the descriptors' names; `conventions`, `repairs`, `notes`, `error` where there are."""
        told: dict[str, Any] = {"file": str(self.file), **(self.measurement or {})}
        if self.measurement is not None and self.measurement.conventions:
            told["conventions"] = self.measurement.conventions
        if self.repairs:
            told["repairs"] = list(self.repairs)
        if self.measurement is not None and self.measurement.notes:
            told["notes"] = list(self.measurement.notes)
        if self.error:
            told["error"] = self.error
        return told


def survey(
    files: Sequence[Path],
    names: Sequence[str] | None = None,
    *,
    unit: str = "mm",
    triangles: int = 20_000,
    box: BoxKind = "principal",
    scale: float = 0.25,
    threads: int | None = None,
) -> Iterator[Row]:
    """Read and measure files on all cores, in their order.

    Parameters
    ----------
    files : sequence of path
        As `find_scans` returns them.
    names : sequence of str, optional
        As `measure`.
    unit : str
        Unit of the files that do not tell theirs, and of the results.
    triangles : int
        Of the meshes made from spherical harmonics.
    box, scale, threads
        As `measure_many`.

    Yields
    ------
    Row
        With an error in place of values where a file cannot be read, repaired or measured.

    Raises
    ------
    MeshError, FileFormatError
        If a name, the unit, the box or the scale is unknown, or the number of triangles is out of its range; before any
        file is read.
    """
    wanted, per_metre = resolve_names(names), UNITS[known_key("unit", unit, UNITS)]
    # Any body will do to tell a box or a scale that is unknown.
    Body(sphere("octahedral", 1), box=box, scale=scale)
    require_possible(triangles)

    def work(path: Path) -> Row:
        try:
            scan: Scan = read_scan(path, unit=unit, triangles=triangles)
            values = measure(scan.mesh, wanted, box=box, scale=scale).scaled(per_metre)
        except LithoformError as error:
            return Row(path, None, error=_one_line(str(error)).removeprefix(f"{_one_line(str(path))}: "))
        except MemoryError:
            raise
        except Exception as error:
            # A fault of ours or of a library is no reason to lose the rest of a long batch.
            return Row(
                path, None, error=f"measuring failed unexpectedly ({type(error).__name__}: {_one_line(str(error))})."
            )
        return Row(path, values, scan.repairs)

    return in_order(work, files, threads=threads)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def rows_to_csv(rows: Sequence[Row], names: Sequence[str], conventions: Mapping[str, Any]) -> bytes:
    """Rows as CSV: file, the descriptors, the conventions they hold under, repairs, notes, error."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["file", *names, *conventions, "repairs", "notes", "error"])
    for row in rows:
        values = row.measurement or {}
        notes = row.measurement.notes if row.measurement is not None else ()
        cells = [values.get(name, "") for name in names]
        writer.writerow(
            [str(row.file), *cells, *conventions.values(), "; ".join(row.repairs), "; ".join(notes), row.error]
        )
    # Names of files may hold bytes that are no text in any coding.
    return out.getvalue().encode(errors="backslashreplace")
