"""Impacts that are difficult to detect: grazing ones, or two roots in one integration step.

An impact is set up exactly and integrated backwards; a walk from that state must find the impact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import BACKWARDS, FREE, KNEED, STRAIGHT, Flock, flock
from gym_passive_walker import Outcome

TOPIC = "Glancing strikes"
LEAD = 0.3
"""Time from the start of a walk to its impact, in sqrt(l/g)."""

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-13)
"""Tolerances from long integration steps, with several events in one, to short steps."""


FOOT, KNEE = np.array([1.0, 1.0, 0.0]), np.array([0.0, 1.0, -1.0])
"""Event functions of heelstrike and kneestrike, as weights of the three angles."""


class Touch(NamedTuple):
    """Walkers with a swing foot, or a knee, that touches for an instant and is lifted again.

    Attributes:
        flock: The walkers.
        event: `FOOT` or `KNEE`.
        states: Dimensionless states at the touch, (n, 6).
        torque: Dimensionless hip torque, which lifts, (n,).
        lift: Second time derivative of the event function at the touch, (n,).
    """

    flock: Flock
    event: NDArray[np.float64]
    states: NDArray[np.float64]
    torque: NDArray[np.float64]
    lift: NDArray[np.float64]

    @property
    def phase(self) -> int:
        """The phase that ends with the impact."""
        return FREE if self.event is KNEE else self.flock.straight_phase

    def lowered(self, angle: NDArray, rate: NDArray) -> Touch:
        """A copy with the swing leg, or the thigh, lower by an angle and falling at a rate."""
        legs = slice(1, 2 if self.event is KNEE else 3)
        states = self.states.copy()
        states[:, :3][:, legs] -= angle[:, None]
        states[:, 3:][:, legs] -= rate[:, None]
        return self._replace(states=states)

    def before(self, lead: NDArray | float) -> NDArray[np.float64]:
        """States (n, 6) from which these walkers reach the touch after a time `lead`."""
        back = self.flock.follow(
            self.states * BACKWARDS, lead, torque=self.torque, tolerance=1e-14, phase=self.phase
        )
        states = back["state"] * BACKWARDS
        states[back["outcome"] != Outcome.RUNNING] = np.nan
        return states

    def walk(self, states: NDArray, tolerance: float) -> NDArray:
        """Records (n,) of walks from states (n, 6)."""
        return self.flock.follow(
            states, 2.0, torque=self.torque, tolerance=tolerance, phase=self.phase
        )

    def struck(self, walks: NDArray) -> NDArray[np.bool_]:
        """Whether each walk has had the impact, (n,)."""
        if self.event is KNEE:
            return walks["knee_time"] > 0.0
        return walks["outcome"] == Outcome.HEELSTRIKE

    def time(self, walks: NDArray) -> NDArray[np.float64]:
        """Time of each walk's impact, (n,)."""
        return walks["knee_time" if self.event is KNEE else "time"]


