"""Figures 12 and 13, Table 6 and the verdict of an experiment with the compactor, beside those of the paper."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lithoform.compaction.experiment import MEASURES, Comparison, Experiment, compare_sources, measures_of
from lithoform.compaction.published import COMPACTED_DENSITY, FITS, LOOSE_DENSITY
from lithoform.figures.compaction import Curve, Densities, cases_figure, densities_figure
from lithoform.figures.gallery import png_bytes
from lithoform.report.page import Bullets, Cell, Page, Paragraph, Picture, Table

__all__ = ["experiment_files", "fits_table", "runs_csv", "summary"]

_TONES = {"equivalent": "same", "open": "open", "different": "strong"}


def experiment_files(experiment: Experiment, rows: list[dict[str, Any]]) -> dict[str, bytes]:
    """PNG files, the table of the runs and the page of an experiment, by name.

    Parameters
    ----------
    experiment : Experiment
    rows : list of dict
        As `lithoform.compaction.experiment.run_experiment` gives them.
    """
    cases = [[row for row in rows if row["case"] == case] for case in range(1, experiment.cases + 1)]
    panels = [
        Densities(title=title, scanned=np.array([case[0][stage]["packing_density"] for case in cases]),
                  generated=np.array([[row[stage]["packing_density"] for row in case[1:]] for case in cases]),
                  published=published)
        for title, stage, published in (
            ("pressed (Fig. 12a)", "loose", LOOSE_DENSITY), ("compacted (Fig. 12b)", "compacted", COMPACTED_DENSITY)
        )
    ]  # fmt: skip
    files = {
        "fig12.png": png_bytes(densities_figure(panels)),
        "fig13.png": png_bytes(cases_figure([[_curve(row) for row in case] for case in cases])),
        "runs.csv": runs_csv(rows),
    }
    return {**files, "report.html": _page(experiment, rows, files)}


def _curve(row: dict[str, Any]) -> Curve:
    series, fit = row["series"], row["fit"]
    return Curve(
        label=f"generated {row['sample']}" if row["sample"] else "scanned",
        gyrations=np.array(series["gyration"]),
        heights=np.array(series["height"]),
        densities=np.array(series["packing_density"]),
        fitted=(fit["A"], fit["B"]) if fit else None,
    )


def runs_csv(rows: Sequence[dict[str, Any]]) -> bytes:
    """A row a run: its case, its source, what was measured, in SI units."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(("case", "sample", "source", "stones", "mould_diameter_m", "loose_height_m", "loose_density",
                     "compacted_height_m", "compacted_density", "gyrations", "A_m", "B", "R2", "pressure_pa",
                     "deepest_overlap", "steps", "seconds"))  # fmt: skip
    for row in rows:
        fit = row["fit"] or {"A": "", "B": "", "R2": ""}
        source = "generated" if row["sample"] else "scanned"
        writer.writerow((row["case"], row["sample"], source, row["stones"], row["mould_diameter"],
                         row["loose"]["height"], row["loose"]["packing_density"], row["compacted"]["height"],
                         row["compacted"]["packing_density"], row["compacted"]["gyration"], fit["A"], fit["B"],
                         fit["R2"], row["pressure"]["mean"], row["deepest_overlap_over_radius"], row["steps"],
                         row["seconds"]))  # fmt: skip
    return out.getvalue().encode()


def fits_table(rows: Sequence[dict[str, Any]]) -> Table:
    """Table 6: ours, and below each case the paper's; our heights as those of a specimen as large as the paper's."""
    samples = max(row["sample"] for row in rows)
    head = ("case", "", "scanned", *(f"generated {k}" for k in range(1, samples + 1)))
    lines: list[tuple[str, ...]] = []
    groups = []
    for case in sorted({row["case"] for row in rows}):
        mine = [row["fit"] and {**row["fit"], "A_mm": row["fit"]["A_mm"] / row["height_scale"]}
                for row in rows if row["case"] == case]  # fmt: skip
        groups.append(len(lines))
        lines.append((str(case), "ours", *(_fit_text(f["A_mm"], f["B"], f["R2"]) if f else "-" for f in mine)))
        theirs = FITS[case - 1][: samples + 1] if case <= len(FITS) else ()
        told = [_fit_text(*fit) for fit in theirs]
        lines.append(("", "paper", *told, *["-"] * (samples + 1 - len(told))))
    return Table(
        head,
        tuple(lines),
        "H = A G^B, A in mm; R2. Ours are scaled: at a packing density of 0.53 a specimen would be 70 mm high.",
        texts=(0, 1),
        groups=tuple(groups),
    )


