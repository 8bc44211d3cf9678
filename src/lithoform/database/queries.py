"""SQL over a database, answered by DuckDB over the Parquet files in place."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO

from lithoform.database.schema import particle_schema
from lithoform.database.store import Store
from lithoform.errors import LithoformError, SampleError
from lithoform.parameters import suggest

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["query", "rows_of", "select", "stream", "table_to_csv", "write_csv"]

_ROWS_AT_ONCE: Final = 8192


def query(folder: str | Path | Store, sql: str, *, tables: Mapping[str, pa.Table] | None = None) -> pa.Table:
    """Answer to a SELECT over the table `particles`, which has a row a particle.

    Parameters
    ----------
    folder : path-like or Store
    sql : str
        One statement in DuckDB's SQL.  It reads this database and nothing else.
    tables : mapping, optional
        Further tables that the statement may name.

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
    import pyarrow as pa

    with stream(folder, sql, tables=tables) as (schema, batches):
        return pa.Table.from_batches(list(batches), schema=schema)


@contextlib.contextmanager
def stream(
    folder: str | Path | Store, sql: str, *, tables: Mapping[str, pa.Table] | None = None
) -> Iterator[tuple[pa.Schema, Iterator[pa.RecordBatch]]]:
    """As `query`, part by part: the columns, and an iterator of rows that lives as long as the block.

    An interrupt (Ctrl-C) ends the work of DuckDB, too.
    """
    import duckdb

    store = folder if isinstance(folder, Store) else Store(folder)
    with contextlib.ExitStack() as stack, _told(store):
        connection = stack.enter_context(_connected(store, tables or {}))
        # In a thread, since the interpreter sees an interrupt only between two calls.
        worker = stack.enter_context(ThreadPoolExecutor(1))
        stack.callback(connection.interrupt)
        statements = connection.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise SampleError('expected one SELECT, such as "select class, avg(roundness) from particles group by '
                              f'class"; got {sql!r}.')  # fmt: skip
        reader = worker.submit(lambda: connection.sql(statements[0].query).to_arrow_reader(_ROWS_AT_ONCE)).result()

        def batches() -> Iterator[pa.RecordBatch]:
            with _told(store):
                while (batch := worker.submit(next, reader, None).result()) is not None:
                    yield batch

        yield reader.schema, batches()


@contextlib.contextmanager
def _told(store: Store) -> Iterator[None]:
    """Faults of DuckDB as one sentence; where a file of the database is at fault, as that file's."""
    import duckdb
    import pyarrow as pa

    try:
        yield
    except (duckdb.Error, pa.ArrowException, OSError, RuntimeError) as error:
        if isinstance(error, LithoformError):
            raise
        store.table()  # reads every file, and tells which is damaged
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
    return _selected(folder if isinstance(folder, Store) else Store(folder), columns, where, None)


def _selected(store: Store, columns: Sequence[str], where: str | None, tables: Any) -> pa.Table:
    known = particle_schema().names
    for name in columns:
        if name not in known:
            raise SampleError(f"expected a column of the database; got {name!r}.{suggest(name, known)}")
    listed = ", ".join(f'"{name}"' for name in columns)
    order = "".join(f" when '{name}' then {place}" for place, name in enumerate(store.sources))
    by_source = f"case source{order} end, " if order else ""
    # Line breaks, so that a comment at the end of the condition comments out nothing else.
    condition = f" and (\n{where}\n)" if where else ""
    sql = f"select {listed} from particles where error is null{condition} order by {by_source}number"
    return query(store, sql, tables=tables)


def rows_of(store: Store, columns: Sequence[str], keys: pa.Table) -> pa.Table:
    """Columns of particles named by source and number, in the order of `select`.

    Parameters
    ----------
    store : Store
    columns : sequence of str
    keys : pyarrow.Table
        With the columns source and number, as `select` gives them.
    """
    return _selected(store, columns, "(source, number) in (select source, number from chosen)", {"chosen": keys})


def write_csv(schema: pa.Schema, batches: Iterable[pa.RecordBatch], sink: TextIO) -> int:
    """Write rows as CSV with a head, lists as JSON, numbers with all their digits; how many there were."""
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(schema.names)
    count = 0
    for batch in batches:
        count += batch.num_rows
        for row in zip(*(column.to_pylist() for column in batch.columns), strict=True):
            writer.writerow(["" if v is None else json.dumps(v, default=str) if isinstance(v, (list, dict)) else v
                             for v in row])  # fmt: skip
    return count


def table_to_csv(table: pa.Table) -> bytes:
    """A table as CSV, as `write_csv` writes it."""
    out = io.StringIO()
    write_csv(table.schema, table.to_batches(), out)
    return out.getvalue().encode()


@contextlib.contextmanager
def _connected(store: Store, tables: Mapping[str, pa.Table]) -> Iterator[Any]:
    import duckdb

    # What reads files is off: Arrow reads those of the database, by their very names, and tries their checksums.
    settings: dict[str, Any] = {
        "autoinstall_known_extensions": "false", "autoload_known_extensions": "false",
        "python_enable_replacements": "false", "enable_external_access": "false",
    }  # fmt: skip
    with duckdb.connect(":memory:", config=settings) as connection:
        connection.register("particles", _dataset(store))
        for name, table in tables.items():
            connection.register(name, table)
        connection.execute("set lock_configuration = true")
        yield connection


def _dataset(store: Store) -> Any:
    import pyarrow.dataset as ds
    from pyarrow.fs import LocalFileSystem

    files = [str(path.absolute()) for path in store.files]
    schema = particle_schema().remove_metadata()
    if not files:
        return schema.empty_table()
    options = ds.ParquetFragmentScanOptions(page_checksum_verification=True)
    form = ds.ParquetFileFormat(default_fragment_scan_options=options)
    return ds.FileSystemDataset.from_paths(files, schema=schema, format=form, filesystem=LocalFileSystem())


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0] if text else type(error).__name__
