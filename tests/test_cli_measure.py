"""`lithoform measure`, `lithoform picture` and the figures of shape as a user and a script meet them."""

from __future__ import annotations

import csv
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bodies
import numpy as np
import pytest

from lithoform import survey as survey_module
from lithoform import write_mesh
from lithoform.cli import measuring
from lithoform.descriptors.table import FOUR, STANDARD
from lithoform.reproduce import shape as reproduce_shape


@pytest.fixture
def files(tmp_path):
    """A box of 30 x 20 x 10 mm, a ball of 10 mm across, and a file that is no mesh."""
    folder = tmp_path / "stones"
    folder.mkdir()
    write_mesh(folder / "ball.ply", bodies.sphere(20_000, radius=0.005))
    write_mesh(folder / "box.stl", bodies.box((0.03, 0.02, 0.01)))
    (tmp_path / "broken.stl").write_bytes(b"solid of nothing\n")
    return tmp_path


def test_json_is_a_list_of_objects_in_the_unit_asked_for(run, files):
    status, out, err = run("measure", "stones", "--json")
    assert (status, err) == (0, "")
    ball, box = json.loads(out)
    assert ball["file"].endswith("ball.ply")
    assert box["file"].endswith("box.stl")
    assert set(STANDARD) <= set(box)
    assert box["volume"] == pytest.approx(6000.0, rel=1e-6)
    assert box["surface_area"] == pytest.approx(2200.0, rel=1e-6)
    assert ball["volume"] == pytest.approx(math.pi / 6 * 1000, rel=2e-3)
    assert ball["roundness"] == pytest.approx(1.0, abs=5e-3)
    assert box["conventions"]["boxiness"] == {"box": "principal"}
    assert box["conventions"]["roundness"] == {"scale": 0.25}
    status, out, _ = run("measure", "stones/box.stl", "--json", "--descriptors", "volume,sieve_size", "--unit", "cm")
    (row,) = json.loads(out)
    # The file does not tell its unit: the same numbers are centimetres now.
    assert row == {"file": "stones/box.stl", "volume": pytest.approx(6000.0), "sieve_size": pytest.approx(20.0)}


def test_the_table_on_the_screen_has_a_row_a_particle_and_the_units(run, files):
    status, out, err = run("measure", "stones")
    assert (status, err) == (0, "")
    head, ball, box = out.splitlines()[:3]
    assert "V [mm^3]" in head
    assert "roundness" in head
    assert max(map(len, (head, ball, box))) <= 100
    assert ball.startswith("stones/ball.ply")
    assert "6000" in box
    assert "cube" in ball


def test_csv_holds_all_that_was_measured_and_the_conventions(run, files):
    status, out, _ = run("measure", "stones", "broken.stl", "--csv", "out.csv", "--box", "minimum")
    assert status == 2
    assert "3 rows: out.csv" in out
    with (files / "out.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [set(FOUR) <= set(row) for row in rows] == [True] * 3
    assert float(rows[1]["boxiness"]) == pytest.approx(1.0, rel=1e-6)
    assert {row["box"] for row in rows} == {"minimum"}
    assert {row["roundness_scale"] for row in rows} == {"0.25"}
    assert rows[2]["volume"] == ""
    assert rows[2]["error"]


def test_a_file_that_cannot_be_measured_is_told_and_the_others_go_on(run, files):
    status, out, err = run("measure", "broken.stl", "stones/box.stl", "missing.ply", "--json")
    assert status == 2
    broken, box, missing = json.loads(out)
    assert "error" in broken
    assert "volume" in box
    assert "no such file" in missing["error"]
    assert err == ""
    status, out, err = run("measure", "broken.stl", "stones/box.stl")
    assert status == 2
    assert "broken.stl: not measured: " in err
    assert "box.stl" in out


def test_repairs_are_told(run, files):
    mesh = bodies.ellipsoid((0.01, 0.008, 0.006), 5_000)
    flipped = np.array(mesh.faces)
    flipped[::7] = flipped[::7, ::-1]
    write_mesh(files / "flipped.ply", type(mesh)(mesh.vertices, flipped))
    status, out, _ = run("measure", "flipped.ply", "--json", "--descriptors", "volume")
    (row,) = json.loads(out)
    assert status == 0
    assert row["repairs"]
    assert row["volume"] == pytest.approx(mesh.volume * 1e9, rel=1e-9)
    assert row["repairs"][0] in run("measure", "flipped.ply", "--descriptors", "volume")[1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--descriptors", "roundnes"], "roundness"),
        (["--unit", "furlong"], "unit"),
        (["--box", "largest"], "box"),
        (["--scale", "0"], "scale"),
        (["--triangles", "7"], "8 to 8000000 triangles"),
        (["--triangles", "-5"], "8 to 8000000 triangles"),
        (["--csv", "no/such/folder.csv"], "its folder does not exist"),
        (["--csv", "stones"], "a folder of that name"),
    ],
)
def test_wrong_requests_are_one_sentence_before_any_file_is_read(run, files, monkeypatch, arguments, says):
    read: list[Path] = []
    monkeypatch.setattr(survey_module, "read_scan", lambda path, **_: read.append(path))
    status, out, err = run("measure", "stones", *arguments)
    assert (status, out, read) == (2, "", [])
    assert says in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_a_folder_without_scans_is_an_error(run, files):
    (files / "empty").mkdir()
    status, out, err = run("measure", "empty")
    assert (status, out) == (2, "")
    assert "empty" in err


