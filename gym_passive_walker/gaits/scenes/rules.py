"""Rules of the task: limits of actions, observation, reward and termination.

Each rule is one plain function. Kernels on CPU and GPU call it with numbers, `torch.rollout` with
tensors and `Batch` with arrays. All quantities are dimensionless (see `equations.hybrid`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.math import minimum, where

ENERGIES = ("absolute", "positive", "net")
"""Kinds of work that the energy term counts."""

CHANNELS = ("hip", "ankle", "push_off")
"""Channels of an action: controls that are held during a step, and the impulse before
heelstrike."""

SIZE = 8
"""Numbers in the default observation; scenes may add some."""

KNEE_LOCK = "knee lock observed"
"""The feature of models that are observed with the lock of a knee, by SIZE bounded numbers."""

RATE_BOUND = 10.0
"""Bound of observed angular velocities, in sqrt(g/l); those of walkers stay well below."""

BOUNDS = np.array([0.5 * math.pi, math.pi, math.pi, *[RATE_BOUND] * 3, 1.0, 0.5 * math.pi])
"""Largest value of each number of the default observation, (SIZE,)."""

LOWEST = -BOUNDS
"""Smallest value of each number of the default observation, (SIZE,)."""
LOWEST[6] = 0.0


def bounds_of(walker: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the smallest and the largest value of each number of a default observation."""
    if KNEE_LOCK in walker.supports:
        return LOWEST, BOUNDS
    unbounded = np.full(len(walker.observed), np.inf)
    return -unbounded, unbounded


LARGEST_PROPORTION = 100.0
"""Bound of observed proportions of a body; those of walkers that walk are below 1."""

HIGHEST, STEEPEST = 1.0, 0.5 * math.pi
"""Bounds of the footholds ahead in observations: leg lengths, and rad."""

_RUNNING, _HEELSTRIKE, _STALLED = map(int, (Outcome.RUNNING, Outcome.HEELSTRIKE, Outcome.STALLED))
_ABSOLUTE, _POSITIVE = map(ENERGIES.index, ("absolute", "positive"))


def clip(value, low, high):
    """Return the value within bounds; `low` if it is not a number."""
    value = where(value >= low, value, low)
    return where(value <= high, value, high)


def step_end(time, tick, max_stride_time):
    """Return the time in a stride at which a control step that begins at `time` ends."""
    return minimum(time + tick, max_stride_time)


def outcome_of(outcome, time, max_stride_time):
    """Return the outcome of a control step that ends at `time`; STALLED for a too long stride."""
    return where((outcome == _RUNNING) & (time >= max_stride_time), _STALLED, outcome)


def ends_episode(outcome):
    """Return whether an outcome terminates the episode."""
    return outcome > _HEELSTRIKE


def observation(state, knee_locked, slope):
    """Return the default observation, SIZE numbers.

    Args:
        state: Angles of stance leg, thigh and shank in rad, then their angular velocities.
        knee_locked: 1 if the swing leg is straight, else 0.
        slope: Slope of the ground in rad.
    """
    return (
        clip(state[0], LOWEST[0], BOUNDS[0]),
        clip(state[1], LOWEST[1], BOUNDS[1]),
        clip(state[2], LOWEST[2], BOUNDS[2]),
        clip(state[3], LOWEST[3], BOUNDS[3]),
        clip(state[4], LOWEST[4], BOUNDS[4]),
        clip(state[5], LOWEST[5], BOUNDS[5]),
        knee_locked,
        clip(slope, LOWEST[7], BOUNDS[7]),
    )


def foothold(height_change, slope_change):
    """Return the observation of a foothold ahead: changes of height and slope."""
    return clip(height_change, -HIGHEST, HIGHEST), clip(slope_change, -STEEPEST, STEEPEST)


def proportion(value):
    """Return the observation of a proportion of the body."""
    return clip(value, -LARGEST_PROPORTION, LARGEST_PROPORTION)


def observed(
    scene: Any, state: Any, knee_locked: Any, slope: Any, command: Any, ahead: Any, body: Any
) -> list[Any]:
    """Return the numbers in the observation of a scene's agent, each of n walkers.

    Kernels write them piece by piece, as they know no scene.

    Args:
        scene: The scene.
        state: Angles or coordinates of the walkers, then their velocities.
        knee_locked: As for `observation`; ignored of a `System`.
        slope: Slope of the ground in rad.
        command: Commanded speed over sqrt(g l); ignored without a command.
        ahead: Height and slope changes of each foothold ahead that is observed.
        body: Observed proportions of the body.
    """
    locks = KNEE_LOCK in scene.walker.supports
    seen = [*observation(state, knee_locked, slope)] if locks else [*state, slope]
    seen += [command] * (scene.command is not None)
    for changes in ahead:
        seen += foothold(*changes)
    return [*seen, *map(proportion, body)]


def distance_of(ends, moved, progress):
    """Return the distance term of the reward of a step.

    A stride without heelstrike does not count: its distance is taken back. Otherwise agents learn
    to dive, which moves the hip by a leg length at once.

    Args:
        ends: Whether the step ends the episode.
        moved: Distance of the hip in the step.
        progress: Distance that was paid in this stride before the step.
    """
    return where(ends, 0.0 - progress, moved)


def work_of(torque, moved, turned):
    """Return the net work of a constant torque, and the integral of its absolute power.

    Args:
        torque: Torque.
        moved: Change of the angle on which it acts.
        turned: Length of the way of that angle, in both directions.
    """
    return torque * moved, abs(torque) * turned


def motor_charge(charged, torque, moved, turned):
    """Return the energy that an actuator is charged for by a kind of work, an index in ENERGIES.

    The other arguments are those of `work_of`.
    """
    net, absolute = work_of(torque, moved, turned)
    if charged == _ABSOLUTE:
        return absolute
    return 0.5 * (absolute + net) if charged == _POSITIVE else net


def reward(distance, energy, energy_weight):
    """Return the default reward of a step, in leg lengths, before `command_penalty`."""
    return distance - energy_weight * energy


def command_error(step_length, step_period, command):
    """Return the distance between a stride's length and the commanded one in its period."""
    return abs(step_length - command * step_period)


def command_penalty(step_length, step_period, command, weight):
    """Return the penalty of a stride for its `command_error`: at most its length."""
    return minimum(weight * command_error(step_length, step_period, command), step_length)
