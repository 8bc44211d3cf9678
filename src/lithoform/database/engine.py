"""Batches of work spread over processes or a cluster by Dask, or over the threads of this process.

A batch depends on its job alone, so that a batch lost with a worker is simply done again, and the results are the same
wherever they are made and in whatever order they come.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import tempfile
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from importlib.metadata import version as _version_of
from importlib.util import find_spec
from itertools import islice
from typing import Any, Final

from lithoform.errors import LithoformError, RecipeError
from lithoform.parallel import in_order
from lithoform.sidecar import program_version
from lithoform.warp_runtime import default_threads

__all__ = ["ClusterError", "has_dask", "require_workers", "spread"]

_AHEAD: Final = 2
"""Batches given out for each worker: one at work and one at hand."""

_PATIENCE: Final = 30.0
"""For a scheduler to answer and for the first worker to be there [s]."""


class ClusterError(LithoformError, RuntimeError):
    """The cluster that was asked for cannot be reached, or its workers died of a batch again and again."""


def has_dask() -> bool:
    """Whether the extra `cluster` is installed."""
    return find_spec("distributed") is not None


def require_workers(workers: int | None, scheduler: str | None) -> None:
    """Refuse workers that there cannot be, before any work; as `spread`.

    Raises
    ------
    RecipeError
        If workers is negative, or given with a scheduler.
    ClusterError
        If a scheduler is given and Dask is not installed.
    """
    if workers is not None and (scheduler is not None or workers < 0):
        raise RecipeError(f"expected --workers of at least 0, and not with --scheduler; got {workers}.")
    if scheduler is not None and not has_dask():
        raise ClusterError('a scheduler needs Dask: install it with pip install "lithoform[cluster]".')


def spread(
    work: Callable[[Any], Any], jobs: Iterable[Any], *, workers: int | None = None, scheduler: str | None = None
) -> Generator[Any, None, None]:
    """Results of a function over jobs, in the order in which they are done, in bounded memory.

    Parameters
    ----------
    work : callable
        A function of a module, which the workers import.
    jobs : iterable
        Any number of plain values; consumed two a worker ahead of the results.
    workers : int, optional
        Local processes (default: the processors that this process may use); 0 for threads of this process, which is
        also what is used where Dask is not installed.
    scheduler : str, optional
        Address of a running Dask scheduler, such as tcp://node:8786; its workers do the work.

    Yields
    ------
    object

    Raises
    ------
    RecipeError
        If workers is negative, or given with a scheduler.
    ClusterError
        If Dask is asked for and not installed, the scheduler does not answer, it has no workers, or workers died of the
        same batch more often than chance explains.
    """
    require_workers(workers, scheduler)
    if workers == 0 or not has_dask():
        return in_order(work, jobs, threads=workers or None)
    return _over_cluster(work, iter(jobs), workers or default_threads(), scheduler)


def _over_cluster(
    work: Callable[[Any], Any], jobs: Iterator[Any], workers: int, scheduler: str | None
) -> Generator[Any, None, None]:
    from distributed import KilledWorker
    from distributed.client import FutureCancelledError, FuturesCancelledError
    from distributed.comm.core import CommClosedError

    with _client(workers, scheduler) as client:
        _require_same_version(client)
        ahead = _AHEAD * max(_worker_count(client), 1)
        pending = {client.submit(work, job, pure=False) for job in islice(jobs, ahead)}
        try:
            while pending:
                finished = _first_finished(client, pending)
                pending -= finished
                for future in finished:
                    try:
                        result = future.result(timeout=_PATIENCE)
                    except TimeoutError:
                        pending.add(future)  # lost with its worker, so that it is done again
                        continue
                    pending.update(client.submit(work, job, pure=False) for job in islice(jobs, 1))
                    yield result
        except KilledWorker as error:
            raise ClusterError(
                f"workers died {error.allowed_failures + 1} times of the same batch: look at their memory and their "
                "logs; what was finished is kept."
            ) from None
        except (FutureCancelledError, FuturesCancelledError, CommClosedError):
            raise ClusterError(
                "the scheduler is gone: start it again, and give the same command; what was finished is kept."
            ) from None
        finally:
            with contextlib.suppress(CommClosedError):
                client.cancel(list(pending))


def _first_finished(client: Any, pending: set[Any]) -> set[Any]:
    """Futures that are done, at least one; an error if for a while there is no worker that could do any."""
    from distributed import wait

    alone = 0
    while True:
        with contextlib.suppress(TimeoutError):
            finished: Any = wait(pending, timeout=_PATIENCE, return_when="FIRST_COMPLETED")
            return set(finished.done)
        alone = 0 if _worker_count(client) else alone + 1
        if alone == 2:
            raise ClusterError("the cluster has no workers any more: start some, and give the same command again.")


def _worker_count(client: Any) -> int:
    return len(client.scheduler_info(n_workers=-1)["workers"])


def _require_same_version(client: Any) -> None:
    """Workers without this very program would not even fail, but wait for ever."""
    ours = program_version()
    # A function of the standard library, which every worker can load.
    for worker, version in client.run(_version_of, "lithoform", on_error="return").items():
        if version != ours:
            theirs = f"lithoform {version}" if isinstance(version, str) else "no lithoform"
            raise ClusterError(f"the worker {worker} has {theirs}, and this is {ours}: install the same there.")


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignore interrupts for the second in which processes are started, which take this over from their parent.

    A Ctrl-C is meant for this process; workers would end of it with a traceback each.  (A mask of blocked signals would
    hold it back instead, but Python's starting of processes clears it.)
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)


def _deaf_to_interrupts() -> Any:
    """The same for workers that are started later, in the place of one that died."""
    from distributed import WorkerPlugin

    class Deaf(WorkerPlugin):
        def setup(self, worker: Any) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    return Deaf()


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """A client of a running cluster, or of local processes that end with it."""
    import dask.config
    from distributed import Client, LocalCluster

    # Work never leaves this machine unless a scheduler elsewhere is named.
    settings = {"distributed.worker.memory.target": False, "distributed.worker.memory.spill": False}
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters comes as an error
        try:
            if scheduler is None:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="lithoform-"))
                with _interrupts_ignored():
                    cluster = LocalCluster(  # its dashboard on any port that is free, or two builds would want one
                        n_workers=workers, threads_per_worker=1, processes=True, memory_limit=0, host="127.0.0.1",
                        dashboard_address="127.0.0.1:0", local_directory=folder, silence_logs=logging.CRITICAL,
                    )  # fmt: skip
                    client = stack.enter_context(Client(stack.enter_context(cluster)))
                    client.register_plugin(_deaf_to_interrupts())
            else:
                client = stack.enter_context(Client(scheduler, timeout=_PATIENCE))
                client.wait_for_workers(1, timeout=_PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            where = "local workers" if scheduler is None else f"the Dask scheduler {scheduler}"
            told = " ".join(str(error).split()) or type(error).__name__
            raise ClusterError(f"{where} cannot be reached ({told}): check the address and that it runs.") from None
        yield client
