"""What is read from a database: SQL, populations for comparisons, and scans that were imported."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lithoform import FileFormatError, MeshError, OutputError, SampleError, generate, measure, read_scan, write_mesh
from lithoform.database.building import Measures, build
from lithoform.database.importing import import_scans
from lithoform.database.population import Population, read_population
from lithoform.database.queries import query, select, table_to_csv
from lithoform.database.store import Store
from lithoform.planning import Plan

FDOT = Path(__file__).resolve().parents[2] / "shared" / "data" / "fdot57"
MEASURES = Measures(("boxiness", "solidity", "length", "elongation"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Forty generated particles and three scans, one of them no scan."""
    base = tmp_path_factory.mktemp("reading")
    plan = Plan(count=40, seed=1, preset="database", shape_class="mixed", base={"triangles": 128})
    assert len([*build(base / "db", plan, MEASURES, workers=0, device="cpu")]) == 40
    (base / "scans").mkdir()
    for name, number in (("b.ply", 3), ("a.stl", 2)):
        write_mesh(base / "scans" / name, generate(plan.recipe(number)).mesh, unit="mm")
    (base / "scans" / "c.stl").write_bytes(b"solid nothing")
    keep = Measures(MEASURES.names, keep_meshes=True)
    assert len([*import_scans(base / "db", [base / "scans"], keep, source="quarry", workers=0)]) == 3
    return base / "db"


def test_imported_scans_are_measured_by_the_same_code(folder):
    rows = select(folder, ["source", "number", "kind", "file", "file_format", "class", "solidity", "length"],
                  "source = 'quarry'").to_pylist()  # fmt: skip
    assert [(row["number"], Path(row["file"]).name, row["file_format"]) for row in rows] == [
        (1, "a.stl", "stl"),
        (2, "b.ply", "ply"),
    ]
    for row in rows:
        scan = read_scan(row["file"], unit="mm")
        assert {name: row[name] for name in ("solidity", "length")} == dict(measure(scan.mesh, ["solidity", "length"]))
        assert row["class"] == measure(scan.mesh, "zingg_class")["zingg_class"]
        assert row["kind"] == "scanned"
        kept = Store(folder).mesh("quarry", row["number"])
        assert kept.content_hash == scan.mesh.content_hash
    [failed] = query(folder, "select number, error, solidity from particles where error is not null").to_pylist()
    assert failed["number"] == 3
    assert failed["solidity"] is None
    assert "c.stl" in failed["error"]


def test_an_import_goes_on_where_it_stopped_and_other_files_are_refused(folder):
    scans = folder.parent / "scans"
    keep = Measures(MEASURES.names, keep_meshes=True)
    assert [*import_scans(folder, [scans], keep, source="quarry", workers=0)] == [1, 2, 3]
    with pytest.raises(OutputError, match=r"other settings \(count, files differ\)"):
        [*import_scans(folder, [scans / "a.stl"], keep, source="quarry", workers=0)]
    with pytest.raises(OutputError, match="other settings"):
        [*import_scans(folder, [scans], keep, source="quarry", unit="m", workers=0)]
    with pytest.raises(FileFormatError, match="unit"):
        [*import_scans(folder, [scans], keep, source="other", unit="furlong", workers=0)]
    with pytest.raises(FileFormatError, match="there is no"):
        [*import_scans(folder, [folder / "nowhere"], keep, source="other", workers=0)]
    with pytest.raises(MeshError, match="Did you mean"):
        [*import_scans(folder, [scans], Measures(("soliditi",)), source="other", workers=0)]


def test_queries_agree_with_a_plain_reading(folder):
    table = Store(folder).table()
    [row] = query(folder, "select count(*) n, avg(solidity) mean, max(length) most from particles").to_pylist()
    assert row["n"] == table.num_rows == 43
    there = [r for r in table.to_pylist() if r["error"] is None]
    assert row["mean"] == pytest.approx(np.mean([r["solidity"] for r in there]), rel=1e-14)
    assert row["most"] == max(r["length"] for r in there)


