"""The numbers of docs/validation.md that are not pass or fail, but for those of benchmarks/soundness.py.

python benchmarks/validation.py [--per-class 40] [--stones 24]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial import ConvexHull

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import oracles
import test_conditioning
import test_noise

from lithoform import (
    Particle,
    Recipe,
    database_recipe,
    generate_many,
    particle_seed,
    principal_frame,
    smooth,
    sphere,
)
from lithoform.noise import gradient_noise
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


def ridges(stones: int, console: Console) -> None:
    """Mean solidity, before the twist, of eq. 7 re-centred and as printed."""
    ball = sphere("octahedral", 50)
    for recentred in (True, False):
        values = []
        for n in range(stones):
            recipe = database_recipe(SHAPE_CLASSES[n % 4], seed=particle_seed(2026, n))
            noise = oracles.noise(recipe, ball.vertices, ball.vertices, recentred=recentred)
            radius = recipe.base_radius * (1.0 + recipe.perturbation * noise)
            values.append(oracles.solidity(radius[:, None] * ball.vertices, ball.faces))
        name = "re-centred" if recentred else "as printed"
        console.print(f"ridges {name}: solidity {np.mean(values):.4f} +- {np.std(values) / len(values) ** 0.5:.4f}")


def noise_and_smoothing(console: Console) -> None:
    """Jumps across cell faces, slopes of the spectrum, volumes kept by smoothing; the measures are the tests'."""
    across = [test_noise.jumps(lambda p: gradient_noise(p, 5)[:, 0], axis) for axis in range(3)]
    console.print(
        "jumps of P, value and derivatives 1 to 3:", [f"{max(column):.0e}" for column in zip(*across, strict=True)]
    )
    for lacunarity, gain in ((2.0, 0.5), (1.5, 0.7), (1.5, 0.5), (2.0, 0.8)):
        theory = 2 * np.log(gain) / np.log(lacunarity) - 1
        console.print(
            f"slope at {lacunarity}, {gain}: {test_noise.measured_slope(lacunarity, gain):.3f}, theory {theory:.3f}"
        )
    stone = test_conditioning.stone()
    for method in ("laplacian", "taubin"):
        kept = smooth(stone, iterations=50, method=method).volume / stone.volume
        console.print(f"volume kept by 50 {method} steps: {kept:.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--per-class", type=int, default=40)
    parser.add_argument("--stones", type=int, default=24)
    options = parser.parse_args()
    console = Console(width=110)
    database(options.per_class, console)
    resolution(options.stones, console)
    ridges(options.per_class, console)
    noise_and_smoothing(console)


if __name__ == "__main__":
    main()
