"""The largest inscribed sphere against closed forms, a brute-force oracle, and its invariances."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import bodies
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import benchmark_recipe, database_recipe, generate, read_mesh
from lithoform.descriptors.inscribed import inscribed_sphere
from lithoform.errors import MeshError
from lithoform.mesh import Mesh

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

SQRT_2 = math.sqrt(2.0)


def distances(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Distance of each point to the surface: over every face, the plane where its foot is inside, or the sides."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    unit = normal / np.linalg.norm(normal, axis=1)[:, None]
    out = np.empty(len(points))
    for row, x in enumerate(points):
        best = np.full(len(a), np.inf)
        inside = np.ones(len(a), dtype=bool)
        for p, q in ((a, b), (b, c), (c, a)):
            along = q - p
            t = np.clip(((x - p) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
            best = np.minimum(best, np.linalg.norm(x - p - t[:, None] * along, axis=1))
            inside &= (np.cross(along, x - p) * normal).sum(axis=1) >= 0.0
        plane = np.abs(((x - a) * unit).sum(axis=1))
        out[row] = np.where(inside, np.minimum(plane, best), best).min()
    return out


def winding(mesh: Mesh, x: np.ndarray) -> float:
    """Solid angle of the surface over 4 pi (van Oosterom and Strackee 1983): 1 inside, 0 outside."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - x for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    top = (a * np.cross(b, c)).sum(axis=1)
    bottom = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(top, bottom).sum() / (2.0 * math.pi))


def climbed(mesh: Mesh, starts: int, seed: int) -> float:
    """Brute force: random inside points, each improved by random steps of shrinking length on exact distances."""
    rng = np.random.default_rng(seed)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = rng.uniform(low, high, (12 * starts, 3))
    points = points[[abs(winding(mesh, p) - 1.0) < 0.5 for p in points]]
    best = distances(mesh, points)
    order = np.argsort(-best)[:starts]
    points, best = points[order], best[order]
    step = 0.2 * (high - low).min()
    while step > 1e-5 * (high - low).max():
        improved = False
        for _ in range(8):
            trial = points + rng.normal(size=points.shape) * step
            height = distances(mesh, trial)
            # A step no longer than the distance cannot cross the surface.
            better = (height > best) & (np.linalg.norm(trial - points, axis=1) < best)
            points[better], best[better] = trial[better], height[better]
            improved |= bool(better.any())
        if not improved:
            step *= 0.6
        keep = best > 0.9 * best.max()
        points, best = points[keep], best[keep]
        step *= 0.9
    return float(best.max())


def stone(kind: str, seed: int, triangles: int) -> Mesh:
    recipe = benchmark_recipe(seed=seed) if kind == "benchmark" else database_recipe(kind, seed=seed)
    return generate(recipe.replace(triangles=triangles)).mesh


EXACT = {
    "cube": (bodies.box((1, 1, 1)), 0.5),
    "box": (bodies.box((3, 2, 1)), 0.5),
    "long box": (bodies.box((100, 1, 1)), 0.5),
    "plate": (bodies.box((1, 1, 0.02)), 0.01),
    "foil": (bodies.box((1, 0.7, 1e-4)), 5e-5),
    "fine box": (bodies.subdivided_box((3, 2, 1), 30), 0.5),
    "octahedron": (bodies.octahedron(2.0), 2.0 / math.sqrt(3.0)),
    "tetrahedron": (bodies.tetrahedron(3.0), 3.0 / math.sqrt(24.0)),
    "tall triangular prism": (bodies.prism(3, 1.0, 5.0), 1.0),
    "low triangular prism": (bodies.prism(3, 1.0, 1.5), 0.75),
    "pentagonal prism": (bodies.prism(5, 1.0, 2.2), 1.0),
    # Between the outer walls and the inner edge: sqrt(2) (t - r) = r.
    "u channel": (bodies.u_channel(wall=1.0, height=1.5), 2.0 - SQRT_2),
    "low u channel": (bodies.u_channel(wall=1.0, height=1.0), 0.5),
    "rounded box": (bodies.rounded_box((1.5, 1.2, 1.0), 0.3), 1.0),
}


