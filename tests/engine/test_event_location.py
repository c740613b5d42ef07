"""Parts of event location within a step: quintics and their roots."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from examples.unequal_legs import PROSTHESIS
from gym_passive_walker import WALKERS, Outcome, find_gait, stride_map
from gym_passive_walker.engine import event_location
from gym_passive_walker.engine.compiler import linker
from gym_passive_walker.engine.layout import HISTORY
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.models.model import bodies
from tests.equations.examples import LONG_GAITS

QUINTIC, VALUE, DERIVATIVE, ROOT, HIDDEN_CROSSINGS, EXTRAPOLATED, MOST_ZEROS = (
    linker()(getattr(event_location, name))
    for name in (
        "quintic",
        "value",
        "derivative",
        "root",
        "hidden_crossings",
        "extrapolated",
        "most_zeros",
    )
)


@numba.njit
def _quintic(histories, i, h):
    return QUINTIC(histories[0], i, h)


@numba.njit
def _value(p, x):
    return VALUE(p, x)


@numba.njit
def _derivative(p):
    return DERIVATIVE(p)


@numba.njit
def _root(p):
    return ROOT(p)


@numba.njit
def _hidden_crossings(histories, i, h):
    return HIDDEN_CROSSINGS(histories[0], i, h)


@numba.njit
def _most_zeros(p, low, high):
    return MOST_ZEROS(p, low, high)


@numba.njit
def _extrapolated(histories, i, ahead):
    return EXTRAPOLATED(histories[0], i, ahead)


ENDS = ("before", "rate_before", "bend_before", "after", "rate_after", "bend_after")


def history(ends, i: int = 0) -> np.ndarray:
    """A guard's value and two time derivatives at both ends of a step."""
    histories = np.zeros(1, HISTORY)
    for name, value in zip(ENDS, ends, strict=True):
        histories[name][0, i] = value
    return histories


def quintic(ends):
    """The polynomial over a step of length 1."""
    return _quintic(history(ends), 0, 1.0)


@pytest.mark.parametrize("h", [1.0, 0.25])
def test_a_quintic_has_the_values_slopes_and_curvatures_it_is_made_from(h):
    rng = np.random.default_rng(1)
    for ends in rng.normal(size=(100, 6)):
        p = _quintic(history(ends, 3), 3, h)
        slope = _derivative(p)
        curvature = _derivative(slope)
        for x, (value, first, second) in ((0.0, ends[:3]), (1.0, ends[3:])):
            found = [_value(q, x) for q in (p, slope, curvature)]
            expected = [value, first * h, second * h * h]
            np.testing.assert_allclose(found[:2], expected[:2], rtol=0.0, atol=1e-13)
            np.testing.assert_allclose(found[2], expected[2], rtol=0.0, atol=1e-12)


def test_a_root_is_found_between_ends_of_different_sign():
    """For any polynomial: Newton's steps may diverge, bisection does not."""
    rng = np.random.default_rng(2)
    for ends in rng.normal(size=(2000, 6)) * [1.0, 30.0, 100.0, 1.0, 30.0, 100.0]:
        ends[3] = -np.sign(ends[0]) * abs(ends[3])
        p = quintic(ends)
        x = _root(p)
        assert 0.0 <= x <= 1.0
        assert abs(_value(p, x)) <= 1e-9 * np.abs(ends).max()


def test_a_root_where_the_polynomial_is_flat_is_found():
    flat = (-(0.3**5), 5 * 0.3**4, -10 * 0.3**3, 10 * 0.3**2, -5 * 0.3, 1.0)  # (x - 0.3)^5
    assert abs(_root(flat) - 0.3) < 1e-3
    assert abs(_root((1.0, 0.0, 0.0, 0.0, 0.0, -2.0)) - 0.5**0.2) < 1e-12


def along(function, h: float):
    """A step of length h over which a guard is a polynomial of the time since its start."""
    p = np.polynomial.Polynomial(function)
    return history([q(t) for t in (0.0, h) for q in (p, p.deriv(), p.deriv(2))])


def test_a_quintic_has_at_most_the_stated_number_of_zeros():
    """It has as many, or fewer by an even number; in a short part without a pair, as many."""
    rng = np.random.default_rng(3)
    for roots in rng.uniform(-1.0, 2.0, (500, 5)):
        p = tuple(np.polynomial.polynomial.polyfromroots(roots))
        for low, high in ((0.0, 1.0), (0.2, 0.6), (0.5, 0.51)):
            inside = np.sum((low < roots) & (roots < high))
            more = _most_zeros(p, low, high) - inside
            assert more in (0, 2, 4)
            near = (abs(roots - low) < 0.1).sum()
            assert more == 0 or high - low > 0.1 or near > 1


@pytest.mark.parametrize(
    ("walker", "slope", "terrain"),
    [(PROSTHESIS, 0.0523, None), ("A", 0.01, {"stairs": {"rise": 0.001}})],
)
def test_how_a_stride_ends_does_not_depend_on_where_its_steps_end(walker, slope, terrain):
    """Also where a foot falls, rises and falls again within a step, as legs pass each other."""
    point = find_gait(walker, slope).point.values[0]
    points = point * (1.0 + 0.5 * np.random.default_rng(0).normal(size=(4000, len(point))))
    exact, fast = (
        stride_map(walker, slope, terrain=terrain, tolerance=tolerance).apply(points).outcomes
        for tolerance in (1e-12, 1e-6)
    )
    np.testing.assert_array_equal(fast, exact)


