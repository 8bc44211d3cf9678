"""Sensitivity: closed forms of Ishigami, elementary effects of known functions, claims on curves made by hand."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lithoform.axes import TABLE_7, Axis
from lithoform.descriptors.table import FOUR
from lithoform.errors import FileFormatError, RecipeError, SampleError
from lithoform.presets import SHAPE_CLASSES
from lithoform.sensitivity.claims import ALL, CLAIMS, Claim
from lithoform.sensitivity.designs import OneAtATime, Points, morris_trajectories, saltelli_sample
from lithoform.sensitivity.oat import Sweep, mean_with_band, read_curves, sweep_of
from lithoform.sensitivity.responses import Responses
from lithoform.sensitivity.screening import screen, screening_to_csv
from lithoform.sensitivity.trends import rank_correlation, tendency, trends, trends_to_csv
from lithoform.sensitivity.twist import TwistDesign, findings, findings_to_csv, twist_to_csv
from lithoform.sensitivity.variance import shares_to_csv, variance_shares

THREE = tuple(Axis(name, "linear", 0.0, 1.0) for name in ("perturbation", "gain", "ridge_weight"))
A, B = 7.0, 0.1


def ishigami(coordinates: np.ndarray) -> np.ndarray:
    x = np.pi * (2.0 * coordinates - 1.0)
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_shares() -> tuple[np.ndarray, np.ndarray]:
    """Closed form (Ishigami and Homma 1990)."""
    first = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    second, both = A**2 / 8.0, B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = first + second + both
    return np.array([first, second, 0.0]) / variance, np.array([first + both, second, both]) / variance


# ------------------------------------------------------------------------------------------------------------ Sobol


def test_variance_shares_of_ishigami_are_the_closed_form():
    design = saltelli_sample(THREE, samples=2048, seed=1)
    found = variance_shares(design, ishigami(design.coordinates)[:, None], ["y"])
    first, total = ishigami_shares()
    assert found.first[:, 0] == pytest.approx(first, abs=0.02)
    assert found.total[:, 0] == pytest.approx(total, abs=0.02)
    for low, high, true in ((found.first_low, found.first_high, first), (found.total_low, found.total_high, total)):
        assert ((low[:, 0] <= true) & (true <= high[:, 0])).all()
        assert (high[:, 0] - low[:, 0] < 0.15).all()
    assert (found.samples, found.left_out) == (2048, 0)


def test_variance_shares_of_a_sum_are_the_shares_of_its_variances():
    design = saltelli_sample(THREE, samples=1024, seed=1)
    y = design.coordinates @ np.array([1.0, 2.0, 3.0]) + 50.0
    found = variance_shares(design, np.stack([y, np.full_like(y, 4.0)], axis=1), ["sum", "constant"])
    assert found.first[:, 0] == pytest.approx(np.array([1.0, 4.0, 9.0]) / 14.0, abs=0.01)
    assert found.total[:, 0] == pytest.approx(np.array([1.0, 4.0, 9.0]) / 14.0, abs=0.01)
    assert np.isnan(found.total[:, 1]).all()


def test_noise_of_seeds_shows_in_the_total_shares_as_its_own_share():
    # An input that only draws another noise has a total share as large as the noise.
    design = saltelli_sample(THREE, samples=2048, seed=1)
    noise = np.random.default_rng(5).normal(size=design.point_count)
    y = design.coordinates[:, 0] * math.sqrt(12.0) + 0.5 * noise
    found = variance_shares(design, y[:, None], ["y"])
    assert found.total[1:, 0] == pytest.approx(np.full(2, 0.2), abs=0.02)
    assert found.first[:, 0] == pytest.approx([0.8, 0.0, 0.0], abs=0.06)


# ----------------------------------------------------------------------------------------------------------- Morris


def test_elementary_effects_of_a_plane_are_its_slopes_without_scatter():
    design = morris_trajectories(THREE, trajectories=12, seed=1)
    y = design.coordinates @ np.array([1.0, -2.0, 0.0])
    found = screen(design, y[:, None], ["y"])
    assert found.mu[:, 0] == pytest.approx([1.0, -2.0, 0.0], abs=1e-12)
    assert found.mu_star[:, 0] == pytest.approx([1.0, 2.0, 0.0], abs=1e-12)
    assert found.sigma[:, 0] == pytest.approx(np.zeros(3), abs=1e-12)
    assert found.mu_star_half[:, 0] == pytest.approx(np.zeros(3), abs=1e-12)


def test_elementary_effects_tell_interaction_and_change_of_sign():
    design = morris_trajectories(THREE, trajectories=200, seed=1)
    u = design.coordinates
    # x0 and x1 act together; x2 rises and falls, so that mu vanishes but mu* does not.
    found = screen(design, ((u[:, 0] - 0.5) * (u[:, 1] - 0.5) + np.abs(u[:, 2] - 0.5))[:, None], ["y"])
    assert np.abs(found.mu[:, 0]).max() < 0.09
    # On 4 levels the effect of x0 is u1 - 1/2, of which the size is 1/2 or 1/6, as often as not.
    assert found.mu_star[:2, 0] == pytest.approx([1 / 3, 1 / 3], abs=0.04)
    assert found.sigma[:2, 0] == pytest.approx(np.full(2, math.sqrt((1 / 4 + 1 / 36) / 2)), abs=0.03)
    # |u - 1/2| over a step of 2/3 from 0 or 1/3: 1/2 to 1/6 and 1/6 to 1/2.
    assert found.mu_star[2, 0] == pytest.approx(0.5, abs=1e-9)
    assert found.sigma[2, 0] == pytest.approx(0.5, abs=0.02)


def test_morris_finds_the_inputs_of_ishigami():
    # On 8 levels all three act, the third through the first alone.
    design = morris_trajectories(THREE, trajectories=60, levels=8, seed=3)
    found = screen(design, ishigami(design.coordinates)[:, None], ["y"])
    assert (found.mu_star[:, 0] > 3.0).all()
    assert found.sigma[2, 0] > found.mu_star[2, 0]


@pytest.mark.parametrize(("make", "analyse", "size"), [
    (lambda: morris_trajectories(THREE, trajectories=40, seed=1), screen, 4),
    (lambda: saltelli_sample(THREE, samples=64, seed=1), variance_shares, 5),
])  # fmt: skip
def test_blocks_with_a_missing_point_are_left_out_whole(make, analyse, size):
    design = make()
    y = (design.coordinates @ np.array([1.0, -2.0, 0.0]))[:, None]
    y[[0, size - 1, 3 * size + 1]] = np.nan
    found = analyse(design, y, ["y"])
    assert found.left_out == 2
    kept = np.setdiff1d(np.arange(design.point_count // size), [0, 3])
    rows = (kept[:, None] * size + np.arange(size)).ravel()
    part = Points(axes=THREE, coordinates=design.coordinates[rows], kind=design.kind, options=design.options, seed=1)
    again = analyse(part, y[rows], ["y"])
    name = "mu_star" if size == 4 else "total"
    assert (getattr(found, name) == getattr(again, name)).all()
    y[:] = np.nan
    with pytest.raises(SampleError, match="at least 2 whole blocks"):
        analyse(design, y, ["y"])
    with pytest.raises(SampleError, match=r"expected a (morris|sobol) design"):
        analyse(Points(axes=THREE, coordinates=design.coordinates), y, ["y"])


def test_tables_have_a_row_an_input_and_an_output():
    design = morris_trajectories(THREE, trajectories=4, seed=1)
    table = screening_to_csv(screen(design, design.coordinates, ["a", "b", "c"]))
    rows = list(csv.DictReader(io.StringIO(table.decode())))
    assert len(rows) == 9
    assert [float(r["mu"]) for r in rows] == pytest.approx(np.eye(3).ravel().tolist(), abs=1e-12)
    design = saltelli_sample(THREE, samples=64, seed=1)
    table = shares_to_csv(variance_shares(design, design.coordinates[:, :1], ["a"]))
    rows = list(csv.DictReader(io.StringIO(table.decode())))
    assert float(rows[0]["total"]) == pytest.approx(1.0, abs=0.1)
    assert float(rows[2]["total"]) == 0.0


# ----------------------------------------------------------------------------------------------------------- curves


def sweep_by_hand(functions: dict[str, object], *, noise: float = 0.01, seeds: int = 12) -> Sweep:
    """A sweep of Table 7: all descriptors over an axis are functions[axis](value), or 0.5, plus the seeds' scatter."""
    design = OneAtATime(seeds=seeds)
    scatter = noise * np.random.default_rng(0).normal(size=(design.point_count, seeds, 4))
    values = np.full((design.point_count, seeds, 4), 0.5)
    for i, axis in enumerate(TABLE_7):
        if axis.name in functions:
            place = design.points_of(i)
            curve = np.array([functions[axis.name](value) for value in design.values(i)])
            values[place.start : place.stop] = curve.reshape(-1, 1, 1)
    return sweep_of(design, Responses(values + scatter, {}))


