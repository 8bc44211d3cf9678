"""Motion of the mould: its axis is tilted, then carried round the vertical; the platens stay level.

Every point of the axis moves on a level circle about the apex, in which the axis meets the vertical.  The mould does
not spin about its own axis.  A particle at height z above the apex is carried sideways by (z - apex) tan(angle) in all
directions in turn: simple shear whose direction rotates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lithoform.dem import Motion

__all__ = ["Gyration"]


@dataclass(frozen=True, kw_only=True)
class Gyration:
    """Tilt in a first part of a gyration, towards x, then precession.

    Attributes
    ----------
    angle : float
        Between the axis and the vertical [rad].
    frequency : float
        Gyrations per second [1/s].
    apex : float
        Height of the point in which the axis meets the vertical [m].
    ramp : float
        Time in which the mould is tilted [s].
    """

    angle: float
    frequency: float
    apex: float
    ramp: float

    @property
    def pivot(self) -> tuple[float, float, float]:
        """The apex as a point [m]."""
        return (0.0, 0.0, self.apex)

    @property
    def tilting(self) -> Motion:
        """Of the mould until it is tilted."""
        return Motion(angular_velocity=(0.0, self.angle / self.ramp, 0.0), pivot=self.pivot, nutates=True)

    @property
    def precessing(self) -> Motion:
        """Of the mould once it is tilted."""
        return Motion(angular_velocity=(0.0, 0.0, 2.0 * math.pi * self.frequency), pivot=self.pivot, nutates=True)

    def axis(self, time: float) -> np.ndarray:
        """Unit vector along the axis of the mould, upwards, at a time since the tilt began [s], shape (3,)."""
        angle = self.angle * min(time / self.ramp, 1.0)
        turn = 2.0 * math.pi * self.gyrations(time)
        return np.array([math.sin(angle) * math.cos(turn), math.sin(angle) * math.sin(turn), math.cos(angle)])

    def gyrations(self, time: float) -> float:
        """Made until a time since the tilt began."""
        return max(0.0, time - self.ramp) * self.frequency
