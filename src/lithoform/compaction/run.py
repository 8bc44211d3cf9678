"""A compaction from the population to the files: drawn, compacted, measured, written; stopped, it goes on."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import atomic_write
from lithoform.compaction.compactor import STAGES, Compaction, Machine, compact
from lithoform.compaction.protocol import find_preset
from lithoform.compaction.request import Request
from lithoform.compaction.specimen import Plan, Specimen, check_specimen, make_specimen
from lithoform.compaction.stages import Look
from lithoform.database.store import Store
from lithoform.dem import TABLE_10, Model, State, VtkSeries, write_table
from lithoform.dem.scales import stiffness_number
from lithoform.errors import LithoformError, OutputError, SceneError
from lithoform.gradation.curves import find_gradation
from lithoform.locking import folder_lock
from lithoform.packing.failing import naming_stones
from lithoform.packing.results import blocks_csv, deepest_overlap
from lithoform.progress import counted
from lithoform.result_folder import ResultFolder
from lithoform.warp_runtime import resolve_device

__all__ = ["FOLDER", "Drawing", "check_request", "require_stiffness", "run_compaction"]

NUMBERS_FILE: Final = "compaction.json"
TABLE_FILE: Final = "table.parquet"
BLOCKS_FILE: Final = "blocks.csv"
PAGE_FILE: Final = "report.html"
PICTURES: Final = ("specimen.png", "film.png", "curve.png")
VTK_FOLDER: Final = "vtk"

FOLDER: Final = ResultFolder(
    what="compaction",
    numbers=NUMBERS_FILE,
    files=frozenset({NUMBERS_FILE, TABLE_FILE, BLOCKS_FILE, PAGE_FILE, *PICTURES,
                     *(f"{stage}.{kind}" for stage in STAGES for kind in ("checkpoint", "jsonl"))}),
    series=(VTK_FOLDER,),
)  # fmt: skip

# Wall-clock time after which the time that was spent is written down [s].
_NOTED: Final = 20.0
# Mean overlap over radius that is allowed: at ten times as much a contact is a fault.
_SOFTEST: Final = 0.006

_UNITS: Final = {"gyration": "1", "height": "m", "packing_density": "1", "pressure": "Pa", "floor_pressure": "Pa",
                 "lateral_pressure": "Pa", "coordination": "1", "coordination_without_rattlers": "1", "kinetic": "J",
                 "potential": "J", "elastic": "J", "work_of_platen": "J", "work_of_mould": "J",
                 "kinetic_share": "1"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Drawing:
    """What pictures and the page are made of.

    Attributes
    ----------
    compaction : Compaction
    states : dict of str to (Model, State)
        At the end of each stage, by its name.
    results : dict
        Plain values, as in compaction.json.
    settings : dict
    """

    compaction: Compaction
    states: dict[str, tuple[Model, State]]
    results: dict[str, Any]
    settings: dict[str, Any]


def run_compaction(
    request: Request,
    out: Path,
    *,
    device: str = "auto",
    threads: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
    progress: bool = False,
    told: Callable[[str], object] = lambda _: None,
    draw: Callable[[Drawing], dict[str, bytes]] | None = None,
) -> dict[str, Any]:
    """Compact a specimen of a population in a folder.

    Parameters
    ----------
    request : Request
    out : Path
        Folder for compaction.json, table.parquet, blocks.csv, the checkpoints, the series and the pictures.
    device, threads
        As `lithoform.dem.simulate`; the result does not depend on the threads.
    overwrite, resume : bool
        Replace the compaction that the folder holds, or go on with it.
    progress : bool
        Whether to show bars.
    told : callable
        Is told, a line at a time, what there is to know.
    draw : callable, optional
        Gives the content of pictures and of the page, by name.

    Returns
    -------
    dict
        What compaction.json holds of the results.

    Raises
    ------
    RecipeError, SceneError, SampleError, FileFormatError, MeshError
        If the request cannot be met.
    OutputError
        If the folder is not one to write into.
    SimulationError
        If the simulation fails; what was reached before stays.
    """
    if overwrite and resume:
        raise OutputError("--overwrite starts anew and --resume goes on; give one of them.")
    protocol, plan = request.protocol, _plan(request)
    require_stiffness(request)
    store, settings = Store(request.population), request.settings()

    def may_grow(asked: dict[str, Any]) -> bool:
        return _is_longer(settings, asked)

    FOLDER.check(out, settings, overwrite=overwrite, resume=resume, may_grow=may_grow)
    with folder_lock(out):
        former = FOLDER.check(out, settings, overwrite=overwrite, resume=resume, may_grow=may_grow)
        if resume and former is not None and former["finished"] and former["settings"] == settings:
            return former["results"]
        specimen = make_specimen(store, plan, protocol, threads=threads, device=device, progress=progress, told=told)
        machine = Machine(specimen=specimen, protocol=protocol, rate_factor=request.rate_factor, seed=request.seed,
                          bed_stiffness_factor=request.bed_stiffness_factor)  # fmt: skip
        for line in introduction(machine, request, device=device, threads=threads):
            told(line)
        if FOLDER.goes_on(former, resume=resume):
            FOLDER.write(out, settings, {"seconds": _spent(former)}, finished=False)
        else:
            FOLDER.clear(out, settings)
            former = None
        FOLDER.remove_unfinished(out)
        names, which = specimen.names, specimen.model.shape
        with naming_stones(lambda k: names[which[k]], request.stiffness_factor):
            return _make(machine, request, out, settings, _spent(former), device, threads, progress, told, draw)


def check_request(request: Request, *, threads: int | None = None, device: str = "auto") -> None:
    """Find out what is wrong with a request, as far as that can be told without the meshes.

    Raises
    ------
    RecipeError, SceneError, SampleError, FileFormatError
        As `run_compaction`.
    """
    require_stiffness(request)
    check_specimen(Store(request.population), _plan(request), request.protocol, threads=threads, device=device)


def require_stiffness(request: Request) -> None:
    """Refuse stones that the platen would press into one another: chains carry ten times the mean."""
    factor, pressure = request.stiffness_factor, request.protocol.pressure
    overlap = 1.0 / stiffness_number(TABLE_10.softened(factor), pressure)
    if overlap > _SOFTEST:
        needed = 1.005 * factor * (overlap / _SOFTEST) ** 1.5
        way = f"at least --stiffness-factor {needed:.2g}, or a smaller --pressure" if needed <= 1.0 else (
            "a smaller --pressure"
        )  # fmt: skip
        raise SceneError(
            f"expected stones that are pressed at most {_SOFTEST:g} of a radius into one another on the average; at "
            f"{pressure / 1e3:g} kPa with --stiffness-factor {factor:g} it would be {overlap:.2g}: give {way}."
        )


def _plan(request: Request) -> Plan:
    return Plan(gradation=find_gradation(request.gradation), min_size=request.min_size, curve=request.curve,
                count=request.count, mould=request.mould, select=request.select, seed=request.seed,
                stiffness_factor=request.stiffness_factor)  # fmt: skip


def _is_longer(settings: dict[str, Any], former: dict[str, Any]) -> bool:
    """Whether settings differ from former ones by more gyrations or a lower height alone: what was made stays right."""
    if any(settings.get(key) != former.get(key) for key in {*settings, *former} - {"gyrations", "to_height"}):
        return False
    ends = []
    for told in (settings, former):
        try:
            changes = {"gyrations": told["gyrations"], "height": told["to_height"]}
            ends.append(find_preset(told["preset"]).changed(**changes))
        except (KeyError, TypeError, LithoformError):
            return False
    return ends[0].gyrations >= ends[1].gyrations and ends[0].height <= ends[1].height


def introduction(machine: Machine, request: Request, *, device: str = "auto", threads: int | None = None) -> list[str]:
    """What there is to know before a run, in sentences."""
    specimen, protocol = machine.specimen, machine.protocol
    model, modulus = specimen.model, specimen.model.materials[0].youngs_modulus
    differing = specimen.grading.largest_difference
    # How fast a GPU is here is not known before it has run.
    steps = machine.expected_steps if resolve_device(device) == "cpu" else 0
    stiffness = f"Young's modulus {modulus / 1e6:,.4g} MPa"
    if request.stiffness_factor != 1.0:
        stiffness += f" instead of 55,000 MPa (--stiffness-factor {request.stiffness_factor:g})"
    stones = (
        f"{model.count} stones of {len(model.shapes)} shapes, {specimen.grading.mass:.3f} kg, {request.gradation} from "
        f"{1e3 * request.min_size:g} mm up, met within {differing:.2f} % of the mass."
    )
    done = (
        f"Protocol {protocol.name}: {protocol.pressure / 1e3:g} kPa, {protocol.angles()}, "
        f"{protocol.rate * request.rate_factor:g} gyrations a minute instead of {protocol.rate:g} (--rate-factor "
        f"{request.rate_factor:g}), until {1e3 * machine.target:.2f} mm or {protocol.gyrations} gyrations."
    )
    return [
        stones,
        *specimen.scaled(protocol),
        done,
        f"Material of stones, mould and platens: Table 10, {stiffness}. Local damping: none.",
        f"Scales of the gyrations, and cost of the whole run: {machine.scales(steps=steps, threads=threads).text()}.",
    ]


def _make(
    machine: Machine, request: Request, out: Path, settings: dict[str, Any], before: float, device: str,
    threads: int | None, progress: bool, told: Callable[[str], object],
    draw: Callable[[Drawing], dict[str, bytes]] | None,
) -> dict[str, Any]:  # fmt: skip
    began = noted = time.perf_counter()
    states: dict[str, tuple[Model, State]] = {}
    series = VtkSeries(out / VTK_FOLDER, machine.specimen.model, surface="hull") if request.vtk else None

    with _Bars(progress) as bars:

        def on_look(stage: str, model: Model, state: State, row: Look) -> None:
            nonlocal noted
            if time.perf_counter() - noted > _NOTED:
                noted = time.perf_counter()
                FOLDER.write(out, settings, {"seconds": before + noted - began}, finished=False)
            bars.advance(state.step)
            whole = abs(row["gyration"] - round(row["gyration"])) < 1e-6
            if series is not None and stage == "gyration" and whole:
                series(model, state)

        done = compact(machine, out, told=told, on_begin=bars.begin, on_look=on_look, device=device, threads=threads,
                       on_stage=lambda name, model, state: states.update({name: (model, state)}))  # fmt: skip
    results = {**_results(done), "seconds": round(before + time.perf_counter() - began, 3)}
    _write(out, done, settings)
    if draw is not None:
        for name, content in draw(Drawing(done, states, results, settings)).items():
            atomic_write(out / name, content)
    FOLDER.write(out, settings, {"results": results}, finished=True)
    return results


class _Bars(contextlib.ExitStack):
    """A bar for each stage, of the steps that it may take."""

    def __init__(self, enabled: bool) -> None:
        super().__init__()
        self._enabled = enabled
        self._step = 0
        self._more: Callable[[int], None] = lambda _: None

    def begin(self, name: str, step: int, longest: int) -> None:
        """A stage begins at a step, and takes so many at most."""
        self.close()
        self._step = step
        self._more = self.enter_context(counted(longest, what=f"steps of {name}, at most", enabled=self._enabled))

    def advance(self, step: int) -> None:
        """A step is reached."""
        self._more(step - self._step)
        self._step = step


def _spent(former: dict[str, Any] | None) -> float:
    """Wall-clock time that a run that was stopped has taken [s]."""
    told = former or {}
    seconds = told.get("seconds", (told.get("results") or {}).get("seconds", 0.0))
    return float(seconds) if isinstance(seconds, (int, float)) and seconds >= 0.0 else 0.0


def _results(done: Compaction) -> dict[str, Any]:
    machine, series = done.machine, done.series
    specimen, protocol = machine.specimen, machine.protocol
    found = machine.scales()
    pressures = np.array([row["pressure"] for row in done.looks["gyration"]])
    pressed = done.looks["pressing"][-1]
    last = done.looks["gyration"][-1]
    return {
        "fit": _fit(done),
        "series": {name: series[name].tolist() for name in series if name != "step"},
        "loose": {"height": pressed["height"], "packing_density": pressed["packing_density"],
                  "coordination": pressed["coordination"]},
        "compacted": {"height": last["height"], "packing_density": last["packing_density"],
                      "coordination": last["coordination"], "gyration": last["gyration"]},
        "height_reached": done.reached,
        "target_height": machine.target,
        "stones": specimen.model.count,
        "different_stones": len(specimen.model.shapes),
        "mass": specimen.grading.mass,
        "mould_diameter": specimen.diameter,
        "mould_over_largest_stone": specimen.diameter / specimen.largest,
        "height_scale": specimen.height_scale,
        "angle_external": protocol.angle,
        "angle_internal": protocol.angle,
        "gyrations_per_second": machine.frequency,
        "pressure": {"asked": protocol.pressure, "mean": float(pressures.mean()),
                     "standard_deviation": float(pressures.std())},
        "deepest_overlap_over_radius": deepest_overlap(done.model, done.state),
        "steps": done.state.step,
        "time": done.state.time,
        "time_step": machine.dt,
        "scales": {key: value if math.isfinite(value) else None for key, value in dataclasses.asdict(found).items()
                   if key not in ("steps", "hours")},
        "notes": list(done.notes),
    }  # fmt: skip


def _fit(done: Compaction) -> dict[str, Any] | None:
    if done.fit is None:
        return None
    return {"A": done.fit.a, "A_mm": 1e3 * done.fit.a, "B": done.fit.b, "R2": done.fit.r_squared,
            "A_interval": list(done.fit.a_interval), "B_interval": list(done.fit.b_interval),
            "points": done.fit.points}  # fmt: skip


def _write(out: Path, done: Compaction, settings: dict[str, Any]) -> None:
    specimen: Specimen = done.machine.specimen
    atomic_write(out / BLOCKS_FILE, blocks_csv(done.model, done.state, specimen.names))
    rows = [{"stage": float(k), **row} for k, name in enumerate(STAGES) for row in done.looks[name]]
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    units = {name: _UNITS.get(name, "1") for name in table if name != "time"}
    write_table(out / TABLE_FILE, table, units=units)
