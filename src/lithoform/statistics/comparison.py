"""Everything that is said of two populations: one descriptor, all of them together, and by class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError
from lithoform.statistics.anova import Anova, anova
from lithoform.statistics.histograms import PSEUDO_COUNT, bin_edges, counts
from lithoform.statistics.joint import JointTest, joint_energy_test, joint_mmd_test
from lithoform.statistics.multiplicity import holm
from lithoform.statistics.permutation import INDICES, IndexTest, permutation_tests
from lithoform.statistics.resampling import ESTIMATES, Estimate, bootstrap_estimates
from lithoform.statistics.samples import as_table, generators, varied_pair

__all__ = [
    "ClassComparison",
    "JointComparison",
    "PopulationComparison",
    "SampleComparison",
    "compare_joint",
    "compare_populations",
    "compare_samples",
]


@dataclass(frozen=True, eq=False)
class SampleComparison:
    """Two samples of one descriptor compared; differences are of the first less the second.

    Attributes
    ----------
    sizes : tuple of int
        Numbers of values.
    means, deviations : tuple of float
        Means and sample standard deviations (n - 1), in the unit of the values.
    anova : Anova
        One-way analysis of variance.
    indices : tuple of IndexTest
        In the order of `lithoform.statistics.permutation.INDICES`, each with noise floor and p-value.
    estimates : tuple of Estimate
        In the order of `lithoform.statistics.resampling.ESTIMATES`, each with its bootstrap interval.
    edges : numpy.ndarray, shape (k + 1,)
        Bin edges of the histogram indices, in the unit of the values.
    counts : numpy.ndarray, shape (2, k)
        The two histograms.
    """

    sizes: tuple[int, int]
    means: tuple[float, float]
    deviations: tuple[float, float]
    anova: Anova
    indices: tuple[IndexTest, ...]
    estimates: tuple[Estimate, ...]
    edges: np.ndarray
    counts: np.ndarray

    def index(self, name: str) -> IndexTest:
        """Return the index of that name; a SampleError lists the names where there is none."""
        return _named(self.indices, name, INDICES)

    def estimate(self, name: str) -> Estimate:
        """Return the estimate of that name; a SampleError lists the names where there is none."""
        return _named(self.estimates, name, ESTIMATES)


@dataclass(frozen=True)
class JointComparison:
    """Two tables of particles compared on all their descriptors together.

    Attributes
    ----------
    energy : JointTest
        Energy test.
    mmd : JointTest
        Kernel test (maximum mean discrepancy, Gaussian kernel at the median distance).
    """

    energy: JointTest
    mmd: JointTest


@dataclass(frozen=True, eq=False)
class ClassComparison:
    """Two populations compared within one class, or pooled over all.

    Attributes
    ----------
    name : str or None
        The class; None for all particles pooled.
    descriptors : tuple of SampleComparison
        In the order of the columns.
    joint : JointComparison
        All descriptors together.
    """

    name: str | None
    descriptors: tuple[SampleComparison, ...]
    joint: JointComparison


@dataclass(frozen=True, eq=False)
class PopulationComparison:
    """Two populations compared descriptor by descriptor and jointly, pooled and by class.

    Attributes
    ----------
    names : tuple of str
        Descriptors, in the order of the columns.
    pooled : ClassComparison
        All particles.
    classes : tuple of ClassComparison
        In alphabetical order; empty where no classes were given.
    """

    names: tuple[str, ...]
    pooled: ClassComparison
    classes: tuple[ClassComparison, ...]

    def adjusted(self, index: str = "energy_distance") -> np.ndarray:
        """P-values of one index and of the joint energy tests over all groups, adjusted together by Holm's method.

        Parameters
        ----------
        index : str
            One of `lithoform.statistics.permutation.INDICES`.

        Returns
        -------
        numpy.ndarray, shape (1 + classes, descriptors + 1)
            The pooled particles in the first row, the joint tests in the last column.  A single descriptor is all that
            its joint test sees: it is adjusted for once, and its p stands in both columns.
        """
        groups = (self.pooled, *self.classes)
        p = np.array([
            [*(one.index(index).p for one in group.descriptors), group.joint.energy.p] for group in groups
        ])  # fmt: skip
        if len(self.names) == 1:
            return np.repeat(holm(p[:, 0])[:, None], 2, axis=1)
        return holm(p.ravel()).reshape(p.shape)


def compare_samples(
    a: ArrayLike,
    b: ArrayLike,
    *,
    seed: int,
    permutations: int = 2000,
    bootstrap: int = 2000,
    level: float = 0.95,
    bins: int | None = None,
    pseudo_count: float = PSEUDO_COUNT,
    strata: tuple[Sequence[str], Sequence[str]] | None = None,
) -> SampleComparison:
    """Compare two samples of one descriptor.

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit; the reference (the scans) first.
    seed : int
        From 0; the same seed gives the same bytes, whatever the number of threads.
    permutations, bootstrap : int
        Numbers of permutations and of bootstrap replicates.
    level : float
        Confidence level of all intervals.
    bins : int, optional
        A fixed number of bins; by default the rule of `lithoform.statistics.histograms.bin_edges`.
    pseudo_count : float
        For the Kullback-Leibler divergence; see `lithoform.statistics.histograms.kullback_leibler`.
    strata : tuple of two sequences of str, lengths n and m, optional
        The class of each value, where permutations are to stay within classes; see
        `lithoform.statistics.permutation.permutation_tests`.  Bootstrap and analysis of variance do not use it.

    Returns
    -------
    SampleComparison

    Raises
    ------
    SampleError
        If a sample has fewer than two values, is not finite or does not vary, or an option is out of range.
    """
    x, y = varied_pair(a, b)
    one, other = _seeds(seed, 2)
    edges = bin_edges(np.concatenate([x, y]), bins=bins)
    histograms = np.stack([counts(x, edges), counts(y, edges)])
    for array in (edges, histograms):
        array.flags.writeable = False
    return SampleComparison(
        sizes=(len(x), len(y)),
        means=(float(x.mean()), float(y.mean())),
        deviations=(float(x.std(ddof=1)), float(y.std(ddof=1))),
        anova=anova([x, y], level=level),
        indices=permutation_tests(
            x, y, seed=one, permutations=permutations, bins=bins, pseudo_count=pseudo_count, strata=strata
        ),
        estimates=bootstrap_estimates(x, y, seed=other, bootstrap=bootstrap, level=level),
        edges=edges,
        counts=histograms,
    )  # fmt: skip


def compare_joint(
    a: ArrayLike,
    b: ArrayLike,
    *,
    seed: int,
    permutations: int = 2000,
    strata: tuple[Sequence[str], Sequence[str]] | None = None,
) -> JointComparison:
    """Compare two tables of particles on all their descriptors together; see `lithoform.statistics.joint`.

    Parameters
    ----------
    a, b : array_like, shape (n, d) and (m, d)
        Particles by descriptors, the same columns in both.
    seed : int
        From 0; the same seed gives the same bytes, whatever the number of threads.
    permutations : int
        Number of permutations of each test.
    strata : tuple of two sequences of str, lengths n and m, optional
        The class of each particle, where permutations are to stay within classes.

    Returns
    -------
    JointComparison

    Raises
    ------
    SampleError
        As `lithoform.statistics.joint.joint_energy_test`.
    """
    one, other = _seeds(seed, 2)
    return JointComparison(
        energy=joint_energy_test(a, b, seed=one, permutations=permutations, strata=strata),
        mmd=joint_mmd_test(a, b, seed=other, permutations=permutations, strata=strata),
    )


def compare_populations(
    a: ArrayLike,
    b: ArrayLike,
    names: Sequence[str],
    *,
    seed: int,
    classes: tuple[Sequence[str], Sequence[str]] | None = None,
    permutations: int = 2000,
    bootstrap: int = 2000,
) -> PopulationComparison:
    """Compare two populations on several descriptors, pooled and by class.

    Parameters
    ----------
    a, b : array_like, shape (n, d) and (m, d)
        Particles by descriptors; the reference (the scans) first.
    names : sequence of str, length d
        What the columns are.
    seed : int
        From 0; the same seed gives the same bytes, whatever the number of threads.
    classes : tuple of two sequences of str, lengths n and m, optional
        The class of each particle of either population.  Permutations of the pooled particles stay within classes.
    permutations, bootstrap : int
        Numbers of permutations and of bootstrap replicates of each comparison.

    Returns
    -------
    PopulationComparison

    Raises
    ------
    SampleError
        As `compare_samples` and `compare_joint`, and if names or classes do not fit the tables, or a class is in one
        population only.
    """
    x, y = as_table(a, "the first table"), as_table(b, "the second table")
    if not len(names) == x.shape[1] == y.shape[1]:
        raise SampleError(
            f"expected a name for each column of both tables, got {len(names)} names for {x.shape[1]} and "
            f"{y.shape[1]} columns."
        )
    groups: list[tuple] = [(None, x, y, classes)]
    if classes is not None:
        left, right = (np.asarray(list(side), dtype=str) for side in classes)
        if len(left) != len(x) or len(right) != len(y):
            raise SampleError(
                f"expected a class for each particle, got {len(left)} and {len(right)} for {len(x)} and {len(y)} rows."
            )
        found, other = sorted(set(left.tolist())), sorted(set(right.tolist()))
        if found != other:
            raise SampleError(f"expected the same classes in both populations, got {found} and {other}; drop the odd.")
        groups += [(name, x[left == name], y[right == name], None) for name in found]
    seeds = iter(_seeds(seed, len(groups) * (len(names) + 1)))
    compared = [
        ClassComparison(
            name=name,
            descriptors=tuple(
                compare_samples(
                    one, other, seed=next(seeds), permutations=permutations, bootstrap=bootstrap, strata=strata
                )
                for one, other in zip(u.T, v.T, strict=True)
            ),
            joint=compare_joint(u, v, seed=next(seeds), permutations=permutations, strata=strata),
        )
        for name, u, v, strata in groups
    ]
    return PopulationComparison(tuple(names), compared[0], tuple(compared[1:]))


def _seeds(seed: int, count: int) -> list[int]:
    """Seeds that follow from one, each for a part of the work."""
    return [int(generator.integers(0, 1 << 63)) for generator in generators(seed, count)]


def _named(found: Sequence, name: str, names: Sequence[str]):
    for one in found:
        if one.name == name:
            return one
    raise SampleError(f"expected one of {', '.join(names)}, got {name!r}.")
