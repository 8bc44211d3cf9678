"""The laboratory on boxes, whose readings are closed forms, and its indices on populations counted by hand."""

from __future__ import annotations

import math

import bodies
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import Mesh, MeshError, database_recipe, generate
from lithoform.descriptors.hull import convex_hull
from lithoform.lab import (
    BAR_SLOTS,
    D4791_RATIOS,
    TEST_SIEVES,
    Share,
    flakiness_index,
    flat_and_elongated,
    laboratory,
    shape_index,
    sieve_curve,
)


@pytest.mark.parametrize(
    ("sides", "flaky", "non_cubical"),
    [
        ((30, 20, 15), False, False),
        ((30, 20, 10.1), False, True),
        ((30, 20, 9.9), True, True),
        ((30, 20, 8), True, True),
        ((30, 20, 5), True, True),
        ((12, 11, 10), False, False),
    ],
)
def test_a_box_is_read_as_its_formulas_say(sides, flaky, non_cubical):
    sides = tuple(1e-3 * s for s in sides)
    a, b, c = sides
    turn = bodies.random_rotation(np.random.default_rng(0))
    result = laboratory(bodies.transformed(bodies.box(sides), turn, shift=(1, 2, 3)))
    size = min(b, (b + c) / math.sqrt(2.0))
    assert result.volume == pytest.approx(a * b * c, rel=1e-9)
    assert result.sieve_size == pytest.approx(size, rel=1e-9)
    assert result.slot_width == pytest.approx(c, rel=1e-9)
    assert result.length == pytest.approx(math.hypot(*sides), rel=1e-9)
    assert result.flaky == flaky == (c <= 0.5 * size)
    assert result.shape_ratio == pytest.approx(math.hypot(*sides) / c, rel=1e-9)
    assert result.non_cubical == non_cubical == (math.hypot(*sides) > 3.0 * c)
    assert result.mass(2650.0) == pytest.approx(2650.0 * a * b * c, rel=1e-9)


def test_a_hull_alone_is_a_convex_body():
    mesh = bodies.box((3, 2, 1))
    assert laboratory(mesh) == laboratory(convex_hull(mesh))


def test_the_volume_of_a_stone_is_its_own_and_the_sizes_those_of_its_hull():
    mesh = generate(database_recipe("blade", seed=2)).mesh
    stone, hull = laboratory(mesh), laboratory(convex_hull(mesh))
    assert stone.volume == mesh.volume < hull.volume
    assert stone.sieve_size == hull.sieve_size
    assert stone.slot_width <= stone.thickness <= stone.width <= stone.length
    assert stone.slot_width <= stone.sieve_size <= stone.length
    assert stone.flat_elongated_ratio == pytest.approx(stone.flat_ratio * stone.elongated_ratio, rel=1e-14)


def test_a_body_inside_out_is_refused():
    box = bodies.box((1, 1, 1))
    with pytest.raises(MeshError, match="its volume is -1"):
        laboratory(Mesh(box.vertices, box.faces[:, ::-1].copy()))


def test_flakiness_by_count_and_mass_worked_by_hand():
    # Slots of half the size: 5, 10, 4 and 2 mm; the first and the last particle pass, one of them just.
    sizes, widths, masses = [10e-3, 20e-3, 8e-3, 4e-3], [5e-3, 10.1e-3, 6e-3, 1e-3], [10.0, 80.0, 9.0, 1.0]
    assert flakiness_index(sizes, widths, masses) == Share(50.0, 11.0)


def test_flakiness_in_the_fractions_of_the_standard_worked_by_hand():
    # 9 mm lies in 8/10, slot 5 mm; 10 mm too (it passes the sieve of 10); 10.1 mm in 10/12.5, slot 6.3 mm;
    # 30 mm in 25/31.5, slot 16 mm; 3.9 and 4 mm pass the sieve of 4 and 101 mm stays on that of 100: not tested.
    sizes = [9e-3, 10e-3, 10.1e-3, 30e-3, 3.9e-3, 4e-3, 101e-3]
    widths = [4.9e-3, 5.1e-3, 6.2e-3, 15.9e-3, 1e-3, 1e-3, 1e-3]
    masses = [1.0, 2.0, 3.0, 4.0, 50.0, 50.0, 50.0]
    share = flakiness_index(sizes, widths, masses, slots="fractions")
    assert share.by_count == pytest.approx(75.0)
    assert share.by_mass == pytest.approx(80.0)
    # By their own halves (4.5, 5, 5.05 and 15 mm) none of the four would be.
    assert flakiness_index(sizes[:4], widths[:4], masses[:4]) == Share(0.0, 0.0)


def test_the_slots_are_half_the_upper_sieves():
    assert len(BAR_SLOTS) == len(TEST_SIEVES) - 1
    assert np.array(BAR_SLOTS) == pytest.approx(0.5 * np.array(TEST_SIEVES[1:]), rel=0.02)
    assert np.diff(np.log(TEST_SIEVES)) == pytest.approx(np.full(14, math.log(10) / 10), rel=0.1)


def test_the_shape_index_counts_above_three():
    lengths, thicknesses = [3.0, 3.1, 9.0, 1.0], [1.0, 1.0, 2.0, 1.0]
    assert shape_index(lengths, thicknesses, [1.0, 2.0, 3.0, 4.0]) == Share(50.0, 50.0)
    assert shape_index(lengths, thicknesses, [1.0, 2.0, 3.0, 4.0], limit=4.0) == Share(25.0, 30.0)


