"""How far two samples differ, in their middle and in their tails, with bootstrap intervals.

Each sample is drawn anew from itself, with replacement; an interval runs between percentiles of what the replicates
give (Efron's percentile interval).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.statistics.permutation import TAILS
from lithoform.statistics.samples import check_level, generators, varied_pair

__all__ = ["ESTIMATES", "Estimate", "bootstrap_estimates", "cliff_delta", "cohen_d", "hedges_g", "superiority"]

ESTIMATES: Final = (
    "mean_difference",
    "cohen_d",
    "hedges_g",
    "superiority",
    "cliff_delta",
    "percentile_5_difference",
    "percentile_95_difference",
)

_BLOCK: Final = 1 << 17  # numbers in a block of replicates, 1 MB of float64


@dataclass(frozen=True)
class Estimate:
    """An estimate with its bootstrap interval.

    Attributes
    ----------
    name : str
        One of `ESTIMATES`.
    value : float
        Of the samples themselves; differences are of the first less the second.
    low, high : float
        Ends of the interval; infinite where replicates without any variation decide an end of a standardised effect.
    level : float
        Confidence level.
    """

    name: str
    value: float
    low: float
    high: float
    level: float


def cohen_d(a: ArrayLike, b: ArrayLike) -> float:
    """Difference of the means over the pooled standard deviation, first less second (Cohen 1988).

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit.

    Raises
    ------
    SampleError
        If a sample has fewer than two values, is not finite or does not vary.
    """
    x, y = varied_pair(a, b)
    return float(_standardised(*_moments(x[None]), *_moments(y[None]), len(x), len(y))[0])


def hedges_g(a: ArrayLike, b: ArrayLike) -> float:
    """Cohen's d without its small-sample bias (Hedges 1981); arguments and errors are those of `cohen_d`."""
    return cohen_d(a, b) * _small_sample_factor(np.size(a) + np.size(b) - 2)


def superiority(a: ArrayLike, b: ArrayLike) -> float:
    """Chance that a value of the first sample is above one of the second, ties half: the U of Mann and Whitney / nm.

    Arguments and errors are those of `cohen_d`.
    """
    x, y = varied_pair(a, b)
    x, y = np.sort(x), np.sort(y)
    below = np.searchsorted(y, x, side="left") + np.searchsorted(y, x, side="right")
    return float(below.sum()) / (2.0 * len(x) * len(y))


def cliff_delta(a: ArrayLike, b: ArrayLike) -> float:
    """Chance of above less chance of below, -1 to 1 (Cliff 1993); arguments and errors are those of `cohen_d`."""
    return 2.0 * superiority(a, b) - 1.0


