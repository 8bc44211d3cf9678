"""A model and a state on a device: arrays, launches over the threads of a processor or as a graph on a GPU."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.dem.arrays import CHUNK, STALE
from lithoform.dem.broadphase import matching_rows, near_pairs, neighbour_entries
from lithoform.dem.device import build_pairs, build_scene, read_scene, to_array
from lithoform.dem.gjk import Simplex
from lithoform.dem.integrate import advance, block_step, pair_step, wall_chunk_step, wall_step
from lithoform.dem.model import Model
from lithoform.dem.narrowphase import pair_gap
from lithoform.dem.state import State, motions_of, wall_radii
from lithoform.dem.team import Team
from lithoform.warp_runtime import default_threads, load, wp

__all__ = ["SKIN", "Engine", "Progress"]

# Pairs nearer than this share of the mean radius are kept in the list.
SKIN: Final = 0.06
# What a contact keeps from list to list.
_HISTORY: Final = ("radius", "spring", "twist", "normal", "force", "torque_first", "torque_second")
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
        self._team = Team(default_threads() if threads is None else threads, model.count, fixed=threads is not None)
        self._fresh = state.fresh
        self._pool: ThreadPoolExecutor | None = None
        self._graph: Any = None
        self.rebuilds = 0
        self.faulty = False
        self.gaps = (np.zeros((0, 2), np.int32), np.zeros(0))
        for kernel in (advance, pair_gap) if device == "cpu" else (pair_step, pair_gap):
            load(kernel.module, device)
        self.scene = build_scene(model, state, dt=dt, half_skin=0.5 * self.skin, device=device)
        self._slots(self._team.most)

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
        self.scene.pairs = build_pairs(found, {"simplex": simplex}, self.device)
        gaps = self._gaps(len(found))
        self.gaps = (found, gaps)
        near = (gaps < self.skin) | in_contact
        kept = found[near]
        there, here = matching_rows(former, kept, self.model.count)
        arrays = {"simplex": self.scene.pairs.simplex.numpy()[near], "limit": gaps[near]}
        for name, values in history.items():
            arrays[name] = np.zeros((len(kept), *values.shape[1:]))
            arrays[name][here] = values[there]
        self.scene.pairs = build_pairs(kept, arrays, self.device)
        first, entries = neighbour_entries(kept, self.model.count)
        blocks.entry_first, blocks.entries = (to_array(a, wp.int32, self.device) for a in (first, entries))
        wp.copy(blocks.origin, blocks.position)
        wp.copy(blocks.origin_orientation, blocks.orientation)
        self.scene.blocks = blocks
        self._fresh = False
        self._graph = None
        self.rebuilds += 1

    def state(self) -> State:
        """The state now, in the memory of the host."""
        return State(
            step=self.step,
            clock=self.clock,
            lag=self.lag,
            fresh=self._fresh,
            blocks=self.model.block_fingerprint,
            wall_motion=motions_of(self.model),
            wall_radius=wall_radii(self.model),
            **read_scene(self.scene),
        )

    def _launch(self, steps: int, kick: float) -> Progress:
        self.scene.kick = kick
        return self._launch_cpu(steps) if self.device == "cpu" else self._launch_gpu(steps)

    def _launch_cpu(self, steps: int) -> Progress:
        threads, steps = self._team.choose(steps)
        epochs, pair_flags, block_flags, done = self._control
        for array in self._control:
            array.zero_()

        def work(me: int) -> None:
            wp.launch(advance, 1, [self.scene, me, threads, steps, epochs, pair_flags, block_flags, done, _PAUSE],
                      device="cpu")  # fmt: skip

        begin = time.perf_counter()
        self._all_do(work, threads)
        self._team.note(threads, int(done.numpy()[0]), time.perf_counter() - begin)
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
        ended, pair_flags, stale, made, block_flags = control.numpy()[:5].tolist()
        return Progress(made, (pair_flags | stale | block_flags) if ended else 0)

    def _gaps(self, count: int) -> np.ndarray:
        gaps = wp.zeros(count, dtype=wp.float64, device=self.device)
        if self.device != "cpu" or count < 2 * CHUNK:
            wp.launch(pair_gap, count, [self.scene, self.skin, 0, gaps], device=self.device)
            return gaps.numpy()
        cuts = np.linspace(0, count, self._team.most + 1).astype(int).tolist()

        def part(me: int) -> None:
            start, end = cuts[me], cuts[me + 1]
            wp.launch(pair_gap, end - start, [self.scene, self.skin, start, gaps], device="cpu")

        self._all_do(part, self._team.most)
        return gaps.numpy()

    def _all_do(self, work: Callable[[int], None], threads: int) -> None:
        """Let threads do their parts 0, 1, ... of a work at the same time."""
        if threads > 1 and self._pool is None:
            self._pool = ThreadPoolExecutor(self._team.most - 1, thread_name_prefix="lithoform-dem")
        others = [self._pool.submit(work, me) for me in range(1, threads)] if self._pool is not None else []
        work(0)
        for other in others:
            other.result()

    def _slots(self, threads: int) -> None:
        """Words that threads tell each other by, each 64 bytes from the next."""
        size = 16 * max(threads, 1)
        self._control = [wp.zeros(size, dtype=wp.int32, device=self.device) for _ in range(4)]


def _address_of_usleep() -> int:
    """Address of the C function that gives the processor away for some microseconds; 0 where there is none."""
    try:
        return ctypes.cast(ctypes.CDLL(None).usleep, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0


_PAUSE: Final = _address_of_usleep()
