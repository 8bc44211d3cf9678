"""Whether a population can be told from stones that its search did not see."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.statistics.comparison import JointComparison, SampleComparison, compare_joint, compare_samples

__all__ = ["LEVEL", "Verdict", "detectable_shift", "judge"]

LEVEL = 0.05
"""A p-value above it is no evidence of a difference."""

_BOOTSTRAP = 200
_POWER_QUANTILE = 0.8416212335729143  # of 80 % power
_TWO_SIDED_QUANTILE = 1.959963984540054  # of a level of 5 %


@dataclass(frozen=True, eq=False)
class Verdict:
    """Two sets of stones compared; differences are of the first, the reference, less the second.

    Attributes
    ----------
    sizes : tuple of int
    descriptors : tuple of SampleComparison
        In the order of `lithoform.descriptors.table.FOUR`.
    joint : JointComparison
        The four together.
    joint_with_dimensions : JointComparison
        The four, EI, FI and the length together.
    detectable : float
        `detectable_shift` of the sizes.
    """

    sizes: tuple[int, int]
    descriptors: tuple[SampleComparison, ...]
    joint: JointComparison
    joint_with_dimensions: JointComparison
    detectable: float

    @property
    def p_values(self) -> dict[str, float]:
        """P-values of what is asked for: BC of each of the four, the energy test and the kernel test of the four."""
        told = {name: one.index("bhattacharyya").p for name, one in zip(FOUR, self.descriptors, strict=True)}
        return {**told, "joint_energy": self.joint.energy.p, "joint_mmd": self.joint.mmd.p}

    @property
    def is_passed(self) -> bool:
        """Whether none of the p-values is below `LEVEL`."""
        return min(self.p_values.values()) > LEVEL

    @property
    def shifts(self) -> dict[str, float]:
        """Mean of the second less the first, in standard deviations of the first."""
        return {
            name: (one.means[1] - one.means[0]) / one.deviations[0]
            for name, one in zip(FOUR, self.descriptors, strict=True)
        }

    @property
    def spreads(self) -> dict[str, float]:
        """Standard deviation of the second over that of the first."""
        return {name: one.deviations[1] / one.deviations[0] for name, one in zip(FOUR, self.descriptors, strict=True)}

    @property
    def resists(self) -> str:
        """The descriptor whose BC is least likely by chance; of equal ones, that of the least Wasserstein p."""
        ranks = {
            name: (one.index("bhattacharyya").p, one.index("wasserstein").p)
            for name, one in zip(FOUR, self.descriptors, strict=True)
        }
        return min(ranks, key=lambda name: ranks[name])


def judge(reference: np.ndarray, stones: np.ndarray, *, seed: int = 0, permutations: int = 2000) -> Verdict:
    """Compare stones with a reference.

    Parameters
    ----------
    reference, stones : numpy.ndarray, shape (n, 7) and (m, 7)
        Columns as in `lithoform.matching.stones.MATCHED`.
    seed : int
        Of the permutations.
    permutations : int

    Raises
    ------
    SampleError
        If a descriptor does not vary.
    """
    four = len(FOUR)
    return Verdict(
        sizes=(len(reference), len(stones)),
        descriptors=tuple(
            compare_samples(a, b, seed=seed, permutations=permutations, bootstrap=_BOOTSTRAP)
            for a, b in zip(reference.T[:four], stones.T[:four], strict=True)
        ),
        joint=compare_joint(reference[:, :four], stones[:, :four], seed=seed, permutations=permutations),
        joint_with_dimensions=compare_joint(reference, stones, seed=seed, permutations=permutations),
        detectable=detectable_shift(len(reference), len(stones)),
    )


def detectable_shift(n: int, m: int) -> float:
    """Shift of a mean that a two-sided test at 5 % finds in 80 of 100 cases, in standard deviations.

    (z_0.975 + z_0.8) sqrt(1 / n + 1 / m), with z the normal quantiles.
    """
    return (_TWO_SIDED_QUANTILE + _POWER_QUANTILE) * math.sqrt(1.0 / n + 1.0 / m)
