"""A particle on its way out: files, sidecars, notebooks, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lithoform import (
    FileFormatError,
    OutputError,
    Recipe,
    UnsoundMeshError,
    check,
    generate,
    generation,
    read_mesh,
    read_recipe,
)

TANGLED = Recipe(base_radius=4.0, perturbation=0.9, twist_rate=60.0, triangles=5000, seed=3)
"""A strong twist of deep relief: faces cross at first."""


@pytest.fixture(scope="module")
def stone():
    return generate(Recipe(triangles=800, seed=5), device="cpu")


def test_save_writes_a_mesh_and_a_sidecar_that_makes_it_again(stone, tmp_path):
    sidecar = stone.save(tmp_path / "stone.ply", unit="m")
    assert json.loads((tmp_path / "stone.json").read_text()) == json.loads(json.dumps(sidecar))
    np.testing.assert_array_equal(read_mesh(tmp_path / "stone.ply", unit="m").vertices, stone.mesh.vertices)
    again = generate(read_recipe(tmp_path / "stone.json"), device="cpu")
    assert again.mesh.content_hash == stone.mesh.content_hash == sidecar["content_sha256"]
    assert sidecar["provenance"] == stone.provenance
    assert sidecar["volume"] == stone.mass_properties.volume


def test_format_may_be_named_apart_from_the_extension(stone, tmp_path):
    assert stone.save(tmp_path / "stone.mesh", format="obj")["format"] == "obj"


def test_unknown_formats_units_and_folders_are_clear_errors(stone, tmp_path):
    with pytest.raises(FileFormatError, match="stl, ply, obj, glb, 3mf"):
        stone.save(tmp_path / "stone.step")
    with pytest.raises(FileFormatError, match="unit"):
        stone.save(tmp_path / "stone.stl", unit="furlong")
    with pytest.raises(OutputError, match="folder does not exist"):
        stone.save(tmp_path / "none" / "stone.stl")
    assert not list(tmp_path.iterdir())


def test_a_mesh_that_would_not_survive_the_rounding_of_the_file_is_refused(tmp_path):
    """A far shift leaves float64 sound, but 32 bits cannot tell its vertices apart."""
    stone = generate(Recipe(triangles=800, length=0.02, width=0.015, height=0.01), device="cpu")
    far = type(stone)(stone.recipe, stone.mesh.with_vertices(stone.mesh.vertices + 1e5), stone.report)
    with pytest.raises(UnsoundMeshError, match="--format ply or obj") as refused:
        far.save(tmp_path / "far.stl")
    assert refused.value.recipe is stone.recipe
    assert not refused.value.report.sound
    assert not list(tmp_path.iterdir())
    far.save(tmp_path / "far.ply")


def test_what_was_relaxed_is_reported():
    stone = generate(TANGLED, device="cpu")
    assert stone.relaxation_rounds > 0
    assert 0 < stone.provenance["relaxed_vertices"] < len(stone.mesh.vertices)
    assert generate(Recipe(triangles=800, flatten=False), device="cpu").provenance["flatten_band"] is None


def test_the_last_resort_fades_all_relief_and_says_so(monkeypatch):
    monkeypatch.setattr(generation, "_FADING_ROUND", 0)
    stone = generate(TANGLED, device="cpu")
    assert check(stone.mesh).sound
    assert stone.relaxed_vertices == len(stone.mesh.vertices)


def test_an_unsound_mesh_is_never_handed_out(monkeypatch):
    """Without its rounds of relaxation the generator raises, with the recipe and what was found."""
    monkeypatch.setattr(generation, "_MAX_ROUNDS", 0)
    with pytest.raises(UnsoundMeshError, match="pairs of faces that intersect") as refused:
        generate(TANGLED, device="cpu")
    assert refused.value.recipe == TANGLED
    assert len(refused.value.report.self_intersections) > 0
    assert f"seed={TANGLED.seed}" in str(refused.value)


def test_a_notebook_shows_a_picture(stone, monkeypatch):
    pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    assert stone._repr_png_().startswith(b"\x89PNG")
    monkeypatch.setitem(__import__("sys").modules, "pyvista", None)
    assert stone._repr_png_() is None
