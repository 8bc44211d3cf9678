"""What is read from a database: SQL, populations for comparisons, and scans that were imported."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lithoform import FileFormatError, MeshError, OutputError, SampleError, generate, measure, read_scan, write_mesh
from lithoform.database.building import Measures, build
from lithoform.database.importing import import_scans
from lithoform.database.population import read_population
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
    import shutil

    shutil.copytree(folder, tmp_path / "db")
    victim = tmp_path / "db" / "particles" / "generated.000002.parquet"
    victim.write_bytes(victim.read_bytes()[:-100])
    with pytest.raises(FileFormatError, match=r"generated\.000002\.parquet is damaged"):
        query(tmp_path / "db", "select count(*), avg(solidity) from particles")


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
