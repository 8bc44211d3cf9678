"""Tables 3 to 5 and Fig. 8 to 10: the paper's numbers as it prints them, ours as they were measured, n everywhere."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from captions import record_captions
from scipy import stats

from lithoform.errors import FileFormatError, LithoformError, OutputError, RecipeError
from lithoform.presets import SHAPE_CLASSES
from lithoform.reproduce import FIGURES, populations
from lithoform.reproduce.published_populations import PUBLISHED_ANOVA, PUBLISHED_INDICES

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "fdot57"
TRIANGLES, STONES = 1280, 6
FOUR = ("roundness", "boxiness", "solidity", "true_sphericity")

ANOVA = [(table, case) for table, cases in PUBLISHED_ANOVA.items() for case in cases]


@pytest.fixture(scope="module")
def reference() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"the scans of FDOT-57 are not here: {DATA}")
    return DATA


@pytest.fixture
def few(reference: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few and coarse generated stones; made once, as they are kept for all figures of a process."""
    monkeypatch.setenv(populations.FOLDER_VARIABLE, str(reference))
    monkeypatch.setattr(populations, "_STONES_A_CLASS", STONES)


def made(name: str, out: Path, **options) -> dict[str, Path]:
    return {path.name: path for path in FIGURES[name].make(out, **({"triangles": TRIANGLES} | options))}


def read(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))


def sources():
    return populations._sources(DATA, 25, TRIANGLES, "auto", STONES)


# ------------------------------------------------------------------------------------------------- the paper's numbers


@pytest.mark.parametrize(("table", "case"), ANOVA)
def test_printed_analyses_agree_with_themselves(table: str, case: str) -> None:
    row = PUBLISHED_ANOVA[table][case]
    freedom = 2 * row.size - 2
    assert row.groups[0] == row.groups[1]
    assert row.error[0] == pytest.approx(freedom * row.error[1], rel=2e-3)
    assert row.total[0] == pytest.approx((freedom + 1) * row.total[1], rel=2e-3)
    assert row.total[0] == pytest.approx(row.groups[0] + row.error[0], rel=2e-3)
    assert row.f == pytest.approx(row.groups[1] / row.error[1], rel=2e-3)
    assert row.p == pytest.approx(stats.f(1, freedom).sf(row.f), rel=5e-3)
    difference = np.sqrt(2 * row.groups[1] / row.size)
    half = stats.t(freedom).ppf(0.975) * np.sqrt(2 * row.error[1] / row.size)
    assert row.interval == pytest.approx((difference - half, difference + half), abs=2e-3 * half)


def test_three_effect_sizes_are_slips_of_the_paper() -> None:
    wrong = {}
    for table, case in ANOVA:
        row = PUBLISHED_ANOVA[table][case]
        true = row.groups[0] / row.total[0]
        if abs(row.eta_squared - true) > 0.05 * true:
            wrong[table, case] = (row.eta_squared, round(true, 4))
    assert wrong == {
        ("table4", "cube"): (0.0013, 0.0130),
        ("table4", "column"): (0.0014, 0.0136),
        ("table4", "blade"): (0.0174, 0.0188),
    }


def test_printed_means_differ_as_the_printed_analyses_say() -> None:
    for table, figure, names in (("table3", "fig8", FOUR), ("table5", "fig10", SHAPE_CLASSES)):
        for name in names:
            row, means = PUBLISHED_ANOVA[table][name], PUBLISHED_INDICES[figure][name].means
            assert abs(means[0] - means[1]) == pytest.approx(sum(row.interval) / 2, abs=1.1e-4)
    for name in FOUR:
        row, printed = PUBLISHED_ANOVA["table3"][name], PUBLISHED_INDICES["fig8"][name].deviations
        assert np.mean(np.square(printed)) == pytest.approx(row.error[1], rel=0.02)
    generated = [PUBLISHED_INDICES["fig10"][name].means[1] for name in SHAPE_CLASSES]
    assert round(np.mean(generated), 3) == 0.783
    for cases in PUBLISHED_INDICES.values():
        for row in cases.values():
            # 1 - BC bounds the Jensen-Shannon divergence from above, (1 - BC) ln 2 from below.
            if row.jensen_shannon is not None:
                assert np.log(2) * (1 - row.bhattacharyya) < row.jensen_shannon < 1 - row.bhattacharyya + 1e-3


