"""What happens inside a stride: its phases as series in time, and the collisions between them."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from gym_passive_walker.gaits.forces import Reactions, forces, impulses
from gym_passive_walker.gaits.measures import foot_velocity
from gym_passive_walker.gaits.passage import NoStride
from gym_passive_walker.gaits.series import Extreme, fit
from gym_passive_walker.gaits.stride import Stride
from gym_passive_walker.gaits.stride_map import Samples, StrideMap
from gym_passive_walker.physics.hybrid import State
from gym_passive_walker.physics.systems import body_of, system_of
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker

_SHORTEST = 1e-12  # share of a stride below which a phase is none
_INFINITESIMAL = 1e-100  # imaginary part that carries a derivative: its square is nothing
_PIECES = 10_000  # in which torques may be held


class Impulse(NamedTuple):
    """What the ground gives the stance foot in a collision.

    Attributes:
        normal: Away from the ground.
        tangential: Along the slope, positive downhill.
        time: When.
    """

    normal: float
    tangential: float
    time: float

    @property
    def friction(self) -> Extreme:
        """Coefficient of friction needed; infinite if the ground would have to pull."""
        if np.isnan(self.normal):
            return Extreme(np.nan, self.time)
        ratio = abs(self.tangential) / self.normal if self.normal > 0.0 else np.inf
        return Extreme(ratio, self.time)


class Collision(NamedTuple):
    """Impulses of a collision.

    Attributes:
        ground: On the stance foot.
        knee: On the stance knee's stop, positive when it is pressed.
    """

    ground: Impulse
    knee: Extreme


NO_COLLISION = Collision(Impulse(np.nan, np.nan, np.nan), Extreme(np.nan, np.nan))


class Phase(NamedTuple):
    """Quantities over one phase as series in time, in the walker's own units.

    Attributes:
        locked: Whether the swing leg is straight.
        state: Angles and rates, six series.
        flexion: Thigh less shank angle.
        clearance: Height of the swing foot over the ground.
        normal: Force of the ground, as in `forces.Reactions`.
        tangential: Likewise.
        stance_knee: Torque on the stop, likewise, but 0 without knees.
        swing_knee: Likewise.
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
    def start(self) -> float:
        """When it starts."""
        return float(self.clearance.domain[0])

    @property
    def end(self) -> float:
        """When it ends."""
        return float(self.clearance.domain[1])

    def state_at(self, time: float) -> NDArray[np.float64]:
        """The state (6,)."""
        return np.array([series(time) for series in self.state])


def foot_clearance(walker: Walker, states: NDArray) -> tuple[NDArray, NDArray]:
    """Height of the swing foot over the ground, and the height's rate, at states (n, 6).

    The foot is a whole circle here.
    """
    # Angles that move by infinitesimal rates move the height by as much of its own rate.
    angles, rates = states[:, :3] + 1j * _INFINITESIMAL * states[:, 3:], states[:, 3:]
    moving = State(*angles.T, *rates.T)
    clearance = system_of(walker).foot_clearance(body_of(walker), moving) * walker.leg_length
    return np.real(clearance), np.imag(clearance) / _INFINITESIMAL


def phases_of(
    stride_map: StrideMap, slope: float, start: NDArray, end: Stride, *, offset: float
) -> list[Phase]:
    """The phases of one stride: two with knees and one without, and more where torques change.

    Args:
        stride_map: Whose stride.
        slope: Slope in rad.
        start: Where the stride starts, shape (6,).
        end: How it ends: with a heelstrike.
        offset: Time at its start.

    Raises:
        NoStride: if one of two phases takes no time.
    """
    walker, tolerance = stride_map.walker, stride_map.tolerance
    own, first_state = units_of(walker), stride_map.dimensionless(start)
    units = np.repeat([1.0, own.rate, 1.0, own.length, own.force, own.energy], [3, 3, 1, 1, 2, 2])

    def look(times: NDArray) -> Samples:
        return stride_map.look(first_state, np.array([slope]), times[None] / own.time)

    def samples(times: NDArray) -> NDArray:
        seen = look(times)
        states, stages = own.to_own(seen.states[0]), seen.stages[0]
        carried = forces(walker, slope, states, stages, hip_torque=hip, ankle_torque=ankle)
        knees = np.nan_to_num(np.stack([carried.stance_knee, carried.swing_knee]))
        flexion, clearance = states[:, 1] - states[:, 2], foot_clearance(walker, states)[0]
        ground = [carried.normal, carried.tangential]
        return np.column_stack([states, flexion, clearance, *ground, *knees])

    duration = float(end.duration)
    knee = float(end.kneestrike_time) if walker.knees else duration
    shortest = _SHORTEST * duration
    if walker.knees and duration - knee < shortest:
        raise NoStride("kneestrike and heelstrike coincide: the swing leg is never straight")
    instants = {0.0, knee, duration}
    held = stride_map.hold * own.time
    for count in range(1, math.ceil(min(duration / held, _PIECES))):
        if min(abs(count * held - instant) for instant in (knee, duration)) > shortest:
            instants.add(count * held)
    phases = []
    for first, last in pairwise(sorted(instants)):
        torques = look(np.array([0.5 * (first + last)])).torques[0, 0]
        hip, ankle = float(torques[0]) * own.torque, float(torques[1]) * own.energy
        series = fit(samples, first, last, units=units, accuracy=10.0 * tolerance)
        for piece in series:
            piece.domain = piece.domain + offset
        phases.append(Phase(first >= knee, series[:6], *series[6:]))
    return phases


def _collision(given: Reactions, time: float) -> Collision:
    return Collision(
        Impulse(float(given.normal[0]), float(given.tangential[0]), time),
        Extreme(float(given.stance_knee[0]), time),
    )


def kneestrike(walker: Walker, free: Phase, locked: Phase) -> Collision:
    """Impulses on the stance leg at kneestrike."""
    before, after = free.state_at(free.end), locked.state_at(locked.start)
    return _collision(impulses(walker, after[None, :3], (after - before)[None, 3:]), free.end)


def heelstrike(walker: Walker, last: Phase, after: NDArray) -> Collision:
    """Impulses on the new stance leg at heelstrike, which leads to the section state `after`."""
    before = last.state_at(last.end)
    velocity = np.array(foot_velocity(walker, before))
    jump = after[3:] - before[[4, 3, 3]]  # the legs exchange their roles
    return _collision(impulses(walker, after[None, :3], jump[None], -velocity), last.end)
