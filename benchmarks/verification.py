"""The engine against closed forms, exact programs and other programs: the numbers of docs/verification.md.

python benchmarks/verification.py [--only gjk jkr impact incline rotor closed walls packing step] [--pairs 100000]
    [--seeds 6] [--coal FOLDER]

FOLDER holds the Python package coal (once hpp-fcl), for the distances of a second library; LAMMPS and YADE are run
where they are installed.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import test_dem_contact as contact
import test_dem_gjk as gjk
import test_dem_motion as motion
from dem_oracles import gross_sliding, hertz_contact_time, polytope_separation
from peers import programs

from lithoform import database_recipe, dem, generate
from lithoform.dem.jkr import NormalContact
from lithoform.parallel import in_order
from lithoform.presets import SHAPE_CLASSES


@dataclass
class Row:
    """A case, what is asked, what was measured, and whether it is good; None where nothing was asked."""

    case: str
    target: str
    measured: str
    good: bool | None


@dataclass
class Options:
    pairs: int
    seeds: int
    coal: Path | None


# ------------------------------------------------------------------------------------------ distances


def distances(options: Options) -> Iterator[Row]:
    share = options.pairs // len(gjk.FAMILIES)
    coal = _coal(options.coal)
    for number, (family, make) in enumerate(gjk.FAMILIES.items()):
        worst = gjk.Report(0, 0.0, 0.0, 0, 0, 0, 0.0, 0)
        differ = wrong = 0
        apart = 0.0
        for part in range(0, share, 1000):
            n = min(1000, share - part)
            pairs = make(np.random.default_rng([number, part]), n)
            found = gjk.judged(pairs)
            worst.pairs += n
            worst.error, worst.unproven = max(worst.error, found.error), max(worst.unproven, found.unproven)
            for name in ("false_overlaps", "missed_overlaps", "not_finite", "overlaps"):
                setattr(worst, name, getattr(worst, name) + getattr(found, name))
            if coal is not None:
                here, disagreed, theirs = _against_coal(coal, pairs)
                apart, differ, wrong = max(apart, here), differ + disagreed, wrong + theirs
        failures = worst.false_overlaps + worst.missed_overlaps + worst.not_finite
        yield Row(
            f"GJK, {family}: {worst.pairs:,} pairs, {worst.overlaps:,} overlap", "1e-12 of size; no failure",
            f"{worst.error:.0e} against the quadratic program, proven to {worst.unproven:.0e}, {failures} failures",
            worst.error < gjk.TOLERANCE and worst.unproven < gjk.TOLERANCE and failures == 0,
        )  # fmt: skip
        if coal is not None:
            told = f"{apart:.0e} at most in {worst.pairs - differ:,} pairs"
            if differ:
                told += f"; {differ} differ by more, of which coal is wrong in {wrong}"
            yield Row("  coal", "1e-12 of size", told, differ == wrong)
    if coal is None:
        yield Row("GJK, second library", "-", "coal is not installed: pip install coal, or --coal FOLDER", None)


def _coal(folder: Path | None) -> Any:
    if folder is not None:
        # At the end: the folder may hold another NumPy.
        sys.path.append(str(folder))
        sys.path += [str(p) for p in folder.glob("cmeel.prefix/lib/python*/site-packages")]
    try:
        return importlib.import_module("coal")
    except ImportError:
        return None


def _against_coal(coal: Any, pairs: gjk.Pairs) -> tuple[float, int, int]:
    """Largest difference below 1e-12 of the size, pairs that differ by more, and those of them where coal is wrong."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = False
    request.gjk_tolerance, request.gjk_max_iterations = 1e-14, 1000
    bodies: dict[tuple[int, float], Any] = {}

    def body(block: int) -> Any:
        key = int(pairs.shape[block]), float(pairs.scale[block])
        if key not in bodies:
            core = pairs.cores[key[0]]
            points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
            for vertex in core.vertices * key[1]:
                points.append(vertex)
            for a, b, c in core.faces.tolist():
                faces.append(coal.Triangle(a, b, c))
            bodies[key] = coal.Convex(points, faces)
        return bodies[key]

    found = gjk.search(pairs)
    largest, differ, wrong = 0.0, 0, 0
    for k in range(pairs.count):
        poses = [coal.Transform3s(Rotation.from_quat(pairs.orientation[b]).as_matrix(), pairs.position[b])
                 for b in (2 * k, 2 * k + 1)]  # fmt: skip
        theirs = max(0.0, coal.distance(body(2 * k), poses[0], body(2 * k + 1), poses[1], request,
                                        coal.DistanceResult()))  # fmt: skip
        ours = 0.0 if found["overlap"][k] else float(np.linalg.norm(found["separation"][k]))
        size = max(pairs.size(k), ours)
        if abs(theirs - ours) <= gjk.TOLERANCE * size:
            largest = max(largest, abs(theirs - ours) / size)
            continue
        differ += 1
        exact = float(np.linalg.norm(polytope_separation(pairs.vertices(2 * k), pairs.vertices(2 * k + 1))))
        wrong += abs(theirs - exact) > gjk.TOLERANCE * size >= abs(ours - exact)
    return largest, differ, wrong


