"""Progress bars with the time left, on standard error, for work that takes more than a moment."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["counted", "track"]

_T = TypeVar("_T")


def track(items: Iterable[_T], *, total: int | None, what: str, enabled: bool = True) -> Iterator[_T]:
    """Yield items while a bar shows how many are done, how fast, and the time left.

    Parameters
    ----------
    items : iterable
    total : int or None
        How many there will be, if known.
    what : str
        What they are, for the bar's label.
    enabled : bool
        False, or a standard error that is no terminal, shows nothing.

    Yields
    ------
    object
        The items.
    """
    with _bar(enabled) as bar:
        yield from bar.track(items, total=total, description=what)


@contextlib.contextmanager
def counted(total: int, *, what: str, enabled: bool = True) -> Iterator[Callable[[int], None]]:
    """A bar for work that is done in pieces of different sizes.

    Parameters
    ----------
    total : int
        How much there is to do.
    what : str
        Label of the bar.
    enabled : bool
        As in `track`.

    Yields
    ------
    callable
        To be called with how much more has been done.
    """
    if not enabled:
        yield lambda _: None
        return
    with _bar(enabled) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.advance(task, done)


def _bar(enabled: bool) -> Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=console, disable=not (enabled and console.is_terminal), transient=True)
