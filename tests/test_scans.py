"""Scans from files: every format read exactly, every damage repaired and told or refused by name, no batch stopped."""

from __future__ import annotations

import csv
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import damage
import numpy as np
import pytest

from lithoform.errors import FileFormatError
from lithoform.scans.reading import Scan, ScanFailure, find_scans, read_scan, read_scans
from lithoform.soundness import check

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
STONE = damage.stone()
VOLUME = damage.volume(STONE)
PRISM = damage.prism()
JUNK = bytes(np.random.default_rng(5).integers(0, 256, 5000, dtype=np.uint8))
BIG = (0, 0, 1)


@dataclass
class Reads:
    """A file that is read: its content's format, what is told of it, and how near its volume [mm^3] is."""

    format: str
    repairs: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    volume: float = VOLUME
    within: float = 1e-6


@dataclass
class Refused:
    """A file that is refused, with what its one sentence holds."""

    words: tuple[str, ...]

    def __init__(self, *words: str) -> None:
        self.words = words


def half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def stl(body: damage.Arrays) -> bytes:
    return damage.as_stl(body)


def ply(body: damage.Arrays) -> bytes:
    return damage.as_ply_binary(*body)


def with_count(data: bytes, count: int) -> bytes:
    return data[:80] + np.uint32(count).tobytes() + data[84:]


