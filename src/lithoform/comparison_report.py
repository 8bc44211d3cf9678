"""A study of two populations as rows, CSV, JSON, lines for a screen, figures and a page; nothing is measured anew."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import re
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import atomic_path, atomic_write, make_folder
from lithoform.descriptors.table import DESCRIPTORS
from lithoform.figures.gallery import png_bytes
from lithoform.figures.populations import (
    Effect,
    Panel,
    distribution_figure,
    effects_figure,
    heading,
    histogram_figure,
    require_figures,
)
from lithoform.report.comparison_page import Drawing, comparison_page, group_name, with_unit
from lithoform.report.study import Study
from lithoform.report.verdicts import Verdict, joint_kind, joint_verdict, mix_notes, p_text, verdicts
from lithoform.sidecar import program_version
from lithoform.statistics.comparison import ClassComparison, SampleComparison

__all__ = [
    "COLUMNS",
    "SCREEN_WIDTH",
    "as_dict",
    "csv_bytes",
    "drawings",
    "report_files",
    "rows",
    "screen",
    "write_report",
]

SCREEN_WIDTH: Final = 100
"""Columns of a terminal that the table on the screen fits."""

REPORT_FILE, TABLE_FILE, DATA_FILE = "report.html", "comparison.csv", "comparison.json"

_DPI: Final = 200  # sharp on a screen and on paper, and half the bytes of 300
_COLOURS: Final = 128
_PANELS: Final = 6  # in one figure

_INDICES: Final = (
    "bhattacharyya", "kullback_leibler", "jensen_shannon", "wasserstein", "kolmogorov_smirnov", "energy_distance",
    "mean_difference", "deviation_difference", "percentile_5_difference", "percentile_95_difference",
)  # fmt: skip
_ESTIMATES: Final = ("mean_difference", "cohen_d", "hedges_g", "superiority", "cliff_delta",
                     "percentile_5_difference", "percentile_95_difference")  # fmt: skip

_HISTOGRAMS: Final = (
    "Histograms of all particles, in the manner of Fig. 8b: kernel curves, means (dotted), indices with what chance "
    "alone gives in brackets, and the p of BC, which is not adjusted."
)
_DISTRIBUTIONS: Final = (
    "Distribution functions of all particles; dots are the 5th and 95th percentiles, P5 and P95 their differences "
    "(A less B) with bootstrap intervals; p is of KS, not adjusted."
)

COLUMNS: Final[tuple[str, ...]] = tuple(dict.fromkeys([
    "group", "descriptor", "unit", "n_a", "n_b", "mean_a", "mean_b", "deviation_a", "deviation_b",
    "verdict", "sentence", "p_adjusted", "size_sd", "bound_sd", "detectable_sd", "bins",
    *(f"{name}{end}" for name in _INDICES for end in ("", "_by_chance", "_limit", "_p")),
    "anova_f", "anova_p", "between_freedom", "within_freedom", "between_mean_square", "within_mean_square",
    "eta_squared", "omega_squared", "anova_low", "anova_high",
    *(f"{name}{end}" for name in _ESTIMATES for end in ("", "_low", "_high")),
    "equivalence_margin", "equivalence_p", "equivalence_low", "equivalence_high", "difference_by_mix",
    "difference_within_classes", "joint_energy", "joint_energy_by_chance", "joint_energy_limit", "joint_energy_p",
    "joint_mmd", "joint_mmd_by_chance", "joint_mmd_limit", "joint_mmd_p", "joint_mmd_scale",
]))  # fmt: skip
"""Of `rows` and of the CSV file; differences are A less B."""

JOINT: Final = "joint"
"""What stands for a descriptor in the row of all descriptors together."""


def rows(study: Study) -> list[dict[str, Any]]:
    """One row a group and descriptor, pooled first, and after those of a group one of all descriptors together.

    Parameters
    ----------
    study : Study

    Returns
    -------
    list of dict
        With the keys of `COLUMNS` that apply; values in the units of the descriptors.
    """
    told = verdicts(study)
    out = []
    for i, group in enumerate(study.groups):
        for j, (name, row) in enumerate(zip(study.names, group.descriptors, strict=True)):
            begin = {"group": group_name(group.name), "descriptor": name, "unit": study.units[j]}
            out.append(begin | _row(study, i, j, row, told[i][j]))
        out.append({"group": group_name(group.name), "descriptor": JOINT} | _joint_row(study, i, group))
    return out


def csv_bytes(study: Study) -> bytes:
    """Rows as CSV with all `COLUMNS`; a cell that does not apply is empty."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows(study):
        writer.writerow({key: "" if value != value else value for key, value in row.items()})  # nan does not apply
    return out.getvalue().encode()


