"""Recipes: ranges, messages, names, files, settings, presets."""

import dataclasses
import json
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from lithoform.errors import FileFormatError, RecipeError
from lithoform.parameters import CHOICES, PARAMETERS, Recipe, find_parameter, resolve_topology
from lithoform.presets import (
    PRESETS,
    SHAPE_CLASSES,
    benchmark_recipe,
    database_recipe,
    draw_size,
    particle_seed,
)
from lithoform.recipe_io import from_dict, parse_setting, parse_settings, read_recipe, to_toml
from lithoform.seeds import MAX_SEED
from lithoform.topology import sphere

NUMBERS = [p for p in PARAMETERS if p.kind == "number"]
INTEGERS = [p for p in PARAMETERS if p.kind == "integer"]
VECTORS = [p for p in PARAMETERS if p.kind == "vector"]
BOUNDED = [p for p in PARAMETERS if math.isfinite(p.low)]


def named(parameters):
    return pytest.mark.parametrize("p", parameters, ids=[p.name for p in parameters])


def shaped(p, number):
    """The number as a value of the parameter's kind."""
    return (number, 0.0, 0.0) if p.kind == "vector" else number


def fitting(p, value) -> dict:
    """Further fields with which a value at the end of a range agrees with the rest of the recipe."""
    if p.name in ("length", "width", "height"):
        return {"length": value, "width": value, "height": value}
    if p.name == "triangles":
        return {"twist_rate": 0.0}
    if p.name == "base_radius":
        return {"triangles": 20_000}
    return {}


def label(p) -> str:
    return f"{p.name} ({p.symbol})" if p.symbol != p.name else p.name


# ------------------------------------------------------------------------------------------------ the table


def test_the_defaults_are_table_1():
    r = Recipe()
    table = dict(
        r=0.5, k=0.3, s=1.5, s_w=1.5, eta=0.5, delta=(0, 0, 0), O=5, g=0.5, alpha=0.8, beta=0.3, gamma=0.15, kappa=0.5,
        A_L=0.15, f_L=1, a=(1, 0, 1), p0=(1, 0, 0), rho=45, L=2, W=1.5, H=1, **{"lambda": 1.5},
    )  # fmt: skip
    for symbol, value in table.items():
        assert getattr(r, find_parameter(symbol)) == value, symbol
    assert r.size == (2.0, 1.5, 1.0)
    assert r == benchmark_recipe() == from_dict({})


def test_the_ranges_are_table_7():
    table = dict(
        k=(0, 1), s=(0, 3), s_w=(0, 3), eta=(0, 1), delta=(-6, 6), O=(0, 10), g=(0, 1), alpha=(0, 2), beta=(0, 1),
        gamma=(0, 2), kappa=(0.1, 128), A_L=(0, 8), f_L=(0, 5), rho=(0, 60), **{"lambda": (0, 3)},
    )  # fmt: skip
    rows = {p.symbol: p for p in PARAMETERS}
    for symbol, (low, high) in table.items():
        assert (rows[symbol].low, rows[symbol].high) == (low, high), symbol
    assert 0 < rows["r"].low <= 1e-6
    assert rows["r"].high == 5


def test_every_field_is_described_once():
    names = [p.name for p in PARAMETERS]
    fields = {f.name for f in dataclasses.fields(Recipe)}
    assert len(set(names)) == len(names)
    assert len({p.symbol for p in PARAMETERS}) == len(names)
    assert fields - set(names) - set(CHOICES) == {"calibration_align", "flatten"}
    assert all(p.meaning and p.unit for p in PARAMETERS)


@named(BOUNDED)
def test_both_ends_of_a_range_are_accepted(p):
    for end in (p.low, p.high):
        value = shaped(p, end)
        recipe = Recipe(**{**fitting(p, end), p.name: value})
        assert getattr(recipe, p.name) == value


@named(BOUNDED)
def test_just_outside_a_range_is_refused(p):
    below = p.low - 1 if p.kind == "integer" else math.nextafter(p.low, -math.inf)
    above = p.high + 1 if p.kind == "integer" else math.nextafter(p.high, math.inf)
    for value in (below, above, p.low - 10 * (abs(p.low) + 1), p.high + 10 * (abs(p.high) + 1)):
        with pytest.raises(RecipeError) as caught:
            Recipe(**{**fitting(p, p.low), p.name: shaped(p, value)})
        assert str(caught.value).startswith(f"{label(p)} must be ")


