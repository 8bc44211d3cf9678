"""`lithoform match`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say


def match(
    reference: Path,
    /,
    *,
    out: Path,
    seed: Whole = 0,
    unit: str = "mm",
    fit_share: float = 0.5,
    budget: Whole = 3000,
    triangles: Whole = 20_000,
    permutations: Whole = 2000,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Find a population of stones that cannot be told from a reference, such as scans.

    The reference is split at random: one part is fitted, the other tells how near the population comes, with stones
    made anew. The file OUT is a population recipe: how the parameters and the dimensions scatter.

    **Example:** `lithoform match scans --out population.toml`

    Parameters
    ----------
    reference
        A database folder, a folder of scans or NIST files, or a CSV or Parquet table of measurements.
    out
        TOML file to write.
    seed
        Of the split, the search and the judged stones: the same seed gives the same file.
    unit
        Unit of scans that do not tell theirs: m, cm, mm, um or in.
    fit_share
        Share of the particles that is fitted.
    budget
        Stones made for the search.
    triangles
        Of every stone made; the smoothing that is found holds for this number.
    permutations
        Of each test.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.atomic import atomic_path
    from lithoform.matching.match import match_population
    from lithoform.matching.references import read_reference
    from lithoform.matching.telling import as_dict, as_text

    # What cannot be written is refused before the work.
    with atomic_path(out) as partial:
        values, notes = read_reference(reference, unit=unit, triangles=triangles, progress=True)
        for note in notes:
            print(note, file=sys.stderr)
        found = match_population(
            values,
            seed=seed,
            fit_share=fit_share,
            budget=budget,
            triangles=triangles,
            permutations=permutations,
            progress=True,
            note=f"matched to {reference.name}, seed {seed}, {fit_share:g} of {len(values)} particles fitted",
        )
        partial.write_bytes(found.population.to_toml().encode())
    if json_:
        say(json.dumps({"file": str(out), "notes": list(notes), **as_dict(found)}, indent=2))
    else:
        say(as_text(found))
        say(f"\nPopulation recipe: {out}")
    return 0
