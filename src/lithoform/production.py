"""Runs of the command line: a plan of numbered particles, carried out into a folder, resumable.

A particle counts as finished when its sidecar is there and the mesh beside it has the bytes that the sidecar
names.  The sidecar is written last, each file whole or not at all, so that a run killed at any moment can be
resumed and ends with the files of an uninterrupted one.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from lithoform import mesh_io
from lithoform.atomic import atomic_path, atomic_write, make_folder, remove_partials
from lithoform.errors import FileFormatError, OutputError
from lithoform.generation import generate_many
from lithoform.locking import LOCK_FILE, folder_lock
from lithoform.parameters import Recipe
from lithoform.particle import Particle
from lithoform.planning import Plan
from lithoform.presets import shape_class_of
from lithoform.progress import track
from lithoform.sidecar import program_version, read_sidecar, sidecar_path

__all__ = ["PICTURE_FILE", "PLAN_FILE", "TABLE_FILE", "open_run", "produce", "unfinished", "write_table"]

PLAN_FILE: Final = "run.json"
TABLE_FILE: Final = "particles.parquet"
PICTURE_FILE: Final = "gallery.png"

_NUMBERED: Final = re.compile(r"(\d{6,})\.(\w+)", re.ASCII)
_ROW_GROUP: Final = 4096


@contextlib.contextmanager
def open_run(out: Path, plan: Plan, *, overwrite: bool = False, resume: bool = False) -> Iterator[None]:
    """Make the folder of a run ready, or refuse; it is this run's alone while the block runs.

    Parameters
    ----------
    out : Path
        Folder; made if it does not exist.
    plan : Plan
    overwrite : bool
        Remove the files of a former run of this program first (and nothing else).
    resume : bool
        Go on with an unfinished run of the same plan and the same version of the program.

    Raises
    ------
    OutputError
        If the folder has other content and neither option is given, holds a run of another plan or files in the
        way that no run of this program wrote, cannot be made, or another run is writing into it.
    """
    make_folder(out)
    with folder_lock(out):
        _prepare(out, plan, overwrite=overwrite, resume=resume)
        yield


def _prepare(out: Path, plan: Plan, *, overwrite: bool, resume: bool) -> None:
    try:
        content = {path.name for path in out.iterdir() if not _is_temporary(path.name)}
    except OSError as error:
        raise OutputError(f"the folder {out} cannot be used: {error.strerror}.") from error
    plan_path = out / PLAN_FILE
    if content and resume:
        if PLAN_FILE not in content:
            raise OutputError(f"{out} holds no run to resume (there is no {PLAN_FILE}); choose another folder.")
        _require_same_plan(plan_path, plan)
        remove_partials(out)
        return
    former = _read_plan(plan_path)
    if content and not overwrite:
        held, way = (
            ("other files", "choose another, or give --overwrite")
            if former is None
            else ("a run of this program", "--resume finishes it, --overwrite starts anew")
        )
        raise OutputError(f"the folder {out} is not empty, it holds {held}: {way}.")
    own = set() if former is None else _files_of(former, content)
    foreign = content - own
    clash = sorted(_files_of(plan.as_dict(), foreign))
    if clash:
        more = f" and {len(clash) - 1} more" if len(clash) > 1 else ""
        raise OutputError(
            f"{out} holds {clash[0]}{more}, which the run would write but no run of this program made there: choose "
            "another folder, or move the files away."
        )
    try:
        # The plan stays until the new one takes its place: if this is stopped, the files are still known as ours.
        for name in sorted(own - {PLAN_FILE}):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"the former run in {out} cannot be removed: {error.strerror} ({error.filename}).") from error
    remove_partials(out)
    atomic_write(plan_path, _json({"lithoform": program_version(), **plan.as_dict()}))


def _is_temporary(name: str) -> bool:
    return name == LOCK_FILE or (name.startswith(".") and name.endswith(".partial"))


def _files_of(plan: dict[str, Any], names: set[str]) -> set[str]:
    """Those of the names that a run of this plan writes."""

    def belongs(name: str) -> bool:
        if name in (PLAN_FILE, TABLE_FILE, PICTURE_FILE):
            return True
        match = _NUMBERED.fullmatch(name)
        if match is None or match[2] not in (plan["format"], "json"):
            return False
        number = int(match[1])
        return 1 <= number <= plan["count"] and match[1] == f"{number:06d}"

    return {name for name in names if belongs(name)}


def _read_plan(path: Path) -> dict[str, Any] | None:
    """What a run of this program recorded, "lithoform" (its version) included; None for anything else."""
    try:
        plan = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    wanted = {"lithoform", *(f.name for f in dataclasses.fields(Plan))}
    if not isinstance(plan, dict) or not wanted <= set(plan):
        return None
    is_ours = isinstance(plan["lithoform"], str) and type(plan["count"]) is int and plan["format"] in [*mesh_io.FORMATS]
    return plan if is_ours else None


def _require_same_plan(path: Path, plan: Plan) -> None:
    former = _read_plan(path)
    if former is None:
        raise OutputError(
            f"{path} is damaged or not of this program; the run cannot be resumed: choose another folder."
        )
    ours = {"lithoform": program_version(), **plan.as_dict()}
    # The bytes of a stone are promised for one version of the program alone.
    if former["lithoform"] != ours["lithoform"]:
        raise OutputError(
            f"{path.parent} holds a run of lithoform {former['lithoform']}, and this is {ours['lithoform']}: resume it "
            "with that version, or use --overwrite."
        )
    if former != ours:
        names = sorted(k for k in {*former, *ours} if former.get(k) != ours.get(k))
        raise OutputError(
            f"{path.parent} holds a run with other settings ({', '.join(names)} differ): resume it with the same "
            "command, or use --overwrite."
        )


def unfinished(out: Path, plan: Plan) -> list[int]:
    """Numbers of the particles that a run still has to make, in order."""
    numbers = track(range(1, plan.count + 1), total=plan.count, what="files looked at")
    return [n for n in numbers if not _is_finished(out, plan, n)]


def _is_finished(out: Path, plan: Plan, number: int) -> bool:
    """Whether the files of a particle are there, whole, and those of this plan."""
    mesh_file = out / plan.mesh_file(number)
    expected = {
        "recipe": json.loads(json.dumps(plan.recipe(number).as_dict())),
        "number": number,
        "file": mesh_file.name,
        "format": plan.format,
        "unit": mesh_io.file_unit(plan.format, plan.unit),
    }
    try:
        sidecar = read_sidecar(sidecar_path(mesh_file))
        if "provenance" not in sidecar or any(sidecar.get(key) != value for key, value in expected.items()):
            return False
        return hashlib.sha256(mesh_file.read_bytes()).hexdigest() == sidecar["file_sha256"]
    except (FileFormatError, OSError):
        return False


def produce(out: Path, plan: Plan, numbers: Sequence[int], *, device: str = "auto") -> Iterator[int]:
    """Generate and write particles, yielding each number once its files are there.

    Parameters
    ----------
    out : Path
        A folder made ready by `open_run`.
    plan : Plan
    numbers : sequence of int
        Which particles to make, in order.
    device : {"auto", "cpu", "cuda"}

    Yields
    ------
    int

    Raises
    ------
    OutputError, UnsoundMeshError, DeviceError, RecipeError
        What was written before stays.
    """
    if not numbers:
        return
    # Worker threads write the files as well; the numbers travel with the particles in the order of the recipes.
    results = generate_many((plan.recipe(n) for n in numbers), device=device, each=_writer(out, plan, numbers))
    yield from results


def _writer(out: Path, plan: Plan, numbers: Sequence[int]) -> Callable[[int, Particle], int]:
    def write(index: int, particle: Particle) -> int:
        number = numbers[index]
        extra = {"number": number, "class": plan.class_of(number) or shape_class_of(particle.recipe.size)}
        particle.save(out / plan.mesh_file(number), unit=plan.unit, extra=extra)
        return number

    return write


def write_table(out: Path, plan: Plan) -> int:
    """Write OUT/particles.parquet from the sidecars: a row a particle, in SI units, in bounded memory.

    Parameters
    ----------
    out : Path
        Folder with all particles of the plan.
    plan : Plan

    Returns
    -------
    int
        How many particles were relaxed, where faces crossed after the twist.

    Raises
    ------
    OutputError, FileFormatError
        If it cannot be written, or a sidecar is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, relaxed = pa.schema(_columns(pa)), 0
    # Opened here: the writer takes no name of a folder that is not UTF-8.
    with (
        atomic_path(out / TABLE_FILE) as partial,
        partial.open("wb") as sink,
        pq.ParquetWriter(sink, schema) as writer,
    ):
        for start in range(1, plan.count + 1, _ROW_GROUP):
            numbers = range(start, min(start + _ROW_GROUP, plan.count + 1))
            rows = [_row(read_sidecar(sidecar_path(out / plan.mesh_file(n)))) for n in numbers]
            relaxed += sum(row["relaxed_vertices"] > 0 for row in rows)
            writer.write_table(pa.Table.from_pylist(rows, schema=schema))
    return relaxed


