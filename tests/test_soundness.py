"""Soundness: a sound mesh is certified, and each fault is named with its count and place."""

import numpy as np
import oracles
import pytest

from lithoform.mesh import Mesh
from lithoform.presets import benchmark_recipe
from lithoform.radius import radii
from lithoform.soundness import check
from lithoform.topology import sphere

BALL = sphere("octahedral", 6)
FAULTS = ("open_edges crowded_edges misoriented_edges pinched_vertices zero_area_faces self_intersections").split()


def counts(report) -> dict[str, int]:
    """Numbers of the faults that were found."""
    return {name: len(getattr(report, name)) for name in FAULTS if len(getattr(report, name))}


def faces_of(mesh: Mesh) -> np.ndarray:
    return np.array(mesh.faces)


# ------------------------------------------------------------------------------------------------ sound


@pytest.mark.parametrize("kind", ["octahedral", "icosahedral"])
@pytest.mark.parametrize("n", [1, 2, 9, 50])
def test_a_sphere_is_sound_and_certified_without_a_search(kind, n):
    report = check(sphere(kind, n))
    assert report.sound
    assert report.certificate == "star-shaped"
    assert report.problems() == []
    assert counts(report) == {}
    assert report.closed
    assert report.manifold
    assert report.outward
    assert (report.euler_characteristic, report.components) == (2, 1)
    assert report.volume == pytest.approx(sphere(kind, n).mass_properties.volume)
    assert report.places == {}


@pytest.mark.parametrize("seed", range(4))
def test_a_stone_is_sound_wherever_it_lies(seed):
    ball = sphere("octahedral", 20)
    stone = ball.vertices * radii([benchmark_recipe(seed=seed)], ball.vertices)[0][:, None]
    for scale, offset in [(1.0, 0.0), (1e-3, 0.5), (1e4, -1e5), (1.0, 1e6)]:
        assert check(ball.with_vertices(stone * scale + offset)).sound


def test_a_sound_body_that_is_not_star_shaped_is_decided_by_the_search():
    # A cylinder bent into a C, closed by flat lids: part of a torus.
    m, n = 24, 8
    vertices, _ = oracles.torus(2.0, 0.5, m + 1, n)
    u = np.repeat(np.linspace(0, 1.6 * np.pi, m + 1), n)
    ring = np.hypot(vertices[:, 0], vertices[:, 1])
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), vertices[:, 2]], axis=1)
    faces = []
    for i in range(m):
        for j in range(n):
            a, b, c, d = i * n + j, (i + 1) * n + j, (i + 1) * n + (j + 1) % n, i * n + (j + 1) % n
            faces += [[a, b, c], [a, c, d]]
    faces += [[0, j, j + 1] for j in range(1, n - 1)]
    faces += [[m * n, m * n + j + 1, m * n + j] for j in range(1, n - 1)]
    report = check(Mesh(vertices, faces))
    assert report.sound, report.problems()
    assert report.certificate == "search"


def test_unused_vertices_do_not_make_a_body_unsound():
    vertices = np.concatenate([BALL.vertices, [[5.0, 5, 5]]])
    assert check(Mesh(vertices, BALL.faces)).sound


# ------------------------------------------------------------------------------------------------ each fault


def test_a_hole():
    faces = faces_of(BALL)
    report = check(Mesh(BALL.vertices, np.delete(faces, 10, axis=0)))
    assert not report.sound
    assert not report.closed
    assert not report.manifold
    assert counts(report) == {"open_edges": 3}
    assert {tuple(e) for e in report.open_edges.tolist()} == {
        tuple(sorted((int(faces[10][i]), int(faces[10][(i + 1) % 3])))) for i in range(3)
    }
    np.testing.assert_allclose(report.places["open_edges"], BALL.vertices[report.open_edges[0]].mean(axis=0))
    assert report.problems()[0].startswith("3 open edges (first at ")
    assert "Euler characteristic 1 instead of 2" in report.problems()


def test_a_flipped_face():
    faces = faces_of(BALL)
    faces[7] = faces[7][::-1]
    report = check(Mesh(BALL.vertices, faces))
    assert not report.sound
    assert report.closed
    assert report.manifold
    assert not report.outward
    assert counts(report) == {"misoriented_edges": 3}
    assert set(report.misoriented_edges.ravel().tolist()) == set(faces[7].tolist())
    assert report.problems()[0].startswith("3 edges whose two faces are wound against each other (first at ")


