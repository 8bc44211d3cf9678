"""The convex hull against closed forms, brute force over all planes, and affine maps."""

from __future__ import annotations

import itertools
import math

import bodies
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import Mesh, MeshError, database_recipe, generate
from lithoform.descriptors.hull import convex_hull


def cloud(points: np.ndarray) -> Mesh:
    """A mesh that uses every point; its faces mean nothing."""
    i = np.arange(len(points))
    return Mesh(points, np.stack([i, np.roll(i, 1), np.roll(i, 2)], axis=1))


@pytest.fixture(scope="module")
def stone() -> Mesh:
    return generate(database_recipe("blade", seed=5)).mesh


def all_bodies() -> dict[str, Mesh]:
    rng = np.random.default_rng(0)
    return {
        "tetrahedron": bodies.tetrahedron(),
        "octahedron": bodies.octahedron(),
        "box": bodies.box((3, 2, 1)),
        "turned fine box": bodies.transformed(bodies.subdivided_box((3, 2, 1), 12), bodies.random_rotation(rng)),
        "prism": bodies.prism(24, 1.0, 0.5),
        "ellipsoid": bodies.ellipsoid((3, 2, 1), 2000),
        "rounded cylinder": bodies.rounded_cylinder(1.0, 0.5, 0.1, 2000),
        "cloud": cloud(rng.normal(size=(300, 3))),
    }


@pytest.mark.parametrize("name", all_bodies())
def test_a_hull_is_a_closed_outward_convex_surface_over_the_points(name):
    mesh = all_bodies()[name]
    hull = convex_hull(mesh)
    assert np.array_equal(hull.vertices, mesh.vertices[hull.indices])
    assert (np.diff(hull.indices) > 0).all()
    c = hull.mesh.connectivity
    assert (c.edge_face_counts == 2).all()
    assert (c.edge_windings == 0).all()
    assert c.euler_characteristic == 2
    assert len(c.used_vertices) == len(hull.vertices)
    # No point lies beyond the plane of a face.
    offsets = (hull.normals * hull.vertices[hull.faces[:, 0]]).sum(axis=1)
    heights = np.einsum("fi,vi->fv", hull.normals, mesh.vertices) - offsets[:, None]
    assert heights.max() < 1e-12 * np.ptp(mesh.vertices)
    assert np.abs(np.linalg.norm(hull.normals, axis=1) - 1.0).max() < 1e-12
    assert hull.volume >= mesh.volume * (1.0 - 1e-13)


@pytest.mark.parametrize("name", all_bodies())
def test_edges_tell_both_their_faces_and_which_is_on_the_left(name):
    hull = convex_hull(all_bodies()[name])
    assert len(hull.edges) == len(hull.vertices) + len(hull.faces) - 2
    for a, b, left, right in hull.edges.tolist():
        sides = [{(f[i], f[(i + 1) % 3]) for i in range(3)} for f in (hull.faces[left], hull.faces[right])]
        assert (a, b) in sides[0]
        assert (b, a) in sides[1]


def test_all_planes_through_three_points_give_the_same_hull():
    points = np.random.default_rng(3).normal(size=(14, 3))
    found = set()
    for i, j, k in itertools.combinations(range(14), 3):
        n = np.cross(points[j] - points[i], points[k] - points[i])
        side = np.delete((points - points[i]) @ n, [i, j, k])
        if (side < 0).all() or (side > 0).all():
            found.add(frozenset((i, j, k)))
    hull = convex_hull(cloud(points))
    assert {frozenset(face) for face in hull.indices[hull.faces].tolist()} == found


def test_boxes_are_their_own_hulls_however_finely_divided_and_turned():
    rng = np.random.default_rng(7)
    for mesh in (bodies.box((3, 2, 1)), bodies.subdivided_box((3, 2, 1), 15)):
        for turn in (None, bodies.random_rotation(rng)):
            hull = convex_hull(bodies.transformed(mesh, turn))
            assert hull.volume == pytest.approx(6.0, rel=1e-13)
            assert hull.area == pytest.approx(22.0, rel=1e-13)
            assert len(hull.vertices) == 8


def test_nothing_is_dropped_from_a_sphere():
    ball = bodies.sphere(8000)
    hull = convex_hull(ball)
    assert np.array_equal(hull.indices, np.arange(len(ball.vertices)))
    assert hull.volume >= ball.volume * (1.0 - 1e-14)
    assert hull.volume < 4 / 3 * math.pi
    assert hull.area < 4 * math.pi