@named(PARAMETERS)
@pytest.mark.parametrize(
    "value", [math.nan, math.inf, -math.inf, "0.5", None, True, 1j, [], {}, b"1", np.True_, np.array(["a", "b", "c"])]
)
def test_what_is_no_number_is_refused_by_name_and_symbol(p, value):
    for candidate in (value, (value, 0.0, 0.0)) if p.kind == "vector" else (value,):
        with pytest.raises(RecipeError) as caught:
            Recipe(**{p.name: candidate})
        assert label(p) in str(caught.value)


@named(VECTORS)
@pytest.mark.parametrize("value", [(1, 2), (1, 2, 3, 4), 1.0, (), np.ones((3, 3)), np.ones((1, 3)), "1,2,3", iter([1])])
def test_vectors_of_another_shape_are_refused(p, value):
    with pytest.raises(RecipeError) as caught:
        Recipe(**{p.name: value})
    assert label(p) in str(caught.value)


@named(NUMBERS + INTEGERS)
@pytest.mark.parametrize("value", [(1.0,), [1, 2, 3], np.ones(3)])
def test_vectors_in_place_of_numbers_are_refused(p, value):
    with pytest.raises(RecipeError) as caught:
        Recipe(**{p.name: value})
    assert label(p) in str(caught.value)


@named(INTEGERS)
def test_fractions_in_place_of_whole_numbers_are_refused(p):
    with pytest.raises(RecipeError) as caught:
        Recipe(**{p.name: 8.5})
    assert label(p) in str(caught.value)


@named(NUMBERS + VECTORS)
def test_numbers_too_large_for_float64_are_refused_like_any_other(p):
    with pytest.raises(RecipeError) as caught:
        Recipe(**{p.name: shaped(p, 10**400)})
    assert label(p) in str(caught.value)


def test_numpy_and_other_real_numbers_become_plain_ones():
    recipe = Recipe(
        perturbation=np.float32(0.25),
        gain=Fraction(1, 2),
        octaves=np.int64(4),
        seed=np.uint64(MAX_SEED),
        phase_offset=np.array([1, 2, 3], dtype=np.float32),
        twist_axis=[0, 0, 2],
        triangles=20_000.0,
    )
    assert recipe == Recipe(
        perturbation=0.25, gain=0.5, octaves=4, seed=MAX_SEED, phase_offset=(1, 2, 3), twist_axis=(0, 0, 2)
    )
    assert [type(recipe.perturbation), type(recipe.octaves), type(recipe.seed)] == [float, int, int]
    assert {type(c) for c in recipe.phase_offset + recipe.twist_axis} == {float}
    assert type(recipe.triangles) is int
    json.dumps(recipe.as_dict())


def test_a_recipe_is_frozen_and_hashable():
    recipe = Recipe()
    with pytest.raises(dataclasses.FrozenInstanceError):
        recipe.perturbation = 0.1
    assert len({recipe, Recipe(), recipe.replace(seed=1)}) == 2


@pytest.mark.parametrize("name", CHOICES)
@pytest.mark.parametrize("value", ["", "PCA", None, 3, True, ["pca"]])
def test_unknown_choices_are_refused_with_the_known_ones(name, value):
    with pytest.raises(RecipeError) as caught:
        Recipe(**{name: value})
    assert f"{name} must be one of {', '.join(CHOICES[name])}" in str(caught.value)


@pytest.mark.parametrize("name", ["flatten", "calibration_align"])
@pytest.mark.parametrize("value", [1, 0, "true", None])
def test_flags_are_true_or_false(name, value):
    with pytest.raises(RecipeError, match=f"{name} must be true or false"):
        Recipe(**{name: value})


@pytest.mark.parametrize("name", ["layer_normal", "twist_axis"])
@pytest.mark.parametrize("value", [(0, 0, 0), (1e-200, 0, 0), (0, 1e200, 0)])
def test_directions_need_a_length(name, value):
    with pytest.raises(RecipeError, match=f"{name} .* must be a direction"):
        Recipe(**{name: value})
    assert Recipe(**{name: (0, 0, 1e-100)}) != Recipe()


