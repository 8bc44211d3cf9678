"""`lithoform measure`, `lithoform picture` and the figures of shape as a user and a script meet them."""

from __future__ import annotations

import csv
import json
import math

import bodies
import numpy as np
import pytest

from lithoform import write_mesh
from lithoform.descriptors.table import FOUR, STANDARD


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
    status, out, _ = run("measure", "stones/box.stl", "--json", "--descriptors", "volume,sieve_size", "--unit", "cm")
    (row,) = json.loads(out)
    # The file does not tell its unit: the same numbers are centimetres now.
    assert row == {"file": "stones/box.stl", "volume": pytest.approx(6000.0), "sieve_size": pytest.approx(20.0)}


def test_the_table_on_the_screen_has_a_row_a_particle_and_the_units(run, files):
    status, out, err = run("measure", "stones")
    assert (status, err) == (0, "")
    head, ball, box = out.splitlines()[:3]
    assert "volume [mm^3]" in head
    assert "roundness" in head
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
    ],
)
def test_wrong_requests_are_one_sentence(run, files, arguments, says):
    status, out, err = run("measure", "stones/box.stl", *arguments)
    assert status == 2
    assert says in out + err
    assert "Traceback" not in out + err


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
    assert [line.split()[0] for line in out.splitlines()] == ["fig2", "fig3", "fig4"]
    status, out, _ = run("reproduce", "fig3", "--triangles", "5000", "--json")
    assert status == 0
    assert json.loads(out)["files"] == ["figures/fig3.png"]
    status, _, err = run("reproduce")
    assert status == 2
    assert "fig2" in err
