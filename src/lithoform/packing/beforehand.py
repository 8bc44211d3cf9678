"""What is refused and told before stones fall: their sizes, how soft they are, the time step."""

from __future__ import annotations

import math

import numpy as np

from lithoform.dem import TABLE_10, Model, Scales, scales
from lithoform.dem.scales import LARGEST_STEP
from lithoform.errors import SceneError
from lithoform.packing.container import Container, millimetres
from lithoform.packing.settling import Schedule

__all__ = ["introduction", "note_on_sizes", "pressure", "require_stiffness", "time_step"]

# Stones that press deeper than this share of their radius into one another under their own weight are too soft: impacts
# and the chains that carry most are ten times as deep, and a contact deeper than 0.1 of a radius is a fault.
_SOFTEST = 0.01
# A largest stone below this share of the container's width is told; one below the other share is a mistake, unless
# there are so many that they cover so much of the floor.
_SMALL, _LOST = 1.0 / 100.0, 1.0 / 1000.0
_COVER, _LEAST_COVER = 1.0, 0.01


def time_step(model: Model, asked: float | None) -> float:
    """The time step that is asked for, or that of the Rayleigh time [s].

    Raises
    ------
    SceneError
        If the one that is asked for is too long.
    """
    found = scales(model)
    if asked is None:
        return found.step
    most = LARGEST_STEP * found.rayleigh_time
    if asked > most:
        raise SceneError(
            f"expected --dt of at most {LARGEST_STEP:g} of the Rayleigh time, {most:.3g} s; got {asked:.3g} s: leave "
            f"it out to take {found.step:.3g} s."
        )
    return asked


def pressure(model: Model, container: Container) -> float:
    """Weight of the stones over the area of the floor [Pa]."""
    return float(model.mass.sum()) * math.hypot(*model.gravity) / container.area


def require_stiffness(model: Model, container: Container, factor: float) -> None:
    """Refuse stones so soft, or so heavy, that their own weight presses them far into one another.

    Parameters
    ----------
    model : Model
    container : Container
    factor : float
        On Young's modulus of Table 10, as it was asked for.

    Raises
    ------
    SceneError
        With the factor that would do.
    """
    # A stone that lies alone in a wide container still carries itself.
    alone = float((model.mass * math.hypot(*model.gravity) / (4.0 * model.radius**2)).max())
    overlap = scales(model, max(pressure(model, container), alone)).overlap
    if overlap <= _SOFTEST:
        return
    # The overlap goes with the modulus to the power -2/3.
    needed = factor * (overlap / _SOFTEST) ** 1.5
    ways = "fewer stones or a smaller --gravity"
    if needed <= 1.0:
        ways = f"--stiffness-factor of at least {_rounded_up(needed):g}, {ways}"
    raise SceneError(
        f"expected stones that press at most {_SOFTEST:g} of a radius into one another under their own weight; with "
        f"--stiffness-factor {factor:g} and --gravity {math.hypot(*model.gravity):g} it is about {overlap:.2g}: give "
        f"{ways}."
    )


def note_on_sizes(model: Model, container: Container, *, from_files: bool) -> str | None:
    """What is to be told about stones that are very small for their container; None for others.

    Parameters
    ----------
    model : Model
    container : Container
    from_files : bool
        Whether some stones are of mesh files, which are read in a unit.

    Raises
    ------
    SceneError
        If they are so small and few that the unit of their files, or of the container, must be another.
    """
    share = 2.0 * float(model.radius.max()) / min(container.sides)
    cover = math.pi * float((model.radius**2).sum()) / container.area
    if share >= _SMALL or cover >= _COVER:
        return None
    unit = "give the unit of their files with --unit, or a smaller container"
    way = unit if from_files else "give a smaller container"
    largest = millimetres(2.0 * float(model.radius.max()))
    if share < _LOST and cover < _LEAST_COVER:
        raise SceneError(
            f"expected stones of at least {_LOST:g} of the width of the container; the largest is {largest} mm wide in "
            f"a {container.text()}: {way}."
        )
    return (
        f"The stones are very small for the container: the largest is {largest} mm wide, and all of them would cover "
        f"{cover:.2g} of the floor. If that is not meant, {way}."
    )


def introduction(container: Container, model: Model, factor: float, found: Scales, plan: Schedule) -> list[str]:
    """Lines for a person, before the simulation begins.

    Parameters
    ----------
    container : Container
    model : Model
    factor : float
        On Young's modulus of Table 10.
    found : Scales
    plan : Schedule
    """
    modulus = model.materials[0].youngs_modulus
    softer = f"Young's modulus {modulus / 1e6:,.4g} MPa instead of {TABLE_10.youngs_modulus / 1e6:,.0f} MPa "
    softer += f"(--stiffness-factor {factor:g}), so that the steps are longer"
    if factor == 1.0:
        softer = "as it stands"
    least, median, most = (millimetres(2.0 * float(x)) for x in np.quantile(model.radius, (0.0, 0.5, 1.0)))
    sizes = f"{least} mm" if least == most else f"{least} to {most} mm, median {median} mm"
    return [
        f"{model.count} stones ({len(model.shapes)} different) are let down into a {container.text()}.",
        f"Diameters of the spheres of equal volume: {sizes}.",
        f"Material of stones and walls: Table 10, {softer}. Local damping: none.",
        f"No stone falls faster than {plan.fastest:.2f} m/s, as if it were poured from close above.",
        f"Scales under the stones' weight: {found.text()}.",
    ]


def _rounded_up(x: float) -> float:
    """With two digits, not smaller."""
    unit = 10.0 ** (math.floor(math.log10(x)) - 1)
    return min(1.0, math.ceil(x / unit) * unit)
