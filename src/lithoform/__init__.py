"""Simulation-ready virtual rock particles: generate them, check them, save them.

The public door: every name is loaded from its module when it is first used, so that importing lithoform
is light.  Lengths are metres unless a docstring says otherwise.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lithoform.conditioning import fit_to_box, principal_frame, smooth, twist
    from lithoform.database.population import Population, read_population
    from lithoform.database.queries import query
    from lithoform.database.store import Store
    from lithoform.descriptors.measuring import Measurement, measure, measure_many
    from lithoform.descriptors.table import DESCRIPTORS
    from lithoform.errors import (
        DeviceError,
        FileFormatError,
        LithoformError,
        MeshError,
        OutputError,
        RecipeError,
        SampleError,
        UnsoundMeshError,
    )
    from lithoform.flattening import flatten
    from lithoform.generation import generate, generate_many
    from lithoform.mesh import MassProperties, Mesh
    from lithoform.mesh_io import read_mesh, write_mesh
    from lithoform.parameters import PARAMETERS, Recipe
    from lithoform.particle import Particle
    from lithoform.population_recipe import PopulationRecipe, read_population_recipe
    from lithoform.presets import benchmark_recipe, database_recipe, particle_seed
    from lithoform.radius import radii
    from lithoform.recipe_io import read_recipe, to_toml
    from lithoform.scans.reading import Scan, read_scan, read_scans
    from lithoform.simplification import simplify
    from lithoform.soundness import SoundnessReport, check
    from lithoform.topology import sphere

__version__ = "0.1.0"

_HOME = {
    "conditioning": ("fit_to_box", "principal_frame", "smooth", "twist"),
    "database.population": ("Population", "read_population"),
    "database.queries": ("query",),
    "database.store": ("Store",),
    "descriptors.measuring": ("Measurement", "measure", "measure_many"),
    "descriptors.table": ("DESCRIPTORS",),
    "errors": (
        "DeviceError",
        "FileFormatError",
        "LithoformError",
        "MeshError",
        "OutputError",
        "RecipeError",
        "SampleError",
        "UnsoundMeshError",
    ),
    "flattening": ("flatten",),
    "generation": ("generate", "generate_many"),
    "mesh": ("MassProperties", "Mesh"),
    "mesh_io": ("read_mesh", "write_mesh"),
    "parameters": ("PARAMETERS", "Recipe"),
    "particle": ("Particle",),
    "population_recipe": ("PopulationRecipe", "read_population_recipe"),
    "presets": ("benchmark_recipe", "database_recipe", "particle_seed"),
    "radius": ("radii",),
    "recipe_io": ("read_recipe", "to_toml"),
    "scans.reading": ("Scan", "read_scan", "read_scans"),
    "simplification": ("simplify",),
    "soundness": ("SoundnessReport", "check"),
    "topology": ("sphere",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "DESCRIPTORS",
    "PARAMETERS",
    "DeviceError",
    "FileFormatError",
    "LithoformError",
    "MassProperties",
    "Measurement",
    "Mesh",
    "MeshError",
    "OutputError",
    "Particle",
    "Population",
    "PopulationRecipe",
    "Recipe",
    "RecipeError",
    "SampleError",
    "Scan",
    "SoundnessReport",
    "Store",
    "UnsoundMeshError",
    "benchmark_recipe",
    "check",
    "database_recipe",
    "fit_to_box",
    "flatten",
    "generate",
    "generate_many",
    "measure",
    "measure_many",
    "particle_seed",
    "principal_frame",
    "query",
    "radii",
    "read_mesh",
    "read_population",
    "read_population_recipe",
    "read_recipe",
    "read_scan",
    "read_scans",
    "simplify",
    "smooth",
    "sphere",
    "to_toml",
    "twist",
    "write_mesh",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'lithoform' has no attribute {name!r}")
    value = getattr(import_module(f"lithoform.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