# ------------------------------------------------------------------------------------------ contact


def jkr(_: Options) -> Iterator[Row]:
    law = NormalContact(modulus=55e9 / (2 * (1 - 0.3**2)), radius=0.0025, energy=0.155)
    error = contact.jkr_error(law, points=400)
    yield Row("JKR curve against eq. 31 in 50 digits", "1e-6 of the pull-off force", f"{error:.1e}", error < 1e-6)
    a = law.tear_off_radius * np.linspace(1.0, 3.0, 200_001)
    pull = float(-law.force(law.overlap(a)).min() / law.pull_off_force - 1.0)
    yield Row("JKR pull-off 3 pi gamma r", "1e-6", f"{abs(pull):.1e}", abs(pull) < 1e-6)
    held = float(-law.force(law.tear_off_overlap * (1 - 1e-12)) / law.pull_off_force)
    yield Row("JKR tension at the tear-off", "5/9 = 0.555556", f"{held:.6f}", abs(held - 5 / 9) < 1e-5)
    if programs.LAMMPS is None:
        yield Row("JKR against LAMMPS", "-", "LAMMPS is not installed", None)
        return
    with tempfile.TemporaryDirectory() as folder:
        rows = programs.lammps_jkr(0.005, 5.5e9, 0.3, 0.155, 2e-7, Path(folder))
    law = NormalContact(modulus=5.5e9 / (2 * (1 - 0.3**2)), radius=0.0025, energy=0.155)
    rows = rows[rows[:, 1] != 0.0]
    error = float(np.abs(law.force(rows[:, 0]) - rows[:, 1]).max() / law.pull_off_force)
    yield Row(f"JKR against LAMMPS, {len(rows)} overlaps down to its end at the pull-off",
              "1e-6 of the pull-off force", f"{error:.1e}", error < 1e-6)  # fmt: skip


def impacts(_: Options) -> Iterator[Row]:
    elastic = replace(contact.DRY, restitution=1.0)
    modulus = elastic.youngs_modulus / (2.0 * (1.0 - elastic.poisson_ratio**2))
    mass = elastic.density * 4.0 / 3.0 * math.pi * contact.RADIUS**3
    for on_wall in (False, True):
        share, where = (1.0, "sphere on wall") if on_wall else (0.5, "two spheres")
        times, restitutions = [], []
        for speed in (0.02, 0.1, 0.5, 2.0):
            duration, restitution = contact.impact(elastic, on_wall=on_wall, speed=speed)
            times.append(duration / hertz_contact_time(share * mass, share * contact.RADIUS, modulus, speed) - 1.0)
            restitutions.append(restitution - 1.0)
        worst = max(times, key=abs)
        yield Row(f"Hertz, contact time, {where}, 0.02 to 2 m/s", "0.5 %", f"{worst:+.2%}", abs(worst) < 5e-3)
        worst = max(restitutions, key=abs)
        yield Row(f"Hertz, e = 1, {where}", "1e-3", f"{worst:+.1e}", abs(worst) < 1e-3)
        for asked in (0.05, 0.2, 0.5, 0.9):
            for step in (0.06, 0.015):
                values = [contact.impact(replace(contact.DRY, restitution=asked), on_wall=on_wall, speed=speed,
                                         step=step)[1] for speed in (0.05, 0.5, 2.0)]  # fmt: skip
                good = max(abs(v - asked) for v in values) < 2e-3
                yield Row(f"restitution {asked}, {where}, step {step} of the Rayleigh time; 0.05, 0.5, 2 m/s", "0.002",
                          ", ".join(f"{v:.4f}" for v in values), good)  # fmt: skip
    for friction in (0.1, 0.3):
        angle = math.radians(70.0)
        found, expected = (
            contact.oblique(angle, friction, 0.9),
            gross_sliding(1.0, angle, 0.9, friction, contact.RADIUS),
        )
        worst = max(abs(a / b - 1.0) for a, b in zip(found, expected, strict=True))
        yield Row(f"oblique impact, 70 degrees, mu = {friction}: speed and spin of gross sliding", "0.5 %",
                  f"{worst:.2%}", worst < 5e-3)  # fmt: skip


