"""Indices, distances and effect sizes against closed forms and scipy; the paper's tables made again from each other."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from lithoform.errors import LithoformError, SampleError
from lithoform.statistics.anova import anova, anova_from_mean_squares, equivalence
from lithoform.statistics.distances import energy_distance, kolmogorov_smirnov, wasserstein
from lithoform.statistics.histograms import bhattacharyya, bin_edges, counts, jensen_shannon, kullback_leibler
from lithoform.statistics.multiplicity import holm
from lithoform.statistics.normals import normal_bhattacharyya, normal_jensen_shannon, normal_kullback_leibler
from lithoform.statistics.resampling import cliff_delta, cohen_d, hedges_g, superiority

NORMALS = [
    ((0.0, 1.0), (0.0, 1.0)),
    ((0.0, 1.0), (0.5, 1.3)),
    ((0.6513, 0.0223), (0.6482, 0.0257)),
    ((2.0, 0.5), (-1, 2)),
]

samples = st.lists(st.integers(-40, 40), min_size=2, max_size=30).map(lambda row: np.array(row) / 8.0)
histograms = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=2, max_size=12).filter(
    lambda pairs: all(sum(side) for side in zip(*pairs, strict=True))
)


# ------------------------------------------------------------------------------------------------ histogram indices


@pytest.mark.parametrize(("p", "q"), NORMALS)
def test_indices_of_normals_against_quadrature(p, q):
    f, g = stats.norm(*p).pdf, stats.norm(*q).pdf
    low = min(m - 12 * s for m, s in (p, q))
    high = max(m + 12 * s for m, s in (p, q))

    def integral(density):
        return integrate.quad(density, low, high, points=[p[0], q[0]], limit=400, epsabs=1e-12)[0]

    def entropy(u, v):
        return 0.0 if u == 0.0 else u * math.log(u / v)

    assert normal_bhattacharyya(p, q) == pytest.approx(integral(lambda x: math.sqrt(f(x) * g(x))), abs=1e-9)
    log_ratio = lambda x: stats.norm(*p).logpdf(x) - stats.norm(*q).logpdf(x)  # noqa: E731
    assert normal_kullback_leibler(p, q) == pytest.approx(integral(lambda x: f(x) * log_ratio(x)), rel=1e-8, abs=1e-9)
    mixed = integral(lambda x: 0.5 * sum(entropy(u, 0.5 * (f(x) + g(x))) for u in (f(x), g(x))))
    assert normal_jensen_shannon(p, q) == pytest.approx(mixed, abs=1e-9)


@pytest.mark.parametrize(("p", "q"), NORMALS)
def test_histograms_of_large_samples_tend_to_the_closed_forms(p, q):
    # The samples are the quantiles of the normals, so that what is left is the width of the bins alone.
    u = (np.arange(400_000) + 0.5) / 400_000
    x, y = stats.norm(*p).ppf(u), stats.norm(*q).ppf(u)
    edges = bin_edges(np.concatenate([x, y]), bins=400)
    pair = counts(x, edges), counts(y, edges)
    assert bhattacharyya(*pair) == pytest.approx(normal_bhattacharyya(p, q), abs=4e-4)
    assert jensen_shannon(*pair) == pytest.approx(normal_jensen_shannon(p, q), abs=4e-4)
    assert kullback_leibler(*pair) == pytest.approx(normal_kullback_leibler(p, q), rel=5e-3, abs=4e-4)


def test_indices_of_known_histograms():
    p, q = [0.5, 0.5, 0.0], [0.25, 0.25, 0.5]
    assert bhattacharyya(p, q) == pytest.approx(math.sqrt(0.5), rel=1e-15)
    assert kullback_leibler(p, q, pseudo_count=0) == pytest.approx(math.log(2), rel=1e-15)
    assert kullback_leibler(q, p, pseudo_count=0) == math.inf
    assert jensen_shannon(p, q) == pytest.approx(0.5 * (math.log(4 / 3) + 0.5 * math.log(2 / 3) + 0.5 * math.log(2)))
    # Half a count more in every bin: (2.5, 0.5) / 3 against (0.5, 2.5) / 3.
    assert kullback_leibler([2, 0], [0, 2]) == pytest.approx(2 / 3 * math.log(5), rel=1e-15)
    assert bhattacharyya([3, 0], [0, 1]) == 0.0
    assert jensen_shannon([3, 0], [0, 1]) == pytest.approx(math.log(2), rel=1e-15)


@settings(deadline=None, max_examples=60)
@given(histograms)
def test_inequalities_between_the_indices(pairs):
    p, q = np.array(pairs).T
    bc, js = bhattacharyya(p, q), jensen_shannon(p, q)
    kl = kullback_leibler(p, q, pseudo_count=0)
    assert math.log(2) * (1 - bc) - 1e-12 <= js <= min(1 - bc, math.log(2)) + 1e-12
    assert js == pytest.approx(jensen_shannon(q, 3 * p), abs=1e-14)
    assert bc == pytest.approx(bhattacharyya(q, 3 * p), abs=1e-14)
    # D >= -2 ln BC (Jensen), and Pinsker's D >= |P - Q|^2 / 2.
    assert kl >= (-2 * math.log(bc) if bc > 0 else math.inf) - 1e-12
    assert kl >= 0.5 * np.abs(p / p.sum() - q / q.sum()).sum() ** 2 - 1e-12
    assert kullback_leibler(p, q) < math.inf


def test_bins_follow_the_stated_rule():
    # 1,000 values spread evenly over 0 to 10: IQR 5, width 2 * 5 / 10 = 1, ten bins.
    assert len(bin_edges(np.linspace(0, 10, 1000))) - 1 == 10
    # Nearly all values in the middle: the rule asks for more than 40; a few values: for fewer than 5.
    assert len(bin_edges(np.r_[-100, np.linspace(-1, 1, 1000), 100])) - 1 == 40
    assert len(bin_edges([0.0, 1.0, 2.0, 3.0])) - 1 == 5
    # Half of the values alike: Scott's width 3.49 s / N^(1/3).
    alike = np.r_[np.zeros(80), np.linspace(-1, 1, 21)]
    width = 3.49 * alike.std(ddof=1) / 101 ** (1 / 3)
    assert len(bin_edges(alike)) - 1 == math.ceil(2 / width) == 10
    np.testing.assert_array_equal(bin_edges([2.0, 0.0], bins=4), [0, 0.5, 1, 1.5, 2])


def test_counts_are_those_of_numpy():
    values = np.random.default_rng(5).integers(0, 17, 500) / 16.0
    edges = np.linspace(0, 1, 9)
    np.testing.assert_array_equal(counts(values, edges), np.histogram(values, edges)[0])


def test_two_samples_of_one_population_do_not_score_1():
    # The remark of the specification: 150 and 150 in 20 bins score a BC near 1 - 19/600 = 0.97 (to order 1/n).
    generator = np.random.default_rng(11)
    for n, tolerance in ((150, 0.1), (15_000, 0.02)):
        pairs = generator.multinomial(n, np.full(20, 0.05), (2, 4000))
        assert 1 - bhattacharyya(*pairs).mean() == pytest.approx(19 / (4 * n), rel=tolerance)
        assert jensen_shannon(*pairs).mean() == pytest.approx(19 / (4 * n), rel=tolerance)


# ------------------------------------------------------------------------------------------------ analysis of variance

# Shape, between and within mean square, F, p, eta squared, interval: Tables 3 (n 600 + 600), 4 and 5 (n 150 + 150).
TABLES = [
    ("R", 600, 0.002851, 0.0005796, 4.92, 0.02673, 0.0041, 0.000356, 0.00581),
    ("B", 600, 0.01114, 0.00116, 9.6037, 0.001987, 0.008, 0.002236, 0.009952),
    ("S3D", 600, 0.001725, 0.00009657, 17.8645, 0.00002552, 0.015, 0.001285, 0.003511),
    ("TS", 600, 0.01239, 0.002693, 4.6008, 0.03216, 0.0038, 0.0005492, 0.0123),
    ("R cube", 150, 0.0007956, 0.0002028, 3.9231, 0.04855, 0.0130, 0.00002094, 0.006493),
    ("R plate", 150, 0.000364, 0.00007199, 5.056, 0.02527, 0.017, 0.0002749, 0.004131),
    ("R column", 150, 0.0003892, 0.00009504, 4.0953, 0.04389, 0.01356, 0.00006273, 0.004493),
    ("R blade", 150, 0.0009083, 0.0001589, 5.7151, 0.01744, 0.0188, 0.0006153, 0.006345),
    ("TS cube", 150, 0.002619, 0.0005166, 5.0687, 0.02509, 0.017, 0.0007439, 0.01107),
    ("TS plate", 150, 0.003034, 0.0007534, 4.0267, 0.04569, 0.013, 0.0001227, 0.0126),
    ("TS column", 150, 0.003591, 0.000894, 4.0174, 0.04594, 0.013, 0.0001256, 0.01371),
    ("TS blade", 150, 0.003878, 0.0008808, 4.4033, 0.03671, 0.015, 0.000447, 0.01393),
]


@pytest.mark.parametrize("row", TABLES, ids=lambda row: row[0])
def test_the_papers_tables_follow_from_their_mean_squares(row):
    _, n, between, within, f, p, eta, low, high = row
    found = anova_from_mean_squares(between, within, (n, n))
    # Mean squares are printed to four digits, the error of boxiness to three.
    assert found.f == pytest.approx(f, rel=5e-4)
    assert found.p == pytest.approx(p, rel=3e-3)
    assert found.eta_squared == pytest.approx(eta, abs=6e-4)
    assert found.mean_difference is not None
    assert found.mean_difference == pytest.approx(0.5 * (low + high), rel=2e-3)
    assert found.interval == pytest.approx((low, high), rel=5e-3, abs=2e-6)


@pytest.mark.parametrize(("between", "total", "printed"), [(0.0007956, 0.06123, 0.0013), (0.0003892, 0.02871, 0.0014)])
def test_two_etas_of_table_4_are_ten_times_too_small(between, total, printed):
    # Cube and column: the table's own sums of squares give ten times what it prints.
    assert between / total == pytest.approx(10 * printed, rel=0.04)


def test_one_eta_of_table_4_is_a_p_value():
    # Blade: the sums of squares give 0.0188; the printed 0.0174 repeats the p-value 0.01744 of the same row.
    found = 0.0009083 / 0.04827
    assert found == pytest.approx(0.0188, abs=5e-5)
    assert anova_from_mean_squares(0.0009083, 0.0001589, (150, 150)).p == pytest.approx(0.0174, abs=1e-4)


def test_the_papers_coefficients_are_those_of_its_moments_less_the_noise_of_some_twenty_to_thirty_bins():
    # 1 - BC of histograms exceeds that of the populations by about (K - 1) / 2400 with 600 and 600.
    moments = [
        (0.9840, (0.6513, 0.0223), (0.6482, 0.0257)),
        (0.9824, (0.4158, 0.0334), (0.4097, 0.0347)),
        (0.9822, (0.8924, 0.0097), (0.8948, 0.0101)),
        (0.9895, (0.8017, 0.0518), (0.8081, 0.0520)),
    ]
    for printed, scan, generated in moments:
        bins = 1 + 2400 * (normal_bhattacharyya(scan, generated) - printed)
        assert 20 < bins < 34


def test_the_papers_error_mean_squares_are_its_deviations():
    for within, s, t in ((0.0005796, 0.0223, 0.0257), (0.00116, 0.0334, 0.0347), (0.002693, 0.0518, 0.0520)):
        assert 0.5 * (s * s + t * t) == pytest.approx(within, rel=4e-3)


def test_the_papers_divergences_are_in_nats():
    # JS lies from (1 - BC) ln 2 to 1 - BC in nats; in bits it would lie from 1 - BC up.
    for bc, js in ((0.9840, 0.0139), (0.9824, 0.0173), (0.9822, 0.0167), (0.9895, 0.0099)):
        assert math.log(2) * (1 - bc) <= js <= 1 - bc


@pytest.mark.parametrize("sizes", [(40, 25), (9, 30, 14), (3, 3, 3, 3, 2)])
def test_anova_against_scipy(sizes):
    generator = np.random.default_rng(sum(sizes))
    groups = [1e3 + 0.3 * i + generator.normal(size=size) for i, size in enumerate(sizes)]
    found, oracle = anova(groups), stats.f_oneway(*groups)
    assert (found.f, found.p) == pytest.approx((oracle.statistic, oracle.pvalue), rel=1e-9)
    pooled = np.concatenate(groups)
    between = sum(len(one) * (one.mean() - pooled.mean()) ** 2 for one in groups)
    assert found.eta_squared == pytest.approx(between / ((pooled - pooled.mean()) ** 2).sum(), rel=1e-9)
    again = anova_from_mean_squares(found.between_mean_square, found.within_mean_square, sizes)
    assert (again.f, again.p, again.omega_squared) == (found.f, found.p, found.omega_squared)
    assert (found.mean_difference is None) == (found.interval is None) == (len(sizes) != 2)


@pytest.mark.parametrize("level", [0.9, 0.95, 0.99])
def test_interval_of_the_mean_difference_against_scipy(level):
    generator = np.random.default_rng(3)
    a, b = generator.normal(0.2, 1, 31), generator.normal(0, 1, 17)
    oracle = stats.ttest_ind(a, b).confidence_interval(level)
    found = anova([a, b], level=level)
    assert found.interval == pytest.approx((oracle.low, oracle.high), rel=1e-10)
    assert found.mean_difference == pytest.approx(a.mean() - b.mean(), rel=1e-12)


def test_groups_without_spread_differ_for_certain():
    found = anova([[1.0, 1.0], [2.0, 2.0]])
    assert (found.f, found.p, found.eta_squared, found.interval) == (math.inf, 0.0, 1.0, (-1.0, -1.0))


def test_omega_squared_is_nearly_without_bias_and_eta_squared_is_not():
    groups = np.random.default_rng(8).normal(size=(2000, 4, 10))
    found = [anova(list(one)) for one in groups]
    # E eta^2 = (k - 1) / (N - 1) = 3 / 39 where all means are one.
    assert np.mean([one.eta_squared for one in found]) == pytest.approx(3 / 39, abs=4e-3)
    assert abs(np.mean([one.omega_squared for one in found])) < 4e-3


def test_equivalence_against_scipys_two_one_sided_tests():
    generator = np.random.default_rng(21)
    a, b = generator.normal(0.1, 1.0, 80), generator.normal(0.0, 1.4, 60)
    for margin in (0.1, 0.5, 1.0):
        found = equivalence(a, b, margin=margin)
        above = stats.ttest_ind(a, b - margin, equal_var=False, alternative="greater").pvalue
        below = stats.ttest_ind(a, b + margin, equal_var=False, alternative="less").pvalue
        assert found.p == pytest.approx(max(above, below), rel=1e-9)
        assert equivalence(b, a, margin=margin).p == pytest.approx(found.p, rel=1e-12)
        inside = -margin < found.interval[0] and found.interval[1] < margin
        assert found.is_equivalent == inside == (found.p < 0.05)
    assert found.is_equivalent


# ------------------------------------------------------------------------------------------------ distances, effects


@settings(deadline=None, max_examples=60)
@given(samples, samples)
def test_distances_against_scipy(a, b):
    assert wasserstein(a, b) == pytest.approx(stats.wasserstein_distance(a, b), abs=1e-12)
    assert energy_distance(a, b) == pytest.approx(stats.energy_distance(a, b), abs=1e-7)
    assert kolmogorov_smirnov(a, b) == pytest.approx(stats.ks_2samp(a, b, method="asymp").statistic, abs=1e-12)


@settings(deadline=None, max_examples=40)
@given(samples, st.integers(-9, 9), st.sampled_from([0.5, 2.0, 8.0]))
def test_distances_of_a_shift_and_of_a_scale(a, shift, factor):
    b = a[::-1] ** 2 / 5.0
    assert wasserstein(a, a + shift) == pytest.approx(abs(shift), abs=1e-12)
    assert wasserstein(factor * a + shift, factor * b + shift) == pytest.approx(factor * wasserstein(a, b), abs=1e-9)
    assert energy_distance(factor * a, factor * b) == pytest.approx(math.sqrt(factor) * energy_distance(a, b), abs=1e-9)
    assert kolmogorov_smirnov(factor * a, factor * b) == kolmogorov_smirnov(a, b)
    assert wasserstein(a, b) == wasserstein(b, a)
    assert wasserstein(a, a) == energy_distance(a, a) == kolmogorov_smirnov(a, a) == 0.0


def test_energy_distance_by_its_definition():
    generator = np.random.default_rng(2)
    a, b = generator.normal(size=30), generator.gamma(2.0, size=22)
    mean = lambda u, v: np.abs(u[:, None] - v).mean()  # noqa: E731
    assert energy_distance(a, b) ** 2 == pytest.approx(2 * mean(a, b) - mean(a, a) - mean(b, b), rel=1e-12)


def test_effect_sizes_by_their_definitions():
    generator = np.random.default_rng(4)
    a, b = generator.integers(0, 12, 20) / 4.0, generator.integers(0, 9, 13) / 4.0
    pooled = math.sqrt((19 * a.var(ddof=1) + 12 * b.var(ddof=1)) / 31)
    assert cohen_d(a, b) == pytest.approx((a.mean() - b.mean()) / pooled, rel=1e-12)
    assert hedges_g(a, b) == pytest.approx(cohen_d(a, b) * (1 - 3 / (4 * 31 - 1)), rel=2e-4)
    pairs = np.sign(a[:, None] - b)
    assert cliff_delta(a, b) == pytest.approx(pairs.mean(), rel=1e-12)
    assert superiority(a, b) == pytest.approx(stats.mannwhitneyu(a, b).statistic / (20 * 13), rel=1e-12)
    # Hedges' factor at 2 degrees of freedom: Gamma(1) / (sqrt(1) Gamma(1/2)) = 1 / sqrt(pi).
    assert hedges_g([0, 1], [0, 3]) == pytest.approx(cohen_d([0, 1], [0, 3]) / math.sqrt(math.pi), rel=1e-14)


def test_hedges_g_has_no_bias_and_cohens_d_has():
    generator = np.random.default_rng(6)
    pairs = [(generator.normal(1, 1, 5), generator.normal(0, 1, 5)) for _ in range(4000)]
    d, g = (np.array([effect(*pair) for pair in pairs]) for effect in (cohen_d, hedges_g))
    error = g.std() / math.sqrt(len(g))
    assert abs(g.mean() - 1.0) < 3 * error
    assert d.mean() - 1.0 > 3 * error


# ------------------------------------------------------------------------------------------------ Holm


def test_holm_by_hand_and_by_its_closed_testing_definition():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    # Closed testing with Bonferroni: the greatest, over all families with the test, of the least p times the size.
    p = np.random.default_rng(1).uniform(0, 0.5, 6)
    families = [f for k in range(1, 7) for f in itertools.combinations(range(6), k)]
    expected = [min(1.0, max(len(f) * p[list(f)].min() for f in families if i in f)) for i in range(6)]
    np.testing.assert_allclose(holm(p), expected)


# ------------------------------------------------------------------------------------------------ errors

TWO_SAMPLES = [wasserstein, kolmogorov_smirnov, energy_distance, cohen_d, superiority, lambda a, b: anova([a, b])]


@pytest.mark.parametrize("function", TWO_SAMPLES)
@pytest.mark.parametrize(
    ("bad", "said"),
    [([], "at least"), ([1.0, math.nan, 3.0], "1 NaN or infinite"), ([[1.0, 2.0]], "one row"), (["a", "b"], "numbers")],
)
def test_unusable_samples_are_told_in_a_sentence(function, bad, said):
    good = [1.0, 2.0, 4.0]
    for pair in ((bad, good), (good, bad)):
        with pytest.raises(SampleError, match=rf"^expected .*{said}.*\.$"):
            function(*pair)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: cohen_d([1.0], [1.0, 2.0]), "at least 2"),
        (lambda: superiority([3.0, 3.0], [1.0, 2.0]), "vary in the first sample, got 2 times 3"),
        (lambda: anova([[1.0, 2.0]]), "two groups"),
        (lambda: anova([[1.0], [2.0]]), "more values than groups"),
        (lambda: anova([[1.0, 1.0], [1.0]]), "vary"),
        (lambda: anova([[1.0, 2.0], [1.0]], level=95), "between 0 and 1"),
        (lambda: anova_from_mean_squares(-1.0, 1.0, (3, 3)), "from 0 up"),
        (lambda: anova_from_mean_squares(1.0, math.nan, (3, 3)), "from 0 up"),
        (lambda: anova_from_mean_squares(1.0, 1.0, (1, 1)), "sizes"),
        (lambda: equivalence([1, 2], [1, 2], margin=0.0), "margin above 0"),
        (lambda: equivalence([1, 1], [2, 2], margin=1.0), "vary"),
        (lambda: bin_edges([1.0, 1.0]), "vary in the pooled sample"),
        (lambda: bin_edges([1.0, 2.0], bins=0), "number of bins"),
        (lambda: bin_edges([1.0, 2.0], bins=True), "number of bins"),
        (lambda: bhattacharyya([1, 2], [1, 2, 3]), "same bins"),
        (lambda: bhattacharyya([0, 0], [1, 2]), "not all of them 0"),
        (lambda: jensen_shannon([-1, 2], [1, 2]), "from 0 up"),
        (lambda: kullback_leibler([1, 2], [1, 2], pseudo_count=-1), "pseudo-count"),
        (lambda: normal_bhattacharyya((0, 0), (0, 1)), "above 0"),
        (lambda: holm([0.5, 1.5]), "from 0 to 1"),
        (lambda: holm([]), "at least 1"),
    ],
)
def test_errors_say_what_was_expected(call, said):
    with pytest.raises(LithoformError, match=rf"^expected .*{said}.*\.$"):
        call()
