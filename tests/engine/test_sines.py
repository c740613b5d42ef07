"""Sine and cosine, as native code computes them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gym_passive_walker.engine.sines import near_turn
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.expressions import Tangents
from tests.engine.machine import entries, evaluate, in_lanes


def sines_cosines(angles) -> np.ndarray:
    """Both of an array of angles, (2, n)."""
    return in_lanes(lambda x: sine_cosine(x), np.asarray(angles, dtype=float))[:2]


def both(angles) -> np.ndarray:
    """The result of the mathematical library, with an error of half a last bit."""
    return np.array([[function(x) for x in angles] for function in (math.sin, math.cos)])


def test_sine_and_cosine_are_right_to_the_last_bit_or_so_within_a_thousand_turns():
    rng, halves = np.random.default_rng(6), 0.5 * np.pi * np.arange(-4000, 4001)
    beside = [halves, np.nextafter(halves, np.inf), np.nextafter(halves, -np.inf)]
    few, many = rng.uniform(-4.0, 4.0, 100_000), rng.uniform(-2e3 * np.pi, 2e3 * np.pi, 200_000)
    angles = np.concatenate([few, many, *beside])
    assert np.abs(sines_cosines(angles) - both(angles)).max() <= 2.5e-16


def test_the_sine_of_a_small_angle_keeps_all_its_digits():
    angles = np.concatenate([np.logspace(-320, -1, 2000), -np.logspace(-320, -1, 2000)])
    np.testing.assert_allclose(sines_cosines(angles)[0], both(angles)[0], rtol=2.5e-16, atol=0.0)


def test_sine_and_cosine_of_zero_are_exact():
    np.testing.assert_array_equal(sines_cosines(np.zeros(1)), [[0.0], [1.0]])


def test_sine_is_odd_and_cosine_even():
    angles = np.random.default_rng(8).uniform(-1000.0, 1000.0, 10_000)
    (sine, cosine), (other_sine, other_cosine) = sines_cosines(angles), sines_cosines(-angles)
    np.testing.assert_array_equal(other_sine, -sine)
    np.testing.assert_array_equal(other_cosine, cosine)


@pytest.mark.parametrize("most", [0.03, 0.1, 0.3])
def test_sine_and_cosine_near_a_known_angle_are_as_right_as_far_as_they_are_to_be(most):
    for start in (-2.0, 0.1, 0.8, 3.1):

        def added(turn, start=start):
            known = sine_cosine(turn.number(start))
            return sine_cosine(near_turn(start + turn, *known, turn, most))

        turns = np.linspace(-most, most, 4001)
        found, exact = in_lanes(added, turns)[:2], both(start + turns)
        assert np.abs(found - exact).max() <= 5e-16
        doubled = in_lanes(added, 2.0 * turns)[:2] - both(start + 2.0 * turns)
        assert np.abs(doubled).max() <= 1e-13 * (most / 0.03) ** 2


def test_the_sine_of_an_angle_near_another_changes_as_any_sine_does():
    x, y, sine, cosine = entries("x", "y", "sine", "cosine")
    by_sum = sine_cosine(near_turn(x + y, sine, cosine, y, 0.1))
    seeds = {x: x.number(1.0), y: x.number(2.0)}
    found = [Tangents(seeds)(value) for value in by_sum]
    at = {x: 0.3, y: 0.05, sine: math.sin(0.3), cosine: math.cos(0.3)}
    assert evaluate(found[0], at) == pytest.approx(3.0 * math.cos(0.35), rel=1e-15)
    assert evaluate(found[1], at) == pytest.approx(-3.0 * math.sin(0.35), rel=1e-15)


def test_sine_and_cosine_of_no_number_are_none():
    assert np.all(np.isnan(sines_cosines([np.nan, np.inf, -np.inf])))
