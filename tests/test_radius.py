"""Radii: against the NumPy oracle, at the ends of every range, and the same at every resolution and batch."""

import math
from itertools import pairwise

import numpy as np
import oracles
import pytest

from lithoform.conditioning import twist
from lithoform.errors import MeshError
from lithoform.parameters import PARAMETERS, Recipe
from lithoform.presets import SHAPE_CLASSES, benchmark_recipe, database_recipe, particle_seed
from lithoform.radius import RADIUS_FLOOR, field, guarded, radii, reference_directions
from lithoform.topology import sphere
from lithoform.warp_runtime import wp

DIRECTIONS = sphere("octahedral", 12).vertices
RANGES = {p.name: p for p in PARAMETERS}
FIELD = (
    "base_radius perturbation main_scale warp_scale warp_strength lacunarity gain fbm_weight ridge_weight chip_weight "
    "chip_sharpness layer_amplitude layer_frequency"
).split()


def random_recipes(count: int, seed: int) -> list[Recipe]:
    """Recipes uniform over the whole of Table 7 (the twist, which is not part of the radius, is 0)."""
    rng = np.random.default_rng(seed)
    return [
        Recipe(
            **{name: rng.uniform(RANGES[name].low, RANGES[name].high) for name in FIELD},
            phase_offset=tuple(rng.uniform(-6, 6, 3)),
            octaves=int(rng.integers(0, 11)),
            layer_normal=tuple(rng.normal(size=3)),
            twist_rate=0.0,
            seed=int(rng.integers(0, 2**64, dtype=np.uint64)),
        )
        for _ in range(count)
    ]


RANDOM = random_recipes(30, seed=1)

EXTREMES = {
    "O=0": {"octaves": 0},
    "O=0, delta": {"octaves": 0, "phase_offset": (6, -6, 6)},
    "O=10, lambda=3, g=1": {"octaves": 10, "lacunarity": 3.0, "gain": 1.0},
    "lambda=0": {"lacunarity": 0.0},
    "g=0": {"gain": 0.0},
    "k=0": {"k": 0.0},
    "k=1": {"k": 1.0},
    "A_L=8": {"A_L": 8.0},
    "A_L=8, f_L=5": {"A_L": 8.0, "f_L": 5.0},
    "f_L=0": {"f_L": 0.0},
    "no weights": {"alpha": 0, "beta": 0, "gamma": 0},
    "chips alone, kappa=0.1": {"alpha": 0, "beta": 0, "gamma": 2, "kappa": 0.1},
    "chips alone, kappa=128": {"alpha": 0, "beta": 0, "gamma": 2, "kappa": 128},
    "ridges alone": {"alpha": 0, "beta": 1, "gamma": 0},
    "s=0": {"s": 0},
    "s=0, eta=0": {"s": 0, "eta": 0},
    "s_w=0": {"s_w": 0},
    "s=3, s_w=3, eta=1": {"s": 3, "s_w": 3, "eta": 1},
    "r tiny": {"r": 1e-6},
    "r=5": {"r": 5, "rho": 0},
    "largest seed": {"seed": 2**64 - 1},
}


# ------------------------------------------------------------------------------------------------ values


def tolerance(recipe: Recipe) -> float:
    """1e-12, or what two orders of summation may differ by where the octaves amplify rounding more than that.

    The slope of FBM is about sum w_o lambda^o.  A rounding of the warp is amplified by it once, one of the warped
    point a second time: 2e-9 at lambda = 3, O = 10, g = 1; below 1e-12 for slopes up to 60 (the benchmark: 2).
    """
    weights = oracles.octave_weights(recipe)
    slope = float(sum(w * recipe.lacunarity**o for o, w in enumerate(weights)))
    return max(1e-12, 4 * 2.0**-53 * slope * (1.0 + recipe.warp_strength * slope))


def departure(recipe: Recipe, directions: np.ndarray) -> float:
    """Largest relative difference from the oracle; NaN, which no bound admits, where a radius is not a number."""
    made, expected = radii([recipe], directions)[0], oracles.radius(recipe, directions)
    return float(np.abs(made / expected - 1.0).max())


@pytest.mark.parametrize("recipe", [benchmark_recipe(), benchmark_recipe(seed=2**64 - 1)])
def test_benchmark_equals_the_oracle_on_the_default_sphere(recipe):
    assert departure(recipe, sphere("octahedral", 50).vertices) <= tolerance(recipe)


@pytest.mark.parametrize("shape_class", SHAPE_CLASSES)
def test_database_preset_equals_the_oracle(shape_class):
    recipe = database_recipe(shape_class, seed=particle_seed(3, 1))
    assert departure(recipe, DIRECTIONS) <= tolerance(recipe)