@pytest.mark.parametrize(
    ("size", "message"),
    [((1, 2, 1), "L >= W >= H"), ((2, 1, 1.5), "L >= W >= H"), ((2000, 1.9, 1.9), "at most 1000")],
)
def test_dimensions_that_do_not_agree_are_refused(size, message):
    with pytest.raises(RecipeError, match=message):
        Recipe().replace(size=size)
    assert Recipe().replace(size=(1000, 1, 1)).size == (1000, 1, 1)
    assert Recipe().replace(size=(1, 1, 1)).size == (1, 1, 1)


def test_a_taubin_pair_that_shrinks_is_refused_with_one_that_does_not():
    with pytest.raises(RecipeError, match=r"try mu = -0\.636") as caught:
        Recipe(smoothing_method="taubin", smoothing_iterations=1, smoothing_lambda=0.6)
    mu = float(str(caught.value).rsplit("= ", 1)[1].rstrip("."))
    Recipe(smoothing_method="taubin", smoothing_iterations=1, smoothing_lambda=0.6, smoothing_mu=mu)
    Recipe(smoothing_method="taubin", smoothing_iterations=0, smoothing_lambda=0.6)


# ------------------------------------------------------------------------------------------------ names


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("octave", "octaves"),
        ("lacunarty", "lacunarity"),
        ("Lambda", "lambda"),
        ("pertubation", "perturbation"),
        ("sW", "s_w"),
        ("kapa", "kappa"),
        ("twist-rate", "twist_rate"),
        ("SEED", "seed"),
        ("a_l", "A_L"),
    ],
)
def test_an_unknown_name_suggests_the_nearest(wrong, right):
    with pytest.raises(RecipeError, match=rf"there is no parameter '{wrong}'. Did you mean .*\b{right}\b"):
        find_parameter(wrong)
    for attempt in (
        lambda: Recipe().replace(**{wrong: 1}),
        lambda: from_dict({wrong: 1}),
        lambda: parse_setting(f"{wrong}=1"),
    ):
        with pytest.raises(RecipeError, match=rf"\b{right}\b"):
            attempt()


def test_a_name_like_no_other_gets_no_suggestion():
    with pytest.raises(RecipeError, match=r"^there is no parameter 'qqqqqqqq'\.$"):
        find_parameter("qqqqqqqq")


def test_every_name_and_symbol_is_found():
    for p in PARAMETERS:
        assert find_parameter(p.name) == find_parameter(p.symbol) == p.name


def test_a_name_given_twice_is_refused():
    with pytest.raises(RecipeError, match="perturbation is given twice, once as 'k'"):
        from_dict({"perturbation": 0.1, "k": 0.2})


@pytest.mark.parametrize("other", [{"length": 3.0}, {"W": 1.2}, {"height": 0.1}])
def test_a_size_beside_a_dimension_is_refused_and_never_dropped(other):
    with pytest.raises(RecipeError, match=r"twice|size"):
        from_dict({"size": [2.0, 1.0, 0.5], **other})
    with pytest.raises(RecipeError, match=r"twice|size"):
        Recipe().replace(size=(2.0, 1.0, 0.5), **other)


@pytest.mark.parametrize("value", [3.0, (1, 2), "2,1,1", (1, 1, 1, 1), None])
def test_a_size_of_another_shape_is_refused(value):
    with pytest.raises(RecipeError, match="size must be three numbers"):
        Recipe().replace(size=value)


# ------------------------------------------------------------------------------------------------ topology


@pytest.mark.parametrize(
    ("triangles", "kind", "n"),
    [
        (8, "octahedral", 1),
        (20, "icosahedral", 1),
        (5_000, "octahedral", 25),
        (20_000, "octahedral", 50),
        (51_200, "octahedral", 80),
        (20_480, "icosahedral", 32),
        (8_000_000, "octahedral", 1000),
    ],
)
def test_counts_that_can_be_met(triangles, kind, n):
    assert resolve_topology(triangles) == (kind, n) == resolve_topology(triangles, kind)
    if triangles < 100_000:
        assert len(sphere(kind, n).faces) == triangles


def test_no_count_is_met_by_both_topologies():
    assert not {8 * n * n for n in range(1, 2000)} & {20 * n * n for n in range(1, 2000)}


