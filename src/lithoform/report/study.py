"""Two populations put through every comparison, pooled and by class, with a note of what had to be left out.

Nothing new is measured here: all numbers come from `lithoform.statistics`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from lithoform.database.population import Population
from lithoform.errors import SampleError
from lithoform.statistics.anova import Equivalence, equivalence
from lithoform.statistics.comparison import (
    ClassComparison,
    JointComparison,
    PopulationComparison,
    SampleComparison,
    compare_joint,
    compare_samples,
)
from lithoform.statistics.multiplicity import holm
from lithoform.statistics.samples import generators

__all__ = [
    "ALPHA",
    "JOINT_MOST",
    "LEAST",
    "MARGIN",
    "PERMUTATIONS",
    "PERMUTATIONS_EACH",
    "LeftOut",
    "Mix",
    "Study",
    "detectable_shift",
    "study",
]

LEAST: Final = 5
"""Fewest particles of a class, in either population, that are compared by themselves."""

MARGIN: Final = 0.2
"""Difference of means held to be of no practical matter, in pooled standard deviations: Cohen's small effect."""

ALPHA: Final = 0.05
"""Chance of a false alarm anywhere among the comparisons of a study."""

PERMUTATIONS: Final = 2_000
PERMUTATIONS_EACH: Final = 100

JOINT_MOST: Final = 2_000
"""Most particles of a population that a joint test takes: its memory and time grow with the square of their number."""

_POWER: Final = 0.8
_SAME_MIX: Final = 0.02  # share of particles that would have to change their class


@dataclass(frozen=True)
class LeftOut:
    """A class that is not compared by itself.

    Attributes
    ----------
    name : str
    sizes : tuple of int
        Particles in the first and in the second population; they stay in the pooled comparison.
    reason : str
    """

    name: str
    sizes: tuple[int, int]
    reason: str


@dataclass(frozen=True)
class Mix:
    """How the two populations are made up of classes.

    Attributes
    ----------
    names : tuple of str
    counts : tuple of two tuples of int
        Particles of each class, in the first and in the second population.
    distance : float
        Share of the particles of one population that would have to be of another class for the mixes to be the same
        (total variation distance), 0 to 1.
    parts : tuple of tuples of float, or None
        For each descriptor, the parts of the pooled difference of means (first less second) that come from the mix and
        from within the classes (Kitagawa 1955); None where a class is in one population only.
    """

    names: tuple[str, ...]
    counts: tuple[tuple[int, ...], tuple[int, ...]]
    distance: float
    parts: tuple[tuple[float, float], ...] | None

    @property
    def is_same(self) -> bool:
        """Whether the mixes agree to within two particles in a hundred."""
        return self.distance <= _SAME_MIX


@dataclass(frozen=True, eq=False)
class Study:
    """Two populations and all that was found by comparing them; differences are of the first less the second.

    Attributes
    ----------
    reference, other : Population
        Called A and B in tables; labels are never the same.
    comparison : PopulationComparison
        Pooled over all particles, and by those classes that could be compared.
    equivalences : tuple of tuples of Equivalence
        By group (pooled first) and descriptor: whether the means differ by less than `MARGIN`.
    joint_p : tuple of float
        By group: p of the joint energy test, adjusted over the groups by Holm's method.
    left_out : tuple of LeftOut
    mix : Mix or None
        None where there are no classes.
    seed, permutations, bootstrap : int
    joint_most : int
        Most particles of a population that the joint tests took.
    """

    reference: Population
    other: Population
    comparison: PopulationComparison
    equivalences: tuple[tuple[Equivalence, ...], ...]
    joint_p: tuple[float, ...]
    left_out: tuple[LeftOut, ...]
    mix: Mix | None
    seed: int
    permutations: int
    bootstrap: int
    joint_most: int

    @property
    def names(self) -> tuple[str, ...]:
        """Descriptors, in the order of the columns."""
        return self.comparison.names

    @property
    def is_thinned(self) -> bool:
        """Whether the joint tests took a part of the particles only."""
        return max(len(self.reference), len(self.other)) > self.joint_most

    @property
    def groups(self) -> tuple[ClassComparison, ...]:
        """All particles first, then the classes."""
        return (self.comparison.pooled, *self.comparison.classes)

    def samples(self, group: str | None, descriptor: str) -> tuple[np.ndarray, np.ndarray]:
        """Values of one descriptor in both populations, of one class or (None) of all particles."""
        column = self.names.index(descriptor)
        pair = []
        for side in (self.reference, self.other):
            chosen = slice(None) if group is None else _members(side, group)
            pair.append(side.values[chosen, column])
        return pair[0], pair[1]


