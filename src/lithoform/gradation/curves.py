"""Named sieve curves, and curves from a file.

A sieve curve gives the percentage of the mass that passes each opening.  Between two openings it is interpolated
linearly in the logarithm of the size, so that the mass is spread evenly over ln d.

References
----------
JTG F40-2004. Technical specifications for construction of highway asphalt pavements (China), tables 5.3.2.
ASTM C33/C33M. Standard specification for concrete aggregates, tables 1 (fine) and 3 (coarse).
DIN 1045-2:2008, annex L. Grading curves of concrete aggregates of 16 and 31.5 mm (regular curves A, B, C).
Fuller, W. B. & Thompson, S. E. (1907). The laws of proportioning concrete. Trans. ASCE 59, 67-143.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import FileFormatError, RecipeError
from lithoform.gradation.quantities import METRES, parse_length
from lithoform.parameters import suggest

__all__ = [
    "GRADATIONS",
    "SAME_OPENING",
    "Curve",
    "Gradation",
    "find_gradation",
    "fuller",
    "read_gradation",
]

Curve = Literal["low", "mid", "high"]

_FINEST, _COARSEST, _STEP = 1e-9, 1e3, 1e-4

SAME_OPENING: Final = 1e-9
"""Relative distance within which two openings are one: 2.36 / 1000 is not the float that 0.00236 is."""


@dataclass(frozen=True)
class Gradation:
    """Limits of a sieve curve; a single curve has equal limits.

    Attributes
    ----------
    name : str
    openings : tuple of float, k values
        Of the sieves [m], from the coarsest to the finest.
    passing_low, passing_high : tuple of float, k values
        Least and greatest percentage of the mass that passes; 100 at the coarsest sieve.
    citation : str

    Raises
    ------
    RecipeError
        If the openings do not fall, or a curve is not from 100 downwards within 0 to 100, or the limits cross.
    """

    name: str
    openings: tuple[float, ...]
    passing_low: tuple[float, ...]
    passing_high: tuple[float, ...]
    citation: str = ""

    def __post_init__(self) -> None:
        for field in ("openings", "passing_low", "passing_high"):
            object.__setattr__(self, field, tuple(float(x) for x in getattr(self, field)))
        label, k = f"the gradation {self.name!r}", len(self.openings)
        if k < 2 or len(self.passing_low) != k or len(self.passing_high) != k:
            raise RecipeError(f"{label} needs two sieves or more and one value a sieve; got {k} openings, "
                              f"{len(self.passing_low)} and {len(self.passing_high)} values.")  # fmt: skip
        if not (self.openings[-1] > 0.0 and self.openings[0] < math.inf and np.all(np.diff(self.openings) < 0.0)):
            raise RecipeError(f"{label} needs positive openings in metres from the coarsest to the finest, each once; "
                              f"got {self.openings}.")  # fmt: skip
        if not (self.openings[-1] >= _FINEST and self.openings[0] <= _COARSEST
                and all(b <= (1.0 - _STEP) * a for a, b in pairwise(self.openings))):  # fmt: skip
            raise RecipeError(f"{label} needs openings of {_FINEST:g} to {_COARSEST:g} m, each finer than the last by "
                              f"{100.0 * _STEP:g} % at least; got {self.openings}.")  # fmt: skip
        for curve in (self.passing_low, self.passing_high):
            if not (curve[-1] >= 0.0 and curve[0] <= 100.0 and np.all(np.diff(curve) <= 0.0)):
                raise RecipeError(f"{label} needs percentages of 0 to 100 that fall with the opening; got {curve}.")
            if curve[0] != 100.0:
                raise RecipeError(f"{label} lets only {curve[0]:g} % through its coarsest sieve: add the sieve that "
                                  "everything passes, or the coarsest particles have no size.")  # fmt: skip
        if any(low > high for low, high in zip(self.passing_low, self.passing_high, strict=True)):
            raise RecipeError(f"{label} has a lower limit above its upper; exchange the two columns.")

    @property
    def mid(self) -> tuple[float, ...]:
        """Middle of the limits [percent]."""
        return tuple(0.5 * (low + high) for low, high in zip(self.passing_low, self.passing_high, strict=True))

    def curve(self, curve: Curve = "mid") -> tuple[float, ...]:
        """Lower limit, middle or upper limit [percent]."""
        if curve not in ("low", "mid", "high"):
            raise RecipeError(f"expected a curve of low, mid, high; got {curve!r}.")
        return {"low": self.passing_low, "mid": self.mid, "high": self.passing_high}[curve]

    def passing(self, sizes: ArrayLike, curve: Curve = "mid") -> np.ndarray:
        """Percent passing sizes [m] of any shape, linear in the logarithm of the size between the sieves.

        Raises
        ------
        RecipeError
            If a size is below the finest opening, where a gradation says nothing; above the coarsest all passes.
        """
        d = np.asarray(sizes, dtype=np.float64)
        if not np.all(d >= self.openings[-1] * (1.0 - SAME_OPENING)):
            raise RecipeError(f"expected sizes of at least {1e3 * self.openings[-1]:g} mm, the finest sieve of "
                              f"{self.name!r}; got {1e3 * float(np.min(d)):g} mm.")  # fmt: skip
        return np.interp(np.log(d), np.log(self.openings[::-1]), self.curve(curve)[::-1])


_JTG: Final = "JTG F40-2004, limits transcribed"
_C33: Final = "ASTM C33/C33M, limits transcribed"
_DIN: Final = "DIN 1045-2:2008 annex L, curve transcribed"
_AC13_MM: Final = "16 13.2 9.5 4.75 2.36 1.18 0.6 0.3 0.15 0.075"
_DIN16_MM: Final = "16 8 4 2 1 0.5 0.25"
_R20_3_MM: Final = "125 90 63 45 31.5 22.4 16 11.2 8 5.6 4 2.8 2 1.4 1 0.71 0.5 0.355 0.25 0.18 0.125 0.09 0.063"

# Openings in millimetres, then percent passing: one number where the limits are equal.
_TABLE: Final = (
    ("AC-10", _AC13_MM.removeprefix("16 "), "100 90-100 45-75 30-58 20-44 13-32 9-23 6-16 4-8", _JTG),
    ("AC-13", _AC13_MM, "100 90-100 68-85 38-68 24-50 15-38 10-28 7-20 5-15 4-8", _JTG),
    ("AC-16", "19 " + _AC13_MM, "100 90-100 76-92 60-80 34-62 20-48 13-36 9-26 7-18 5-14 4-8", _JTG),
    ("SMA-13", _AC13_MM, "100 90-100 50-75 20-34 15-26 14-24 12-20 10-16 9-15 8-12", _JTG),
    ("OGFC-13", _AC13_MM, "100 90-100 60-80 12-30 10-22 6-18 4-15 3-12 3-8 2-6", _JTG),
    ("ASTM C33 #57", "37.5 25 12.5 4.75 2.36", "100 95-100 25-60 0-10 0-5", _C33),
    ("ASTM C33 #67", "25 19 9.5 4.75 2.36", "100 90-100 20-55 0-10 0-5", _C33),
    ("ASTM C33 fine", "9.5 4.75 2.36 1.18 0.6 0.3 0.15", "100 95-100 80-100 50-85 25-60 5-30 0-10", _C33),
    ("DIN A16", _DIN16_MM, "100 60 36 21 12 8 3", _DIN),
    ("DIN B16", _DIN16_MM, "100 76 56 42 32 20 8", _DIN),
    ("DIN C16", _DIN16_MM, "100 88 74 62 49 34 18", _DIN),
    ("DIN AB16", _DIN16_MM, "100 60-76 36-56 21-42 12-32 8-20 3-8", f"{_DIN}: the zone between A16 and B16"),
    ("DIN A32", "31.5 " + _DIN16_MM, "100 62 38 23 14 8 5 2", _DIN),
    ("DIN B32", "31.5 " + _DIN16_MM, "100 80 62 47 37 28 18 8", _DIN),
    ("DIN C32", "31.5 " + _DIN16_MM, "100 89 77 65 53 42 29 15", _DIN),
)  # fmt: skip


def _transcribed(name: str, openings: str, limits: str, citation: str) -> Gradation:
    pairs = [[float(p) for p in limit.split("-")] for limit in limits.split()]
    metres = tuple(parse_length(x) for x in openings.split())
    return Gradation(name, metres, tuple(p[0] for p in pairs), tuple(p[-1] for p in pairs), citation)


def fuller(largest: float, exponent: float = 0.5) -> Gradation:
    """Fuller's curve p = 100 (d / D)^n on the sieves of ISO 565, series R20/3, from 0.063 mm up to D [m].

    Fuller & Thompson (1907) have n = 0.5; the chart of the US Federal Highway Administration has 0.45.

    Raises
    ------
    RecipeError
        If D is not 0.09 to 250 mm, or n not above 0 and up to 2.
    """
    if not (9e-5 <= largest <= 0.25 and 0.0 < exponent <= 2.0):
        raise RecipeError(f"expected a largest size of 0.09 to 250 mm and an exponent above 0 and up to 2; got "
                          f"{1e3 * largest:g} mm and {exponent:g}.")  # fmt: skip
    finer = (parse_length(x) for x in _R20_3_MM.split())
    openings = (float(largest), *(x for x in finer if x < largest * (1.0 - SAME_OPENING)))
    passing = tuple(100.0 * (x / largest) ** exponent for x in openings)
    power = "" if exponent == 0.5 else f"^{exponent:g}"
    return Gradation(f"Fuller-{1e3 * largest:g}{power}", openings, passing, passing, "Fuller & Thompson (1907)")


GRADATIONS: Final[dict[str, Gradation]] = {row[0]: _transcribed(*row) for row in _TABLE} | {
    curve.name: curve for curve in (fuller(0.016), fuller(0.0315))
}
"""Named gradations.  The limits are transcribed from the standards: a contract needs the standard itself."""


def find_gradation(name: str) -> Gradation:
    """Gradation of a name of `GRADATIONS` in any case, or "Fuller-D" with D in millimetres.

    Raises
    ------
    RecipeError
        If there is none; the message names the nearest.
    """
    folded = {key.lower(): key for key in GRADATIONS}
    word = str(name).strip().lower()
    if word in folded:
        return GRADATIONS[folded[word]]
    if word.startswith("fuller-"):
        return fuller(parse_length(word.removeprefix("fuller-")))
    raise RecipeError(f"expected a gradation of {', '.join(GRADATIONS)}, or Fuller-D; got {name!r}."
                      f"{suggest(name, GRADATIONS)}")  # fmt: skip


def read_gradation(path: str | Path) -> Gradation:
    """Gradation of a CSV file with the columns size_mm and passing, or size_mm, low and high.

    The lines stand in any order; "size_um", "size_in" and so on give other units; a line that begins with "#" is a
    comment.  The name is that of the file.

    Raises
    ------
    FileFormatError
        If the file cannot be read, a column is missing, or a line or the curve is not valid.
    """
    file = Path(path)
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise FileFormatError(f"the gradation {file} cannot be read: {reason}.") from error
    kept = [(n, line) for n, line in enumerate(lines, 1) if line.strip(" ,") and not line.lstrip().startswith("#")]
    header = [cell.strip(' "').lower() for cell in kept[0][1].split(",")] if kept else []
    sizes = [c for c in header if c.startswith("size_") and c.removeprefix("size_") in METRES]
    limits = ["passing"] if "passing" in header else ["low", "high"]
    if len(sizes) != 1 or any(header.count(c) != 1 for c in limits):
        raise FileFormatError(f"{file}: expected the columns size_mm and passing, or size_mm, low and high, in the "
                              f"first line; got {', '.join(header) or 'nothing'}.")  # fmt: skip
    rows = []
    for number, line in kept[1:]:
        try:
            row = dict(zip(header, (cell.strip(' "') for cell in line.split(",")), strict=True))
            rows.append((parse_length(row[sizes[0]], sizes[0].removeprefix("size_")), *(float(row[c]) for c in limits)))
        except ValueError:
            raise FileFormatError(f"{file}, line {number}: expected {len(header)} numbers, a positive size and "
                                  f"percentages, with commas between; got {line.strip()!r}.") from None  # fmt: skip
    rows.sort(reverse=True)
    columns = [tuple(row[i] for row in rows) for i in range(1 + len(limits))]
    try:
        return Gradation(file.stem, columns[0], columns[1], columns[-1], f"file {file.name}")
    except RecipeError as error:
        raise FileFormatError(f"{file}: {error}") from error
