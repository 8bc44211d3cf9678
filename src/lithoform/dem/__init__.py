"""Rigid blocks in contact: a discrete element engine for convex rounded hulls of meshes.

It takes shapes, materials, walls and a scene; nothing in it knows of databases or compactors.

    from lithoform import dem

    stone = dem.Shape.from_mesh(mesh)
    model = dem.Model(shapes=(stone,), materials=(dem.TABLE_10,), shape=[0, 0],
                      walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))
    state = dem.State.at_rest(model, [[0, 0, 0.02], [0, 0, 0.05]])
    run = dem.simulate(model, state, until=0.1)
"""

from __future__ import annotations

from lithoform.dem import observers
from lithoform.dem.checkpoint import read_checkpoint, write_checkpoint
from lithoform.dem.container import Container
from lithoform.dem.energy import Energy, EnergyWarning, energy
from lithoform.dem.jkr import NormalContact
from lithoform.dem.materials import TABLE_10, Material, PairConstants
from lithoform.dem.model import Model
from lithoform.dem.output import VtkSeries, write_table
from lithoform.dem.scales import Scales, rayleigh_time, scales
from lithoform.dem.shapes import Core, Shape
from lithoform.dem.simulate import Run, simulate
from lithoform.dem.state import State
from lithoform.dem.walls import Cylinder, Motion, Plane, Servo

__all__ = [
    "TABLE_10",
    "Container",
    "Core",
    "Cylinder",
    "Energy",
    "EnergyWarning",
    "Material",
    "Model",
    "Motion",
    "NormalContact",
    "PairConstants",
    "Plane",
    "Run",
    "Scales",
    "Servo",
    "Shape",
    "State",
    "VtkSeries",
    "energy",
    "observers",
    "rayleigh_time",
    "read_checkpoint",
    "scales",
    "simulate",
    "write_checkpoint",
    "write_table",
]
