"""Population design: the estimate against closed forms, and a hidden setting found again."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy import stats

from lithoform import Recipe
from lithoform.errors import FileFormatError, RecipeError, SampleError
from lithoform.matching.dimensions import fit_dimensions, normal_scores
from lithoform.matching.emulator import Stones, fit_emulator
from lithoform.matching.energy import energy_distances, sum_of_distances
from lithoform.matching.estimation import Density, Places, estimate, objective
from lithoform.matching.judging import detectable_shift, judge
from lithoform.matching.match import Match, match_population, split
from lithoform.matching.references import read_reference
from lithoform.matching.search import population_of, search
from lithoform.matching.stones import MATCHED, measured
from lithoform.matching.telling import as_dict, as_text
from lithoform.matching.variables import VARIABLES, base_recipe, variables_for
from lithoform.population_recipe import PopulationRecipe, Spread, read_population_recipe

TRUTH = Density(
    np.array([0.6, 0.4]), np.array([[0.05, 0.0, -0.02], [0.0, 0.08, 0.0]]), np.array([[0.08, 0.0], [0.03, 0.12]])
)


def made_up_stones(coordinates: np.ndarray, scores: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Descriptors of a made-up generator: curved in the coordinates, with a scatter that grows with the first."""
    u, v = np.clip(coordinates, 0.0, 1.0).T
    scatter = 0.03 * np.exp(u) * generator.standard_normal((3, len(u)))
    middle = (u + 0.3 * v**2, 0.2 * u - v + 0.3 * u**3, 0.5 * u * v + 0.02 * scores[:, 0])
    return np.column_stack(np.array(middle) + scatter)


def even_stones(count: int, seed: int) -> Stones:
    generator = np.random.default_rng(seed)
    coordinates, scores = generator.random((count, 2)), generator.standard_normal((count, 3))
    return Stones(coordinates, scores, made_up_stones(coordinates, scores, generator))


def places_of(count: int, seed: int) -> Places:
    generator = np.random.default_rng(seed)
    normal, scores = generator.standard_normal((count, 2)), generator.standard_normal((count, 3))
    return Places(normal, scores, 0.1 * scores[:, 1:])


