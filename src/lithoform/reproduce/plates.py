"""The paper's figures from their recipes, and the same pictures for the documentation.

Every stone is made anew by `lithoform.generation`; `lithoform.figures.gallery` draws it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from lithoform.atomic import make_folder
from lithoform.errors import LithoformError
from lithoform.figures.gallery import Variation
from lithoform.figures.gallery import figure_2 as draw_plate
from lithoform.lazy import cached_property
from lithoform.parameters import Recipe, find_parameter
from lithoform.rendering import VIEW, require_pictures

__all__ = ["FIGURE_2_VARIATIONS", "PARAMETER_PLATES", "SEED", "Sweep", "figure_2", "parameter_plates"]

SEED: Final = 25
"""Seed of the pictured stone: of seeds 0 to 47 one with clear faces, ledges and notches."""


@dataclass(frozen=True)
class Sweep:
    """Values of one parameter, all else at the benchmark of Table 1.

    Attributes
    ----------
    symbol : str
        Symbol of the parameter in ASCII, or "size" for L, W and H together; for a parameter without a symbol
        of its own, the name of the recipe's field.
    values : tuple
        In the order in which they are drawn; a mapping sets several fields of the recipe at once.
    base : mapping
        What differs from the benchmark throughout, where the parameter alone would show nothing.
    labels : tuple of str
        How the values are written; empty writes them as they are.
    view : (float, float, float)
        Direction from the stones to the eye.
    """

    symbol: str
    values: tuple[Any, ...]
    base: dict[str, Any] = field(default_factory=dict)
    labels: tuple[str, ...] = ()
    view: tuple[float, float, float] = VIEW

    @cached_property
    def name(self) -> str:
        """Field of `Recipe`, or "size"."""
        return self.symbol if self.symbol in ("size", "calibration") else find_parameter(self.symbol)

    def recipes(self, benchmark: Recipe) -> list[Recipe]:
        """One recipe for each value."""
        changes = (value if isinstance(value, dict) else {self.name: value} for value in self.values)
        return [benchmark.replace(**self.base, **change) for change in changes]

    def texts(self) -> list[str]:
        """How each value is written."""
        return list(self.labels) or [_text(value) for value in self.values]


FIGURE_2_VARIATIONS: Final[tuple[Sweep, ...]] = (
    Sweep("r", (0.1, 0.5, 1.0, 2.5, 5.0)),
    Sweep("k", (0.0, 0.15, 0.3, 0.6, 1.0)),
    Sweep("s", (0.0, 0.75, 1.5, 2.25, 3.0)),
    Sweep("s_w", (0.0, 0.75, 1.5, 2.25, 3.0)),
    Sweep("eta", (0.0, 0.25, 0.5, 0.75, 1.0)),
    Sweep("delta", ((-6.0,) * 3, (-3.0,) * 3, (0.0,) * 3, (3.0,) * 3, (6.0,) * 3)),
    Sweep("O", (0, 2, 5, 8, 10)),
    Sweep("lambda", (0.0, 0.75, 1.5, 2.25, 3.0)),
    Sweep("g", (0.0, 0.25, 0.5, 0.75, 1.0)),
    Sweep("alpha", (0.0, 0.4, 0.8, 1.4, 2.0)),
    Sweep("beta", (0.0, 0.15, 0.3, 0.6, 1.0)),
    Sweep("gamma", (0.0, 0.15, 0.5, 1.0, 2.0)),
    Sweep("kappa", (0.1, 0.5, 4.0, 32.0, 128.0)),
    Sweep("A_L", (0.0, 0.15, 1.0, 3.0, 8.0)),
    Sweep("f_L", (0.0, 1.0, 2.0, 3.5, 5.0)),
    Sweep("a", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0))),
    Sweep("p0", ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (4.0, 0.0, 0.0), (6.0, 0.0, 0.0))),
    Sweep("rho", (0.0, 15.0, 30.0, 45.0, 60.0), labels=("0°", "15°", "30°", "45°", "60°")),
    Sweep("size", ((1.4, 1.3, 1.2), (2.0, 1.5, 1.0), (2.0, 1.8, 0.7), (2.0, 1.0, 0.9), (2.0, 1.1, 0.6))),
)
"""The 19 parameters of Table 1, each with five values over its range in Table 7, the benchmark among them."""

_FROM_BELOW: Final = (0.75, -1.0, -0.5)

PARAMETER_PLATES: Final[tuple[Sweep, ...]] = (
    *FIGURE_2_VARIATIONS,
    Sweep(
        "n",
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0), (1.0, -1.0, 0.0)),
        base={"layer_amplitude": 3.0, "layer_frequency": 2.0},  # at the benchmark's 0.15 layers hardly show
    ),
    Sweep("seed", (1, 2, 3, 4, 5)),
    Sweep("n_s", (0, 2, 10, 50)),
    Sweep(
        "smoothing_method",
        (
            {"smoothing_iterations": 0},
            {"smoothing_iterations": 50, "smoothing_method": "laplacian"},
            {"smoothing_iterations": 50, "smoothing_method": "taubin"},
        ),
        labels=("none", "50 laplacian", "50 taubin"),
    ),
    Sweep("d_b", (0.0, 0.1, 0.2, 0.3), view=_FROM_BELOW),
    Sweep("h_b", (0.0, 0.05, 0.15, 0.3), base={"flatten_depth": 0.15}, view=_FROM_BELOW),
    Sweep(
        "calibration",
        (
            {},
            {"calibration_fit": "uniform"},
            {"calibration_align": False},
            {"calibration_frame": "aabb"},
            {"calibration_frame": "none"},
        ),
        labels=("pca, exact", "pca, uniform", "not aligned", "aabb, exact", "none"),
    ),
    Sweep(
        "N_t",
        (
            {"triangles": 200},
            {"triangles": 720},
            {"triangles": 1280},
            {"triangles": 5000},
            {"triangles": 20_000},
        ),
        labels=("200", "720 (icosa)", "1280", "5000", "20 000"),
    ),
)
"""What the recipe reference shows: Table 1 and what else shapes a stone."""


def figure_2(
    out: str | Path,
    *,
    seed: int | None = None,
    triangles: int = 20_000,
    device: str = "auto",
    threads: int | None = None,
) -> Path:
    """Make the stones of Fig. 2, one parameter varied at a time at one seed, and draw them at one view.

    Parameters
    ----------
    out : str or pathlib.Path
        PNG file, or a folder that takes ``fig2.png``.
    seed : int, optional
        Default `SEED`.
    triangles : int
        Number of triangles of each stone.
    device : {"auto", "cpu", "cuda"}
    threads : int, optional
        Number of threads (default: the processors that this process may use).

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    LithoformError
        If the stones cannot be made or drawn, or the file cannot be written.
    """
    path = Path(out)
    if path.suffix.lower() != ".png":
        if path.suffix and not os.path.isdir(path):  # noqa: PTH112 (Path.is_dir raises for a name too long)
            raise LithoformError(f"the figure is a PNG file: {path} should end in .png, or be a folder.")
        path = path / "fig2.png"
    require_pictures()
    benchmark = Recipe(seed=SEED if seed is None else seed, triangles=triangles)
    _require_possible(FIGURE_2_VARIATIONS, benchmark, device)
    make_folder(path.parent)
    rows = list(_variations(FIGURE_2_VARIATIONS, benchmark, device, threads))
    return draw_plate(rows, path)


def parameter_plates(
    folder: str | Path,
    *,
    seed: int | None = None,
    triangles: int = 20_000,
    device: str = "auto",
    threads: int | None = None,
    sweeps: Sequence[Sweep] = PARAMETER_PLATES,
) -> list[Path]:
    """Draw a strip of stones for each parameter of a recipe, one small PNG file each, named after the field.

    Parameters
    ----------
    folder : str or pathlib.Path
    seed, triangles, device, threads
        As for `figure_2`.
    sweeps : sequence of Sweep

    Returns
    -------
    list of pathlib.Path
        The files, in the order of the sweeps.

    Raises
    ------
    LithoformError
        If the stones cannot be made or drawn, or a file cannot be written.
    """
    target = Path(folder)
    require_pictures()
    benchmark = Recipe(seed=SEED if seed is None else seed, triangles=triangles)
    _require_possible(sweeps, benchmark, device)
    make_folder(target)
    return [
        draw_plate([row], target / f"{sweep.name}.png", cell=(190, 150), view=sweep.view, symbols=False)
        for sweep, row in zip(sweeps, _variations(sweeps, benchmark, device, threads), strict=True)
    ]


def _variations(sweeps: Iterable[Sweep], benchmark: Recipe, device: str, threads: int | None) -> Iterator[Variation]:
    """The stones of each sweep; a recipe that occurs in several is made once."""
    from lithoform.generation import generate_many

    plans = [(sweep, sweep.recipes(benchmark)) for sweep in sweeps]
    wanted = list(dict.fromkeys(recipe for _, recipes in plans for recipe in recipes))
    stream = generate_many(wanted, device=device, threads=threads)
    made: dict[Recipe, Any] = {}
    for sweep, recipes in plans:
        while not all(recipe in made for recipe in recipes):
            particle = next(stream)
            made[particle.recipe] = particle.mesh
        stones = [(text, made[recipe]) for text, recipe in zip(sweep.texts(), recipes, strict=True)]
        yield Variation(sweep.symbol, stones, recipes.index(benchmark) if benchmark in recipes else None)


def _require_possible(sweeps: Iterable[Sweep], benchmark: Recipe, device: str) -> None:
    """Refuse a device that is not there and stones that cannot be made, before anything is written."""
    from lithoform.feasibility import require_feasible
    from lithoform.warp_runtime import resolve_device

    resolve_device(device)
    for sweep in sweeps:
        for recipe in sweep.recipes(benchmark):
            require_feasible(recipe)


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(_text(v) for v in value)})"
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")