@pytest.mark.parametrize(
    ("triangles", "topology", "nearest"),
    [
        (20_001, "auto", "20000 and 20480"),
        (20_001, "octahedral", "20000 and 20808"),
        (20_000, "icosahedral", "19220 and 20480"),
        (9, "auto", "8 and 20"),
        (10, "icosahedral", "are 20"),
        (31, "auto", "20 and 32"),
    ],
)
def test_counts_that_cannot_be_met_are_refused_with_the_nearest(triangles, topology, nearest):
    with pytest.raises(RecipeError, match=f"got {triangles}: the nearest counts.* {nearest}"):
        resolve_topology(triangles, topology)
    with pytest.raises(RecipeError, match=nearest):
        Recipe(triangles=triangles, topology=topology, twist_rate=0)


def test_the_nearest_counts_are_the_nearest():
    every = sorted({c * n * n for c in (8, 20) for n in range(1, 60)})
    for triangles in range(8, 3000):
        if triangles in every:
            resolve_topology(triangles)
            continue
        below, above = max(c for c in every if c < triangles), min(c for c in every if c > triangles)
        with pytest.raises(RecipeError, match=f"{below} and {above}"):
            resolve_topology(triangles)


def test_a_twist_too_strong_for_the_mesh_is_refused_with_a_count_that_is_accepted():
    refused = 0
    for topology, triangles in [("auto", 8), ("auto", 20), ("octahedral", 72), ("icosahedral", 80), ("octahedral", 8)]:
        for rate in (10.0, 29.0, 45.0, 59.99, 60.0):
            for radius in (0.5, 1.0, 2.5, 10 / 3, 5.0):
                change = {"triangles": triangles, "topology": topology, "rho": rate, "r": radius}
                try:
                    Recipe().replace(**change)
                except RecipeError as error:
                    refused += 1
                    words = str(error)
                    assert "cannot follow a twist" in words
                    enough = int(words.split("use at least ")[1].split()[0])
                    assert enough > triangles
                    Recipe().replace(**{**change, "triangles": enough})
                    per_square = 8 if resolve_topology(triangles, topology)[0] == "octahedral" else 20
                    fewer = per_square * (math.isqrt(enough // per_square) - 1) ** 2
                    if fewer:
                        with pytest.raises(RecipeError, match="cannot follow"):
                            Recipe().replace(**{**change, "triangles": fewer})
    assert refused > 30


# ------------------------------------------------------------------------------------------------ replace


def test_replace_takes_names_symbols_and_size_and_validates():
    r = Recipe().replace(k=0.1, twist_rate=10, size=(3, 2, 1), **{"lambda": 2})
    assert (r.perturbation, r.twist_rate, r.size, r.lacunarity) == (0.1, 10, (3, 2, 1), 2)
    assert r.replace() == r
    with pytest.raises(RecipeError, match="perturbation"):
        r.replace(k=2)


# ------------------------------------------------------------------------------------------------ files


def numbers(p):
    return st.floats(p.low, p.high, allow_nan=False) if math.isfinite(p.low) else st.floats(-1e6, 1e6)


RANDOM_FIELDS = {
    p.name: numbers(p)
    if p.kind == "number"
    else st.tuples(*[numbers(p)] * 3)
    if p.kind == "vector"
    else st.integers(int(p.low), int(p.high))
    for p in PARAMETERS
    if p.name not in ("length", "width", "height", "triangles", "twist_rate")
}
RANDOM_FIELDS |= {name: st.sampled_from(choices) for name, choices in CHOICES.items() if name != "topology"}
RANDOM_FIELDS |= {"flatten": st.booleans(), "calibration_align": st.booleans(), "twist_rate": st.floats(0, 60)}


@st.composite
def recipes(draw):
    fields = {name: draw(values) for name, values in RANDOM_FIELDS.items()}
    for name in ("layer_normal", "twist_axis"):
        if max(map(abs, fields[name])) < 1e-100:
            fields[name] = (0.0, 1.0, 0.0)
    fields["smoothing_lambda"] = min(fields["smoothing_lambda"], 0.9)
    fields["smoothing_mu"] = -min(1.0, 1.1 * fields["smoothing_lambda"])
    height = draw(st.floats(1e-9, 1e3))
    width = height * draw(st.floats(1, 30))
    length = width * draw(st.floats(1, 30))
    return Recipe(
        **fields, length=length, width=width, height=height, triangles=draw(st.sampled_from([5000, 20_000, 20_480]))
    )


@given(recipes())
@settings(derandomize=True, max_examples=150, deadline=None)
def test_toml_and_json_round_trips_are_exact(tmp_path_factory, recipe):
    folder = tmp_path_factory.getbasetemp()
    toml, sidecar, bare = folder / "r.toml", folder / "r.json", folder / "bare.json"
    toml.write_text(to_toml(recipe), encoding="utf-8")
    sidecar.write_text(json.dumps({"recipe": recipe.as_dict(), "volume": 1.0}), encoding="utf-8")
    bare.write_text(json.dumps(recipe.as_dict()), encoding="utf-8")
    for file in (toml, sidecar, bare):
        again = read_recipe(file)
        assert again == recipe
        # Equality does not tell 0.0 from -0.0: the texts do.
        assert repr(again) == repr(recipe)


@pytest.mark.parametrize("seed", [0, 1, 2**53 + 1, 2**63 - 1, 2**63, MAX_SEED])
def test_seeds_of_64_bits_survive_every_file(tmp_path, seed):
    (tmp_path / "r.toml").write_text(to_toml(Recipe(seed=seed)))
    (tmp_path / "r.json").write_text(json.dumps({"recipe": Recipe(seed=seed).as_dict()}))
    assert read_recipe(tmp_path / "r.toml").seed == seed
    assert read_recipe(str(tmp_path / "r.json")).seed == seed
    assert parse_setting(f"seed={seed}") == ("seed", seed)


def test_toml_says_what_each_field_is_and_is_read_by_symbol(tmp_path):
    text = to_toml(Recipe())
    for p in PARAMETERS:
        line = next(line for line in text.splitlines() if line.startswith(f"{p.name} = "))
        assert f"# {p.symbol} [{p.unit}]: {p.meaning}" in line
    file = tmp_path / "short.toml"
    file.write_text('k = 0.1\nsize = [0.03, 0.02, 0.01]\ndelta = [1, 2, 3]\n"lambda" = 2\nflatten = false\n')
    expected = Recipe().replace(k=0.1, size=(0.03, 0.02, 0.01), delta=(1, 2, 3), lacunarity=2, flatten=False)
    assert read_recipe(file) == expected
    file.write_text("[recipe]\nk = 0.1\n")
    assert read_recipe(file) == Recipe(perturbation=0.1)


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        ("a.toml", "k = ", FileFormatError, "not valid TOML"),
        ("a.toml", "k = 0.1\nk = 0.2", FileFormatError, "not valid TOML"),
        ("a.json", "{", FileFormatError, "not valid JSON"),
        ("a.json", "[1, 2]", RecipeError, "table of names and values; got list"),
        ("a.json", '{"k": NaN}', RecipeError, "perturbation .k. must be finite"),
        ("a.json", '{"k": null}', RecipeError, "perturbation .k. must be a number"),
        ("a.json", '{"k": true}', RecipeError, "perturbation .k. must be a number"),
        ("a.toml", "k = nan", RecipeError, "must be finite"),
        ("a.toml", 'k = "0.1"', RecipeError, "must be a number; got '0.1'"),
        ("a.toml", "octavs = 3", RecipeError, "Did you mean octaves"),
        ("a.toml", "seed = -1", RecipeError, "seed must be 0 to 18446744073709551615; got -1"),
        ("a.toml", f"seed = {2**64}", RecipeError, f"got {2**64}"),
        ("a.toml", f"k = 1{'0' * 400}", RecipeError, "perturbation"),
        ("a.toml", "[k]\nvalue = 1", RecipeError, "must be a number"),
        ("a.toml", f"k = {'1' * 5000}", FileFormatError, "thousands of digits"),
        ("a.json", f'{{"k": {"1" * 5000}}}', FileFormatError, "thousands of digits"),
        ("a.toml", f"k = {'[' * 50_000}", FileFormatError, "nested too deeply|not valid TOML"),
        ("a.json", f'{{"k": {"[" * 100_000}', FileFormatError, "nested too deeply"),
        ("a.toml", "{", FileFormatError, "not valid JSON"),
        ("a.toml", "delta = [1, 2]", RecipeError, r"phase_offset \(delta\) must be three numbers"),
    ],
)
def test_bad_files_are_one_clear_error_that_names_the_file(tmp_path, name, content, error, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(error, match=message) as caught:
        read_recipe(tmp_path / name)
    assert name in str(caught.value)


def test_a_byte_order_mark_and_json_by_another_name_are_read(tmp_path):
    (tmp_path / "a.toml").write_text("k = 0.1\n", encoding="utf-8-sig")
    (tmp_path / "a.json").write_text('{"k": 0.1}', encoding="utf-8-sig")
    (tmp_path / "a.txt").write_text('\n {"recipe": {"k": 0.1}}')
    for name in ("a.toml", "a.json", "a.txt"):
        assert read_recipe(tmp_path / name) == Recipe(perturbation=0.1)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(FileFormatError, match="cannot be read: No such file"):
        read_recipe(tmp_path / "none.toml")
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_recipe(tmp_path)
    (tmp_path / "x.toml").write_bytes(b"k = 0.1 # \xff\xfe")
    with pytest.raises(FileFormatError, match="it is not text"):
        read_recipe(tmp_path / "x.toml")


# ------------------------------------------------------------------------------------------------ settings


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("r=0.6", "base_radius", 0.6),
        ("k=0.2", "perturbation", 0.2),
        ("s=1", "main_scale", 1),
        ("s_w=1.2", "warp_scale", 1.2),
        ("eta=0.5", "warp_strength", 0.5),
        ("delta=1,2,3", "phase_offset", (1, 2, 3)),
        ("delta=-1.5", "phase_offset", (-1.5, -1.5, -1.5)),
        ("O=7", "octaves", 7),
        ("lambda=2.1", "lacunarity", 2.1),
        ("g=0.4", "gain", 0.4),
        ("alpha=1", "fbm_weight", 1),
        ("beta=0", "ridge_weight", 0),
        ("gamma=0.5", "chip_weight", 0.5),
        ("kappa=8", "chip_sharpness", 8),
        ("A_L=8", "layer_amplitude", 8),
        ("f_L=2.5", "layer_frequency", 2.5),
        ("n=0,0,1", "layer_normal", (0, 0, 1)),
        ("a=[0, 1, 0]", "twist_axis", (0, 1, 0)),
        ("p0=(1, 2, 3)", "twist_point", (1, 2, 3)),
        ("rho=30", "twist_rate", 30),
        ("L=3", "length", 3),
        ("W=1.7", "width", 1.7),
        ("H=1e-1", "height", 0.1),
        ("seed=18446744073709551615", "seed", MAX_SEED),
        ("triangles=5000", "triangles", 5000),
        ("N_t=5000", "triangles", 5000),
        ("smoothing_method=taubin", "smoothing_method", "taubin"),
        ("flatten=false", "flatten", False),
        ("flatten=True", "flatten", True),
        (" k = 0.25 ", "perturbation", 0.25),
        ("twist_rate=30", "twist_rate", 30),
    ],
)
def test_settings_by_symbol_and_by_name(text, name, value):
    assert parse_setting(text) == (name, value)
    assert getattr(Recipe().replace(**dict([parse_setting(text)])), name) == value


