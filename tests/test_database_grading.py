"""Draws by size from a database: the standards' curves at every sieve, masses by hand, sizes measured anew."""

from __future__ import annotations

import csv
import itertools
import json
import math
from dataclasses import replace
from pathlib import Path

import bodies
import numpy as np
import pyarrow.parquet as pq
import pytest
from captions import record_captions
from cyclopts import App

from lithoform import (
    FileFormatError,
    LithoformError,
    OutputError,
    RecipeError,
    SampleError,
    generate,
    measure,
    write_mesh,
)
from lithoform.cli.database_contents import grade
from lithoform.database.building import Measures, build
from lithoform.database.grading import Candidates, read_candidates, verify
from lithoform.database.grading import grade as draw
from lithoform.database.importing import import_scans
from lithoform.database.store import Store
from lithoform.figures.grading import grading_curve
from lithoform.gradation.curves import GRADATIONS, Gradation, find_gradation
from lithoform.gradation.quantities import parse_container_volume, parse_mass
from lithoform.lab import sieve_curve
from lithoform.planning import Plan

PLAN = Plan(count=16, seed=1, preset="database", shape_class="mixed", base={"triangles": 1280})
SITE = "# a quarry\nsize_mm,low,high\n16,100,100\n8,50,70\n4,20,40\n2,0,10\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Sixteen stones, half of which have their sieve sizes in their rows; a ball and a box as scans."""
    folder = tmp_path_factory.mktemp("grading")
    half = replace(PLAN, count=8)
    [*build(folder / "db", half, Measures(("volume", "sieve_size")), source="sized", workers=0, device="cpu")]
    [*build(folder / "db", PLAN, Measures(("volume",)), source="stones", workers=0, device="cpu")]
    write_mesh(folder / "ball.ply", bodies.sphere(20_000, radius=0.005))
    write_mesh(folder / "box.ply", bodies.box((0.03, 0.02, 0.01)))
    scans = [folder / "ball.ply", folder / "box.ply"]
    [*import_scans(folder / "db", scans, Measures(("volume",), keep_meshes=True), source="scans", workers=0)]
    return folder / "db"


@pytest.fixture(scope="module")
def stones(folder) -> Candidates:
    return read_candidates(Store(folder), "source = 'stones'", device="cpu")


@pytest.fixture
def call(capsys):
    """Run `grade` as a command; gives its status and what it printed."""
    app = App()
    app.command(grade)

    def run(*words: object) -> tuple[int, str]:
        status = app(["grade", *map(str, words)], exit_on_error=False, print_error=False, result_action="return_value")
        return status, capsys.readouterr().out

    return run


def read(path: Path) -> list[dict]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


class TestCandidates:
    def test_sizes_are_taken_from_the_rows_or_measured_from_the_meshes(self, folder, stones):
        assert (len(stones), stones.measured) == (16, 16)
        both = read_candidates(Store(folder), "source in ('sized', 'stones')", device="cpu", threads=1)
        assert (len(both), both.measured) == (24, 16)
        # The stones 1 to 8 of both are the same.
        assert np.array_equal(both.sieve_sizes[:8], both.sieve_sizes[8:16])
        assert np.array_equal(both.sieve_sizes[8:], stones.sieve_sizes)
        for number in (1, 16):
            found = measure(generate(PLAN.recipe(number), device="cpu"), ("sieve_size", "volume"))
            assert stones.sieve_sizes[number - 1] == found["sieve_size"]
            assert stones.volumes[number - 1] == found["volume"]

    def test_a_ball_and_a_box_have_the_unit_volumes_of_geometry(self, folder):
        ball, box = read_candidates(Store(folder), "source = 'scans'").unit_volumes
        assert ball == pytest.approx(math.pi / 6, rel=2e-3)
        # A box of a >= b >= c passes min(b, (b + c) / sqrt 2): here 20 mm.
        assert box == pytest.approx(0.03 * 0.02 * 0.01 / 0.02**3, rel=1e-9)

    def test_none_and_nonsense_are_refused(self, folder):
        with pytest.raises(SampleError, match=r"draw from; .* has none for which .class = 'ball'. holds"):
            read_candidates(Store(folder), "class = 'ball'")
        with pytest.raises(SampleError, match=r"expected a condition such as .* in SQL"):
            read_candidates(Store(folder), "class is")


