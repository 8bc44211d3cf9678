"""Mesh files: exact round trips, units, the same bytes on every run, and plain errors for broken files."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import struct
import subprocess
import sys
import textwrap
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lithoform import mesh_io
from lithoform.errors import FileFormatError, MeshError, OutputError
from lithoform.mesh import Mesh, weld
from lithoform.mesh_io import (
    FORMATS,
    UNITS,
    encode_mesh,
    file_unit,
    format_of,
    read_mesh,
    stored_vertices,
    write_mesh,
)
from lithoform.topology import sphere

ALL = list(FORMATS)
INDEXED = [name for name in ALL if FORMATS[name].welded]
EXACT = [name for name in ALL if FORMATS[name].dtype == "float64"]


def bumpy(n: int = 6) -> Mesh:
    """A body of about 25 mm with an odd shape, away from the origin."""
    ball = sphere("octahedral", n)
    x, y, z = ball.vertices.T
    radius = 0.0123 * (1 + 0.2 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.1 * np.sin(9 * z))
    return ball.with_vertices(ball.vertices * radius[:, None] * [1.3, 1.0, 0.7] + [0.001, -0.002, 0.03])


@pytest.fixture(scope="module")
def body() -> Mesh:
    return bumpy()


def triangles(mesh: Mesh) -> list[tuple[float, ...]]:
    """Triangles by their coordinates, each from its smallest corner, sorted: a set that no order can hide."""
    rows = []
    for corners in mesh.vertices[mesh.faces].tolist():
        first = corners.index(min(corners))
        rows.append(tuple(c for i in range(3) for c in corners[(first + i) % 3]))
    return sorted(rows)


def write(path: Path, data: bytes | str) -> Path:
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def refusal(path: Path, **options: str) -> str:
    """Message of the error on reading; it names the file, is one line, and hides what trimesh says."""
    with pytest.raises(FileFormatError) as caught:
        read_mesh(path, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.endswith((".", "?"))
    assert "\n" not in message
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    return message


TETRA_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def ascii_stl(mesh: Mesh, solids: int = 1) -> str:
    text = ""
    for number, faces in enumerate(np.array_split(mesh.faces, solids)):
        text += f"solid Vertex facet {number}\n"
        for a, b, c in mesh.vertices[faces].tolist():
            text += "  facet normal 0 0 1\n    outer loop\n"
            text += "".join(f"      VERTEX {x!r} {y!r} {z!r}\n" for x, y, z in (a, b, c))
            text += "    endloop\n  endfacet\n"
        text += f"endsolid Vertex facet {number}\n"
    return text


# --- the table


def test_the_table_says_what_a_file_holds():
    assert ALL == ["stl", "ply", "obj", "glb", "3mf"]
    assert [FORMATS[f].extension for f in ALL] == [".stl", ".ply", ".obj", ".glb", ".3mf"]
    assert EXACT == ["ply", "obj", "3mf"]
    for unit in UNITS:
        assert [file_unit(f, unit) for f in ALL] == [unit, unit, unit, "m", unit]
    assert UNITS["in"] * 0.0254 == 1.0


@pytest.mark.parametrize(
    ("name", "word"), [("slt", "Did you mean stl"), ("gltf", "Did you mean glb"), ("dwg", "expected a mesh format of")]
)
def test_an_unknown_format_names_the_nearest(body, tmp_path, name, word):
    with pytest.raises(FileFormatError, match=word):
        encode_mesh(body, name)
    with pytest.raises(FileFormatError, match=word):
        write_mesh(tmp_path / f"a.{name}", body)
    assert word in refusal(tmp_path / f"a.{name}")
    assert list(tmp_path.iterdir()) == []


def test_formats_by_name_are_found_in_any_case(body, tmp_path):
    assert encode_mesh(body, "STL") == encode_mesh(body, "stl") == encode_mesh(body, ".stl")
    assert format_of("folder/A.PLY") == "ply"
    write_mesh(tmp_path / "A.Obj", body)
    assert read_mesh(tmp_path / "A.Obj").faces.tolist() == body.faces.tolist()
    with pytest.raises(FileFormatError, match="expected a mesh format of stl, ply, obj, glb, 3mf, got ''"):
        format_of("none")


def test_an_unknown_unit(body, tmp_path):
    with pytest.raises(FileFormatError, match="expected a unit of m, cm, mm, um, in, got 'km'"):
        encode_mesh(body, "glb", unit="km")
    with pytest.raises(FileFormatError, match="expected a unit"):
        stored_vertices(body, "stl", "")
    write_mesh(tmp_path / "a.glb", body)
    with pytest.raises(FileFormatError, match="expected a unit"):
        read_mesh(tmp_path / "a.glb", unit="parsec")


def test_coordinates_that_a_format_cannot_hold(body):
    huge = body.with_vertices(body.vertices * 1e40)
    for name in ("stl", "glb"):
        with pytest.raises(MeshError, match="too large"):
            encode_mesh(huge, name)
    assert len(encode_mesh(huge, "ply")) > 0
    with pytest.raises(MeshError, match="too large"):
        stored_vertices(body.with_vertices(body.vertices * 1e306), "ply", "um")


# --- round trips


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", ALL)
def test_a_round_trip_gives_what_is_stored(body, tmp_path, name, unit):
    path = tmp_path / f"a.{name}"
    digest = write_mesh(path, body, unit=unit)
    assert digest == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    back = read_mesh(path, unit=unit)
    stored = stored_vertices(body, name, unit) / UNITS[file_unit(name, unit)]
    precision = 1e-15 if name in EXACT else 6e-8
    assert np.abs(stored - body.vertices).max() <= precision * np.abs(body.vertices).max()
    if name in INDEXED:
        assert (back.faces == body.faces).all()
        assert (back.vertices == stored).all()
    assert len(back.vertices) == len(body.vertices)
    assert triangles(back) == triangles(body.with_vertices(stored))
    assert back.connectivity.euler_characteristic == 2
    assert back.mass_properties.volume == pytest.approx(body.mass_properties.volume, rel=1e-6)


@pytest.mark.parametrize("name", EXACT)
def test_metres_come_back_to_the_bit(body, tmp_path, name):
    write_mesh(tmp_path / f"a.{name}", body, unit="m")
    assert read_mesh(tmp_path / f"a.{name}", unit="m").content_hash == body.content_hash


@given(arrays(np.float64, (6, 3), elements=st.floats(allow_nan=False, allow_infinity=False)))
@settings(max_examples=40, deadline=None)
def test_any_coordinate_comes_back_to_the_bit(tmp_path_factory, vertices):
    mesh = Mesh(vertices, sphere("octahedral", 1).faces)
    folder = tmp_path_factory.mktemp("any")
    for name in EXACT:
        write_mesh(folder / f"a.{name}", mesh, unit="m")
        assert read_mesh(folder / f"a.{name}", unit="m").content_hash == mesh.content_hash


@pytest.mark.parametrize("name", ALL)
def test_nothing_is_merged_removed_or_turned(tmp_path, name):
    # A vertex twice, a vertex of no face, a triangle twice, a triangle without area, one inside out.
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0], [5, 5, 5]], float)
    faces = np.array([[0, 2, 1], [0, 2, 1], [0, 4, 3], [0, 1, 4], [3, 2, 0], [1, 1, 2], [1, 2, 3]])
    write_mesh(tmp_path / f"a.{name}", Mesh(vertices, faces), unit="m")
    back = read_mesh(tmp_path / f"a.{name}", unit="m")
    if name == "stl":
        assert (back.vertices == [[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1]]).all()
        assert back.faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 2, 2], [3, 1, 0], [2, 2, 1], [2, 1, 3]]
    else:
        assert (back.vertices == vertices).all()
        assert (back.faces == faces).all()


def test_the_corners_of_an_stl_are_merged_by_value_in_order(tmp_path):
    tiny = float(np.nextafter(np.float32(1), np.float32(2)))
    corners = [
        [[0.0, 1, 2], [3, 4, 5], [1, 1, 1]],
        [[-0.0, 1, 2], [1, 1, 1], [3, 4, 5]],
        [[tiny, 1, 1], [1, 1, 1], [9, 9, 9]],
    ]
    data = np.zeros(3, mesh_io.STL_TRIANGLE)
    data["corners"] = corners
    path = write(tmp_path / "a.stl", bytes(80) + struct.pack("<I", 3) + data.tobytes())
    mesh = read_mesh(path, unit="m")
    assert mesh.vertices.tolist() == [[0, 1, 2], [3, 4, 5], [1, 1, 1], [tiny, 1, 1], [9, 9, 9]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 1], [3, 2, 4]]


@given(arrays(np.int64, (30, 3), elements=st.integers(-1, 1)))
@settings(max_examples=50, deadline=None)
def test_merging_agrees_with_a_dictionary(points):
    corners = points.astype(np.float32)
    index: dict[tuple[float, ...], int] = {}
    expected = [index.setdefault(tuple(c), len(index)) for c in corners.tolist()]
    vertices, faces = weld(corners)
    assert vertices.tolist() == [list(key) for key in index]
    assert faces.ravel().tolist() == expected


# --- units


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 1e2), ("mm", 1e3), ("um", 1e6), ("in", 1 / 0.0254)])
@pytest.mark.parametrize("name", ALL)
def test_another_program_reads_the_size_in_the_unit(body, tmp_path, name, unit, factor):
    import trimesh

    write_mesh(tmp_path / f"a.{name}", body, unit=unit)
    loaded = trimesh.load(tmp_path / f"a.{name}", force="mesh")
    factor = 1.0 if name == "glb" else factor
    extents = np.ptp(body.vertices, axis=0)
    assert loaded.is_watertight
    assert len(loaded.vertices) == len(body.vertices)
    assert loaded.extents == pytest.approx(extents * factor, rel=2e-7)
    assert loaded.volume == pytest.approx(body.mass_properties.volume * factor**3, rel=1e-6)
    # trimesh keeps every digit of our exact formats.
    bounds = np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)]) * factor
    assert loaded.bounds == pytest.approx(bounds, rel=1e-15 if name in EXACT else 1e-7, abs=0)


@pytest.mark.parametrize(
    ("unit", "name"),
    [("m", "meter"), ("cm", "centimeter"), ("mm", "millimeter"), ("um", "micron"), ("in", "inch")],
)
def test_a_3mf_names_its_unit(body, tmp_path, unit, name):
    path = tmp_path / "a.3mf"
    write_mesh(path, body, unit=unit)
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        model = archive.read("3D/3dmodel.model").decode()
    assert f' unit="{name}"' in model
    assert "UUID" not in model
    # The unit of the file counts, not the one asked for.
    assert read_mesh(path, unit="um").vertices == pytest.approx(body.vertices, rel=1e-15)


def remodel(path: Path, old: str, new: str) -> Path:
    """Replace a piece of the model of a 3mf file."""
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    model = entries["3D/3dmodel.model"].decode()
    assert old in model
    entries["3D/3dmodel.model"] = model.replace(old, new).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return path


def test_the_unit_of_a_3mf_of_others(body, tmp_path):
    path = tmp_path / "a.3mf"
    write_mesh(path, body, unit="mm")
    extent = np.ptp(body.vertices, axis=0)
    assert np.ptp(read_mesh(remodel(path, ' unit="millimeter"', ' unit="foot"')).vertices, axis=0) == pytest.approx(
        extent * 304.8
    )
    assert np.ptp(read_mesh(remodel(path, ' unit="foot"', "")).vertices, axis=0) == pytest.approx(extent)
    assert "got 'furlong'" in refusal(remodel(path, "<model ", '<model unit="furlong" '))


# --- the same bytes


@pytest.mark.parametrize("name", ALL)
def test_two_processes_write_the_same_bytes(tmp_path, name, body):
    code = """
        import sys, time, numpy
        from lithoform.topology import sphere
        from lithoform.mesh_io import encode_mesh
        # Another day, for whatever asks what time it is.
        time.time = lambda: 2e9
        time.localtime = lambda *_: time.gmtime(2e9)
        ball = sphere("octahedral", 6)
        x, y, z = ball.vertices.T
        radius = 0.0123 * (1 + 0.2 * numpy.sin(5 * x + 1) * numpy.cos(4 * y) + 0.1 * numpy.sin(9 * z))
        mesh = ball.with_vertices(ball.vertices * radius[:, None] * [1.3, 1.0, 0.7] + [0.001, -0.002, 0.03])
        sys.stdout.buffer.write(encode_mesh(mesh, sys.argv[1], unit="cm"))
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "PYTHONHASHSEED": "7"}
    command = [sys.executable, "-W", "error", "-c", textwrap.dedent(code), name]
    done = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert done.stderr == b""
    assert done.stdout == encode_mesh(body, name, unit="cm")