@pytest.mark.parametrize("name", EXACT)
def test_equals_the_closed_form(name):
    mesh, radius = EXACT[name]
    found = inscribed_sphere(mesh)
    assert found.radius == pytest.approx(radius, rel=1e-9)
    assert distances(mesh, found.center[None])[0] == pytest.approx(radius, rel=1e-9)
    assert winding(mesh, found.center) == pytest.approx(1.0, abs=1e-6)


def test_centre_of_a_cube_and_of_a_tetrahedron():
    for mesh in (bodies.box((1, 1, 1)), bodies.tetrahedron()):
        assert np.abs(inscribed_sphere(mesh).center).max() < 1e-9


def test_sphere_lies_between_its_faces_and_its_radius():
    mesh = bodies.sphere(20_000, "icosahedral")
    to_planes = np.abs((mesh.vertices[mesh.faces[:, 0]] * mesh.area_vectors).sum(axis=1))
    assert (to_planes / np.linalg.norm(mesh.area_vectors, axis=1)).min() <= inscribed_sphere(mesh).radius * (1 + 1e-12)
    assert inscribed_sphere(mesh).radius < 1.0


@pytest.mark.parametrize("axes", [(1.0, 0.75, 0.5), (2.0, 1.0, 1.0), (1.0, 1.0, 0.3)])
def test_ellipsoid_is_its_shortest_semi_axis_to_the_sagitta_of_the_faces(axes):
    assert inscribed_sphere(bodies.ellipsoid(axes)).radius == pytest.approx(min(axes), rel=5e-4)


@pytest.mark.parametrize("wall", [0.4, 0.1, 0.02, 0.001])
def test_sphere_in_a_bowl_is_in_its_wall(wall):
    # The bowl is a hollow half ball: its own centroid, and the middle of its box, are outside the wall.
    mesh = bodies.bowl(1.0, wall)
    found = inscribed_sphere(mesh)
    assert winding(mesh, found.center) == pytest.approx(1.0, abs=1e-6)
    # The faces cut the ball by up to 1 - cos(half an edge) of its radius, and both shells alike.
    assert 0.49 * wall < found.radius < 0.5 * wall + 1e-9


STONES = [("benchmark", 1), ("plate", 2), ("column", 3), ("blade", 2), ("cube", 4)]


@pytest.mark.parametrize(("kind", "seed"), STONES)
def test_no_random_search_finds_a_larger_sphere(kind, seed):
    mesh = stone(kind, seed, 1_152)
    found = inscribed_sphere(mesh)
    assert distances(mesh, found.center[None])[0] == pytest.approx(found.radius, rel=1e-10)
    assert winding(mesh, found.center) == pytest.approx(1.0, abs=1e-6)
    oracle = climbed(mesh, 12, seed)
    assert found.radius >= oracle * (1.0 - 1e-9)
    assert found.radius == pytest.approx(oracle, rel=8e-3)


def test_a_torn_stone_does_not_let_the_ascent_out():
    # Relief so strong that the walls are thinner than the sample: ascents between the samples climb without end.
    recipe = benchmark_recipe(
        base_radius=1.7, perturbation=1.0, main_scale=3.0, warp_scale=2.0, warp_strength=0.0,
        phase_offset=(2.0, 2.0, 2.0), octaves=7, lacunarity=2.0, gain=1.0 / 3.0, fbm_weight=0.0, ridge_weight=1.0,
        chip_weight=2.0, chip_sharpness=128.0, layer_amplitude=8.0 / 3.0, layer_frequency=0.0, twist_rate=60.0,
        width=14.0 / 9.0, height=0.8641975308641975, triangles=5_000, seed=4761106133576860377,
    )  # fmt: skip
    mesh = generate(recipe).mesh
    found = inscribed_sphere(mesh)
    assert distances(mesh, found.center[None])[0] == pytest.approx(found.radius, rel=1e-10)
    assert winding(mesh, found.center) == pytest.approx(1.0, abs=1e-6)
    assert found.radius >= climbed(mesh, 8, 1) * (1.0 - 1e-9)


