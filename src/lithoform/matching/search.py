"""Search for a population: a design over the whole range, then stones of ever fewer and better populations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.axes import Axis
from lithoform.descriptors.table import FOUR
from lithoform.errors import RecipeError
from lithoform.feasibility import require_feasible
from lithoform.matching.dimensions import DimensionModel, fit_dimensions
from lithoform.matching.emulator import Stones, fit_emulator
from lithoform.matching.estimation import Density, Estimate, Places, estimate
from lithoform.matching.stones import MATCHED, measured
from lithoform.matching.variables import base_recipe, preset_coordinates, variables_for
from lithoform.parallel import in_order
from lithoform.parameters import Recipe
from lithoform.population_recipe import PopulationRecipe, Spread
from lithoform.seeds import Role, derive

__all__ = ["LEAST_BUDGET", "Search", "population_of", "preset_population", "search"]

LEAST_BUDGET: Final = 60
"""Fewest stones of a search."""

_SHARES: Final = (0.30, 0.14, 0.14, 0.14, 0.14, 0.14)
"""Of the stones, in the design and in each round after it."""

_KEPT: Final = (4, 2, 1, 1, 1)
"""Populations that are followed after the design and after each round but the last."""

_STARTS: Final = 14
_START_DEVIATION: Final = 0.2
_APART: Final = 0.15
"""Least distance of the means of two populations that are both followed, as coordinates."""

_PLACES: Final = (96, 256, 400)
"""Emulated stones in the first search from all starts, in those after it, and in the last."""

_STEPS: Final = (50, 150)
"""Of the minimiser, likewise."""

_WIDENING: Final = 1.3
"""Of the deviations of the population from which a round is drawn, so that the fit reaches around it."""

_NEAR: Final = 0.35
_FAR_WEIGHT: Final = 0.05
"""How fast the weight of stones falls with their distance from the population, as coordinates, and to what."""

_SUBSEED: Final = 1 << 32  # beyond the counters of normal scores in a population recipe

_Make = Callable[[list[Recipe], str], np.ndarray]


@dataclass(frozen=True, eq=False)
class Search:
    """What a search found.

    Attributes
    ----------
    population : PopulationRecipe
    density : Density
        The same in coordinates.
    variables : tuple of Axis
    energy : float
        Squared energy distance to the fitted part, as `lithoform.matching.estimation` has it.
    noise : float
        What a sample as large as the fitted part would have on average, were it of the population itself.
    stones : int
        Stones made.
    unsound : int
        Stones left out because no sound mesh was found.
    """

    population: PopulationRecipe
    density: Density
    variables: tuple[Axis, ...]
    energy: float
    noise: float
    stones: int
    unsound: int

    def at_limits(self) -> dict[str, str]:
        """Parameters whose median is at an end of its range: "low" or "high"."""
        ends = {}
        for variable, mean in zip(self.variables, self.density.mean, strict=True):
            if mean < 0.03 or mean > 0.97:
                ends[variable.name] = "low" if mean < 0.5 else "high"
        return ends


def search(
    reference: np.ndarray,
    *,
    seed: int = 0,
    budget: int = 3000,
    triangles: int = 20_000,
    threads: int | None = None,
    progress: bool = False,
) -> Search:
    """Find the population of least energy distance to a reference.

    Parameters
    ----------
    reference : numpy.ndarray, shape (n, 7)
        Columns as in `lithoform.matching.stones.MATCHED`; lengths in metres.
    seed : int
        The same seed gives the same population, whatever the number of threads.
    budget : int
        Stones made, at least `LEAST_BUDGET`.
    triangles : int
        Of the stones.
    threads : int, optional
    progress : bool

    Returns
    -------
    Search

    Raises
    ------
    RecipeError
        If the budget is too small, or stones of so few triangles cannot be made.
    """
    if isinstance(budget, bool) or budget < LEAST_BUDGET:
        raise RecipeError(f"expected a budget of at least {LEAST_BUDGET} stones; got {budget}: 3000 is usual.")
    variables = variables_for(triangles)
    model = fit_dimensions(reference[:, [MATCHED.index(name) for name in ("length", "elongation", "flatness")]])
    preset = preset_coordinates(variables)
    base = base_recipe(triangles)
    _require_range(variables, base)

    def make(recipes: list[Recipe], what: str) -> np.ndarray:
        return measured(recipes, total=len(recipes), what=what, threads=threads, progress=progress)

    drawing = _Drawing(variables, model, base, seed, make)
    counts = [max(8, round(share * budget)) for share in _SHARES]
    stones = drawing.stones([(counts[0], None)], 0)
    starts = _starts(len(variables), preset, seed)
    found: list[Estimate] = []
    for round_, kept in enumerate((*_KEPT, 1)):
        places = drawing.places(_PLACES[(round_ > 0) + (round_ == len(_KEPT))], round_)

        def work(start: Density, stones: Stones = stones, places: Places = places, round_: int = round_) -> Estimate:
            emulator = fit_emulator(stones, _nearness(stones, start) if round_ else None)
            return estimate(emulator, places, reference, preset, start, steps=_STEPS[min(round_, 1)])

        found = list(in_order(work, starts, threads=threads))
        found.sort(key=lambda one: one.objective)
        ends = _apart(found, kept)
        starts = [end.density for end in ends]
        if round_ == len(_KEPT):
            break
        share = counts[round_ + 1] // len(ends)
        stones = stones.joined(drawing.stones([(share, density) for density in starts], round_ + 1))
    best = found[0]
    return Search(
        population=population_of(best.density, variables, model, base),
        density=best.density,
        variables=variables,
        energy=best.energy,
        noise=best.noise,
        stones=drawing.made,
        unsound=drawing.made - len(stones),
    )


def _nearness(stones: Stones, density: Density) -> np.ndarray:
    away = (stones.coordinates - density.mean) / (_NEAR + np.sqrt((density.spread**2).sum(axis=1)))
    return np.maximum(np.exp(-0.5 * (away**2).sum(axis=1)), _FAR_WEIGHT)


def population_of(
    density: Density, variables: tuple[Axis, ...], model: DimensionModel, base: Recipe
) -> PopulationRecipe:
    """Population recipe of a density in coordinates and a model of dimensions, rounded to what it can tell."""
    deviations, correlation = density.joint(model.correlation)
    spreads = tuple(
        Spread(v.name, v.scale, _short(v.value(float(mean))), _short(float(deviation) * v.width), v.low, v.high)
        for v, mean, deviation in zip(variables, density.mean, deviations, strict=True)
    )
    # Drawn a little towards 0, so that rounding leaves the matrix definite.
    rounded = np.round(0.999 * correlation, 5)
    np.fill_diagonal(rounded, 1.0)
    length, elongation, flatness = ([_short(float(value)) for value in row] for row in model.quantiles)
    return PopulationRecipe(
        length=tuple(length),
        elongation=tuple(elongation),
        flatness=tuple(flatness),
        spreads=spreads,
        correlation=tuple(tuple(float(value) for value in row) for row in rounded),
        base=base,
    )


def preset_population(reference: np.ndarray, triangles: int) -> PopulationRecipe:
    """The database setting with the dimensions of a reference: what there was before the match."""
    model = fit_dimensions(reference[:, [MATCHED.index(name) for name in ("length", "elongation", "flatness")]])
    quantiles = [tuple(map(float, row)) for row in model.quantiles]
    correlation = tuple(tuple(float(value) for value in row) for row in model.correlation)
    return PopulationRecipe(
        length=quantiles[0],
        elongation=quantiles[1],
        flatness=quantiles[2],
        correlation=correlation,
        base=base_recipe(triangles),
    )


class _Drawing:
    """Draws stones round by round; what a stone is depends on the seed, the round and its number alone."""

    def __init__(
        self, variables: tuple[Axis, ...], model: DimensionModel, base: Recipe, seed: int, make: _Make
    ) -> None:
        self.variables, self.model, self.seed, self.make = variables, model, seed, make
        # A population whose coordinates have a deviation of 1 puts scores that are coordinates on their values.
        d = len(variables)
        even = Density(np.zeros(d), np.zeros((d, 3)), np.eye(d))
        self.carrier = population_of(even, variables, model, base)
        self.made = 0

    def places(self, count: int, round_: int) -> Places:
        from scipy.special import ndtri

        d = len(self.variables)
        normal = ndtri(_spread_points(d + 3, count, derive(self.seed, Role.POPULATION, _SUBSEED + 3, round_)))
        scores = self.model.scores(normal[:, d:])
        return Places(normal[:, :d], scores, self.model.values(scores)[:, [1, 2, 0]])

    def stones(self, origins: list[tuple[int, Density | None]], round_: int) -> Stones:
        from scipy.special import ndtri

        d = len(self.variables)
        parts = []
        for i, (count, density) in enumerate(origins):
            uniform = _spread_points(d + 3, count, derive(self.seed, Role.POPULATION, _SUBSEED, round_, i))
            scores = self.model.scores(ndtri(uniform[:, d:]))
            if density is None:
                coordinates = uniform[:, :d]
            else:
                coordinates = density.draw(_WIDENING * ndtri(uniform[:, :d]), scores)
            parts.append((coordinates, scores))
        coordinates, scores = (np.concatenate(part) for part in zip(*parts, strict=True))
        recipes = list(self._recipes(coordinates, scores, round_))
        what = "stones of the design" if round_ == 0 else f"stones of round {round_}"
        values = self.make(recipes, what)[:, : len(FOUR)]
        self.made += len(recipes)
        sound = np.isfinite(values).all(axis=1)
        return Stones(np.clip(coordinates[sound], 0.0, 1.0), scores[sound], values[sound])

    def _recipes(self, coordinates: np.ndarray, scores: np.ndarray, round_: int) -> Iterator[Recipe]:
        for number, (own, dimensions) in enumerate(zip(coordinates, scores, strict=True)):
            seed = derive(self.seed, Role.POPULATION, _SUBSEED + 1, round_, number)
            recipe = self.carrier.recipe_at([*map(float, dimensions), *([0.0] * len(own))], seed)
            yield recipe.replace(**{v.name: v.setting(c) for v, c in zip(self.variables, own, strict=True)})


def _spread_points(dimension: int, count: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points inside the unit cube, shape (count, dimension)."""
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, scramble=True, rng=np.random.default_rng(seed)).random_base2(
        max(1, math.ceil(math.log2(count)))
    )
    return np.clip(points[:count], 1e-6, 1.0 - 1e-6)


