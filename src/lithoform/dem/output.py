"""Results in files: a series of VTK files that ParaView opens, and the table of a run as Parquet."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np

from lithoform.atomic import atomic_path, atomic_write, make_folder
from lithoform.dem.model import Model
from lithoform.dem.observers import contacts, unit_of
from lithoform.dem.shapes import Shape
from lithoform.dem.state import State, rotate
from lithoform.errors import FileFormatError, OutputError, SceneError

__all__ = ["VtkSeries", "write_table"]

# A sphere is drawn with 20 times the square of this many triangles.
_SPHERE: Final = 6
# What zlib takes at a time: VTK reads blocks of this many bytes.
_BLOCK: Final = 1 << 16
_VTK_TYPES: Final[Mapping[str, str]] = {"f8": "Float64", "f4": "Float32", "i4": "Int32", "u1": "UInt8"}
_COLLECTION: Final = "Collection"

# "Polys" or "Lines" with the points of each; arrays by name.
_Cells = tuple[str, np.ndarray]
_Data = dict[str, np.ndarray]


class VtkSeries:
    """Writes a state as VTK files: `simulate(..., on_report=VtkSeries(folder, model))`.

    At each call `blocks_<step>.vtp` (the surfaces of all blocks where they are) and `contacts_<step>.vtp` (a line from
    centre to centre, or from a centre to the place on a wall) are written, and `blocks.pvd` and `contacts.pvd`, which
    ParaView opens as series in time.  Files of the same step are replaced; a series goes on in the folder where it was,
    and steps later than the one that is written, of a run that has been taken back, leave the list.  Lengths in metres.

    On the points of the blocks: block (number), velocity [m/s] and angular_velocity [rad/s] (half a step back), force
    (net, [N]).  On the lines: first, second (blocks, or wall), is_wall, normal, force_magnitude and normal_force [N].

    Parameters
    ----------
    folder : path-like
        Made if it is not there.
    model : Model
    blocks, contacts : bool
        What to write.
    surface : {"mesh", "hull"}
        The true meshes, about 0.2 MB for each block of 20,000 triangles, or their convex hulls, about 16 times smaller.

    Raises
    ------
    OutputError
        If the folder cannot be made.
    FileFormatError
        If the folder has a file `blocks.pvd` or `contacts.pvd` that is no collection.
    SceneError
        If `surface` is neither.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        model: Model,
        *,
        blocks: bool = True,
        contacts: bool = True,
        surface: Literal["mesh", "hull"] = "mesh",
    ) -> None:
        if surface not in ("mesh", "hull"):
            raise SceneError(f"expected a surface of mesh or hull, got {surface!r}.")
        self.folder = Path(folder)
        make_folder(self.folder)
        self._shapes = model.shapes
        self._surfaces = [_surface(shape, hull=surface == "hull") for shape in model.shapes] if blocks else []
        self._listed = {
            name: _read_collection(self.folder / f"{name}.pvd")
            for name, wanted in (("blocks", blocks), ("contacts", contacts))
            if wanted
        }

    def __call__(self, model: Model, state: State) -> list[Path]:
        """Write a state.

        Returns
        -------
        list of pathlib.Path
            The files that were written.

        Raises
        ------
        SceneError
            If the model has other shapes than that of the series.
        OutputError
            If a file cannot be written; none is left half.
        """
        if model.shapes != self._shapes:
            raise SceneError("expected the model that the series was made for, got one of other shapes.")
        written = []
        for name in self._listed:
            content = self._blocks(model, state) if name == "blocks" else _contact_lines(model, state)
            path = self.folder / f"{name}_{state.step:09d}.vtp"
            atomic_write(path, _vtp(*content, time=state.time))
            written.append(path)
        # After both, so that the lists name no file that is not there.
        for name, listed in self._listed.items():
            kept = {step: entry for step, entry in listed.items() if step < state.step}
            self._listed[name] = {**kept, state.step: (state.time, f"{name}_{state.step:09d}.vtp")}
            path = self.folder / f"{name}.pvd"
            atomic_write(path, _collection(self._listed[name]))
            written.append(path)
        return written

    def _blocks(self, model: Model, state: State) -> tuple[np.ndarray, _Cells, _Data, _Data]:
        surfaces = [self._surfaces[shape] for shape in model.shape]
        counts = np.array([len(points) for points, _ in surfaces])
        first = np.cumsum([0, *counts[:-1]])
        points = np.concatenate([
            rotate(np.broadcast_to(turn, (len(local), 4)), local * scale) + centre
            for (local, _), turn, scale, centre in zip(
                surfaces, state.orientation, model.scale, state.position, strict=True
            )
        ])  # fmt: skip
        faces = np.concatenate([faces + start for (_, faces), start in zip(surfaces, first.tolist(), strict=True)])
        each = {
            "block": np.arange(model.count, dtype=np.int32),
            "velocity": state.velocity.astype(np.float32),
            "angular_velocity": state.angular_velocity(model).astype(np.float32),
            "force": state.force.astype(np.float32),
        }
        data = {name: values.repeat(counts, axis=0) for name, values in each.items()}
        return points.astype(np.float32), ("Polys", faces), data, {}


