#!/usr/bin/env bash
# Gymnasium 1.4.0: `gymnasium.wrappers.NumpyToTorch` replaces each text in `info` by the text
# "<generator object ...>", without an error; its vector form raises a BufferError for such infos.
# `array_conversion` takes a text for an iterable and builds `str(generator)` from its characters.
# Seen: {'outcome': '<generator object _iterable_array_conversion.<locals>.<genexpr> at 0x...>'}
# Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gymnasium==1.4.0 numpy==2.4.6 array-api-compat==1.16.0 packaging==26.3 torch==2.13.0
"$folder/venv/bin/python" - <<'PYTHON'
import gymnasium as gym
import numpy as np


class Says(gym.Env):
    observation_space = action_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {"outcome": "fell"}

    def step(self, action):
        return np.zeros(1, np.float32), 0.0, True, False, {"outcome": "fell"}


info = gym.wrappers.NumpyToTorch(Says()).reset()[1]
print(info)
assert info["outcome"].startswith("<generator object"), "Gymnasium now returns the text"
PYTHON
