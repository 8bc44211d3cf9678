"""Whose turn it is: of a page's requests for one thing the newest wins, and those of a closed page are dropped."""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from lithoform.errors import LithoformError

__all__ = ["POLL", "SupersededError", "Ticket", "Turns"]

_PAGE: Final = re.compile(r"[0-9a-zA-Z-]{1,64}", re.ASCII)
_CHANNELS: Final = ("studio", "space", "sheet", "stone", "file")
POLL: Final = 0.02
"""Time between two looks at whether work that waits is still wanted [s]."""

_REMEMBERED: Final = 2000  # pages and channels


class SupersededError(LithoformError):
    """The work is no longer wanted: a newer request came, or the page was closed."""


@dataclass(frozen=True)
class Ticket:
    """A request's place among those of its page and channel."""

    turns: Turns
    key: tuple[str, str]
    turn: int

    def require(self) -> None:
        """Raise `SupersededError` if the work is no longer wanted."""
        self.turns.require(self)

    @contextlib.contextmanager
    def working(self) -> Iterator[None]:
        """Hold one of the places for work; who is overtaken while waiting leaves."""
        with self.turns.place(self):
            yield


class Turns:
    """Newest turn of every page and channel, and the places for work.

    Parameters
    ----------
    places : int
        Pieces of work done at the same time.
    """

    def __init__(self, places: int) -> None:
        self._lock = threading.Lock()
        self._newest: OrderedDict[tuple[str, str], float] = OrderedDict()
        self._places = threading.BoundedSemaphore(places)
        self._count = places
        self._working = 0
        self._is_open = True

    def enter(self, page: Any, channel: Any, turn: Any) -> Ticket:
        """A place for a request, by the name and turn that its page gives.

        Raises
        ------
        LithoformError
            If they are no name, channel and whole number.
        SupersededError
            If a newer one is there already.
        """
        if not isinstance(page, str) or not _PAGE.fullmatch(page) or channel not in _CHANNELS:
            raise LithoformError("expected the name of a page and a channel; reload the page.")
        if isinstance(turn, bool) or not isinstance(turn, int) or not 0 <= turn < 2**53:
            raise LithoformError("expected the turn of a request, a whole number; reload the page.")
        ticket = Ticket(self, (page, channel), turn)
        with self._lock:
            if turn > self._newest.get(ticket.key, -1):
                self._newest[ticket.key] = turn
            self._newest.move_to_end(ticket.key)
            while len(self._newest) > _REMEMBERED:
                self._newest.popitem(last=False)
        ticket.require()
        return ticket

    def close(self, page: Any) -> None:
        """Drop all the work of a page."""
        with self._lock:
            for channel in _CHANNELS if isinstance(page, str) and _PAGE.fullmatch(page) else ():
                self._newest[page, channel] = math.inf

    def stop(self, patience: float = 10.0) -> bool:
        """Drop all work; whether what was in progress ended within a time [s]."""
        with self._lock:
            self._is_open = False
        end = time.monotonic() + patience
        taken = sum(self._places.acquire(timeout=max(end - time.monotonic(), 0.0)) for _ in range(self._count))
        return taken == self._count

    @property
    def working(self) -> int:
        """Pieces of work in progress."""
        with self._lock:
            return self._working

    def require(self, ticket: Ticket) -> None:
        """As `Ticket.require`."""
        with self._lock:
            if not self._is_open or self._newest.get(ticket.key, ticket.turn) > ticket.turn:
                raise SupersededError("a newer request took the place of this one.")

    @contextlib.contextmanager
    def place(self, ticket: Ticket) -> Iterator[None]:
        """As `Ticket.working`."""
        while not self._places.acquire(timeout=POLL):
            self.require(ticket)
        try:
            self.require(ticket)
            with self._lock:
                self._working += 1
            try:
                yield
            finally:
                with self._lock:
                    self._working -= 1
        finally:
            self._places.release()
