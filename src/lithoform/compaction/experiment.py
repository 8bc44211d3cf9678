"""The paper's experiment: specimens of scanned and of generated stones, compacted alike, and compared."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.compaction.campaign import run_campaign
from lithoform.compaction.request import Request
from lithoform.errors import RecipeError
from lithoform.seeds import MAX_SEED, Role, derive
from lithoform.sidecar import program_version
from lithoform.statistics.anova import equivalence

__all__ = [
    "MARGINS", "MEASURES", "SCALES", "Comparison", "Experiment", "Run", "compare_sources", "measures_of",
    "run_experiment",
]  # fmt: skip

SCALES: Final[dict[str, dict[str, Any]]] = {
    "small": {"min_size": 9.5e-3, "mould": 0.070, "gyrations": 5, "rate_factor": 40.0},
    "medium": {"min_size": 4.75e-3, "mould": 0.081, "gyrations": 33, "rate_factor": 40.0},
    "paper": {"min_size": 2.36e-3, "mould": 0.150, "gyrations": 33, "rate_factor": 20.0},
}
"""Settings of a specimen, all at E/5: the same mould for both sources, and as many stones as fill it alike, so that
all specimens have the same mass."""

MEASURES: Final = {
    "loose_density": "packing density before gyration",
    "compacted_density": "packing density after gyration",
    "A": "height at the first gyration over that of the solids",
    "B": "exponent of the height",
}
"""What is compared. A is divided by the height that the stones would have without voids: masses do not matter."""

MARGINS: Final = {"loose_density": 0.01, "compacted_density": 0.01, "A": 0.05, "B": 0.003}
"""Differences that would not matter: a point of packing density, as the paper takes it; some 2 % of A; 10 % of B."""


# At a tenth small stones under chains of large ones would be pressed too deep: one specimen in a few fails.
_STIFFNESS: Final = 0.2
# Below all specimens, for a mould as wide as the protocol's [m].
_NO_HEIGHT: Final = 1e-4


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment.

    Attributes
    ----------
    scanned, generated : Path
        Databases.
    cases, generated_runs : int
        In each case one specimen of scanned stones, and so many of generated ones.
    scale : str
        One of `SCALES`.
    seed : int
    changes : dict
        Settings of `lithoform.compaction.request.Request` in place of those of the scale.
    """

    scanned: Path
    generated: Path
    cases: int = 6
    generated_runs: int = 3
    scale: str = "medium"
    seed: int = 0
    changes: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.scale not in SCALES:
            raise RecipeError(f"expected --scale of {', '.join(SCALES)}; got {self.scale!r}.")
        if not (isinstance(self.seed, int) and 0 <= self.seed <= MAX_SEED):
            raise RecipeError(f"the seed must be a whole number from 0 to {MAX_SEED}; got {self.seed!r}.")
        for name, value, most in (("cases", self.cases, 100), ("generated-runs", self.generated_runs, 100)):
            if not (isinstance(value, int) and 1 <= value <= most):
                raise RecipeError(f"expected --{name} from 1 to {most}; got {value!r}.")
        self.plan()

    def plan(self) -> list[Run]:
        """All runs, each with a seed of its own."""
        return [
            Run(case, sample, self._request(case, sample))
            for case in range(1, self.cases + 1)
            for sample in range(self.generated_runs + 1)
        ]

    def _request(self, case: int, sample: int) -> Request:
        asked = {"vtk": False, "stiffness_factor": _STIFFNESS, **SCALES[self.scale], **(self.changes or {})}
        source = self.generated if sample else self.scanned
        # No run ends at a height: all are compared after the same gyrations.
        return Request(population=source, seed=derive(self.seed, Role.SPECIMEN, case, sample), count=None,
                       to_height=_NO_HEIGHT, **asked)  # fmt: skip

    def settings(self) -> dict[str, Any]:
        """Plain values, with the version of the program."""
        return {"lithoform": program_version(), "scanned": str(self.scanned), "generated": str(self.generated),
                "cases": self.cases, "generated_runs": self.generated_runs, "scale": self.scale, "seed": self.seed,
                "changes": self.changes or {}}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A run of an experiment.

    Attributes
    ----------
    case : int
        From 1.
    sample : int
        0 for the specimen of scanned stones, from 1 for those of generated ones.
    request : Request
    """

    case: int
    sample: int
    request: Request

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"case{self.case}_{f'generated{self.sample}' if self.sample else 'scanned'}"


def run_experiment(experiment: Experiment, out: Path, **how: Any) -> list[dict[str, Any]]:
    """Carry out an experiment: each run in a folder of its own, whole or to be gone on with.

    Parameters
    ----------
    experiment : Experiment
    out : Path
        Folder.
    **how
        device, workers, scheduler, resume, progress and told of `lithoform.compaction.campaign.run_campaign`.

    Returns
    -------
    list of dict
        Results of the runs in the order of the plan, each with case, sample and name.

    Raises
    ------
    OutputError, LithoformError
        As `lithoform.compaction.campaign.run_campaign`.
    """
    plan = experiment.plan()
    named = [(run.name, run.request) for run in plan]
    found = run_campaign(named, experiment.settings(), out, what="experiment", **how)
    return [{"case": run.case, "sample": run.sample, "name": run.name, **row}
            for run, row in zip(plan, found, strict=True)]  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """A measure of scanned and of generated specimens.

    Attributes
    ----------
    name : str
        One of `MEASURES`.
    scanned, generated : tuple of float
    difference : float
        Mean of the generated less that of the scanned.
    interval : (float, float)
        Confidence interval of 90 % of the difference: equivalence at the level 0.05 is that it lies within the margin.
    margin : float
    spread : float
        Standard deviation of generated specimens of one case: from seed to seed.
    """

    name: str
    scanned: tuple[float, ...]
    generated: tuple[float, ...]
    difference: float
    interval: tuple[float, float]
    margin: float
    spread: float

    @property
    def verdict(self) -> str:
        """Whether the sources are equivalent within the margin, different, or it cannot be told."""
        low, high = self.interval
        if -self.margin < low and high < self.margin:
            return "equivalent"
        if low > 0.0 or high < 0.0:
            return "different"
        return "open"


def measures_of(results: dict[str, Any]) -> dict[str, float]:
    """The compared numbers of a run."""
    loose, end, fit = results["loose"], results["compacted"], results["fit"]
    solid = loose["packing_density"] * loose["height"]
    return {
        "loose_density": loose["packing_density"],
        "compacted_density": end["packing_density"],
        "A": fit["A"] / solid if fit else math.nan,
        "B": fit["B"] if fit else math.nan,
    }


def compare_sources(rows: list[dict[str, Any]]) -> list[Comparison]:
    """Compare the sources of an experiment, measure by measure.

    Parameters
    ----------
    rows : list of dict
        As `run_experiment` gives them.
    """
    return [_compared(name, rows) for name in MEASURES]


def _compared(name: str, rows: list[dict[str, Any]]) -> Comparison:
    found = {(row["case"], row["sample"]): measures_of(row)[name] for row in rows}
    # Runs too short for a fit have no A and B.
    values = {key: value for key, value in found.items() if math.isfinite(value)}
    scanned = np.array([value for (_, sample), value in values.items() if sample == 0])
    generated = np.array([value for (_, sample), value in values.items() if sample > 0])
    groups = [[value for (c, sample), value in values.items() if c == case and sample] for case in _cases(values)]
    groups = [group for group in groups if group]
    free = sum(len(group) - 1 for group in groups)
    within = sum(float(np.var(group) * len(group)) for group in groups)
    difference = float(generated.mean() - scanned.mean()) if len(scanned) and len(generated) else math.nan
    interval = (-math.inf, math.inf)
    if len(scanned) > 1 and len(generated) > 1 and float(np.ptp(scanned)) == float(np.ptp(generated)) == 0.0:
        interval = (difference, difference)
    elif len(scanned) > 1 and len(generated) > 1:
        test = equivalence(generated, scanned, margin=MARGINS[name])
        interval = test.interval
    return Comparison(name, tuple(scanned.tolist()), tuple(generated.tolist()), difference, interval, MARGINS[name],
                      math.sqrt(within / free) if free else math.nan)  # fmt: skip


def _cases(values: dict[tuple[int, int], float]) -> Iterator[int]:
    yield from sorted({case for case, _ in values})
