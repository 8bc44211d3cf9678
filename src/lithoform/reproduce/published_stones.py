"""Stones as the paper's released program measures them: roundness on its open mesh, the rest on a closed one.

The reading of the roundness is that which meets the paper's database (strong regularisation, fitted radius: see
`lithoform.descriptors.published`).  The program has no smoothing, which would open the seam, so there is none here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from lithoform.axes import Axis
from lithoform.conditioning import fit_to_box, twist
from lithoform.descriptors.measuring import measure
from lithoform.descriptors.published import latitude_longitude_mesh, roundness_published
from lithoform.descriptors.table import FOUR
from lithoform.errors import MeshError
from lithoform.flattening import flatten
from lithoform.generation import generate
from lithoform.inverse.library import DesignLibrary
from lithoform.inverse.search import Evaluate
from lithoform.mesh import Mesh
from lithoform.parallel import in_order
from lithoform.parameters import Recipe
from lithoform.radius import radii
from lithoform.seeds import Role, derive

__all__ = ["published_evaluator", "published_library"]

_REGULARISATION: Final = 1e-3
_STONES: Final = 900


def published_evaluator(*, device: str = "cpu", threads: int | None = None) -> Evaluate:
    """The four descriptors, the roundness as the released program has it."""

    def work(recipe: Recipe) -> list[float]:
        try:
            found = measure(generate(recipe, device=device), FOUR[1:])
            rounded = roundness_published(_open_stone(recipe), regularisation=_REGULARISATION, inscribed="fitted")
        except MeshError:
            return [np.nan] * len(FOUR)
        return [rounded, *(float(found[name]) for name in FOUR[1:])]

    def evaluate(recipes: list[Recipe]) -> np.ndarray:
        return np.array(list(in_order(work, recipes, threads=threads)), dtype=np.float64).reshape(-1, len(FOUR))

    return evaluate


def published_library(library: DesignLibrary, *, device: str = "cpu", threads: int | None = None) -> DesignLibrary:
    """The first stones of a library without their smoothing, made and measured by `published_evaluator`."""
    kept = [i for i, axis in enumerate(library.axes) if axis.name != "smoothing_iterations"]
    axes: tuple[Axis, ...] = tuple(library.axes[i] for i in kept)
    bare = replace(library, axes=axes, base=library.base.replace(smoothing_iterations=0),
                   coordinates=library.coordinates[:_STONES, kept], numbers=None, about={})  # fmt: skip
    recipes = [bare.recipe(i, derive(0, Role.POPULATION, 1 << 35, i)) for i in range(len(bare))]
    values = published_evaluator(device=device, threads=threads)(recipes)
    sound = np.isfinite(values).all(axis=1)
    return replace(bare, coordinates=bare.coordinates[sound], descriptors=values[sound])


def _open_stone(recipe: Recipe) -> Mesh:
    directions, faces = latitude_longitude_mesh(max(3, round((recipe.triangles / 2) ** 0.5)))
    mesh = Mesh(directions * radii([recipe], directions, device="cpu")[0][:, None], faces)
    mesh = twist(mesh, axis=recipe.twist_axis, point=recipe.twist_point, rate=float(np.radians(recipe.twist_rate)))
    mesh = fit_to_box(mesh, recipe.size)
    return flatten(mesh, depth=0.0, band=recipe.flatten_band * float(np.ptp(mesh.vertices[:, 2])))
