"""Quantities as series in time."""

import numpy as np
import pytest

from gym_passive_walker.gaits.look.dense_stride import fit, greatest, least, ratio_turns, turns


def series(function, start, end):
    return fit(lambda t: function(t)[:, None], start, end, units=np.ones(1), accuracy=1e-13)[0]


def test_a_series_holds_a_function_to_rounding_up_to_its_ends():
    found = series(lambda t: np.exp(np.sin(5.0 * t)), 0.3, 2.0)
    times = np.linspace(0.3, 2.0, 101)
    np.testing.assert_allclose(found(times), np.exp(np.sin(5.0 * times)), rtol=1e-12)


def test_noise_does_not_ask_for_ever_more_samples():
    rng = np.random.default_rng(6)
    found = series(lambda t: np.cos(t) + 1e-9 * rng.normal(size=len(t)), 0.0, 1.0)
    assert len(found.coef) <= 128


def test_a_function_is_monotone_between_its_turns():
    found = turns([series(np.sin, 0.0, 4.0), series(np.sin, 4.0, 8.0)])
    times = [0.0, 0.5 * np.pi, 4.0, 4.0, 1.5 * np.pi, 2.5 * np.pi, 8.0]
    np.testing.assert_allclose([turn.time for turn in found], times, atol=1e-12)
    np.testing.assert_allclose([turn.value for turn in found], np.sin(times), atol=1e-13)
    assert least(found).time == pytest.approx(1.5 * np.pi)
    assert greatest(found[:4]).time == pytest.approx(0.5 * np.pi)


def test_a_quotient_turns_where_it_does():
    above, below = series(np.sin, 0.0, 4.0), series(lambda t: 2.0 + np.cos(t), 0.0, 4.0)
    best = greatest(ratio_turns([(above, below)]))
    assert best.time == pytest.approx(2.0 * np.pi / 3.0, rel=1e-12)
    assert best.value == pytest.approx(1.0 / np.sqrt(3.0), rel=1e-13)


def test_a_quotient_is_infinite_where_nothing_carries_it():
    above, below = series(np.cos, 0.0, 2.0), series(lambda t: t - 1.0, 0.0, 2.0)
    assert greatest(ratio_turns([(above, below)])).value == np.inf


def test_nothing_has_no_extreme():
    assert np.isnan(least([]).value) and np.isnan(greatest([]).time)
