"""The texture of a population from stones of other settings: least energy distance of emulated stones.

Coordinates u of a stone's parameters are normal given the normal scores g of its dimensions,

    u = m + B g + S z,   z standard normal,   S lower triangular,

and the descriptors y of a stone follow from u, g and its seed.  Stones at fixed z and g move with m, B and S, and what
they measure is emulated (`lithoform.matching.emulator`).  Their energy distance to the reference,

    E = 2 mean |y - r| - mean |y - y'| - mean |r - r'|,   y and y' of two different stones,

is a proper score, least for the reference's own distribution (Gneiting and Raftery 2007), and is minimised over m, B
and S.  A stone beside itself does not count: it would make every population look narrower than it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.matching.emulator import Emulator
from lithoform.matching.energy import energy_distances, sum_of_distances

__all__ = ["Density", "Estimate", "Places", "estimate", "objective"]

_DIMENSIONS: Final = 3
_LEAST_DEVIATION: Final = 0.01  # of a coordinate's range; narrower populations of few stones cannot be told from it
_MOST_DEVIATION: Final = 0.6
_MOST_SLOPE: Final = 0.6
_USUAL_DEVIATION: Final = 0.10


@dataclass(frozen=True, eq=False)
class Density:
    """Normal density of coordinates given scores.

    Attributes
    ----------
    mean : numpy.ndarray, shape (d,)
        m: coordinates at scores of 0.
    slopes : numpy.ndarray, shape (d, 3)
        B: change with the scores of L, EI and FI.
    spread : numpy.ndarray, shape (d, d)
        S: lower triangular, positive on the diagonal.
    """

    mean: np.ndarray
    slopes: np.ndarray
    spread: np.ndarray

    def draw(self, normal: np.ndarray, scores: np.ndarray) -> np.ndarray:
        """Coordinates of independent normal numbers, shape (n, d)."""
        return self.mean + np.einsum("ij,kj->ik", scores, self.slopes) + np.einsum("ij,kj->ik", normal, self.spread)

    def joint(self, correlation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Deviations of the coordinates, shape (d,), and the correlation with the scores before them, (3 + d, 3 + d).

        Parameters
        ----------
        correlation : numpy.ndarray, shape (3, 3)
            Of the scores.
        """
        cross = np.einsum("ij,jk->ik", self.slopes, correlation)
        own = np.einsum("ij,kj->ik", cross, self.slopes) + np.einsum("ij,kj->ik", self.spread, self.spread)
        whole = np.block([[correlation, cross.T], [cross, own]])
        deviations = np.sqrt(np.diag(whole))
        matrix = whole / np.outer(deviations, deviations)
        matrix = 0.5 * (matrix + matrix.T)
        np.fill_diagonal(matrix, 1.0)
        return deviations[_DIMENSIONS:], matrix


@dataclass(frozen=True, eq=False)
class Places:
    """Where a population's stones are emulated.

    Attributes
    ----------
    normal : numpy.ndarray, shape (m, d)
        z.
    scores : numpy.ndarray, shape (m, 3)
        g: of L, EI and FI.
    dimensions : numpy.ndarray, shape (m, k)
        What is compared beside the descriptors; k may be 0.
    """

    normal: np.ndarray
    scores: np.ndarray
    dimensions: np.ndarray


@dataclass(frozen=True, eq=False)
class Estimate:
    """A population that was found.

    Attributes
    ----------
    density : Density
    objective : float
        What was minimised: the energy with the prices.
    energy : float
        Squared energy distance of the emulated stones to the reference.
    noise : float
        What a reference of this size has on average if it is a sample of the population.
    """

    density: Density
    objective: float
    energy: float
    noise: float


def estimate(
    emulator: Emulator, places: Places, reference: np.ndarray, preset: np.ndarray, start: Density, *, steps: int = 150
) -> Estimate:
    """Density of least energy distance to a reference.

    Parameters
    ----------
    emulator : Emulator
    places : Places
    reference : numpy.ndarray, shape (n, p + k)
        Descriptors as the emulator gives them, then what `Places.dimensions` has.
    preset : numpy.ndarray, shape (d,)
        Coordinates towards which means are drawn by a weight of 1 / n.
    start : Density
    steps : int
        Of the minimiser, at most, in each of two passes: in the second the places take the scatter of the stones that
        are nearest by then.
    """
    from scipy.optimize import minimize

    d = len(start.mean)
    bounds = (
        [(0.0, 1.0)] * d
        + [(-_MOST_SLOPE, _MOST_SLOPE)] * (_DIMENSIONS * d)
        + [(math.log(_LEAST_DEVIATION), math.log(_MOST_DEVIATION))] * d
        + [(-_MOST_DEVIATION, _MOST_DEVIATION)] * (d * (d - 1) // 2)
    )
    density, problem, value = start, None, math.inf
    for _ in range(2):
        problem = _Problem(emulator, places, reference, preset, density)
        found = minimize(
            problem, _packed(density), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps}
        )
        density, value = _unpacked(np.asarray(found.x, dtype=np.float64), d), float(found.fun)
    assert problem is not None
    energy, own = problem.energy(density)
    return Estimate(density, value, energy, own / len(reference))


