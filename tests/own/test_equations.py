"""Systems of given equations: the package's own walkers by public means, and contradictions."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.models.equations import hybrid, kneed, simplest, straight
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.equations.systems import SYSTEMS
from gym_passive_walker.models.math import cos, sin

KINDS = {"kneed": ("lab", 0.036), "straight": ("A", 0.01), "simplest": ("D", 0.009)}


def hip(body, state):
    """Position of the hip; its height over a foot is that of the centre of mass within a shift."""
    return -body.leg * sin(state.stance) - body.foot_radius * state.stance, (
        body.foot_radius + body.leg * cos(state.stance)
    )


def stated(kind, **rest):
    """A kind of walker of the package as a system of a user's own."""
    walker = gpw.WALKERS[KINDS[kind][0]]
    return gpw.System.of(SYSTEMS[kind], walker.body, centre=hip, **rest)


def dimensionless(kind, states):
    unit = gpw.WALKERS[KINDS[kind][0]].time_unit
    return np.asarray(states) * np.array([1.0, 1.0, 1.0, unit, unit, unit])


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_of_the_package_is_a_statement_like_any_other(kind):
    """By public means alone its strides have the same bits, near the gait and far from it."""
    name, slope = KINDS[kind]
    walker, gait = gpw.WALKERS[name], gpw.find_gait(name, slope)
    rng = np.random.default_rng(2)
    starts = gait.state * (1.0 + 0.5 * rng.uniform(-1.0, 1.0, (64, 6)))
    if not walker.knees:
        starts[:, 2], starts[:, 5] = starts[:, 1], starts[:, 4]
    states = dimensionless(kind, starts)
    alone = gpw.WALKERS[name] if walker.time_unit == 1.0 else replace_gravity(walker)
    found = gpw.stride(stated(kind), slope, states)
    expected = gpw.stride(alone, slope, states)
    assert len(set(found.outcome)) > 1
    np.testing.assert_array_equal(found.outcome, expected.outcome)
    np.testing.assert_array_equal(found.state, expected.state)
    np.testing.assert_array_equal(found.duration, expected.duration)


def replace_gravity(walker):
    """The walker with a gravity that makes its unit of time 1."""
    return replace(walker, gravity=walker.leg_length)


@pytest.mark.parametrize("kind", KINDS)
def test_its_gaits_and_multipliers_are_the_package_s(kind):
    name, slope = KINDS[kind]
    gait = gpw.find_gait(name, slope)
    system = stated(kind, start=dimensionless(kind, gait.state))
    found = gpw.find_gait(system, slope)
    np.testing.assert_allclose(found.state, dimensionless(kind, gait.state), atol=1e-9)
    largest = np.abs(gait.multipliers[0])
    assert np.abs(found.multipliers[0]) == pytest.approx(largest, rel=1e-7)
    assert found.cost_of_transport == pytest.approx(math.sin(slope), rel=1e-9)


def test_a_walker_with_knees_is_an_environment_by_the_same_means():
    """Its knee locks within a stride, so a system may have several phases."""
    gait = gpw.find_gait("lab", 0.036)
    start = dimensionless("kneed", gait.state)
    system = stated("kneed", start=start)
    env = gym.make("PassiveWalker-v0", system=system, slope=0.036, actions=("hip",)).unwrapped
    own = gym.make("PassiveWalker-v0", scene="lab").unwrapped
    env.reset(seed=0, options={"state": start, "slope": 0.036})
    own.reset(seed=0, options={"state": gait.state, "slope": 0.036})
    for _ in range(60):
        found, expected = env.step(np.zeros(1)), own.step(np.zeros(1))
        np.testing.assert_allclose(found[0][:6], expected[0][:6], rtol=1e-5, atol=1e-6)
        assert found[2:4] == expected[2:4] == (False, False)
    assert found[4]["strides"] == expected[4]["strides"] >= 2


def changed(kind, phase=-1, **parts):
    """The equations of a kind with other functions."""
    equations = SYSTEMS[kind]
    phases = list(equations.phases)
    of_phase = {name: parts.pop(name) for name in list(parts) if name in hybrid.Phase._fields}
    phases[phase] = phases[phase]._replace(**of_phase)
    return equations._replace(phases=tuple(phases), **parts)


def heavier(body, state):
    """A mass matrix of twice the inertia."""
    return tuple(2.0 * x for x in straight.mass_matrix(body, state))