def as_dict(study: Study, files: Sequence[str] = ()) -> dict[str, Any]:
    """Everything as plain values, for JSON; what is infinite or does not apply is None."""
    mix = study.mix
    return {
        "lithoform": program_version(),
        "a": {"label": study.reference.label, "particles": len(study.reference)},
        "b": {"label": study.other.label, "particles": len(study.other)},
        "descriptors": list(study.names),
        "seed": study.seed,
        "permutations": study.permutations,
        "bootstrap": study.bootstrap,
        "classes": None if mix is None else {
            "names": list(mix.names), "particles_a": list(mix.counts[0]), "particles_b": list(mix.counts[1]),
            "mix_distance": mix.distance, "mix_p": mix.p, "mix_differs": not mix.is_same,
            "shared": list(mix.shared),
        },
        "left_out": [{"class": o.name, "particles": list(o.sizes), "reason": o.reason} for o in study.left_out],
        "notes": list(mix_notes(study)),
        "rows": [{key: _finite(value) for key, value in row.items()} for row in rows(study)],
        "files": list(files),
    }  # fmt: skip


def screen(study: Study) -> str:
    """Table and verdicts for a terminal of 100 columns."""
    pair = ((letter, side) for letter, side in zip("AB", (study.reference, study.other), strict=True))
    lines = [_short(f"{letter}: {side.label}, {len(side):,} particles", SCREEN_WIDTH) for letter, side in pair]
    head = ("group", "descriptor", "mean A", "mean B", "sd A", "sd B", "BC (chance)", "KL", "JS", "p", "verdict")
    table: list[tuple[str, ...]] = [head]
    told = verdicts(study)
    for group, found in zip(study.groups, told, strict=True):
        for name, unit, row, verdict in zip(study.names, study.units, group.descriptors, found, strict=True):
            is_least = row.index("energy_distance").p <= study.least_p
            overlap = row.index("bhattacharyya")
            table.append((
                _short(group_name(group.name), 8), _short_name(name, unit), *(f"{mean:#.4g}" for mean in row.means),
                *(f"{one:#.2g}" for one in row.deviations), f"{overlap.value:.3f} ({overlap.floor_mean:.3f})",
                f"{row.index('kullback_leibler').value:.2f}", f"{row.index('jensen_shannon').value:.3f}",
                p_text(verdict.p, is_least=is_least).replace(" ", ""), verdict.kind,
            ))  # fmt: skip
    columns = [(max(map(len, column)), column) for column in zip(*table, strict=True)]
    # Where numbers are long, the page has the divergences that the screen has no room for.
    for name in ("JS", "KL"):
        if sum(width + 1 for width, _ in columns) - 1 > SCREEN_WIDTH:
            columns = [one for one in columns if one[1][0] != name]
    # Words are set from the left, numbers from the right.
    for i in range(len(table)):
        cells = [
            column[i].ljust(width) if column[0] in ("group", "descriptor", "verdict") else column[i].rjust(width)
            for width, column in columns
        ]
        lines.append(" ".join(cells).rstrip())
    lines.append("p: of the energy distance, adjusted for all tests (≤: the least that so many permutations can give).")
    lines.append("BC in brackets: what chance alone gives.")
    for i, (group, found) in enumerate(zip(study.groups, told, strict=True)):
        sizes = " and ".join(f"{size:,}" for size in group.descriptors[0].sizes)
        lines += ["", f"{_short(group_name(group.name), 60)}, {sizes} particles:"]
        for name, verdict in zip(study.names, found, strict=True):
            lines += _wrapped(f"{name}: {verdict.sentence}")
        lines += _wrapped(f"joint: {joint_verdict(study, i)}")
    notes = mix_notes(study)
    return "\n".join([*lines, *([""] if notes else []), *(line for note in notes for line in _wrapped(note, "note: "))])


