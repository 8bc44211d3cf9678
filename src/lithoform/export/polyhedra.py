"""Convex hulls with few vertices, for engines whose cost grows with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.dem import Shape
from lithoform.errors import SceneError
from lithoform.topology import sphere

__all__ = ["VERTICES", "Polyhedron", "make_polyhedron"]

VERTICES: Final = 50
"""Vertices of a polyhedron, at most, unless told."""

_MOST: Final = 500


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """Convex polyhedron in the frame of a shape: the origin is the true centre of mass, the axes the principal ones.

    Attributes
    ----------
    vertices : numpy.ndarray, shape (n, 3)
        [m].
    volume_error : float
        Its volume over that of the convex hull of the shape, less 1.
    hull_excess : float
        Its volume over that of the true mesh, less 1: what is solid here and not there.
    mean_distance, max_distance : float
        Between tangent planes of both in 2,562 directions and those of the faces, over the radius of the sphere of
        equal volume.
    """

    vertices: np.ndarray
    volume_error: float
    hull_excess: float
    mean_distance: float
    max_distance: float

    def __len__(self) -> int:
        return len(self.vertices)

    def errors(self) -> dict[str, float]:
        """What was lost, by name."""
        return {name: getattr(self, name) for name in ("volume_error", "hull_excess", "mean_distance", "max_distance")}


def make_polyhedron(shape: Shape, vertices: int = VERTICES) -> Polyhedron:
    """Hull of a shape with few vertices, blown up about the centre of mass to the volume of the whole hull.

    Each time the vertex of the hull is taken that lies farthest outside those before (the first step of the algorithm
    of Barber et al. 1996, stopped early).

    Parameters
    ----------
    shape : Shape
    vertices : int
        At most.

    Raises
    ------
    SceneError
        If the number of vertices is not from 6 to 500.
    """
    from scipy.spatial import ConvexHull

    if not 6 <= vertices <= _MOST:
        raise SceneError(f"expected 6 to {_MOST} vertices of a polyhedron, got {vertices!r}.")
    if shape.mesh is None:
        points = shape.radius * sphere("icosahedral", 2).vertices
    else:
        points = shape.mesh.vertices[ConvexHull(shape.mesh.vertices).vertices]
    taken = sorted({int(k) for axis in range(3) for k in (points[:, axis].argmin(), points[:, axis].argmax())})
    # Two extents may share a vertex; the farthest from the centre fill up what a first hull needs.
    for k in np.argsort(-np.linalg.norm(points, axis=1), kind="stable").tolist():
        if len(taken) >= 6 or len(taken) == len(points):
            break
        if k not in taken:
            taken.append(k)
    hull = ConvexHull(points[taken])
    while len(taken) < min(vertices, len(points)):
        outside = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        farthest = int(outside.argmax())
        if outside[farthest] <= 1e-9 * shape.radius:
            break
        taken.append(farthest)
        hull = ConvexHull(points[taken])
    kept = points[taken][np.sort(hull.vertices)]
    kept = kept * (shape.hull_volume / hull.volume) ** (1.0 / 3.0)
    last = ConvexHull(kept)
    # A vertex of the hull lies farthest outside along the normal of a face.
    directions = np.concatenate([sphere("icosahedral", 16).vertices, last.equations[:, :3]])
    apart = np.abs((directions @ kept.T).max(axis=1) - (directions @ points.T).max(axis=1)) / shape.radius
    volume = float(last.volume)
    return Polyhedron(kept, volume / shape.hull_volume - 1.0, volume / shape.volume - 1.0, float(apart.mean()),
                      float(apart.max()))  # fmt: skip
