"""A packing from the stones to the files: read, let down, settled, measured, written; stopped, it goes on."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lithoform.atomic import atomic_write, remove_partials
from lithoform.dem import TABLE_10, Model, Scales, State, scales
from lithoform.dem.checkpoint import read_checkpoint, write_checkpoint
from lithoform.dem.output import VtkSeries, write_table
from lithoform.dem.scales import LARGEST_STEP
from lithoform.errors import OutputError, RecipeError, SceneError
from lithoform.locking import folder_lock
from lithoform.packing.container import Container
from lithoform.packing.folder import (
    BLOCKS_FILE,
    CHECKPOINT_FILE,
    MESHES_FOLDER,
    PICTURE_FILE,
    PROGRESS_FILE,
    TABLE_FILE,
    VTK_FOLDER,
    check_folder,
    clear_folder,
    write_numbers,
)
from lithoform.packing.placing import insert, random_attitudes, require_room
from lithoform.packing.results import Packing, blocks_csv, measure_packing
from lithoform.packing.settling import Schedule, is_at_rest, schedule, settle
from lithoform.packing.stones import draw, find_stones, read_shapes, refuse_inside
from lithoform.progress import counted, track
from lithoform.seeds import MAX_SEED
from lithoform.sidecar import program_version

__all__ = ["Made", "Request", "pack", "pour"]

# A frame of the series every so many looks.
_FRAME = 5
_UNITS = {"kinetic": "J", "potential": "J", "elastic": "J", "height": "m", "fastest": "m/s"}


@dataclass(frozen=True, kw_only=True)
class Request:
    """What is to be packed, and how.

    Attributes
    ----------
    sources : tuple of Path
        Mesh files, folders of them, databases.
    container : str
        As `Container.parse`.
    count : int or None
        Stones; by default each that the sources hold once.
    seed : int
        Of the choice, the order, the places and the attitudes of the stones.
    unit : str
        Of files that do not tell theirs.
    select : str or None
        Particles of a database.
    gravity : float
        Downwards [m/s^2].
    stiffness_factor : float
        On Young's modulus of Table 10.
    dt, until : float or None
        Time step and latest end [s]; by default 0.06 of the Rayleigh time, and when the stones are at rest.
    vtk : bool
        Whether to write a series for ParaView.
    """

    sources: tuple[Path, ...]
    container: str
    count: int | None = None
    seed: int = 0
    unit: str = "mm"
    select: str | None = None
    gravity: float = 9.81
    stiffness_factor: float = 0.01
    dt: float | None = None
    until: float | None = None
    vtk: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= MAX_SEED:
            raise RecipeError(f"the seed must be 0 to {MAX_SEED}; got {self.seed}.")
        for name, most in (("gravity", math.inf), ("stiffness_factor", 1.0), ("dt", math.inf), ("until", math.inf)):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and 0.0 < value <= most):
                limit = f" and at most {most:g}" if most < math.inf else ""
                raise RecipeError(f"expected --{name.replace('_', '-')} above 0{limit}; got {value:g}.")

    def settings(self) -> dict[str, Any]:
        """Plain values, with the version of the program."""
        told = {**dataclasses.asdict(self), "sources": [str(path) for path in self.sources]}
        return {"lithoform": program_version(), **told}


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


def pour(shapes: Sequence[Any], which: np.ndarray, container: Container, *, rng: np.random.Generator,
         stiffness_factor: float = 0.01, gravity: float = 9.81) -> tuple[Model, State]:  # fmt: skip
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

    Raises
    ------
    SceneError
        If the stones do not fit.
    """
    material = TABLE_10.softened(stiffness_factor)
    model = Model(shapes=tuple(shapes), materials=(material,), shape=which, walls=container.walls,
                  gravity=(0.0, 0.0, -gravity))  # fmt: skip
    require_room(float(model.bounding_radius.max()), container, model.volume)
    places = insert(model.bounding_radius, container, rng)
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
    RecipeError, SceneError, FileFormatError, MeshError, SampleError
        If the request cannot be met.
    OutputError
        If the folder is not one to write into.
    SimulationError
        If the simulation fails; what was reached before stays.
    """
    from lithoform.atomic import make_folder

    if overwrite and resume:
        raise OutputError("--overwrite starts anew and --resume goes on; give one of them.")
    container = Container.parse(request.container)
    rng = np.random.Generator(np.random.PCG64(request.seed))
    stones = find_stones(request.sources, unit=request.unit, select=request.select)
    order = draw(len(stones), request.count, rng)
    refuse_inside(out, request.sources)
    settings = request.settings()
    make_folder(out)
    with folder_lock(out):
        former = check_folder(out, settings, overwrite=overwrite, resume=resume)
        if resume and former is not None and former["finished"]:
            lost = [name for name in (BLOCKS_FILE, TABLE_FILE, CHECKPOINT_FILE) if not (out / name).is_file()]
            if lost:
                raise OutputError(f"{out} holds a finished packing of which {', '.join(lost)} is missing: give "
                                  "--overwrite to make it anew.")  # fmt: skip
            return former["results"]
        chosen, which = np.unique(order, return_inverse=True)
        used = [stones[k] for k in chosen.tolist()]
        read = list(track(read_shapes(used, threads=threads), total=len(used), what="stones", enabled=progress))
        for stone, (_, repairs) in zip(used, read, strict=True):
            for text in repairs:
                told(f"{stone.name}: {text}")
        model, start = pour([shape for shape, _ in read], which, container, rng=rng, gravity=request.gravity,
                            stiffness_factor=request.stiffness_factor)  # fmt: skip
        given = _time_step(model, request.dt)
        plan = schedule(model, start, given, request.until)
        # From here on a former packing is gone; what cannot be done has been refused.
        if former is None or not resume:
            clear_folder(out, settings)
        remove_partials(out)
        found = scales(model, _pressure(model, container), duration=plan.expected * given, dt=given, threads=threads)
        for line in _introduction(request, container, model, found, plan):
            told(line)
        names = [stone.name for stone in used]
        return _make(request, out, model, start, container, plan, found, names, device, threads, progress, settings,
                     draw_picture)  # fmt: skip


def _make(
    request: Request, out: Path, model: Model, start: State, container: Container, plan: Schedule, found: Scales,
    names: list[str], device: str, threads: int | None, progress: bool, settings: dict[str, Any],
    draw_picture: Callable[[Made], bytes] | None,
) -> dict[str, Any]:  # fmt: skip
    began = time.perf_counter()
    state, rows, before = _former(out, model, start)
    series = VtkSeries(out / VTK_FOLDER, model, surface="hull") if request.vtk else None

    def on_look(model: Model, state: State, number: int) -> None:
        if series is not None and number % _FRAME == 0:
            series(model, state)
        spent = before + time.perf_counter() - began
        atomic_write(out / PROGRESS_FILE, json.dumps({"seconds": spent, "rows": rows}).encode())

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
    write_numbers(out, settings, {"results": results}, finished=True)
    # Last: without it a run that is stopped here would begin anew.
    (out / PROGRESS_FILE).unlink(missing_ok=True)
    return results


def _former(out: Path, model: Model, start: State) -> tuple[State, list[dict[str, float]], float]:
    """State, looks and time spent of a run that was stopped; those of the start where there is none."""
    if not ((out / CHECKPOINT_FILE).exists() and (out / PROGRESS_FILE).exists()):
        return start, [], 0.0
    state = read_checkpoint(out / CHECKPOINT_FILE, model)
    try:
        told = json.loads((out / PROGRESS_FILE).read_bytes())
        rows = [{str(key): value for key, value in row.items()} for row in told["rows"]]
        return state, rows, float(told["seconds"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise OutputError(f"{out / PROGRESS_FILE} is damaged, the packing cannot be resumed: give --overwrite to make "
                          "it anew.") from error  # fmt: skip


def _number(value: float) -> float | None:
    """What JSON can hold."""
    return value if math.isfinite(value) else None


def _time_step(model: Model, asked: float | None) -> float:
    found = scales(model)
    if asked is None:
        return found.step
    most = LARGEST_STEP * found.rayleigh_time
    if asked > most:
        raise SceneError(
            f"expected --dt of at most {LARGEST_STEP:g} of the Rayleigh time, {most:.3g} s; got {asked:.3g} s: leave "
            f"it out to take {found.step:.3g} s."
        )
    return asked


def _pressure(model: Model, container: Container) -> float:
    """Weight of the stones over the area of the floor [Pa]."""
    return float(model.mass.sum()) * math.hypot(*model.gravity) / container.area


def _introduction(request: Request, container: Container, model: Model, found: Scales, plan: Schedule) -> list[str]:
    modulus = model.materials[0].youngs_modulus
    softer = f"Young's modulus {modulus / 1e6:,.4g} MPa instead of {TABLE_10.youngs_modulus / 1e6:,.0f} MPa "
    softer += f"(--stiffness-factor {request.stiffness_factor:g}), so that the steps are longer"
    if request.stiffness_factor == 1.0:
        softer = "as it stands"
    return [
        f"{model.count} stones ({len(model.shapes)} different) are let down into a {container.text()}.",
        f"Material of stones and walls: Table 10, {softer}. Local damping: none.",
        f"No stone falls faster than {plan.fastest:.2f} m/s, as if it were poured from close above.",
        f"Scales under the stones' weight: {found.text()}.",
    ]