WELDED = ("merged 9,600 corners into 1,602 vertices",)
HOLE_1 = damage.without(STONE, (BIG, 20))
LIES = with_count(stl(STONE), 0)
# The file, what is in it, and what becomes of it.
ROWS: dict[str, tuple[str, Callable[[], bytes], Reads | Refused]] = {
    # whole, in every format
    "stl": ("a.stl", lambda: stl(STONE), Reads("stl", (), WELDED)),
    "stl that says solid": ("b.stl", lambda: b"solid".ljust(80) + stl(STONE)[80:], Reads("stl", (), WELDED)),
    "stl of no count": ("c.stl", lambda: LIES, Reads("stl", ("promises 0 triangles, but 3,200",), WELDED)),
    "stl of too large a count": ("d.stl", lambda: with_count(stl(STONE), 9999), Reads("stl", ("9,999",), WELDED)),
    "stl with a tail": ("e.stl", lambda: stl(STONE) + b"tail", Reads("stl", ("ignored 4 bytes",), WELDED)),
    "text stl": ("f.stl", lambda: damage.as_stl_text(STONE), Reads("stl", (), WELDED)),
    "text stl in capitals": ("g.STL", lambda: damage.as_stl_text(STONE).upper(), Reads("stl", (), WELDED)),
    "text stl without its end": ("h.stl", lambda: damage.as_stl_text(STONE, ""), Reads("stl", (), WELDED)),
    "text stl with a byte order mark": (
        "bom.stl",
        lambda: b"\xef\xbb\xbf" + damage.as_stl_text(STONE),
        Reads("stl", (), WELDED),
    ),
    "obj of an old Macintosh": ("m.obj", lambda: damage.as_obj(*STONE).replace(b"\n", b"\r"), Reads("obj")),
    "text ply": ("a.ply", lambda: damage.as_ply_text(*STONE, extra=True), Reads("ply")),
    "binary ply": ("b.ply", lambda: ply(STONE), Reads("ply")),
    "big-endian ply": ("c.ply", lambda: damage.as_ply_binary(*STONE, ">"), Reads("ply")),
    "obj": ("a.obj", lambda: damage.as_obj(*STONE), Reads("obj")),
    "off": ("a.off", lambda: damage.as_off(*STONE), Reads("off")),
    "off in one line": ("b.off", lambda: damage.as_off(*STONE, head="OFF "), Reads("off")),
    "glb": ("a.glb", lambda: damage.as_scene(STONE, "glb"), Reads("glb")),
    "gltf": ("a.gltf", lambda: damage.as_gltf(STONE)[0], Reads("gltf")),
    "3mf": ("a.3mf", lambda: damage.as_scene(STONE, "3mf"), Reads("3mf")),
    "text vtp": ("a.vtp", lambda: damage.as_vtp(*STONE), Reads("vtp")),
    "zlib vtp": ("b.vtp", lambda: damage.as_vtp(*STONE, "zlib"), Reads("vtp")),
    "appended vtp": ("c.vtp", lambda: damage.as_vtp(*STONE, "appended"), Reads("vtp")),
    # polygons
    "squares in obj": ("quads.obj", lambda: damage.as_obj(*damage.CUBE), Reads("obj", (), ("cut 6 p",), 1000.0)),
    "squares in text ply": ("q.ply", lambda: damage.as_ply_text(*damage.CUBE), Reads("ply", (), ("cut 6 p",), 1000.0)),
    "squares in off": ("quads.off", lambda: damage.as_off(*damage.CUBE), Reads("off", (), ("cut 6 p",), 1000.0)),
    "stars in ply": ("p.ply", lambda: damage.as_ply_binary(*PRISM[:2]), Reads("ply", (), ("cut 42",), PRISM[2])),
    "stars in text ply": ("r.ply", lambda: damage.as_ply_text(*PRISM[:2]), Reads("ply", (), ("cut 42",), PRISM[2])),
    "stars in vtp": ("p.vtp", lambda: damage.as_vtp(*PRISM[:2]), Reads("vtp", (), ("cut 42",), PRISM[2])),
    "stars in obj": ("p.obj", lambda: damage.as_obj(*PRISM[:2]), Reads("obj", (), ("cut 42",), PRISM[2])),
    # damage of the surface
    "unwelded ply": ("u.ply", lambda: ply(damage.unwelded(STONE)), Reads("ply", (), WELDED)),
    "corners 2 um off": (
        "j.ply",
        lambda: ply(damage.jittered(STONE, 2e-3)),
        Reads("ply", ("merged 7,998 vertices on open edges",), (), VOLUME, 1e-4),
    ),
    "some faces turned": (
        "turned.ply",
        lambda: ply(damage.turned(STONE, np.arange(0, 3200, 7))),
        Reads("ply", ("turned 458 faces",)),
    ),
    "inside out": ("in.stl", lambda: stl(damage.turned(STONE, slice(None))), Reads("stl", ("inside out",), WELDED)),
    "one hole": ("hole.stl", lambda: stl(HOLE_1), Reads("stl", ("filled 1 hole, 0.72 %",), ("merged",), VOLUME, 1e-3)),
    "four holes": (
        "holes.ply",
        lambda: ply(damage.without(STONE, (BIG, 20), ((1, 0, 0), 40), ((0, 1, 0), 1), ((0, -1, 0), 6))),
        Reads("ply", ("filled 4 holes",), (), VOLUME, 2e-3),
    ),
    "large hole": (
        "large.ply",
        lambda: ply(damage.without(STONE, (BIG, 200))),
        Reads("ply", ("filled 1 hole, 6.8 %",), (), VOLUME, 1e-2),
    ),
    "open scan": ("open.ply", lambda: ply(damage.without(STONE, (BIG, 1000))), Refused("open", "1 hole", "31 %")),
    "doubled faces": (
        "double.ply",
        lambda: ply((STONE[0], np.concatenate([STONE[1], STONE[1][:50]]))),
        Reads("ply", ("dropped 50 faces that came twice",)),
    ),
    "both sides": (
        "sides.ply",
        lambda: ply((STONE[0], np.concatenate([STONE[1], STONE[1][:, ::-1]]))),
        Reads("ply", ("dropped 3,200 faces that came twice",)),
    ),
    "doubled body": (
        "bodies.ply",
        lambda: ply(damage.joined(STONE, STONE)),
        Reads("ply", ("1 smaller piece with 50 %",)),
    ),
    "not a number": (
        "nan.ply",
        lambda: damage.as_ply_text(*damage.with_vertex(STONE, 500, np.nan)),
        Reads("ply", ("dropped 6 faces with corners that are not finite", "filled 1 hole"), (), VOLUME, 1e-4),
    ),
    "infinite": (
        "inf.stl",
        lambda: stl(STONE)[:96] + np.float32(np.inf).tobytes() + stl(STONE)[100:],
        Reads("stl", ("dropped 1 face with corners", "filled 1 hole"), ("merged",), VOLUME, 1e-4),
    ),
    "one point far away": (
        "far.ply",
        lambda: ply(damage.with_vertex(STONE, 500, [1e30, 0, 0])),
        Reads("ply", ("dropped 6 faces with corners",), (), VOLUME, 1e-4),
    ),
    "all far away": ("huge.ply", lambda: ply((STONE[0] * 1e30, STONE[1])), Reads("ply", (), (), VOLUME * 1e90)),
    "two pieces": (
        "two.ply",
        lambda: ply(damage.joined(damage.moved(STONE, (60, 0, 0), 0.3), STONE)),
        Reads("ply", ("dropped 1 smaller piece with 8.3 % of the area",)),
    ),
    "a cavity": (
        "bubble.ply",
        lambda: ply(damage.joined(STONE, damage.turned(damage.moved(STONE, (0, 0, 0), 0.3), slice(None)))),
        Reads("ply", ("1 of them inside the body",)),
    ),
    "pieces that meet at a point": (
        "pinched.ply",
        lambda: ply(damage.pinched(STONE)),
        Reads("ply", ("1 smaller piece",)),
    ),
    "pieces that meet at an edge": (
        "edge.ply",
        lambda: ply(damage.touching_edge(STONE)),
        Reads("ply", ("dropped 4 faces on edges with more than two",)),
    ),
    "a fin": ("fin.ply", lambda: ply(damage.with_fin(STONE)), Reads("ply", ("dropped 1 face on edges with more",))),
    "an inner wall": ("wall.ply", lambda: ply(damage.with_wall(STONE)), Reads("ply", ("dropped 80 faces on edges",))),
    "a spike through the body": (
        "spike.ply",
        lambda: ply(damage.spiked(STONE)),
        Reads("ply", ("where the surface crossed",), (), VOLUME, 1e-3),
    ),
    "a folded patch": (
        "folded.ply",
        lambda: ply(damage.folded(STONE)),
        Reads("ply", ("where the surface crossed",), (), VOLUME, 1e-3),
    ),
    "a patch of noise": (
        "noisy.ply",
        lambda: ply(damage.noisy(STONE)),
        Reads("ply", ("where the surface crossed",), (), VOLUME, 1e-3),
    ),
    "faces without area": ("sliver.ply", lambda: ply(damage.slivered(STONE)), Reads("ply", ("resolved 4 faces",))),
    "sixty faces lost": (
        "sieve.ply",
        lambda: ply((STONE[0], np.delete(STONE[1], np.random.default_rng(0).choice(3200, 60, False), axis=0))),
        Reads("ply", ("filled 51 holes",), (), VOLUME, 1e-3),
    ),
    # no solid
    "a band of one side": ("moebius.ply", lambda: ply(damage.moebius()), Refused("one side only")),
    "a bottle of one side": ("klein.ply", lambda: ply(damage.klein()), Refused("one side only")),
    "a ring": ("torus.ply", lambda: ply(damage.torus()), Refused("1 tunnel")),
    "a disc": ("disc.ply", lambda: ply(damage.disc()), Refused("flat")),
    "all at one place": ("dot.ply", lambda: ply((STONE[0] * 0, STONE[1])), Refused("at one place")),
    "one face": ("one.stl", lambda: stl((STONE[0], STONE[1][:1])), Refused("1 usable triangle")),
    "empty stl": ("empty.stl", lambda: stl(STONE)[:80] + bytes(4), Refused("no stl file")),
    "empty ply": ("empty.ply", lambda: damage.as_ply_text([], []), Refused("no triangles")),
    "empty off": ("empty.off", lambda: damage.as_off([], []), Refused("0 points and no triangles")),
    "cloud ply": (
        "cloud.ply",
        lambda: damage.as_ply_text(STONE[0], []),
        Refused("1,602 points and no triangles", "MeshLab"),
    ),
    "cloud obj": ("cloud.obj", lambda: damage.as_obj(STONE[0], []), Refused("1,602 points and no triangles")),
    "cloud vtp": ("cloud.vtp", lambda: damage.as_vtp(STONE[0], []), Refused("1,602 points and no triangles")),
    "lines obj": ("lines.obj", lambda: damage.as_obj(STONE[0], []) + b"l 1 2 3\nl 4 5\n", Refused("no triangles")),
    "lines vtp": ("lines.vtp", lambda: damage.as_vtp(*STONE, what="Lines"), Refused("no triangles")),
    # broken files
    "nothing": ("zero.ply", lambda: b"", Refused("it is empty")),
    "half an stl": ("half.stl", lambda: half(stl(STONE)), Refused("promises 3,200 triangles")),
    "an stl cut between triangles": (
        "cut.stl",
        lambda: stl(STONE)[: 84 + 50 * 3000],
        Refused("promises 3,200 triangles, but it holds 3,000", "truncated"),
    ),
    "half a text stl": ("half_text.stl", lambda: half(damage.as_stl_text(STONE)), Refused("truncated")),
    "half a ply": ("half.ply", lambda: half(ply(STONE)), Refused("3,200 of face", "truncated")),
    "half a text ply": ("half_text.ply", lambda: half(damage.as_ply_text(*STONE)), Refused("1,602 of vertex")),
    "half a header": ("header.ply", lambda: ply(STONE)[:60], Refused("its header has no end")),
    "half an obj": (
        "half.obj",
        lambda: half(damage.as_obj(*STONE)),
        Refused("vertex 1,570 has 2 numbers", "truncated"),
    ),
    "half an off": ("half.off", lambda: half(damage.as_off(*STONE)), Refused("3,200 faces", "truncated")),
    "half a glb": ("half.glb", lambda: half(damage.as_scene(STONE, "glb")), Refused("truncated")),
    "half a gltf": ("half.gltf", lambda: half(damage.as_gltf(STONE)[0]), Refused("truncated")),
    "half a 3mf": ("half.3mf", lambda: half(damage.as_scene(STONE, "3mf")), Refused("truncated")),
    "half a vtp": ("half.vtp", lambda: half(damage.as_vtp(*STONE)), Refused("truncated")),
    "half a zlib vtp": ("half_zlib.vtp", lambda: half(damage.as_vtp(*STONE, "zlib")), Refused("truncated")),
    "words in stl": (
        "w.stl",
        lambda: damage.as_stl_text(STONE).replace(b"3", b"x", 1),
        Refused("expected a number, got"),
    ),
    "words in ply": (
        "w.ply",
        lambda: damage.as_ply_text(STONE[0], [["a", 1, 2]]),
        Refused("expected a number, got 'a'"),
    ),
    "words in obj": ("w.obj", lambda: b"v 1 two 3\nf 1 1 1\n", Refused("expected a number, got 'two'")),
    "words in off": ("w.off", lambda: b"OFF\n1 1 0\nx y z\n3 0 0 0\n", Refused("expected a number, got 'x'")),
    "a face to nowhere": (
        "nowhere.obj",
        lambda: damage.as_obj(*STONE) + b"f 1 2 9999\n",
        Refused("vertex 9998 of 1602"),
    ),
    "a gltf without its buffer": (
        "side.gltf",
        lambda: damage.as_gltf(STONE, "gone.bin")[0],
        Refused("gone.bin", "beside"),
    ),
    "noise as stl": ("junk.stl", lambda: JUNK, Refused("stl")),
    "noise as glb": ("junk.glb", lambda: JUNK, Refused("does not begin as a glb")),
    "noise as vtp": ("junk.vtp", lambda: JUNK, Refused("no vtp file")),
    "noise as 3mf": ("junk.3mf", lambda: JUNK, Refused("does not begin as a 3mf")),
    "a web page": ("page.obj", lambda: b"<html><body>404 not found</body></html>", Refused("no triangles")),
    # misnamed
    "stl named ply": (
        "n.ply",
        lambda: stl(STONE),
        Reads("stl", ("its name says .ply, but its content is stl",), WELDED),
    ),
    "ply named stl": ("n.stl", lambda: ply(STONE), Reads("ply", ("its name says .stl, but its content is ply",))),
    "obj named off": (
        "n.off",
        lambda: damage.as_obj(*STONE),
        Reads("obj", ("its name says .off, but its content is obj",)),
    ),
    "off named obj": (
        "n.obj",
        lambda: damage.as_off(*STONE),
        Reads("off", ("its name says .obj, but its content is off",)),
    ),
    "glb named gltf": ("n.gltf", lambda: damage.as_scene(STONE, "glb"), Reads("glb", ("its content is glb",))),
    "text named glb": ("n.glb", lambda: damage.as_stl_text(STONE), Reads("stl", ("its content is stl",), WELDED)),
    "vtp named txt": ("n.txt", lambda: damage.as_vtp(*STONE), Reads("vtp", ("its name says .txt",))),
    "a note": ("note.txt", lambda: b"a note\n", Refused("neither its name nor its content")),
    "a folder": ("folder.stl", lambda: b"", Refused("cannot be read")),
    "no file": ("missing.ply", lambda: b"", Refused("no such file")),
}


