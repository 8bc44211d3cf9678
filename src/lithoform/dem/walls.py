"""Walls: planes and the inside of cylinders, carried along a prescribed motion or pressed on with a force."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from lithoform.errors import SceneError

__all__ = ["Cylinder", "Motion", "Plane", "Servo", "Wall"]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Prescribed rigid motion of a wall.

    Attributes
    ----------
    velocity : tuple of float
        [m/s].
    angular_velocity : tuple of float
        With which the wall is carried about the pivot [rad/s].
    pivot : tuple of float
        [m]; it moves with the velocity.
    nutates : bool
        The wall is carried round without turning about its own normal or axis, as the mould of a gyratory compactor;
        else it turns like a body.
    """

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    nutates: bool = False

    def __post_init__(self) -> None:
        for name in ("velocity", "angular_velocity", "pivot"):
            object.__setattr__(self, name, _vector(getattr(self, name), name.replace("_", " ")))


@dataclass(frozen=True, kw_only=True)
class Servo:
    """A plane that moves along its normal until the blocks push back with a force.

    The plane has a mass and a damping, d speed / dt = (force - push of the blocks) / mass - speed / time, positive
    into the domain, and the speed is limited.

    Attributes
    ----------
    force : float
        With which the plane presses [N].
    mass : float
        [kg].
    time : float
        Of the damping [s]; infinite for none.
    max_speed : float
        [m/s].
    """

    force: float
    mass: float
    time: float = math.inf
    max_speed: float = math.inf

    def __post_init__(self) -> None:
        if not math.isfinite(self.force):
            raise SceneError(f"expected a finite force of a servo, got {self.force!r}.")
        for name in ("mass", "time", "max_speed"):
            if not getattr(self, name) > 0.0:
                raise SceneError(
                    f"expected a positive {name.replace('_', ' ')} of a servo, got {getattr(self, name)!r}."
                )
        if not math.isfinite(self.mass):
            raise SceneError(f"expected a finite mass of a servo, got {self.mass!r}.")


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A plane; the blocks are on the side to which its normal points.

    Attributes
    ----------
    point : tuple of float
        A point of it at the start [m].
    normal : tuple of float
        Into the domain; made a unit vector.
    material : int
        Number of the material in the model.
    motion : Motion or Servo
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    material: int = 0
    motion: Motion | Servo = field(default_factory=Motion)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector(self.point, "point of a plane"))
        object.__setattr__(self, "normal", _unit(self.normal, "normal of a plane"))

    @property
    def direction(self) -> tuple[float, float, float]:
        """The normal."""
        return self.normal


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """The inside of an endless cylinder.

    Attributes
    ----------
    point : tuple of float
        A point of the axis at the start [m].
    axis : tuple of float
        Made a unit vector.
    radius : float
        [m].
    material : int
        Number of the material in the model.
    motion : Motion
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    radius: float
    material: int = 0
    motion: Motion = field(default_factory=Motion)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector(self.point, "point of a cylinder's axis"))
        object.__setattr__(self, "axis", _unit(self.axis, "axis of a cylinder"))
        if not (math.isfinite(self.radius) and self.radius > 0.0):
            raise SceneError(f"expected a positive radius of a cylinder, got {self.radius!r}.")
        if not isinstance(self.motion, Motion):
            raise SceneError("expected a prescribed motion of a cylinder; only planes can be pressed with a force.")

    @property
    def direction(self) -> tuple[float, float, float]:
        """The axis."""
        return self.axis


Wall = Plane | Cylinder


def moved(wall: Wall, motion: Motion | Servo) -> Wall:
    """The same wall with another motion."""
    return replace(wall, motion=motion)  # pyright: ignore[reportArgumentType]


def _vector(value: object, what: str) -> tuple[float, float, float]:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"expected three finite numbers for the {what}, got {value!r}.")
    x, y, z = (float(c) for c in array)
    return x, y, z


def _unit(value: object, what: str) -> tuple[float, float, float]:
    x, y, z = _vector(value, what)
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise SceneError(f"expected a direction for the {what}, got {value!r}.")
    return x / length, y / length, z / length
