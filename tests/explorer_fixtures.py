"""A small design library and a small database for the tests of the explorer."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lithoform import Recipe, generate, measure
from lithoform.axes import EXTRA_AXES, TABLE_7
from lithoform.database.building import Measures, build
from lithoform.descriptors.table import FOUR
from lithoform.inverse.library import DesignLibrary
from lithoform.planning import Plan

AXES = tuple(
    axis
    for axis in (*TABLE_7, *EXTRA_AXES)
    if axis.name in ("perturbation", "chip_sharpness", "elongation", "flatness")
)
TRIANGLES = 500


def small_library(count: int = 80) -> DesignLibrary:
    """Stones of 500 triangles at random settings of four axes, really measured."""
    coordinates = np.random.default_rng(5).random((count, len(AXES)))
    plan = DesignLibrary(AXES, Recipe(triangles=TRIANGLES), coordinates, np.zeros((count, 4)))
    stones = [measure(generate(plan.recipe(i, seed=1000 + i)), FOUR) for i in range(count)]
    descriptors = np.array([[stone[name] for name in FOUR] for stone in stones])
    return DesignLibrary(AXES, plan.base, coordinates, descriptors)


def small_database(folder: Path) -> Path:
    """Two sources of generated stones, the second with its meshes."""
    for source, seed, count, keep in (("first", 1, 28, False), ("second", 2, 10, True)):
        plan = Plan(count=count, seed=seed, preset="database", shape_class="mixed", base={"triangles": TRIANGLES})
        measures = Measures((*FOUR, "length", "elongation", "flatness"), keep_meshes=keep)
        assert len([*build(folder, plan, measures, source=source, workers=0, device="cpu")]) == count
    return folder
