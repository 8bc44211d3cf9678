"""Populations of a folder: its databases and their sources by name, never by path."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from lithoform.database.meshes import MESH_COLUMNS, particle_mesh
from lithoform.database.population import NO_CLASS
from lithoform.database.queries import select
from lithoform.database.schema import particle_schema, recipe_of
from lithoform.database.store import Store, is_store
from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.errors import FileFormatError, LithoformError
from lithoform.explorer.state import to_page
from lithoform.explorer.stones import Stone, outline
from lithoform.presets import SHAPE_CLASSES

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["PAGE", "Percentiles", "Shelf", "unit_of"]

PAGE: Final = 24
"""Stones of a contact sheet."""

_NUMBERS: Final = tuple(name for name in DESCRIPTORS if name != "zingg_class")


@dataclass(frozen=True, eq=False)
class Percentiles:
    """Where values are among those of a population.

    Attributes
    ----------
    label : str
        What the population is called.
    columns : mapping of str to numpy.ndarray
        Sorted values of each descriptor.
    """

    label: str
    columns: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, label: str, columns: Mapping[str, np.ndarray]) -> Percentiles:
        """Of values in any order; those that are not finite are left out."""
        kept = {name: np.sort(values[np.isfinite(values)]) for name, values in columns.items()}
        return cls(label, {name: values for name, values in kept.items() if len(values)})

    def place(self, name: str, value: float) -> float | None:
        """Share of the population below a value, equal ones counted half [percent]; None if it was not measured."""
        values = self.columns.get(name)
        if values is None:
            return None
        below, upto = np.searchsorted(values, value, "left"), np.searchsorted(values, value, "right")
        return 50.0 * float(below + upto) / len(values)


class Shelf:
    """Sources of the databases of a folder.

    Parameters
    ----------
    folder : path-like
        A database, or a folder of databases.

    Attributes
    ----------
    folder : Path
    sources : dict of str to (Store, str)
        Store and source by the name that the page knows: SOURCE, or DATABASE/SOURCE in a folder of databases.
    left_out : dict of str to str
        Databases of a folder that cannot be read, and why in a sentence.

    Raises
    ------
    FileFormatError
        If there is no database, or none that can be read.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.left_out: dict[str, str] = {}
        self._four: list[pa.Table] = []
        if is_store(self.folder):
            self.sources = self._read(self.folder, "")
        else:
            try:
                found = sorted(path for path in self.folder.iterdir() if path.is_dir())
            except OSError as error:
                told = f"{self.folder} cannot be read: {error.strerror}; name a folder with a database."
                raise FileFormatError(told) from None
            self.sources = {}
            for path in found:
                try:
                    self.sources |= self._read(path, f"{path.name}/") if is_store(path) else {}
                except FileFormatError as error:
                    self.left_out[path.name] = str(error)
        if self.left_out and not self.sources:
            raise FileFormatError(next(iter(self.left_out.values())))
        if not self.sources:
            raise FileFormatError(f"expected a database, or a folder of databases; {self.folder} holds none: make one "
                                  "with lithoform database build.")  # fmt: skip

    def _read(self, folder: Path, prefix: str) -> dict[str, tuple[Store, str]]:
        """Sources of a database by name; the four descriptors of all are read, so that damage shows now."""
        store = Store(folder)
        self._four += [store.table(list(FOUR), sources=[entry]) for entry in store.sources]
        return {f"{prefix}{entry}": (store, entry) for entry in store.sources}

    def column(self, source: Any, name: Any) -> tuple[np.ndarray, np.ndarray]:
        """Values of a descriptor, and the class of each particle; those in error or not measured are left out.

        Raises
        ------
        LithoformError
            If there is no such source or descriptor.
        FileFormatError
            If a file of the database is damaged.
        """
        if name not in _NUMBERS:
            raise LithoformError(f"expected a descriptor of a database; got {str(name)[:60]!r}.")
        store, entry = self._source(source)
        table = store.table(["error", "class", name], sources=[entry])
        values = table[name].to_numpy().astype(np.float64)
        classes = np.array([word or NO_CLASS for word in table["class"].to_pylist()])
        # A particle in error was not measured, so that its values are not finite.
        kept = np.isfinite(values)
        return values[kept], classes[kept]

    def measured(self, sources: Sequence[Any]) -> list[str]:
        """Descriptors that were measured in all of some sources, in the order of the table."""
        names = list(_NUMBERS)
        for source in sources:
            store, entry = self._source(source)
            table = store.table(names, sources=[entry])
            names = [name for name in names if table[name].null_count < table.num_rows]
        return names

    def percentiles(self) -> Percentiles | None:
        """The four descriptors of all sources together; None if no particle has them."""
        columns = {
            name: np.concatenate([table[name].to_numpy().astype(np.float64) for table in self._four]) for name in FOUR
        }
        found = Percentiles.of(f"{self.folder.resolve().name}", columns)
        return found if found.columns else None

    def sheet(self, source: Any, shape_class: Any, start: Any) -> dict[str, Any]:
        """Rows of a contact sheet: particles of a class, from the start-th on, at most `PAGE`.

        Parameters
        ----------
        source : str
        shape_class : str
            Of `SHAPE_CLASSES`, or "all".
        start : int
            From 0.

        Returns
        -------
        dict
            "total", "start" and "stones": a list of {"number", "class"} and the descriptors that were measured.

        Raises
        ------
        LithoformError
            If the request makes no sense, or the database is damaged.
        """
        store, entry = self._source(source)
        if shape_class != "all" and shape_class not in SHAPE_CLASSES:
            raise LithoformError(
                f"expected a class of {', '.join(SHAPE_CLASSES)} or all; got {str(shape_class)[:40]!r}."
            )
        if not _is_whole(start):
            raise LithoformError("expected a whole number as the first stone of a sheet; reload the page.")
        condition = f"source = '{entry}'" + ("" if shape_class == "all" else f" and class = '{shape_class}'")
        table = select(store, ["number", "class", *FOUR], condition)
        start = min(start, max(table.num_rows - 1, 0)) // PAGE * PAGE
        return {"total": table.num_rows, "start": start, "stones": table.slice(start, PAGE).to_pylist()}

    def stone(self, source: Any, number: Any) -> Stone:
        """A particle, its mesh kept or made again, with what its row tells.

        Raises
        ------
        LithoformError
            If there is none, or it cannot be made again.
        """
        store, entry = self._source(source)
        if not _is_whole(number):
            raise LithoformError("expected the number of a particle; reload the page.")
        columns = [*dict.fromkeys([*MESH_COLUMNS, "class", *_NUMBERS])]
        rows = select(store, columns, f"source = '{entry}' and number = {number}").to_pylist()
        if not rows:
            raise LithoformError(f"{source} has no particle {number}; choose one of its sheet.")
        row = rows[0]
        mesh = particle_mesh(store, row)
        recipe = to_page(recipe_of(row)) if row["kind"] == "generated" else None
        told = {
            "source": source,
            "number": number,
            "class": row["class"],
            "recipe": recipe,
            "descriptors": {name: row[name] for name in _NUMBERS if row[name] is not None},
        }
        return Stone(mesh, {**outline(mesh), **told})

    def _source(self, name: Any) -> tuple[Store, str]:
        found = self.sources.get(name) if isinstance(name, str) else None
        if found is None:
            raise LithoformError(f"expected a source of {', '.join(self.sources)}; got {str(name)[:60]!r}.")
        return found


def unit_of(name: str) -> str:
    """Unit of a column of a database; empty for plain numbers."""
    field = particle_schema().field(name)
    unit = (field.metadata or {}).get(b"unit", b"").decode()
    return "" if unit == "1" else unit


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53
