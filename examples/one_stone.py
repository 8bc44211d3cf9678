"""One stone: from a recipe to a checked mesh, a file, and back."""

import tempfile
from pathlib import Path

import numpy as np

import lithoform

# A 20 mm stone with a little less relief than the benchmark.  Lengths are metres.
recipe = lithoform.Recipe(perturbation=0.25, length=0.020, width=0.015, height=0.010, seed=7)
stone = lithoform.generate(recipe)

assert stone.report.sound
assert np.allclose(np.ptp(stone.mesh.vertices, axis=0), recipe.size, rtol=1e-9)
assert np.linalg.norm(stone.mass_properties.centroid) < 1e-12

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "stone.stl"
    sidecar = stone.save(path)  # writes stone.json as well; millimetres unless told otherwise
    back = lithoform.read_mesh(path)

assert sidecar["unit"] == "mm"
assert lithoform.check(back).sound
# An STL file holds 32-bit numbers.
assert np.isclose(back.volume, stone.mass_properties.volume, rtol=1e-5)

print(f"{stone}: {1e9 * stone.mass_properties.volume:.1f} mm3, {1e6 * stone.mass_properties.area:.1f} mm2")
