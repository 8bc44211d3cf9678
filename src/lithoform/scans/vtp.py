"""Reading of polygons from VTK's XML PolyData files (vtp), without VTK.

VTK's own reader ends the whole process where a header lies about a size, which a batch of files cannot stand; the
format is small enough to be read here: text, base64 and appended arrays, plain or packed by zlib or LZMA.

Reference: VTK File Formats, section "XML File Formats", https://docs.vtk.org/en/latest/vtk_file_formats/.
"""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from dataclasses import dataclass
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from lithoform.errors import FileFormatError
from lithoform.scans.ply import parse_numbers

__all__ = ["read_vtp_polygons"]

_TYPES: Final = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
    "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
_PACKERS: Final = {"vtkZLibDataCompressor": "zlib", "vtkLZMADataCompressor": "lzma"}
_SEGMENT: Final = re.compile(rb"[A-Za-z0-9+/]+=*")


@dataclass(frozen=True)
class _Source:
    """What the arrays of a file have in common; `offsets` tell where each appended array begins."""

    endian: str
    length: np.dtype
    packer: str
    appended: bytes
    is_base64: bool
    offsets: tuple[int, ...]


def read_vtp_polygons(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and polygons of all pieces of a file; strips are cut into triangles, lines and points passed over.

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
        If the file is no PolyData, is packed otherwise, or an array is shorter than it promises; other broken content
        raises whatever the reader stumbles on.
    """
    root, source = _opened(data)
    vertices, sizes, corners, count = [np.empty((0, 3))], [np.empty(0, np.int64)], [np.empty(0, np.int64)], 0
    for piece in root.iter("Piece"):
        array = piece.find("Points/DataArray")
        points = np.empty((0, 3)) if array is None else _values(array, source).astype(np.float64).reshape(-1, 3)
        if len(points) != int(piece.get("NumberOfPoints", "0")):
            raise FileFormatError(f"it promises {piece.get('NumberOfPoints', 0)} points and holds {len(points)}.")
        ends, named = _cells(piece, "Polys", source)
        sizes.append(np.diff(ends, prepend=0))
        corners.append(count + named)
        ends, named = _cells(piece, "Strips", source)
        for strip in np.split(named, ends[:-1]):
            triangles = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
            # Every second triangle of a strip is wound the other way.
            triangles[1::2] = triangles[1::2, ::-1]
            sizes.append(np.full(len(triangles), 3))
            corners.append(count + triangles.ravel())
        vertices.append(points)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(sizes), np.concatenate(corners)


def _opened(data: bytes) -> tuple[ElementTree.Element, _Source]:
    """The XML of a file, and where and how its arrays are kept."""
    start = data.find(b"<AppendedData")
    appended, is_base64 = b"", False
    if start >= 0:
        head = data[start : data.index(b">", start)]
        begin, end = data.index(b"_", start + len(head)) + 1, data.rfind(b"</AppendedData")
        if end < begin:
            raise FileFormatError("its appended data have no end; it is truncated.")
        is_base64 = b"base64" in head
        appended = data[begin:end]
        data = data[:start] + b"</VTKFile>"
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise FileFormatError(f"it is truncated or is no vtp file ({error}).") from None
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        raise FileFormatError(
            f"expected VTK's PolyData, got {root.get('type', root.tag)!r}; extract its surface first."
        )
    packer = root.get("compressor", "")
    # Text is not packed, whatever packer the file names.
    is_text = all(array.get("format", "ascii") == "ascii" for array in root.iter("DataArray"))
    if packer and packer not in _PACKERS and not is_text:
        raise FileFormatError(f"it is packed by {packer}, which is not read here; write it with zlib, or unpacked.")
    endian = ">" if root.get("byte_order") == "BigEndian" else "<"
    offsets = sorted({int(array.get("offset", "0")) for array in root.iter("DataArray")})
    length = np.dtype(endian + _TYPES[root.get("header_type", "UInt32")])
    return root, _Source(endian, length, _PACKERS.get(packer, ""), appended, is_base64, tuple(offsets))


def _cells(piece: Any, name: str, source: _Source) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the cells of a kind within their list of vertices, and that list."""
    arrays = {array.get("Name"): array for array in piece.findall(f"{name}/DataArray")}
    if int(piece.get(f"NumberOf{name}", "0")) == 0 or not arrays:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    ends = _values(arrays["offsets"], source).astype(np.int64)
    named = _values(arrays["connectivity"], source).astype(np.int64)
    if len(ends) != int(piece.get(f"NumberOf{name}")) or (np.diff(ends, prepend=0) < 0).any() or ends[-1] > len(named):
        raise FileFormatError("its polygons do not fit its list of vertices; it is truncated or broken.")
    return ends, named[: ends[-1]]


def _values(array: Any, source: _Source) -> np.ndarray:
    dtype = np.dtype(source.endian + _TYPES[array.get("type")])
    kind, text = array.get("format", "ascii"), (array.text or "").encode()
    if kind == "ascii":
        words = text.split()
        # Not by way of floats, which do not hold every whole number.
        return np.array([int(word) for word in words], np.int64) if dtype.kind in "iu" else parse_numbers(words)
    raw = text
    if kind == "appended":
        begin = int(array.get("offset"))
        raw = source.appended[begin : min((o for o in source.offsets if o > begin), default=None)]
    if kind != "appended" or source.is_base64:
        # Lengths and data are coded one after the other, each with its own padding, or in one.
        raw = b"".join(base64.b64decode(segment, validate=True) for segment in _SEGMENT.findall(raw))
    return np.frombuffer(_unpacked(raw, source), dtype)


def _unpacked(raw: bytes, source: _Source) -> bytes:
    """The bytes of an array, without the lengths before them."""
    width = source.length.itemsize
    first = int(np.frombuffer(raw, source.length, 1)[0])
    if not source.packer:
        if len(raw) - width < first:
            raise FileFormatError(f"an array of {first:,} bytes is cut short; it is truncated.")
        return raw[width : width + first]
    if first == 0:
        return b""
    if (3 + first) * width > len(raw):
        raise FileFormatError("the lengths of a packed array are cut short; it is truncated.")
    size, last, *packed = (int(n) for n in np.frombuffer(raw, source.length, 3 + first)[1:])
    sizes = [size] * (first - 1) + [last or size]
    blocks, at = [], (3 + first) * width
    for length, expected in zip(packed, sizes, strict=True):
        unpacker: Any = zlib.decompressobj() if source.packer == "zlib" else lzma.LZMADecompressor()
        # No more than promised, so that a small file cannot fill the memory.
        block = unpacker.decompress(raw[at : at + length], expected + 1)
        if len(block) != expected:
            raise FileFormatError("a packed array does not hold what it promises; it is truncated or broken.")
        blocks.append(block)
        at += length
    return b"".join(blocks)
