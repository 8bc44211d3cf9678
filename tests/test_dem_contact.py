"""The contact law against closed forms: JKR, impacts, sliding, rolling, bodies on walls."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from dem_oracles import gross_sliding, hertz_contact_time, hertz_overlap, jkr_force, jkr_landmarks
from hypothesis import given, settings
from hypothesis import strategies as st
from peers import programs
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from test_dem_gjk import box_core

from lithoform import Mesh, dem
from lithoform.dem.clearances import shared_depths
from lithoform.dem.jkr import NormalContact
from lithoform.errors import SceneError

GRAVITY = 9.81
RADIUS = 0.005
# Without adhesion, ten times softer than Table 10: the laws checked here hold at any modulus.
DRY = replace(dem.TABLE_10.softened(0.1), surface_energy=0.0)
SPHERE = dem.Shape.sphere(RADIUS)
FLOOR = dem.Plane(point=(0, 0, 0), normal=(0, 0, 1))


def box(a: float, b: float, c: float) -> tuple[dem.Shape, np.ndarray]:
    """A box and the quaternion that puts it upright: its frame is that of its principal axes."""
    core = box_core(a, b, c)
    shape = dem.Shape.from_mesh(Mesh(core.vertices, core.faces))
    return shape, Rotation.from_matrix(shape.rotation).as_quat()


# ------------------------------------------------------------------------------------------ JKR


def jkr_error(contact: NormalContact, points: int = 60) -> float:
    """Largest error of the force against eq. 31 in 50 digits, from the tear-off to deep overlap, in pull-off forces."""
    least = contact.tear_off_overlap
    overlaps = np.concatenate(
        [least * (1.0 - np.geomspace(1e-12, 1.0, points)), -least * np.geomspace(1e-9, 100, points)]
    )
    exact = np.array([jkr_force(d, contact.modulus, contact.radius, contact.energy) for d in overlaps])
    # Far into the contact the force is many pull-offs: there its relative error counts.
    unit = np.maximum(contact.pull_off_force, np.abs(exact))
    return float(np.nanmax(np.abs(contact.force(overlaps) - exact) / unit))


def test_jkr_curve_is_that_of_eq_31():
    table_10 = NormalContact(modulus=30.2e9, radius=0.0025, energy=0.155)
    assert jkr_error(table_10) < 1e-6
    with pytest.raises(SceneError, match="modulus"):
        NormalContact(modulus=0.0, radius=1.0)


@settings(deadline=None, max_examples=25)
@given(
    modulus=st.floats(1e5, 1e12), radius=st.floats(1e-6, 1.0), energy=st.floats(1e-5, 10.0)
)  # fmt: skip
def test_jkr_landmarks_for_any_constants(modulus, radius, energy):
    contact = NormalContact(modulus=modulus, radius=radius, energy=energy)
    truth = jkr_landmarks(modulus, radius, energy)
    assert contact.pull_off_force == pytest.approx(truth["pull_off"], rel=1e-12)
    assert contact.tear_off_overlap == pytest.approx(truth["tear_off_overlap"], rel=1e-12)
    assert truth["tear_off_tension"] == pytest.approx(truth["pull_off"] * 5.0 / 9.0, rel=1e-12)
    # The largest tension along the curve is the pull-off force, and there is nothing beyond the tear-off.
    a = contact.tear_off_radius * np.linspace(1.0, 3.0, 2001)
    assert -contact.force(contact.overlap(a)).min() == pytest.approx(truth["pull_off"], rel=1e-5)
    at = contact.tear_off_overlap * np.array([1.0 - 1e-9, 1.0 + 1e-9])
    held, gone = contact.force(at)
    assert held == pytest.approx(-truth["pull_off"] * 5.0 / 9.0, rel=1e-3)
    assert gone == 0.0
    # Without former contact it begins at overlap 0, there with 8/9 of the pull-off force.
    assert contact.force(at[0], touching=False) == 0.0
    assert contact.force(0.0) == pytest.approx(-truth["pull_off"] * 8.0 / 9.0, rel=1e-9)
    assert jkr_error(contact, points=4) < 1e-6


def test_jkr_potential_is_the_integral_of_the_force():
    contact = NormalContact(modulus=3e9, radius=0.002, energy=0.2)

    def power(x: float) -> float:
        slope = 2.0 * x / contact.radius - math.sqrt(math.pi * contact.energy / (contact.modulus * x))
        return float(contact.force(contact.overlap(x))) * slope

    for factor in (1.0, 1.5, 4.0, 10.0):
        a = contact.tear_off_radius * factor
        start = contact.tear_off_radius * 16.0 ** (1.0 / 3.0)
        # Over the contact radius, in which both are smooth.
        work = quad(power, start, a, epsabs=0.0, epsrel=1e-10)[0]
        scale = contact.pull_off_force * abs(contact.tear_off_overlap)
        assert float(contact.potential(a)) == pytest.approx(work, abs=1e-8 * scale, rel=1e-8)


def test_hertz_is_the_limit_without_adhesion():
    contact = NormalContact(modulus=3e9, radius=0.002)
    for force in (1e-3, 1.0, 1e3):
        assert contact.force(hertz_overlap(force, 0.002, 3e9)) == pytest.approx(force, rel=1e-12)
    assert contact.force(-1e-9) == 0.0


def test_two_stuck_spheres_part_at_the_pull_off_force():
    """In a simulation: a sphere hangs from a fixed plane while its weight is below 3 pi gamma r, and falls above."""
    material = dem.TABLE_10.softened(0.01)
    mass = material.density * 4.0 / 3.0 * math.pi * RADIUS**3
    pull_off = 3.0 * math.pi * material.surface_energy * RADIUS
    ceiling = dem.Plane(point=(0, 0, RADIUS), normal=(0, 0, -1))
    for share, falls in ((0.97, False), (1.03, True)):
        model = dem.Model(shapes=(SPHERE,), materials=(material,), shape=[0], walls=(ceiling,), gravity=(0, 0, GRAVITY))
        run = dem.simulate(model, dem.State.at_rest(model, [[0, 0, 1e-9]]), until=0.005, threads=1)
        # Pressed on by gravity first; then the pull, slowly enough that inertia plays no part.
        state = run.state
        for pull in np.linspace(-0.5, 1.0, 40) * share * pull_off / mass:
            model = replace(model, gravity=(0.0, 0.0, -float(pull)))
            state = dem.simulate(model, state, until=state.time + 5e-4, threads=1).state
        state = dem.simulate(model, state, until=state.time + 0.01, threads=1).state
        assert (state.wall_contact_radius[0] == 0.0) == falls


# ------------------------------------------------------------------------------------------ impacts


def impact(material: dem.Material, *, on_wall: bool, speed: float = 0.5, step: float = 0.06) -> tuple[float, float]:
    """Duration of an impact, without the flight before and after it, and the coefficient of restitution.

    A sphere meets an equal one, each with half of the speed, or a wall of the same material.
    """
    gap = 1e-6
    if on_wall:
        model = dem.Model(shapes=(SPHERE,), materials=(material,), shape=[0], gravity=(0, 0, 0), walls=(FLOOR,))
        state = dem.State.at_rest(model, [[0, 0, RADIUS + gap]], velocity=[[0, 0, -speed]])
        mass, radius = float(model.mass[0]), RADIUS
    else:
        model = dem.Model(shapes=(SPHERE,), materials=(material,), shape=[0, 0], gravity=(0, 0, 0))
        state = dem.State.at_rest(model, [[0, 0, 0], [2 * RADIUS + gap, 0, 0]],
                                  velocity=[[0.5 * speed, 0, 0], [-0.5 * speed, 0, 0]])  # fmt: skip
        mass, radius = float(model.mass[0]) / 2.0, RADIUS / 2.0
    modulus = material.youngs_modulus / (2.0 * (1.0 - material.poisson_ratio**2))
    expected = hertz_contact_time(mass, radius, modulus, speed)
    dt = step * dem.rayleigh_time(RADIUS, material)
    # Damping makes an impact longer than the elastic one.
    run = dem.simulate(model, state, until=gap / speed + 3.0 * expected, dt=dt, threads=1)
    assert not run.state.wall_contact_radius.any()
    assert not run.state.contact_radius.any()
    x, v = run.state.position, run.state.velocity
    left, apart = (v[0, 2], x[0, 2] - RADIUS) if on_wall else (v[1, 0] - v[0, 0], x[1, 0] - x[0, 0] - 2 * RADIUS)
    return run.state.time - gap / speed - apart / left, left / speed


@pytest.mark.parametrize("on_wall", [False, True])
@pytest.mark.parametrize("speed", [0.05, 1.0])
def test_elastic_impact_lasts_as_hertz_says(on_wall, speed):
    material = replace(DRY, restitution=1.0)
    time, restitution = impact(material, on_wall=on_wall, speed=speed)
    modulus = material.youngs_modulus / (2.0 * (1.0 - material.poisson_ratio**2))
    mass = material.density * 4.0 / 3.0 * math.pi * RADIUS**3
    share = 1.0 if on_wall else 0.5
    assert time == pytest.approx(hertz_contact_time(share * mass, share * RADIUS, modulus, speed), rel=5e-3)
    assert restitution == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("on_wall", [False, True])
@pytest.mark.parametrize("asked", [0.05, 0.2, 0.5, 0.9])
def test_an_impact_restitutes_what_it_is_asked_to(on_wall, asked):
    # At the usual time step of 0.06 Rayleigh times.
    restitution = impact(replace(DRY, restitution=asked), on_wall=on_wall)[1]
    assert restitution == pytest.approx(asked, abs=2e-3)


def oblique(angle: float, friction: float, restitution: float) -> tuple[float, float]:
    """Tangential speed and spin after a sphere has met a wall at an angle to its normal [rad], at 1 m/s."""
    material = replace(DRY, restitution=restitution, sliding_friction=friction, rolling_friction=0.0)
    model = dem.Model(shapes=(SPHERE,), materials=(material,), shape=[0], gravity=(0, 0, 0), walls=(FLOOR,))
    state = dem.State.at_rest(model, [[0, 0, RADIUS + 1e-6]], velocity=[[math.sin(angle), 0, -math.cos(angle)]])
    run = dem.simulate(model, state, until=4e-4, threads=1)
    assert not run.state.wall_contact_radius.any()
    return float(run.state.velocity[0, 0]), float(run.state.angular_velocity(model)[0, 1])


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_oblique_impact_with_gross_sliding(friction):
    """tan(angle) above 7/2 mu (1 + e) and the sphere slides all the time."""
    angle = math.radians(70.0)
    speed, spin = oblique(angle, friction, 0.9)
    expected = gross_sliding(1.0, angle, 0.9, friction, RADIUS)
    assert (speed, spin) == pytest.approx(expected, rel=5e-3)


# ------------------------------------------------------------------------------------------ incline


def on_incline(
    shape: dem.Shape, height: float, turn: np.ndarray, degrees: float, time: float = 0.06
) -> tuple[float, float]:
    """Speed down an incline at half of a time and at its end [m/s] of a body that is put on it."""
    angle = math.radians(degrees)
    model = dem.Model(shapes=(shape,), materials=(replace(dem.TABLE_10.softened(0.01), surface_energy=0.0),), shape=[0],
                      walls=(FLOOR,), gravity=(GRAVITY * math.sin(angle), 0, -GRAVITY * math.cos(angle)))  # fmt: skip
    half = dem.simulate(model, dem.State.at_rest(model, [[0, 0, height]], [turn]), until=0.5 * time, threads=1).state
    end = dem.simulate(model, half, until=time, threads=1).state
    return float(half.velocity[0, 0]), float(end.velocity[0, 0])


def slides(degrees: float) -> bool:
    """Whether a block 20 x 20 x 10 mm goes on sliding down: it speeds up over the second half."""
    shape, turn = box(0.02, 0.02, 0.01)
    half, end = on_incline(shape, 0.005, turn, degrees)
    return end > half and end > 1e-4


def rolls(degrees: float) -> bool:
    half, end = on_incline(SPHERE, RADIUS, np.array([0.0, 0.0, 0.0, 1.0]), degrees)
    return end > half and end > 1e-4


def test_block_slides_where_the_tangent_is_the_friction():
    friction = math.degrees(math.atan(0.5))
    assert not slides(friction - 0.1)
    assert slides(friction + 0.1)


def test_sphere_rolls_where_the_tangent_is_the_rolling_friction():
    friction = math.degrees(math.atan(0.35))
    assert not rolls(friction - 0.2)
    assert rolls(friction + 0.2)


def test_sliding_block_speeds_up_as_coulomb_says():
    shape, turn = box(0.02, 0.02, 0.01)
    half, end = on_incline(shape, 0.005, turn, 40.0)
    angle = math.radians(40.0)
    assert (end - half) / 0.03 == pytest.approx(GRAVITY * (math.sin(angle) - 0.5 * math.cos(angle)), rel=2e-3)


# ------------------------------------------------------------------------------------------ at rest on walls


def resting_height(dimensions: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """A box at rest on a plane: its centre above half of its thickness, Hertz's overlap, the scale [m]; tilt [rad]."""
    shape, turn = box(*dimensions)
    soft = replace(dem.TABLE_10.softened(0.001), surface_energy=0.0)
    model = dem.Model(shapes=(shape,), materials=(soft,), shape=[0], walls=(FLOOR,))
    state = dem.State.at_rest(model, [[0, 0, 0.5 * dimensions[2]]], [turn])
    run = dem.simulate(model, state, until=0.1, threads=1)
    state = run.state
    up = Rotation.from_quat(state.orientation[0]) * Rotation.from_quat(turn).inv()
    modulus = soft.youngs_modulus / (2.0 * (1.0 - soft.poisson_ratio**2))
    overlap = hertz_overlap(float(model.mass[0]) * GRAVITY, shape.radius, modulus)
    above = float(state.position[0, 2]) - 0.5 * dimensions[2]
    return above, overlap, float(shared_depths(model, run.dt)[0, 0]), float(np.linalg.norm(up.as_rotvec()[:2]))


