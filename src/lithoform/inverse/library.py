"""Design libraries: settings, and what a stone of each measured.

A library is a Parquet file of 32-bit numbers that any tool opens.  Its metadata tell the axes, the recipe that they
change, the version of the program and the seed of the design.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from lithoform.atomic import atomic_path
from lithoform.axes import Axis, at_axes
from lithoform.database.store import Store
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, LithoformError
from lithoform.inverse.building import LIBRARY_SOURCE, LibraryPlan, reaching
from lithoform.inverse.kernels import fit_kernel
from lithoform.parameters import Recipe
from lithoform.recipe_io import from_dict

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["DesignLibrary", "condense", "read_library", "shipped_library", "write_library"]

_KEY: Final = b"lithoform design library"
_FORMAT: Final = 1
_SHIPPED: Final = "library.parquet"


@dataclass(frozen=True, eq=False)
class DesignLibrary:
    """Stones of a design.

    Attributes
    ----------
    axes : tuple of Axis
        What was varied.
    base : Recipe
        What was not.
    coordinates : numpy.ndarray, shape (n, d)
        0 to 1 on each axis.
    descriptors : numpy.ndarray, shape (n, 4)
        Roundness, boxiness, solidity and true sphericity of the stone at each point.
    numbers : numpy.ndarray of int, shape (n,), or None
        Numbers of the points in the plan.
    about : dict
        How it was made: version, seed, count, and how many points gave no sound stone.
    """

    axes: tuple[Axis, ...]
    base: Recipe
    coordinates: np.ndarray
    descriptors: np.ndarray
    numbers: np.ndarray | None = None
    about: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.coordinates)

    def recipe(self, index: int, seed: int = 0) -> Recipe:
        """Recipe of a point, with a seed."""
        return self.recipe_at(self.coordinates[index], seed)

    def recipe_at(self, coordinates: np.ndarray, seed: int = 0) -> Recipe:
        """Recipe of any coordinates, shape (d,), with a seed."""
        settings = {axis.name: axis.setting(float(c)) for axis, c in zip(self.axes, coordinates, strict=True)}
        return at_axes(self.base, settings).replace(seed=seed)

    def at_triangles(self, triangles: int) -> DesignLibrary:
        """The same coordinates on stones of another number of triangles; the smoothing reaches equally far.

        What they measure is then an estimate, which a search with the real generator puts right.
        """
        if triangles == self.base.triangles:
            return self
        axes = tuple(reaching(axis, self.base.triangles, triangles) for axis in self.axes)
        return replace(self, axes=axes, base=self.base.replace(triangles=triangles))

    def values(self) -> np.ndarray:
        """Values of the parameters, each in its unit, shape (n, d)."""
        columns = zip(self.axes, self.coordinates.T, strict=True)
        return np.array([[axis.setting(float(c)) for c in column] for axis, column in columns], dtype=np.float64).T


def shipped_library() -> DesignLibrary:
    """The library that comes with the package.

    Raises
    ------
    FileFormatError
        If the file is missing or damaged.
    """
    return _shipped()


@lru_cache(maxsize=1)
def _shipped() -> DesignLibrary:
    with as_file(files("lithoform.inverse").joinpath(_SHIPPED)) as path:
        return read_library(path)


def condense(folder: str | Path) -> DesignLibrary:
    """Library of a finished database that was built by a `LibraryPlan`.

    Parameters
    ----------
    folder : path-like

    Raises
    ------
    FileFormatError
        If it holds no such stones, or not all of them.
    """
    store = Store(folder)
    source = store.sources.get(LIBRARY_SOURCE)
    if source is None or source.plan.get("design") != "sobol":
        raise FileFormatError(f"{folder} holds no stones of a design library; make one with lithoform design library "
                              "build.")  # fmt: skip
    plan = LibraryPlan(source.count, source.plan["seed"], source.plan["triangles"])
    table = store.table(["number", "error", *FOUR], sources=[LIBRARY_SOURCE]).sort_by("number")
    if table.num_rows != plan.count:
        raise FileFormatError(f"{folder} holds {table.num_rows} of {plan.count} stones of its library; the same "
                              "lithoform design library build finishes it.")  # fmt: skip
    made = np.array([reason is None for reason in table["error"].to_pylist()])
    numbers = table["number"].to_numpy()[made]
    descriptors = np.stack([table[name].to_numpy() for name in FOUR], axis=1)[made]
    about = {"lithoform": source.lithoform, "seed": plan.seed, "count": plan.count, "left_out": int((~made).sum())}
    coordinates = plan.coordinates[numbers - 1]
    kernels = [fit_kernel(coordinates, column).as_dict() for column in descriptors.T]
    return DesignLibrary(plan.axes, plan.base, coordinates, descriptors, numbers, {**about, "kernels": kernels})


def write_library(library: DesignLibrary, path: str | Path) -> Path:
    """Write a library, whole or not at all; the same library gives the same bytes.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    numbers = np.arange(1, len(library) + 1) if library.numbers is None else library.numbers
    columns: dict[str, Any] = {"number": pa.array(numbers.astype(np.int32))}
    for axis, column in zip(library.axes, library.coordinates.T, strict=True):
        columns[f"coordinate_{axis.name}"] = pa.array(column.astype(np.float32))
    for name, column in zip(FOUR, library.descriptors.T, strict=True):
        columns[name] = pa.array(column.astype(np.float32))
    about = {
        "format": _FORMAT,
        "axes": [[axis.name, axis.scale, axis.low, axis.high] for axis in library.axes],
        "base": library.base.as_dict(),
        "about": dict(library.about),
    }
    table = pa.table(columns).replace_schema_metadata({_KEY: json.dumps(about).encode()})
    with atomic_path(path) as partial, partial.open("wb") as sink:
        pq.write_table(table, sink, compression="zstd", compression_level=9, use_dictionary=False,
                       use_byte_stream_split=[name for name in columns if name != "number"],
                       write_page_checksum=True)  # fmt: skip
    return Path(path)


