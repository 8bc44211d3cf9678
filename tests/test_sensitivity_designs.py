"""Designs: what each point sets, that seeds are common, and that a database carries them out and resumes them."""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lithoform.axes import EXTRA_AXES, TABLE_7, Axis, axis_values
from lithoform.database.building import Measures, build
from lithoform.database.store import Store
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, OutputError, RecipeError, SampleError
from lithoform.generation import generate
from lithoform.parameters import Recipe
from lithoform.presets import benchmark_recipe, particle_seed
from lithoform.sensitivity.designs import (
    OneAtATime,
    Points,
    axes_for,
    latin_hypercube,
    morris_trajectories,
    saltelli_sample,
    sobol_sequence,
)
from lithoform.sensitivity.responses import read_responses
from lithoform.sensitivity.twist import TwistDesign

COARSE = benchmark_recipe(triangles=128)
QUICK = Measures(names=("four",))
QUICKEST = Measures(names=("boxiness",))
GAIN = Axis("gain", "linear", 0.0, 1.0)
TWIST = Axis("twist_rate", "linear", 0.0, 60.0)


def digest(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def made(folder: Path, design, measures: Measures = QUICK, *, workers: int = 0, source: str = "design") -> list[int]:
    return list(build(folder, design, measures, source=source, workers=workers))


# -------------------------------------------------------------------------------------------------------- one at a time


def test_the_sweep_of_the_paper_has_15_parameters_11_points_and_30_seeds():
    design = OneAtATime(seeds=30)
    design.validate()
    assert design.count == (15 * 11 + 1) * 30
    assert [len(design.values(i)) for i in range(15)] == [11] * 15
    for i, axis in enumerate(TABLE_7):
        values = design.values(i)
        assert (values[0], values[-1]) == (axis.low, axis.high)
        steps = np.diff([axis.coordinate(value) for value in values])
        assert steps == pytest.approx(np.full(10, 0.1))
    octaves = design.values([axis.name for axis in TABLE_7].index("octaves"))
    assert octaves == tuple(range(11))
    assert all(type(value) is int for value in octaves)


def test_whole_values_are_made_once():
    design = OneAtATime(axes=(Axis("octaves", "linear", 0, 3), GAIN), points=11)
    assert design.values(0) == (0, 1, 2, 3)
    assert design.points_of(1) == range(5, 16)
    assert design.point_count == 16


def test_each_point_differs_from_the_base_in_one_axis_and_all_share_their_seeds():
    base = replace(COARSE, triangles=1280)
    design = OneAtATime(seeds=2, points=3, seed=9, base=base)
    assert [design.recipe(n).seed for n in (1, 2)] == [particle_seed(9, 1), particle_seed(9, 2)]
    assert design.recipe(1) == replace(base, seed=particle_seed(9, 1))
    for i, axis in enumerate(TABLE_7):
        for point in design.points_of(i):
            for k in (0, 1):
                recipe = design.recipe(point * 2 + k + 1)
                assert design.place(point * 2 + k + 1) == (point, k)
                plain = replace(recipe, **{axis.name: getattr(base, axis.name)})
                assert plain == replace(base, seed=particle_seed(9, k + 1))
                value = axis_values(recipe, (axis.name,))[axis.name]
                assert value == design.values(i)[point - design.points_of(i).start]


def test_of_another_seed_all_stones_are_others():
    one, other = (OneAtATime(seeds=2, points=3, seed=seed) for seed in (0, 1))
    assert {one.recipe(n).seed for n in (1, 2)} & {other.recipe(n).seed for n in (1, 2)} == set()


# -------------------------------------------------------------------------------------------------- spaces of many axes


def test_a_latin_hypercube_has_one_point_in_every_slice():
    table = latin_hypercube(40, 5, seed=3)
    for column in table.T:
        assert sorted(np.floor(40 * column).astype(int)) == list(range(40))
    assert (table == latin_hypercube(40, 5, seed=3)).all()
    assert (table != latin_hypercube(40, 5, seed=4)).any()


def test_a_sobol_sequence_is_a_net():
    # A (0, m, s)-net in base 2 in two dimensions: each elementary box of 1/16 holds one of 16 points.
    table = sobol_sequence(16, 2, seed=5)
    for split in range(5):
        cells = np.stack([np.floor(table[:, 0] * 2**split), np.floor(table[:, 1] * 2 ** (4 - split))], axis=1)
        assert len(np.unique(cells, axis=0)) == 16


def test_morris_moves_one_input_a_step_and_each_once_a_trajectory():
    axes = axes_for(5000)
    design = morris_trajectories(axes, trajectories=6, levels=4, seed=2, seeds=3)
    assert design.count == 6 * 20 * 3
    for path in design.coordinates.reshape(6, 20, 19):
        steps = np.diff(path, axis=0)
        moved = np.abs(steps) > 1e-12
        assert (moved.sum(axis=1) == 1).all()
        assert (moved.sum(axis=0) == 1).all()
        assert np.abs(steps[moved]) == pytest.approx(np.full(19, 2 / 3))
    assert 3.0 * design.coordinates == pytest.approx(np.round(3.0 * design.coordinates), abs=1e-9)


def test_saltelli_exchanges_one_column_a_point():
    design = saltelli_sample(axes_for(5000), samples=8, seed=2)
    for block in design.coordinates.reshape(8, 21, 19):
        first, last = block[0], block[-1]
        for j in range(19):
            expected = first.copy()
            expected[j] = last[j]
            assert (block[1 + j] == expected).all()


def test_the_range_of_the_smoothing_follows_the_triangles():
    reach = {t: next(a.high for a in axes_for(t) if a.name == "smoothing_iterations") for t in (1280, 5000, 20_000)}
    assert reach == {20_000: 200, 5000: 50, 1280: 13}
    assert [a.name for a in axes_for(5000)] == [a.name for a in (*TABLE_7, *EXTRA_AXES)]


def test_dimensions_are_inputs():
    axes = (Axis("elongation", "linear", 0.5, 1.0), Axis("flatness", "linear", 0.5, 1.0), GAIN)
    design = Points(axes=axes, coordinates=np.array([[0.0, 1.0, 0.25]]))
    assert design.recipe(1).size == pytest.approx((2.0, 1.0, 1.0))
    assert design.recipe(1).gain == 0.25


def test_another_table_of_coordinates_is_another_design():
    one, other = (Points(axes=(GAIN,), coordinates=np.array([[x]])) for x in (0.1, 0.1 + 1e-16 + 1e-15))
    assert one.as_dict() != other.as_dict()
    assert one.as_dict() == Points(axes=(GAIN,), coordinates=[[0.1]]).as_dict()


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: OneAtATime(points=1), "at least 2 points"),
        (lambda: OneAtATime(axes=()), "one or more axes"),
        (lambda: OneAtATime(axes=(GAIN, GAIN)), "each once"),
        (lambda: OneAtATime(seeds=0).validate(), "1 seed"),
        (lambda: OneAtATime(seeds=10**6).validate(), "fewer points"),
        (lambda: OneAtATime(seed=-1).validate(), "seed must be"),
        (lambda: Points(axes=(GAIN,), coordinates=[[0.5, 0.5]]), "a column an axis"),
        (lambda: Points(axes=(GAIN,), coordinates=[[1.5]]), "from 0 to 1"),
        (lambda: Points(axes=(GAIN,), coordinates=[[float("nan")]]), "from 0 to 1"),
        (lambda: latin_hypercube(0, 1, 0), "at least 1 point"),
        (lambda: sobol_sequence(12, 1, 0), "power of two"),
        (lambda: saltelli_sample((GAIN,), samples=2), "power of two"),
        (lambda: morris_trajectories((GAIN,), trajectories=1), "2 trajectories"),
        (lambda: morris_trajectories((GAIN,), trajectories=4, levels=3), "even number"),
        (lambda: TwistDesign(rates=(30.0, 0.0)), "rising"),
    ],
)
def test_what_is_no_design_is_refused(wrong, told):
    with pytest.raises(RecipeError, match=told):
        wrong()