@pytest.fixture(scope="module")
def batch(tmp_path_factory) -> dict[str, Scan | ScanFailure]:
    """All rows written and read in one batch."""
    folder = tmp_path_factory.mktemp("scans")
    for name, (file, make, _) in ROWS.items():
        if name == "a folder":
            (folder / file).mkdir()
        elif name != "no file":
            (folder / file).write_bytes(make())
    results = list(read_scans([folder / file for file, _, _ in ROWS.values()]))
    assert [result.path.name for result in results] == [file for file, _, _ in ROWS.values()]
    return dict(zip(ROWS, results, strict=True))


@pytest.mark.parametrize("name", ROWS)
def test_each_file_is_read_and_told_or_refused_by_name(batch, name):
    result, expected = batch[name], ROWS[name][2]
    if isinstance(expected, Refused):
        assert isinstance(result, ScanFailure)
        assert result.error.startswith(f"{result.path}: ")
        assert "unexpectedly" not in result.error
        assert "\n" not in result.error
        assert result.error.endswith(".")
        for word in expected.words:
            assert word in result.error
        return
    assert isinstance(result, Scan), result.error
    assert check(result.mesh).sound
    assert result.source_format == expected.format
    assert result.mesh.volume * 1e9 == pytest.approx(expected.volume, rel=expected.within)
    assert (len(result.repairs) == 0) == (len(expected.repairs) == 0)
    for told, words in ((result.repairs, expected.repairs), (result.reading, expected.reading)):
        for word in words:
            assert any(word in sentence for sentence in told), told
    assert len(result.reading) == len(expected.reading)


