"""Claims of section 5: Tables 3 to 5 and Fig. 8 to 10."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from lithoform.descriptors.table import FOUR
from lithoform.presets import SHAPE_CLASSES
from lithoform.reproduce.claims import Finding, decided, judged, number, read_rows
from lithoform.reproduce.published_populations import PUBLISHED_INDICES

__all__ = ["figure_8", "figure_9", "figure_10", "table_3", "table_4", "table_5"]

_LEVEL: Final = 0.05
_MEDIUM: Final = 0.06
"""Share of the variance from which an effect is no longer small (Cohen)."""

_ROCK: Final = "scans of another rock: NIST's FDOT-57 in its own mix of classes"
_MEASURE: Final = "our roundness has another definition than the paper's"

Table = dict[str, dict[str, dict[str, str]]]


class _Numbers:
    """Cells of a file by case, quantity and column; NaN where there is none."""

    def __init__(self, folder: Path | None, name: str, key: str, columns: Sequence[str]) -> None:
        self.is_there = folder is not None
        self.cells: Table = {}
        if folder is not None:
            for row in read_rows(folder / f"{name}.csv", (key, "quantity", *columns)):
                self.cells.setdefault(row[key], {})[row["quantity"]] = row

    def text(self, case: str, quantity: str, column: str = "ours") -> str:
        return self.cells.get(case, {}).get(quantity, {}).get(column, "")

    def of(self, case: str, quantity: str, column: str = "ours") -> float:
        return number(self.text(case, quantity, column))

    def told(self, cases: Sequence[str], quantity: str, column: str = "ours") -> str:
        found = ((case, self.of(case, quantity, column)) for case in cases)
        return ", ".join(f"{case} {'-' if math.isnan(value) else f'{value:.4g}'}" for case, value in found)


def _less(a: float, b: float) -> bool | None:
    return None if math.isnan(a) or math.isnan(b) else a < b


def _finding(
    numbers: _Numbers, item: str, claim: str, truth: bool | None, ours: str, paper: str, criterion: str,
    condition: str = _ROCK,
) -> Finding:  # fmt: skip
    if not numbers.is_there:
        return Finding(item=item, claim=claim, verdict="not run", paper=paper, criterion=criterion, condition=condition)
    return Finding(item=item, claim=claim, verdict=judged(truth), ours=ours, paper=paper, criterion=criterion,
                   condition=condition)  # fmt: skip


def _anova(folder: Path | None, name: str) -> tuple[_Numbers, list[Finding]]:
    """What the three tables have in common: significance, small effects, and the paper's own arithmetic."""
    by_descriptor = name == "table3"
    cases = FOUR if by_descriptor else SHAPE_CLASSES
    key = "descriptor" if by_descriptor else "class"
    table = _Numbers(folder, name, key, ("ours", "paper", "recomputed", "note"))
    what = "descriptor" if by_descriptor else "class"
    p, eta = "p", "eta squared"
    found = [
        _finding(table, name, f"the sources differ significantly in each {what}",
                 decided(_less(table.of(case, p), _LEVEL) for case in cases), table.told(cases, p),
                 table.told(cases, p, "paper"), "p below 0.05 in all four"),
        _finding(table, name, f"the effects are small in each {what}",
                 decided(_less(table.of(case, eta), _MEDIUM) for case in cases), table.told(cases, eta),
                 table.told(cases, eta, "paper"), "eta squared below 0.06, Cohen's medium effect, in all four"),
        _finding(table, name, "the printed analyses agree with their own mean squares",
                 not _slips(table) if table.is_there else None,
                 "; ".join(_slips(table)) or "no slip", "", "no entry is 5 % away from what it follows from", ""),
    ]  # fmt: skip
    return table, found


def _slips(table: _Numbers) -> list[str]:
    return [
        f"{case}, {quantity}: {row['paper']} instead of {row['recomputed']}"
        for case, rows in table.cells.items()
        for quantity, row in rows.items()
        if "slip of the paper" in row["note"]
    ]


def table_3(folder: Path | None) -> list[Finding]:
    """Analysis of variance of the four descriptors; of no folder the claims as not run."""
    table, found = _anova(folder, "table3")
    f = {name: table.of(name, "F") for name in FOUR}
    order = (_less(f["boxiness"], f["solidity"]), _less(f["roundness"], f["boxiness"]),
             _less(f["true_sphericity"], f["boxiness"]))  # fmt: skip
    claim = "the sources are told apart best by 3D solidity, then by boxiness"
    criterion = "F falls from solidity to boxiness to the other two"
    told, printed = table.told(FOUR, "F"), table.told(FOUR, "F", "paper")
    return [*found, _finding(table, "table3", claim, decided(order), told, printed, criterion)]


def table_4(folder: Path | None) -> list[Finding]:
    """Analysis of variance of the roundness by class."""
    return _anova(folder, "table4")[1]


