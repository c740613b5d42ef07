"""The stride map's derivative is exact: by the state, the slope, the torque and every parameter."""

from dataclasses import asdict, replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker import (
    WALKERS,
    Actuation,
    GaitNotFound,
    find_gait,
    lab_walker_from_parts,
    reality_check,
    simulate,
    stride,
    stride_jacobian,
    stride_map,
)
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.models.equations.systems import FITTINGS
from tests.equations.examples import LONG_GAITS, fitted

STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Central differences of order eight."""

WALKED = {**WALKERS, "lab from its parts": lab_walker_from_parts()}


def start(name):
    """A slope and a state beside the long-step gait."""
    gait = LONG_GAITS[name if name in LONG_GAITS else "lab"]
    return gait.slope, gait.state * np.array([1.01, 1.01, 1.01, 1.02, 0.99, 1.0])


def coordinates(states, walker):
    """The section's coordinates of states."""
    return states[..., [0, 3, 4, 5] if walker.knees else [0, 3, 4]]


def state_of(point, walker):
    """The state (6,) at coordinates."""
    angle, rates = point[0], point[1:]
    return np.array([angle, -angle, -angle, *rates, *([] if walker.knees else rates[-1:])])


def next_point(walker, slope, point, torque=0.0, **motors):
    state = state_of(point, walker)
    end = stride(walker, slope, state, hip_torque=torque, **motors, tolerance=1e-14)
    return coordinates(end.state, walker)


def differences(function, at, step):
    return sum(
        weight * (function(at + k * step) - function(at - k * step))
        for k, weight in STENCIL.items()
    ) / step  # fmt: skip


def agree(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", WALKED)
def test_the_derivative_by_the_state_is_that_of_the_map(name):
    walker, (slope, state) = WALKED[name], start(name)
    point = coordinates(state, walker)
    found = stride_jacobian(walker, slope, state)
    unit = np.eye(len(point))
    expected = [
        differences(lambda x, i=i: next_point(walker, slope, point + x * unit[i]), 0.0, 2e-4)
        for i in range(len(point))
    ]
    agree(found, np.array(expected).T)


@pytest.mark.parametrize("name", WALKED)
def test_the_derivative_by_slope_and_torque_is_that_of_the_map(name):
    walker, (slope, state) = WALKED[name], start(name)
    point = coordinates(state, walker)
    torque = 0.01 * walker.gravity * (1.0 if walker.massless_legs else walker.total_mass)
    found = stride_jacobian(walker, slope, state, hip_torque=torque, wrt=["slope", "hip_torque"])
    by_slope = differences(lambda x: next_point(walker, x, point, torque), slope, 2e-4)
    by_torque = differences(lambda x: next_point(walker, slope, point, x), torque, 0.02 * torque)
    agree(found[:, 0], by_slope)
    agree(found[:, 1], by_torque)


PARAMETERS = [
    (name, parameter)
    for name in ("lab", "lab-straight", "E")
    for parameter in asdict(WALKERS[name])
    if parameter != "knees"
    # A radius of gyration at zero has no left-hand side.
    and not (name == "E" and parameter.endswith(("gyration", "foot_radius")))
]


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS)
def test_the_derivative_by_a_parameter_is_that_of_the_map(name, parameter):
    walker, (slope, state) = WALKERS[name], start(name)
    if parameter == "hip_mass":
        walker = replace(walker, hip_mass=0.1 * walker.total_mass)
    if parameter in FITTINGS:
        walker = replace(walker, **{parameter: 0.02 * walker.total_mass})
    point, value = coordinates(state, walker), getattr(walker, parameter)
    found = stride_jacobian(walker, slope, state, wrt=parameter)[:, 0]
    step = 3e-4 * max(abs(value), 0.3 * walker.leg_length)
    expected = differences(
        lambda x: next_point(replace(walker, **{parameter: x}), slope, point), value, step
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * max(1.0, np.abs(found).max()))


SPRUNG = fitted(WALKERS["lab"], 0.005, 0.001, 0.003)
MOTORS = {"hip_torque": 0.004, "ankle_torque": 0.003, "push_off": 0.03}


DRIVEN = [
    (name, parameter)
    for name, mass in (("E", "thigh_mass"), ("D", "hip_mass"), ("lab sprung", "shank_mass"))
    for parameter in (*MOTORS, "thigh_length", "shank_length", mass, "gravity")
    if (name, parameter) != ("lab sprung", "ankle_torque")
]


@pytest.mark.parametrize(("name", "parameter"), DRIVEN)
def test_under_motors_a_parameter_changes_their_units_as_well(name, parameter):
    """What motors do is held in the walker's own units as its size, its mass or gravity changes."""
    walker, (slope, state) = SPRUNG if name == "lab sprung" else WALKERS[name], start(name)
    units = walker.units
    scale = {"hip_torque": units.torque, "ankle_torque": units.energy, "push_off": units.impulse}
    held = {motor: share * scale[motor] for motor, share in MOTORS.items()}
    if walker.foot_radius:
        held["ankle_torque"] = 0.0
    point = coordinates(state, walker)
    found = stride_jacobian(walker, slope, state, wrt=parameter, **held)[:, 0]

    def moved(x):
        changed = {} if parameter in held else {parameter: x}
        motors = {name: x if name == parameter else value for name, value in held.items()}
        torque = motors.pop("hip_torque")
        return next_point(replace(walker, **changed), slope, point, torque, **motors)

    value = held.get(parameter, getattr(walker, parameter, 0.0))
    expected = differences(moved, value, 3e-3 * value)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-9 * max(1.0, np.abs(found).max()))


