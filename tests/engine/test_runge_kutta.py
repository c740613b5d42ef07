"""Runge-Kutta pairs are data, and the pair in use has the published properties."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from gym_passive_walker.engine import step
from gym_passive_walker.engine.layout import PAIR
from gym_passive_walker.engine.runge_kutta import Pair
from gym_passive_walker.engine.verner import VERNER
from gym_passive_walker.models.expressions import read
from tests.engine.machine import evaluate

MATRIX, WEIGHTS = VERNER.weights[:-1], VERNER.weights[-1]
NODES, ERROR = VERNER.nodes[:-1], VERNER.error


def test_walkers_step_with_verners_pair():
    assert PAIR is VERNER
    assert (VERNER.order, VERNER.error_order, VERNER.stages) == (9, 7, 15)


@pytest.mark.parametrize("power", range(9))
def test_a_step_integrates_polynomials_of_time_exactly(power):
    assert float(WEIGHTS @ NODES**power) == pytest.approx(1.0 / (power + 1), abs=1e-14)


def trees(order: int) -> list[tuple]:
    """The rooted trees with this number of vertices: each is the tuple of its branches."""
    smaller = [(size, tree) for size in range(1, order) for tree in trees(size)]

    def forests(left: int, first: int) -> list[tuple]:
        if left == 0:
            return [()]
        return [
            (tree, *rest)
            for k, (size, tree) in enumerate(smaller[first:], first)
            if size <= left
            for rest in forests(left - size, k)
        ]

    return forests(order - 1, 0)


def weights_of(tree: tuple) -> np.ndarray:
    """Weights of each stage in a tree's order condition."""
    values = np.ones(VERNER.stages, np.longdouble)
    for branch in tree:
        values = values * (MATRIX @ weights_of(branch))
    return values


@pytest.mark.parametrize(("order", "count"), [*enumerate([1, 1, 2, 4, 9, 20, 48], 1)])
def test_the_estimate_sees_nothing_that_a_method_of_order_seven_does_right(order, count):
    found = trees(order)
    assert len(found) == count  # Cayley's
    for tree in found:
        assert abs(float(ERROR @ weights_of(tree))) < 1e-14 * float(np.abs(ERROR).max())


def test_the_estimate_sees_what_is_of_order_eight():
    seen = [abs(float(ERROR @ weights_of(tree))) for tree in trees(8)]
    assert len(seen) == 115
    assert min(seen) > 1e-8 * float(np.abs(ERROR).max())


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
    assert float(WEIGHTS @ MATRIX @ NODES**power) == pytest.approx(exact, abs=1e-14)


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
    assert pair.weights.shape == (8, 7)
    assert pair.nodes.shape == (8,)
    assert pair.error.shape == (7,)
    np.testing.assert_allclose(
        pair.nodes.astype(float), [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0, 1.0], atol=1e-15
    )
    assert float(pair.weights[-1].sum()) == pytest.approx(1.0, abs=1e-15)
    assert float(pair.weights[-1] @ pair.nodes[:-1]) == pytest.approx(0.5, abs=1e-15)
    assert float(pair.error.sum()) == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_array_equal(pair.weights[-1], pair.weights[-2])  # its last stage is its end


def test_a_tableau_with_a_row_too_few_is_refused():
    with pytest.raises(ValueError):
        Pair.from_tableau([[]], [0.5, 0.5], [0.5, -0.5], order=2, error_order=1)


def pendulum_step(pair: Pair, angle: float, rate: float, h: float):
    """One step of a damped pendulum, and the error of its rate, in the form for such equations."""
    stages, angles = np.zeros(pair.stages, np.longdouble), pair.weights @ pair.weights[:-1]
    for i in range(pair.stages + 1):
        at = angle + h * pair.nodes[i] * rate + h * h * (angles[i] @ stages)
        speed = rate + h * (pair.weights[i] @ stages)
        if i < pair.stages:
            stages[i] = -np.sin(at) - np.longdouble(0.1) * speed
    return at, speed, h * (pair.error @ stages)


