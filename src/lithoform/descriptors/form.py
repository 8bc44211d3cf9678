"""Measures of form from three principal dimensions, volume and surface: closed formulas on plain numbers.

Dimensions are named as in the paper: l_a <= l_b <= l_c, thickness, width and length.
"""

from __future__ import annotations

import math

from lithoform.presets import shape_class_of

__all__ = [
    "boxiness", "elongation", "equivalent_diameter", "flatness", "krumbein_sphericity", "maximum_projection_sphericity",
    "sneed_folk_form", "true_sphericity", "zingg_class",
]  # fmt: skip


def boxiness(volume: float, length: float, width: float, thickness: float) -> float:
    """Volume over that of the box, B = V / (l_a l_b l_c) (Table 2 of the paper); 1 for a box, pi / 6 for a sphere."""
    return volume / (length * width * thickness)


def true_sphericity(volume: float, area: float) -> float:
    """Surface of the ball of equal volume over the surface, TS = pi^(1/3) (6 V)^(2/3) / S (Wadell 1932)."""
    return math.pi ** (1 / 3) * (6.0 * volume) ** (2 / 3) / area


def equivalent_diameter(volume: float) -> float:
    """Diameter of the ball of equal volume, (6 V / pi)^(1/3)."""
    return (6.0 * volume / math.pi) ** (1 / 3)


def elongation(length: float, width: float) -> float:
    """Elongation index EI = l_b / l_c (Zingg 1935); small for columns."""
    return width / length


def flatness(width: float, thickness: float) -> float:
    """Flatness index FI = l_a / l_b (Zingg 1935); small for plates."""
    return thickness / width


def zingg_class(length: float, width: float, thickness: float) -> str:
    """Class by EI and FI at 2/3: cube (both above), plate (FI below), column (EI below), blade (both below)."""
    return shape_class_of((length, width, thickness))


def krumbein_sphericity(length: float, width: float, thickness: float) -> float:
    """Intercept sphericity (l_a l_b / l_c^2)^(1/3) (Krumbein 1941): ellipsoid over its circumscribed ball."""
    return (thickness * width / length**2) ** (1 / 3)


def maximum_projection_sphericity(length: float, width: float, thickness: float) -> float:
    """Maximum projection sphericity (l_a^2 / (l_b l_c))^(1/3) (Sneed and Folk 1958): of settling grains."""
    return (thickness**2 / (width * length)) ** (1 / 3)


def sneed_folk_form(length: float, width: float, thickness: float) -> float:
    """Form ratio (l_c - l_b) / (l_c - l_a) (Sneed and Folk 1958): 0 oblate, 1 prolate; 0.5 where all are equal."""
    spread = length - thickness
    return (length - width) / spread if spread > 1e-9 * length else 0.5
