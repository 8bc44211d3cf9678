"""Makers of damaged meshes: each takes a whole body's arrays, and returns arrays or the bytes of a file."""

from __future__ import annotations

import base64
import json
import struct
import zlib

import numpy as np

from lithoform.mesh import Mesh
from lithoform.mesh_io import encode_mesh
from lithoform.topology import sphere

Arrays = tuple[np.ndarray, np.ndarray]


def stone(n: int = 20) -> Arrays:
    """A star-shaped body of about 25 mm, in millimetres, away from the origin, with coordinates that float32 holds."""
    ball = sphere("octahedral", n)
    x, y, z = ball.vertices.T
    radius = 12.3 * (1 + 0.12 * np.sin(3 * x + 1) * np.cos(3 * y) + 0.05 * np.sin(4 * z))
    vertices = ball.vertices * radius[:, None] * [1.3, 1.0, 0.8] + [1.0, -2.0, 30.0]
    return vertices.astype(np.float32).astype(np.float64), ball.faces.astype(np.int64)


def volume(body: Arrays) -> float:
    a, b, c = (body[0][body[1][:, i]] for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def joined(*bodies: Arrays) -> Arrays:
    offsets = np.cumsum([0] + [len(v) for v, _ in bodies])
    return np.concatenate([v for v, _ in bodies]), np.concatenate(
        [f + o for (_, f), o in zip(bodies, offsets, strict=False)]
    )


def unwelded(body: Arrays) -> Arrays:
    vertices, faces = body
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def about(body: Arrays, direction, count: int) -> np.ndarray:
    """Numbers of the faces farthest in a direction."""
    return np.argsort(-(body[0][body[1]].mean(axis=1) @ np.asarray(direction, float)), kind="stable")[:count]


def without(body: Arrays, *directions_and_counts) -> Arrays:
    gone = np.concatenate([about(body, d, n) for d, n in directions_and_counts])
    return body[0], np.delete(body[1], gone, axis=0)


def turned(body: Arrays, faces) -> Arrays:
    out = body[1].copy()
    out[faces] = out[faces][:, ::-1]
    return body[0], out


def jittered(body: Arrays, size: float) -> Arrays:
    """Corners that do not quite meet: off by up to `size` each way."""
    vertices, faces = unwelded(body)
    return vertices + np.random.default_rng(1).uniform(-size, size, vertices.shape), faces


def moved(body: Arrays, by, scale: float = 1.0) -> Arrays:
    centre = body[0].mean(axis=0)
    return (body[0] - centre) * scale + centre + np.asarray(by, float), body[1]


def with_vertex(body: Arrays, vertex: int, position) -> Arrays:
    out = body[0].copy()
    out[vertex] = position
    return out, body[1]


def with_fin(body: Arrays) -> Arrays:
    """One face that stands on an edge of the body."""
    a, b = body[1][100][:2]
    tip = body[0][a] + 0.3 * (body[0][a] - body[0].mean(axis=0))
    return np.concatenate([body[0], [tip]]), np.concatenate([body[1], [[a, b, len(body[0])]]])


def with_wall(body: Arrays) -> Arrays:
    """The body's equator closed by a fan to its middle: edges of three faces all around."""
    vertices, faces = body
    unit = sphere("octahedral", 20).vertices
    rim = np.flatnonzero(unit[:, 2] == 0.0)
    rim = rim[np.argsort(np.arctan2(unit[rim, 1], unit[rim, 0]), kind="stable")]
    middle = len(vertices)
    fan = np.stack([rim, np.roll(rim, -1), np.full(len(rim), middle)], axis=1)
    return np.concatenate([vertices, [vertices.mean(axis=0)]]), np.concatenate([faces, fan])


def pinched(body: Arrays) -> Arrays:
    """A small body that shares one vertex with the large one."""
    small = moved(body, (0, 0, 0), 0.2)
    top, bottom = int(body[0][:, 2].argmax()), int(small[0][:, 2].argmin())
    small = (small[0] - small[0][bottom] + body[0][top], small[1])
    vertices, faces = joined(body, small)
    faces[faces == bottom + len(body[0])] = top
    return vertices, faces


def touching_edge(body: Arrays) -> Arrays:
    """A tetrahedron that shares one edge with the body: an edge of four faces."""
    vertices, faces = body
    a, b = faces[about(body, (0, 0, 1), 1)[0]][:2]
    out = vertices[a] - vertices.mean(axis=0)
    side = np.cross(out, vertices[b] - vertices[a])
    c, d = vertices[a] + 0.3 * out + 0.1 * side, vertices[a] + 0.3 * out - 0.1 * side
    n = len(vertices)
    tetrahedron = np.array([[a, b, n], [b, a, n + 1], [a, n, n + 1], [b, n + 1, n]])
    return np.concatenate([vertices, [c, d]]), np.concatenate([faces, tetrahedron])


def spiked(body: Arrays) -> Arrays:
    """One vertex pulled through the body and out at the other side."""
    top = int(body[0][:, 2].argmax())
    return with_vertex(body, top, body[0].mean(axis=0) - 1.5 * (body[0][top] - body[0].mean(axis=0)))


def folded(body: Arrays) -> Arrays:
    """A patch pushed sideways over its neighbours."""
    vertices = body[0].copy()
    near = np.unique(body[1][about(body, (0, 0, 1), 12)])
    vertices[near] += [2.5, 0.3, 0.05]
    return vertices, body[1]


def noisy(body: Arrays) -> Arrays:
    """A patch of random shifts longer than its edges."""
    vertices = body[0].copy()
    near = np.unique(body[1][about(body, (1, 0, 0), 30)])
    vertices[near] += np.random.default_rng(3).uniform(-1.0, 1.0, (len(near), 3))
    return vertices, body[1]


def slivered(body: Arrays) -> Arrays:
    """Edges cut at a point exactly on them, on one side only: faces without area fill the cuts."""
    vertices, faces = body
    new_vertices, new_faces = [], []
    keep = np.ones(len(faces), bool)
    for k, f in enumerate((50, 500, 1500, 2500)):
        a, b, c = faces[f]
        middle = len(vertices) + k
        new_vertices.append((vertices[a] + vertices[b]) / 2)
        keep[f] = False
        new_faces += [[a, middle, c], [middle, b, c], [a, b, middle]]
    return np.concatenate([vertices, new_vertices]), np.concatenate([faces[keep], new_faces])


def moebius() -> Arrays:
    """A band of two thousand faces with one half twist."""
    n, m = 200, 5
    angle, width = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.linspace(-1, 1, m + 1), indexing="ij")
    radius = 5 + width * np.cos(angle / 2)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), width * np.sin(angle / 2)], axis=-1)
    faces = []
    for i in range(n):
        for j in range(m):
            a, b = i * (m + 1) + j, i * (m + 1) + j + 1
            c, d = a + m + 1, b + m + 1
            if i == n - 1:
                c, d = m - j, m - j - 1
            faces += [[a, c, d], [a, d, b]]
    return vertices.reshape(-1, 3), np.array(faces)


