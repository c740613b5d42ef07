"""Derivatives of a walker that are integrated with it are those of the stride map."""

from __future__ import annotations

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, stride_jacobian
from gym_passive_walker.engine.run import Seeds, advance, new_records
from gym_passive_walker.gaits.actuation import Actuation
from gym_passive_walker.gaits.control.ticks import ticked_stride
from gym_passive_walker.gaits.stride_map import StrideMap
from gym_passive_walker.models.equations.bodies import body_from
from gym_passive_walker.models.equations.systems import body_of, system_of
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


def end(name: str, values, directions=(), body=None, body_changes=None) -> np.ndarray:
    """A stride's results from the six inputs, and behind them their derivatives, (1 + k, results).

    Args:
        name: Name of the walker.
        values: The inputs.
        directions: Directions in them, (k, 6).
        body: The walker's constants; its own when None.
        body_changes: Directions in these, (k, constants).
    """
    walker, system = WALKERS[name], system_of(WALKERS[name])

    def states(inputs):
        stance, stance_rate, thigh_rate, shank_rate = np.asarray(inputs, dtype=float)[..., :4].T
        shank_rate = shank_rate if walker.knees else thigh_rate
        return np.stack([stance, -stance, -stance, stance_rate, thigh_rate, shank_rate], axis=-1)

    directions = np.asarray(directions, dtype=float).reshape(-1, 6)
    seeds = Seeds(
        states=states(directions)[None],
        slopes=directions[None, :, 4],
        controls=directions[None, :, 5:],
    )
    records = new_records(
        states(values)[None], values[4], values[5], seeds=seeds, tangents=len(directions)
    )
    rows = [body_of(walker) if body is None else body]
    if body_changes is not None:
        rows += list(body_changes)
    bodies = np.array(rows, dtype=float)[None]
    advance(system, bodies, records, tolerance=1e-14)
    assert records["outcome"][0, 0] == Outcome.HEELSTRIKE
    return results(records[0])


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
    found = end(name, values, np.eye(6))[1:]
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
    carried = end(name, values, np.diag(np.arange(1.0, 7.0)))[0]
    np.testing.assert_allclose(carried, end(name, values)[0], rtol=0.0, atol=2e-14)


@pytest.mark.parametrize("name", WALKERS)
def test_derivatives_are_in_proportion_to_the_change(name):
    values, direction = start(name), np.array([[0.3, -1.0, 0.5, 0.7, 0.2, 0.1]])
    _, whole = end(name, values, direction)
    for share in (2.0**-400, 2.0**300):
        _, part = end(name, values, share * direction)
        np.testing.assert_array_equal(part, share * whole)


@pytest.mark.parametrize("name", WALKERS)
def test_derivatives_along_two_directions_add(name):
    values, weights = start(name), np.array([0.3, -1.0, 0.5, 0.7, 0.2, 0.1])
    each = end(name, values, np.eye(6))[1:]
    _, both = end(name, values, weights[None])
    np.testing.assert_allclose(both, weights @ each, rtol=0.0, atol=1e-12 * np.abs(each).max())


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_a_derivative_does_not_depend_on_how_many_ride_along(name):
    rng, values = np.random.default_rng(1), start(name)
    directions = rng.normal(size=(23, 6))
    all_of_them = end(name, values, directions)
    for count in (1, 5, 7):
        some = end(name, values, directions[:count])
        np.testing.assert_array_equal(some, all_of_them[: count + 1])
    np.testing.assert_array_equal(end(name, values, directions[20:])[1:], all_of_them[21:])


@pytest.mark.parametrize("parameter", ["shank_com", "thigh_offset", "foot_radius", "foot_angle"])
@pytest.mark.parametrize("name", ["lab", "A", "E"])
def test_the_derivative_by_a_parameter_is_that_of_the_map(name, parameter):
    walker, values = WALKERS[name], start(name)
    if name == "E" and parameter == "foot_radius":
        walker = WALKERS["B"]

    def body(value):
        changed = SimpleNamespace(**{**asdict(walker), parameter: value})
        return body_from(changed, system_of(walker).Body)

    value = getattr(walker, parameter)
    change = np.imag(np.array(body(value + 1e-100j), complex)) / 1e-100
    found = end(name, values, np.zeros((1, 6)), body(value), [change])[1]
    expected = differences(lambda x: end(name, values, body=body(x))[0], value, 1e-4)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


