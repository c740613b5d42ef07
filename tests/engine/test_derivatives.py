"""Derivatives of a walker that are integrated with it are those of the stride map."""

from __future__ import annotations

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.engine.run import LONGEST_STRIDE, advance
from gym_passive_walker.gaits.flow import Walkers, flow
from tests.equations import statements
from tests.equations.examples import KNEED, LONG_GAITS

RESULTS = (
    "state", "time", "moved", "turned", "knee_time", "knee_loss", "heel_loss", "step_length",
    "gravity_work",
)  # fmt: skip
"""What a stride leaves in a record that depends on where it began."""

MOVED, TURNED = 7, 9
"""Where among results the hip's travel stands, net and either way; each has the ankle's behind."""

STENCIL = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
"""Central differences of order six."""

INPUTS = ["stance", "stance rate", "thigh rate", "shank rate", "slope", "torque"]


def results(records) -> np.ndarray:
    """All results of records in one row, (..., results)."""
    parts = [records[name] for name in RESULTS]
    lead = records.shape
    return np.concatenate([part.reshape(*lead, -1) for part in parts], axis=-1)


def states(inputs, knees: bool) -> np.ndarray:
    """States on the section from stance angle and the three angular velocities, (..., 6)."""
    stance, stance_rate, thigh_rate, shank_rate = np.asarray(inputs, dtype=float)[..., :4].T
    shank_rate = shank_rate if knees else thigh_rate
    return np.stack([stance, -stance, -stance, stance_rate, thigh_rate, shank_rate], axis=-1)


def end(name: str, values, directions=None, by=(), **parameters) -> np.ndarray:
    """A stride's results from the six inputs, and behind them their derivatives, (1 + k, results).

    Args:
        name: Name of the walker.
        values: The inputs.
        directions: Directions in the first four of them, (d, 4).
        by: Names of the variables of derivatives behind those along directions.
        parameters: Parameters in which the walker differs.
    """
    walker, along = WALKERS[name], None
    if directions is not None:
        along = np.zeros((1, 6, len(directions) + len(by)))
        along[0, :, : len(directions)] = states(directions, walker.knees).T
        by = ("point", *by)
    walked = flow(
        Walkers(walker=walker, parameters=parameters, tolerance=1e-14),
        states(values, walker.knees)[None], values[4], controls=values[5], by=by, along=along,
    )  # fmt: skip
    assert walked.outcomes[0] == Outcome.HEELSTRIKE
    return results(walked.records[0])


def derivatives(name: str, values) -> np.ndarray:
    """A stride's results and their derivatives by each of the six inputs, (7, results)."""
    return end(name, values, np.eye(4), ("slope", "hip_torque"))


def start(name: str) -> np.ndarray:
    """Inputs near the long-step gait, with a little torque."""
    gait = LONG_GAITS[name]
    state = statements.dimensionless(WALKERS[name], gait.state)
    return np.array([state[0], *state[3:], gait.slope, 0.003])


def differences(function, value: float, step: float) -> np.ndarray:
    """Derivative of a function of one number by central differences."""
    return (
        sum(
            weight * (function(value + k * step) - function(value - k * step))
            for k, weight in STENCIL.items()
        )
        / step
    )


@pytest.mark.parametrize("name", WALKERS)
def test_the_derivative_is_that_of_the_map(name):
    values = start(name)
    stride, *found = derivatives(name, values)
    if name == "lab":  # it first closes its legs a little: the hip turns by more than they open
        assert stride[TURNED] > 1.02 * abs(stride[MOVED])
    for varied, (derivative, of) in enumerate(zip(found, INPUTS, strict=True)):

        def at(value, varied=varied):
            return end(name, np.where(np.arange(6) == varied, value, values))[0]

        expected = differences(at, values[varied], 2e-4)
        # It bends sharply where the legs hardly turn back before they turn again.
        expected[TURNED] = differences(at, values[varied], 1e-5)[TURNED]
        np.testing.assert_allclose(
            derivative, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max(), err_msg=of
        )
        if varied != 3 or name in KNEED:
            assert np.abs(derivative).max() > 1e-3


@pytest.mark.parametrize("name", WALKERS)
def test_the_values_are_the_stride_itself(name):
    values = start(name)
    carried = derivatives(name, values)[0]
    np.testing.assert_allclose(carried, end(name, values)[0], rtol=0.0, atol=2e-14)


@pytest.mark.parametrize("name", WALKERS)
def test_derivatives_are_in_proportion_to_the_change(name):
    values, direction = start(name), np.array([[0.3, -1.0, 0.5, 0.7]])
    _, whole = end(name, values, direction)
    for share in (2.0**-400, 2.0**300):
        _, part = end(name, values, share * direction)
        np.testing.assert_array_equal(part, share * whole)


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_a_derivative_does_not_depend_on_how_many_ride_along(name):
    rng, values = np.random.default_rng(1), start(name)
    directions = rng.normal(size=(23, 4))
    all_of_them = end(name, values, directions)
    for count in (1, 5, 7):
        some = end(name, values, directions[:count])
        np.testing.assert_array_equal(some, all_of_them[: count + 1])
    np.testing.assert_array_equal(end(name, values, directions[20:])[1:], all_of_them[21:])


def test_a_walk_that_is_stopped_follows_the_moment_when_it_is():
    """A later time limit is further along the motion; other ends do not move."""
    walker, gait = WALKERS["lab"], LONG_GAITS["lab"]
    state = statements.dimensionless(walker, gait.state)[None]

    def stopped(when):
        found = flow(
            Walkers(walker=walker, tolerance=1e-14), state, gait.slope, controls=0.01, until=when,
            by=("point", "end"), along=np.zeros((1, 6, 2)),
        )  # fmt: skip
        assert found.outcomes[0] == Outcome.RUNNING
        return results(found.records[0])[:, :11]

    for when in (0.7, 2.4):
        expected = differences(lambda t: stopped(t)[0], when, 1e-3)
        np.testing.assert_array_equal(stopped(when)[1], 0.0)
        np.testing.assert_allclose(stopped(when)[2], expected, rtol=0.0, atol=1e-9)


def test_a_walk_in_ticks_has_the_derivatives_of_a_walk_at_once():
    walker, gait = WALKERS["lab"], LONG_GAITS["lab"]
    state = statements.dimensionless(walker, gait.state)[None]
    along = np.zeros((1, 6, 4))
    along[0, :, :2] = np.array([[1, -1, -1, 0, 0, 0], [0, 0, 0, 1, 2, 3]]).T

    def walked(until):
        return flow(
            Walkers(walker=walker, tolerance=1e-14), state, gait.slope, controls=0.01, until=until,
            by=("point", "slope", "hip_torque"), along=along,
        )  # fmt: skip

    whole, ticks, count = walked(LONGEST_STRIDE).records, walked(0.3), 1
    while ticks.outcomes[0] == Outcome.RUNNING:
        count += 1
        ticks.records["end"][:, 0] = 0.3 * count
        advance(ticks.system, ticks.bodies, ticks.records, tolerance=1e-14, from_section=False)
    assert count == np.ceil(whole["time"][0, 0] / 0.3)
    np.testing.assert_allclose(results(ticks.records), results(whole), rtol=0.0, atol=1e-8)
