"""Short trainings that several tests share."""

import dataclasses

import gymnasium
import numpy as np
import torch

from agents import envs
from agents.config import configure

TINY = ["--steps", "128", "--envs", "8", "--every", "64", "--quiet"]
"""Words of the command line for two small updates."""

# What follows the steps asked for would go on otherwise when more are asked for.
PPO = {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "learning_rate": 1e-3}
SAC = {"learning_starts": 64, "batch_size": 32, "buffer_size": 512, "learning_rate": 1e-3}

SEEN = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 8)).astype(np.float32)
"""Observations at which policies are compared."""


def small(algo="ppo", steps=256, scene="level", **changes):
    """A configuration of a few hundred steps."""
    config = configure(algo, scene, steps=steps, **{"n_envs": 8, "every": 128, **changes})
    config.hyperparams.update(SAC if algo == "sac" else PPO)
    if algo != "sac":  # noise follows the steps asked for
        config = dataclasses.replace(config, exploration=None)
    return config


def weights(model):
    """All numbers that a learner has learned, in one array."""
    tensors = list(model.policy.state_dict().values())
    if getattr(model, "log_ent_coef", None) is not None:
        tensors.append(model.log_ent_coef)
    return torch.cat([t.detach().reshape(-1) for t in tensors]).numpy()


def short_arena(config, count):
    """Two walkers for thirty steps, in place of `agents.envs.arena`."""
    scene = envs.scene_of(config)
    return gymnasium.make_vec(envs.ID, num_envs=min(count, 2), scene=scene, max_episode_steps=30)
