"""What is measured on a state while a simulation runs: energies, packing density, contacts, forces.

An observer of `lithoform.dem.simulate` takes the model and the state and gives numbers by name.  Beside each one here
is a function that gives the whole data.  Contacts and forces are those of the last evaluation, one step back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from lithoform.dem.clearances import shared_depths
from lithoform.dem.container import Container, solid_below
from lithoform.dem.energy import energy
from lithoform.dem.model import Model
from lithoform.dem.state import State
from lithoform.dem.walls import Cylinder
from lithoform.errors import SceneError

__all__ = [
    "Contacts",
    "PackingDensity",
    "contact_counts",
    "contacts",
    "coordination",
    "density_profile",
    "energies",
    "fabric",
    "fabric_tensor",
    "force_chains",
    "packing_density",
    "unit_of",
    "wall_forces",
    "wall_pushes",
]


def energies(model: Model, state: State) -> dict[str, float]:
    """Observer: energies [J] of `lithoform.dem.energy`, and the work that the walls have done."""
    now = energy(model, state)
    return {
        "kinetic": now.kinetic,
        "potential": now.potential,
        "elastic": now.elastic,
        "total": now.total,
        "work": now.work,
    }


def packing_density(model: Model, state: State, low: float, high: float, container: Container) -> float:
    """Volume of the true meshes between two heights over the volume of the container between them.

    The meshes are cut exactly; that they are inside the sides of the container is taken for granted.

    Parameters
    ----------
    model : Model
    state : State
    low, high : float
        Heights along the axis of the container, from the origin of the world [m].
    container : Container

    Raises
    ------
    SceneError
        If the heights are not in order, or the container has no such walls.
    """
    return float(density_profile(model, state, [low, high], container)[0])


def density_profile(model: Model, state: State, edges: ArrayLike, container: Container) -> np.ndarray:
    """Packing density of the layers between heights, shape (len(edges) - 1,).

    Parameters
    ----------
    model : Model
    state : State
    edges : array_like
        Ascending heights along the axis of the container, from the origin of the world [m].
    container : Container

    Raises
    ------
    SceneError
        As `packing_density`.
    """
    heights = np.array(edges, dtype=np.float64)
    if heights.ndim != 1 or len(heights) < 2 or not (np.isfinite(heights).all() and (np.diff(heights) > 0.0).all()):
        raise SceneError(f"expected at least two ascending, finite heights of the layers, got {edges!r}.")
    axis = container.axis(model, state)
    below = np.array([solid_below(model, state, height, axis).sum() for height in heights])
    return np.diff(below) / (container.area(model, state) * np.diff(heights))


@dataclass(frozen=True, kw_only=True)
class PackingDensity:
    """Observer: packing density in a container.

    Without heights it is the volume of all blocks over the volume of the container between its ends, where they are
    now; with heights it is `packing_density` between them.

    Attributes
    ----------
    container : Container
    low, high : float or None
        [m].
    """

    container: Container
    low: float | None = None
    high: float | None = None
    units: ClassVar[Mapping[str, str]] = {"": "1"}

    def __post_init__(self) -> None:
        if (self.low is None) != (self.high is None):
            raise SceneError("expected both heights of the layer or none, got one of them.")

    def __call__(self, model: Model, state: State) -> dict[str, float]:
        """Packing density."""
        if self.low is not None and self.high is not None:
            return {"": packing_density(model, state, self.low, self.high, self.container)}
        return {"": float(model.volume.sum()) / self.container.volume(model, state)}


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of a state, m of them: first those between blocks, then those with walls.

    Attributes
    ----------
    first, second : numpy.ndarray of int, shape (m,)
        Blocks; with a wall, `second` is the number of the wall.
    is_wall : numpy.ndarray of bool, shape (m,)
    normal : numpy.ndarray, shape (m, 3)
        Unit vector from the first block to the second block, or to the wall.
    force : numpy.ndarray, shape (m, 3)
        On the first block [N].
    end : numpy.ndarray, shape (m, 3)
        Centre of the second block, or the point of the first block that is deepest in the wall [m].
    """

    first: np.ndarray
    second: np.ndarray
    is_wall: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    end: np.ndarray

    @property
    def normal_force(self) -> np.ndarray:
        """Damping included [N], positive where the bodies push, negative where they pull, shape (m,)."""
        return -(self.force * self.normal).sum(axis=1)

    @property
    def tangential_force(self) -> np.ndarray:
        """[N], shape (m,)."""
        return np.linalg.norm(self.force + self.normal_force[:, None] * self.normal, axis=1)


