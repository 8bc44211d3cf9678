"""The virtual laboratory: the tests that a crushed-rock laboratory runs on a sample, on meshes.

`laboratory` measures one particle; the indices take plain arrays over a population, in metres and in any unit of
mass (volume times density), and give percentages by count and by mass.

References
----------
EN 933-1:2012. Tests for geometrical properties of aggregates. Part 1: Particle size distribution, sieving method.
EN 933-3:2012. Part 3: Particle shape, flakiness index.
EN 933-4:2008. Part 4: Particle shape, shape index.
ASTM D4791-19. Standard test method for flat particles, elongated particles, or flat and elongated particles in
coarse aggregate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from lithoform.descriptors.calipers import caliper_dimensions
from lithoform.descriptors.hull import Hull, convex_hull
from lithoform.descriptors.passing import sieve_size
from lithoform.errors import MeshError
from lithoform.mesh import Mesh

__all__ = [
    "BAR_SLOTS",
    "D4791_RATIOS",
    "TEST_SIEVES",
    "FlatElongated",
    "LabResult",
    "Share",
    "flakiness_index",
    "flat_and_elongated",
    "laboratory",
    "shape_index",
    "sieve_curve",
]

TEST_SIEVES: Final = tuple(
    1e-3 * mm for mm in (4.0, 5.0, 6.3, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 31.5, 40.0, 50.0, 63.0, 80.0, 100.0)
)
"""Openings of the test sieves of EN 933-3 [m]; neighbours d_i < D_i bound a particle size fraction."""

BAR_SLOTS: Final = tuple(
    1e-3 * mm for mm in (2.5, 3.15, 4.0, 5.0, 6.3, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 31.5, 40.0, 50.0)
)
"""Slots of the bar sieves of EN 933-3, table 1, one a fraction [m]: D_i / 2, rounded to the series (6.3, 16)."""

D4791_RATIOS: Final = (2.0, 3.0, 4.0, 5.0)
"""Ratios at which flat and elongated particles are counted."""

NON_CUBICAL: Final = 3.0
"""EN 933-4: a particle whose length is more than this many times its thickness is non-cubical."""


@dataclass(frozen=True)
class LabResult:
    """What the laboratory reads from one particle, in metres.

    Attributes
    ----------
    volume : float
        Of the body [m^3].
    sieve_size : float
        Side of the smallest square opening that the particle passes in some orientation [m].
    slot_width : float
        Width of the narrowest slot of a bar sieve that it passes [m]: its least distance of two parallel planes.
    length, width, thickness : float
        ASTM D4791: the greatest dimension, the greatest perpendicular to it, and that perpendicular to both [m].
    """

    volume: float
    sieve_size: float
    slot_width: float
    length: float
    width: float
    thickness: float

    @property
    def flaky(self) -> bool:
        """Whether it passes a slot of half its sieve size (EN 933-3, for a fraction that ends at the particle)."""
        return self.slot_width <= 0.5 * self.sieve_size

    @property
    def shape_ratio(self) -> float:
        """Length over thickness L / E of EN 933-4, both between parallel planes: the greatest over the least."""
        return self.length / self.slot_width

    @property
    def non_cubical(self) -> bool:
        """Whether the ratio of EN 933-4 exceeds 3."""
        return self.shape_ratio > NON_CUBICAL

    @property
    def flat_ratio(self) -> float:
        """Width over thickness: flat where it exceeds the ratio asked for (ASTM D4791)."""
        return self.width / self.thickness

    @property
    def elongated_ratio(self) -> float:
        """Length over width: elongated where it exceeds the ratio asked for (ASTM D4791)."""
        return self.length / self.width

    @property
    def flat_elongated_ratio(self) -> float:
        """Length over thickness: flat and elongated where it exceeds the ratio asked for (ASTM D4791)."""
        return self.length / self.thickness

    def mass(self, density: float) -> float:
        """Mass at a density [kg/m^3], in kg."""
        return self.volume * density


@dataclass(frozen=True)
class Share:
    """Part of a population.

    Attributes
    ----------
    by_count, by_mass : float
        Percent.
    """

    by_count: float
    by_mass: float


@dataclass(frozen=True)
class FlatElongated:
    """ASTM D4791 at one ratio.

    Attributes
    ----------
    ratio : float
    flat, elongated, flat_and_elongated : Share
        Particles whose width over thickness, length over width, and length over thickness exceed the ratio.
    """

    ratio: float
    flat: Share
    elongated: Share
    flat_and_elongated: Share


def laboratory(body: Mesh | Hull) -> LabResult:
    """Measure one particle.

    Parameters
    ----------
    body : Mesh or Hull
        In metres.  A hull that is given alone stands for a convex body: its volume is the volume.

    Returns
    -------
    LabResult

    Raises
    ------
    MeshError
        If the body is flat, or its faces enclose no positive volume.
    """
    hull = body if isinstance(body, Hull) else convex_hull(body)
    if not body.volume > 0.0:
        raise MeshError(f"expected a closed, outward mesh, but its volume is {body.volume:g}; repair it first.")
    caliper = caliper_dimensions(hull)
    return LabResult(
        volume=body.volume,
        sieve_size=sieve_size(hull),
        slot_width=caliper.minimum_width,
        length=caliper.length,
        width=caliper.width,
        thickness=caliper.thickness,
    )


def flakiness_index(
    sieve_sizes: ArrayLike,
    slot_widths: ArrayLike,
    masses: ArrayLike,
    *,
    slots: Literal["half", "fractions"] = "half",
) -> Share:
    """Percentage of flaky particles (EN 933-3).

    Parameters
    ----------
    sieve_sizes : array_like, shape (n,)
        Smallest square opening that each particle passes [m].
    slot_widths : array_like, shape (n,)
        Narrowest slot that each passes [m].
    masses : array_like, shape (n,)
        Any unit.
    slots : {"half", "fractions"}
        The slot that a flaky particle passes: half its own sieve size, or as the standard prints it, that of
        `BAR_SLOTS` for the fraction d_i < sieve size <= D_i of `TEST_SIEVES`; particles that pass the sieve of 4 mm
        or stay on that of 100 mm are then not tested.

    Returns
    -------
    Share
        Of the particles tested.

    Raises
    ------
    MeshError
        If the population is empty, the arrays differ in length or hold what is no size or mass, or `slots` is
        unknown.
    """
    (sizes, widths), weights = _population(masses, sieve_sizes=sieve_sizes, slot_widths=slot_widths)
    if slots == "half":
        return _share(widths <= 0.5 * sizes, weights)
    if slots != "fractions":
        raise MeshError(f"expected slots of half or fractions; got {slots!r}.")
    fraction = np.searchsorted(np.array(TEST_SIEVES), sizes, side="left") - 1
    tested = (fraction >= 0) & (fraction < len(BAR_SLOTS))
    if not tested.any():
        raise MeshError(
            "EN 933-3 tests particles from 4 to 100 mm, but every sieve size of this population, from "
            f"{1e3 * sizes.min():.4g} to {1e3 * sizes.max():.4g} mm, is outside; use slots='half'."
        )
    return _share(widths[tested] <= np.array(BAR_SLOTS)[fraction[tested]], weights[tested])


def shape_index(lengths: ArrayLike, thicknesses: ArrayLike, masses: ArrayLike, *, limit: float = NON_CUBICAL) -> Share:
    """Percentage of non-cubical particles, whose length exceeds three times their thickness (EN 933-4).

    Parameters
    ----------
    lengths, thicknesses : array_like, shape (n,)
        Greatest and least distance of two parallel planes about each particle [m]: `length`, `slot_width`.
    masses : array_like, shape (n,)
        Any unit.
    limit : float

    Returns
    -------
    Share

    Raises
    ------
    MeshError
        If the population is empty, the arrays differ in length or hold what is no size or mass, or the limit is no
        positive number.
    """
    _require_ratios([limit])
    (long, thick), weights = _population(masses, lengths=lengths, thicknesses=thicknesses)
    return _share(long / thick > limit, weights)


def flat_and_elongated(
    lengths: ArrayLike,
    widths: ArrayLike,
    thicknesses: ArrayLike,
    masses: ArrayLike,
    *,
    ratios: ArrayLike = D4791_RATIOS,
) -> list[FlatElongated]:
    """Percentages of flat, of elongated, and of flat and elongated particles (ASTM D4791).

    Parameters
    ----------
    lengths, widths, thicknesses : array_like, shape (n,)
        Caliper dimensions [m].
    masses : array_like, shape (n,)
        Any unit.
    ratios : array_like, shape (r,)

    Returns
    -------
    list of FlatElongated
        One a ratio.

    Raises
    ------
    MeshError
        If the population is empty, the arrays differ in length or hold what is no size or mass, or a ratio is no
        positive number.
    """
    limits = _require_ratios(ratios)
    (long, wide, thick), weights = _population(masses, lengths=lengths, widths=widths, thicknesses=thicknesses)
    return [
        FlatElongated(
            ratio=ratio,
            flat=_share(wide / thick > ratio, weights),
            elongated=_share(long / wide > ratio, weights),
            flat_and_elongated=_share(long / thick > ratio, weights),
        )
        for ratio in limits
    ]


def sieve_curve(sieve_sizes: ArrayLike, masses: ArrayLike, openings: ArrayLike) -> np.ndarray:
    """Percent of the mass that passes each sieve (EN 933-1).

    Parameters
    ----------
    sieve_sizes : array_like, shape (n,)
        Smallest square opening that each particle passes [m].
    masses : array_like, shape (n,)
        Any unit.
    openings : array_like, shape (k,)
        Of the sieves [m], in any order.

    Returns
    -------
    numpy.ndarray, shape (k,)
        Percent; a particle passes the sieve of its own size.

    Raises
    ------
    MeshError
        If the population is empty, the arrays differ in length or hold what is no size or mass, or an opening is
        no positive number.
    """
    (sizes,), weights = _population(masses, sieve_sizes=sieve_sizes)
    holes = np.asarray(openings, dtype=np.float64)
    if holes.ndim != 1 or not (np.isfinite(holes) & (holes > 0.0)).all():
        raise MeshError(f"expected openings as a list of positive lengths in metres; got {openings}.")
    order = np.argsort(sizes, kind="stable")
    passed = np.concatenate([[0.0], np.cumsum(weights[order])])
    return 100.0 * passed[np.searchsorted(sizes[order], holes, side="right")] / passed[-1]


def _population(masses: ArrayLike, **lengths: ArrayLike) -> tuple[list[np.ndarray], np.ndarray]:
    """Arrays of positive lengths and of masses, one value a particle."""
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in {**lengths, "masses": masses}.items()}
    shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
    if any(array.ndim != 1 for array in arrays.values()) or len({len(array) for array in arrays.values()}) > 1:
        raise MeshError(f"expected one value a particle in every array; got the shapes {shapes}.")
    if len(arrays["masses"]) == 0:
        raise MeshError("expected at least one particle, got an empty population.")
    for name, array in arrays.items():
        bad = ~np.isfinite(array) | ((array < 0.0) if name == "masses" else (array <= 0.0))
        if bad.any():
            kind = "masses that are not negative" if name == "masses" else "positive lengths"
            place = int(np.argmax(bad))
            raise MeshError(f"expected {kind} in {name}, got {array[place]:g} for particle {place}.")
    weights = arrays.pop("masses")
    if not weights.sum() > 0.0:
        raise MeshError("expected a population with a mass, but all masses are 0.")
    return list(arrays.values()), weights


def _require_ratios(ratios: ArrayLike) -> list[float]:
    limits = np.asarray(ratios, dtype=np.float64).ravel()
    if not (np.isfinite(limits) & (limits > 0.0)).all():
        raise MeshError(f"expected ratios as positive numbers, such as 3; got {', '.join(f'{r:g}' for r in limits)}.")
    return limits.tolist()


def _share(chosen: np.ndarray, masses: np.ndarray) -> Share:
    total = float(masses.sum())
    if not total > 0.0:
        raise MeshError("expected tested particles with a mass, but all masses are 0.")
    return Share(100.0 * float(chosen.mean()), 100.0 * float(masses[chosen].sum()) / total)
