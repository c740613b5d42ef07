"""Checkpoints: everything that a training needs to resume exactly, saved between two updates."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import flatdim
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from agents.config import Config, ConfigError
from agents.envs import training_envs
from agents.files import CONFIG, newest_checkpoint, read_arrays, read_json, reading
from agents.learner import (
    MODEL,
    LearnedPolicy,
    build,
    moments,
    restore_moments,
    restore_weights,
    save_model,
)
from agents.networks import columns, in_groups
from gym_passive_walker._tools.arguments import number, whole
from gym_passive_walker._tools.files import replacing
from gym_passive_walker.models.walkers import Walker, as_walker

_ARRAYS, _REPLAY, _NOTES = "arrays.npz", "replay.npz", "notes.json"
_RECORDS, _RANDOMS = "envs.npz", "envs.json"
_REACHED = ("hundred_strides", "reached_time_limit")  # shares of walks in an evaluation
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_LAST = ("_last_obs", "_last_original_obs", "_last_episode_starts")
_STORED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save(path: Path, model: BaseAlgorithm, notes: dict[str, Any]) -> None:
    """Write a checkpoint as a folder, atomically.

    Args:
        path: The folder, which must not exist.
        model: The algorithm, between two updates.
        notes: Further values to save, representable as JSON.
    """
    assert model.env is not None
    arrays: dict[str, Any] = {"torch": torch.get_rng_state().numpy()}
    last = {name: columns(getattr(model, name)) for name in _LAST}
    arrays |= {name: array for name, array in last.items() if array is not None}
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        arrays |= moments(normalizer) | {"returns": normalizer.returns}
    # stable-baselines3 shuffles with numpy's global generator.
    shuffling: Any = np.random.get_state()  # noqa: NPY002
    kind, keys, *place = shuffling
    arrays["numpy"] = keys
    state = {
        "counters": {name: getattr(model, name) for name in _COUNTERS},
        "numpy": [kind, *place],
        "action_space": model.action_space.np_random.bit_generator.state,
        "episodes": [{k: float(v) for k, v in info.items()} for info in model.ep_info_buffer or ()],
        "notes": notes,
    }
    with replacing(path) as folder:
        folder.mkdir()
        save_model(folder / MODEL, model)
        np.savez(folder / _ARRAYS, **arrays)
        _save_walkers(model.env, folder)
        replay = getattr(model, "replay_buffer", None)
        if replay is not None:
            filled = replay.buffer_size if replay.full else replay.pos
            stored = {name: getattr(replay, name)[:filled] for name in _STORED}
            np.savez(folder / _REPLAY, position=replay.pos, full=replay.full, **stored)
        (folder / _NOTES).write_text(json.dumps(state), encoding="utf-8")


def restore(path: Path, model: BaseAlgorithm) -> dict[str, Any]:
    """Load a checkpoint into an untrained algorithm of the same configuration.

    Returns:
        The `notes` of `save`.

    Raises:
        ConfigError: if a file is damaged, or holds values that no training reaches.
    """
    assert model.env is not None
    restore_weights(model, path / MODEL)
    state = read_json(path / _NOTES)
    with reading(path / _NOTES):
        for name in _COUNTERS:
            setattr(model, name, whole(state["counters"][name], name, 0))
        episodes = [{k: number(v, k) for k, v in info.items()} for info in state["episodes"]]
        notes: dict[str, Any] = {
            name: state["notes"][name] for name in ("best", "seconds", "curve")
        }
        number(notes["seconds"], "seconds", least=0.0)
        if notes["best"] is not None:
            number(notes["best"], "best")
        for row in notes["curve"]:
            for name in ("steps", "seconds", "reward", "distance", *_REACHED):
                number(row[name], name)
    model.ep_info_buffer = deque(episodes, maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    # Restore the environments first: the arrays below belong to the same step.
    _restore_walkers(model.env, path)
    with reading(path / _ARRAYS):
        keys = _restore_arrays(model, read_arrays(path / _ARRAYS))
    if getattr(model, "replay_buffer", None) is not None:
        with reading(path / _REPLAY):
            _restore_replay(model, read_arrays(path / _REPLAY))
    with reading(path / _NOTES):
        kind, place, *gauss = state["numpy"]
        if not 0 <= whole(place, "numpy's place among its keys", 0) <= len(keys):
            raise ValueError(f"numpy's place among its keys is {place}")  # numpy does not check it
        np.random.set_state((kind, keys, place, *gauss))  # noqa: NPY002
        model.action_space.np_random.bit_generator.state = state["action_space"]
    return notes


def last_policy(run: Path, *, trust: bool = False) -> tuple[Config, LearnedPolicy]:
    """A run's configuration, and the policy of its newest checkpoint.

    A run may keep another one, that of its best evaluation (`training.Run.keeps_last`). `trust`
    allows a scene of the user's own.

    Raises:
        ConfigError: if the folder is not a run, has no checkpoint yet, or is not trusted.
    """
    config, newest = Config.load(run / CONFIG, trust=trust), newest_checkpoint(run)
    if newest is None:
        raise ConfigError(f"{run} has no checkpoint yet")
    model = build(config, training_envs(config))
    with reading(newest):
        restore(newest, model)
    return config, LearnedPolicy(model, config.algo.upper())


def _restore_arrays(model: BaseAlgorithm, arrays: dict[str, NDArray]) -> NDArray:
    """Restore the last observations and torch's generator; returns the keys of numpy's generator.

    Raises:
        ValueError: if an array does not have the shape and type of the algorithm's.
        KeyError: if an array is missing.
    """
    space = model.observation_space
    seen = np.empty((model.n_envs, flatdim(space)), np.float32)
    began = np.empty(model.n_envs, bool)
    for name, like in zip(_LAST, (seen, seen, began), strict=True):
        found = arrays.get(name)
        known: Any = None if found is None else _checked(found, name, like)
        if known is not None and like is seen:
            known = in_groups(known, space)
        setattr(model, name, known)
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        for name, own in moments(normalizer).items():
            found = _checked(arrays[name], name, own)
            if not name.endswith("mean") and np.any(found < 0.0):
                raise ValueError(f"{name} is below 0")
        restore_moments(normalizer, arrays)
        normalizer.returns = _checked(arrays["returns"], "returns", np.empty(model.n_envs))
    torch.set_rng_state(torch.from_numpy(arrays["torch"]))
    if arrays["numpy"].dtype.kind != "u":  # numpy does not check it
        raise ValueError(f"numpy's keys must be whole numbers, not {arrays['numpy'].dtype}")
    return arrays["numpy"]


def _restore_replay(model: Any, stored: dict[str, NDArray]) -> None:
    """Restore the replay buffer.

    Raises:
        ValueError: if its size differs from the algorithm's, or from its own fill count.
        KeyError: if an array is missing.
    """
    replay = model.replay_buffer
    position, full = whole(stored["position"], "position", 0), bool(stored["full"])
    filled = replay.buffer_size if full else position
    if position >= replay.buffer_size:
        raise ValueError(f"position {position} is beyond {replay.buffer_size} steps")
    for name in _STORED:
        own = getattr(replay, name)[:filled]
        own[:] = _checked(stored[name], name, own)
    replay.pos, replay.full = position, full


def _checked(found: NDArray, name: str, own: NDArray) -> NDArray:
    """Return an array that was read, after a check against the algorithm's own array.

    Raises:
        ValueError: if its shape or kind of type differs, or a value is not finite.
    """
    if found.shape != own.shape or found.dtype.kind != own.dtype.kind:
        raise ValueError(
            f"{name} must be {own.dtype} of shape {own.shape}, not {found.dtype} of {found.shape}"
        )
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite")
    return found


def _save_walkers(envs: VecEnv, folder: Path) -> None:
    """Write the state of the environments, and that of their random generators."""
    state = envs.unwrapped.get_state()  # type: ignore[attr-defined]
    walkers, randoms = state.pop("walkers"), state.pop("random")
    np.savez(folder / _RECORDS, **state)
    # Environments that share one walker store it once.
    walkers = walkers if len(set(walkers)) > 1 else walkers[:1]
    walkers = [asdict(each) if isinstance(each, Walker) else each for each in walkers]
    text = json.dumps({"walkers": walkers, "random": randoms})
    (folder / _RANDOMS).write_text(text, encoding="utf-8")


def _restore_walkers(envs: VecEnv, folder: Path) -> None:
    """Restore what `_save_walkers` wrote."""
    native: Any = envs.unwrapped
    rest: dict[str, Any] = read_json(folder / _RANDOMS)
    with reading(folder / _RANDOMS):
        # Of a system, the name of its equations and its constants, which `set_state` takes.
        walkers = [each if isinstance(each, list) else as_walker(each) for each in rest["walkers"]]
        if len(walkers) == 1:
            walkers *= native.num_envs
        found = {"walkers": walkers, "random": rest["random"]}
    with reading(folder / _RECORDS):
        native.set_state(read_arrays(folder / _RECORDS) | found)
