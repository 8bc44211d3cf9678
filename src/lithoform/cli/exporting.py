"""`lithoform export`."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from lithoform.cli.arguments import Flag, Json, Whole
from lithoform.cli.output import say

__all__ = ["export"]

export = App(name="export", help="Decks for other engines: lammps, liggghts, yade.", help_format="markdown")


@Parameter(name="*")
@dataclass(frozen=True)
class Options:
    """What all decks are asked for.

    Attributes
    ----------
    stones
        Where the database or the meshes of the specimen are now [default: where they were].
    device
        auto, cpu or cuda: what makes stones from recipes.
    threads
        [default: the processors at hand]; the result does not depend on it.
    overwrite
        Replace the deck that OUT holds.
    json_
        Print one JSON object instead of text.
    debug
        Show the traceback of an error.
    """

    stones: Annotated[list[Path] | None, Parameter(negative="", consume_multiple=True)] = None
    device: str = "auto"
    threads: Whole | None = None
    overwrite: Flag = False
    json_: Json = False
    debug: Flag = False


@export.command
def lammps(
    specimen: Path,
    /,
    *,
    out: Path,
    spheres: Whole = 40,
    options: Options | None = None,
) -> int:
    """Write a deck for LAMMPS: clumps of spheres as rigid bodies.

    Mass, centre of mass and inertia of each body are those of the true mesh. OUT gets in.lammps, data.lammps,
    bodies.lammps and deck.json, which tells how far the clumps are from the meshes.

    **Example:** `lithoform export lammps packing --out deck`, then `mpirun -np 4 lmp -in in.lammps` in that folder.

    Parameters
    ----------
    specimen
        Folder that lithoform pack or lithoform compact has finished.
    out
        Folder for the deck.
    spheres
        Of a clump, at most.
    """
    return _export("lammps", specimen, out, options or Options(), spheres=spheres)


@export.command
def liggghts(
    specimen: Path,
    /,
    *,
    out: Path,
    spheres: Whole = 40,
    options: Options | None = None,
) -> int:
    """Write a deck for LIGGGHTS-PUBLIC: clumps of spheres as multispheres.

    Mass and inertia of each body are those of the true mesh. LIGGGHTS lays the centroid of the spheres on the centre of
    mass: the surface moves by centre_error in deck.json.

    **Example:** `lithoform export liggghts packing --out deck`, then `liggghts -in in.liggghts` in that folder.

    Parameters
    ----------
    specimen
        Folder that lithoform pack or lithoform compact has finished.
    out
        Folder for the deck.
    spheres
        Of a clump, at most.
    """
    return _export("liggghts", specimen, out, options or Options(), spheres=spheres)


@export.command
def yade(
    specimen: Path,
    /,
    *,
    out: Path,
    vertices: Whole = 50,
    options: Options | None = None,
) -> int:
    """Write a deck for YADE: convex polyhedra.

    Mass, centre of mass and inertia of each body are those of the true mesh. OUT gets run_yade.py, scene.json and
    deck.json, which tells how far the polyhedra are from the hulls.

    **Example:** `lithoform export yade packing --out deck`, then `yade -n -x run_yade.py` in that folder.

    Parameters
    ----------
    specimen
        Folder that lithoform pack or lithoform compact has finished.
    out
        Folder for the deck.
    vertices
        Of a polyhedron, at most.
    """
    return _export("yade", specimen, out, options or Options(), vertices=vertices)


# What the errors of a deck are called, and what they are shares of.
_TOLD = {
    "volume_error": "volume",
    "hull_excess": "volume above that of the mesh",
    "centre_error": "centroid of the spheres, of the radius",
    "inertia_error": "inertia of the spheres (the deck has that of the mesh)",
    "mean_distance": "distance of the surfaces on the average, of the radius",
    "max_distance": "distance of the surfaces at most, of the radius",
}


def _export(engine: str, specimen: Path, out: Path, options: Options, **detail: int) -> int:
    from lithoform.errors import OutputError
    from lithoform.export.deck import export_deck
    from lithoform.export.scene import read_scene
    from lithoform.warp_runtime import resolve_device

    began = time.perf_counter()
    if out.resolve().is_relative_to(specimen.resolve()):
        raise OutputError(f"the deck would lie in the folder of the specimen, {specimen}: name another for --out.")
    resolve_device(options.device)
    progress = not options.json_
    scene = read_scene(specimen, stones=options.stones or (), device=options.device, threads=options.threads,
                       progress=progress)  # fmt: skip
    results = export_deck(engine, scene, out, threads=options.threads, overwrite=options.overwrite, progress=progress,
                          **detail)  # fmt: skip
    if options.json_:
        say(json.dumps({"out": str(out), **results}, indent=2))
        return 0
    kind = "spheres" if engine != "yade" else "vertices"
    count = sum(row[kind] for row in results["shapes"]) / len(results["shapes"])
    say(f"{results['blocks']} blocks of {len(results['shapes'])} shapes, {count:.0f} {kind} a shape; largest errors:")
    for name, value in results["worst"].items():
        say(f"  {value:8.2%}  {_TOLD[name]}")
    say(f"\n{out}: {', '.join(results['files'][:8])}; {time.perf_counter() - began:.1f} s")
    say(f"Run it there: {results['run']}")
    return 0