def contacts(model: Model, state: State, *, walls: bool = True) -> Contacts:
    """All contacts of a state.

    Parameters
    ----------
    model : Model
    state : State
    walls : bool
        Whether those with walls too.
    """
    on = state.contact_radius > 0.0
    i, j = state.pair[on].T
    at = np.flatnonzero(state.wall_contact_radius > 0.0) if walls else np.zeros(0, np.int64)
    block, wall = at // max(len(model.walls), 1), at % max(len(model.walls), 1)
    toward, place = _on_walls(model, state, block, wall)
    return Contacts(
        np.concatenate([i, block]),
        np.concatenate([j, wall]),
        np.arange(len(i) + len(at)) >= len(i),
        np.concatenate([state.normal[on], toward]),
        np.concatenate([state.contact_force[on], state.wall_contact_force[at]]),
        np.concatenate([state.position[j], place]),
    )


def contact_counts(model: Model, state: State) -> np.ndarray:
    """Contacts of each block with other blocks and with walls, shape (n, 2)."""
    n = model.count
    of_blocks = np.bincount(state.pair[state.contact_radius > 0.0].ravel(), minlength=n)
    of_walls = (state.wall_contact_radius.reshape(n, len(model.walls)) > 0.0).sum(axis=1)
    return np.stack([of_blocks, of_walls], axis=1)


def coordination(model: Model, state: State) -> dict[str, float]:
    """Observer: mean number of contacts of a block.

    A rattler has less than two contacts, those with walls counted; means without rattlers are over the other blocks
    (Thornton 2000, Geotechnique 50:43, where there are no walls).

    Returns
    -------
    dict of str to float
        mean, without_rattlers : contacts with other blocks; with_walls, with_walls_without_rattlers : with walls too;
        rattlers : share of the blocks.  Means over no block are NaN.
    """
    counts = contact_counts(model, state)
    both = counts.sum(axis=1)
    held = both >= 2
    return {
        "mean": _mean(counts[:, 0]),
        "without_rattlers": _mean(counts[held, 0]),
        "with_walls": _mean(both),
        "with_walls_without_rattlers": _mean(both[held]),
        "rattlers": float((~held).mean()),
    }


def fabric_tensor(model: Model, state: State, *, walls: bool = False) -> np.ndarray:
    """Mean of n n^T over the normals of the contacts (Satake 1982), shape (3, 3), of trace 1; NaN without contacts.

    Parameters
    ----------
    model : Model
    state : State
    walls : bool
        Whether contacts with walls count.
    """
    normal = contacts(model, state, walls=walls).normal
    if not len(normal):
        return np.full((3, 3), np.nan)
    return (normal[:, :, None] * normal[:, None, :]).sum(axis=0) / len(normal)


def fabric(model: Model, state: State) -> dict[str, float]:
    """Observer: principal values of the fabric tensor of the contacts between blocks, and its deviator.

    Returns
    -------
    dict of str to float
        major, intermediate, minor : principal values, 1/3 each where no direction is preferred; deviator :
        sqrt(((F1 - F2)^2 + (F2 - F3)^2 + (F3 - F1)^2) / 2), from 0 to 1 where all normals are parallel.
    """
    tensor = fabric_tensor(model, state)
    if np.isnan(tensor).any():
        return dict.fromkeys(("major", "intermediate", "minor", "deviator"), math.nan)
    minor, middle, major = np.linalg.eigvalsh(tensor).tolist()
    deviator = math.sqrt(0.5 * ((major - middle) ** 2 + (middle - minor) ** 2 + (minor - major) ** 2))
    return {"major": major, "intermediate": middle, "minor": minor, "deviator": deviator}


def force_chains(model: Model, state: State) -> dict[str, float]:
    """Observer: normal forces of the contacts between blocks that push.

    Returns
    -------
    dict of str to float
        contacts : their number; mean_force, quadratic_mean_force, largest_force [N], NaN without contacts;
        share_above_mean : of them, carry more than the mean, which are the strong chains (Radjai et al. 1998,
        Phys. Rev. Lett. 80:61); pulling : number of the contacts that adhesion or damping makes pull, left out above.
    """
    force = contacts(model, state, walls=False).normal_force
    push = force[force > 0.0]
    mean = _mean(push)
    return {
        "contacts": float(len(push)),
        "mean_force": mean,
        "quadratic_mean_force": math.sqrt(_mean(push**2)),
        "largest_force": float(push.max()) if len(push) else math.nan,
        "share_above_mean": _mean(push > mean),
        "pulling": float((force < 0.0).sum()),
    }


