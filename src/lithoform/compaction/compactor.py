"""The compactor: stones fall into the mould, a platen presses them, the mould gyrates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.compaction.fitting import PowerLaw, fit_power_law
from lithoform.compaction.mould import Gyration
from lithoform.compaction.protocol import Protocol
from lithoform.compaction.specimen import Specimen
from lithoform.compaction.stages import FLOOR, MOULD, PLATEN, Look, Record, deposit, stage
from lithoform.dem import TABLE_10, Model, Plane, Scales, Servo, State, scales
from lithoform.dem.container import extents
from lithoform.packing.container import Container
from lithoform.packing.placing import insert, random_attitudes
from lithoform.packing.settling import schedule

__all__ = ["LOOKS", "STAGES", "Compaction", "Machine", "compact"]

STAGES: Final = ("deposition", "seating", "pressing", "tilting", "gyration")
"""Names of the stages, in their order."""

LOOKS: Final = 32
"""Looks in a gyration."""

# The platen first comes down with this share of its force, so that the stone that it meets first does not carry all.
_SEATING: Final = 0.05
# The mould is tilted in this share of a gyration.
_RAMP: Final = 0.25
# The bed carries the pressure when so many looks in turn are within this share of it, and it got lower by less than
# this share of its height in them.
_CARRIES, _HELD, _CREEP = 8, 0.01, 2e-4
# Time between two looks while the platen comes down, at least, and how many there are at most; time that it is given
# after it should be down [s].
_PRESS_LOOK, _PRESS_LOOKS, _PRESS_MORE = 5e-4, 500, 0.3
# The platen's mass over that of the stones, and its damping [s]; see `Machine.servo`.
_PLATEN_MASS, _PLATEN_TIME, _PLATEN_SPEED = 0.5, 2e-3, 1.0
# The platen comes down so that the inertial number under its pressure stays below this.
_QUASI_STATIC: Final = 2e-3


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Settings of the compactor for a specimen.

    Attributes
    ----------
    specimen : Specimen
    protocol : Protocol
    rate_factor : float
        On the rate of gyration.
    seed : int
        Of places and attitudes.
    bed_stiffness_factor : float or None
        On Young's modulus of Table 10 while the stones fall; None: that of the specimen.
    """

    specimen: Specimen
    protocol: Protocol
    rate_factor: float
    seed: int
    bed_stiffness_factor: float | None = None

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return scales(self.specimen.model).step

    @property
    def falling(self) -> Model:
        """The stones while they fall."""
        if self.bed_stiffness_factor is None:
            return self.specimen.model
        return replace(self.specimen.model, materials=(TABLE_10.softened(self.bed_stiffness_factor),))

    @property
    def force(self) -> float:
        """Of the upper platen [N]."""
        return self.protocol.pressure * self.specimen.area

    @property
    def every(self) -> int:
        """Steps between two looks at a gyration; they divide it, so that its frequency is rounded."""
        return max(1, round(60.0 / (self.protocol.rate * self.rate_factor) / LOOKS / self.dt))

    @property
    def frequency(self) -> float:
        """Gyrations per second [1/s]."""
        return 1.0 / (LOOKS * self.every * self.dt)

    @property
    def target(self) -> float:
        """Height at which the run ends [m]."""
        return self.protocol.height * self.specimen.height_scale

    @property
    def loose_height(self) -> float:
        """Height at which pressing ends, if the platen gets there [m]."""
        return self.protocol.loose_height * self.specimen.height_scale

    @property
    def servo(self) -> Servo:
        """Of the upper platen.

        It is light, so that the force on it is that asked for but for m a, and damped, so that it does not bounce.
        """
        return Servo(force=self.force, mass=_PLATEN_MASS * float(self.specimen.model.mass.sum()), time=_PLATEN_TIME,
                     max_speed=_PLATEN_SPEED)  # fmt: skip

    @property
    def approach(self) -> float:
        """Speed of the platen on its way down [m/s]."""
        diameter = 2.0 * float(np.median(self.specimen.model.radius))
        density = float(self.specimen.model.density.mean())
        rate = _QUASI_STATIC / (diameter * math.sqrt(density / self.protocol.pressure))
        return min(_PLATEN_SPEED, rate * self.loose_height)

    @property
    def expected_steps(self) -> int:
        """Of the whole run, about: the fall, the platen coming down by half of the loose height, the gyrations."""
        fall = schedule(self.falling, _loose(self), scales(self.falling).step).expected
        press = 0.5 * self.loose_height / self.approach / self.dt
        return round(fall + press + (_RAMP + self.protocol.gyrations) * LOOKS * self.every)

    def scales(self, *, steps: int = 0, threads: int | None = None) -> Scales:
        """Time scales of the gyrations, with the cost of so many steps."""
        # A layer at height z goes round a circle of radius z tan(angle): the rate of shear turns, its size is constant.
        return scales(self.specimen.model, self.protocol.pressure, 2.0 * math.pi * self.protocol.shear * self.frequency,
                      duration=steps * self.dt, dt=self.dt, threads=threads)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Compaction:
    """A specimen that has been compacted.

    Attributes
    ----------
    machine : Machine
    model, state
        At the end.
    gyration : Gyration
        Of the mould.
    looks : dict of str to list of dict
        Looks at each stage: `lithoform.compaction.stages.look`.
    fit : PowerLaw or None
        None after less than three gyrations.
    reached : bool
        Whether the height was reached.
    notes : tuple of str
    """

    machine: Machine
    model: Model
    state: State
    gyration: Gyration
    looks: Mapping[str, list[Look]]
    fit: PowerLaw | None
    reached: bool
    notes: tuple[str, ...]

    @property
    def series(self) -> dict[str, np.ndarray]:
        """Looks at whole gyrations, from 0 on: columns of the looks by name."""
        rows = [row for row in self.looks["gyration"] if abs(row["gyration"] - round(row["gyration"])) < 1e-6]
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@dataclass
class _Progress:
    told: Callable[[str], object]
    begin: Callable[[str, int, int], object]
    on_look: Callable[[str, Model, State, Look], object]
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        self.notes.append(text)
        self.told(text)

    def of(self, name: str) -> Callable[[Model, State, Look], object]:
        return lambda model, state, row: self.on_look(name, model, state, row)


