"""The energy balance of each stride closes: energy is neither created nor lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, stride
from gym_passive_walker.models.equations.hybrid import State
from tests.equations import bodies, oracle, statements
from tests.equations.examples import (
    GAITS,
    LONG_GAITS,
    MASSIVE,
    fitted,
    random_state,
    random_walker,
)


def error(walker, start, found) -> float:
    """Work given less losses and the gain of kinetic energy, over m g l."""
    units, system, body = walker.units, walker.equations(), walker.body
    before, after = (
        system.kinetic_energy(body, State(*units.to_dimensionless(state)))
        for state in (start, found.state)
    )
    given = found.gravity_work + found.spring_work + found.hip_work + found.ankle_work
    taken = found.collision_loss + found.friction_loss - found.push_off_work
    return (given - taken) / units.energy - after + before


def motors(walker, hip: float, ankle: float, push_off: float) -> dict[str, float]:
    """Actuators in the walker's own units; round feet bear no ankle torque."""
    units = walker.units
    return {
        "hip_torque": hip * units.torque,
        "ankle_torque": ankle * units.energy if walker.foot_radius == 0.0 else 0.0,
        "push_off": push_off * units.impulse,
    }


@pytest.mark.parametrize("joints", ["bare", "fitted"])
@pytest.mark.parametrize("shares", [(0, 0, 0), (0.01, 0, 0), (-0.005, 0, 0), (0.003, 0.002, 0.02)])
@pytest.mark.parametrize("gait", GAITS, ids=str)
def test_the_energy_balance_of_a_stride_closes(gait, shares, joints):
    walker = WALKERS[gait.walker]
    walker = walker if joints == "bare" else fitted(walker, 0.005, 0.001, 0.003)
    given, state = motors(walker, *shares), gait.state * [1.0, 1.0, 1.0, 1.02, 1.01, 1.01]
    found = stride(walker, gait.slope, state, tolerance=1e-13, **given)
    assert abs(error(walker, state, found)) < 1e-14
    if found.outcome == Outcome.HEELSTRIKE:
        assert (found.push_off_work > 0.0) == (shares[2] > 0.0)
        assert (found.ankle_work > 0.0) == (given["ankle_torque"] > 0.0)
        assert (found.hip_work != 0.0) == (shares[0] != 0.0 and not walker.massless_legs)


@pytest.mark.parametrize("name", WALKERS)
def test_the_energy_balance_closes_as_well_as_the_motion_is_integrated(name):
    """However hard the motor pushes; to rounding at the finest tolerances."""
    walker, gait, rng = WALKERS[name], LONG_GAITS[name], np.random.default_rng(1)
    for _ in range(20):
        state = gait.state * (1.0 + 0.1 * rng.normal(size=6))
        state[1:3] = -state[0]
        if not walker.knees:
            state[5] = state[4]
        torque = rng.uniform(-0.05, 0.05) * walker.units.torque
        for tolerance in (1e-6, 1e-9, 1e-14):
            found = stride(walker, gait.slope, state, hip_torque=torque, tolerance=tolerance)
            moved = max(map(abs, (found.gravity_work, found.hip_work, found.collision_loss)))
            moved = max(moved, oracle.kinetic_energy(walker, state)) / walker.units.energy
            assert abs(error(walker, state, found)) < (10.0 * tolerance + 1e-14) * moved


def test_the_energy_balance_closes_however_a_walk_ends():
    """For any walker, with springs, friction and all motors; springs stay stretched by a fall."""
    rng, fell = np.random.default_rng(0), 0
    for i in range(120):
        name = ("lab", "lab-straight")[i % 2]
        walker = fitted(random_walker(rng, knees=i % 2 == 0), *rng.uniform(0.0, [0.1, 0.02, 0.02]))
        if i % 3 == 0:
            walker = replace(walker, foot_radius=0.0, foot_angle=0.0)
        state = LONG_GAITS[name].state * (1.0 + rng.normal(size=6) * rng.choice([0.05, 0.3]))
        state[1:3] = -state[0]
        state[5] = state[5] if walker.knees else state[4]
        state[3:] *= WALKERS[name].time_unit / walker.time_unit
        given = motors(walker, *0.02 * rng.normal(size=2), rng.uniform(0.0, 0.1))
        given = given if i % 3 < 2 else {}
        found = stride(walker, rng.uniform(-0.1, 0.2), state, tolerance=1e-13, **given)
        assert abs(error(walker, state, found)) < 1e-11
        assert found.friction_loss > 0.0
        if found.outcome != Outcome.HEELSTRIKE:
            fell += 1
            assert np.isnan(found.step_length) and found.heelstrike_loss == 0.0
    assert 10 < fell < 110


@pytest.mark.parametrize("name", WALKERS)
def test_the_motion_in_the_energy_balance_is_that_of_the_bodies(name):
    walker, rng = WALKERS[name], np.random.default_rng(1)
    states = [random_state(rng, walker, locked=not walker.knees) for _ in range(20)]
    scaled = State(*statements.dimensionless(walker, states).T)
    energies = walker.equations().kinetic_energy(walker.body, scaled)
    expected = [oracle.kinetic_energy(walker, state) for state in states]
    np.testing.assert_allclose(energies * walker.units.energy, expected, rtol=1e-12)


