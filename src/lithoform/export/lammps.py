"""A deck for LAMMPS: clumps as rigid bodies whose mass, centre and inertia are told, those of the true meshes.

Written for the version of 29 September 2021 and later, with the packages GRANULAR and RIGID.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from lithoform.dem import Cylinder, Plane
from lithoform.export.clumps import Clump, extremes
from lithoform.export.scene import Contact, Scene

__all__ = ["lammps_files"]

# Steps in which overlaps that clumps have and blocks had not are let out, the speed falling by e in so many of them.
_RELAXING, _DAMPED = 4000, 20
# To be simulated after that [s].
_DURATION: Final = 0.2
# Weights of a median block on a contact, of which the stiffness of its rolling is taken.
_WEIGHTS: Final = 10.0


def lammps_files(scene: Scene, clumps: Sequence[Clump]) -> dict[str, bytes]:
    """Files of the deck, by name.

    Parameters
    ----------
    scene : Scene
    clumps : sequence of Clump
        Of each shape.

    Returns
    -------
    dict of str to bytes
        in.lammps, data.lammps (the spheres) and bodies.lammps (the rigid bodies).
    """
    sides = _box(scene, clumps)
    return {
        "in.lammps": _script(scene, clumps).encode(),
        "data.lammps": _spheres(scene, clumps, sides).encode(),
        "bodies.lammps": _bodies(scene).encode(),
    }


def rolling_stiffness(scene: Scene, contact: Contact) -> float:
    """8 G* a [N/m], a of Hertz's contact of two median blocks under ten times their weight.

    With it a moment of R^2 times this an angle is that of the engine (its a is that of each contact).
    """
    radius = 0.5 * float(np.median(scene.model.radius))
    pull = max(float(np.linalg.norm(scene.model.gravity)), 1e-3)
    force = _WEIGHTS * float(np.median(scene.model.mass)) * pull
    return 8.0 * contact.shear * (0.75 * force * radius / contact.modulus) ** (1.0 / 3.0)


def _law(scene: Scene, a: int, b: int, *, wall: bool = False) -> str:
    """Normal, tangential and rolling model of the contact of two materials.

    At walls by the stiffnesses themselves: those that LAMMPS of 2021 makes of the moduli there are 30 % too large and
    39 % too small.
    """
    contact = scene.contact(a, b)
    modulus, restitution = f"{contact.youngs_modulus:.17g}", f"{contact.restitution:.17g}"
    shear = "NULL"
    if wall:
        normal = f"hertz {4.0 / 3.0 * contact.modulus:.17g} {restitution}"
        shear = f"{8.0 * contact.shear:.17g}"
    elif contact.energy > 0.0:
        normal = f"jkr {modulus} {restitution} {contact.poisson_ratio:.17g} {contact.energy:.17g}"
    else:
        normal = f"hertz/material {modulus} {restitution} {contact.poisson_ratio:.17g}"
    text = f"{normal} tangential mindlin {shear} 1.0 {contact.sliding:.17g}"
    if contact.rolling > 0.0:
        stiffness = rolling_stiffness(scene, contact)
        # As hard to roll as critical damping of a median block makes it.
        drag = 2.0 * math.sqrt(stiffness * float(np.median(scene.model.mass)))
        text += f" rolling sds {stiffness:.17g} {drag:.17g} {contact.rolling:.17g}"
    return f"{text} twisting marshall damping tsuji"


def _box(scene: Scene, clumps: Sequence[Clump]) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the box of the simulation: about the blocks and the walls, with room for those that jump."""
    low, high = scene.room
    _, reach = extremes(clumps, scene.model)
    room = 0.5 * (high - low) + 2.0 * reach
    return low - room, high + room


def _spheres(scene: Scene, clumps: Sequence[Clump], sides: tuple[np.ndarray, np.ndarray]) -> str:
    model = scene.model
    rows, molecules = [], []
    number = 0
    for block in range(model.count):
        clump = clumps[model.shape[block]]
        radii = clump.radii * model.scale[block]
        places = scene.state.position[block] + (clump.centres * model.scale[block]) @ scene.rotations[block].T
        # Together the spheres have the mass of the block: what damps a contact, and what the thermodynamic output sums.
        density = float(model.mass[block] / (4.0 / 3.0 * math.pi * (radii**3).sum()))
        for radius, (x, y, z) in zip(radii.tolist(), places.tolist(), strict=True):
            number += 1
            rows.append(f"{number} {model.material[block] + 1} {2.0 * radius!r} {density!r} {x!r} {y!r} {z!r}")
            molecules.append(f"{number} {block + 1}")
    extents = [f"{a!r} {b!r} {k}lo {k}hi" for a, b, k in zip(sides[0].tolist(), sides[1].tolist(), "xyz", strict=True)]
    head = [f"lithoform: {model.count} blocks as {number} spheres", "", f"{number} atoms",
            f"{len(model.materials)} atom types", *extents]  # fmt: skip
    return "\n".join([*head, "", "Atoms # sphere", "", *rows, "", "Molecules", "", *molecules, ""])


