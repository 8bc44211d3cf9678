"""What a match found, as text for a terminal and as plain values."""

from __future__ import annotations

from typing import Any

from lithoform.descriptors.table import FOUR
from lithoform.matching.judging import LEVEL, Verdict
from lithoform.matching.match import Match

__all__ = ["as_dict", "as_text"]

_LABELS = {"roundness": "roundness", "boxiness": "boxiness", "solidity": "solidity", "true_sphericity": "TS"}


def as_dict(match: Match) -> dict[str, Any]:
    """Plain values of a match, for JSON."""
    found = match.search
    return {
        "fitted": len(match.fitted),
        "held_out": len(match.held_out),
        "held_out_rows": match.held_out.tolist(),
        "passed": match.held.is_passed,
        "resists": match.held.resists,
        "at_limits": found.at_limits(),
        "energy": found.energy,
        "energy_by_chance": found.noise,
        "stones": found.stones,
        "unsound": found.unsound,
        "parameters": {
            s.name: {"scale": s.scale, "median": s.median, "deviation": s.deviation} for s in match.population.spreads
        },
        "held": _verdict(match.held),
        "before": _verdict(match.before),
        "fitted_part_itself": _verdict(match.parts),
        "whole": _verdict(match.whole),
    }


def as_text(match: Match) -> str:
    """Table and sentences for people."""
    found, held = match.search, match.held
    lines = [
        f"{len(match.fitted)} particles fitted, {len(match.held_out)} judged.",
        f"{found.stones} stones made for the search, {held.sizes[1]} made anew to judge.",
        "",
        "Against the particles not fitted, BC beside what chance alone gives:",
        *_table(match),
        "",
        *_sentences(match),
    ]
    return "\n".join(lines)


def _table(match: Match) -> list[str]:
    rows = [["", "before: BC", "p", "after: BC", "chance", "p", "mean shift", "spread"]]
    for name, before, after in zip(FOUR, match.before.descriptors, match.held.descriptors, strict=True):
        old, new = before.index("bhattacharyya"), after.index("bhattacharyya")
        rows.append(
            [
                _LABELS[name],
                f"{old.value:.3f}",
                _p(old.p),
                f"{new.value:.3f}",
                f"{new.floor_mean:.3f}",
                _p(new.p),
                f"{match.held.shifts[name]:+.2f} sd",
                f"x {match.held.spreads[name]:.2f}",
            ]
        )
    for label, kind in (("joint, energy", "energy"), ("joint, kernel", "mmd")):
        old, new = getattr(match.before.joint, kind), getattr(match.held.joint, kind)
        rows.append([label, f"{old.value:.3f}", _p(old.p), f"{new.value:.3f}", f"{new.floor_mean:.3f}", _p(new.p)])
    widths = [max(len(row[i]) for row in rows if i < len(row)) for i in range(len(rows[0]))]
    return [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=False))]).rstrip()
        for row in rows
    ]


def _sentences(match: Match) -> list[str]:
    found, held = match.search, match.held
    lines = []
    if held.is_passed:
        lines.append("The population cannot be told from the particles not fitted.")
    else:
        told = ", ".join(_name(name) for name, p in held.p_values.items() if p <= LEVEL)
        lines.append(f"The population can still be told from the particles not fitted, by: {told}.")
    worst = held.resists
    lines.append(
        f"Most resists: {worst}; mean {held.shifts[worst]:+.2f} standard deviations off, spread times "
        f"{held.spreads[worst]:.2f}."
    )
    ends = found.at_limits()
    if ends:
        lines.append(
            f"At the end of its range: {', '.join(f'{name} ({end})' for name, end in ends.items())}; further the "
            "search cannot go."
        )
    lines.append(
        f"The test is only as sharp as {held.sizes[0]} particles allow: a mean off by {held.detectable:.2f} standard "
        "deviations is found by one test in 4 of 5 cases, smaller shifts more rarely."
    )
    parts = match.parts
    lines.append(
        f"The fitted particles themselves against those judged: p {parts.joint.energy.p:.3f} (energy), "
        f"{parts.joint.mmd.p:.3f} (kernel); the search saw no more than they tell."
    )
    if found.unsound:
        lines.append(f"{found.unsound} of {found.stones} settings tried gave no sound mesh and were left out.")
    lines += ["", "Parameters (median, and deviation on the scale):"]
    lines += [
        f"  {s.name:<22}{s.median:10.4g}  {s.deviation:8.3g}  {s.scale.replace('_', ' ')}"
        for s in match.population.spreads
    ]
    return lines


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "<0.001"


def _name(key: str) -> str:
    return {"joint_energy": "the joint energy test", "joint_mmd": "the joint kernel test"}.get(key, key)


def _verdict(verdict: Verdict) -> dict[str, Any]:
    descriptors = {}
    for name, one in zip(FOUR, verdict.descriptors, strict=True):
        coefficient, distance = one.index("bhattacharyya"), one.index("wasserstein")
        descriptors[name] = {
            "means": list(one.means),
            "deviations": list(one.deviations),
            "bhattacharyya": {
                "value": coefficient.value,
                "by_chance": coefficient.floor_mean,
                "limit": coefficient.floor_limit,
                "p": coefficient.p,
            },
            "wasserstein": {"value": distance.value, "by_chance": distance.floor_mean, "p": distance.p},
            "mean_shift": verdict.shifts[name],
            "spread": verdict.spreads[name],
        }
    tests = {"four": verdict.joint, "four_and_dimensions": verdict.joint_with_dimensions}
    joint = {
        what: {
            kind: {"value": one.value, "by_chance": one.floor_mean, "p": one.p}
            for kind, one in (("energy", pair.energy), ("kernel", pair.mmd))
        }
        for what, pair in tests.items()
    }
    return {
        "sizes": list(verdict.sizes),
        "passed": verdict.is_passed,
        "detectable_shift": verdict.detectable,
        "descriptors": descriptors,
        "joint": joint,
    }
