"""Builds: what they make, that they may be killed at any moment, and that memory does not grow with the count."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
import tracemalloc
from collections import deque
from pathlib import Path

import pytest
from work_of_workers import die, double, kill_once

from lithoform import RecipeError
from lithoform.database import building
from lithoform.database.building import Measures, batch_size, build
from lithoform.database.engine import ClusterError, spread
from lithoform.database.schema import recipe_of
from lithoform.database.store import Store
from lithoform.planning import Plan
from lithoform.population_recipe import PopulationRecipe, Spread
from lithoform.presets import shape_class_of

SMALL = ("--triangles", "128", "--descriptors", "boxiness,solidity", "--device", "cpu")


def plan(count: int, seed: int = 1, **base) -> Plan:
    return Plan(count=count, seed=seed, preset="database", shape_class="mixed", base={"triangles": 128, **base})


def digest(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def test_batches_are_few_for_many_particles_and_small_for_few():
    assert [batch_size(n, keep_meshes=False) for n in (1, 600, 20_000, 1_000_000)] == [25, 25, 100, 1000]
    assert batch_size(1_000_000, keep_meshes=True) == 50


def test_killed_at_ten_moments_and_resumed_it_ends_with_the_same_bytes(tmp_path):
    command = [sys.executable, "-m", "lithoform", "database", "build"]
    options = ["--per-class", "120", "--keep-meshes", "--workers", "0", "--seed", "4", *SMALL]
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    started = time.perf_counter()
    subprocess.run([*command, str(whole), *options], check=True, capture_output=True)
    span = time.perf_counter() - started
    moments, stages = random.Random(5), set()
    for _ in range(10):
        run = subprocess.Popen([*command, str(torn), *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            run.wait(timeout=moments.uniform(0.2, 0.6) * span)
        except subprocess.TimeoutExpired:
            run.kill()
            run.wait()
        stages.add(len([*torn.rglob("particles/*.parquet")]))
    done = subprocess.run([*command, str(torn), *options, "--json"], check=True, capture_output=True, text=True)
    assert json.loads(done.stdout)["particles"] == 480
    assert len(stages) > 1  # the kills met the build at work
    assert digest(torn) == digest(whole)


@pytest.mark.parametrize("workers", ["0", "2"])
def test_interrupted_it_says_how_far_it_got_and_goes_on(tmp_path, workers):
    options = ["--per-class", "60", "--workers", workers, *SMALL]
    command = [sys.executable, "-m", "lithoform", "database", "build", str(tmp_path / "db"), *options]
    # Python leaves SIGINT ignored where it was, as under a shell's &.
    run = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    while not [*(tmp_path / "db").rglob("particles/*.parquet")]:
        assert run.poll() is None
        time.sleep(0.01)
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to the workers too
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert re.fullmatch(r"lithoform: interrupted; \S+ holds \d+ of 240 particles: the same command goes on\.\n", err)
    subprocess.run(command, check=True, capture_output=True)
    assert Store(tmp_path / "db").missing() == {}


def test_threads_and_processes_make_the_same_bytes(tmp_path):
    for name, workers in (("threads", 0), ("processes", 2)):
        numbers = [*build(tmp_path / name, plan(60), Measures(("boxiness", "solidity")), workers=workers, device="cpu")]
        assert sorted(numbers) == [*range(1, 61)]
    assert digest(tmp_path / "threads") == digest(tmp_path / "processes")


def test_a_running_cluster_does_the_work_and_a_worker_that_is_killed_loses_nothing(tmp_path):
    from distributed import LocalCluster

    plain = tmp_path / "plain"
    assert len([*build(plain, plan(300), Measures(("boxiness", "solidity")), workers=0, device="cpu")]) == 300
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        victim = next(iter(cluster.workers.values())).pid
        numbers = build(
            tmp_path / "cluster", plan(300), Measures(("boxiness", "solidity")), scheduler=cluster.scheduler_address
        )
        first = next(numbers)
        os.kill(victim, signal.SIGKILL)
        assert sorted([first, *numbers]) == [*range(1, 301)]
    assert digest(tmp_path / "cluster") == digest(plain)


def test_a_job_that_a_dead_worker_had_is_done_again(tmp_path):
    jobs = [(n, str(tmp_path / "mark")) for n in range(8)]
    assert sorted(spread(kill_once, jobs, workers=2)) == [*range(8)]
    assert (tmp_path / "mark").exists()


def test_a_batch_that_kills_every_worker_is_told():
    with pytest.raises(ClusterError, match="workers died 4 times of the same batch"):
        next(spread(die, [1], workers=2))


def test_workers_without_the_program_are_told_and_not_waited_for(monkeypatch):
    def absent(_: str) -> str:
        raise ModuleNotFoundError

    monkeypatch.setattr("lithoform.database.engine._version_of", absent)
    with pytest.raises(ClusterError, match="has no lithoform, and this is"):
        next(spread(double, [1], workers=1))


def test_a_cluster_that_has_lost_its_workers_is_told(monkeypatch):
    from distributed import LocalCluster

    with LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        address = cluster.scheduler_address
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard"]
        with subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_worker", address, *options],
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parent)},
        ) as worker:
            stream = spread(double, iter(int, 1), scheduler=address)
            next(stream)
            monkeypatch.setattr("lithoform.database.engine._PATIENCE", 2.0)
            worker.kill()
            with pytest.raises(ClusterError, match="no workers any more"):
                deque(stream, maxlen=0)


@pytest.mark.parametrize("workers", [0, 2])
def test_jobs_are_taken_as_they_are_needed(workers):
    taken = itertools.count()
    stream = spread(double, taken, workers=workers)
    assert next(stream) in {2 * x for x in range(8)}
    stream.close()
    assert next(taken) <= 12


def test_what_the_workers_are_asked_for_is_checked(tmp_path, monkeypatch):
    with pytest.raises(RecipeError, match="--workers of at least 0"):
        spread(double, [1], workers=-1)
    with pytest.raises(RecipeError, match="--workers of at least 0"):
        next(build(tmp_path / "db", plan(4), workers=-1))
    assert not (tmp_path / "db").exists()  # refused before anything is made
    with pytest.raises(RecipeError, match="not with --scheduler"):
        spread(double, [1], workers=2, scheduler="tcp://127.0.0.1:1")
    monkeypatch.setattr("lithoform.database.engine._PATIENCE", 1.0)
    with pytest.raises(ClusterError, match="cannot be reached"):
        next(spread(double, [1], scheduler="tcp://127.0.0.1:1"))
    with pytest.raises(ClusterError, match="cannot be reached"):
        next(spread(double, [1], scheduler="nonsense://x"))
    monkeypatch.setattr("lithoform.database.engine.has_dask", lambda: False)
    assert [*spread(double, [1, 2], workers=2)] == [2, 4]
    with pytest.raises(ClusterError, match=r"lithoform\[cluster\]"):
        spread(double, [1], scheduler="tcp://127.0.0.1:1")


def test_workers_of_another_version_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "program_version", lambda: "0.0.9")
    with pytest.raises(ClusterError, match=r"the workers run lithoform 0\.0\.9"):
        next(build(tmp_path / "db", plan(4), Measures(("boxiness", "solidity")), workers=0))


def test_a_recipe_without_a_sound_mesh_has_a_row_with_the_reason(tmp_path, monkeypatch):
    from lithoform import UnsoundMeshError

    real = building.generate

    def fails(recipe, **options):
        if recipe.seed == plan(30).recipe(7).seed:
            raise UnsoundMeshError("no sound mesh was found.  The recipe: ...", recipe=recipe)
        if recipe.seed == plan(30).recipe(8).seed:
            raise ZeroDivisionError("by nothing")
        return real(recipe, **options)

    def all_fail(*_, **__):
        raise UnsoundMeshError("one of them")

    monkeypatch.setattr(building, "generate", fails)
    monkeypatch.setattr(building, "generate_many", all_fail)
    assert len([*build(tmp_path / "db", plan(30), Measures(("boxiness", "solidity")), workers=0, device="cpu")]) == 30
    rows = Store(tmp_path / "db").table().to_pylist()
    told = {row["number"]: row["error"] for row in rows if row["error"]}
    assert told == {7: "no sound mesh was found.", 8: "it failed unexpectedly (ZeroDivisionError: by nothing)."}
    assert rows[6]["solidity"] is None
    assert rows[6]["perturbation"] == 0.3
    assert rows[5]["solidity"] > 0


def test_a_million_recipes_are_planned_one_by_one(tmp_path, monkeypatch):
    calls = []

    def stub(job):
        _, _, source, batch = job
        calls.append(batch)
        rows, meshes = building.particle_schema().empty_table(), None
        return batch, source.lithoform, rows, meshes

    monkeypatch.setattr(building, "make_batch", stub)
    monkeypatch.setattr(Store, "write", lambda *_: None)

    def peak(count: int) -> int:
        tracemalloc.start()
        numbers = build(tmp_path / str(count), plan(count), Measures(("boxiness", "solidity")), workers=0, device="cpu")
        assert sum(1 for _ in numbers) == count
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(1000)  # what is loaded once
    few, many = peak(10_000), peak(1_000_000)
    assert len(calls) > 1000
    # A number for each of the 1,000 batches, but nothing for each particle.
    assert many < few + 200_000


def test_command_line(run):
    status, out, err = run("database", "build", "db", "--per-class", "2", "--workers", "0", "--seed", "0", *SMALL)
    assert (status, err) == (0, "")
    assert out.startswith("db: 8 particles of source generated")
    status, out, _ = run("database", "query", "db", "select class, count(*) as n from particles group by 1 order by 1")
    assert status == 0
    assert out.split() == "class n blade 2 column 2 cube 2 plate 2".split()
    status, out, _ = run("database", "query", "db", "--json", "select number, seed from particles where number = 3")
    assert json.loads(out) == [{"number": 3, "seed": plan(8, seed=0).recipe(3).seed}]
    status, out, _ = run("database", "query", "db", "select * from particles", "--csv", "all.csv")
    assert "8 rows: all.csv" in out
    assert len(Path("all.csv").read_text().splitlines()) == 9


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--per-class", "0"], "--per-class of at least 1"),
        (["--per-class", "5", "--count", "3"], "without --count"),
        (["--per-class", "5", "--class", "cube"], "without --class"),
        (["--descriptors", "roundnes"], "Did you mean roundness"),
        (["--box", "round"], "box"),
        (["--scale", "-1"], "scale"),
        (["--workers", "-1"], "--workers of at least 0"),
        (["--workers", "1", "--scheduler", "tcp://127.0.0.1:1"], "not with --scheduler"),
        (["--source", "a b"], "letters, digits"),
        (["--triangles", "700"], "nearest counts"),
        (["--device", "tpu"], "tpu"),
        (["--seed", "-1"], "the seed must be"),
    ],
)
def test_wrong_requests_are_refused_before_any_work(run, arguments, said):
    status, _, err = run("database", "build", "db", *arguments)
    assert status == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not [*Path().rglob("*.parquet")]


def test_a_population_recipe_is_built_and_generated(run):
    spread = Spread("perturbation", "linear", 0.2, 0.05, 0.1, 0.3)
    recipe = PopulationRecipe(length=(0.01, 0.02), elongation=(0.5, 0.9), flatness=(0.4, 0.8), spreads=(spread,))
    Path("pop.toml").write_text(recipe.to_toml())
    options = ["--recipe", "pop.toml", "--count", "30", "--seed", "7"]
    status, _, err = run("database", "build", "db", *options, "--workers", "0", *SMALL)
    assert (status, err) == (0, "")
    for row in Store("db").table().to_pylist():
        expected = recipe.recipe(row["number"], 7).replace(triangles=128)
        assert recipe_of(row) == expected
        assert row["class"] == shape_class_of(expected.size)
    status, _, _ = run("generate", "out", "--recipe", "pop.toml", "--count", "2", "--seed", "7", "--triangles", "128")
    assert status == 0
    sidecar = json.loads(Path("out/000002.json").read_text())
    assert sidecar["recipe"]["seed"] == recipe.recipe(2, 7).seed
    for more, said in (
        (["--class", "cube"], "leave out --class"),
        (["--size", "3,2,1"], "leave out --class"),
        (["--set", "L=3"], "leave out --class"),
        (["--preset", "database"], "give one of them"),
    ):
        status, _, err = run("database", "build", "other", *options, *more)
        assert status == 2
        assert said in err
    status, _, err = run("database", "build", "other", "--recipe", "pop.toml", "--per-class", "3")
    assert status == 2
    assert "--count in place of --per-class" in err
