"""The report of two populations: its numbers are those of the comparison, its verdicts follow from them."""

from __future__ import annotations

import csv
import io
import json
import re
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from cyclopts import App
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lithoform.cli.comparing import compare
from lithoform.comparison_report import COLUMNS, JOINT, as_dict, csv_bytes, rows, screen, write_report
from lithoform.database.population import Population
from lithoform.errors import FileFormatError, LithoformError, OutputError, SampleError
from lithoform.report.study import Study, detectable_shift, study
from lithoform.report.verdicts import KINDS, joint_verdict, mix_notes, verdicts
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
    assert joint_verdict(full, 0) == f"the descriptors together differ (p {full.joint_p[0]:.2g})"


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
    assert [r["verdict"] for r in data["rows"] if "verdict" in r] == [v.kind for row in verdicts(full) for v in row]


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
        (normal(600), normal(600), "agrees", r"^cannot be told apart, and the means agree within 0\.2 sd$"),
        (normal(60), normal(60), "not told apart", r"^cannot be told apart; a difference of means up to 0\.3\d* \(0"),
        (normal(30), normal(30), "not told apart", r"\(0\.43 sd\) is not ruled out$"),
        (normal(20), normal(20), "too few to tell", r" up to 0\.5\d \(0\.53 sd\) is not ruled out$"),
        (normal(6), normal(6), "too few to tell", r"which says little: 6 and 6 particles would show 1\.8 sd"),
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
    # 5 descriptors, 40 studies of one population: any "differs" in more than 5 of them has a chance of 1.4 %.
    generator, names = np.random.default_rng(3), tuple("abcde")
    alarms = 0
    for seed in range(40):
        sides = [Population(x, names, generator.normal(size=(30, 5))) for x in "ab"]
        found = study(*sides, seed=seed, permutations=120, bootstrap=10)
        alarms += any(v.kind.startswith("differs") for v in verdicts(found)[0])
    assert alarms <= 5


def test_the_detectable_difference_has_a_power_of_80_percent() -> None:
    found = study(one(normal(15)), one(normal(150), "b"), permutations=20, bootstrap=10)
    row = found.groups[0].descriptors[0]
    shift = detectable_shift(row)
    error = np.sqrt(1 / 15 + 1 / 150)
    power = stats.nct(163, shift / error).sf(stats.t(163).ppf(0.975))
    assert power == pytest.approx(0.8, abs=0.005)


def test_large_populations_are_thinned_for_the_joint_test_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lithoform.report.study.JOINT_MOST", 30)
    generator, names = np.random.default_rng(12), ("roundness", "solidity")
    sides = [Population(x, names, generator.normal(size=(50, 2)), ("cube",) * 50) for x in "ab"]
    found = study(*sides, permutations=100, bootstrap=20)
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
    assert found.permutations == 2500
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
    # A class of one population alone has no second mean, so that the difference has no two parts.
    assert found.mix.parts is None
    for text in (screen(found), " ".join(as_dict(found)["notes"])):
        assert text.count("is not compared by") == 3


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
            assert float(of_indices[key][6]) == pytest.approx(bc.p, rel=0.05)
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
    assert {v.kind for row in verdicts(found) for v in row} <= {"agrees", "not told apart"}


# ---------------------------------------------------------------------------------------------------- faults, commands


@pytest.mark.parametrize(
    ("a", "b", "options", "message"),
    [
        (one(normal(9)), one(normal(9), "b", "boxiness"), {}, "expected the same descriptors of both populations"),
        (one(normal(4)), one(normal(9), "b"), {}, "expected 5 particles or more in a, got 4"),
        (one([*normal(9), np.nan]), one(normal(9), "b"), {}, "expected a finite roundness .* of a, got 1"),
        (one(np.full(9, 0.5)), one(normal(9), "b"), {}, "expected a roundness that varies in a, got 0.5 9 times"),
        (one(normal(9)), one(normal(9), "b"), {"permutations": 19}, "expected 20 permutations or more, for 1 compar"),
        (one(normal(9)), one(normal(9), "b"), {"permutations": 0}, "expected a whole number of permutations"),
        (one(normal(9)), one(normal(9), "b"), {"seed": -1}, "expected a seed that is a whole number from 0"),
        (Population("a", FOUR, np.ones((9, 4)), ("cube",) * 9), Population("b", FOUR, np.ones((9, 4))), {},
         "expected classes in both populations or in neither, got none in b"),
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
    with pytest.raises(LithoformError, match=r"roundnes.*Did you mean roundness"):
        command(a, b, "--out", str(tmp_path / "out"), "--names", "roundnes")
    with pytest.raises(LithoformError, match="sieve_size"):
        command(a, b, "--out", str(tmp_path / "out"), "--names", "sieve_size")


def test_every_kind_has_a_tone_that_pages_know() -> None:
    from lithoform.report.page import TONES

    assert set(KINDS.values()) <= set(TONES)
    assert max(map(len, KINDS)) <= 15
