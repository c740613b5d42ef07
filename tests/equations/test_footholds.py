"""Uneven ground: heelstrikes on footholds that are higher, lower or tilted."""

from __future__ import annotations

import cmath
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gym_passive_walker import WALKERS, Outcome, find_gait, rough, simulate, stride
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import Ground, State
from gym_passive_walker.models.equations.systems import SYSTEMS, UNEVEN
from gym_passive_walker.models.model import constants_by
from tests.equations import bodies
from tests.equations.bodies import SHANK, STANCE_SHANK, STANCE_THIGH, THIGH
from tests.equations.examples import GAITS, KNEED, LONG_GAITS, MASSIVE

ALL = range(5)
RATE = st.floats(-3.0, 3.0)
POINT_FEET = [name for name in LONG_GAITS if WALKERS[name].foot_radius == 0.0]
GROUNDS = st.builds(
    lambda rise, turn: Ground(0.0, 1.0, rise, turn), st.floats(-0.1, 0.1), st.floats(-0.3, 0.3)
)


def on_both(walker, stance: float, ground: Ground) -> State:
    """Straight legs with their feet on a foothold and the next; angles from the first's normal."""
    body = walker.body
    state = State(stance, -stance, -stance, 0.0, 0.0, 0.0)
    for _ in range(8):
        state = legs.standing(body, state, ground)
    return state


@pytest.mark.parametrize("name", list(WALKERS))
@given(stance=st.floats(-0.8, -0.2), ground=GROUNDS)
def test_feet_that_stand_differ_in_height_by_the_rise(name, stance, ground):
    walker = WALKERS[name]
    state = on_both(walker, stance, ground)
    height = legs.clearance(walker.body, state.stance, state.thigh)
    assert height == pytest.approx(ground.height_change, rel=0.0, abs=1e-15)
    assert state.thigh - state.stance == pytest.approx(-2.0 * stance, rel=1e-14)


@pytest.mark.parametrize("name", MASSIVE)
@given(stance=st.floats(-0.8, -0.2), rates=st.tuples(RATE, RATE), ground=GROUNDS)
def test_a_strike_on_any_foothold_conserves_angular_momentum(name, stance, rates, ground):
    """About the new contact, which lies where the foot touches the next foothold; and the hip."""
    walker, units = WALKERS[name], WALKERS[name].units
    before = on_both(walker, stance, ground)._replace(
        stance_rate=rates[0], thigh_rate=rates[1], shank_rate=rates[1]
    )
    strike = SYSTEMS[f"{walker.kind}-uneven"].phases[-1].resets[Outcome.HEELSTRIKE].strike
    struck = strike(walker.body, before, 0.0, ground)
    assert struck.after.stance == pytest.approx(before.thigh + ground.slope_change, abs=1e-15)
    assert struck.after.thigh == pytest.approx(before.stance + ground.slope_change, abs=1e-15)
    rates_of = [
        np.array(x[3:]) / units.time for x in (before, struck.after)
    ]  # in the walker's own units
    old, new = bodies.Bodies(walker, before[:3]), bodies.Bodies(walker, struck.after[:3])
    velocities = old.velocities(rates_of[0]), new.velocities(rates_of[1])
    turned = new.legs[0].foot / old.legs[1].foot  # from the old foothold's frame to the new one's
    assert abs(cmath.phase(turned)) == pytest.approx(abs(ground.slope_change), abs=1e-14)
    scale = walker.total_mass * walker.leg_length**2 * (1e-3 + np.abs(rates_of[0]).max())
    under = 1j * walker.foot_radius

    def same(old_members, old_point, new_members, new_point):
        assert new.angular_momentum(velocities[1], new_point, new_members) == pytest.approx(
            old.angular_momentum(velocities[0], old_point, old_members), rel=0.0, abs=1e-13 * scale
        )

    same(ALL, old.legs[1].foot - under / turned, ALL, new.legs[0].foot - under)
    same([STANCE_THIGH, STANCE_SHANK], 0j, [THIGH, SHANK], 0j)
    if walker.knees:
        same([STANCE_SHANK], old.legs[0].knee, [SHANK], new.legs[1].knee)
    energies = [x.kinetic_energy(v) for x, v in zip((old, new), rates_of, strict=True)]
    assert struck.lost * units.energy == pytest.approx(
        energies[0] - energies[1], rel=0.0, abs=1e-13 * scale * (1.0 + np.abs(rates_of[0]).max())
    )
    assert struck.lost >= -1e-15


