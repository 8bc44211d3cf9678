"""From directions and recipes to radii: eq. 1 to 10, many particles in one launch.

The kernel evaluates the three parts of the field that do not depend on the set of directions: the relief
alpha FBM + beta ridges, the chip bracket and the layer factor.  What the paper takes over the sampled
directions, the mean of the chips (eq. 8) and the maximum of |N| (eq. 10), is taken over one fixed set,
the 10,002 directions of the octahedral sphere of 20,000 triangles, so that a recipe is the same stone at
every resolution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.errors import MeshError
from lithoform.noise import GRADIENTS, cellular_noise_2, gradient_noise_3, split_key, vec2u
from lithoform.parameters import Recipe
from lithoform.seeds import Role, derive
from lithoform.topology import sphere
from lithoform.warp_runtime import MODULE_OPTIONS, load, resolve_device, to_device, wp

__all__ = ["RADIUS_FLOOR", "FieldSample", "field", "guarded", "radii", "reference_directions"]

wp.set_module_options(MODULE_OPTIONS)

MAX_OCTAVES: Final = 10

RADIUS_FLOOR: Final = 0.01
"""Least radius in units of r.  At k = 1 the deepest point would lie at the centre, where faces vanish."""

_EPSILON: Final = 1e-12  # of eq. 10: only keeps 0 / 0 away, where the field is 0 everywhere


@wp.struct
class _Field:
    """Scalars of one particle's field, in the notation of Table 1."""

    octaves: wp.int32
    main_scale: wp.float64
    warp_scale: wp.float64
    warp_strength: wp.float64
    phase: wp.vec3d
    fbm_weight: wp.float64
    ridge_weight: wp.float64
    chip_sharpness: wp.float64
    layer_amplitude: wp.float64
    layer_wave: wp.vec3d
    chip_key: vec2u


@wp.kernel(enable_backward=False)
def _field_kernel(
    directions: wp.array(dtype=wp.vec3d),
    fields: wp.array(dtype=_Field),
    frequency: wp.array2d(dtype=wp.float64),
    amplitude: wp.array2d(dtype=wp.float64),
    warp_keys: wp.array2d(dtype=vec2u),
    relief_keys: wp.array2d(dtype=vec2u),
    gradients: wp.array(dtype=wp.vec3d),
    relief: wp.array2d(dtype=wp.float64),
    chips: wp.array2d(dtype=wp.float64),
    layers: wp.array2d(dtype=wp.float64),
):
    particle, site = wp.tid()
    f = fields[particle]
    one = wp.float64(1.0)
    u = directions[site]

    # eq. 2, 3: three channels of FBM displace the domain.
    q = f.warp_scale * u + f.phase
    warp = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for octave in range(f.octaves):
        warp += amplitude[particle, octave] * gradient_noise_3(
            frequency[particle, octave] * q, warp_keys[particle, octave], gradients
        )
    x = f.main_scale * u + f.warp_strength * warp

    # eq. 5, 7: FBM and ridges are two channels over the same lattice; ridges are re-centred to [-1, 1].
    smooth = wp.float64(0.0)
    ridged = wp.float64(0.0)
    for octave in range(f.octaves):
        p = gradient_noise_3(frequency[particle, octave] * x, relief_keys[particle, octave], gradients)
        crest = one - wp.abs(p[1])
        smooth += amplitude[particle, octave] * p[0]
        ridged += amplitude[particle, octave] * (wp.float64(2.0) * crest * crest - one)
    relief[particle, site] = f.fbm_weight * smooth + f.ridge_weight * ridged

    # eq. 8: the exponent is on the whole bracket.
    distance = cellular_noise_2(x, f.chip_key)
    bracket = wp.max(wp.float64(0.0), one - (distance[1] - distance[0]))
    chips[particle, site] = wp.pow(bracket, f.chip_sharpness)

    # eq. 9
    layers[particle, site] = one + f.layer_amplitude * wp.sin(wp.dot(f.layer_wave, x))


@dataclass(frozen=True)
class FieldSample:
    """Parts of the field at a set of directions, each of shape (particles, directions), float64.

    Attributes
    ----------
    relief : numpy.ndarray
        alpha FBM + beta ridges.
    chips : numpy.ndarray
        Chip bracket to the power kappa, before its mean is taken off.
    layers : numpy.ndarray
        Factor of eq. 9.
    """

    relief: np.ndarray
    chips: np.ndarray
    layers: np.ndarray


def reference_directions() -> np.ndarray:
    """The fixed set over which eq. 8's mean and eq. 10's maximum are taken, shape (10002, 3)."""
    return sphere("octahedral", 50).vertices


def field(recipes: Sequence[Recipe], directions: np.ndarray, *, device: str = "cpu") -> FieldSample:
    """Parts of the field of several recipes at common directions, in one launch.

    Parameters
    ----------
    recipes : sequence of Recipe
    directions : numpy.ndarray, shape (n, 3)
        Unit vectors in the model frame.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    FieldSample

    Raises
    ------
    DeviceError
        If the device is not there.
    """
    name = resolve_device(device)
    load(_field_kernel.module, name)
    shape = (len(recipes), len(directions))
    parts = [wp.empty(shape, dtype=wp.float64, device=name) for _ in range(3)]
    frequency, amplitude, warp_keys, relief_keys = _octave_tables(recipes)
    inputs = [
        to_device(directions, wp.vec3d, name),
        wp.array([_pack(recipe) for recipe in recipes], dtype=_Field, device=name),
        to_device(frequency, wp.float64, name),
        to_device(amplitude, wp.float64, name),
        to_device(warp_keys, vec2u, name),
        to_device(relief_keys, vec2u, name),
        to_device(GRADIENTS, wp.vec3d, name),
    ]
    wp.launch(_field_kernel, dim=shape, inputs=inputs, outputs=parts, device=name)
    return FieldSample(*(part.numpy() for part in parts))


