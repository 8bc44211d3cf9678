"""Population recipes: margins, correlation, files, and what is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lithoform import Recipe
from lithoform.errors import FileFormatError, RecipeError
from lithoform.parameters import PARAMETERS
from lithoform.population_recipe import PopulationRecipe, Spread, read_population_recipe
from lithoform.presets import particle_seed

MATRIX = (
    (1.0, -0.5, 0.0, 0.0, 0.0),
    (-0.5, 1.0, -0.2, 0.6, 0.0),
    (0.0, -0.2, 1.0, 0.0, 0.3),
    (0.0, 0.6, 0.0, 1.0, 0.4),
    (0.0, 0.0, 0.3, 0.4, 1.0),
)
EXAMPLE = PopulationRecipe(
    length=(0.01, 0.02, 0.04, 0.05),
    elongation=(0.5, 0.7, 0.9),
    flatness=(0.4, 0.6, 0.65, 1.0),
    spreads=(
        Spread("perturbation", "log", 0.3, 0.25, 0.01, 1.0),
        Spread("smoothing_iterations", "square_root", 40, 1.5, 0, 200),
    ),
    correlation=MATRIX,
    base=Recipe(main_scale=1.0, triangles=1280),
    note='of "scans"',
)


@pytest.fixture(scope="module")
def drawn() -> list[Recipe]:
    return [EXAMPLE.recipe(number, 3) for number in range(1, 4001)]


def test_a_parameter_on_a_log_scale_is_log_normal(drawn):
    scores = (np.log([r.perturbation for r in drawn]) - math.log(0.3)) / 0.25
    assert stats.kstest(scores, "norm").pvalue > 0.01


def test_whole_parameters_are_rounded_square_roots_of_normal_numbers(drawn):
    steps = np.array([r.smoothing_iterations for r in drawn])
    # P(n <= 40) = P(root < sqrt(40.5)).
    expected = stats.norm.cdf((math.sqrt(40.5) - math.sqrt(40.0)) / 1.5)
    assert abs((steps <= 40).mean() - expected) < 4.0 * math.sqrt(0.25 / len(steps))


def test_dimensions_follow_their_quantiles(drawn):
    # The margin puts mass 1/2n below the first and above the last quantile, and 1/n evenly between neighbours.
    for table, values in (
        (EXAMPLE.length, [r.length for r in drawn]),
        (EXAMPLE.elongation, [r.width / r.length for r in drawn]),
        (EXAMPLE.flatness, [r.height / r.width for r in drawn]),
    ):
        n = len(table)
        for i in range(n - 1):
            middle = 0.5 * (table[i] + table[i + 1])
            assert abs((np.array(values) <= middle).mean() - (i + 1) / n) < 4.0 * math.sqrt(0.25 / len(values))
        assert min(values) == pytest.approx(table[0])
        assert max(values) == pytest.approx(table[-1])


def test_rank_correlations_are_those_of_a_gaussian_copula(drawn):
    columns = np.array([[r.length, r.width / r.length, r.height / r.width, r.perturbation] for r in drawn])
    found = stats.spearmanr(columns).statistic
    # Spearman's of a Gaussian copula: 6 / pi asin(r / 2); ties at the ends of a margin of few quantiles lower it.
    expected = 6.0 / math.pi * np.arcsin(np.array(MATRIX)[:4, :4] / 2.0)
    assert np.abs(found - expected).max() < 0.06


def test_a_particle_depends_on_its_number_and_seed_alone(drawn):
    assert EXAMPLE.recipe(7, 3) == drawn[6]
    assert EXAMPLE.recipe(7, 3).seed == particle_seed(3, 7)
    assert EXAMPLE.recipe(7, 4) != drawn[6]


def test_toml_round_trip_is_exact(tmp_path):
    file = tmp_path / "population.toml"
    file.write_text(EXAMPLE.to_toml())
    again = read_population_recipe(file)
    assert again == EXAMPLE
    assert again.to_toml() == EXAMPLE.to_toml()
    assert again.recipe(5, 1) == EXAMPLE.recipe(5, 1)


def test_without_parameters_and_correlation_the_dimensions_alone_vary(tmp_path):
    file = tmp_path / "plain.toml"
    file.write_text("[dimensions]\nlength = [0.01]\nelongation = [0.5]\nflatness = [0.5, 1.0]\n")
    recipe = read_population_recipe(file).recipe(1, 0)
    assert recipe.width == pytest.approx(0.005)
    assert recipe.replace(size=(2.0, 1.5, 1.0), seed=0) == Recipe()


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(
        [
            p
            for p in PARAMETERS
            if p.kind != "vector" and p.name not in ("length", "width", "height", "seed", "triangles")
        ]
    ),
    st.sampled_from(["linear", "log", "square_root"]),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1e3),
    st.integers(0, 2**64 - 1),
)
def test_every_recipe_drawn_is_valid(parameter, scale, place, deviation, seed):
    low, high = parameter.low, parameter.high
    if parameter.name == "smoothing_mu":
        scale = "linear"
    if scale == "log":
        low = max(low, 1 if parameter.kind == "integer" else 1e-3)
    median = min(max(low + place * (high - low), low), high)
    population = PopulationRecipe(
        length=(0.01, 0.02),
        elongation=(0.04, 1.0),
        flatness=(0.04, 1.0),
        spreads=(Spread(parameter.name, scale, median, deviation, low, high),),
    )
    for number in (1, 2, 3):
        recipe = population.recipe(number, seed)
        assert low <= getattr(recipe, parameter.name) <= high
        assert recipe.length >= recipe.width >= recipe.height


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("median = 0.3", "median = nan", "finite number"),
        ("median = 0.3", "median = 3.0", "low <= median <= high"),
        ("high = 1.0", "high = 2.0", "low <= median <= high"),
        ("deviation = 0.25", "deviation = -1", "at least 0"),
        ('scale = "log"', 'scale = "logarithm"', "Did you mean log"),
        ("[parameters.perturbation]", "[parameters.perturbaton]", "Did you mean perturbation"),
        ("deviation = 0.25", "", "lacks 'deviation'"),
        ("deviation = 0.25", "deviation = 0.25\nmean = 1", "'mean', which means nothing"),
        ("elongation = [0.5, 0.7, 0.9]", "elongation = [0.5, 0.7, 1.9]", "elongation must be quantiles"),
        ("elongation = [0.5, 0.7, 0.9]", "elongation = [0.7, 0.5, 0.9]", "rising order"),
        ("elongation = [0.5, 0.7, 0.9]", "elongation = []", "elongation must be quantiles"),
        ("elongation = [0.5, 0.7, 0.9]", "elongation = 0.7", "must be a list"),
        ("[-0.5, 1.0, -0.2, 0.6, 0.0]", "[-0.5, 1.0, -0.2, 0.5, 0.0]", "symmetric"),
        ("[0.0, 0.6, 0.0, 1.0, 0.4]", "[0.0, 0.6, 0.0, 1.0]", "5 rows of 5"),
        ("[1.0, -0.5, 0.0, 0.0, 0.0]", "[1.5, -0.5, 0.0, 0.0, 0.0]", "ones on the diagonal"),
        ("triangles = 1280", "triangles = 1281", "8 n^2 or 20 n^2"),
        ("triangles = 1280", "triangles = 1280\nseed = 4", "drawn for each particle"),
        ("format = 1", "format = 2", "format 1"),
        ('"perturbation", "smoothing_iterations"]', '"smoothing_iterations", "perturbation"]', "names of"),
    ],
)
def test_what_is_wrong_in_a_file_is_said(tmp_path, old, new, told):
    text = EXAMPLE.to_toml()
    assert old in text
    file = tmp_path / "bad.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(RecipeError, match=re.escape(told)) as caught:
        read_population_recipe(file)
    assert str(caught.value).startswith(str(file))


def test_correlations_that_no_population_has_are_refused():
    # Eigenvalue 1 - 0.9 sqrt(2) < 0.
    matrix = ((1.0, 0.9, 0.0), (0.9, 1.0, 0.9), (0.0, 0.9, 1.0))
    with pytest.raises(RecipeError, match="positive definite"):
        PopulationRecipe(length=(0.01,), elongation=(0.5,), flatness=(0.5,), correlation=matrix)


@pytest.mark.parametrize("text", ["perturbation = 0.3\n", "[dimensions\n", '{"recipe": {}}'])
def test_a_file_of_another_kind_is_refused(tmp_path, text):
    file = tmp_path / "other.toml"
    file.write_text(text)
    with pytest.raises(FileFormatError):
        read_population_recipe(file)


@pytest.mark.parametrize(("number", "seed"), [(0, 1), (True, 1), (1, -1), (1, 2**64), (1.0, 0)])
def test_numbers_and_seeds_out_of_range_are_refused(number, seed):
    with pytest.raises(RecipeError, match="whole number"):
        EXAMPLE.recipe(number, seed)


@pytest.mark.parametrize("name", ["layer_normal", "length", "seed", "topology", "nothing"])
def test_only_texture_parameters_that_are_numbers_are_spread(name):
    with pytest.raises(RecipeError, match="texture parameter"):
        Spread(name, "linear", 1.0, 0.1, 0.5, 2.0)
