"""The stones of a specimen: drawn from a database by a gradation, for a mould that may be a smaller one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lithoform.compaction.protocol import Protocol
from lithoform.database.grading import Candidates, Grading, grade, read_candidates
from lithoform.database.meshes import MESH_COLUMNS, choose, particle_mesh, particle_name
from lithoform.database.store import Store
from lithoform.dem import TABLE_10, Cylinder, Model, Plane, Shape
from lithoform.errors import MeshError, RecipeError, SampleError, SceneError
from lithoform.gradation.curves import Gradation
from lithoform.parallel import in_order
from lithoform.progress import track

__all__ = ["LEAST_HEIGHT", "LEAST_WIDTH", "LOOSE", "Plan", "Specimen", "check_specimen", "make_specimen"]

LOOSE: Final = 0.53
"""Packing density for which the mass is chosen: the middle of what the paper's loose mixtures have."""

LEAST_WIDTH: Final = 4.0
"""Diameter of the mould over the largest sieve size, at least."""

LEAST_HEIGHT: Final = 1.0
"""Height of the loose specimen over the largest sieve size, at least."""

# Different stones in memory, about 1 MB each; and how often one may be taken on the average.
_MOST_SHAPES, _MOST_USES = 1000, 100


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a specimen is made of.

    Attributes
    ----------
    gradation : Gradation
    min_size : float
        Least sieve size [m].
    curve : {"low", "mid", "high"}
    count : int or None
        Stones; None: as many as fill the mould to the loose height at a packing density of 0.53.
    mould : float or None
        Diameter [m]; None: the protocol's, or, for a count, such that the specimen is as high over its width as there.
    select : str or None
        Particles of the database.
    seed : int
        Of the choice of the particles, their sizes and their order.
    stiffness_factor : float
        On Young's modulus of Table 10.
    """

    gradation: Gradation
    min_size: float
    curve: Any = "mid"
    count: int | None = None
    mould: float | None = None
    select: str | None = None
    seed: int = 0
    stiffness_factor: float = 0.1


@dataclass(frozen=True, eq=False)
class Specimen:
    """Stones of a specimen in the order in which they fall into the mould.

    Attributes
    ----------
    model : Model
        With the lower platen, wall 0, and the mould, wall 1.
    names : tuple of str
        Of the shapes.
    grading : Grading
    diameter : float
        Of the mould [m].
    height_scale : float
        Of its heights over those of the protocol: at a packing density of 0.53 it has its loose height.
    """

    model: Model
    names: tuple[str, ...]
    grading: Grading
    diameter: float
    height_scale: float

    @property
    def area(self) -> float:
        """Of the platens [m^2]."""
        return 0.25 * math.pi * self.diameter**2

    @property
    def solid(self) -> float:
        """Volume of the stones [m^3]."""
        return float(self.model.volume.sum())

    @property
    def largest(self) -> float:
        """Largest sieve size [m]."""
        return float(self.grading.draw.sizes.max())

    def density(self, height: float) -> float:
        """Packing density (eq. 27) at a height [m]."""
        return self.solid / (self.area * height)

    def scaled(self, protocol: Protocol) -> list[str]:
        """What is smaller than in the protocol, in sentences."""
        told = []
        if abs(self.diameter / protocol.diameter - 1.0) > 1e-6 or abs(self.height_scale - 1.0) > 0.01:
            told.append(
                f"The mould is {1e3 * self.diameter:.1f} mm wide instead of {1e3 * protocol.diameter:g} mm, and "
                f"heights are taken {self.height_scale:.3f} times those of the protocol; the stones are not scaled."
            )
        ratio, usual = self.diameter / self.largest, protocol.diameter / self.largest
        told.append(
            f"The mould is {ratio:.1f} times as wide as the largest stone's sieve size"
            + (f" (a {1e3 * protocol.diameter:g} mm mould: {usual:.1f})." if abs(ratio / usual - 1.0) > 1e-6 else ".")
        )
        return told


def make_specimen(
    store: Store,
    plan: Plan,
    protocol: Protocol,
    *,
    threads: int | None = None,
    device: str = "auto",
    progress: bool = False,
    told: Callable[[str], object] = lambda _: None,
) -> Specimen:
    """Draw the stones of a specimen and make their shapes.

    Parameters
    ----------
    store : Store
        The population.
    plan : Plan
    protocol : Protocol
    threads, device
        As `lithoform.database.grading.read_candidates`.
    progress : bool
        Whether to show bars.
    told : callable
        Is told notes, a sentence at a time.

    Raises
    ------
    SampleError
        If the population is too small.
    RecipeError
        If the gradation cannot be filled with so many stones.
    SceneError
        If the mould is too narrow for the largest stone.
    """
    rng = np.random.default_rng([plan.seed, 0])
    candidates, grading, diameter = _drawn(store, plan, protocol, rng, threads=threads, device=device,
                                           progress=progress)  # fmt: skip
    order = rng.permutation(len(grading))
    used, which = np.unique(grading.draw.candidates[order], return_inverse=True)
    shapes, names = _shapes(store, candidates, used, threads=threads, device=device, progress=progress, told=told)
    walls = (Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)), Cylinder(radius=0.5 * diameter))
    model = Model(shapes=shapes, materials=(TABLE_10.softened(plan.stiffness_factor),), shape=which,
                  scale=grading.scales[order], walls=walls)  # fmt: skip
    loose = float(model.volume.sum()) / (LOOSE * 0.25 * math.pi * diameter**2)
    return Specimen(model, names, grading, diameter, loose / protocol.loose_height)


def check_specimen(
    store: Store, plan: Plan, protocol: Protocol, *, threads: int | None = None, device: str = "auto"
) -> None:
    """Draw the stones of a specimen without making them.

    Raises
    ------
    SampleError, RecipeError, SceneError
        As `make_specimen`.
    """
    rng = np.random.default_rng([plan.seed, 0])
    _drawn(store, plan, protocol, rng, threads=threads, device=device, progress=False)


def _drawn(
    store: Store, plan: Plan, protocol: Protocol, rng: np.random.Generator, *, threads: int | None, device: str,
    progress: bool,
) -> tuple[Candidates, Grading, float]:  # fmt: skip
    """Particles that were chosen from, stones that were drawn, and the diameter of the mould [m]."""
    candidates = _some(store, plan, rng, threads=threads, device=device, progress=progress)
    grading = _graded(candidates, plan, protocol)
    if len(grading) > _MOST_USES * len(candidates):
        raise SampleError(
            f"expected at least {math.ceil(len(grading) / _MOST_USES)} different particles for {len(grading)} stones; "
            f"the population has {len(candidates)}: take a larger one, or fewer stones."
        )
    diameter = plan.mould or (_narrowed(grading, protocol) if plan.count else protocol.diameter)
    largest = float(grading.draw.sizes.max())
    if diameter < LEAST_WIDTH * largest:
        raise SceneError(
            f"expected a mould at least {LEAST_WIDTH:g} times as wide as the largest sieve size, {1e3 * largest:.3g} "
            f"mm; got one of {1e3 * diameter:.1f} mm: take more stones (--count), a larger --mould, or leave smaller "
            "stones out (--min-size), of which a specimen needs so many."
        )
    height = _solid(grading) / (LOOSE * 0.25 * math.pi * diameter**2)
    if height < LEAST_HEIGHT * largest:
        raise SceneError(
            f"expected stones that fill the mould at least as high as the largest sieve size, "
            f"{1e3 * largest:.3g} mm; {len(grading)} of them fill one of {1e3 * diameter:.4g} mm to "
            f"{1e3 * height:.3g} mm: take more stones (--count), or a narrower --mould."
        )
    return candidates, grading, diameter


def _some(
    store: Store, plan: Plan, rng: np.random.Generator, *, threads: int | None, device: str, progress: bool
) -> Candidates:
    """Particles that the specimen may be made of: a random choice where there are more than are needed."""
    rows = choose(store, ["source", "number"], plan.select).to_pylist()
    if not rows:
        raise SampleError(f"expected particles in {store.folder}; none is chosen.")
    most = min(_MOST_SHAPES, plan.count or _MOST_SHAPES)
    if len(rows) > most:
        rows = [rows[i] for i in np.sort(rng.choice(len(rows), most, replace=False)).tolist()]
    quoted = ", ".join("('{}', {})".format(row["source"].replace("'", "''"), row["number"]) for row in rows)
    return read_candidates(store, f"(source, number) in ({quoted})", threads=threads, device=device, progress=progress)


def _graded(candidates: Candidates, plan: Plan, protocol: Protocol) -> Grading:
    asked: dict[str, Any] = {"count": plan.count}
    if plan.count is None:
        diameter = plan.mould or protocol.diameter
        height = protocol.loose_height * diameter / protocol.diameter
        asked = {"volume": LOOSE * 0.25 * math.pi * diameter**2 * height}
    try:
        return grade(candidates, plan.gradation, min_size=plan.min_size, curve=plan.curve, seed=plan.seed,
                     density=TABLE_10.density, **asked)  # fmt: skip
    except RecipeError as error:
        raise RecipeError(f"the gradation cannot be filled: {error}") from None


def _solid(grading: Grading) -> float:
    """Volume of the stones [m^3]."""
    return float(grading.draw.masses.sum()) / TABLE_10.density


def _narrowed(grading: Grading, protocol: Protocol) -> float:
    """Diameter at which the stones at the loose packing density are as high over wide as the protocol's specimen."""
    solid = _solid(grading)
    slender = protocol.loose_height / protocol.diameter
    return (solid / (LOOSE * 0.25 * math.pi * slender)) ** (1.0 / 3.0)


def _shapes(
    store: Store, candidates: Candidates, used: np.ndarray, *, threads: int | None, device: str, progress: bool,
    told: Callable[[str], object],
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:  # fmt: skip
    keys = {(str(candidates.sources[k]), int(candidates.numbers[k])): at for at, k in enumerate(used.tolist())}
    quoted = ", ".join("('{}', {})".format(source.replace("'", "''"), number) for source, number in keys)
    rows = choose(store, MESH_COLUMNS, f"(source, number) in ({quoted})").to_pylist()
    rows.sort(key=lambda row: keys[row["source"], row["number"]])

    def work(row: dict[str, Any]) -> Shape:
        try:
            return Shape.from_mesh(particle_mesh(store, row, device=device))
        except MeshError as error:
            raise MeshError(f"{particle_name(row)}: {error}") from None

    made = in_order(work, rows, threads=threads)
    shapes = tuple(track(made, total=len(rows), what="stones", enabled=progress))
    told(f"{len(rows)} different particles of {store.folder}.")
    return shapes, tuple(particle_name(row) for row in rows)
