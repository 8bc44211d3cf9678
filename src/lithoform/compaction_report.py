"""Pictures and the page of a compaction."""

from __future__ import annotations

from typing import Any

import numpy as np

from lithoform.compaction.run import Drawing
from lithoform.dem import Model, State
from lithoform.figures.compaction import Curve, curve_figure, film_strip, specimen_figure
from lithoform.figures.gallery import png_bytes
from lithoform.figures.packing import Heap
from lithoform.report.page import Page, Paragraph, Picture, Table

__all__ = ["compaction_files"]

_STAGES = {"deposition": "deposited", "pressing": "pressed", "gyration": "compacted"}


def compaction_files(drawing: Drawing) -> dict[str, bytes]:
    """PNG files and the page of a compaction, by name.

    Parameters
    ----------
    drawing : Drawing
    """
    done, results = drawing.compaction, drawing.results
    diameter, loose, end = results["mould_diameter"], results["loose"], results["compacted"]
    heaps = {name: _heap(*drawing.states[name], diameter) for name in _STAGES}
    captions = []
    for stage, name in _STAGES.items():
        row = done.looks[stage][-1]
        turns = f", {row['gyration']:g} gyrations" if stage == "gyration" else ""
        what = f"{1e3 * row['height']:.1f} mm, packing density {row['packing_density']:.3f}"
        if stage == "deposition":
            what = f"centre of mass at {500.0 * row['height']:.1f} mm"
        captions.append(f"{name}{turns}\n{what}")
    lines = [
        f"in a mould {1e3 * diameter:.1f} mm wide",
        f"after {end['gyration']:g} gyrations at {drawing.settings['rate_factor']:g} times the rate",
        f"height {1e3 * end['height']:.2f} mm, from {1e3 * loose['height']:.2f} mm",
        f"packing density {end['packing_density']:.4f}, from {loose['packing_density']:.4f}",
        f"coordination number {end['coordination']:.2f}",
        *(
            [rf"$H = {1e3 * done.fit.a:.2f}\,G^{{{done.fit.b:.4f}}}$ mm, $R^2 = {done.fit.r_squared:.4f}$"]
            if done.fit
            else []
        ),
    ]
    specimen = specimen_figure(heaps["gyration"], f"{results['stones']} stones, {drawing.settings['gradation']}", lines)
    series = done.series
    curve = curve_figure([
        Curve(label="specimen", gyrations=series["gyration"], heights=series["height"],
              densities=series["packing_density"], fitted=(done.fit.a, done.fit.b) if done.fit else None)
    ])  # fmt: skip
    files = {
        "specimen.png": png_bytes(specimen, colours=256),
        "film.png": png_bytes(film_strip([*heaps.values()], captions), colours=256),
        "curve.png": png_bytes(curve),
    }
    return {**files, "report.html": _page(drawing, files)}


def _heap(model: Model, state: State, diameter: float) -> Heap:
    from scipy.spatial.transform import Rotation

    return Heap(
        meshes=[shape.mesh for shape in model.shapes if shape.mesh is not None],
        which=model.shape,
        turns=Rotation.from_quat(state.orientation).as_matrix() * model.scale[:, None, None],
        places=state.position,
        sides=(diameter,),
        height=1e3,
    )


def _page(drawing: Drawing, files: dict[str, bytes]) -> bytes:
    results, settings, done = drawing.results, drawing.settings, drawing.compaction
    page = Page(f"Gyratory compaction of {results['stones']} stones")
    fit = results["fit"]
    if fit is not None:
        low, high = fit["B_interval"]
        first, last = (1e3 * x for x in fit["A_interval"])
        page.add(Paragraph(
            f"H = {fit['A_mm']:.3f} mm G^{fit['B']:.5f}, R2 = {fit['R2']:.4f}, over {fit['points']} gyrations. "
            f"Intervals of 95 %: A {first:.3f} to {last:.3f} mm, B {low:.5f} to {high:.5f}, as if the heights "
            "of gyrations that follow each other were independent; the spread over seeds is the better measure."
        ))  # fmt: skip
    page.add(*(Paragraph(note) for note in results["notes"]))
    page.add(Picture(files["specimen.png"], "The specimen in its mould, cut away.", width=170.0),
             Picture(files["film.png"], "The specimen deposited, pressed and compacted.", width=180.0),
             Picture(files["curve.png"], "Height and packing density over the gyrations.", width=170.0))  # fmt: skip
    page.section("Numbers", Table(("", "value"), tuple(_numbers(results))))
    series = done.series
    names = ("gyration", "height", "packing_density", "pressure", "lateral_pressure", "coordination", "work_of_mould")
    formats = ("{:g}", "{:.3f}", "{:.4f}", "{:.1f}", "{:.1f}", "{:.3f}", "{:.4f}")
    factors = (1.0, 1e3, 1.0, 1e-3, 1e-3, 1.0, 1.0)
    columns = [np.asarray(series[name]) * factor for name, factor in zip(names, factors, strict=True)]
    rows = tuple(
        tuple(form.format(x) for form, x in zip(formats, row, strict=True)) for row in zip(*columns, strict=True)
    )
    head = ("gyration", "height (mm)", "packing density", "pressure (kPa)", "lateral pressure (kPa)",
            "coordination number", "work of the mould (J)")  # fmt: skip
    page.section("Gyration by gyration", Table(head, rows, texts=()))
    page.section("Settings", Table(("", "value"), tuple((key, str(value)) for key, value in settings.items())))
    return page.to_bytes()


def _numbers(results: dict[str, Any]) -> list[tuple[str, str]]:
    loose, end, pressure, scales = results["loose"], results["compacted"], results["pressure"], results["scales"]
    return [
        ("height pressed, compacted (mm)", f"{1e3 * loose['height']:.3f}, {1e3 * end['height']:.3f}"),
        ("packing density pressed, compacted", f"{loose['packing_density']:.4f}, {end['packing_density']:.4f}"),
        ("mould (mm)", f"{1e3 * results['mould_diameter']:.2f}"),
        ("mould over the largest stone", f"{results['mould_over_largest_stone']:.2f}"),
        ("angle external, internal (deg)", f"{results['angle_external']:g}, {results['angle_internal']:g}"),
        ("pressure asked for, mean, standard deviation (kPa)",
         ", ".join(f"{1e-3 * pressure[key]:.2f}" for key in ("asked", "mean", "standard_deviation"))),
        ("deepest overlap over radius", f"{results['deepest_overlap_over_radius']:.2e}"),
        ("kappa, inertial number (median, largest)",
         f"{scales['kappa']:.0f}, {scales['inertial_number_median']:.1e}, {scales['inertial_number']:.1e}"),
        ("time step (s), steps, simulated time (s)",
         f"{results['time_step']:.2e}, {results['steps']:,}, {results['time']:.3f}"),
        ("wall-clock time (s)", f"{results['seconds']:.0f}"),
    ]  # fmt: skip
