"""Fractal dimension: 2 for what is smooth or smooth in pieces, 3 - H for relief of a known exponent H."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import bodies
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform.descriptors.fractal import _centres_of_parts, _weighed_points, fractal_dimension
from lithoform.errors import MeshError
from lithoform.generation import generate
from lithoform.mesh import Mesh
from lithoform.presets import benchmark_recipe, database_recipe
from lithoform.topology import sphere

WAVES = 300

SCANS = Path(__file__).resolve().parents[2] / "shared" / "data" / "collide"


@cache
def self_affine(hurst: float, n: int, seed: int, amplitude: float = 0.03) -> Mesh:
    """A ball with the relief of a stationary field whose variogram grows as d^2H.

    A sum of plane waves of random direction and phase, the wave number k even in ln k from 2 to 400 and the amplitude
    as k^-H: the variogram is the integral of k^-2H (1 - sin(k d) / (k d)) over ln k, that is, a multiple of d^2H for
    distances d between the wavelengths.  Waves shorter than the mesh are left out, as a scanner leaves them out.
    """
    ball = sphere("octahedral", n)
    random = np.random.default_rng(seed)
    number = 2.0 * 200.0 ** random.random(WAVES)
    wave = random.normal(size=(WAVES, 3))
    wave *= (number / np.linalg.norm(wave, axis=1))[:, None]
    weight, phase = number**-hurst, random.uniform(0.0, 2.0 * np.pi, WAVES)
    relief = np.zeros(len(ball.vertices))
    for k in range(WAVES):
        relief += weight[k] * np.cos(ball.vertices @ wave[k] + phase[k])
    relief *= amplitude / np.sqrt(0.5 * (weight**2).sum())
    return ball.with_vertices(ball.vertices * np.exp(relief)[:, None])


def cube(n: int) -> Mesh:
    import trimesh

    box = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    for _ in range(n):
        box = box.subdivide()
    return Mesh(box.vertices, np.array(box.faces))


# ------------------------------------------------------------------------------------------------------- smooth


@pytest.mark.parametrize("n", [25, 50, 80])
@pytest.mark.parametrize("axes", [(1.0, 1.0, 1.0), (1.0, 0.7, 0.5), (1.0, 1.0, 0.3), (1.0, 0.4, 0.4)])
def test_a_smooth_body_has_dimension_2(axes, n):
    ball = sphere("octahedral", n)
    found = fractal_dimension(ball.with_vertices(ball.vertices * axes))
    assert found.value == 2.0
    # Not by a hair: the roughness of a smooth surface falls faster than the window.
    assert found.hurst > 2.0
    assert found.resolved == (n > 25)


@pytest.mark.parametrize("subdivisions", [0, 3, 5])
@pytest.mark.parametrize("extents", [(1.0, 1.0, 1.0), (3.0, 2.0, 1.0), (4.0, 3.0, 1.0)])
def test_a_box_has_dimension_2_and_its_edges_have_the_exponent_of_edges(extents, subdivisions):
    # A window of radius l crosses an edge with a probability ~ l and has a roughness ~ l there: sigma^2 ~ l^3.
    body = cube(subdivisions)
    found = fractal_dimension(body.with_vertices(body.vertices * extents))
    assert found.value == 2.0
    assert found.hurst == pytest.approx(1.5, abs=0.25)


@pytest.mark.parametrize("triangles", [20_000, 5_000])
def test_the_uneven_faces_of_a_simplified_sphere_are_no_relief(triangles):
    from lithoform.simplification import simplify

    assert fractal_dimension(simplify(sphere("octahedral", 80), triangles)).value == 2.0


# -------------------------------------------------------------------------------------------------- known exponents


@pytest.mark.parametrize("n", [50, 80])
@pytest.mark.parametrize("hurst", [0.2, 0.4, 0.6, 0.8])
def test_relief_of_a_known_exponent_is_found(hurst, n):
    found = [fractal_dimension(self_affine(hurst, n, seed)) for seed in (0, 1)]
    assert np.mean([f.value for f in found]) == pytest.approx(3.0 - hurst, abs=0.14 if hurst < 0.3 else 0.07)
    assert max(f.misfit for f in found) < 0.05


def test_rougher_relief_has_the_larger_dimension_seed_by_seed():
    for seed in (0, 1):
        values = [fractal_dimension(self_affine(hurst, 50, seed)).value for hurst in (0.2, 0.4, 0.6, 0.8)]
        assert values == sorted(values, reverse=True)
        assert min(a - b for a, b in pairwise(values)) > 0.1


@pytest.mark.parametrize("hurst", [0.3, 0.7])
def test_the_mesh_matters_little_where_it_resolves_the_windows(hurst):
    coarse, fine = (fractal_dimension(self_affine(hurst, n, 2)) for n in (50, 80))
    assert coarse.value == pytest.approx(fine.value, abs=0.08)
    assert coarse.scales[-1] == pytest.approx(fine.scales[-1], rel=0.1)
    assert coarse.scales[0] == pytest.approx(1.6 * fine.scales[0], rel=0.1)


def test_the_height_of_the_relief_does_not_matter_while_slopes_are_small():
    low, high = (fractal_dimension(self_affine(0.5, 50, 3, amplitude)).value for amplitude in (0.01, 0.04))
    assert low == pytest.approx(high, abs=0.05)


def test_body_shape_does_not_matter_much():
    ball = self_affine(0.4, 50, 4)
    long = ball.with_vertices(ball.vertices * [1.0, 0.7, 0.7])
    assert fractal_dimension(long).value == pytest.approx(fractal_dimension(ball).value, abs=0.08)


def test_gain_raises_the_dimension_of_generated_stones():
    # Amplitudes fall as gain^o while frequencies rise as 2^o: H = -log2(gain) of the relief below the first octave.
    values = []
    for gain in (0.4, 0.6, 0.8):
        recipe = benchmark_recipe(
            gain=gain, lacunarity=2.0, octaves=6, perturbation=0.1, warp_strength=0.0, chip_weight=0.0, ridge_weight=0.0
        )
        values.append(fractal_dimension(generate(recipe, device="cpu").mesh).value)
    assert values == sorted(values)
    assert values[0] < 2.2
    assert values[2] == pytest.approx(3.0 + np.log2(0.8), abs=0.25)


# ------------------------------------------------------------------------------------------------------ invariance


@settings(deadline=None, max_examples=6)
@given(st.floats(1e-6, 1e6), st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.integers(0, 10**6))
def test_place_pose_and_unit_do_not_matter(factor, shift, seed):
    body = self_affine(0.4, 50, 5)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = body.with_vertices(factor * (body.vertices @ turn.T + shift))
    here, there = fractal_dimension(body), fractal_dimension(moved)
    assert there.value == pytest.approx(here.value, abs=2e-3)
    assert there.scales / factor == pytest.approx(here.scales, rel=1e-9)
    assert there.roughness / factor == pytest.approx(here.roughness, rel=1e-3)


def test_the_same_bytes_again():
    first, second = (fractal_dimension(Mesh(*self_affine_arrays())) for _ in range(2))
    assert first.value == second.value
    assert first.roughness.tobytes() == second.roughness.tobytes()


def self_affine_arrays() -> tuple[np.ndarray, np.ndarray]:
    body = self_affine(0.6, 50, 0)
    return body.vertices.copy(), body.faces.copy()


# -------------------------------------------------------------------------------------------------- parts and faults


@pytest.mark.parametrize("longest", [10.0, 0.3, 0.1])
def test_points_stand_for_the_whole_area_and_lie_on_it(longest):
    body = cube(1)
    areas = np.linalg.norm(body.area_vectors, axis=1)
    points, vectors, weights = _weighed_points(body, areas, longest)
    assert np.abs(points).max(axis=1) == pytest.approx(np.full(len(points), 0.5), abs=1e-15)
    assert weights.sum() == pytest.approx(6.0)
    assert vectors.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    # The second moments of the surface of a cube: two faces at 1/2, four of 1/12 each.
    assert len(points) == {10.0: 26, 0.3: 48 * 10**2, 0.1: 48 * 29**2}[longest]
    if longest < 1.0:
        moments = (weights[:, None] * points**2).sum(axis=0)
        assert moments == pytest.approx(np.full(3, 2.0 * 0.25 + 4.0 / 12.0), rel=1e-3)


@pytest.mark.parametrize("k", [1, 2, 5])
def test_the_parts_of_a_triangle_have_its_centre(k):
    u, v = _centres_of_parts(k)
    assert len(u) == k * k
    assert (u.mean(), v.mean()) == pytest.approx((1 / 3, 1 / 3))
    assert (u > 0).all()
    assert (v > 0).all()
    assert (u + v < 1).all()


def test_a_mesh_without_area_is_refused():
    with pytest.raises(MeshError, match="no area"):
        fractal_dimension(Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))


def test_a_database_stone_lies_between_smooth_and_rough():
    found = fractal_dimension(generate(database_recipe("cube", seed=1), device="cpu").mesh)
    assert found.resolved
    assert 2.0 <= found.value < 2.3


def test_long_slivers_make_few_points():
    # 800 faces, 60 times as long as the radius: cut by their length alone they made 3 million points.
    mesh = bodies.prism(200, 1.0, 30.0)
    areas = np.linalg.norm(mesh.area_vectors, axis=1)
    points, _, weights = _weighed_points(mesh, areas, 0.5)
    assert len(points) <= 50_000 + len(mesh.faces) + len(mesh.vertices)
    assert weights.sum() == pytest.approx(areas.sum(), rel=1e-12)
    assert fractal_dimension(mesh).value == 2.0


def test_dimension_of_a_plate_thinner_than_the_windows_stays_within_3():
    found = fractal_dimension(bodies.subdivided_box((1.0, 1.0, 0.001), 12))
    assert found.hurst < 0.0
    assert found.value == 3.0


@pytest.mark.skipif(not SCANS.is_dir(), reason="no scanned stones beside this repository")
def test_scanned_stones_lie_in_the_range_of_crushed_rock():
    from lithoform.mesh_io import read_mesh

    values = [fractal_dimension(read_mesh(SCANS / f"m_{letter}.ply")).value for letter in "AE"]
    assert all(2.0 <= value < 2.6 for value in values)
