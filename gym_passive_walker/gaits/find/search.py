"""Search for gaits, the fixed points of the stride map, without an initial guess.

Just before a heelstrike three numbers determine the motion: the step's size and the ratios of the
two legs' angular velocities to it. Initial guesses are a small grid of these ratios. Each takes
the step size at which the impact loses the energy that the slope supplies. This grid suits every
slope and every walker of human proportions. Gaits of several strides are searched for near the
points to which walks return.

All initial guesses take their first strides in one batch. The most promising go on to Newton's
method with the exact derivative, a batch at a time, away from the gaits already found.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import check_state
from gym_passive_walker.gaits.find.newton import newton
from gym_passive_walker.gaits.gait import Gait, GaitKind, gait_at, gait_equations
from gym_passive_walker.gaits.section import Section
from gym_passive_walker.gaits.stride_map import MapLike, StrideMap, map_of
from gym_passive_walker.models.equations import legs
from gym_passive_walker.models.equations.hybrid import SMOOTH, Outcome
from gym_passive_walker.models.equations.numbers import natural_logarithm, power_of_e
from gym_passive_walker.models.walkers import Walker

ACCURACY = 1e-12
"""Integration tolerance of the strides in a search."""

_BATCHES = (12, 24, 96)  # initial guesses for Newton's method, one batch after the other
_PATIENCE = 2  # iterations left to the other guesses after the first has led to a gait
_LATTICE = 216  # guesses in a quick search; a kneed walker's full grid has 864
_APART = 0.03  # guesses closer than this are tried once
_LOOKS = 64  # samples of the swing leg in a stride
_ROUGHLY, _FINELY = 1e-6, 1e-14  # tolerances
_ALIKE, _NEARLY = 1e-6, 1e-3  # gaits closer than this are one: exact derivatives, differences


def _geometric(low: float, high: float, count: int) -> NDArray:
    return power_of_e(np.linspace(natural_logarithm(low), natural_logarithm(high), count))


# Ratios to the step angle, just before heelstrike: of the stance leg's angular velocity, and of
# the swing leg's angular velocity in excess of it (zero where the foot lands without sliding).
# Excesses far from zero belong to slow gaits of untuned walkers and to short steps on steep slopes.
# The simplest walker's swing leg needs no excess, as a heelstrike sets its angular velocity.
_EXCESSES = (-6.0, -4.0, -2.8, -2.0, -1.5, -1.0, -0.7, -0.45, -0.25, -0.1)
_EXCESSES += (0.0, 0.1, 0.3, 0.6, 1.0, 1.6, 2.2, 2.8)
_RATIOS = -_geometric(1.005, 2.0, 16), np.array(_EXCESSES)
_RATIOS_OF_THE_SIMPLEST = -_geometric(1.005, 2.0, 200), np.zeros(1)
_LOSS_SHARES = (1.0, 0.6, 0.3)  # of the energy supplied, lost at heelstrike; 1 without knees
_ANGLES = _geometric(1e-10, 0.7, 80)
_PUSHED_ANGLES = _geometric(1e-4, 0.7, 120)  # no tiny steps with a push-off
_LEAST = 1e-300  # smallest energy, so that logarithms are finite

_WALKERS, _SETTLING, _KEPT = 48, 100, 12  # number of walks, transient strides, recorded strides
_BESIDE = 200  # states around the start of a user's system
_RETURNING = 1e-7  # tolerance of these walks


def at_heelstrike(
    section: Section,
    angles: NDArray,
    stance_rates: NDArray,
    swing_rates: NDArray,
    push_off: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Apply a heelstrike to straight legs with given angular velocities; dimensionless.

    Args:
        section: Section of one walker.
        angles: Stance angles just after the heelstrike, (n,).
        stance_rates: Angular velocities of the old stance leg just before it, (n,).
        swing_rates: Angular velocities of the old swing leg just before it, (n,).
        push_off: Impulse just before the heelstrike.

    Returns:
        Points after the heelstrike, (n, m); the energy lost and the push-off's work, (n,) each.
    """
    reset = section.walker.equations().phases[-1].resets[Outcome.HEELSTRIKE]
    before = legs.straight(-angles, angles, stance_rates, swing_rates)
    struck = reset.strike(section.walker.body, before, push_off, SMOOTH)
    work = np.broadcast_to(struck.work, struck.lost.shape)
    return section.point(np.stack(struck.after, axis=-1)), struck.lost, work


