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
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.gaits.section import Section, section_of, split, strides, with_derivatives
from gym_passive_walker.physics import constants as K
from gym_passive_walker.physics import integrator as I
from gym_passive_walker.physics.events import Outcome
from gym_passive_walker.physics.stride import (
    LONGEST_STRIDE,
    Stride,
    check_slope,
    check_state,
    frame_of,
    new_records,
    stride,
    strike_heels,
)
from gym_passive_walker.walkers import Walker, as_walker, describe

GaitKind = Literal["long", "short"]


class GaitNotFound(Exception):
    """No such gait; the message says for which walker and slope, and what was tried."""


@dataclass(frozen=True)
class Gait:
    """A periodic walk, in the walker's own units.

    Attributes:
        walker: Who walks.
        slope: Slope in rad.
        kind: "long" or "short" step.
        period: Strides until the motion repeats.
        state: Section state (6,): angles in rad and rates, just after heelstrike.
        multipliers: Eigenvalues of the stride map's derivative over one period, largest modulus
            first. One of a kneed walker's four, and of the simplest walker's three, is zero: the
            walker forgets it at kneestrike (at heelstrike), where two rates become one.
        stride: The first stride of the gait with its ledger.
        step_period: Mean time of a stride.
        step_length: Mean distance between contacts along the slope.
    """

    walker: Walker
    slope: float
    kind: str
    period: int
    state: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    stride: Stride
    step_period: float
    step_length: float

    @property
    def stance_angle(self) -> float:
        """Stance angle in rad just after heelstrike."""
        return float(self.state[0])

    @property
    def speed(self) -> float:
        """Mean speed along the slope."""
        return self.step_length / self.step_period

    @property
    def froude_speed(self) -> float:
        """Speed over sqrt(g l), the square root of the Froude number (Eq. 4.6)."""
        return self.speed / math.sqrt(self.walker.gravity * self.walker.leg_length)

    @property
    def cost_of_transport(self) -> float:
        """Energy lost at collisions over weight times distance (Eq. 4.3)."""
        return float(self.stride.cost_of_transport) if self.period == 1 else math.sin(self.slope)

    @property
    def kneestrike_time(self) -> float:
        """Time from heelstrike to kneestrike in the first stride; NaN without knees."""
        return float(self.stride.kneestrike_time)

    @property
    def kneestrike_loss(self) -> float:
        """Energy lost at kneestrike in the first stride."""
        return float(self.stride.kneestrike_loss)

    @property
    def heelstrike_loss(self) -> float:
        """Energy lost at heelstrike in the first stride."""
        return float(self.stride.heelstrike_loss)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out: all multipliers inside the unit circle."""
        return bool(np.abs(self.multipliers[0]) < 1.0)


# Ratios to the step angle, just before heelstrike: of the stance leg's rate, and of the swing
# leg's rate in excess of it (zero where the foot meets the ground without sliding).
_STANCE_RATIOS = -np.geomspace(1.005, 2.0, 16)
_EXCESS_RATIOS = np.array([-1.5, -1.0, -0.7, -0.45, -0.25, -0.1, 0.0, 0.1, 0.3, 0.6, 1.0, 1.6])
_LOSS_SHARES = {K.Kind.KNEED: (1.0, 0.6, 0.3), K.Kind.COMPASS: (1.0,), K.Kind.SIMPLEST: (1.0,)}
_ANGLES = np.geomspace(1e-10, 0.7, 80)
_BATCHES = (12, 24, 96)  # promising starts tried by Newton's method, as long as need be
_APART = 0.03  # starts closer than this are tried once
_MOST_ITERATIONS = 40
_LONGEST = 20.0  # time in sqrt(l/g) after which a stride is given up in a search


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


def equations(
    section: Section,
    points: NDArray,
    *,
    period: int,
    torque: float,
    tolerance: float,
    longest: float = LONGEST_STRIDE,
) -> tuple[NDArray, NDArray, NDArray]:
    """What vanishes on a gait, with its exact derivative.

    The equation for the stance leg's rate is replaced by the balance of energy, which says the
    same on a gait but keeps its digits at small slopes, where the map is nearly the identity along
    one direction.

    Args:
        section: The section.
        points: Points and slope, shape (n, dimension + 1).
        period: Strides of the gait.
        torque: Dimensionless hip torque.
        tolerance: Of the integration.
        longest: Time after which a stride is given up.

    Returns:
        Values (n, dimension), derivatives (n, dimension, dimension + 1) and the multipliers'
        matrix (n, dimension, dimension); NaN where a walker did not complete its strides.
    """
    columns = points.shape[1]
    dual = with_derivatives(points)
    section = section._replace(
        constants=np.repeat(section.constants, columns, axis=0)
        if len(section.constants) > 1
        else section.constants
    )
    u, slope = dual[:, :-1], dual[:, -1]
    result = strides(
        section, u, slope, count=period, torque=torque, tolerance=tolerance, longest=longest
    )
    gap = result.end - u
    _, map_derivative = split(result.end, columns)
    gap[:, 1] = result.imbalance
    value, derivative = split(gap, columns)
    dead = ~result.alive.reshape(-1, columns)[:, 0]
    value[dead] = np.nan
    return value, derivative, map_derivative[..., :-1]


def _size(value: NDArray) -> NDArray:
    with np.errstate(all="ignore"):
        size = np.abs(value).max(axis=1)
    return np.where(np.isfinite(size), size, np.inf)


def newton(
    section: Section,
    u: NDArray,
    slope: float,
    *,
    period: int,
    torque: float,
    tolerance: float,
    accuracy: float,
) -> tuple[NDArray, NDArray]:
    """Damped Newton iterations from many points at once, as lanes.

    Returns:
        Final points (n, dimension) and the size of the equations' violation there (n,).
    """
    u = u.copy()
    options = {
        "period": period, "torque": torque, "tolerance": tolerance, "longest": _LONGEST
    }  # fmt: skip

    def at(points: NDArray) -> tuple[NDArray, NDArray]:
        full = np.column_stack([points, np.full(len(points), slope)])
        value, derivative, _ = equations(section, full, **options)
        return value, derivative

    value, derivative = at(u)
    size = _size(value)
    damping = np.ones(len(u))
    for _ in range(_MOST_ITERATIONS):
        active = np.flatnonzero(np.isfinite(size) & (size > accuracy) & (damping > 1e-2))
        if len(active) == 0:
            break
        step = np.empty((len(active), section.dimension))
        for j, i in enumerate(active):
            try:
                step[j] = np.linalg.solve(derivative[i][:, :-1], -value[i])
            except np.linalg.LinAlgError:
                step[j] = np.nan
        length = np.abs(step).max(axis=1)
        limit = np.minimum(1.0, 0.7 / np.maximum(length, 1e-300))
        trial = u[active] + step * (damping[active] * limit)[:, None]
        sane = np.all(np.isfinite(trial), axis=1) & (trial[:, 0] < math.log(1.4))
        trial[~sane] = u[active][~sane]
        new_value, new_derivative = at(trial)
        new_size = np.where(sane, _size(new_value), np.inf)
        better = new_size < size[active]
        won, lost = active[better], active[~better]
        u[won], value[won] = trial[better], new_value[better]
        derivative[won], size[won] = new_derivative[better], new_size[better]
        damping[won] = np.minimum(1.0, 4.0 * damping[won])
        damping[lost] *= np.where(size[lost] < 1e-9, 0.0, 0.25)  # at rounding there is no better
    return u, size


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
        section, u, slopes, count=period, torque=torque, tolerance=1e-6, longest=_LONGEST
    )
    for outcome in first.records[:, I.OUTCOME].astype(int):
        ends[Outcome(outcome).name if outcome else Outcome.STALLED.name] += 1
    alive = np.flatnonzero(first.alive)
    gap = np.abs(first.end - u).max(axis=1)[alive]
    ranked = _distinct_first(u[alive[np.argsort(gap, kind="stable")]], _APART)
    tried = 0
    for batch in _BATCHES:
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
                    gaits.append(_gait(walker, section, point, slope, period, torque))
        if enough(gaits) or (gaits and tried > _BATCHES[0]):
            break
    gaits.sort(key=lambda gait: -gait.stance_angle)
    return gaits, ends


def _index(map_derivative: NDArray) -> int:
    """Sign of det(1 - D): a branch keeps it until it folds. Positive on long-step branches."""
    return int(np.sign(np.linalg.det(np.eye(len(map_derivative)) - map_derivative)))


def multipliers_of(map_derivative: NDArray) -> NDArray[np.complex128]:
    """Eigenvalues of the stride map's derivative, largest modulus first."""
    values = np.linalg.eigvals(map_derivative).astype(complex)
    return values[np.argsort(-np.abs(values), kind="stable")]