def test_any_tool_opens_the_files(folder):
    files = sorted((folder / "particles").glob("generated.*.parquet"))
    assert pq.read_table(files[0]).num_rows == 25
    import duckdb

    pattern = str(folder / "particles" / "*.parquet")
    assert duckdb.sql(f"select count(*) from read_parquet('{pattern}')").fetchall() == [(43,)]
    assert pq.read_schema(files[0]).field("length").metadata[b"unit"] == b"m"


@pytest.mark.parametrize(
    ("sql", "said"),
    [
        ("selec", "syntax error"),
        ("", "expected one SELECT"),
        ("select 1; select 2", "expected one SELECT"),
        ("drop view particles", "expected one SELECT"),
        ("create table t as select 1", "expected one SELECT"),
        ("copy particles to 'out.csv'", "expected one SELECT"),
        ("explain analyze copy particles to 'out.csv'", "expected one SELECT"),
        ("attach 'other.db'", "expected one SELECT"),
        ("install httpfs", "expected one SELECT"),
        ("set threads = 1", "expected one SELECT"),
        ("select nothing from particles", "nothing"),
        ("select * from read_text('/etc/hostname')", "cannot be answered"),
        ("select * from '/etc/hostname'", "cannot be answered"),
        ("select * from glob('/etc/*')", "cannot be answered"),
    ],
)
def test_a_query_reads_the_database_and_nothing_else(folder, sql, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SampleError, match=said):
        query(folder, sql)
    assert not [*tmp_path.iterdir()]


def test_a_database_without_rows_answers_too(tmp_path):
    with Store.writing(tmp_path / "db"):
        pass
    assert query(tmp_path / "db", "select count(*) n from particles").to_pylist() == [{"n": 0}]
    with pytest.raises(SampleError, match="there are none"):
        read_population(tmp_path / "db", ("solidity",))


def test_selection_keeps_the_order_and_knows_its_columns(folder):
    rows = select(folder, ["source", "number"], "number < 4 -- and more").to_pylist()
    assert [(r["source"], r["number"]) for r in rows] == [("generated", 1), ("generated", 2), ("generated", 3),
                                                          ("quarry", 1), ("quarry", 2)]  # fmt: skip
    with pytest.raises(SampleError, match="Did you mean solidity"):
        select(folder, ["soliditi"])
    with pytest.raises(SampleError, match="cannot be answered"):
        select(folder, ["solidity"], "number <")
    with pytest.raises(SampleError, match=r"cannot be answered|one SELECT"):
        select(folder, ["solidity"], "1=1); drop view particles; select (1")


def test_a_damaged_file_is_named_by_queries_too(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "db")
    victim = tmp_path / "db" / "particles" / "generated.000002.parquet"
    victim.write_bytes(victim.read_bytes()[:-100])
    with pytest.raises(FileFormatError, match=r"generated\.000002\.parquet is damaged"):
        query(tmp_path / "db", "select count(*), avg(solidity) from particles")


@pytest.mark.parametrize("batch", ["000001", "000002"])
@pytest.mark.parametrize("damage", ["empty", "cut", "flip", "unreadable"])
def test_whatever_file_is_damaged_every_reader_tells_it(folder, tmp_path, run, batch, damage):
    shutil.copytree(folder, tmp_path / "db")
    victim = tmp_path / "db" / "particles" / f"generated.{batch}.parquet"
    content = bytearray(victim.read_bytes())
    if damage == "flip":
        # In the page of a column that is asked for, where no reader but one that tries checksums would see it.
        column = pq.read_metadata(victim).row_group(0)
        place = next(c for c in map(column.column, range(column.num_columns)) if c.path_in_schema == "solidity")
        first = place.dictionary_page_offset or place.data_page_offset
        content[first + place.total_compressed_size - 3] ^= 0x10
    elif damage == "unreadable":
        victim.unlink()
        victim.mkdir()
    if damage != "unreadable":
        victim.write_bytes({"empty": b"", "cut": content[:-100]}.get(damage, content))
    for arguments in (
        ("query", "db", "select avg(solidity) from particles"),
        ("show", "db", "--no-picture"),
        ("export", "db", "--out", "out"),
        ("grade", "db", "--gradation", "AC-13", "--mass", "1kg", "--out", "g.csv"),
    ):
        if damage == "flip" and arguments[0] == "grade":
            continue  # it reads other columns
        status, _, err = run("database", *arguments)
        assert status == 2
        assert f"generated.{batch}.parquet" in err, err
        assert "unexpected" not in err


