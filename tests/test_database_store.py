"""The folder of a database: whose it is, what is refused, what damage is told and what stays."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lithoform
from lithoform import DESCRIPTORS, FileFormatError, OutputError, Recipe, generate, measure
from lithoform.database.building import Measures, build
from lithoform.database.schema import particle_schema, recipe_of
from lithoform.database.sources import differing_settings
from lithoform.database.store import MANIFEST, Store, new_source
from lithoform.locking import folder_lock
from lithoform.planning import Plan

MEASURES = Measures(("boxiness", "solidity"))


def plan(count: int = 60, **base) -> Plan:
    return Plan(count=count, seed=1, preset="database", shape_class="mixed", base={"triangles": 128, **base})


def built(folder: Path, count: int = 60, measures: Measures = MEASURES, **options) -> Store:
    numbers = [*build(folder, plan(count), measures, workers=0, device="cpu", **options)]
    assert sorted(numbers) == [*range(1, count + 1)]
    return Store(folder)


def test_rows_are_the_recipes_and_the_measures_of_their_particles(tmp_path):
    store = built(tmp_path / "db", 8, Measures(("standard",), keep_meshes=True))
    rows = store.table().to_pylist()
    assert [row["number"] for row in rows] == [*range(1, 9)]
    assert [row["class"] for row in rows] == ["cube", "plate", "column", "blade"] * 2
    for row in rows:
        recipe = recipe_of(row)
        assert recipe == plan(8).recipe(row["number"])
        particle = generate(recipe, device="cpu")
        assert row["content_hash"] == particle.mesh.content_hash
        assert np.array_equal(store.mesh("generated", row["number"]).vertices, particle.mesh.vertices)
        expected = measure(particle, "standard")
        assert {name: row[name] for name in expected} == dict(expected)
        assert row["volume"] == particle.mass_properties.volume
        assert row["inertia"] == particle.mass_properties.inertia.ravel().tolist()
        assert row["error"] is None
        assert row["sieve_size"] is None  # not asked for


def test_every_descriptor_and_parameter_has_a_column_that_tells_its_meaning_and_unit():
    schema = particle_schema()
    for name in (*DESCRIPTORS, *Recipe().as_dict()):
        column = {"height": "target_height"}.get(name, name)
        assert schema.field(column).metadata[b"meaning"], name
    assert schema.field("sieve_size").metadata[b"unit"] == b"m"
    assert schema.field("volume").metadata[b"unit"] == b"m^3"
    assert len(schema.names) == len(set(schema.names))


def test_two_sources_stay_apart(tmp_path):
    built(tmp_path / "db", 30)
    store = built(tmp_path / "db", 26, source="more")
    assert store.table(["source"])["source"].to_pylist() == ["generated"] * 30 + ["more"] * 26
    assert store.missing() == {}


def test_a_source_with_other_settings_is_refused_and_nothing_is_changed(tmp_path):
    built(tmp_path / "db", 30)
    before = {p: p.read_bytes() for p in (tmp_path / "db").rglob("*") if p.is_file()}
    other = Plan(count=30, seed=2, preset="database", shape_class="mixed", base={"triangles": 128})
    with pytest.raises(OutputError, match=r"other settings \(seed differ\).*another --source"):
        [*build(tmp_path / "db", other, MEASURES, workers=0)]
    with pytest.raises(OutputError) as told:  # of a caller whose user names no source
        [*build(tmp_path / "db", other, MEASURES, is_named=False, workers=0)]
    assert "or another folder for the new particles" in str(told.value)
    assert "--source" not in str(told.value)
    with pytest.raises(OutputError, match=r"\(count differ\)"):
        [*build(tmp_path / "db", plan(31), MEASURES, workers=0)]
    with pytest.raises(OutputError, match="other settings"):
        [*build(tmp_path / "db", plan(30), Measures(("standard",)), workers=0)]
    with pytest.raises(OutputError, match="letters, digits"):
        [*build(tmp_path / "db", plan(30), MEASURES, workers=0, source="../x")]
    with pytest.raises(OutputError, match="in case alone"):  # one file on a disk that folds case
        [*build(tmp_path / "db", plan(30), MEASURES, workers=0, source="Generated")]
    assert {p: p.read_bytes() for p in (tmp_path / "db").rglob("*") if p.is_file()} == before


def test_settings_that_differ_are_told_by_the_names_under_which_they_were_given():
    base = {"triangles": 128, "seed": 0}

    def of(**plan):
        return new_source("a", "generated", 1000, batch=25, keeps_meshes=False, plan={"seed": 1, "base": base, **plan})

    assert differing_settings(of(), of()) == []
    assert differing_settings(of(), of(base={**base, "triangles": 500})) == ["triangles"]
    assert differing_settings(of(), of(base={**base, "seed": 5})) == ["base seed"]
    assert differing_settings(of(), of(levels=4)) == ["levels"]
    # What follows from other settings is told only where it is all that differs.
    assert differing_settings(of(levels=4, points_sha256="a"), of(levels=6, points_sha256="b")) == ["levels"]
    assert differing_settings(of(points_sha256="a"), of(points_sha256="b")) == ["points"]


def test_another_version_may_not_go_on_with_a_source(tmp_path):
    built(tmp_path / "db", 30)
    manifest = tmp_path / "db" / MANIFEST
    content = json.loads(manifest.read_text())
    content["sources"]["generated"]["lithoform"] = "0.0.1"
    manifest.write_text(json.dumps(content))
    with pytest.raises(OutputError, match=r"made by lithoform 0\.0\.1.*another --source"):
        built(tmp_path / "db", 30)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"format": "lithoform database", "schema": 99, "sources": {}}', "schema 99, newer than 1; update"),
        ('{"format": "other", "schema": 1, "sources": {}}', "not of a lithoform database"),
        ('{"format": "lithoform database", "schema": true, "sources": {}}', "not of a lithoform database"),
        ('{"format": "lithoform database", "schema"', "truncated or damaged"),
        ("[" * 100_000, "truncated or damaged"),
        ('{"format": "lithoform database", "schema": 1}', "its sources are not"),
        ('{"format": "lithoform database", "schema": 1, "sources": {"a": {"count": 3}}}', "its sources are not"),
        (
            '{"format": "lithoform database", "schema": 1, "sources": {"../a": {"kind": "scanned", "count": 3, "batch": 2, "keeps_meshes": true, "lithoform": "1", "plan": {}}}}',  # noqa: E501
            "its sources are not",
        ),
    ],
)
def test_foreign_newer_and_damaged_manifests_are_told(tmp_path, content, said):
    (tmp_path / MANIFEST).write_text(content)
    with pytest.raises(FileFormatError, match=said):
        Store(tmp_path)
    with pytest.raises(FileFormatError, match=said):
        [*build(tmp_path, plan(), MEASURES, workers=0)]
    assert (tmp_path / MANIFEST).read_text() == content


def test_a_folder_of_somebody_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match=r"holds other files \(thesis.tex\)"):
        [*build(tmp_path, plan(), MEASURES, workers=0)]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["thesis.tex"]
    with pytest.raises(FileFormatError, match="holds no database"):
        Store(tmp_path)
    with pytest.raises(FileFormatError, match="is not there"):
        Store(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="is a file"):
        [*build(tmp_path / "thesis.tex", plan(), MEASURES, workers=0)]


def test_a_second_build_into_the_same_folder_is_refused(tmp_path):
    folder = tmp_path / "db"
    numbers = build(folder, plan(), MEASURES, workers=0, device="cpu")
    next(numbers)
    with pytest.raises(OutputError, match="another run is writing"):
        next(build(folder, plan(), MEASURES, workers=0, source="more"))
    command = [sys.executable, "-m", "lithoform", "database", "build", str(folder), "--per-class", "1"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert "another run is writing" in done.stderr
    numbers.close()
    assert built(folder).missing() == {}
    with folder_lock(folder), pytest.raises(OutputError, match="another run is writing"):
        built(folder)


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "other", "row"])
def test_a_damaged_batch_is_told_and_made_anew_and_the_others_are_kept(tmp_path, damage):
    store = built(tmp_path / "db", 80)
    assert len(store.files) == 4
    whole = {path: path.read_bytes() for path in store.files}
    times = {path: path.stat().st_mtime_ns for path in store.files}
    victim = store.files[1]
    content = bytearray(whole[victim])
    if damage == "cut":
        content = content[: len(content) // 2]
    elif damage == "flip":
        content[200] ^= 0xFF
    elif damage == "empty":
        content = bytearray()
    elif damage == "other":
        content = bytearray(whole[store.files[2]])
    else:
        table = pq.read_table(victim)
        pq.write_table(table.slice(0, 3), victim)
        content = bytearray(victim.read_bytes())
    victim.write_bytes(content)
    assert store.damaged(store.sources["generated"], 2)
    assert not store.damaged(store.sources["generated"], 3)
    if damage in ("cut", "flip", "empty"):
        with pytest.raises(FileFormatError, match=r"generated\.000002\.parquet is damaged.*makes this batch anew"):
            store.table()
    built(tmp_path / "db", 80)
    assert {path: path.read_bytes() for path in store.files} == whole
    assert {p for p in whole if p.stat().st_mtime_ns != times[p]} == {victim}


def test_a_damaged_mesh_batch_is_told_and_made_anew(tmp_path):
    store = built(tmp_path / "db", 30, Measures(("boxiness", "solidity"), keep_meshes=True))
    path = store.path(store.sources["generated"], 1, meshes=True)
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 3] ^= 0x10
    path.write_bytes(flipped)
    assert store.mesh("generated", 26) is not None
    with pytest.raises(FileFormatError, match=r"generated\.000001\.parquet is damaged"):
        [store.mesh("generated", number) for number in range(1, 26)]
    path.unlink()
    with pytest.raises(FileFormatError, match="is damaged"):
        store.mesh("generated", 1)
    built(tmp_path / "db", 30, Measures(("boxiness", "solidity"), keep_meshes=True))
    assert path.read_bytes() == whole


def test_a_full_disk_is_told_and_the_good_batches_are_kept(tmp_path):
    code = (
        "import resource, sys; from lithoform.database.building import *; from lithoform.planning import Plan\n"
        "plan = Plan(count=80, seed=1, preset='database', shape_class='mixed', base={'triangles': 128})\n"
        "for n in build(sys.argv[1], plan, Measures(('boxiness', 'solidity')), workers=0, device='cpu'):\n"
        "    if n == 50: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "db")], capture_output=True, text=True)
    assert done.returncode == 1
    assert "OutputError: cannot write" in done.stderr
    store = Store(tmp_path / "db")
    assert len(store.files) >= 2
    assert store.table().num_rows == 25 * len(store.files)
    assert not [*(tmp_path / "db").rglob("*.partial")]
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    assert built(tmp_path / "db", 80).missing() == {}


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_told(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be used"):
        built(tmp_path / "db")
    with pytest.raises(OutputError, match="cannot be used"):
        built(tmp_path)


def test_strange_files_in_the_folders_are_not_read(tmp_path):
    store = built(tmp_path / "db", 30)
    before = store.table()
    for name in ("x.parquet", "generated.1.parquet", "generated.000001.csv", "other.000001.parquet", "contact.png"):
        (tmp_path / "db" / "particles" / name).write_bytes(b"no table")
    assert Store(tmp_path / "db").table().equals(before)


def test_no_file_of_a_database_is_a_pickle(tmp_path):
    built(tmp_path / "db", 26, Measures(("boxiness", "solidity"), keep_meshes=True))
    files = [p for p in (tmp_path / "db").rglob("*") if p.is_file()]
    assert sorted({p.suffix for p in files}) == [".json", ".parquet"]
    for path in files:
        assert path.read_bytes()[:4] in (b"PAR1", b"{\n  ")
        if path.suffix == ".parquet":
            kinds = {str(field.type) for field in pq.read_schema(path)}
            assert not [kind for kind in kinds if "binary" in kind or "extension" in kind]
    sources = [path.read_text() for path in Path(lithoform.__file__).parent.rglob("*.py")]
    assert not [text for text in sources if re.search(r"\b(pickle|marshal|shelve|joblib|allow_pickle)\b", text)]


def test_a_new_source_is_told_in_plain_values():
    source = new_source("a", "generated", 51, batch=25, keeps_meshes=False, plan={"size": (1.0, 2.0)})
    assert source.plan == {"size": [1.0, 2.0]}
    assert source.batches == 3
    assert [len(source.numbers(batch)) for batch in (1, 2, 3)] == [25, 25, 1]
