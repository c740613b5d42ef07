"""What derived functions return for numbers is what NumPy computes."""

from typing import NamedTuple

import numpy as np
import pytest

from gym_passive_walker.engine.own.mechanics import Derived
from gym_passive_walker.models.math import cos, exp, maximum, minimum, sin, sqrt, tanh, where


class Angles(NamedTuple):
    """Two angles."""

    stance: float
    swing: float


def chosen(condition):
    """A function that has one of two values, by a condition on two angles."""
    return lambda s: where(condition(s.stance, s.swing), 1.0 + s.stance, s.swing)


FUNCTIONS = {
    "arithmetic": lambda s: (s.stance - s.swing) / (2.0 + s.stance * s.swing) + -s.swing,
    "absolute": lambda s: abs(s.stance) + abs(s.swing),
    "root": lambda s: sqrt(4.0 + s.stance) + (2.0 + s.swing) ** 2,
    "functions": lambda s: exp(s.stance) + tanh(s.swing) + sin(s.stance) * cos(s.swing),
    "smaller and larger": lambda s: minimum(s.stance, s.swing) - 2.0 * maximum(s.stance, s.swing),
    "less": chosen(lambda a, b: a < b),
    "at most": chosen(lambda a, b: a <= b),
    "more": chosen(lambda a, b: a > b),
    "at least": chosen(lambda a, b: a >= b),
    "and": chosen(lambda a, b: (a < b) & (a > 0.0)),
    "or": chosen(lambda a, b: (a < b) | (a > 0.0)),
    "not": chosen(lambda a, b: ~(a < b)),
    "neither": chosen(lambda a, b: ~((a < b) | (a > 0.0))),
}

SIGNS = np.array([-0.7, -0.2, 0.0, 0.3, 0.9])


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_derived_function_of_numbers_is_the_function(name):
    stance, swing = (part.ravel() for part in np.meshgrid(SIGNS, SIGNS))
    expected = FUNCTIONS[name](Angles(stance, swing))
    assert np.ptp(expected) > 0.0
    found = Derived(FUNCTIONS[name])(Angles(stance, swing))
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)
    single = [
        Derived(FUNCTIONS[name])(Angles(*s))
        for s in zip(stance.tolist(), swing.tolist(), strict=True)
    ]
    np.testing.assert_array_equal(np.array(single, dtype=float), found)