def objective(
    emulator: Emulator, places: Places, reference: np.ndarray, preset: np.ndarray, density: Density, near: Density
) -> tuple[float, np.ndarray]:
    """What `estimate` minimises, and its gradient, with the scatter of stones near another density (for tests)."""
    return _Problem(emulator, places, reference, preset, near)(_packed(density))


def _packed(density: Density) -> np.ndarray:
    d = len(density.mean)
    lower = density.spread[np.tril_indices(d, -1)]
    return np.concatenate([density.mean, density.slopes.ravel(), np.log(np.diag(density.spread)), lower])


def _unpacked(x: np.ndarray, d: int) -> Density:
    mean, slopes, log_diagonal, lower = np.split(x, [d, d + _DIMENSIONS * d, 2 * d + _DIMENSIONS * d])
    spread = np.diag(np.exp(log_diagonal))
    spread[np.tril_indices(d, -1)] = lower
    return Density(mean.copy(), slopes.reshape(d, _DIMENSIONS), spread)


class _Problem:
    """Objective and gradient.  Sums run by einsum, never by BLAS, whose last bits depend on its threads."""

    def __init__(
        self, emulator: Emulator, places: Places, reference: np.ndarray, preset: np.ndarray, near: Density
    ) -> None:
        self.emulator, self.places, self.preset = emulator, places, preset
        middle, unit = reference.mean(axis=0), reference.std(axis=0, ddof=1)
        self.target = (reference - middle) / unit
        self.first = emulator.residuals.shape[1]
        self.middle, self.unit = middle[: self.first], unit[: self.first]
        self.dimensions = (places.dimensions - middle[self.first :]) / unit[self.first :]
        self.constant = float(energy_distances(self.target, self.target, self.first).mean())
        self.price = 1.0 / len(reference)
        self.stones = emulator.nearest(near.draw(places.normal, places.scores), places.scores)

    def parts(self, density: Density) -> tuple[float, float, np.ndarray]:
        """Energy, mean distance of two stones, and derivatives of the energy by the coordinates."""
        places, m = self.places, len(self.places.normal)
        coordinates = density.draw(places.normal, places.scores)
        values, slopes = self.emulator.values(coordinates, places.scores, self.stones)
        rows = np.column_stack([(values - self.middle) / self.unit, self.dimensions])
        across, by_across = sum_of_distances(rows, self.target, self.first)
        between, by_between = sum_of_distances(rows, rows, self.first)
        pairs, own_pairs = m * len(self.target), m * (m - 1)
        energy = 2.0 * across / pairs - between / own_pairs - self.constant
        by_rows = 2.0 * by_across / pairs - 2.0 * by_between / own_pairs
        own = between / own_pairs
        return energy, own, np.einsum("np,npd->nd", by_rows / self.unit, slopes)

    def energy(self, density: Density) -> tuple[float, float]:
        energy, own, _ = self.parts(density)
        return energy, own

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        d = len(self.preset)
        density = _unpacked(x, d)
        value, _, by_coordinates = self.parts(density)
        below = np.tril_indices(d, -1)
        by_spread = np.einsum("ni,nj->ij", by_coordinates, self.places.normal)
        away = density.mean - self.preset
        log_diagonal = np.log(np.diag(density.spread))
        usual = log_diagonal - math.log(_USUAL_DEVIATION)
        lower = density.spread[below] / _USUAL_DEVIATION
        value += self.price * float(
            (away**2).sum() + 4.0 * (density.slopes**2).sum() + 0.05 * (usual**2).sum() + 0.01 * (lower**2).sum()
        )
        gradient = np.concatenate(
            [
                by_coordinates.sum(axis=0) + self.price * 2.0 * away,
                (
                    np.einsum("ni,nj->ij", by_coordinates, self.places.scores) + self.price * 8.0 * density.slopes
                ).ravel(),
                np.diag(by_spread) * np.diag(density.spread) + self.price * 0.1 * usual,
                by_spread[below] + self.price * 0.02 * lower / _USUAL_DEVIATION,
            ]
        )
        return value, gradient
