"""Population recipes: how the parameters and the dimensions of a population scatter, and together with what.

A particle of the population is drawn in three steps: independent standard normal numbers from the seed, normal scores
with the correlation matrix R (a Gaussian copula), and each score put on its margin.  A dimension's margin is a table
of quantiles; a parameter's is a normal distribution of the parameter itself, its logarithm or its square root.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from statistics import NormalDist
from typing import Any, Final, get_args

from lithoform.axes import Scale
from lithoform.errors import FileFormatError, RecipeError
from lithoform.parameters import PARAMETERS, Recipe, find_parameter, suggest
from lithoform.recipe_io import from_dict, read_table, to_toml
from lithoform.seeds import MAX_SEED, Role, derive, uniform

__all__ = [
    "DIMENSIONS", "PopulationRecipe", "Spread", "is_population", "parse_population_recipe", "read_population_recipe",
]  # fmt: skip

DIMENSIONS: Final = ("length", "elongation", "flatness")
"""L [m], EI = W / L and FI = H / W, in the order of the first rows of the correlation matrix."""

_LEAST_RATIO: Final = 0.04
"""Least EI and FI: L / H stays below the 1000 that a recipe allows."""

_FORMAT: Final = 1
_NORMAL: Final = NormalDist()
_PARAMETERS: Final = {p.name: p for p in PARAMETERS}
_DRAWN: Final = ("length", "width", "height", "seed")
_SYMMETRY: Final = 1e-9  # what a file rounded to 10 digits may be off


@dataclass(frozen=True)
class Spread:
    """Margin of a parameter: normal on a scale, clipped.

    Attributes
    ----------
    name : str
        Field of `Recipe` that is a number.
    scale : {"linear", "log", "square_root"}
        What is normal: the value, its logarithm or its square root.
    median : float
        In the parameter's unit.
    deviation : float
        Standard deviation on the scale, from 0.
    low, high : float
        What is drawn beyond them is set to them; within the range of the parameter.

    Raises
    ------
    RecipeError
        If the parameter is unknown or is no number, or a value is out of its range.
    """

    name: str
    scale: Scale
    median: float
    deviation: float
    low: float
    high: float

    def __post_init__(self) -> None:
        parameter = _PARAMETERS.get(self.name)
        if parameter is None or parameter.kind == "vector" or self.name in _DRAWN:
            raise RecipeError(f"expected a texture parameter that is a number; got {self.name!r}."
                              f"{suggest(self.name, _PARAMETERS)}")  # fmt: skip
        if self.scale not in get_args(Scale):
            raise RecipeError(f"{self.name}: the scale must be one of {', '.join(get_args(Scale))}; got {self.scale!r}."
                              f"{suggest(self.scale, get_args(Scale))}")  # fmt: skip
        for what in ("median", "deviation", "low", "high"):
            object.__setattr__(self, what, _finite(getattr(self, what), f"{self.name}: {what}"))
        if self.deviation < 0.0:
            raise RecipeError(f"{self.name}: the deviation must be at least 0; got {self.deviation:g}.")
        if not parameter.low <= self.low <= self.median <= self.high <= parameter.high:
            raise RecipeError(
                f"{self.name}: expected {parameter.low:g} <= low <= median <= high <= {parameter.high:g}; got low "
                f"{self.low:g}, median {self.median:g}, high {self.high:g}."
            )
        if (self.scale == "log" and self.low <= 0.0) or (self.scale == "square_root" and self.low < 0.0):
            raise RecipeError(f"{self.name}: the scale {self.scale} needs a low above 0; got {self.low:g}.")

    def value(self, score: float) -> float | int:
        """Value at a normal score, clipped, and whole where the parameter is."""
        if self.scale == "log":
            # Beyond these exponents the clip decides; math.exp would overflow.
            drawn = math.exp(min(max(math.log(self.median) + self.deviation * score, -700.0), 700.0))
        elif self.scale == "square_root":
            drawn = max(math.sqrt(self.median) + self.deviation * score, 0.0) ** 2
        else:
            drawn = self.median + self.deviation * score
        clipped = min(max(drawn, self.low), self.high)
        return int(math.floor(clipped + 0.5)) if _PARAMETERS[self.name].kind == "integer" else clipped


@dataclass(frozen=True, kw_only=True)
class PopulationRecipe:
    """A population of particles, of which each follows from a seed and its number.

    Attributes
    ----------
    base : Recipe
        What all particles share; of what is drawn it keeps the medians, and the benchmark's dimensions.
    spreads : tuple of Spread
        Margins of the parameters that vary; may be empty.
    length, elongation, flatness : tuple of float
        Quantiles of L [m], EI and FI at the probabilities (i - 1/2) / n, in rising order; between them the margin is
        linear, beyond them it ends.  EI and FI are 0.04 to 1.
    correlation : tuple of tuples of float, shape (3 + k, 3 + k)
        Of the normal scores: length, elongation, flatness, then the k spreads.
    note : str
        Where the population comes from, in words.

    Raises
    ------
    RecipeError
        If a value is out of its range, the matrix is no correlation, or the ends of the ranges make no recipe.
    """

    length: tuple[float, ...]
    elongation: tuple[float, ...]
    flatness: tuple[float, ...]
    spreads: tuple[Spread, ...] = ()
    correlation: tuple[tuple[float, ...], ...] = ()
    base: Recipe = field(default_factory=Recipe)
    note: str = ""

    def __post_init__(self) -> None:
        for name in DIMENSIONS:
            limits = (1e-9, 1e6) if name == "length" else (_LEAST_RATIO, 1.0)
            object.__setattr__(self, name, _quantiles(name, getattr(self, name), limits))
        names = [spread.name for spread in self.spreads]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise RecipeError(f"{min(twice)} is spread twice; keep one of them.")
        size = len(DIMENSIONS) + len(names)
        matrix = self.correlation or tuple(tuple(float(i == j) for j in range(size)) for i in range(size))
        object.__setattr__(self, "correlation", _correlation(matrix, size))
        object.__setattr__(self, "_factor", _cholesky(self.correlation))
        for end in ("low", "high"):
            changes = {s.name: _whole(s.name, getattr(s, end)) for s in self.spreads}
            try:
                self.base.replace(**changes)
            except RecipeError as error:
                raise RecipeError(f"with every parameter at its {end} end there is no recipe: {error}") from error
        # What is drawn has one value here, so that equal populations compare equal.
        middle = {s.name: s.value(0.0) for s in self.spreads}
        object.__setattr__(self, "base", self.base.replace(size=Recipe().size, seed=0, **middle))

    @property
    def names(self) -> tuple[str, ...]:
        """What varies, in the order of the correlation matrix."""
        return (*DIMENSIONS, *(spread.name for spread in self.spreads))

    def recipe(self, number: int, seed: int) -> Recipe:
        """Recipe of a particle of the population.

        Parameters
        ----------
        number : int
            From 1; a particle depends on no other.
        seed : int
            Of the run, 0 to 2^64 - 1.

        Returns
        -------
        Recipe
            Its seed is `lithoform.presets.particle_seed` of the run's.

        Raises
        ------
        RecipeError
            If the number or the seed is out of its range.
        """
        for what, value, least in (("number", number, 1), ("seed", seed, 0)):
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= MAX_SEED:
                raise RecipeError(f"the {what} must be a whole number of {least} to {MAX_SEED}; got {value!r}.")
        own = derive(seed, Role.PARTICLE, number)
        # Half a step above 0, where the normal distribution has no quantile.
        normal = [_NORMAL.inv_cdf(uniform(own, Role.POPULATION, i) + 2.0**-54) for i in range(len(self.names))]
        return self.recipe_at(self.scores(normal), own)

    def scores(self, normal: Sequence[float]) -> list[float]:
        """Correlated normal scores of independent ones; both shape (3 + k,)."""
        factor: tuple[tuple[float, ...], ...] = self._factor  # type: ignore[attr-defined]
        return [math.fsum(a * b for a, b in zip(row, normal, strict=False)) for row in factor]

    def recipe_at(self, scores: Sequence[float], seed: int) -> Recipe:
        """Recipe at normal scores on the margins, shape (3 + k,), with a particle's own seed."""
        tables = (self.length, self.elongation, self.flatness)
        length, elongation, flatness = (_at(table, score) for table, score in zip(tables, scores, strict=False))
        varied = {s.name: s.value(z) for s, z in zip(self.spreads, scores[len(DIMENSIONS) :], strict=True)}
        width = length * elongation
        return self.base.replace(size=(length, width, width * flatness), seed=seed, **varied)

    def to_toml(self) -> str:
        """TOML text, which `read_population_recipe` takes back exactly."""
        shared = {**self.base.as_dict()}
        skipped = {*_DRAWN, *(s.name for s in self.spreads)}
        base = [line for line in to_toml(self.base).splitlines() if line.split(" ")[0] in shared.keys() - skipped]
        lines = [
            "# lithoform population recipe", f"format = {_FORMAT}", f"note = {_text(self.note)}", "",
            "[dimensions]  # quantiles at the probabilities (i - 1/2) / n: L [m], EI = W / L, FI = H / W",
            *(f"{name} = {_row(getattr(self, name))}" for name in DIMENSIONS), "",
        ]  # fmt: skip
        for s in self.spreads:
            parameter = _PARAMETERS[s.name]
            lines += [f"[parameters.{s.name}]  # {parameter.symbol} [{parameter.unit}]: {parameter.meaning}",
                      f'scale = "{s.scale}"  # on which it is normal, with this median and deviation',
                      *(f"{what} = {getattr(s, what)!r}" for what in ("median", "deviation", "low", "high")),
                      ""]  # fmt: skip
        lines += ["[correlation]  # of the normal scores", f"names = [{', '.join(map(_text, self.names))}]",
                  "matrix = [", *(f"  {_row(row)}," for row in self.correlation), "]", "",
                  "[base]  # what all particles share", *base, ""]  # fmt: skip
        return "\n".join(lines)


