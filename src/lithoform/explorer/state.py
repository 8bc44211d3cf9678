"""A recipe as a link and as what a page holds: the studio's state is its recipe, and nothing else."""

from __future__ import annotations

from typing import Any, Final
from urllib.parse import parse_qsl, quote

from lithoform.errors import RecipeError
from lithoform.parameters import PARAMETERS, Recipe
from lithoform.presets import PRESETS, SHAPE_CLASSES, benchmark_recipe, database_recipe
from lithoform.recipe_io import from_dict, parse_setting

__all__ = [
    "MAX_SMOOTHING", "MAX_TRIANGLES", "PRESET_NAMES", "from_page", "link_of", "preset_recipe", "recipe_of_link",
    "require_light", "to_page",
]  # fmt: skip

MAX_TRIANGLES: Final = 200_000
"""Largest mesh that the explorer makes: about a second of work."""

MAX_SMOOTHING: Final = 50_000_000
"""Most triangles times steps of smoothing, which is as much again."""

PRESET_NAMES: Final = (PRESETS[0], *SHAPE_CLASSES)
"""The benchmark of Table 1, and the four classes of the paper's database."""

_MAX_LINK: Final = 4000
_SYMBOLS: Final = {parameter.name: parameter.symbol for parameter in PARAMETERS}
_NOT_PARAMETERS: Final = ("tab",)  # what else a link may tell


def link_of(recipe: Recipe) -> str:
    """Query of a link that holds a recipe: what differs from the benchmark, such as "k=0.2&seed=7".

    Symbols stand for names, and numbers have all their digits, so that `recipe_of_link` gives the same recipe.
    """
    benchmark = Recipe().as_dict()
    changed = [(name, value) for name, value in recipe.as_dict().items() if value != benchmark[name]]
    return "&".join(f"{quote(_SYMBOLS.get(name, name))}={quote(_text(value), safe=',')}" for name, value in changed)


def recipe_of_link(query: str) -> Recipe:
    """Recipe of a link's query, with or without the question mark.

    Raises
    ------
    RecipeError
        If it is too long, names no parameter, or its recipe is not valid or too large for the explorer.
    """
    text = query.removeprefix("?")
    if len(text) > _MAX_LINK:
        raise RecipeError(f"expected a link of at most {_MAX_LINK} characters; got {len(text)}.")
    settings: dict[str, Any] = {}
    for name, value in parse_qsl(text, keep_blank_values=True):
        if name in _NOT_PARAMETERS:
            continue
        field, given = parse_setting(f"{name}={value}")
        if field in settings:
            raise RecipeError(f"{field} is given twice in the link; keep one of them.")
        settings[field] = given
    recipe = from_dict(settings)
    require_light(recipe)
    return recipe


def require_light(recipe: Recipe) -> None:
    """Refuse a mesh that takes too long to be drawn while one waits: too large, or smoothed too often for its size.

    Raises
    ------
    RecipeError
        If it does.
    """
    if recipe.triangles > MAX_TRIANGLES:
        raise RecipeError(f"the explorer draws at most {MAX_TRIANGLES:,} triangles; got {recipe.triangles:,}: make "
                          "larger stones with lithoform generate.")  # fmt: skip
    most = MAX_SMOOTHING // recipe.triangles
    if recipe.smoothing_iterations > most:
        raise RecipeError(f"the explorer smooths {recipe.triangles:,} triangles in at most {most:,} steps; got "
                          f"{recipe.smoothing_iterations:,}: take fewer of either, or lithoform generate.")  # fmt: skip


def to_page(recipe: Recipe) -> dict[str, Any]:
    """A recipe in plain values for a page; the seed as text, since a browser's numbers end at 2^53."""
    values = {name: list(v) if isinstance(v, tuple) else v for name, v in recipe.as_dict().items()}
    return {**values, "seed": str(recipe.seed)}


def from_page(values: Any) -> Recipe:
    """Recipe of what a page sends.

    Raises
    ------
    RecipeError
        If a name or a value is not valid, or the mesh is too large for the explorer.
    """
    if not isinstance(values, dict):
        raise RecipeError(f"a recipe must be a table of names and values; got {type(values).__name__}.")
    seed = values.get("seed", "0")
    if isinstance(seed, str):
        if not (seed.isascii() and seed.isdigit() and len(seed) <= 20):
            raise RecipeError(f"seed must be a whole number from 0 to 2^64 - 1; got {seed[:40]!r}.")
        values = {**values, "seed": int(seed)}
    recipe = from_dict({name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})
    require_light(recipe)
    return recipe


def preset_recipe(name: str, *, seed: int, triangles: int) -> Recipe:
    """The benchmark, or a stone of the paper's database in one class, with a seed and a number of triangles.

    Raises
    ------
    RecipeError
        If there is no such preset.
    """
    if name == PRESETS[0]:
        return benchmark_recipe(seed=seed, triangles=triangles)
    return database_recipe(name, seed=seed, triangles=triangles)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return ",".join(_text(component) for component in value)
    return value if isinstance(value, str) else repr(value)