def klein() -> Arrays:
    """A closed surface of one side (the figure-of-eight immersion of Klein's bottle), which has no open edge."""
    n, m = 60, 24
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    r = 4 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    z = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    vertices = np.stack([r * np.cos(u), r * np.sin(u), z], axis=-1).reshape(-1, 3)
    faces = []
    for i in range(n):
        for j in range(m):
            k = (j + 1) % m
            c, d = ((i + 1) * m + j, (i + 1) * m + k) if i < n - 1 else ((m - j) % m, (m - k) % m)
            faces += [[i * m + j, c, d], [i * m + j, d, i * m + k]]
    return vertices, np.array(faces)


def disc(sides: int = 60) -> Arrays:
    angle = np.arange(sides) * 2 * np.pi / sides
    vertices = np.concatenate([np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), np.zeros((1, 3))])
    i = np.arange(sides)
    return vertices, np.stack([i, (i + 1) % sides, np.full(sides, sides)], axis=1)


def torus() -> Arrays:
    u, v = np.meshgrid(np.arange(40) * 2 * np.pi / 40, np.arange(20) * 2 * np.pi / 20, indexing="ij")
    ring = 3 + np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(40), np.arange(20), indexing="ij"))
    a, b = i * 20 + j, (i + 1) % 40 * 20 + j
    c, d = (i + 1) % 40 * 20 + (j + 1) % 20, i * 20 + (j + 1) % 20
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


CUBE = (
    np.array([[x, y, z] for z in (0.0, 10.0) for y in (0.0, 10.0) for x in (0.0, 10.0)]),
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]],
)
"""A cube of 10 mm as six squares."""


def prism(sides: int = 40) -> tuple[np.ndarray, list[list[int]], float]:
    """A prism over a star, 10 mm high: two polygons that are not convex, and squares; with its volume."""
    angle = np.arange(sides) * 2 * np.pi / sides
    radius = np.where(np.arange(sides) % 2, 10.0, 5.0)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    vertices = np.concatenate([np.column_stack([flat, np.full(sides, z)]) for z in (0.0, 10.0)])
    sidewalls = [[i, (i + 1) % sides, (i + 1) % sides + sides, i + sides] for i in range(sides)]
    x, y = flat.T
    base = 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return vertices, [list(range(sides))[::-1], list(range(sides, 2 * sides)), *sidewalls], 10.0 * base


