"""Conditioning: what each step must keep, and what it must reach."""

import math
from itertools import pairwise, product

import numpy as np
import oracles
import pytest

from lithoform.conditioning import fit_to_box, principal_frame, smooth, twist
from lithoform.errors import MeshError
from lithoform.mesh import Mesh
from lithoform.presets import benchmark_recipe
from lithoform.radius import radii
from lithoform.topology import sphere

SIZE = (2.0, 1.5, 1.0)
WEIGHTINGS = ("vertices", "surface", "solid")


def stone(seed: int = 1, n: int = 12) -> Mesh:
    """A stone of the benchmark, turned and moved out of every symmetry."""
    ball = sphere("octahedral", n)
    r = radii([benchmark_recipe(seed=seed)], ball.vertices)[0]
    return ball.with_vertices(
        (ball.vertices * r[:, None] * [1.5, 1.0, 0.7]) @ oracles.rotation(seed).T + [0.3, -0.2, 0.5]
    )


STONE = stone()


# ------------------------------------------------------------------------------------------------ twist


@pytest.mark.parametrize("rate", [0.1, math.radians(45), math.radians(60), -3.0])
@pytest.mark.parametrize(
    ("axis", "point"), [((1, 0, 1), (1, 0, 0)), ((0, 0, 5), (0, 0, 0)), ((-1, 2, 0.3), (7, -3, 2))]
)
def test_twist_keeps_distances_to_the_axis_and_coordinates_along_it(axis, point, rate):
    turned = twist(STONE, axis=axis, point=point, rate=rate)
    a = np.array(axis) / np.linalg.norm(axis)

    def cylindrical(mesh):
        d = mesh.vertices - point
        return d @ a, np.linalg.norm(d - np.outer(d @ a, a), axis=1)

    for before, after in zip(cylindrical(STONE), cylindrical(turned), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-13)
    assert turned.connectivity is STONE.connectivity
    assert np.abs(turned.vertices - STONE.vertices).max() > 0.01
    # Twisting back is the inverse, since the coordinate along the axis is kept.
    back = twist(turned, axis=axis, point=point, rate=-rate)
    np.testing.assert_allclose(back.vertices, STONE.vertices, atol=1e-12)


def test_the_angle_is_the_rate_times_the_axial_coordinate_by_the_right_hand():
    line = Mesh([[1, 0, 0], [1, 0, 1], [1, 0, 2], [1, 0, -1]], [[0, 1, 2], [0, 2, 3]])
    turned = twist(line, axis=(0, 0, 2), point=(0, 0, 0), rate=0.5).vertices
    np.testing.assert_allclose(np.arctan2(turned[:, 1], turned[:, 0]), [0, 0.5, 1.0, -0.5], atol=1e-15)
    # The zero of the angle is at the point.
    shifted = twist(line, axis=(0, 0, 2), point=(0, 0, 1), rate=0.5).vertices
    np.testing.assert_allclose(np.arctan2(shifted[:, 1], shifted[:, 0]), [-0.5, 0, 0.5, -1.0], atol=1e-15)


def test_twist_against_the_matrix_form_of_rodrigues():
    axis, point, rate = np.array([1.0, 0, 1]), np.array([1.0, 0, 0]), math.radians(45)
    a = axis / np.linalg.norm(axis)
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    expected = []
    for p in STONE.vertices[::7]:
        angle = rate * a @ (p - point)
        rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        expected.append(point + rotation @ (p - point))
    np.testing.assert_allclose(twist(STONE, axis=axis, point=point, rate=rate).vertices[::7], expected, atol=1e-14)


def test_twist_keeps_the_volume_of_a_fine_mesh():
    # The map has a Jacobian of 1; what is lost is the flatness of the faces.
    losses = []
    for n in (12, 24):
        mesh = stone(1, n)
        turned = twist(mesh, axis=(1, 0, 1), point=(1, 0, 0), rate=math.radians(45))
        losses.append(abs(turned.mass_properties.volume / mesh.mass_properties.volume - 1))
    assert losses[1] < 2e-3
    assert losses[1] < 0.4 * losses[0]


