"""Several tests at once: p-values adjusted so that the chance of any false alarm stays what it was for one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError
from lithoform.statistics.samples import as_sample

__all__ = ["holm"]


def holm(p_values: ArrayLike) -> np.ndarray:
    """Holm's step-down adjustment: reject where the adjusted p is below alpha, whatever the dependence of the tests.

    Parameters
    ----------
    p_values : array_like, shape (k,)
        One for each test.

    Returns
    -------
    numpy.ndarray, shape (k,)
        Adjusted p-values in the order given: the i-th smallest times (k + 1 - i), made monotone, at most 1.

    Raises
    ------
    SampleError
        If there are none, or one is outside 0 to 1.

    References
    ----------
    Holm, S. (1979). A simple sequentially rejective multiple test procedure. Scand. J. Stat. 6, 65-70.
    """
    p = as_sample(p_values, "the p-values")
    if p.min() < 0.0 or p.max() > 1.0:
        raise SampleError(f"expected p-values from 0 to 1, got {p.min():g} to {p.max():g}.")
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return adjusted
