"""One parameter at a time: the curves of the descriptors over each axis (Fig. 6), and the file that keeps them."""

from __future__ import annotations

import csv
import io
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from lithoform.axes import Axis, axis_values
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, LithoformError
from lithoform.lazy import cached_property
from lithoform.sensitivity.designs import OneAtATime
from lithoform.sensitivity.responses import Responses

__all__ = ["Curves", "Sweep", "mean_with_band", "read_curves", "sweep_of"]

_LEVEL: Final = 0.95
_BENCHMARK: Final = "benchmark"
_COLUMNS: Final = ("parameter", "symbol", "scale", "low", "high", "benchmark", "value", "stones")
_MOMENTS: Final = ("mean", "deviation", "low", "high")


@dataclass(frozen=True, eq=False)
class Curves:
    """Mean response of the four descriptors to each axis, the others at the base.

    Attributes
    ----------
    axes : tuple of Axis
    base : tuple of float
        Value of the base on each axis.
    values : tuple of numpy.ndarray
        Of each axis, shape (p,), rising.
    mean, deviation, low, high : tuple of numpy.ndarray
        Of each axis, shape (p, 4) in the order of `FOUR`: mean over the stones, standard deviation with n - 1, and the
        95 % interval of the mean.
    stones : tuple of numpy.ndarray
        Of each axis, shape (p,): stones that were made.
    baseline, baseline_deviation : numpy.ndarray, shape (4,)
        Of the base.
    baseline_stones : int
    """

    axes: tuple[Axis, ...]
    base: tuple[float, ...]
    values: tuple[np.ndarray, ...]
    mean: tuple[np.ndarray, ...]
    deviation: tuple[np.ndarray, ...]
    low: tuple[np.ndarray, ...]
    high: tuple[np.ndarray, ...]
    stones: tuple[np.ndarray, ...]
    baseline: np.ndarray
    baseline_deviation: np.ndarray
    baseline_stones: int

    @cached_property
    def ranges(self) -> np.ndarray:
        """Greatest less least mean on each axis, shape (axes, 4); NaN where no point has a stone."""
        known = [mean[np.isfinite(mean).all(axis=1)] for mean in self.mean]
        return np.array([np.ptp(mean, axis=0) if len(mean) else np.full(len(FOUR), np.nan) for mean in known])

    def to_csv(self) -> bytes:
        """Table with a row a point, the base first; numbers with all their digits."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([*_COLUMNS, *(f"{name}_{what}" for name in FOUR for what in _MOMENTS)])
        low, high = _interval(self.baseline, self.baseline_deviation, np.array(float(self.baseline_stones)))
        moments = np.stack([self.baseline, self.baseline_deviation, low, high], axis=1).ravel().tolist()
        writer.writerow([_BENCHMARK, *[""] * (len(_COLUMNS) - 2), self.baseline_stones, *_written(moments)])
        for i, axis in enumerate(self.axes):
            head = [axis.name, axis.symbol, axis.scale, float(axis.low), float(axis.high), self.base[i]]
            for j, value in enumerate(self.values[i].tolist()):
                moments = np.stack([part[i][j] for part in (self.mean, self.deviation, self.low, self.high)], axis=1)
                writer.writerow([*head, value, int(self.stones[i][j]), *_written(moments.ravel().tolist())])
        return out.getvalue().encode()


@dataclass(frozen=True, eq=False)
class Sweep:
    """Responses of a sweep, stone by stone.

    Attributes
    ----------
    axes : tuple of Axis
    base : tuple of float
        Value of the base on each axis.
    values : tuple of numpy.ndarray
        Of each axis, shape (p,).
    responses : tuple of numpy.ndarray
        Of each axis, shape (p, seeds, 4); NaN where no stone could be made.
    baseline : numpy.ndarray, shape (seeds, 4)
    """

    axes: tuple[Axis, ...]
    base: tuple[float, ...]
    values: tuple[np.ndarray, ...]
    responses: tuple[np.ndarray, ...]
    baseline: np.ndarray

    @cached_property
    def curves(self) -> Curves:
        """Means and bands."""
        parts = [mean_with_band(response) for response in self.responses]
        mean, deviation, low, high, stones = (tuple(column) for column in zip(*parts, strict=True))
        base_mean, base_deviation, _, _, base_stones = mean_with_band(self.baseline[None])
        return Curves(self.axes, self.base, self.values, mean, deviation, low, high, stones, base_mean[0],
                      base_deviation[0], int(base_stones[0]))  # fmt: skip


def sweep_of(design: OneAtATime, responses: Responses) -> Sweep:
    """Responses of a one-at-a-time design, axis by axis."""
    names = tuple(axis.name for axis in design.axes)
    base = axis_values(design.base, names)
    places = [design.points_of(i) for i in range(len(design.axes))]
    return Sweep(
        design.axes,
        tuple(base[name] for name in names),
        tuple(np.array(design.values(i), dtype=np.float64) for i in range(len(design.axes))),
        tuple(responses.values[place.start : place.stop] for place in places),
        responses.values[0],
    )


def mean_with_band(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean, standard deviation, 95 % interval of the mean, and number of the stones that were made.

    Parameters
    ----------
    values : numpy.ndarray, shape (points, seeds, d)
        NaN where no stone could be made.

    Returns
    -------
    mean, deviation, low, high : numpy.ndarray, shape (points, d)
        The interval is Student's; NaN where the stones are too few.
    stones : numpy.ndarray, shape (points,)
    """
    there: np.ndarray = np.all(np.isfinite(values), axis=2)
    stones = there.sum(axis=1)
    count = stones[:, None].astype(np.float64)
    kept = np.where(there[..., None], values, 0.0)
    mean = kept.sum(axis=1) / np.where(count > 0.0, count, np.nan)
    squares = np.where(there[..., None], (values - mean[:, None]) ** 2, 0.0).sum(axis=1)
    deviation = np.sqrt(squares / np.where(count > 1.0, count - 1.0, np.nan))
    low, high = _interval(mean, deviation, count)
    return mean, deviation, low, high, stones


