"""Order of the method, and error as a function of the tolerance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.stress_cases.case import Finding, case
from benchmarks.stress_cases.flight import Flock, flock
from benchmarks.stress_cases.gaits import every_gait, near
from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.engine.layout import PAIR
from gym_passive_walker.engine.run import new_records

TOPIC = "Accuracy"
WHOLE = 0.4  # time in sqrt(l/g) that the fixed steps cover
ANY_ERROR = 1e12  # a tolerance that every step meets


def fixed_steps(mine: Flock, states: NDArray, count: int) -> NDArray[np.float64]:
    """States (n, 6) at time `WHOLE`, after `count` equal steps; NaN if an event divided a step."""
    records = new_records(states, 0.05, end=0.0)[:, 0]
    for step in range(1, count + 1):
        records["end"], records["step"] = WHOLE * step / count, 2.0 * WHOLE
        mine.go_on(records, tolerance=ANY_ERROR)
    states = records["state"]
    states[records["steps"] != count] = np.nan  # an event divided a step
    return states


@case(
    TOPIC,
    f"Halving fixed steps divides the error by 2 to the {PAIR.order}",
    quick=30, long=3_000, bound=0.3, unit=f"order less {PAIR.order}, at the median",
)  # fmt: skip
def order(count: int, rng: np.random.Generator) -> Finding:
    """Test the first phase of each kind, with steps so long that rounding errors are negligible."""
    tried, failed, worst = 0, 0, 0.0
    for name, steps in (("lab", 2), ("A", 1), ("D", 1)):
        mine = flock(WALKERS[name])
        states = np.zeros((count, 6))
        states[:, 0] = rng.uniform(-0.2, 0.2, count)
        states[:, 1] = rng.uniform(0.6, 0.9, count)
        states[:, 2] = states[:, 1] - (1.2 if mine.kneed else 0.0)
        states[:, 3:] = rng.normal(scale=0.1, size=(count, 3))
        if not mine.kneed:
            states[:, 5] = states[:, 4]
        exact = fixed_steps(mine, states, 16 * steps)
        whole, halved = (
            np.abs(fixed_steps(mine, states, n) - exact).max(axis=1) for n in (steps, 2 * steps)
        )
        orders = np.log2(whole / halved)
        orders = orders[np.isfinite(orders)]
        tried += len(orders)
        failed += int(len(orders) < 0.5 * count)
        worst = max(worst, abs(float(np.median(orders)) - PAIR.order))
    return Finding(tried, failed, worst)


@case(
    TOPIC,
    "Over nine decades of tolerance, 10⁻⁴ to 10⁻¹³, the error of a stride falls in proportion",
    quick=30, long=3_000, bound=0.25, unit="exponent less 1, for each gait",
)  # fmt: skip
def proportional(count: int, rng: np.random.Generator) -> Finding:
    """Test the median error of the next state, over driven strides from near each gait.

    Coarser tolerances would change little, because steps are limited to less than a swing.
    """
    tried, worst = 0, 0.0
    tolerances = 10.0 ** np.arange(-4.0, -13.5, -1.0)
    medians = []
    for _, gait in every_gait():
        mine = flock(gait.walker)
        states = near(gait, rng, count, 0.02)
        options = {"slope": gait.slope, "torque": 0.003}
        exact = mine.follow(states, tolerance=1e-15, **options)
        walked = exact["outcome"] == Outcome.HEELSTRIKE
        errors = [
            np.abs(mine.follow(states, tolerance=t, **options)["state"] - exact["state"])
            for t in tolerances
        ]
        errors = [error[walked].max(axis=1) for error in errors]
        medians.append(np.median(errors, axis=1))
        exponent = np.polyfit(np.log(tolerances), np.log(medians[-1]), 1)[0]
        tried += int(walked.sum()) * len(tolerances)
        worst = max(worst, abs(float(exponent) - 1.0))
    falling = np.diff(np.median(medians, axis=0)) < 0.0
    return Finding(tried, int((~falling).sum()), worst)
