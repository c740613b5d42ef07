"""Section 4.5.2 and Figs. 4.6 and 4.12: the laboratory's walker with knees free and locked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import gym_passive_walker as gpw
from gym_passive_walker import GaitFamily
from validation.rows import Row, claim, listed, number
from validation.walks import (
    KINDS,
    KNEE_MEETS_HEEL,
    STANCE_STOPS,
    TANGENTIAL,
    boundary,
    family,
    gait,
    numbers_of_gaits,
)


def _shown(found: GaitFamily) -> NDArray[np.intp]:
    """Indices of the gaits in the printed figure: their stance leg never turns back in a stride."""
    before = np.arange(len(found)) < np.argmin(found.slope)
    return np.flatnonzero(~(before & (found.slope > found.halts[0])))


def _slowest(found: GaitFamily) -> tuple[float, float]:
    """Slope in rad of the slowest gait in the printed figure, and its speed over sqrt(g l)."""
    shown = _shown(found)
    slowest = shown[np.argmin(found.froude_speed[shown])]
    return float(found.slope[slowest]), float(found.froude_speed[slowest])


def _scuffing(found: GaitFamily) -> NDArray[np.bool_]:
    """Whether the foot scuffs, for a sample of the gaits in the printed figure."""
    checks = [
        gpw.reality_check(found.walker, float(found.slope[i]), found.state[i], tolerance=1e-10)
        for i in _shown(found)[2:-2:6]
    ]
    return np.array([check.clearance.value < 0.0 for check in checks])


def laboratory() -> Iterator[Row]:
    """The observations under Fig. 4.6."""
    kneed, straight = family("lab", 0.01, 0.1), family("lab-straight", 0.01, 0.1)
    short = family("lab-straight", 0.05, 0.1, "short")
    counts = [
        numbers_of_gaits([name], (0.012, 0.03, 0.05, 0.07)) for name in ("lab", "lab-straight")
    ]
    yield claim(
        "Fig. 4.6 (1) | gaits at slopes 0.012, 0.03, 0.05, 0.07, with knees; and straight | "
        "0, 1 or 2",
        "; ".join(listed(each) for each in counts),
        counts == [[0, 1, 2, 0], [0, 1, 1, 2]],
    )
    least = min(np.abs(found.multipliers[:, 0]).min() for found in (straight, short))
    said = (
        "Fig. 4.6 (2) | straight legs: no gait is stable; least of the largest multipliers | "
        "above 1"
    )
    yield claim(said, f"{least:.4f}", least > 1.0)
    foot, top = int(np.argmin(kneed.slope)), int(np.argmax(kneed.slope))
    yield claim(
        "Fig. 4.6 (2) | knees: only a section is stable, from fold to fold | a section",
        f"{kneed.folds[0]:.10f} to {kneed.folds[1]:.10f}",
        abs(kneed.folds[0] - 0.0191228797) < 1e-9
        and abs(kneed.folds[1] - 0.0530371064) < 1e-9
        and np.all(kneed.stable[foot + 1 : top - 1])
        and not kneed.stable[: foot - 1].any()
        and not kneed.stable[top + 1 :].any(),
    )
    end = kneed.ends[1]
    said = f"Fig. 4.6 (3) | how the curve with knees ends, point 1 | {KNEE_MEETS_HEEL}"
    yield claim(said, f"{end.reason}, at slope {end.value:.8f}", end.reason == KNEE_MEETS_HEEL)
    end = short.ends[0]
    said = f"Fig. 4.6 (3) | how the straight-legged short step ends, point 2 | {TANGENTIAL}"
    yield claim(said, end.reason, end.reason == TANGENTIAL)
    yield number("Fig. 4.6 (3) | and at which slope | 0.056", end.value, digits=7)
    halts = [found.halts[0] for found in (kneed, straight)]
    yield claim(
        f"Fig. 4.6 (4) | how the long step's slow end is reached, with knees; and straight | "
        f"{STANCE_STOPS}",
        f"so at slope {halts[0]:.5f}; at {halts[1]:.5f}",
        all(STANCE_STOPS in found.ends[0].reason for found in (kneed, straight)),
        remark="The curve itself goes on, with a stance leg that turns back for a while, to slope "
        f"{kneed.ends[0].value:.6f}, where heelstrike becomes tangential.",
    )
    slowest = [_slowest(found) for found in (kneed, straight)]
    yield claim(
        f"Fig. 4.6 (4) | the slowest gait is there: slope of the least v/√(g l), with knees; "
        f"and straight | {halts[0]:.4f}; {halts[1]:.4f}",
        "; ".join(f"{slope:.4f} ({speed:.4f})" for slope, speed in slowest),
        all(abs(slope - halt) < 2e-4 for (slope, _), halt in zip(slowest, halts, strict=True)),
    )
    scuffs, drags = _scuffing(kneed), np.append(_scuffing(straight), True)
    yield claim(
        "Fig. 4.6 (5) | all straight gaits scuff, and some with knees: shares of a sample | "
        "all, and some",
        f"{drags.mean():.0%}, {scuffs.mean():.0%}",
        drags.all() and 0.0 < scuffs.mean() < 1.0,
    )
    said = "Fig. 4.6 (6) | least slope with straight legs | 0.016"
    why = (
        "Print has “about”. The document stops where the stance leg barely passes the vertical, at "
        f"{halts[1]:.6f}; the curve folds just below."
    )
    yield number(said, straight.folds[0], known="0.0153620977", digits=9, remark=why)
    said = "Fig. 4.6 (6) | least slope with knees | 0.02"
    yield number(said, kneed.folds[0], known="0.0191228797", digits=9)


def _crossing(name: str, low: float, high: float) -> float:
    """The slope in rad at which the long-step and the short-step gait are equally fast."""

    def long_is_faster(slope: float) -> bool:
        return gait(name, slope).speed > gait(name, slope, "short").speed

    return 0.5 * sum(boundary(low, high, long_is_faster, 1e-6))


def speeds() -> Iterator[Row]:
    """Section 4.9: which gait is faster."""
    brackets = {**dict.fromkeys("ABCEF", (1e-3, 0.1)), "lab": (0.038, 0.05)}
    crossings = {name: _crossing(name, *bracket) for name, bracket in brackets.items()}
    yield claim(
        "4.9 | slope above which the short step is the faster: A, B, C, E, F, lab | long at "
        "lower, short at higher",
        listed(crossings.values(), ".4f"),
        all(low + 1e-5 < crossings[name] < high - 1e-5 for name, (low, high) in brackets.items()),
    )
    slopes = np.geomspace(1e-8, 0.1, 15)
    ratios = [gait("D", float(x)).speed / gait("D", float(x), "short").speed for x in slopes]
    said = (
        "4.9 | D: speed of the long step over the short one's, slopes from 1e-8 to 0.1 | "
        "below 1 throughout"
    )
    yield claim(said, f"{min(ratios):.3f} to {max(ratios):.3f}", max(ratios) < 1.0)
    pairs = [
        [gait(name, slope, kind).step_period for kind in KINDS]
        for name in "ABCDEF"
        for slope in (1e-3, 0.03)
    ]
    longer = sum(long > short for long, short in pairs)
    said = "4.9 | long steps take the longer time: A to F at 0.001 and 0.03 | all"
    yield claim(said, f"{longer} of {len(pairs)}", longer == len(pairs))
