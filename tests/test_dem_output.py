"""Files of a simulation: VTK series read back with VTK, and the table in Parquet."""

from __future__ import annotations

import contextlib
import math
import os
import resource
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import pyvista
from scipy.spatial.transform import Rotation

from lithoform import dem, generate
from lithoform.dem.observers import PackingDensity, contacts, energies, wall_forces
from lithoform.dem.output import _vtp
from lithoform.errors import FileFormatError, OutputError, SceneError
from lithoform.presets import database_recipe

SOFT = dem.TABLE_10.softened(0.01)


@pytest.fixture(scope="module")
def scene() -> tuple[dem.Model, dem.State, float]:
    """Stones of two shapes and a sphere that hit a plane and each other; and the time step."""
    shapes = [dem.Shape.from_mesh(generate(database_recipe(name, seed=2, triangles=2000)).mesh)
              for name in ("cube", "plate")]  # fmt: skip
    reach = max(shape.bounding_radius for shape in shapes)
    model = dem.Model(
        shapes=(*shapes, dem.Shape.sphere(0.5 * reach)),
        materials=(SOFT,),
        shape=[0, 1, 0, 2, 2],
        scale=[1.0, 0.8, 0.5, 1.0, 1.0],
        walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Cylinder(radius=3 * reach)),
    )
    place = np.array([[0, 0, 1.1], [0.3, 0, 3.0], [1.7, 0, 0.8], [-1.8, 0, 0.5], [-1.8, 0, 1.49999]]) * reach
    generator = np.random.default_rng(3)
    velocity = np.tile([0.0, 0.0, -0.3], (5, 1))
    velocity[3:] = 0.0
    state = dem.State.at_rest(model, place, generator.normal(size=(5, 4)), velocity, generator.normal(size=(5, 3)) * 5)
    run = dem.simulate(model, state, until=0.006, device="cpu", threads=1)
    return model, run.state, run.dt


