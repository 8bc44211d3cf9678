"""Calibration by PCA or by the axis-aligned box, and the twist from 0 to 60 degrees, in the four classes (Fig. 5)."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.errors import RecipeError
from lithoform.presets import SHAPE_CLASSES
from lithoform.sensitivity.designs import Design
from lithoform.sensitivity.oat import mean_with_band
from lithoform.sensitivity.trends import student_interval, tendency

__all__ = ["CLASS_RATIOS", "FRAMES", "SMALL_EFFECT", "Finding", "TwistDesign", "findings", "findings_to_csv",
           "twist_to_csv"]  # fmt: skip

FRAMES: Final = ("pca", "aabb")

CLASS_RATIOS: Final = {"cube": (5 / 6, 5 / 6), "plate": (5 / 6, 0.5), "column": (0.5, 5 / 6), "blade": (0.5, 0.5)}
"""EI = W / L and FI = H / W in the middle of each class."""

SMALL_EFFECT: Final = 0.2
"""A difference of at most so many standard deviations from stone to stone is negligible (Cohen 1988)."""

_R, _B, _S, _TS = FOUR
_CALIBRATION: Final = (
    ("cube", _R, -1), ("cube", _TS, 1), ("plate", _R, 1), ("plate", _TS, -1), ("column", _R, -1), ("column", _TS, -1),
    ("blade", _R, -1), ("blade", _TS, -1), *((name, d, 0) for d in (_B, _S) for name in SHAPE_CLASSES),
)  # fmt: skip
"""What section 4 says of the box less PCA: class, descriptor, sign (0 is negligible)."""

_TWIST: Final = ((_R, 1), (_TS, -1), (_B, 0), (_S, -1))
"""What it says of a growing twist in every class: descriptor, sign (0 is no tendency)."""

_ROBUST: Final = ("cube", "plate")


@dataclass(frozen=True, eq=False, kw_only=True)
class TwistDesign(Design):
    """The four classes, both calibrations, rates of twist; the rest is the base.

    Attributes
    ----------
    rates : tuple of float
        [deg per model unit], rising.

    Notes
    -----
    Points go class by class, calibration by calibration, rate by rate.
    """

    rates: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)

    def __post_init__(self) -> None:
        if len(self.rates) < 2 or list(self.rates) != sorted(set(self.rates)):
            raise RecipeError(f"expected at least 2 rates of twist, rising; got {self.rates}.")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Classes, calibrations and rates."""
        return len(CLASS_RATIOS), len(FRAMES), len(self.rates)

    @property
    def point_count(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    def settings(self, point: int) -> dict[str, Any]:
        """Dimensions, calibration and twist of a point (from 0)."""
        first, frame, rate = np.unravel_index(point, self.shape)
        elongation, flatness = CLASS_RATIOS[SHAPE_CLASSES[int(first)]]
        return {
            "elongation": elongation, "flatness": flatness, "calibration_frame": FRAMES[int(frame)],
            "twist_rate": self.rates[int(rate)],
        }  # fmt: skip

    def told(self) -> dict[str, Any]:
        """What was asked for."""
        return {"design": "calibration and twist", "rates": list(self.rates), "ratios": CLASS_RATIOS}


@dataclass(frozen=True)
class Finding:
    """A claim of section 4 on the calibration or the twist, and what was found.

    Attributes
    ----------
    shape_class, descriptor, text : str
    estimate, low, high : float
        Of a calibration the mean difference, box less PCA, over seeds and rates; of a twist the change of the
        descriptor from the first to the last rate under PCA; with the 95 % interval over the seeds.
    measure : float
        Of a calibration the difference over the standard deviation from stone to stone; of a twist the rank
        correlation of the mean with the rate.
    held : bool
    """

    shape_class: str
    descriptor: str
    text: str
    estimate: float
    low: float
    high: float
    measure: float
    held: bool


def findings(rates: Sequence[float], values: np.ndarray) -> list[Finding]:
    """Test what section 4 says of Fig. 5.

    Parameters
    ----------
    rates : sequence of float
        [deg per model unit]
    values : numpy.ndarray, shape (4 classes, 2 calibrations, rates, seeds, 4)
        In the orders of `SHAPE_CLASSES`, `FRAMES` and `FOUR`; a seed with a missing stone (NaN) is left out.
    """
    kept = values[..., np.isfinite(values).all(axis=(0, 1, 2, 4)), :]
    found = [_calibration(kept, *row) for row in _CALIBRATION]
    found += [_twist(np.array(rates), kept, name, *row) for name in SHAPE_CLASSES for row in _TWIST]
    for descriptor, sign in ((_R, 1), (_TS, -1)):
        column = FOUR.index(descriptor)
        change = kept[:, 0, -1, :, column] - kept[:, 0, 0, :, column]
        robust = max(sign * float(change[SHAPE_CLASSES.index(name)].mean()) for name in _ROBUST)
        for name in ("column", "blade"):
            own = student_interval(change[SHAPE_CLASSES.index(name)])
            text = f"{'rises' if sign > 0 else 'falls'} more with the twist than in {' and '.join(_ROBUST)}"
            held = sign * own[0] > robust and min(sign * own[1], sign * own[2]) > 0.0
            found.append(Finding(name, descriptor, text, *own, math.nan, held))
    return found


def _calibration(values: np.ndarray, name: str, descriptor: str, sign: int) -> Finding:
    row = values[SHAPE_CLASSES.index(name)][..., FOUR.index(descriptor)]
    difference = (row[1] - row[0]).mean(axis=0)
    estimate, low, high = student_interval(difference)
    scatter = math.sqrt(float(row.var(axis=-1, ddof=1).mean()))
    effect = estimate / scatter if scatter > 0.0 else 0.0
    if sign == 0:
        held, text = abs(effect) <= SMALL_EFFECT, "does not depend on the calibration"
    else:
        held = min(sign * low, sign * high) > 0.0
        text = f"is {'higher' if sign > 0 else 'lower'} by the box than by PCA"
    return Finding(name, descriptor, text, estimate, low, high, effect, held)


def _twist(rates: np.ndarray, values: np.ndarray, name: str, descriptor: str, sign: int) -> Finding:
    found = tendency(rates, values[SHAPE_CLASSES.index(name), 0, ..., FOUR.index(descriptor)])
    if sign == 0:
        held, text = not (found.tends(1) or found.tends(-1)), "has no tendency with the twist"
    else:
        held, text = found.tends(sign), f"{'rises' if sign > 0 else 'falls'} with the twist"
    return Finding(name, descriptor, text, found.change, found.change_low, found.change_high, found.correlation, held)


def findings_to_csv(found: Sequence[Finding]) -> bytes:
    """Table with a row a claim."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["class", "descriptor", "claim", "estimate", "low", "high", "measure", "held"])
    for row in found:
        numbers = ["" if math.isnan(x) else x for x in (row.estimate, row.low, row.high, row.measure)]
        writer.writerow([row.shape_class, row.descriptor, row.text, *numbers, "yes" if row.held else "no"])
    return out.getvalue().encode()


def twist_to_csv(rates: Sequence[float], values: np.ndarray) -> bytes:
    """Means over the seeds, a row a class, a calibration and a rate; values as `findings` takes them."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    moments = ("mean", "deviation", "low", "high")
    writer.writerow(["class", "calibration", "twist_rate", "stones", *(f"{n}_{m}" for n in FOUR for m in moments)])
    for i, name in enumerate(SHAPE_CLASSES):
        for j, frame in enumerate(FRAMES):
            *parts, stones = mean_with_band(values[i, j])
            for k, rate in enumerate(rates):
                cells = np.stack([part[k] for part in parts], axis=1).ravel().tolist()
                writer.writerow([name, frame, rate, int(stones[k]), *("" if math.isnan(x) else x for x in cells)])
    return out.getvalue().encode()
