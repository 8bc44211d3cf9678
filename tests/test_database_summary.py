"""What `lithoform database show` tells, against the rows themselves."""

from __future__ import annotations

import io
import itertools
import json
import shutil
import sys

import bodies
import numpy as np
import pytest
from captions import record_captions
from cyclopts import App
from wavy import is_drawn, stone

from lithoform import LithoformError, OutputError, RecipeError, write_mesh
from lithoform.cli.database_contents import show
from lithoform.database.building import Measures, build
from lithoform.database.importing import import_scans
from lithoform.database.store import Store
from lithoform.database.summary import SUMMARISED, describe, pick_examples, summarise
from lithoform.figures.contact_sheet import ClassRow, Section, contact_sheet
from lithoform.planning import Plan

MEASURES = Measures(("four", "length", "width", "thickness"))


def plan(count: int, seed: int = 3) -> Plan:
    return Plan(count=count, seed=seed, preset="database", shape_class="mixed", base={"triangles": 128})


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> Store:
    """A build that was stopped, a second with the same stones, and scans of which four are broken."""
    folder = tmp_path_factory.mktemp("summary")
    scans = folder / "scans"
    scans.mkdir()
    write_mesh(scans / "a.ply", bodies.box((0.03, 0.02, 0.01)))
    write_mesh(scans / "b.ply", bodies.sphere(512, radius=0.01))
    for number in range(4):
        (scans / f"c{number}.stl").write_bytes(b"solid of nothing\n")
    stopped = build(folder / "db", plan(60), MEASURES, workers=0, device="cpu")
    assert len([*itertools.islice(stopped, 25)]) == 25
    stopped.close()
    [*build(folder / "db", plan(8), MEASURES, source="again", workers=0, device="cpu")]
    [*import_scans(folder / "db", [scans], Measures(("four",), keep_meshes=True), source="quarry", workers=0)]
    return Store(folder / "db")


@pytest.fixture
def call(capsys):
    """Run `show` as a command; gives its status and what it printed."""
    app = App()
    app.command(show)

    def run(*words: object) -> tuple[int, str, str]:
        status = app(["show", *map(str, words)], exit_on_error=False, print_error=False, result_action="return_value")
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_counts_failures_and_what_is_missing_are_those_of_the_rows(store):
    stopped, again, quarry = summarise(store).sources
    batches = len(store.present(store.sources["generated"]))
    assert stopped.rows == store.table(["number"], sources=["generated"]).num_rows == min(25 * batches, 60)
    assert (stopped.asked, stopped.missing) == (60, 60 - stopped.rows)
    assert sum(stopped.classes.values()) == stopped.good == stopped.rows
    assert list(stopped.classes) == ["cube", "plate", "column", "blade"]
    assert (again.classes, again.missing, again.failed) == ({"cube": 2, "plate": 2, "column": 2, "blade": 2}, 0, 0)
    assert (quarry.kind, quarry.rows, quarry.good, quarry.failed) == ("scanned", 6, 2, 4)
    # Cutting the sphere by octahedra leaves its three extents equal; the box has 20/30 and 10/20.
    assert quarry.classes == {"cube": 1, "plate": 1}
    assert [number for number, _ in quarry.reasons] == [3, 4, 5]
    assert all("holds" in reason for _, reason in quarry.reasons)
    assert quarry.settings["files"] == 6


def test_moments_are_those_of_numpy(store):
    for source in summarise(store).sources:
        table = store.table(["error", *SUMMARISED], sources=[source.name]).to_pylist()
        for name in SUMMARISED:
            x = np.array([row[name] for row in table if row["error"] is None and row[name] is not None])
            if not len(x):
                assert name not in source.moments
                continue
            m = source.moments[name]
            assert m.count == len(x)
            assert m.mean == pytest.approx(x.mean(), rel=1e-11)
            assert m.deviation == pytest.approx(x.std(ddof=1), rel=1e-9)
            quantiles = np.quantile(x, [0, 0.05, 0.5, 0.95, 1])
            assert [m.least, m.low, m.median, m.high, m.greatest] == pytest.approx(quantiles, rel=1e-11)
    assert "sieve_size" not in summarise(store).sources[0].moments


def test_particles_of_the_same_mesh_are_found(store):
    found = summarise(store)
    assert (found.duplicated_meshes, found.duplicate_particles) == (8, 16)
    assert found.duplicates == tuple((f"again {n}", f"generated {n}") for n in (1, 2, 3))
    assert "duplicates: 16 particles share 8 meshes (again 1 and generated 1; " in describe(found)


def test_the_sizes_on_the_disk_are_those_of_the_files(store):
    for source in summarise(store).sources:
        for folder, size in (("particles", source.row_bytes), ("meshes", source.mesh_bytes)):
            files = (store.folder / folder).glob(f"{source.name}.*.parquet")
            assert size == sum(path.stat().st_size for path in files)
    assert summarise(store).sources[2].mesh_bytes > 0


