"""Noise on R^3 as Warp functions: one source, float64, compiled for the CPU and for CUDA.

Gradient noise is Perlin's improved noise (Perlin 2002): quintic fade (eq. 6) and his twelve edge gradients,
chosen by a hash instead of a permutation table, so that it never repeats.  One hash of a lattice cell gives 32
mixed bits; noise channels that are sampled at the same point take disjoint bits of it and share the cell, the
fade and the corner weights.  Cellular noise is Worley's (1996) with one feature point a cell (eq. 20, 21).

References
----------
Perlin, K. (2002). Improving noise. ACM Trans. Graph. 21, 681-682.
Worley, S. (1996). A cellular texture basis function. SIGGRAPH 96, 291-294.
Wellons, C. (2018). Prospecting for hash functions (the constants of the 32-bit finaliser).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from lithoform.errors import MeshError
from lithoform.seeds import MAX_SEED
from lithoform.warp_runtime import MODULE_OPTIONS, load, resolve_device, to_device, wp

__all__ = ["GRADIENTS", "NOISE_BOUND", "PERLIN_SUPREMUM", "cellular_noise", "gradient_noise", "vec2u"]

wp.set_module_options(MODULE_OPTIONS)

PERLIN_SUPREMUM: Final = 1.036353811211803
"""Supremum of Perlin's noise with edge gradients of length sqrt 2, sum_c w_c(t) max_g g.d_c at its largest over the
cell t, rounded up (a test finds it again in exact arithmetic)."""

NOISE_BOUND: Final = 1.0
"""Supremum of |P| here.  Eq. 7 presumes |P| <= 1, which Perlin's own gradients exceed by 3.6 %: ours are shorter."""

GRADIENTS: Final = np.array(
    [
        [1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0],
        [1, 0, 1], [-1, 0, 1], [1, 0, -1], [-1, 0, -1],
        [0, 1, 1], [0, -1, 1], [0, 1, -1], [0, -1, -1],
        [1, 1, 0], [0, -1, 1], [-1, 1, 0], [0, -1, -1],
    ],
    dtype=np.float64,
) / PERLIN_SUPREMUM  # fmt: skip
"""Perlin's (2002) gradients, shape (16, 3): the twelve edge directions, four of them (a tetrahedron) twice, divided by
the supremum of the noise that they would give."""
GRADIENTS.flags.writeable = False

vec2u = wp.types.vector(length=2, dtype=wp.uint32)

# Odd multipliers that spread the three cell coordinates over 32 bits before the finaliser mixes them.
_PRIME_X = wp.constant(wp.uint32(0x8DA6B343))
_PRIME_Y = wp.constant(wp.uint32(0xD8163841))
_PRIME_Z = wp.constant(wp.uint32(0xCB1AB31F))
# Offsets (digits of pi) keep the mirror cells c and -c apart: for odd p, (-a p) xor (-b p) equals (a p) xor (b p)
# whenever a and b hold the same power of 2, and every field would repeat itself about the origin.
_START_X = wp.constant(wp.uint32(0x243F6A88))
_START_Y = wp.constant(wp.uint32(0x85A308D3))
_START_Z = wp.constant(wp.uint32(0x13198A2E))
_MIX_A = wp.constant(wp.uint32(0x7FEB352D))
_MIX_B = wp.constant(wp.uint32(0x846CA68B))
_STEP_A = wp.constant(wp.uint32(0x85EBCA77))
_STEP_B = wp.constant(wp.uint32(0xC2B2AE3D))
_GOLDEN = wp.constant(wp.uint32(0x9E3779B1))
_TO_UNIT = wp.constant(wp.float64(2.0**-32))


@wp.func
def _mix(h: wp.uint32, key: wp.uint32) -> wp.uint32:
    """Finaliser of a 32-bit hash; the second half of the key enters between its two rounds."""
    h = h ^ (h >> wp.uint32(16))
    h = h * _MIX_A + key
    h = h ^ (h >> wp.uint32(15))
    h = h * _MIX_B
    return h ^ (h >> wp.uint32(16))


