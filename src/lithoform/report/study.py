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
from lithoform.report.mix import LEAST, Mix, members, mix_of
from lithoform.report.spread import deviation_ratio
from lithoform.statistics.anova import Equivalence, equivalence
from lithoform.statistics.comparison import (
    ClassComparison,
    JointComparison,
    PopulationComparison,
    SampleComparison,
    compare_joint,
    compare_samples,
)
from lithoform.statistics.samples import generators

__all__ = [
    "ALPHA",
    "JOINT_MOST",
    "LEAST",
    "MARGIN",
    "PERMUTATIONS",
    "PERMUTATIONS_EACH",
    "POOLED",
    "SPREAD_MARGIN",
    "LeftOut",
    "Study",
    "detectable_shift",
    "study",
]

POOLED: Final = "pooled"
"""What the group of all particles is called; no class may have that name."""

MARGIN: Final = 0.2
"""Difference of means held to be of no practical matter, in pooled standard deviations: Cohen's small effect."""

SPREAD_MARGIN: Final = 1.15
"""Ratio of standard deviations held to be of no practical matter, and one over it."""

ALPHA: Final = 0.05
"""Chance of a false alarm anywhere among the comparisons of a study."""

PERMUTATIONS: Final = 2_000
PERMUTATIONS_EACH: Final = 100

JOINT_MOST: Final = 2_000
"""Most particles of a population that a joint test takes: its memory and time grow with the square of their number."""

