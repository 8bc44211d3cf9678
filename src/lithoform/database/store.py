"""A database on disk: a folder with a manifest and batches of rows, each file whole or not there.

    DIR/database.json                        format, schema, and what each source was asked for
    DIR/particles/SOURCE.000001.parquet      rows of particles 1 to n of the source
    DIR/meshes/SOURCE.000001.parquet         their meshes, where they are kept; written before the rows

A batch counts once its rows are there.  Its number says which particles it holds, so that a build that was stopped
knows what is left without reading, and ends with the files of one that was not.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from lithoform.atomic import atomic_path, atomic_write, make_folder, remove_partials
from lithoform.database.schema import SCHEMA_VERSION, particle_schema
from lithoform.database.sources import Source, differing_settings, new_source
from lithoform.errors import FileFormatError, OutputError
from lithoform.locking import LOCK_FILE, folder_lock
from lithoform.mesh import Mesh

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MANIFEST", "Source", "Store", "is_store", "new_source"]

MANIFEST: Final = "database.json"
KINDS: Final = ("generated", "scanned")
_FORMAT: Final = "lithoform database"
_SOURCE_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", re.ASCII)
_BATCH_FILE: Final = re.compile(r"([A-Za-z0-9][A-Za-z0-9_-]*)\.(\d{6,})\.parquet", re.ASCII)
_FOLDERS: Final = ("particles", "meshes")


def is_store(folder: str | Path) -> bool:
    """Whether a folder is, or claims to be, a database."""
    try:
        return (Path(folder) / MANIFEST).is_file()
    except PermissionError as error:
        raise FileFormatError(f"{folder} cannot be read: {error.strerror}; allow reading it.") from None


class Store:
    """A database that is there.

    Parameters
    ----------
    folder : path-like

    Raises
    ------
    FileFormatError
        If the folder holds no database, one of another program, a newer one, or a damaged manifest.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        _require_plain_name(self.folder)
        self.sources = _read_manifest(self.folder)

    @classmethod
    @contextlib.contextmanager
    def writing(cls, folder: str | Path) -> Iterator[Store]:
        """A database for one writer alone, made if there is none; what killed runs left half-written is removed.

        Raises
        ------
        OutputError
            If the folder holds other files, cannot be written to, or another run is writing into it.
        FileFormatError
            As the class.
        """
        folder = Path(folder)
        _require_plain_name(folder)
        make_folder(folder)
        with folder_lock(folder):
            if not is_store(folder):
                _require_empty(folder)
                _write_manifest(folder, {})
            remove_partials(folder)
            for name in _FOLDERS:
                make_folder(folder / name)
                remove_partials(folder / name)
            yield cls(folder)

    def refuse_inside(self, path: str | Path) -> None:
        """Refuse to write a result over a file of the database."""
        place, home = Path(path).resolve(), self.folder.resolve()
        if place == home / MANIFEST or any(place.is_relative_to(home / name) for name in _FOLDERS):
            raise OutputError(f"{path} is among the files of the database {self.folder}; name another file.")

    def add(self, source: Source, *, is_named: bool = True) -> None:
        """Enter a source, or find that it is there with the same plan; only while the store is held for writing.

        Parameters
        ----------
        source : Source
        is_named : bool
            Whether its name is the caller's choice, so that another one is a way out.

        Raises
        ------
        OutputError
            If its name is taken by another plan, by another version of the program, or is not a plain name.
        """
        if not _SOURCE_NAME.fullmatch(source.name):
            raise OutputError(f"expected a source of letters, digits, - and _ (at most 64); got {source.name!r}.")
        # Two names that differ in case alone would be one file on some systems.
        taken = {name.lower(): name for name in self.sources}.get(source.name.lower())
        other = "another --source or folder" if is_named else "another folder"
        if taken is not None and taken != source.name:
            raise OutputError(f"{self.folder} holds {taken!r}, which differs from {source.name!r} in case alone: give "
                              f"the new particles {other}.")  # fmt: skip
        # A source without a batch was stopped before it had begun; it may begin again otherwise.
        if taken is None or not self.present(self.sources[taken]):
            _write_manifest(self.folder, {**self.sources, source.name: source})
            self.sources[source.name] = source
            return
        former = self.sources[taken]
        if former.lithoform != source.lithoform:
            raise OutputError(
                f"{self.folder} holds {taken!r} made by lithoform {former.lithoform}, and this is {source.lithoform}: "
                f"go on with that version, or give the new particles {other}."
            )
        if former != source:
            names = differing_settings(former, source)
            raise OutputError(
                f"{self.folder} holds {taken!r} with other settings ({', '.join(names)} differ): give the same command "
                f"to finish it, or {other} for the new particles."
            )

    def path(self, source: Source, batch: int, *, meshes: bool = False) -> Path:
        """File of a batch."""
        return self.folder / _FOLDERS[meshes] / f"{source.name}.{batch:06d}.parquet"

    def present(self, source: Source) -> list[int]:
        """Batches that are there, sorted."""
        return [number for name, number, _ in self._files if name == source.name]

    @property
    def _files(self) -> list[tuple[str, int, Path]]:
        order = {name: place for place, name in enumerate(self.sources)}
        found = []
        try:
            for path in (self.folder / "particles").iterdir():
                match = _BATCH_FILE.fullmatch(path.name)
                if match is None or match[1] not in order:
                    continue
                source, number = self.sources[match[1]], int(match[2])
                if 1 <= number <= source.batches and path.name == f"{source.name}.{number:06d}.parquet":
                    found.append((source.name, number, path))
        except FileNotFoundError:
            return []  # nothing was built yet
        except OSError as error:
            raise FileFormatError(f"{self.folder / 'particles'} cannot be read: {error.strerror}; mend it.") from None
        return sorted(found, key=lambda item: (order[item[0]], item[1]))

    @property
    def files(self) -> list[Path]:
        """Files of rows, source by source, in the order of the batches."""
        return [path for _, _, path in self._files]

    def missing(self) -> dict[str, int]:
        """Particles that are still to be made, by source; sources that are complete are left out."""
        out = {}
        for source in self.sources.values():
            there = sum(len(source.numbers(batch)) for batch in self.present(source))
            if there < source.count:
                out[source.name] = source.count - there
        return out

    def write(self, source: Source, batch: int, rows: pa.Table, meshes: pa.Table | None) -> None:
        """Write a batch: its meshes first, so that rows are there only when all is.

        Raises
        ------
        OutputError
            If it cannot be written; what was there before stays.
        """
        if meshes is not None:
            # A row group a mesh: one can be read without the others.
            _write_parquet(self.path(source, batch, meshes=True), meshes, row_group_size=1)
        _write_parquet(self.path(source, batch), rows, row_group_size=max(rows.num_rows, 1))

    def damaged(self, source: Source, batch: int) -> str:
        """What is wrong with a batch that is there; empty if it is whole.  Every byte is read.

        One that may not be read is a `FileFormatError`: it could be whole.
        """
        try:
            rows = _read_parquet(self.path(source, batch))
            told = (
                [{*rows[name].to_pylist()} for name in ("source", "kind")]
                if rows.schema.equals(particle_schema())
                else []
            )
            if told != [{source.name}, {source.kind}] or rows["number"].to_pylist() != [*source.numbers(batch)]:
                return "its rows are not those of its source"
            if source.keeps_meshes:
                kept = _read_parquet(self.path(source, batch, meshes=True), ["number", "content_hash"])
                made = [(n, h) for n, h in zip(*(rows[c].to_pylist() for c in ("number", "content_hash")), strict=True)
                        if h]  # fmt: skip
                if [*zip(*(kept[c].to_pylist() for c in ("number", "content_hash")), strict=True)] != made:
                    return "its meshes are not those of its rows"
        except FileFormatError as error:
            if isinstance(error.__context__, PermissionError):
                raise
            return str(error)
        return ""

    def table(self, columns: Sequence[str] | None = None, *, sources: Sequence[str] | None = None) -> pa.Table:
        """Rows of the database, source by source, in the order of their numbers.

        Parameters
        ----------
        columns : sequence of str, optional
            All by default.
        sources : sequence of str, optional

        Raises
        ------
        FileFormatError
            If a file is damaged; the message says which and the way out.
        """
        import pyarrow as pa

        schema = particle_schema()
        chosen = schema if columns is None else pa.schema([schema.field(name) for name in columns])
        parts = [_read_parquet(path, columns) for name, _, path in self._files if sources is None or name in sources]
        return pa.concat_tables([chosen.empty_table(), *parts])

    def mesh(self, source: str, number: int) -> Mesh | None:
        """Kept mesh [m] of a particle; None where meshes are not kept or the particle has none.

        Raises
        ------
        FileFormatError
            If the file is damaged, or the mesh is not the one that the row tells of.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        entry = self.sources[source]
        if not entry.keeps_meshes or not 1 <= number <= entry.count:
            return None
        path = self.path(entry, (number - 1) // entry.batch + 1, meshes=True)
        try:
            with pq.ParquetFile(path, page_checksum_verification=True) as file:
                numbers = file.read(["number"])["number"].to_pylist()
                if number not in numbers:
                    return None
                row = file.read_row_group(numbers.index(number))
        except (OSError, pa.ArrowException) as error:
            raise _damage(path, error) from None
        vertices, faces = (row[name].combine_chunks().values.to_numpy() for name in ("vertices", "faces"))
        mesh = Mesh(vertices.reshape(-1, 3), faces.reshape(-1, 3))
        if mesh.content_hash != row["content_hash"][0].as_py():
            raise _damage(path, f"particle {number} is not the one that was written")
        return mesh


def _write_parquet(path: Path, table: pa.Table, *, row_group_size: int) -> None:
    import pyarrow.parquet as pq

    # Opened here: the writer takes no name of a folder that is not UTF-8.
    with atomic_path(path) as partial, partial.open("wb") as sink:
        pq.write_table(table, sink, compression="zstd", row_group_size=row_group_size, write_page_checksum=True)


def _read_parquet(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # Not the open file: threads of Arrow that hold one after the interpreter has gone end the process.
        content = pa.BufferReader(path.read_bytes())
        return pq.read_table(content, columns=columns, page_checksum_verification=True)
    except (OSError, pa.ArrowException) as error:
        raise _damage(path, error) from None


def _damage(path: Path, reason: object) -> FileFormatError:
    if isinstance(reason, PermissionError):
        return FileFormatError(f"{path} cannot be read: permission denied; allow reading it.")
    text = " ".join(str(reason).split())
    return FileFormatError(
        f"{path} is damaged ({text}): give the command that made it again, which makes this batch anew."
    )


def _require_plain_name(folder: Path) -> None:
    """Refuse a name that Arrow cannot open."""
    try:
        str(folder.absolute()).encode()
    except UnicodeEncodeError:
        raise FileFormatError(f"expected a folder whose name is UTF-8; got {str(folder)!r}: rename it.") from None


def _require_empty(folder: Path) -> None:
    try:
        # A database begins with its manifest; whatever else is there is somebody else's.
        names = sorted(p.name for p in folder.iterdir() if p.name != LOCK_FILE and not p.name.endswith(".partial"))
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be used: {error.strerror}.") from error
    if names:
        raise OutputError(f"{folder} holds other files ({names[0]}) and no database: name a new or an empty folder.")


def _write_manifest(folder: Path, sources: dict[str, Source]) -> None:
    content = {
        "format": _FORMAT,
        "schema": SCHEMA_VERSION,
        "sources": {name: source.as_dict() for name, source in sources.items()},
    }
    atomic_write(folder / MANIFEST, (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode())


def _read_manifest(folder: Path) -> dict[str, Source]:
    path = folder / MANIFEST
    if not is_store(folder):
        what = "is not there" if not folder.exists() else f"holds no database (there is no {MANIFEST})"
        raise FileFormatError(f"{folder} {what}; make one with lithoform database build.")
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError):
        raise FileFormatError(f"{path} is truncated or damaged; restore it from a copy.") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT or type(content.get("schema")) is not int:
        raise FileFormatError(f"{path} is not of a lithoform database; name another folder.")
    if content["schema"] < 1:
        raise FileFormatError(f"{path} is damaged: there is no schema {content['schema']}.")
    if content["schema"] > SCHEMA_VERSION:
        raise FileFormatError(
            f"{folder} is a database of schema {content['schema']}, newer than {SCHEMA_VERSION}; update lithoform."
        )
    try:
        sources = {name: Source(name=name, **entry) for name, entry in content["sources"].items()}
        kinds = {"name": str, "kind": str, "count": int, "batch": int, "keeps_meshes": bool, "lithoform": str,
                 "plan": dict}  # fmt: skip
        if all(type(getattr(s, k)) is kind for s in sources.values() for k, kind in kinds.items()) and all(
            s.count >= 1 and s.batch >= 1 and s.kind in KINDS and _SOURCE_NAME.fullmatch(s.name)
            for s in sources.values()
        ):
            return sources
    except (KeyError, TypeError, AttributeError):
        pass
    raise FileFormatError(f"{path} is damaged: its sources are not as this program writes them.")