def as_ply_text(vertices, polygons, extra: bool = False) -> bytes:
    lines = ["ply", "format ascii 1.0", "comment made for a test", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"] + (["property uchar red"] if extra else [])
    if len(polygons):
        lines += [f"element face {len(polygons)}", "property list uchar int vertex_indices"]
        lines += ["property float quality"] if extra else []
    lines += ["end_header"]
    lines += [" ".join(map(repr, map(float, v))) + (" 255" if extra else "") for v in vertices]
    lines += [" ".join(map(str, [len(p), *p])) + (" 0.5" if extra else "") for p in polygons]
    return ("\n".join(lines) + "\n").encode()


def as_ply_binary(vertices, polygons, endian: str = "<") -> bytes:
    """With colours, normals and a quality that are not wanted."""
    kind = "little" if endian == "<" else "big"
    header = f"ply\nformat binary_{kind}_endian 1.0\nelement vertex {len(vertices)}\nproperty float nx\n"
    header += "property double x\nproperty double y\nproperty double z\nproperty uchar red\n"
    header += f"element face {len(polygons)}\nproperty uchar flag\nproperty list uchar int vertex_index\n"
    header += "property list uchar float texcoord\nend_header\n"
    rows = b"".join(struct.pack(endian + "fdddB", 0.5, *map(float, v), 7) for v in vertices)
    faces = b"".join(struct.pack(f"{endian}BB{len(p)}iBf", 1, len(p), *map(int, p), 1, 0.25) for p in polygons)
    return header.encode() + rows + faces


def as_obj(vertices, polygons) -> bytes:
    lines = ["# a test", "mtllib stone.mtl", "o stone"] + ["v " + " ".join(map(repr, map(float, v))) for v in vertices]
    lines += ["vt 0 0", "vn 0 0 1", "usemtl rock", "s off"]
    return ("\n".join(lines + ["f " + " ".join(f"{i + 1}/1/1" for i in p) for p in polygons]) + "\n").encode()


def as_off(vertices, polygons, head: str = "OFF\n") -> bytes:
    lines = [f"{head}{len(vertices)} {len(polygons)} 0", "# a comment"]
    lines += [" ".join(map(repr, map(float, v))) for v in vertices]
    return ("\n".join(lines + [" ".join(map(str, [len(p), *p])) + " 200 200 200" for p in polygons]) + "\n").encode()


def as_stl(body: Arrays) -> bytes:
    return encode_mesh(Mesh(body[0] / 1000, body[1]), "stl", unit="mm")


def as_stl_text(body: Arrays, end: str = "endsolid a facet of rock\n") -> bytes:
    rows = []
    for triangle in body[0][body[1]].tolist():
        corners = "".join(f"      vertex {x!r} {y!r} {z!r}\n" for x, y, z in triangle)
        rows.append(f"  facet normal nan nan nan\n    outer loop\n{corners}    endloop\n  endfacet\n")
    return ("solid a facet of rock\n" + "".join(rows) + end).encode()


def as_scene(body: Arrays, name: str) -> bytes:
    return encode_mesh(Mesh(body[0] / 1000, body[1]), name, unit="mm")


def as_gltf(body: Arrays, side_file: str | None = None) -> tuple[bytes, bytes]:
    """A gltf of metres and its buffer, embedded unless a side file is named."""
    vertices, faces = (body[0] / 1000).astype("<f4"), body[1].astype("<u4")
    buffer = vertices.tobytes() + faces.tobytes()
    uri = side_file or "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(buffer), "uri": uri}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": vertices.nbytes},
            {"buffer": 0, "byteOffset": vertices.nbytes, "byteLength": faces.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
    }
    return json.dumps(header).encode(), buffer


def as_vtp(vertices, polygons, form: str = "ascii", what: str = "Polys") -> bytes:
    """VTK's XML: written out by hand, as text, as base64 of zlib, or appended raw."""
    flat = [i for p in polygons for i in p]
    arrays = {
        "points": np.asarray(vertices, "<f8"),
        "connectivity": np.array(flat, "<i8"),
        "offsets": np.cumsum([len(p) for p in polygons]).astype("<i8"),
    }
    appended = b""
    blocks = {}
    for name, array in arrays.items():
        kind = "Float64" if array.dtype.kind == "f" else "Int64"
        name_of = "" if name == "points" else f' Name="{name}"'
        head = f'<DataArray type="{kind}"{name_of} NumberOfComponents="{3 if name == "points" else 1}"'
        raw = array.tobytes()
        if form == "ascii":
            blocks[name] = f'{head} format="ascii">{" ".join(map(repr, array.ravel().tolist()))}</DataArray>'
        elif form == "zlib":
            packed = zlib.compress(raw)
            sizes = struct.pack("<4Q", 1, len(raw), 0, len(packed))
            text = base64.b64encode(sizes).decode() + base64.b64encode(packed).decode()
            blocks[name] = f'{head} format="binary">{text}</DataArray>'
        else:
            blocks[name] = f'{head} format="appended" offset="{len(appended)}"/>'
            appended += struct.pack("<Q", len(raw)) + raw
    compressor = ' compressor="vtkZLibDataCompressor"' if form == "zlib" else ""
    counts = "".join(
        f' NumberOf{k}="{len(polygons) if k == what else 0}"' for k in ("Verts", "Lines", "Strips", "Polys")
    )
    head = (
        f'<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64"{compressor}>\n<PolyData><Piece NumberOfPoints="{len(vertices)}"{counts}>\n'
        f"<Points>{blocks['points']}</Points>\n<{what}>{blocks['connectivity']}{blocks['offsets']}</{what}>\n"
        "</Piece></PolyData>\n"
    ).encode()
    tail = b'<AppendedData encoding="raw">\n_' + appended + b"\n</AppendedData>\n" if form == "appended" else b""
    return head + tail + b"</VTKFile>\n"
