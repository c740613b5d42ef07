"""What the tests of the environments share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

import gym_passive_walker  # noqa: F401  (registers the environments)


@pytest.fixture
def make() -> Callable[..., Any]:
    """Makes a bare environment."""

    def bare(**arguments: Any) -> Any:
        return gymnasium.make("PassiveWalker-v0", **arguments).unwrapped

    return bare


@pytest.fixture
def play() -> Callable[..., list[Any]]:
    """Plays an episode: what each step returned."""

    def episode(env: Any, act: Any = 0.0, *, steps: int = 4000, **reset: Any) -> list[Any]:
        observation, _ = env.reset(**reset)
        walk = []
        for step in range(steps):
            action = act(step, observation) if callable(act) else act
            walk.append(env.step(np.array([action])))
            observation = walk[-1][0]
            if walk[-1][2] or walk[-1][3]:
                break
        return walk

    return episode
