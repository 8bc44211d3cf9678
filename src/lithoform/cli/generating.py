"""`lithoform generate`."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say
from lithoform.errors import OutputError


def generate(
    out: Path = Path("particles"),
    *,
    count: Whole | None = None,
    seed: Whole | None = None,
    class_: Annotated[str | None, Parameter(name="--class")] = None,
    preset: str | None = None,
    recipe: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", negative="")] = None,
    size: str | None = None,
    unit: str | None = None,
    triangles: Whole | None = None,
    format: str | None = None,
    device: str = "auto",
    picture: Flag = False,
    overwrite: Flag = False,
    resume: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Generate particles: a mesh and a JSON sidecar each, and a table of all.

    Writes OUT/000001.stl, OUT/000001.json, ... and OUT/particles.parquet; with --picture also OUT/gallery.png.

    **Example:** `lithoform generate stones --count 12 --class mixed --seed 1 --picture`

    **Example:** `lithoform generate slabs --count 5 --size 40,30,10 --set k=0.2 --set s=1.8 --format ply`

    **Example:** `lithoform generate again --recipe stones/000001.json` makes the same bytes again.

    Parameters
    ----------
    out
        Folder for the results; made if it does not exist.
    count
        Number of particles [default: 1].
    seed
        Run seed, 0 to 2^64 - 1; each particle has its own seed derived from it and its number [default:
        0, or the recipe's own].
    class_
        Zingg class in which the dimensions are drawn: cube, plate, column, blade, or mixed (the four in turn).
    preset
        benchmark (Table 1 of the paper) or database (its setting for scanned stones) [default: database].
    recipe
        TOML recipe, population recipe (see `lithoform match`), or the sidecar of a particle; without --seed and
        --count its very particle is made again.
    set_
        NAME=VALUE: a parameter by its symbol in Table 1 (k, s, s_w, eta, delta, O, lambda, g, alpha, beta,
        gamma, kappa, A_L, f_L, a, p0, rho, L, W, H) or by its full name; may be repeated.
    size
        L,W,H in the unit of --unit, from the largest to the smallest.
    unit
        Unit of lengths given and of the files: m, cm, mm, um or in [default: mm]. (glb files are in metres.)
    triangles
        Number of triangles, 8 n^2 or 20 n^2 [default: 20000].
    format
        stl, ply, obj, glb or 3mf [default: stl].
    device
        auto, cpu or cuda.
    picture
        Draw OUT/gallery.png as well.
    overwrite
        Replace the run that OUT holds.
    resume
        Finish an interrupted run: the same command with this added.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform import production
    from lithoform.planning import plan_run
    from lithoform.progress import track
    from lithoform.run_report import draw_gallery, run_report
    from lithoform.warp_runtime import resolve_device

    started = time.perf_counter()
    if overwrite and resume:
        raise OutputError("--overwrite starts anew and --resume goes on; give one of them.")
    plan = plan_run(
        count=count, seed=seed, shape_class=class_, preset=preset, recipe=recipe, settings=set_ or [],
        size=size, unit=unit, triangles=triangles, format=format,
    )  # fmt: skip
    # What can be refused is refused before OUT is touched.
    resolve_device(device)
    if picture:
        from lithoform.rendering import require_pictures

        require_pictures()
    with production.open_run(out, plan, overwrite=overwrite, resume=resume):
        numbers = production.unfinished(out, plan) if resume else range(1, plan.count + 1)
        done = 0
        try:
            for _ in track(production.produce(out, plan, numbers, device=device), total=len(numbers), what="particles"):
                done += 1
        except KeyboardInterrupt:
            # Work in flight was finished after the last count.
            already = plan.count - len(numbers) + done
            print(
                f"lithoform: interrupted with at least {already} of {plan.count} particles; add --resume to finish it.",
                file=sys.stderr,
            )
            return 130
        relaxed = production.write_table(out, plan)
        drawn = draw_gallery(out, plan) if picture else None
    seconds = time.perf_counter() - started
    say(run_report(out, plan, drawn=drawn, done=done, relaxed=relaxed, seconds=seconds, as_json=json_))
    return 0
