"""Section 4.5.2 and Figs. 4.6 and 4.12: the laboratory's walker, its knees free and locked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.gaits.ends import KNEE_MEETS_HEEL, STANCE_STOPS, TANGENTIAL
from gym_passive_walker.gaits.family import GaitFamily
from gym_passive_walker.gaits.fixed_point import find_gaits
from gym_passive_walker.gaits.reality import reality_check
from gym_passive_walker.validation.rows import Row, claim, family, gait, number

_FIGURES = "Fig. 4.6"


def _shown(found: GaitFamily) -> NDArray[np.bool_]:
    """Which gaits the document has: those whose stance leg does not turn back in mid-stride."""
    before = np.arange(len(found)) < np.argmin(found.slope)
    return ~(before & (found.slope > found.halts[0]))


def _slowest(found: GaitFamily) -> tuple[float, float]:
    """Least speed over sqrt(g l) of the gaits that the document has, and the slope there."""
    shown = np.flatnonzero(_shown(found))
    slowest = shown[np.argmin(found.froude_speed[shown])]
    return float(found.froude_speed[slowest]), float(found.slope[slowest])


def _scuffing(found: GaitFamily) -> NDArray[np.bool_]:
    """Whether the foot scuffs, gait by gait along what the document has."""
    some = np.flatnonzero(_shown(found))[2:-2:6]
    checks = (
        reality_check(found.walker, float(found.slope[i]), found.state[i], tolerance=1e-10)
        for i in some
    )
    return np.array([check.clearance.value < 0.0 for check in checks])


def laboratory() -> list[Row]:
    """The observations under Fig. 4.6."""
    kneed = family("lab", 0.01, 0.1)
    straight = family("lab-straight", 0.01, 0.1)
    short = family("lab-straight", 0.05, 0.1, "short")
    scuffs, drags = _scuffing(kneed), np.append(_scuffing(straight), True)
    slow = {name: _slowest(found) for name, found in (("lab", kneed), ("straight", straight))}
    counts = {
        name: [len(find_gaits(name, slope)) for slope in (0.012, 0.03, 0.05, 0.07)]
        for name in ("lab", "lab-straight")
    }
    least = min(np.abs(found.multipliers[:, 0]).min() for found in (straight, short))
    foot, top = int(np.argmin(kneed.slope)), int(np.argmax(kneed.slope))
    beyond = (
        "The curve itself goes on, with a stance leg that turns back for a while, to slope "
        f"{kneed.ends[0].value:.6f}, where heelstrike becomes tangential."
    )
    return [
        claim(
            f"{_FIGURES} (1)",
            "gaits at slopes 0.012, 0.03, 0.05, 0.07, with knees; and straight",
            "0, 1 or 2",
            "; ".join(", ".join(str(n) for n in each) for each in counts.values()),
            counts == {"lab": [0, 1, 2, 0], "lab-straight": [0, 1, 1, 2]},
        ),
        claim(
            f"{_FIGURES} (2)",
            "straight legs: no gait is stable; least of the largest multipliers",
            "above 1",
            f"{least:.4f}",
            bool(least > 1.0),
        ),
        claim(
            f"{_FIGURES} (2)",
            "knees: only a section is stable, from fold to fold",
            "a section",
            f"{kneed.folds[0]:.10f} to {kneed.folds[1]:.10f}",
            bool(
                abs(kneed.folds[0] - 0.0191228797) < 1e-9
                and abs(kneed.folds[1] - 0.0530371064) < 1e-9
                and np.all(kneed.stable[foot + 1 : top - 1])
                and not kneed.stable[: foot - 1].any()
                and not kneed.stable[top + 1 :].any()
            ),
        ),
        claim(
            f"{_FIGURES} (3)",
            "how the curve with knees ends, point 1",
            KNEE_MEETS_HEEL,
            f"{kneed.ends[1].reason}, at slope {kneed.ends[1].value:.8f}",
            kneed.ends[1].reason == KNEE_MEETS_HEEL,
        ),
        claim(
            f"{_FIGURES} (3)",
            "how the straight-legged short step ends, point 2",
            TANGENTIAL,
            short.ends[0].reason,
            short.ends[0].reason == TANGENTIAL,
        ),
        number(f"{_FIGURES} (3)", "and at which slope", "0.056", short.ends[0].value, digits=7),
        claim(
            f"{_FIGURES} (4)",
            "how the long step's slow end is reached, with knees; and straight",
            STANCE_STOPS,
            f"so at slope {kneed.halts[0]:.5f}; at {straight.halts[0]:.5f}",
            all(STANCE_STOPS in found.ends[0].reason for found in (kneed, straight)),
            remark=beyond,
        ),
        claim(
            f"{_FIGURES} (4)",
            "the slowest gait is there: slope of the least v/√(g l), with knees; and straight",
            f"{kneed.halts[0]:.4f}; {straight.halts[0]:.4f}",
            "; ".join(f"{slope:.4f} ({speed:.4f})" for speed, slope in slow.values()),
            abs(slow["lab"][1] - kneed.halts[0]) < 2e-4
            and abs(slow["straight"][1] - straight.halts[0]) < 2e-4,
        ),
        claim(
            f"{_FIGURES} (5)",
            "all straight gaits scuff, and some with knees: shares of a sample",
            "all, and some",
            f"{drags.mean():.0%}, {scuffs.mean():.0%}",
            bool(drags.all() and 0.0 < scuffs.mean() < 1.0),
        ),
        number(
            f"{_FIGURES} (6)",
            "least slope with straight legs",
            "0.016",
            straight.folds[0],
            known="0.0153620977",
            digits=9,
            remark="Print has “about”. The document stops where the stance leg barely passes the "
            f"vertical, at {straight.halts[0]:.6f}; the curve folds just below.",
        ),
        number(
            f"{_FIGURES} (6)",
            "least slope with knees",
            "0.02",
            kneed.folds[0],
            known="0.0191228797",
            digits=9,
        ),
    ]


def _crossing(name: str, low: float, high: float) -> float:
    """The slope at which long and short step are equally fast."""
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        faster = gait(name, middle).speed > gait(name, middle, "short").speed
        low, high = (middle, high) if faster else (low, middle)
    return 0.5 * (low + high)


def speeds() -> list[Row]:
    """Section 4.9: which gait is the faster."""
    brackets = {
        "A": (1e-3, 0.1),
        "B": (1e-3, 0.1),
        "C": (1e-3, 0.1),
        "E": (1e-3, 0.1),
        "F": (1e-3, 0.1),
        "lab": (0.038, 0.05),
    }
    crossings = {name: _crossing(name, *bracket) for name, bracket in brackets.items()}
    slopes = np.geomspace(1e-8, 0.1, 15)
    ratios = [gait("D", float(x)).speed / gait("D", float(x), "short").speed for x in slopes]
    periods = [
        gait(name, slope).step_period - gait(name, slope, "short").step_period
        for name in "ABCDEF"
        for slope in (1e-3, 0.03)
    ]
    return [
        claim(
            "4.9",
            "slope above which the short step is the faster: A, B, C, E, F, lab",
            "long at lower, short at higher",
            ", ".join(f"{slope:.4f}" for slope in crossings.values()),
            all(
                bracket[0] + 1e-5 < crossings[name] < bracket[1] - 1e-5
                for name, bracket in brackets.items()
            ),
        ),
        claim(
            "4.9",
            "D: speed of the long step over the short one's, slopes from 1e-8 to 0.1",
            "below 1 throughout",
            f"{min(ratios):.3f} to {max(ratios):.3f}",
            max(ratios) < 1.0,
        ),
        claim(
            "4.9",
            "long steps take the longer time: A to F at 0.001 and 0.03",
            "all",
            f"{sum(gap > 0.0 for gap in periods)} of {len(periods)}",
            all(gap > 0.0 for gap in periods),
        ),
    ]
