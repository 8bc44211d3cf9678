"""Standard output of the commands: whole lines at once, and what to do when nobody reads them."""

from __future__ import annotations

import contextlib
import io
import os
import sys

from lithoform.errors import OutputError

__all__ = ["drop_output", "one_line", "open_output", "say"]


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


def drop_output() -> None:
    """Send the rest of standard output nowhere: the interpreter flushes it once more when it ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def one_line(error: Exception) -> str:
    """The message of an error without its line breaks."""
    text = str(error) or type(error).__name__
    return " ".join(line.strip() for line in text.splitlines() if line.strip())
