"""Distances between the distribution functions of two samples: no bins, so nothing to choose.

All three are read from F - G, the difference of the two empirical distribution functions, a step function that changes
at the values of the pooled sample only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lithoform.statistics.samples import as_sample

__all__ = ["distances_of_steps", "energy_distance", "kolmogorov_smirnov", "wasserstein"]


def wasserstein(a: ArrayLike, b: ArrayLike) -> float:
    """First Wasserstein (earth mover's) distance, the integral of |F - G|.

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit.

    Returns
    -------
    float
        In the unit of the samples: how far, on average, a particle's value has to move.

    Raises
    ------
    SampleError
        If a sample is empty or not finite.

    References
    ----------
    Vallender, S. S. (1974). Calculation of the Wasserstein distance between probability distributions on the line.
    """
    return float(distances_of_steps(*_steps(a, b))[0])


def kolmogorov_smirnov(a: ArrayLike, b: ArrayLike) -> float:
    """Kolmogorov-Smirnov distance, the greatest |F - G|, 0 to 1; arguments and errors are those of `wasserstein`."""
    return float(distances_of_steps(*_steps(a, b))[1])


def energy_distance(a: ArrayLike, b: ArrayLike) -> float:
    """Energy distance, the root of 2 times the integral of (F - G)^2.

    Its square is 2 E|X - Y| - E|X - X'| - E|Y - Y'|, the one-dimensional case of what `lithoform.statistics.joint`
    tests; arguments and errors are those of `wasserstein`.

    Returns
    -------
    float
        In the square root of the samples' unit.

    References
    ----------
    Szekely, G. J. and Rizzo, M. L. (2013). Energy statistics: a class of statistics based on distances. J. Stat. Plan.
    Inference 143, 1249-1272.
    """
    return float(distances_of_steps(*_steps(a, b))[2])


def distances_of_steps(excess: np.ndarray, gaps: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The three distances of F - G given as steps.

    Parameters
    ----------
    excess : numpy.ndarray, shape (..., k)
        F - G on each of k intervals.
    gaps : numpy.ndarray, shape (k,)
        Lengths of the intervals, above 0, in the unit of the samples.

    Returns
    -------
    tuple of numpy.ndarray, each of shape (...)
        Wasserstein, Kolmogorov-Smirnov and energy distance.
    """
    # einsum sums in its own fixed order; a matrix product may round differently with the number of threads.
    size = np.abs(excess)
    first = np.einsum("...k,k->...", size, gaps)
    greatest = size.max(axis=-1, initial=0.0)
    np.multiply(size, size, out=size)
    return first, greatest, np.sqrt(2.0 * np.einsum("...k,k->...", size, gaps))


def _steps(a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.sort(as_sample(a, "the first sample")), np.sort(as_sample(b, "the second sample"))
    values = np.unique(np.concatenate([x, y]))
    below_x = np.searchsorted(x, values[:-1], side="right")
    below_y = np.searchsorted(y, values[:-1], side="right")
    # Whole numbers over one denominator: equal differences are equal bit for bit.
    return (below_x * len(y) - below_y * len(x)) / (len(x) * len(y)), np.diff(values)
