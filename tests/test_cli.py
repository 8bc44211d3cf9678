"""The command line as a user and a script meet it."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from lithoform import Recipe, cli, production, read_mesh, to_toml
from lithoform.parameters import PARAMETERS

SMALL = ["--triangles", "800", "--device", "cpu"]


def command(*arguments: str, **options) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "lithoform", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def bytes_of(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir())}


def test_generate_writes_meshes_sidecars_and_table(run):
    status, out, err = run("generate", "out", "--count", "5", "--seed", "3", "--class", "mixed", *SMALL)
    assert (status, err) == (0, "")
    assert "5 particles" in out
    names = sorted(p.name for p in Path("out").iterdir())
    meshes = [f"{n:06d}" for n in range(1, 6)]
    assert names == sorted([*(m + e for m in meshes for e in (".stl", ".json")), "particles.parquet", "run.json"])
    rows = pq.read_table("out/particles.parquet").to_pylist()
    assert [row["class"] for row in rows] == ["cube", "plate", "column", "blade", "cube"]
    assert len({row["seed"] for row in rows}) == 5
    for row in rows:
        solid = trimesh.load(f"out/{row['file']}")
        assert solid.is_watertight
        assert solid.volume == pytest.approx(row["volume_m3"] * 1e9, rel=1e-5)
        sidecar = json.loads(Path("out", row["file"]).with_suffix(".json").read_text())
        assert sidecar["seed"] == row["seed"] == sidecar["recipe"]["seed"]
        assert sidecar["unit"] == "mm"
        assert sidecar["volume"] == pytest.approx(row["volume_m3"] * 1e9, rel=1e-12)


@pytest.mark.parametrize("form", ["stl", "ply", "obj", "glb", "3mf"])
@pytest.mark.parametrize("unit", ["mm", "m"])
def test_size_and_unit_reach_the_file(run, form, unit):
    status, *_ = run(
        "generate", "out", "--size", "20,15,10", "--unit", unit, "--format", form, "--set", "flatten=false", *SMALL
    )
    assert status == 0
    sidecar = json.loads(Path("out/000001.json").read_text())
    assert sidecar["unit"] == ("m" if form == "glb" else unit)
    expected = np.array([20.0, 15.0, 10.0]) * (1e-3 if form == "glb" and unit == "mm" else 1.0)
    loaded = trimesh.load_mesh(f"out/000001.{form}")
    np.testing.assert_allclose(loaded.extents, expected, rtol=1e-6)
    ours = read_mesh(f"out/000001.{form}", unit=unit)
    np.testing.assert_allclose(
        np.ptp(ours.vertices, axis=0), expected if sidecar["unit"] == "m" else expected / 1000, rtol=1e-6
    )


def test_benchmark_preset_is_table_1_in_the_unit_of_the_run(run):
    run("generate", "out", "--preset", "benchmark", "--unit", "cm", *SMALL)
    recipe = json.loads(Path("out/000001.json").read_text())["recipe"]
    assert (recipe["length"], recipe["width"], recipe["height"]) == pytest.approx((0.02, 0.015, 0.01))
    assert recipe["main_scale"] == 1.5


def test_the_default_is_the_database_setting_in_mixed_classes(run):
    run("generate", "out", "--count", "2", *SMALL)
    recipe = json.loads(Path("out/000002.json").read_text())["recipe"]
    assert (recipe["main_scale"], recipe["warp_scale"], recipe["length"]) == (1.0, 1.0, 0.02)


@pytest.mark.parametrize(
    "parameter", [p for p in PARAMETERS if p.name not in ("seed", "triangles")], ids=lambda p: p.symbol
)
def test_set_takes_every_symbol_and_every_name(parameter):
    value = {"vector": "1,2,3", "integer": "3", "number": "0.5"}[parameter.kind]
    if parameter.name == "smoothing_mu":
        value = "-0.6"
    expected = [float(v) for v in value.split(",")]
    for name in (parameter.symbol, parameter.name):
        plan = cli_plan("--set", f"{name}={value}")
        got = plan.base[parameter.name]
        scale = 1e-3 if parameter.unit == "m" else 1.0
        assert np.atleast_1d(got) == pytest.approx(np.array(expected) * scale)


def cli_plan(*arguments: str):
    from lithoform import planning

    captured = {}

    def keep(**options):
        # L, W and H are set one at a time here, out of order: the recipe itself is not made.
        captured.update(options)
        return planning.Plan(count=1, seed=0, preset="database", shape_class=None, base=planning_fields(options))

    def planning_fields(options):
        from lithoform.recipe_io import parse_settings

        fields = parse_settings(options["settings"])
        return {n: v * 1e-3 if n in ("length", "width", "height") else v for n, v in fields.items()}

    settings = cli._repeat_set(list(arguments))
    return keep(settings=[word for word in settings if word != "--set"])


def test_set_reaches_the_recipe_repeated_or_in_a_row(run):
    run("generate", "a", "--set", "k=0.1", "--set", "O=3", "--set", "delta=1,2,3", *SMALL)
    run("generate", "b", "--set", "k=0.1", "octaves=3", "delta=1,2,3", *SMALL)
    recipe = json.loads(Path("a/000001.json").read_text())["recipe"]
    assert (recipe["perturbation"], recipe["octaves"], recipe["phase_offset"]) == (0.1, 3, [1.0, 2.0, 3.0])
    assert bytes_of(Path("a"))["000001.stl"] == bytes_of(Path("b"))["000001.stl"]


def test_set_of_a_length_is_in_the_unit_of_the_run(run):
    run("generate", "out", "--set", "L=3", "W=2", "H=1", "--unit", "cm", *SMALL)
    assert json.loads(Path("out/000001.json").read_text())["recipe"]["length"] == pytest.approx(0.03)


def test_a_sidecar_makes_the_same_bytes_again(run):
    run("generate", "a", "--count", "3", "--seed", "9", "--format", "ply", "--unit", "cm", *SMALL)
    status, *_ = run("generate", "b", "--recipe", "a/000002.json", "--device", "cpu")
    assert status == 0
    assert Path("a/000002.ply").read_bytes() == Path("b/000001.ply").read_bytes()
    first, again = (json.loads(Path(p).read_text()) for p in ("a/000002.json", "b/000001.json"))
    assert first["content_sha256"] == again["content_sha256"]


def test_a_recipe_with_a_count_or_a_seed_makes_relatives(run):
    Path("r.toml").write_text(to_toml(Recipe(triangles=800, seed=5, length=0.02, width=0.015, height=0.01)))
    run("generate", "one", "--recipe", "r.toml", "--device", "cpu")
    run("generate", "many", "--recipe", "r.toml", "--count", "2", "--device", "cpu")
    assert json.loads(Path("one/000001.json").read_text())["seed"] == 5
    seeds = [json.loads(Path(f"many/00000{n}.json").read_text())["seed"] for n in (1, 2)]
    assert 5 not in seeds
    assert len(set(seeds)) == 2


def test_neither_threads_nor_repetition_change_a_byte(run, monkeypatch):
    run("generate", "a", "--count", "6", *SMALL)
    monkeypatch.setattr("lithoform.generation.default_threads", lambda: 1)
    run("generate", "b", "--count", "6", *SMALL)
    assert bytes_of(Path("a")) == bytes_of(Path("b"))


def test_json_is_one_object(run):
    status, out, err = run("generate", "out", "--count", "2", "--json", *SMALL)
    answer = json.loads(out)
    assert (status, err) == (0, "")
    assert answer["count"] == answer["generated"] == 2
    assert answer["files"] == ["000001.stl", "000002.stl"]
    assert Path(answer["table"]).exists()


def test_check_says_which_is_unsound(run):
    run("generate", "out", *SMALL)
    good = Path("out/000001.stl")
    data = good.read_bytes()
    hole = bytearray(data[:-50])
    hole[80:84] = (799).to_bytes(4, "little")
    Path("hole.stl").write_bytes(hole)
    assert run("check", str(good))[:2] == (0, f"{good}: sound, 800 triangles (star-shaped)\n")
    status, out, err = run("check", str(good), "hole.stl")
    assert (status, err) == (1, "")
    assert "hole.stl: UNSOUND, 3 open edges (first at" in out
    assert len(out.splitlines()) == 2
    status, out, _ = run("check", "--json", str(good), "hole.stl")
    assert [entry["sound"] for entry in json.loads(out)] == [True, False]
    assert status == 1


def test_check_goes_on_after_a_file_that_cannot_be_read(run):
    run("generate", "out", *SMALL)
    Path("bad.ply").write_bytes(b"ply\nnonsense")
    status, out, _ = run("check", "bad.ply", "missing.stl", "out")
    assert status == 2
    lines = out.splitlines()
    assert "cannot be read" in lines[0]
    assert "cannot be read" in lines[1]
    assert lines[2].endswith("sound, 800 triangles (star-shaped)")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "k=2"], "perturbation (k) must be 0 to 1; got 2"),
        (["--set", "r=0"], "a sphere of radius 0 has no surface"),
        (["--set", "k=nan"], "finite"),
        (["--set", "kapa=1"], "Did you mean kappa"),
        (["--set", "k"], "NAME=VALUE"),
        (["--set", "delta=1,2"], "three numbers"),
        (["--set", "seed=4"], "--seed"),
        (["--class", "cubes"], "Did you mean cube"),
        (["--preset", "bench"], "benchmark, database"),
        (["--format", "step"], "stl, ply, obj, glb, 3mf"),
        (["--unit", "ft"], "m, cm, mm, um, in"),
        (["--size", "10,20"], "L,W,H"),
        (["--size", "10,20,30"], "L >= W >= H; got 10, 20, 30 mm:"),
        (["--size", "nan,20,30"], "finite"),
        (["--size", f"1{'0' * 400},20,10"], "finite"),
        (["--set", f"L=1{'0' * 400}", "W=2", "H=1"], "finite"),
        (["--size", "20", "15", "10"], "such as 20,15,10; got 20 15"),
        (["--size", "20,", "15,", "10"], "such as 20,15,10; got 20, 15,"),
        (["--size", "-20,15,10"], "such as 20,15,10; got -20,15,10"),
        (["--set", "L=20"], "give L, W and H together, or --size"),
        (["--set", "W=2", "H=1"], "give L, W and H together, or --size"),
        (["--preset", "benchmark", "--set", "H=1.6"], "L >= W >= H; got 2, 1.5, 1.6 mm:"),
        (["--count", "1.5"], "a whole number in digits; got '1.5'"),
        (["--count", "1e3"], "a whole number"),
        (["--count", "-1"], "at least 1; got -1"),
        (["--count", "10000001"], "at most 10000000"),
        (["--seed", "-1.5"], "a whole number in digits; got '-1.5'"),
        (["--seed", "9" * 5000], "at most 39 digits; got 5000"),
        (["--triangles", "800.4"], "a whole number in digits"),
        (["--format", ""], "stl, ply, obj, glb, 3mf"),
        (["--unit", ""], "m, cm, mm, um, in"),
        (["--size", "30,20,10", "--class", "cube"], "use one of them"),
        (["--size", "30,20,10", "--set", "L=30"], "not by both"),
        (["--triangles", "20001"], "20000 and 20480"),
        (["--count", "0"], "at least 1"),
        (["--count", "many"], "--count"),
        (["--seed", "-1"], "0 to 18446744073709551615"),
        (["--recipe", "none.toml"], "cannot be read"),
        (["--recipe", "r.toml", "--preset", "database"], "give one of them"),
        (["--overwrite", "--resume"], "give one of them"),
        (["--bogus"], "--bogus"),
        (["--device", "tpu"], "auto, cpu or cuda"),
        (["--set", "rho=60", "r=5", "--triangles", "32"], "at least 512 triangles"),
    ],
)
def test_a_wrong_request_is_one_sentence_and_touches_nothing(run, arguments, words):
    status, out, err = run("generate", "out", *arguments)
    assert status == 2
    assert out == ""
    assert words in err
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert not Path("out").exists()


def test_toml_with_an_unknown_name_suggests_the_nearest(run):
    Path("r.toml").write_text("octavs = 4\n")
    status, _, err = run("generate", "out", "--recipe", "r.toml")
    assert status == 2
    assert "Did you mean octaves" in err
    assert "r.toml" in err


def test_debug_shows_the_traceback(run):
    with pytest.raises(Exception, match="perturbation"):
        cli.main(["generate", "out", "--set", "k=2", "--debug"])


def test_an_unexpected_fault_is_still_one_sentence(run, monkeypatch):
    monkeypatch.setattr(production, "produce", lambda *a, **k: 1 / 0)
    status, _, err = run("generate", "out", *SMALL)
    assert status == 2
    assert "ZeroDivisionError" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "arguments",
    [["--triangles", "7"], ["--triangles", "800.5"], ["--seed", "-4"], ["--triangles", "8"], ["--device", "tpu"]],
    ids=" ".join,
)
def test_a_wrong_request_for_a_figure_leaves_no_folder(run, arguments):
    pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    status, out, err = run("reproduce", "fig2", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "unexpected" not in err
    assert not Path("figures").exists()


def test_one_dimension_of_the_benchmark_is_in_the_unit_of_the_others(run):
    run("generate", "out", "--preset", "benchmark", "--set", "L=3", "--unit", "cm", *SMALL)
    recipe = json.loads(Path("out/000001.json").read_text())["recipe"]
    assert [recipe[n] for n in ("length", "width", "height")] == pytest.approx([0.03, 0.015, 0.01])


def test_one_dimension_changes_that_of_a_recipe(run):
    Path("r.toml").write_text(to_toml(Recipe(triangles=800, length=0.02, width=0.015, height=0.01)))
    run("generate", "out", "--recipe", "r.toml", "--set", "L=30", "--device", "cpu")
    recipe = json.loads(Path("out/000001.json").read_text())["recipe"]
    assert [recipe[n] for n in ("length", "width", "height")] == [0.03, 0.015, 0.01]


def test_a_format_is_taken_in_any_spelling(run):
    run("generate", "out", "--format", ".PLY", *SMALL)
    assert Path("out/000001.ply").exists()


def test_the_report_names_the_unit_of_the_file(run):
    _, out, _ = run("generate", "out", "--format", "glb", *SMALL)
    assert "(glb, m)" in out


def test_a_glb_sidecar_does_not_set_the_unit_of_the_run(run):
    run("generate", "a", "--format", "glb", *SMALL)
    run("generate", "b", "--recipe", "a/000001.json", "--device", "cpu")
    assert Path("a/000001.glb").read_bytes() == Path("b/000001.glb").read_bytes()
    run("generate", "c", "--recipe", "a/000001.json", "--size", "20,15,10", "--format", "ply", "--device", "cpu")
    sidecar = json.loads(Path("c/000001.json").read_text())
    assert (sidecar["unit"], sidecar["recipe"]["length"]) == ("mm", 0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "newer than 1"),
        ({"schema": "1"}, "expected a lithoform sidecar"),
        ({"unit": "ft"}, "expected a unit"),
        ({"unit": 5}, "expected a unit"),
        ({"format": "step"}, "expected a mesh format"),
        ({"volume": None}, None),
    ],
)
def test_a_sidecar_of_another_form_is_not_taken_for_a_bare_recipe(run, change, words):
    run("generate", "a", *SMALL)
    sidecar = json.loads(Path("a/000001.json").read_text()) | change
    if words is None:
        del sidecar["volume"]
    Path("other.json").write_text(json.dumps(sidecar))
    status, _, err = run("generate", "b", "--recipe", "other.json")
    assert status == 2
    assert err.startswith("lithoform: other.json: ")
    assert (words or "lacks volume") in err
    assert not Path("b").exists()


def test_relaxed_particles_are_told(run, monkeypatch):
    run("generate", "out", "--count", "3", *SMALL)
    path = Path("out/000002.json")
    sidecar = json.loads(path.read_text())
    sidecar["provenance"]["relaxed_vertices"] = 7
    path.write_text(json.dumps(sidecar))
    _, out, _ = run("generate", "out", "--count", "3", "--resume", *SMALL)
    assert "  relaxed  1 of 3 particles, where faces crossed after the twist: see provenance\n" in out
    _, out, _ = run("generate", "out", "--count", "3", "--resume", "--json", *SMALL)
    assert json.loads(out)["relaxed"] == 1


def test_two_runs_into_one_folder_at_once_are_refused(run, tmp_path):
    out = tmp_path / "out"
    first = command("generate", str(out), "--count", "100000", *SMALL)
    try:
        while first.poll() is None and not list(out.glob("*.json")):
            time.sleep(0.01)
        for option in ([], ["--resume"], ["--overwrite"]):
            status, _, err = run("generate", "out", "--count", "100000", *option, *SMALL)
            assert status == 2
            assert "another run is writing into out; wait for it or choose another folder" in err
    finally:
        first.kill()
        first.communicate()
    # The lock ends with the process that held it.
    assert (out / ".lithoform.lock").exists()
    status, *_ = run("generate", "out", "--count", "2", "--overwrite", *SMALL)
    assert status == 0
    assert not (out / ".lithoform.lock").exists()


def test_a_lock_left_behind_is_no_content(run):
    Path("out").mkdir()
    Path("out/.lithoform.lock").write_text("")
    assert run("generate", "out", *SMALL)[0] == 0
    assert ".lithoform.lock" not in bytes_of(Path("out"))


def test_overwrite_removes_only_what_the_former_run_wrote(run):
    run("generate", "out", "--count", "2", *SMALL)
    kept = {name: Path("out", name) for name in ("000003.stl", "000001.ply", "0000001.stl", "notes.json", ".hidden")}
    for path in kept.values():
        path.write_text("mine")
    status, *_ = run("generate", "out", "--count", "1", "--overwrite", *SMALL)
    assert status == 0
    assert all(path.read_text() == "mine" for path in kept.values())
    assert not Path("out/000002.stl").exists()
    before = bytes_of(Path("out"))
    for arguments in (["--count", "3"], ["--format", "ply"]):
        status, _, err = run("generate", "out", "--overwrite", *arguments, *SMALL)
        assert status == 2
        assert "move the files away" in err
    assert bytes_of(Path("out")) == before


@pytest.mark.parametrize("plan", [None, "{", "{}", '{"count": 5, "format": "stl"}'])
def test_overwrite_leaves_files_that_no_run_of_ours_wrote(run, plan):
    Path("out").mkdir()
    Path("out/000001.stl").write_text("a scan")
    if plan is not None:
        Path("out/run.json").write_text(plan)
    before = bytes_of(Path("out"))
    for option in ([], ["--overwrite"], ["--resume"]):
        status, _, err = run("generate", "out", *option, *SMALL)
        assert (status, err.count("\n")) == (2, 1)
    assert bytes_of(Path("out")) == before


def test_resume_wants_the_version_that_began(run):
    run("generate", "out", *SMALL)
    path = Path("out/run.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"lithoform": "0.0.1"}))
    status, _, err = run("generate", "out", "--resume", *SMALL)
    assert status == 2
    assert "a run of lithoform 0.0.1" in err


@pytest.mark.parametrize(
    "change", [{"number": 2}, {"unit": "m"}, {"format": "ply"}, {"recipe": Recipe().as_dict()}, {"provenance": None}]
)
def test_resume_makes_a_particle_of_another_plan_anew(run, change):
    run("generate", "out", *SMALL)
    expected = bytes_of(Path("out"))
    path = Path("out/000001.json")
    sidecar = json.loads(path.read_text()) | change
    if change == {"provenance": None}:
        del sidecar["provenance"]
    path.write_text(json.dumps(sidecar))
    run("generate", "out", "--resume", *SMALL)
    assert bytes_of(Path("out")) == expected


@pytest.mark.parametrize("name", ["a" * 300, "a/" * 3000, "dangling", "dangling/deeper"])
def test_a_folder_that_cannot_be_is_one_sentence(run, name):
    Path("dangling").symlink_to("nowhere")
    status, _, err = run("generate", name, *SMALL)
    assert (status, err.count("\n")) == (2, 1)
    assert "unexpected" not in err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("words", [["check", "x.stl"], ["--help"], ["--version"]], ids=" ".join)
def test_an_output_that_takes_nothing_is_one_sentence(words, tmp_path):
    for redirect, said in ((">/dev/full", "No space left"), (">&-", "standard output is closed")):
        line = f'"$0" -m lithoform {" ".join(words)} {redirect}'
        done = subprocess.run(["sh", "-c", line, sys.executable], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
        assert "unexpected" not in done.stderr


def test_a_reader_that_stops_early_is_no_fault(tmp_path):
    with command("generate", "--help", cwd=tmp_path) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(60) == 141
        assert process.stderr is not None
        assert process.stderr.read() == ""


@pytest.mark.skipif(sys.platform in ("darwin", "win32"), reason="names are Unicode there")
def test_a_folder_of_any_bytes_can_be_written_and_printed(run, tmp_path):
    name = os.fsdecode(b"\xff")
    status, out, err = run("generate", name, *SMALL)
    assert (status, err) == (0, "")
    assert "\\udcff" in out
    assert Path(name, "particles.parquet").exists()
    status, out, _ = run("generate", name, "--resume", "--json", *SMALL)
    assert json.loads(out)["out"] == name


def test_other_content_is_refused_and_never_removed(run):
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")
    status, _, err = run("generate", "out", *SMALL)
    assert status == 2
    assert "--overwrite" in err
    status, *_ = run("generate", "out", "--overwrite", *SMALL)
    assert status == 0
    assert Path("out/notes.txt").read_text() == "mine"
    status, _, err = run("generate", "out", *SMALL)
    assert status == 2
    assert "--resume" in err


def test_overwrite_leaves_nothing_of_the_former_run(run):
    run("generate", "out", "--count", "5", "--format", "ply", *SMALL)
    run("generate", "out", "--count", "2", "--overwrite", *SMALL)
    run("generate", "fresh", "--count", "2", *SMALL)
    assert bytes_of(Path("out")) == bytes_of(Path("fresh"))


def test_a_file_in_the_place_of_out_is_refused(run):
    Path("out").write_text("")
    status, _, err = run("generate", "out", *SMALL)
    assert status == 2
    assert "is a file" in err


def test_resume_needs_the_same_settings(run):
    run("generate", "out", "--count", "2", *SMALL)
    status, _, err = run("generate", "out", "--count", "3", "--resume", *SMALL)
    assert status == 2
    assert "count" in err
    Path("elsewhere").mkdir()
    Path("elsewhere/x").write_text("")
    status, _, err = run("generate", "elsewhere", "--resume", *SMALL)
    assert status == 2
    assert "no run to resume" in err


def test_resume_mends_missing_damaged_and_half_written_files(run):
    run("generate", "whole", "--count", "6", *SMALL)
    run("generate", "out", "--count", "6", *SMALL)
    expected = bytes_of(Path("whole"))
    Path("out/000002.json").unlink()
    Path("out/000003.stl").unlink()
    Path("out/000004.stl").write_bytes(Path("out/000004.stl").read_bytes()[:-1])
    Path("out/000005.json").write_text("{")
    Path("out/particles.parquet").unlink()
    Path("out/.000006.stl.0123.partial").write_bytes(b"left by a killed run")
    status, out, _ = run("generate", "out", "--count", "6", "--resume", *SMALL)
    assert status == 0
    assert "2 were there already" in out
    assert bytes_of(Path("out")) == expected


def test_killed_at_any_moment_and_resumed_it_ends_the_same(tmp_path):
    arguments = ["--count", "60", "--seed", "4", *SMALL]
    whole = command("generate", str(tmp_path / "whole"), *arguments)
    whole.communicate()
    assert whole.returncode == 0
    expected = bytes_of(tmp_path / "whole")
    out = tmp_path / "out"
    resume: list[str] = []
    for wanted in (1, 15, 40):
        process = command("generate", str(out), *arguments, *resume)
        # Killed when that many particles are there (or when it was faster than we are: then nothing is left to do).
        while process.poll() is None and len(list(out.glob("*.json"))) <= wanted:
            time.sleep(0.002)
        process.kill()
        process.communicate()
        resume = ["--resume"]
    final = command("generate", str(out), *arguments, *resume)
    final.communicate()
    assert final.returncode == 0
    assert bytes_of(out) == expected


def test_interrupted_it_says_how_to_go_on(tmp_path):
    out = tmp_path / "out"
    # A shell starts what runs in the background with interrupts ignored, and so all that this starts.
    heed = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731
    process = command("generate", str(out), "--count", "100000", *SMALL, preexec_fn=heed)
    while process.poll() is None and len(list(out.glob("*.json"))) < 5:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "--resume" in err
    assert "Traceback" not in err
    assert not list(out.glob(".*.partial"))
    assert not (out / "particles.parquet").exists()


def test_a_full_disk_is_a_clear_error_and_leaves_whole_files(tmp_path):
    """A limit on the size of files stands in for a full disk: the write fails at the same place."""
    out = tmp_path / "out"

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))

    # Kernels are compiled by a command before: the cache of Warp is no part of this.
    warm = command("generate", str(tmp_path / "warm"), *SMALL)
    warm.communicate()
    assert warm.returncode == 0
    process = command("generate", str(out), "--count", "3", *SMALL, preexec_fn=limit)
    _, err = process.communicate()
    assert process.returncode == 2
    assert "Traceback" not in err
    assert "000001.stl" in err
    assert [p.name for p in out.iterdir()] == ["run.json"]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_a_clear_error(run, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    status, _, err = run("generate", str(locked / "out"), *SMALL)
    assert status == 2
    assert "cannot be used" in err


def commands(group=cli.app, words=()):
    """Words and function of every command."""
    names = [name for name in group if not name.startswith("-")]
    if group.default_command is not None:
        yield words, group
    for name in names:
        yield from commands(group[name], (*words, name))


@pytest.mark.parametrize(("words", "command"), [pytest.param(*found, id=" ".join(found[0])) for found in commands()])
def test_every_command_has_help_with_an_example_and_a_word_on_each_option(run, words, command):
    status, out, _ = run(*words, "--help")
    assert status == 0
    assert "Example" in out
    assert "--empty-" not in out
    told = [
        argument for argument in command.assemble_argument_collection(parse_docstring=True) if not argument.children
    ]
    assert len(told) > 2
    assert [argument.name for argument in told if not argument.parameter.help] == []


def test_help_and_version(run):
    status, out, _ = run("--help")
    assert status == 0
    assert "Example" in out
    status, out, _ = run("--version")
    assert status == 0
    assert out.strip().count(".") == 2


def test_reproduce_refuses_what_is_not_there(run):
    status, _, err = run("reproduce", "fig99")
    assert status == 2
    assert "fig2" in err


def test_picture(run):
    pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    status, out, _ = run("generate", "out", "--count", "4", "--picture", *SMALL)
    assert status == 0
    assert "gallery.png" in out
    assert Path("out/gallery.png").stat().st_size > 20_000