@settings(deadline=None, max_examples=25)
@given(st.integers(2, 9), st.integers(0, 2**32))
def test_bands_are_those_of_student(seeds, seed):
    values = np.random.default_rng(seed).normal(size=(3, seeds, 2))
    mean, deviation, low, high, stones = mean_with_band(values)
    assert (stones == seeds).all()
    for i in range(3):
        for j in range(2):
            column = values[i, :, j]
            assert mean[i, j] == pytest.approx(column.mean(), abs=1e-12)
            assert deviation[i, j] == pytest.approx(column.std(ddof=1))
            expected = stats.t.interval(0.95, seeds - 1, column.mean(), stats.sem(column))
            assert (low[i, j], high[i, j]) == pytest.approx(expected)


def test_a_stone_that_is_missing_is_left_out_of_its_point_alone():
    values = np.arange(12.0).reshape(2, 3, 2)
    values[0, 1] = np.nan
    mean, _, low, _, stones = mean_with_band(values)
    assert stones.tolist() == [2, 3]
    assert mean.tolist() == [[2.0, 3.0], [8.0, 9.0]]
    assert np.isfinite(low).all()
    values[0, 2] = np.nan
    assert np.isnan(mean_with_band(values)[2][0]).all()
    values[0, 0] = np.nan
    assert np.isnan(mean_with_band(values)[0][0]).all()


