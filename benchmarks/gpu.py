"""Speed on a GPU: strides, control steps and learning per second, beside the CPU.

    python -m benchmarks.gpu               Run all parts.
    python -m benchmarks.gpu strides       Run one part: strides, ticks or learning.

Each part prints its table and writes the table to docs/gpu.md. It requires a CUDA GPU
and the extras "gpu" and, for `learning`, "train" and "rsl-rl". With NUMBA_ENABLE_CUDASIM=1 a few
walkers run on a simulated GPU, and no table is written.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import gym_passive_walker  # noqa: F401  (registers the environment)
from benchmarks import engine
from benchmarks.problem import error, problem
from benchmarks.report import command, machine, seconds, table
from benchmarks.tables import GPU, keep
from gym_passive_walker.devices.gpu import device
from gym_passive_walker.devices.gpu.batch import DeviceBatch
from gym_passive_walker.devices.gpu.device import SIMULATED, cuda
from gym_passive_walker.devices.gpu.strides import advance_there
from gym_passive_walker.models.equations.systems import SYSTEMS

SIZES = [4, 16] if SIMULATED else [10**k for k in range(3, 7)]
LARGEST_HERE = 10**5
"""Largest number of walkers on the CPU; a larger number is not faster per walker."""

CORES = os.cpu_count() or 1

_WALKS = ("kneed", 1e-4), ("kneed", 1e-6), ("straight", 1e-4), ("simplest", 1e-4)

_NETWORK = {
    "class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "relu",
    "obs_normalization": True,
}  # fmt: skip
_PPO = {
    "save_interval": 10**9,
    "logger": "tensorboard",
    "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
    "actor": {
        **_NETWORK,
        "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 0.37},
    },
    "critic": _NETWORK,
    "algorithm": {
        "class_name": "PPO", "gamma": 0.995, "lam": 0.98, "clip_param": 0.2,
        "learning_rate": 1e-3, "schedule": "fixed", "num_learning_epochs": 5,
        "num_mini_batches": 4, "entropy_coef": 0.0, "value_loss_coef": 0.5, "max_grad_norm": 0.5,
        "use_clipped_value_loss": False,
    },
}  # fmt: skip


class _Rows(list[tuple[object, ...]]):
    """Rows of a table; each is printed when it is measured."""

    def add(self, *row: object) -> None:
        """Append a row and print it."""
        print(*row, flush=True)
        self.append(row)


def _finished(job: Callable[[], object]) -> Callable[[], None]:
    """Wrap a function so that it returns after the GPU has finished."""

    def done() -> None:
        job()
        cuda.synchronize()

    return done


def _copied(there: Any, source: Any) -> None:
    """Copy an array into one on the GPU."""
    if SIMULATED:
        there[:] = source
    else:
        there.copy_to_device(source)


def _report(name: str, text: str) -> None:
    """Write a result to the page; on a simulated GPU, only print it."""
    if SIMULATED:
        print(f"\n{text}\n\nA rehearsal: nothing is kept.")
        return
    there = cuda.get_current_device().name
    there = there.decode() if isinstance(there, bytes) else there
    keep(name, f"{text}\n\n{there}; CPU: {machine('numba-cuda', 'torch')}.", GPU)


def carried() -> None:
    """Measure strides per second of each kind of walker."""
    device.need_device()
    text = []
    for name, tolerance in _WALKS:
        p, rows = problem(name), _Rows()
        exact = engine.strides(p, 1e-14)  # six digits finer than the requested tolerance
        for count in SIZES:
            rows.add("GPU", count, *_strides(p, tolerance, count, exact))
        for count in SIZES:
            if count <= LARGEST_HERE:
                one = engine.microseconds(p, count, tolerance, CORES)
                reached = error(engine.strides(p, tolerance), exact)
                rows.add(f"CPU, {CORES} cores", count, reached, 1e6 / one)
        heads = ["by", "walkers", "error reached", "strides/s"]
        text += [f"Walker {name}, tolerance {tolerance:.0e}", table(heads, rows)]
    _report("gpu strides", "\n\n".join(text))


def _strides(p: Any, tolerance: float, count: int, exact: Any) -> tuple[float, float]:
    """Error of the problem's strides on the GPU, and strides per second."""
    fresh = device.upload(engine.new_batch(p, count))
    body, records = (
        device.upload(np.array(p.body)[None, None]),
        device.upload(engine.new_batch(p, count)),
    )
    begin = _finished(lambda: _copied(records, fresh))

    def job() -> None:
        _copied(records, fresh)
        advance_there(SYSTEMS[p.system.name], body, records, tolerance=tolerance)

    alone, both = seconds(begin), seconds(_finished(job))
    states = device.to_host(records)["state"][: len(p.starts), 0]
    return error(states, exact[: len(states)]), count / (both - alone)


