"""`lithoform reproduce`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json, Whole, words
from lithoform.cli.output import plain_warnings, say
from lithoform.errors import RecipeError

_ALL = "all"


def reproduce(
    what: str | None = None,
    /,
    *,
    list_: Annotated[bool, Parameter(name="--list", negative="")] = False,
    out: Path = Path("figures"),
    only: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    skip: Annotated[list[str] | None, Parameter(negative="", consume_multiple=True)] = None,
    overwrite: Flag = False,
    seed: Whole | None = None,
    triangles: Whole | None = None,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Make a figure or a table of the paper anew, or all of them: --list names them.

    `all` makes what OUT does not hold yet, goes on past what cannot be made here, and writes report.html and
    claims.csv: what the paper says, and what was confirmed, refuted and not run. Stopped, the same command goes on.

    **Example:** `lithoform reproduce fig4 --out figures`

    **Example:** `lithoform reproduce all --out figures --skip fig12 fig13 table6`

    Parameters
    ----------
    what
        Name of the figure or table, such as fig2, or all.
    list_
        List the figures and tables of the paper: state in OUT, cost, command.
    out
        Folder for the files.
    only
        Of all: make these alone.
    skip
        Of all: leave these out.
    overwrite
        Of all: make anew what OUT holds.
    seed
        Seed of the stones [default: the one of the documentation].
    triangles
        Number of triangles of each stone (of the finest, for fig4) [default: the paper's].
    device
        auto, cpu or cuda.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform.reproduce import FIGURES, PAPER
    from lithoform.reproduce.overview import chosen, listing, make_one

    if list_:
        rows = listing(out)
        say(json.dumps(rows, indent=2) if json_ else _listed(rows, out))
        return 0
    options = {"seed": seed, "device": device} | ({} if triangles is None else {"triangles": triangles})
    if what == _ALL:
        names = chosen(words(only), words(skip))
        return _all(out, options, names, overwrite=overwrite, as_json=json_)
    if what is not None and what in PAPER and what not in FIGURES:
        row = PAPER[what]
        raise RecipeError(f"{row.title} is not made by a command ({row.represented}); see lithoform reproduce --list.")
    if what is None or what not in FIGURES:
        got = "nothing" if what is None else repr(what)
        raise RecipeError(f"expected one of {', '.join((*FIGURES, _ALL))}; got {got}.")
    if only or skip or overwrite:
        raise RecipeError(f"--only, --skip and --overwrite are for lithoform reproduce all; leave them out for {what}.")
    with plain_warnings():
        files = [str(path) for path in make_one(what, out, options)]
    say(json.dumps({"figure": what, "file": files[0], "files": files}) if json_ else f"{what}: {', '.join(files)}")
    return 0


def _listed(rows: list[dict[str, Any]], out: Path) -> str:
    """A line an item: name, command, state in the folder, cost and meaning; then the reasons."""
    from lithoform.reproduce import SHARED

    lines = []
    for row in rows:
        command, told = row["command"] or "-", row["cost"] or "-"
        meaning = row["meaning"] if row["command"] else f"{row['meaning']} ({row['reason']})"
        lines.append(f"{row['figure']:8} {command:26} {row['state']:11} {told:25} {meaning}")
    reasons: dict[str, list[str]] = {}
    for row in rows:
        if row["command"] and row["reason"]:
            reasons.setdefault(row["reason"], []).append(row["figure"])
    lines.append(f"State: of the folder {out}. Cost: wall-clock time on two cores; shared: {SHARED}")
    return "\n".join([*lines, *(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())])


def _all(out: Path, options: dict[str, Any], names: list[str], *, overwrite: bool, as_json: bool) -> int:
    from lithoform.reproduce.claims import counts
    from lithoform.reproduce.overview import find_claims, make_all, plain_outcomes
    from lithoform.reproduce.report import CLAIMS_FILE, REPORT_FILE

    try:
        with plain_warnings():
            outcomes = make_all(
                out, options, names=names, overwrite=overwrite, told=(lambda _: None) if as_json else say
            )
    except KeyboardInterrupt:
        print(f"lithoform: interrupted; the same command goes on with {out}.", file=sys.stderr)
        return 130
    verdicts = counts(find_claims(out))
    files = [str(out / name) for name in (REPORT_FILE, CLAIMS_FILE)]
    if as_json:
        told = {"out": str(out), "items": plain_outcomes(outcomes), "claims": verdicts, "files": files}
        say(json.dumps(told, indent=2))
    else:
        say(f"claims of the paper: {', '.join(f'{number} {verdict}' for verdict, number in verdicts.items())}")
        say(", ".join(files))
    return 2 if any(outcome.state == "failed" for outcome in outcomes) else 0
