"""Many compactions by a plan: each in a folder of its own, spread over workers; stopped, the plan goes on."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import atomic_write, make_folder
from lithoform.compaction.request import Request
from lithoform.compaction.run import NUMBERS_FILE, check_request, require_stiffness, run_compaction
from lithoform.database.engine import has_dask, require_workers, spread
from lithoform.errors import LithoformError, OutputError, SimulationError
from lithoform.locking import LOCK_FILE, folder_lock
from lithoform.progress import track
from lithoform.warp_runtime import every_gpu

__all__ = ["PLAN_FILE", "RUNS_FOLDER", "run_campaign"]

PLAN_FILE: Final = "experiment.json"
RUNS_FOLDER: Final = "runs"


def run_campaign(
    plan: Sequence[tuple[str, Request]],
    settings: dict[str, Any],
    out: Path,
    *,
    what: str,
    device: str = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: bool = False,
    told: Callable[[str], object] = lambda _: None,
) -> list[dict[str, Any]]:
    """Carry out all runs of a plan that are not there yet.

    Parameters
    ----------
    plan : sequence of (str, Request)
        Names of the runs, which are those of their folders, and what is to be compacted.
    settings : dict
        Of the plan, plain: a folder goes on with the same ones only.
    out : Path
        Folder.
    what : str
        What it is, for a person: experiment, study.
    device : str
        As `lithoform.dem.simulate`. Local runs take all NVIDIA GPUs in turn, one worker each unless told otherwise;
        the workers of a scheduler choose themselves.
    workers, scheduler
        As `lithoform.database.engine.spread`, a worker making a run on one thread; but with 0 workers, or without
        Dask, this process makes one run after another on all processors.
    resume : bool
        Go on with the plan that the folder holds.
    progress : bool
        Whether to show a bar.
    told : callable
        Is told of each run that is done.

    Returns
    -------
    list of dict
        Results of the runs in the order of the plan.

    Raises
    ------
    OutputError
        If the folder holds something else, or a plan of other settings.
    LithoformError
        As `lithoform.compaction.run.run_compaction`, with the name of the run; those that were done are kept.
    SimulationError
        At the end, if the simulation of a run failed.
    """
    require_workers(workers, scheduler)
    places = [out.resolve() / RUNS_FOLDER / name for name, _ in plan]
    _check([run for run, place in zip(plan, places, strict=True) if _results_of(place) is None], device)
    in_process = workers == 0 or not (scheduler or has_dask())
    make_folder(out)
    with folder_lock(out):
        _begin(out, settings, what, resume=resume)
        devices = [device] if scheduler else every_gpu(device)
        if workers is None and devices[0].startswith("cuda"):
            workers = len(devices)
        jobs = [{"request": _placed(request), "out": str(place), "device": devices[k % len(devices)],
                 "threads": None if in_process else 1}
                for k, ((_, request), place) in enumerate(zip(plan, places, strict=True))]  # fmt: skip
        open_jobs = [job for job in jobs if _results_of(Path(job["out"])) is None]
        if len(open_jobs) < len(jobs):
            told(f"{len(jobs) - len(open_jobs)} of {len(jobs)} runs are there.")
        if in_process:
            # One after another in the main thread, which Ctrl-C reaches; each takes all processors.
            done = map(_work, open_jobs)
        else:
            done = spread(_work, iter(open_jobs), workers=workers, scheduler=scheduler)
        failed = []
        for name, seconds, fault in track(done, total=len(open_jobs), what="runs", enabled=progress):
            told(f"{name}: {fault or f'{seconds:.0f} s'}")
            if fault:
                failed.append(f"{name}: {fault}")
        if failed:
            more = f" ({len(failed) - 1} more failed)" if len(failed) > 1 else ""
            raise SimulationError(f"{failed[0].rstrip('.')}{more}; the {len(plan) - len(failed)} other runs are kept.")
        return [_required(place) for place in places]


def _begin(out: Path, settings: dict[str, Any], what: str, *, resume: bool) -> None:
    path = out / PLAN_FILE
    if path.exists():
        try:
            former = dict(json.loads(path.read_bytes())["settings"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise OutputError(f"{path} is damaged: name another folder.") from error
        differing = sorted(key for key in {*former, *settings} if former.get(key) != settings.get(key))
        if differing and any((out / RUNS_FOLDER).glob("*")):
            raise OutputError(f"{out} holds an experiment or a study with other settings ({', '.join(differing)}): go "
                              "on with the same command, or name another folder.")  # fmt: skip
        if differing:
            atomic_write(path, json.dumps({"settings": settings}, indent=2).encode())
        elif not resume:
            raise OutputError(f"{out} holds this {what} already: --resume goes on, or name another folder.")
    elif any(path.name != LOCK_FILE for path in out.iterdir()):
        raise OutputError(f"the folder {out} is not empty: name another.")
    else:
        atomic_write(path, json.dumps({"settings": settings}, indent=2).encode())
    make_folder(out / RUNS_FOLDER)


def _work(job: dict[str, Any]) -> tuple[str, float, str]:
    """A run, in a worker: its name, its time [s], and what went wrong in the simulation, which stops no other run."""
    out = Path(job["out"])
    resume = (out / NUMBERS_FILE).exists()
    try:
        with _naming(out.name):
            results = run_compaction(job["request"], out, device=job["device"], threads=job["threads"], resume=resume)
    except SimulationError as error:
        return out.name, 0.0, str(error)
    return out.name, results["seconds"], ""


def _check(plan: Sequence[tuple[str, Request]], device: str) -> None:
    """Refuse a plan of which a run would be refused, as far as that can be told without the meshes."""
    drawn: set[tuple[Any, ...]] = set()
    # First what needs no population.
    for name, request in plan:
        with _naming(name):
            require_stiffness(request)
    for name, request in plan:
        key = (request.population, request.preset, request.gradation, request.curve, request.min_size, request.count,
               request.mould, request.select)  # fmt: skip
        if key not in drawn:
            with _naming(name):
                check_request(request, device=device)
        drawn.add(key)


@contextlib.contextmanager
def _naming(run: str) -> Iterator[None]:
    """Errors with the name of the run."""
    try:
        yield
    except SimulationError:
        raise
    except LithoformError as error:
        raise type(error)(f"{run}: {error}") from error


def _placed(request: Request) -> Request:
    """The same for a process that works in another folder."""
    return replace(request, population=request.population.resolve())


def _results_of(place: Path) -> dict[str, Any] | None:
    try:
        told = json.loads((place / NUMBERS_FILE).read_bytes())
    except (OSError, ValueError):
        return None
    return told["results"] if told.get("finished") else None


def _required(place: Path) -> dict[str, Any]:
    results = _results_of(place)
    if results is None:
        raise OutputError(f"the run in {place} is not finished: give the same command with --resume.")
    return results