def test_a_duplicated_face():
    faces = faces_of(BALL)
    report = check(Mesh(BALL.vertices, np.concatenate([faces, faces[5:6]])))
    assert not report.sound
    assert not report.manifold
    assert counts(report)["crowded_edges"] == 3
    assert set(report.crowded_edges.ravel().tolist()) == set(faces[5].tolist())
    assert [5, len(faces)] in report.self_intersections.tolist()
    assert any(p.startswith("3 edges with more than two faces") for p in report.problems())


def test_a_pinched_vertex():
    # Two cubes that touch at one corner, which they share.
    one, other = oracles.box((1, 1, 1)), oracles.box((1, 1, 1))
    vertices, faces = oracles.joined(one, (other[0] + 1.0, other[1]))
    copies = np.flatnonzero((vertices == 0.5).all(axis=1))
    faces[faces == copies[1]] = copies[0]
    report = check(Mesh(vertices, faces))
    assert not report.sound
    assert report.closed
    assert not report.manifold
    assert counts(report) == {"pinched_vertices": 1}
    assert report.pinched_vertices.tolist() == [copies[0]]
    np.testing.assert_allclose(report.places["pinched_vertices"], [0.5, 0.5, 0.5])
    assert report.problems()[0] == "1 vertices where the surface touches itself (first at 0.5, 0.5, 0.5)"


def test_a_torus():
    report = check(Mesh(*oracles.torus()))
    assert not report.sound
    assert report.manifold
    assert report.outward
    assert counts(report) == {}
    assert report.problems() == ["Euler characteristic 0 instead of 2"]


def test_two_components():
    body = (np.array(BALL.vertices), faces_of(BALL))
    report = check(Mesh(*oracles.joined(body, (body[0] + [3, 0, 0], body[1]))))
    assert not report.sound
    assert report.components == 2
    assert counts(report) == {}
    assert report.problems() == ["2 separate pieces instead of 1"]


def test_a_torus_and_a_pair_of_bodies_do_not_cancel():
    # Euler characteristic 0 + 2 = 2, as for one sphere: the pieces are counted all the same.
    body = (np.array(BALL.vertices) * 0.2, faces_of(BALL))
    report = check(Mesh(*oracles.joined(oracles.torus(), body)))
    assert report.euler_characteristic == 2
    assert report.problems() == ["2 separate pieces instead of 1"]


def test_an_inverted_body():
    report = check(Mesh(BALL.vertices, faces_of(BALL)[:, ::-1]))
    assert not report.sound
    assert report.manifold
    assert not report.outward
    assert report.volume < 0
    assert counts(report) == {}
    assert report.problems() == ["the faces point inwards"]


def test_a_zero_area_face():
    # A vertex moved onto the middle of the opposite side of one of its faces.
    vertices = np.array(oracles.box((1, 1, 1))[0])
    faces = oracles.box((1, 1, 1))[1]
    split = [*faces[1:].tolist()]
    a, b, c = faces[0]
    middle = len(vertices)
    vertices = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
    split += [[a, middle, c], [middle, b, c], [a, b, middle]]
    report = check(Mesh(vertices, split))
    assert report.zero_area_faces.tolist() == [len(split) - 1]
    assert not report.sound
    np.testing.assert_allclose(report.places["zero_area_faces"], vertices[[a, b, middle]].mean(axis=0))
    assert any(p.startswith("1 faces without area (first at ") for p in report.problems())


def test_a_collapsed_edge():
    # All faces of an edge shrink to lines when its ends coincide.
    vertices = np.array(BALL.vertices)
    a, b = BALL.connectivity.edges[40]
    vertices[a] = vertices[b]
    report = check(BALL.with_vertices(vertices))
    both = [i for i, f in enumerate(BALL.faces.tolist()) if a in f and b in f]
    assert report.zero_area_faces.tolist() == both
    assert not report.sound


def test_a_face_that_names_a_vertex_twice():
    faces = faces_of(BALL)
    report = check(Mesh(BALL.vertices, np.concatenate([faces, [[3, 3, 4]]])))
    assert not report.sound
    assert report.zero_area_faces.tolist() == [len(faces)]


def test_a_thin_face_is_not_a_face_without_area():
    vertices, faces = oracles.box((1, 1, 1), 2)
    vertices[:, 2] *= 1e-9
    report = check(Mesh(vertices, faces))
    assert report.sound, report.problems()


