"""`lithoform compare`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token

from lithoform.cli.arguments import Flag, Json, Whole, words
from lithoform.cli.output import say


def _folder(_: Any, tokens: Sequence[Token]) -> Path:
    """A folder; Path alone takes an empty text for the current one."""
    if not tokens[0].value.strip():
        raise ValueError("expected the name of a folder for the files; got an empty one.")
    return Path(tokens[0].value)


def compare(
    a: Path,
    b: Path,
    /,
    *,
    out: Annotated[Path, Parameter(converter=_folder)],
    by: str | None = None,
    names: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    label_a: str | None = None,
    label_b: str | None = None,
    seed: Whole = 0,
    permutations: Whole | None = None,
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Compare two populations of particles, such as scans (A) and generated stones (B).

    The table shows means, standard deviations, the Bhattacharyya coefficient BC with what chance alone gives, the
    divergences KL and JS, p, and a verdict; sentences follow. The folder takes the report (report.html) with all
    numbers, the same as comparison.csv and comparison.json, and the figures.

    **Example:** `lithoform compare scans generated --by class --out comparison`

    Parameters
    ----------
    a
        The reference: a database folder, or a CSV or Parquet table of measurements.
    b
        What is compared with it, likewise.
    out
        Folder for the files; files of a former comparison in it are replaced.
    by
        Compare by this column too, such as class.
    names
        Descriptors, or four, standard or all; separated by commas or spaces [default: four].
    label_a
        What A is called [default: the name of the folder or file].
    label_b
        What B is called.
    seed
        Of permutations and bootstrap: the same seed gives the same files.
    permutations
        Number of permutations of each test [default: 2000, or 100 for each comparison if that is more].
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.comparison_report import as_dict, screen, write_report
    from lithoform.database.population import read_population
    from lithoform.descriptors.measuring import resolve_names
    from lithoform.report.study import study

    asked = words(names) or ["four"]
    # Sets of descriptors hold the class, which is no number; by name it is refused.
    wanted = [name for name in resolve_names(asked) if name != "zingg_class" or name in asked]

    first = read_population(a, wanted, by=by, label=label_a)
    second = read_population(b, wanted, by=by, label=label_b)
    found, paths = write_report(lambda: study(first, second, seed=seed, permutations=permutations), out)
    files = [str(path) for path in paths]
    if json_:
        say(json.dumps(as_dict(found, files), indent=2))
    else:
        say(screen(found))
        say(f"\n{len(files)} files in {out}: open {paths[0].name}")
    return 0
