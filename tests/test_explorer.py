"""The explorer without a browser: links, turns, percentiles, figures, who may ask, and what is answered."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from explorer_fixtures import AXES, TRIANGLES, small_database, small_library
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import FileFormatError, OutputError, Recipe, RecipeError, benchmark_recipe, generate, measure, read_mesh
from lithoform.database.store import Store
from lithoform.descriptors.table import FOUR
from lithoform.errors import LithoformError, MeshError
from lithoform.explorer.controls import controls
from lithoform.explorer.design import DesignSpace, Filter, target_of
from lithoform.explorer.figures import Sample, cloud, distributions, encoded
from lithoform.explorer.layout import population_panel
from lithoform.explorer.populations import PAGE, Percentiles, Shelf
from lithoform.explorer.state import MAX_TRIANGLES, from_page, link_of, preset_recipe, recipe_of_link, to_page
from lithoform.explorer.stones import Stone, pack, unpack
from lithoform.explorer.turns import SupersededError, Turns
from lithoform.inverse.surrogate import Surrogate
from lithoform.parameters import CHOICES, PARAMETERS
from lithoform.presets import SHAPE_CLASSES, shape_class_of
from lithoform.recipe_io import read_recipe
from lithoform.seeds import MAX_SEED
from lithoform.soundness import check

pytest.importorskip("dash", reason="the explorer needs Dash")

ROOT = Path(__file__).resolve().parent.parent
TARGET = target_of((0.3, 0.42, 0.9, 0.8), (0.02,) * 4, (1.0,) * 4)


@pytest.fixture(scope="module")
def library():
    return small_library()


@pytest.fixture(scope="module")
def space(library):
    return DesignSpace(library)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return small_database(tmp_path_factory.mktemp("explorer") / "db")


@pytest.fixture(scope="module")
def app(folder, library):
    from lithoform.explorer.app import make_app

    return make_app(folder, library)


@pytest.fixture
def client(app):
    return app.server.test_client()


def ask(client, path, **body):
    """The answer of /api/PATH: a dict, or what `unpack` gives."""
    answer = client.post(f"/api/{path}", json={"page": "test", **body})
    assert answer.status_code == 200, answer.text
    return answer.json if answer.mimetype == "application/json" else unpack(answer.data)


# ------------------------------------------------------------------------------------------------ links

_CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "perturbation": st.floats(0.0, 1.0),
        "main_scale": st.floats(0.0, 3.0),
        "chip_sharpness": st.floats(0.1, 128.0),
        "phase_offset": st.tuples(*[st.floats(-6.0, 6.0)] * 3),
        "twist_axis": st.tuples(st.floats(-2.0, 2.0), st.floats(0.5, 1.0), st.floats(-2.0, 2.0)),
        "octaves": st.integers(0, 10),
        "flatten": st.booleans(),
        "calibration_align": st.booleans(),
        "calibration_frame": st.sampled_from(CHOICES["calibration_frame"]),
        "size": st.tuples(st.floats(0.9, 1.0), st.floats(0.5, 0.9), st.floats(0.1, 0.5)),
        "seed": st.integers(0, MAX_SEED),
        "triangles": st.sampled_from([1280, 20_000, 200_000]),
    },
)


@settings(deadline=None, max_examples=60)
@given(_CHANGES)
def test_a_link_and_a_page_give_back_the_very_recipe(changes):
    recipe = Recipe().replace(**changes)
    assert recipe_of_link(link_of(recipe)) == recipe
    assert recipe_of_link("?tab=studio&" + link_of(recipe)) == recipe
    assert from_page(json.loads(json.dumps(to_page(recipe)))) == recipe


def test_a_link_tells_only_what_differs_from_the_benchmark():
    assert link_of(benchmark_recipe()) == ""
    assert recipe_of_link("") == benchmark_recipe()
    assert link_of(benchmark_recipe(k=0.2, delta=(0, 1, 0.5), flatten=False, seed=7)) == (
        "k=0.2&delta=0.0,1.0,0.5&flatten=false&seed=7"
    )
    assert recipe_of_link("perturbation=0.2&s%5Fw=2") == benchmark_recipe(k=0.2, s_w=2)


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("k=7", r"perturbation \(k\) must be 0 to 1; got 7"),
        ("perturbatoin=0.2", "Did you mean perturbation"),
        ("k=0.2&perturbation=0.3", "given twice in the link"),
        ("k=", "expected NAME=VALUE"),
        ("k=nan", "must be finite"),
        ("k=1e999", "must be finite"),
        ("seed=" + "9" * 30, "seed"),
        ("N_t=8000000", "at most 200,000 triangles"),
        ("N_t=1281", "nearest counts"),
        ("N_t=200000&n_s=1000", "in at most 250 steps; got 1,000: take fewer"),
        ("W=9", "order L >= W >= H"),
        ("a=0,0,0", "must be a direction"),
        ("delta=1,2", "phase_offset"),
        ("calibration_frame=%3Cscript%3E", "must be one of"),
        ("source=../../etc/passwd", "no parameter"),
        ("k=0.2&" * 1000, "at most 4000 characters"),
    ],
)
def test_a_bad_link_is_refused_in_one_sentence(query, told, client):
    with pytest.raises(RecipeError, match=told):
        recipe_of_link(query)
    answer = ask(client, "recipe", link="?" + query)
    assert set(answer) == {"error"}
    assert "\n" not in answer["error"]


@pytest.mark.parametrize("values", [None, [], 3, {"seed": "-1"}, {"seed": "1" * 21}, {"seed": "٣"}, {"k": "0.2"},
                                    {"phase_offset": [1, 2]}, {"triangles": True}, {"nothing": 1}])  # fmt: skip
def test_what_a_page_sends_is_validated(values):
    with pytest.raises(RecipeError):
        from_page(values)


def test_the_presets_are_those_of_the_paper():
    assert preset_recipe("benchmark", seed=4, triangles=500) == benchmark_recipe(seed=4, triangles=500)
    for name in SHAPE_CLASSES:
        recipe = preset_recipe(name, seed=4, triangles=500)
        assert (shape_class_of(recipe.size), recipe.main_scale, recipe.triangles) == (name, 1.0, 500)
    with pytest.raises(RecipeError, match="expected a class"):
        preset_recipe("../db", seed=0, triangles=500)


def test_every_field_of_a_recipe_has_one_control_within_its_range():
    told = [control for group in controls()["groups"] for control in group["controls"]]
    assert sorted(c["name"] for c in told) == sorted(f.name for f in dataclasses.fields(Recipe))
    parameters = {p.name: p for p in PARAMETERS}
    for control in told:
        if control["kind"] == "slider":
            parameter, value = parameters[control["name"]], getattr(Recipe(), control["name"])
            assert parameter.low <= control["low"] <= value <= control["high"] <= parameter.high
            assert control["scale"] != "log" or control["low"] > 0
    [counts] = [c["counts"] for c in told if c["kind"] == "counts"]
    assert all(Recipe(triangles=count, twist_rate=0.0).triangles == count for count in counts)
    assert max(counts) == MAX_TRIANGLES
    json.dumps(controls(), allow_nan=False)


# ------------------------------------------------------------------------------------------------ turns


def test_stopping_waits_for_work_however_many_places_there_are():
    turns = Turns(64)
    begun = threading.Event()

    def work():
        with turns.enter("a", "studio", 1).working():
            begun.set()
            time.sleep(0.5)

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    assert turns.stop(20.0)
    thread.join()


@pytest.mark.parametrize(("tolerance", "weight"), [(1e-300, 1.0), (-1.0, 1.0), (0.02, 1e308), (0.02, -1.0)])
def test_tolerances_and_weights_beyond_sense_are_refused(tolerance, weight):
    with pytest.raises(LithoformError, match="expected every"):
        target_of((0.3, None, None, None), (tolerance,) * 4, (weight,) * 4)


def test_of_the_requests_of_a_page_the_newest_wins():
    turns = Turns(1)
    first = turns.enter("a", "studio", 1)
    first.require()
    others = [turns.enter("b", "studio", 1), turns.enter("a", "sheet", 1), turns.enter("a", "sheet", 1)]
    newest = turns.enter("a", "studio", 2)
    with pytest.raises(SupersededError):
        first.require()
    with pytest.raises(SupersededError):
        turns.enter("a", "studio", 1)
    for ticket in (newest, *others):
        ticket.require()
    turns.close("a")
    others[0].require()
    for ticket in (newest, others[1]):
        with pytest.raises(SupersededError):
            ticket.require()
    for wrong in (("", "studio", 1), ("a" * 65, "studio", 1), ("../a", "studio", 1), ("a", "nowhere", 1),
                  ("a", "studio", -1), ("a", "studio", True), ("a", "studio", 0.5), (None, "studio", 1)):  # fmt: skip
        with pytest.raises(LithoformError, match="reload"):
            turns.enter(*wrong)


def test_work_that_waits_leaves_when_it_is_overtaken_and_when_the_server_stops():
    turns, left = Turns(1), []
    held = turns.enter("a", "studio", 1)

    def wait(ticket):
        try:
            with ticket.working():
                left.append("worked")
        except SupersededError:
            left.append("overtaken")

    with held.working():
        assert turns.working == 1
        waiting = threading.Thread(target=wait, args=(turns.enter("b", "studio", 1),))
        waiting.start()
        turns.enter("b", "studio", 2)
        waiting.join(5.0)
        assert left == ["overtaken"]
        # Work in progress is waited for, but not for ever.
        assert not turns.stop(patience=0.05)
    assert turns.working == 0
    with pytest.raises(SupersededError):
        turns.enter("c", "studio", 1)
    assert turns.stop(patience=0.05)


def test_only_the_request_that_fits_the_prediction_holds_a_place_for_work(library, monkeypatch):
    space, turns = DesignSpace(library), Turns(2)
    started, go_on, told = threading.Event(), threading.Event(), []
    whole = Surrogate.fit

    def slow(given):
        started.set()
        assert go_on.wait(30.0)
        return whole(given)

    monkeypatch.setattr(Surrogate, "fit", slow)

    def predict(page):
        try:
            told.append(space.predicted(3, turns.enter(page, "space", 1)))
        except SupersededError:
            told.append("overtaken")

    pages = [threading.Thread(target=predict, args=(page,)) for page in "abc"]
    for page in pages:
        page.start()
        started.wait(30.0)
    time.sleep(0.1)
    try:
        assert turns.working == 1
        with turns.enter("d", "studio", 1).working():  # the other place is free
            assert turns.working == 2
        turns.close("c")
        pages[2].join(5.0)
        assert told == ["overtaken"]  # one that waits for the fit leaves at once
    finally:
        go_on.set()
        for page in pages:
            page.join(30.0)
    assert told[1] == told[2] == space.predicted(3)


# ------------------------------------------------------------------------------------------------ percentiles, stones


def test_percentiles_are_those_of_scipy():
    from scipy.stats import percentileofscore

    values = np.random.default_rng(1).integers(0, 40, 200).astype(float)
    found = Percentiles.of("some", {"roundness": np.append(values, np.nan), "solidity": np.full(3, np.nan)})
    for value in (-1.0, 0.0, 7.0, 7.5, 39.0, 50.0):
        expected = percentileofscore(values, value, kind="mean")
        assert found.place("roundness", value) == pytest.approx(expected, abs=1e-12)
    assert found.place("solidity", 0.5) is None


def test_a_packed_stone_is_the_stone_about_the_middle_of_its_box():
    particle = generate(Recipe(triangles=320, seed=3))
    told, vertices, faces = unpack(pack(Stone(particle.mesh, {"name": "é", "value": 0.1})))
    assert told == {"name": "é", "value": 0.1}
    np.testing.assert_array_equal(faces, particle.mesh.faces)
    middle = 0.5 * (particle.mesh.vertices.min(axis=0) + particle.mesh.vertices.max(axis=0))
    np.testing.assert_allclose(vertices, particle.mesh.vertices - middle, atol=1e-6)
    assert check(particle.mesh.with_vertices(vertices.astype(float))).sound


def test_a_mesh_that_is_too_large_for_a_page_is_refused():
    from lithoform.topology import sphere

    with pytest.raises(MeshError, match="at most 200,000 triangles; this mesh has 204,800"):
        pack(Stone(sphere("octahedral", 160), {}))


# ------------------------------------------------------------------------------------------------ design space


def test_designs_are_ranked_by_the_mismatch_and_filtered(space, library):
    mismatch = space.mismatch(TARGET)
    away = (library.descriptors - [0.3, 0.42, 0.9, 0.8]) / 0.02
    np.testing.assert_allclose(mismatch, np.linalg.norm(away, axis=1), rtol=1e-12)
    everything = space.shown(Filter(), TARGET)
    assert everything.tolist() == list(range(len(library)))
    best = space.best(everything, TARGET, 5)
    assert best.tolist() == np.argsort(mismatch)[:5].tolist()
    assert space.classes.tolist() == [shape_class_of(library.recipe(i).size) for i in range(len(library))]
    some = space.shown(Filter(("cube", "blade"), (("roundness", 0.2, 0.5), ("E", -math.inf, 20.0))), TARGET)
    expected = [i for i in range(len(library)) if space.classes[i] in ("cube", "blade")
                and 0.2 <= library.descriptors[i, 0] <= 0.5 and mismatch[i] <= 20.0]  # fmt: skip
    assert some.tolist() == expected
    assert 0 < len(some) < len(library)
    wide = target_of((0.3, 0.42, 0.9, 0.8), (0.1,) * 4, (1.0,) * 4)
    kept = space.shown(Filter(is_within=True), wide)
    assert kept.tolist() == np.flatnonzero((np.abs(away) <= 5.0).all(axis=1)).tolist()
    with pytest.raises(LithoformError, match="expected a quantity"):
        space.column("colour", mismatch)


def test_an_empty_field_asks_nothing_and_a_bad_one_is_told(space):
    alone = target_of((0.3, None, None, None), (0.05,) * 4, (2.0,) * 4)
    np.testing.assert_allclose(space.mismatch(alone), np.abs(space.library.descriptors[:, 0] - 0.3) * 40.0)
    with pytest.raises(LithoformError, match="tolerance of boxiness"):
        target_of((0.3, 0.4, 0.9, 0.8), (0.02, None, 0.02, 0.02), (1.0,) * 4)
    with pytest.raises(LithoformError):
        target_of((None,) * 4, (0.02,) * 4, (1.0,) * 4)


def test_a_prediction_is_near_the_stones_that_it_was_fitted_to(space, library):
    # A sanity check of the columns and their order: a mix-up would be off by 0.3 and more.
    off = [abs(space.predicted(i)["mean"][d] - library.descriptors[i, d]) for i in range(0, 80, 8) for d in range(4)]
    assert np.mean(off) < 0.06
    assert all(value >= 0.0 for value in space.predicted(0)["scatter"])


def decoded(values):
    numbers = np.frombuffer(base64.b64decode(values["bdata"]), "<f4")
    return numbers.reshape([int(n) for n in values["shape"].split(",")]) if "shape" in values else numbers


def test_the_cloud_holds_the_points_and_the_target_where_it_has_a_place(space, library):
    indices, best = np.arange(10, 50), np.array([12, 30])
    figure = cloud(space, ("roundness", "solidity", "E"), TARGET, indices, best, theme="light")
    points, ringed, target, baseline = figure["data"]
    np.testing.assert_allclose(decoded(points["x"]), library.descriptors[10:50, 0], rtol=1e-6)
    np.testing.assert_allclose(decoded(points["z"]), space.mismatch(TARGET)[10:50], rtol=1e-6)
    np.testing.assert_allclose(decoded(points["marker"]["color"]), space.mismatch(TARGET)[10:50], rtol=1e-6)
    assert decoded(points["customdata"])[:, 0].tolist() == indices.tolist()
    assert decoded(points["customdata"]).shape == (40, 1 + 4 + 1 + len(AXES))
    assert decoded(ringed["customdata"])[:, 0].tolist() == [12, 30]
    assert [target[letter][0] for letter in "xyz"] == [0.3, 0.9, 0.0]
    stones = [measure(generate(benchmark_recipe(triangles=TRIANGLES, seed=seed)), "roundness") for seed in range(5)]
    assert baseline["x"][0] == pytest.approx(np.mean([stone["roundness"] for stone in stones]))
    with_parameter = cloud(space, ("roundness", "perturbation", "E"), TARGET, indices, best, theme="dark")
    # Their names are above the points, which may hide the marks.
    named = [[note["text"] for note in shown["layout"]["scene"]["annotations"]] for shown in (figure, with_parameter)]
    assert named == [["target", "baseline"], ["baseline"]]
    assert [trace["name"] for trace in with_parameter["data"]] == ["designs", "best 2", "baseline"]
    assert with_parameter["data"][2]["y"] == [0.3]
    assert cloud(space, FOUR[:3], TARGET, indices[:0], best[:0], theme="dark")["data"][0]["x"]["bdata"] == ""


def test_histograms_and_cumulative_curves_add_up():
    rng = np.random.default_rng(2)
    one = Sample("one", rng.normal(0.5, 0.1, 500), rng.choice(["cube", "blade"], 500))
    two = Sample("two", rng.normal(0.6, 0.1, 300), np.full(300, "cube"))
    bars = distributions([one, two], "roundness")["data"]
    for bar in bars:
        assert decoded(bar["y"]).sum() == pytest.approx(100.0, rel=1e-5)
    assert bars[0]["width"] == bars[1]["width"]
    by_class = distributions([one, two], "roundness", by_class=True)
    assert [(trace["name"], trace["xaxis"]) for trace in by_class["data"]] == [
        ("one", "x"), ("two", "x"), ("one", "x2"),
    ]  # fmt: skip
    [curve] = distributions([one], "roundness", kind="cumulative")["data"]
    x, y = decoded(curve["x"]), decoded(curve["y"])
    ordered = np.sort(one.values).astype(np.float32)
    np.testing.assert_allclose(y, 100.0 * np.searchsorted(ordered, x, "right") / 500, rtol=1e-5)
    assert y[-1] == 100.0
    flat = distributions([Sample("flat", np.full(7, 0.25), np.full(7, "cube"))], "roundness")["data"]
    assert decoded(flat[0]["y"]).sum() == pytest.approx(100.0)
    assert encoded(np.arange(6.0).reshape(2, 3))["shape"] == "2, 3"


# ------------------------------------------------------------------------------------------------ populations


def test_sources_are_known_by_name_and_nothing_else_is_read(folder, tmp_path):
    shelf = Shelf(folder)
    assert list(shelf.sources) == ["first", "second"]
    values, classes = shelf.column("first", "roundness")
    table = Store(folder).table(["roundness", "class"], sources=["first"])
    assert values.tolist() == table["roundness"].to_pylist()
    assert classes.tolist() == table["class"].to_pylist()
    assert shelf.measured(["first", "second"]) == [*FOUR, "volume", "surface_area", "length", "elongation", "flatness"]
    for wrong in ("third", "../db", "/etc", "first.000001.parquet", "first' or 1=1 --", None, 3, ["first"]):
        with pytest.raises(LithoformError, match="expected a source of first, second"):
            shelf.column(wrong, "roundness")
        with pytest.raises(LithoformError, match="expected a source"):
            shelf.stone(wrong, 1)
    with pytest.raises(LithoformError, match="expected a descriptor"):
        shelf.column("first", "file")
    (tmp_path / "a").mkdir()
    with pytest.raises(FileFormatError, match="lithoform database build"):
        Shelf(tmp_path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        Shelf(tmp_path / "nowhere")
    (tmp_path / "b").symlink_to(folder)
    assert list(Shelf(tmp_path).sources) == ["b/first", "b/second"]


def test_a_damaged_database_among_others_is_left_out_and_told(folder, tmp_path, capsys, monkeypatch):
    from lithoform.cli import exploring
    from lithoform.explorer import serving
    from lithoform.explorer.app import make_app

    for name in ("whole", "manifest", "rows"):
        shutil.copytree(folder, tmp_path / name)
    (tmp_path / "manifest" / "database.json").write_text("{")
    batch = next((tmp_path / "rows" / "particles").iterdir())
    batch.write_bytes(batch.read_bytes()[:200])
    shelf = Shelf(tmp_path)
    assert list(shelf.sources) == ["whole/first", "whole/second"]
    assert "is truncated or damaged" in shelf.left_out["manifest"]
    assert "is damaged" in shelf.left_out["rows"]
    assert shelf.percentiles().columns["roundness"].size == 38  # of what is left, each stone once
    panel = str(population_panel(shelf))
    assert "manifest is left out: " in panel
    assert "rows is left out: " in panel
    assert make_app(tmp_path).context.percentiles.label == tmp_path.name
    monkeypatch.setattr(serving, "serve", lambda *_: True)
    assert exploring.explore(tmp_path, port=0) == 0
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(" is left out: ")[0] for line in said] == [
        "lithoform: warning: the database manifest", "lithoform: warning: the database rows"
    ]  # fmt: skip
    # Where nothing is left, the reason is told.
    shutil.rmtree(tmp_path / "whole")
    with pytest.raises(FileFormatError, match="damaged"):
        Shelf(tmp_path)


def test_a_sheet_lists_the_stones_of_a_class_page_by_page(folder):
    shelf = Shelf(folder)
    first = shelf.sheet("first", "all", 0)
    assert (first["total"], first["start"], len(first["stones"])) == (28, 0, PAGE)
    second = shelf.sheet("first", "all", PAGE)
    assert [row["number"] for row in second["stones"]] == [25, 26, 27, 28]
    assert shelf.sheet("first", "all", 10**9)["start"] == PAGE
    plates = shelf.sheet("first", "plate", 0)
    assert {row["class"] for row in plates["stones"]} == {"plate"}
    assert plates["total"] == 7
    for wrong in (("first", "disc", 0), ("first", "all", -1), ("first", "all", "0"), ("first", "x' or '1'='1", 0)):
        with pytest.raises(LithoformError):
            shelf.sheet(*wrong)


@pytest.mark.parametrize("source", ["first", "second"])
def test_a_stone_of_a_database_is_the_one_of_its_row(source, folder):
    stone = Shelf(folder).stone(source, 3)
    row = Store(folder).table(["content_hash", "roundness"], sources=[source]).to_pylist()[2]
    assert stone.told["hash"] == stone.mesh.content_hash == row["content_hash"]
    assert stone.told["descriptors"]["roundness"] == row["roundness"]
    assert generate(from_page(stone.told["recipe"])).mesh.content_hash == row["content_hash"]
    with pytest.raises(LithoformError, match="no particle 99"):
        Shelf(folder).stone(source, 99)


# ------------------------------------------------------------------------------------------------ who may ask


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Origin": "http://localhost", "Sec-Fetch-Site": "same-origin"}, 200),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "http://localhost:9999"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "https://localhost"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Host": "localhost.evil.example"}, 403),
        ({"Host": "127.0.0.1.evil.example:8050"}, 403),
        ({"Host": "evil@127.0.0.1"}, 403),
        ({"Host": "192.168.1.7"}, 403),
        ({"Host": "127.0.0.1:8050"}, 200),
        ({"Host": "[::1]:8050"}, 200),
    ],
)
def test_foreign_requests_start_no_work(headers, status, client):
    for path, body in (("/api/start", {}), ("/api/stone", {"page": "g", "turn": 1, "recipe": {"triangles": 80}})):
        assert client.post(path, json=body, headers=headers).status_code == status
    told = client.post("/_dash-update-component", json={}, headers=headers)
    assert (told.status_code == 403) == (status == 403)
    # A page may be opened by a link from anywhere, but only under this machine's name.
    opened = client.get("/", headers=headers)
    assert opened.status_code == (403 if "Host" in headers and status == 403 else 200)


def test_a_server_that_others_reach_takes_addresses_and_its_own_names():
    from lithoform.explorer.guard import refusal

    def told(host, at):
        return refusal("GET", {"Host": host}, host=at, names=frozenset({"box"}))

    for at in ("0.0.0.0", "192.168.1.7"):
        for host in ("192.168.1.7:8050", "box", "box:80", "localhost"):
            assert told(host, at) == ""
        assert told("evil.example", at) != ""
    assert told("lab.example", "lab.example") == ""
    assert told("box", "127.0.0.1") != ""
    assert told("", "0.0.0.0") != ""


def test_pages_load_from_here_alone_and_files_beside_the_assets_are_not_served(client):
    page = client.get("/")
    policy = page.headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "unsafe-eval" not in policy
    assert "script-src 'self' 'unsafe-inline'" not in policy
    assert (page.headers["X-Frame-Options"], page.headers["X-Content-Type-Options"]) == ("DENY", "nosniff")
    with client.get("/assets/page.js") as asset:
        assert asset.status_code == 200
    for path in ("/assets/../app.py", "/assets/%2e%2e/app.py", "/assets/..%2fapp.py", "/assets//etc/passwd", "/_mcp",
                 "/_dash-component-suites/dash/../../../pyvenv.cfg"):  # fmt: skip
        answer = client.get(path)
        assert answer.status_code >= 400 or b"react-entry-point" in answer.data, path
    assert client.post("/api/stone", data="{}", content_type="text/plain").status_code == 415
    assert client.post("/api/stone", json={"page": "x" * (2 << 20)}).status_code == 413
    assert client.get("/api/stone").status_code != 500


# ------------------------------------------------------------------------------------------------ answers


def test_a_stone_is_answered_with_its_descriptors_and_percentiles(client, folder):
    recipe = benchmark_recipe(triangles=500, seed=MAX_SEED, k=0.25)
    told, vertices, faces = ask(client, "stone", turn=1, recipe=to_page(recipe))
    particle = generate(recipe)
    assert told["hash"] == particle.mesh.content_hash
    assert {name: told["descriptors"][name] for name in FOUR} == dict(measure(particle, "four"))
    assert (len(vertices), len(faces)) == (len(particle.mesh.vertices), 500)
    assert recipe_of_link(told["link"]) == recipe
    all_values = Store(folder).table(["roundness"])["roundness"].to_numpy()
    share = 100.0 * (all_values < told["descriptors"]["roundness"]).mean()
    assert told["percentiles"]["roundness"] == pytest.approx(share)
    assert ask(client, "stone", turn=0, recipe=to_page(recipe)) == {"superseded": True}
    assert "at most 200,000" in ask(client, "stone", turn=2, recipe={"triangles": 204_800})["error"]
    smoothed = to_page(benchmark_recipe(triangles=100_352, smoothing_iterations=499))
    assert "smooths 100,352 triangles in at most 498 steps" in ask(client, "stone", turn=2, recipe=smoothed)["error"]
    ask(client, "close")
    assert ask(client, "stone", turn=3, recipe=to_page(recipe)) == {"superseded": True}


def test_a_point_is_made_with_the_seed_that_is_asked(client, library):
    told, _, faces = ask(client, "point", page="p", turn=1, index=5, seed=77)
    assert told["hash"] == generate(library.recipe(5, seed=77)).mesh.content_hash
    assert len(faces) == TRIANGLES
    assert [told["values"][name] for name in FOUR] == library.descriptors[5].tolist()
    assert len(ask(client, "predict", page="p", turn=1, index=5)["mean"]) == 4
    for wrong in (-1, 80, True, "5", None):
        assert "expected a design" in ask(client, "point", page="p", turn=2, index=wrong)["error"]


def test_what_is_asked_wrongly_is_told_in_a_sentence(client):
    for path, body in (("particle", {"source": "../db", "number": 1, "turn": 1}), ("sheet", {"source": "x"}),
                       ("file", {"recipe": {}, "kind": "../../x", "turn": 1}), ("stone", {"turn": 1, "recipe": 5}),
                       ("stone", {"turn": "1", "recipe": {}}), ("cancel", {"channel": "x", "turn": 1}),
                       ("recipe", {"preset": "benchmark", "seed": "x"})):  # fmt: skip
        told = ask(client, path, page="w", **body)
        assert set(told) == {"error"}
        assert "unexpected" not in told["error"]
        assert "Traceback" not in told["error"]


def test_files_are_the_stone_and_how_it_was_made(client, tmp_path):
    recipe = benchmark_recipe(triangles=500, seed=9)
    content = {}
    for kind in ("stl", "json", "toml", "ply"):
        answer = client.post("/api/file", json={"page": "f", "turn": 1, "recipe": to_page(recipe), "kind": kind})
        content[kind] = answer.data
        (tmp_path / f"stone.{kind}").write_bytes(answer.data)
        assert answer.headers["X-Filename"].endswith(f".{kind}")
    mesh = read_mesh(tmp_path / "stone.stl", unit="mm")
    assert check(mesh).sound
    assert mesh.mass_properties.volume == pytest.approx(generate(recipe).mesh.mass_properties.volume, rel=1e-6)
    assert json.loads(content["json"])["file_sha256"] == hashlib.sha256(content["stl"]).hexdigest()
    assert read_recipe(tmp_path / "stone.toml") == read_recipe(tmp_path / "stone.json") == recipe


def test_the_page_works_without_a_library_and_without_a_database():
    from lithoform.explorer.app import make_app

    app = make_app()
    client = app.server.test_client()
    layout = client.get("/_dash-layout").text
    assert "lithoform design library build" in layout
    assert "lithoform explore DIR" in layout
    assert ask(client, "start")["population"] is None
    assert "no design library" in ask(client, "point", index=0, turn=1)["error"]
    assert "no database" in ask(client, "sheet", source="first")["error"]


def test_without_a_database_percentiles_are_of_the_library_and_say_so(library):
    from lithoform.explorer.app import make_app

    client = make_app(library=library).server.test_client()
    assert ask(client, "start")["population"] == "the design library"
    told, *_ = ask(client, "stone", turn=1, recipe=to_page(benchmark_recipe(triangles=500)))
    below = (library.descriptors[:, 0] < told["descriptors"]["roundness"]).mean()
    assert told["percentiles"]["roundness"] == pytest.approx(100.0 * below)


# ------------------------------------------------------------------------------------------------ the server

_EXPLORE = "import sys; from lithoform.cli.exploring import explore; sys.exit(explore(port=0))"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_server_ends_cleanly(number):
    with subprocess.Popen(
        [sys.executable, "-c", _EXPLORE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as server:
        told = server.stdout.readline()
        assert told.startswith("The explorer is at http://127.0.0.1:")
        port = int(told.split(":")[2].split("/")[0])
        # Work in progress does not keep it.
        body = json.dumps({"page": "s", "turn": 1, "recipe": {"triangles": 200_000}}).encode()
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.sendall(b"POST /api/stone HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
                         b"Content-Length: " + str(len(body)).encode() + b"\r\n\r\n" + body)  # fmt: skip
            time.sleep(0.1)
            server.send_signal(number)
            rest, errors = server.communicate(timeout=30)
    assert (server.returncode, rest, errors) == (0, "The explorer has ended.\n", "")


def test_a_port_in_use_and_a_wrong_host_are_told():
    from lithoform.explorer.serving import bind

    with bind("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=rf"port {port} of 127\.0\.0\.1 is in use; give another one with --port"):
            bind("127.0.0.1", port)
    with pytest.raises(OutputError, match="expected a port"):
        bind("127.0.0.1", 70_000)
    with pytest.raises(OutputError, match="--host"):
        bind("no such host", 0)


@pytest.mark.parametrize("named", [None, "elsewhere"])
def test_the_checks_of_a_change_keep_the_screenshots(named, tmp_path):
    (tmp_path / "make").write_text('#!/bin/sh\necho "$* $LITHOFORM_ARTEFACTS"\n')
    (tmp_path / "make").chmod(0o755)
    outer = {name: value for name, value in os.environ.items() if name != "LITHOFORM_ARTEFACTS"}
    given = {} if named is None else {"LITHOFORM_ARTEFACTS": named}
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    script = ROOT / ".ci" / "run"
    if not script.exists():
        pytest.skip("an archive of the sources without .ci")
    said = subprocess.run(
        ["bash", script], env={**outer, **given, "PATH": path}, cwd="/", check=True, capture_output=True, text=True
    ).stdout
    assert said == f"test {named or ROOT / 'build' / 'artefacts'}\n"
    assert "build/" in (ROOT / ".gitignore").read_text().split()
