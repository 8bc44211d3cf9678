"""A short search with the real generator: the same seeds at every setting, the surrogate's slopes for the steps.

At a setting x_k the mean over n common seeds is measured.  Near it stones are expected to measure

    y(x) = m(x) + a (y_k - m(x_k)) + D (x - x_k),      a = e^2 / (e^2 + s^2 / n),

the surrogate moved towards what was measured.  e is the error of the surrogate and s the scatter: a mean of few stones
is not trusted beyond what it knows, or the search would follow the luck of its seeds; in the last round a is 1.  D
starts at 0 and takes up what each step shows of the slopes (Broyden 1965).
The next setting is that of least J within a distance that shrinks when a step does not help.  With the same seeds the
scatter from seed to seed cancels from the comparison of two settings, so that few stones lead a long way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from lithoform.inverse.candidates import JUDGED_SEEDS, Candidate, Region, hold_whole, minimise, settled
from lithoform.inverse.library import DesignLibrary
from lithoform.inverse.surrogate import Surrogate
from lithoform.inverse.targets import Target, mismatch
from lithoform.parameters import Recipe
from lithoform.seeds import Role, derive

__all__ = ["Evaluate", "Found", "search"]

Evaluate = Callable[[list[Recipe]], np.ndarray]
"""Descriptors of stones, shape (n, 4), a row of NaN where no sound mesh was found."""

_ROUNDS: Final = ((5, 12), (2, 24))
"""Settings and common seeds of the first rounds; the best setting goes on with the most."""

_SEEDS: Final = 64
"""Common seeds of the last round: a mean of scatter 0.02 is then known to 0.0025."""

_ITERATIONS: Final = 6
_ENOUGH: Final = 0.1
"""E of the mean that is believed at which no further step is worth its stones."""

_MISSED: Final = 0.5
"""E at which another setting is tried."""

_STEADY: Final = 200
"""n of J in the steps: of settings that differ little the nearest is taken, and the scatter decides between others."""

_DOUBT: Final = 2.0
"""Of the surrogate's error e, which is a statement about all settings: these were picked for what it says of them."""

_FIRST_STEP: Final = 0.2
_LEAST_STEP: Final = 0.01
_RELUCTANCE: Final = 0.5
_LEAST_SOUND: Final = 0.75
"""Share of the seeds that must give a sound mesh; a setting with fewer is left."""

_SUBSEED: Final = 1 << 33


@dataclass(frozen=True, eq=False)
class Found:
    """The setting that a search ended with.

    Attributes
    ----------
    coordinates : numpy.ndarray, shape (d,)
    recipe : Recipe
    mean, scatter : numpy.ndarray, shape (4,)
        Measured over the common seeds.
    seeds : int
        How many they were.
    stones : int
        Stones that the whole search made.
    """

    coordinates: np.ndarray
    recipe: Recipe
    mean: np.ndarray
    scatter: np.ndarray
    seeds: int
    stones: int


@dataclass(eq=False)
class _Trial:
    """A setting under way."""

    coordinates: np.ndarray
    recipe: Recipe
    mean: np.ndarray
    scatter: np.ndarray
    believed: np.ndarray
    tilt: np.ndarray
    reach: float = _FIRST_STEP