def test_a_rate_of_zero_is_the_same_mesh():
    assert twist(STONE, axis=(0, 0, 1), point=(0, 0, 0), rate=0.0) is STONE


@pytest.mark.parametrize(
    "change",
    [
        {"axis": (0, 0, 0)},
        {"axis": (0, np.nan, 1)},
        {"axis": (np.inf, 0, 0)},
        {"axis": (1, 0)},
        {"point": (0, np.nan, 0)},
        {"point": (np.inf, 0, 0)},
        {"point": 0},
        {"rate": np.nan},
        {"rate": np.inf},
    ],
)
def test_twist_refuses_what_it_cannot_do(change):
    with pytest.raises(MeshError, match="a twist needs an axis"):
        twist(STONE, **{"axis": (0, 0, 1), "point": (0, 0, 0), "rate": 1.0, **change})


# ------------------------------------------------------------------------------------------------ smooth


@pytest.mark.parametrize("method", ["laplacian", "taubin"])
def test_smoothing_keeps_the_centroid_and_symmetry_of_a_symmetric_body(method):
    ball = sphere("octahedral", 10)
    body = ball.with_vertices(ball.vertices * [3, 2, 1] + [4, 5, 6])
    done = smooth(body, iterations=20, method=method)
    np.testing.assert_allclose(done.vertices.mean(axis=0), [4, 5, 6], atol=1e-12)
    np.testing.assert_allclose(done.mass_properties.centroid, [4, 5, 6], atol=1e-12)
    np.testing.assert_allclose(done.mass_properties.inertia, np.diag(np.diag(done.mass_properties.inertia)), atol=1e-10)


def test_one_step_is_the_printed_formula():
    # V <- V + lambda (W V - V), with the one-ring found here from the faces.
    neighbours = [set() for _ in STONE.vertices]
    for f in STONE.faces.tolist():
        for i in f:
            neighbours[i] |= set(f) - {i}
    mean = np.array([STONE.vertices[sorted(near)].mean(axis=0) for near in neighbours])
    done = smooth(STONE, iterations=1, lambda_=0.3)
    np.testing.assert_allclose(done.vertices, STONE.vertices + 0.3 * (mean - STONE.vertices), atol=1e-14)
    once = smooth(STONE, iterations=1, method="taubin", lambda_=0.3, mu=-0.4)
    back = smooth(smooth(STONE, iterations=1, lambda_=0.3), iterations=1, lambda_=1.0)  # W after the first step
    np.testing.assert_allclose(once.vertices, done.vertices - 0.4 * (back.vertices - done.vertices), atol=1e-14)
    twice = smooth(done, iterations=1, lambda_=0.3)
    assert (smooth(STONE, iterations=2, lambda_=0.3).vertices == twice.vertices).all()


def roughness(mesh: Mesh) -> float:
    """Root mean square distance of the vertices from the mean of their neighbours."""
    lag = mesh.connectivity.neighbour_mean @ mesh.vertices - mesh.vertices
    return float(np.sqrt((lag**2).sum(axis=1).mean()))


def test_laplacian_shrinks_step_by_step_and_taubin_keeps_the_volume():
    volume = STONE.mass_properties.volume
    steps = [0, 1, 2, 5, 10, 20, 50]
    laplacian = [smooth(STONE, iterations=n) for n in steps]
    taubin = [smooth(STONE, iterations=n, method="taubin") for n in steps]
    assert all(b.mass_properties.volume < a.mass_properties.volume for a, b in pairwise(laplacian))
    # At 20 iterations on this mesh (measured): Laplacian 0.67 of the volume, Taubin 1.015.
    kept = {
        n: (a.mass_properties.volume / volume, b.mass_properties.volume / volume)
        for n, a, b in zip(steps, laplacian, taubin, strict=True)
    }
    assert kept[20][0] < 0.85
    assert abs(kept[20][1] - 1) < 0.02
    for n in steps[1:]:
        assert abs(kept[n][1] - 1) < 0.2 * abs(kept[n][0] - 1)
    # Both do smooth.
    assert roughness(laplacian[-1]) < 0.5 * roughness(STONE)
    assert roughness(taubin[-1]) < 0.8 * roughness(STONE)


