"""`lithoform sensitivity`, its figures, and Fig. 5 and 6: what they write, that they go on, what they refuse."""

from __future__ import annotations

import csv
import functools
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from captions import record_captions

from lithoform.axes import TABLE_7
from lithoform.cli.sensitivity import sensitivity
from lithoform.database import building
from lithoform.descriptors.table import FOUR
from lithoform.errors import LithoformError, OutputError, RecipeError, SampleError
from lithoform.figures.sensitivity import CurvePanel, curves_figure, screening_figure, shares_figure, sign_of
from lithoform.reproduce import sensitivity as figures
from lithoform.sensitivity.designs import axes_for
from lithoform.sensitivity.oat import read_curves

COARSE = ("--triangles", "128", "--workers", "0")
SWEEP = ("--points", "2", "--seeds", "2", *COARSE)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Few stones need no processes, and these pictures no fine dots."""
    monkeypatch.setattr(figures, "build", lambda *args, **options: building.build(*args, **options, workers=0))
    for name in ("curves_figure", "twist_figure"):
        monkeypatch.setattr(figures, name, functools.partial(getattr(figures, name), dpi=60))


@pytest.fixture
def call(capsys, monkeypatch, tmp_path):
    """Run a command of the group in an empty folder; gives exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        status = sensitivity(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")
        captured = capsys.readouterr()
        return status or 0, captured.out, captured.err

    return run


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def read(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))


# ---------------------------------------------------------------------------------------------------------- commands


def test_a_sweep_tells_its_effects_its_trends_and_what_it_left_out(call, tmp_path):
    status, out, err = call("oat", "sweep", *SWEEP)
    assert status == 0
    # 128 triangles cannot follow the twist at r = 5: both seeds of one point.
    assert "2 stones could not be made, 2 of them because: 128 triangles cannot follow a twist" in err
    assert "claims held." in out
    assert "62 stones" in out
    curves = read_curves(tmp_path / "sweep" / "oat.csv")
    assert [axis.name for axis in curves.axes] == [axis.name for axis in TABLE_7]
    assert curves.stones[0].tolist() == [2, 0]
    assert np.isnan(curves.mean[0][1]).all()
    assert all(stones.tolist() == [2, 2] for stones in curves.stones[1:])
    trends = read(tmp_path / "sweep" / "oat_trends.csv")
    assert {row["held"] for row in trends} <= {"yes", "no"}
    assert {row["found"] for row in trends if row["parameter"] == "base_radius"} == {"only 1 points with stones"}
    assert (tmp_path / "sweep" / "oat.png").read_bytes()[:4] == b"\x89PNG"

    # Once finished, the bare command reads how it was begun and only draws anew: the same bytes.
    before = bytes_of(tmp_path / "sweep")
    (tmp_path / "sweep" / "oat.png").unlink()
    status, out, _ = call("oat", "sweep", "--json")
    told = json.loads(out)
    assert (told["stones"], told["failed"], len(told["trends"])) == (62, 2, len(trends))
    assert told["ranges"]["gain"]["roundness"] == pytest.approx(np.ptp(curves.mean[8][:, 0]))
    assert bytes_of(tmp_path / "sweep") == before

    with pytest.raises(OutputError, match=r"other settings .*seeds differ"):
        call("oat", "sweep", "--seeds", "3")


def test_a_mean_without_a_stone_is_null_in_json(call, monkeypatch):
    from lithoform.sensitivity import oat

    def sparse(design, responses):
        found = oat_sweep(design, responses)
        first = np.full_like(found.responses[0], np.nan)
        return replace(found, responses=(first, *found.responses[1:]), baseline=np.full_like(found.baseline, np.nan))

    oat_sweep = oat.sweep_of
    monkeypatch.setattr(oat, "sweep_of", sparse)
    monkeypatch.setattr(figures, "curves_picture", lambda *_: b"")
    status, out, _ = call("oat", "sweep", "--points", "2", "--seeds", "1", *COARSE, "--json")
    told = json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert status == 0
    assert told["baseline"] == dict.fromkeys(FOUR)
    assert told["ranges"]["base_radius"] == dict.fromkeys(FOUR)
    assert told["ranges"]["gain"]["roundness"] >= 0.0


