"""`lithoform design` from a library that is made to the stones in a folder, and what it refuses."""

from __future__ import annotations

import itertools
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lithoform import Recipe, generate, measure
from lithoform.cli.designing import design
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, OutputError, RecipeError
from lithoform.figures.design import ClosedLoop, closed_loop_figure, loop_errors_figure
from lithoform.inverse.design import Design, Setting, as_dict
from lithoform.inverse.targets import TargetError, parse_target
from lithoform.inverse.writing import prepare_folder, write_design
from lithoform.mesh_io import read_mesh
from lithoform.recipe_io import from_dict, read_recipe
from lithoform.soundness import check
from lithoform.topology import sphere

TRIANGLES = 320
TARGET = "solidity=0.93,true_sphericity=0.80"


def run(*words: str) -> int:
    return design([*words], exit_on_error=False, print_error=False, result_action="return_value")


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> Path:
    base = tmp_path_factory.mktemp("library")
    words = ["library", "build", str(base / "stones"), "--out", str(base / "small.parquet"), "--count", "300"]
    assert run(*words, "--triangles", str(TRIANGLES), "--workers", "0", "--device", "cpu") == 0
    return base / "small.parquet"


def test_a_library_is_finished_and_made_again_with_the_same_bytes(library, tmp_path, capsys):
    stones = library.parent / "stones"
    gone = sorted((stones / "particles").glob("*.parquet"))[1]
    gone.unlink()
    again = tmp_path / "again.parquet"
    words = ["--count", "300", "--triangles", str(TRIANGLES), "--workers", "0", "--device", "cpu", "--json"]
    assert run("library", "build", str(stones), "--out", str(again), *words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["stones"] + told["left_out"] == 300
    assert again.read_bytes() == library.read_bytes()


@pytest.mark.parametrize("refine", ["--refine", "--no-refine"])
def test_stones_recipe_and_numbers_agree(library, tmp_path, capsys, refine):
    out = tmp_path / "design"
    words = ["--target", TARGET, "--library", str(library), "--out", str(out), "--seeds", "2", "--fresh", "4"]
    assert run(*words, refine, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["stones_of_the_search"] > 0) == (refine == "--refine")
    assert set(told["target"]) == {"solidity", "true_sphericity"}
    assert {p.name for p in out.iterdir()} >= {"recipe.toml", "candidates.csv", "design.json", "000001.stl"}
    recipe = read_recipe(out / "recipe.toml")
    assert recipe == from_dict({k: tuple(v) if isinstance(v, list) else v for k, v in told["recipe"].items()})
    values = []
    for number, seed in enumerate(told["fresh_seeds"], start=1):
        stone = generate(recipe.replace(seed=seed))
        values.append([measure(stone, FOUR)[name] for name in FOUR])
        if number <= 2:
            sidecar = json.loads((out / f"{number:06d}.json").read_text())
            assert sidecar["recipe"]["seed"] == seed
            mesh = read_mesh(out / f"{number:06d}.stl", unit="mm")
            assert check(mesh).sound
    assert list(told["achieved"]["mean"].values()) == pytest.approx(np.mean(values, axis=0))
    assert list(told["achieved"]["scatter"].values()) == pytest.approx(np.std(values, axis=0, ddof=1))
    assert tomllib.loads((out / "recipe.toml").read_text())["triangles"] == TRIANGLES
    rows = (out / "candidates.csv").read_text().splitlines()
    errors = [float(row.split(",")[1]) for row in rows[1:]]
    assert errors
    assert json.loads((out / "design.json").read_text())["recipe"] == told["recipe"]


def test_the_table_shows_target_predicted_and_achieved(library, tmp_path, capsys):
    words = ["--target", TARGET, "--library", str(library), "--out", str(tmp_path / "d"), "--no-refine", "--seeds", "1"]
    assert run(*words, "--fresh", "3", "--class", "plate") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["target", "tolerance", "predicted", "achieved", "scatter", "error"]
    assert lines[1].split()[:3] == ["roundness", "-", "-"]
    assert lines[3].split()[:3] == ["solidity", "0.930", "0.020"]


def test_a_folder_is_replaced_only_when_it_is_ours(library, tmp_path):
    out = tmp_path / "d"
    words = ["--target", TARGET, "--library", str(library), "--out", str(out), "--no-refine", "--fresh", "2"]
    assert run(*words, "--seeds", "2") == 0
    with pytest.raises(OutputError, match="give --overwrite"):
        run(*words, "--seeds", "1")
    with pytest.raises(RecipeError, match="class"):
        run(*words, "--class", "bladee", "--overwrite")
    assert (out / "000002.stl").exists()  # what is there goes only when the new one is known
    assert run(*words, "--seeds", "1", "--overwrite") == 0
    assert not (out / "000002.stl").exists()
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.txt").write_text("mine")
    (other / "design.json").write_text('{"route": "x", "recipe": {}, "files": ["thesis.txt"]}')
    with pytest.raises(OutputError, match="other files"):
        run("--target", TARGET, "--library", str(library), "--no-refine", "--overwrite", "--out", str(other))
    assert (other / "thesis.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "kind", "told"),
    [
        (["--target", "R=2"], TargetError, "at most 1"),
        (["--target", "R=0.3", "--route", "papr"], RecipeError, "Did you mean paper"),
        (["--target", "R=0.3", "--route", "paper", "--class", "cube"], RecipeError, "leave out"),
        (["--target", "R=0.3", "--seeds", "0"], RecipeError, "1 to 1000 --seeds"),
        (["--target", "R=0.3", "--seed", "-1"], RecipeError, "seed must be 0"),
        (["--target", "R=0.3", "--class", "disc"], RecipeError, "--class to be one of"),
        (["--target", "R=0.3", "--library", "none.parquet"], FileFormatError, "cannot be read"),
    ],
)
def test_a_wrong_request_is_refused_in_a_sentence(tmp_path, words, kind, told):
    with pytest.raises(kind, match=told):
        run(*words, "--out", str(tmp_path / "d"))
    assert not [p for p in (tmp_path / "d").glob("*") if p.suffix == ".stl"]


def test_a_library_is_not_written_into_its_database(tmp_path):
    with pytest.raises(OutputError, match="another place"):
        run("library", "build", str(tmp_path / "stones"), "--out", str(tmp_path / "stones" / "x.parquet"))


def test_workers_that_there_cannot_be_are_refused_before_anything_is_made(tmp_path):
    with pytest.raises(RecipeError, match="--workers of at least 0"):
        run("library", "build", str(tmp_path / "s"), "--out", str(tmp_path / "x.parquet"), "--workers", "-1")
    assert [*tmp_path.iterdir()] == []


def test_an_interrupted_library_says_so_once_and_goes_on(tmp_path, monkeypatch, capsys):
    from lithoform import progress
    from lithoform.cli import main

    def stopped(items, **_):
        yield from itertools.islice(items, 30)
        raise KeyboardInterrupt

    words = ["library", "build", str(tmp_path / "s"), "--out", str(tmp_path / "x.parquet"), "--count", "200",
             "--triangles", str(TRIANGLES), "--workers", "0"]  # fmt: skip
    with monkeypatch.context() as patch:
        patch.setattr(progress, "track", stopped)
        with pytest.raises(SystemExit) as end:
            main(["design", *words])
    said = capsys.readouterr().err
    assert end.value.code == 130
    assert said == f"lithoform: interrupted; {tmp_path / 's'} holds 30 of 200 stones: the same command goes on.\n"
    assert [path.name for path in tmp_path.iterdir()] == ["s"]
    assert run(*words) == 0


def test_stones_that_were_not_measured_are_neither_counted_nor_written(tmp_path):
    recipe = Recipe(triangles=TRIANGLES)
    setting = Setting(recipe, np.full(4, 0.5), np.full(4, 0.1), np.full(4, 0.1), 1.0, within=False)
    achieved = np.array([[np.nan] * 4, [0.3, 0.4, 0.9, 0.8], [np.nan] * 4, [0.5, 0.4, 0.9, 0.8]])
    found = Design(parse_target("R=0.4"), "search", recipe, setting, (setting,), achieved, (11, 12, 13, 14), 0,
                   refined=False, reached=True, limits=(), verdict="")  # fmt: skip
    told = as_dict(found)
    assert told["achieved"]["stones"] == 2
    assert told["achieved"]["mean"]["roundness"] == pytest.approx(0.4)
    prepare_folder(tmp_path / "d", overwrite=False)
    assert len(write_design(found, tmp_path / "d", stones=3, picture=False)) == 2
    seeds = [json.loads((tmp_path / "d" / f"00000{n}.json").read_text())["seed"] for n in (1, 2)]
    assert seeds == [12, 14]
    assert "000003.stl" not in json.loads((tmp_path / "d" / "design.json").read_text())["files"]
    # A run that was killed between the stones leaves a folder of which the next says so.
    (tmp_path / "d" / "000002.stl").unlink()
    (tmp_path / "d" / "000002.json").unlink()
    with pytest.raises(
        OutputError, match=r"stopped before it was finished \(2 of its 7 files are missing\): give --overw"
    ):
        prepare_folder(tmp_path / "d", overwrite=False)
    prepare_folder(tmp_path / "d", overwrite=True)
    assert [*(tmp_path / "d").iterdir()] == []


def test_a_library_does_not_take_the_place_of_another_file(tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_text("keep")
    with pytest.raises(FileFormatError, match="not a design library"):
        run("library", "build", str(tmp_path / "stones"), "--out", str(mine), "--count", "200")
    assert mine.read_text() == "keep"
    assert not (tmp_path / "stones").exists()


def test_pictures_show_what_comes_in():
    pytest.importorskip("pyvista")
    ball = sphere("octahedral", 8)
    values = np.array([[0.3, 0.42, 0.9, 0.8], [0.32, 0.43, 0.91, 0.79]])
    loop = ClosedLoop("a", np.array([0.3, np.nan, 0.9, 0.8]), np.full(4, 0.02), values[0], values, [ball])
    one, two = closed_loop_figure([loop], dpi=80), closed_loop_figure([loop, loop], dpi=80)
    assert one.shape[1] == two.shape[1] == round(181.0 / 25.4 * 80)
    assert one.shape[0] < two.shape[0]
    assert (one == closed_loop_figure([loop], dpi=80)).all()
    errors = loop_errors_figure({"search": values, "paper's route": 2 * values}, 0.008, title="t", dpi=80)
    assert (errors < 250).any()