def test_names_of_folders_mean_nothing(folder, tmp_path):
    for name in ("class=foo", "number=3", "br[a]c", "star*", "qm?", "~tilde", "it's", 'two "words"', "ünï"):
        place = tmp_path / name / "db"
        shutil.copytree(folder, place)
        shutil.copytree(folder, tmp_path / "brac", dirs_exist_ok=True)
        assert query(
            place, "select count(*) n, count(distinct class) c from particles where error is null"
        ).to_pylist() == [{"n": 42, "c": 4}]
        assert select(place, ["number"], "number = 2 and source = 'quarry'").num_rows == 1
    with pytest.raises(FileFormatError, match="whose name is UTF-8"):
        Store(Path(os.fsdecode(b"non\xff")))


def test_a_random_choice_is_asked_once(folder, run, tmp_path):
    some = "select source, number from particles where source = 'generated' order by random() limit 7"
    status, _, err = run("database", "export", str(folder), "--out", "out", "--select", some)
    assert (status, err) == (0, "")
    listed = {row["mesh_file"] for row in csv.DictReader(Path("out/particles.csv").read_text().splitlines())}
    assert listed == {path.name for path in Path("out").glob("*.stl")}
    assert len(listed) == 7
    options = ["--gradation", "AC-13", "--min-size", "4.75mm", "--mass", "1kg", "--out", "g.csv", "--verify", "--json"]
    status, out, err = run("database", "grade", str(folder), *options, "--select", some)
    assert (status, err) == (0, "")
    assert json.loads(out)["verification"]["largest_deviation"] < 1e-9


def test_results_are_not_written_over_the_database(folder, run):
    for arguments in (
        ("query", str(folder), "select 1", "--csv", str(folder / "database.json")),
        ("show", str(folder), "--picture", str(folder / "particles" / "generated.000001.parquet")),
        ("grade", str(folder), "--gradation", "AC-13", "--mass", "1kg", "--out", str(folder / "meshes" / "g.csv")),
    ):
        status, _, err = run("database", *arguments)
        assert status == 2
        assert "among the files of the database" in err


def test_surplus_batches_are_not_read(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "db")
    particles = tmp_path / "db" / "particles"
    shutil.copy(particles / "generated.000001.parquet", particles / "generated.000099.parquet")
    assert query(tmp_path / "db", "select count(*) n from particles").to_pylist() == [{"n": 43}]
    shutil.copy(particles / "quarry.000001.parquet", particles / "generated.000002.parquet")
    store = Store(tmp_path / "db")
    assert store.damaged(store.sources["generated"], 2) == "its rows are not those of its source"