def wall_pushes(model: Model, state: State) -> np.ndarray:
    """Sum of the normal forces of the blocks on each wall [N], shape (k,): of a cylinder, its lateral thrust."""
    every = contacts(model, state)
    on = every.is_wall
    return np.bincount(every.second[on], weights=every.normal_force[on], minlength=len(model.walls))


def wall_forces(model: Model, state: State) -> dict[str, float]:
    """Observer: of each wall w, the force of the blocks on it in the world's frame, and the sum of the normal forces.

    Returns
    -------
    dict of str to float
        w_x, w_y, w_z, w_push [N].
    """
    pushes = wall_pushes(model, state)
    return {
        f"{wall}_{name}": float(value)
        for wall in range(len(model.walls))
        for name, value in zip(("x", "y", "z", "push"), (*state.wall_force[wall], pushes[wall]), strict=True)
    }


# Units of the numbers that the observers give; "" stands for all others of an observer.
_UNITS: Final[Mapping[Callable[..., object], Mapping[str, str]]] = {
    energies: {"": "J"},
    coordination: {"": "1"},
    fabric: {"": "1"},
    force_chains: {"": "1", "mean_force": "N", "quadratic_mean_force": "N", "largest_force": "N"},
    wall_forces: {"": "N"},
}


def unit_of(column: str, observers: Mapping[str, Callable[..., object]]) -> str | None:
    """Unit of a column that one of the observers gave; None where it is not known.

    Parameters
    ----------
    column : str
    observers : mapping of str to callable
        An observer of one's own tells its units by an attribute `units`, a mapping of its names to units in which ""
        stands for all others.
    """
    # The longest name, so that "wall_force" is not taken for the "force" of "wall".
    names = sorted((name for name in observers if column == name or column.startswith(f"{name}_")), key=len)
    if not names:
        return None
    observer = observers[names[-1]]
    ours = next((units for function, units in _UNITS.items() if function is observer), {})
    known: Mapping[str, str] = getattr(observer, "units", ours)
    return known.get(column.removeprefix(names[-1]).removeprefix("_"), known.get(""))


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan


def _on_walls(model: Model, state: State, block: np.ndarray, wall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals of contacts towards the walls, and their places [m], both of shape (m, 3)."""
    toward, place = np.zeros((len(block), 3)), np.zeros((len(block), 3))
    shared = shared_depths(model, state.clock[2])
    # Where the blocks were when the forces were evaluated: in a step the deepest point may jump to another vertex.
    position = state.position - state.velocity * (2.0 * state.lag)
    orientation = _turned_back(state.orientation, state.spin * state.lag)
    # All turns at once; the vertices of each block then in its own frame.
    turns = _matrices(orientation[block])
    points = np.einsum("cji,cj->ci", turns, state.wall_point[wall] - position[block])
    directions = np.einsum("cji,cj->ci", turns, state.wall_direction[wall])
    for c, (i, w) in enumerate(zip(block.tolist(), wall.tolist(), strict=True)):
        point, direction = points[c], directions[c]
        vertices = model.shapes[model.shape[i]].core.vertices * model.scale[i]
        from_point = vertices - point
        height = from_point @ direction
        made = model.walls[w]
        if isinstance(made, Cylinder):
            off = from_point - height[:, None] * direction
            height = made.radius - np.sqrt((off**2).sum(axis=1))
        weights = np.exp((height.min() - height) / shared[i, w])
        arm = weights @ vertices / weights.sum()
        outward = -direction
        if isinstance(made, Cylinder):
            outward = arm - point - ((arm - point) @ direction) * direction
            outward = outward / math.sqrt(outward @ outward)
        toward[c], place[c] = outward, arm + model.margin[i] * outward
    return np.einsum("cij,cj->ci", turns, toward), np.einsum("cij,cj->ci", turns, place) + position[block]


def _matrices(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions (x, y, z, w), shape (n, 3, 3)."""
    x, y, z, w = quaternion.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _turned_back(quaternion: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Quaternions before the step that multiplied them by (half, 1) and made them unit, both of n rows."""
    x, w = quaternion[:, :3], quaternion[:, 3:]
    before = np.hstack([x - w * half - np.cross(half, x), w + (half * x).sum(axis=1, keepdims=True)])
    return before / np.linalg.norm(before, axis=1, keepdims=True)
