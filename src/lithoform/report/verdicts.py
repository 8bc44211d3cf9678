"""What a comparison comes to, in a word and in a sentence, from its numbers.

Whether two samples differ is decided by the energy distance, which sees differences of any kind, with its p-value
adjusted for all comparisons of the study.  How much they differ is another question, answered by the shift of two
normal distributions that overlap as much as normals with the means and deviations found; and where no difference
can be told, the equivalence test says how large a one could have hidden.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Final

from lithoform.errors import SampleError
from lithoform.report.study import ALPHA, MARGIN, Study, detectable_shift
from lithoform.statistics.anova import Equivalence
from lithoform.statistics.comparison import SampleComparison
from lithoform.statistics.normals import normal_bhattacharyya

__all__ = ["KINDS", "Verdict", "joint_verdict", "mix_notes", "verdict", "verdicts"]

KINDS: Final = {
    "agrees": "same",
    "not told apart": "open",
    "too few to tell": "open",
    "differs: slight": "slight",
    "differs: small": "slight",
    "differs: medium": "strong",
    "differs: large": "strong",
}
"""Words of a verdict, and the tone in which a page shows each."""

_SIZES: Final = ((0.2, "slight"), (0.5, "small"), (0.8, "medium"), (math.inf, "large"))  # Cohen's bounds
_SENTENCE: Final = {"slight": "slightly", "small": "by a small amount", "medium": "by a medium amount",
                    "large": "by a large amount"}  # fmt: skip
_VAGUE: Final = 0.5  # a bound on the difference that is no more than this many deviations is worth having
_LEAST_RATIO: Final = 1.1  # of two deviations that is worth a word

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
        On which it rests: of the energy distance, adjusted for all comparisons of the study.
    size : float
        How much the samples differ, in standard deviations: the shift at which two normals of one deviation overlap as
        much as normals with the means and deviations found; of pooled samples with different mixes of classes, the
        part of the difference of means that lies within the classes.
    bound : float
        The means differ by no more than this many standard deviations (95 %, one-sided, Welch).
    """

    kind: str
    sentence: str
    p: float
    size: float
    bound: float


def verdicts(study: Study) -> tuple[tuple[Verdict, ...], ...]:
    """Verdicts by group (pooled first) and descriptor."""
    adjusted = study.comparison.adjusted()
    mix = study.mix
    table = []
    for i, group in enumerate(study.groups):
        rows = []
        for j, row in enumerate(group.descriptors):
            uneven = group.name is None and mix is not None and not mix.is_same
            parts = (mix.parts[j] if mix.parts else (math.nan, math.nan)) if uneven and mix else None
            one = verdict(study.names[j], row, study.equivalences[i][j], float(adjusted[i, j]), parts=parts)
            apart = [str(g.name) for k, g in enumerate(study.groups) if k > 0 and adjusted[k, j] < ALPHA]
            if uneven and apart and one.p >= ALPHA:
                # With uneven mixes the pooled test is blunt: most of what it sees is the mix.
                verb = "differs" if len(apart) == 1 else "differ"
                one = replace(one, sentence=f"{one.sentence}; but by class {_listed(apart)} {verb}")
            rows.append(one)
        table.append(tuple(rows))
    return tuple(table)


def verdict(
    name: str,
    row: SampleComparison,
    equal: Equivalence,
    p: float,
    *,
    parts: tuple[float, float] | None = None,
) -> Verdict:
    """Verdict on one descriptor.

    Parameters
    ----------
    name : str
        Descriptor.
    row : SampleComparison
    equal : Equivalence
        With the margin `MARGIN`.
    p : float
        Of the energy distance, adjusted for all comparisons.
    parts : tuple of float, optional
        Where the mixes of classes differ: the parts of the difference of means from the mix and from within the
        classes, nan where they cannot be told.
    """
    deviation = math.sqrt(row.anova.within_mean_square)
    bound = max(abs(end) for end in equal.interval) / deviation
    shift = (row.means[1] - row.means[0]) if parts is None else -parts[1]
    size = abs(shift) / deviation if parts is not None else _overlap_shift(row)
    if p >= ALPHA:
        kind, sentence = _agreement(row, equal, bound, deviation, parts)
        return Verdict(kind, sentence, p, size, bound)
    clauses = _clauses(name, row, shift, deviation, parts)
    if not clauses:
        clauses = [f"in the shape of the distribution (Kolmogorov-Smirnov {row.index('kolmogorov_smirnov').value:.2f})"]
        size = max(size, _shift_of_distance(row.index("kolmogorov_smirnov").value)) if parts is None else size
    word = "slight" if math.isnan(size) else next(word for limit, word in _SIZES if size < limit)
    beyond = "" if parts is None else " beyond the mix of classes"
    sentence = f"differs {_SENTENCE[word]}{beyond}: {', and '.join(clauses)}"
    return Verdict(f"differs: {word}", sentence, p, size, bound)