def compact(
    machine: Machine, folder: Path, *, told: Callable[[str], object] = lambda _: None,
    on_begin: Callable[[str, int, int], object] = lambda *_: None,
    on_look: Callable[[str, Model, State, Look], object] = lambda *_: None,
    on_stage: Callable[[str, Model, State], object] = lambda *_: None, **how: Any,
) -> Compaction:  # fmt: skip
    """Compact a specimen, or go on with it where the folder holds checkpoints of it.

    Parameters
    ----------
    machine : Machine
    folder : Path
        For checkpoints and looks.
    told : callable
        Is told what happens, a sentence at a time.
    on_begin : callable
        Called with the name of each stage, the step at which it begins, and the steps that it takes at most.
    on_look : callable
        Called with the stage, the model, the state and each new look.
    on_stage : callable
        Called with the name of each stage, the model and the state at its end.
    **how
        device, threads of `lithoform.dem.simulate`.

    Raises
    ------
    SceneError
        If the stones do not fit into the mould.
    SimulationError
        If the simulation fails.
    """
    specimen, dt, falling = machine.specimen, machine.dt, machine.falling
    progress = _Progress(told, on_begin, on_look)
    records = {name: Record(folder / name) for name in STAGES}
    common: dict[str, Any] = {"dt": dt, "diameter": specimen.diameter}

    start, fall_dt = _loose(machine), scales(falling).step
    plan = schedule(falling, start, fall_dt)
    progress.begin("deposition", 0, plan.steps)
    state = deposit(falling, start, records["deposition"], dt=fall_dt, every=plan.every, fastest=plan.fastest,
                    longest=plan.steps, diameter=specimen.diameter, on_look=progress.of("deposition"),
                    **how)  # fmt: skip
    on_stage("deposition", falling, state)

    model, state = _under_platen(machine, state)
    state = _press(machine, model, state, _SEATING, records["seating"], progress, common, how)
    on_stage("seating", model, state)
    model = model.with_motion(PLATEN, _coming_down(machine, 1.0))
    state = _press(machine, model, state, 1.0, records["pressing"], progress, common, how)
    progress.note(_pressed(machine, records["pressing"].rows))
    on_stage("pressing", model, state)
    pressed = records["pressing"].rows[-1]

    ramp = max(1, round(_RAMP * LOOKS)) * machine.every
    gyration = Gyration(angle=math.radians(machine.protocol.angle), frequency=machine.frequency,
                        apex=0.5 * pressed["height"], ramp=ramp * dt)  # fmt: skip
    # The platen may now be as fast as it takes to hold its force.
    model = model.with_motion(PLATEN, machine.servo)
    progress.begin("tilting", state.step, ramp)
    state = stage(model.with_motion(MOULD, gyration.tilting), state, records["tilting"], every=machine.every,
                  longest=ramp, gyrations=lambda _: 0.0, done=lambda _: False, on_look=progress.of("tilting"), how=how,
                  **common)  # fmt: skip
    on_stage("tilting", model, state)
    model = model.with_motion(MOULD, gyration.precessing)
    longest = machine.protocol.gyrations * LOOKS * machine.every
    progress.begin("gyration", state.step, longest)
    state = stage(model, state, records["gyration"], every=machine.every, longest=longest,
                  gyrations=lambda steps: steps / (LOOKS * machine.every),
                  done=lambda rows: rows[-1]["height"] <= machine.target, on_look=progress.of("gyration"), how=how,
                  **common)  # fmt: skip
    on_stage("gyration", model, state)
    return _finished(machine, model, state, gyration, records, progress)


