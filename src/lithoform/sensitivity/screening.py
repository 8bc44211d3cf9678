"""Screening after Morris (1991): which inputs matter at all, and which act alike everywhere."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.errors import SampleError
from lithoform.sensitivity.designs import Points, unit_problem

__all__ = ["Screening", "screen", "screening_to_csv"]

_RESAMPLES: Final = 1000
_LEAST: Final = 2


@dataclass(frozen=True, eq=False)
class Screening:
    """Elementary effects of each input on each output: change of the output, in its unit, over the input's whole range.

    Attributes
    ----------
    inputs, outputs : tuple of str
    mu : numpy.ndarray, shape (d, k)
        Mean effect.
    mu_star : numpy.ndarray, shape (d, k)
        Mean of the absolute effects (Campolongo, Cariboni and Saltelli 2007).
    mu_star_half : numpy.ndarray, shape (d, k)
        Half of its 95 % bootstrap interval over the trajectories.
    sigma : numpy.ndarray, shape (d, k)
        Standard deviation of the effects: that of an input whose effect differs from place to place, by curvature or
        by interaction.
    trajectories, left_out : int
        Trajectories that count, and those of which a point is missing.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    mu: np.ndarray
    mu_star: np.ndarray
    mu_star_half: np.ndarray
    sigma: np.ndarray
    trajectories: int
    left_out: int


def screen(design: Points, values: np.ndarray, outputs: Sequence[str]) -> Screening:
    """Elementary effects of the trajectories of a design.

    Parameters
    ----------
    design : Points
        Of `morris_trajectories`.
    values : numpy.ndarray, shape (points, k)
        Outputs at the points; a trajectory with one that is NaN is left out whole.
    outputs : sequence of str
        Their names.

    Raises
    ------
    SampleError
        If the values are not of such a design, or fewer than two trajectories are whole.
    """
    from SALib.analyze import morris

    kept, whole = whole_blocks(design, values, len(design.axes) + 1, "morris")
    found = []
    for column in kept.T:
        result = morris.analyze(
            unit_problem(design.axes), design.coordinates[np.repeat(whole, len(design.axes) + 1)], column,
            num_resamples=_RESAMPLES, num_levels=design.options["levels"], seed=np.random.default_rng(design.seed),
        )  # fmt: skip
        found.append([np.asarray(result[name], dtype=float) for name in ("mu", "mu_star", "mu_star_conf", "sigma")])
    mu, mu_star, half, sigma = np.transpose(np.array(found), (1, 2, 0))
    names = tuple(axis.name for axis in design.axes)
    count = int(whole.sum())
    return Screening(names, tuple(outputs), mu, mu_star, half, sigma, count, len(whole) - count)


def whole_blocks(design: Points, values: np.ndarray, size: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Values of the blocks of points of which none is missing, one after the other, and which blocks these are.

    Parameters
    ----------
    design : Points
    values : numpy.ndarray, shape (points, k)
    size : int
        Points a block.
    kind : str
        That the design must be of.

    Returns
    -------
    values : numpy.ndarray, shape (kept points, k)
    whole : numpy.ndarray of bool, shape (blocks,)

    Raises
    ------
    SampleError
        If the design or the values are not such, or fewer than two blocks are whole.
    """
    if design.kind != kind or values.ndim != 2 or len(values) != design.point_count:
        raise SampleError(f"expected a {kind} design and a row of values for each of its {design.point_count} points; "
                          f"got a {design.kind} design and values of shape {values.shape}.")  # fmt: skip
    whole: np.ndarray = np.all(np.isfinite(values).reshape(-1, size * values.shape[1]), axis=1)
    if whole.sum() < _LEAST:
        raise SampleError(f"expected at least {_LEAST} whole blocks of {size} points; got {int(whole.sum())} of "
                          f"{len(whole)}: use more triangles, so that all settings can be made.")  # fmt: skip
    return values[np.repeat(whole, size)], whole


def screening_to_csv(found: Screening) -> bytes:
    """Table with a row an input and an output."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["parameter", "descriptor", "mu", "mu_star", "mu_star_half_interval", "sigma", "trajectories"])
    for i, name in enumerate(found.inputs):
        for j, output in enumerate(found.outputs):
            numbers = (float(part[i, j]) for part in (found.mu, found.mu_star, found.mu_star_half, found.sigma))
            writer.writerow([name, output, *numbers, found.trajectories])
    return out.getvalue().encode()
