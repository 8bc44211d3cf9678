"""Speed and memory of generation: every figure a median, pairs measured in turns in the same run.

    python benchmarks/generation.py [--rounds 21] [--stream 2000]

Rows for a GPU are printed where there is one.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import oracles
from timing import medians, one_core

from lithoform import Recipe, check, generate, generate_many, sphere
from lithoform.radius import field, radii
from lithoform.warp_runtime import default_threads, wp


def single_core(rounds: int) -> dict[str, float]:
    with one_core():
        directions = sphere("octahedral", 50).vertices
        recipes = [Recipe(seed=seed) for seed in range(rounds)]
        counter = iter(range(10**9))
        pick = lambda: recipes[next(counter) % rounds]  # noqa: E731
        mesh = generate(recipes[0], device="cpu").mesh
        functions = {
            "noise field, Warp float64": lambda: field([pick()], directions, device="cpu"),
            "radii (field, mean, maximum, guard)": lambda: radii([pick()], directions, device="cpu"),
            "recipe to checked mesh": lambda: generate(pick(), device="cpu"),
            "check of a mesh": lambda: check(mesh.with_vertices(mesh.vertices)),
        }
        slow = {"noise field, vectorised NumPy": lambda: oracles.radius(pick(), directions, directions)}
        return medians(functions, rounds) | medians(slow | {"again: Warp": functions["noise field, Warp float64"]}, 5)


def streaming(count: int, rounds: int) -> dict[int, float]:
    """Median milliseconds a particle for one thread and for all, in turns."""
    recipes = [Recipe(seed=seed) for seed in range(count)]

    def run(threads: int) -> Callable[[], object]:
        return lambda: sum(1 for _ in generate_many(recipes, device="cpu", threads=threads))

    every = sorted({1, default_threads()})
    times = medians({str(n): run(n) for n in every}, rounds)
    return {int(n): 1e3 * t / count for n, t in times.items()}


def memory(count: int) -> tuple[float, float]:
    """Peak resident memory [MB] after a tenth of a stream, and after all of it."""
    peaks = []
    for i, _ in enumerate(generate_many((Recipe(seed=s, triangles=20_000) for s in range(count)), device="cpu"), 1):
        if i in (count // 10, count):
            peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return peaks[0], peaks[-1]


def import_seconds(statement: str) -> float:
    def run() -> None:
        subprocess.run([sys.executable, "-c", statement], check=True)

    times = medians({"python": lambda: subprocess.run([sys.executable, "-c", ""], check=True), "import": run}, 11)
    return times["import"] - times["python"]


def gpu_rows(rounds: int) -> dict[str, float]:
    if not wp.is_cuda_available():
        return {}
    directions = sphere("octahedral", 50).vertices
    batch = [Recipe(seed=seed) for seed in range(256)]
    times = medians({"noise field on the GPU, batch of 256": lambda: field(batch, directions, device="cuda")}, rounds)
    return {name: value / len(batch) for name, value in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--stream", type=int, default=2000, help="particles of the memory measurement")
    options = parser.parse_args()

    table = Table(title="20,000 triangles, Table 1, float64")
    table.add_column("what")
    table.add_column("ms a particle", justify="right")
    table.add_column("target", justify="right")
    core = single_core(options.rounds)
    targets = {"noise field, Warp float64": "8", "recipe to checked mesh": "18"}
    for name, value in core.items():
        if name != "again: Warp":
            table.add_row(f"{name}, one core", f"{1e3 * value:.2f}", targets.get(name, ""))
    ratio = core["noise field, vectorised NumPy"] / core["again: Warp"]
    stream = streaming(120, 5)
    for threads, value in stream.items():
        table.add_row(f"stream, {threads} thread{'s' * (threads > 1)}", f"{value:.2f}", "")
    gpu = gpu_rows(options.rounds)
    for name, value in gpu.items():
        table.add_row(name, f"{1e3 * value:.3f}", "")
    console = Console(width=100)
    console.print(table)
    console.print(f"vectorised NumPy / Warp field, in turns: {ratio:.0f} times")
    most = max(stream)
    console.print(f"{most} threads against one: {stream[1] / stream[most]:.2f} times as fast (target 1.8 with two)")
    if not gpu:
        console.print("GPU: none here, not measured")
    early, late = memory(options.stream)
    console.print(
        f"peak memory after {options.stream // 10} particles {early:.0f} MB, after {options.stream} {late:.0f} MB "
        f"(100,000 at the same slope: {late + (late - early) / 0.9 / options.stream * 98_000:.0f} MB, target 1000)"
    )
    light = import_seconds("import lithoform")
    full = import_seconds("from lithoform import generate")
    console.print(f"import lithoform {light:.3f} s (target 0.3); with generate (Warp) {full:.2f} s")
    console.print(f"NumPy {np.__version__}, Warp {wp.__version__}, {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