def _starts(d: int, preset: np.ndarray, seed: int) -> list[Density]:
    """Where the first search begins: around the preset, and spread over the range."""
    spread = 0.1 + 0.8 * _spread_points(d, _STARTS, derive(seed, Role.POPULATION, _SUBSEED + 2))
    return [Density(mean, np.zeros((d, 3)), _START_DEVIATION * np.eye(d)) for mean in [preset, *spread]]


def _apart(found: list[Estimate], count: int) -> list[Estimate]:
    """The best of them that are not one and the same, at most `count`."""
    kept: list[Estimate] = []
    for one in found:
        if len(kept) < count and all(np.abs(one.density.mean - k.density.mean).max() > _APART for k in kept):
            kept.append(one)
    return kept


def _require_range(variables: tuple[Axis, ...], base: Recipe) -> None:
    """Refuse, before any work, a mesh that is too coarse for the ends of the ranges."""
    ends = {v.name: v.setting(1.0) for v in variables}
    try:
        require_feasible(base.replace(**ends))
    except RecipeError as error:
        raise RecipeError(f"stones of {base.triangles} triangles are too coarse for a match: {error}") from error


def _short(value: float) -> float:
    """Seven digits: what follows is beneath the noise of any sample."""
    return float(f"{value:.7g}")
