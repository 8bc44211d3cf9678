"""The adhesive normal contact of Johnson, Kendall and Roberts: scalar functions, for kernels and for plots.

Two spheres, or a sphere and a plane, of effective radius r and modulus E* with the surface energy gamma touch in a disc
of radius a.  With the work of adhesion 2 gamma, force and overlap follow from a (eq. 31 of the paper; Johnson, Kendall
and Roberts 1971, Proc. R. Soc. A 324:301):

    F = 4 E* a^3 / (3 r) - sqrt(16 pi gamma E* a^3),    overlap = a^2 / r - sqrt(4 pi gamma a / E*).

Contact begins where the surfaces meet (overlap 0) and ends at the tear-off, where d overlap / d a = 0.  Without
adhesion it is the contact of Hertz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import SceneError
from lithoform.warp_runtime import MODULE_OPTIONS, load, to_device, wp

__all__ = ["NormalContact", "contact_radius", "normal_force", "potential", "tear_off_radius"]

wp.set_module_options(MODULE_OPTIONS)

_ZERO = wp.constant(wp.float64(0.0))
_PI = wp.constant(wp.float64(math.pi))
_THIRD = wp.constant(wp.float64(1.0 / 3.0))
# The root is known to this share; Newton's method doubles the digits from there.
_ENOUGH = wp.constant(wp.float64(1e-9))
# Contact radius at overlap 0 over that at the tear-off: 16^(1/3).
_AT_TOUCH = wp.constant(wp.float64(16.0 ** (1.0 / 3.0)))


@wp.func
def tear_off_radius(modulus: wp.float64, radius: wp.float64, energy: wp.float64) -> wp.float64:
    """Contact radius at which the surfaces part if the distance is controlled: (pi gamma r^2 / (4 E*))^(1/3) [m]."""
    return wp.pow(_PI * energy * radius * radius / (wp.float64(4.0) * modulus), _THIRD)


@wp.func
def contact_radius(
    overlap: wp.float64, modulus: wp.float64, radius: wp.float64, energy: wp.float64, former: wp.float64
) -> wp.float64:
    """Contact radius at an overlap [m]: the stable branch; 0 beyond the tear-off, or without contact.

    `former` is the contact radius of the last step, 0 if there was no contact: then contact needs a positive overlap.
    """
    if overlap <= _ZERO and (former == _ZERO or energy == _ZERO):
        return _ZERO
    if energy == _ZERO:
        return wp.sqrt(radius * overlap)
    least = tear_off_radius(modulus, radius, energy)
    if overlap < -wp.float64(3.0) * least * least / radius:
        return _ZERO
    pull = wp.sqrt(wp.float64(4.0) * _PI * energy / modulus)
    # a^2 / r - pull sqrt(a) - overlap is convex, so that Newton's method comes down from any start above the root.
    a = former
    if former == _ZERO:
        a = wp.sqrt(radius * wp.max(overlap, _ZERO)) + _AT_TOUCH * least
    a = wp.max(a, wp.float64(1.05) * least)
    iterating = bool(True)  # Warp: a variable, not a constant
    count = wp.int32(0)
    while iterating:
        root = wp.sqrt(a)
        step = (a * a / radius - pull * root - overlap) / (wp.float64(2.0) * a / radius - wp.float64(0.5) * pull / root)
        a = wp.max(a - step, least)
        count += 1
        if wp.abs(step) <= _ENOUGH * a or count >= 100 or (a == least and step >= _ZERO):
            iterating = False
    return a


@wp.func
def normal_force(a: wp.float64, modulus: wp.float64, radius: wp.float64, energy: wp.float64) -> wp.float64:
    """Force at a contact radius, eq. 31 [N]: positive where it pushes the bodies apart."""
    cube = a * a * a
    push = wp.float64(4.0) * modulus * cube / (wp.float64(3.0) * radius)
    return push - wp.sqrt(wp.float64(16.0) * _PI * energy * modulus * cube)


@wp.kernel
def _contact_radii(
    overlaps: wp.array(dtype=wp.float64),
    modulus: wp.float64,
    radius: wp.float64,
    energy: wp.float64,
    former: wp.float64,
    radii: wp.array(dtype=wp.float64),
    forces: wp.array(dtype=wp.float64),
):
    k = wp.tid()
    a = contact_radius(overlaps[k], modulus, radius, energy, former)
    radii[k] = a
    if a > _ZERO:
        forces[k] = normal_force(a, modulus, radius, energy)


def potential(a: np.ndarray, modulus: float, radius: np.ndarray, energy: float) -> np.ndarray:
    """Work done against the normal force since the surfaces met at overlap 0 [J], at a contact radius [m]."""
    # F d(overlap)/da, integrated term by term.
    adhesion = math.sqrt(math.pi * energy * modulus)

    def primitive(x: np.ndarray) -> np.ndarray:
        return (
            8.0 * modulus * x**5 / (15.0 * radius**2)
            - 8.0 / 3.0 * adhesion * x**3.5 / radius
            + 2.0 * math.pi * energy * x**2
        )

    touch = (4.0 * math.pi * energy * radius**2 / modulus) ** (1.0 / 3.0)
    return primitive(a) - primitive(touch)


@dataclass(frozen=True)
class NormalContact:
    """The normal contact law of a pair, to be called and plotted without a simulation.

    `force` and `contact_radius` run the functions that the simulation runs.

    Attributes
    ----------
    modulus : float
        Effective modulus E* of eq. 36 [Pa].
    radius : float
        Effective radius r of eq. 37 [m].
    energy : float
        Surface energy gamma [J/m^2]; 0 for the contact of Hertz.
    """

    modulus: float
    radius: float
    energy: float = 0.0

    def __post_init__(self) -> None:
        for name, least in (("modulus", "positive"), ("radius", "positive"), ("energy", "at least 0")):
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0.0 or (value == 0.0 and name != "energy"):
                raise SceneError(f"expected a finite {name} that is {least}, got {value!r}.")

    @property
    def pull_off_force(self) -> float:
        """Largest tension, 3 pi gamma r [N]: where the bodies part if the force is controlled."""
        return 3.0 * math.pi * self.energy * self.radius

    @property
    def tear_off_radius(self) -> float:
        """Contact radius at which the bodies part if the distance is controlled [m]."""
        return (math.pi * self.energy * self.radius**2 / (4.0 * self.modulus)) ** (1.0 / 3.0)

    @property
    def tear_off_overlap(self) -> float:
        """Overlap at which the bodies part if the distance is controlled, -3 a^2 / r [m]."""
        return -3.0 * self.tear_off_radius**2 / self.radius

    def contact_radius(self, overlap: ArrayLike, *, touching: bool = True) -> np.ndarray:
        """Contact radius at an overlap.

        Parameters
        ----------
        overlap : array_like
            Positive where the undeformed bodies overlap [m].
        touching : bool
            Whether the bodies were in contact before: below overlap 0 only such bodies are.

        Returns
        -------
        numpy.ndarray
            [m]; 0 where there is no contact.
        """
        return self._evaluated(overlap, touching)[0]

    def force(self, overlap: ArrayLike, *, touching: bool = True) -> np.ndarray:
        """Force at an overlap, eq. 31 [N]: positive where it pushes; 0 where there is no contact.

        Parameters
        ----------
        overlap, touching
            As in `contact_radius`.
        """
        return self._evaluated(overlap, touching)[1]

    def overlap(self, contact_radius: ArrayLike) -> np.ndarray:
        """Overlap at a contact radius [m]: the closed form that `contact_radius` inverts."""
        a = np.asarray(contact_radius, dtype=np.float64)
        return a * a / self.radius - np.sqrt(4.0 * math.pi * self.energy * a / self.modulus)

    def potential(self, contact_radius: ArrayLike) -> np.ndarray:
        """Work that has been done against the force since the surfaces met at overlap 0 [J].

        The integral of F d(overlap) along the stable branch.
        """
        return potential(
            np.asarray(contact_radius, dtype=np.float64), self.modulus, np.asarray(self.radius), self.energy
        )

    def _evaluated(self, overlap: ArrayLike, touching: bool) -> tuple[np.ndarray, np.ndarray]:
        overlaps = np.atleast_1d(np.asarray(overlap, dtype=np.float64))
        load(_contact_radii.module, "cpu")
        radii, forces = (wp.zeros(overlaps.size, dtype=wp.float64, device="cpu") for _ in range(2))
        # Any contact radius serves as a start; that of the surfaces' meeting is never 0 with adhesion.
        former = 16.0 ** (1.0 / 3.0) * self.tear_off_radius if touching else 0.0
        given = [to_device(overlaps.ravel(), wp.float64, "cpu"), self.modulus, self.radius, self.energy, former]
        wp.launch(_contact_radii, overlaps.size, [*given, radii, forces], device="cpu")
        shape = np.shape(overlap)
        return radii.numpy().reshape(shape), forces.numpy().reshape(shape)
