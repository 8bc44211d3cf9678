"""Stones let down, settled and measured: closed forms of lattices and balls, weights, and what a packing must be."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wavy import stone

from lithoform import dem
from lithoform.dem.checkpoint import write_checkpoint
from lithoform.dem.container import extents
from lithoform.dem.state import rotate
from lithoform.errors import FileFormatError, MeshError, OutputError, RecipeError, SceneError, SimulationError
from lithoform.mesh import Mesh
from lithoform.mesh_io import write_mesh
from lithoform.packing import placing
from lithoform.packing.beforehand import introduction, note_on_sizes, pressure, require_stiffness, time_step
from lithoform.packing.container import Container
from lithoform.packing.failing import naming_stones
from lithoform.packing.folder import (
    CHECKPOINT_FILE,
    FOLDER,
    NUMBERS_FILE,
    PROGRESS_FILE,
)
from lithoform.packing.placing import insert, random_attitudes, require_room
from lithoform.packing.request import Request
from lithoform.packing.results import blocks_csv, measure_packing
from lithoform.packing.resuming import read_progress, write_progress
from lithoform.packing.run import pack, pour
from lithoform.packing.settling import LOOK, fastest_fall, is_at_rest, let_down, look, schedule, settle
from lithoform.packing.stones import Source, draw, find_stones, read_shapes

BALL = dem.Shape.sphere(0.005)
CUBE = Mesh(
    0.01 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float),
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]],
)  # fmt: skip


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


# --- the container ---------------------------------------------------------------------------------------------------


def test_containers_are_read_as_people_write_them():
    cylinder = Container.parse("cylinder:150mm:0.2m")
    assert (cylinder.sides, cylinder.height, cylinder.kind) == ((0.15,), 0.2, "cylinder")
    assert cylinder.volume == pytest.approx(math.pi * 0.075**2 * 0.2, rel=1e-12)
    box = Container.parse("box:10cm:50:1in")
    assert (box.sides, box.height, box.area) == ((0.1, 0.05), 0.0254, pytest.approx(0.005))
    assert box.text() == "box 100 x 50 mm wide and 25.4 mm high"


@pytest.mark.parametrize(
    "text",
    ["barrel:1m:1m", "cylinder:150mm", "box:1:1", "cylinder:-1mm:2mm", "cylinder:1 mile:1m", "cylinder:1e300m:1m",
     "box:1m:1m:1001m", ""],
)  # fmt: skip
def test_other_containers_are_refused(text):
    with pytest.raises(RecipeError, match="expected"):
        Container.parse(text)


@pytest.mark.parametrize("sides", [None, 0.1, (), (0.1, 0.1, 0.1), ("0.1",), (math.nan,), (0.0,), (2000.0,)])
def test_a_container_has_lengths(sides):
    with pytest.raises(SceneError, match="expected a diameter or two widths"):
        Container(sides, 0.1)


def test_long_lengths_are_written_out():
    assert Container((12.5,), 3.0).text() == "cylinder 12,500 mm wide and 3,000 mm high"


@pytest.mark.parametrize("text", ["cylinder:100mm:90mm", "box:80mm:60mm:90mm"])
def test_the_walls_are_where_the_container_is(text):
    """The distance of a point from each wall, by the walls themselves, is positive inside and not outside."""
    container = Container.parse(text)
    model = dem.Model(shapes=(BALL,), materials=(dem.TABLE_10,), shape=[0], walls=container.walls)
    state = dem.State.at_rest(model, [[0.0, 0.0, 0.01]])
    assert container.enclosure.area(model, state) == pytest.approx(container.area, rel=1e-12)
    assert container.enclosure.axis(model, state) == pytest.approx([0.0, 0.0, 1.0])
    half = 0.5 * container.sides[-1]
    for plane in container.walls:
        if isinstance(plane, dem.Plane):
            inside = np.array([0.0, half - 1e-9, 1e-9]) - plane.point
            outside = np.array([0.0, half + 1e-9, -1e-9]) - plane.point
            assert inside @ plane.normal > 0.0
            assert plane.normal[0] != 0.0 or plane.normal[1] > 0.0 or outside @ plane.normal < 0.0


# --- which stones, and where -----------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 60), st.integers(0, 2**64 - 1), st.sampled_from(["cylinder:60mm:60mm", "box:50mm:70mm:60mm"]))
def test_no_ball_overlaps_another_or_a_wall(count, seed, text):
    container = Container.parse(text)
    radii = rng(seed).uniform(0.002, 0.012, count)
    places = insert(radii, container, rng(seed))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) - radii[:, None] - radii
    assert apart[~np.eye(count, dtype=bool)].min(initial=1.0) > 0.0
    assert (places[:, 2] > radii).all()
    if len(container.sides) == 1:
        assert (np.hypot(*places[:, :2].T) + radii < 0.5 * container.sides[0]).all()
    else:
        assert (np.abs(places[:, :2]) + radii[:, None] < 0.5 * np.array(container.sides)).all()
    assert (places == insert(radii, container, rng(seed))).all()


def test_what_lies_deep_is_rightly_not_looked_at():
    """Many small balls on few places: those that are passed over must not overlap the new ones."""
    radii = np.full(600, 0.004)
    radii[::7] = 0.012
    places = insert(radii, Container.parse("cylinder:40mm:1m"), rng(3))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) - radii[:, None] - radii
    assert apart[~np.eye(600, dtype=bool)].min() > 0.0


@settings(deadline=None, max_examples=30)
@given(
    st.integers(1, 250),
    st.integers(0, 2**64 - 1),
    st.floats(0.0, 1.5),
    st.floats(1.02, 40.0),
    st.sampled_from(["cylinder", "box"]),
)
def test_each_ball_lies_where_all_others_let_it_down_to(count, seed, spread, wide, kind):
    """Against every ball before it, at each of its random places: the bits are the same, however sizes are spread."""
    radii = 0.01 * 10.0 ** (-spread * rng(seed).random(count))
    container = Container((0.0202 * wide,) if kind == "cylinder" else (0.0202 * wide, 0.0303 * wide), 1.0)
    places, again = insert(radii, container, rng(seed)), rng(seed)
    balls, top = 1.01 * radii, 0.0
    for i, radius in enumerate(balls):
        tried = container.places(radius, 16, again)
        # No lower than four of the largest diameters below the top.
        heights = np.full(16, max(0.0, top - 8.0 * balls.max()) + radius)
        reach = (radius + balls[:i]) ** 2
        for k, place in enumerate(tried):
            apart = ((place - places[:i, :2]) ** 2).sum(axis=1)
            met = apart < reach
            heights[k] = max(heights[k], (places[:i, 2][met] + np.sqrt((reach - apart)[met])).max(initial=0.0))
        assert (places[i, :2] == tried[heights.argmin()]).all()
        assert places[i, 2] == heights.min()
        top = max(top, float(heights.min() + radius))


def test_in_a_wide_container_only_the_balls_near_a_place_are_looked_at(monkeypatch):
    """Without a grid each of them would be held against up to 3,000."""
    looked = []
    over = placing._Columns.over

    def counting(self, places):
        near, held = over(self, places)
        looked.append(near.shape[1])
        return near, held

    monkeypatch.setattr(placing._Columns, "over", counting)
    radii = rng(1).uniform(0.003, 0.006, 3000)
    places = insert(radii, Container((0.6, 0.6), 0.5), rng(2))
    assert max(looked) < 100
    from scipy.spatial import cKDTree

    i, j = cKDTree(places).query_pairs(0.012, output_type="ndarray").T
    assert len(i) > 1000
    assert (np.linalg.norm(places[i] - places[j], axis=1) > radii[i] + radii[j]).all()


def test_a_container_that_cannot_hold_the_stones_is_refused_with_a_number():
    with pytest.raises(SceneError, match=r"at least 20\.2 mm wide"):
        require_room(0.01, Container.parse("cylinder:20mm:100mm"))
    with pytest.raises(SceneError, match=r"at least 20\.2 mm wide and high"):
        require_room(0.01, Container.parse("cylinder:100mm:20mm"))
    with pytest.raises(SceneError, match=r"at least 20,200 mm wide .* give the unit of their files with --unit"):
        require_room(10.0, Container.parse("cylinder:100mm:100mm"))
    box = Container.parse("box:100mm:100mm:100mm")
    with pytest.raises(SceneError, match=r"at most about 67 of these stones .* got 90, which are 91%"):
        require_room(0.01, box, np.full(90, 1.01e-5))
    require_room(0.01, box, np.full(67, 1.01e-5))


def test_attitudes_are_even_over_all_rotations():
    quaternions = random_attitudes(20_000, rng(1))
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0)
    up = rotate(quaternions, np.tile([0.0, 0.0, 1.0], (20_000, 1)))
    # Mean 0 and mean square 1/3 of each component; standard errors 0.004 and 0.002.
    assert up.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.02)
    assert (up**2).mean(axis=0) == pytest.approx(np.full(3, 1 / 3), abs=0.01)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 50), st.integers(1, 200), st.integers(0, 2**64 - 1))
def test_stones_are_taken_about_equally_often(available, count, seed):
    often = np.bincount(draw(available, count, rng(seed)), minlength=available)
    assert often.sum() == count
    assert often.max() - often.min() <= 1


def test_of_very_many_stones_a_thousand_are_taken():
    chosen = draw(5000, 3000, rng())
    assert (np.bincount(chosen)[np.unique(chosen)] == 3).all()
    assert len(np.unique(chosen)) == 1000
    assert len(draw(7, None, rng())) == 7
    with pytest.raises(RecipeError, match="--count from 1"):
        draw(7, 0, rng())


# --- falling and settling --------------------------------------------------------------------------------------------


def thrown(speed: float) -> float:
    """Deepest overlap over rounding of a soft cube that lands on a corner."""
    shape = dem.Shape.from_mesh(CUBE)
    model = dem.Model(shapes=(shape,), materials=(dem.TABLE_10.softened(0.001),), shape=[0],
                      walls=(dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)),))  # fmt: skip
    corner = np.linalg.norm(shape.core.vertices, axis=1).max() + shape.core.margin
    tilt = np.array([math.sin(0.5 * math.acos(3**-0.5)), -math.sin(0.5 * math.acos(3**-0.5)), 0.0]) / math.sqrt(2.0)
    state = dem.State.at_rest(model, [[0.0, 0.0, corner]], [[*tilt, math.cos(0.5 * math.acos(3**-0.5))]],
                              velocity=[[0.0, 0.0, -speed]])  # fmt: skip
    deepest = 0.0
    for _ in range(60):
        state = dem.simulate(model, state, until=state.time + 2e-5, device="cpu", threads=1).state
        deepest = max(deepest, float(state.wall_contact_radius[0]) ** 2 / float(model.radius[0]))
    return deepest / float(model.margin[0])


def test_at_the_speed_limit_an_impact_stays_within_half_of_the_rounding():
    model = dem.Model(shapes=(dem.Shape.from_mesh(CUBE),), materials=(dem.TABLE_10.softened(0.001),), shape=[0])
    limit = fastest_fall(model)
    assert limit < math.sqrt(2.0 * 9.81 * 10.0 * model.radius[0])
    # Damping takes some of the depth, but not most.
    assert 0.2 < thrown(limit) < 0.55


def test_stiff_stones_fall_as_from_five_diameters_and_the_limit_of_soft_ones_has_no_scale():
    stiff = dem.Model(shapes=(BALL,), materials=(dem.TABLE_10,), shape=[0])
    assert fastest_fall(stiff) == pytest.approx(math.sqrt(2.0 * 9.81 * 5 * 0.01), rel=1e-12)
    shape = dem.Shape.from_mesh(CUBE)
    limits = [
        fastest_fall(dem.Model(shapes=(shape,), materials=(dem.TABLE_10.softened(1e-4),), shape=[0], scale=[scale]))
        for scale in (1.0, 10.0)
    ]
    assert limits[1] == pytest.approx(limits[0], rel=1e-9)


def test_letting_down_only_slows_what_is_too_fast_and_only_once():
    model = dem.Model(shapes=(BALL,), materials=(dem.TABLE_10,), shape=[0, 0, 0])
    velocity = np.array([[0.0, 0.0, -0.5], [3.0, 0.0, -4.0], [0.0, 0.0, 0.0]])
    state = dem.State.at_rest(model, np.diag([0.1, 0.2, 0.3]), velocity=velocity)
    slowed = let_down(state, 1.0)
    assert slowed.velocity == pytest.approx(np.array([[0.0, 0.0, -0.5], [0.6, 0.0, -0.8], [0.0, 0.0, 0.0]]))
    assert let_down(slowed, 1.0) is slowed


@pytest.fixture(scope="module")
def settled():
    """Forty angular stones of four shapes in a cylinder, at rest."""
    forms = [(1.0, 1.0, 1.0), (1.3, 1.0, 1.0), (1.0, 1.2, 1.4), (0.8, 1.0, 1.6)]
    body = stone(0.15, scale=0.006, n=4)
    shapes = [dem.Shape.from_mesh(body.with_vertices(body.vertices * form)) for form in forms]
    container = Container.parse("cylinder:60mm:60mm")
    model, start = pour(shapes, np.arange(40) % 4, container, rng=rng(5), stiffness_factor=0.003)
    plan = schedule(model, start, dem.scales(model).step)
    rows: list[dict[str, float]] = []
    state = settle(model, start, plan, rows, device="cpu", threads=1)
    return model, start, state, container, rows, plan


def test_settled_stones_are_at_rest_inside_and_carried_by_floor_and_wall(settled):
    model, _, state, container, rows, _ = settled
    assert is_at_rest(rows)
    assert not is_at_rest(rows[:10])
    # What the floor and the side carry is the weight.
    assert state.wall_force[:, 2].sum() == pytest.approx(-9.81 * model.mass.sum(), rel=5e-3)
    deepest = measure_packing(model, state, container).deepest
    assert 0.0 < deepest < 0.05
    # Overlaps, and what a sharp corner reaches beyond its rounding.
    most = deepest * model.radius.max() + max(shape.rounding[0] for shape in model.shapes)
    assert extents(model, state, np.array([0.0, 0.0, 1.0]))[:, 0].min() > -most
    for axis in np.array([[math.cos(a), math.sin(a), 0.0] for a in np.linspace(0, 6, 13)]):
        assert extents(model, state, axis)[:, 1].max() < 0.03 + most


def test_energy_is_lost_and_the_bed_sinks(settled):
    _, start, state, _, rows, plan = settled
    total = np.array([row["kinetic"] + row["potential"] + row["elastic"] for row in rows])
    assert (np.diff(total) < 1e-3 * np.ptp(total)).all()
    assert rows[-1]["height"] < 0.5 * rows[0]["height"]
    # Steps between looks and the limit of speed are kept; a look is one interval of free fall behind.
    assert all(row["step"] == k * plan.every for k, row in enumerate(rows))
    assert max(row["fastest"] for row in rows[:-1]) < 1.3 * plan.fastest
    assert state.step > start.step


def test_a_run_that_is_stopped_and_goes_on_is_the_same(settled):
    model, start, state, _, rows, plan = settled
    former: list[dict[str, float]] = []
    part = settle(model, start, replace(plan, steps=10 * plan.every + 7), former, device="cpu", threads=2)
    assert part.step == 10 * plan.every + 7
    # The look at the odd end of the first part is none of the whole run.
    former = [row for row in former if row["step"] % plan.every == 0]
    again = settle(model, part, plan, former, device="cpu", threads=1)
    assert former == rows
    for name, array in again.arrays().items():
        assert array.tobytes() == state.arrays()[name].tobytes(), name


def test_a_run_ends_at_the_time_it_is_given(settled):
    model, start, _, _, _, plan = settled
    short = schedule(model, start, plan.dt, until=12.5 * plan.dt)
    rows: list[dict[str, float]] = []
    state = settle(model, start, short, rows, device="cpu", threads=1)
    assert state.step == short.steps == 13
    assert not is_at_rest(rows)


def test_a_look_tells_what_it_promises(settled):
    model, _, state, _, rows, _ = settled
    assert tuple(look(model, state)) == tuple(rows[-1]) == LOOK


@pytest.mark.parametrize(
    ("dt", "until", "told"),
    [
        (1e-6, 1e300, r"at most 10,000,000,000 steps; --until 1e\+300 takes 1e\+306 of 1e-06 s: give a longer --dt"),
        (1e-300, 1.0, r"takes 1e\+300 of 1e-300 s"),
        (5e-324, 1e300, r"takes far more of 4\.94e-324 s"),
        (1e-20, None, r"until they rest, about 0\.\d+ s, takes .* give a longer --dt or a larger --gravity"),
    ],
)
def test_more_steps_than_anybody_can_wait_for_are_refused(settled, dt, until, told):
    model, start, *_ = settled
    with pytest.raises(SceneError, match=told):
        schedule(model, start, dt, until)
    # Of the shortest of steps a few are no fault.
    assert schedule(model, start, 1e-300, 5e-299).steps == 50


# --- what is refused and told beforehand -----------------------------------------------------------------------------


def ball_model(radius: float, count: int, factor: float = 0.01, gravity: float = 9.81) -> dem.Model:
    return dem.Model(shapes=(dem.Shape.sphere(radius),), materials=(dem.TABLE_10.softened(factor),),
                     shape=np.zeros(count, int), gravity=(0.0, 0.0, -gravity))  # fmt: skip


def test_the_sizes_of_the_stones_are_told(settled):
    model, start, _, container, _, plan = settled
    told = introduction(container, model, 0.003, dem.scales(model), schedule(model, start, plan.dt))
    volumes = np.sort([shape.volume for shape in model.shapes])
    least, most = 2e3 * (3.0 * volumes[[0, -1]] / (4.0 * math.pi)) ** (1.0 / 3.0)
    assert f"Diameters of the spheres of equal volume: {least:.4g} to {most:.4g} mm, median" in told[1]


def test_stones_that_are_lost_in_their_container_are_told_or_refused():
    container = Container.parse("cylinder:100mm:100mm")
    # Metres that were read as millimetres.
    with pytest.raises(SceneError, match=r"the largest is 0\.02 mm wide in a cylinder .* unit .* with --unit"):
        note_on_sizes(ball_model(1e-5, 30), container, from_files=True)
    with pytest.raises(SceneError, match=r"mm high: give a smaller container\.$"):
        note_on_sizes(ball_model(1e-5, 30), container, from_files=False)
    # So many that they cover 1.2 % of the floor may be meant, and sand that covers all of it is usual.
    assert note_on_sizes(ball_model(1e-5, 300_000), container, from_files=True)
    assert note_on_sizes(ball_model(4e-4, 20_000), container, from_files=True) is None
    # Inches that were read as millimetres; a single stone in a room.
    assert "--unit" in note_on_sizes(ball_model(0.3e-3, 30), container, from_files=True)
    assert "smaller container" in note_on_sizes(ball_model(0.01, 1), Container((5.0,), 5.0), from_files=False)
    # A single stone in a common container.
    assert note_on_sizes(ball_model(0.01, 1), Container.parse("cylinder:150mm:200mm"), from_files=True) is None


@pytest.mark.parametrize(("factor", "gravity"), [(1e-7, 9.81), (1e-300, 9.81), (0.01, 9e4), (1e-9, 1e-3)])
def test_stones_too_soft_for_their_weight_are_refused_with_the_factor_that_would_do(factor, gravity):
    container = Container.parse("cylinder:60mm:60mm")
    model = ball_model(0.006, 100, factor, gravity)
    with pytest.raises(SceneError, match=r"--stiffness-factor of at least (\S+), fewer stones") as told:
        require_stiffness(model, container, factor)
    enough = float(str(told.value).partition("at least ")[2].partition(",")[0])
    require_stiffness(ball_model(0.006, 100, enough, gravity), container, enough)
    with pytest.raises(SceneError):
        require_stiffness(ball_model(0.006, 100, 0.8 * enough, gravity), container, 0.8 * enough)


def test_the_stiffness_that_is_refused_is_where_hertz_puts_it():
    """Overlap of a column under its weight, (E / ((1 - nu^2) P))^(-2/3), at the bound of 0.01."""
    container = Container.parse("box:100mm:100mm:1m")
    count = 500
    weight = count * 2650.0 * 4.0 / 3.0 * math.pi * 0.008**3 * 9.81
    assert pressure(ball_model(0.008, count), container) == pytest.approx(weight / 0.01, rel=1e-12)
    modulus = 0.01**-1.5 * (1.0 - 0.3**2) * weight / 0.01
    require_stiffness(ball_model(0.008, count, 1.001 * modulus / 55e9), container, 1.0)
    with pytest.raises(SceneError, match=r"it is about 0\.01:"):
        require_stiffness(ball_model(0.008, count, 0.999 * modulus / 55e9), container, 0.999 * modulus / 55e9)
    # A stone alone carries itself, however wide the container.
    with pytest.raises(SceneError):
        require_stiffness(ball_model(0.008, 1, 1e-8), Container((100.0,), 1.0), 1e-8)
    with pytest.raises(SceneError, match="give fewer stones or a smaller --gravity"):
        require_stiffness(ball_model(0.008, 100_000, 1.0, 1e5), container, 1.0)


def test_the_time_step_is_that_of_rayleigh_or_the_one_that_is_given():
    model = ball_model(0.005, 1)
    least = dem.scales(model).rayleigh_time
    assert time_step(model, None) == pytest.approx(0.06 * least)
    assert time_step(model, 0.2 * least) == 0.2 * least
    with pytest.raises(SceneError, match=r"expected --dt of at most 0\.2 of the Rayleigh"):
        time_step(model, 0.21 * least)


# --- errors in the words of a packing --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (
            "the cores of blocks 0 and 2 overlap: they are in each other by 1 mm at t = 2 s: take a smaller load.",
            r"^the cores of stones 1 \(a\.stl\) and 3 \(c\.stl\) overlap: they are in .* 1 mm at t = 2 s \(stones are",
        ),
        (
            "block 2 is deeper in a wall than three times its rounding (1 mm) at t = 1 s (and 4 more): take less.",
            r"^stone 3 \(c\.stl\) is deeper in a wall .* \(and 4 more\) \(stones are numbered as in blocks\.csv\)",
        ),
        ("the kernels reported fault 64.", "^the kernels reported fault 64 "),
    ],
)
def test_errors_of_the_simulation_name_the_files_and_the_options(said, told):
    with pytest.raises(SimulationError, match=told) as raised, naming_stones("a.stl b.stl c.stl".split().__getitem__,
                                                                             0.01, 1e-6):  # fmt: skip
        raise SimulationError(said, time=2.0, bodies=(0, 2))
    assert (raised.value.time, raised.value.bodies) == (2.0, (0, 2))
    assert "give a --dt below 1e-06, or a --stiffness-factor above 0.01, or leave such" in str(raised.value)
    assert "take a" not in str(raised.value)
    with pytest.raises(SimulationError) as raised, naming_stones(str, 1.0, 1e-6):
        raise SimulationError(said)
    assert "--stiffness-factor" not in str(raised.value)


def thin(name: str, key: tuple[str, int] | None = None) -> Source:
    flat = CUBE.with_vertices(CUBE.vertices * [1.0, 1.0, 0.001])
    return Source(name, lambda: (flat, ()), key)


def test_all_stones_that_cannot_be_used_are_named_with_the_way_out():
    good = Source("good.stl", lambda: (CUBE, ("mended",)))
    assert [repairs for _, repairs in read_shapes([good, good], threads=1)] == [("mended",)] * 2
    with pytest.raises(MeshError, match=r"^b\.stl: expected a block thicker .* m; leave that file out\.$"):
        read_shapes([good, thin("b.stl"), good], threads=1)
    with pytest.raises(MeshError, match=r"^2 of 3 stones cannot be used \(b\.stl, c\.stl\); the first is b\.stl: "
                                        r"expected .*; leave those files out\.$"):  # fmt: skip
        read_shapes([good, thin("b.stl"), thin("c.stl")], threads=1)
    with pytest.raises(MeshError, match=r"50 of 51 .*stone-9\.stl and 40 more\); the first is stone-0"):
        read_shapes([*(thin(f"stone-{i}.stl") for i in range(50)), good], threads=1)
    with pytest.raises(MeshError, match=r"give --select \"\(source, number\) not in \(\('s', 7\), \('s', 8\)\)\"\.$"):
        read_shapes([good, thin("s-000007", ("s", 7)), thin("s-000008", ("s", 8))], threads=1)
    with pytest.raises(MeshError, match=r"leave that file out, and give --select"):
        read_shapes([thin("s-000007", ("s", 7)), thin("b.stl"), good], threads=1)
    with pytest.raises(MeshError, match=r"give other stones\.$"):
        read_shapes([thin("b.stl")], threads=1)


# --- what is measured ------------------------------------------------------------------------------------------------


def lattice(side: int, container: str) -> tuple[dem.Model, dem.State, Container]:
    """Simple cubic lattice of balls that touch each other and the floor."""
    box = Container.parse(container)
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = 0.01 * (grid + np.array([0.5 - 0.5 * side, 0.5 - 0.5 * side, 0.5]))
    model = dem.Model(shapes=(BALL,), materials=(dem.TABLE_10,), shape=np.zeros(side**3, int), walls=box.walls)
    return model, dem.State.at_rest(model, places), box


def test_density_of_a_lattice():
    model, state, box = lattice(4, "box:40mm:40mm:30mm")
    found = measure_packing(model, state, box)
    assert found.height == pytest.approx(0.04, rel=1e-12)
    assert found.total_density == pytest.approx(math.pi / 6.0, rel=1e-12)
    assert found.profile == pytest.approx(np.full(4, math.pi / 6.0), rel=1e-9)
    # From one diameter to the rim at 30 mm: two layers whole.
    assert found.band == pytest.approx((0.01, 0.03))
    assert found.packing_density == pytest.approx(math.pi / 6.0, rel=1e-12)
    assert measure_packing(model, state, replace(box, height=0.0301)).fits == 48
    # With a higher rim up to 32 mm: two layers and the caps of the next, 2 mm high.
    found = measure_packing(model, state, replace(box, height=1.0))
    cap = math.pi * 0.002**2 * (3 * 0.005 - 0.002) / 3.0
    assert found.packing_density == pytest.approx((2 * math.pi / 6.0 * 1e-6 + cap) / (1e-4 * 0.022), rel=1e-9)
    assert found.fits == 64


def test_a_thin_bed_is_taken_whole():
    model, state, box = lattice(1, "box:20mm:20mm:50mm")
    found = measure_packing(model, state, box)
    assert found.band == (0.0, pytest.approx(0.01))
    assert found.packing_density == found.total_density == pytest.approx(math.pi / 6.0 / 4.0)


def test_contacts_of_a_settled_column():
    """Balls in a tube that is hardly wider: each on the one below."""
    container = Container.parse("cylinder:10.3mm:100mm")
    model, start = pour([BALL], np.zeros(4, int), container, rng=rng(), stiffness_factor=0.003)
    rows: list[dict[str, float]] = []
    state = settle(model, start, schedule(model, start, dem.scales(model).step), rows, device="cpu", threads=1)
    found = measure_packing(model, state, container)
    assert found.coordination["mean"] == 2 * 3 / 4
    assert look(model, state)["contacts"] == 1.5
    # Twice the height of the centre of mass: 40 mm less what the balls lean and sink.
    assert 0.0385 < found.height < 0.04


def test_the_table_of_the_stones_puts_their_meshes_where_they_lie():
    """A mesh far from the origin and askew: its vertices by the table, against those of the shape by the state."""
    turn = np.linalg.qr(np.array([[1.0, 2.0, 0.3], [0.2, 1.0, 4.0], [3.0, 0.1, 1.0]]))[0]
    turn *= np.sign(np.linalg.det(turn))
    body = stone(0.2, n=3)
    mesh = body.with_vertices(0.01 * body.vertices * [1.5, 1.0, 0.6] @ turn + [0.3, -0.2, 5.0])
    shape = dem.Shape.from_mesh(mesh)
    model = dem.Model(shapes=(shape,), materials=(dem.TABLE_10,), shape=[0, 0], scale=[1.0, 0.7])
    state = dem.State.at_rest(model, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], random_attitudes(2, rng(4)))
    rows = list(csv.DictReader(io.StringIO(blocks_csv(model, state, ["a,b.stl"]).decode())))
    assert [row["stone"] for row in rows] == ["a,b.stl"] * 2
    for i, row in enumerate(rows):
        q = np.array([[float(row[f"q{k}"]) for k in "xyzw"]]).repeat(len(mesh.vertices), axis=0)
        centre = [float(row[f"mesh_centre_{k}_m"]) for k in "xyz"]
        by_table = rotate(q, float(row["scale"]) * (mesh.vertices - centre)) + [float(row[f"{k}_m"]) for k in "xyz"]
        local = shape.mesh.vertices * model.scale[i]
        by_state = rotate(state.orientation[i : i + 1].repeat(len(local), axis=0), local) + state.position[i]
        assert by_table == pytest.approx(by_state, abs=1e-12)
        assert float(row["mass_kg"]) == pytest.approx(2650.0 * mesh.volume * model.scale[i] ** 3, rel=1e-9)


# --- requests and folders --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"seed": -1}, "seed must be 0"),
        ({"gravity": 0.0}, "--gravity from 1e-06 to 100000; got 0"),
        ({"gravity": math.nan}, "--gravity from"),
        ({"stiffness_factor": 1.5}, "--stiffness-factor above 0 and at most 1; got 1.5"),
        ({"dt": -1e-6}, "--dt above 0"),
        ({"until": 0.0}, "--until above 0"),
        ({"gravity": 1e300}, r"--gravity from 1e-06 to 100000; got 1e\+300"),
        ({"gravity": 1e-300}, "--gravity from 1e-06"),
        ({"gravity": None}, "--gravity from 1e-06 to 100000; got None"),
        ({"gravity": 10**400}, "--gravity from"),
        ({"gravity": True}, "--gravity from"),
        ({"dt": "1e-6"}, "--dt above 0; got '1e-6'"),
        ({"stiffness_factor": 1j}, "--stiffness-factor above 0 and at most 1"),
        ({"seed": math.nan}, "a seed to be a whole number; got nan"),
        ({"seed": 1.5}, "a seed to be a whole number"),
        ({"count": "12"}, "--count to be a whole number; got '12'"),
        ({"sources": "stones"}, r"as a tuple of paths, such as \(Path\('stones'\),\); got 'stones'"),
        ({"sources": None}, "as a tuple of paths"),
        ({"sources": (1,)}, "a source to be the path of a file or a folder; got 1"),
        ({"sources": ("a\0b",)}, "a source to be the path"),
        ({"container": 0.15}, "a container such as 'cylinder:150mm:200mm'; got 0.15"),
        ({"unit": None}, "a unit such as 'mm'; got None"),
        ({"select": 3}, "--select as a condition in SQL; got 3"),
        ({"vtk": "no"}, "vtk to be True or False"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(change, told):
    with pytest.raises(RecipeError, match=told):
        Request(**{"sources": (), "container": "cylinder:1m:1m", **change})


def test_numbers_of_numpy_and_names_of_paths_are_taken():
    asked = Request(sources=["stones"], container="cylinder:1m:1m", count=np.int64(3), seed=np.uint64(2**64 - 1),
                    gravity=np.float32(2.0))  # fmt: skip
    assert (type(asked.count), type(asked.seed), type(asked.gravity)) == (int, int, float)
    assert json.loads(json.dumps(asked.settings()))["sources"] == ["stones"]


@pytest.mark.parametrize(
    "more",
    [{"out": 3}, {"out": None}, {"device": None}, {"threads": 0}, {"threads": 1.5}, {"threads": 10**30},
     {"request": "stones"}, {"request": Request(sources=("nosuch.stl",), container="cylinder:1m:1m")},
     {"request": Request(sources=("nosuch.stl",), container="no container")}],
)  # fmt: skip
def test_what_makes_no_sense_in_python_is_refused_too(tmp_path, more):
    asked = {"request": Request(sources=("nosuch.stl",), container="cylinder:1m:1m"), "out": tmp_path / "p", **more}
    with pytest.raises((RecipeError, FileFormatError), match=r"expected|there is no such file"):
        pack(**asked)


def test_stones_that_are_none_are_refused(tmp_path):
    with pytest.raises(RecipeError, match="expected meshes or a database"):
        find_stones([])
    with pytest.raises(RecipeError, match="none is given"):
        find_stones([tmp_path], select="class = 'cube'")
    flat = tmp_path / "flat.obj"
    flat.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n")
    with pytest.raises(FileFormatError, match=r"flat\.obj"):
        read_shapes(find_stones([flat]))
    write_mesh(tmp_path / "good.stl", CUBE)
    with pytest.raises(FileFormatError, match=r"flat\.obj: .*; leave that file out\.$"):
        read_shapes(find_stones([tmp_path]))


def test_a_folder_knows_what_it_holds(tmp_path):
    asked = {"lithoform": "1", "count": 3}
    out = tmp_path / "p"
    assert FOLDER.check(out, asked, overwrite=False, resume=False) is None
    FOLDER.clear(out, asked)
    with pytest.raises(OutputError, match="stopped before it was finished: --resume goes on"):
        FOLDER.check(out, asked, overwrite=False, resume=False)
    assert FOLDER.check(out, asked, overwrite=False, resume=True)["finished"] is False
    with pytest.raises(OutputError, match=r"other settings \(count, seed differ\)"):
        FOLDER.check(out, {"lithoform": "1", "count": 4, "seed": 0}, overwrite=False, resume=True)
    FOLDER.write(out, asked, {"results": {"steps": 1}}, finished=True)
    with pytest.raises(OutputError, match="a packing: --overwrite replaces it"):
        FOLDER.check(out, asked, overwrite=False, resume=False)
    assert FOLDER.check(out, asked, overwrite=False, resume=True)["results"] == {"steps": 1}
    (out / "vtk").mkdir()
    for name in ("blocks.csv", "vtk/blocks_000000001.vtp", "vtk/blocks.pvd", "vtk/mine.txt"):
        (out / name).write_text("x")
    FOLDER.check(out, asked, overwrite=True, resume=False)
    FOLDER.clear(out, asked)
    assert sorted(p.name for p in out.rglob("*")) == ["mine.txt", NUMBERS_FILE, "vtk"]


def test_only_unfinished_files_of_a_packing_are_removed(tmp_path):
    out = tmp_path / "p"
    out.mkdir()
    mine = ["draft.partial", ".draft.partial", ".notes.txt.01234567.partial", ".blocks.csv.partial",
            ".blocks.csv.0123456x.partial", ".blocks_1.vtp.bak.01234567.partial"]  # fmt: skip
    ours = [".blocks.csv.01234567.partial", ".packing.json.89abcdef.partial", ".blocks_000000012.vtp.01234567.partial"]
    for name in (*mine, *ours):
        (out / name).write_text("x")
    with pytest.raises(OutputError, match="not empty, it holds other files"):
        FOLDER.check(out, {}, overwrite=False, resume=False)
    FOLDER.remove_unfinished(out)
    assert sorted(p.name for p in out.iterdir()) == sorted(mine)
    for name in mine:
        (out / name).unlink()
    (out / ours[0]).write_text("x")
    assert FOLDER.check(out, {}, overwrite=False, resume=False) is None


def test_a_packing_beside_files_of_others_is_resumed_and_never_replaced(tmp_path):
    asked = {"count": 3}
    FOLDER.clear(tmp_path, asked)
    (tmp_path / "thesis.txt").write_text("mine")
    assert FOLDER.check(tmp_path, asked, overwrite=False, resume=True) == FOLDER.read(tmp_path)
    with pytest.raises(OutputError, match=r"other files \(thesis\.txt\): move those away"):
        FOLDER.check(tmp_path, asked, overwrite=True, resume=False)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_names_that_are_no_text_are_kept(tmp_path):
    FOLDER.clear(tmp_path, {"sources": ["st\udce4ne", "höhe"]})
    assert FOLDER.read(tmp_path)["settings"] == {"sources": ["st\udce4ne", "höhe"]}
    assert "höhe" in (tmp_path / NUMBERS_FILE).read_text("utf-8")


@pytest.fixture(scope="module")
def stopped(settled, tmp_path_factory):
    """Folder of the settled stones as if they had been stopped within an interval, with the model and the plan."""
    model, start, _, _, _, plan = settled
    out = tmp_path_factory.mktemp("stopped")
    rows: list[dict[str, float]] = []
    state = settle(model, start, replace(plan, steps=4 * plan.every + 7), rows, device="cpu", threads=1)
    write_checkpoint(out / CHECKPOINT_FILE, model, state)
    write_progress(out, 1.5, rows[:5])
    return out, model, start, plan


def copied(stopped, tmp_path):
    for name in (CHECKPOINT_FILE, PROGRESS_FILE):
        (tmp_path / name).write_bytes((stopped[0] / name).read_bytes())
    return tmp_path, *stopped[1:]


def test_what_was_written_is_read_again(stopped, tmp_path):
    out, model, start, plan = copied(stopped, tmp_path)
    state, rows, seconds = read_progress(out, model, start, plan)
    assert (state.step, seconds) == (4 * plan.every + 7, 1.5)
    assert [row["step"] for row in rows] == [k * plan.every for k in range(5)]
    # Of an interval that nobody looked at the table would not tell.
    write_progress(out, 1.5, rows[:4])
    with pytest.raises(OutputError, match="not of the same run"):
        read_progress(out, model, start, plan)
    (out / PROGRESS_FILE).unlink()
    assert read_progress(out, model, start, plan) == (start, [], 0.0)


@pytest.mark.parametrize(
    "change",
    [
        lambda told: "no json",
        lambda told: "[" * 100_000,
        lambda told: "null",
        lambda told: "[]",
        lambda told: {"rows": told["rows"]},
        lambda told: {"seconds": 1.0},
        lambda told: {**told, "seconds": -1.0},
        lambda told: {**told, "seconds": math.nan},
        lambda told: {**told, "seconds": "1"},
        lambda told: {**told, "seconds": 10**400},
        lambda told: {**told, "rows": None},
        lambda told: {**told, "rows": "rows"},
        lambda told: {**told, "rows": {"time": 0.0}},
        lambda told: {**told, "rows": []},
        lambda told: {**told, "rows": [[1.0]]},
        lambda told: {**told, "rows": [{"time": 0.0, "step": 0}]},
        lambda told: {**told, "rows": told["rows"][1:]},
        lambda told: {**told, "rows": told["rows"][::-1]},
        lambda told: {**told, "rows": [*told["rows"], told["rows"][-1]]},
        lambda told: {**told, "rows": [{**row, "kinetic": math.inf} for row in told["rows"]]},
        lambda told: {**told, "rows": [{**row, "kinetic": "0"} for row in told["rows"]]},
        lambda told: {**told, "rows": [{**row, "step": float(row["step"])} for row in told["rows"]]},
    ],
)
def test_a_damaged_account_of_the_way_is_told_with_the_way_out(stopped, tmp_path, change):
    out, model, start, plan = copied(stopped, tmp_path)
    damaged = change(json.loads((out / PROGRESS_FILE).read_bytes()))
    (out / PROGRESS_FILE).write_text(damaged if isinstance(damaged, str) else json.dumps(damaged))
    with pytest.raises(OutputError, match=r"cannot be resumed: .*progress\.json .*; give --overwrite to make it anew"):
        read_progress(out, model, start, plan)


@pytest.mark.parametrize("change", [lambda data: data[:1000], lambda data: b"", lambda data: b"hello",
                                    lambda data: data[:-1] + b"x", lambda data: data + b"x"])  # fmt: skip
def test_a_damaged_checkpoint_is_told_with_the_way_out(stopped, tmp_path, change):
    out, model, start, plan = copied(stopped, tmp_path)
    (out / CHECKPOINT_FILE).write_bytes(change((out / CHECKPOINT_FILE).read_bytes()))
    with pytest.raises(OutputError, match=r"packing\.checkpoint is damaged or no checkpoint; give --overwrite"):
        read_progress(out, model, start, plan)


def test_a_checkpoint_of_other_stones_is_told_with_the_way_out(stopped, tmp_path):
    out, model, start, plan = copied(stopped, tmp_path)
    other = replace(model, scale=np.full(model.count, 1.1))
    with pytest.raises(OutputError, match=r"is of other stones \(have their files changed\?\) .*; give --overwrite"):
        read_progress(out, other, start, plan)


@pytest.mark.parametrize("content", ["{}", "[1]", "no json", json.dumps({"format": "lithoform packing"})])
def test_files_of_others_are_left_alone(tmp_path, content):
    (tmp_path / NUMBERS_FILE).write_text(content)
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="other files"):
            FOLDER.check(tmp_path, {}, overwrite=overwrite, resume=False)
    with pytest.raises(OutputError, match="no packing to resume"):
        FOLDER.check(tmp_path, {}, overwrite=False, resume=True)
    assert (tmp_path / NUMBERS_FILE).read_text() == content
