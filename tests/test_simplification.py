"""Simplification: sound results of the size asked for, near the body given, whatever its unit and place."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lithoform.errors import MeshError
from lithoform.generation import generate
from lithoform.mesh import Mesh
from lithoform.presets import SHAPE_CLASSES, database_recipe
from lithoform.simplification import _bent, _unbent, _without_folds, simplification_drift, simplify
from lithoform.soundness import check
from lithoform.topology import sphere

SCANS = Path(__file__).resolve().parents[2] / "shared" / "data" / "collide"


@cache
def stone(number: int, triangles: int = 51_200) -> Mesh:
    recipe = database_recipe(SHAPE_CLASSES[number % 4], seed=number, triangles=triangles)
    return generate(recipe, device="cpu").mesh


def heights(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Height of each point above the nearest of the planes of the four faces whose centres are nearest to it."""
    from scipy.spatial import cKDTree

    normals = mesh.area_vectors / np.linalg.norm(mesh.area_vectors, axis=1)[:, None]
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    nearest = cKDTree(centres).query(points, k=4)[1]
    return np.abs(((points[:, None] - centres[nearest]) * normals[nearest]).sum(axis=2)).min(axis=1)


# ----------------------------------------------------------------------------------------- spheres and boxes


def test_a_sphere_keeps_its_volume_and_its_radius():
    fine = sphere("octahedral", 80)
    coarse = simplify(fine, 5_000)
    assert len(coarse.faces) == 5_000
    assert check(coarse).sound
    assert coarse.volume == pytest.approx(fine.volume, rel=1e-3)
    # Faces of the best mesh of 5,000 triangles sag by (edge / radius)^2 / 6 = 0.1 %.
    radii = np.linalg.norm(coarse.vertices, axis=1)
    assert radii.min() > 0.998
    assert radii.max() < 1.003
    assert np.linalg.norm(coarse.mass_properties.centroid) < 1e-4


@pytest.mark.parametrize("asked", [2_500, 1_500, 100, 12])
def test_what_is_flat_loses_nothing(asked):
    import trimesh

    box = trimesh.creation.box(extents=(3.0, 2.0, 1.0))
    for _ in range(4):
        box = box.subdivide()
    fine = Mesh(box.vertices, np.array(box.faces))
    coarse = simplify(fine, asked)
    assert (len(fine.faces), len(coarse.faces)) == (3_072, asked)
    assert check(coarse).sound
    assert coarse.volume == pytest.approx(6.0, rel=5e-5)
    assert coarse.mass_properties.area == pytest.approx(22.0, rel=5e-5)


@pytest.mark.parametrize("asked", [20_000, 5_000, 1_000, 500, 100])
def test_the_number_of_triangles_is_the_one_asked_for(asked):
    coarse = simplify(stone(1), asked)
    assert 0.99 * asked <= len(coarse.faces) <= asked
    assert check(coarse).sound


def test_an_odd_number_is_met_from_below():
    # A closed surface of triangles has 3 f / 2 edges, so that f is even.
    assert len(simplify(sphere("octahedral", 20), 1_001).faces) == 1_000


def test_a_mesh_that_is_small_enough_is_returned_as_it_is():
    ball = sphere("octahedral", 5)
    assert simplify(ball, 200) is ball
    assert simplify(ball, 10**6) is ball


def test_an_octahedron_is_as_few_triangles_as_a_ball_can_be_brought_to_here():
    coarse = simplify(sphere("octahedral", 10), 8)
    assert len(coarse.faces) == 8
    assert check(coarse).sound


# -------------------------------------------------------------------------------------------------- stones


@pytest.mark.parametrize("number", range(4))
def test_a_stone_of_each_class_stays_sound_and_near(number):
    fine = stone(number)
    for asked, volume, distance in [(20_000, 1e-4, 1e-3), (5_000, 1e-3, 3e-3)]:
        coarse = simplify(fine, asked)
        assert len(coarse.faces) == asked
        assert check(coarse).sound
        assert coarse.volume == pytest.approx(fine.volume, rel=volume)
        # Root mean square height of the old vertices above the new faces, relative to L = 20 mm.
        assert np.sqrt((heights(fine.vertices, coarse) ** 2).mean()) < distance * 0.020


def test_a_stone_with_a_flat_base_stays_sound_and_its_base_flat():
    recipe = database_recipe("cube", seed=5, triangles=20_000, flatten_depth=0.15)
    fine = generate(recipe, device="cpu").mesh
    coarse = simplify(fine, 2_000)
    assert check(coarse).sound
    assert coarse.volume == pytest.approx(fine.volume, rel=2e-3)
    assert coarse.vertices[:, 2].min() == pytest.approx(fine.vertices[:, 2].min(), abs=1e-3 * 0.020)


def test_a_bend_is_undone_to_the_last_digit():
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (1_000, 3))
    assert np.abs(_unbent(_bent(points, 1e-4), 1e-4) - points).max() < 5e-16
    assert (_unbent(_bent(points, 0.0), 0.0) == points).all()


