"""What a run of `lithoform generate` makes: the options as a plan of numbered particles."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from lithoform import mesh_io
from lithoform.errors import FileFormatError, RecipeError
from lithoform.feasibility import require_feasible
from lithoform.parameters import Recipe, suggest
from lithoform.population_recipe import is_population, parse_population_recipe, read_population_recipe
from lithoform.presets import PRESETS, SHAPE_CLASSES, benchmark_recipe, database_recipe, draw_size, particle_seed
from lithoform.recipe_io import from_dict, parse_settings, read_recipe, read_table
from lithoform.seeds import MAX_SEED
from lithoform.sidecar import read_sidecar

__all__ = ["MAX_COUNT", "Plan", "plan_run"]

MAX_COUNT: Final = 10_000_000
"""Particles of one run: a folder of more files than twice that serves nobody."""

_DIMENSIONS: Final = ("length", "width", "height")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a run makes; particle by particle it depends on nothing else.

    Attributes
    ----------
    count : int
        Number of particles, numbered from 1.
    seed : int or None
        Run seed from which each particle's own is derived; None uses the recipe's own seed (one particle).
    preset : {"benchmark", "database"} or None
        None where `base` is a whole recipe.
    shape_class : {"cube", "plate", "column", "blade", "mixed"} or None
        Class in which the dimensions are drawn; "mixed" takes the four in turn.
    base : dict
        Fields set by the user, or a whole recipe (lengths in metres).
    population : str or None
        Text of a population recipe in TOML, from which every particle is drawn; `base` is set on each.
    format, unit : str
        Of the mesh files.
    """

    count: int
    seed: int | None
    preset: str | None
    shape_class: str | None
    base: dict[str, Any] = field(default_factory=dict)
    population: str | None = None
    format: str = "stl"
    unit: str = "mm"

    def class_of(self, number: int) -> str | None:
        """Zingg class in which particle `number` is drawn, if any."""
        if self.shape_class == "mixed":
            return SHAPE_CLASSES[(number - 1) % len(SHAPE_CLASSES)]
        return self.shape_class

    def recipe(self, number: int) -> Recipe:
        """Recipe of particle `number` (from 1).

        Raises
        ------
        RecipeError
            If the settings are not valid.
        """
        if self.seed is None:
            return from_dict(self.base)
        if self.population is not None:
            return parse_population_recipe(self.population).recipe(number, self.seed).replace(**self.base)
        seed = particle_seed(self.seed, number)
        shape_class = self.class_of(number)
        if self.preset == "database" and shape_class is not None:
            return database_recipe(shape_class, seed=seed, **self.base)
        settings = {**self.base, "seed": seed}
        if shape_class is not None:
            settings["size"] = draw_size(shape_class, seed)
        if self.preset == "database":
            settings = {"main_scale": 1.0, "warp_scale": 1.0, **settings}
        return benchmark_recipe(**settings)

    def mesh_file(self, number: int) -> str:
        """Name of the mesh of particle `number`."""
        return f"{number:06d}.{self.format}"

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as they come back from JSON."""
        return json.loads(json.dumps(asdict(self)))

    def validate(self) -> None:
        """Refuse a plan that cannot be carried out, before any work.

        Raises
        ------
        RecipeError
            If the count or the seed is out of range, or the first particle of a class has no valid recipe.
        FileFormatError
            If the format or the unit is unknown.
        """
        if self.count < 1:
            raise RecipeError(f"expected --count of at least 1; got {self.count}.")
        if self.count > MAX_COUNT:
            raise RecipeError(
                f"expected --count of at most {MAX_COUNT}; got {self.count}: make several runs with seeds of their own."
            )
        if self.seed is not None and not 0 <= self.seed <= MAX_SEED:
            raise RecipeError(f"the seed must be 0 to {MAX_SEED}; got {self.seed}.")
        mesh_io.file_unit(self.format, self.unit)
        for number in range(1, min(self.count, len(SHAPE_CLASSES)) + 1):
            require_feasible(self.recipe(number))


def plan_run(
    *,
    count: int | None,
    seed: int | None,
    shape_class: str | None,
    preset: str | None,
    recipe: Path | None,
    settings: list[str],
    size: str | None,
    unit: str | None,
    triangles: int | None,
    format: str | None,
) -> Plan:
    """Plan that the options of `lithoform generate` mean; every conflict between them is an error here.

    Parameters
    ----------
    count, seed, shape_class, preset, recipe, settings, size, unit, triangles, format
        The options as given (None: not given); lengths in the unit of `unit`.

    Returns
    -------
    Plan

    Raises
    ------
    RecipeError
        If a value is not valid or two options contradict each other.
    FileFormatError
        If the recipe file cannot be read, or the format or unit is unknown.
    """
    classes = (*SHAPE_CLASSES, "mixed")
    for name, value, known in (("class", shape_class, classes), ("preset", preset, PRESETS)):
        if value is not None and value not in known:
            raise RecipeError(
                f"expected --{name} to be one of {', '.join(known)}; got {value!r}.{suggest(value, known)}"
            )
    fields = parse_settings(settings)
    base: dict[str, Any] = {}
    sidecar: dict[str, str] = {}
    if recipe is not None and preset is not None:
        raise RecipeError("--recipe is a whole recipe and --preset another; give one of them.")
    population = _population_of(recipe) if recipe is not None else None
    if population is not None:
        if shape_class is not None or size is not None or any(name in fields for name in _DIMENSIONS):
            raise RecipeError("a population recipe draws the dimensions itself; leave out --class, --size and L, W, H.")
        seed = 0 if seed is None else seed
    elif recipe is not None:
        sidecar = _sidecar_of(recipe)
        base = read_recipe(recipe).as_dict()
        if seed is None and count not in (None, 1):
            seed = base["seed"]
    unit = mesh_io.known_key("unit", sidecar.get("unit", "mm") if unit is None else unit, mesh_io.UNITS)
    metre = 1.0 / mesh_io.UNITS[unit]
    if "seed" in fields:
        raise RecipeError("set the seed with --seed; each particle's own seed is derived from it.")
    # Dimensions stay in the unit of the run until all are known.
    given = {name: fields.pop(name) for name in _DIMENSIONS if name in fields}
    if size is not None:
        if given:
            raise RecipeError("give the dimensions by --size or by --set L=, W=, H=; not by both.")
        given = _parse_size(size)
    if given and shape_class is not None:
        raise RecipeError("--class draws the dimensions and --size (or --set L=...) gives them; use one of them.")
    if triangles is not None:
        fields["triangles"] = triangles
    if population is not None:
        pass
    elif recipe is None:
        preset = preset or "database"
        if preset == "benchmark" and shape_class is None:
            # Table 1 gives no unit for its 2 x 1.5 x 1: they are read in the unit of the run.
            given = {"length": 2.0, "width": 1.5, "height": 1.0, **given}
        if preset == "database" and not given:
            shape_class = shape_class or "mixed"
        if given and len(given) < len(_DIMENSIONS):
            raise RecipeError("the preset database draws L, W and H together: give L, W and H together, or --size.")
        if seed is None:
            seed = 0
    elif seed is not None or shape_class is not None:
        seed = base["seed"] if seed is None else seed
        del base["seed"]
        if shape_class is not None:
            for name in _DIMENSIONS:
                del base[name]
    if given:
        _require_order(given, base, unit)
    fields |= {name: _as_float(value) * metre for name, value in given.items()}
    plan = Plan(
        count=1 if count is None else count,
        seed=seed,
        preset=preset,
        shape_class=shape_class,
        base={**base, **fields},
        population=population,
        format=mesh_io.known_key(
            "mesh format", sidecar.get("format", "stl") if format is None else format, mesh_io.FORMATS
        ),
        unit=unit,
    )
    plan.validate()
    return plan


def _population_of(path: Path) -> str | None:
    """Text of a population recipe; None if the file is something else."""
    return read_population_recipe(path).to_toml() if is_population(*read_table(path)) else None


def _sidecar_of(path: Path) -> dict[str, str]:
    """Format and unit that a particle's sidecar asks for; empty for a plain recipe.

    A glb file is in metres whatever was asked for, so that its sidecar tells no unit of the run.
    """
    values, kind = read_table(path)
    if kind != "JSON" or not isinstance(values, dict) or "schema" not in values:
        return {}
    sidecar = read_sidecar(path)
    try:
        form = mesh_io.known_key("mesh format", sidecar["format"], mesh_io.FORMATS)
        unit = mesh_io.known_key("unit", sidecar["unit"], mesh_io.UNITS)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    return {"format": form} if mesh_io.FORMATS[form].unit_rule == "metre" else {"format": form, "unit": unit}


def _parse_size(text: str) -> dict[str, float]:
    try:
        length, width, height = (float(part) for part in text.split(","))
    except ValueError:
        raise RecipeError(f"expected --size L,W,H, such as 20,15,10; got {text!r}.") from None
    return {"length": length, "width": width, "height": height}


def _require_order(given: dict[str, Any], base: dict[str, Any], unit: str) -> None:
    """Refuse dimensions out of order in the unit in which they were given; the recipe itself speaks in metres."""
    scale = mesh_io.UNITS[unit]
    metres = [_as_float(given[name]) * (1.0 / scale) if name in given else base[name] for name in _DIMENSIONS]
    length, width, height = metres
    # What is not finite or not positive has an error of its own in the recipe.
    if all(math.isfinite(size) and size > 0 for size in metres) and not length >= width >= height:
        sizes = ", ".join(f"{size * scale:g}" for size in metres)
        raise RecipeError(
            f"the target dimensions must be in the order L >= W >= H; got {sizes} {unit}: "
            "write them from the largest to the smallest."
        )


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:  # a whole number beyond the range of float64
        return float("inf")
