"""An infinitesimal imaginary part carries the exact derivative of the stride map."""

from __future__ import annotations

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.record import new_records

from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import record as R
from tests.physics import statements
from tests.physics.examples import KNEED, LONG_GAITS

TINY = 1e-100
"""An imaginary part whose square vanishes beside 1."""

RESULTS = [*range(6), R.TIME, R.HIP_NET, R.KNEE_TIME, R.KNEE_LOSS, R.HEEL_LOSS]
"""What a stride leaves in a record that depends on where it began."""

STENCIL = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
"""Central differences of order six."""

INPUTS = ["stance", "stance rate", "thigh rate", "shank rate", "slope", "torque"]


def end(name: str, values, constants=None) -> np.ndarray:
    """A stride's results from the six inputs, which are real or complex."""
    walker = WALKERS[name]
    stance, stance_rate, thigh_rate, shank_rate, slope, torque = values
    if not walker.knees:
        shank_rate = thigh_rate
    state = np.array([[stance, -stance, -stance, stance_rate, thigh_rate, shank_rate]])
    records = new_records(state, np.array([slope]), np.array([torque]))
    if constants is None:
        constants = K.constants(walker)
    constants = constants[None].astype(records.dtype)
    advance(K.kind_of(walker), constants, records, tolerance=1e-14)
    assert records[0, R.OUTCOME].real == Outcome.HEELSTRIKE
    return records[0, RESULTS]


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


@pytest.mark.parametrize("varied", range(6), ids=INPUTS)
@pytest.mark.parametrize("name", WALKERS)
def test_the_derivative_is_that_of_the_map(name, varied):
    values = start(name)
    carried = values.astype(complex)
    carried[varied] += 1j * TINY
    found = end(name, carried).imag / TINY

    def results(value):
        return end(name, np.where(np.arange(6) == varied, value, values))

    expected = differences(results, values[varied], 2e-4)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
    if varied != 3 or name in KNEED:
        assert np.abs(found).max() > 1e-3


@pytest.mark.parametrize("name", WALKERS)
def test_the_real_part_is_the_stride_itself(name):
    values = start(name)
    carried = values + 1j * TINY * np.arange(1.0, 7.0)
    np.testing.assert_allclose(end(name, carried).real, end(name, values), rtol=0.0, atol=2e-14)


@pytest.mark.parametrize("name", WALKERS)
def test_derivatives_do_not_depend_on_how_small_the_imaginary_part_is(name):
    values = start(name)
    direction = np.array([0.3, -1.0, 0.5, 0.7, 0.2, 0.1])
    small, smaller = (
        end(name, values + 1j * tiny * direction).imag / tiny for tiny in (1e-30, 1e-150)
    )
    np.testing.assert_allclose(small, smaller, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("name", WALKERS)
def test_derivatives_along_two_directions_add(name):
    values, directions = start(name), np.eye(6)
    each = [end(name, values + 1j * TINY * one).imag / TINY for one in directions]
    weights = np.array([0.3, -1.0, 0.5, 0.7, 0.2, 0.1])
    both = end(name, values + 1j * TINY * weights).imag / TINY
    expected = weights @ np.array(each)
    np.testing.assert_allclose(both, expected, rtol=0.0, atol=1e-12 * np.abs(each).max())


@pytest.mark.parametrize("parameter", ["shank_com", "thigh_offset", "foot_radius", "foot_angle"])
@pytest.mark.parametrize("name", ["lab", "A", "E"])
def test_the_derivative_by_a_parameter_is_that_of_the_map(name, parameter):
    walker, values = WALKERS[name], start(name)
    if name == "E" and parameter == "foot_radius":
        walker = WALKERS["B"]

    def results(value):
        changed = SimpleNamespace(**{**asdict(walker), parameter: value})
        constants = K.constants_from(changed, knees=walker.knees)
        return end(name, values + 0.0 * value, constants)

    value = getattr(walker, parameter)
    found = results(value + 1j * TINY).imag / TINY
    expected = differences(results, value, 1e-4)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
