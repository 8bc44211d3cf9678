"""Whether two samples scatter alike: the ratio of their standard deviations with its interval."""

from __future__ import annotations

import math

import numpy as np

__all__ = ["deviation_ratio"]


def deviation_ratio(a: np.ndarray, b: np.ndarray, *, level: float) -> tuple[float, float]:
    """Interval of the ratio of the standard deviations, second over first, that also holds for samples not normal.

    ln(s_b / s_a) has a variance of about the sum of (g - (n - 3) / n) / (4 (n - 1)) over both samples, where the
    kurtosis g is pooled, of values over their own sample's deviation, and taken about trimmed means.

    Parameters
    ----------
    a, b : numpy.ndarray, shape (n,) and (m,)
        Samples of 5 values or more that vary.
    level : float
        Confidence level.

    Returns
    -------
    low, high : float

    References
    ----------
    Bonett, D. G. (2006). Robust confidence interval for a ratio of standard deviations. Appl. Psychol. Meas. 30,
    432-439.
    """
    from scipy.special import ndtri

    quantile = float(ndtri(0.5 + 0.5 * level))
    ratio = float(b.std(ddof=1) / a.std(ddof=1))
    fourth = square = variance = 0.0
    sides = [(one - one.mean()) / one.std(ddof=1) for one in (a, b)]
    for one in sides:
        size = len(one)
        cut = int(size * 0.5 / math.sqrt(size - 4.0))
        middle = np.sort(one)[cut : size - cut].mean()
        fourth += float(((one - middle) ** 4).sum())
        square += float((one**2).sum())
    kurtosis = fourth * (len(a) + len(b)) / square**2
    for one in sides:
        size = len(one)
        variance += (kurtosis - (size - 3.0) / size) / (4.0 * (size - 1.0))
    half = quantile * math.sqrt(variance)
    return ratio * math.exp(-half), ratio * math.exp(half)
