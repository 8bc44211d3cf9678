"""Stones fall and come to rest: in intervals, between which they are looked at, and a run can be stopped and go on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lithoform.dem import Energy, Model, State, energy, simulate
from lithoform.dem.energy import EnergyMonitor
from lithoform.dem.materials import pair_constants
from lithoform.errors import SceneError

__all__ = [
    "AT_REST", "LOOK", "UNBALANCED", "Schedule", "fastest_fall", "is_at_rest", "let_down", "look", "schedule", "settle",
]  # fmt: skip

AT_REST = 1e-6
"""A stone is at rest when its kinetic energy is below this share of m g d, d the median diameter ..."""

UNBALANCED = 0.01
"""... and the resultant force on it below this share of the mean contact force."""

LOOK = ("time", "step", "kinetic", "potential", "elastic", "kinetic_share", "kinetic_most", "unbalanced", "contacts",
        "height", "fastest")  # fmt: skip
"""What a look tells, by name."""

# So many of the stones have to be at rest, for so many looks in turn, and the mean kinetic energy of all has to be
# below this many times the share. Not all of them: nothing brakes a stone that spins upright on a single contact.
_MOST, _LOOKS, _MEAN = 0.95, 3, 10.0
# Stones fall as if let go from this many median diameters.
_DROP = 5.0
# A head-on impact on a wall is at most this deep, in roundings of the stone.
_DEEPEST = 0.5
# Between two looks a stone that falls at the limit gains this share of it.
_GAIN = 0.05
# What settling takes after the last stone has come down, in sqrt(d / g): seen, for the time left; and the most.
_USUAL, _LONGEST = 12.0, 100.0
# More steps take years.
_MOST_STEPS = 10_000_000_000


@dataclass(frozen=True)
class Schedule:
    """When a settling run is looked at, and when it ends at the latest.

    Attributes
    ----------
    dt : float
        Time step [s].
    every : int
        Steps between two looks.
    fastest : float
        No stone falls faster than this after a look [m/s].
    steps : int
        At the latest.
    expected : int
        Steps that it will take, roughly.
    """

    dt: float
    every: int
    fastest: float
    steps: int
    expected: int


def fastest_fall(model: Model) -> float:
    """Speed that no stone exceeds on its way down [m/s]: it is poured, not thrown.

    The speed after a fall of five median diameters; or less, so that an impact on a wall (that of Hertz, without
    damping) is no deeper than half of the rounding of the stone, which softened stones would otherwise exceed.

    Parameters
    ----------
    model : Model
    """
    drop = _DROP * 2.0 * float(np.median(model.radius))
    from_drop = math.sqrt(2.0 * math.hypot(*model.gravity) * drop)
    material = model.materials[0]
    modulus = pair_constants(material, material)["modulus"]
    # Hertz: m v^2 / 2 = (8/15) E* sqrt(r) depth^(5/2).
    stored = 8.0 / 15.0 * modulus * np.sqrt(model.radius) * (_DEEPEST * model.margin) ** 2.5
    return min(from_drop, float(np.sqrt(2.0 * stored / model.mass).min()))


def schedule(model: Model, state: State, dt: float, until: float | None = None) -> Schedule:
    """Schedule of a column of stones that is about to fall.

    Parameters
    ----------
    model : Model
    state : State
        At the start.
    dt : float
        Time step [s].
    until : float, optional
        Latest end [s]; by default long after the stones should be at rest.

    Raises
    ------
    SceneError
        If that takes more than 10,000,000,000 steps.
    """
    gravity = math.hypot(*model.gravity)
    fastest = fastest_fall(model)
    # The column becomes about half as high, and its top goes down at the limit.
    fall = 0.5 * float(state.position[:, 2].max()) / fastest + fastest / gravity
    unit = math.sqrt(2.0 * float(np.median(model.radius)) / gravity)
    usual = fall + _USUAL * unit
    needed = (usual if until is None else until) / dt
    if needed > _MOST_STEPS:
        what, way = f"until they rest, about {usual:.3g} s,", "a longer --dt or a larger --gravity"
        if until is not None:
            what, way = f"--until {until:g}", "a longer --dt or an earlier --until"
        told = f"{needed:.2g}" if math.isfinite(needed) else "far more"
        raise SceneError(
            f"expected a packing of at most {_MOST_STEPS:,} steps; {what} takes {told} of {dt:.3g} s: give {way}."
        )
    every = max(1, round(min(_GAIN * fastest / gravity / dt, _MOST_STEPS)))
    if until is None:
        steps = max(1, math.ceil(min((fall + _LONGEST * unit) / dt, _MOST_STEPS) / every)) * every
    else:
        steps = max(1, math.ceil(needed - 1e-6))
    expected = math.ceil(min(usual / dt, _MOST_STEPS) / every) * every
    return Schedule(dt, every, fastest, steps, min(steps, expected))


def let_down(state: State, fastest: float) -> State:
    """The state with no stone faster than a limit; the state itself where none is."""
    speed = np.sqrt((state.velocity**2).sum(axis=1))
    # The tolerance makes a second call change nothing, so that a run that goes on from here is the same.
    over = speed > fastest * (1.0 + 1e-9)
    if not over.any():
        return state
    velocity = state.velocity.copy()
    velocity[over] *= (fastest / speed[over])[:, None]
    return replace(state, velocity=velocity)


def look(model: Model, state: State) -> dict[str, float]:
    """How far a packing has settled.

    Returns
    -------
    dict of str to float
        time [s], step; kinetic, potential, elastic [J]; kinetic_share: mean kinetic energy over m g d;
        kinetic_most, unbalanced: what 95 of 100 stones do not exceed of kinetic energy over m g d, and of resultant
        over mean contact force; contacts: among stones, per stone; height: twice that of the centre of mass [m];
        fastest: speed [m/s].
    """
    found = energy(model, state)
    unit = model.mass * math.hypot(*model.gravity) * 2.0 * float(np.median(model.radius))
    kinetic = _kinetic(model, state) / unit
    resultant = np.sort(np.sqrt((state.force**2).sum(axis=1)))
    most = math.ceil(_MOST * model.count) - 1
    forces = np.concatenate([
        np.sqrt((state.contact_force[state.contact_radius > 0.0] ** 2).sum(axis=1)),
        np.sqrt((state.wall_contact_force[state.wall_contact_radius > 0.0] ** 2).sum(axis=1)),
    ])  # fmt: skip
    return {
        "time": state.time,
        "step": state.step,
        "kinetic": found.kinetic,
        "potential": found.potential,
        "elastic": found.elastic,
        "kinetic_share": float(kinetic.mean()),
        "kinetic_most": float(np.sort(kinetic)[most]),
        "unbalanced": float(resultant[most] / forces.mean()) if len(forces) else 1.0,
        "contacts": 2.0 * float((state.contact_radius > 0.0).sum()) / model.count,
        "height": 2.0 * float((model.mass * state.position[:, 2]).sum() / model.mass.sum()),
        "fastest": float(np.sqrt((state.velocity**2).sum(axis=1)).max()),
    }


def is_at_rest(rows: list[dict[str, float]]) -> bool:
    """Whether the last looks all found the stones at rest."""
    last = rows[-_LOOKS:]
    return len(last) == _LOOKS and all(
        row["step"] > 0  # at the very start nothing moves
        and row["kinetic_most"] < AT_REST
        and row["kinetic_share"] < _MEAN * AT_REST
        and row["unbalanced"] < UNBALANCED
        for row in last
    )


def _watch(monitor: EnergyMonitor, row: dict[str, float]) -> None:
    # The walls stand still and do no work.
    monitor.look(Energy(row["kinetic"], row["potential"], row["elastic"], 0.0), row["time"])


def _kinetic(model: Model, state: State) -> np.ndarray:
    """Kinetic energy of each stone [J], shape (n,)."""
    spin = (state.angular_velocity(model) * state.angular_momentum).sum(axis=1)
    return 0.5 * (model.mass * (state.velocity**2).sum(axis=1) + spin)


def settle(
    model: Model,
    state: State,
    plan: Schedule,
    rows: list[dict[str, float]],
    *,
    checkpoint: Path | None = None,
    on_look: Callable[[Model, State, int], object] | None = None,
    advance: Callable[[int], None] = lambda _: None,
    device: str = "auto",
    threads: int | None = None,
) -> State:
    """Simulate until the stones are at rest, or the plan ends.

    Parameters
    ----------
    model : Model
    state : State
        At the start, or of a run that was stopped.
    plan : Schedule
    rows : list of dict
        Looks so far; each new one is added, those after the state are dropped.
    checkpoint : Path, optional
        File that is written at each look, and when the run is interrupted.
    on_look : callable, optional
        Called with the model, the state and the number of the look after each look, the one at the start as 0.
    advance : callable
        Called with the steps made, for a bar.
    device, threads
        As `lithoform.dem.simulate`.

    Returns
    -------
    State
        The last, at a look; `is_at_rest(rows)` tells whether it is at rest. An `EnergyWarning` tells if the energy
        grew on the way.
    """
    rows[:] = [row for row in rows if row["step"] <= state.step]
    monitor = EnergyMonitor()
    for row in rows:
        _watch(monitor, row)
    while True:
        at_look = state.step % plan.every == 0 or state.step >= plan.steps
        if at_look and not (rows and rows[-1]["step"] == state.step):
            rows.append(look(model, state))
            _watch(monitor, rows[-1])
            if on_look is not None:
                on_look(model, state, len(rows) - 1)
        if at_look and (is_at_rest(rows) or state.step >= plan.steps):
            return state
        if at_look:
            state = let_down(state, plan.fastest)
        end = min(plan.steps, (state.step // plan.every + 1) * plan.every)
        run = simulate(
            model, state, until=end * plan.dt, dt=plan.dt, checkpoint=checkpoint, checkpoint_every=math.inf,
            device=device, threads=threads,
        )  # fmt: skip
        advance(run.state.step - state.step)
        state = run.state
