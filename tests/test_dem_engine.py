"""The engine: bits that do not depend on threads or pieces, pairs found, scales."""

from __future__ import annotations

import re
import signal
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import dem, generate
from lithoform.dem.arrays import STALE
from lithoform.dem.broadphase import matching_rows, near_pairs, neighbour_entries
from lithoform.dem.energy import EnergyMonitor
from lithoform.dem.engine import Engine
from lithoform.presets import database_recipe

SOFT = dem.TABLE_10.softened(1e-2)
STONES = tuple(
    dem.Shape.from_mesh(generate(database_recipe(name, seed=3, triangles=800)).mesh)
    for name in ("cube", "plate", "column", "blade")
)


def falling(count: int = 150, *, walls: bool = True) -> tuple[dem.Model, dem.State]:
    """Stones on a lattice, turned at random, that fall into a moving cylinder under a platen."""
    rng = np.random.default_rng(5)
    shape = np.arange(count) % len(STONES)
    side = 5
    place = np.stack(np.unravel_index(np.arange(count), (999, side, side))[::-1], axis=1)
    radius = np.array([stone.bounding_radius for stone in STONES]).max()
    position = (place - [2.0, 2.0, -0.6]) * 1.7 * radius
    scale = rng.uniform(0.7, 0.84, count)
    container = (
        dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),
        dem.Cylinder(radius=6.5 * radius, motion=dem.Motion(angular_velocity=(0, 0, 3.0), nutates=True)),
        dem.Plane(point=(0, 0, position[:, 2].max() + radius), normal=(0, 0, -1),
                  motion=dem.Servo(force=5.0, mass=0.1, time=1e-2, max_speed=1.0)),
    )  # fmt: skip
    model = dem.Model(shapes=STONES, materials=(SOFT,), shape=shape, scale=scale, walls=container if walls else (),
                      gravity=(0, 0, -300.0))  # fmt: skip
    turn = rng.normal(size=(count, 4))
    return model, dem.State.at_rest(model, position, turn, velocity=rng.normal(scale=0.3, size=(count, 3)))


def same(a: dem.State, b: dem.State) -> list[str]:
    """Names of the arrays that differ."""
    return [name for name, array in a.arrays().items() if array.tobytes() != b.arrays()[name].tobytes()]


class TestBits:
    def test_threads_do_not_matter(self):
        model, state = falling()
        ends = [dem.simulate(model, state, until=0.022, threads=threads).state for threads in (1, 2, 3)]
        assert (ends[0].contact_radius > 0.0).sum() > 20
        assert (ends[0].wall_contact_radius > 0.0).sum() > 10
        assert same(ends[0], ends[1]) == []
        assert same(ends[0], ends[2]) == []

    def test_pieces_do_not_matter(self):
        model, state = falling(60)
        whole = dem.simulate(model, state, until=0.01)
        piece = state
        for until in (0.0021, 0.0055, 0.01):
            piece = dem.simulate(model, piece, until=until, dt=whole.dt, report=0.0007).state
        assert piece.step == whole.state.step
        assert piece.time == whole.state.time
        assert same(piece, whole.state) == []

    def test_the_state_given_is_not_changed(self):
        model, state = falling(30)
        before = {name: array.copy() for name, array in state.arrays().items()}
        dem.simulate(model, state, until=0.002)
        assert all(np.array_equal(before[name], array) for name, array in state.arrays().items())
        with pytest.raises(ValueError, match="read-only"):
            state.position[0, 0] = 1.0


