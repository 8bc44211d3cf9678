"""Figures of two populations: every number in its place, nothing upon another, from 5 particles to 5,000."""

from __future__ import annotations

import math

import numpy as np
import pytest
from captions import record_captions
from scipy import integrate, stats

from lithoform.errors import LithoformError
from lithoform.figures.gallery import png_bytes
from lithoform.figures.populations import (
    Effect,
    Panel,
    _kernel_density,
    _tick_labels,
    distribution_figure,
    effects_figure,
    heading,
    histogram_figure,
    require_figures,
)
from lithoform.figures.sheet import COLOURS
from lithoform.statistics.comparison import compare_samples

pytest.importorskip("matplotlib")

DPI = 100
LABELS = ("scans of a quarry", "generated")
FIGURES = (histogram_figure, distribution_figure)


def panel(
    n: int = 60, m: int = 90, *, name: str = "roundness", scale: float = 1.0, notes: tuple[str, ...] = ()
) -> Panel:
    generator = np.random.default_rng(n + m)
    a, b = scale * generator.normal(0.65, 0.02, n), scale * generator.normal(0.66, 0.03, m)
    words, symbol = heading(name)
    return Panel(words, (a, b), compare_samples(a, b, seed=1, permutations=60, bootstrap=60), symbol, notes)


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize(("n", "m"), [(5, 5), (60, 5000), (5000, 5000)])
def test_few_and_many_particles_are_drawn(figure, n: int, m: int, monkeypatch: pytest.MonkeyPatch) -> None:
    captions = record_captions(monkeypatch)
    one = panel(n, m)
    picture = figure([one, one], LABELS, title="All particles", dpi=DPI)
    shown = [caption.text for caption in captions]
    assert {"All particles", "A: scans of a quarry", "B: generated", "Roundness $R$"} <= set(shown)
    for letter, values in zip("AB", one.values, strict=True):
        (text,) = {text for text in shown if text.startswith(f"{letter}  ")}
        mean, deviation, size = text[3:].replace(" ± ", " ").replace(" n ", " ").split()
        assert float(mean) == pytest.approx(values.mean(), rel=1e-3)
        assert float(deviation) == pytest.approx(values.std(ddof=1), rel=5e-3)
        assert int(size.replace(",", "")) == len(values)
    # Both colours are there, as lines on white.
    for colour in COLOURS[:2]:
        rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        assert (np.abs(picture.astype(int) - rgb).sum(axis=2) < 40).sum() > 30


def test_the_indices_are_those_of_the_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    captions = record_captions(monkeypatch)
    one = panel(notes=("paper: BC 0.9840",))
    histogram_figure([one], LABELS, dpi=DPI)
    distribution_figure([one], LABELS, dpi=DPI)
    shown = [caption.text for caption in captions]
    assert shown.count("paper: BC 0.9840") == 2
    (line,) = [text for text in shown if text.startswith("BC ")]
    found = one.comparison
    bc, kl, js = (found.index(name) for name in ("bhattacharyya", "kullback_leibler", "jensen_shannon"))
    assert line == (
        f"BC {bc.value:.3f} ({bc.floor_mean:.3f})   KL {kl.value:.3f} ({kl.floor_mean:.3f})   "
        f"JS {js.value:.3f} ({js.floor_mean:.3f})   p of BC {bc.p:.2g}"
    )
    (tails,) = [text for text in shown if text.startswith("P5 ")]
    assert any(text.startswith("P95 ") for text in shown)
    assert f"{found.estimate('percentile_5_difference').value:+.2g}".replace("-", "−") in tails
    (ks,) = [text for text in shown if text.startswith("KS ")]
    greatest = stats.ks_2samp(*one.values).statistic
    assert ks.startswith(f"KS {greatest:.3f} (")
    assert ks.endswith(f"p of KS {found.index('kolmogorov_smirnov').p:.2g}")
    assert sum("p is not adjusted" in text for text in shown) == 2


def test_bars_are_the_counts_of_the_comparison(monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.patches import StepPatch

    from lithoform.figures import populations

    kept = []
    write = populations._draw_histograms
    monkeypatch.setattr(populations, "_draw_histograms", lambda axes, one: (kept.append(axes), write(axes, one))[1])
    one = panel()
    histogram_figure([one], LABELS, dpi=DPI)
    filled = [patch for patch in kept[0].patches if isinstance(patch, StepPatch) and patch.get_fill()]
    for patch, counts, size in zip(filled, one.comparison.counts, one.comparison.sizes, strict=True):
        values, edges, _ = patch.get_data()
        np.testing.assert_allclose(values, 100.0 * counts / size)
        np.testing.assert_array_equal(edges, one.comparison.edges)
        assert values.sum() == pytest.approx(100.0)


@pytest.mark.parametrize("figure", FIGURES)
def test_samples_that_are_not_compared_are_shown_as_they_are(figure, monkeypatch: pytest.MonkeyPatch) -> None:
    captions = record_captions(monkeypatch)
    many = np.random.default_rng(0).normal(0.7, 0.05, 150)
    panels = [
        Panel("two and many", (np.array([0.7, 0.75]), many)),
        Panel("none and many", (np.empty(0), many)),
        Panel("one value", (np.full(1, 0.5), np.empty(0))),
        Panel("all alike", (np.full(7, 0.5), np.full(6, 0.5))),
    ]
    picture = figure(panels, LABELS, dpi=DPI)
    shown = [caption.text for caption in captions]
    assert shown.count("too few to compare") == 4
    assert "A  none  n 0" in shown
    assert picture.min() < 128


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e4, 1e9])
def test_any_unit_can_be_read(scale: float, monkeypatch: pytest.MonkeyPatch) -> None:
    captions = record_captions(monkeypatch)
    panels = [panel(name="volume", scale=scale), panel(name="volume", scale=-scale)]
    for figure in FIGURES:
        captions.clear()
        picture = figure(panels, LABELS, dpi=DPI)
        assert picture.min() < 128
        told = [caption.text for caption in captions if caption.text.startswith("A  ")]
        means = [float(text[3:].partition(" ± ")[0]) for text in told]
        assert means == pytest.approx([one.values[0].mean() for one in panels], rel=1e-3)


