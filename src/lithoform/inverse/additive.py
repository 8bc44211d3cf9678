"""The paper's route: an additive surrogate from curves of one parameter at a time, and a Latin hypercube ranked by E.

Appendix B of the paper, eq. 29 and 30.  No interaction of parameters is known to it, and the dimensions are fixed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import as_file, files
from typing import Final

import numpy as np

from lithoform.axes import Axis, at_axes
from lithoform.errors import RecipeError
from lithoform.feasibility import require_feasible
from lithoform.inverse.targets import Target, mismatch, within
from lithoform.parameters import Recipe
from lithoform.sensitivity.oat import Curves, read_curves

__all__ = ["AdditiveSurrogate", "PaperCandidate", "paper_candidates", "shipped_curves"]

_SHIPPED: Final = "curves.csv"
_POINTS: Final = 20_000


@dataclass(frozen=True, eq=False)
class AdditiveSurrogate:
    """Eq. 29: main effects alone.

    Parameters
    ----------
    curves : Curves
        Responses to one parameter at a time; values where no stone could be made are left out.
    """

    curves: Curves

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The parameters."""
        return self.curves.axes

    def ranges(self) -> np.ndarray:
        """Least and greatest value of each axis at which there is a response, shape (d, 2)."""
        return np.array([self._knots(i)[0][[0, -1]] for i in range(len(self.axes))])

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Descriptors by the additive model.

            y_d(x) = y_d(0) + sum_i ( f_id(x_i) - f_id(x_i(0)) )

        Parameters
        ----------
        values : numpy.ndarray, shape (n, axes)
            Of the parameters, each in its unit; the curves are interpolated linearly in it, that of kappa too, whose
            points are even on its logarithm.

        Returns
        -------
        numpy.ndarray, shape (n, 4)
        """
        values = np.asarray(values, dtype=np.float64)
        found = np.tile(self.curves.baseline, (len(values), 1))
        for i in range(len(self.axes)):
            knots, responses = self._knots(i)
            for d in range(found.shape[1]):
                base = np.interp(self.curves.base[i], knots, responses[:, d])
                found[:, d] += np.interp(values[:, i], knots, responses[:, d]) - base
        return found

    def _knots(self, axis: int) -> tuple[np.ndarray, np.ndarray]:
        mean = self.curves.mean[axis]
        there = np.isfinite(mean).all(axis=1)
        return self.curves.values[axis][there], mean[there]


@dataclass(frozen=True, eq=False)
class PaperCandidate:
    """A point of the hypercube.

    Attributes
    ----------
    recipe : Recipe
    mean : numpy.ndarray, shape (4,)
        Predicted.
    mismatch : float
        E.
    within : bool
        Whether all are within their tolerance.
    """

    recipe: Recipe
    mean: np.ndarray
    mismatch: float
    within: bool


@lru_cache(maxsize=1)
def shipped_curves() -> Curves:
    """The curves that come with the package: 30 seeds a point, benchmark of Table 1, 20,000 triangles."""
    with as_file(files("lithoform.inverse").joinpath(_SHIPPED)) as path:
        return read_curves(path)


def paper_candidates(
    surrogate: AdditiveSurrogate,
    target: Target,
    *,
    base: Recipe | None = None,
    count: int = 10,
    points: int = _POINTS,
    seed: int = 0,
) -> list[PaperCandidate]:
    """Points of a Latin hypercube over the admissible ranges, ranked by E.

    The hypercube is even on the scale of each axis: that of kappa is its logarithm, all others are linear.

    Parameters
    ----------
    surrogate : AdditiveSurrogate
    target : Target
    base : Recipe, optional
        What the parameters leave: the benchmark of Table 1 unless given.
    count : int
        How many are kept; those whose recipe no mesh could follow are passed over.
    points : int
        Of the hypercube.
    seed : int
        Of the hypercube.

    Returns
    -------
    list of PaperCandidate
        The best first.
    """
    from scipy.stats import qmc

    base = Recipe() if base is None else base
    d = len(surrogate.axes)
    uniform = qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(points)
    low, high = (np.array([a.coordinate(v) for a, v in zip(surrogate.axes, ends, strict=True)])
                 for ends in surrogate.ranges().T)  # fmt: skip
    columns = zip(surrogate.axes, (low + (high - low) * uniform).T, strict=True)
    values = np.array([[axis.setting(float(c)) for c in column] for axis, column in columns], dtype=np.float64).T
    predicted = surrogate.predict(values)
    found = mismatch(predicted, target)
    kept: list[PaperCandidate] = []
    for i in np.argsort(found, kind="stable"):
        settings = {
            axis.name: int(value) if axis.is_whole else float(value)
            for axis, value in zip(surrogate.axes, values[i], strict=True)
        }
        try:
            recipe = at_axes(base, settings)
            require_feasible(recipe)
        except RecipeError:
            continue
        is_within = bool(within(predicted[i : i + 1], target)[0])
        kept.append(PaperCandidate(recipe, predicted[i], float(found[i]), is_within))
        if len(kept) == count:
            break
    return kept