@pytest.mark.parametrize("name", POINT_FEET)
@pytest.mark.parametrize("steeper", [-0.003, 0.005])
def test_point_feet_take_a_step_down_for_a_steeper_slope(name, steeper):
    """Where feet are points, ground is where they stand: a line from foothold to foothold."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    on_slope = stride(walker, gait.slope + steeper, gait.state, tolerance=1e-13)
    turned = np.array([steeper] * 3 + [0.0] * 3)
    length = on_slope.step_length
    on_steps = stride(
        walker, gait.slope, gait.state - turned, tolerance=1e-13,
        height_change=-length * np.sin(steeper), slope_change=steeper,
    )  # fmt: skip
    assert on_steps.outcome == on_slope.outcome == Outcome.HEELSTRIKE
    np.testing.assert_allclose(on_steps.state, on_slope.state, rtol=0.0, atol=1e-11)
    assert on_steps.step_length == pytest.approx(length * np.cos(steeper), rel=1e-12)
    for measure in ("duration", "gravity_work", "heelstrike_loss"):
        assert getattr(on_steps, measure) == pytest.approx(getattr(on_slope, measure), rel=1e-11)


@pytest.mark.parametrize("gait", GAITS, ids=str)
def test_smooth_ground_is_a_case_of_the_other(gait):
    """The next foothold is slightly higher: strides change in proportion."""
    walker = WALKERS[gait.walker]
    level = stride(walker, gait.slope, gait.state, tolerance=1e-13)
    hair = stride(walker, gait.slope, gait.state, tolerance=1e-13, height_change=1e-14)
    np.testing.assert_allclose(hair.state, level.state, rtol=0.0, atol=2e-11)
    assert hair.heelstrike_loss == pytest.approx(level.heelstrike_loss, rel=1e-10)


@pytest.mark.parametrize("name", list(LONG_GAITS))
def test_the_energy_balance_of_a_walk_on_rough_ground_closes(name):
    """Work of gravity minus losses equals the gain of kinetic energy, stride by stride."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    system, body = SYSTEMS[f"{walker.kind}-uneven"], walker.body
    units, terrain, state, strides = walker.units, rough(2e-4, 1e-3), gait.state, 0
    for tilt, rise, turn in terrain.ground(5, range(30)):
        end = stride(
            walker, gait.slope + tilt, state, height_change=rise * walker.leg_length,
            slope_change=turn,
            tolerance=1e-12,
        )  # fmt: skip
        if end.outcome != Outcome.HEELSTRIKE:
            break
        energies = [
            system.kinetic_energy(body, State(*units.to_dimensionless(x))) * units.energy
            for x in (state, end.state)
        ]
        gained = end.gravity_work - end.collision_loss
        assert energies[1] - energies[0] == pytest.approx(gained, rel=0.0, abs=1e-11 * units.energy)
        state, strides = end.state, strides + 1
    assert strides >= 3


