"""Particles of a database as files: what is in them, what is made again, whose files are replaced."""

from __future__ import annotations

import csv
import errno
import hashlib
import json
import os
from pathlib import Path

import bodies
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cyclopts import App

from lithoform import (
    FileFormatError,
    MeshError,
    OutputError,
    RecipeError,
    SampleError,
    atomic,
    check,
    measure,
    read_mesh,
    read_recipe,
    write_mesh,
)
from lithoform.cli.database_contents import export
from lithoform.database.building import Measures, build
from lithoform.database.exporting import Export
from lithoform.database.importing import import_scans
from lithoform.database.store import Store
from lithoform.locking import folder_lock
from lithoform.planning import Plan
from lithoform.sidecar import read_sidecar

PLAN = Plan(count=8, seed=3, preset="database", shape_class="mixed", base={"triangles": 1280})


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Eight stones as recipes and a box, scanned inside out, with its mesh."""
    folder = tmp_path_factory.mktemp("exporting")
    box = bodies.box((0.03, 0.02, 0.01))
    write_mesh(folder / "box.ply", type(box)(box.vertices, box.faces[:, ::-1]))
    [*build(folder / "db", PLAN, Measures(("four", "length")), workers=0, device="cpu")]
    [
        *import_scans(
            folder / "db", [folder / "box.ply"], Measures(("four",), keep_meshes=True), source="quarry", workers=0
        )
    ]
    return folder / "db"


@pytest.fixture
def call(capsys):
    """Run `export` as a command; gives its status and what it printed."""
    app = App()
    app.command(export)

    def run(*words: object) -> tuple[int, str]:
        status = app(["export", *map(str, words)], exit_on_error=False, print_error=False, result_action="return_value")
        return status, capsys.readouterr().out

    return run


def digests(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


def test_files_hold_the_meshes_of_the_rows_and_their_sidecars_make_them_again(call, folder, tmp_path):
    out = tmp_path / "out"
    status, text = call(folder, "--out", out, "--format", "ply", "--unit", "m")
    assert (status, text) == (0, f"9 particles in {out}, with a .json sidecar each; table particles.csv\n")
    rows = Store(folder).table().to_pylist()
    names = [f"generated-{n:06d}" for n in range(1, 9)] + ["quarry-000001"]
    written = {f"{name}.{kind}" for name in names for kind in ("ply", "json")}
    assert {p.name for p in out.iterdir()} == written | {"particles.csv", "export.json"}
    for row, name in zip(rows, names, strict=True):
        mesh = read_mesh(out / f"{name}.ply", unit="m")
        # PLY in metres is exact, so that file, sidecar and row tell of the same bytes.
        assert mesh.content_hash == row["content_hash"]
        assert check(mesh).sound
        found = measure(mesh, ("four",))
        assert {key: row[key] for key in found} == dict(found)
        sidecar = read_sidecar(out / f"{name}.json")
        assert (sidecar["source"], sidecar["number"], sidecar["class"]) == (row["source"], row["number"], row["class"])
        assert sidecar["content_sha256"] == row["content_hash"]
        if row["kind"] == "generated":
            assert read_recipe(out / f"{name}.json") == PLAN.recipe(row["number"])


def test_the_sidecar_of_a_scan_tells_its_file_and_repairs_and_is_no_recipe(call, folder, tmp_path):
    call(folder, "--out", tmp_path / "out", "--select", "source = 'quarry'")
    path = tmp_path / "out" / "quarry-000001.json"
    sidecar = read_sidecar(path)
    origin = sidecar["recipe"]
    assert origin["scan"].endswith("box.ply")
    assert origin["sha256"] == hashlib.sha256(Path(origin["scan"]).read_bytes()).hexdigest()
    assert origin["repairs"] == ["turned the whole surface, which was inside out"]
    assert sidecar["seed"] is None
    assert sidecar["volume"] == pytest.approx(6000.0, rel=1e-9)
    with pytest.raises((RecipeError, FileFormatError), match="scan"):
        read_recipe(path)


def test_the_table_has_the_chosen_rows(call, folder, tmp_path):
    out = tmp_path / "out"
    call(folder, "--out", out, "--select", "select source, number from particles where class = 'blade'", "--json")
    with (out / "particles.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["mesh_file"] for row in rows] == ["generated-000004.stl", "generated-000008.stl"]
    expected = {row["number"]: row for row in Store(folder).table().to_pylist() if row["class"] == "blade"}
    for row in rows:
        told = expected[int(row["number"])]
        assert float(row["length"]) == told["length"]
        assert float(row["roundness"]) == told["roundness"]
        assert int(row["seed"]) == told["seed"]
        assert json.loads(row["inertia"]) == told["inertia"]
    assert "file_sha256" not in rows[0]  # a column of scans


def test_what_is_there_is_not_made_again_and_what_is_damaged_is(call, folder, tmp_path, monkeypatch):
    out = tmp_path / "out"
    call(folder, "--out", out)
    whole = digests(out)
    times = {p.name: p.stat().st_mtime_ns for p in out.glob("*.stl")}
    (out / "generated-000003.stl").write_bytes(b"cut")
    (out / "generated-000005.json").unlink()
    (out / ".generated-000006.stl.1234.partial").write_bytes(b"half")
    status, text = call(folder, "--out", out, "--json")
    assert status == 0
    assert json.loads(text)["written"] == 2
    assert digests(out) == whole
    again = {name for name, time in times.items() if (out / name).stat().st_mtime_ns != time}
    assert again == {"generated-000003.stl", "generated-000005.stl"}


def test_a_full_disk_is_told_and_the_same_command_goes_on(call, folder, tmp_path, monkeypatch):
    out, calls = tmp_path / "out", iter(range(1000))

    def sync(path, flags, sync=atomic._sync):
        if flags == os.O_RDWR and next(calls) >= 9:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        sync(path, flags)

    with monkeypatch.context() as patch:
        patch.setattr(atomic, "_sync", sync)
        with pytest.raises(OutputError, match="the disk is full"):
            call(folder, "--out", out)
    there = len([*out.glob("*.json")])
    assert 1 < there < 10
    assert not (out / "particles.csv").exists()
    assert not [*out.glob(".*.partial")]
    assert call(folder, "--out", out)[0] == 0
    fresh = tmp_path / "fresh"
    call(folder, "--out", fresh)
    assert digests(out) == digests(fresh)


def test_the_same_bytes_whatever_the_threads(folder, tmp_path):
    for threads in (1, 3):
        [*Export(Store(folder), format="stl").run(tmp_path / str(threads), threads=threads)]
    assert digests(tmp_path / "1") == digests(tmp_path / "3")


class TestFolders:
    def test_files_of_others_are_kept_and_refused_without_overwrite(self, call, folder, tmp_path):
        (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
        (tmp_path / "generated-000001.json").write_text("mine too", encoding="utf-8")
        with pytest.raises(
            OutputError, match=r"not empty, it holds other files \(generated-000001.json\).*--overwrite"
        ):
            call(folder, "--out", tmp_path)
        assert {p.name for p in tmp_path.iterdir()} == {"notes.txt", "generated-000001.json"}
        call(folder, "--out", tmp_path, "--overwrite", "--select", "number < 3")
        assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"
        assert read_sidecar(tmp_path / "generated-000001.json")["number"] == 1

    def test_an_export_with_other_settings_is_replaced_only_when_told(self, call, folder, tmp_path):
        out = tmp_path / "out"
        call(folder, "--out", out, "--select", "class = 'cube'")
        (out / "notes.txt").write_text("mine", encoding="utf-8")
        (out / "other-000001.stl").write_text("mine", encoding="utf-8")
        with pytest.raises(OutputError, match=r"other settings \(select, mesh_format differ\)"):
            call(folder, "--out", out, "--select", "class = 'plate'", "--format", "obj")
        call(folder, "--out", out, "--select", "class = 'blade'", "--format", "obj", "--overwrite")
        names = {p.name for p in out.iterdir()}
        stones = {f"generated-00000{n}.{kind}" for n in (4, 8) for kind in ("obj", "json")}
        assert names == stones | {"particles.csv", "export.json", "notes.txt", "other-000001.stl"}

    def test_a_database_a_held_and_an_unwritable_folder_are_refused(self, call, folder, tmp_path):
        with pytest.raises(OutputError, match="is a database; name another folder"):
            call(folder, "--out", folder, "--overwrite")
        (tmp_path / "held").mkdir()
        with folder_lock(tmp_path / "held"), pytest.raises(OutputError, match="another run is writing"):
            call(folder, "--out", tmp_path / "held")
        (tmp_path / "file").write_bytes(b"")
        with pytest.raises(OutputError, match="is a file; name a folder"):
            call(folder, "--out", tmp_path / "file")


def test_wrong_requests_are_refused_before_the_folder_is_made(call, folder, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(SampleError, match=r"has none for which .class = 'ball'. holds"):
        call(folder, "--out", out, "--select", "class = 'ball'")
    with pytest.raises(FileFormatError, match="expected a mesh format of stl"):
        call(folder, "--out", out, "--format", "step")
    with pytest.raises(FileFormatError, match="expected a unit"):
        call(folder, "--out", out, "--unit", "furlong")
    with pytest.raises(FileFormatError, match="is not there"):
        call(tmp_path / "none", "--out", out)
    assert not out.exists()


def test_a_recipe_changed_in_the_file_stops_the_export_with_the_name(call, folder, tmp_path):
    copy = tmp_path / "db"
    for path in (p for p in folder.rglob("*") if p.is_file()):
        (copy / path.relative_to(folder)).parent.mkdir(parents=True, exist_ok=True)
        (copy / path.relative_to(folder)).write_bytes(path.read_bytes())
    batch = copy / "particles" / "generated.000001.parquet"
    table = pq.read_table(batch)
    values = np.array(table["perturbation"].to_pylist())
    values[4] += 0.01
    place = table.schema.get_field_index("perturbation")
    pq.write_table(table.set_column(place, table.schema.field(place), pa.array(values)), batch)
    with pytest.raises(MeshError, match="generated-000005: its row tells of a mesh, but its recipe makes another"):
        call(copy, "--out", tmp_path / "out")
    assert not (tmp_path / "out" / "generated-000005.stl").exists()
    assert call(copy, "--out", tmp_path / "out", "--select", "number <> 5", "--overwrite")[0] == 0
