"""`measure` one body, or many over all cores."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from typing import Any

from lithoform.descriptors.body import Body, BoxKind
from lithoform.descriptors.table import DESCRIPTORS, FOUR, STANDARD
from lithoform.errors import MeshError
from lithoform.parallel import in_order
from lithoform.parameters import suggest
from lithoform.progress import track

__all__ = ["Measurement", "measure", "measure_body", "measure_many", "resolve_names"]

_SETS = {"four": FOUR, "standard": STANDARD, "all": tuple(DESCRIPTORS)}


class Measurement(Mapping[str, Any]):
    """Values by the names of descriptors, with the conventions that they depend on.

    Parameters
    ----------
    values : mapping
        In the unit u of the mesh, to the power that the descriptor's row says.
    conventions : mapping
        Of each value that has a choice: {"boxiness": {"box": "principal"}, "roundness": {"scale": 0.25}, ...}.
    notes : tuple of str
        What a reader should know of these values, such as a mesh too coarse for the scale of the roundness.
    """

    def __init__(
        self,
        values: Mapping[str, Any],
        conventions: Mapping[str, Mapping[str, Any]] | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        self._values = dict(values)
        self.conventions = {name: dict(choices) for name, choices in (conventions or {}).items()}
        self.notes = notes

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        shown = ", ".join(f"{k}={v:.4g}" if isinstance(v, float) else f"{k}={v}" for k, v in self._values.items())
        return f"Measurement({shown})"

    def scaled(self, factor: float) -> Measurement:
        """The same with lengths multiplied by a factor, areas by its square, and so on: for another unit."""
        powers = {name: DESCRIPTORS[name].power for name in self._values}
        values = {name: v * factor ** powers[name] if powers[name] else v for name, v in self._values.items()}
        return Measurement(values, self.conventions, self.notes)


def resolve_names(names: str | Iterable[str] | None) -> tuple[str, ...]:
    """Names of descriptors that a request means, in its order, each once.

    Parameters
    ----------
    names : str, iterable of str or None
        Names of `DESCRIPTORS`, or "four", "standard" (the default), "all".

    Raises
    ------
    MeshError
        If a name is unknown; the nearest is named.
    """
    asked = ["standard"] if names is None else [names] if isinstance(names, str) else list(names)
    out: dict[str, None] = {}
    for name in asked:
        if name not in DESCRIPTORS and name not in _SETS:
            known = (*_SETS, *DESCRIPTORS)
            raise MeshError(f"expected descriptors of {', '.join(known)}; got {name!r}.{suggest(name, known)}")
        out.update(dict.fromkeys(_SETS.get(name, (name,))))
    if not out:
        raise MeshError("expected at least one descriptor, such as roundness; got none.")
    return tuple(out)


def measure(
    mesh: Any, names: str | Iterable[str] | None = None, *, box: BoxKind = "principal", scale: float = 0.25
) -> Measurement:
    """Measures of a body, each once, sharing what they share (hull, frames, inscribed sphere).

    Parameters
    ----------
    mesh : Mesh or Particle
        Closed and outward, in any unit u (u is the metre for particles and for what `read_scan` returns).
    names : str or iterable of str, optional
        Names of `DESCRIPTORS`, or "four", "standard" (the default: all but the slow and rare), "all".
    box : {"principal", "solid", "vertices", "minimum"}
        Box of boxiness and of the principal dimensions: along the principal axes of the surface (the paper's, freed
        from the mesh), of the solid or of the vertices, or that of least volume, in which boxiness is larger.
    scale : float
        Scale beta of the roundness: curvature is measured within beta times the inscribed radius.

    Returns
    -------
    Measurement
        A mapping from names to values in u, u^2, u^3 or plain numbers.

    Raises
    ------
    MeshError
        If a name is unknown, or the mesh is open, inside out or flat.

    Examples
    --------
    >>> from lithoform import Recipe, generate, measure
    >>> values = measure(generate(Recipe(seed=1)), "four")
    >>> list(values)
    ['roundness', 'boxiness', 'solidity', 'true_sphericity']
    """
    wanted = resolve_names(names)
    return measure_body(Body(mesh, box=box, scale=scale), wanted)


def measure_body(body: Body, names: Sequence[str]) -> Measurement:
    """As `measure`, of a body whose shared results the caller wants to use further, as for a picture."""
    values = {name: DESCRIPTORS[name].function(body) for name in names}
    choices = {"box": body.box_kind, "scale": body.scale}
    conventions = {
        name: {choice: choices[choice] for choice in DESCRIPTORS[name].conventions}
        for name in names
        if DESCRIPTORS[name].conventions
    }
    notes = []
    if any("scale" in DESCRIPTORS[name].conventions for name in names) and body.roundness.under_resolved:
        notes.append(
            f"the mesh is too coarse for a roundness at scale {body.scale:g}: use more triangles or a larger scale"
        )
    return Measurement(values, conventions, tuple(notes))


def measure_many(
    meshes: Iterable[Any],
    names: str | Iterable[str] | None = None,
    *,
    box: BoxKind = "principal",
    scale: float = 0.25,
    threads: int | None = None,
    progress: bool = False,
) -> Iterator[Measurement]:
    """Measure many bodies on all cores, in their order and in bounded memory.

    Parameters
    ----------
    meshes : iterable of Mesh or Particle
        Any number; consumed as they are measured, so that a generator of meshes will do.
    names, box, scale
        As `measure`.
    threads : int, optional
        Number of threads (default: the processors that this process may use); the values do not depend on it.
    progress : bool
        Show a bar on a terminal.

    Yields
    ------
    Measurement

    Raises
    ------
    MeshError
        As `measure`; the measurements before the fault have been handed out.
    ValueError
        If threads is not positive.
    """
    wanted = resolve_names(names)
    total = len(meshes) if isinstance(meshes, Sized) else None
    stream = in_order(lambda mesh: measure(mesh, wanted, box=box, scale=scale), meshes, threads=threads)
    return track(stream, total=total, what="bodies", enabled=progress) if progress else stream
