"""Motion against closed forms: flight, the free rotor, momentum and energy of a closed system, walls that move."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from dem_oracles import free_rotor
from peers import programs
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_dem_contact import FLOOR, GRAVITY, RADIUS, SPHERE, box

from lithoform import database_recipe, dem, generate
from lithoform.presets import SHAPE_CLASSES

SOFT = dem.TABLE_10.softened(0.01)
DRY = replace(SOFT, surface_energy=0.0)


@lru_cache(maxsize=1)
def stones() -> tuple[dem.Shape, ...]:
    """Four stones, one a class, of 10 mm."""
    meshes = [generate(database_recipe(name, seed=7).replace(triangles=2000)).mesh for name in SHAPE_CLASSES]
    return tuple(dem.Shape.from_mesh(mesh.with_vertices(mesh.vertices * (0.01 / np.ptp(mesh.vertices, axis=0).max())))
                 for mesh in meshes)  # fmt: skip


# ------------------------------------------------------------------------------------------ one body


def test_projectile_flies_as_galilei_says():
    model = dem.Model(shapes=stones()[:1], materials=(DRY,), shape=[0], gravity=(0.3, -1.0, -GRAVITY))
    x0, v0 = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    state = dem.State.at_rest(model, [x0], velocity=[v0])
    state = dem.simulate(model, state, until=0.05, threads=1).state
    t = state.time
    assert state.position[0] == pytest.approx(x0 + v0 * t + 0.5 * np.array(model.gravity) * t**2, abs=1e-10)
    # Velocities are half a step behind.
    assert state.velocity[0] == pytest.approx(v0 + np.array(model.gravity) * (t - state.lag), abs=1e-10)


def rotor(turns: float, step: float, spin=(40.0, 0.0, 90.0)) -> dict[str, float]:
    """Errors of a free box of 20 x 14 x 10 mm after some turns, at a step that is a share of a turn."""
    shape, _ = box(0.02, 0.014, 0.01)
    # A large sphere far away lets the list of pairs last longer: its skin goes with the mean size.
    model = dem.Model(shapes=(shape, dem.Shape.sphere(1.0)), materials=(DRY,), shape=[0, 1], gravity=(0, 0, 0))
    # Principal axes are those of the frame, moments ascending.
    spin = np.array(spin)
    state = dem.State.at_rest(model, [[0, 0, 0], [100, 0, 0]], angular_velocity=[spin, [0, 0, 0]])
    begin = state.angular_momentum[0]
    inertia = model.inertia[0]
    energy = float((inertia * spin**2).sum()) / 2.0
    period = 2.0 * math.pi / float(np.linalg.norm(spin))
    dt = step * period
    # A softer material, since the largest step that is let pass belongs to contacts, and this body has none.
    slow = min(1.0, (0.1 * dem.rayleigh_time(shape.radius, DRY) / dt) ** 2)
    model = replace(model, materials=(DRY.softened(slow),))
    drift = wrong = 0.0
    for part in range(1, 21):
        state = dem.simulate(model, state, until=turns * period * part / 20.0, dt=dt, threads=1).state
        local = Rotation.from_quat(state.orientation[0]).inv().apply(np.array(state.angular_momentum[0])) / inertia
        drift = max(drift, abs(float((inertia * local**2).sum()) / 2.0 / energy - 1.0))
        exact = free_rotor(inertia, spin, np.array([state.time]))[0]
        wrong = max(wrong, float(np.linalg.norm(np.abs(local) - np.abs(exact)) / np.linalg.norm(spin)))
    off = float(np.linalg.norm(state.angular_momentum[0] - begin) / np.linalg.norm(begin))
    return {"momentum": off, "energy": drift, "angular velocity": wrong}


def test_closed_form_of_the_rotor_solves_the_equations_of_euler():
    inertia = np.array([1.0, 1.7, 2.3])

    def euler(_, w):
        l = inertia * w
        return np.cross(l, w) / inertia

    for spin in ([1.0, 0.0, 0.5], [0.5, 0.0, 1.0]):
        times = np.linspace(0.0, 20.0, 9)
        solved = solve_ivp(euler, (0.0, 20.0), spin, t_eval=times, rtol=1e-11, atol=1e-12).y.T
        # The sense in which the second component starts is that of the equations.
        exact = free_rotor(inertia, np.array(spin), times)
        sense = np.sign(euler(0.0, spin)[1])
        assert exact * [1.0, sense, 1.0] == pytest.approx(solved, abs=1e-8)


@pytest.mark.parametrize("spin", [(40.0, 0.0, 90.0), (90.0, 0.0, 40.0)])
def test_free_asymmetric_rotor(spin):
    errors = rotor(100.0, 1e-3, spin)
    assert errors["momentum"] < 1e-14
    assert errors["energy"] < 1e-4
    # Second order in the step: the phase drifts with the turns.
    coarse, fine = rotor(20.0, 2e-3, spin), rotor(20.0, 1e-3, spin)
    assert coarse["angular velocity"] / fine["angular velocity"] == pytest.approx(4.0, rel=0.1)
    assert fine["angular velocity"] < 1e-2


# ------------------------------------------------------------------------------------------ closed systems


def cloud(side: int = 3, spacing: float = 0.0112) -> tuple[dem.Model, dem.State]:
    """Stones in a cubic lattice that fly into one another, without gravity or walls."""
    grid = np.array(list(itertools.product(range(side), repeat=3)), dtype=float) - 0.5 * (side - 1)
    n = len(grid)
    rng = np.random.default_rng(5)
    model = dem.Model(shapes=stones(), materials=(SOFT,), shape=np.arange(n) % 4, scale=rng.uniform(0.7, 1.0, n),
                      gravity=(0, 0, 0))  # fmt: skip
    state = dem.State.at_rest(model, grid * spacing + [0.01, -0.02, 0.03], Rotation.random(n, random_state=3).as_quat(),
                              velocity=-40.0 * grid * spacing + rng.normal(0.0, 0.1, (n, 3)),
                              angular_velocity=rng.normal(0.0, 20.0, (n, 3)))  # fmt: skip
    return model, state


def momenta(model: dem.Model, state: dem.State) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Momentum, angular momentum about the origin, and what adds up to both without signs.

    With positions at whole and momenta at half steps x cross m v is the same half a step before and after.
    """
    p = model.mass[:, None] * state.velocity
    orbital = np.cross(state.position, p)
    total = orbital + state.angular_momentum
    return (p.sum(axis=0), total.sum(axis=0), float(np.linalg.norm(p, axis=1).sum()),
            float(np.linalg.norm(orbital, axis=1).sum()))  # fmt: skip


