"""`lithoform experiment`."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from lithoform.cli.arguments import Flag, Json, Whole, words
from lithoform.cli.output import say

__all__ = ["experiment"]

experiment = App(name="experiment", help="Experiments with the compactor: sgc, scales.", help_format="markdown")


@Parameter(name="*")
@dataclass(frozen=True)
class Options:
    """How an experiment is carried out.

    Attributes
    ----------
    device
        auto, cpu or cuda; local runs take all GPUs in turn.
    workers
        Local processes [default: the processors at hand]; 0: this one, one run after another.
    scheduler
        Address of a Dask scheduler, such as tcp://node:8786, in place of local processes.
    resume
        Go on with what OUT holds.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """

    device: str = "auto"
    workers: Whole | None = None
    scheduler: str | None = None
    resume: Flag = False
    json_: Json = False
    debug: Flag = False


@experiment.command
def sgc(
    out: Path,
    /,
    *,
    scanned: Path,
    generated: Path,
    cases: Whole = 6,
    generated_runs: Whole = 3,
    scale: str = "medium",
    mould: str | None = None,
    gyrations: Whole | None = None,
    rate_factor: float | None = None,
    stiffness_factor: float | None = None,
    seed: Whole = 0,
    options: Options | None = None,
) -> int:
    """Compact specimens of scanned and of generated stones alike, and compare them: section 6 of the paper.

    In each case there is one specimen of scanned stones and several of generated ones, each of other stones. OUT gets
    a folder a run, runs.csv, Fig. 12 and 13 and Table 6 beside the paper's, and report.html with the verdict: the
    difference between the sources against that between seeds, and a test of equivalence.

    Interrupted, the same command with --resume goes on.

    **Example:** `lithoform experiment sgc out --scanned scans --generated stones --cases 3 --generated-runs 2`

    Parameters
    ----------
    out
        Folder for the results.
    scanned
        Database of scanned stones.
    generated
        Database of generated stones.
    cases
        Of the paper: 6.
    generated_runs
        Specimens of generated stones in each case; of the paper: 3.
    scale
        small (stones from 9.5 mm in a mould of 70 mm, 5 gyrations), medium (4.75 mm, 81 mm, 33) or paper (2.36 mm,
        150 mm, 33).
    mould
        Diameter, such as 80mm, in place of that of the scale; all specimens fill it alike.
    gyrations
        At most, in place of those of the scale.
    rate_factor
        On 30 gyrations a minute [default: 40; at the paper's scale 20].
    stiffness_factor
        On Young's modulus of the paper's Table 10 [default: 0.2].
    seed
        Each run has one of its own, made of this one.
    """
    from lithoform.compaction.experiment import MEASURES, Experiment, compare_sources, run_experiment
    from lithoform.experiment_report import experiment_files, summary
    from lithoform.gradation.quantities import parse_length

    began, options = time.perf_counter(), options or Options()
    given = {
        "mould": None if mould is None else parse_length(mould),
        "gyrations": gyrations,
        "rate_factor": rate_factor,
        "stiffness_factor": stiffness_factor,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    plan = Experiment(scanned=scanned, generated=generated, cases=cases, generated_runs=generated_runs, scale=scale,
                      seed=seed, changes=changes)  # fmt: skip
    rows = _carried_out(run_experiment, plan, out, options)
    if rows is None:
        return 130
    files = experiment_files(plan, rows)
    _write(out, files)
    found = compare_sources(rows) if cases > 1 else []
    if options.json_:
        verdicts = [{**asdict(row), "verdict": row.verdict} for row in found]
        told_all = {"out": str(out), "files": list(files), "runs": summary(rows), "verdicts": verdicts}
        say(json.dumps(_finite(told_all), indent=2, allow_nan=False))
        return 0
    for row in found:
        if not (row.scanned and row.generated):
            say(f"{MEASURES[row.name]:<36} not fitted: at least three gyrations are needed")
            continue
        say(f"{MEASURES[row.name]:<36} scanned {sum(row.scanned) / len(row.scanned):.4f}, generated less scanned "
            f"{row.difference:+.4f} ({row.interval[0]:+.4f} to {row.interval[1]:+.4f}), margin {row.margin:g}: "
            f"{row.verdict}")  # fmt: skip
    say(f"\n{out}: {', '.join(files)}; {time.perf_counter() - began:.1f} s")
    return 0


@experiment.command
def scales(
    out: Path,
    /,
    *,
    population: Path,
    rate_factors: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    stiffness_factors: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    seeds: Whole = 3,
    seed: Whole = 0,
    count: Whole = 60,
    gyrations: Whole = 5,
    min_size: str = "9.5mm",
    gradation: str = "AC-13",
    options: Options | None = None,
) -> int:
    """Measure what a faster mould and softer stones change, and which settings are safe.

    The same specimens are compacted at several rates and stiffnesses; packing density and height are extrapolated to
    30 gyrations a minute and 55 GPa over the inertial number and the overlap. OUT gets a folder a run, scales.csv,
    scales.png and report.html.

    Interrupted, the same command with --resume goes on.

    **Example:** `lithoform experiment scales out --population stones`

    Parameters
    ----------
    out
        Folder for the results.
    population
        A database.
    rate_factors
        On 30 gyrations a minute [default: 40, 10, 20, 80]; all but the first with the first stiffness.
    stiffness_factors
        On 55 GPa [default: 0.1, 0.3, 1]; all but the first with the first rate.
    seeds
        Specimens, each with all settings.
    seed
        Each specimen has one of its own, made of this one.
    count
        Stones of a specimen.
    gyrations
        Of each run.
    min_size
        Least sieve size.
    gradation
        Name, such as AC-13, or a file.
    """
    from lithoform.compaction.study import MEASURES, Study, run_study
    from lithoform.gradation.quantities import parse_length
    from lithoform.study_report import findings, study_files

    began, options = time.perf_counter(), options or Options()
    lists = {"rate_factors": _numbers("rate-factors", rate_factors),
             "stiffness_factors": _numbers("stiffness-factors", stiffness_factors)}  # fmt: skip
    study = Study(population=population, seeds=seeds, seed=seed, count=count, gyrations=gyrations,
                  min_size=parse_length(min_size), gradation=gradation,
                  **{name: values for name, values in lists.items() if values is not None})  # fmt: skip
    rows = _carried_out(run_study, study, out, options)
    if rows is None:
        return 130
    files, found = study_files(study, rows), findings(study, rows)
    _write(out, files)
    if options.json_:
        say(json.dumps({"out": str(out), "files": list(files), "runs": rows, "measures": found}, indent=2))
        return 0
    for row in found:
        say(f"{MEASURES[row['measure']]}: {row['limit']:.4f} +- {row['limit_error']:.4f} at no rate and no overlap")
        for s in row["settings"]:
            low, high = s["interval"]
            say(f"  rate x {s['rate_factor']:<4g} E x {s['stiffness_factor']:<5g} {s['change']:+.4f} ({low:+.4f} to "
                f"{high:+.4f}) against 30 a minute and 55 GPa: {s['verdict']}; by the rate alone "
                f"{s['rate_alone']['change']:+.4f}: {s['rate_alone']['verdict']}")  # fmt: skip
    say(f"\n{out}: {', '.join(files)}; {time.perf_counter() - began:.1f} s")
    return 0


def _carried_out(
    run: Callable[..., list[dict[str, Any]]], plan: Any, out: Path, options: Options
) -> list[dict[str, Any]] | None:
    """Rows of a plan, with a line for each run that is done; None where it was interrupted, which is told."""
    from lithoform.warp_runtime import resolve_device

    resolve_device(options.device)

    def told(line: str) -> None:
        if not options.json_:
            say(line)

    try:
        return run(plan, out, device=options.device, workers=options.workers, scheduler=options.scheduler,
                   resume=options.resume, progress=True, told=told)  # fmt: skip
    except KeyboardInterrupt:
        print(f"lithoform: interrupted; the same command with --resume goes on with {out}.", file=sys.stderr)
        return None


def _write(out: Path, files: dict[str, bytes]) -> None:
    from lithoform.atomic import atomic_write

    for name, content in files.items():
        atomic_write(out / name, content)


def _finite(value: Any) -> Any:
    """Plain values with None for numbers that are none, which JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _numbers(option: str, given: list[str] | None) -> tuple[float, ...] | None:
    """Numbers separated by commas or spaces; None where the option is not given."""
    if given is None:
        return None
    from lithoform.errors import RecipeError

    try:
        return tuple(float(word) for word in words(given))
    except ValueError as error:
        raise RecipeError(
            f"expected numbers for --{option}, such as 40,20,10; got {' '.join(given or [])!r}."
        ) from error
