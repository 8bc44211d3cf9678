"""Stones for a packing: mesh files, folders of them, and particles of databases, made anew from their recipes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from lithoform.database.meshes import MESH_COLUMNS, choose, particle_mesh, particle_name
from lithoform.database.store import Store, is_store
from lithoform.dem import Shape
from lithoform.errors import FileFormatError, LithoformError, MeshError, OutputError, RecipeError, SampleError
from lithoform.mesh import Mesh
from lithoform.mesh_io import UNITS, known_key
from lithoform.parallel import in_order
from lithoform.progress import track
from lithoform.scans.reading import find_scans, read_scan

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Source", "draw", "find_stones", "read_shapes", "refuse_inside"]

# Different stones in a packing: each keeps its mesh and its hull in memory, 1 MB at 20,000 triangles.
_MOST_SHAPES: Final = 1000
# Stones that a message names.
_NAMED: Final = 10

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
    key : tuple of (str, int) or None
        Source and number of a particle of a database; None of a file.
    """

    name: str
    read: _Read
    key: tuple[str, int] | None = None


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
        found += [
            Source(particle_name(row), partial(_from_table, store, table, i), (row["source"], row["number"]))
            for i, row in enumerate(names)
        ]
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


def read_shapes(
    stones: Sequence[Source], *, threads: int | None = None, progress: bool = False
) -> list[tuple[Shape, tuple[str, ...]]]:
    """Shapes of stones in their order, with the repairs that the meshes took.

    Raises
    ------
    FileFormatError, MeshError
        If stones cannot be read or are no bodies; the message names them and tells what to do.
    """

    def work(stone: Source) -> tuple[Shape, tuple[str, ...]] | LithoformError:
        try:
            mesh, repairs = stone.read()
        except (FileFormatError, MeshError) as error:
            return error
        try:
            return Shape.from_mesh(mesh), repairs
        except MeshError as error:
            # What follows the colon is a way out for those who build meshes and shapes; here it is another.
            reason = str(error).rstrip(".")
            return MeshError(reason.rpartition(": ")[0] or reason)

    read: list[tuple[Shape, tuple[str, ...]]] = []
    bad: list[tuple[Source, LithoformError]] = []
    results = track(in_order(work, stones, threads=threads), total=len(stones), what="stones", enabled=progress)
    for stone, result in zip(stones, results, strict=True):
        if isinstance(result, LithoformError):
            bad.append((stone, result))
        else:
            read.append(result)
    if bad:
        raise _refusal(bad, len(stones))
    return read


def _refusal(bad: Sequence[tuple[Source, LithoformError]], count: int) -> LithoformError:
    """The error of stones that cannot be used: all names, what is wrong with the first, the way out."""
    first, error = bad[0]
    told = f"{first.name}: {str(error).removeprefix(f'{first.name}: ').rstrip('.')}"
    if len(bad) > 1:
        listed = ", ".join(stone.name for stone, _ in bad[:_NAMED])
        more = f" and {len(bad) - _NAMED:,} more" if len(bad) > _NAMED else ""
        told = f"{len(bad):,} of {count:,} stones cannot be used ({listed}{more}); the first is {told}"
    keys = [stone.key for stone, _ in bad if stone.key is not None]
    ways = []
    if len(keys) < len(bad):
        ways.append(f"leave {'that file' if len(bad) - len(keys) == 1 else 'those files'} out")
    if keys:
        listed = ", ".join(f"('{source}', {number})" for source, number in keys[:_NAMED])
        ways.append(f'give --select "(source, number) not in ({listed}{", ..." if len(keys) > _NAMED else ""})"')
    if count == len(bad):
        # Without them nothing would be left; what is wrong with a file tells by itself what to do.
        ways = ["give other stones"] if isinstance(error, MeshError) else []
    return type(error)("; ".join([told, *([", and ".join(ways)] if ways else [])]) + ".")


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