def _gait(
    walker: Walker, section: Section, u: NDArray, slope: float, period: int, torque: float
) -> Gait:
    """Measure the gait at a fixed point."""
    frame = frame_of(walker)
    point = np.append(u, slope)[None]
    _, _, derivative = equations(section, point, period=period, torque=torque, tolerance=1e-13)
    state = section.state(u[None])[0]
    state[3:] *= frame.rate
    first = walk = stride(walker, slope, state, hip_torque=torque * frame.torque, tolerance=1e-13)
    time, length = float(walk.duration), float(walk.step_length)
    for _ in range(period - 1):
        walk = stride(walker, slope, walk.state, hip_torque=torque * frame.torque, tolerance=1e-13)
        time, length = time + float(walk.duration), length + float(walk.step_length)
    return Gait(
        walker=walker,
        slope=slope,
        kind="long" if _index(derivative[0]) > 0 else "short",
        period=period,
        state=state,
        multipliers=multipliers_of(derivative[0]),
        stride=first,
        step_period=time / period,
        step_length=length / period,
    )


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
        f"no {kind}-step gait of period {period} for {describe(walker)} at slope {slope} rad{others}. "
        f"First strides of the {sum(ends.values())} starts ended so: {tried}. "
        "A passive gait needs a downhill slope that suits the walker; `gait_family` shows where "
        "its gaits begin and end, and `guess=` starts the search from a state of your own."
    )
