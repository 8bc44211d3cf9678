"""Particles of a database as mesh files, each with its sidecar, and a table of them.

A particle counts as exported when its sidecar names the mesh of its row and the file beside it has the bytes that the
sidecar names.  The sidecar is written last, each file whole or not at all, so that an export that was stopped goes on.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from lithoform import mesh_io
from lithoform.atomic import atomic_write, make_folder, remove_partials
from lithoform.database.meshes import (
    MESH_COLUMNS,
    choose,
    particle_mesh,
    particle_name,
    restored_particle,
    stream_rows,
)
from lithoform.database.queries import rows_of, table_to_csv
from lithoform.database.schema import particle_schema
from lithoform.database.store import Store, is_store
from lithoform.errors import FileFormatError, OutputError, SampleError, UnsoundMeshError
from lithoform.locking import LOCK_FILE, folder_lock
from lithoform.parallel import in_order
from lithoform.sidecar import build_sidecar, program_version, read_sidecar, sidecar_path, write_sidecar
from lithoform.soundness import check

__all__ = ["PLAN_FILE", "TABLE_FILE", "Export"]

PLAN_FILE: Final = "export.json"
TABLE_FILE: Final = "particles.csv"

_FORMAT: Final = "lithoform export"
_SETTINGS: Final = ("database", "select", "mesh_format", "unit")
_SCAN_COLUMNS: Final = ("class", "file_sha256", "file_format", "repairs")


class Export:
    """Chosen particles of a database and how they are written.

    Parameters
    ----------
    store : Store
    chosen : str, optional
        As `lithoform.database.meshes.choose`; all particles by default.
    format, unit : str
        Of the mesh files; keys of `lithoform.mesh_io.FORMATS` and `UNITS`.

    Attributes
    ----------
    count : int
        Particles that are written.

    Raises
    ------
    SampleError
        If the choice is not valid or means no particle.
    FileFormatError
        If the format or the unit is unknown.
    """

    def __init__(self, store: Store, chosen: str | None = None, *, format: str = "stl", unit: str = "mm") -> None:
        self.store, self.chosen = store, chosen
        self.format = mesh_io.known_key("mesh format", format, mesh_io.FORMATS)
        self.unit = mesh_io.known_key("unit", unit, mesh_io.UNITS)
        self._rows = choose(store, [*MESH_COLUMNS, *_SCAN_COLUMNS], chosen)
        self.count: int = self._rows.num_rows
        if not self.count:
            raise SampleError(f"expected particles to export; {_place(store.folder, chosen)}.")

    def file_name(self, row: Mapping[str, Any]) -> str:
        """Name of the mesh file of a particle: SOURCE-000123.stl."""
        return f"{particle_name(row)}.{self.format}"

    def run(
        self, out: Path, *, overwrite: bool = False, threads: int | None = None, device: str = "auto"
    ) -> Iterator[bool]:
        """Write the particles that are not there yet, and at the end the table of all.

        Parameters
        ----------
        out : Path
            Folder; made if it does not exist.  A former export with the same settings is gone on with.
        overwrite : bool
            Replace a former export with other settings, or write among files of others; of these only such are
            replaced that have the name of a file of the export.
        threads, device
            As `lithoform.database.meshes.particle_meshes`.

        Yields
        ------
        bool
            For each particle, in order, whether its files were made now; False if they were there.

        Raises
        ------
        OutputError
            If the folder holds other files and not `overwrite`, is a database, or cannot be written to.
        MeshError, FileFormatError
            As `particle_mesh`; or if a mesh is not sound after the rounding of the format.  What was written stays.
        """
        if is_store(out):
            raise OutputError(f"{out} is a database; name another folder for the mesh files.")
        make_folder(out)
        with folder_lock(out):
            self._prepare(out, overwrite=overwrite)

            def work(row: Mapping[str, Any]) -> bool:
                return self._write(out, row, device)

            yield from in_order(work, stream_rows(self._rows), threads=threads)
            atomic_write(out / TABLE_FILE, self._table())

    def _prepare(self, out: Path, *, overwrite: bool) -> None:
        try:
            content = {path.name for path in out.iterdir() if not _is_temporary(path.name)}
        except OSError as error:
            raise OutputError(f"the folder {out} cannot be used: {error.strerror}.") from error
        former = _read_plan(out / PLAN_FILE)
        ours = self._plan()
        if content and former is None and not overwrite:
            raise OutputError(
                f"the folder {out} is not empty, it holds other files ({min(content)}): choose another, or give "
                "--overwrite, which replaces files of the same names alone."
            )
        if former is not None:
            differing = [key for key in _SETTINGS if former[key] != ours[key]]
            if differing and not overwrite:
                raise OutputError(
                    f"{out} holds an export with other settings ({', '.join(differing)} differ): choose another "
                    "folder, or give --overwrite, which replaces it."
                )
            if differing:
                _remove(out, former, content)
        remove_partials(out)
        atomic_write(out / PLAN_FILE, (json.dumps(ours, indent=2, ensure_ascii=False) + "\n").encode())

    def _plan(self) -> dict[str, Any]:
        return {
            "format": _FORMAT,
            "lithoform": program_version(),
            "database": self.store.folder.resolve().name,
            "select": self.chosen,
            "mesh_format": self.format,
            "unit": self.unit,
            "sources": [*self.store.sources],
        }

    def _write(self, out: Path, row: Mapping[str, Any], device: str) -> bool:
        target = out / self.file_name(row)
        named = {"source": row["source"], "number": row["number"], "class": row["class"]}
        if self._is_finished(target, row, named):
            return False
        if row["kind"] == "generated":
            restored_particle(self.store, row, device=device).save(target, unit=self.unit, extra=named)
            return True
        mesh = particle_mesh(self.store, row)
        report = check(mesh.with_vertices(mesh_io.stored_vertices(mesh, self.format, self.unit)))
        if not report.sound:
            raise UnsoundMeshError(
                f"{particle_name(row)}: rounded to the precision of {self.format} files this mesh is not sound "
                f"({'; '.join(report.problems())}); use --format ply or obj, which keep every digit.",
                report,
            )
        digest = mesh_io.write_mesh(target, mesh, unit=self.unit)
        # In the place of a recipe, so that `generate --recipe` refuses it instead of making some other stone.
        origin = {"scan": row["file"], "sha256": row["file_sha256"], "format": row["file_format"],
                  "repairs": row["repairs"] or []}  # fmt: skip
        sidecar = build_sidecar(recipe=origin, mesh=mesh, mesh_file=target.name, file_sha256=digest,
                                format=self.format, unit=self.unit, extra=named)  # fmt: skip
        write_sidecar(sidecar_path(target), sidecar)
        return True

    def _is_finished(self, target: Path, row: Mapping[str, Any], named: dict[str, Any]) -> bool:
        expected = {
            **named,
            "file": target.name,
            "format": self.format,
            "unit": mesh_io.file_unit(self.format, self.unit),
            "content_sha256": row["content_hash"],
        }
        try:
            sidecar = read_sidecar(sidecar_path(target))
            if any(sidecar.get(key) != value for key, value in expected.items()):
                return False
            return hashlib.sha256(target.read_bytes()).hexdigest() == sidecar["file_sha256"]
        except (FileFormatError, OSError):
            return False

    def _table(self) -> bytes:
        """CSV of the exported rows in SI units: the mesh file, and every column that has a value in some row."""
        import pyarrow as pa

        # The choice is not asked again: it may be a random one.
        rows = rows_of(self.store, particle_schema().names, self._rows.select(["source", "number"]))
        told = rows.select([n for n in rows.column_names if rows[n].null_count < rows.num_rows])
        files = [self.file_name(row) for row in stream_rows(rows.select(["source", "number"]))]
        return table_to_csv(told.add_column(0, "mesh_file", pa.array(files, pa.string())))


def _is_temporary(name: str) -> bool:
    return name == LOCK_FILE or (name.startswith(".") and name.endswith(".partial"))


def _read_plan(path: Path) -> dict[str, Any] | None:
    """What a former export recorded; None for anything else."""
    try:
        plan = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    is_ours = isinstance(plan, dict) and plan.get("format") == _FORMAT and {*_SETTINGS, "sources"} <= {*plan}
    return plan if is_ours and isinstance(plan["sources"], list) else None


def _remove(out: Path, former: dict[str, Any], content: set[str]) -> None:
    """Remove the files of a former export; its plan stays until the new one takes its place."""
    sources = "|".join(re.escape(str(source)) for source in former["sources"])
    named = re.compile(rf"(?:{sources})-\d{{6,}}\.(?:{re.escape(str(former['mesh_format']))}|json)", re.ASCII)
    try:
        for name in sorted(n for n in content if n == TABLE_FILE or named.fullmatch(n)):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"the former export in {out} cannot be removed: {error.strerror} ({error.filename})."
        ) from error


def _place(folder: Path, chosen: str | None) -> str:
    return f"{folder} has none" + (f" for which {' '.join(chosen.split())!r} holds" if chosen else "")
