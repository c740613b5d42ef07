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


@pytest.fixture
def assert_same() -> Callable[[Any, Any], None]:
    """Asserts that results, infos or states are alike to the last bit."""

    def same(a: Any, b: Any, where: str = "") -> None:
        if isinstance(a, dict):
            assert set(a) == set(b), (where, set(a) ^ set(b))
            for key in a:
                same(a[key], b[key], f"{where}/{key}")
        elif isinstance(a, (list, tuple)):
            assert len(a) == len(b), where
            for i, (x, y) in enumerate(zip(a, b, strict=True)):
                same(x, y, f"{where}/{i}")
        elif isinstance(a, np.ndarray):
            assert isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape, where
            if a.dtype == object:
                same(list(a), list(b), where)
            else:
                assert np.array_equal(a, b), (where, a, b)
        else:
            assert type(a) is type(b) and a == b, (where, a, b)

    return same