def test_no_two_rows_share_a_file():
    assert len({file.lower() for file, _, _ in ROWS.values()}) == len(ROWS)


@pytest.mark.parametrize("name", ["text ply", "binary ply", "obj", "off", "text vtp", "zlib vtp"])
def test_whole_files_of_doubles_come_back_bit_for_bit(batch, name):
    np.testing.assert_array_equal(batch[name].mesh.vertices, STONE[0] / 1000)
    np.testing.assert_array_equal(batch[name].mesh.faces, STONE[1])


def test_every_cut_of_every_format_is_read_or_refused(tmp_path):
    """A file may end anywhere; the batch goes on, and what is read is sound."""
    body = damage.stone(4)
    whole = {
        "stl": stl(body), "text.stl": damage.as_stl_text(body), "ply": ply(body), "text.ply": damage.as_ply_text(*body),
        "obj": damage.as_obj(*body), "off": damage.as_off(*body), "glb": damage.as_scene(body, "glb"),
        "gltf": damage.as_gltf(body)[0], "3mf": damage.as_scene(body, "3mf"), "vtp": damage.as_vtp(*body, "zlib"),
        "raw.vtp": damage.as_vtp(*body, "appended"),
    }  # fmt: skip
    rng = np.random.default_rng(8)
    paths = []
    for ending, data in whole.items():
        for k, cut in enumerate(rng.integers(1, len(data), 12)):
            paths.append(tmp_path / f"{k}.{ending}")
            paths[-1].write_bytes(data[:cut])
        for k in range(12):
            paths.append(tmp_path / f"changed{k}.{ending}")
            changed = bytearray(data)
            for place in rng.integers(0, len(data), 3):
                changed[place] = rng.integers(0, 256)
            paths[-1].write_bytes(bytes(changed))
    results = list(read_scans(paths))
    assert len(results) == len(paths)
    for result in results:
        if isinstance(result, ScanFailure):
            assert result.error.startswith(f"{result.path}: ")
            assert "unexpectedly" not in result.error
        else:
            assert check(result.mesh).sound


