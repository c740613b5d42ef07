"""Train PPO with RLlib; its env runners sample vectorized environments of the package.

    python -m agents.rllib                                Train on the recommended scene.
    python -m agents.rllib --scene lab --runners 2        Sample with two processes.
    python -m agents.rllib --steps 300000 --out runs/rllib

RLlib pins an older version of Gymnasium. Install it in a separate virtual environment, with
`pip install -e ".[rllib]" torch`.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray

from agents.config import DEFAULT_SCENE, Config, configure
from agents.envs import arena, scene_of
from gym_passive_walker._tools import console
from gym_passive_walker._tools.arguments import whole
from gym_passive_walker._tools.extras import extra
from gym_passive_walker.envs.evaluation.walks import Walks, score_table, simulate_episodes
from gym_passive_walker.envs.registration import MAX_EPISODE_STEPS
from gym_passive_walker.envs.seeds import training_seeds
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import SCENES

with extra("rllib"):
    import ray  # type: ignore[import-not-found]
    from ray.rllib.algorithms.ppo import PPO, PPOConfig  # type: ignore[import-not-found]
    from ray.rllib.connectors.env_to_module import (  # type: ignore[import-not-found]
        MeanStdFilter,
    )
    from ray.rllib.core.rl_module.default_model_config import (  # type: ignore[import-not-found]
        DefaultModelConfig,
    )
    from ray.rllib.utils.filter import RunningStat  # type: ignore[import-not-found]
    from ray.rllib.utils.numpy import SMALL_NUMBER  # type: ignore[import-not-found]

STEPS = 200_000
"""Default number of environment steps of a training: enough to walk, but not to walk well."""

EPISODES, SEED = 20, 1000
"""Number of evaluation episodes, and the seed of the first."""


class TrainingEnvs(PassiveWalkerVectorEnv):
    """Vector environments with seeds that are drawn as in other trainings.

    RLlib resets those of each process with the training's seed plus the number of the process.
    """

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin episodes; see `PassiveWalkerVectorEnv.reset`."""
        drawn = training_seeds(seed, self.num_envs) if isinstance(seed, int) else seed
        return super().reset(seed=drawn, options=options)


ENVS = "PassiveWalkerTraining-v0"
if ENVS not in gym.registry:
    gym.register(
        ENVS,
        vector_entry_point="agents.rllib:TrainingEnvs",
        max_episode_steps=MAX_EPISODE_STEPS,
    )


def rllib_config(config: Config, *, runners: int = 0) -> PPOConfig:
    """Convert a PPO configuration of this repository to RLlib's.

    The preset's schedule of exploration applies to stable-baselines3 only. Here the noise begins as
    large as the largest torque, and is then learned.

    Args:
        config: Configuration of the training.
        runners: Number of sampling processes, each with `config.n_envs` walkers; 0 samples in the
            current process.

    Raises:
        ValueError: if `runners` is not a whole number, or is negative.
    """
    runners, given = whole(runners, "runners", least=0), config.hyperparams
    network = given["policy_kwargs"]
    rate = float(str(given["learning_rate"]).removeprefix("lin_"))
    scene = {"scene": scene_of(config, **config.training)}
    return (
        PPOConfig()
        .environment(
            f"agents.rllib:{ENVS}",
            env_config=scene | {"max_episode_steps": config.episode_steps},
        )
        .env_runners(
            num_env_runners=runners,
            num_envs_per_env_runner=config.n_envs,
            gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
            rollout_fragment_length=given["n_steps"],
            env_to_module_connector=lambda env, spaces, device: MeanStdFilter(),
        )
        .training(
            train_batch_size_per_learner=given["n_steps"] * config.n_envs * max(runners, 1),
            minibatch_size=given["batch_size"],
            num_epochs=given["n_epochs"],
            lr=[[0, rate], [config.steps, 0.0]],
            gamma=given["gamma"],
            lambda_=given["gae_lambda"],
            clip_param=given.get("clip_range", 0.2),
            entropy_coeff=given["ent_coef"],
            vf_clip_param=float("inf"),
            use_kl_loss=False,
            grad_clip=0.5,
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=network["net_arch"],
                fcnet_activation=str(network.get("activation_fn", "Tanh")).split(".")[-1].lower(),
                vf_share_layers=False,
                free_log_std=True,
            )
        )
        .debugging(seed=config.seed, log_level="ERROR")
    )


class RllibPolicy:
    """The current policy of an RLlib algorithm, with the interface of the package's policies.

    Args:
        algorithm: The RLlib algorithm.
    """

    def __init__(self, algorithm: PPO) -> None:
        self._module = algorithm.get_module()
        sees = algorithm.env_runner.get_state()["env_to_module_connector"]["MeanStdFilter"]
        self._seen = RunningStat.from_state(sees[None]["running_stats"][0])

    def predict(
        self,
        observation: NDArray,
        state: tuple[NDArray, ...] | None = None,
        episode_start: NDArray | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], None]:
        """Mean actions for a batch of observations, clipped to [-1, 1]."""
        seen = np.clip(
            (observation - self._seen.mean) / (self._seen.std + SMALL_NUMBER), -10.0, 10.0
        )
        with torch.no_grad():
            batch = {"obs": torch.as_tensor(seen, dtype=torch.float32)}
            mean, _ = self._module.forward_inference(batch)["action_dist_inputs"].chunk(2, dim=-1)
        return np.clip(mean.numpy(), -1.0, 1.0), None


def train(
    config: Config, *, runners: int = 0, out: Path | None = None, quiet: bool = False
) -> Walks:
    """Train PPO with RLlib, and evaluate the policy.

    Args:
        config: Configuration of the training.
        runners: Number of sampling processes; 0 samples in the current process.
        out: Folder for RLlib's checkpoint; None saves nothing.
        quiet: Whether to print no progress.

    Returns:
        Evaluation episodes, with mean actions.
    """
    ray.init("local", include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
    try:
        algorithm = rllib_config(config, runners=runners).build_algo()
        steps = 0
        while steps < config.steps:
            result = algorithm.train()
            steps = int(result["num_env_steps_sampled_lifetime"])
            if not quiet:
                length = result["env_runners"].get("episode_len_mean", float("nan"))
                print(f"{steps:,} steps: episodes of {length:.0f}", flush=True)
        if out is not None:
            algorithm.save_to_path(out.absolute())
        return simulate_episodes(RllibPolicy(algorithm), arena(config, EPISODES), seed=SEED)
    finally:
        ray.shutdown()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.rllib",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--scene", default=DEFAULT_SCENE, help=f"{', '.join(SCENES)} (%(default)s)")
    add("--steps", type=int, default=STEPS, metavar="N", help="environment steps (%(default)s)")
    add("--runners", type=int, default=0, metavar="N", help="processes that sample (this one)")
    add("--seed", type=int, default=0, help="of everything (%(default)s)")
    add("--out", type=Path, metavar="DIR", help="keep RLlib's checkpoint there")
    args = parser.parse_args(arguments)
    return console.run(
        lambda: _compare(args), name="agents.rllib: ", refusals={ValueError: 2, OSError: 2}
    )


def _compare(args: argparse.Namespace) -> None:
    """Train, and print the evaluation beside that of the passive walker."""
    config = configure("ppo", args.scene, steps=args.steps, seed=args.seed)
    walks = train(config, runners=args.runners, out=args.out)
    passive = simulate_episodes(Passive(), arena(config, EPISODES), seed=SEED)
    print(
        score_table(
            f"{config.scene}; {EPISODES} episodes", {"RLlib PPO": walks, Passive.name: passive}
        )
    )


if __name__ == "__main__":
    sys.exit(main())
