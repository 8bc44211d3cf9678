"""What a faster mould and softer stones change: runs over both, and their extrapolation to the slow and the rigid.

Two numbers without dimension tell how far a case is from quasi-static and rigid (Roux and Combe 2002, C. R. Physique
3:131; da Cruz et al. 2005, Phys. Rev. E 72:021309): the inertial number I and the overlap over radius 1 / kappa.  While
both are small a packing density is linear in them,

    y = c_seed + a I + b / kappa,

with a constant for each seed, since the same seed has the same stones in the same places: they fall with the stiffness
of the first setting in all runs, and have their own from the pressing on.  (Beds that fell with another stiffness would
differ by chance, and by more than the platen and the gyrations make of it; under their own weight the stones are rigid
at any of them.)  Runs of one seed and one stiffness begin to gyrate from the same pressed bed.  So a is fitted among
runs of the same bed, and b among the beds, each with its own scatter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.compaction.campaign import run_campaign
from lithoform.compaction.request import Request
from lithoform.errors import RecipeError, SampleError
from lithoform.seeds import MAX_SEED, Role, derive
from lithoform.sidecar import program_version

__all__ = ["MARGINS", "MEASURES", "Extrapolation", "Setting", "Study", "extrapolate", "run_study"]

MEASURES: Final = {
    "loose_density": "packing density before gyration",
    "compacted_density": "packing density after gyration",
    "settlement": "height after gyration over that before",
}
"""What is extrapolated."""

MARGINS: Final = {"loose_density": 0.01, "compacted_density": 0.01, "settlement": 0.01}
"""Changes that would not matter: a point of packing density, and a hundredth of the height."""

# The mould stands still until then: the rate of gyration cannot matter.
_BEFORE_GYRATION: Final = frozenset({"loose_density"})
# Of the mean between its bounds: two one-sided tests at 5 %.
_CONFIDENCE: Final = 0.90


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study of the rate of gyration and of the stiffness.

    Attributes
    ----------
    population : Path
        A database.
    rate_factors, stiffness_factors : tuple of float
        Each with the first of the other: the first are the setting in which all else is compared.
    seeds : int
        Specimens, each with all settings.
    seed : int
        Of which each specimen has one made.
    count, gyrations : int
        Stones of a specimen, and gyrations of each run.
    min_size : float
        Least sieve size [m].
    gradation : str
    """

    population: Path
    rate_factors: tuple[float, ...] = (40.0, 10.0, 20.0, 80.0)
    stiffness_factors: tuple[float, ...] = (0.1, 0.3, 1.0)
    seeds: int = 3
    seed: int = 0
    count: int = 60
    gyrations: int = 5
    min_size: float = 9.5e-3
    gradation: str = "AC-13"

    def __post_init__(self) -> None:
        for name in ("rate_factors", "stiffness_factors"):
            values = getattr(self, name)
            if len(values) != len(set(values)) or len(values) < 2:
                raise RecipeError(f"expected two or more different --{name.replace('_', '-')}, got "
                                  f"{', '.join(f'{v:g}' for v in values) or 'none'}.")  # fmt: skip
        if not (isinstance(self.seeds, int) and 2 <= self.seeds <= 100):
            raise RecipeError(f"expected --seeds from 2 to 100: one tells nothing of the scatter; got {self.seeds!r}.")
        if not (isinstance(self.seed, int) and 0 <= self.seed <= MAX_SEED):
            raise RecipeError(f"the seed must be a whole number from 0 to {MAX_SEED}; got {self.seed!r}.")
        self.plan()

    def plan(self) -> list[tuple[str, Request]]:
        """Names and settings of all runs; those of one seed follow one another."""
        pairs = [(rate, self.stiffness_factors[0]) for rate in self.rate_factors]
        pairs += [(self.rate_factors[0], stiffness) for stiffness in self.stiffness_factors[1:]]
        return [
            (
                f"seed{seed}_rate{rate:g}_stiffness{stiffness:g}",
                self._request(rate, stiffness, derive(self.seed, Role.SPECIMEN, seed)),
            )
            for seed in range(self.seeds)
            for rate, stiffness in pairs
        ]

    def _request(self, rate: float, stiffness: float, seed: int) -> Request:
        # No run ends at a height: all make the same gyrations.
        return Request(population=self.population, gradation=self.gradation, min_size=self.min_size, count=self.count,
                       gyrations=self.gyrations, to_height=1e-4, rate_factor=rate, stiffness_factor=stiffness,
                       bed_stiffness_factor=self.stiffness_factors[0], seed=seed, vtk=False)  # fmt: skip

    def settings(self) -> dict[str, Any]:
        """Plain values, with the version of the program."""
        return {"lithoform": program_version(), "population": str(self.population),
                "rate_factors": list(self.rate_factors), "stiffness_factors": list(self.stiffness_factors),
                "seeds": self.seeds, "seed": self.seed, "count": self.count, "gyrations": self.gyrations,
                "min_size": self.min_size, "gradation": self.gradation}  # fmt: skip


