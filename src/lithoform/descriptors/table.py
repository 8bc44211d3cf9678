"""DESCRIPTORS: the table of every measure, with its symbol, definition, unit, range and source."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from lithoform.descriptors import form
from lithoform.descriptors.body import Body

__all__ = ["DESCRIPTORS", "FOUR", "STANDARD", "Descriptor"]

Convention = Literal["box", "scale"]


@dataclass(frozen=True)
class Descriptor:
    """One row of the table of measures.

    Attributes
    ----------
    name, symbol, definition : str
        The name is the key of results and files.
    power : int
        The unit is the unit of length to this power; 0 for a plain number, or for a word.
    low, high : float
        Range of the values; `low` and `high` themselves may be reached by idealised bodies only.
    citation : str
    function : callable
        Body to value: a float, or a word for `zingg_class`.
    conventions : tuple of str
        Conventions that the value depends on: "box", "scale".
    is_standard : bool
        Whether it is measured unless others are asked for; the rest is slower, or of rarer use.
    """

    name: str
    symbol: str
    definition: str
    power: int
    low: float
    high: float
    citation: str
    function: Callable[[Body], float | str]
    conventions: tuple[Convention, ...] = ()
    is_standard: bool = True


def _published(body: Body) -> float:
    from lithoform.descriptors.published import roundness_published

    return roundness_published(body.mesh)


_INF: Final = math.inf
_BOX: Final = ("box",)
_ZINGG: Final = "Zingg 1935"
_TABLE_2: Final = "Table 2 of the paper"
_ROWS: Final = (
    # The four of the paper.
    Descriptor("roundness", "R", "curvature radius of corners and edges over that of the largest inscribed sphere",
               0, 0.0, 1.0, "Wadell 1932; eq. 22 of the paper", lambda b: b.roundness.value, ("scale",)),
    Descriptor("boxiness", "B", "volume over that of the box, V / (l_a l_b l_c)",
               0, 0.0, 1.0, _TABLE_2, lambda b: form.boxiness(b.mass.volume, *b.dimensions), _BOX),
    Descriptor("solidity", "S_3D", "volume over that of the convex hull",
               0, 0.0, 1.0, _TABLE_2, lambda b: b.mass.volume / b.hull.volume),
    Descriptor("true_sphericity", "TS", "surface of the ball of equal volume over the surface",
               0, 0.0, 1.0, "Wadell 1932; Table 2 of the paper",
               lambda b: form.true_sphericity(b.mass.volume, b.mass.area)),
    # Size.
    Descriptor("volume", "V", "volume enclosed by the mesh",
               3, 0.0, _INF, "divergence theorem", lambda b: b.mass.volume),
    Descriptor("surface_area", "S", "area of the mesh",
               2, 0.0, _INF, "sum over the triangles", lambda b: b.mass.area),
    Descriptor("equivalent_diameter", "d_V", "diameter of the ball of equal volume",
               1, 0.0, _INF, "ISO 9276-6", lambda b: form.equivalent_diameter(b.mass.volume)),
    Descriptor("inscribed_radius", "r_in", "radius of the largest inscribed sphere",
               1, 0.0, _INF, "Wadell 1932", lambda b: b.inscribed.radius),
    Descriptor("length", "l_c", "longest extent of the box",
               1, 0.0, _INF, _TABLE_2, lambda b: b.dimensions[0], _BOX),
    Descriptor("width", "l_b", "middle extent of the box",
               1, 0.0, _INF, _TABLE_2, lambda b: b.dimensions[1], _BOX),
    Descriptor("thickness", "l_a", "shortest extent of the box",
               1, 0.0, _INF, _TABLE_2, lambda b: b.dimensions[2], _BOX),
    # Form.
    Descriptor("elongation", "EI", "l_b / l_c",
               0, 0.0, 1.0, _ZINGG, lambda b: form.elongation(*b.dimensions[:2]), _BOX),
    Descriptor("flatness", "FI", "l_a / l_b",
               0, 0.0, 1.0, _ZINGG, lambda b: form.flatness(*b.dimensions[1:]), _BOX),
    Descriptor("zingg_class", "", "cube, plate, column or blade, by EI and FI at 2/3",
               0, -_INF, _INF, _ZINGG, lambda b: form.zingg_class(*b.dimensions), _BOX),
    Descriptor("krumbein_sphericity", "psi_K", "(l_a l_b / l_c^2)^(1/3)",
               0, 0.0, 1.0, "Krumbein 1941", lambda b: form.krumbein_sphericity(*b.dimensions), _BOX),
    Descriptor("maximum_projection_sphericity", "psi_p", "(l_a^2 / (l_b l_c))^(1/3)",
               0, 0.0, 1.0, "Sneed and Folk 1958", lambda b: form.maximum_projection_sphericity(*b.dimensions), _BOX),
    Descriptor("sneed_folk_form", "F", "(l_c - l_b) / (l_c - l_a): 0 oblate, 1 prolate",
               0, 0.0, 1.0, "Sneed and Folk 1958", lambda b: form.sneed_folk_form(*b.dimensions), _BOX),
    Descriptor("surface_convexity", "C_S", "area of the convex hull over the surface area; above 1 for a U or a hook",
               0, 0.0, _INF, "ISO 9276-6, in three dimensions", lambda b: b.hull.area / b.mass.area),
    Descriptor("corner_fraction", "A_c / S", "share of the surface that curves more than the inscribed sphere by 5 %",
               0, 0.0, 1.0, "defined with the roundness", lambda b: b.roundness.corner_fraction, ("scale",)),
    # On request.
    Descriptor("minimum_box_length", "L_m", "longest extent of the box of least volume",
               1, 0.0, _INF, "O'Rourke 1985", lambda b: float(b.minimum_box.extents[0]), is_standard=False),
    Descriptor("minimum_box_width", "W_m", "middle extent of the box of least volume",
               1, 0.0, _INF, "O'Rourke 1985", lambda b: float(b.minimum_box.extents[1]), is_standard=False),
    Descriptor("minimum_box_thickness", "H_m", "shortest extent of the box of least volume",
               1, 0.0, _INF, "O'Rourke 1985", lambda b: float(b.minimum_box.extents[2]), is_standard=False),
    Descriptor("minimum_box_boxiness", "B_m", "volume over that of the box of least volume",
               0, 0.0, 1.0, "O'Rourke 1985", lambda b: b.mass.volume / b.minimum_box.volume, is_standard=False),
    Descriptor("caliper_length", "L_c", "greatest distance of two points",
               1, 0.0, _INF, "ASTM D4791", lambda b: b.caliper.length, is_standard=False),
    Descriptor("caliper_width", "W_c", "greatest extent across the caliper length",
               1, 0.0, _INF, "ASTM D4791", lambda b: b.caliper.width, is_standard=False),
    Descriptor("caliper_thickness", "T_c", "extent across caliper length and width",
               1, 0.0, _INF, "ASTM D4791", lambda b: b.caliper.thickness, is_standard=False),
    Descriptor("chord_width", "W_ch", "longest chord across the caliper length",
               1, 0.0, _INF, "NIST's tables of particles", lambda b: b.caliper.chord_width, is_standard=False),
    Descriptor("chord_thickness", "T_ch", "longest chord across caliper length and chord width",
               1, 0.0, _INF, "NIST's tables of particles", lambda b: b.caliper.chord_thickness, is_standard=False),
    Descriptor("minimum_width", "w_min", "least distance of two parallel planes that hold the body",
               1, 0.0, _INF, "EN 933-4", lambda b: b.caliper.minimum_width, is_standard=False),
    Descriptor("sieve_size", "d_s", "side of the smallest square opening that the body passes",
               1, 0.0, _INF, "EN 933-1", lambda b: b.sieve_size, is_standard=False),
    Descriptor("hull_volume", "V_h", "volume of the convex hull",
               3, 0.0, _INF, _TABLE_2, lambda b: b.hull.volume, is_standard=False),
    Descriptor("hull_area", "S_h", "area of the convex hull",
               2, 0.0, _INF, _TABLE_2, lambda b: b.hull.area, is_standard=False),
    Descriptor("inertia_1", "I_1", "least principal moment of inertia at unit density",
               5, 0.0, _INF, "mechanics", lambda b: b.principal_inertia[0], is_standard=False),
    Descriptor("inertia_2", "I_2", "middle principal moment of inertia at unit density",
               5, 0.0, _INF, "mechanics", lambda b: b.principal_inertia[1], is_standard=False),
    Descriptor("inertia_3", "I_3", "greatest principal moment of inertia at unit density",
               5, 0.0, _INF, "mechanics", lambda b: b.principal_inertia[2], is_standard=False),
    Descriptor("fractal_dimension", "D", "3 - H, with H the growth of the relief with the window; 2 if smooth",
               0, 2.0, 3.0, "Malinverno 1990", lambda b: b.fractal.value, is_standard=False),
    Descriptor("hurst_exponent", "H", "growth of the relief with the window over which it is measured",
               0, -_INF, _INF, "Malinverno 1990", lambda b: b.fractal.hurst, is_standard=False),
    Descriptor("roundness_published", "R_pub", "the paper's own program, which measures the mesh: for comparison only",
               0, 0.0, _INF, "eq. 22 of the paper as its program has it", _published, is_standard=False),
)  # fmt: skip

DESCRIPTORS: Final[dict[str, Descriptor]] = {row.name: row for row in _ROWS}
"""Every measure by its name."""

FOUR: Final = ("roundness", "boxiness", "solidity", "true_sphericity")
"""The four descriptors of the paper."""

STANDARD: Final = tuple(row.name for row in _ROWS if row.is_standard)
"""What `measure` computes unless other names are given."""