def test_labels_are_plain_text_and_not_too_long(monkeypatch: pytest.MonkeyPatch, recwarn) -> None:
    captions = record_captions(monkeypatch)
    labels = ("cost $5 of $x_1$ \\frac", "石 \x07" + "very long " * 30)
    histogram_figure([panel()], labels, title="$ 100 %", dpi=DPI)
    effects_figure([Effect("$g$", "$x$", 0.1, 0.0, 0.2)], labels, dpi=DPI)
    shown = [caption.text for caption in captions]
    assert "A: cost $5 of $x_1$ \\frac" in shown
    assert any(text.startswith("B: □ □very long") and text.endswith("...") for text in shown)
    assert not recwarn.list


def test_effect_sizes_are_written_and_drawn_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    captions = record_captions(monkeypatch)
    effects = [
        Effect("pooled", "roundness", 0.12, -0.05, 0.30),
        Effect("pooled", "solidity", -2.5, -math.inf, -1.0),
        Effect("cube", "roundness", 0.0, -0.2, 0.2),
        Effect("cube", "solidity", 9.0, 8.0, 2.0e16),
    ]
    picture = effects_figure(effects, LABELS, dpi=DPI)
    places = {caption.text: caption.bottom for caption in captions}
    shown = list(places)
    assert "+0.12  (−0.05 to +0.30)" in shown
    assert "−2.50  (−∞ to −1.00)" in shown
    assert "+9.00  (+8.00 to +2.0e+16)" in shown
    numbers = [places[text] for text in shown if " to " in text and text[0] in "+−"]
    assert numbers == sorted(numbers, reverse=True)
    assert places["pooled"] > places["cube"]
    many = [Effect(f"group {i // 18}", f"d{i % 18}", 0.1 * i - 4, 0.1 * i - 5, 0.1 * i - 3) for i in range(90)]
    assert effects_figure(many, LABELS, dpi=DPI).shape[0] > 4 * picture.shape[0]


def test_the_curve_is_a_kernel_estimate() -> None:
    values = np.random.default_rng(4).gamma(3.0, 1.0, 2500)
    x = np.linspace(-5, 30, 4001)
    curve = _kernel_density(values, x)
    assert integrate.simpson(curve, x=x) == pytest.approx(1.0, abs=1e-6)
    lower, upper = np.quantile(values, [0.25, 0.75])
    width = 0.9 * min(values.std(ddof=1), (upper - lower) / 1.34) * 2500**-0.2
    expected = stats.gaussian_kde(values, bw_method=width / values.std(ddof=1))
    np.testing.assert_allclose(curve[::200], expected(x[::200]), rtol=1e-9, atol=1e-15)
    assert _kernel_density(np.full(9, 2.0), x) is None


def test_ticks_have_as_many_digits_as_tell_them_apart() -> None:
    assert _tick_labels(np.array([0.7, 0.75, 0.8])) == ["0.70", "0.75", "0.80"]
    assert _tick_labels(np.array([-1.0, 0.0, 1.0])) == ["−1", "0", "1"]
    assert _tick_labels(np.array([0.0, 0.0025, 0.005])) == ["0.0000", "0.0025", "0.0050"]
    assert _tick_labels(np.array([0.0, 2e-7, 4e-7])) == ["0", "2e-07", "4e-07"]
    assert _tick_labels(np.array([])) == []


@pytest.mark.parametrize("figure", FIGURES)
def test_the_same_results_give_the_same_bytes_whatever_the_users_settings(figure) -> None:
    import matplotlib as mpl

    one = panel()
    plain = png_bytes(figure([one], LABELS, dpi=DPI))
    with mpl.rc_context({"font.size": 20, "axes.grid": True}):
        assert png_bytes(figure([one], LABELS, dpi=DPI)) == plain


@pytest.mark.parametrize("figure", FIGURES)
def test_nothing_to_draw_is_refused(figure) -> None:
    for panels in ([], [Panel("x", (np.empty(0), np.empty(0)))]):
        with pytest.raises(LithoformError, match="needs at least one panel, and a value in each"):
            figure(panels, LABELS)


def test_no_effects_and_no_extra_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LithoformError, match="needs at least one; got none"):
        effects_figure([], LABELS)
    monkeypatch.setitem(__import__("sys").modules, "PIL.Image", None)
    with pytest.raises(LithoformError, match="needs PIL"):
        require_figures()


def test_a_descriptor_beyond_the_papers_goes_by_its_name() -> None:
    assert heading("true_sphericity") == ("True sphericity", "TS")
    assert heading("fractal_dimension") == ("fractal dimension", "")
