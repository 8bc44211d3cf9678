"""Mesh: mass properties against closed forms, connectivity of known surfaces, errors, ownership of arrays."""

import hashlib
import pickle

import numpy as np
import oracles
import pytest

from lithoform.errors import MeshError
from lithoform.mesh import Connectivity, Mesh
from lithoform.topology import sphere

BOX = (3.0, 2.0, 0.5)
TETRAHEDRON = oracles.TETRAHEDRON


# ------------------------------------------------------------------------------------------------ mass properties


@pytest.mark.parametrize("subdivided", [1, 4])
@pytest.mark.parametrize("turn", [None, 1, 2])
@pytest.mark.parametrize("offset", [(0, 0, 0), (5, -7, 11)])
def test_box(subdivided, turn, offset):
    rotation = np.eye(3) if turn is None else oracles.rotation(turn)
    vertices, faces = oracles.box(BOX, subdivided)
    p = Mesh(vertices @ rotation.T + offset, faces).mass_properties
    assert p.volume == pytest.approx(3.0, rel=1e-13)
    assert p.area == pytest.approx(2 * (6 + 1.5 + 1), rel=1e-13)
    np.testing.assert_allclose(p.centroid, offset, atol=1e-13)
    np.testing.assert_allclose(p.inertia, rotation @ oracles.box_inertia(BOX) @ rotation.T, atol=1e-12)


def test_tetrahedron():
    p = Mesh(*TETRAHEDRON).mass_properties
    assert p.volume == pytest.approx(1 / 6, rel=1e-14)
    assert p.area == pytest.approx(1.5 + np.sqrt(3) / 2, rel=1e-14)
    np.testing.assert_allclose(p.centroid, np.full(3, 0.25), rtol=1e-14)
    np.testing.assert_allclose(p.inertia, oracles.tetrahedron_inertia(), rtol=1e-13)


def test_tetrahedron_by_monte_carlo():
    # The oracle's own closed form, and the mesh, against random points.
    p = Mesh(*TETRAHEDRON).mass_properties
    found, error = oracles.monte_carlo_moments(lambda x: x.sum(axis=1) < 1, np.zeros(3), np.ones(3), 200_000, seed=3)
    second = 0.5 * np.trace(p.inertia) * np.eye(3) - p.inertia + p.volume * np.outer(p.centroid, p.centroid)
    exact = np.concatenate([[p.volume], p.volume * p.centroid, np.diag(second)])
    assert (np.abs(found - exact) < 4 * error).all()


@pytest.mark.parametrize("kind", ["octahedral", "icosahedral"])
def test_ellipsoid_in_the_limit(kind):
    axes = np.array([1.5, 1.0, 0.6])
    rotation = oracles.rotation(7)
    errors = []
    for n in (16, 32):
        ball = sphere(kind, n)
        p = ball.with_vertices((ball.vertices * axes) @ rotation.T).mass_properties
        np.testing.assert_allclose(p.centroid, 0, atol=1e-14)
        exact = rotation @ oracles.ellipsoid_inertia(axes) @ rotation.T
        errors.append([4 * np.pi / 3 * axes.prod() - p.volume, np.abs(p.inertia - exact).max()])
    assert np.allclose(np.divide(*errors), 4, rtol=0.03)  # second order
    assert max(errors[1]) < 0.01


def test_a_body_far_from_the_origin_keeps_its_digits():
    vertices, faces = oracles.box(BOX, 3)
    near = Mesh(vertices, faces).mass_properties
    far = Mesh(vertices + np.array([1e6, -2e6, 3e6]), faces).mass_properties
    # The coordinates themselves are rounded to 4.7e-10 there, a relative 1e-9 of the body.
    assert far.volume == pytest.approx(near.volume, rel=1e-8)
    np.testing.assert_allclose(far.inertia, near.inertia, atol=1e-8)
    np.testing.assert_allclose(far.centroid, [1e6, -2e6, 3e6], rtol=1e-15, atol=1e-9)
    # Offsets that are exact in binary lose nothing at all.
    exact = Mesh(np.round(vertices * 64) / 64 + 2.0**20, faces).mass_properties
    assert exact.volume == pytest.approx(Mesh(np.round(vertices * 64) / 64, faces).mass_properties.volume, rel=1e-13)


