"""How two populations are made up of classes, and what they would be in one common mix.

Where the mixes differ, pooled means and deviations compare the mixes too.  Both populations are therefore weighted to
a mix half-way between theirs (direct standardisation), which leaves the differences within the classes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lithoform.statistics.permutation import p_value

__all__ = ["LEAST", "Mix", "Standardised", "members", "mix_of"]

LEAST: Final = 5
"""Fewest particles of a class, in either population, that are compared by themselves."""

_SAME_MIX: Final = 0.02  # share of particles that would have to change their class
_BEYOND_CHANCE: Final = 0.05


@dataclass(frozen=True)
class Standardised:
    """One descriptor of two populations, both weighted to one mix of classes.

    Attributes
    ----------
    means, deviations : tuple of float
        In the unit of the descriptor.
    error : float
        Standard error of the difference of the means.
    freedom : float
        Its degrees of freedom (Welch and Satterthwaite); infinite where the error is 0.
    """

    means: tuple[float, float]
    deviations: tuple[float, float]
    error: float
    freedom: float

    @property
    def deviation(self) -> float:
        """Root mean square of the two deviations."""
        return math.sqrt(0.5 * (self.deviations[0] ** 2 + self.deviations[1] ** 2))

    def half_width(self, level: float) -> float:
        """Half of the interval of the difference of the means at a level, by Student's t."""
        from scipy.special import stdtrit

        return float(stdtrit(min(self.freedom, 1e9), 0.5 + 0.5 * level)) * self.error


@dataclass(frozen=True)
class Mix:
    """How the two populations are made up of classes.

    Attributes
    ----------
    names : tuple of str
    counts : tuple of two tuples of int
        Particles of each class, in the first and in the second population.
    distance : float
        Share of the particles of one population that would have to be of another class for the mixes to be the same
        (total variation distance), 0 to 1.
    p : float
        Chance that random deals of the particles give mixes that differ as much (chi-square, by permutation).
    shared : tuple of str
        Classes with `LEAST` particles or more in both populations.
    common : tuple of Standardised, or None
        For each descriptor, both populations in the common mix of the shared classes, each class with the mean of its
        two shares; None where no class is shared.
    parts : tuple of tuples of float, or None
        For each descriptor, the parts of the pooled difference of means (first less second) that come from the mix,
        the classes that are not shared included, and from within the shared classes (Kitagawa 1955).
    """

    names: tuple[str, ...]
    counts: tuple[tuple[int, ...], tuple[int, ...]]
    distance: float
    p: float
    shared: tuple[str, ...]
    common: tuple[Standardised, ...] | None
    parts: tuple[tuple[float, float], ...] | None

    @property
    def is_same(self) -> bool:
        """Whether the mixes agree to within two particles in a hundred, or to within what chance gives."""
        return self.distance <= _SAME_MIX or self.p >= _BEYOND_CHANCE

    @property
    def small(self) -> tuple[str, ...]:
        """Classes that are not shared."""
        return tuple(name for name in self.names if name not in self.shared)


def members(classes: Sequence[str], name: str) -> np.ndarray:
    """Which particles are of a class, boolean, shape (n,)."""
    return np.array([one == name for one in classes], dtype=bool)


def mix_of(
    values: tuple[np.ndarray, np.ndarray],
    classes: tuple[Sequence[str], Sequence[str]],
    *,
    generator: np.random.Generator,
    permutations: int,
) -> Mix:
    """Mix of two populations.

    Parameters
    ----------
    values : tuple of numpy.ndarray, shapes (n, d) and (m, d)
        Particles by descriptors.
    classes : tuple of two sequences of str, lengths n and m
    generator : numpy.random.Generator
        Deals the particles to the two populations.
    permutations : int
        Number of deals.

    Returns
    -------
    Mix

    References
    ----------
    Kitagawa, E. M. (1955). Components of a difference between two rates. J. Am. Stat. Assoc. 50, 1168-1194.
    """
    names = tuple(sorted({*classes[0], *classes[1]}))
    masks = [[members(side, name) for name in names] for side in classes]
    counts = np.array([[int(mask.sum()) for mask in side] for side in masks])
    shares = counts / counts.sum(axis=1, keepdims=True)
    shared = [k for k in range(len(names)) if counts[:, k].min() >= LEAST]
    common = parts = None
    if shared:
        of_shared = counts[:, shared] / counts[:, shared].sum(axis=1, keepdims=True)
        weights = of_shared.mean(axis=0)
        blocks = [[side[mask[k]] for k in shared] for side, mask in zip(values, masks, strict=True)]
        common = tuple(
            _standardised([[block[:, j] for block in side] for side in blocks], weights)
            for j in range(values[0].shape[1])
        )
        pooled = values[0].mean(axis=0) - values[1].mean(axis=0)
        within = [one.means[0] - one.means[1] for one in common]
        parts = tuple((float(whole) - part, part) for whole, part in zip(pooled, within, strict=True))
    return Mix(
        names=names,
        counts=(tuple(counts[0].tolist()), tuple(counts[1].tolist())),
        distance=0.5 * float(np.abs(shares[0] - shares[1]).sum()),
        p=_chance(counts, generator, permutations),
        shared=tuple(names[k] for k in shared),
        common=common,
        parts=parts,
    )


def _standardised(samples: list[list[np.ndarray]], weights: np.ndarray) -> Standardised:
    """Both populations in one mix, from their samples by class."""
    means, deviations, squares, rest = [], [], 0.0, 0.0
    for side in samples:
        of_class = np.array([one.mean() for one in side])
        variances = np.array([one.var(ddof=1) for one in side])
        sizes = np.array([len(one) for one in side])
        mean = float((weights * of_class).sum())
        means.append(mean)
        deviations.append(math.sqrt(float((weights * (variances + (of_class - mean) ** 2)).sum())))
        terms = weights**2 * variances / sizes
        squares += float(terms.sum())
        rest += float((terms**2 / (sizes - 1)).sum())
    freedom = squares**2 / rest if rest > 0.0 else math.inf
    return Standardised((means[0], means[1]), (deviations[0], deviations[1]), math.sqrt(squares), freedom)


def _chance(counts: np.ndarray, generator: np.random.Generator, permutations: int) -> float:
    totals = counts.sum(axis=0)
    expected = totals * (counts[0].sum() / totals.sum())

    def departure(first: np.ndarray) -> np.ndarray:
        # Chi-square but for a factor that no deal changes.
        return ((first - expected) ** 2 / totals).sum(axis=-1)

    dealt = generator.multivariate_hypergeometric(totals, int(counts[0].sum()), size=permutations, method="marginals")
    return p_value(float(departure(counts[0])), departure(dealt))