def run_study(study: Study, out: Path, **how: Any) -> list[dict[str, Any]]:
    """Carry out a study, or go on with it.

    Parameters
    ----------
    study : Study
    out : Path
        Folder.
    **how
        device, workers, scheduler, resume, progress and told of `lithoform.compaction.campaign.run_campaign`.

    Returns
    -------
    list of dict
        A row a run: seed, rate_factor, stiffness_factor, inertial_number, inverse_kappa, seconds, and `MEASURES`.

    Raises
    ------
    OutputError, LithoformError
        As `lithoform.compaction.campaign.run_campaign`.
    """
    plan = study.plan()
    found = run_campaign(plan, study.settings(), out, what="study", **how)
    return [_row(request, results) for (_, request), results in zip(plan, found, strict=True)]


def _row(request: Request, results: dict[str, Any]) -> dict[str, Any]:
    loose, end, scales = results["loose"], results["compacted"], results["scales"]
    return {
        "seed": request.seed,
        "rate_factor": request.rate_factor,
        "stiffness_factor": request.stiffness_factor,
        "inertial_number": scales["inertial_number_median"],
        "inverse_kappa": 1.0 / scales["kappa"],
        "loose_density": loose["packing_density"],
        "compacted_density": end["packing_density"],
        "settlement": end["height"] / loose["height"],
        "seconds": results["seconds"],
    }


@dataclass(frozen=True, eq=False)
class Extrapolation:
    """A measure as a linear function of I and 1 / kappa.

    Attributes
    ----------
    name : str
        One of `MEASURES`.
    limit, limit_error : float
        At I = 1 / kappa = 0, mean of the seeds, and its standard error: by the scatter of the beds, or of the specimens
        where that is larger.
    slopes, errors : numpy.ndarray, shape (2,)
        a and b, and their standard errors; a is 0 where the rate cannot matter.
    scatter : (float, float)
        Standard deviations of the residuals: of runs of one bed, and of beds.
    freedom : (int, int)
        Their degrees of freedom.
    """

    name: str
    limit: float
    limit_error: float
    slopes: np.ndarray
    errors: np.ndarray
    scatter: tuple[float, float]
    freedom: tuple[int, int]

    def change(self, of: Setting, against: Setting) -> tuple[float, float, float]:
        """By how much a setting lies above another, and the interval of 90 % of that: value, low, high.

        The degrees of freedom of both scatters together are those of Welch and Satterthwaite.
        """
        from scipy.stats import t

        x = np.array([of.inertial_number - against.inertial_number, of.inverse_kappa - against.inverse_kappa])
        value, variances = float(x @ self.slopes), (x * self.errors) ** 2
        total = float(variances.sum())
        if total == 0.0:
            return value, value, value
        known = [(v, n) for v, n in zip(variances.tolist(), self.freedom, strict=True) if v > 0.0]
        freedom = total**2 / sum(v**2 / n for v, n in known)
        half = float(t.ppf(0.5 + 0.5 * _CONFIDENCE, freedom)) * math.sqrt(total)
        return value, value - half, value + half

    def verdict(self, of: Setting, against: Setting) -> str:
        """Whether the change is within the margin (safe), or not (biased), or it cannot be told (open)."""
        _, low, high = self.change(of, against)
        margin = MARGINS[self.name]
        if -margin < low and high < margin:
            return "safe"
        return "biased" if low > margin or high < -margin else "open"


