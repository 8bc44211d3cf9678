"""Run a model from a state to a time, with reports, checkpoints and progress."""

from __future__ import annotations

import contextlib
import math
import signal
import sys
import threading
import time as clock
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lithoform.dem.energy import EnergyMonitor, energy
from lithoform.dem.engine import Engine
from lithoform.dem.faults import fault_of, refuse_in_walls, refuse_overlaps
from lithoform.dem.model import Model
from lithoform.dem.scales import LARGEST_STEP, STEP, rayleigh_time, scales
from lithoform.dem.state import State
from lithoform.errors import SceneError
from lithoform.progress import counted
from lithoform.warp_runtime import resolve_device

__all__ = ["Observer", "Run", "simulate"]

Observer = Callable[[Model, State], Mapping[str, float]]

# Wall-clock time between two looks at the clock, the keyboard and the progress [s].
_LAUNCH = 0.2


@dataclass(frozen=True, eq=False)
class Run:
    """What a simulation gives.

    Attributes
    ----------
    state : State
        At the end.
    table : dict of str to numpy.ndarray
        A row a report: time [s], step, and the columns of the observers.
    dt : float
        Time step used [s].
    seconds : float
        Wall-clock time [s].
    energy_growth : float
        By how much energy less work has grown at most between reports [J]; 0 as it must be, but for rounding.
    """

    state: State
    table: dict[str, np.ndarray]
    dt: float
    seconds: float
    energy_growth: float = 0.0


@dataclass
class _Rows:
    columns: dict[str, list[float]] = field(default_factory=dict)

    def add(self, row: Mapping[str, float]) -> None:
        for name, value in row.items():
            self.columns.setdefault(name, []).append(value)

    def table(self) -> dict[str, np.ndarray]:
        return {name: np.array(values) for name, values in self.columns.items()}


