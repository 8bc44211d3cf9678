"""A packing from the stones to the files: read, let down, settled, measured, written; stopped, it goes on."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import atomic_write, make_folder
from lithoform.dem import TABLE_10, Model, Scales, State, scales, simulate
from lithoform.dem.checkpoint import write_checkpoint
from lithoform.dem.output import VtkSeries, write_table
from lithoform.errors import OutputError, RecipeError
from lithoform.locking import folder_lock
from lithoform.packing.beforehand import introduction, note_on_sizes, pressure, require_stiffness, time_step
from lithoform.packing.container import Container
from lithoform.packing.failing import naming_stones
from lithoform.packing.folder import (
    BLOCKS_FILE,
    CHECKPOINT_FILE,
    FOLDER,
    MESHES_FOLDER,
    NUMBERS_FILE,
    PICTURE_FILE,
    PROGRESS_FILE,
    TABLE_FILE,
    VTK_FOLDER,
)
from lithoform.packing.placing import insert, random_attitudes, require_room
from lithoform.packing.request import Request, path_of
from lithoform.packing.results import Packing, blocks_csv, measure_packing
from lithoform.packing.resuming import read_progress, write_progress
from lithoform.packing.settling import Schedule, is_at_rest, schedule, settle
from lithoform.packing.stones import draw, find_stones, read_shapes, refuse_inside
from lithoform.progress import counted

__all__ = ["Made", "pack", "pour"]

_MOST_THREADS: Final = 10_000
# A frame of the series every so many looks.
_FRAME = 5
# What packing.json holds of the results.
_RESULTS: Final = frozenset(
    "packing_density packing_density_between_m total_density height_m coordination_number "
    "coordination_without_rattlers coordination_with_walls rattlers stones different_stones below_the_rim at_rest "
    "deepest_overlap_over_radius steps time_s time_step_s fastest_fall_m_s scales seconds".split()
)
_UNITS = {"kinetic": "J", "potential": "J", "elastic": "J", "height": "m", "fastest": "m/s"}


@dataclass(frozen=True, eq=False)
class Made:
    """A packing that has been made.

    Attributes
    ----------
    model, state
        As they are at the end.
    container : Container
    packing : Packing
    rows : list of dict
        The looks at it on the way: `lithoform.packing.settling.look`.
    results : dict
        Plain values, for packing.json.
    """

    model: Model
    state: State
    container: Container
    packing: Packing
    rows: list[dict[str, float]]
    results: dict[str, Any]


def pour(
    shapes: Sequence[Any],
    which: np.ndarray,
    container: Container,
    *,
    rng: np.random.Generator,
    stiffness_factor: float = 0.01,
    gravity: float = 9.81,
    progress: bool = False,
) -> tuple[Model, State]:
    """Stones above the floor of a container, before they fall.

    Parameters
    ----------
    shapes : sequence of Shape
    which : numpy.ndarray of int, shape (n,)
        Shape of each stone, in the order in which they are let down.
    container : Container
    rng : numpy.random.Generator
        Of places and attitudes.
    stiffness_factor : float
        On Young's modulus of Table 10.
    gravity : float
        [m/s^2].
    progress : bool
        Whether to show a bar.

    Raises
    ------
    SceneError
        If the stones do not fit.
    """
    material = TABLE_10.softened(stiffness_factor)
    model = Model(shapes=tuple(shapes), materials=(material,), shape=which, walls=container.walls,
                  gravity=(0.0, 0.0, -gravity))  # fmt: skip
    require_room(float(model.bounding_radius.max()), container, model.volume)
    places = insert(model.bounding_radius, container, rng, progress=progress)
    return model, State.at_rest(model, places, random_attitudes(len(which), rng))


def pack(
    request: Request,
    out: Path,
    *,
    device: str = "auto",
    threads: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
    progress: bool = False,
    told: Callable[[str], object] = lambda _: None,
    draw_picture: Callable[[Made], bytes] | None = None,
) -> dict[str, Any]:
    """Make a packing in a folder.

    Parameters
    ----------
    request : Request
    out : Path
        Folder for packing.json, blocks.csv, table.parquet, packing.checkpoint, the series and the picture.
    device, threads
        As `lithoform.dem.simulate`; the result does not depend on the threads.
    overwrite, resume : bool
        Replace the packing that the folder holds, or go on with it.
    progress : bool
        Whether to show bars.
    told : callable
        Is told, a line at a time, what there is to know before the simulation begins.
    draw_picture : callable, optional
        Gives the content of packing.png.

    Returns
    -------
    dict
        What packing.json holds of the results.

    Raises
    ------
    RecipeError, SceneError, FileFormatError, MeshError, SampleError, DeviceError
        If the request cannot be met.
    OutputError
        If the folder is not one to write into.
    SimulationError
        If the simulation fails; what was reached before stays. A former packing is replaced only once the first step
        has been made.
    """
    if overwrite and resume:
        raise OutputError("--overwrite starts anew and --resume goes on; give one of them.")
    out = _checked(request, out, device, threads)
    container = Container.parse(request.container)
    rng = np.random.Generator(np.random.PCG64(request.seed))
    stones = find_stones(request.sources, unit=request.unit, select=request.select)
    order = draw(len(stones), request.count, rng)
    refuse_inside(out, request.sources)
    settings = request.settings()
    make_folder(out)
    with folder_lock(out):
        former = FOLDER.check(out, settings, overwrite=overwrite, resume=resume)
        if resume and former is not None and former["finished"]:
            return _finished(out, former)
        if resume and former is None:
            told(f"{out} holds no packing to go on with: it is begun.")
        chosen, which = np.unique(order, return_inverse=True)
        used = [stones[k] for k in chosen.tolist()]
        read = read_shapes(used, threads=threads, progress=progress)
        for stone, (_, repairs) in zip(used, read, strict=True):
            for text in repairs:
                told(f"{stone.name}: {text}")
        factor = request.stiffness_factor
        model, start = pour([shape for shape, _ in read], which, container, rng=rng, gravity=request.gravity,
                            stiffness_factor=factor, progress=progress)  # fmt: skip
        note = note_on_sizes(model, container, from_files=any(stone.key is None for stone in used))
        require_stiffness(model, container, factor)
        given = time_step(model, request.dt)
        plan = schedule(model, start, given, request.until)
        names = [stone.name for stone in used]
        with naming_stones(lambda k: names[which[k]], factor, given):
            if not FOLDER.goes_on(former, resume=resume):
                # Tried first: a step that fails costs no former packing.
                simulate(model, start, until=given, dt=given, device=device, threads=threads)
                FOLDER.clear(out, settings)
            FOLDER.remove_unfinished(out)
            found = scales(model, pressure(model, container), duration=plan.expected * given, dt=given, threads=threads)
            for line in [*introduction(container, model, factor, found, plan), *([note] if note else [])]:
                told(line)
            return _make(request, out, model, start, container, plan, found, names, device, threads, progress, settings,
                         draw_picture)  # fmt: skip


def _checked(request: Any, out: Any, device: Any, threads: Any) -> Path:
    """The folder as a path; a `RecipeError` if an argument is of another kind."""
    if not isinstance(request, Request):
        raise RecipeError(f"expected a lithoform.packing.request.Request; got {request!r}.")
    if not isinstance(device, str):
        raise RecipeError(f"expected a device of auto, cpu or cuda; got {device!r}.")
    if threads is not None and (type(threads) is not int or not 1 <= threads <= _MOST_THREADS):
        raise RecipeError(f"expected --threads from 1 to {_MOST_THREADS}; got {threads!r}.")
    return path_of("--out", out)


def _finished(out: Path, former: dict[str, Any]) -> dict[str, Any]:
    """Results of a packing that is complete."""
    lost = [name for name in (BLOCKS_FILE, TABLE_FILE, CHECKPOINT_FILE) if not (out / name).is_file()]
    if lost:
        raise OutputError(f"{out} holds a finished packing of which {', '.join(lost)} is missing: give --overwrite to "
                          "make it anew.")  # fmt: skip
    results = former.get("results")
    if not (isinstance(results, dict) and results.keys() >= _RESULTS):
        raise OutputError(f"{out / NUMBERS_FILE} is damaged: give --overwrite to make the packing anew.")
    return results


def _make(
    request: Request, out: Path, model: Model, start: State, container: Container, plan: Schedule, found: Scales,
    names: list[str], device: str, threads: int | None, progress: bool, settings: dict[str, Any],
    draw_picture: Callable[[Made], bytes] | None,
) -> dict[str, Any]:  # fmt: skip
    began = time.perf_counter()
    state, rows, before = read_progress(out, model, start, plan)
    series = VtkSeries(out / VTK_FOLDER, model, surface="hull") if request.vtk else None

    def on_look(model: Model, state: State, number: int) -> None:
        if series is not None and number % _FRAME == 0:
            series(model, state)
        write_progress(out, before + time.perf_counter() - began, rows)

    with counted(plan.expected, what="steps", enabled=progress) as advance:
        advance(state.step)
        state = settle(model, state, plan, rows, checkpoint=out / CHECKPOINT_FILE, on_look=on_look, advance=advance,
                       device=device, threads=threads)  # fmt: skip
    if series is not None:
        series(model, state)
        VtkSeries(out / MESHES_FOLDER, model, contacts=False)(model, state)
    write_checkpoint(out / CHECKPOINT_FILE, model, state)
    packing = measure_packing(model, state, container)
    results: dict[str, Any] = {
        "packing_density": packing.packing_density,
        "packing_density_between_m": list(packing.band),
        "total_density": packing.total_density,
        "height_m": packing.height,
        "coordination_number": packing.coordination["mean"],
        "coordination_without_rattlers": _number(packing.coordination["without_rattlers"]),
        "coordination_with_walls": packing.coordination["with_walls"],
        "rattlers": packing.coordination["rattlers"],
        "stones": model.count,
        "different_stones": len(model.shapes),
        "below_the_rim": packing.fits,
        "at_rest": is_at_rest(rows),
        "deepest_overlap_over_radius": packing.deepest,
        "steps": state.step,
        "time_s": state.time,
        "time_step_s": plan.dt,
        "fastest_fall_m_s": plan.fastest,
        "scales": {
            key: _number(value) for key, value in dataclasses.asdict(found).items() if key not in ("steps", "hours")
        },
    }  # fmt: skip
    made = Made(model, state, container, packing, rows, results)
    atomic_write(out / BLOCKS_FILE, blocks_csv(model, state, names))
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    write_table(out / TABLE_FILE, table, units={name: _UNITS.get(name, "1") for name in table if name != "time"})
    if draw_picture is not None:
        atomic_write(out / PICTURE_FILE, draw_picture(made))
    results["seconds"] = round(before + time.perf_counter() - began, 3)
    FOLDER.write(out, settings, {"results": results}, finished=True)
    # Last: without it a run that is stopped here would begin anew.
    (out / PROGRESS_FILE).unlink(missing_ok=True)
    return results


def _number(value: float) -> float | None:
    """What JSON can hold."""
    return value if math.isfinite(value) else None
