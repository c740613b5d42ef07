"""Pairs of Runge-Kutta methods are data; the one in use is what its paper says it is."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from gym_passive_walker.engine import step
from gym_passive_walker.engine.expressions import read
from gym_passive_walker.engine.layout import PAIR
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.engine.verner import VERNER
from tests.engine.machine import evaluate

MATRIX, WEIGHTS = VERNER.rates[:-1], VERNER.rates[-1]
NODES, ERROR = VERNER.nodes[:-1], VERNER.rate_error


def test_walkers_step_with_verners_pair():
    assert PAIR is VERNER
    assert (VERNER.order, VERNER.error_order, VERNER.stages) == (9, 8, 16)


@pytest.mark.parametrize("power", range(9))
def test_a_step_integrates_polynomials_of_time_exactly(power):
    assert float(WEIGHTS @ NODES**power) == pytest.approx(1.0 / (power + 1), abs=1e-14)


@pytest.mark.parametrize("power", range(8))
def test_the_embedded_step_is_of_order_eight_and_no_more(power):
    assert float(ERROR @ NODES**power) == pytest.approx(0.0, abs=1e-13)


def test_the_embedded_step_differs_at_order_nine():
    assert abs(ERROR @ NODES**8) > 1e-7


@pytest.mark.parametrize("links", range(1, 9))
def test_a_step_follows_a_linear_equation_to_order_nine(links):
    """The tall trees: b A ... A 1 = 1 / (links + 1)!"""
    values = np.ones(VERNER.stages)
    for _ in range(links):
        values = MATRIX @ values
    factorial = np.prod(np.arange(1.0, links + 2.0))
    assert float(WEIGHTS @ values) == pytest.approx(1.0 / factorial, abs=1e-14)


@pytest.mark.parametrize(("one", "other"), [(1, 2), (2, 2), (2, 4), (3, 3)])
def test_a_step_follows_bushy_trees_to_order_nine(one, other):
    """The sum b (A c^p)(A c^q) has the value of the double integral that it stands for."""
    value = WEIGHTS @ ((MATRIX @ NODES**one) * (MATRIX @ NODES**other))
    exact = 1.0 / ((one + 1) * (other + 1) * (one + other + 3))
    assert float(value) == pytest.approx(exact, abs=1e-14)


@pytest.mark.parametrize("power", range(8))
def test_angles_are_followed_as_if_their_rates_were_integrated(power):
    """The double integral of a power of time, by the weights for second-order equations."""
    exact = 1.0 / ((power + 1) * (power + 2))
    assert float(VERNER.angles[-1] @ NODES**power) == pytest.approx(exact, abs=1e-14)
    assert float(VERNER.angle_error @ NODES**power) == pytest.approx(
        0.0, abs=1e-13 if power < 7 else 1.0
    )


def test_a_step_ends_where_it_should():
    assert VERNER.nodes[0] == 0.0
    assert float(VERNER.nodes[-1]) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_array_equal(np.triu(MATRIX), 0.0)


# Any other pair is data as well.


def fractions(text: str) -> list[float]:
    """Numbers written as quotients."""
    return [float(Fraction(x)) for x in text.split()]


DORMAND_PRINCE = Pair.from_tableau(
    [
        [],
        fractions("1/5"),
        fractions("3/40 9/40"),
        fractions("44/45 -56/15 32/9"),
        fractions("19372/6561 -25360/2187 64448/6561 -212/729"),
        fractions("9017/3168 -355/33 46732/5247 49/176 -5103/18656"),
        fractions("35/384 0 500/1113 125/192 -2187/6784 11/84"),
    ],
    fractions("35/384 0 500/1113 125/192 -2187/6784 11/84 0"),
    fractions("71/57600 0 -71/16695 71/1920 -17253/339200 22/525 -1/40"),
    order=5,
    error_order=4,
)
"""Dormand and Prince (1980): a pair of order 5(4), with seven stages."""


def test_a_pair_from_its_tableau_has_a_row_for_each_stage_and_the_end():
    pair = DORMAND_PRINCE
    assert pair.stages == 7
    assert pair.rates.shape == pair.angles.shape == (8, 7)
    assert pair.nodes.shape == (8,)
    assert pair.rate_error.shape == pair.angle_error.shape == (7,)
    np.testing.assert_allclose(
        pair.nodes.astype(float), [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0, 1.0], atol=1e-15
    )
    assert float(pair.rates[-1].sum()) == pytest.approx(1.0, abs=1e-15)
    assert float(pair.angles[-1].sum()) == pytest.approx(0.5, abs=1e-15)
    assert float(pair.rate_error.sum()) == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_array_equal(pair.rates[-1], pair.rates[-2])  # its last stage is its end


def test_a_tableau_with_a_row_too_few_is_refused():
    with pytest.raises(ValueError):
        Pair.from_tableau([[]], [0.5, 0.5], [0.5, -0.5], order=2, error_order=1)


def pendulum_step(pair: Pair, angle: float, rate: float, h: float):
    """One step of a damped pendulum, and the errors estimated, in the form for such equations."""
    stages = np.zeros(pair.stages, np.longdouble)
    for i in range(pair.stages + 1):
        at = angle + h * pair.nodes[i] * rate + h * h * (pair.angles[i] @ stages)
        speed = rate + h * (pair.rates[i] @ stages)
        if i < pair.stages:
            stages[i] = -np.sin(at) - np.longdouble(0.1) * speed
    errors = h * h * (pair.angle_error @ stages), h * (pair.rate_error @ stages)
    return at, speed, errors


@pytest.mark.parametrize("pair", [VERNER, DORMAND_PRINCE], ids=["verner", "dormand-prince"])
def test_a_step_without_stages_for_the_angles_is_the_method_itself(pair):
    """Against the tableau applied to angle and rate as two equations of first order."""
    h, y = np.longdouble(0.3), np.array([0.7, -0.4], np.longdouble)
    slopes = np.zeros((pair.stages, 2), np.longdouble)
    for i in range(pair.stages):
        at, speed = y + h * (pair.rates[i] @ slopes)
        slopes[i] = speed, -np.sin(at) - np.longdouble(0.1) * speed
    end, error = y + h * (pair.rates[-1] @ slopes), h * (pair.rate_error @ slopes)
    *found, errors = pendulum_step(pair, *y, h)
    np.testing.assert_allclose(np.array(found, float), end.astype(float), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(np.array(errors, float), error.astype(float), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("pair", "coarse"), [(VERNER, 1.0), (DORMAND_PRINCE, 0.1)], ids=["verner", "dormand-prince"]
)
def test_errors_shrink_with_the_steps_as_the_orders_say(pair, coarse):
    def walk(h):
        state, told = (np.longdouble(0.7), np.longdouble(-0.4)), 0.0
        for _ in range(round(4.0 / h)):
            *state, errors = pendulum_step(pair, *state, np.longdouble(h))
            told = max(told, np.abs(errors).max())
        return np.array(state), told

    exact, _ = walk(coarse / 16.0)
    (rough, told), (fine, told_fine) = walk(coarse), walk(coarse / 2.0)
    order = np.log2(np.abs(rough - exact).max() / np.abs(fine - exact).max())
    assert order > pair.order - 0.2  # more where the first terms beyond it are small
    assert np.log2(told / told_fine) == pytest.approx(pair.error_order + 1, abs=0.8)


@pytest.mark.parametrize("order", [4, 5, 7, 8])
def test_steps_grow_with_the_root_of_the_error(order):
    """Its exponent is one over the order of the error, as near as square roots come to it."""
    x = read({}, "error")
    factor = step.growth(x, PAIR._replace(error_order=order))
    for share in (-0.5, 0.3, 0.7):
        error = (step.SAFETY / 1.5**share) ** order
        found = float(evaluate(factor, {x: error}))
        assert np.log(found / step.SAFETY) / np.log(error) == pytest.approx(-1.0 / order, abs=1e-3)


def test_steps_grow_and_shrink_by_no_more_than_they_may():
    x = read({}, "error")
    factor = step.growth(x)
    for error, bound in ((0.0, step.FASTEST), (1e-300, step.FASTEST), (1e30, step.SLOWEST)):
        assert float(evaluate(factor, {x: error})) == bound
