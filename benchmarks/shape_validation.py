"""The numbers of docs/validation.md on measuring shape: known bodies, resolution, noise, trends, real particles.

    python benchmarks/shape_validation.py [--stones 36] [--data ../shared/data]

Real particles are measured where their folder is: 95 of NIST (fdot57) and 7 scanned boulders (collide).
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import bodies

from lithoform import Mesh, Recipe, database_recipe, generate_many, measure, measure_many, particle_seed, simplify
from lithoform.descriptors.table import FOUR
from lithoform.parallel import in_order
from lithoform.presets import SHAPE_CLASSES
from lithoform.scans.reading import find_scans, read_scan
from lithoform.scans.spherical_harmonics import read_geometry_table

# The specification's truths: integrals of the definition without its crest factor.
KNOWN = {
    "sphere": (bodies.sphere, 1.0),
    "ellipsoid 1 : 0.75 : 0.5": (lambda n: bodies.ellipsoid((1.0, 0.75, 0.5), n), 0.6555),
    "ellipsoid 1 : 1 : 0.5": (lambda n: bodies.ellipsoid((1.0, 1.0, 0.5), n), 0.5853),
    "ellipsoid 2 : 1 : 1": (lambda n: bodies.ellipsoid((2.0, 1.0, 1.0), n), 0.7194),
    "superellipsoid e = 3": (lambda n: bodies.superellipsoid((1, 1, 1), 3.0, n), 0.627),
    "superellipsoid e = 4": (lambda n: bodies.superellipsoid((1, 1, 1), 4.0, n), 0.480),
    "cube rounded at 0.6": (lambda n: bodies.rounded_box((1, 1, 1), 0.6, n), 0.6),
    "cube rounded at 0.4": (lambda n: bodies.rounded_box((1, 1, 1), 0.4, n), 0.4),
    "cube rounded at 0.3": (lambda n: bodies.rounded_box((1, 1, 1), 0.3, n), 0.3),
    "cube rounded at 0.2": (lambda n: bodies.rounded_box((1, 1, 1), 0.2, n), 0.2),
    "capsule": (lambda n: bodies.capsule(1.0, 1.0, n), 1.0),
}
COUNTS = (5_000, 20_000, 81_920)
TRENDS = {
    "perturbation": (0.05, 0.1, 0.2, 0.3, 0.4, 0.5), "main_scale": (0.5, 1.0, 1.5, 2.0, 3.0),
    "lacunarity": (0.5, 1.0, 1.5, 2.0, 3.0), "gain": (0.1, 0.3, 0.5, 0.7, 0.9),
}  # fmt: skip


def known_bodies(console: Console) -> None:
    table = Table(title="roundness of known bodies")
    for column in ("body", *(f"{n:,}" for n in COUNTS), "truth"):
        table.add_column(column)
    for name, (make, truth) in KNOWN.items():
        values = [measure(make(n), "roundness")["roundness"] for n in COUNTS]
        table.add_row(name, *(f"{v:.4f}" for v in values), f"{truth:g}")
    console.print(table)


def stones(recipes: list[Recipe]) -> list[Mesh]:
    return [particle.mesh for particle in generate_many(recipes)]


def resolution(count: int, console: Console) -> None:
    seeds = [particle_seed(81, i) for i in range(count)]
    by_count = {}
    for n in (5_000, 20_000, 80_000):
        recipes = [database_recipe(SHAPE_CLASSES[i % 4], seed=s, triangles=n) for i, s in enumerate(seeds)]
        by_count[n] = list(measure_many(generate_many(recipes), "four"))
    table = Table(title=f"{count} database stones against the same at 80,000 triangles: relative, mean / rms / worst")
    for column in ("triangles", *FOUR):
        table.add_column(column)
    resolved = [not row.notes for row in by_count[20_000]]
    groups = {
        "5,000": (5_000, [True] * count),
        "20,000": (20_000, [True] * count),
        f"20,000, the {sum(resolved)} resolved": (20_000, resolved),
    }
    for label, (n, kept) in groups.items():
        cells = []
        for name in FOUR:
            pairs = zip(by_count[n], by_count[80_000], kept, strict=True)
            change = np.array([a[name] / b[name] - 1 for a, b, k in pairs if k])
            cells.append(f"{change.mean():+.4f} / {np.sqrt((change**2).mean()):.4f} / {np.abs(change).max():.4f}")
        table.add_row(label, *cells)
    console.print(table)


def same_body(count: int, console: Console) -> None:
    fine = [database_recipe(SHAPE_CLASSES[i % 4], seed=particle_seed(81, i), triangles=80_000) for i in range(count)]
    changes, resolved = [], []
    for mesh in stones(fine):
        coarse = measure(simplify(mesh, 20_000), "roundness")
        changes.append(coarse["roundness"] / measure(mesh, "roundness")["roundness"] - 1)
        resolved.append(not coarse.notes)
    groups = ((f"{count} stones", [True] * count), (f"the {sum(resolved)} resolved", resolved))
    for label, kept in groups:
        change = np.array(changes)[kept]
        console.print(f"roundness of one body, 80,000 triangles simplified to 20,000, {label}: {change.mean():+.4f} "
                      f"mean, {np.sqrt((change**2).mean()):.4f} rms, {np.abs(change).max():.4f} worst")  # fmt: skip


def noise(count: int, console: Console) -> None:
    rng = np.random.default_rng(5)
    changes = []
    meshes = stones([database_recipe(SHAPE_CLASSES[i % 4], seed=particle_seed(7, i)) for i in range(count)])
    for mesh in meshes:
        factor = 1.0 + 1e-3 * rng.standard_normal((len(mesh.vertices), 1))
        noisy = mesh.with_vertices(mesh.vertices * factor)
        changes.append(measure(noisy, "roundness")["roundness"] / measure(mesh, "roundness")["roundness"] - 1)
    change = np.array(changes)
    console.print(f"noise of 0.1 % of the radius: roundness {np.sqrt((change**2).mean()):.4f} rms, "
                  f"{np.abs(change).max():.4f} worst of {count} stones")  # fmt: skip


def trends(console: Console) -> None:
    for name, values in TRENDS.items():
        means = []
        for value in values:
            recipes = [Recipe(seed=seed).replace(**{name: value}) for seed in range(8)]
            found = measure_many(generate_many(recipes), "roundness")
            means.append(np.mean([row["roundness"] for row in found]))
        console.print(f"roundness against {name} {values}: {', '.join(f'{m:.3f}' for m in means)}")


def database(per_class: int, console: Console) -> None:
    table = Table(title=f"database setting, {per_class} stones a class (mean +- standard deviation)")
    names = (*FOUR, "minimum_box_boxiness", "hurst_exponent", "roundness_published")
    for column in ("class", *names):
        table.add_column(column)
    everything = []
    for k, shape_class in enumerate(SHAPE_CLASSES):
        seeds = [particle_seed(2026, n) for n in range(k * per_class, (k + 1) * per_class)]
        rows = list(measure_many(generate_many([database_recipe(shape_class, seed=s) for s in seeds]), names))
        values = np.array([[row[name] for name in names] for row in rows])
        everything.append(values)
        table.add_row(shape_class, *(f"{m:.3f} +- {s:.3f}" for m, s in zip(values.mean(0), values.std(0), strict=True)))
    pooled = np.concatenate(everything)
    table.add_row("all", *(f"{m:.3f} +- {s:.3f}" for m, s in zip(pooled.mean(0), pooled.std(0), strict=True)))
    gain = pooled[:, 4] / pooled[:, 1]
    console.print(table)
    console.print(f"boxiness, minimum box over principal box: {gain.mean():.3f} mean, {gain.max():.3f} largest")


def florida(folder: Path, console: Console) -> None:
    table = read_geometry_table(next(folder.glob("*-geom.dat")))
    keys = {"volume": "volume", "surface_area": "surf_area", "caliper_length": "length(mm)",
            "caliper_width": "width(mm)", "caliper_thickness": "thick(mm)",
            "chord_width": "width(mm)", "chord_thickness": "thick(mm)"}  # fmt: skip
    names = (*FOUR, *keys, "zingg_class")
    files = find_scans(folder)
    found = list(in_order(lambda path: measure(read_scan(path).mesh, names).scaled(1000.0), files))
    console.print(f"fdot57: {len(files)} particles")
    for ours, theirs in keys.items():
        change = np.array([row[ours] / table[path.name][theirs] - 1 for path, row in zip(files, found, strict=True)])
        worst = int(np.argmax(np.abs(change)))
        console.print(f"  {ours}: median |difference| {np.median(np.abs(change)):.5f}, mean {change.mean():+.5f}, "
                      f"worst {change[worst]:+.5f} ({files[worst].name})")  # fmt: skip
    for name in FOUR:
        values = np.array([row[name] for row in found])
        console.print(f"  {name}: {values.mean():.3f} +- {values.std():.3f}, {values.min():.3f} to {values.max():.3f}")
    classes = [row["zingg_class"] for row in found]
    console.print("  classes: " + ", ".join(f"{classes.count(c)} {c}" for c in SHAPE_CLASSES))


def boulders(folder: Path, console: Console) -> None:
    with (folder / "descriptors.csv").open() as file:
        truth = {row["id"].rpartition("/")[2]: row for row in csv.DictReader(file)}
    table = Table(title="seven scanned boulders: largest relative difference from their table, and our descriptors")
    for column in ("boulder", "V, S, hull, TS, EI, FI", "B", *FOUR):
        table.add_column(column)
    plain = {"V": "volume", "S": "surface_area", "V_hull": "hull_volume", "solidity": "solidity",
             "TS": "true_sphericity"}  # fmt: skip
    for path in find_scans(folder):
        row, mesh = truth[path.stem], read_scan(path, unit="m").mesh
        values = measure(mesh, (*FOUR, *plain.values()))
        # Their elongation and flatness are along the axes of the solid, their boxiness along those of the surface.
        by_solid = measure(mesh, ("elongation", "flatness"), box="solid")
        changes = [values[ours] / float(row[theirs]) - 1 for theirs, ours in plain.items()]
        changes += [by_solid["elongation"] / float(row["EI"]) - 1, by_solid["flatness"] / float(row["FI"]) - 1]
        box = values["boxiness"] / float(row["B_surfPCA"]) - 1
        cells = (f"{max(map(abs, changes)):.1e}", f"{box:+.1e}", *(f"{values[name]:.3f}" for name in FOUR))
        table.add_row(path.stem, *cells)
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stones", type=int, default=36)
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data")
    options = parser.parse_args()
    console = Console(width=160)
    known_bodies(console)
    resolution(options.stones, console)
    same_body(options.stones, console)
    noise(options.stones, console)
    trends(console)
    database(40, console)
    for name, study in (("fdot57", florida), ("collide", boulders)):
        if (options.data / name).is_dir():
            study(options.data / name, console)
        else:
            console.print(f"{name}: {options.data / name} is not there, not measured")


if __name__ == "__main__":
    main()
