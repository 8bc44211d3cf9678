"""Noise: against the NumPy oracle, its bound, its smoothness, its spectrum, and the quality of its hash."""

from fractions import Fraction
from itertools import combinations, pairwise, product

import numpy as np
import oracles
import pytest
from scipy import optimize, stats

from lithoform.errors import DeviceError, MeshError
from lithoform.noise import GRADIENTS, NOISE_BOUND, PERLIN_SUPREMUM, cellular_noise, gradient_noise
from lithoform.seeds import MAX_SEED, Role, derive

KEYS = [0, 1, 0x0123456789ABCDEF, MAX_SEED, derive(0, Role.RELIEF, 0)]


def block(low: int, high: int) -> np.ndarray:
    """All cells with coordinates from low to high - 1, shape (n, 3)."""
    return np.stack(np.meshgrid(*[np.arange(low, high)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


# ------------------------------------------------------------------------------------------------ values


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("extent", [2.0, 50.0, 80_000.0])
def test_gradient_noise_equals_the_oracle(key, extent):
    points = np.random.default_rng(1).uniform(-extent, extent, size=(5000, 3))
    values = gradient_noise(points, key)
    assert values.shape == (5000, 3)
    expected = np.stack([oracles.gradient_noise(points, key, c) for c in range(3)], axis=1)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("key", KEYS)
def test_noise_is_exactly_zero_at_lattice_points(key):
    corners = np.concatenate([block(-4, 5), [[70_000, -70_000, 3], [2**30, -(2**30), 0]]])
    assert (gradient_noise(corners, key) == 0.0).all()


def test_the_gradients_are_the_edges_of_the_cube_and_have_no_mean():
    assert (oracles.GRADIENT_TABLE == GRADIENTS).all()
    unscaled = np.rint(GRADIENTS * PERLIN_SUPREMUM)
    assert pytest.approx(unscaled / PERLIN_SUPREMUM, abs=1e-16) == GRADIENTS
    edges = {tuple(g) for g in unscaled.tolist()}
    assert edges == {p for p in product((-1.0, 0.0, 1.0), repeat=3) if p.count(0.0) == 1}
    assert (unscaled.sum(axis=0) == 0).all()
    # Perlin's fourth tetrahedron makes y a little livelier than x and z; no axis leans on another.
    assert (np.diag([10.0, 12.0, 10.0]) == unscaled.T @ unscaled).all()
    with pytest.raises(ValueError, match="read-only"):
        GRADIENTS[0, 0] = 2.0


def test_wrong_device_is_a_clear_error():
    with pytest.raises(DeviceError, match="auto, cpu or cuda"):
        gradient_noise(np.zeros((1, 3)), 0, device="tpu")


def test_no_points_give_no_values():
    assert gradient_noise(np.empty((0, 3)), 0).shape == (0, 3)
    assert cellular_noise(np.empty((0, 3)), 0).shape == (0, 2)


# ------------------------------------------------------------------------------------------------ bound


def envelope(t: np.ndarray) -> np.ndarray:
    """sum_c w_c(t) max_g g.d_c: what |P| can reach at t if every corner may choose its gradient."""
    total = np.zeros(len(t))
    for corner in product((0, 1), repeat=3):
        weight = np.prod(np.where(np.array(corner) == 1, oracles.quintic(t), 1.0 - oracles.quintic(t)), axis=1)
        total += weight * ((t - corner) @ oracles.GRADIENT_TABLE.T).max(axis=1)
    return total


def exact_envelope(t) -> Fraction:
    """The same without rounding and for edges of length sqrt 2: the best one gives the two largest of |d|."""
    t = [Fraction(float(x)) for x in t]
    fade = [6 * x**5 - 15 * x**4 + 10 * x**3 for x in t]
    total = Fraction(0)
    for corner in product((0, 1), repeat=3):
        weight = Fraction(1)
        for side, f in zip(corner, fade, strict=True):
            weight *= f if side else 1 - f
        total += weight * sum(sorted(abs(x - side) for x, side in zip(t, corner, strict=True))[1:])
    return total


def test_noise_bound_is_the_supremum_of_the_envelope():
    axis = np.linspace(0.0, 1.0, 61)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    values = envelope(grid)
    assert values.max() <= NOISE_BOUND
    found = [
        # The envelope has creases, which a simplex search does not mind.
        optimize.minimize(
            lambda t: -envelope(np.clip(t, 0, 1)[None])[0],
            start,
            method="Nelder-Mead",
            options={"xatol": 1e-11, "fatol": 1e-15, "maxiter": 2000},
        ).x
        for start in grid[np.argsort(values)[-24:]]
    ]
    best = max(exact_envelope(np.clip(t, 0, 1)) for t in found)
    assert best <= Fraction(PERLIN_SUPREMUM)  # in whole numbers: the constant is rounded up
    assert float(best) == pytest.approx(PERLIN_SUPREMUM, abs=1e-9)
    assert NOISE_BOUND == 1.0


def test_the_bound_lies_above_one_and_away_from_the_middle_of_the_cell():
    assert envelope(np.full((1, 3), 0.5))[0] * PERLIN_SUPREMUM == pytest.approx(1.0)
    assert PERLIN_SUPREMUM > 1.036


def test_noise_stays_within_its_bound_over_many_points():
    points = np.random.default_rng(2).uniform(-300, 300, size=(1_000_000, 3))
    values = np.abs(gradient_noise(points, 77))
    assert values.max() <= NOISE_BOUND
    assert values.max() > 0.82  # the sample does come near it


# ------------------------------------------------------------------------------------------------ smoothness

# Weights of one-sided differences on 0, h, ..., 7h, from the moments (exact for polynomials of degree 7).
_OFFSETS = np.arange(8)
_MOMENTS = np.vander(_OFFSETS, increasing=True).T.astype(float)
FIRST = np.linalg.solve(_MOMENTS, np.eye(8)[1])
SECOND = np.linalg.solve(_MOMENTS, 2.0 * np.eye(8)[2])
THIRD = np.linalg.solve(_MOMENTS, 6.0 * np.eye(8)[3])


def jumps(function, axis: int, count: int = 300) -> list[float]:
    """Largest jumps of value and of first to third derivative across faces x_axis = whole number."""
    h = 4e-3
    points = np.random.default_rng(3 + axis).uniform(-6, 6, size=(count, 3))
    points[:, axis] = np.floor(points[:, axis])
    step = np.eye(3)[axis] * h

    def derivatives(sign):
        rows = np.stack([function(points + sign * m * step) for m in _OFFSETS])
        # The row at the face itself belongs to the cell above; an offset of 1e-13 stands for the other side.
        rows[0] = function(points + sign * 1e-13 * np.eye(3)[axis])
        return [rows[0], *(weights @ rows * (sign / h) ** k for k, weights in enumerate((FIRST, SECOND, THIRD), 1))]

    return [float(np.abs(a - b).max()) for a, b in zip(derivatives(1), derivatives(-1), strict=True)]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_noise_is_twice_continuously_differentiable_across_cell_faces(axis):
    value, first, second, third = jumps(lambda p: gradient_noise(p, 5)[:, 0], axis)
    assert value < 1e-12
    assert first < 1e-8
    assert second < 1e-6
    assert third > 1.0  # the quintic fade promises no more; this also shows that the differences can see a jump


def test_the_differences_would_see_a_jump_of_the_second_derivative():
    _, first, second, _ = jumps(lambda p: oracles.gradient_noise(p, 5, 0, fade=lambda t: t * t * (3 - 2 * t)), 0)
    assert first < 1e-8
    assert second > 1.0


def test_gradient_by_differences_equals_the_analytic_one():
    points = np.random.default_rng(4).uniform(-9, 9, size=(2000, 3))
    h = 1e-5
    for channel in range(3):
        exact = oracles.gradient_of_noise(points, 11, channel)
        for axis in range(3):
            step = h * np.eye(3)[axis]
            ahead, behind = gradient_noise(points + step, 11), gradient_noise(points - step, 11)
            central = (ahead - behind)[:, channel] / (2 * h)
            # h^2 / 6 of a third derivative below 300, and rounding 1e-15 / h.
            np.testing.assert_allclose(central, exact[:, axis], atol=1e-8)


# ------------------------------------------------------------------------------------------------ independence

SPREAD = 2 * block(1, 33)  # lattice points two apart: no two samples share a corner
SITES = SPREAD + np.random.default_rng(6).uniform(0, 1, size=SPREAD.shape)
FIVE_SIGMA = 5.0 / np.sqrt(len(SITES))  # of a correlation of independent samples: 1 / sqrt(32768) = 0.0055


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a, b)[0, 1])


def test_noise_has_no_mean_and_no_skew():
    values = gradient_noise(SITES, 9)
    for channel in values.T:
        assert abs(channel.mean()) < 5 * channel.std() / np.sqrt(len(SITES))
        assert abs((channel**3).mean()) < 5 * (channel**3).std() / np.sqrt(len(SITES))


def test_channels_are_uncorrelated():
    for key in KEYS:
        values = gradient_noise(SITES, key)
        for a, b in combinations(range(3), 2):
            assert abs(correlation(values[:, a], values[:, b])) < FIVE_SIGMA
            assert abs(correlation(values[:, a] ** 2, values[:, b] ** 2)) < 0.3  # they share the fade, no more


def test_neighbouring_keys_are_uncorrelated():
    # Of the low word.  The high word enters between the rounds of the finaliser: keys that differ there alone do
    # correlate (up to 0.2, measured), which sub-seeds, whose halves all differ, never do: see the next test.
    base = gradient_noise(SITES, 1000)
    for key in [1001, 999, 1000 ^ 1 << 16, 1000 ^ 1 << 31]:
        other = gradient_noise(SITES, key)
        for a, b in product(range(3), repeat=2):
            assert abs(correlation(base[:, a], other[:, b])) < FIVE_SIGMA


@pytest.mark.parametrize("role", [Role.WARP, Role.RELIEF])
def test_neighbouring_seeds_and_octaves_are_uncorrelated(role):
    fields = [
        gradient_noise(SITES, derive(seed, role, o))[:, 0] for seed, o in [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1)]
    ]
    for a, b in combinations(fields, 2):
        assert abs(correlation(a, b)) < FIVE_SIGMA


