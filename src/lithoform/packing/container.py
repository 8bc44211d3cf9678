"""The container of a packing: an upright cylinder or box, open at the top, whose walls reach up without end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lithoform.dem import Cylinder, Plane
from lithoform.dem.container import Container as Enclosure
from lithoform.errors import RecipeError, SceneError
from lithoform.gradation.quantities import parse_container_volume, parse_length

__all__ = ["Container", "millimetres"]

# Wider or higher is no container of stones [m].
_LARGEST = 1000.0
_FLOOR = Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Container:
    """A container that stands on z = 0 with its axis along z.

    Its walls reach up without end, as with a funnel on it: stones that end above the rim stay, and are told.

    Attributes
    ----------
    sides : tuple of float
        Diameter, or width along x and y [m].
    height : float
        Of the rim [m].
    """

    sides: tuple[float, ...]
    height: float

    def __post_init__(self) -> None:
        sides = self.sides if isinstance(self.sides, (tuple, list)) else ()
        numbers = all(isinstance(x, (int, float)) and 0.0 < x <= _LARGEST for x in (*sides, self.height))
        if len(sides) not in (1, 2) or not numbers:
            raise SceneError(
                f"expected a diameter or two widths, and a height, all above 0 and at most {_LARGEST:g} m; got "
                f"{self.sides!r} and {self.height!r}: take Container((0.15,), 0.2), for instance."
            )

    @classmethod
    def parse(cls, text: str) -> Container:
        """The container of a text: cylinder:DIAMETER:HEIGHT or box:X:Y:HEIGHT, in millimetres unless told.

        Raises
        ------
        RecipeError
            If it is neither, or a length is not valid.
        """
        text = str(text)
        lengths = [parse_length(length) for length in text.split(":")[1:]] if text.count(":") in (2, 3) else []
        if max(lengths, default=0.0) > _LARGEST:
            raise RecipeError(f"expected a container of at most {_LARGEST:g} m; got {text!r}.")
        parse_container_volume(text)
        return cls(tuple(lengths[:-1]), lengths[-1])

    @property
    def kind(self) -> str:
        """Cylinder or box."""
        return "cylinder" if len(self.sides) == 1 else "box"

    @property
    def area(self) -> float:
        """Of the cross-section [m^2]."""
        return math.pi / 4.0 * self.sides[0] ** 2 if len(self.sides) == 1 else self.sides[0] * self.sides[1]

    @property
    def volume(self) -> float:
        """Up to the rim [m^3]."""
        return self.area * self.height

    @property
    def walls(self) -> tuple[Plane | Cylinder, ...]:
        """The floor first, then the sides; all of the material 0."""
        if len(self.sides) == 1:
            return (_FLOOR, Cylinder(radius=0.5 * self.sides[0]))
        planes = [_FLOOR]
        for axis, side in enumerate(self.sides):
            for sign in (-1.0, 1.0):
                point, normal = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
                point[axis], normal[axis] = 0.5 * sign * side, -sign
                planes.append(Plane(point=tuple(point), normal=tuple(normal)))  # pyright: ignore[reportArgumentType]
        return tuple(planes)

    @property
    def enclosure(self) -> Enclosure:
        """The sides as observers take them, by the numbers of `walls`."""
        return Enclosure(sides=1) if len(self.sides) == 1 else Enclosure(sides=((1, 2), (3, 4)))

    def places(self, radius: float, count: int, rng: np.random.Generator) -> np.ndarray:
        """Random places of the centre of a ball, even over where it can be.

        Parameters
        ----------
        radius : float
            Of the ball [m].
        count : int
        rng : numpy.random.Generator

        Returns
        -------
        numpy.ndarray, shape (count, 2)
            x and y [m].
        """
        if len(self.sides) == 1:
            far = (0.5 * self.sides[0] - radius) * np.sqrt(rng.random(count))
            angle = 2.0 * math.pi * rng.random(count)
            return np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)
        return (rng.random((count, 2)) - 0.5) * (np.array(self.sides) - 2.0 * radius)

    def text(self) -> str:
        """As a person would write it, in millimetres."""
        across = " x ".join(map(millimetres, self.sides))
        return f"{self.kind} {across} mm wide and {millimetres(self.height)} mm high"


def millimetres(length: float) -> str:
    """A length [m] in millimetres, with four digits or to the millimetre."""
    return f"{1e3 * length:,.0f}" if length >= 1.0 else f"{1e3 * length:.4g}"
