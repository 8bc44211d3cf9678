"""Claims on how the descriptors follow the parameters, each tested on a sweep and found held or not held.

The rules:

- A descriptor falls (or rises) with a parameter if the rank correlation of its mean curve is at most -0.8 (at least
  0.8), and the 95 % interval of the mean over the seeds of each seed's own rank correlation leaves out 0.
- Its change is the range of the mean curve; the largest is that under any of the parameters of the sweep, over their
  whole axes.  Negligible is at most 10 % of the largest, slight at most 25 %, strong at least 25 %.
- It rebounds if its mean is least inside the range, and from there to the end it rises by at least 10 % of what it fell
  from the start, and in the mean of the seeds by more than the 95 % interval of that rise.
- A threshold holds if the change before it is at most 25 % of the change after it, and it falls after it.
- A descriptor changes most, or between two others, by the sum of its ranges over all parameters; it changes least under
  each parameter if it does under at least 80 % of them.
- The parameters that act most are those with the largest shares of the largest change, averaged over the descriptors.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.errors import SampleError
from lithoform.sensitivity.claims import ALL, CLAIMS, LEADING, Claim
from lithoform.sensitivity.oat import Sweep

__all__ = ["LEAST_CORRELATION", "NEGLIGIBLE", "SLIGHT", "Tendency", "Trend", "tendency", "trends", "trends_to_csv"]

LEAST_CORRELATION: Final = 0.8
NEGLIGIBLE: Final = 0.10
SLIGHT: Final = 0.25
_MOST_AXES: Final = 0.8
_LEAST_POINTS: Final = 2
_LEVEL: Final = 0.95


@dataclass(frozen=True)
class Tendency:
    """How a descriptor follows a parameter over a range.

    Attributes
    ----------
    points : int
    correlation : float
        Spearman's rank correlation of the mean curve with the parameter; 0 of a constant curve.
    seeds_correlation, seeds_low, seeds_high : float
        Mean over the seeds of each seed's own rank correlation, and its 95 % interval (Student).
    seeds, seeds_agreeing : int
        Seeds without a missing stone; those whose correlation has the sign of the mean curve's.
    p : float
        Exact two-sided sign test: the chance that so many seeds agree where nothing tends anywhere.
    change, change_low, change_high : float
        Mean over the seeds of the last value less the first, and its 95 % interval.
    range : float
        Greatest less least value of the mean curve.
    """

    points: int
    correlation: float
    seeds_correlation: float
    seeds_low: float
    seeds_high: float
    seeds: int
    seeds_agreeing: int
    p: float
    change: float
    change_low: float
    change_high: float
    range: float

    def tends(self, sign: int) -> bool:
        """Whether it falls (sign -1) or rises (1), by the rule of this module."""
        ends = (sign * self.seeds_low, sign * self.seeds_high)
        return sign * self.correlation >= LEAST_CORRELATION and min(ends) > 0.0


@dataclass(frozen=True)
class Trend:
    """A claim, and what was found.

    Attributes
    ----------
    claim : Claim
    tendency : Tendency or None
        None where the claim is on all parameters, or fewer than two points have stones.
    share : float
        Range over the largest range of the descriptor; NaN where there is no tendency.
    held : bool
    found : str
        In words.
    """

    claim: Claim
    tendency: Tendency | None
    share: float
    held: bool
    found: str


def tendency(values: np.ndarray, responses: np.ndarray) -> Tendency:
    """How responses follow the values of a parameter.

    Parameters
    ----------
    values : numpy.ndarray, shape (p,)
    responses : numpy.ndarray, shape (p, seeds)
        One descriptor; seeds with a missing stone (NaN) are left out.
    """
    from scipy.stats import binomtest

    whole = responses[:, np.isfinite(responses).all(axis=0)]
    seeds = whole.shape[1]
    mean = whole.mean(axis=1) if seeds else np.full(len(values), np.nan)
    correlation = rank_correlation(values, mean)
    own = np.array([rank_correlation(values, column) for column in whole.T])
    agreeing = int((np.sign(own) == np.sign(correlation)).sum())
    p = float(binomtest(agreeing, seeds).pvalue) if seeds and correlation else 1.0
    centre, low, high = student_interval(own)
    change = student_interval(whole[-1] - whole[0])
    return Tendency(len(values), correlation, centre, low, high, seeds, agreeing, p, *change, float(np.ptp(mean)))


def rank_correlation(x: np.ndarray, y: np.ndarray) -> float:
    """Spearman's rank correlation, shape (n,) each, ties at their mean rank; 0 where one is constant or NaN."""
    from scipy.stats import rankdata

    if len(x) < 2 or not (np.isfinite(x).all() and np.isfinite(y).all()):
        return 0.0
    a, b = (rankdata(z) - 0.5 * (len(z) + 1) for z in (x, y))
    scale = math.sqrt(float((a * a).sum()) * float((b * b).sum()))
    return float((a * b).sum()) / scale if scale > 0.0 else 0.0