def test_smoothing_commutes_with_affine_maps():
    affine = oracles.rotation(4) @ np.diag([2.0, 1.0, 0.5])
    a = smooth(STONE.with_vertices(STONE.vertices @ affine.T + 3.0), iterations=7)
    b = smooth(STONE, iterations=7)
    np.testing.assert_allclose(a.vertices, b.vertices @ affine.T + 3.0, atol=1e-13)


def test_no_iterations_is_the_same_mesh():
    assert smooth(STONE, iterations=0) is STONE
    assert smooth(STONE, iterations=3).connectivity is STONE.connectivity


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"iterations": -1}, "iterations >= 0"),
        ({"lambda_": 0.0}, "0 < lambda <= 1"),
        ({"lambda_": 1.1}, "0 < lambda <= 1"),
        ({"lambda_": np.nan}, "0 < lambda <= 1"),
        ({"method": "gaussian"}, "laplacian or taubin; got 'gaussian'"),
        ({"method": "taubin", "mu": -0.5}, "mu < -lambda"),
        ({"method": "taubin", "mu": 0.6}, "mu < -lambda"),
        ({"method": "taubin", "mu": np.nan}, "mu < -lambda"),
    ],
)
def test_smooth_refuses_what_it_cannot_do(change, message):
    with pytest.raises(MeshError, match=message):
        smooth(STONE, **{"iterations": 1, **change})


# ------------------------------------------------------------------------------------------------ principal frame


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_principal_frame_of_a_turned_box(weighting):
    vertices, faces = oracles.box((4.0, 2.0, 1.0), 4)
    rotation = oracles.rotation(3)
    centroid, axes = principal_frame(Mesh(vertices @ rotation.T + [1, 2, 3], faces), weighting)
    np.testing.assert_allclose(centroid, [1, 2, 3], atol=1e-13)
    np.testing.assert_allclose(np.abs((axes * rotation).sum(axis=0)), 1.0, atol=1e-12)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_principal_frame_of_an_ellipsoid(weighting):
    ball = sphere("icosahedral", 12)
    rotation = oracles.rotation(11)
    body = ball.with_vertices((ball.vertices * [1.0, 3.0, 2.0]) @ rotation.T - 4.0)
    centroid, axes = principal_frame(body, weighting)
    np.testing.assert_allclose(centroid, -4.0, atol=1e-12)
    np.testing.assert_allclose(np.abs((axes * rotation[:, [1, 2, 0]]).sum(axis=0)), 1.0, atol=1e-12)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("seed", range(5))
def test_principal_frame_is_right_handed_orthonormal_and_signed(weighting, seed):
    mesh = stone(seed)
    _, axes = principal_frame(mesh, weighting)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-13)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    for e in axes.T[:2]:
        assert e[np.argmax(np.abs(e))] > 0
    # In the frame: no products of inertia, and falling variance.  Moments are estimated here from samples.
    if weighting == "vertices":
        samples, weights = mesh.vertices, np.ones(len(mesh.vertices))
    elif weighting == "surface":
        # Mid-points of the sides integrate polynomials of degree 2 over a triangle exactly.
        p = mesh.vertices[mesh.faces]
        samples = ((p + np.roll(p, -1, axis=1)) / 2).reshape(-1, 3)
        weights = np.repeat(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1), 3)
    else:
        # Tetrahedra from the origin by a four-point rule of degree 2.
        p = mesh.vertices[mesh.faces]
        p = np.concatenate([p, np.zeros((len(p), 1, 3))], axis=1)
        b = (5 - math.sqrt(5)) / 20
        samples = (b * p.sum(axis=1, keepdims=True) + (1 - 4 * b) * p).reshape(-1, 3)
        weights = np.repeat(np.linalg.det(p[:, :3]), 4)
    centroid = weights @ samples / weights.sum()
    np.testing.assert_allclose(principal_frame(mesh, weighting)[0], centroid, atol=1e-12)
    local = (samples - centroid) @ axes
    covariance = (local * weights[:, None]).T @ local / weights.sum()
    np.testing.assert_allclose(covariance, np.diag(np.diag(covariance)), atol=1e-12)
    assert all(a > b for a, b in pairwise(np.diag(covariance)))


