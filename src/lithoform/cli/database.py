"""`lithoform database`: build, import and query."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from lithoform.cli.arguments import Flag, Json, Whole, words
from lithoform.cli.database_contents import export, grade, show
from lithoform.cli.output import opened, say, say_table
from lithoform.errors import RecipeError

__all__ = ["database"]

database = App(name="database", help="Databases of particles: build, import, show, query, export, grade.")

for _command in (show, export, grade):
    database.command(_command)

_SHOWN = 40
_DEFAULT_COUNT = 600


@database.command
def build(
    folder: Path,
    /,
    *,
    per_class: Whole | None = None,
    count: Whole | None = None,
    class_: Annotated[str | None, Parameter(name="--class")] = None,
    seed: Whole | None = None,
    preset: str | None = None,
    recipe: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", negative="")] = None,
    size: str | None = None,
    unit: str | None = None,
    triangles: Whole | None = None,
    descriptors: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    box: str = "principal",
    scale: float = 0.25,
    keep_meshes: Flag = False,
    source: str = "generated",
    workers: Whole | None = None,
    scheduler: str | None = None,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Generate, check, measure and store particles: a row a particle, in Parquet files that any tool opens.

    Stopped at any moment, the same command finishes the work; the rows are those of a run that was not stopped.

    **Example:** `lithoform database build stones --per-class 150`

    **Example:** `lithoform database build stones --per-class 150 --scheduler tcp://node:8786`

    Parameters
    ----------
    folder
        The database: a new folder, an empty one, or a database that gets a further source.
    per_class
        Particles in each Zingg class [default: 150, unless --count or --class is given].
    count
        Particles in all; the classes take turns unless --class names one [default, of a population recipe: 600].
    class_
        Zingg class in which the dimensions are drawn: cube, plate, column, blade, or mixed (the four in turn).
    seed
        Run seed, 0 to 2^64 - 1 [default: 0].
    preset
        benchmark (Table 1 of the paper) or database (its setting for scanned stones) [default: database].
    recipe
        TOML recipe, or a population recipe as `lithoform match` writes it, which draws texture and dimensions.
    set_
        NAME=VALUE: a parameter by its symbol in Table 1 or by its full name; may be repeated.
    size
        L,W,H in the unit of --unit, from the largest to the smallest, for all particles.
    unit
        Unit of the lengths given: m, cm, mm, um or in [default: mm].
    triangles
        Number of triangles, 8 n^2 or 20 n^2 [default: 20000].
    descriptors
        What is measured: names, or four, standard or all [default: standard].
    box
        Box of boxiness and of length, width and thickness: principal, solid, vertices or minimum.
    scale
        Scale of the roundness, times the radius of the inscribed sphere.
    keep_meshes
        Store the meshes too; without it they are made again from their recipes when asked for.
    source
        Name of these particles in the database.
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
    from lithoform.database.building import build as run
    from lithoform.planning import plan_run
    from lithoform.population_recipe import is_population
    from lithoform.presets import SHAPE_CLASSES
    from lithoform.recipe_io import read_table
    from lithoform.warp_runtime import resolve_device

    given = [name for name, value in (("count", count), ("class", class_), ("size", size)) if value is not None]
    if per_class is not None and given:
        raise RecipeError(f"--per-class draws that many in each class; it goes without --{given[0]}.")
    if per_class is not None or not (given or recipe):
        each = 150 if per_class is None else per_class
        if each < 1:
            raise RecipeError(f"expected --per-class of at least 1; got {each}.")
        count, class_ = each * len(SHAPE_CLASSES), "mixed"
    resolve_device(device)
    of_population = recipe is not None and is_population(*read_table(recipe))
    if of_population and per_class is not None:
        raise RecipeError("a population recipe draws the dimensions itself; give --count in place of --per-class.")
    plan = plan_run(
        count=_DEFAULT_COUNT if of_population and count is None else count, seed=0 if seed is None else seed,
        shape_class=class_, preset=preset, recipe=recipe,
        settings=set_ or [], size=size, unit=unit, triangles=triangles, format=None,
    )  # fmt: skip
    measures = _measures(descriptors, box, scale, keep_meshes=keep_meshes)
    numbers = run(folder, plan, measures, source=source, workers=workers, scheduler=scheduler, device=device)
    return _carry_out(folder, source, numbers, plan.count, as_json=json_)


@database.command(name="import")
def import_(
    folder: Path,
    /,
    *scans: Annotated[Path, Parameter(negative="")],
    source: str,
    unit: str = "mm",
    triangles: Whole = 20_000,
    descriptors: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    box: str = "principal",
    scale: float = 0.25,
    keep_meshes: bool = True,
    workers: Whole | None = None,
    scheduler: str | None = None,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Read, repair and measure scans, and store them beside generated particles.

    Scans and NIST coefficient files are measured by the code that measures generated particles. One that cannot be read
    has a row with the reason; `lithoform database show` tells how many.

    **Example:** `lithoform database import stones scans --unit mm --source quarry`

    Parameters
    ----------
    folder
        The database: a new folder, an empty one, or a database that gets a further source.
    scans
        Mesh files (stl, ply, obj, off, gltf, glb, 3mf, vtp), NIST spherical-harmonic files (anm .dat), or folders.
    source
        Name of these particles in the database.
    unit
        Unit of files that do not tell theirs: m, cm, mm, um or in.
    triangles
        About how many triangles the meshes made from spherical harmonics have.
    descriptors
        What is measured: names, or four, standard or all [default: standard].
    box
        Box of boxiness and of length, width and thickness: principal, solid, vertices or minimum.
    scale
        Scale of the roundness, times the radius of the inscribed sphere.
    keep_meshes
        Store the repaired meshes too, since no recipe makes them again.
    workers
        Local processes [default: the processors at hand]; 0 works in threads of this process.
    scheduler
        Address of a running Dask scheduler, whose workers must see the files.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.database.importing import import_scans
    from lithoform.errors import FileFormatError
    from lithoform.scans.reading import find_scans

    if not scans:
        raise FileFormatError("expected at least one file or folder of scans after the database's own folder.")
    measures = _measures(descriptors, box, scale, keep_meshes=keep_meshes)
    files = find_scans(scans)
    numbers = import_scans(
        folder, files, measures, source=source, unit=unit, triangles=triangles, workers=workers, scheduler=scheduler
    )
    return _carry_out(folder, source, numbers, len(files), as_json=json_)


@database.command
def query(
    folder: Path,
    sql: str,
    /,
    *,
    csv: Path | None = None,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Answer a question in SQL about the table `particles`, which has a row a particle, lengths in metres.

    **Example:** `lithoform database query stones "select class, avg(roundness) from particles group by class"`

    **Example:** `lithoform database query stones "describe particles"` lists the columns.

    Parameters
    ----------
    folder
        A database.
    sql
        One SELECT in DuckDB's SQL; it reads this database and nothing else.
    csv
        Write the whole answer to this file.
    json_
        Print a list of JSON objects instead of a table.
    debug
        Show the traceback of an error.
    """
    from lithoform.database.queries import stream, write_csv
    from lithoform.database.store import Store

    store = Store(folder)
    if csv is not None:
        store.refuse_inside(csv)
    with opened(csv) as partial, stream(store, sql) as (schema, batches):
        if partial is not None:
            with partial.open("w", encoding="utf-8", newline="") as sink:
                count = write_csv(schema, batches, sink)
            told = f"{count} rows: {csv}"
        elif json_:
            told = json.dumps([row for batch in batches for row in batch.to_pylist()], indent=2, default=str)
        else:
            shown, count = [], 0
            for batch in batches:
                shown += batch.slice(0, max(_SHOWN - len(shown), 0)).to_pylist()
                count += batch.num_rows
            say_table([schema.names, *([_cell(row[name]) for name in schema.names] for row in shown)])
            told = f"... and {count - _SHOWN} more rows; --csv writes them all." if count > _SHOWN else ""
    if told:
        say(told)
    return 0


