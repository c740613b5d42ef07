"""Bhounsule and Zamani's foot placement: the simplest walker under one hip torque a stride."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from examples.stride_controllers import SpeedControl, midstance_speed, speed_of
from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.control import Walkers, ticked_strides
from validation.rows import Row, claim, listed, number
from validation.walks import gait

_SLOPE = 0.009
_BHOUNSULE = "Bhounsule, Zamani 2017"


def _law(decay: float) -> SpeedControl:
    """The simplest walker's hip torque by Bhounsule's and Zamani's law."""
    scene = {"walker": "D", "slope": _SLOPE, "actions": "hip", "max_hip_torque": 2.0}
    return SpeedControl(scene, speed_of(gait("D", _SLOPE)), decay=decay)


def _struck(angle: ArrayLike, rate: ArrayLike) -> NDArray:
    """Points on the Poincaré section just after heelstrike, dimensionless, (n, 3)."""
    angle, rate = np.ravel(angle), np.ravel(rate)
    return np.stack([angle, rate, np.cos(2.0 * angle) * rate], axis=1)


def _starts(factors: ArrayLike) -> NDArray:
    """The gait's points with their angular velocities multiplied by `factors`, (n, 3)."""
    walks = gait("D", _SLOPE)
    rate = walks.state[3] * WALKERS["D"].time_unit
    return _struck(np.full(np.shape(factors), walks.stance_angle), rate * np.asarray(factors))


def _walk(
    law: SpeedControl | None, points: NDArray, slopes: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Simulate strides on a sequence of slopes, with a controller or without.

    Args:
        law: The controller; None for the passive walker.
        points: Points on the Poincaré section at the start, dimensionless, (n, 3).
        slopes: Slope of each stride in rad, (strides,) or (strides, n).

    Returns:
        Number of strides of each walker, (n,); mid-stance speeds over sqrt(g l), (strides, n); and
        the torques' absolute work per unit of foot mass over g l, (strides, n). Speeds and work are
        NaN after a fall.
    """
    who, n = Walkers(walker=WALKERS["D"], tolerance=1e-11), len(points)
    going, made = np.arange(n), np.zeros(n, int)
    speeds, works = np.full((2, len(slopes), n), np.nan)
    for k, slope in enumerate(slopes):
        here = np.broadcast_to(slope, n)[going]
        torque = np.zeros((len(points), 1)) if law is None else law.actuation(points, here)
        walked = ticked_strides(who, here, points, torque, tick=math.inf)
        speeds[k, going] = midstance_speed(points, here)
        works[k, going] = (np.abs(torque) * walked.turn)[:, 0]
        on = walked.outcomes == Outcome.HEELSTRIKE
        going, points = going[on], walked.end[on]
        made[going] += 1
        if len(going) == 0:
            break
    return made, speeds, works


def foot_placement() -> Iterator[Row]:
    """Rows on a hip torque per stride, which places the foot and so sets the next speed."""
    decays, starts = (0.0, 0.2, 0.5, 0.8), _starts([0.97, 1.02, 1.05, 1.08, 1.12])
    spent = []
    for decay in decays:
        law = _law(decay)
        _, speeds, works = _walk(law, starts, np.full(60, _SLOPE))
        off = speeds - law.speed
        spent.append(works.sum(axis=0))
        said = f"{_BHOUNSULE} | what a stride leaves of a deviation of the mid-stance speed"
        yield number(
            f"{said} | {decay:g}", float((off[1] / off[0]).mean()), within=1e-9, digits=10,
            remark="Five velocity perturbations, of −3 % to 12 %.",
        )  # fmt: skip
    yield claim(
        f"{_BHOUNSULE} | work of the hip until a velocity perturbation has decayed, decays 0, 0.2, "
        "0.5, 0.8 | least in one step",
        listed(np.mean(spent, axis=1), ".3f"),
        np.all(np.diff(spent, axis=0) > 0.0),
        remark="Mean of the five, each of which grows so; absolute, per foot mass over g l.",
    )
    slopes, lattice = np.full(30, _SLOPE), _lattice()
    passive, held = (int((_walk(law, lattice, slopes)[0] == 30).sum()) for law in (None, _law(0.0)))
    yield claim(
        f"{_BHOUNSULE} | basin over the passive walker's | an order of magnitude",
        f"{held / passive:.1f} times",
        held > 10 * passive,
        remark=f"{held} and {passive} of {len(lattice)} starts, θ to 0.45 and its rate to −0.5, "
        "make 30 strides. Speed is back in one.",
    )
    yield from _rough_ground()


def _lattice() -> NDArray:
    """A grid of points just after heelstrike around the gait, dimensionless, (n, 3)."""
    angle, rate = np.meshgrid(np.linspace(0.0, 0.45, 101)[1:], np.linspace(-0.5, 0.0, 100))
    return _struck(angle, rate)


def _rough_ground() -> Iterator[Row]:
    """Row on the number of strides to a fall, with a random slope for each stride."""
    walkers, strides, spread = 100, 400, 0.0014
    slopes = np.random.default_rng(0).normal(_SLOPE, spread, (strides, walkers))
    between, works = [], []
    for law in (None, _law(0.0), _law(0.5)):
        made, _, work = _walk(law, _starts(np.ones(walkers)), slopes)
        between.append(made.sum() / max(1, int((made < strides).sum())))
        works.append(np.nanmean(work))
    yield claim(
        f"{_BHOUNSULE} | strides to a fall on rough ground over the passive walker's, decay 0 and "
        "0.5 | two orders of magnitude",
        listed((x / between[0] for x in between[1:]), ".0f"),
        min(between[1:]) > 100.0 * between[0],
        remark=f"Slopes normal about 0.009 by {spread:g}, ours: {walkers} walkers of {strides} "
        "strides; as many for each fall, of which one is counted at least: "
        f"{listed(between, '.0f')}. The hip's work a stride is {listed(works[1:], '.4f')}: here "
        "the slower answer costs less.",
    )  # fmt: skip