class TestPairs:
    @settings(deadline=None, max_examples=25)
    @given(seed=st.integers(0, 10**6), count=st.integers(2, 120), spread=st.floats(1.0, 8.0))
    def test_all_near_pairs_of_all_sizes_are_found(self, seed, count, spread):
        rng = np.random.default_rng(seed)
        bound = np.exp(rng.uniform(0.0, np.log(spread), count))
        position = rng.uniform(0.0, 3.0 * count ** (1 / 3), (count, 3))
        i, j = np.triu_indices(count, 1)
        near = np.linalg.norm(position[i] - position[j], axis=1) < bound[i] + bound[j] + 0.1
        assert np.array_equal(near_pairs(position, bound, 0.1), np.stack([i[near], j[near]], axis=1))

    def test_entries_name_the_pairs_of_each_block_in_order(self):
        pairs = np.array([[0, 2], [0, 3], [1, 2], [2, 3]])
        first, entries = neighbour_entries(pairs, 5)
        assert first.tolist() == [0, 2, 3, 6, 8, 8]
        assert entries.tolist() == [0, 2, 4, 1, 5, 6, 3, 7]

    def test_rows_are_matched(self):
        old, new = np.array([[0, 1], [0, 4], [2, 3]]), np.array([[0, 4], [1, 2], [2, 3], [3, 4]])
        there, here = matching_rows(old, new, 5)
        assert there.tolist() == [1, 2]
        assert here.tolist() == [0, 2]

    def test_what_is_not_looked_at_does_not_touch(self):
        # Every pair that GJK finds in contact is one whose force the engine has; the lists are made anew in between.
        model, state = falling()
        end = dem.simulate(model, state, until=0.022).state
        with Engine(model, replace(end, fresh=True), 1e-6, device="cpu") as engine:
            engine.find_pairs()
            pair, gap = engine.gaps
        # Positions are one step ahead of the forces: less than a step's way into one another is not yet a contact.
        ahead = 2.0 * np.linalg.norm(end.velocity, axis=1).max() * end.clock[2]
        touching = {tuple(row) for row in pair[gap < -ahead].tolist()}
        known = {tuple(row) for row in end.pair[end.contact_radius > 0.0].tolist()}
        assert len(touching) > 10
        assert touching <= known


class TestScales:
    def test_the_cases_of_the_specification(self):
        # 55 GPa at 600 kPa: kappa 2165; a tenth: 466. 8e-8 s is below the Rayleigh time of the smallest grain.
        grain = dem.Shape.sphere(0.00118)
        model = dem.Model(shapes=(grain,), materials=(dem.TABLE_10,), shape=[0])
        assert dem.scales(model, 600e3).kappa == pytest.approx(2165, abs=1)
        softer = dem.Model(shapes=(grain,), materials=(dem.TABLE_10.softened(0.1),), shape=[0])
        assert dem.scales(softer, 600e3).kappa == pytest.approx(466, abs=1)
        assert dem.scales(model).rayleigh_time > 8e-8
        # r sqrt(rho / G) = 1.18 mm / 2825 m/s; pi / (0.1631 0.3 + 0.8766) = 3.394.
        assert dem.scales(model).rayleigh_time == pytest.approx(3.394 * 0.00118 / 2825.4, rel=1e-3)

    def test_inertial_number_and_pull_off(self):
        model = dem.Model(shapes=(dem.Shape.sphere(0.005),), materials=(dem.TABLE_10,), shape=[0, 0], scale=[1.0, 0.5])
        found = dem.scales(model, 600e3, rate=2.0)
        assert found.inertial_number == pytest.approx(2.0 * 0.01 * np.sqrt(2650 / 600e3))
        assert found.inertial_number_median == pytest.approx(0.75 * found.inertial_number)
        radius = 0.00375
        weight = 2650 * 4 / 3 * np.pi * radius**3 * 9.81
        assert found.pull_off_to_weight == pytest.approx(3 * np.pi * 0.155 * radius / 2 / weight)

    def test_a_run_for_a_person_tells_its_scales(self, capsys):
        model, state = falling(20)
        dem.simulate(model, state, until=1e-5, progress=True)
        assert re.match(r"20 blocks: step .* s \(Rayleigh time .*; \d+ steps, about \d+ s\.\n", capsys.readouterr().err)
        dem.simulate(model, state, until=1e-5)
        assert capsys.readouterr().err == ""

    def test_the_cost_is_that_of_this_machine(self):
        model = dem.Model(shapes=(dem.Shape.sphere(0.005),), materials=(dem.TABLE_10,), shape=np.zeros(100, int))
        found = dem.scales(model, 600e3, duration=1.0, threads=1)
        assert found.steps == np.ceil(1.0 / found.step)
        assert found.hours == pytest.approx(found.steps * 100 / 3600 / dem_rate(), rel=1e-9)
        assert "steps, about" in found.text()
        assert f"kappa {found.kappa:.0f}" in found.text()


