"""Descriptors of stones that were not made: a polynomial of the setting, and the scatter of stones made nearby.

    y(u, g) = p(u, g) + s(u) / s(u_i) e_i

p is a cubic of the coordinates u and the scores g of the dimensions, e_i is what the cubic leaves of a made stone i
near (u, g), and s the size of what it leaves, an exponential of a quadratic, for each descriptor.  The scatter from
seed to seed is thus that of made stones, with its correlations and tails, and no stone is preferred because its seed
was lucky.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final

import numpy as np

__all__ = ["Emulator", "Stones", "fit_emulator"]

_SCORE_UNIT: Final = 2.5
"""Scores are divided by it and held within -1 to 1, as coordinates are."""

_STONES_PER_TERM: Final = 2
"""Fewest stones for each term of a cubic; with fewer a quadratic is fitted."""

_RIDGE: Final = 1e-4
_SCATTER_RIDGE: Final = 1e-2
_SCORING_STEPS: Final = 6
_MOST_WORKING: Final = 4.0
_MOST_CHANGE: Final = 1.5
"""Largest change of the logarithm of the scatter between a stone and where it is used."""


@dataclass(frozen=True, eq=False)
class Stones:
    """Stones made so far.

    Attributes
    ----------
    coordinates : numpy.ndarray, shape (n, d)
    scores : numpy.ndarray, shape (n, 3)
        Normal scores of L, EI and FI.
    values : numpy.ndarray, shape (n, p)
        Descriptors, each in its unit.
    """

    coordinates: np.ndarray
    scores: np.ndarray
    values: np.ndarray

    def __len__(self) -> int:
        return len(self.coordinates)

    def joined(self, other: Stones) -> Stones:
        """Both together."""
        names = ("coordinates", "scores", "values")
        return Stones(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


@dataclass(frozen=True, eq=False)
class _Polynomial:
    """All monomials of up to a degree: `factors` has, for each, the columns multiplied (0 is the constant 1)."""

    factors: np.ndarray

    @classmethod
    def of(cls, columns: int, degree: int) -> _Polynomial:
        return cls(np.array(list(combinations_with_replacement(range(columns + 1), degree))))

    def terms(self, x: np.ndarray) -> np.ndarray:
        """Values of the monomials, shape (n, terms)."""
        padded = np.column_stack([np.ones(len(x)), x])
        product = np.ones((len(x), len(self.factors)))
        for column in self.factors.T:
            product *= padded[:, column]
        return product

    def slopes(self, x: np.ndarray, coefficients: np.ndarray, columns: int) -> np.ndarray:
        """Derivatives of the polynomials by the first columns, shape (n, polynomials, columns)."""
        padded = np.column_stack([np.ones(len(x)), x])
        slopes = np.zeros((len(x), coefficients.shape[1], columns))
        for place in range(self.factors.shape[1]):
            others = np.ones((len(x), len(self.factors)))
            for other in range(self.factors.shape[1]):
                if other != place:
                    others *= padded[:, self.factors[:, other]]
            for column in range(columns):
                chosen = self.factors[:, place] == column + 1
                slopes[:, :, column] += np.einsum("nt,tp->np", others[:, chosen], coefficients[chosen])
        return slopes


@dataclass(frozen=True, eq=False)
class Emulator:
    """What stones of any setting are expected to measure; see `fit_emulator`."""

    stones: Stones
    mean: _Polynomial
    coefficients: np.ndarray
    scatter: _Polynomial
    scatter_coefficients: np.ndarray
    residuals: np.ndarray
    log_scatter: np.ndarray

    def nearest(self, coordinates: np.ndarray, scores: np.ndarray) -> np.ndarray:
        """A made stone for each place, shape (m,), each at most once or evenly often, and near on the whole."""
        from scipy.optimize import linear_sum_assignment

        places, made = _inputs(coordinates, scores), _inputs(self.stones.coordinates, self.stones.scores)
        squares = np.zeros((len(places), len(made)))
        for one, other in zip(places.T, made.T, strict=True):
            squares += (one[:, None] - other) ** 2
        repeats = -(-len(places) // len(made))
        rows, columns = linear_sum_assignment(np.tile(squares, repeats))
        stones = np.empty(len(places), dtype=np.int64)
        stones[rows] = columns % len(made)
        return stones

    def values(self, coordinates: np.ndarray, scores: np.ndarray, stones: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Descriptors at places with the scatter of given stones, and derivatives by the coordinates.

        Parameters
        ----------
        coordinates : numpy.ndarray, shape (m, d)
        scores : numpy.ndarray, shape (m, 3)
        stones : numpy.ndarray of int, shape (m,)

        Returns
        -------
        numpy.ndarray, shape (m, p)
        numpy.ndarray, shape (m, p, d)
        """
        d = coordinates.shape[1]
        x = _inputs(coordinates, scores)
        change = np.einsum("nt,tp->np", self.scatter.terms(x[:, :d]), self.scatter_coefficients)
        change -= self.log_scatter[stones]
        held = np.abs(change) < _MOST_CHANGE
        ratio = np.exp(np.clip(change, -_MOST_CHANGE, _MOST_CHANGE))
        scattered = ratio * self.residuals[stones]
        values = np.einsum("nt,tp->np", self.mean.terms(x), self.coefficients) + scattered
        slopes = self.mean.slopes(x, self.coefficients, d)
        own = self.scatter.slopes(x[:, :d], self.scatter_coefficients, d)
        slopes += (scattered * held)[:, :, None] * own
        inside = (coordinates > 0.0) & (coordinates < 1.0)
        return values, 2.0 * slopes * inside[:, None, :]


