"""The folder of a packing: what it was asked for first, so that a stopped run is known, goes on, or is replaced."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import atomic_write, make_folder, remove_partials
from lithoform.errors import OutputError
from lithoform.locking import LOCK_FILE

__all__ = [
    "BLOCKS_FILE", "CHECKPOINT_FILE", "MESHES_FOLDER", "NUMBERS_FILE", "PICTURE_FILE", "PROGRESS_FILE", "TABLE_FILE",
    "VTK_FOLDER", "check_folder", "clear_folder", "read_numbers", "write_numbers",
]  # fmt: skip

NUMBERS_FILE: Final = "packing.json"
BLOCKS_FILE: Final = "blocks.csv"
TABLE_FILE: Final = "table.parquet"
PICTURE_FILE: Final = "packing.png"
CHECKPOINT_FILE: Final = "packing.checkpoint"
PROGRESS_FILE: Final = "progress.json"
VTK_FOLDER: Final = "vtk"
MESHES_FOLDER: Final = "vtk_meshes"

_FORMAT: Final = "lithoform packing"
_FILES: Final = {NUMBERS_FILE, BLOCKS_FILE, TABLE_FILE, PICTURE_FILE, CHECKPOINT_FILE, PROGRESS_FILE}
_VTK_FILE: Final = re.compile(r"(blocks|contacts)(_\d+\.vt[pu]|\.pvd)", re.ASCII)


def check_folder(out: Path, settings: dict[str, Any], *, overwrite: bool, resume: bool) -> dict[str, Any] | None:
    """Make a folder, and make sure that a packing may be written there; nothing in it is touched.

    Parameters
    ----------
    out : Path
        Made if it does not exist.
    settings : dict
        What is asked for, in plain values; a run is gone on with only by the same.
    overwrite : bool
        A former packing may be replaced.
    resume : bool
        A packing that was stopped is to be gone on with.

    Returns
    -------
    dict or None
        What a former packing left in packing.json; None where there is none.

    Raises
    ------
    OutputError
        If the folder holds other files, or a packing while neither option is given, or one of other settings or of
        another version, or cannot be used.
    """
    make_folder(out)
    try:
        content = {path.name for path in out.iterdir() if path.name != LOCK_FILE and not path.name.endswith(".partial")}
    except OSError as error:
        raise OutputError(f"the folder {out} cannot be used: {error.strerror or error}.") from error
    former = read_numbers(out)
    if not content:
        return None
    if resume:
        if former is None:
            raise OutputError(f"{out} holds no packing to resume (there is no {NUMBERS_FILE}): choose another folder.")
        asked = former["settings"]
        differing = sorted(key for key in {*asked, *settings} if asked.get(key) != settings.get(key))
        if differing:
            raise OutputError(
                f"{out} holds a packing with other settings ({', '.join(differing)} differ): resume it with the same "
                "command, or give --overwrite to make it anew."
            )
        return former
    foreign = sorted(content - _FILES - ({VTK_FOLDER, MESHES_FOLDER} if former else set()))
    if former is None or foreign:
        named = (foreign or sorted(content))[0]
        raise OutputError(f"the folder {out} is not empty, it holds other files ({named}): choose another.")
    if not overwrite:
        held, way = "a packing that was stopped before it was finished", "--resume goes on, --overwrite starts anew"
        if former["finished"]:
            held, way = "a packing", "--overwrite replaces it"
        raise OutputError(f"the folder {out} holds {held}: {way}, or choose another folder.")
    return former


def clear_folder(out: Path, settings: dict[str, Any]) -> None:
    """Remove the files of a former packing, and nothing else, and note what is asked for now.

    Raises
    ------
    OutputError
        If a file cannot be removed or written.
    """
    # First of all the numbers say that nothing is finished: if this is stopped, the files are still known as ours, and
    # what is left of them is not taken for a packing.
    write_numbers(out, settings, {}, finished=False)
    try:
        for name in sorted(_FILES - {NUMBERS_FILE}):
            (out / name).unlink(missing_ok=True)
        for name in (VTK_FOLDER, MESHES_FOLDER):
            _remove_series(out / name)
    except OSError as error:
        raise OutputError(f"the former packing in {out} cannot be removed: {error.strerror or error}.") from error
    remove_partials(out)


def write_numbers(out: Path, settings: dict[str, Any], results: dict[str, Any], *, finished: bool) -> None:
    """Write packing.json.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    told = {"format": _FORMAT, "finished": finished, "settings": settings, **results}
    atomic_write(out / NUMBERS_FILE, (json.dumps(told, indent=2, ensure_ascii=False) + "\n").encode())


def read_numbers(out: Path) -> dict[str, Any] | None:
    """What packing.json in a folder holds; None where it is not of a packing."""
    try:
        told = json.loads((out / NUMBERS_FILE).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    is_ours = isinstance(told, dict) and told.get("format") == _FORMAT and isinstance(told.get("settings"), dict)
    return told if is_ours and isinstance(told.get("finished"), bool) else None


def _remove_series(folder: Path) -> None:
    """Remove the files of a series, and its folder where nothing else is in it."""
    if not folder.is_dir() or folder.is_symlink():
        return
    for path in sorted(folder.iterdir()):
        if _VTK_FILE.fullmatch(path.name) or (path.name.startswith(".") and path.name.endswith(".partial")):
            path.unlink()
    if not any(folder.iterdir()):
        folder.rmdir()
