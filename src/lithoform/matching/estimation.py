"""The texture of a population from stones of other settings: least energy distance by importance weights.

Coordinates u of a stone's parameters are normal given the normal scores g of its dimensions,

    u = m + B g + e,   W e standard normal,   W lower triangular,

and the descriptors y of a stone follow from u, g and its seed.  Stones drawn from other densities p_r stand for the
population with weights w proportional to q(u | g) / sum_r (n_r / n) p_r(u | g) (the balance heuristic, Veach and Guibas
1995), the scatter from seed to seed included.  The energy distance of the weighted stones to the reference,

    E(w) = 2 w' b - w' D w - c,

is a proper score, least for the reference's own distribution (Gneiting and Raftery 2007), and is minimised over m, B
and W.  Not the weights are chosen but the population: weights chosen stone by stone would pick lucky seeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from lithoform.descriptors.table import FOUR

__all__ = ["Density", "Estimate", "Pool", "energy_distances", "estimate", "objective"]

_DIMENSIONS: Final = 3
_LEAST_DEVIATION: Final = 0.015  # of a coordinate's range; narrower populations of few stones cannot be told from it
_MOST_DEVIATION: Final = 0.6
_MOST_SLOPE: Final = 0.6

_MARGIN_SHARE: Final = 0.5
_ALL_SHARE: Final = 0.5
"""Weights, beside the distance of the four descriptors together, of each one's own and of all with the dimensions."""

_FEW_STONES: Final = 0.02
"""Price of weights on few stones, times the squared log of the ratio by which they are too few."""