@pytest.mark.parametrize("pair", [VERNER, DORMAND_PRINCE], ids=["verner", "dormand-prince"])
def test_a_step_without_stages_for_the_angles_is_the_method_itself(pair):
    """Against the tableau applied to angle and rate as two equations of first order."""
    h, y = np.longdouble(0.3), np.array([0.7, -0.4], np.longdouble)
    slopes = np.zeros((pair.stages, 2), np.longdouble)
    for i in range(pair.stages):
        at, speed = y + h * (pair.weights[i] @ slopes)
        slopes[i] = speed, -np.sin(at) - np.longdouble(0.1) * speed
    end, error = y + h * (pair.weights[-1] @ slopes), h * (pair.error @ slopes)
    *found, reported = pendulum_step(pair, *y, h)
    np.testing.assert_allclose(np.array(found, float), end.astype(float), rtol=0.0, atol=1e-15)
    assert float(reported) == pytest.approx(float(error[1]), rel=0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("pair", "coarse"), [(VERNER, 0.5), (DORMAND_PRINCE, 0.1)], ids=["verner", "dormand-prince"]
)
def test_errors_shrink_with_the_steps_as_the_orders_say(pair, coarse):
    def walk(h):
        state, reported = (np.longdouble(0.7), np.longdouble(-0.4)), 0.0
        for _ in range(round(4.0 / h)):
            *state, error = pendulum_step(pair, *state, np.longdouble(h))
            reported = max(reported, abs(error))
        return np.array(state), reported

    exact, _ = walk(coarse / 16.0)
    (rough, reported), (fine, reported_fine) = walk(coarse), walk(coarse / 2.0)
    order = np.log2(np.abs(rough - exact).max() / np.abs(fine - exact).max())
    assert order > pair.order - 0.2  # more where the first terms beyond it are small
    assert np.log2(reported / reported_fine) == pytest.approx(pair.error_order + 1, abs=0.8)


def test_steps_grow_and_shrink_by_no_more_than_they_may():
    x = read({}, "error")
    factor = step.step_growth(x, 8)
    assert float(evaluate(factor, {x: 1.0})) == step.SAFETY
    for error, bound in ((0.0, step.FASTEST), (1e30, step.SLOWEST)):
        assert float(evaluate(factor, {x: error})) == bound


@pytest.mark.parametrize("pair", [VERNER, DORMAND_PRINCE], ids=["verner", "dormand-prince"])
@pytest.mark.parametrize("count", [3, 5])
def test_accelerations_go_on_along_the_polynomial_through_the_last_stages(pair, count):
    powers = np.random.default_rng(1).normal(size=count)
    weights = pair.onward(count)
    nodes = pair.nodes.astype(float)
    assert next(iter(weights)) == pair.stages and nodes[pair.stages] == pytest.approx(1.0)
    assert all(a > b for a, b in pairwise(nodes[stage] for stage in weights))
    for k in range(count):
        found = sum(
            w[k] * np.polyval(powers[::-1], nodes[stage] - 1.0) for stage, w in weights.items()
        )
        assert found == pytest.approx(powers[k], abs=1e-9)


def test_angles_follow_those_of_the_stage_nearest_in_time():
    nodes = VERNER.nodes.astype(float)
    for stage, other in enumerate(VERNER.neighbours(), 1):
        assert other < stage
        assert abs(nodes[stage] - nodes[other]) <= np.abs(nodes[stage] - nodes[:stage]).min() + 1e-9


@pytest.mark.parametrize("pair", [VERNER, DORMAND_PRINCE], ids=["verner", "dormand-prince"])
def test_nobody_takes_a_place_that_others_still_follow(pair):
    places, holds = pair.places(), {}
    for stage, other in enumerate([None, *pair.neighbours()]):
        assert other is None or holds[places[other]] == other
        holds[places[stage]] = stage
    assert max(places) < pair.stages // 2