def test_screening_and_shares_stand_beside_each_other_in_one_folder(call, tmp_path):
    options = ("--triangles", "1280", "--workers", "0", "--seeds", "1", "--json")
    status, out, _ = call("morris", "study", "--trajectories", "2", *options)
    told = json.loads(out)
    assert (status, told["stones"], told["failed"], told["trajectories"]) == (0, 40, 0, 2)
    names = [axis.name for axis in axes_for(1280)]
    assert list(told["effects"]) == names
    rows = read(tmp_path / "study" / "morris.csv")
    assert [(r["parameter"], r["descriptor"]) for r in rows] == [(n, d) for n in names for d in FOUR]
    assert float(rows[0]["mu_star"]) == told["effects"]["base_radius"]["mu_star"]["roundness"]
    assert told["noise_shares"]["roundness"] is None  # of one seed

    status, out, _ = call("sobol", "study", "--samples", "4", *options)
    told = json.loads(out)
    assert (status, told["stones"], told["samples"]) == (0, 84, 4)
    for entry in told["shares"].values():
        assert entry["total"]["solidity"] >= 0.0
        assert entry["total_low"]["solidity"] <= entry["total_high"]["solidity"]
    with pytest.raises(OutputError) as refused:
        call("morris", "study", "--trajectories", "3", *options)
    assert "(count, trajectories differ)" in str(refused.value)
    assert "or another folder for" in str(refused.value)
    assert "--source" not in str(refused.value)
    for name in ("morris", "sobol"):
        assert (tmp_path / "study" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    status, out, _ = call("sobol", "study")
    assert status == 0
    assert "84 stones" in out
    # The dimensions are inputs, and the solidity does not feel them but for the cut of the support face.
    shares = told["shares"]
    assert shares["elongation"]["total"]["solidity"] < 0.01
    assert shares["flatness"]["total"]["boxiness"] < 0.6


def test_left_out_blocks_are_told(call):
    # Eight triangles follow hardly any twist.
    with pytest.raises(SampleError, match="use more triangles"):
        call("morris", "study", "--trajectories", "2", "--triangles", "8", "--workers", "0", "--seeds", "1")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("oat", "out", "--seeds", "0"), "1 seed"),
        (("oat", "out", "--points", "1"), "at least 2 points"),
        (("morris", "out", "--levels", "5"), "even number"),
        (("sobol", "out", "--samples", "100"), "power of two"),
        (("oat", "out", "--triangles", "100"), "nearest counts"),
        (("oat", "out", "--workers", "-1"), "--workers of at least 0"),
        (("morris", "out", "--workers", "-1"), "--workers of at least 0"),
        (("sobol", "out", "--workers", "-1"), "--workers of at least 0"),
    ],
)
def test_options_that_make_no_sense_are_refused_before_any_work(call, tmp_path, arguments, told):
    with pytest.raises(RecipeError, match=told):
        call(*arguments)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_somebody_else_is_refused(call, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(OutputError, match="holds other files"):
        call("oat", "mine", *SWEEP)


def test_an_interrupt_leaves_what_is_done(call, tmp_path, monkeypatch):
    from lithoform import progress

    whole = progress.track

    def stopped(items, **options):
        for done, item in enumerate(whole(items, **options)):
            if done == 30:
                raise KeyboardInterrupt
            yield item

    monkeypatch.setattr(figures, "curves_picture", lambda *_: b"")  # drawn in other tests
    monkeypatch.setattr(progress, "track", stopped)
    status, _, err = call("oat", "sweep", *SWEEP)
    assert status == 130
    assert "holds 30 of 62 stones: the same command goes on" in err
    monkeypatch.setattr(progress, "track", whole)
    assert call("oat", "sweep")[0] == 0
    call("oat", "other", *SWEEP)
    assert bytes_of(tmp_path / "sweep") == bytes_of(tmp_path / "other")


# ----------------------------------------------------------------------------------------------------------- figures


def panel(name: str = "gain", *, is_log: bool = False) -> CurvePanel:
    values = np.array([0.1, 1.0, 10.0])
    mean = np.linspace(0.2, 0.8, 12).reshape(3, 4)
    return CurvePanel(name, values, mean, 0.05 + 0 * mean, mean - 0.02, mean + 0.02, 1.0, is_log)


def test_curves_are_drawn_with_the_benchmark_and_a_key(monkeypatch):
    captions = record_captions(monkeypatch)
    picture = curves_figure([panel(), panel("chip_sharpness", is_log=True)], title="Curves", note="two", dpi=60)
    assert picture.dtype == np.uint8
    assert picture.shape[1] == round(180.0 * 60 / 25.4)
    told = " | ".join(caption.text for caption in captions)
    for word in ("Curves", "two", "benchmark", "Roundness", "True sphericity", r"$\kappa$"):
        assert word in told
    # A curve that moves moves pixels; the same curves give the same pixels.
    assert (curves_figure([panel()], title="", dpi=60) == curves_figure([panel()], title="", dpi=60)).all()
    other = panel()
    moved = CurvePanel(**{**vars(other), "mean": other.mean[::-1]})
    assert (curves_figure([panel()], title="", dpi=60) != curves_figure([moved], title="", dpi=60)).any()


def test_screening_and_shares_are_drawn(monkeypatch):
    names = [axis.name for axis in axes_for(20_000)]
    some = np.random.default_rng(0).random((19, 4))
    assert screening_figure(names, some, 0.1 * some, some, title="Screening", dpi=60).ndim == 3
    some[:, 2] = math.nan  # of a constant descriptor
    captions = record_captions(monkeypatch)
    assert shares_figure(names, (some, some, some), (some, some, some), title="Shares", dpi=60).ndim == 3
    assert {sign_of(name) for name in names} <= {caption.text for caption in captions}
    for draw in (
        lambda: curves_figure([], title=""),
        lambda: screening_figure([], some, some, some, title=""),
        lambda: shares_figure([], (some,) * 3, (some,) * 3, title=""),
    ):
        with pytest.raises(LithoformError, match="at least one"):
            draw()


def test_figure_6_is_the_sweep(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "_SWEEP_SEEDS", 1)
    paths = figures.figure_6(tmp_path, triangles=512)
    assert [path.name for path in paths] == ["fig6.png", "fig6.csv", "fig6_trends.csv"]
    curves = read_curves(paths[1])
    assert [len(values) for values in curves.values] == [11] * 15
    # Without relief the stone is an ellipsoid with axes 2, 1.5, 1, whatever the rest: B = pi / 6, S = 1.
    smooth = curves.mean[1][0]
    assert smooth[1] == pytest.approx(math.pi / 6, rel=0.03)
    assert smooth[2] == pytest.approx(1.0, abs=5e-3)
    with pytest.raises(OutputError, match="expected a folder"):
        figures.figure_6(tmp_path / "fig6.png", triangles=1280)


@pytest.mark.usefixtures("drawing")
def test_figure_5_has_stones_and_claims(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "_TWIST_SEEDS", 2)
    paths = figures.figure_5(tmp_path, triangles=200)
    assert [path.name for path in paths] == ["fig5.png", "fig5.csv", "fig5_claims.csv"]
    assert len(read(paths[1])) == 4 * 2 * 7
    means = {(r["class"], r["calibration"], r["twist_rate"]): float(r["solidity_mean"]) for r in read(paths[1])}
    # Solidity does not feel an affine map; only the cut of the support face can tell the classes apart.
    for rate in ("0.0", "60.0"):
        alike = [value for (_, _, r), value in means.items() if r == rate]
        assert np.ptp(alike) < 0.01
    assert {row["held"] for row in read(paths[2])} == {"yes", "no"}