def student_interval(values: np.ndarray) -> tuple[float, float, float]:
    """Mean and its 95 % interval (Student), NaN of too few; shape (n,)."""
    from scipy.stats import t

    n = len(values)
    mean = float(values.mean()) if n else math.nan
    half = float(t.ppf(0.5 + 0.5 * _LEVEL, n - 1) * values.std(ddof=1) / math.sqrt(n)) if n > 1 else math.nan
    return mean, mean - half, mean + half


def trends(sweep: Sweep, claims: Sequence[Claim] = CLAIMS) -> list[Trend]:
    """Test claims on a sweep; those on a parameter that it does not have are left out.

    Raises
    ------
    SampleError
        If the sweep has no stone.
    """
    names = [axis.name for axis in sweep.axes]
    if not np.isfinite(sweep.curves.ranges).any():
        raise SampleError("no stone of the sweep could be made: use more triangles.")
    return [_tested(sweep, claim, names) for claim in claims if claim.parameter in (ALL, *names)]


def _tested(sweep: Sweep, claim: Claim, names: list[str]) -> Trend:
    # A parameter without a stone takes no part in what is said of all.
    ranges = np.nan_to_num(sweep.curves.ranges, nan=0.0)
    if claim.parameter == ALL:
        known = np.flatnonzero(np.isfinite(sweep.curves.ranges).all(axis=1))
        held, found = _ranked(claim, ranges[known], [names[i] for i in known])
        return Trend(claim, None, math.nan, held, found)
    axis, column = names.index(claim.parameter), FOUR.index(claim.descriptor)
    values, responses = sweep.values[axis], sweep.responses[axis][..., column]
    largest = float(ranges[:, column].max())
    low, high = (values[0] if claim.low is None else claim.low, values[-1] if claim.high is None else claim.high)
    inside, made = _within(values, float(low), float(high)), np.isfinite(responses).any(axis=1)
    kept, left_out = np.flatnonzero(inside & made), int((inside & ~made).sum())
    if len(kept) < _LEAST_POINTS:
        return Trend(claim, None, math.nan, False, f"only {len(kept)} points with stones")
    found = tendency(values[kept], responses[kept])
    share = found.range / largest if largest > 0.0 else 0.0
    in_size = {"any": True, "negligible": share <= NEGLIGIBLE, "slight": share <= SLIGHT, "strong": share >= SLIGHT}
    way = f"rank correlation {_signed(found.correlation)}, range {found.range:.3f}, {share:.0%} of the largest"
    if left_out:
        way += f"; {left_out} points of which no stone could be made are left out"
    if claim.kind in ("falls", "rises"):
        tends = found.tends(-1 if claim.kind == "falls" else 1)
        return Trend(claim, found, share, tends and in_size[claim.size], way)
    if claim.kind == "changes":
        return Trend(claim, found, share, in_size[claim.size], way)
    if claim.kind == "strongest":
        first = names[int(ranges[:, column].argmax())]
        return Trend(claim, found, share, first == claim.parameter, f"{way}; most under {first}")
    test = _rebound if claim.kind == "rebounds" else _threshold
    held, words = test(values[kept], responses[kept], claim)
    return Trend(claim, found, share, held, words)


