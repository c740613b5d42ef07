"""Fixtures of the tests of trainers."""

import pytest


@pytest.fixture
def rsl_rl_configuration() -> dict:
    """A small configuration of PPO in rsl_rl."""
    network = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "relu"}
    noise = {"class_name": "GaussianDistribution", "init_std": 0.37}
    return {
        "num_steps_per_env": 64, "save_interval": 10**9, "logger": "tensorboard",
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": {**network, "obs_normalization": True, "distribution_cfg": noise},
        "critic": {**network, "obs_normalization": True},
        "algorithm": {
            "class_name": "PPO", "gamma": 0.995, "lam": 0.98, "clip_param": 0.1,
            "learning_rate": 1e-3, "schedule": "fixed", "num_learning_epochs": 10,
            "num_mini_batches": 2, "entropy_coef": 0.0, "value_loss_coef": 0.5,
            "max_grad_norm": 0.5, "use_clipped_value_loss": False,
        },
    }  # fmt: skip