@dataclass(frozen=True, eq=False)
class Density:
    """Normal density of coordinates given scores.

    Attributes
    ----------
    mean : numpy.ndarray, shape (d,)
        m: coordinates at scores of 0.
    slopes : numpy.ndarray, shape (d, 3)
        B: change with the scores of L, EI and FI.
    whitening : numpy.ndarray, shape (d, d)
        W: lower triangular, positive on the diagonal.
    """

    mean: np.ndarray
    slopes: np.ndarray
    whitening: np.ndarray

    def widened(self, factor: float) -> Density:
        """The same with deviations times a factor."""
        return replace(self, whitening=self.whitening / factor)

    def log(self, coordinates: np.ndarray, scores: np.ndarray) -> np.ndarray:
        """Logarithm of the density, shape (n,)."""
        residuals = coordinates - self.mean - np.einsum("ij,kj->ik", scores, self.slopes)
        white = np.einsum("ij,kj->ik", residuals, self.whitening)
        constant = float(np.log(np.diag(self.whitening)).sum()) - 0.5 * len(self.mean) * math.log(2.0 * math.pi)
        return constant - 0.5 * np.einsum("ij,ij->i", white, white)

    def draw(self, normal: np.ndarray, scores: np.ndarray) -> np.ndarray:
        """Coordinates of independent normal numbers, shape (n, d)."""
        spread = np.linalg.inv(self.whitening)
        return self.mean + np.einsum("ij,kj->ik", scores, self.slopes) + np.einsum("ij,kj->ik", normal, spread)

    def joint(self, correlation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Deviations of the coordinates, shape (d,), and the correlation with the scores before them, (3 + d, 3 + d).

        Parameters
        ----------
        correlation : numpy.ndarray, shape (3, 3)
            Of the scores.
        """
        spread = np.linalg.inv(self.whitening)
        cross = np.einsum("ij,jk->ik", self.slopes, correlation)
        own = np.einsum("ij,kj->ik", cross, self.slopes) + np.einsum("ij,kj->ik", spread, spread)
        whole = np.block([[correlation, cross.T], [cross, own]])
        deviations = np.sqrt(np.diag(whole))
        matrix = whole / np.outer(deviations, deviations)
        matrix = 0.5 * (matrix + matrix.T)
        np.fill_diagonal(matrix, 1.0)
        return deviations[_DIMENSIONS:], matrix


@dataclass(frozen=True, eq=False)
class Pool:
    """Stones made so far.

    Attributes
    ----------
    coordinates : numpy.ndarray, shape (n, d)
        As drawn, before they are clipped.
    scores : numpy.ndarray, shape (n, 3)
        Normal scores of L, EI and FI.
    values : numpy.ndarray, shape (n, p)
        Descriptors, each in its unit.
    origins : tuple of (int, Density or None)
        Number of stones of each density in their order; None is even over the unit cube.
    """

    coordinates: np.ndarray
    scores: np.ndarray
    values: np.ndarray
    origins: tuple[tuple[int, Density | None], ...]

    def __len__(self) -> int:
        return len(self.coordinates)

    def joined(self, other: Pool) -> Pool:
        """Both together."""
        stacked = (np.concatenate([getattr(self, k), getattr(other, k)]) for k in ("coordinates", "scores", "values"))
        return Pool(*stacked, origins=(*self.origins, *other.origins))

    def log_density(self) -> np.ndarray:
        """Logarithm of the density of the mixture that the stones are drawn from, shape (n,)."""
        inside = ((self.coordinates >= 0.0) & (self.coordinates <= 1.0)).all(axis=1)
        even = np.where(inside, 0.0, -np.inf)
        parts = [
            (even if density is None else density.log(self.coordinates, self.scores)) + math.log(count / len(self))
            for count, density in self.origins
        ]
        return np.logaddexp.reduce(parts, axis=0)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A population that was found.

    Attributes
    ----------
    density : Density
    objective : float
        What was minimised: the energy with the prices.
    energy : float
        Squared energy distance of the weighted stones to the reference.
    noise : float
        What a reference of this size has on average if it is a sample of the population.
    stones : float
        1 / sum of squared weights: how many stones of equal weight would tell as much.
    weights : numpy.ndarray, shape (n,)
    """

    density: Density
    objective: float
    energy: float
    noise: float
    stones: float
    weights: np.ndarray


def energy_distances(a: np.ndarray, b: np.ndarray, first: int = len(FOUR)) -> np.ndarray:
    """Distances of all rows: Euclidean of the first columns, half of each of these alone, half Euclidean of all.

    Each part is of negative type, so that the energy distance of their sum is a distance of distributions.

    Parameters
    ----------
    a, b : numpy.ndarray, shape (n, p) and (m, p)
        In standard deviations.
    first : int
        Columns that the match is for; the rest are the dimensions.

    Returns
    -------
    numpy.ndarray, shape (n, m)
    """
    squares = np.zeros((len(a), len(b)))
    margins, inner = np.zeros_like(squares), np.zeros_like(squares)
    for i, (left, right) in enumerate(zip(a.T, b.T, strict=True)):
        away = np.abs(left[:, None] - right)
        squares += away * away
        if i < first:
            margins += away
            inner = squares.copy() if i == first - 1 else inner
    inner = squares if a.shape[1] <= first else inner
    return np.sqrt(inner) + _MARGIN_SHARE * margins + _ALL_SHARE * np.sqrt(squares)


def estimate(
    pool: Pool, reference: np.ndarray, preset: np.ndarray, starts: list[Density], *, least_stones: float
) -> Estimate:
    """Density of least energy distance to a reference.

    Parameters
    ----------
    pool : Pool
    reference : numpy.ndarray, shape (m, p)
        The descriptors that `pool.values` holds, of the reference.
    preset : numpy.ndarray, shape (d,)
        Coordinates towards which means are drawn by a weight of 1 / m.
    starts : list of Density
        The search begins at each; the best end is taken.
    least_stones : float
        Weights on fewer stones than this are made dear: they would fit the seeds of these.

    Returns
    -------
    Estimate
    """
    from scipy.optimize import minimize

    problem = _Problem(pool, reference, preset, least_stones)
    d = pool.coordinates.shape[1]
    bounds = (
        [(0.0, 1.0)] * d
        + [(-_MOST_SLOPE, _MOST_SLOPE)] * (_DIMENSIONS * d)
        + [(-math.log(_MOST_DEVIATION), -math.log(_LEAST_DEVIATION))] * d
        + [(-40.0, 40.0)] * (d * (d - 1) // 2)
    )
    ends = [
        minimize(problem, _packed(start), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 300})
        for start in starts
    ]
    best = min(ends, key=lambda end: float(end.fun))
    density = _unpacked(np.asarray(best.x, dtype=np.float64), d)
    weights = problem.weights(density)
    own = float(np.einsum("i,i->", weights, np.einsum("ij,j->i", problem.between, weights)))
    return Estimate(
        density,
        float(best.fun),
        problem.energy(weights),
        own / len(reference),
        float(1.0 / np.einsum("i,i->", weights, weights)),
        weights,
    )


def objective(pool: Pool, reference: np.ndarray, preset: np.ndarray, density: Density) -> tuple[float, np.ndarray]:
    """What `estimate` minimises, and its gradient, at a density (for tests of the gradient)."""
    return _Problem(pool, reference, preset, 0.5 * len(pool))(_packed(density))


def _packed(density: Density) -> np.ndarray:
    d = len(density.mean)
    lower = density.whitening[np.tril_indices(d, -1)]
    return np.concatenate([density.mean, density.slopes.ravel(), np.log(np.diag(density.whitening)), lower])


def _unpacked(x: np.ndarray, d: int) -> Density:
    mean, slopes, log_diagonal, lower = np.split(x, [d, d + _DIMENSIONS * d, 2 * d + _DIMENSIONS * d])
    whitening = np.diag(np.exp(log_diagonal))
    whitening[np.tril_indices(d, -1)] = lower
    return Density(mean.copy(), slopes.reshape(d, _DIMENSIONS), whitening)


class _Problem:
    """Objective and gradient.  Sums run by einsum, never by BLAS, whose last bits depend on its threads."""

    def __init__(self, pool: Pool, reference: np.ndarray, preset: np.ndarray, least_stones: float) -> None:
        middle, unit = reference.mean(axis=0), reference.std(axis=0, ddof=1)
        stones, target = (pool.values - middle) / unit, (reference - middle) / unit
        self.pool, self.preset, self.least = pool, preset, least_stones
        self.log_origin = pool.log_density()
        self.between = energy_distances(stones, stones)
        self.across = energy_distances(stones, target).mean(axis=1)
        self.constant = float(energy_distances(target, target).mean())
        self.price = 1.0 / len(reference)

    def weights(self, density: Density) -> np.ndarray:
        logs = density.log(self.pool.coordinates, self.pool.scores) - self.log_origin
        raw = np.exp(logs - logs.max())
        return raw / raw.sum()

    def energy(self, weights: np.ndarray) -> float:
        moved = np.einsum("ij,j->i", self.between, weights)
        return float(np.einsum("i,i->", weights, 2.0 * self.across - moved)) - self.constant

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        d = self.pool.coordinates.shape[1]
        density = _unpacked(x, d)
        w = self.weights(density)
        moved = np.einsum("ij,j->i", self.between, w)
        value = float(np.einsum("i,i->", w, 2.0 * self.across - moved)) - self.constant
        by_weight = 2.0 * (self.across - moved)
        stones = 1.0 / float(np.einsum("i,i->", w, w))
        lack = max(0.0, math.log(self.least / stones))
        value += _FEW_STONES * lack * lack
        by_weight = by_weight + 4.0 * _FEW_STONES * lack * stones * w
        # The weights are a softmax of the log density.
        by_log = w * (by_weight - float(np.einsum("i,i->", w, by_weight)))
        scores = self.pool.scores
        residuals = self.pool.coordinates - density.mean - np.einsum("ij,kj->ik", scores, density.slopes)
        white = np.einsum("ij,kj->ik", residuals, density.whitening)
        by_residual = np.einsum("ij,jk->ik", white, density.whitening) * by_log[:, None]
        by_mean = by_residual.sum(axis=0)
        by_slopes = np.einsum("ij,ik->jk", by_residual, scores)
        by_whitening = -np.einsum("ij,ik->jk", white * by_log[:, None], residuals)
        by_diagonal = np.diag(by_whitening) * np.diag(density.whitening) + by_log.sum()
        below = np.tril_indices(d, -1)
        away = density.mean - self.preset
        log_diagonal = np.log(np.diag(density.whitening))
        usual = log_diagonal - math.log(1.0 / 0.10)
        lower = density.whitening[below]
        value += self.price * float(
            (away**2).sum() + 4.0 * (density.slopes**2).sum() + 0.05 * (usual**2).sum() + 0.01 * (lower**2).sum()
        )
        gradient = np.concatenate(
            [
                by_mean + self.price * 2.0 * away,
                (by_slopes + self.price * 8.0 * density.slopes).ravel(),
                by_diagonal + self.price * 0.1 * usual,
                by_whitening[below] + self.price * 0.02 * lower,
            ]
        )
        return value, gradient
