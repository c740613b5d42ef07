"""Potential shaping: a walker that feels another gravity, and what that takes."""

from __future__ import annotations

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from scipy.integrate import simpson

from examples import potential_shaping
from examples.potential_shaping import (
    COMPASS,
    HeldTorques,
    PotentialShaping,
    controlled_symmetry,
    virtual_gravity,
)
from gym_passive_walker import WALKERS, Outcome, find_gait, stride_map
from tests.equations import bodies, oracle

LEGS = {"compass": COMPASS, "E": WALKERS["E"], "F": WALKERS["F"], "D": WALKERS["D"]}
HEAVY = {name: walker for name, walker in LEGS.items() if not walker.massless_legs}


def states(count=20, seed=0):
    """Anything that two straight legs may be doing."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(-0.6, 0.6, (count, 6))
    drawn[:, 2], drawn[:, 5] = drawn[:, 1], drawn[:, 4]
    return drawn


def closed_loop(shaping, slope, state):
    """A stride under the law, by SciPy on equations of motion that this package has no hand in."""
    walker = shaping.walker

    def accelerations(state):
        hip, ankle = shaping.torques(state, slope)
        return oracle.motion(walker, slope, float(hip), float(ankle), locked=True)(state)

    unit = walker.time_unit
    phase = oracle.follow(accelerations, state, 0.0, 10.0 * unit, 0.05 * unit, oracle.LOCKED_EVENTS)
    assert phase.event == Outcome.HEELSTRIKE
    return phase


def after_heelstrike(walker, phase):
    """Where the next stride begins."""
    before = phase.state(phase.times[-1])
    angle = before[1]
    if walker.massless_legs:
        rates, _ = oracle.simplest_heelstrike(walker, -angle, before[3])
        rates = np.append(rates, rates[1])
    else:
        rates = bodies.heelstrike(walker, -angle, before[3:]).rates
    return np.array([angle, -angle, -angle, *rates])


@pytest.mark.parametrize("name", HEAVY)
def test_the_torques_are_the_gradient_of_what_the_potentials_differ_by(name):
    walker, felt, slope = HEAVY[name], 0.05, -0.1
    hip, ankle = controlled_symmetry(walker, felt).torques(states(), slope)

    def gain(angles):
        return bodies.potential_energy(walker, felt, angles) - bodies.potential_energy(
            walker, slope, angles
        )

    step = 1e-5
    for state, by_hip, by_ankle in zip(states(), hip, ankle, strict=True):
        stance, thigh = (
            (gain(state[:3] + step * turn) - gain(state[:3] - step * turn)) / (2.0 * step)
            for turn in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 1.0]))
        )
        # The hip's torque moves the thigh against the stance leg, the ankle's the stance leg alone.
        scale = walker.units.energy
        assert by_hip == pytest.approx(-thigh, abs=1e-9 * scale)
        assert by_ankle == pytest.approx(stance + thigh, abs=1e-9 * scale)


def test_two_pendulums_need_what_their_gravities_differ_by():
    """The simplest walker: a strut turned over, and a foot hung up, each with its own weight."""
    walker, felt, slope = WALKERS["D"], 0.009, -0.03
    hip, ankle = controlled_symmetry(walker, felt).torques(states(), slope)
    stance, thigh = states()[:, 0], states()[:, 1]
    units = walker.units
    expected = np.sin(stance - slope) - np.sin(stance - felt)
    np.testing.assert_allclose(ankle / units.energy, expected, rtol=0.0, atol=1e-15)
    expected = np.sin(thigh - slope) - np.sin(thigh - felt)
    np.testing.assert_allclose(hip / units.torque, expected, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("slope", [-0.1, 0.0, 0.2])
@pytest.mark.parametrize("name", LEGS)
def test_a_gait_of_one_slope_walks_on_any_other(name, slope):
    """Spong and Bullo: to 1e-12, by integration of the closed loop on the other slope."""
    walker, own = LEGS[name], 0.009
    shaping = controlled_symmetry(walker, own)
    assert shaping.passive_twin == (walker, own)
    gait, units = find_gait(walker, own), walker.units
    phase = closed_loop(shaping, slope, gait.state)
    assert phase.times[-1] / units.time == pytest.approx(gait.step_period / units.time, abs=1e-12)
    off = units.to_dimensionless(after_heelstrike(walker, phase) - gait.state)
    assert np.abs(off).max() < 1e-12


@pytest.mark.parametrize("angle", [0.009, 0.03])
@pytest.mark.parametrize("name", LEGS)
def test_a_virtual_slope_carries_a_walker_over_level_ground(name, angle):
    """Asano: as down a slope, in a time shorter by the root of the cosine, at the cost tan."""
    walker = LEGS[name]
    shaping = virtual_gravity(walker, angle)
    gait, units = find_gait(*shaping.passive_twin), walker.units
    downhill = find_gait(walker, angle)
    assert gait.stance_angle == pytest.approx(downhill.stance_angle, rel=1e-12)
    quicker = downhill.step_period * np.sqrt(np.cos(angle))
    assert gait.step_period == pytest.approx(quicker, rel=1e-12)
    phase = closed_loop(shaping, 0.0, gait.state)
    assert phase.times[-1] / units.time == pytest.approx(gait.step_period / units.time, abs=1e-12)
    off = units.to_dimensionless(after_heelstrike(walker, phase) - gait.state)
    assert np.abs(off).max() < 1e-12
    assert shaping.cost(gait, 0.0).net == pytest.approx(np.tan(angle), rel=1e-12)


@pytest.mark.parametrize("slope", [-0.05, 0.0, 0.02])
@pytest.mark.parametrize("name", LEGS)
def test_motors_pay_what_gravity_does_not(name, slope):
    walker, own = LEGS[name], 0.009
    shaping, gait = controlled_symmetry(walker, own), find_gait(walker, own)
    cost = shaping.cost(gait, slope)
    paid = np.sin(own) - np.sin(slope)
    assert cost.net == pytest.approx(paid, rel=1e-12)
    assert cost.absolute >= abs(cost.net)
    # The same from the closed loop's own motion, by another rule.
    phase = closed_loop(shaping, slope, gait.state)
    times = np.linspace(0.0, phase.times[-1], 4001)
    walked = phase.state(times).T
    for power, net, absolute in zip(
        shaping.power(walked, slope),
        (cost.hip, cost.ankle),
        (cost.hip_absolute, cost.ankle_absolute),
        strict=True,
    ):
        scale = walker.total_mass * walker.gravity * gait.step_length
        assert power.shape == times.shape
        assert net == pytest.approx(simpson(power, x=times) / scale, abs=1e-11)
        # Where power changes sign its size has a corner, which a fixed rule rounds off.
        assert absolute == pytest.approx(simpson(abs(power), x=times) / scale, abs=1e-7)


def test_nothing_is_asked_of_motors_where_ground_and_gravity_felt_agree():
    shaping = controlled_symmetry(COMPASS, 0.05)
    hip, ankle = shaping.torques(states(), 0.05)
    np.testing.assert_allclose([hip, ankle], 0.0, atol=1e-13 * COMPASS.units.energy)


def test_the_shorter_the_ticks_the_nearer_the_law():
    walker, own, slope = COMPASS, 0.03, -0.02
    shaping, gait = controlled_symmetry(walker, own), find_gait(walker, own)
    start, errors = tuple(walker.units.to_dimensionless(gait.state)), []
    for tick in (0.02, 0.01, 0.005):
        policy = HeldTorques(shaping, slope=slope, tick=tick, reset_noise_scale=0.0, start=start)
        env = gymnasium.make("PassiveWalker-v0", **policy.scene)
        seen, info = env.reset(seed=0)
        while not info.get("strides"):
            seen, _, terminated, _, info = env.step(policy(seen).astype(np.float32))
            assert not terminated
        errors.append(np.abs(seen[:6] - start).max())
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2.0, rtol=0.2)
    assert errors[-1] < 0.01


def test_shaped_walkers_do_not_mind_a_new_slope_at_each_episode():
    shaping = controlled_symmetry(COMPASS, 0.05)
    policy = HeldTorques(
        shaping, slope=(-0.1, 0.1), tick=0.02, reset_noise_scale=0.01,
        start=tuple(COMPASS.units.to_dimensionless(find_gait(COMPASS, 0.05).state)),
    )  # fmt: skip
    envs = gymnasium.make_vec("PassiveWalker-v0", num_envs=8, **policy.scene)
    seen, _ = envs.reset(seed=3)
    strides = np.zeros(8, int)
    assert np.ptp(seen[:, 7]) > 0.05
    while strides.min() < 10:
        seen, _, terminated, _, infos = envs.step(policy(seen).astype(np.float32))
        assert not terminated.any()
        strides = infos["strides"]


@pytest.mark.parametrize("name", ["compass", "D"])
def test_the_stride_map_of_held_torques_has_the_twin_s_multipliers(name):
    walker, own = LEGS[name], 0.009
    shaping, gait = controlled_symmetry(walker, own), find_gait(LEGS[name], own)
    errors = []
    for tick in (0.02, 0.01):
        held = HeldTorques(shaping, slope=0.0, tick=tick)
        walks = find_gait(stride_map(controller=held), guess=gait.state)
        assert walks.stance_angle == pytest.approx(gait.stance_angle, rel=1e-2)
        errors.append(abs(walks.multipliers[0] - gait.multipliers[0]))
    assert errors[1] < 0.6 * errors[0] < 0.02


def test_walkers_that_cannot_be_shaped_are_refused():
    for name in ("C", "A"):  # knees; round feet
        with pytest.raises(ValueError, match="knees=False and foot_radius=0"):
            controlled_symmetry(WALKERS[name], 0.0)
    with pytest.raises(ValueError, match="on the line of the leg"):
        virtual_gravity(replace(COMPASS, thigh_offset=0.01), 0.01)
    with pytest.raises(ValueError, match="passive twin"):
        controlled_symmetry(WALKERS["E"], 0.01).cost(find_gait("E", 0.02), 0.0)


def test_a_law_may_feel_a_gravity_of_any_strength():
    weak = PotentialShaping(COMPASS, 0.05, 0.5)
    assert weak.passive_twin == (replace(COMPASS, gravity=4.9), 0.05)
    phase = closed_loop(weak, 0.0, find_gait(*weak.passive_twin).state)
    assert phase.times[-1] == pytest.approx(find_gait(*weak.passive_twin).step_period, rel=1e-12)


def test_the_example_prints_its_tables(capsys):
    potential_shaping.main()
    said = capsys.readouterr().out
    assert "            0.0    0.05234         0.05252" in said
    assert "         the law             0.23280                       0.5800" in said