def sample_of(density: Density, count: int, seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    scores = generator.standard_normal((count, 3))
    coordinates = density.draw(generator.standard_normal((count, 2)), scores)
    return np.column_stack([made_up_stones(coordinates, scores, generator), 0.1 * scores[:, 1:]])


def test_the_emulator_is_the_mean_and_the_scatter_of_stones():
    emulator = fit_emulator(even_stones(3000, 1))
    generator = np.random.default_rng(2)
    coordinates, scores = 0.1 + 0.8 * generator.random((400, 2)), generator.standard_normal((400, 3))
    stones = emulator.nearest(coordinates, scores)
    assert len(np.unique(stones)) == 400  # none used twice while there are enough
    values = emulator.values(coordinates, scores, stones)[0]
    u, v = coordinates.T
    middle = np.column_stack([u + 0.3 * v**2, 0.2 * u - v + 0.3 * u**3, 0.5 * u * v + 0.02 * scores[:, 0]])
    scatter = (values - middle) / (0.03 * np.exp(u))[:, None]
    assert np.abs(scatter.mean(axis=0)).max() < 0.15  # 400 stones: 0.05 by chance, and the error of the cubic
    assert np.allclose(scatter.std(axis=0), 1.0, rtol=0.1)
    for half in (u < 0.4, u > 0.6):
        assert np.allclose(scatter[half].std(axis=0), 1.0, rtol=0.15)


def test_scatter_is_carried_from_where_it_is_small_to_where_it_is_large():
    emulator = fit_emulator(even_stones(3000, 3))
    rows = np.argsort(emulator.stones.coordinates[:, 0])[:300]  # u near 0.05
    scores = emulator.stones.scores[rows]
    values = emulator.values(np.full((300, 2), 0.9), scores, rows)[0]
    centred = values - np.column_stack([np.zeros((300, 2)), 0.02 * scores[:, 0]])
    assert np.allclose(centred.std(axis=0), 0.03 * math.exp(0.9), rtol=0.15)


def test_few_stones_are_used_evenly_often():
    emulator = fit_emulator(even_stones(60, 4))
    places = places_of(150, 5)
    counts = np.bincount(emulator.nearest(TRUTH.draw(places.normal, places.scores), places.scores), minlength=60)
    assert counts.max() == 3


def test_slopes_of_the_emulator_are_those_of_finite_differences():
    emulator = fit_emulator(even_stones(600, 6))
    generator = np.random.default_rng(7)
    coordinates, scores = 0.1 + 0.8 * generator.random((20, 2)), generator.standard_normal((20, 3))
    stones = emulator.nearest(coordinates, scores)
    slopes = emulator.values(coordinates, scores, stones)[1]
    for k in range(2):
        step = np.eye(2)[k] * 1e-6
        up, down = (emulator.values(coordinates + sign * step, scores, stones)[0] for sign in (1.0, -1.0))
        assert np.allclose(slopes[:, :, k], (up - down) / 2e-6, rtol=1e-6, atol=1e-8)
    outside = emulator.values(coordinates + 1.0, scores, stones)[1]
    assert np.all(outside == 0.0)


def test_joint_moments_are_those_of_a_large_sample():
    correlation = np.array([[1.0, -0.4, 0.2], [-0.4, 1.0, 0.1], [0.2, 0.1, 1.0]])
    generator = np.random.default_rng(2)
    scores = generator.standard_normal((200_000, 3)) @ np.linalg.cholesky(correlation).T
    coordinates = TRUTH.draw(generator.standard_normal((200_000, 2)), scores)
    deviations, matrix = TRUTH.joint(correlation)
    assert np.allclose(coordinates.std(axis=0), deviations, rtol=0.01)
    assert np.allclose(np.corrcoef(np.column_stack([scores, coordinates]).T), matrix, atol=0.01)


def test_the_energy_of_two_points_is_known():
    # Of two columns: Euclid sqrt(1 + 4), half of 1 + 2, and half of Euclid again; of five, the last is no margin.
    assert energy_distances(np.array([[0.0, 0.0]]), np.array([[1.0, -2.0]]))[0, 0] == pytest.approx(
        1.5 * math.sqrt(5.0) + 1.5
    )
    five = energy_distances(np.zeros((1, 5)), np.array([[0.0, 0.0, 1.0, -2.0, 3.0]]))[0, 0]
    assert five == pytest.approx(math.sqrt(5.0) + 1.5 + 0.5 * math.sqrt(14.0))


def test_the_sum_of_distances_is_that_of_all_pairs():
    generator = np.random.default_rng(13)
    a, b = generator.standard_normal((9, 6)), generator.standard_normal((7, 6))
    a[0] = b[0]  # equal rows have no direction
    total, slopes = sum_of_distances(a, b, 4)
    assert total == pytest.approx(energy_distances(a, b).sum(), rel=1e-13)
    for i, k in ((3, 0), (8, 3)):
        step = np.zeros_like(a)
        step[i, k] = 1e-6
        numeric = (energy_distances(a + step, b).sum() - energy_distances(a - step, b).sum()) / 2e-6
        assert slopes[i, k] == pytest.approx(numeric, rel=1e-7)
    assert np.isfinite(slopes).all()


def test_the_gradient_is_that_of_finite_differences():
    emulator, places = fit_emulator(even_stones(400, 1)), places_of(90, 2)
    reference = sample_of(TRUTH, 20, 3)
    preset = np.array([0.3, 0.7])
    at = Density(np.array([0.55, 0.45]), 0.8 * TRUTH.slopes + 0.01, 0.6 * TRUTH.spread)
    gradient = objective(emulator, places, reference, preset, at, TRUTH)[1]

    def moved(mean=(0.0, 0.0), slope=0.0, diagonal=0.0, below=0.0):
        spread = at.spread.copy()
        spread[1, 1] *= math.exp(diagonal)
        spread[1, 0] += below
        slopes = at.slopes.copy()
        slopes[1, 2] += slope
        density = Density(at.mean + np.array(mean), slopes, spread)
        return objective(emulator, places, reference, preset, density, TRUTH)[0]

    step = 1e-6
    for place, change in (
        (0, {"mean": (step, 0.0)}), (1, {"mean": (0.0, step)}), (7, {"slope": step}), (9, {"diagonal": step}),
        (10, {"below": step}),
    ):  # fmt: skip
        back = {k: tuple(-c for c in v) if isinstance(v, tuple) else -v for k, v in change.items()}
        assert gradient[place] == pytest.approx((moved(**change) - moved(**back)) / (2 * step), rel=1e-4, abs=1e-7)


@pytest.mark.parametrize("factor", [0.1, 1.0, 2.0])  # of the spread: a narrow, a usual and a wide population
def test_a_known_population_is_found_among_stones_of_others(factor):
    truth = dataclasses.replace(TRUTH, slopes=factor * TRUTH.slopes, spread=factor * TRUTH.spread)
    reference = sample_of(truth, 600, 6)
    start = Density(np.full(2, 0.5), np.zeros((2, 3)), 0.2 * np.eye(2))
    found = estimate(fit_emulator(even_stones(2000, 4)), places_of(500, 5), reference, np.full(2, 0.5), start)
    assert np.abs(found.density.mean - truth.mean).max() < 0.02
    expected, _ = truth.joint(np.eye(3))
    assert np.allclose(found.density.joint(np.eye(3))[0], expected, rtol=0.2, atol=0.015)
    # A sample of the population itself is as far, on average, as chance alone puts it.
    assert found.energy < 2.0 * found.noise


def test_stones_of_the_population_itself_are_as_far_as_the_noise_says():
    emulator, places = fit_emulator(even_stones(2000, 7)), places_of(400, 8)
    coordinates = TRUTH.draw(places.normal, places.scores)
    stones = emulator.nearest(coordinates, places.scores)
    rows = np.column_stack([emulator.values(coordinates, places.scores, stones)[0], places.dimensions])
    energies, noises, prices = [], [], []
    for seed in range(60):
        reference = sample_of(TRUTH, 40, 100 + seed)
        unit = reference.std(axis=0, ddof=1)
        between = energy_distances(rows / unit, rows / unit, first=3).sum() / (400 * 399)
        within = energy_distances(reference / unit, reference / unit, first=3).mean()
        across = energy_distances(rows / unit, reference / unit, first=3).mean()
        energies.append(2.0 * across - between - within)
        noises.append(between / 40)
        prices.append(objective(emulator, places, reference, TRUTH.mean, TRUTH, TRUTH)[0] - energies[-1])
    assert np.mean(energies) == pytest.approx(np.mean(noises), rel=0.15)
    assert np.ptp(prices) < 1e-12  # the price of a density has nothing to do with the reference but its size
    assert 0.0 < prices[0] < 0.1 * np.mean(noises)


def test_dimensions_keep_their_margins_and_correlation():
    generator = np.random.default_rng(9)
    scores = generator.multivariate_normal(np.zeros(3), [[1, -0.5, 0], [-0.5, 1, 0.3], [0, 0.3, 1]], 3000)
    values = np.column_stack([0.02 * np.exp(0.1 * scores[:, 0]), stats.norm.cdf(scores[:, 1:])])
    model = fit_dimensions(values)
    assert np.allclose(model.correlation[np.triu_indices(3, 1)], [-0.5, 0.0, 0.3], atol=0.05)
    levels = (np.arange(model.quantiles.shape[1]) + 0.5) / model.quantiles.shape[1]
    assert np.allclose(model.quantiles[1][3:], levels[3:], atol=0.03)
    assert normal_scores(np.array([[1.0], [3.0], [2.0]]))[:, 0] == pytest.approx(stats.norm.ppf([1 / 6, 5 / 6, 1 / 2]))


def test_coordinates_and_values_are_inverse_and_the_carrier_is_the_population():
    for variable in VARIABLES:
        for place in (0.0, 0.25, 1.0):
            assert variable.coordinate(variable.value(place)) == pytest.approx(place)
    model = fit_dimensions(
        np.column_stack([np.linspace(0.01, 0.02, 30), np.linspace(0.5, 1, 30), np.linspace(0.4, 1, 30)])
    )
    d = len(VARIABLES)
    density = Density(np.full(d, 0.5), np.zeros((d, 3)), 0.1 * np.eye(d))
    population = population_of(density, VARIABLES, model, base_recipe(1280))
    score = 1.3
    recipe = population.recipe_at([0.0] * 3 + [score] * d, 1)
    for variable in VARIABLES:
        expected = variable.value(0.5 + 0.1 * score)
        unit = 0.5 if variable.name == "smoothing_iterations" else 1e-5 * expected
        assert getattr(recipe, variable.name) == pytest.approx(expected, abs=unit)


def test_the_range_of_smoothing_is_the_same_length_on_the_surface():
    highs = {v.name: v.high for v in variables_for(5000)}
    assert highs["smoothing_iterations"] == 50  # a quarter of the triangles: edges twice as long
    assert highs["perturbation"] == 1.0


def test_a_split_is_a_partition_that_follows_the_seed():
    fitted, held = split(95, 0.5, 3)
    assert sorted([*fitted, *held]) == list(range(95))
    assert len(fitted) == 48
    assert not np.array_equal(fitted, split(95, 0.5, 4)[0])
    assert np.array_equal(fitted, split(95, 0.5, 3)[0])


def test_the_detectable_shift_is_found_in_four_of_five_cases():
    n, m = 47, 400
    shift = detectable_shift(n, m)
    assert shift == pytest.approx(2.8015852 * math.sqrt(1 / 47 + 1 / 400), rel=1e-6)
    generator = np.random.default_rng(10)
    p = stats.ttest_ind(generator.normal(shift, 1.0, (4000, n)), generator.normal(0.0, 1.0, (4000, m)), axis=1).pvalue
    assert (p < 0.05).mean() == pytest.approx(0.8, abs=0.03)


def test_a_verdict_names_what_differs():
    generator = np.random.default_rng(11)
    a, b = generator.normal(0.5, 0.05, (60, 7)), generator.normal(0.5, 0.05, (200, 7))
    b[:, 2] += 0.08
    verdict = judge(a, b, permutations=200)
    assert verdict.resists == "solidity"
    assert not verdict.is_passed
    assert verdict.shifts["solidity"] == pytest.approx(1.6, abs=0.4)
    assert (
        judge(a, np.random.default_rng(12).normal(0.5, 0.05, (200, 7)), permutations=200).p_values["joint_energy"]
        > 0.01
    )


HIDDEN = PopulationRecipe(
    length=(0.016, 0.02, 0.028),
    elongation=(0.55, 0.7, 0.8, 0.95),
    flatness=(0.5, 0.65, 0.9),
    spreads=(
        Spread("perturbation", "log", 0.55, 0.1, 0.05, 1.0),
        Spread("smoothing_iterations", "square_root", 2, 0.3, 0, 12),
    ),
    base=Recipe(main_scale=1.4, warp_scale=1.0, triangles=1280),
)


@pytest.fixture(scope="module")
def hidden() -> np.ndarray:
    recipes = [HIDDEN.recipe(number, 5) for number in range(1, 101)]
    return measured(recipes, total=100, what="stones")


@pytest.fixture(scope="module")
def found(hidden) -> Match:
    return match_population(hidden, seed=1, budget=300, triangles=1280, judged=120, permutations=400, note="hidden")


def test_a_hidden_population_cannot_be_told_after_the_match_but_before(found):
    assert not found.before.is_passed
    assert found.before.joint.energy.p < 0.01
    assert found.held.joint.energy.p > 0.05
    assert found.held.joint.mmd.p > 0.05
    assert min(one.index("bhattacharyya").p for one in found.held.descriptors) > 0.01
    assert max(abs(shift) for shift in found.held.shifts.values()) < 0.6


def test_what_was_found_is_told(found, tmp_path):
    file = tmp_path / "found.toml"
    file.write_text(found.population.to_toml())
    assert read_population_recipe(file) == found.population
    assert found.population.note == "hidden"
    told = json.loads(json.dumps(as_dict(found), allow_nan=True))
    assert told["fitted"] + told["held_out"] == 100
    assert told["held"]["descriptors"]["roundness"]["bhattacharyya"]["p"] == found.held.p_values["roundness"]
    text = as_text(found)
    assert "Most resists: " in text
    assert "perturbation" in text
    assert max(map(len, text.splitlines())) < 240


def test_the_same_bytes_whatever_the_threads(hidden):
    one, three = (search(hidden[:40], seed=2, budget=60, triangles=320, threads=n).population for n in (1, 3))
    assert one.to_toml() == three.to_toml()


@pytest.mark.parametrize(
    ("change", "error", "told"),
    [
        ({"rows": 19}, SampleError, "at least 20"),
        ({"constant": 3}, SampleError, "true_sphericity to vary"),
        ({"bad": math.nan}, SampleError, "finite"),
        ({"bad": -0.1}, SampleError, "EI and FI"),
        ({"long": 2e6}, SampleError, "1e-9 to 1e6 m"),
        ({"fit_share": 1.0}, SampleError, "between 0 and 1"),
        ({"fit_share": 0.9}, SampleError, "each part"),
        ({"seed": -1}, SampleError, "a seed of 0"),
        ({"permutations": 0}, SampleError, "permutations"),
        ({"judged": 7}, SampleError, "stones to judge"),
        ({"budget": 10}, RecipeError, "at least 60"),
        ({"triangles": 1000}, RecipeError, "nearest counts"),
        ({"columns": 6}, SampleError, "with the columns"),
    ],
)
def test_what_cannot_be_matched_is_refused(hidden, change, error, told):
    values = hidden[: change.pop("rows", 40)].copy()
    if "constant" in change:
        values[:, change.pop("constant")] = 0.5
    if "bad" in change:
        values[3, MATCHED.index("elongation")] = change.pop("bad")
    if "long" in change:
        values[3, MATCHED.index("length")] = change.pop("long")
    values = values[:, : change.pop("columns", 7)]
    with pytest.raises(error, match=told):
        match_population(values, **{"budget": 60, "triangles": 320, **change})


def test_references_are_tables_and_folders(tmp_path, hidden):
    table = tmp_path / "table.csv"
    rows = [",".join((*MATCHED, "unit")), *(",".join([*map(repr, map(float, row)), "m"]) for row in hidden[:25])]
    table.write_text("\n".join(rows) + "\n")
    values, notes = read_reference(table)
    assert np.array_equal(values, hidden[:25])
    assert notes == ()
    table.write_text("\n".join(row.rpartition(",")[0] for row in rows) + "\n")  # without the column unit
    values, notes = read_reference(table)
    assert np.array_equal(values, hidden[:25])
    assert "no column unit" in notes[0]
    table.write_text("roundness,boxiness\n0.5,0.4\n")
    with pytest.raises(SampleError, match="no column"):
        read_reference(table)
    with pytest.raises(FileFormatError, match="not there"):
        read_reference(tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError):
        read_reference(tmp_path / "empty")


def test_the_command_leaves_no_file_where_it_fails(tmp_path, hidden):
    from lithoform.cli.matching import match

    out = tmp_path / "population.toml"
    table = tmp_path / "few.csv"
    rows = [",".join(MATCHED), *(",".join(map(repr, map(float, row))) for row in hidden[:10])]
    table.write_text("\n".join(rows) + "\n")
    with pytest.raises(SampleError, match="at least 20 particles, got 10"):
        match(table, out=out)
    assert sorted(tmp_path.iterdir()) == [table]


def test_the_population_is_frozen(found):
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.population.note = "other"
