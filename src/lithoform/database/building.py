"""Building a database: recipes drawn in each class, generated, checked, measured, stored batch by batch."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from lithoform.database.engine import ClusterError, require_workers, spread
from lithoform.database.schema import mesh_row, mesh_table, particle_schema, recipe_values, shape_values
from lithoform.database.store import Source, Store, new_source
from lithoform.descriptors.body import Body, BoxKind
from lithoform.descriptors.measuring import measure, resolve_names
from lithoform.errors import LithoformError, MeshError, RecipeError
from lithoform.generation import generate, generate_many
from lithoform.parameters import Recipe
from lithoform.particle import Particle
from lithoform.presets import shape_class_of
from lithoform.sidecar import program_version
from lithoform.topology import sphere
from lithoform.warp_runtime import resolve_device

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Measures", "Numbered", "batch_size", "build", "carry_out", "guarded"]


class Numbered(Protocol):
    """What draws the recipes of a source: a plan of `lithoform generate`, or a design of `lithoform.sensitivity`.

    A particle depends on nothing but its number; `as_dict` says in plain values what was asked for.
    """

    @property
    def count(self) -> int:
        """Number of particles, which are numbered from 1."""
        ...

    def recipe(self, number: int) -> Recipe:
        """Recipe of a particle; a `RecipeError` where its settings cannot go together."""
        ...

    def class_of(self, number: int) -> str | None:
        """Zingg class in which a particle is drawn, if any."""
        ...

    def validate(self) -> None:
        """Refuse what cannot be carried out, before any work."""
        ...

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        ...


@dataclass(frozen=True)
class Measures:
    """What is measured of every particle of a source, and whether its mesh is kept.

    Attributes
    ----------
    names : tuple of str
        Of `DESCRIPTORS`, or the sets "four", "standard", "all"; Zingg's class is always measured.
    box : {"principal", "solid", "vertices", "minimum"}
    scale : float
        Of the roundness.
    keep_meshes : bool
    """

    names: tuple[str, ...] = ("standard",)
    box: BoxKind = "principal"
    scale: float = 0.25
    keep_meshes: bool = False

    def resolved(self) -> Measures:
        """The same with the names of descriptors alone; an error of `measure` if something is unknown."""
        Body(sphere("octahedral", 1), box=self.box, scale=self.scale)
        return replace(self, names=tuple(dict.fromkeys((*resolve_names(self.names), "zingg_class"))))

    def row(self, mesh: Any) -> dict[str, Any]:
        """Columns of a mesh [m]."""
        found = measure(mesh, self.names, box=self.box, scale=self.scale)
        return shape_values(mesh, found, box=self.box, scale=self.scale)

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {"descriptors": list(self.names), "box": self.box, "scale": self.scale}


def batch_size(count: int, *, keep_meshes: bool) -> int:
    """Particles a batch: so few that little is lost when a build is stopped, so many that a million are 1,000 files."""
    return max(25, min(-(-count // 200), 50 if keep_meshes else 1000))


def build(
    folder: str | Path,
    plan: Numbered,
    measures: Measures | None = None,
    *,
    source: str = "generated",
    is_named: bool = True,
    workers: int | None = None,
    scheduler: str | None = None,
    device: str = "auto",
) -> Iterator[int]:
    """Generate, check, measure and store the particles of a plan that are not there yet.

    Parameters
    ----------
    folder : path-like
        A database, or a new or empty folder.
    plan : Numbered
        The particles of a `Plan` are those that `lithoform generate` makes with the same options.
    measures : Measures, optional
    source : str
        Name of these particles in the database.
    is_named : bool
        As `Store.add`.
    workers, scheduler
        As `lithoform.database.engine.spread`.
    device : {"auto", "cpu", "cuda"}
        Where noise fields are evaluated.

    Yields
    ------
    int
        Number of each particle once its row is on the disk; first those that were there, in order, then the new ones
        as batches are done.

    Raises
    ------
    OutputError, FileFormatError
        As `Store.writing` and `Store.add`, and if a batch cannot be written; the batches before it are kept.
    RecipeError, MeshError, ClusterError
        If the plan, the measures or the workers are not what they should be; before any work.

    Notes
    -----
    Stopped at any moment and called again with the same arguments it ends with the files of a run that was not stopped,
    bit for bit: a batch depends on the plan alone.  A recipe of which no sound mesh can be made has a row with the
    reason in the column error; so has a number of which the plan draws no valid recipe, and its row has nothing else.
    """
    measures = (measures or Measures()).resolved()
    plan.validate()
    # What is not there is left out, so that a later version may add to it.
    asked = {k: v for k, v in plan.as_dict().items() if k not in ("count", "format", "unit") and v is not None}
    told = {**asked, **measures.as_dict()}
    size = batch_size(plan.count, keep_meshes=measures.keep_meshes)
    entry = new_source(source, "generated", plan.count, batch=size, keeps_meshes=measures.keep_meshes, plan=told)
    job = {"plan": plan, "measures": measures, "device": device}
    return carry_out(
        folder, entry, _generated_rows, lambda _: job, is_named=is_named, workers=workers, scheduler=scheduler
    )


def carry_out(
    folder: str | Path,
    source: Source,
    rows_of: Any,
    job: Callable[[range], dict[str, Any]],
    *,
    is_named: bool = True,
    workers: int | None,
    scheduler: str | None,
) -> Iterator[int]:
    """Batches of a source that are missing or damaged are made and stored; the numbers of all are yielded.

    Parameters
    ----------
    folder : path-like
    source : Source
    rows_of : callable
        A function of a module: of a job and a range of numbers, an iterator of rows with their meshes or None.
    job : callable
        What `rows_of` needs for a range of numbers, in plain values.
    is_named : bool
        As `Store.add`.
    workers, scheduler
        As `spread`.
    """
    require_workers(workers, scheduler)
    with Store.writing(folder) as store:
        store.add(source, is_named=is_named)
        open_batches = []
        there = set(store.present(source))
        for batch in range(1, source.batches + 1):
            if batch in there and not store.damaged(source, batch):
                yield from source.numbers(batch)
            else:
                open_batches.append(batch)
        if not open_batches:
            return
        bare = replace(source, plan={})  # workers need no list of all files
        jobs = ((rows_of, job(source.numbers(batch)), bare, batch) for batch in open_batches)
        # Closed here, so that workers end before the folder is free for another run.
        with contextlib.closing(spread(make_batch, jobs, workers=workers, scheduler=scheduler)) as results:
            for batch, version, rows, meshes in results:
                if version != source.lithoform:
                    raise ClusterError(
                        f"the workers run lithoform {version}, and this is {source.lithoform}: install the same there."
                    )
                store.write(source, batch, rows, meshes)
                yield from source.numbers(batch)


def make_batch(job: tuple[Any, dict[str, Any], Source, int]) -> tuple[int, str, pa.Table, pa.Table | None]:
    """A batch, its number, and the version that made it: the work of one worker."""
    import pyarrow as pa

    rows_of, content, source, batch = job
    rows, meshes = [], []
    for number, (row, mesh) in zip(source.numbers(batch), rows_of(content, source.numbers(batch)), strict=True):
        rows.append(
            {"source": source.name, "number": number, "kind": source.kind, "lithoform": program_version(), **row}
        )
        if source.keeps_meshes and mesh is not None:
            meshes.append(mesh_row(source.name, number, mesh))
    table = pa.Table.from_pylist(rows, schema=particle_schema())
    return batch, program_version(), table, mesh_table(meshes) if source.keeps_meshes else None


def guarded(row: dict[str, Any], work: Any) -> tuple[dict[str, Any], Any]:
    """A row with what some work adds to it, and its mesh; where the work fails, with the reason instead."""
    try:
        more, mesh = work()
    except MemoryError:
        raise
    except LithoformError as error:
        return {**row, "error": _plain(error)}, None
    except Exception as error:
        # A fault of ours or of a library in one particle is no reason to lose a long build.
        return {**row, "error": f"it failed unexpectedly ({type(error).__name__}: {_plain(error)})."}, None
    return {**row, **more}, mesh


def _plain(error: Exception) -> str:
    """Message in one line of UTF-8: it may name a file whose name is no text in any coding."""
    text = str(error).partition("  The recipe:")[0]  # the row holds it
    return " ".join(text.split()).encode(errors="surrogateescape").decode(errors="backslashreplace")


def _generated_rows(job: dict[str, Any], numbers: Sequence[int]) -> Iterator[tuple[dict[str, Any], Any]]:
    plan, measures, device = job["plan"], job["measures"], job["device"]
    recipes = [_drawn(plan, number) for number in numbers]
    together = _made_together([recipe for recipe in recipes if isinstance(recipe, Recipe)], device)
    for number, recipe in zip(numbers, recipes, strict=True):
        if isinstance(recipe, RecipeError):
            yield {"class": plan.class_of(number), "error": _plain(recipe)}, None
            continue
        shape_class = plan.class_of(number) or shape_class_of(recipe.size)
        row = {"class": shape_class, **recipe_values(recipe)}

        def work(recipe: Recipe = recipe) -> tuple[dict[str, Any], Any]:
            return _measured(generate(recipe, device=device) if together is None else together[recipe], measures)

        yield guarded(row, work)


def _drawn(plan: Numbered, number: int) -> Recipe | RecipeError:
    """Recipe of a particle, or why it has none: a design may hold settings that cannot go together."""
    try:
        return plan.recipe(number)
    except RecipeError as error:
        return error


def _made_together(recipes: list[Recipe], device: str) -> dict[Recipe, Particle] | None:
    """Particles made in one launch on a GPU; None where each is made by itself: on a CPU, or where one cannot be."""
    if resolve_device(device) == "cpu":
        return None
    try:
        return dict(zip(recipes, generate_many(recipes, device=device, threads=1), strict=True))
    except (MeshError, RecipeError):
        return None


def _measured(particle: Particle, measures: Measures) -> tuple[dict[str, Any], Any]:
    how = particle.provenance
    provenance = {
        "certificate": how["certificate"],
        "relaxed_vertices": how["relaxed_vertices"],
        "relaxation_rounds": how["relaxation_rounds"],
        "used_flatten_band": how["flatten_band"],
    }
    return {**provenance, **measures.row(particle.mesh)}, particle.mesh