def test_a_gltf_finds_its_buffer_beside_it(tmp_path):
    header, buffer = damage.as_gltf(STONE, "stone.bin")
    (tmp_path / "stone.gltf").write_bytes(header)
    (tmp_path / "stone.bin").write_bytes(buffer)
    scan = read_scan(tmp_path / "stone.gltf", unit="m")
    assert scan.mesh.volume * 1e9 == pytest.approx(VOLUME, rel=1e-6)


@pytest.mark.parametrize("packer", ["zlib", "lzma", "lz4", None])
@pytest.mark.parametrize("mode", ["ascii", "binary", "appended", "raw"])
@pytest.mark.parametrize("header", [32, 64])
def test_what_vtk_itself_writes_is_read(tmp_path, packer, mode, header):
    core = pytest.importorskip("vtkmodules.vtkCommonCore")
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    points, cells, body = core.vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetData(numpy_to_vtk(STONE[0], deep=1))
    cells.SetData(3, numpy_to_vtkIdTypeArray(STONE[1].ravel(), deep=1))
    body.SetPoints(points)
    body.SetPolys(cells)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.SetInputData(body)
    {None: writer.SetCompressorTypeToNone, "zlib": writer.SetCompressorTypeToZLib,
     "lzma": writer.SetCompressorTypeToLZMA, "lz4": writer.SetCompressorTypeToLZ4}[packer]()  # fmt: skip
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "appended")
    writer.SetHeaderType(header)
    assert writer.Write()
    # Text names the packer of the writer, and is not packed.
    if packer == "lz4" and mode != "ascii":
        with pytest.raises(FileFormatError, match=r"packed by vtkLZ4DataCompressor.*zlib"):
            read_scan(tmp_path / "a.vtp")
        return
    scan = read_scan(tmp_path / "a.vtp")
    # VTK writes text with fewer digits than a double has.
    np.testing.assert_allclose(scan.mesh.vertices, STONE[0] / 1000, rtol=0, atol=1e-9 if mode == "ascii" else 0)
    np.testing.assert_array_equal(scan.mesh.faces, STONE[1])


