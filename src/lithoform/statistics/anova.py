"""One-way analysis of variance, from data or from the mean squares that a paper prints (Tables 3-5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SampleError
from lithoform.statistics.samples import as_sample, check_level

__all__ = ["Anova", "Equivalence", "anova", "anova_from_mean_squares", "equivalence"]


@dataclass(frozen=True)
class Anova:
    """A one-way analysis of variance; squares are in the square of the values' unit.

    Attributes
    ----------
    sizes : tuple of int
        Number of values of each group.
    between_mean_square, within_mean_square : float
        Sum of squares over degrees of freedom, of the groups and of the error.
    between_freedom, within_freedom : int
        Degrees of freedom, groups - 1 and values - groups.
    f : float
        Ratio of the mean squares; infinite where there is no variation within groups.
    p : float
        Probability of as large an F or larger if all groups had one mean (normal values of one variance).
    eta_squared : float
        Part of the total sum of squares that lies between the groups, 0 to 1.  It is biased upwards.
    omega_squared : float
        The same nearly without bias (Hays 1963); it may be a little below 0.
    mean_difference : float or None
        Mean of the first less mean of the second group, in the unit of the values; None where there are not two
        groups.  From mean squares alone its sign is not known, and it is given as positive.
    interval : tuple of float or None
        Confidence interval of the mean difference by the pooled variance (Student); None as the difference.
    level : float
        Confidence level of the interval.
    """

    sizes: tuple[int, ...]
    between_mean_square: float
    within_mean_square: float
    between_freedom: int
    within_freedom: int
    f: float
    p: float
    eta_squared: float
    omega_squared: float
    mean_difference: float | None
    interval: tuple[float, float] | None
    level: float


def anova(samples: Sequence[ArrayLike], *, level: float = 0.95) -> Anova:
    """One-way analysis of variance of two or more samples.

    Parameters
    ----------
    samples : sequence of array_like, each of shape (n_i,)
        The groups, all in one unit; for two, the reference (the scans) first.
    level : float
        Confidence level of the interval of the mean difference.

    Returns
    -------
    Anova

    Raises
    ------
    SampleError
        If there are fewer than two groups, one is empty or not finite, no degree of freedom is left for the error, or
        no group varies and all have the same mean.

    References
    ----------
    Fisher, R. A. (1925). Statistical Methods for Research Workers. Oliver and Boyd.
    """
    groups = [as_sample(one, f"group {i + 1}") for i, one in enumerate(samples)]
    _check_sizes([len(one) for one in groups])
    # About the grand mean, so that values far from 0 lose no digits.
    grand = float(np.concatenate(groups).mean())
    means = [float((one - grand).mean()) for one in groups]
    centre = sum(len(one) * mean for one, mean in zip(groups, means, strict=True)) / sum(len(one) for one in groups)
    between = sum(len(one) * (mean - centre) ** 2 for one, mean in zip(groups, means, strict=True))
    within = sum(float(((one - grand - mean) ** 2).sum()) for one, mean in zip(groups, means, strict=True))
    sizes = tuple(len(one) for one in groups)
    difference = means[0] - means[1] if len(groups) == 2 else None
    return _table(between / (len(sizes) - 1), within / (sum(sizes) - len(sizes)), sizes, difference, level)


def anova_from_mean_squares(between: float, within: float, sizes: Sequence[int], *, level: float = 0.95) -> Anova:
    """Everything else of a one-way table from its two mean squares and the sizes of the groups.

    Parameters
    ----------
    between, within : float
        Mean squares of the groups and of the error, in the square of the values' unit.
    sizes : sequence of int
        Number of values of each group.
    level : float
        Confidence level of the interval of the mean difference.

    Returns
    -------
    Anova
        With two groups, |mean difference| = sqrt(between (1/n + 1/m)), and its interval about that positive value.

    Raises
    ------
    SampleError
        If a mean square is negative or not finite, both are 0, or the sizes leave no degree of freedom.
    """
    sizes = tuple(int(size) for size in sizes)
    _check_sizes(sizes)
    if not (0.0 <= between < math.inf and 0.0 <= within < math.inf):
        raise SampleError(f"expected mean squares from 0 up, finite, got {between} and {within}; see the table again.")
    difference = math.sqrt(between * (1.0 / sizes[0] + 1.0 / sizes[1])) if len(sizes) == 2 else None
    return _table(float(between), float(within), sizes, difference, level)


def _check_sizes(sizes: Sequence[int]) -> None:
    if len(sizes) < 2 or min(sizes) < 1 or sum(sizes) <= len(sizes):
        raise SampleError(
            f"expected two groups or more, none empty, and more values than groups, got sizes {list(sizes)}."
        )


def _table(between: float, within: float, sizes: tuple[int, ...], difference: float | None, level: float) -> Anova:
    from scipy.special import fdtrc, stdtrit

    level = check_level(level)
    if between == 0.0 and within == 0.0:
        raise SampleError("expected values that vary, got groups whose values are all the same; leave them out.")
    k, n = len(sizes) - 1, sum(sizes) - len(sizes)
    f = between / within if within > 0.0 else math.inf
    total = k * between + n * within
    interval = None
    if difference is not None:
        half = float(stdtrit(n, 0.5 + 0.5 * level)) * math.sqrt(within * (1.0 / sizes[0] + 1.0 / sizes[1]))
        interval = (difference - half, difference + half)
    return Anova(
        sizes=sizes,
        between_mean_square=between,
        within_mean_square=within,
        between_freedom=k,
        within_freedom=n,
        f=f,
        p=float(fdtrc(k, n, f)) if math.isfinite(f) else 0.0,
        eta_squared=k * between / total,
        omega_squared=k * (between - within) / (total + within),
        mean_difference=difference,
        interval=interval,
        level=level,
    )


@dataclass(frozen=True)
class Equivalence:
    """Two one-sided tests of whether two means differ by less than a margin.

    Attributes
    ----------
    mean_difference : float
        Mean of the first less mean of the second sample, in the unit of the values.
    margin : float
        The largest difference that is held to be of no practical matter, in the unit of the values.
    p : float
        The larger of the two one-sided p-values: below 0.05, the means differ by less than the margin (at 5 %).
    interval : tuple of float
        Interval of the mean difference at the level 1 - 2 alpha; inside (-margin, margin) just where p < alpha.
    alpha : float
        Size of the test.
    """

    mean_difference: float
    margin: float
    p: float
    interval: tuple[float, float]
    alpha: float

    @property
    def is_equivalent(self) -> bool:
        """Whether p is below alpha."""
        return self.p < self.alpha


def equivalence(a: ArrayLike, b: ArrayLike, *, margin: float, alpha: float = 0.05) -> Equivalence:
    """Test whether two means differ by less than a margin, by two one-sided tests of Welch's t.

    A large p of an analysis of variance does not show that populations agree; a small p of this test does, to within
    the margin, which has to be chosen before the data are seen.

    Parameters
    ----------
    a, b : array_like, shape (n,) and (m,)
        The samples, in one unit.
    margin : float
        Above 0, in the unit of the values.
    alpha : float
        Size of the test, between 0 and 0.5.

    Returns
    -------
    Equivalence

    Raises
    ------
    SampleError
        If a sample has fewer than two values or is not finite, neither varies, or an option is out of range.

    References
    ----------
    Schuirmann, D. J. (1987). A comparison of the two one-sided tests procedure and the power approach for assessing the
    equivalence of average bioavailability. J. Pharmacokinet. Biopharm. 15, 657-680.
    Welch, B. L. (1947). The generalization of Student's problem. Biometrika 34, 28-35.
    """
    from scipy.special import stdtr, stdtrit

    x, y = as_sample(a, "the first sample", least=2), as_sample(b, "the second sample", least=2)
    if not (0.0 < margin < math.inf and 0.0 < alpha < 0.5):
        raise SampleError(f"expected a margin above 0 and alpha from 0 to 0.5, got {margin} and {alpha}.")
    u, v = float(x.var(ddof=1)) / len(x), float(y.var(ddof=1)) / len(y)
    if u + v == 0.0:
        raise SampleError("expected values that vary in one sample at least, got constants; compare them by eye.")
    difference, error = float(x.mean() - y.mean()), math.sqrt(u + v)
    freedom = (u + v) ** 2 / (u * u / (len(x) - 1) + v * v / (len(y) - 1))
    p = float(stdtr(freedom, (abs(difference) - margin) / error))
    half = float(stdtrit(freedom, 1.0 - alpha)) * error
    return Equivalence(difference, float(margin), p, (difference - half, difference + half), float(alpha))
