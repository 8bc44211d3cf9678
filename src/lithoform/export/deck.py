"""A deck in a folder: its files, and deck.json, which says what was lost in the shapes."""

from __future__ import annotations

import os
import re
from typing import Any, Final

import numpy as np

from lithoform.atomic import atomic_write, make_folder
from lithoform.errors import SceneError
from lithoform.export.clumps import MOST_SPHERES, SPHERES, Clump, at_least_two, make_clump
from lithoform.export.lammps import lammps_files
from lithoform.export.liggghts import liggghts_files
from lithoform.export.polyhedra import VERTICES, Polyhedron, make_polyhedron
from lithoform.export.scene import Scene
from lithoform.export.yade import yade_files
from lithoform.locking import folder_lock
from lithoform.packing.request import path_of
from lithoform.parallel import in_order
from lithoform.progress import track
from lithoform.result_folder import ResultFolder
from lithoform.sidecar import program_version

__all__ = ["ENGINES", "NUMBERS_FILE", "RUN", "export_deck"]

NUMBERS_FILE: Final = "deck.json"
ENGINES: Final = ("lammps", "liggghts", "yade")
RUN: Final = {
    "lammps": "lmp -in in.lammps",
    "liggghts": "liggghts -in in.liggghts",
    "yade": "yade -n -x run_yade.py",
}
"""What runs a deck, in its folder."""

_FILES: Final = frozenset(
    "deck.json in.lammps data.lammps bodies.lammps in.liggghts stones.liggghts run_yade.py scene.json".split()
)
# Files of which a deck has some, and what the engines leave beside it: a former export may have had more of them.
_SOME: Final = re.compile(
    r"(shape|wall)[0-9]+\.(txt|stl)|(start|end)\.(dump|json|restart(\.rigid)?)|log\.(lammps|liggghts)"
)


def export_deck(
    engine: str,
    scene: Scene,
    out: str | os.PathLike[str],
    *,
    spheres: int = SPHERES,
    vertices: int = VERTICES,
    threads: int | None = None,
    overwrite: bool = False,
    progress: bool = False,
) -> dict[str, Any]:
    """Write a deck.

    Parameters
    ----------
    engine : {"lammps", "liggghts", "yade"}
    scene : Scene
    out : path-like
        Folder for the deck.
    spheres : int
        Of a clump, at most, for LAMMPS and LIGGGHTS.
    vertices : int
        Of a polyhedron, at most, for YADE.
    threads : int, optional
        For the clumps; by default all processors. The result does not depend on it.
    overwrite : bool
        Replace the deck that the folder holds.
    progress : bool
        Whether to show a bar.

    Returns
    -------
    dict
        What deck.json holds: `blocks`, `files`, `run`, `shapes` (of each: name, spheres or vertices, errors) and
        `worst` (the largest of each error).

    Raises
    ------
    SceneError
        If the engine is not known, or a number of spheres or vertices out of range.
    OutputError
        If the folder is not one to write into.
    """
    if engine not in ENGINES:
        raise SceneError(f"expected an engine of {', '.join(ENGINES)}; got {engine!r}.")
    if not 1 <= spheres <= MOST_SPHERES:
        raise SceneError(f"expected 1 to {MOST_SPHERES} spheres in a clump, got {spheres!r}.")
    if threads is not None and threads < 1:
        raise SceneError(f"expected --threads of at least 1, got {threads}.")
    out = path_of("--out", out)
    settings = {"lithoform": program_version(), "engine": engine, "source": scene.source, "spheres": spheres,
                "vertices": vertices}  # fmt: skip
    make_folder(out)
    with folder_lock(out):
        found = frozenset(path.name for path in out.iterdir() if _SOME.fullmatch(path.name))
        _folder(found).check(out, settings, overwrite=overwrite, resume=False)
        solids = _solids(engine, scene, spheres, vertices, threads, progress)
        files = _files(engine, scene, solids)
        shapes = [
            {"name": name, _KINDS[engine]: len(solid), **solid.errors()}
            for name, solid in zip(scene.names, solids, strict=True)
        ]
        folder = _folder(found | files.keys())
        folder.clear(out, settings)
        for name, content in files.items():
            atomic_write(out / name, content)
        worst = {name: float(np.abs([row[name] for row in shapes]).max()) for name in solids[0].errors()}
        results = {"blocks": scene.model.count, "files": sorted(files), "run": RUN[engine], "worst": worst,
                   "shapes": shapes}  # fmt: skip
        folder.write(out, settings, {"results": results}, finished=True)
    return results


_KINDS: Final = {"lammps": "spheres", "liggghts": "spheres", "yade": "vertices"}


def _folder(more: frozenset[str]) -> ResultFolder:
    return ResultFolder(what="deck", numbers=NUMBERS_FILE, files=_FILES | more)


def _solids(
    engine: str, scene: Scene, spheres: int, vertices: int, threads: int | None, progress: bool
) -> list[Clump] | list[Polyhedron]:
    shapes = scene.model.shapes
    if engine == "yade":
        return [make_polyhedron(shape, vertices) for shape in shapes]
    made = in_order(lambda shape: at_least_two(make_clump(shape, spheres)), shapes, threads=threads)
    return list(track(made, total=len(shapes), what="clumps", enabled=progress))


def _files(engine: str, scene: Scene, solids: Any) -> dict[str, bytes]:
    writer = {"lammps": lammps_files, "liggghts": liggghts_files, "yade": yade_files}[engine]
    return writer(scene, solids)
