"""`lithoform compact`."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import can_draw, plain_warnings, say
from lithoform.errors import RecipeError

if TYPE_CHECKING:
    from lithoform.compaction.run import Drawing

__all__ = ["compact"]

# A specimen that fits a laptop: stones, and the least sieve size with which they are enough for the mould.
_COUNT, _LEAST = 300, "4.75mm"
# The paper's least size, for a full mould.
_FULL = "2.36mm"


def compact(
    population: Path,
    /,
    *,
    out: Path,
    preset: str = "paper",
    mould: str | None = None,
    count: Whole | None = None,
    gradation: str = "AC-13",
    curve: str = "mid",
    min_size: str | None = None,
    select: str | None = None,
    pressure: float | None = None,
    gyrations: Whole | None = None,
    to_height: str | None = None,
    rate_factor: float = 20.0,
    stiffness_factor: float = 0.1,
    seed: Whole = 0,
    device: str = "auto",
    threads: Whole | None = None,
    vtk: bool = True,
    resume: Flag = False,
    overwrite: Flag = False,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Compact a specimen of a population in a gyratory compactor: section 6 of the paper.

    Stones are drawn from a database by a gradation, fall into the mould, are pressed by a platen at 600 kPa, and the
    mould gyrates. OUT gets compaction.json with all numbers and the fit H = A G^B, table.parquet with every look,
    blocks.csv with the place of each stone, pictures, report.html, and a series for ParaView.

    Without --mould and --min-size the specimen is one for a laptop: 300 stones from 4.75 mm up in a narrower mould.
    `--mould 150mm --min-size 2.36mm` is the paper's.

    Interrupted, the same command with --resume goes on.

    **Example:** `lithoform compact stones --out specimen --gyrations 33`

    Parameters
    ----------
    population
        A database.
    out
        Folder for the results.
    preset
        paper, en12697-31 or aashto-t312.
    mould
        Diameter, such as 150mm [default: the preset's, or with --count one that the stones fill].
    count
        Stones [default: 300, or as many as fill the mould where --mould is given].
    gradation
        Name, such as AC-13, or a file: see lithoform database grade.
    curve
        Of the gradation: low, mid or high.
    min_size
        Least sieve size [default: 4.75mm, or 2.36mm where --mould is given without --count].
    select
        Which particles of the database: a condition in SQL, such as "class = 'cube'".
    pressure
        Of the platen [kPa] [default: the preset's, 600].
    gyrations
        At most [default: the preset's].
    to_height
        Height at which the run ends, of a specimen as wide as the preset's [default: the preset's, 63.5mm].
    rate_factor
        On the 30 gyrations a minute: the inertial number that is printed should stay below 1e-3.
    stiffness_factor
        On Young's modulus of the paper's Table 10, from 0.001 to 1.
    seed
        Of the choice of the particles, their sizes, order, places and attitudes.
    device
        auto, cpu or cuda.
    threads
        [default: the processors at hand]; the result does not depend on it.
    vtk
        Write files for ParaView.
    resume
        Go on with a compaction that was stopped.
    overwrite
        Replace the compaction that OUT holds.
    json_
        Print one JSON object, lengths in metres, instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.compaction.request import Request
    from lithoform.compaction.run import run_compaction
    from lithoform.gradation.quantities import parse_length
    from lithoform.warp_runtime import resolve_device

    began = time.perf_counter()
    if threads is not None and threads < 1:
        raise RecipeError(f"expected --threads of at least 1; got {threads}.")
    full = mould is not None and count is None
    request = Request(
        population=population,
        preset=preset,
        gradation=gradation,
        curve=curve,
        min_size=parse_length(min_size if min_size is not None else _FULL if full else _LEAST),
        count=None if full else _COUNT if count is None else count,
        mould=None if mould is None else parse_length(mould),
        select=select,
        pressure=None if pressure is None else 1e3 * pressure,
        gyrations=gyrations,
        to_height=None if to_height is None else parse_length(to_height),
        rate_factor=rate_factor,
        stiffness_factor=stiffness_factor,
        seed=seed,
        vtk=vtk,
    )
    resolve_device(device)
    lines: list[str] = []

    def told(line: str) -> None:
        lines.append(line)
        if not json_:
            say(line)

    try:
        with plain_warnings():
            results = run_compaction(request, out, device=device, threads=threads, overwrite=overwrite, resume=resume,
                                     progress=True, told=told, draw=_draw if can_draw() else None)  # fmt: skip
    except KeyboardInterrupt:
        option = "--resume in place of --overwrite" if overwrite else "--resume"
        print(f"lithoform: interrupted; the same command with {option} goes on with {out}.", file=sys.stderr)
        return 130
    if json_:
        say(json.dumps({"out": str(out), "told": lines, **results}, indent=2))
        return 0
    _tell(results)
    say(f"\n{out}: compaction.json, table.parquet, blocks.csv, report.html; {time.perf_counter() - began:.1f} s")
    return 0


def _draw(drawing: Drawing) -> dict[str, bytes]:
    from lithoform.compaction_report import compaction_files

    return compaction_files(drawing)


def _tell(results: dict[str, Any]) -> None:
    loose, end, fit = results["loose"], results["compacted"], results["fit"]
    say("")
    say(f"{'':<12}{'height':>10}{'packing density':>18}{'coordination':>15}")
    rows = (("pressed", loose), (f"{end['gyration']:g} gyrations", end))
    for name, row in rows:
        say(f"{name:<14}{1e3 * row['height']:>6.2f} mm{row['packing_density']:>14.4f}{row['coordination']:>15.2f}")
    pressure = results["pressure"]
    say(f"pressure on the platen {pressure['mean'] / 1e3:.1f} kPa, standard deviation "
        f"{pressure['standard_deviation'] / 1e3:.1f}; deepest overlap "
        f"{results['deepest_overlap_over_radius']:.1%} of a radius")  # fmt: skip
    if fit is not None:
        low, high = fit["B_interval"]
        say(f"H = {fit['A_mm']:.4f} mm G^{fit['B']:.5f} (B from {low:.5f} to {high:.5f}), R2 = {fit['R2']:.4f}")
