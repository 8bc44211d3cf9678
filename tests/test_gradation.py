"""Gradations against the standards' numbers, closed forms of the number density, and real stones sieved again."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lithoform import FileFormatError, Mesh, RecipeError, database_recipe, generate
from lithoform.descriptors.hull import convex_hull
from lithoform.descriptors.passing import sieve_size
from lithoform.gradation.curves import GRADATIONS, Gradation, find_gradation, fuller, read_gradation
from lithoform.gradation.drawing import TOLERANCE, draw_sizes, retained
from lithoform.gradation.quantities import parse_length
from lithoform.lab import sieve_curve

SPHERE = math.pi / 6.0
CUT = 2.36e-3
# The paper's compactor: 58 % of a mould of 150 mm at a height of 63.5 mm [m^3].
MOULD = 0.58 * math.pi / 4.0 * 0.150**2 * 0.0635
UNIT_VOLUMES = np.random.default_rng(7).uniform(0.25, 0.75, 150)


# The curves themselves


def test_ac_13_has_the_limits_of_the_standard_as_the_specification_quotes_them():
    quoted = (
        "16 mm 100; 13.2 mm 90-100; 9.5 mm 68-85; 4.75 mm 38-68; 2.36 mm 24-50; 1.18 mm 15-38; 0.6 mm 10-28; "
        "0.3 mm 7-20; 0.15 mm 5-15; 0.075 mm 4-8"
    )
    rows = [re.fullmatch(r"([\d.]+) mm (\d+)(?:-(\d+))?", part).groups() for part in quoted.split("; ")]
    curve = GRADATIONS["AC-13"]
    assert curve.openings == tuple(float(f"{size}e-3") for size, _, _ in rows)
    assert curve.passing_low == tuple(float(low) for _, low, _ in rows)
    assert curve.passing_high == tuple(float(high or low) for _, low, high in rows)
    assert curve.mid == (100, 95, 76.5, 53, 37, 26.5, 19, 13.5, 10, 6)


@pytest.mark.parametrize(
    ("name", "grading_number"),
    [("A16", 4.60), ("B16", 3.66), ("C16", 2.75), ("A32", 5.48), ("B32", 4.20), ("C32", 3.30)],
)
def test_the_concrete_curves_have_their_published_grading_numbers(name, grading_number):
    # Körnungsziffer k: percent retained on 0.25, 0.5, 1, 2, 4, 8, 16, 31.5 and 63 mm, over 100.
    sieves = 1e-3 * np.array([0.25, 0.5, 1, 2, 4, 8, 16, 31.5, 63])
    assert np.sum(100.0 - GRADATIONS[f"DIN {name}"].passing(sieves)) / 100 == pytest.approx(grading_number, abs=1e-9)


def test_the_middle_of_c33_sand_has_a_fineness_modulus_within_the_limits_of_c33():
    sieves = 1e-3 * np.array([0.15, 0.3, 0.6, 1.18, 2.36, 4.75, 9.5])
    modulus = np.sum(100.0 - GRADATIONS["ASTM C33 fine"].passing(sieves)) / 100
    assert 2.3 <= modulus <= 3.1


def test_fuller_is_the_square_root_on_its_sieves():
    for curve in (find_gradation("Fuller-16"), find_gradation("fuller-20"), fuller(0.0315)):
        largest = curve.openings[0]
        assert curve.mid == pytest.approx([100 * math.sqrt(d / largest) for d in curve.openings], rel=1e-15)
        assert curve.openings[-1] == pytest.approx(0.063e-3)
    assert find_gradation("Fuller-20").openings[:2] == (0.020, 0.016)
    assert find_gradation("Fuller-16").passing(4e-3) == pytest.approx(50.0, rel=1e-15)
    assert fuller(0.016, 0.45).passing(4e-3) == pytest.approx(100 * 0.25**0.45, rel=1e-15)


def test_the_curve_is_linear_in_the_logarithm_of_the_size():
    curve = Gradation("two sieves", (16e-3, 4e-3), (100, 20), (100, 40))
    assert curve.passing([32e-3, 16e-3, 8e-3, 4e-3]) == pytest.approx([100, 100, 65, 30], rel=1e-14)
    assert curve.passing(8e-3, "low") == pytest.approx(60.0, rel=1e-14)
    assert curve.passing(4e-3 * 2**0.5, "high") == pytest.approx(40 + 60 / 4, rel=1e-14)
    with pytest.raises(RecipeError, match="at least 4 mm, the finest sieve"):
        curve.passing([3.9e-3, 8e-3])


def test_fractions_of_ac_13_cut_at_2_36_mm_worked_by_hand():
    cut = retained(GRADATIONS["AC-13"], CUT)
    assert cut.openings == (16e-3, 13.2e-3, 9.5e-3, 4.75e-3, 2.36e-3)
    assert cut.shares == pytest.approx([5 / 63, 18.5 / 63, 23.5 / 63, 16 / 63], rel=1e-14)
    assert cut.passing == pytest.approx([100, 100 * 58 / 63, 100 * 39.5 / 63, 100 * 16 / 63, 0], abs=1e-12)
    # The quotient is another float than the decimal; it is the same sieve.
    quotient = 2.36 / 1000
    assert quotient != CUT
    assert retained(GRADATIONS["AC-13"], quotient).openings == cut.openings


def test_a_cut_between_two_sieves_becomes_a_sieve():
    curve = Gradation("two sieves", (16e-3, 4e-3, 1e-3), (100, 30, 10), (100, 30, 10))
    cut = retained(curve, 8e-3)
    assert (cut.openings, cut.shares) == ((16e-3, 8e-3), (1.0,))
    cut = retained(curve, 2e-3)
    assert cut.openings == (16e-3, 4e-3, 2e-3)
    assert cut.shares == pytest.approx([70 / 80, 10 / 80], rel=1e-14)
    assert retained(curve).shares == pytest.approx([70 / 90, 20 / 90], rel=1e-14)
    with pytest.raises(RecipeError, match="nothing is coarser"):
        retained(curve, 20e-3)
    with pytest.raises(RecipeError, match="at least 1 mm"):
        retained(curve, 0.5e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"openings": (1e-3, 2e-3)}, "from the coarsest to the finest"),
        ({"openings": (2e-3, 0.0)}, "positive openings"),
        ({"openings": (2e-3, math.nan)}, "positive openings"),
        ({"openings": (2e-3, 2e-3 * (1.0 - 1e-9))}, "each finer than the last by"),
        ({"openings": (1e300, 1e-3)}, "openings of 1e-09 to 1000 m"),
        ({"openings": (1e-3, 1e-300)}, "openings of 1e-09 to 1000 m"),
        ({"openings": (2e-3, 1e-3, 5e-4)}, "one value a sieve; got 3 openings, 2 and 2"),
        ({"passing_low": (100, math.nan)}, "percentages of 0 to 100"),
        ({"passing_low": (50, 60)}, "that fall with the opening"),
        ({"passing_high": (101, 60)}, "percentages of 0 to 100"),
        ({"passing_low": (98, 40)}, "only 98 % through its coarsest sieve"),
        ({"passing_low": (100, 70)}, "exchange the two columns"),
    ],
)
def test_what_is_no_gradation_is_refused(changes, message):
    good = {"openings": (2e-3, 1e-3), "passing_low": (100, 40), "passing_high": (100, 60)}
    Gradation("good", **good)
    with pytest.raises(RecipeError, match=message):
        Gradation("bad", **{**good, **changes})


def test_names_are_found_in_any_case_and_the_nearest_is_named():
    assert find_gradation("ac-13") is GRADATIONS["AC-13"]
    assert all(curve.citation for curve in GRADATIONS.values())
    with pytest.raises(RecipeError, match="Did you mean SMA-13"):
        find_gradation("SMA13")
    with pytest.raises(RecipeError, match="largest size"):
        find_gradation("Fuller-900")
    with pytest.raises(RecipeError, match="low, mid, high"):
        GRADATIONS["AC-13"].curve("median")


# Files and lengths


def test_a_csv_file_is_read_in_any_order_of_lines(tmp_path):
    file = tmp_path / "quarry 7.csv"
    file.write_text("# sieved in May\nsize_mm, Passing\n4.75,53\n16,100\n\n9.5, 76.5\n", encoding="utf-8")
    curve = read_gradation(file)
    assert (curve.name, curve.openings, curve.mid) == ("quarry 7", (0.016, 9.5e-3, 4.75e-3), (100, 76.5, 53))
    file.write_text('\ufeff"high",size_um,low\n40,75,20\n100,16000,100\n', encoding="utf-8")
    curve = read_gradation(file)
    assert (curve.openings, curve.passing_low, curve.passing_high) == ((0.016, 75e-6), (100, 20), (100, 40))
    drawn = draw_sizes(read_gradation(file), mass=0.5, min_size=2e-3, seed=0)
    assert drawn.passing == pytest.approx([100, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected the columns .* got nothing"),
        ("size,passing\n16,100\n", "expected the columns .* got size, passing"),
        ("size_mm,low\n16,100\n", "size_mm, low and high"),
        ("size_mm,passing\n16,100\n4,x\n", "line 3: expected 2 numbers"),
        ("size_mm,passing\n16,100\n4,50,7\n", "line 3: expected 2 numbers"),
        ("size_mm,passing\n16,100\n-4,50\n", "line 3"),
        ("size_mm,passing\n16,100\n", "two sieves or more"),
        ("size_mm,passing\n16,90\n4,50\n", "add the sieve that everything passes"),
        ("size_mm,passing\n16,100\n16,90\n4,50\n", "each once"),
        ('size_mm,passing\n16,"100\n4,50\n8,200\n', "percentages of 0 to 100"),
    ],
)
def test_a_bad_file_is_refused_with_its_name(tmp_path, text, message):
    file = tmp_path / "bad.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=message) as caught:
        read_gradation(file)
    assert "bad.csv" in str(caught.value)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="No such file"):
        read_gradation(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="it is not text"):
        read_gradation(tmp_path / "binary.csv")


def test_lengths_are_the_floats_of_their_decimals():
    assert parse_length("2.36mm") == parse_length(" 2.36 ") == parse_length("0.00236 m") == 0.00236
    assert parse_length("75um") == parse_length("75 µm") == parse_length("75", "um") == 75e-6
    assert parse_length("0.5 in") == pytest.approx(0.0127, rel=1e-15)
    assert parse_length("1.5e1CM") == 0.15
    for text in ("", "mm", "2,36", "-1 mm", "0", "1e999", "1e99999999", "nan", "2.36 furlong"):
        with pytest.raises(RecipeError):
            parse_length(text)


# Draws


@pytest.mark.parametrize("name", GRADATIONS)
@pytest.mark.parametrize("spread", ["mass", "count"])
def test_every_named_curve_is_met_at_every_sieve(name, spread):
    curve = GRADATIONS[name]
    # A cut that leaves some thousands of particles.
    least = max(curve.openings[-1], curve.openings[0] / 10)
    drawn = draw_sizes(curve, mass=4e5 * curve.openings[0] ** 3 * SPHERE * 50, min_size=least,
                       unit_volumes=UNIT_VOLUMES, spread=spread, seed=1)  # fmt: skip
    wanted = curve.passing([d for d in curve.openings if d >= least] + [least])
    wanted = 100 * (wanted - wanted[-1]) / (100 - wanted[-1])
    openings = [d for d in curve.openings if d >= least] + [least]
    again = sieve_curve(drawn.sizes, drawn.masses, openings)
    assert np.abs(again - wanted).max() < 1e-9 < TOLERANCE
    assert drawn.masses.sum() == pytest.approx(4e5 * curve.openings[0] ** 3 * SPHERE * 50, rel=1e-12)


def test_the_stones_of_the_compactor_as_the_specification_counts_them():
    # Spheres of the sieve size, their number even over ln d in each fraction: V_f / (pi/6 E[d^3]).
    drawn = draw_sizes(GRADATIONS["AC-13"], volume=MOULD, min_size=CUT, spread="count", unit_volumes=SPHERE, seed=0)
    assert drawn.counts == pytest.approx([31, 250, 1278, 7063], rel=0.035)
    assert drawn.counts[1:] == pytest.approx([250, 1278, 7063], rel=0.006)
    assert len(drawn.sizes) == pytest.approx(8622, rel=0.002)


def test_more_stones_fill_the_compactor_when_the_mass_is_even_within_a_fraction():
    drawn = draw_sizes(GRADATIONS["AC-13"], volume=MOULD, min_size=CUT, unit_volumes=SPHERE, seed=0)
    edges = [(13.2e-3, 16e-3), (9.5e-3, 13.2e-3), (4.75e-3, 9.5e-3), (2.36e-3, 4.75e-3)]
    # Trapezia in ln d of dN = dM / (density c d^3): independent of the sampler's closed form.
    expected = []
    for (a, b), share in zip(edges, np.array([5, 18.5, 23.5, 16]) / 63, strict=True):
        d = np.exp(np.linspace(math.log(a), math.log(b), 20001))
        expected.append(share * MOULD / SPHERE * float(np.mean(0.5 * (d[1:] ** -3 + d[:-1] ** -3))))
    assert np.abs(drawn.counts - expected).max() <= 1.0
    assert 9_000 <= len(drawn.sizes) <= 12_200


@pytest.mark.parametrize("seed", [0, 1])
def test_within_a_fraction_the_mass_follows_the_curve(seed):
    # At sizes between the sieves, which nothing in the draw corrects: one fraction of ratio 4.
    curve = Gradation("two sieves", (16e-3, 4e-3), (100, 0), (100, 0))
    drawn = draw_sizes(curve, count=20_000, unit_volumes=UNIT_VOLUMES, seed=seed)
    between = np.geomspace(4e-3, 16e-3, 41)
    by_mass = sieve_curve(drawn.sizes, drawn.masses, between)
    assert np.abs(by_mass - curve.passing(between)).max() < 0.6
    # The number: N(d) = (a^-3 - d^-3) / (a^-3 - b^-3); by mass and by number are far apart.
    by_count = sieve_curve(drawn.sizes, np.ones(20_000), between)
    closed = 100 * (4e-3**-3 - between**-3) / (4e-3**-3 - 16e-3**-3)
    assert np.abs(by_count - closed).max() < 0.3
    assert np.abs(by_count - by_mass).max() > 30


def test_with_the_number_even_the_mass_goes_with_the_cube():
    curve = Gradation("two sieves", (16e-3, 4e-3), (100, 0), (100, 0))
    drawn = draw_sizes(curve, count=20_000, unit_volumes=UNIT_VOLUMES, spread="count", seed=5)
    between = np.geomspace(4e-3, 16e-3, 41)
    by_count = sieve_curve(drawn.sizes, np.ones(20_000), between)
    assert np.abs(by_count - np.linspace(0, 100, 41)).max() < 0.3
    closed = 100 * (between**3 - 4e-3**3) / (16e-3**3 - 4e-3**3)
    assert np.abs(sieve_curve(drawn.sizes, drawn.masses, between) - closed).max() < 0.6


def test_masses_are_those_of_the_scaled_candidates_and_sizes_lie_in_their_fractions():
    drawn = draw_sizes(GRADATIONS["AC-13"], mass=1.5, min_size=CUT, density=2700.0, unit_volumes=UNIT_VOLUMES, seed=2)
    assert drawn.masses == pytest.approx(2700.0 * UNIT_VOLUMES[drawn.candidates] * drawn.sizes**3, rel=1e-15)
    openings = np.array(drawn.fractions.openings)
    assert (drawn.sizes < openings[drawn.fraction]).all()
    assert (drawn.sizes > openings[drawn.fraction + 1]).all()
    assert (np.diff(drawn.sizes) < 0).all()
    # Dealt like cards: in each fraction no candidate is used twice more than another.
    for i in range(4):
        used = np.bincount(drawn.candidates[drawn.fraction == i], minlength=150)
        assert used.max() - used.min() <= 1
    # Large stones are not of other shapes than small ones.
    ranks = np.argsort(np.argsort(UNIT_VOLUMES[drawn.candidates[drawn.fraction == 3]]))
    assert abs(np.corrcoef(ranks, np.arange(len(ranks)))[0, 1]) < 4 / math.sqrt(len(ranks))


@settings(deadline=None, max_examples=25)
@example(count=700, seed=5000, spread="mass", name="AC-13")
@given(
    count=st.integers(700, 4000),
    seed=st.integers(0, 2**64 - 1),
    spread=st.sampled_from(["mass", "count"]),
    name=st.sampled_from(["AC-13", "SMA-13", "OGFC-13"]),
)
def test_a_count_is_met_exactly_and_its_mass_gives_the_same_fractions(count, seed, spread, name):
    options = {"min_size": CUT, "unit_volumes": UNIT_VOLUMES, "spread": spread, "seed": seed}
    drawn = draw_sizes(GRADATIONS[name], count=count, **options)
    assert len(drawn.sizes) == count == drawn.counts.sum()
    assert np.abs(drawn.passing - drawn.fractions.passing).max() < TOLERANCE
    again = draw_sizes(GRADATIONS[name], mass=float(drawn.masses.sum()) * (1 + 1e-9), **options)
    # One stone more or less, or as many as weigh less than the curve's tolerance: where the coarsest fraction is a
    # stone or two, a mass is met by a few of the finest.
    weight = drawn.masses.sum() / drawn.counts.sum()
    allowed = np.maximum(1.0, TOLERANCE / 100.0 * drawn.masses.sum() / weight)
    assert (np.abs(again.counts - drawn.counts) <= allowed).all()


@pytest.mark.parametrize("count", [100, 101, 1001])
@pytest.mark.parametrize("spread", ["mass", "count"])
def test_fractions_that_gain_particles_at_the_same_mass_share_an_odd_count(count, spread):
    # Half the size and an eighth of the mass: always as many particles in the one as in the other.
    curve = Gradation("alike", (16e-3, 8e-3, 4e-3), (100, 20, 10), (100, 20, 10))
    drawn = draw_sizes(curve, count=count, spread=spread, seed=0)
    assert drawn.counts.tolist() == [(count + 1) // 2, count // 2]
    assert np.abs(drawn.passing - [100, 100 / 9, 0]).max() < 1e-9


@settings(deadline=None, max_examples=25)
@given(scale=st.floats(0.01, 100.0), seed=st.integers(0, 2**64 - 1))
def test_a_curve_of_larger_stones_is_the_same_draw_enlarged(scale, seed):
    small = Gradation("small", (16e-3, 8e-3, 4e-3), (100, 60, 20), (100, 60, 20))
    large = Gradation("large", tuple(scale * d for d in small.openings), small.mid, small.mid)
    one = draw_sizes(small, mass=0.3, unit_volumes=UNIT_VOLUMES, seed=seed)
    other = draw_sizes(large, mass=0.3 * scale**3 * (1 + 1e-9), unit_volumes=UNIT_VOLUMES, seed=seed)
    assert (one.counts == other.counts).all()
    assert (one.candidates == other.candidates).all()
    assert other.sizes == pytest.approx(scale * one.sizes, rel=1e-7)


def test_a_seed_is_a_draw_bit_for_bit_and_zero_is_a_seed():
    options = {"mass": 0.5, "min_size": CUT, "unit_volumes": UNIT_VOLUMES}
    draws = {s: draw_sizes(GRADATIONS["AC-13"], seed=s, **options) for s in (0, 1, 2**64 - 1)}
    again = draw_sizes(GRADATIONS["AC-13"], seed=0, **options)
    for field in ("sizes", "candidates", "masses", "fraction"):
        assert getattr(draws[0], field).tobytes() == getattr(again, field).tobytes()
    assert len({d.candidates[:50].tobytes() for d in draws.values()}) == 3
    # The words of Philox are those of every version of NumPy: the first candidates are a fixed list.
    words = np.random.Philox(key=np.array([0, 0], dtype=np.uint64)).random_raw(150)
    assert (draws[0].candidates[:5] == np.argsort(words)[:5]).all()


@pytest.mark.parametrize("name", ["AC-13", "ASTM C33 #57", "DIN A32"])
@pytest.mark.parametrize("amount", ["mass", "count", "volume"])
def test_too_little_is_refused_and_the_named_amount_is_always_enough(name, amount):
    options = {"min_size": CUT, "unit_volumes": UNIT_VOLUMES, "seed": 4}
    tiny = 3 if amount == "count" else 1e-9
    with pytest.raises(RecipeError, match=f"is too small a {amount} for whole particles") as caught:
        draw_sizes(GRADATIONS[name], **{amount: tiny}, **options)
    least = float(re.search(r"sieve; (\S+) ", str(caught.value)).group(1))
    for factor in (1.0, 1.01, 1.1, 1.37, 2.0, 3.3):
        enough = round(factor * least) if amount == "count" else factor * least
        drawn = draw_sizes(GRADATIONS[name], **{amount: enough}, **options)
        assert np.abs(drawn.passing - drawn.fractions.passing).max() < 1e-9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "one positive amount"),
        ({"mass": 1.0, "count": 9}, "one positive amount"),
        ({"mass": -1.0}, "one positive amount"),
        ({"volume": math.nan}, "one positive amount"),
        ({"count": 99.5}, "whole number of particles"),
        ({"mass": 1.0, "density": 0.0}, "positive density"),
        ({"mass": 1.0, "unit_volumes": []}, "positive unit volumes"),
        ({"mass": 1.0, "unit_volumes": [0.5, -0.5]}, "positive unit volumes"),
        ({"mass": 1.0, "spread": "even"}, "spread of mass or count"),
        ({"mass": 1.0, "seed": -1}, "as the seed"),
        ({"mass": 1.0, "seed": 1.0}, "as the seed"),
        ({"mass": 1.0, "curve": "top"}, "curve of low, mid, high"),
        ({"mass": 50.0, "min_size": 75e-6}, "at most 20000000 particles"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, message):
    with pytest.raises(RecipeError, match=message):
        draw_sizes(GRADATIONS["AC-13"], **{"seed": 0, "min_size": CUT, **options})


def test_real_stones_sieved_again_meet_the_curve():
    stones = [
        generate(database_recipe(shape_class, seed=seed, triangles=1280)).mesh
        for seed, shape_class in enumerate(("cube", "plate", "column", "blade"))
    ]
    own = np.array([sieve_size(convex_hull(stone)) for stone in stones])
    unit_volumes = [stone.volume / size**3 for stone, size in zip(stones, own, strict=True)]
    drawn = draw_sizes(GRADATIONS["AC-13"], mass=0.12, min_size=4.75e-3, unit_volumes=unit_volumes, seed=11)
    made = [
        Mesh(stones[c].vertices * (size / own[c]), stones[c].faces)
        for c, size in zip(drawn.candidates, drawn.sizes, strict=True)
    ]
    sizes = [sieve_size(convex_hull(mesh)) for mesh in made]
    assert sizes == pytest.approx(drawn.sizes, rel=1e-7)
    masses = [2650.0 * mesh.volume for mesh in made]
    again = sieve_curve(sizes, masses, drawn.fractions.openings)
    assert np.abs(again - [100, 100 * 42 / 47, 100 * 23.5 / 47, 0]).max() < TOLERANCE
    assert sum(masses) == pytest.approx(0.12, rel=1e-9)
