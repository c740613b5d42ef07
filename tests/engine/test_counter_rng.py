"""Random numbers by key, counter and stream."""

import itertools

import numpy as np
import pytest
from scipy import stats

from gym_passive_walker.engine.counter_rng import normal, uniform, word

KEY, MANY = 0x1234_5678_9ABC_DEF0, 20_000


def drawn(law, key=KEY, stream=0, count=MANY):
    return np.array([law(key, i, stream) for i in range(count)])


def test_words_are_those_of_splitmix64():
    published = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F, 0xF88BB8A8724C81EC]
    assert [int(word(0, i)) for i in range(4)] == published


def test_the_same_question_has_the_same_answer_whatever_integers_it_is_asked_in():
    asked = uniform(np.uint64(2**64 - 5), np.int64(7), 3)
    assert uniform(np.int64(-5), np.uint64(7), 3) == asked == uniform(-5, 7, 3)


@pytest.mark.parametrize(
    ("law", "distribution"), [(uniform, stats.uniform()), (normal, stats.norm())]
)
def test_numbers_have_their_distribution_and_its_moments(law, distribution):
    numbers = drawn(law)
    assert stats.kstest(numbers, distribution.cdf).pvalue > 0.01
    for power in (1, 2, 3, 4):
        spread = np.sqrt((distribution.moment(2 * power) - distribution.moment(power) ** 2) / MANY)
        assert np.mean(numbers**power) == pytest.approx(distribution.moment(power), abs=3 * spread)


@pytest.mark.parametrize("law", [uniform, normal])
def test_keys_streams_and_neighbours_are_independent(law):
    rows = [drawn(law), drawn(law, key=KEY + 1), drawn(law, stream=1), drawn(law, stream=2)]
    rows += [np.roll(rows[0], 1)]
    for one, other in itertools.combinations(rows, 2):
        assert abs(stats.spearmanr(one, other).statistic) < 4.0 / np.sqrt(MANY)


def test_no_uniform_number_reaches_one_and_no_normal_number_is_infinite():
    keys = np.random.default_rng(0).integers(2**63, size=2000)
    assert all(0.0 <= uniform(key, 0, 0) < 1.0 for key in keys)
    assert all(np.isfinite(normal(key, 0, 0)) for key in keys)
