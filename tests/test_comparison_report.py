"""The report of two populations: its numbers are those of the comparison, its verdicts follow from them."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from captions import record_captions
from cyclopts import App, CoercionError
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lithoform.cli.comparing import compare
from lithoform.comparison_report import (
    COLUMNS,
    JOINT,
    _former_files,
    as_dict,
    csv_bytes,
    drawings,
    rows,
    screen,
    write_report,
)
from lithoform.database.population import Population
from lithoform.errors import FileFormatError, LithoformError, OutputError, SampleError
from lithoform.report.comparison_page import comparison_page
from lithoform.report.mix import mix_of
from lithoform.report.spread import deviation_ratio
from lithoform.report.study import Study, detectable_shift, study
from lithoform.report.verdicts import KINDS, joint_kind, joint_verdict, mix_notes, verdicts
from lithoform.statistics.comparison import compare_populations

SPACE = "{http://www.w3.org/1999/xhtml}"
FOUR = ("roundness", "boxiness", "solidity", "true_sphericity")
CLASSES = ("cube", "plate", "column", "blade")
# Mean true sphericity by class, as of real stones: a mix moves the pooled mean.
OF_CLASS = {"cube": 0.85, "plate": 0.78, "column": 0.76, "blade": 0.70}


def normal(n: int, mean: float = 0.0, deviation: float = 1.0) -> np.ndarray:
    """Quantiles of a normal distribution: a sample with no scatter of its own."""
    return mean + deviation * stats.norm.ppf((np.arange(n) + 0.5) / n)


def one(values: np.ndarray, label: str = "a", name: str = "roundness") -> Population:
    return Population(label, (name,), np.asarray(values, dtype=float)[:, None])


def told(a: np.ndarray, b: np.ndarray, **options):
    """The verdict on two samples of roundness."""
    found = study(one(a), one(b, "b"), permutations=options.pop("permutations", 400), bootstrap=200, **options)
    return verdicts(found)[0][0]


def stones(sizes: dict[str, int], seed: int, shift: float = 0.0, label: str = "stones") -> Population:
    """Four descriptors of stones of some classes."""
    generator = np.random.default_rng(seed)
    values, classes = [], []
    for name, size in sizes.items():
        block = generator.normal((0.65, 0.41, 0.89, OF_CLASS[name]), (0.024, 0.034, 0.01, 0.02), (size, 4))
        values.append(block + np.array([shift, 0.0, 0.0, 0.0]))
        classes += [name] * size
    return Population(label, FOUR, np.concatenate(values), tuple(classes))


@pytest.fixture(scope="module")
def full() -> Study:
    """40 and 60 stones a class; B is rounder by 0.9 standard deviations."""
    a = stones(dict.fromkeys(CLASSES, 40), 1, label="scans")
    b = stones(dict.fromkeys(CLASSES, 60), 2, shift=0.9 * 0.024, label="generated")
    return study(a, b, permutations=500, bootstrap=300)


@pytest.fixture(scope="module")
def written(full: Study, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    pytest.importorskip("matplotlib")
    return write_report(lambda: full, tmp_path_factory.mktemp("report") / "new" / "folder")[1]


# ------------------------------------------------------------------------------------------------------------- numbers


def test_the_numbers_are_those_of_the_comparison(full: Study) -> None:
    a, b = full.reference, full.other
    expected = compare_populations(
        a.values, b.values, FOUR, seed=0, classes=(a.classes, b.classes), permutations=500, bootstrap=300
    )
    assert full.comparison.classes[0].name == "blade"
    for ours, theirs in zip(full.groups, (expected.pooled, *expected.classes), strict=True):
        assert ours.name == theirs.name
        assert ours.joint == theirs.joint
        for x, y in zip(ours.descriptors, theirs.descriptors, strict=True):
            assert (x.anova, x.indices, x.estimates) == (y.anova, y.indices, y.estimates)
            np.testing.assert_array_equal(x.counts, y.counts)


def test_the_table_holds_the_samples_truths(full: Study) -> None:
    table = list(csv.DictReader(io.StringIO(csv_bytes(full).decode())))
    assert tuple(table[0]) == COLUMNS
    assert [(row["group"], row["descriptor"]) for row in table] == [
        (group, name) for group in ("pooled", *sorted(CLASSES)) for name in (*FOUR, JOINT)
    ]
    for row in table:
        if row["descriptor"] == JOINT:
            continue
        x, y = full.samples(None if row["group"] == "pooled" else row["group"], row["descriptor"])
        assert (int(row["n_a"]), int(row["n_b"])) == (len(x), len(y)) in [(160, 240), (40, 60)]
        assert float(row["mean_a"]) == pytest.approx(x.mean(), rel=1e-14)
        assert float(row["deviation_b"]) == pytest.approx(y.std(ddof=1), rel=1e-12)
        f, p = stats.f_oneway(x, y)
        assert float(row["anova_f"]) == pytest.approx(f, rel=1e-9)
        assert float(row["anova_p"]) == pytest.approx(p, rel=1e-9)
        assert float(row["eta_squared"]) == pytest.approx(f / (f + len(x) + len(y) - 2), rel=1e-9)
        assert float(row["kolmogorov_smirnov"]) == pytest.approx(stats.ks_2samp(x, y).statistic, abs=1e-12)
        assert float(row["wasserstein"]) == pytest.approx(stats.wasserstein_distance(x, y), rel=1e-9)
        edges = np.linspace(min(x.min(), y.min()), max(x.max(), y.max()), int(row["bins"]) + 1)
        first, second = (np.histogram(side, edges)[0] / len(side) for side in (x, y))
        assert float(row["bhattacharyya"]) == pytest.approx(np.sqrt(first * second).sum(), abs=1e-12)
        assert float(row["percentile_95_difference"]) == pytest.approx(
            np.quantile(x, 0.95) - np.quantile(y, 0.95), abs=1e-12
        )
        # Welch's two one-sided tests at 5 % are the 90 % interval.
        low, high = stats.ttest_ind(x, y, equal_var=False).confidence_interval(0.9)
        assert float(row["equivalence_low"]) == pytest.approx(low, rel=1e-9)
        pooled = np.sqrt(float(row["within_mean_square"]))
        assert float(row["bound_sd"]) == pytest.approx(max(-low, high) / pooled, rel=1e-9)
        assert float(row["bhattacharyya_limit"]) < float(row["bhattacharyya_by_chance"]) < 1.0
        assert float(row["energy_distance_limit"]) > float(row["energy_distance_by_chance"]) > 0.0
        assert float(row["mean_difference_low"]) < float(row["mean_difference"]) < float(row["mean_difference_high"])


def test_the_rows_of_all_descriptors_together(full: Study) -> None:
    table = [row for row in rows(full) if row["descriptor"] == JOINT]
    for row, group in zip(table, full.groups, strict=True):
        assert row["joint_energy"] == group.joint.energy.value
        assert row["joint_mmd_p"] == group.joint.mmd.p
        assert not set(row) - set(COLUMNS)
    assert table[0]["p_adjusted"] < 0.05
    # No deal of 500 is as far apart, so that p is the least there can be: 1 of 501.
    assert joint_verdict(full, 0) == f"the descriptors together differ (p ≤ {full.joint_p[0]:.2g})"
    told_again = list(csv.DictReader(io.StringIO(csv_bytes(full).decode())))
    assert {row["verdict"] for row in told_again if row["descriptor"] == JOINT} <= {"differs", "not told apart"}
    assert table[0]["verdict"] == "differs"


def test_a_difference_of_the_joint_distribution_alone_is_told() -> None:
    # The same margins, paired upwards in A and downwards in B.
    x = normal(80)
    a = Population("a", ("roundness", "solidity"), np.column_stack([x, x]))
    b = Population("b", ("roundness", "solidity"), np.column_stack([x, -x]))
    found = study(a, b, permutations=200, bootstrap=100)
    assert {row.kind for row in verdicts(found)[0]} <= {"agrees", "not told apart"}
    assert "though none of them does by itself" in joint_verdict(found, 0)


def test_json_is_strict_and_holds_the_rows(full: Study) -> None:
    def refuse(text: str) -> None:
        raise AssertionError(text)

    data = json.loads(json.dumps(as_dict(full, ["report.html"])), parse_constant=refuse)
    assert data["a"] == {"label": "scans", "particles": 160}
    assert data["classes"]["particles_b"] == [60] * 4
    assert data["files"] == ["report.html"]
    by_descriptor = [r["verdict"] for r in data["rows"] if r["descriptor"] != JOINT]
    assert by_descriptor == [v.kind for row in verdicts(full) for v in row]


def test_what_is_infinite_is_null_in_json() -> None:
    # So few values that replicates without variation decide an end of the interval of g.
    found = study(one([0.0] * 7 + [8]), one([16.0] * 7 + [24], "b"), permutations=100, bootstrap=400)
    row = as_dict(found)["rows"][0]
    assert found.groups[0].descriptors[0].estimate("hedges_g").low == -np.inf
    assert row["hedges_g_low"] is None
    json.dumps(row, allow_nan=False)


# ------------------------------------------------------------------------------------------------------------ verdicts


@pytest.mark.parametrize(
    ("a", "b", "kind", "words"),
    [
        (normal(600), normal(600), "agrees", r"means and tails agree within 0\.2 sd, scatter within 15 %$"),
        (normal(60), normal(60), "not told apart", r"^cannot be told apart; a difference of means up to 0\.3\d* \(0"),
        (normal(30), normal(30), "not told apart", r"\(0\.43 sd\) is not ruled out$"),
        (normal(20), normal(20), "too few to tell", r" up to 0\.5\d \(0\.53 sd\) is not ruled out$"),
        (normal(6), normal(6), "too few to tell", r"which says little: 6 and 6 particles would show 1\.9 sd"),
        (normal(900), normal(900, 0.18), "differs: slight", r"^differs slightly: B is rounder by 0\.18 \(0\.18 sd, η"),
        (normal(600), normal(600, -0.35), "differs: small", r"^differs by a small amount: B is more angular by 0\.35"),
        (normal(200), normal(200, 0.65), "differs: medium", r"B is rounder by 0\.65 \(0\.65 sd, η² 0\.096\)$"),
        (normal(200), normal(200, 0.9), "differs: large", r"^differs by a large amount: B is rounder by 0\.9 \(0\.9"),
        (normal(400), normal(400, 0, 1.5), "differs: medium", r"medium amount: B scatters more \(sd 1\.5 against 1\)$"),
        (normal(400), normal(400, 0, 0.5), "differs: large", r"large amount: B scatters less \(sd 0\.5 against 1\)$"),
        (normal(400), normal(400, 0.9, 0.5), "differs: large", r"B is rounder by 0\.9 .*, and B scatters less"),
    ],
)  # fmt: skip
def test_verdicts_of_known_samples(a: np.ndarray, b: np.ndarray, kind: str, words: str) -> None:
    verdict = told(a, b)
    assert verdict.kind == kind
    assert re.search(words, verdict.sentence), verdict.sentence
    assert (verdict.p < 0.05) == kind.startswith("differs")


def test_a_shape_that_differs_with_equal_means_and_deviations() -> None:
    two_heaps = np.concatenate([normal(200, -0.98, 0.2), normal(200, 0.98, 0.2)])
    verdict = told(normal(400), two_heaps / two_heaps.std(ddof=1) * normal(400).std(ddof=1))
    assert verdict.kind.startswith("differs")
    assert re.search(r"tail of B|in the shape of the distribution \(Kolmogorov-Smirnov 0\.\d", verdict.sentence)


def test_the_size_is_the_shift_of_two_normals_that_overlap_as_much() -> None:
    # Deviations 1 and r: BC = sqrt(2 r / (1 + r^2)), equal to exp(-d^2 / 8) at d.
    r = 1.5
    expected = np.sqrt(-8.0 * np.log(np.sqrt(2 * r / (1 + r * r))))
    assert told(normal(400), normal(400, 0, r)).size == pytest.approx(expected, rel=1e-9)
    assert told(normal(400), normal(400, 0.6)).size == pytest.approx(0.6 / normal(400).std(ddof=1), rel=1e-9)


def test_words_of_each_descriptor() -> None:
    for name, more, less in (
        ("roundness", "rounder", "more angular"),
        ("boxiness", "boxier", "less boxy"),
        ("solidity", "more solid", "less solid"),
        ("true_sphericity", "more spherical", "less spherical"),
        ("elongation", "higher in elongation", "lower in elongation"),
    ):
        for shift, word in ((1.0, more), (-1.0, less)):
            found = study(one(normal(60), "a", name), one(normal(60, shift), "b", name), permutations=100, bootstrap=50)
            assert f"B is {word} by 1 (" in verdicts(found)[0][0].sentence


@settings(deadline=None, max_examples=15)
@given(st.integers(-20, 20), st.integers(5, 60), st.integers(5, 60), st.floats(-1.5, 1.5), st.floats(0.4, 2.5))
def test_the_unit_does_not_touch_the_verdict(power: int, n: int, m: int, shift: float, ratio: float) -> None:
    a, b = normal(n), normal(m, shift, ratio)
    plain, scaled = told(a, b, permutations=60), told(a * 2.0**power, b * 2.0**power, permutations=60)
    assert (plain.kind, plain.p) == (scaled.kind, scaled.p)
    assert scaled.size == pytest.approx(plain.size, rel=1e-9, abs=1e-12)
    assert scaled.bound == pytest.approx(plain.bound, rel=1e-9)


def test_false_alarms_are_as_rare_as_promised() -> None:
    # 2 descriptors and the joint test, 100 studies of one population: more than 10 alarms have a chance of 1.1 %.
    generator, names = np.random.default_rng(3), tuple("ab")
    alarms = 0
    for seed in range(100):
        sides = [Population(x, names, generator.normal(size=(25, 2))) for x in "ab"]
        found = study(*sides, seed=seed, permutations=240, bootstrap=10)
        alarms += any(v.kind.startswith("differs") for v in verdicts(found)[0]) or joint_kind(found, 0) == "differs"
    assert alarms <= 10


def test_descriptors_and_joint_tests_are_adjusted_together(full: Study) -> None:
    raw = [(row.index("energy_distance").p, group.joint.energy.p) for group in full.groups for row in group.descriptors]
    p = np.array([x for x, _ in raw] + [group.joint.energy.p for group in full.groups])
    assert full.tests == len(p) == 25
    # Holm by hand: the i-th least times what is left, and never below the one before.
    rank = np.argsort(p, kind="stable")
    expected = np.empty(25)
    expected[rank] = np.minimum(np.maximum.accumulate(p[rank] * np.arange(25, 0, -1)), 1.0)
    np.testing.assert_allclose([*full.adjusted.ravel(), *full.joint_p], expected, rtol=1e-12)


def test_of_one_descriptor_the_joint_test_is_the_descriptors_own() -> None:
    found = study(one(normal(30)), one(normal(30, 0.6), "b"), permutations=400, bootstrap=10)
    assert found.tests == 1
    assert found.joint_p == (found.groups[0].descriptors[0].index("energy_distance").p,)


def test_the_least_p_is_marked_on_the_screen() -> None:
    a, b = one(normal(30)), one(normal(30, 4.0), "b")
    assert " ≤0.0025 differs: large" in screen(study(a, b, permutations=400, bootstrap=10))
    assert "≤" not in screen(study(a, one(normal(30, 0.5), "b"), permutations=400, bootstrap=10)).split("p: of")[0]


@pytest.mark.parametrize("tests", [1, 5, 25])
def test_the_detectable_difference_has_a_power_of_80_percent(tests: int) -> None:
    found = study(one(normal(15)), one(normal(150), "b"), permutations=20, bootstrap=10)
    shift = detectable_shift(found.groups[0].descriptors[0], tests)
    error = np.sqrt(1 / 15 + 1 / 150)
    # The t-test of k at once by Bonferroni; the energy distance needs 5 % more.
    power = stats.nct(163, shift / 1.05 / error).sf(stats.t(163).ppf(1 - 0.025 / tests))
    assert power == pytest.approx(0.8, abs=0.005)


def test_a_detectable_difference_is_found_in_four_of_five_studies() -> None:
    # 4 descriptors and the joint test: 5 tests.  Of 60 studies, 38 to 57 have a chance of 99.8 % at a power of 0.8.
    generator, names = np.random.default_rng(8), tuple("abcd")
    found, shift = 0, None
    for seed in range(60):
        a, b = generator.normal(size=(15, 4)), generator.normal(size=(150, 4))
        if shift is None:
            first = study(Population("a", names, a), Population("b", names, b), permutations=200, bootstrap=10)
            assert first.tests == 5
            shift = detectable_shift(first.groups[0].descriptors[0], first.tests)
        b[:, 0] += shift
        one_study = study(
            Population("a", names, a), Population("b", names, b), seed=seed, permutations=300, bootstrap=5
        )
        found += verdicts(one_study)[0][0].kind.startswith("differs")
    assert 38 <= found <= 57


def test_large_populations_are_thinned_for_the_joint_test_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lithoform.report.study.JOINT_MOST", 30)
    generator, names = np.random.default_rng(12), ("roundness", "solidity")
    sides = [Population(x, names, generator.normal(size=(50, 2)), ("cube",) * 50) for x in "ab"]
    found = study(*sides, permutations=120, bootstrap=20)
    assert found.groups[0].descriptors[0].sizes == (50, 50)
    assert mix_notes(found) == ("joint tests take at most 30 particles of each population, drawn at random",)
    # The floor of the energy distance falls with the root of the number of particles.
    whole = compare_populations(*(side.values for side in sides), names, seed=0, permutations=100, bootstrap=20)
    ratio = found.groups[0].joint.energy.floor_mean / whole.pooled.joint.energy.floor_mean
    assert ratio == pytest.approx(np.sqrt(50 / 30), rel=0.15)


def test_many_comparisons_get_more_permutations() -> None:
    names = tuple(f"d{i}" for i in range(25))
    sides = [Population(x, names, np.random.default_rng(i).normal(i, 0.1, (6, 25))) for i, x in enumerate("ab")]
    found = study(*sides, bootstrap=10)
    assert found.permutations == 2600  # 25 descriptors and the joint test
    # Wide apart: 6 against 6 are dealt so in 2 of 924 ways, of which p is the share.
    p = [row.index("energy_distance").p for row in found.groups[0].descriptors]
    assert np.mean(p) == pytest.approx(2 / 924, rel=0.25)
    assert study(one(normal(9)), one(normal(9), "b"), bootstrap=10).permutations == 2000


# ------------------------------------------------------------------------------------------------------------- classes


@pytest.fixture(scope="module")
def uneven() -> Study:
    a = stones({"cube": 30, "plate": 20, "column": 40, "blade": 5}, 4, label="scans")
    b = stones(dict.fromkeys(CLASSES, 150), 5, label="generated")
    return study(a, b, permutations=500, bootstrap=200)


def test_what_the_mix_of_classes_makes_is_told_from_the_rest(uneven: Study) -> None:
    mix = uneven.mix
    assert mix is not None
    assert not mix.is_same
    assert mix.names == ("blade", "column", "cube", "plate")
    # 95 stones: shares 5, 40, 30, 20 of 95 against a quarter each.
    assert mix.distance == pytest.approx((40 + 30) / 95 - 0.5)
    for j, (of_mix, within) in enumerate(mix.parts):
        means = uneven.groups[0].descriptors[j].means
        assert of_mix + within == pytest.approx(means[0] - means[1], abs=1e-12)
    # By construction the classes are the same in both, and only their mix moves the sphericity.
    expected = sum((n / 95 - 0.25) * OF_CLASS[name] for name, n in zip(mix.names, (5, 40, 30, 20), strict=True))
    assert mix.parts[3][0] == pytest.approx(expected, abs=0.003)
    assert abs(mix.parts[3][1]) < 0.005
    verdict = verdicts(uneven)[0][3]
    assert verdict.kind == "not told apart"
    assert "beyond the mix of classes" in verdict.sentence
    (note,) = mix_notes(uneven)
    assert "blade 5 and 150; column 40 and 150; cube 30 and 150; plate 20 and 150; 24 %" in note


def test_a_difference_within_the_classes_is_seen_through_uneven_mixes() -> None:
    a = stones({"cube": 30, "plate": 20, "column": 40, "blade": 10}, 4)
    b = stones(dict.fromkeys(CLASSES, 60), 5, shift=0.036)
    verdict = verdicts(study(a, b, permutations=500, bootstrap=50))[0][0]
    assert verdict.kind == "differs: large"
    assert re.search(r"beyond the mix of classes: B is rounder by 0\.03\d within the classes \(1", verdict.sentence)


def test_even_mixes_need_no_word(full: Study) -> None:
    assert full.mix.is_same
    assert full.mix.parts is not None
    assert mix_notes(full) == ()


def test_classes_that_cannot_be_compared_are_told() -> None:
    a = stones({"cube": 20, "plate": 4, "column": 6}, 6, label="scans")
    b = stones({"cube": 20, "plate": 20, "blade": 8, "column": 6}, 7, label="generated")
    alike = b.values.copy()
    alike[np.array(b.classes) == "column", 1] = 0.4
    found = study(a, Population("generated", FOUR, alike, b.classes), permutations=200, bootstrap=50)
    assert [group.name for group in found.groups] == [None, "cube"]
    assert [(x.name, x.sizes) for x in found.left_out] == [("blade", (0, 8)), ("column", (6, 6)), ("plate", (4, 20))]
    notes = mix_notes(found)
    assert "class blade (0 and 8 particles) is not compared by itself: it is in generated only" in notes[0]
    assert "its boxiness does not vary" in notes[1]
    assert "fewer than 5 particles say too little" in notes[2]
    assert found.groups[0].descriptors[0].sizes == (30, 54)
    # A class of few particles, or in one population alone, is left out of what lies within the classes.
    assert found.mix.shared == ("column", "cube")
    assert "within the classes is taken over column, cube only: blade, plate have fewer than 5 particles" in notes[4]
    for text in (screen(found), " ".join(as_dict(found)["notes"])):
        assert text.count("is not compared by") == 3


def classed(blocks: dict[str, np.ndarray], label: str) -> Population:
    """One descriptor, by class."""
    classes = tuple(name for name, block in blocks.items() for _ in block)
    return Population(label, ("roundness",), np.concatenate([*blocks.values()])[:, None], classes)


def pooled(a: dict[str, np.ndarray], b: dict[str, np.ndarray], permutations: int = 400):
    return verdicts(study(classed(a, "a"), classed(b, "b"), permutations=permutations, bootstrap=50))[0][0]


def test_a_class_of_one_source_alone_does_not_make_a_difference_slight() -> None:
    a, b = {"cube": normal(200)}, {"cube": normal(180, 3.0), "blade": normal(20)}
    found = pooled(a, b)
    assert found.kind == "differs: large"
    assert found.size == pytest.approx(3.0, rel=0.02)
    assert "rounder by 3 within class cube (3 sd); the mix makes it lower by 0.3" in found.sentence
    # With no class that has 5 particles in both, there is a difference and no size.
    rest = pooled({"cube": normal(4), "blade": normal(300)}, {"cube": normal(4, 40.0), "column": normal(90, 3.0)})
    # All 4 cubes of A lie below all of B, of which 2 deals of 70 are as far: p is about 0.03.
    assert rest.p == pytest.approx(2 / 70, abs=0.02)
    assert (rest.kind, np.isnan(rest.size)) == ("differs", True)
    assert "no class has 5 particles or more in both" in rest.sentence
    table = csv_bytes(study(classed(a, "a"), classed(b, "b"), permutations=400, bootstrap=20)).decode()
    assert "nan" not in table.replace("blade", "")
    same = pooled({"cube": normal(4), "blade": normal(300)}, {"cube": normal(4), "column": normal(90, 3.0)})
    assert same.kind == "too few to tell"


def test_the_scatter_is_seen_through_uneven_mixes() -> None:
    a = {"cube": normal(150), "plate": normal(150)}
    b = {"cube": normal(180, 0, 3), "plate": normal(120, 0, 3)}
    found = pooled(a, b)
    # BC of N(0, 1) and N(0, 3) is sqrt(0.6), which two normals of one deviation have at a shift of 1.43.
    assert found.size == pytest.approx(np.sqrt(-8 * np.log(np.sqrt(0.6))), abs=0.02)
    assert found.kind == "differs: large"
    assert "B scatters more (sd 3 against 1 in a common mix)" in found.sentence


def test_both_are_weighted_to_one_mix() -> None:
    # Classes at 0 and 10 with deviation 1, in halves against 1 to 3: the common mix is 3 to 5, in either.
    a = {"cube": normal(300), "plate": normal(300, 10)}
    b = {"cube": normal(150), "plate": normal(450, 10)}
    found = study(classed(a, "a"), classed(b, "b"), permutations=200, bootstrap=20)
    (common,) = found.mix.common
    assert common.means == pytest.approx((6.25, 6.25))
    assert common.deviations == pytest.approx([np.sqrt(1 + 100 * 0.375 * 0.625)] * 2, rel=0.002)
    assert found.mix.parts[0] == pytest.approx((-2.5, 0.0), abs=1e-12)
    # Var = sum w^2 (1 / n + 1 / m).
    assert common.error == pytest.approx(
        np.sqrt(0.375**2 * (1 / 300 + 1 / 150) + 0.625**2 * (1 / 300 + 1 / 450)), rel=0.01
    )
    assert not found.mix.is_same


def test_one_odd_particle_of_a_tiny_class_does_not_decide() -> None:
    a = {"cube": normal(60), "plate": normal(40), "blade": np.array([50.0, 0.0])}
    b = {"cube": normal(40, 0.9), "plate": normal(60, 0.9), "blade": normal(60, 0.9)}
    found = pooled(a, b)
    assert found.size == pytest.approx(0.9, rel=0.05)
    assert "rounder by 0.9 within classes cube and plate" in found.sentence


def test_a_sign_that_is_not_told_is_not_said() -> None:
    # Cubes go up by 2 and plates down by 2.44: with the weights 0.55 and 0.45 that is 0 within the classes.
    a = {"cube": normal(100), "plate": normal(100)}
    b = {"cube": normal(150, 2.0), "plate": normal(100, -2.0 * 0.55 / 0.45)}
    found = pooled(a, b)
    assert found.kind.startswith("differs")
    assert not re.search("rounder|angular", found.sentence)


def test_few_particles_of_unlike_mixes_are_too_few_to_tell() -> None:
    few = pooled({"cube": normal(30), "plate": normal(6)}, {"cube": normal(6), "plate": normal(30)})
    assert few.bound > 0.5
    assert few.kind == "too few to tell"
    many = pooled({"cube": normal(300), "plate": normal(60)}, {"cube": normal(60), "plate": normal(300)})
    assert many.bound < 0.5
    assert many.kind == "not told apart"


def test_mixes_that_chance_makes_are_no_different_mixes() -> None:
    def mix(*counts: tuple[int, int]):
        sides = [classed({f"c{k}": normal(pair[i]) for k, pair in enumerate(counts)}, "x") for i in (0, 1)]
        values, classes = ((sides[0].values, sides[1].values), (sides[0].classes, sides[1].classes))
        return mix_of(values, classes, generator=np.random.default_rng(0), permutations=20_000)

    assert mix((10, 13), (10, 7)).is_same  # Fisher's exact p is 0.52
    assert mix((100, 130), (100, 70)).p == pytest.approx(
        stats.chi2_contingency([[100, 130], [100, 70]], correction=False).pvalue, abs=0.002
    )
    assert not mix((100, 130), (100, 70)).is_same
    assert mix((1000, 1010), (1000, 990)).is_same


@pytest.mark.parametrize(
    ("b", "kind", "words"),
    [
        (normal(600, 0.0, 1.1), "means agree", r"the scatter may differ \(sd of B 1\.03 to 1\.18 times that of A\)"),
        (np.r_[normal(600)[:40] - 0.3, normal(600)[40:]], "means agree", r"\(5th percentile of B lower by 0\.3\)$"),
        (normal(600, 0.03), "agrees", "scatter within 15 %"),
        (normal(600, 0.03, 1.03), "agrees", "scatter within 15 %"),
    ],
)  # fmt: skip
def test_agreement_needs_the_scatter_and_the_tails(b: np.ndarray, kind: str, words: str) -> None:
    verdict = told(normal(600), b)
    assert verdict.kind == kind
    assert re.search(words, verdict.sentence), verdict.sentence


def test_a_ratio_of_deviations_of_1_25_never_agrees() -> None:
    generator = np.random.default_rng(21)
    pairs = [(generator.normal(size=600), generator.normal(0, 1.25, 600)) for _ in range(10)]
    kinds = [told(a, b, permutations=100).kind for a, b in pairs]
    assert "agrees" not in kinds


def test_the_interval_of_the_ratio_of_deviations_holds_the_truth() -> None:
    # 1,000 samples at 90 %: 870 to 930 have a chance of 99.9 %; heavy tails and skewed samples are nearly as good.
    generator = np.random.default_rng(22)
    for draw, low, high in ((generator.standard_normal, 870, 930), (generator.exponential, 850, 945),
                            (generator.laplace, 850, 945)):  # fmt: skip
        hits = 0
        for _ in range(1000):
            a, b = (draw(size=n) for n in (100, 150))
            ends = deviation_ratio(a, 2.0 * b, level=0.9)
            hits += ends[0] <= 2.0 <= ends[1]
        assert low <= hits <= high


# -------------------------------------------------------------------------------------------------------------- screen


def test_the_screen_fits_100_columns(full: Study, uneven: Study) -> None:
    for found in (full, uneven):
        lines = screen(found).splitlines()
        assert max(map(len, lines)) <= 100
        table = [line.split() for line in lines if line.startswith(("pooled ", *CLASSES)) and "particles" not in line]
        assert len(table) == 4 * len(found.groups)
        expected = [
            (group, one_row, verdict)
            for group, words in zip(found.groups, verdicts(found), strict=True)
            for one_row, verdict in zip(group.descriptors, words, strict=True)
        ]
        for row, (group, found_one, verdict) in zip(table, expected, strict=True):
            assert row[0] == (group.name or "pooled")
            assert row[2] == f"{found_one.means[0]:#.4g}"
            assert row[6] == f"{found_one.index('bhattacharyya').value:.3f}"
            assert row[7] == f"({found_one.index('bhattacharyya').floor_mean:.3f})"
            assert " ".join(row[11:]) == verdict.kind


def test_a_wide_range_of_numbers_and_long_names_fit_too() -> None:
    names = ("volume", "maximum_projection_sphericity", "inertia_1")
    scale = np.array([1e-6, 1.0, 1e-13])
    sides = [Population(x * 60, names, np.random.default_rng(i).normal(5, 1, (9, 3)) * scale, ("a long class",) * 9)
             for i, x in enumerate("ab")]  # fmt: skip
    lines = screen(study(*sides, permutations=200, bootstrap=20)).splitlines()
    assert max(map(len, lines)) <= 100
    assert any("psi_p" in line for line in lines)


# ---------------------------------------------------------------------------------------------------------- page, files


def test_the_page_holds_the_numbers(full: Study, written: list[Path]) -> None:
    root = ET.fromstring(written[0].read_bytes())
    tables = []
    for table in root.iter(SPACE + "table"):
        head = ["".join(cell.itertext()) for cell in table.iter(SPACE + "th")]
        body = [["".join(cell.itertext()) for cell in row.iter(SPACE + "td")] for row in table.iter(SPACE + "tr")][1:]
        tables.append((head, {(row[0], row[1]): row for row in body}))
    of_verdicts, of_means, of_indices = (table for _, table in tables[:3])
    for group, words in zip(full.groups, verdicts(full), strict=True):
        for name, row, verdict in zip(FOUR, group.descriptors, words, strict=True):
            key = (group.name or "pooled", name)
            assert of_verdicts[key][2:4] == [verdict.kind, verdict.sentence]
            assert float(of_means[key][4]) == pytest.approx(row.means[0], rel=1e-3)
            assert float(of_means[key][10]) == pytest.approx(row.anova.f, rel=1e-3)
            low, high = (float(text.replace("−", "-")) for text in of_means[key][9].split(" to "))
            assert (low, high) == pytest.approx(row.anova.interval, rel=5e-3)
            bc = row.index("bhattacharyya")
            assert float(of_indices[key][3]) == pytest.approx(bc.value, rel=1e-3)
            assert float(of_indices[key][4]) == pytest.approx(bc.floor_mean, rel=1e-3)
            assert of_indices[key][6].startswith("≤") == (bc.p == 1 / 501)
            assert float(of_indices[key][6].removeprefix("≤ ")) == pytest.approx(bc.p, rel=0.05)
            assert float(of_indices[key][7]) == pytest.approx(row.index("kullback_leibler").value, rel=1e-3)
    assert len(list(root.iter(SPACE + "img"))) == len([path for path in written if path.suffix == ".png"]) == 7


def test_the_files_are_there_and_the_same_again(full: Study, written: list[Path], tmp_path: Path) -> None:
    names = {path.name for path in written}
    assert {"report.html", "comparison.csv", "comparison.json", "histograms.png", "distributions.png", "effects.png",
            "roundness_by_class.png"} <= names  # fmt: skip
    assert {path.name for path in written[0].parent.iterdir()} == names
    assert json.loads((written[0].parent / "comparison.json").read_bytes())["files"] == [path.name for path in written]
    again = write_report(lambda: full, tmp_path)[1]
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


def test_a_label_is_only_a_label(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    label = "<script>alert('$x$')</script>\x07\n石"
    found = study(one(normal(9), label), one(normal(9, 1.0), label), permutations=50, bootstrap=20)
    assert (found.reference.label, found.other.label) == (f"{label} (A)", f"{label} (B)")
    files = write_report(lambda: found, tmp_path)[1]
    text = files[0].read_text(encoding="utf-8")
    ET.fromstring(text.encode())
    assert "<script" not in text
    assert "&lt;script&gt;alert" in text
    assert "\x07" not in screen(found)


def test_many_descriptors_take_several_sheets(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    names = tuple(f"descriptor_{i}" for i in range(8))
    sides = [Population(x, names, np.random.default_rng(i).normal(size=(12, 8))) for i, x in enumerate("ab")]
    found = study(*sides, permutations=200, bootstrap=20)
    made = {path.name for path in write_report(lambda: found, tmp_path)[1]}
    assert {"histograms_1.png", "histograms_2.png", "distributions_2.png"} <= made


def test_files_of_a_former_comparison_are_removed_and_no_others(written: list[Path], tmp_path: Path) -> None:
    out, first = tmp_path / "out", written
    shutil.copytree(written[0].parent, out)
    (out / "mine.png").write_bytes(b"mine")
    (tmp_path / "outside.png").write_bytes(b"outside")
    data = json.loads((out / "comparison.json").read_bytes())
    (out / "comparison.json").write_text(json.dumps(data | {"files": [*data["files"], "../outside.png", 7]}))
    found = study(one(normal(9)), one(normal(9), "b"), permutations=50, bootstrap=20)
    second = write_report(lambda: found, out)[1]
    assert {path.name for path in out.iterdir()} == {path.name for path in second} | {"mine.png"}
    assert {path.name for path in first} - {path.name for path in second}  # some were stale
    assert (tmp_path / "outside.png").exists()
    # What is no data of a comparison is let alone.
    for text in ("[]", "{}", "nothing", '{"files": ["mine.png"]}', '{"lithoform": "1", "rows": [], "files": 7}'):
        (out / "comparison.json").write_text(text)
        assert _former_files(out) == set()


def test_units_are_told_in_tables_sentences_and_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    captions = record_captions(monkeypatch)
    names = ("length", "surface_area", "volume", "solidity")
    scale = np.array([1e-2, 1e-4, 1e-6, 0.1])
    values = normal(60)[:, None] * scale + 9.0 * scale
    sides = Population("a", names, values), Population("b", names, values + scale)
    found = study(*sides, permutations=200, bootstrap=20)
    assert found.units == ("m", "m²", "m³", "")
    assert [row.get("unit") for row in rows(found)] == ["m", "m²", "m³", "", None]
    assert "higher in volume by 1e-06 m³ (1 sd" in verdicts(found)[0][2].sentence
    assert "B is more solid by 0.1 (1 sd" in verdicts(found)[0][3].sentence
    assert "length [m] " in screen(found)
    drawings(found)
    assert {"length [m]", "surface area [m²]", "volume [m³]"} <= {caption.text for caption in captions}
    assert "volume [m³]" in comparison_page(found, []).decode()
    # Where one side does not tell its unit, none is claimed.
    unknown = study(sides[0], Population("b", names, values + scale, has_unit=False), permutations=200, bootstrap=20)
    assert unknown.units == ("",) * 4
    assert mix_notes(unknown) == (
        "b has no column unit: its lengths were taken as metres, which those of a are",
    )  # fmt: skip


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")

    def work() -> Study:
        raise AssertionError("the work began")

    (tmp_path / "file").write_text("x")
    for out in (tmp_path / "file", tmp_path / "file" / "deeper"):
        with pytest.raises(OutputError):
            write_report(work, out)
    (tmp_path / "out" / "report.html").mkdir(parents=True)
    with pytest.raises(OutputError, match="a folder of that name is in the way"):
        write_report(work, tmp_path / "out")


def test_without_the_extra_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(LithoformError, match=r"needs matplotlib.*lithoform\[pictures\]"):
        write_report(lambda: pytest.fail("the work began"), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_600_and_600_by_class_are_fast(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    a = stones(dict.fromkeys(CLASSES, 150), 8, label="scans")
    b = stones(dict.fromkeys(CLASSES, 150), 9, label="generated")
    start = time.process_time()
    found, _ = write_report(lambda: study(a, b), tmp_path)
    assert time.process_time() - start < 15.0
    # Both are of one population.
    assert {v.kind for row in verdicts(found) for v in row} <= {"agrees", "means agree", "not told apart"}


# ---------------------------------------------------------------------------------------------------- faults, commands


@pytest.mark.parametrize(
    ("a", "b", "options", "message"),
    [
        (one(normal(9)), one(normal(9), "b", "boxiness"), {}, "expected the same descriptors of both populations"),
        (one(normal(4)), one(normal(9), "b"), {}, "expected 5 particles or more in a, got 4"),
        (one([*normal(9), np.nan]), one(normal(9), "b"), {}, "expected a finite roundness .* of a, got 1"),
        (one(np.full(9, 0.5)), one(normal(9), "b"), {}, "expected a roundness that varies in a, got 0.5 9 times"),
        (one(normal(9)), one(normal(9), "b"), {"permutations": 19}, "expected 20 permutations or more, as 1 test"),
        (one(normal(9)), one(normal(9), "b"), {"permutations": 0}, "expected a whole number of permutations"),
        (one(normal(9)), one(normal(9), "b"), {"seed": -1}, "expected a seed that is a whole number from 0"),
        (Population("a", FOUR, np.ones((9, 4)), ("cube",) * 9), Population("b", FOUR, np.ones((9, 4))), {},
         "expected classes in both populations or in neither, got none in b"),
        (classed({"cube": normal(9)}, "a"), classed({"plate": normal(9)}, "b"), {},
         "expected a class that is in both populations, got cube in a and plate in b"),
        (classed({"pooled": normal(9)}, "a"), classed({"pooled": normal(9)}, "b"), {},
         "expected classes of other names than pooled.* in a; rename it"),
        (one(1e110 * normal(9)), one(normal(9), "b"), {}, "within 1e100 of 0.*choose another unit"),
        (one(1e-110 * normal(9)), one(normal(9), "b"), {}, "differences of 1e-100 or more.*choose another unit"),
    ],
)  # fmt: skip
def test_faults_are_told_in_a_sentence(a: Population, b: Population, options: dict, message: str) -> None:
    with pytest.raises(SampleError, match=message):
        study(a, b, **options)


@pytest.fixture
def tables(tmp_path: Path) -> tuple[Path, Path]:
    paths = []
    for name, seed, shift in (("scans", 10, 0.0), ("generated", 11, 0.05)):
        side = stones({"cube": 12, "plate": 9}, seed, shift)
        lines = [",".join(("file", *FOUR, "zingg_class"))]
        lines += [f"{i}.stl,{','.join(map(repr, row))},{side.classes[i]}" for i, row in enumerate(side.values.tolist())]
        paths.append(tmp_path / f"{name}.csv")
        paths[-1].write_text("\n".join(lines))
    return paths[0], paths[1]


def command(*arguments: str) -> int:
    app = App(result_action="return_value")
    app.command(compare)
    return app(["compare", *arguments], exit_on_error=False, print_error=False)


def test_the_command_compares_two_tables(tables, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    a, b = map(str, tables)
    out = tmp_path / "out"
    small = ("--permutations", "300")
    assert command(a, b, "--by", "class", "--out", str(out), "--label-b", "made", *small) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("A: scans, 21 particles\nB: made, 21 particles\n")
    assert "differs: large" in shown
    assert f"files in {out}: open report.html" in shown
    table = list(csv.DictReader(io.StringIO((out / "comparison.csv").read_text())))
    assert len(table) == 15

    assert command(a, b, "--out", str(out), "--names", "roundness,solidity", "boxiness", "--json", *small) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["descriptors"] == ["roundness", "solidity", "boxiness"]
    assert all(Path(file).is_file() for file in data["files"])


def test_the_command_tells_what_is_missing(tables, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    a, b = map(str, tables)
    with pytest.raises(FileFormatError, match="expected a database, or a table"):
        command(a, str(tmp_path / "nothing"), "--out", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()
    with pytest.raises(OutputError):
        command(a, b, "--out", a)
    with pytest.raises(CoercionError, match="expected the name of a folder"):
        command(a, b, "--out", "")
    with pytest.raises(SampleError, match=r"got 'zingg_class', which is a word: compare by it\.$"):
        command(a, b, "--out", str(tmp_path / "out"), "--names", "zingg_class")
    with pytest.raises(LithoformError, match=r"roundnes.*Did you mean roundness"):
        command(a, b, "--out", str(tmp_path / "out"), "--names", "roundnes")
    with pytest.raises(LithoformError, match="sieve_size"):
        command(a, b, "--out", str(tmp_path / "out"), "--names", "sieve_size")


def test_every_kind_has_a_tone_that_pages_know() -> None:
    from lithoform.report.page import TONES

    assert set(KINDS.values()) <= set(TONES)
    assert max(map(len, KINDS)) <= 15