def test_box_at_rest_stands_on_its_face():
    height, overlap, scale, tilt = resting_height((0.02, 0.015, 0.01))
    # The smooth maximum over the four corners adds ln 4 of its scale to the depth of each.
    assert height + overlap == pytest.approx(scale * math.log(4.0), rel=1e-2)
    assert tilt < 1e-6


def test_a_cube_under_a_platen_does_not_rock():
    """At the usual step a load of 380 N on a face shook it at 37 rad/s while vertices shared by 1e-4 radii alone."""
    shape, turn = box(0.008, 0.00799, 0.00798)
    platen = dem.Plane(point=(0, 0, 0.004), normal=(0, 0, -1), motion=dem.Servo(force=380.0, mass=0.05, time=1e-3))
    floor = dem.Plane(point=(0, 0, -0.004), normal=(0, 0, 1))
    model = dem.Model(shapes=(shape,), materials=(dem.TABLE_10.softened(0.1),), shape=[0], gravity=(0, 0, 0),
                      walls=(floor, platen))  # fmt: skip
    tilted = (Rotation.from_rotvec([1e-5, 2e-5, 0.0]) * Rotation.from_quat(turn)).as_quat()
    spins = dem.simulate(
        model, dem.State.at_rest(model, [[0, 0, 0]], [tilted]), until=2e-3, report=1e-5, threads=1,
        observers={"spin": lambda _, state: {"": float(np.linalg.norm(state.spin))}},
    ).table["spin"]  # fmt: skip
    assert np.sqrt((spins[100:] ** 2).mean()) < 0.01


