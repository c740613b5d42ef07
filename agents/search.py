"""Hyperparameter search with Optuna, in this process or through Ray Tune on many CPUs."""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
import yaml

from agents import files
from agents.config import Config, ConfigError
from agents.training import Run
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.apps.sweeps.cluster import HERE

STUDY, BEST, ASKED = "study.log", "best.yml", "asked.yml"

_SPACES: dict[str, dict[str, Callable[[Any], Any]]] = {
    "ppo": {
        "learning_rate": lambda t: f"lin_{t.suggest_float('learning_rate', 1e-4, 5e-3, log=True)}",
        "gamma": lambda t: 1.0 - t.suggest_float("1 - gamma", 2e-3, 5e-2, log=True),
        "gae_lambda": lambda t: t.suggest_float("gae_lambda", 0.85, 0.99),
        "ent_coef": lambda t: t.suggest_float("ent_coef", 1e-5, 1e-2, log=True),
        "n_epochs": lambda t: t.suggest_int("n_epochs", 3, 20),
    },
    "ppo-fast": {
        "learning_rate": lambda t: f"lin_{t.suggest_float('learning_rate', 3e-4, 1e-2, log=True)}",
        "gamma": lambda t: 1.0 - t.suggest_float("1 - gamma", 2e-3, 5e-2, log=True),
        "gae_lambda": lambda t: t.suggest_float("gae_lambda", 0.85, 0.99),
        "clip_range": lambda t: t.suggest_float("clip_range", 0.05, 0.4, log=True),
        "n_epochs": lambda t: t.suggest_int("n_epochs", 2, 10),
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

_SPACES["shac-learned"] = _SPACES["shac"]


def search(
    config: Config,
    folder: Path,
    trials: int,
    *,
    ray: str | None = None,
    progress: bool = True,
    trust: bool = False,
) -> dict[str, Any]:
    """Search for hyperparameters, with one training for each trial, and save the best.

    The study is saved on disk: a repeated call resumes the study, with or without Ray.

    Args:
        config: Configuration of the trainings; the first trial has its hyperparameters.
        folder: Folder of the study, the trainings, and the best hyperparameters as a preset in
            YAML. All machines of a cluster must have access to it under this path.
        trials: Total number of trainings.
        ray: "here" for Ray Tune on this machine, with a training on each core, or the address
            of a cluster; None runs one training after another.
        progress: Whether to print each result.
        trust: Whether to allow a first policy of a scene of the user's own.

    Returns:
        The best hyperparameters.

    Raises:
        ConfigError: if Optuna, or Ray Tune, is not installed, or the folder has the trials of
            another configuration.
    """
    with _needed("Optuna", "search"):
        import optuna  # type: ignore  # an extra
        from optuna.storages import JournalStorage  # type: ignore  # an extra
        from optuna.storages.journal import JournalFileBackend  # type: ignore  # an extra
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.absolute()  # workers have other current folders
    _check_same(config, folder)
    with files.reading(folder / STUDY):
        storage = JournalStorage(JournalFileBackend(str(folder / STUDY)))
        study = optuna.create_study(
            study_name=f"{config.scene}-{config.algo}",
            storage=storage,
            sampler=optuna.samplers.TPESampler(seed=config.seed),
            direction="maximize",
            load_if_exists=True,
        )

    def tried(trial: Any) -> float:
        best = _trained(folder, **_drawn(config, trial), trust=trust)
        if progress:
            print(f"trial {trial.number}: return {best:.3f}", flush=True)
        return best

    done = optuna.trial.TrialState.COMPLETE  # an interrupted trial has no result
    left = trials - len([t for t in study.trials if t.state == done])
    if left > 0 and ray is None:
        study.optimize(tried, n_trials=left)
    elif left > 0:
        kept = {"study_name": study.study_name, "storage": storage, "sampler": study.sampler}
        trained = partial(_trained, folder, trust=trust)
        _tune(kept, partial(_drawn, config), trained, folder, left, str(ray), progress=progress)
    best = study.best_trial.user_attrs["hyperparams"]
    preset = replace(config, hyperparams=best).preset()
    with replacing(folder / BEST) as path:
        path.write_text(yaml.safe_dump({config.scene: preset}, sort_keys=False), encoding="utf-8")
    return best


def _check_same(config: Config, folder: Path) -> None:
    """Save the configuration of a search, or compare it with that of the trials in the folder."""
    with replacing(folder / ASKED) as path:
        config.save(path)
        asked = Config.load(path, trust=True)
        if (folder / ASKED).is_file():
            differences = Config.load(folder / ASKED, trust=True).differences(asked)
            if differences:
                raise ConfigError(
                    f"{folder} has the trials of another configuration: give another --out, or "
                    "the same arguments:\n  " + "\n  ".join(differences)
                )


def _drawn(config: Config, trial: Any) -> dict[str, Any]:
    """Configuration and number of a trial; the first has the hyperparameters of `config`."""
    hyperparams = copy.deepcopy(config.hyperparams)
    if trial.number > 0:
        hyperparams |= {name: draw(trial) for name, draw in _SPACES[config.algo].items()}
    trial.set_user_attr("hyperparams", hyperparams)
    return {"config": replace(config, hyperparams=hyperparams), "number": trial.number}


def _trained(folder: Path, config: Config, number: int, *, trust: bool) -> float:
    """Best return of one training."""
    run = Run(config, folder / f"trial-{number}", trust=trust)
    if not run.train(progress=False):
        raise KeyboardInterrupt  # an unfinished trial has no result
    return float(run.notes["best"])


def _tune(
    study: dict[str, Any],
    drawn: Callable[[Any], dict[str, Any]],
    trained: Callable[[Config, int], float],
    folder: Path,
    trials: int,
    ray: str,
    *,
    progress: bool,
) -> None:
    """Run the trials of a study with Ray Tune, one on each core at a time."""
    with _needed("Ray Tune", "ray"):
        import ray as library  # type: ignore[import-not-found]
        from ray import tune  # type: ignore[import-not-found]
        from ray.tune.search.optuna import OptunaSearch  # type: ignore[import-not-found]
    local = {"address": "local", "include_dashboard": False} if ray == HERE else {"address": ray}
    library.init(**local, log_to_driver=False, logging_level=logging.ERROR)

    def trial(given: dict[str, Any]) -> None:
        torch.set_num_threads(1)
        tune.report({"return": trained(given["config"], given["number"])})

    try:
        found = tune.Tuner(
            trial,
            tune_config=tune.TuneConfig(
                search_alg=OptunaSearch(drawn, metric="return", mode="max", **study),
                num_samples=trials,
            ),
            run_config=tune.RunConfig(storage_path=str(folder), name="tune", verbose=0),
        ).fit()
    finally:
        library.shutdown()
    if progress:
        for each in found:
            said = each.error or f"return {each.metrics['return']:.3f}"
            print(f"trial {each.config['number']}: {said}", flush=True)


@contextmanager
def _needed(what: str, name: str) -> Iterator[None]:
    try:
        yield
    except ImportError:
        raise ConfigError(
            f'a search needs {what}: pip install "gym-passive-walker[{name}]"'
        ) from None