def test_every_symbol_can_be_set():
    for p in PARAMETERS:
        value = getattr(Recipe(), p.name)
        text = ",".join(map(str, value)) if p.kind == "vector" else str(value)
        assert parse_setting(f"{p.symbol}={text}") == (p.name, value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("k", "expected NAME=VALUE"),
        ("k=", "expected NAME=VALUE"),
        ("=3", "expected NAME=VALUE"),
        ("", "expected NAME=VALUE"),
        ("k=abc", "perturbation must be a number; got 'abc'"),
        ("k=0.1,0.2", "perturbation must be a number"),
        ("flatten=1", "flatten must be true or false"),
        ("delta=1,,2", "phase_offset must be a number"),
        ("kapp=1", "Did you mean kappa"),
    ],
)
def test_settings_that_say_nothing_are_refused(text, message):
    with pytest.raises(RecipeError, match=message):
        parse_setting(text)


@pytest.mark.parametrize("text", ["k=nan", "k=inf", "O=2.5", "seed=-1", "delta=1,2", "k=1e999", "topology=cubic"])
def test_settings_of_wrong_values_are_refused_by_the_recipe(text):
    with pytest.raises(RecipeError):
        Recipe().replace(**parse_settings([text]))


def test_the_last_setting_of_a_name_counts():
    assert parse_settings(["k=0.1", "O=3", "perturbation=0.2"]) == {"perturbation": 0.2, "octaves": 3}


