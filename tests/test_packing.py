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
from lithoform.dem.container import extents
from lithoform.dem.state import rotate
from lithoform.errors import OutputError, RecipeError, SceneError
from lithoform.mesh import Mesh
from lithoform.packing.container import Container
from lithoform.packing.folder import NUMBERS_FILE, check_folder, clear_folder, write_numbers
from lithoform.packing.placing import insert, random_attitudes, require_room
from lithoform.packing.results import blocks_csv, measure_packing
from lithoform.packing.run import Request, pour
from lithoform.packing.settling import fastest_fall, is_at_rest, let_down, look, schedule, settle
from lithoform.packing.stones import draw, find_stones, read_shapes

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
    "text", ["barrel:1m:1m", "cylinder:150mm", "box:1:1", "cylinder:-1mm:2mm", "cylinder:1 mile:1m"]
)
def test_other_containers_are_refused(text):
    with pytest.raises(RecipeError, match="expected"):
        Container.parse(text)


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


def test_a_container_that_cannot_hold_the_stones_is_refused_with_a_number():
    with pytest.raises(SceneError, match=r"at least 20\.2 mm wide"):
        require_room(0.01, Container.parse("cylinder:20mm:100mm"))
    with pytest.raises(SceneError, match=r"at least 20\.2 mm wide and high"):
        require_room(0.01, Container.parse("cylinder:100mm:20mm"))
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
        ({"gravity": 0.0}, "--gravity above 0; got 0"),
        ({"gravity": math.nan}, "--gravity above 0"),
        ({"stiffness_factor": 1.5}, "--stiffness-factor above 0 and at most 1; got 1.5"),
        ({"dt": -1e-6}, "--dt above 0"),
        ({"until": 0.0}, "--until above 0"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(change, told):
    with pytest.raises(RecipeError, match=told):
        Request(**{"sources": (), "container": "cylinder:1m:1m", **change})


def test_stones_that_are_none_are_refused(tmp_path):
    with pytest.raises(RecipeError, match="expected meshes or a database"):
        find_stones([])
    with pytest.raises(RecipeError, match="none is given"):
        find_stones([tmp_path], select="class = 'cube'")
    flat = tmp_path / "flat.obj"
    flat.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n")
    with pytest.raises(ValueError, match=r"flat\.obj"):
        list(read_shapes(find_stones([flat])))


def test_a_folder_knows_what_it_holds(tmp_path):
    asked = {"lithoform": "1", "count": 3}
    out = tmp_path / "p"
    assert check_folder(out, asked, overwrite=False, resume=False) is None
    clear_folder(out, asked)
    with pytest.raises(OutputError, match="stopped before it was finished: --resume goes on"):
        check_folder(out, asked, overwrite=False, resume=False)
    assert check_folder(out, asked, overwrite=False, resume=True)["finished"] is False
    with pytest.raises(OutputError, match=r"other settings \(count, seed differ\)"):
        check_folder(out, {"lithoform": "1", "count": 4, "seed": 0}, overwrite=False, resume=True)
    write_numbers(out, asked, {"results": {"steps": 1}}, finished=True)
    with pytest.raises(OutputError, match="a packing: --overwrite replaces it"):
        check_folder(out, asked, overwrite=False, resume=False)
    assert check_folder(out, asked, overwrite=False, resume=True)["results"] == {"steps": 1}
    (out / "vtk").mkdir()
    for name in ("blocks.csv", "vtk/blocks_000000001.vtp", "vtk/blocks.pvd", "vtk/mine.txt"):
        (out / name).write_text("x")
    check_folder(out, asked, overwrite=True, resume=False)
    clear_folder(out, asked)
    assert sorted(p.name for p in out.rglob("*")) == ["mine.txt", NUMBERS_FILE, "vtk"]


@pytest.mark.parametrize("content", ["{}", "[1]", "no json", json.dumps({"format": "lithoform packing"})])
def test_files_of_others_are_left_alone(tmp_path, content):
    (tmp_path / NUMBERS_FILE).write_text(content)
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="other files"):
            check_folder(tmp_path, {}, overwrite=overwrite, resume=False)
    with pytest.raises(OutputError, match="no packing to resume"):
        check_folder(tmp_path, {}, overwrite=False, resume=True)
    assert (tmp_path / NUMBERS_FILE).read_text() == content
