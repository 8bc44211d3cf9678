"""`lithoform database show`, `export` and `grade`."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import one_line, opened, say, say_table
from lithoform.errors import FileFormatError, LithoformError, RecipeError

if TYPE_CHECKING:
    from lithoform.database.grading import Grading, Verification
    from lithoform.database.store import Store
    from lithoform.database.summary import Summary
    from lithoform.gradation.curves import Gradation

__all__ = ["export", "grade", "show"]

PICTURE_FILE = "contact-sheet.png"
_STONES_A_CLASS, _PICTURED_SOURCES = 8, 12


def show(
    folder: Path,
    /,
    *,
    picture: Path | None = None,
    no_picture: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Tell what a database holds: sources, classes, failures, what is missing, moments, size; and draw some stones.

    **Example:** `lithoform database show stones`

    Parameters
    ----------
    folder
        A database.
    picture
        PNG of some stones of each class, generated and scanned apart [default: contact-sheet.png in the database].
    no_picture
        Draw nothing.
    json_
        Print one JSON object, lengths in metres, instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.database.store import Store
    from lithoform.database.summary import describe, summarise

    if picture is not None and no_picture:
        raise RecipeError("--picture names a picture and --no-picture wants none; give one of them.")
    store = Store(folder)
    if picture is not None:
        store.refuse_inside(picture)
    found = summarise(store)
    drawn, reason = picture or folder / PICTURE_FILE, "it was not wanted." if no_picture else ""
    if not any(source.good for source in found.sources):
        reason = "the database has no particles yet."
    if not reason:
        try:
            _draw_stones(store, found, drawn)
        except LithoformError as error:
            # Not asked for by name, a picture that cannot be drawn is no reason to tell nothing.
            if picture is not None:
                raise
            reason = one_line(error)
    if json_:
        told = {"database": str(folder), **found.as_dict(), "picture": None if reason else str(drawn)}
        say(json.dumps(told, indent=2, ensure_ascii=False))
    else:
        say(describe(found))
        if not reason:
            say(f"picture: {drawn}")
    if reason and not no_picture:
        print(f"no picture: {reason}", file=sys.stderr)
    return 0


def _draw_stones(store: Store, found: Summary, target: Path) -> None:
    import pyarrow as pa

    from lithoform.database.meshes import MESH_COLUMNS, particle_meshes, stream_rows
    from lithoform.database.queries import rows_of
    from lithoform.database.summary import pick_examples
    from lithoform.figures.contact_sheet import ClassRow, Section, contact_sheet
    from lithoform.figures.gallery import png_bytes
    from lithoform.progress import track
    from lithoform.rendering import require_pictures

    require_pictures()
    with opened(target) as partial:
        pictured = [source for source in found.sources if source.good][:_PICTURED_SOURCES]
        names = {source.name for source in pictured}
        picked = [item for item in pick_examples(store, _STONES_A_CLASS) if item[0] in names]
        sources, _, numbers = zip(*picked, strict=True)
        rows = rows_of(store, [*MESH_COLUMNS, "volume"], pa.table({"source": sources, "number": numbers}))
        sizes = {(row["source"], row["number"]): row["volume"] for row in stream_rows(rows)}
        found_meshes = track(particle_meshes(store, stream_rows(rows)), total=len(sizes), what="stones")
        meshes = dict(zip(sizes, found_meshes, strict=True))
        sections = []
        for source in pictured:
            by_class: dict[str, list[tuple[str, Any]]] = {}
            for name, label, number in picked:
                if name == source.name:
                    diameter = 1e3 * math.cbrt(6.0 / math.pi * sizes[name, number])
                    caption = f"{number:06d}  {diameter:.3g} mm"
                    by_class.setdefault(label, []).append((caption, meshes[name, number]))
            heading = f"{source.name}: {source.good:,} {source.kind} particles"
            sections.append(Section(heading, [ClassRow(label, stones) for label, stones in by_class.items()]))
        title = store.folder.resolve().name
        if sum(source.good > 0 for source in found.sources) > len(pictured):
            title += f", the first {len(pictured)} sources"
        note = "number, and diameter of the ball of equal volume; each stone is as large as its cell"
        pixels = contact_sheet(sections, title=title, note=note)
        if partial is not None:
            partial.write_bytes(png_bytes(pixels))


def export(
    folder: Path,
    /,
    *,
    out: Path,
    select: str | None = None,
    format: str = "stl",
    unit: str = "mm",
    overwrite: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Write particles as mesh files with a sidecar each, and a table of them.

    Files are named SOURCE-000123.stl. Stopped at any moment, the same command goes on; what is there is not made again.

    **Example:** `lithoform database export stones --out cubes --select "class = 'cube' and roundness < 0.6"`

    Parameters
    ----------
    folder
        A database.
    out
        Folder for the files; made if it does not exist.
    select
        Which particles: a condition in SQL (what stands after WHERE), or a whole SELECT that gives source and number
        [default: all].
    format
        stl, ply, obj, glb or 3mf.
    unit
        Unit of the files: m, cm, mm, um or in (glb files are in metres).
    overwrite
        Replace a former export with other settings, or write into a folder with files of others, which stay.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.database.exporting import TABLE_FILE, Export
    from lithoform.database.store import Store
    from lithoform.progress import track

    job = Export(Store(folder), select, format=format, unit=unit)
    made = done = 0
    try:
        for new in track(job.run(out, overwrite=overwrite), total=job.count, what="particles"):
            made, done = made + new, done + 1
    except KeyboardInterrupt:
        print(
            f"lithoform: interrupted with at least {done} of {job.count} particles; the same command goes on.",
            file=sys.stderr,
        )
        return 130
    kept = f" ({job.count - made:,} were there)" if made < job.count else ""
    told = {"out": str(out), "count": job.count, "written": made, "table": str(out / TABLE_FILE)}
    text = f"{job.count:,} particles in {out}{kept}, with a .json sidecar each; table {TABLE_FILE}"
    say(json.dumps(told, indent=2) if json_ else text)
    return 0


def grade(
    folder: Path,
    /,
    *,
    gradation: str,
    out: Path,
    min_size: str | None = None,
    mass: str | None = None,
    count: Whole | None = None,
    fill: str | None = None,
    packing_density: float | None = None,
    density: float = 2650.0,
    spread: str = "mass",
    curve: str = "mid",
    select: str | None = None,
    seed: Whole = 0,
    verify: Flag = False,
    picture: Path | None = None,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Draw particles by size, so that their mass by sieve size is that of a gradation.

    Each drawn particle is one of the database at a new scale. The table has a row a drawn particle: source, number,
    scale, sieve size [m], mass [kg], and the sieves between which it lies. Particles may be used many times.

    **Example:** `lithoform database grade stones --gradation AC-13 --min-size 2.36mm --mass 1.5kg --out sample.csv`

    **Example:** `lithoform database grade stones --gradation AC-13 --min-size 2.36mm --fill cylinder:150mm:63.5mm
    --packing-density 0.58 --out mould.parquet --picture mould.png`

    Parameters
    ----------
    folder
        A database.
    gradation
        A name such as AC-13, SMA-13, "DIN A16", "ASTM C33 #57", Fuller-16; or a CSV file with the columns size_mm and
        passing, or size_mm, low and high.
    out
        Table of the drawn particles, .csv or .parquet.
    min_size
        Least sieve size, such as 2.36mm [default: the finest sieve of the gradation].
    mass
        Mass of what is drawn, such as 1.5kg, 800g or 2t.
    count
        Number of particles.
    fill
        Container whose solids are drawn: cylinder:DIAMETER:HEIGHT or box:X:Y:Z, such as cylinder:150mm:63.5mm.
    packing_density
        Share of the container that is solid, above 0 and below 1; goes with --fill.
    density
        Of the rock [kg/m^3].
    spread
        Between two sieves: mass even over the logarithm of the size, or count.
    curve
        low, mid or high: which curve within the limits is met.
    select
        Which particles are drawn from: a condition in SQL, or a whole SELECT that gives source and number
        [default: all].
    seed
        0 to 2^64 - 1.
    verify
        Scale the meshes of 64 drawn particles and measure their sieve sizes anew.
    picture
        PNG of the curve, its limits and what was drawn.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.database.grading import grade as draw
    from lithoform.database.grading import read_candidates
    from lithoform.database.grading import verify as measure_anew
    from lithoform.database.population import TABLES
    from lithoform.database.store import Store
    from lithoform.gradation.quantities import parse_length
    from lithoform.rendering import load_module

    if out.suffix.lower() not in TABLES:
        raise FileFormatError(f"expected --out with a name that ends in {' or '.join(TABLES)}; got {out}.")
    amount = _amount(mass, count, fill, packing_density)
    curves, store, least = _gradation(gradation), Store(folder), None if min_size is None else parse_length(min_size)
    store.refuse_inside(out)
    if picture is not None:
        store.refuse_inside(picture)
        load_module("matplotlib.figure")
    with opened(out) as table, opened(picture) as drawing:
        candidates = read_candidates(store, select, progress=True)
        drawn = draw(
            candidates, curves, **amount, min_size=least, density=density, seed=seed,
            spread=spread, curve=curve,  # type: ignore[arg-type]
        )  # fmt: skip
        checked = measure_anew(store, drawn, seed=seed, progress=True) if verify else None
        if table is not None:
            _write_table(drawn, table, csv=out.suffix.lower() == ".csv")
        if drawing is not None:
            drawing.write_bytes(_curve_png(drawn))
    if json_:
        told = {"out": str(out), **drawn.as_dict(), "density": density, "spread": spread, "seed": seed}
        told |= {"verification": vars(checked)} if checked is not None else {}
        say(json.dumps(told | ({"picture": str(picture)} if picture else {}), indent=2, ensure_ascii=False))
        return 0
    _say_grading(out, drawn, checked)
    if picture is not None:
        say(f"picture: {picture}")
    return 0


def _amount(mass: str | None, count: int | None, fill: str | None, packing_density: float | None) -> dict[str, Any]:
    from lithoform.gradation.quantities import parse_container_volume, parse_mass

    given = [n for n, v in (("--mass", mass), ("--count", count), ("--fill", fill)) if v is not None]
    if len(given) != 1:
        raise RecipeError(f"expected one of --mass, --count and --fill; got {' and '.join(given) or 'none'}.")
    if fill is None:
        if packing_density is not None:
            raise RecipeError(f"--packing-density goes with --fill; got {given[0]}.")
        return {"mass": parse_mass(mass)} if mass is not None else {"count": count}
    if packing_density is None or not 0.0 < packing_density < 1.0:
        raise RecipeError(
            f"expected a --packing-density above 0 and below 1 with --fill, such as 0.58; got {packing_density}."
        )
    return {"volume": parse_container_volume(fill) * packing_density}


def _gradation(text: str) -> Gradation:
    from lithoform.gradation.curves import find_gradation, read_gradation

    return read_gradation(text) if text.lower().endswith(".csv") else find_gradation(text)


def _write_table(drawn: Grading, path: Path, *, csv: bool) -> None:
    import pyarrow.csv
    import pyarrow.parquet

    with path.open("wb") as sink:
        (pyarrow.csv.write_csv if csv else pyarrow.parquet.write_table)(drawn.particle_table(), sink)


def _curve_png(drawn: Grading) -> bytes:
    import numpy as np

    from lithoform.figures.gallery import png_bytes
    from lithoform.figures.grading import grading_curve

    curve, openings = drawn.gradation, drawn.draw.fractions.openings
    limits = (curve.passing_low, curve.passing_high) if curve.passing_low != curve.passing_high else None
    sizes = np.geomspace(openings[-1], openings[0], 1000)
    met = [row.mixture for row in drawn.sieves]
    pixels = grading_curve(
        curve.openings, curve.curve(drawn.curve), limits=limits, drawn=(sizes, drawn.mixture_passing(sizes)),
        met=(openings, met), least=openings[-1], title=f"{curve.name}: {len(drawn):,} particles, {drawn.mass:.4g} kg",
    )  # fmt: skip
    return png_bytes(pixels)


def _say_grading(out: Path, drawn: Grading, checked: Verification | None) -> None:
    told = drawn.as_dict()
    say(f"{out}: {len(drawn):,} particles of {drawn.mass:.6g} kg, {told['gradation']} ({told['citation']})")
    table = [["sieve [mm]", "particles", "asked [%]", "met [%]", "difference", "mixture [%]", "limits [%]"]]
    for row in drawn.sieves:
        limits = "" if row.low is None or row.high is None else f"{row.low:g}-{row.high:g}"
        table.append([
            f"{1e3 * row.opening:g}", f"{row.count:,}", f"{row.asked:.2f}", f"{row.met:.2f}", f"{row.difference:+.2f}",
            f"{row.mixture:.2f}", limits,
        ])  # fmt: skip
    say_table(table)
    if drawn.fines > 0.0:
        say(f"mixture: with the {drawn.fines:.4g} % that are finer than {table[-1][0]} mm and were not drawn")
    if told["sieve_sizes_measured_now"]:
        say(
            f"the sieve size of {told['sieve_sizes_measured_now']:,} particles was measured now; a database built with "
            "--descriptors standard sieve_size has it"
        )
    most = told["most_used"]
    say(
        f"{told['candidates_used']:,} of {told['candidates']:,} particles are used; {most['source']} {most['number']} "
        f"the most, {most['times']:,} times"
    )
    if checked is not None:
        say(
            f"measured anew: {checked.count:,} particles, sieve size within {checked.largest_deviation:.1e} and volume "
            f"within {checked.largest_volume_deviation:.1e} of the table, {checked.misplaced} in another fraction"
        )
