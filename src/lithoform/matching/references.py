"""References of a match: a database, a table of measurements, or a folder of scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lithoform.database.population import TABLES, read_population
from lithoform.database.store import is_store
from lithoform.errors import FileFormatError
from lithoform.matching.stones import MATCHED
from lithoform.mesh_io import UNITS, known_key
from lithoform.progress import track
from lithoform.scans.reading import find_scans
from lithoform.survey import survey

__all__ = ["read_reference"]


def read_reference(
    path: str | Path, *, unit: str = "mm", triangles: int = 20_000, progress: bool = False
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Descriptors of a reference.

    Parameters
    ----------
    path : path-like
        A database, a CSV or Parquet table with columns named as `DESCRIPTORS`, or a folder of scans.
    unit : str
        Of scans that do not tell theirs.
    triangles : int
        Of meshes made from spherical harmonics.
    progress : bool

    Returns
    -------
    values : numpy.ndarray, shape (n, 7)
        Columns as in `lithoform.matching.stones.MATCHED`; lengths in metres.
    notes : tuple of str
        Scans that could not be measured, each with the reason, and a unit that was taken for granted.

    Raises
    ------
    FileFormatError
        If there is nothing to read, or no scan can be measured.
    SampleError
        If a column is missing or holds something else than numbers.
    """
    path = Path(path)
    if is_store(path) or path.suffix.lower() in TABLES:
        population = read_population(path, MATCHED)
        if population.has_unit:
            return population.values, ()
        median = float(np.median(population.values[:, MATCHED.index("length")]))
        return population.values, (f"{path} has no column unit: its lengths are taken as metres (median {median:g} m)",)
    if not path.is_dir():
        raise FileFormatError(f"expected a database, a folder of scans, or a table ending in {' or '.join(TABLES)}; "
                              f"{path} is {'a file of another kind' if path.exists() else 'not there'}.")  # fmt: skip
    per_metre = UNITS[known_key("unit", unit, UNITS)]
    files = find_scans([path])
    if not files:
        raise FileFormatError(f"expected scans in {path}; the folder holds none that can be read.")
    # Measures come in the unit asked for; the length is told in metres.
    stream = survey(files, MATCHED, unit=unit, triangles=triangles)
    rows = list(track(stream, total=len(files), what="scans", enabled=progress))
    values = [[float(row.measurement[name]) for name in MATCHED] for row in rows if row.measurement is not None]
    notes = tuple(f"not measured: {row.file}: {row.error}" for row in rows if row.error)
    if not values:
        raise FileFormatError(f"none of the {len(files)} scans in {path} can be measured; the first: "
                              f"{notes[0].removeprefix('not measured: ')}")  # fmt: skip
    table = np.array(values)
    table[:, MATCHED.index("length")] *= 1.0 / per_metre  # to the last bit as a table of the same scans
    return table, notes
