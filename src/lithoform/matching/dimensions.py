"""Dimensions of a reference as margins and a Gaussian copula."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

__all__ = ["MAX_QUANTILES", "DimensionModel", "fit_dimensions", "normal_scores"]

MAX_QUANTILES: Final = 65
"""Quantiles kept of a margin: between them it is linear."""

_LEAST_RATIO: Final = 0.04


@dataclass(frozen=True, eq=False)
class DimensionModel:
    """Joint distribution of L [m], EI and FI.

    Attributes
    ----------
    quantiles : numpy.ndarray, shape (3, q)
        At the probabilities (i - 1/2) / q, rising along each row.
    correlation : numpy.ndarray, shape (3, 3)
        Of the normal scores.
    """

    quantiles: np.ndarray
    correlation: np.ndarray

    def scores(self, normal: np.ndarray) -> np.ndarray:
        """Correlated normal scores of independent ones, both shape (n, 3)."""
        return np.einsum("ij,kj->ik", normal, np.linalg.cholesky(self.correlation))

    def values(self, scores: np.ndarray) -> np.ndarray:
        """L [m], EI and FI at normal scores, both shape (n, 3)."""
        from scipy.special import ndtr

        count = self.quantiles.shape[1]
        levels = (np.arange(count) + 0.5) / count
        margins = zip(ndtr(scores).T, self.quantiles, strict=True)
        return np.column_stack([np.interp(at, levels, quantiles) for at, quantiles in margins])


def fit_dimensions(values: np.ndarray) -> DimensionModel:
    """Model of measured dimensions.

    Parameters
    ----------
    values : numpy.ndarray, shape (n, 3)
        L [m], EI, FI.

    Notes
    -----
    The correlations of so few numbers are drawn towards 0 by n / (n + 4), which keeps the matrix definite as well.
    """
    n = len(values)
    count = min(n, MAX_QUANTILES)
    levels = (np.arange(count) + 0.5) / count
    quantiles = np.quantile(values, levels, axis=0, method="hazen").T
    quantiles[1:] = np.clip(quantiles[1:], _LEAST_RATIO, 1.0)
    scores = normal_scores(values)
    raw = np.corrcoef(scores.T)
    correlation = np.where(np.eye(3, dtype=bool), 1.0, 0.5 * (raw + raw.T) * (n / (n + 4.0)))
    return DimensionModel(np.maximum.accumulate(quantiles, axis=1), correlation)


def normal_scores(values: np.ndarray) -> np.ndarray:
    """Normal quantiles of the ranks in each column at (rank - 1/2) / n, shape (n, d); ties share their mean rank."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    return ndtri((rankdata(values, axis=0) - 0.5) / len(values))
