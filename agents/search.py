"""A search for better hyperparameters, with Optuna."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from agents import files
from agents.config import Config, ConfigError
from agents.training import Run

STUDY, BEST = "study.log", "best.yml"

_SPACES: dict[str, dict[str, Callable[[Any], Any]]] = {
    "ppo": {
        "learning_rate": lambda t: f"lin_{t.suggest_float('learning_rate', 1e-4, 5e-3, log=True)}",
        "gamma": lambda t: 1.0 - t.suggest_float("1 - gamma", 2e-3, 5e-2, log=True),
        "gae_lambda": lambda t: t.suggest_float("gae_lambda", 0.85, 0.99),
        "ent_coef": lambda t: t.suggest_float("ent_coef", 1e-5, 1e-2, log=True),
        "n_epochs": lambda t: t.suggest_int("n_epochs", 3, 20),
    },
    "sac": {
        "learning_rate": lambda t: t.suggest_float("learning_rate", 1e-4, 3e-3, log=True),
        "gamma": lambda t: 1.0 - t.suggest_float("1 - gamma", 2e-3, 5e-2, log=True),
        "tau": lambda t: t.suggest_float("tau", 2e-3, 5e-2, log=True),
        "gradient_steps": lambda t: t.suggest_categorical("gradient_steps", [1, 2, 4, 8]),
        "target_entropy": lambda t: t.suggest_float("target_entropy", -5.0, -1.0),
    },
    "shac": {
        "learning_rate": lambda t: f"lin_{t.suggest_float('learning_rate', 3e-4, 1e-2, log=True)}",
        "gamma": lambda t: 1.0 - t.suggest_float("1 - gamma", 2e-3, 5e-2, log=True),
        "gae_lambda": lambda t: t.suggest_float("gae_lambda", 0.8, 0.97),
        "n_steps": lambda t: t.suggest_categorical("n_steps", [16, 32, 64]),
        "reach": lambda t: t.suggest_float("reach", 0.02, 0.3, log=True),
    },
}


def search(config: Config, folder: Path, trials: int, *, progress: bool = True) -> dict[str, Any]:
    """Try hyperparameters, each in a training of its own, and keep the best.

    The study is kept on disk: the same call goes on with it.

    Args:
        config: What to train; its hyperparameters are the first that are tried.
        folder: Gets the study, the trainings and the best hyperparameters as a preset in YAML.
        trials: How many trainings in all.
        progress: Whether to print each result.

    Returns:
        The best hyperparameters.

    Raises:
        ConfigError: if Optuna is not installed.
    """
    try:
        import optuna  # type: ignore  # an extra
        from optuna.storages import JournalStorage  # type: ignore  # an extra
        from optuna.storages.journal import JournalFileBackend  # type: ignore  # an extra
    except ImportError:
        raise ConfigError(
            'a search needs Optuna: pip install "gym-passive-walker[search]"'
        ) from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    folder.mkdir(parents=True, exist_ok=True)
    with files.reading(folder / STUDY):
        study = optuna.create_study(
            study_name=f"{config.scene}-{config.algo}",
            storage=JournalStorage(JournalFileBackend(str(folder / STUDY))),
            sampler=optuna.samplers.TPESampler(seed=config.seed),
            direction="maximize",
            load_if_exists=True,
        )

    def tried(trial: Any) -> float:
        hyperparams = copy.deepcopy(config.hyperparams)
        if trial.number > 0:
            hyperparams |= {name: draw(trial) for name, draw in _SPACES[config.algo].items()}
        trial.set_user_attr("hyperparams", hyperparams)
        run = Run(replace(config, hyperparams=hyperparams), folder / f"trial-{trial.number}")
        if not run.train(progress=False):
            raise KeyboardInterrupt  # half a trial says nothing
        if progress:
            print(f"trial {trial.number}: return {run.notes['best']:.3f}", flush=True)
        return float(run.notes["best"])

    left = trials - len([t for t in study.trials if t.state.is_finished()])
    if left > 0:
        study.optimize(tried, n_trials=left)
    best = study.best_trial.user_attrs["hyperparams"]
    preset = replace(config, hyperparams=best).preset()
    with files.replacing(folder / BEST) as path:
        path.write_text(yaml.safe_dump({config.scene: preset}, sort_keys=False), encoding="utf-8")
    return best
