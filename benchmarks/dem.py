"""Speed of the discrete element engine: a dense packing under 600 kPa, full hulls.

python benchmarks/dem.py [--count 300 1000] [--yade] [--memory] [--gpu]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dem_scene import pressed, scene, stones
from rich.console import Console
from rich.table import Table

from lithoform import dem
from lithoform.dem.engine import Engine

PEER = Path(__file__).parent / "peers" / "yade_polyhedra.py"
ROUNDS = 5


def rate(engine: Engine, steps: int) -> float:
    """Block-steps per second of wall-clock time."""
    begin = time.perf_counter()
    made = 0
    while made < steps:
        progress = engine.run(steps - made)
        if progress.flags:
            raise SystemExit(f"fault {progress.flags}")
        made += progress.steps
    return engine.model.count * made / (time.perf_counter() - begin)


def rates(model: dem.Model, state: dem.State, threads: tuple[int, ...], steps: int) -> dict[int, float]:
    """Medians over rounds in which each number of threads has its turn."""
    engines = {n: Engine(model, state, state.clock[2], device="cpu", threads=n) for n in threads}
    for engine in engines.values():
        engine.run(100)
    found = {n: [] for n in threads}
    for _ in range(ROUNDS):
        for n, engine in engines.items():
            found[n].append(rate(engine, steps))
    for engine in engines.values():
        engine.close()
    return {n: statistics.median(values) for n, values in found.items()}


def yade(shapes: tuple[dem.Shape, ...], count: int, vertices: int, steps: int) -> dict[str, float] | None:
    """Block-steps per second of YADE's polyhedra with hulls of about so many vertices; None where it is not there."""
    program = shutil.which("yade") or shutil.which("yade-batch")
    if program is None:
        return None
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(vertices, 3))
    hulls = []
    for shape in shapes:
        core = shape.core.vertices / shape.radius
        # The farthest vertices in evenly drawn directions: a coarser hull of about that many vertices.
        hulls.append(core[np.unique((core @ directions.T).argmax(axis=0))].tolist())
    with tempfile.TemporaryDirectory() as folder:
        task, answer = Path(folder) / "task.json", Path(folder) / "answer.json"
        task.write_text(
            json.dumps({"hulls": hulls, "count": count, "steps": steps, "patience": 150, "answer": str(answer)})
        )
        given = {**os.environ, "LITHOFORM_TASK": str(task)}
        subprocess.run(
            [program, "-j1", "-n", "-x", str(PEER)], env=given, check=False, capture_output=True, timeout=900
        )
        return json.loads(answer.read_text()) if answer.exists() else None


def memory() -> tuple[float, float]:
    """Peak memory [GB] of a process with 9,000 blocks over 600 shapes before and after it has found its pairs."""
    shapes = stones(600)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    model, state = scene(9000, shapes)
    with Engine(model, state, 1e-7, device="cpu") as engine:
        engine.run(10)
    return before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, nargs="+", default=[300, 1000])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--yade", action="store_true", help="YADE's polyhedra as well, where it is installed")
    parser.add_argument("--memory", action="store_true", help="9,000 blocks over 600 shapes")
    parser.add_argument("--measure-memory", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure_memory:
        print(json.dumps(memory()))
        return
    console = Console(width=110)
    shapes = stones(16)
    vertices = statistics.mean(len(shape.core.vertices) for shape in shapes)
    title = f"million block-steps a second, hulls of {vertices:.0f} vertices (aims: 0.8, ratio 1.7)"
    table = Table("dense packing", "contacts a block", "1 thread", "2 threads", "ratio", title=title)
    ours = 0.0
    for count in options.count:
        model, state = pressed(count, shapes)
        touching = 2 * (state.contact_radius > 0).sum() + (state.wall_contact_radius > 0).sum()
        found = rates(model, state, (1, 2), options.steps)
        ours = ours or found[1]
        density = model.volume.sum() / (np.pi * model.walls[1].radius ** 2 * state.wall_point[2, 2])
        table.add_row(f"{count} blocks, packing density {density:.3f}", f"{touching / count:.2f}",
                      f"{found[1] / 1e6:.2f}", f"{found[2] / 1e6:.2f}", f"{found[2] / found[1]:.2f}")  # fmt: skip
    console.print(table)
    if options.yade:
        peer = yade(shapes, options.count[0], 50, 100)
        if peer is None:
            console.print("YADE is not installed here: no comparison (Debian package yade).")
        else:
            rate = peer["block_steps_per_second"]
            console.print(
                f"YADE's polyhedra, about 50 vertices, {peer['contacts_per_block']:.2f} contacts a block: {rate:,.0f} "
                f"block-steps/s on one core over {peer['steps']} steps; ours, full hulls: {ours / rate:.0f} times."
            )
    if options.memory:
        done = subprocess.run(
            [sys.executable, __file__, "--measure-memory"], check=True, capture_output=True, text=True
        )
        shapes_alone, whole = json.loads(done.stdout.splitlines()[-1])
        console.print(f"9,000 blocks over 600 shapes: {whole:.2f} GB at most (aim 2), of which 600 stones of 20,000 "
                      f"triangles and their making {shapes_alone:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