@pytest.fixture(scope="module")
def frames(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("series") / "new" / "vtk"
    model, state, _ = scene
    written = dem.VtkSeries(folder, model)(model, state)
    return folder, written


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """As on a disk that is full after so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def listed(folder: Path, name: str) -> list[float]:
    return list(pyvista.PVDReader(folder / f"{name}.pvd").time_values)


def in_the_world(model: dem.Model, state: dem.State, block: int) -> np.ndarray:
    mesh = model.shapes[model.shape[block]].mesh
    turned = Rotation.from_quat(state.orientation[block]).apply(mesh.vertices * model.scale[block])
    return turned + state.position[block]


def test_the_files_and_their_names(scene, frames):
    folder, written = frames
    step = f"{scene[1].step:09d}"
    expected = [f"blocks_{step}.vtp", f"contacts_{step}.vtp", "blocks.pvd", "contacts.pvd"]
    assert [path.name for path in written] == expected
    assert names(folder) == sorted(expected)


def test_the_blocks_are_the_true_meshes_where_they_are(scene, frames):
    model, state, _ = scene
    found = pyvista.read(frames[1][0])
    assert isinstance(found, pyvista.PolyData)
    block = found.point_data["block"]
    assert np.unique(block).tolist() == [0, 1, 2, 3, 4]
    for i in range(3):
        mesh = model.shapes[model.shape[i]].mesh
        np.testing.assert_allclose(found.points[block == i], in_the_world(model, state, i), atol=1e-8)
        own = found.regular_faces[(block[found.regular_faces] == i).all(axis=1)]
        np.testing.assert_array_equal(own - np.flatnonzero(block == i)[0], mesh.faces)
    ball = found.points[block == 3] - state.position[3]
    np.testing.assert_allclose(np.linalg.norm(ball, axis=1), model.radius[3], rtol=1e-5)
    # Outward and closed: the volume is that of the stones and of the two balls, a little less than round.
    stones = model.volume[:3].sum()
    assert stones + 0.96 * model.volume[3:].sum() < found.volume < stones + model.volume[3:].sum()
    assert found.n_open_edges == 0
    assert found.field_data["TimeValue"][0] == state.time


def test_each_point_has_the_numbers_of_its_block(scene, frames):
    model, state, _ = scene
    found = pyvista.read(frames[1][0])
    block = found.point_data["block"]
    truths = {"velocity": state.velocity, "angular_velocity": state.angular_velocity(model), "force": state.force}
    assert set(found.point_data) == {"block", *truths}
    for name, truth in truths.items():
        np.testing.assert_allclose(found.point_data[name], truth[block], rtol=1e-6, atol=1e-12)


def test_the_contacts_are_lines_with_their_forces(scene, frames):
    model, state, _ = scene
    every = contacts(model, state)
    assert 0 < every.is_wall.sum() < len(every.first)
    found = pyvista.read(frames[1][1])
    assert found.n_lines == found.n_cells == len(every.first)
    ends = found.points[found.lines.reshape(-1, 3)[:, 1:]]
    np.testing.assert_array_equal(ends[:, 0], state.position[every.first])
    between = ~every.is_wall
    np.testing.assert_array_equal(ends[between, 1], state.position[every.second[between]])
    np.testing.assert_array_equal(found.cell_data["is_wall"].astype(bool), every.is_wall)
    np.testing.assert_array_equal(found.cell_data["first"], every.first)
    np.testing.assert_array_equal(found.cell_data["second"], every.second)
    np.testing.assert_array_equal(found.cell_data["normal"], every.normal)
    force = np.linalg.norm(every.force, axis=1)
    np.testing.assert_allclose(found.cell_data["force_magnitude"], force, rtol=1e-12)
    np.testing.assert_allclose(found.cell_data["normal_force"], -(every.force * every.normal).sum(axis=1), rtol=1e-12)
    # The normal of two balls is along the line of their centres, and one stands on the plane.
    upon = np.flatnonzero((every.first == 3) & (every.second == 4) & between)
    line = np.diff(ends[upon], axis=1)[:, 0]
    np.testing.assert_allclose(line / np.linalg.norm(line), every.normal[upon], atol=1e-5)
    down = np.flatnonzero((every.first == 3) & (every.second == 0) & every.is_wall)
    np.testing.assert_allclose(every.normal[down], [[0, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(ends[down, 1], state.position[3:4] - [0, 0, model.radius[3]], atol=1e-6)


def test_the_same_state_gives_the_same_bytes(scene, frames, tmp_path):
    model, state, _ = scene
    again = dem.VtkSeries(tmp_path, model)(model, state)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in frames[1]]


def test_hulls_hold_the_stones_and_are_small(scene, frames, tmp_path):
    model, state, _ = scene
    path = dem.VtkSeries(tmp_path, model, contacts=False, surface="hull")(model, state)[0]
    assert names(tmp_path) == ["blocks.pvd", path.name]
    found = pyvista.read(path)
    block = found.point_data["block"]
    for i in range(3):
        own = found.extract_points(block == i).extract_surface(algorithm=None)
        hull = model.shapes[model.shape[i]].hull_volume * model.scale[i] ** 3
        assert own.volume == pytest.approx(hull, rel=1e-4)
        assert own.n_open_edges == 0
    assert path.stat().st_size < 0.5 * frames[1][0].stat().st_size


def test_a_state_without_contacts_and_without_walls(tmp_path):
    model = dem.Model(shapes=(dem.Shape.sphere(0.01),), materials=(SOFT,), shape=[0])
    path = dem.VtkSeries(tmp_path, model, blocks=False)(model, dem.State.at_rest(model, [[1, 2, 3]]))[0]
    assert names(tmp_path) == ["contacts.pvd", "contacts_000000000.vtp"]
    found = pyvista.read(path)
    assert found.n_cells == found.n_points == 0
    assert listed(tmp_path, "contacts") == [0.0]


@pytest.mark.parametrize("count", [16383, 16384, 16385, 32768])
def test_arrays_about_the_size_of_a_packed_block_are_whole(tmp_path, count):
    points = np.random.default_rng(1).normal(size=(count, 3))
    numbers = np.arange(count, dtype=np.int32)  # 64 KiB at 16,384
    data = _vtp(points, ("Lines", np.stack([numbers, numbers[::-1]], axis=1)), {"number": numbers}, {}, time=0.5)
    (tmp_path / "a.vtp").write_bytes(data)
    found = pyvista.read(tmp_path / "a.vtp")
    np.testing.assert_array_equal(found.points, points)
    np.testing.assert_array_equal(found.point_data["number"], numbers)
    np.testing.assert_array_equal(found.lines.reshape(-1, 3)[:, 1:], np.stack([numbers, numbers[::-1]], axis=1))


def test_a_series_of_a_run(scene, tmp_path):
    model, state, dt = scene
    series = dem.VtkSeries(tmp_path, model, surface="hull")
    run = dem.simulate(model, state, until=state.time + 50 * dt, dt=dt, report=20 * dt, on_report=series, device="cpu")
    times = run.table["time"].tolist()
    assert listed(tmp_path, "blocks") == listed(tmp_path, "contacts") == pytest.approx(times, rel=1e-15)
    reader = pyvista.PVDReader(tmp_path / "blocks.pvd")
    reader.set_active_time_value(times[1])
    assert reader.read()[0].field_data["TimeValue"][0] == times[1]
    vtk_files = [name for name in names(tmp_path) if name.startswith("blocks_")]
    assert vtk_files == [f"blocks_{int(step):09d}.vtp" for step in run.table["step"]]


def test_a_series_goes_on_where_it_was(scene, tmp_path):
    model, state, dt = scene

    def at(*steps: int) -> None:
        series = dem.VtkSeries(tmp_path, model, blocks=False)
        for step in steps:
            series(model, replace(state, step=step, clock=(0.0, 0, dt)))

    at(10, 20, 30)
    whole = {name: (tmp_path / name).read_bytes() for name in names(tmp_path)}
    at(30)  # the same step again
    assert {name: (tmp_path / name).read_bytes() for name in names(tmp_path)} == whole
    at(40, 1000000000)
    assert listed(tmp_path, "contacts") == pytest.approx([10 * dt, 20 * dt, 30 * dt, 40 * dt, 1e9 * dt], rel=1e-14)
    at(25)  # taken back to a checkpoint: what came later is not of this run
    assert listed(tmp_path, "contacts") == pytest.approx([10 * dt, 20 * dt, 25 * dt], rel=1e-14)
    at(30, 40)
    assert listed(tmp_path, "contacts") == pytest.approx([10 * dt, 20 * dt, 25 * dt, 30 * dt, 40 * dt], rel=1e-14)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no xml",
        b"<VTKFile type='PolyData'/>",
        b"<a><DataSet/></a>",
        b"<VTKFile type='Collection'><DataSet timestep='1' file='x.vtu'/></VTKFile>",
    ],
)
def test_a_foreign_collection_is_not_written_over(scene, tmp_path, content):
    (tmp_path / "blocks.pvd").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"blocks\.pvd is no collection that lithoform has written"):
        dem.VtkSeries(tmp_path, scene[0])
    assert (tmp_path / "blocks.pvd").read_bytes() == content


def test_what_cannot_be_written_is_told(scene, tmp_path):
    model, state, _ = scene
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="is a file; name a folder"):
        dem.VtkSeries(tmp_path / "file", model)
    with pytest.raises(SceneError, match="surface of mesh or hull, got 'faces'"):
        dem.VtkSeries(tmp_path / "x", model, surface="faces")
    other = dem.Model(shapes=(dem.Shape.sphere(0.01),), materials=(SOFT,), shape=[0])
    with pytest.raises(SceneError, match="the model that the series was made for"):
        dem.VtkSeries(tmp_path / "x", model)(other, dem.State.at_rest(other, [[0, 0, 0]]))
    # The same blocks between other walls are the same series.
    dem.VtkSeries(tmp_path / "y", model)(model.with_motion(0, dem.Motion(velocity=(0, 0, 1))), state)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(scene, tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="cannot be used: Permission denied"):
            dem.VtkSeries(tmp_path / "vtk", scene[0])
    finally:
        tmp_path.chmod(0o700)


def test_a_disk_that_fills_loses_no_state(scene, tmp_path):
    model, state, dt = scene
    series = dem.VtkSeries(tmp_path / "vtk", model)
    series(model, state)
    before = {path.name: path.read_bytes() for path in (tmp_path / "vtk").iterdir()}
    until, checkpoint = state.time + 50 * dt, tmp_path / "run.ckpt"
    with files_of_at_most(20_000), pytest.raises(OutputError, match=r"cannot write .*blocks_0.*vtp: the file would be"):
        dem.simulate(model, state, until=until, dt=dt, report=20 * dt, on_report=series, checkpoint=checkpoint,
                     device="cpu")  # fmt: skip
    # No half file, the lists as they were, and the run goes on from where it was.
    assert {path.name: path.read_bytes() for path in (tmp_path / "vtk").iterdir()} == before
    kept = dem.read_checkpoint(checkpoint, model)
    assert state.step < kept.step <= state.step + 20
    rest = dem.simulate(model, kept, until=until, dt=dt, report=20 * dt, on_report=series, device="cpu")
    whole = dem.simulate(model, state, until=until, dt=dt, device="cpu")
    assert rest.state.position.tobytes() == whole.state.position.tobytes()
    assert listed(tmp_path / "vtk", "blocks") == [state.time, *rest.table["time"]]


def test_the_table_has_its_units(scene, tmp_path):
    model, state, dt = scene
    container = dem.Container(sides=1)
    observers = {"energy": energies, "wall": wall_forces, "count": lambda model, _: {"": float(model.count)},
                 "density": PackingDensity(container=container, low=0.0, high=0.01)}  # fmt: skip
    run = dem.simulate(model, state, until=state.time + 30 * dt, dt=dt, report=10 * dt, observers=observers,
                       device="cpu")  # fmt: skip
    path = dem.write_table(tmp_path / "table.parquet", run.table, observers=observers, units={"count": "stones"})
    found = pq.read_table(path)
    assert found.column_names == list(run.table)
    for name, values in run.table.items():
        np.testing.assert_array_equal(found[name].to_numpy(), values)
    units = {field.name: field.metadata[b"unit"].decode() for field in found.schema}
    assert units["time"] == "s"
    assert units["energy_kinetic"] == units["energy_work"] == "J"
    assert units["wall_0_z"] == units["wall_1_push"] == "N"
    assert (units["step"], units["density"], units["count"]) == ("1", "1", "stones")
    again = dem.write_table(tmp_path / "again.parquet", run.table, observers=observers, units={"count": "stones"})
    assert again.read_bytes() == path.read_bytes()


def test_a_table_without_units_and_without_rows(tmp_path):
    path = dem.write_table(tmp_path / "a", {"x": [1.5, math.nan], "n": np.array([1, 2])})
    found = pq.read_table(path)
    assert found.schema.field("x").metadata is None
    np.testing.assert_array_equal(found["x"].to_numpy(), [1.5, math.nan])
    assert pq.read_table(dem.write_table(tmp_path / "b", {"time": []})).num_rows == 0


def test_a_table_that_is_none_or_a_full_disk_is_told(tmp_path):
    path = tmp_path / "table"
    dem.write_table(path, {"x": [1.0]})
    before = path.read_bytes()
    for table in ({"x": [1.0], "y": [1.0, 2.0]}, {"x": [[1.0]]}):
        with pytest.raises(OutputError, match="expected columns of one length, got x "):
            dem.write_table(path, table)
    with files_of_at_most(2000), pytest.raises(OutputError, match=r"cannot write .*table: the file would be larger"):
        dem.write_table(path, {"x": np.random.default_rng(1).normal(size=10_000)})
    assert path.read_bytes() == before
    assert names(tmp_path) == ["table"]
    with pytest.raises(OutputError, match="its folder does not exist"):
        dem.write_table(tmp_path / "none" / "table", {"x": [1.0]})