def test_flat_and_elongated_worked_by_hand():
    # A cube, a plate 3 : 3 : 1, a rod 6 : 1 : 1, a blade 6 : 2.5 : 1.
    lengths, widths, thicknesses = [1.0, 3.0, 6.0, 6.0], [1.0, 3.0, 1.0, 2.5], [1.0, 1.0, 1.0, 1.0]
    found = flat_and_elongated(lengths, widths, thicknesses, [4.0, 3.0, 2.0, 1.0])
    assert tuple(f.ratio for f in found) == D4791_RATIOS
    two, three, _, five = found
    assert (two.flat, two.elongated, two.flat_and_elongated) == (Share(50, 40), Share(50, 30), Share(75, 60))
    assert (three.flat, three.elongated, three.flat_and_elongated) == (Share(0, 0), Share(25, 20), Share(50, 30))
    assert (five.flat, five.elongated, five.flat_and_elongated) == (Share(0, 0), Share(25, 20), Share(50, 30))


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 9999), n=st.integers(1, 40))
def test_a_higher_ratio_never_finds_more(seed, n):
    rng = np.random.default_rng(seed)
    thick, wide, long = np.sort(rng.uniform(1e-3, 1e-2, (n, 3)), axis=1).T
    found = flat_and_elongated(long, wide, thick, rng.uniform(0.0, 1.0, n) + 1e-3)
    for kind in ("flat", "elongated", "flat_and_elongated"):
        for part in ("by_count", "by_mass"):
            values = [getattr(getattr(f, kind), part) for f in found]
            assert values == sorted(values, reverse=True)
            assert values[-1] >= 0.0
            assert values[0] <= 100.0 + 1e-9
    for f in found:
        assert f.flat_and_elongated.by_count >= max(f.flat.by_count, f.elongated.by_count)


def test_the_sieve_curve_worked_by_hand():
    sizes, masses = [4e-3, 2e-3, 8e-3, 4e-3], [1.0, 2.0, 5.0, 2.0]
    curve = sieve_curve(sizes, masses, [1e-3, 2e-3, 3.9e-3, 4e-3, 10e-3, 5e-3])
    assert curve == pytest.approx([0.0, 20.0, 20.0, 50.0, 100.0, 50.0])


def test_a_sieve_curve_rises_to_a_hundred():
    rng = np.random.default_rng(1)
    curve = sieve_curve(rng.uniform(1e-3, 30e-3, 500), rng.uniform(0, 1, 500), np.linspace(1e-4, 30e-3, 60))
    assert (np.diff(curve) >= 0.0).all()
    assert curve[0] == 0.0
    assert curve[-1] == 100.0


def test_shares_by_mass_do_not_depend_on_the_unit_of_mass():
    rng = np.random.default_rng(2)
    sizes, widths, masses = rng.uniform(4e-3, 30e-3, 50), rng.uniform(1e-3, 9e-3, 50), rng.uniform(0, 1, 50)
    one, two = flakiness_index(sizes, widths, masses), flakiness_index(sizes, widths, 2650.0 * masses)
    assert one.by_count == two.by_count
    assert one.by_mass == pytest.approx(two.by_mass, rel=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: shape_index([], [], []), "at least one particle, got an empty population"),
        (lambda: sieve_curve([], [], [1e-3]), "at least one particle, got an empty population"),
        (lambda: shape_index([1.0, 2.0], [1.0], [1.0, 1.0]), r"lengths \(2,\), thicknesses \(1,\), masses \(2,\)"),
        (lambda: shape_index([[1.0]], [[1.0]], [[1.0]]), "one value a particle"),
        (lambda: shape_index([2.0, 3.0], [1.0, 1.0], [1.0, -2.0]), "not negative in masses, got -2 for particle 1"),
        (lambda: shape_index([2.0], [0.0], [1.0]), "positive lengths in thicknesses, got 0 for particle 0"),
        (lambda: shape_index([math.nan], [1.0], [1.0]), "positive lengths in lengths, got nan for particle 0"),
        (lambda: shape_index([1.0], [1.0], [0.0]), "all masses are 0"),
        (lambda: flakiness_index([1e-3], [1e-3], [1.0], slots="fractions"), "from 1 to 1 mm, is outside"),
        (lambda: flakiness_index([9.0], [1.0], [1.0], slots="both"), "half or fractions; got 'both'"),
        (
            lambda: flakiness_index([9e-3, 2e-3], [1e-3, 1e-3], [0.0, 1.0], slots="fractions"),
            "tested particles with a mass",
        ),
        (lambda: sieve_curve([1.0], [1.0], [0.0]), "openings as a list of positive lengths"),
        (lambda: sieve_curve([1.0], [1.0], 2.0), "openings as a list of positive lengths"),
        (lambda: flat_and_elongated([1.0], [math.inf], [1.0], [1.0]), "positive lengths in widths, got inf"),
    ],
)
def test_what_is_no_population_is_refused_in_one_sentence(call, message):
    with pytest.raises(MeshError, match=message):
        call()


@pytest.mark.parametrize("ratio", [0.0, -1.0, math.nan, math.inf])
def test_a_ratio_that_is_no_positive_number_is_refused(ratio):
    # Compared with nan no particle is elongated, and the share came out as 0 without a word.
    with pytest.raises(MeshError, match="ratios as positive numbers"):
        flat_and_elongated([2.0], [1.0], [0.5], [1.0], ratios=[3.0, ratio])
    with pytest.raises(MeshError, match="ratios as positive numbers"):
        shape_index([2.0], [1.0], [1.0], limit=ratio)
