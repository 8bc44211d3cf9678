"""`lithoform design`: settings for a target, and libraries of designs."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import can_draw, say, say_table
from lithoform.errors import OutputError, RecipeError

if TYPE_CHECKING:
    from lithoform.inverse.design import Design
    from lithoform.inverse.library import DesignLibrary

__all__ = ["design"]

design = App(name="design", help_format="markdown")
library = App(name="library", help="Design libraries.")
design.command(library)

_ROUTES = ("search", "paper")


@design.default
def make(
    *,
    target: str,
    out: Path,
    tolerance: str | None = None,
    weights: str | None = None,
    class_: Annotated[str | None, Parameter(name="--class")] = None,
    route: str = "search",
    refine: bool = True,
    seeds: Whole = 3,
    fresh: Whole = 10,
    seed: Whole = 0,
    library: Path | None = None,
    triangles: Whole | None = None,
    overwrite: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Find a setting whose stones have given descriptors, and make some of them.

    The setting is looked for in the library that comes with the program, then with stones that are made and measured.
    It is judged on stones of seeds that the search has not seen. Writes these stones (STL with a JSON sidecar each),
    recipe.toml, candidates.csv, design.json and design.png.

    **Example:** `lithoform design --target roundness=0.30,boxiness=0.42,solidity=0.90,true_sphericity=0.80 --out slate`

    **Example:** `lithoform design --target R=0.35,TS=0.7 --class plate --out plates` leaves the others free.

    Parameters
    ----------
    target
        NAME=VALUE with commas between: roundness (R), boxiness (B), solidity (S3D), true_sphericity (TS), or some.
    out
        Folder for the results.
    tolerance
        What counts as met: one number, or NAME=VALUE with commas between [default: 0.02].
    weights
        Weights in the mismatch: one number, or NAME=VALUE with commas between [default: 1].
    class_
        cube, plate, column or blade: bounds W / L and H / W; free without it.
    route
        search, or paper: the paper's additive model and Latin hypercube, at the dimensions of its benchmark.
    refine
        Search with stones that are made, after the library; --no-refine answers at once.
    seeds
        Stones that are written.
    fresh
        Stones on which the setting is judged, those written among them.
    seed
        Of the search and of the stones: the same seed gives the same files.
    library
        A library that lithoform design library build has made [default: the one that comes with the program].
    triangles
        Of every stone [default: the library's].
    overwrite
        Replace the design that OUT holds.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.inverse.design import as_dict
    from lithoform.inverse.targets import parse_target
    from lithoform.inverse.writing import PICTURE_FILE, prepare_folder, write_design
    from lithoform.locking import folder_lock
    from lithoform.parameters import suggest
    from lithoform.seeds import MAX_SEED

    started = time.perf_counter()
    wanted = parse_target(target, tolerance, weights)
    if route not in _ROUTES:
        raise RecipeError(
            f"expected --route to be one of {', '.join(_ROUTES)}; got {route!r}.{suggest(route, _ROUTES)}"
        )
    if route == "paper" and (class_ or library):
        raise RecipeError("the paper's route keeps the dimensions of its benchmark and takes no library; leave out "
                          "--class and --library.")  # fmt: skip
    if not 0 <= seed <= MAX_SEED:
        raise RecipeError(f"the seed must be 0 to {MAX_SEED}; got {seed}.")
    if not 1 <= seeds <= 1000 or not 2 <= fresh <= 10_000:
        raise RecipeError(f"expected 1 to 1000 --seeds and 2 to 10000 --fresh; got {seeds} and {fresh}.")
    from lithoform.atomic import make_folder

    make_folder(out)
    with folder_lock(out):
        prepare_folder(out, overwrite=overwrite, remove=False)
        found = _found(route, wanted, library, triangles, class_, seed, max(fresh, seeds), refine)
        draws = can_draw()
        prepare_folder(out, overwrite=overwrite, remove=True)
        meshes = write_design(found, out, stones=seeds, picture=draws)
        if draws:
            _draw(found, meshes, out / PICTURE_FILE)
    seconds = time.perf_counter() - started
    if json_:
        say(json.dumps({"out": str(out), "seconds": round(seconds, 3), **as_dict(found)}, indent=2))
        return 0
    _tell(found)
    say(f"\n{out}: {len(meshes)} stones of fresh seeds, recipe.toml, candidates.csv, design.json"
        f"{', design.png' if draws else ''}; {seconds:.1f} s")  # fmt: skip
    return 0


@library.command
def build(
    folder: Path,
    /,
    *,
    out: Path,
    count: Whole | None = None,
    seed: Whole = 0,
    triangles: Whole = 20_000,
    workers: Whole | None = None,
    scheduler: str | None = None,
    device: str = "auto",
    overwrite: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Make a design library: stones all over the design space, generated and measured.

    Stopped at any moment, the same command finishes the work.

    **Example:** `lithoform design library build stones --count 50000 --out large.parquet`

    Parameters
    ----------
    folder
        The database of the stones: a new folder, an empty one, or an unfinished one of the same library.
    out
        File of the library, for --library.
    count
        Stones [default: 12288, as in the library that comes with the program].
    seed
        Of the design and of the stones.
    triangles
        Of every stone.
    workers
        Local processes [default: the processors at hand]; 0 works in threads of this process.
    scheduler
        Address of a running Dask scheduler, whose workers do the work.
    device
        auto, cpu or cuda.
    overwrite
        Replace OUT even if it is no design library.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.atomic import atomic_path
    from lithoform.database.building import Measures
    from lithoform.database.building import build as run
    from lithoform.inverse.building import LIBRARY_COUNT, LIBRARY_SOURCE, LibraryPlan
    from lithoform.inverse.library import condense, read_library, write_library
    from lithoform.progress import track
    from lithoform.warp_runtime import resolve_device

    started = time.perf_counter()
    resolve_device(device)
    plan = LibraryPlan(LIBRARY_COUNT if count is None else count, seed, triangles)
    plan.validate()
    if out.resolve().is_relative_to(folder.resolve()):
        raise OutputError(f"the library would lie in its database {folder}, which keeps no other files; name another "
                          "place for --out.")  # fmt: skip
    if out.exists() and not overwrite:
        read_library(out)  # of another file than a library an error, so that nothing else is replaced
    numbers: Iterator[int] = run(
        folder, plan, Measures(("four",)), source=LIBRARY_SOURCE, is_named=False, workers=workers, scheduler=scheduler,
        device=device,
    )  # fmt: skip
    done = 0
    try:
        # What cannot be written is refused before the work.
        with atomic_path(out) as probe:
            probe.write_bytes(b"")
            for _ in track(numbers, total=plan.count, what="stones"):
                done += 1
            made = condense(folder)
            write_library(made, probe)
    except KeyboardInterrupt:
        print(f"lithoform: interrupted; {folder} holds {done} of {plan.count} stones: the same command goes on.",
              file=sys.stderr)  # fmt: skip
        return 130
    told = {"library": str(out), "database": str(folder), "stones": len(made), **_plain(made)}
    if json_:
        say(json.dumps({**told, "seconds": round(time.perf_counter() - started, 3)}))
    else:
        left = made.about["left_out"]
        lost = f", {left} left out (no sound mesh)" if left else ""
        say(f"{out}: {len(made)} stones over {len(made.axes)} axes{lost}; {time.perf_counter() - started:.1f} s")
    return 0


def _plain(made: DesignLibrary) -> dict[str, Any]:
    return {"left_out": made.about["left_out"], "axes": [axis.name for axis in made.axes]}


def _found(
    route: str, wanted: Any, path: Path | None, triangles: int | None, class_: str | None, seed: int, fresh: int,
    refine: bool,
) -> Design:  # fmt: skip
    from lithoform.inverse.design import by_search, by_the_papers_route, evaluator
    from lithoform.inverse.library import read_library, shipped_library
    from lithoform.parameters import Recipe

    evaluate = evaluator(progress=True)
    if route == "paper":
        base = Recipe().replace(size=(0.020, 0.015, 0.010), triangles=20_000 if triangles is None else triangles)
        return by_the_papers_route(wanted, base=base, seed=seed, fresh=fresh, evaluate=evaluate)
    known = shipped_library() if path is None else read_library(path)
    if triangles is not None:
        known = known.at_triangles(triangles)
    shown = sys.stderr.isatty()
    return by_search(
        wanted, known, shape_class=class_, seed=seed, refine=refine, fresh=fresh, evaluate=evaluate,
        told=lambda line: print(f"{line} ...", file=sys.stderr) if shown else None,
    )  # fmt: skip


def _draw(found: Design, meshes: list[Any], path: Path) -> None:
    import numpy as np

    from lithoform.atomic import atomic_write
    from lithoform.figures.design import ClosedLoop, design_figure
    from lithoform.figures.gallery import png_bytes

    asked = np.where(found.target.asked, found.target.values, np.nan)
    loop = ClosedLoop("target and stones", asked, np.array(found.target.tolerance), found.predicted.mean,
                      found.achieved, meshes)  # fmt: skip
    atomic_write(path, png_bytes(design_figure(loop), colours=256))


def _tell(found: Design) -> None:
    from lithoform.descriptors.table import FOUR

    rows = [["", "target", "tolerance", "predicted", "achieved", "scatter", "error"]]
    columns = zip(FOUR, found.target.values, found.target.tolerance, found.target.asked, found.predicted.mean,
                  found.mean, found.scatter, strict=True)  # fmt: skip
    for name, value, tolerance, asked, predicted, mean, scatter in columns:
        wanted = [f"{value:.3f}", f"{tolerance:.3f}"] if asked else ["-", "-"]
        error = f"{mean - value:+.4f}" if asked else "-"
        rows.append([name, *wanted, f"{predicted:.4f}", f"{mean:.4f}", f"{scatter:.4f}", error])
    say_table(rows)
    say(f"\nachieved: mean of {found.measured.sum()} stones of fresh seeds; scatter: from seed to seed. "
        f"{found.stones} stones were made for the search.")  # fmt: skip
    say(found.verdict)