def drawings(study: Study) -> list[Drawing]:
    """Figures as PNG files: histograms, distribution functions, effect sizes, and each descriptor by class.

    Raises
    ------
    LithoformError
        If Matplotlib is not installed.
    """
    labels = (study.reference.label, study.other.label)
    titles = [with_unit(heading(name)[0], unit) for name, unit in zip(study.names, study.units, strict=True)]
    pooled = [
        Panel(title, study.samples(None, name), row, heading(name)[1])
        for name, title, row in zip(study.names, titles, study.groups[0].descriptors, strict=True)
    ]
    out: list[Drawing] = []
    sheets = [pooled[k : k + _PANELS] for k in range(0, len(pooled), _PANELS)]
    for kind, draw, what in (("histograms", histogram_figure, _HISTOGRAMS),
                             ("distributions", distribution_figure, _DISTRIBUTIONS)):  # fmt: skip
        for k, panels in enumerate(sheets):
            number = f"_{k + 1}" if len(sheets) > 1 else ""
            pixels = draw(panels, labels, title="All particles", dpi=_DPI)
            out.append(Drawing(f"{kind}{number}.png", png_bytes(pixels, colours=_COLOURS), what))
    effects = [
        Effect(group_name(group.name), name.replace("_", " "), g.value, g.low, g.high)
        for group in study.groups
        for name, row in zip(study.names, group.descriptors, strict=True)
        for g in (row.estimate("hedges_g"),)
    ]
    out.append(Drawing("effects.png", png_bytes(effects_figure(effects, labels, dpi=_DPI), colours=_COLOURS),
                       "Standardised differences of means with bootstrap intervals; the band is Cohen's small effect, "
                       "0.2 standard deviations to either side."))  # fmt: skip
    for j, name in enumerate(study.names if len(study.groups) > 1 else ()):
        panels = [Panel(str(g.name), study.samples(g.name, name), g.descriptors[j]) for g in study.groups[1:]]
        words = titles[j]
        pixels = histogram_figure(panels, labels, title=f"{words} by class", dpi=_DPI)
        out.append(Drawing(f"{re.sub('[^A-Za-z0-9_-]', '_', name)}_by_class.png", png_bytes(pixels, colours=_COLOURS),
                           f"{words} by class, in the manner of Fig. 9 and 10."))  # fmt: skip
    return out


def report_files(study: Study) -> dict[str, bytes]:
    """Files of a report by their names, the page first: report.html, comparison.csv, comparison.json, the figures.

    Raises
    ------
    LithoformError
        If Matplotlib is not installed.
    """
    figures = drawings(study)
    names = [REPORT_FILE, TABLE_FILE, DATA_FILE, *(one.file for one in figures)]
    return {
        REPORT_FILE: comparison_page(study, figures),
        TABLE_FILE: csv_bytes(study),
        DATA_FILE: (json.dumps(as_dict(study, names), indent=1) + "\n").encode(),
    } | {one.file: one.png for one in figures}


def write_report(make: Callable[[], Study], out: Path) -> tuple[Study, list[Path]]:
    """Make a study and write its report into a folder, each file whole or not at all and the page last.

    Parameters
    ----------
    make : callable
        Makes the study; called when it is known that the folder can be written.
    out : pathlib.Path
        Made where there is none; files of the same names are replaced, and those of a former comparison that this one
        does not make are removed.

    Returns
    -------
    Study, list of pathlib.Path
        The report first.

    Raises
    ------
    OutputError
        If the folder or a file cannot be written.
    LithoformError
        If Matplotlib is not installed, or as `make`.
    """
    require_figures()
    make_folder(out)
    stale = _former_files(out)
    with atomic_path(out / REPORT_FILE) as page:
        found = make()
        files = report_files(found)
        for name, data in files.items():
            if name != REPORT_FILE:
                atomic_write(out / name, data)
        for name in stale - {*files}:
            with contextlib.suppress(OSError):
                (out / name).unlink()
        page.write_bytes(files[REPORT_FILE])
    return found, [out / name for name in files]


