"""Permutation and bootstrap: exact small cases, size and power by simulation, same bytes from the same seed."""

import itertools
import math
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from lithoform.errors import SampleError
from lithoform.statistics import distances, histograms, resampling
from lithoform.statistics.anova import anova
from lithoform.statistics.comparison import compare_joint, compare_populations, compare_samples
from lithoform.statistics.joint import joint_energy_test, joint_mmd_test
from lithoform.statistics.permutation import INDICES, permutation_tests
from lithoform.statistics.resampling import ESTIMATES, bootstrap_estimates


def by_name(found):
    return {one.name: one for one in found}


def within_binomial(hits, trials, chance):
    """Whether a count is one that a binomial gives with all but 1 in 10,000 on either side."""
    low, high = stats.binom(trials, chance).ppf([1e-4, 1 - 1e-4])
    return low <= hits <= high


# ------------------------------------------------------------------------------------------------ permutation


@pytest.mark.parametrize("tied", [False, True])
def test_observed_indices_are_those_of_the_plain_functions(tied):
    generator = np.random.default_rng(9)
    a, b = generator.normal(50.0, 1.0, 83), generator.normal(50.3, 1.4, 61)
    if tied:
        a, b = np.round(2 * a) / 2, np.round(2 * b) / 2
    edges = histograms.bin_edges(np.concatenate([a, b]))
    pair = histograms.counts(a, edges), histograms.counts(b, edges)
    expected = {
        "bhattacharyya": histograms.bhattacharyya(*pair),
        "kullback_leibler": histograms.kullback_leibler(*pair),
        "jensen_shannon": histograms.jensen_shannon(*pair),
        "wasserstein": stats.wasserstein_distance(a, b),
        "kolmogorov_smirnov": stats.ks_2samp(a, b).statistic,
        "energy_distance": stats.energy_distance(a, b),
        "mean_difference": a.mean() - b.mean(),
        "deviation_difference": a.std(ddof=1) - b.std(ddof=1),
        "percentile_5_difference": np.percentile(a, 5) - np.percentile(b, 5),
        "percentile_95_difference": np.percentile(a, 95) - np.percentile(b, 95),
    }
    found = permutation_tests(a, b, seed=0, permutations=10)
    assert tuple(one.name for one in found) == INDICES == tuple(expected)
    for one in found:
        assert one.value == pytest.approx(expected[one.name], rel=1e-9, abs=1e-11), one.name


def test_floors_and_p_values_tend_to_those_of_all_permutations():
    a, b = np.array([0.1, 0.9, 1.7, 2.0, 3.1]), np.array([1.2, 2.6, 3.3, 4.0])
    pooled = np.concatenate([a, b])
    edges = histograms.bin_edges(pooled, bins=3)
    measures = {
        "wasserstein": distances.wasserstein,
        "kolmogorov_smirnov": distances.kolmogorov_smirnov,
        "energy_distance": distances.energy_distance,
        "mean_difference": lambda u, v: abs(u.mean() - v.mean()),
        "deviation_difference": lambda u, v: abs(u.std(ddof=1) - v.std(ddof=1)),
        "percentile_95_difference": lambda u, v: abs(np.percentile(u, 95) - np.percentile(v, 95)),
        "bhattacharyya": lambda u, v: float(
            histograms.bhattacharyya(histograms.counts(u, edges), histograms.counts(v, edges))
        ),
    }
    permutations = 20_000
    found = by_name(permutation_tests(a, b, seed=5, permutations=permutations, bins=3))
    deals = [(pooled[list(c)], np.delete(pooled, c)) for c in itertools.combinations(range(9), 5)]
    for name, measure in measures.items():
        sizes = np.array([measure(*deal) for deal in deals])
        sign = -1.0 if name == "bhattacharyya" else 1.0
        exact = np.mean(sign * sizes >= sign * measure(a, b) - 1e-12)
        one = found[name]
        assert one.p == pytest.approx(exact, abs=4 * math.sqrt(exact * (1 - exact) / permutations)), name
        assert one.floor_mean == pytest.approx(sizes.mean(), abs=4 * sizes.std() / math.sqrt(permutations)), name
        # The limit leaves at most 5 % beyond it, and what lies just within it is more than that.
        assert np.mean(sign * sizes > sign * one.floor_limit + 1e-9) <= 0.056
        assert np.mean(sign * sizes >= sign * one.floor_limit - 1e-9) >= 0.044