def test_chips_of_neighbouring_seeds_are_uncorrelated():
    fields = [cellular_noise(SITES, derive(seed, Role.CHIPS)) for seed in range(4)]
    gaps = np.stack([f[:, 1] - f[:, 0] for f in fields], axis=1)
    # The feature points are jittered about fixed cells, so that the mean of a gap depends slightly on the place
    # within the cell, the same for all seeds: take that common part, a smooth function of the place, off.
    t = SITES - np.floor(SITES)
    terms = np.stack([np.prod(np.cos(np.pi * np.array(p) * t), axis=1) for p in product(range(4), repeat=3)], axis=1)
    rest = gaps - terms @ np.linalg.lstsq(terms, gaps, rcond=None)[0]
    for a, b in combinations(rest.T, 2):
        assert abs(correlation(a, b)) < FIVE_SIGMA


# ------------------------------------------------------------------------------------------------ hash


def uniformity(counts: np.ndarray) -> float:
    """p-value of the chi-square test of equal frequencies (two-sided: too even is as suspicious)."""
    p = stats.chisquare(np.ravel(counts)).pvalue
    return 2 * min(p, 1 - p)


P_MIN = 1e-4  # the tests below make about 90 comparisons on fixed data


def test_no_two_cells_near_the_origin_share_a_hash():
    # Independent 32-bit words of 64^3 cells: 8 coincidences expected.  A stone lives in the cells around the
    # origin, so that a coincidence there is a repetition in every stone of every seed.
    words = oracles.hash_cells(block(-32, 32), KEYS[2])
    assert len(words) - len(np.unique(words)) < 30
    near = oracles.hash_cells(block(-8, 8), KEYS[2])
    assert len(np.unique(near)) == len(near)


