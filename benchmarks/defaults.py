"""Walks of PPO and SAC of stable-baselines3 with default hyperparameters.

    python -m benchmarks.defaults --id PassiveWalkerEasy-v0 --algo ppo --seeds 0 1 2
    python -m benchmarks.defaults --algo sac --steps 20000 --marks 5000 10000
    python -m benchmarks.defaults --scene "{reset_noise_scale: 0.1, max_hip_torque: 0.1}"

PPO trains on 16 environments and SAC on one, unless `--envs` says otherwise. At each mark, and at
the end of `learn`, the policy acts without noise in 100 episodes with the seeds 1000 to 1099. It
prints the number of walks that reach the time limit of 4,000 steps, of the first 20 and of all 100,
and the mean return.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import yaml
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

import gym_passive_walker  # noqa: F401  (registers the environments)
from gym_passive_walker._tools import console
from gym_passive_walker.envs.evaluation.walks import simulate_episodes
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.seeds import training_seeds

ALGORITHMS: dict[str, tuple[type[BaseAlgorithm], int]] = {"ppo": (PPO, 16), "sac": (SAC, 1)}
"""Each algorithm with its number of environments."""

EPISODES, FIRST, SEED = 100, 20, 1000


class Shaped(VecEnvWrapper):
    """Environments with another scale of rewards or observations, or with a price of a fall."""

    def __init__(self, envs: VecEnv, reward: float, observation: float, fall: float) -> None:
        low, high = np.array([-np.inf, np.inf], np.float32)
        space = gym.spaces.Box(low, high, envs.observation_space.shape)
        super().__init__(envs, observation_space=space)
        self.reward, self.fall = reward, fall
        self.scale = np.array([observation] * 6 + [1.0] * 2, np.float32)

    def reset(self) -> Any:
        """First observations."""
        return self.scale * np.asarray(self.venv.reset())

    def step_wait(self) -> Any:
        """A step, its observations and rewards scaled."""
        seen, rewards, dones, infos = self.venv.step_wait()
        seen = self.scale * np.asarray(seen)
        for i in np.flatnonzero(dones):
            infos[i]["terminal_observation"] = self.scale * infos[i]["terminal_observation"]
            rewards[i] -= self.fall * (not infos[i]["TimeLimit.truncated"])
        return seen, self.reward * rewards, dones, infos


class Scaled:
    """A policy of scaled observations, for an environment of observations without scale."""

    def __init__(self, model: BaseAlgorithm, scale: np.ndarray) -> None:
        self.model, self.scale = model, scale

    def predict(self, observation: np.ndarray, *rest: Any, **named: Any) -> Any:
        """Actions, as stable-baselines3 returns them."""
        return self.model.predict(self.scale * observation, *rest, **named)


class Marks(BaseCallback):
    """Evaluates the policy as soon as the training has made certain numbers of steps."""

    def __init__(self, marks: list[int], row: Any) -> None:
        super().__init__()
        self.left, self.row = sorted(marks), row

    def _on_step(self) -> bool:
        while self.left and self.num_timesteps >= self.left[0]:
            self.row(self.left.pop(0))
        return True


def learn(args: argparse.Namespace, seed: int) -> None:
    """Train with one seed; print a row at each mark and at the end."""
    scene = {**(gym.spec(args.id).kwargs.get("scene") or {}), **yaml.safe_load(args.scene)}
    of, count = ALGORITHMS[args.algo]
    native = PassiveWalkerVecEnv(args.envs or count, scene, max_episode_steps=args.limit)
    envs = Shaped(native, args.reward_scale, args.observation_scale, args.fall_price)
    model = of("MlpPolicy", envs, seed=seed, device="cpu")  # type: ignore[call-arg]
    native.seed(training_seeds(seed, native.num_envs))
    arena = gym.make_vec(args.id, num_envs=EPISODES, scene=scene)
    policy: Any = Scaled(model, envs.scale)
    begun = time.perf_counter()

    def row(steps: int) -> None:
        walks = simulate_episodes(policy, arena, seed=SEED)
        lasting = walks.reached_limit
        print(
            f"| {args.algo} | {seed} | {steps:,} | {lasting[:FIRST].sum()} of {FIRST} | "
            f"{lasting.sum()} of {EPISODES} | {walks.reward.mean():.1f} | "
            f"{time.perf_counter() - begun:.0f} |",
            flush=True,
        )

    model.learn(args.steps, Marks(args.marks, row))
    row(model.num_timesteps)


def main() -> int:
    """Read the arguments, and train with each seed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add("--id", default="PassiveWalkerEasy-v0", help="environment (%(default)s)")
    add("--algo", choices=tuple(ALGORITHMS), default="ppo", help="(%(default)s)")
    add("--seeds", type=int, nargs="+", default=[0, 1, 2], help="(0 1 2)")
    add("--envs", type=int, help="(16 with ppo, 1 with sac)")
    add("--steps", type=int, default=150_000, help="(%(default)s)")
    add("--marks", type=int, nargs="*", default=[50_000, 100_000, 150_000], help="of steps")
    add("--scene", default="{}", metavar="YAML", help="arguments of the scene that differ")
    add("--limit", type=int, default=4000, help="of steps in a training episode (%(default)s)")
    add("--reward-scale", type=float, default=1.0, help="in training (%(default)s)")
    add("--observation-scale", type=float, default=1.0, help="of the state (%(default)s)")
    add("--fall-price", type=float, default=0.0, help="subtracted at a fall (%(default)s)")
    args = parser.parse_args()
    torch.set_num_threads(1)
    print("| algorithm | seed | steps | to the limit | to the limit | return | seconds |")
    print("|---|---|---|---|---|---|---|")
    for seed in args.seeds:
        learn(args, seed)
    return 0


if __name__ == "__main__":
    raise SystemExit(console.run(main))