def test_no_file_holds_a_date_a_version_or_a_name_of_this_system(body):
    with zipfile.ZipFile(io.BytesIO(encode_mesh(body, "3mf"))) as archive:
        assert {(i.date_time, i.create_system) for i in archive.infolist()} == {((1980, 1, 1, 0, 0, 0), 0)}
    import trimesh

    for name in ALL:
        assert trimesh.__version__.encode() not in encode_mesh(body, name)[:2000]


def test_the_heads_of_the_files(body):
    assert encode_mesh(body, "stl")[:80] == bytes(80)
    assert len(encode_mesh(body, "stl")) == 84 + 50 * len(body.faces)
    assert encode_mesh(body, "ply").count(b"property double") == 3
    assert encode_mesh(body, "obj").startswith(b"# lithoform: 146 vertices, 288 triangles\nv ")


# --- files of others


def test_a_text_stl(body, tmp_path):
    for solids in (1, 3):
        mesh = read_mesh(write(tmp_path / "a.stl", ascii_stl(body, solids)), unit="m")
        assert len(mesh.vertices) == len(body.vertices)
        assert triangles(mesh) == triangles(body)  # with all digits, unlike a binary one
    crlf = ascii_stl(body).replace("\n", "\r\n")
    assert len(read_mesh(write(tmp_path / "a.stl", crlf)).faces) == len(body.faces)


