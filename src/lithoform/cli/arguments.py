"""Kinds of arguments that the commands share."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter, Token

__all__ = ["Flag", "Json", "Whole", "words"]

Flag = Annotated[bool, Parameter(negative="")]
Json = Annotated[bool, Parameter(name="--json", negative="")]


def _whole(_: Any, tokens: Sequence[Token]) -> int:
    """A whole number and nothing that would have to be rounded to one."""
    text = tokens[0].value
    if not re.fullmatch(r"[+-]?[0-9]+", text):
        raise ValueError(f"expected a whole number in digits; got {text!r}.")
    if len(text) > 40:
        raise ValueError(f"expected a whole number of at most 39 digits; got {len(text)}.")
    return int(text)


Whole = Annotated[int, Parameter(converter=_whole)]


def words(given: list[str] | None) -> list[str]:
    """Words separated by commas, by spaces, or given one an option."""
    return [word for text in given or [] for word in text.split(",") if word]
