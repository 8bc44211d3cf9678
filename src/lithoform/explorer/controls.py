"""Controls of the studio: what is beside each field of a recipe, in groups, with the range and scale of its slider."""

from __future__ import annotations

from typing import Any, Final, Literal

from lithoform.axes import EXTRA_AXES, TABLE_7
from lithoform.explorer.state import MAX_TRIANGLES, PRESET_NAMES
from lithoform.parameters import CHOICES, PARAMETERS, Recipe

__all__ = ["GROUPS", "controls"]

Kind = Literal["slider", "counts", "vector", "choice", "flag", "seed"]

GROUPS: Final[dict[str, tuple[str, ...]]] = {
    "Field": ("base_radius", "perturbation", "main_scale", "warp_scale", "warp_strength", "phase_offset", "octaves",
              "lacunarity", "gain"),
    "Weights": ("fbm_weight", "ridge_weight"),
    "Chips and layers": ("chip_weight", "chip_sharpness", "layer_amplitude", "layer_frequency", "layer_normal"),
    "Twist": ("twist_rate", "twist_axis", "twist_point"),
    "Dimensions": ("length", "width", "height", "calibration_frame", "calibration_weighting", "calibration_fit",
                   "calibration_align"),
    "Smoothing": ("smoothing_iterations", "smoothing_method", "smoothing_lambda", "smoothing_mu"),
    "Flattening": ("flatten", "flatten_depth", "flatten_band"),
    "Mesh": ("triangles", "topology", "seed"),
}  # fmt: skip
"""Fields of a recipe by group, in the order of the page; every field is there once."""

_PARAMETERS: Final = {parameter.name: parameter for parameter in PARAMETERS}
_SCALES: Final = {axis.name: axis.scale for axis in (*TABLE_7, *EXTRA_AXES)}
_SIZES: Final = ("length", "width", "height")
_SIZE_RANGE: Final = (0.001, 10.0)  # [m]; the number field takes any length of a recipe
_COUNTS: Final = tuple(
    sorted({8 * n * n for n in (4, 8, 16, 25, 32, 50, 64, 80, 100, 125, 150)} | {20 * n * n for n in (8, 16, 32, 100)})
)
_MEANINGS: Final = {
    "smoothing_method": "way of smoothing, eq. 13",
    "calibration_frame": "axes of the calibration, eq. 14",
    "calibration_weighting": "what the principal axes are taken of",
    "calibration_fit": "all three dimensions met, or scaled alike",
    "calibration_align": "turn the stone onto its axes",
    "flatten": "cut a support face, eq. 18",
    "topology": "sphere that the mesh begins with",
}


def controls() -> dict[str, Any]:
    """What a page builds its controls from: groups of controls, the benchmark's presets and the limits.

    Returns
    -------
    dict
        "groups": a list of {"name", "controls"}; each control has name, symbol, unit, meaning, kind, and of a slider
        low, high, scale ("linear", "log", "square_root"), whole.
    """
    groups = [{"name": name, "controls": [_control(field) for field in fields]} for name, fields in GROUPS.items()]
    return {"groups": groups, "presets": list(PRESET_NAMES), "sizes": list(_SIZES), "max_triangles": MAX_TRIANGLES}


def _control(name: str) -> dict[str, Any]:
    kind = _kind(name)
    parameter = _PARAMETERS.get(name)
    if parameter is None:
        told = {"symbol": "", "unit": "", "meaning": _MEANINGS[name]}
    else:
        told = {"symbol": parameter.symbol, "unit": parameter.unit, "meaning": parameter.meaning}
    control: dict[str, Any] = {"name": name, "kind": kind, **told}
    if kind == "choice":
        control["choices"] = list(CHOICES[name])
    elif kind == "counts":
        control["counts"] = list(_COUNTS)
    elif kind == "slider" and parameter is not None:
        is_size = name in _SIZES
        low, high = _SIZE_RANGE if is_size else (parameter.low, parameter.high)
        scale = "log" if is_size else _SCALES.get(name, "linear")
        if name == "base_radius":
            low = 0.05
        control |= {"low": low, "high": high, "scale": scale, "whole": parameter.kind == "integer"}
    return control


def _kind(name: str) -> Kind:
    special: dict[str, Kind] = {"triangles": "counts", "seed": "seed"}
    if name in special:
        return special[name]
    if name in CHOICES:
        return "choice"
    value = getattr(Recipe(), name)
    return "flag" if isinstance(value, bool) else "vector" if isinstance(value, tuple) else "slider"