def study(
    reference: Population,
    other: Population,
    *,
    seed: int = 0,
    permutations: int | None = None,
    bootstrap: int = 2000,
) -> Study:
    """Compare two populations on all their descriptors, pooled and, where both have classes, by class.

    Parameters
    ----------
    reference, other : Population
        Of the same descriptors; the reference (the scans) first.
    seed : int
        From 0; the same seed gives the same bytes.
    permutations : int, optional
        Number of permutations of each test; by default `PERMUTATIONS`, or `PERMUTATIONS_EACH` times the number of
        comparisons where that is more: the least p that permutations can give is multiplied by that number.
    bootstrap : int
        Number of bootstrap replicates of each comparison.

    Returns
    -------
    Study
        With the numbers of `lithoform.statistics.comparison.compare_populations` where no class is left out.

    Raises
    ------
    SampleError
        If the descriptors are not the same, one population has classes and the other has not, there are fewer than
        `LEAST` particles in one, a descriptor is not finite or does not vary, or there are too few permutations for any
        difference to be told.

    References
    ----------
    Kitagawa, E. M. (1955). Components of a difference between two rates. J. Am. Stat. Assoc. 50, 1168-1194.
    """
    first, second = _checked(reference, other)
    classes = None if first.classes is None or second.classes is None else (first.classes, second.classes)
    names, kept, left_out = _sorted_classes(first, second)
    tests = (1 + len(kept)) * len(first.names)
    if permutations is None:
        permutations = max(PERMUTATIONS, PERMUTATIONS_EACH * tests)
    # The least p that permutations can give, times Holm's factor, has to be below alpha.
    if not isinstance(permutations, bool) and 1 <= permutations < tests / ALPHA:
        raise SampleError(
            f"expected {math.ceil(tests / ALPHA)} permutations or more, for {tests} comparisons "
            f"({1 + len(kept)} groups of {len(first.names)} descriptors), got {permutations}: with fewer no "
            "difference could be told; ask for more, or for fewer descriptors."
        )
    seeds = iter(int(g.integers(0, 1 << 63)) for g in generators(seed, (1 + len(kept)) * (len(first.names) + 1)))
    groups, equal = [], []
    for name in (None, *kept):
        u, v = (side.values if name is None else side.values[_members(side, name)] for side in (first, second))
        strata = classes if name is None else None
        rows = tuple(
            compare_samples(x, y, seed=next(seeds), permutations=permutations, bootstrap=bootstrap, strata=strata)
            for x, y in zip(u.T, v.T, strict=True)
        )
        joint = _joint(u, v, next(seeds), permutations, strata)
        groups.append(ClassComparison(name, rows, joint))
        margins = [MARGIN * math.sqrt(row.anova.within_mean_square) for row in rows]
        equal.append(tuple(equivalence(x, y, margin=m) for x, y, m in zip(u.T, v.T, margins, strict=True)))
    return Study(
        reference=first,
        other=second,
        comparison=PopulationComparison(first.names, groups[0], tuple(groups[1:])),
        equivalences=tuple(equal),
        joint_p=tuple(holm([group.joint.energy.p for group in groups]).tolist()),
        left_out=left_out,
        mix=_mix(first, second, names),
        seed=seed,
        permutations=permutations,
        bootstrap=bootstrap,
        joint_most=JOINT_MOST,
    )


def detectable_shift(row: SampleComparison) -> float:
    """Difference of means, in standard deviations, that samples of these sizes would show in 4 cases of 5.

    (t(0.975) + t(0.8)) sqrt(1/n + 1/m), with Student's quantiles at n + m - 2 degrees of freedom: the power of a single
    two-sided test at 0.05, not adjusted for several tests (Cohen 1988).
    """
    from scipy.special import stdtrit

    n, m = row.sizes
    quantiles = (float(stdtrit(n + m - 2, level)) for level in (1.0 - 0.5 * ALPHA, _POWER))
    return sum(quantiles) * math.sqrt(1.0 / n + 1.0 / m)


