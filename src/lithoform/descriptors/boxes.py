"""Boxes about a body: along its principal axes, and the one of least volume.

O'Rourke (1985): two adjacent faces of a box of least volume are flush with edges of the hull, which leaves
O(h^2) families to search, too many for a stone.  Here, as in HYBBRID (Chang, Gorissen, Melchior 2011), exact planar
calipers along many directions give starts; what follows them down is the descent of `lithoform.descriptors.poses`,
which ends in the flush contact itself, and where planar calipers about the three axes then found no more to gain
(600 random polytopes).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lithoform.conditioning import Weighting, principal_frame
from lithoform.descriptors.directions import dot, half_sphere, pointed
from lithoform.descriptors.hull import Hull
from lithoform.descriptors.outlines import planar_poses
from lithoform.descriptors.poses import BOX_VOLUME, descend, distinct_best
from lithoform.descriptors.solids import Box
from lithoform.mesh import Mesh

__all__ = ["minimum_box", "principal_box"]

_DIRECTIONS: Final = 250
"""Directions over half the sphere (8 degrees apart) from which a body is seen first."""

_FACETS: Final = 150
"""Of the facets, those of the largest area whose normals are tried as well."""

_STARTS: Final = 24
"""Poses that are followed down to a local minimum; with 12, one stone in 40 ended 7e-7 above the global one."""


def principal_box(mesh: Mesh, *, weighting: Weighting = "surface") -> Box:
    """Box of a body along its principal axes (eq. 14), as the paper's boxiness takes it.

    Parameters
    ----------
    mesh : Mesh
    weighting : {"vertices", "surface", "solid"}
        What the principal axes are those of; see `lithoform.conditioning.principal_frame`.

    Returns
    -------
    Box
        The extents of all vertices along the axes, sorted.

    Raises
    ------
    MeshError
        If the weighting is unknown or the body has no principal axes.
    """
    centroid, axes = principal_frame(mesh, weighting)
    return _box(mesh.vertices, centroid, axes.T)


def minimum_box(hull: Hull, *, start: Box | None = None) -> Box:
    """The box of least volume about a body, in any orientation.

    Parameters
    ----------
    hull : Hull
    start : Box, optional
        A box that the result must not be larger than, such as the principal box.

    Returns
    -------
    Box
        A local minimum to rounding, and in every case tested the global one.

    References
    ----------
    O'Rourke, J. (1985). Finding minimal enclosing boxes. Int. J. Comput. Inf. Sci. 14(3), 183-199.
    Freeman, H., Shapira, R. (1975). Determining the minimum-area encasing rectangle. Commun. ACM 18(7), 409-413.
    Chang, C.-T., Gorissen, B., Melchior, S. (2011). Fast oriented bounding box optimization on the rotation
    group SO(3,R). ACM Trans. Graph. 30(5), 122.
    """
    directions = [half_sphere(_DIRECTIONS), hull.largest_normals(_FACETS)]
    if start is not None:
        directions.append(start.axes.T)
    poses, values = planar_poses(hull, np.concatenate(directions), BOX_VOLUME)
    chosen = distinct_best(poses, values, _STARTS, BOX_VOLUME)
    poses, values = descend(hull, poses[chosen], BOX_VOLUME)
    box = _box(hull.vertices, hull.vertices[0], poses[np.argmin(values)])
    return start if start is not None and start.volume < box.volume else box


def _box(points: np.ndarray, origin: np.ndarray, axes: np.ndarray) -> Box:
    """Box of points along axes (rows), sorted and right-handed."""
    relative = points - origin
    heights = [dot(relative, e) for e in axes]
    low, high = np.array([(h.min(), h.max()) for h in heights]).T
    order = np.argsort(low - high, kind="stable")
    first, second = (pointed(axes[i]) for i in order[:2])
    middle = (0.5 * (low + high)[:, None] * axes).sum(axis=0)
    return Box(origin + middle, np.stack([first, second, np.cross(first, second)], axis=1), (high - low)[order])