def test_a_guard_that_dips_to_zero_and_back_hides_two_falls():
    """(t - 0.3)² - d: below zero around 0.3 where d is positive."""
    for dip in (1e-3, 1e-12, -1e-12):
        turn = _hidden_crossings(along([0.09 - dip, -0.6, 1.0], 1.0), 0, 1.0)
        assert turn == pytest.approx(0.3, abs=1e-6)
    assert _hidden_crossings(along([0.09 + 1.0, -0.6, 1.0], 1.0), 0, 1.0) == -1.0  # far from zero
    assert _hidden_crossings(along([0.1, 0.2, 1.0], 1.0), 0, 1.0) == -1.0  # no turn


def test_a_turn_at_a_steps_end_hides_nothing():
    assert _hidden_crossings(along([1e-16, -1e-8, 1.0], 1.0), 0, 1.0) == -1.0


def test_a_guard_is_followed_a_little_beyond_the_step():
    histories = along([0.2, -1.0, 0.5], 0.4)
    assert _extrapolated(histories, 0, 0.01) == pytest.approx(0.2 - 0.41 + 0.5 * 0.41**2, abs=1e-15)


@pytest.mark.parametrize("name", ["lab", "C", "A", "E"])
def test_a_hip_that_turns_back_twice_has_gone_every_way(name):
    """For steps of any length: the absolute work includes each reversal."""
    random, walker, count = np.random.default_rng(0), WALKERS[name], 2000
    states = random.uniform(-0.3, 0.3, (count, 6))
    states[:, 4] = states[:, 3] + random.uniform(-0.003, 0.003, count)  # the hip hardly turns
    states[:, 2], states[:, 5] = states[:, 1], states[:, 4]
    fresh = new_records(states, 0.03, random.uniform(-0.1, 0.1, count))

    def walked(times):
        records = fresh.copy()
        for time in times:
            records["end"] = time
            going = records["outcome"][:, 0] == 0
            records[going] = advance(
                walker.equations(), bodies(walker), records[going], tolerance=1e-10,
                from_section=False,
            )  # fmt: skip
        return records["turned"][:, 0, 0], records["moved"][:, 0, 0], records["outcome"][:, 0] == 0

    (way, moved, going), (ways, _, _) = walked([0.2]), walked(0.2 * np.arange(1, 33) / 32)
    assert going.mean() > 0.9 and (way > 1.001 * np.abs(moved)).any()
    np.testing.assert_allclose(way[going], ways[going], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "slope", "most"), [("lab", 0.036, 18), ("A", 0.03, 9), ("D", 0.009, 9)]
)
def test_steps_end_on_strikes_and_few_are_made_again(name, slope, most):
    """Each impact is predicted: few steps, with errors of at most a tenth of the allowed one."""
    walker, count = WALKERS[name], 64
    state = walker.units.to_dimensionless(find_gait(walker, slope).state)
    states = state * (1.0 + 0.01 * np.random.default_rng(1).uniform(-1.0, 1.0, (count, 6)))
    states[:, 1] = states[:, 2] = -states[:, 0]
    if not walker.knees:
        states[:, 5] = states[:, 4]
    ends = {}
    for tolerance in (1e-8, 1e-14):
        records = new_records(states, slope)
        advance(walker.equations(), bodies(walker), records, tolerance=tolerance)
        assert np.all(records["outcome"] == Outcome.HEELSTRIKE)
        ends[tolerance] = records
    assert ends[1e-8]["steps"].mean() < most
    rough, fine = (found["state"][:, 0] for found in ends.values())
    np.testing.assert_allclose(rough, fine, rtol=0.0, atol=1e-9 * np.abs(fine).max())
    np.testing.assert_array_equal(rough[:, 1], rough[:, 2])  # both feet are on the ground


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_a_step_that_ends_near_a_strike_goes_on_to_it(name):
    """A walk is integrated in pieces; the last piece ends near the impact."""
    walker = WALKERS[name]
    gait = LONG_GAITS[name]
    state = walker.units.to_dimensionless(gait.state)[None]
    whole = new_records(state, gait.slope)
    advance(walker.equations(), bodies(walker), whole, tolerance=1e-12)
    struck = float(whole["time"][0, 0])
    for before in np.geomspace(1e-9, 0.3, 25):
        pieces = new_records(state, gait.slope, end=struck - before)
        advance(walker.equations(), bodies(walker), pieces, tolerance=1e-12)
        assert pieces["outcome"][0, 0] == Outcome.RUNNING
        pieces["end"] = 100.0
        advance(walker.equations(), bodies(walker), pieces, tolerance=1e-12, from_section=False)
        assert pieces["outcome"][0, 0] == Outcome.HEELSTRIKE
        assert pieces["time"][0, 0] == pytest.approx(struck, abs=1e-10)
        np.testing.assert_allclose(pieces["state"], whole["state"], rtol=0.0, atol=1e-10)
