"""The gyratory compactor: its mould, its platen, its fit, its stages, and what stops it."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lithoform import dem
from lithoform.cli import main
from lithoform.compaction.compactor import LOOKS, STAGES, Machine, compact
from lithoform.compaction.fitting import fit_power_law
from lithoform.compaction.mould import Gyration
from lithoform.compaction.protocol import PRESETS, find_preset
from lithoform.compaction.request import Request
from lithoform.compaction.run import run_compaction
from lithoform.compaction.specimen import LOOSE, Plan, Specimen, make_specimen
from lithoform.compaction.stages import FLOOR, MOULD, PLATEN, Record, look
from lithoform.database.store import Store
from lithoform.errors import LithoformError, OutputError, RecipeError, SampleError, SceneError
from lithoform.gradation.curves import find_gradation

SOFT = dem.TABLE_10.softened(0.01)
# As stiff under its pressure as stones at E/10 under 600 kPa, in a third of the steps.
SMALL = {"count": 24, "min_size": 9.5e-3, "mould": 0.062, "pressure": 60e3, "gyrations": 3, "rate_factor": 20.0,
         "stiffness_factor": 0.01}  # fmt: skip


@pytest.fixture(scope="module")
def population(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("population") / "stones"
    command = ["database", "build", str(folder), "--count", "24", "--triangles", "980", "--descriptors", "standard",
               "sieve_size"]  # fmt: skip
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 0
    return folder


@pytest.fixture(scope="module")
def done(population, tmp_path_factory):
    """A small specimen that was compacted, and its folder."""
    out = tmp_path_factory.mktemp("compaction") / "out"
    results = run_compaction(Request(population=population, **SMALL), out, threads=1)
    return out, results


def looks_of(out: Path, stage: str) -> list[dict[str, float]]:
    return [json.loads(line) for line in (out / f"{stage}.jsonl").read_text().splitlines()]


def machine_of(population: Path) -> Machine:
    """The compactor of that specimen."""
    request = Request(population=population, **SMALL)
    plan = Plan(gradation=find_gradation("AC-13"), min_size=9.5e-3, count=24, mould=0.062, stiffness_factor=0.01)
    specimen = make_specimen(Store(population), plan, request.protocol)
    return Machine(specimen=specimen, protocol=request.protocol, rate_factor=20.0, seed=0)


# ------------------------------------------------------------------------------------------ the mould


class TestMould:
    GYRATION = Gyration(angle=math.radians(1.16), frequency=20.0, apex=0.03, ramp=0.0125)

    def test_the_axis_is_tilted_then_carried_round(self):
        g = self.GYRATION
        assert g.axis(0.0).tolist() == [0.0, 0.0, 1.0]
        assert g.axis(g.ramp / 2) == pytest.approx([math.sin(g.angle / 2), 0.0, math.cos(g.angle / 2)])
        for turns in (0.0, 0.25, 0.5, 1.75):
            axis = g.axis(g.ramp + turns / g.frequency)
            assert math.degrees(math.acos(axis[2])) == pytest.approx(1.16)
            assert math.atan2(axis[1], axis[0]) % (2.0 * math.pi) == pytest.approx(2.0 * math.pi * (turns % 1.0))
            assert g.gyrations(g.ramp + turns / g.frequency) == pytest.approx(turns)

    def test_the_engine_moves_the_mould_as_the_closed_form_says(self):
        """Axis, and the point of the axis at the apex, which stays; through the tilt and two gyrations."""
        g, dt = self.GYRATION, 2.5e-5
        ball = dem.Shape.sphere(0.02)
        mould = dem.Cylinder(radius=0.05)
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0], walls=(mould,), gravity=(0, 0, 0))
        state = dem.State.at_rest(model, [[0.0, 0.0, 0.03]])
        steps = round(g.ramp / dt)
        state = dem.simulate(model.with_motion(0, g.tilting), state, until=steps * dt, dt=dt).state
        assert state.wall_direction[0] == pytest.approx(g.axis(g.ramp), abs=1e-12)
        state = dem.simulate(model.with_motion(0, g.precessing), state, until=g.ramp + 2.3 / g.frequency, dt=dt).state
        assert state.wall_direction[0] == pytest.approx(g.axis(state.time), abs=1e-10)
        off = np.array(g.pivot) - state.wall_point[0]
        axis = state.wall_direction[0]
        assert np.linalg.norm(off - axis * (off @ axis)) < 1e-12

    def test_a_point_of_the_wall_moves_in_a_level_circle_of_the_tilt(self):
        """At a height h over the apex the centre of the mould is h tan(angle) off the vertical: the shear strain."""
        g = self.GYRATION
        for turns in np.linspace(0.0, 1.0, 9):
            axis = g.axis(g.ramp + turns / g.frequency)
            at = np.array(g.pivot) + axis * (0.04 / axis[2])
            assert at[2] == pytest.approx(0.07)
            assert math.hypot(at[0], at[1]) == pytest.approx(0.04 * math.tan(g.angle))
        assert PRESETS["aashto-t312"].shear == pytest.approx(math.tan(math.radians(1.16)))

    def test_presets_are_those_of_the_standards(self):
        table = {name: (p.pressure, p.angle, p.rate, p.diameter) for name, p in PRESETS.items()}
        assert table == {
            "paper": (600e3, 0.82, 30.0, 0.15),
            "en12697-31": (600e3, 0.82, 30.0, 0.15),
            "aashto-t312": (600e3, 1.16, 30.0, 0.15),
        }
        assert "0.82 deg external and internal" in PRESETS["paper"].angles()
        with pytest.raises(RecipeError, match="expected a preset of paper, en12697-31, aashto-t312; got 'marshall'"):
            find_preset("marshall")


# ------------------------------------------------------------------------------------------ the fit


class TestFit:
    def test_an_exact_curve_is_recovered(self):
        g = np.arange(1, 34)
        fit = fit_power_law(g, 0.0703 * g**-0.0289)
        assert (fit.a, fit.b, fit.r_squared) == pytest.approx((0.0703, -0.0289, 1.0), rel=1e-12)
        assert fit(np.array([1.0, 33.8])) == pytest.approx([0.0703, 0.0635], rel=1e-4)
        assert fit.text() == "H = 70.3000 G^-0.0289, R2 = 1.0000"

    def test_gyrations_before_the_first_do_not_count(self):
        g = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.0])
        h = np.where(g < 1.0, 1.0, 0.07 * np.maximum(g, 1.0) ** -0.03)
        assert fit_power_law(g, h).b == pytest.approx(-0.03)

    @settings(deadline=None, max_examples=20)
    @given(st.floats(0.03, 0.2), st.floats(-0.08, -0.01), st.integers(0, 2**32 - 1))
    def test_noise_leaves_the_truth_in_reach(self, a, b, seed):
        """With noise of 0.1 % the estimates are unbiased: within five standard errors."""
        g = np.arange(1, 101)
        noisy = a * g**b * np.exp(1e-3 * np.random.default_rng(seed).standard_normal(100))
        fit = fit_power_law(g, noisy)
        spread = math.sqrt(((np.log(g) - np.log(g).mean()) ** 2).sum())
        assert abs(fit.b - b) < 5e-3 / spread
        assert abs(math.log(fit.a / a)) < 5e-3 * math.sqrt(0.01 + (np.log(g).mean() / spread) ** 2)

    def test_intervals_hold_the_truth_as_often_as_they_say(self):
        g, rng, held = np.arange(1, 34), np.random.default_rng(1), np.zeros(2)
        for _ in range(400):
            fit = fit_power_law(g, 0.07 * g**-0.029 * np.exp(1e-3 * rng.standard_normal(33)))
            held += [fit.a_interval[0] < 0.07 < fit.a_interval[1], fit.b_interval[0] < -0.029 < fit.b_interval[1]]
        # Binomial: 380 expected of 400, standard deviation 4.4.
        assert (np.abs(held - 380) < 18).all()

    @pytest.mark.parametrize(("g", "h", "told"), [
        ([1, 2], [1.0, 1.0], "at least three gyrations"), ([1, 2, 3], [1.0, -1.0, 1.0], "positive, finite heights"),
        ([1, 2, 3], [1.0, 1.0], "a height for each"), ([1, 2, np.nan], [1.0, 1.0, 1.0], "finite"),
        ([2, 2, 2], [1.0, 1.0, 1.0], "got 1"),
    ])  # fmt: skip
    def test_what_cannot_be_fitted_is_told(self, g, h, told):
        with pytest.raises(SampleError, match=told):
            fit_power_law(g, h)


# ------------------------------------------------------------------------------------------ the specimen


class TestSpecimen:
    def test_a_known_filling_has_its_packing_density(self):
        """Eq. 27 at the platen's height: 8 balls of 10 mm in a mould 40 mm wide and 25 mm high."""
        ball = dem.Shape.sphere(0.005)
        walls = (dem.Plane(point=(0, 0, 0), normal=(0, 0, 1)), dem.Cylinder(radius=0.02),
                 dem.Plane(point=(0, 0, 0.025), normal=(0, 0, -1)))  # fmt: skip
        model = dem.Model(shapes=(ball,), materials=(SOFT,), shape=[0] * 8, walls=walls)
        places = [[0.01 * x, 0.01 * y, z] for z in (0.006, 0.018) for x, y in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        row = look(model, dem.State.at_rest(model, places), 0.0, 0.04)
        exact = 8 * math.pi / 6 * 0.01**3 / (math.pi / 4 * 0.04**2 * 0.025)
        assert row["packing_density"] == pytest.approx(exact, rel=1e-12)
        assert row["height"] == 0.025

    def test_a_count_gives_a_mould_of_the_protocols_form(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=9.5e-3, count=60)
        specimen = make_specimen(Store(population), plan, PRESETS["paper"])
        # At the loose packing density it is 70/150 as high as wide.
        height = specimen.solid / (LOOSE * specimen.area)
        assert height / specimen.diameter == pytest.approx(70.0 / 150.0, rel=1e-9)
        assert specimen.height_scale == pytest.approx(specimen.diameter / 0.15, rel=1e-6)
        assert "instead of 150 mm" in specimen.scaled(PRESETS["paper"])[0]
        assert specimen.model.count == 60
        assert (specimen.model.mass.sum(), specimen.solid) == pytest.approx(
            (specimen.grading.mass, specimen.grading.mass / 2650.0), rel=1e-9
        )

    def test_a_mould_without_a_count_is_filled(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=9.5e-3, mould=0.08)
        specimen = make_specimen(Store(population), plan, PRESETS["paper"])
        assert specimen.density(0.07 * 80.0 / 150.0) == pytest.approx(LOOSE, rel=0.02)

    def test_seeds_take_other_stones_and_the_same_seed_the_same(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=9.5e-3, count=60)
        first, again = (make_specimen(Store(population), plan, PRESETS["paper"]) for _ in range(2))
        assert first.model.fingerprint == again.model.fingerprint
        other = make_specimen(Store(population), replace(plan, seed=1), PRESETS["paper"])
        assert other.model.fingerprint != first.model.fingerprint

    def test_a_mould_too_narrow_for_its_stones_is_refused(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=4.75e-3, count=60)
        with pytest.raises(SceneError, match=r"a mould at least 4 times as wide .* take more stones \(--count\)"):
            make_specimen(Store(population), plan, PRESETS["paper"])

    def test_a_gradation_that_so_few_stones_cannot_fill_is_refused(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=2.36e-3, count=10, mould=0.15)
        with pytest.raises(RecipeError, match="the gradation cannot be filled"):
            make_specimen(Store(population), plan, PRESETS["paper"])

    def test_a_population_too_small_for_the_mould_is_refused(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=4.75e-3, mould=0.15, select="number <= 3")
        with pytest.raises(SampleError, match=r"expected at least \d+ different particles for \d+ stones"):
            make_specimen(Store(population), plan, PRESETS["paper"])

    def test_no_stone_chosen_is_told(self, population):
        plan = Plan(gradation=find_gradation("AC-13"), min_size=9.5e-3, count=60, select="number < 0")
        with pytest.raises(SampleError, match="none is chosen"):
            make_specimen(Store(population), plan, PRESETS["paper"])


# ------------------------------------------------------------------------------------------ the compactor


class TestCompactor:
    def test_the_platen_holds_its_pressure_within_a_hundredth(self, done):
        out, results = done
        pressure = results["pressure"]
        assert pressure["mean"] == pytest.approx(60e3, rel=0.01)
        rows = looks_of(out, "gyration")
        # Of each gyration too.
        for k in range(3):
            mine = [row["pressure"] for row in rows if k <= row["gyration"] < k + 1]
            assert len(mine) == LOOKS
            assert np.mean(mine) == pytest.approx(60e3, rel=0.01)

    def test_the_specimen_gets_denser(self, done):
        _, results = done
        series = results["series"]
        assert series["gyration"] == [0.0, 1.0, 2.0, 3.0]
        heights = np.array(series["height"])
        assert (np.diff(heights) < 0.0).all()
        solid = np.array(series["packing_density"]) * heights
        assert solid == pytest.approx(np.full(4, solid[0]), rel=1e-12)
        assert results["fit"]["B"] < 0.0

    def test_platens_and_mould_carry_what_is_asked_of_them(self, done):
        """The floor carries the platen's force less what the mould takes, and the weight, on the average."""
        out, _ = done
        rows = looks_of(out, "pressing")
        last = rows[-1]
        assert last["pressure"] == pytest.approx(60e3, rel=0.02)
        assert 0.3 < last["floor_pressure"] / last["pressure"] <= 1.1
        assert last["lateral_pressure"] > 0.0

    def test_the_mould_ends_where_the_closed_form_says(self, done, population):
        out, results = done
        found = compact(machine_of(population), out)
        assert found.series["height"].tolist() == results["series"]["height"]
        state = found.state
        axis = state.wall_direction[MOULD]
        assert math.degrees(math.acos(axis[2])) == pytest.approx(0.82, abs=1e-9)
        assert math.atan2(axis[1], axis[0]) == pytest.approx(0.0, abs=1e-6)
        for wall in (FLOOR, PLATEN):
            assert np.abs(state.wall_direction[wall, :2]).max() == 0.0
        assert state.wall_point[FLOOR].tolist() == [0.0, 0.0, 0.0]
        assert state.wall_point[PLATEN, 2] == results["compacted"]["height"]

    def test_a_height_that_is_reached_ends_the_run(self, population, tmp_path, done, monkeypatch):
        out, results = done
        machine = machine_of(population)
        # Between the first and the second gyration; what was before is there.
        heights = results["series"]["height"]
        target = 0.5 * (heights[1] + heights[2])
        # So few stones stay above the loose height, below which a protocol's must lie.
        monkeypatch.setattr(Machine, "target", property(lambda _: target))
        for stage in ("deposition", "seating", "pressing", "tilting"):
            for kind in ("jsonl", "checkpoint"):
                shutil.copy(out / f"{stage}.{kind}", tmp_path / f"{stage}.{kind}")
        again = compact(machine, tmp_path, threads=1)
        last = again.looks["gyration"][-1]
        assert again.reached
        assert 1.0 < last["gyration"] <= 2.0
        assert last["height"] <= target
        assert again.series["height"][:2].tolist() == heights[:2]
        assert again.fit is None
        assert any("too few to fit" in note for note in again.notes)

    def test_a_height_that_is_not_reached_is_told_and_all_is_kept(self, done):
        out, results = done
        assert not results["height_reached"]
        assert any("was not reached in 3 gyrations" in note for note in results["notes"])
        for name in ("compaction.json", "table.parquet", "blocks.csv", "gyration.checkpoint"):
            assert (out / name).is_file()

    def test_killed_in_every_stage_and_resumed_it_is_the_same(self, done, population, tmp_path):
        out, results = done
        # What a run leaves that has begun.
        numbers = json.loads((out / "compaction.json").read_text())
        (tmp_path / "compaction.json").write_text(json.dumps({**numbers, "finished": False}))
        machine = machine_of(population)
        for stage in STAGES:
            looks = []

            def killed(name: str, *_: object, stage: str = stage, looks: list[str] = looks) -> None:
                looks.append(name)
                if looks.count(stage) == 3:
                    raise KeyboardInterrupt

            with pytest.raises(KeyboardInterrupt):
                compact(machine, tmp_path, on_look=killed, threads=1)
            assert looks[-1] == stage
        again = run_compaction(Request(population=population, **SMALL), tmp_path, threads=1, resume=True)
        assert again["series"] == results["series"]
        assert (tmp_path / "blocks.csv").read_bytes() == (out / "blocks.csv").read_bytes()

    def test_a_damaged_record_is_told(self, done, tmp_path):
        out, _ = done
        record = Record(tmp_path / "pressing")
        shutil.copy(out / "pressing.checkpoint", record.checkpoint)
        record.file.write_text("{\n")
        with pytest.raises((OutputError, SceneError)):
            record.resume(dem.Model(shapes=(dem.Shape.sphere(1e-3),), materials=(SOFT,), shape=[0]), None, 1)

    def test_a_record_with_holes_is_mended(self, done, population, tmp_path):
        """A look that is missing makes its stage anew; the last one is made again from the state of the checkpoint."""
        out, results = done
        shutil.copytree(out, tmp_path / "out")
        out, first = tmp_path / "out", out
        numbers = json.loads((out / "compaction.json").read_text())
        (out / "compaction.json").write_text(json.dumps({**numbers, "finished": False}))
        tilting, gyration = out / "tilting.jsonl", out / "gyration.jsonl"
        lines = tilting.read_bytes().splitlines(keepends=True)
        tilting.write_bytes(b"".join(lines[:2] + lines[3:]))
        gyration.write_bytes(b"".join(gyration.read_bytes().splitlines(keepends=True)[:-1]))
        again = run_compaction(Request(population=population, **SMALL), out, threads=1, resume=True)
        assert again["series"] == results["series"]
        for stage in STAGES:
            assert (out / f"{stage}.jsonl").read_bytes() == (first / f"{stage}.jsonl").read_bytes()

    def test_a_run_goes_on_to_more_gyrations(self, done, population, tmp_path):
        first, results = done
        shutil.copytree(first, tmp_path / "out")
        out = tmp_path / "out"
        for kind in ("jsonl", "checkpoint"):
            (out / f"gyration.{kind}").unlink()
        numbers = json.loads((out / "compaction.json").read_text())
        numbers["settings"]["gyrations"] = 1
        (out / "compaction.json").write_text(json.dumps({**numbers, "finished": False}))
        short = run_compaction(Request(population=population, **{**SMALL, "gyrations": 1}), out, threads=1, resume=True)
        assert short["series"]["gyration"] == [0.0, 1.0]
        longer = run_compaction(Request(population=population, **SMALL), out, threads=1, resume=True)
        assert longer["series"] == results["series"]
        assert (out / "blocks.csv").read_bytes() == (first / "blocks.csv").read_bytes()
        for fewer in ({"gyrations": 2}, {"to_height": 0.065}, {"seed": 5}):
            with pytest.raises(OutputError, match="with other settings"):
                run_compaction(Request(population=population, **{**SMALL, **fewer}), out, threads=1, resume=True)

    def test_stiffer_stones_begin_from_the_bed_of_softer_ones(self, done, population, tmp_path):
        first, results = done
        stiffer = {**SMALL, "stiffness_factor": 0.02, "bed_stiffness_factor": 0.01, "gyrations": 1}
        found = run_compaction(Request(population=population, **stiffer), tmp_path, threads=1)
        for kind in ("jsonl", "checkpoint"):
            assert (tmp_path / f"deposition.{kind}").read_bytes() == (first / f"deposition.{kind}").read_bytes()
        assert found["time_step"] == pytest.approx(results["time_step"] / math.sqrt(2.0))
        start, former = looks_of(tmp_path, "seating")[0], looks_of(first, "seating")[0]
        assert (start["step"], start["time"], start["height"]) == (former["step"], former["time"], former["height"])
        # The same stones in the same places: the press moves them a little otherwise.
        assert found["loose"]["packing_density"] == pytest.approx(results["loose"]["packing_density"], abs=0.02)
        assert found["loose"]["packing_density"] != results["loose"]["packing_density"]

    def test_files_that_were_about_to_be_removed_are_not_gone_on_with(self, done, population, tmp_path, monkeypatch):
        """Stopped while it clears the folder, a run that is resumed begins: nothing of the former one is in it."""
        shutil.copytree(done[0], tmp_path / "out")
        out = tmp_path / "out"
        other = Request(population=population, **{**SMALL, "pressure": 30e3, "gyrations": 1})
        unlink = Path.unlink

        def stopped(path: Path, missing_ok: bool = False) -> None:
            if path.name == "gyration.jsonl":
                raise KeyboardInterrupt
            unlink(path, missing_ok=missing_ok)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "unlink", stopped)
            with pytest.raises(KeyboardInterrupt):
                run_compaction(other, out, threads=1, overwrite=True)
        assert (out / "pressing.checkpoint").exists()
        begun = []

        def compacted(machine, folder, **_):
            begun.extend(path.name for path in folder.iterdir() if path.suffix in (".checkpoint", ".jsonl"))
            raise KeyboardInterrupt

        monkeypatch.setattr("lithoform.compaction.run.compact", compacted)
        with pytest.raises(KeyboardInterrupt):
            run_compaction(other, out, threads=1, resume=True)
        assert begun == []


