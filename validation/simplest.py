"""Sections 4.3.3, 4.3.4 and 4.4: the cost of transport, and the simplest walker."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker import WALKERS, Gait, Walker
from validation.rows import Row, claim, listed, number
from validation.walks import KINDS, exponents, family, gait, numbers_of_gaits, sliding

_EXAMPLES = {"A": 0.03, "B": 0.01, "C": 0.05, "D": 0.009, "E": 0.02, "lab": 0.045}
_EXAMINED = "Long and short gaits of A, B, C, D, E and lab."


def _loss_by_matrix(walks: Gait) -> float:
    velocity = np.array(gpw.foot_velocity(walks))
    matrix = gpw.collision_matrix(walks.walker, float(walks.stride.state[0]))
    return float(0.5 * velocity @ matrix @ velocity)


def _taller(walker: Walker) -> Walker:
    """The walker 100 times taller, with a tenth of the mass."""
    lengths = ("length", "offset", "gyration", "com", "radius")
    factors = {
        name: 100.0 if name.rpartition("_")[2] in lengths else 0.1
        for name in asdict(walker)
        if name.rpartition("_")[2] in (*lengths, "mass")
    }
    return replace(walker, **{n: factor * getattr(walker, n) for n, factor in factors.items()})


def costs() -> Iterator[Row]:
    """Sections 4.3.3 and 4.3.4: costs, speeds and collisions."""
    examples = [gait(name, slope, kind) for name, slope in _EXAMPLES.items() for kind in KINDS]
    worst = max(abs(walks.cost_of_transport / math.sin(walks.slope) - 1.0) for walks in examples)
    said = "Eq. 4.4 | cost of transport along the path | sin γ"
    yield claim(said, f"within {max(worst, 1e-12):.0e} of it", worst < 1e-11, remark=_EXAMINED)
    said = (
        "Eq. 4.5 | sin γ and tan γ are the inefficiency γ: tan γ / sin γ at Table 4.2's 0.052 | 1"
    )
    yield number(said, 1.0 / math.cos(0.052), within=2e-3)
    small, big = gait("lab", 0.036), gait(_taller(WALKERS["lab"]), 0.036)
    power = (big.collision_loss / big.step_period) / (small.collision_loss / small.step_period)
    said = "4.3.3 | speed of a walker 100 times taller with a tenth of the mass | 10"
    yield number(said, big.speed / small.speed, within=1e-10, digits=12)
    yield number("4.3.3 | its power | 1", power, within=1e-10, digits=12)
    said = "Eq. 4.6 | its v/√(g l), over the small one's | 1"
    yield number(said, big.froude_speed / small.froude_speed, within=1e-10, digits=12)
    off = max(abs(_loss_by_matrix(walks) / walks.heelstrike_loss - 1.0) for walks in examples)
    said = (
        "Eq. 4.7 | energy lost at heelstrike is ½ vᵀM v, M symmetric and positive "
        "semidefinite | equal"
    )
    yield claim(said, f"within {max(off, 1e-12):.0e}", off < 1e-9, remark=_EXAMINED)


def simplest_walker() -> Iterator[Row]:
    """Section 4.4, except chaos."""
    counts = set(numbers_of_gaits(["D"], np.geomspace(1e-8, 0.1, 12)))
    said = "4.4 | gaits at each of 12 slopes from 1e-8 to 0.1 | 2"
    yield claim(said, listed(sorted(counts)), counts == {2})
    short, long = family("D", 1e-8, 0.3, "short"), family("D", 1e-8, 0.3)
    said = "4.4 | slope below which the long step is stable | 0.015"
    yield number(said, long.period_doublings[0], known="0.0150884379", digits=11)
    least = np.abs(short.multipliers[:, 0]).min()
    said = (
        "4.4 | the short step is unstable at all slopes: least of its largest multipliers | above 1"
    )
    yield claim(said, f"{least:.4f}", least > 1.0)
    slides = {kind: [sliding("D", slope, kind) for slope in (1e-3, 1e-5, 1e-7)] for kind in KINDS}
    said = (
        "4.4 | long step: foot's tangential over normal velocity at 0.001, 1e-5, 1e-7 | tends to 0"
    )
    yield claim(said, listed(slides["long"], ".1e"), slides["long"][-1] < 1e-4)
    said = "4.4 | short step: the same | not 0"
    yield claim(said, listed(slides["short"], ".3g"), slides["short"][-1] > 1.0)
    matrix = gpw.collision_matrix("D", 0.0)
    yield claim(
        "4.4 | M(0), tangential first, in units of the hip's mass | singular: only normal "
        "velocity costs",
        f"diag({abs(matrix[0, 0]):g}, {matrix[1, 1]:g})",
        abs(matrix[0, 0]) < 1e-15 and abs(matrix[1, 1] - 1.0) < 1e-15,
    )
    unit = WALKERS["D"].time_unit
    periods = [gait("D", 1e-8, kind).step_period / unit for kind in KINDS]
    said = (
        "4.4 | step periods over √(l/g) at 1e-8, long and short step | different constants, not 0"
    )
    yield claim(said, listed(periods, ".5f"), periods[0] > 1.1 * periods[1] > 1.0)
    for kind in KINDS:
        angle, speed = exponents("D", 1e-7, kind)
        of = f"{kind} step: power of"
        yield number(f"4.4 | {of} γ of the stance angle | 1/3", angle, within=1e-3)
        yield number(f"4.4 | {of} γ of the speed | 1/3", speed, within=1e-3)
        said = f"Eq. 4.8 | {of} v of the power | 4"
        why = "The power is m g v γ, so its exponent is 1 and 1 over the speed's."
        yield number(said, 1.0 + 1.0 / speed, within=0.01, remark=why)
