"""The phases of a stride as series, and the collisions between them.

Between impacts everything is analytic. A Chebyshev series through a few dozen exact samples of a
phase holds a quantity to rounding at every instant, ends included. Its derivative says where it
turns. All is in the walker's own units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebinterpolate, chebpts1
from numpy.typing import NDArray

from gym_passive_walker.gaits.look.forces import forces, landing, pushed_off, struck
from gym_passive_walker.gaits.map_result import NoStride
from gym_passive_walker.gaits.stride import Stride
from gym_passive_walker.gaits.stride_map import Samples, StrideMap
from gym_passive_walker.models.equations.hybrid import SMOOTH, Ground, State
from gym_passive_walker.models.equations.numbers import complex_step, step_derivative
from gym_passive_walker.models.walkers import Walker

_SHORTEST = 1e-12  # share of a stride below which a phase is none
_PIECES = 10_000  # in which torques may be held
_FEWEST, _MOST = 32, 256  # samples of a phase
_ROUNDING = 1e-14
_LOOKS = 6  # at a series, for each of its coefficients, when its turns are sought


def clearance_of(walker: Walker, states: NDArray) -> tuple[NDArray, NDArray]:
    """Return the height of the swing foot over the ground and its rate, at states (n, 6 or 2 m).

    The foot is a whole circle here.
    """
    # Angles that move by infinitesimal rates move the height by as much of its own rate.
    angles, rates = np.split(states, 2, axis=1)
    system = walker.equations()
    moving = system.State(*complex_step(angles, rates).T, *rates.T)
    clearance = system.foot_clearance(walker.body, moving) * walker.leg_length
    return np.real(clearance), step_derivative(clearance)


class TimedExtremum(NamedTuple):
    """An extreme value and its time."""

    value: float
    time: float


def fit(
    samples: Callable[[NDArray], NDArray],
    start: float,
    end: float,
    *,
    units: NDArray,
    accuracy: float,
) -> list[Chebyshev]:
    """Fit series to several quantities over a phase.

    Args:
        samples: Takes times (n,) inside the phase to quantities (n, k).
        start: Time at which the phase starts.
        end: Time at which it ends.
        units: Units of the quantities, (k,): their rounding errors are of numbers of this size.
        accuracy: Accuracy of the samples, relative to the largest of each quantity.
    """
    count, before = _FEWEST, np.full(len(units), np.inf)
    while True:
        values = samples(0.5 * (start + end) + 0.5 * (end - start) * chebpts1(count))
        columns = chebinterpolate(lambda _, values=values: values, count - 1)  # type: ignore
        size, tail = np.abs(columns).max(axis=0), np.abs(columns[-4:]).max(axis=0)
        resolved = tail <= accuracy * size + _ROUNDING * units
        noisy = tail > 0.1 * before  # more samples bring no more digits
        if count >= _MOST or np.all(resolved | noisy):
            break
        count, before = 2 * count, tail
    return [
        Chebyshev(column, domain=(start, end)).trim(noise)
        for column, noise in zip(columns.T, tail, strict=True)
    ]


def _zeros(function: Callable[[NDArray], NDArray], series: Chebyshev) -> list[float]:
    """Return the zeros, inside a phase, of a function with no more detail than a series."""
    start, end = series.domain
    looks = -np.cos(np.linspace(0.0, np.pi, _LOOKS * (len(series.coef) + 2)))  # denser at the ends
    times = 0.5 * (start + end) + 0.5 * (end - start) * looks
    signs = np.signbit(function(times))
    return [
        float(scipy.optimize.brentq(function, times[i], times[i + 1], xtol=1e-15 * (end - start)))  # type: ignore
        for i in np.flatnonzero(signs[1:] != signs[:-1])
    ]


def turns(pieces: Iterable[Chebyshev]) -> list[TimedExtremum]:
    """Return local extrema and ends of phases, in order of time; monotone in between."""
    found = []
    for piece in pieces:
        start, end = piece.domain
        times = [start, *_zeros(piece.deriv(), piece), end]
        found += [TimedExtremum(float(piece(t)), float(t)) for t in times]
    return found


def ratio_turns(pieces: Iterable[tuple[Chebyshev, Chebyshev]]) -> list[TimedExtremum]:
    """Return the `turns` of quotients of series; infinite where a denominator is not positive."""
    found = []
    for above, below in pieces:
        rise, lift = above.deriv(), below.deriv()

        def slope(t, above=above, below=below, rise=rise, lift=lift):
            return rise(t) * below(t) - above(t) * lift(t)

        finer = max(above, below, key=lambda series: len(series.coef))
        for t in [*(turn.time for turn in turns([below])), *_zeros(slope, finer)]:
            quotient = above(t) / below(t) if below(t) > 0.0 else np.inf
            found.append(TimedExtremum(float(quotient), float(t)))
    return sorted(found, key=lambda turn: turn.time)


def least(candidates: Iterable[TimedExtremum]) -> TimedExtremum:
    """Return the smallest value at its first time; NaN if there is none."""
    return min(candidates, key=lambda extreme: extreme.value, default=TimedExtremum(np.nan, np.nan))


def greatest(candidates: Iterable[TimedExtremum]) -> TimedExtremum:
    """Return the largest value at its first time; NaN if there is none."""
    return max(candidates, key=lambda extreme: extreme.value, default=TimedExtremum(np.nan, np.nan))


class Impulse(NamedTuple):
    """Impulse of the ground on the stance foot in a collision.

    Attributes:
        normal_impulse: Component away from the ground.
        tangential_impulse: Component along the slope, positive downhill.
        time: Time of the collision.
    """

    normal_impulse: float
    tangential_impulse: float
    time: float

    @property
    def needed_friction(self) -> TimedExtremum:
        """Coefficient of friction needed; infinite if the ground would have to pull."""
        normal, tangential, time = self
        if np.isnan(normal):
            return TimedExtremum(np.nan, time)
        return TimedExtremum(abs(tangential) / normal if normal > 0.0 else np.inf, time)


class DensePhase(NamedTuple):
    """Quantities over one phase as series in time, in the walker's own units.

    Attributes:
        locked: Whether the swing leg is straight.
        state: Coordinates and rates, a series for each.
        flexion: Thigh less shank angle; 0 without knees.
        clearance: Height of the swing foot over the ground.
        normal: Force of the ground, as in `forces.Reactions`.
        tangential: Force of the ground along it, as in `forces.Reactions`.
        stance_knee: Torque on the stop; 0 without knees.
        swing_knee: Torque on the swing knee's stop; 0 without knees.
    """

    locked: bool
    state: list[Chebyshev]
    flexion: Chebyshev
    clearance: Chebyshev
    normal: Chebyshev
    tangential: Chebyshev
    stance_knee: Chebyshev
    swing_knee: Chebyshev

    @property
    def end(self) -> float:
        """When it ends."""
        return float(self.clearance.domain[1])

    def state_at(self, time: float) -> NDArray[np.float64]:
        """The state (6 or 2 m,)."""
        return np.array([series(time) for series in self.state])


def dense_phases(
    stride_map: StrideMap, slope: float, start: NDArray, end: Stride, *, offset: float
) -> list[DensePhase]:
    """The phases of one stride: two with knees and one without, and more where torques change.

    Args:
        stride_map: The stride map.
        slope: Slope in rad.
        start: Initial state, shape (6,), or (2 m,) of a system.
        end: The stride, which ends with a heelstrike.
        offset: Time at its start.

    Raises:
        NoStride: if one of two phases takes no time.
    """
    walker, tolerance = stride_map.walker, stride_map.tolerance
    own, first_state, size = walker.units, stride_map.dimensionless(start), walker.size
    each = [size // 2, size // 2, 1, 1, 2, 2]
    units = np.repeat([1.0, own.rate, 1.0, own.length, own.force, own.energy], each)

    def look(times: NDArray) -> Samples:
        return stride_map.look(first_state, np.array([slope]), times[None] / own.time)

    def samples(times: NDArray) -> NDArray:
        seen = look(times)
        states, stages = own.to_own(seen.states[0]), seen.stages[0]
        carried = forces(walker, slope, states, stages, held)
        knees = np.nan_to_num(np.stack([carried.stance_knee, carried.swing_knee]))
        flexion = states[:, 1] - states[:, 2] if walker.knees else np.zeros(len(states))
        clearance = clearance_of(walker, states)[0]
        ground = [carried.normal, carried.tangential]
        return np.column_stack([states, flexion, clearance, *ground, *knees])

    duration = float(end.duration)
    shortest, locks = _SHORTEST * duration, bool(end.kneestrike_time > 0.0)
    knee = float(end.kneestrike_time) if locks else duration
    if locks and duration - knee < shortest:
        raise NoStride("kneestrike and heelstrike coincide: the swing leg is never straight")
    instants = {0.0, knee, duration}
    hold = stride_map.hold * own.time
    for count in range(1, math.ceil(min(duration / hold, _PIECES))):
        if min(abs(count * hold - instant) for instant in (knee, duration)) > shortest:
            instants.add(count * hold)
    phases = []
    for first, last in pairwise(sorted(instants)):
        torques = look(np.array([0.5 * (first + last)])).controls[0, 0]
        held = torques[: len(walker.control_units)] * walker.control_units
        series = fit(samples, first, last, units=units, accuracy=10.0 * tolerance)
        for piece in series:
            piece.domain = piece.domain + offset
        phases.append(DensePhase(first >= knee, series[:size], *series[size:]))
    return phases


def kneestrike_impulses(
    walker: Walker, before: NDArray, after: NDArray, time: float
) -> tuple[Impulse, TimedExtremum]:
    """Impulses of a kneestrike, from the states (6,) just before and just after it.

    Returns:
        That on the stance foot, and that on the stance knee's stop, positive when it is pressed.
    """
    if (momentum := _momentum_change(walker, before, after, time)) is not None:
        return momentum
    jumps = (after - before)[3:] * walker.units.time
    return _given(walker, struck(walker.body, after[:3], jumps, (0.0, 0.0)), time)


def heelstrike_impulses(
    walker: Walker,
    before: NDArray,
    after: NDArray,
    time: float,
    push_off: float,
    ground: Ground = SMOOTH,
) -> tuple[tuple[Impulse, TimedExtremum], tuple[Impulse, TimedExtremum]]:
    """Impulses of a heelstrike, and of the push-off before it.

    Args:
        walker: The walker.
        before: State (6,) just before both.
        after: State (6,) just after both, with the roles that legs then have.
        time: Their time.
        push_off: Impulse along the old stance leg, dimensionless.
        ground: Ground with the next foothold.

    Returns:
        That of the ground on the new stance foot, and that on the new stance knee's stop, positive
        when it is pressed, from the normal of the next foothold; the same of the push-off, on the
        old foot and knee, from the normal of the old foothold; NaN without one.
    """
    units, body = walker.units, walker.body
    none = Impulse(np.nan, np.nan, time), TimedExtremum(np.nan, np.nan)
    if (momentum := _momentum_change(walker, before, after, time, walker.swapped)) is not None:
        return momentum, none
    state = State(*units.to_dimensionless(before))
    left = pushed_off(body, state, push_off, ground) if push_off else (np.nan,) * 4
    old, (back, up) = landing(body, state, push_off, ground)
    rates = np.array([old.thigh_rate, old.stance_rate, old.stance_rate])
    jumps = units.to_dimensionless(after)[3:] - rates
    given = _given(walker, struck(body, after[:3], jumps, (-back, -up)), time)
    return given, _given(walker, left, time)


def _momentum_change(
    walker: Walker, before: NDArray, after: NDArray, time: float, then: Walker | None = None
) -> tuple[Impulse, TimedExtremum] | None:
    """Impulse on a system by the change of its momentum, if that is known; else None.

    Its legs are those of `then` after the impact, if they have exchanged their roles.
    """
    system = walker.equations()
    if system.momentum is None:
        return None
    bodies = walker.body, (then or walker).body
    each = zip(bodies, (before, after), strict=True)
    momenta = [system.momentum(body, system.State(*state)) for body, state in each]
    along, up = np.diff(momenta, axis=0)[0]
    return Impulse(up, along, time), TimedExtremum(np.nan, np.nan)


def _given(
    walker: Walker, carried: tuple[float, ...], time: float
) -> tuple[Impulse, TimedExtremum]:
    """Impulses (back, up, on the stance knee's stop, …), in the walker's own units."""
    units, (back, up, knee, _) = walker.units, map(float, carried)
    scale = units.force * units.time
    ground = Impulse(up * scale, -back * scale, time)
    return ground, TimedExtremum(knee * units.energy * units.time if walker.knees else np.nan, time)