def _contact_lines(model: Model, state: State) -> tuple[np.ndarray, _Cells, _Data, _Data]:
    every = contacts(model, state)
    points = np.stack([state.position[every.first], every.end], axis=1).reshape(-1, 3)
    lines = np.arange(len(points), dtype=np.int32).reshape(-1, 2)
    data = {
        "first": every.first.astype(np.int32),
        "second": every.second.astype(np.int32),
        "is_wall": every.is_wall.astype(np.uint8),
        "normal": every.normal,
        "force_magnitude": np.linalg.norm(every.force, axis=1),
        "normal_force": every.normal_force,
    }
    return points, ("Lines", lines), {}, data


def _surface(shape: Shape, *, hull: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] and triangles of a shape."""
    if shape.mesh is None:
        from lithoform.topology import sphere

        ball = sphere("icosahedral", _SPHERE)
        return ball.vertices * shape.radius, ball.faces
    if not hull:
        return shape.mesh.vertices, shape.mesh.faces
    from scipy.spatial import ConvexHull

    points = shape.mesh.vertices
    found = ConvexHull(points)
    a, b, c = (points[found.simplices[:, k]] for k in range(3))
    outward = (np.cross(b - a, c - a) * found.equations[:, :3]).sum(axis=1) > 0.0
    faces = np.where(outward[:, None], found.simplices, found.simplices[:, ::-1])
    used, numbers = np.unique(faces, return_inverse=True)
    return points[used], numbers.reshape(-1, 3).astype(np.int32)


def _vtp(points: np.ndarray, cells: _Cells, point_data: _Data, cell_data: _Data, *, time: float) -> bytes:
    """A file of VTK's PolyData, its arrays compressed and appended."""
    kind, corners = cells
    root = ET.Element(
        "VTKFile",
        type="PolyData",
        version="1.0",
        byte_order="LittleEndian",
        header_type="UInt64",
        compressor="vtkZLibDataCompressor",
    )
    appended = bytearray()

    def add(parent: ET.Element, name: str, values: np.ndarray) -> None:
        array = np.ascontiguousarray(values)
        code = f"{array.dtype.kind}{array.dtype.itemsize}"
        attributes = {"type": _VTK_TYPES[code], "Name": name, "format": "appended", "offset": str(len(appended))}
        if array.ndim == 2:
            attributes["NumberOfComponents"] = str(array.shape[1])
        ET.SubElement(parent, "DataArray", attributes)
        appended.extend(_compressed(array.astype(f"<{code}", copy=False).tobytes()))

    data = ET.SubElement(root, "PolyData")
    fields = ET.SubElement(data, "FieldData")
    add(fields, "TimeValue", np.array([time]))
    fields[0].set("NumberOfTuples", "1")
    counts = {"NumberOfPoints": len(points), "NumberOfVerts": 0, "NumberOfLines": 0, "NumberOfStrips": 0,
              "NumberOfPolys": 0, f"NumberOf{kind}": len(corners)}  # fmt: skip
    piece = ET.SubElement(data, "Piece", {name: str(count) for name, count in counts.items()})
    for parent, arrays in (("PointData", point_data), ("CellData", cell_data)):
        element = ET.SubElement(piece, parent)
        for name, values in arrays.items():
            add(element, name, values)
    add(ET.SubElement(piece, "Points"), "Points", points)
    element = ET.SubElement(piece, kind)
    add(element, "connectivity", corners.ravel())
    add(element, "offsets", np.arange(1, len(corners) + 1, dtype=np.int32) * corners.shape[1])
    ET.SubElement(root, "AppendedData", encoding="raw").text = "@"
    head, tail = ET.tostring(root, encoding="utf-8", xml_declaration=True).split(b"@")
    # Raw bytes are no XML; VTK's readers take them from the underscore on.
    return head + b"_" + bytes(appended) + tail


