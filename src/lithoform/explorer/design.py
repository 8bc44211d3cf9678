"""The design space: columns of a library, mismatch with a target, filters, and the best candidates."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from lithoform.axes import axis_values
from lithoform.descriptors.table import DESCRIPTORS, FOUR
from lithoform.errors import LithoformError
from lithoform.explorer.turns import POLL
from lithoform.lazy import cached_property
from lithoform.parameters import PARAMETERS
from lithoform.presets import SHAPE_CLASSES, ZINGG_LIMIT

if TYPE_CHECKING:
    from lithoform.explorer.turns import Ticket
    from lithoform.inverse.library import DesignLibrary
    from lithoform.inverse.surrogate import Surrogate
    from lithoform.inverse.targets import Target

__all__ = ["MISMATCH", "DesignSpace", "Filter", "target_of"]

MISMATCH: Final = "E"
"""Name of the mismatch, eq. 30, among the quantities."""

_MEANINGS: Final = {
    **{name: row.definition for name, row in DESCRIPTORS.items()},
    **{parameter.name: parameter.meaning for parameter in PARAMETERS},
    MISMATCH: "mismatch with the target, eq. 30",
}
_SYMBOLS: Final = {
    **{name: DESCRIPTORS[name].symbol for name in (*FOUR, "elongation", "flatness")},
    **{p.name: p.symbol for p in PARAMETERS},
}
_BASELINE_SEEDS: Final = 5
_MOST_ASKED: Final = 1e6  # of a tolerance or a weight: E stays finite


@dataclass(frozen=True)
class Filter:
    """Which points are shown.

    Attributes
    ----------
    classes : tuple of str
        Zingg classes of the target dimensions.
    ranges : tuple of (str, float, float)
        Quantity, least and greatest value; infinite where there is no limit.
    is_within : bool
        Only points whose descriptors are all within the tolerances.
    """

    classes: tuple[str, ...] = SHAPE_CLASSES
    ranges: tuple[tuple[str, float, float], ...] = ()
    is_within: bool = False


class DesignSpace:
    """A library, as the page looks at it.

    Attributes
    ----------
    library : DesignLibrary
    quantities : tuple of str
        Names of what can be on an axis: the four descriptors, E, the axes of the library.
    """

    def __init__(self, library: DesignLibrary) -> None:
        self.library = library
        self.quantities = (*FOUR, MISMATCH, *(axis.name for axis in library.axes))
        values = library.values()
        self._columns = {name: library.descriptors[:, i] for i, name in enumerate(FOUR)}
        self._columns |= {axis.name: values[:, i] for i, axis in enumerate(library.axes)}
        self._lock = threading.Lock()
        self._surrogate: Surrogate | None = None

    def __len__(self) -> int:
        return len(self.library.descriptors)

    def column(self, name: str, mismatch: np.ndarray) -> np.ndarray:
        """Values of a quantity, shape (n,).

        Raises
        ------
        LithoformError
            If there is no such quantity.
        """
        if name == MISMATCH:
            return mismatch
        if name not in self._columns:
            raise LithoformError(f"expected a quantity of {', '.join(self.quantities)}; got {name!r}.")
        return self._columns[name]

    @cached_property
    def classes(self) -> np.ndarray:
        """Zingg class of every point's target dimensions, shape (n,)."""
        base = axis_values(self.library.base, ("elongation", "flatness"))
        slim, flat = (
            self._columns.get(name, np.full(len(self), base[name])) < ZINGG_LIMIT for name in ("elongation", "flatness")
        )
        return np.array(SHAPE_CLASSES)[2 * slim.astype(int) + flat]

    def mismatch(self, target: Target) -> np.ndarray:
        """E of every point, shape (n,)."""
        from lithoform.inverse.targets import mismatch

        return mismatch(self.library.descriptors, target)

    def shown(self, chosen: Filter, target: Target) -> np.ndarray:
        """Indices of the points that a filter leaves, shape (k,)."""
        from lithoform.inverse.targets import within

        kept = np.isin(self.classes, list(chosen.classes))
        mismatch = self.mismatch(target)
        for name, low, high in chosen.ranges:
            values = self.column(name, mismatch)
            kept &= (values >= low) & (values <= high)
        if chosen.is_within:
            kept &= within(self.library.descriptors, target)
        return np.flatnonzero(kept)

    def best(self, indices: np.ndarray, target: Target, count: int) -> np.ndarray:
        """The points of least E among some, best first; of equal ones the first."""
        mismatch = self.mismatch(target)[indices]
        return indices[np.argsort(mismatch, kind="stable")[: max(count, 0)]]

    def values_at(self, index: int) -> dict[str, float]:
        """Descriptors and axes of a point."""
        return {name: float(column[index]) for name, column in self._columns.items()}

    def predicted(self, index: int, ticket: Ticket | None = None) -> dict[str, list[float]]:
        """Mean and scatter from seed to seed of the descriptors at a point, by the surrogate of the library.

        Parameters
        ----------
        index : int
        ticket : Ticket, optional
            Of the request.  The first fits the surrogate, and holds a place for work while it does; others wait for it
            without one.

        Returns
        -------
        dict
            "mean", "scatter": four numbers each.

        Raises
        ------
        SupersededError
            If the request is overtaken while it waits.
        """
        while not self._lock.acquire(timeout=POLL):
            if ticket is not None:
                ticket.require()
        try:
            if self._surrogate is None:
                from lithoform.inverse.surrogate import Surrogate

                with contextlib.nullcontext() if ticket is None else ticket.working():
                    self._surrogate = Surrogate.fit(self.library)
            surrogate = self._surrogate
        finally:
            self._lock.release()
        told = surrogate.predict(self.library.coordinates[index : index + 1])
        return {"mean": [float(v) for v in told.mean[0]], "scatter": [float(v) for v in told.scatter[0]]}

    @cached_property
    def baseline(self) -> dict[str, float]:
        """The benchmark's place: means of its descriptors over a few seeds, and its own parameters."""
        from lithoform.descriptors.measuring import measure
        from lithoform.generation import generate
        from lithoform.presets import benchmark_recipe

        recipe = benchmark_recipe(triangles=self.library.base.triangles)
        stones = [measure(generate(recipe.replace(seed=seed)), FOUR) for seed in range(_BASELINE_SEEDS)]
        means = {name: math.fsum(stone[name] for stone in stones) / len(stones) for name in FOUR}
        return {**means, **axis_values(recipe, tuple(axis.name for axis in self.library.axes))}

    def label(self, name: str) -> str:
        """A quantity for an axis: name, symbol."""
        symbol = _SYMBOLS.get(name, "").replace("S_3D", "S3D")
        return name.replace("_", " ") + (f" {symbol}" if symbol else "")

    def meaning(self, name: str) -> str:
        """What a quantity is."""
        return _MEANINGS.get(name, "")


def target_of(values: Sequence[Any], tolerances: Sequence[Any], weights: Sequence[Any]) -> Target:
    """Target of the fields of a page; a field left empty asks nothing of its descriptor.

    Raises
    ------
    LithoformError
        If a number is missing, or the target is not valid.
    """
    from lithoform.inverse.targets import Target

    rows: Mapping[str, Sequence[Any]] = {"tolerance": tolerances, "weight": weights}
    for what, numbers in rows.items():
        for name, number in zip(FOUR, numbers, strict=True):
            if not _is_number(number):
                raise LithoformError(f"expected a number as the {what} of {name}; the field is empty or holds none.")
    for what, numbers, least in (("tolerance", tolerances, 1e-6), ("weight", weights, 0.0)):
        if not all(least <= number <= _MOST_ASKED for number in numbers):
            raise LithoformError(f"expected every {what} from {least:g} to {_MOST_ASKED:g}.")
    asked = [float(v) if _is_number(v) else math.nan for v in values]
    return Target(tuple(asked), tuple(map(float, tolerances)), tuple(map(float, weights)))  # type: ignore[arg-type]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