def _starts(stride_map: StrideMap, slope: float) -> NDArray:
    """Return initial guesses for a gait of one stride, in logarithmic coordinates, (n, m)."""
    held = stride_map.actuation
    u, loss, pushed = _grid(stride_map.walker, held.push_off)
    # Over a step, the hip opens by four stance angles and the stance leg turns by two. A step is
    # about two stance angles long, so these are about two and one for each unit of length.
    works = stride_map.system.works
    given = 2.0 * works.hip * held.hip_torque + works.ankle * held.ankle_torque
    supply = np.sin(slope + stride_map.ground[:, 0]).mean() + given + pushed
    if stride_map.terrain is not None:
        rise = float(stride_map.ground[:, 1].mean())
        angles = power_of_e(u[0, :, 0])
        lengths = legs.step_length(stride_map.walker.body, angles, angles)
        supply = supply - rise * math.cos(slope) / lengths
    if not np.any(supply > 0.0):
        return np.empty((0, stride_map.dimension))
    found = []
    for share in _LOSS_SHARES if stride_map.walker.knees else _LOSS_SHARES[:1]:
        excess = loss - natural_logarithm(np.maximum(share * supply, _LEAST))
        short = excess < 0.0
        # With a push-off uphill, steps of two sizes are in balance.
        rows, above = np.nonzero(short[:, :-1] != short[:, 1:])
        low, high = excess[rows, above], excess[rows, above + 1]
        part = (low / (low - high))[:, None]
        found.append((1.0 - part) * u[rows, above] + part * u[rows, above + 1])
    return np.concatenate(found)


@lru_cache(maxsize=64)
def _grid(walker: Walker, push_off: float) -> tuple[NDArray, NDArray, NDArray | float]:
    """Return points just after heelstrike on a grid of ratios and angles, with their energies.

    Energies are over the weight and the step's length.

    Returns:
        Logarithmic coordinates (ratios, angles, m); the logarithm of the heelstrike's loss,
        (ratios, angles); and the work of the push-off before it, (ratios, angles) or 0.
    """
    stride_map = StrideMap.of(walker)
    ratios = _RATIOS_OF_THE_SIMPLEST if walker.massless_legs else _RATIOS
    stance, excess = (x.ravel() for x in np.meshgrid(*ratios))
    angles = _PUSHED_ANGLES if push_off else _ANGLES
    angle = np.tile(angles, len(stance))
    stance_rate = np.repeat(stance, len(angles)) * angle
    swing_rate = np.repeat(stance + excess, len(angles)) * angle
    points, *energies = at_heelstrike(stride_map, angle, stance_rate, swing_rate, push_off)
    shape, lengths = (len(stance), len(angles)), legs.step_length(walker.body, angle, angle)
    lost, pushed = ((energy / lengths).reshape(shape) for energy in energies)
    u = stride_map.at(points).search.reshape(*shape, -1)
    loss = natural_logarithm(np.maximum(lost, _LEAST))
    return u, loss, pushed if push_off else 0.0


def _returns(stride_map: StrideMap, slope: float, gaits: list[Gait]) -> NDArray:
    """Return points (k, m) in the chart along walks that begin beside gaits, after a transient.

    After a period doubling, or in chaos, such walks pass near every gait.
    """
    roughly = stride_map.with_tolerance(_RETURNING)
    beside = np.random.default_rng(0).standard_normal((_WALKERS, stride_map.dimension))
    size = np.geomspace(1e-4, 0.03, _WALKERS)[:, None]
    near = stride_map.points([gait.state for gait in gaits]).search
    points = stride_map.searched(np.concatenate([u + size * beside for u in near])).values
    points = roughly.apply(points, slope, strides=_SETTLING).ends
    points = points[np.isfinite(points[:, 0])]
    kept = []
    for _ in range(_KEPT):
        points = roughly.apply(points, slope).ends
        kept.append(points)
    points = np.concatenate(kept)
    return stride_map.at(points[np.isfinite(points[:, 0])]).search


def _distinct(u: NDArray, others: list[NDArray], apart: float) -> NDArray:
    """Return the points that are farther than `apart` from `others` and from all points before."""
    kept: list[NDArray] = []
    for point in u:
        if all(np.abs(point - other).max() > apart for other in kept + others):
            kept.append(point)
    return np.array(kept).reshape(-1, u.shape[1])


