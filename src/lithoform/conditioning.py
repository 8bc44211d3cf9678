"""Mesh to mesh, the steps of Algorithm 1, each its own pure function: twist, smooth, fit_to_box.

The last step, `flatten`, is long enough for a module of its own: `lithoform.flattening`.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import MeshError
from lithoform.mesh import Mesh

__all__ = ["fit_to_box", "principal_frame", "smooth", "twist"]

Weighting = Literal["vertices", "surface", "solid"]


def twist(mesh: Mesh, *, axis: ArrayLike, point: ArrayLike, rate: float) -> Mesh:
    """Turn every vertex about an axis by an angle proportional to its axial coordinate (eq. 11, 12).

    Parameters
    ----------
    mesh : Mesh
    axis : array_like, shape (3,)
        Direction of the axis, any length but 0.
    point : array_like, shape (3,)
        A point on the axis, where the angle is 0 [unit of the mesh].
    rate : float
        Twist rate [rad per unit length of the mesh].

    Returns
    -------
    Mesh
        Distances to the axis, and coordinates along it, are those of the input.

    Raises
    ------
    MeshError
        If the axis has no direction or an argument is not finite.
    """
    a, p0 = np.asarray(axis, dtype=np.float64), np.asarray(point, dtype=np.float64)
    length = float(np.linalg.norm(a))
    if a.shape != (3,) or p0.shape != (3,) or not (0.0 < length < math.inf) or not math.isfinite(rate + p0.sum()):
        raise MeshError(
            f"a twist needs an axis (a direction), a point and a rate, all finite; got {axis}, {point}, {rate}."
        )
    a = a / length
    if rate == 0.0:
        return mesh
    d = _rows(mesh.vertices, p0)
    along = _project(d, a)
    angle = rate * along
    cosine, sine = np.cos(angle), np.sin(angle)
    v = [d[i] - along * a[i] for i in range(3)]
    turned = [a[j] * v[k] - a[k] * v[j] for j, k in ((1, 2), (2, 0), (0, 1))]
    rows = [p0[i] + along * a[i] + cosine * v[i] + sine * turned[i] for i in range(3)]
    return mesh.with_vertices(np.stack(rows, axis=1))


def _rows(points: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Coordinates relative to an origin, shape (3, n): long contiguous rows are what NumPy is fast with."""
    return np.ascontiguousarray(points.T) - origin[:, None]


