"""Fig. 5 and Fig. 6: calibration and twist in the four classes, and the 15 parameters one at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from lithoform.database.building import Measures, build
from lithoform.figures.gallery import png_bytes
from lithoform.figures.populations import require_figures
from lithoform.figures.sensitivity import CurvePanel, curves_figure
from lithoform.figures.twist import TwistRow, twist_figure
from lithoform.generation import generate
from lithoform.presets import SHAPE_CLASSES, benchmark_recipe
from lithoform.progress import track
from lithoform.rendering import require_pictures
from lithoform.reproduce.files import made_folder, write_files
from lithoform.sensitivity.designs import Design, OneAtATime
from lithoform.sensitivity.oat import Curves, mean_with_band, sweep_of
from lithoform.sensitivity.responses import Responses, read_responses
from lithoform.sensitivity.trends import trends, trends_to_csv
from lithoform.sensitivity.twist import FRAMES, TwistDesign, findings, findings_to_csv, twist_to_csv
from lithoform.warp_runtime import resolve_device

__all__ = ["curves_picture", "figure_5", "figure_6"]

_SEED: Final = 0
_TWIST_SEEDS: Final = 10
_SWEEP_SEEDS: Final = 30
_PICTURED: Final = (0.0, 20.0, 40.0, 60.0)
"""Rates of the stones that are drawn [deg per model unit]."""


def figure_5(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Calibration by PCA and by the axis-aligned box, and the twist from 0 to 60 degrees, in the four classes (Fig. 5).

    Parameters
    ----------
    out : path-like
        Folder, which takes fig5.png; fig5.csv, the means; fig5_claims.csv, what section 4 says of them, held or not;
        and the folder fig5, a database with the stones, from which a run that was stopped goes on.
    seed : int, optional
        From which those of the stones are derived.
    triangles : int
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of pathlib.Path
        The files.

    Raises
    ------
    LithoformError
        If a stone cannot be made or drawn, or a file cannot be written.
    """
    require_pictures()
    require_figures()
    resolve_device(device)
    folder = made_folder(out)
    base = benchmark_recipe(triangles=triangles)
    design = TwistDesign(base=base, seeds=_TWIST_SEEDS, seed=_SEED if seed is None else seed)
    values = _made(folder / "fig5", "twist", design, device).values
    values = values.reshape(*design.shape, design.seeds, -1)
    moments = [[mean_with_band(values[i, j])[:2] for j in range(len(FRAMES))] for i in range(len(SHAPE_CLASSES))]
    rows = []
    for i, name in enumerate(SHAPE_CLASSES):
        stones = []
        for j in range(len(FRAMES)):
            points = [
                (rate, np.ravel_multi_index((i, j, design.rates.index(rate)), design.shape)) for rate in _PICTURED
            ]
            recipes = [(f"{rate:g}°", design.recipe(int(point) * design.seeds + 1)) for rate, point in points]
            stones.append([(text, generate(recipe, device=device).mesh) for text, recipe in recipes])
        mean, deviation = (np.stack([pair[part] for pair in moments[i]]) for part in (0, 1))
        rows.append(TwistRow(name, np.array(design.rates), mean, deviation, stones))
    note = f"{design.seeds} stones at each point, {triangles:,} triangles; band: standard deviation under PCA"
    picture = twist_figure(rows, ("PCA", "box"), title="Calibration and twist", note=note)
    return write_files(folder, {
        "fig5.png": png_bytes(picture),
        "fig5.csv": twist_to_csv(design.rates, values),
        "fig5_claims.csv": findings_to_csv(findings(design.rates, values)),
    })  # fmt: skip


def figure_6(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """The four descriptors over the 15 parameters of Table 7, one at a time (Fig. 6).

    Parameters
    ----------
    out : path-like
        Folder, which takes fig6.png; fig6.csv, the curves; fig6_trends.csv, what section 4 says of them, held or not;
        and the folder fig6, a database with the 4,980 stones, from which a run that was stopped goes on.
    seed, triangles, device
        As `figure_5`.

    Returns
    -------
    list of pathlib.Path
        The files.

    Raises
    ------
    LithoformError
        If no stone can be made, or a file cannot be written.
    """
    require_figures()
    resolve_device(device)
    folder = made_folder(out)
    base = benchmark_recipe(triangles=triangles)
    design = OneAtATime(base=base, seeds=_SWEEP_SEEDS, seed=_SEED if seed is None else seed)
    sweep = sweep_of(design, _made(folder / "fig6", "oat", design, device))
    return write_files(folder, {
        "fig6.png": curves_picture(sweep.curves, design.seeds, triangles),
        "fig6.csv": sweep.curves.to_csv(),
        "fig6_trends.csv": trends_to_csv(trends(sweep)),
    })  # fmt: skip


def curves_picture(curves: Curves, seeds: int, triangles: int) -> bytes:
    """PNG file of the curves of a sweep."""
    panels = [
        CurvePanel(axis.name, curves.values[i], curves.mean[i], curves.deviation[i], curves.low[i], curves.high[i],
                   curves.base[i], axis.scale == "log")
        for i, axis in enumerate(curves.axes)
    ]  # fmt: skip
    note = (f"{seeds} stones at each point, {triangles:,} triangles; pale band: standard deviation from stone to "
            "stone, dark band: 95 % interval of the mean")  # fmt: skip
    return png_bytes(curves_figure(panels, title="Descriptors over each parameter, the others at the benchmark",
                                   note=note))  # fmt: skip


def _made(folder: Path, source: str, design: Design, device: str) -> Responses:
    numbers = build(folder, design, Measures(("four",)), source=source, device=device, is_named=False)
    for _ in track(numbers, total=design.count, what="stones"):
        pass
    return read_responses(folder, source, design)
