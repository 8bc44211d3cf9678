"""The experiment with the compactor: its plan, its verdicts against known samples, its pages, its folder."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from lithoform.cli import main
from lithoform.compaction import campaign as module
from lithoform.compaction.experiment import Experiment, compare_sources, measures_of, run_experiment
from lithoform.compaction.published import COMPACTED_DENSITY, FITS, LOOSE_DENSITY
from lithoform.errors import FileFormatError, OutputError, RecipeError, SimulationError
from lithoform.experiment_report import experiment_files, fits_table, runs_csv


def row(case: int, sample: int, density: float, b: float = -0.029, gain: float = 0.05) -> dict:
    """Results of a run whose specimen follows H = A G^B exactly."""
    solid, g = 0.02, np.arange(0.0, 34.0)
    loose = solid / density
    heights = 0.98 * loose * np.maximum(g, 1.0) ** b
    heights[0] = loose
    return {
        "case": case, "sample": sample, "name": f"{case}-{sample}", "stones": 300, "mould_diameter": 0.08,
        "mould_over_largest_stone": 5.0, "height_scale": 0.5,
        "fit": {"A": 0.98 * loose, "A_mm": 980.0 * loose, "B": b, "R2": 1.0},
        "series": {"gyration": g.tolist(), "height": heights.tolist(), "packing_density": (solid / heights).tolist()},
        "loose": {"height": loose, "packing_density": density},
        "compacted": {"height": float(heights[-1]), "packing_density": density + gain, "gyration": 33.0},
        "pressure": {"mean": 600e3}, "deepest_overlap_over_radius": 0.02, "steps": 1, "seconds": 2.0,
        "scales": {"kappa": 466.0, "inertial_number": 1e-3, "inertial_number_median": 5e-4},
    }  # fmt: skip


def rows(shift: float, spread: float, *, cases: int = 6, samples: int = 3, seed: int = 0) -> list[dict]:
    rng = np.random.default_rng(seed)
    return [
        row(case, sample, 0.53 + (shift if sample else 0.0) + spread * rng.standard_normal())
        for case in range(1, cases + 1)
        for sample in range(samples + 1)
    ]


class TestVerdicts:
    def test_sources_that_are_alike_are_equivalent(self):
        found = {c.name: c for c in compare_sources(rows(0.0, 0.003))}
        loose = found["loose_density"]
        assert loose.verdict == "equivalent"
        assert (len(loose.scanned), len(loose.generated)) == (6, 18)
        # The standard deviation within cases, of 12 degrees of freedom, is that of the draw.
        assert 0.0015 < loose.spread < 0.005

    def test_sources_that_differ_are_told_apart(self):
        loose = compare_sources(rows(0.02, 0.003))[0]
        assert loose.verdict == "different"
        assert loose.difference == pytest.approx(0.02, abs=0.005)
        assert loose.interval[0] > 0.01

    def test_a_scatter_that_is_too_large_leaves_it_open(self):
        said = [compare_sources(rows(0.0, 0.05, seed=s))[0].verdict for s in range(40)]
        # The interval of 90 % holds no difference in 36 of 40 on the average.
        assert said.count("open") >= 30
        assert "equivalent" not in said

    def test_a_single_case_decides_nothing(self):
        loose = compare_sources(rows(0.0, 0.003, cases=1))[0]
        assert loose.verdict == "open"
        assert loose.interval == (-math.inf, math.inf)

    def test_a_does_not_depend_on_the_mass(self):
        """A over the height of the solids: of the curve above 0.98 over the packing density."""
        assert measures_of(row(1, 0, 0.5))["A"] == pytest.approx(0.98 / 0.5)

    def test_equivalence_is_as_rare_as_its_level_at_the_margin(self):
        """At a difference of the margin itself, two one-sided tests at 5 % say equivalent in 5 % of experiments."""
        said = sum(compare_sources(rows(0.01, 0.003, seed=s))[0].verdict == "equivalent" for s in range(400))
        assert 8 <= said <= 34  # binomial: 20 expected, standard deviation 4.4

    def test_runs_without_a_fit_leave_it_open(self):
        short = [{**each, "fit": None} for each in rows(0.0, 0.003)]
        found = {c.name: c for c in compare_sources(short)}
        assert found["B"].verdict == "open"
        assert found["loose_density"].verdict == "equivalent"

    def test_runs_of_one_case_without_a_fit_leave_the_others_their_spread(self):
        some = [{**each, "fit": None} if each["case"] == 1 and each["sample"] else each for each in rows(0.0, 0.003)]
        found = {c.name: c for c in compare_sources(some)}
        assert math.isfinite(found["A"].spread)


class TestPages:
    def test_the_papers_figures_are_beside_ours(self):
        table = fits_table(rows(0.0, 0.003))
        assert len(table.rows) == 12
        assert table.rows[1][1:] == ("paper", "70.2147 G^-0.0286; 0.9961", "70.2923 G^-0.0288; 0.9968",
                                     "70.3315 G^-0.0288; 0.9953", "70.2563 G^-0.0285; 0.9959")  # fmt: skip
        assert table.rows[0][0] == "1"
        assert table.rows[0][2].endswith("G^-0.0290; 1.0000")
        # 0.98 times the loose height, over a scale of heights of a half.
        assert float(table.rows[0][2].split()[0]) == pytest.approx(0.98 * 2.0 * 20.0 / 0.53, rel=0.05)

    def test_the_published_fits_lead_from_the_loose_to_the_compacted_density(self):
        """70 mm to 63.5 mm raises 53 % to 58.4 %, and the fits reach 63.5 mm in 30 to 40 gyrations."""
        gyrations = [(63.5 / a) ** (1.0 / b) for case in FITS for a, b, _ in case]
        assert 29.0 < min(gyrations) < max(gyrations) < 41.0
        assert LOOSE_DENSITY[0] * 70.0 / 63.5 == pytest.approx(COMPACTED_DENSITY[0], abs=0.005)

    def test_files_of_an_experiment(self, tmp_path):
        plan = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b", cases=2, generated_runs=2)
        made = experiment_files(plan, rows(0.0, 0.003, cases=2, samples=2))
        assert set(made) == {"fig12.png", "fig13.png", "runs.csv", "report.html"}
        assert all(made[name].startswith(b"\x89PNG") for name in ("fig12.png", "fig13.png"))
        page = made["report.html"].decode()
        assert "Table 6" in page
        assert "70.2147 G^-0.0286" in page
        assert page.count("equivalent") >= 2

    def test_a_page_without_fits_says_so(self, tmp_path):
        plan = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b", cases=2, generated_runs=1)
        short = [{**each, "fit": None} for each in rows(0.0, 0.003, cases=2, samples=1)]
        page = experiment_files(plan, short)["report.html"].decode()
        assert "not fitted" in page
        assert "nan" not in page
        assert "inf" not in page.replace("information", "")

    def test_the_table_of_the_runs_has_a_row_each(self):
        lines = runs_csv(rows(0.0, 0.003)).decode().splitlines()
        assert len(lines) == 25
        assert lines[1].startswith("1,0,scanned,300,0.08,")


class TestRuns:
    def test_each_run_has_its_own_seed_and_source(self, tmp_path):
        plan = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b").plan()
        assert len(plan) == 24
        assert len({run.request.seed for run in plan}) == 24
        assert [run.name for run in plan[:5]] == ["case1_scanned", "case1_generated1", "case1_generated2",
                                                  "case1_generated3", "case2_scanned"]  # fmt: skip
        assert {run.request.population.name for run in plan if run.sample == 0} == {"a"}
        assert {run.request.population.name for run in plan if run.sample} == {"b"}

    @pytest.fixture
    def made(self, monkeypatch) -> list[str]:
        """Names of the runs, which a stand-in makes; what it is told to fail with, by `self.faults`."""
        names = []
        results = {key: value for key, value in row(1, 0, 0.5).items() if key not in ("case", "sample", "name")}
        self.faults = {}

        def stand_in(request, out, **_):
            names.append(out.name)
            if out.name in self.faults:
                raise self.faults.pop(out.name)
            out.mkdir(parents=True, exist_ok=True)
            (out / "compaction.json").write_text(json.dumps({"finished": True, "results": results}))
            return {"seconds": 0.0}

        monkeypatch.setattr(module, "run_compaction", stand_in)
        monkeypatch.setattr(module, "check_request", lambda *_, **__: None)
        return names

    def test_what_is_done_is_not_done_again(self, tmp_path, made):
        """A run fails once for want of space: what was done before is kept, the rest is made on resuming."""
        self.faults["case2_generated1"] = OutputError("the disk is full.")
        plan = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b", cases=2, generated_runs=1)
        with pytest.raises(OutputError, match="case2_generated1: the disk is full"):
            run_experiment(plan, tmp_path / "out", workers=0)
        with pytest.raises(OutputError, match="holds this experiment already: --resume goes on"):
            run_experiment(plan, tmp_path / "out", workers=0)
        told = []
        found = run_experiment(plan, tmp_path / "out", workers=0, resume=True, told=told.append)
        assert made == ["case1_scanned", "case1_generated1", "case2_scanned", "case2_generated1", "case2_generated1"]
        assert told[0] == "3 of 4 runs are there."
        assert [(r["case"], r["sample"]) for r in found] == [(1, 0), (1, 1), (2, 0), (2, 1)]
        other = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b", cases=3, generated_runs=1)
        with pytest.raises(OutputError, match=r"other settings \(cases\)"):
            run_experiment(other, tmp_path / "out", resume=True)

    def test_a_simulation_that_fails_stops_no_other_run(self, tmp_path, made):
        self.faults["case1_scanned"] = SimulationError(
            "stone 3 is no number any more at t = 1 s.", time=1.0, bodies=(3,)
        )
        plan = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b", cases=2, generated_runs=1)
        with pytest.raises(SimulationError, match=r"^case1_scanned: stone 3 .* at t = 1 s; the 3 other runs are kept"):
            run_experiment(plan, tmp_path / "out", workers=0)
        assert made == ["case1_scanned", "case1_generated1", "case2_scanned", "case2_generated1"]

    def test_a_plan_that_is_refused_leaves_no_folder(self, tmp_path):
        with pytest.raises(FileFormatError, match=r"case1_scanned: .* make one with lithoform database build"):
            run_experiment(Experiment(scanned=tmp_path / "a", generated=tmp_path / "b"), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_a_plan_without_a_run_is_replaced(self, tmp_path, monkeypatch):
        def stopped(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr(module, "run_compaction", stopped)
        monkeypatch.setattr(module, "check_request", lambda *_, **__: None)
        for cases in (2, 3):
            plan = Experiment(scanned=tmp_path / "a", generated=tmp_path / "b", cases=cases)
            with pytest.raises(KeyboardInterrupt):
                run_experiment(plan, tmp_path / "out", workers=0)
        assert json.loads((tmp_path / "out" / "experiment.json").read_text())["settings"]["cases"] == 3

    def test_neighbouring_seeds_share_no_run(self, tmp_path):
        seeds = [{run.request.seed for run in Experiment(scanned=tmp_path, generated=tmp_path, seed=seed).plan()}
                 for seed in range(4)]  # fmt: skip
        assert len(set.union(*seeds)) == 4 * 24

    def test_a_folder_of_others_is_left_alone(self, tmp_path, monkeypatch):
        monkeypatch.setattr(module, "check_request", lambda *_, **__: None)
        (tmp_path / "mine.txt").write_text("x")
        with pytest.raises(OutputError, match="is not empty"):
            run_experiment(Experiment(scanned=tmp_path, generated=tmp_path), tmp_path)

    @pytest.mark.parametrize("changes", [
        {"scale": "huge"}, {"cases": 0}, {"generated_runs": 0}, {"cases": 999}, {"seed": -1},
        {"changes": {"mould": 30.0}},
        {"changes": {"stiffness_factor": 7.0}},
    ])  # fmt: skip
    def test_what_makes_no_sense_is_refused(self, changes, tmp_path):
        with pytest.raises(RecipeError):
            Experiment(scanned=tmp_path, generated=tmp_path, **changes)


def test_the_command_tells_of_a_missing_database(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["experiment", "sgc", str(tmp_path / "out"), "--scanned", str(tmp_path / "a"), "--generated",
              str(tmp_path / "b"), "--cases", "1", "--generated-runs", "1", "--workers", "0"])  # fmt: skip
    assert ended.value.code == 2
    assert str(tmp_path / "a") in capsys.readouterr().err
