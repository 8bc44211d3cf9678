"""The numbers of docs/validation.md that are not pass or fail: the database setting and the drift with resolution.

python benchmarks/validation.py [--per-class 40] [--stones 24]
"""

from __future__ import annotations

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import ConvexHull

from lithoform import Particle, Recipe, database_recipe, generate_many, particle_seed, principal_frame
from lithoform.presets import SHAPE_CLASSES

# The paper's means over 600 generated stones (section 5); by class it gives true sphericity alone.
PAPER = {"solidity": 0.8948, "boxiness": 0.4097, "true sphericity": 0.8081}
PAPER_SPHERICITY = {"cube": 0.8473, "plate": 0.7846, "column": 0.7642, "blade": 0.7379}


def measures(particle: Particle) -> tuple[float, float, float]:
    """3D solidity, boxiness along the principal axes of the vertices, true sphericity."""
    mesh, mass = particle.mesh, particle.mass_properties
    centroid, axes = principal_frame(mesh)
    extents = np.ptp((mesh.vertices - centroid) @ axes, axis=0)
    sphericity = np.pi ** (1 / 3) * (6 * mass.volume) ** (2 / 3) / mass.area
    return mass.volume / ConvexHull(mesh.vertices).volume, mass.volume / extents.prod(), sphericity


def database(per_class: int, console: Console) -> None:
    table = Table(title=f"database setting, {per_class} stones a class, 20,000 triangles (mean +- standard deviation)")
    for column in ("class", *PAPER):
        table.add_column(column)
    everything = []
    for k, shape_class in enumerate(SHAPE_CLASSES):
        numbers = range(k * per_class, (k + 1) * per_class)
        recipes = [database_recipe(shape_class, seed=particle_seed(2026, n)) for n in numbers]
        values = np.array([measures(p) for p in generate_many(recipes, device="cpu")])
        everything.append(values)
        table.add_row(shape_class, *(f"{m:.4f} +- {s:.4f}" for m, s in zip(values.mean(0), values.std(0), strict=True)))
    values = np.concatenate(everything)
    table.add_row("all", *(f"{m:.4f} +- {s:.4f}" for m, s in zip(values.mean(0), values.std(0), strict=True)))
    table.add_row("paper, all", *(f"{value:.4f}" for value in PAPER.values()))
    console.print(table)
    console.print("paper's true sphericity by class:", PAPER_SPHERICITY)


def resolution(stones: int, console: Console) -> None:
    table = Table(title=f"solidity against 51,200 triangles, {stones} stones (mean, largest difference)")
    for column in ("setting", "5,000", "20,000"):
        table.add_column(column)
    settings = {
        "database": lambda seed: database_recipe(SHAPE_CLASSES[seed % 4], seed=seed),
        "database without ridges": lambda seed: database_recipe(SHAPE_CLASSES[seed % 4], seed=seed, beta=0.0),
        "benchmark": lambda seed: Recipe(seed=seed),
        "benchmark without ridges": lambda seed: Recipe(seed=seed, ridge_weight=0.0),
    }
    for name, recipe in settings.items():
        solidity = {}
        for triangles in (5000, 20_000, 51_200):
            recipes = [recipe(seed).replace(triangles=triangles) for seed in range(stones)]
            solidity[triangles] = np.array([measures(p)[0] for p in generate_many(recipes, device="cpu")])
        drifts = [solidity[n] - solidity[51_200] for n in (5000, 20_000)]
        table.add_row(name, *(f"{d.mean():+.4f}, {np.abs(d).max():.4f}" for d in drifts))
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--per-class", type=int, default=40)
    parser.add_argument("--stones", type=int, default=24)
    options = parser.parse_args()
    console = Console(width=110)
    database(options.per_class, console)
    resolution(options.stones, console)


if __name__ == "__main__":
    main()