def test_additivity():
    # A box cut in two: volumes add, and the inertia follows by the parallel axis theorem.
    left, right = oracles.box((1.0, 2.0, 3.0), 2), oracles.box((0.5, 2.0, 3.0), 2)
    right = (right[0] + [0.75, 0, 0], right[1])
    whole = Mesh(*oracles.joined(left, right)).mass_properties
    parts = [Mesh(*left).mass_properties, Mesh(*right).mass_properties]
    assert whole.volume == pytest.approx(sum(p.volume for p in parts), rel=1e-14)
    centroid = sum(p.volume * p.centroid for p in parts) / whole.volume
    np.testing.assert_allclose(whole.centroid, centroid, atol=1e-15)
    inertia = np.zeros((3, 3))
    for p in parts:
        d = p.centroid - centroid
        inertia += p.inertia + p.volume * (d @ d * np.eye(3) - np.outer(d, d))
    np.testing.assert_allclose(whole.inertia, inertia, atol=1e-13)
    np.testing.assert_allclose(whole.inertia, oracles.box_inertia((1.5, 2.0, 3.0)), atol=1e-13)


def test_a_cavity_is_taken_off():
    outer, inner = oracles.box((2, 2, 2)), oracles.box((1, 1, 1))
    p = Mesh(*oracles.joined(outer, (inner[0], inner[1][:, ::-1]))).mass_properties
    assert p.volume == pytest.approx(7.0)
    np.testing.assert_allclose(p.inertia, oracles.box_inertia((2, 2, 2)) - oracles.box_inertia((1, 1, 1)), atol=1e-13)


def test_reversed_faces_change_the_sign_of_volume_and_inertia_only():
    vertices, faces = oracles.box(BOX, 2)
    a, b = Mesh(vertices, faces).mass_properties, Mesh(vertices, faces[:, ::-1]).mass_properties
    assert b.volume == pytest.approx(-a.volume, rel=1e-14)
    assert b.area == pytest.approx(a.area, rel=1e-14)
    np.testing.assert_allclose(b.centroid, a.centroid, atol=1e-15)
    np.testing.assert_allclose(b.inertia, -a.inertia, atol=1e-14)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e5])
def test_powers_of_the_unit(scale):
    vertices, faces = oracles.box(BOX, 2)
    p = Mesh(vertices * scale, faces).mass_properties
    assert p.volume == pytest.approx(3.0 * scale**3, rel=1e-13)
    np.testing.assert_allclose(p.inertia, oracles.box_inertia(BOX) * scale**5, rtol=1e-12, atol=1e-13 * scale**5)


def test_no_volume_is_an_error():
    flat = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])
    with pytest.raises(MeshError, match="encloses no volume"):
        _ = flat.mass_properties


def test_area_vectors():
    mesh = Mesh(*TETRAHEDRON)
    np.testing.assert_allclose(mesh.area_vectors, [[0, 0, -0.5], [0, -0.5, 0], [0.5, 0.5, 0.5], [-0.5, 0, 0]])


# ------------------------------------------------------------------------------------------------ connectivity


def test_a_closed_surface():
    c = sphere("icosahedral", 3).connectivity
    assert len(c.edges) == 270
    assert (c.edges[:, 0] < c.edges[:, 1]).all()
    assert len(np.unique(c.edges, axis=0)) == 270
    assert (c.edge_face_counts == 2).all()
    assert (c.edge_windings == 0).all()
    assert c.euler_characteristic == 2
    assert c.component_count == 1
    assert len(c.pinched_vertices) == 0
    sides = np.stack([c.faces, np.roll(c.faces, -1, axis=1)], axis=-1)
    assert (c.edges[c.face_edges] == np.sort(sides, axis=-1)).all()


def test_open_edges():
    c = Connectivity(TETRAHEDRON[1][1:], 4)
    assert c.edges[c.edge_face_counts == 1].tolist() == [[0, 1], [0, 2], [1, 2]]
    assert np.abs(c.edge_windings).tolist() == (c.edge_face_counts == 1).astype(int).tolist()
    assert c.euler_characteristic == 1  # a disc