def _within(values: np.ndarray, low: float, high: float) -> np.ndarray:
    # The ends are decimals that a grid meets only up to rounding.
    room = 1e-9 * max(float(np.ptp(values)), 1e-300)
    return (values >= low - room) & (values <= high + room)


def _rebound(values: np.ndarray, responses: np.ndarray, claim: Claim) -> tuple[bool, str]:
    whole = responses[:, np.isfinite(responses).all(axis=0)]
    if not whole.shape[1]:
        return False, "no seed has a stone at every point"
    mean = whole.mean(axis=1)
    least = int(mean.argmin())
    rise, low, high = student_interval(whole[-1] - whole[least])
    fall = float(mean[0] - mean[least])
    words = f"least at {values[least]:g}, {fall:.3f} below the start; from there to the end {_signed(rise, 4)}"
    held = 0 < least < len(values) - 1 and low > 0.0 and rise >= NEGLIGIBLE * fall
    return held, f"{words} ({_signed(low, 4)} to {_signed(high, 4)})"


def _threshold(values: np.ndarray, responses: np.ndarray, claim: Claim) -> tuple[bool, str]:
    at = float(values[-1] if claim.at is None else claim.at)
    before = _within(values, float(values[0]), at)
    # The curve after the threshold starts from the last point before it.
    after = ~before
    after[np.flatnonzero(before)[-1:]] = True
    if min(before.sum(), after.sum()) < _LEAST_POINTS:
        return False, f"expected at least {_LEAST_POINTS} points with stones up to {at:g} and from there on"
    parts = [tendency(values[part], responses[part]) for part in (before, after)]
    words = f"range {parts[0].range:.3f} up to {at:g}, {parts[1].range:.3f} after it"
    return parts[0].range <= SLIGHT * parts[1].range and parts[1].tends(-1), words


def _ranked(claim: Claim, ranges: np.ndarray, names: list[str]) -> tuple[bool, str]:
    if claim.kind == "leading":
        shares = (ranges / ranges.max(axis=0)).mean(axis=1)
        first = [names[i] for i in np.argsort(-shares, kind="stable")[: len(LEADING)]]
        others = [name for name in first if name not in LEADING]
        return not others, f"the {len(LEADING)} that act most: {', '.join(first)}"
    column, total = FOUR.index(claim.descriptor), ranges.sum(axis=0)
    told = ", ".join(f"{name} {value:.2f}" for name, value in zip(FOUR, total, strict=True))
    if claim.kind == "between":
        return bool(total[1] < total[column] < total[0]), f"sum of the ranges: {told}"
    order = ranges.argmax(axis=1) if claim.kind == "most" else ranges.argmin(axis=1)
    times = int((order == column).sum())
    if claim.kind == "most":
        held = bool(total.argmax() == column)
    else:
        held = times >= _MOST_AXES * len(names)
    return held, f"under {times} of {len(names)} parameters; sum of the ranges: {told}"


def trends_to_csv(found: Sequence[Trend]) -> bytes:
    """Table with a row a claim."""
    numbers = tuple(Tendency.__dataclass_fields__)
    head = ("parameter", "descriptor", "claim", "kind", "size", "from", "to", *numbers, "share", "held", "found")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    for trend in found:
        claim = trend.claim
        cells: list[Any] = [
            claim.parameter,
            claim.descriptor,
            claim.text,
            claim.kind,
            claim.size,
            claim.low,
            claim.high,
        ]
        cells += [None if trend.tendency is None else getattr(trend.tendency, name) for name in numbers]
        cells += [trend.share, "yes" if trend.held else "no", trend.found]
        writer.writerow(["" if cell is None or cell != cell else cell for cell in cells])
    return out.getvalue().encode()


def _signed(number: float, digits: int = 2) -> str:
    return f"{number:+.{digits}f}"
