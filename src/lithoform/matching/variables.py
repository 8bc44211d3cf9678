"""The parameters that are matched, each on the scale on which it acts evenly, as coordinates from 0 to 1."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.parameters import Recipe
from lithoform.population_recipe import Scale

__all__ = ["VARIABLES", "Variable", "base_recipe", "preset_coordinates", "variables_for"]

_REFERENCE_TRIANGLES: Final = 20_000


@dataclass(frozen=True)
class Variable:
    """A parameter that is matched.

    Attributes
    ----------
    name : str
        Field of `Recipe`.
    scale : {"linear", "log", "square_root"}
        The coordinate is linear in the value, its logarithm or its square root.
    low, high : float
        Values at the coordinates 0 and 1, in the parameter's unit.
    """

    name: str
    scale: Scale
    low: float
    high: float

    def _scaled(self, value: float) -> float:
        return {"linear": float, "log": math.log, "square_root": math.sqrt}[self.scale](value)

    @property
    def width(self) -> float:
        """Range on the scale."""
        return self._scaled(self.high) - self._scaled(self.low)

    def value(self, coordinate: float) -> float:
        """Value at a coordinate, which is first clipped to 0 to 1."""
        if coordinate <= 0.0:
            return self.low
        if coordinate >= 1.0:
            return self.high
        scaled = self._scaled(self.low) + self.width * float(coordinate)
        drawn = {"linear": float, "log": math.exp, "square_root": lambda x: x * x}[self.scale](scaled)
        return min(max(drawn, self.low), self.high)

    def coordinate(self, value: float) -> float:
        """Coordinate of a value, clipped to 0 to 1."""
        return (self._scaled(min(max(value, self.low), self.high)) - self._scaled(self.low)) / self.width


VARIABLES: Final = (
    Variable("perturbation", "log", 0.05, 1.0),
    Variable("main_scale", "log", 0.4, 3.0),
    Variable("smoothing_iterations", "square_root", 0.0, 200.0),
    Variable("twist_rate", "linear", 0.0, 60.0),
    Variable("warp_strength", "linear", 0.0, 1.0),
)
"""At 20,000 triangles.  Relief, its scale and its smoothing move all descriptors; the twist moves the roundness almost
alone; the warp makes the stones of one setting more alike."""


def variables_for(triangles: int) -> tuple[Variable, ...]:
    """`VARIABLES` with a range of smoothing that is the same length on the surface at another number of triangles.

    A step of smoothing spreads over one edge, n steps over sqrt(n) edges, and an edge goes as 1 / sqrt(triangles).
    """
    factor = triangles / _REFERENCE_TRIANGLES
    return tuple(
        Variable(v.name, v.scale, v.low, min(max(float(round(v.high * factor)), 4.0), 1000.0))
        if v.name == "smoothing_iterations"
        else v
        for v in VARIABLES
    )


def base_recipe(triangles: int) -> Recipe:
    """The setting of the paper's database, which all that is not matched keeps."""
    return Recipe(main_scale=1.0, warp_scale=1.0, triangles=triangles)


def preset_coordinates(variables: tuple[Variable, ...]) -> np.ndarray:
    """Coordinates of the database setting, shape (d,)."""
    base = base_recipe(_REFERENCE_TRIANGLES)
    return np.array([v.coordinate(float(getattr(base, v.name))) for v in variables])
