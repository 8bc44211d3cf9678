"""`lithoform reproduce`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say
from lithoform.errors import RecipeError


def reproduce(
    what: str | None = None,
    /,
    *,
    list_: Annotated[bool, Parameter(name="--list", negative="")] = False,
    out: Path = Path("figures"),
    seed: Whole | None = None,
    triangles: Whole | None = None,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Make a figure of the paper anew: --list names them.

    **Example:** `lithoform reproduce fig4 --out figures`

    Parameters
    ----------
    what
        Name of the figure, such as fig2.
    list_
        List the figures that can be made.
    out
        Folder for the files.
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
    from lithoform.reproduce import FIGURES

    if list_:
        rows = [{"figure": row.name, "meaning": row.meaning} for row in FIGURES.values()]
        say(json.dumps(rows, indent=2) if json_ else "\n".join(f"{r['figure']:6}  {r['meaning']}" for r in rows))
        return 0
    if what is None or what not in FIGURES:
        got = "nothing" if what is None else repr(what)
        raise RecipeError(f"expected one of {', '.join(FIGURES)}; got {got}.")
    options = {"seed": seed, "device": device} | ({} if triangles is None else {"triangles": triangles})
    files = [str(path) for path in FIGURES[what].make(out, **options)]
    say(json.dumps({"figure": what, "file": files[0], "files": files}) if json_ else f"{what}: {', '.join(files)}")
    return 0