@pytest.mark.parametrize(
    ("name", "least", "mass"),
    [
        ("AC-13", "2.36mm", "1.5kg"),
        ("Fuller-16", "1mm", "300g"),
        ("SMA-13", "1.18mm", "0.8kg"),
        ("OGFC-13", "2.36mm", "1.5kg"),
        ("DIN A16", "2mm", "1kg"),
        ("ASTM C33 #57", None, "0.02t"),
        ("site.csv", None, "400 g"),
        ("AC-13", "3mm", "1.5kg"),
    ],
)
@pytest.mark.parametrize("spread", ["mass", "count"])
def test_curves_are_met_at_every_sieve_by_what_the_file_holds(call, folder, tmp_path, name, least, mass, spread):
    if name == "site.csv":
        (tmp_path / name).write_text(SITE, encoding="utf-8")
        curve = Gradation("site", (16e-3, 8e-3, 4e-3, 2e-3), (100, 50, 20, 0), (100, 70, 40, 10))
        name = str(tmp_path / name)
    else:
        curve = find_gradation(name)
    out = tmp_path / "out.csv"
    words = ["--gradation", name, "--mass", mass, "--out", out, "--spread", spread, "--select", "source = 'stones'"]
    status, text = call(folder, *words, *(["--min-size", least] if least else []), "--json")
    assert status == 0
    rows, told = read(out), json.loads(text)
    sizes, masses, scales = (np.array([float(row[k]) for row in rows]) for k in ("sieve_size", "mass", "scale"))
    # The file is sieved again: the curve of the standard, cut at the least size and scaled to 100.
    cut = curve.openings[-1] if least is None else float(least.removesuffix("mm")) * 1e-3
    openings = [d for d in curve.openings if d > cut * 1.000001] + [cut]
    asked = curve.passing(openings)
    asked = 100.0 * (asked - asked[-1]) / (100.0 - asked[-1])
    met = sieve_curve(sizes, masses, openings)
    assert np.abs(met - asked).max() < 1e-6
    assert told["largest_difference"] < 1.0
    assert [row["opening"] for row in told["sieves"]] == pytest.approx(openings, rel=1e-12)
    assert [row["asked"] for row in told["sieves"]] == pytest.approx(asked, abs=1e-9)
    assert [row["met"] for row in told["sieves"]] == pytest.approx(met, abs=1e-9)
    # Masses add up to what was asked for, and are those of the scaled stones.
    assert masses.sum() == pytest.approx({"1.5kg": 1.5, "300g": 0.3, "0.8kg": 0.8, "1kg": 1.0, "0.02t": 20.0,
                                          "400 g": 0.4}[mass], rel=1e-9)  # fmt: skip
    volumes = dict(enumerate(Store(folder).table(["volume"], sources=["stones"])["volume"].to_pylist(), 1))
    expected = [2650.0 * volumes[int(row["number"])] * scale**3 for row, scale in zip(rows, scales, strict=True)]
    assert masses == pytest.approx(np.array(expected), rel=1e-12)
    # Each lies between the sieves that its fraction names.
    bounds = [[1e-3 * float(x) for x in row["fraction"].removesuffix(" mm").split("-")] for row in rows]
    assert all(low < size < high for (low, high), size in zip(bounds, sizes, strict=True))
    # With the fines that were not drawn the mixture is within the limits wherever the curve itself is.
    for row in told["sieves"]:
        if row["low"] is not None:
            assert row["low"] - 1e-6 <= row["mixture"] <= row["high"] + 1e-6
            assert row["mixture"] == pytest.approx(float(curve.passing(row["opening"])), abs=1e-6)
    if curve.passing_low == curve.passing_high or least == "3mm":
        assert told["sieves"][-1]["low"] is None


@pytest.mark.parametrize("curve", ["low", "high"])
def test_the_limits_themselves_can_be_met(stones, curve):
    drawn = draw(stones, GRADATIONS["AC-13"], mass=1.5, min_size=2.36e-3, curve=curve, seed=1)
    for row, limit in zip(drawn.sieves, GRADATIONS["AC-13"].curve(curve), strict=False):
        assert row.mixture == pytest.approx(limit, abs=1e-6)


