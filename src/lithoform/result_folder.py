"""The folder of a result: what was asked for first, so that a stopped run is known, goes on, or is replaced.

Files that are not of the result are left alone: with them in the folder it is not replaced.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import atomic_write, make_folder
from lithoform.errors import OutputError
from lithoform.locking import LOCK_FILE

__all__ = ["ResultFolder"]

_VTK_FILE: Final = re.compile(r"(blocks|contacts)(_\d+\.vt[pu]|\.pvd)", re.ASCII)
# Written as false while files of a former result are removed.
_CLEARED: Final = "cleared"
# What a killed run leaves of a file that it was writing: see `lithoform.atomic`.
_UNFINISHED: Final = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{8}\.partial", re.ASCII)


@dataclass(frozen=True)
class ResultFolder:
    """Names of the files of a kind of result.

    Attributes
    ----------
    what : str
        What the result is, for messages: "packing".
    numbers : str
        Name of the JSON file with the settings and the results.
    files : frozenset of str
        Names of all files, that one among them.
    series : tuple of str
        Names of folders with VTK files.
    """

    what: str
    numbers: str
    files: frozenset[str]
    series: tuple[str, ...] = ()

    def check(
        self, out: Path, settings: dict[str, Any], *, overwrite: bool, resume: bool,
        may_grow: Callable[[dict[str, Any]], bool] = lambda _: False,
    ) -> dict[str, Any] | None:  # fmt: skip
        """Make a folder, and make sure that a result may be written there; nothing in it is touched.

        Parameters
        ----------
        out : Path
            Made if it does not exist.
        settings : dict
            What is asked for, in plain values; a run is gone on with only by the same.
        overwrite : bool
            A former result may be replaced.
        resume : bool
            A run that was stopped is to be gone on with.
        may_grow : callable
            Whether a run of other settings, which it is given, may be gone on with too.

        Returns
        -------
        dict or None
            What a former run left in the file of the numbers; None where there is none.

        Raises
        ------
        OutputError
            If the folder holds other files, or a result while neither option is given, or one of other settings or of
            another version, or cannot be used.
        """
        make_folder(out)
        try:
            content = {path.name for path in out.iterdir() if path.name != LOCK_FILE and not self._is_unfinished(path)}
        except OSError as error:
            raise OutputError(f"the folder {out} cannot be used: {error.strerror or error}.") from error
        former = self.read(out)
        if not content:
            return None
        if resume:
            return self._same(out, former, settings, may_grow)
        foreign = sorted(content - self.files - {*self.series})
        if former is None:
            named = (foreign or sorted(content))[0]
            raise OutputError(f"the folder {out} is not empty, it holds other files ({named}): choose another.")
        if not overwrite:
            held, way = (
                f"a {self.what} that was stopped before it was finished",
                "--resume goes on, --overwrite starts anew",
            )
            if former["finished"]:
                held, way = f"a {self.what}", "--overwrite replaces it"
            raise OutputError(f"the folder {out} holds {held}: {way}, or choose another folder.")
        if foreign:
            raise OutputError(f"the folder {out} holds a {self.what} and other files ({foreign[0]}): move those away, "
                              "or choose another folder.")  # fmt: skip
        return former

    def _same(
        self, out: Path, former: dict[str, Any] | None, settings: dict[str, Any],
        may_grow: Callable[[dict[str, Any]], bool],
    ) -> dict[str, Any]:  # fmt: skip
        if former is None:
            raise OutputError(f"{out} holds no {self.what} to resume (there is no {self.numbers} of one): name the "
                              f"folder of the {self.what}, or choose another and leave --resume out.")  # fmt: skip
        asked = former["settings"]
        differing = sorted(key for key in {*asked, *settings} if asked.get(key) != settings.get(key))
        if differing and not may_grow(asked):
            differ = "differs" if len(differing) == 1 else "differ"
            raise OutputError(
                f"{out} holds a {self.what} with other settings ({', '.join(differing)} {differ}): resume it with the "
                "same command, or give --overwrite to make it anew."
            )
        return former

    def clear(self, out: Path, settings: dict[str, Any]) -> None:
        """Remove the files of a former result, and nothing else, and note what is asked for now.

        Raises
        ------
        OutputError
            If a file cannot be removed or written.
        """
        # First of all the numbers say that nothing is finished, nor cleared: if this is stopped, the files are still
        # known as ours, and what is left of them is not taken for a result, nor for what a run goes on from.
        self.write(out, settings, {_CLEARED: False}, finished=False)
        try:
            for name in sorted(self.files - {self.numbers}):
                (out / name).unlink(missing_ok=True)
            for name in self.series:
                self._remove_series(out / name)
        except OSError as error:
            raise OutputError(
                f"the former {self.what} in {out} cannot be removed: {error.strerror or error}."
            ) from error
        self.remove_unfinished(out)
        self.write(out, settings, {}, finished=False)

    @staticmethod
    def goes_on(former: dict[str, Any] | None, *, resume: bool) -> bool:
        """Whether a run goes on from what a former one left: not from files of another that were about to be removed.

        Parameters
        ----------
        former : dict or None
            As `check` returns it.
        resume : bool
        """
        return resume and former is not None and former.get(_CLEARED) is not False

    def remove_unfinished(self, out: Path) -> None:
        """Remove what a killed run left of the files that it was writing, and nothing else.

        Raises
        ------
        OutputError
            If a file cannot be removed.
        """
        try:
            for folder in (out, *(out / name for name in self.series)):
                for path in sorted(folder.iterdir()) if folder.is_dir() and not folder.is_symlink() else ():
                    if self._is_unfinished(path):
                        path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"unfinished files in {out} cannot be removed: {error.strerror or error}.") from error

    def write(self, out: Path, settings: dict[str, Any], results: dict[str, Any], *, finished: bool) -> None:
        """Write the file of the numbers.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        told = {"format": self._format, "finished": finished, "settings": settings, **results}
        text = json.dumps(told, indent=2, ensure_ascii=False) + "\n"
        # Names of files may hold bytes that are no text: these become escapes of JSON, which read as they were.
        atomic_write(out / self.numbers, text.encode(errors="backslashreplace"))

    def read(self, out: Path) -> dict[str, Any] | None:
        """What the file of the numbers holds; None where it is not of such a result."""
        try:
            told = json.loads((out / self.numbers).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        is_ours = isinstance(told, dict) and told.get("format") == self._format
        if not (is_ours and isinstance(told.get("settings"), dict) and isinstance(told.get("finished"), bool)):
            return None
        return told

    @property
    def _format(self) -> str:
        return f"lithoform {self.what}"

    def _is_unfinished(self, path: Path) -> bool:
        """Whether a file is what is left of one of ours."""
        found = _UNFINISHED.fullmatch(path.name)
        return (
            found is not None
            and (found["name"] in self.files or _VTK_FILE.fullmatch(found["name"]) is not None)
            and path.is_file()
            and not path.is_symlink()
        )

    def _remove_series(self, folder: Path) -> None:
        """Remove the files of a series, and its folder where nothing else is in it."""
        if not folder.is_dir() or folder.is_symlink():
            return
        for path in sorted(folder.iterdir()):
            if _VTK_FILE.fullmatch(path.name) or self._is_unfinished(path):
                path.unlink()
        if not any(folder.iterdir()):
            folder.rmdir()
