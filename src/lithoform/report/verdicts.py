"""What a comparison comes to, in a word and in a sentence, from its numbers.

Whether two samples differ is decided by the energy distance, which sees differences of any kind, with its p-value
adjusted for all tests of the study.  How much they differ is another question, answered by the shift of two normal
distributions that overlap as much as normals with the means and deviations found; and where no difference can be told,
the equivalence test says how large a one could have hidden.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Final

from lithoform.errors import SampleError
from lithoform.report.mix import LEAST, Mix, Standardised
from lithoform.report.study import ALPHA, MARGIN, SPREAD_MARGIN, Study, detectable_shift
from lithoform.statistics.anova import Equivalence
from lithoform.statistics.comparison import SampleComparison
from lithoform.statistics.normals import normal_bhattacharyya

__all__ = ["KINDS", "Verdict", "is_least_joint", "joint_kind", "joint_verdict", "mix_notes", "p_text", "verdicts"]

KINDS: Final = {
    "agrees": "same",
    "means agree": "open",
    "not told apart": "open",
    "too few to tell": "open",
    "differs: slight": "slight",
    "differs: small": "slight",
    "differs: medium": "strong",
    "differs: large": "strong",
    "differs": "strong",
}
"""Words of a verdict, and the tone in which a page shows each; the last has no size."""

_SIZES: Final = ((0.2, "slight"), (0.5, "small"), (0.8, "medium"), (math.inf, "large"))  # Cohen's bounds
_SENTENCE: Final = {"slight": "slightly", "small": "by a small amount", "medium": "by a medium amount",
                    "large": "by a large amount"}  # fmt: skip
_VAGUE: Final = 0.5  # a bound on the difference that is no more than this many deviations is worth having
_LEAST_RATIO: Final = 1.1  # of two deviations that is worth a word
_MOST_LISTED: Final = 3  # classes in a sentence

# How "B is ..." goes on where its mean is higher, and where it is lower.
_WORDS: Final = {
    "roundness": ("rounder", "more angular"),
    "boxiness": ("boxier", "less boxy"),
    "solidity": ("more solid", "less solid"),
    "true_sphericity": ("more spherical", "less spherical"),
}


@dataclass(frozen=True)
class Verdict:
    """What a comparison comes to.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    sentence : str
        The same in words, with its numbers; A is the first population, B the second.
    p : float
        On which it rests: of the energy distance, adjusted for all tests of the study.
    size : float
        How much the samples differ, in standard deviations: the shift at which two normals of one deviation overlap as
        much as normals with the means and deviations found; of pooled samples with different mixes of classes, with
        those that both have in a common mix.  It is nan where it cannot be told.
    bound : float
        The means differ by no more than this many standard deviations (95 %, one-sided, Welch); where the mixes
        differ, within the classes.
    detectable : float
        Difference of means, in standard deviations, that so many particles show in 4 cases of 5; nan where the mixes
        differ.
    """

    kind: str
    sentence: str
    p: float
    size: float
    bound: float
    detectable: float


@dataclass(frozen=True, eq=False)
class _Case:
    """One descriptor of one group; `mix` and `common` where the mixes of the pooled particles differ."""

    name: str
    unit: str
    row: SampleComparison
    equal: Equivalence
    ratio: tuple[float, float]
    p: float
    tests: int
    mix: Mix | None = None
    common: Standardised | None = None
    of_mix: float = math.nan

    @property
    def moments(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Mean and deviation of A and of B, in the common mix if the mixes differ."""
        means, deviations = (self.common or self.row).means, (self.common or self.row).deviations
        return (means[0], deviations[0]), (means[1], deviations[1])

    @property
    def shift(self) -> float:
        return self.moments[1][0] - self.moments[0][0]

    @property
    def deviation(self) -> float:
        """Unit of sizes."""
        return (self.common.deviation if self.common else 0.0) or math.sqrt(self.row.anova.within_mean_square)

    @property
    def bound(self) -> float:
        if self.mix is None:
            return max(abs(end) for end in self.equal.interval) / self.deviation
        if self.common is None:
            return math.inf
        return (abs(self.shift) + self.common.half_width(1.0 - 2.0 * ALPHA)) / self.deviation

    @property
    def where(self) -> str:
        """Over which classes differences are taken where the mixes differ."""
        if self.mix is None or not self.mix.small:
            return "within the classes"
        shared = list(self.mix.shared)
        if len(shared) > _MOST_LISTED:
            return f"within {len(shared)} of {len(self.mix.names)} classes"
        return f"within {'class' if len(shared) == 1 else 'classes'} {_listed(shared)}"

    def number(self, value: float) -> str:
        return f"{value:.2g} {self.unit}".rstrip()

    def moved(self, change: float) -> str:
        return f"{'lower' if change < 0.0 else 'higher'} by {self.number(abs(change))}"