def test_under_motors_on_steps_a_parameter_changes_their_units_too():
    """On ground that is level but for rounding, derivatives are those on level ground."""
    driven = gpw.Actuation(push_off=0.05)
    level, steps = (
        gpw.stride_map("E", 0.009, controller=driven, terrain=terrain)
        for terrain in (None, gpw.stairs(1e-9))
    )
    state = gpw.find_gait(level).state
    by = [gpw.stride_jacobian(each, state=state, wrt="gravity") for each in (level, steps)]
    np.testing.assert_allclose(by[1], by[0], atol=1e-6)
    assert np.abs(by[0]).max() > 0.1


@pytest.mark.parametrize("name", ["C", "lab", "lab from its parts"])
def test_a_kneed_walker_forgets_one_number_at_kneestrike(name):
    for slope in (0.03, 0.045):
        assert abs(find_gait(WALKED[name], slope).multipliers[-1]) < 1e-12


def test_the_simplest_walker_forgets_its_swing_rate_at_heelstrike():
    jacobian = stride_jacobian("D", *start("D"))
    assert abs(np.linalg.det(jacobian)) < 1e-13


def test_multipliers_are_the_eigenvalues_of_the_derivative_in_any_coordinates():
    gait = find_gait("lab", 0.036)
    eigenvalues = np.linalg.eigvals(stride_jacobian("lab", 0.036, gait.state))
    eigenvalues = eigenvalues[np.argsort(-np.abs(eigenvalues))]
    np.testing.assert_allclose(np.abs(gait.multipliers), np.abs(eigenvalues), atol=1e-11)


def test_columns_come_in_the_order_asked_for():
    slope, state = start("E")
    both = stride_jacobian("E", slope, state, wrt=["gravity", "state", "slope"])
    assert both.shape == (3, 5)
    np.testing.assert_array_equal(both[:, 1:4], stride_jacobian("E", slope, state))


def test_an_unknown_parameter_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"wrt: the stride map has no weight.*foot_radius"):
        stride_jacobian("E", *start("E"), wrt="weight")


def test_a_walker_has_no_derivative_by_what_it_cannot_have():
    with pytest.raises(ValueError, match="by shank_mass, as legs without mass have equations"):
        stride_jacobian("D", 0.009, wrt=("state", "shank_mass"))
    assert stride_jacobian("D", 0.009, wrt="foot_radius").shape == (3, 1)
    with pytest.raises(ValueError, match="by thigh_mass"):
        find_gait("D", 0.009).stride_map.linearize(np.zeros((1, 3)), 0.009, by=("thigh_mass",))
    with pytest.raises(ValueError, match="by ankle_torque: a round foot rolls"):
        stride_jacobian("lab", 0.036, wrt="ankle_torque")


def test_a_fall_has_no_derivative():
    with pytest.raises(NoStride, match="FELL_BACKWARD"):
        stride_jacobian("E", 0.01, [0.3, -0.3, -0.3, -0.1, -0.1, -0.1])


@pytest.mark.parametrize("name", ["lab", "E", "D"])
def test_many_states_have_the_derivatives_that_each_has_alone(name):
    slope, state = start(name)
    states = state * np.linspace(0.99, 1.01, 7)[:, None]
    wrt = ["state", "slope", "gravity"]
    together = stride_jacobian(name, slope, states, wrt=wrt)
    alone = [stride_jacobian(name, slope, each, wrt=wrt) for each in states]
    np.testing.assert_array_equal(together, alone)


def test_one_fall_among_many_states_is_named():
    states = [start("E")[1], [0.3, -0.3, -0.3, -0.1, -0.1, -0.1]]
    with pytest.raises(NoStride, match=r"from state 1 .* FELL_BACKWARD"):
        stride_jacobian("E", start("E")[0], states)


@pytest.mark.parametrize("push_off", [None, 0.02])
def test_without_a_state_analyses_of_a_walk_begin_at_the_gait(push_off):
    held = Actuation(push_off=push_off or 0.0)
    strides = stride_map("lab", 0.036, controller=held)
    gait = find_gait(strides)
    for given, driven in (((strides,), {}), (("lab", 0.036), {"push_off": push_off})):
        found = stride_jacobian(*given, **driven)
        np.testing.assert_allclose(found, stride_jacobian(gait), rtol=1e-6, atol=1e-9)
        walk = simulate(*given, **driven, strides=2)
        np.testing.assert_allclose(walk.states[0], gait.state, rtol=1e-9)
    assert reality_check(strides).least_normal_force == reality_check(gait).least_normal_force
    with pytest.raises(GaitNotFound):
        simulate("lab", -0.1)
