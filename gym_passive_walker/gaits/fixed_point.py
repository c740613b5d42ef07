"""Gaits: fixed points of the stride map, found without a guess.

Just before a heelstrike a walker's motion is set by three numbers: the step's size and the ratios
of the two legs' rates to it. A small grid of ratios, each with the step size at which the collision
loses what the slope supplies, is a set of starts that suits every slope and every walker of human
proportions. All starts are followed as lanes; the most promising go on to Newton's method.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound, measure
from gym_passive_walker.gaits.newton import LONGEST_SEARCHED, newton
from gym_passive_walker.gaits.section import Section, section_of, strides
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import integrator as I
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.stride import (
    check_slope,
    check_state,
    frame_of,
    new_records,
    strike_heels,
)
from gym_passive_walker.walkers import Walker, as_walker, describe

# Ratios to the step angle, just before heelstrike: of the stance leg's rate, and of the swing
# leg's rate in excess of it (zero where the foot meets the ground without sliding).
_STANCE_RATIOS = -np.geomspace(1.005, 2.0, 16)
_EXCESS_RATIOS = np.array([-1.5, -1.0, -0.7, -0.45, -0.25, -0.1, 0.0, 0.1, 0.3, 0.6, 1.0, 1.6])
_LOSS_SHARES = {K.Kind.KNEED: (1.0, 0.6, 0.3), K.Kind.COMPASS: (1.0,), K.Kind.SIMPLEST: (1.0,)}
_ANGLES = np.geomspace(1e-10, 0.7, 80)
_BATCHES = (12, 24, 96)  # promising starts tried by Newton's method, as long as need be
_APART = 0.03  # starts closer than this are tried once


def starts(section: Section, slope: float) -> NDArray:
    """Points of the section that a gait at this slope may be near to, (n, dimension)."""
    ratios = [(a, a + b) for a in _STANCE_RATIOS for b in _EXCESS_RATIOS]
    angle = np.tile(_ANGLES, len(ratios))
    stance_ratio, swing_ratio = np.repeat(ratios, len(_ANGLES), axis=0).T
    state = np.column_stack(
        [-angle, angle, angle, stance_ratio * angle, swing_ratio * angle, swing_ratio * angle]
    )
    records = new_records(state, np.zeros(len(state)))
    strike_heels(records, section.constants, int(section.kind))
    c = section.constants[0]
    length = 2.0 * (c[K.LEG] * np.sin(angle) + c[K.FOOT_RADIUS] * angle)
    loss = (records[:, I.HEEL_LOSS] / length).reshape(len(ratios), -1)
    points = section.point(records[:, :6]).reshape(len(ratios), len(_ANGLES), -1)
    found = []
    for share in _LOSS_SHARES[section.kind]:
        goal = math.log(share * math.sin(slope))
        for i in range(len(ratios)):
            log_loss = np.log(np.maximum(loss[i], 1e-300))
            if log_loss[0] < goal < log_loss[-1]:
                found.append([np.interp(goal, log_loss, column) for column in points[i].T])
    return np.array(found).reshape(-1, section.dimension)


def _distinct_first(u: NDArray, apart: float) -> NDArray:
    """Points that differ from all before them by more than a distance."""
    kept: list[NDArray] = []
    for point in u:
        if all(np.abs(point - other).max() > apart for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, u.shape[1])


def _search(
    walker: Walker,
    slope: float,
    u: NDArray,
    period: int,
    torque: float,
    enough: Callable[[list[Gait]], bool],
    batches: tuple[int, ...] = _BATCHES,
) -> tuple[list[Gait], Counter]:
    """Gaits that Newton's method reaches from some starts; and how the starts' strides ended."""
    ends: Counter = Counter()
    section = section_of(walker)
    found: list[NDArray] = []
    gaits: list[Gait] = []
    if len(u) == 0:
        return gaits, ends
    options = {"period": period, "torque": torque}
    slopes = np.full(len(u), slope)
    first = strides(
        section, u, slopes, count=period, torque=torque, tolerance=1e-6, longest=LONGEST_SEARCHED
    )
    for outcome in first.records[:, I.OUTCOME].astype(int):
        ends[Outcome(outcome).name if outcome else Outcome.STALLED.name] += 1
    alive = np.flatnonzero(first.alive)
    gap = np.abs(first.end - u).max(axis=1)[alive]
    ranked = _distinct_first(u[alive[np.argsort(gap, kind="stable")]], _APART)
    tried = 0
    for batch in batches:
        chosen, tried = ranked[tried : tried + batch], tried + batch
        if len(chosen) == 0:
            break
        rough, size = newton(section, chosen, slope, tolerance=1e-6, accuracy=1e-5, **options)
        rough = _distinct_first(rough[size < 1e-5], 1e-3)
        rough = np.array(
            [x for x in rough if all(np.abs(x - y).max() > 1e-3 for y in found)]
        ).reshape(-1, section.dimension)
        if len(rough):
            fine, size = newton(section, rough, slope, tolerance=1e-14, accuracy=1e-15, **options)
            for point in _distinct_first(fine[size < 1e-9], 1e-6):
                once = _smallest_period(section, point, slope, period, torque) == period
                if once and _human(section, point, slope, torque):
                    found.append(point)
                    gaits.append(measure(walker, section, point, slope, period, torque))
        if enough(gaits) or (gaits and tried > _BATCHES[0]):
            break
    gaits.sort(key=lambda gait: -gait.stance_angle)
    return gaits, ends


def _smallest_period(section: Section, u: NDArray, slope: float, period: int, torque: float) -> int:
    for divisor in range(1, period):
        if period % divisor == 0:
            result = strides(
                section, u[None], np.array([slope]), count=divisor, torque=torque, tolerance=1e-12
            )
            if result.alive[0] and np.abs(result.end[0] - u).max() < 1e-7:
                return divisor
    return period


def _human(section: Section, u: NDArray, slope: float, torque: float) -> bool:
    """Whether the swing leg swings once: no walk of several swings or whole turns a step."""
    records = strides(section, u[None], np.array([slope]), torque=torque, tolerance=1e-8).records[0]
    return bool(records[I.HIP_TURN] < 2.0 * abs(records[I.HIP_NET]))


def _as_points(section: Section, walker: Walker, guess: ArrayLike) -> NDArray:
    states = np.atleast_2d(check_state(guess)).copy()
    if np.any(states[:, 0] <= 0.0):
        raise ValueError("a guess must be a section state: its stance angle is positive")
    states[:, 3:] *= frame_of(walker).time
    return section.point(states)


def _check(walker: Walker | str, slope: float, period: int) -> tuple[Walker, float]:
    walker = as_walker(walker)
    slope = float(check_slope(slope))
    if int(period) != period or period < 1:
        raise ValueError(f"period must be a whole number of strides from 1 on, not {period!r}")
    return walker, slope


def _starts(walker: Walker, slope: float, guess: ArrayLike | None) -> NDArray:
    section = section_of(walker)
    if guess is not None:
        return _as_points(section, walker, guess)
    return starts(section, slope) if slope > 0.0 else np.empty((0, section.dimension))


def glance(walker: Walker, slope: float, kind: GaitKind) -> Gait | None:
    """A gait of a kind if a quick search finds one: for looking over many slopes."""

    def enough(gaits: list[Gait]) -> bool:
        return any(gait.kind == kind for gait in gaits)

    u = _starts(walker, slope, None)
    gaits, _ = _search(walker, slope, u, 1, 0.0, enough, _BATCHES[:1])
    return next((gait for gait in gaits if gait.kind == kind), None)


def find_gaits(
    walker: Walker | str, slope: float, *, period: int = 1, guess: ArrayLike | None = None
) -> list[Gait]:
    """Every gait of a period that is found at a slope, longest step first.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad.
        period: Strides until the motion repeats; 1 for an ordinary gait.
        guess: A section state or several to start from, instead of the search's own starts.

    Returns:
        Zero, one or two gaits for walkers like the published ones.
    """
    walker, slope = _check(walker, slope, period)
    u = _starts(walker, slope, guess)
    return _search(walker, slope, u, period, 0.0, lambda gaits: len(gaits) >= 2 * period)[0]


def find_gait(
    walker: Walker | str,
    slope: float,
    kind: GaitKind = "long",
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
) -> Gait:
    """Find the long-step or the short-step gait of a walker at a slope.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad.
        kind: "long" or "short". Of two gaits the longer step is the long one; a gait alone is told
            by the branch it belongs to, which the signs of 1 - multipliers reveal.
        period: Strides until the motion repeats.
        guess: A section state to start from, instead of the search's own starts; the gait found
            from it is returned whatever its kind.

    Returns:
        The gait, its state exact to about 1e-12 relative.

    Raises:
        GaitNotFound: if there is none; the message says what was tried and how it ended.
    """
    walker, slope = _check(walker, slope, period)
    if kind not in ("long", "short"):
        raise ValueError(f'kind must be "long" or "short", not {kind!r}')
    u = _starts(walker, slope, guess)

    def wanted(gaits: list[Gait]) -> list[Gait]:
        return [gait for gait in gaits if guess is not None or period > 1 or gait.kind == kind]

    gaits, ends = _search(walker, slope, u, period, 0.0, lambda gaits: bool(wanted(gaits)))
    if wanted(gaits):
        return wanted(gaits)[0 if kind == "long" else -1]
    tried = ", ".join(f"{count} {name}" for name, count in ends.most_common()) or "none"
    others = f"; only a {gaits[0].kind}-step gait was found" if gaits else ""
    raise GaitNotFound(
        f"no {kind}-step gait of period {period} for {describe(walker)} at slope {slope} rad"
        f"{others}. "
        f"First strides of the {sum(ends.values())} starts ended so: {tried}. "
        "A passive gait needs a downhill slope that suits the walker; `gait_family` shows where "
        "its gaits begin and end, and `guess=` starts the search from a state of your own."
    )
