"""Repair of scanned surfaces: a mesh with faults in, the boundary of one solid out, and an account of what was done.

Corners are merged, doubled and flat faces dropped, edges of more than two faces and touching vertices resolved, the
largest piece kept and wound outwards, its holes filled (`lithoform.scans.hole_filling`), and where it crosses itself
the faces concerned and a growing ring about them are removed and the gap is filled, until the soundness check passes
(Attene 2010).  What cannot be repaired without inventing a shape is refused.

References
----------
Attene, M. (2010). A lightweight approach to repairing digitized polygon meshes. Vis. Comput. 26, 1393-1406.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.errors import MeshError
from lithoform.mesh import Connectivity, Mesh, weld
from lithoform.scans.cleaning import (
    bow_ties,
    crowded_faces,
    distinct_faces,
    face_areas,
    flatten_slivers,
    largest_patch,
    orient,
    split_fans,
    weld_rims,
)
from lithoform.scans.hole_filling import fill_holes, lids
from lithoform.soundness import SoundnessReport, check

__all__ = ["ALL_LIDS", "LARGEST_LID", "Repaired", "refuse_flat", "repair"]

LARGEST_LID: Final = 0.12
"""Share of the closed surface that the lid of one hole may have.  A faired cap over such a hole misses about 1 % of the
volume (0.9 % on an ellipsoid of 1 : 0.8 : 0.6, and 3 % at a share of 0.2): beyond, the cap and not the stone would be
measured."""

ALL_LIDS: Final = 0.3
"""Share that the lids of all holes may have together: small holes are closed well, but their sum must stay a part."""

_FARTHEST: Final = 1e4
"""Distance of a vertex from the middle, in medians of all, beyond which it is a fault: no stone has such a needle."""

_FLATTEST: Final = 1e-6
"""Least thickness of a body beside its length: below it the crossing of its two sides is a matter of rounding."""

_PLACED: Final = 32
"""Dropped pieces that are looked at for whether they lay inside: each costs a pass over all faces."""

_ROUNDS: Final = 12
"""Of removing crossing faces; each takes a ring more than the one before."""


@dataclass(frozen=True, eq=False)
class Repaired:
    """A sound mesh.

    Attributes
    ----------
    mesh : Mesh
        In the unit and frame of what came; the very same object if it was sound.
    notes : tuple of str
        What was wrong and was set right, one plain sentence each.
    """

    mesh: Mesh
    notes: tuple[str, ...]


@dataclass
class _Account:
    """Counts of what was done, gathered over the rounds."""

    counts: Counter[str] = field(default_factory=Counter)
    rim_tolerance: float = 0.0
    holes: list[float] = field(default_factory=list)
    dropped_points: list[np.ndarray] = field(default_factory=list)
    dropped_share: float = 0.0


def repair(mesh: Mesh | tuple[ArrayLike, ArrayLike]) -> Repaired:
    """Make a mesh the boundary of one solid, or say why it cannot be.

    Parameters
    ----------
    mesh : Mesh or (vertices, faces)
        Vertices of shape (n, 3) [u], which may hold what is not finite; faces of shape (m, 3), vertex indices.

    Returns
    -------
    Repaired
        Its mesh passes `lithoform.soundness.check`.  A mesh that is sound comes back as it is, without a note.

    Raises
    ------
    MeshError
        If there are no faces or too few, the body is flat, its surface has one side only, the lids of its holes would
        be more of the surface than `LARGEST_LID` and `ALL_LIDS`, it has a tunnel, or crossings remain after all rounds.
    """
    if isinstance(mesh, Mesh):
        vertices, faces, whole = mesh.vertices, mesh.faces.astype(np.int64), mesh
    else:
        vertices, faces = _checked_arrays(*mesh)
        whole = None
    account = _Account()
    kept = _ordinary(vertices, faces)
    refuse_flat(vertices, faces[kept])
    if kept.all():
        whole = whole or Mesh(vertices, faces)
        if _may_be_sound(whole) and check(whole).sound:
            return Repaired(whole, ())
    account.counts["not finite"] = int((~kept).sum())
    faces = faces[kept]
    # About the middle and beside the size, so that squares of huge or tiny lengths stay in range.
    used = np.unique(faces)
    if len(used) < len(vertices):
        vertices, faces = vertices[used], np.searchsorted(used, faces)
    exponent = int(np.frexp(abs(vertices).max())[1])
    scaled = np.ldexp(vertices, -exponent)
    scaled, faces, report = _repaired(scaled, faces, account)
    if not report.sound:
        raise MeshError(_remaining(report))
    used = np.unique(faces)
    notes = _notes(account, scaled, faces)
    return Repaired(Mesh(np.ldexp(scaled[used], exponent), np.searchsorted(used, faces)), notes)


def _may_be_sound(mesh: Mesh) -> bool:
    """What is quickly told, before a search for crossings that takes long where whole faces lie on each other."""
    if (mesh.area_vectors == 0.0).all(axis=1).any():
        return False
    table = mesh.connectivity
    paired = (table.edge_face_counts == 2).all() and not table.edge_windings.any()
    return bool(paired) and table.euler_characteristic == 2 and table.component_count == 1


def _checked_arrays(vertices: ArrayLike, faces: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    points, triangles = np.asarray(vertices, np.float64), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"expected vertices of shape (n, 3), got {points.shape}.")
    if triangles.size == 0:
        raise MeshError(f"it holds {len(points):,} points and no triangles; make a surface of them first.")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise MeshError(f"expected faces as whole numbers of shape (m, 3), got {triangles.dtype}, {triangles.shape}.")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise MeshError(f"expected vertex indices from 0 to {len(points) - 1} in the faces, "
                        f"got {triangles.min()} to {triangles.max()}.")  # fmt: skip
    return points, triangles.astype(np.int64)


def _ordinary(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Mask (m,) of the faces whose corners are finite and not out of all proportion."""
    good = np.all(np.isfinite(vertices), axis=1)
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    if (good & used).any():
        # Halved, so that the difference of the largest numbers does not overflow.
        half = 0.5 * np.where(good[:, None], vertices, 0.0)
        distance = abs(half - np.median(half[good & used], axis=0)).max(axis=1)
        middle = float(np.median(distance[good & used]))
        good &= (distance <= _FARTHEST * middle) | (middle == 0.0)
    return np.all(good[faces], axis=1)


