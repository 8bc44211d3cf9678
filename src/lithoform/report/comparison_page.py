"""The page of a study of two populations: verdicts first, then every number beside what chance alone would give."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from lithoform.report.page import Bullets, Cell, Page, Paragraph, Picture, Table
from lithoform.report.study import ALPHA, MARGIN, POOLED, SPREAD_MARGIN, Study
from lithoform.report.verdicts import (
    KINDS,
    Verdict,
    is_least_joint,
    joint_kind,
    joint_verdict,
    mix_notes,
    p_text,
    verdicts,
)
from lithoform.statistics.comparison import SampleComparison
from lithoform.statistics.resampling import Estimate

__all__ = ["Drawing", "comparison_page", "group_name", "with_unit"]

_Cells = Callable[[SampleComparison, int, int], Sequence[str | Cell]]

_INDEX_NAMES: Final = (("BC", "bhattacharyya"), ("KL", "kullback_leibler"), ("JS", "jensen_shannon"))
_DISTANCE_NAMES: Final = (
    ("Wasserstein", "wasserstein"),
    ("KS", "kolmogorov_smirnov"),
    ("energy", "energy_distance"),
)
_READING: Final = (
    "A is the reference. Differences are A less B; a verdict says what B is.",
    ("Whether two samples differ is decided by the energy distance, which sees differences of any kind. Its p and "
     f"those of the joint tests are adjusted together (Holm): a false alarm anywhere has a chance of {ALPHA:g} at "
     "most. All other p on this page are not adjusted. ≤ stands before the least p that the permutations can give."),
    ("By chance: the mean of an index over random deals of the pooled particles to A and B, which is what two samples "
     "of one population score. Limit: what only 5 deals in 100 pass. p: share of deals that come as far."),
    ("How much they differ is told in standard deviations (sd): slight below 0.2, small below 0.5, medium below 0.8, "
     "else large. It is the shift at which two normals of one sd overlap as much as those that were found."),
    ("Where no difference can be told, the largest difference of means that is not ruled out (95 %) says what that is "
     f"worth. 'Means agree' says that it is below {MARGIN:g} sd; 'agrees' that the standard deviations are also within "
     f"{100.0 * (SPREAD_MARGIN - 1.0):.0f} % (95 %), the 5th and 95th percentiles found within {MARGIN:g} sd, and p "
     "not below 0.05 before it is adjusted; 'too few to tell' that it is above 0.5 sd."),
)  # fmt: skip


@dataclass(frozen=True)
class Drawing:
    """A figure of a report.

    Attributes
    ----------
    file : str
        Name of its file.
    png : bytes
    caption : str
    """

    file: str
    png: bytes
    caption: str


def group_name(name: str | None) -> str:
    """What a group is called in tables: the class, or "pooled" for all particles."""
    return POOLED if name is None else name


def with_unit(name: str, unit: str) -> str:
    """A descriptor's name and its unit in square brackets, where it has one."""
    return f"{name} [{unit}]" if unit else name


