"""Fig. 11 to 13 and Table 6: the gyratory compactor with scanned and with generated stones, beside the paper's numbers.

The paper's specimens have 9,000 stones in a mould of 150 mm.  Ours have some hundred in narrower moulds, the same
for both sources, softer stones and a faster mould, and fewer cases: what differs between the sources is to be compared,
the level of packing density is not.  NIST's particles of FDOT-57 take the place of the paper's scans.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import make_folder
from lithoform.compaction.campaign import PLAN_FILE
from lithoform.compaction.experiment import (
    MEASURES,
    Experiment,
    compare_sources,
    measures_of,
    run_experiment,
)
from lithoform.compaction.published import COMPACTED_DENSITY, FITS, LOOSE_DENSITY
from lithoform.compaction.request import Request
from lithoform.compaction.run import FOLDER, run_compaction
from lithoform.compaction_report import compaction_files
from lithoform.database.building import Measures, build
from lithoform.database.importing import import_scans
from lithoform.errors import OutputError
from lithoform.experiment_report import experiment_files, fits_table
from lithoform.figures.gallery import png_bytes
from lithoform.figures.grading import grading_curve
from lithoform.figures.populations import require_figures
from lithoform.gradation.curves import find_gradation
from lithoform.planning import plan_run
from lithoform.presets import SHAPE_CLASSES, database_recipe
from lithoform.progress import track
from lithoform.rendering import require_pictures
from lithoform.report.page import Bullets, Page, Paragraph
from lithoform.reproduce.files import csv_bytes, named_folder, write_files
from lithoform.reproduce.populations import find_reference
from lithoform.scans.reading import find_scans
from lithoform.warp_runtime import resolve_device

__all__ = ["FOLDER_NAME", "figure_11", "figure_12", "figure_13", "table_6"]

FOLDER_NAME: Final = "sgc"
"""Folder of the databases, the specimen and the runs."""

_SEED: Final = 25
_STONES_A_CLASS: Final = 75
_MEASURES: Final = ("standard", "sieve_size")
_GRADATION: Final = "AC-13"
_CASES: Final = 3
_GENERATED_RUNS: Final = 2
_SCALE: Final = "medium"
_CHANGES: Final[dict[str, Any]] = {"gyrations": 10}
_SPECIMEN: Final[dict[str, Any]] = {"count": 60, "min_size": 9.5e-3, "gyrations": 5, "rate_factor": 40.0, "vtk": False}
"""The specimen of Fig. 11: the least that shows the three stages."""

_ABOUT: Final = (
    "Scanned stones: NIST's particles of Florida's #57 stone, since the paper's scans are not public.",
    "A depends on the mass of the specimen, and ours are smaller; A over the height of the solids does not.",
)


def figure_11(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Gradation of AC-13, and a small specimen of generated stones deposited, pressed and compacted (Fig. 11).

    Parameters
    ----------
    out : path-like
        Folder, which takes fig11_gradation.png, fig11_film.png (the three stages), fig11_specimen.png, fig11_curve.png
        and fig11.csv, the heights over the gyrations; and the folder sgc with the stones and the compaction, from which
        a run that was stopped goes on.
    seed : int, optional
        Of the stones and of the specimen.
    triangles : int
        Of every stone.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of pathlib.Path

    Raises
    ------
    LithoformError
        If a stone cannot be made, the simulation fails, or a file cannot be written.
    """
    require_pictures()
    require_figures()
    folder, first = _begun(out, seed, triangles, device)
    generated = _generated(folder, first, triangles, device)
    request = Request(population=generated, gradation=_GRADATION, seed=first, **_SPECIMEN)
    place = folder / FOLDER_NAME / "specimen"
    # One of other options is replaced: it costs little. The same that was stopped goes on.
    former = FOLDER.read(place)
    resume = former is not None and former["settings"] == request.settings()
    results = run_compaction(request, place, device=device, overwrite=former is not None and not resume, resume=resume,
                             progress=True, draw=compaction_files)  # fmt: skip
    asked = find_gradation(_GRADATION)
    openings, passing = np.array(asked.openings), (np.array(asked.passing_low) + np.array(asked.passing_high)) / 2.0
    gradation = grading_curve(openings, passing, limits=(asked.passing_low, asked.passing_high),
                              least=_SPECIMEN["min_size"], title=f"{_GRADATION}: limits and mean")  # fmt: skip
    series = results["series"]
    heights = zip(series["gyration"], series["height"], series["packing_density"], strict=True)
    pictures = {f"fig11_{name}.png": _content(place / f"{name}.png") for name in ("film", "specimen", "curve")}
    return write_files(folder, {
        "fig11_gradation.png": png_bytes(gradation),
        **pictures,
        "fig11.csv": csv_bytes(("gyration", "height_m", "packing_density"), heights),
    })  # fmt: skip