def _columns(pa: Any) -> list[tuple[str, Any]]:
    kinds = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), str: pa.string(), tuple: pa.list_(pa.float64(), 3)}
    recipe = [(name, kinds[type(value)]) for name, value in Recipe().as_dict().items() if name != "seed"]
    return [
        ("number", pa.int64()),
        ("file", pa.string()),
        ("class", pa.string()),
        ("seed", pa.uint64()),
        ("volume_m3", pa.float64()),
        ("area_m2", pa.float64()),
        ("inertia_m5", pa.list_(pa.float64(), 9)),
        ("certificate", pa.string()),
        ("relaxed_vertices", pa.int64()),
        ("content_sha256", pa.string()),
        ("file_sha256", pa.string()),
        ("lithoform", pa.string()),
        *recipe,
    ]


def _row(sidecar: dict[str, Any]) -> dict[str, Any]:
    metre = 1.0 / mesh_io.UNITS[sidecar["unit"]]
    inertia = [component * metre**5 for row in sidecar["inertia"] for component in row]
    provenance = sidecar["provenance"]
    return {
        **sidecar["recipe"],
        "number": sidecar["number"],
        "file": sidecar["file"],
        "class": sidecar["class"],
        "volume_m3": sidecar["volume"] * metre**3,
        "area_m2": sidecar["area"] * metre**2,
        "inertia_m5": inertia,
        "certificate": provenance["certificate"],
        "relaxed_vertices": provenance["relaxed_vertices"],
        "content_sha256": sidecar["content_sha256"],
        "file_sha256": sidecar["file_sha256"],
        "lithoform": sidecar["lithoform"],
    }


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=2) + "\n").encode()