@dataclass(eq=False)
class _Search:
    library: DesignLibrary
    surrogate: Surrogate
    target: Target
    region: Region
    evaluate: Evaluate
    seed: int
    most: int
    stones: int = 0
    _known: dict[tuple[Recipe, int], np.ndarray] = field(default_factory=dict)

    def trial(self, coordinates: np.ndarray, seeds: int, tilt: np.ndarray) -> _Trial | None:
        """Measure a setting; None where too few of its stones are sound."""
        coordinates, recipe = settled(self.library, coordinates)
        recipes = [recipe.replace(seed=derive(self.seed, Role.POPULATION, _SUBSEED, i)) for i in range(seeds)]
        have = max((n for known, n in self._known if known == recipe and n <= seeds), default=0)
        rows = [self._known[recipe, have]] if have else []
        if have < seeds:
            rows.append(self.evaluate(recipes[have:]))
            self.stones += seeds - have
        values = np.concatenate(rows)
        self._known[recipe, seeds] = values
        sound = values[np.isfinite(values).all(axis=1)]
        if len(sound) < max(2.0, _LEAST_SOUND * seeds):
            return None
        mean, scatter = sound.mean(axis=0), sound.std(axis=0, ddof=1)
        believed = mean
        if seeds < self.most:
            told = self.surrogate.predict(coordinates[None])
            doubt, noise = (_DOUBT * told.error[0]) ** 2, scatter**2 / len(sound)
            believed = told.mean[0] + doubt / (doubt + noise) * (mean - told.mean[0])
        return _Trial(coordinates, recipe, mean, scatter, believed, tilt)

    def cost(self, mean: np.ndarray, scatter: np.ndarray, seeds: int = JUDGED_SEEDS) -> float:
        """J with what was measured."""
        scale = np.array(self.target.weights) / np.array(self.target.tolerance)
        return float(mismatch(mean[None], self.target)[0] ** 2 + ((scale * scatter) ** 2).sum() / seeds)

    def proposal(self, trial: _Trial) -> np.ndarray:
        """Where J is expected to be least within reach of a trial."""
        held = hold_whole(self.library, self.region, trial.coordinates)
        near = Region(
            np.maximum(held.low, trial.coordinates - trial.reach),
            np.minimum(held.high, trial.coordinates + trial.reach),
        )
        offset = trial.believed - self.surrogate.mean(trial.coordinates[None])[0]
        return minimise(
            self.surrogate, self.target, trial.coordinates, region=near, seeds=_STEADY, offset=offset,
            tilt=trial.tilt, reluctance=_RELUCTANCE,
        )  # fmt: skip

    def step(self, trial: _Trial, seeds: int) -> _Trial:
        """A trial after one step, or itself with a shorter reach where the step did not help."""
        place = self.proposal(trial)
        after = self.trial(place, seeds, trial.tilt)
        if after is None:
            trial.reach *= 0.5
            return trial
        moved = after.coordinates - trial.coordinates
        length = float((moved**2).sum())
        if length > 0.0:
            # Broyden's update: the tilt that is nearest to the former and explains what the step showed.
            expected = (
                trial.mean
                + np.diff(self.surrogate.mean(np.stack([trial.coordinates, after.coordinates])), axis=0)[0]
                + np.einsum("pd,d->p", trial.tilt, moved)
            )
            tilt = trial.tilt + np.outer(after.mean - expected, moved) / length
        else:
            tilt = trial.tilt
        if self.cost(after.believed, after.scatter, _STEADY) < self.cost(trial.believed, trial.scatter, _STEADY):
            after.tilt, after.reach = tilt, trial.reach
            return after
        trial.tilt, trial.reach = tilt, 0.4 * trial.reach
        return trial


def search(
    library: DesignLibrary,
    surrogate: Surrogate,
    target: Target,
    candidates: list[Candidate],
    *,
    region: Region,
    evaluate: Evaluate,
    seed: int = 0,
    seeds: int = _SEEDS,
) -> Found | None:
    """Bring the mean of a setting's stones to a target, with stones that are made and measured.

    Parameters
    ----------
    library : DesignLibrary
    surrogate : Surrogate
        Fitted to it.
    target : Target
    candidates : list of Candidate
        Where to begin.
    region : Region
        Bounds of the settings.
    evaluate : callable
        Descriptors of recipes; called with the seeds that a setting still lacks.
    seed : int
        Of the common seeds.
    seeds : int
        How many of them in the last round.

    Returns
    -------
    Found or None
        None if too few sound stones were found at every candidate.
    """
    work = _Search(library, surrogate, target, region, evaluate, seed, seeds)
    flat = np.zeros((len(target.values), len(library.axes)))
    places = [candidate.coordinates for candidate in candidates]
    for settings, few in _ROUNDS:
        tried = [work.trial(place, min(few, seeds), flat) for place in places[:settings]]
        # Judged by where the next step is expected to lead, not by where the surrogate began.
        ranked = [(work.proposal(trial), trial) for trial in tried if trial is not None]
        ranked.sort(key=lambda pair: _expected(work, *pair))
        places = [place for place, _ in ranked]
    best: _Trial | None = None
    for place in places[:2]:
        end = _ended(work, place, seeds, flat)
        if end is None:
            continue
        if best is None or work.cost(end.believed, end.scatter) < work.cost(best.believed, best.scatter):
            best = end
        if mismatch(best.believed[None], target)[0] < _MISSED:
            break
    if best is None:
        return None
    return Found(best.coordinates, best.recipe, best.mean, best.scatter, seeds, work.stones)


def _ended(work: _Search, place: np.ndarray, seeds: int, tilt: np.ndarray) -> _Trial | None:
    trial = work.trial(place, seeds, tilt)
    if trial is None:
        return None
    for _ in range(_ITERATIONS):
        if mismatch(trial.believed[None], work.target)[0] < _ENOUGH or trial.reach < _LEAST_STEP:
            break
        trial = work.step(trial, seeds)
    return trial


def _expected(work: _Search, place: np.ndarray, trial: _Trial) -> float:
    """J that is expected after a step, with the scatter that was measured before it."""
    change = np.diff(work.surrogate.mean(np.stack([trial.coordinates, place])), axis=0)[0]
    return work.cost(trial.believed + change, trial.scatter)
