"""Claims of section 6: Fig. 12, Fig. 13 and Table 6.

Two kinds of claims are only of the paper's specimens, 9,000 stones in 150 mm.  Of smaller ones the level of a number is
not to be compared: it is told, and not judged.  Their scatter is larger: where they meet a bound all the same it is
confirmed, where they do not it is not decided.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from lithoform.compaction.published import COMPACTED_DENSITY, FITS, LOOSE_DENSITY
from lithoform.reproduce.claims import Finding, Rows, Verdict, judged, number, read_rows

__all__ = ["figure_12", "figure_13", "table_6"]

_FULL: Final = (0.14, 8000)
"""Width of the mould [m] and number of stones from which a specimen counts as one of the paper's size."""

_POINT: Final = 0.01
_LEAST_R2: Final = 0.99
_EXPONENT: Final = (min(b for case in FITS for _, b, _ in case), max(b for case in FITS for _, b, _ in case))
_SCATTER_OF_A: Final = 0.01
_SCATTER_OF_B: Final = 0.0015
"""Greatest less least exponent: of the order of 1e-3; the paper's own is 1.0e-3."""


class _Specimens:
    """Rows of a file, a specimen each, and how far they are from the paper's."""

    def __init__(self, item: str, folder: Path | None, name: str, columns: Sequence[str]) -> None:
        needed = ("source", "stones", "mould_diameter_m", *columns)
        self.item = item
        self.rows: Rows | None = None if folder is None else read_rows(folder / name, needed)
        width, stones = self.column("mould_diameter_m"), self.column("stones")
        self.is_full = len(width) > 0 and bool(width.min() >= _FULL[0] and stones.min() >= _FULL[1])
        self.condition = ""
        if len(width) and not self.is_full:
            self.condition = f"{stones.max():.0f} stones in a mould of {1e3 * width.max():.0f} mm; 9,000 in 150 mm"

    def column(self, name: str) -> np.ndarray:
        return np.array([number(row[name]) for row in self.rows or ()])

    def finding(self, claim: str, ours: str, paper: str, criterion: str, verdict: Verdict, condition: str) -> Finding:
        is_run = self.rows is not None
        return Finding(item=self.item, claim=claim, verdict=verdict if is_run else "not run",
                       ours=ours if is_run else "", paper=paper, criterion=criterion, condition=condition)  # fmt: skip

    def level(self, claim: str, values: np.ndarray, bounds: tuple[float, float], criterion: str) -> Finding:
        """All values within bounds, which is only judged of specimens of the paper's size."""
        low, high = bounds
        is_known = len(values) > 0 and bool(np.isfinite(values).all())
        truth = bool(low <= values.min() and values.max() <= high) if is_known and self.is_full else None
        paper = f"{low:g} to {high:g}"
        condition = f"not to be compared: {self.condition}" if self.condition else ""
        return self.finding(claim, _span(values), paper, criterion, judged(truth), condition)

    def bound(self, claim: str, value: float, ours: str, paper: str, criterion: str, *, meets: bool) -> Finding:
        """A bound that smaller specimens meet less easily."""
        truth: bool | None = None
        if math.isfinite(value) and (meets or self.is_full):
            truth = meets
        return self.finding(claim, ours, paper, criterion, judged(truth), self.condition)


def _span(values: np.ndarray) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.4f} to {known.max():.4f}" if len(known) else "-"


def figure_12(folder: Path | None) -> list[Finding]:
    """Packing densities; of no folder the claims as not run."""
    table = _Specimens("fig12", folder, "fig12.csv", ("loose_density", "compacted_density"))
    loose, end = table.column("loose_density"), table.column("compacted_density")
    gain = end - loose
    least, most = COMPACTED_DENSITY[0] - LOOSE_DENSITY[1], COMPACTED_DENSITY[1] - LOOSE_DENSITY[0]
    found = [
        table.level("packing densities of loose mixtures lie in a narrow band", loose, LOOSE_DENSITY,
                    "all within the paper's range"),
        table.level("packing densities after gyration lie in a narrow band", end, COMPACTED_DENSITY,
                    "all within the paper's range"),
        table.finding("gyration raises the packing density in every specimen",
                      f"{gain.min():+.4f} to {gain.max():+.4f}" if len(gain) else "", f"{least:+.3f} to {most:+.3f}",
                      "after gyration above before", judged(bool((gain > 0.0).all()) if len(gain) else None),
                      table.condition),
    ]  # fmt: skip
    named = {"loose_density": "before gyration", "compacted_density": "after gyration"}
    return [*found, *_sources("fig12", folder, table.condition, named, _POINT, "one percentage point")]