def _fit_text(a: float, b: float, r2: float) -> str:
    return f"{a:.4f} G^{b:.4f}; {r2:.4f}"


def _page(experiment: Experiment, rows: list[dict[str, Any]], files: dict[str, bytes]) -> bytes:
    page = Page("The gyratory compactor: specimens of scanned and of generated stones")
    found = compare_sources(rows) if experiment.cases > 1 else []
    page.add(Bullets(tuple(map(_sentence, found))))
    page.section("Verdict", _verdicts(found))
    page.section("Packing density", Picture(files["fig12.png"], "Packing densities by case, with the paper's range."))
    page.section("Height over gyrations", Picture(files["fig13.png"], "Heights by case, with the fits."))
    page.section("Table 6", fits_table(rows))
    first = rows[0]
    page.section("Settings", Paragraph(
        f"Scale {experiment.scale}: {first['stones']} stones in a mould of {1e3 * first['mould_diameter']:.1f} mm, "
        f"{first['mould_over_largest_stone']:.1f} times as wide as the largest; kappa {first['scales']['kappa']:.0f}, "
        f"inertial number {first['scales']['inertial_number_median']:.1e} (largest stone "
        f"{first['scales']['inertial_number']:.1e}). The paper's specimens have 9,000 stones in 150 mm, kappa 2,165: "
        "the level of packing density is not to be compared, the difference between sources is."
    ), Table(("", "value"), tuple((key, str(value)) for key, value in experiment.settings().items())))  # fmt: skip
    return page.to_bytes()


def _sentence(found: Comparison) -> str:
    low, high = found.interval
    if not (found.scanned and found.generated):
        return f"{MEASURES[found.name].capitalize()}: not fitted, for which at least three gyrations are needed."
    spread = f"; from seed to seed {found.spread:.4f}" if math.isfinite(found.spread) else ""
    said = {
        "equivalent": "the sources are equivalent within",
        "different": "the sources differ; the margin was",
        "open": "it cannot be told whether the sources are equivalent within",
    }[found.verdict]
    return (
        f"{MEASURES[found.name].capitalize()}: {said} {found.margin:g} (generated less scanned "
        f"{found.difference:+.4f}, 90 % from {low:+.4f} to {high:+.4f}{spread})."
    )


def _verdicts(found: Sequence[Comparison]) -> Table:
    lines = []
    for row in found:
        low, high = row.interval
        if not (row.scanned and row.generated):
            lines.append((MEASURES[row.name], *["-"] * 5, f"{row.margin:g}", "not fitted"))
            continue
        spread = f"{row.spread:.4f}" if math.isfinite(row.spread) else "-"
        lines.append((MEASURES[row.name], f"{np.mean(row.scanned):.4f}", f"{np.mean(row.generated):.4f}",
                      f"{row.difference:+.4f}", f"{low:+.4f} to {high:+.4f}", spread, f"{row.margin:g}",
                      Cell(row.verdict, _TONES[row.verdict])))  # fmt: skip
    head = ("", "scanned", "generated", "difference", "90 % interval", "seed to seed", "margin", "verdict")
    return Table(head, tuple(lines), "Two one-sided tests of Welch at 5 %.", texts=(0,))


def summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The compared numbers of each run, plain."""
    return [{"case": row["case"], "sample": row["sample"], **measures_of(row)} for row in rows]
