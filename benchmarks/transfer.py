"""What it costs to train in MuJoCo and to walk by exact dynamics, and the other way.

    python -m benchmarks.transfer [--seeds N] [--steps N]

`PPO("MlpPolicy", env)` of stable-baselines3 trains 16 walkers of `PassiveWalkerEasy-v0` in each
simulator, with its default hyperparameters. Each policy acts without noise in each simulator.
Policies and walks are kept in runs/transfer: what is there is not made again. The table goes to
docs/simulators.md.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import gym_passive_walker  # noqa: F401  (registers the environments)
from benchmarks.report import machine, spread, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console

FOLDER = Path("runs/transfer")
SCENE: dict[str, Any] = gym.spec("PassiveWalkerEasy-v0").kwargs
ENVS, LIMIT, WALKS, FIRST = 16, 1000, 20, 1000
"""Walkers of a training; control steps of a walk; walks of an evaluation, and their first seed."""

SIMULATORS: dict[str, Callable[[], gym.Env]] = {
    "exact": lambda: gym.make("PassiveWalkerEasy-v0"),
    "MuJoCo": lambda: gym.make("PassiveWalkerMujoco-v0", timestep=2e-3, **SCENE),
    "MuJoCo, its own contacts": lambda: gym.make(
        "PassiveWalkerMujoco-v0", timestep=2e-3, softness=None, **SCENE
    ),
}


def trained(name: str, seed: int, steps: int) -> tuple[PPO, float]:
    """Return a policy that was trained in a simulator, and the seconds of the CPU that it took."""
    place = FOLDER / f"{name}-{seed}-{steps}.zip"
    took = place.with_suffix(".json")
    if not took.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        began = time.process_time()
        model = PPO("MlpPolicy", make_vec_env(SIMULATORS[name], ENVS, seed), seed=seed)
        model.learn(steps)
        model.save(place)
        took.write_text(json.dumps(time.process_time() - began), "utf-8")
    return PPO.load(place), json.loads(took.read_text("utf-8"))


def walk(policy: PPO, env: gym.Env, seed: int) -> dict[str, float]:
    """Walk once; returns the sum of rewards, and measures of strides if the walk does not fall."""
    observation, _ = env.reset(seed=seed)
    paid, length, period, spent = 0.0, 0.0, 0.0, 0.0
    for _ in range(LIMIT):
        action, _ = policy.predict(observation, deterministic=True)
        observation, reward, fell, _, info = env.step(action)
        paid += float(reward)
        if fell:
            return {"return": paid}
        if info["step_period"] > 0.0:
            length, period = length + info["step_length"], period + info["step_period"]
            spent += info["hip_cost"] * info["step_length"]
    return {"return": paid, "speed": length / period, "cost": spent / length}


def walks(name: str, seed: int, steps: int, where: str) -> list[dict[str, float]]:
    """Walks of a policy in a simulator."""
    place = FOLDER / f"{name}-{seed}-{steps} in {where}.json"
    if not place.exists():
        policy, env = trained(name, seed, steps)[0], SIMULATORS[where]()
        found = [walk(policy, env, FIRST + i) for i in range(WALKS)]
        place.write_text(json.dumps(found), "utf-8")
        print(name, seed, "in", where, "done", flush=True)
    return json.loads(place.read_text("utf-8"))


def main() -> int:
    """Train, walk, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="(%(default)s)")
    parser.add_argument("--steps", type=int, default=163_840, metavar="N", help="(%(default)s)")
    args = parser.parse_args()
    torch.set_num_threads(1)
    found: dict[tuple[str, str], list[list[dict[str, float]]]] = {}
    for seed in range(args.seeds):
        for name in SIMULATORS:
            for where in SIMULATORS:
                found.setdefault((name, where), []).append(walks(name, seed, args.steps, where))
    rows: list[tuple[Any, ...]] = []
    for (name, where), of_seeds in found.items():
        means = [
            {key: sum(one.get(key, math.nan) for one in each) / len(each)
             for key in ("return", "speed", "cost")}
            for each in ([one for one in walked if "speed" in one] for walked in of_seeds)
            if each
        ]  # fmt: skip
        lasting = sum("speed" in one for walked in of_seeds for one in walked)
        returns = [sum(one["return"] for one in walked) / WALKS for walked in of_seeds]
        at_home = [sum(one["return"] for one in walked) / WALKS for walked in found[name, name]]
        gap = [there / here - 1.0 for there, here in zip(returns, at_home, strict=True)]
        rows.append((
            name, where, f"{lasting} of {WALKS * args.seeds}", spread(returns, ".1f"),
            "" if where == name else spread(gap, "+.1%"),
            *(spread([each[key] for each in means], form) if means else ""
              for key, form in (("speed", ".4f"), ("cost", ".5f"))),
        ))  # fmt: skip
    took = [
        f"{name} {median(trained(name, seed, args.steps)[1] for seed in range(args.seeds)):.0f}"
        for name in SIMULATORS
    ]
    heads = ("trained in", "walks in", "to the limit", "return", "gap", "speed", "hip cost")
    text = (
        f"Seconds of the CPU for a training, median: {', '.join(took)}. "
        f"{machine('mujoco', 'stable-baselines3', 'torch')}."
    )
    keep("transfer", f"{table(heads, rows)}\n\n{text}", DOCS / "simulators.md")
    return 0


if __name__ == "__main__":
    raise SystemExit(console.run(main))
