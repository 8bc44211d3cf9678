"""The largest sphere inside a solid (r_in of Wadell's roundness)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from lithoform.descriptors.ascent import ascent_kernel, bounds_kernel, tangent_kernel
from lithoform.descriptors.solids import Sphere
from lithoform.descriptors.surfels import Surfels, bin_surfels, surface_frame
from lithoform.errors import MeshError
from lithoform.mesh import Mesh
from lithoform.warp_runtime import load, shared_array, wp

__all__ = ["inscribed_sphere"]

_SAMPLE_CELL: Final = 0.15
"""Cell of the sampled surface in units of 3 V / S, the radius of a ball with that ratio.

Of 60 generated stones none missed the best of 100 random exact ascents; with 0.2, three did, by up to 0.3 %.
"""

_THIN: Final = 1.5
"""Cell of the sample over the wanted one above which a body is thin for the sample, and faces give starts as well."""

_FACE_STARTS: Final = 48
_START_DEPTH: Final = 1.0e-5
"""Depth of a start below its face, over the extent of the body: half of the thinnest wall that is sure to be found."""

_TANGENT_BALLS: Final = 256
_COARSE_ASCENTS: Final = 20
_EXACT_ASCENTS: Final = 8
_MOST_SCRATCH: Final = 200_000
"""Rows of 36 bytes that the coarse ascents together may take: a thin body has many samples."""

_MOST_STEPS: Final = 120
"""Steps of an exact ascent: 4 to 10 are usual, and about 60 lead from the face of a wall to its middle."""

_WORTH_REFINING: Final = 0.94
"""Coarse maxima below this share of the best one are dropped: sampling moves them by about 2 %."""


def inscribed_sphere(mesh: Mesh) -> Sphere:
    """The largest sphere inside a closed mesh.

    Balls that touch a sampled surface from inside start a few coarse ascents of the distance to the samples; the
    best of these start exact ones on the distance to the triangles (see `lithoform.descriptors.ascent`).

    Parameters
    ----------
    mesh : Mesh
        Closed and outward; of any shape, star-shaped or not.

    Returns
    -------
    Sphere
        Centre and radius in the frame and unit of the mesh.  The radius is a local maximum to rounding, and the
        global one unless two maxima with different radii are hidden from the samples.  Where many centres are
        as good (a long box), one of them.

    Raises
    ------
    MeshError
        If the mesh encloses no positive volume, or is so thin that no point was found inside.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = low + 0.5 * (high - low)
    extent = float((high - low).max())
    if not 0.0 < extent < math.inf:
        raise MeshError(f"expected a body of finite extent above 0, got {extent:g}; check the vertices of the mesh.")
    exponent = math.frexp(extent)[1]
    body = mesh.with_vertices(np.ldexp(mesh.vertices - middle, -exponent))
    frame = surface_frame(body)
    volume = body.volume
    if not volume > 0.0:
        raise MeshError(
            f"an inscribed sphere needs a closed mesh with outward faces, but its volume is {volume:g}; "
            "flip the faces if they point inwards."
        )
    cell = _SAMPLE_CELL * 3.0 * volume / frame.area
    search = _ExactSearch(body)
    surfels = bin_surfels(body, frame, cell)
    found = search.best_of([frame.turned_back(_coarse_maxima(surfels)) + frame.centroid], first_step=0.03)
    if found[1] == 0.0 or surfels.cell > _THIN * cell:
        # Balls leak through a sample that is coarser than the wall; the ascent from just below a face cannot.
        found = search.best_of([found[0][None], _below_faces(body)], first_step=0.25)
    if not found[1] > 0.0:
        raise MeshError(
            "no point was found inside the mesh; check that it is closed and that its faces point outwards."
        )
    return Sphere(middle + np.ldexp(found[0], exponent), math.ldexp(found[1], exponent))


def _below_faces(body: Mesh) -> np.ndarray:
    """Points just inside a few of the faces, shape (k, 3)."""
    chosen = np.linspace(0, len(body.faces) - 1, min(_FACE_STARTS, len(body.faces))).astype(np.int64)
    area = np.sqrt((body.area_vectors[chosen] ** 2).sum(axis=1))
    chosen, area = chosen[area > 0.0], area[area > 0.0]
    normals = body.area_vectors[chosen] / area[:, None]
    return body.vertices[body.faces[chosen]].mean(axis=1) - _START_DEPTH * normals


