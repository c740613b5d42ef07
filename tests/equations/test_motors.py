"""Push-off and ankle torque: their effect on a walker, and their cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    Actuation,
    find_gaits,
    stride,
    stride_map,
)
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.systems import EXTRAS
from gym_passive_walker.models.model import bodies
from tests.equations.examples import GAITS, LONG_GAITS, MASSIVE


@pytest.mark.parametrize("name", MASSIVE)
def test_a_push_off_obeys_newton_and_the_foot_it_pushes_gets_its_work(name):
    """Momentum of the whole, angular momentum of each leg about the hip, and energy, by hand."""
    body, rng = WALKERS[name].body, np.random.default_rng(0)
    for stance, swing in rng.uniform(-0.6, 0.6, (20, 2)):
        velocity, *rates, gained = legs.push_off(body, stance, swing)
        push = np.array([np.sin(stance), np.cos(stance)])  # (back, up), along the leg
        momentum, energy = np.array(velocity), 0.5 * np.dot(velocity, velocity)
        for angle, rate, arm in zip(
            (stance, swing), rates, (legs.hip(body, stance), None), strict=True
        ):
            moment = np.array(
                legs.turned(body.swing_along, body.swing_across, np.sin(angle), np.cos(angle))
            )
            across = np.array([moment[1], -moment[0]])  # what a unit turn makes of it
            momentum = momentum + rate * across
            turned = body.swing_inertia * rate + np.dot(across, velocity)
            torque = 0.0 if arm is None else push[1] * arm[0] - push[0] * arm[1]
            assert turned == pytest.approx(torque, abs=1e-13)
            energy += 0.5 * body.swing_inertia * rate**2 + rate * np.dot(across, velocity)
        np.testing.assert_allclose(momentum, push, rtol=0.0, atol=1e-13)
        assert energy == pytest.approx(0.5 * gained, rel=1e-12)


def test_feet_of_vanishing_mass_are_pushed_as_the_simplest_walker_is():
    gait = LONG_GAITS["D"]
    simplest = stride("D", gait.slope, gait.state, push_off=0.05 * np.sqrt(9.81), tolerance=1e-13)
    errors = []
    for mass in (1e-4, 1e-5):
        walker = replace(WALKERS["E"], shank_mass=mass, thigh_mass=0.5 - mass)
        push = 0.05 * walker.units.impulse
        walk = stride(walker, gait.slope, gait.state, push_off=push, tolerance=1e-13)
        assert walk.push_off_work == pytest.approx(simplest.push_off_work, rel=20.0 * mass)
        errors.append(np.abs(walk.state - simplest.state).max())
    assert errors[1] < 0.11 * errors[0] < 1e-3


def test_an_ankle_torque_turns_the_stance_leg_alone():
    """A hanging-up pendulum: with the slope and the torque in balance the hip stays where it is."""
    slope, angle = 0.1, 0.3
    torque = np.sin(angle - slope)
    units = WALKERS["D"].units
    state = np.array([angle, -angle, -angle, 0.0, 0.0, 0.0])
    walk = stride("D", slope, state, ankle_torque=torque * units.energy, max_stride_time=1.0)
    assert walk.state[0] == pytest.approx(angle, abs=1e-12)
    assert abs(walk.ankle_work) < 1e-12


@pytest.mark.parametrize("gait", GAITS, ids=str)
def test_motors_at_rest_change_no_bit_of_a_walk(gait):
    walker, ends = WALKERS[gait.walker], []
    for system in (walker.equations(), walker.equations(EXTRAS)):
        records = new_records(walker.units.to_dimensionless(gait.state)[None], gait.slope, 1e-3)
        ends.append(advance(system, bodies(walker), records, tolerance=1e-10)["state"])
    np.testing.assert_array_equal(*ends)


def test_kuo_s_walker_walks_on_level_ground_at_his_speed():
    """Kuo 2002, normal gait: to the digits of his program, and what theory says of its push-off."""
    walker = replace(WALKERS["D"], hip_stiffness=2.5127 * 9.81)
    units = walker.units
    gait = find_gaits(
        stride_map(walker, 0.0, controller=Actuation(push_off=0.1877 * units.impulse))
    )[0]
    assert gait.stance_angle == pytest.approx(0.355460, abs=1e-6)
    assert gait.state[3] * units.time == pytest.approx(-0.505619, abs=1e-6)
    assert gait.speed == pytest.approx(1.2527, abs=5e-5)
    assert 1.0 / gait.step_period == pytest.approx(1.7998, abs=5e-5)
    assert gait.cost_of_transport == pytest.approx(0.025308, abs=5e-7)
    assert gait.stable
    work = gait.stride.push_off_work / (gait.stride.weight * gait.step_length)
    assert work == pytest.approx(gait.cost_of_transport, rel=1e-12)
    # On level ground the hip is as fast before the strike as after the last one.
    speed = -gait.state[3] * units.time
    assert speed * np.tan(gait.stance_angle) == pytest.approx(0.1877, abs=1e-12)


def test_a_push_off_costs_a_quarter_of_what_a_hip_would_at_small_steps():
    """Kuo's law: 1/(4 cos^4 a) of what the strike would lose without it, at equal speed."""
    for push in (0.02, 0.1, 0.2):
        walker = replace(WALKERS["D"], hip_stiffness=2.0 * 9.81)
        units = walker.units
        gait = find_gaits(
            stride_map(walker, 0.0, controller=Actuation(push_off=push * units.impulse))
        )[0]
        angle, speed = gait.stance_angle, -gait.state[3] * units.time
        without = 0.5 * (speed * np.sin(2.0 * angle)) ** 2
        share = gait.stride.push_off_work / units.energy / without
        assert share == pytest.approx(0.25 / np.cos(angle) ** 4, rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"ankle_torque": 0.1}, "ankle_torque needs point feet"),
        ({"push_off": -0.1}, "push_off must not be negative"),
        ({"push_off": [0.1, -0.1]}, "push_off must not be negative"),
        ({"push_off": "much"}, "push_off must be a number"),
        ({"hip_torque": np.nan}, "hip_torque must be a number"),
    ],
)
def test_a_motor_that_cannot_be_is_refused(arguments, sentence):
    gait = LONG_GAITS["C"]
    with pytest.raises(ValueError, match=sentence):
        stride("C", gait.slope, gait.state, **arguments)
    with pytest.raises(ValueError, match=sentence):
        find_gaits(stride_map("C", gait.slope, controller=Actuation(**arguments)))
