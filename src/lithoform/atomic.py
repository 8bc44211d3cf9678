"""Files that are written whole or not at all: a temporary file beside the target, then one rename.

A run that is killed outright leaves only files named `.<name>.<token>.partial`, for `remove_partials`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from lithoform.errors import OutputError

__all__ = ["atomic_path", "atomic_write", "make_folder", "remove_partials"]

_SUFFIX: Final = ".partial"

# What the operating system says, in words, and the way out.
_CAUSES: Final[dict[int, str]] = {
    errno.ENOSPC: "the disk is full; free some space or write to another disk.",
    errno.EDQUOT: "the disk quota is used up; free some space or write to another disk.",
    errno.EFBIG: "the file would be larger than the system allows; raise the limit (ulimit -f).",
    errno.EACCES: "permission is denied; write to a folder of your own.",
    errno.EPERM: "permission is denied; write to a folder of your own.",
    errno.EROFS: "the disk is read-only; write to another disk.",
    errno.ENOENT: "its folder does not exist; make the folder first.",
    errno.ENOTDIR: "a part of its path is a file, not a folder; choose another path.",
    errno.EISDIR: "a folder of that name is in the way; choose another name or remove the folder.",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one.",
}


def atomic_write(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file whole or not at all.

    Parameters
    ----------
    path : path-like
        The file; one of that name is replaced in a single step.
    data : bytes

    Raises
    ------
    OutputError
        If it cannot be written; the file of that name, if any, is then as it was.
    """
    with atomic_path(path) as partial:
        partial.write_bytes(data)


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside the target, which becomes the target when the block ends well.

    Parameters
    ----------
    path : path-like
        The file to make.  A symbolic link is followed, so that it stays a link.

    Yields
    ------
    pathlib.Path
        An empty file in the same folder; write to it by its name, and close it inside the block.

    Raises
    ------
    OutputError
        If the file cannot be written.  After this and any other exception (`KeyboardInterrupt` too) the
        temporary file is gone and the target is as it was.
    """
    target = Path(os.path.realpath(path))
    # The random token keeps apart two processes, and two threads, that write the same file.
    partial = target.with_name(f".{target.name[:40]}.{secrets.token_hex(4)}{_SUFFIX}")
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if target.exists() and not target.is_file():
            # A rename would replace the device or the pipe itself, /dev/null for one.
            raise OutputError(f"cannot write {path}: it is a device or a pipe, not a file; choose another.")
        # With the mode of any new file, as the umask says; tempfile would let the owner alone read it.
        os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield partial
        # The content must be on the disk before the name is, or a power cut could leave the name alone.
        _sync(partial, os.O_RDWR)
        partial.replace(target)
    except OutputError:
        raise
    except OSError as error:
        # A fault of another file in the caller's block, one it reads say, is not a fault of this one.
        if error.filename is not None and os.fspath(error.filename) not in (str(partial), str(target)):
            raise
        raise OutputError(f"cannot write {path}: {_cause(error)}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()  # gone already if it was renamed
    # Some systems cannot sync a folder; the file is whole either way.
    with contextlib.suppress(OSError):
        _sync(target.parent, os.O_RDONLY)


def remove_partials(folder: str | os.PathLike[str]) -> list[Path]:
    """Remove what killed runs left in a folder; call it while nothing else writes there.

    Parameters
    ----------
    folder : path-like
        Its own files alone, not those of folders in it.

    Returns
    -------
    list of pathlib.Path
        What was removed, sorted.

    Raises
    ------
    OutputError
        If the folder cannot be read or a file cannot be removed.
    """
    try:
        # Not glob, which takes a folder that does not exist for an empty one.
        inside = sorted(Path(folder).iterdir())
        found = [p for p in inside if p.name.startswith(".") and p.name.endswith(_SUFFIX) and p.is_file()]
        for partial in found:
            partial.unlink(missing_ok=True)
    except OSError as error:
        reason = os.strerror(error.errno or 0).lower()
        raise OutputError(f"cannot clear unfinished files in {folder}: {reason}; check it.") from None
    return found


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _cause(error: OSError) -> str:
    reason = error.strerror or str(error) or "unknown fault"
    return _CAUSES.get(error.errno or 0, f"{reason[0].lower()}{reason[1:]}; try another path.")


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, where there is none; an `OutputError` if it cannot be made."""
    try:
        if folder.is_symlink() and not folder.exists():
            raise OutputError(f"{folder} is a link to a place that does not exist; name a folder.")
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file; name a folder.")
        folder.mkdir(parents=True, exist_ok=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be used: {error.strerror or error}; choose another.") from error