def _coarse_maxima(surfels: Surfels) -> np.ndarray:
    """Centres of the largest balls among the samples, the best first, shape (k, 3)."""
    chosen = np.linspace(0, len(surfels.areas) - 1, min(_TANGENT_BALLS, len(surfels.areas))).astype(np.int32)
    load(tangent_kernel.module, "cpu")
    positions, normals = (shared_array(a, wp.vec3d) for a in (surfels.positions, surfels.normals))
    reach = wp.empty(len(chosen), dtype=wp.float64, device="cpu")
    inputs = [positions, normals, shared_array(chosen, wp.int32), 0.1 * surfels.cell, reach]
    wp.launch(tangent_kernel, dim=len(chosen), inputs=inputs, device="cpu")
    radii = reach.numpy()
    centres = surfels.positions[chosen] - radii[:, None] * surfels.normals[chosen]
    usable = np.flatnonzero(radii < 1.0)
    order = usable[np.argsort(-radii[usable], kind="stable")]
    if len(order) == 0:
        return np.empty((0, 3))
    count = len(surfels.areas)
    most = min(_COARSE_ASCENTS, max(_EXACT_ASCENTS, _MOST_SCRATCH // count))
    starts = _apart(centres[order], 0.2 * float(radii[order[0]]), most)
    points = np.repeat(np.arange(count, dtype=np.int32), 3).reshape(-1, 3)
    climb = _Ascent(surfels.positions, points, len(starts))
    maxima, heights = climb.run(starts, first_step=0.2, tolerance=1e-3, most_steps=25, check_side=False)
    # Where the sample is thinner than the wall an ascent leaks out, and climbs without end.
    low, high = surfels.positions.min(axis=0), surfels.positions.max(axis=0)
    inside = ((maxima >= low) & (maxima <= high)).all(axis=1)
    maxima, heights = maxima[inside], heights[inside]
    if len(maxima) == 0:
        return maxima
    order = np.argsort(-heights, kind="stable")
    order = order[heights[order] >= _WORTH_REFINING * heights[order[0]]]
    return _apart(maxima[order], 0.1 * float(heights[order[0]]), _EXACT_ASCENTS)


def _apart(points: np.ndarray, distance: float, most: int) -> np.ndarray:
    """The first points that are at least this far from all taken before."""
    taken: list[int] = []
    free = np.ones(len(points), dtype=bool)
    while len(taken) < most and free.any():
        i = int(np.argmax(free))
        taken.append(i)
        away = points - points[i]
        free &= (away * away).sum(axis=1) > distance**2
    return points[taken]


class _Ascent:
    """The ascent kernel with its scratch memory, for a number of starts at a time."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, starts: int) -> None:
        load(ascent_kernel.module, "cpu")
        self.mesh = [shared_array(vertices, wp.vec3d), shared_array(faces, wp.vec3i)]
        n = len(faces)
        bounds = [wp.empty(n, dtype=kind, device="cpu") for kind in (wp.vec3d, wp.float64)]
        wp.launch(bounds_kernel, dim=n, inputs=[*self.mesh, *bounds], device="cpu")
        self.mesh += bounds
        kinds = (wp.float64, wp.vec3d, wp.int32)
        self.scratch = [wp.empty((starts, n), dtype=kind, device="cpu") for kind in kinds]
        self.found = [wp.empty(starts, dtype=kind, device="cpu") for kind in (wp.vec3d, wp.float64)]

    def run(
        self, starts: np.ndarray, *, first_step: float, tolerance: float, most_steps: int, check_side: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Centres, shape (starts, 3), and radii, shape (starts,), of the local maxima."""
        settings = [first_step, tolerance, most_steps, check_side]
        inputs = [*self.mesh, shared_array(np.ascontiguousarray(starts), wp.vec3d), *settings]
        wp.launch(ascent_kernel, dim=len(starts), inputs=[*inputs, *self.scratch, *self.found], device="cpu")
        return self.found[0].numpy().copy(), self.found[1].numpy().copy()


class _ExactSearch:
    """Exact ascents on the triangles of a body, one start after the other."""

    def __init__(self, body: Mesh) -> None:
        self.climb = _Ascent(body.vertices, body.faces, 1)

    def best_of(self, starts: list[np.ndarray], *, first_step: float) -> tuple[np.ndarray, float]:
        """Centre, shape (3,), and radius of the best maximum; a radius of 0 if every start is outside."""
        best: tuple[np.ndarray, float] = (np.zeros(3), 0.0)
        for start in np.concatenate(starts):
            found = self.climb.run(
                start[None], first_step=first_step, tolerance=1e-13, most_steps=_MOST_STEPS, check_side=True
            )
            if found[1][0] > best[1]:
                best = (found[0][0], float(found[1][0]))
        return best
