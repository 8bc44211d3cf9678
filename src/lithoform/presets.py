"""Ready-made recipes: the benchmark of Table 1, and the setting of the paper's database (section 5)."""

from __future__ import annotations

from typing import Any, Final

from lithoform.errors import RecipeError
from lithoform.parameters import Recipe, suggest
from lithoform.seeds import Role, derive, uniform

__all__ = [
    "PRESETS",
    "SHAPE_CLASSES",
    "ZINGG_LIMIT",
    "benchmark_recipe",
    "database_recipe",
    "draw_size",
    "particle_seed",
    "shape_class_of",
]

PRESETS: Final = ("benchmark", "database")

SHAPE_CLASSES: Final = ("cube", "plate", "column", "blade")
"""Zingg's classes at 2/3, in the paper's order; "mixed" takes them in turn."""

ZINGG_LIMIT: Final = 2.0 / 3.0
"""Elongation and flatness below it are marked (Zingg 1935)."""
_LOW: Final = 1.0 / 3.0

DATABASE_LENGTH: Final = 0.020
"""L of a database stone unless another is asked for [m]: a coarse aggregate; the paper gives no size."""


def particle_seed(run_seed: int, number: int) -> int:
    """Seed of particle `number` (from 1) of a run; neighbouring numbers and runs share nothing."""
    return derive(run_seed, Role.PARTICLE, number)


def benchmark_recipe(**changes: Any) -> Recipe:
    """Table 1, with some fields changed (names or symbols).

    Raises
    ------
    RecipeError
        If a change is not valid.
    """
    return Recipe().replace(**changes)


def database_recipe(shape_class: str, *, seed: int = 0, length: float = DATABASE_LENGTH, **changes: Any) -> Recipe:
    """Setting of the paper's generated database: s = s_w = 1 and dimensions drawn inside a Zingg class.

    Parameters
    ----------
    shape_class : {"cube", "plate", "column", "blade"}
    seed : int
        The particle's seed; the dimensions follow from it as well.
    length : float
        L [m].
    **changes
        Other fields of the recipe (names or symbols).

    Returns
    -------
    Recipe

    Raises
    ------
    RecipeError
        If the class is unknown or a value is not valid.
    """
    drawn = draw_size(shape_class, seed, length=length)
    setting = Recipe().replace(main_scale=1.0, warp_scale=1.0, size=drawn, seed=seed)
    return setting.replace(**changes)


def shape_class_of(size: tuple[float, float, float]) -> str:
    """Zingg class of dimensions L >= W >= H: cube, plate, column or blade, divided at 2/3."""
    length, width, height = size
    return {(False, False): "cube", (False, True): "plate", (True, False): "column", (True, True): "blade"}[
        width < ZINGG_LIMIT * length, height < ZINGG_LIMIT * width
    ]


def draw_size(shape_class: str, seed: int, *, length: float = DATABASE_LENGTH) -> tuple[float, float, float]:
    """Dimensions (L, W, H) drawn inside a Zingg class.

    The elongation index EI = W / L and the flatness index FI = H / W are uniform between 2/3 and 1 or, on the
    flat or elongated side, between 1/3 and 2/3.  The paper does not say how it drew them; this is the stated
    default.

    Parameters
    ----------
    shape_class : {"cube", "plate", "column", "blade"}
        cube: EI and FI above 2/3; plate: FI below; column: EI below; blade: both below.
    seed : int
        The particle's seed.
    length : float
        L [m].

    Returns
    -------
    tuple of float
        L >= W >= H [m].

    Raises
    ------
    RecipeError
        If the class is unknown.
    """
    if shape_class not in SHAPE_CLASSES:
        raise RecipeError(f"expected a class of {', '.join(SHAPE_CLASSES)}; got {shape_class!r}."
                          f"{suggest(shape_class, SHAPE_CLASSES)}")  # fmt: skip
    low_elongation = _LOW if shape_class in ("column", "blade") else ZINGG_LIMIT
    low_flatness = _LOW if shape_class in ("plate", "blade") else ZINGG_LIMIT
    elongation = low_elongation + _LOW * uniform(seed, Role.DIMENSIONS, 0)
    flatness = low_flatness + _LOW * uniform(seed, Role.DIMENSIONS, 1)
    return length, length * elongation, length * elongation * flatness