def test_noise_does_not_repeat_under_a_half_turn_of_the_lattice():
    # Around lattice points and their mirror images, over many seeds: as unlike as any two places.
    point = np.array([1.2, 1.1, 0.9])
    places = [point + shift for shift in product((0, -2), repeat=3)]
    values = np.array([gradient_noise(places, derive(seed, Role.RELIEF, 0))[:, 0] for seed in range(2000)])
    matrix = np.corrcoef(values.T) - np.eye(8)
    assert np.abs(matrix).max() < 5 / np.sqrt(2000)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("low", [3, 60_000, -60_000])
def test_gradient_indices_are_uniform_over_a_lattice_block(key, low):
    cells = block(low, low + 48)
    for channel in range(3):
        index = oracles.gradient_index(cells, key, channel)
        assert uniformity(np.bincount(index, minlength=16)) > P_MIN


@pytest.mark.parametrize(
    "offset", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 1), (2, 0, 0), (0, 4, 0), (0, 0, 16)]
)
def test_gradient_indices_of_neighbouring_cells_are_independent(offset):
    cells = block(5, 53)
    a = oracles.gradient_index(cells, KEYS[4], 0)
    b = oracles.gradient_index(cells + offset, KEYS[4], 0)
    assert uniformity(np.bincount(16 * a + b, minlength=256)) > P_MIN