def _bodies(scene: Scene) -> str:
    """Mass, centre of mass, inertia, velocity and angular momentum of each block, in the axes of the world."""
    model, state = scene.model, scene.state
    rows = ["# block, mass, centre x y z, inertia xx yy zz xy xz yz, velocity, angular momentum, images (SI units)",
            str(model.count)]  # fmt: skip
    tensor = scene.inertia
    six = np.stack([tensor[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=1)
    numbers = np.concatenate([model.mass[:, None], state.position, six, state.velocity, state.angular_momentum], axis=1)
    rows += [f"{k + 1} {' '.join(map(repr, row))} 0 0 0" for k, row in enumerate(numbers.tolist())]
    return "\n".join([*rows, ""])


def _wall(scene: Scene, number: int, wall: Plane | Cylinder) -> list[str]:
    """Region of a wall and its contact with the blocks of each material.

    Without adhesion: with it the walls of LAMMPS of 2021 give forces that are no numbers.
    """
    name = f"wall{number + 1}"
    if isinstance(wall, Plane):
        place = " ".join(f"{x:.17g}" for x in (*wall.point, *wall.normal))
        lines = [f"region {name} plane {place}"]
    else:
        lines = _cylinder(scene, name, wall)
    lines += [
        f"fix {name}_{material + 1} material{material + 1} wall/gran/region granular "
        f"{_law(scene, wall.material, material, wall=True)} region {name}"
        for material in sorted({int(m) for m in scene.model.material})
    ]
    return lines


def _cylinder(scene: Scene, name: str, wall: Cylinder) -> list[str]:
    """Regions of LAMMPS stand along an axis of the box: an inclined one is turned by a constant angle."""
    axis = np.array(wall.axis) * (1.0 if wall.axis[2] >= 0.0 else -1.0)
    low, high = scene.room
    length = 10.0 * float(np.linalg.norm(high - low)) + 10.0 * wall.radius
    x, y, z = wall.point
    lines = []
    turned = ""
    about = np.cross([0.0, 0.0, 1.0], axis)
    sine = float(np.linalg.norm(about))
    if sine > 1e-12:
        lines.append(f"variable {name}angle equal {math.atan2(sine, float(axis[2])):.17g}")
        way = " ".join(f"{c:.17g}" for c in about / sine)
        turned = f" rotate v_{name}angle {x:.17g} {y:.17g} {z:.17g} {way}"
    ends = f"{z - length:.17g} {z + length:.17g}"
    return [*lines, f"region {name} cylinder z {x:.17g} {y:.17g} {wall.radius:.17g} {ends} open 1 open 2{turned}"]


def _script(scene: Scene, clumps: Sequence[Clump]) -> str:
    model = scene.model
    used = sorted({int(m) for m in model.material})
    least, reach = extremes(clumps, model)
    pull = float(np.linalg.norm(model.gravity))
    dt = scene.step
    lines = [
        f"# {model.count} blocks of {scene.title} as clumps of spheres, written by lithoform.",
        "# Run: lmp -in in.lammps, or on several processors: mpirun -np 4 lmp -in in.lammps",
        "# Settings that may be given on the command line, such as -var steps 200000:",
        f"variable dt index {dt:.6g}",
        f"variable relax index {_RELAXING}",
        f"variable steps index {math.ceil(_DURATION / dt)}",
        "variable every index 1000",
        "",
        "units si",
        "atom_style sphere",
        "atom_modify map array",
        "boundary f f f",
        "newton off",
        "processors * * 1",
        # A rank must see whole clumps, and the neighbours of its own.
        f"comm_modify mode single vel yes cutoff {2.0 * reach + 4.0 * least:.17g}",
        "fix stone all property/atom mol ghost yes",
        "read_data data.lammps fix stone NULL Molecules",
        f"neighbor {0.5 * least:.17g} bin",
        "neigh_modify delay 0 every 1 check yes exclude molecule/intra all",
        "pair_style granular",
        *(f"pair_coeff {a + 1} {b + 1} {_law(scene, a, b)}"
          for a in range(len(model.materials)) for b in range(a, len(model.materials))),
        *(f"group material{m + 1} type {m + 1}" for m in used),
        "",
    ]  # fmt: skip
    gravity = ""
    if pull > 0.0:
        way = " ".join(f"{c / pull:.17g}" for c in model.gravity)
        # Not on the spheres, whose masses are not spread as that of the block, but on the bodies.
        lines.append(f"fix pull all gravity {pull:.17g} vector {way} disable")
        gravity = " gravity pull"
    lines += [
        f"fix blocks all rigid/small molecule infile bodies.lammps{gravity}",
        "compute moving all ke/rigid blocks",
        "compute turning all erotate/rigid blocks",
        "compute body all rigid/local blocks mol mass x y z quatw quati quatj quatk inertiax inertiay inertiaz",
        "variable kinetic equal c_moving+c_turning",
        "# Kinetic energy over that of a fall of all blocks by a median diameter.",
        f"variable share equal v_kinetic/{scene.fall:.17g}",
        "thermo_style custom step v_kinetic v_share",
        "thermo_modify lost error norm no",
        "thermo ${every}",
        "timestep ${dt}",
        "dump start all local 1 start.dump c_body[*]",
        "dump_modify start format float %.15g",
        "run 0",
        "undump start",
        "",
        "# Walls come now, and all is one run: at each further one LAMMPS of 2021 would damp at them otherwise.",
        *(line for number, wall in enumerate(scene.walls) for line in _wall(scene, number, wall)),
        "",
        "# Clumps overlap where the blocks only touched: at first everything moves as in a thick liquid.",
        f"variable drag atom -mass/({_DAMPED}*v_dt)*(step<=v_relax)",
        *(f"variable drag{k} atom v_drag*v{k}" for k in "xyz"),
        "fix liquid all addforce v_dragx v_dragy v_dragz",
        "variable all equal v_relax+v_steps",
        "run ${all}",
        "unfix liquid",
        "",
        "dump end all local 1 end.dump c_body[*]",
        "dump_modify end format float %.15g",
        "run 0",
        "write_restart end.restart",
        "",
    ]
    return "\n".join(lines)
