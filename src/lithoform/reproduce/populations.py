"""Tables 3 to 5 and Fig. 8 to 10: scanned and generated stones compared, with the paper's numbers beside ours.

The paper's scans are not public.  NIST's particles of FDOT-57, Florida's #57 stone, take their place: 95 stones in
their natural mix of classes, few of them columns and blades.  What agrees and what differs is therefore of another rock
than the paper's, which the generator was never fitted to.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.atomic import make_folder
from lithoform.database.population import Population
from lithoform.descriptors.measuring import measure
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError
from lithoform.figures.gallery import gallery, png_bytes
from lithoform.figures.populations import Panel, heading, histogram_figure, require_figures
from lithoform.generation import generate, generate_many
from lithoform.parameters import Recipe
from lithoform.presets import SHAPE_CLASSES, database_recipe, particle_seed
from lithoform.progress import track
from lithoform.rendering import require_pictures
from lithoform.report.page import Bullets, Page, Paragraph, Table
from lithoform.report.study import Study, study
from lithoform.report.verdicts import mix_notes, verdicts
from lithoform.reproduce.files import csv_bytes, named_folder, write_files
from lithoform.reproduce.published_populations import (
    PUBLISHED_ANOVA,
    PUBLISHED_INDICES,
    PublishedAnova,
    PublishedIndices,
)
from lithoform.scans.reading import find_scans, read_scan
from lithoform.statistics.anova import Anova, anova_from_mean_squares
from lithoform.statistics.comparison import SampleComparison
from lithoform.survey import survey
from lithoform.warp_runtime import resolve_device

__all__ = ["figure_8", "figure_9", "figure_10", "table_3", "table_4", "table_5"]

FOLDER_VARIABLE: Final = "LITHOFORM_FDOT57"
_FOLDER: Final = Path("shared", "data", "fdot57")
_SEED: Final = 25
_STONES_A_CLASS: Final = 150
_EXAMPLES: Final = 2  # stones of each source and class in Fig. 8a
_SLIP: Final = 0.05  # a printed number this part away from the recomputed one is a slip, not rounding

_ABOUT: Final = (
    "The paper's scans are not public. NIST's particles of Florida's #57 stone take their place, in their natural mix.",
    "Ours and the paper's numbers are therefore of different rocks.",
    "Our roundness has a stated scale, a quarter of the inscribed radius; the paper's program gives higher values.",
    "Generated: the paper's database setting, classes as drawn. Scans: classes as measured.",
)
_FIGURES: Final = {"table3": "fig8", "table4": "fig9", "table5": "fig10"}
_MOMENTS: Final = ("particles", "mean of A", "mean of B", "deviation of A", "deviation of B")
_MEANS: Final = (
    "The paper's class means of the generated stones average 0.783, its pooled mean is 0.808: they do not agree.",
)


@dataclass(frozen=True, eq=False)
class _Sources:
    found: Study
    scans: tuple[Path, ...]
    recipes: tuple[Recipe, ...]


def table_3(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Analysis of variance of the four descriptors, all particles (Table 3).

    Parameters
    ----------
    out : path-like
        Folder, which takes table3.csv and table3.html.
    seed : int, optional
        Seed from which those of the generated stones are derived, and of the statistics.
    triangles : int
        Of every stone, generated or made from its coefficients.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    list of pathlib.Path

    Raises
    ------
    FileFormatError
        If the folder of the scans is not found, or one of them cannot be measured.
    LithoformError
        If a stone cannot be made, or a file cannot be written.
    """
    return _table("table3", "Table 3: analysis of variance, all particles", out, seed, triangles, device)