def verdicts(study: Study) -> tuple[tuple[Verdict, ...], ...]:
    """Verdicts by group (pooled first) and descriptor."""
    table = []
    for i, group in enumerate(study.groups):
        mix = study.mix if group.name is None and study.mix is not None and not study.mix.is_same else None
        rows = []
        for j, row in enumerate(group.descriptors):
            case = _Case(
                name=study.names[j],
                unit=study.units[j],
                row=row,
                equal=study.equivalences[i][j],
                ratio=study.ratios[i][j],
                p=float(study.adjusted[i, j]),
                tests=study.tests,
                mix=mix,
                common=mix.common[j] if mix and mix.common else None,
                of_mix=mix.parts[j][0] if mix and mix.parts else math.nan,
            )
            one = _verdict(case)
            apart = [str(g.name) for k, g in enumerate(study.groups) if k > 0 and study.adjusted[k, j] < ALPHA]
            if mix and apart and one.p >= ALPHA:
                # With uneven mixes the pooled test is blunt: most of what it sees is the mix.
                verb = "differs" if len(apart) == 1 else "differ"
                one = replace(one, sentence=f"{one.sentence}; but by class {_listed(apart)} {verb}")
            rows.append(one)
        table.append(tuple(rows))
    return tuple(table)


def joint_kind(study: Study, group: int) -> str:
    """What the joint test of one group (0 for the pooled particles) comes to, one of `KINDS`."""
    return "differs" if study.joint_p[group] < ALPHA else "not told apart"


def joint_verdict(study: Study, group: int) -> str:
    """What the joint test of one group (0 for the pooled particles) says, in a sentence."""
    p = study.joint_p[group]
    shown = p_text(p, is_least=is_least_joint(study, group))
    if len(study.names) == 1:
        return f"the same test, as there is one descriptor (p {shown})"
    if p >= ALPHA:
        return f"the descriptors together cannot be told apart (p {shown})"
    alone = study.adjusted[group].min() >= ALPHA
    hidden = ", though none of them does by itself: they go together in another way" if alone else ""
    return f"the descriptors together differ (p {shown}){hidden}"


def mix_notes(study: Study) -> tuple[str, ...]:
    """What is to be told of a study beside its numbers: classes left out, mixes, units, joint tests of a part."""
    notes = [
        f"class {one.name} ({one.sizes[0]:,} and {one.sizes[1]:,} particles) is not compared by itself: {one.reason}; "
        "its particles are in the pooled comparison"
        for one in study.left_out
    ]
    mix = study.mix
    if mix is not None and not mix.is_same:
        notes += _of_mix(mix, study.least_p)
    sides = (study.reference, study.other)
    if any(study.reference.units) and not all(side.has_unit for side in sides):
        if any(side.has_unit for side in sides):
            with_unit, without = sorted(sides, key=lambda side: not side.has_unit)
            notes.append(f"{without.label} has no column unit: its lengths were taken as metres, which those of "
                         f"{with_unit.label} are")  # fmt: skip
        else:
            notes.append("neither table has a column unit: lengths were taken as they are")
    if study.is_thinned:
        notes.append(f"joint tests take at most {study.joint_most:,} particles of each population, drawn at random")
    return tuple(notes)


