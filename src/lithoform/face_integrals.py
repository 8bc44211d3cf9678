"""Integrals over the faces of a mesh as one Warp kernel: area, volume, first and second moments.

Faces are summed in fixed runs of 64, and the runs in order, so that the result depends on neither threads
nor device scheduling.  (The same in NumPy needs a dozen temporary arrays and took eight times as long.)
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["face_moments"]

wp.set_module_options(MODULE_OPTIONS)

_RUN: Final = 64
_SUMS: Final = 11


@wp.kernel(enable_backward=False)
def _moments_kernel(
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    origin: wp.vec3d,
    run: wp.int32,
    sums: wp.array2d(dtype=wp.float64),
):
    k = wp.tid()
    area = wp.float64(0.0)
    volume = wp.float64(0.0)
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
        six = wp.dot(a, n)
        area += wp.length(n)
        volume += six
        first += six * t
        diagonal += six * (wp.cw_mul(a, a) + wp.cw_mul(b, b) + wp.cw_mul(c, c) + wp.cw_mul(t, t))
        # yz, zx, xy
        mixed += six * wp.vec3d(
            a[1] * a[2] + b[1] * b[2] + c[1] * c[2] + t[1] * t[2],
            a[2] * a[0] + b[2] * b[0] + c[2] * c[0] + t[2] * t[0],
            a[0] * a[1] + b[0] * b[1] + c[0] * c[1] + t[0] * t[1],
        )
    sums[k, 0] = area
    sums[k, 1] = volume
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
    load(_moments_kernel.module, "cpu")
    runs = -(-len(faces) // _RUN)
    sums = wp.empty((runs, _SUMS), dtype=wp.float64, device="cpu")
    inputs = [shared_array(vertices, wp.vec3d), shared_array(faces, wp.vec3i), wp.vec3d(*origin), _RUN, sums]
    wp.launch(_moments_kernel, dim=runs, inputs=inputs, device="cpu")
    area, volume, *moments = sums.numpy().sum(axis=0)
    first, (xx, yy, zz), (yz, zx, xy) = (np.array(moments[i : i + 3]) for i in (0, 3, 6))
    second = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    return 0.5 * float(area), float(volume) / 6.0, first / 24.0, second / 120.0
