"""What is to be packed, and how: each value is tried before anything is read."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Final

from lithoform.errors import RecipeError
from lithoform.seeds import MAX_SEED
from lithoform.sidecar import program_version

__all__ = ["Request", "path_of"]

# Numbers above 0, and the ranges in which they are of use. Gravity: from that of a boulder in space to a centrifuge.
_RANGES: Final = {
    "gravity": (1e-6, 1e5),
    "stiffness_factor": (0.0, 1.0),
    "dt": (0.0, math.inf),
    "until": (0.0, math.inf),
}


@dataclass(frozen=True, kw_only=True)
class Request:
    """What is to be packed, and how.

    Attributes
    ----------
    sources : tuple of Path
        Mesh files, folders of them, databases.
    container : str
        As `lithoform.packing.container.Container.parse`.
    count : int or None
        Stones; by default each that the sources hold once.
    seed : int
        Of the choice, the order, the places and the attitudes of the stones.
    unit : str
        Of files that do not tell theirs.
    select : str or None
        Particles of a database.
    gravity : float
        Downwards [m/s^2], 1e-6 to 1e5.
    stiffness_factor : float
        On Young's modulus of Table 10, above 0 and at most 1.
    dt, until : float or None
        Time step and latest end [s]; by default 0.06 of the Rayleigh time, and when the stones are at rest.
    vtk : bool
        Whether to write a series for ParaView.

    Raises
    ------
    RecipeError
        If a value is of another kind, or out of range.
    """

    sources: tuple[Path, ...]
    container: str
    count: int | None = None
    seed: int = 0
    unit: str = "mm"
    select: str | None = None
    gravity: float = 9.81
    stiffness_factor: float = 0.01
    dt: float | None = None
    until: float | None = None
    vtk: bool = True

    def __post_init__(self) -> None:
        given: Any = self.sources
        if isinstance(given, (str, bytes, os.PathLike)) or not isinstance(given, Sequence):
            raise RecipeError(f"expected sources as a tuple of paths, such as (Path('stones'),); got {given!r}.")
        object.__setattr__(self, "sources", tuple(path_of("a source", path) for path in given))
        for name, wanted in (("container", "cylinder:150mm:200mm"), ("unit", "mm")):
            if not isinstance(getattr(self, name), str):
                raise RecipeError(f"expected a {name} such as {wanted!r}; got {getattr(self, name)!r}.")
        if not isinstance(self.select, (str, type(None))):
            raise RecipeError(f"expected --select as a condition in SQL; got {self.select!r}.")
        if self.count is not None:
            object.__setattr__(self, "count", _whole("--count", self.count))
        object.__setattr__(self, "seed", _whole("a seed", self.seed))
        if not 0 <= self.seed <= MAX_SEED:
            raise RecipeError(f"the seed must be 0 to {MAX_SEED}; got {self.seed}.")
        for name, (least, most) in _RANGES.items():
            if getattr(self, name) is not None or name in ("gravity", "stiffness_factor"):
                object.__setattr__(self, name, _number(f"--{name.replace('_', '-')}", getattr(self, name), least, most))
        if not isinstance(self.vtk, bool):
            raise RecipeError(f"expected vtk to be True or False; got {self.vtk!r}.")

    def settings(self) -> dict[str, Any]:
        """Plain values, with the version of the program."""
        told = {**dataclasses.asdict(self), "sources": [str(path) for path in self.sources]}
        return {"lithoform": program_version(), **told}


def path_of(what: str, given: Any) -> Path:
    """A path that a caller gave, as one; a `RecipeError` if it is none."""
    if not isinstance(given, (str, os.PathLike)) or "\0" in os.fsdecode(given):
        raise RecipeError(f"expected {what} to be the path of a file or a folder; got {given!r}.")
    return Path(os.fsdecode(given))


def _whole(what: str, given: Any) -> int:
    if not isinstance(given, Integral) or isinstance(given, bool):
        raise RecipeError(f"expected {what} to be a whole number; got {given!r}.")
    return int(given)


def _number(what: str, given: Any, least: float, most: float) -> float:
    """A number above 0, from the least to the most."""
    is_number = isinstance(given, Real) and not isinstance(given, bool)
    try:
        value = float(given) if is_number else math.nan
    except OverflowError:  # a whole number beyond all floats
        value = math.inf
    if math.isfinite(value) and value > 0.0 and least <= value <= most:
        return value
    wanted = f"from {least:g} to {most:g}" if least else "above 0"
    if not least and most < math.inf:
        wanted += f" and at most {most:g}"
    raise RecipeError(f"expected {what} {wanted}; got {f'{value:g}' if is_number else repr(given)}.")