def fit_emulator(stones: Stones, weights: np.ndarray | None = None) -> Emulator:
    """Fit the polynomials to stones.

    Parameters
    ----------
    stones : Stones
    weights : numpy.ndarray, shape (n,), optional
        Of the stones.
    """
    d = stones.coordinates.shape[1]
    weights = np.ones(len(stones)) if weights is None else weights
    x = _inputs(stones.coordinates, stones.scores)
    cubic = _Polynomial.of(x.shape[1], 3)
    mean = cubic if len(stones) >= _STONES_PER_TERM * len(cubic.factors) else _Polynomial.of(x.shape[1], 2)
    scatter = _Polynomial.of(d, 2)
    terms, own = mean.terms(x), scatter.terms(x[:, :d])
    coefficients = _least_squares(terms, stones.values, weights, _RIDGE)
    residuals = stones.values - np.einsum("nt,tp->np", terms, coefficients)
    sizes = np.abs(residuals)
    scatter_coefficients = np.zeros((own.shape[1], sizes.shape[1]))
    scatter_coefficients[0] = np.log(sizes.mean(axis=0))
    for _ in range(_SCORING_STEPS):
        # Fisher scoring of a gamma model with a log link: consistent, where a fit of log |e| leans on the smallest.
        logs = np.einsum("nt,tp->np", own, scatter_coefficients)
        change = np.minimum(sizes * np.exp(-logs) - 1.0, _MOST_WORKING)
        scatter_coefficients = _least_squares(own, logs + change, weights, _SCATTER_RIDGE)
    log_scatter = np.einsum("nt,tp->np", own, scatter_coefficients)
    return Emulator(stones, mean, coefficients, scatter, scatter_coefficients, residuals, log_scatter)


def _inputs(coordinates: np.ndarray, scores: np.ndarray) -> np.ndarray:
    return np.column_stack([2.0 * np.clip(coordinates, 0.0, 1.0) - 1.0, np.clip(scores / _SCORE_UNIT, -1.0, 1.0)])


def _least_squares(terms: np.ndarray, values: np.ndarray, weights: np.ndarray, ridge: float) -> np.ndarray:
    """Ridge regression by a Cholesky decomposition without BLAS, whose last bits depend on its threads."""
    weights = weights / weights.mean()
    scale = np.sqrt(np.einsum("n,nt,nt->t", weights, terms, terms) / len(terms))
    scale[scale == 0.0] = 1.0
    scaled = terms / scale
    matrix = np.einsum("nt,nu->tu", scaled * weights[:, None], scaled) / len(terms)
    matrix += ridge * np.eye(len(matrix))
    right = np.einsum("nt,np->tp", scaled * weights[:, None], values) / len(terms)
    n = len(matrix)
    lower = np.zeros((n, n))
    for j in range(n):
        column = matrix[j:, j] - np.einsum("ij,j->i", lower[j:, :j], lower[j, :j])
        lower[j:, j] = column / np.sqrt(column[0])
    for j in range(n):
        right[j] = (right[j] - np.einsum("j,jp->p", lower[j, :j], right[:j])) / lower[j, j]
    for j in reversed(range(n)):
        right[j] = (right[j] - np.einsum("j,jp->p", lower[j + 1 :, j], right[j + 1 :])) / lower[j, j]
    return right / scale[:, None]