def inclines(_: Options) -> Iterator[Row]:
    for what, moves, friction, within in (("block slides", contact.slides, 0.5, 0.1),
                                          ("sphere rolls", contact.rolls, 0.35, 0.2)):  # fmt: skip
        exact = math.degrees(math.atan(friction))
        low, high = exact - 5.0, exact + 5.0
        while high - low > 0.002:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if moves(middle) else (middle, high)
        yield Row(f"{what} at atan {friction} = {exact:.2f} degrees", f"{within} degrees", f"{high:.3f}",
                  abs(high - exact) < within)  # fmt: skip


# ------------------------------------------------------------------------------------------ motion


def rotors(_: Options) -> Iterator[Row]:
    for spin, about in (((40.0, 0.0, 90.0), "shortest"), ((90.0, 0.0, 40.0), "longest")):
        for step in (2e-3, 5e-4):
            found = motion.rotor(100.0, step, spin)
            yield Row(f"free asymmetric rotor, near its {about} axis, 100 turns of {1 / step:.0f} steps",
                      "L to rounding; energy 1e-4", f"L {found['momentum']:.0e}, energy {found['energy']:.1e}, "
                      f"angular velocity {found['angular velocity']:.1e}",
                      found["momentum"] < 1e-14 and found["energy"] < 1e-4)  # fmt: skip


def closed(_: Options) -> Iterator[Row]:
    for side, until in ((3, 0.02), (5, 0.02)):
        found = motion.closed_system(until, side)
        yield Row(f"{side**3} stones collide, at most {found['contacts']:.0f} contacts, "
                  f"{1 - found['left']:.0%} of the energy lost", "to rounding; no growth of energy",
                  f"momentum {found['momentum']:.0e}, about the origin {found['angular momentum']:.0e}, "
                  f"energy grew by {found['growth']:.0e}",
                  max(found["momentum"], found["angular momentum"]) < 1e-12 and found["growth"] < 2e-3)  # fmt: skip


def walls(_: Options) -> Iterator[Row]:
    height, overlap, scale, tilt = contact.resting_height((0.02, 0.015, 0.01))
    radius = (0.02 * 0.015 * 0.01 * 3.0 / (4.0 * math.pi)) ** (1.0 / 3.0)
    shared = scale * math.log(4.0)
    error = abs(height + overlap - shared) / overlap
    yield Row("box at rest: height over Hertz's overlap, less ln 4 of the scale of the smooth maximum",
              "1 % of the overlap", f"{error:.1e}; the scale itself {shared / radius:.1e} radii; tilt {tilt:.0e}",
              error < 1e-2 and tilt < 1e-6)  # fmt: skip


# ------------------------------------------------------------------------------------------ packings


def packings(options: Options) -> Iterator[Row]:
    for restitution, until in ((0.8, 0.9), (0.2, 0.6)):
        yield from _packings(options, restitution, until)