def comparison_page(study: Study, figures: Sequence[Drawing]) -> bytes:
    """The report of a study as one HTML file.

    Parameters
    ----------
    study : Study
    figures : sequence of Drawing
        Put into the page itself, in this order.

    Returns
    -------
    bytes
        The same study and figures give the same bytes.
    """
    a, b = study.reference, study.other
    page = Page(f"{a.label} and {b.label} compared")
    page.add(
        Paragraph(f"A: {a.label}, {len(a):,} particles, the reference. B: {b.label}, {len(b):,} particles. "
                  f"{study.permutations:,} permutations, {study.bootstrap:,} bootstrap replicates, seed {study.seed}."),
        *([Bullets(tuple(f"{note[0].upper()}{note[1:]}." for note in mix_notes(study)))] if mix_notes(study) else []),
    )  # fmt: skip
    told = verdicts(study)
    page.section("Verdicts", _verdict_table(study, told), Bullets(_READING))
    pooled = [one for one in figures if not one.file.endswith("_by_class.png")]
    page.section("All particles", *map(_picture, pooled))
    page.section("Means and analysis of variance", _table(
        study,
        ("n A", "n B", "mean A", "mean B", "sd A", "sd B", "A − B", "95 % interval", "F", "p", "η²", "ω²"),
        _anova_cells,
        "One-way analysis of variance with its interval of the difference of means. η² is the share of the variance "
        "that lies between the populations; ω² is the same nearly without bias.",
    ), *_mix_table(study))  # fmt: skip
    heads = tuple(text for sign, _ in _INDEX_NAMES for text in (sign, "by chance", "limit", "p"))
    page.section("Histogram indices (eq. 23 to 26)", _table(
        study, ("bins", *heads), lambda row, *_: (str(len(row.edges) - 1), *_index_cells(study, row, _INDEX_NAMES)),
        "Natural logarithms. Bins by the rule of Freedman and Diaconis on the pooled sample. KL is of A from B, with "
        "half a particle added to every bin.",
    ))  # fmt: skip
    heads = tuple(text for sign, _ in _DISTANCE_NAMES for text in (sign, "by chance", "limit", "p"))
    page.section("Distances without bins", _table(
        study, heads, lambda row, *_: _index_cells(study, row, _DISTANCE_NAMES),
        "Wasserstein in the unit of the descriptor; KS is that of Kolmogorov and Smirnov; the p of the energy distance "
        "is not yet adjusted.",
    ))  # fmt: skip
    page.section("Effect sizes", _table(
        study, ("Hedges' g", "95 % interval", "A above B", "95 % interval", "not ruled out", "equivalent, p", "shown"),
        lambda row, i, j: _effect_cells(study, told, row, i, j),
        "Hedges' g: difference of means in standard deviations. A above B: chance that a particle of A has the larger "
        f"value. Not ruled out: difference of means [sd] up to which they may differ (95 %). Equivalent: p of the test "
        f"that means differ by less than {MARGIN:g} sd. Shown: difference of means [sd] that so many particles show in "
        "4 cases of 5, at p adjusted for all tests.",
    ))  # fmt: skip
    page.section("Tails", _table(
        study, ("5th percentile, A − B", "95 % interval", "p", "95th percentile, A − B", "95 % interval", "p"),
        lambda row, *_: _tail_cells(study, row), "Bootstrap intervals. A shift of the mean moves both tails.",
    ))  # fmt: skip
    page.section("All descriptors together", _joint_table(study))
    by_class = [one for one in figures if one.file.endswith("_by_class.png")]
    if by_class:
        page.section("By class", *map(_picture, by_class))
    return page.to_bytes()


def _verdict_table(study: Study, told: tuple[tuple[Verdict, ...], ...]) -> Table:
    rows: list[tuple[str | Cell, ...]] = []
    for i, group in enumerate(study.groups):
        for name, row, one in zip(study.names, group.descriptors, told[i], strict=True):
            is_least = row.index("energy_distance").p <= study.least_p
            cell = Cell(one.kind, KINDS[one.kind])
            rows.append((group_name(group.name), name, cell, one.sentence, p_text(one.p, is_least=is_least)))
        kind, sentence = joint_kind(study, i), joint_verdict(study, i)
        rows.append((group_name(group.name), "joint", Cell(kind, KINDS[kind]), sentence, _joint_p(study, i)))
    step = len(study.names) + 1
    return Table(
        ("group", "descriptor", "verdict", "in words", "p"), tuple(rows),
        "p: of the energy distance and of the joint tests, "
        f"{'not adjusted: there is one' if study.tests == 1 else f'adjusted over all {study.tests} tests'}.",
        texts=(0, 1, 2), long=(3,), groups=tuple(range(step, len(rows), step)),
    )  # fmt: skip


def _table(study: Study, head: tuple[str, ...], cells: _Cells, caption: str) -> Table:
    rows = [
        (group_name(group.name), with_unit(name, study.units[j]), *cells(row, i, j))
        for i, group in enumerate(study.groups)
        for j, (name, row) in enumerate(zip(study.names, group.descriptors, strict=True))
    ]
    groups = tuple(range(len(study.names), len(rows), len(study.names)))
    return Table(("group", "descriptor", *head), tuple(rows), caption, texts=(0, 1), groups=groups)


def _anova_cells(row: SampleComparison, *_: int) -> Sequence[str]:
    found = row.anova
    return (
        *(f"{size:,}" for size in row.sizes), *(_digits(mean, 4) for mean in row.means),
        *(_digits(one, 3) for one in row.deviations), _signed(found.mean_difference or 0.0),
        _interval(*(found.interval or (math.nan, math.nan))), _digits(found.f, 4), _p(found.p),
        _digits(found.eta_squared, 3), _digits(found.omega_squared, 3),
    )  # fmt: skip


