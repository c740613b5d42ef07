"""The search for gaits without a guess: fixed points of the stride map.

Just before a heelstrike a walker's motion is set by three numbers: the step's size and the ratios
of the two legs' rates to it. A small grid of ratios, each with the step size at which the collision
loses what the slope supplies, is a set of starts that suits every slope and every walker of human
proportions. Gaits that take several strides to repeat are looked for where walks return to.

Starts are followed as lanes; the most promising go on to Newton's method with the exact derivative,
a batch at a time, the next batch away from the gaits already found.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_state
from gym_passive_walker.gaits.gait import Gait, GaitKind, gait_equations, measure
from gym_passive_walker.gaits.newton import newton
from gym_passive_walker.gaits.section import Section, from_logarithms, logarithms
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.physics import legs
from gym_passive_walker.physics.hybrid import SMOOTH, Outcome
from gym_passive_walker.physics.systems import body_of, kind_of, system_of
from gym_passive_walker.walkers import Walker

ACCURACY = 1e-12
"""Tolerance of the strides by which gaits are told apart."""

_BATCHES = (12, 24, 96)  # promising starts tried by Newton's method, as long as need be
_PATIENCE = 2  # steps for other starts to follow the first that has led to a gait
_LATTICE = 216  # starts are enough for a quick search; a kneed walker's lattice has 864
_APART = 0.03  # starts closer than this are tried once
_LOOKS = 64  # at the swing leg during a stride
_LARGEST = 1.4  # stance angle of a gait, in rad
_ROUGHLY, _FINELY = 1e-6, 1e-14  # tolerances
_ALIKE, _NEARLY = 1e-6, 1e-3  # gaits closer than this are one, exactly derived and by differences

# Ratios to the step angle, just before heelstrike: of the stance leg's rate, and of the swing
# leg's rate in excess of it (zero where the foot meets the ground without sliding). Excesses far
# from zero belong to the slow walks of untuned walkers and to short steps on steep slopes. The
# simplest walker forgets its swing leg's rate at heelstrike.
_EXCESSES = (-6.0, -4.0, -2.8, -2.0, -1.5, -1.0, -0.7, -0.45, -0.25, -0.1)
_EXCESSES += (0.0, 0.1, 0.3, 0.6, 1.0, 1.6, 2.2, 2.8)
_RATIOS = -np.geomspace(1.005, 2.0, 16), np.array(_EXCESSES)
_RATIOS_OF = {
    "kneed": _RATIOS,
    "straight": _RATIOS,
    "simplest": (-np.geomspace(1.005, 2.0, 200), np.zeros(1)),
}
_LOSS_SHARES = {"kneed": (1.0, 0.6, 0.3), "straight": (1.0,), "simplest": (1.0,)}
_ANGLES = np.geomspace(1e-10, 0.7, 80)
_PUSHED_ANGLES = np.geomspace(1e-4, 0.7, 120)  # a push-off makes no tiny steps
_LEAST = 1e-300  # energy: its logarithm is finite

_WALKERS, _SETTLING, _KEPT = 48, 100, 12  # walks looked at for returns
_RETURNING = 1e-7  # tolerance of these


def heelstrike(
    section: Section,
    angles: NDArray,
    stance_rates: NDArray,
    swing_rates: NDArray,
    push_off: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """What a heelstrike makes of straight legs with given rates just before it; dimensionless.

    Args:
        section: Of one walker.
        angles: Stance angles just after it, (n,).
        stance_rates: Of the old stance leg, (n,).
        swing_rates: Of the old swing leg, (n,).
        push_off: Impulse just before it.

    Returns:
        Points after it, (n, m); the energy lost and the push-off's work, (n,) each.
    """
    reset = system_of(section.walker).phases[-1].resets[Outcome.HEELSTRIKE]
    before = legs.straight(-angles, angles, stance_rates, swing_rates)
    struck = reset.strike(body_of(section.walker), before, push_off, SMOOTH)
    work = np.broadcast_to(struck.work, struck.lost.shape)
    return section.point(np.stack(struck.after, axis=-1)), struck.lost, work


def starts(stride_map: StrideMap, slope: float) -> NDArray:
    """Where a gait of one stride at this slope may be near to.

    Args:
        stride_map: Of one walker.
        slope: Slope in rad; positive, unless motors drive the walker.

    Returns:
        Logarithmic coordinates (n, m).
    """
    held = stride_map.actuation
    u, loss, pushed = _grid(stride_map.walker, held.push_off)
    # Over a step, the hip opens by four stance angles and the stance leg turns by two: by about two
    # and one for each unit of length.
    works = stride_map.system.works
    given = 2.0 * works.hip * held.hip_torque + works.ankle * held.ankle_torque
    supply = math.sin(slope) + given + pushed
    if stride_map.terrain is not None:
        rise = float(stride_map.ground[:, 1].mean())
        angles = np.exp(u[0, :, 0])
        lengths = legs.step_length(body_of(stride_map.walker), angles, angles)
        supply = supply - rise * math.cos(slope) / lengths
    if not np.any(supply > 0.0):
        return np.empty((0, stride_map.dimension))
    found = []
    for share in _LOSS_SHARES[kind_of(stride_map.walker)]:
        excess = loss - np.log(np.maximum(share * supply, _LEAST))
        short = excess < 0.0
        # Under a push-off uphill, steps of two sizes are in balance: it hardly helps tiny ones.
        rows, above = np.nonzero(short[:, :-1] != short[:, 1:])
        low, high = excess[rows, above], excess[rows, above + 1]
        part = (low / (low - high))[:, None]
        found.append((1.0 - part) * u[rows, above] + part * u[rows, above + 1])
    return np.concatenate(found)


@lru_cache(maxsize=64)
def _grid(walker: Walker, push_off: float) -> tuple[NDArray, NDArray, NDArray | float]:
    """Points just after heelstrike, by ratios of rates and step angle, and what each step loses.

    Returns:
        Logarithmic coordinates (ratios, angles, m); over the weight and the step's length, the
        logarithm of what the heelstrike loses, (ratios, angles), and what the push-off before it
        gives, of the same shape or 0.
    """
    stride_map = StrideMap.of(walker)
    stance, excess = (x.ravel() for x in np.meshgrid(*_RATIOS_OF[kind_of(walker)]))
    angles = _PUSHED_ANGLES if push_off else _ANGLES
    angle = np.tile(angles, len(stance))
    stance_rate = np.repeat(stance, len(angles)) * angle
    swing_rate = np.repeat(stance + excess, len(angles)) * angle
    points, *energies = heelstrike(stride_map, angle, stance_rate, swing_rate, push_off)
    shape, lengths = (len(stance), len(angles)), legs.step_length(body_of(walker), angle, angle)
    lost, pushed = ((energy / lengths).reshape(shape) for energy in energies)
    u, loss = logarithms(points).reshape(*shape, -1), np.log(np.maximum(lost, _LEAST))
    return u, loss, pushed if push_off else 0.0


def returns(stride_map: StrideMap, slope: float, gaits: NDArray) -> NDArray:
    """Where walks begun beside some gaits come back to.

    Where a gait has doubled its period, or walks are chaotic, they pass near every gait there is.

    Args:
        stride_map: Of one walker.
        slope: Slope in rad.
        gaits: Fixed points in logarithmic coordinates, (n, m).

    Returns:
        Logarithmic coordinates (k, m) along walks that last.
    """
    roughly = stride_map.with_tolerance(_RETURNING)
    beside = np.random.default_rng(0).standard_normal((_WALKERS, stride_map.dimension))
    size = np.geomspace(1e-4, 0.03, _WALKERS)[:, None]
    points = from_logarithms(np.concatenate([gait + size * beside for gait in gaits]))
    points = roughly.apply(points, slope, strides=_SETTLING).ends
    points = points[np.isfinite(points[:, 0])]
    kept = []
    for _ in range(_KEPT):
        points = roughly.apply(points, slope).ends
        kept.append(points)
    points = np.concatenate(kept)
    return logarithms(points[np.isfinite(points[:, 0])])


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
        self.u, self.score = u, np.abs(end - u).max(axis=1)  # infinite once tried

    def avoid(self, point: NDArray) -> None:
        """Turn away from a gait."""
        distance = np.abs(self.u - point).max(axis=1)
        self.score = self.score / np.clip(distance, 1e-6, 1.0)

    def best(self, count: int) -> NDArray:
        """The next starts, each apart from the others."""
        chosen: list[NDArray] = []
        while len(chosen) < min(count, len(self.u)):
            i = self.score.argmin()
            if self.score[i] == math.inf:
                break
            chosen.append(self.u[i])
            self.score[np.abs(self.u - self.u[i]).max(axis=1) <= _APART] = math.inf
        return np.array(chosen).reshape(-1, self.u.shape[1])


def search(
    stride_map: StrideMap,
    slope: float,
    u: NDArray,
    period: int,
    enough: Callable[[list[Gait]], bool],
    batches: tuple[int, ...] = _BATCHES,
    patience: int | None = None,
) -> tuple[list[Gait], Counter]:
    """Gaits that Newton's method reaches from some starts; and how the starts' strides ended.

    Args:
        stride_map: Of one walker.
        slope: Slope in rad.
        u: Starts in logarithmic coordinates, (n, m).
        period: Strides until a gait repeats.
        enough: Whether the gaits found are all that is wanted.
        batches: Starts tried by Newton's method, as long as it is not enough.
        patience: Of that method, as of `newton`: for whom one gait is enough.
    """
    gaits: list[Gait] = []
    found: list[NDArray] = []
    roughly, finely = stride_map.with_tolerance(_ROUGHLY), stride_map.with_tolerance(_FINELY)
    closes, alike = stride_map.closes, _ALIKE if stride_map.exact else _NEARLY

    def solutions(followed: StrideMap, guesses: NDArray, accuracy: float, limit: float) -> NDArray:
        def equations(u: NDArray) -> tuple[NDArray, NDArray]:
            sane = np.where(u[:, :1] < math.log(_LARGEST), u, np.nan)
            return gait_equations(followed, sane, slope, period=period)[:2]

        solved = newton(equations, guesses, accuracy=accuracy, patience=patience)
        return solved.points[solved.sizes < limit]

    first = roughly.apply(from_logarithms(u), slope, strides=period)
    ends = Counter({Outcome(i).name: n for i, n in enumerate(np.bincount(first.outcomes)) if n})
    ahead = first.ends[:, 0] > 0.0  # who struck behind the stance foot begins no walk
    candidates = _Starts(u[ahead], logarithms(first.ends[ahead]))
    for batch in batches:
        chosen = candidates.best(batch)
        if len(chosen) == 0:
            break
        rough = _distinct(solutions(roughly, chosen, 1e-5, max(1e-5, closes)), found, 1e-3)
        for point in _distinct(solutions(finely, rough, 1e-15, closes), found, alike):
            if any(np.abs(point - other).max() < alike for other in found):
                continue  # another stride of a gait found in this batch
            orbit = _orbit(stride_map, point, slope, period, 0.1 * alike)
            if len(orbit) == period:
                with suppress(np.linalg.LinAlgError):  # a rounding off, there may be no stride
                    gait = measure(stride_map, point, slope, period)
                    if _human(roughly, point, gait):
                        gaits.append(gait)
            for stride in orbit:
                found.append(stride)
                candidates.avoid(stride)
        if enough(gaits):
            break
    gaits.sort(key=lambda gait: -gait.stance_angle)
    return gaits, ends


def _orbit(
    stride_map: StrideMap, u: NDArray, slope: float, period: int, alike: float
) -> list[NDArray]:
    """The points that a gait passes through, from one of them on until it repeats."""
    orbit = [u]
    while len(orbit) < period:
        end = logarithms(stride_map.apply(from_logarithms(orbit[-1][None]), slope).ends)[0]
        if period % len(orbit) == 0 and np.abs(end - u).max() < alike:
            break
        orbit.append(end)
    return orbit


def _human(stride_map: StrideMap, u: NDArray, gait: Gait) -> bool:
    """Whether the swing leg swings forward once: no walk of several swings a step."""
    walker, duration = gait.walker, float(gait.stride.duration) / stride_map.units.time
    times = duration * np.linspace(0.0, 1.0 - 1e-4, _LOOKS)[None]
    rates = stride_map.sample(from_logarithms(u[None]), gait.slope, times).states[0, :, 3:]
    forward = walker.thigh_length * rates[:, 1] + walker.shank_length * rates[:, 2]
    swings = np.count_nonzero(np.diff(forward > 0.0, prepend=False) & (forward > 0.0))
    return swings == 1


def begin(
    stride_map: StrideMap, slope: float, period: int = 1, guess: ArrayLike | None = None
) -> NDArray:
    """Where a search begins: at a guess, or where gaits of this period may be."""
    if guess is not None:
        states = np.atleast_2d(check_state(guess, "guess"))
        if np.any(states[:, 0] <= 0.0):
            raise ValueError("a guess must be a section state: its stance angle is positive")
        return logarithms(stride_map.points_at(states))
    if slope <= 0.0 and stride_map.passive and stride_map.terrain is None:
        return np.empty((0, stride_map.dimension))
    u = logarithms(stride_map.likely(slope)) if stride_map.controlled else starts(stride_map, slope)
    if period == 1:
        return u
    gaits, _ = search(stride_map, slope, u, 1, lambda gaits: len(gaits) >= 2)
    if not gaits:
        return u
    points = stride_map.points_at([gait.state for gait in gaits])
    return np.concatenate([returns(stride_map, slope, logarithms(points)), u])


class Sought(NamedTuple):
    """What a search for one gait came to.

    Attributes:
        gait: The gait, if there is one.
        all: Every gait found on the way, longest step first.
        ends: How the first strides of the starts ended, and how many did so.
    """

    gait: Gait | None
    all: list[Gait]
    ends: Counter


def seek(
    walker: MapLike,
    slope: float,
    kind: GaitKind = "long",
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
) -> Sought:
    """As `fixed_point.find_gait`, for whom no gait is an answer like any other."""
    stride_map = map_of(walker, tolerance=ACCURACY)
    # Under a controller there is no telling which kind it holds.
    any_kind = guess is not None or stride_map.controlled

    def wanted(gait: Gait) -> bool:
        return any_kind or period > 1 or gait.kind == kind

    def enough(gaits: list[Gait]) -> bool:
        short = kind == "short"
        return any(any_kind or (wanted(x) and x.beyond_fold == short) for x in gaits)

    u = begin(stride_map, slope, period, guess)
    few = u[:: max(1, len(u) // _LATTICE)] if period == 1 and guess is None else u
    gaits, ends = search(stride_map, slope, few, period, enough, _BATCHES[:1], _PATIENCE)
    if not enough(gaits):  # starts that were left out or not waited for may lead to it
        gaits, ends = search(stride_map, slope, u, period, enough)
    chosen = [gait for gait in gaits if wanted(gait)]
    if period > 1 and guess is None:  # gaits of several strides are born in pairs, at folds
        chosen = [gait for gait in chosen if enough([gait])] or chosen
    return Sought(chosen[0 if kind == "long" else -1] if chosen else None, gaits, ends)


def glance(walker: MapLike, slope: float, kind: GaitKind) -> Gait | None:
    """A gait of a kind if a quick search finds one: for looking over many slopes."""
    stride_map = map_of(walker, tolerance=ACCURACY)

    def enough(gaits: list[Gait]) -> bool:
        return any(gait.kind == kind or stride_map.controlled for gait in gaits)

    gaits, _ = search(stride_map, slope, begin(stride_map, slope), 1, enough, _BATCHES[:1])
    return next((gait for gait in gaits if enough([gait])), None)