def closed_system(until: float, side: int = 3) -> dict[str, float]:
    """Changes of the momenta, as shares of what flies about, and the growth of energy, as a share of the start's."""
    model, state = cloud(side)
    before = momenta(model, state)
    first = dem.energy(model, state).total

    def observed(m: dem.Model, s: dem.State) -> dict[str, float]:
        return {"e": dem.energy(m, s).total, "n": float((s.contact_radius > 0.0).sum())}

    run = dem.simulate(model, state, until=until, report=2e-4, threads=1, observers={"all": observed})
    after = momenta(model, run.state)
    energies = np.concatenate([[first], run.table["all_e"]])
    return {
        "momentum": float(np.linalg.norm(after[0] - before[0]) / before[2]),
        "angular momentum": float(np.linalg.norm(after[1] - before[1]) / before[3]),
        "growth": float((energies - np.minimum.accumulate(energies)).max() / first),
        "left": float(energies[-1] / first),
        "contacts": float(run.table["all_n"].max()),
    }


def test_closed_system_of_colliding_stones():
    found = closed_system(0.02)
    # A few thousand steps of a few tens of contacts: rounding adds up like a walk.
    assert found["momentum"] < 1e-12
    assert found["angular momentum"] < 1e-12
    assert found["growth"] < 2e-3
    # They did collide.
    assert found["contacts"] > 10
    assert found["left"] < 0.9


# ------------------------------------------------------------------------------------------ walls that move


