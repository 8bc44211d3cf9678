"""Settings whose stones are expected to meet a target: the surrogate searched from many sides.

What is made least is the expected square of E (eq. 30) of the mean of a few stones,

    J(x) = sum_d (w_d / t_d)^2 ( (m_d(x) + o_d - y*_d)^2 + s_d(x)^2 / n ),

so that of two settings of the same mean that with the smaller scatter from seed to seed comes first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.axes import at_axes
from lithoform.errors import RecipeError
from lithoform.inverse.kernels import one_blas_thread
from lithoform.inverse.library import DesignLibrary
from lithoform.inverse.surrogate import Surrogate
from lithoform.inverse.targets import Target
from lithoform.parameters import Recipe, suggest
from lithoform.presets import SHAPE_CLASSES, ZINGG_LIMIT

__all__ = ["JUDGED_SEEDS", "Candidate", "Region", "find_candidates", "hold_whole", "minimise", "region_of", "settled"]

JUDGED_SEEDS: Final = 10
"""n of J: a setting is judged by the mean of so many stones."""

_STARTS: Final = 16
_STEPS: Final = 60
_APART: Final = 0.12
"""Least distance of two starts or candidates along some axis, as coordinates."""

_MARGIN: Final = 0.01
"""Distance of EI and FI from the limit of a class."""


@dataclass(frozen=True, eq=False)
class Region:
    """Where settings may lie: bounds of the coordinates, each of shape (d,)."""

    low: np.ndarray
    high: np.ndarray

    def inside(self, coordinates: np.ndarray) -> np.ndarray:
        """The points of the unit cube, moved into it evenly."""
        return self.low + (self.high - self.low) * coordinates


@dataclass(frozen=True, eq=False)
class Candidate:
    """A setting and what the surrogate expects of it.

    Attributes
    ----------
    coordinates : numpy.ndarray, shape (d,)
    recipe : Recipe
    mean, error, scatter : numpy.ndarray, shape (4,)
        As `lithoform.inverse.surrogate.Prediction`.
    expected : float
        Root of J with the error of the surrogate added to it: E that is to be expected of the mean of ten stones.
    """

    coordinates: np.ndarray
    recipe: Recipe
    mean: np.ndarray
    error: np.ndarray
    scatter: np.ndarray
    expected: float


def region_of(library: DesignLibrary, shape_class: str | None) -> Region:
    """The whole library, or the part of a Zingg class.

    Raises
    ------
    RecipeError
        If the class is unknown, or the library has no part in it.
    """
    low, high = np.zeros(len(library.axes)), np.ones(len(library.axes))
    if shape_class is None:
        return Region(low, high)
    if shape_class not in SHAPE_CLASSES:
        raise RecipeError(f"expected --class to be one of {', '.join(SHAPE_CLASSES)}; got {shape_class!r}."
                          f"{suggest(shape_class, SHAPE_CLASSES)}")  # fmt: skip
    base = library.base
    fixed = {"elongation": base.width / base.length, "flatness": base.height / base.width}
    for name, long_classes in (("elongation", ("column", "blade")), ("flatness", ("plate", "blade"))):
        below = shape_class in long_classes
        place = next((i for i, axis in enumerate(library.axes) if axis.name == name), None)
        if place is None:
            if (fixed[name] < ZINGG_LIMIT) != below:
                raise RecipeError(f"the library holds no {shape_class}: its {name} is {fixed[name]:.3g} throughout.")
            continue
        axis = library.axes[place]
        if not axis.low < ZINGG_LIMIT < axis.high:
            raise RecipeError(f"the library does not vary {name} on both sides of 2/3; leave out --class.")
        if below:
            high[place] = axis.coordinate(ZINGG_LIMIT - _MARGIN)
        else:
            low[place] = axis.coordinate(ZINGG_LIMIT + _MARGIN)
    return Region(low, high)


def settled(library: DesignLibrary, coordinates: np.ndarray) -> tuple[np.ndarray, Recipe]:
    """Coordinates on values that a recipe can have and a reader can copy: whole, or of five digits; and the recipe."""
    settings: dict[str, float | int] = {}
    for axis, coordinate in zip(library.axes, coordinates, strict=True):
        value = axis.setting(float(coordinate))
        settings[axis.name] = value if axis.is_whole else min(max(float(f"{value:.5g}"), axis.low), axis.high)
    settled_at = [axis.coordinate(settings[axis.name]) for axis in library.axes]
    return np.array(settled_at), at_axes(library.base, settings)


def find_candidates(
    library: DesignLibrary,
    surrogate: Surrogate,
    target: Target,
    *,
    region: Region,
    count: int,
    seeds: int = JUDGED_SEEDS,
) -> list[Candidate]:
    """Settings of least J that differ from one another, the best first.

    Parameters
    ----------
    library : DesignLibrary
        Where the search starts, and how coordinates become recipes.
    surrogate : Surrogate
        Fitted to it.
    target : Target
    region : Region
    count : int
        At most so many.
    seeds : int
        n of J.

    Returns
    -------
    list of Candidate
    """
    places = region.inside(library.coordinates)
    scale = _scale(target)
    away = (surrogate.mean(places) - _values(target)) * scale
    scatter = surrogate.scatter(places) * scale
    order = np.argsort((away**2).sum(axis=1) + (scatter**2).sum(axis=1) / seeds, kind="stable")
    ends = []
    for start in _distinct(places[order], _STARTS):
        end = minimise(surrogate, target, start, region=region, seeds=seeds)
        # The least of a whole number lies beside it: the others are settled once it is.
        end, _ = settled(library, end)
        held = hold_whole(library, region, end)
        ends.append(settled(library, minimise(surrogate, target, end, region=held, seeds=seeds)))
    found = surrogate.predict(np.array([coordinates for coordinates, _ in ends]))
    bias, spread = (found.mean - _values(target)) * scale, (found.scatter**2 / seeds + found.error**2) * scale**2
    expected = np.sqrt((bias**2 + spread).sum(axis=1))
    order = np.argsort(expected, kind="stable")
    kept: list[Candidate] = []
    for i in order:
        coordinates, recipe = ends[i]
        if len(kept) < count and all(np.abs(coordinates - k.coordinates).max() > _APART for k in kept):
            kept.append(
                Candidate(coordinates, recipe, found.mean[i], found.error[i], found.scatter[i], float(expected[i]))
            )
    return kept


def minimise(
    surrogate: Surrogate,
    target: Target,
    start: np.ndarray,
    *,
    region: Region,
    seeds: int = JUDGED_SEEDS,
    offset: np.ndarray | None = None,
    tilt: np.ndarray | None = None,
    reluctance: float = 0.0,
) -> np.ndarray:
    """Place of least J near a start.

    Parameters
    ----------
    surrogate : Surrogate
    target : Target
    start : numpy.ndarray, shape (d,)
    region : Region
        Bounds of the place.
    seeds : int
        n of J.
    offset : numpy.ndarray, shape (4,), optional
        o: what stones at the start measured beyond the surrogate.
    tilt : numpy.ndarray, shape (4, d), optional
        How o grows with the distance from the start.
    reluctance : float
        Weight of the squared distance from the start, which keeps directions that do not matter where they are.

    Returns
    -------
    numpy.ndarray, shape (d,)
    """
    from scipy.optimize import minimize

    scale, values = _scale(target), _values(target)
    offset = np.zeros(len(values)) if offset is None else offset
    tilt = np.zeros((len(values), len(start))) if tilt is None else tilt

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        step = x - start
        mean, scatter, slopes, log_slopes = surrogate.with_slopes(x)
        away = (mean + offset + np.einsum("pd,d->p", tilt, step) - values) * scale
        scatter = scatter * scale
        value = (away**2).sum() + (scatter**2).sum() / seeds + reluctance * (step**2).sum()
        slope = 2.0 * np.einsum("p,pd->d", away * scale, slopes + tilt)
        slope += 2.0 / seeds * np.einsum("p,pd->d", scatter**2, log_slopes) + 2.0 * reluctance * step
        return float(value), slope

    bounds = list(zip(region.low, region.high, strict=True))
    begin = np.clip(start, region.low, region.high)
    with one_blas_thread():
        found = minimize(objective, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _STEPS})
    return np.clip(found.x, region.low, region.high)


def hold_whole(library: DesignLibrary, region: Region, coordinates: np.ndarray) -> Region:
    """The same region with whole numbers held at their value."""
    whole = np.array([axis.is_whole for axis in library.axes])
    return Region(np.where(whole, coordinates, region.low), np.where(whole, coordinates, region.high))


def _distinct(places: np.ndarray, count: int) -> list[np.ndarray]:
    kept: list[np.ndarray] = []
    for place in places:
        if all(np.abs(place - other).max() > 2.0 * _APART for other in kept):
            kept.append(place)
            if len(kept) == count:
                break
    return kept


def _scale(target: Target) -> np.ndarray:
    return np.array(target.weights) / np.array(target.tolerance)


def _values(target: Target) -> np.ndarray:
    """Target values, with a number where nothing is asked (its weight is 0)."""
    return np.nan_to_num(np.array(target.values), nan=0.5)
