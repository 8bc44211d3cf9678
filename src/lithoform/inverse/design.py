"""A design from beginning to end: candidates, a search with the real generator, and a judgement on fresh seeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from lithoform.descriptors.measuring import measure
from lithoform.descriptors.table import FOUR
from lithoform.errors import MeshError, RecipeError
from lithoform.generation import generate
from lithoform.inverse.additive import AdditiveSurrogate, paper_candidates, shipped_curves
from lithoform.inverse.candidates import JUDGED_SEEDS, find_candidates, region_of
from lithoform.inverse.library import DesignLibrary
from lithoform.inverse.reachability import Limit, limits_of, stopped_by
from lithoform.inverse.search import Evaluate, search
from lithoform.inverse.surrogate import Surrogate
from lithoform.inverse.targets import Target, mismatch, within
from lithoform.parallel import in_order
from lithoform.parameters import Recipe
from lithoform.progress import track
from lithoform.seeds import Role, derive

__all__ = ["Design", "Setting", "as_dict", "by_search", "by_the_papers_route", "evaluator", "fresh_seeds"]

_CANDIDATES: Final = 10
_SEARCHED: Final = 5
_FRESH: Final = 1 << 34
"""Counters of fresh seeds begin here, those of the search elsewhere, so that no seed is in both."""

_WAY_OUT: Final = {
    True: "other descriptors beside it, a wider tolerance or a larger library may help.",
    False: "a search with the generator may reach it, which --no-refine has left out.",
}
_ADDITIVE: Final = "the additive model knows no interactions; the route search does."

_DOUBT: Final = 2.0
"""Standard errors by which a mean may miss its tolerance by chance."""

Nearness = Literal["reached", "by chance", "missed"]


@dataclass(frozen=True, eq=False)
class Setting:
    """A ranked candidate.

    Attributes
    ----------
    recipe : Recipe
    mean : numpy.ndarray, shape (4,)
        Predicted over the seeds.
    error, scatter : numpy.ndarray, shape (4,)
        Standard error of that prediction, and standard deviation from seed to seed; NaN where the route knows none.
    mismatch : float
        E of the predicted mean.
    within : bool
        Whether the predicted mean is within all tolerances.
    """

    recipe: Recipe
    mean: np.ndarray
    error: np.ndarray
    scatter: np.ndarray
    mismatch: float
    within: bool


@dataclass(frozen=True, eq=False)
class Design:
    """What was asked for, what was expected and what came.

    Attributes
    ----------
    target : Target
    route : {"search", "paper"}
    recipe : Recipe
        The setting, with seed 0.
    predicted : Setting
        What was expected of it (after the search: of it by the surrogate moved to what was measured).
    candidates : tuple of Setting
        The best of the surrogate, ranked.
    achieved : numpy.ndarray, shape (n, 4)
        Of stones of fresh seeds; NaN where no sound mesh was found.
    seeds : tuple of int
        The fresh seeds.
    stones : int
        Stones that the search made.
    refined : bool
        Whether the real generator took part in the search.
    reached : bool
        Whether the mean of the fresh stones is within all tolerances.
    limits : tuple of Limit
        Where the target is not reached: what stops it, the first first.
    verdict : str
        The same in a sentence.
    """

    target: Target
    route: Literal["search", "paper"]
    recipe: Recipe
    predicted: Setting
    candidates: tuple[Setting, ...]
    achieved: np.ndarray
    seeds: tuple[int, ...]
    stones: int
    refined: bool
    reached: bool
    limits: tuple[Limit, ...]
    verdict: str

    @property
    def measured(self) -> np.ndarray:
        """Which of the fresh stones have a sound mesh that was measured, shape (n,), bool."""
        there: np.ndarray = np.all(np.isfinite(self.achieved), axis=1)
        return there

    @property
    def mean(self) -> np.ndarray:
        """Mean descriptors of the fresh stones, shape (4,)."""
        return np.nanmean(self.achieved, axis=0)

    @property
    def scatter(self) -> np.ndarray:
        """Their standard deviation from seed to seed, shape (4,)."""
        return np.nanstd(self.achieved, axis=0, ddof=1)


def evaluator(*, threads: int | None = None, progress: bool = False, device: str = "cpu") -> Evaluate:
    """Generate and measure the four descriptors, over threads; the values do not depend on their number."""

    def work(recipe: Recipe) -> list[float]:
        try:
            found = measure(generate(recipe, device=device), FOUR)
        except (MeshError, RecipeError):  # unsound, or beyond what its mesh can follow
            return [np.nan] * len(FOUR)
        return [float(found[name]) for name in FOUR]

    def evaluate(recipes: list[Recipe]) -> np.ndarray:
        stream = in_order(work, recipes, threads=threads)
        rows = list(track(stream, total=len(recipes), what="stones of the search", enabled=progress))
        return np.array(rows, dtype=np.float64).reshape(-1, len(FOUR))

    return evaluate


def fresh_seeds(seed: int, count: int) -> tuple[int, ...]:
    """Seeds that no search uses."""
    return tuple(derive(seed, Role.POPULATION, _FRESH, i) for i in range(count))


def by_search(
    target: Target,
    library: DesignLibrary,
    *,
    surrogate: Surrogate | None = None,
    shape_class: str | None = None,
    seed: int = 0,
    refine: bool = True,
    fresh: int = JUDGED_SEEDS,
    evaluate: Evaluate | None = None,
    told: Callable[[str], None] = lambda _: None,
) -> Design:
    """Design by the surrogate with interactions, and unless `refine` is off by a search with the real generator.

    Parameters
    ----------
    target : Target
    library : DesignLibrary
    surrogate : Surrogate, optional
        Fitted to the library.
    shape_class : {"cube", "plate", "column", "blade"}, optional
        Bounds EI and FI of the recipe.
    seed : int
        Of the common seeds of the search and of the fresh ones.
    refine : bool
    fresh : int
        Stones of fresh seeds, at least 2, on which the setting is judged.
    evaluate : callable, optional
        Descriptors of recipes: the generator unless given.
    told : callable
        Called with a line for each stage.

    Returns
    -------
    Design
        The same whatever the threads.

    Raises
    ------
    RecipeError
        If the class is unknown, or the library has no part in it.
    """
    evaluate = evaluator() if evaluate is None else evaluate
    asked, target = target, target.normalised()
    region = region_of(library, shape_class)
    told(f"surrogate of {len(library)} stones")
    surrogate = Surrogate.fit(library) if surrogate is None else surrogate
    told("candidates")
    found = find_candidates(library, surrogate, target, region=region, count=_CANDIDATES)
    candidates = tuple(_setting(c.recipe, c.mean, c.error, c.scatter, target) for c in found)
    chosen, stones = candidates[0], 0
    if refine:
        told("search with the real generator")
        end = search(library, surrogate, target, found[:_SEARCHED], region=region, evaluate=evaluate, seed=seed)
        if end is not None:
            stones = end.stones
            error = end.scatter / np.sqrt(end.seeds)
            chosen = _setting(end.recipe, end.mean, error, end.scatter, target)
    told("fresh seeds")
    seeds, achieved, nearness = _judged(chosen.recipe, target, evaluate, seed, fresh)
    limits: tuple[Limit, ...] = ()
    if nearness == "missed" and not candidates[0].within:
        told("what stops it")
        limits = tuple(
            limits_of(
                library,
                surrogate,
                target,
                np.nanmean(achieved, axis=0),
                region=region,
                evaluate=evaluate if refine else None,
                seeds=seeds,
            )
        )
    verdict = _verdict(target, np.nanmean(achieved, axis=0), nearness, limits, _WAY_OUT[refine])
    ranked = tuple(replace(one, mismatch=float(mismatch(one.mean[None], asked)[0])) for one in (chosen, *candidates))
    return Design(asked, "search", chosen.recipe, ranked[0], ranked[1:], achieved, seeds, stones, refine,
                  nearness == "reached", limits, verdict)  # fmt: skip


def by_the_papers_route(
    target: Target,
    *,
    surrogate: AdditiveSurrogate | None = None,
    base: Recipe | None = None,
    seed: int = 0,
    fresh: int = JUDGED_SEEDS,
    evaluate: Evaluate | None = None,
) -> Design:
    """Design as Appendix B of the paper has it: eq. 29, a Latin hypercube, eq. 30, and stones of new seeds.

    Parameters
    ----------
    target : Target
    surrogate : AdditiveSurrogate, optional
        That of the shipped curves unless given.
    base : Recipe, optional
        The benchmark of Table 1 unless given: the dimensions are its own.
    seed, fresh, evaluate
        As `by_search`; the seed is also that of the hypercube.

    Returns
    -------
    Design
    """
    evaluate = evaluator() if evaluate is None else evaluate
    surrogate = AdditiveSurrogate(shipped_curves()) if surrogate is None else surrogate
    unknown = np.full(len(FOUR), np.nan)
    found = paper_candidates(surrogate, target, base=base, count=_CANDIDATES, seed=seed)
    candidates = tuple(Setting(c.recipe, c.mean, unknown, unknown, c.mismatch, c.within) for c in found)
    if not candidates:
        raise RecipeError("no point of the hypercube has a recipe that its mesh can follow; use more triangles.")
    chosen = candidates[0]
    seeds, achieved, nearness = _judged(chosen.recipe, target, evaluate, seed, fresh)
    verdict = _verdict(target, np.nanmean(achieved, axis=0), nearness, (), _ADDITIVE)
    return Design(target, "paper", chosen.recipe, chosen, candidates, achieved, seeds, 0, False, nearness == "reached",
                  (), verdict)  # fmt: skip


def _setting(recipe: Recipe, mean: np.ndarray, error: np.ndarray, scatter: np.ndarray, target: Target) -> Setting:
    return Setting(
        recipe, mean, error, scatter, float(mismatch(mean[None], target)[0]), bool(within(mean[None], target)[0])
    )


def _judged(
    recipe: Recipe, target: Target, evaluate: Evaluate, seed: int, fresh: int
) -> tuple[tuple[int, ...], np.ndarray, Nearness]:
    if fresh < 2:
        raise RecipeError(f"expected at least 2 fresh stones, so that their scatter is known; got {fresh}.")
    seeds = fresh_seeds(seed, fresh)
    achieved = evaluate([recipe.replace(seed=own) for own in seeds])
    sound = achieved[np.isfinite(achieved).all(axis=1)]
    if len(sound) < 2:
        raise RecipeError("hardly a stone of the best setting has a sound mesh; use more triangles.")
    chance = _DOUBT * sound.std(axis=0, ddof=1) / np.sqrt(len(sound))
    wide = replace(target, tolerance=tuple(t + c for t, c in zip(target.tolerance, chance, strict=True)))
    mean = sound.mean(axis=0)[None]
    if within(mean, target)[0]:
        return seeds, achieved, "reached"
    return seeds, achieved, "by chance" if within(mean, wide)[0] else "missed"


def _verdict(target: Target, mean: np.ndarray, nearness: Nearness, limits: tuple[Limit, ...], way_out: str) -> str:
    if nearness == "reached":
        return "The target is reached: the mean of the fresh stones is within its tolerances."
    named = ", ".join(
        f"{name}={value:.3f}" for name, value, asked in zip(FOUR, mean, target.asked, strict=True) if asked
    )
    if nearness == "by chance":
        return (
            f"The fresh stones have {named}, which misses a tolerance by no more than their scatter explains: more of "
            "them (--fresh) tell."
        )
    if not limits:
        return f"The target is missed, the fresh stones have {named}: {way_out}"
    return f"The target cannot be reached here, the nearest is {named}; {stopped_by(list(limits))}"


def as_dict(design: Design) -> dict[str, Any]:
    """Plain values for JSON."""

    def four(values: np.ndarray) -> dict[str, float | None]:
        return {name: float(v) if np.isfinite(v) else None for name, v in zip(FOUR, values, strict=True)}

    def setting(one: Setting) -> dict[str, Any]:
        told = {"mean": four(one.mean), "error": four(one.error), "scatter": four(one.scatter)}
        return {**told, "mismatch": one.mismatch, "within": one.within}

    return {
        "route": design.route,
        "target": design.target.as_dict(),
        "reached": design.reached,
        "verdict": design.verdict,
        "predicted": setting(design.predicted),
        "achieved": {"mean": four(design.mean), "scatter": four(design.scatter), "stones": int(design.measured.sum())},
        "limits": [vars(limit) for limit in design.limits],
        "stones_of_the_search": design.stones,
        "fresh_seeds": list(design.seeds),
        "recipe": design.recipe.as_dict(),
        "candidates": [setting(one) for one in design.candidates],
    }
