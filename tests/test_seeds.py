"""Sub-seeds: the published SplitMix64 sequence, independence of neighbours, seed 0."""

import numpy as np
import oracles
import pytest
from scipy import stats

from lithoform.seeds import MAX_SEED, Role, derive, uniform


def test_the_finaliser_is_that_of_splitmix64():
    # First outputs of SplitMix64 started at 0 (Steele, Lea & Flood 2014, java.util.SplittableRandom).
    golden = 0x9E3779B97F4A7C15
    published = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    from lithoform.seeds import _finalise

    assert [_finalise((i + 1) * golden & MAX_SEED) for i in range(3)] == published


@pytest.mark.parametrize("seed", [0, 1, 2, 12345, 2**63, MAX_SEED])
@pytest.mark.parametrize("words", [(), (0,), (1,), (3, 9), (2**40,)])
def test_derive_equals_the_definition(seed, words):
    for role in Role:
        assert derive(seed, role, *words) == oracles.sub_seed(seed, role, *words)


def test_roles_are_part_of_the_file_format():
    named = {r.name: int(r) for r in Role}
    assert named == {"WARP": 1, "RELIEF": 2, "CHIPS": 3, "PARTICLE": 4, "DIMENSIONS": 5, "POPULATION": 6,
                     "SPECIMEN": 7}  # fmt: skip
    assert (oracles.WARP, oracles.RELIEF, oracles.CHIPS) == (Role.WARP, Role.RELIEF, Role.CHIPS)


def test_no_two_purposes_share_a_sub_seed():
    made = [
        derive(seed, role, *words)
        for seed in [*range(40), MAX_SEED - 1, MAX_SEED]
        for role in Role
        for words in [(), *((o,) for o in range(60)), *((o, c) for o in range(10) for c in range(10))]
    ]
    assert len(set(made)) == len(made) == 42 * 7 * 161


def test_every_input_bit_flips_half_of_the_output_bits():
    rng = np.random.default_rng(5)
    flips = np.zeros((64, 64))
    count = 400
    for seed in rng.integers(0, 2**64, size=count, dtype=np.uint64).tolist():
        base = derive(seed, Role.RELIEF, 3)
        for bit in range(64):
            change = base ^ derive(seed ^ (1 << bit), Role.RELIEF, 3)
            flips[bit] += [change >> out & 1 for out in range(64)]
    # 4096 binomial frequencies with standard error 0.025: five of them bound all.
    assert np.abs(flips / count - 0.5).max() < 5 * 0.5 / np.sqrt(count)


def test_uniform_is_uniform_over_neighbouring_seeds_and_counters():
    over_seeds = [uniform(seed, Role.DIMENSIONS, 0) for seed in range(20_000)]
    over_counters = [uniform(7, Role.DIMENSIONS, i) for i in range(20_000)]
    for values in (over_seeds, over_counters):
        assert min(values) >= 0.0
        assert max(values) < 1.0
        assert stats.kstest(values, "uniform").pvalue > 1e-3
        # Successive values: correlation within four standard errors.
        assert abs(np.corrcoef(values[:-1], values[1:])[0, 1]) < 4 / np.sqrt(20_000)


def test_uniform_never_rounds_up_to_one():
    # The largest 64-bit word, cut to 53 bits.
    assert (MAX_SEED >> 11) * 2.0**-53 < 1.0
    assert uniform(0, Role.CHIPS) == (derive(0, Role.CHIPS) >> 11) / 2**53
