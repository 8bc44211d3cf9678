"""The paper's figures and tables made anew, by the names that the command line takes."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

__all__ = ["FIGURES", "Reproduction"]


@dataclass(frozen=True)
class Reproduction:
    """A figure or a table of the paper.

    Attributes
    ----------
    name, meaning : str
        As the command line takes and lists it.
    module, function : str
        Where it is made: ``function(out, *, seed, triangles, device) -> list of Path``; loaded when it is asked for.
    """

    name: str
    meaning: str
    module: str
    function: str

    def make(self, out: str | Path, **options: Any) -> list[Path]:
        """Make it; the files written."""
        made = getattr(import_module(f"lithoform.reproduce.{self.module}"), self.function)(out, **options)
        return [made] if isinstance(made, Path) else list(made)


FIGURES: Final[dict[str, Reproduction]] = {row.name: row for row in (
    Reproduction("fig2", "the gallery of one-parameter variations at one seed and one view", "plates", "figure_2"),
    Reproduction("fig3", "what the four descriptors measure, on one stone", "shape", "figure_3"),
    Reproduction("fig4", "the classes in Zingg's diagram; the descriptors at 51,200, 20,000 and 5,000 triangles",
                 "shape", "figure_4"),
    Reproduction("fig5", "stones calibrated by PCA and AABB and twisted by 0 to 60 degrees, by class", "sensitivity",
                 "figure_5"),
    Reproduction("fig6", "the four descriptors over each of the 15 parameters", "sensitivity", "figure_6"),
    Reproduction("fig7", "stones designed for targets, and what they reach: the closed loop", "design", "figure_7"),
    Reproduction("fig8", "scanned and generated stones, and the histograms of the four descriptors", "populations",
                 "figure_8"),
    Reproduction("fig9", "histograms of the roundness by class", "populations", "figure_9"),
    Reproduction("fig10", "histograms of the true sphericity by class", "populations", "figure_10"),
    Reproduction("table3", "analysis of variance of the four descriptors", "populations", "table_3"),
    Reproduction("table4", "analysis of variance of the roundness by class", "populations", "table_4"),
    Reproduction("table5", "analysis of variance of the true sphericity by class", "populations", "table_5"),
)}  # fmt: skip
"""Figures and tables of the paper by the names that the command line takes."""
