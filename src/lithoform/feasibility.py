"""What can be known of a recipe before any work: whether its mesh can follow its twist and bear its smoothing.

Both questions are put to the plain sphere of the recipe's topology, which is what relaxation tends to: if that
cannot be twisted without crossings, or is smoothed to nothing, no relief on it can be made sound.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from lithoform.conditioning import smooth, twist
from lithoform.errors import RecipeError
from lithoform.intersections import find_self_intersections
from lithoform.parameters import Recipe, SmoothingMethod, Vector, resolve_topology
from lithoform.topology import sphere

__all__ = ["require_feasible"]

_SAFE_TURN: Final = 10.0
"""Turn from one vertex to the next [deg] up to which no plain sphere crosses itself, wherever its axis lies within
the range of the twist point: 20,000 triangles at r = 5 and 60 degrees turn by 9.4, and none of them did."""

_LEAST_SIZE: Final = 1e-3
"""Least size to which smoothing may shrink the sphere: the relief, which decays faster, must stay above rounding."""

_MOST_GROWTH: Final = 10.0
"""Most by which smoothing may amplify a pattern on the mesh; a proper Taubin pair stays below 2."""


def require_feasible(recipe: Recipe) -> None:
    """Refuse a recipe whose mesh cannot follow its twist or bear its smoothing.

    Parameters
    ----------
    recipe : Recipe

    Raises
    ------
    RecipeError
        The message says what to change.
    """
    kind, n = resolve_topology(recipe.triangles, recipe.topology)
    if recipe.smoothing_iterations:
        _require_smoothable(
            kind, n, recipe.smoothing_iterations, recipe.smoothing_method, recipe.smoothing_lambda, recipe.smoothing_mu
        )
    if recipe.twist_rate * recipe.base_radius * (np.pi / 2) / n > _SAFE_TURN and not _can_be_twisted(
        kind, n, recipe.base_radius, recipe.twist_axis, recipe.twist_point, recipe.twist_rate
    ):
        raise RecipeError(
            f"{recipe.triangles} triangles cannot follow this twist ({recipe.twist_rate:g} deg per unit about an "
            f"axis through {recipe.twist_point}, base radius {recipe.base_radius:g}): even a plain sphere would cross "
            "itself; use more triangles, a smaller rate or radius, or a nearer axis."
        )


@lru_cache(maxsize=256)
def _can_be_twisted(kind: str, n: int, radius: float, axis: Vector, point: Vector, rate: float) -> bool:
    ball = sphere(kind, n)
    twisted = twist(ball.with_vertices(radius * ball.vertices), axis=axis, point=point, rate=float(np.radians(rate)))
    return len(find_self_intersections(twisted.vertices, twisted.faces, limit=1)) == 0


@lru_cache(maxsize=256)
def _require_smoothable(kind: str, n: int, iterations: int, method: SmoothingMethod, lambda_: float, mu: float) -> None:
    """Two limits: how a step multiplies a pattern of eigenvalue nu of I - W (0 to 2), and the size of the sphere."""
    nu = np.linspace(0.0, 2.0, 2001)
    factor = np.abs((1.0 - lambda_ * nu) * (1.0 - mu * nu if method == "taubin" else 1.0)).max()
    if iterations * np.log(factor) > np.log(_MOST_GROWTH):
        raise RecipeError(
            f"{iterations} Taubin steps of lambda = {lambda_:g} and mu = {mu:g} would amplify the mesh's own pattern "
            f"{factor:.3g} times each; use a mu near -1.06 lambda, or fewer steps."
        )
    with np.errstate(all="ignore"):
        ball = smooth(sphere(kind, n), iterations=iterations, method=method, lambda_=lambda_, mu=mu)
    size = float(np.ptp(ball.vertices[:, 2])) / 2.0
    if size < _LEAST_SIZE:
        raise RecipeError(
            f"{iterations} smoothing steps of lambda = {lambda_:g} would shrink a sphere of this mesh to {size:.1g} of "
            "its size; use fewer or smaller steps, or more triangles."
        )
