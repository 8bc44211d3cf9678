"""What the stones of a design measure: the four descriptors, point by point and seed by seed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lithoform.database.store import Store
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, SampleError
from lithoform.lazy import cached_property
from lithoform.sensitivity.designs import Design

__all__ = ["Responses", "read_responses"]


@dataclass(frozen=True, eq=False)
class Responses:
    """Descriptors of the stones of a design.

    Attributes
    ----------
    values : numpy.ndarray, shape (points, seeds, 4)
        In the order of `FOUR`; NaN where no stone could be made.
    errors : dict of int to str
        Why, by the number of the particle.
    """

    values: np.ndarray
    errors: dict[int, str]

    @cached_property
    def made(self) -> np.ndarray:
        """How many stones each point has, shape (points,)."""
        return np.isfinite(self.values).all(axis=2).sum(axis=1)

    @cached_property
    def means(self) -> np.ndarray:
        """Mean over the seeds, shape (points, 4); NaN at a point of which a stone is missing.

        The mean of fewer seeds would differ from its neighbours by the seeds that it lacks.
        """
        return self.values.mean(axis=1)

    @cached_property
    def noise_shares(self) -> np.ndarray:
        """Share of the seeds' scatter in the variance of the means, shape (4,); NaN of one seed.

        Mean variance from seed to seed over the number of seeds, over the variance of the means from point to point.
        """
        seeds = self.values.shape[1]
        whole = np.isfinite(self.means).all(axis=1)
        if seeds < 2 or whole.sum() < 2:
            return np.full(len(FOUR), np.nan)
        scatter = self.values[whole].var(axis=1, ddof=1).mean(axis=0) / seeds
        spread = self.means[whole].var(axis=0, ddof=1)
        return np.where(spread > 0.0, scatter / np.where(spread > 0.0, spread, 1.0), np.nan)

    def left_out(self) -> str:
        """How many stones could not be made and why, in a sentence; empty where all were."""
        if not self.errors:
            return ""
        reason, times = Counter(self.errors.values()).most_common(1)[0]
        return f"{len(self.errors)} stones could not be made, {times} of them because: {reason}"


def read_responses(folder: str | Path, source: str, design: Design) -> Responses:
    """Descriptors of a design whose particles are in a database.

    Parameters
    ----------
    folder : path-like
        The database.
    source : str
        Name of the particles in it.
    design : Design

    Raises
    ------
    FileFormatError
        If there is no such source, or it does not have the particles of the design.
    SampleError
        If no stone could be made.
    """
    store = Store(folder)
    entry = store.sources.get(source)
    missing = store.missing().get(source, 0)
    if entry is None or entry.count != design.count or missing:
        there = "no such source" if entry is None else f"{entry.count - missing} of {design.count} particles"
        raise FileFormatError(f"expected the whole design {source!r} in {folder}, which has {there}: give the command "
                              "that makes it again.")  # fmt: skip
    rows = store.table(["number", "error", *FOUR], sources=[source])
    values = np.full((design.count, len(FOUR)), np.nan)
    place = rows["number"].to_numpy() - 1
    for column, name in enumerate(FOUR):
        # A null becomes NaN.
        values[place, column] = rows[name].to_numpy()
    numbers, reasons = rows["number"].to_pylist(), rows["error"].to_pylist()
    errors = {number: reason for number, reason in zip(numbers, reasons, strict=True) if reason is not None}
    if len(errors) == design.count:
        raise SampleError(f"no stone of the design {source!r} could be made: {next(iter(errors.values()))}")
    return Responses(values.reshape(design.point_count, design.seeds, len(FOUR)), errors)