def _project(rows: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Coordinate along a direction, shape (n,); no matrix product, which may round differently with threads."""
    return rows[0] * direction[0] + rows[1] * direction[1] + rows[2] * direction[2]


def smooth(
    mesh: Mesh,
    *,
    iterations: int,
    method: Literal["laplacian", "taubin"] = "laplacian",
    lambda_: float = 0.5,
    mu: float = -0.53,
) -> Mesh:
    """Move every vertex towards the mean of its neighbours (eq. 13).

    Parameters
    ----------
    mesh : Mesh
    iterations : int
        Number of steps; a Taubin step is a pair of a forward and a backward one.
    method : {"laplacian", "taubin"}
        Laplacian smoothing shrinks the body; the Taubin (1995) pair (lambda | mu) does not.
    lambda_ : float
        Step, 0 < lambda <= 1.
    mu : float
        Backward step of the Taubin pair, below -lambda.

    Returns
    -------
    Mesh

    Raises
    ------
    MeshError
        If an argument is outside its range.

    References
    ----------
    Taubin, G. (1995). A signal processing approach to fair surface design. SIGGRAPH 95, 351-358.
    """
    if iterations < 0 or not 0.0 < lambda_ <= 1.0:
        raise MeshError(f"smoothing needs iterations >= 0 and 0 < lambda <= 1; got {iterations} and {lambda_}.")
    if method not in ("laplacian", "taubin"):
        raise MeshError(f"expected a smoothing method of laplacian or taubin; got {method!r}.")
    if method == "taubin" and not mu < -lambda_:
        raise MeshError(f"a Taubin pair needs mu < -lambda, or it shrinks; got mu = {mu} and lambda = {lambda_}.")
    steps = (lambda_,) if method == "laplacian" else (lambda_, mu)
    vertices = mesh.vertices
    for _ in range(iterations):
        for step in steps:
            vertices = vertices + step * (mesh.connectivity.neighbour_mean @ vertices - vertices)
    return mesh.with_vertices(vertices) if iterations else mesh


def principal_frame(mesh: Mesh, weighting: Weighting = "vertices") -> tuple[np.ndarray, np.ndarray]:
    """Centroid and principal axes of a body (eq. 14).

    Parameters
    ----------
    mesh : Mesh
    weighting : {"vertices", "surface", "solid"}
        What carries the mass: each vertex the same (as printed in the paper), the surface, or the volume.

    Returns
    -------
    centroid : numpy.ndarray, shape (3,)
    axes : numpy.ndarray, shape (3, 3)
        Columns e1, e2, e3 in the order of falling variance, right-handed; e1 and e2 point so that their
        component of largest magnitude is positive.

    Raises
    ------
    MeshError
        If the weighting is unknown or the body has no volume.
    """
    if weighting == "vertices":
        rows = np.ascontiguousarray(mesh.vertices.T)
        centroid = rows.mean(axis=1)
        x = rows - centroid[:, None]
        covariance = np.array([[float((x[i] * x[j]).sum()) for j in range(3)] for i in range(3)])
    elif weighting == "surface":
        centroid, covariance = _surface_moments(mesh)
    elif weighting == "solid":
        properties = mesh.mass_properties
        centroid = properties.centroid
        covariance = 0.5 * np.trace(properties.inertia) * np.eye(3) - properties.inertia
    else:
        raise MeshError(f"expected a weighting of vertices, surface or solid; got {weighting!r}.")
    if not np.isfinite(covariance).all():
        raise MeshError("the body is too large or too far away for its principal axes; scale it or move it first.")
    axes = np.linalg.eigh(covariance)[1][:, ::-1].copy()
    for column in (0, 1):
        e = axes[:, column]
        axes[:, column] = e if e[np.argmax(np.abs(e))] > 0 else -e
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return centroid, axes


def _surface_moments(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    # Warp is loaded when a surface is first measured.
    from lithoform.face_integrals import surface_moments

    origin = mesh.vertices[0]
    area, _, first, second = surface_moments(mesh.vertices, mesh.faces, origin)
    if not 0.0 < area < math.inf:
        raise MeshError(f"a body needs a finite surface for its principal axes; its area is {area:g}.")
    offset = first / area
    return origin + offset, second - area * np.outer(offset, offset)


def fit_to_box(
    mesh: Mesh,
    size: ArrayLike,
    *,
    frame: Literal["pca", "aabb"] = "pca",
    weighting: Weighting = "vertices",
    fit: Literal["exact", "uniform"] = "exact",
    align: bool = True,
) -> Mesh:
    """Scale a body about its centroid to a target box (eq. 14 to 17).

    Parameters
    ----------
    mesh : Mesh
    size : array_like, shape (3,)
        Target extents L, W, H along the first, second and third axis of the frame [unit of the result].
    frame : {"pca", "aabb"}
        The principal axes, or the coordinate axes x, y, z.
    weighting : {"vertices", "surface", "solid"}
        What the principal axes (and the centroid) are taken of; "aabb" uses its centroid alone.
    fit : {"exact", "uniform"}
        One factor an axis, so that the extents equal the targets; or one factor for all, the largest with
        which the body stays inside the box (it then touches at least one pair of faces).
    align : bool
        Turn the principal axes onto x, y, z (L along x, W along y, H along z).  False leaves the body in
        its pose, as eq. 16 prints it; the extents then hold along the principal axes.

    Returns
    -------
    Mesh
        The centroid about which it was scaled stays where it was (that of the surface only if all factors are
        equal: it is not carried along by other maps).

    Raises
    ------
    MeshError
        If the targets are not three positive numbers, the body is flat along an axis, or a name is unknown.
    """
    target = np.asarray(size, dtype=np.float64)
    if target.shape != (3,) or not (np.isfinite(target).all() and (target > 0).all()):
        raise MeshError(f"a box needs three positive extents; got {size}.")
    if frame not in ("pca", "aabb") or fit not in ("exact", "uniform"):
        raise MeshError(f"expected a frame of pca or aabb and a fit of exact or uniform; got {frame!r} and {fit!r}.")
    centroid, axes = principal_frame(mesh, weighting)
    if frame == "aabb":
        axes = np.eye(3)
    x = _rows(mesh.vertices, centroid)
    local = [_project(x, e) for e in axes.T]
    extents = np.array([row.max() - row.min() for row in local])
    if not (extents > 1e-12 * extents.max()).all():
        raise MeshError(f"the body is flat: its extents along the axes of the box are {extents.tolist()}.")
    factors = target / extents
    if fit == "uniform":
        factors = np.full(3, factors.min())
    scaled = np.stack([row * factor for row, factor in zip(local, factors, strict=True)])
    if not align:
        scaled = np.stack([_project(scaled, r) for r in axes])
    return mesh.with_vertices((scaled + centroid[:, None]).T)
