"""Claims of section 4: Fig. 4 to 7."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.presets import SHAPE_CLASSES
from lithoform.reproduce.claims import Finding, decided, judged, number, read_rows
from lithoform.sensitivity.claims import CLAIMS

__all__ = ["STATEMENTS_OF_FIGURE_5", "figure_4", "figure_5", "figure_6", "figure_7"]

STATEMENTS_OF_FIGURE_5: Final = 36
_PRESERVED: Final = 0.01
"""Mean change of a descriptor that keeps it, relative."""

_LEVELS: Final = (20_000, 5_000)
_ROUNDNESS: Final = "the roundness has a stated scale, where the paper's measures the mesh"
_CASE: Final = "paper's targets, published roundness"


def _compared(pair: tuple[float, float], above: bool = True) -> bool | None:
    a, b = pair
    return None if math.isnan(a) or math.isnan(b) else (a > b if above else a < b)


def figure_4(folder: Path | None) -> list[Finding]:
    """Mesh simplification, Fig. 4b; of no folder the claims as not run."""
    drift: dict[tuple[str, int, str], float] = {}
    if folder is not None:
        rows = read_rows(folder / "fig4b.csv", ("class", "triangles", *(f"{name}_drift" for name in FOUR)))
        drift = {
            (row["class"], round(number(row["triangles"])), name): number(row[f"{name}_drift"])
            for row in rows
            for name in FOUR
            if row["triangles"]
        }

    def of(shape: str, level: int, name: str) -> float:
        return drift.get((shape, level, name), math.nan)

    def size(name: str, level: int) -> float:
        return float(np.mean([abs(of(shape, level, name)) for shape in SHAPE_CLASSES]))

    fine, coarse = _LEVELS
    sizes = {name: size(name, coarse) for name in FOUR}
    told = ", ".join(f"{name} {100 * value:.2f} %" for name, value in sizes.items())
    rises = {
        shape: [_compared((of(shape, fine, "roundness"), 0.0)),
                _compared((of(shape, coarse, "roundness"), of(shape, fine, "roundness")))]
        for shape in SHAPE_CLASSES
    }  # fmt: skip
    slender, stout = (
        float(np.mean([of(shape, coarse, "roundness") for shape in pair]))
        for pair in (("column", "blade"), ("cube", "plate"))
    )
    up = {name: [of(shape, coarse, name) for shape in SHAPE_CLASSES] for name in ("solidity", "true_sphericity")}
    keep = [[abs(of(shape, fine, name)) for shape in SHAPE_CLASSES] for name in FOUR]
    lowest = "; ".join(f"{name} from {100 * min(row):+.2f} to {100 * max(row):+.2f} %" for name, row in up.items())
    roundness = [f"{shape} {100 * of(shape, fine, 'roundness'):+.2f}, {100 * of(shape, coarse, 'roundness'):+.2f} %"
                 for shape in SHAPE_CLASSES]  # fmt: skip
    others = [sizes[name] for name in FOUR]
    claims = [
        ("boxiness varies least of the four under simplification",
         decided(_compared((sizes[n], sizes["boxiness"])) for n in FOUR if n != "boxiness"), told,
         "mean size of the drift at 5,000 triangles over the classes is least"),
        ("roundness is the most sensitive of the four to the resolution",
         decided(_compared((sizes["roundness"], sizes[n])) for n in FOUR if n != "roundness"), told,
         "mean size of the drift at 5,000 triangles over the classes is largest"),
        ("roundness rises monotonically as the mesh is simplified",
         decided(one for pair in rises.values() for one in pair), "; ".join(roundness),
         "in each class 0 < drift at 20,000 < drift at 5,000 triangles"),
        ("roundness rises most in columns and blades", _compared((slender, stout)),
         f"columns and blades {100 * slender:+.2f} %, cubes and plates {100 * stout:+.2f} %",
         "mean drift at 5,000 triangles is larger"),
        ("3D solidity and true sphericity drift upwards at very coarse resolution",
         decided(_compared((value, 0.0)) for row in up.values() for value in row), lowest,
         "drift at 5,000 triangles above 0 in each class"),
        ("20,000 triangles preserve the descriptors",
         decided(_compared((value, _PRESERVED), above=False) for row in keep for value in row),
         f"largest mean drift {100 * max(map(max, keep)):.2f} %",
         "mean drift at 20,000 triangles at most 1 % in each class and descriptor"),
    ]  # fmt: skip
    missing = folder is None
    return [
        Finding(item="fig4", claim=claim, verdict="not run" if missing else judged(truth),
                ours="" if missing or any(map(math.isnan, others)) else text, criterion=criterion,
                condition=_ROUNDNESS if "roundness" in claim else "")
        for claim, truth, text, criterion in claims
    ]  # fmt: skip


def figure_5(folder: Path | None) -> list[Finding]:
    """Calibration and twist, as `lithoform.sensitivity.twist` judges them."""
    criterion = "the rules of lithoform.sensitivity.twist"
    if folder is None:
        text = f"the {STATEMENTS_OF_FIGURE_5} statements on calibration and twist"
        return [Finding(item="fig5", claim=text, verdict="not run", criterion=criterion)]
    columns = ("class", "descriptor", "claim", "estimate", "low", "high", "held")
    found = []
    for row in read_rows(folder / "fig5_claims.csv", columns):
        estimate, low, high = (number(row[name]) for name in ("estimate", "low", "high"))
        ours = f"{estimate:+.4f} ({low:+.4f} to {high:+.4f})"
        found.append(Finding(item="fig5", claim=f"{row['class']}: {row['descriptor']} {row['claim']}",
                             verdict=judged(_held(row["held"])), ours=ours, criterion=criterion,
                             condition=_ROUNDNESS if row["descriptor"] == "roundness" else ""))  # fmt: skip
    return found


def figure_6(folder: Path | None) -> list[Finding]:
    """The 15 parameters, as `lithoform.sensitivity.trends` judges them."""
    criterion = "the rules of lithoform.sensitivity.trends"

    def condition(descriptor: str) -> str:
        return _ROUNDNESS if descriptor in ("roundness", "all") else ""

    if folder is None:
        return [
            Finding(item="fig6", claim=f"{one.parameter}: {one.descriptor} {one.text}", verdict="not run",
                    criterion=criterion, condition=condition(one.descriptor))
            for one in CLAIMS
        ]  # fmt: skip
    rows = read_rows(folder / "fig6_trends.csv", ("parameter", "descriptor", "claim", "held", "found"))
    return [
        Finding(item="fig6", claim=f"{row['parameter']}: {row['descriptor']} {row['claim']}",
                verdict=judged(_held(row["held"])), ours=row["found"], criterion=criterion,
                condition=condition(row["descriptor"]))
        for row in rows
    ]  # fmt: skip


def _held(text: str) -> bool | None:
    return {"yes": True, "no": False}.get(text)


def figure_7(folder: Path | None) -> list[Finding]:
    """The closed loop over the paper's three targets: mean errors no larger than the paper's."""
    errors: dict[str, list[float]] = {name: [] for name in FOUR}
    paper: dict[str, float] = dict.fromkeys(FOUR, math.nan)
    if folder is not None:
        for row in read_rows(folder / "fig7.csv", ("case", "descriptor", "error", "error_of_the_paper")):
            if row["case"] == _CASE and row["descriptor"] in errors:
                errors[row["descriptor"]].append(number(row["error"]))
                paper[row["descriptor"]] = number(row["error_of_the_paper"])
    found = []
    for name in FOUR:
        mean = float(np.mean(errors[name])) if errors[name] else math.nan
        truth = None if math.isnan(mean) or math.isnan(paper[name]) else mean <= paper[name]
        found.append(Finding(
            item="fig7", claim=f"the closed loop reaches its targets: mean error of {name}",
            verdict="not run" if folder is None else judged(truth),
            ours="" if math.isnan(mean) else f"{mean:.4f} over {len(errors[name])} targets",
            paper="" if math.isnan(paper[name]) else f"{paper[name]:g}",
            criterion="at most the paper's, in the paper's roundness",
            condition="found by our search, not by the paper's route; means of ten seeds instead of three",
        ))  # fmt: skip
    return found