def test_the_least_p_is_one_over_the_draws_and_one():
    a = np.arange(60.0)
    found = by_name(permutation_tests(a, a + 1000.0, seed=1, permutations=99))
    for name in ("bhattacharyya", "wasserstein", "kolmogorov_smirnov", "energy_distance", "mean_difference"):
        assert found[name].p == 0.01, name
    same = by_name(permutation_tests(a, a, seed=1, permutations=99))
    for name in ("bhattacharyya", "wasserstein", "kolmogorov_smirnov", "energy_distance", "mean_difference"):
        assert same[name].p == 1.0, name


def test_floor_of_the_specification():
    # 150 and 150 of one population in 20 bins: a BC near 1 - 19/600 = 0.97.
    generator = np.random.default_rng(0)
    one = by_name(permutation_tests(*generator.uniform(size=(2, 150)), seed=0, permutations=500, bins=20))
    assert one["bhattacharyya"].floor_mean == pytest.approx(1 - 19 / 600, abs=4e-3)
    assert one["bhattacharyya"].floor_limit < one["bhattacharyya"].floor_mean
    assert one["jensen_shannon"].floor_mean == pytest.approx(19 / 600, abs=4e-3)


def test_size_and_power_by_simulation():
    # Under one population p <= 0.05 in 5 % of pairs (10 of 200), under a shift of 1 s nearly always.
    generator, trials = np.random.default_rng(77), 800
    hits, found_shifts = dict.fromkeys(INDICES, 0), dict.fromkeys(INDICES, 0)
    for trial in range(trials):
        a, b = generator.gamma(3.0, size=(2, 40))
        for one in permutation_tests(a, b, seed=trial, permutations=199):
            hits[one.name] += one.p <= 0.05
        if trial < 60:
            for one in permutation_tests(a, b + math.sqrt(3.0), seed=trial, permutations=199):
                found_shifts[one.name] += one.p <= 0.05
    for name, count in hits.items():
        # Indices of few different values (counts in bins, order statistics) reject a little less often than they may.
        assert count <= stats.binom(trials, 0.05).ppf(1 - 1e-4), name
        assert count >= stats.binom(trials, 0.03).ppf(1e-4), name
    for name in ("wasserstein", "energy_distance", "mean_difference"):
        assert within_binomial(hits[name], trials, 0.05), name
    for name in ("wasserstein", "kolmogorov_smirnov", "energy_distance", "mean_difference"):
        assert found_shifts[name] >= 54, name


def test_size_by_simulation_where_the_numbers_of_each_class_were_chosen():
    # Four classes of 20 whose means lie 2 s apart: free deals never reject, deals within classes do so in 5 %.
    generator, trials, names = np.random.default_rng(78), 400, np.repeat(list("abcd"), 20)
    free = kept = joint = 0
    for trial in range(trials):
        a, b = 2.0 * np.repeat(np.arange(4), 20) + generator.normal(size=(2, 80))
        options = {"seed": trial, "permutations": 199}
        free += by_name(permutation_tests(a, b, **options))["mean_difference"].p <= 0.05
        kept += by_name(permutation_tests(a, b, **options, strata=(names, names)))["mean_difference"].p <= 0.05
        joint += joint_energy_test(a[:, None], b[:, None], **options, strata=(names, names)).p <= 0.05
    assert free == 0
    assert within_binomial(kept, trials, 0.05)
    assert within_binomial(joint, trials, 0.05)


def test_deals_within_classes_against_all_of_them():
    a, b = np.array([0.0, 1.0, 7.0, 8.5]), np.array([0.5, 2.5, 6.0, 7.3])
    options = {"seed": 4, "permutations": 20_000}
    found = by_name(permutation_tests(a, b, **options, strata=("llhh", "llhh")))["mean_difference"]
    low, high = np.array([0.0, 1.0, 0.5, 2.5]), np.array([7.0, 8.5, 6.0, 7.3])
    pairs = list(itertools.combinations(range(4), 2))
    sizes = np.array([
        abs(2 * (low[list(i)].sum() + high[list(j)].sum()) - low.sum() - high.sum()) / 4 for i in pairs for j in pairs
    ])  # fmt: skip
    exact = np.mean(sizes >= abs(a.mean() - b.mean()) - 1e-12)
    assert found.p == pytest.approx(exact, abs=4 * math.sqrt(exact * (1 - exact) / 20_000))
    assert found.floor_mean == pytest.approx(sizes.mean(), abs=4 * sizes.std() / math.sqrt(20_000))