def bootstrap_estimates(
    a: ArrayLike, b: ArrayLike, *, seed: int, bootstrap: int = 2000, level: float = 0.95
) -> tuple[Estimate, ...]:
    """Effect sizes and differences of the 5th and 95th percentiles, each with its bootstrap interval.

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit; the reference (the scans) first.
    seed : int
        From 0; the same seed gives the same bytes.
    bootstrap : int
        Number of replicates.
    level : float
        Confidence level.

    Returns
    -------
    tuple of Estimate
        In the order of `ESTIMATES`.  Percentiles are interpolated between values (Hyndman and Fan's type 7).  In
        simulations with normal samples of 50 to 600, intervals at 0.95 hold the truth in 94.5 to 97 % of cases.

    Raises
    ------
    SampleError
        If a sample has fewer than two values, is not finite or does not vary, or an option is out of range.

    References
    ----------
    Efron, B. and Tibshirani, R. J. (1993). An Introduction to the Bootstrap. Chapman and Hall, chapter 13.
    """
    x, y = (np.sort(one) for one in varied_pair(a, b))
    level = check_level(level)
    left, right = generators(seed, 2, bootstrap=bootstrap)
    # About the pooled mean, so that sums of squares lose no digits to a large mean.
    centre = float(np.concatenate([x, y]).mean())
    x, y = x - centre, y - centre
    sides = np.searchsorted(y, x, side="left"), np.searchsorted(y, x, side="right")
    observed = _evaluate(x, y, sides, np.arange(len(x))[None], np.arange(len(y))[None])[:, 0]
    rows = max(1, _BLOCK // max(len(x), len(y)))
    blocks = []
    for start in range(0, bootstrap, rows):
        count = min(rows, bootstrap - start)
        blocks.append(_evaluate(x, y, sides, _draw(left, count, len(x)), _draw(right, count, len(y))))
    drawn = np.sort(np.concatenate(blocks, axis=1), axis=1)
    # Order statistics as they are: replicates may be infinite, and are then not to be interpolated.
    low = math.floor((bootstrap - 1) * (0.5 - 0.5 * level))
    return tuple(
        Estimate(name, float(value), float(row[low]), float(row[bootstrap - 1 - low]), level)
        for name, value, row in zip(ESTIMATES, observed, drawn, strict=True)
    )


def _draw(generator: np.random.Generator, count: int, size: int) -> np.ndarray:
    """Ranks of the values of replicates, each row rising, shape (count, size)."""
    # 16-bit whole numbers are sorted by their digits, which is fastest.
    kind = np.uint16 if size <= 1 << 16 else np.uint32
    drawn = generator.integers(0, size, (count, size), dtype=kind)
    drawn.sort(axis=1, kind="stable")
    return drawn


def _evaluate(
    x: np.ndarray, y: np.ndarray, sides: tuple[np.ndarray, np.ndarray], drawn_x: np.ndarray, drawn_y: np.ndarray
) -> np.ndarray:
    """Estimates, shape (number of ESTIMATES, rows), of replicates given by ranks into the sorted samples."""
    n, m = len(x), len(y)
    u, v = x[drawn_x], y[drawn_y]
    moments = *_moments(u), *_moments(v)
    d = _standardised(*moments, n, m)
    # Number of the second replicate's values below, and not above, each of the first sample's values.
    rows = len(drawn_y)
    shifted = drawn_y.astype(np.int64) + np.arange(rows)[:, None] * m
    cumulative = np.zeros((rows, m + 1), dtype=np.int64)
    np.cumsum(np.bincount(shifted.ravel(), minlength=rows * m).reshape(rows, m), axis=1, out=cumulative[:, 1:])
    below = np.take(cumulative, sides[0], axis=1) + np.take(cumulative, sides[1], axis=1)
    wins = np.take_along_axis(below, drawn_x.astype(np.int64), axis=1).sum(axis=1) / (2.0 * n * m)
    tails = _ranked(u), _ranked(v)
    return np.stack([
        moments[0] - moments[2],
        d,
        d * _small_sample_factor(n + m - 2),
        wins,
        2.0 * wins - 1.0,
        *(first - second for first, second in zip(*tails, strict=True)),
    ])  # fmt: skip


def _ranked(rows: np.ndarray) -> list[np.ndarray]:
    """Percentiles of `TAILS` of rows that rise, interpolated."""
    size, found = rows.shape[1], []
    for level in TAILS:
        rank = (size - 1) * level
        low = int(rank)
        lower, upper = rows[:, low], rows[:, min(low + 1, size - 1)]
        found.append(lower + (rank - low) * (upper - lower))
    return found


def _moments(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sum of squares about it of each row; the squares of a row without variation are 0 to the bit."""
    # About the first value: the mean of equal values is rounded, and need not be one of them.
    first = rows[:, 0]
    away = rows - first[:, None]
    shift = away.mean(axis=1)
    away -= shift[:, None]
    return first + shift, np.einsum("ij,ij->i", away, away)


def _standardised(
    mean_a: np.ndarray, squares_a: np.ndarray, mean_b: np.ndarray, squares_b: np.ndarray, n: int, m: int
) -> np.ndarray:
    deviation = np.sqrt((squares_a + squares_b) / (n + m - 2))
    difference = mean_a - mean_b
    with np.errstate(divide="ignore", invalid="ignore"):
        d = difference / deviation
    return np.where(difference == 0.0, 0.0, d)


def _small_sample_factor(freedom: int) -> float:
    """Hedges' exact J = Gamma(f/2) / (sqrt(f/2) Gamma((f-1)/2))."""
    return math.exp(math.lgamma(0.5 * freedom) - math.lgamma(0.5 * (freedom - 1))) / math.sqrt(0.5 * freedom)