# ------------------------------------------------------------------------------------------------------------ databases


def test_a_design_in_a_database_has_the_stones_of_its_recipes(tmp_path):
    from lithoform.descriptors.measuring import measure

    design = OneAtATime(axes=(GAIN, TWIST), points=2, seeds=2, base=COARSE)
    assert made(tmp_path / "db", design) == list(range(1, 11))
    values = read_responses(tmp_path / "db", "design", design).values
    assert values.shape == (5, 2, 4)
    for number in (1, 4, 10):
        point, k = design.place(number)
        found = measure(generate(design.recipe(number)), FOUR)
        assert values[point, k].tolist() == [found[name] for name in FOUR]


@pytest.mark.parametrize("workers", [0, 2])
def test_stopped_and_resumed_or_spread_it_has_the_same_bytes(tmp_path, workers):
    design = OneAtATime(axes=(GAIN, TWIST), points=3, seeds=10, base=COARSE)
    made(tmp_path / "whole", design, QUICKEST)
    numbers = build(tmp_path / "torn", design, QUICKEST, source="design", workers=0)
    list(itertools.islice(numbers, 30))
    numbers.close()
    assert 0 < len(Store(tmp_path / "torn").files) < 3
    made(tmp_path / "torn", design, QUICKEST, workers=workers)
    assert digest(tmp_path / "torn") == digest(tmp_path / "whole")