def test_lifting_plane_does_the_work_that_the_stone_gains():
    model = dem.Model(shapes=stones()[:1], materials=(DRY,), shape=[0], walls=(FLOOR,))
    state = dem.State.at_rest(model, [[0, 0, 0.0051]])
    state = dem.simulate(model, state, until=0.3, threads=1).state
    rest = dem.energy(model, state)
    lifting = model.with_motion(0, dem.Motion(velocity=(0.0, 0.0, 0.05)))
    run = dem.simulate(lifting, state, until=0.5, threads=1)
    after = dem.energy(lifting, run.state)
    risen = run.state.position[0, 2] - state.position[0, 2]
    assert run.state.wall_point[0, 2] == pytest.approx(0.05 * (run.state.time - state.time), rel=1e-9)
    assert risen == pytest.approx(run.state.wall_point[0, 2], rel=1e-3)
    assert after.potential - rest.potential == pytest.approx(float(model.mass[0]) * GRAVITY * risen, rel=1e-3)
    # What the impact of the start turned into heat is work too: half m v^2, of a wall that does not give way.
    kick = 0.5 * float(model.mass[0]) * 0.05**2
    assert after.work - rest.work == pytest.approx(after.total - rest.total + kick, rel=2e-3)


def test_servo_presses_with_the_force_asked_for():
    mass = float(dem.Model(shapes=(SPHERE,), materials=(DRY,), shape=[0]).mass[0])
    for force in (0.5, 20.0):
        servo = dem.Servo(force=force, mass=10.0 * mass, time=5e-4, max_speed=0.2)
        top = dem.Plane(point=(0, 0, 2 * RADIUS + 1e-4), normal=(0, 0, -1), motion=servo)
        model = dem.Model(shapes=(SPHERE,), materials=(DRY,), shape=[0], walls=(FLOOR, top))
        state = dem.simulate(model, dem.State.at_rest(model, [[0, 0, RADIUS]]), until=0.1, threads=1).state
        # Upwards on the upper plane, downwards on the floor, which carries the weight too.
        assert state.wall_force[1, 2] == pytest.approx(force, rel=1e-6)
        assert state.wall_force[0, 2] == pytest.approx(-force - mass * GRAVITY, rel=1e-6)
        assert abs(state.wall_speed[1]) < 1e-9


def test_servo_without_blocks_moves_as_newton_and_its_damping_say():
    """Speed force / mass time (1 - exp(-t / time)) until the largest speed."""
    servo = dem.Servo(force=2.0, mass=1.0, time=0.01)
    far = dem.Plane(point=(0, 0, 1), normal=(0, 0, -1), motion=servo)
    model = dem.Model(shapes=(SPHERE,), materials=(DRY,), shape=[0], walls=(far,), gravity=(0, 0, 0))
    state = dem.simulate(model, dem.State.at_rest(model, [[0, 0, 0]]), until=0.02, dt=2e-6, threads=1).state
    assert state.wall_speed[0] == pytest.approx(0.02 * (1.0 - math.exp(-2.0)), rel=1e-3)
    assert 1.0 - state.wall_point[0, 2] == pytest.approx(0.02 * (0.02 - 0.01 * (1.0 - math.exp(-2.0))), rel=1e-3)
    limited = model.with_motion(0, replace(servo, max_speed=0.005))
    state = dem.simulate(limited, dem.State.at_rest(limited, [[0, 0, 0]]), until=0.02, dt=2e-6, threads=1).state
    assert state.wall_speed[0] == 0.005