def ticks() -> None:
    """Measure control steps per second with random actions; episodes reset on the GPU."""
    rows = _Rows()
    for count in SIZES:
        rows.add("GPU", count, count / _tick(DeviceBatch(count)))
        if count <= LARGEST_HERE:
            rows.add(f"CPU, {CORES} cores", count, count / _tick_here(count))
    _report("gpu ticks", table(["by", "walkers", "control steps/s"], rows))


def _tick(there: DeviceBatch) -> float:
    """Seconds for a control step of a batch on the GPU."""
    random = np.random.default_rng(0)
    shape = there.arrays.actions.shape
    few = [device.upload(random.uniform(-1.0, 1.0, shape)) for _ in range(4)]
    there.reset()

    def job() -> None:
        for actions in few:
            _copied(there.arrays.actions, actions)
            there.step()

    for _ in range(2 if SIMULATED else 100):  # until walkers are spread over all phases
        job()
    return seconds(_finished(job)) / len(few)


def _tick_here(count: int) -> float:
    """Seconds for a control step of `count` walkers on the CPU."""
    envs = gym.make_vec("PassiveWalker-v0", num_envs=count, threads=CORES)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    few = [envs.action_space.sample() for _ in range(4)]
    took = seconds(lambda: [envs.step(actions) for actions in few]) / len(few)
    envs.close()
    return took


def learning() -> None:
    """Measure frames per second of PPO on the GPU, with walkers on the GPU and on the CPU."""
    import torch
    from rsl_rl.runners import OnPolicyRunner  # type: ignore[import-not-found]

    from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv
    from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv
    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    where, steps = "cpu" if SIMULATED else "cuda", 4 if SIMULATED else 24

    def here(count: int, **options: Any) -> Any:
        return PassiveWalkerTorchEnv(count, device=where, **options)

    rows = _Rows()
    for count in SIZES if SIMULATED else (4096, 65_536, 524_288):
        for label, envs in (("GPU", PassiveWalkerGpuEnv), ("CPU", here)):
            if label == "CPU" and count > LARGEST_HERE:
                continue
            options = {**_PPO, "num_steps_per_env": steps}
            runner = OnPolicyRunner(RslRlWalkers(count, envs=envs), options, device=where)

            def job(runner: Any = runner) -> None:
                runner.learn(2)
                torch.cuda.synchronize() if not SIMULATED else None

            frames = 2 * steps * count
            rows.add(f"rsl_rl, walkers on the {label}", count, frames / seconds(job, repeats=2))
        update = _finished(_ppo_fast(count, steps))
        rows.add("ppo-fast, both on the GPU", count, frames / seconds(update, repeats=2))
    _report("gpu learning", table(["PPO", "walkers", "frames/s"], rows))


def _ppo_fast(count: int, steps: int) -> Callable[[], object]:
    """Two updates by this repository's PPO, with as many epochs and batches as rsl_rl's."""
    from stable_baselines3.common.logger import Logger

    from agents.config import configure
    from agents.envs import training_envs
    from agents.learner import build

    config, size = configure("ppo-fast", "level"), steps * count // 4
    model = build(config, training_envs(config, count), n_steps=steps, batch_size=size, n_epochs=5)
    model.set_logger(Logger(None, []))
    return lambda: model.learn(2 * steps * count)


PARTS = {"strides": carried, "ticks": ticks, "learning": learning}


if __name__ == "__main__":
    try:
        command(__doc__, PARTS)
    except device.NoDevice as error_:
        sys.exit(str(error_))
