"""Collisions conserve angular momenta, lose energy, and agree with an impulse solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gym_passive_walker import WALKERS, tune
from tests.equations import bodies, oracle, statements
from tests.equations.bodies import SHANK, STANCE_SHANK, STANCE_THIGH, THIGH
from tests.equations.examples import KNEED, MASSIVE, STRAIGHT, random_walker

RATE = st.floats(-3.0, 3.0)
ALL = range(5)


def examples(rng: np.random.Generator, name: str):
    """The named walker often, and random ones of its kind."""
    for _ in range(50):
        yield WALKERS[name]
    for _ in range(50):
        yield random_walker(rng, knees=WALKERS[name].knees)


def random_rates(rng: np.random.Generator, walker) -> np.ndarray:
    """Rates of stance leg, thigh and shank."""
    return rng.normal(size=3) / walker.time_unit


@pytest.mark.parametrize("name", KNEED)
def test_kneestrike_is_an_impulse_at_the_stop_and_the_foot(name):
    rng = np.random.default_rng(1)
    for walker in examples(rng, name):
        stance, swing = rng.uniform(-1.0, 1.0, 2)
        rates = random_rates(rng, walker)
        expected = bodies.kneestrike(walker, stance, swing, rates)
        found, loss = statements.kneestrike(walker, stance, swing, rates)
        np.testing.assert_allclose(found, expected.rates, rtol=0, atol=1e-12 * max(abs(rates)))
        assert loss == pytest.approx(expected.loss, rel=1e-12)


@pytest.mark.parametrize("name", MASSIVE)
def test_heelstrike_is_an_impulse_at_the_new_foot_alone(name):
    rng = np.random.default_rng(2)
    for walker in examples(rng, name):
        stance = rng.uniform(-1.0, 0.0)
        rates = random_rates(rng, walker)[[0, 1, 1]]
        expected = bodies.heelstrike(walker, stance, rates)
        found, loss = statements.heelstrike(walker, stance, rates)
        np.testing.assert_allclose(found, expected.rates, rtol=0, atol=1e-12 * max(abs(rates)))
        assert loss == pytest.approx(expected.loss, rel=1e-12)


def test_the_simplest_heelstrike_leaves_the_hip_its_velocity_across_the_new_leg():
    rng = np.random.default_rng(3)
    walker = replace(WALKERS["D"], hip_mass=3.0, thigh_length=0.7)
    for _ in range(50):
        stance, (rate, swing_rate, _) = rng.uniform(-0.7, 0.0), rng.normal(size=3)
        expected, expected_loss = oracle.simplest_heelstrike(walker, stance, rate)
        found, loss = statements.heelstrike(walker, stance, [rate, swing_rate, swing_rate])
        np.testing.assert_allclose(found[:2], expected, rtol=0.0, atol=1e-14 * abs(rate))
        assert loss == pytest.approx(expected_loss, rel=1e-12)


def test_the_simplest_heelstrike_is_the_limit_of_vanishing_feet():
    rates = [-1.0, -0.4, -0.4]
    limit, lost = statements.heelstrike(WALKERS["D"], -0.2, rates)
    for mass in (1e-4, 1e-6, 1e-8):
        feet = replace(WALKERS["D"], shank_mass=mass, shank_com=0.5)
        found, loss = statements.heelstrike(feet, -0.2, rates)
        np.testing.assert_allclose(found, limit, rtol=0.0, atol=20.0 * mass)
        assert loss == pytest.approx(lost, rel=100.0 * mass)


@pytest.mark.parametrize("name", MASSIVE)
@given(stance=st.floats(-1.0, 0.0), rates=st.tuples(RATE, RATE))
def test_heelstrike_conserves_angular_momentum_about_the_new_contact_and_the_hip(
    name, stance, rates
):
    walker = WALKERS[name]
    rates = np.array(rates)[[0, 1, 1]]
    after_rates, _ = statements.heelstrike(walker, stance, rates)
    old = bodies.Bodies(walker, (stance, -stance, -stance))
    new = bodies.Bodies(walker, (-stance, stance, stance))
    before, after = old.velocities(rates), new.velocities(after_rates)
    scale = walker.total_mass * walker.leg_length**2 * (1e-300 + np.abs(rates).max())
    under = 1j * walker.foot_radius

    def same(old_members, old_point, new_members, new_point):
        assert new.angular_momentum(after, new_point, new_members) == pytest.approx(
            old.angular_momentum(before, old_point, old_members), rel=0.0, abs=1e-14 * scale
        )

    same(ALL, old.legs[1].foot - under, ALL, new.legs[0].foot - under)
    same([STANCE_THIGH, STANCE_SHANK], 0j, [THIGH, SHANK], 0j)
    if walker.knees:
        same([STANCE_SHANK], old.legs[0].knee, [SHANK], new.legs[1].knee)


@pytest.mark.parametrize("name", KNEED)
@given(angles=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), rates=st.tuples(*[RATE] * 3))
def test_kneestrike_conserves_angular_momentum_about_the_contact_and_the_hip(name, angles, rates):
    walker = WALKERS[name]
    after_rates, _ = statements.kneestrike(walker, *angles, rates)
    walking = bodies.Bodies(walker, (angles[0], angles[1], angles[1]))
    before, after = walking.velocities(rates), walking.velocities(after_rates)
    scale = walker.total_mass * walker.leg_length**2 * (1e-300 + np.abs(rates).max())
    contact = walking.legs[0].foot - 1j * walker.foot_radius
    for members, point in [(ALL, contact), ([THIGH, SHANK], 0j)]:
        assert walking.angular_momentum(after, point, members) == pytest.approx(
            walking.angular_momentum(before, point, members), rel=0.0, abs=1e-14 * scale
        )


@pytest.mark.parametrize("name", WALKERS)
@given(stance=st.floats(-1.0, 0.0), rates=st.tuples(RATE, RATE))
def test_heelstrike_loses_the_energy_that_is_missing_and_never_adds_any(name, stance, rates):
    walker = WALKERS[name]
    rates = np.array(rates)[[0, 1, 1]]
    after, loss = statements.heelstrike(walker, stance, rates)
    before = oracle.kinetic_energy(walker, [stance, -stance, -stance, *rates])
    left = oracle.kinetic_energy(walker, [-stance, stance, stance, *after])
    assert loss >= -1e-16 * before
    assert before - left == pytest.approx(loss, rel=0.0, abs=1e-13 * before + 1e-300)


@pytest.mark.parametrize("name", KNEED)
@given(angles=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), rates=st.tuples(*[RATE] * 3))
def test_kneestrike_loses_the_energy_that_is_missing_and_never_adds_any(name, angles, rates):
    walker = WALKERS[name]
    stance, swing = angles
    after, loss = statements.kneestrike(walker, stance, swing, rates)
    before = bodies.kinetic_energy(walker, [stance, swing, swing, *rates])
    left = bodies.kinetic_energy(walker, [stance, swing, swing, *after])
    assert loss >= -1e-16 * before
    assert before - left == pytest.approx(loss, rel=0.0, abs=1e-13 * before + 1e-300)


@pytest.mark.parametrize("name", KNEED)
def test_a_knee_that_closes_gently_costs_nothing(name):
    rates = [-1.0, 0.7, 0.7]
    after, loss = statements.kneestrike(WALKERS[name], 0.1, 0.4, rates)
    np.testing.assert_array_equal(after, rates)
    assert loss == 0.0


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_foot_that_lands_at_rest_costs_nothing(name):
    """Feet together and both legs rotating equally: the new foot is at rest."""
    after, loss = statements.heelstrike(WALKERS[name], 0.0, [-1.0, -1.0, -1.0])
    np.testing.assert_allclose(after, -1.0, rtol=1e-14)
    assert loss == pytest.approx(0.0, abs=1e-28)


@pytest.mark.parametrize("name", STRAIGHT)
def test_the_smallest_step_still_knows_its_cost(name):
    """A foot that lands without sliding costs the square of its step, to all digits."""
    per_square = [
        statements.heelstrike(WALKERS[name], -step, [-1.0] * 3)[1] / step**2
        for step in (1e-6, 1e-12)
    ]
    assert per_square[1] == pytest.approx(per_square[0], rel=1e-5)


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_tuned_walker_that_lands_without_sliding_loses_as_if_all_its_mass_fell(name):
    """The matrix M(0) of equation 4.9 is diagonal, and one entry is the total mass (4.6.3)."""
    walker, step, rate = tune(WALKERS[name]), 1e-7, -0.7
    hip = abs(bodies.Bodies(walker, (0.0, 0.0, 0.0)).legs[0].foot)
    falling = hip * np.sin(step) * 2.0 * rate
    _, loss = statements.heelstrike(walker, -step, [rate] * 3)
    assert loss == pytest.approx(0.5 * walker.total_mass * falling**2, rel=1e-5)


@pytest.mark.parametrize("name", WALKERS)
def test_losses_grow_with_the_square_of_speed(name):
    rates = np.array([-1.0, -0.3, -0.3])
    slow_rates, slow = statements.heelstrike(WALKERS[name], -0.3, rates)
    fast_rates, fast = statements.heelstrike(WALKERS[name], -0.3, 4.0 * rates)
    assert fast == pytest.approx(16.0 * slow, rel=1e-14)
    np.testing.assert_allclose(fast_rates, 4.0 * slow_rates, rtol=1e-14)
