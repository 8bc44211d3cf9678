"""Self-intersections against a brute-force oracle in fractions, at and off every kind of contact."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import intersections
from lithoform.errors import MeshError
from lithoform.intersections import find_self_intersections
from lithoform.predicates import faces_meet
from lithoform.warp_runtime import wp

# --- the oracle ---------------------------------------------------------------------------------------------
# The common part of two triangles is convex, and each of its extreme points is a corner of one of them, or
# the point where an edge of one crosses the plane or an edge of the other.  All such points are listed in
# fractions, and those in both triangles are kept.  The module never computes such a point for triangles of
# positive area.


def minus(p, q):
    return [x - y for x, y in zip(p, q, strict=True)]


def dot(u, v):
    return sum(x * y for x, y in zip(u, v, strict=True))


def cross(u, v):
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def walk(p, direction, t):
    return [x + t * d for x, d in zip(p, direction, strict=True)]


def edges(triangle):
    return [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]


def on_segment(p, q, x):
    return not any(cross(minus(q, p), minus(x, p))) and dot(minus(x, p), minus(x, q)) <= 0


def holds(triangle, x):
    a, b, c = triangle
    normal = cross(minus(b, a), minus(c, a))
    if not any(normal):
        return any(on_segment(p, q, x) for p, q in edges(triangle))
    if dot(normal, minus(x, a)) != 0:
        return False
    return all(dot(cross(minus(q, p), minus(x, p)), normal) >= 0 for p, q in edges(triangle))


def contact_points(first, second):
    """All extreme points of the common part, and maybe more points of it."""
    points = [*first, *second]
    for one, other in ((first, second), (second, first)):
        normal = cross(minus(other[1], other[0]), minus(other[2], other[0]))
        for p, q in edges(one):
            rate = dot(normal, minus(q, p))
            if rate != 0:
                points.append(walk(p, minus(q, p), Fraction(dot(normal, minus(other[0], p)), rate)))
    for (p, q), (r, s) in itertools.product(edges(first), edges(second)):
        normal = cross(minus(q, p), minus(s, r))
        if any(normal) and dot(normal, minus(r, p)) == 0:
            t = Fraction(dot(cross(minus(r, p), minus(s, r)), normal), dot(normal, normal))
            points.append(walk(p, minus(q, p), t))
    return [x for x in points if holds(first, x) and holds(second, x)]


def boxes_apart(first, second):
    return any(
        max(p[k] for p in first) < min(p[k] for p in second) or max(p[k] for p in second) < min(p[k] for p in first)
        for k in range(3)
    )


def oracle_meets(points, f, g):
    common = sorted(set(f) & set(g))
    if len(common) == 3:
        return True
    first, second = [points[k] for k in f], [points[k] for k in g]
    if boxes_apart(first, second):
        return False
    contacts = contact_points(first, second)
    if len(common) == 2:
        p, q = points[common[0]], points[common[1]]
        return any(not on_segment(p, q, x) for x in contacts)
    return any(x != points[k] for k in common for x in contacts) if common else bool(contacts)


def oracle_pairs(vertices, faces):
    points = [[Fraction(float(x)) for x in row] for row in vertices]
    if all(x.denominator == 1 for row in points for x in row):
        points = [[int(x) for x in row] for row in points]
    faces = np.asarray(faces).tolist()
    return [[i, j] for i, j in itertools.combinations(range(len(faces)), 2) if oracle_meets(points, faces[i], faces[j])]


# --- meshes -------------------------------------------------------------------------------------------------


def icosphere(subdivisions):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.array(mesh.vertices), np.array(mesh.faces)


def cube(subdivisions):
    """Cube of side 1 about the origin, each triangle split in four, again and again, at exact midpoints."""
    box = trimesh.creation.box()
    vertices, faces = np.array(box.vertices), np.array(box.faces)
    for _ in range(subdivisions):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return vertices, faces


def crumpled(amount, subdivisions=2, seed=3):
    vertices, faces = icosphere(subdivisions)
    return vertices + np.random.default_rng(seed).normal(scale=amount, size=vertices.shape), faces


def union(*meshes):
    shifts = np.cumsum([0, *(len(v) for v, _ in meshes)])
    return (
        np.concatenate([v for v, _ in meshes]),
        np.concatenate([f + shift for (_, f), shift in zip(meshes, shifts, strict=False)]),
    )


def rotation(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


FLOOR = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]


def pair_with_floor(*corners):
    """A large triangle in the plane z = 0 and a second one, without common vertices."""
    return np.array([*FLOOR, *corners]), np.array([[0, 1, 2], [3, 4, 5]])


# --- closed surfaces without self-intersection --------------------------------------------------------------


@pytest.mark.parametrize("mesh", [icosphere(3), cube(0), cube(3)], ids=["icosphere", "cube", "fine cube"])
@pytest.mark.parametrize("turned", [False, True])
def test_sound_surface_has_no_pairs(mesh, turned):
    vertices, faces = mesh
    pairs = find_self_intersections(vertices @ rotation(1) if turned else vertices, faces)
    assert pairs.shape == (0, 2)
    assert pairs.dtype == np.int32


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("stretch", [1.0, 0.05])
@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150])
def test_flat_neighbours_need_no_exact_arithmetic(monkeypatch, turned, stretch, scale):
    # 12,288 faces with some 100,000 coplanar neighbours: deciding these in whole numbers would take a second.
    def refuse(vertices, faces, first, second):
        raise AssertionError(f"{len(first)} pairs were left open")

    monkeypatch.setattr(intersections, "faces_meet", refuse)
    vertices, faces = cube(5)
    vertices = vertices * [scale, scale, stretch * scale]
    assert len(find_self_intersections(vertices @ rotation(2) if turned else vertices, faces)) == 0


# --- surfaces that do intersect -----------------------------------------------------------------------------


def test_interpenetrating_spheres_match_the_oracle():
    ball, faces = icosphere(1)
    # Steps of 2^-12 keep the oracle's numbers short.
    ball = np.round(ball * 4096)
    vertices, faces = union((ball, faces), (ball @ np.diag([1, -1, -1]) + [6000, 700, 300], faces))
    expected = oracle_pairs(vertices, faces)
    assert len(expected) > 10
    assert find_self_intersections(vertices, faces).tolist() == expected


def test_vertex_pushed_through_the_opposite_side():
    vertices, faces = icosphere(1)
    vertices[5] *= -1.25
    expected = oracle_pairs(vertices, faces)
    assert all(5 in [*faces[i], *faces[j]] for i, j in expected)
    assert len(expected) >= 3
    assert find_self_intersections(vertices, faces).tolist() == expected


def test_crumpled_sphere_matches_the_oracle():
    vertices, faces = crumpled(0.3, subdivisions=1)
    vertices = np.round(1024 * vertices)
    expected = oracle_pairs(vertices, faces)
    shared = [len(set(faces[i]) & set(faces[j])) for i, j in expected]
    assert shared.count(0) > 20
    assert shared.count(1) > 20
    assert find_self_intersections(vertices, faces).tolist() == expected


# --- every degeneracy: small whole coordinates --------------------------------------------------------------

COORDINATE = st.integers(-2, 2)
SOUPS = st.integers(5, 9).flatmap(
    lambda count: st.tuples(
        st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=count, max_size=count),
        st.lists(st.tuples(*[st.integers(0, count - 1)] * 3), min_size=2, max_size=6),
    )
)
FLAT_SOUPS = SOUPS.map(lambda soup: ([(x, y, 0) for x, y, _ in soup[0]], soup[1]))
# A shear and swap of determinant 1 with whole entries: takes planes off the axes, keeps all contacts.
SHEAR = np.array([[3.0, 1.0, -2.0], [1.0, 2.0, 0.0], [2.0, 1.0, -1.0]])


@settings(max_examples=300, derandomize=True, deadline=None, database=None)
@given(
    soup=st.one_of(SOUPS, FLAT_SOUPS),
    sheared=st.booleans(),
    scale=st.sampled_from([1.0, 2.0**-340, 2.0**400]),
)
def test_soup_of_small_whole_numbers_matches_the_oracle(soup, sheared, scale):
    vertices, faces = np.array(soup[0], dtype=float), np.array(soup[1])
    if sheared:
        vertices = vertices @ SHEAR
    assert find_self_intersections(vertices * scale, faces).tolist() == oracle_pairs(vertices, faces)


@settings(max_examples=150, derandomize=True, deadline=None, database=None)
@given(soup=SOUPS, seed=st.integers(0, 2**32 - 1))
def test_soup_off_contact_by_rounding_matches_the_oracle(soup, seed):
    # Rounded rotations turn contacts into gaps and overlaps of a few units in the last place.
    vertices, faces = np.array(soup[0], dtype=float) @ rotation(seed), np.array(soup[1])
    assert find_self_intersections(vertices, faces).tolist() == oracle_pairs(vertices, faces)


def test_no_pair_is_lost_between_sizes_and_places_far_apart():
    # Sizes over nine decades, half of them about one point: the tree is deep, and float32 boxes are coarse.
    rng = np.random.default_rng(4)
    size = 10.0 ** rng.uniform(-9, 0, size=(400, 1, 1))
    place = np.where(rng.random((400, 1, 1)) < 0.5, 0.3 * size, 0.1) * rng.normal(size=(400, 1, 3))
    vertices = (1.0 + place + size * rng.normal(size=(400, 3, 3))).reshape(-1, 3)
    faces = np.arange(1200).reshape(-1, 3)
    pairs = np.stack(np.triu_indices(400, 1), axis=1)
    expected = pairs[faces_meet(vertices, faces, *pairs.T)]
    assert len(expected) > 500
    assert find_self_intersections(vertices, faces).tolist() == expected.tolist()


def test_many_faces_in_one_place():
    # Equal boxes cannot be split: the tree ends in a leaf larger than usual, and no face may drop out of it.
    faces = np.arange(300).reshape(-1, 3)
    assert len(find_self_intersections(np.tile(np.array(FLOOR), (100, 1)), faces)) == 100 * 99 // 2


# --- contact and its absence by one unit in the last place --------------------------------------------------


@pytest.mark.parametrize("place", [(1.0, 1.0), (2.0, 2.0), (0.0, 0.0), (3.0, 0.0)])
def test_vertex_on_a_face_edge_or_corner_counts(place):
    tip = [*place, 0.0]
    high = [[1.0, 1.0, 1.0], [2.0, 1.0, 1.0]]
    assert find_self_intersections(*pair_with_floor(tip, *high)).tolist() == [[0, 1]]
    tip[2] = 5e-324  # the smallest positive number
    assert len(find_self_intersections(*pair_with_floor(tip, *high))) == 0


@pytest.mark.parametrize(("gap", "count"), [(0.0, 1), (2.0**-40, 0), (-(2.0**-40), 1)])
def test_coplanar_faces_side_by_side(gap, count):
    shifted = np.add([[2.0, 2.0, 0.0], [4.0, 2.0, 0.0], [2.0, 4.0, 0.0]], [gap, 0.0, 0.0])
    for tilt in (np.eye(3), SHEAR):
        vertices, faces = pair_with_floor(*shifted)
        assert len(find_self_intersections(vertices @ tilt, faces)) == count


@pytest.mark.parametrize(
    ("other", "found"),
    [
        ((0.6, 0.5, 0.0), True),  # dihedral angle exactly 0
        ((0.6, 0.5, 1e-12), False),
        ((0.6, 0.5, 5e-324), False),
        ((0.6, -0.5, 0.0), False),  # unfolded flat
        ((3.0, 0.5, 0.0), True),  # folded, and beyond the end of the edge
    ],
)
def test_faces_folded_over_a_common_edge(other, found):
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 1.0, 0.0], other])
    expected = [[0, 1]] if found else []
    for faces in ([[0, 1, 2], [1, 0, 3]], [[2, 0, 1], [3, 0, 1]]):
        assert find_self_intersections(vertices, np.array(faces)).tolist() == expected


@pytest.mark.parametrize(
    ("other_edge", "other_apex", "found"),
    [
        ((3.0, 0.0, 0.0), (1.0, -2.0, 0.0), True),  # beside each other, along a part of one edge
        ((3.0, 0.0, 0.0), (1.0, 0.0, 2.0), True),  # the same, out of plane
        ((3.0, 1.0, 0.0), (3.0, 2.0, 0.0), True),  # one within the other's angle
        ((-3.0, 0.0, 0.0), (0.0, -3.0, 0.0), False),  # opposite angles on the same two lines
        ((-3.0, 0.0, 0.0), (-3.0, 3.0, 0.0), False),  # adjacent angles on one line
        ((1.0, 1.0, 1.0), (1.0, 1.0, -1.0), True),  # through the other's angle
        ((-1.0, -1.0, 1.0), (-1.0, -1.0, -1.0), False),  # through the opposite angle
    ],
)
@pytest.mark.parametrize("tilt", [np.eye(3), SHEAR], ids=["flat", "tilted"])
def test_faces_with_one_common_vertex(other_edge, other_apex, found, tilt):
    vertices = np.array([*FLOOR, other_edge, other_apex]) @ tilt
    for f, g in itertools.product(itertools.permutations([0, 1, 2]), itertools.permutations([0, 3, 4])):
        assert len(find_self_intersections(vertices, np.array([f, g]))) == found


def test_faces_with_the_same_three_vertices_always_count():
    faces = np.array([[0, 1, 2], [2, 1, 0], [1, 2, 0]])
    assert find_self_intersections(np.array(FLOOR), faces).tolist() == [[0, 1], [0, 2], [1, 2]]


def test_equal_coordinates_are_not_a_common_vertex():
    vertices, faces = pair_with_floor([4.0, 0.0, 0.0], [5.0, 1.0, 1.0], [5.0, -1.0, 1.0])
    assert len(find_self_intersections(vertices, faces)) == 1
    faces[1, 0] = 1
    assert len(find_self_intersections(vertices, faces)) == 0


@pytest.mark.parametrize(
    ("corners", "found"),
    [
        ([(1.0, 1.0, -1.0), (1.0, 1.0, 0.5), (1.0, 1.0, 1.0)], True),  # a segment through the floor
        ([(1.0, 1.0, 0.0)] * 3, True),  # a point on it
        ([(1.0, 1.0, 0.5)] * 3, False),  # a point within its box when tilted, off its plane
        ([(3.0, 3.0, 0.0), (5.0, 1.0, 0.0), (4.0, 2.0, 0.0)], False),  # a segment beside it, in its plane
        ([(3.0, 3.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 0.0)], True),  # and across it
    ],
)
def test_face_of_zero_area_counts_as_segment_or_point(corners, found):
    vertices, faces = pair_with_floor(*corners)
    assert len(find_self_intersections(vertices @ SHEAR, faces)) == found


@pytest.mark.parametrize(
    ("xs", "count"),
    [
        ((0.0, 1.0, 3.0, 2.0), 1),  # both go on beyond the common edge, over each other
        ((0.0, 1.0, 3.0, -1.0), 0),  # on either side of it
        ((0.0, 0.0, 1.0, 1.0), 1),  # the common edge is a point, and they go on from it together
        ((0.0, 0.0, 1.0, -1.0), 0),
    ],
)
def test_faces_of_zero_area_with_a_common_edge(xs, count):
    vertices = np.outer(xs, [1.0, 2.0, -1.0])
    assert len(find_self_intersections(vertices, np.array([[0, 1, 2], [1, 0, 3]]))) == count


# --- what must not change the answer ------------------------------------------------------------------------


def contacts_on_a_grid():
    """Two fine cubes that overlap, with coplanar sides: crossings, and many exact contacts."""
    vertices, faces = cube(2)
    return union((vertices, faces), (np.add(vertices, [0.25, 0.0, 0.125]), faces))


@pytest.mark.parametrize("offset", [(2.0**40, 0.0, 0.0), (-(2.0**44), 2.0**43, 3 * 2.0**41)])
def test_large_exact_offsets_leave_the_answer(offset):
    vertices, faces = contacts_on_a_grid()
    moved = vertices + offset
    assert np.array_equal(moved - offset, vertices)  # nothing was rounded
    expected = find_self_intersections(vertices, faces)
    assert len(expected) > 100
    assert np.array_equal(find_self_intersections(moved, faces), expected)


def test_threads_and_repetition_leave_the_answer():
    meshes = [crumpled(0.03, subdivisions=3, seed=seed) for seed in range(8)]
    meshes += [contacts_on_a_grid()] * 2
    expected = [find_self_intersections(*mesh) for mesh in meshes]
    assert len({len(pairs) for pairs in expected}) > 2
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda mesh: find_self_intersections(*mesh), meshes * 4))
    assert all(np.array_equal(a, b) for a, b in zip(found, expected * 4, strict=True))


def test_pairs_are_sorted_and_distinct():
    pairs = find_self_intersections(*contacts_on_a_grid())
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert np.array_equal(pairs, np.unique(pairs, axis=0))


@pytest.mark.parametrize("limit", [0, 1, 2, 7, 100, 10**9])
@pytest.mark.parametrize("mesh", [contacts_on_a_grid(), crumpled(0.1)], ids=["contacts", "crossings"])
def test_limit_returns_the_first_pairs(limit, mesh):
    vertices, faces = mesh
    expected = find_self_intersections(vertices, faces)[:limit]
    pairs = find_self_intersections(vertices, faces, limit=limit)
    assert pairs.shape == (len(expected), 2)
    assert np.array_equal(pairs, expected)


def test_arguments_are_left_alone_and_layout_is_free():
    vertices, faces = contacts_on_a_grid()
    expected = find_self_intersections(vertices, faces)
    vertices.setflags(write=False)
    turned = np.asfortranarray(vertices)
    assert np.array_equal(find_self_intersections(turned, faces.astype(np.uint32)), expected)
    assert np.array_equal(find_self_intersections(vertices, faces.tolist()), expected)


@pytest.mark.cuda
def test_the_gpu_gives_the_same_answer():
    if not wp.is_cuda_available():
        pytest.skip("needs a CUDA device")
    for vertices, faces in (contacts_on_a_grid(), crumpled(0.1, subdivisions=4)):
        expected = find_self_intersections(vertices, faces)
        assert np.array_equal(find_self_intersections(vertices, faces, device="cuda"), expected)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_faces_have_no_pairs(count):
    faces = np.array([[0, 1, 2]])[:count]
    assert find_self_intersections(np.array(FLOOR), faces).shape == (0, 2)


# --- errors -------------------------------------------------------------------------------------------------

FACES = np.array([[0, 1, 2], [2, 1, 0]])


@pytest.mark.parametrize(
    ("vertices", "faces", "limit", "message"),
    [
        (np.zeros((3, 2)), FACES, None, r"vertices of shape \(vertices, 3\), got shape \(3, 2\)"),
        (np.zeros(9), FACES, None, r"vertices of shape \(vertices, 3\), got shape \(9,\)"),
        ([["a", "b", "c"]], FACES, None, r"arrays of numbers, got could not convert"),
        (FLOOR, [[0, 1, 2], [0, 1]], None, r"arrays of numbers"),
        (FLOOR, FACES[:, :2], None, r"integers of shape \(faces, 3\), got int64, \(2, 2\)"),
        (FLOOR, FACES.astype(float), None, r"integers of shape \(faces, 3\), got float64, \(2, 3\)"),
        (
            [*FLOOR[:2], [0, np.nan, 1]],
            FACES,
            None,
            r"finite coordinates, got \[0\.0, nan, 1\.0\] at vertex 2",
        ),
        (
            [*FLOOR[:2], [-np.inf, 0, 1]],
            FACES,
            None,
            r"finite coordinates, got \[-inf, 0\.0, 1\.0\] at vertex 2",
        ),
        (FLOOR, FACES + 1, None, r"vertex numbers from 0 to 2 in faces, got 3"),
        (FLOOR, FACES - 1, None, r"vertex numbers from 0 to 2 in faces, got -1"),
        (FLOOR, FACES, -1, r"limit of at least 0 pairs, got -1"),
    ],
)
def test_a_bad_argument_is_named(vertices, faces, limit, message):
    with pytest.raises(MeshError, match=message):
        find_self_intersections(vertices, faces, limit=limit)