def test_principal_frame_refuses_an_unknown_weighting():
    with pytest.raises(MeshError, match="vertices, surface or solid; got 'mass'"):
        principal_frame(STONE, "mass")


# ------------------------------------------------------------------------------------------------ fit to box

COMBINATIONS = list(product(("pca", "aabb"), WEIGHTINGS, ("exact", "uniform"), (True, False)))


def extents_along(mesh: Mesh, axes: np.ndarray) -> np.ndarray:
    return np.ptp(mesh.vertices @ axes, axis=0)


@pytest.mark.parametrize(("frame", "weighting", "fit", "align"), COMBINATIONS)
@pytest.mark.parametrize("size", [SIZE, (20e-3, 9e-3, 4e-3), (1000.0, 999.0, 998.0)])
def test_fit_to_box_meets_its_targets(frame, weighting, fit, align, size):
    done = fit_to_box(STONE, size, frame=frame, weighting=weighting, fit=fit, align=align)
    centroid, principal = principal_frame(STONE, weighting)
    before = extents_along(STONE, np.eye(3) if frame == "aabb" else principal)
    after = extents_along(done, np.eye(3) if align or frame == "aabb" else principal)
    if fit == "exact":
        np.testing.assert_allclose(after, size, rtol=1e-9)
    else:
        assert (after <= np.array(size) * (1 + 1e-9)).all()  # inside the box
        assert (np.abs(after / size - 1) < 1e-9).sum() == 1  # and touching one pair of its faces
        np.testing.assert_allclose(after / before, (after / before)[0], rtol=1e-9)
    volume = STONE.mass_properties.volume * (after / before).prod()
    assert done.mass_properties.volume == pytest.approx(volume, rel=1e-9)
    # An affine map carries the centroids of the vertices and of the solid along: they stay where they were.
    if weighting != "surface" or fit == "uniform":
        np.testing.assert_allclose(principal_frame(done, weighting)[0], centroid, atol=1e-9)
    assert volume > 0
    assert done.connectivity is STONE.connectivity
    assert oracles.solidity(done.vertices, done.faces) == pytest.approx(
        oracles.solidity(STONE.vertices, STONE.faces), rel=1e-9
    )


@pytest.mark.parametrize("fit", ["exact", "uniform"])
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_align_turns_the_same_body(fit, weighting):
    kept = fit_to_box(STONE, SIZE, weighting=weighting, fit=fit, align=False)
    aligned = fit_to_box(STONE, SIZE, weighting=weighting, fit=fit, align=True)
    centroid, axes = principal_frame(STONE, weighting)
    np.testing.assert_allclose((kept.vertices - centroid) @ axes, aligned.vertices - centroid, atol=1e-13)
    assert kept.mass_properties.volume == pytest.approx(aligned.mass_properties.volume, rel=1e-12)


def test_uniform_fit_is_a_similarity():
    done = fit_to_box(STONE, SIZE, fit="uniform", align=True)
    i, j = np.random.default_rng(1).integers(0, len(STONE.vertices), size=(2, 500))
    i, j = i[i != j], j[i != j]
    before = np.linalg.norm(STONE.vertices[i] - STONE.vertices[j], axis=1)
    after = np.linalg.norm(done.vertices[i] - done.vertices[j], axis=1)
    np.testing.assert_allclose(after / before, (after / before)[0], rtol=1e-11)


