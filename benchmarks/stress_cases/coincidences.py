"""Events that crowd: two at once, in either order, within one step, or at the very start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import BACKWARDS, FREE, KNEED, STRAIGHT, Flock, flock
from benchmarks.stress_cases.gaits import every_gait, start
from gym_passive_walker import Outcome

TOPIC = "Coinciding events"
LEAD = 0.3
"""How long before its events a walk starts, in sqrt(l/g)."""

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-10, 1e-13)


def before(mine: Flock, states: NDArray, phase: int) -> NDArray[np.float64]:
    """States from which walkers come to `states` after `LEAD`."""
    back = mine.follow(states * BACKWARDS, LEAD, phase=phase, tolerance=1e-14)
    starts = back["state"] * BACKWARDS
    on_the_way = (back["outcome"] == Outcome.RUNNING) & (back["phase"] == phase)
    return starts[on_the_way]


def knees_about_to_strike(rng: np.random.Generator, height: NDArray) -> NDArray[np.float64]:
    """Legs that become straight where stance plus swing angle is `height`, and falling."""
    n = len(height)
    angle, rate = rng.uniform(0.15, 0.4, n), rng.uniform(0.6, 1.2, n)
    thigh_rate = rate - rng.uniform(1.0, 1.5, n)
    shank_rate = thigh_rate + rng.uniform(0.1, 0.5, n)
    swing = angle + height
    return np.stack([-angle, swing, swing, -rate, thigh_rate, shank_rate], axis=1)


def knee_and_heel(heights: NDArray, outcome: Outcome, rng: np.random.Generator) -> Finding:
    """Walk to a kneestrike at known heights of the foot, which must end the stride as expected."""
    tried = failed = 0
    worst = 0.0
    for walker in KNEED.values():
        mine = flock(walker)
        ends = knees_about_to_strike(rng, heights)
        for tolerance in TOLERANCES:
            seen = before(mine, ends[np.abs(heights) > 100.0 * tolerance], FREE)
            walks = mine.follow(seen, 2.0, phase=FREE, tolerance=tolerance)
            exact = mine.follow(seen, 2.0, phase=FREE, tolerance=1e-15)
            off = [np.abs(walks[t] - exact[t]) for t in ("time", "knee_time")]
            knee = np.abs(walks["knee_time"] - LEAD)
            tried += len(walks)
            failed += int((walks["outcome"] != outcome).sum())
            worst = max(worst, *(float(a.max(initial=0.0)) / tolerance for a in (*off, knee)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A knee that strikes with the foot 10⁻² to 10⁻¹¹ above the ground is followed by heelstrike",
    quick=200, long=20_000, bound=100.0, unit="tolerance",
)  # fmt: skip
def knee_then_heel(count: int, rng: np.random.Generator) -> Finding:
    """Both strikes at their times."""
    return knee_and_heel(10.0 ** rng.uniform(-11.0, -2.0, count), Outcome.HEELSTRIKE, rng)


@case(
    TOPIC,
    "A knee that strikes with the foot 10⁻² to 10⁻¹¹ below the ground has been bent there",
    quick=200, long=20_000, bound=100.0, unit="tolerance",
)  # fmt: skip
def heel_then_knee(count: int, rng: np.random.Generator) -> Finding:
    """The foot came down before the knee locked."""
    return knee_and_heel(-(10.0 ** rng.uniform(-11.0, -2.0, count)), Outcome.KNEE_NOT_LOCKED, rng)


@case(
    TOPIC,
    "Kneestrike and heelstrike at the same instant: one of both, then",
    quick=200, long=20_000, bound=100.0, unit="tolerance",
)  # fmt: skip
def knee_with_heel(count: int, rng: np.random.Generator) -> Finding:
    """To within rounding; which of both is a matter of the last digit."""
    tried = failed = 0
    worst = 0.0
    for walker in KNEED.values():
        mine = flock(walker)
        height = rng.choice([0.0, 1e-16, -1e-16, 1e-15, -1e-15, 1e-14, -1e-14], count)
        starts = before(mine, knees_about_to_strike(rng, height), FREE)
        for tolerance in TOLERANCES:
            walks = mine.follow(starts, 2.0, phase=FREE, tolerance=tolerance)
            outcome = walks["outcome"]
            known = (outcome == Outcome.HEELSTRIKE) | (outcome == Outcome.KNEE_NOT_LOCKED)
            tried += len(walks)
            failed += int((~known).sum())
            off = np.abs(walks["time"] - LEAD) / tolerance
            worst = max(worst, float(off.max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "Heelstrike and a fall within one step: the earlier ends the stride",
    quick=3_000, long=20_000, bound=1.0, unit="tolerance",
)  # fmt: skip
def strike_or_fall(count: int, rng: np.random.Generator) -> Finding:
    """Legs flat on the ground; which event comes first is asked where it can be told."""
    tried = failed = 0
    worst = 0.0
    for walker in STRAIGHT.values():
        mine = flock(walker)
        to_fall, gap = 0.02, 10.0 ** rng.uniform(-6.0, -2.0, count)
        rate, closing = rng.uniform(1.0, 3.0, count), rng.uniform(1.0, 3.0, count)
        stance = -0.5 * np.pi + rate * to_fall
        swing = -stance + closing * (to_fall + gap * rng.choice([-1.0, 0.0, 1.0], count))
        states = np.stack([stance, swing, swing, -rate, rate - closing, rate - closing], axis=1)
        starts = before(mine, states, mine.straight_phase)
        exact = mine.follow(starts, 2.0, tolerance=1e-15, phase=mine.straight_phase)
        struck = exact["outcome"] == Outcome.HEELSTRIKE
        stance, swing = exact["state"][:, 0], exact["state"][:, 1]
        apart = np.where(struck, 0.5 * np.pi - stance, stance + swing)
        for tolerance in TOLERANCES:
            walks = mine.follow(starts, 2.0, tolerance=tolerance, phase=mine.straight_phase)
            other = walks["outcome"] != exact["outcome"]
            off = np.abs(walks["time"] - exact["time"])
            tried += len(walks)
            failed += int((other & (apart > tolerance)).sum())
            worst = max(worst, float(off.max(initial=0.0)) / tolerance)
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A stride that starts exactly on an event, or a rounding error beside it, is not ended by it",
    quick=200, long=20_000, bound=1e-12, unit="time, angles and rates",
)  # fmt: skip
def start_on_an_event(count: int, rng: np.random.Generator) -> Finding:
    """Both feet on the ground just after heelstrike, and the knee straight."""
    tried = failed = 0
    worst = 0.0
    for _, gait in every_gait():
        mine, options = flock(gait.walker), {"slope": gait.slope, "tolerance": 1e-14}
        exact = mine.follow(start(gait)[None], **options)
        starts = start(gait) + rng.choice([0.0, 1e-17, -1e-17, 1e-16, -1e-16], (count, 6))
        if not gait.walker.knees:
            starts[:, [2, 5]] = starts[:, [1, 4]]
        walks = mine.follow(starts, **options)
        off = [np.abs(walks[what] - exact[what]).max() for what in ("state", "time")]
        tried += count
        failed += int((walks["outcome"] != Outcome.HEELSTRIKE).sum())
        worst = max(worst, *map(float, off))
    return Finding(tried, failed, worst)
