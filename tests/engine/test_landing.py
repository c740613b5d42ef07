"""What the search for events within a step is made of: quintics and their roots."""

from __future__ import annotations

import numba
import numpy as np

from gym_passive_walker.physics import events as E


@numba.njit
def _quintic(ends):
    return E.quintic(ends[0], ends[1], ends[2], ends[3], ends[4], ends[5])


@numba.njit
def _value(p, x):
    return E.value(p, x)


@numba.njit
def _derivative(p):
    return E.derivative(p)


@numba.njit
def _root(p):
    return E.root(p)


def test_a_quintic_has_the_values_slopes_and_curvatures_it_is_made_from():
    rng = np.random.default_rng(1)
    for ends in rng.normal(size=(100, 6)):
        p = _quintic(ends)
        slope = _derivative(p)
        curvature = _derivative(slope)
        for x, (value, first, second) in ((0.0, ends[:3]), (1.0, ends[3:])):
            np.testing.assert_allclose(_value(p, x), value, rtol=0.0, atol=1e-13)
            np.testing.assert_allclose(_value(slope, x), first, rtol=0.0, atol=1e-13)
            np.testing.assert_allclose(_value(curvature, x), second, rtol=0.0, atol=1e-12)


def test_a_root_is_found_between_ends_of_different_sign():
    """However the polynomial bends there: Newton's steps may lead astray, bisection does not."""
    rng = np.random.default_rng(2)
    for ends in rng.normal(size=(2000, 6)) * [1.0, 30.0, 100.0, 1.0, 30.0, 100.0]:
        ends[3] = -np.sign(ends[0]) * abs(ends[3])
        p = _quintic(ends)
        x = _root(p)
        assert 0.0 <= x <= 1.0
        assert abs(_value(p, x)) <= 1e-9 * np.abs(ends).max()


def test_a_root_where_the_polynomial_is_flat_is_found():
    flat = (-(0.3**5), 5 * 0.3**4, -10 * 0.3**3, 10 * 0.3**2, -5 * 0.3, 1.0)  # (x - 0.3)^5
    assert abs(_root(flat) - 0.3) < 1e-3
    assert abs(_root((1.0, 0.0, 0.0, 0.0, 0.0, -2.0)) - 0.5**0.2) < 1e-12