def _compressed(content: bytes) -> bytes:
    """Blocks of zlib behind VTK's header: how many, their size, that of the last one if it is less, theirs packed."""
    packed = [zlib.compress(content[at : at + _BLOCK], 1) for at in range(0, len(content), _BLOCK)]
    header = [len(packed), _BLOCK, len(content) % _BLOCK, *map(len, packed)]
    return np.array(header, dtype="<u8").tobytes() + b"".join(packed)


def _collection(entries: Mapping[int, tuple[float, str]]) -> bytes:
    root = ET.Element("VTKFile", type=_COLLECTION, version="1.0", byte_order="LittleEndian")
    listing = ET.SubElement(root, _COLLECTION)
    for _, (time, file) in sorted(entries.items()):
        ET.SubElement(listing, "DataSet", timestep=repr(float(time)), group="", part="0", file=file)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)


def _read_collection(path: Path) -> dict[int, tuple[float, str]]:
    """Steps of a series that is there already, with time and file."""
    if not path.exists():
        return {}
    try:
        root = ET.fromstring(path.read_bytes())
        entries = [(float(entry.attrib["timestep"]), entry.attrib["file"]) for entry in root.iter("DataSet")]
        if root.get("type") != _COLLECTION:
            raise ValueError
        return {int(file.removesuffix(".vtp").rpartition("_")[2]): (time, file) for time, file in entries}
    except OSError as error:
        raise FileFormatError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}.") from error
    except (ET.ParseError, KeyError, ValueError) as error:
        raise FileFormatError(f"{path} is no collection that lithoform has written: choose another folder.") from error


def write_table(
    path: str | os.PathLike[str],
    table: Mapping[str, Sequence[float] | np.ndarray],
    *,
    observers: Mapping[str, Callable[..., object]] | None = None,
    units: Mapping[str, str] | None = None,
) -> Path:
    """Write the table of a run as Parquet, whole or not at all, with the unit of each column in its metadata.

    Parameters
    ----------
    path : path-like
    table : mapping of str to array
        `Run.table`.
    observers : mapping of str to callable, optional
        Those of the run: the units of their columns are those of `lithoform.dem.observers.unit_of`.
    units : mapping of str to str, optional
        Units of other columns.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    OutputError
        If the columns have no common length, or the file cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {name: np.asarray(values) for name, values in table.items()}
    if len({values.shape for values in columns.values()}) > 1 or any(v.ndim != 1 for v in columns.values()):
        told = ", ".join(f"{name} {values.shape}" for name, values in columns.items())
        raise OutputError(f"cannot write {path}: expected columns of one length, got {told}; an observer must give the "
                          "same names at each report.")  # fmt: skip
    known = {"time": "s", "step": "1", **(units or {})}
    fields = []
    for name, values in columns.items():
        unit = known.get(name) or unit_of(name, observers or {})
        fields.append(pa.field(name, pa.from_numpy_dtype(values.dtype), metadata={"unit": unit} if unit else None))
    made = pa.table([pa.array(values) for values in columns.values()], schema=pa.schema(fields))
    with atomic_path(path) as partial, partial.open("wb") as sink:
        pq.write_table(made, sink, compression="zstd", write_page_checksum=True)
    return Path(path)
