"""What a design leaves in a folder: the stones of the setting, its recipe, the candidates, and the numbers."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import atomic_write, make_folder, remove_partials
from lithoform.descriptors.table import FOUR
from lithoform.errors import OutputError
from lithoform.generation import generate
from lithoform.inverse.design import Design, Setting, as_dict
from lithoform.locking import LOCK_FILE
from lithoform.mesh import Mesh
from lithoform.presets import shape_class_of
from lithoform.recipe_io import to_toml

__all__ = ["CANDIDATES_FILE", "NUMBERS_FILE", "PICTURE_FILE", "RECIPE_FILE", "prepare_folder", "write_design"]

NUMBERS_FILE: Final = "design.json"
RECIPE_FILE: Final = "recipe.toml"
CANDIDATES_FILE: Final = "candidates.csv"
PICTURE_FILE: Final = "design.png"
_OWN_FILE: Final = re.compile(r"recipe\.toml|candidates\.csv|design\.(json|png)|\d{6,}\.(stl|json)", re.ASCII)


def prepare_folder(out: Path, *, overwrite: bool, remove: bool = True) -> None:
    """Make a folder ready for a design; only files of a former design are ever removed, and only if `remove` is on.

    Raises
    ------
    OutputError
        If it holds other files, or a design while `overwrite` is off, a finished one or not, or cannot be used.
    """
    make_folder(out)
    try:
        content = {p.name for p in out.iterdir() if p.name != LOCK_FILE and not p.name.endswith(".partial")}
        own = _files_of_former(out)
        if content and not (own and overwrite):
            if missing := len(own - content):
                raise OutputError(
                    f"the folder {out} holds a design that was stopped before it was finished ({missing} of its "
                    f"{len(own)} files are missing): give --overwrite to make it anew, or choose another folder."
                )
            held, way = ("a design", ", or give --overwrite") if own else ("other files", "")
            raise OutputError(f"the folder {out} is not empty, it holds {held}: choose another{way}.")
        if remove:
            for name in sorted(own & content):
                (out / name).unlink()
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"the folder {out} cannot be used: {error.strerror}.") from error
    remove_partials(out)


def write_design(design: Design, out: Path, *, stones: int, picture: bool, unit: str = "mm") -> list[Mesh]:
    """Write stones of the fresh seeds, those that were measured, the recipe, the candidates and the numbers.

    Parameters
    ----------
    design : Design
    out : Path
        A folder that `prepare_folder` made ready.
    stones : int
        How many, at most the fresh seeds.
    picture : bool
        Whether a picture will be put beside them.
    unit : str
        Of the mesh files.

    Returns
    -------
    list of Mesh
        Of the stones [m].

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    seeds = [seed for seed, there in zip(design.seeds, design.measured, strict=True) if there][:stones]
    names = [f"{i:06d}" for i in range(1, len(seeds) + 1)]
    files = [RECIPE_FILE, CANDIDATES_FILE, *([PICTURE_FILE] if picture else [])]
    files += [f"{name}.{kind}" for name in names for kind in ("stl", "json")]
    told = {**as_dict(design), "files": files}
    # First, so that what a stopped run has written is known as ours.
    atomic_write(out / NUMBERS_FILE, _json(told))
    atomic_write(out / RECIPE_FILE, to_toml(design.recipe).encode())
    atomic_write(out / CANDIDATES_FILE, candidates_csv(design.candidates))
    meshes = []
    for number, (name, seed) in enumerate(zip(names, seeds, strict=True), start=1):
        particle = generate(design.recipe.replace(seed=seed))
        extra = {"number": number, "class": shape_class_of(particle.recipe.size)}
        particle.save(out / f"{name}.stl", unit=unit, extra=extra)
        meshes.append(particle.mesh)
    return meshes


def candidates_csv(candidates: Iterable[Setting]) -> bytes:
    """Table with a row a candidate: E, the predicted descriptors, and the recipe."""
    rows: list[dict[str, Any]] = []
    for rank, one in enumerate(candidates, start=1):
        row: dict[str, Any] = {"rank": rank, "mismatch": one.mismatch, "within": one.within}
        for what, values in (("", one.mean), ("_error", one.error), ("_scatter", one.scatter)):
            told = (float(value) if np.isfinite(value) else "" for value in values)
            row |= {f"{name}{what}": value for name, value in zip(FOUR, told, strict=True)}
        rows.append(row | one.recipe.as_dict())
    out = io.StringIO()
    writer = csv.DictWriter(out, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue().encode()


def _files_of_former(out: Path) -> set[str]:
    """Names that a former design recorded; empty if there is none."""
    try:
        former = json.loads((out / NUMBERS_FILE).read_bytes())
        files = former["files"] if {"route", "recipe"} <= former.keys() else []
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()
    # Whatever such a file says, nothing else than what a design writes is ever removed.
    own = {str(name) for name in files if _OWN_FILE.fullmatch(str(name))} if isinstance(files, list) else set()
    return own | {NUMBERS_FILE} if own else set()


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=2) + "\n").encode()
