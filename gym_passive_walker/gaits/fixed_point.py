"""Gaits: fixed points of the stride map, found without a guess.

Many starts are followed as lanes; the most promising go on to Newton's method with the exact
derivative, a batch at a time, the next batch away from the gaits already found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_state, gait_kind, one_slope, whole
from gym_passive_walker.gaits.gait import Gait, GaitKind, GaitNotFound, measure
from gym_passive_walker.gaits.newton import LONGEST_SEARCHED, newton
from gym_passive_walker.gaits.section import Section, section_of, strides
from gym_passive_walker.gaits.starts import returns, starts
from gym_passive_walker.physics import record as R
from gym_passive_walker.physics.engine import advance
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.frame import frame_of
from gym_passive_walker.physics.record import new_records
from gym_passive_walker.walkers import Walker, as_walker, describe

_BATCHES = (12, 24, 96)  # promising starts tried by Newton's method, as long as need be
_APART = 0.03  # starts closer than this are tried once
_LOOKS = 64  # at the swing leg during a stride


def _distinct(u: NDArray, others: list[NDArray], apart: float) -> NDArray:
    """Points that differ from others, and from all before them, by more than a distance."""
    kept: list[NDArray] = []
    for point in u:
        if all(np.abs(point - other).max() > apart for other in kept + others):
            kept.append(point)
    return np.array(kept).reshape(-1, u.shape[1])


class _Starts:
    """Starts of a search, handed out the most promising first.

    A start promises the more the less its strides move it, and what counts is that movement over
    its distance from the gaits already found: near one of those every start moves little.
    """

    def __init__(self, u: NDArray, end: NDArray) -> None:
        self.u, self.score = u, np.abs(end - u).max(axis=1)
        self.left = np.ones(len(u), bool)

    def avoid(self, point: NDArray) -> None:
        """Turn away from a gait."""
        distance = np.abs(self.u - point).max(axis=1)
        self.score = self.score / np.clip(distance, 1e-6, 1.0)

    def best(self, count: int) -> NDArray:
        """The next starts, each apart from the others."""
        chosen = []
        while len(chosen) < count and np.any(self.left):
            i = np.argmin(np.where(self.left, self.score, np.inf))
            chosen.append(self.u[i])
            self.left &= np.abs(self.u - self.u[i]).max(axis=1) > _APART
        return np.array(chosen).reshape(-1, self.u.shape[1])


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
    gaits: list[Gait] = []
    if len(u) == 0:
        return gaits, ends
    found: list[NDArray] = []
    options = {"period": period, "torque": torque}
    first = strides(
        section, u, np.full(len(u), slope), count=period, torque=torque, tolerance=1e-6,
        longest=LONGEST_SEARCHED,
    )  # fmt: skip
    for outcome in first.records[:, R.OUTCOME].astype(int):
        ends[Outcome(outcome).name if outcome else Outcome.STALLED.name] += 1
    candidates = _Starts(u[first.alive], first.end[first.alive])
    for batch in batches:
        chosen = candidates.best(batch)
        if len(chosen) == 0:
            break
        rough, size = newton(section, chosen, slope, tolerance=1e-6, accuracy=1e-5, **options)
        rough = _distinct(rough[size < 1e-5], found, 1e-3)
        if len(rough):
            fine, size = newton(section, rough, slope, tolerance=1e-14, accuracy=1e-15, **options)
            for point in _distinct(fine[size < 1e-9], found, 1e-6):
                if any(np.abs(point - other).max() < 1e-6 for other in found):
                    continue  # another stride of a gait found in this batch
                orbit = _orbit(section, point, slope, period, torque)
                if len(orbit) == period and _human(walker, section, point, slope, torque):
                    gaits.append(measure(walker, section, point, slope, period, torque))
                for stride in orbit:
                    found.append(stride)
                    candidates.avoid(stride)
        if enough(gaits):
            break
    gaits.sort(key=lambda gait: -gait.stance_angle)
    return gaits, ends


def _orbit(section: Section, u: NDArray, slope: float, period: int, torque: float) -> list[NDArray]:
    """The points that a gait passes through, from one of them on until it repeats."""
    orbit, slopes = [u], np.array([slope])
    while len(orbit) < period:
        result = strides(section, orbit[-1][None], slopes, torque=torque, tolerance=1e-12)
        if period % len(orbit) == 0 and np.abs(result.end[0] - u).max() < 1e-7:
            break
        orbit.append(result.end[0])
    return orbit


def _human(walker: Walker, section: Section, u: NDArray, slope: float, torque: float) -> bool:
    """Whether the swing leg swings forward once: no walk of several swings a step."""
    slopes = np.full(_LOOKS, slope)
    states = section.state(np.repeat(u[None], _LOOKS, axis=0))
    whole = new_records(states[:1], slopes[:1], torque)
    advance(section.kind, section.constants, whole, tolerance=1e-6)
    records = new_records(states, slopes, torque)
    records[:, R.END] = whole[0, R.TIME] * np.linspace(0.0, 1.0 - 1e-4, _LOOKS)
    advance(section.kind, section.constants, records, tolerance=1e-6)
    forward = walker.thigh_length * records[:, R.RATES + 1]
    forward += walker.shank_length * records[:, R.RATES + 2]
    swings = np.count_nonzero(np.diff(forward > 0.0, prepend=False) & (forward > 0.0))
    return swings == 1


def _as_points(section: Section, walker: Walker, guess: ArrayLike) -> NDArray:
    states = np.atleast_2d(check_state(guess)).copy()
    if np.any(states[:, 0] <= 0.0):
        raise ValueError("a guess must be a section state: its stance angle is positive")
    states[:, 3:] *= frame_of(walker).time
    return section.point(states)


def _check(walker: Walker | str, slope: float, period: int) -> tuple[Walker, float, int]:
    walker = as_walker(walker)
    return walker, one_slope(slope), whole(period, "period")


def _starts(walker: Walker, slope: float, period: int, guess: ArrayLike | None) -> NDArray:
    """Where a search begins: at a guess, or where gaits of this period may be."""
    section = section_of(walker)
    if guess is not None:
        return _as_points(section, walker, guess)
    if slope <= 0.0:
        return np.empty((0, section.dimension))
    u = starts(section, slope)
    if period == 1:
        return u
    gaits, _ = _search(walker, slope, u, 1, 0.0, lambda gaits: len(gaits) >= 2)
    if not gaits:
        return u
    states = np.array([gait.state for gait in gaits])
    states[:, 3:] *= section.time
    return np.concatenate([returns(section, slope, section.point(states)), u])


def glance(walker: Walker, slope: float, kind: GaitKind) -> Gait | None:
    """A gait of a kind if a quick search finds one: for looking over many slopes."""

    def enough(gaits: list[Gait]) -> bool:
        return any(gait.kind == kind for gait in gaits)

    u = _starts(walker, slope, 1, None)
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
    walker, slope, period = _check(walker, slope, period)
    u = _starts(walker, slope, period, guess)
    return _search(walker, slope, u, period, 0.0, lambda gaits: len(gaits) >= 2)[0]


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
        kind: "long" or "short", as `Gait.kind` has it. Of an untuned walker's two long-step gaits
            at the lowest slopes, the one with the longer step.
        period: Strides until the motion repeats.
        guess: A section state to start from, instead of the search's own starts; the gait found
            from it is returned whatever its kind.

    Returns:
        The gait, its state exact to about 1e-12 relative.

    Raises:
        GaitNotFound: if there is none; the message says what was tried and how it ended.
    """
    walker, slope, period = _check(walker, slope, period)
    kind = gait_kind(kind)
    u = _starts(walker, slope, period, guess)

    def wanted(gaits: list[Gait]) -> list[Gait]:
        return [gait for gait in gaits if guess is not None or period > 1 or gait.kind == kind]

    def enough(gaits: list[Gait]) -> bool:
        return any(guess is not None or gait.beyond_fold == (kind == "short") for gait in gaits)

    gaits, ends = _search(walker, slope, u, period, 0.0, lambda gaits: enough(wanted(gaits)))
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