def test_scans_whose_names_are_no_text_are_rows(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    Path(os.fsdecode(bytes(scans) + b"/non\xff.stl")).write_bytes(b"solid nothing")
    assert [*import_scans(tmp_path / "db", [scans], MEASURES, source="odd", workers=0)] == [1]
    [row] = Store(tmp_path / "db").table(["file", "error"]).to_pylist()
    assert row["file"].endswith("non\\xff.stl")
    assert row["error"]


def test_a_scan_that_was_exchanged_is_not_taken_for_the_former_one(tmp_path, folder):
    (tmp_path / "scans").mkdir()
    scan = tmp_path / "scans" / "a.stl"
    shutil.copy(folder.parent / "scans" / "a.stl", scan)
    assert [*import_scans(tmp_path / "db", [scan], MEASURES, source="pit", workers=0)] == [1]
    content = bytearray(scan.read_bytes())
    content[100] ^= 1
    scan.write_bytes(content)
    with pytest.raises(OutputError, match=r"other settings \(files differ\)"):
        [*import_scans(tmp_path / "db", [scan], MEASURES, source="pit", workers=0)]


def test_a_long_query_can_be_interrupted(folder):
    code = "select sum(p.number * r.range) from particles p, range(100000000) r, range(10000) s"
    run = subprocess.Popen(
        [sys.executable, "-m", "lithoform", "database", "query", str(folder), code],
        stderr=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    time.sleep(3.0)
    assert run.poll() is None
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=30)
    assert run.returncode == 130
    assert err == "lithoform: interrupted.\n"


def test_csv_of_an_answer():
    table = pa.table({"a": [1.5, None], "b": ['x,"y"', "z"], "c": [[1.0, 2.0], None], "n": [1 << 62, 1]})
    rows = [*csv.reader(io.StringIO(table_to_csv(table).decode()))]
    assert rows[:2] == [["a", "b", "c", "n"], ["1.5", 'x,"y"', "[1.0, 2.0]", str(1 << 62)]]
    assert rows[2][:3] == ["", "z", ""]


def test_populations_of_databases(folder):
    found = read_population(folder, ("solidity", "length"), by="class", where="kind = 'generated'")
    assert (found.label, found.names, found.values.shape) == ("db", ("solidity", "length"), (40, 2))
    assert found.classes == ("cube", "plate", "column", "blade") * 10
    assert not found.values.flags.writeable
    everything = read_population(folder, ("solidity",), by="source", label="all")
    assert (everything.label, len(everything)) == ("all", 42)  # the one that failed is left out
    for arguments, options, said in (
        ((("soliditi",),), {}, "Did you mean solidity"),
        ((("zingg_class",),), {}, "that are numbers"),
        ((("roundness",),), {}, "roundness was not measured of 42 of 42 particles"),
        ((("solidity",),), {"by": "clas"}, "Did you mean class"),
        ((("solidity",),), {"by": "volume"}, "column of words"),
        ((("solidity",),), {"where": "number > 99"}, "that meet the condition"),
    ):
        with pytest.raises(SampleError, match=said):
            read_population(folder, *arguments, **options)


def test_populations_of_tables(folder, run, tmp_path):
    scans = folder.parent / "scans"
    status, _, _ = run("measure", str(scans), "--unit", "mm", "--csv", "t.csv", "--descriptors",
                       "solidity,length,volume,zingg_class")  # fmt: skip
    assert status == 2  # one file is no scan
    found = read_population("t.csv", ("solidity", "length", "volume"), by="class")
    expected = read_population(folder, ("solidity", "length", "volume"), by="class", where="kind = 'scanned'")
    assert found.values == pytest.approx(expected.values, rel=1e-12)  # metres, whatever the unit of the table
    assert found.classes == expected.classes
    pq.write_table(pa.table({"solidity": [0.5, 0.6], "class": ["a", "b"]}), "t.parquet")
    assert read_population("t.parquet", ("solidity",), by="class").classes == ("a", "b")
    Path("bad.csv").write_text("solidity\n0.5\nrock\n")
    Path("gap.csv").write_text("solidity,x\n0.5,1\n,1\n")
    Path("broken.parquet").write_bytes(b"PAR1")
    for name, error, said in (
        ("bad.csv", SampleError, "holds words"),
        ("gap.csv", SampleError, "was not measured of 1 of 2"),
        ("broken.parquet", FileFormatError, "cannot be read as a table"),
        ("nowhere.csv", FileFormatError, "no such file"),
        (".", FileFormatError, "a folder without a database"),
    ):
        with pytest.raises(error, match=said):
            read_population(name, ("solidity",))
    with pytest.raises(SampleError, match="has no column 'true_sphericity'"):
        read_population("gap.csv", ("true_sphericity", "solidity"))
    with pytest.raises(SampleError, match="expected a database for a condition"):
        read_population("gap.csv", ("solidity",), where="x = 1")


def test_units_and_classes_of_tables(tmp_path):
    def read(text, names=("length", "volume"), **options):
        (tmp_path / "t.csv").write_text(text)
        return read_population(tmp_path / "t.csv", names, **options)

    # An inch is 25.4 mm; units are told whatever the case and the blanks.
    for unit, metre in (("in", 0.0254), ("MM", 1e-3), ("mm ", 1e-3), (" Um", 1e-6), ("m", 1.0)):
        found = read(f"length,volume,unit\n2.0,3.0,{unit}\n")
        assert found.values[0] == pytest.approx([2.0 * metre, 3.0 * metre**3], rel=1e-14)
        assert found.has_unit
    for unit, told in (("inch", "'inch'"), ("furlong", "'furlong'"), ("", "none of a particle")):
        with pytest.raises(SampleError, match=f"expected a unit of m, cm, mm, um, in in .*got {told}; change"):
            read(f"length,volume,unit,x\n2.0,3.0,{unit},1\n")
    # What has no unit needs none.
    assert read("solidity,unit\n0.5,inch\n", ("solidity",)).values[0, 0] == 0.5
    assert not read("length,volume\n2.0,3.0\n").has_unit
    assert read("length,volume\n2.0,3.0\n").units == ("m", "m³")
    assert Population("x", ("surface_area", "inertia_1", "solidity", "other"), np.zeros((1, 4))).units == (
        "m²", "m⁵", "", "",
    )  # fmt: skip

    one = read("solidity,class\n0.5,1\n0.6,2\n", ("solidity",), by="class")
    other = read("solidity,class\n0.5,1.0\n0.6,2.0\n0.6,\n", ("solidity",), by="class")
    assert one.classes == ("1", "2")
    assert other.classes == ("1", "2", "(none)")
    assert read("solidity,class\n0.5, cube\n0.6,\n", ("solidity",), by="class").classes == ("cube", "(none)")
    assert read("solidity,class\n0.5,1.0\n0.6,a\n", ("solidity",), by="class").classes == ("1", "a")


def test_columns_of_tables_that_mislead(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("solidity,roundness,solidity\n0.5,1,0.6\n")
    with pytest.raises(
        SampleError, match=r"expected one column 'solidity' in .*, got 2; rename or remove the others\."
    ):
        read_population(path, ("solidity",))
    assert read_population(path, ("roundness",)).values[0, 0] == 1.0
    # An error that is a number is how exact a value is, not why there is none.
    path.write_text("solidity,error\n0.5,0.01\n0.6,0.0\n0.7,0.02\n")
    assert len(read_population(path, ("solidity",))) == 3
    path.write_text("solidity,error\n0.5,\n,not closed\n")
    assert read_population(path, ("solidity",)).values.tolist() == [[0.5]]
    with pytest.raises(SampleError, match=r"got 'zingg_class', which is a word: compare by it\.$"):
        read_population(path, ("zingg_class",))
    with pytest.raises(SampleError, match="Did you mean solidity"):
        read_population(path, ("soliditi",))


def test_command_import(run, folder):
    scans = folder.parent / "scans"
    options = ["--unit", "mm", "--source", "pit", "--workers", "0", "--descriptors", "solidity"]
    status, out, err = run("database", "import", "db", str(scans), *options, "--json")
    assert status == 0
    assert json.loads(out) | {"seconds": 0} == {
        "database": "db", "source": "pit", "particles": 3, "failed": 1, "seconds": 0,
    }  # fmt: skip
    status, out, err = run("database", "import", "db", str(scans), *options)
    assert "3 particles of source pit" in out
    assert "1 of them failed, the first because: " in err
    status, _, err = run("database", "import", "db", *options)
    assert status == 2
    assert "expected at least one file" in err
    status, _, err = run("database", "import", "db", str(scans), "--unit", "mm")
    assert status == 2
    assert "source" in err.lower()
    status, _, err = run("database", "query", "nowhere", "select 1")
    assert status == 2
    assert "is not there" in err


@pytest.mark.skipif(not FDOT.is_dir(), reason="the 95 particles of the Florida DOT are not here (shared/data/fdot57)")
def test_nist_particles_of_the_florida_dot(tmp_path):
    numbers = [*import_scans(tmp_path / "db", [FDOT], MEASURES, source="FDOT-57", triangles=1280, workers=0)]
    assert numbers == [*range(1, 96)]
    [row] = query(tmp_path / "db", "select count(*) n, count(error) failed, count(distinct content_hash) different, "
                  "avg(length) length from particles").to_pylist()  # fmt: skip
    assert (row["n"], row["failed"], row["different"]) == (95, 0, 95)
    assert 0.015 < row["length"] < 0.03  # ASTM C33 number 57: 4.75 to 25 mm by sieve