def table_5(folder: Path | None) -> list[Finding]:
    """Analysis of variance of the true sphericity by class."""
    return _anova(folder, "table5")[1]


def figure_8(folder: Path | None) -> list[Finding]:
    """Indices of the four descriptors, and the means of the generated stones."""
    table = _Numbers(folder, "fig8", "descriptor", ("ours", "paper"))
    bc, js, kl = "bhattacharyya", "jensen_shannon", "kullback_leibler"
    largest = decided(_less(table.of(name, kl), table.of("solidity", kl)) for name in FOUR if name != "solidity")
    found = [
        _finding(table, "fig8", "the distributions of all four descriptors overlap",
                 decided(_less(0.98, table.of(name, bc)) for name in FOUR), table.told(FOUR, bc),
                 table.told(FOUR, bc, "paper"), "Bhattacharyya coefficient above 0.98 in all four"),
        _finding(table, "fig8", "the Jensen-Shannon divergences are near 0.01 to 0.02",
                 decided(_less(table.of(name, js), 0.02) for name in FOUR), table.told(FOUR, js),
                 table.told(FOUR, js, "paper"), "below 0.02 in all four"),
        _finding(table, "fig8", "the Kullback-Leibler divergence is largest for 3D solidity", largest,
                 table.told(FOUR, kl), table.told(FOUR, kl, "paper"), "largest of the four"),
    ]  # fmt: skip
    for name in FOUR:
        printed = PUBLISHED_INDICES["fig8"][name]
        mean, deviation = (printed.means or (0.0, 0.0))[1], (printed.deviations or (0.0, 0.0))[1]
        ours = table.of(name, "mean of B")
        is_same = name != "roundness"
        truth = _less(abs(ours - mean), deviation) if is_same else None
        found.append(_finding(
            table, "fig8", f"generated stones of the paper's setting have the paper's mean {name}", truth,
            f"{ours:.4f}", f"{mean:g}", f"within one standard deviation of the paper's stones, {deviation:g}",
            "" if is_same else f"not to be compared: {_MEASURE}",
        ))  # fmt: skip
    return found


def _overlap(table: _Numbers, item: str) -> Finding:
    bc = "bhattacharyya"
    least = min(row.bhattacharyya for row in PUBLISHED_INDICES[item].values())
    bound = math.floor(100.0 * least) / 100.0
    truth = decided(_less(bound, table.of(case, bc)) for case in SHAPE_CLASSES)
    return _finding(table, item, "the distributions overlap in each class", truth, table.told(SHAPE_CLASSES, bc),
                    table.told(SHAPE_CLASSES, bc, "paper"),
                    f"Bhattacharyya coefficient above {bound:g} in all four")  # fmt: skip


def _best(table: _Numbers, item: str, best: str) -> Finding:
    bc = "bhattacharyya"
    truths = [_less(table.of(case, bc), table.of(best, bc)) for case in SHAPE_CLASSES if case != best]
    return _finding(table, item, f"{best} particles agree best", decided(truths), table.told(SHAPE_CLASSES, bc),
                    table.told(SHAPE_CLASSES, bc, "paper"),
                    "the largest Bhattacharyya coefficient of the four")  # fmt: skip


def _means(table: _Numbers) -> str:
    pairs = ((case, table.of(case, "mean of A"), table.of(case, "mean of B")) for case in SHAPE_CLASSES)
    return ", ".join(f"{case} {'-' if math.isnan(a) else f'{b - a:+.4f}'}" for case, a, b in pairs)


def figure_9(folder: Path | None) -> list[Finding]:
    """Roundness by class."""
    table = _Numbers(folder, "fig9", "class", ("ours", "paper"))
    truths = [
        _less(*(table.of(case, f"mean of {letter}") for letter in ("BA" if case in ("cube", "plate") else "AB")))
        for case in SHAPE_CLASSES
    ]
    text = "generated stones are less round in cubes and plates, rounder in columns and blades"
    return [_overlap(table, "fig9"), _best(table, "fig9", "plate"),
            _finding(table, "fig9", text, decided(truths), _means(table), "",
                     "signs of the difference of means, generated less scanned")]  # fmt: skip


def figure_10(folder: Path | None) -> list[Finding]:
    """True sphericity by class."""
    table = _Numbers(folder, "fig10", "class", ("ours", "paper"))
    truths = [_less(table.of(case, "mean of A"), table.of(case, "mean of B")) for case in SHAPE_CLASSES]
    paper = [(case, PUBLISHED_INDICES["fig10"][case].means) for case in SHAPE_CLASSES]
    told = ", ".join(f"{case} {means[1] - means[0]:+.4f}" for case, means in paper if means)
    return [_overlap(table, "fig10"), _best(table, "fig10", "column"),
            _finding(table, "fig10", "generated stones are a little more spherical in each class", decided(truths),
                     _means(table), told, "mean of the generated stones above that of the scans in all")]  # fmt: skip
