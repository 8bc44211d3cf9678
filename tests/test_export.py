"""Decks for other engines: clumps and polyhedra against their shapes, and the decks run where the programs are."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import shutil
import subprocess
from csv import DictReader
from pathlib import Path

import numpy as np
import pytest
from cyclopts import App

from lithoform import dem, generate
from lithoform.cli.exporting import export
from lithoform.errors import FileFormatError, OutputError, RecipeError, SceneError
from lithoform.export import clumps
from lithoform.export.clumps import make_clump
from lithoform.export.deck import export_deck
from lithoform.export.polyhedra import make_polyhedron
from lithoform.export.scene import Scene, read_scene
from lithoform.locking import LOCK_FILE
from lithoform.mesh import Mesh
from lithoform.mesh_io import write_mesh
from lithoform.packing.request import Request
from lithoform.packing.run import pack
from lithoform.presets import database_recipe
from lithoform.topology import sphere

LAMMPS = shutil.which("lmp") or shutil.which("lammps")
MPI = shutil.which("mpirun")
LIGGGHTS = shutil.which("liggghts")
YADE = shutil.which("yade")
needs_lammps = pytest.mark.skipif(LAMMPS is None, reason="LAMMPS is not installed (Debian: lammps)")
needs_liggghts = pytest.mark.skipif(LIGGGHTS is None, reason="LIGGGHTS is not installed (Debian: liggghts)")
needs_yade = pytest.mark.skipif(YADE is None, reason="YADE is not installed (Debian: yade)")

# Soft stones: their steps are long, so that a case settles in seconds.
SOFT = dem.TABLE_10.softened(1e-3)


@pytest.fixture(scope="module")
def shapes() -> tuple[dem.Shape, ...]:
    recipes = (database_recipe("cube", seed=seed).replace(triangles=2000) for seed in (1, 2))
    return tuple(dem.Shape.from_mesh(generate(recipe).mesh) for recipe in recipes)


@pytest.fixture(scope="module")
def scene(shapes) -> Scene:
    """Eight stones in two layers above the floor of an inclined cylinder, each of another size and attitude."""
    reach = max(shape.bounding_radius for shape in shapes)
    tilt = 0.02
    walls = (
        dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),
        dem.Cylinder(radius=3.6 * reach, axis=(math.sin(tilt), 0, math.cos(tilt))),
    )
    which = [0, 1, 1, 0, 1, 0, 0, 1]
    scale = np.linspace(0.9, 1.1, 8)
    model = dem.Model(shapes=shapes, materials=(SOFT,), shape=which, scale=scale, walls=walls)
    angle = 0.5 * math.pi * np.arange(8)
    place = np.stack([1.6 * reach * np.cos(angle), 1.6 * reach * np.sin(angle), 1.2 * reach * np.ones(8)], axis=1)
    place[4:, 2] += 2.3 * reach
    attitude = np.random.default_rng(3).normal(size=(8, 4))
    return Scene(model=model, state=dem.State.at_rest(model, place, attitude), names=("a", "b"))


def run(command: list[str], folder: Path) -> str:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "QT_QPA_PLATFORM": "offscreen", "DISPLAY": ""}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False,
                          errors="replace", timeout=120)  # fmt: skip
    assert done.returncode == 0, done.stdout[-1500:] + done.stderr[-1500:]
    return done.stdout


def dumped(path: Path) -> np.ndarray:
    """Rows of a dump, by their first column."""
    lines = path.read_text().splitlines()
    at = max(k for k, line in enumerate(lines) if line.startswith(("ITEM: ATOMS", "ITEM: ENTRIES")))
    rows = np.array([[float(word) for word in line.split()] for line in lines[at + 1 :]])
    return rows[np.argsort(rows[:, 0])]


def shares(text: str) -> list[float]:
    """The last column of the thermodynamic output."""
    rows = [line.split() for line in text.splitlines()]
    return [float(row[2]) for row in rows if len(row) == 3 and row[0].isdigit() and row[1][0].isdigit()]


def principal(quaternions: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Tensors of inertia of moments about turned axes; quaternions (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_quat(quaternions[:, [1, 2, 3, 0]]).as_matrix()
    return np.einsum("nij,nj,nkj->nik", turns, moments, turns)


def test_the_clump_of_a_sphere_is_one_sphere() -> None:
    ball = sphere("icosahedral", 16)
    clump = make_clump(dem.Shape.from_mesh(ball.with_vertices(0.01 * ball.vertices)))
    assert len(clump) == 1
    # The polyhedron has 0.4 % less volume than the sphere about it.
    np.testing.assert_allclose(clump.radii, 0.01 * (ball.volume / (4.0 / 3.0 * math.pi)) ** (1.0 / 3.0), rtol=1e-3)
    assert np.abs(clump.centres).max() < 1e-5
    exact = make_clump(dem.Shape.sphere(0.02))
    assert exact.radii.tolist() == pytest.approx([0.02])


@pytest.mark.parametrize("spheres", [8, 40])
def test_the_errors_of_a_clump_are_those_of_its_spheres(shapes, spheres: int) -> None:
    shape = shapes[0]
    clump = make_clump(shape, spheres)
    assert len(clump) <= spheres
    # Monte Carlo, with points that the module does not know.
    rng = np.random.default_rng(11)
    side = 2.0 * clump.reach
    points = side * (rng.random((400_000, 3)) - 0.5)
    inside = np.zeros(len(points), dtype=bool)
    for centre, radius in zip(clump.centres, clump.radii, strict=True):
        inside |= ((points - centre) ** 2).sum(axis=1) <= radius**2
    share = inside.mean()
    noise = math.sqrt((1.0 - share) / share / len(points))
    assert share * side**3 / shape.volume - 1.0 == pytest.approx(clump.volume_error, abs=4.0 * noise)
    within = points[inside]
    assert np.linalg.norm(within.mean(axis=0)) / shape.radius == pytest.approx(clump.centre_error, abs=4e-3)
    about = np.cov(within.T)
    inertia = shape.volume * (np.trace(about) * np.eye(3) - about)
    worst = np.abs(inertia - np.diag(shape.inertia)).max() / shape.inertia.max()
    assert worst == pytest.approx(clump.inertia_error, abs=0.01)
    # All vertices of the mesh are as near to the spheres as is told, up to what its sample of points leaves out.
    apart = np.min([np.linalg.norm(shape.mesh.vertices - c, axis=1) - r
                    for c, r in zip(clump.centres, clump.radii, strict=True)], axis=0)  # fmt: skip
    assert np.abs(apart).max() / shape.radius < clump.max_distance + 0.05
    assert np.abs(apart).mean() / shape.radius == pytest.approx(clump.mean_distance, rel=0.25)


def test_more_spheres_are_nearer_and_the_same_shape_gives_the_same_clump(shapes) -> None:
    few, many, again = (make_clump(shapes[1], n) for n in (6, 30, 30))
    assert many.mean_distance < 0.6 * few.mean_distance
    assert abs(many.volume_error) < 0.005
    assert many.centres.tobytes() == again.centres.tobytes()
    with pytest.raises(SceneError, match="1 to 500 spheres"):
        make_clump(shapes[0], 0)


def test_a_polyhedron_has_the_volume_of_the_hull_and_is_near_it(shapes) -> None:
    from scipy.spatial import ConvexHull

    shape = shapes[0]
    solid = make_polyhedron(shape)
    assert len(solid) <= 50
    hull = ConvexHull(solid.vertices)
    assert hull.volume == pytest.approx(ConvexHull(shape.mesh.vertices).volume, rel=1e-9)
    assert len(hull.vertices) == len(solid)
    # By distances of vertices from the faces, not by tangent planes as the module does.
    outside = (shape.mesh.vertices @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    assert outside.max() / shape.radius <= solid.max_distance * (1.0 + 1e-9)
    assert solid.max_distance < 0.06
    # A cube needs its eight corners and keeps them.
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.01
    cube = ConvexHull(corners)
    turned = np.where(
        (np.einsum("ij,ij->i", np.cross(corners[cube.simplices[:, 1]] - corners[cube.simplices[:, 0]],
                                        corners[cube.simplices[:, 2]] - corners[cube.simplices[:, 0]]),
                   cube.equations[:, :3]) < 0.0)[:, None], cube.simplices[:, ::-1], cube.simplices)  # fmt: skip
    kept = make_polyhedron(dem.Shape.from_mesh(Mesh(corners, turned)))
    assert len(kept) == 8
    assert kept.max_distance < 1e-9


@pytest.mark.parametrize("seed", [48, 72, 94])
def test_no_sphere_of_a_thin_stone_lies_outside(seed: int) -> None:
    """Flat stones have edges across which a centre may leave the body."""
    recipe = database_recipe("blade", seed=seed).replace(triangles=2000)
    shape = dem.Shape.from_mesh(generate(recipe).mesh)
    for spheres in (6, 40):
        clump = make_clump(shape, spheres)
        assert clump.radii.min() > 0.05 * shape.radius
        # By the winding number of all triangles, not of sampled points: the centres are inside.
        corners = shape.mesh.vertices[shape.mesh.faces][None] - clump.centres[:, None, None]
        a, b, c = (corners[:, :, k] for k in range(3))
        x, y, z = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        over = x * y * z + (a * b).sum(2) * z + (b * c).sum(2) * x + (c * a).sum(2) * y
        turns = np.arctan2((a * np.cross(b, c)).sum(2), over).sum(1) / (2.0 * math.pi)
        np.testing.assert_allclose(turns, 1.0, atol=1e-6)
        assert clump.centre_error < 0.12
        assert abs(clump.volume_error) < 0.01


def test_a_ball_beside_a_stone_is_told(shapes) -> None:
    """The distance is measured from the spheres too: one that sticks out cannot hide."""
    shape = shapes[0]
    surface = clumps._Surface.of(shape.mesh)
    good = make_clump(shape, 20)
    place = np.array([[0.0, 0.0, 3.0 * shape.bounding_radius]])
    bad = clumps._with_errors(
        clumps.Clump(np.concatenate([good.centres, place]), np.append(good.radii, 0.1 * shape.radius)), shape, surface
    )
    assert bad.max_distance > 1.5
    assert good.max_distance < 0.3


def two_balls(**changes) -> Scene:
    """Two balls, one of them of another material, above a floor."""
    hard = dem.TABLE_10.softened(2e-3)
    other = dataclasses.replace(hard, poisson_ratio=0.1, restitution=0.5)
    walls = changes.pop("walls", (dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))
    model = dem.Model(shapes=(dem.Shape.sphere(0.01),), materials=(hard, other), shape=[0, 0], material=[0, 1],
                      walls=walls)  # fmt: skip
    state = dem.State.at_rest(model, [[0, 0, 0.012], [0.03, 0, 0.3]], **changes)
    return Scene(model=model, state=state)


def test_both_moduli_of_a_pair_are_those_of_the_engine() -> None:
    scene = two_balls()
    contact = scene.contact(0, 1)
    g = contact.youngs_modulus / (2.0 * (1.0 + contact.poisson_ratio))
    # Of two bodies alike: E / (2 (1 - nu^2)) and G / (2 (2 - nu)).
    assert contact.youngs_modulus / (2.0 * (1.0 - contact.poisson_ratio**2)) == pytest.approx(contact.modulus)
    assert g / (2.0 * (2.0 - contact.poisson_ratio)) == pytest.approx(contact.shear)


@needs_lammps
@needs_liggghts
def test_balls_far_above_the_floor_run_in_both(tmp_path) -> None:
    """Engines ask for two spheres a clump, and lose what leaves the box."""
    for engine, program in (("lammps", LAMMPS), ("liggghts", LIGGGHTS)):
        deck = export_deck(engine, two_balls(), tmp_path / engine, threads=1)
        assert deck["shapes"][0]["spheres"] == 2
        text = run([program, "-in", f"in.{engine}", "-var", "steps", "20000", "-var", "relax", "0"], tmp_path / engine)
        assert "ERROR" not in text


@needs_lammps
def test_the_walls_of_lammps_push_as_the_law_says(tmp_path) -> None:
    """A ball pressed into the floor by a tenth of a millimetre: Hertz's force, from how far it gets."""
    material = dem.TABLE_10.softened(1e-2)
    model = dem.Model(shapes=(dem.Shape.sphere(0.01),), materials=(material,), shape=[0], gravity=(0.0, 0.0, 0.0),
                      walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))  # fmt: skip
    case = Scene(model=model, state=dem.State.at_rest(model, [[0, 0, 0.0099]]))
    export_deck("lammps", case, tmp_path, threads=1)
    dt, steps = 1e-9, 1000
    run([LAMMPS, "-in", "in.lammps", "-log", "none", "-var", "dt", str(dt), "-var", "steps", str(steps), "-var",
         "relax", "0"], tmp_path)  # fmt: skip
    moved = dumped(tmp_path / "end.dump")[0, 4] - dumped(tmp_path / "start.dump")[0, 4]
    stiffness = material.youngs_modulus / (1.0 - material.poisson_ratio**2) / 2.0
    force = 4.0 / 3.0 * stiffness * math.sqrt(0.01) * 1e-4**1.5
    # Leapfrog with a constant force.
    assert moved == pytest.approx(0.5 * force / model.mass[0] * (steps * dt) ** 2, rel=0.005)


