"""What the observers say of arrangements whose truth is known: lattices, columns, bodies that a plane cuts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bodies import box, random_rotation
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from lithoform import dem, generate
from lithoform.dem.container import extents, solid_below
from lithoform.dem.observers import (
    PackingDensity,
    contact_counts,
    contacts,
    coordination,
    density_profile,
    energies,
    fabric,
    fabric_tensor,
    force_chains,
    packing_density,
    unit_of,
    wall_forces,
    wall_pushes,
)
from lithoform.errors import SceneError
from lithoform.presets import database_recipe

DRY = dem.Material(youngs_modulus=1e8, poisson_ratio=0.3, density=2650.0, restitution=0.5, sliding_friction=0.5)
RADIUS = 0.005
# By what share of the diameter neighbours of the lattice overlap, so that they touch.
CLOSER = 1e-4
Z = np.array([0.0, 0.0, 1.0])


def cube_of_planes(size: float) -> tuple[dem.Plane, ...]:
    """Six planes around a cube at the origin: low and high of x, y, z."""
    axes = np.eye(3)
    return tuple(
        dem.Plane(point=tuple(side * size * axes[a]), normal=tuple(axes[a] - 2.0 * side * axes[a]))
        for a in range(3)
        for side in (0, 1)
    )


BOX = dem.Container(sides=((0, 1), (2, 3)), ends=(4, 5))


def after_one_step(model: dem.Model, place: np.ndarray, **given: object) -> dem.State:
    state = dem.State.at_rest(model, place, **given)
    return dem.simulate(model, state, until=1e-9, dt=1e-9, device="cpu", threads=1).state


@pytest.fixture(scope="module")
def lattice() -> tuple[dem.Model, dem.State]:
    """Simple cubic lattice of 4 x 4 x 4 spheres that touch each other and six planes."""
    pitch = 2.0 * RADIUS * (1.0 - CLOSER)
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(DRY,), shape=[0] * 64, gravity=(0, 0, 0),
                      walls=cube_of_planes(4.0 * pitch))  # fmt: skip
    place = (np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3) + 0.5) * pitch
    return model, after_one_step(model, place)


@pytest.fixture(scope="module")
def column() -> tuple[dem.Model, dem.State]:
    """Five spheres upon each other on a plane, at rest under gravity."""
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(DRY,), shape=[0] * 5, local_damping=0.7,
                      walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))  # fmt: skip
    place = [[0.0, 0.0, (2 * k + 1) * RADIUS] for k in range(5)]
    return model, dem.simulate(model, dem.State.at_rest(model, place), until=0.1, device="cpu", threads=1).state


@pytest.fixture(scope="module")
def stone() -> dem.Shape:
    return dem.Shape.from_mesh(generate(database_recipe("column", seed=4, triangles=2000)).mesh)


def alone(shape: dem.Shape, *, scale: float = 1.0, at: object = (0, 0, 0), turn: object = None):
    """A block of a shape, without walls."""
    model = dem.Model(shapes=(shape,), materials=(DRY,), shape=[0], scale=[scale])
    return model, dem.State.at_rest(model, [at], None if turn is None else [turn])


def test_a_simple_cubic_lattice_has_six_contacts(lattice):
    counts = contact_counts(*lattice)
    assert (counts.sum(axis=1) == 6).all()
    assert coordination(*lattice) == {
        "mean": 6.0 * (1.0 - 1.0 / 4.0),
        "without_rattlers": 4.5,
        "with_walls": 6.0,
        "with_walls_without_rattlers": 6.0,
        "rattlers": 0.0,
    }


def test_a_simple_cubic_lattice_fills_pi_over_six(lattice):
    model, state = lattice
    truth = math.pi / 6.0 / (1.0 - CLOSER) ** 3
    assert PackingDensity(container=BOX)(model, state)[""] == pytest.approx(truth, rel=1e-12)
    height = 8.0 * RADIUS * (1.0 - CLOSER)
    assert packing_density(model, state, 0.0, height, BOX) == pytest.approx(truth, rel=1e-3)  # caps through the walls
    middle = PackingDensity(container=BOX, low=height / 4, high=height / 2)(model, state)[""]
    # A layer of whole spheres: what a sphere has beyond its cell, the neighbours have in it.
    assert middle == pytest.approx(truth, rel=1e-7)
    profile = density_profile(model, state, np.linspace(0.0, height, 9), BOX)
    np.testing.assert_allclose(profile[1:-1], truth, rtol=1e-3)
    assert packing_density(model, state, 1.0, 2.0, BOX) == 0.0


def test_a_simple_cubic_lattice_is_isotropic(lattice):
    tensor = fabric_tensor(*lattice)
    np.testing.assert_allclose(tensor, np.eye(3) / 3.0, atol=1e-12)
    assert fabric(*lattice) == pytest.approx(
        {"major": 1 / 3, "intermediate": 1 / 3, "minor": 1 / 3, "deviator": 0.0}, abs=1e-7
    )
    np.testing.assert_allclose(fabric_tensor(*lattice, walls=True), np.eye(3) / 3.0, atol=1e-12)
    # All contacts are as deep, so that all forces are the same: Hertz.
    modulus = DRY.youngs_modulus / (2.0 * (1.0 - DRY.poisson_ratio**2))
    force = 4.0 / 3.0 * modulus * math.sqrt(RADIUS / 2.0) * (2.0 * RADIUS * CLOSER) ** 1.5
    numbers = force_chains(*lattice)
    assert numbers["contacts"] == 3 * 4 * 4 * 3
    assert numbers["mean_force"] == pytest.approx(force, rel=1e-6)
    assert numbers["largest_force"] == pytest.approx(force, rel=1e-6)


def test_a_column_carries_the_weight_of_what_is_above(column):
    model, state = column
    weight = float(model.mass[0]) * 9.81
    found = contacts(model, state)
    np.testing.assert_allclose(found.normal_force, weight * np.array([4, 3, 2, 1, 5]), rtol=1e-6)
    np.testing.assert_allclose(found.tangential_force, 0.0, atol=1e-9 * weight)
    np.testing.assert_array_equal(found.is_wall, [False] * 4 + [True])
    np.testing.assert_allclose(found.normal, [*[Z] * 4, -Z], atol=1e-12)
    np.testing.assert_allclose(found.force, -found.normal * found.normal_force[:, None], atol=1e-9 * weight)
    np.testing.assert_array_equal(found.end[:4], state.position[1:])
    np.testing.assert_allclose(found.end[4], state.position[0] - RADIUS * Z, atol=1e-12)
    numbers = force_chains(model, state)
    assert numbers["mean_force"] == pytest.approx(2.5 * weight, rel=1e-6)
    assert numbers["quadratic_mean_force"] == pytest.approx(math.sqrt(30 / 4) * weight, rel=1e-6)
    assert numbers["largest_force"] == pytest.approx(4.0 * weight, rel=1e-6)
    assert numbers["share_above_mean"] == 0.5
    assert numbers["pulling"] == 0.0
    walls = wall_forces(model, state)
    assert walls == pytest.approx({"0_x": 0.0, "0_y": 0.0, "0_z": -5 * weight, "0_push": 5 * weight}, rel=1e-6)


def test_a_column_is_as_anisotropic_as_can_be_and_its_top_is_a_rattler(column):
    assert fabric(*column) == pytest.approx({"major": 1.0, "intermediate": 0.0, "minor": 0.0, "deviator": 1.0})
    assert coordination(*column) == pytest.approx({
        "mean": 8 / 5, "without_rattlers": 7 / 4, "with_walls": 9 / 5, "with_walls_without_rattlers": 2.0,
        "rattlers": 1 / 5,
    })  # fmt: skip


def test_the_energies_of_a_column_at_rest(column):
    model, state = column
    found = energies(model, state)
    weight = float(model.mass[0]) * 9.81
    assert found["potential"] == pytest.approx(weight * state.position[:, 2].sum(), rel=1e-9)
    assert found["kinetic"] < 1e-9 * found["potential"]
    assert found["total"] == found["kinetic"] + found["potential"] + found["elastic"]
    # Hertz: 2/5 of force times overlap.
    radius = np.array([RADIUS, *[RADIUS / 2] * 4])
    modulus = DRY.youngs_modulus / (2.0 * (1.0 - DRY.poisson_ratio**2))
    force = weight * np.array([5, 4, 3, 2, 1])
    overlap = (3.0 * force / (4.0 * modulus * np.sqrt(radius))) ** (2.0 / 3.0)
    assert found["elastic"] == pytest.approx((0.4 * force * overlap).sum(), rel=1e-5)


def test_without_contacts_nothing_is_made_up():
    model, state = alone(dem.Shape.sphere(1.0))
    assert coordination(model, state)["mean"] == 0.0
    assert coordination(model, state)["rattlers"] == 1.0
    assert math.isnan(coordination(model, state)["without_rattlers"])
    assert all(math.isnan(value) for value in fabric(model, state).values())
    numbers = force_chains(model, state)
    assert numbers["contacts"] == numbers["pulling"] == 0.0
    assert math.isnan(numbers["mean_force"])
    assert wall_forces(model, state) == {}
    assert len(contacts(model, state).first) == 0


def test_contacts_that_pull_are_told_apart():
    sticky = dem.Material(youngs_modulus=1e8, poisson_ratio=0.3, density=2650.0, surface_energy=10.0)
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(sticky,), shape=[0, 0], gravity=(0, 0, 0))
    state = after_one_step(model, np.array([[0.0, 0.0, 0.0], [2.0 * RADIUS * (1 - 1e-7), 0.0, 0.0]]))
    numbers = force_chains(model, state)
    assert (numbers["contacts"], numbers["pulling"]) == (0.0, 1.0)
    assert contacts(model, state).normal_force[0] < 0.0


@pytest.mark.parametrize("angle", [0.3, 2.0, 4.4])
def test_the_normal_of_a_cylinder_is_radial(angle):
    axis = np.array([0.48, 0.6, 0.64])
    u = np.cross(axis, Z) / np.linalg.norm(np.cross(axis, Z))
    outward = math.cos(angle) * u + math.sin(angle) * np.cross(axis, u)
    cylinder = dem.Cylinder(point=(0.01, 0.02, 0.03), axis=tuple(axis), radius=0.05)
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(DRY,), shape=[0], gravity=(0, 0, 0),
                      walls=(cylinder,))  # fmt: skip
    centre = np.array([0.01, 0.02, 0.03]) + 0.7 * axis + (0.05 - RADIUS * 0.999) * outward
    state = after_one_step(model, centre[None])
    found = contacts(model, state)
    np.testing.assert_allclose(found.normal, [outward], atol=1e-10)
    np.testing.assert_allclose(found.end, [centre + RADIUS * outward], atol=1e-10)
    overlap = RADIUS * 0.001
    modulus = DRY.youngs_modulus / (2.0 * (1.0 - DRY.poisson_ratio**2))
    truth = 4.0 / 3.0 * modulus * math.sqrt(RADIUS) * overlap**1.5
    assert wall_pushes(model, state) == pytest.approx([truth], rel=1e-6)
    np.testing.assert_allclose(state.wall_force[0], truth * outward, rtol=1e-6)


def test_the_normals_of_stones_in_a_cylinder_are_those_of_the_forces(stone):
    # Without friction and damping the force of a wall is along the normal.
    smooth = dem.Material(youngs_modulus=1e8, poisson_ratio=0.3, density=2650.0)
    model = dem.Model(shapes=(stone,), materials=(smooth,), shape=[0] * 6, gravity=(0, 0, 0),
                      walls=(dem.Cylinder(radius=10.0 * stone.radius),))  # fmt: skip
    generator = np.random.default_rng(5)
    reach = 10.0 * stone.radius - stone.bounding_radius
    angle = 2.0 * math.pi * np.arange(6) / 6
    outward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    state = dem.State.at_rest(model, reach * outward, generator.normal(size=(6, 4)), 1.0 * outward)
    hit = set()

    def look(model, now):
        found = contacts(model, now)
        np.testing.assert_allclose(found.force / -found.normal_force[:, None], found.normal, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(found.end[:, :2], axis=1), 10.0 * stone.radius, rtol=5e-3)
        hit.update(found.first.tolist())

    dem.simulate(model, state, until=6e-3, report=2e-5, on_report=look, device="cpu", threads=1)
    assert len(hit) == 6


def test_a_box_that_stands_on_a_plane_touches_it_in_the_middle_of_its_face():
    turned = Rotation.from_euler("z", 0.4)
    shape = dem.Shape.from_mesh(box((0.01, 0.02, 0.03)))
    model = dem.Model(shapes=(shape,), materials=(DRY,), shape=[0],
                      walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))  # fmt: skip
    upright = Rotation.from_matrix(shape.rotation)
    half = 0.03 / 2 - 1e-6
    state = after_one_step(model, np.array([[0.1, 0.2, half]]), orientation=[(turned * upright).as_quat()])
    found = contacts(model, state)
    np.testing.assert_allclose(found.end, [[0.1, 0.2, -1e-6]], atol=1e-7)
    np.testing.assert_allclose(found.normal, [-Z], atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(st.floats(-1.2, 1.2), st.floats(0.1, 3.0), st.integers(0, 10**6))
def test_a_sphere_below_a_plane_is_a_cap(height, scale, seed):
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    model, state = alone(dem.Shape.sphere(0.7), scale=scale, at=(1.0, 2.0, 3.0))
    radius, centre = 0.7 * scale, float(axis @ [1.0, 2.0, 3.0])
    truth, _ = quad(lambda z: math.pi * (radius**2 - z**2), -radius, min(max(height, -1.0), 1.0) * radius)
    found = solid_below(model, state, centre + height * radius, axis)
    assert found == pytest.approx([truth], rel=1e-9, abs=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.floats(-0.1, 3.1), st.floats(0.1, 3.0), st.integers(0, 10**6))
def test_a_cube_below_a_plane_across_its_diagonal(s, scale, seed):
    """Volume of the unit cube where x + y + z < s (Irwin and Hall), at any pose."""
    truth = sum((-1) ** k * math.comb(3, k) * max(s - k, 0.0) ** 3 for k in range(4)) / 6.0 if s < 3.0 else 1.0
    shape = dem.Shape.from_mesh(box((1.0, 1.0, 1.0)))
    turn = Rotation.from_matrix(random_rotation(np.random.default_rng(seed)))
    # The frame of the shape is that of the mesh, turned and moved; the diagonal in the world:
    axis = turn.apply(shape.rotation.T @ np.ones(3)) / math.sqrt(3.0)
    model, state = alone(shape, scale=scale, at=(0.3, -0.2, 0.9), turn=turn.as_quat())
    height = float(axis @ [0.3, -0.2, 0.9]) + scale * (s - 1.5) / math.sqrt(3.0)
    assert solid_below(model, state, height, axis) == pytest.approx([truth * scale**3], rel=1e-9, abs=1e-12)


def test_a_cut_along_a_face_and_through_vertices_is_exact():
    model, state = alone(dem.Shape.from_mesh(box((1.0, 2.0, 3.0))))
    axis = state.orientation[0, :3] * 0.0 + model.shapes[0].rotation.T @ Z
    for height, share in ((-1.5, 0.0), (-1.4999, 1e-4 / 3), (-0.5, 1 / 3), (0.0, 0.5), (1.5, 1.0), (9.0, 1.0)):
        assert solid_below(model, state, height, axis) == pytest.approx([6.0 * share], rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(extents(model, state, axis), [[-1.5, 1.5]])


@pytest.mark.parametrize("seed", range(4))
def test_the_volume_of_a_stone_below_a_plane_integrates_to_its_first_moment(stone, seed):
    """The integral of V(below z) from z0 to the top z1 is V (z1 - centroid): true of a body that is not convex too."""
    turn = Rotation.from_matrix(random_rotation(np.random.default_rng(seed)))
    model, state = alone(stone, scale=1.3, at=(0.01, 0.02, 0.03), turn=turn.as_quat())
    (low, high), axis = extents(model, state, Z)[0], Z
    heights, weights = np.polynomial.legendre.leggauss(200)
    heights = low + (high - low) * (heights + 1.0) / 2.0
    volumes = np.array([solid_below(model, state, z, axis)[0] for z in heights])
    assert (np.diff(volumes) > 0.0).all()
    found = (volumes * weights).sum() * (high - low) / 2.0
    assert found == pytest.approx(model.volume[0] * (high - 0.03), rel=1e-6)
    # What is below a plane is not above it.
    above = solid_below(model, state, -heights[70], -axis)
    assert volumes[70] + above[0] == pytest.approx(model.volume[0], rel=1e-12)
    assert solid_below(model, state, low - 1e-9, axis)[0] == 0.0
    assert solid_below(model, state, high + 1e-9, axis)[0] == pytest.approx(model.volume[0], rel=1e-12)


def test_the_volume_between_tilted_platens_of_a_cylinder():
    bottom = dem.Plane(point=(0.3, 0.0, 0.01), normal=(0.1, 0.02, 1.0))
    top = dem.Plane(point=(0.0, 0.4, 0.09), normal=(0.05, -0.2, -1.0))
    cylinder = dem.Cylinder(point=(0.01, 0.02, 7.0), radius=0.05)
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(DRY,), shape=[0],
                      walls=(cylinder, bottom, top))  # fmt: skip
    state = dem.State.at_rest(model, [[0.01, 0.02, 0.05]])

    def height(plane, x, y):
        (a, b, c), (px, py, pz) = plane.normal, plane.point
        return pz - (a * (x - px) + b * (y - py)) / c

    # Over the disc by midpoints in r^2 and angle.
    r = 0.05 * np.sqrt((np.arange(400) + 0.5) / 400)
    angle = 2.0 * math.pi * (np.arange(64) + 0.5) / 64
    x, y = 0.01 + np.outer(r, np.cos(angle)), 0.02 + np.outer(r, np.sin(angle))
    truth = (height(top, x, y) - height(bottom, x, y)).mean() * math.pi * 0.05**2
    container = dem.Container(sides=0, ends=(1, 2))
    assert container.volume(model, state) == pytest.approx(truth, rel=1e-12)
    assert PackingDensity(container=container)(model, state)[""] == pytest.approx(model.volume[0] / truth, rel=1e-12)
    # The axis is against gravity however the cylinder was given.
    down = model.with_walls(dem.Cylinder(axis=(0, 0, -1), radius=0.05))
    np.testing.assert_array_equal(dem.Container(sides=0).axis(down, dem.State.at_rest(down, [[0, 0, 0]])), Z)


def test_the_volume_goes_with_a_platen_that_moves():
    moving = dem.Plane(point=(0, 0, 0.1), normal=(0, 0, -1), motion=dem.Motion(velocity=(0, 0, -1.0)))
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(DRY,), shape=[0], gravity=(0, 0, 0),
                      walls=(dem.Cylinder(radius=0.02), cube_of_planes(0.0)[4], moving))  # fmt: skip
    density = PackingDensity(container=dem.Container(sides=0, ends=(1, 2)))
    run = dem.simulate(model, dem.State.at_rest(model, [[0, 0, 0.01]]), until=0.05, report=0.025, device="cpu",
                       observers={"packing_density": density, "energy": energies})  # fmt: skip
    truth = model.volume[0] / (math.pi * 0.02**2 * (0.1 - run.table["time"]))
    np.testing.assert_allclose(run.table["packing_density"], truth, rtol=1e-9)
    assert {"energy_kinetic", "energy_work"} <= set(run.table)


def test_the_cross_section_of_a_slanted_box():
    angle = math.radians(60.0)
    slanted = np.array([math.cos(angle), math.sin(angle), 0.0])
    walls = (
        dem.Plane(point=(0, 0, 0), normal=(1, 0, 0)), dem.Plane(point=(0.2, 5, 0), normal=(-1, 0, 0)),
        dem.Plane(point=(0, 0, 0), normal=tuple(slanted)),
        dem.Plane(point=tuple(0.3 * slanted), normal=tuple(-slanted)),
        dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Plane(point=(0, 0, 0.5), normal=(0, 0, -1)),
    )  # fmt: skip
    model = dem.Model(shapes=(dem.Shape.sphere(RADIUS),), materials=(DRY,), shape=[0], walls=walls)
    state = dem.State.at_rest(model, [[0.1, 0.1, 0.1]])
    assert BOX.area(model, state) == pytest.approx(0.2 * 0.3 / math.sin(angle), rel=1e-12)
    assert BOX.volume(model, state) == pytest.approx(0.2 * 0.3 / math.sin(angle) * 0.5, rel=1e-12)
    np.testing.assert_allclose(BOX.axis(model, state), Z)


def test_a_container_that_is_none_is_told(lattice):
    model, state = lattice
    cases = {
        "wall 9 of a container to be a plane of the model, which has 6 walls": {"sides": ((0, 9), (2, 3))},
        "wall 0 of a container to be a cylinder": {"sides": 0},
        "walls 0 and 2 to be parallel": {"sides": ((0, 2), (1, 3))},
        "but all are parallel": {"sides": ((0, 1), (1, 0))},
        "two ends for its volume": {"sides": ((0, 1), (2, 3)), "ends": None},
        "wall 2 is parallel to its sides": {"sides": ((0, 1), (2, 3)), "ends": (2, 3)},
    }
    for said, given_ in cases.items():
        with pytest.raises(SceneError, match=said):
            dem.Container(**{"ends": (4, 5), **given_}).volume(model, state)
    for edges in ([0.0], [1.0, 0.0], [0.0, math.nan], [[0.0, 1.0]]):
        with pytest.raises(SceneError, match="ascending, finite heights"):
            density_profile(model, state, edges, BOX)
    with pytest.raises(SceneError, match="both heights of the layer or none"):
        PackingDensity(container=BOX, low=0.0)


def test_units_of_columns():
    def mine(model, state):
        return {"a": 1.0}

    observers = {"energy": energies, "z": coordination, "f": force_chains, "w": wall_forces, "mine": mine,
                 "density": PackingDensity(container=BOX)}  # fmt: skip
    expected = {
        "energy_kinetic": "J", "z_mean": "1", "f_mean_force": "N", "f_share_above_mean": "1", "w_0_push": "N",
        "density": "1", "mine_a": None, "other": None, "time": None,
    }  # fmt: skip
    assert {name: unit_of(name, observers) for name in expected} == expected
    assert unit_of("f_x_mean_force", {"f_x": force_chains, "f": coordination}) == "N"
    mine.units = {"a": "m"}
    assert unit_of("mine_a", observers) == "m"
