"""Stones of a design, and stones of a population: made, measured, and told as rows of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from lithoform.descriptors.measuring import measure
from lithoform.descriptors.table import FOUR
from lithoform.errors import MeshError
from lithoform.generation import generate
from lithoform.parallel import in_order
from lithoform.parameters import Recipe
from lithoform.progress import track

__all__ = ["MATCHED", "measured"]

MATCHED: Final = (*FOUR, "elongation", "flatness", "length")
"""What is matched, in the order of the columns; the length in metres."""


def measured(
    recipes: Iterable[Recipe],
    *,
    total: int,
    what: str,
    names: Sequence[str] = MATCHED,
    threads: int | None = None,
    progress: bool = False,
) -> np.ndarray:
    """Descriptors of generated stones.

    Parameters
    ----------
    recipes : iterable of Recipe
    total : int
        How many there are.
    what : str
        What they are, for the bar.
    names : sequence of str
    threads : int, optional
        Default: the processors that this process may use.
    progress : bool
        Show a bar with the time left on a terminal.

    Returns
    -------
    numpy.ndarray, shape (total, number of names)
        A row of NaN where no sound mesh was found.
    """

    def work(recipe: Recipe) -> list[float]:
        try:
            found = measure(generate(recipe, device="cpu").mesh, names)
        except MeshError:  # unsound, or without a surface
            return [np.nan] * len(names)
        return [float(found[name]) for name in names]

    stream = in_order(work, recipes, threads=threads)
    return np.array(list(track(stream, total=total, what=what, enabled=progress)), dtype=np.float64)
