"""A deck for LIGGGHTS-PUBLIC: clumps as multispheres whose mass and inertia are told, those of the true meshes.

Written for version 3.8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from lithoform.dem import Cylinder, Plane
from lithoform.errors import SceneError
from lithoform.export.clumps import Clump, extremes
from lithoform.export.scene import Scene
from lithoform.export.walls import axis_of, triangles

__all__ = ["liggghts_files"]

# To be simulated after the beginning [s].
_DURATION: Final = 0.2
# Steps in which overlaps that clumps have and blocks had not are let out, the speed of the clump of the most spheres
# falling by e in so many of them, and that of others more slowly.
_RELAXING, _DAMPED = 4000, 20
# LIGGGHTS asks for three different primes a stone; the place that it draws by them is within this share of a radius.
_SEEDS, _EXACT = (15485863, 32452843, 49979687), 1e-6
# Tries of the Monte Carlo integral by which LIGGGHTS finds the centroid of a clump: to about 0.002 of its radius.
_TRIES: Final = 100_000
_LEAST_RESTITUTION: Final = 0.05
# Flat pieces of a cylinder that is inclined.
_SIDES: Final = 96


def liggghts_files(scene: Scene, clumps: Sequence[Clump]) -> dict[str, bytes]:
    """Files of the deck, by name.

    Parameters
    ----------
    scene : Scene
    clumps : sequence of Clump
        Of each shape.

    Returns
    -------
    dict of str to bytes
        in.liggghts, stones.liggghts (which it includes: a template a stone), shape1.txt and so on (spheres of
        a shape), and an STL file of each wall that is inclined.
    """
    files = {"stones.liggghts": _stones(scene, clumps).encode()}
    for number, clump in enumerate(clumps):
        rows = np.concatenate([clump.centres, clump.radii[:, None]], axis=1).tolist()
        files[f"shape{number + 1}.txt"] = "".join(f"{_told(row)}\n" for row in rows).encode()
    _require(scene)
    walls: list[str] = []
    low, high = scene.room
    for number, wall in enumerate(scene.walls):
        lines, triangles = _wall(scene, number, wall)
        walls += lines
        if triangles is not None:
            files[f"wall{number + 1}.stl"] = _stl(triangles)
            # It loses triangles whose middle is outside of the box.
            low, high = np.minimum(low, triangles.min(axis=(0, 1))), np.maximum(high, triangles.max(axis=(0, 1)))
    return {"in.liggghts": _script(scene, clumps, walls, (low, high)).encode(), **files}


def _require(scene: Scene) -> None:
    """Refuse what LIGGGHTS refuses."""
    for material in scene.model.materials:
        if material.poisson_ratio < 0.0:
            raise SceneError(f"expected a Poisson's ratio of at least 0 for LIGGGHTS, got {material.poisson_ratio:g}.")
    numbers = range(len(scene.model.materials))
    least = min(scene.contact(a, b).restitution for a in numbers for b in numbers)
    if least <= _LEAST_RESTITUTION:
        raise SceneError(f"expected a restitution above {_LEAST_RESTITUTION:g} for LIGGGHTS, got {least:g}.")


def _model(scene: Scene) -> str:
    rolls = " rolling_friction epsd2" if any(m.rolling_friction > 0.0 for m in scene.model.materials) else ""
    return f"model hertz tangential history{rolls}"


def _wall(scene: Scene, number: int, wall: Plane | Cylinder) -> tuple[list[str], np.ndarray | None]:
    name, model = f"wall{number + 1}", _model(scene)
    axis, material = axis_of(wall), wall.material + 1
    head = f"fix {name} all wall/gran {model}"
    if axis is not None and isinstance(wall, Plane):
        return [f"{head} primitive type {material} {'xyz'[axis]}plane {wall.point[axis]:.17g}"], None
    if axis is not None and isinstance(wall, Cylinder):
        # LIGGGHTS names the other two in the order of a cycle.
        a, b = wall.point[(axis + 1) % 3], wall.point[(axis + 2) % 3]
        place = f"{'xyz'[axis]}cylinder {wall.radius:.17g} {a:.17g} {b:.17g}"
        return [f"{head} primitive type {material} {place}"], None
    low, high = scene.bounds
    room = float(np.linalg.norm(high - low)) + 2.0 * float(scene.model.bounding_radius.max())
    lines = [f"fix {name}mesh all mesh/surface file {name}.stl type {material} curvature 1e-6",
             f"{head} mesh n_meshes 1 meshes {name}mesh"]  # fmt: skip
    return lines, triangles(wall, 0.5 * (low + high), room, _SIDES)


def _stl(corners: np.ndarray) -> bytes:
    lines = ["solid wall"]
    for a, b, c in corners:
        normal = np.cross(b - a, c - a)
        told = " ".join(f"{x:.9g}" for x in normal / np.linalg.norm(normal))
        lines += [f"facet normal {told}", "outer loop"]
        lines += [f"vertex {' '.join(f'{x:.17g}' for x in corner)}" for corner in (a, b, c)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid wall", ""]).encode()


def _stones(scene: Scene, clumps: Sequence[Clump]) -> str:
    """A template, and a region so small that it is a place, for each stone."""
    model = scene.model
    spins = scene.state.angular_velocity(model)
    lines = ["# Each stone: its spheres, mass and principal moments of inertia; its place and its attitude."]
    for i in range(model.count):
        shape, name = int(model.shape[i]), i + 1
        place, (x, y, z, w) = scene.state.position[i].tolist(), scene.state.orientation[i].tolist()
        a, b, c = model.inertia[i].tolist()
        count, speed, spin = len(clumps[shape]), _told(scene.state.velocity[i].tolist()), _told(spins[i].tolist())
        density = f"atom_type {model.material[i] + 1} density constant {model.density[i]:.17g}"
        lines += [
            (
                f"fix template{name} all particletemplate/multisphere {_SEEDS[0]} {density} nspheres {count} "
                f"ntry {_TRIES} spheres file shape{shape + 1}.txt scale {model.scale[i]:.17g} type {name} "
                f"mass {model.mass[i]:.17g} inertia_tensor {a:.17g} 0 0 {b:.17g} 0 {c:.17g} use_volume"
            ),
            f"fix only{name} all particledistribution/discrete {_SEEDS[1]} 1 template{name} 1.0",
            f"region place{name} sphere {_told(place)} {_EXACT * model.radius[i]:.17g} units box volume_limit 1e-60",
            (
                f"fix put{name} all insert/pack seed {_SEEDS[2]} distributiontemplate only{name} vel constant "
                f"{speed} omega constant {spin} orientation constant {_told([w, x, y, z])} insert_every once "
                f"overlapcheck no all_in no particles_in_region 1 region place{name}"
            ),
        ]
    return "\n".join([*lines, ""])


def _told(numbers: Sequence[float]) -> str:
    return " ".join(f"{x:.17g}" for x in numbers)


def _script(scene: Scene, clumps: Sequence[Clump], walls: Sequence[str], sides: tuple[np.ndarray, np.ndarray]) -> str:
    model = scene.model
    count = len(model.materials)
    low, high = sides
    room = 0.5 * (high - low) + 2.0 * float(model.bounding_radius.max())
    box = " ".join(f"{x:.17g}" for pair in zip(low - room, high + room, strict=True) for x in pair)
    least, _ = extremes(clumps, model)
    pull = float(np.linalg.norm(model.gravity))
    most = max(len(clumps[s]) for s in set(model.shape.tolist()))
    pairs = [scene.contact(a, b) for a in range(count) for b in range(count)]

    def of_pairs(name: str) -> str:
        return " ".join(f"{getattr(contact, name):.17g}" for contact in pairs)

    young, poisson = ([getattr(m, name) for m in model.materials] for name in ("youngs_modulus", "poisson_ratio"))
    lines = [
        f"# {model.count} blocks of {scene.title} as clumps of spheres, written by lithoform.",
        "# Run: liggghts -in in.liggghts",
        "# Settings that may be given on the command line, such as -var steps 200000:",
        f"variable dt index {scene.step:.6g}",
        f"variable relax index {_RELAXING}",
        f"variable steps index {math.ceil(_DURATION / scene.step)}",
        "variable every index 1000",
        "",
        "units si",
        "# Else LIGGGHTS takes no modulus above 1 GPa, and none below 5 MPa.",
        "hard_particles yes",
        "soft_particles yes",
        "atom_style granular",
        "atom_modify map array",
        "boundary f f f",
        "newton off",
        "communicate single vel yes",
        "processors * * 1",
        f"region box block {box} units box",
        f"create_box {count} box",
        f"neighbor {0.5 * least:.17g} bin",
        "neigh_modify delay 0",
        f"fix young all property/global youngsModulus peratomtype {' '.join(f'{x:.17g}' for x in young)}",
        f"fix poisson all property/global poissonsRatio peratomtype {' '.join(f'{x:.17g}' for x in poisson)}",
        f"fix bounce all property/global coefficientRestitution peratomtypepair {count} {of_pairs('restitution')}",
        f"fix slide all property/global coefficientFriction peratomtypepair {count} {of_pairs('sliding')}",
        f"fix roll all property/global coefficientRollingFriction peratomtypepair {count} {of_pairs('rolling')}",
        "# No adhesion: the models of LIGGGHTS for it are others than that of lithoform.",
        f"pair_style gran {_model(scene)}",
        "pair_coeff * *",
        *walls,
    ]
    if pull > 0.0:
        lines.append(f"fix pull all gravity {pull:.17g} vector {' '.join(f'{c / pull:.17g}' for c in model.gravity)}")
    lines += [
        "",
        "include stones.liggghts",
        "fix blocks all multisphere",
        "compute moving all ke/multisphere",
        "compute turning all erotate/multisphere",
        "# Kinetic energy over that of a fall of all blocks by a median diameter.",
        f"variable share equal (c_moving+c_turning)/{scene.fall:.17g}",
        "thermo_style custom step atoms v_share",
        "thermo_modify lost error norm no",
        "thermo ${every}",
        "timestep ${dt}",
        "dump start all custom 1 start.dump id id_multisphere mass radius x y z",
        "run 1",
        "undump start",
        "",
        "# Clumps overlap where the blocks only touched: at first everything moves as in a thick liquid.",
        "# Each sphere has the mass of its whole clump here.",
        f"variable drag atom -mass/({_DAMPED * most}*${{dt}})",
        *(f"variable drag{k} atom v_drag*v{k}" for k in "xyz"),
        "fix liquid all addforce v_dragx v_dragy v_dragz",
        "run ${relax}",
        "unfix liquid",
        "",
        "run ${steps}",
        "dump end all custom 1 end.dump id id_multisphere mass radius x y z vx vy vz",
        "run 1",
        "write_restart end.restart",
        "",
    ]
    return "\n".join(lines)
