"""What a settled packing is: how dense, how its stones touch, where each lies."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lithoform.dem import Model, State
from lithoform.dem.container import extents
from lithoform.dem.materials import pair_constants
from lithoform.dem.observers import coordination, density_profile
from lithoform.packing.container import Container

__all__ = ["Packing", "blocks_csv", "deepest_overlap", "measure_packing"]

_UP = np.array([0.0, 0.0, 1.0])
# The inner part ends at this share of the height, and counts if it is at least this many median diameters thick.
_TOP, _LEAST = 0.8, 0.5
_COLUMNS = ("number", "stone", "scale", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "mesh_centre_x_m",
            "mesh_centre_y_m", "mesh_centre_z_m", "volume_m3", "mass_kg", "contacts")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Packing:
    """Numbers of a packing.

    Attributes
    ----------
    packing_density : float
        Volume of the stones, that of their true meshes, over that of the container, between the heights of `band`, at
        which stones are cut exactly.
    band : tuple of float
        From one median diameter above the floor to 0.8 of the height (the rim, where that is lower) [m]; of a bed too
        thin for that, from the floor to its height.
    total_density : float
        The same from the floor to the height.
    height : float
        Of the bed [m]: twice the height of the centre of mass, that of the even bed of the same mass and moment.
    coordination : dict of str to float
        As `lithoform.dem.observers.coordination` gives it.
    fits : int
        Stones that are wholly below the rim.
    deepest : float
        Largest overlap of two stones, of a stone and a wall, over the effective radius.
    edges, profile : numpy.ndarray
        Heights of layers [m], shape (k + 1,), and the packing density of each, shape (k,).
    """

    packing_density: float
    band: tuple[float, float]
    total_density: float
    height: float
    coordination: dict[str, float]
    fits: int
    deepest: float
    edges: np.ndarray
    profile: np.ndarray


def measure_packing(model: Model, state: State, container: Container) -> Packing:
    """Measure a packing.

    Parameters
    ----------
    model : Model
    state : State
    container : Container
        With the walls of the model.
    """
    diameter = 2.0 * float(np.median(model.radius))
    height = 2.0 * float((model.volume * state.position[:, 2]).sum() / model.volume.sum())
    low, high = diameter, min(_TOP * height, container.height)
    if high - low < _LEAST * diameter:
        low, high = 0.0, height
    top = extents(model, state, _UP)[:, 1]
    layers = max(1, math.ceil(float(top.max()) / diameter))
    edges = diameter * np.arange(layers + 1)
    # One call for all heights: each cuts the stones that it meets.
    wanted = np.unique(np.concatenate([edges, [low, high, height]]))
    density = density_profile(model, state, wanted, container.enclosure)
    solid = np.concatenate([[0.0], np.cumsum(density * np.diff(wanted))])  # volume below each height over the area

    def between(a: float, b: float) -> float:
        at = np.searchsorted(wanted, (a, b))
        return float((solid[at[1]] - solid[at[0]]) / (b - a))

    return Packing(
        packing_density=between(low, high),
        band=(low, high),
        total_density=between(0.0, height),
        height=height,
        coordination=coordination(model, state),
        fits=int((top <= container.height).sum()),
        deepest=deepest_overlap(model, state),
        edges=edges,
        profile=np.array([between(a, b) for a, b in itertools.pairwise(edges)]),
    )


def deepest_overlap(model: Model, state: State) -> float:
    """Largest overlap over effective radius, from the contact radii (eq. 31): a^2 / r - sqrt(4 pi gamma a / E*)."""
    material = model.materials[0]
    law = pair_constants(material, material)
    on = state.contact_radius > 0.0
    i, j = state.pair[on].T
    radius = np.concatenate([
        model.radius[i] * model.radius[j] / (model.radius[i] + model.radius[j]),
        np.repeat(model.radius, len(model.walls))[state.wall_contact_radius > 0.0],
    ])  # fmt: skip
    disc = np.concatenate([state.contact_radius[on], state.wall_contact_radius[state.wall_contact_radius > 0.0]])
    overlap = disc**2 / radius - np.sqrt(4.0 * math.pi * law["energy"] * disc / law["modulus"])
    return float((overlap / radius).max(initial=0.0))


def blocks_csv(model: Model, state: State, names: Sequence[str]) -> bytes:
    """Table of the stones: a point p of the mesh of a stone lies at R scale (p - mesh_centre) + (x, y, z).

    Parameters
    ----------
    model : Model
    state : State
    names : sequence of str
        Of the shapes: files, or particles of a database.

    Returns
    -------
    bytes
        Columns: number from 1, stone, scale, centre of mass in the world [m], quaternion (x, y, z, w) of R, centre of
        mass in the frame of the mesh [m], volume [m^3], mass [kg], contacts with stones and walls.
    """
    from scipy.spatial.transform import Rotation

    from lithoform.dem.observers import contact_counts

    of_shapes = Rotation.from_matrix(np.array([shape.rotation for shape in model.shapes]))
    turn = (Rotation.from_quat(state.orientation) * of_shapes[model.shape].inv()).as_quat(canonical=True)
    centre = np.array([shape.centroid for shape in model.shapes])[model.shape]
    counts = contact_counts(model, state).sum(axis=1)
    numbers = np.concatenate(
        [model.scale[:, None], state.position, turn, centre, model.volume[:, None], model.mass[:, None]], axis=1
    )
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for i, row in enumerate(numbers.tolist()):
        writer.writerow([i + 1, names[model.shape[i]], *row, int(counts[i])])
    # Names of files may hold bytes that are no text in any coding.
    return out.getvalue().encode(errors="backslashreplace")
