"""Recipes: the 19 parameters of Table 1, the target dimensions, the conditioning, the topology and the seed.

A `Recipe` is frozen and valid from the moment it exists; a particle is nothing but its recipe.  `PARAMETERS`
is the table of symbol, name, unit and range that validation, files, the command line and the documentation
all read.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import numbers
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field
from typing import Any, Final, Literal, get_args

from lithoform.errors import RecipeError
from lithoform.seeds import MAX_SEED

__all__ = ["CHOICES", "PARAMETERS", "Parameter", "Recipe", "find_parameter", "resolve_topology", "suggest"]

Vector = tuple[float, float, float]
SmoothingMethod = Literal["laplacian", "taubin"]
CalibrationFrame = Literal["pca", "aabb", "none"]
CalibrationWeighting = Literal["vertices", "surface", "solid"]
CalibrationFit = Literal["exact", "uniform"]
Topology = Literal["auto", "octahedral", "icosahedral"]


@dataclass(frozen=True)
class Parameter:
    """One row of the parameter table.

    Attributes
    ----------
    name : str
        Field of `Recipe`.
    symbol : str
        The paper's symbol in ASCII, accepted wherever a name is.
    low, high : float
        Range of every component, ends included (Table 7 where the paper gives one).
    unit : str
        "1" for a pure number, "height" for a fraction of the body's extent along z.
    kind : {"number", "integer", "vector"}
    meaning : str
    low_reason : str
        Why values below the range make no sense, for the error message.
    """

    name: str
    symbol: str
    low: float
    high: float
    unit: str
    kind: Literal["number", "integer", "vector"]
    meaning: str
    low_reason: str = ""

    def range_text(self) -> str:
        """The range in words."""
        if math.isinf(self.low) and math.isinf(self.high):
            return "a finite number"
        if math.isinf(self.high):
            return f"at least {self.low:g}"
        return f"{self.low:g} to {self.high:g}"


_INF: Final = math.inf

# Triangles per n^2 and the longest edge of the base solid seen from the centre [rad], of each topology.
_TOPOLOGIES: Final = {"octahedral": (8, math.pi / 2), "icosahedral": (20, math.atan(2.0))}

_MAX_TURN: Final = 60.0
"""Largest turn of the twist from one vertex to the next [deg].  Measured about near axes: plain spheres twisted by
more than 75 degrees an edge cross themselves.  Far axes are stricter; `lithoform.feasibility` tries them."""

PARAMETERS: Final[tuple[Parameter, ...]] = (
    Parameter("base_radius", "r", 1e-6, 5.0, "model unit", "number", "base radius of the sphere, eq. 1",
              "a sphere of radius 0 has no surface"),
    Parameter("perturbation", "k", 0.0, 1.0, "1", "number", "perturbation coefficient (relief amplitude), eq. 1"),
    Parameter("main_scale", "s", 0.0, 3.0, "1", "number", "main scale of the noise domain, eq. 2"),
    Parameter("warp_scale", "s_w", 0.0, 3.0, "1", "number", "scale of the warp field, eq. 2"),
    Parameter("warp_strength", "eta", 0.0, 1.0, "1", "number", "strength of the warp, eq. 2"),
    Parameter("phase_offset", "delta", -6.0, 6.0, "1", "vector", "phase offset of the warp field, eq. 3"),
    Parameter("octaves", "O", 0, 10, "1", "integer", "number of octaves, eq. 5"),
    Parameter("lacunarity", "lambda", 0.0, 3.0, "1", "number", "frequency factor from octave to octave, eq. 5"),
    Parameter("gain", "g", 0.0, 1.0, "1", "number", "amplitude factor from octave to octave, eq. 5"),
    Parameter("fbm_weight", "alpha", 0.0, 2.0, "1", "number", "weight of the fractional Brownian motion, eq. 4"),
    Parameter("ridge_weight", "beta", 0.0, 1.0, "1", "number", "weight of the ridged multifractal, eq. 4"),
    Parameter("chip_weight", "gamma", 0.0, 2.0, "1", "number", "weight of the Worley chips, eq. 4"),
    Parameter("chip_sharpness", "kappa", 0.1, 128.0, "1", "number", "sharpness exponent of the chips, eq. 8"),
    Parameter("layer_amplitude", "A_L", 0.0, 8.0, "1", "number", "amplitude of the layers, eq. 9"),
    Parameter("layer_frequency", "f_L", 0.0, 5.0, "1", "number", "spatial frequency of the layers, eq. 9"),
    Parameter("layer_normal", "n", -_INF, _INF, "1", "vector", "normal of the layers (any length but 0), eq. 9"),
    Parameter("twist_axis", "a", -_INF, _INF, "1", "vector", "axis of the twist (any length but 0), eq. 11"),
    Parameter("twist_point", "p0", -10.0, 10.0, "model unit", "vector", "a point on the twist axis, eq. 11"),
    Parameter("twist_rate", "rho", 0.0, 60.0, "deg/model unit", "number", "twist rate, eq. 11"),
    Parameter("length", "L", 1e-9, 1e6, "m", "number", "target length, eq. 16", "a particle needs an extent"),
    Parameter("width", "W", 1e-9, 1e6, "m", "number", "target width, eq. 16", "a particle needs an extent"),
    Parameter("height", "H", 1e-9, 1e6, "m", "number", "target height, eq. 16", "a particle needs an extent"),
    Parameter("smoothing_iterations", "n_s", 0, 1000, "1", "integer", "smoothing steps, eq. 13"),
    Parameter("smoothing_lambda", "lambda_s", 0.01, 1.0, "1", "number", "step of the smoothing, eq. 13",
              "a step of 0 smooths nothing; use smoothing_iterations = 0"),
    Parameter("smoothing_mu", "mu_s", -1.0, 0.0, "1", "number", "backward step of the Taubin pair"),
    Parameter("flatten_depth", "d_b", 0.0, 0.5, "height", "number", "depth of the cut of the support face"),
    Parameter("flatten_band", "h_b", 0.0, 0.5, "height", "number", "thickness of the blended band, eq. 18"),
    Parameter("triangles", "N_t", 8, 8_000_000, "1", "integer", "number of triangles"),
    Parameter("seed", "seed", 0, MAX_SEED, "1", "integer", "64-bit seed of everything random in the particle"),
)  # fmt: skip

CHOICES: Final[dict[str, tuple[str, ...]]] = {
    "smoothing_method": get_args(SmoothingMethod),
    "calibration_frame": get_args(CalibrationFrame),
    "calibration_weighting": get_args(CalibrationWeighting),
    "calibration_fit": get_args(CalibrationFit),
    "topology": get_args(Topology),
}

_FLAGS: Final = ("calibration_align", "flatten")


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Everything that determines a particle; the defaults are the benchmark of Table 1.

    Lengths L, W, H are metres (SI).  The sphere of eq. 1, the twist axis point and the twist rate live in
    the dimensionless model frame, before the calibration to L x W x H; the twist rate is in degrees per model
    unit, as Table 1 prints it.

    Raises
    ------
    RecipeError
        If a value is outside its range, not finite, or of the wrong shape or kind.

    Examples
    --------
    >>> Recipe(perturbation=0.2, seed=7).octaves
    5
    """

    base_radius: float = 0.5
    perturbation: float = 0.3
    main_scale: float = 1.5
    warp_scale: float = 1.5
    warp_strength: float = 0.5
    phase_offset: Vector = (0.0, 0.0, 0.0)
    octaves: int = 5
    lacunarity: float = 1.5
    gain: float = 0.5
    fbm_weight: float = 0.8
    ridge_weight: float = 0.3
    chip_weight: float = 0.15
    chip_sharpness: float = 0.5
    layer_amplitude: float = 0.15
    layer_frequency: float = 1.0
    layer_normal: Vector = (1.0, 1.0, 1.0)
    twist_axis: Vector = (1.0, 0.0, 1.0)
    twist_point: Vector = (1.0, 0.0, 0.0)
    twist_rate: float = 45.0
    length: float = 2.0
    width: float = 1.5
    height: float = 1.0
    smoothing_iterations: int = 0
    smoothing_method: SmoothingMethod = "laplacian"
    smoothing_lambda: float = 0.5
    smoothing_mu: float = -0.53
    calibration_frame: CalibrationFrame = "pca"
    calibration_weighting: CalibrationWeighting = "vertices"
    calibration_fit: CalibrationFit = "exact"
    calibration_align: bool = True
    flatten: bool = True
    flatten_depth: float = 0.0
    flatten_band: float = 0.05
    topology: Topology = "auto"
    triangles: int = 20_000
    seed: int = field(default=0)

    def __post_init__(self) -> None:
        for parameter in PARAMETERS:
            value = _checked(parameter, getattr(self, parameter.name))
            object.__setattr__(self, parameter.name, value)
        for name, choices in CHOICES.items():
            value = getattr(self, name)
            if value not in choices:
                raise RecipeError(
                    f"{name} must be one of {', '.join(choices)}; got {value!r}.{suggest(value, choices)}"
                )
        for name in _FLAGS:
            if not isinstance(getattr(self, name), bool):
                raise RecipeError(f"{name} must be true or false; got {getattr(self, name)!r}.")
        for name, symbol in (("layer_normal", "n"), ("twist_axis", "a")):
            # The squares are summed after scaling, so that neither tiny nor huge components are lost.
            scale = max(abs(c) for c in getattr(self, name))
            if scale < 1e-150 or scale > 1e150:
                raise RecipeError(f"{name} ({symbol}) must be a direction, a vector of a length neither 0 nor huge; "
                                  f"got {getattr(self, name)}.")  # fmt: skip
        if not self.length >= self.width >= self.height:
            raise RecipeError(
                f"the target dimensions must be in the order L >= W >= H; got {self.length:g}, {self.width:g}, "
                f"{self.height:g} m: write them from the largest to the smallest."
            )
        if self.length > 1000 * self.height:
            raise RecipeError(f"L / H must be at most 1000 (float64 meshes thinner than that are not trustworthy); "
                              f"got {self.length:g} / {self.height:g}.")  # fmt: skip
        if (
            self.smoothing_method == "taubin"
            and self.smoothing_iterations
            and -self.smoothing_mu <= self.smoothing_lambda
        ):
            way_out = (
                f"mu = {-1.06 * self.smoothing_lambda:.3g}"
                if self.smoothing_lambda < 0.94
                else "lambda = 0.5 and mu = -0.53"
            )
            raise RecipeError(
                f"a Taubin pair needs -smoothing_mu > smoothing_lambda, or it shrinks; got mu = {self.smoothing_mu:g} "
                f"and lambda = {self.smoothing_lambda:g}: try {way_out}."
            )

        self._check_twist()

    def _check_twist(self) -> None:
        """Refuse, before any work, a mesh that is too coarse to follow its twist."""
        kind, n = resolve_topology(self.triangles, self.topology)
        per_square, edge = _TOPOLOGIES[kind]
        turn = self.twist_rate * self.base_radius * edge / n
        if turn > _MAX_TURN:
            enough = per_square * math.ceil(n * turn / _MAX_TURN) ** 2
            raise RecipeError(
                f"{self.triangles} triangles cannot follow a twist of {self.twist_rate:g} deg per unit at a base "
                f"radius of {self.base_radius:g}: use at least {enough} triangles, a smaller rate or a smaller radius."
            )

    @property
    def size(self) -> Vector:
        """Target dimensions (L, W, H) [m]."""
        return self.length, self.width, self.height

    def replace(self, **changes: Any) -> Recipe:
        """A copy with some fields changed, validated again; names or symbols, and `size`, are accepted."""
        named = [(find_parameter(name), value, name) for name, value in changes.items() if name != "size"]
        if "size" in changes:
            size = _vector("size", changes["size"])
            named += [(full, value, "size") for full, value in zip(("length", "width", "height"), size, strict=True)]
        fields: dict[str, Any] = {}
        for full, value, name in named:
            if full in fields:
                raise RecipeError(f"{full} is given twice, once as {name!r}; keep one of them.")
            fields[full] = value
        return dataclasses.replace(self, **fields)

    def as_dict(self) -> dict[str, Any]:
        """Field names and values in the order of the fields (plain Python types)."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}


def resolve_topology(triangles: int, topology: str = "auto") -> tuple[str, int]:
    """Kind and subdivision of the sphere that has exactly a number of triangles.

    Parameters
    ----------
    triangles : int
    topology : {"auto", "octahedral", "icosahedral"}
        "auto" takes the kind that meets the count; no count is met by both, since 5/2 is no square.

    Returns
    -------
    kind : str
    n : int
        8 n^2 or 20 n^2 is the count.

    Raises
    ------
    RecipeError
        If the count cannot be met; the message names the nearest that can.
    """
    kinds = list(_TOPOLOGIES) if topology == "auto" else [topology]
    near = set()
    for kind in kinds:
        per_square = _TOPOLOGIES[kind][0]
        n = math.isqrt(triangles // per_square)
        if n >= 1 and per_square * n * n == triangles:
            return kind, n
        near |= {per_square * m * m for m in (n, n + 1) if m >= 1}
    below = max((c for c in near if c < triangles), default=None)
    above = min(c for c in near if c > triangles)
    counts = "8 n^2 or 20 n^2" if topology == "auto" else f"{_TOPOLOGIES[topology][0]} n^2"
    nearest = f"{above}" if below is None else f"{below} and {above}"
    raise RecipeError(f"triangles must be {counts}; got {triangles}: the nearest counts are {nearest}.")


_NAMES: Final = tuple(f.name for f in dataclasses.fields(Recipe))
_SYMBOLS: Final = {p.symbol: p.name for p in PARAMETERS}


def find_parameter(name: str) -> str:
    """Field of `Recipe` that a full name or a symbol of Table 1 means.

    Raises
    ------
    RecipeError
        If there is none; the message names the nearest.
    """
    if name in _NAMES:
        return name
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    raise RecipeError(f"there is no parameter {name!r}.{suggest(name, (*_NAMES, *_SYMBOLS))}")


def suggest(word: Any, known: Iterable[str]) -> str:
    """A sentence that names the nearest known words, with a blank before it; empty if none is near."""
    folded = {k.lower(): k for k in known}
    near = [folded[k] for k in difflib.get_close_matches(str(word).lower(), folded, n=2, cutoff=0.5)]
    return f" Did you mean {' or '.join(near)}?" if near else ""


def _number(parameter: Parameter, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise RecipeError(f"{_label(parameter)} must be a number; got {value!r}.")
    try:
        number = float(value)
    except OverflowError:  # a whole number beyond the range of float64
        number = _INF
    if not math.isfinite(number):
        raise RecipeError(f"{_label(parameter)} must be finite; got {value!r}.")
    if not parameter.low <= number <= parameter.high:
        why = f" ({parameter.low_reason})" if number < parameter.low and parameter.low_reason else ""
        raise RecipeError(f"{_label(parameter)} must be {parameter.range_text()}; got {number:g}{why}.")
    return number


def _checked(parameter: Parameter, value: Any) -> Any:
    if parameter.kind == "number":
        return _number(parameter, value)
    if parameter.kind == "vector":
        vector = _vector(_label(parameter), value)
        return tuple(_number(parameter, c) for c in vector)
    if (
        isinstance(value, bool)
        or not isinstance(value, numbers.Real)
        or (not isinstance(value, numbers.Integral) and not float(value).is_integer())
    ):
        raise RecipeError(f"{_label(parameter)} must be a whole number; got {value!r}.")
    whole = int(value)  # pyright: ignore[reportArgumentType]
    if not parameter.low <= whole <= parameter.high:
        raise RecipeError(f"{_label(parameter)} must be {parameter.low} to {parameter.high}; got {whole}.")
    return whole


def _vector(label: str, value: Any) -> tuple[Any, ...]:
    # A set has no order, a table has names: neither is three numbers.
    if isinstance(value, (str, bytes, numbers.Number, Set, Mapping)) or not isinstance(value, Iterable):
        raise RecipeError(f"{label} must be three numbers; got {value!r}.")
    # .tolist() turns NumPy scalars into the Python numbers that files and hashes are made of.
    vector = tuple(value.tolist() if hasattr(value, "tolist") else value)  # type: ignore[attr-defined]
    if len(vector) != 3:
        raise RecipeError(f"{label} must be three numbers; got {len(vector)}: {vector!r}.")
    return vector


def _label(parameter: Parameter) -> str:
    return parameter.name if parameter.symbol == parameter.name else f"{parameter.name} ({parameter.symbol})"
