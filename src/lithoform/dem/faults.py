"""Faults that the kernels flag, as one clear error with the blocks, the time and the way out."""

from __future__ import annotations

import numpy as np

from lithoform.dem.arrays import CORES_OVERLAP, MOVES_TOO_FAR, NOT_FINITE, OUTSIDE, TOO_DEEP
from lithoform.dem.clearances import deepest_in_walls
from lithoform.dem.engine import Engine
from lithoform.dem.model import Model
from lithoform.dem.state import State
from lithoform.errors import SimulationError

__all__ = ["fault_of", "refuse_in_walls", "refuse_overlaps"]

# Blocks that are put down may overlap by this share of their effective radius: what rounding and settling leave.
_AT_START = 0.01

_SAID = {
    OUTSIDE: "the centre of block {block} is outside a wall",
    TOO_DEEP: "block {block} is deeper in a wall than three times its rounding ({margin:.3g} m)",
    MOVES_TOO_FAR: "block {block} moves by more than half of its rounding ({margin:.3g} m) in one step",
    NOT_FINITE: "the motion of block {block} is no number any more",
}
_WAY_OUT = (
    "take a smaller time step, a stiffer material or a smaller load, or check where the blocks and walls were put"
)


def fault_of(engine: Engine, flags: int) -> SimulationError:
    """The error of a launch that ended with a fault: of the first pair or block that has one.

    Parameters
    ----------
    engine : Engine
    flags : int
        Of the launch.
    """
    time = engine.time
    pair_flags, block_flags = engine.scene.pairs.flags.numpy(), engine.scene.blocks.flags.numpy()
    bad = np.flatnonzero(pair_flags & (CORES_OVERLAP | NOT_FINITE))
    if len(bad):
        p = int(bad[0])
        i, j = int(engine.scene.pairs.first.numpy()[p]), int(engine.scene.pairs.second.numpy()[p])
        depth = float(engine.model.margin[i] + engine.model.margin[j])
        what = f"the cores of blocks {i} and {j} overlap: they are in each other by more than {depth:.3g} m"
        if pair_flags[p] & NOT_FINITE:
            what = f"the distance of blocks {i} and {j} is no number any more"
        return _error(what, time, (i, j), len(bad))
    bad = np.flatnonzero(block_flags)
    if len(bad):
        i = int(bad[0])
        kind = next(flag for flag in _SAID if block_flags[i] & flag)
        return _error(_SAID[kind].format(block=i, margin=float(engine.model.margin[i])), time, (i,), len(bad))
    return _error(f"the kernels reported fault {flags}", time, (), 1)


def refuse_overlaps(model: Model, pair: np.ndarray, gaps: np.ndarray) -> None:
    """Refuse blocks that are put down inside one another.

    Parameters
    ----------
    model : Model
    pair : numpy.ndarray, shape (m, 2)
    gaps : numpy.ndarray, shape (m,)
        [m]; negative where they overlap.

    Raises
    ------
    SimulationError
        With the deepest pair.
    """
    if not len(pair):
        return
    i, j = pair.T
    radius = model.radius[i] * model.radius[j] / (model.radius[i] + model.radius[j])
    depth = -gaps / radius
    worst = int(depth.argmax())
    if depth[worst] > _AT_START:
        a, b = int(i[worst]), int(j[worst])
        count = int((depth > _AT_START).sum())
        raise SimulationError(
            f"blocks {a} and {b} overlap by {-gaps[worst]:.3g} m or more at the start{_others(count)}: put them "
            "farther apart.",
            time=0.0,
            bodies=(a, b),
        )


def refuse_in_walls(model: Model, state: State) -> None:
    """Refuse blocks that are put down inside a wall.

    Parameters
    ----------
    model : Model
    state : State

    Raises
    ------
    SimulationError
        With the deepest block; one whose centre is outside is told by the first step.
    """
    depth, block, wall = deepest_in_walls(
        model, state.position, state.orientation, state.wall_point, state.wall_direction
    )
    if depth > _AT_START:
        raise SimulationError(
            f"block {block} is {depth * model.radius[block]:.3g} m inside wall {wall} at the start: put it farther in.",
            time=state.time,
            bodies=(block,),
        )


def _error(what: str, time: float, bodies: tuple[int, ...], count: int) -> SimulationError:
    return SimulationError(f"{what} at t = {time:.6g} s{_others(count)}: {_WAY_OUT}.", time=time, bodies=bodies)


def _others(count: int) -> str:
    return "" if count == 1 else f" (and {count - 1} more)"
