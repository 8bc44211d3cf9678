"""Tests of whether two tables of particles are of one population, all descriptors at once.

Margins can agree while the joint distribution does not, as where roundness goes with boxiness in the scans and not in
the generated particles.  Both statistics here see that: they are 0 in the limit only where the joint distributions are
the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError
from lithoform.statistics.permutation import deals, p_value
from lithoform.statistics.samples import as_table, generators, stratum_codes

__all__ = ["JointTest", "joint_energy_test", "joint_mmd_test"]

Strata = tuple[Sequence[str], Sequence[str]]

# Bits of a float64's whole numbers: sums of pairs are kept below 2 to this power.
_EXACT_BITS: Final = 53


@dataclass(frozen=True)
class JointTest:
    """A permutation test on several descriptors together.

    Attributes
    ----------
    statistic : {"energy_distance", "maximum_mean_discrepancy"}
        What was measured.
    value : float
        Observed, from 0, without unit.
    floor_mean : float
        Mean over permutations: what two samples of one population score.
    floor_limit : float
        The 95 % quantile over permutations.
    p : float
        (1 + number of permutations that reach the value) / (1 + permutations).
    scale : float
        Length of the Gaussian kernel in pooled standard deviations; nan for the energy distance, which has none.
    """

    statistic: Literal["energy_distance", "maximum_mean_discrepancy"]
    value: float
    floor_mean: float
    floor_limit: float
    p: float
    scale: float


def joint_energy_test(
    a: ArrayLike, b: ArrayLike, *, seed: int, permutations: int = 2000, strata: Strata | None = None
) -> JointTest:
    """Energy test: root of 2 E|X - Y| - E|X - X'| - E|Y - Y'| with descriptors over their pooled standard deviation.

    Parameters
    ----------
    a, b : array_like, shape (n, d) and (m, d)
        Particles by descriptors, the same columns in both, each in its own unit.
    seed : int
        From 0; the same seed gives the same bytes, whatever the number of threads.
    permutations : int
        Number of random deals of the pooled rows.
    strata : tuple of two sequences of str, lengths n and m, optional
        The class of each particle; see `lithoform.statistics.permutation.permutation_tests`.

    Returns
    -------
    JointTest
        With one descriptor the value is `lithoform.statistics.distances.energy_distance` of the standardised values.
        Distances are rounded to about 2^-32 of the greatest (N about 1,200), so that sums of them are exact.

    Raises
    ------
    SampleError
        If a table has fewer than 2 rows or anything not finite, the columns differ in number, a column does not
        vary, or an option is out of range.

    References
    ----------
    Szekely, G. J. and Rizzo, M. L. (2004). Testing for equal distributions in high dimension. InterStat, November.
    """
    squares, n = _squared_distances(a, b)
    return _test("energy_distance", np.sqrt(squares), n, -1.0, math.nan, seed, permutations, strata)


def joint_mmd_test(
    a: ArrayLike,
    b: ArrayLike,
    *,
    seed: int,
    permutations: int = 2000,
    scale: float | None = None,
    strata: Strata | None = None,
) -> JointTest:
    """Kernel test: maximum mean discrepancy under k = exp(-r^2 / (2 h^2)), descriptors over their pooled deviation.

    Parameters
    ----------
    a, b, seed, permutations, strata
        As of `joint_energy_test`.
    scale : float, optional
        h in pooled standard deviations, above 0; by default the median distance between two particles of the pooled
        sample, which permutations do not change, or where that is 0 the median of the distances above 0.

    Returns
    -------
    JointTest
        The root of the biased estimate E k(X, X') + E k(Y, Y') - 2 E k(X, Y).

    Raises
    ------
    SampleError
        As `joint_energy_test`, and where the scale is not above 0.

    References
    ----------
    Gretton, A. et al. (2012). A kernel two-sample test. J. Mach. Learn. Res. 13, 723-773.
    """
    squares, n = _squared_distances(a, b)
    if scale is None:
        distances = np.sqrt(squares[np.triu_indices(len(squares), 1)])
        # Where most particles are alike, the median distance is 0 and says nothing of those that are not.
        scale = float(np.median(distances)) or float(np.median(distances[distances > 0.0]))
    if not 0.0 < scale < math.inf:
        raise SampleError(f"expected a kernel scale above 0, got {scale}; pass one, in pooled standard deviations.")
    kernel = np.exp(squares * (-0.5 / (scale * scale)))
    return _test("maximum_mean_discrepancy", kernel, n, 1.0, float(scale), seed, permutations, strata)


def _squared_distances(a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray, int]:
    """Squared distances between all rows of both tables, standardised, shape (N, N), and the first table's rows."""
    x, y = as_table(a, "the first table"), as_table(b, "the second table")
    if x.shape[1] != y.shape[1]:
        raise SampleError(f"expected the same descriptors in both tables, got {x.shape[1]} and {y.shape[1]} columns.")
    pooled = np.concatenate([x, y])
    for i, column in enumerate(pooled.T):
        if column.min() == column.max():
            raise SampleError(f"expected descriptors that vary, got column {i} all {column[0]:g}; leave it out.")
    pooled = (pooled - pooled.mean(axis=0)) / pooled.std(axis=0, ddof=1)
    squares = np.zeros((len(pooled), len(pooled)))
    for column in pooled.T:
        away = column[:, None] - column
        squares += away * away
    return squares, len(x)


def _test(
    statistic: Literal["energy_distance", "maximum_mean_discrepancy"],
    pairs: np.ndarray,
    n: int,
    sign: float,
    scale: float,
    seed: int,
    permutations: int,
    strata: Strata | None,
) -> JointTest:
    (generator,) = generators(seed, 1, permutations=permutations)
    total = len(pairs)
    codes = stratum_codes(strata, n, total - n)
    # Fixed point: whole numbers whose sums over all pairs stay below 2^53 add up exactly in any order, so the matrix
    # product below gives the same bytes with any number of threads.
    unit = 2.0 ** (math.floor(_EXACT_BITS - 2.0 * math.log2(total)) - math.ceil(math.log2(float(pairs.max()))))
    whole = np.rint(pairs * unit)
    rows, everything = whole.sum(axis=1), whole.sum()

    def sizes(labels: np.ndarray) -> np.ndarray:
        first = labels.astype(np.float64)
        from_first = (first * rows).sum(axis=1)
        inside = np.einsum("ij,ij->i", first @ whole, first)
        across = from_first - inside
        outside = everything - from_first - across
        m = total - n
        squared = sign * (inside / (n * n) + outside / (m * m) - 2.0 * across / (n * m)) / unit
        return np.sqrt(np.maximum(squared, 0.0))

    labels = np.arange(total) < n
    value = float(sizes(labels[None])[0])
    drawn = np.concatenate([sizes(block) for block in deals(labels, permutations, generator, codes)])
    limit = float(np.quantile(drawn, 0.95))
    return JointTest(statistic, value, float(drawn.mean()), limit, p_value(value, drawn), scale)