def test_a_self_intersection():
    # A vertex pulled through the opposite side.
    vertices = np.array(BALL.vertices)
    top = int(np.argmax(vertices[:, 2]))
    vertices[top] = [0.05, 0.03, -1.3]
    report = check(BALL.with_vertices(vertices))
    assert not report.sound
    assert report.manifold
    assert report.certificate == "search"
    assert set(counts(report)) == {"self_intersections"}
    pulled = {i for i, f in enumerate(BALL.faces.tolist()) if top in f}
    assert all(len(pulled & set(pair)) == 1 for pair in report.self_intersections.tolist())
    assert report.places["self_intersections"][2] < 0
    assert report.problems()[0].startswith(f"{len(report.self_intersections)} pairs of faces that intersect (first at ")


def test_two_bodies_that_cross():
    body = (np.array(BALL.vertices), faces_of(BALL))
    report = check(Mesh(*oracles.joined(body, (body[0] + [0.9, 0.1, 0.2], body[1]))))
    assert len(report.self_intersections) > 10
    assert "2 separate pieces instead of 1" in report.problems()
    # Every pair is of one face of each body.
    m = len(BALL.faces)
    assert ((report.self_intersections < m).sum(axis=1) == 1).all()


def test_nested_bodies_are_two_pieces_and_do_not_cross():
    body = (np.array(BALL.vertices), faces_of(BALL))
    report = check(Mesh(*oracles.joined(body, (body[0] * 0.5, body[1][:, ::-1]))))
    assert counts(report) == {}
    assert report.problems() == ["2 separate pieces instead of 1"]


# ------------------------------------------------------------------------------------------------ the certificate


@pytest.mark.parametrize("turns", [2, 3])
@pytest.mark.parametrize("wobble", [0.0, 0.1])
def test_a_sphere_wrapped_several_times_is_not_certified(turns, wobble):
    # Closed, manifold, consistently wound, connected, Euler characteristic 2, and every face on the positive side
    # of the centre: all but the count of sheets.
    vertices, faces = oracles.wrapped_sphere(turns, wobble=wobble)
    mesh = Mesh(vertices, faces)
    c = mesh.connectivity
    assert (c.edge_face_counts == 2).all()
    assert (c.edge_windings == 0).all()
    assert (c.euler_characteristic, c.component_count, len(c.pinched_vertices)) == (2, 1, 0)
    centre = mesh.mass_properties.centroid
    assert (np.linalg.det(vertices[faces] - centre) > 0).all()
    report = check(mesh)
    assert report.certificate == "search"
    assert not report.sound
    assert len(report.self_intersections) > 0


def test_the_same_sphere_wrapped_once_is_certified():
    report = check(Mesh(*oracles.wrapped_sphere(1, wobble=0.1)))
    assert report.sound
    assert report.certificate == "star-shaped"


def test_the_certificate_does_not_depend_on_which_face_comes_first():
    vertices, faces = oracles.wrapped_sphere(2)
    for shift in range(0, len(faces), 17):
        assert check(Mesh(vertices, np.roll(faces, shift, axis=0))).certificate == "search"
        turned = np.roll(BALL.faces, shift, axis=0)
        assert check(Mesh(BALL.vertices, turned)).certificate == "star-shaped"


def test_a_face_seen_edge_on_is_left_to_the_search():
    # A dent that reaches the centroid: the faces about it lie in planes through the centre, at volume 0 or less.
    vertices = np.array(BALL.vertices)
    top = int(np.argmax(vertices[:, 2]))
    vertices[top] = [0, 0, -0.4]
    report = check(BALL.with_vertices(vertices))
    assert report.certificate == "search"
    assert report.sound, report.problems()


# ------------------------------------------------------------------------------------------------ the report


def test_as_dict_is_plain():
    import json

    faces = faces_of(BALL)
    report = check(Mesh(BALL.vertices, np.delete(faces, 10, axis=0)))
    plain = json.loads(json.dumps(report.as_dict()))
    assert plain["sound"] is False
    assert plain["open_edges"] == 3
    assert plain["self_intersections"] == 0
    assert plain["problems"] == report.problems()
    assert plain["euler_characteristic"] == 1


@pytest.mark.parametrize("scale", [1e-200, 1e-90, 1e100, 1e200])
def test_size_does_not_change_the_verdict(scale):
    ball = sphere("octahedral", 5)
    report = check(ball.with_vertices(scale * ball.vertices))
    assert report.sound
    assert report.volume > 0
    assert not check(Mesh(scale * ball.vertices, ball.faces[:, ::-1])).sound
