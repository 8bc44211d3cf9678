"""Speed and memory of measuring: 20,000 triangles, medians over stones, every function in turns in the same run.

python benchmarks/descriptors.py [--rounds 31]
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parent))

from timing import medians, one_core, peak_memory

from lithoform import Mesh, database_recipe, generate_many, measure, measure_many, particle_seed
from lithoform.descriptors.table import DESCRIPTORS
from lithoform.presets import SHAPE_CLASSES
from lithoform.warp_runtime import default_threads

SETS = ("four", "standard", "all")
PARTS = {
    "convex hull (solidity)": ("solidity", 8.0),
    "inscribed sphere": ("inscribed_radius", None),
    "roundness with inscribed sphere": ("roundness", 40.0),
    "principal box (boxiness)": ("boxiness", None),
    "true sphericity": ("true_sphericity", None),
    "the four descriptors": ("four", 50.0),
    "standard set": ("standard", None),
    "minimum box": ("minimum_box_boxiness", None),
    "caliper dimensions": ("caliper_length", None),
    "sieve size": ("sieve_size", None),
    "fractal dimension": ("fractal_dimension", None),
    "roundness as published": ("roundness_published", None),
}


def stones(count: int) -> list[Mesh]:
    recipes = [database_recipe(SHAPE_CLASSES[i % 4], seed=particle_seed(0, i)) for i in range(count)]
    return [particle.mesh for particle in generate_many(recipes)]


def fresh(mesh: Mesh) -> Mesh:
    """The same mesh without what it has cached, its connectivity too."""
    return Mesh(mesh.vertices, mesh.faces)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=31)
    rounds = parser.parse_args().rounds
    meshes = stones(rounds)
    counter = iter(range(10**9))

    def timed(name: str):
        return lambda: measure(fresh(meshes[next(counter) % rounds]), name)

    with one_core():
        times = medians({label: timed(name) for label, (name, _) in PARTS.items()}, rounds)
    table = Table(title="20,000 triangles, database setting, one core, a fresh mesh each time")
    for column in ("what", "ms a particle", "target"):
        table.add_column(column, justify="left" if column == "what" else "right")
    for label, (_, target) in PARTS.items():
        table.add_row(label, f"{1e3 * times[label]:.1f}", "" if target is None else f"{target:g}")

    def stream(threads: int):
        return lambda: sum(1 for _ in measure_many(map(fresh, meshes), "four", threads=threads))

    threads = sorted({1, 2, default_threads()})
    streams = medians({str(n): stream(n) for n in threads}, 7)
    for n in threads:
        table.add_row(f"four, stream, {n} thread{'s' * (n > 1)}", f"{1e3 * streams[str(n)] / rounds:.1f}", "")
    console = Console(width=100)
    console.print(table)
    console.print(f"two threads against one: {streams['1'] / streams['2']:.2f} times as fast (target 1.8)")
    memory = peak_memory(
        "from lithoform import database_recipe, generate, measure\n"
        "for s in range(20): measure(generate(database_recipe('cube', seed=s)), 'four')"
    )
    console.print(f"peak memory of a process that generates and measures: {memory:.0f} MB (target 300)")
    console.print(f"{len(DESCRIPTORS)} descriptors; {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
