"""Run by YADE (yade -j1 -n -x): speed of its convex polyhedra in a heap, for benchmarks/dem.py.

The task, a JSON file named in LITHOFORM_TASK, gives hulls (lists of points, radius 1), how many blocks, how many
steps to time, and how long to settle and to time them at most [s]; the answer goes to the file that it names.
"""

import json
import os
import time
from pathlib import Path

import numpy as np
from yade import *  # noqa: F403  the engines are found by their names
from yade import O, Quaternion, Vector3, polyhedra_utils, utils

task = json.loads(Path(os.environ["LITHOFORM_TASK"]).read_text())
radius, gravity = 3.5e-3, 100.0
rng = np.random.default_rng(1)
rock = PolyhedraMat()  # noqa: F405
rock.density, rock.young, rock.poisson, rock.frictionAngle = 2650.0, 1e9, 0.3, 0.4636
O.materials.append(rock)
count, hulls = task["count"], task["hulls"]
side = int(round((count / 2.0) ** (1.0 / 3.0))) + 1
cell = 3.2 * radius
for k in range(count):
    layer, rest = divmod(k, side * side)
    points = tuple(Vector3(*(radius * c for c in p)) for p in hulls[k % len(hulls)])
    body = polyhedra_utils.polyhedra(rock, v=points)
    body.state.pos = Vector3((rest // side + 0.5) * cell, (rest % side + 0.5) * cell, (layer + 0.5) * cell)
    body.state.ori = Quaternion(*(float(c) for c in rng.normal(size=4)))
    body.state.ori.normalize()
    O.bodies.append(body)
width = side * cell
for axis, sense, place in ((0, 1, 0.0), (0, -1, width), (1, 1, 0.0), (1, -1, width), (2, 1, 0.0)):
    O.bodies.append(utils.wall(place, axis, sense=sense, material=rock))
O.engines = [
    ForceResetter(),  # noqa: F405
    InsertionSortCollider([Bo1_Polyhedra_Aabb(), Bo1_Wall_Aabb()], verletDist=0.05 * radius),  # noqa: F405
    InteractionLoop(  # noqa: F405
        [Ig2_Wall_Polyhedra_PolyhedraGeom(), Ig2_Polyhedra_Polyhedra_PolyhedraGeom()],  # noqa: F405
        [Ip2_PolyhedraMat_PolyhedraMat_PolyhedraPhys()],  # noqa: F405
        [Law2_PolyhedraGeom_PolyhedraPhys_Volumetric()],  # noqa: F405
    ),
    NewtonIntegrator(gravity=(0, 0, -gravity), damping=0.3),  # noqa: F405
]
O.dt = 1e-5
# Until they touch one another as in a heap, or for as long as the benchmark waits.
began = time.monotonic()
while O.iter < 1500 and time.monotonic() - began < task["patience"]:
    O.run(10, True)
settled, begin, spent = O.iter, time.process_time(), 0.0
while O.iter < settled + task["steps"] and spent < task["patience"]:
    O.run(2, True)
    spent = time.process_time() - begin
answer = {
    "block_steps_per_second": count * (O.iter - settled) / spent,
    "contacts_per_block": 2.0 * O.interactions.countReal() / count,
    "settling_steps": settled,
    "steps": O.iter - settled,
}
Path(task["answer"]).write_text(json.dumps(answer))
os._exit(0)
