"""Tuned walkers that walk: `tune` alone meets conditions that are necessary, not sufficient."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats.qmc import Halton

from gym_passive_walker.arguments import number, one_slope
from gym_passive_walker.gaits.design_nlp import CIRCLE, Candidates, slsqp
from gym_passive_walker.gaits.gait import Gait, GaitNotFound, measure
from gym_passive_walker.gaits.search import glance, seek
from gym_passive_walker.gaits.sensitivity import place_near
from gym_passive_walker.progress import said
from gym_passive_walker.walkers import Walker, WalkerLike, as_walker, describe, tune

_MOVED = ("thigh_com", "thigh_gyration", "shank_com", "shank_gyration")
_ALL = (*_MOVED, "thigh_offset", "shank_offset")
_MET = 1e-6  # by which a multiplier may be out of its circle
_SHARES = (0.05, 0.6)  # of a segment's length: where such designs are looked for
_LOOKS = 128  # designs looked at


def tune_to_walk(walker: WalkerLike, slope: float, *, radius: float = 0.8) -> Gait:
    """The nearest tuned walker that walks, stably, at a slope; as its long-step gait.

    `tune` moves offsets alone, and what it makes of a walker that walks may have no gait. Here the
    centres of mass and the gyrations of thigh and shank change as well, as little as need be: by
    the root of the sum of squares of all changes from `tune(walker)`. Lengths, masses and feet
    stay. If `tune(walker)` walks so itself, it is the answer.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        slope: Slope in rad.
        radius: The largest modulus that a multiplier may have. Nearer to 1 the walk is lost by ever
            smaller changes of the design, which is hardly nearer for it; but at vanishing slopes
            every tuned walker needs that.

    Returns:
        The gait; `gait.walker` is the design. It is nearest among those near it; the search, of
        some seconds, begins at the nearest of 128 designs that walk so.

    Raises:
        GaitNotFound: if none of these walks.
        WalkerError: if the walker cannot be tuned.
    """
    walker, slope = as_walker(walker), one_slope(slope)
    radius = number(radius, "radius", above=0.0)
    tuned = tune(walker)
    gait = seek(tuned, slope).gait
    if gait is not None and np.abs(gait.multipliers[0]) <= radius:
        return gait
    with said(f"tuned, this walker does not walk so at slope {slope:g} rad: looking for one"):
        start = _start(tuned, slope, radius)
        if start is not None:
            return _nearest(start, tuned, radius) or start
    raise GaitNotFound(
        f"no tuned walker near {describe(walker)} has a long-step gait at slope {slope:g} "
        f"rad with multipliers up to {radius:g}: none of {_LOOKS} with their segments' centres "
        "of mass and gyrations elsewhere; change lengths, masses or the foot, or the slope"
    )


def _place(walker: Walker) -> NDArray[np.float64]:
    """What is moved, (6,)."""
    return np.array([getattr(walker, name) for name in _ALL])


def _start(tuned: Walker, slope: float, radius: float) -> Gait | None:
    """The gait of a tuned walker, the nearest of many that walk."""
    if tuned.massless_legs:  # nothing to move
        return None
    lengths = np.repeat([tuned.thigh_length, tuned.shank_length], 2)
    low, high = _SHARES
    places = (low + (high - low) * Halton(4, scramble=False).random(_LOOKS)) * lengths
    walkers = [
        tune(replace(tuned, **dict(zip(_MOVED, place, strict=True)))) for place in places.tolist()
    ]
    walkers.sort(key=lambda walker: float(np.linalg.norm(_place(walker) - _place(tuned))))
    for walker in walkers:
        gait = glance(walker, slope, "long")
        if gait is not None and np.abs(gait.multipliers[0]) <= radius:
            return gait
    return None


def _nearest(start: Gait, tuned: Walker, radius: float) -> Gait | None:
    """The tuned walker nearest to one, of those that a gait can be followed to."""
    length = tuned.leg_length
    box = length * np.array([[0.0 if name.endswith("gyration") else -1.0, 1.0] for name in _ALL])
    candidates = Candidates(start, _ALL, box, (), multipliers=True)
    width = box[:, 1] - box[:, 0]
    goal = (_place(tuned) - box[:, 0]) / width

    def tied(x: NDArray) -> NDArray:
        here = box[:, 0] + width * x
        walker = replace(tuned, **dict(zip(_MOVED, here[:4].tolist(), strict=True)))
        return (here[4:] - _place(tune(walker))[4:]) / length

    # Offsets of tuned walkers are linear in the centres of mass.
    ties = np.stack([tied(x) - tied(np.zeros(6)) for x in np.eye(6)], axis=1)

    def circle(x: NDArray) -> tuple[NDArray, NDArray]:
        judged = candidates.at(x)
        if judged is None:
            return -np.ones(CIRCLE), np.zeros((CIRCLE, 6))
        values, by = judged.inside(radius)
        return values, by[:, :6]

    def distance(x: NDArray) -> tuple[float, NDArray]:
        away = (x - goal) * width / length
        if candidates.at(x) is None:
            return np.inf, np.zeros(6)
        return float(away @ away), 2.0 * away * width / length

    found = slsqp(
        distance, candidates.first, [(0.0, 1.0)] * 6,
        equal=lambda x: (tied(x), ties), beyond=circle, iterations=200,
    )  # fmt: skip
    judged = candidates.at(found.x)
    if judged is None or circle(found.x)[0].min() < -_MET:
        return None
    place = judged.gait.place
    tuned_map = place.stride_map.with_walker(tune(place.walker))
    exact = place_near(tuned_map, place.slope, place.u)  # tuned to the last digit
    return exact and measure(exact.stride_map, exact.u, exact.slope, 1)
