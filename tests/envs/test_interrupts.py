"""Errors and interrupts in the midst of steps and resets leave walkers that walk on, or are reset.

A profiler raises at each call of a Python function, and at each return from compiled code, in turn:
these are the places where Ctrl-C and errors of a user's function arise.
"""

import itertools
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from gym_passive_walker.engine import run
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

COUNT, STEPS, LIMIT = 5, 8, 4  # two episodes
TO_FALL = {"max_stride_time": 0.25, "max_episode_steps": LIMIT}  # some fall, some are truncated

SCENES: dict[str, dict[str, Any]] = {
    "compiled": {"scene": "rolling"},
    "own reward": {"reward": lambda step: float(step.distance), "slope": 0.02},
    "own observation": {"observation": lambda step: [float(step.time), float(step.slope)]},
    "own end": {"terminated": lambda step: bool(step.time > 0.15), "slope": 0.02},
    "disturbed": {"pushes": {"rate": 3.0, "impulse": 0.01}, "command": (0.1, 0.2)},
    "other bodies": {"domain_randomization": {"thigh_mass": 0.1}, "reward_terms": True},
}
KINDS = ("single", "NextStep", "SameStep", "Disabled", "stable-baselines3", "tensors")

pytestmark = [
    pytest.mark.filterwarnings("ignore:.* cannot be compiled"),
    # Python reports, and ignores, an interrupt of a generator that it throws away.
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


class Walk:
    """An environment of any class, with one reset and one step for all of them."""

    def __init__(self, kind: str, scene: dict[str, Any]) -> None:
        self.kind = kind
        if kind == "single":
            own = {k: v for k, v in (scene | TO_FALL).items() if k != "max_episode_steps"}
            self.env = gymnasium.make(ID, **own).unwrapped
            self.count = 1
            return
        self.count = COUNT
        if kind == "stable-baselines3":
            pytest.importorskip("stable_baselines3")
            from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

            self.env = PassiveWalkerVecEnv(COUNT, **scene | TO_FALL)
        elif kind == "tensors":
            pytest.importorskip("torch")
            from gym_passive_walker.torch import PassiveWalkerTorchEnv

            self.env = PassiveWalkerTorchEnv(COUNT, **scene | TO_FALL)
        else:
            self.env = PassiveWalkerVectorEnv(COUNT, autoreset_mode=kind, **scene | TO_FALL)

    def reset(self, seed: int) -> Any:
        """Begin; returns the observations."""
        if self.kind == "stable-baselines3":
            self.env.seed(seed)
            return self.env.reset()
        return np.asarray(self.env.reset(seed=seed)[0])

    def step(self, k: int) -> list[Any]:
        """Take the k-th step; returns what it shows."""
        act = np.random.default_rng(k).uniform(-1.0, 1.0, (self.count, 1)).astype(np.float32)
        if self.kind == "tensors":
            import torch

            results = self.env.step(torch.from_numpy(act))
        else:
            results = self.env.step(act[0] if self.kind == "single" else act)
        shown = [np.asarray(part) for part in results[:-1]]
        infos = results[-1]
        if isinstance(infos, list):
            shown += [np.array([info["distance"] for info in infos])]
        else:
            shown += [np.asarray(infos[name]) for name in ("distance", "strides", "step_period")]
        return shown

    def again(self, results: list[Any]) -> list[Any]:
        """Reset what the last step has ended, where the environment does not do so itself."""
        ended = results[2] | results[3] if self.kind in ("single", "Disabled") else np.False_
        if not ended.any():
            return []
        options = {"reset_mask": ended} if self.kind == "Disabled" else None
        return [self.env.reset(options=options)[0]]

    def walk(self) -> list[Any]:
        """A walk of some steps from the beginning: the reset, then a step and a reset in turns."""
        shown = [[self.reset(3)]]
        for k in range(STEPS):
            shown.append(self.step(k))
            shown.append(self.again(shown[-1]))
        return shown


def interrupt(call: Callable[[], Any], place: int, error: type[BaseException]) -> bool:
    """Raise an error at a place of a call; returns whether the call came so far."""
    left = place

    def profile(frame: Any, event: str, _: Any) -> None:
        nonlocal left
        if event in ("call", "c_return"):
            left -= 1
            if left < 0:
                sys.setprofile(None)
                raise error

    sys.setprofile(profile)
    try:
        call()
    except error:
        return True
    finally:
        sys.setprofile(None)
    return False


def same(a: Any, b: Any) -> bool:
    """Whether two results are equal to the last bit."""
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def interrupted(kind: str, scene: str, before: int, stride: int, offset: int = 0) -> int:
    """Interrupt a step, and a reset, at every `stride`-th place; returns how many there were."""
    walk, twin = Walk(kind, SCENES[scene]), Walk(kind, SCENES[scene])
    reference, tried = walk.walk(), 0
    errors = itertools.cycle((KeyboardInterrupt, ArithmeticError))
    for call in ("step", "reset"):
        for place in itertools.count(offset, stride):
            walk.reset(3)
            for k in range(before):
                walk.again(walk.step(k))
            act = (lambda: walk.step(before)) if call == "step" else (lambda: walk.reset(3))
            if not interrupt(act, place, next(errors)):
                break
            tried += 1
            state = walk.env.get_state()
            for each in (walk, twin) if call == "step" else ():
                shown = []
                for k in (before, before + 1):
                    each.env.set_state(state)
                    with suppress(ResetNeeded):
                        shown.append(same(each.step(k), reference[1 + 2 * k]))
                # As if the interrupted step had not begun, or had been completed.
                assert any(shown) or not shown
            assert all(same(a, b) for a, b in zip(walk.walk(), reference, strict=True))
    return tried


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", ["own reward", "disturbed"])
def test_an_interrupted_step_is_undone_completed_or_needs_a_reset(kind, scene):
    assert interrupted(kind, scene, LIMIT - 1, 7) >= 5


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES)
def test_walkers_walk_on_after_an_interrupt_anywhere(kind, scene):
    assert sum(interrupted(kind, scene, before, 7, before) for before in (1, LIMIT - 1)) >= 14


@pytest.mark.parametrize("kind", KINDS)
def test_after_an_error_of_a_reward_a_step_asks_for_a_reset(kind):
    fails = []

    def reward(step):
        if fails:
            raise ZeroDivisionError("mine")
        return float(step.distance)

    walk = Walk(kind, {"reward": reward, "slope": 0.02})
    reference = walk.walk()
    walk.reset(3)
    fails.append(True)
    with pytest.raises(ZeroDivisionError, match="mine"):
        walk.step(0)
    fails.clear()
    for k in (0, 1):
        with pytest.raises(ResetNeeded, match="error interrupted"):
            walk.step(k)
    assert same(walk.walk()[:1], reference[:1])


def test_an_interrupt_among_threads_waits_for_all_of_them():
    done = []

    def job(first, last):
        if first == 0:
            raise KeyboardInterrupt
        done.append((first, last))

    with pytest.raises(KeyboardInterrupt):
        run.in_parts(job, 100_000, 2)
    here = len(done)
    assert sum(last - first for first, last in done) < 100_000
    run.in_parts(lambda first, last: done.append((first, last)), 100_000, 2)
    assert sum(last - first for first, last in done[here:]) == 100_000