def test_the_papers_mould_filled_with_balls_has_the_papers_count(call, folder, tmp_path):
    out = tmp_path / "mould.parquet"
    mould = ["--fill", "cylinder:150mm:63.5mm", "--packing-density", "0.58"]
    asked = ["--gradation", "AC-13", "--min-size", "2.36mm", "--spread", "count", *mould, "--out", out]
    status, text = call(folder, *asked, "--select", "source = 'scans' and number = 1")
    assert status == 0
    table = pq.read_table(out)
    assert table.column_names == ["source", "number", "scale", "sieve_size", "mass", "fraction"]
    fractions = table["fraction"].to_pylist()
    counts = [fractions.count(name) for name in ("13.2-16 mm", "9.5-13.2 mm", "4.75-9.5 mm", "2.36-4.75 mm")]
    # The specification's 31 + 250 + 1,278 + 7,063 = 8,622 (the first is of few, and off by one).
    assert counts == pytest.approx([31, 250, 1278, 7063], rel=0.035)
    assert len(fractions) == pytest.approx(8622, rel=0.005)
    volume = 0.58 * math.pi / 4 * 0.15**2 * 0.0635
    assert sum(table["mass"].to_pylist()) == pytest.approx(2650.0 * volume, rel=1e-9)
    assert f"{len(fractions):,} particles" in text
    assert f"1 of 1 particles are used; scans 1 the most, {len(fractions):,} times" in text


def test_stones_fill_the_mould_with_as_many_as_their_unit_volume_says(stones):
    volume = 0.58 * math.pi / 4 * 0.15**2 * 0.0635
    drawn = draw(stones, GRADATIONS["AC-13"], volume=volume, min_size=2.36e-3, spread="count")
    assert len(drawn) == pytest.approx(8622 * (math.pi / 6) / stones.unit_volumes.mean(), rel=0.01)
    # Dealt like cards in each of four fractions: nobody is used more than once a round more than another.
    assert np.ptp(drawn.uses) <= 4


def test_the_same_request_gives_the_same_bytes_and_another_seed_others(call, folder, tmp_path):
    words = ["--gradation", "AC-13", "--min-size", "4.75mm", "--count", "300", "--select", "source = 'sized'"]
    texts = []
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        status, text = call(folder, *words, "--out", tmp_path / f"{name}.csv", "--seed", seed, "--json")
        assert status == 0
        assert len(read(tmp_path / f"{name}.csv")) == 300
        texts.append({**json.loads(text), "out": ""})
    a, b, c = ((tmp_path / f"{name}.csv").read_bytes() for name in "abc")
    assert a == b != c
    assert texts[0] == texts[1]


class TestVerification:
    def test_all_of_a_small_draw_have_the_sieve_sizes_of_the_table(self, folder, stones):
        drawn = draw(stones, GRADATIONS["AC-13"], count=60, min_size=9.5e-3, seed=2)
        found = verify(Store(folder), drawn, sample=1000, device="cpu")
        assert found.count == 60
        assert found.largest_deviation < 1e-9
        assert found.largest_volume_deviation < 1e-12
        assert found.misplaced == 0
        part = verify(Store(folder), drawn, sample=5, seed=3, device="cpu", threads=1)
        assert (part.count, part.misplaced) == (5, 0)

    def test_wrong_sizes_in_the_database_are_seen(self, folder, stones):
        wrong = replace(stones, sieve_sizes=stones.sieve_sizes * 1.01)
        drawn = draw(wrong, GRADATIONS["AC-13"], count=60, min_size=9.5e-3, seed=2)
        found = verify(Store(folder), drawn, sample=20, device="cpu")
        assert found.largest_deviation == pytest.approx(1.0 - 1.0 / 1.01, rel=1e-6)
        with pytest.raises(SampleError, match="at least 1"):
            verify(Store(folder), drawn, sample=0)

    def test_the_command_tells_it(self, call, folder, tmp_path):
        words = ["--gradation", "AC-13", "--min-size", "9.5mm", "--count", "40", "--out", tmp_path / "a.csv",
                 "--select", "source = 'sized'"]  # fmt: skip
        assert "measured anew: 40 particles" in call(folder, *words, "--verify")[1]
        assert json.loads(call(folder, *words, "--verify", "--json")[1])["verification"]["misplaced"] == 0


