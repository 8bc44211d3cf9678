"""Picture, table and page of a study of rate and stiffness."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from lithoform.compaction.study import MARGINS, MEASURES, Extrapolation, Setting, Study, extrapolate
from lithoform.figures.compaction import Trend, trends_figure
from lithoform.figures.gallery import png_bytes
from lithoform.report.page import Bullets, Cell, Page, Paragraph, Picture, Table

__all__ = ["findings", "study_files"]

_TONES = {"safe": "same", "open": "open", "biased": "strong"}
# Measures that the rate may change.
_AFTER = ("compacted_density", "settlement")
_COLUMNS = ("seed", "rate_factor", "stiffness_factor", "inertial_number", "inverse_kappa", *MEASURES, "seconds")


def study_files(study: Study, rows: list[dict[str, Any]]) -> dict[str, bytes]:
    """Files of a study by name: scales.png, scales.csv, report.html.

    Parameters
    ----------
    study : Study
    rows : list of dict
        As `lithoform.compaction.study.run_study` gives them.
    """
    fits = {name: extrapolate(rows, name) for name in MEASURES}
    out = io.StringIO()
    writer = csv.DictWriter(out, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    picture = png_bytes(trends_figure(_trends(study, rows, fits)))
    return {"scales.png": picture, "scales.csv": out.getvalue().encode(),
            "report.html": _page(study, rows, fits, picture)}  # fmt: skip


def findings(study: Study, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Plain values: of each measure the limit and the slopes, and of each setting the change against the real one."""
    return [_finding(fit, rows) for fit in (extrapolate(rows, name) for name in MEASURES)]


def _finding(fit: Extrapolation, rows: list[dict[str, Any]]) -> dict[str, Any]:
    settings = _settings(rows)
    real = settings[0].real

    def told(of: Setting, against: Setting) -> dict[str, Any]:
        value, low, high = fit.change(of, against)
        return {"change": value, "interval": [low, high], "verdict": fit.verdict(of, against)}

    return {
        "measure": fit.name,
        "limit": fit.limit,
        "limit_error": fit.limit_error,
        "slope_inertial_number": float(fit.slopes[0]),
        "slope_inverse_kappa": float(fit.slopes[1]),
        "slope_errors": fit.errors.tolist(),
        "scatter_of_runs": fit.scatter[0],
        "scatter_of_beds": fit.scatter[1],
        "freedom": list(fit.freedom),
        "settings": [
            {"rate_factor": s.rate_factor, "stiffness_factor": s.stiffness_factor,
             "inertial_number": s.inertial_number, "kappa": 1.0 / s.inverse_kappa, **told(s, real),
             "rate_alone": told(s, s.changed(1.0, s.stiffness_factor))}
            for s in settings
        ],
    }  # fmt: skip


def _settings(rows: Sequence[dict[str, Any]]) -> list[Setting]:
    """Settings of the study, with the numbers of the first specimen, the base first."""
    found: dict[tuple[float, float], Setting] = {}
    for row in rows:
        setting = Setting.of(row)
        found.setdefault((setting.rate_factor, setting.stiffness_factor), setting)
    return list(found.values())


def _trends(study: Study, rows: list[dict[str, Any]], fits: dict[str, Extrapolation]) -> list[Trend]:
    base = {"rate_factor": study.rate_factors[0], "stiffness_factor": study.stiffness_factors[0]}
    trends = []
    for axis, number, other in ((0, "inertial_number", "stiffness_factor"), (1, "inverse_kappa", "rate_factor")):
        fit = fits["compacted_density"]
        along = [row for row in rows if row[other] == base[other]]
        seeds = sorted({row["seed"] for row in along})
        of_seed = [[row for row in along if row["seed"] == seed] for seed in seeds]
        values = [(np.array([r[number] for r in group]), np.array([r["compacted_density"] for r in group]))
                  for group in of_seed]  # fmt: skip
        real = Setting.of(along[0]).real
        trends.append(Trend(
            title=("inertial number I of the median stone", "overlap over radius, 1 / kappa")[axis],
            values=values, slope=float(fit.slopes[axis]),
            mark=(real.inertial_number, real.inverse_kappa)[axis],
            labels=[f"specimen {k + 1}" for k in range(len(seeds))],
        ))  # fmt: skip
    return trends


