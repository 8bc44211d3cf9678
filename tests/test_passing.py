"""Sieves and slots against closed forms and blind search over all orientations."""

from __future__ import annotations

import math

import bodies
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import Mesh, database_recipe, generate
from lithoform.descriptors.boxes import minimum_box
from lithoform.descriptors.hull import convex_hull
from lithoform.descriptors.passing import sieve_pose, sieve_size, slot_width


def cloud(points: np.ndarray) -> Mesh:
    """A mesh that uses every point; its faces mean nothing."""
    i = np.arange(len(points))
    return Mesh(points, np.stack([i, np.roll(i, 1), np.roll(i, 2)], axis=1))


def random_pairs(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal pairs of directions drawn uniformly, shapes (count, 3)."""
    rng = np.random.default_rng(seed)
    u, v = rng.normal(size=(2, count, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    v -= (u * v).sum(axis=1)[:, None] * u
    return u, v / np.linalg.norm(v, axis=1)[:, None]


def squares(points: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.maximum(np.ptp(points @ u.T, axis=0), np.ptp(points @ v.T, axis=0))


@settings(deadline=None, max_examples=25)
@given(sides=st.lists(st.floats(0.05, 1.0), min_size=3, max_size=3), seed=st.integers(0, 99))
def test_a_box_passes_straight_or_on_its_edge(sides, seed):
    c, b, _ = sorted(sides)
    mesh = bodies.transformed(bodies.box(sides), bodies.random_rotation(np.random.default_rng(seed)))
    assert sieve_size(convex_hull(mesh)) == pytest.approx(min(b, (b + c) / math.sqrt(2.0)), rel=1e-9)


@pytest.mark.parametrize("sides", [(3, 2, 1), (3, 2, 0.5), (1, 1, 1), (1, 0.9, 0.3), (1, 1, 0.01)])
def test_no_pose_tried_blindly_passes_a_box_through_less(sides):
    hull = convex_hull(bodies.box(sides))
    tried = squares(hull.vertices, *random_pairs(300_000, 1)).min()
    a, b, c = sides
    truth = min(b, (b + c) / math.sqrt(2.0))
    assert truth <= tried < 1.05 * truth + 0.02 * a


@pytest.mark.parametrize("half_axes", [(3, 2, 1), (1, 1, 1), (2, 2, 0.4), (5, 1, 1), (1.2, 1.1, 1.0)])
def test_an_ellipsoid_passes_the_square_about_its_lesser_ellipse(half_axes):
    # w(u)^2 + w(v)^2 is four times the trace of the squared form on the plane of u and v: least 4 (b^2 + c^2), and
    # both are equal at some angle.
    _, b, c = half_axes
    turn = bodies.random_rotation(np.random.default_rng(2))
    hull = convex_hull(bodies.transformed(bodies.ellipsoid(half_axes, 8000), turn))
    truth = math.sqrt(2.0 * (b * b + c * c))
    # Vertices lie on the ellipsoid, so that the mesh is a little smaller, by the square of its edges.
    assert truth * (1.0 - 2e-3) < sieve_size(hull) <= truth


@pytest.mark.parametrize("height", [0.1, 0.5, 0.82, 0.84, 1.0, 3.0])
def test_a_cylinder_passes_along_its_axis_or_edgewise(height):
    # 96 sides, of which two lie in the planes at 45 degrees too: the prism's extents are the cylinder's there.
    hull = convex_hull(
        bodies.transformed(bodies.prism(96, 1.0, height), bodies.random_rotation(np.random.default_rng(3)))
    )
    assert sieve_size(hull) == pytest.approx(min(2.0, (2.0 + height) / math.sqrt(2.0)), rel=2e-4)


def test_platonic_solids():
    # The tetrahedron in its cube; no square is less than the least width.
    tetrahedron = convex_hull(bodies.tetrahedron(1.0))
    assert sieve_size(tetrahedron) == pytest.approx(math.sqrt(0.5), rel=1e-12)
    assert slot_width(tetrahedron) == pytest.approx(math.sqrt(0.5), rel=1e-12)
    # The octahedron along (2, 2, 1) / 3 and (-2, 1, 2) / 3.
    assert sieve_size(convex_hull(bodies.octahedron(1.0))) == pytest.approx(4 / 3, rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_no_pose_tried_blindly_passes_a_random_polytope_through_less(seed):
    rng = np.random.default_rng(seed)
    hull = convex_hull(cloud(rng.normal(size=(rng.integers(5, 25), 3)) * rng.uniform(0.3, 1.0, 3)))
    size = sieve_size(hull)
    tried = squares(hull.vertices, *random_pairs(100_000, seed)).min()
    assert size <= tried < 1.06 * size
    assert slot_width(hull) <= size <= minimum_box(hull).extents[1] * (1.0 + 1e-12)


def test_no_pose_tried_blindly_passes_a_stone_through_less():
    for i, shape_class in enumerate(("cube", "plate", "column", "blade")):
        hull = convex_hull(generate(database_recipe(shape_class, seed=1000 + i)).mesh)
        pose = sieve_pose(hull)
        parts = [random_pairs(1000, 20 * i + j) for j in range(20)]
        tried = min(squares(hull.vertices, u, v).min() for u, v in parts)
        assert pose.size <= tried < 1.06 * pose.size
        # The pose is a local minimum: small turns, down to the last digits, gain nothing.
        rng = np.random.default_rng(i)
        for reach in (1e-1, 1e-3, 1e-5, 1e-7):
            turn = reach * rng.uniform(-1.0, 1.0, (400, 3))
            frames = np.linalg.qr(pose.axes + np.cross(turn[:, None], pose.axes.T).transpose(0, 2, 1))[0]
            nearby = squares(hull.vertices, frames[:, :, 0], frames[:, :, 1])
            assert nearby.min() >= pose.size * (1.0 - 1e-12)


def test_the_pose_gives_the_size():
    mesh = bodies.transformed(
        bodies.box((3, 2, 0.5)), bodies.random_rotation(np.random.default_rng(9)), shift=(8, 0, 0)
    )
    pose = sieve_pose(convex_hull(mesh))
    assert np.abs(pose.axes.T @ pose.axes - np.eye(3)).max() < 1e-13
    assert np.linalg.det(pose.axes) == pytest.approx(1.0)
    assert np.ptp(mesh.vertices @ pose.axes, axis=0) == pytest.approx(pose.extents, rel=1e-12)
    assert pose.size == pose.extents[:2].max()
    # On its edge: both sides of the square are filled, and the box passes lengthwise.
    assert pose.extents == pytest.approx([2.5 / math.sqrt(2), 2.5 / math.sqrt(2), 3.0], rel=1e-9)


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 999), exponent=st.integers(-6, 6))
def test_size_place_and_pose_do_not_matter(seed, exponent):
    rng = np.random.default_rng(seed)
    mesh = cloud(rng.normal(size=(20, 3)) * (1.0, 0.7, 0.4))
    scale = 10.0**exponent
    moved = bodies.transformed(mesh, bodies.random_rotation(rng), scale=scale, shift=scale * rng.normal(size=3))
    for measure in (sieve_size, slot_width):
        assert measure(convex_hull(moved)) == pytest.approx(scale * measure(convex_hull(mesh)), rel=1e-9)


def test_the_same_hull_gives_the_same_bytes():
    mesh = generate(database_recipe("plate", seed=3)).mesh
    one, two = (sieve_pose(convex_hull(mesh)) for _ in range(2))
    assert one.axes.tobytes() + one.extents.tobytes() == two.axes.tobytes() + two.extents.tobytes()


def test_the_size_of_the_scratch_does_not_matter(monkeypatch):
    from lithoform.descriptors import calipers, outlines

    hull = convex_hull(bodies.star(lambda u: 1.0 + 0.2 * np.sin(5 * u[:, 0]) * np.cos(4 * u[:, 1]), 800))
    at_once = sieve_pose(hull).axes, minimum_box(hull).axes, calipers.caliper_dimensions(hull).chord_axes
    for module in (calipers, outlines):
        monkeypatch.setattr(module, "_SCRATCH", 7 * len(hull.edges))
    in_parts = sieve_pose(hull).axes, minimum_box(hull).axes, calipers.caliper_dimensions(hull).chord_axes
    assert all(np.array_equal(one, two) for one, two in zip(at_once, in_parts, strict=True))
