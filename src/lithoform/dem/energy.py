"""Mechanical energy of a state, and a monitor that says when it grows from nothing."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from lithoform.dem.materials import pair_constants
from lithoform.dem.model import Model
from lithoform.dem.state import State, rotate_back

__all__ = ["Energy", "EnergyMonitor", "EnergyWarning", "energy"]

# Energy may seem to grow by this share of what is in play: leapfrog conserves it on average, not in each step.
_TOLERANCE = 2e-3


class EnergyWarning(UserWarning):
    """The energy of a simulation grew without work done on it."""


@dataclass(frozen=True)
class Energy:
    """Energies of all blocks [J] at the time of the last evaluation of the forces.

    Attributes
    ----------
    kinetic : float
        Of translation and rotation.
    potential : float
        In the field of gravity, 0 at the origin.
    elastic : float
        In the contacts: normal (with adhesion, 0 where the surfaces meet), tangential and rolling.
    work : float
        That the walls have done on the blocks.
    """

    kinetic: float
    potential: float
    elastic: float
    work: float

    @property
    def total(self) -> float:
        """Kinetic, potential and elastic energy."""
        return self.kinetic + self.potential + self.elastic


def energy(model: Model, state: State) -> Energy:
    """Energy of a state.

    Positions, velocities and contacts are brought to one time, that of the last evaluation of the forces, a step back.

    Parameters
    ----------
    model : Model
    state : State
    """
    lag = state.lag
    velocity = state.velocity - state.force / model.mass[:, None] * lag
    momentum = state.angular_momentum - state.torque * lag
    position = state.position - state.velocity * (2.0 * lag)
    local = rotate_back(state.orientation, momentum)
    kinetic = 0.5 * float((model.mass * (velocity**2).sum(axis=1)).sum() + (local**2 / model.inertia).sum())
    potential = -float((model.mass * (position @ np.asarray(model.gravity))).sum())
    return Energy(kinetic, potential, _elastic(model, state), float(state.wall_work.sum()))


def _elastic(model: Model, state: State) -> float:
    from lithoform.dem.observers import contacts

    normal = contacts(model, state).normal
    on = state.contact_radius > 0.0
    i, j = state.pair[on].T
    radius = model.radius[i] * model.radius[j] / (model.radius[i] + model.radius[j])
    total = _stored(model, model.material[i], model.material[j], radius, state.contact_radius[on], state.spring[on],
                    state.twist[on], normal[: on.sum()])  # fmt: skip
    if model.walls:
        walls = len(model.walls)
        touching = np.flatnonzero(state.wall_contact_radius > 0.0)
        block = touching // walls
        of_walls = np.array([wall.material for wall in model.walls])[touching % walls]
        total += _stored(model, model.material[block], of_walls, model.radius[block],
                         state.wall_contact_radius[touching], state.wall_spring[touching],
                         state.wall_twist[touching], normal[on.sum() :])  # fmt: skip
    return total


def _stored(
    model: Model, a: np.ndarray, b: np.ndarray, radius: np.ndarray, disc: np.ndarray, spring: np.ndarray,
    twist: np.ndarray, normal: np.ndarray,
) -> float:  # fmt: skip
    from lithoform.dem.jkr import potential

    total = 0.0
    for first, second in {*zip(a.tolist(), b.tolist(), strict=True)}:
        mine = (a == first) & (b == second)
        given = model.pairs.get((first, second), model.pairs.get((second, first)))
        law = pair_constants(model.materials[first], model.materials[second], given)
        r, c = radius[mine], disc[mine]
        stiffness = 8.0 * law["shear"] * c
        total += float(potential(c, law["modulus"], r, law["energy"]).sum())
        total += float((0.5 * (spring[mine] ** 2).sum(axis=1) / stiffness).sum())
        about = (twist[mine] * normal[mine]).sum(axis=1)
        rolling = np.maximum((twist[mine] ** 2).sum(axis=1) - about**2, 0.0)
        total += float((0.5 * rolling / (stiffness * r * r) + 0.5 * about**2 / (stiffness * c * c)).sum())
    return total


class EnergyMonitor:
    """Watches energy less work from report to report and warns when it grows."""

    def __init__(self) -> None:
        self._least: float | None = None
        self._largest = 0.0
        self._told = 0.0
        self.growth = 0.0

    def look(self, now: Energy, time: float) -> None:
        """Take a report into account.

        Parameters
        ----------
        now : Energy
        time : float
            [s], for the warning.
        """
        left = now.total - now.work
        if self._least is None:
            self._least = left
            self._first = left
        # What is in play: what moves, what is stored, what has been turned into heat, what the walls put in.
        self._largest = max(self._largest, now.kinetic + abs(now.elastic), abs(now.work), self._first - left)
        grown = max(0.0, left - self._least)
        # Told again only where it is twice as much.
        if grown > _TOLERANCE * self._largest and grown > 2.0 * self._told:
            self._told = grown
            warnings.warn(
                f"the energy grew by {grown:.3g} J without work until t = {time:.4g} s "
                f"({grown / self._largest:.1%} of what is in play): take a smaller time step.",
                EnergyWarning,
                stacklevel=3,
            )
        self.growth = max(self.growth, grown)
        self._least = min(self._least, left)