def test_a_binary_stl_whose_header_says_solid(body, tmp_path):
    data = encode_mesh(body, "stl")
    path = write(tmp_path / "a.stl", b"solid of another program".ljust(80) + data[80:])
    assert len(read_mesh(path).faces) == len(body.faces)


def test_an_obj_with_normals_textures_materials_and_relative_corners(tmp_path):
    text = """# by hand
mtllib none.mtl
v 0 0 0 0.5 0.5 0.5
v\t1 0 0 1 1 1
v 0 1 0 # a remark
v 0 0 \\
1
vt 0 0
vt 1 1
vn 0 0 1
usemtl one
f 1/1/1 3/2/1 2/1/1
usemtl two
f 1//1 2//1 4//1
g third
f -4 -1 -2
usemtl one
f 2/2 3/1 4/2
"""
    for content in (text, text.replace("\n", "\r\n")):
        mesh = read_mesh(write(tmp_path / "a.obj", content), unit="m")
        assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        assert mesh.faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        assert mesh.mass_properties.volume == pytest.approx(1 / 6)


def ascii_ply(faces: str, count: int, properties: str = "") -> str:
    return (
        f"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{properties}"
        f"element face {count}\nproperty list uchar int vertex_index\nend_header\n"
        + "".join(f"{v}{' 0.5 0.25' if properties else ''}\n" for v in ("0 0 0", "1 0 0", "0 1 0", "0 0 1"))
        + faces
    )


