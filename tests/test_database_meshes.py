"""Meshes of a database: those that were kept, those that recipes make again, and rows that tell of another."""

from __future__ import annotations

import itertools
import shutil

import bodies
import numpy as np
import pyarrow as pa
import pytest

from lithoform import FileFormatError, MeshError, SampleError, generate, write_mesh
from lithoform.database.building import Measures, build
from lithoform.database.importing import import_scans
from lithoform.database.meshes import (
    MESH_COLUMNS,
    choose,
    particle_mesh,
    particle_meshes,
    restored_particle,
    stream_rows,
)
from lithoform.database.queries import rows_of
from lithoform.database.store import Store
from lithoform.planning import Plan

PLAN = Plan(count=12, seed=3, preset="database", shape_class="mixed", base={"triangles": 1280})
FOUR = ("four",)


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> Store:
    """Twelve stones as recipes, the same twelve with their meshes, a box and a broken scan with and without mesh."""
    folder = tmp_path_factory.mktemp("meshes")
    scans = folder / "scans"
    scans.mkdir()
    write_mesh(scans / "a.ply", bodies.box((0.03, 0.02, 0.01)))
    (scans / "b.stl").write_bytes(b"solid of nothing\n")
    database = folder / "db"
    for source, keep in (("recipes", False), ("kept", True)):
        [*build(database, PLAN, Measures(FOUR, keep_meshes=keep), source=source, workers=0, device="cpu")]
        [*import_scans(database, [scans], Measures(FOUR, keep_meshes=keep), source=f"scans-{source}", workers=0)]
    return Store(database)


def rows(store: Store, chosen: str | None = None) -> list[dict]:
    return choose(store, MESH_COLUMNS, chosen).to_pylist()


def test_a_mesh_is_the_particle_of_its_recipe_bit_for_bit_kept_or_not(store):
    made = [generate(PLAN.recipe(number), device="cpu") for number in range(1, 13)]
    for source in ("recipes", "kept"):
        for row, particle in zip(rows(store, f"source = '{source}'"), made, strict=True):
            mesh = particle_mesh(store, row, device="cpu")
            assert np.array_equal(mesh.vertices, particle.mesh.vertices)
            assert np.array_equal(mesh.faces, particle.mesh.faces)
            again = restored_particle(store, row, device="cpu")
            assert again.mesh.content_hash == particle.mesh.content_hash
            assert again.recipe == particle.recipe
            assert again.provenance == particle.provenance


def test_the_mesh_of_a_scan_is_the_one_that_was_measured(store):
    (row,) = rows(store, "source = 'scans-kept'")
    assert particle_mesh(store, row).mass_properties.volume == pytest.approx(6e-6, rel=1e-9)


def test_many_meshes_come_in_the_order_of_their_rows_whatever_the_threads(store):
    table = choose(store, MESH_COLUMNS, "kind = 'generated'")
    told = table["content_hash"].to_pylist()
    for threads in (1, 3):
        found = [m.content_hash for m in particle_meshes(store, stream_rows(table), threads=threads, device="cpu")]
        assert found == told
    # In bounded memory: rows are taken as meshes are.
    taken = itertools.count()
    stream = particle_meshes(store, (row for row in rows(store) if next(taken) >= 0), threads=1)
    next(stream)
    assert next(taken) <= 4
    stream.close()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"perturbation": 0.2}, MeshError, "recipes-000001.*makes another one here.*row was changed"),
        ({"seed": 5}, MeshError, "makes another one here"),
        ({"content_hash": "0" * 64}, MeshError, "keep-meshes"),
        ({"seed": 5, "lithoform": "0.0.9"}, MeshError, "lithoform 0.0.9 made it, and this is .*use that version"),
        ({"octaves": -1}, FileFormatError, "recipe in its row is not valid"),
        ({"gain": None}, FileFormatError, "restore the database from a copy"),
        ({"twist_axis": "z"}, FileFormatError, "recipe in its row is not valid"),
        ({"triangles": 32, "smoothing_iterations": 100}, MeshError, "makes none here"),
        ({"error": "it was not sound."}, MeshError, "has no mesh: it was not sound"),
    ],
)
def test_a_row_that_was_changed_is_told_with_its_name_and_the_way_out(store, change, error, message):
    (row,) = rows(store, "source = 'recipes' and number = 1")
    with pytest.raises(error, match=message) as caught:
        particle_mesh(store, {**row, **change}, device="cpu")
    assert "recipes-000001" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_kept_mesh_that_is_not_the_one_of_its_row_is_refused(store):
    (row,) = rows(store, "source = 'kept' and number = 2")
    with pytest.raises(FileFormatError, match="kept-000002: the kept mesh is not the one of its row"):
        particle_mesh(store, {**row, "content_hash": "0" * 64})


def test_a_scan_without_its_mesh_is_told_with_its_file(store):
    (row,) = rows(store, "source = 'scans-recipes'")
    with pytest.raises(MeshError, match=r"scan .*a\.ply was imported without its mesh.*--keep-meshes"):
        particle_mesh(store, row)


def test_a_lost_file_of_meshes_is_told(store, tmp_path):
    shutil.copytree(store.folder, tmp_path / "db")
    lost = Store(tmp_path / "db")
    lost.path(lost.sources["kept"], 1, meshes=True).unlink()
    (row,) = rows(lost, "source = 'kept' and number = 2")
    with pytest.raises(FileFormatError, match=r"kept\.000001\.parquet is damaged"):
        particle_mesh(lost, row)


class TestChoice:
    def test_a_condition_and_a_select_mean_the_same(self, store):
        names = ("source", "number")
        plain = choose(store, names, "class = 'cube' and source = 'kept'").to_pylist()
        assert plain == [{"source": "kept", "number": number} for number in (1, 5, 9)]
        for statement in (
            "select * from particles where class = 'cube' and source = 'kept' order by roundness desc",
            "SELECT number, Source from particles where class = 'cube' and source = 'kept'; ",
            "with c as (from particles where class = 'cube') select source, number from c -- c\nwhere source = 'kept'",
            "from particles where class = 'cube' and source = 'kept'",
        ):
            assert choose(store, names, statement).to_pylist() == plain
        keys = pa.table({"source": ["kept"] * 3, "number": [9, 1, 5]})
        assert rows_of(store, names, keys).to_pylist() == plain

    def test_particles_in_error_are_never_chosen(self, store):
        assert choose(store, ("number",), "source = 'scans-kept'")["number"].to_pylist() == [1]
        chosen = choose(store, ("source",), "select source, number from particles where error is not null")
        assert chosen.num_rows == 0

    def test_what_gives_no_particles_is_refused(self, store):
        with pytest.raises(SampleError, match=r"gives source and number, or a condition .* it gives number"):
            choose(store, ("number",), "select number from particles")
        with pytest.raises(SampleError, match="cannot be answered"):
            choose(store, ("number",), "klass = 'cube'")
        with pytest.raises(SampleError, match=r"Did you mean .*roundness"):
            choose(store, ("roundnes",))
