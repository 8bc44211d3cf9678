"""Axes of a design space: parameters and dimension ratios, each on the scale on which it acts evenly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from lithoform.errors import RecipeError
from lithoform.parameters import PARAMETERS, Recipe, suggest

__all__ = ["EXTRA_AXES", "TABLE_7", "Axis", "Scale", "at_axes", "axis_values"]

Scale = Literal["linear", "log", "square_root"]

_PARAMETERS: Final = {parameter.name: parameter for parameter in PARAMETERS}
_RATIOS: Final = {"elongation": "EI", "flatness": "FI"}
_LEAST_RATIO: Final = 0.04


@dataclass(frozen=True)
class Axis:
    """A parameter, or a ratio of the dimensions, over a range.

    Attributes
    ----------
    name : str
        Field of `Recipe` (the three components of phase_offset move together), or elongation EI = W / L or flatness
        FI = H / W.
    scale : {"linear", "log", "square_root"}
        The coordinate is linear in the value, its logarithm or its square root.
    low, high : float
        Values at the coordinates 0 and 1, in the parameter's unit.

    Raises
    ------
    RecipeError
        If the name or the scale is unknown, or the range is empty or beyond what the scale or the parameter admits.
    """

    name: str
    scale: Scale
    low: float
    high: float

    def __post_init__(self) -> None:
        if self.scale not in get_args(Scale):
            raise RecipeError(f"{self.name}: the scale must be one of {', '.join(get_args(Scale))}; got {self.scale!r}."
                              f"{suggest(self.scale, get_args(Scale))}")  # fmt: skip
        parameter = _PARAMETERS.get(self.name)
        if parameter is None and self.name not in _RATIOS:
            names = [*_PARAMETERS, *_RATIOS]
            raise RecipeError(f"expected a parameter or elongation or flatness as an axis; got {self.name!r}."
                              f"{suggest(self.name, names)}")  # fmt: skip
        least, most = (parameter.low, parameter.high) if parameter else (_LEAST_RATIO, 1.0)
        if self.scale == "log" and self.low <= 0.0:
            raise RecipeError(f"{self.name}: a log scale needs a low end above 0; got {self.low:g}.")
        if not least <= self.low < self.high <= most:
            raise RecipeError(f"{self.name}: expected {least:g} <= low < high <= {most:g}; got {self.low:g} and "
                              f"{self.high:g}.")  # fmt: skip

    @property
    def symbol(self) -> str:
        """The paper's symbol."""
        return _RATIOS.get(self.name) or _PARAMETERS[self.name].symbol

    @property
    def is_whole(self) -> bool:
        """Whether its values are whole numbers."""
        return self.name in _PARAMETERS and _PARAMETERS[self.name].kind == "integer"

    @property
    def width(self) -> float:
        """Range on the scale."""
        return self._scaled(self.high) - self._scaled(self.low)

    def value(self, coordinate: float) -> float:
        """Value at a coordinate, which is first clipped to 0 to 1; not rounded."""
        if coordinate <= 0.0:
            return self.low
        if coordinate >= 1.0:
            return self.high
        scaled = self._scaled(self.low) + self.width * float(coordinate)
        drawn = {"linear": float, "log": math.exp, "square_root": lambda x: x * x}[self.scale](scaled)
        return min(max(drawn, self.low), self.high)

    def setting(self, coordinate: float) -> float | int:
        """The same, whole where the parameter is."""
        value = self.value(coordinate)
        return math.floor(value + 0.5) if self.is_whole else value

    def coordinate(self, value: float) -> float:
        """Coordinate of a value, clipped to 0 to 1."""
        return (self._scaled(min(max(value, self.low), self.high)) - self._scaled(self.low)) / self.width

    def _scaled(self, value: float) -> float:
        return {"linear": float, "log": math.log, "square_root": math.sqrt}[self.scale](value)


TABLE_7: Final = (
    Axis("base_radius", "linear", 0.05, 5.0),
    Axis("perturbation", "linear", 0.0, 1.0),
    Axis("main_scale", "linear", 0.0, 3.0),
    Axis("warp_scale", "linear", 0.0, 3.0),
    Axis("warp_strength", "linear", 0.0, 1.0),
    Axis("phase_offset", "linear", -6.0, 6.0),
    Axis("octaves", "linear", 0, 10),
    Axis("lacunarity", "linear", 0.0, 3.0),
    Axis("gain", "linear", 0.0, 1.0),
    Axis("fbm_weight", "linear", 0.0, 2.0),
    Axis("ridge_weight", "linear", 0.0, 1.0),
    Axis("chip_weight", "linear", 0.0, 2.0),
    Axis("chip_sharpness", "log", 0.1, 128.0),
    Axis("layer_amplitude", "linear", 0.0, 8.0),
    Axis("layer_frequency", "linear", 0.0, 5.0),
)
"""The 15 parameters of the paper's Table 7 over its ranges.  A sphere of radius 0 has no surface, so that r begins at
0.05; the sharpness, a "wide positive sweep", is logarithmic."""

EXTRA_AXES: Final = (
    Axis("twist_rate", "linear", 0.0, 60.0),
    Axis("smoothing_iterations", "square_root", 0, 200),
    Axis("elongation", "linear", 1.0 / 3.0, 1.0),
    Axis("flatness", "linear", 1.0 / 3.0, 1.0),
)
"""What acts on the shape beside Table 7: the twist, the smoothing (at 20,000 triangles) and the dimensions."""


def at_axes(base: Recipe, settings: Mapping[str, float | int]) -> Recipe:
    """A recipe with some axes set.

    Parameters
    ----------
    base : Recipe
        What is not set stays; L is always its own.
    settings : mapping
        Value by the name of the axis.

    Raises
    ------
    RecipeError
        If a value is not valid.
    """
    changes: dict[str, Any] = {name: value for name, value in settings.items() if name not in _RATIOS}
    if "phase_offset" in changes:
        changes["phase_offset"] = (float(changes["phase_offset"]),) * 3
    if settings.keys() & _RATIOS.keys():
        elongation = float(settings.get("elongation", base.width / base.length))
        flatness = float(settings.get("flatness", base.height / base.width))
        width = base.length * elongation
        changes |= {"width": width, "height": width * flatness}
    return base.replace(**changes)


def axis_values(recipe: Recipe, names: tuple[str, ...]) -> dict[str, float]:
    """Values of a recipe on some axes; of phase_offset the mean of its components."""
    ratios = {"elongation": recipe.width / recipe.length, "flatness": recipe.height / recipe.width}
    values = {}
    for name in names:
        value = ratios[name] if name in ratios else getattr(recipe, name)
        values[name] = sum(value) / 3.0 if isinstance(value, tuple) else float(value)
    return values
