"""The distance of stones in which a match is measured, its sum over pairs, and the derivatives of this sum."""

from __future__ import annotations

from typing import Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.warp_runtime import MODULE_OPTIONS, load, shared_array, wp

__all__ = ["energy_distances", "sum_of_distances"]

wp.set_module_options(MODULE_OPTIONS)

_MARGIN_SHARE: Final = 0.5
_ALL_SHARE: Final = 0.5
"""Weights, beside the distance of the four descriptors together, of each one's own and of all with the dimensions."""


def energy_distances(a: np.ndarray, b: np.ndarray, first: int = len(FOUR)) -> np.ndarray:
    """Distances of all rows: Euclidean of the first columns, half of each of these alone, half Euclidean of all.

    Each part is of negative type, so that the energy distance of their sum is a distance of distributions.

    Parameters
    ----------
    a, b : numpy.ndarray, shape (n, p) and (m, p)
        In standard deviations.
    first : int
        Columns that the match is for; the rest are the dimensions.

    Returns
    -------
    numpy.ndarray, shape (n, m)
    """
    away = np.abs(a.T[:, :, None] - b.T[:, None, :])
    inner = np.einsum("knm,knm->nm", away[:first], away[:first])
    outer = inner + np.einsum("knm,knm->nm", away[first:], away[first:])
    return np.sqrt(inner) + _MARGIN_SHARE * away[:first].sum(axis=0) + _ALL_SHARE * np.sqrt(outer)


def sum_of_distances(a: np.ndarray, b: np.ndarray, first: int) -> tuple[float, np.ndarray]:
    """Sum of `energy_distances`, and its derivatives by the first columns of a, shape (n, first).

    Where two rows are equal the derivative of their distance is taken as 0.
    """
    load(_row_kernel.module, "cpu")
    sums, slopes = np.zeros(len(a)), np.zeros((len(a), first))
    rows = [shared_array(np.ascontiguousarray(array, dtype=np.float64), wp.float64) for array in (a, b)]
    results = [shared_array(array, wp.float64) for array in (sums, slopes)]
    wp.launch(_row_kernel, dim=len(a), inputs=[*rows, first, *results], device="cpu")
    return float(sums.sum()), slopes


@wp.kernel(enable_backward=False)
def _row_kernel(
    a: wp.array2d(dtype=wp.float64),
    b: wp.array2d(dtype=wp.float64),
    first: wp.int32,
    sums: wp.array(dtype=wp.float64),
    slopes: wp.array2d(dtype=wp.float64),
):
    """Distances of one row of a from all of b."""
    i = wp.tid()
    total = wp.float64(0.0)
    for j in range(b.shape[0]):
        inner = wp.float64(0.0)
        outer = wp.float64(0.0)
        margins = wp.float64(0.0)
        for k in range(a.shape[1]):
            away = a[i, k] - b[j, k]
            outer += away * away
            if k < first:
                inner += away * away
                margins += wp.abs(away)
        inner = wp.sqrt(inner)
        outer = wp.sqrt(outer)
        total += inner + wp.float64(_MARGIN_SHARE) * margins + wp.float64(_ALL_SHARE) * outer
        pull = wp.float64(0.0)
        if inner > wp.float64(0.0):
            pull += wp.float64(1.0) / inner
        if outer > wp.float64(0.0):
            pull += wp.float64(_ALL_SHARE) / outer
        for k in range(first):
            away = a[i, k] - b[j, k]
            slope = away * pull
            if away > wp.float64(0.0):
                slope += wp.float64(_MARGIN_SHARE)
            if away < wp.float64(0.0):
                slope -= wp.float64(_MARGIN_SHARE)
            slopes[i, k] = slopes[i, k] + slope
    sums[i] = total