@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.floats(-6.0, 6.0),
    which=st.sampled_from(["benchmark", "blade", "u", "box"]),
)
@settings(deadline=None, max_examples=15)
def test_radius_does_not_depend_on_rotation_scale_place_or_order(seed, exponent, which):
    rng = np.random.default_rng(seed)
    shapes = {"u": bodies.u_channel(), "box": bodies.box((5, 2, 1))}
    mesh = shapes[which] if which in shapes else stone(which, 5, 5_000)
    scale = 10.0**exponent
    moved = bodies.transformed(mesh, bodies.random_rotation(rng), scale=scale, shift=scale * rng.uniform(-9, 9, 3))
    order = rng.permutation(len(moved.vertices))
    place = np.argsort(order)
    shuffled = Mesh(moved.vertices[order], np.roll(place[moved.faces], 1, axis=1)[rng.permutation(len(moved.faces))])
    expected = inscribed_sphere(mesh).radius
    assert inscribed_sphere(shuffled).radius == pytest.approx(scale * expected, rel=1e-9)


def test_far_from_the_origin():
    mesh = bodies.transformed(stone("cube", 1, 5_000), shift=(1e4, -2e4, 3e4))
    near = bodies.transformed(mesh, shift=(-1e4, 2e4, -3e4))
    far = inscribed_sphere(mesh)
    assert far.radius == pytest.approx(inscribed_sphere(near).radius, rel=1e-9)
    assert distances(near, (far.center - (1e4, -2e4, 3e4))[None])[0] == pytest.approx(far.radius, rel=1e-6)


def test_power_of_two_scale_is_exact():
    mesh = stone("plate", 1, 5_000)
    found, larger = inscribed_sphere(mesh), inscribed_sphere(bodies.transformed(mesh, scale=2.0**20))
    assert larger.radius == 2.0**20 * found.radius
    assert np.array_equal(larger.center, 2.0**20 * found.center)


def test_slivers_and_uneven_faces_do_not_matter():
    # One face of the cube is cut into fans of slivers from a point close to one of its edges.
    cube = bodies.box((1, 1, 1))
    corners = np.array([[0.5, -0.5, -0.5], [0.5, 0.5, -0.5], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5]])
    side = np.isclose(cube.vertices[cube.faces][:, :, 0], 0.5).all(axis=1)
    points = np.concatenate([cube.vertices, [[0.5, -0.5 + 1e-7, 0.1]]])
    index = [int(np.argmin(np.abs(cube.vertices - p).sum(axis=1))) for p in corners]
    fan = [(index[i], index[(i + 1) % 4], 8) for i in range(4)]
    mesh = Mesh(points, np.concatenate([cube.faces[~side], fan]))
    assert mesh.volume == pytest.approx(1.0)
    assert inscribed_sphere(mesh).radius == pytest.approx(0.5, rel=1e-9)


def test_scans_of_boulders():
    files = sorted((DATA / "collide").glob("*.ply"))
    if not files:
        pytest.skip("the scanned boulders (shared/data/collide) are not beside the repository.")
    for file in files[:3]:
        mesh = read_mesh(file)
        found = inscribed_sphere(mesh)
        assert winding(mesh, found.center) == pytest.approx(1.0, abs=1e-6)
        assert distances(mesh, found.center[None])[0] == pytest.approx(found.radius, rel=1e-9)
        around = found.center + 0.05 * found.radius * np.random.default_rng(0).normal(size=(20, 3))
        assert distances(mesh, around).max() <= found.radius * (1.0 + 1e-9)


def test_threads_give_the_same_bytes():
    meshes = [stone(kind, seed, 5_000) for kind, seed in STONES]
    alone = [inscribed_sphere(mesh) for mesh in meshes]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(inscribed_sphere, meshes))
    for a, b in zip(alone, together, strict=True):
        assert a.radius == b.radius
        assert np.array_equal(a.center, b.center)


def test_inward_faces_and_flat_bodies_are_refused():
    cube = bodies.box()
    with pytest.raises(MeshError, match="flip the faces"):
        inscribed_sphere(Mesh(cube.vertices, cube.faces[:, ::-1]))
    with pytest.raises(MeshError, match="volume"):
        inscribed_sphere(cube.with_vertices(cube.vertices * (1.0, 1.0, 0.0)))
    with pytest.raises(MeshError, match="extent"):
        inscribed_sphere(cube.with_vertices(cube.vertices * 0.0))
