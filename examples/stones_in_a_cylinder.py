"""Thirty stones fall into a cylinder, come to rest, and are measured."""

import numpy as np

import lithoform
from lithoform import dem
from lithoform.packing.container import Container
from lithoform.packing.results import measure_packing
from lithoform.packing.run import pour
from lithoform.packing.settling import is_at_rest, schedule, settle
from lithoform.presets import database_recipe

classes = ("cube", "plate", "column", "blade")
meshes = [lithoform.generate(database_recipe(name, seed=1, triangles=1352)).mesh for name in classes]
shapes = [dem.Shape.from_mesh(mesh) for mesh in meshes]

container = Container.parse("cylinder:60mm:100mm")
rng = np.random.default_rng(1)
# A modulus of 0.003 of Table 10's makes the steps 18 times as long; under their own weight stones hardly feel it.
model, start = pour(shapes, np.arange(30) % 4, container, rng=rng, stiffness_factor=0.003)
weight = 9.81 * model.mass.sum()
print(dem.scales(model, weight / container.area).text())

rows = []
state = settle(model, start, schedule(model, start, dem.scales(model).step), rows)
found = measure_packing(model, state, container)
print(f"packing density {found.packing_density:.3f}, coordination number {found.coordination['mean']:.2f}")

assert is_at_rest(rows)
assert abs(-state.wall_force[:, 2].sum() / weight - 1.0) < 0.01  # floor and wall carry the stones
assert 0.2 < found.packing_density < 0.6
assert found.fits == 30