def _joint(
    u: np.ndarray, v: np.ndarray, seed: int, permutations: int, strata: tuple[Sequence[str], Sequence[str]] | None
) -> JointComparison:
    """The joint tests, of particles drawn at random where there are too many."""
    chosen = [
        np.sort(generator.permutation(len(side))[:JOINT_MOST]) if len(side) > JOINT_MOST else np.arange(len(side))
        for generator, side in zip(generators(seed, 2), (u, v), strict=True)
    ]
    if strata is not None:
        left, right = ([side[i] for i in rows.tolist()] for side, rows in zip(strata, chosen, strict=True))
        strata = (left, right)
    return compare_joint(u[chosen[0]], v[chosen[1]], seed=seed, permutations=permutations, strata=strata)


def _checked(reference: Population, other: Population) -> tuple[Population, Population]:
    if reference.names != other.names or not reference.names:
        raise SampleError(
            f"expected the same descriptors of both populations, got {', '.join(reference.names) or 'none'} and "
            f"{', '.join(other.names) or 'none'}; read both with the same names."
        )
    if (reference.classes is None) != (other.classes is None):
        which = reference.label if reference.classes is None else other.label
        raise SampleError(f"expected classes in both populations or in neither, got none in {which}.")
    for side in (reference, other):
        if len(side) < LEAST:
            raise SampleError(f"expected {LEAST} particles or more in {side.label}, got {len(side)}; measure more.")
        for name, column in zip(side.names, side.values.T, strict=True):
            bad = int(len(column) - np.count_nonzero(np.isfinite(column)))
            if bad:
                raise SampleError(
                    f"expected a finite {name} of every particle of {side.label}, got {bad} that are not; leave those "
                    "particles or that descriptor out."
                )
            if column.min() == column.max():
                raise SampleError(
                    f"expected a {name} that varies in {side.label}, got {column[0]:g} {len(column)} times; leave it "
                    "out of the names."
                )
    if reference.label == other.label:
        return tuple(replace(side, label=f"{side.label} ({x})") for side, x in ((reference, "A"), (other, "B")))  # type: ignore[return-value]
    return reference, other


def _sorted_classes(first: Population, second: Population) -> tuple[tuple[str, ...], list[str], tuple[LeftOut, ...]]:
    """All classes; those that can be compared; those that cannot, and why."""
    if first.classes is None or second.classes is None:
        return (), [], ()
    names, kept, left_out = tuple(sorted({*first.classes, *second.classes})), [], []
    for name in names:
        sides = [side.values[_members(side, name)] for side in (first, second)]
        sizes = len(sides[0]), len(sides[1])
        if min(sizes) == 0:
            reason = f"it is in {(first if sizes[0] else second).label} only"
        elif min(sizes) < LEAST:
            reason = f"fewer than {LEAST} particles say too little"
        else:
            alike = [n for i, n in enumerate(first.names) if any(np.ptp(side[:, i]) == 0.0 for side in sides)]
            reason = f"its {alike[0]} does not vary" if alike else ""
        if reason:
            left_out.append(LeftOut(name, sizes, reason))
        else:
            kept.append(name)
    return names, kept, tuple(left_out)


def _mix(first: Population, second: Population, names: Sequence[str]) -> Mix | None:
    if not names:
        return None
    masks = [[_members(side, name) for name in names] for side in (first, second)]
    counts = [[int(mask.sum()) for mask in side] for side in masks]
    a, b = (np.array(side) / sum(side) for side in counts)
    parts = None
    if min(map(min, counts)) > 0:
        means = [
            np.array([side.values[mask].mean(axis=0) for mask in rows])
            for side, rows in zip((first, second), masks, strict=True)
        ]
        of_mix = ((a - b)[:, None] * (means[0] + means[1]) / 2.0).sum(axis=0)
        within = ((a + b)[:, None] / 2.0 * (means[0] - means[1])).sum(axis=0)
        parts = tuple(zip(of_mix.tolist(), within.tolist(), strict=True))
    return Mix(
        names=tuple(names),
        counts=(tuple(counts[0]), tuple(counts[1])),
        distance=0.5 * float(np.abs(a - b).sum()),
        parts=parts,
    )


def _members(side: Population, name: str) -> np.ndarray:
    return np.array([one == name for one in side.classes or ()], dtype=bool)