def test_absolute_hip_work_has_its_derivative_where_the_hip_turns_back():
    """The lab walker first closes its legs a little: the total rotation exceeds the opening."""
    values = start("lab")
    found = end("lab", values, np.eye(6))
    assert found[0, TURNED] > 1.02 * abs(found[0, MOVED])
    for varied in range(6):

        def turned(value, varied=varied):
            inputs = np.where(np.arange(6) == varied, value, values)
            return end("lab", inputs)[0, TURNED]

        expected = differences(turned, values[varied], 1e-5)
        assert found[1 + varied, TURNED] == pytest.approx(expected, rel=1e-8, abs=1e-8)
        # It is not what the net work's derivative is, up to its sign.
    net, absolute = found[1:, MOVED], found[1:, TURNED]
    assert np.abs(np.abs(net) - np.abs(absolute)).max() > 1e-2


def test_a_walk_that_is_stopped_follows_the_moment_when_it_is():
    """A later time limit is further along the motion; other ends do not move."""
    walker, gait = WALKERS["lab"], LONG_GAITS["lab"]
    state = statements.dimensionless(walker, gait.state)[None]
    own = np.array(body_of(walker))[None, None]

    def stopped(when):
        seeds = Seeds(ends=np.array([[1.0, 0.0]]))
        records = new_records(state, gait.slope, 0.01, end=when, seeds=seeds, tangents=2)
        advance(system_of(walker), own, records, tolerance=1e-14)
        assert records["outcome"][0, 0] == Outcome.RUNNING
        return results(records[0])[:, :11]

    for when in (0.7, 2.4):
        expected = differences(lambda t: stopped(t)[0], when, 1e-3)
        np.testing.assert_allclose(stopped(when)[1], expected, rtol=0.0, atol=1e-9)
        np.testing.assert_array_equal(stopped(when)[2], 0.0)


def test_a_walk_in_ticks_has_the_derivatives_of_a_walk_at_once():
    walker, gait = WALKERS["lab"], LONG_GAITS["lab"]
    state = statements.dimensionless(walker, gait.state)[None]
    own, system = np.array(body_of(walker))[None, None], system_of(walker)
    seeds = Seeds(
        states=np.array([[[1, -1, -1, 0, 0, 0], [0, 0, 0, 1, 2, 3]]], float),
        slopes=np.array([[0.5, 1.0]]),
        controls=np.array([[[0.1], [0.2]]]),
    )
    whole = new_records(state, gait.slope, 0.01, seeds=seeds, tangents=2)
    ticks = whole.copy()
    advance(system, own, whole, tolerance=1e-14)
    count = 0
    while count == 0 or ticks["outcome"][0, 0] == Outcome.RUNNING:
        ticks["end"][:, 0] = 0.3 * (count + 1)
        advance(system, own, ticks, tolerance=1e-14, from_section=count == 0)
        count += 1
    assert count == np.ceil(whole["time"][0, 0] / 0.3)
    np.testing.assert_allclose(results(ticks), results(whole), rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("name", ["lab", "A", "D"])
def test_values_are_the_same_with_derivatives_and_without(name):
    """The stride map, its Jacobian, and a stride with a torque for each control step."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    strides = StrideMap.of(walker)
    point = strides.points_at(gait.state)
    m, coordinates = strides.dimension, strides.coordinates
    driven = replace(strides, actuation=Actuation(hip_torque=0.003))
    _, change = driven.linearize(point, gait.slope, by=("state", "slope", "hip_torque"))
    found = end(name, start(name), np.eye(6))[1:]
    rows = [0, 1, 2, 3, 4, 5] if name in KNEED else [0, 1, 2, 4, 5]
    expected = found[rows][:, coordinates].T
    np.testing.assert_allclose(change.ends[0], expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(change.durations[0], found[rows, 6], rtol=0.0, atol=1e-9)

    torques = np.full(3, 0.003)
    ticked = ticked_stride(walker, gait.slope, point[0], torques, tick=0.4, tolerance=1e-13)
    np.testing.assert_allclose(ticked.by_point, expected[:, :m], rtol=0.0, atol=1e-9)
    by_torque = ticked.by_torque.sum(axis=1)
    np.testing.assert_allclose(by_torque, expected[:, -1], rtol=0.0, atol=1e-9)

    _, passive = strides.linearize(point, gait.slope)
    units = np.array([1.0, *[walker.time_unit] * (m - 1)])
    jacobian = stride_jacobian(walker, gait.slope, gait.state)
    scaled = np.asarray(jacobian) * units[:, None] / units
    np.testing.assert_allclose(scaled, passive.ends[0], rtol=0.0, atol=1e-8)