def test_crowded_edges():
    # Three fins on one edge.
    c = Connectivity([[0, 1, 2], [0, 1, 3], [1, 0, 4]], 5)
    assert c.edges[c.edge_face_counts > 2].tolist() == [[0, 1]]
    assert c.edge_windings[(c.edges == [0, 1]).all(axis=1)].tolist() == [1]


def test_misoriented_edges():
    turned = np.array(TETRAHEDRON[1])
    turned[2] = turned[2][::-1]
    c = Connectivity(turned, 4)
    assert (c.edge_face_counts == 2).all()
    wrong = c.edges[c.edge_windings != 0]
    assert {tuple(e) for e in wrong.tolist()} == {(1, 2), (2, 3), (1, 3)}
    assert np.abs(c.edge_windings[c.edge_windings != 0]).tolist() == [2, 2, 2]


def test_a_pinched_vertex():
    # Two tetrahedra that share vertex 3 alone.
    c = Connectivity([*TETRAHEDRON[1], *[[f + 3 for f in face] for face in TETRAHEDRON[1]]], 7)
    assert c.pinched_vertices.tolist() == [3]
    assert (c.edge_face_counts == 2).all()
    assert c.component_count == 1
    assert c.euler_characteristic == 3


def test_two_pinched_vertices_where_fans_meet_only_there():
    # Three tetrahedra in a row, vertex to vertex.
    faces = np.array(TETRAHEDRON[1])
    assert Connectivity(np.concatenate([faces, faces + 3, faces + 6]), 10).pinched_vertices.tolist() == [3, 6]


def test_an_edge_shared_by_two_tetrahedra_pinches_no_vertex_but_is_crowded():
    # The fans at 0 and 1 are joined by the common edge, which is where the fault is.
    second = [[0, 4, 1], [0, 1, 5], [1, 4, 5], [0, 5, 4]]
    c = Connectivity([*TETRAHEDRON[1], *second], 6)
    assert c.edges[c.edge_face_counts == 4].tolist() == [[0, 1]]
    assert len(c.pinched_vertices) == 0


def test_components_and_unused_vertices():
    vertices, faces = oracles.joined(TETRAHEDRON, oracles.torus(), TETRAHEDRON)
    c = Connectivity(faces, len(vertices))
    assert c.component_count == 3
    assert c.euler_characteristic == 2 + 0 + 2
    spare = Connectivity(np.array(faces) + 1, len(vertices) + 5)
    assert spare.component_count == 3
    assert spare.euler_characteristic == 4
    assert (spare.used_vertices == np.arange(1, len(vertices) + 1)).all()


def test_torus():
    vertices, faces = oracles.torus()
    mesh = Mesh(vertices, faces)
    c = mesh.connectivity
    assert c.euler_characteristic == 0
    assert (c.edge_face_counts == 2).all()
    assert (c.edge_windings == 0).all()
    assert len(c.pinched_vertices) == 0
    assert mesh.mass_properties.volume == pytest.approx(2 * np.pi**2 * 2 * 0.7**2, rel=0.07)


def test_neighbour_mean_is_the_one_ring_mean():
    mesh = sphere("octahedral", 3)
    w = mesh.connectivity.neighbour_mean
    neighbours = [set() for _ in mesh.vertices]
    for f in mesh.faces:
        for i in f:
            neighbours[i] |= {int(j) for j in f} - {int(i)}
    expected = np.array([mesh.vertices[sorted(near)].mean(axis=0) for near in neighbours])
    np.testing.assert_allclose(w @ mesh.vertices, expected, atol=1e-15)
    np.testing.assert_allclose(w @ np.ones(len(mesh.vertices)), 1.0, rtol=1e-15)


