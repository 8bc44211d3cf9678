"""Progress bars with the time left, on standard error, for work that takes more than a moment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

__all__ = ["track"]

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
    with Progress(*columns, console=console, disable=not (enabled and console.is_terminal), transient=True) as bar:
        yield from bar.track(items, total=total, description=what)
