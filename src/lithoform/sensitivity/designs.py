"""Designs: which settings of the parameters are made into stones, and with which seeds.

A design is a plan that `lithoform.database.building.build` carries out.  Its particles are numbered point by point, and
at each point seed by seed; all points share the seeds, so that two points differ by their settings alone.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.axes import EXTRA_AXES, TABLE_7, Axis, at_axes
from lithoform.errors import RecipeError
from lithoform.lazy import cached_property
from lithoform.parameters import Recipe
from lithoform.presets import benchmark_recipe, particle_seed
from lithoform.seeds import MAX_SEED

__all__ = [
    "Design", "OneAtATime", "Points", "axes_for", "latin_hypercube", "morris_trajectories", "saltelli_sample",
    "sobol_sequence",
]  # fmt: skip

_MOST_PARTICLES: Final = 10_000_000
_REFERENCE_TRIANGLES: Final = 20_000


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(ABC):
    """Points of a design, each made with the same seeds.

    Attributes
    ----------
    base : Recipe
        What no point sets stays as it is here.
    seeds : int
        Stones at each point.
    seed : int
        Run seed; the k-th stone of every point has the seed `particle_seed(seed, k)`.
    """

    base: Recipe = field(default_factory=benchmark_recipe)
    seeds: int = 1
    seed: int = 0

    @property
    @abstractmethod
    def point_count(self) -> int:
        """Number of points."""

    @abstractmethod
    def settings(self, point: int) -> dict[str, Any]:
        """What a point (from 0) sets: values by the names of axes or of fields of `Recipe`."""

    @abstractmethod
    def told(self) -> dict[str, Any]:
        """What was asked for, in plain values, beside the base and the seeds."""

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.point_count * self.seeds

    def place(self, number: int) -> tuple[int, int]:
        """Point and seed (both from 0) of particle `number` (from 1)."""
        return divmod(number - 1, self.seeds)

    def recipe(self, number: int) -> Recipe:
        """Recipe of particle `number` (from 1).

        Raises
        ------
        RecipeError
            If the settings of its point cannot go together, such as a twist that the mesh cannot follow.
        """
        point, k = self.place(number)
        return at_axes(self.base, {**self.settings(point), "seed": particle_seed(self.seed, k + 1)})

    def class_of(self, number: int) -> str | None:
        """No particle is drawn in a class; that of its dimensions is written."""
        return None

    def validate(self) -> None:
        """Refuse a design that cannot be carried out, before any work.

        Raises
        ------
        RecipeError
            If there is no point or no seed, or there are too many.
        """
        if self.seeds < 1 or self.point_count < 1:
            raise RecipeError(f"expected at least 1 point and 1 seed; got {self.point_count} and {self.seeds}.")
        _require_count(self.count)
        if not 0 <= self.seed <= MAX_SEED:
            raise RecipeError(f"the seed must be 0 to {MAX_SEED}; got {self.seed}.")

    def as_dict(self) -> dict[str, Any]:
        """Plain values that say what was asked for."""
        told = {**self.told(), "seeds": self.seeds, "seed": self.seed, "base": self.base.as_dict()}
        return json.loads(json.dumps(told))


@dataclass(frozen=True, eq=False, kw_only=True)
class OneAtATime(Design):
    """The base, and each axis over its range while the others keep their base (appendix A of the paper).

    Attributes
    ----------
    axes : tuple of Axis
    points : int
        Values on each axis, evenly spaced on its scale, both ends included; fewer where whole numbers run out.

    Raises
    ------
    RecipeError
        If there are no axes, one is there twice, or there are fewer than two points.

    Notes
    -----
    Point 0 is the base; the points of the axes follow, axis by axis.
    """

    axes: tuple[Axis, ...] = TABLE_7
    points: int = 11

    def __post_init__(self) -> None:
        _require_axes(self.axes)
        if self.points < 2:
            raise RecipeError(f"expected at least 2 points on each axis; got {self.points}.")

    @cached_property
    def _values(self) -> tuple[tuple[float | int, ...], ...]:
        steps = [i / (self.points - 1) for i in range(self.points)]
        return tuple(tuple(dict.fromkeys(axis.setting(x) for x in steps)) for axis in self.axes)

    @cached_property
    def _places(self) -> tuple[range, ...]:
        ends = list(accumulate(map(len, self._values), initial=1))
        return tuple(range(start, end) for start, end in pairwise(ends))

    def values(self, axis: int) -> tuple[float | int, ...]:
        """Values on an axis (from 0)."""
        return self._values[axis]

    def points_of(self, axis: int) -> range:
        """Points of an axis (from 0)."""
        return self._places[axis]

    @property
    def point_count(self) -> int:
        """Number of points, the base included."""
        return self.points_of(len(self.axes) - 1).stop

    def settings(self, point: int) -> dict[str, Any]:
        """What a point (from 0) sets; nothing at point 0."""
        for i, axis in enumerate(self.axes):
            there = self.points_of(i)
            if point in there:
                return {axis.name: self.values(i)[point - there.start]}
        return {}

    def told(self) -> dict[str, Any]:
        """What was asked for."""
        return {"design": "one at a time", "points": self.points, "axes": _axes_as_lists(self.axes)}


@dataclass(frozen=True, eq=False, kw_only=True)
class Points(Design):
    """Any points of a space of axes.

    Attributes
    ----------
    axes : tuple of Axis
    coordinates : numpy.ndarray, shape (n, d)
        Of each point on each axis, 0 to 1; read-only.
    kind : str
        What the design is called.
    options : dict
        How the coordinates were made, in plain values.

    Raises
    ------
    RecipeError
        If there are no axes, one is there twice, or the coordinates are not such a table.
    """

    axes: tuple[Axis, ...]
    coordinates: np.ndarray
    kind: str = "points"
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _require_axes(self.axes)
        object.__setattr__(self, "coordinates", as_coordinates(self.coordinates, len(self.axes)))

    @property
    def point_count(self) -> int:
        """Number of points."""
        return len(self.coordinates)

    def settings(self, point: int) -> dict[str, Any]:
        """Values of a point (from 0) on the axes."""
        return {axis.name: axis.setting(float(x)) for axis, x in zip(self.axes, self.coordinates[point], strict=True)}

    def told(self) -> dict[str, Any]:
        """What was asked for; a digest tells whether another version of a library made other coordinates of it."""
        digest = hashlib.sha256(np.ascontiguousarray(self.coordinates, dtype="<f8").tobytes()).hexdigest()
        return {"design": self.kind, **self.options, "axes": _axes_as_lists(self.axes), "coordinates_sha256": digest}


def as_coordinates(coordinates: ArrayLike, width: int) -> np.ndarray:
    """Return coordinates as a read-only float64 array of shape (n, width), checked to be 0 to 1.

    Raises
    ------
    RecipeError
        If they are not.
    """
    array = np.array(coordinates, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != width:
        raise RecipeError(f"expected coordinates of shape (n, {width}), a column an axis; got {array.shape}.")
    if not (np.isfinite(array).all() and array.min(initial=0.0) >= 0.0 and array.max(initial=1.0) <= 1.0):
        raise RecipeError("expected coordinates from 0 to 1 on every axis; scale them to the ranges of the axes.")
    array.flags.writeable = False
    return array


def axes_for(triangles: int) -> tuple[Axis, ...]:
    """Table 7, the twist, the smoothing and the dimensions: the 19 inputs of a global analysis.

    Parameters
    ----------
    triangles : int
        A step of smoothing spreads over one edge, n steps over sqrt(n) edges, and an edge goes as 1 / sqrt(triangles):
        the range of the smoothing is the one that reaches as far as 200 steps do at 20,000 triangles.
    """
    factor = triangles / _REFERENCE_TRIANGLES
    return (*TABLE_7, *(
        replace(axis, high=min(max(float(round(axis.high * factor)), 4.0), 1000.0))
        if axis.name == "smoothing_iterations" else axis
        for axis in EXTRA_AXES
    ))  # fmt: skip


def latin_hypercube(n: int, d: int, seed: int) -> np.ndarray:
    """Latin hypercube, shape (n, d): each column has one value in each of n equal parts of 0 to 1 (McKay et al. 1979).

    Raises
    ------
    RecipeError
        If there is no point or no axis.
    """
    if n < 1 or d < 1:
        raise RecipeError(f"expected at least 1 point and 1 axis; got {n} and {d}.")
    generator = np.random.default_rng(seed)
    parts = np.stack([generator.permutation(n) for _ in range(d)], axis=1)
    return (parts + generator.random((n, d))) / n


def sobol_sequence(n: int, d: int, seed: int) -> np.ndarray:
    """Scrambled Sobol sequence, shape (n, d) (Owen 1998); n is a power of two.

    Raises
    ------
    RecipeError
        If it is not.
    """
    from scipy.stats import qmc

    _require_power(n)
    return qmc.Sobol(d=d, scramble=True, rng=np.random.default_rng(seed)).random(n)


def morris_trajectories(axes: tuple[Axis, ...], *, trajectories: int, levels: int = 4, seed: int = 0,
                        seeds: int = 1, base: Recipe | None = None) -> Points:  # fmt: skip
    """Trajectories of Morris (1991): on each, one axis after the other takes a step of levels / (2 (levels - 1)).

    Parameters
    ----------
    axes : tuple of Axis
    trajectories : int
    levels : int
        Levels of the grid, even.
    seed : int
        Of the trajectories and the stones.
    seeds : int
        Stones at each point.
    base : Recipe, optional
        Default: the benchmark of Table 1.

    Returns
    -------
    Points
        Of trajectories * (d + 1) points, trajectory by trajectory.

    Raises
    ------
    RecipeError
        If there are fewer than two trajectories, or the levels are odd or fewer than four.
    """
    from SALib.sample import morris

    if trajectories < 2 or levels < 4 or levels % 2:
        raise RecipeError("expected at least 2 trajectories and an even number of levels of at least 4; got "
                          f"{trajectories} and {levels}.")  # fmt: skip
    _require_axes(axes)
    _require_count(trajectories * (len(axes) + 1) * seeds)
    found = morris.sample(unit_problem(axes), trajectories, num_levels=levels, seed=np.random.default_rng(seed))
    found = np.clip(found, 0.0, 1.0)  # of steps that add up to 1 but for rounding
    options = {"trajectories": trajectories, "levels": levels}
    return Points(base=base or benchmark_recipe(), seeds=seeds, seed=seed, axes=axes, coordinates=found, kind="morris",
                  options=options)  # fmt: skip


def saltelli_sample(axes: tuple[Axis, ...], *, samples: int, seed: int = 0, seeds: int = 1,
                    base: Recipe | None = None) -> Points:  # fmt: skip
    """Sample of Saltelli et al. (2010): A, A with one column of B at a time, B, of a scrambled Sobol sequence.

    Parameters
    ----------
    axes : tuple of Axis
    samples : int
        Rows of A, a power of two.
    seed : int
        Of the sequence and the stones.
    seeds : int
        Stones at each point.
    base : Recipe, optional
        Default: the benchmark of Table 1.

    Returns
    -------
    Points
        Of samples * (d + 2) points, row by row.

    Raises
    ------
    RecipeError
        If samples is no power of two, or below 4.
    """
    from SALib.sample import sobol

    _require_power(samples, 4)
    _require_axes(axes)
    _require_count(samples * (len(axes) + 2) * seeds)
    found = sobol.sample(unit_problem(axes), samples, calc_second_order=False, seed=np.random.default_rng(seed))
    return Points(base=base or benchmark_recipe(), seeds=seeds, seed=seed, axes=axes, coordinates=found, kind="sobol",
                  options={"samples": samples})  # fmt: skip


def unit_problem(axes: tuple[Axis, ...]) -> dict[str, Any]:
    """What SALib calls a problem: the axes by name, each from 0 to 1."""
    return {"num_vars": len(axes), "names": [axis.name for axis in axes], "bounds": [[0.0, 1.0]] * len(axes)}


def _axes_as_lists(axes: tuple[Axis, ...]) -> list[list[Any]]:
    return [[axis.name, axis.scale, axis.low, axis.high] for axis in axes]


def _require_axes(axes: tuple[Axis, ...]) -> None:
    names = [axis.name for axis in axes]
    if not names or len(set(names)) < len(names):
        raise RecipeError(f"expected one or more axes, each once; got {', '.join(names) or 'none'}.")


def _require_count(count: int) -> None:
    if count > _MOST_PARTICLES:
        raise RecipeError(f"expected at most {_MOST_PARTICLES:,} particles; got {count:,}: take fewer points or seeds.")


def _require_power(n: int, least: int = 1) -> None:
    if n < least or n & (n - 1):
        raise RecipeError(f"expected a power of two of at least {least} samples; got {n}.")