@pytest.mark.parametrize("number", range(30))
def test_random_recipes_over_table_7_equal_the_oracle(number):
    assert departure(RANDOM[number], DIRECTIONS) <= tolerance(RANDOM[number])


@pytest.mark.parametrize("change", EXTREMES.values(), ids=EXTREMES)
def test_the_ends_of_the_ranges_are_finite_positive_and_equal_the_oracle(change):
    recipe = benchmark_recipe(**change)
    r = radii([recipe], DIRECTIONS)[0]
    assert np.isfinite(r).all()
    assert r.min() >= 0.999 * RADIUS_FLOOR * recipe.base_radius
    assert departure(recipe, DIRECTIONS) <= tolerance(recipe)


def test_parts_of_the_field_equal_the_oracle():
    recipes = RANDOM[:6]
    sample = field(recipes, DIRECTIONS)
    assert sample.relief.shape == sample.chips.shape == sample.layers.shape == (6, len(DIRECTIONS))
    for i, recipe in enumerate(recipes):
        x = oracles.warped(recipe, DIRECTIONS)
        relief = recipe.fbm_weight * oracles.fbm(recipe, x) + recipe.ridge_weight * oracles.ridges(recipe, x)
        normal = np.array(recipe.layer_normal) / np.linalg.norm(recipe.layer_normal)
        layers = 1 + recipe.layer_amplitude * np.sin(2 * np.pi * recipe.layer_frequency * (x @ normal))
        np.testing.assert_allclose(sample.relief[i], relief, atol=1e-11)
        np.testing.assert_allclose(sample.chips[i], oracles.chip_bracket(recipe, x), atol=1e-11)
        np.testing.assert_allclose(sample.layers[i], layers, atol=1e-11)


def test_the_radius_stays_between_its_bounds_and_reaches_one_of_them():
    for recipe in [benchmark_recipe(seed=s) for s in range(5)]:
        swing = radii([recipe], reference_directions())[0] / recipe.base_radius - 1.0
        assert np.abs(swing).max() == pytest.approx(recipe.perturbation, rel=1e-9)