def test_strips_of_a_vtp_are_wound_one_way(tmp_path):
    """An octahedron as one strip about its middle and two faces."""
    vertices = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    strip = [0, 4, 1, 2, 5, 3, 0, 4]
    faces = [[1, 0, 5], [1, 5, 2], [4, 3, 2], [4, 2, 1]]
    flat, row = (" ".join(map(str, values)) for values in (vertices.ravel(), strip))
    polys = "".join(f"{a} {b} {c} " for a, b, c in faces)
    (tmp_path / "a.vtp").write_text(
        '<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="6" NumberOfStrips="1" NumberOfPolys="4"><Points>'
        f'<DataArray type="Float32">{flat}</DataArray></Points><Strips><DataArray type="Int32" Name="connectivity">'
        f'{row}</DataArray><DataArray type="Int32" Name="offsets">{len(strip)}</DataArray></Strips>'
        f'<Polys><DataArray type="Int32" Name="connectivity">{polys}</DataArray><DataArray type="Int32" Name="offsets">'
        "3 6 9 12</DataArray></Polys></Piece></PolyData></VTKFile>"
    )
    scan = read_scan(tmp_path / "a.vtp", unit="m")
    assert scan.mesh.volume == pytest.approx(4 / 3, rel=1e-12)


def test_the_unit_scales_the_formats_that_do_not_tell_theirs(tmp_path):
    for name, data in (("a.off", damage.as_off(*STONE)), ("a.glb", damage.as_scene(STONE, "glb"))):
        (tmp_path / name).write_bytes(data)
    in_mm, in_inches = (read_scan(tmp_path / "a.off", unit=unit).mesh.volume for unit in ("mm", "in"))
    assert in_inches / in_mm == pytest.approx(25.4**3, rel=1e-12)
    assert read_scan(tmp_path / "a.glb", unit="in").mesh.volume == pytest.approx(in_mm, rel=1e-6)
    with pytest.raises(FileFormatError, match="expected a unit"):
        list(read_scans([tmp_path / "a.off"], unit="parsec"))


def test_without_repair_a_fault_is_an_error_and_a_whole_file_is_not(tmp_path):
    (tmp_path / "whole.stl").write_bytes(stl(STONE))
    (tmp_path / "hole.stl").write_bytes(stl(HOLE_1))
    assert read_scan(tmp_path / "whole.stl", repair=False).repairs == ()
    with pytest.raises(FileFormatError, match=r"hole\.stl: .*open edges.*read it with repair"):
        read_scan(tmp_path / "hole.stl", repair=False)


