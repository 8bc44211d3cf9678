"""Recipe to particle: the module that a reader should read first.

parameters -> radius -> mesh -> twist -> smooth -> fit to box -> flatten -> check.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Any, Final

import numpy as np

from lithoform.conditioning import fit_to_box, smooth, twist
from lithoform.errors import MeshError, UnsoundMeshError
from lithoform.feasibility import require_feasible
from lithoform.flattening import flatten
from lithoform.mesh import Mesh
from lithoform.parallel import in_order
from lithoform.parameters import Recipe, resolve_topology
from lithoform.particle import Particle
from lithoform.progress import track
from lithoform.radius import radii
from lithoform.soundness import SoundnessReport, check
from lithoform.topology import sphere
from lithoform.warp_runtime import default_threads, resolve_device

__all__ = ["generate", "generate_many"]

_MAX_ROUNDS: Final = 60
"""Relaxation rounds before giving up; 10,000 random recipes of Table 7 needed far fewer (docs/validation.md)."""

_FADING_ROUND: Final = 20
"""Round from which all relief is faded towards the plain sphere as well, which `require_feasible` has tried: the last
resort for coarse meshes that local relaxation does not mend."""


def generate(recipe: Recipe, *, device: str = "auto") -> Particle:
    """One particle from its recipe.

    Parameters
    ----------
    recipe : Recipe
    device : {"auto", "cpu", "cuda"}
        Where the noise field is evaluated.

    Returns
    -------
    Particle
        With a sound mesh in metres: solid centroid at the origin; L, W, H along x, y, z unless the recipe's
        calibration says otherwise.

    Raises
    ------
    RecipeError
        If the mesh of the recipe could not follow its twist or bear its smoothing; before any work.
    UnsoundMeshError
        If no sound mesh could be made; the recipe is in the message and in the error.
    DeviceError
        If the device is not there.

    Examples
    --------
    >>> from lithoform import Recipe, generate
    >>> generate(Recipe(seed=1)).report.sound
    True
    """
    return _generate_batch([recipe], resolve_device(device))[0]


def generate_many(
    recipes: Iterable[Recipe],
    *,
    device: str = "auto",
    threads: int | None = None,
    batch_size: int | None = None,
    progress: bool = False,
    each: Callable[[int, Particle], Any] | None = None,
) -> Iterator[Any]:
    """Stream particles in the order of their recipes, in bounded memory.

    Parameters
    ----------
    recipes : iterable of Recipe
        Any number; consumed as the particles are.
    device : {"auto", "cpu", "cuda"}
        Where the noise fields are evaluated; the rest runs on CPU threads.
    threads : int, optional
        Number of threads (default: the processors that this process may use).
    batch_size : int, optional
        Particles whose fields are evaluated in one launch (default 64 on a GPU; 1 on a CPU, where the arrays of a
        larger batch leave the cache).  It changes neither the results nor, beyond that many particles, the memory.
    progress : bool
        Show a bar on a terminal.
    each : callable, optional
        Called in the worker threads with the index (from 0) and the particle; its result is yielded in the
        particle's place, so that measuring and writing are spread over the threads as well.

    Yields
    ------
    Particle
        Or what `each` returns.

    Raises
    ------
    ValueError
        If threads or batch_size is not positive.
    RecipeError, UnsoundMeshError, DeviceError
        As `generate`; particles of the batches before the fault have been handed out.
    """
    name = resolve_device(device)
    workers = default_threads() if threads is None else threads
    size = (1 if name == "cpu" else 64) if batch_size is None else batch_size
    if workers < 1 or size < 1:
        raise ValueError(f"expected at least one thread and a batch of at least one, got {threads} and {batch_size}.")
    total = len(recipes) if isinstance(recipes, Sized) else None
    stream = _stream(_batches(recipes, size), name, workers, each)
    return track(stream, total=total, what="particles", enabled=progress) if progress else stream


def _stream(
    batches: Iterator[tuple[int, list[Recipe]]], device: str, workers: int, each: Callable[[int, Particle], Any] | None
) -> Iterator[Any]:
    def work(numbered: tuple[int, list[Recipe]]) -> list[Any]:
        start, batch = numbered
        particles = _generate_batch(batch, device)
        return particles if each is None else [each(start + i, particle) for i, particle in enumerate(particles)]

    for results in in_order(work, batches, threads=workers):
        yield from results


def _batches(recipes: Iterable[Recipe], size: int) -> Iterator[tuple[int, list[Recipe]]]:
    """Runs of at most `size` recipes that share a topology, with the index of the first."""
    start = 0
    for _, run in groupby(recipes, key=lambda recipe: (recipe.triangles, recipe.topology)):
        while batch := list(islice(run, size)):
            yield start, batch
            start += len(batch)


def _generate_batch(recipes: Sequence[Recipe], device: str) -> list[Particle]:
    for recipe in recipes:
        require_feasible(recipe)
    base = sphere(*resolve_topology(recipes[0].triangles, recipes[0].topology))
    return [
        _finish(r, base, radius)
        for r, radius in zip(recipes, radii(recipes, base.vertices, device=device), strict=True)
    ]


def _finish(recipe: Recipe, base: Mesh, radius: np.ndarray) -> Particle:
    """Condition and check; where faces cross, relax the relief there and try again.

    The twist carries the true surface without crossings, but flat triangles too coarse for the relief may
    cross.  The radial graph before it is always sound, so that relaxing it around the crossings, in rings that
    widen from round to round, tends to a twisted sphere, which is (coarser meshes are refused by the recipe).
    Where the blended band of the flattening is at fault it is narrowed.  What was changed is reported with the
    particle.
    """
    relaxed = np.zeros(len(radius), dtype=bool)
    band = recipe.flatten_band if recipe.flatten else None
    round_ = -1
    while True:
        round_ += 1
        attempt = _attempt(recipe, base, radius, band)
        if attempt.report is not None and attempt.report.sound:
            return Particle(recipe, attempt.mesh, attempt.report, int(relaxed.sum()), round_, band)
        if round_ >= _MAX_ROUNDS:
            raise UnsoundMeshError(
                f"no sound mesh was found for this recipe in {round_} rounds ({attempt.problems}); try more triangles, "
                f"a smaller twist rate or a smaller k.  The recipe: {recipe}",
                attempt.report,
                recipe,
            )
        if band and attempt.band_at_fault:
            band = 0.5 * band if band > 0.2 * recipe.flatten_band else 0.0
            if recipe.flatten_depth > 0.0:
                continue  # a cut without its band is sound as a rule: leave the relief alone
        region = attempt.region
        for _ in range(1 + round_ // 3):
            region = region | (base.connectivity.neighbour_mean @ region > 0.0)
        relaxed |= region
        # In the logarithm deep pits and high spikes are relaxed alike, and the radius stays positive.
        log_radius = np.log(radius)
        mean = base.connectivity.neighbour_mean @ log_radius
        radius = np.where(region, np.exp(0.5 * (log_radius + mean)), radius)
        if round_ >= _FADING_ROUND:
            relaxed[:] = True
            radius = recipe.base_radius * (radius / recipe.base_radius) ** 0.7


@dataclass(frozen=True)
class _Attempt:
    """A conditioned mesh and, if it is not sound, where on the radial graph the fault lies."""

    mesh: Mesh
    report: SoundnessReport | None  # None: the flattening itself refused the body
    problems: str
    region: np.ndarray  # vertices at fault, shape (vertices,), bool
    band_at_fault: bool


def _attempt(recipe: Recipe, base: Mesh, radius: np.ndarray, band: float | None) -> _Attempt:
    try:
        uncut = _calibrated(recipe, base, radius)
    except MeshError as refused:
        raise UnsoundMeshError(f"{refused}  The recipe: {recipe}", recipe=recipe) from refused
    if band is not None and recipe.flatten_depth > 0.0:
        report = _check_stored(uncut)  # only a sound body can be cut
        if not report.sound:
            return _Attempt(uncut, report, "; ".join(report.problems()), _faulty(uncut, report), band_at_fault=False)
    bottom = _bottom(recipe, uncut, band or 0.0)
    try:
        mesh = _flattened(recipe, uncut, band)
    except MeshError as refused:  # such as a section that would leave a ring
        return _Attempt(uncut, None, str(refused), bottom, band_at_fault=False)
    report = _check_stored(mesh)
    # After a cut the vertices are others: the fault is at the cut, since the body before it was sound.
    region = _faulty(mesh, report) if mesh.connectivity is base.connectivity else bottom
    return _Attempt(mesh, report, "; ".join(report.problems()), region, bool((region & bottom).any()))


def _calibrated(recipe: Recipe, base: Mesh, radius: np.ndarray) -> Mesh:
    mesh = base.with_vertices(radius[:, None] * base.vertices)
    mesh = twist(mesh, axis=recipe.twist_axis, point=recipe.twist_point, rate=float(np.radians(recipe.twist_rate)))
    mesh = smooth(
        mesh,
        iterations=recipe.smoothing_iterations,
        method=recipe.smoothing_method,
        lambda_=recipe.smoothing_lambda,
        mu=recipe.smoothing_mu,
    )
    # Centred before it is scaled: the twist may have carried the body off, and a small one far away loses digits.
    mesh = mesh.with_vertices(mesh.vertices - mesh.mass_properties.centroid)
    if recipe.calibration_frame == "none":
        return mesh
    return fit_to_box(
        mesh,
        recipe.size,
        frame=recipe.calibration_frame,
        weighting=recipe.calibration_weighting,
        fit=recipe.calibration_fit,
        align=recipe.calibration_align,
    )


def _flattened(recipe: Recipe, mesh: Mesh, band: float | None) -> Mesh:
    """Support face, then the solid's centroid to the origin."""
    if band is not None:
        height = float(np.ptp(mesh.vertices[:, 2]))
        mesh = flatten(mesh, depth=recipe.flatten_depth * height, band=band * height)
    return mesh.with_vertices(mesh.vertices - mesh.mass_properties.centroid)


def _check_stored(mesh: Mesh) -> SoundnessReport:
    """Report of a mesh that must be sound as it is and after the rounding of a file of 32-bit numbers.

    The rounding is that of the default file, an STL in millimetres; `Particle.save` checks any other.
    """
    report = check(mesh)
    if not report.sound:
        return report
    rounded = check(mesh.with_vertices((mesh.vertices * 1000.0).astype(np.float32)))
    return report if rounded.sound else rounded


def _faulty(mesh: Mesh, report: SoundnessReport) -> np.ndarray:
    """Vertices of the faces at fault, as a mask, shape (vertices,)."""
    region = np.zeros(len(mesh.vertices), dtype=bool)
    region[mesh.faces[np.union1d(report.self_intersections.ravel(), report.zero_area_faces)].ravel()] = True
    return region


def _bottom(recipe: Recipe, uncut: Mesh, band: float) -> np.ndarray:
    """Vertices below the top of the band, as a mask, shape (vertices,)."""
    z = uncut.vertices[:, 2]
    return z <= z.min() + (recipe.flatten_depth + band) * np.ptp(z)
