"""The paper's figures and tables by the names that the command line takes, and what stands for those not made anew."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Literal

__all__ = ["FIGURES", "PAPER", "SHARED", "Reproduction"]


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """A figure or a table of the paper.

    Attributes
    ----------
    name, meaning : str
        As the command line takes and lists it.
    section : str
        Of the paper; a letter is an appendix.
    module, function : str
        Where it is made: ``function(out, *, seed, triangles, device) -> list of Path``; loaded when it is asked for.
        Empty where it is not made.
    files : tuple of str
        Names of the files that it makes in its folder.
    cost : str
        Wall-clock time on two cores at the usual settings, measured or estimated.
    represented : str
        Of what is not made anew, a drawing or an input of the paper's: what stands for it in the program.
    """

    name: str
    meaning: str
    section: str
    module: str = ""
    function: str = ""
    files: tuple[str, ...] = ()
    cost: str = ""
    represented: str = ""

    @property
    def kind(self) -> Literal["figure", "table"]:
        """What it is in the paper."""
        return "table" if self.name.startswith("table") else "figure"

    @property
    def title(self) -> str:
        """As the paper names it, such as "Fig. 6"."""
        return f"Table {self.name[5:]}" if self.kind == "table" else f"Fig. {self.name[3:]}"

    @property
    def command(self) -> str:
        """What makes it; empty where nothing does."""
        return f"lithoform reproduce {self.name}" if self.module else ""

    def make(self, out: str | Path, **options: Any) -> list[Path]:
        """Make it; the files written."""
        made = getattr(import_module(f"lithoform.reproduce.{self.module}"), self.function)(out, **options)
        return [made] if isinstance(made, Path) else list(made)

    def missing(self, out: str | Path) -> list[str]:
        """Names of its files that a folder does not hold, or holds empty."""
        return [name for name in self.files if not _has_content(Path(out) / name)]


def _has_content(path: Path) -> bool:
    try:
        return os.stat(path).st_size > 0 and path.is_file()  # noqa: PTH116 (Path.is_file alone says nothing of the size)
    except (OSError, ValueError):
        return False


def _csv_and_page(name: str) -> tuple[str, str]:
    return f"{name}.csv", f"{name}.html"


_SHARED: Final = "measured 45 s, shared"
_EXPERIMENT: Final = "measured 92 min with the databases at hand, shared"

SHARED: Final = " ".join((
    "Fig. 8 to 10 and Tables 3 to 5 share their stones within one `all`;",
    "Fig. 12, Fig. 13 and Table 6 share one experiment.",
))  # fmt: skip
"""What a cost that is shared means."""

PAPER: Final[dict[str, Reproduction]] = {row.name: row for row in (
    Reproduction(name="fig1", meaning="flowchart of the algorithm", section="2",
                 represented="a drawing; its steps are those of lithoform.generation.generate"),
    Reproduction(name="table1", meaning="the 19 parameters and their benchmark values", section="3",
                 represented="an input: lithoform.presets.benchmark_recipe, preset benchmark"),
    Reproduction(name="fig2", meaning="the gallery of one-parameter variations at one seed and one view", section="3",
                 module="plates", function="figure_2", files=("fig2.png",), cost="measured 8 s"),
    Reproduction(name="table2", meaning="definitions of the four descriptors", section="4",
                 represented="definitions: lithoform.descriptors.measuring.measure, lithoform measure"),
    Reproduction(name="fig3", meaning="what the four descriptors measure, on one stone", section="4",
                 module="shape", function="figure_3", files=("fig3.png",), cost="measured 3 s"),
    Reproduction(name="fig4", section="4",
                 meaning="the classes in Zingg's diagram; the descriptors at 51,200, 20,000 and 5,000 triangles",
                 module="shape", function="figure_4", files=("fig4a.png", "fig4b.csv", "fig4b.png"),
                 cost="measured 22 s"),
    Reproduction(name="fig5", meaning="stones calibrated by PCA and AABB and twisted by 0 to 60 degrees, by class",
                 section="4", module="sensitivity", function="figure_5",
                 files=("fig5.png", "fig5.csv", "fig5_claims.csv"), cost="measured 49 s"),
    Reproduction(name="fig6", meaning="the four descriptors over each of the 15 parameters", section="4",
                 module="sensitivity", function="figure_6", files=("fig6.png", "fig6.csv", "fig6_trends.csv"),
                 cost="measured 3 to 7 min"),
    Reproduction(name="fig7", meaning="stones designed for targets, and what they reach: the closed loop", section="4",
                 module="design", function="figure_7",
                 files=("fig7_published.png", "fig7_ours.png", "fig7_errors.png", "fig7.csv"),
                 cost="measured 9 min"),
    Reproduction(name="fig8", meaning="scanned and generated stones, and the histograms of the four descriptors",
                 section="5", module="populations", function="figure_8",
                 files=("fig8a.png", "fig8b.png", "fig8.csv"), cost=_SHARED),
    Reproduction(name="table3", meaning="analysis of variance of the four descriptors", section="5",
                 module="populations", function="table_3", files=_csv_and_page("table3"), cost=_SHARED),
    Reproduction(name="fig9", meaning="histograms of the roundness by class", section="5",
                 module="populations", function="figure_9", files=("fig9.png", "fig9.csv"), cost=_SHARED),
    Reproduction(name="table4", meaning="analysis of variance of the roundness by class", section="5",
                 module="populations", function="table_4", files=_csv_and_page("table4"), cost=_SHARED),
    Reproduction(name="fig10", meaning="histograms of the true sphericity by class", section="5",
                 module="populations", function="figure_10", files=("fig10.png", "fig10.csv"), cost=_SHARED),
    Reproduction(name="table5", meaning="analysis of variance of the true sphericity by class", section="5",
                 module="populations", function="table_5", files=_csv_and_page("table5"), cost=_SHARED),
    Reproduction(name="fig11", meaning="the gradation; a specimen deposited, pressed and compacted", section="6",
                 module="compaction", function="figure_11",
                 files=("fig11_gradation.png", "fig11_specimen.png", "fig11_film.png", "fig11_curve.png",
                        "fig11.csv"), cost="measured 2 min"),
    Reproduction(name="fig12", meaning="packing densities of specimens of scanned and of generated stones", section="6",
                 module="compaction", function="figure_12", files=("fig12.png", "fig12.csv", "fig12_sources.csv"),
                 cost=_EXPERIMENT),
    Reproduction(name="fig13", meaning="heights of these specimens over the gyrations", section="6",
                 module="compaction", function="figure_13", files=("fig13.png", "fig13.csv"), cost=_EXPERIMENT),
    Reproduction(name="table6", meaning="fits of the height, H = A G^B", section="6",
                 module="compaction", function="table_6", files=_csv_and_page("table6"), cost=_EXPERIMENT),
    Reproduction(name="table7", meaning="ranges of the 15 parameters", section="A",
                 represented="an input: lithoform.axes.TABLE_7, which lithoform sensitivity oat and Fig. 6 vary"),
    Reproduction(name="fig14", meaning="window of the design explorer", section="B",
                 represented="a picture of a program: lithoform explore"),
    Reproduction(name="table8", meaning="equations of the contact model", section="C",
                 represented="equations: lithoform.dem.jkr, lithoform.dem.contact"),
    Reproduction(name="table9", meaning="symbols of the contact model", section="C",
                 represented="names: the docstrings of lithoform.dem.jkr, lithoform.dem.contact"),
    Reproduction(name="table10", meaning="parameters of the discrete element model", section="C",
                 represented="an input: lithoform.dem.materials.TABLE_10"),
)}  # fmt: skip
"""All figures and tables of the paper, in its order."""

FIGURES: Final[dict[str, Reproduction]] = {name: row for name, row in PAPER.items() if row.module}
"""Those of them that the program makes anew."""