def _packings(options: Options, restitution: float, until: float) -> Iterator[Row]:
    found: dict[str, list[dict[str, float]]] = {"lithoform": [], "LAMMPS": [], "YADE": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in range(options.seeds):
            case = programs.Box(seed=seed, restitution=restitution, time=until)
            found["lithoform"].append(case.measures(case.by_lithoform()))
            if programs.LAMMPS is not None:
                found["LAMMPS"].append(case.measures(case.by_lammps(folder)))
            if programs.YADE is not None:
                found["YADE"].append(case.measures(case.by_yade(folder)))
    within = {"density": 0.005, "bulk density": 0.005, "contacts": 0.1}
    ours = {key: np.array([row[key] for row in found["lithoform"]]) for key in within}
    for program, rows in found.items():
        if not rows:
            yield Row(f"500 spheres, e = {restitution}, {program}", "-", f"{program} is not installed", None)
            continue
        for key, limit in within.items():
            values = np.array([row[key] for row in rows])
            error = values.std(ddof=1) / math.sqrt(len(values))
            apart = float(ours[key].mean() - values.mean())
            told = f"{values.mean():.4f} +- {error:.4f}"
            if program != "lithoform":
                told += f"; ours less theirs {apart:+.4f}"
            mine = program == "lithoform"
            yield Row(f"500 spheres, e = {restitution}, {key}, {program}, {len(values)} seeds",
                      "-" if mine else f"{limit}", told,
                      None if mine else abs(apart) < limit)  # fmt: skip


def pressed(seed: int, *, step: float = 0.06, stiffness: float = 2e-3, rate: float = 1.0, count: int = 100) -> float:
    """Packing density of stones that fell into a cylinder, under a platen of 6 kPa.

    With E / 500 their stiffness number is 730: that of E / 5 under 600 kPa.  At E / 1000 a chain of small stones may be
    pressed deeper than the engine allows.
    """
    meshes = [
        generate(database_recipe(name, seed=k).replace(triangles=2000)).mesh for k in range(2) for name in SHAPE_CLASSES
    ]
    shapes = tuple(dem.Shape.from_mesh(mesh) for mesh in meshes)
    material = dem.TABLE_10.softened(stiffness)
    rng = np.random.default_rng(seed)
    diameter = (0.0095**-3 + rng.uniform(size=count) * (0.00475**-3 - 0.0095**-3)) ** (-1.0 / 3.0)
    number = np.arange(count) % len(shapes)
    scale = 0.5 * diameter / np.array([shape.radius for shape in shapes])[number]
    volume = float((math.pi / 6.0 * diameter**3).sum())
    width = (volume / 0.55 / math.pi) ** (1.0 / 3.0)
    floor, mould = dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Cylinder(radius=width)
    model = dem.Model(shapes=shapes, materials=(material,), shape=number, scale=scale, walls=(floor, mould))
    bound = model.bounding_radius
    position, height = np.zeros((count, 3)), 5.0 * volume / (math.pi * width**2)
    order = np.argsort(-bound)
    for k, i in enumerate(order):
        former = order[:k]
        while True:
            at, around = (width - bound[i]) * math.sqrt(rng.uniform()), rng.uniform(0.0, 2.0 * math.pi)
            p = np.array([at * math.cos(around), at * math.sin(around), rng.uniform(bound[i], height)])
            if (np.linalg.norm(position[former] - p, axis=1) > bound[former] + bound[i]).all():
                position[i] = p
                break
            height *= 1.0005
    turn = Rotation.random(count, random_state=seed).as_quat()
    state = dem.State.at_rest(model, position, turn, velocity=np.tile([0.0, 0.0, -1.0], (count, 1)))
    dt = step * min(dem.rayleigh_time(float(r), material) for r in model.radius)
    state = dem.simulate(model, state, until=0.2, dt=dt, threads=1).state
    area = math.pi * width**2
    top = float((state.position[:, 2] + bound).max())
    mass, fastest = float(model.mass.sum()) / 2.0, 0.25 * rate
    # First lightly, so that the stone that is met first does not carry all.
    light, full = (dem.Servo(force=load * area, mass=mass, time=2e-3, max_speed=fastest) for load in (300.0, 6e3))
    model = model.with_walls(floor, mould, dem.Plane(point=(0, 0, top), normal=(0, 0, -1), motion=light))
    state = dem.simulate(model, state.with_walls_of(model), until=state.time + 0.03 / rate, dt=dt, threads=1).state
    model = model.with_motion(2, full)
    state = dem.simulate(model, state, until=state.time + 0.03 + 0.02 / rate, dt=dt, threads=1).state
    return volume / (area * float(state.wall_point[2, 2]))


def steps(options: Options) -> Iterator[Row]:
    variants = {"half the step": {"step": 0.03}, "half the rate": {"rate": 0.5}, "3 E": {"stiffness": 6e-3}}
    # Packings of 100 stones scatter by more than a point: many starts, two at a time.
    seeds = range(4 * options.seeds)
    base = np.array(list(in_order(pressed, seeds)))
    yield Row(f"100 stones under 6 kPa at E/500, {len(seeds)} seeds", "-",
              f"{base.mean():.4f} +- {base.std(ddof=1) / math.sqrt(len(base)):.4f}", None)  # fmt: skip
    for name, changed in variants.items():
        apart = np.array(list(in_order(partial(pressed, **changed), seeds))) - base
        yield Row(f"  {name}", "0.3 point",
                  f"{100 * apart.mean():+.2f} +- {100 * apart.std(ddof=1) / math.sqrt(len(apart)):.2f} points",
                  abs(apart.mean()) < 0.003)  # fmt: skip


SECTIONS = {
    "gjk": distances,
    "jkr": jkr,
    "impact": impacts,
    "incline": inclines,
    "rotor": rotors,
    "closed": closed,
    "walls": walls,
    "packing": packings,
    "step": steps,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--pairs", type=int, default=100_000)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--coal", type=Path)
    arguments = parser.parse_args()
    options = Options(arguments.pairs, arguments.seeds, arguments.coal)
    console = Console(width=180)
    table = Table(title="the engine against its truths")
    for column in ("case", "target", "measured", ""):
        table.add_column(column)
    missed = 0
    for name in arguments.only:
        begin = time.process_time()
        for row in SECTIONS[name](options):
            mark = "" if row.good is None else "ok" if row.good else "missed"
            missed += row.good is not None and not row.good
            table.add_row(row.case, row.target, row.measured, mark)
        table.add_row(f"[dim]{name}: {time.process_time() - begin:.1f} s of this process[/dim]")
    console.print(table)
    console.print(f"{missed} targets missed" if missed else "all targets met")


if __name__ == "__main__":
    main()
