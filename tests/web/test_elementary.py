"""The functions that WebAssembly has not: exact, and nearest to the exact result."""

import math

import mpmath
import numba
import numpy as np
import pytest

from gym_passive_walker.devices.web import elementary
from gym_passive_walker.engine import jit
from gym_passive_walker.engine.compiler import PRIMITIVES, linker

fma, fused = PRIMITIVES[jit.fma], linker()(elementary.fused)


@numba.njit(error_model="numpy")
def _fused(a, b, c, by_processor, found):
    for i in range(len(a)):
        if by_processor:
            found[i] = fma(a[i], b[i], c[i])
        else:
            found[i] = fused(a[i], b[i], c[i])


def _differ(a, b, c):
    ours, theirs = np.empty((2, len(a)))
    _fused(a, b, c, False, ours)
    _fused(a, b, c, True, theirs)
    same = (ours.view("u8") == theirs.view("u8")) | (np.isnan(ours) & np.isnan(theirs))
    return [(a[i], b[i], c[i]) for i in np.flatnonzero(~same)]


def _numbers(rng, count, least, most):
    signs, fractions = rng.choice([-1.0, 1.0], count), 1.0 + rng.random(count)
    with np.errstate(under="ignore"):
        return np.ldexp(signs * fractions, rng.integers(least, most, count))


@pytest.mark.parametrize("sizes", [(-5, 5), (-1074, 1023), (-600, -400), (400, 600), (-540, -500)])
def test_the_fused_sum_is_the_processors(sizes):
    rng, count = np.random.default_rng(0), 50_000
    a, b = (_numbers(rng, count, *sizes) for _ in range(2))
    with np.errstate(all="ignore"):
        product = -(a * b)
    product = np.where(np.isfinite(product), product, 1.0)
    near = product * (1.0 + rng.integers(-3, 4, count) * 2.0**-52)
    for c in (_numbers(rng, count, *sizes), product, near, 2.0**-54 * product):
        assert not _differ(a, b, c)


def test_the_fused_sum_of_special_numbers_is_the_processors():
    special = [0.0, math.inf, math.nan, 1.0, 5e-324, 2.2e-308, 1.7e308]
    row = np.array([*special, *(-x for x in special)])
    a, b, c = np.array(np.meshgrid(row, row, row)).reshape(3, -1)
    assert not _differ(*map(np.ascontiguousarray, (a, b, c)))


def _values(function, given):
    """Results of a function that only compiled code can call."""
    function = linker()(function)

    @numba.njit(error_model="numpy")
    def each(given, found):
        for i in range(len(given)):
            found[i] = function(given[i])

    found = np.empty_like(given)
    each(given, found)
    return found


@pytest.mark.parametrize(
    ("function", "exact", "bounds"),
    [
        (elementary.sine, mpmath.sin, (-10.0, 10.0)),
        (elementary.sine, mpmath.sin, (-1e-6, 1e-6)),
        (elementary.cosine, mpmath.cos, (-10.0, 10.0)),
        (elementary.logarithm, mpmath.log, (1e-300, 1.0)),
        (elementary.logarithm, mpmath.log, (0.999, 1.001)),
        (elementary.arcsine, mpmath.asin, (-1.0, 1.0)),
        (elementary.exponential, mpmath.exp, (-700.0, 709.0)),
        (elementary.exponential, mpmath.exp, (-1e-3, 1e-3)),
        (elementary.hyperbolic_tangent, mpmath.tanh, (-25.0, 25.0)),
        (elementary.hyperbolic_tangent, mpmath.tanh, (-1e-5, 1e-5)),
    ],
)
def test_an_elementary_function_is_the_nearest_number(function, exact, bounds):
    given = np.random.default_rng(0).uniform(*bounds, 2000)
    found = _values(function, given)
    with mpmath.workprec(200):
        assert [float(exact(mpmath.mpf(x))) for x in given.tolist()] == found.tolist()


@pytest.mark.parametrize(
    ("function", "own"),
    [
        (elementary.sine, np.sin),
        (elementary.cosine, np.cos),
        (elementary.logarithm, np.log),
        (elementary.arcsine, np.arcsin),
        (elementary.exponential, np.exp),
        (elementary.hyperbolic_tangent, np.tanh),
    ],
)
def test_zero_and_what_lies_beyond_the_numbers_give_what_the_processor_gives(function, own):
    given = {
        np.sin: [0.0, -0.0],
        np.cos: [0.0, -0.0],
        np.log: [0.0, 1.0],
        np.arcsin: [0.0, -0.0, 1.0, -1.0, 1.5, -1.5, math.nan],
    }.get(own, [0.0, -0.0, 800.0, -800.0, math.inf, -math.inf, math.nan])
    with np.errstate(all="ignore"):
        expected = own(np.array(given))
    found = _values(function, np.array(given))
    np.testing.assert_array_equal(found, expected)
    number = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found)[number], np.signbit(expected)[number])