@pytest.mark.parametrize("cell", [(0, 0, 0), (1, -1, 2), (-3, 0, 1)])
def test_gradient_indices_are_uniform_over_seeds(cell):
    keys = [derive(seed, Role.RELIEF, 0) for seed in range(20_000)]
    index = np.array([oracles.gradient_index(np.array([cell]), key, 1)[0] for key in keys])
    assert uniformity(np.bincount(index, minlength=16)) > P_MIN
    # Neighbouring seeds: the pair is uniform as well.
    assert uniformity(np.bincount(16 * index[:-1:2] + index[1::2], minlength=256)) > P_MIN


@pytest.mark.parametrize("key", KEYS)
def test_feature_points_are_uniform_in_their_cells(key):
    jitter = oracles.feature_jitter(block(3, 51), key)
    for column in jitter.T:
        assert uniformity(np.bincount(column >> np.uint32(24), minlength=256)) > P_MIN
        assert uniformity(np.bincount(column & np.uint32(255), minlength=256)) > P_MIN
    for a, b in combinations(range(3), 2):
        for shift in (28, 12, 0):  # the highest, the middle and the lowest four bits
            pair = 16 * (jitter[:, a] >> np.uint32(shift) & np.uint32(15)) + (
                jitter[:, b] >> np.uint32(shift) & np.uint32(15)
            )
            assert uniformity(np.bincount(pair, minlength=256)) > P_MIN


def test_feature_points_are_uniform_over_seeds():
    keys = [derive(seed, Role.CHIPS) for seed in range(10_000)]
    jitter = np.concatenate([oracles.feature_jitter(np.array([[0, 0, 0]]), key) for key in keys])
    for column in jitter.T:
        assert stats.kstest(column * 2.0**-32, "uniform").pvalue > P_MIN
        assert uniformity(np.bincount(column & np.uint32(15), minlength=16)) > P_MIN


# ------------------------------------------------------------------------------------------------ cellular


@pytest.mark.parametrize("key", KEYS)
def test_cellular_noise_equals_brute_force_over_a_larger_neighbourhood(key):
    points = np.random.default_rng(8).uniform(-30, 30, size=(20_000, 3))
    values = cellular_noise(points, key)
    larger = oracles.cellular_noise(points, key, reach=2)
    assert (values == larger).all()
    assert (values[:, 0] <= values[:, 1]).all()
    assert values.min() >= 0.0
    assert values.max() <= 1.0


def test_the_clamp_is_what_makes_the_27_cells_enough():
    points = np.random.default_rng(8).uniform(-30, 30, size=(200_000, 3))
    f27 = oracles.cellular_noise(points, 3, reach=1, clamp=False)
    f125 = oracles.cellular_noise(points, 3, reach=2, clamp=False)
    wrong = (f27 != f125).any(axis=1)
    assert 0 < wrong.sum() < 0.01 * len(points)  # unclamped, rare points miss a neighbour
    assert (f125[wrong].max(axis=1) >= 1.0).all()  # and only where the distance is 1 or more
    assert (np.minimum(f27, 1.0) == np.minimum(f125, 1.0)).all()