def test_a_text_ply_with_texture_coordinates(tmp_path):
    text = ascii_ply("3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n", 4, "property float s\nproperty float t\n")
    mesh = read_mesh(write(tmp_path / "a.ply", text), unit="m")
    assert mesh.faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


def test_the_texture_seams_of_a_ply_split_nothing(tmp_path):
    faces = "".join(f"3 {f} 6 0 0 1 0 0.{i} 1\n" for i, f in enumerate(["0 2 1", "0 1 3", "0 3 2", "1 2 3"]))
    text = ascii_ply(faces, 4).replace("vertex_index\n", "vertex_index\nproperty list uchar float texcoord\n")
    mesh = read_mesh(write(tmp_path / "a.ply", text), unit="m")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@pytest.mark.parametrize("name", ["stl", "ply", "glb", "3mf", "obj"])
def test_files_of_trimesh(body, tmp_path, name):
    import trimesh

    other = trimesh.Trimesh(body.vertices * 1000, body.faces, process=False)
    other.vertex_normals  # noqa: B018 - once known, trimesh writes them
    other.export(tmp_path / f"a.{name}")
    mesh = read_mesh(tmp_path / f"a.{name}", unit="mm" if name != "glb" else "m")
    assert len(mesh.vertices) == len(body.vertices)
    scale = 1000 if name == "glb" else 1
    assert mesh.mass_properties.volume == pytest.approx(body.mass_properties.volume * scale**3, rel=1e-5)


