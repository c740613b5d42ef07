"""How a family of gaits ends, and where: what a stride at its end is about to lose.

A family can only end where the stride map itself has an edge: where kneestrike comes as late as
heelstrike, or where the foot no longer comes down at heelstrike but glides along the ground. What
is lost goes to zero smoothly along the family, so the end is found by going there in steps and
extrapolating the rest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.stride_map import StrideMap

KNEE_MEETS_HEEL = "kneestrike and heelstrike coincide"
STANCE_STOPS = "the stance leg barely passes the vertical"
TANGENTIAL = "heelstrike becomes tangential"
BOUND = "end of the range asked for"
VANISHED = "the step length goes to zero"
STEP_ENDS = "a strike comes as a control step ends"
LOST = "the family could not be followed further"

_VERGE = 1e-9  # of a stride, before its heelstrike
_LOOKS, _ROUGHLY = 96, 1e-9  # at the stance leg during a stride, and their tolerance
_NEAR = 0.3  # a margin below this is about to be lost
_TINY = 1e-3  # stance angle of steps that are about to vanish
_AT_ONCE = 1e-3  # of a control step: a strike so near to its end comes with it
_ENDLESS = 12.0  # time in sqrt(l/g) of a stride that hardly gets over the vertical


class End(NamedTuple):
    """Where a family ends.

    Attributes:
        value: Slope in rad, or the parameter's value.
        reason: Why it ends there.
    """

    value: float
    reason: str


class Margins(NamedTuple):
    """How far strides are from failing, (n,) each; the least of a gait's several strides.

    Attributes:
        knee: Time from kneestrike to heelstrike over the stride's; infinite without knees.
        landing: Rate at which the legs close just before heelstrike, over the larger of theirs.
        pace: Least rate of the stance leg in mid-stride over its first; negative where it turns
            back for a while.
        time: Duration of the longest stride.
    """

    knee: NDArray[np.float64]
    landing: NDArray[np.float64]
    pace: NDArray[np.float64]
    time: NDArray[np.float64]


def margins(stride_map: StrideMap, points: NDArray, slopes: NDArray, period: int) -> Margins:
    """How far gaits are from where their strides fail.

    Args:
        stride_map: Of one walker, or of one for each gait.
        points: Points of the section, (n, m).
        slopes: rad, (n,).
        period: Strides of each gait.
    """
    knee, landing, pace = (np.full(len(points), np.inf) for _ in range(3))
    time = np.zeros(len(points))
    roughly = stride_map.with_tolerance(_ROUGHLY)
    for _ in range(period):
        passage = stride_map.apply(points, slopes)
        duration = passage.durations
        verge = (duration * (1.0 - _VERGE))[:, None]
        rates = stride_map.sample(points, slopes, verge).states[:, 0, 3:5]
        landing = np.minimum(landing, -rates.sum(axis=1) / np.abs(rates).max(axis=1))
        knee = np.fmin(knee, 1.0 - passage.knee_times / duration)  # without knees it stays infinite
        times = duration[:, None] * np.linspace(0.0, 1.0 - _VERGE, _LOOKS)
        stance_rates = roughly.sample(points, slopes, times).states[:, :, 3]
        pace = np.minimum(pace, np.min(stance_rates / points[:, 1:2], axis=1))
        time = np.maximum(time, duration)
        points = passage.ends
    return Margins(knee, landing, pace, time)


def reason_of(
    stride_map: StrideMap, points: NDArray, slopes: NDArray, values: NDArray, period: int
) -> End:
    """Why and where a family ends whose last gaits are given.

    Args:
        stride_map: Of one walker, or of one for each gait.
        points: Points of the last gaits, (n, m), the last one last.
        slopes: rad, (n,).
        values: The varied quantity, (n,).
        period: Strides of each gait.
    """
    if math.isfinite(stride_map.hold):
        # There a controller observes the walker before the strike or after it.
        last = stride_map.apply(points[-1:], slopes[-1:], strides=1)
        steps = np.array([last.knee_times[0], last.durations[0]]) / stride_map.hold
        if np.nanmin(np.abs(steps - np.round(steps))) < _AT_ONCE:
            return End(float(values[-1]), STEP_ENDS)
    left = margins(stride_map, points, slopes, period)
    near = {
        reason: (_vanishing(margin, values), margin[-1])
        for reason, margin, least in (
            (KNEE_MEETS_HEEL, left.knee, _NEAR),
            (TANGENTIAL, left.landing, _NEAR),
            (VANISHED, points[:, 0], _TINY),
        )
        if margin[-1] <= least
    }
    if not near:
        stopped = left.time[-1] > _ENDLESS
        return End(float(values[-1]), STANCE_STOPS if stopped else LOST)
    # What is lost first is nearest, whichever margin is the smaller.
    running_out = {reason: end for reason, (end, _) in near.items() if end is not None}
    if not running_out:
        return End(float(values[-1]), min(near, key=lambda reason: near[reason][1]))
    reason = min(running_out, key=lambda reason: abs(running_out[reason] - values[-1]))
    return End(running_out[reason], reason)


def _vanishing(margin: NDArray, values: NDArray) -> float | None:
    """Where a margin that runs out would be zero; None if it does not run out.

    By a polynomial in the margin through gaits that differ by it; noise would spoil near ones.
    """
    chosen = [len(margin) - 1]
    for i in range(len(margin) - 2, -1, -1):
        if margin[i] > 1.4 * margin[chosen[-1]] + 1e-6 and margin[i] < 2.0 * _NEAR:
            chosen.append(i)
    chosen = chosen[:5]
    if len(chosen) == 1:
        return None
    powers = np.vander(margin[chosen], increasing=True)
    base = values[-1]
    return float(base + np.linalg.solve(powers, values[chosen] - base)[0])
