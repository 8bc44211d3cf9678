"""Time scales of a simulation: what a step may be, what it costs, how far the case is from quasi-static and rigid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lithoform.dem.materials import Material
from lithoform.dem.model import Model
from lithoform.errors import SceneError

__all__ = ["LARGEST_STEP", "STEP", "Scales", "measured_rate", "rayleigh_time", "scales", "stiffness_number"]

# Share of the Rayleigh time: 0.05 to 0.07 is safe; at 0.2 an assembly jitters and densifies falsely.
STEP = 0.06
LARGEST_STEP = 0.2


@dataclass(frozen=True)
class Scales:
    """Scales of a case.

    Attributes
    ----------
    rayleigh_time : float
        Least time that a Rayleigh wave takes round half a block [s].
    step : float
        Time step: the one given, or 0.06 of it [s].
    kappa : float
        Contact stiffness (E / ((1 - nu^2) P))^(2/3); about the inverse of overlap over radius. Infinite at no pressure.
    inertial_number : float
        I = rate d sqrt(rho / P), d the diameter of the largest block; below 1e-3 the flow is quasi-static.
    inertial_number_median : float
        The same with the median diameter.
    pull_off_to_weight : float
        Pull-off force of two median blocks over the weight of one; above 1 they stick together in free fall.
    overlap : float
        Expected overlap over radius under the pressure, 1 / kappa.
    steps : int
        That the duration takes; 0 where none was asked for.
    hours : float
        That they take here, from a rate measured on this machine.
    """

    rayleigh_time: float
    step: float
    kappa: float
    inertial_number: float
    inertial_number_median: float
    pull_off_to_weight: float
    overlap: float
    steps: int = 0
    hours: float = 0.0

    def text(self) -> str:
        """In one line, for a person."""
        parts = [f"step {self.step:.2e} s (Rayleigh time {self.rayleigh_time:.2e} s)"]
        if math.isfinite(self.kappa):
            parts.append(f"kappa {self.kappa:.0f} (overlap about {self.overlap:.1e} of a radius)")
        if self.inertial_number:
            parts.append(
                f"inertial number {self.inertial_number_median:.1e} (largest block {self.inertial_number:.1e})"
            )
        parts.append(f"pull-off / weight {self.pull_off_to_weight:.2g}")
        if self.steps:
            parts.append(f"{self.steps:,} steps, about {_duration(self.hours)}")
        return "; ".join(parts)


def rayleigh_time(radius: float, material: Material) -> float:
    """Time of a Rayleigh wave round a sphere, pi r sqrt(rho / G) / (0.1631 nu + 0.8766) [s].

    Parameters
    ----------
    radius : float
        [m].
    material : Material
    """
    speed = math.sqrt(material.density / material.shear_modulus)
    return math.pi * radius * speed / (0.1631 * material.poisson_ratio + 0.8766)


def stiffness_number(material: Material, pressure: float) -> float:
    """Kappa of a material under a pressure [Pa], (E / ((1 - nu^2) P))^(2/3)."""
    return (material.youngs_modulus / (1.0 - material.poisson_ratio**2) / pressure) ** (2.0 / 3.0)


def scales(
    model: Model,
    pressure: float = 0.0,
    rate: float = 0.0,
    *,
    duration: float = 0.0,
    dt: float | None = None,
    threads: int | None = None,
) -> Scales:
    """Scales of a model under a pressure and a rate of shear.

    Parameters
    ----------
    model : Model
    pressure : float
        [Pa]; 0 for none.
    rate : float
        Shear rate [1/s].
    duration : float
        To be simulated [s]; for the cost.
    dt : float, optional
        Time step, if another than the proposed one is taken [s].
    threads : int, optional
        For the cost; by default all processors.

    Raises
    ------
    SceneError
        If a number is negative or not finite.
    """
    for name, value in (("pressure", pressure), ("rate", rate), ("duration", duration)):
        if not (math.isfinite(value) and value >= 0.0):
            raise SceneError(f"expected a {name} of at least 0, got {value!r}.")
    used = sorted({int(m) for m in model.material})
    least = min(rayleigh_time(float(model.radius[model.material == m].min()), model.materials[m]) for m in used)
    step = STEP * least if dt is None else dt
    kappa = min(stiffness_number(model.materials[m], pressure) for m in used) if pressure else math.inf
    density = float(model.density.mean())
    inertial = rate * 2.0 * math.sqrt(density / pressure) if pressure else 0.0
    median = float(np.median(model.radius))
    weight = density * 4.0 / 3.0 * math.pi * median**3 * (math.hypot(*model.gravity) or 9.81)
    energy = max(model.materials[m].surface_energy for m in used)
    steps = math.ceil(duration / step)
    hours = steps * model.count / measured_rate(threads) / 3600.0 if steps else 0.0
    return Scales(
        rayleigh_time=least,
        step=step,
        kappa=kappa,
        inertial_number=inertial * float(model.radius.max()),
        inertial_number_median=inertial * median,
        pull_off_to_weight=3.0 * math.pi * energy * 0.5 * median / weight,
        overlap=1.0 / kappa,
        steps=steps,
        hours=hours,
    )


@lru_cache(maxsize=4)
def measured_rate(threads: int | None = None) -> float:
    """Block-steps per second of a dense assembly on this machine, from a run of a fraction of a second.

    Parameters
    ----------
    threads : int, optional
    """
    import time

    from lithoform.dem.engine import Engine
    from lithoform.dem.materials import TABLE_10
    from lithoform.dem.shapes import Shape
    from lithoform.dem.state import State
    from lithoform.mesh import Mesh
    from lithoform.topology import sphere

    # Ellipsoids of 578 vertices in layers of a lattice, pressed 1e-3 into one another: two contacts a block of its own,
    # which is what a packing under pressure has.  Next to no time passes, so that they stay there.
    ball = sphere("octahedral", 12)
    mesh = Mesh(ball.vertices * [0.005, 0.0047, 0.0044], ball.faces)
    shape = Shape.from_mesh(mesh)
    cell = 2.0 * mesh.vertices.max(axis=0) * [1.0 - 1e-3, 1.0 - 1e-3, 1.01]
    grid = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * cell
    soft = TABLE_10.softened(0.1)
    model = Model(shapes=(shape,), materials=(soft,), shape=np.zeros(len(grid), int), gravity=(0.0, 0.0, 0.0))
    turn = np.tile(shape.orientation, (len(grid), 1))
    with Engine(model, State.at_rest(model, grid, turn), 1e-15, device="cpu", threads=threads) as engine:
        engine.run(1)
        engine.run(20)
        begin = time.perf_counter()
        made = engine.run(100).steps
        return len(grid) * made / (time.perf_counter() - begin)


def _duration(hours: float) -> str:
    if hours < 1.0 / 60.0:
        return f"{hours * 3600.0:.0f} s"
    return f"{hours * 60.0:.0f} min" if hours < 1.0 else f"{hours:.1f} h"