def _interval(mean: np.ndarray, deviation: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from scipy.stats import t

    enough = count > 1.0
    factor = t.ppf(0.5 + 0.5 * _LEVEL, np.where(enough, count - 1.0, 1.0)) / np.sqrt(np.where(enough, count, 1.0))
    half = np.where(enough, factor, np.nan) * deviation
    return mean - half, mean + half


def read_curves(path: str | os.PathLike[str]) -> Curves:
    """Curves from a table that `Curves.to_csv` wrote.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or is no such table.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(Path(path).read_text(encoding="utf-8"))))
        groups: dict[str, list[dict[str, str]]] = {}
        for row in rows:
            groups.setdefault(row["parameter"], []).append(row)
        (first,) = groups.pop(_BENCHMARK)
        heads = [group[0] for group in groups.values()]
        axes = tuple(Axis(h["parameter"], h["scale"], float(h["low"]), float(h["high"])) for h in heads)  # type: ignore[arg-type]
        means, deviations, lows, highs = (
            tuple(_moments(group, what) for group in groups.values()) for what in _MOMENTS
        )
        stones = tuple(np.array([int(row["stones"]) for row in group]) for group in groups.values())
        values = tuple(np.array([float(row["value"]) for row in group]) for group in groups.values())
        base = tuple(float(h["benchmark"]) for h in heads)
        mean, deviation = (_moments([first], what)[0] for what in _MOMENTS[:2])
        return Curves(axes, base, values, means, deviations, lows, highs, stones, mean, deviation, int(first["stones"]))
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {error.strerror}.") from None
    except (KeyError, ValueError, TypeError, csv.Error, LithoformError) as error:
        raise FileFormatError(
            f"{path} is no table of curves as lithoform sensitivity oat writes it ({type(error).__name__}: {error}); "
            "make it again."
        ) from None


def _moments(rows: list[dict[str, str]], what: str) -> np.ndarray:
    return np.array([[float(row[f"{name}_{what}"] or math.nan) for name in FOUR] for row in rows])


def _written(numbers: list[float]) -> list[float | str]:
    return [number if math.isfinite(number) else "" for number in numbers]
