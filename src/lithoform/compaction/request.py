"""What is to be compacted, and how."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from lithoform.compaction.protocol import Protocol, find_preset
from lithoform.errors import RecipeError
from lithoform.seeds import MAX_SEED
from lithoform.sidecar import program_version

__all__ = ["Request"]


# Of the options of the command, in SI units.
_MILLI, _KILO = (" mm", 1e-3), (" kPa", 1e3)
_OPTIONAL: Final = frozenset({"mould", "to_height", "count", "pressure", "gyrations", "bed_stiffness_factor"})
_UNITS: Final = {"min_size": _MILLI, "mould": _MILLI, "to_height": _MILLI, "pressure": _KILO}


@dataclass(frozen=True, kw_only=True)
class Request:
    """A specimen and what the compactor does to it.

    Attributes
    ----------
    population : Path
        A database.
    preset : str
        Of the protocol: paper, en12697-31 or aashto-t312.
    gradation, curve : str
        Name of a gradation or a file, and which of its curves: low, mid, high.
    min_size : float
        Least sieve size [m].
    count, mould : int, float or None
        Stones, and diameter of the mould [m]: as `lithoform.compaction.specimen.Plan`.
    select : str or None
        Particles of the database.
    pressure : float or None
        Of the upper platen [Pa]; by default the protocol's.
    gyrations : int or None
        At most; by default those of the protocol.
    to_height : float or None
        At which the run ends, for a mould as wide as the protocol's [m]; by default the protocol's.
    rate_factor : float
        On the rate of gyration.
    stiffness_factor : float
        On Young's modulus of Table 10.
    bed_stiffness_factor : float or None
        The same while the stones fall; by default the one above.
    seed : int
        Of the choice of the particles, their sizes, order, places and attitudes.
    vtk : bool
        Whether to write a series for ParaView.
    """

    population: Path
    preset: str = "paper"
    gradation: str = "AC-13"
    curve: str = "mid"
    min_size: float = 4.75e-3
    count: int | None = 300
    mould: float | None = None
    select: str | None = None
    pressure: float | None = None
    gyrations: int | None = None
    to_height: float | None = None
    rate_factor: float = 20.0
    stiffness_factor: float = 0.1
    bed_stiffness_factor: float | None = None
    seed: int = 0
    vtk: bool = True

    def __post_init__(self) -> None:
        if not (isinstance(self.seed, int) and 0 <= self.seed <= MAX_SEED):
            raise RecipeError(f"the seed must be a whole number from 0 to {MAX_SEED}; got {self.seed!r}.")
        if self.curve not in ("low", "mid", "high"):
            raise RecipeError(f"expected a curve of low, mid or high; got {self.curve!r}.")
        limits = {"min_size": (1e-5, 1.0), "mould": (1e-3, 10.0), "to_height": (1e-4, 10.0),
                  "rate_factor": (1e-3, 1e3), "stiffness_factor": (1e-3, 1.0), "bed_stiffness_factor": (1e-3, 1.0),
                  "count": (10, 1_000_000), "pressure": (1.0, 1e8), "gyrations": (1, 10_000)}  # fmt: skip
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if value is None and name in _OPTIONAL:
                continue
            if not (isinstance(value, (int, float)) and math.isfinite(value) and low <= value <= high):
                unit, scale = _UNITS.get(name, ("", 1.0))
                got = f"{value / scale:g}" if isinstance(value, (int, float)) else repr(value)
                raise RecipeError(
                    f"expected --{name.replace('_', '-')} from {low / scale:g} to {high / scale:g}{unit}; got {got}."
                )

    @property
    def protocol(self) -> Protocol:
        """The preset with what is asked for otherwise."""
        changes = {"pressure": self.pressure, "gyrations": self.gyrations, "height": self.to_height}
        return find_preset(self.preset).changed(**changes)

    def settings(self) -> dict[str, Any]:
        """Plain values, with the version of the program."""
        told = {**dataclasses.asdict(self), "population": str(self.population)}
        return {"lithoform": program_version(), **told}
