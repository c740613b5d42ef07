"""Everything a training needs to go on as if nothing had happened, saved between two updates."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from agents.files import read_arrays, read_json
from agents.learner import MODEL, moments, restore_moments, restore_weights, save_model
from gym_passive_walker.envs.scene import walker_from
from gym_passive_walker.files import replacing

_ARRAYS, _REPLAY, _NOTES = "arrays.npz", "replay.npz", "notes.json"
_RECORDS, _RANDOMS = "worlds.npz", "worlds.json"
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_LAST = ("_last_obs", "_last_original_obs", "_last_episode_starts")
_STORED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save(path: Path, model: BaseAlgorithm, notes: dict[str, Any]) -> None:
    """Write a checkpoint as a folder, which appears whole or not at all.

    Args:
        path: The folder, not there yet.
        model: The algorithm, between two updates.
        notes: What else to keep; JSON.
    """
    assert model.env is not None
    arrays: dict[str, Any] = {"torch": torch.get_rng_state().numpy()}
    arrays |= {name: getattr(model, name) for name in _LAST if getattr(model, name) is not None}
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        arrays |= moments(normalizer) | {"returns": normalizer.returns}
    # The library shuffles by numpy's global generator.
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
    """Put a checkpoint into an untrained algorithm of the same configuration.

    Returns:
        The notes that were saved with it.

    Raises:
        ConfigError: if a file of it is damaged.
    """
    assert model.env is not None
    restore_weights(model, path / MODEL)
    state = read_json(path / _NOTES)
    for name, value in state["counters"].items():
        setattr(model, name, value)
    model.ep_info_buffer = deque(state["episodes"], maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    # The environments first: what follows is the learner's side of the same moment.
    _restore_walkers(model.env, path)
    arrays = read_arrays(path / _ARRAYS)
    for name in _LAST:
        setattr(model, name, arrays.get(name))
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        restore_moments(normalizer, arrays)
        normalizer.returns = arrays["returns"]
    keys: NDArray = arrays["numpy"]
    torch.set_rng_state(torch.from_numpy(arrays["torch"]))
    replay = getattr(model, "replay_buffer", None)
    if replay is not None:
        stored = read_arrays(path / _REPLAY)
        for name in _STORED:
            getattr(replay, name)[: len(stored[name])] = stored[name]
        replay.pos, replay.full = int(stored["position"]), bool(stored["full"])
    kind, *place = state["numpy"]
    np.random.set_state((kind, keys, *place))  # noqa: NPY002
    model.action_space.np_random.bit_generator.state = state["action_space"]
    return state["notes"]


def _save_walkers(worlds: VecEnv, folder: Path) -> None:
    """Write where the walkers stand, and their random numbers."""
    state = worlds.unwrapped.get_state()  # type: ignore[attr-defined]
    walkers, randoms = state.pop("walkers"), state.pop("random")
    np.savez(folder / _RECORDS, **state)
    # Walkers are many only where each differs from the others.
    walkers = [asdict(walker) for walker in (walkers if len(set(walkers)) > 1 else walkers[:1])]
    text = json.dumps({"walkers": walkers, "random": randoms})
    (folder / _RANDOMS).write_text(text, encoding="utf-8")


def _restore_walkers(worlds: VecEnv, folder: Path) -> None:
    """Put back what `_save_walkers` wrote."""
    native: Any = worlds.unwrapped
    rest: dict[str, Any] = read_json(folder / _RANDOMS)
    walkers = [walker_from(parameters) for parameters in rest["walkers"]]
    if len(walkers) == 1:
        walkers *= native.num_envs
    state = read_arrays(folder / _RECORDS) | {"walkers": walkers, "random": rest["random"]}
    native.set_state(state)