@given(
    name=st.sampled_from(list(WALKERS)),
    angle=st.floats(0.02, 0.7),
    rates=st.tuples(RATE, RATE, RATE),
    ground=st.tuples(st.floats(-0.1, 0.2), st.floats(-0.15, 0.15), st.floats(-0.3, 0.3)),
    tolerance=st.sampled_from([1e-6, 1e-8, 1e-10, 1e-12]),
)
def test_a_strike_comes_with_legs_apart_and_closes_its_balance(
    name, angle, rates, ground, tolerance
):
    """For any initial state and any foothold; no stride diverges."""
    walker, (slope, rise, turn) = WALKERS[name], ground
    system, body, units = walker.equations(UNEVEN), walker.body, walker.units
    start = State(angle, -angle, -angle, *rates)
    if not walker.knees:
        start = start._replace(shank_rate=start.thigh_rate)
    found = stride(
        walker, slope, units.to_own(np.array(start)), height_change=rise * units.length,
        slope_change=turn,
        tolerance=tolerance,
    )  # fmt: skip
    assert found.outcome != Outcome.DIVERGED
    if found.outcome != Outcome.HEELSTRIKE:
        return
    end = State(*units.to_dimensionless(found.state))
    apart = legs.NARROWEST - 1e-12 if rise or turn else 0.0  # as near as they like on smooth ground
    assert end.stance - end.thigh > apart
    energies = [system.kinetic_energy(body, state) for state in (start, end)]
    gravity, lost = found.gravity_work / units.energy, found.collision_loss / units.energy
    moved = energies[0] + abs(energies[1] - energies[0]) + abs(gravity) + lost
    largest = max(map(abs, (*start, *end)))
    missing = gravity - lost - (energies[1] - energies[0])
    assert abs(missing) < 10.0 * tolerance * (moved + largest**2) + 1e-14


@pytest.mark.parametrize(
    ("name", "slope", "state", "rise"),
    [
        (
            "lab-straight", 0.03,
            [0.348022, -0.348022, -0.348022, -1.182074, 0.434742, 0.434742], -0.007009,
        ),
        ("A", 0.03, [0.265874, -0.265874, -0.265874, -2.487278, -4.497271, -4.497271], -0.01114),
        (
            "lab", 0.036,
            [
                0.6673372287145243, -0.6673372287145243, -0.6673372287145243,
                -2.291585976627713, -0.6647859737356817, -3.2364329102466307,
            ], 0.0,
        ),
    ],
)  # fmt: skip
def test_legs_that_pass_each_other_near_the_ground_do_not_strike(name, slope, state, rise):
    """At no tolerance, although the foot passes the height of the foothold there."""
    for tolerance in 10.0 ** np.arange(-6.0, -13.5, -1.0):
        found = stride(name, slope, state, height_change=rise, tolerance=tolerance)
        assert found.outcome == Outcome.FELL_FORWARD


@pytest.mark.parametrize("name", ["A", "lab", "lab-straight"])
@pytest.mark.parametrize("turn", [-0.2, 0.1])
def test_a_step_onto_tilted_ground_is_measured_to_where_the_foot_touches_it(name, turn):
    """A round foot touches below its centre, along the normal of its own foothold."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    level, tilted = (
        stride(walker, gait.slope, gait.state, slope_change=x, tolerance=1e-13) for x in (0.0, turn)
    )
    assert tilted.outcome == Outcome.HEELSTRIKE
    beside = walker.foot_radius * np.sin(turn)
    assert tilted.step_length == pytest.approx(level.step_length - beside, rel=1e-11)


def test_ground_with_random_slopes_alone_is_walked_on():
    terrain, gait = rough(0.0, 0.01), LONG_GAITS["lab"]
    assert terrain.random and not terrain.smooth
    walk = simulate("lab", gait.slope, gait.state, 3, terrain=terrain, terrain_seed=1)
    assert np.unique(walk.tilts).size == 3


def test_a_step_too_high_is_never_reached_and_one_too_low_is_fallen_from():
    gait = LONG_GAITS["C"]
    ends = [
        stride("C", gait.slope, gait.state, height_change=rise).outcome
        for rise in (-0.02, 0.0, 0.01, 0.5)
    ]
    assert ends[:2] == [Outcome.HEELSTRIKE] * 2
    assert ends[-1] != Outcome.HEELSTRIKE


def test_a_walk_over_rough_ground_has_its_feet_on_it():
    """The contact of each stride begins where the foot of the last came down."""
    gait = LONG_GAITS["lab"]
    walk = simulate("lab", gait.slope, gait.state, 6, terrain=rough(0.002, 0.01), terrain_seed=3)
    assert len(walk.outcomes) == 6
    walker = WALKERS["lab"]
    for k in walk.struck[walk.stride_index[walk.struck] != walk.stride_index[walk.struck - 1]]:
        feet = []
        for i, leg in ((k - 1, 1), (k, 0)):
            own = bodies.Bodies(walker, walk.states[i, :3])
            normal = 1j * cmath.exp(-1j * walk.tilts[i])
            there = complex(walk.contact_x[i], walk.contact_y[i]) + walker.foot_radius * normal
            foot = own.legs[leg].foot - own.legs[0].foot
            foot = -foot.real + 1j * foot.imag if _backwards(walker) else foot
            feet.append(there + foot * cmath.exp(-1j * walk.tilts[i]))
        assert abs(feet[0] - feet[1]) < 1e-6


def _backwards(walker) -> bool:
    """Whether the bodies' x points backwards: a leg that leans back has its hip behind its foot."""
    own = bodies.Bodies(walker, (0.3, 0.3, 0.3))
    return own.legs[0].foot.real < 0.0


