"""Off-policy learners of SBX (Stable-Baselines in JAX), and XQC, with the preset of `sac`.

    pip install -e '.[off-policy]'
    python -m benchmarks.off_policy --learners tqc crossq --seeds 0 1 2

Networks, noise, discount, rewards and numbers of updates are those of `python train.py --algo sac`,
and CrossQ's learning rate is constant, as SBX has no schedule for it. XQC is `benchmarks.xqc`. The
last policy walks in the episodes of the benchmark of agents. Results are kept in `--out`, a line of
JSON for each seed, and are not computed again. It prints a row for each learner.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from agents.benchmark import least_cost
from agents.config import configure
from agents.envs import arena, training_envs
from agents.exploration import explorers
from agents.learner import LearnedPolicy, schedule
from benchmarks.report import machine, spread, table
from gym_passive_walker._tools import console
from gym_passive_walker._tools.extras import extra
from gym_passive_walker.envs.evaluation.walks import simulate_episodes
from gym_passive_walker.envs.seeds import training_seeds

LEARNERS = {
    "sac": ("SAC", "MlpPolicy", {}),
    "sac-layer-norm": ("SAC", "MlpPolicy", {"layer_norm": True}),
    "tqc": ("TQC", "MlpPolicy", {}),
    "tqc-layer-norm": ("TQC", "MlpPolicy", {"layer_norm": True}),
    "crossq": ("CrossQ", "MlpPolicy", {}),
    "simba": ("SAC", "SimbaPolicy", {}),
    "xqc": ("XQC", "MlpPolicy", {}),
}
"""Classes (of SBX, or `benchmarks.xqc`) and policies, and arguments of the policies, by name."""

EPISODES, SEED = 100, 1000


def learn(learner: str, seed: int, steps: int | None) -> dict[str, Any]:
    """Train with one seed, and return the results of its last policy."""
    with extra("off-policy"):
        import sbx  # type: ignore[import-not-found]

        from benchmarks.xqc import XQC
    from stable_baselines3.common.utils import FloatSchedule
    from stable_baselines3.common.vec_env import VecNormalize

    of, policy, arguments = LEARNERS[learner]
    config = configure("sac", "level", seed=seed, steps=steps)
    named = dict(config.hyperparams)
    rate = FloatSchedule(schedule(named["learning_rate"]))
    sizes = named.pop("policy_kwargs")["net_arch"]
    named |= {"policy": policy, "policy_kwargs": {"net_arch": sizes, **arguments}}
    named["learning_rate"] = rate
    if of in ("CrossQ", "XQC"):  # without a schedule, and without target networks
        named["learning_rate"] = rate(1.0)
        named.pop("tau")
    if of == "XQC":
        updates = config.steps // config.n_envs * named["gradient_steps"]
        named["policy_kwargs"]["updates"] = updates
    envs = VecNormalize(training_envs(config), gamma=named["gamma"], **(config.normalize or {}))
    model = (XQC if of == "XQC" else getattr(sbx, of))(env=envs, seed=seed, **named)
    envs.seed(training_seeds(seed, envs.num_envs))  # type: ignore[arg-type]
    begun = time.process_time()
    model.learn(config.steps, callback=explorers("sac", config.exploration))
    took = time.process_time() - begun
    walks = simulate_episodes(LearnedPolicy(model, learner), arena(config, EPISODES), seed=SEED)
    lasting = walks.reached_limit
    speed, cost = (
        float(np.median(each[lasting])) if lasting.any() else np.nan
        for each in (walks.speed, walks.cost_of_transport)
    )
    return {
        "learner": learner, "seed": seed, "steps": config.steps, "walks": int(lasting.sum()),
        "return": float(walks.reward.mean()), "speed": speed,
        "gap": cost / least_cost("level", speed) - 1.0, "cpu": took,
    }  # fmt: skip


def main() -> None:
    """Train with all learners and seeds that have no result yet, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add("--learners", nargs="+", choices=tuple(LEARNERS), default=list(LEARNERS), help="(all)")
    add("--seeds", type=int, nargs="+", default=[0, 1, 2], help="(0 1 2)")
    add("--steps", type=int, help="of each training (the preset's)")
    add("--out", type=Path, default=Path("runs/off-policy.jsonl"), help="(%(default)s)")
    args = parser.parse_args()
    # Networks this small are fastest on one core.
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    lines = args.out.read_text(encoding="utf-8").splitlines() if args.out.is_file() else []
    found = [json.loads(line) for line in lines]
    done = {(row["learner"], row["seed"], row["steps"]) for row in found}
    steps = configure("sac", "level", steps=args.steps).steps
    for seed in args.seeds:
        for learner in args.learners:
            if (learner, seed, steps) not in done:
                found.append(learn(learner, seed, steps))
                print(found[-1], flush=True)
                with args.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(found[-1]) + "\n")
    rows = []
    for learner in args.learners:
        own = [row for row in found if (row["learner"], row["steps"]) == (learner, steps)]
        if own:
            rows.append((
                learner, len(own), spread([row["return"] for row in own], ".1f"),
                spread([100.0 * row["gap"] for row in own], ".0f"),
                sum(row["walks"] for row in own), f"{np.mean([row['cpu'] for row in own]):.0f} s",
            ))  # fmt: skip
    heads = ["learner", "seeds", "return", "cost above the optimum in %", "walks to the time limit",
             "CPU time"]  # fmt: skip
    print(f"\n{table(heads, rows)}\n\n{machine('sbx-rl', 'jax')}.")


if __name__ == "__main__":
    raise SystemExit(console.run(main))