# ------------------------------------------------------------------------------------------------------- what is made


@pytest.mark.usefixtures("few")
def test_both_sources_are_measured_by_the_same_code() -> None:
    from lithoform import database_recipe, generate, measure, particle_seed, read_scan

    found = sources().found
    assert len(found.reference) == 95
    assert len(found.other) == 4 * STONES
    assert found.other.classes == SHAPE_CLASSES * STONES
    scan = read_scan(sources().scans[3], unit="mm", triangles=TRIANGLES)
    assert found.reference.values[3].tolist() == list(measure(scan.mesh, FOUR).values())
    recipe = database_recipe("plate", seed=particle_seed(25, 6), triangles=TRIANGLES)
    assert found.other.values[5].tolist() == list(measure(generate(recipe), FOUR).values())


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize(("name", "descriptor"), [("table3", None), ("table4", "roundness"), ("table5", FOUR[3])])
def test_a_table_has_ours_and_the_papers(name: str, descriptor: str | None, tmp_path: Path) -> None:
    files = made(name, tmp_path)
    assert set(files) == {f"{name}.csv", f"{name}.html"}
    table = read(files[f"{name}.csv"])
    key = "descriptor" if descriptor is None else "class"
    cases = list(dict.fromkeys(row[key] for row in table))
    assert cases == list(FOUR if descriptor is None else SHAPE_CLASSES)
    for case in cases:
        row = {line["quantity"]: line for line in table if line[key] == case}
        x, y = sources().found.samples(None if descriptor is None else case, descriptor or case)
        assert row["particles"]["ours"] == f"{len(x)} + {len(y)}"
        printed = PUBLISHED_ANOVA[name][case]
        assert float(row["F"]["paper"]) == pytest.approx(printed.f, rel=1e-3)
        assert float(row["error: degrees of freedom"]["paper"]) == 2 * printed.size - 2
        assert float(row["eta squared"]["recomputed"]) == pytest.approx(printed.groups[0] / printed.total[0], rel=2e-3)
        if min(len(x), len(y)) < 5:
            assert row["F"]["ours"] == ""
            assert row["particles"]["note"] == "too few scans to compare"
            continue
        f, p = stats.f_oneway(x, y)
        assert float(row["F"]["ours"]) == pytest.approx(f, rel=1e-3)
        assert float(row["p"]["ours"]) == pytest.approx(p, rel=1e-3)
        assert float(row["mean of B"]["ours"]) == pytest.approx(y.mean(), rel=1e-3)
        interval = stats.ttest_ind(x, y).confidence_interval(0.95)
        assert float(row["95 % interval of A − B, low"]["ours"]) == pytest.approx(interval.low, rel=1e-3)
        assert float(row["total: sum of squares"]["ours"]) == pytest.approx(
            np.var(np.concatenate([x, y])) * (len(x) + len(y)), rel=1e-3
        )
    slips = {line[key]: line["note"] for line in table if "slip" in line["note"]}
    expected = {"cube": "ten times too small", "column": "ten times too small", "blade": "it is the row's p"}
    assert slips == ({k: f"a slip of the paper: {v}" for k, v in expected.items()} if name == "table4" else {})
    page = ET.fromstring(files[f"{name}.html"].read_bytes())
    cells = ["".join(cell.itertext()) for cell in page.iter("{http://www.w3.org/1999/xhtml}td")]
    assert cells == [value for line in table for value in line.values()]
    text = "".join(page.itertext())
    assert "A: FDOT-57, 95 scans. B: generated, 24 stones" in text
    blades = sources().found.reference.classes.count("blade")
    told = f"blade ({blades} and {STONES} stones): not compared: too few scans." in text
    assert told == (descriptor is not None)


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("name", ["fig9", "fig10"])
def test_a_figure_by_class_has_both_numbers(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    captions = record_captions(monkeypatch)
    files = made(name, tmp_path)
    assert files[f"{name}.png"].read_bytes().startswith(b"\x89PNG")
    shown = [caption.text for caption in captions]
    for case, printed in PUBLISHED_INDICES[name].items():
        assert case in shown
        assert any(f"paper (150 + 150):  BC {printed.bhattacharyya:.4f}" in text for text in shown)
    assert sum(text == "too few to compare" for text in shown) == 1
    table = read(files[f"{name}.csv"])
    column = FOUR.index("roundness" if name == "fig9" else "true_sphericity")
    for row in table:
        if row["quantity"] == "bhattacharyya":
            assert float(row["paper"]) == PUBLISHED_INDICES[name][row["class"]].bhattacharyya
            groups = {group.name: group.descriptors[column] for group in sources().found.groups}
            found = groups.get(row["class"])
            assert row["ours"] == ("" if found is None else str(found.index("bhattacharyya").value))
            assert row["by_chance"] == ("" if found is None else str(found.index("bhattacharyya").floor_mean))
    again = made(name, tmp_path / "again")
    assert [path.read_bytes() for path in files.values()] == [path.read_bytes() for path in again.values()]


@pytest.mark.usefixtures("few", "drawing")
def test_figure_8_shows_stones_and_histograms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    captions = record_captions(monkeypatch)
    shown: list[str] = []
    draw = populations.gallery
    monkeypatch.setattr(populations, "gallery", lambda m, c, *a, **k: (shown.extend(c), draw(m, c, *a, **k))[1])
    files = made("fig8", tmp_path)
    assert set(files) == {"fig8a.png", "fig8b.png", "fig8.csv"}
    assert all(path.stat().st_size > 1000 for path in files.values())
    assert [text.split("\n")[0] for text in shown] == [
        f"{source}, {shape}"
        for shape in SHAPE_CLASSES
        for source in ("AABB" if sources().found.reference.classes.count(shape) > 1 else "ABBB")
    ]
    assert sum("paper (600 + 600):  BC 0.98" in caption.text for caption in captions) == 4
    table = read(files["fig8.csv"])
    assert [row["paper"] for row in table if row["quantity"] == "mean of A"] == ["0.6513", "0.4158", "0.8924", "0.8017"]


# ------------------------------------------------------------------------------------------------------------- faults


def test_the_folder_of_the_scans_has_to_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(populations.FOLDER_VARIABLE, str(tmp_path / "nothing"))
    with pytest.raises(FileFormatError, match=r"LITHOFORM_FDOT57 names .*nothing: get NIST's coefficient files"):
        FIGURES["table3"].make(tmp_path / "out", seed=None, device="auto")
    assert not (tmp_path / "out").exists()
    monkeypatch.delenv(populations.FOLDER_VARIABLE)
    monkeypatch.setattr(populations, "_FOLDER", Path("shared", "data", "no such scans"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError, match="there is no shared/data/no such scans"):
        populations.find_reference()
    (tmp_path / "shared" / "data" / "no such scans").mkdir(parents=True)
    assert populations.find_reference() == tmp_path / "shared" / "data" / "no such scans"
    (tmp_path / "deeper").mkdir()
    monkeypatch.chdir(tmp_path / "deeper")
    assert populations.find_reference().samefile(tmp_path / "shared" / "data" / "no such scans")


def test_a_folder_without_scans_and_a_damaged_scan_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "rock"
    folder.mkdir()
    monkeypatch.setenv(populations.FOLDER_VARIABLE, str(folder))
    with pytest.raises(LithoformError, match="holds no scans"):
        FIGURES["table3"].make(tmp_path / "out", triangles=TRIANGLES)
    (folder / "bad.ply").write_bytes(b"ply\n")
    with pytest.raises(FileFormatError, match=r"bad\.ply"):
        FIGURES["table3"].make(tmp_path / "out", triangles=TRIANGLES)


@pytest.mark.usefixtures("few")
def test_wrong_requests_are_refused_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(populations, "_sources", lambda *_: pytest.fail("the work began"))
    with pytest.raises(OutputError, match="expected a folder"):
        FIGURES["fig9"].make(tmp_path / "fig9.png", triangles=TRIANGLES)
    with pytest.raises(RecipeError, match="triangles"):
        FIGURES["table3"].make(tmp_path, triangles=1234)
    with pytest.raises(LithoformError):
        FIGURES["table3"].make(tmp_path, device="tpu")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        FIGURES["table3"].make(tmp_path / "file", triangles=TRIANGLES)
