"""The parameters that are matched, as axes from 0 to 1."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from lithoform.axes import Axis, axis_values
from lithoform.parameters import Recipe

__all__ = ["VARIABLES", "base_recipe", "preset_coordinates", "variables_for"]

_REFERENCE_TRIANGLES: Final = 20_000

VARIABLES: Final = (
    Axis("perturbation", "log", 0.05, 1.0),
    Axis("main_scale", "log", 0.4, 3.0),
    Axis("smoothing_iterations", "square_root", 0.0, 200.0),
    Axis("twist_rate", "linear", 0.0, 60.0),
    Axis("warp_strength", "linear", 0.0, 1.0),
)
"""At 20,000 triangles.  Relief, its scale and its smoothing move all descriptors; the twist moves the roundness almost
alone; the warp makes the stones of one setting more alike."""


def variables_for(triangles: int) -> tuple[Axis, ...]:
    """`VARIABLES` with a range of smoothing that is the same length on the surface at another number of triangles.

    A step of smoothing spreads over one edge, n steps over sqrt(n) edges, and an edge goes as 1 / sqrt(triangles).
    """
    factor = triangles / _REFERENCE_TRIANGLES
    return tuple(
        replace(v, high=min(max(float(round(v.high * factor)), 4.0), 1000.0)) if v.name == "smoothing_iterations" else v
        for v in VARIABLES
    )


def base_recipe(triangles: int) -> Recipe:
    """The setting of the paper's database, which all that is not matched keeps."""
    return Recipe(main_scale=1.0, warp_scale=1.0, triangles=triangles)


def preset_coordinates(variables: tuple[Axis, ...]) -> np.ndarray:
    """Coordinates of the database setting, shape (d,)."""
    values = axis_values(base_recipe(_REFERENCE_TRIANGLES), tuple(v.name for v in variables))
    return np.array([v.coordinate(values[v.name]) for v in variables])