def _sources(
    item: str, folder: Path | None, condition: str, named: dict[str, str], margin: float | None, told: str
) -> list[Finding]:
    """That the sources differ by less than a margin, by a 90 % interval: two one-sided tests at 5 %.

    A margin of None is that of the experiment.
    """
    columns = ("measure", "difference", "low", "high", "margin")
    rows = {} if folder is None else {row["measure"]: row for row in read_rows(folder / "fig12_sources.csv", columns)}
    found = []
    for name, when in named.items():
        row = rows.get(name, {})
        difference, low, high, own = (number(row.get(key)) for key in columns[1:])
        bound = own if margin is None else margin
        truth: bool | None = None
        if -bound < low and high < bound:
            truth = True
        elif low > bound or high < -bound:
            truth = False
        found.append(Finding(
            item=item, claim=f"scanned and generated stones agree: {when}",
            verdict="not run" if folder is None else judged(truth),
            ours=f"{difference:+.4f} (90 % from {low:+.4f} to {high:+.4f})" if row else "",
            criterion=f"the 90 % interval of generated less scanned lies within {told}; outside it is refuted",
            condition="; ".join(filter(None, ("scans of another rock: NIST's FDOT-57", condition))),
        ))  # fmt: skip
    return found


def figure_13(folder: Path | None) -> list[Finding]:
    """The course of the height: no systematic deviation between the sources.

    It needs fig12_sources.csv too, which the same experiment gives.
    """
    with_sources = folder if folder is not None and (folder / "fig12_sources.csv").exists() else None
    named = {"A": "height at the first gyration over that of the solids", "B": "exponent of the height"}
    return _sources("fig13", with_sources, "", named, None, "the margin of the experiment (A 0.05, B 0.003)")


def table_6(folder: Path | None) -> list[Finding]:
    """Fits of the height."""
    table = _Specimens("table6", folder, "table6.csv", ("A_over_solids", "B", "R2"))
    a, b, r2 = (table.column(name) for name in ("A_over_solids", "B", "R2"))
    is_known = len(a) > 0 and bool(np.isfinite([a, b, r2]).all())
    spread_a = float(np.ptp(a) / a.mean()) if is_known else math.nan
    spread_b = float(np.ptp(b)) if is_known else math.nan
    least = float(r2.min()) if is_known else math.nan
    published = [fit for case in FITS for fit in case]
    paper_a, paper_b = (np.array([fit[k] for fit in published]) for k in (0, 1))
    paper_r2 = min(fit[2] for fit in published)
    return [
        table.bound("H = A G^B fits every run", least, f"least {least:.4f}", f"least {paper_r2:g}",
                    "R2 above 0.99 in all runs", meets=least > _LEAST_R2),
        table.level("the exponents are close to -0.029", b, _EXPONENT, "all within the paper's range"),
        table.bound("A varies within one percent from run to run", spread_a, f"{100 * spread_a:.2f} %",
                    f"{100 * np.ptp(paper_a) / paper_a.mean():.2f} %",
                    "greatest less least of A over the height of the solids, at most 1 % of the mean",
                    meets=spread_a <= _SCATTER_OF_A),
        table.bound("B varies by some 1e-3 from run to run", spread_b, f"{spread_b:.4f}", f"{np.ptp(paper_b):.4f}",
                    "greatest less least at most 0.0015", meets=spread_b <= _SCATTER_OF_B),
    ]  # fmt: skip