class _Guesses:
    """Initial guesses of a search, the most promising first.

    The score of a guess is the distance by which its strides move it; less is better. Near a gait
    already found every guess moves little, so the score is divided by the distance from that gait.
    """

    def __init__(self, u: NDArray, end: NDArray) -> None:
        self.u, self.score = u, np.abs(end - u).max(axis=1)  # infinite once tried

    def avoid(self, point: NDArray) -> None:
        """Raise the scores of guesses near a gait already found."""
        distance = np.abs(self.u - point).max(axis=1)
        self.score = self.score / np.clip(distance, 1e-6, 1.0)

    def best(self, count: int) -> NDArray:
        """Return up to `count` untried guesses, each apart from the others."""
        chosen: list[NDArray] = []
        while len(chosen) < min(count, len(self.u)):
            i = self.score.argmin()
            if self.score[i] == math.inf:
                break
            chosen.append(self.u[i])
            self.score[np.abs(self.u - self.u[i]).max(axis=1) <= _APART] = math.inf
        return np.array(chosen).reshape(-1, self.u.shape[1])


def _search(
    stride_map: StrideMap,
    slope: float,
    u: NDArray,
    period: int,
    enough: Callable[[list[Gait]], bool],
    batches: tuple[int, ...] = _BATCHES,
    patience: int | None = None,
) -> tuple[list[Gait], Counter]:
    """Return gaits that Newton's method reaches, and the outcomes of the first strides.

    Args:
        stride_map: Stride map of one walker.
        slope: Slope in rad.
        u: Initial guesses, as coordinates (n, m) in the chart.
        period: Strides until a gait repeats.
        enough: Function of the gaits found; the search ends when it returns True.
        batches: Number of guesses in each batch for Newton's method.
        patience: As for `newton`.
    """
    gaits: list[Gait] = []
    found: list[NDArray] = []
    roughly, finely = stride_map.with_tolerance(_ROUGHLY), stride_map.with_tolerance(_FINELY)
    kinds = "step kinds" in stride_map.walker.supports
    closes, alike = stride_map.closes, _ALIKE if stride_map.exact else _NEARLY

    def solutions(followed: StrideMap, guesses: NDArray, accuracy: float, limit: float) -> NDArray:
        def equations(u: NDArray) -> tuple[NDArray, NDArray]:
            return gait_equations(followed, followed.chart.within(u), slope, period=period)[:2]

        solved = newton(equations, guesses, accuracy=accuracy, patience=patience)
        return solved.points[solved.sizes < limit]

    first = roughly.apply(stride_map.searched(u).values, slope, strides=period)
    ends = Counter({Outcome(i).name: n for i, n in enumerate(np.bincount(first.outcomes)) if n})
    # A heelstrike behind the stance foot starts no walk.
    ahead = first.alive & stride_map.chart.ahead(first.ends)
    candidates = _Guesses(u[ahead], stride_map.at(first.ends[ahead]).search)
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
                with suppress(np.linalg.LinAlgError):  # rounding may leave no stride
                    gait = gait_at(stride_map.searched(point[None]), slope, period)
                    if not kinds or _human(roughly, gait):
                        gaits.append(gait)
            for stride in orbit:
                found.append(stride)
                candidates.avoid(stride)
        if enough(gaits):
            break
    # Steps without kinds have no common measure: the most stable gait comes first.
    gaits.sort(key=lambda g: -g.stance_angle if kinds else abs(g.multipliers[0]))
    return gaits, ends


def _orbit(
    stride_map: StrideMap, u: NDArray, slope: float, period: int, alike: float
) -> list[NDArray]:
    """Return the points of a gait from one of them on, until it repeats."""
    orbit = [u]
    while len(orbit) < period:
        start = stride_map.searched(orbit[-1][None]).values
        end = stride_map.at(stride_map.apply(start, slope).ends).search[0]
        if period % len(orbit) == 0 and np.abs(end - u).max() < alike:
            break
        orbit.append(end)
    return orbit


def _human(stride_map: StrideMap, gait: Gait) -> bool:
    """Return whether the swing leg swings forward only once in a step."""
    walker, duration = gait.walker, float(gait.stride.duration) / stride_map.units.time
    times = duration * np.linspace(0.0, 1.0 - 1e-4, _LOOKS)[None]
    rates = stride_map.sample(gait.point.values, gait.slope, times).states[0, :, 3:]
    forward = walker.thigh_length * rates[:, 1] + walker.shank_length * rates[:, 2]
    swings = np.count_nonzero(np.diff(forward > 0.0, prepend=False) & (forward > 0.0))
    return swings == 1