@pytest.mark.parametrize("name", MASSIVE)
def test_gravitys_work_is_the_potential_energy_given_up(name):
    walker, gait = WALKERS[name], LONG_GAITS[name]
    found = stride(walker, gait.slope, gait.state)
    up = bodies.potential_energy(walker, gait.slope, -found.state[:3])
    down = bodies.potential_energy(walker, gait.slope, gait.state[:3])
    scale = found.weight * walker.leg_length
    assert found.gravity_work == pytest.approx(down - up, rel=0.0, abs=1e-14 * scale)


@pytest.mark.parametrize("name", MASSIVE)
@pytest.mark.parametrize("torque", [0.01, -0.002, 0.04])
def test_hip_work_is_what_an_independent_integration_says(name, torque):
    walker, gait = WALKERS[name], LONG_GAITS[name]
    torque *= walker.units.torque
    walk = oracle.walk(walker, gait.slope, gait.state, torque=torque)
    found = stride(walker, gait.slope, gait.state, hip_torque=torque)
    ends = [oracle.opening(phase.state(t)) for phase in walk.phases for t in phase.times[[0, -1]]]
    net = sum(ends[1::2]) - sum(ends[::2])
    scale = abs(torque)
    assert found.hip_work == pytest.approx(torque * net, rel=0.0, abs=1e-9 * scale)
    assert found.hip_work_absolute == pytest.approx(
        abs(torque) * oracle.absolute_hip_travel(walk), rel=1e-9
    )


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
@pytest.mark.parametrize("name", MASSIVE)
def test_absolute_hip_work_does_not_need_a_fine_integration(name, tolerance):
    """Steps end where the hip reverses, so long steps contain no reversal."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    torque = 0.01 * walker.units.torque
    coarse = stride(walker, gait.slope, gait.state, hip_torque=torque, tolerance=tolerance)
    fine = stride(walker, gait.slope, gait.state, hip_torque=torque, tolerance=1e-13)
    assert coarse.hip_work_absolute == pytest.approx(fine.hip_work_absolute, rel=10.0 * tolerance)


@pytest.mark.parametrize("share", [0.01, -0.01])
@pytest.mark.parametrize("name", MASSIVE)
def test_absolute_hip_work_is_positive_and_negative_work_added(name, share):
    walker, gait = WALKERS[name], LONG_GAITS[name]
    found = stride(walker, gait.slope, gait.state, hip_torque=share * walker.units.torque)
    positive, absolute = found.hip_work_positive, found.hip_work_absolute
    negative = absolute - positive
    assert absolute > 0.0
    assert min(positive, negative) >= -1e-12 * absolute
    assert positive - negative == pytest.approx(found.hip_work, rel=0.0, abs=1e-12 * absolute)


def test_a_torque_that_drives_late_and_brakes_early_does_both():
    """The swing leg starts backwards, relative to the stance leg, in walkers with heavy shanks."""
    gait = LONG_GAITS["lab"]
    torque = 0.01 * WALKERS["lab"].units.torque
    found = stride("lab", gait.slope, gait.state, hip_torque=torque)
    assert 0.02 < found.hip_work_positive / found.hip_work_absolute < 0.98


@pytest.mark.parametrize("name", MASSIVE)
def test_reversing_the_torque_of_a_short_push_reverses_its_work(name):
    """To first order: the same motion with a tiny positive or negative work."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    push = 1e-9 * walker.units.torque
    driven = stride(walker, gait.slope, gait.state, hip_torque=push)
    braked = stride(walker, gait.slope, gait.state, hip_torque=-push)
    assert driven.hip_work == pytest.approx(-braked.hip_work, rel=1e-6)
    assert driven.hip_work_absolute == pytest.approx(braked.hip_work_absolute, rel=1e-6)


@pytest.mark.parametrize("name", WALKERS)
def test_no_motor_no_work(name):
    gait = LONG_GAITS[name]
    found = stride(name, gait.slope, gait.state)
    assert found.hip_work == found.hip_work_absolute == found.hip_work_positive == 0.0


def test_the_torque_on_feet_without_mass_costs_nothing():
    gait = LONG_GAITS["D"]
    driven = stride("D", gait.slope, gait.state, hip_torque=0.5)
    passive = stride("D", gait.slope, gait.state)
    assert driven.outcome == Outcome.HEELSTRIKE
    assert driven.hip_work == driven.hip_work_absolute == 0.0
    assert driven.state[0] != pytest.approx(passive.state[0], rel=1e-3)


def test_the_knee_costs_only_those_who_have_one():
    for name, gait in LONG_GAITS.items():
        found = stride(name, gait.slope, gait.state)
        assert (found.kneestrike_loss > 0.0) == WALKERS[name].knees
        assert np.isfinite(found.kneestrike_time) == WALKERS[name].knees
        assert found.collision_loss == found.kneestrike_loss + found.heelstrike_loss


@pytest.mark.parametrize("name", WALKERS)
def test_weight_is_mass_times_gravity(name):
    gait, walker = LONG_GAITS[name], WALKERS[name]
    found = stride(name, gait.slope, gait.state)
    assert found.weight == pytest.approx(walker.total_mass * walker.gravity, rel=1e-15)