def _former_files(out: Path) -> set[str]:
    """Files that a former comparison in the folder says it made."""
    try:
        told = json.loads((out / DATA_FILE).read_bytes())
        names = filter(
            lambda name: isinstance(name, str), told["files"] if {"lithoform", "rows"} <= told.keys() else []
        )
        # Plain names alone: nothing outside the folder is touched, whatever the file says.
        return {
            name
            for name in names
            if name == Path(name).name and Path(name).suffix in (".html", ".csv", ".json", ".png")
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return set()


def _row(study: Study, i: int, j: int, row: SampleComparison, verdict: Verdict) -> dict[str, Any]:
    table, equal = row.anova, study.equivalences[i][j]
    out: dict[str, Any] = {
        "n_a": row.sizes[0], "n_b": row.sizes[1], "mean_a": row.means[0], "mean_b": row.means[1],
        "deviation_a": row.deviations[0], "deviation_b": row.deviations[1],
        "verdict": verdict.kind, "sentence": verdict.sentence, "p_adjusted": verdict.p, "size_sd": verdict.size,
        "bound_sd": verdict.bound, "detectable_sd": verdict.detectable, "bins": len(row.edges) - 1,
    }  # fmt: skip
    for name in _INDICES:
        test = row.index(name)
        out |= {name: test.value, f"{name}_by_chance": test.floor_mean, f"{name}_limit": test.floor_limit,
                f"{name}_p": test.p}  # fmt: skip
    for name in _ESTIMATES:
        estimate = row.estimate(name)
        out |= {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
    low, high = table.interval or (math.nan, math.nan)
    out |= {
        "anova_f": table.f, "anova_p": table.p, "between_freedom": table.between_freedom,
        "within_freedom": table.within_freedom, "between_mean_square": table.between_mean_square,
        "within_mean_square": table.within_mean_square, "eta_squared": table.eta_squared,
        "omega_squared": table.omega_squared, "anova_low": low, "anova_high": high,
        "equivalence_margin": equal.margin, "equivalence_p": equal.p, "equivalence_low": equal.interval[0],
        "equivalence_high": equal.interval[1],
    }  # fmt: skip
    if i == 0 and study.mix is not None and study.mix.parts is not None:
        out["difference_by_mix"], out["difference_within_classes"] = study.mix.parts[j]
    return out


def _joint_row(study: Study, i: int, group: ClassComparison) -> dict[str, Any]:
    out: dict[str, Any] = {
        "n_a": group.descriptors[0].sizes[0], "n_b": group.descriptors[0].sizes[1],
        "verdict": joint_kind(study, i), "sentence": joint_verdict(study, i), "p_adjusted": study.joint_p[i],
    }  # fmt: skip
    for name, test in (("joint_energy", group.joint.energy), ("joint_mmd", group.joint.mmd)):
        out |= {name: test.value, f"{name}_by_chance": test.floor_mean, f"{name}_limit": test.floor_limit,
                f"{name}_p": test.p}  # fmt: skip
    return out | {"joint_mmd_scale": group.joint.mmd.scale}


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _short(text: str, most: int) -> str:
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _short_name(name: str, unit: str) -> str:
    """A descriptor's name with its unit in 15 characters, or its symbol."""
    known = DESCRIPTORS.get(name)
    if len(with_unit(name, unit)) > 15 and known is not None and known.symbol:
        name = known.symbol
    return _short(with_unit(name, unit), 15)


def _wrapped(text: str, first: str = "  ") -> list[str]:
    return textwrap.wrap("".join(c if c.isprintable() else "?" for c in text), SCREEN_WIDTH, initial_indent=first,
                         subsequent_indent="    ", break_on_hyphens=False)  # fmt: skip
