"""Work over threads in the order of the items, in bounded memory.

Threads, not processes: the kernels, Qhull and the file system release the interpreter's lock, and meshes need not be
copied.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from numbers import Integral
from typing import TypeVar

from lithoform.warp_runtime import default_threads

__all__ = ["in_order"]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def in_order(
    work: Callable[[_Item], _Result], items: Iterable[_Item], *, threads: int | None = None
) -> Generator[_Result, None, None]:
    """Results of a function over items, computed by threads, yielded in the order of the items.

    Parameters
    ----------
    work : callable
        Called once an item, in a worker thread.
    items : iterable
        Any number; consumed two a thread ahead of the results, so that no thread waits and memory does not grow.
    threads : int, optional
        Default: the processors that this process may use.

    Yields
    ------
    object
        What `work` returns; what it raises is raised in its place, and the rest is cancelled.

    Raises
    ------
    ValueError
        If threads is not a whole number of at least 1.
    """
    count = default_threads() if threads is None else threads
    if not isinstance(count, Integral) or count < 1:
        raise ValueError(f"expected at least one thread, as a whole number; got {threads!r}.")
    return _stream(work, iter(items), count)


def _stream(work: Callable[[_Item], _Result], items: Iterator[_Item], threads: int) -> Generator[_Result, None, None]:
    pending: deque[Future[_Result]] = deque()
    executor = ThreadPoolExecutor(threads, thread_name_prefix="lithoform")
    try:
        pending.extend(executor.submit(work, item) for item in islice(items, 2 * threads))
        while pending:
            result = pending.popleft().result()
            pending.extend(executor.submit(work, item) for item in islice(items, 1))
            yield result
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