# ------------------------------------------------------------------------------------------------ presets

INTERVALS = {  # EI = W / L and FI = H / W
    "cube": ((2 / 3, 1), (2 / 3, 1)),
    "plate": ((2 / 3, 1), (1 / 3, 2 / 3)),
    "column": ((1 / 3, 2 / 3), (2 / 3, 1)),
    "blade": ((1 / 3, 2 / 3), (1 / 3, 2 / 3)),
}


def test_presets_and_classes_are_those_of_the_contract():
    assert PRESETS == ("benchmark", "database")
    assert tuple(INTERVALS) == SHAPE_CLASSES


@pytest.mark.parametrize("shape_class", SHAPE_CLASSES)
def test_database_sizes_fill_their_zingg_class_uniformly(shape_class):
    size = np.array([draw_size(shape_class, seed, length=0.03) for seed in range(4000)])
    assert (size[:, 0] == 0.03).all()
    indices = size[:, 1] / size[:, 0], size[:, 2] / size[:, 1]
    for values, (low, high) in zip(indices, INTERVALS[shape_class], strict=True):
        assert low - 1e-12 <= values.min() < low + 0.01
        assert high - 0.01 < values.max() <= high + 1e-12
        assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(*indices)[0, 1]) < 4 / np.sqrt(4000)
    for index in indices:  # neighbouring seeds
        assert abs(np.corrcoef(index[:-1], index[1:])[0, 1]) < 4 / np.sqrt(4000)