def test_picture_writes_a_png_of_the_panels_asked_for(run, files, drawing):
    status, out, err = run("picture", "stones/box.stl", "--out", "box.png", "--show", "inscribed,box")
    assert (status, err) == (0, "")
    assert (files / "box.png").read_bytes().startswith(b"\x89PNG")
    assert "boxiness 1.000" in out
    status, out, _ = run("picture", "stones/ball.ply", "--out", "ball.png", "--show", "hull", "--json")
    told = json.loads(out)
    assert told["show"] == ["hull"]
    assert told["solidity"] == pytest.approx(1.0)
    status, _, err = run("picture", "stones/box.stl", "--out", "no.png", "--show", "shadow")
    assert status == 2
    assert "inscribed" in err
    assert not (files / "no.png").exists()


def test_figures_of_the_paper_on_shape(run, files, drawing):
    status, out, _ = run("reproduce", "--list")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()][:3] == ["fig2", "fig3", "fig4"]
    status, out, _ = run("reproduce", "fig3", "--triangles", "5000", "--json")
    assert status == 0
    assert json.loads(out)["files"] == ["figures/fig3.png"]
    status, _, err = run("reproduce")
    assert status == 2
    assert "fig2" in err


def test_files_may_stand_after_options(run, files):
    status, out, err = run("measure", "stones/ball.ply", "--unit", "MM", "--csv", "a.csv", "stones/box.stl")
    assert (status, err) == (0, "")
    assert [line.split()[0] for line in out.splitlines()[1:3]] == ["stones/ball.ply", "stones/box.stl"]
    assert "[mm^3]" in out
    assert run("check", "stones/ball.ply", "--json", "stones/box.stl")[0] == 0
    status, _, err = run("measure", "--descriptors", "four", "stones")
    assert status == 2
    assert "after --descriptors" in err


def test_names_of_any_kind_are_measured_or_told(run, files):
    odd = "stones/a b é.stl", os.fsdecode(b"stones/\xff.stl")
    for name in odd:
        try:
            (files / name).write_bytes((files / "stones" / "box.stl").read_bytes())
        except OSError:
            pytest.skip("this file system has no such names")
    status, _, err = run("measure", *odd, "a" * 300 + ".stl", "--descriptors", "volume", "--csv", "out.csv")
    assert status == 2
    assert "file name too long" in err
    assert "unexpected" not in err
    with (files / "out.csv").open(encoding="utf-8") as file:
        names = [row["file"] for row in csv.DictReader(file)]
    assert names == ["stones/a b é.stl", "stones/\\udcff.stl", "a" * 300 + ".stl"]


