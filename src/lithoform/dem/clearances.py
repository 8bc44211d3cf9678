"""How far blocks are from walls, on the host: to refuse those that are put down inside one."""

from __future__ import annotations

import numpy as np

from lithoform.dem.model import Model
from lithoform.dem.walls import Cylinder

__all__ = ["deepest_in_walls"]


def deepest_in_walls(
    model: Model, position: np.ndarray, orientation: np.ndarray, point: np.ndarray, direction: np.ndarray
) -> tuple[float, int, int]:
    """Deepest overlap of a block whose centre is inside with a wall, in radii of the block.

    Parameters
    ----------
    model : Model
    position, orientation : numpy.ndarray, shape (n, 3) and (n, 4)
        Centres [m], quaternions (x, y, z, w).
    point, direction : numpy.ndarray, shape (k, 3)
        Where the walls are [m], their normals or axes.

    Returns
    -------
    tuple of (float, int, int)
        Overlap over radius, block and wall; 0 or less where no block overlaps.
    """
    from scipy.spatial.transform import Rotation

    deepest = (-np.inf, 0, 0)
    for w, wall in enumerate(model.walls):
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
