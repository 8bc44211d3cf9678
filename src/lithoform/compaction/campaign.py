"""Many compactions by a plan: each in a folder of its own, spread over workers; stopped, the plan goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import atomic_write, make_folder
from lithoform.compaction.request import Request
from lithoform.compaction.run import NUMBERS_FILE, run_compaction
from lithoform.database.engine import require_workers, spread
from lithoform.errors import OutputError
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
        As `lithoform.database.engine.spread`; a worker makes a run on one thread.
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
    """
    require_workers(workers, scheduler)
    make_folder(out)
    with folder_lock(out):
        _begin(out, settings, what, resume=resume)
        devices = [device] if scheduler else every_gpu(device)
        if workers is None and devices[0].startswith("cuda"):
            workers = len(devices)
        jobs = [{"request": request, "out": str(out / RUNS_FOLDER / name), "device": devices[k % len(devices)]}
                for k, (name, request) in enumerate(plan)]  # fmt: skip
        open_jobs = [job for job in jobs if _results_of(job["out"]) is None]
        if len(open_jobs) < len(jobs):
            told(f"{len(jobs) - len(open_jobs)} of {len(jobs)} runs are there.")
        done = spread(_work, iter(open_jobs), workers=workers, scheduler=scheduler)
        for name, seconds in track(done, total=len(open_jobs), what="runs", enabled=progress):
            told(f"{name}: {seconds:.0f} s")
        return [_required(job["out"]) for job in jobs]


def _begin(out: Path, settings: dict[str, Any], what: str, *, resume: bool) -> None:
    path = out / PLAN_FILE
    if path.exists():
        try:
            former = json.loads(path.read_bytes())["settings"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise OutputError(f"{path} is damaged: name another folder.") from error
        differing = sorted(key for key in {*former, *settings} if former.get(key) != settings.get(key))
        if differing:
            raise OutputError(f"{out} holds an experiment or a study with other settings ({', '.join(differing)}): go "
                              "on with the same command, or name another folder.")  # fmt: skip
        if not resume:
            raise OutputError(f"{out} holds this {what} already: --resume goes on, or name another folder.")
    elif any(path.name != LOCK_FILE for path in out.iterdir()):
        raise OutputError(f"the folder {out} is not empty: name another.")
    else:
        atomic_write(path, json.dumps({"settings": settings}, indent=2).encode())
    make_folder(out / RUNS_FOLDER)


def _work(job: dict[str, Any]) -> tuple[str, float]:
    """A run, in a worker."""
    out = Path(job["out"])
    resume = (out / NUMBERS_FILE).exists()
    results = run_compaction(job["request"], out, device=job["device"], threads=1, resume=resume)
    return out.name, results["seconds"]


def _results_of(out: str) -> dict[str, Any] | None:
    try:
        told = json.loads((Path(out) / NUMBERS_FILE).read_bytes())
    except (OSError, ValueError):
        return None
    return told["results"] if told.get("finished") else None


def _required(out: str) -> dict[str, Any]:
    results = _results_of(out)
    if results is None:
        raise OutputError(f"the run in {out} is not finished: give the same command with --resume.")
    return results
