"""Section 4.7 and Fig. 4.10: period doubling and chaos of the tuned kneed walker."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gym_passive_walker.gaits.bifurcation import bifurcation_diagram, crisis_slope
from gym_passive_walker.gaits.doubling import FEIGENBAUM, doubling_cascade
from gym_passive_walker.gaits.family import gait_family
from gym_passive_walker.validation.rows import Row, claim, number, tuned
from gym_passive_walker.walkers import WALKERS, Walker

_ROUNDED = {
    "thigh_offset": 5e-4,
    "thigh_mass": 5e-4,
    "thigh_gyration": 5e-5,
    "thigh_com": 5e-4,
    "shank_offset": 5e-4,
    "shank_mass": 5e-4,
    "shank_gyration": 5e-5,
    "shank_com": 5e-4,
    "foot_angle": 5e-4,
}
"""Half a unit in the last digit that Table 4.1 has for C's masses and where they lie."""


def _doubling(walker: Walker) -> float:
    return gait_family(walker, 0.06, 0.12, resolution=0.1).period_doublings[0]


def latest_doubling() -> Walker:
    """Of the walkers that round to Table 4.1's C, nearly the one whose period doubles latest."""
    c = WALKERS["C"]
    changes = {}
    for name, half in _ROUNDED.items():
        value = getattr(c, name)
        ends = (value - half, value + half)
        changes[name] = max(ends, key=lambda end: _doubling(replace(c, **{name: end})))
    return replace(c, **changes)


def kneed_chaos() -> list[Row]:
    """Section 4.7."""
    walker, table = tuned("C"), WALKERS["C"]
    cascade = doubling_cascade(walker, 0.06, 0.12, doublings=6)
    crisis = crisis_slope(walker, 0.09, 0.12, strides=1000, accuracy=1e-6)
    bounds = [0.076, *cascade.slopes[:4]]
    slopes = 0.5 * (np.array(bounds[:-1]) + bounds[1:])
    periods = bifurcation_diagram(walker, slopes).period
    extreme = latest_doubling()
    latest = _doubling(extreme)
    ends = [crisis_slope(w, 0.09, 0.13, strides=400, accuracy=1e-5) for w in (table, extreme)]
    rounding = "So the print lies at the edge of what Table 4.1's rounding leaves open."
    return [
        number(
            "4.7",
            "slope where C's gait of period one becomes unstable",
            "0.084",
            cascade.slopes[0],
            known="0.0768533651",
            digits=11,
            remark=f"For C exactly tuned; {_doubling(table):.5f} for the table's digits, and "
            f"{latest:.5f} for the walker among those that round to them that doubles latest. "
            + rounding,
        ),
        claim(
            "4.7",
            "periods of the walks that it settles on, between doublings",
            "1, 2, 4, …",
            ", ".join(str(period) for period in periods),
            periods.tolist() == [1, 2, 4, 8],
            remark="The doublings: " + ", ".join(f"{x:.9f}" for x in cascade.slopes) + ".",
        ),
        number(
            "Feigenbaum 1978",
            "last ratio of distances between C's doublings",
            f"{FEIGENBAUM:.5f}",
            cascade.ratios[-1],
            within=0.005,
            remark="The ratios are " + ", ".join(f"{ratio:.4f}" for ratio in cascade.ratios) + ".",
        ),
        number(
            "4.7",
            "slope up to which C walks at all",
            "0.103",
            crisis,
            known="0.0965",
            digits=5,
            remark=f"Likewise {ends[0]:.4f} for the table's digits and {ends[1]:.4f} for the "
            "walker that doubles latest.",
        ),
        claim(
            "4.7",
            "the first doubling comes at a higher slope than the simplest walker's 0.015",
            "higher",
            f"{cascade.slopes[0] / 0.0150884379:.2f} times",
            cascade.slopes[0] > 0.0150884379,
        ),
    ]
