"""Measuring: a stone and its descriptors, a scan with a hole in it, and the same stone with fewer triangles."""

import tempfile
from pathlib import Path

import lithoform

stone = lithoform.generate(lithoform.database_recipe("plate", seed=3))
found = lithoform.measure(stone, ["four", "zingg_class", "sieve_size", "caliper_length"])
for name, value in found.items():
    print(f"{name:16s} {value if isinstance(value, str) else format(value, '.4g')}")
assert found["zingg_class"] == "plate"
assert found["sieve_size"] < found["caliper_length"]
assert found.conventions["boxiness"] == {"box": "principal"}

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "scan.ply"
    lithoform.write_mesh(path, lithoform.Mesh(stone.mesh.vertices, stone.mesh.faces[60:]))
    scan = lithoform.read_scan(path)
print("; ".join(scan.repairs))
assert scan.repairs
assert abs(scan.mesh.volume / stone.mesh.volume - 1) < 1e-3

coarse = lithoform.simplify(stone.mesh, 5000)
change = {name: value / found[name] - 1 for name, value in lithoform.measure(coarse, "four").items()}
print("5,000 triangles:", ", ".join(f"{name} {100 * value:+.1f} %" for name, value in change.items()))
assert all(abs(value) < 0.05 for value in change.values())
