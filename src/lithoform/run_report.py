"""What a finished run of `lithoform generate` shows: the gallery and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from lithoform.figures.gallery import gallery
from lithoform.mesh_io import UNITS, file_unit, read_mesh
from lithoform.planning import Plan
from lithoform.production import PICTURE_FILE, TABLE_FILE
from lithoform.sidecar import read_sidecar, sidecar_path

__all__ = ["MAX_PICTURED", "draw_gallery", "run_report"]

MAX_PICTURED: Final = 60


def draw_gallery(out: Path, plan: Plan) -> Path:
    """Draw OUT/gallery.png, of the first `MAX_PICTURED` particles of a finished run."""
    meshes, captions = [], []
    for number in range(1, min(plan.count, MAX_PICTURED) + 1):
        path = out / plan.mesh_file(number)
        sidecar = read_sidecar(sidecar_path(path))
        recipe = sidecar["recipe"]
        size = " x ".join(f"{recipe[n] * UNITS[plan.unit]:.3g}" for n in ("length", "width", "height"))
        meshes.append(read_mesh(path, unit=plan.unit))
        captions.append(f"{number:06d}  {sidecar['class']}\n{size} {plan.unit}")
    target = out / PICTURE_FILE
    gallery(meshes, captions, target)
    return target


def run_report(
    out: Path, plan: Plan, *, drawn: Path | None, done: int, relaxed: int, seconds: float, as_json: bool
) -> str:
    """What a finished run tells.

    Parameters
    ----------
    out : Path
    plan : Plan
    drawn : Path or None
        The picture.
    done, relaxed : int
        How many particles were made by this command, and how many of the run were relaxed.
    seconds : float
    as_json : bool
        One JSON object instead of text.

    Returns
    -------
    str
    """
    if as_json:
        answer = {
            "out": str(out),
            "count": plan.count,
            "generated": done,
            "files": [plan.mesh_file(n) for n in range(1, plan.count + 1)],
            "table": str(out / TABLE_FILE),
            "picture": None if drawn is None else str(drawn),
            "relaxed": relaxed,
            "seconds": round(seconds, 3),
        }
        return json.dumps(answer, indent=2)
    kept = f" ({plan.count - done} were there already)" if done < plan.count else ""
    noun = "particle" if plan.count == 1 else "particles"
    last = "" if plan.count == 1 else f" ... {plan.mesh_file(plan.count)}"
    held = file_unit(plan.format, plan.unit)
    lines = [
        f"{plan.count} {noun} in {out.resolve()}{kept}, every mesh checked when it was made, {seconds:.1f} s",
        f"  meshes   {plan.mesh_file(1)}{last}  ({plan.format}, {held}), with a .json sidecar each",
        f"  table    {TABLE_FILE}",
    ]
    if drawn is not None:
        some = f"  (the first {MAX_PICTURED})" if plan.count > MAX_PICTURED else ""
        lines.append(f"  picture  {drawn.name}{some}")
    if relaxed:
        lines.append(
            f"  relaxed  {relaxed} of {plan.count} {noun}, where faces crossed after the twist: see provenance"
        )
    return "\n".join(lines)
