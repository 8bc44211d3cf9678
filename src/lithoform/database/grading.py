"""Particles of a database scaled to sieve sizes whose mass curve is that of a gradation.

A particle of sieve size d0 and volume V0 that is scaled to the sieve size d has the volume (V0 / d0^3) d^3: its unit
volume V0 / d0^3 is all that a draw needs, and its shape stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lithoform.database.meshes import MESH_COLUMNS, choose, particle_mesh, stream_rows
from lithoform.database.queries import rows_of
from lithoform.database.store import Store
from lithoform.descriptors.measuring import measure
from lithoform.errors import SampleError
from lithoform.gradation.curves import SAME_OPENING, Curve, Gradation
from lithoform.gradation.drawing import Draw, draw_sizes
from lithoform.lazy import cached_property
from lithoform.mesh import Mesh
from lithoform.parallel import in_order
from lithoform.progress import track

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Candidates", "Grading", "SieveRow", "Verification", "grade", "read_candidates", "verify"]


@dataclass(frozen=True, eq=False)
class Candidates:
    """Particles of a database that a gradation may be drawn from.

    Attributes
    ----------
    sources : numpy.ndarray of str, shape (c,)
    numbers : numpy.ndarray of int64, shape (c,)
    sieve_sizes : numpy.ndarray, shape (c,)
        Side of the smallest square opening that each passes [m].
    volumes : numpy.ndarray, shape (c,)
        [m^3]
    measured : int
        Of how many the sieve size was measured now, since the database did not have it.
    """

    sources: np.ndarray
    numbers: np.ndarray
    sieve_sizes: np.ndarray
    volumes: np.ndarray
    measured: int = 0

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def unit_volumes(self) -> np.ndarray:
        """Volume over sieve size cubed, shape (c,)."""
        return self.volumes / self.sieve_sizes**3


def read_candidates(
    store: Store,
    chosen: str | None = None,
    *,
    threads: int | None = None,
    device: str = "auto",
    progress: bool = False,
) -> Candidates:
    """Sieve sizes and volumes of the chosen particles; sizes that were not measured are measured from the meshes.

    Parameters
    ----------
    store : Store
    chosen : str, optional
        As `lithoform.database.meshes.choose`.
    threads, device
        As `lithoform.database.meshes.particle_meshes`.
    progress : bool
        Show a bar on a terminal while meshes are measured.

    Raises
    ------
    SampleError
        If no particle is chosen, or the choice is not valid.
    MeshError, FileFormatError
        If a mesh that must be measured is not to be had.
    """
    table = choose(store, ["source", "number", "sieve_size", "volume"], chosen)
    if not table.num_rows:
        holds = f" for which {' '.join(chosen.split())!r} holds" if chosen else ""
        raise SampleError(f"expected particles to draw from; {store.folder} has none{holds}.")
    sizes = table["sieve_size"].to_numpy().astype(np.float64)
    unknown = np.flatnonzero(np.isnan(sizes))
    if len(unknown):
        # The choice is not asked again: it may be a random one.
        rows = rows_of(store, MESH_COLUMNS, table.take(unknown))

        def work(row: Mapping[str, Any]) -> float:
            return measure(particle_mesh(store, row, device=device), ("sieve_size",))["sieve_size"]

        found = in_order(work, stream_rows(rows), threads=threads)
        sizes[unknown] = [*track(found, total=len(unknown), what="sieve sizes", enabled=progress)]
    volumes = table["volume"].to_numpy().astype(np.float64)
    return Candidates(
        np.array(table["source"].to_pylist()), table["number"].to_numpy(), sizes, volumes, measured=len(unknown)
    )


@dataclass(frozen=True)
class SieveRow:
    """One sieve of a drawn mass curve; all in percent of the mass but the opening.

    Attributes
    ----------
    opening : float
        [m]
    asked, met, difference : float
        Passing of what is drawn: the curve cut at the least size and scaled to 100, the draw, the draw less the curve.
    mixture : float
        Passing of the draw together with the fines below the least size that the curve asks for beside it.
    low, high : float or None
        Limits of the gradation, to compare with `mixture`; None where the least size is no sieve of it, and for a
        gradation that is a single curve.
    count : int
        Drawn particles between this sieve and the next coarser one.
    """

    opening: float
    asked: float
    met: float
    difference: float
    mixture: float
    low: float | None
    high: float | None
    count: int


@dataclass(frozen=True, eq=False)
class Grading:
    """A draw of scaled particles of a database.

    Attributes
    ----------
    gradation : Gradation
    curve : {"low", "mid", "high"}
        Which of its curves was asked for.
    candidates : Candidates
    draw : Draw
    """

    gradation: Gradation
    curve: Curve
    candidates: Candidates
    draw: Draw

    def __len__(self) -> int:
        return len(self.draw.sizes)

    @property
    def mass(self) -> float:
        """Of all that was drawn [kg]."""
        return float(self.draw.masses.sum())

    @property
    def scales(self) -> np.ndarray:
        """New size over that of the particle in the database, shape (n,)."""
        return self.draw.sizes / self.candidates.sieve_sizes[self.draw.candidates]

    @cached_property
    def uses(self) -> np.ndarray:
        """How often each candidate was drawn, shape (c,)."""
        return np.bincount(self.draw.candidates, minlength=len(self.candidates))

    @property
    def largest_difference(self) -> float:
        """Between the draw and the curve at any sieve [percent of the mass]."""
        return max(abs(row.difference) for row in self.sieves)

    @property
    def fines(self) -> float:
        """Percent of the whole mixture that is finer than the least size, and not drawn."""
        return float(self.gradation.passing(self.draw.fractions.openings[-1], self.curve))

    @cached_property
    def sieves(self) -> tuple[SieveRow, ...]:
        """The mass curve at the openings, from the coarsest to the least size."""
        fractions, gradation, fines = self.draw.fractions, self.gradation, self.fines
        counts, is_single = [0, *self.draw.counts.tolist()], gradation.passing_low == gradation.passing_high
        rows = []
        for opening, asked, met, count in zip(
            fractions.openings, fractions.passing.tolist(), self.draw.passing.tolist(), counts, strict=True
        ):
            place = next((i for i, d in enumerate(gradation.openings) if abs(d - opening) <= d * SAME_OPENING), None)
            limits = (
                (None, None)
                if place is None or is_single
                else (gradation.passing_low[place], gradation.passing_high[place])
            )
            mixture = fines + (100.0 - fines) * met / 100.0
            rows.append(SieveRow(opening, asked, met, met - asked, mixture, *limits, count))
        return tuple(rows)

    def mixture_passing(self, sizes: np.ndarray) -> np.ndarray:
        """Percent of the mixture that passes sizes [m] of shape (k,), with the fines below the least size."""
        order = np.argsort(self.draw.sizes, kind="stable")
        passed = np.concatenate([[0.0], np.cumsum(self.draw.masses[order])])
        met = passed[np.searchsorted(self.draw.sizes[order], sizes, side="right")] / passed[-1]
        return self.fines + (100.0 - self.fines) * met

    def particle_table(self) -> pa.Table:
        """A row a drawn particle: source, number, scale, sieve_size [m], mass [kg], fraction (between sieves, mm)."""
        import pyarrow as pa

        openings = [f"{1e3 * d:g}" for d in self.draw.fractions.openings]
        names = [f"{fine}-{coarse} mm" for coarse, fine in pairwise(openings)]
        chosen = self.draw.candidates
        known, place = np.unique(self.candidates.sources, return_inverse=True)

        def words(index: np.ndarray, texts: list[str]) -> Any:
            return pa.DictionaryArray.from_arrays(pa.array(index.astype(np.int32)), pa.array(texts, pa.string()))

        return pa.table({
            "source": words(place[chosen], known.tolist()).cast(pa.string()),
            "number": pa.array(self.candidates.numbers[chosen]),
            "scale": pa.array(self.scales),
            "sieve_size": pa.array(self.draw.sizes),
            "mass": pa.array(self.draw.masses),
            "fraction": words(self.draw.fraction, names).cast(pa.string()),
        })  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """Plain values: counts, the curve by sieve, how often particles are used."""
        most = int(self.uses.argmax())
        return {
            "gradation": self.gradation.name,
            "citation": self.gradation.citation,
            "curve": self.curve,
            "particles": len(self),
            "mass": self.mass,
            "candidates": len(self.candidates),
            "candidates_used": int((self.uses > 0).sum()),
            "sieve_sizes_measured_now": self.candidates.measured,
            "most_used": {
                "source": str(self.candidates.sources[most]),
                "number": int(self.candidates.numbers[most]),
                "times": int(self.uses[most]),
            },
            "largest_difference": self.largest_difference,
            "sieves": [vars(row) for row in self.sieves],
        }


def grade(
    candidates: Candidates,
    gradation: Gradation,
    *,
    mass: float | None = None,
    count: int | None = None,
    volume: float | None = None,
    min_size: float | None = None,
    density: float = 2650.0,
    spread: Literal["mass", "count"] = "mass",
    curve: Curve = "mid",
    seed: int = 0,
) -> Grading:
    """Draw particles whose mass by sieve size is that of a gradation.

    Parameters
    ----------
    candidates : Candidates
    gradation : Gradation
    mass, count, volume, min_size, density, spread, curve, seed
        As `lithoform.gradation.drawing.draw_sizes`; mass [kg] or volume of the solids [m^3] of what is drawn.

    Raises
    ------
    RecipeError
        As `draw_sizes`.
    """
    draw = draw_sizes(
        gradation, mass=mass, count=count, volume=volume, min_size=min_size, density=density,
        unit_volumes=candidates.unit_volumes, spread=spread, curve=curve, seed=seed,
    )  # fmt: skip
    return Grading(gradation, curve, candidates, draw)


@dataclass(frozen=True)
class Verification:
    """Drawn particles whose scaled meshes were measured anew.

    Attributes
    ----------
    count : int
    largest_deviation : float
        Largest relative deviation of the sieve size from the one that was drawn.
    largest_volume_deviation : float
        The same of the volume, which the mass follows.
    misplaced : int
        Particles whose measured size lies in another fraction.
    """

    count: int
    largest_deviation: float
    largest_volume_deviation: float
    misplaced: int


def verify(
    store: Store,
    grading: Grading,
    *,
    sample: int = 64,
    seed: int = 0,
    threads: int | None = None,
    device: str = "auto",
    progress: bool = False,
) -> Verification:
    """Scale the meshes of drawn particles and measure their sieve sizes and volumes anew.

    Parameters
    ----------
    store : Store
        The database that the candidates are of.
    grading : Grading
    sample : int
        Particles, chosen at random; all if there are no more.
    seed : int
        Of the choice.
    threads, device, progress
        As `read_candidates`.

    Raises
    ------
    SampleError
        If the sample is below 1.
    MeshError, FileFormatError
        As `lithoform.database.meshes.particle_mesh`.
    """
    import pyarrow as pa

    if sample < 1:
        raise SampleError(f"expected a sample of at least 1 particle; got {sample}.")
    draw, candidates, n = grading.draw, grading.candidates, len(grading)
    # The words of a bit generator are the same in every version of NumPy.
    order = np.argsort(np.random.Philox(key=seed).random_raw(n), kind="stable")
    picked = np.sort(order[:sample])
    wanted: dict[tuple[str, int], list[int]] = {}
    for i in picked.tolist():
        c = draw.candidates[i]
        wanted.setdefault((str(candidates.sources[c]), int(candidates.numbers[c])), []).append(i)
    sources, numbers = zip(*wanted, strict=True)
    rows = rows_of(store, MESH_COLUMNS, pa.table({"source": sources, "number": numbers}))
    scales = grading.scales

    def work(row: Mapping[str, Any]) -> list[tuple[int, float, float]]:
        mesh = particle_mesh(store, row, device=device)
        found = []
        for i in wanted[row["source"], row["number"]]:
            scaled: Mesh = mesh.with_vertices(mesh.vertices * scales[i])
            values = measure(scaled, ("sieve_size", "volume"))
            found.append((i, values["sieve_size"], values["volume"]))
        return found

    results = in_order(work, stream_rows(rows), threads=threads)
    found = [item for part in track(results, total=len(wanted), what="meshes", enabled=progress) for item in part]
    place = np.array([i for i, _, _ in found])
    sizes, volumes = (np.array([item[k] for item in found]) for k in (1, 2))
    promised = candidates.unit_volumes[draw.candidates[place]] * draw.sizes[place] ** 3
    openings = np.array(draw.fractions.openings)
    fraction = draw.fraction[place]
    inside = (sizes > openings[fraction + 1]) & (sizes <= openings[fraction])
    return Verification(
        len(found),
        float(np.abs(sizes / draw.sizes[place] - 1.0).max()),
        float(np.abs(volumes / promised - 1.0).max()),
        int((~inside).sum()),
    )
