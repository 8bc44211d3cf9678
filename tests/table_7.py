"""Random recipes over the whole of Table 7, for the tests and for benchmarks/soundness.py."""

from __future__ import annotations

import math

import numpy as np

from lithoform import PARAMETERS, Recipe

_SWEPT = [p for p in PARAMETERS if p.name in {
    "base_radius", "perturbation", "main_scale", "warp_scale", "warp_strength", "phase_offset", "octaves", "lacunarity",
    "gain", "fbm_weight", "ridge_weight", "chip_weight", "chip_sharpness", "layer_amplitude", "layer_frequency",
    "twist_rate",
}]  # fmt: skip


def random_recipe(rng: np.random.Generator, triangles: int) -> Recipe:
    """A recipe drawn from the whole of Table 7, with random dimensions, twist axis and twist point."""
    values: dict[str, object] = {}
    for p in _SWEPT:
        if p.kind == "integer":
            values[p.name] = int(rng.integers(p.low, p.high + 1))
        elif p.kind == "vector":
            values[p.name] = tuple(rng.uniform(p.low, p.high, 3))
        elif p.name == "chip_sharpness":
            values[p.name] = math.exp(rng.uniform(math.log(p.low), math.log(p.high)))
        else:
            values[p.name] = rng.uniform(p.low, p.high)
    length, elongation, flatness = 0.02, *rng.uniform(0.2, 1.0, 2)
    return Recipe(
        **values,  # type: ignore[arg-type]
        twist_axis=tuple(rng.normal(size=3)),
        twist_point=tuple(rng.uniform(-10, 10, 3) if rng.random() < 0.25 else rng.uniform(-1, 1, 3)),
        length=length,
        width=length * elongation,
        height=length * elongation * flatness,
        flatten_depth=float(rng.choice([0.0, 0.0, 0.1])),
        triangles=triangles,
        seed=int(rng.integers(2**63)),
    )