@wp.func
def _fade(t: wp.float64) -> wp.float64:
    return t * t * t * (t * (t * wp.float64(6.0) - wp.float64(15.0)) + wp.float64(10.0))


@wp.func
def _corner(
    h: wp.uint32,
    weight: wp.float64,
    dx: wp.float64,
    dy: wp.float64,
    dz: wp.float64,
    gradients: wp.array(dtype=wp.vec3d),
) -> wp.vec3d:
    """A corner's share of three noise channels, which take four bits each of the cell's hash."""
    d = wp.vec3d(weight * dx, weight * dy, weight * dz)
    a = gradients[wp.int32(h & wp.uint32(15))]
    b = gradients[wp.int32((h >> wp.uint32(8)) & wp.uint32(15))]
    c = gradients[wp.int32((h >> wp.uint32(16)) & wp.uint32(15))]
    return wp.vec3d(wp.dot(a, d), wp.dot(b, d), wp.dot(c, d))


@wp.func
def gradient_noise_3(x: wp.vec3d, key: vec2u, gradients: wp.array(dtype=wp.vec3d)) -> wp.vec3d:
    """Three independent channels of improved Perlin noise at one point (unused channels cost nothing)."""
    fx = wp.floor(x[0])
    fy = wp.floor(x[1])
    fz = wp.floor(x[2])
    tx = x[0] - fx
    ty = x[1] - fy
    tz = x[2] - fz
    # Unsigned arithmetic wraps: the hash is the same function on every cell of the lattice.
    px = wp.uint32(wp.int32(fx)) * _PRIME_X + _START_X
    py = wp.uint32(wp.int32(fy)) * _PRIME_Y + _START_Y
    pz = wp.uint32(wp.int32(fz)) * _PRIME_Z + _START_Z
    x0 = px ^ key[0]
    x1 = (px + _PRIME_X) ^ key[0]
    y1 = py + _PRIME_Y
    z1 = pz + _PRIME_Z
    one = wp.float64(1.0)
    u = _fade(tx)
    v = _fade(ty)
    w = _fade(tz)
    a = one - u
    v0w0 = (one - v) * (one - w)
    v1w0 = v * (one - w)
    v0w1 = (one - v) * w
    v1w1 = v * w
    sx = tx - one
    sy = ty - one
    sz = tz - one
    n = _corner(_mix(x0 ^ py ^ pz, key[1]), a * v0w0, tx, ty, tz, gradients)
    n += _corner(_mix(x1 ^ py ^ pz, key[1]), u * v0w0, sx, ty, tz, gradients)
    n += _corner(_mix(x0 ^ y1 ^ pz, key[1]), a * v1w0, tx, sy, tz, gradients)
    n += _corner(_mix(x1 ^ y1 ^ pz, key[1]), u * v1w0, sx, sy, tz, gradients)
    n += _corner(_mix(x0 ^ py ^ z1, key[1]), a * v0w1, tx, ty, sz, gradients)
    n += _corner(_mix(x1 ^ py ^ z1, key[1]), u * v0w1, sx, ty, sz, gradients)
    n += _corner(_mix(x0 ^ y1 ^ z1, key[1]), a * v1w1, tx, sy, sz, gradients)
    n += _corner(_mix(x1 ^ y1 ^ z1, key[1]), u * v1w1, sx, sy, sz, gradients)
    return n


