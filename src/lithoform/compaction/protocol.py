"""Protocols of the gyratory compactor: pressure, angle, rate, and when a specimen is done.

References
----------
EN 12697-31:2019. Bituminous mixtures - Test methods - Part 31: Specimen preparation by gyratory compactor.
AASHTO T 312-19. Preparing and determining the density of asphalt mixture specimens by means of the Superpave gyratory
compactor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

from lithoform.errors import RecipeError

__all__ = ["PRESETS", "Protocol", "find_preset"]


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """What the compactor does.

    The platens are rigid, parallel and level, and do not give way.  The angle between the normal of the platens and the
    axis of the mould, the internal one, is therefore the same as that between the axis and the vertical, the external
    one; in a real machine, which yields, the external one is larger by some hundredths of a degree.

    Attributes
    ----------
    name, meaning : str
    pressure : float
        Of the upper platen [Pa].
    angle : float
        Between the axis of the mould and the vertical [degrees].
    angle_is : {"external", "internal"}
        Which of both the source of the angle means.
    rate : float
        Gyrations per minute.
    diameter : float
        Of the mould [m].
    loose_height, height : float
        Of the specimen before the gyrations, under pressure, and at their end, in a mould of that diameter [m].
    gyrations : int
        At most.
    """

    name: str
    meaning: str
    pressure: float
    angle: float
    angle_is: str
    rate: float
    diameter: float
    loose_height: float
    height: float
    gyrations: int

    def __post_init__(self) -> None:
        for name, most in (("pressure", math.inf), ("angle", 10.0), ("rate", math.inf), ("diameter", math.inf),
                           ("loose_height", math.inf), ("height", math.inf)):  # fmt: skip
            value = getattr(self, name)
            if not (math.isfinite(value) and 0.0 < value <= most):
                limit = f" and at most {most:g}" if most < math.inf else ""
                raise RecipeError(
                    f"expected a {name.replace('_', ' ')} of the compactor above 0{limit}; got {value:g}."
                )
        if self.height >= self.loose_height:
            raise RecipeError(
                f"expected a height below {1e3 * self.loose_height:g} mm, which the specimen has before the gyrations "
                f"(in a mould of {1e3 * self.diameter:g} mm); got {1e3 * self.height:g} mm."
            )
        if self.gyrations < 1:
            raise RecipeError(f"expected at least one gyration; got {self.gyrations}.")

    @property
    def shear(self) -> float:
        """Amplitude of the shear strain that the tilt makes: the tangent of the angle."""
        return math.tan(math.radians(self.angle))

    def changed(self, **changes: Any) -> Protocol:
        """The same protocol with other numbers; None leaves one as it is."""
        return replace(self, **{name: value for name, value in changes.items() if value is not None})

    def angles(self) -> str:
        """Both angles in words."""
        return (
            f"{self.angle:g} deg external and internal (rigid, level platens; its source means the {self.angle_is} one)"
        )


PRESETS: Final = {preset.name: preset for preset in (
    Protocol(
        name="paper", meaning="the paper's section 6: 0.82 deg external, from 70 to 63.5 mm", pressure=600e3,
        angle=0.82, angle_is="external", rate=30.0, diameter=0.150, loose_height=0.070, height=0.0635, gyrations=100,
    ),
    Protocol(
        name="en12697-31", meaning="EN 12697-31: 0.82 deg", pressure=600e3, angle=0.82, angle_is="internal", rate=30.0,
        diameter=0.150, loose_height=0.070, height=0.0635, gyrations=100,
    ),
    Protocol(
        name="aashto-t312", meaning="AASHTO T 312: 1.16 deg internal", pressure=600e3, angle=1.16, angle_is="internal",
        rate=30.0, diameter=0.150, loose_height=0.070, height=0.0635, gyrations=100,
    ),
)}  # fmt: skip
"""Protocols by name. Heights are those of the paper's specimen: neither standard prescribes one of 70 mm."""


def find_preset(name: str) -> Protocol:
    """The protocol of a name.

    Raises
    ------
    RecipeError
        If there is none.
    """
    if name not in PRESETS:
        raise RecipeError(f"expected a preset of {', '.join(PRESETS)}; got {name!r}.")
    return PRESETS[name]
