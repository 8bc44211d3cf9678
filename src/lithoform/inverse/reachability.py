"""What stops a target: the nearest that can be reached, and how far each descriptor comes where the others are met."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from lithoform.descriptors.table import FOUR
from lithoform.inverse.candidates import Region, find_candidates
from lithoform.inverse.library import DesignLibrary
from lithoform.inverse.surrogate import Surrogate
from lithoform.inverse.targets import Target, within
from lithoform.parameters import Recipe

__all__ = ["Limit", "limits_of", "stopped_by"]

_STRICT: Final = 15.0
"""How much more the other descriptors weigh than the one whose limit is looked for."""

_STEADY: Final = 1000  # n of J: a limit is of the mean


@dataclass(frozen=True)
class Limit:
    """How near a descriptor comes to its target where the others are met.

    Attributes
    ----------
    name : str
    wanted, reached : float
    others_met : bool
        Whether the surrogate expects the others within their tolerance there.
    miss : float
        Distance in tolerances, at the nearest setting of all, which weighs the four as the target does.
    """

    name: str
    wanted: float
    reached: float
    others_met: bool
    miss: float


def limits_of(
    library: DesignLibrary,
    surrogate: Surrogate,
    target: Target,
    nearest: np.ndarray,
    *,
    region: Region,
    evaluate: Callable[[list[Recipe]], np.ndarray] | None = None,
    seeds: Sequence[int] = (),
) -> list[Limit]:
    """Limits of the descriptors that are asked for, that which stops the target first.

    Parameters
    ----------
    library : DesignLibrary
    surrogate : Surrogate
    target : Target
    nearest : numpy.ndarray, shape (4,)
        Mean descriptors of the nearest setting.
    region : Region
    evaluate : callable, optional
        Descriptors of recipes: with it a limit is what stones of the seeds measure, not what the surrogate expects.
    seeds : sequence of int

    Returns
    -------
    list of Limit
    """
    found = []
    for place, name in enumerate(FOUR):
        if not target.asked[place]:
            continue
        weights = tuple(w if i == place else _STRICT * w for i, w in enumerate(target.weights))
        bent = replace(target, weights=weights)
        end = find_candidates(library, surrogate, bent, region=region, count=1, seeds=_STEADY)[0]
        best = end.mean
        if evaluate is not None:
            made = evaluate([end.recipe.replace(seed=seed) for seed in seeds])
            sound = made[np.isfinite(made).all(axis=1)]
            best = sound.mean(axis=0) if len(sound) else best
        others = target.without(place) if target.asked.sum() > 1 else None
        met = others is None or bool(within(end.mean[None], others)[0])
        miss = float(abs(nearest[place] - target.values[place]) / target.tolerance[place] * target.weights[place])
        found.append(Limit(name, target.values[place], float(best[place]), met, miss))
    # Two descriptors in conflict each stop the other: named first is the one that is missed most.
    return sorted(found, key=lambda limit: (not limit.others_met, -limit.miss))


def stopped_by(limits: list[Limit]) -> str:
    """A sentence that names what stops the target.

    Parameters
    ----------
    limits : list of Limit
        As `limits_of` has them.
    """
    first = limits[0]
    name = first.name.replace("_", " ")
    if len(limits) == 1:
        return f"{name} stops it: it comes to {first.reached:.3f}, where {first.wanted:g} is asked."
    if not first.others_met:
        return f"more than one descriptor stops it, {name} most."
    told = f"{name} stops it: where the others are met it comes to {first.reached:.3f}, and {first.wanted:g} is asked"
    second = limits[1]
    if second.others_met and second.miss > 0.5 * first.miss:
        told += f"; or {second.name.replace('_', ' ')}, which comes to {second.reached:.3f} ({second.wanted:g})"
    return told + "."
