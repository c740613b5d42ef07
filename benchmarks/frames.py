"""Frames per second of PPO: with this environment, with an empty one, and on tensors."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnv

from agents.config import configure
from agents.envs import training_envs
from agents.learner import build
from benchmarks.report import machine, seconds, table

WARMING = 40
"""Updates before the measurement, after which walkers seldom fall, as in most of a training."""

MEASURED = 24
"""Number of measured updates; the median is reported."""


class _Free(VecEnv):
    """Environments with given spaces that return zeros, without simulation."""

    def __init__(self, envs: VecEnv) -> None:
        super().__init__(envs.num_envs, envs.observation_space, envs.action_space)
        self._zeros = np.zeros((envs.num_envs, *envs.observation_space.shape), np.float32)
        self._answer = np.zeros(envs.num_envs), np.zeros(envs.num_envs, bool)
        self._infos: list[dict] = [{} for _ in range(envs.num_envs)]

    def seed(self, seed: Any = None) -> list[None]:
        return [None] * self.num_envs

    def reset(self) -> Any:
        return self._zeros

    def step_async(self, actions: Any) -> None:
        pass

    def step_wait(self) -> Any:
        return self._zeros, *self._answer, self._infos

    def close(self) -> None:
        pass

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [None] * self.num_envs

    def set_attr(self, *_: Any, **__: Any) -> None:
        pass

    def env_method(self, *_: Any, **__: Any) -> list[Any]:
        return []

    def env_is_wrapped(self, *_: Any, **__: Any) -> list[bool]:
        return [False] * self.num_envs


def _timed(job: Callable[..., Any], taken: list[float]) -> Callable[..., Any]:
    """Wrap a function so that each call appends its seconds to `taken`."""

    def timed(*arguments: Any, **named: Any) -> Any:
        began = time.perf_counter()
        result = job(*arguments, **named)
        taken.append(time.perf_counter() - began)
        return result

    return timed


def _trained(learners: list[BaseAlgorithm], frames: int) -> list[float]:
    """Frames per second of each learner."""
    collecting: list[list[float]] = [[] for _ in learners]
    training: list[float] = []  # shared: training costs the same for all learners
    for model, collected in zip(learners, collecting, strict=True):
        model.set_logger(Logger(None, []))
        model.learn(WARMING * frames)
        model.collect_rollouts = _timed(model.collect_rollouts, collected)  # type: ignore
        model.train = _timed(model.train, training)  # type: ignore
    for _ in range(MEASURED):  # alternate, so that the machine's load affects all equally
        for model in learners:
            model.learn(frames, reset_num_timesteps=False)
    return [frames / float(np.median(each) + np.median(training)) for each in collecting]


def report() -> str:
    """The table and its explanation."""
    torch.set_num_threads(1)
    config = configure("ppo", "level")
    envs = training_envs(config)
    frames = config.hyperparams["n_steps"] * envs.num_envs
    learners = [build(config, environment) for environment in (envs, _Free(envs))]
    own, floor = _trained(learners, frames)

    native = training_envs(config)
    native.reset()
    random = np.random.default_rng(0)
    actions = [random.uniform(-0.1, 0.1, (native.num_envs, 1)) for _ in range(64)]
    env_only = seconds(lambda: [native.step(action) for action in actions]) / 64 / native.num_envs

    model = learners[0]
    env = model.env
    assert env is not None
    env.reset()
    batch = np.repeat([env.observation_space.sample()], native.num_envs, axis=0)

    def acting() -> None:
        for _ in range(16):
            action, _ = model.predict(batch)
            env.step(action)

    env_policy = seconds(acting) / 16 / native.num_envs
    rows = [
        ("environment only", 1.0 / env_only),
        ("environment and policy", 1.0 / env_policy),
        ("environment, policy and training", own),
        ("the same with an environment that costs nothing", floor),
    ]
    text = table([f"PPO, preset level, {native.num_envs} environments", "frames/s"], rows)
    return (
        f"{text}\n\nAfter {WARMING * frames:,} frames, training reaches {100 * own / floor:.1f} % "
        "of the frames/s that an environment without run time allows. Times to collect frames "
        f"and to learn from them are medians of {MEASURED} updates, measured in turns. The "
        f"environment's own steps take {100 * env_only * own:.1f} % of the time of training. One "
        f"thread of torch. {machine('stable-baselines3', 'torch')}."
    )


def on_tensors() -> str:
    """PPO on tensors beside PPO of stable-baselines3, each with its preset."""
    torch.set_num_threads(1)
    learners, frames, names = [], [], []
    for algo in ("ppo", "ppo-fast"):
        config = configure(algo, "level")
        learners.append(build(config, training_envs(config)))
        frames.append(config.n_envs * config.hyperparams["n_steps"])
        names.append((f"`{algo}`", config.n_envs, config.hyperparams["n_epochs"]))
    for model in learners:
        model.set_logger(Logger(None, []))
        model.learn(WARMING * frames[0])
    taken = np.empty((MEASURED, 2))
    for turn in taken:  # alternate, so that the machine's load affects both equally
        for i, model in enumerate(learners):
            began = time.process_time()
            for _ in range(max(frames) // frames[i]):
                model.learn(frames[i], reset_num_timesteps=False)
            turn[i] = (time.process_time() - began) / max(frames)
    rates = 1.0 / np.median(taken, axis=0)
    rows = [(*name, rate) for name, rate in zip(names, rates, strict=True)]
    text = table(["PPO, preset level", "walkers", "passes", "frames/s"], rows)
    low, middle, high = np.percentile(taken[:, 0] / taken[:, 1], [25, 50, 75])
    return (
        f"{text}\n\nOn tensors {middle:.2f} times as many (quartiles {low:.2f} and {high:.2f} of "
        f"{MEASURED} turns of {max(frames):,} frames each, after {WARMING * frames[0]:,}), by the "
        "CPU time: other work of the machine slows both, and is not counted. One "
        f"thread of torch. {machine('stable-baselines3', 'torch')}."
    )