def negative(body, state):
    first, *rest = straight.mass_matrix(body, state)
    return -first, *rest


def too_light(body, state, control, ground):
    first, second = straight.accelerations(body, state, control, ground)
    return first, 1.01 * second


def not_a_number(body, state, control, ground):
    return math.nan, 0.0


def one_of_two(body, state, control, ground):
    return straight.accelerations(body, state, control, ground)[:1]


def springs_back(body, before, push_off=0.0, ground=hybrid.SMOOTH):
    """A collision that returns energy."""
    strike = straight.heelstrike(body, before, push_off, ground)
    after = strike.after
    faster = after._replace(stance_rate=9.0 * after.stance_rate)
    return strike._replace(after=faster)


def understates(body, before, push_off=0.0, ground=hybrid.SMOOTH):
    strike = straight.heelstrike(body, before, push_off, ground)
    return strike._replace(lost=0.5 * strike.lost)


def jumps(body, before, push_off=0.0, ground=hybrid.SMOOTH):
    """A collision that moves the new stance leg."""
    strike = straight.heelstrike(body, before, push_off, ground)
    return strike._replace(after=strike.after._replace(stance=strike.after.stance + 0.3))


def level(body, state, ground):
    """A guard that no motion changes."""
    return 1.0 + 0.0 * body.leg


def never():
    guard = SYSTEMS["straight"].phases[0].guards[0]
    return (guard._replace(falls=level), *SYSTEMS["straight"].phases[0].guards[1:])


def resets(strike):
    return {Outcome.HEELSTRIKE: hybrid.Reset(strike)}


WRONG = {
    "a mass matrix of another energy": (
        changed("straight", mass_matrix=heavier), "mass_matrix .* kinetic energy",
    ),
    "negative mass": (changed("straight", mass_matrix=negative), "mass_matrix .* positive"),
    "forces from nowhere": (
        changed("straight", accelerations=too_light), "accelerations of phase LOCKED .* power",
    ),
    "NaN": (changed("straight", accelerations=not_a_number), "accelerations .* finite"),
    "wrong shapes": (changed("straight", accelerations=one_of_two), "accelerations .* 2 numbers"),
    "a guard that never falls": (
        changed("straight", guards=never()), "guard HEELSTRIKE of phase LOCKED .* never falls",
    ),
    "a reset that gains energy": (
        changed("straight", resets=resets(springs_back)), "reset HEELSTRIKE .* gains energy",
    ),
    "a loss that is another": (
        changed("straight", resets=resets(understates)), "reset HEELSTRIKE .* states an energy",
    ),
    "a reset that moves the walker": (
        changed("straight", resets=resets(jumps)), "reset HEELSTRIKE",
    ),
    "no heelstrike": (changed("straight", resets={}), "phases .* end with a heelstrike"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_equations_that_contradict_each_other_are_refused_by_name(wrong):
    equations, said = WRONG[wrong]
    body = gpw.WALKERS["A"].body
    with pytest.raises(gpw.StatementError, match=said) as raised:
        gpw.System.of(equations, body, centre=hip)
    assert "\n" not in str(raised.value) and "system 'straight'" in str(raised.value)


def test_a_body_and_a_centre_must_fit_the_equations():
    body = gpw.WALKERS["A"].body
    with pytest.raises(gpw.StatementError, match=r"body .* StraightBody"):
        gpw.System.of(SYSTEMS["straight"], gpw.WALKERS["lab"].body, centre=hip)
    with pytest.raises(gpw.StatementError, match=r"centre .* 2 numbers"):
        gpw.System.of(SYSTEMS["straight"], body, centre=lambda body, state: (0.0,))
    with pytest.raises(TypeError, match=r"System.of has no argument links"):
        gpw.System.of(SYSTEMS["straight"], body, centre=hip, links=hip)


def test_the_kinds_of_the_package_are_the_statements_of_their_modules():
    """Nothing is added to them but what smooth ground and bare walkers leave out."""
    for module in (kneed, straight, simplest):
        bare, full = SYSTEMS[module.SYSTEM.name], module.SYSTEM
        assert bare.kinetic_energy is full.kinetic_energy and bare.measure is full.measure
        for one, other in zip(bare.phases, full.phases, strict=True):
            assert one.accelerations is other.accelerations and one.resets is other.resets
