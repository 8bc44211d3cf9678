"""Fig. 7: the closed loop of inverse design, for the paper's targets and for twelve of our own.

The paper's targets are in the roundness of its released program, which measures the mesh.  They are tried in that
measure, on the open mesh of the program, and in ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import atomic_write
from lithoform.descriptors.table import FOUR
from lithoform.figures.design import ClosedLoop, closed_loop_figure, loop_errors_figure
from lithoform.figures.gallery import png_bytes
from lithoform.generation import generate
from lithoform.inverse.design import Design, by_search, by_the_papers_route, evaluator
from lithoform.inverse.library import DesignLibrary, shipped_library
from lithoform.inverse.search import Evaluate
from lithoform.inverse.surrogate import Surrogate
from lithoform.inverse.targets import Target
from lithoform.parameters import Recipe
from lithoform.progress import track
from lithoform.rendering import require_pictures
from lithoform.reproduce.files import csv_bytes, made_folder
from lithoform.reproduce.published_stones import published_evaluator, published_library

__all__ = ["PAPER_ERRORS", "PAPER_TARGETS", "figure_7", "mean_errors", "spread_targets"]

PAPER_TARGETS: Final = ((0.60, 0.45, 0.85, 0.75), (0.70, 0.47, 0.90, 0.80), (0.75, 0.50, 0.90, 0.85))
PAPER_ERRORS: Final = (0.020, 0.029, 0.018, 0.027)
"""Mean absolute errors of the paper's closed loop, over three targets and three seeds."""

GOAL: Final = 0.008
_SEED: Final = 7
_FRESH: Final = 10
_TARGETS: Final = 12
_POINTS: Final = 2048
_PERCENTILES: Final = (10.0, 90.0)
_SOLIDITY: Final = (0.80, 0.99)


def spread_targets(library: DesignLibrary, surrogate: Surrogate, *, count: int = _TARGETS, seed: int = 0) -> np.ndarray:
    """Targets spread over the part of the descriptor space that rock has, shape (count, 4), of three digits.

    The rule: means that the surrogate expects at 2,048 Sobol points that are not in the library; those whose
    descriptors lie between the 10th and the 90th percentile of the library, the solidity between 0.80 and 0.99; of
    them first the one nearest to the middle, then again and again the one farthest from all before it, in units of the
    standard deviations.
    """
    from scipy.stats import qmc

    points = qmc.Sobol(len(library.axes), rng=np.random.default_rng([seed, 1])).random(_POINTS)
    means = surrogate.mean(points)
    low, high = np.percentile(library.descriptors, _PERCENTILES, axis=0)
    low[2], high[2] = _SOLIDITY
    means = means[((means >= low) & (means <= high)).all(axis=1)]
    scaled = means / means.std(axis=0)
    chosen = [int(((scaled - np.median(scaled, axis=0)) ** 2).sum(axis=1).argmin())]
    nearest = ((scaled - scaled[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < count:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, ((scaled - scaled[chosen[-1]]) ** 2).sum(axis=1))
    return np.round(means[chosen], 3)


def mean_errors(designs: list[Design]) -> np.ndarray:
    """Absolute errors of the means of the fresh stones, shape (targets, 4)."""
    return np.array([np.abs(one.mean - one.target.values) for one in designs])


def figure_7(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Closed loop of the paper's three targets, in both measures of roundness, and of twelve targets by both routes.

    Parameters
    ----------
    out : path-like
        Folder, which takes fig7_published.png, fig7_ours.png, fig7_errors.png and fig7.csv.
    seed : int, optional
        Of the searches and of the fresh stones.
    triangles : int
        Of every stone.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of pathlib.Path

    Raises
    ------
    LithoformError
        If a stone cannot be made, or a file cannot be written.
    """
    require_pictures()
    folder = made_folder(out)
    seed = _SEED if seed is None else seed
    library = shipped_library().at_triangles(triangles)
    surrogate = Surrogate.fit(library)
    evaluate = evaluator(device=device)
    rows: list[list[Any]] = []
    files = []

    published = published_library(library, device=device)
    own = published_evaluator(device=device)
    told = "Fig. 7: the paper's targets, roundness as its released program measures it"
    designs = _searched(PAPER_TARGETS, published, Surrogate.fit(published), own, seed)
    files.append(_drawn(designs, folder / "fig7_published.png", told, device))
    rows += _rows("paper's targets, published roundness", designs)

    told = "Fig. 7: the paper's targets, our roundness; see what stops each"
    designs = _searched(PAPER_TARGETS, library, surrogate, evaluate, seed)
    files.append(_drawn(designs, folder / "fig7_ours.png", told, device))
    rows += _rows("paper's targets, our roundness", designs)

    targets = spread_targets(library, surrogate)
    searched = _searched(targets, library, surrogate, evaluate, seed)
    base = Recipe(length=0.020, width=0.015, height=0.010, triangles=triangles)
    by_paper = [
        by_the_papers_route(Target(tuple(row)), base=base, seed=seed, fresh=_FRESH, evaluate=evaluate)
        for row in track(targets.tolist(), total=len(targets), what="targets by the paper's route")
    ]
    rows += _rows("twelve targets, search", searched) + _rows("twelve targets, paper's route", by_paper)
    errors = {"search": mean_errors(searched), "paper's route": mean_errors(by_paper)}
    told = "Closed loop over twelve targets: errors of the means of ten fresh seeds"
    files.append(folder / "fig7_errors.png")
    atomic_write(files[-1], png_bytes(loop_errors_figure(errors, GOAL, title=told), colours=256))
    files.append(folder / "fig7.csv")
    atomic_write(files[-1], _table(rows))
    return files


def _searched(
    targets: Any, library: DesignLibrary, surrogate: Surrogate, evaluate: Evaluate, seed: int
) -> list[Design]:
    asked = [Target(tuple(float(v) for v in row)) for row in targets]  # type: ignore[arg-type]
    return [
        by_search(target, library, surrogate=surrogate, seed=seed, fresh=_FRESH, evaluate=evaluate)
        for target in track(asked, total=len(asked), what="targets")
    ]


def _drawn(designs: list[Design], path: Path, title: str, device: str) -> Path:
    loops = []
    for one in designs:
        stones = [generate(one.recipe.replace(seed=own), device=device).mesh for own in one.seeds[:3]]
        values = ", ".join(f"{value:.2f}" for value in one.target.values)
        told = "reached" if one.reached else "not reached"
        loops.append(ClosedLoop(f"{{{values}}}: {told}", np.array(one.target.values), np.array(one.target.tolerance),
                                one.predicted.mean, one.achieved, stones))  # fmt: skip
    atomic_write(path, png_bytes(closed_loop_figure(loops, title=title), colours=256))
    return path


def _rows(what: str, designs: list[Design]) -> list[list[Any]]:
    rows = []
    for number, one in enumerate(designs, start=1):
        for d, name in enumerate(FOUR):
            mean, scatter = float(one.mean[d]), float(one.scatter[d])
            rows.append([what, number, name, one.target.values[d], float(one.predicted.mean[d]), mean, scatter,
                         abs(mean - one.target.values[d]), PAPER_ERRORS[d], one.reached, one.stones])  # fmt: skip
    return rows


def _table(rows: list[list[Any]]) -> bytes:
    head = ("case", "number", "descriptor", "target", "predicted", "achieved", "scatter", "error", "error_of_the_paper",
            "reached", "stones")  # fmt: skip
    return csv_bytes(head, rows)
