"""The study of rate and stiffness: its plan, its extrapolation against known lines, its folder, its page."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lithoform.cli import main
from lithoform.compaction import campaign
from lithoform.compaction.study import MEASURES, Setting, Study, extrapolate, run_study
from lithoform.errors import OutputError, RecipeError, SampleError
from lithoform.study_report import findings, study_files

A, B = -8.0, 4.0
BASE = Setting(40.0, 0.1, 9.7e-4, 1.0 / 466.0)


def rows_of(study: Study, noise: float = 0.0, seed: int = 0) -> list[dict]:
    """Runs that follow the lines exactly, but for noise of each bed, and a quarter of it of each run."""
    rng = np.random.default_rng(seed)
    of_bed = {(k, e): noise * rng.standard_normal(3) for k in range(3) for e in study.stiffness_factors}
    rows = []
    for name, request in study.plan():
        specimen, e = int(name[4]), request.stiffness_factor
        at = BASE.changed(request.rate_factor, request.stiffness_factor)
        rows.append({
            "seed": request.seed, "rate_factor": request.rate_factor, "stiffness_factor": request.stiffness_factor,
            "inertial_number": at.inertial_number, "inverse_kappa": at.inverse_kappa,
            "loose_density": 0.45 + 0.01 * specimen + 2.0 * at.inverse_kappa + of_bed[specimen, e][0],
            "compacted_density": 0.50 + 0.01 * specimen + A * at.inertial_number + B * at.inverse_kappa
            + of_bed[specimen, e][1] + 0.25 * noise * rng.standard_normal(),
            "settlement": 0.9 + of_bed[specimen, e][2] + 0.25 * noise * rng.standard_normal(), "seconds": 1.0,
        })  # fmt: skip
    return rows


@pytest.fixture
def study(tmp_path) -> Study:
    return Study(population=tmp_path / "stones")


class TestPlan:
    def test_each_specimen_meets_all_settings(self, study):
        plan = study.plan()
        assert len(plan) == 18
        assert len({name for name, _ in plan}) == 18
        assert len({request.seed for _, request in plan}) == 3
        of_first = {(r.rate_factor, r.stiffness_factor) for name, r in plan if name.startswith("seed0_")}
        assert of_first == {(40.0, 0.1), (10.0, 0.1), (20.0, 0.1), (80.0, 0.1), (40.0, 0.3), (40.0, 1.0)}
        assert {request.bed_stiffness_factor for _, request in plan} == {0.1}
        # Else the runs that get there would make fewer gyrations than the others.
        assert all(request.to_height == 1e-4 for _, request in plan)

    @pytest.mark.parametrize("changes", [
        {"rate_factors": (40.0,)}, {"rate_factors": (40.0, 40.0)}, {"stiffness_factors": (0.1, 7.0)}, {"seeds": 1},
        {"rate_factors": (40.0, -1.0)}, {"count": 2}, {"gyrations": 0}, {"rate_factors": (40.0, float("nan"))},
    ])  # fmt: skip
    def test_what_makes_no_sense_is_refused(self, changes, tmp_path):
        with pytest.raises(RecipeError):
            Study(population=tmp_path, **changes)


class TestExtrapolation:
    def test_lines_are_recovered(self, study):
        fit = extrapolate(rows_of(study), "compacted_density")
        assert fit.slopes == pytest.approx([A, B], rel=1e-9)
        assert fit.limit == pytest.approx(0.51, rel=1e-12)
        assert max(fit.scatter) < 1e-12
        # 12 runs of 3 beds and a slope; 9 beds of 3 seeds and a slope.
        assert fit.freedom == (12 - 3 - 1, 9 - 3 - 1)
        # Specimens at 0.50, 0.51 and 0.52: their scatter is what the limit is known to.
        assert fit.limit_error == pytest.approx(0.01 / 3.0**0.5)

    def test_the_change_against_the_real_case_is_that_of_the_lines(self, study):
        fit = extrapolate(rows_of(study), "compacted_density")
        real = BASE.real
        # I goes as the rate, 1 / kappa as E^(-2/3).
        assert real.inertial_number == pytest.approx(BASE.inertial_number / 40.0)
        assert 1.0 / real.inverse_kappa == pytest.approx(466.0 * 10.0 ** (2.0 / 3.0))
        value, low, high = fit.change(BASE, real)
        assert value == pytest.approx(A * 9.7e-4 * 39.0 / 40.0 + B / 466.0 * (1.0 - 0.1 ** (2.0 / 3.0)))
        assert low == pytest.approx(high)
        assert fit.verdict(BASE, real) == "safe"

    def test_the_rate_cannot_change_what_was_before_gyration(self, study):
        fit = extrapolate(rows_of(study), "loose_density")
        assert fit.slopes == pytest.approx([0.0, 2.0])
        assert fit.freedom == (0, 9 - 3 - 1)

    def test_the_interval_holds_the_truth_as_often_as_it_says(self, study):
        slow = BASE.changed(1.0, 0.1)
        rate, both = A * 9.7e-4 * 39.0 / 40.0, B / 466.0 * (1.0 - 0.1 ** (2.0 / 3.0))
        held = {slow: 0, BASE.real: 0}
        for seed in range(400):
            fit = extrapolate(rows_of(study, 0.004, seed), "compacted_density")
            for against, truth in ((slow, rate), (BASE.real, rate + both)):
                _, low, high = fit.change(BASE, against)
                held[against] += low < truth < high
        # Binomial: 360 expected, standard deviation 6.
        assert all(342 <= count <= 378 for count in held.values())

    def test_the_rate_is_known_better_than_the_stiffness(self, study):
        """Runs of the same bed differ by little, and tell of the rate whatever the beds do."""
        fit = extrapolate(rows_of(study, 0.02), "compacted_density")
        assert fit.scatter[0] < 0.5 * fit.scatter[1]
        assert fit.verdict(BASE, BASE.changed(20.0, 0.1)) == "safe"
        assert fit.verdict(BASE, BASE.real) == "open"

    def test_large_changes_are_biased_and_noise_leaves_it_open(self, study):
        fit = extrapolate(rows_of(study), "compacted_density")
        assert fit.verdict(BASE.changed(200.0, 0.1), BASE.real) == "biased"
        noisy = extrapolate(rows_of(study, 0.05), "compacted_density")
        assert noisy.verdict(BASE, BASE.real) == "open"

    def test_too_few_runs_are_refused(self, study):
        with pytest.raises(SampleError, match="at least two values of each"):
            extrapolate(rows_of(study)[:4], "compacted_density")


def test_the_page_tells_limits_slopes_and_verdicts(study):
    files = study_files(study, rows_of(study, 0.002))
    assert set(files) == {"scales.png", "scales.csv", "report.html"}
    assert files["scales.png"].startswith(b"\x89PNG")
    assert len(files["scales.csv"].decode().splitlines()) == 19
    page = files["report.html"].decode()
    assert all(name.capitalize() in page for name in MEASURES.values())
    assert "cannot" in page  # the slope of the loose density over the rate
    found = findings(study, rows_of(study))
    assert [row["measure"] for row in found] == list(MEASURES)
    assert found[1]["settings"][0]["verdict"] == "safe"
    json.dumps(found, allow_nan=False)


def test_runs_are_made_once_and_become_rows(study, tmp_path, monkeypatch):
    made = []

    def stand_in(request, out, **_):
        made.append(out.name)
        out.mkdir(parents=True, exist_ok=True)
        results = {
            "loose": {"packing_density": 0.5, "height": 0.08},
            "compacted": {"packing_density": 0.55, "height": 0.072},
            "scales": {"inertial_number_median": 1e-3, "kappa": 500.0},
            "seconds": 2.0,
        }
        (out / "compaction.json").write_text(json.dumps({"finished": True, "results": results}))
        return results

    monkeypatch.setattr(campaign, "run_compaction", stand_in)
    monkeypatch.setattr(campaign, "check_request", lambda *_, **__: None)
    rows = run_study(study, tmp_path / "out", workers=0)
    assert len(made) == len(rows) == 18
    assert rows[0]["settlement"] == pytest.approx(0.9)
    assert rows[0]["inverse_kappa"] == pytest.approx(2e-3)
    assert run_study(study, tmp_path / "out", workers=0, resume=True) == rows
    assert len(made) == 18


def test_runs_take_all_gpus_in_turn(study, tmp_path, monkeypatch):
    """With names of GPUs in place of GPUs: what each run is told, and how many workers there are."""
    told, asked = [], []

    def spread(work, jobs, *, workers, scheduler):
        asked.append(workers)
        told.extend(job["device"] for job in jobs)
        return iter(())

    monkeypatch.setattr(campaign, "spread", spread)
    monkeypatch.setattr(campaign, "check_request", lambda *_, **__: None)
    monkeypatch.setattr(campaign, "has_dask", lambda: True)
    monkeypatch.setattr(campaign, "every_gpu", lambda device: ["cuda:0", "cuda:1"])
    with pytest.raises(OutputError, match="not finished"):
        run_study(study, tmp_path / "a")
    assert told[:3] == ["cuda:0", "cuda:1", "cuda:0"]
    told.clear()
    with pytest.raises(OutputError, match="not finished"):
        run_study(study, tmp_path / "b", workers=5)
    assert asked == [2, 5]


def test_the_command_tells_what_is_wrong(tmp_path, capsys):
    for words, said in (
        (["--rate-factors", "40,fast"], "expected numbers for --rate-factors"),
        (["--stiffness-factors", "0.1"], "two or more different --stiffness-factors"),
        (["--seeds", "1"], "--seeds from 2"),
        (["--rate-factors", ""], "two or more different --rate-factors"),
        (["--stiffness-factors", "0.1,0.3,0.01"], "give at least --stiffness-factor"),
        (["--workers", "0"], str(tmp_path / "stones")),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["experiment", "scales", str(tmp_path / "out"), "--population", str(tmp_path / "stones"), *words])
        assert ended.value.code == 2
        assert said in capsys.readouterr().err