def read_library(path: str | Path) -> DesignLibrary:
    """Library of a file.

    Raises
    ------
    FileFormatError
        If it cannot be read or is no design library.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with Path(path).open("rb") as stream:
            table = pq.read_table(stream, page_checksum_verification=True)
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {error.strerror or 'it is no Parquet file'}.") from error
    except pa.ArrowException as error:
        raise FileFormatError(f"{path} is not a design library: expected a Parquet file that lithoform design library "
                              "build has written.") from error  # fmt: skip
    try:
        return _library_of(table)
    except (KeyError, TypeError, ValueError, LithoformError) as error:
        raise FileFormatError(f"{path} is not a design library that this version reads ({error}); build one with "
                              "lithoform design library build.") from error  # fmt: skip


def _library_of(table: pa.Table) -> DesignLibrary:
    about = json.loads((table.schema.metadata or {}).get(_KEY, b"{}"))
    if not isinstance(about, dict) or not isinstance(about.get("about", {}), dict):
        raise ValueError("its metadata are no table")
    if about.get("format") != _FORMAT:
        raise ValueError(f"its format is {about.get('format')}, and this version reads {_FORMAT}")
    axes = tuple(Axis(*row) for row in about["axes"])
    if len({axis.name for axis in axes}) < len(axes):
        raise ValueError("an axis is there twice")
    for row in about["about"].get("kernels", []):
        scales = np.array(row["scales"], dtype=np.float64)
        numbers = np.array([*scales, row["variance"], row["noise"]], dtype=np.float64)
        if scales.shape != (len(axes),) or not (np.isfinite(numbers).all() and (numbers > 0.0).all()):
            raise ValueError("its kernels are not of its axes")
    coordinates = np.stack([table[f"coordinate_{axis.name}"].to_numpy() for axis in axes], axis=1).astype(np.float64)
    descriptors = np.stack([table[name].to_numpy() for name in FOUR], axis=1).astype(np.float64)
    if not (np.isfinite(descriptors).all() and ((coordinates >= 0.0) & (coordinates <= 1.0)).all()):
        raise ValueError("numbers are missing or out of their range")
    base = from_dict({k: tuple(v) if isinstance(v, list) else v for k, v in about["base"].items()})
    return DesignLibrary(axes, base, coordinates, descriptors, table["number"].to_numpy(), about["about"])