@dataclass(frozen=True)
class Setting:
    """Factors, and the numbers that they make.

    Attributes
    ----------
    rate_factor, stiffness_factor : float
    inertial_number, inverse_kappa : float
        I of the median stone, and 1 / kappa.
    """

    rate_factor: float
    stiffness_factor: float
    inertial_number: float
    inverse_kappa: float

    @classmethod
    def of(cls, row: dict[str, Any]) -> Setting:
        """That of a run."""
        return cls(*(float(row[k]) for k in ("rate_factor", "stiffness_factor", "inertial_number", "inverse_kappa")))

    def changed(self, rate_factor: float, stiffness_factor: float) -> Setting:
        """With other factors, by the laws of both numbers: I ~ rate, 1 / kappa ~ E^(-2/3)."""
        return Setting(
            rate_factor, stiffness_factor, self.inertial_number * rate_factor / self.rate_factor,
            self.inverse_kappa * (self.stiffness_factor / stiffness_factor) ** (2.0 / 3.0),
        )  # fmt: skip

    @property
    def real(self) -> Setting:
        """The machine's own rate and the stones' own modulus: 30 a minute, 55 GPa."""
        return self.changed(1.0, 1.0)


def extrapolate(rows: Iterable[dict[str, Any]], name: str) -> Extrapolation:
    """Fit a measure over I and 1 / kappa.

    Parameters
    ----------
    rows : iterable of dict
        As `run_study` gives them.
    name : str
        One of `MEASURES`.

    Raises
    ------
    SampleError
        If the runs do not tell the slopes, or leave no degree of freedom.
    """
    rows = list(rows)
    beds: dict[tuple[int, float], list[dict[str, Any]]] = {}
    for row in rows:
        beds.setdefault((row["seed"], row["stiffness_factor"]), []).append(row)
    a, a_error, within, freedom = _within(list(beds.values()), name)
    seeds = sorted({seed for seed, _ in beds})
    at = [{key: float(np.mean([row[key] for row in bed])) for key in ("inertial_number", "inverse_kappa", name)}
          for bed in beds.values()]  # fmt: skip
    x = np.array([row["inverse_kappa"] for row in at])
    y = np.array([row[name] - a * row["inertial_number"] for row in at])
    design = np.array([[float(seed == one) for one in seeds] for seed, _ in beds])
    design = np.concatenate([design, x[:, None] / x.max()], axis=1)
    k = len(seeds)
    free = len(y) - k - 1
    if freedom < 0 or free < 1 or np.linalg.matrix_rank(design) < k + 1:
        raise SampleError(f"{len(rows)} runs do not tell how {MEASURES[name]} depends on rate and stiffness: at least "
                          "two values of each and two seeds are needed.")  # fmt: skip
    found, *_ = np.linalg.lstsq(design, y, rcond=None)
    residuals = y - design @ found
    variance = float(residuals @ residuals) / free
    covariance = variance * np.linalg.inv(design.T @ design)
    mean = np.append(np.full(k, 1.0 / k), 0.0)
    among = float(np.std(found[:k], ddof=1)) / math.sqrt(k) if k > 1 else 0.0
    error = max(math.sqrt(float(mean @ covariance @ mean)), among)
    return Extrapolation(
        name, float(mean @ found), error, np.array([a, found[k] / x.max()]),
        np.array([a_error, math.sqrt(covariance[k, k]) / x.max()]), (within, math.sqrt(variance)), (freedom, free),
    )  # fmt: skip


def _within(beds: list[list[dict[str, Any]]], name: str) -> tuple[float, float, float, int]:
    """Slope over I among runs of the same bed, its standard error, the scatter, and the degrees of freedom.

    These are -1 if the runs do not tell it.
    """
    if name in _BEFORE_GYRATION:
        return 0.0, 0.0, 0.0, 0
    x, y, freedom = np.zeros(0), np.zeros(0), -1
    for bed in beds:
        numbers, values = (np.array([row[key] for row in bed]) for key in ("inertial_number", name))
        x, y = np.append(x, numbers - numbers.mean()), np.append(y, values - values.mean())
        freedom += len(bed) - 1
    if freedom < 1:
        return 0.0, 0.0, 0.0, -1
    slope = float(x @ y / (x @ x))
    scatter = math.sqrt(float(((y - slope * x) ** 2).sum()) / freedom)
    return slope, scatter / math.sqrt(float(x @ x)), scatter, freedom