def test_folders_stand_for_the_scans_in_them(tmp_path):
    for name in ("b.stl", "a.PLY", "sub/c.obj", "A-anm-1.dat", "plain.dat", "X-geom.dat", "log.dat", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "plain.dat").write_bytes(b"  0 0 3.5 0.0\n")
    (tmp_path / "log.dat").write_bytes(b"a log\n")
    (tmp_path / "X-geom.dat").write_bytes(b"Name xlow xhi ylow yhi zlow zhi volume surf_area Nnn\n")
    (tmp_path / "f.stl").mkdir()
    found = [path.relative_to(tmp_path).as_posix() for path in find_scans([tmp_path, tmp_path / "b.stl"])]
    assert found == ["A-anm-1.dat", "a.PLY", "b.stl", "plain.dat", "sub/c.obj"]
    named = [tmp_path / "X-geom.dat", tmp_path / "notes.txt", tmp_path / "none.stl"]
    assert find_scans(named) == named[1:]
    assert find_scans(tmp_path / "b.stl") == [tmp_path / "b.stl"]
    assert [r.path for r in read_scans([tmp_path / "sub", tmp_path / "b.stl"])] == [
        tmp_path / "sub" / "c.obj",
        tmp_path / "b.stl",
    ]
    assert [r.path.name for r in read_scans(str(tmp_path / "sub"))] == ["c.obj"]
    with pytest.raises(FileFormatError, match="table of sizes"):
        read_scan(tmp_path / "X-geom.dat")


def test_coefficients_are_stones_in_millimetres(tmp_path):
    radius = 7.0
    (tmp_path / "s-anm-1.dat").write_text(f"0 0 {float(radius * np.sqrt(4 * np.pi))!r} 0.0\n")
    scan = read_scan(tmp_path / "s-anm-1.dat", unit="m", triangles=80_000)
    assert scan.source_format == "anm"
    assert scan.reading == ("evaluated the coefficients up to degree 0",)
    assert scan.mesh.volume == pytest.approx(4 / 3 * np.pi * 0.007**3, rel=3e-4)
    (tmp_path / "s-anm-2.dat").write_text("0 0 nan 0.0\n")
    (tmp_path / "s-anm-3.dat").write_text("rock\n")
    failures = [r for r in read_scans(find_scans(tmp_path)) if isinstance(r, ScanFailure)]
    assert ["not finite" in failures[0].error, "line 1" in failures[1].error] == [True, True]


def test_an_unforeseen_fault_is_a_failure_of_one_file(monkeypatch, tmp_path):
    (tmp_path / "a.stl").write_bytes(stl(STONE))

    def broken(*_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr("lithoform.scans.reading.decode", broken)
    (failure,) = read_scans([tmp_path / "a.stl"])
    assert isinstance(failure, ScanFailure)
    assert "RuntimeError: boom" in failure.error

    def spent(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("lithoform.scans.reading.decode", spent)
    with pytest.raises(MemoryError):
        list(read_scans([tmp_path / "a.stl"]))


def test_published_scans_keep_their_volume_and_surface():
    """Seven scans of crushed rock, measured by others; their table has eight digits."""
    folder = DATA / "collide"
    if not folder.is_dir():
        pytest.skip("the scans of shared/data are not here")
    with (folder / "descriptors.csv").open() as file:
        table = {row["id"].rpartition("/")[2]: row for row in csv.DictReader(file)}
    scans = list(read_scans(find_scans(folder), unit="m"))
    assert sorted(scan.path.stem for scan in scans) == sorted(table)
    for scan in scans:
        row, properties = table[scan.path.stem], scan.mesh.mass_properties
        assert (scan.repairs, scan.reading, len(scan.mesh.faces)) == ((), (), int(row["triangles"]))
        assert properties.volume == pytest.approx(float(row["V"]), rel=1e-6)
        assert properties.area == pytest.approx(float(row["S"]), rel=1e-6)


def test_importing_scans_loads_nothing_heavy():
    code = (
        "import sys, lithoform.scans.reading; print({'scipy', 'trimesh', 'vtkmodules', 'pyvista'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