@needs_liggghts
def test_stones_turn_in_liggghts_as_they_should(scene, tmp_path) -> None:
    """The energy of the spin is that of the true tensors of inertia, of stones that are turned."""
    spin = np.random.default_rng(8).normal(size=(scene.model.count, 3))
    momentum = np.einsum("nij,nj->ni", scene.inertia, spin)
    turning = dataclasses.replace(scene.state, angular_momentum=momentum)
    case = Scene(model=scene.model, state=turning)
    export_deck("liggghts", case, tmp_path, spheres=8, threads=1)
    text = run([LIGGGHTS, "-in", "in.liggghts", "-var", "dt", "1e-9", "-var", "steps", "2", "-var", "relax", "0"],
               tmp_path)  # fmt: skip
    fall = float(scene.model.mass.sum()) * 9.81 * 2.0 * float(np.median(scene.model.radius))
    expected = 0.5 * (momentum * spin).sum() / fall
    assert max(shares(text)) == pytest.approx(expected, rel=0.01)


def test_what_liggghts_refuses_is_told_first(tmp_path) -> None:
    scene = two_balls()
    for changed, said in (({"poisson_ratio": -0.2}, "Poisson's ratio"), ({"restitution": 0.04}, "restitution above")):
        odd = dataclasses.replace(scene.model.materials[0], **changed)
        model = dataclasses.replace(scene.model, materials=(odd, odd))
        with pytest.raises(SceneError, match=said):
            export_deck("liggghts", Scene(model=model, state=scene.state), tmp_path / "deck", threads=1)