def test_permutation_of_the_mean_agrees_with_anova():
    generator = np.random.default_rng(12)
    a, b = generator.normal(0.0, 1, 150), generator.normal(0.15, 1, 150)
    p = anova([a, b]).p
    found = by_name(permutation_tests(a, b, seed=3, permutations=10_000))
    assert 0.01 < p < 0.9
    assert found["mean_difference"].p == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / 10_000) + 2e-3)


# ------------------------------------------------------------------------------------------------ bootstrap


def test_estimates_are_those_of_the_plain_functions():
    generator = np.random.default_rng(14)
    a, b = np.round(generator.normal(7, 1, 45), 1), np.round(generator.normal(6.5, 2, 60), 1)
    found = by_name(bootstrap_estimates(a, b, seed=0, bootstrap=200))
    assert tuple(found) == ESTIMATES
    for name in ("cohen_d", "hedges_g", "superiority", "cliff_delta"):
        assert found[name].value == pytest.approx(getattr(resampling, name)(a, b), rel=1e-10)
    assert found["mean_difference"].value == pytest.approx(a.mean() - b.mean(), rel=1e-12)
    for q in (5, 95):
        expected = np.percentile(a, q) - np.percentile(b, q)
        assert found[f"percentile_{q}_difference"].value == pytest.approx(expected, rel=1e-12)
    assert all(one.low < one.value < one.high for one in found.values())


def test_replicates_are_measured_as_samples_are():
    # Ranks of a replicate, by the function that sees blocks of them, against the plain functions on its values.
    generator = np.random.default_rng(15)
    x, y = np.sort(generator.integers(0, 30, 25) / 8.0), np.sort(generator.integers(5, 40, 31) / 8.0)
    sides = np.searchsorted(y, x, side="left"), np.searchsorted(y, x, side="right")
    u, v = resampling._draw(generator, 6, 25), resampling._draw(generator, 6, 31)
    found = dict(zip(ESTIMATES, resampling._evaluate(x, y, sides, u, v), strict=True))
    for i in range(6):
        pair = x[u[i]], y[v[i]]
        for name in ("cohen_d", "hedges_g", "superiority", "cliff_delta"):
            assert found[name][i] == pytest.approx(getattr(resampling, name)(*pair), rel=1e-12, abs=1e-13)
        tails = [np.percentile(side, 95) for side in pair]
        assert found["percentile_95_difference"][i] == pytest.approx(tails[0] - tails[1], rel=1e-12, abs=1e-13)


def test_interval_of_the_mean_against_normal_theory():
    generator = np.random.default_rng(16)
    a, b = generator.normal(0, 1, 600), generator.normal(0.1, 1.2, 600)
    one = by_name(bootstrap_estimates(a, b, seed=2, bootstrap=20_000))["mean_difference"]
    error = math.sqrt((a.var() + b.var()) / 600)
    assert one.high - one.low == pytest.approx(2 * 1.95996 * error, rel=0.03)
    assert 0.5 * (one.low + one.high) == pytest.approx(one.value, abs=0.05 * error)


def test_coverage_by_simulation():
    # 95 % intervals hold the truth of normals 0 and 0.5, s = 1.
    generator, trials = np.random.default_rng(18), 1000
    truth = {
        "mean_difference": -0.5,
        "cohen_d": -0.5,
        "hedges_g": -0.5,
        "superiority": stats.norm.cdf(-0.5 / math.sqrt(2)),
        "cliff_delta": 2 * stats.norm.cdf(-0.5 / math.sqrt(2)) - 1,
        "percentile_5_difference": -0.5,
        "percentile_95_difference": -0.5,
    }
    hits = dict.fromkeys(ESTIMATES, 0)
    for trial in range(trials):
        a, b = generator.normal(0, 1, 150), generator.normal(0.5, 1, 150)
        for one in bootstrap_estimates(a, b, seed=trial, bootstrap=399):
            hits[one.name] += one.low <= truth[one.name] <= one.high
    for name, count in hits.items():
        # Measured with 2,000 trials: 94.8 to 95.4 %, of the percentiles 96.7 %.
        chance = 0.965 if name.startswith("percentile") else 0.95
        assert within_binomial(count, trials, chance), (name, count)


