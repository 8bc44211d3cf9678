"""What is refused before any work, and that what is let through can be made."""

from __future__ import annotations

import numpy as np
import pytest

from lithoform import Recipe, RecipeError, check, feasibility, generate
from lithoform.feasibility import require_feasible

FAR_AXIS = {
    "perturbation": 0.0,
    "base_radius": 5.0,
    "twist_rate": 60.0,
    "twist_axis": (0.31537880847355226, 0.37462295610641855, -0.4489724531255603),
    "twist_point": (-10.0, 10.0, -10.0),
}


def test_a_twist_about_a_far_axis_that_a_plain_sphere_cannot_follow_is_refused():
    with pytest.raises(RecipeError, match="even a plain sphere would cross itself"):
        generate(Recipe(triangles=2000, **FAR_AXIS), device="cpu")


def test_more_triangles_can_follow_it():
    stone = generate(Recipe(triangles=20_000, **FAR_AXIS), device="cpu")
    assert check(stone.mesh).sound
    assert stone.relaxed_vertices == 0


def test_plain_spheres_that_are_let_through_are_sound_without_relaxation():
    rng = np.random.default_rng(3)
    made = refused = 0
    for _ in range(60):
        recipe = Recipe(
            perturbation=0.0,
            base_radius=float(rng.choice([0.5, 2.0, 5.0])),
            twist_rate=60.0,
            twist_axis=tuple(rng.normal(size=3)),
            twist_point=tuple(rng.choice([-10.0, 10.0], 3)),
            triangles=int(rng.choice([512, 2000, 5000])),
            flatten=False,
        )
        try:
            assert generate(recipe, device="cpu").relaxed_vertices == 0
            made += 1
        except RecipeError:
            refused += 1
    assert made > 30
    assert refused > 0


@pytest.mark.parametrize(
    "changes",
    [
        {"triangles": 8, "smoothing_iterations": 1000},
        {"triangles": 8, "smoothing_iterations": 1, "smoothing_lambda": 1.0},
        {"triangles": 200, "smoothing_iterations": 1000, "smoothing_lambda": 1.0},
    ],
)
def test_smoothing_a_stone_away_is_refused(changes):
    with pytest.raises(RecipeError, match="would shrink a sphere"):
        require_feasible(Recipe(twist_rate=0.0, **changes))


def test_a_taubin_pair_that_amplifies_is_refused():
    pair = {"smoothing_method": "taubin", "smoothing_lambda": 0.01, "smoothing_mu": -1.0}
    with pytest.raises(RecipeError, match="amplify"):
        require_feasible(Recipe(triangles=72, twist_rate=0.0, smoothing_iterations=10, **pair))


@pytest.mark.parametrize("method", ["laplacian", "taubin"])
def test_common_smoothing_is_let_through_and_sound(method):
    recipe = Recipe(triangles=800, smoothing_iterations=100, smoothing_method=method)
    assert check(generate(recipe, device="cpu").mesh).sound


def test_the_answer_is_kept():
    recipe = Recipe(triangles=2000, smoothing_iterations=1000)
    require_feasible(recipe)
    before = feasibility._require_smoothable.cache_info()
    require_feasible(recipe.replace(seed=2))
    after = feasibility._require_smoothable.cache_info()
    assert (after.hits, after.misses) == (before.hits + 1, before.misses)