def simulate(
    model: Model,
    state: State,
    *,
    until: float,
    dt: float | None = None,
    report: float | None = None,
    observers: Mapping[str, Observer] | None = None,
    on_report: Callable[[Model, State], object] | None = None,
    stop: Callable[[Model, State], bool] | None = None,
    checkpoint: Path | None = None,
    checkpoint_every: float = 60.0,
    device: str = "auto",
    threads: int | None = None,
    progress: bool = False,
) -> Run:
    """Simulate until a time.

    Parameters
    ----------
    model : Model
    state : State
        It is not changed.
    until : float
        End [s], in the time of the state.
    dt : float, optional
        Time step [s]; by default 0.06 of the least Rayleigh time.
    report : float, optional
        Time between reports [s]; by default only at the end.
    observers : mapping of str to callable, optional
        Each gives numbers by name; they are columns of the table, as `name` or `name_key`.
    on_report : callable, optional
        Called at each report, as a writer of files.
    stop : callable, optional
        Called at each report; where it is true the run ends.
    checkpoint : path, optional
        File that is written from time to time and at the end; see `lithoform.dem.checkpoint`.
    checkpoint_every : float
        Wall-clock time between checkpoints [s].
    device : {"auto", "cpu", "cuda"}
    threads : int, optional
        On a processor; by default all. The result does not depend on it.
    progress : bool
        Whether to tell the time scales and the cost (`lithoform.dem.scales`) and to show a bar with the time left.

    Returns
    -------
    Run

    Raises
    ------
    SceneError
        If a time or the time step makes no sense, or the state is not one of the model.
    SimulationError
        If the blocks overlap at the start, leave the walls, or the motion is no number any more.
    """
    dt = _time_step(model, dt)
    # A run ends with the first step at or after its end, so that a finished one may be asked for again.
    if not (math.isfinite(until) and until > state.time - max(dt, state.clock[2]) * (1.0 + 1e-6)):
        raise SceneError(f"expected an end of at least the state's time, {state.time:.6g} s; got {until!r}.")
    if report is not None and not (math.isfinite(report) and report > 0.0):
        raise SceneError(f"expected a positive time between reports, got {report!r}.")
    if threads is not None and threads < 1:
        raise SceneError(f"expected at least one thread, got {threads}.")
    state.require_model(model)
    if state.step == 0:
        refuse_in_walls(model, state)
    end = state.step + max(0, math.ceil((until - state.time) / dt - 1e-6))
    every = 0 if report is None else max(1, round(report / dt))
    if progress and end > state.step:
        found = scales(model, dt=dt, duration=(end - state.step) * dt, threads=threads)
        sys.stderr.write(f"{model.count} blocks: {found.text()}.\n")
    rows, monitor = _Rows(), EnergyMonitor()
    begin = clock.perf_counter()
    saved = begin

    def reported(now: State) -> bool:
        energies = energy(model, now)
        monitor.look(energies, now.time)
        row: dict[str, float] = {"time": now.time, "step": now.step}
        for name, observer in (observers or {}).items():
            for key, value in observer(model, now).items():
                row[f"{name}_{key}" if key else name] = value
        rows.add(row)
        if on_report is not None:
            on_report(model, now)
        return stop is not None and stop(model, now)

    with (
        Engine(model, state, dt, device=resolve_device(device), threads=threads) as engine,
        counted(end - state.step, what="steps", enabled=progress) as advance,
        _interrupts_between_launches() as interrupted,
    ):
        if state.fresh:
            engine.find_pairs()
            refuse_overlaps(model, *engine.gaps)
        batch, ended, looked = 16, False, False
        try:
            if engine.step == end:
                reported(engine.state())
            while engine.step < end and not ended:
                next_report = end if report is None else min(end, _next(engine.step, engine.clock[1], every))
                asked = min(batch, next_report - engine.step)
                launched = clock.perf_counter()
                made = engine.run(asked)
                spent = clock.perf_counter() - launched
                if made.flags:
                    raise fault_of(engine, made.flags)
                advance(made.steps)
                if not looked:
                    # After the first step, since the contacts of blocks that are put down are not yet known before.
                    now, looked = engine.state(), True
                    monitor.look(energy(model, now), now.time)
                if made.steps == asked == batch:
                    batch = max(1, min(4 * batch, int(batch * _LAUNCH / max(spent, 1e-6))))
                if engine.step == next_report:
                    ended = reported(engine.state())
                # After the report, since the run goes on behind this step.
                if interrupted():
                    raise KeyboardInterrupt
                if checkpoint is not None and clock.perf_counter() - saved > checkpoint_every:
                    _save(checkpoint, model, engine.state())
                    saved = clock.perf_counter()
        finally:
            # Interrupted or done, what has been computed is kept; after a fault the last checkpoint is the good one.
            final = engine.state() if not engine.faulty else None
            if checkpoint is not None and final is not None:
                _save(checkpoint, model, final)
        if interrupted():
            raise KeyboardInterrupt
    assert final is not None
    return Run(final, rows.table(), dt, clock.perf_counter() - begin, monitor.growth)


@contextlib.contextmanager
def _interrupts_between_launches() -> Iterator[Callable[[], bool]]:
    """Hold Ctrl-C back until the step that is being made is whole."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    came = threading.Event()
    former = signal.signal(signal.SIGINT, lambda *_: came.set())
    try:
        yield came.is_set
    finally:
        signal.signal(signal.SIGINT, former)


def _next(step: int, begin: int, every: int) -> int:
    """Step of the next report: counted from where the time step began to be used, as by a run that is resumed."""
    return begin + ((step - begin) // every + 1) * every


def _time_step(model: Model, dt: float | None) -> float:
    least = min(
        rayleigh_time(float(model.radius[model.material == m].min()), model.materials[m])
        for m in {int(m) for m in model.material}
    )
    if dt is None:
        return STEP * least
    if not (math.isfinite(dt) and dt > 0.0):
        raise SceneError(f"expected a positive time step, got {dt!r}.")
    if dt > LARGEST_STEP * least:
        raise SceneError(
            f"expected a time step of at most {LARGEST_STEP:g} of the least Rayleigh time, "
            f"{LARGEST_STEP * least:.3g} s; got {dt:.3g} s ({dt / least:.2g} of it): leave it out to take {STEP:g} of "
            "it."
        )
    return dt


def _save(path: Path, model: Model, state: State) -> None:
    from lithoform.dem.checkpoint import write_checkpoint

    write_checkpoint(path, model, state)
