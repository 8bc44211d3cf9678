"""The folder that a figure or a table is made in, and its files."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from lithoform.atomic import atomic_write, make_folder
from lithoform.errors import OutputError

__all__ = ["csv_bytes", "made_folder", "named_folder", "write_files"]


def named_folder(out: str | Path) -> Path:
    """Path of a folder for files, which need not be there.

    Raises
    ------
    OutputError
        If it has the name of a file.
    """
    folder = Path(out)
    if folder.suffix.lower() in (".png", ".csv", ".html") and not os.path.isdir(folder):  # noqa: PTH112 (is_dir raises for a long name)
        raise OutputError(f"{folder}: expected a folder for the files, not the name of a file; choose another.")
    return folder


def made_folder(out: str | Path) -> Path:
    """Path of a folder for files, which is made if it is not there.

    Raises
    ------
    OutputError
        If it has the name of a file, or cannot be made.
    """
    folder = named_folder(out)
    make_folder(folder)
    return folder


def csv_bytes(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    """Table of rows under a head."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([head, *rows])
    return out.getvalue().encode()


def write_files(folder: Path, contents: dict[str, bytes]) -> list[Path]:
    """Write files by name, each whole or not at all, and return their paths.

    Raises
    ------
    OutputError
        If one cannot be written.
    """
    for name, data in contents.items():
        atomic_write(folder / name, data)
    return [folder / name for name in contents]
