"""Errors of a simulation in the words of a packing: stones by their numbers and files, options as the way out."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from lithoform.errors import SimulationError

__all__ = ["naming_stones"]

_BLOCKS: Final = re.compile(r"\b(b|B)locks? (\d+)(?: and (\d+))?")


@contextmanager
def naming_stones(names: Callable[[int], str], factor: float, dt: float | None = None) -> Iterator[None]:
    """Tell errors of the simulation as errors of a packing, or a specimen.

    Parameters
    ----------
    names : callable
        File, or particle, of the stone with an index.
    factor : float
        On Young's modulus of Table 10.
    dt : float, optional
        Time step [s], where another one may be given.

    Raises
    ------
    SimulationError
        With the stones numbered from 1, as in blocks.csv, and the time and the bodies of the error.
    """
    try:
        yield
    except SimulationError as error:
        told = str(error).rstrip(".")
        # What follows the last colon is the way out of those who set up the simulation.
        what = _BLOCKS.sub(lambda found: _named(found, names), told.rpartition(": ")[0] or told)
        ways = [] if dt is None else [f"a --dt below {dt:.2g}"]
        if factor < 1.0:
            ways.append(f"a --stiffness-factor above {factor:g}")
        raise SimulationError(
            f"{what} (stones are numbered as in blocks.csv): {'give ' if ways else ''}"
            f"{', or '.join([*ways, 'leave such stones out'])}.",
            time=error.time,
            bodies=error.bodies,
        ) from error


def _named(found: re.Match[str], names: Callable[[int], str]) -> str:
    indices: Sequence[int] = [int(k) for k in found.groups()[1:] if k is not None]
    word = ("Stone" if found[1] == "B" else "stone") + ("s" if len(indices) > 1 else "")
    return f"{word} " + " and ".join(f"{k + 1} ({names(k)})" for k in indices)