@pytest.mark.parametrize("name", KNEED)
def test_a_stubbed_toe_is_one_below_both_footholds(name):
    """A locked swing leg may pass below the higher one, towards the lower."""
    gait, walker = LONG_GAITS[name], WALKERS[name]
    down = stride(
        walker,
        gait.slope,
        gait.state,
        height_change=-0.01 * walker.leg_length,
        end_on_toe_stub=True,
    )
    assert down.outcome == stride(walker, gait.slope, gait.state, end_on_toe_stub=True).outcome
    assert down.outcome == Outcome.HEELSTRIKE
    up = 0.03 * walker.leg_length
    assert (
        stride(walker, gait.slope, gait.state, height_change=up, end_on_toe_stub=True).outcome
        == Outcome.HEELSTRIKE
    )


@pytest.mark.parametrize("rise", [-0.02, 0.0, 0.03])
def test_of_two_footholds_the_lower_one_is_meant(rise):
    assert legs.lower(Ground(0.0, 1.0, rise, 0.0)) == min(rise, 0.0)


@pytest.mark.parametrize("name", ["D", "E", "F"])
def test_a_point_foot_is_pushed_off_alike_whatever_the_next_foothold_s_slope(name):
    walker = replace(WALKERS[name], foot_radius=0.0)
    gait = find_gait(WALKERS[name], 0.01 if name == "D" else 0.02)
    units = walker.units
    level, steep = (
        stride(
            walker, 0.02, gait.state, push_off=0.02 * units.impulse, slope_change=turn,
            tolerance=1e-12,
        )
        for turn in (0.0, 0.05)
    )  # fmt: skip
    assert level.outcome == steep.outcome == Outcome.HEELSTRIKE and level.push_off_work > 0.0
    np.testing.assert_allclose(steep.state[:3], level.state[:3] + 0.05, atol=1e-10)
    np.testing.assert_allclose(steep.state[3:], level.state[3:], rtol=1e-9)
    assert steep.heelstrike_loss == pytest.approx(level.heelstrike_loss, rel=1e-9)


@pytest.mark.parametrize("parameter", ["thigh_length", "thigh_com", "shank_mass"])
def test_constants_change_with_a_parameter_as_each_walker_s_own_do(parameter):
    lab = WALKERS["lab"]
    values = getattr(lab, parameter) * np.array([0.9, 1.0, 1.1])
    found = constants_by(lab, {parameter: values}, parameter)
    for change, value in zip(found, values, strict=True):
        (own,) = np.atleast_2d(constants_by(replace(lab, **{parameter: value}), {}, parameter))
        np.testing.assert_allclose(change, own, rtol=1e-12, atol=1e-14)