def test_sphere_at_rest_in_a_cylinder_and_on_a_plane():
    """It lies at the lowest line of a lying cylinder, at the depth of Hertz, and so on a plane."""
    soft = replace(dem.TABLE_10.softened(0.001), surface_energy=0.0)
    cylinder = dem.Cylinder(radius=0.03, axis=(0, 1, 0))
    modulus = soft.youngs_modulus / (2.0 * (1.0 - soft.poisson_ratio**2))
    for walls, start in (((cylinder,), [0.0, 0.0, -0.025]), ((FLOOR,), [0.0, 0.0, 0.005])):
        model = dem.Model(shapes=(SPHERE,), materials=(soft,), shape=[0], walls=walls)
        state = dem.simulate(model, dem.State.at_rest(model, [start]), until=0.05, threads=1).state
        overlap = hertz_overlap(float(model.mass[0]) * GRAVITY, RADIUS, modulus)
        assert start[2] - state.position[0, 2] == pytest.approx(overlap, rel=1e-4)
        assert state.wall_force[0, 2] == pytest.approx(-float(model.mass[0]) * GRAVITY, rel=1e-4)


# ------------------------------------------------------------------------------------------ another program


@pytest.mark.skipif(programs.LAMMPS is None, reason="LAMMPS is not installed (Debian: apt-get install lammps)")
def test_jkr_curve_is_that_of_lammps(tmp_path):
    rows = programs.lammps_jkr(0.005, 5.5e9, 0.3, 0.155, 2e-7, tmp_path)
    contact = NormalContact(modulus=5.5e9 / (2.0 * (1.0 - 0.3**2)), radius=0.0025, energy=0.155)
    rows = rows[rows[:, 1] != 0.0]
    assert len(rows) > 100
    assert np.abs(contact.force(rows[:, 0]) - rows[:, 1]).max() < 1e-6 * contact.pull_off_force
    # LAMMPS lets go at the largest tension, where a force would part them; we at the tear-off, which is farther.
    assert contact.tear_off_overlap < rows[-1, 0] < 0.95 * contact.overlap(contact.tear_off_radius * 9.0 ** (1.0 / 3.0))