def test_a_cylinder_along_y_is_where_it_was(tmp_path) -> None:
    """LIGGGHTS wants its centre in the order z, x."""
    wall = dem.Cylinder(radius=0.1, axis=(0, 1, 0), point=(0.03, 0.0, 0.3))
    scene = two_balls(walls=(wall,))
    export_deck("liggghts", scene, tmp_path, threads=1)
    line = next(text for text in (tmp_path / "in.liggghts").read_text().splitlines() if "ycylinder" in text)
    assert [float(word) for word in line.split()[-2:]] == [0.3, 0.03]


@needs_lammps
@pytest.mark.parametrize("ranks", [1, 2])
def test_lammps_has_the_same_bodies_and_they_settle(scene, tmp_path, ranks: int) -> None:
    if ranks > 1 and MPI is None:
        pytest.skip("mpirun is not installed (Debian: openmpi-bin)")
    export_deck("lammps", scene, tmp_path, spheres=20, threads=1)
    before = [] if ranks == 1 else [MPI, "--allow-run-as-root", "--oversubscribe", "-np", str(ranks)]
    text = run([*before, LAMMPS, "-in", "in.lammps", "-log", "none", "-var", "steps", "80000", "-var", "relax", "500"],
               tmp_path)  # fmt: skip
    assert f"{1} by {ranks} by 1" in text or f"{ranks} by 1 by 1" in text
    start = dumped(tmp_path / "start.dump")
    model = scene.model
    np.testing.assert_allclose(start[:, 1], model.mass, rtol=1e-12)
    np.testing.assert_allclose(start[:, 2:5], scene.state.position, atol=1e-12)
    tensor = principal(start[:, 5:9], start[:, 9:12])
    assert np.abs(tensor - scene.inertia).max() < 1e-9 * model.inertia.max()
    found = shares(text)
    assert max(found) > 0.05  # they fell
    assert found[-1] < 1e-3  # and lie
    end = dumped(tmp_path / "end.dump")[:, 2:5]
    across = np.hypot(end[:, 0], end[:, 1])
    assert (end[:, 2] > 0.0).all()
    assert across.max() < scene.model.walls[1].radius


