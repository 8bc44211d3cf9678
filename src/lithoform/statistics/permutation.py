"""Every index of two samples with its noise floor and its p-value, by permutation of the pooled sample.

If both samples are of one population, every way of dealing the pooled values to the two is equally likely, so that the
values an index takes over random deals are what it scores by chance alone: its noise floor.  All indices are read from
one array, the number of the first sample's values among the k least of the pooled sample, for all k, so that one
sorting serves all permutations and all indices.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.statistics.distances import distances_of_steps
from lithoform.statistics.histograms import (
    PSEUDO_COUNT,
    bhattacharyya,
    bin_edges,
    jensen_shannon,
    kullback_leibler,
)
from lithoform.statistics.samples import generators, stratum_codes, varied_pair

__all__ = ["INDICES", "TAILS", "IndexTest", "deals", "p_value", "permutation_tests"]

TAILS: Final = (0.05, 0.95)

INDICES: Final = (
    "bhattacharyya",
    "kullback_leibler",
    "jensen_shannon",
    "wasserstein",
    "kolmogorov_smirnov",
    "energy_distance",
    "mean_difference",
    "deviation_difference",
    "percentile_5_difference",
    "percentile_95_difference",
)

# Small for two samples that differ; of all the others, the size is large.
_SIMILARITIES: Final = frozenset({"bhattacharyya"})

# Numbers in a block of permutations: 1 MB of float64, which stays in a core's cache.
_BLOCK: Final = 1 << 17

# Values as close as this part of the observed one count as equal to it: they differ by rounding alone.
_ROUNDING: Final = 1e-10


@dataclass(frozen=True)
class IndexTest:
    """An index of two samples beside what it scores by chance.

    Attributes
    ----------
    name : str
        One of `INDICES`.
    value : float
        Observed; differences are of the first less the second sample.
    floor_mean : float
        Mean size of the index over permutations: what two samples of one population score.
    floor_limit : float
        What only 5 % of the permutations pass: the 95 % quantile of the size, of a similarity the 5 % quantile.
    p : float
        (1 + number of permutations at least as far) / (1 + permutations), two-sided for differences.
    """

    name: str
    value: float
    floor_mean: float
    floor_limit: float
    p: float


def permutation_tests(
    a: ArrayLike,
    b: ArrayLike,
    *,
    seed: int,
    permutations: int = 2000,
    bins: int | None = None,
    pseudo_count: float = PSEUDO_COUNT,
    strata: tuple[Sequence[str], Sequence[str]] | None = None,
) -> tuple[IndexTest, ...]:
    """Test every index of two samples in one pass.

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit; the reference (the scans) first.
    seed : int
        From 0; the same seed gives the same bytes.
    permutations : int
        Number of random deals of the pooled values.
    bins : int, optional
        A fixed number of bins; by default the rule of `lithoform.statistics.histograms.bin_edges`.
    pseudo_count : float
        For the Kullback-Leibler divergence; see `lithoform.statistics.histograms.kullback_leibler`.
    strata : tuple of two sequences of str, lengths n and m, optional
        The class of each value; values are then dealt within their class only.  Needed where the numbers of each class
        were chosen and not drawn: free deals would add the scatter of the classes to the floor and hide differences.

    Returns
    -------
    tuple of IndexTest
        In the order of `INDICES`.  The tests of the deviation and of the percentiles ask, as all permutation tests do,
        whether the populations are the same; a shift of the mean alone can make a percentile's p small.

    Raises
    ------
    SampleError
        If a sample has fewer than two values, is not finite or does not vary, or an option is out of range.

    References
    ----------
    Phipson, B. and Smyth, G. K. (2010). Permutation p-values should never be zero. Stat. Appl. Genet. Mol. Biol. 9, 39.
    """
    x, y = varied_pair(a, b)
    (generator,) = generators(seed, 1, permutations=permutations)
    codes = stratum_codes(strata, len(x), len(y))
    order = _PooledOrder(x, y, bins, pseudo_count)
    codes = None if codes is None else codes[order.order]
    observed = order.evaluate(order.labels[None])[0]
    blocks = [order.evaluate(labels) for labels in deals(order.labels, permutations, generator, codes)]
    return tuple(
        _tested(name, float(value), drawn)
        for name, value, drawn in zip(INDICES, observed, np.concatenate(blocks).T, strict=True)
    )


def deals(
    labels: np.ndarray, permutations: int, generator: np.random.Generator, codes: np.ndarray | None = None
) -> Iterator[np.ndarray]:
    """Yield blocks of random permutations of labels, each of shape (rows, N), in rows that fit a core's cache.

    Parameters
    ----------
    labels : numpy.ndarray of bool, shape (N,)
    permutations : int
    generator : numpy.random.Generator
    codes : numpy.ndarray of int, shape (N,), optional
        Labels change places only with labels of the same code.
    """
    groups = [] if codes is None else [np.flatnonzero(codes == code) for code in range(int(codes.max()) + 1)]
    rows = max(1, _BLOCK // len(labels))
    for start in range(0, permutations, rows):
        block = np.tile(labels, (min(rows, permutations - start), 1))
        if codes is None:
            generator.permuted(block, axis=1, out=block)
        for group in groups:
            block[:, group] = generator.permuted(block[:, group], axis=1)
        yield block


def p_value(observed: float, drawn: np.ndarray) -> float:
    """Permutation p-value of a size that is large where samples differ, with the +1 of Phipson and Smyth (2010).

    Parameters
    ----------
    observed : float
    drawn : numpy.ndarray, shape (permutations,)
        Draws equal to the observed size but for rounding count as reaching it.
    """
    reached = np.count_nonzero(drawn >= observed - _ROUNDING * abs(observed))
    return (1 + int(reached)) / (1 + len(drawn))


def _tested(name: str, value: float, drawn: np.ndarray) -> IndexTest:
    sign = -1.0 if name in _SIMILARITIES else 1.0
    far = sign * np.abs(drawn)
    limit = sign * float(np.quantile(far, 0.95))
    return IndexTest(name, value, sign * float(far.mean()), limit, p_value(sign * abs(value), far))


class _PooledOrder:
    """The pooled sample in rising order, and the indices of any dealing of it.

    Parameters
    ----------
    x, y : numpy.ndarray, shape (n,) and (m,)
    bins, pseudo_count
        As of `permutation_tests`.

    Attributes
    ----------
    order : numpy.ndarray of int, shape (N,)
        Places of the pooled values, in rising order, in the first sample followed by the second.
    labels : numpy.ndarray of bool, shape (N,)
        Which of the pooled values, in rising order, are of the first sample.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray, bins: int | None, pseudo_count: float) -> None:
        pooled = np.concatenate([x, y])
        order = np.argsort(pooled, kind="stable")
        self.order = order
        self.labels = order < len(x)
        self.sizes = (len(x), len(y))
        self.pseudo_count = pseudo_count
        self.values = pooled[order]
        centred = self.values - pooled.mean()
        self.square_sum = float((centred**2).sum())
        # The distribution functions step where one value ends and the next, greater one begins.
        self.steps = np.flatnonzero(np.diff(self.values) > 0.0)
        self.gaps = np.diff(self.values)[self.steps]
        self.square_gaps = np.diff(centred**2)[self.steps]
        edges = bin_edges(pooled, bins=bins)
        self.cuts = np.searchsorted(self.values, edges[1:-1], side="left")

    def evaluate(self, labels: np.ndarray) -> np.ndarray:
        """Return the indices of each row of labels, shape (rows, number of INDICES)."""
        n, m = self.sizes
        total = n + m
        below = np.cumsum(labels, axis=1, dtype=np.float64)
        first, second = self._bin_counts(below)
        below = below if len(self.steps) == total - 1 else np.take(below, self.steps, axis=1)
        # F - G = (total below - n rank) / (n m): whole numbers, so that equal steps are equal bit for bit.
        excess = below[:, : len(self.steps)] * float(total)
        excess -= (self.steps + 1.0) * n
        excess /= float(n) * m
        # The integral of F - G is the difference of the means, the other way round; that of 2 x (F - G) likewise.
        mean = -np.einsum("ij,j->i", excess, self.gaps)
        square = -np.einsum("ij,j->i", excess, self.square_gaps)
        table = [
            bhattacharyya(first, second),
            kullback_leibler(first, second, pseudo_count=self.pseudo_count),
            jensen_shannon(first, second),
            *distances_of_steps(excess, self.gaps),
            mean,
            self._deviation_difference(mean, square),
            *self._percentile_differences(labels),
        ]
        return np.stack(table, axis=1)

    def _bin_counts(self, below: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n, m = self.sizes
        cumulative = np.zeros((len(below), len(self.cuts) + 2))
        # A cut at 0 has nothing below it; np.take would read the last column there.
        used = self.cuts > 0
        cumulative[:, 1:-1][:, used] = np.take(below, self.cuts[used] - 1, axis=1)
        cumulative[:, -1] = n
        first = np.diff(cumulative, axis=1)
        return first, np.diff(self.cuts, prepend=0, append=n + m) - first

    def _deviation_difference(self, mean: np.ndarray, square: np.ndarray) -> np.ndarray:
        n, m = self.sizes
        # Means and mean squares about the pooled mean follow from their differences and their pooled sums.
        mean_a, mean_b = mean * (m / (n + m)), -mean * (n / (n + m))
        square_a, square_b = ((self.square_sum + m * square) / (n + m), (self.square_sum - n * square) / (n + m))
        variance_a = np.maximum(square_a - mean_a**2, 0.0) * (n / (n - 1))
        variance_b = np.maximum(square_b - mean_b**2, 0.0) * (m / (m - 1))
        return np.sqrt(variance_a) - np.sqrt(variance_b)

    def _percentile_differences(self, labels: np.ndarray) -> list[np.ndarray]:
        places = [np.flatnonzero(side) for side in (labels, ~labels)]
        offset = np.arange(len(labels)) * labels.shape[1]
        found = []
        for level in TAILS:
            pair = []
            for place, size in zip(places, self.sizes, strict=True):
                rank = (size - 1) * level
                low = int(rank)
                ranks = place.reshape(len(labels), size)
                lower = self.values[ranks[:, low] - offset]
                upper = self.values[ranks[:, min(low + 1, size - 1)] - offset]
                pair.append(lower + (rank - low) * (upper - lower))
            found.append(pair[0] - pair[1])
        return found