# ------------------------------------------------------------------------------------------ the command


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["compact", *arguments])
    return int(ended.value.code or 0)


def test_the_command_tells_the_fit_and_the_series(population, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [str(population), "--out", str(out), "--count", "24", "--mould", "62mm", "--min-size", "9.5mm",
                 "--pressure", "60", "--gyrations", "3", "--rate-factor", "60", "--stiffness-factor", "0.01",
                 "--no-vtk", "--threads", "1"]  # fmt: skip
    assert run(*arguments, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["fit"]) >= {"A", "B", "R2"}
    assert (
        len(told["series"]["gyration"]) == len(told["series"]["height"]) == len(told["series"]["packing_density"]) == 4
    )
    assert any("instead of 150 mm" in line for line in told["told"])
    # A finished one is told again at once, and another one is not put on top of it.
    assert run(*arguments, "--json", "--resume") == 0
    assert json.loads(capsys.readouterr().out)["fit"] == told["fit"]
    assert run(*arguments) == 2
    assert "--overwrite replaces it" in capsys.readouterr().err
    assert run(*arguments[:-2], "--seed", "1", "--resume") == 2
    assert "with other settings" in capsys.readouterr().err


@pytest.mark.parametrize(("changes", "told"), [
    (["--count", "3"], "expected --count from 10"), (["--gyrations", "0"], "--gyrations from 1"),
    (["--rate-factor", "0"], "--rate-factor from"), (["--stiffness-factor", "2"], "--stiffness-factor from"),
    (["--preset", "marshall"], "expected a preset of"), (["--gradation", "AC-14"], "AC-13"),
    (["--mould", "3parsec"], "unit"), (["--min-size", "1km"], "unit"),
    (["--curve", "middle"], "low, mid or high"), (["--threads", "0"], "--threads of at least 1"),
    (["--to-height", "0mm"], "positive"),
    (["--min-size", "20mm"], "the gradation cannot be filled"), (["--rate-factor", "nan"], "--rate-factor from"),
    (["--select", "nosuch = 1"], "nosuch"),
    (["--overwrite", "--resume"], "give one of them"), (["--pressure", "0"], "--pressure from"),
    (["--stiffness-factor", "0.005"], "at least --stiffness-factor 0.02"),
])  # fmt: skip
def test_what_makes_no_sense_is_refused_in_a_sentence(changes, told, population, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(str(population), "--out", str(out), *changes) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not (out / "compaction.json").exists()


def test_no_database_is_told(tmp_path, capsys):
    assert run(str(tmp_path / "none"), "--out", str(tmp_path / "out")) == 2
    assert "none" in capsys.readouterr().err


def test_every_error_of_a_request_is_one_of_ours(population):
    for changes in ({"seed": -1}, {"seed": "x"}, {"count": "x"}, {"mould": math.nan}, {"rate_factor": math.inf}):
        with pytest.raises(LithoformError):
            Request(population=population, **changes)


def test_a_specimen_knows_its_density(population):
    plan = Plan(gradation=find_gradation("AC-13"), min_size=9.5e-3, count=40)
    specimen: Specimen = make_specimen(Store(population), plan, PRESETS["paper"])
    assert specimen.density(1.0) == pytest.approx(float(specimen.model.volume.sum()) / specimen.area)
