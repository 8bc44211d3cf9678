"""What changes in a simulation: poses, momenta, contacts, walls, time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from lithoform.dem.arrays import CANDIDATES
from lithoform.dem.model import Model
from lithoform.dem.walls import Motion
from lithoform.errors import SceneError

__all__ = ["State"]

# A wall may be put this deep into a block, in radii: what a specimen under load has.
IN_WALL = 0.05

# Arrays of a state: name, type, and shape in blocks (n), walls (k), pairs (p), contacts with walls (n k).
FIELDS: Mapping[str, tuple[str, tuple[str | int, ...]]] = {
    "position": ("f8", ("n", 3)),
    "orientation": ("f8", ("n", 4)),
    "velocity": ("f8", ("n", 3)),
    "angular_momentum": ("f8", ("n", 3)),
    "spin": ("f8", ("n", 3)),
    "velocity_ahead": ("f8", ("n", 3)),
    "spin_ahead": ("f8", ("n", 3)),
    "force": ("f8", ("n", 3)),
    "torque": ("f8", ("n", 3)),
    "travel": ("f8", ("n",)),
    "origin": ("f8", ("n", 3)),
    "origin_orientation": ("f8", ("n", 4)),
    "pair": ("i4", ("p", 2)),
    "simplex": ("i4", ("p", 7)),
    "limit": ("f8", ("p",)),
    "contact_radius": ("f8", ("p",)),
    "spring": ("f8", ("p", 3)),
    "twist": ("f8", ("p", 3)),
    "normal": ("f8", ("p", 3)),
    "contact_force": ("f8", ("p", 3)),
    "wall_point": ("f8", ("k", 3)),
    "wall_direction": ("f8", ("k", 3)),
    "wall_pivot": ("f8", ("k", 3)),
    "wall_motion": ("f8", ("k", 9)),
    "wall_radius": ("f8", ("k",)),
    "wall_speed": ("f8", ("k",)),
    "wall_force": ("f8", ("k", 3)),
    "wall_work": ("f8", ("k",)),
    "wall_power": ("f8", ("k",)),
    "wall_candidates": ("i4", ("nk", CANDIDATES)),
    "wall_candidate_count": ("i4", ("nk",)),
    "wall_budget": ("f8", ("nk",)),
    "wall_contact_radius": ("f8", ("nk",)),
    "wall_spring": ("f8", ("nk", 3)),
    "wall_twist": ("f8", ("nk", 3)),
    "wall_contact_force": ("f8", ("nk", 3)),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """All that a step depends on. World's frame and SI units; arrays are read-only.

    Attributes
    ----------
    step : int
        Steps made.
    clock : tuple of (float, int, float)
        Time [s] and step at which the present time step began to be used, and that time step [s].
    lag : float
        By how much the velocities and momenta are behind the positions [s]: 0 at the start, half a step later.
    fresh : bool
        Whether pairs of blocks are yet to be looked for.
    blocks : str
        Fingerprint of the shapes and the blocks of the model that the state belongs to.
    position : numpy.ndarray, shape (n, 3)
        Centres of mass [m].
    orientation : numpy.ndarray, shape (n, 4)
        Unit quaternions (x, y, z, w) from the frame of the shape to the world's.
    velocity, angular_momentum : numpy.ndarray, shape (n, 3)
        [m/s], and about the centre of mass [kg m^2/s].
    spin : numpy.ndarray, shape (n, 3)
        Angular velocity that the contacts of the next step see [rad/s]: that of the orientation half a step back, which
        cannot be found again from the rest to the last bit.
    velocity_ahead, spin_ahead : numpy.ndarray, shape (n, 3)
        Velocities at the time of the positions, forecast by the last forces [m/s], [rad/s].
    force, torque : numpy.ndarray, shape (n, 3)
        Of the last step [N], [N m].
    pair : numpy.ndarray of int, shape (p, 2)
        Neighbouring blocks i < j, sorted.
    contact_radius : numpy.ndarray, shape (p,)
        [m]; 0 where they do not touch.
    normal, contact_force : numpy.ndarray, shape (p, 3)
        From i to j; on i [N].
    spring, twist : numpy.ndarray, shape (p, 3)
        Tangential force [N] and rolling moment [N m] that the contact keeps.
    wall_point, wall_direction, wall_pivot : numpy.ndarray, shape (k, 3)
        Where the walls are [m].
    wall_motion : numpy.ndarray, shape (k, 9)
        Velocity, angular velocity and pivot of the motion to which the pivot belongs.
    wall_radius : numpy.ndarray, shape (k,)
        Of a cylinder [m]; 0 for a plane.
    wall_speed : numpy.ndarray, shape (k,)
        Of a servo along its normal [m/s].
    wall_force : numpy.ndarray, shape (k, 3)
        Of the blocks on each wall in the last step [N].
    wall_work : numpy.ndarray, shape (k,)
        Of each wall on the blocks since the start [J]; wall_power : in the last step [W].
    wall_contact_radius : numpy.ndarray, shape (n k,)
        Contact of block i with wall w at i k + w [m]; wall_contact_force : on the block [N], shape (n k, 3).
    others
        What the search for contacts keeps: see `lithoform.dem.arrays`.
    """

    step: int
    clock: tuple[float, int, float]
    lag: float
    fresh: bool
    blocks: str
    position: np.ndarray
    orientation: np.ndarray
    velocity: np.ndarray
    angular_momentum: np.ndarray
    spin: np.ndarray
    velocity_ahead: np.ndarray
    spin_ahead: np.ndarray
    force: np.ndarray
    torque: np.ndarray
    travel: np.ndarray
    origin: np.ndarray
    origin_orientation: np.ndarray
    pair: np.ndarray
    simplex: np.ndarray
    limit: np.ndarray
    contact_radius: np.ndarray
    spring: np.ndarray
    twist: np.ndarray
    normal: np.ndarray
    contact_force: np.ndarray
    wall_point: np.ndarray
    wall_direction: np.ndarray
    wall_pivot: np.ndarray
    wall_motion: np.ndarray
    wall_radius: np.ndarray
    wall_speed: np.ndarray
    wall_force: np.ndarray
    wall_work: np.ndarray
    wall_power: np.ndarray
    wall_candidates: np.ndarray
    wall_candidate_count: np.ndarray
    wall_budget: np.ndarray
    wall_contact_radius: np.ndarray
    wall_spring: np.ndarray
    wall_twist: np.ndarray
    wall_contact_force: np.ndarray

    def __post_init__(self) -> None:
        n, k, p = len(self.position), len(self.wall_point), len(self.pair)
        sizes = {"n": n, "k": k, "p": p, "nk": n * k}
        for name, (kind, dimensions) in FIELDS.items():
            array = np.ascontiguousarray(getattr(self, name), dtype=kind)
            expected = tuple(sizes[d] if isinstance(d, str) else d for d in dimensions)
            if array.shape != expected:
                raise SceneError(f"expected {name.replace('_', ' ')} of shape {expected}, got {array.shape}.")
            if kind == "f8" and name != "limit" and not np.isfinite(array).all():
                bad = int(np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))[0])
                raise SceneError(
                    f"expected finite numbers, but {name.replace('_', ' ')} {bad} is {array[bad].tolist()}."
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def time(self) -> float:
        """[s]: of the positions."""
        begin, step, dt = self.clock
        # A product, not a sum of steps, so that it does not matter in how many pieces a run was made.
        return begin + (self.step - step) * dt

    @classmethod
    def at_rest(
        cls,
        model: Model,
        position: ArrayLike,
        orientation: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None,
    ) -> State:
        """Blocks where they are put, at time 0; at rest unless velocities are given.

        Parameters
        ----------
        model : Model
        position : array_like, shape (n, 3)
            Centres of mass [m].
        orientation : array_like, shape (n, 4), optional
            Quaternions (x, y, z, w), made unit; by default the shape's frame is the world's.
        velocity, angular_velocity : array_like, shape (n, 3), optional
            [m/s], [rad/s], world's frame.

        Raises
        ------
        SceneError
            If a number is missing or not finite.
        """
        n, k = model.count, len(model.walls)
        zero = np.zeros((n, 3))
        position = _rows(position, (n, 3), "position")
        turn = (
            np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)) if orientation is None else _rows(orientation, (n, 4), "orientation")
        )
        length = np.linalg.norm(turn, axis=1, keepdims=True)
        if not (length > 0.0).all():
            raise SceneError("expected quaternions that are not zero, one for each block.")
        turn = turn / length
        spin = zero if angular_velocity is None else _rows(angular_velocity, (n, 3), "angular velocity")
        momentum = rotate(turn, rotate_back(turn, spin) * model.inertia)
        given = {
            "position": position,
            "orientation": turn,
            "velocity": zero if velocity is None else _rows(velocity, (n, 3), "velocity"),
            "angular_momentum": momentum,
            "spin": spin,
            "spin_ahead": spin,
            "velocity_ahead": zero if velocity is None else _rows(velocity, (n, 3), "velocity"),
            "origin": position,
            "origin_orientation": turn,
            **placed_walls(model),
        }
        sizes = {"n": n, "k": k, "p": 0, "nk": n * k}
        empty = {
            name: np.zeros(tuple(sizes[d] if isinstance(d, str) else d for d in dimensions), dtype=kind)
            for name, (kind, dimensions) in FIELDS.items()
        }
        return cls(
            step=0, clock=(0.0, 0, 0.0), lag=0.0, fresh=True, blocks=model.block_fingerprint, **{**empty, **given}
        )

    def with_walls_of(self, model: Model) -> State:
        """The same blocks and their contacts between the walls of a model.

        A wall that is as it was, where it is, keeps its number and its contacts; others are placed anew.

        Raises
        ------
        SceneError
            If the model has other blocks, or a wall that is placed would be inside a block.
        """
        from lithoform.dem.clearances import deepest_in_walls

        self.require_blocks_of(model)
        n, k = len(self.position), len(model.walls)
        placed = placed_walls(model)
        both = min(k, len(self.wall_point))
        stays = np.zeros(k, dtype=bool)
        stays[:both] = np.all(
            [
                (placed[name][:both] == getattr(self, name)[:both]).reshape(both, -1).all(axis=1)
                for name in ("wall_point", "wall_direction", "wall_radius")
            ],
            axis=0,
        )
        depth, block, wall = deepest_in_walls(
            model, self.position, self.orientation, placed["wall_point"], placed["wall_direction"], ~stays
        )
        if depth > IN_WALL:
            raise SceneError(f"expected walls around the blocks, but block {block} would be "
                             f"{depth * model.radius[block]:.3g} m inside wall {wall}: move that wall.")  # fmt: skip
        kept = np.flatnonzero(stays)
        walls = {}
        for name, (kind, dimensions) in FIELDS.items():
            if name.startswith("wall_"):
                rows = n if dimensions[0] == "nk" else 1
                rest = tuple(int(d) for d in dimensions[1:])
                array = np.zeros((rows, k, *rest), dtype=kind)
                if name in placed:
                    array[0] = placed[name]
                array[:, kept] = getattr(self, name).reshape(rows, -1, *rest)[:, kept]
                walls[name] = array.reshape(-1, *rest)
        return replace(self, **walls)

    def require_blocks_of(self, model: Model) -> None:
        """Refuse a model with other blocks than those of the state.

        Raises
        ------
        SceneError
        """
        if len(self.position) != model.count:
            raise SceneError(
                f"expected a state of {model.count} blocks, got one of {len(self.position)}: make it with "
                "State.at_rest."
            )
        if self.blocks != model.block_fingerprint:
            raise SceneError(
                "expected a state of the model's own blocks, got one of blocks of other shapes or sizes: make it with "
                "State.at_rest."
            )

    def require_model(self, model: Model) -> None:
        """Refuse a model of which this is no state: other blocks, other walls, indices that point nowhere.

        Raises
        ------
        SceneError
        """
        self.require_blocks_of(model)
        if len(self.wall_point) != len(model.walls) or not np.array_equal(self.wall_radius, wall_radii(model)):
            raise SceneError(
                f"expected a state with the model's {len(model.walls)} walls, got one with "
                f"{len(self.wall_point)} walls, or of other kinds or radii: make it with with_walls_of."
            )
        numbers = (*self.clock, self.lag)
        if not (np.isfinite(numbers).all() and self.clock[1] <= self.step and self.clock[2] >= 0.0 <= self.lag):
            raise SceneError(
                f"expected a finite clock and lag, got {self.clock!r} and {self.lag!r}: take a state as a run left it."
            )
        if not _points_somewhere(self.arrays(), model):
            raise SceneError("expected pairs of the model's blocks and vertices of their shapes; the state's indices "
                             "point elsewhere: take a state as a run left it.")  # fmt: skip

    def angular_velocity(self, model: Model) -> np.ndarray:
        """[rad/s], world's frame, shape (n, 3)."""
        return rotate(self.orientation, rotate_back(self.orientation, self.angular_momentum) / model.inertia)

    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name, in the order of the fields."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name in FIELDS}


