"""The scene of the benchmarks: stones between 4.75 and 9.5 mm, pressed to 600 kPa in a mould."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lithoform import dem, generate
from lithoform.packing.container import Container
from lithoform.packing.placing import insert, random_attitudes
from lithoform.presets import database_recipe

CLASSES = ("cube", "plate", "column", "blade")
PRESSURE = 600e3
# Softer by the same factor as the load is less, the assembly deforms as much and is made in a tenth of the steps.
SOFTER = 0.1
# Gravity while the stones fall into the mould [m/s^2].
FALL = 30.0


def stones(count: int, *, triangles: int = 20_000) -> tuple[dem.Shape, ...]:
    """Shapes of the database setting, with full hulls."""
    recipes = (database_recipe(CLASSES[k % 4], seed=k, triangles=triangles) for k in range(count))
    return tuple(dem.Shape.from_mesh(generate(recipe).mesh) for recipe in recipes)


def scene(count: int, shapes: tuple[dem.Shape, ...], *, seed: int = 3) -> tuple[dem.Model, dem.State]:
    """Stones let down into a mould that they will fill about as high as wide, in random attitudes."""
    rng = np.random.default_rng(seed)
    low, high = 4.75e-3, 9.5e-3
    # Even in mass over the logarithm of size.
    diameter = (low**-3 + rng.uniform(size=count) * (high**-3 - low**-3)) ** (-1.0 / 3.0)
    shape = rng.integers(0, len(shapes), count)
    scale = 0.5 * diameter / np.array([s.radius for s in shapes])[shape]
    model = dem.Model(shapes=shapes, materials=(dem.TABLE_10.softened(0.1),), shape=shape, scale=scale)
    mould = (model.volume.sum() / 0.55 / (2.0 * math.pi)) ** (1.0 / 3.0)
    container = Container.parse(f"cylinder:{2e3 * mould}mm:1m")
    position = insert(model.bounding_radius, container, rng)
    walls = (dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Cylinder(radius=mould))
    model = replace(model, walls=walls)
    return model, dem.State.at_rest(model, position, random_attitudes(count, rng))


def pressed(count: int, shapes: tuple[dem.Shape, ...]) -> tuple[dem.Model, dem.State]:
    """The scene under a platen at 600 kPa: a dense packing at rest but for the last creep."""
    model, state = scene(count, shapes)
    soft = replace(model, materials=(model.materials[0].softened(SOFTER),), gravity=(0.0, 0.0, -FALL))
    top = float(state.position[:, 2].max())
    fall = math.sqrt(2.0 * 0.6 * top / FALL) + 0.02
    state = dem.simulate(replace(soft, local_damping=0.3), state, until=fall).state
    mould = next(wall.radius for wall in model.walls if isinstance(wall, dem.Cylinder))
    force = PRESSURE * math.pi * mould**2
    lid = float((state.position[:, 2] + model.bounding_radius).max())

    def servo(load: float) -> dem.Servo:
        return dem.Servo(force=load, mass=0.5 * float(model.mass.sum()), time=2e-3, max_speed=1.0)

    def under(base: dem.Model, motion: dem.Servo, height: float) -> dem.Model:
        platen = dem.Plane(point=(0.0, 0.0, height), normal=(0.0, 0.0, -1.0), motion=motion)
        return base.with_walls(*base.walls[:2], platen)

    def holds(_: dem.Model, now: dem.State) -> bool:
        return abs(now.wall_force[2, 2] / (SOFTER * force) - 1.0) < 0.1 and abs(now.wall_speed[2]) < 0.02

    press = under(replace(soft, gravity=(0.0, 0.0, -9.81)), servo(SOFTER * force), lid)
    state = dem.simulate(press, state.with_walls_of(press), until=state.time + 0.3, report=1e-3, stop=holds).state
    # The walls stay where they are.
    hard = replace(press, materials=model.materials).with_motion(2, servo(force))
    return hard, dem.simulate(hard, state, until=state.time + 1e-3).state