def dem_rate() -> float:
    from lithoform.dem.scales import measured_rate

    return measured_rate(1)


class TestTwisting:
    def test_a_ball_that_spins_on_the_spot_is_braked_by_the_disc_of_contact(self):
        # Torque 3 pi / 16 mu a m g at full slip under the pressure of Hertz (Johnson 1985, 7.4).
        rock = replace(SOFT, surface_energy=0.0)
        radius = 0.005
        floor = dem.Plane(point=(0, 0, 0), normal=(0, 0, 1))
        model = dem.Model(shapes=(dem.Shape.sphere(radius),), materials=(rock,), shape=[0], walls=(floor,))
        weight, modulus = model.mass[0] * 9.81, rock.youngs_modulus / (2.0 * (1.0 - rock.poisson_ratio**2))
        disc = (3.0 * weight * radius / (4.0 * modulus)) ** (1.0 / 3.0)
        start = dem.State.at_rest(model, [[0, 0, radius - disc**2 / radius]], angular_velocity=[[0, 0, 5.0]])
        spins = dem.simulate(model, start, until=0.2, report=0.05, observers={"spin": spin_about_z}).table["spin_z"]
        braking = 3.0 * np.pi / 16.0 * rock.sliding_friction * disc * weight / model.inertia[0, 2]
        assert np.diff(spins) == pytest.approx(-0.05 * braking, rel=0.01)

    def test_it_comes_to_rest(self):
        model = dem.Model(shapes=STONES[:1], materials=(SOFT,), shape=[0],
                          walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))  # fmt: skip
        lowest = STONES[0].core.vertices[:, 2].min() - STONES[0].core.margin
        start = dem.State.at_rest(model, [[0, 0, -lowest]], angular_velocity=[[0, 0, 3.0]])
        end = dem.simulate(model, start, until=0.7).state
        assert np.linalg.norm(end.angular_velocity(model)) < 1e-3


def spin_about_z(model: dem.Model, state: dem.State) -> dict[str, float]:
    return {"z": float(state.angular_velocity(model)[0, 2])}


class TestKernelsOfAGpu:
    def test_they_do_what_the_loop_of_a_processor_does(self):
        model, state = falling(60)
        state = dem.simulate(model, state, until=0.012).state
        dt = state.clock[2]
        loop, kernels = (Engine(model, state, dt, device="cpu", threads=1) for _ in range(2))
        kernels.scene.kick = dt
        for _ in range(20):
            made = loop.run(15)
            # Below sixteen steps no graph is made, so that a processor can run them.
            also = kernels._launch_gpu(15)
            kernels.step += also.steps
            if also.flags:
                assert also.flags == STALE
                kernels.find_pairs()
            assert also.steps == made.steps
        assert kernels.step > state.step + 50
        assert (kernels.state().contact_radius > 0.0).sum() > 3
        assert same(loop.state(), kernels.state()) == []


class TestEnergyMonitor:
    def test_it_says_when_energy_comes_from_nothing(self):
        monitor = EnergyMonitor()
        monitor.look(dem.Energy(kinetic=1.0, potential=0.0, elastic=0.0, work=0.0), 0.1)
        monitor.look(dem.Energy(kinetic=0.8, potential=0.0, elastic=0.1, work=0.0), 0.2)
        # What a wall puts in is not from nothing.
        monitor.look(dem.Energy(kinetic=2.9, potential=0.0, elastic=0.0, work=2.0), 0.3)
        assert monitor.growth == 0.0
        with pytest.warns(dem.EnergyWarning, match=r"grew by 0\.1 J without work until t = 0\.4 s"):
            monitor.look(dem.Energy(kinetic=3.0, potential=0.0, elastic=0.0, work=2.0), 0.4)

    def test_it_is_silent_over_falls_impacts_and_rest(self):
        model, state = falling(60)
        run = dem.simulate(model, state, until=0.02, report=1e-4)
        assert run.energy_growth < 1e-3 * dem.energy(model, run.state).kinetic