@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        (["--mass", "20g"], RecipeError, "too small a mass .* kg will do"),
        (["--count", "3"], RecipeError, "too small a count .* particles will do"),
        (["--mass", "1kg", "--count", "9"], RecipeError, "one of --mass, --count and --fill; got --mass and --count"),
        ([], RecipeError, "one of --mass, --count and --fill; got none"),
        (["--mass", "1kg", "--gradation", "AC13"], RecipeError, "Did you mean AC-13"),
        (["--mass", "1kg", "--min-size", "0.01mm"], RecipeError, "at least 0.075 mm, the finest sieve"),
        (["--mass", "1kg", "--min-size", "17mm"], RecipeError, "nothing is coarser"),
        (["--mass", "1kg", "--packing-density", "0.6"], RecipeError, "goes with --fill"),
        (["--fill", "box:1m:1m:1m"], RecipeError, "above 0 and below 1 with --fill"),
        (["--fill", "box:1m:1m:1m", "--packing-density", "58"], RecipeError, "above 0 and below 1"),
        (["--fill", "ball:1m", "--packing-density", "0.5"], RecipeError, "expected a container such as"),
        (["--mass", "1kg", "--density", "-1"], RecipeError, "positive density"),
        (["--mass", "1kg", "--spread", "area"], RecipeError, "spread of mass or count"),
        (["--mass", "1kg", "--curve", "best"], RecipeError, "low, mid, high"),
        (["--mass", "1kg", "--select", "class = 'ball'"], SampleError, "expected particles to draw from"),
        (["--mass", "1kg", "--gradation", "none.csv"], FileFormatError, "none.csv cannot be read"),
        (["--mass", "1kg", "--out", "out.xlsx"], FileFormatError, "ends in .csv or .parquet"),
        (["--mass", "1kg", "--out", "none/out.csv"], OutputError, "its folder does not exist"),
        (["--mass", "1kg", "--picture", "none/out.png"], OutputError, "its folder does not exist"),
        (["--mass", "1e5t", "--min-size", "0.6mm"], RecipeError, "at most 20000000 particles"),
    ],
)
def test_what_cannot_be_drawn_is_told_and_leaves_no_file(call, folder, tmp_path, monkeypatch, words, error, message):
    monkeypatch.chdir(tmp_path)
    given = {"--gradation": "AC-13", "--min-size": "2.36mm", "--out": "out.csv", "--select": "source = 'sized'"}
    given |= dict(zip(words[::2], words[1::2], strict=True))
    with pytest.raises(error, match=message):
        call(folder, *itertools.chain(*given.items()))
    assert not [*tmp_path.iterdir()]


def test_masses_and_containers_are_the_floats_of_their_decimals():
    assert parse_mass("1.5kg") == parse_mass(" 1.5 ") == parse_mass("1500 g") == parse_mass("0.0015T") == 1.5
    assert parse_mass("2.36g") == 0.00236
    assert parse_container_volume("box:1m:0.5m:20cm") == pytest.approx(0.1, rel=1e-15)
    assert parse_container_volume("cylinder:150:63.5mm") == pytest.approx(math.pi / 4 * 0.0225 * 0.0635, rel=1e-15)
    for text in ("", "kg", "-1kg", "0", "1e999kg", "1 lb", "1,5kg"):
        with pytest.raises(RecipeError, match="expected a"):
            parse_mass(text)
    for text in ("cylinder:1m", "box:1m:1m", "cylinder", "cylinder:1m:0m", "box:1m:1m:1m:1m", "cube:1m:1m:1m"):
        with pytest.raises(RecipeError, match="expected a"):
            parse_container_volume(text)


@pytest.mark.usefixtures("drawing")
class TestPicture:
    def test_it_names_the_sieves_and_what_was_drawn(self, call, folder, tmp_path, monkeypatch):
        captions = record_captions(monkeypatch)
        words = ["--gradation", "AC-13", "--min-size", "2.36mm", "--mass", "1.5kg", "--select", "source = 'sized'"]
        for name in ("a", "b"):
            call(folder, *words, "--out", tmp_path / "a.csv", "--picture", tmp_path / f"{name}.png")
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
        texts = {caption.text for caption in captions}
        for text in ("2.36", "13.2", "16", "0.075", "limits", "asked for", "drawn", "finer: not drawn"):
            assert text in texts
        assert any(text.startswith("AC-13: ") and text.endswith(" particles, 1.5 kg") for text in texts)

    def test_a_single_curve_of_many_sieves_has_room_for_their_names(self, stones, monkeypatch):
        captions = record_captions(monkeypatch)
        curve = GRADATIONS["Fuller-31.5"]
        grading_curve(curve.openings, curve.mid, title="Fuller")
        assert {"31.5", "0.063"} <= {caption.text for caption in captions}

    def test_what_is_no_curve_is_refused(self):
        good = ([2e-3, 1e-3], [100.0, 0.0])
        for wrong in (
            ([1e-3, 2e-3], [0.0, 100.0]),
            ([1e-3], [100.0]),
            ([2e-3, 1e-3], [101.0, 0.0]),
            ([1.0], [1.0, 2.0]),
        ):
            with pytest.raises(LithoformError, match="expected"):
                grading_curve(*wrong)
        with pytest.raises(LithoformError, match="for met"):
            grading_curve(*good, met=([0.0], [50.0]))
        with pytest.raises(LithoformError, match="for the limits"):
            grading_curve(*good, limits=([100.0], [100.0]))
