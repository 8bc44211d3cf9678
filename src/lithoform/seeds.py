"""Sub-seeds by a counter-based hash: the only source of randomness in a particle.

Everything random in a particle follows from its 64-bit seed and a few small integers that say what the
number is for (its role, and a channel, an octave or a particle number).  The words are absorbed one by one
by the finaliser of SplitMix64 (Steele, Lea & Flood 2014), a bijection of the 64-bit integers with full
avalanche; no sub-seed is ever made by adding small integers to another, so neighbouring seeds share nothing.
"""

from __future__ import annotations

from enum import IntEnum

__all__ = ["MAX_SEED", "Role", "derive", "uniform"]

MAX_SEED = 2**64 - 1
_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 / golden ratio: the increment of SplitMix64


class Role(IntEnum):
    """What a sub-seed is for.  The values are part of the file format: never renumber them."""

    WARP = 1
    RELIEF = 2
    CHIPS = 3
    PARTICLE = 4
    DIMENSIONS = 5
    POPULATION = 6
    SPECIMEN = 7


def _finalise(z: int) -> int:
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MAX_SEED
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MAX_SEED
    return z ^ (z >> 31)


def derive(seed: int, role: Role, *words: int) -> int:
    """Sub-seed of a seed for one purpose.

    Parameters
    ----------
    seed : int
        The particle's (or the run's) seed, 0 to 2^64 - 1.
    role : Role
        The purpose.
    *words : int
        Non-negative counters within the purpose: channel, octave, particle number.

    Returns
    -------
    int
        64 well-mixed bits.
    """
    state = _finalise((seed + _GOLDEN) & MAX_SEED)
    for word in (int(role), *words):
        state = _finalise(((state ^ word) + _GOLDEN) & MAX_SEED)
    return state


def uniform(seed: int, role: Role, *words: int) -> float:
    """One number uniform in [0, 1) with 53 random bits; the arguments are those of `derive`."""
    return (derive(seed, role, *words) >> 11) * 2.0**-53
