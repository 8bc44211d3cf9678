"""`lithoform sensitivity`: how the descriptors depend on the parameters."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from cyclopts import App

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say, say_table

__all__ = ["sensitivity"]

sensitivity = App(name="sensitivity", help="How the descriptors depend on the parameters: oat, morris, sobol.")

_TRIANGLES: Final = 20_000


@sensitivity.command
def oat(
    out: Path,
    /,
    *,
    seeds: Whole | None = None,
    points: Whole | None = None,
    triangles: Whole | None = None,
    seed: Whole | None = None,
    workers: Whole | None = None,
    scheduler: str | None = None,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Vary the 15 parameters of Table 7 one at a time, the others at the benchmark (Fig. 6 of the paper).

    OUT becomes a database of the stones, source oat, and takes oat.png (the curves), oat.csv (their numbers) and
    oat_trends.csv (what the paper says of them, held or not held). Stopped at any moment, the same command finishes
    the work; once it is finished, it only makes these files anew.

    **Example:** `lithoform sensitivity oat sweep --seeds 30`

    Parameters
    ----------
    out
        A new folder, an empty one, or a database.
    seeds
        Stones at each point, the same seeds at all [default: 30, or as begun].
    points
        Points on each parameter [default: 11, or as begun].
    triangles
        Number of triangles, 8 n^2 or 20 n^2 [default: 20000, or as begun].
    seed
        Run seed from which those of the stones are derived [default: 0, or as begun].
    workers
        Local processes [default: the processors at hand]; 0 works in threads of this process.
    scheduler
        Address of a running Dask scheduler, whose workers do the work.
    device
        auto, cpu or cuda.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.axes import TABLE_7
    from lithoform.descriptors.table import FOUR
    from lithoform.presets import benchmark_recipe
    from lithoform.reproduce.sensitivity import curves_picture
    from lithoform.sensitivity.designs import OneAtATime
    from lithoform.sensitivity.oat import sweep_of
    from lithoform.sensitivity.trends import trends, trends_to_csv

    asked = _settled(out, "oat", {"seeds": seeds, "points": points, "triangles": triangles, "seed": seed},
                     {"seeds": 30, "points": 11, "triangles": _TRIANGLES, "seed": 0})  # fmt: skip
    base = benchmark_recipe(triangles=asked["triangles"])
    design = OneAtATime(axes=TABLE_7, points=asked["points"], base=base, seeds=asked["seeds"], seed=asked["seed"])
    made = _carry_out(out, "oat", design, workers, scheduler, device)
    if made is None:
        return 130
    responses, told = made
    sweep = sweep_of(design, responses)
    curves, found = sweep.curves, trends(sweep)
    told |= _written(out, {"oat.png": curves_picture(curves, design.seeds, base.triangles), "oat.csv": curves.to_csv(),
                           "oat_trends.csv": trends_to_csv(found)})  # fmt: skip
    held = sum(trend.held for trend in found)
    if json_:
        effects = {axis.name: _by_name(FOUR, row) for axis, row in zip(curves.axes, curves.ranges, strict=True)}
        baseline = _by_name(FOUR, curves.baseline)
        claims = [
            {"parameter": t.claim.parameter, "descriptor": t.claim.descriptor, "claim": t.claim.text, "held": t.held,
             "found": t.found, "correlation": t.tendency and t.tendency.correlation, "p": t.tendency and t.tendency.p}
            for t in found
        ]  # fmt: skip
        say(_json({**told, "baseline": baseline, "ranges": effects, "held": held, "trends": claims}))
        return 0
    say("Range of the mean of each descriptor over each parameter:\n")
    rows = [[axis.name, *(f"{x:.3f}" for x in row)] for axis, row in zip(curves.axes, curves.ranges, strict=True)]
    say_table([["", *FOUR], *rows])
    say("\nWhat section 4 of the paper says, and whether it holds:\n")
    _say_left([[t.claim.parameter, t.claim.descriptor, t.claim.text, "held" if t.held else "NOT HELD", t.found] for t in
               found])  # fmt: skip
    say(f"\n{held} of {len(found)} claims held.")
    _say_end(told)
    return 0


@sensitivity.command
def morris(
    out: Path,
    /,
    *,
    trajectories: Whole | None = None,
    levels: Whole | None = None,
    seeds: Whole | None = None,
    triangles: Whole | None = None,
    seed: Whole | None = None,
    workers: Whole | None = None,
    scheduler: str | None = None,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Screen 19 inputs after Morris: the 15 parameters, the twist, the smoothing and the dimensions.

    OUT becomes a database of the stones, source morris, and takes morris.png and morris.csv. It may hold the other
    designs too. Stopped at any moment, the same command finishes the work.

    **Example:** `lithoform sensitivity morris screening --triangles 5000`

    Parameters
    ----------
    out
        A new folder, an empty one, or a database.
    trajectories
        Trajectories, each of 20 points [default: 40, or as begun].
    levels
        Levels of the grid, even [default: 4, or as begun].
    seeds
        Stones at each point, which are averaged [default: 2, or as begun].
    triangles
        Number of triangles, 8 n^2 or 20 n^2 [default: 20000, or as begun].
    seed
        Run seed of the trajectories and of the stones [default: 0, or as begun].
    workers
        Local processes [default: the processors at hand]; 0 works in threads of this process.
    scheduler
        Address of a running Dask scheduler, whose workers do the work.
    device
        auto, cpu or cuda.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.descriptors.table import FOUR
    from lithoform.figures.gallery import png_bytes
    from lithoform.figures.sensitivity import screening_figure
    from lithoform.presets import benchmark_recipe
    from lithoform.sensitivity.designs import axes_for, morris_trajectories
    from lithoform.sensitivity.screening import screen, screening_to_csv

    given = {"trajectories": trajectories, "levels": levels, "seeds": seeds, "triangles": triangles, "seed": seed}
    asked = _settled(out, "morris", given, {"trajectories": 40, "levels": 4, "seeds": 2, "triangles": _TRIANGLES,
                                            "seed": 0})  # fmt: skip
    base = benchmark_recipe(triangles=asked.pop("triangles"))
    design = morris_trajectories(axes_for(base.triangles), base=base, **asked)
    made = _carry_out(out, "morris", design, workers, scheduler, device)
    if made is None:
        return 130
    responses, told = made
    found = screen(design, responses.means, FOUR)
    note = f"{found.trajectories} trajectories, {design.seeds} stones at each point, {base.triangles:,} triangles"
    picture = screening_figure(found.inputs, found.mu_star, found.mu_star_half, found.sigma,
                               title="Elementary effects over the whole range of each input", note=note)  # fmt: skip
    told |= _written(out, {"morris.png": png_bytes(picture), "morris.csv": screening_to_csv(found)})
    told |= {"trajectories": found.trajectories, "trajectories_left_out": found.left_out}
    parts = {
        "mu": found.mu,
        "mu_star": found.mu_star,
        "mu_star_half_interval": found.mu_star_half,
        "sigma": found.sigma,
    }
    if json_:
        say(_json({**told, "noise_shares": _by_name(FOUR, responses.noise_shares),
                   "effects": _by_input(found.inputs, parts)}))  # fmt: skip
        return 0
    say("Mean absolute effect mu* of each input over its whole range, and the standard deviation of the effects:\n")
    cells = [[f"{x:.3f} / {y:.3f}" for x, y in zip(*pair, strict=True)] for pair in
             zip(found.mu_star, found.sigma, strict=True)]  # fmt: skip
    _say_inputs(found.inputs, cells)
    if found.left_out:
        say(f"\n{found.left_out} trajectories with a stone that could not be made are left out.")
    _say_noise(responses.noise_shares)
    _say_end(told)
    return 0


@sensitivity.command
def sobol(
    out: Path,
    /,
    *,
    samples: Whole | None = None,
    seeds: Whole | None = None,
    triangles: Whole | None = None,
    seed: Whole | None = None,
    workers: Whole | None = None,
    scheduler: str | None = None,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Share the variance of the descriptors out among 19 inputs after Sobol: each alone, and with the others.

    The inputs are the 15 parameters, the twist, the smoothing and the dimensions. OUT becomes a database of the stones,
    source sobol, and takes sobol.png and sobol.csv. Stopped at any moment, the same command finishes the work.

    **Example:** `lithoform sensitivity sobol shares --samples 256 --triangles 5000`

    Parameters
    ----------
    out
        A new folder, an empty one, or a database.
    samples
        Rows of the sample, a power of two, each of 21 points [default: 128, or as begun].
    seeds
        Stones at each point, which are averaged [default: 2, or as begun].
    triangles
        Number of triangles, 8 n^2 or 20 n^2 [default: 20000, or as begun].
    seed
        Run seed of the sample and of the stones [default: 0, or as begun].
    workers
        Local processes [default: the processors at hand]; 0 works in threads of this process.
    scheduler
        Address of a running Dask scheduler, whose workers do the work.
    device
        auto, cpu or cuda.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.descriptors.table import FOUR
    from lithoform.figures.gallery import png_bytes
    from lithoform.figures.sensitivity import shares_figure
    from lithoform.presets import benchmark_recipe
    from lithoform.sensitivity.designs import axes_for, saltelli_sample
    from lithoform.sensitivity.variance import shares_to_csv, variance_shares

    given = {"samples": samples, "seeds": seeds, "triangles": triangles, "seed": seed}
    asked = _settled(out, "sobol", given, {"samples": 128, "seeds": 2, "triangles": _TRIANGLES, "seed": 0})
    base = benchmark_recipe(triangles=asked.pop("triangles"))
    design = saltelli_sample(axes_for(base.triangles), base=base, **asked)
    made = _carry_out(out, "sobol", design, workers, scheduler, device)
    if made is None:
        return 130
    responses, told = made
    found = variance_shares(design, responses.means, FOUR)
    first, total = (found.first, found.first_low, found.first_high), (found.total, found.total_low, found.total_high)
    note = f"{found.samples} samples, {design.seeds} stones at each point, {base.triangles:,} triangles"
    picture = shares_figure(found.inputs, first, total, title="Share of each input in the variance", note=note)
    told |= _written(out, {"sobol.png": png_bytes(picture), "sobol.csv": shares_to_csv(found)})
    told |= {"samples": found.samples, "samples_left_out": found.left_out}
    if json_:
        names = ("first", "first_low", "first_high", "total", "total_low", "total_high")
        parts: dict[str, Any] = dict(zip(names, (*first, *total), strict=True))
        say(_json({**told, "noise_shares": _by_name(FOUR, responses.noise_shares),
                   "shares": _by_input(found.inputs, parts)}))  # fmt: skip
        return 0
    say("Share of the variance that each input explains alone / in all, with half of the latter's 95 % interval:\n")
    half = 0.5 * (found.total_high - found.total_low)
    cells = [[f"{x:.2f} / {y:.2f} ± {z:.2f}" for x, y, z in zip(*row, strict=True)] for row in
             zip(found.first, found.total, half, strict=True)]  # fmt: skip
    _say_inputs(found.inputs, cells)
    if found.left_out:
        say(f"\n{found.left_out} rows of the sample with a stone that could not be made are left out.")
    _say_noise(responses.noise_shares)
    _say_end(told)
    return 0


def _settled(folder: Path, source: str, given: Mapping[str, int | None], defaults: Mapping[str, int]) -> dict[str, int]:
    """Options as given; else those with which the stones that are there were begun; else the defaults."""
    from lithoform.database.store import Store, is_store
    from lithoform.figures.populations import require_figures

    require_figures()
    begun: dict[str, Any] = {}
    if is_store(folder) and (entry := Store(folder).sources.get(source)) is not None:
        begun = {**entry.plan, **entry.plan.get("base", {}), "seed": entry.plan.get("seed")}
    chosen = {name: begun.get(name) if value is None else value for name, value in given.items()}
    return {name: defaults[name] if value is None else int(value) for name, value in chosen.items()}


def _carry_out(folder: Path, source: str, design: Any, workers: int | None, scheduler: str | None, device: str) -> Any:
    """Responses and what to tell of the work; None if it was interrupted."""
    from lithoform.database.building import Measures, build
    from lithoform.progress import track
    from lithoform.sensitivity.responses import read_responses
    from lithoform.warp_runtime import resolve_device

    resolve_device(device)
    started, done = time.perf_counter(), 0
    numbers = build(folder, design, Measures(("four",)), source=source, is_named=False, workers=workers,
                    scheduler=scheduler, device=device)  # fmt: skip
    try:
        for _ in track(numbers, total=design.count, what="stones"):
            done += 1
    except KeyboardInterrupt:
        print(f"lithoform: interrupted; {folder} holds {done} of {design.count} stones: the same command goes on.",
              file=sys.stderr)  # fmt: skip
        return None
    responses = read_responses(folder, source, design)
    told = {"database": str(folder), "source": source, "stones": design.count, "failed": len(responses.errors),
            "seconds": round(time.perf_counter() - started, 3)}  # fmt: skip
    if responses.errors:
        print(f"lithoform: {responses.left_out()}", file=sys.stderr)
    return responses, told


def _written(folder: Path, contents: Mapping[str, bytes]) -> dict[str, Any]:
    from lithoform.atomic import atomic_write

    for name, data in contents.items():
        atomic_write(folder / name, data)
    return {"files": [str(folder / name) for name in contents]}


def _by_name(names: Sequence[str], numbers: Any) -> dict[str, float | None]:
    return {name: None if math.isnan(x) else float(x) for name, x in zip(names, numbers, strict=True)}


def _by_input(inputs: Sequence[str], parts: Mapping[str, Any]) -> dict[str, Any]:
    from lithoform.descriptors.table import FOUR

    return {name: {what: _by_name(FOUR, array[i]) for what, array in parts.items()} for i, name in enumerate(inputs)}


def _json(told: Mapping[str, Any]) -> str:
    return json.dumps(told, indent=2, allow_nan=False)


def _say_inputs(inputs: Sequence[str], cells: Sequence[Sequence[str]]) -> None:
    from lithoform.descriptors.table import FOUR

    say_table([["", *FOUR], *([name, *row] for name, row in zip(inputs, cells, strict=True))])


def _say_noise(shares: Any) -> None:
    from lithoform.descriptors.table import FOUR

    if not all(math.isnan(x) for x in shares):
        told = ", ".join(f"{name} {x:.1%}" for name, x in zip(FOUR, shares, strict=True))
        say(f"\nOf the variance of the means, the scatter from seed to seed is: {told}.")


def _say_left(rows: Sequence[Sequence[str]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        say("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _say_end(told: Mapping[str, Any]) -> None:
    say(f"\n{told['stones']} stones, {told['seconds']:.1f} s: {', '.join(told['files'])}")
