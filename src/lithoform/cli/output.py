"""Standard output of the commands: whole lines at once, and what to do when nobody reads them."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from lithoform.errors import LithoformError, OutputError

__all__ = ["can_draw", "drop_output", "one_line", "open_output", "opened", "plain_warnings", "say", "say_table"]


def open_output() -> None:
    """Let names be printed that the terminal cannot show; refuse to work for an output that is closed."""
    if sys.stdout is None:
        raise OutputError("standard output is closed; send it to a file, or to /dev/null.")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def say(text: str, *, end: str = "\n") -> None:
    """Print a result at once, so that an output that takes none is an error of the command."""
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        drop_output()
        raise OutputError(f"standard output cannot be written: {error.strerror or error}.") from None


@contextlib.contextmanager
def plain_warnings() -> Iterator[None]:
    """Warnings of a simulation as one line each, without the place in the program."""
    with warnings.catch_warnings():

        def show(message: Warning | str, *_: object, **__: object) -> None:
            print(f"lithoform: warning: {message}", file=sys.stderr)

        warnings.showwarning = show
        yield


def can_draw() -> bool:
    """Whether pictures can be drawn here; if not, why is told."""
    from lithoform.rendering import require_pictures

    try:
        require_pictures()
    except LithoformError as error:
        print(f"no picture is drawn: {error}", file=sys.stderr)
        return False
    return True


def drop_output() -> None:
    """Send the rest of standard output nowhere: the interpreter flushes it once more when it ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def one_line(error: Exception) -> str:
    """The message of an error without its line breaks."""
    text = str(error) or type(error).__name__
    return " ".join(line.strip() for line in text.splitlines() if line.strip())


@contextlib.contextmanager
def opened(path: Path | None) -> Iterator[Path | None]:
    """A file that is written when the work is done, but refused before, if it cannot be."""
    from lithoform.atomic import atomic_path

    if path is None:
        yield None
        return
    with atomic_path(path) as partial:
        yield partial


def say_table(rows: Sequence[Sequence[str]]) -> None:
    """Print rows in columns, the first to the left and the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        aligned = [row[0].ljust(widths[0]), *(w.rjust(n) for w, n in zip(row[1:], widths[1:], strict=True))]
        say("  ".join(aligned).rstrip())
