"""What cannot be simulated is refused, and what goes wrong on the way ends in one clear error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lithoform import dem
from lithoform.errors import LithoformError, MeshError, SceneError, SimulationError
from lithoform.mesh import Mesh
from lithoform.topology import sphere

SOFT = dem.TABLE_10.softened(1e-3)
FLOOR = dem.Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
BALL = dem.Shape.sphere(0.005)


def model(count: int = 2, **changes) -> dem.Model:
    given = {"shapes": (BALL,), "materials": (SOFT,), "shape": np.zeros(count, int), "walls": (FLOOR,), **changes}
    return dem.Model(**given)


def box(a: float = 0.01, b: float = 0.01, c: float = 0.01) -> Mesh:
    ball = sphere("octahedral", 1)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [a / 2, b / 2, c / 2]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    assert len(ball.faces) == 8
    return Mesh(corners, [face for p, q, r, s in sides for face in ((p, q, r), (p, r, s))])


class TestAtTheStart:
    def test_blocks_in_one_another_are_refused_with_their_numbers(self):
        state = dem.State.at_rest(model(3), [[0, 0, 0.01], [0.1, 0, 0.01], [0.109, 0, 0.01]])
        with pytest.raises(
            SimulationError, match=r"blocks 1 and 2 overlap by 0\.001 m or more at the start: put"
        ) as told:
            dem.simulate(model(3), state, until=0.01)
        assert told.value.bodies == (1, 2)

    def test_blocks_at_one_place_are_refused(self):
        stone = dem.Shape.from_mesh(box())
        scene = model(shapes=(stone,))
        with pytest.raises(SimulationError, match="blocks 0 and 1 overlap"):
            dem.simulate(scene, dem.State.at_rest(scene, [[0, 0, 0.01]] * 2), until=0.01)

    def test_all_pairs_are_counted(self):
        scene = model(4)
        with pytest.raises(SimulationError, match=r"at the start \(and 1 more\)"):
            dem.simulate(scene, dem.State.at_rest(scene, [[x, 0, 0.02] for x in (0, 0.009, 0.1, 0.109)]), until=0.01)

    def test_touching_blocks_are_not_refused(self):
        scene = model(2)
        run = dem.simulate(scene, dem.State.at_rest(scene, [[0, 0, 0.005], [0.01, 0, 0.005]]), until=1e-4)
        assert run.state.step > 0

    def test_a_block_outside_the_container_is_told(self):
        scene = model(2, walls=(FLOOR, dem.Cylinder(radius=0.02)))
        state = dem.State.at_rest(scene, [[0, 0, 0.01], [0.03, 0, 0.01]])
        with pytest.raises(SimulationError, match=r"the centre of block 1 is outside a wall at t = 0 s") as told:
            dem.simulate(scene, state, until=0.01)
        assert told.value.bodies == (1,)

    def test_a_block_through_a_wall_is_told(self):
        stone = dem.Shape.from_mesh(box())
        scene = model(1, shapes=(stone,))
        for turn, depth in ((stone.orientation, "0.001"), ([0.3, 0.2, -0.1, 1.0], r"0\.00\d+")):
            state = dem.State.at_rest(scene, [[0, 0, 0.004]], [turn])
            with pytest.raises(SimulationError, match=rf"block 0 is {depth} m inside wall 0 at the start") as told:
                dem.simulate(scene, state, until=0.01)
            assert told.value.bodies == (0,)

    def test_a_ball_in_a_wall_is_told(self):
        with pytest.raises(SimulationError, match=r"block 0 is 0\.002 m inside wall 0"):
            dem.simulate(model(1), dem.State.at_rest(model(1), [[0, 0, 0.003]]), until=0.01)
        around = model(1, walls=(dem.Cylinder(radius=0.02),))
        with pytest.raises(SimulationError, match=r"block 0 is 0\.001 m inside wall 0"):
            dem.simulate(around, dem.State.at_rest(around, [[0.016, 0, 0]]), until=0.01)

    def test_walls_through_blocks_are_refused(self):
        state = dem.State.at_rest(model(1), [[0, 0, 0.006]])
        lid = dem.Plane(point=(0, 0, 0.009), normal=(0, 0, -1))
        with pytest.raises(SceneError, match=r"block 0 would be 0\.002 m inside wall 1: move that wall"):
            state.with_walls_of(model(1, walls=(FLOOR, lid)))

    def test_a_pair_of_materials_is_told_once(self):
        with pytest.raises(SceneError, match="each pair of materials once"):
            model(1, materials=(SOFT, SOFT), pairs={(0, 1): dem.PairConstants(), (1, 0): dem.PairConstants()})

    @pytest.mark.parametrize("name", ["position", "orientation", "velocity", "angular_velocity"])
    def test_no_number_is_refused_by_name(self, name):
        given = {"position": np.full((2, 3), 0.5), "orientation": np.ones((2, 4)), "velocity": np.zeros((2, 3)),
                 "angular_velocity": np.zeros((2, 3))}  # fmt: skip
        given[name][1, 0] = np.nan
        with pytest.raises(SceneError, match=f"the {name.replace('_', ' ')} of block 1 is"):
            dem.State.at_rest(model(2), **given)

    def test_a_state_of_another_model_is_refused(self):
        with pytest.raises(SceneError, match="expected a state of 3 blocks, got one of 2"):
            dem.simulate(model(3), dem.State.at_rest(model(2), [[0, 0, 1], [0, 0, 2]]), until=1.0)

    def test_a_state_of_other_blocks_or_walls_is_refused(self):
        state = dem.State.at_rest(model(2), [[0, 0, 1], [0, 0, 2]])
        with pytest.raises(SceneError, match="blocks of other shapes or sizes"):
            dem.simulate(model(2, scale=[1.0, 2.0]), state, until=1.0)
        around = model(2, walls=(dem.Cylinder(radius=1.0),))
        for other in (around, model(2, walls=())):
            with pytest.raises(SceneError, match=r"with the model's [01] walls, got one with 1 walls"):
                dem.simulate(other, state, until=1.0)
        with pytest.raises(SceneError, match="or of other kinds or radii"):
            dem.simulate(model(2, walls=(dem.Cylinder(radius=2.0),)), state.with_walls_of(around), until=1.0)

    def test_a_state_whose_indices_point_nowhere_is_refused(self):
        scene = model(2, walls=(FLOOR,))
        state = dem.simulate(scene, dem.State.at_rest(scene, [[0, 0, 0.006], [0, 0, 0.01601]]), until=1e-4).state
        assert len(state.pair) == 1
        beyond = {
            "pair": [[0, 2]],
            "simplex": np.full((1, 7), 10**6),
            "wall_candidates": np.full_like(state.wall_candidates, -1),
            "wall_candidate_count": [10**6, 0],
        }
        for name, values in beyond.items():
            with pytest.raises(SceneError, match="indices point elsewhere"):
                dem.simulate(scene, replace(state, **{name: np.array(values)}), until=1.0)

    @pytest.mark.parametrize("changes", [{"lag": np.nan}, {"clock": (np.nan, 0, 1e-6)}, {"clock": (0.0, 5, 1e-6)}])
    def test_a_clock_that_makes_no_sense_is_refused(self, changes):
        state = replace(dem.State.at_rest(model(1), [[0, 0, 1]]), **changes)
        with pytest.raises(SceneError):
            dem.simulate(model(1), state, until=1.0)

    @pytest.mark.parametrize("threads", [0, -1])
    def test_no_threads_are_refused(self, threads):
        with pytest.raises(SceneError, match=f"at least one thread, got {threads}"):
            dem.simulate(model(1), dem.State.at_rest(model(1), [[0, 0, 1]]), until=1.0, threads=threads)

    def test_a_step_ten_times_too_large_is_refused(self):
        scene = model(1)
        good = dem.scales(scene).step
        state = dem.State.at_rest(scene, [[0, 0, 0.1]])
        with pytest.raises(SceneError, match=r"at most 0\.2 of the least Rayleigh time.*\(0\.6 of it\)"):
            dem.simulate(scene, state, until=0.01, dt=10 * good)
        for bad in (0.0, -good, np.nan, np.inf):
            with pytest.raises(SceneError, match="time step"):
                dem.simulate(scene, state, until=0.01, dt=bad)

    def test_an_end_in_the_past_is_refused(self):
        with pytest.raises(SceneError, match="expected an end of at least the state's time"):
            dem.simulate(model(1), dem.State.at_rest(model(1), [[0, 0, 0.1]]), until=-1.0)


class TestOnTheWay:
    def test_a_bullet_is_told(self):
        scene = model(1, gravity=(0, 0, 0))
        state = dem.State.at_rest(scene, [[0, 0, 0.1]], velocity=[[1e6, 0, 0]])
        with pytest.raises(SimulationError, match="block 0 moves by more than half of its rounding"):
            dem.simulate(scene, state, until=0.01)

    def test_cores_that_meet_are_told_with_the_time(self):
        # Too soft for the impact: the roundings are used up.
        stone = dem.Shape.from_mesh(box())
        jelly = replace(SOFT, youngs_modulus=1e6, surface_energy=0.0)
        scene = model(2, shapes=(stone,), materials=(jelly,), gravity=(0, 0, 0))
        state = dem.State.at_rest(scene, [[0, 0, 0.05], [0.0102, 0, 0.05]], [stone.orientation] * 2,
                                    velocity=[[5, 0, 0], [-5, 0, 0]])  # fmt: skip
        with pytest.raises(SimulationError, match=r"the cores of blocks 0 and 1 overlap.* at t = 0\.000\d+ s") as told:
            dem.simulate(scene, state, until=0.01, dt=2e-5)
        assert told.value.bodies == (0, 1)
        assert 0.0 < told.value.time < 0.01

    def test_a_wall_that_runs_a_block_over_is_told(self):
        ram = dem.Plane(point=(0, 0, 0.05), normal=(0, 0, -1), motion=dem.Motion(velocity=(0.0, 0.0, -50.0)))
        scene = model(1, walls=(FLOOR, ram))
        with pytest.raises(SimulationError, match="block 0"):
            dem.simulate(scene, dem.State.at_rest(scene, [[0, 0, 0.005]]), until=0.01)


class TestModels:
    @pytest.mark.parametrize(("changes", "told"), [
        ({"scale": [1.0, 0.0]}, "positive, finite scales"),
        ({"scale": [1.0, np.nan]}, "positive, finite scales"),
        ({"shape": [0, 1]}, "numbers of a shape from 0 to 0, got 0 to 1"),
        ({"shape": []}, "at least one block"),
        ({"material": [0, 3]}, "numbers of a material from 0 to 0"),
        ({"material": [0]}, r"the number of a material for each block \(2\)"),
        ({"gravity": (0, 0, np.inf)}, "three finite components of gravity"),
        ({"local_damping": 1.0}, "a local damping of at least 0 and below 1"),
        ({"shapes": ()}, "at least one shape"),
        ({"walls": (replace(FLOOR, material=2),)}, "a wall's material from 0 to 0, got 2"),
        ({"pairs": {(0, 1): dem.PairConstants()}}, r"pairs of materials from 0 to 0, got \(0, 1\)"),
    ])  # fmt: skip
    def test_what_makes_no_sense_is_refused(self, changes, told):
        with pytest.raises(SceneError, match=told):
            model(2, **changes)

    @pytest.mark.parametrize("changes", [
        {"density": 0.0}, {"youngs_modulus": -1.0}, {"poisson_ratio": 0.6}, {"restitution": 0.0}, {"restitution": 1.1},
        {"sliding_friction": -0.1}, {"rolling_friction": np.nan}, {"surface_energy": -1.0}, {"density": np.inf},
    ])  # fmt: skip
    def test_materials_out_of_range_are_refused_by_name(self, changes):
        with pytest.raises(SceneError, match=next(iter(changes)).replace("_", " ")):
            replace(dem.TABLE_10, **changes)

    def test_walls_out_of_range_are_refused(self):
        for wall in (
            lambda: dem.Plane(point=(0, 0, 0), normal=(0, 0, 0)),
            lambda: dem.Plane(point=(0, 0, np.nan), normal=(0, 0, 1)),
            lambda: dem.Cylinder(radius=0.0),
            lambda: dem.Cylinder(radius=1.0, motion=dem.Servo(force=1.0, mass=1.0)),
            lambda: dem.Servo(force=np.nan, mass=1.0),
            lambda: dem.Servo(force=1.0, mass=0.0),
            lambda: dem.Motion(velocity=(0, 0, np.inf)),
        ):
            with pytest.raises(SceneError, match="expected"):
                wall()


class TestShapes:
    def test_a_block_without_mass_is_refused(self):
        with pytest.raises(MeshError, match="a block with a positive volume, got 0"):
            dem.Shape(BALL.core, 0.0, np.ones(3), 1.0)
        with pytest.raises(MeshError, match="three positive principal moments"):
            dem.Shape(BALL.core, 1.0, np.zeros(3), 1.0)

    def test_an_open_mesh_is_refused(self):
        cube = box()
        with pytest.raises(MeshError, match="closed mesh for a block"):
            dem.Shape.from_mesh(Mesh(cube.vertices, cube.faces[:-1]))

    def test_an_open_core_is_refused(self):
        cube = box()
        with pytest.raises(MeshError, match=r"expected a closed core.*this one is open"):
            dem.Core(cube.vertices, cube.faces[:-1], 0.001)

    def test_a_core_that_is_not_convex_is_refused(self):
        ball = sphere("icosahedral", 4)
        dented = ball.vertices.copy()
        dented[7] *= 0.8
        with pytest.raises(MeshError, match="expected a convex core; a vertex lies"):
            dem.Core(dented, ball.faces, 0.001)

    def test_a_core_inside_out_is_refused(self):
        cube = box()
        with pytest.raises(MeshError, match="inside out"):
            dem.Core(cube.vertices, cube.faces[:, ::-1], 0.001)

    def test_a_leaf_thinner_than_its_rounding_is_refused(self):
        with pytest.raises(MeshError, match="thicker than twice the margin"):
            dem.Shape.from_mesh(box(0.02, 0.02, 0.0002))

    @pytest.mark.parametrize("margin", [0.0, -0.1, 1.0, np.nan])
    def test_margins_out_of_range_are_refused(self, margin):
        with pytest.raises(MeshError, match="a margin between 0 and 1"):
            dem.Shape.from_mesh(box(), margin=margin)

    def test_every_error_is_one_of_ours(self):
        assert issubclass(SceneError, LithoformError)
        assert issubclass(SimulationError, LithoformError)
