"""A model and a state on a device: arrays, launches over the threads of a processor or as a graph on a GPU."""

from __future__ import annotations

import ctypes
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.dem.arrays import CANDIDATES, CHUNK, CYLINDER, PLANE, STALE, Blocks, Pairs, Scene, Walls
from lithoform.dem.broadphase import matching_rows, near_pairs, neighbour_entries
from lithoform.dem.contact import PairLaw
from lithoform.dem.gjk import Hulls, Simplex
from lithoform.dem.integrate import advance, block_step, pair_step, wall_chunk_step, wall_step
from lithoform.dem.materials import pair_constants
from lithoform.dem.model import Model
from lithoform.dem.narrowphase import pair_gap
from lithoform.dem.state import FIELDS, State
from lithoform.dem.walls import Cylinder, Motion, Servo
from lithoform.warp_runtime import default_threads, load, wp

__all__ = ["SKIN", "Engine", "Progress"]

# Pairs nearer than this share of the mean radius are kept in the list.
SKIN: Final = 0.06
# Steps in one graph on a GPU.
_GRAPH_STEPS: Final = 16


@dataclass(frozen=True)
class Progress:
    """What a launch did: steps made, and the flags that ended it (0: all were made)."""

    steps: int
    flags: int


class Engine:
    """A model and a state in the memory of a device.

    Parameters
    ----------
    model : Model
    state : State
    dt : float
        Time step [s].
    device : str
        "cpu" or a name of Warp such as "cuda:0".
    threads : int, optional
        On a processor; by default as many as it has.
    """

    def __init__(self, model: Model, state: State, dt: float, *, device: str, threads: int | None = None) -> None:
        self.model = model
        self.device = device
        self.dt = dt
        self.step, self.lag = state.step, state.lag
        self.clock = state.clock if state.clock[2] == dt else (state.time, state.step, dt)
        self.skin = SKIN * float(model.radius.mean())
        self.threads = default_threads() if threads is None else threads
        self._fresh = state.fresh
        self._pool: ThreadPoolExecutor | None = None
        self._graph: Any = None
        self.rebuilds = 0
        self.faulty = False
        self.gaps = (np.zeros((0, 2), np.int32), np.zeros(0))
        for kernel in (advance, pair_gap) if device == "cpu" else (pair_step, pair_gap):
            load(kernel.module, device)
        self.scene = self._scene(state)
        self._slots(self.threads)

    @property
    def time(self) -> float:
        """[s]."""
        begin, step, dt = self.clock
        return begin + (self.step - step) * dt

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, steps: int) -> Progress:
        """Make steps until they are done, a fault comes, or the list of pairs is stale; then it is made anew.

        Parameters
        ----------
        steps : int
        """
        if self._fresh:
            self.find_pairs()
        # The first step brings the velocities from where they are to half a step behind the positions.
        kick = self.lag + 0.5 * self.dt
        if kick != self.dt:
            made = self._launch(1, kick)
            self.lag = 0.5 * self.dt if made.steps else self.lag
        else:
            made = self._launch(steps, self.dt)
        self.step += made.steps
        if made.flags == STALE:
            self.find_pairs()
            return Progress(made.steps, 0)
        self.faulty = made.flags != 0
        return made

    def find_pairs(self) -> None:
        """Make the list of pairs anew; contacts and simplices of pairs that stay are kept."""
        blocks, old = self.scene.blocks, self.scene.pairs
        position = blocks.position.numpy()
        found = near_pairs(position, self.model.bounding_radius, self.skin)
        former = np.stack([old.first.numpy(), old.second.numpy()], axis=1)
        # Taken out now: a struct within a struct is overwritten in place.
        history = {name: getattr(old, name).numpy() for name in _HISTORY}
        blocks.travel.zero_()
        there, here = matching_rows(former, found, self.model.count)
        simplex = np.zeros(len(found), dtype=Simplex.numpy_dtype())
        simplex[here] = old.simplex.numpy()[there]
        in_contact = np.zeros(len(found), dtype=bool)
        in_contact[here] = history["radius"][there] > 0.0
        # Bounding spheres let many pairs pass: the distance of the cores decides.
        self.scene.pairs = self._pairs(found, {"simplex": simplex})
        gaps = self._gaps(len(found))
        self.gaps = (found, gaps)
        near = (gaps < self.skin) | in_contact
        kept = found[near]
        there, here = matching_rows(former, kept, self.model.count)
        arrays = {"simplex": self.scene.pairs.simplex.numpy()[near], "limit": gaps[near]}
        for name, values in history.items():
            arrays[name] = np.zeros((len(kept), *values.shape[1:]))
            arrays[name][here] = values[there]
        self.scene.pairs = self._pairs(kept, arrays)
        first, entries = neighbour_entries(kept, self.model.count)
        blocks.entry_first, blocks.entries = self._array(first, wp.int32), self._array(entries, wp.int32)
        wp.copy(blocks.origin, blocks.position)
        wp.copy(blocks.origin_orientation, blocks.orientation)
        self.scene.blocks = blocks
        self._fresh = False
        self._graph = None
        self.rebuilds += 1

    def state(self) -> State:
        """The state now, in the memory of the host."""
        blocks, pairs, walls = self.scene.blocks, self.scene.pairs, self.scene.walls
        pair = np.stack([pairs.first.numpy(), pairs.second.numpy()], axis=1)
        simplex = pairs.simplex.numpy()
        arrays = {
            **{name: getattr(blocks, name).numpy() for name in _BLOCK_FIELDS},
            "spin": blocks.angular_velocity.numpy(),
            **{name: getattr(pairs, source).numpy() for name, source in _PAIR_FIELDS.items()},
            **{name: getattr(walls, name.removeprefix("wall_")).numpy() for name in _WALL_FIELDS},
            "wall_contact_radius": walls.radius.numpy(),
            "wall_contact_force": walls.push.numpy(),
            "wall_candidates": walls.candidates.numpy().reshape(-1, CANDIDATES),
            "pair": pair,
            "simplex": simplex.view(np.int32).reshape(-1, 7),
        }
        copies = {name: np.array(array, dtype=FIELDS[name][0]) for name, array in arrays.items()}
        return State(step=self.step, clock=self.clock, lag=self.lag, fresh=self._fresh, **copies)

    def _launch(self, steps: int, kick: float) -> Progress:
        self.scene.kick = kick
        return self._launch_cpu(steps) if self.device == "cpu" else self._launch_gpu(steps)

    def _launch_cpu(self, steps: int) -> Progress:
        threads = max(1, min(self.threads, math.ceil(self.model.count / CHUNK)))
        epochs, pair_flags, block_flags, done = self._control
        for array in self._control:
            array.zero_()

        def work(me: int) -> None:
            wp.launch(advance, 1, [self.scene, me, threads, steps, epochs, pair_flags, block_flags, done, _PAUSE],
                      device="cpu")  # fmt: skip

        if threads > 1 and self._pool is None:
            self._pool = ThreadPoolExecutor(threads - 1, thread_name_prefix="lithoform-dem")
        others = [self._pool.submit(work, me) for me in range(1, threads)] if self._pool is not None else []
        work(0)
        for other in others:
            other.result()
        flags = int(np.bitwise_or.reduce(pair_flags.numpy()) | np.bitwise_or.reduce(block_flags.numpy()))
        return Progress(int(done.numpy()[0]), flags)

    def _launch_gpu(self, steps: int) -> Progress:
        control = self._control[0]
        control.zero_()
        n, m = self.model.count, self.scene.pairs.first.shape[0]
        chunks = math.ceil(n / CHUNK)

        def one() -> None:
            wp.launch(pair_step, m, [self.scene, control], device=self.device)
            wp.launch(block_step, n, [self.scene, control], device=self.device)
            wp.launch(wall_chunk_step, chunks, [self.scene, control], device=self.device)
            wp.launch(wall_step, 1, [self.scene, chunks, control], device=self.device)

        graphs, rest = divmod(steps, _GRAPH_STEPS)
        made = 0
        if graphs and self._graph is None:
            with wp.ScopedCapture(device=self.device) as capture:
                for _ in range(_GRAPH_STEPS):
                    one()
            self._graph = capture.graph
        for batch in range(graphs):
            wp.capture_launch(self._graph)
            # Reading the flags waits for the device; every few graphs is enough, since steps after a flag do nothing.
            if batch % 8 == 7 and control.numpy()[0]:
                break
        if not (graphs and control.numpy()[0]):
            for _ in range(rest):
                one()
        ended, pair_flags, block_flags, made = control.numpy()[:4].tolist()
        return Progress(made, (pair_flags | block_flags) if ended else 0)

    def _gaps(self, count: int) -> np.ndarray:
        gaps = wp.zeros(count, dtype=wp.float64, device=self.device)
        if self.device != "cpu" or count < 2 * CHUNK:
            wp.launch(pair_gap, count, [self.scene, self.skin, 0, gaps], device=self.device)
            return gaps.numpy()
        cuts = np.linspace(0, count, self.threads + 1).astype(int).tolist()

        def part(start: int, end: int) -> None:
            wp.launch(pair_gap, end - start, [self.scene, self.skin, start, gaps], device="cpu")

        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(part, cuts[:-1], cuts[1:]))
        return gaps.numpy()

    def _slots(self, threads: int) -> None:
        """Words that threads tell each other by, each 64 bytes from the next."""
        size = 16 * max(threads, 1)
        self._control = [wp.zeros(size, dtype=wp.int32, device=self.device) for _ in range(4)]

    def _array(self, values: Any, dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _scene(self, state: State) -> Any:
        scene = Scene()
        scene.dt = self.dt
        scene.gravity = wp.vec3d(*self.model.gravity)
        scene.damping = self.model.local_damping
        scene.half_skin = 0.5 * self.skin
        scene.materials = len(self.model.materials)
        scene.laws = self._laws()
        scene.hulls = self._hulls()
        scene.blocks = self._blocks(state)
        scene.pairs = self._pairs(state.pair, {
            "simplex": np.ascontiguousarray(state.simplex).view(Simplex.numpy_dtype()).ravel(),
            **{source: getattr(state, name) for name, source in _PAIR_FIELDS.items()},
        })  # fmt: skip
        scene.walls = self._walls(state)
        return scene

    def _laws(self) -> Any:
        materials = self.model.materials
        laws = []
        for a, first in enumerate(materials):
            for b, second in enumerate(materials):
                given = self.model.pairs.get((a, b), self.model.pairs.get((b, a)))
                law = PairLaw()
                for name, value in pair_constants(first, second, given).items():
                    setattr(law, name, value)
                laws.append(law)
        return wp.array(laws, dtype=PairLaw, device=self.device)

    def _hulls(self) -> Any:
        cores = [shape.core for shape in self.model.shapes]
        first = np.cumsum([0, *(len(core.vertices) for core in cores)])
        starts, entries, total = [], [], 0
        for core in cores:
            begin, neighbours = core.adjacency
            starts.append(begin[:-1] + total)
            entries.append(neighbours)
            total += len(neighbours)
        hulls = Hulls()
        hulls.vertices = self._array(np.concatenate([core.vertices for core in cores]), wp.vec3d)
        hulls.first = self._array(first.astype(np.int32), wp.int32)
        hulls.adjacency_first = self._array(np.concatenate([*starts, [total]]).astype(np.int32), wp.int32)
        # An empty array would be no array: spheres have no neighbours.
        hulls.adjacency = self._array(np.concatenate([*entries, [0]]).astype(np.int32), wp.int32)
        return hulls

    def _blocks(self, state: State) -> Any:
        model, blocks = self.model, Blocks()
        for name in ("shape", "material"):
            setattr(blocks, name, self._array(getattr(model, name), wp.int32))
        for name, values in (("scale", model.scale), ("mass", model.mass), ("radius", model.radius),
                             ("bound", model.bounding_radius), ("margin", model.margin)):  # fmt: skip
            setattr(blocks, name, self._array(values, wp.float64))
        blocks.inertia = self._array(model.inertia, wp.vec3d)
        blocks.angular_velocity = self._array(state.spin, wp.vec3d)
        for name in _BLOCK_FIELDS:
            dtype = wp.quatd if "orientation" in name else wp.float64 if name == "travel" else wp.vec3d
            setattr(blocks, name, self._array(getattr(state, name), dtype))
        blocks.flags = wp.zeros(model.count, dtype=wp.int32, device=self.device)
        first, entries = neighbour_entries(state.pair, model.count)
        blocks.entry_first, blocks.entries = self._array(first, wp.int32), self._array(entries, wp.int32)
        return blocks

    def _pairs(self, pair: np.ndarray, given: dict[str, np.ndarray]) -> Any:
        pairs = Pairs()
        count = len(pair)
        pairs.first, pairs.second = (self._array(pair[:, side].astype(np.int32), wp.int32) for side in (0, 1))
        for name, dtype in (("simplex", Simplex), ("limit", wp.float64), ("radius", wp.float64), ("spring", wp.vec3d),
                            ("twist", wp.vec3d), ("normal", wp.vec3d), ("force", wp.vec3d), ("torque_first", wp.vec3d),
                            ("torque_second", wp.vec3d), ("flags", wp.int32)):  # fmt: skip
            empty = wp.zeros(count, dtype=dtype, device=self.device)
            setattr(pairs, name, self._array(given[name], dtype) if name in given and count else empty)
        return pairs

    def _walls(self, state: State) -> Any:
        model, walls = self.model, Walls()
        count = len(model.walls)
        motions = [wall.motion if isinstance(wall.motion, Motion) else Motion() for wall in model.walls]
        servos = [wall.motion if isinstance(wall.motion, Servo) else None for wall in model.walls]
        walls.count = count
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
            "speed": state.wall_speed,
            "work": state.wall_work,
            "budget": state.wall_budget,
            "radius": state.wall_contact_radius,
            "power": np.zeros(model.count * count),
            "chunk_power": np.zeros(math.ceil(model.count / CHUNK) * count),
        }
        vectors = {
            "point": state.wall_point,
            "direction": state.wall_direction,
            "velocity": [motion.velocity for motion in motions],
            "angular_velocity": [motion.angular_velocity for motion in motions],
            "pivot": state.wall_pivot,
            "force": state.wall_force,
            "spring": state.wall_spring,
            "twist": state.wall_twist,
            "push": state.wall_contact_force,
            "chunk_force": np.zeros((math.ceil(model.count / CHUNK) * count, 3)),
        }
        for group, kind, dtype in ((integers, np.int32, wp.int32), (numbers, np.float64, wp.float64)):
            for name, values in group.items():
                setattr(walls, name, self._array(np.asarray(values, dtype=kind), dtype))
        for name, values in vectors.items():
            setattr(walls, name, self._array(np.asarray(values, dtype=np.float64).reshape(-1, 3), wp.vec3d))
        walls.turn = self._array(np.array([_turn(motion, self.dt) for motion in motions]).reshape(-1, 3, 3), wp.mat33d)
        return walls


_BLOCK_FIELDS = ("position", "orientation", "velocity", "angular_momentum", "force", "torque", "travel", "origin",
                 "origin_orientation")  # fmt: skip
_PAIR_FIELDS = {"limit": "limit", "contact_radius": "radius", "spring": "spring", "twist": "twist", "normal": "normal",
                "contact_force": "force"}  # fmt: skip
_HISTORY = ("radius", "spring", "twist", "normal", "force", "torque_first", "torque_second")
_WALL_FIELDS = ("wall_point", "wall_direction", "wall_pivot", "wall_speed", "wall_force", "wall_work",
                "wall_candidate_count", "wall_budget", "wall_spring", "wall_twist")  # fmt: skip


def _turn(motion: Motion, dt: float) -> np.ndarray:
    """Rotation of one step."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(np.array(motion.angular_velocity) * dt).as_matrix()


def _address_of_usleep() -> int:
    """Address of the C function that gives the processor away for some microseconds; 0 where there is none."""
    try:
        return ctypes.cast(ctypes.CDLL(None).usleep, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0


_PAUSE: Final = _address_of_usleep()
