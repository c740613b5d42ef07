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


FEW = [1.0, 1.5, *(1.0 + 2.0**-k for k in (25, 26, 27, 51, 52)), 2.0 - 2.0**-52]
"""Fractions of few digits, or nearly: their sums and products are at ties, and beside them."""


def _numbers(rng, exponents):
    count = len(exponents)
    fractions = np.where(rng.random(count) < 0.7, rng.choice(FEW, count), 1.0 + rng.random(count))
    with np.errstate(all="ignore"):
        return np.ldexp(rng.choice([-1.0, 1.0], count) * fractions, exponents)


@pytest.mark.parametrize("power", [-1140, -1074, -1022, -960, -400, 0, 500, 1020])
def test_the_fused_sum_is_the_processors(power):
    rng, count = np.random.default_rng(0), 50_000
    of_product = rng.integers(power - 60, power + 60, count)
    most, least = np.minimum(1023, of_product + 1074), np.maximum(-1074, of_product - 1023)
    first = rng.integers(least, most + 1)
    a, b = _numbers(rng, first), _numbers(rng, of_product - first)
    assert not _differ(a, b, _numbers(rng, of_product + rng.integers(-140, 140, count)))
    with np.errstate(all="ignore"):
        product = -(a * b)
        near = product * (1.0 + rng.integers(-3, 4, count) * 2.0**-52)
    for c in (product, near, 2.0**-54 * product):
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


def _beside(numbers, least=-math.inf, most=math.inf):
    """Numbers of both signs, and their two neighbours on each side, within bounds."""
    bits = np.abs(np.concatenate([np.atleast_1d(x) for x in numbers])).view("i8")
    near = np.concatenate([bits + k for k in range(-2, 3)])
    near = near[near >= 0].view("f8")
    near = np.unique([near, -near])
    return near[(near >= least) & (near <= most)]


TINY = [5e-324, 2.0**-1022, 1e-300, 2.0**-538, 2.0**-511]
SMALL = 2.0 ** -np.r_[1:53, 54:70]  # the exponential of 2^-53 is at a tie up to 107 bits
LOG_2 = math.log(2.0)


@pytest.mark.parametrize(
    ("function", "exact", "given"),
    [
        # quadrants and their boundaries
        (elementary.sine, mpmath.sin, _beside([np.arange(2400) * math.pi / 4, TINY, SMALL])),
        (elementary.cosine, mpmath.cos, _beside([np.arange(2400) * math.pi / 4, TINY, SMALL])),
        # powers of two, and the fraction from which a logarithm belongs to the next power
        (elementary.logarithm, mpmath.log, _beside([2.0 ** np.arange(-1022, 1024)], 2.0**-1022)),
        (
            elementary.logarithm,
            mpmath.log,
            _beside([math.sqrt(0.5) * 2.0 ** np.arange(-1000, 1000.0)], 2.0**-1022),
        ),
        # each power of two, and half of it; the largest number
        (
            elementary.exponential,
            mpmath.exp,
            _beside(
                [np.arange(2048) * 0.5 * LOG_2, TINY, SMALL, 709.782712893384],
                -1022.0 * LOG_2,
                709.782712893384,
            ),
        ),
        # where it is its argument, and where it is 1
        (
            elementary.hyperbolic_tangent,
            mpmath.tanh,
            _beside([np.arange(240) * 0.25 * LOG_2, TINY, SMALL, 1e-9, 20.0]),
        ),
        # where its first guess changes, and where its slope ends
        (
            elementary.arcsine,
            mpmath.asin,
            _beside([np.arange(101) / 100.0, TINY, SMALL, 1.0 - SMALL], -1.0, 1.0),
        ),
    ],
)
def test_an_elementary_function_is_the_nearest_number_beside_each_boundary(function, exact, given):
    found = _values(function, given)
    with mpmath.workprec(300):
        assert [float(exact(mpmath.mpf(x))) for x in given.tolist()] == found.tolist()


def test_an_exponential_below_the_normal_numbers_is_rounded_twice():
    given = np.concatenate([np.linspace(-745.2, -708.4, 1000), [-745.1332191019412, -745.13322]])
    found = _values(elementary.exponential, given)
    with mpmath.workprec(200):
        expected = np.array([float(mpmath.exp(x)) for x in given.tolist()])
    assert np.abs(found - expected).max() <= 5e-324  # a unit of the last digit
    assert np.mean(found == expected) > 0.99


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
