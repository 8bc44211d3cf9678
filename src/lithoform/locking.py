"""One run at a time in a folder: a lock of the operating system, which ends with the process that holds it."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from lithoform.errors import OutputError

__all__ = ["LOCK_FILE", "folder_lock"]

LOCK_FILE: Final = ".lithoform.lock"

_HELD_ELSEWHERE: Final = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)
# Some network disks cannot lock at all; a run there goes on without.
_NO_LOCKS: Final = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextlib.contextmanager
def folder_lock(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Hold a folder for this process alone while the block runs.

    Parameters
    ----------
    folder : path-like
        It must exist.  The lock is on a file in it, `LOCK_FILE`, which is removed at the end; one that a killed
        process left behind is no obstacle.

    Raises
    ------
    OutputError
        If another run holds the folder, or no file can be made in it.
    """
    path = Path(folder) / LOCK_FILE
    try:
        descriptor = _acquire(path)
    except OSError as error:
        raise OutputError(f"the folder {folder} cannot be used: {error.strerror or error}.") from error
    if descriptor is None:
        raise OutputError(f"another run is writing into {folder}; wait for it or choose another folder.")
    try:
        yield
    finally:
        # Removed while it is held, so that nobody else's is; Windows removes no open file.
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(descriptor)
        if sys.platform == "win32":
            with contextlib.suppress(OSError):
                path.unlink()


def _acquire(path: Path) -> int | None:
    """Descriptor of the lock file once it is locked; None where another process holds it."""
    while True:
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        with contextlib.ExitStack() as unless_held:
            unless_held.callback(os.close, descriptor)
            is_locked = _try_lock(descriptor)
            # The former holder may have removed the file between the opening and the locking: then begin again.
            if is_locked and _is_the_file(descriptor, path):
                unless_held.pop_all()
                return descriptor
        if not is_locked:
            return None


def _try_lock(descriptor: int) -> bool:
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD_ELSEWHERE:
            return False
        if error.errno not in _NO_LOCKS:
            raise
    return True


def _is_the_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
