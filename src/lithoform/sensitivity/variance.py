"""Variance shares after Sobol (1993): how much of an output's variance each input explains, alone and in all."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.sensitivity.designs import Points, unit_problem
from lithoform.sensitivity.screening import whole_blocks

__all__ = ["VarianceShares", "shares_to_csv", "variance_shares"]

_RESAMPLES: Final = 1000
_QUANTILES: Final = (0.025, 0.975)


@dataclass(frozen=True, eq=False)
class VarianceShares:
    """First-order and total indices of each input for each output, with 95 % bootstrap intervals.

    Attributes
    ----------
    inputs, outputs : tuple of str
    first, first_low, first_high : numpy.ndarray, shape (d, k)
        Share of the variance that the input explains alone; estimates scatter, below 0 too.  NaN of a constant output.
    total, total_low, total_high : numpy.ndarray, shape (d, k)
        Share that is left when all other inputs are known: what it explains alone and with others.
    samples, left_out : int
        Rows of the sample that count, and those of which a point is missing.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    first: np.ndarray
    first_low: np.ndarray
    first_high: np.ndarray
    total: np.ndarray
    total_low: np.ndarray
    total_high: np.ndarray
    samples: int
    left_out: int


def variance_shares(design: Points, values: np.ndarray, outputs: Sequence[str]) -> VarianceShares:
    """Sobol indices of a design, by the estimators of Saltelli et al. (2010).

    Parameters
    ----------
    design : Points
        Of `saltelli_sample`.
    values : numpy.ndarray, shape (points, k)
        Outputs at the points; a row of the sample with one that is NaN is left out whole.
    outputs : sequence of str
        Their names.

    Raises
    ------
    SampleError
        If the values are not of such a design, or fewer than two rows are whole.

    Notes
    -----
    The intervals are percentiles over resampled rows.
    """
    from SALib.analyze import sobol

    kept, whole = whole_blocks(design, values, len(design.axes) + 2, "sobol")
    d = len(design.axes)
    found = []
    for column in kept.T:
        if np.ptp(column) == 0.0:
            found.append([np.full(d, np.nan)] * 6)
            continue
        result = sobol.analyze(
            unit_problem(design.axes), column, calc_second_order=False, num_resamples=_RESAMPLES, keep_resamples=True,
            seed=np.random.default_rng(design.seed),
        )  # fmt: skip
        parts = []
        for name in ("S1", "ST"):
            low, high = np.quantile(result[f"{name}_conf_all"], _QUANTILES, axis=0)
            parts += [np.asarray(result[name], dtype=float), low, high]
        found.append(parts)
    names = tuple(axis.name for axis in design.axes)
    count = int(whole.sum())
    arrays = np.transpose(np.array(found), (1, 2, 0))
    return VarianceShares(names, tuple(outputs), *arrays, count, len(whole) - count)  # type: ignore[misc]


def shares_to_csv(found: VarianceShares) -> bytes:
    """Table with a row an input and an output."""
    parts = (found.first, found.first_low, found.first_high, found.total, found.total_low, found.total_high)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["parameter", "descriptor", "first", "first_low", "first_high", "total", "total_low", "total_high",
                     "samples"])  # fmt: skip
    for i, name in enumerate(found.inputs):
        for j, output in enumerate(found.outputs):
            writer.writerow([name, output, *(float(part[i, j]) for part in parts), found.samples])
    return out.getvalue().encode()
