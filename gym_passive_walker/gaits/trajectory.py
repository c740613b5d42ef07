"""A walk as states at many instants, for pictures and for whoever looks inside a stride.

Every sample is integrated from the start of its stride to its own end time, all of them side by
side in one batch: a sample is as exact as the stride map itself, and nothing is interpolated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.arguments import check_state, check_tolerance
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.gaits.forces import forces
from gym_passive_walker.gaits.stride import stride
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.physics.systems import bodies, system_of
from gym_passive_walker.units import units_of
from gym_passive_walker.walkers import Walker, as_walker

COARSEST_SAMPLES = 1e-4
"""Largest tolerance at which the instant before a strike can still be told from the strike."""

_VERGE = 1e-8  # of the time until a strike: its square is nothing


class Trajectory(NamedTuple):
    """A walk at n instants, in the walker's own units.

    A heelstrike appears twice, at nearly the same time: as the last sample of one stride, before
    the collision, and as the first of the next, where the legs have changed roles.

    Attributes:
        times: Time since the start, shape (n,).
        states: [stance, thigh, shank] angles in rad, then their rates, shape (n, 6).
        contact_x: Contact point along the slope, positive downhill, shape (n,).
        strides: Which stride a sample belongs to, from 0, shape (n,).
        phases: `Stage` of the swing leg, shape (n,).
        outcomes: How each stride ended, shape (strides made,); all but the last are HEELSTRIKE.
    """

    times: NDArray[np.float64]
    states: NDArray[np.float64]
    contact_x: NDArray[np.float64]
    strides: NDArray[np.int64]
    phases: NDArray[np.int64]
    outcomes: NDArray[np.int64]


def trajectory(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    *,
    strides: int = 1,
    samples: int = 100,
    hip_torque: ArrayLike = 0.0,
    tolerance: float = 1e-10,
) -> Trajectory:
    """Follow one walker for some strides, and keep what it passes through.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad, positive downhill.
        state: Where it starts, just after heelstrike, shape (6,).
        strides: How many strides to follow; fewer are made if the walker falls.
        samples: Instants of each stride, evenly spaced: the first just after heelstrike, the last
            just before what ends the stride. At least 2.
        hip_torque: Torque, as for `stride`: a number, or one for each stride.
        tolerance: Error relative to the largest angle or rate, as for `stride`; at most 1e-4.

    Returns:
        The `Trajectory`, with `samples` instants for each stride made.

    Raises:
        ValueError: if a number is not finite or out of its range, or a shape does not fit.
    """
    walker = as_walker(walker)
    state = check_state(state)
    if state.shape != (6,):
        raise ValueError(f"trajectory follows one walker: state must be (6,), not {state.shape}")
    if strides < 1 or samples < 2:
        raise ValueError(
            f"strides must be at least 1 and samples at least 2, not {strides} and {samples}"
        )
    if check_tolerance(tolerance) > COARSEST_SAMPLES:
        raise ValueError(f"tolerance must be at most {COARSEST_SAMPLES}, not {tolerance}")
    torques = np.broadcast_to(np.asarray(hip_torque, dtype=float), (strides,))
    # Strikes seen from sample to sample differ by the tolerance: stop short of them by more.
    instants = np.linspace(0.0, 1.0 - 10.0 * tolerance - 1e-12, samples)

    times, states, contacts, phases, outcomes = [], [], [], [], []
    time = contact = 0.0
    for torque in torques:
        end = stride(walker, slope, state, hip_torque=torque, tolerance=tolerance)
        passed, phase = _sampled(walker, slope, state, torque, instants * end.duration, tolerance)
        times.append(time + instants * end.duration)
        states.append(passed)
        contacts.append(contact + walker.foot_radius * (state[0] - passed[:, 0]))
        phases.append(phase)
        outcomes.append(int(end.outcome))
        if end.outcome != Outcome.HEELSTRIKE:
            break
        time, contact, state = time + end.duration, contact + end.step_length, end.state
    return Trajectory(
        times=np.concatenate(times),
        states=np.concatenate(states),
        contact_x=np.concatenate(contacts),
        strides=np.repeat(np.arange(len(outcomes)), samples),
        phases=np.concatenate(phases),
        outcomes=np.array(outcomes),
    )


def _sampled(
    walker: Walker, slope: float, start: NDArray, torque: float, times: NDArray, tolerance: float
) -> tuple[NDArray, NDArray]:
    """States (n, 6) and phases (n,) at times since the start of a stride."""
    system, units = system_of(walker), units_of(walker)
    first = units.to_dimensionless(start)
    if not walker.knees:
        first[2], first[5] = first[1], first[4]
    records = new_records(
        np.broadcast_to(first, (len(times), 6)), slope, torque / units.torque,
        end=times / units.time,
    )  # fmt: skip
    record = advance(system, bodies(walker), records, tolerance=tolerance)[:, 0]
    stages = np.array([phase.stage for phase in system.phases])
    return units.to_own(record["state"]), stages[record["phase"]]


def states_at(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    times: ArrayLike,
    *,
    hip_torque: float = 0.0,
    tolerance: float = 1e-10,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """States inside one stride at any instants.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad.
        state: Where the stride starts, shape (6,).
        times: Since the start, shape (n,), in any order; later ones than the stride's end give
            the state that the stride ends with.
        hip_torque: Torque, as for `stride`.
        tolerance: As for `stride`.

    Returns:
        States (n, 6) and phases (n,).
    """
    start, instants = np.array(state, dtype=float), np.asarray(times, dtype=float)
    return _sampled(as_walker(walker), slope, start, hip_torque, instants, tolerance)


def just_before(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    strike: float,
    *,
    hip_torque: float = 0.0,
    tolerance: float = 1e-13,
) -> NDArray[np.float64]:
    """The state on the verge of a strike, before the collision, exact to rounding.

    A state is taken so short before the strike that its accelerations lead there.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad.
        state: Where the stride starts, shape (6,).
        strike: Time of the kneestrike or the heelstrike since the start.
        hip_torque: Torque, as for `stride`.
        tolerance: As for `stride`.

    Returns:
        State (6,).
    """
    walker = as_walker(walker)
    time = np.array([strike * (1.0 - _VERGE)])
    states, phases = states_at(
        walker, slope, state, time, hip_torque=hip_torque, tolerance=tolerance
    )
    left = strike - time[0]
    change = forces(walker, slope, states, phases, hip_torque=hip_torque).accelerations[0] * left
    angles, rates = states[0, :3], states[0, 3:]
    return np.concatenate([angles + (rates + 0.5 * change) * left, rates + change])
