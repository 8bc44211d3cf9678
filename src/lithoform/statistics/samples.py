"""What a sample is to the rest of this package: finite float64 numbers, enough of them, and not all alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError

__all__ = ["as_sample", "as_table", "check_level", "generators", "stratum_codes", "varied_pair"]


def as_sample(values: ArrayLike, name: str = "the sample", *, least: int = 1) -> np.ndarray:
    """Return values as a float64 array, checked.

    Parameters
    ----------
    values : array_like, shape (n,)
        Measured values, in any one unit.
    name : str
        What a message calls them.
    least : int
        Fewest values that will do.

    Returns
    -------
    numpy.ndarray, shape (n,)

    Raises
    ------
    SampleError
        If there are fewer values than `least`, they are not in one row, are no numbers, or are not all finite.
    """
    array = _numbers(values, name)
    if array.ndim != 1:
        raise SampleError(
            f"expected one row of values in {name}, got an array of shape {array.shape}; pass one column."
        )
    if len(array) < least:
        raise SampleError(f"expected at least {least} value(s) in {name}, got {len(array)}; measure more particles.")
    _check_finite(array, name)
    return array


def as_table(values: ArrayLike, name: str = "the table") -> np.ndarray:
    """Return particles by descriptors as a float64 array, checked.

    Parameters
    ----------
    values : array_like, shape (n, d)
        One row a particle, one column a descriptor, each in its own unit.
    name : str
        What a message calls them.

    Returns
    -------
    numpy.ndarray, shape (n, d)

    Raises
    ------
    SampleError
        If it is no table of at least 2 rows and 1 column, or not all of it is finite numbers.
    """
    array = _numbers(values, name)
    if array.ndim != 2 or array.shape[0] < 2 or array.shape[1] < 1:
        raise SampleError(
            f"expected {name} as rows of particles (2 or more) by columns of descriptors, got shape {array.shape}; "
            "stack the descriptors as columns."
        )
    _check_finite(array, name)
    return array


def varied_pair(a: ArrayLike, b: ArrayLike, *, each: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return two samples of at least two values each that vary, checked.

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit.
    each : bool
        Whether each must vary by itself, or it is enough that the two together do.

    Raises
    ------
    SampleError
        As `as_sample`, and where values that should vary are all alike.
    """
    x, y = as_sample(a, "the first sample", least=2), as_sample(b, "the second sample", least=2)
    for name, one in (("the first sample", x), ("the second sample", y)) if each else ():
        check_varied(one, name)
    check_varied(np.concatenate([x, y]), "the two samples together")
    return x, y


def check_varied(sample: np.ndarray, name: str) -> None:
    """Raise a SampleError where all values of a sample are the same."""
    if sample.min() == sample.max():
        raise SampleError(f"expected values that vary in {name}, got {len(sample)} times {sample[0]:g}; leave it out.")


def check_level(level: float) -> float:
    """Return a confidence level as float; a SampleError where it is not between 0 and 1."""
    if not 0.0 < level < 1.0:
        raise SampleError(f"expected a confidence level between 0 and 1, got {level}; 0.95 is usual.")
    return float(level)


def generators(seed: int, count: int, **draws: int) -> list[np.random.Generator]:
    """Return independent random generators that follow from one seed, and check the numbers of draws.

    Parameters
    ----------
    seed : int
        Not negative.
    count : int
        How many generators.
    **draws : int
        Numbers of draws by name, each at least 1.

    Raises
    ------
    SampleError
        If the seed is no whole number from 0, or a number of draws is below 1.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise SampleError(f"expected a seed that is a whole number from 0, got {seed!r}.")
    for name, number in draws.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or number < 1:
            raise SampleError(f"expected a whole number of {name}, 1 or more, got {number!r}; 2000 is usual.")
    return [np.random.Generator(np.random.PCG64(child)) for child in np.random.SeedSequence(int(seed)).spawn(count)]


def stratum_codes(strata: tuple[Sequence[str], Sequence[str]] | None, n: int, m: int) -> np.ndarray | None:
    """Return the stratum of each value of the pooled sample as a whole number, shape (n + m,); None for None.

    Parameters
    ----------
    strata : tuple of two sequences of str, or None
        The stratum (class) of each value of the first and of the second sample.
    n, m : int
        Sizes of the samples.

    Raises
    ------
    SampleError
        If their lengths are not those of the samples.
    """
    if strata is None:
        return None
    left, right = (list(side) for side in strata)
    if (len(left), len(right)) != (n, m):
        raise SampleError(f"expected a class for each particle, got {len(left)} and {len(right)} for {n} and {m} rows.")
    return np.unique(np.array([str(one) for one in left + right]), return_inverse=True)[1]


def _numbers(values: ArrayLike, name: str) -> np.ndarray:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SampleError(f"expected numbers in {name}, got something else ({error}).") from error


def _check_finite(array: np.ndarray, name: str) -> None:
    bad = int(array.size - np.count_nonzero(np.isfinite(array)))
    if bad:
        raise SampleError(f"expected finite values in {name}, got {bad} NaN or infinite; drop those particles first.")
