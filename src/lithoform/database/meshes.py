"""Meshes of a database's particles: as they were kept, or made again from their recipes and held to the rows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from lithoform.database.queries import query, select
from lithoform.database.schema import RECIPE_COLUMNS, recipe_of
from lithoform.database.store import Store
from lithoform.errors import DeviceError, FileFormatError, LithoformError, MeshError, SampleError
from lithoform.generation import generate
from lithoform.mesh import Mesh
from lithoform.parallel import in_order
from lithoform.parameters import Recipe
from lithoform.particle import Particle
from lithoform.sidecar import program_version
from lithoform.soundness import check

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "MESH_COLUMNS", "choose", "particle_mesh", "particle_meshes", "particle_name", "restored_particle", "stream_rows",
]  # fmt: skip

MESH_COLUMNS: Final = (
    "source", "number", "kind", "error", "content_hash", "lithoform", "file", "relaxed_vertices", "relaxation_rounds",
    "used_flatten_band", *RECIPE_COLUMNS.values(),
)  # fmt: skip
"""Columns of a row that its mesh is found or made again from."""

_STATEMENT: Final = re.compile(r"\s*(?:select|with|from)\b", re.IGNORECASE)
_ROWS_AT_ONCE: Final = 256


def choose(store: Store, columns: Sequence[str], chosen: str | None = None) -> pa.Table:
    """Columns of the particles that a choice means, source by source, by number; those in error are left out.

    Parameters
    ----------
    store : Store
    columns : sequence of str
    chosen : str, optional
        A condition, what stands after WHERE, or a whole SELECT that gives source and number; all by default.

    Raises
    ------
    SampleError
        If a column is unknown, or the choice is empty, not valid SQL or gives no source and number.
    """
    condition = chosen if chosen is None else chosen.strip().rstrip("; \t\r\n")
    if condition is not None and not condition:
        raise SampleError("expected a condition such as class = 'cube'; got an empty one: leave it out to take all.")
    if condition is not None and _STATEMENT.match(condition):
        statement = condition
        _require_one(statement, "SELECT that gives source and number")
        # Asked first: a name that the statement lacks would be taken from the rows around it.
        given = query(store, f"select * from (\n{statement}\n) limit 0").column_names
        if not {"source", "number"} <= {name.lower() for name in given}:
            raise SampleError(
                f"expected a SELECT that gives source and number, or a condition such as class = 'cube'; it gives "
                f"{', '.join(given)}."
            )
        condition = f"(source, number) in (select source, number from (\n{statement}\n))"
    elif condition is not None:
        _require_one(f"select\n{condition}\n", "condition such as class = 'cube'", shown=condition)
    return select(store, columns, condition)


def _require_one(sql: str, what: str, *, shown: str | None = None) -> None:
    """Refuse what is more than one statement, or closes a bracket that it did not open: it goes between brackets."""
    import duckdb

    got = sql if shown is None else shown
    try:
        with duckdb.connect(":memory:") as connection:
            statements = connection.extract_statements(sql)  # parsed, not run
    except duckdb.Error as error:
        reason = next(iter(str(error).strip().splitlines()), "").removeprefix("Parser Error: ")
        raise SampleError(f"expected a {what} in SQL; got {got!r}: {reason}.") from None
    if len(statements) != 1:
        raise SampleError(f"expected a {what}; got {len(statements)} statements: give one.")


def stream_rows(table: pa.Table) -> Iterator[dict[str, Any]]:
    """Rows of a table one by one, without a million Python objects at once."""
    for batch in table.to_batches(max_chunksize=_ROWS_AT_ONCE):
        yield from batch.to_pylist()


def particle_name(row: Mapping[str, Any]) -> str:
    """What a particle is called in messages and files: SOURCE-000123."""
    return f"{row['source']}-{row['number']:06d}"


def particle_mesh(store: Store, row: Mapping[str, Any], *, device: str = "auto") -> Mesh:
    """Mesh [m] of a particle: the kept one, or the one that its recipe makes again.

    Parameters
    ----------
    store : Store
    row : mapping
        With the `MESH_COLUMNS`.
    device : {"auto", "cpu", "cuda"}
        Where noise fields are evaluated.

    Raises
    ------
    MeshError
        If the row is in error, is of a scan without a kept mesh, or its recipe makes another mesh here than the one
        that it tells of.
    FileFormatError
        If the kept mesh or the recipe is damaged.
    """
    kept = _kept_mesh(store, row)
    return _made_again(row, device).mesh if kept is None else kept


def particle_meshes(
    store: Store, rows: Iterable[Mapping[str, Any]], *, threads: int | None = None, device: str = "auto"
) -> Iterator[Mesh]:
    """Meshes [m] of many particles in the order of their rows, over threads and in bounded memory.

    Parameters and errors are those of `particle_mesh`; threads are by default the processors at hand.
    """
    return in_order(lambda row: particle_mesh(store, row, device=device), rows, threads=threads)


def restored_particle(store: Store, row: Mapping[str, Any], *, device: str = "auto") -> Particle:
    """The generated particle of a row, with its recipe and how it came about; arguments and errors as `particle_mesh`.

    A kept mesh is checked anew; what was relaxed is taken from the row.
    """
    kept = _kept_mesh(store, row)
    if kept is None:
        return _made_again(row, device)
    told = row["relaxed_vertices"] or 0, row["relaxation_rounds"] or 0, row["used_flatten_band"]
    return Particle(_recipe(row), kept, check(kept), *told)


def _kept_mesh(store: Store, row: Mapping[str, Any]) -> Mesh | None:
    if row["error"] is not None:
        raise MeshError(f"{particle_name(row)} has no mesh: {row['error']}")
    mesh = store.mesh(row["source"], row["number"])
    if mesh is not None and mesh.content_hash != row["content_hash"]:
        raise FileFormatError(
            f"{particle_name(row)}: the kept mesh is not the one of its row; restore the database from a copy, or "
            "remove the file of its batch in particles and give the command that made it again."
        )
    if mesh is None and row["kind"] != "generated":
        raise MeshError(
            f"{particle_name(row)}: the scan {row['file']} was imported without its mesh, which no recipe makes again; "
            "import it with --keep-meshes under another --source."
        )
    return mesh


def _recipe(row: Mapping[str, Any]) -> Recipe:
    try:
        return recipe_of(row)
    except (LithoformError, TypeError) as error:
        raise FileFormatError(
            f"{particle_name(row)}: the recipe in its row is not valid ({error}): the row was changed or damaged; "
            "restore the database from a copy."
        ) from None


def _made_again(row: Mapping[str, Any], device: str) -> Particle:
    recipe = _recipe(row)
    try:
        particle = generate(recipe, device=device)
    except DeviceError:
        raise
    except LithoformError as error:
        raise _mismatch(
            row, f"makes none here ({' '.join(str(error).partition('  The recipe:')[0].split())})"
        ) from None
    if particle.mesh.content_hash != row["content_hash"]:
        raise _mismatch(row, "makes another one here")
    return particle


def _mismatch(row: Mapping[str, Any], what: str) -> MeshError:
    ours, theirs = program_version(), row["lithoform"]
    if ours != theirs:
        way = f"lithoform {theirs} made it, and this is {ours}: use that version"
    else:
        way = "the row was changed, or made on another platform or device: go there, or restore a copy"
    return MeshError(
        f"{particle_name(row)}: its row tells of a mesh, but its recipe {what}; {way}, or build with --keep-meshes "
        "under another --source."
    )