@wp.func
def cellular_noise_2(x: wp.vec3d, key: vec2u) -> wp.vec2d:
    """Worley's F1 and F2, both clamped to 1.

    The clamp makes the 27-cell search exact: a point outside the 3x3x3 neighbourhood is at least one cell,
    a distance of 1, away, so that min(F, 1) never misses it.
    """
    fx = wp.floor(x[0])
    fy = wp.floor(x[1])
    fz = wp.floor(x[2])
    tx = x[0] - fx
    ty = x[1] - fy
    tz = x[2] - fz
    cx = wp.int32(fx)
    cy = wp.int32(fy)
    cz = wp.int32(fz)
    nearest = wp.float64(1.0)
    second = wp.float64(1.0)
    for i in range(-1, 2):
        hx = (wp.uint32(cx + wp.int32(i)) * _PRIME_X + _START_X) ^ key[0]
        ax = wp.float64(i) - tx
        for j in range(-1, 2):
            hy = hx ^ (wp.uint32(cy + wp.int32(j)) * _PRIME_Y + _START_Y)
            ay = wp.float64(j) - ty
            for k in range(-1, 2):
                h0 = _mix(hy ^ (wp.uint32(cz + wp.int32(k)) * _PRIME_Z + _START_Z), key[1])
                h1 = _mix(h0 * _GOLDEN, _STEP_A)
                h2 = _mix(h1 * _GOLDEN, _STEP_B)
                dx = ax + wp.float64(h0) * _TO_UNIT
                dy = ay + wp.float64(h1) * _TO_UNIT
                dz = wp.float64(k) - tz + wp.float64(h2) * _TO_UNIT
                d = dx * dx + dy * dy + dz * dz
                second = wp.min(second, wp.max(nearest, d))
                nearest = wp.min(nearest, d)
    return wp.vec2d(wp.sqrt(nearest), wp.sqrt(second))


@wp.kernel(enable_backward=False)
def _gradient_kernel(
    points: wp.array(dtype=wp.vec3d),
    key: vec2u,
    gradients: wp.array(dtype=wp.vec3d),
    out: wp.array(dtype=wp.vec3d),
):
    i = wp.tid()
    out[i] = gradient_noise_3(points[i], key, gradients)


@wp.kernel(enable_backward=False)
def _cellular_kernel(points: wp.array(dtype=wp.vec3d), key: vec2u, out: wp.array(dtype=wp.vec2d)):
    i = wp.tid()
    out[i] = cellular_noise_2(points[i], key)


def split_key(key: int) -> tuple[int, int]:
    """The two 32-bit words of a 64-bit sub-seed."""
    return key & 0xFFFFFFFF, key >> 32


def gradient_noise(points: np.ndarray, key: int, *, device: str = "cpu") -> np.ndarray:
    """Improved Perlin noise of three independent channels.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Points in lattice units, each coordinate below 2^31 in magnitude.
    key : int
        64-bit sub-seed (see `lithoform.seeds.derive`).
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    numpy.ndarray, shape (n, 3), float64
        One column a channel, each within +-`NOISE_BOUND`, zero at every lattice point.

    Raises
    ------
    MeshError
        If the points have another shape, are not finite or lie beyond the lattice, or the key is out of range.
    DeviceError
        If the device is not there.
    """
    return _evaluate(_gradient_kernel, points, key, device, wp.vec3d, gradients=True)


def cellular_noise(points: np.ndarray, key: int, *, device: str = "cpu") -> np.ndarray:
    """Distances (F1, F2) to the nearest and second nearest feature point, clamped to 1 (eq. 20, 21).

    Parameters and errors are those of `gradient_noise`; the result has shape (n, 2).
    """
    return _evaluate(_cellular_kernel, points, key, device, wp.vec2d, gradients=False)


def _evaluate(kernel: Any, points: np.ndarray, key: int, device: str, dtype: Any, *, gradients: bool) -> np.ndarray:
    name = resolve_device(device)
    load(kernel.module, name)
    sites = np.ascontiguousarray(points, dtype=np.float64)
    if sites.ndim != 2 or sites.shape[1] != 3:
        raise MeshError(f"expected points of shape (n, 3), got {sites.shape}.")
    if not (np.abs(sites) < 2.0**31 - 1.0).all():  # False for NaN as well
        raise MeshError("expected finite points with coordinates below 2^31, where the lattice ends.")
    if not 0 <= key <= MAX_SEED:
        raise MeshError(f"expected a key of 0 to 2^64 - 1, got {key}.")
    out = wp.empty(len(sites), dtype=dtype, device=name)
    inputs = [to_device(sites, wp.vec3d, name), vec2u(*split_key(key))]
    if gradients:
        inputs.append(to_device(GRADIENTS, wp.vec3d, name))
    wp.launch(kernel, dim=len(sites), inputs=[*inputs, out], device=name)
    return out.numpy()