def figure_12(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Packing densities of specimens of both sources, loose and compacted (Fig. 12).

    It makes fig12.png; fig12.csv, a row a specimen with the paper's range; fig12_sources.csv, the sources compared
    measure by measure; and the folder sgc with the experiment, which Fig. 13 and Table 6 share, and from which one that
    was stopped goes on.  Parameters and result are those of `figure_11`.

    Raises
    ------
    FileFormatError
        If the folder of the scans is not found.
    OutputError
        If the folder holds an experiment with other options.
    LithoformError
        As `figure_11`.
    """
    require_figures()
    folder, plan, rows = _experiment(out, seed, triangles, device)
    lines = [
        (row["case"], row["sample"], _source(row), row["stones"], row["mould_diameter"],
         row["loose"]["packing_density"], *LOOSE_DENSITY, row["compacted"]["packing_density"], *COMPACTED_DENSITY)
        for row in rows
    ]  # fmt: skip
    head = ("case", "sample", "source", "stones", "mould_diameter_m", "loose_density", "paper_loose_low",
            "paper_loose_high", "compacted_density", "paper_compacted_low", "paper_compacted_high")  # fmt: skip
    found = compare_sources(rows)
    sources = [
        (row.name, MEASURES[row.name], np.mean(row.scanned), np.mean(row.generated), row.difference, *row.interval,
         row.margin, row.spread, row.verdict)
        for row in found
    ]  # fmt: skip
    source_head = ("measure", "meaning", "scanned", "generated", "difference", "low", "high", "margin", "seed_to_seed",
                   "verdict")  # fmt: skip
    return write_files(folder, {
        "fig12.png": experiment_files(plan, rows)["fig12.png"],
        "fig12.csv": csv_bytes(head, lines),
        "fig12_sources.csv": csv_bytes(source_head, sources),
    })  # fmt: skip


def figure_13(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Heights over the gyrations, case by case (Fig. 13), in fig13.png and fig13.csv; as `figure_12`."""
    require_figures()
    folder, plan, rows = _experiment(out, seed, triangles, device)
    lines = [
        (row["case"], row["sample"], _source(row), gyration, height, density)
        for row in rows
        for gyration, height, density in zip(
            *(row["series"][name] for name in ("gyration", "height", "packing_density")), strict=True
        )
    ]
    return write_files(folder, {
        "fig13.png": experiment_files(plan, rows)["fig13.png"],
        "fig13.csv": csv_bytes(("case", "sample", "source", "gyration", "height_m", "packing_density"), lines),
    })  # fmt: skip


def table_6(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Fits H = A G^B beside the paper's (Table 6), in table6.csv and table6.html; as `figure_12`."""
    require_figures()
    folder, _, rows = _experiment(out, seed, triangles, device)
    lines = []
    for row in rows:
        fit, case, sample = row["fit"], row["case"], row["sample"]
        ours = ("", "", "", "") if fit is None else (fit["A_mm"], measures_of(row)["A"], fit["B"], fit["R2"])
        known = case <= len(FITS) and sample < len(FITS[0])
        lines.append((case, sample, _source(row), row["stones"], row["mould_diameter"], *ours,
                      *(FITS[case - 1][sample] if known else ("", "", ""))))  # fmt: skip
    head = ("case", "sample", "source", "stones", "mould_diameter_m", "A_mm", "A_over_solids", "B", "R2", "paper_A_mm",
            "paper_B", "paper_R2")  # fmt: skip
    page = Page("Table 6: fits of the height over the gyrations")
    first = rows[0]
    page.add(
        Bullets(_ABOUT),
        Paragraph(f"Ours: {first['stones']} stones in a mould of {1e3 * first['mould_diameter']:.1f} mm; the paper's: "
                  "9,000 in 150 mm."),
        fits_table(rows),
    )  # fmt: skip
    return write_files(folder, {"table6.csv": csv_bytes(head, lines), "table6.html": page.to_bytes()})


def _begun(out: str | Path, seed: int | None, triangles: int, device: str) -> tuple[Path, int]:
    """The folder for the files, once the request is known to be possible, and the seed."""
    folder = named_folder(out)
    first = database_recipe("cube", seed=_SEED if seed is None else seed, triangles=triangles).seed
    resolve_device(device)
    make_folder(folder)
    return folder, first


def _generated(folder: Path, seed: int, triangles: int, device: str) -> Path:
    """Database of generated stones, built or gone on with."""
    place = folder / FOLDER_NAME / "generated"
    plan = plan_run(count=_STONES_A_CLASS * len(SHAPE_CLASSES), seed=seed, shape_class="mixed", preset="database",
                    recipe=None, settings=[], size=None, unit=None, triangles=triangles, format=None)  # fmt: skip
    _finish(build(place, plan, Measures(_MEASURES), device=device, is_named=False), plan.count, "generated stones")
    return place


def _scanned(folder: Path, reference: Path, triangles: int) -> Path:
    """Database of the reference scans, imported or gone on with."""
    place = folder / FOLDER_NAME / "scanned"
    numbers = import_scans(place, [reference], Measures(_MEASURES, keep_meshes=True), source="FDOT-57", unit="mm",
                           triangles=triangles)  # fmt: skip
    _finish(numbers, len(find_scans([reference])), "scans")
    return place


def _finish(numbers: Iterable[int], total: int, what: str) -> None:
    for _ in track(numbers, total=total, what=what):
        pass


def _experiment(
    out: str | Path, seed: int | None, triangles: int, device: str
) -> tuple[Path, Experiment, list[dict[str, Any]]]:
    """The experiment, carried out or gone on with, and its rows."""
    reference = find_reference()
    folder, first = _begun(out, seed, triangles, device)
    scanned = _scanned(folder, reference, triangles)
    generated = _generated(folder, first, triangles, device)
    plan = Experiment(scanned=scanned, generated=generated, cases=_CASES, generated_runs=_GENERATED_RUNS, scale=_SCALE,
                      seed=first, changes=dict(_CHANGES))  # fmt: skip
    place = folder / FOLDER_NAME / "experiment"
    rows = run_experiment(plan, place, device=device, resume=(place / PLAN_FILE).exists(), progress=True)
    return folder, plan, rows


def _source(row: dict[str, Any]) -> str:
    return "generated" if row["sample"] else "scanned"


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise OutputError(
            f"expected the picture {path}, which cannot be read ({error.strerror or error}): remove the folder "
            f"{path.parent} and give the same command again."
        ) from error
