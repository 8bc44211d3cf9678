"""What the benchmarks share: medians of functions called in turns, on one core or all."""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator


def seconds(function: Callable[[], object]) -> float:
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


def medians(functions: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median seconds of each function, called in turns so that all meet the same weather."""
    for function in functions.values():
        function()
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            times[name].append(seconds(function))
    return {name: statistics.median(values) for name, values in times.items()}


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep this process on one processor."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def peak_memory(statement: str) -> float:
    """Peak resident memory [MB] of a fresh process that runs a statement."""
    # Not ru_maxrss, which a child takes over from the process that it was forked from.
    code = f"{statement}\nprint(*(x.split()[1] for x in open('/proc/self/status') if x.startswith('VmHWM')))"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(run.stdout.split()[-1]) / 1024