def read_population_recipe(path: str | Path) -> PopulationRecipe:
    """Population recipe of a TOML file.

    Raises
    ------
    FileFormatError
        If the file is missing, is not TOML, or is no population recipe.
    RecipeError
        If what it says is not valid; the message begins with the file.
    """
    values, kind = read_table(path)
    if not is_population(values, kind):
        raise FileFormatError(
            f"expected a population recipe in TOML with a table [dimensions]; {path} has none: make one with "
            "lithoform match."
        )
    try:
        return _from_tables(values)
    except RecipeError as error:
        raise RecipeError(f"{path}: {error}") from error


def is_population(values: Any, kind: str) -> bool:
    """Whether what `lithoform.recipe_io.read_table` returned is, or wants to be, a population recipe."""
    return kind == "TOML" and isinstance(values, dict) and "dimensions" in values


@lru_cache(maxsize=8)
def parse_population_recipe(text: str) -> PopulationRecipe:
    """Population recipe of a text that `PopulationRecipe.to_toml` made; a `RecipeError` if it is not valid."""
    return _from_tables(tomllib.loads(text))


def _from_tables(values: Mapping[str, Any]) -> PopulationRecipe:
    _known(values, ("format", "note", "dimensions", "parameters", "correlation", "base"), "the file")
    if values.get("format", _FORMAT) != _FORMAT:
        raise RecipeError(f"expected format {_FORMAT}; got {values['format']!r}: use the version that wrote it.")
    tables = {name: _table(values, name) for name in ("dimensions", "parameters", "correlation", "base")}
    _known(tables["dimensions"], DIMENSIONS, "[dimensions]", whole=True)
    spreads = []
    for name, entries in tables["parameters"].items():
        keys = ("scale", "median", "deviation", "low", "high")
        if not isinstance(entries, dict):
            raise RecipeError(f"expected a table [parameters.{name}]; got {entries!r}.")
        _known(entries, keys, f"[parameters.{name}]", whole=True)
        spreads.append(Spread(find_parameter(name), *(entries[key] for key in keys)))
    for name in tables["base"]:
        if find_parameter(name) in (*_DRAWN, *(s.name for s in spreads)):
            raise RecipeError(f"{name} is drawn for each particle; leave it out of [base].")
    names = (*DIMENSIONS, *(s.name for s in spreads))
    _known(tables["correlation"], ("names", "matrix"), "[correlation]", whole=bool(tables["correlation"]))
    told = tables["correlation"].get("names", names)
    if list(names) != told and names != told:
        raise RecipeError(f"expected the names of [correlation] to be {', '.join(names)}; got {told!r}: the rows are "
                          "the dimensions, then the parameters in the order of the file.")  # fmt: skip
    note = values.get("note", "")
    if not isinstance(note, str):
        raise RecipeError(f"the note must be a text; got {note!r}.")
    return PopulationRecipe(
        **tables["dimensions"],
        spreads=tuple(spreads),
        correlation=tables["correlation"].get("matrix", ()),
        base=from_dict(dict(tables["base"])),
        note=note,
    )