def refuse_flat(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Raise a `MeshError` if there are fewer than four faces, or the points that are finite lie in a plane.

    Told before any search for crossings, which takes long where all faces lie on each other.
    """
    if len(faces) < 4:
        raise MeshError(
            f"it holds {_count(len(faces), 'usable triangle')}, and no solid has fewer than 4; check how it was "
            "exported."
        )
    points = vertices[np.unique(faces)]
    half = 0.5 * points[np.all(np.isfinite(points), axis=1)]
    if len(half) == 0:
        raise MeshError("none of its points has finite coordinates; check how it was exported.")
    half = half - half.mean(axis=0)
    size = abs(half).max()
    if size == 0.0:
        raise MeshError("all its points lie at one place; check how it was exported.")
    # Sums in a fixed order, and not a matrix product, whose last bits depend on the threads.
    half = half / size
    _, axes = np.linalg.eigh(np.einsum("ni,nj->ij", half, half))
    extents = np.sort(np.ptp(np.einsum("ni,ij->nj", half, axes), axis=0))
    if extents[0] <= _FLATTEST * extents[2]:
        raise MeshError(
            f"it is flat: its thickness is {extents[0] / extents[2]:.2g} of its length, so that it encloses no volume."
        )


def _repaired(
    vertices: np.ndarray, faces: np.ndarray, account: _Account
) -> tuple[np.ndarray, np.ndarray, SoundnessReport]:
    """Rounds of cleaning, filling and removing what crosses, until the check passes or the rounds are spent."""
    vertices, faces = _joined(vertices, faces, account)
    fair, turn = True, 0
    while True:
        vertices, faces = _as_manifold(vertices, faces, account)
        before = len(faces)
        vertices, faces = _closed(vertices, faces, account, fair=fair)
        # Cleared of what is not used, as every round may have left some.
        used = np.unique(faces)
        vertices, faces = vertices[used], np.searchsorted(used, faces)
        mesh = Mesh(vertices, faces)
        if mesh.volume < 0.0:
            account.counts["inside out"] += turn == 0
            faces = np.ascontiguousarray(faces[:, ::-1])
            mesh = Mesh(vertices, faces)
        report = check(mesh)
        bad = np.zeros(len(faces), bool)
        bad[report.self_intersections.ravel()] = True
        bad[report.zero_area_faces] = True
        bad |= np.isin(faces, report.pinched_vertices).any(axis=1)
        if report.sound or turn == _ROUNDS or not bad.any():
            return vertices, faces, report
        # A cap that crosses its surroundings lies flatter without the fairing.
        fair = not bad[before:].any() and turn % 2 == 0
        for _ in range(turn // 2):
            bad = np.isin(faces, faces[bad]).any(axis=1)
        account.counts["crossing"] += int(bad.sum())
        faces = faces[~bad]
        if len(faces) < 4:
            raise MeshError("nothing is left of it once the faces that cross each other are removed.")
        turn += 1


def _joined(vertices: np.ndarray, faces: np.ndarray, account: _Account) -> tuple[np.ndarray, np.ndarray]:
    """Corners merged, first where equal, then within a tolerance, as far as the surface is open without."""
    if _is_open(vertices, faces):
        count = len(vertices)
        vertices, faces = weld(vertices, faces)
        account.counts["equal corners"] = count - len(vertices)
        account.counts["distinct corners"] = len(vertices)
    faces = _distinct(faces, account)
    if len(faces) and _is_open(vertices, faces):
        faces, account.counts["rim corners"], account.rim_tolerance = weld_rims(vertices, faces)
        faces = _distinct(faces, account)
    if len(faces):
        faces, slivers = flatten_slivers(vertices, faces)
        account.counts["slivers"] += slivers
        faces = _distinct(faces, account)
    if len(faces) < 4:
        raise MeshError(
            f"only {_count(len(faces), 'triangle')} with an area and three different corners would be left of it, "
            "and no solid has fewer than 4; check how it was exported."
        )
    return vertices, faces


def _is_open(vertices: np.ndarray, faces: np.ndarray) -> bool:
    return bool((Connectivity(faces, len(vertices)).edge_face_counts == 1).any())


def _distinct(faces: np.ndarray, account: _Account) -> np.ndarray:
    whole = (faces != np.roll(faces, -1, axis=1)).all(axis=1)
    kept = distinct_faces(faces)
    account.counts["collapsed"] += int((~whole).sum())
    account.counts["doubled"] += int(whole.sum()) - len(kept)
    return kept


def _as_manifold(vertices: np.ndarray, faces: np.ndarray, account: _Account) -> tuple[np.ndarray, np.ndarray]:
    """One piece, at most two faces on an edge, one fan about a vertex, all wound one way."""
    total = float(face_areas(vertices, faces).sum())
    # Each pass removes faces or is the last; the bound is far above what was ever needed.
    for _ in range(1000):
        crowded = crowded_faces(vertices, faces)
        account.counts["crowded"] += int(crowded.sum())
        faces = faces[~crowded]
        if len(faces) == 0:
            raise MeshError("nothing is left of it once edges with more than two faces are resolved.")
        largest, label = largest_patch(vertices, faces)
        if not largest.all():
            dropped = faces[~largest]
            firsts = np.unique(label[~largest], return_index=True)[1]
            account.counts["pieces"] += len(firsts)
            account.dropped_points += list(vertices[dropped[firsts]].mean(axis=1))
            account.dropped_share += float(face_areas(vertices, dropped).sum()) / total
            faces = faces[largest]
        ties = bow_ties(faces, len(vertices))
        if not ties.any():
            break
        account.counts["bow ties"] += int(ties.sum())
        faces = faces[~ties]
        if len(faces) == 0:
            raise MeshError("nothing is left of it once faces that hang together at single points are removed.")
    before = len(vertices)
    vertices, faces = split_fans(vertices, faces)
    account.counts["split"] += len(vertices) - before
    faces, turned = orient(faces, len(vertices))
    account.counts["turned"] += turned
    return vertices, faces


def _closed(vertices: np.ndarray, faces: np.ndarray, account: _Account, *, fair: bool) -> tuple[np.ndarray, np.ndarray]:
    """Holes filled, if the lids are no larger than a stone can stand."""
    if not _is_open(vertices, faces):
        return vertices, faces
    surface = float(face_areas(vertices, faces).sum())
    holes = lids(vertices, faces)
    areas = np.array([hole.area for hole in holes])
    share = areas / (surface + areas.sum())
    if share.max() > LARGEST_LID or share.sum() > ALL_LIDS:
        cut = account.counts["crossing"]
        fault = "its surface is open" + (" where the faces that cross each other were removed" if cut else "")
        raise MeshError(
            f"{fault}: it has {_count(len(holes), 'hole')}, and lids over them would be "
            f"{100 * share.sum():.0f} % of the closed surface, the largest {100 * share.max():.0f} %; with more than "
            f"{100 * ALL_LIDS:.0f} % or {100 * LARGEST_LID:.0f} % the lids and not the stone would be measured; scan "
            "the missing part, or close it by hand."
        )
    # Gaps that later rounds cut and close are told as crossings.
    if not account.counts["crossing"]:
        account.holes += share.tolist()
    return fill_holes(vertices, faces, holes, fair=fair)


def _remaining(report: SoundnessReport) -> str:
    """Why a mesh is refused that the rounds could not make sound."""
    if report.components == 1 and report.closed and report.manifold and len(report.self_intersections) == 0:
        tunnels = (2 - report.euler_characteristic) // 2
        if tunnels > 0:
            return (
                f"the body has {_count(tunnels, 'tunnel')} right through it, where a stone has none; close them by "
                "hand, or smooth the image from which the surface was made."
            )
    return f"it could not be repaired in {_ROUNDS} rounds: {'; '.join(report.problems())}; repair it by hand."


def _notes(account: _Account, vertices: np.ndarray, faces: np.ndarray) -> tuple[str, ...]:
    """One sentence for each thing that was done."""
    counts, notes = account.counts, []

    def tell(done: str, name: str, what: str, why: str) -> None:
        if counts[name]:
            notes.append(f"{done} {_count(counts[name], what)} {why}".rstrip())

    tell("dropped", "not finite", "face", "with corners that are not finite or lie out of all proportion")
    tell("merged", "equal corners", "vertex", "into others at the same place")
    tell("merged", "rim corners", "vertex", f"on open edges, up to {account.rim_tolerance:.0e} of the size apart")
    tell("dropped", "collapsed", "face", "with a vertex named twice")
    tell("resolved", "slivers", "face", "without area")
    tell("dropped", "doubled", "face", "that came twice")
    tell("dropped", "crowded", "face", "on edges with more than two faces, and what hung on them")
    tell("dropped", "bow ties", "face", "about vertices where two gaps met")
    tell("split", "split", "vertex", "where the surface touched itself")
    if counts["pieces"]:
        inside = sum(_is_inside(point, vertices, faces) for point in account.dropped_points[:_PLACED])
        where = f", {inside:,} of them inside the body (a cavity, or a part shut in)" if inside else ""
        share = f"with {100 * account.dropped_share:.2g} % of the area"
        notes.append(f"dropped {_count(counts['pieces'], 'smaller piece')} {share}{where}")
    tell("turned", "turned", "face", "wound against the neighbours")
    if counts["inside out"]:
        notes.append("turned the whole surface, which was inside out")
    if account.holes:
        largest, total = 100 * max(account.holes), 100 * sum(account.holes)
        share = f"{largest:.2g} % of the surface" if len(account.holes) == 1 else (
            f"the largest {largest:.2g} % of the surface, all together {total:.2g} %"
        )  # fmt: skip
        notes.append(f"filled {_count(len(account.holes), 'hole')}, {share}")
    tell("removed", "crossing", "face", "where the surface crossed or touched itself, and filled the gaps")
    return tuple(notes)


def _count(number: int, what: str) -> str:
    plural = what if number == 1 else {"vertex": "vertices"}.get(what, f"{what}s")
    return f"{number:,} {plural}"


def _is_inside(point: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether a point lies within a closed surface, by its solid angle (van Oosterom and Strackee 1983)."""
    # Half the angle: 2 pi within, pi on the surface, 0 outside.
    a, b, c = (vertices[faces[:, i]] - point for i in range(3))
    la, lb, lc = (np.sqrt((side**2).sum(axis=1)) for side in (a, b, c))
    above = (a * np.cross(b, c)).sum(axis=1)
    below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return bool(np.arctan2(above, below).sum() > 1.5 * np.pi)
