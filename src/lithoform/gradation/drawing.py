"""Sieve sizes of particles whose mass curve is that of a gradation.

Mass is spread evenly over ln d in each fraction, so that the number of particles is spread as d^-3 over ln d: a
particle of sieve size d and unit volume v has the volume v d^3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import RecipeError
from lithoform.gradation.curves import SAME_OPENING, Curve, Gradation
from lithoform.seeds import MAX_SEED

__all__ = ["TOLERANCE", "Draw", "Fractions", "draw_sizes", "retained"]

Spread = Literal["mass", "count"]

TOLERANCE: Final = 1.0
"""Largest distance of a drawn curve from its gradation at any sieve [percentage points of the mass]."""

MAX_PARTICLES: Final = 20_000_000
"""A draw of more is refused: fine sieves ask for billions of grains, which no computer holds as particles."""

_INSET: Final = 1e-6
"""Relative distance kept from the openings: the size of the scaled mesh, rounded anew, stays in its fraction."""


@dataclass(frozen=True)
class Fractions:
    """Mass between neighbouring sieves: a gradation cut at a least size and scaled to 1.

    Attributes
    ----------
    openings : tuple of float, k + 1 values
        [m], from the coarsest to the cut.
    shares : tuple of float, k values
        Of the mass between openings i and i + 1; they add up to 1.
    """

    openings: tuple[float, ...]
    shares: tuple[float, ...]

    @property
    def passing(self) -> np.ndarray:
        """Percent passing at the openings, 100 to 0, shape (k + 1,)."""
        return 100.0 * np.append(np.cumsum(self.shares[::-1])[::-1], 0.0)


def retained(gradation: Gradation, min_size: float | None = None, *, curve: Curve = "mid") -> Fractions:
    """Mass fractions between the sieves, of what is coarser than a least size.

    The least size [m] becomes a sieve, with its interpolated passing; None is the finest opening.

    Raises
    ------
    RecipeError
        If nothing is coarser, or it is below the finest opening.
    """
    cut = gradation.openings[-1] if min_size is None else float(min_size)
    above = [d for d in gradation.openings if d > cut * (1.0 + SAME_OPENING)]
    shared = [d for d in gradation.openings if abs(d - cut) <= cut * SAME_OPENING]
    openings = (*above, *(shared or [cut]))
    p = gradation.passing(openings, curve)
    total = float(p[0] - p[-1])
    if total <= 0.0:
        raise RecipeError(f"expected a least size below what the gradation {gradation.name!r} holds; got "
                          f"{1e3 * cut:g} mm, and nothing is coarser.")  # fmt: skip
    return Fractions(openings, tuple(float(x) for x in -np.diff(p) / total))


@dataclass(frozen=True, eq=False)
class Draw:
    """Sieve sizes drawn from a gradation, the coarsest fraction first, falling within it.

    Attributes
    ----------
    sizes : numpy.ndarray, shape (n,)
        Sieve size of each particle [m], strictly inside its fraction.
    fraction : numpy.ndarray of int32, shape (n,)
        It lies between `fractions.openings[i]` and the next.
    candidates : numpy.ndarray of int32, shape (n,)
        Which of the candidate shapes is scaled to the size.
    masses : numpy.ndarray, shape (n,)
        [kg]: density * unit volume * size^3.
    fractions : Fractions
        What was asked for.
    """

    sizes: np.ndarray
    fraction: np.ndarray
    candidates: np.ndarray
    masses: np.ndarray
    fractions: Fractions

    @property
    def counts(self) -> np.ndarray:
        """Particles in each fraction, shape (k,)."""
        return np.bincount(self.fraction, minlength=len(self.fractions.shares))

    @property
    def passing(self) -> np.ndarray:
        """Percent of the drawn mass that passes each opening of the fractions, shape (k + 1,)."""
        passed = [self.masses[self.sizes <= d].sum() for d in self.fractions.openings]
        return 100.0 * np.array(passed) / self.masses.sum()


def draw_sizes(
    gradation: Gradation,
    *,
    mass: float | None = None,
    count: int | None = None,
    volume: float | None = None,
    min_size: float | None = None,
    density: float = 2650.0,
    unit_volumes: ArrayLike = math.pi / 6.0,
    spread: Spread = "mass",
    curve: Curve = "mid",
    seed: int,
) -> Draw:
    """Particles whose mass by sieve size is that of a gradation.

    In each fraction (a, b) as many particles are taken as the mass asks for on the average; their sizes are one
    from each of n strata of equal probability; then the places t = ln(d / a) / ln(b / a) are all replaced by
    t^g, with the one g, near 1, at which the mass of the fraction is met exactly.

    Parameters
    ----------
    gradation : Gradation
    mass, count, volume
        One of the three: total mass [kg], number of particles, or total volume of the solids [m^3].
    min_size : float or None
        Least sieve size [m]; None: the finest opening.
    density : float
        [kg/m^3].
    unit_volumes : float or array_like, shape (c,)
        Volume over sieve size cubed of each candidate shape (pi / 6 for a sphere).  The candidates are dealt
        like cards, shuffled anew for every round.
    spread : {"mass", "count"}
        Within a fraction: mass even over ln d, as the interpolated curve says, so that the number density in d is
        3 / (a^-3 - b^-3) * d^-4; or the number even over ln d, density 1 / (d ln(b / a)), which meets the curve at
        the sieves as well but has fewer, larger particles (8,600 instead of 12,200 in the SGC mould of the paper).
    curve : {"mid", "low", "high"}
    seed : int
        0 to 2^64 - 1; each fraction has streams of its own (Philox, keyed by the seed and the fraction).

    Raises
    ------
    RecipeError
        If a value is out of range, or so little is asked for that the curve would be missed by more than
        `TOLERANCE` at a sieve; the message names an amount that is always enough.
    """
    amounts = {"mass": mass, "count": count, "volume": volume}
    given = {name: float(x) for name, x in amounts.items() if x is not None}
    if len(given) != 1 or not all(0.0 < x < math.inf for x in given.values()):
        raise RecipeError(f"expected one positive amount of mass, count or volume; got {given or 'none'}.")
    if not given.get("count", 1.0).is_integer():
        raise RecipeError(f"expected a whole number of particles; got {count!r}.")
    v = np.atleast_1d(np.asarray(unit_volumes, dtype=np.float64))
    if not 0.0 < density < math.inf:
        raise RecipeError(f"expected a positive density [kg/m^3]; got {density!r}.")
    if v.ndim != 1 or not v.size or not (np.isfinite(v) & (v > 0.0)).all():
        worst = float(v.ravel()[int(np.argmin(np.where(np.isfinite(v), v, -math.inf)))]) if v.size else "none"
        raise RecipeError(f"expected positive unit volumes, one a candidate; got {worst}.")
    if spread not in ("mass", "count"):
        raise RecipeError(f"expected a spread of mass or count; got {spread!r}.")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed <= MAX_SEED:
        raise RecipeError(f"expected a whole number of 0 to {MAX_SEED} as the seed; got {seed!r}.")
    fractions = retained(gradation, min_size, curve=curve)
    bins = [_Bin(fractions, i, v, spread, int(seed)) for i, share in enumerate(fractions.shares) if share > 0.0]
    per_volume = sum(b.share / b.mean_cube for b in bins) / float(v.mean())
    total = given.get("volume", given.get("mass", 0.0) / density) or given["count"] / per_volume
    if total * per_volume > MAX_PARTICLES:
        raise RecipeError(f"expected at most {MAX_PARTICLES} particles; got about {total * per_volume:.3g}: raise the "
                          "least size or ask for less.")  # fmt: skip
    total, numbers = _share_out(bins, int(given["count"]), total) if "count" in given else (
        total, [b.number(total) for b in bins])  # fmt: skip
    parts = [b.draw(n, total) for b, n in zip(bins, numbers, strict=True)]
    sizes, dealt = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    where = np.repeat(np.array([b.index for b in bins], dtype=np.int32), numbers)
    drawn = Draw(sizes, where, dealt, density * v[dealt] * sizes**3, fractions)
    if not len(sizes) or np.abs(drawn.passing - fractions.passing).max() > TOLERANCE:
        least = 1.001 * max(b.least_volume() for b in bins)
        enough = {"volume": f"{least:.4g} m^3", "mass": f"{least * density:.4g} kg",
                  "count": f"{sum(b.number(least) for b in bins)} particles"}[next(iter(given))]  # fmt: skip
        asked, unit = next(iter(given)), {"mass": " kg", "volume": " m^3", "count": ""}
        raise RecipeError(f"{given[asked]:g}{unit[asked]} is too small a {asked} for whole particles to "
                          f"meet the curve within {TOLERANCE:g} % at every sieve; {enough} will do.")  # fmt: skip
    return drawn


class _Bin:
    """One fraction: the order in which its candidates are dealt does not depend on the amount."""

    def __init__(self, fractions: Fractions, index: int, v: np.ndarray, spread: Spread, seed: int) -> None:
        self.index, self.share, self.v, self.spread, self.seed = index, fractions.shares[index], v, spread, seed
        self.low = fractions.openings[index + 1] * (1.0 + _INSET)
        self.high = fractions.openings[index] * (1.0 - _INSET)
        self.log_ratio = math.log(self.high / self.low)
        even_mass = 3.0 * self.log_ratio / (self.low**-3 - self.high**-3)
        even_count = (self.high**3 - self.low**3) / (3.0 * self.log_ratio)
        self.mean_cube = even_mass if spread == "mass" else even_count

    def _random(self, purpose: int, n: int) -> np.ndarray:
        # The words of a bit generator are the same in every version of NumPy; its permutations are not.
        return np.random.Philox(key=np.array([self.seed, 2 * self.index + purpose], dtype=np.uint64)).random_raw(n)

    def deal(self, unit_volume: float) -> np.ndarray:
        """Candidates whose unit volumes add up to an amount and a little more."""
        rounds, c = math.ceil(unit_volume / float(self.v.sum())) + 1, len(self.v)
        words = self._random(0, rounds * c).reshape(rounds, c) if c > 1 else np.zeros((rounds, 1))
        return np.argsort(words, axis=1, kind="stable").ravel().astype(np.int32)

    def number(self, total: float) -> int:
        """Particles for a total volume: nearest to the mean, of those numbers that can meet it exactly if any."""
        wanted = self.share * total
        sums = np.concatenate([[0.0], np.cumsum(self.v[self.deal(wanted / self.low**3)])])
        first = int(np.searchsorted(sums, wanted / self.high**3))
        last = int(np.searchsorted(sums, wanted / self.low**3, side="right")) - 1
        nearest = int(np.argmin(np.abs(sums - wanted / self.mean_cube)))
        return min(max(nearest, first), last) if first <= last else nearest

    def least_volume(self) -> float:
        """Total volume from which on every one can be met exactly: the reach of n particles meets that of n + 1."""
        grow = math.exp(3.0 * self.log_ratio) - 1.0
        v = self.v[self.deal(float(self.v.max()) / grow)]
        sums = np.cumsum(v)
        gaps = np.flatnonzero(v[1:] > sums[:-1] * grow)
        return float(sums[gaps[-1] + 1 if len(gaps) else 0]) * self.low**3 / self.share

    def draw(self, n: int, total: float) -> tuple[np.ndarray, np.ndarray]:
        """Sizes, falling, and candidates of n particles that fill the fraction's share of a total volume."""
        dealt = self.deal(n * float(self.v.max()))[:n]
        jitter = ((self._random(1, n) >> np.uint64(11)) + 0.5) * 2.0**-53
        u = (np.arange(n, 0, -1) - jitter) / max(n, 1)
        steep = math.expm1(-3.0 * self.log_ratio)
        t = np.log1p(u * steep) / (-3.0 * self.log_ratio) if self.spread == "mass" else u
        wanted, v, log_t = self.share * total / self.low**3, self.v[dealt], np.log(t)
        # The volume falls with the exponent g = e^x: safeguarded Newton steps in x.
        below, above, x = -40.0, 40.0, 0.0
        for _ in range(100):
            place = np.exp(log_t * math.exp(x))
            volumes = v * np.exp(3.0 * self.log_ratio * place)
            excess = float(volumes.sum()) - wanted
            if abs(excess) <= 1e-13 * wanted:
                break
            below, above = (x, above) if excess > 0.0 else (below, x)
            slope = float((volumes * place * log_t).sum()) * 3.0 * self.log_ratio * math.exp(x)
            x = x - excess / slope if slope else math.inf
            if not below < x < above:
                x = 0.5 * (below + above)
        place = np.exp(log_t * math.exp(x))
        return self.low * np.exp(self.log_ratio * place), dealt


def _share_out(bins: list[_Bin], count: int, total: float) -> tuple[float, list[int]]:
    """Total volume at which the fractions have exactly a number of particles, and the number in each."""
    low, high = 0.0, total
    while sum(b.number(high) for b in bins) < count:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sum(b.number(middle) for b in bins) < count else (low, middle)
    numbers = [b.number(high) for b in bins]
    # Two fractions may gain a particle at the same volume; the finer gives its own back.
    for i in reversed(range(len(bins))):
        numbers[i] -= max(min(sum(numbers) - count, numbers[i] - bins[i].number(low)), 0)
    return high, numbers