def test_the_axes_of_a_box_go_to_length_width_height():
    vertices, faces = oracles.box((1.0, 4.0, 2.0), 3)
    rotation = oracles.rotation(9)
    done = fit_to_box(Mesh(vertices @ rotation.T, faces), (8.0, 4.0, 1.0))
    # The side of 4 becomes L along x, that of 2 W along y, that of 1 H along z.
    assert done.mass_properties.volume == pytest.approx(32.0)
    np.testing.assert_allclose(np.sort(np.abs(done.vertices).max(axis=0))[::-1], [4, 2, 0.5], rtol=1e-12)
    np.testing.assert_allclose(np.abs(done.vertices).max(axis=0), [4, 2, 0.5], rtol=1e-12)


def test_fitting_twice_changes_nothing():
    once = fit_to_box(STONE, (2.0, 1.2, 0.7))
    twice = fit_to_box(once, (2.0, 1.2, 0.7), frame="aabb")
    np.testing.assert_allclose(twice.vertices, once.vertices, atol=1e-14)


@pytest.mark.parametrize("size", [(1, 1), (1, 1, 0), (1, -1, 1), (1, 1, np.nan), (np.inf, 1, 1), 3.0, (1, 1, 1, 1)])
def test_targets_that_are_no_box_are_refused(size):
    with pytest.raises(MeshError, match="three positive extents"):
        fit_to_box(STONE, size)


@pytest.mark.parametrize("change", [{"frame": "obb"}, {"fit": "loose"}, {"frame": "none"}])
def test_unknown_names_are_refused(change):
    with pytest.raises(MeshError, match="frame of pca or aabb and a fit of exact or uniform"):
        fit_to_box(STONE, SIZE, **change)
    with pytest.raises(MeshError, match="weighting"):
        fit_to_box(STONE, SIZE, weighting="mass")


def test_a_flat_body_is_refused():
    flat = STONE.with_vertices(STONE.vertices * [1, 1, 0])
    for frame in ("pca", "aabb"):
        with pytest.raises(MeshError, match="the body is flat"):
            fit_to_box(flat, SIZE, frame=frame)
    with pytest.raises(MeshError, match="the body is flat"):
        fit_to_box(STONE.with_vertices(STONE.vertices * 0), SIZE, frame="aabb")
    thin = STONE.with_vertices(STONE.vertices * [1, 1, 1e-6])  # thin is not flat
    np.testing.assert_allclose(extents_along(fit_to_box(thin, SIZE, frame="aabb"), np.eye(3)), SIZE, rtol=1e-9)


def test_steps_leave_their_input_alone():
    before = STONE.content_hash
    twist(STONE, axis=(0, 0, 1), point=(0, 0, 0), rate=1.0)
    smooth(STONE, iterations=2)
    fit_to_box(STONE, SIZE)
    assert Mesh(STONE.vertices, STONE.connectivity).content_hash == before


@pytest.mark.parametrize("weighting", ["vertices", "surface", "solid"])
@pytest.mark.parametrize("squash", [(1, 0, 0), (0, 0, 0), (1, 1, 0)])
def test_bodies_without_extent_are_refused(weighting, squash):
    ball = sphere("octahedral", 2)
    with pytest.raises(MeshError):
        fit_to_box(ball.with_vertices(ball.vertices * squash), (3, 2, 1), weighting=weighting)


def test_smoothing_leaves_vertices_that_no_face_uses_alone():
    ball = sphere("octahedral", 2)
    lone = Mesh(np.vstack([ball.vertices, [10.0, 10.0, 12.0]]), ball.faces)
    assert smooth(lone, iterations=3).vertices[-1].tolist() == [10.0, 10.0, 12.0]