def _page(study: Study, rows: list[dict[str, Any]], fits: dict[str, Extrapolation], picture: bytes) -> bytes:
    page = Page("The gyratory compactor: what a faster mould and softer stones change")
    page.add(Bullets(tuple(_sentence(fit, rows) for fit in fits.values())))
    page.section("Packing density after gyration", Picture(
        picture, "Each point a run; lines: the common slopes; dashed: 30 gyrations a minute, 55 GPa."))  # fmt: skip
    page.section("Slopes", Paragraph(
        "y = c_seed + a I + b / kappa: a among runs that begin to gyrate from the same bed, b among beds. In all runs "
        "of a specimen the stones fall with the same stiffness, and have their own from the pressing on."),
        _slopes(fits.values()))  # fmt: skip
    page.section("Rate alone", Paragraph(
        "Change against 30 gyrations a minute with the same stones."), _rates(rows, fits))  # fmt: skip
    page.section("Settings", Paragraph(
        "Change against 30 gyrations a minute and 55 GPa by that line, with an interval of 90 %. Safe: the interval is "
        "within the margin; biased: it lies outside; open: neither."), _changes(rows, fits))  # fmt: skip
    page.section("Runs", Table(("", "value"), tuple((key, str(value)) for key, value in study.settings().items())))
    return page.to_bytes()


def _sentence(fit: Extrapolation, rows: Sequence[dict[str, Any]]) -> str:
    base = _settings(rows)[0]
    value, low, high = fit.change(base, base.real)
    said = {"safe": "does not matter", "biased": "matters", "open": "may matter or not"}[fit.verdict(base, base.real)]
    return (
        f"{MEASURES[fit.name].capitalize()}: {base.rate_factor:g} times the rate and {base.stiffness_factor:g} of the "
        f"stiffness change it by {value:+.4f} (90 % from {low:+.4f} to {high:+.4f}), which {said} at a margin of "
        f"{MARGINS[fit.name]:g}; at no rate and no overlap it is {fit.limit:.4f} +- {fit.limit_error:.4f}."
    )


def _slopes(fits: Iterable[Extrapolation]) -> Table:
    lines = []
    for fit in fits:
        told = [f"{a:+.2f} +- {e:.2f}" if n else "cannot" for a, e, n in zip(fit.slopes, fit.errors, fit.freedom,
                                                                             strict=True)]  # fmt: skip
        scatter = [f"{s:.4f} ({n})" if n else "-" for s, n in zip(fit.scatter, fit.freedom, strict=True)]
        lines.append((MEASURES[fit.name], f"{fit.limit:.4f} +- {fit.limit_error:.4f}", *told, *scatter))
    head = ("", "limit", "a", "b", "scatter of runs (freedom)", "of beds (freedom)")
    return Table(head, tuple(lines), texts=(0,))


def _rates(rows: Sequence[dict[str, Any]], fits: dict[str, Extrapolation]) -> Table:
    base = _settings(rows)[0]
    lines = []
    for s in _settings(rows):
        if s.stiffness_factor == base.stiffness_factor:
            cells: list[Any] = [f"{s.rate_factor:g}", f"{s.inertial_number:.1e}"]
            for name in _AFTER:
                cells += _cells(fits[name], s, s.changed(1.0, s.stiffness_factor))
            lines.append(tuple(cells))
    head = ["rate factor", "I"]
    for name in _AFTER:
        head += [MEASURES[name], ""]
    return Table(tuple(head), tuple(lines))


def _cells(fit: Extrapolation, of: Setting, against: Setting) -> list[Any]:
    value, low, high = fit.change(of, against)
    verdict = fit.verdict(of, against)
    return [f"{value:+.4f} ({low:+.4f} to {high:+.4f})", Cell(verdict, _TONES[verdict])]


def _changes(rows: Sequence[dict[str, Any]], fits: dict[str, Extrapolation]) -> Table:
    lines = []
    for s in _settings(rows):
        cells: list[Any] = [f"{s.rate_factor:g}", f"{s.stiffness_factor:g}", f"{s.inertial_number:.1e}",
                            f"{1.0 / s.inverse_kappa:.0f}"]  # fmt: skip
        for fit in fits.values():
            cells += _cells(fit, s, s.real)
        lines.append(tuple(cells))
    head = ["rate factor", "stiffness factor", "I", "kappa"]
    for fit in fits.values():
        head += [MEASURES[fit.name], ""]
    return Table(tuple(head), tuple(lines))