def placed_walls(model: Model) -> dict[str, np.ndarray]:
    """Where the walls of a model are at the start."""
    pivots = [getattr(wall.motion, "pivot", wall.point) for wall in model.walls]
    return {
        "wall_point": np.array([wall.point for wall in model.walls]).reshape(-1, 3),
        "wall_direction": np.array([wall.direction for wall in model.walls]).reshape(-1, 3),
        "wall_pivot": np.array(pivots, dtype=np.float64).reshape(-1, 3),
        "wall_motion": motions_of(model),
        "wall_radius": wall_radii(model),
    }


def wall_radii(model: Model) -> np.ndarray:
    """Radius of each cylinder [m], 0 for planes, shape (k,)."""
    return np.array([getattr(wall, "radius", 0.0) for wall in model.walls], dtype=np.float64)


def motions_of(model: Model) -> np.ndarray:
    """Velocity, angular velocity and pivot of each wall's prescribed motion, shape (k, 9); 0 for a servo."""
    rows = [
        (*wall.motion.velocity, *wall.motion.angular_velocity, *wall.motion.pivot)
        if isinstance(wall.motion, Motion)
        else (0.0,) * 9
        for wall in model.walls
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 9)


def _points_somewhere(arrays: Mapping[str, np.ndarray], model: Model) -> bool:
    """Whether all indices are of blocks and vertices of the model: the kernels go where they say without looking."""
    vertices = np.array([len(shape.core.vertices) for shape in model.shapes])[model.shape]
    pair, simplex = arrays["pair"], arrays["simplex"]
    if not ((pair >= 0) & (pair < model.count)).all() or not (pair[:, 0] < pair[:, 1]).all():
        return False
    candidates = arrays["wall_candidates"].reshape(model.count, -1)
    limits = [
        (simplex[:, 0], 4),
        (simplex[:, 1:4], vertices[pair[:, :1]]),
        (simplex[:, 4:7], vertices[pair[:, 1:]]),
        (candidates, vertices[:, None]),
        (arrays["wall_candidate_count"], CANDIDATES + 1),
    ]
    return all(((values >= 0) & (values < limit)).all() for values, limit in limits)


def rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors, shape (n, 3), turned by unit quaternions (x, y, z, w), shape (n, 4)."""
    u, w = quaternion[:, :3], quaternion[:, 3:]
    t = 2.0 * np.cross(u, vector)
    return vector + w * t + np.cross(u, t)


def rotate_back(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors turned by the inverse of unit quaternions."""
    return rotate(quaternion * [-1.0, -1.0, -1.0, 1.0], vector)


def _rows(values: ArrayLike, shape: tuple[int, int], what: str) -> np.ndarray:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise SceneError(f"expected a {what} for each block, shape {shape}; got shape {array.shape}.")
    if not np.isfinite(array).all():
        bad = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise SceneError(f"expected finite numbers, but the {what} of block {bad} is {array[bad].tolist()}.")
    return array
