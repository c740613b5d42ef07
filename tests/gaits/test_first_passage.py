"""How long walkers last on rough ground; a rimless wheel is a walker without a swing leg."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pytest

from gym_passive_walker import WALKERS, find_gait, rough
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.robust.first_passage import SETTLING, FirstPassage, survivors
from gym_passive_walker.models.equations import legs, simplest
from gym_passive_walker.models.equations.hybrid import Outcome, Phase, Reset, Stage, Strike, System
from gym_passive_walker.models.equations.numbers import sine_cosine
from gym_passive_walker.models.equations.systems import SYSTEMS
from validation.wheel import HALF, KEEPS, SLOPE

LASTS = {2.0: 4324.9129, 3.0: 113.56971}
"""Steps to a fall, by the standard deviation of the slope in degrees; see tests/validation."""


class Wheel(NamedTuple):
    """A mass on spokes without any."""

    foot_radius: float = 0.0
    leg: float = 1.0
    between: float = 2.0 * HALF


def accelerations(body, state, control, ground):
    """Those of an inverted pendulum; the spoke in front turns with it."""
    sine, cosine = sine_cosine(state.stance)
    acceleration = sine * ground.cosine - cosine * ground.sine
    return acceleration, acceleration


def heelstrike(body, before, push_off=0.0, ground=None):
    """The hub keeps its velocity across the new spoke."""
    sine, cosine = sine_cosine(body.between)
    rate, lost = cosine * before.stance_rate, sine * before.stance_rate
    stance = before.thigh + ground.slope_change
    after = legs.straight(stance, stance + body.between, rate, rate)
    return Strike(after, 0.5 * lost * lost)


WHEEL = System(
    name="wheel",
    Body=Wheel,
    phases=(
        Phase(
            Stage.SIMPLEST,
            2,
            accelerations,
            guards=(legs.HEELSTRIKE, *legs.STANCE_FALLS),
            resets={Outcome.HEELSTRIKE: Reset(heelstrike)},
        ),
    ),
    measure=legs.measure,
    place=legs.place,
    kinetic_energy=simplest.kinetic_energy,
    potential_gain=simplest.potential_gain,
    foot_clearance=simplest.foot_clearance,
    absent=("ankle", "push_off"),
)


@pytest.fixture(autouse=True)
def wheel(monkeypatch):
    """The engine knows of the wheel."""
    monkeypatch.setitem(SYSTEMS, "wheel", WHEEL)


class Wheels(Walkers):
    """Wheels instead of walkers."""

    def system(self, moving=()):
        """See `Walkers`."""
        return WHEEL

    @cached_property
    def constants(self):
        """See `Walkers`."""
        return np.array(Wheel())[None, None]


WHO = Wheels(walker=WALKERS["D"], tolerance=1e-8)


def steady_rate() -> float:
    """Rate after a collision on smooth ground: what the slope gives, the collision takes."""
    return -math.sqrt(KEEPS * 4.0 * math.sin(HALF) * math.sin(SLOPE) / (1.0 - KEEPS))


START = legs.straight(HALF, 3.0 * HALF, steady_rate(), steady_rate())


def test_a_wheel_on_smooth_ground_keeps_its_rate():
    apex = math.sqrt(steady_rate() ** 2 - 2.0 * (1.0 - math.cos(HALF - SLOPE)))
    assert apex * math.sqrt(9.8) == pytest.approx(1.209733838, rel=1e-9)
    exact = replace(WHO, tolerance=1e-12)
    left = survivors(exact, START, SLOPE, rough(0.0), walkers=2, strides=50)
    assert left.tolist() == [2] * 51


@pytest.mark.parametrize("degrees", LASTS)
def test_wheels_that_walk_fall_as_often_as_the_eigenvalue_says(degrees):
    ground = rough(slope_std=math.radians(degrees))
    strides = SETTLING + int(400 * LASTS[degrees] / 2000) + 20
    found = FirstPassage.of(
        survivors(WHO, START, SLOPE, ground, walkers=2000, strides=strides, seed=1)
    )
    assert found.falls > 150
    assert abs(found.mean - LASTS[degrees]) < 3.0 * found.error


def test_the_interval_of_a_mean_holds_it_nineteen_times_of_twenty():
    rng, held = np.random.default_rng(0), 0
    for falls in rng.binomial(2000, 0.02, size=400):
        low, high = FirstPassage(int(falls), 2000).interval
        held += low < 50.0 < high
    assert 0.93 < held / 400 < 0.97


def test_walkers_that_never_fell_last_longer_than_was_simulated():
    none = FirstPassage(0, 3000)
    assert none.mean == none.error == math.inf
    assert none.interval[0] == pytest.approx(1001.4, rel=1e-4)
    assert "none of 3000" in str(none)


def test_of_walkers_that_fall_before_any_stride_counts_nothing_is_known_but_that():
    none = FirstPassage.of(np.array([64, 3, 0, 0, 0]), settling=2)
    assert (none.falls, none.strides) == (0, 0)
    assert str(none) == "all fell before any stride was counted"
    assert math.isnan(none.mean) and math.isnan(none.error)
    assert none.interval == (0.0, math.inf)


def test_a_kneed_walker_lasts_the_longer_the_smoother_the_ground():
    walker, gait = WALKERS["C"], find_gait("C", 0.05)
    state = walker.units.to_dimensionless(gait.state)
    kind = Walkers(walker=walker, tolerance=1e-8)
    lasts = [
        FirstPassage.of(
            survivors(kind, state, 0.05, rough(std), walkers=400, strides=SETTLING + 60)
        ).mean
        for std in (0.004, 0.002)
    ]
    assert lasts[0] < lasts[1]


@pytest.mark.parametrize("left", [(), (0,), (0, 0), (12,), (12, 12), (30, 30, 5)])
def test_falls_are_counted_among_all_who_begin_a_stride_once_they_have_settled(left):
    found = FirstPassage.of(np.array([100, 90, 60, 30, *left]), settling=1)
    begun = [90, 60, 30, *left][:-1]  # those left at the end have begun no further stride
    assert found == FirstPassage(falls=90 - [30, *left][-1], strides=sum(begun))
