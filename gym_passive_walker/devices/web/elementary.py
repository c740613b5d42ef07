"""Elementary functions for machines without a mathematical library or a fused multiply-add.

Numba compiles these functions for WebAssembly, which has neither. `fused` is exact. The
other functions compute with pairs of numbers of about 104 bits and round once. The result is the
number nearest to the exact one, up to rare cases near a tie.
"""

from __future__ import annotations

from fractions import Fraction
from math import factorial

import numpy as np

from gym_passive_walker.engine.jit import bits_of, jitted, number_of

_SPLITTER = 134217729.0  # 2^27 + 1
_LARGEST = 2.0**500
_SMALLEST = 2.0**-400
_FRACTION, _HIDDEN = np.uint64(2**52 - 1), np.uint64(2**52)
_LOW = np.uint64(2**27 - 1)
_ZERO, _ONE, _27 = np.uint64(0), np.uint64(1), np.uint64(27)


def _sum(a, b):
    """Return the sum of two numbers and its rounding error."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def _product(a, b):
    """Return the product of two numbers and its rounding error, without overflow or underflow."""
    product = a * b
    t = _SPLITTER * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = _SPLITTER * b
    b_high = t - (t - b)
    b_low = b - b_high
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, error


@jitted
def fused(a, b, c):
    """Return a * b + c, rounded once.

    References:
        S. Boldo and G. Melquiond, "Emulation of FMA and correctly rounded sums: proved algorithms
        using rounding to odd", IEEE Transactions on Computers 57 (2008) 462-471.
    """
    size = abs(a * b)
    ordinary = (size < _LARGEST) & (size > _SMALLEST) & (abs(a) < _LARGEST) & (abs(b) < _LARGEST)
    if not (ordinary and abs(c) < _LARGEST):
        return _by_integers(a, b, c)
    high, low = _product(a, b)
    middle, error = _sum(c, low)
    high, middle = _sum(high, middle)
    rest, left = _sum(middle, error)
    if left != 0.0:
        bits = bits_of(rest)
        if bits & _ONE == _ZERO:  # round to odd, towards what is left
            away = (left > 0.0) == (rest > 0.0)
            rest = number_of(bits + _ONE if away else bits - _ONE)
    return high + rest


@jitted
def _parts(x):
    """Return the 53-bit integer of a finite number and the power of two that it multiplies."""
    bits = bits_of(abs(x))
    exponent = np.int64(bits >> np.uint64(52))
    whole = bits & _FRACTION
    if exponent == 0:
        return whole, np.int64(-1074)
    return whole | _HIDDEN, exponent - 1075


@jitted
def _by_integers(a, b, c):
    """Return a * b + c, rounded once, by integers of 192 bits, for numbers of any size."""
    if a == 0.0 or b == 0.0 or not (abs(a) < np.inf and abs(b) < np.inf):
        return a * b + c
    if not abs(c) < np.inf:
        return c
    first, first_power = _parts(a)
    second, second_power = _parts(b)
    negative = (a < 0.0) != (b < 0.0)
    # The product, 106 bits, in two words, from parts of 26 and 27 bits.
    a1, a0, b1, b0 = first >> _27, first & _LOW, second >> _27, second & _LOW
    cross, high = a1 * b0 + a0 * b1, a1 * b1
    part, top = cross << _27, high << np.uint64(54)
    low = a0 * b0 + part
    high = (high >> np.uint64(10)) + (cross >> np.uint64(37))
    high += _ONE if low < part else _ZERO
    low += top
    high += _ONE if low < top else _ZERO
    power = first_power + second_power
    if c == 0.0:
        return _rounded(negative, high, low, _ZERO, power - 64)
    third, third_power = _parts(c)
    # Both numbers in units of 2^unit: the larger one is shifted to the left.
    x2, x1, x0 = high, low, _ZERO
    y2, y1, y0 = _ZERO, third, _ZERO
    apart = power - third_power
    unit = power - 64
    if apart >= 0:  # c is at most 2^53 in units of 2^third_power
        y2, y1, y0 = _right(y2, y1, y0, apart)
    elif -apart <= 74:
        y2, y1, y0 = _left(y2, y1, y0, -apart)
    else:
        y2, y1, y0 = _left(y2, y1, y0, np.int64(74))
        x2, x1, x0 = _right(x2, x1, x0, -apart - 74)
        unit = third_power - 138
    if negative == (c < 0.0):
        z0 = x0 + y0
        carry = _ONE if z0 < x0 else _ZERO
        z1 = x1 + y1
        more = _ONE if z1 < x1 else _ZERO
        z1 += carry
        more += _ONE if z1 < carry else _ZERO
        return _rounded(negative, x2 + y2 + more, z1, z0, unit)
    if x2 < y2 or (x2 == y2 and (x1 < y1 or (x1 == y1 and x0 < y0))):
        x2, x1, x0, y2, y1, y0 = y2, y1, y0, x2, x1, x0
        negative = not negative
    z0 = x0 - y0
    borrow = _ONE if x0 < y0 else _ZERO
    z1 = x1 - y1
    more = _ONE if x1 < y1 else _ZERO
    more += _ONE if z1 < borrow else _ZERO
    z1 -= borrow
    z2 = x2 - y2 - more
    if z2 == _ZERO and z1 == _ZERO and z0 == _ZERO:
        return 0.0
    return _rounded(negative, z2, z1, z0, unit)


@jitted
def _left(x2, x1, x0, places):
    """Shift a number of three words to the left."""
    for _ in range(places):
        x2 = (x2 << _ONE) | (x1 >> np.uint64(63))
        x1 = (x1 << _ONE) | (x0 >> np.uint64(63))
        x0 <<= _ONE
    return x2, x1, x0


@jitted
def _right(x2, x1, x0, places):
    """Shift a number of three words to the right; its last bit is set if any bit was lost."""
    lost = _ZERO
    for _ in range(min(places, 192)):
        lost |= x0 & _ONE
        x0 = (x0 >> _ONE) | (x1 << np.uint64(63))
        x1 = (x1 >> _ONE) | (x2 << np.uint64(63))
        x2 >>= _ONE
    return x2, x1, x0 | lost


@jitted
def _rounded(negative, x2, x1, x0, power):
    """Return the number nearest to an integer of three words times a power of two."""
    while x2 >> np.uint64(63) == _ZERO:
        x2, x1, x0 = _left(x2, x1, x0, 1)
        power -= 1
    # The first word is the fraction: 53 bits, fewer for a subnormal number.
    exponent = power + 128 + 63
    places = 11
    if exponent < -1022:
        places += -1022 - exponent
        exponent = np.int64(-1022)
    sticky = _ONE if (x1 | x0) != _ZERO else _ZERO
    if places > 64:
        whole, half, below = _ZERO, _ZERO, _ONE
    elif places == 64:
        whole, half = _ZERO, x2 >> np.uint64(63)
        below = (x2 << _ONE) | sticky
    else:
        whole = x2 >> np.uint64(places)
        half = (x2 >> np.uint64(places - 1)) & _ONE
        below = (x2 << np.uint64(65 - places)) | sticky
    if half != _ZERO and (below != _ZERO or whole & _ONE != _ZERO):
        whole += _ONE
    if exponent > 1023:
        bits = np.uint64(0x7FF) << np.uint64(52)
    else:
        # The hidden bit adds one to the exponent; a fraction that rounds up carries into it.
        bits = (np.uint64(exponent + 1022) << np.uint64(52)) + whole
        if bits > np.uint64(0x7FF) << np.uint64(52):
            bits = np.uint64(0x7FF) << np.uint64(52)
    value = number_of(bits)
    return -value if negative else value


def _pair(exact: Fraction) -> tuple[float, float]:
    """Return the number nearest to a fraction, and the number nearest to the rest."""
    high = float(exact)
    return high, float(exact - Fraction(high))


_PI = Fraction("3.141592653589793238462643383279502884197169399375105820974944592307816406286209")
_HALF_PI = _pair(_PI / 2)
_HALF_PI_REST = float(_PI / 2 - Fraction(_HALF_PI[0]) - Fraction(_HALF_PI[1]))
_TO_QUADRANTS = float(2 / _PI)
_ROUNDS = 1.5 * 2.0**52
_LOG_2 = _pair(sum((Fraction(1, k * 2**k) for k in range(1, 300)), Fraction(0)))
_SINES = np.array([_pair(Fraction((-1) ** k, factorial(2 * k + 1))) for k in range(15)])
_COSINES = np.array([_pair(Fraction((-1) ** k, factorial(2 * k))) for k in range(15)])
_LOGARITHMS = np.array([_pair(Fraction(2, 2 * k + 1)) for k in range(24)])
_EXPONENTIALS = np.array([_pair(Fraction(1, factorial(k))) for k in range(26)])
_PER_LOG_2 = 1.0 / _LOG_2[0]
_LARGEST_EXPONENT, _LEAST_EXPONENT = 709.782712893384, -745.2
_ROOT_HALF = 0.7071067811865476


def _add(a, a_low, b, b_low):
    """Return the sum of two pairs."""
    high, low = _sum(a, b)
    return _sum(high, low + (a_low + b_low))


def _times(a, a_low, b, b_low):
    """Return the product of two pairs."""
    high, low = _product(a, b)
    return _sum(high, low + (a * b_low + a_low * b))


def _quotient(a, a_low, b, b_low):
    """Return the quotient of two pairs."""
    high = a / b
    product, error = _product(high, b)
    return _sum(high, ((a - product) - error + a_low - high * b_low) / b)


@jitted
def _series(terms, x, x_low):
    """Return a polynomial with pairs for coefficients, at a pair."""
    last = len(terms) - 1
    high, low = terms[last, 0], terms[last, 1]
    for k in range(last - 1, -1, -1):
        high, low = _times(high, low, x, x_low)
        high, low = _add(high, low, terms[k, 0], terms[k, 1])
    return high, low


@jitted
def _turned(x, quarters):
    """Return the sine of an angle plus a number of right angles."""
    count = (x * _TO_QUADRANTS + _ROUNDS) - _ROUNDS
    high, low = _product(count, -_HALF_PI[0])
    high, less = _sum(high, x)
    high, low = _sum(high, low + less)
    more, rest = _product(count, -_HALF_PI[1])
    high, low = _add(high, low, more, rest - count * _HALF_PI_REST)
    square, square_low = _times(high, low, high, low)
    quadrant = (np.int64(count) + quarters) & 3
    if quadrant & 1:
        value, rest = _series(_COSINES, square, square_low)
    else:
        value, rest = _series(_SINES, square, square_low)
        value, rest = _times(value, rest, high, low)
    value = value + rest
    return -value if quadrant & 2 else value


@jitted
def sine(x):
    """Return the sine of an angle in rad, up to some thousands of rad in size."""
    return x if x == 0.0 else _turned(x, 0)


@jitted
def cosine(x):
    """Return the cosine of an angle in rad, up to some thousands of rad in size."""
    return _turned(x, 1)


@jitted
def logarithm(x):
    """Return the natural logarithm of a normal positive number; of 0, minus infinity."""
    if x == 0.0:
        return -np.inf
    bits = bits_of(x)
    power = np.int64(bits >> np.uint64(52)) - 1022
    fraction = number_of((bits & _FRACTION) | (np.uint64(1022) << np.uint64(52)))
    if fraction < _ROOT_HALF:
        fraction, power = 2.0 * fraction, power - 1
    # 2 artanh((m - 1) / (m + 1)); m - 1 is exact.
    above, (below, below_low) = fraction - 1.0, _sum(fraction, 1.0)
    high, low = _quotient(above, 0.0, below, below_low)
    square, square_low = _times(high, low, high, low)
    value, rest = _series(_LOGARITHMS, square, square_low)
    value, rest = _times(value, rest, high, low)
    more, less = _times(float(power), 0.0, _LOG_2[0], _LOG_2[1])
    value, rest = _add(more, less, value, rest)
    return value + rest


@jitted
def _reduced_exponential(x):
    """Return a pair and a power of two, the product of which is the exponential of a number."""
    power = (x * _PER_LOG_2 + _ROUNDS) - _ROUNDS
    high, low = _times(power, 0.0, -_LOG_2[0], -_LOG_2[1])
    high, low = _add(x, 0.0, high, low)
    high, low = _series(_EXPONENTIALS, high, low)
    return high, low, np.int64(power)


@jitted
def _power_of_two(n):
    """Return 2^n, from n = -1022 to 1023."""
    return number_of(np.uint64(n + 1023) << np.uint64(52))


@jitted
def exponential(x):
    """Return the exponential of a number; a result below 2.3e-308 is rounded twice."""
    if not abs(x) < np.inf:
        return 0.0 if x < 0.0 else x
    if x > _LARGEST_EXPONENT:
        return np.inf
    if x < _LEAST_EXPONENT:
        return 0.0
    high, low, power = _reduced_exponential(x)
    half = power >> 1
    return (high + low) * _power_of_two(half) * _power_of_two(power - half)


@jitted
def hyperbolic_tangent(x):
    """Return the hyperbolic tangent of a number."""
    if not (abs(x) > 1e-9):  # the next term of its series is below rounding
        return x
    if abs(x) > 20.0:
        return 1.0 if x > 0.0 else -1.0
    high, low, power = _reduced_exponential(2.0 * abs(x))
    scale = _power_of_two(power)
    high, low = high * scale, low * scale
    above, above_low = _add(high, low, -1.0, 0.0)
    below, below_low = _add(high, low, 1.0, 0.0)
    value, rest = _quotient(above, above_low, below, below_low)
    return value + rest if x > 0.0 else -(value + rest)


@jitted
def arcsine(x):
    """Return the angle in rad, from -pi/2 to pi/2, with a given sine."""
    if x == 0.0 or not abs(x) <= 1.0:
        return x if x == 0.0 else np.nan
    # 1 - t^2/2 is at most cos(t), so that Newton's method converges from here.
    y = _HALF_PI[0] - np.sqrt(2.0 * (1.0 - abs(x)))
    y = y if x > 0.0 else -y
    for _ in range(60):
        slope = cosine(y)
        if slope < 1e-8:
            break
        change = (sine(y) - x) / slope
        y = min(max(y - change, -_HALF_PI[0]), _HALF_PI[0])
        if abs(change) < 1e-9:
            break
    # One more step of Newton's method with the error of the sine to twice as many digits.
    square, square_low = _times(y, 0.0, y, 0.0)
    value, rest = _series(_SINES, square, square_low)
    value, rest = _times(value, rest, y, 0.0)
    slope = cosine(y)
    return y if slope < 1e-8 else y - ((value - x) + rest) / slope
