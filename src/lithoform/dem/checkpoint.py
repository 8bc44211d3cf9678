"""Checkpoints: a state in one file, whole or not at all, from which a run goes on to the last bit.

A file is a magic number, the version of the format (uint32), the number of bytes of header and arrays (uint64), SHA-256
of everything else (32 bytes), the length of the header (uint32), the header (JSON) and the arrays of
`lithoform.dem.state.FIELDS` one after another.  All numbers are little-endian; nothing is executed on reading.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import struct
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from lithoform.atomic import atomic_path
from lithoform.dem.model import Model
from lithoform.dem.state import FIELDS, State
from lithoform.dem.walls import Cylinder
from lithoform.errors import FileFormatError, SceneError

__all__ = ["read_checkpoint", "write_checkpoint"]

# The first byte and the line ends show a file that was sent as text; from then on every format begins like this.
_MAGIC: Final = b"\x89LFDEM\r\n"
_VERSION: Final = 1
_START: Final = struct.Struct("<8sIQ32sI")


def write_checkpoint(path: str | os.PathLike[str], model: Model, state: State) -> Path:
    """Write a state; the same state gives the same bytes.

    Parameters
    ----------
    path : path-like
        A file of that name is replaced in a single step.
    model : Model
        Of which only a fingerprint is written.
    state : State

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    SceneError
        If the state is not one of the model.
    OutputError
        If the file cannot be written; the former one is then as it was.
    """
    sizes = {"blocks": len(state.position), "walls": len(state.wall_point), "pairs": len(state.pair)}
    state.require_model(model)
    header = {
        "lithoform": _lithoform(),
        "model": _identity(model),
        **sizes,
        "fields": _fields(),
        "step": state.step,
        "clock": list(state.clock),
        "lag": state.lag,
        "fresh": state.fresh,
    }
    text = json.dumps(header, sort_keys=True, allow_nan=False).encode()
    content = [text, *(np.asarray(array, dtype=_kind(name)).tobytes() for name, array in state.arrays().items())]
    length = sum(map(len, content))
    digest = _digest(length, len(text), content)
    with atomic_path(path) as partial, partial.open("wb") as file:
        file.write(_START.pack(_MAGIC, _VERSION, length, digest, len(text)))
        file.writelines(content)
    return Path(path)


def read_checkpoint(path: str | os.PathLike[str], model: Model) -> State:
    """State of a checkpoint.

    Parameters
    ----------
    path : path-like
    model : Model
        With the same shapes, blocks, materials and walls as when it was written.  The motion of the walls, gravity and
        the local damping may be others: that is how a protocol goes on in stages.

    Returns
    -------
    State
        A run from here gives the same bits as one that was never interrupted, on the same device.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is no checkpoint, is cut short or altered, or has a newer format.
    SceneError
        If it is a checkpoint of another model.
    """
    try:
        with Path(path).open("rb") as file:
            header, content = _verified(path, file)
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}.") from error
    try:
        different = _differences(header, model)
        state = None if different else _state_of(header, content, model)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise FileFormatError(
            f"{path} is not a checkpoint that this version reads ({error}); go on from another one."
        ) from error
    if state is None:
        raise SceneError(
            f"{path} is a checkpoint of another model: its {different} are not those of this one; build the model as "
            f"it was (with lithoform {header.get('lithoform')}), or start anew."
        )
    return state


def _verified(path: str | os.PathLike[str], file: BinaryIO) -> tuple[dict[str, Any], memoryview]:
    """Header and arrays of a file whose hash is right."""
    size = os.fstat(file.fileno()).st_size
    start = file.read(_START.size)
    if not start.startswith(_MAGIC):
        # A file that was cut within its first bytes looks the same as an empty one.
        raise FileFormatError(f"{path} is not a checkpoint of lithoform: expected a file that write_checkpoint made.")
    if len(start) < _START.size:
        raise _cut(path, size)
    _, form, length, digest, text_length = _START.unpack(start)
    if form > _VERSION:
        raise FileFormatError(f"{path} has format {form} of checkpoints, and this version of lithoform reads up to "
                              f"{_VERSION}: read it with a newer lithoform.")  # fmt: skip
    if size < _START.size + length:
        raise _cut(path, size, _START.size + length)
    # No more is read than the file has, whatever its numbers say.
    content = memoryview(file.read(min(length, size)))
    if (
        form < 1
        or size > _START.size + length
        or text_length > length
        or digest != _digest(length, text_length, [content])
    ):
        raise FileFormatError(f"{path} is damaged: its content does not have the hash that it was written with; go on "
                              "from another checkpoint.")  # fmt: skip
    try:
        header = json.loads(bytes(content[:text_length]))
    except ValueError as error:
        raise FileFormatError(f"{path} is not a checkpoint that this version reads: its header is no JSON.") from error
    if not isinstance(header, dict):
        raise FileFormatError(f"{path} is not a checkpoint that this version reads: its header is no table.")
    return header, content[text_length:]


def _cut(path: str | os.PathLike[str], size: int, expected: int | None = None) -> FileFormatError:
    of = "" if expected is None else f" of {expected}"
    return FileFormatError(f"{path} is cut short: it has {size}{of} bytes; go on from another checkpoint.")


def _digest(length: int, text_length: int, content: list[bytes] | list[memoryview]) -> bytes:
    digest = hashlib.sha256(_START.pack(_MAGIC, _VERSION, length, b"", text_length))
    for part in content:
        digest.update(part)
    return digest.digest()


def _identity(model: Model) -> dict[str, Any]:
    """What must be the same when the run goes on, and cannot be changed meanwhile."""
    walls = [
        {
            "kind": type(wall).__name__,
            "material": wall.material,
            "point": list(wall.point),
            "direction": list(wall.direction),
            **({"radius": wall.radius} if isinstance(wall, Cylinder) else {}),
        }
        for wall in model.walls
    ]
    pairs = sorted((a, b, repr(constants)) for (a, b), constants in model.pairs.items())
    return {"blocks": model.fingerprint, "walls": walls, "pairs": [list(pair) for pair in pairs]}


def _differences(header: dict[str, Any], model: Model) -> str:
    """What a checkpoint has that the model has not, in words; nothing where they agree."""
    written, expected = header["model"], _identity(model)
    words = {"blocks": "shapes, blocks or materials", "walls": "walls", "pairs": "pairs of materials"}
    return next((said for name, said in words.items() if written[name] != expected[name]), "")


def _state_of(header: dict[str, Any], content: memoryview, model: Model) -> State:
    n, k, p = (header[name] for name in ("blocks", "walls", "pairs"))
    if (n, k) != (model.count, len(model.walls)) or type(p) is not int or p < 0:
        raise ValueError("its numbers of blocks, walls and pairs are not those of the model")
    if header["fields"] != _fields():
        raise ValueError("its arrays are not those of this version")
    sizes = {"n": n, "k": k, "p": p, "nk": n * k}
    shapes = {
        name: tuple(sizes[d] if isinstance(d, str) else d for d in dimensions)
        for name, (_, dimensions) in FIELDS.items()
    }
    if sum(math.prod(shapes[name]) * _kind(name).itemsize for name in FIELDS) != len(content):
        raise ValueError("its arrays do not have the sizes that its header says")
    arrays, at = {}, 0
    for name, shape in shapes.items():
        count = math.prod(shape)
        arrays[name] = np.frombuffer(content, _kind(name), count, at).reshape(shape).astype(FIELDS[name][0])
        at += count * _kind(name).itemsize
    begin, begin_step, dt = header["clock"]
    whole = all(type(step) is int and step >= 0 for step in (header["step"], begin_step))
    if not (whole and type(header["fresh"]) is bool):
        raise ValueError("its clock makes no sense")
    try:
        state = State(
            step=header["step"],
            clock=(float(begin), begin_step, float(dt)),
            lag=float(header["lag"]),
            fresh=header["fresh"],
            blocks=model.block_fingerprint,
            **arrays,
        )
        state.require_model(model)
    except SceneError as error:
        raise ValueError(str(error)) from error
    return state


def _fields() -> list[list[object]]:
    """Names, types and dimensions of the arrays, as in the header."""
    return [[name, kind, *dimensions] for name, (kind, dimensions) in FIELDS.items()]


def _kind(name: str) -> np.dtype[Any]:
    """Little-endian type of an array in the file."""
    return np.dtype(f"<{FIELDS[name][0]}")


def _lithoform() -> str:
    try:
        return version("lithoform")
    except PackageNotFoundError:  # a source tree that is not installed
        return "unknown"