@pytest.mark.parametrize("nutates", [False, True])
def test_walls_are_carried_round_as_told(nutates):
    """A tilted cylinder and a plane, carried about a moving pivot: place and direction after some turns."""
    turning = np.array([3.0, -20.0, 50.0])
    motion = dem.Motion(
        velocity=(0.1, 0.2, -0.3), angular_velocity=tuple(turning), pivot=(0.01, 0.02, 0.03), nutates=nutates
    )
    axis, normal = np.array([math.sin(0.02), 0.0, math.cos(0.02)]), np.array([0.0, math.sin(0.1), math.cos(0.1)])
    walls = (dem.Cylinder(radius=0.1, point=(0.011, 0.02, 0.0), axis=tuple(axis), motion=motion),
             dem.Plane(point=(0.0, 0.0, -0.1), normal=tuple(normal), motion=motion))  # fmt: skip
    model = dem.Model(shapes=(SPHERE,), materials=(DRY,), shape=[0], walls=walls, gravity=(0, 0, 0))
    state = dem.simulate(model, dem.State.at_rest(model, [[0.01, 0.02, 0.03]]), until=0.1, threads=1).state
    turn = Rotation.from_rotvec(turning * state.time)
    pivot = np.array(motion.pivot) + np.array(motion.velocity) * state.time
    for k, (wall, direction) in enumerate(zip(walls, (axis, normal), strict=True)):
        assert state.wall_direction[k] == pytest.approx(turn.apply(direction), abs=1e-10)
        expected = pivot + turn.apply(np.array(wall.point) - motion.pivot)
        assert state.wall_point[k] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("nutates", [False, True])
def test_turning_cylinder_drags_a_sphere_and_a_nutating_one_does_not(nutates):
    """At the lowest line of a cylinder that turns about its axis the sphere ends up rolling: spin r = turn R."""
    turn, reach = 5.0, 0.03
    rolling = replace(DRY, rolling_friction=0.0)
    cylinder = dem.Cylinder(
        radius=reach, axis=(0, 1, 0), motion=dem.Motion(angular_velocity=(0, turn, 0), nutates=nutates)
    )
    model = dem.Model(shapes=(SPHERE,), materials=(rolling,), shape=[0], walls=(cylinder,))
    state = dem.State.at_rest(model, [[0, 0, -(reach - RADIUS)]])
    state = dem.simulate(model, state, until=0.5, threads=1).state
    spin = state.angular_velocity(model)[0]
    # While it slid it was dragged up the side, and now rolls to and fro: its own motion along the wall is taken off.
    along = float(np.dot(state.velocity[0], np.cross([0, 1, 0], state.position[0] / np.linalg.norm(state.position[0]))))
    if nutates:
        assert np.linalg.norm(spin) == np.linalg.norm(state.velocity[0][:2]) == 0.0
    else:
        assert spin[1] * RADIUS == pytest.approx(turn * reach - along, rel=2e-3)


def test_turning_floor_carries_a_block_round():
    """A block on a plane that turns about the block's own axis ends up turning with it; a nutating plane leaves it."""
    shape, upright = box(0.01, 0.01, 0.01)
    for nutates in (False, True):
        floor = replace(FLOOR, motion=dem.Motion(angular_velocity=(0, 0, 2.0), nutates=nutates))
        model = dem.Model(shapes=(shape,), materials=(DRY,), shape=[0], walls=(floor,))
        state = dem.State.at_rest(model, [[0.02, 0, 0.005]], [upright])
        state = dem.simulate(model, state, until=0.2, threads=1).state
        if nutates:
            assert np.linalg.norm(state.position[0][:2] - [0.02, 0.0]) < 1e-9
        else:
            angle = math.atan2(state.position[0, 1], state.position[0, 0])
            assert angle == pytest.approx(0.4, rel=0.05)


# ------------------------------------------------------------------------------------------ other programs


@pytest.mark.parametrize("program", ["LAMMPS", "YADE"])
def test_a_few_spheres_pack_as_with_another_program(program, tmp_path):
    """Small and short: one packing of 40 spheres; benchmarks/verification.py compares packings of 500."""
    if getattr(programs, program) is None:
        pytest.skip(f"{program} is not installed (Debian: apt-get install {program.lower()})")
    case = programs.Box(seed=1, count=48, side=4, time=0.3)
    ours = case.by_lithoform()
    theirs = case.by_lammps(tmp_path) if program == "LAMMPS" else case.by_yade(tmp_path)
    assert ours.shape == theirs.shape
    # All lie in the box, and the beds are as high as each other.
    for centres in (ours, theirs):
        assert centres.min() > 0.99 * case.radius
        assert centres[:, :2].max() < case.width - 0.99 * case.radius
    assert ours[:, 2].mean() == pytest.approx(theirs[:, 2].mean(), rel=0.05)
