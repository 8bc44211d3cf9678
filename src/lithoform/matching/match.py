"""A population for a reference: split it, search on one part, judge on the other."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.errors import SampleError
from lithoform.matching.judging import Verdict, judge
from lithoform.matching.search import Search, preset_population, search
from lithoform.matching.stones import MATCHED, measured
from lithoform.population_recipe import PopulationRecipe
from lithoform.seeds import MAX_SEED, Role, derive

__all__ = ["JUDGED", "LEAST_REFERENCE", "Match", "match_population", "split"]

LEAST_REFERENCE: Final = 20
"""Fewest particles of a reference: with fewer there is nothing to split."""

LEAST_PART: Final = 8

JUDGED: Final = 400
"""Stones of the population made anew for judging it."""

_BEFORE: Final = 200
"""Stones of the preset, for the comparison before the match."""

_SPLIT, _JUDGE, _PRESET = 1 << 33, (1 << 33) + 1, (1 << 33) + 2  # sub-seeds of their own


@dataclass(frozen=True, eq=False)
class Match:
    """A population and how near it comes to its reference.

    Attributes
    ----------
    search : Search
        With the population.
    fitted, held_out : numpy.ndarray of int
        Rows of the reference that were fitted, and those that were judged.
    held : Verdict
        Stones made anew against the part that was not fitted.
    before : Verdict
        The database setting with the dimensions of the fitted part, against the same part.
    parts : Verdict
        The fitted part itself against the other: what no search on this part can be asked to beat.
    whole : Verdict
        Stones made anew against the whole reference, the fitted part included: kinder than the truth.
    """

    search: Search
    fitted: np.ndarray
    held_out: np.ndarray
    held: Verdict
    before: Verdict
    parts: Verdict
    whole: Verdict

    @property
    def population(self) -> PopulationRecipe:
        """The population that was found."""
        return self.search.population


def match_population(
    reference: np.ndarray,
    *,
    seed: int = 0,
    fit_share: float = 0.5,
    budget: int = 3000,
    triangles: int = 20_000,
    judged: int = JUDGED,
    permutations: int = 2000,
    threads: int | None = None,
    progress: bool = False,
    note: str = "",
) -> Match:
    """Find a population for a reference, and judge it on particles that the search did not see.

    Parameters
    ----------
    reference : array_like, shape (n, 7)
        Roundness, boxiness, solidity, true sphericity, elongation, flatness, length [m] of each particle.
    seed : int
        Of the split, of the search and of the judged stones; the same seed gives the same bytes, whatever the number
        of threads.
    fit_share : float
        Share of the particles that is fitted, between 0 and 1.
    budget : int
        Stones made for the search.
    triangles : int
        Of every stone.
    judged : int
        Stones made anew for the judgement.
    permutations : int
        Of each test.
    threads : int, optional
    progress : bool
    note : str
        Kept in the population recipe.

    Returns
    -------
    Match

    Raises
    ------
    SampleError
        If the reference has too few particles, is not finite or has a column that does not vary, the share leaves
        too few in a part, or there are too few permutations or stones to judge.
    RecipeError
        As `lithoform.matching.search.search`.
    """
    values = _checked(reference)
    # The tests come last; what they refuse is told first.
    if isinstance(permutations, bool) or permutations < 1:
        raise SampleError(f"expected a whole number of permutations, 1 or more, got {permutations}; 2000 is usual.")
    if isinstance(judged, bool) or judged < LEAST_PART:
        raise SampleError(f"expected at least {LEAST_PART} stones to judge, got {judged}; {JUDGED} is usual.")
    fitted, held_out = split(len(values), fit_share, seed)
    for name, part in (("fitted", values[fitted]), ("judged", values[held_out])):
        still = np.flatnonzero(part.min(axis=0) == part.max(axis=0))
        if len(still):
            raise SampleError(f"expected {MATCHED[still[0]]} to vary among the {name} particles, got {len(part)} times "
                              f"{part[0, still[0]]:g}; a match needs particles that differ.")  # fmt: skip
    found = search(
        values[fitted], seed=seed, budget=budget, triangles=triangles, threads=threads, progress=progress
    )  # fmt: skip
    found = dataclasses.replace(found, population=dataclasses.replace(found.population, note=note))

    def made(population: PopulationRecipe, count: int, counter: int, what: str) -> np.ndarray:
        own = derive(seed, Role.POPULATION, counter)
        recipes = [population.recipe(number, own) for number in range(1, count + 1)]
        rows = measured(recipes, total=count, what=what, threads=threads, progress=progress)
        return rows[np.isfinite(rows).all(axis=1)]

    stones = made(found.population, judged, _JUDGE, "stones to judge")
    preset = preset_population(values[fitted], triangles)
    earlier = made(preset, min(_BEFORE, judged), _PRESET, "stones of the preset")

    def verdict(a: np.ndarray, b: np.ndarray) -> Verdict:
        return judge(a, b, seed=seed, permutations=permutations)

    return Match(
        search=found,
        fitted=fitted,
        held_out=held_out,
        held=verdict(values[held_out], stones),
        before=verdict(values[held_out], earlier),
        parts=verdict(values[held_out], values[fitted]),
        whole=verdict(values, stones),
    )


def split(count: int, share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random rows to fit and rows to judge, each in rising order.

    Parameters
    ----------
    count : int
    share : float
        To fit; rounded to whole particles.
    seed : int

    Raises
    ------
    SampleError
        If a part would have fewer than 8 particles.
    """
    if not 0.0 < share < 1.0:
        raise SampleError(f"expected a share to fit between 0 and 1, got {share}; 0.5 is usual.")
    fitted = round(share * count)
    if min(fitted, count - fitted) < LEAST_PART:
        raise SampleError(f"expected at least {LEAST_PART} particles in each part, got {fitted} to fit and "
                          f"{count - fitted} to judge; choose a share nearer to 0.5.")  # fmt: skip
    if isinstance(seed, bool) or not 0 <= seed <= MAX_SEED:
        raise SampleError(f"expected a seed of 0 to {MAX_SEED}, got {seed}.")
    order = np.argsort([derive(seed, Role.POPULATION, _SPLIT, i) for i in range(count)], kind="stable")
    return np.sort(order[:fitted]), np.sort(order[fitted:])


def _checked(reference: np.ndarray) -> np.ndarray:
    values = np.array(reference, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != len(MATCHED):
        raise SampleError(f"expected a reference with the columns {', '.join(MATCHED)}; got shape {values.shape}.")
    if len(values) < LEAST_REFERENCE:
        raise SampleError(
            f"expected a reference of at least {LEAST_REFERENCE} particles, got {len(values)}; measure more of them."
        )
    if not np.isfinite(values).all():
        raise SampleError("expected finite values in the reference, got NaN or infinite; drop those particles first.")
    ratios = values[:, [MATCHED.index("elongation"), MATCHED.index("flatness")]]
    lengths = values[:, MATCHED.index("length")]
    if not ((ratios > 0.0) & (ratios <= 1.0)).all() or not ((lengths >= 1e-9) & (lengths <= 1e6)).all():
        raise SampleError(
            "expected EI and FI above 0 and up to 1, and lengths of 1e-9 to 1e6 m, in the reference; the longest is "
            f"{lengths.max():g} m and the shortest {lengths.min():g} m: a table may tell its unit in a column unit."
        )
    return values