def test_the_mean_of_the_chips_over_the_reference_directions_is_zero():
    # With chips alone and no layers the mean of N is that of the chips, in units of the largest |N|.
    recipe = benchmark_recipe(alpha=0, beta=0, gamma=1, A_L=0, seed=8)
    swing = radii([recipe], reference_directions())[0] / recipe.base_radius - 1.0
    assert abs(swing.mean()) < 1e-12
    assert np.abs(swing).max() == pytest.approx(recipe.perturbation, rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_constant_chips_are_no_relief(seed):
    # s = eta = 0: the field is sampled at one point, the chips equal their mean, N = 0 and the stone is a sphere.
    # Rounding of the mean must not be blown up by the normalisation (eq. 10).
    recipe = benchmark_recipe(s=0, eta=0, alpha=0, beta=0, gamma=2, k=1, kappa=1.7, seed=seed)
    np.testing.assert_allclose(radii([recipe], DIRECTIONS), recipe.base_radius, rtol=1e-12)
    moved = recipe.replace(eta=1.0, s_w=0.0, phase_offset=(0.3, 0.4, 0.5 + seed))
    np.testing.assert_allclose(radii([moved], DIRECTIONS), recipe.base_radius, rtol=1e-12)


def test_no_weights_and_no_perturbation_give_the_sphere():
    for change in ({"alpha": 0, "beta": 0, "gamma": 0}, {"k": 0}):
        assert (radii([benchmark_recipe(**change)], DIRECTIONS) == 0.5).all()


def test_the_base_radius_only_scales():
    one, two = radii([benchmark_recipe(r=1.0), benchmark_recipe(r=2.0)], DIRECTIONS)
    assert (two == 2.0 * one).all()


# ------------------------------------------------------------------------------------------------ same stone


def rows(directions: np.ndarray) -> dict[bytes, int]:
    return {(d + 0.0).tobytes(): i for i, d in enumerate(directions)}  # + 0.0: -0 and 0 are one direction


def test_reference_directions_are_those_of_the_default_sphere():
    ours = reference_directions()
    assert ours.shape == (10_002, 3)
    theirs = oracles.reference_directions()
    order, other = np.lexsort(np.round(ours, 9).T), np.lexsort(np.round(theirs, 9).T)
    np.testing.assert_allclose(ours[order], theirs[other], atol=1e-15)


@pytest.mark.parametrize("recipe", [benchmark_recipe(seed=4), RANDOM[3], RANDOM[11]])
def test_every_resolution_is_the_same_stone(recipe):
    spheres = [sphere("octahedral", n) for n in (25, 50, 80)] + [sphere("icosahedral", n) for n in (20, 32)]
    values = [radii([recipe], s.vertices)[0] for s in spheres]
    shared = 0
    for a in range(len(spheres)):
        for b in range(a):
            at = rows(spheres[a].vertices)
            pairs = [(at[key], j) for key, j in rows(spheres[b].vertices).items() if key in at]
            shared += len(pairs)
            i, j = np.array(pairs).reshape(-1, 2).T
            assert (values[a][i] == values[b][j]).all()
    assert shared >= 2502 + 2 * 102  # octahedral 25 in 50; 25 and 80 share those of 5, 50 and 80 those of 10


def test_a_value_does_not_depend_on_the_other_directions():
    recipe = benchmark_recipe(seed=6)
    everywhere = np.concatenate([sphere("icosahedral", 9).vertices, DIRECTIONS])
    alone = np.concatenate([radii([recipe], everywhere[i : i + 1])[0] for i in range(0, len(everywhere), 97)])
    assert (radii([recipe], everywhere)[0][::97] == alone).all()
    assert (radii([recipe], everywhere[::-1])[0] == radii([recipe], everywhere)[0][::-1]).all()


def test_a_batch_gives_the_bits_of_its_members_in_any_order():
    recipes = [*RANDOM[:4], benchmark_recipe(), benchmark_recipe(octaves=0), database_recipe("blade", seed=9)]
    together = radii(recipes, DIRECTIONS)
    assert together.shape == (7, len(DIRECTIONS))
    for i, recipe in enumerate(recipes):
        assert radii([recipe], DIRECTIONS)[0].tobytes() == together[i].tobytes()
    order = [5, 2, 0, 6, 3, 1, 4]
    assert radii([recipes[i] for i in order], DIRECTIONS).tobytes() == together[order].tobytes()
    assert radii([], DIRECTIONS).shape == (0, len(DIRECTIONS))


def test_repeated_calls_give_the_same_bits():
    first = radii([benchmark_recipe(seed=3)], DIRECTIONS)
    assert radii([benchmark_recipe(seed=3)], DIRECTIONS).tobytes() == first.tobytes()


# ------------------------------------------------------------------------------------------------ seeds


def normalised(make, seeds) -> np.ndarray:
    """Fields without mean and of unit length, shape (seeds, directions): products are correlations."""
    recipes = [make(seed) for seed in seeds]
    sample = field(recipes, sphere("octahedral", 8).vertices)
    gamma = np.array([[recipe.chip_weight] for recipe in recipes])
    f = (sample.relief + gamma * (sample.chips - sample.chips.mean(axis=1, keepdims=True))) * sample.layers
    f = f - f.mean(axis=1, keepdims=True)
    return f / np.sqrt((f**2).sum(axis=1, keepdims=True))


VARIANTS = {
    "whole": lambda seed: benchmark_recipe(seed=seed),
    "fbm alone": lambda seed: benchmark_recipe(seed=seed, beta=0, gamma=0),
    "chips alone": lambda seed: benchmark_recipe(seed=seed, alpha=0, beta=0, gamma=1),
    "database": lambda seed: database_recipe("plate", seed=seed),
}


@pytest.mark.parametrize("make", VARIANTS.values(), ids=VARIANTS)
@pytest.mark.parametrize("first", [0, 2**40, 2**63 - 200])
def test_neighbouring_seeds_are_as_unlike_as_any_two(make, first):
    # The fixed lattice makes any two ridged stones alike by a few per cent (P = 0 at its points, for all seeds);
    # neighbours must not be more alike than that: means of about 200 correlations each, within 4 standard errors.
    f = normalised(make, range(first, first + 200))
    matrix = f @ f.T
    near = np.diag(matrix, 1)
    far = np.diag(matrix, 97)
    error = math.hypot(near.std() / math.sqrt(len(near)), far.std() / math.sqrt(len(far)))
    assert abs(near.mean() - far.mean()) < 4 * error
    assert abs(near.mean()) < 0.05
    assert near.max() < 0.7  # and no two are the same stone


def test_the_chips_use_the_seed():
    stones = normalised(VARIANTS["chips alone"], [0, 1, 2, 2**32, 2**33, 2**63, 2**64 - 1])
    assert len({s.tobytes() for s in stones}) == 7
    assert np.abs(np.triu(stones @ stones.T, 1)).max() < 0.7


def test_high_bits_of_the_seed_count():
    values = [radii([benchmark_recipe(seed=1 << bit)], DIRECTIONS)[0].tobytes() for bit in range(64)]
    assert len(set(values)) == 64


# ------------------------------------------------------------------------------------------------ guard


def test_the_guard_is_smooth_monotone_and_leaves_the_rest_alone():
    c = RADIUS_FLOOR
    f = np.linspace(-1.0, 2.0, 3_000_001)
    g = guarded(f)
    assert (g[f >= 2 * c] == f[f >= 2 * c]).all()
    assert (g >= c).all()
    assert (np.diff(g) >= 0).all()
    assert (g[f <= 0] == c).all()
    slope = np.diff(g) / np.diff(f)
    # C1: from one step of 1e-6 to the next the slope changes by at most g'' = 1 / 2c times the step.
    assert np.abs(np.diff(slope)).max() < 1.01e-6 / (2 * c) + 1e-9
    assert slope.min() >= 0.0
    assert slope.max() < 1.0 + 1e-9


def test_the_guard_does_not_depend_on_its_neighbours():
    f = np.array([-0.5, 0.0, 0.005, 0.0199, 0.02, 0.5, 1.9])
    assert guarded(f).tolist() == [float(guarded(np.array([x]))[0]) for x in f]
    assert guarded(f).tolist() == pytest.approx([0.01, 0.01, 0.010625, 0.01 + 0.0199**2 / 0.04, 0.02, 0.5, 1.9])


def test_at_k_1_the_deepest_point_is_at_the_floor_and_not_at_the_centre():
    deepest = []
    for seed in range(12):
        recipe = benchmark_recipe(k=1.0, beta=0, gamma=0, seed=seed)
        r = radii([recipe], reference_directions())[0] / recipe.base_radius
        assert r.min() >= RADIUS_FLOOR
        deepest.append(r.min())
    # FBM alone has no preferred sign: where the largest |N| is a pit, and only there, the guard is reached.
    assert 2 <= sum(d < 1.001 * RADIUS_FLOOR for d in deepest) <= 10


# ------------------------------------------------------------------------------------------------ ridges


def test_ridges_are_recentred_as_the_papers_solidity_shows():
    # The specification's decision: eq. 7 as printed gives a mean solidity of 0.949, re-centred 0.891; the paper
    # has 0.895.
    ball = sphere("octahedral", 25)
    recipes = [database_recipe(SHAPE_CLASSES[i % 4], seed=particle_seed(1, i + 1)) for i in range(24)]

    def mean_solidity(stones):
        values = []
        for recipe, r in zip(recipes, stones, strict=True):
            mesh = ball.with_vertices(ball.vertices * r[:, None])
            rate = math.radians(recipe.twist_rate)
            mesh = twist(mesh, axis=recipe.twist_axis, point=recipe.twist_point, rate=rate)
            values.append(oracles.solidity(mesh.vertices, mesh.faces))  # the calibration is affine: no change
        return np.mean(values)

    made = mean_solidity(radii(recipes, ball.vertices))
    printed = mean_solidity([oracles.radius(recipe, ball.vertices, recentred=False) for recipe in recipes])
    assert made == pytest.approx(0.893, abs=0.015)  # standard error of 24 stones: 0.0045
    assert printed == pytest.approx(0.948, abs=0.01)  # standard error: 0.0025


def test_more_octaves_refine_the_same_stone():
    # Each octave is added to the same coarser ones: the correlation with the finest grows.
    f = normalised(lambda o: benchmark_recipe(octaves=o, beta=0, gamma=0, eta=0), range(1, 9))
    likeness = f @ f[-1]
    assert all(a < b for a, b in pairwise(likeness))
    assert likeness[0] > 0.5


# ------------------------------------------------------------------------------------------------ CUDA


@pytest.mark.cuda
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device on this machine: the CPU alone is tested")
def test_cuda_equals_the_cpu():
    recipes = [benchmark_recipe(), *RANDOM, *(benchmark_recipe(**change) for change in EXTREMES.values())]
    np.testing.assert_allclose(
        radii(recipes, DIRECTIONS, device="cuda"), radii(recipes, DIRECTIONS, device="cpu"), rtol=1e-9, atol=0
    )


@pytest.mark.parametrize(
    ("directions", "words"),
    [
        ([[np.nan, 0.0, 1.0]], "unit length"),
        ([[0.0, 0.0, 0.0]], "unit length"),
        ([[0.0, 0.0, 2.0]], "unit length"),
        ([0.0, 0.0, 1.0], "shape"),
        (np.zeros((2, 2)), "shape"),
    ],
)
def test_wrong_directions_are_refused(directions, words):
    with pytest.raises(MeshError, match=words):
        radii([Recipe()], np.asarray(directions))


def test_no_directions_give_no_radii():
    assert radii([Recipe()], np.zeros((0, 3))).shape == (1, 0)