@pytest.mark.parametrize("shape_class", SHAPE_CLASSES)
def test_database_recipe_is_table_1_with_unit_scales_and_a_size(shape_class):
    for seed in (0, 5, MAX_SEED):
        recipe = database_recipe(shape_class, seed=seed)
        assert recipe == Recipe().replace(s=1, s_w=1, size=draw_size(shape_class, seed), seed=seed)
        assert recipe == database_recipe(shape_class, seed=seed)
        assert recipe.length == 0.020
    assert database_recipe(shape_class, seed=1, length=2.0).length == 2.0
    assert database_recipe(shape_class, seed=1, k=0.1, s=2).main_scale == 2


@pytest.mark.parametrize("change", [{"width": 0.0101}, {"H": 0.0101}, {"L": 0.0401}])
def test_a_dimension_asked_for_is_not_dropped_by_the_database_preset(change):
    (name, value) = next(iter(change.items()))
    try:
        recipe = database_recipe("cube", seed=1, **change)
    except RecipeError:
        return  # refused is as clear
    assert getattr(recipe, find_parameter(name)) == value


def test_a_size_asked_for_takes_the_place_of_the_drawn_one():
    assert database_recipe("cube", seed=1, size=(3, 2, 1)).size == (3, 2, 1)


@pytest.mark.parametrize("shape_class", ["Cube", "ball", "", None, "plates"])
def test_an_unknown_class_is_refused(shape_class):
    with pytest.raises(RecipeError, match="expected a class of cube, plate, column, blade"):
        database_recipe(shape_class)


def test_seed_0_is_a_seed_like_any_other():
    assert Recipe(seed=0).replace(seed=0).seed == 0
    assert from_dict({"seed": 0}).seed == 0
    assert database_recipe("cube", seed=0).size != database_recipe("cube", seed=1).size
    drawn = database_recipe("cube", seed=0)
    assert 2 / 3 < drawn.width / drawn.length < 1
    seeds = [particle_seed(run, number) for run in (0, 1, 2, MAX_SEED) for number in range(200)]
    assert len(set(seeds)) == 800
    assert all(0 < seed <= MAX_SEED for seed in seeds)
    assert particle_seed(0, 1) == particle_seed(0, 1) != particle_seed(1, 0)
