"""Fig. 3 and Fig. 4: what the descriptors measure, the classes of form, the influence of the mesh's resolution."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.descriptors.measuring import measure, measure_many
from lithoform.descriptors.table import FOUR
from lithoform.figures.gallery import png_bytes
from lithoform.figures.resolution import Resolution, resolution_figure
from lithoform.figures.zingg import zingg_diagram
from lithoform.generation import generate, generate_many
from lithoform.parallel import in_order
from lithoform.portrait import portrait
from lithoform.presets import SHAPE_CLASSES, database_recipe, particle_seed
from lithoform.progress import track
from lithoform.rendering import require_pictures
from lithoform.reproduce.files import csv_bytes, made_folder, write_files
from lithoform.simplification import simplification_drift, simplify
from lithoform.warp_runtime import resolve_device

__all__ = ["figure_3", "figure_4"]

_SEED: Final = 25
_COUNTS: Final = (51_200, 20_000, 5_000)
_STONES_A_CLASS: Final = 10
"""Stones over which the drift of the table is averaged."""

_DIAGRAM_STONES: Final = 200


def figure_3(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Draw what the four descriptors measure, on one stone of the database setting (Fig. 3).

    Parameters
    ----------
    out : path-like
        Folder, which takes fig3.png.
    seed : int, optional
        Seed of the stone.
    triangles : int
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of pathlib.Path

    Raises
    ------
    LithoformError
        If the stone cannot be made or drawn, or the file cannot be written.
    """
    require_pictures()
    recipe = database_recipe("cube", seed=_SEED if seed is None else seed, triangles=triangles)
    resolve_device(device)
    folder = made_folder(out)
    pixels, _ = portrait(generate(recipe, device=device))
    return write_files(folder, {"fig3.png": png_bytes(pixels)})


def figure_4(
    out: str | Path, *, seed: int | None = None, triangles: int = _COUNTS[0], device: str = "auto"
) -> list[Path]:
    """Draw Zingg's diagram of the database setting, and the drift of the descriptors under simplification (Fig. 4).

    Parameters
    ----------
    out : path-like
        Folder, which takes fig4a.png (200 stones, 50 a class, by their measured dimensions), fig4b.png (a stone a
        class) and fig4b.csv (mean and largest relative drift of ten stones a class).
    seed : int, optional
        Seed from which those of the stones are derived.
    triangles : int
        Of the finest meshes, which are simplified to 20,000 and 5,000.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of pathlib.Path

    Raises
    ------
    LithoformError
        If a stone cannot be made, simplified or drawn, or a file cannot be written.
    """
    require_pictures()
    # The seed itself is one of a stone too, so that it is refused where a stone's would be.
    first = database_recipe("cube", seed=_SEED if seed is None else seed, triangles=triangles).seed
    resolve_device(device)
    folder = made_folder(out)
    recipes = [database_recipe(SHAPE_CLASSES[i % 4], seed=particle_seed(first, i)) for i in range(_DIAGRAM_STONES)]
    dimensions = track(
        measure_many(generate_many(recipes, device=device), ("elongation", "flatness")),
        total=len(recipes), what="stones of the diagram",
    )  # fmt: skip
    indices = np.array([[row["elongation"], row["flatness"]] for row in dimensions])
    # By the class in which each was drawn: what the calibration makes of it is what the diagram shows.
    populations = {name: (indices[i::4, 0], indices[i::4, 1]) for i, name in enumerate(SHAPE_CLASSES)}
    files = write_files(folder, {"fig4a.png": png_bytes(zingg_diagram(populations))})

    counts = [count for count in _COUNTS[1:] if count < triangles]
    fine = [
        database_recipe(SHAPE_CLASSES[i % 4], seed=particle_seed(first, i), triangles=triangles)
        for i in range(4 * _STONES_A_CLASS)
    ]
    meshes = (particle.mesh for particle in generate_many(fine, device=device))
    drifts = list(
        track(
            in_order(lambda mesh: simplification_drift(mesh, counts, lambda m: measure(m, FOUR)), meshes),
            total=len(fine), what="stones simplified",
        )
    )  # fmt: skip
    head = ("class", "triangles", *(f"{n}_{what}" for n in FOUR for what in ("mean", "drift", "worst_drift")))
    lines: list[list[Any]] = []
    for i, name in enumerate(SHAPE_CLASSES):
        for level in range(len(counts) + 1):
            rows = [stone[level] for stone in drifts[i::4]]
            cells: list[float] = []
            for descriptor in FOUR:
                relative = np.array([row.relative[descriptor] for row in rows])
                mean = float(np.mean([row.values[descriptor] for row in rows]))
                cells += [mean, float(relative.mean()), float(relative[np.argmax(np.abs(relative))])]
            lines.append([name, rows[0].triangles, *cells])
    files += write_files(folder, {"fig4b.csv": csv_bytes(head, lines)})

    pictured = []
    for i, name in enumerate(SHAPE_CLASSES):
        mesh = generate(fine[i], device=device).mesh
        bodies = [mesh, *(simplify(mesh, count) for count in counts)]
        pictured += [
            Resolution(name, asked, row.values, body)
            for asked, row, body in zip((triangles, *counts), drifts[i], bodies, strict=True)
        ]
    files += write_files(folder, {"fig4b.png": png_bytes(resolution_figure(pictured))})
    return files
