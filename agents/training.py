"""A training run from its configuration to its files; it can be interrupted and resumed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from tqdm import tqdm

from agents import checkpoint, envs, files
from agents.callbacks import Milestones, StopRequest
from agents.config import Config
from agents.evaluation import EPISODES, write_rows
from agents.exploration import explorers
from agents.learner import LearnedPolicy, begin_with, build, on_numpy
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.envs.evaluation.walks import simulate_episodes

EXAM_SEED = 1_000_000
"""Seed of the evaluations during training; the final evaluation has other episodes."""

KEEPS_LAST = ("ppo-fast", "shac", "shac-learned")
"""Algorithms of which the last policy is kept, and not that of the best evaluation.

Their noise and rates end near zero, so the last policy costs least. A single fall among the walks
of an evaluation outweighs that. And a return counts control steps, of which a heelstrike ends one:
of policies of equal cost the best evaluation has the gait of whole control steps. A reward of the
user's own is itself what counts, so the best evaluation is kept there.
"""


class Run:
    """A training with its files.

    Args:
        config: The configuration.
        folder: Folder of the files; empty, or with a run of this configuration, which is resumed.
        tensorboard: Whether to write tensorboard's logs too.
        trust: Whether to allow a first policy of a scene of the user's own.

    Raises:
        ConfigError: if the configuration is invalid, the folder has a run of another one, or the
            checkpoint is damaged.
    """

    def __init__(
        self, config: Config, folder: Path, *, tensorboard: bool = False, trust: bool = False
    ) -> None:
        self.config, self.folder = config, folder
        config.check_same(folder / files.CONFIG, ignore=("steps", "every"))
        log = {"tensorboard_log": str(folder / "tensorboard")} if tensorboard else {}
        self.model: BaseAlgorithm = build(config, envs.training_envs(config), **log)
        if not tensorboard:  # else stable-baselines3 makes an empty folder of logs for each run
            self.model.set_logger(Logger(None, []))
        self.exploring = explorers(config.algo, config.exploration)
        self.exam = envs.arena(config, EPISODES)
        self.keeps_last = config.algo in KEEPS_LAST and envs.scene_of(config).reward is None
        self.notes: dict[str, Any] = {"best": None, "seconds": 0.0, "curve": []}
        newest = files.newest_checkpoint(folder)
        self.resumed = newest is not None
        if newest is None and config.start is not None:
            begin_with(self.model, config.start, trust=trust)
        if newest is not None:
            with files.reading(newest):
                self.notes = checkpoint.restore(newest, self.model)
        with replacing(folder / files.CONFIG) as path:
            config.save(path)

    @property
    def steps(self) -> int:
        """Environment steps made so far."""
        return self.model.num_timesteps

    @property
    def left_out(self) -> list[str]:
        """Sentences on the derivatives that the algorithm leaves out; none if it takes none."""
        recorder = getattr(self.model.env, "recorder", None)
        return [] if recorder is None else [*recorder.left_out]

    def train(self, *, progress: bool = True) -> bool:
        """Train to the end, or until a stop request.

        Returns:
            Whether the end was reached.
        """
        left = self.config.steps - self.steps
        if left <= 0:
            return True
        bar = tqdm(
            total=self.config.steps, initial=self.steps, unit=" steps", unit_scale=True,
            disable=not progress, dynamic_ncols=True, smoothing=0.05,
        )  # fmt: skip

        def reach(seconds: float) -> None:
            row = self._evaluate(seconds)
            said = f"walks {row['distance']:.1f} l, {row['strides']:.0f} strides, return "
            said += f"{row['reward']:.1f}"
            if not math.isnan(row["exploring_reward"]):
                said += f" (exploring {row['exploring_reward']:.1f})"
            bar.set_postfix_str(said, refresh=False)
            self._save()

        with StopRequest() as stop, bar:
            milestones = Milestones(self.config.every, reach, stop, bar)
            logged = self.model.tensorboard_log is not None
            self.model.learn(
                left,
                callback=[milestones, *self.exploring],
                # SAC logs seldom, because logging each time would be slow.
                log_interval=(100 if self.config.algo == "sac" else 1) if logged else None,  # type: ignore[arg-type]
                reset_num_timesteps=not self.resumed,
            )
            if not milestones.stopped:
                milestones.finish()
        return not milestones.stopped

    @property
    def first_to_walk(self) -> dict[str, Any] | None:
        """The first evaluation in which half of the walks made a hundred strides; None if none."""
        return next((row for row in self.notes["curve"] if row["hundred_strides"] >= 0.5), None)

    def first_walks(self) -> str:
        """A sentence on when half of the evaluation walks first reached the time limit."""
        walked = [row for row in self.notes["curve"] if row["reached_time_limit"] >= 0.5]
        if not walked:
            return "At no time in training did half of the evaluation walks reach the time limit."
        first = walked[0]
        return (
            f"Half of the evaluation walks first reached the time limit after "
            f"{first['seconds']:.1f} s of training ({first['steps']:,} steps). Their median "
            f"distance was {first['distance']:.1f} leg lengths."
        )

    @property
    def exploring_reward(self) -> float:
        """Mean return of the last training episodes: noisy actions, short episodes; NaN if none."""
        returns = [float(episode["r"]) for episode in self.model.ep_info_buffer or ()]
        return float(np.mean(returns)) if returns else math.nan

    def _evaluate(self, seconds: float) -> dict[str, Any]:
        """Add a row to the learning curve, and save the policy if it is to be kept."""
        policy = LearnedPolicy(self.model, self.config.algo.upper())
        walks = simulate_episodes(on_numpy(policy, self.config), self.exam, seed=EXAM_SEED)
        self.notes["seconds"] += seconds
        row = {
            "steps": self.steps,
            "seconds": round(self.notes["seconds"], 2),
            **walks.summary(),
            "exploring_reward": self.exploring_reward,
        }
        self.notes["curve"].append(row)
        for name in ("reward", "distance", "strides"):  # beside the library's rollout/ep_rew_mean
            self.model.logger.record(f"eval/{name}", row[name])
        best = self.notes["best"]
        if best is None or row["reward"] >= best or self.keeps_last:
            self.notes["best"] = row["reward"]
            policy.save(self.folder)
        with replacing(self.folder / "learning_curve.csv") as path:
            write_rows(path, self.notes["curve"])
        return row

    def _save(self) -> None:
        path = files.checkpoint_path(self.folder, self.steps)
        if not path.exists():
            checkpoint.save(path, self.model, self.notes)
        files.drop_older_checkpoints(path)