def test_settings_that_cannot_go_together_become_rows_with_their_reason(tmp_path):
    # 128 triangles follow a twist of 60 degrees a unit at r = 0.5, but not at r = 5.
    axes = (Axis("base_radius", "linear", 0.5, 5.0), TWIST)
    design = Points(axes=axes, coordinates=[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0]], seeds=2, base=COARSE)
    with pytest.raises(RecipeError):
        design.recipe(3)
    assert made(tmp_path / "db", design) == [1, 2, 3, 4, 5, 6]
    table = Store(tmp_path / "db").table(["number", "error", "class", "base_radius", "roundness"])
    rows = table.to_pylist()
    assert [row["error"] is None for row in rows] == [True, True, False, False, True, True]
    assert "cannot follow a twist" in rows[2]["error"]
    assert rows[2]["base_radius"] is None
    assert rows[2]["roundness"] is None
    found = read_responses(tmp_path / "db", "design", design)
    assert found.made.tolist() == [2, 0, 2]
    assert np.isnan(found.means).any(axis=1).tolist() == [False, True, False]
    assert found.left_out().startswith("2 stones could not be made, 2 of them because: 128 triangles cannot follow")
    # A finished design is not made again, rows in error included.
    before = digest(tmp_path / "db")
    assert made(tmp_path / "db", design) == [1, 2, 3, 4, 5, 6]
    assert digest(tmp_path / "db") == before


def test_one_folder_holds_several_designs_but_not_two_of_one_name(tmp_path):
    one = OneAtATime(axes=(GAIN,), points=2, base=COARSE)
    made(tmp_path / "db", one, QUICKEST, source="oat")
    made(tmp_path / "db", Points(axes=(GAIN,), coordinates=[[0.5]], base=COARSE), QUICKEST, source="points")
    assert list(Store(tmp_path / "db").sources) == ["oat", "points"]
    with pytest.raises(OutputError, match=r"other settings .*points differ"):
        made(tmp_path / "db", OneAtATime(axes=(GAIN,), points=3, base=COARSE), QUICKEST, source="oat")


def test_responses_of_a_part_or_of_nothing_are_refused(tmp_path):
    design = OneAtATime(axes=(GAIN,), points=3, seeds=10, base=COARSE)
    numbers = build(tmp_path / "db", design, QUICKEST, source="oat", workers=0)
    next(numbers)
    numbers.close()
    with pytest.raises(FileFormatError, match="25 of 40 particles"):
        read_responses(tmp_path / "db", "oat", design)
    with pytest.raises(FileFormatError, match="no such source"):
        read_responses(tmp_path / "db", "sobol", design)
    impossible = Points(axes=(Axis("base_radius", "linear", 4.0, 5.0),), coordinates=[[1.0]],
                        base=Recipe(triangles=128, twist_rate=60.0))  # fmt: skip
    made(tmp_path / "none", impossible)
    with pytest.raises(SampleError, match="no stone of the design"):
        read_responses(tmp_path / "none", "design", impossible)


def test_the_share_of_the_scatter_is_that_of_known_variances(tmp_path):
    from lithoform.sensitivity.responses import Responses

    # Means 0 and 1 exactly, variance 2 d^2 / 1 within each point.
    values = np.zeros((2, 2, 4))
    values[1] = 1.0
    values[:, 0] -= 0.1
    values[:, 1] += 0.1
    found = Responses(values, {})
    assert found.noise_shares == pytest.approx(np.full(4, (0.02 / 2) / 0.5))
    assert np.isnan(Responses(values[:, :1], {}).noise_shares).all()


# ---------------------------------------------------------------------------------------------- truths of the generator


def test_without_twist_the_base_radius_changes_nothing():
    # Eq. 1 to 9 know the direction alone, and the calibration takes the size away; the twist alone has a length.
    axis = Axis("base_radius", "linear", 0.05, 5.0)
    design = OneAtATime(axes=(axis,), points=3, base=replace(COARSE, triangles=1280, twist_rate=0.0))
    stones = [generate(design.recipe(number)).mesh for number in (2, 3, 4)]
    for mesh in stones[1:]:
        assert np.abs(mesh.vertices - stones[0].vertices).max() < 1e-12


def test_solidity_does_not_know_the_dimensions():
    # The calibration to L x W x H is affine, and volume and hull go alike under affine maps.
    from lithoform.descriptors.measuring import measure

    axes = (Axis("elongation", "linear", 0.4, 1.0), Axis("flatness", "linear", 0.4, 1.0))
    base = replace(COARSE, triangles=1280, flatten=False)
    design = Points(axes=axes, coordinates=[[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]], base=base)
    solid = [measure(generate(design.recipe(n)), ("solidity",))["solidity"] for n in (1, 2, 3)]
    assert solid == pytest.approx([solid[0]] * 3, rel=1e-9)


def test_designs_of_too_many_stones_are_refused_before_they_are_drawn():
    with pytest.raises(RecipeError, match="at most 10,000,000 particles"):
        saltelli_sample(TABLE_7, samples=1 << 30)
    with pytest.raises(RecipeError, match="at most 10,000,000 particles"):
        morris_trajectories(TABLE_7, trajectories=10**9)