@needs_liggghts
def test_liggghts_has_the_same_bodies_and_they_settle(scene, tmp_path) -> None:
    deck = export_deck("liggghts", scene, tmp_path, spheres=20, threads=1)
    text = run([LIGGGHTS, "-in", "in.liggghts", "-var", "steps", "40000", "-var", "relax", "500"], tmp_path)
    rows = dumped(tmp_path / "start.dump")
    model = scene.model
    clumps = [make_clump(shape, 20) for shape in model.shapes]
    at = 0
    for i in range(model.count):
        clump = clumps[model.shape[i]]
        mine = rows[at : at + len(clump)]
        at += len(clump)
        np.testing.assert_allclose(mine[:, 2], model.mass[i], rtol=1e-4)
        expected = scene.state.position[i] + model.scale[i] * clump.centres @ scene.rotations[i].T
        moved = (mine[:, 4:7] - expected) / model.radius[i]
        # All spheres alike, by the distance of their centroid from the centre of mass.
        assert np.ptp(moved, axis=0).max() < 1e-3
        assert np.linalg.norm(moved.mean(axis=0)) == pytest.approx(clump.centre_error, abs=5e-3)
    assert deck["worst"]["centre_error"] == pytest.approx(max(c.centre_error for c in clumps))
    found = shares(text)
    assert max(found) > 0.05
    assert found[-1] < 1e-2