def test_replicates_without_spread_make_an_end_infinite_and_not_nan():
    found = by_name(bootstrap_estimates([0.0, 1.0], [5.0, 6.0], seed=0, bootstrap=500))
    assert found["cohen_d"].low == -math.inf
    assert not any(math.isnan(end) for one in found.values() for end in (one.value, one.low, one.high))


@pytest.mark.parametrize("values", [(1.0, 2.0, 5.0, 6.0), (0.1, 0.2, 0.5, 0.6), (-7.3, -7.2, 1e-3, 0.3)])
def test_replicates_without_spread_are_known_in_spite_of_rounding(values):
    # A replicate of either sample has one value only with a chance of (4/5)^5 = 0.33, both at once in 1 of 9.
    low, high, least, most = values
    a, b = [low] * 4 + [high], [least] * 4 + [most]
    for one, other, sign in ((a, b, -1.0), (b, a, 1.0)):
        found = by_name(bootstrap_estimates(one, other, seed=0, bootstrap=500))
        for name in ("cohen_d", "hedges_g"):
            ends = found[name].low, found[name].high
            assert math.inf * sign in ends
            assert 0.0 < min(map(abs, ends)) < 1e3
    # Where both have the same value only, they do not differ.
    found = by_name(bootstrap_estimates(a, [*a, low], seed=0, bootstrap=500))
    assert all(-1e3 < end < 1e3 for end in (found["hedges_g"].low, found["hedges_g"].high))


# ------------------------------------------------------------------------------------------------ joint tests


def energy_by_definition(a, b):
    mean = lambda u, v: np.linalg.norm(u[:, None] - v, axis=2).mean()  # noqa: E731
    return math.sqrt(2 * mean(a, b) - mean(a, a) - mean(b, b))


def test_joint_statistics_by_their_definitions():
    generator = np.random.default_rng(20)
    a, b = generator.normal(size=(70, 3)) * [1, 10, 0.01], generator.normal(0.4, 1, (50, 3)) * [1, 10, 0.01]
    pooled = np.concatenate([a, b])
    u, v = (side / pooled.std(axis=0, ddof=1) for side in (a, b))
    found = joint_energy_test(a, b, seed=0, permutations=20)
    assert found.value == pytest.approx(energy_by_definition(u, v), rel=1e-8)
    kernel = lambda x, y, h: np.exp(-(np.linalg.norm(x[:, None] - y, axis=2) ** 2) / (2 * h * h)).mean()  # noqa: E731
    found = joint_mmd_test(a, b, seed=0, permutations=20)
    h = found.scale
    pairs = np.linalg.norm((pooled[:, None] - pooled) / pooled.std(axis=0, ddof=1), axis=2)
    assert h == pytest.approx(np.median(pairs[np.triu_indices(120, 1)]), rel=1e-12)
    assert found.value**2 == pytest.approx(kernel(u, u, h) + kernel(v, v, h) - 2 * kernel(u, v, h), rel=1e-7)


def test_joint_energy_of_one_descriptor_is_that_of_the_line():
    generator = np.random.default_rng(22)
    a, b = generator.gamma(2, size=60), generator.gamma(3, size=80)
    deviation = np.concatenate([a, b]).std(ddof=1)
    found = joint_energy_test(a[:, None], b[:, None], seed=4, permutations=500)
    assert found.value == pytest.approx(distances.energy_distance(a / deviation, b / deviation), rel=1e-8)
    line = by_name(permutation_tests(a, b, seed=8, permutations=500))["energy_distance"]
    assert found.floor_mean == pytest.approx(line.floor_mean / math.sqrt(deviation), rel=0.1)


def test_joint_floor_against_its_expectation():
    # E of the squared V-statistic over all deals: (1/n + 1/m) times the mean distance of two different particles.
    generator = np.random.default_rng(23)
    a, b = generator.normal(size=(2, 40, 2))
    pooled = np.concatenate([a, b])
    pooled /= pooled.std(axis=0, ddof=1)
    mean = np.linalg.norm(pooled[:, None] - pooled, axis=2).sum() / (80 * 79)
    found = joint_energy_test(a, b, seed=1, permutations=4000)
    # The floor is the mean of the root, a little less than the root of the mean.
    assert 0.95 * math.sqrt(mean / 20) < found.floor_mean < math.sqrt(mean / 20)


