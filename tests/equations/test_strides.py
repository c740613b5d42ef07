"""Strides agree with a slow, independent integration and with the laws of mechanics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, stride
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.models.equations.hybrid import Stage
from gym_passive_walker.models.model import bodies as bodies_as_numbers
from tests.equations import bodies, oracle, statements
from tests.equations.examples import GAITS, KNEED, LONG_GAITS, random_walker


def units(walker) -> np.ndarray:
    """Factor that makes a state's angular velocities dimensionless."""
    return np.array([1.0] * 3 + [walker.time_unit] * 3)


def assert_same_stride(walker, slope, state, torque, **precision) -> oracle.Walk:
    """Compare all numbers of a stride with the oracle's, at the finest tolerance."""
    expected = oracle.walk(walker, slope, state, torque=torque, longest=100.0)
    found = stride(walker, slope, state, hip_torque=torque, tolerance=1e-14)
    time, energy = walker.time_unit, walker.units.energy
    assert found.outcome == expected.outcome
    np.testing.assert_allclose(
        found.state * units(walker), expected.state * units(walker), rtol=0.0, **precision
    )
    for name, unit in [
        ("duration", time),
        ("kneestrike_time", time),
        ("kneestrike_loss", energy),
        ("heelstrike_loss", energy),
    ]:
        np.testing.assert_allclose(
            getattr(found, name) / unit, getattr(expected, name) / unit, rtol=0.0, **precision
        )
    return expected


@pytest.mark.parametrize("torque", [0.0, 0.01, -0.002], ids=["passive", "driven", "braked"])
@pytest.mark.parametrize("gait", GAITS, ids=str)
def test_a_stride_is_what_an_independent_integration_says(gait, torque):
    walker = WALKERS[gait.walker]
    state = gait.state * [1.0, 1.0, 1.0, 0.997, 0.995, 0.995]
    expected = assert_same_stride(
        walker, gait.slope, state, torque * walker.units.torque, atol=1e-12
    )
    assert expected.outcome == Outcome.HEELSTRIKE


def thrown(rng: np.random.Generator, name: str):
    """A walker of some kind with its slope, a random state and a torque."""
    walker = WALKERS[name]
    if not walker.massless_legs and rng.random() < 0.5:
        walker = random_walker(rng, knees=walker.knees)
    gait = LONG_GAITS[name]
    state = gait.state * (1.0 + rng.normal(size=6) * rng.choice([0.1, 0.3]))
    state[1:3] = -state[0]
    state[3:] *= WALKERS[name].time_unit / walker.time_unit
    if not walker.knees:
        state[5] = state[4]
    torque = rng.choice([0.0, 0.02]) * rng.normal() * walker.units.torque
    return walker, gait.slope + 0.02 * rng.normal(), state, torque


@pytest.mark.parametrize("name", WALKERS)
def test_a_thrown_walker_ends_as_an_independent_integration_says(name):
    """Falls, over-rotations and strides."""
    rng = np.random.default_rng(3)
    for _ in range(8):
        assert_same_stride(*thrown(rng, name), atol=1e-9)


def lowest_clearance(walker, walk: oracle.Walk) -> float:
    """Least height of the locked swing foot above the ground, in leg lengths."""
    if len(walk.phases) < 2:
        return np.inf
    *_, locked = walk.phases
    heights = []
    for t in np.linspace(locked.times[0], locked.times[-1], 400):
        stance, swing = bodies.Bodies(walker, locked.state(t)[:3]).legs
        heights.append((swing.foot - stance.foot).imag / walker.leg_length)
    return min(heights)


@pytest.mark.parametrize("name", KNEED)
def test_a_toe_is_stubbed_just_where_the_locked_leg_is_below_the_ground(name):
    rng = np.random.default_rng(5)
    stubbed = 0
    for _ in range(15):
        walker, slope, state, torque = thrown(rng, name)
        free = stride(walker, slope, state, hip_torque=torque)
        ruled = stride(walker, slope, state, hip_torque=torque, end_on_toe_stub=True)
        lowest = lowest_clearance(walker, oracle.walk(walker, slope, state, torque=torque))
        if lowest < -1e-4 or free.outcome == Outcome.KNEE_NOT_LOCKED:
            assert ruled.outcome == Outcome.STUBBED_TOE
            stubbed += 1
        elif lowest > -1e-9:
            assert ruled.outcome == free.outcome
            np.testing.assert_array_equal(ruled.state, free.state)
    assert 0 < stubbed < 15


