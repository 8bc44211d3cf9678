"""Roundness: the mean radius of a body's corners and ridges over that of its inscribed sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.descriptors.curvature import SAME_SIDE, SurfelField, largest_curvatures
from lithoform.descriptors.inscribed import inscribed_sphere
from lithoform.descriptors.solids import Sphere
from lithoform.descriptors.surfels import SurfelGrid, bin_surfels, cell_at, surface_frame
from lithoform.errors import MeshError
from lithoform.mesh import Mesh
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["Roundness", "corner_weights", "roundness"]

wp.set_module_options(MODULE_OPTIONS)

_CELL: Final = 0.25
"""Spacing of surfels over the scale l."""

_CREST_REACH: Final = 0.5
"""Distance over l within which a corner competes with its neighbours."""

_CORNER: Final = 1.05
"""Curvature times r_in above which surface counts as corner (in `corner_fraction` alone, not in the value)."""

_FEWEST_CORNERS: Final = 1.0e-3
"""Share of the surface in corners below which a body has none, and a roundness of 1."""

_COARSEST: Final = 0.4
"""Mean edge over l above which a mesh is called under-resolved."""


@dataclass(frozen=True, eq=False)
class Roundness:
    """Roundness of a body and the surface elements that it comes from; arrays are read-only.

    Attributes
    ----------
    value : float
        R, from near 0 (sharp) to 1 (no corners).
    scale : float
        beta: the length l over which curvature is measured, over the radius of the inscribed sphere.
    inscribed : Sphere
        The largest inscribed sphere, in the frame and unit u of the mesh.
    corner_fraction : float
        Share of the surface whose curvature is above 1.05 / r_in.
    under_resolved : bool
        The mean edge of the mesh, or for very thin bodies the spacing of the surfels, is above 0.4 l: the value
        then says more of the mesh than of the body.
    positions, normals : numpy.ndarray, shape (s, 3)
        Surfels: their centroids [u] and outward unit normals, in the frame of the mesh.
    areas : numpy.ndarray, shape (s,)
        [u^2]
    curvatures : numpy.ndarray, shape (s,)
        Largest principal curvature at the scale l [1/u], convex positive.
    weights : numpy.ndarray, shape (s,)
        w, the weight of each surfel in the mean [u]; 0 away from corners and ridges.
    """

    value: float
    scale: float
    inscribed: Sphere
    corner_fraction: float
    under_resolved: bool
    positions: np.ndarray
    normals: np.ndarray
    areas: np.ndarray
    curvatures: np.ndarray
    weights: np.ndarray


@wp.kernel(enable_backward=False)
def _crest_kernel(
    grid: SurfelGrid,
    curvatures: wp.array(dtype=wp.float64),
    facings: wp.array(dtype=wp.vec3d),
    reach: wp.float64,
    least: wp.float64,
    crests: wp.array(dtype=wp.float64),
):
    """Largest curvature within `reach` on the same side, where the own one is above `least`."""
    i = wp.tid()
    centre = grid.positions[i]
    facing = facings[i]
    crest = curvatures[i]
    if crest > least:
        around = wp.vec3d(reach, reach, reach)
        begin = cell_at(grid, centre - around)
        end = cell_at(grid, centre + around)
        for a in range(begin[0], end[0] + 1):
            for b in range(begin[1], end[1] + 1):
                base = (a * grid.shape[1] + b) * grid.shape[2]
                for j in range(grid.starts[base + begin[2]], grid.starts[base + end[2] + 1]):
                    higher = curvatures[j] > crest
                    if higher and wp.length_sq(grid.positions[j] - centre) < reach * reach:
                        crest = wp.where(wp.dot(grid.normals[j], facing) > SAME_SIDE, curvatures[j], crest)
    crests[i] = crest


def _crests(field: SurfelField, reach: float, least: float) -> np.ndarray:
    """Largest curvature within `reach` of each surfel [1/u], shape (s,); its own where that is below `least`."""
    load(_crest_kernel.module, "cpu")
    crests = np.empty(len(field.areas))
    given = [field.grid, shared_array(field.curvatures, wp.float64), shared_array(field.facings, wp.vec3d)]
    inputs = [*given, reach, least, shared_array(crests, wp.float64)]
    wp.launch(_crest_kernel, dim=len(crests), inputs=inputs, device="cpu")
    return crests


def roundness(mesh: Mesh, *, scale: float = 0.25, inscribed: Sphere | None = None) -> Roundness:
    """Wadell's roundness in three dimensions, as an integral over the surface.

    With k0 = 1 / r_in, k the largest principal curvature at the scale l = beta r_in, and kmax its maximum within
    l / 2,

        R = sum w (1 / k) / (r_in sum w),    w = dA (k - k0)+ (2 k / kmax - 1)+,

    and R = 1 where less than 0.1 % of the surface has k > 1.05 k0.  The first factor lets corners begin without a
    threshold; the second keeps crests: the tops of corners and ridges.

    Parameters
    ----------
    mesh : Mesh
        Closed and outward.
    scale : float
        beta = l / r_in: detail below it is smoothed, so that R is a measure at this scale; a sharp edge has a
        radius of about l / 2 (a sharp cube: R = 0.12 at 0.25).  Two values can be compared only at the same scale.
    inscribed : Sphere, optional
        The largest inscribed sphere, where it is known already.

    Returns
    -------
    Roundness

    Notes
    -----
    Edges sharper than about 35 degrees are seen in part or not at all: the value of a wedge then comes from its
    other edges, and a lens with a rim as sharp as that passes for a body without corners.  So does a body so thin
    (below about 1/100 of its extent) that its rim is less than 0.1 % of its surface; `under_resolved` then warns.

    Raises
    ------
    MeshError
        If the scale or the radius given is not above 0, or the mesh has no inscribed sphere.

    References
    ----------
    Wadell, H. (1932). Volume, shape, and roundness of rock particles. J. Geol. 40, 443-451.
    """
    if not 0.0 < scale < math.inf:
        raise MeshError(f"expected a roundness scale above 0 (a share of the inscribed radius), got {scale}.")
    sphere = inscribed_sphere(mesh) if inscribed is None else inscribed
    if not 0.0 < sphere.radius < math.inf:
        raise MeshError(f"expected an inscribed sphere with a radius above 0, got {sphere.radius}.")
    # In units of the power of two next to r_in, so that no square over- or underflows at any scale of the mesh.
    exponent = math.frexp(sphere.radius)[1]
    body = mesh.with_vertices(np.ldexp(mesh.vertices - sphere.center, -exponent))
    radius = math.ldexp(sphere.radius, -exponent)
    frame = surface_frame(body)
    length = scale * radius
    surfels = bin_surfels(body, frame, _CELL * length)
    field = largest_curvatures(surfels, length)
    k, areas = field.curvatures, field.areas
    least = 1.0 / radius
    excess = np.maximum(k - least, 0.0)
    # Where nothing exceeds k0 the weight is 0 whatever it is divided by, and a flat surfel must not divide by 0.
    crests = np.maximum(_crests(field, _CREST_REACH * length, least), least)
    weights = areas * excess * np.maximum(2.0 * k / crests - 1.0, 0.0)
    corner_fraction = float(areas[k > _CORNER * least].sum() / areas.sum())
    value = 1.0
    if corner_fraction >= _FEWEST_CORNERS:
        value = float((weights / np.maximum(k, least)).sum() / (radius * weights.sum()))
    arrays = (
        np.ldexp(frame.turned_back(field.positions) + frame.centroid, exponent) + sphere.center,
        frame.turned_back(field.normals),
        np.ldexp(areas, 2 * exponent),
        np.ldexp(k, -exponent),
        np.ldexp(weights, exponent),
    )
    for array in arrays:
        array.flags.writeable = False
    return Roundness(
        value, scale, sphere, corner_fraction, max(frame.mean_edge, surfels.cell) > _COARSEST * length, *arrays
    )


def corner_weights(mesh: Mesh, result: Roundness) -> np.ndarray:
    """How much each face counts in the roundness, for colouring a picture.

    Parameters
    ----------
    mesh : Mesh
        The one that was measured.
    result : Roundness

    Returns
    -------
    numpy.ndarray, shape (m,)
        Weight per area of the surfel nearest to the face's centroid on its side, over the largest; 0 to 1.
    """
    from scipy.spatial import cKDTree

    density = result.weights / np.maximum(result.areas, np.finfo(np.float64).tiny)
    largest = density.max()
    if not largest > 0.0:
        return np.zeros(len(mesh.faces))
    centroids = mesh.vertices[mesh.faces].mean(axis=1)
    near = cKDTree(result.positions).query(centroids, k=min(4, len(density)))[1].reshape(len(centroids), -1)
    same_side = np.einsum("fjk,fk->fj", result.normals[near], mesh.area_vectors) > 0.0
    first = np.argmax(same_side, axis=1)
    return density[near[np.arange(len(near)), first]] / largest