class TestStages:
    def test_a_new_motion_has_its_own_pivot(self):
        ball = dem.Shape.sphere(0.005)
        wall = dem.Plane(point=(0, 0, -0.1), normal=(0, 0, 1))
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0], walls=(wall,), gravity=(0, 0, 0))
        state = dem.simulate(model, dem.State.at_rest(model, [[0, 0, 0.1]]), until=1e-4).state
        turning = model.with_motion(0, dem.Motion(angular_velocity=(10.0, 0, 0), pivot=(0, 1.0, 0)))
        end = dem.simulate(turning, state, until=0.0101)
        angle = 10.0 * (end.state.time - state.time)
        y, z = -1.0, -0.1
        expected = [1.0 + np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z]
        assert end.state.wall_point[0, 1:] == pytest.approx(expected, abs=1e-12)

    def test_a_servo_that_was_held_starts_from_rest(self):
        ball = dem.Shape.sphere(0.005)
        platen = dem.Plane(point=(0, 0, 1.0), normal=(0, 0, -1), motion=dem.Servo(force=1.0, mass=0.1))
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0], walls=(platen,), gravity=(0, 0, 0))
        state = dem.simulate(model, dem.State.at_rest(model, [[0, 0, 0.0]]), until=0.01).state
        assert state.wall_speed[0] == pytest.approx(0.1, rel=1e-3)
        state = dem.simulate(model.with_motion(0, dem.Motion()), state, until=0.02).state
        state = dem.simulate(model, state, until=0.0201).state
        assert state.wall_speed[0] == pytest.approx(0.001, rel=0.1)

    def test_a_finished_run_may_be_asked_for_again(self):
        model, state = falling(30)
        run = dem.simulate(model, state, until=1e-3)
        again = dem.simulate(model, run.state, until=1e-3)
        assert again.state.step == run.state.step
        assert same(again.state, run.state) == []
        # Its end is reported all the same.
        assert again.table["step"].tolist() == [run.state.step]

    def test_walls_that_stay_keep_their_contacts(self):
        ball = dem.Shape.sphere(0.005)
        floor = dem.Plane(point=(0, 0, 0), normal=(0, 0, 1))
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0, 0], walls=(floor,), gravity=(3.0, 0, -9.81))
        state = dem.State.at_rest(model, [[0, 0, 0.005], [0.02, 0, 0.005]])
        state = dem.simulate(model, state, until=0.01).state
        assert np.linalg.norm(state.wall_spring, axis=1).min() > 0.0
        lid = dem.Plane(point=(0, 0, 0.02), normal=(0, 0, -1))
        more = state.with_walls_of(model.with_walls(floor, lid))
        assert (more.wall_spring.reshape(2, 2, 3)[:, 0] == state.wall_spring).all()
        assert (more.wall_spring.reshape(2, 2, 3)[:, 1] == 0.0).all()
        assert more.wall_force[0].tolist() == state.wall_force[0].tolist()
        # Another order of the walls is another wall of that number.
        turned = state.with_walls_of(model.with_walls(lid, floor))
        assert (turned.wall_spring == 0.0).all()
        # What goes on between the same walls is the same to the last bit.
        until = state.time + 1e-3
        plain, kept = (dem.simulate(model, s, until=until).state for s in (state, state.with_walls_of(model)))
        assert same(plain, kept) == []

    def test_reports_count_from_where_the_time_step_was_taken(self):
        ball = dem.Shape.sphere(0.005)
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0], gravity=(0, 0, 0))
        first = dem.simulate(model, dem.State.at_rest(model, [[0, 0, 0]]), until=7e-6, dt=1e-6)
        assert first.state.step == 7
        whole = dem.simulate(model, first.state, until=7e-6 + 40e-6, dt=2e-6, report=10e-6)
        assert whole.table["step"].tolist() == [12, 17, 22, 27]
        # Stopped between reports, it goes on with the same ones.
        part = dem.simulate(model, first.state, until=7e-6 + 16e-6, dt=2e-6, report=10e-6)
        rest = dem.simulate(model, part.state, until=7e-6 + 40e-6, dt=2e-6, report=10e-6)
        assert part.table["step"].tolist() == [12, 15]
        assert rest.table["step"].tolist() == [17, 22, 27]

    def test_an_interrupt_does_not_lose_the_report_of_its_step(self):
        ball = dem.Shape.sphere(0.005)
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0], gravity=(0, 0, 0))
        reported = []

        def note(_: dem.Model, state: dem.State) -> None:
            reported.append(state.step)

        def interrupt(_: dem.Model, state: dem.State) -> dict[str, float]:
            if state.step == 10:
                signal.raise_signal(signal.SIGINT)
            return {"": 0.0}

        with pytest.raises(KeyboardInterrupt):
            dem.simulate(model, dem.State.at_rest(model, [[0, 0, 0]]), until=1e-3, dt=1e-6, report=5e-6, on_report=note,
                         observers={"interrupt": interrupt})  # fmt: skip
        assert reported == [5, 10]

    def test_a_cylinder_carried_about_a_distant_pivot_does_work(self):
        # A ball is carried along by the wall that hits it: what it gains is the work of the wall.
        rock = replace(SOFT, restitution=1.0, sliding_friction=0.0, rolling_friction=0.0, surface_energy=0.0)
        for nutates in (False, True):
            motion = dem.Motion(angular_velocity=(0, 0, 20.0), nutates=nutates)
            wall = dem.Cylinder(point=(0.05, 0, 0), radius=0.01, motion=motion)
            model = dem.Model(shapes=(dem.Shape.sphere(0.005),), materials=(rock,), shape=[0], walls=(wall,),
                              gravity=(0, 0, 0))  # fmt: skip
            end = dem.simulate(model, dem.State.at_rest(model, [[0.05, 0, 0]]), until=0.01, report=1e-4).state
            found = dem.energy(model, end)
            assert found.kinetic > 1e-4
            assert found.work == pytest.approx(found.total, rel=2e-3)

    def test_the_work_of_a_light_servo_is_that_of_its_mean_speed(self):
        rock = replace(SOFT, restitution=1.0, surface_energy=0.0)
        platen = dem.Plane(point=(0, 0, 0.0), normal=(0, 0, 1), motion=dem.Servo(force=0.0, mass=0.001))
        model = dem.Model(shapes=(dem.Shape.sphere(0.005),), materials=(rock,), shape=[0], walls=(platen,),
                          gravity=(0, 0, 0))  # fmt: skip
        start = dem.State.at_rest(model, [[0, 0, 0.00501]], velocity=[[0, 0, -1.0]])
        end = dem.simulate(model, start, until=3e-4).state
        before, after = 0.5 * model.mass[0], dem.energy(model, end)
        assert after.elastic == 0.0
        assert after.kinetic - after.work == pytest.approx(before, rel=1e-3)


class TestTwistingEnergy:
    def test_a_twisted_contact_that_shrinks_does_not_make_energy(self):
        rock = replace(SOFT, restitution=1.0, surface_energy=0.0)
        floor = dem.Plane(point=(0, 0, 0), normal=(0, 0, 1))
        model = dem.Model(shapes=(dem.Shape.sphere(0.005),), materials=(rock,), shape=[0], walls=(floor,))
        start = dem.State.at_rest(model, [[0, 0, 0.00501]], velocity=[[0, 0, -0.2]], angular_velocity=[[0, 0, 40.0]])
        run = dem.simulate(model, start, until=0.05, report=1e-5)
        assert run.energy_growth < 1e-4 * dem.energy(model, start).kinetic