def joint_verdict(study: Study, group: int) -> str:
    """What the joint test of one group (0 for the pooled particles) says, in a sentence."""
    p, alone = study.joint_p[group], study.comparison.adjusted()[group]
    what = "the descriptors together"
    if p >= ALPHA:
        return f"{what} cannot be told apart (p {p:.2g})"
    hidden = ", though none of them does by itself: they go together in another way" if alone.min() >= ALPHA else ""
    return f"{what} differ (p {p:.2g}){hidden}"


def mix_notes(study: Study) -> tuple[str, ...]:
    """What is to be told of a study: classes left out, mixes that differ, joint tests of a part of the particles."""
    notes = [
        f"class {one.name} ({one.sizes[0]} and {one.sizes[1]} particles) is not compared by itself: {one.reason}; "
        "its particles are in the pooled comparison"
        for one in study.left_out
    ]
    mix = study.mix
    if mix is not None and not mix.is_same:
        counts = "; ".join(
            f"{name} {a} and {b}" for name, a, b in zip(mix.names, mix.counts[0], mix.counts[1], strict=True)
        )
        notes.append(
            f"the mixes of classes differ ({counts}; {100.0 * mix.distance:.0f} % would have to change class): pooled "
            "means, indices, intervals and effect sizes compare the mixes too; pooled p-values and noise floors do "
            "not, since their deals stay within the classes"
        )
    if study.is_thinned:
        notes.append(f"joint tests take at most {study.joint_most:,} particles of each population, drawn at random")
    return tuple(notes)


def _agreement(
    row: SampleComparison, equal: Equivalence, bound: float, deviation: float, parts: tuple[float, float] | None
) -> tuple[str, str]:
    if parts is not None:
        of_mix = "" if math.isnan(parts[0]) else f"; the mix alone would make it {_moved(-parts[0])}"
        means = f"the mean of B is {_moved(row.means[1] - row.means[0])}{of_mix}"
        return "not told apart", f"cannot be told apart beyond the mix of classes ({means})"
    if equal.is_equivalent:
        return "agrees", f"cannot be told apart, and the means agree within {MARGIN:g} sd"
    limit = f"a difference of means up to {_number(bound * deviation)} ({bound:.2g} sd) is not ruled out"
    if bound > _VAGUE:
        few = f"{row.sizes[0]} and {row.sizes[1]} particles would show {detectable_shift(row):.2g} sd"
        return "too few to tell", f"cannot be told apart, which says little: {few}, and {limit}"
    return "not told apart", f"cannot be told apart; {limit}"


def _clauses(
    name: str, row: SampleComparison, shift: float, deviation: float, parts: tuple[float, float] | None
) -> list[str]:
    """In what samples differ that do, for which there is evidence: the mean, the scatter, the tails."""
    found = []
    if row.index("mean_difference").p < ALPHA and not math.isnan(shift):
        higher, lower = _WORDS.get(name, (f"higher in {name}", f"lower in {name}"))
        told = f"{abs(shift) / deviation:.2g} sd"
        if parts is None:
            told += f", η² {row.anova.eta_squared:.2g}"
            found.append(f"B is {higher if shift > 0 else lower} by {_number(abs(shift))} ({told})")
        else:
            found.append(
                f"B is {higher if shift > 0 else lower} by {_number(abs(shift))} within the classes ({told}); the mix "
                f"makes it {_moved(-parts[0])}"
            )
    if parts is not None:
        return found
    a, b = row.deviations
    if row.index("deviation_difference").p < ALPHA and max(a, b) > _LEAST_RATIO * min(a, b):
        found.append(f"B scatters {'more' if b > a else 'less'} (sd {_number(b)} against {_number(a)})")
    if not found:
        for estimate, tail in (("percentile_5_difference", "lower"), ("percentile_95_difference", "upper")):
            one = row.estimate(estimate)
            if one.low > 0.0 or one.high < 0.0:
                way = "lower" if one.value > 0.0 else "higher"
                found.append(f"the {tail} tail of B is {way} by {_number(abs(one.value))}")
    return found


def _overlap_shift(row: SampleComparison) -> float:
    """Shift d of two normals of deviation 1 whose Bhattacharyya coefficient, exp(-d^2 / 8), is that of the normals."""
    (m, k), (s, t) = row.means, row.deviations
    try:
        overlap = normal_bhattacharyya((m, s), (k, t))
    except SampleError:
        return math.inf
    return math.sqrt(-8.0 * math.log(overlap)) if overlap > 0.0 else math.inf


def _shift_of_distance(distance: float) -> float:
    """Shift d of two normals of deviation 1 whose Kolmogorov-Smirnov distance, 2 Phi(d / 2) - 1, is the one given."""
    return 2.0 * NormalDist().inv_cdf(0.5 + 0.5 * distance) if distance < 1.0 else math.inf


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _moved(change: float) -> str:
    return f"{'lower' if change < 0.0 else 'higher'} by {_number(abs(change))}"


def _number(value: float) -> str:
    return f"{value:.2g}"