@pytest.mark.parametrize("name", ["A", "B", "D", "E", "F"])
def test_a_foot_that_sinks_while_the_hip_is_behind_it_has_not_struck(name):
    """Even where the hip passes over the stance foot a moment later, within the same step."""
    walker = WALKERS[name]
    state = np.array([0.05, -0.04, -0.04, -0.8, 0.1, 0.1]) / units(walker)
    expected = oracle.walk(walker, 0.05, state)
    for tolerance in (1e-2, 1e-4, 1e-10):
        found = stride(walker, 0.05, state, tolerance=tolerance)
        assert found.outcome == expected.outcome
        assert found.duration == pytest.approx(expected.duration, rel=100.0 * tolerance)
    assert expected.duration > 0.2 * walker.time_unit


@pytest.mark.slow
@pytest.mark.parametrize("name", WALKERS)
def test_two_hundred_thrown_walkers_end_as_an_independent_integration_says(name):
    rng = np.random.default_rng(4)
    for _ in range(200):
        assert_same_stride(*thrown(rng, name), atol=1e-8)


@pytest.mark.parametrize("gait", GAITS, ids=str)
def test_a_gait_repeats_itself(gait):
    walker = WALKERS[gait.walker]
    after = stride(walker, gait.slope, gait.state, tolerance=1e-14).state
    np.testing.assert_allclose(
        after * units(walker), gait.state * units(walker), rtol=0.0, atol=1e-12
    )


@pytest.mark.parametrize("name", WALKERS)
def test_a_stride_starts_and_ends_with_both_feet_on_the_ground(name):
    gait = LONG_GAITS[name]
    after = stride(name, gait.slope, gait.state * [1.0, 1.0, 1.0, 1.03, 1.0, 1.0]).state
    assert after[0] > 0.0
    assert after[0] == -after[1] == -after[2]


@pytest.mark.parametrize("name", WALKERS)
def test_a_step_is_as_long_as_the_way_from_contact_to_contact(name):
    gait, walker = LONG_GAITS[name], WALKERS[name]
    start = gait.state * [1.0, 1.0, 1.0, 1.03, 1.0, 1.0]
    found = stride(walker, gait.slope, start)
    end = -found.state[:3]
    stance, swing = bodies.Bodies(walker, end).legs
    rolled = walker.foot_radius * (start[0] - end[0])
    assert found.step_length == pytest.approx(rolled + (swing.foot - stance.foot).real, rel=1e-13)


def energy(walker, slope, state) -> float:
    """Total energy over the present contact."""
    return bodies.kinetic_energy(walker, state) + bodies.potential_energy(walker, slope, state[:3])


@pytest.mark.parametrize("name", [name for name in WALKERS if name != "D"])
def test_energy_is_conserved_between_impacts(name):
    gait, walker = LONG_GAITS[name], WALKERS[name]
    whole = stride(name, gait.slope, gait.state)
    start = energy(walker, gait.slope, gait.state)
    scale = bodies.kinetic_energy(walker, gait.state)
    for share in (0.1, 0.4, 0.7, 0.95):
        longest = share * whole.duration / walker.time_unit
        part = stride(name, gait.slope, gait.state, max_stride_time=longest, tolerance=1e-14)
        assert part.outcome == Outcome.STALLED
        assert part.duration == pytest.approx(share * whole.duration, rel=1e-15)
        now = energy(walker, gait.slope, part.state)
        assert now + part.kneestrike_loss == pytest.approx(start, rel=0.0, abs=1e-13 * scale)


def test_the_energy_of_the_simplest_walker_is_its_hips_between_impacts():
    gait, walker = LONG_GAITS["D"], replace(WALKERS["D"], hip_mass=3.0, gravity=2.0)
    state = gait.state * ([1.0] * 3 + [WALKERS["D"].time_unit / walker.time_unit] * 3)

    def total(state):
        hip = walker.leg_length * np.array([-np.sin(state[0]), np.cos(state[0])])
        height = hip @ [-np.sin(gait.slope), np.cos(gait.slope)]
        return oracle.kinetic_energy(walker, state) + walker.hip_mass * walker.gravity * height

    for longest in (0.5, 2.0, 3.5):
        part = stride(walker, gait.slope, state, max_stride_time=longest, tolerance=1e-14)
        assert total(part.state) == pytest.approx(total(state), rel=1e-14)


