"""What comparisons take of a database or of a table of measurements: descriptors of particles, and their classes."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.database.queries import select
from lithoform.database.schema import particle_schema
from lithoform.database.store import Store, is_store
from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.errors import FileFormatError, SampleError
from lithoform.mesh_io import UNITS
from lithoform.parameters import suggest

__all__ = ["NO_CLASS", "TABLES", "Population", "read_population"]

TABLES: Final = (".csv", ".parquet")
"""Endings of tables of measurements, such as `lithoform measure --csv` writes."""


NO_CLASS: Final = "(none)"
"""Class of a particle without one."""

_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True, eq=False)
class Population:
    """Descriptors of the particles of one source.

    Attributes
    ----------
    label : str
        What it is called in tables and figures.
    names : tuple of str
        Descriptors, in the order of the columns.
    values : numpy.ndarray, shape (n, d)
        A row a particle; lengths in metres.
    classes : tuple of str or None
        Class of each particle, where one was asked for; "(none)" of a particle without.
    has_unit : bool
        Whether lengths are known to be in metres; of a table without a column unit they are taken as they are.
    """

    label: str
    names: tuple[str, ...]
    values: np.ndarray
    classes: tuple[str, ...] | None = None
    has_unit: bool = True

    def __len__(self) -> int:
        return len(self.values)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the descriptors, such as m, m² or m³; empty for plain numbers."""
        powers = (DESCRIPTORS[name].power if name in DESCRIPTORS else 0 for name in self.names)
        return tuple(f"m{'' if power == 1 else str(power).translate(_RAISED)}" if power else "" for power in powers)


def read_population(
    path: str | os.PathLike[str],
    names: Sequence[str] = FOUR,
    *,
    by: str | None = None,
    where: str | None = None,
    label: str | None = None,
) -> Population:
    """Descriptors of the particles of a database or of a table.

    Parameters
    ----------
    path : path-like
        A database, or a CSV or Parquet file with a column for each descriptor.
    names : sequence of str
        Of `DESCRIPTORS`, words like zingg_class excepted.
    by : str, optional
        Column of words that tells the classes: "class" (of a table without one, zingg_class), "source", ...
    where : str, optional
        Condition on the particles of a database, as `lithoform.database.queries.select` takes it.
    label : str, optional
        Default: the name of the folder or file.

    Raises
    ------
    FileFormatError
        If there is nothing to read, or a table cannot be read.
    SampleError
        If a name is unknown or was not measured, a condition is not valid, a table tells a unit that is unknown or has
        a column twice, or no particle is left.

    Notes
    -----
    Particles in error are left out.  Lengths in a table with a column unit, such as `lithoform measure --csv` writes,
    are turned into metres; those of other tables are taken as they are.  Classes that are whole numbers are the same
    with and without a decimal point.
    """
    path = Path(path)
    for name in names:
        if name == "zingg_class":
            raise SampleError(f"expected descriptors that are numbers; got {name!r}, which is a word: compare by it.")
        if name not in DESCRIPTORS:
            raise SampleError(f"expected descriptors that are numbers; got {name!r}.{suggest(name, DESCRIPTORS)}")
    has_unit = True
    if is_store(path):
        columns = _of_store(Store(path), names, by, where)
    elif path.is_file() and path.suffix.lower() in TABLES:
        if where is not None:
            raise SampleError(f"expected a database for a condition; {path} is a table: choose its rows before.")
        columns, has_unit = _of_table(path, names, by)
    else:
        there = "a folder without a database" if path.is_dir() else "no such file" if not path.exists() else "a file"
        raise FileFormatError(
            f"expected a database, or a table ending in {' or '.join(TABLES)}; {path} is {there}: make one with "
            "lithoform database import, or with lithoform measure --csv."
        )
    values = np.column_stack([columns[name] for name in names]) if names else np.empty((0, 0))
    if not len(values):
        raise SampleError(f"expected particles in {path}; there are none{' that meet the condition' if where else ''}.")
    bad = ~np.isfinite(values)
    if bad.any():
        column = int(bad.any(axis=0).argmax())
        raise SampleError(
            f"{path}: {names[column]} was not measured of {int(bad[:, column].sum())} of {len(values)} particles: "
            "build or import with --descriptors that hold it, or choose the rows that have it."
        )
    values.flags.writeable = False
    classes = None if by is None else tuple(columns[by])
    return Population(label or path.resolve().stem, tuple(names), values, classes, has_unit)


def _of_store(store: Store, names: Sequence[str], by: str | None, where: str | None) -> dict[str, Any]:
    texts = [f.name for f in particle_schema() if str(f.type) == "string"]
    if by is not None and by not in texts:
        raise SampleError(f"expected a column of words such as class or source; got {by!r}.{suggest(by, texts)}")
    table = select(store, [*dict.fromkeys([*names, *([by] if by else [])])], where)
    columns: dict[str, Any] = {name: table[name].to_numpy().astype(float) for name in names}
    if by is not None:
        columns[by] = [_word(value) for value in table[by].to_pylist()]
    return columns


def _of_table(path: Path, names: Sequence[str], by: str | None) -> tuple[dict[str, Any], bool]:
    """Columns, and whether there is a column unit."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    try:
        with path.open("rb") as file:
            table = (pyarrow.csv.read_csv if path.suffix.lower() == ".csv" else pyarrow.parquet.read_table)(file)
    except (OSError, pa.ArrowException) as error:
        raise FileFormatError(f"{path} cannot be read as a table ({' '.join(str(error).split())}).") from None
    chosen = "zingg_class" if by == "class" and "class" not in table.column_names else by
    for name in [*names, *([chosen] if chosen else [])]:
        if name not in table.column_names:
            raise SampleError(f"{path} has no column {name!r}.{suggest(name, table.column_names)}")
    for name in ("error", "unit", *names, *([chosen] if chosen else [])):
        times = table.column_names.count(name)
        if times > 1:
            raise SampleError(f"expected one column {name!r} in {path}, got {times}; rename or remove the others.")
    # A column of numbers called error tells how exact a measurement is, not why there is none.
    if "error" in table.column_names and str(table["error"].type) in ("string", "large_string"):
        table = table.filter([not value for value in table["error"].to_pylist()])
    metre, has_unit = np.ones(len(table)), "unit" in table.column_names
    if has_unit and any(DESCRIPTORS[name].power for name in names):
        metre = np.array([1.0 / _per_metre(path, unit) for unit in table["unit"].to_pylist()])
    columns: dict[str, Any] = {}
    for name in names:
        try:
            # A cell that is no number becomes one that is not finite, which is then told.
            values = np.array([np.nan if v in (None, "") else float(v) for v in table[name].to_pylist()], dtype=float)
        except ValueError:
            raise SampleError(f"{path}: the column {name!r} holds words; expected numbers.") from None
        columns[name] = values * metre ** DESCRIPTORS[name].power
    if by is not None:
        columns[by] = [_word(value) for value in table[chosen].to_pylist()]
    return columns, has_unit


def _per_metre(path: Path, unit: Any) -> float:
    known = UNITS.get(str(unit).strip().lower())
    if known is None:
        told = repr(unit) if str(unit or "").strip() else "none of a particle"
        raise SampleError(f"expected a unit of {', '.join(UNITS)} in {path}, got {told}; change the column unit.")
    return known


def _word(value: Any) -> str:
    """A class as text."""
    if value is None or value != value or not str(value).strip():
        return NO_CLASS
    text = str(value).strip()
    return whole[1] if (whole := re.fullmatch(r"([+-]?[0-9]+)\.0*", text)) else text