@needs_liggghts
@pytest.mark.parametrize("softened", [1.0, 5e-5])
def test_liggghts_takes_any_stiffness(scene, tmp_path, softened: float) -> None:
    """By itself it refuses moduli above 1 GPa and below 5 MPa."""
    stones = Scene(model=dataclasses.replace(scene.model, materials=(dem.TABLE_10.softened(softened),)),
                   state=scene.state)  # fmt: skip
    export_deck("liggghts", stones, tmp_path, spheres=2, threads=1)
    text = run([LIGGGHTS, "-in", "in.liggghts", "-var", "steps", "10", "-var", "relax", "0"], tmp_path)
    assert "ERROR" not in text
    # Two spheres a stone, and none was lost.
    assert len(dumped(tmp_path / "end.dump")) == 2 * scene.model.count


@needs_yade
@pytest.mark.timeout(120)
def test_yade_has_the_same_bodies_and_they_settle(shapes, tmp_path) -> None:
    reach = max(shape.bounding_radius for shape in shapes)
    half = 2.2 * reach
    sides = [((s * half, 0, 0), (-s, 0, 0)) for s in (-1, 1)] + [((0, s * half, 0), (0, -s, 0)) for s in (-1, 1)]
    walls = [dem.Plane(point=p, normal=n) for p, n in [((0, 0, 0), (0, 0, 1)), *sides]]
    model = dem.Model(shapes=shapes, materials=(SOFT,), shape=[0, 1, 1, 0], scale=[1.0, 0.9, 1.1, 0.8], walls=walls)
    place = [[s * reach * 1.1, t * reach * 1.1, 1.1 * reach] for s in (-1, 1) for t in (-1, 1)]
    state = dem.State.at_rest(model, place, np.random.default_rng(5).normal(size=(4, 4)))
    case = Scene(model=model, state=state)
    export_deck("yade", case, tmp_path, vertices=24)
    run([YADE, "-n", "-x", "run_yade.py", "6000", "0"], tmp_path)
    start, end = (json.loads((tmp_path / name).read_text()) for name in ("start.json", "end.json"))
    np.testing.assert_allclose([row["mass"] for row in start["blocks"]], model.mass, rtol=1e-12)
    np.testing.assert_allclose([row["position"] for row in start["blocks"]], state.position, atol=1e-12)
    tensor = np.array([row["inertia"] for row in start["blocks"]])
    assert np.abs(tensor - case.inertia).max() < 1e-9 * model.inertia.max()
    assert end["kinetic_share"] < 1e-2
    # They fell, and lie on the floor.
    low = np.array([row["position"][2] for row in end["blocks"]])
    assert (low < state.position[:, 2]).all()
    assert (low > 0.3 * model.radius).all()


