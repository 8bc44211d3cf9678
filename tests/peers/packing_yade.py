"""Equal spheres fall into a box: run by `yade -n -x packing_yade.py SETTINGS.json`."""

import json
import math
import sys

from yade import *  # noqa: F403
from yade import utils

with open(sys.argv[1]) as file:  # noqa: PTH123
    case = json.load(file)

material = FrictMat(  # noqa: F405
    young=case["modulus"], poisson=case["poisson"], density=2650.0, frictionAngle=math.atan(case["friction"])
)
O.materials.append(material)  # noqa: F405
for centre in case["centres"]:
    O.bodies.append(utils.sphere(centre, case["radius"], material=material))  # noqa: F405
    O.bodies[-1].state.vel = (0, 0, -1)  # noqa: F405
for axis in (0, 1):
    O.bodies.append(utils.wall(0.0, axis, sense=1, material=material))  # noqa: F405
    O.bodies.append(utils.wall(case["width"], axis, sense=-1, material=material))  # noqa: F405
O.bodies.append(utils.wall(0.0, 2, sense=1, material=material))  # noqa: F405
O.engines = [  # noqa: F405
    ForceResetter(),  # noqa: F405
    InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()], verletDist=0.3 * case["radius"]),  # noqa: F405
    InteractionLoop(  # noqa: F405
        [Ig2_Sphere_Sphere_ScGeom(), Ig2_Wall_Sphere_ScGeom()],  # noqa: F405
        [Ip2_FrictMat_FrictMat_MindlinPhys(en=case["restitution"], es=case["restitution"])],  # noqa: F405
        [Law2_ScGeom_MindlinPhys_Mindlin()],  # noqa: F405
    ),
    NewtonIntegrator(damping=0.0, gravity=(0, 0, -9.81)),  # noqa: F405
]
O.dt = case["dt"]  # noqa: F405
O.run(case["steps"], True)  # noqa: F405
spheres = [list(b.state.pos) for b in O.bodies if isinstance(b.shape, Sphere)]  # noqa: F405
with open(case["result"], "w") as file:  # noqa: PTH123
    json.dump(spheres, file)