# ------------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], r"vertices of shape \(n, 3\), got \(3, 2\)"),
        ([1.0, 2.0, 3.0], [[0, 1, 2]], r"vertices of shape \(n, 3\), got \(3,\)"),
        ([["a", "b", "c"]] * 3, [[0, 1, 2]], "real numbers"),
        (np.eye(3) * 1j, [[0, 1, 2]], "real numbers, got complex128"),
        (np.eye(3, dtype=bool), [[0, 1, 2]], "real numbers, got bool"),
        ([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]], [[0, 1, 2]], r"vertex 1 is \[1.0, 0.0, nan\]"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "vertex 2"),
        (np.eye(3), [[0, 1]], r"faces of shape \(m, 3\) with m >= 1, got \(1, 2\)"),
        (np.eye(3), np.empty((0, 3), int), "m >= 1"),
        (np.eye(3), [[0.0, 1.0, 2.0]], "whole numbers .vertex indices., got float64"),
        (np.eye(3), [[0, 1, 3]], "from 0 to 2 in the faces, got 0 to 3"),
        (np.eye(3), [[-1, 1, 2]], "got -1 to 2"),
    ],
)
def test_wrong_arrays_are_refused_with_what_came(vertices, faces, message):
    with pytest.raises(MeshError, match=message):
        Mesh(vertices, faces)


def test_another_number_of_vertices_is_refused():
    mesh = Mesh(*TETRAHEDRON)
    with pytest.raises(MeshError, match="expected 4 vertices for this connectivity, got 5"):
        mesh.with_vertices(np.zeros((5, 3)))


# ------------------------------------------------------------------------------------------------ ownership


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
def test_arrays_are_read_only_and_not_shared(dtype):
    vertices, faces = np.array(TETRAHEDRON[0], dtype=dtype), np.array(TETRAHEDRON[1], dtype=np.int32)
    mesh = Mesh(vertices, faces)
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int32
    vertices[0, 0] = 9  # the caller's arrays stay the caller's
    faces[0] = 0
    assert mesh.vertices[0, 0] == 0
    assert mesh.faces[0].tolist() == [0, 2, 1]
    for array in (mesh.vertices, mesh.faces):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


def test_a_read_only_view_of_a_writeable_array_is_copied():
    owner = np.array(TETRAHEDRON[0])
    view = owner.view()
    view.flags.writeable = False
    mesh = Mesh(view, TETRAHEDRON[1])
    owner[0, 0] = 9
    assert mesh.vertices[0, 0] == 0


def test_arrays_of_other_layouts_are_taken():
    vertices = np.asfortranarray(np.array(TETRAHEDRON[0]))
    big_endian = vertices.astype(">f8")
    strided = np.repeat(TETRAHEDRON[0], 2, axis=0)[::2]
    reference = Mesh(*TETRAHEDRON)
    for other in (vertices, big_endian, strided, TETRAHEDRON[0].tolist()):
        mesh = Mesh(other, np.array(TETRAHEDRON[1], dtype=np.uint64))
        assert mesh.vertices.flags.c_contiguous
        assert mesh.content_hash == reference.content_hash


def test_connectivity_is_shared_by_meshes_that_differ_in_shape_only():
    mesh = sphere("octahedral", 2)
    other = mesh.with_vertices(2 * mesh.vertices)
    assert other.connectivity is mesh.connectivity
    assert other.mass_properties.volume == pytest.approx(8 * mesh.mass_properties.volume)
    assert repr(other) == "Mesh(18 vertices, 32 faces)"


def test_content_hash_is_that_of_the_bytes():
    mesh = Mesh(*TETRAHEDRON)
    data = np.array(TETRAHEDRON[0], "<f8").tobytes() + np.array(TETRAHEDRON[1], "<i4").tobytes()
    assert mesh.content_hash == hashlib.sha256(data).hexdigest()
    moved = np.array(TETRAHEDRON[0])
    moved[3, 2] = np.nextafter(1.0, 2.0)
    assert mesh.with_vertices(moved).content_hash != mesh.content_hash


def test_a_mesh_survives_pickling_and_stays_read_only():
    mesh = sphere("octahedral", 3)
    again = pickle.loads(pickle.dumps(mesh))
    assert again.content_hash == mesh.content_hash
    assert not again.vertices.flags.writeable
    assert not again.faces.flags.writeable


def test_what_is_computed_and_kept_is_read_only():
    mesh = sphere("octahedral", 2)
    connectivity = pickle.loads(pickle.dumps(mesh.connectivity))
    kept = [mesh.area_vectors, mesh.connectivity.edges, mesh.mass_properties.centroid, mesh.mass_properties.inertia]
    assert not any(array.flags.writeable for array in [*kept, connectivity.faces])
