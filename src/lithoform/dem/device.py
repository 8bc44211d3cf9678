"""A model and a state as arrays of a device, and back."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from lithoform.dem.arrays import CANDIDATES, CHUNK, CYLINDER, PLANE, Blocks, Pairs, Scene, Walls
from lithoform.dem.broadphase import neighbour_entries
from lithoform.dem.clearances import shared_depths
from lithoform.dem.contact import PairLaw
from lithoform.dem.gjk import Hulls, Simplex
from lithoform.dem.materials import pair_constants
from lithoform.dem.model import Model
from lithoform.dem.state import FIELDS, State, motions_of, placed_walls
from lithoform.dem.walls import Cylinder, Motion, Servo
from lithoform.warp_runtime import wp

__all__ = ["build_pairs", "build_scene", "read_scene", "to_array"]

_BLOCK_FIELDS = ("position", "orientation", "velocity", "angular_momentum", "force", "torque", "travel", "origin",
                 "origin_orientation")  # fmt: skip
_PAIR_FIELDS = {"limit": "limit", "contact_radius": "radius", "spring": "spring", "twist": "twist", "normal": "normal",
                "contact_force": "force"}  # fmt: skip
_WALL_FIELDS = ("wall_point", "wall_direction", "wall_pivot", "wall_speed", "wall_force", "wall_work",
                "wall_candidate_count", "wall_budget", "wall_spring", "wall_twist")  # fmt: skip


def to_array(values: Any, dtype: Any, device: str) -> Any:
    """Array of a device with a copy of the values."""
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)


def build_scene(model: Model, state: State, *, dt: float, half_skin: float, device: str) -> Any:
    """The scene of the kernels: a model and a state in the memory of a device.

    Parameters
    ----------
    model : Model
    state : State
    dt : float
        Time step [s].
    half_skin : float
        Displacement of a block at which the pairs are stale [m].
    device : str
        Warp's name of it.
    """
    scene = Scene()
    scene.dt = dt
    scene.gravity = wp.vec3d(*model.gravity)
    scene.damping = model.local_damping
    scene.half_skin = half_skin
    scene.materials = len(model.materials)
    scene.laws = _laws(model, device)
    scene.hulls = _hulls(model, device)
    scene.blocks = _blocks(model, state, device)
    scene.pairs = build_pairs(state.pair, {
        "simplex": np.ascontiguousarray(state.simplex).view(Simplex.numpy_dtype()).ravel(),
        **{source: getattr(state, name) for name, source in _PAIR_FIELDS.items()},
    }, device)  # fmt: skip
    scene.walls = _walls(model, state, dt, device)
    return scene


def _laws(model: Model, device: str) -> Any:
    materials = model.materials
    laws = []
    for a, first in enumerate(materials):
        for b, second in enumerate(materials):
            given = model.pairs.get((a, b), model.pairs.get((b, a)))
            law = PairLaw()
            for name, value in pair_constants(first, second, given).items():
                setattr(law, name, value)
            laws.append(law)
    return wp.array(laws, dtype=PairLaw, device=device)


def _hulls(model: Model, device: str) -> Any:
    put = partial(to_array, device=device)
    cores = [shape.core for shape in model.shapes]
    first = np.cumsum([0, *(len(core.vertices) for core in cores)])
    starts, entries, total = [], [], 0
    for core in cores:
        begin, neighbours = core.adjacency
        starts.append(begin[:-1] + total)
        entries.append(neighbours)
        total += len(neighbours)
    hulls = Hulls()
    hulls.vertices = put(np.concatenate([core.vertices for core in cores]), wp.vec3d)
    hulls.first = put(first.astype(np.int32), wp.int32)
    hulls.adjacency_first = put(np.concatenate([*starts, [total]]).astype(np.int32), wp.int32)
    # An empty array would be no array: spheres have no neighbours.
    hulls.adjacency = put(np.concatenate([*entries, [0]]).astype(np.int32), wp.int32)
    return hulls


def _blocks(model: Model, state: State, device: str) -> Any:
    put, blocks = partial(to_array, device=device), Blocks()
    for name in ("shape", "material"):
        setattr(blocks, name, put(getattr(model, name), wp.int32))
    for name, values in (("scale", model.scale), ("mass", model.mass), ("radius", model.radius),
                         ("bound", model.bounding_radius), ("margin", model.margin)):  # fmt: skip
        setattr(blocks, name, put(values, wp.float64))
    blocks.inertia = put(model.inertia, wp.vec3d)
    blocks.angular_velocity = put(state.spin, wp.vec3d)
    blocks.velocity_ahead, blocks.spin_ahead = put(state.velocity_ahead, wp.vec3d), put(state.spin_ahead, wp.vec3d)
    for name in _BLOCK_FIELDS:
        dtype = wp.quatd if "orientation" in name else wp.float64 if name == "travel" else wp.vec3d
        setattr(blocks, name, put(getattr(state, name), dtype))
    blocks.flags = wp.zeros(model.count, dtype=wp.int32, device=device)
    first, entries = neighbour_entries(state.pair, model.count)
    blocks.entry_first, blocks.entries = put(first, wp.int32), put(entries, wp.int32)
    return blocks


def build_pairs(pair: np.ndarray, given: dict[str, np.ndarray], device: str) -> Any:
    """Pairs of a device: what is not given is 0.

    Parameters
    ----------
    pair : numpy.ndarray, shape (m, 2)
    given : dict of str to numpy.ndarray
        By the names of `lithoform.dem.arrays.Pairs`.
    device : str
    """
    put, pairs = partial(to_array, device=device), Pairs()
    count = len(pair)
    pairs.first, pairs.second = (put(pair[:, side].astype(np.int32), wp.int32) for side in (0, 1))
    for name, dtype in (("simplex", Simplex), ("limit", wp.float64), ("radius", wp.float64), ("spring", wp.vec3d),
                        ("twist", wp.vec3d), ("normal", wp.vec3d), ("force", wp.vec3d), ("torque_first", wp.vec3d),
                        ("torque_second", wp.vec3d), ("flags", wp.int32)):  # fmt: skip
        empty = wp.zeros(count, dtype=dtype, device=device)
        setattr(pairs, name, put(given[name], dtype) if name in given and count else empty)
    return pairs


def _walls(model: Model, state: State, dt: float, device: str) -> Any:
    put, walls = partial(to_array, device=device), Walls()
    count = len(model.walls)
    motions = [wall.motion if isinstance(wall.motion, Motion) else Motion() for wall in model.walls]
    servos = [wall.motion if isinstance(wall.motion, Servo) else None for wall in model.walls]
    walls.count = count
    same_motion = (state.wall_motion == motions_of(model)).all(axis=1)
    integers = {
        "kind": [CYLINDER if isinstance(wall, Cylinder) else PLANE for wall in model.walls],
        "material": [wall.material for wall in model.walls],
        "nutates": [motion.nutates for motion in motions],
        "servo": [servo is not None for servo in servos],
        "candidates": state.wall_candidates.ravel(),
        "candidate_count": state.wall_candidate_count,
    }
    numbers = {
        "cylinder_radius": [getattr(wall, "radius", 0.0) for wall in model.walls],
        "pace": [math.hypot(*motion.velocity) for motion in motions],
        "turning": [math.hypot(*motion.angular_velocity) for motion in motions],
        "servo_force": [servo.force if servo else 0.0 for servo in servos],
        "servo_mass": [servo.mass if servo else 1.0 for servo in servos],
        "servo_rate": [1.0 / servo.time if servo else 0.0 for servo in servos],
        "servo_speed": [servo.max_speed if servo else 0.0 for servo in servos],
        "speed": np.where([servo is not None for servo in servos], state.wall_speed, 0.0),
        "work": state.wall_work,
        "present_power": state.wall_power,
        "budget": state.wall_budget,
        "radius": state.wall_contact_radius,
        "shared": shared_depths(model, dt).ravel(),
        "power": np.zeros(model.count * count),
        "chunk_power": np.zeros(math.ceil(model.count / CHUNK) * count),
    }
    vectors = {
        "point": state.wall_point,
        "direction": state.wall_direction,
        "velocity": [motion.velocity for motion in motions],
        "angular_velocity": [motion.angular_velocity for motion in motions],
        # A new motion has its own pivot; that of the former one has been carried along.
        "pivot": np.where(same_motion[:, None], state.wall_pivot, placed_walls(model)["wall_pivot"]),
        "force": state.wall_force,
        "spring": state.wall_spring,
        "twist": state.wall_twist,
        "push": state.wall_contact_force,
        "chunk_force": np.zeros((math.ceil(model.count / CHUNK) * count, 3)),
    }
    for group, kind, dtype in ((integers, np.int32, wp.int32), (numbers, np.float64, wp.float64)):
        for name, values in group.items():
            setattr(walls, name, put(np.asarray(values, dtype=kind), dtype))
    for name, values in vectors.items():
        setattr(walls, name, put(np.asarray(values, dtype=np.float64).reshape(-1, 3), wp.vec3d))
    walls.turn = put(np.array([_turn(motion, dt) for motion in motions]).reshape(-1, 3, 3), wp.mat33d)
    return walls


def read_scene(scene: Any) -> dict[str, np.ndarray]:
    """Copies of the arrays of a state from the memory of a device, by their names in `State`."""
    blocks, pairs, walls = scene.blocks, scene.pairs, scene.walls
    arrays = {
        **{name: getattr(blocks, name).numpy() for name in _BLOCK_FIELDS},
        "spin": blocks.angular_velocity.numpy(),
        "velocity_ahead": blocks.velocity_ahead.numpy(),
        "spin_ahead": blocks.spin_ahead.numpy(),
        **{name: getattr(pairs, source).numpy() for name, source in _PAIR_FIELDS.items()},
        **{name: getattr(walls, name.removeprefix("wall_")).numpy() for name in _WALL_FIELDS},
        "wall_power": walls.present_power.numpy(),
        "wall_contact_radius": walls.radius.numpy(),
        "wall_contact_force": walls.push.numpy(),
        "wall_candidates": walls.candidates.numpy().reshape(-1, CANDIDATES),
        "pair": np.stack([pairs.first.numpy(), pairs.second.numpy()], axis=1),
        "simplex": pairs.simplex.numpy().view(np.int32).reshape(-1, 7),
    }
    return {name: np.array(array, dtype=FIELDS[name][0]) for name, array in arrays.items()}


def _turn(motion: Motion, dt: float) -> np.ndarray:
    """Rotation of one step."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(np.array(motion.angular_velocity) * dt).as_matrix()