def _index_cells(study: Study, row: SampleComparison, names: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    tests = [row.index(name) for _, name in names]
    return tuple(
        text
        for test in tests
        for text in (*(_digits(x, 4) for x in (test.value, test.floor_mean, test.floor_limit)), _drawn(study, test.p))
    )


def _effect_cells(
    study: Study, told: tuple[tuple[Verdict, ...], ...], row: SampleComparison, i: int, j: int
) -> Sequence[str]:
    g, above = row.estimate("hedges_g"), row.estimate("superiority")
    return (
        _signed(g.value), _interval(g.low, g.high), _digits(above.value, 3),
        f"{_digits(above.low, 3)} to {_digits(above.high, 3)}",
        _known(told[i][j].bound), _p(study.equivalences[i][j].p), _known(told[i][j].detectable),
    )  # fmt: skip


def _tail_cells(study: Study, row: SampleComparison) -> Sequence[str]:
    out: list[str] = []
    for name in ("percentile_5_difference", "percentile_95_difference"):
        one: Estimate = row.estimate(name)
        out += [_signed(one.value), _interval(one.low, one.high), _drawn(study, row.index(name).p)]
    return out


def _joint_table(study: Study) -> Table:
    rows = []
    for i, group in enumerate(study.groups):
        tests = (group.joint.energy, group.joint.mmd)
        numbers = (
            (*(_digits(x, 4) for x in (t.value, t.floor_mean, t.floor_limit)), _drawn(study, t.p)) for t in tests
        )
        rows.append((group_name(group.name), *(text for four in numbers for text in four), _joint_p(study, i)))
    head = ("group", "energy", "by chance", "limit", "p", "MMD", "by chance", "limit", "p", "energy, p adjusted")
    return Table(head, tuple(rows), "Energy distance and maximum mean discrepancy of all descriptors together, each in "
                 "its standard deviations. They see differences of the joint distribution that no descriptor shows "
                 "alone.")  # fmt: skip


def _mix_table(study: Study) -> list[Table | Paragraph]:
    mix = study.mix
    if mix is None or mix.is_same:
        return []
    counts = tuple(
        (name, f"{a:,}", f"{b:,}", f"{100.0 * a / sum(mix.counts[0]):.1f} %", f"{100.0 * b / sum(mix.counts[1]):.1f} %")
        for name, a, b in zip(mix.names, *mix.counts, strict=True)
    )
    blocks: list[Table | Paragraph] = [
        Table(("class", "A", "B", "share of A", "share of B"), counts, "Classes: the mixes differ.")
    ]
    if mix.parts is not None:
        parts = tuple((with_unit(name, unit), _signed(sum(p)), _signed(p[0]), _signed(p[1])) for name, unit, p in
                      zip(study.names, study.units, mix.parts, strict=True))  # fmt: skip
        blocks.append(Table(("descriptor", "A − B", "by the mix", "within the classes"), parts,
                            "The pooled difference of means in two parts (Kitagawa 1955): what the mix of classes "
                            f"makes, and what is left within {', '.join(mix.shared)}."))  # fmt: skip
    return blocks


def _picture(one: Drawing) -> Picture:
    return Picture(one.png, one.caption, f"{one.caption} File: {one.file}")


def _interval(low: float, high: float) -> str:
    return f"{_signed(low)} to {_signed(high)}"


def _digits(value: float, digits: int) -> str:
    """So many digits, those that are 0 as well."""
    if math.isinf(value):
        return "−∞" if value < 0 else "∞"
    return f"{value:#.{digits}g}".rstrip(".").replace("-", "−")


def _signed(value: float) -> str:
    return f"{'+' if value >= 0.0 else ''}{_digits(value, 3)}"


def _known(value: float) -> str:
    return f"{value:.2g}" if math.isfinite(value) else ""


def _p(value: float) -> str:
    return p_text(value)


def _drawn(study: Study, value: float) -> str:
    """A p that comes from permutations and is not adjusted."""
    return p_text(value, is_least=value <= study.least_p)


def _joint_p(study: Study, group: int) -> str:
    return p_text(study.joint_p[group], is_least=is_least_joint(study, group))