@pytest.mark.skipif(not SCANS.is_dir(), reason="no scanned stones beside this repository")
@pytest.mark.parametrize("name", ["m_A", "m_D", "m_G"])
def test_a_scanned_stone_stays_sound_and_near(name):
    from lithoform.mesh_io import read_mesh

    scan = read_mesh(SCANS / f"{name}.ply")
    assert check(scan).sound
    coarse = simplify(scan, len(scan.faces) // 4)
    assert check(coarse).sound
    assert coarse.volume == pytest.approx(scan.volume, rel=5e-3)


# ---------------------------------------------------------------------------------------- frame and repetition


@pytest.mark.parametrize(("factor", "shift"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e3), (2.0**-300, 0.0), (2.0**300, 0.0)])
def test_unit_and_place_do_not_matter(factor, shift):
    fine = sphere("octahedral", 40)
    fine = fine.with_vertices(fine.vertices * [1.0, 0.7, 0.5])
    there = fine.with_vertices(fine.vertices * factor + shift)
    coarse, back = simplify(fine, 2_000), simplify(there, 2_000)
    # Rounding may change the order of collapses, hence the vertices, but not how near the body is.
    assert len(back.faces) == 2_000
    assert (back.vertices.max(axis=0) - shift) / factor == pytest.approx(coarse.vertices.max(axis=0), rel=2e-3)
    assert back.volume / factor / factor / factor == pytest.approx(coarse.volume, rel=2e-4)


def test_a_power_of_two_changes_no_bit():
    fine = stone(2)
    coarse = simplify(fine, 5_000)
    scaled = simplify(fine.with_vertices(fine.vertices * 1024.0), 5_000)
    assert (scaled.faces == coarse.faces).all()
    assert (scaled.vertices == 1024.0 * coarse.vertices).all()


def test_the_same_bytes_again_and_from_several_threads_at_once():
    bodies = [stone(number, 5_000) for number in range(4)] * 3
    alone = [simplify(body, 1_200).content_hash for body in bodies]
    with ThreadPoolExecutor(4) as pool:
        together = [mesh.content_hash for mesh in pool.map(lambda body: simplify(body, 1_200), bodies)]
    assert together == alone
    assert alone[:4] == alone[4:8]


# -------------------------------------------------------------------------------------------------- faults


@pytest.mark.parametrize("wrong", [3, 0, -8, 100.0, "many", True])
def test_a_number_of_triangles_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(MeshError, match="at least 4 triangles"):
        simplify(sphere("octahedral", 3), wrong)


def test_an_unsound_mesh_is_refused_by_name():
    ball = sphere("octahedral", 10)
    with pytest.raises(MeshError, match=r"must be sound .* open edges"):
        simplify(Mesh(ball.vertices, ball.faces[1:]), 100)
    with pytest.raises(MeshError, match="point inwards"):
        simplify(Mesh(ball.vertices, ball.faces[:, ::-1]), 100)
    with pytest.raises(MeshError, match="no volume"):
        simplify(Mesh(sphere("octahedral", 1).vertices * 0.0, sphere("octahedral", 1).faces), 4)


def test_a_number_that_the_library_does_not_reach_is_refused(monkeypatch):
    from lithoform import simplification

    # A threshold that hardly rises, so that the library gives up after its 100 rounds.
    monkeypatch.setattr(simplification, "_AGGRESSIVENESS", (0.5,))
    with pytest.raises(MeshError, match=r"no sound mesh of 100 triangles .* ask for more triangles"):
        simplify(stone(0), 100)


def test_two_faces_back_to_back_are_taken_out():
    faces = np.array(sphere("octahedral", 1).faces)
    folded = np.concatenate([faces[:3], [[0, 2, 7], [7, 2, 0]], faces[3:]])
    assert (_without_folds(folded) == faces).all()
    assert (_without_folds(faces) == faces).all()


def test_a_fold_that_the_library_leaves_is_mended(monkeypatch):
    import fast_simplification

    # With the package's own setting, stone 1 comes with a fold: two coincident faces on an edge of four.
    from lithoform import simplification

    fine = stone(1)
    low, high = fine.vertices.min(axis=0), fine.vertices.max(axis=0)
    unit = (fine.vertices - (low + high) / 2) / (high - low).max() * 2
    raw = Mesh(*fast_simplification.simplify(unit, np.array(fine.faces), target_count=5_000, agg=8.0))
    monkeypatch.setattr(simplification, "_AGGRESSIVENESS", (8.0,))
    mended = simplify(fine, 5_000)
    assert not check(raw).sound
    assert check(mended).sound
    assert 4_950 <= len(mended.faces) <= 5_000


# --------------------------------------------------------------------------------------------------- drift


def test_drift_is_relative_to_the_mesh_given():
    ball = sphere("octahedral", 40)
    rows = simplification_drift(
        ball, [3_200, 800], lambda mesh: {"volume": mesh.volume, "faces": len(mesh.faces), "none": 0.0}
    )
    assert [row.triangles for row in rows] == [12_800, 3_200, 800]
    assert rows[0].relative == {"volume": 0.0, "faces": 0.0, "none": 0.0}
    assert rows[1].relative["faces"] == pytest.approx(-0.75)
    assert rows[2].values["faces"] == 800
    assert rows[2].relative["volume"] == pytest.approx(rows[2].values["volume"] / rows[0].values["volume"] - 1)
    assert rows[2].relative["none"] == 0.0
    assert abs(rows[1].relative["volume"]) < 2e-3


def test_drift_from_nothing_is_not_a_number():
    ball = sphere("octahedral", 10)
    rows = simplification_drift(ball, [400], lambda mesh: {"more": float(len(mesh.faces) < 800)})
    assert np.isnan(rows[1].relative["more"])