def _of_mix(mix: Mix, least_p: float) -> list[str]:
    counts = "; ".join(
        f"{name} {a:,} and {b:,}" for name, a, b in zip(mix.names, mix.counts[0], mix.counts[1], strict=True)
    )
    chance = p_text(mix.p, is_least=mix.p <= least_p)
    first = (
        f"the mixes of classes differ ({counts}; {100.0 * mix.distance:.0f} % would have to change class, p {chance}): "
        "pooled means, indices, intervals and effect sizes compare the mixes too; pooled p-values and what chance "
        "gives do not, since their deals stay within the classes"
    )
    notes = [first]
    if mix.small and mix.shared:
        one = len(mix.small) == 1
        notes.append(
            f"what lies within the classes is taken over {', '.join(mix.shared)} only: {', '.join(mix.small)} "
            f"{'has' if one else 'have'} fewer than {LEAST} particles in A or B"
        )
    return notes


def p_text(p: float, *, is_least: bool = False) -> str:
    """A p-value with two digits, with a sign before it where permutations can give no lesser one."""
    text = f"{p:.2g}" if p >= 1e-4 else f"{p:.1e}".replace("-", "−")
    return f"≤ {text}" if is_least and p < 1.0 else text


def is_least_joint(study: Study, group: int) -> bool:
    """Whether permutations can give no lesser p than that of the joint test of a group, before it is adjusted."""
    one = study.groups[group]
    # Of one descriptor, the joint test is the descriptor's own.
    decided = one.joint.energy if len(study.names) > 1 else one.descriptors[0].index("energy_distance")
    return decided.p <= study.least_p


def _verdict(case: _Case) -> Verdict:
    unsized = case.mix is not None and case.common is None
    size = math.nan if unsized else _overlap_shift(*case.moments)
    shown = detectable_shift(case.row, case.tests) if case.mix is None else math.nan
    if case.p >= ALPHA:
        kind, sentence = _agreement(case) if case.mix is None else _agreement_beyond(case)
        return Verdict(kind, sentence, case.p, size, case.bound, shown)
    clauses = [] if unsized else _clauses(case)
    if not clauses and case.mix is not None:
        why = f"no class has {LEAST} particles or more in both" if unsized else "neither mean nor scatter shows it"
        sentence = f"differs beyond the mix of classes, by how much cannot be told: {why}"
        return Verdict("differs", sentence, case.p, math.nan, case.bound, shown)
    if not clauses:
        distance = case.row.index("kolmogorov_smirnov").value
        clauses = [f"in the shape of the distribution (Kolmogorov-Smirnov {distance:.2f})"]
        size = max(size, _shift_of_distance(distance))
    word = next((word for limit, word in _SIZES if size < limit), "large")
    beyond = "" if case.mix is None else " beyond the mix of classes"
    sentence = f"differs {_SENTENCE[word]}{beyond}: {', and '.join(clauses)}"
    return Verdict(f"differs: {word}", sentence, case.p, size, case.bound, shown)


def _agreement(case: _Case) -> tuple[str, str]:
    row, bound = case.row, case.bound
    raw = row.index("energy_distance").p
    if case.equal.is_equivalent and raw >= ALPHA:
        unlike = [text for text in (_scatter_may_differ(case), _tails_may_differ(case)) if text]
        if unlike:
            return "means agree", f"cannot be told apart, and the means agree within {MARGIN:g} sd; {'; '.join(unlike)}"
        scatter = f"{100.0 * (SPREAD_MARGIN - 1.0):.0f} %"
        return "agrees", f"cannot be told apart: means and tails agree within {MARGIN:g} sd, scatter within {scatter}"
    limit = f"a difference of means up to {case.number(bound * case.deviation)} ({bound:.2g} sd) is not ruled out"
    if bound > _VAGUE:
        shown = detectable_shift(row, case.tests)
        few = f"{row.sizes[0]:,} and {row.sizes[1]:,} particles would show {shown:.2g} sd"
        return "too few to tell", f"cannot be told apart, which says little: {few}, and {limit}"
    alone = f"; p is {raw:.2g} before it is adjusted for {case.tests} tests" if raw < ALPHA and case.tests > 1 else ""
    return "not told apart", f"cannot be told apart; {limit}{alone}"


