"""Materials and the constants of the contact between two of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from lithoform.errors import SceneError

__all__ = ["TABLE_10", "Material", "PairConstants", "damping_ratio", "pair_constants"]

# With the critical damping ratio alone, eq. 32 restitutes less than asked; with this factor a Hertzian impact
# restitutes e exactly (Antypov and Elliott 2011, EPL 94:50004).
_HERTZ_DAMPING = math.sqrt(5.0 / 6.0)


@dataclass(frozen=True, kw_only=True)
class Material:
    """A material of blocks or walls.

    Attributes
    ----------
    youngs_modulus : float
        E [Pa].
    poisson_ratio : float
        nu, above -1 and at most 0.5.
    density : float
        [kg/m^3]; that of a wall does not matter.
    restitution : float
        Coefficient of restitution e of a head-on impact without adhesion, above 0 and at most 1.
    sliding_friction, rolling_friction : float
        Coefficients mu_s and mu_r.
    surface_energy : float
        gamma [J/m^2], half of the work of adhesion.
    """

    youngs_modulus: float
    poisson_ratio: float
    density: float
    restitution: float = 1.0
    sliding_friction: float = 0.0
    rolling_friction: float = 0.0
    surface_energy: float = 0.0

    def __post_init__(self) -> None:
        for name in ("youngs_modulus", "density"):
            _check(name, getattr(self, name), 0.0, math.inf, above=True)
        _check("poisson_ratio", self.poisson_ratio, -1.0, 0.5, above=True)
        _check_pair(self)

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    def softened(self, factor: float) -> Material:
        """The same material with another modulus.

        Parameters
        ----------
        factor : float
            On Young's modulus; below 1 the time step grows and the result changes: see `lithoform.dem.scales`.
        """
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Material(**{**values, "youngs_modulus": self.youngs_modulus * factor})


@dataclass(frozen=True, kw_only=True)
class PairConstants:
    """What belongs to a pair of materials; what is not given is the geometric mean of the two materials.

    Attributes
    ----------
    restitution, sliding_friction, rolling_friction, surface_energy : float or None
        As in `Material`.
    """

    restitution: float | None = None
    sliding_friction: float | None = None
    rolling_friction: float | None = None
    surface_energy: float | None = None

    def __post_init__(self) -> None:
        _check_pair(self)


def damping_ratio(restitution: float) -> float:
    """Factor 2 sqrt(5/6) beta of the damping force, beta = -ln e / sqrt(ln^2 e + pi^2)."""
    log = math.log(restitution)
    return -2.0 * _HERTZ_DAMPING * log / math.hypot(log, math.pi)


def pair_constants(a: Material, b: Material, given: PairConstants | None = None) -> Mapping[str, float]:
    """Constants of the contact of two materials, as `lithoform.dem.contact.PairLaw` takes them.

    Eq. 36 and 41 for the moduli; the rest as given, or the geometric mean.
    """
    modulus = 1.0 / sum((1.0 - m.poisson_ratio**2) / m.youngs_modulus for m in (a, b))
    shear = 1.0 / sum((2.0 - m.poisson_ratio) / m.shear_modulus for m in (a, b))

    def mean(name: str) -> float:
        asked = getattr(given, name, None)
        return math.sqrt(getattr(a, name) * getattr(b, name)) if asked is None else asked

    return {
        "modulus": modulus,
        "shear": shear,
        "energy": mean("surface_energy"),
        "sliding": mean("sliding_friction"),
        "rolling": mean("rolling_friction"),
        "damping": damping_ratio(mean("restitution")),
    }


def _check_pair(constants: Material | PairConstants) -> None:
    ranges = {"restitution": (0.0, 1.0, True), "sliding_friction": (0.0, math.inf, False),
              "rolling_friction": (0.0, math.inf, False), "surface_energy": (0.0, math.inf, False)}  # fmt: skip
    for name, (low, high, above) in ranges.items():
        value = getattr(constants, name)
        if value is not None:
            _check(name, value, low, high, above=above)


def _check(name: str, value: float, low: float, high: float, *, above: bool) -> None:
    good = isinstance(value, (int, float)) and math.isfinite(value) and low <= value <= high
    if not good or (above and value == low):
        wanted = f"{'above' if above else 'at least'} {low:g}" + (f" and at most {high:g}" if high < math.inf else "")
        raise SceneError(f"expected a {name.replace('_', ' ')} {wanted}, got {value!r}.")


# Basalt with asphalt film as Table 10 of the paper gives it; its "stiffness ratio 2.6" is E / G = 2 (1 + nu).
TABLE_10 = Material(
    youngs_modulus=55e9,
    poisson_ratio=0.3,
    density=2650.0,
    restitution=0.2,
    sliding_friction=0.5,
    rolling_friction=0.35,
    surface_energy=0.155,
)