_POWER: Final = 0.8
_MOST_NAMED: Final = 4  # classes in a message
_ENERGY: Final = 1.05  # the energy distance needs a shift larger by this factor than the t-test does
_GREATEST, _LEAST_RANGE = 1e100, 1e-100  # squares of greater values, and of lesser differences, leave float64


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
    ratios : tuple of tuples of tuple of float
        By group and descriptor: the 90 % interval of the standard deviation of the second over that of the first.
    adjusted : numpy.ndarray, shape (groups, descriptors)
        P-values of the energy distance, adjusted together with those of the joint tests (Holm).
    joint_p : tuple of float
        By group: p of the joint energy test, adjusted in the same way.
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
    ratios: tuple[tuple[tuple[float, float], ...], ...]
    adjusted: np.ndarray
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
    def units(self) -> tuple[str, ...]:
        """Units of the descriptors; empty for plain numbers, and where a source does not tell the unit of lengths."""
        known = self.reference.has_unit and self.other.has_unit
        return self.reference.units if known else ("",) * len(self.names)

    @property
    def tests(self) -> int:
        """Number of tests that the p-values are adjusted for."""
        return _tests(len(self.groups), len(self.names))

    @property
    def least_p(self) -> float:
        """Least p that so many permutations can give, before it is adjusted."""
        return 1.0 / (1.0 + self.permutations)

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
            chosen = slice(None) if group is None else members(side.classes or (), group)
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
        If the descriptors are not the same, one population has classes and the other has not, no class is in both or
        one is called "pooled", there are fewer than `LEAST` particles in one, a descriptor is not finite, too large or
        does not vary, or there are too few permutations for any difference to be told.
    """
    first, second = _checked(reference, other)
    classes = None if first.classes is None or second.classes is None else (first.classes, second.classes)
    kept, left_out = _sorted_classes(first, second)
    tests = _tests(1 + len(kept), len(first.names))
    if permutations is None:
        permutations = max(PERMUTATIONS, PERMUTATIONS_EACH * tests)
    # The least p that permutations can give, times Holm's factor, has to be below alpha.
    if not isinstance(permutations, bool) and 1 <= permutations < tests / ALPHA:
        raise SampleError(
            f"expected {math.ceil(tests / ALPHA)} permutations or more, as {tests} "
            f"{'test needs' if tests == 1 else 'tests need'}, got {permutations}: "
            "with fewer no difference could be told; ask for more, or for fewer descriptors."
        )
    *parts, of_mix = generators(seed, (1 + len(kept)) * (len(first.names) + 1) + 1)
    seeds = iter(int(g.integers(0, 1 << 63)) for g in parts)
    groups, equal, ratios = [], [], []
    for name in (None, *kept):
        u, v = (_values(side, name) for side in (first, second))
        strata = classes if name is None else None
        rows = tuple(
            compare_samples(x, y, seed=next(seeds), permutations=permutations, bootstrap=bootstrap, strata=strata)
            for x, y in zip(u.T, v.T, strict=True)
        )
        joint = _joint(u, v, next(seeds), permutations, strata)
        groups.append(ClassComparison(name, rows, joint))
        margins = [MARGIN * math.sqrt(row.anova.within_mean_square) for row in rows]
        equal.append(tuple(equivalence(x, y, margin=m) for x, y, m in zip(u.T, v.T, margins, strict=True)))
        # Two one-sided tests of 5 % are the interval of 90 %, as for the means.
        ratios.append(tuple(deviation_ratio(x, y, level=1.0 - 2.0 * ALPHA) for x, y in zip(u.T, v.T, strict=True)))
    comparison = PopulationComparison(first.names, groups[0], tuple(groups[1:]))
    adjusted = comparison.adjusted()
    mix = None
    if classes is not None:
        mix = mix_of((first.values, second.values), classes, generator=of_mix, permutations=permutations)
    return Study(
        reference=first,
        other=second,
        comparison=comparison,
        equivalences=tuple(equal),
        ratios=tuple(ratios),
        adjusted=adjusted[:, :-1],
        joint_p=tuple(adjusted[:, -1].tolist()),
        left_out=left_out,
        mix=mix,
        seed=seed,
        permutations=permutations,
        bootstrap=bootstrap,
        joint_most=JOINT_MOST,
    )


def detectable_shift(row: SampleComparison, tests: int) -> float:
    """Difference of means, in standard deviations, that samples of these sizes would show in 4 cases of 5.

    1.05 (t(1 - 0.05 / (2 k)) + t(0.8)) sqrt(1/n + 1/m), with Student's quantiles at n + m - 2 degrees of freedom: the
    power of the t-test when k are made at once (Cohen 1988, Bonferroni's bound), and a part more for the energy
    distance, which sees other differences too.

    Parameters
    ----------
    row : SampleComparison
    tests : int
        Number k of tests that p-values are adjusted for.
    """
    from scipy.special import stdtrit

    n, m = row.sizes
    quantiles = (float(stdtrit(n + m - 2, level)) for level in (1.0 - 0.5 * ALPHA / tests, _POWER))
    return _ENERGY * sum(quantiles) * math.sqrt(1.0 / n + 1.0 / m)


def _tests(groups: int, names: int) -> int:
    """The descriptors of every group and its joint test, which is the same as the descriptor's where there is one."""
    return groups * (names + (names > 1))


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
        if POOLED in (side.classes or ()):
            raise SampleError(
                f"expected classes of other names than {POOLED}, which all particles are called together, got one in "
                f"{side.label}; rename it."
            )
        for name, column in zip(side.names, side.values.T, strict=True):
            bad = int(len(column) - np.count_nonzero(np.isfinite(column)))
            if bad:
                raise SampleError(
                    f"expected a finite {name} of every particle of {side.label}, got {bad} of {len(column)} without; "
                    "leave those particles or that descriptor out."
                )
            if np.abs(column).max() > _GREATEST or 0.0 < np.ptp(column) < _LEAST_RANGE:
                raise SampleError(
                    f"expected a {name} of {side.label} within 1e100 of 0, and differences of 1e-100 or more, got "
                    f"{column.min():g} to {column.max():g}; choose another unit."
                )
            if column.min() == column.max():
                raise SampleError(
                    f"expected a {name} that varies in {side.label}, got {column[0]:g} {len(column)} times; leave it "
                    "out of the names."
                )
    if reference.label == other.label:
        return tuple(replace(side, label=f"{side.label} ({x})") for side, x in ((reference, "A"), (other, "B")))  # type: ignore[return-value]
    return reference, other


def _sorted_classes(first: Population, second: Population) -> tuple[list[str], tuple[LeftOut, ...]]:
    """Classes that can be compared; those that cannot, and why."""
    if first.classes is None or second.classes is None:
        return [], ()
    if not {*first.classes} & {*second.classes}:
        raise SampleError(
            f"expected a class that is in both populations, got {_named(first)} and {_named(second)}; name the classes "
            "alike, or compare without them."
        )
    names, kept, left_out = tuple(sorted({*first.classes, *second.classes})), [], []
    for name in names:
        sides = [_values(side, name) for side in (first, second)]
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
    return kept, tuple(left_out)


def _values(side: Population, name: str | None) -> np.ndarray:
    return side.values if name is None else side.values[members(side.classes or (), name)]


def _named(side: Population) -> str:
    found = sorted({*(side.classes or ())})
    more = f" and {len(found) - _MOST_NAMED} more" if len(found) > _MOST_NAMED else ""
    return f"{', '.join(found[:_MOST_NAMED])}{more} in {side.label}"
