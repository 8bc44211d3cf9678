"""Histograms of two samples on common bins, and the paper's three indices of them (eq. 23-26).

The indices are sums over bins, natural logarithms, in nats where they have a unit.  What a value means depends on the
bins and on the sample sizes: with K bins and samples of n and m from one population, 1 - BC and JS are both about
(K - 1)/8 (1/n + 1/m), not 0.  `lithoform.statistics.comparison` therefore gives each beside its noise floor.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError
from lithoform.statistics.samples import as_sample, check_varied

__all__ = [
    "FEWEST_BINS",
    "MOST_BINS",
    "PSEUDO_COUNT",
    "bhattacharyya",
    "bin_edges",
    "counts",
    "jensen_shannon",
    "kullback_leibler",
]

FEWEST_BINS: Final = 5
MOST_BINS: Final = 40

# Added to every bin of both histograms before the Kullback-Leibler divergence, which is infinite where the second
# histogram has an empty bin and the first has not: half a count, the prior of Jeffreys (1946) for a multinomial.
PSEUDO_COUNT: Final = 0.5


def bin_edges(pooled: ArrayLike, *, bins: int | None = None) -> np.ndarray:
    """Edges of equal bins from the least to the greatest value of a pooled sample.

    The rule is that of Freedman and Diaconis, a width of 2 IQR / N^(1/3), the number of bins rounded up and kept
    within 5 to 40.  Where half of the values are alike, so that the interquartile range is 0, the width is Scott's
    3.49 s / N^(1/3).  The rule sees the pooled sample only, so bins are the same under every permutation of it.

    Parameters
    ----------
    pooled : array_like, shape (n,)
        All values of both samples, in one unit.
    bins : int, optional
        A fixed number of bins in place of the rule.

    Returns
    -------
    numpy.ndarray, shape (k + 1,)
        Rising edges, in the unit of the values.

    Raises
    ------
    SampleError
        If the values are all alike or not finite, or the number of bins is below 1.

    References
    ----------
    Freedman, D. and Diaconis, P. (1981). On the histogram as a density estimator. Z. Wahrscheinlichkeitstheorie 57.
    Scott, D. W. (1979). On optimal and data-based histograms. Biometrika 66, 605-610.
    """
    values = as_sample(pooled, "the pooled sample", least=2)
    check_varied(values, "the pooled sample")
    low, high = float(values.min()), float(values.max())
    if bins is None:
        lower, upper = np.quantile(values, [0.25, 0.75])
        width = 2.0 * float(upper - lower) or 3.49 * float(values.std(ddof=1))
        number = math.ceil((high - low) / width * len(values) ** (1.0 / 3.0))
        number = min(max(number, FEWEST_BINS), MOST_BINS)
    elif isinstance(bins, bool) or not isinstance(bins, int | np.integer) or bins < 1:
        raise SampleError(f"expected a whole number of bins, 1 or more, got {bins!r}; or leave it to the rule.")
    else:
        number = int(bins)
    return np.linspace(low, high, number + 1)


def counts(values: ArrayLike, edges: np.ndarray) -> np.ndarray:
    """Number of values in each bin; the last bin holds its upper edge, the others do not.

    Parameters
    ----------
    values : array_like, shape (n,)
    edges : numpy.ndarray, shape (k + 1,)
        Rising, in the unit of the values; values outside are counted in the outermost bins.

    Returns
    -------
    numpy.ndarray of float64, shape (k,)
    """
    position = np.searchsorted(np.sort(as_sample(values)), edges[1:-1], side="left")
    return np.diff(position, prepend=0, append=np.size(values)).astype(np.float64)


def bhattacharyya(p: ArrayLike, q: ArrayLike) -> np.ndarray:
    """Bhattacharyya coefficient, the sum of sqrt(P Q) over bins (eq. 23): 1 for equal histograms, 0 for disjoint.

    Parameters
    ----------
    p, q : array_like, shape (..., k)
        Counts or probabilities of the same k bins; each is divided by its own sum.

    Returns
    -------
    numpy.ndarray, shape (...)

    Raises
    ------
    SampleError
        If the bins differ in number, or a histogram is empty or has a negative or non-finite bin.

    References
    ----------
    Bhattacharyya, A. (1946). On a measure of divergence between two multinomial populations. Sankhya 7, 401-406.
    """
    p, q = _masses(p, q)
    return np.minimum(np.sqrt(p * q).sum(axis=-1), 1.0)


def kullback_leibler(p: ArrayLike, q: ArrayLike, *, pseudo_count: float = PSEUDO_COUNT) -> np.ndarray:
    """Kullback-Leibler divergence D(P || Q), the sum of P ln(P / Q) over bins (eq. 24) [nat].

    Parameters
    ----------
    p, q : array_like, shape (..., k)
        Counts of the same k bins.  P is the reference (the scans), Q what approximates it.
    pseudo_count : float
        Added to every bin of both before they are divided by their sums, so that the divergence is finite.  With 0,
        as for known probabilities, it is infinite where Q has an empty bin and P has not.

    Returns
    -------
    numpy.ndarray, shape (...)

    Raises
    ------
    SampleError
        As `bhattacharyya`, and if the pseudo-count is negative or not finite.

    References
    ----------
    Kullback, S. and Leibler, R. A. (1951). On information and sufficiency. Ann. Math. Stat. 22, 79-86.
    """
    if not 0.0 <= pseudo_count < math.inf:
        raise SampleError(f"expected a pseudo-count from 0, finite, got {pseudo_count}; 0.5 is the default.")
    return np.maximum(_relative_entropy(*_masses(p, q, float(pseudo_count))), 0.0)


def jensen_shannon(p: ArrayLike, q: ArrayLike) -> np.ndarray:
    """Jensen-Shannon divergence, half D(P || M) and half D(Q || M) with M = (P + Q) / 2 (eq. 25, 26) [nat].

    It lies from 0 to ln 2, and from (1 - BC) ln 2 to 1 - BC.

    Parameters
    ----------
    p, q : array_like, shape (..., k)
        Counts or probabilities of the same k bins; each is divided by its own sum.  Empty bins need no care.

    Returns
    -------
    numpy.ndarray, shape (...)

    Raises
    ------
    SampleError
        As `bhattacharyya`.

    References
    ----------
    Lin, J. (1991). Divergence measures based on the Shannon entropy. IEEE Trans. Inf. Theory 37, 145-151.
    """
    p, q = _masses(p, q)
    m = 0.5 * (p + q)
    return np.maximum(0.5 * (_relative_entropy(p, m) + _relative_entropy(q, m)), 0.0)


def _masses(p: ArrayLike, q: ArrayLike, pseudo_count: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    pair = [np.asarray(p, dtype=np.float64), np.asarray(q, dtype=np.float64)]
    if pair[0].ndim == 0 or pair[0].shape[-1:] != pair[1].shape[-1:]:
        raise SampleError(f"expected two histograms of the same bins, got shapes {pair[0].shape} and {pair[1].shape}.")
    for i, one in enumerate(pair):
        one = one + pseudo_count
        total = one.sum(axis=-1, keepdims=True)
        if not (np.isfinite(one).all() and (one >= 0.0).all() and (total > 0.0).all()):
            raise SampleError(
                "expected histograms of finite bins from 0 up, not all of them 0; count the values with these bins."
            )
        pair[i] = one / total
    return pair[0], pair[1]


def _relative_entropy(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    used = p > 0.0
    ratio = np.ones(np.broadcast_shapes(p.shape, q.shape))
    with np.errstate(divide="ignore"):
        np.divide(p, q, out=ratio, where=used)
    return (p * np.log(ratio)).sum(axis=-1)
