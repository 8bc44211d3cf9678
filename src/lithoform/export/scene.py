"""What is exported: blocks where they are, between walls where they are; read from a packing or a compaction."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from lithoform.dem import TABLE_10, Cylinder, Material, Model, Motion, Plane, State, read_checkpoint
from lithoform.dem.materials import pair_constants
from lithoform.dem.scales import scales
from lithoform.errors import FileFormatError, LithoformError, RecipeError, SceneError
from lithoform.lazy import cached_property

__all__ = ["Contact", "Scene", "read_scene"]

_PACKING, _COMPACTION = "packing.json", "compaction.json"
# The checkpoint of the end of each kind of result.
_CHECKPOINTS: Final = {_PACKING: "packing.checkpoint", _COMPACTION: "gyration.checkpoint"}
# Before the header of a checkpoint: see `lithoform.dem.checkpoint`.
_START: Final = struct.Struct("<8sIQ32sI")


@dataclass(frozen=True)
class Contact:
    """Constants of the contact of two materials, as other engines take them.

    Attributes
    ----------
    youngs_modulus, poisson_ratio : float
        Of both bodies alike [Pa]: with them Hertz's and Mindlin's moduli are those of the pair.
    restitution, sliding, rolling : float
        Coefficients.
    energy : float
        Surface energy [J/m^2], half of the work of adhesion.
    modulus, shear : float
        Of the pair: E* (eq. 36) and G* (eq. 41) [Pa].
    """

    youngs_modulus: float
    poisson_ratio: float
    restitution: float
    sliding: float
    rolling: float
    energy: float
    modulus: float
    shear: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Blocks and walls as they stand.

    Attributes
    ----------
    model : Model
    state : State
    names : tuple of str
        Of the shapes, for the tables; by default their numbers.
    source : str
        Where it comes from, for the head of a deck.
    """

    model: Model
    state: State
    names: Sequence[str] = ()
    source: str = ""

    def __post_init__(self) -> None:
        self.state.require_model(self.model)
        names = tuple(self.names) or tuple(f"shape {k + 1}" for k in range(len(self.model.shapes)))
        if len(names) != len(self.model.shapes):
            raise SceneError(f"expected a name for each of {len(self.model.shapes)} shapes, got {len(names)}.")
        object.__setattr__(self, "names", names)

    @cached_property
    def rotations(self) -> np.ndarray:
        """From the frames of the shapes to the world's, shape (n, 3, 3)."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_quat(self.state.orientation).as_matrix()

    @cached_property
    def inertia(self) -> np.ndarray:
        """Tensors about the centres of mass in the axes of the world [kg m^2], shape (n, 3, 3)."""
        return np.einsum("nij,nj,nkj->nik", self.rotations, self.model.inertia, self.rotations)

    @cached_property
    def walls(self) -> tuple[Plane | Cylinder, ...]:
        """The walls where they are now, at rest."""
        placed: list[Plane | Cylinder] = []
        for k, wall in enumerate(self.model.walls):
            point, direction = self.state.wall_point[k], self.state.wall_direction[k]
            if isinstance(wall, Cylinder):
                placed.append(replace(wall, point=tuple(point), axis=tuple(direction), motion=Motion()))  # pyright: ignore[reportArgumentType]
            else:
                placed.append(replace(wall, point=tuple(point), normal=tuple(direction), motion=Motion()))  # pyright: ignore[reportArgumentType]
        return tuple(placed)

    @cached_property
    def fall(self) -> float:
        """Energy of a fall of all blocks by a median diameter [J]; in a case without gravity, at 1 mm/s^2."""
        pull = max(float(np.linalg.norm(self.model.gravity)), 1e-3)
        return float(self.model.mass.sum()) * pull * 2.0 * float(np.median(self.model.radius))

    @cached_property
    def step(self) -> float:
        """Time step [s]: 0.06 of the Rayleigh time of the smallest block."""
        return scales(self.model).step

    @property
    def title(self) -> str:
        """Where it comes from, as a comment in a script may hold it."""
        return ascii(self.source)[1:-1].replace('"', "'") or "a scene"

    @property
    def room(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box about all blocks and the walls near them [m]."""
        low, high = self.bounds
        middle = 0.5 * (low + high)
        for wall in self.walls:
            direction, point = np.array(wall.direction), np.array(wall.point)
            if isinstance(wall, Cylinder):
                reach = wall.radius * np.sqrt(np.maximum(1.0 - direction**2, 0.0))
                for corner in (low, high):
                    foot = point + ((corner - point) @ direction) * direction
                    low, high = np.minimum(low, foot - reach), np.maximum(high, foot + reach)
            else:
                foot = middle - ((middle - point) @ direction) * direction
                low, high = np.minimum(low, foot), np.maximum(high, foot)
        return low, high

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box about the balls about all blocks [m]."""
        reach = self.model.bounding_radius[:, None]
        return (self.state.position - reach).min(axis=0), (self.state.position + reach).max(axis=0)

    def contact(self, a: int, b: int) -> Contact:
        """Constants of the contact of two materials, by their numbers."""
        first, second = self.model.materials[a], self.model.materials[b]
        given = self.model.pairs.get((a, b), self.model.pairs.get((b, a)))
        law = pair_constants(first, second, given)
        # Two bodies of this ratio, and of the modulus below, have both G* and E* of the pair: with r their quotient,
        # r = (1 - nu) / (2 (2 - nu)).
        r = law["shear"] / law["modulus"]
        poisson = (1.0 - 4.0 * r) / (1.0 - 2.0 * r)
        restitution = getattr(given, "restitution", None)
        if restitution is None:
            restitution = (first.restitution * second.restitution) ** 0.5
        return Contact(
            youngs_modulus=2.0 * (1.0 - poisson**2) * law["modulus"],
            poisson_ratio=poisson,
            restitution=restitution,
            sliding=law["sliding"],
            rolling=law["rolling"],
            energy=law["energy"],
            modulus=law["modulus"],
            shear=law["shear"],
        )


def read_scene(
    folder: str | os.PathLike[str],
    *,
    stones: Sequence[str | os.PathLike[str]] = (),
    device: str = "auto",
    threads: int | None = None,
    progress: bool = False,
) -> Scene:
    """Scene of a folder that `lithoform pack` or `lithoform compact` has finished.

    The stones are made anew from where they came from, and the checkpoint says whether they are the same.

    Parameters
    ----------
    folder : path-like
    stones : sequence of path-like
        Where the database or the meshes are; by default where they were, seen from here or from the folder.
    device : str
        auto, cpu or cuda: what makes stones from recipes.
    threads : int, optional
        For the shapes; by default all processors.
    progress : bool
        Whether to show a bar.

    Raises
    ------
    RecipeError
        If the number of threads is below 1.
    FileFormatError
        If the folder holds neither, or one that is not finished, or a damaged one.
    SceneError
        If the stones are no longer those that the checkpoint is of.
    """
    folder = Path(folder)
    if threads is not None and threads < 1:
        raise RecipeError(f"expected --threads of at least 1, got {threads}.")
    kind = next((name for name in _CHECKPOINTS if (folder / name).is_file()), None)
    if kind is None:
        raise FileFormatError(f"expected the folder of a packing or a compaction, but {folder} holds no {_PACKING} and "
                              f"no {_COMPACTION}: make one with lithoform pack or lithoform compact.")  # fmt: skip
    settings = _settings(folder / kind)
    checkpoint = folder / _CHECKPOINTS[kind]
    walls = _walls(checkpoint)
    name, build = ("sources", _packed) if kind == _PACKING else ("population", _compacted)
    try:
        told = settings[name] if isinstance(settings[name], list) else [settings[name]]
        places = list(map(Path, stones)) or [_found(Path(place), folder) for place in told]
        settings[name] = tuple(places) if name == "sources" else places[0]
        model, names = build(settings, device, threads, progress)
    except (KeyError, TypeError) as error:  # settings of another version
        raise FileFormatError(f"{folder / kind} has settings that this version does not know: {error}.") from error
    except LithoformError as error:
        raise type(error)(f"the stones of {folder} cannot be made anew: {error}") from error
    model = model.with_walls(*walls)
    return Scene(model=model, state=read_checkpoint(checkpoint, model), names=names, source=str(folder))


def _found(place: Path, folder: Path) -> Path:
    """Where stones are that were at a place, seen from the folder in which the result was made: that is not known."""
    seen = [place, *(above / place for above in folder.resolve().parents)]
    found = next((path for path in seen if path.exists()), None)
    if found is None:
        raise FileFormatError(
            f"the stones of {folder} were at {place}, which is there neither seen from {Path.cwd()} nor from a folder "
            "above it: say where they are with --stones."
        )
    return found


def _settings(path: Path) -> dict[str, Any]:
    try:
        told = json.loads(path.read_bytes())
        settings, finished = dict(told["settings"]), told["finished"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"{path} is damaged: make the result anew with --overwrite.") from error
    if finished is not True:
        raise FileFormatError(f"{path.parent} is not finished: go on with it first, with --resume.")
    settings.pop("lithoform", None)
    return settings


def _packed(
    settings: dict[str, Any], device: str, threads: int | None, progress: bool
) -> tuple[Model, tuple[str, ...]]:
    from lithoform.packing.request import Request
    from lithoform.packing.stones import draw, find_stones, read_shapes

    request = Request(**settings)
    rng = np.random.Generator(np.random.PCG64(request.seed))
    stones = find_stones(request.sources, unit=request.unit, select=request.select)
    chosen, which = np.unique(draw(len(stones), request.count, rng), return_inverse=True)
    used = [stones[k] for k in chosen.tolist()]
    shapes = tuple(shape for shape, _ in read_shapes(used, threads=threads, progress=progress))
    model = Model(shapes=shapes, materials=(_softened(request.stiffness_factor),), shape=which,
                  gravity=(0.0, 0.0, -request.gravity))  # fmt: skip
    return model, tuple(stone.name for stone in used)


def _compacted(
    settings: dict[str, Any], device: str, threads: int | None, progress: bool
) -> tuple[Model, tuple[str, ...]]:
    from lithoform.compaction.request import Request
    from lithoform.compaction.specimen import Plan, make_specimen
    from lithoform.database.store import Store
    from lithoform.gradation.curves import find_gradation

    request = Request(**settings)
    known = {field.name for field in fields(Plan)} - {"gradation"}
    plan = Plan(gradation=find_gradation(request.gradation), **{name: getattr(request, name) for name in known})
    specimen = make_specimen(Store(request.population), plan, request.protocol, device=device, threads=threads,
                             progress=progress)  # fmt: skip
    return specimen.model, specimen.names


def _softened(factor: float) -> Material:
    return TABLE_10.softened(factor)


def _walls(checkpoint: Path) -> list[Plane | Cylinder]:
    """Walls of the model that a checkpoint is of, at rest: the protocol has put some of them there on the way."""
    try:
        with checkpoint.open("rb") as file:
            length = _START.unpack(file.read(_START.size))[4]
            header = json.loads(file.read(min(length, checkpoint.stat().st_size)))
        return [
            Cylinder(point=wall["point"], axis=wall["direction"], radius=wall["radius"], material=wall["material"])
            if wall["kind"] == "Cylinder"
            else Plane(point=wall["point"], normal=wall["direction"], material=wall["material"])
            for wall in header["model"]["walls"]
        ]
    except OSError as error:
        raise FileFormatError(f"{checkpoint} cannot be read: {(error.strerror or str(error)).lower()}.") from error
    except (struct.error, ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"{checkpoint} is damaged or no checkpoint: make the result anew.") from error