def flow(walker, slope, state, time, phase, tolerance=1e-14) -> np.ndarray:
    """A dimensionless state after some time in one phase."""
    records, own = new_records(np.array([state]), slope, end=time), bodies_as_numbers(walker)
    records["phase"] = phase
    (record,) = advance(
        walker.equations(), own, records, tolerance=tolerance, from_section=False
    )[:, 0]  # fmt: skip
    assert record["outcome"] == Outcome.RUNNING
    assert record["phase"] == phase
    assert record["time"] == time
    return record["state"]


BACKWARDS = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        (name, phase.stage)
        for name, walker in WALKERS.items()
        for phase in walker.equations().phases
    ],
)
def test_a_walker_reversed_in_time_obeys_the_same_laws(name, stage):
    walker = WALKERS[name]
    phase = [phase.stage for phase in walker.equations().phases].index(stage)
    state = np.array([0.5, -0.2, -0.2 if stage != Stage.FREE else -0.5, -0.6, 0.8, 0.8])
    there = flow(walker, 0.05, state, 0.7, phase)
    back = flow(walker, 0.05, there * BACKWARDS, 0.7, phase)
    np.testing.assert_allclose(back * BACKWARDS, state, rtol=0.0, atol=1e-13)
    assert np.abs(there - state).max() > 0.1


@pytest.mark.parametrize("name", WALKERS)
def test_a_stride_in_ticks_is_a_stride(name):
    """Interruptions change nothing but the last digits."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    state = statements.dimensionless(walker, gait.state)[None]
    system, own = walker.equations(), bodies_as_numbers(walker)
    whole = new_records(state, gait.slope, 0.01)
    advance(system, own, whole, tolerance=1e-14)
    ticks = new_records(state, gait.slope, 0.01, end=0.1)
    advance(system, own, ticks, tolerance=1e-14)
    count = 1
    while ticks["outcome"] == Outcome.RUNNING:
        ticks["end"] += 0.1
        advance(system, own, ticks, tolerance=1e-14, from_section=False)
        count += 1
    assert ticks["outcome"] == Outcome.HEELSTRIKE
    assert count == np.ceil(whole["time"] / 0.1)
    for field in (
        "state", "time", "moved", "turned", "knee_time", "knee_loss", "heel_loss", "step_length",
        "gravity_work",
    ):  # fmt: skip
        np.testing.assert_allclose(ticks[field], whole[field], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", WALKERS)
def test_a_hip_mass_may_as_well_be_shared_between_the_thighs(name):
    """A point mass on the axis belongs to whichever leg one likes."""
    walker, gait = WALKERS[name], LONG_GAITS[name]
    if walker.massless_legs:
        walker = replace(walker, shank_mass=0.01, shank_com=0.5)
    loaded = replace(walker, hip_mass=walker.hip_mass + 0.8)
    mass = walker.thigh_mass + 0.4
    com = walker.thigh_mass * walker.thigh_com / mass
    offset = walker.thigh_mass * walker.thigh_offset / mass
    square = walker.thigh_mass / mass * (
        walker.thigh_gyration**2 + walker.thigh_com**2 + walker.thigh_offset**2
    ) - (com**2 + offset**2)
    shared = replace(
        walker,
        thigh_mass=mass,
        thigh_com=com,
        thigh_offset=offset,
        thigh_gyration=np.sqrt(max(0.0, square)),
    )
    one = stride(loaded, gait.slope, gait.state, tolerance=1e-13)
    other = stride(shared, gait.slope, gait.state, tolerance=1e-13)
    assert other.outcome == one.outcome == Outcome.HEELSTRIKE
    np.testing.assert_allclose(other.state, one.state, rtol=0.0, atol=1e-12)


def test_the_rates_of_a_straight_legged_walkers_shank_are_ignored():
    gait = LONG_GAITS["A"]
    usual = stride("A", gait.slope, gait.state)
    odd = stride("A", gait.slope, np.add(gait.state, [0.0, 0.0, 1.0, 0.0, 0.0, -7.0]))
    np.testing.assert_array_equal(odd.state, usual.state)