def test_cellular_noise_at_a_feature_point_is_zero_and_continuous():
    cells = block(-3, 4)
    sites = cells + oracles.feature_jitter(cells, 21) * 2.0**-32
    inside = (np.floor(sites) == cells).all(axis=1)
    assert cellular_noise(sites[inside], 21)[:, 0].max() < 1e-14
    # Distances are 1-Lipschitz, across cell faces as well.
    faces = np.random.default_rng(9).uniform(-5, 5, size=(3000, 3))
    faces[:, 1] = np.round(faces[:, 1])
    step = np.array([0, 1e-9, 0])
    assert np.abs(cellular_noise(faces + step, 21) - cellular_noise(faces - step, 21)).max() <= 2.001e-9


# ------------------------------------------------------------------------------------------------ spectrum


def measured_slope(lacunarity: float, gain: float) -> float:
    """Slope of log spectral density against log frequency of one-dimensional sections of FBM.

    Octave o has the density g^(2 o) S_P(f / lambda^o) / lambda^o in a section, so that the sum over octaves
    obeys S(lambda f) = (g^2 / lambda) S(f) away from its two ends: the slope is 2 ln g / ln lambda - 1.
    """
    octaves = int(np.log(128) / np.log(lacunarity)) + 1
    lines, length, samples = 48, 16.0, 16_384  # 1024 samples a unit of length; highest frequency 128 a unit
    rng = np.random.default_rng(10)
    start = rng.uniform(-40, 40, size=(lines, 1, 3))
    along = rng.normal(size=(lines, 1, 3))
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    points = (start + along * np.linspace(0, length, samples, endpoint=False)[None, :, None]).reshape(-1, 3)
    values = np.zeros(len(points))
    for o in range(octaves):
        values += gain**o * gradient_noise(points * lacunarity**o, derive(4, Role.RELIEF, o))[:, 0]
    window = np.hanning(samples)
    power = (np.abs(np.fft.rfft(values.reshape(lines, samples) * window)) ** 2).mean(axis=0)
    frequency = np.arange(len(power)) / length
    # Logarithmic means over bins of a quarter octave of lambda, from 2 a unit for a whole number of octaves.
    whole = int(np.log(24 / 2) / np.log(lacunarity))
    edges = 2.0 * lacunarity ** (np.arange(4 * whole + 1) / 4)
    bins = [(frequency >= a) & (frequency < b) for a, b in pairwise(edges)]
    x = [np.log(frequency[b]).mean() for b in bins]
    y = [np.log(power[b].mean()) for b in bins]
    return float(np.polyfit(x, y, 1)[0])


@pytest.mark.parametrize(("lacunarity", "gain"), [(2.0, 0.5), (1.5, 0.7), (1.5, 0.5), (2.0, 0.8)])
def test_spectrum_of_fbm_follows_lacunarity_and_gain(lacunarity, gain):
    expected = 2 * np.log(gain) / np.log(lacunarity) - 1
    assert measured_slope(lacunarity, gain) == pytest.approx(expected, abs=0.1)


# ------------------------------------------------------------------------------------------------ wrong input


@pytest.mark.parametrize("noise", [gradient_noise, cellular_noise])
@pytest.mark.parametrize(
    ("points", "key", "words"),
    [
        ([[np.nan, 0.0, 0.0]], 1, "finite"),
        ([[np.inf, 0.0, 0.0]], 1, "finite"),
        ([[2.0**31, 0.0, 0.0]], 1, "below 2\\^31"),
        ([1.0, 2.0, 3.0], 1, "shape"),
        (np.zeros((3, 2)), 1, "shape"),
        ([[0.0, 0.0, 0.0]], -1, "key"),
        ([[0.0, 0.0, 0.0]], 2**64, "key"),
    ],
)
def test_wrong_points_and_keys_are_refused(noise, points, key, words):
    with pytest.raises(MeshError, match=words):
        noise(points, key)