def _guesses(
    stride_map: StrideMap, slope: float, period: int = 1, guess: ArrayLike | None = None
) -> NDArray:
    """Return initial guesses (n, m) in the chart: `guess`, or those for this period."""
    if guess is not None:
        states = np.atleast_2d(check_state(guess, "guess", stride_map.walker))
        return stride_map.points(states).search
    kinds = "step kinds" in stride_map.walker.supports
    if slope <= 0.0 and stride_map.passive and stride_map.terrain is None and kinds:
        return np.empty((0, stride_map.dimension))
    if not kinds:
        u = _beside_start(stride_map)
    elif stride_map.controlled:
        u = stride_map.at(stride_map.likely(slope)).search  # type: ignore[attr-defined]
    else:
        u = _starts(stride_map, slope)
    if period == 1:
        return u
    gaits, _ = _search(stride_map, slope, u, 1, lambda gaits: len(gaits) >= 2)
    return np.concatenate([_returns(stride_map, slope, gaits), u]) if gaits else u


def _beside_start(stride_map: StrideMap) -> NDArray:
    """Return the state with which a user's system starts, and others around it, (n, m)."""
    system: Any = stride_map.walker
    start = system.start
    if start is None:
        raise ValueError(
            f"system {system.name!r} has no start: give it one, or give the search a "
            "guess, a state just after heelstrike"
        )
    rng, start = np.random.default_rng(0), np.array(start, dtype=float)
    beside = rng.standard_normal((_BESIDE, len(start))) * rng.uniform(0.0, 0.3, (_BESIDE, 1))
    size = np.maximum(np.abs(start), 0.3 * np.abs(start).max())
    return np.concatenate([start[None], start + size * beside])


class Sought(NamedTuple):
    """Result of a search for one gait.

    Attributes:
        gait: The gait; None if there is none.
        all: Every gait found by the search, longest step first.
        ends: Outcomes of the first strides of the initial guesses, with their numbers.
    """

    gait: Gait | None
    all: list[Gait]
    ends: Counter


def seek(
    walker: MapLike,
    slope: float,
    kind: GaitKind | None = "long",
    *,
    period: int = 1,
    guess: ArrayLike | None = None,
    quick: bool = False,
) -> Sought:
    """Search for a gait like `fixed_point.find_gait`, but do not raise if there is none.

    Args:
        walker: The walker or stride map, as for `find_gait`.
        slope: Slope in rad.
        kind: "long" or "short"; None for every gait, as for `find_gaits`.
        period: Strides until the motion repeats.
        guess: States on the Poincaré section, as for `find_gaits`.
        quick: Whether to end the search after the most promising guesses.
    """
    stride_map = map_of(walker, tolerance=ACCURACY)
    # Under a controller the kind of a gait is not known in advance.
    any_kind = kind is None or guess is not None or stride_map.controlled
    # Uphill, a push-off balances the losses of steps of two sizes, each long and short.
    most = 4 if stride_map.actuation.push_off else 2

    def wanted(gait: Gait) -> bool:
        return any_kind or period > 1 or gait.kind == kind

    def enough(gaits: list[Gait]) -> bool:
        if kind is None:
            return len(gaits) >= most
        short = kind == "short"
        return any(any_kind or (wanted(x) and x.beyond_fold == short) for x in gaits)

    u = _guesses(stride_map, slope, period, guess)
    gaits, ends = [], Counter()
    if kind is not None:
        few = u[:: max(1, len(u) // _LATTICE)] if period == 1 and guess is None else u
        some, patience = (u, None) if quick else (few, _PATIENCE)
        gaits, ends = _search(stride_map, slope, some, period, enough, _BATCHES[:1], patience)
    if not (quick or enough(gaits)):  # guesses left out or stopped early may lead to it
        gaits, ends = _search(stride_map, slope, u, period, enough)
    chosen = [gait for gait in gaits if wanted(gait)]
    if period > 1 and guess is None:  # gaits of several strides are born in pairs, at folds
        chosen = [gait for gait in chosen if enough([gait])] or chosen
    return Sought(chosen[-1 if kind == "short" else 0] if chosen else None, gaits, ends)
