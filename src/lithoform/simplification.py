"""Fewer triangles for the same body, by edge collapse under a quadric error; the result is sound or it is refused.

The work is done by the fast-simplification package (Garland & Heckbert's quadrics, collapsed in the order of a
rising threshold instead of a heap).  Its thresholds are absolute, so that a body is centred and brought to unit
size first.  It does not test whether a collapse keeps the surface a manifold: now and then a fold of two coincident
faces is left, or two faces cross.  Where the surface is flat, every collapse is free and the point to collapse to is
not determined, so that faces come to lie on each other.  Hence every result is checked, folds are taken out, and
other settings are tried, the body slightly bent among them: x (1 - b |x|^2) makes a flat face round, and is undone.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from lithoform.errors import MeshError
from lithoform.mesh import Mesh
from lithoform.soundness import check

__all__ = ["Drift", "simplification_drift", "simplify"]

# Exponents of the threshold 1e-9 (k + 3)^a of round k, in the order of trial.  A slow rise collapses edges nearly in
# the order of their error: over 40 stones of 51,200 triangles brought to 20,000 and 5,000, a = 3 came nearest to the
# body (root mean square 0.02 % and 0.06 % of its half extent; 0.03 % and 0.11 % with the package's own 7) and left
# no fault in 80 results (17 with 7).  The library stops after 100 rounds, so that a strong reduction needs a fast rise.
_AGGRESSIVENESS: Final = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0)

# Bends b of the unit body.  1e-4 is enough for a box of 3,072 triangles, and moves its volume by 6e-6 at 500 triangles.
_BENDS: Final = (0.0, 1e-4)

# Steps that undo the bend; each gains 3 digits, since |x|^2 <= 3.
_UNBENDING_STEPS: Final = 8

# Where no setting serves, fewer triangles are asked for, by so many; never below 99 % of what was asked.
_FEWER: Final = (0, 2, 6, 14, 30)
_LEAST: Final = 0.99

# The library keeps the body that it works on in global variables.
_ONE_AT_A_TIME: Final = threading.Lock()


@dataclass(frozen=True)
class Drift:
    """What a measure says of a body with fewer triangles.

    Attributes
    ----------
    triangles : int
        Number of triangles that the body has here.
    values : dict of str to float
        What the measure returned, in its own units.
    relative : dict of str to float
        (value - value of the first row) / |value of the first row|: 0 where both are equal, otherwise not a number
        where the first is 0.
    """

    triangles: int
    values: dict[str, float]
    relative: dict[str, float]


def simplify(mesh: Mesh, triangles: int) -> Mesh:
    """The same body with fewer triangles.

    Edges are collapsed to the point that minimises the sum of squared distances to the planes of the faces merged
    so far (Garland & Heckbert 1997), those of small error first.

    Parameters
    ----------
    mesh : Mesh
        Sound (see `lithoform.soundness.check`), in any unit and place.
    triangles : int
        The most triangles that the result may have, at least 4.

    Returns
    -------
    Mesh
        Sound, in the unit and place of the input, with `triangles` triangles (one less where that is odd) or, if no
        sound mesh of that many was found, fewer by at most 1 %.  The mesh itself if it has no more than asked.  Its
        vertices are new ones, not a subset of those given; the same input gives the same bytes.

    Raises
    ------
    MeshError
        If the number is not a whole one of at least 4, the mesh given is not sound, or no sound mesh of so few
        triangles was found.

    References
    ----------
    Garland, M. & Heckbert, P. S. (1997). Surface simplification using quadric error metrics. SIGGRAPH 97, 209-216.
    """
    if isinstance(triangles, bool) or not isinstance(triangles, int | np.integer) or triangles < 4:
        raise MeshError(f"expected a whole number of at least 4 triangles to simplify to, got {triangles!r}.")
    if len(mesh.faces) <= triangles:
        return mesh
    # The library closes small holes without a word, so that a sound result proves nothing about what was given.
    problems = check(mesh).problems()
    if problems:
        raise MeshError(f"a mesh must be sound to be simplified, but this one has faults: {'; '.join(problems)}.")
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    # Halves, since the sum or difference of two large coordinates may overflow.
    centre, half = 0.5 * low + 0.5 * high, float((0.5 * high - 0.5 * low).max())
    unit = (mesh.vertices - centre) / half
    for fewer in _FEWER:
        wanted = int(triangles) - fewer
        if wanted < max(4, _LEAST * triangles):
            break
        for aggressiveness, bend in product(_AGGRESSIVENESS, _BENDS):
            points, faces = _collapse(_bent(unit, bend), mesh.faces, wanted, aggressiveness)
            if not _LEAST * triangles - 1.0 <= len(faces) <= triangles:
                continue
            result = Mesh(_unbent(points, bend) * half + centre, faces)
            if check(result).sound:
                return result
    raise MeshError(
        f"no sound mesh of {triangles} triangles was found for this body of {len(mesh.faces)}; ask for more triangles."
    )


def simplification_drift(
    mesh: Mesh, counts: Sequence[int], measure: Callable[[Mesh], Mapping[str, float]]
) -> list[Drift]:
    """How far a measure moves when a body is told with fewer triangles (the paper's Fig. 4b).

    Parameters
    ----------
    mesh : Mesh
        The finest mesh, sound.
    counts : sequence of int
        Numbers of triangles; each mesh is simplified from the finest, not from the one before.
    measure : callable
        From a mesh to named numbers, the same names for each mesh.

    Returns
    -------
    list of Drift
        The first for the mesh given, then one for each count, in order.

    Raises
    ------
    MeshError
        As `simplify`; whatever the measure raises passes through.
    """
    rows: list[Drift] = []
    for body in (mesh, *(simplify(mesh, count) for count in counts)):
        values = {name: float(value) for name, value in measure(body).items()}
        first = rows[0].values if rows else values
        relative = {name: _relative_change(value, first[name]) for name, value in values.items()}
        rows.append(Drift(len(body.faces), values, relative))
    return rows


def _relative_change(value: float, reference: float) -> float:
    if value == reference:
        return 0.0
    return (value - reference) / abs(reference) if reference else float("nan")


def _collapse(
    points: np.ndarray, faces: np.ndarray, triangles: int, aggressiveness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and faces (m, 3) of one run of the library, without folds."""
    import fast_simplification

    # Copies, because the library refuses read-only arrays.
    with _ONE_AT_A_TIME:
        fewer_points, fewer_faces = fast_simplification.simplify(
            points.copy(), faces.copy(), target_count=triangles, agg=aggressiveness
        )
    fewer_faces = _without_folds(fewer_faces)
    used, inverse = np.unique(fewer_faces, return_inverse=True)
    return fewer_points[used], inverse.reshape(-1, 3)


def _bent(points: np.ndarray, bend: float) -> np.ndarray:
    """Map x to x (1 - b |x|^2), shape (n, 3): planes at a distance from the origin bulge outwards."""
    return points * (1.0 - bend * _squares(points))


def _unbent(points: np.ndarray, bend: float) -> np.ndarray:
    """The inverse of `_bent` by fixed-point iteration, shape (n, 3)."""
    flat = points
    for _ in range(_UNBENDING_STEPS if bend else 0):
        flat = points / (1.0 - bend * _squares(flat))
    return flat


def _squares(points: np.ndarray) -> np.ndarray:
    return points[:, 0:1] ** 2 + points[:, 1:2] ** 2 + points[:, 2:3] ** 2


def _without_folds(faces: np.ndarray) -> np.ndarray:
    """Faces less the pairs that lie on each other, back to back, on the same three vertices.

    Such a pair encloses nothing; where its edge carries two further faces, these close up without it.
    """
    _, inverse, counts = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return faces[counts[inverse.ravel()] != 2]