def test_curves_are_the_same_after_their_file(tmp_path):
    sweep = sweep_by_hand({"gain": lambda g: 1.0 - g / 2})
    path = tmp_path / "curves.csv"
    path.write_bytes(sweep.curves.to_csv())
    again = read_curves(path)
    assert again.axes == sweep.axes
    assert again.base == sweep.base == (0.5, 0.3, 1.5, 1.5, 0.5, 0.0, 5.0, 1.5, 0.5, 0.8, 0.3, 0.15, 0.5, 0.15, 1.0)
    for name in ("values", "mean", "deviation", "low", "high", "stones"):
        for one, other in zip(getattr(again, name), getattr(sweep.curves, name), strict=True):
            assert (one == other).all()
    assert (again.baseline == sweep.curves.baseline).all()
    assert again.to_csv() == sweep.curves.to_csv()
    assert again.ranges[8] == pytest.approx(np.full(4, 0.5), abs=0.03)


@pytest.mark.parametrize("text", ["", "parameter\nbenchmark\n", "a,b\n1,2\n", "\x00"])
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "curves.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"make it again|cannot be read"):
        read_curves(path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_curves(tmp_path / "none.csv")


# ----------------------------------------------------------------------------------------------------------- claims


@settings(deadline=None, max_examples=40)
@given(st.lists(st.integers(-5, 5), min_size=3, max_size=12), st.integers(0, 2**32))
def test_rank_correlation_is_spearmans(y, seed):
    x = np.random.default_rng(seed).integers(0, 4, len(y)).astype(float)
    y = np.array(y, dtype=float)
    if np.ptp(x) == 0 or np.ptp(y) == 0:
        assert rank_correlation(x, y) == 0.0
    else:
        assert rank_correlation(x, y) == pytest.approx(stats.spearmanr(x, y).statistic)


def test_a_tendency_of_a_curve_made_by_hand():
    x = np.arange(5.0)
    falling = -x[:, None] + np.array([0.0, 10.0, 20.0])
    found = tendency(x, falling)
    assert (found.correlation, found.seeds_correlation, found.change, found.range) == (-1.0, -1.0, -4.0, 4.0)
    assert found.seeds_agreeing == found.seeds == 3
    assert found.p == 0.25  # two of the eight ways in which three signs fall
    assert found.tends(-1)
    assert not found.tends(1)
    flat = tendency(x, np.zeros((5, 3)))
    assert (flat.correlation, flat.p, flat.range) == (0.0, 1.0, 0.0)
    assert not flat.tends(1)
    assert not flat.tends(-1)
    # One seed with a missing stone does not count.
    falling[2, 1] = np.nan
    assert tendency(x, falling).seeds == 2


def one(sweep: Sweep, **claim) -> bool:
    (found,) = trends(sweep, [Claim(**{"descriptor": "roundness", "text": "", **claim})])
    return found.held


LARGE = {"perturbation": lambda k: 1.0 - k}  # the largest range is 1


@pytest.mark.parametrize(
    ("curve", "kind", "held"),
    [
        (lambda g: 0.6 - 0.2 * g, {"kind": "falls"}, True),
        (lambda g: 0.6 - 0.2 * g, {"kind": "rises"}, False),
        (lambda g: 0.6 + 0.2 * g, {"kind": "rises", "size": "slight"}, True),
        (lambda g: 0.6 + 0.2 * g, {"kind": "rises", "size": "strong"}, False),
        (lambda g: 0.6 - 0.4 * g, {"kind": "falls", "size": "slight"}, False),
        (lambda g: 0.6 - 0.4 * g, {"kind": "falls", "size": "strong"}, True),
        (lambda g: 0.6 - 0.2 * abs(g - 0.5), {"kind": "falls"}, False),
        (lambda g: 0.6 - 0.2 * abs(g - 0.5), {"kind": "falls", "low": 0.5}, True),
        (lambda g: 0.6 - 0.2 * abs(g - 0.5), {"kind": "rises", "high": 0.5}, True),
        (lambda g: 0.5 + 0.05 * g, {"kind": "changes", "size": "negligible"}, True),
        (lambda g: 0.5 + 0.3 * g, {"kind": "changes", "size": "negligible"}, False),
        (lambda g: 0.5 + 0.5 * max(g - 0.4, 0.0), {"kind": "changes", "size": "negligible", "high": 0.4}, True),
        (lambda g: 0.5 + 0.5 * (g - 0.3) ** 2, {"kind": "rebounds"}, True),
        (lambda g: 0.5 + 0.5 * (g - 0.9) ** 2, {"kind": "rebounds"}, False),
        (lambda g: 0.5 + 0.4 * max(0.6 - g, 0.0) + 0.04 * g, {"kind": "rebounds"}, False),
        (lambda g: 0.5 + 0.4 * max(0.6 - g, 0.0) + 0.12 * max(g - 0.6, 0.0), {"kind": "rebounds"}, True),
        (lambda g: 0.5 - 0.3 * g, {"kind": "rebounds"}, False),
        (lambda g: 0.5 - 0.5 * max(g - 0.4, 0.0), {"kind": "threshold", "at": 0.4}, True),
        (lambda g: 0.5 - 0.5 * g, {"kind": "threshold", "at": 0.4}, False),
        (lambda g: 0.5 + 0.5 * max(g - 0.4, 0.0), {"kind": "threshold", "at": 0.4}, False),
        (lambda g: 0.5 - 0.5 * g, {"kind": "strongest"}, False),
    ],
)
def test_a_claim_on_a_curve_made_by_hand(curve, kind, held):
    assert one(sweep_by_hand({**LARGE, "gain": curve}), parameter="gain", **kind) is held


@pytest.mark.parametrize("end", [0, -1])
def test_a_threshold_with_too_few_points_on_one_side_does_not_hold(end):
    # Two points, one of which is the threshold: nothing is known of what lies before, or after.
    whole = sweep_by_hand({**LARGE, "gain": lambda g: 0.5 - 0.5 * g})
    gain = next(i for i, axis in enumerate(TABLE_7) if axis.name == "gain")
    ends = replace(
        whole,
        values=tuple(v[[0, -1]] for v in whole.values),
        responses=tuple(r[[0, -1]] for r in whole.responses),
    )
    at = float(ends.values[gain][end])
    claim = Claim(parameter="gain", descriptor="roundness", text="", kind="threshold", at=at)
    (found,) = trends(ends, [claim])
    assert not found.held
    assert found.found.startswith("expected at least 2 points with stones")


def test_a_parameter_without_a_stone_takes_no_part_in_what_is_said_of_all():
    whole = sweep_by_hand(LARGE)
    gone = next(i for i, axis in enumerate(TABLE_7) if axis.name == "gain")
    sparse = replace(
        whole, responses=tuple(np.full_like(r, np.nan) if i == gone else r for i, r in enumerate(whole.responses))
    )
    assert np.isnan(sparse.curves.ranges[gone]).all()
    assert one(sparse, parameter="perturbation", kind="strongest")
    (told,) = trends(sparse, [Claim(parameter=ALL, descriptor="roundness", text="", kind="most")])
    assert f"of {len(TABLE_7) - 1} parameters" in told.found
    (told,) = trends(sparse, [Claim(parameter="gain", descriptor="roundness", text="", kind="falls")])
    assert (told.held, told.found) == (False, "only 0 points with stones")
    nothing = replace(whole, responses=tuple(np.full_like(r, np.nan) for r in whole.responses))
    with pytest.raises(SampleError, match="use more triangles"):
        trends(nothing)


def test_the_strongest_parameter_and_the_order_of_the_descriptors():
    sweep = sweep_by_hand(LARGE, noise=0.0)
    assert one(sweep, parameter="perturbation", kind="strongest")
    # Where all four are alike, none is between.
    assert not one(sweep, parameter=ALL, descriptor="solidity", kind="between")
    graded = replace(sweep, responses=tuple(
        np.array([4.0, 1.0, 2.0, 3.0]) * np.linspace(1.0, 1.2, len(r))[:, None, None] * np.ones_like(r)
        for r in sweep.responses
    ))  # fmt: skip
    assert one(graded, parameter=ALL, descriptor="roundness", kind="most")
    assert one(graded, parameter=ALL, descriptor="boxiness", kind="least")
    assert one(graded, parameter=ALL, descriptor="solidity", kind="between")
    assert not one(graded, parameter=ALL, descriptor="solidity", kind="most")
    assert not one(graded, parameter=ALL, descriptor="true_sphericity", kind="least")


def test_the_claims_are_on_table_7_and_on_all_four():
    assert {claim.parameter for claim in CLAIMS} == {ALL, *(axis.name for axis in TABLE_7)}
    assert {claim.descriptor for claim in CLAIMS} == {ALL, *FOUR}
    assert len({(c.parameter, c.descriptor, c.text) for c in CLAIMS}) == len(CLAIMS)
    ranges = {axis.name: (axis.low, axis.high) for axis in TABLE_7}
    for claim in CLAIMS:
        for end in (claim.low, claim.high, claim.at):
            assert end is None or ranges[claim.parameter][0] <= end <= ranges[claim.parameter][1]


def test_the_table_of_trends_says_what_held():
    sweep = sweep_by_hand(LARGE)
    found = trends(sweep)
    assert len(found) == len(CLAIMS)
    rows = list(csv.DictReader(io.StringIO(trends_to_csv(found).decode())))
    assert [row["held"] for row in rows] == ["yes" if trend.held else "no" for trend in found]
    row = next(r for r in rows if (r["parameter"], r["descriptor"], r["kind"]) == ("perturbation", "solidity", "falls"))
    assert (row["held"], float(row["correlation"])) == ("yes", -1.0)
    assert float(row["share"]) == pytest.approx(1.0)
    # A sweep of some parameters tests what is said of them.
    part = Sweep(sweep.axes[:1], sweep.base[:1], sweep.values[:1], sweep.responses[:1], sweep.baseline)
    assert {t.claim.parameter for t in trends(part)} == {ALL, "base_radius"}


# ------------------------------------------------------------------------------------------------------------ twist


def test_the_design_of_figure_5_has_its_classes_calibrations_and_rates():
    from lithoform.presets import shape_class_of

    design = TwistDesign(seeds=10)
    design.validate()
    assert design.count == 4 * 2 * 7 * 10
    for number in range(1, design.count + 1, 10):
        recipe, i = design.recipe(number), number - 1
        assert shape_class_of(recipe.size) == SHAPE_CLASSES[i // 140]
        assert recipe.calibration_frame == ("pca", "aabb")[i // 70 % 2]
        assert recipe.twist_rate == 10.0 * (i // 10 % 7)
        assert recipe.seed == design.recipe(1).seed


def test_findings_on_values_made_by_hand():
    rates = (0.0, 30.0, 60.0)
    rng = np.random.default_rng(1)
    values = 0.5 + 0.01 * rng.normal(size=(1, 1, 1, 10, 4)) + 1e-6 * rng.normal(size=(4, 2, 3, 10, 4))
    values[..., 0] += np.array(rates)[:, None] * 1e-3 * np.array([1.0, 1.0, 2.0, 3.0])[:, None, None, None]
    values[..., 3] -= np.array(rates)[:, None] * 1e-3 * np.array([2.0, 1.0, 1.0, 3.0])[:, None, None, None]
    values[0, 1, ..., 0] -= 0.005  # the box gives cubes a lower roundness, by half a deviation
    found = {(f.shape_class, f.descriptor, f.text): f for f in findings(rates, values)}
    lower = found["cube", "roundness", "is lower by the box than by PCA"]
    assert lower.held
    assert lower.estimate == pytest.approx(-0.005, abs=1e-5)
    scatter = values[0, 0, 0, :, 0].std(ddof=1)
    assert lower.measure == pytest.approx(-0.005 / scatter, rel=1e-2)
    assert found["cube", "boxiness", "does not depend on the calibration"].held
    assert not found["plate", "roundness", "is higher by the box than by PCA"].held
    assert found["blade", "roundness", "rises with the twist"].held
    assert not found["blade", "solidity", "falls with the twist"].held
    assert found["blade", "boxiness", "has no tendency with the twist"].held
    assert found["column", "roundness", "rises more with the twist than in cube and plate"].held
    assert not found["column", "true_sphericity", "falls more with the twist than in cube and plate"].held
    assert found["blade", "true_sphericity", "falls more with the twist than in cube and plate"].held
    rows = list(csv.DictReader(io.StringIO(findings_to_csv(list(found.values())).decode())))
    assert len(rows) == len(found) == 16 + 16 + 4
    means = list(csv.DictReader(io.StringIO(twist_to_csv(rates, values).decode())))
    assert len(means) == 24
    assert float(means[0]["roundness_mean"]) == pytest.approx(values[0, 0, 0, :, 0].mean())


def test_options_out_of_range_are_refused():
    with pytest.raises(RecipeError, match="2 trajectories"):
        morris_trajectories(THREE, trajectories=0)