def test_an_unforeseen_fault_is_one_of_one_file(run, files, monkeypatch):
    measured = survey_module.measure

    def faulty(mesh, *arguments, **options):
        if len(mesh.faces) < 100:
            raise ZeroDivisionError("division by zero")
        return measured(mesh, *arguments, **options)

    monkeypatch.setattr(survey_module, "measure", faulty)
    status, out, _ = run("measure", "stones", "--json", "--descriptors", "volume")
    ball, box = json.loads(out)
    assert status == 2
    assert "volume" in ball
    assert "unexpectedly (ZeroDivisionError: division by zero)" in box["error"]


def test_a_note_of_many_files_is_told_once(run, files):
    for i in range(3):
        write_mesh(files / f"{i}.ply", bodies.ellipsoid((0.02, 0.01, 0.005), 800))
    status, out, _ = run("measure", "0.ply", "1.ply", "2.ply")
    assert status == 0
    assert next(line for line in out.splitlines() if "coarse" in line).startswith("0.ply and 2 more: ")
    assert out.count("coarse") == 1
    status, out, _ = run("measure", "0.ply", "1.ply", "--json", "--descriptors", "roundness")
    assert [len(row["notes"]) for row in json.loads(out)] == [1, 1]


def test_long_names_are_cut_at_their_beginning_on_a_narrow_terminal(run, files, monkeypatch):
    name = "stones/of a very long name that ends with 0815.stl"
    (files / name).write_bytes((files / "stones" / "box.stl").read_bytes())
    monkeypatch.setattr(measuring.sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(measuring.shutil, "get_terminal_size", lambda _: os.terminal_size((100, 24)))
    _, out, _ = run("measure", name)
    assert max(map(len, out.splitlines()[:2])) == 100
    assert out.splitlines()[1].startswith("...")
    assert "0815.stl" in out.splitlines()[1]


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX's")
def test_interrupted_it_says_so_and_leaves_no_file(files):
    write_mesh(files / "fine.ply", bodies.sphere(80_000, radius=0.005))
    names = [f"{i}.ply" for i in range(200)]
    for name in names:
        (files / name).hardlink_to(files / "fine.ply")
    process = subprocess.Popen(
        [sys.executable, "-m", "lithoform", "measure", *names, "--csv", "out.csv"],
        cwd=files, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    # It is at work once the file beside the target is there.
    while process.poll() is None and not list(files.glob(".out.csv.*.partial")):
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    # Where the signal meets the making of a dataclass, CPython ends by it though it was caught: 130 in a shell too.
    assert process.returncode in (130, -signal.SIGINT)
    assert out == ""
    assert "interrupted" in err
    assert "Traceback" not in err
    assert not list(files.glob("*out.csv*")) + list(files.glob(".out.csv*"))


def test_picture_refuses_what_it_cannot_write_before_it_measures(run, files, drawing, monkeypatch):
    status, out, err = run("picture", "no such file.stl", "--out", "nowhere/box.png")
    assert (status, out) == (2, "")
    assert "nowhere/box.png" in err
    write_mesh(files / "coarse.ply", bodies.ellipsoid((0.02, 0.01, 0.005), 800))
    status, out, _ = run("picture", "coarse.ply", "--out", "a.png", "--show", "inscribed", "--json")
    assert status == 0
    assert "coarse" in json.loads(out)["notes"][0]


@pytest.mark.parametrize("figure", ["fig3", "fig4"])
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--seed", "-1"], "seed"),
        (["--triangles", "7"], "triangles"),
        (["--device", "abacus"], "device"),
        (["--out", "figure.png"], "expected a folder"),
    ],
)
def test_figures_that_cannot_be_made_leave_no_folder(run, files, drawing, monkeypatch, figure, arguments, says):
    monkeypatch.setattr(reproduce_shape, "measure_many", lambda *_: pytest.fail("work was begun"))
    before = sorted(files.iterdir())
    status, out, err = run("reproduce", figure, *arguments)
    assert (status, out) == (2, "")
    assert says in err
    assert sorted(files.iterdir()) == before