def _agreement_beyond(case: _Case) -> tuple[str, str]:
    """Where the mixes differ: agreement is not said of particles of which most of what one sees is the mix."""
    begin = "cannot be told apart beyond the mix of classes"
    if case.common is None:
        return "too few to tell", f"{begin}, which says little: no class has {LEAST} particles or more in both"
    limit = (
        f"{case.where} a difference of means up to {case.number(case.bound * case.deviation)} ({case.bound:.2g} sd) is "
        f"not ruled out; the mean of B is {case.moved(case.row.means[1] - case.row.means[0])}, the mix alone would "
        f"make it {case.moved(-case.of_mix)}"
    )
    if case.bound > _VAGUE:
        return "too few to tell", f"{begin}, which says little: {limit}"
    return "not told apart", f"{begin}: {limit}"


def _scatter_may_differ(case: _Case) -> str:
    low, high = case.ratio
    if low > 1.0 / SPREAD_MARGIN and high < SPREAD_MARGIN:
        return ""
    return f"the scatter may differ (sd of B {low:.3g} to {high:.3g} times that of A)"


def _tails_may_differ(case: _Case) -> str:
    found = [
        f"{level} percentile of B {case.moved(-case.row.estimate(name).value)}"
        for level, name in (("5th", "percentile_5_difference"), ("95th", "percentile_95_difference"))
        if abs(case.row.estimate(name).value) > MARGIN * case.deviation or case.row.index(name).p < ALPHA
    ]
    return f"the tails may differ ({', '.join(found)})" if found else ""


def _clauses(case: _Case) -> list[str]:
    """In what samples differ that do, for which there is evidence: the mean, the scatter, the tails."""
    found, row, shift = [], case.row, case.shift
    # The p of the pooled means says nothing of those within the classes, whose interval does.
    if case.common is None:
        is_told = row.index("mean_difference").p < ALPHA
    else:
        is_told = abs(shift) > case.common.half_width(1.0 - ALPHA)
    if is_told:
        higher, lower = _WORDS.get(case.name, (f"higher in {case.name}", f"lower in {case.name}"))
        told = f"B is {higher if shift > 0 else lower} by {case.number(abs(shift))}"
        size = f"{abs(shift) / case.deviation:.2g} sd"
        if case.mix is None:
            found.append(f"{told} ({size}, η² {row.anova.eta_squared:.2g})")
        else:
            found.append(f"{told} {case.where} ({size}); the mix makes it {case.moved(-case.of_mix)}")
    (_, a), (_, b) = case.moments
    if row.index("deviation_difference").p < ALPHA and max(a, b) > _LEAST_RATIO * min(a, b):
        mixed = "" if case.mix is None else " in a common mix"
        found.append(f"B scatters {'more' if b > a else 'less'} (sd {case.number(b)} against {case.number(a)}{mixed})")
    if not found and case.mix is None:
        for estimate, tail in (("percentile_5_difference", "lower"), ("percentile_95_difference", "upper")):
            one = row.estimate(estimate)
            if one.low > 0.0 or one.high < 0.0:
                way = "lower" if one.value > 0.0 else "higher"
                found.append(f"the {tail} tail of B is {way} by {case.number(abs(one.value))}")
    return found


def _overlap_shift(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Shift d of two normals of deviation 1 whose Bhattacharyya coefficient, exp(-d^2 / 8), is that of the normals."""
    try:
        overlap = normal_bhattacharyya(a, b)
    except SampleError:
        return math.inf
    return math.sqrt(max(0.0, -8.0 * math.log(overlap))) if overlap > 0.0 else math.inf


def _shift_of_distance(distance: float) -> float:
    """Shift d of two normals of deviation 1 whose Kolmogorov-Smirnov distance, 2 Phi(d / 2) - 1, is the one given."""
    return 2.0 * NormalDist().inv_cdf(0.5 + 0.5 * distance) if distance < 1.0 else math.inf


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