def radii(recipes: Sequence[Recipe], directions: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Radii r (1 + k N) of several recipes at common directions (eq. 1 to 10).

    Parameters
    ----------
    recipes : sequence of Recipe
    directions : numpy.ndarray, shape (n, 3)
        Unit vectors in the model frame.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    numpy.ndarray, shape (recipes, n), float64
        Positive radii in model units.  The value at a direction does not depend on the other directions,
        on the other recipes, or on the number of threads.

    Raises
    ------
    MeshError
        If the directions are not unit vectors of shape (n, 3).
    DeviceError
        If the device is not there.
    """
    reference = reference_directions()
    same = directions is reference
    if not same:
        directions = _checked_directions(directions)
    sites = reference if same else np.concatenate([reference, directions])
    sample = field(recipes, sites, device=device)
    out = np.empty((len(recipes), len(directions)))
    for i, recipe in enumerate(recipes):
        fixed = slice(0, len(reference))
        # Taken about the first value, the mean of a constant is exact: eq. 10 would blow its rounding up.
        first = sample.chips[i, 0]
        mean = first + (sample.chips[i, fixed] - first).mean()
        noise = (sample.relief[i] + recipe.chip_weight * (sample.chips[i] - mean)) * sample.layers[i]
        peak = np.abs(noise[fixed]).max()
        factor = 1.0 + (recipe.perturbation / (peak + _EPSILON)) * noise
        out[i] = recipe.base_radius * guarded(factor if same else factor[len(reference) :])
    return out


def _checked_directions(directions: np.ndarray) -> np.ndarray:
    array = np.ascontiguousarray(directions, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise MeshError(f"expected directions of shape (n, 3), got {array.shape}.")
    if not (np.abs(np.sqrt((array * array).sum(axis=1)) - 1.0) < 1e-6).all():  # False for NaN as well
        raise MeshError("expected finite directions of unit length; divide each by its length.")
    return array


def guarded(factor: np.ndarray) -> np.ndarray:
    """Radius factor 1 + k N kept at or above `RADIUS_FLOOR` = c.

    The guard is the identity above 2c, smooth in slope, and non-decreasing: f, c + f^2 / 4c below 2c, c
    below 0.  On the fixed directions only k above 0.98 can reach it; between them |N| may exceed 1 a little,
    and such peaks are left as they are.

    Parameters
    ----------
    factor : numpy.ndarray
        1 + k N, any shape.

    Returns
    -------
    numpy.ndarray
        The same shape, every value at least c.
    """
    floor = RADIUS_FLOOR
    if factor.size == 0 or factor.min() >= 2.0 * floor:
        return factor
    low = np.maximum(factor, 0.0)
    return np.where(factor >= 2.0 * floor, factor, floor + low * low / (4.0 * floor))


def _octave_tables(recipes: Sequence[Recipe]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies lambda^o, normalised amplitudes g^o / A_0 and keys of every octave, padded to ten."""
    count = len(recipes)
    frequency = np.zeros((count, MAX_OCTAVES))
    amplitude = np.zeros((count, MAX_OCTAVES))
    warp_keys = np.zeros((count, MAX_OCTAVES, 2), dtype=np.uint32)
    relief_keys = np.zeros((count, MAX_OCTAVES, 2), dtype=np.uint32)
    for i, recipe in enumerate(recipes):
        octaves = range(recipe.octaves)
        frequency[i, : recipe.octaves] = [recipe.lacunarity**o for o in octaves]
        weights = [recipe.gain**o for o in octaves]
        amplitude[i, : recipe.octaves] = [w / math.fsum(weights) for w in weights]
        for o in octaves:
            warp_keys[i, o] = split_key(derive(recipe.seed, Role.WARP, o))
            relief_keys[i, o] = split_key(derive(recipe.seed, Role.RELIEF, o))
    return frequency, amplitude, warp_keys, relief_keys


def _pack(recipe: Recipe) -> Any:
    f = _Field()
    f.octaves = recipe.octaves
    f.main_scale = recipe.main_scale
    f.warp_scale = recipe.warp_scale
    f.warp_strength = recipe.warp_strength
    f.phase = wp.vec3d(*recipe.phase_offset)
    f.fbm_weight = recipe.fbm_weight
    f.ridge_weight = recipe.ridge_weight
    f.chip_sharpness = recipe.chip_sharpness
    f.layer_amplitude = recipe.layer_amplitude
    wave = 2.0 * math.pi * recipe.layer_frequency / math.hypot(*recipe.layer_normal)
    f.layer_wave = wp.vec3d(*(wave * c for c in recipe.layer_normal))
    f.chip_key = vec2u(*split_key(derive(recipe.seed, Role.CHIPS)))
    return f
