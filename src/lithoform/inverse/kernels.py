"""Squared-exponential kernels with a length scale for each axis, and the most likely one for some stones."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

__all__ = ["Kernel", "fit_kernel", "one_blas_thread"]

_STONES: Final = 1200
"""Stones on which a likelihood is worked out, whose cost goes as their cube."""

_SCALES: Final = (0.15, 20.0)
"""Range of the length scales, as coordinates: at the upper end an axis acts as a line."""

_STEPS: Final = 40
_TREND: Final = 1e2


@dataclass(frozen=True, eq=False)
class Kernel:
    """k(x, z) = variance exp(-1/2 sum_i ((x_i - z_i) / scale_i)^2), and the variance of the noise.

    Attributes
    ----------
    scales : numpy.ndarray, shape (d,)
    variance, noise : float
    """

    scales: np.ndarray
    variance: float
    noise: float

    def between(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Kernel of all pairs, shape (n, m)."""
        return self.to_scaled(x, *self.scaled(z))

    def scaled(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points in units of the length scales, shape (m, d), and the squares of their lengths, shape (m,)."""
        b = z / self.scales
        return b, (b**2).sum(axis=1)

    def to_scaled(self, x: np.ndarray, b: np.ndarray, b_squares: np.ndarray) -> np.ndarray:
        """As `between`, to what `scaled` gave: points that are asked for again and again are scaled once."""
        a = x / self.scales
        squares = (a**2).sum(axis=1)[:, None] + b_squares - 2.0 * (a @ b.T)
        return self.variance * np.exp(-0.5 * np.maximum(squares, 0.0))

    def as_dict(self) -> dict[str, float | list[float]]:
        """Plain values, of six digits."""
        return {
            "scales": [float(f"{s:.6g}") for s in self.scales],
            "variance": float(f"{self.variance:.6g}"),
            "noise": float(f"{self.noise:.6g}"),
        }


def fit_kernel(x: np.ndarray, y: np.ndarray) -> Kernel:
    """Kernel of largest marginal likelihood, on the first stones of a library.

    Parameters
    ----------
    x : numpy.ndarray, shape (n, d)
        Coordinates.
    y : numpy.ndarray, shape (n,)
        One descriptor.

    Returns
    -------
    Kernel

    Notes
    -----
    Minus twice the log likelihood is y^T C^-1 y + log det C, with C = K + noise I and a linear trend of wide prior
    (Rasmussen and Williams 2006, eq. 2.30 and 5.9).
    """
    from scipy.optimize import minimize

    x, y = x[:_STONES], y[:_STONES]
    spread = float(y.std()) or 1.0
    y = (y - y.mean()) / spread
    n, d = x.shape
    squares = (x.T[:, :, None] - x.T[:, None, :]) ** 2
    trend = _TREND * (1.0 + np.einsum("ni,mi->nm", x - 0.5, x - 0.5))

    def objective(logs: np.ndarray) -> tuple[float, np.ndarray]:
        inverse_squares, variance, noise = np.exp(-2.0 * logs[:d]), np.exp(logs[d]), np.exp(logs[d + 1])
        kernel = variance * np.exp(-0.5 * np.tensordot(inverse_squares, squares, 1))
        covariance = kernel + trend + noise * np.eye(n)
        lower = np.linalg.cholesky(covariance)
        inverse = np.linalg.inv(covariance)
        alpha = inverse @ y
        # The derivative by a parameter p is tr((C^-1 - alpha alpha^T) dC/dp).
        inner = inverse - np.outer(alpha, alpha)
        weighted = inner * kernel
        slopes = np.empty(d + 2)
        slopes[:d] = np.tensordot(squares, weighted, 2) * inverse_squares
        slopes[d], slopes[d + 1] = weighted.sum(), noise * np.trace(inner)
        # A weak prior keeps scales that do not matter where they are.
        prior = 0.05 * (logs[:d] - np.log(3.0))
        value = float(y @ alpha) + 2.0 * float(np.log(np.diag(lower)).sum()) + float((prior**2).sum()) * 20.0
        slopes[:d] += 2.0 * 20.0 * 0.05 * prior
        return value, slopes

    start = np.concatenate([np.full(d, 0.0), [0.0, np.log(0.05)]])
    low, high = np.log(_SCALES)
    bounds = [(low, high)] * d + [(-6.0, 6.0), (-12.0, 1.0)]
    with one_blas_thread():
        found = minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _STEPS}).x
    return Kernel(np.exp(found[:d]), float(np.exp(found[d])) * spread**2, float(np.exp(found[d + 1])) * spread**2)


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Matrix products whose last bits do not depend on the number of threads."""
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@lru_cache(maxsize=1)
def _libraries() -> Any:
    """Those found once: to look for them takes longer than most of the products."""
    # SciPy brings a BLAS of its own, which is not found before it is loaded.
    import scipy.linalg
    import scipy.optimize  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