def _measures(descriptors: list[str] | None, box: str, scale: float, *, keep_meshes: bool) -> Any:
    from lithoform.database.building import Measures

    names = ("standard",) if descriptors is None else tuple(words(descriptors))
    return Measures(names, box, scale, keep_meshes).resolved()  # type: ignore[arg-type]


def _carry_out(folder: Path, source: str, numbers: Iterator[int], total: int, *, as_json: bool) -> int:
    from lithoform.database.store import Store
    from lithoform.progress import track

    started, done = time.perf_counter(), 0
    try:
        for _ in track(numbers, total=total, what="particles"):
            done += 1
    except KeyboardInterrupt:
        print(
            f"lithoform: interrupted; {folder} holds {done} of {total} particles: the same command goes on.",
            file=sys.stderr,
        )
        return 130
    seconds = time.perf_counter() - started
    errors = Store(folder).table(["error"], sources=[source])["error"].drop_null().to_pylist()
    if as_json:
        told = {"database": str(folder), "source": source, "particles": total, "failed": len(errors)}
        say(json.dumps({**told, "seconds": round(seconds, 3)}))
        return 0
    say(f"{folder}: {total} particles of source {source}, {seconds:.1f} s")
    if errors:
        print(f"{len(errors)} of them failed, the first because: {errors[0]}", file=sys.stderr)
    return 0


def _cell(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float) else "" if value is None else str(value)
