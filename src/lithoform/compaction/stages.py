"""The stages of a compaction: deposition, pressing, tilting, gyrating; each with looks, a checkpoint, and an end.

A stage that was stopped goes on from its checkpoint, and one that was finished is passed over, so that a run that is
resumed at any moment makes the same states.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import atomic_write
from lithoform.dem import Model, State, energy, simulate
from lithoform.dem.checkpoint import read_checkpoint
from lithoform.dem.observers import coordination, wall_pushes
from lithoform.errors import OutputError
from lithoform.packing.settling import let_down

__all__ = ["FLOOR", "MOULD", "PLATEN", "Look", "Record", "deposit", "look", "stage"]

FLOOR, MOULD, PLATEN = 0, 1, 2
"""Numbers of the walls."""

Look = dict[str, float]

# Wall-clock time between two checkpoints [s].
_SAVED: Final = 30.0
# Deposited stones may still creep: mean kinetic energy over m g d.
_STILL: Final = 1e-4


@dataclass
class Record:
    """Looks at a stage so far, in a file beside its checkpoint.

    Attributes
    ----------
    path : Path
        Without the endings .jsonl and .checkpoint.
    rows : list of dict
    """

    path: Path
    rows: list[Look] = field(default_factory=list)

    @property
    def checkpoint(self) -> Path:
        """File of the state."""
        return self.path.with_name(f"{self.path.name}.checkpoint")

    @property
    def file(self) -> Path:
        """File of the looks, a line of JSON each."""
        return self.path.with_name(f"{self.path.name}.jsonl")

    def resume(self, model: Model, start: State, every: int) -> State:
        """The state to go on from, with the looks until then: of the checkpoint, or the start.

        It is the start too where a look is missing, but for one at the step of the checkpoint.

        Parameters
        ----------
        model : Model
        start : State
        every : int
            Steps between two looks, the first at the start.

        Raises
        ------
        OutputError
            If the looks cannot be read.
        FileFormatError, SceneError
            As `lithoform.dem.read_checkpoint`.
        """
        self.rows.clear()
        if not (self.checkpoint.exists() and self.file.exists()):
            return self._anew(start)
        state = read_checkpoint(self.checkpoint, model)
        try:
            # A run that was killed may leave a last line that is not whole; its step is behind the checkpoint's.
            lines = self.file.read_bytes().split(b"\n")[:-1]
            rows = [{str(key): float(value) for key, value in json.loads(line).items()} for line in lines]
            self.rows += [row for row in rows if row["step"] <= state.step]
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise OutputError(f"{self.file} is damaged, the run cannot be resumed: give --overwrite to start "
                              "anew.") from error  # fmt: skip
        steps, expected = [int(row["step"]) for row in self.rows], list(range(start.step, state.step + 1, every))
        if steps != expected and (steps != expected[:-1] or expected[-1] != state.step):
            return self._anew(start)
        atomic_write(self.file, b"".join(map(_line, self.rows)))
        return state

    def _anew(self, start: State) -> State:
        self.rows.clear()
        try:
            for path in (self.checkpoint, self.file):
                path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"cannot remove {error.filename}: {error.strerror or error}.") from error
        return start

    def add(self, row: Look) -> None:
        """Note a look, once a step."""
        if not (self.rows and self.rows[-1]["step"] >= row["step"]):
            self.rows.append(row)
            try:
                with self.file.open("ab") as file:
                    file.write(_line(row))
                    # A checkpoint that outlives a power cut must have its looks.
                    file.flush()
                    os.fsync(file.fileno())
            except OSError as error:
                raise OutputError(f"cannot write {self.file}: {error.strerror or error}.") from error


def _line(row: Look) -> bytes:
    return json.dumps(row).encode() + b"\n"


def look(model: Model, state: State, gyration: float, diameter: float) -> Look:
    """What there is to see of a specimen.

    Parameters
    ----------
    model : Model
        With the platens and the mould, or without the upper platen.
    state : State
    gyration : float
        Made so far.
    diameter : float
        Of the mould [m].

    Returns
    -------
    dict of str to float
        time [s], step, gyration; height [m]: of the platen, or without it twice that of the centre of mass;
        packing_density (eq. 27); pressure, floor_pressure: on the platens over their area, lateral_pressure: of all
        pushes on the mould over its area [Pa]; coordination: contacts with stones, coordination_without_rattlers;
        kinetic, potential, elastic, work_of_platen, work_of_mould [J]; kinetic_share: over m g d.
    """
    area = 0.25 * math.pi * diameter**2
    pressed = len(model.walls) > PLATEN
    mass = float(model.mass.sum())
    height = float(state.wall_point[PLATEN, 2]) if pressed else 2.0 * float(
        (model.mass * state.position[:, 2]).sum() / mass
    )  # fmt: skip
    pushes = wall_pushes(model, state)
    touching = coordination(model, state)
    found = energy(model, state)
    weight = mass * math.hypot(*model.gravity) * 2.0 * float(np.median(model.radius))
    return {
        "time": state.time,
        "step": float(state.step),
        "gyration": gyration,
        "height": height,
        "packing_density": float(model.volume.sum()) / (area * height),
        "pressure": float(state.wall_force[PLATEN, 2]) / area if pressed else 0.0,
        "floor_pressure": -float(state.wall_force[FLOOR, 2]) / area,
        "lateral_pressure": float(pushes[MOULD]) / (math.pi * diameter * height),
        "coordination": touching["mean"],
        "coordination_without_rattlers": touching["without_rattlers"],
        "kinetic": found.kinetic,
        "potential": found.potential,
        "elastic": found.elastic,
        "work_of_platen": float(state.wall_work[PLATEN]) if pressed else 0.0,
        "work_of_mould": float(state.wall_work[MOULD]),
        "kinetic_share": found.kinetic / weight,
    }


def deposit(
    model: Model, start: State, record: Record, *, dt: float, every: int, fastest: float, longest: int, diameter: float,
    on_look: Callable[[Model, State, Look], object] = lambda *_: None, **how: Any,
) -> State:  # fmt: skip
    """Let the stones fall until they hardly move, none faster than a limit at a look.

    Parameters
    ----------
    model : Model
    start : State
    record : Record
    dt : float
        Time step [s].
    every, longest : int
        Steps between two looks, and at most.
    fastest : float
        [m/s].
    diameter : float
        Of the mould [m].
    on_look : callable
        Called with the model, the state and each new look.
    **how
        device, threads of `lithoform.dem.simulate`.
    """
    state = record.resume(model, start, every)
    while True:
        at_look = state.step % every == 0
        if at_look:
            row = look(model, state, 0.0, diameter)
            if not (record.rows and record.rows[-1]["step"] == state.step):
                record.add(row)
                on_look(model, state, row)
            last = record.rows[-3:]
            still = len(last) == 3 and last[0]["step"] > 0 and all(row["kinetic_share"] < _STILL for row in last)
            if still or state.step >= longest:
                return state
            state = let_down(state, fastest)
        end = (state.step // every + 1) * every
        state = simulate(model, state, until=end * dt, dt=dt, checkpoint=record.checkpoint, checkpoint_every=math.inf,
                         **how).state  # fmt: skip


def stage(
    model: Model, start: State, record: Record, *, dt: float, every: int, longest: int, diameter: float,
    gyrations: Callable[[int], float], done: Callable[[list[Look]], bool],
    on_look: Callable[[Model, State, Look], object] = lambda *_: None, how: Mapping[str, Any],
) -> State:  # fmt: skip
    """Simulate until looks tell that a stage is done.

    Parameters
    ----------
    model : Model
    start : State
        Where the stage begins.
    record : Record
    dt : float
        Time step [s].
    every, longest : int
        Steps between two looks, and of the stage at most.
    diameter : float
        Of the mould [m].
    gyrations : callable
        Gyrations made after so many steps of the stage.
    done : callable
        Whether the looks so far are all that are wanted.
    on_look : callable
        Called with the model, the state and each new look.
    how : mapping
        device, threads of `lithoform.dem.simulate`.
    """
    # Time counts from here, so that looks are whole numbers of intervals after the start of the stage.
    begun = replace(start, clock=(start.time, start.step, dt))
    state = record.resume(model, begun, every)
    first = begun.step

    def note(model: Model, state: State) -> None:
        row = look(model, state, gyrations(state.step - first), diameter)
        if not (record.rows and record.rows[-1]["step"] >= row["step"]):
            record.add(row)
            on_look(model, state, row)

    if (state.step - first) % every == 0:
        note(model, state)  # unless it is noted
    if done(record.rows) or state.step >= first + longest:
        return state
    return simulate(
        model, state, until=begun.time + longest * dt, dt=dt, report=every * dt, on_report=note,
        stop=lambda *_: done(record.rows), checkpoint=record.checkpoint, checkpoint_every=_SAVED, **how,
    ).state  # fmt: skip