@pytest.fixture(scope="module")
def packing(shapes, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("packing")
    (folder / "stones").mkdir()
    for k, shape in enumerate(shapes):
        write_mesh(folder / "stones" / f"{k}.stl", shape.mesh)
    request = Request(sources=(folder / "stones",), container="cylinder:80mm:80mm", count=6, stiffness_factor=1e-3,
                      vtk=False)  # fmt: skip
    pack(request, folder / "out", device="cpu", threads=1)
    return folder / "out"


def command(*words: str) -> int:
    app = App()
    app.command(export)
    return app(["export", *words], exit_on_error=False, print_error=False, result_action="return_value")


def test_a_packing_is_exported_as_its_table_says(packing, tmp_path, capsys) -> None:
    assert command("lammps", str(packing), "--out", str(tmp_path / "deck"), "--spheres", "10", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["blocks"] == 6
    assert set(told["worst"]) >= {"volume_error", "inertia_error", "mean_distance"}
    rows = list(DictReader((packing / "blocks.csv").read_text().splitlines()))
    bodies = [line.split() for line in (tmp_path / "deck" / "bodies.lammps").read_text().splitlines()[2:]]
    for row, body in zip(rows, bodies, strict=True):
        assert body[1] == row["mass_kg"]
        assert body[2:5] == [row["x_m"], row["y_m"], row["z_m"]]
    scene = read_scene(packing, threads=1)
    assert [type(wall).__name__ for wall in scene.walls] == ["Plane", "Cylinder"]


def test_stones_that_moved_are_found_or_asked_for(packing, tmp_path, monkeypatch) -> None:
    moved = tmp_path / "elsewhere"
    shutil.copytree(packing.parent, moved)
    numbers = json.loads((moved / "out" / "packing.json").read_text())
    numbers["settings"]["sources"] = ["stones"]
    (moved / "out" / "packing.json").write_text(json.dumps(numbers))
    monkeypatch.chdir(tmp_path)
    found = read_scene(moved / "out", threads=1)
    assert found.state.position.tobytes() == read_scene(packing, threads=1).state.position.tobytes()
    (moved / "stones").rename(tmp_path / "away")
    with pytest.raises(FileFormatError, match="say where they are with --stones"):
        read_scene(moved / "out", threads=1)
    again = read_scene(moved / "out", stones=[tmp_path / "away"], threads=1)
    assert again.model.mass.tobytes() == found.model.mass.tobytes()
    numbers["settings"] = {}
    (moved / "out" / "packing.json").write_text(json.dumps(numbers))
    with pytest.raises(FileFormatError, match="settings that this version does not know"):
        read_scene(moved / "out", threads=1)


def test_a_name_that_is_a_command_stays_a_name(scene, tmp_path) -> None:
    odd = dataclasses.replace(scene, source='new\nshell echo INJECTED """ \udcff')
    for engine in ("lammps", "liggghts"):
        export_deck(engine, odd, tmp_path / engine, spheres=3, threads=1)
        text = (tmp_path / engine / f"in.{engine}").read_text()
        assert not any(line.startswith("shell") for line in text.splitlines())
        assert '"""' not in text


def test_what_is_refused(packing, scene, tmp_path) -> None:
    with pytest.raises(FileFormatError, match=r"holds no packing\.json"):
        read_scene(tmp_path)
    for place in (packing, packing / "deck"):
        with pytest.raises(OutputError, match="folder of the specimen"):
            command("yade", str(packing), "--out", str(place))
    with pytest.raises(RecipeError, match="--threads of at least 1"):
        command("yade", str(packing), "--out", str(tmp_path / "a"), "--threads", "0")
    with pytest.raises(SceneError, match="lammps, liggghts, yade"):
        export_deck("pfc", scene, tmp_path / "deck")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "letter.txt").write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        export_deck("yade", scene, tmp_path / "other")
    out = tmp_path / "deck"
    export_deck("liggghts", scene, out, spheres=5, threads=1)
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    assert {"shape1.txt", "shape2.txt", "wall2.stl"} <= first.keys()
    with pytest.raises(OutputError, match="--overwrite replaces it"):
        export_deck("liggghts", scene, out, spheres=5, threads=1)
    export_deck("liggghts", scene, out, spheres=5, threads=2, overwrite=True)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == first
    # What LAMMPS leaves is the deck's too.
    export_deck("lammps", scene, out, spheres=5, threads=1, overwrite=True)
    for name in ("end.restart", "end.restart.rigid", "start.dump"):
        (out / name).write_text("x")
    # Another engine's deck leaves nothing of the former one.
    export_deck("yade", scene, out, overwrite=True)
    assert {path.name for path in out.iterdir()} - {LOCK_FILE} == {"deck.json", "run_yade.py", "scene.json"}
