"""Reading of PLY polygons: elements in any order, scalar and list properties, text and both byte orders.

Reference: G. Turk (1994), The PLY Polygon File Format, Stanford University.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from lithoform.errors import FileFormatError

__all__ = ["parse_numbers", "read_ply_polygons"]

_PLY_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip


def read_ply_polygons(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and polygons of a PLY file, text or binary of either byte order; other properties are passed over.

    Parameters
    ----------
    data : bytes

    Returns
    -------
    vertices : numpy.ndarray, shape (n, 3), float64
        [unit of the file]
    sizes : numpy.ndarray of int64, shape (polygons,)
        Corners of each polygon.
    corners : numpy.ndarray of int64, shape (sum of sizes,)
        Vertex indices, not checked.

    Raises
    ------
    FileFormatError
        If the header is not whole or not understood, the body is shorter than it promises, or a word of a text is no
        number.
    """
    ending = re.search(rb"end_header[ \t]*(\r\n|\n|\r)", data)
    if ending is None:
        raise FileFormatError("its header has no end; it is truncated.")
    kind, elements = _ply_header(data[: ending.start()].decode("latin-1"))
    body = data[ending.end() :]
    if kind == "ascii":
        values: dict[str, dict[str, Any]] = _ply_elements(elements, parse_numbers(body.split()), None)
    else:
        values = _ply_elements(elements, body, "<" if kind == "binary_little_endian" else ">")
    corners = values.get("vertex", {})
    if not {"x", "y", "z"} <= set(corners):
        raise FileFormatError("it has no vertices with x, y and z.")
    vertices = np.stack([np.asarray(corners[axis], np.float64) for axis in "xyz"], axis=1)
    faces = values.get("face", {})
    sizes, flat = next(
        (faces[name] for name in ("vertex_indices", "vertex_index") if name in faces), (np.empty(0, int),) * 2
    )
    return vertices, np.asarray(sizes, np.int64), np.asarray(flat, np.int64)


_PlyElement = tuple[str, int, list[tuple[str, str, str | None]]]


def _ply_header(text: str) -> tuple[str, list[_PlyElement]]:
    """Kind of the body; for each element its name, count, and properties (name, type, type of a list's length)."""
    kind, elements = "", []
    for line in text.splitlines():
        match line.split():
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as kind, *_]:
                pass
            case ["element", name, count] if int(count) >= 0:
                elements.append((name, int(count), []))
            case ["property", "list", length, item, name]:
                elements[-1][2].append((name, _PLY_TYPES[item], _PLY_TYPES[length]))
            case ["property", item, name]:
                elements[-1][2].append((name, _PLY_TYPES[item], None))
            case ["format" | "element" | "property", *_]:
                raise FileFormatError(f"its header has a line that is not understood: {line.strip()[:60]!r}.")
    if not kind:
        raise FileFormatError("its header does not tell whether it is text or binary.")
    return kind, elements


def _ply_elements(elements: list[_PlyElement], body: Any, endian: str | None) -> dict[str, dict[str, Any]]:
    """Columns of each element: an array, or for a list its lengths and its items one after another."""
    out, at = {}, 0
    for name, count, properties in elements:
        try:
            out[name], at = _ply_rows(count, properties, body, at, endian)
        except (ValueError, IndexError, struct.error):
            raise FileFormatError(f"its header promises {count:,} of {name}, but there are fewer; it is truncated.") \
                from None  # fmt: skip
    return out


def _ply_rows(
    count: int, properties: list[tuple[str, str, str | None]], body: Any, at: int, endian: str | None
) -> tuple[dict[str, Any], int]:
    """Columns of one element and where the next begins: at once if all its lists are as long as in the first row."""
    if count == 0 or not properties:
        none = np.empty(0)
        return {name: none if length is None else (none, none) for name, _, length in properties}, at

    def scalar(place: int, kind: str) -> tuple[Any, int]:
        if endian is None:
            return body[place], place + 1
        dtype = np.dtype(endian + kind)
        return np.frombuffer(body, dtype, 1, place)[0], place + dtype.itemsize

    fields, place = [], at
    for i, (_, kind, length) in enumerate(properties):
        size = 1
        if length is not None:
            size, place = scalar(place, length)
            fields.append((f"n{i}", length, 1))
        fields.append((f"v{i}", kind, int(size)))
        width = 1 if endian is None else np.dtype(kind).itemsize
        place += int(size) * width
    if endian is None:
        width = sum(f[2] for f in fields)
        if len(body) - at < width * count:
            columns = None
        else:
            table = body[at : at + width * count].reshape(count, width)
            starts = np.cumsum([0] + [f[2] for f in fields])
            columns = {f[0]: table[:, a : a + f[2]] for f, a in zip(fields, starts, strict=False)}
    else:
        dtype = np.dtype([(name, endian + kind, (size,)) for name, kind, size in fields])
        width = dtype.itemsize
        columns = np.frombuffer(body, dtype, count, at) if len(body) - at >= width * count else None
    uniform = columns is not None and all(
        (columns[f"n{i}"] == columns[f"n{i}"][0]).all() for i, row in enumerate(properties) if row[2] is not None
    )
    if columns is not None and uniform:
        out: dict[str, Any] = {}
        for i, (name, _, length) in enumerate(properties):
            values = columns[f"v{i}"]
            out[name] = values[:, 0] if length is None else (columns[f"n{i}"][:, 0], values.ravel())
        return out, at + width * count
    if all(length is None for _, _, length in properties):
        raise ValueError("fewer rows than promised")
    return _walk_rows(count, properties, body, at, endian, scalar)


def _walk_rows(
    count: int, properties: list[tuple[str, str, str | None]], body: Any, at: int, endian: str | None, scalar: Callable
) -> tuple[dict[str, Any], int]:
    """The same row by row, for lists of different lengths."""
    sizes: dict[str, list[int]] = {row[0]: [] for row in properties}
    parts: dict[str, list[np.ndarray]] = {row[0]: [] for row in properties}
    for _ in range(count):
        for name, kind, length in properties:
            size = 1
            if length is not None:
                size, at = scalar(at, length)
            size = int(size)
            if endian is None:
                part, width = body[at : at + size], 1
            else:
                dtype = np.dtype(endian + kind)
                part, width = np.frombuffer(body, dtype, size, at), dtype.itemsize
            if size < 0 or len(part) < size:
                raise ValueError("a row is not whole")
            sizes[name].append(size)
            parts[name].append(part)
            at += size * width
    joined = {name: np.concatenate(part) for name, part in parts.items()}
    return {n: joined[n] if length is None else (np.array(sizes[n]), joined[n]) for n, _, length in properties}, at


def parse_numbers(words: list[bytes]) -> np.ndarray:
    """Words of a text as float64, shape (words,); a `FileFormatError` that cites the first that is no number."""
    try:
        return np.array(words, dtype=bytes).astype(np.float64) if words else np.empty(0)
    except ValueError:
        wrong = next(word for word in words if not _is_number(word))
        text = wrong[:30].decode("latin-1")
        raise FileFormatError(f"expected a number, got {text!r}; check how it was exported.") from None


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
