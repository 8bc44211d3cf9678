"""Integrals over the faces of a mesh as one Warp kernel: moments of the solid that they enclose, or of the surface.

Faces are summed in fixed runs of 64, and the runs in order, so that the result depends on neither threads
nor device scheduling.  (The same in NumPy needs a dozen temporary arrays and took eight times as long.)
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["face_moments", "surface_moments"]

wp.set_module_options(MODULE_OPTIONS)

_RUN: Final = 64
_COLUMNS: Final = 11


@wp.kernel(enable_backward=False)
def _moments_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    origin: wp.vec3d,
    run: wp.int32,
    of_surface: wp.bool,
    sums: wp.array2d(dtype=wp.float64),
):
    """Sums of twice the areas, of the sides (surface) or six volumes (solid), and of the moments with such weights."""
    k = wp.tid()
    area = wp.float64(0.0)
    extent = wp.float64(0.0)
    first = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    diagonal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    mixed = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for i in range(k * run, wp.min((k + 1) * run, faces.shape[0])):
        f = faces[i]
        a = vertices[f[0]] - origin
        b = vertices[f[1]] - origin
        c = vertices[f[2]] - origin
        n = wp.cross(b - a, c - a)
        t = a + b + c
        double_area = wp.length(n)
        area += double_area
        weight = wp.dot(a, n)
        if of_surface:
            weight = double_area
            extent += wp.length(b - a) + wp.length(c - b) + wp.length(a - c)
        else:
            extent += weight
        first += weight * t
        diagonal += weight * (wp.cw_mul(a, a) + wp.cw_mul(b, b) + wp.cw_mul(c, c) + wp.cw_mul(t, t))
        # yz, zx, xy
        mixed += weight * wp.vec3d(
            a[1] * a[2] + b[1] * b[2] + c[1] * c[2] + t[1] * t[2],
            a[2] * a[0] + b[2] * b[0] + c[2] * c[0] + t[2] * t[0],
            a[0] * a[1] + b[0] * b[1] + c[0] * c[1] + t[0] * t[1],
        )
    sums[k, 0] = area
    sums[k, 1] = extent
    for j in range(3):
        sums[k, 2 + j] = first[j]
        sums[k, 5 + j] = diagonal[j]
        sums[k, 8 + j] = mixed[j]


def face_moments(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Area, signed volume, first and second moments of volume about a point.

    Each face stands for the tetrahedron that it spans with the origin (0, a, b, c), with
    V = a . (b - a) x (c - a) / 6, first moment V (a + b + c) / 4, and second moments
    V / 20 (a a^T + b b^T + c c^T + t t^T), t = a + b + c.

    Parameters
    ----------
    vertices : numpy.ndarray, shape (n, 3), float64
    faces : numpy.ndarray, shape (m, 3), int32
    origin : numpy.ndarray, shape (3,)

    Returns
    -------
    area : float
        [u^2]
    volume : float
        [u^3]
    first : numpy.ndarray, shape (3,)
        Integral of x over the volume [u^4], x from the origin.
    second : numpy.ndarray, shape (3, 3)
        Integral of x x^T over the volume [u^5].
    """
    area, volume, first, second = _sums(vertices, faces, origin, of_surface=False)
    return 0.5 * area, volume / 6.0, first / 24.0, second / 120.0


def surface_moments(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Area, length of all sides, first and second moments of area about a point.

    Each face of area A has the first moment A (a + b + c) / 3 and the second moments
    A / 12 (a a^T + b b^T + c c^T + t t^T), t = a + b + c.

    Parameters
    ----------
    vertices : numpy.ndarray, shape (n, 3), float64
    faces : numpy.ndarray, shape (m, 3), int32
    origin : numpy.ndarray, shape (3,)

    Returns
    -------
    area : float
        [u^2]
    sides : float
        Sum over the faces of the lengths of their three sides [u].
    first : numpy.ndarray, shape (3,)
        Integral of x over the surface [u^3], x from the origin.
    second : numpy.ndarray, shape (3, 3)
        Integral of x x^T over the surface [u^4].
    """
    area, sides, first, second = _sums(vertices, faces, origin, of_surface=True)
    return 0.5 * area, sides, first / 6.0, second / 24.0


def _sums(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, *, of_surface: bool
) -> tuple[float, float, np.ndarray, np.ndarray]:
    load(_moments_kernel.module, "cpu")
    runs = -(-len(faces) // _RUN)
    sums = wp.empty((runs, _COLUMNS), dtype=wp.float64, device="cpu")
    inputs = [
        shared_array(vertices, wp.vec3d),
        shared_array(faces, wp.vec3i),
        wp.vec3d(*origin),
        _RUN,
        of_surface,
        sums,
    ]
    wp.launch(_moments_kernel, dim=runs, inputs=inputs, device="cpu")
    area, extent, *moments = sums.numpy().sum(axis=0)
    first, (xx, yy, zz), (yz, zx, xy) = (np.array(moments[i : i + 3]) for i in (0, 3, 6))
    return float(area), float(extent), first, np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