def _table(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = values.get(name, {})
    if not isinstance(found, dict):
        raise RecipeError(f"expected a table [{name}]; got {found!r}.")
    return found


def _known(values: Mapping[str, Any], names: Sequence[str], where: str, *, whole: bool = False) -> None:
    for name in values:
        if name not in names:
            raise RecipeError(f"{where} holds {name!r}, which means nothing there.{suggest(name, names)}")
    for name in names if whole else ():
        if name not in values:
            raise RecipeError(f"{where} lacks {name!r}; give it.")


def _finite(value: Any, label: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise RecipeError(f"{label} must be a finite number; got {value!r}.")
    return float(value)


def _quantiles(name: str, values: Any, limits: tuple[float, float]) -> tuple[float, ...]:
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        raise RecipeError(f"{name} must be a list of quantiles; got {values!r}.")
    table = tuple(_finite(value, name) for value in values)
    if not table or list(table) != sorted(table) or not limits[0] <= table[0] <= table[-1] <= limits[1]:
        raise RecipeError(f"{name} must be quantiles in rising order from {limits[0]:g} to {limits[1]:g}; got "
                          f"{list(table[:4])}{' ...' if len(table) > 4 else ''}.")  # fmt: skip
    return table


def _correlation(matrix: Any, size: int) -> tuple[tuple[float, ...], ...]:
    try:
        rows = tuple(tuple(_finite(value, "a correlation") for value in row) for row in matrix)
    except TypeError:
        raise RecipeError("the correlation must be rows of numbers.") from None
    if len(rows) != size or any(len(row) != size for row in rows):
        raise RecipeError(f"expected a correlation matrix of {size} rows of {size}; got rows of "
                          f"{[len(row) for row in rows]}.")  # fmt: skip
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            if abs(value - rows[j][i]) > _SYMMETRY or (i == j and abs(value - 1.0) > _SYMMETRY) or abs(value) > 1.0:
                raise RecipeError(f"a correlation matrix is symmetric with ones on the diagonal and -1 to 1 beside it; "
                                  f"row {i + 1}, column {j + 1} is {value:g}.")  # fmt: skip
    return rows


def _cholesky(matrix: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Lower factor of a correlation matrix, with correctly rounded sums: the same bytes everywhere."""
    factor: list[list[float]] = []
    for i, row in enumerate(matrix):
        new: list[float] = []
        for j in range(i):
            inner = math.fsum(a * b for a, b in zip(new, factor[j], strict=False))
            new.append((row[j] - inner) / factor[j][j])
        rest = row[i] - math.fsum(a * a for a in new)
        if rest <= 1e-12:
            raise RecipeError(f"the correlation matrix is not positive definite at row {i + 1}: no population has such "
                              "correlations; bring them nearer to 0.")  # fmt: skip
        factor.append([*new, math.sqrt(rest)])
    return tuple(map(tuple, factor))


def _at(table: tuple[float, ...], score: float) -> float:
    """Quantile at a normal score: linear between the probabilities (i - 1/2) / n."""
    place = _NORMAL.cdf(score) * len(table) - 0.5
    low = min(max(math.floor(place), 0), len(table) - 1)
    high = min(low + 1, len(table) - 1)
    return table[low] + min(max(place - low, 0.0), 1.0) * (table[high] - table[low])


def _whole(name: str, value: float) -> float | int:
    return int(math.floor(value + 0.5)) if _PARAMETERS[name].kind == "integer" else value


def _row(values: Sequence[float]) -> str:
    return f"[{', '.join(repr(value) for value in values)}]"


def _text(text: str) -> str:
    import json

    return json.dumps(text)
