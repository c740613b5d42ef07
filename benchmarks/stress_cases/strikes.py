"""Strikes that are hard to see: glancing, together, at the start, or two in one integration step.

A strike is set up exactly and played backwards for a while; a walk from there must find it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import BACKWARDS, STRAIGHT, Flock, flock
from gym_passive_walker import Outcome
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.constants import Kind
from gym_passive_walker.physics.engine import advance

TOPIC = "Glancing strikes"
LEAD = 0.3
"""How long before its strike a walk starts, in sqrt(l/g)."""

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13)
"""From steps so long that much can happen within one, to short ones."""


class Touch(NamedTuple):
    """Walkers whose straight swing leg touches the ground in front, about to be lifted again.

    Attributes:
        flock: The walkers.
        states: At the touch, (n, 6).
        torque: What lifts the foot, (n,).
        lift: Acceleration of stance plus swing angle, (n,).
    """

    flock: Flock
    states: NDArray[np.float64]
    torque: NDArray[np.float64]
    lift: NDArray[np.float64]

    def lowered(self, angle: NDArray, rate: NDArray) -> Touch:
        """The same with the swing leg lower by an angle and falling at a rate."""
        change = np.zeros_like(self.states)
        change[:, 1:3], change[:, 4:] = angle[:, None], rate[:, None]
        return self._replace(states=self.states - change)

    def before(self, lead: NDArray | float) -> NDArray[np.float64]:
        """States from which these walkers come to the touch after a time."""
        back = self.flock.follow(
            self.states * BACKWARDS, lead, torque=self.torque, tolerance=1e-14,
            phase=self.flock.straight_phase,
        )  # fmt: skip
        states = back[:, :6] * BACKWARDS
        states[back[:, R.OUTCOME] != Outcome.RUNNING] = np.nan
        return states

    def walk(self, states: NDArray, tolerance: float) -> NDArray[np.float64]:
        """Records of the walks that start there."""
        return self.flock.follow(
            states, 2.0, torque=self.torque, tolerance=tolerance, phase=self.flock.straight_phase
        )


def touches(rng: np.random.Generator, count: int) -> list[Touch]:
    """Feet of every straight-legged walker that just touch the ground in front."""
    found = []
    for walker in STRAIGHT.values():
        mine, n = flock(walker), max(1, count // len(STRAIGHT))
        angle, rate = rng.uniform(0.1, 0.5, n), rng.uniform(0.5, 1.5, n)
        states = np.stack([-angle, angle, angle, -rate, rate, rate], axis=1)
        torque = np.full(n, 2.0 if mine.kind == Kind.SIMPLEST else 0.3)
        step = 1e-3  # there and back: what is left of the motion is its curvature
        ways = [
            mine.follow(s, step, torque=torque, phase=mine.straight_phase)[:, :2] - states[:, :2]
            for s in (states, states * BACKWARDS)
        ]
        lift = (ways[0] + ways[1]).sum(axis=1) / step**2
        found.append(Touch(mine, states, torque, lift))
    return found


@case(
    TOPIC,
    "A foot that comes down at a rate of 10⁻¹ to 10⁻⁶, about to lift again, lands when it must",
    quick=6_000, long=60_000, bound=20.0, unit="tolerance / rate",
)  # fmt: skip
def almost_tangential(count: int, rng: np.random.Generator) -> Finding:
    """The time of a strike is as uncertain as the angle, over the rate at which it closes."""
    tried = failed = 0
    worst = 0.0
    for touch in touches(rng, count):
        rate = 10.0 ** rng.uniform(-6.0, -1.0, len(touch.states))
        falling = touch.lowered(0.0 * rate, rate)
        starts = falling.before(LEAD)
        for tolerance in TOLERANCES:
            walks = falling.walk(starts, tolerance)
            deep = rate**2 / (2.0 * touch.lift) > 100.0 * tolerance
            struck = walks[:, R.OUTCOME] == Outcome.HEELSTRIKE
            off = np.abs(walks[:, R.TIME] - LEAD) * rate / tolerance
            tried += int(deep.sum())
            failed += int((deep & ~struck).sum())
            worst = max(worst, float(off[deep & struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A foot that dips into the ground and out within one step, 10⁻² to 10⁻¹¹ deep, strikes it",
    quick=6_000, long=60_000, bound=20.0, unit="tolerance / rate",
)  # fmt: skip
def pair_of_roots(count: int, rng: np.random.Generator) -> Finding:
    """In and out again: the way in counts, at the rate it is taken with."""
    tried = failed = 0
    worst = 0.0
    for touch in touches(rng, count):
        depth = 10.0 ** rng.uniform(-11.0, -2.0, len(touch.states))
        rate = np.sqrt(2.0 * depth * touch.lift)
        starts = touch.lowered(0.0 * rate, rate).before(LEAD)
        for tolerance in TOLERANCES:
            seen = depth > 100.0 * tolerance
            walks = touch.walk(starts, tolerance)
            struck = walks[:, R.OUTCOME] == Outcome.HEELSTRIKE
            off = np.abs(walks[:, R.TIME] - LEAD) * rate / tolerance
            tried += int(seen.sum())
            failed += int((seen & ~struck).sum())
            worst = max(worst, float(off[seen & struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A foot that stays above the ground by 10⁻² to 10⁻¹¹ at its lowest does not strike it there",
    quick=6_000, long=60_000,
)  # fmt: skip
def near_miss(count: int, rng: np.random.Generator) -> Finding:
    """It may strike later, when it comes down again."""
    tried = failed = 0
    for touch in touches(rng, count):
        height = 10.0 ** rng.uniform(-11.0, -2.0, len(touch.states))
        passing = touch.lowered(-height, 0.0 * height)
        starts = passing.before(LEAD)
        for tolerance in TOLERANCES:
            seen = height > 100.0 * tolerance
            walks = passing.walk(starts, tolerance)
            struck = walks[:, R.OUTCOME] == Outcome.HEELSTRIKE
            tried += int(seen.sum())
            failed += int((seen & struck & (walks[:, R.TIME] < 1.1 * LEAD)).sum())
    return Finding(tried, failed)


@case(
    TOPIC,
    "A foot that just touches the ground strikes it, if at all, at the touch",
    quick=6_000, long=60_000, bound=3.0, unit="√(tolerance / lift)",
)  # fmt: skip
def mere_touch(count: int, rng: np.random.Generator) -> Finding:
    """Whether it strikes is below the tolerance; when it does is known to its square root only."""
    tried = failed = 0
    worst = 0.0
    for touch in touches(rng, count):
        starts = touch.before(LEAD)
        for tolerance in TOLERANCES[1:]:
            walks = touch.walk(starts, tolerance)
            early = walks[:, R.TIME] < 1.5 * LEAD
            struck = walks[:, R.OUTCOME] == Outcome.HEELSTRIKE
            off = np.abs(walks[:, R.TIME] - LEAD) / np.sqrt(tolerance / touch.lift)
            tried += len(walks)
            failed += int((early & ~struck).sum())
            worst = max(worst, float(off[early & struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A stance leg that dips below the horizontal within one step, lifted by a torque, has fallen",
    quick=200, long=5_000,
)  # fmt: skip
def grazing_fall(count: int, rng: np.random.Generator) -> Finding:
    """Held against the same walk looked at a thousand times a unit of time."""
    tried = failed = 0
    for walker in STRAIGHT.values():
        mine = flock(walker)
        if mine.kind == Kind.SIMPLEST:  # its torque does not act on the stance leg
            continue
        states = np.zeros((count, 6))
        states[:, 0] = -0.5 * np.pi + 0.02
        states[:, 1] = states[:, 2] = rng.uniform(2.0, 2.6, count)
        torque = -rng.uniform(1.0, 3.0, count)
        options = {"torque": torque, "phase": mine.straight_phase}
        lift = mine.follow(states, 1e-4, **options)[:, 3] / 1e-4
        depth = rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-5.0, -2.0, count)
        states[:, 3] = -np.sqrt(np.maximum(0.0, 2.0 * lift * (0.02 + depth)))
        closely = mine.follow(states, 1e-3, **options)
        lowest = closely[:, 0].copy()
        for tick in range(2, 601):
            closely[:, R.END] = 1e-3 * tick
            advance(mine.kind, mine.constants, closely, tolerance=1e-13, from_section=False)
            lowest = np.minimum(lowest, closely[:, 0])
        fell = closely[:, R.OUTCOME] == Outcome.FELL_FORWARD
        deeper = closely[:, 3] ** 2 / (2.0 * lift)  # the depth that it would reach
        margin = np.where(fell, deeper, lowest + 0.5 * np.pi)
        for tolerance in TOLERANCES:
            walks = mine.follow(states, 0.6, tolerance=tolerance, **options)
            seen = margin > 1e-5 + 100.0 * tolerance
            also = walks[:, R.OUTCOME] == Outcome.FELL_FORWARD
            tried += int(seen.sum())
            failed += int((seen & (also != fell)).sum())
    return Finding(tried, failed)
