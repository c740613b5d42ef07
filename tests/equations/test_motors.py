"""Push-off and ankle torque: their effect on a walker, and their cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import (
    WALKERS,
    Actuation,
    Outcome,
    Walker,
    find_gaits,
    stride,
    stride_jacobian,
    stride_map,
)
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.models.equations.systems import EXTRAS
from gym_passive_walker.models.model import bodies
from tests.equations.examples import GAITS, LONG_GAITS, MASSIVE, fitted, random_walker


def missing(walker: Walker, start, walk) -> float:
    """Error of a stride's energy balance, over m g l."""
    units, system, body = walker.units, walker.equations(), walker.body

    def kinetic(state):
        return system.kinetic_energy(body, State(*units.to_dimensionless(state)))

    given = walk.gravity_work + walk.spring_work + walk.hip_work + walk.ankle_work
    taken = walk.collision_loss + walk.friction_loss - walk.push_off_work
    return (given - taken) / units.energy - kinetic(walk.state) + kinetic(start)


def everything(walker: Walker) -> dict[str, float]:
    """All actuators at once, as far as the walker has them."""
    units = walker.units
    return {
        "hip_torque": 0.003 * units.torque,
        "ankle_torque": 0.002 * units.energy if walker.foot_radius == 0.0 else 0.0,
        "push_off": 0.02 * units.impulse,
    }


@pytest.mark.parametrize("joints", ["bare", "fitted"])
@pytest.mark.parametrize("name", WALKERS)
def test_the_energy_balance_closes_with_all_motors_on(name, joints):
    gait, walker = LONG_GAITS[name], WALKERS[name]
    walker = walker if joints == "bare" else fitted(walker, 0.005, 0.001, 0.003)
    walk = stride(walker, gait.slope, gait.state, tolerance=1e-13, **everything(walker))
    assert walk.outcome == Outcome.HEELSTRIKE
    assert walk.push_off_work > 0.0
    assert (walk.ankle_work > 0.0) == (walker.foot_radius == 0.0)
    assert (walk.hip_work > 0.0) == (not walker.massless_legs)
    assert abs(missing(walker, gait.state, walk)) < 1e-14


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


@pytest.mark.parametrize("wrt", Actuation._fields)
@pytest.mark.parametrize("name", ["lab", "A", "D", "E"])
def test_the_derivative_by_a_motor_is_that_of_the_map(name, wrt):
    gait, walker = LONG_GAITS[name], fitted(WALKERS[name], 0.005, 0.001, 0.003)
    if wrt == "ankle_torque" and walker.foot_radius:
        return
    motors = everything(walker)
    by = stride_jacobian(walker, gait.slope, gait.state, wrt=wrt, **motors)[:, 0]
    step = 1e-3 * motors[wrt]
    ends = [
        stride(walker, gait.slope, gait.state, tolerance=1e-14, **motors | {wrt: motors[wrt] + s})
        for s in (step, -step)
    ]
    kept = [0, 3, 4, 5] if walker.knees else [0, 3, 4]
    difference = (ends[0].state - ends[1].state)[kept] / (2.0 * step)
    np.testing.assert_allclose(by, difference, rtol=0.0, atol=1e-6 * np.abs(by).max())


@pytest.mark.parametrize("parameter", ["thigh_length", "gravity", "hip_mass"])
def test_a_motor_keeps_its_strength_as_the_walker_changes(parameter):
    """Derivatives by a parameter hold torques and impulses constant in the walker's own units."""
    gait, walker = LONG_GAITS["E"], replace(WALKERS["E"], hip_mass=0.1)
    motors = everything(walker)
    by = stride_jacobian(walker, gait.slope, gait.state, wrt=parameter, **motors)[:, 0]
    value = getattr(walker, parameter)
    step = 1e-4 * value
    ends = [
        stride(replace(walker, **{parameter: value + s}), gait.slope, gait.state, tolerance=1e-14,
               **motors)
        for s in (step, -step)
    ]  # fmt: skip
    difference = (ends[0].state - ends[1].state)[[0, 3, 4]] / (2.0 * step)
    np.testing.assert_allclose(by, difference, rtol=0.0, atol=1e-6 * np.abs(by).max())


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


def test_the_energy_balance_closes_for_any_walker_with_all_motors_on():
    rng = np.random.default_rng(1)
    for i in range(40):
        walker = fitted(random_walker(rng, knees=i % 2 == 0), *rng.uniform(0.0, [0.05, 0.01, 0.02]))
        walker = replace(walker, foot_radius=0.0, foot_angle=0.0)
        angle, units = rng.uniform(0.1, 0.4), walker.units
        state = np.array([angle, -angle, -angle, *-rng.uniform(0.5, 2.0, 3)])
        state[5] = state[4] - rng.uniform(0.0, 1.0) * walker.knees
        state[3:] /= units.time
        walk = stride(
            walker, rng.uniform(-0.1, 0.2), state, tolerance=1e-13,
            hip_torque=rng.normal() * 0.05 * units.torque,
            ankle_torque=rng.normal() * 0.05 * units.energy,
            push_off=rng.uniform(0.0, 0.3) * units.impulse,
        )  # fmt: skip
        assert abs(missing(walker, state, walk)) < 1e-11
