"""A deck for YADE: convex polyhedra with the mass, centre of mass and inertia of the true meshes.

Written for YADE 2023.02 and later, built with CGAL.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from importlib.resources import files
from typing import Any, Final

import numpy as np

from lithoform.dem import Cylinder, Plane
from lithoform.export.polyhedra import Polyhedron
from lithoform.export.scene import Scene
from lithoform.export.walls import axis_of, triangles

__all__ = ["yade_files"]

# Flat pieces of a cylinder: it is wider at their joints by 0.1 % of its radius.
_SIDES: Final = 72
# Time step over sqrt(m / k) of the smallest block, k the stiffness of a face as wide as the block.
_STEP: Final = 0.3
# Steps of the beginning, in which polyhedra that overlap are let apart under strong damping; and time after that [s].
_RELAXING, _DURATION = 1000, 0.2


def yade_files(scene: Scene, polyhedra: Sequence[Polyhedron]) -> dict[str, bytes]:
    """Files of the deck, by name.

    Parameters
    ----------
    scene : Scene
    polyhedra : sequence of Polyhedron
        Of each shape.

    Returns
    -------
    dict of str to bytes
        run_yade.py, and scene.json which it reads.
    """
    told = json.dumps(_content(scene, polyhedra), allow_nan=False)
    script = files("lithoform.export").joinpath("run_yade.txt").read_bytes()
    return {"run_yade.py": script, "scene.json": (told + "\n").encode()}


def _content(scene: Scene, polyhedra: Sequence[Polyhedron]) -> dict[str, Any]:
    model, state = scene.model, scene.state
    stiffness = [_stiffness(scene, m) for m in range(len(model.materials))]
    least = math.sqrt(
        min(
            float(mass / (stiffness[m] * math.pi * radius**2))
            for mass, m, radius in zip(model.mass, model.material, model.radius, strict=True)
        )
    )
    low, high = scene.bounds
    room = float(np.linalg.norm(high - low)) + 2.0 * float(model.bounding_radius.max())
    dt = _STEP * least
    return {
        "source": scene.source,
        "gravity": list(model.gravity),
        "dt": dt,
        "relax": _RELAXING,
        "steps": math.ceil(_DURATION / dt),
        "fall": 2.0 * float(np.median(model.radius)),
        "materials": [
            {"young": 2.0 * k, "density": m.density, "friction": math.atan(scene.contact(i, i).sliding)}
            for i, (k, m) in enumerate(zip(stiffness, model.materials, strict=True))
        ],
        "shapes": [polyhedron.vertices.tolist() for polyhedron in polyhedra],
        "blocks": [
            {"shape": int(model.shape[i]), "scale": float(model.scale[i]), "material": int(model.material[i]),
             "position": state.position[i].tolist(), "orientation": state.orientation[i].tolist(),
             "velocity": state.velocity[i].tolist(), "angular_velocity": spin.tolist(),
             "mass": float(model.mass[i]), "inertia": model.inertia[i].tolist()}
            for i, spin in enumerate(state.angular_velocity(model))
        ],
        "walls": [piece for wall in scene.walls for piece in _wall(wall, 0.5 * (low + high), room)],
    }  # fmt: skip


def _stiffness(scene: Scene, material: int) -> float:
    """Force over common volume [N/m^3]: E* over the radius of a median block.

    YADE's law of polyhedra has no radius of curvature in it, and Hertz's law cannot be told to it. It is told twice
    this number for each material, of which it takes the product over the sum.
    """
    return scene.contact(material, material).modulus / float(np.median(scene.model.radius))


def _wall(wall: Plane | Cylinder, middle: np.ndarray, room: float) -> list[dict[str, Any]]:
    """Planes across an axis as YADE's walls; other planes and cylinders as triangles."""
    axis = axis_of(wall)
    if isinstance(wall, Plane) and axis is not None:
        sense = 1 if wall.normal[axis] > 0.0 else -1
        return [{"kind": "wall", "axis": axis, "at": wall.point[axis], "sense": sense, "material": wall.material}]
    return [
        {"kind": "triangle", "corners": corners.tolist(), "material": wall.material}
        for corners in triangles(wall, middle, room, _SIDES)
    ]
