"""Recipes as text: TOML files, JSON sidecars, and NAME=VALUE settings of the command line."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from lithoform.errors import FileFormatError, RecipeError
from lithoform.parameters import PARAMETERS, Recipe, find_parameter

__all__ = ["from_dict", "parse_setting", "parse_settings", "read_recipe", "read_table", "to_toml"]


def from_dict(values: dict[str, Any]) -> Recipe:
    """Recipe from names or symbols and values; what is not named keeps its benchmark value.

    Raises
    ------
    RecipeError
        If a name is unknown (the message names the nearest), given twice, or a value is not valid.
    """
    if not isinstance(values, dict):
        raise RecipeError(f"a recipe must be a table of names and values; got {type(values).__name__}.")
    return Recipe().replace(**values)


def read_recipe(path: str | Path) -> Recipe:
    """Recipe of a TOML file, or of the JSON sidecar that every generated particle has.

    Parameters
    ----------
    path : str or Path
        A ``.json`` file, or one that begins with a brace, is read as a sidecar (or as a bare table of a recipe),
        any other as TOML.

    Returns
    -------
    Recipe

    Raises
    ------
    FileFormatError
        If the file is missing or is not TOML or JSON.
    RecipeError
        If what it says is not a valid recipe.
    """
    file = Path(path)
    values, _ = read_table(file)
    if isinstance(values, dict) and isinstance(values.get("recipe"), dict):
        values = values["recipe"]
    if isinstance(values, dict) and "scan" in values:
        raise RecipeError(f"{file} is the sidecar of a scan, which no recipe makes; name that of a generated particle.")
    try:
        return from_dict(values)
    except RecipeError as error:
        raise RecipeError(f"{file}: {error}") from error
    except RecursionError:
        raise RecipeError(f"{file}: its tables or lists are nested too deeply for a recipe.") from None


def read_table(path: str | Path) -> tuple[Any, Literal["JSON", "TOML"]]:
    """Content of a TOML or JSON file, and which of the two it is; errors as in `read_recipe`."""
    file = Path(path)
    try:
        # Some editors begin a file with a byte order mark, which neither TOML nor JSON allows.
        text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise FileFormatError(f"the recipe {file} cannot be read: {reason}.") from error
    kind = "JSON" if file.suffix.lower() == ".json" or text.lstrip().startswith("{") else "TOML"
    try:
        return (json.loads(text) if kind == "JSON" else tomllib.loads(text)), kind
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        raise FileFormatError(f"the recipe {file} is not valid {kind}: {error}.") from error
    except RecursionError:
        raise FileFormatError(f"the recipe {file} is nested too deeply; a recipe is names and values.") from None
    except ValueError as error:
        # Python reads whole numbers of up to 4300 digits.
        raise FileFormatError(f"the recipe {file} holds a number of thousands of digits; shorten it.") from error


def to_toml(recipe: Recipe) -> str:
    """TOML text of a recipe, every field with its symbol, unit and meaning; `read_recipe` takes it back exactly."""
    comments = {p.name: f"  # {p.symbol} [{p.unit}]: {p.meaning}" for p in PARAMETERS}
    lines = [f"{name} = {_toml(value)}{comments.get(name, '')}" for name, value in recipe.as_dict().items()]
    return "\n".join(["# lithoform recipe", *lines, ""])


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(v) for v in value)}]"
    if isinstance(value, int) and value >= 2**63:
        # TOML promises 64-bit signed integers only; larger seeds are read by Python all the same.
        return str(value)
    return repr(value)


def parse_settings(settings: Iterable[str]) -> dict[str, Any]:
    """Fields and values of several NAME=VALUE texts; the last one of a name counts."""
    return dict(parse_setting(text) for text in settings)


def parse_setting(text: str) -> tuple[str, Any]:
    """Field and value of NAME=VALUE, where NAME is a full name or the symbol of Table 1 in ASCII.

    Vectors are three numbers separated by commas; one number stands for three equal ones.

    Raises
    ------
    RecipeError
        If the text has another form or the name is unknown.

    Examples
    --------
    >>> parse_setting("s_w=1.2")
    ('warp_scale', 1.2)
    """
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise RecipeError(f"expected NAME=VALUE, such as k=0.2; got {text!r}.")
    field = find_parameter(name.strip())
    default = getattr(Recipe(), field)
    value = value.strip()
    if isinstance(default, bool):
        if value.lower() not in ("true", "false"):
            raise RecipeError(f"{field} must be true or false; got {value!r}.")
        return field, value.lower() == "true"
    if isinstance(default, str):
        return field, value
    if isinstance(default, tuple):
        components = [_to_number(field, part) for part in value.strip("[]()").split(",")]
        return field, tuple(components * 3 if len(components) == 1 else components)
    return field, _to_number(field, value)


def _to_number(field: str, text: str) -> float | int:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)  # also a whole number too long for int: infinite, which no parameter may be
    except ValueError:
        raise RecipeError(f"{field} must be a number; got {text.strip()!r}.") from None