def touches(rng: np.random.Generator, count: int) -> list[Touch]:
    """Feet that just touch the ground in front, and knees that are straight for an instant."""
    found = []
    n = max(1, count // (len(STRAIGHT) + len(KNEED)))
    for walker in (*STRAIGHT.values(), *KNEED.values()):
        mine, event = flock(walker), KNEE if walker.knees else FOOT
        angle, rate = rng.uniform(0.1, 0.5, n), rng.uniform(0.5, 1.5, n)
        stance = 0.2 - angle if walker.knees else -angle
        states = np.stack([stance, angle, angle, -rate, rate, rate], axis=1)
        torque = np.full(n, 2.0 if not mine.works else 0.3)
        touch = Touch(mine, event, states, torque, np.ones(n))
        step = 1e-3  # forwards and backwards in time: the sum leaves the second derivative
        ways = [
            mine.follow(s, step, torque=torque, phase=touch.phase)["state"][:, :3] - states[:, :3]
            for s in (states, states * BACKWARDS)
        ]
        found.append(touch._replace(lift=(ways[0] + ways[1]) @ event / step**2))
    return found


@case(
    TOPIC,
    "A foot that comes down, or a knee that closes, at a rate of 10⁻¹ to 10⁻⁶, about to turn back, "
    "strikes when it must",
    quick=6_000, long=60_000, bound=20.0, unit="tolerance / rate",
)  # fmt: skip
def almost_tangential(count: int, rng: np.random.Generator) -> Finding:
    """Test times of impacts; their error is that of the angle over the closing rate."""
    tried = failed = 0
    worst = 0.0
    for touch in touches(rng, count):
        rate = 10.0 ** rng.uniform(-6.0, -1.0, len(touch.states))
        falling = touch.lowered(0.0 * rate, rate)
        starts = falling.before(LEAD)
        for tolerance in TOLERANCES:
            walks = falling.walk(starts, tolerance)
            deep = rate**2 / (2.0 * touch.lift) > 100.0 * tolerance
            struck = touch.struck(walks)
            off = np.abs(touch.time(walks) - LEAD) * rate / tolerance
            tried += int(deep.sum())
            failed += int((deep & ~struck).sum())
            worst = max(worst, float(off[deep & struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A foot that dips into the ground and out within one step, or a knee that bends too far and "
    "back, by 10⁻² to 10⁻¹¹, strikes",
    quick=6_000, long=60_000, bound=20.0, unit="tolerance / rate",
)  # fmt: skip
def pair_of_roots(count: int, rng: np.random.Generator) -> Finding:
    """Test two roots in one step; the first counts, with an error that depends on its rate."""
    tried = failed = 0
    worst = 0.0
    for touch in touches(rng, count):
        depth = 10.0 ** rng.uniform(-11.0, -2.0, len(touch.states))
        rate = np.sqrt(2.0 * depth * touch.lift)
        starts = touch.lowered(0.0 * rate, rate).before(LEAD)
        for tolerance in TOLERANCES:
            seen = depth > 100.0 * tolerance
            walks = touch.walk(starts, tolerance)
            struck = touch.struck(walks)
            off = np.abs(touch.time(walks) - LEAD) * rate / tolerance
            tried += int(seen.sum())
            failed += int((seen & ~struck).sum())
            worst = max(worst, float(off[seen & struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A foot that stays above the ground, or a knee that stays bent, by 10⁻² to 10⁻¹¹ at the least, "
    "does not strike there",
    quick=6_000, long=60_000,
)  # fmt: skip
def near_miss(count: int, rng: np.random.Generator) -> Finding:
    """Test near misses; a later impact is permitted."""
    tried = failed = 0
    for touch in touches(rng, count):
        height = 10.0 ** rng.uniform(-11.0, -2.0, len(touch.states))
        passing = touch.lowered(-height, 0.0 * height)
        starts = passing.before(LEAD)
        for tolerance in TOLERANCES:
            seen = height > 100.0 * tolerance
            walks = passing.walk(starts, tolerance)
            struck = touch.struck(walks)
            tried += int(seen.sum())
            failed += int((seen & struck & (touch.time(walks) < 1.1 * LEAD)).sum())
    return Finding(tried, failed)


@case(
    TOPIC,
    "A foot that just touches the ground, or a knee that is straight for an instant, strikes, if "
    "at all, then",
    quick=6_000, long=60_000, bound=3.0, unit="√(tolerance / lift)",
)  # fmt: skip
def mere_touch(count: int, rng: np.random.Generator) -> Finding:
    """Test times of touches: an impact is optional, with an error of the tolerance's root."""
    tried = failed = 0
    worst = 0.0
    for touch in touches(rng, count):
        starts = touch.before(LEAD)
        for tolerance in TOLERANCES[1:]:
            walks = touch.walk(starts, tolerance)
            early = touch.time(walks) < 1.5 * LEAD
            struck = touch.struck(walks)
            off = np.abs(touch.time(walks) - LEAD) / np.sqrt(tolerance / touch.lift)
            tried += len(walks)
            failed += int((walks["outcome"] == Outcome.DIVERGED).sum())
            worst = max(worst, float(off[early & struck].max(initial=0.0)))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "A stance leg that dips below the horizontal within one step, lifted by a torque, has fallen",
    quick=200, long=5_000,
)  # fmt: skip
def grazing_fall(count: int, rng: np.random.Generator) -> Finding:
    """Test falls against walks in a thousand short steps per unit of time."""
    tried = failed = 0
    for walker in STRAIGHT.values():
        mine = flock(walker)
        if not mine.works:  # its torque does not act on the stance leg
            continue
        states = np.zeros((count, 6))
        states[:, 0] = -0.5 * np.pi + 0.02
        states[:, 1] = states[:, 2] = rng.uniform(2.0, 2.6, count)
        torque = -rng.uniform(1.0, 3.0, count)
        options = {"torque": torque, "phase": mine.straight_phase}
        lift = mine.follow(states, 1e-4, **options)["state"][:, 3] / 1e-4
        depth = rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-5.0, -2.0, count)
        states[:, 3] = -np.sqrt(np.maximum(0.0, 2.0 * lift * (0.02 + depth)))
        closely = mine.follow(states, 1e-3, **options)
        lowest = closely["state"][:, 0].copy()
        for tick in range(2, 601):
            closely["end"] = 1e-3 * tick
            mine.go_on(closely, tolerance=1e-13)
            lowest = np.minimum(lowest, closely["state"][:, 0])
        fell = closely["outcome"] == Outcome.FELL_FORWARD
        deeper = closely["state"][:, 3] ** 2 / (2.0 * lift)  # depth that the leg would reach
        margin = np.where(fell, deeper, lowest + 0.5 * np.pi)
        for tolerance in TOLERANCES:
            walks = mine.follow(states, 0.6, tolerance=tolerance, **options)
            seen = margin > 1e-5 + 100.0 * tolerance
            also = walks["outcome"] == Outcome.FELL_FORWARD
            tried += int(seen.sum())
            failed += int((seen & (also != fell)).sum())
    return Finding(tried, failed)
