"""Sines and cosines of expressions: by polynomials, or by addition theorems from a nearby angle."""

from __future__ import annotations

import math
from math import factorial

from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.expressions import Expression, polynomial

_INVERSE_PI = 0.3183098861837907
_PI = 3.141592653589793
_PI_REST = 1.2246467991473532e-16  # pi = _PI + _PI_REST to 32 digits


_ROUNDS = 1.5 * 2.0**52
"""Adding a number to this rounds it to an integer; the last bit of the sum is 1 if it is odd."""


def _flipped(x: Expression, rounded: Expression) -> Expression:
    """Return x with its sign changed if `rounded`, which includes _ROUNDS, is odd."""
    return Expression(x.known, "flip", x, rounded)


def near_turn(
    angle: Expression, sine: Expression, cosine: Expression, turn: Expression, most: float
) -> Expression:
    """Return an angle that is near another angle of known sine and cosine.

    Args:
        angle: The angle in rad.
        sine: Sine of the other angle.
        cosine: Cosine of the other angle.
        turn: The angle less the other angle, in rad.
        most: Largest size of `turn` in rad with sine and cosine accurate to about the last bit.
    """
    return Expression(angle.known, "near", angle, sine, cosine, turn, most)


def _by_addition(x: Expression) -> tuple[Expression, Expression]:
    """Return the sine and cosine of an angle near another, by addition theorems and series."""
    _, sine, cosine, turn, most = x.args
    square = turn * turn
    s = turn + (turn * square) * polynomial(_terms(3, most), square)
    less = square * polynomial(_terms(2, most), square)
    by_sine = Expression(x.known, "sin", x, (sine + cosine * s) + sine * less)
    return by_sine, Expression(x.known, "cos", x, (cosine - sine * s) + cosine * less)


def _terms(first: int, most: float) -> list[float]:
    """Return the coefficients of a sine or cosine series, until terms are negligible.

    The first one is that of the power `first`; signs begin with a minus.
    """
    found, k = [-1.0 / factorial(first)], first + 2
    while most**k / factorial(k) > _NOTHING:
        found.append(-math.copysign(1.0, found[-1]) / factorial(k))
        k += 2
    return found


_NOTHING = 2e-17  # negligible beside 1


@sine_cosine.register
def _(x: Expression) -> tuple[Expression, Expression]:
    """Return sine and cosine to about the last bit, in arithmetic that vectorizes.

    The angle is reduced to at most a quarter turn from a multiple of pi. Polynomials in its square
    are Chebyshev fits, evaluated by Estrin's method to keep dependency chains short. The absolute
    error is below 2e-16 for angles up to a thousand turns.
    """
    if x.op == "near":
        return _by_addition(x)
    rounded = x * _INVERSE_PI + _ROUNDS
    half_turns = rounded - _ROUNDS
    r = (x - half_turns * _PI) - half_turns * _PI_REST
    z = r * r
    z2 = z * z
    z4 = z2 * z2
    sine = r + r * z * (
        (
            (-1.6666666666666666e-1 + 8.333333333333316e-3 * z)
            + z2 * (-1.9841269841254966e-4 + 2.7557319219160833e-6 * z)
        )
        + z4
        * (
            (-2.505210761669045e-8 + 1.6058977292642743e-10 * z)
            + z2 * (-7.643969663988074e-13 + 2.7314368769379893e-15 * z)
        )
    )
    cosine = (
        1.0
        - 0.5 * z
        + z2
        * (
            (
                (4.1666666666666664e-2 - 1.388888888888888e-3 * z)
                + z2 * (2.4801587301579848e-5 - 2.755731922156836e-7 * z)
            )
            + z4
            * (
                (2.0876756602722215e-9 - 1.1470712262813793e-11 * z)
                + z2 * (4.77787760803859e-14 - 1.5218598818596388e-16 * z)
            )
        )
    )
    # The first operand is the angle, for the derivative; the second is the code of the value.
    return Expression(x.known, "sin", x, _flipped(sine, rounded)), Expression(
        x.known, "cos", x, _flipped(cosine, rounded)
    )
