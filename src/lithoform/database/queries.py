"""SQL over a database, answered by DuckDB, which reads the Parquet files in place."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lithoform.database.schema import particle_schema
from lithoform.database.store import Store
from lithoform.errors import SampleError
from lithoform.parameters import suggest

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["query", "select", "table_to_csv"]


def query(folder: str | Path | Store, sql: str) -> pa.Table:
    """Answer to a SELECT over the table `particles`, which has a row a particle.

    Parameters
    ----------
    folder : path-like or Store
    sql : str
        One statement in DuckDB's SQL.  It reads this database and nothing else.

    Returns
    -------
    pyarrow.Table

    Raises
    ------
    SampleError
        If it is not one SELECT, or not valid; the message is DuckDB's.
    FileFormatError
        If the folder is no database, or a file of it is damaged.
    """
    store = folder if isinstance(folder, Store) else Store(folder)
    import duckdb

    with _connected(store) as connection:
        try:
            statements = connection.extract_statements(sql)
            if len(statements) != 1 or statements[0].type.name != "SELECT":
                raise SampleError('expected one SELECT, such as "select class, avg(roundness) from particles group by '
                                  f'class"; got {sql!r}.')  # fmt: skip
            return connection.sql(statements[0].query).to_arrow_table()
        except duckdb.Error as error:
            if isinstance(error, (duckdb.IOException, duckdb.InvalidInputException)):
                # Not the query but a file may be at fault; reading them all tells which.
                store.table(["number"])
            raise SampleError(f"the query cannot be answered: {_first_line(error)}") from None


def select(folder: str | Path | Store, columns: Sequence[str], where: str | None = None) -> pa.Table:
    """Columns of the particles that are there and for which a condition holds, source by source, by number.

    Parameters
    ----------
    folder : path-like or Store
    columns : sequence of str
    where : str, optional
        What stands after WHERE, such as "class = 'cube' and roundness < 0.3".

    Raises
    ------
    SampleError
        If there is no such column, the nearest being named, or the condition is not valid.
    """
    store = folder if isinstance(folder, Store) else Store(folder)
    known = particle_schema().names
    for name in columns:
        if name not in known:
            raise SampleError(f"expected a column of the database; got {name!r}.{suggest(name, known)}")
    listed = ", ".join(f'"{name}"' for name in columns)
    order = "".join(f" when '{name}' then {place}" for place, name in enumerate(store.sources))
    by_source = f"case source{order} end, " if order else ""
    # Line breaks, so that a comment at the end of the condition comments out nothing else.
    condition = f" and (\n{where}\n)" if where else ""
    return query(store, f"select {listed} from particles where error is null{condition} order by {by_source}number")


def table_to_csv(table: pa.Table) -> bytes:
    """A table as CSV with a head; lists as JSON, numbers with all their digits."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table.column_names)
    for batch in table.to_batches():
        for row in zip(*(column.to_pylist() for column in batch.columns), strict=True):
            writer.writerow([json.dumps(v) if isinstance(v, (list, dict)) else "" if v is None else v for v in row])
    return out.getvalue().encode()


@contextlib.contextmanager
def _connected(store: Store) -> Iterator[Any]:
    import duckdb

    settings: dict[str, Any] = {"autoinstall_known_extensions": "false", "autoload_known_extensions": "false"}
    with duckdb.connect(":memory:", config=settings) as connection:
        files = [str(path) for path in store.files]
        if files:
            connection.execute(f"set allowed_paths = [{', '.join(map(_quoted, files))}]")
            connection.execute("set enable_external_access = false")
            connection.execute(
                f"create view particles as select * from read_parquet([{', '.join(map(_quoted, files))}])"
            )
        else:
            connection.execute("set enable_external_access = false")
            connection.register("particles", particle_schema().empty_table())
        connection.execute("set lock_configuration = true")
        yield connection


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0] if text else type(error).__name__
