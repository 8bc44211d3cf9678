"""Runs of the command line: a plan of numbered particles, carried out into a folder, resumable.

A particle counts as finished when its sidecar is there and the mesh beside it has the bytes that the sidecar
names.  The sidecar is written last, each file whole or not at all, so that a run killed at any moment can be
resumed and ends with the files of an uninterrupted one.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from lithoform import mesh_io
from lithoform.atomic import atomic_path, atomic_write, remove_partials
from lithoform.errors import FileFormatError, OutputError
from lithoform.generation import generate_many
from lithoform.parameters import Recipe
from lithoform.particle import Particle
from lithoform.planning import Plan
from lithoform.presets import shape_class_of
from lithoform.progress import track
from lithoform.sidecar import read_sidecar, sidecar_path

__all__ = ["PICTURE_FILE", "PLAN_FILE", "TABLE_FILE", "open_run", "produce", "unfinished", "write_table"]

PLAN_FILE: Final = "run.json"
TABLE_FILE: Final = "particles.parquet"
PICTURE_FILE: Final = "gallery.png"

_OWN_FILE: Final = re.compile(r"\d{6,}\.(stl|ply|obj|glb|3mf|json)|run\.json|particles\.parquet|gallery\.png")
_ROW_GROUP: Final = 4096


def open_run(out: Path, plan: Plan, *, overwrite: bool = False, resume: bool = False) -> None:
    """Make the folder of a run ready, or refuse.

    Parameters
    ----------
    out : Path
        Folder; made if it does not exist.
    plan : Plan
    overwrite : bool
        Remove the files of a former run of this program first (and nothing else).
    resume : bool
        Go on with an unfinished run of the same plan.

    Raises
    ------
    OutputError
        If the folder has other content and neither option is given, holds a run of another plan, or cannot
        be made.
    """
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out} is a file; name a folder for the particles.")
    try:
        out.mkdir(parents=True, exist_ok=True)
        content = [path for path in out.iterdir() if not (path.name.startswith(".") and path.name.endswith(".partial"))]
    except OSError as error:
        raise OutputError(f"the folder {out} cannot be used: {error.strerror}.") from error
    plan_path = out / PLAN_FILE
    if content and resume and plan_path.exists():
        _require_same_plan(plan_path, plan)
        remove_partials(out)
        return
    if content and resume:
        raise OutputError(f"{out} holds no run to resume (there is no {PLAN_FILE}); choose another folder.")
    if content and not overwrite:
        way = (
            "--resume finishes it, --overwrite starts anew"
            if plan_path.exists()
            else "choose another, or give --overwrite"
        )
        held = "a run of this program" if plan_path.exists() else "other files"
        raise OutputError(f"the folder {out} is not empty, it holds {held}: {way}.")
    if plan_path.exists():
        for path in content:
            if _OWN_FILE.fullmatch(path.name):
                path.unlink(missing_ok=True)
    remove_partials(out)
    atomic_write(plan_path, _json(plan.as_dict()))


def _require_same_plan(path: Path, plan: Plan) -> None:
    try:
        former = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OutputError(f"{path} is damaged, so that the run cannot be resumed; use --overwrite.") from error
    ours = plan.as_dict()
    if former != ours:
        names = (
            sorted(k for k in {*former, *ours} if former.get(k) != ours.get(k)) if isinstance(former, dict) else ["all"]
        )
        raise OutputError(
            f"{path.parent} holds a run with other settings ({', '.join(names)} differ): resume it with the same "
            "command, or use --overwrite."
        )


def unfinished(out: Path, plan: Plan) -> list[int]:
    """Numbers of the particles that a run still has to make, in order."""
    numbers = track(range(1, plan.count + 1), total=plan.count, what="files looked at")
    return [n for n in numbers if not _is_finished(out / plan.mesh_file(n))]


def _is_finished(mesh_file: Path) -> bool:
    try:
        expected = read_sidecar(sidecar_path(mesh_file))["file_sha256"]
        return hashlib.sha256(mesh_file.read_bytes()).hexdigest() == expected
    except (FileFormatError, OSError):
        return False


def produce(out: Path, plan: Plan, numbers: list[int], *, device: str = "auto") -> Iterator[int]:
    """Generate and write particles, yielding each number once its files are there.

    Parameters
    ----------
    out : Path
        A folder made ready by `open_run`.
    plan : Plan
    numbers : list of int
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


def _writer(out: Path, plan: Plan, numbers: list[int]) -> Callable[[int, Particle], int]:
    def write(index: int, particle: Particle) -> int:
        number = numbers[index]
        extra = {"number": number, "class": plan.class_of(number) or shape_class_of(particle.recipe.size)}
        particle.save(out / plan.mesh_file(number), unit=plan.unit, extra=extra)
        return number

    return write


def write_table(out: Path, plan: Plan) -> Path:
    """Write OUT/particles.parquet from the sidecars: a row a particle, in SI units, in bounded memory.

    Parameters
    ----------
    out : Path
        Folder with all particles of the plan.
    plan : Plan

    Returns
    -------
    Path

    Raises
    ------
    OutputError, FileFormatError
        If it cannot be written, or a sidecar is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    target = out / TABLE_FILE
    schema = pa.schema(_columns(pa))
    with atomic_path(target) as partial, pq.ParquetWriter(partial, schema) as writer:
        for start in range(1, plan.count + 1, _ROW_GROUP):
            numbers = range(start, min(start + _ROW_GROUP, plan.count + 1))
            rows = [_row(read_sidecar(sidecar_path(out / plan.mesh_file(n)))) for n in numbers]
            writer.write_table(pa.Table.from_pylist(rows, schema=schema))
    return target


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
