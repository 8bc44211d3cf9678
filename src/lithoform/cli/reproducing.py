"""`lithoform reproduce`."""

from __future__ import annotations

import json
from pathlib import Path

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say
from lithoform.errors import RecipeError


def reproduce(
    what: str,
    /,
    *,
    out: Path = Path("figures"),
    seed: Whole | None = None,
    triangles: Whole = 20_000,
    device: str = "auto",
    json_: Json = False,
    debug: Flag = False,
) -> int:
    """Draw a figure of the paper: fig2, the gallery of one-parameter variations at one seed and one view.

    **Example:** `lithoform reproduce fig2 --out figures`

    Parameters
    ----------
    what
        fig2.
    out
        Folder for the picture.
    seed
        Seed of the stone [default: the one of the documentation].
    triangles
        Number of triangles of each stone.
    device
        auto, cpu or cuda.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """
    from lithoform import reproduce as figures

    if what not in figures.FIGURES:
        raise RecipeError(f"expected one of {', '.join(figures.FIGURES)}; got {what!r}.")
    path = figures.FIGURES[what](out, seed=seed, triangles=triangles, device=device)
    say(json.dumps({"figure": what, "file": str(path)}) if json_ else f"{what}: {path}")
    return 0
