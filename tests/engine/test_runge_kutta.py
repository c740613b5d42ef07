"""The pair of coefficients is what its paper says it is."""

from __future__ import annotations

import numpy as np
import pytest

from gym_passive_walker.physics import verner

MATRIX = np.zeros((verner.STAGES, verner.STAGES))
for stage, row in enumerate(verner.MATRIX):
    MATRIX[stage, : len(row)] = row
WEIGHTS, ERROR = np.array(verner.WEIGHTS), np.array(verner.ERROR)
NODES = MATRIX.sum(axis=1)


@pytest.mark.parametrize("power", range(9))
def test_a_step_integrates_polynomials_of_time_exactly(power):
    assert WEIGHTS @ NODES**power == pytest.approx(1.0 / (power + 1), abs=1e-14)


@pytest.mark.parametrize("power", range(8))
def test_the_embedded_step_is_of_order_eight_and_no_more(power):
    assert ERROR @ NODES**power == pytest.approx(0.0, abs=1e-13)


def test_the_embedded_step_differs_at_order_nine():
    assert abs(ERROR @ NODES**8) > 1e-7


@pytest.mark.parametrize("links", range(1, 9))
def test_a_step_follows_a_linear_equation_to_order_nine(links):
    """The tall trees: b A ... A 1 = 1 / (links + 1)!"""
    values = np.ones(verner.STAGES)
    for _ in range(links):
        values = MATRIX @ values
    factorial = np.prod(np.arange(1.0, links + 2.0))
    assert WEIGHTS @ values == pytest.approx(1.0 / factorial, abs=1e-14)


@pytest.mark.parametrize(("one", "other"), [(1, 2), (2, 2), (2, 4), (3, 3)])
def test_a_step_follows_bushy_trees_to_order_nine(one, other):
    """The sum b (A c^p)(A c^q) has the value of the double integral that it stands for."""
    value = WEIGHTS @ ((MATRIX @ NODES**one) * (MATRIX @ NODES**other))
    exact = 1.0 / ((one + 1) * (other + 1) * (one + other + 3))
    assert value == pytest.approx(exact, abs=1e-14)
