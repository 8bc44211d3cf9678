"""`lithoform pack` from meshes and databases to the files, stopped and gone on with, and what it refuses."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import stat
import warnings
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from cyclopts import App
from wavy import is_drawn, stone

from lithoform import dem
from lithoform.cli.packing import pack
from lithoform.database.building import Measures, build
from lithoform.database.meshes import choose
from lithoform.database.store import Store
from lithoform.errors import (
    FileFormatError,
    LithoformError,
    MeshError,
    OutputError,
    RecipeError,
    SampleError,
    SceneError,
    SimulationError,
)
from lithoform.figures.packing import Bed, packing_figure
from lithoform.mesh_io import write_mesh
from lithoform.packing import run as packing_run
from lithoform.packing.folder import FOLDER
from lithoform.packing.resuming import write_progress
from lithoform.planning import Plan

FORMS = ((1.0, 1.0, 1.0), (1.3, 1.0, 1.0), (1.0, 1.2, 1.4), (0.8, 1.0, 1.6), (1.1, 1.1, 0.9))
SMALL = ("--container", "cylinder:60mm:60mm", "--count", "24", "--stiffness-factor", "0.001", "--device", "cpu")


def run(*words: str) -> int:
    """Run the command; an option given twice counts as given last."""
    given = [*words]
    for option in ("--container", "--count", "--seed", "--threads", "--stiffness-factor"):
        while given.count(option) > 1:
            at = given.index(option)
            del given[at : at + 2]
    app = App()
    app.default(pack)
    return app(given, exit_on_error=False, print_error=False, result_action="return_value")


@pytest.fixture(scope="module")
def stones(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("packing") / "stones"
    folder.mkdir()
    body = stone(0.15, scale=0.006, n=6)
    for i, form in enumerate(FORMS):
        write_mesh(folder / f"{i}.stl", body.with_vertices(body.vertices * form))
    (folder / "notes.txt").write_text("no stone")
    return folder


@pytest.fixture(scope="module")
def packed(stones) -> Path:
    out = stones.parent / "packed"
    assert run(str(stones), *SMALL, "--out", str(out), "--threads", "1", "--seed", "3") == 0
    return out


def test_a_folder_of_meshes_is_packed(packed):
    told = json.loads((packed / "packing.json").read_text())
    results = told["results"]
    assert told["finished"]
    assert results["at_rest"]
    assert (results["stones"], results["different_stones"], results["below_the_rim"]) == (24, 5, 24)
    assert 0.2 < results["packing_density"] < 0.65
    assert 1.0 < results["coordination_number"] < 8.0
    assert results["coordination_with_walls"] > results["coordination_number"]
    rows = (packed / "blocks.csv").read_text().splitlines()
    assert len(rows) == 25
    table = pq.read_table(packed / "table.parquet")
    assert table["step"][-1].as_py() == results["steps"]
    assert table.schema.field("height").metadata == {b"unit": b"m"}
    assert table["height"][-1].as_py() == pytest.approx(results["height_m"])
    assert not (packed / "progress.json").exists()


def test_the_files_are_those_that_paraview_opens(packed):
    pyvista = pytest.importorskip("pyvista")
    steps = json.loads((packed / "packing.json").read_text())["results"]["steps"]
    (last,) = (packed / "vtk_meshes").glob("blocks_*.vtp")
    assert int(last.stem.split("_")[1]) == steps
    surface = pyvista.read(last)
    assert surface.n_cells == 24 * 288
    # The volume of the stones, as the table has it.
    volumes = [float(line.split(",")[13]) for line in (packed / "blocks.csv").read_text().splitlines()[1:]]
    assert surface.volume == pytest.approx(sum(volumes), rel=1e-4)
    series = sorted((packed / "vtk").glob("blocks_*.vtp"))
    assert len(series) > 4
    assert series[0].name == "blocks_000000000.vtp"
    assert len(list((packed / "vtk").glob("contacts_*.vtp"))) == len(series)


def test_the_picture_shows_them(packed, drawing):
    image = pytest.importorskip("PIL.Image")
    picture = np.asarray(image.open(packed / "packing.png").convert("RGB"))
    assert picture.shape[0] > 800
    assert is_drawn(picture[:, : picture.shape[1] // 2]).mean() > 0.3


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_threads(packed, stones, tmp_path, capsys):
    out = tmp_path / "again"
    words = [str(stones), *SMALL, "--out", str(out), "--threads", "2", "--seed", "3", "--no-vtk", "--json"]
    assert run(*words) == 0
    told = json.loads(capsys.readouterr().out)
    for name in ("blocks.csv", "packing.checkpoint"):
        assert (out / name).read_bytes() == (packed / name).read_bytes(), name
    assert {"packing_density", "coordination_number", "steps", "seconds", "out"} <= told.keys()
    assert any("Young's modulus 55 MPa instead of 55,000 MPa" in line for line in told["notes"])
    assert any(line.startswith("Scales") for line in told["notes"])
    assert not (out / "vtk").exists()
    # A finished one is told again, not made again.
    before = (out / "blocks.csv").stat().st_mtime_ns
    assert run(*words, "--resume") == 0
    assert json.loads(capsys.readouterr().out)["packing_density"] == told["packing_density"]
    assert (out / "blocks.csv").stat().st_mtime_ns == before


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is a signal")
def test_interrupted_and_resumed_it_is_the_same(packed, stones, tmp_path, capsys, monkeypatch):
    out = tmp_path / "resumed"
    words = [str(stones), *SMALL, "--out", str(out), "--threads", "1", "--seed", "3"]

    def interrupted(folder: Path, seconds: float, rows: list) -> None:
        write_progress(folder, seconds, rows)
        if len(rows) > 8:
            os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patched:
        patched.setattr(packing_run, "write_progress", interrupted)
        status = run(*words)
    assert status == 130
    assert "--resume goes on with" in capsys.readouterr().err
    assert json.loads((out / "packing.json").read_text())["finished"] is False
    with pytest.raises(OutputError, match="--resume goes on"):
        run(*words)
    with pytest.raises(OutputError, match=r"other settings \(seed differs\)"):
        run(*words[:-1], "4", "--resume")
    assert run(*words, "--resume") == 0
    for name in ("blocks.csv", "table.parquet", "packing.checkpoint", "vtk/blocks.pvd", "packing.png"):
        if (packed / name).exists():
            assert (out / name).read_bytes() == (packed / name).read_bytes(), name
    assert sorted(p.name for p in (out / "vtk").iterdir()) == sorted(p.name for p in (packed / "vtk").iterdir())


def test_a_run_that_is_cut_short_says_so(stones, tmp_path, capsys):
    words = [str(stones), *SMALL, "--out", str(tmp_path / "p"), "--until", "0.002", "--no-vtk"]
    assert run(*words) == 0
    assert "not yet at rest" in capsys.readouterr().out
    with pytest.raises(OutputError, match="holds a packing: --overwrite replaces it"):
        run(*words)
    assert run(*words, "--overwrite") == 0


def test_stones_that_do_not_fit_are_counted(stones, tmp_path, capsys):
    """Fewer than the most that any packing holds, but too many for loose stones; they are seen before they fall."""
    words = [str(stones), "--container", "box:40mm:40mm:20mm", "--count", "16", "--stiffness-factor", "0.001"]
    assert run(*words, "--out", str(tmp_path / "p"), "--until", "0.001", "--no-vtk", "--device", "cpu") == 0
    out = capsys.readouterr().out
    fits = json.loads((tmp_path / "p" / "packing.json").read_text())["results"]["below_the_rim"]
    assert 0 < fits < 16
    assert f"{16 - fits} of 16 stones reach above the rim: about {fits} fit." in out
    with pytest.raises(SceneError, match="at most about"):
        run(*words, "--count", "60", "--out", str(tmp_path / "q"))


def test_a_database_is_packed_with_stones_made_anew(tmp_path):
    store = tmp_path / "store"
    plan = Plan(count=6, seed=1, preset="database", shape_class="mixed", base={"triangles": 512})
    assert len(list(build(store, plan, Measures(("volume",)), workers=0))) == 6
    words = ["--container", "box:60mm:60mm:60mm", "--stiffness-factor", "0.001", "--until", "0.002", "--device", "cpu"]
    assert run(str(store), *words, "--out", str(tmp_path / "p"), "--select", "number <= 4") == 0
    names = {line.split(",")[1] for line in (tmp_path / "p" / "blocks.csv").read_text().splitlines()[1:]}
    assert names == {f"generated-00000{n}" for n in range(1, 5)}
    volumes = pq.read_table(store / "particles")["volume"].to_pylist()
    packed = [float(line.split(",")[13]) for line in (tmp_path / "p" / "blocks.csv").read_text().splitlines()[1:]]
    assert sorted(packed) == pytest.approx(sorted(volumes[:4]), rel=1e-9)
    with pytest.raises(LithoformError, match="none is chosen"):
        run(str(store), *words, "--out", str(tmp_path / "q"), "--select", "number > 99")
    for chosen, told in (
        ("", "got an empty one: leave it out to take all"),
        ("  ;", "got an empty one"),
        ("-- all", "expected a condition such as"),
        ("1=1; drop table particles", "got 2 statements: give one"),
        ("1=1) or (1=1", "syntax error"),
        ("1) union select * from particles where (1=1", "syntax error"),
        ("select source, number from particles) union (select source, number from particles", "syntax error"),
        ("select 1; select 2", "got 2 statements"),
        ("'", "unterminated"),
    ):
        with pytest.raises(SampleError, match=told):
            run(str(store), *words, "--out", str(tmp_path / "q"), f"--select={chosen}")
    table = choose(Store(store), ["number"], "number in (2, 3) -- a comment")
    assert table["number"].to_pylist() == [2, 3]
    assert choose(Store(store), ["number"], " number <= 2 ; ")["number"].to_pylist() == [1, 2]
    assert choose(Store(store), ["number"], "class <> ')' and (number = 4)")["number"].to_pylist() == [4]
    # The way out that is given for stones that cannot be used.
    kept = choose(Store(store), ["number"], "(source, number) not in (('generated', 1), ('generated', 5))")
    assert kept["number"].to_pylist() == [2, 3, 4, 6]


@pytest.mark.parametrize(
    ("words", "kind", "told"),
    [
        (["--count", "-1"], RecipeError, "--count from 1"),
        (["--container", "barrel:1m:1m"], RecipeError, "expected a container such as"),
        (["--container", "cylinder:12mm:60mm"], SceneError, "so that the largest stone fits"),
        (["--seed", "-1"], RecipeError, "seed must be 0"),
        (["--threads", "0"], RecipeError, "--threads from 1 to 10000; got 0"),
        (["--dt", "1"], SceneError, "leave it out to take"),
        (["--dt", "1e-300"], SceneError, "at most 10,000,000,000 steps; until they rest"),
        (["--until", "1e300"], SceneError, r"at most 10,000,000,000 steps; --until 1e\+300 takes"),
        (["--until", "1e308", "--dt", "1e-320"], SceneError, r"takes far more of 1e-320 s: give a longer --dt"),
        (["--gravity", "9e4"], SceneError, "fewer stones or a smaller --gravity"),
        (["--gravity", "1e300"], RecipeError, "--gravity from"),
        (["--stiffness-factor", "1e-9"], SceneError, "give --stiffness-factor of at least"),
        (["--container", "cylinder:1e300m:1m"], RecipeError, "at most 1000 m"),
        (["--unit", "um"], SceneError, r"unit of their files with --unit"),
        (["--unit", "m"], SceneError, r"unit of their files with --unit"),
        (["--unit", "furlong"], FileFormatError, "furlong"),
        (["--select", "class = 'cube'"], RecipeError, "none is given"),
    ],
)
def test_what_makes_no_sense_is_refused_and_nothing_is_written(stones, tmp_path, words, kind, told):
    out = tmp_path / "p"
    with pytest.raises(kind, match=told):
        run(str(stones), *SMALL, "--out", str(out), *words)
    assert not out.exists() or not list(out.iterdir())


def test_sources_without_stones_are_refused(stones, tmp_path):
    (tmp_path / "empty").mkdir()
    broken = tmp_path / "open.stl"
    body = stone(n=6)
    write_mesh(broken, type(body)(0.01 * body.vertices, body.faces[40:]))
    for given, told in (
        (tmp_path / "empty", "holds no scans"),
        (tmp_path / "none.stl", "none.stl"),
        (broken, "open.stl"),
    ):
        with pytest.raises(FileFormatError, match=told):
            run(str(given), *SMALL, "--out", str(tmp_path / "p"))
    with pytest.raises(RecipeError, match="expected meshes"):
        run(*SMALL, "--out", str(tmp_path / "p"))
    with pytest.raises(OutputError, match="name another place"):
        run(str(stones), *SMALL, "--out", str(stones / "p"))


def test_a_unit_that_is_wrong_is_told_and_the_right_one_packs(tmp_path, capsys):
    body = stone(0.15, scale=0.006, n=6)
    for i in range(3):
        write_mesh(tmp_path / f"{i}.stl", body, unit="m")
    words = [*SMALL, "--out", str(tmp_path / "out"), "--until", "1e-4", "--no-vtk", "--count", "3"]
    given = [str(tmp_path / f"{i}.stl") for i in range(3)]
    with pytest.raises(SceneError, match="give the unit of their files with --unit"):
        run(*given, *words)
    assert run(*given, *words, "--unit", "m") == 0
    out = capsys.readouterr().out
    diameter = 2e3 * (3.0 * body.volume / (4.0 * math.pi)) ** (1.0 / 3.0)
    assert f"Diameters of the spheres of equal volume: {diameter:.4g} mm." in out
    assert "very small" not in out
    # A single stone in a wide container is packed, and told of.
    words = [given[0], "--unit", "m", "--container", "cylinder:3m:1m", "--device", "cpu", "--until", "1e-4", "--no-vtk"]
    assert run(*words, "--out", str(tmp_path / "wide")) == 0
    assert "very small for the container" in capsys.readouterr().out


def test_stones_that_cannot_be_used_are_all_named(stones, tmp_path):
    body = stone(0.15, scale=0.006, n=6)
    for i, thickness in enumerate((1.0, 0.001, 1.0, 0.001)):
        write_mesh(tmp_path / f"{i}.stl", body.with_vertices(body.vertices * [1.0, 1.0, thickness]))
    with pytest.raises(MeshError, match=r"^2 of 4 stones .*1\.stl, .*3\.stl\); the first .*; leave those files out\.$"):
        run(str(tmp_path), *SMALL, "--count", "4", "--out", str(tmp_path.parent / "thin"))


def refuse(*_: object, **__: object) -> None:
    raise SimulationError(
        "block 3 is deeper in a wall than three times its rounding (0.0004 m) at t = 1 s: be careful."
    )


def test_a_first_step_that_fails_costs_no_former_packing(packed, stones, tmp_path, monkeypatch):
    out = tmp_path / "former"
    shutil.copytree(packed, out)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    monkeypatch.setattr("lithoform.packing.run.simulate", refuse)
    with pytest.raises(SimulationError, match=r"^stone 4 \(.*\d\.stl\) is deeper .* give a --dt below"):
        run(str(stones), *SMALL, "--out", str(out), "--seed", "9", "--overwrite")
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    # Nor does it leave a packing that would have to be overwritten.
    with pytest.raises(SimulationError):
        run(str(stones), *SMALL, "--out", str(tmp_path / "new"))
    assert not list((tmp_path / "new").iterdir())


def test_a_simulation_that_fails_names_the_stone_as_the_table_does(packed, stones, tmp_path, monkeypatch):
    monkeypatch.setattr("lithoform.packing.run.settle", refuse)
    with pytest.raises(SimulationError) as raised:
        run(str(stones), *SMALL, "--seed", "3", "--out", str(tmp_path / "p"), "--no-vtk")
    number, name = (packed / "blocks.csv").read_text().splitlines()[4].split(",")[:2]
    assert str(raised.value).startswith(f"stone {number} ({name}) is deeper")
    assert "a --stiffness-factor above 0.001" in str(raised.value)


def test_warnings_are_told_in_a_line(stones, tmp_path, monkeypatch, capsys):
    def settle(model, state, *_: object, **__: object) -> None:
        warnings.warn("the energy grew", dem.EnergyWarning, stacklevel=1)
        raise SimulationError("block 0 is gone at t = 1 s: be careful.")

    monkeypatch.setattr("lithoform.packing.run.settle", settle)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with pytest.raises(SimulationError):
            run(str(stones), *SMALL, "--out", str(tmp_path / "p"), "--no-vtk")
        shown = warnings.showwarning
    assert "lithoform: warning: the energy grew\n" in capsys.readouterr().err
    assert shown is warnings.showwarning


def test_a_run_that_is_to_go_on_where_there_is_none_begins(stones, tmp_path, capsys):
    words = [str(stones), *SMALL, "--out", str(tmp_path / "p"), "--until", "1e-4", "--no-vtk", "--resume"]
    assert run(*words) == 0
    assert "holds no packing to go on with: it is begun" in capsys.readouterr().out


def test_files_whose_names_are_no_text_are_packed(stones, tmp_path):
    given = tmp_path / os.fsdecode(b"st\xe4ne.stl")
    try:
        shutil.copy(stones / "0.stl", given)
    except OSError:
        pytest.skip("this file system takes no such name")
    assert run(str(given), *SMALL, "--out", str(tmp_path / "p"), "--until", "1e-4", "--no-vtk", "--count", "2") == 0
    settings = json.loads((tmp_path / "p" / "packing.json").read_text())["settings"]
    assert settings["sources"] == [str(given)]


def test_folders_of_others_are_left_alone(stones, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    for more in ([], ["--overwrite"], ["--resume"]):
        with pytest.raises(OutputError, match=r"other files \(thesis|no packing to resume"):
            run(str(stones), *SMALL, "--out", str(tmp_path), *more)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission_is_told(stones, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(OutputError, match="cannot be used"):
        run(str(stones), *SMALL, "--out", str(locked / "p"))


def test_a_file_in_the_place_of_the_folder_is_told(stones, tmp_path):
    (tmp_path / "p").write_text("mine")
    with pytest.raises(OutputError, match="is a file; name a folder"):
        run(str(stones), *SMALL, "--out", str(tmp_path / "p"))
    with pytest.raises(OutputError, match="cannot be used"):
        run(str(stones), *SMALL, "--out", str(tmp_path / "p" / "q"))


@pytest.mark.parametrize("sides", [(0.05,), (0.05, 0.04)])
def test_the_walls_nearest_to_the_eye_are_cut_away(sides, drawing, monkeypatch):
    """A stone on the floor in the middle is seen in both containers, with walls behind it."""
    body = stone(scale=0.008, n=6)
    turns = np.eye(3) * np.array([0.1, 1.0])[:, None, None]  # the second stone has a warm tone, and hides the first
    bed = Bed(
        meshes=[body], which=np.array([0, 0]), turns=turns, places=np.full((2, 3), [0.0, 0.0, 0.008]), sides=sides,
        height=0.03, edges=np.array([0.0, 0.016]), profile=np.array([0.2]), band=(0.0, 0.016), title="two",
        time=np.array([0.0, 0.1]), kinetic=np.array([0.0, 1e-7]), lines=["line"],
    )  # fmt: skip
    monkeypatch.setattr("lithoform.figures.packing._TRIANGLES", 300)  # so that the stones are simplified
    picture = packing_figure(bed, dpi=100)
    left = picture[:, : round(0.6 * picture.shape[1])].astype(int)
    warm = left[..., 0] > left[..., 2] + 12
    cool = left[..., 2] > left[..., 0] + 4  # walls and floor
    rows, columns = np.nonzero(warm)
    assert warm.mean() > 0.02
    assert cool[: int(rows.min())].any(axis=0).mean() > 0.3
    assert abs(columns.mean() / left.shape[1] - 0.5) < 0.15
    # Nothing stands before it: the warm pixels have no cool ones among them.
    assert warm[int(np.median(rows)), columns.min() + 2 : columns.max() - 2].mean() > 0.7
    with pytest.raises(LithoformError, match="has none"):
        packing_figure(Bed(**{**vars(bed), "which": np.array([], dtype=int)}))


def test_overwrite_and_resume_exclude_each_other(packed, stones):
    with pytest.raises(OutputError, match="give one of them"):
        run(str(stones), *SMALL, "--out", str(packed), "--seed", "3", "--resume", "--overwrite")


def test_a_finished_packing_that_lost_a_file_is_not_taken_for_one(packed, stones, tmp_path):
    out = tmp_path / "lossy"
    shutil.copytree(packed, out)
    told = json.loads((out / "packing.json").read_text())
    del told["results"]["packing_density"]
    (out / "packing.json").write_text(json.dumps(told))
    with pytest.raises(OutputError, match=r"packing\.json is damaged: give --overwrite"):
        run(str(stones), *SMALL, "--out", str(out), "--seed", "3", "--resume")
    (out / "blocks.csv").unlink()
    with pytest.raises(OutputError, match=r"of which blocks\.csv is missing: give --overwrite"):
        run(str(stones), *SMALL, "--out", str(out), "--seed", "3", "--resume")


def test_an_overwrite_that_is_stopped_leaves_nothing_that_passes_for_finished(packed, tmp_path, monkeypatch):
    out = tmp_path / "stopped"
    shutil.copytree(packed, out)
    settings = json.loads((out / "packing.json").read_text())["settings"]

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("lithoform.result_folder.ResultFolder._remove_series", stop)
    with pytest.raises(KeyboardInterrupt):
        FOLDER.clear(out, settings)
    assert json.loads((out / "packing.json").read_text())["finished"] is False


def test_another_time_step_is_the_one_that_is_told(stones, tmp_path, capsys):
    out = tmp_path / "step"
    assert run(str(stones), *SMALL, "--out", str(out), "--dt", "2e-6", "--until", "1e-4", "--no-vtk") == 0
    told = json.loads((out / "packing.json").read_text())
    assert told["results"]["scales"]["step"] == told["results"]["time_step_s"] == 2e-6
    assert "step 2.00e-06 s" in capsys.readouterr().out
