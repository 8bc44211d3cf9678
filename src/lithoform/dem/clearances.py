"""How far blocks are from walls, on the host, and which of their vertices a wall touches together."""

from __future__ import annotations

import numpy as np

from lithoform.dem.materials import pair_constants
from lithoform.dem.model import Model
from lithoform.dem.walls import Cylinder

__all__ = ["deepest_in_walls", "shared_depths"]

# Vertices share a contact with a wall where their depths differ by about this share of the block's radius ...
_SHARED = 1e-4
# ... or this many times F dt^2 / m, F the force at a depth of this many radii. A plate on a scale s rocks at
# sqrt(3 F / (s m)): at 1 / dt there, and at 1.99 / dt at the depth that is a fault; leapfrog is stable below 2 / dt.
_STEADY, _DEEP = 3.0, 0.06


def shared_depths(model: Model, dt: float) -> np.ndarray:
    """By what the depths of vertices that share a contact with a wall differ [m], shape (n, k).

    Parameters
    ----------
    model : Model
    dt : float
        Time step [s].
    """
    shared = np.empty((model.count, len(model.walls)))
    for w, wall in enumerate(model.walls):
        modulus = np.array([
            pair_constants(material, model.materials[wall.material])["modulus"] for material in model.materials
        ])[model.material]  # fmt: skip
        force = 4.0 / 3.0 * modulus * model.radius**2 * _DEEP**1.5
        shared[:, w] = np.maximum(_SHARED * model.radius, _STEADY * force * dt**2 / model.mass)
    return shared


def deepest_in_walls(
    model: Model,
    position: np.ndarray,
    orientation: np.ndarray,
    point: np.ndarray,
    direction: np.ndarray,
    chosen: np.ndarray | None = None,
) -> tuple[float, int, int]:
    """Deepest overlap of a block whose centre is inside with a wall, in radii of the block.

    Parameters
    ----------
    model : Model
    position, orientation : numpy.ndarray, shape (n, 3) and (n, 4)
        Centres [m], quaternions (x, y, z, w).
    point, direction : numpy.ndarray, shape (k, 3)
        Where the walls are [m], their normals or axes.
    chosen : numpy.ndarray of bool, shape (k,), optional
        Walls to look at; by default all.

    Returns
    -------
    tuple of (float, int, int)
        Overlap over radius, block and wall; 0 or less where no block overlaps.
    """
    from scipy.spatial.transform import Rotation

    deepest = (-np.inf, 0, 0)
    for w, wall in enumerate(model.walls):
        if chosen is not None and not chosen[w]:
            continue
        along = (position - point[w]) @ direction[w]
        round_wall = wall if isinstance(wall, Cylinder) else None
        if round_wall is not None:
            off = position - point[w] - along[:, None] * direction[w]
            along = round_wall.radius - np.linalg.norm(off, axis=1)
        for i in np.flatnonzero((along >= 0.0) & (along < model.bounding_radius)):
            core = model.shapes[model.shape[i]].core
            vertices = Rotation.from_quat(orientation[i]).apply(core.vertices * model.scale[i]) + position[i] - point[w]
            height = vertices @ direction[w]
            if round_wall is not None:
                radial = np.linalg.norm(vertices - height[:, None] * direction[w], axis=1)
                height = round_wall.radius - radial
            overlap = (model.margin[i] - float(height.min())) / float(model.radius[i])
            deepest = max(deepest, (overlap, int(i), w))
    return deepest