def test_joint_tests_see_what_margins_do_not():
    # Equal margins, correlation 0.8 against -0.8.
    generator = np.random.default_rng(24)
    a, b = (generator.multivariate_normal([0, 0], [[1, r], [r, 1]], 150) for r in (0.8, -0.8))
    found = compare_joint(a, b, seed=0, permutations=499)
    assert found.energy.p == found.mmd.p == 1 / 500
    for i in range(2):
        line = by_name(permutation_tests(a[:, i], b[:, i], seed=i, permutations=499))
        assert line["energy_distance"].p > 0.05


def test_size_of_the_joint_tests_by_simulation():
    generator, trials = np.random.default_rng(26), 300
    hits = np.zeros(2, dtype=int)
    for trial in range(trials):
        a, b = generator.gamma(2.0, size=(2, 30, 3))
        hits[0] += joint_energy_test(a, b, seed=trial, permutations=199).p <= 0.05
        hits[1] += joint_mmd_test(a, b, seed=trial, permutations=199).p <= 0.05
    assert all(within_binomial(count, trials, 0.05) for count in hits)


# ------------------------------------------------------------------------------------------------ collected


def test_comparison_collects_what_the_parts_give():
    generator = np.random.default_rng(30)
    a, b = generator.normal(0.65, 0.02, 90), generator.normal(0.64, 0.025, 70)
    found = compare_samples(a, b, seed=0, permutations=200, bootstrap=200, level=0.9)
    assert found.sizes == (90, 70)
    assert found.means == (a.mean(), b.mean())
    assert found.deviations == (a.std(ddof=1), b.std(ddof=1))
    assert found.anova == anova([a, b], level=0.9)
    np.testing.assert_array_equal(found.counts, [np.histogram(side, found.edges)[0] for side in (a, b)])
    assert found.index("bhattacharyya").value == histograms.bhattacharyya(*found.counts)
    assert found.estimate("cohen_d").value == pytest.approx(resampling.cohen_d(a, b), rel=1e-12)
    assert found.estimate("cohen_d").level == 0.9
    assert repr(pickle.loads(pickle.dumps(found))) == repr(found)
    with pytest.raises(SampleError, match=r"^expected one of bhattacharyya, .*'nothing'\.$"):
        found.index("nothing")
    with pytest.raises(ValueError, match="read-only"):
        found.counts[0, 0] = 1


def test_populations_by_class():
    generator = np.random.default_rng(31)
    a, b = generator.normal(size=(2, 120, 2))
    kinds = np.repeat(["plate", "cube"], 60)
    b[:60, 1] += 2.0
    found = compare_populations(a, b, ["R", "B"], classes=(kinds, kinds[::-1]), seed=7, permutations=199, bootstrap=50)
    assert [one.name for one in (found.pooled, *found.classes)] == [None, "cube", "plate"]
    cube, plate = found.classes
    assert cube.descriptors[1].means == (a[60:, 1].mean(), b[:60, 1].mean())
    adjusted = found.adjusted()
    assert adjusted.shape == (3, 3)
    assert cube.joint.energy.p == 1 / 200
    assert plate.joint.energy.p > 0.05
    # The shifted descriptor of the cubes, and with it the pooled one and both joint tests: the least p of 9, times 9.
    assert adjusted[1, 1] == adjusted[1, 2] == pytest.approx(9 / 200)
    raw = np.array([
        [*(one.index("energy_distance").p for one in g.descriptors), g.joint.energy.p]
        for g in (found.pooled, *found.classes)
    ])  # fmt: skip
    assert (adjusted >= raw).all()


def test_of_one_descriptor_the_joint_test_is_not_counted_twice():
    a, b = np.random.default_rng(35).normal(size=(2, 30, 1))
    found = compare_populations(a, b, ["R"], seed=7, permutations=99, bootstrap=10)
    assert found.adjusted().tolist() == [[found.pooled.descriptors[0].index("energy_distance").p] * 2]


_BYTES = """
import hashlib, numpy as np
from lithoform.statistics.comparison import compare_populations
r = np.random.default_rng(1)
a, b = r.normal(size=(2, 130, 3))
found = compare_populations(a, b, "xyz", seed=0, permutations=300, bootstrap=100)
print(hashlib.sha256(repr([(d.indices, d.estimates, d.anova) for d in found.pooled.descriptors]
      + [found.pooled.joint]).encode()).hexdigest())
"""


