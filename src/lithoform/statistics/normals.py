"""The histogram indices of two normal distributions: what they would be with every particle of the world.

With the means and standard deviations that a paper prints, these say how far two populations can differ by their first
two moments alone.
"""

from __future__ import annotations

import math

import numpy as np

from lithoform.errors import SampleError

__all__ = ["normal_bhattacharyya", "normal_jensen_shannon", "normal_kullback_leibler"]

Moments = tuple[float, float]


def normal_bhattacharyya(p: Moments, q: Moments) -> float:
    """Bhattacharyya coefficient of two normals in closed form.

    BC = sqrt(2 s t / (s^2 + t^2)) exp(-(m - k)^2 / (4 (s^2 + t^2))) for N(m, s^2) and N(k, t^2).

    Parameters
    ----------
    p, q : tuple of float
        Mean and standard deviation, in one unit.

    Raises
    ------
    SampleError
        If a mean is not finite or a standard deviation is not above 0.
    """
    (m, s), (k, t) = _checked(p), _checked(q)
    total = s * s + t * t
    return math.sqrt(2.0 * s * t / total) * math.exp(-((m - k) ** 2) / (4.0 * total))


def normal_kullback_leibler(p: Moments, q: Moments) -> float:
    """Kullback-Leibler divergence D(P || Q) of two normals in closed form [nat].

    D = ln(t / s) + (s^2 + (m - k)^2) / (2 t^2) - 1/2 for P = N(m, s^2) and Q = N(k, t^2); the arguments and errors
    are those of `normal_bhattacharyya`.
    """
    (m, s), (k, t) = _checked(p), _checked(q)
    return math.log(t / s) + (s * s + (m - k) ** 2) / (2.0 * t * t) - 0.5


def normal_jensen_shannon(p: Moments, q: Moments) -> float:
    """Jensen-Shannon divergence of two normals [nat]; it has no closed form and is integrated numerically.

    The trapezium rule on 20,001 points over 10 standard deviations beyond both means converges faster than any power
    of the step for such integrands; the arguments and errors are those of `normal_bhattacharyya`.
    """
    (m, s), (k, t) = _checked(p), _checked(q)
    x, step = np.linspace(min(m - 10.0 * s, k - 10.0 * t), max(m + 10.0 * s, k + 10.0 * t), 20_001, retstep=True)
    log_p, log_q = (-0.5 * ((x - a) / b) ** 2 - math.log(b * math.sqrt(2.0 * math.pi)) for a, b in ((m, s), (k, t)))
    log_mean = np.logaddexp(log_p, log_q) - math.log(2.0)
    integrand = np.exp(log_p) * (log_p - log_mean) + np.exp(log_q) * (log_q - log_mean)
    return max(0.5 * float(step) * float(integrand.sum()), 0.0)


def _checked(moments: Moments) -> Moments:
    mean, deviation = float(moments[0]), float(moments[1])
    if not (math.isfinite(mean) and 0.0 < deviation < math.inf):
        raise SampleError(f"expected a finite mean and a standard deviation above 0, got {mean} and {deviation}.")
    return mean, deviation
