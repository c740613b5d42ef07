"""Stance legs that barely pass the vertical, for which the required time is unbounded."""

from __future__ import annotations

import numpy as np

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import flock
from gym_passive_walker import WALKERS, Outcome

TOPIC = "Extremes"
HELD = 0.8
"""Torque that holds a massless swing leg far in front, so that there is no earlier impact."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(200)


def time_over(delta: float, first: float, last: float) -> float:
    """Time of an inverted pendulum that passes the vertical with angular velocity √(2 delta).

    The time is the integral of dφ / √(2 delta + 4 sin²(φ/2)). The substitution
    sin(φ/2) = √(delta/2) sinh u gives a smooth integral of du / √(1 - sin²(φ/2)).
    """
    root = np.sqrt(0.5 * delta)
    ends = np.arcsinh(np.sin(0.5 * np.array([first, last])) / root)
    u = 0.5 * (ends[0] + ends[1]) + 0.5 * (ends[0] - ends[1]) * _NODES
    integrand = 1.0 / np.sqrt(1.0 - (root * np.sinh(u)) ** 2)
    return 0.5 * (ends[0] - ends[1]) * float(_WEIGHTS @ integrand)


@case(
    TOPIC,
    "A stance leg that passes the vertical with 10⁻¹ to 10⁻¹² of its energy left takes as long as "
    "the elliptic integral says",
    quick=50, long=2_000, bound=1.0, unit="10⁻¹⁵ / energy left",
)  # fmt: skip
def barely_over(count: int, rng: np.random.Generator) -> Finding:
    """Test the time, about ln(1 / energy left); its error comes from rounding of the energy."""
    mine = flock(WALKERS["D"])
    left = 10.0 ** rng.uniform(-12.0, -1.0, count)
    angle, slope = rng.uniform(0.1, 0.4, count), rng.uniform(-0.05, 0.05, count)
    first, last = angle - slope, -rng.uniform(0.05, 0.3, count)
    states = np.zeros((count, 6))
    states[:, 0] = angle
    states[:, 1:3] = np.arcsin(HELD)
    states[:, 3] = -np.sqrt(2.0 * left + 4.0 * np.sin(0.5 * first) ** 2)
    time = np.array([time_over(*each) for each in zip(left, first, last, strict=True)])
    walks = mine.follow(
        states, time, slope=slope, torque=HELD, phase=mine.straight_phase, tolerance=1e-15
    )
    rate = np.sqrt(2.0 * left + 4.0 * np.sin(0.5 * last) ** 2)
    late = np.abs(walks["state"][:, 0] - slope - last) / rate
    failed = int((walks["outcome"] != Outcome.RUNNING).sum())
    return Finding(count, failed, float((late * left).max() / 1e-15))