def table_4(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Analysis of variance of the roundness by class (Table 4), in table4.csv and table4.html; as `table_3`."""
    return _table("table4", "Table 4: analysis of variance of the roundness by class", out, seed, triangles, device)


def table_5(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Analysis of variance of the true sphericity by class (Table 5), in table5.csv and table5.html; as `table_3`."""
    title = "Table 5: analysis of variance of the true sphericity by class"
    return _table("table5", title, out, seed, triangles, device)


def figure_8(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Stones of both sources, and histograms of the four descriptors (Fig. 8).

    It makes fig8a.png, two stones of each source and class; fig8b.png, the histograms; and fig8.csv, the indices.
    Parameters, result and errors are those of `table_3`; stones are drawn, which needs the extra ``pictures``.
    """
    require_pictures()
    sources, folder = _prepared(out, seed, triangles, device)
    return [_gallery(sources, folder / "fig8a.png", triangles, device), *_histograms("fig8", sources, folder, "fig8b")]


def figure_9(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Histograms of the roundness by class (Fig. 9), in fig9.png and fig9.csv; as `figure_8`."""
    require_figures()
    return _histograms("fig9", *_prepared(out, seed, triangles, device), "fig9")


def figure_10(out: str | Path, *, seed: int | None = None, triangles: int = 20_000, device: str = "auto") -> list[Path]:
    """Histograms of the true sphericity by class (Fig. 10), in fig10.png and fig10.csv; as `figure_8`."""
    require_figures()
    return _histograms("fig10", *_prepared(out, seed, triangles, device), "fig10")


def find_reference() -> Path:
    """Folder of the reference scans: the variable LITHOFORM_FDOT57, or shared/data/fdot57 near the program.

    Raises
    ------
    FileFormatError
        If there is none.
    """
    named = os.environ.get(FOLDER_VARIABLE)
    roots = (Path(__file__).resolve().parents[4], Path.cwd(), Path.cwd().parent)
    tried = [Path(named)] if named else [root / _FOLDER for root in roots]
    for folder in tried:
        if os.path.isdir(folder):  # noqa: PTH112 (Path.is_dir raises for a name too long)
            return folder
    where = f"{FOLDER_VARIABLE} names {named}" if named else f"there is no {_FOLDER.as_posix()}"
    raise FileFormatError(
        f"expected a folder with the scans of FDOT-57, but {where}: get NIST's coefficient files of that rock, "
        f"and name their folder in the environment variable {FOLDER_VARIABLE}."
    )


def _prepared(out: str | Path, seed: int | None, triangles: int, device: str) -> tuple[_Sources, Path]:
    """Both populations, made or as they were made before in this process, and the folder for the files."""
    folder = named_folder(out)
    first = database_recipe("cube", seed=_SEED if seed is None else seed, triangles=triangles).seed
    resolve_device(device)
    reference = find_reference()
    make_folder(folder)
    return _sources(reference, first, triangles, device, _STONES_A_CLASS), folder


@functools.lru_cache(maxsize=1)
def _sources(folder: Path, seed: int, triangles: int, device: str, stones: int) -> _Sources:
    scans = tuple(find_scans(folder))
    names = (*FOUR, "zingg_class")
    measured = list(track(survey(scans, names, unit="mm", triangles=triangles), total=len(scans), what="scans"))
    values, classes = [], []
    for row in measured:
        if row.measurement is None:
            raise FileFormatError(f"{row.file}: {row.error}")
        values.append([row.measurement[name] for name in FOUR])
        classes.append(str(row.measurement["zingg_class"]))
    label = f"FDOT-57, {len(scans)} scans" if folder.name == _FOLDER.name else f"{folder.name}, {len(scans)} scans"
    reference = Population(label, FOUR, np.array(values), tuple(classes))

    drawn = [SHAPE_CLASSES[i % len(SHAPE_CLASSES)] for i in range(stones * len(SHAPE_CLASSES))]
    recipes = tuple(
        database_recipe(name, seed=particle_seed(seed, i + 1), triangles=triangles) for i, name in enumerate(drawn)
    )
    stream = generate_many(recipes, device=device, each=lambda _, particle: measure(particle, FOUR))
    rows = [[row[name] for name in FOUR] for row in track(stream, total=len(recipes), what="generated stones")]
    generated = Population(f"generated, {len(recipes)} stones", FOUR, np.array(rows), tuple(drawn))
    return _Sources(study(reference, generated, seed=seed), scans, recipes)


def _cases(name: str, found: Study) -> list[tuple[str, str, str | None, SampleComparison | None]]:
    """Rows or panels: what each is called, its descriptor, its class, the comparison (None where it was left out)."""
    if name in ("table3", "fig8"):
        return [(d, d, None, row) for d, row in zip(found.names, found.groups[0].descriptors, strict=True)]
    descriptor = "roundness" if name in ("table4", "fig9") else "true_sphericity"
    column = found.names.index(descriptor)
    compared = {group.name: group.descriptors[column] for group in found.groups[1:]}
    return [(shape, descriptor, shape, compared.get(shape)) for shape in SHAPE_CLASSES]


def _table(name: str, title: str, out: str | Path, seed: int | None, triangles: int, device: str) -> list[Path]:
    sources, folder = _prepared(out, seed, triangles, device)
    found = sources.found
    cells: list[tuple[str, ...]] = []
    starts = []
    for case, descriptor, shape, row in _cases(name, found):
        starts.append(len(cells))
        sizes = tuple(len(side) for side in found.samples(shape, descriptor))
        moments = PUBLISHED_INDICES[_FIGURES[name]][case]
        cells += [(case, *line) for line in _anova_lines(row, sizes, PUBLISHED_ANOVA[name][case], moments)]
    head = ("descriptor" if name == "table3" else "class", "quantity", "ours", "paper", "recomputed", "note")
    page = Page(title)
    page.add(Paragraph(f"A: {found.reference.label}. B: {found.other.label}, {triangles:,} triangles each."))
    page.add(
        Bullets(
            (
                *_ABOUT,
                *(_MEANS if name == "table5" else ()),
                *(f"{note[0].upper()}{note[1:]}." for note in mix_notes(found)),
            )
        )
    )
    page.section("In words", Bullets(tuple(_sentences(name, found))))
    caption = (
        "A − B: mean of the scans less mean of the generated stones; the paper prints its interval without a sign. "
        "Recomputed: from the paper's own mean squares and numbers of particles; a note says where that is not what it "
        "prints."
    )
    page.section("Numbers", Table(head, tuple(cells), caption, texts=(0, 1, 5), groups=tuple(starts[1:])))
    return write_files(folder, {f"{name}.csv": csv_bytes(head, cells), f"{name}.html": page.to_bytes()})


def _anova_lines(
    row: SampleComparison | None, sizes: tuple[int, ...], printed: PublishedAnova, moments: PublishedIndices
) -> list[tuple[str, ...]]:
    again = anova_from_mean_squares(printed.groups[1], printed.error[1], (printed.size, printed.size))
    paper: dict[str, Any] = {
        "particles": f"{printed.size} + {printed.size}",
        "groups: degrees of freedom": 1, "error: degrees of freedom": 2 * printed.size - 2,
        "total: degrees of freedom": 2 * printed.size - 1,
        "groups: sum of squares": printed.groups[0], "groups: mean square": printed.groups[1],
        "error: sum of squares": printed.error[0], "error: mean square": printed.error[1],
        "total: sum of squares": printed.total[0], "total: mean square": printed.total[1],
        "F": printed.f, "p": printed.p, "eta squared": printed.eta_squared,
        "95 % interval of A − B, low": printed.interval[0], "95 % interval of A − B, high": printed.interval[1],
        "significant at 0.05": "yes" if printed.p < 0.05 else "no",
    }  # fmt: skip
    ours: dict[str, Any] = {"particles": " + ".join(map(str, sizes))}
    for side, means, deviations in (
        (ours, row and row.means, row and row.deviations),
        (paper, moments.means, moments.deviations),
    ):
        for what, pair in (("mean", means), ("deviation", deviations)):
            side |= {f"{what} of {letter}": value for letter, value in zip("AB", pair or (), strict=False)}
    if row is not None:
        ours |= _anova_numbers(row.anova)
    recomputed = _anova_numbers(again)
    lines = []
    for what in (*_MOMENTS, *recomputed):
        note = ""
        a, b = paper.get(what), recomputed.get(what)
        if isinstance(a, float) and isinstance(b, float) and abs(a - b) > _SLIP * abs(b):
            tenfold = abs(10.0 * a - b) < _SLIP * abs(b)
            cause = "ten times too small" if tenfold else "it is the row's p" if abs(a - again.p) < 1e-4 else "see text"
            note = f"a slip of the paper: {cause}"
        elif what == "particles" and row is None:
            note = "too few scans to compare"
        lines.append((what, *(_cell(side.get(what, "")) for side in (ours, paper, recomputed)), note))
    return lines


def _anova_numbers(found: Anova) -> dict[str, Any]:
    groups, error = found.between_freedom, found.within_freedom
    total = groups * found.between_mean_square + error * found.within_mean_square
    low, high = found.interval or (np.nan, np.nan)
    return {
        "groups: degrees of freedom": groups, "groups: sum of squares": groups * found.between_mean_square,
        "groups: mean square": found.between_mean_square, "error: degrees of freedom": error,
        "error: sum of squares": error * found.within_mean_square, "error: mean square": found.within_mean_square,
        "total: degrees of freedom": groups + error, "total: sum of squares": total,
        "total: mean square": total / (groups + error), "F": found.f, "p": found.p,
        "eta squared": found.eta_squared, "95 % interval of A − B, low": low, "95 % interval of A − B, high": high,
        "significant at 0.05": "yes" if found.p < 0.05 else "no",
    }  # fmt: skip


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _sentences(name: str, found: Study) -> Sequence[str]:
    told = {
        (group.name, descriptor): one.sentence
        for group, row in zip(found.groups, verdicts(found), strict=True)
        for descriptor, one in zip(found.names, row, strict=True)
    }
    lines = []
    for case, descriptor, shape, _ in _cases(name, found):
        sizes = " and ".join(f"{len(side)}" for side in found.samples(shape, descriptor))
        sentence = told.get((shape, descriptor), "not compared: too few scans")
        lines.append(f"{case} ({sizes} stones): {sentence}.")
    return lines


def _histograms(name: str, sources: _Sources, folder: Path, file: str) -> list[Path]:
    found = sources.found
    panels, lines = [], []
    for case, descriptor, shape, row in _cases(name, found):
        title, symbol = heading(descriptor) if shape is None else (shape, "")
        printed, sides = PUBLISHED_INDICES[name][case], found.samples(shape, descriptor)
        size = PUBLISHED_ANOVA["table3" if shape is None else "table4"][case].size
        panels.append(Panel(title, sides, row, symbol, _paper_notes(printed, size)))
        lines += [(case, *line) for line in _index_lines(row, sides, printed)]
    title = "All particles" if name == "fig8" else f"{heading(_cases(name, found)[0][1])[0]} by class"
    labels = (found.reference.label, found.other.label)
    head = ("descriptor" if name == "fig8" else "class", "quantity", "ours", "by_chance", "p", "paper")
    picture = png_bytes(histogram_figure(panels, labels, title=title))
    return write_files(folder, {f"{file}.png": picture, f"{name}.csv": csv_bytes(head, lines)})


def _paper_notes(printed: PublishedIndices, size: int) -> tuple[str, ...]:
    pairs = (("BC", printed.bhattacharyya), ("KL", printed.kullback_leibler), ("JS", printed.jensen_shannon))
    first = "   ".join(f"{sign} {value:.4f}" for sign, value in pairs if value is not None)
    if printed.means is None:
        return (f"paper ({size} + {size}):  {first}",)
    means = (f"{mean:.4f}" for mean in printed.means)
    if printed.deviations is not None:
        means = (f"{m} ± {s:.4f}" for m, s in zip(means, printed.deviations, strict=True))
    return f"paper ({size} + {size}):  {first}", f"paper:  A {'   B '.join(means)}"


def _index_lines(
    row: SampleComparison | None, sides: tuple[np.ndarray, np.ndarray], printed: PublishedIndices
) -> list[tuple[Any, ...]]:
    lines: list[tuple[Any, ...]] = [(f"particles of {x}", len(side), "", "", "") for x, side in
                                    zip("AB", sides, strict=True)]  # fmt: skip
    for i, letter in enumerate("AB"):
        for what, ours, paper in (("mean", row and row.means, printed.means),
                                  ("deviation", row and row.deviations, printed.deviations)):  # fmt: skip
            lines.append((f"{what} of {letter}", ours[i] if ours else "", "", "", paper[i] if paper else ""))
    for index in ("bhattacharyya", "kullback_leibler", "jensen_shannon"):
        paper = getattr(printed, index)
        test = None if row is None else row.index(index)
        ours = ("", "", "") if test is None else (test.value, test.floor_mean, test.p)
        lines.append((index, *ours, "" if paper is None else paper))
    return lines


def _gallery(sources: _Sources, path: Path, triangles: int, device: str) -> Path:
    """A row a class: first stones of the scans, then generated ones."""
    found = sources.found
    meshes, captions = [], []
    for shape in SHAPE_CLASSES:
        ours, theirs = (
            [i for i, one in enumerate(side.classes or ()) if one == shape] for side in (found.other, found.reference)
        )
        scans = [sources.scans[i] for i in theirs[:_EXAMPLES]]
        meshes += [read_scan(path, unit="mm", triangles=triangles).mesh for path in scans]
        captions += [f"A, {shape}\n{path.stem}" for path in scans]
        # Where scans are few, generated stones fill the row.
        made = ours[: 2 * _EXAMPLES - len(scans)]
        meshes += [generate(sources.recipes[i], device=device).mesh for i in made]
        captions += [f"B, {shape}\nstone {i + 1}" for i in made]
    title = f"A: {found.reference.label}; B: {found.other.label}"
    return gallery(meshes, captions, path, columns=2 * _EXAMPLES, title=title, scale="each")
