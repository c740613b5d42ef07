"""Statistics of chaotic walks, which do not depend on the initial state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import flock
from benchmarks.stress_cases.gaits import gaits, start
from gym_passive_walker import WALKERS, Outcome

TOPIC = "Chaos"
SLOPE = 0.0186
"""The simplest walker's steps are chaotic here, and it does not fall."""

FORGOTTEN = 60  # strides after which a walk is independent of its initial state


def engine_stride(states: NDArray, tolerance: float) -> NDArray[np.float64]:
    """Next states on the Poincaré section of simplest walkers, (n, 6); NaN after a fall."""
    walks = flock(WALKERS["D"]).follow(states, slope=SLOPE, tolerance=tolerance)
    return np.where(walks["outcome"][:, None] == Outcome.HEELSTRIKE, walks["state"], np.nan)


def pace(y: NDArray) -> NDArray[np.float64]:
    """Angular velocities and accelerations of the simplest walker, by the printed equations."""
    stance, swing, stance_rate, swing_rate = y
    # Printed with phi = stance - swing: phi'' = theta'' + (theta'^2 - cos(theta - slope)) sin(phi).
    leaning = np.sin(stance - SLOPE)
    between = leaning + np.sin(stance - swing) * (stance_rate**2 - np.cos(stance - SLOPE))
    return np.array([stance_rate, swing_rate, leaning, leaning - between])


def classical(y: NDArray, h: NDArray) -> NDArray[np.float64]:
    """The classical Runge-Kutta step of order 4."""
    a = pace(y)
    b = pace(y + 0.5 * h * a)
    c = pace(y + 0.5 * h * b)
    d = pace(y + h * c)
    return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def classical_stride(states: NDArray, h: float) -> NDArray[np.float64]:
    """Next states (n, 6) by the printed equations, another integrator and another event search."""
    y = states[:, [0, 1, 3, 4]].T.copy()
    walking = np.arange(y.shape[1])
    after = np.full_like(y, np.nan)
    for _ in range(int(12.0 / h)):
        now = y[:, walking]
        new = classical(now, np.full(len(walking), h))
        struck = (now[:2].sum(axis=0) > 0.0) & (new[:2].sum(axis=0) <= 0.0) & (new[0] < 0.0)
        if np.any(struck):
            part, step = now[:, struck], np.full(int(struck.sum()), h)
            for _ in range(8):
                end = classical(part, step)
                step = step - end[:2].sum(axis=0) / end[2:].sum(axis=0)
            after[:, walking[struck]] = classical(part, step)
        y[:, walking] = new
        walking = walking[~struck & (np.abs(new[0]) < 1.5)]
        if len(walking) == 0:
            break
    angle = -after[0]
    cosine = np.cos(2.0 * angle)
    swing_rate = cosine * (1.0 - cosine) * after[2]  # of phi; the swing leg's is the difference
    rate = cosine * after[2]
    return np.stack([angle, -angle, -angle, rate, rate - swing_rate, rate - swing_rate], axis=1)


@case(
    TOPIC,
    "Chaotic steps have the same mean and spread at tolerances 10⁻⁵, 10⁻⁹ and 10⁻¹³, and by a "
    "fixed-step integration of the printed equations",
    quick=40, long=400, bound=4.5, unit="standard error",
)  # fmt: skip
def statistics(count: int, rng: np.random.Generator) -> Finding:
    """Test with each walker's mean over its strides as a sample.

    Trajectories of different methods agree for some strides only.
    """
    origin = start(gaits("D", SLOPE)[0])
    methods = [
        lambda states: engine_stride(states, 1e-5),
        lambda states: engine_stride(states, 1e-9),
        lambda states: engine_stride(states, 1e-13),
        lambda states: classical_stride(states, 0.05),
    ]
    means, errors, failed = [], [], 0
    for take in methods:
        states = origin * (1.0 + 1e-3 * rng.normal(size=(count, 1)))
        seen = []
        for index in range(FORGOTTEN + count):
            states = take(states)
            if index >= FORGOTTEN:
                seen.append(states[:, 0])
        steps = np.array(seen)
        failed += int(np.isnan(steps[-1]).sum())
        samples = np.array([steps.mean(axis=0), (steps**2).mean(axis=0)])
        means.append(samples.mean(axis=1))
        errors.append(samples.std(axis=1, ddof=1) / np.sqrt(count))
    apart = [
        np.abs(means[i] - means[j]) / np.hypot(errors[i], errors[j])
        for i in range(len(methods))
        for j in range(i)
    ]
    return Finding(count * count * len(methods), failed, float(np.max(apart)))
