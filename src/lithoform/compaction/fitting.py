"""The fit of the height over the gyrations, H = A G^B (eq. 28)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError

__all__ = ["PowerLaw", "fit_power_law"]


@dataclass(frozen=True)
class PowerLaw:
    """H = A G^B.

    Attributes
    ----------
    a : float
        Height at the first gyration [m].
    b : float
        Exponent; below 0 where the specimen gets lower.
    a_interval, b_interval : tuple of float
        Confidence intervals of 95 %, as if the distances from the curve were independent.  Heights of gyrations that
        follow each other are not quite: take the spread over seeds for the uncertainty of a material.
    r_squared : float
        Share of the variance of H that the curve explains.
    points : int
        Gyrations that were fitted.
    """

    a: float
    b: float
    a_interval: tuple[float, float]
    b_interval: tuple[float, float]
    r_squared: float
    points: int

    def __call__(self, gyrations: ArrayLike) -> np.ndarray:
        """Heights [m]."""
        return self.a * np.asarray(gyrations, dtype=np.float64) ** self.b

    def text(self) -> str:
        """As the paper writes it, in millimetres."""
        return f"H = {1e3 * self.a:.4f} G^{self.b:.4f}, R2 = {self.r_squared:.4f}"


def fit_power_law(gyrations: ArrayLike, heights: ArrayLike) -> PowerLaw:
    """Fit by least squares of ln H over ln G, with gyrations from 1 on.

    Parameters
    ----------
    gyrations : array_like, shape (n,)
    heights : array_like, shape (n,)
        [m].

    Raises
    ------
    SampleError
        If there are less than three different gyrations from 1 on, or a number is not finite or a height not positive.
    """
    from scipy.stats import t as student

    g, h = np.asarray(gyrations, dtype=np.float64), np.asarray(heights, dtype=np.float64)
    if g.shape != h.shape or g.ndim != 1:
        raise SampleError(f"expected a height for each gyration, got {g.shape} gyrations and {h.shape} heights.")
    if not (np.isfinite(g).all() and np.isfinite(h).all() and (h > 0.0).all()):
        raise SampleError("expected finite gyrations and positive, finite heights.")
    g, h = g[g >= 1.0], h[g >= 1.0]
    if len(np.unique(g)) < 3:
        raise SampleError(f"expected at least three gyrations to fit H = A G^B, got {len(np.unique(g))}.")
    x, y = np.log(g), np.log(h)
    spread = float(((x - x.mean()) ** 2).sum())
    b = float(((x - x.mean()) * (y - y.mean())).sum() / spread)
    log_a = float(y.mean() - b * x.mean())
    rest = y - log_a - b * x
    free = len(x) - 2
    variance = float((rest**2).sum()) / free
    times = float(student.ppf(0.975, free))
    half_b = times * math.sqrt(variance / spread)
    half_a = times * math.sqrt(variance * (1.0 / len(x) + x.mean() ** 2 / spread))
    error = float(((h - np.exp(log_a) * g**b) ** 2).sum())
    total = float(((h - h.mean()) ** 2).sum())
    return PowerLaw(
        a=math.exp(log_a),
        b=b,
        a_interval=(math.exp(log_a - half_a), math.exp(log_a + half_a)),
        b_interval=(b - half_b, b + half_b),
        r_squared=1.0 - error / total if total > 0.0 else 1.0,
        points=len(x),
    )
