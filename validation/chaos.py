"""Sections 4.4 and 4.7, Fig. 4.10: period doubling and chaos, of the simplest walker and of C."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker import WALKERS, Cascade, Walker
from validation.rows import Row, claim, listed, number
from validation.walks import TUNED

_D_DOUBLES = "0.0150884379"
"""Recorded slope in rad where the simplest walker's long step doubles its period."""

_ROUNDED = {
    **dict.fromkeys(("thigh_mass", "thigh_com", "thigh_offset"), 5e-4),
    **dict.fromkeys(("shank_mass", "shank_com", "shank_offset", "foot_angle"), 5e-4),
    **dict.fromkeys(("thigh_gyration", "shank_gyration"), 5e-5),
}
"""Half a unit in the last digit of Table 4.1, for the masses of walker C and their positions."""


def _feigenbaum(cascade: Cascade, what: str) -> Row:
    """Row on the ratio of distances between doublings, which tends to Feigenbaum's number."""
    remark = f"The ratios are {listed(cascade.ratios, '.4f')}."
    return number(
        f"Feigenbaum 1978 | {what} | 4.66920", cascade.ratios[-1], within=0.005, remark=remark
    )


def simplest_walker() -> Iterator[Row]:
    """Section 4.4: the period-doubling route, and the gait of period three."""
    cascade = gpw.doubling_cascade("D", 0.012, 0.02, doublings=6)
    first, *_ = cascade.slopes
    yield number(
        "4.4 | period doubling begins at slope | 0.015", first, known=_D_DOUBLES, digits=11
    )
    said = "4.4 | chaotic walking ends at slope | 0.019"
    why = "Where one of 64 walkers falls within 1000 strides."
    yield number(
        said, gpw.crisis("D", 0.0185, 0.02, strides=1000, accuracy=1e-6), digits=5, remark=why
    )
    said = "4.4 | slopes at which gaits of period 1, 2, 4, … double | 0.015 to 0.019"
    why = f"They accumulate at {cascade.limit:.8f}."
    yield claim(
        said, listed(cascade.slopes, ".9f"), 0.0145 < first and cascade.limit < 0.0195, remark=why
    )
    yield _feigenbaum(cascade, "last ratio of their distances")
    beyond = gpw.bifurcation_diagram("D", [0.0195, 0.02]).walks
    left = str(int(beyond.sum()))
    yield claim("4.4 | walks left at slopes 0.0195 and 0.02 | 0", left, not beyond.any())
    three = gpw.gait_family("D", 0.012, 0.0135, start=gpw.find_gait("D", 0.0125, period=3))
    born, doubled = three.folds[0], three.period_doublings[-1]
    said = (
        "Howell, Baillieul 1998 | a stable gait of period three near slope 0.0125, which doubles "
        "to period six | near 0.0125"
    )
    why = "Born in a fold at the first slope, doubled at the second."
    yield claim(said, f"{born:.9f} to {doubled:.9f}", born < 0.0125 < doubled < 0.013, remark=why)


def _doubling(walker: Walker) -> float:
    return gpw.gait_family(walker, 0.06, 0.12, resolution=0.1).period_doublings[0]


def latest_doubling() -> Walker:
    """Walker that rounds to C of Table 4.1 and doubles its period at nearly the largest slope."""
    c = WALKERS["C"]
    changes = {}
    for name, half in _ROUNDED.items():
        value = getattr(c, name)
        ends = (value - half, value + half)
        changes[name] = max(ends, key=lambda end: _doubling(replace(c, **{name: end})))
    return replace(c, **changes)


def kneed_walker() -> Iterator[Row]:
    """Section 4.7: period doubling and chaos of the tuned kneed walker C."""
    walker, of_table, extreme = TUNED["C"], WALKERS["C"], latest_doubling()
    cascade = gpw.doubling_cascade(walker, 0.06, 0.12, doublings=6)
    first, *_ = cascade.slopes
    said = "4.7 | slope where C's gait of period one becomes unstable | 0.084"
    why = (
        f"For C exactly tuned; {_doubling(of_table):.5f} for the table's digits, and "
        f"{_doubling(extreme):.5f} for the walker among those that round to them that doubles "
        "latest. So the print lies at the edge of what Table 4.1's rounding leaves open."
    )
    yield number(said, first, known="0.0768533651", digits=11, remark=why)
    bounds = np.array([0.076, *cascade.slopes[:4]])
    periods = gpw.bifurcation_diagram(walker, 0.5 * (bounds[:-1] + bounds[1:])).period
    said = "4.7 | periods of the walks that it settles on, between doublings | 1, 2, 4, …"
    why = f"The doublings: {listed(cascade.slopes, '.9f')}."
    yield claim(said, listed(periods), periods.tolist() == [1, 2, 4, 8], remark=why)
    yield _feigenbaum(cascade, "last ratio of distances between C's doublings")
    ends = [
        gpw.crisis(each, 0.09, 0.13, strides=400, accuracy=1e-5) for each in (of_table, extreme)
    ]
    yield number(
        "4.7 | slope up to which C walks at all | 0.103",
        gpw.crisis(walker, 0.09, 0.12, strides=1000, accuracy=1e-6),
        known="0.0965",
        digits=5,
        remark=f"It is {ends[0]:.4f} for the table's digits and {ends[1]:.4f} for the walker "
        "that doubles latest.",
    )
    said = (
        "4.7 | the first doubling comes at a higher slope than the simplest walker's 0.015 | higher"
    )
    yield claim(said, f"{first / float(_D_DOUBLES):.2f} times", first > float(_D_DOUBLES))
