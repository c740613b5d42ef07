"""Strides by SciPy's integrator on the independent equations, with independent collisions.

It is slow and simple. It uses nothing of the engine but the conventions of a state.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853, OdeSolution
from scipy.optimize import brentq

from gym_passive_walker import Outcome, Walker
from tests.equations import bodies, lagrange


def hip_and_feet_of_no_mass(walker: Walker, slope: float, torque: float, ankle: float = 0.0):
    """Accelerations of the simplest walker: a point on a strut, and a pendulum hung from it.

    Newton's law for the hip along its circle, then for the swing foot along its own, with gravity
    and the hip's acceleration. `torque` is per unit of foot mass; `ankle` tips the strut forward.
    """
    length = walker.leg_length
    gravity = walker.gravity * cmath.exp(-1j * (0.5 * np.pi - slope))

    def accelerations(state) -> np.ndarray:
        stance, swing, _, stance_rate, _, _ = state
        strut, tangent = 1j * cmath.exp(1j * stance), -cmath.exp(1j * stance)
        stance_acceleration = (tangent.conjugate() * gravity).real / length
        stance_acceleration -= ankle / (walker.hip_mass * length**2)
        hip = length * (stance_acceleration * tangent - stance_rate**2 * strut)
        forward = cmath.exp(1j * swing)  # how the swing foot moves as the leg turns
        swing_acceleration = (forward.conjugate() * (gravity - hip)).real / length
        swing_acceleration += torque / length**2
        return np.array([stance_acceleration, swing_acceleration, swing_acceleration])

    return accelerations


def motion(walker: Walker, slope: float, torque: float, ankle: float = 0.0, *, locked: bool):
    """Accelerations of any walker as a function of its state."""
    if walker.massless_legs:
        return hip_and_feet_of_no_mass(walker, slope, torque, ankle)
    return lagrange.motion(walker, slope, torque, ankle, locked=locked)


def simplest_heelstrike(walker: Walker, stance: float, stance_rate: float):
    """Heelstrike where only the hip has mass: rates of new stance and swing leg, and the loss.

    The impulse of the new leg acts along it, so what remains of the hip's velocity is across it.
    The old foot gains velocity along the old leg only, and that leg's two ends keep their distance.
    """
    length = walker.leg_length
    hip = -length * stance_rate * cmath.exp(1j * stance)
    across_new, across_old = -cmath.exp(-1j * stance), -cmath.exp(1j * stance)
    speed = (across_new.conjugate() * hip).real
    kept = speed * across_new
    rates = np.array([speed, (across_old.conjugate() * kept).real]) / length
    return rates, 0.5 * walker.hip_mass * abs(hip - kept) ** 2


class Phase(NamedTuple):
    """A stretch of motion between collisions.

    Attributes:
        times: ends of the integration steps, from the phase's start to its end.
        state: function of time in that range, the state [angles, rates].
        event: what ended it; RUNNING if the time was up.
    """

    times: np.ndarray
    state: Callable[[float], np.ndarray]
    event: Outcome


class Walk(NamedTuple):
    """Results of the oracle's stride, in the walker's own units."""

    outcome: Outcome
    state: np.ndarray
    duration: float
    kneestrike_time: float
    kneestrike_loss: float
    heelstrike_loss: float
    phases: list[Phase]


BOUNDS = [
    (Outcome.FELL_FORWARD, lambda s: s[0] + 0.5 * np.pi),
    (Outcome.FELL_BACKWARD, lambda s: 0.5 * np.pi - s[0]),
    (Outcome.SWING_OVERROTATION, lambda s: np.pi - s[1]),
    (Outcome.SWING_OVERROTATION, lambda s: np.pi + s[1]),
    (Outcome.SWING_OVERROTATION, lambda s: np.pi - s[2]),
    (Outcome.SWING_OVERROTATION, lambda s: np.pi + s[2]),
]
FREE_EVENTS = [(Outcome.KNEESTRIKE, lambda s: s[1] - s[2]), *BOUNDS]
LOCKED_EVENTS = [(Outcome.HEELSTRIKE, lambda s: s[0] + s[1]), *BOUNDS]


def follow(accelerations, state, start, longest, step, events) -> Phase:
    """Integrate a phase to the first of its events: functions that fall through zero.

    A heelstrike counts only in front of the hip.
    """

    def derivative(_time, state):
        return np.concatenate([state[3:], accelerations(state)])

    solver = DOP853(
        derivative, start, np.asarray(state, dtype=float), start + longest,
        rtol=1e-13, atol=1e-14, max_step=step, first_step=1e-4 * step,
    )  # fmt: skip
    times, pieces = [start], []
    while solver.status == "running":
        before = solver.y.copy()
        solver.step()
        piece = solver.dense_output()
        times.append(solver.t)
        pieces.append(piece)
        found = []
        instants = np.linspace(*times[-2:], 17)  # a foot may rise from the ground and strike within
        states = [before, *piece(instants[1:-1]).T, solver.y]
        for outcome, event in events:
            values = [event(state) for state in states]
            for i in range(16):
                if values[i] > 0.0 >= values[i + 1]:
                    at = brentq(
                        lambda t, e=event: e(piece(t)),  # noqa: B023
                        *instants[i : i + 2], xtol=1e-15,
                    )  # fmt: skip
                    if outcome != Outcome.HEELSTRIKE or piece(at)[0] < 0.0:
                        found.append((at, outcome))
        if found:
            times[-1], outcome = min(found)
            return Phase(np.array(times), OdeSolution(times, pieces), outcome)
    return Phase(np.array(times), OdeSolution(times, pieces), Outcome.RUNNING)


def walk(
    walker: Walker,
    slope: float,
    state,
    *,
    torque: float = 0.0,
    longest: float = 10.0,
    step: float = 0.1,
) -> Walk:
    """One stride, from just after heelstrike to just after the next, or however it ends.

    Args:
        walker: The walker.
        slope: Slope in rad.
        state: Angles and rates just after heelstrike.
        torque: Hip torque, per unit of foot mass for the simplest walker.
        longest: Time in units of sqrt(l/g) that each phase may take.
        step: Longest integration step in units of sqrt(l/g).
    """
    state = np.array(state, dtype=float)
    longest, step = longest * walker.time_unit, step * walker.time_unit
    phases, time, knee_time, knee_loss = [], 0.0, np.nan, 0.0
    if walker.knees:
        free = motion(walker, slope, torque, locked=False)
        phases.append(follow(free, state, 0.0, longest, step, FREE_EVENTS))
        time = phases[-1].times[-1]
        state = phases[-1].state(time)
        if phases[-1].event != Outcome.KNEESTRIKE:
            return Walk(phases[-1].event, state, time, knee_time, knee_loss, 0.0, phases)
        knee_time = time
        struck = bodies.kneestrike(walker, state[0], state[1], state[3:])
        state = np.array([state[0], state[1], state[1], *struck.rates])
        knee_loss = struck.loss
        if state[0] < 0.0 and state[0] + state[1] <= 0.0 < opening(state):
            if state[3] + state[4] <= 0.0:  # below the ground in front, and sinking
                return Walk(Outcome.KNEE_NOT_LOCKED, state, time, knee_time, knee_loss, 0.0, phases)
    straight = motion(walker, slope, torque, locked=True)
    phases.append(follow(straight, state, time, longest, step, LOCKED_EVENTS))
    time = phases[-1].times[-1]
    state = phases[-1].state(time)
    if phases[-1].event != Outcome.HEELSTRIKE:
        return Walk(phases[-1].event, state, time, knee_time, knee_loss, 0.0, phases)
    angle = 0.5 * (state[1] - state[0])
    if walker.massless_legs:
        rates, heel_loss = simplest_heelstrike(walker, -angle, state[3])
        rates = np.append(rates, rates[1])
    else:
        struck = bodies.heelstrike(walker, -angle, state[3:])
        rates, heel_loss = struck.rates, struck.loss
    after = np.array([angle, -angle, -angle, *rates])
    return Walk(Outcome.HEELSTRIKE, after, time, knee_time, knee_loss, heel_loss, phases)


def opening(state) -> float:
    """The angle between the legs."""
    return state[1] - state[0]


def absolute_hip_travel(walk: Walk) -> float:
    """Sum of the absolute changes of the angle between the legs."""
    total = 0.0
    for phase in walk.phases:

        def rate(t, phase=phase):
            state = phase.state(t)
            return state[4] - state[3]

        marks = []
        for a, b in pairwise(phase.times):
            marks.append(a)
            if rate(a) * rate(b) < 0.0:
                marks.append(brentq(rate, a, b, xtol=1e-15))
        marks.append(phase.times[-1])
        angles = [opening(phase.state(t)) for t in marks]
        total += sum(abs(b - a) for a, b in pairwise(angles))
    return total


def kinetic_energy(walker: Walker, state) -> float:
    """Kinetic energy of a state: of its bodies, or of the hip where legs have no mass."""
    if walker.massless_legs:
        return 0.5 * walker.hip_mass * (walker.leg_length * state[3]) ** 2
    return bodies.kinetic_energy(walker, state)