def _loose(machine: Machine) -> State:
    """Stones above the floor of the mould."""
    model, specimen = machine.specimen.model, machine.specimen
    rng = np.random.default_rng([machine.seed, 1])
    places = insert(model.bounding_radius, Container((specimen.diameter,), 1.0), rng)
    return State.at_rest(model, places, random_attitudes(model.count, rng))


def _under_platen(machine: Machine, state: State) -> tuple[Model, State]:
    """The upper platen just above the highest stone, coming down lightly."""
    model = machine.specimen.model
    top = float(extents(model, state, np.array([0.0, 0.0, 1.0]))[:, 1].max())
    platen = Plane(point=(0.0, 0.0, top + 1e-3 * machine.specimen.diameter), normal=(0.0, 0.0, -1.0),
                   motion=_coming_down(machine, _SEATING))  # fmt: skip
    model = model.with_walls(model.walls[FLOOR], model.walls[MOULD], platen)
    return model, state.with_walls_of(model)


def _coming_down(machine: Machine, share: float) -> Servo:
    """The platen with a share of its force, slow enough for its way down."""
    return replace(machine.servo, force=share * machine.force, max_speed=machine.approach)


def _press(
    machine: Machine, model: Model, state: State, share: float, record: Record, progress: _Progress,
    common: dict[str, Any], how: Mapping[str, Any],
) -> State:  # fmt: skip
    """Press with a share of the pressure until the bed carries it, or the loose height is reached."""
    height = float(state.wall_point[PLATEN, 2])
    every = max(1, round(max(_PRESS_LOOK, height / machine.approach / _PRESS_LOOKS) / machine.dt))
    longest = math.ceil((height / machine.approach + _PRESS_MORE) / (every * machine.dt)) * every
    pressure = share * machine.protocol.pressure
    progress.begin(record.path.name, state.step, longest)
    return stage(
        model, state, record, every=every, longest=longest, gyrations=lambda _: 0.0,
        done=lambda rows: rows[-1]["height"] <= machine.loose_height or _carries(rows, pressure),
        on_look=progress.of(record.path.name), how=how, **common,
    )  # fmt: skip


def _carries(rows: list[Look], pressure: float) -> bool:
    """Whether the bed carries a pressure [Pa]: in the last looks the platen had it, and hardly moved."""
    last = rows[-_CARRIES:]
    held = all(abs(row["pressure"] / pressure - 1.0) < _HELD for row in last)
    return len(last) == _CARRIES and held and last[0]["height"] - last[-1]["height"] < _CREEP * last[-1]["height"]


def _pressed(machine: Machine, rows: list[Look]) -> str:
    """How pressing ended."""
    last, pressure = rows[-1], machine.protocol.pressure
    if last["height"] <= machine.loose_height:
        why = f"the height of {1e3 * machine.loose_height:.2f} mm was reached"
    elif _carries(rows, pressure):
        why = f"the bed carries {pressure / 1e3:g} kPa"
    else:
        why = "its time was over, and the bed still creeps"
    return f"Pressing ended at {1e3 * last['height']:.2f} mm, packing density {last['packing_density']:.4f}: {why}."


def _finished(
    machine: Machine, model: Model, state: State, gyration: Gyration, records: Mapping[str, Record], progress: _Progress
) -> Compaction:
    looks = {name: record.rows for name, record in records.items()}
    last = looks["gyration"][-1]
    reached = last["height"] <= machine.target
    # A height that the stones without voids would not have asks for the gyrations alone.
    if not reached and machine.specimen.density(machine.target) < 1.0:
        progress.note(
            f"The height of {1e3 * machine.target:.2f} mm was not reached in {last['gyration']:g} gyrations: the "
            f"specimen is {1e3 * last['height']:.2f} mm high. All that was reached is kept; --resume with more "
            "--gyrations goes on."
        )
    whole = [row for row in looks["gyration"] if abs(row["gyration"] - round(row["gyration"])) < 1e-6]
    made = [row for row in whole if row["gyration"] >= 1.0]
    fit = fit_power_law([row["gyration"] for row in made], [row["height"] for row in made]) if len(made) >= 3 else None
    if fit is None:
        progress.note(f"{len(made)} whole gyrations are too few to fit H = A G^B: at least three are needed.")
    return Compaction(machine, model, state, gyration, looks, fit, reached, tuple(progress.notes))
