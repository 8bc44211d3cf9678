"""Sphere topologies: counts, closure, evenness, and shared directions."""

from itertools import pairwise

import numpy as np
import pytest

from lithoform.topology import sphere

KINDS = {"octahedral": 8, "icosahedral": 20}
SIZES = [1, 2, 3, 7, 50]

each = pytest.mark.parametrize(("kind", "n"), [(kind, n) for kind in KINDS for n in SIZES])


def angles(mesh) -> np.ndarray:
    """Angles of all faces [deg], shape (m, 3)."""
    p = mesh.vertices[mesh.faces]
    out = []
    for i in range(3):
        a, b = p[:, (i + 1) % 3] - p[:, i], p[:, (i + 2) % 3] - p[:, i]
        out.append(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))
    return np.degrees(np.stack(out, axis=1))


@each
def test_counts(kind, n):
    mesh = sphere(kind, n)
    assert len(mesh.faces) == KINDS[kind] * n * n
    assert len(mesh.vertices) == KINDS[kind] * n * n // 2 + 2


@each
def test_closed_and_a_topological_sphere(kind, n):
    faces = sphere(kind, n).faces
    assert (np.sort(np.unique(faces)) == np.arange(len(sphere(kind, n).vertices))).all()
    # Directed edges: each once, and its reverse once, counted here without the package's tables.
    directed = [(int(a), int(b)) for f in faces for a, b in pairwise([*f, f[0]])]
    assert len(set(directed)) == len(directed)
    assert {(b, a) for a, b in directed} == set(directed)
    edges = len(directed) // 2
    assert len(sphere(kind, n).vertices) - edges + len(faces) == 2


@each
def test_unit_vertices_outward_faces_no_duplicates(kind, n):
    mesh = sphere(kind, n)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 4e-16
    assert (np.linalg.det(mesh.vertices[mesh.faces]) > 0).all()
    assert len(np.unique(np.round(mesh.vertices, 9), axis=0)) == len(mesh.vertices)
    # Faces cover the sphere once: their solid angles add up to 4 pi.
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    ab, bc, ca = (a * b).sum(axis=1), (b * c).sum(axis=1), (c * a).sum(axis=1)
    solid = 2 * np.arctan2(np.linalg.det(mesh.vertices[mesh.faces]), 1 + ab + bc + ca)
    assert solid.sum() == pytest.approx(4 * np.pi, rel=1e-12)


@each
def test_symmetric_under_reflection_through_the_centre(kind, n):
    v = sphere(kind, n).vertices
    assert np.abs(v.mean(axis=0)).max() < 1e-14
    ahead, behind = (np.lexsort(np.round(p, 9).T) for p in (v, -v))
    np.testing.assert_allclose(v[ahead], -v[behind], atol=1e-14)


# At about 20,000 triangles each; the icosahedral ratio still grows with n (1.95 at n = 50).
@pytest.mark.parametrize(
    ("kind", "n", "ratio", "smallest"), [("octahedral", 50, 1.74, 45.0), ("icosahedral", 32, 1.92, 54.0)]
)
def test_evenness(kind, n, ratio, smallest):
    mesh = sphere(kind, n)
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    assert area.max() / area.min() == pytest.approx(ratio, abs=0.01)
    assert angles(mesh).min() == pytest.approx(smallest, abs=0.05)
    assert np.allclose(angles(mesh).sum(axis=1), 180)


@pytest.mark.parametrize(("coarse", "fine"), [(25, 50), (10, 50), (10, 80), (1, 7), (16, 80)])
def test_octahedral_directions_are_a_subset_bit_for_bit(coarse, fine):
    coarse_rows = {v.tobytes() for v in sphere("octahedral", coarse).vertices + 0.0}
    fine_rows = {v.tobytes() for v in sphere("octahedral", fine).vertices + 0.0}
    assert coarse_rows <= fine_rows


def test_the_poles_are_exact():
    v = sphere("octahedral", 50).vertices
    poles = np.concatenate([np.eye(3), -np.eye(3)])
    assert all((v == pole).all(axis=1).any() for pole in poles)


@pytest.mark.parametrize("kind", KINDS)
def test_area_and_volume_tend_to_those_of_the_ball(kind):
    errors = []
    for n in (10, 20, 40):
        p = sphere(kind, n).mass_properties
        errors.append((4 * np.pi - p.area, 4 * np.pi / 3 - p.volume))
    for coarse, fine in pairwise(np.array(errors)):
        assert np.allclose(coarse / fine, 4, rtol=0.02)  # second order, from below


def test_the_same_object_is_returned_and_it_is_read_only():
    mesh = sphere("icosahedral", 4)
    assert sphere("icosahedral", 4) is mesh
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        mesh.faces[0, 0] = 1


@pytest.mark.parametrize(
    ("kind", "n"), [("octahedral", 0), ("octahedral", -3), ("cubic", 4), ("", 1), ("icosahedral", 0), ("OCTAHEDRAL", 2)]
)
def test_wrong_arguments(kind, n):
    with pytest.raises(ValueError, match=f"octahedral or icosahedral and n >= 1, got '{kind}' and {n}"):
        sphere(kind, n)
