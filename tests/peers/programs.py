"""Run the same case with LAMMPS, YADE and our engine."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from dem_oracles import bulk_density, mean_contacts

from lithoform import dem

HERE = Path(__file__).resolve().parent
LAMMPS = shutil.which("lmp") or shutil.which("lammps")
YADE = shutil.which("yade")


def _run(command: list[str], folder: Path) -> str:
    # One thread, and no display: both programs would look for one.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "QT_QPA_PLATFORM": "offscreen", "DISPLAY": ""}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed:\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
    return done.stdout


def _lammps(script: str, variables: Mapping[str, object], folder: Path) -> str:
    assert LAMMPS is not None
    command = [LAMMPS, "-in", str(HERE / script), "-log", "none"]
    for name, value in variables.items():
        command += ["-var", name, f"{value!r}" if isinstance(value, float) else str(value)]
    return _run(command, folder)


def lammps_jkr(
    radius: float, modulus: float, poisson: float, energy: float, overlap: float, folder: Path
) -> np.ndarray:
    """Overlap [m] and force [N] of two equal spheres from an overlap to where they part, rows."""
    steps, every = 20_000, 50
    speed, dt = 1e-3, 3.0 * overlap / (1e-3 * steps)
    given = {"radius": radius, "modulus": modulus, "poisson": poisson, "energy": energy}
    given |= {"start": overlap, "speed": speed, "dt": dt, "steps": steps, "every": every}
    text = _lammps("jkr.lammps", given, folder)
    rows = []
    for line in text.splitlines():
        words = line.split()
        if len(words) == 3 and words[0].isdigit():
            rows.append([float(words[1]), float(words[2])])
    return np.array(rows)


@dataclass(frozen=True)
class Box:
    """Equal spheres that fall into a box, all at 1 m/s at the start; lengths in metres, of Hertz and Mindlin's law.

    At a restitution of 0.8 damping plays a small part; at 0.2 the packings of the programs differ by more.
    """

    seed: int
    count: int = 500
    side: int = 7
    time: float = 0.9
    radius: float = 0.005
    restitution: float = 0.8
    friction: float = 0.5

    @property
    def width(self) -> float:
        return 2.0 * self.radius * self.side

    @property
    def material(self) -> dem.Material:
        return replace(dem.TABLE_10.softened(1e-3), restitution=self.restitution, sliding_friction=self.friction,
                       rolling_friction=0.0, surface_energy=0.0)  # fmt: skip

    @property
    def dt(self) -> float:
        return 0.06 * dem.rayleigh_time(self.radius, self.material)

    @property
    def steps(self) -> int:
        return math.ceil(self.time / self.dt)

    @property
    def centres(self) -> np.ndarray:
        """A loose lattice, each sphere moved at random within its cell."""
        a_layer = self.side - 2
        spacing = self.width / a_layer
        cell = np.arange(self.count)
        lattice = np.stack([cell % a_layer, cell // a_layer % a_layer, cell // a_layer**2], axis=1) + 0.5
        free = 0.5 * spacing - 1.001 * self.radius
        centres = lattice * spacing + np.random.default_rng(self.seed).uniform(-free, free, (self.count, 3))
        return centres + np.array([0.0, 0.0, self.radius])

    def by_lithoform(self) -> np.ndarray:
        planes = [dem.Plane(point=(0, 0, 0), normal=(0, 0, 1))]
        for k in (0, 1):
            normal = tuple(float(x) for x in np.eye(3)[k])
            planes += [dem.Plane(point=(0, 0, 0), normal=normal),
                       dem.Plane(point=(self.width,) * 3, normal=tuple(-x for x in normal))]  # fmt: skip
        model = dem.Model(shapes=(dem.Shape.sphere(self.radius),), materials=(self.material,), walls=tuple(planes),
                          shape=np.zeros(self.count, int))  # fmt: skip
        state = dem.State.at_rest(model, self.centres, velocity=np.tile([0.0, 0.0, -1.0], (self.count, 1)))
        return dem.simulate(model, state, until=self.steps * self.dt, dt=self.dt, threads=1).state.position

    def by_lammps(self, folder: Path) -> np.ndarray:
        lines = [f"create_atoms 1 single {x!r} {y!r} {z!r}" for x, y, z in self.centres.tolist()]
        (folder / "start.lammps").write_text("\n".join(lines) + "\n")
        _lammps("packing.lammps", {
            "radius": self.radius, "width": self.width, "height": float(self.centres[:, 2].max()) + 0.05,
            "modulus": self.material.youngs_modulus, "poisson": self.material.poisson_ratio,
            "restitution": self.restitution, "friction": self.friction, "dt": self.dt, "steps": self.steps,
            "start": "start.lammps", "result": "result.dump",
        }, folder)  # fmt: skip
        rows = np.loadtxt((folder / "result.dump").read_text().splitlines()[9:])
        return rows[:, 1:]

    def by_yade(self, folder: Path) -> np.ndarray:
        assert YADE is not None
        case = {
            "radius": self.radius, "width": self.width, "modulus": self.material.youngs_modulus,
            "poisson": self.material.poisson_ratio, "restitution": self.restitution, "friction": self.friction,
            "dt": self.dt, "steps": self.steps, "centres": self.centres.tolist(), "result": str(folder / "result.json"),
        }  # fmt: skip
        (folder / "case.json").write_text(json.dumps(case))
        _run([YADE, "-n", "-x", "-j", "1", str(HERE / "packing_yade.py"), str(folder / "case.json")], folder)
        return np.array(json.loads((folder / "result.json").read_text()))

    def measures(self, centres: np.ndarray) -> dict[str, float]:
        """Packing density over the whole width and more than 1.5 diameters from all walls; mean number of contacts.

        Up to the height that is filled: 1.5 diameters below the highest sphere but a few.
        """
        d = 2.0 * self.radius
        top = float(np.sort(centres[:, 2])[-max(3, self.count // 50)]) - 1.5 * d
        whole = bulk_density(centres, self.radius, np.zeros(3), np.array([self.width, self.width, top]), 0.06 * d)
        bulk = bulk_density(centres, self.radius, np.array([1.5 * d] * 3),
                            np.array([self.width - 1.5 * d] * 2 + [top]), 0.06 * d)  # fmt: skip
        inner = ((centres[:, :2] > d) & (centres[:, :2] < self.width - d)).all(axis=1)
        inner &= (centres[:, 2] > d) & (centres[:, 2] < top)
        return {"density": whole, "bulk density": bulk, "contacts": mean_contacts(centres, self.radius, inner)}
