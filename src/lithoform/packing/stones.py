"""Stones for a packing: mesh files, folders of them, and particles of databases, made anew from their recipes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from lithoform.database.meshes import MESH_COLUMNS, choose, particle_mesh, particle_name
from lithoform.database.store import Store, is_store
from lithoform.dem import Shape
from lithoform.errors import MeshError, OutputError, RecipeError, SampleError
from lithoform.mesh import Mesh
from lithoform.mesh_io import UNITS, known_key
from lithoform.parallel import in_order
from lithoform.scans.reading import find_scans, read_scan

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Source", "draw", "find_stones", "read_shapes", "refuse_inside"]

# Different stones in a packing: each keeps its mesh and its hull in memory, 1 MB at 20,000 triangles.
_MOST_SHAPES: Final = 1000

_Read = Callable[[], tuple[Mesh, tuple[str, ...]]]


@dataclass(frozen=True, eq=False)
class Source:
    """A stone that can be read.

    Attributes
    ----------
    name : str
        Of the file; of a particle of a database SOURCE-000123.
    read : callable
        Gives the mesh [m] and the repairs that it took.
    """

    name: str
    read: _Read


def find_stones(given: Sequence[Path], *, unit: str = "mm", select: str | None = None) -> list[Source]:
    """Stones that mesh files, folders and databases hold, in their order; no mesh is read yet.

    Parameters
    ----------
    given : sequence of path
        Mesh files or NIST coefficient files, folders of them (a run of `lithoform generate`, say), databases.
    unit : str
        Of files that do not tell theirs.
    select : str, optional
        Which particles of a database: as `lithoform.database.meshes.choose`.

    Raises
    ------
    RecipeError
        If nothing is given, or `select` is given without a database.
    FileFormatError, SampleError
        If a folder or a database holds no stone, or the unit or the selection is not valid.
    """
    known_key("unit", unit, UNITS)
    if not given:
        raise RecipeError("expected meshes or a database, such as lithoform pack stones --container "
                          "cylinder:150mm:200mm --out packing; got none.")  # fmt: skip
    stores = [path for path in given if is_store(path)]
    if select is not None and not stores:
        raise RecipeError("--select chooses particles of a database, but none is given; leave it out.")
    found: list[Source] = []
    for path in given:
        if path not in stores:
            found += [Source(str(file), partial(_from_file, file, unit)) for file in find_scans([path])]
            continue
        store = Store(path)
        table = choose(store, MESH_COLUMNS, select)
        if not table.num_rows:
            raise SampleError(
                f"expected particles in the database {path}; {'none is chosen' if select else 'it is empty'}."
            )
        names = table.select(["source", "number"]).to_pylist()
        found += [Source(particle_name(row), partial(_from_table, store, table, i)) for i, row in enumerate(names)]
    return found


def draw(available: int, count: int | None, rng: np.random.Generator) -> np.ndarray:
    """Which stones are let down, in their order: at most 1,000 different ones, each about as often as any other.

    Parameters
    ----------
    available : int
    count : int or None
        How many; by default each once.
    rng : numpy.random.Generator

    Returns
    -------
    numpy.ndarray of int, shape (count,)

    Raises
    ------
    RecipeError
        If the count is not from 1 to 1,000,000.
    """
    count = available if count is None else count
    if not 1 <= count <= 1_000_000:
        raise RecipeError(f"expected --count from 1 to 1000000; got {count}.")
    used = rng.permutation(available)[:_MOST_SHAPES]
    whole, rest = divmod(count, len(used))
    chosen = np.concatenate([np.tile(used, whole), used[:rest]])
    return rng.permutation(chosen)


def read_shapes(stones: Sequence[Source], *, threads: int | None = None) -> Iterator[tuple[Shape, tuple[str, ...]]]:
    """Shapes of stones in their order, with the repairs that the meshes took.

    Raises
    ------
    FileFormatError, MeshError
        If a stone cannot be read or is no body; the message names it.
    """

    def work(stone: Source) -> tuple[Shape, tuple[str, ...]]:
        mesh, repairs = stone.read()
        try:
            return Shape.from_mesh(mesh), repairs
        except MeshError as error:
            raise MeshError(f"{stone.name}: {error}") from None

    return in_order(work, stones, threads=threads)


def refuse_inside(out: Path, given: Sequence[Path]) -> None:
    """Refuse to write into a folder that stones are read from: the next run would find its own files there.

    Raises
    ------
    OutputError
    """
    for path in given:
        if path.is_dir() and out.resolve().is_relative_to(path.resolve()):
            raise OutputError(f"the packing would lie in {path}, from which stones are read; name another place for "
                              "--out.")  # fmt: skip


def _from_file(file: Path, unit: str) -> tuple[Mesh, tuple[str, ...]]:
    scan = read_scan(file, unit=unit)
    return scan.mesh, scan.repairs


def _from_table(store: Store, table: pa.Table, row: int) -> tuple[Mesh, tuple[str, ...]]:
    return particle_mesh(store, table.slice(row, 1).to_pylist()[0], device="cpu"), ()
