"""The design of a library: settings spread over the design space, a stone each, as a plan for a database."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from lithoform.axes import Axis, at_axes
from lithoform.errors import RecipeError
from lithoform.feasibility import require_feasible
from lithoform.lazy import cached_property
from lithoform.parameters import Recipe
from lithoform.presets import DATABASE_LENGTH
from lithoform.seeds import MAX_SEED, Role, derive

__all__ = ["DESIGN_AXES", "LIBRARY_COUNT", "LIBRARY_SOURCE", "LibraryPlan", "design_axes", "design_base", "reaching"]

LIBRARY_SOURCE: Final = "library"
LIBRARY_COUNT: Final = 12_288
_REFERENCE_TRIANGLES: Final = 20_000

DESIGN_AXES: Final = (
    Axis("perturbation", "log", 0.05, 1.0),
    Axis("main_scale", "log", 0.4, 3.0),
    Axis("warp_strength", "linear", 0.0, 1.0),
    Axis("lacunarity", "linear", 1.0, 2.2),
    Axis("gain", "linear", 0.1, 0.7),
    Axis("fbm_weight", "linear", 0.2, 1.6),
    Axis("ridge_weight", "linear", 0.0, 1.0),
    Axis("chip_weight", "linear", 0.0, 1.0),
    Axis("twist_rate", "linear", 0.0, 60.0),
    Axis("smoothing_iterations", "square_root", 0, 200),
    Axis("elongation", "linear", 0.3, 1.0),
    Axis("flatness", "linear", 0.3, 1.0),
)
"""What is varied, at 20,000 triangles.  Relief k, its scale s and its smoothing move all descriptors, EI and FI the
true sphericity and the roundness; the warp makes the stones of one setting more alike; the others are texture."""

_CROWDING: Final = {"perturbation": 0.65, "smoothing_iterations": 1.4}
"""Powers of the coordinate u of the even design.  Half of an even one would be smooth ellipsoids (small k, or much
smoothing), which need few stones; small k, which changes little,
and relief that no mesh follows are left out."""


def design_axes(triangles: int = _REFERENCE_TRIANGLES) -> tuple[Axis, ...]:
    """`DESIGN_AXES` with a range of smoothing that reaches equally far over the surface at a number of triangles."""
    return tuple(reaching(axis, _REFERENCE_TRIANGLES, triangles) for axis in DESIGN_AXES)


def reaching(axis: Axis, triangles: int, others: int) -> Axis:
    """An axis for meshes of another number of triangles: n steps of smoothing reach sqrt(n) edges far."""
    if axis.name != "smoothing_iterations":
        return axis
    return replace(axis, high=min(max(float(round(axis.high * others / triangles)), 4.0), 1000.0))


def design_base(triangles: int = _REFERENCE_TRIANGLES) -> Recipe:
    """What the axes leave: the setting of the paper's database, L = 20 mm."""
    length = DATABASE_LENGTH
    return Recipe(
        main_scale=1.0,
        warp_scale=1.0,
        length=length,
        width=0.75 * length,
        height=0.5 * length,
        triangles=triangles,
    )


@dataclass(frozen=True)
class LibraryPlan:
    """A scrambled Sobol sequence over the axes, a stone of its own seed at each point.

    The first points of a longer plan are those of a shorter one.

    Attributes
    ----------
    count : int
    seed : int
        Of the scrambling and of the stones.
    triangles : int
        Of every stone.
    """

    count: int = LIBRARY_COUNT
    seed: int = 0
    triangles: int = _REFERENCE_TRIANGLES

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """Of the design."""
        return design_axes(self.triangles)

    @cached_property
    def base(self) -> Recipe:
        """What the axes leave."""
        return design_base(self.triangles)

    @cached_property
    def coordinates(self) -> np.ndarray:
        """Coordinates of the points, shape (count, axes), on the numbers of 32 bits that a library keeps."""
        from scipy.stats import qmc

        sobol = qmc.Sobol(len(self.axes), scramble=True, rng=np.random.default_rng(self.seed))
        points = sobol.random_base2(max(1, math.ceil(math.log2(self.count))))[: self.count]
        for column, axis in enumerate(self.axes):
            points[:, column] **= _CROWDING.get(axis.name, 1.0)
        return points.astype(np.float32).astype(np.float64)

    def class_of(self, number: int) -> None:
        """None: the dimensions are those of the point."""

    def particle_seed(self, number: int) -> int:
        """Seed of the stone at point `number` (from 1)."""
        return derive(self.seed, Role.PARTICLE, number)

    def recipe(self, number: int) -> Recipe:
        """Recipe of the stone at point `number` (from 1)."""
        row = self.coordinates[number - 1]
        settings = {axis.name: axis.setting(float(c)) for axis, c in zip(self.axes, row, strict=True)}
        return at_axes(self.base, settings).replace(seed=self.particle_seed(number))

    def as_dict(self) -> dict[str, Any]:
        """Plain values that say what was asked for."""
        axes = [[axis.name, axis.scale, axis.low, axis.high] for axis in self.axes]
        return {"count": self.count, "seed": self.seed, "triangles": self.triangles, "design": "sobol", "axes": axes}

    def validate(self) -> None:
        """Refuse a plan that cannot be carried out, before any work.

        Raises
        ------
        RecipeError
            If the count or the seed is out of range, or the mesh is too coarse for the ends of the axes.
        """
        least = 10 * len(self.axes)
        if not least <= self.count <= 1_000_000:
            raise RecipeError(f"expected a library of {least} to 1,000,000 stones; got {self.count}.")
        if not 0 <= self.seed <= MAX_SEED:
            raise RecipeError(f"the seed must be 0 to {MAX_SEED}; got {self.seed}.")
        ends = {axis.name: axis.setting(1.0) for axis in self.axes}
        try:
            require_feasible(at_axes(self.base, ends))
        except RecipeError as error:
            raise RecipeError(f"stones of {self.triangles} triangles are too coarse for a library: {error}") from error
