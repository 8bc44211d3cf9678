"""Targets: the four descriptors that are asked for, their tolerances and weights, and the mismatch E of eq. 30."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.errors import LithoformError
from lithoform.parameters import suggest

__all__ = ["DEFAULT_TOLERANCE", "Target", "TargetError", "mismatch", "parse_target", "within"]

DEFAULT_TOLERANCE: Final = 0.02
"""Of each descriptor: what the paper's own closed loop reaches at best (0.018 to 0.029)."""

_DEFAULT_WEIGHT: Final = 1.0
_LEAST_TOLERANCE: Final = 1e-6
_MOST_WEIGHT: Final = 1e6
_SYMBOLS: Final = {"R": "roundness", "B": "boxiness", "S3D": "solidity", "S_3D": "solidity", "TS": "true_sphericity"}
_EXAMPLE: Final = "roundness=0.30,boxiness=0.42,solidity=0.90,true_sphericity=0.80"


class TargetError(LithoformError, ValueError):
    """A target, a tolerance or a weight is not one that a stone could have."""


@dataclass(frozen=True)
class Target:
    """What stones shall measure.

    Attributes
    ----------
    values : tuple of 4 floats
        In the order of `FOUR`: roundness, boxiness, solidity, true sphericity; NaN where nothing is asked.
    tolerance : tuple of 4 floats
        t of eq. 30, above 0: the half width of the band that counts as met.
    weights : tuple of 4 floats
        w of eq. 30, at least 0; 0 where nothing is asked.

    Raises
    ------
    TargetError
        If no body has such values, or a tolerance or a weight is out of its range.
    """

    values: tuple[float, float, float, float]
    tolerance: tuple[float, float, float, float] = (
        DEFAULT_TOLERANCE,
        DEFAULT_TOLERANCE,
        DEFAULT_TOLERANCE,
        DEFAULT_TOLERANCE,
    )
    weights: tuple[float, float, float, float] = (_DEFAULT_WEIGHT, _DEFAULT_WEIGHT, _DEFAULT_WEIGHT, _DEFAULT_WEIGHT)

    def __post_init__(self) -> None:
        for name in ("values", "tolerance", "weights"):
            numbers = tuple(float(value) for value in getattr(self, name))
            if len(numbers) != len(FOUR):
                raise TargetError(f"expected four numbers for {', '.join(FOUR)}; got {len(numbers)}.")
            object.__setattr__(self, name, numbers)
        weights = tuple(0.0 if math.isnan(v) else w for v, w in zip(self.values, self.weights, strict=True))
        object.__setattr__(self, "weights", weights)
        for name, value, tolerance, weight in zip(FOUR, self.values, self.tolerance, weights, strict=True):
            if not math.isnan(value) and not 0.0 < value <= 1.0:
                raise TargetError(f"{name} is above 0 and at most 1 for every body; got {value:g}.")
            if not _LEAST_TOLERANCE <= tolerance <= 1.0:
                raise TargetError(f"the tolerance of {name} must be {_LEAST_TOLERANCE:g} to 1; got {tolerance:g}.")
            if weight != 0.0 and not 1.0 / _MOST_WEIGHT <= weight <= _MOST_WEIGHT:
                raise TargetError(f"the weight of {name} must be 0, or {1.0 / _MOST_WEIGHT:g} to {_MOST_WEIGHT:g}; got "
                                  f"{weight:g}.")  # fmt: skip
        if not any(weights):
            raise TargetError(f"a target asks for at least one descriptor with a weight above 0, such as {_EXAMPLE}.")
        boxiness, solidity = self.values[1], self.values[2]
        if boxiness > solidity:
            raise TargetError(
                "no body has a boxiness above its solidity, since its hull lies within its box; got "
                f"{boxiness:g} and {solidity:g}."
            )

    @property
    def asked(self) -> np.ndarray:
        """Which descriptors are asked for, shape (4,), bool."""
        return np.array(self.weights) > 0.0

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Value, tolerance and weight of the descriptors that are asked for."""
        rows = zip(FOUR, self.values, self.tolerance, self.weights, strict=True)
        return {n: {"value": v, "tolerance": t, "weight": w} for n, v, t, w in rows if w > 0.0}

    def normalised(self) -> Target:
        """The same with a largest weight of 1: what is best does not depend on the unit of the weights."""
        largest = max(self.weights)
        return Target(self.values, self.tolerance, tuple(w / largest for w in self.weights))  # type: ignore[arg-type]

    def without(self, descriptor: int) -> Target:
        """The same, not asking for one descriptor."""
        values = list(self.values)
        values[descriptor] = math.nan
        return Target(tuple(values), self.tolerance, self.weights)  # type: ignore[arg-type]


def parse_target(text: str, tolerance: str | None = None, weights: str | None = None) -> Target:
    """Target of a line of text.

    Parameters
    ----------
    text : str
        NAME=VALUE with commas between; names of descriptors, or R, B, S3D, TS.  What is not named has the weight 0.
    tolerance, weights : str, optional
        One number for all, or NAME=VALUE with commas between; 0.02 and 1 where nothing is given.

    Returns
    -------
    Target

    Raises
    ------
    TargetError
        If a name is unknown or given twice, a number cannot be read, or no body has such values.
    """
    values = _pairs("target", text)
    return Target(
        _four(values, math.nan),
        _option("tolerance", tolerance, DEFAULT_TOLERANCE, values),
        _option("weights", weights, _DEFAULT_WEIGHT, values),
    )


def mismatch(descriptors: np.ndarray, target: Target) -> np.ndarray:
    """E of eq. 30, the weighted distance of descriptors from a target in units of the tolerances.

        E = ( sum_d (w_d (y_d - y*_d) / t_d)^2 )^(1/2)

    Parameters
    ----------
    descriptors : numpy.ndarray, shape (n, 4)
    target : Target

    Returns
    -------
    numpy.ndarray, shape (n,)
    """
    asked = target.asked
    scale = np.array(target.weights)[asked] / np.array(target.tolerance)[asked]
    away = (np.asarray(descriptors, dtype=np.float64)[:, asked] - np.array(target.values)[asked]) * scale
    return np.sqrt((away**2).sum(axis=1))


def within(descriptors: np.ndarray, target: Target) -> np.ndarray:
    """Whether all descriptors that are asked for are within their tolerance at once.

    Parameters
    ----------
    descriptors : numpy.ndarray, shape (n, 4)
    target : Target

    Returns
    -------
    numpy.ndarray of bool, shape (n,)
    """
    asked = target.asked
    away = np.abs(np.asarray(descriptors, dtype=np.float64)[:, asked] - np.array(target.values)[asked])
    met: np.ndarray = np.all(away <= np.array(target.tolerance)[asked], axis=1)
    return met


def _pairs(what: str, text: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for word in text.split(","):
        name, equals, value = (part.strip() for part in word.partition("="))
        if not equals:
            raise TargetError(
                f"expected the {what} as NAME=VALUE with commas between, such as {_EXAMPLE}; got {text!r}."
            )
        full = _SYMBOLS.get(name, name)
        if full not in FOUR:
            why = " it is measured, but not designed for;" if full in DESCRIPTORS else ""
            raise TargetError(f"expected one of {', '.join(FOUR)} (or R, B, S3D, TS) in the {what};{why} got {name!r}."
                              f"{suggest(name, (*FOUR, *_SYMBOLS))}")  # fmt: skip
        if full in found:
            raise TargetError(f"{full} is given twice in the {what}; keep one of them.")
        found[full] = _number(f"{full} in the {what}", value)
    return found


def _option(what: str, text: str | None, default: float, asked: Mapping[str, float]) -> Any:
    if text is None:
        return (default,) * len(FOUR)
    if "=" not in text:
        return (_number(f"the {what}", text.strip()),) * len(FOUR)
    given = _pairs(what, text)
    for name in given:
        if name not in asked:
            raise TargetError(f"the {what} names {name}, which the target does not; name it in both.")
    return _four(given, default)


def _four(given: Mapping[str, float], default: float) -> Any:
    return tuple(given.get(name, default) for name in FOUR)


def _number(what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise TargetError(f"expected a number for {what}; got {text!r}.") from None
    if not math.isfinite(value):
        raise TargetError(f"expected a finite number for {what}; got {text!r}.")
    return value