@pytest.mark.parametrize("name", ["glb", "3mf"])
def test_the_bodies_of_a_scene_are_placed_and_joined(body, tmp_path, name):
    import trimesh

    part = trimesh.Trimesh(body.vertices, body.faces, process=False)
    scene = trimesh.Scene()
    scene.add_geometry(part, geom_name="a")
    mirror = np.diag([-2.0, 2.0, 2.0, 1.0])
    mirror[:3, 3] = [7, 0, 0]
    scene.add_geometry(part, geom_name="b", transform=mirror)
    scene.export(tmp_path / f"a.{name}")
    if name == "3mf":
        remodel(tmp_path / "a.3mf", "millimeter", "meter")
    mesh = read_mesh(tmp_path / f"a.{name}")
    assert len(mesh.faces) == 2 * len(body.faces)
    assert mesh.connectivity.component_count == 2
    assert mesh.mass_properties.volume == pytest.approx(9 * body.mass_properties.volume, rel=1e-5)
    # Twice the body, mirrored, reaches left from 7.
    assert mesh.vertices[:, 0].max() == pytest.approx(7 - 2 * body.vertices[:, 0].min(), rel=1e-6)


# --- broken files


@pytest.mark.parametrize("name", ALL)
def test_a_truncated_file_is_refused_wherever_it_ends(body, tmp_path, name):
    data = encode_mesh(body, name)
    path = tmp_path / f"a.{name}"
    ends = {1, 3, 10, 79, 83, 84, 100, len(data) // 3, len(data) // 2, len(data) - 51, len(data) - 2, len(data) - 1}
    for end in (0, *sorted(ends)):
        assert path.name in refusal(write(path, data[:end]))


@pytest.mark.parametrize("name", ["stl", "ply", "glb"])
def test_a_binary_file_with_more_than_it_promises_is_refused(body, tmp_path, name):
    assert f"a.{name}" in refusal(write(tmp_path / f"a.{name}", encode_mesh(body, name) + bytes(12)))


def test_a_truncated_text_is_refused(body, tmp_path):
    stl, ply = ascii_stl(body), ascii_ply("3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n", 4)
    for part in (0.2, 0.5, 0.9):
        assert "truncated" in refusal(write(tmp_path / "a.stl", stl[: int(part * len(stl))]))
    assert "truncated" in refusal(write(tmp_path / "a.stl", stl[: stl.rindex("endsolid")]))
    assert "truncated" in refusal(write(tmp_path / "a.ply", ply[:-9]))
    assert "truncated" in refusal(write(tmp_path / "a.ply", ply[: ply.index("0 1 0")]))


@pytest.mark.parametrize("name", ALL)
def test_garbage_is_refused(tmp_path, name):
    generator = np.random.default_rng(5)
    path = tmp_path / f"a.{name}"
    magic = {"ply": b"ply\n", "glb": b"glTF", "3mf": b"PK\x03\x04", "stl": b"solid ", "obj": b"v 1 2\n"}[name]
    for size in (1, 20, 90, 3000):
        noise = generator.integers(0, 256, size, dtype=np.uint8).tobytes()
        assert path.name in refusal(write(path, noise))
        assert path.name in refusal(write(path, magic + noise))


@pytest.mark.parametrize("name", ALL)
def test_damage_never_escapes_as_another_error(body, tmp_path, name):
    generator = np.random.default_rng(11)
    data = bytearray(encode_mesh(bumpy(1), name))
    path = tmp_path / f"a.{name}"
    for _ in range(120):
        damaged = bytearray(data)
        for place in generator.integers(0, len(data), 3):
            damaged[place] = generator.integers(0, 256)
        with contextlib.suppress(FileFormatError):
            assert isinstance(read_mesh(write(path, bytes(damaged))), Mesh)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("other", ALL)
def test_a_wrong_extension_is_refused(body, tmp_path, name, other):
    if name == other:
        return
    message = refusal(write(tmp_path / f"a.{name}", encode_mesh(body, other)))
    if other in ("ply", "glb", "3mf"):
        assert f"its name says {name}, but its content is {other}; rename it" in message


def test_files_that_are_not_there(tmp_path):
    assert "there is no such file" in refusal(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    assert "cannot be read" in refusal(tmp_path / "folder.stl")
    assert "is empty" in refusal(write(tmp_path / "a.obj", b""))


def test_files_without_triangles(tmp_path):
    assert "no triangles" in refusal(write(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\n"))
    assert "no triangles" in refusal(write(tmp_path / "a.obj", "# nothing\n"))
    assert "no triangles" in refusal(write(tmp_path / "a.stl", bytes(84)))
    assert "no triangles" in refusal(write(tmp_path / "a.stl", "solid a\nendsolid a\n"))
    assert "no triangles" in refusal(write(tmp_path / "a.ply", ascii_ply("", 0)))


def test_polygons_are_not_cut_up(tmp_path):
    for faces, count in (("4 0 1 2 3\n", 1), ("3 0 2 1\n4 0 1 2 3\n", 2)):
        assert "polygons" in refusal(write(tmp_path / "a.ply", ascii_ply(faces, count)))
    assert "polygons" in refusal(write(tmp_path / "a.obj", TETRA_OBJ + "f 1 2 3 4\n"))


@pytest.mark.parametrize(
    "line", ["f 1 2", "f 1 2 x", "f 0 1 2", "f 1 2 9", "f 1 2 -9", "v 1 2", "v 1 2 z", "v 1 nan 2", "v 1 2 inf", "f"]
)
def test_bad_lines_of_an_obj(tmp_path, line):
    assert "a.obj" in refusal(write(tmp_path / "a.obj", TETRA_OBJ + line + "\n"))


def test_coordinates_that_are_not_finite(body, tmp_path):
    for value in (np.nan, np.inf):
        data = bytearray(encode_mesh(body, "stl"))
        data[96:100] = struct.pack("<f", value)
        assert "finite" in refusal(write(tmp_path / "a.stl", bytes(data)))
        data = bytearray(encode_mesh(body, "ply"))
        start = data.index(b"end_header\n") + 11
        data[start : start + 8] = struct.pack("<d", value)
        assert "finite" in refusal(write(tmp_path / "a.ply", bytes(data)))
        text = ascii_stl(body).split("VERTEX ", 1)
        text[1] = text[1].partition("\n")[2]
        assert "finite" in refusal(write(tmp_path / "a.stl", f"VERTEX {value} 0 0\n".join(text)))


def glb(header: dict, binary: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize(
    "change",
    [
        {"extensionsRequired": ["KHR_draco_mesh_compression"]},
        {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 1}]}]},
        {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}]},
        {"accessors": [{"sparse": {}, "componentType": 5126, "count": 3, "type": "VEC3"}]},
    ],
)
def test_a_glb_that_trimesh_would_read_as_less_than_it_is(tmp_path, change):
    base = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "buffers": [{"byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    }  # fmt: skip
    corners = np.eye(3, dtype="<f4").tobytes()
    assert read_mesh(write(tmp_path / "a.glb", glb(base, corners))).vertices.tolist() == np.eye(3).tolist()
    assert "plain triangles" in refusal(write(tmp_path / "a.glb", glb(base | change, corners)))


def test_a_3mf_with_a_word_for_a_number(body, tmp_path):
    path = tmp_path / "a.3mf"
    write_mesh(path, bumpy(1))
    with zipfile.ZipFile(path) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    first = model.split(' x="')[3].split('"')[0]
    assert "truncated" in refusal(remodel(path, f' x="{first}"', ' x="word"'))


# --- writing


def test_a_full_disk_leaves_nothing(body, tmp_path):
    pytest.importorskip("resource")
    code = """
        import resource, sys
        from lithoform.errors import OutputError
        from lithoform.mesh_io import write_mesh
        from lithoform.topology import sphere
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        try:
            write_mesh(sys.argv[1], sphere("octahedral", 8))
        except OutputError as error:
            print(error)
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-B", "-W", "error", "-c", textwrap.dedent(code), str(tmp_path / "a.ply")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.stderr == ""
    assert done.stdout.startswith(f"cannot write {tmp_path / 'a.ply'}: ")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_write_leaves_nothing(body, tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_mesh(tmp_path / "a.stl", body)
    assert list(tmp_path.iterdir()) == []


def test_writing_where_it_cannot_be(body, tmp_path):
    with pytest.raises(OutputError, match="its folder does not exist"):
        write_mesh(tmp_path / "none" / "a.stl", body)
    (tmp_path / "a.stl").mkdir()
    with pytest.raises(OutputError, match="a folder of that name is in the way"):
        write_mesh(tmp_path / "a.stl", body)


def test_the_format_may_be_told(body, tmp_path):
    digest = write_mesh(tmp_path / "a.dat", body, format="ply", unit="m")
    assert digest == hashlib.sha256(encode_mesh(body, "ply", unit="m")).hexdigest()


def test_importing_loads_nothing_heavy():
    code = "import sys, lithoform.mesh_io; print({'trimesh', 'lxml', 'networkx', 'scipy'} & set(sys.modules))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == "set()"


def test_nothing_warns(body, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ALL:
            write_mesh(tmp_path / f"a.{name}", body)
            read_mesh(tmp_path / f"a.{name}")
