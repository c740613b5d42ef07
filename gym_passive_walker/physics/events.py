"""Events: what ends a phase, as straight-line functions of the angles that fall through zero.

Every event function is linear in the angles, so its rate and its acceleration are at hand at both
ends of a step, and a quintic polynomial through them says where in the step to look.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from gym_passive_walker.physics.lanes import inlined, jitted

# Phases of a stride.
FREE = 0  # knee free: three links
LOCKED = 1  # straight swing leg: two links
SIMPLEST = 2  # straight swing leg without mass


class Outcome(IntEnum):
    """How a stride, or a tick of one, ended."""

    RUNNING = 0
    """The time asked for is over and the stride goes on."""
    HEELSTRIKE = 1
    """The swing foot came down in front: the next stride begins."""
    KNEESTRIKE = 2
    """The swing knee locked (inside a stride only)."""
    FELL_FORWARD = 3
    """The stance leg lies on the ground ahead."""
    FELL_BACKWARD = 4
    """The stance leg lies on the ground behind."""
    OVER_THE_TOP = 5
    """The swing leg went round beyond the upright."""
    STUBBED_TOE = 6
    """The locked swing leg of a kneed walker was below the ground (only where this is a rule)."""
    BENT_KNEE = 7
    """The foot came down in front before the knee had locked."""
    STALLED = 8
    """No heelstrike within the time allowed: rocking, standing or hanging."""
    DIVERGED = 9
    """The motion left the range of floating-point numbers."""


# Rows: weights of stance, thigh and shank angle, and a constant.
_PI = np.pi
_FUNCTIONS = (
    (0.0, 0.0, 0.0, 0.0),
    (1.0, 1.0, 0.0, 0.0),  # heelstrike: the legs mirror each other
    (0.0, 1.0, -1.0, 0.0),  # kneestrike: the shank catches up with the thigh
    (1.0, 0.0, 0.0, 0.5 * _PI),  # falls
    (-1.0, 0.0, 0.0, 0.5 * _PI),
    (0.0, -1.0, 0.0, _PI),  # over the top, forward and backward, thigh and shank
    (0.0, 1.0, 0.0, _PI),
    (0.0, 0.0, -1.0, _PI),
    (0.0, 0.0, 1.0, _PI),
    (-1.0, 1.0, 0.0, 0.0),  # a straight leg that meets the ground anywhere but in front
    (1.0, -1.0, 0.0, 0.0),
    (-1.0, -1.0, 0.0, 0.0),
)
FUNCTIONS = np.array(_FUNCTIONS)
OUTCOMES = np.array([0, 1, 2, 3, 4, 5, 5, 5, 5, 6, 6, 6])
HEELSTRIKE, KNEESTRIKE, FIRST_BOUND, FIRST_STUB, EVENTS = 1, 2, 3, 9, 12


@inlined
def linear(event, stance, thigh, shank):
    """An event function without its constant: of angles, of rates or of accelerations."""
    w = FUNCTIONS[event]
    return w[0] * stance + w[1] * thigh + w[2] * shank


@inlined
def quintic(g0, v0, a0, g1, v1, a1):
    """Coefficients of the polynomial on [0, 1] with these values, slopes and curvatures."""
    rise = g1 - g0 - v0 - 0.5 * a0
    turn = v1 - v0 - a0
    bend = a1 - a0
    return (
        g0,
        v0,
        0.5 * a0,
        10.0 * rise - 4.0 * turn + 0.5 * bend,
        -15.0 * rise + 7.0 * turn - bend,
        6.0 * rise - 3.0 * turn + 0.5 * bend,
    )


@inlined
def value(p, x):
    """The polynomial at x."""
    return p[0] + x * (p[1] + x * (p[2] + x * (p[3] + x * (p[4] + x * p[5]))))


@inlined
def derivative(p):
    """Coefficients of the polynomial's derivative."""
    return p[1], 2.0 * p[2], 3.0 * p[3], 4.0 * p[4], 5.0 * p[5], 0.0 * p[5]


@jitted
def root(p):
    """A root in [0, 1] of a polynomial whose ends differ in sign, by bracketed Newton steps."""
    low, high = 0.0, 1.0
    first, last = value(p, 0.0), value(p, 1.0)
    rising = last > 0.0
    d = derivative(p)
    x = first / (first - last)
    if not 0.0 <= x <= 1.0:  # rounding of huge coefficients has hidden the change of sign
        x = 0.5
    for _ in range(60):
        g = value(p, x)
        if (g > 0.0) == rising:
            high = x
        else:
            low = x
        slope = value(d, x)
        new = x - g / slope if slope != 0.0 else 0.5 * (low + high)
        if not low < new < high:
            new = 0.5 * (low + high)
        if np.abs(new - x) < 1e-6:  # the next change would be its square
            return new
        x = new
    return x