def test_the_hull_of_a_stone_follows_affine_maps(stone):
    hull = convex_hull(stone)
    matrix = np.array([[2.0, 0.3, 0.0], [0.1, 1.0, -0.4], [0.0, 0.2, 0.5]])
    mapped = convex_hull(stone.with_vertices(np.einsum("ij,nj->ni", matrix, stone.vertices)))
    assert np.array_equal(mapped.indices, hull.indices)
    assert mapped.volume == pytest.approx(np.linalg.det(matrix) * hull.volume, rel=1e-12)


def test_the_hull_of_a_hull_is_itself(stone):
    hull = convex_hull(stone)
    again = convex_hull(hull.mesh)
    assert np.array_equal(again.vertices, hull.vertices)
    assert again.volume == pytest.approx(hull.volume, rel=1e-13)
    assert again.area == pytest.approx(hull.area, rel=1e-13)


def test_the_order_of_vertices_and_faces_does_not_matter(stone):
    order = np.random.default_rng(1).permutation(len(stone.vertices))
    place = np.argsort(order)
    shuffled = convex_hull(Mesh(stone.vertices[order], place[stone.faces]))
    hull = convex_hull(stone)
    assert np.array_equal(np.sort(order[shuffled.indices]), hull.indices)
    assert shuffled.volume == pytest.approx(hull.volume, rel=1e-13)


def test_the_same_mesh_gives_the_same_bytes(stone):
    one, two = convex_hull(stone), convex_hull(Mesh(stone.vertices.copy(), stone.faces.copy()))
    assert (one.volume, one.area) == (two.volume, two.area)
    for name in ("vertices", "faces", "normals", "indices", "edges"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    assert not one.vertices.flags.writeable


@settings(deadline=None, max_examples=15)
@given(exponent=st.integers(-6, 6), distance=st.floats(0.0, 1e4), seed=st.integers(0, 99))
def test_size_place_and_pose_do_not_matter(exponent, distance, seed):
    body = bodies.star(lambda u: 1.0 + 0.2 * np.sin(5 * u[:, 0]) * np.cos(4 * u[:, 1]), 800)
    hull = convex_hull(body)
    scale = 10.0**exponent
    turn = bodies.random_rotation(np.random.default_rng(seed))
    moved = convex_hull(bodies.transformed(body, turn, scale=scale, shift=np.full(3, scale * distance)))
    # The shift itself rounds the coordinates by 1e-16 of the distance.
    tolerance = 1e-13 + 1e-14 * distance
    assert moved.volume == pytest.approx(scale**3 * hull.volume, rel=tolerance)
    assert moved.area == pytest.approx(scale**2 * hull.area, rel=tolerance)


def test_vertices_that_no_face_uses_do_not_count():
    box = bodies.box((1, 1, 1))
    padded = Mesh(np.concatenate([[[9.0, 9.0, 9.0]], box.vertices]), box.faces + 1)
    hull = convex_hull(padded)
    assert hull.volume == pytest.approx(1.0, rel=1e-14)
    assert np.array_equal(hull.indices, np.arange(1, 9))


@pytest.mark.parametrize("name", ["plane", "tilted plane", "line", "point"])
def test_a_flat_body_is_refused_in_one_sentence(name):
    rng = np.random.default_rng(2)
    points = rng.normal(size=(30, 3))
    points[:, 2] = 0.0
    if name == "tilted plane":
        points[:, 2] = 0.3 * points[:, 0] - 0.7 * points[:, 1]
    elif name == "line":
        points[:, 1] = 2.0 * points[:, 0]
    elif name == "point":
        points[:] = 1.5
    with pytest.raises(MeshError, match="needs a body with a volume, but these vertices lie in one plane") as caught:
        convex_hull(cloud(points))
    assert "\n" not in str(caught.value)


def test_a_thin_body_is_no_flat_one():
    assert convex_hull(bodies.box((1, 1, 1e-6))).volume == pytest.approx(1e-6, rel=1e-9)
    assert convex_hull(bodies.box((1, 1e-4, 1e-4))).volume == pytest.approx(1e-8, rel=1e-9)


def test_facets_that_do_not_join_are_found_again_from_joggled_points_or_refused(monkeypatch):
    from lithoform.descriptors import hull as module

    mesh = bodies.subdivided_box((3, 2, 1), 6)
    verdicts = iter([False, True])
    monkeypatch.setattr(module, "_is_closed", lambda faces, count: next(verdicts))
    assert convex_hull(mesh).volume == pytest.approx(6.0, rel=1e-11)
    monkeypatch.setattr(module, "_is_closed", lambda faces, count: False)
    with pytest.raises(MeshError, match="do not join up"):
        convex_hull(mesh)