def test_examples_are_fixed_by_the_seed_and_spread_over_the_classes(store):
    picked = pick_examples(store, 3)
    assert picked == pick_examples(store, 3)
    assert picked != pick_examples(store, 3, seed=1)
    counts = {key: len([*group]) for key, group in itertools.groupby(picked, key=lambda item: item[:2])}
    assert counts == {("generated", c): 3 for c in ("cube", "plate", "column", "blade")} | {
        ("again", c): 2 for c in ("cube", "plate", "column", "blade")
    } | {("quarry", "cube"): 1, ("quarry", "plate"): 1}
    rows = {(r["source"], r["number"]): r["class"] for r in store.table(["source", "number", "class"]).to_pylist()}
    assert all(rows[source, number] == label for source, label, number in picked)


def test_the_text_tells_all_and_the_json_the_numbers(store, call):
    status, text, err = call(store.folder, "--no-picture")
    assert (status, err) == (0, "")
    assert text.startswith(f"{summarise(store).as_dict()['particles']} particles of 3 sources; rows ")
    for part in ("missing   ", "failed    4", "quarry: 2 of 6 particles, scanned", "roundness", "length [mm]",
                 "preset: database", "goes on where it stopped"):  # fmt: skip
        assert part in text
    status, out, _ = call(store.folder, "--no-picture", "--json")
    told = json.loads(out)
    assert told["picture"] is None
    assert told["failed"] == 4
    assert told["sources"][1]["moments"]["length"]["mean"] == summarise(store).sources[1].moments["length"].mean
    assert told["sources"][2]["reasons"][0]["number"] == 3


def test_an_empty_database_is_told_as_such(tmp_path, call):
    with Store.writing(tmp_path / "db"):
        pass
    status, out, err = call(tmp_path / "db")
    assert (status, out) == (0, "0 particles of 0 sources; rows 0 B, meshes 0 B\n")
    assert "no picture: the database has no particles yet" in err


class TestPicture:
    @pytest.mark.usefixtures("drawing")
    def test_it_lies_in_the_database_which_stays_one(self, store, call, tmp_path, monkeypatch):
        copy = tmp_path / "db"
        shutil.copytree(store.folder, copy)
        captions = record_captions(monkeypatch)
        status, out, err = call(copy)
        assert (status, err) == (0, "")
        assert out.endswith(f"picture: {copy / 'contact-sheet.png'}\n")
        first = (copy / "contact-sheet.png").read_bytes()
        call(copy)
        assert (copy / "contact-sheet.png").read_bytes() == first
        texts = [caption.text for caption in captions]
        for text in ("db", "again: 8 generated particles", "quarry: 2 scanned particles", "blade", "000001  22.5 mm"):
            assert text in texts  # the ball of 6000 mm^3 has a diameter of 22.5 mm
        # More is built into it, and it can be summarised again.
        assert len([*build(copy, plan(60), MEASURES, workers=0, device="cpu")]) == 60
        assert summarise(Store(copy)).sources[0].missing == 0

    def test_without_the_extra_all_else_is_told(self, store, call, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
        monkeypatch.setitem(sys.modules, "pyvista", None)
        status, out, err = call(store.folder)
        assert status == 0
        assert "quarry: 2 of 6" in out
        assert "picture:" not in out
        assert err.startswith("no picture: drawing stones needs ")
        with pytest.raises(LithoformError, match="pictures"):
            call(store.folder, "--picture", tmp_path / "stones.png")

    @pytest.mark.usefixtures("drawing")
    def test_a_place_that_cannot_be_written_is_an_error_if_it_was_named(self, store, call, tmp_path):
        with pytest.raises(OutputError, match="its folder does not exist"):
            call(store.folder, "--picture", tmp_path / "none" / "stones.png")
        with pytest.raises(RecipeError, match="give one of them"):
            call(store.folder, "--picture", tmp_path / "stones.png", "--no-picture")

    @pytest.mark.usefixtures("drawing")
    def test_every_stone_stands_in_its_cell(self):
        rows = [ClassRow("cube", [("1", stone()), ("2", stone(0.2))]), ClassRow("plate", [("3", stone(0.05))])]
        picture = is_drawn(contact_sheet([Section("quarry", rows)], dpi=100))
        cell, pixel = (22.0, 19.0), 100 / 25.4
        for i, j in itertools.product(range(2), range(2)):
            left, top = 4.0 + 17.0 + i * cell[0], 4.0 + 7.0 + j * (cell[1] + 4.2 + 2.0)
            x, y = round(left * pixel), round(top * pixel)
            share = picture[y : y + round(cell[1] * pixel), x : x + round(cell[0] * pixel)].mean()
            assert (share > 0.2) == ((i, j) != (1, 1))
        for sections in ([], [Section("quarry", [])], [Section("quarry", [ClassRow("cube", [])])]):
            with pytest.raises(LithoformError, match="at least one section"):
                contact_sheet(sections)


def test_a_damaged_file_is_named(store, call, tmp_path):
    copy = tmp_path / "db"
    shutil.copytree(store.folder, copy)
    batch = copy / "particles" / "again.000001.parquet"
    batch.write_bytes(io.BytesIO(batch.read_bytes()).read(2000))
    with pytest.raises(LithoformError, match=r"again\.000001\.parquet is damaged"):
        call(copy, "--no-picture")
