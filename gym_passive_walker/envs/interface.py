"""What the outside sees of the task: spaces, and the names of what stands in `info`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from gym_passive_walker.envs import task
from gym_passive_walker.physics.hybrid import Outcome

OUTCOMES = (None, *(outcome.name.lower() for outcome in Outcome if outcome))
"""Names of outcomes, by their number."""


def observation_space() -> Any:
    """What an agent sees: the same for every walker and every scene."""
    low = -task.BOUNDS
    low[6] = 0.0
    return spaces.Box(low.astype(np.float32), task.BOUNDS.astype(np.float32), dtype=np.float32)


def action_space() -> Any:
    """What an agent does: the hip torque, as a share of the largest."""
    return spaces.Box(-1.0, 1.0, (1,), np.float32)


def step_limit(max_episode_steps: int | None) -> float:
    """Steps of an episode, where -1 and None mean without limit."""
    if max_episode_steps in (None, -1):
        return math.inf
    if max_episode_steps < 1:
        raise ValueError(f"max_episode_steps must be positive, -1 or None: {max_episode_steps!r}")
    return float(max_episode_steps)


def refuse(action: object, lane: int | None = None) -> None:
    """Say what is wrong with an action.

    Raises:
        ValueError: always.
    """
    where = "" if lane is None else f" of environment {lane}"
    raise ValueError(f"the action{where} must be one finite number from -1 to 1, not {action!r}")