def test_same_bytes_whatever_the_threads():
    told = {
        subprocess.run(
            [sys.executable, "-c", _BYTES],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for threads in ("1", "2", "3")
    }
    assert len(told) == 1


def test_seeds_matter_and_0_is_one_of_them():
    a, b = np.random.default_rng(33).normal(size=(2, 50))
    first, again, other = (permutation_tests(a, b, seed=seed, permutations=100) for seed in (0, 0, 1))
    assert first == again
    assert first != other
    first, again, other = (bootstrap_estimates(a, b, seed=seed, bootstrap=100) for seed in (0, 0, 1))
    assert first == again
    assert first != other


def test_indices_do_not_depend_on_the_unit():
    a, b = np.random.default_rng(34).normal(2.0, 0.3, size=(2, 80))
    plain, scaled = (by_name(permutation_tests(f * a, f * b, seed=0, permutations=200)) for f in (1.0, 1024.0))
    for name, one in plain.items():
        assert scaled[name].p == one.p
        power = {"bhattacharyya": 0, "kullback_leibler": 0, "jensen_shannon": 0, "kolmogorov_smirnov": 0}.get(name, 1)
        factor = 32.0 if name == "energy_distance" else 1024.0**power
        assert scaled[name].value == pytest.approx(factor * one.value, rel=1e-12)


def test_the_kernel_scale_where_most_values_are_alike():
    # 18 values are 0, the others 1 and 3: the distances above 0 are 1 and 3, each 18 times, and one of 2,
    # which is their median, over the pooled standard deviation.
    a, b = [[0.0]] * 9 + [[1.0]], [[0.0]] * 9 + [[3.0]]
    found = joint_mmd_test(a, b, seed=0, permutations=50)
    deviation = np.std([0.0] * 18 + [1.0, 3.0], ddof=1)
    assert found.scale == pytest.approx(2.0 / deviation, rel=1e-12)
    assert 0.0 < found.p <= 1.0


GOOD = [[1.0, 2.0], [3.0, 5.0], [4.0, 1.0]]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: compare_samples([], [1, 2], seed=0), "at least 2 value"),
        (lambda: compare_samples([1], [1, 2], seed=0), "at least 2 value"),
        (lambda: compare_samples([1, math.nan], [1, 2], seed=0), "1 NaN or infinite"),
        (lambda: compare_samples([1, math.inf], [1, 2], seed=0), "1 NaN or infinite"),
        (lambda: compare_samples([1, 2], [3, 3, 3], seed=0), "vary in the second sample, got 3 times 3"),
        (lambda: compare_samples([1, 2], [3, 4], seed=-1), "seed that is a whole number"),
        (lambda: compare_samples([1, 2], [3, 4], seed=1.5), "seed that is a whole number"),
        (lambda: compare_samples([1, 2], [3, 4], seed=True), "seed that is a whole number"),
        (lambda: compare_samples([1, 2], [3, 4], seed=0, permutations=0), "number of permutations"),
        (lambda: compare_samples([1, 2], [3, 4], seed=0, bootstrap=0), "number of bootstrap"),
        (lambda: compare_samples([1, 2], [3, 4], seed=0, level=1.0), "level between 0 and 1"),
        (lambda: compare_joint([1, 2], [3, 4], seed=0), "rows of particles"),
        (lambda: compare_joint(GOOD, [[1.0], [2.0]], seed=0), "same descriptors"),
        (lambda: compare_joint([[1, 1], [2, 1]], [[3, 1], [4, 1]], seed=0), "column 1 all 1"),
        (lambda: compare_joint(GOOD, [[1, 2], [math.nan, 2]], seed=0), "1 NaN or infinite"),
        (lambda: compare_joint(GOOD, GOOD, seed=0, strata=("aab", "aa")), "class for each particle"),
        (lambda: compare_samples([1, 2], [3, 4], seed=0, strata=("a", "ab")), "class for each particle"),
        (lambda: joint_mmd_test(GOOD, GOOD, seed=0, scale=0.0), "scale above 0"),
        (lambda: compare_populations(GOOD, GOOD, ["R"], seed=0), "name for each column"),
        (lambda: compare_populations(GOOD, GOOD, "RB", seed=0, classes=(["a"], ["a"])), "class for each particle"),
        (lambda: compare_populations(GOOD, GOOD, "RB", seed=0, classes=("aab", "aaa")), "same classes"),
    ],
)
def test_errors_say_what_was_expected(call, said):
    with pytest.raises(SampleError, match=rf"^expected .*{said}.*\.$"):
        call()
