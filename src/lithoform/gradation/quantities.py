"""Lengths, masses and containers as people write them: "2.36mm", "1.5 kg", "cylinder:150mm:63.5mm"."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Final

from lithoform.errors import RecipeError

__all__ = ["METRES", "parse_container_volume", "parse_length", "parse_mass"]

_QUANTITY: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?)\s*([a-zµμ]*)\s*", re.IGNORECASE)

# Decimals, so that 2.36 mm is the float that is nearest to 0.00236 m, as a reader of the standard would write it.
METRES: Final = {unit: Decimal(metres) for unit, metres in (
    ("m", "1"), ("cm", "0.01"), ("mm", "0.001"), ("um", "1e-6"), ("in", "0.0254"), ("µm", "1e-6"), ("μm", "1e-6"),
)}  # fmt: skip
"""Units of length."""

_KILOGRAMS: Final = {"kg": Decimal(1), "g": Decimal("0.001"), "t": Decimal(1000)}


def parse_length(text: str, default_unit: str = "mm") -> float:
    """Length [m] of a text such as "2.36mm", "75 um", "0.5 in" or, in the default unit, "2.36".

    Raises
    ------
    RecipeError
        If it is no positive number, or the unit is none of m, cm, mm, um, in.
    """
    return _parsed(text, METRES, default_unit, "length such as 2.36mm")


def parse_mass(text: str) -> float:
    """Mass [kg] of a text such as "1.5kg", "800 g", "0.2t" or "1.5", which is in kilograms.

    Raises
    ------
    RecipeError
        If it is no positive number, or the unit is none of kg, g, t.
    """
    return _parsed(text, _KILOGRAMS, "kg", "mass such as 1.5kg")


def parse_container_volume(text: str) -> float:
    """Volume [m^3] of a container: "cylinder:DIAMETER:HEIGHT" or "box:X:Y:Z", lengths as `parse_length` takes them.

    Raises
    ------
    RecipeError
        If it is neither, or a length is not valid.
    """
    kind, *lengths = str(text).split(":")
    if {"cylinder": 2, "box": 3}.get(kind.strip().lower()) != len(lengths):
        raise RecipeError(f"expected a container such as cylinder:150mm:63.5mm or box:1m:1m:0.5m; got {text!r}.")
    sides = [parse_length(length) for length in lengths]
    return math.pi / 4.0 * sides[0] ** 2 * sides[1] if len(sides) == 2 else math.prod(sides)


def _parsed(text: str, units: Mapping[str, Decimal], default_unit: str, wanted: str) -> float:
    match = _QUANTITY.fullmatch(str(text))
    if match is None:
        raise RecipeError(f"expected a {wanted}; got {text!r}.")
    unit = match[2].lower() or default_unit
    if unit not in units:
        known = ", ".join(name for name in units if name.isascii())
        raise RecipeError(f"expected a unit of {known}; got {unit!r} in {text!r}.")
    value = float(Decimal(match[1]) * units[unit])
    if not 0.0 < value < math.inf:
        raise RecipeError(f"expected a positive, finite {wanted.split()[0]}; got {text!r}.")
    return value
