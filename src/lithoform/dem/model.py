"""What is simulated and does not change: shapes, blocks, materials, walls, gravity."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from lithoform.dem.materials import Material, PairConstants
from lithoform.dem.shapes import Shape
from lithoform.dem.walls import Motion, Servo, Wall, moved
from lithoform.errors import SceneError
from lithoform.lazy import cached_property

__all__ = ["GRAVITY", "Model"]

GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """Rigid blocks, walls, and the materials of both.

    Attributes
    ----------
    shapes : tuple of Shape
        Each once, however many blocks use it.
    materials : tuple of Material
    shape : numpy.ndarray of int, shape (n,)
        Number of the shape of each block; how many there are says how many blocks.
    scale : numpy.ndarray, shape (n,)
        Factor on the lengths of the shape [default: 1].
    material : numpy.ndarray of int, shape (n,)
        Number of the material of each block [default: 0].
    walls : tuple of Plane and Cylinder
    pairs : mapping of (int, int) to PairConstants
        For pairs of materials of which the geometric mean will not do.
    gravity : tuple of float
        [m/s^2].
    local_damping : float
        Cundall's coefficient, 0 to below 1: forces that speed a block up are less, those that slow it down more by this
        share. 0 is the physics of the contact alone; a little more lets an assembly settle sooner.

    Raises
    ------
    SceneError
        If numbers are missing, out of range, not finite, or of other lengths.
    """

    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    shape: np.ndarray
    scale: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    material: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    walls: tuple[Wall, ...] = ()
    pairs: Mapping[tuple[int, int], PairConstants] = field(default_factory=dict)
    gravity: tuple[float, float, float] = GRAVITY
    local_damping: float = 0.0

    def __post_init__(self) -> None:
        for name in ("shapes", "materials", "walls"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.shapes or not self.materials:
            raise SceneError("expected at least one shape and one material.")
        shape = _numbers(self.shape, len(self.shapes), "shape", None)
        n = len(shape)
        if n == 0:
            raise SceneError("expected at least one block; the model has none.")
        material = np.zeros(n) if self.material is None else self.material
        scale = np.ones(n) if self.scale is None else np.array(self.scale, dtype=np.float64)
        if scale.shape != (n,) or not (np.isfinite(scale).all() and (scale > 0.0).all()):
            raise SceneError(f"expected {n} positive, finite scales, one a block; got {_told(scale, n)}.")
        scale.flags.writeable = False
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "scale", scale)
        object.__setattr__(self, "material", _numbers(material, len(self.materials), "material", n))
        object.__setattr__(self, "pairs", dict(self.pairs))
        for wall in self.walls:
            if not 0 <= wall.material < len(self.materials):
                raise SceneError(
                    f"expected a wall's material from 0 to {len(self.materials) - 1}, got {wall.material}."
                )
        for a, b in self.pairs:
            if not (0 <= a < len(self.materials) and 0 <= b < len(self.materials)):
                raise SceneError(f"expected pairs of materials from 0 to {len(self.materials) - 1}, got ({a}, {b}).")
            if a != b and (b, a) in self.pairs:
                raise SceneError(f"expected each pair of materials once, got ({a}, {b}) and ({b}, {a}): leave one out.")
        gravity = np.asarray(self.gravity, dtype=np.float64)
        if gravity.shape != (3,) or not np.isfinite(gravity).all():
            raise SceneError(f"expected three finite components of gravity, got {self.gravity!r}.")
        if not 0.0 <= self.local_damping < 1.0:
            raise SceneError(f"expected a local damping of at least 0 and below 1, got {self.local_damping!r}.")

    def with_walls(self, *walls: Wall) -> Model:
        """The same blocks between other walls."""
        return replace(self, walls=walls)

    def with_motion(self, wall: int, motion: Motion | Servo) -> Model:
        """The same model with another motion of one wall; a state of this model goes on with it where the wall is."""
        walls = list(self.walls)
        walls[wall] = moved(walls[wall], motion)
        return replace(self, walls=tuple(walls))

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.shape)

    @cached_property
    def volume(self) -> np.ndarray:
        """Volume of each block's true mesh [m^3], shape (n,)."""
        return self._of_shapes("volume") * self.scale**3

    @cached_property
    def density(self) -> np.ndarray:
        """[kg/m^3], shape (n,)."""
        return np.array([m.density for m in self.materials])[self.material]

    @cached_property
    def mass(self) -> np.ndarray:
        """[kg], shape (n,)."""
        return self.density * self.volume

    @cached_property
    def inertia(self) -> np.ndarray:
        """Principal moments of inertia [kg m^2], shape (n, 3)."""
        per_shape = np.array([shape.inertia for shape in self.shapes])
        return per_shape[self.shape] * (self.density * self.scale**5)[:, None]

    @cached_property
    def radius(self) -> np.ndarray:
        """Radius of the sphere of equal volume [m], shape (n,): the contact radius of a block (eq. 37)."""
        return self._of_shapes("radius") * self.scale

    @cached_property
    def bounding_radius(self) -> np.ndarray:
        """Radius of the sphere about the centre of mass that holds the block [m], shape (n,)."""
        return self._of_shapes("bounding_radius") * self.scale

    @cached_property
    def margin(self) -> np.ndarray:
        """Radius of the rounding [m], shape (n,)."""
        return np.array([shape.core.margin for shape in self.shapes])[self.shape] * self.scale

    @cached_property
    def block_fingerprint(self) -> str:
        """SHA-256 of the shapes and the blocks: of what a state must agree with."""
        digest = hashlib.sha256()
        for shape in self.shapes:
            for array in (shape.core.vertices, shape.core.faces, shape.inertia):
                digest.update(np.ascontiguousarray(array).tobytes())
            digest.update(np.array([shape.core.margin, shape.volume]).tobytes())
        for array in (self.shape, self.scale):
            digest.update(array.tobytes())
        return digest.hexdigest()

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the shapes, the blocks and the materials: of what a checkpoint must agree with."""
        told = (self.block_fingerprint, self.material.tobytes().hex(), repr(self.materials))
        return hashlib.sha256(repr(told).encode()).hexdigest()

    def _of_shapes(self, name: str) -> np.ndarray:
        return np.array([getattr(shape, name) for shape in self.shapes])[self.shape]


def _numbers(values: ArrayLike, count: int, what: str, expected: int | None) -> np.ndarray:
    array = np.asarray(values)
    whole = array.ndim == 1 and np.array_equal(array, array.astype(np.int64)) if array.dtype.kind in "iuf" else False
    if not whole or (expected is not None and len(array) != expected):
        raise SceneError(
            f"expected the number of a {what} for each block{_blocks(expected)}, got {_told(array, expected)}."
        )
    if len(array) and (array.min() < 0 or array.max() >= count):
        raise SceneError(f"expected numbers of a {what} from 0 to {count - 1}, got {array.min():g} to {array.max():g}.")
    numbers = array.astype(np.int32)
    numbers.flags.writeable = False
    return numbers


def _blocks(expected: int | None) -> str:
    return "" if expected is None else f" ({expected})"


def _told(array: np.ndarray, expected: int | None) -> str:
    if array.ndim != 1 or (expected is not None and array.shape != (expected,)):
        return f"an array of shape {array.shape}"
    bad = [x for x in array.tolist() if not (isinstance(x, (int, float)) and math.isfinite(x) and x > 0.0)]
    return f"{bad[0]!r}" if bad else f"{array[:3].tolist()}"
