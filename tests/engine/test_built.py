"""What environments and analyses load is in a wheel, which has no compiler beside it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = """
import warnings
import gymnasium as gym
import numpy as np
import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.apps import build
from gym_passive_walker.engine import compiled, machine
from gym_passive_walker.envs import constraints

warnings.simplefilter("ignore")
there, used, load = machine.asked_by(build.pieces()), [], machine.kept_code


def noted(name, *rest):
    used.append(name)
    return load(name, *rest)


machine.kept_code = compiled.kept_code = constraints.kept_code = noted
scenes = "level steep rolling lab rough pushed push-off commanded anywhere".split()
changes = [
    {}, {"reward": lambda s: s.distance},
    {"action_delay": 2, "observation_noise": 0.1},
    {"observation": lambda s: (*s.state, s.slope), "terminated": lambda s: s.steps > 9},
    {"constraints": {"friction": "end"}}, {"slope": (0.0, 0.02)}, {"control": "stride"},
    {"reward": lambda s: s.distance, "action_delay": 1},
]
given = [{"scene": scene} for scene in scenes] + changes
given += [{"walker": own, **change} for own in (FIVE_LINKS, TORSO) for change in changes[:4]]
for arguments in given:
    for more in (0, 3):
        made = {"id": "PassiveWalker-v0", **arguments}
        env = gym.make_vec(num_envs=more, **made) if more else gym.make(**made)
        env.reset(seed=0)
        action = env.action_space.sample()
        for _ in range(12):
            *_, ended, cut, info = env.step(action)
            dict(info)
            if not more and (ended or cut):
                env.reset()
        env.reset(options={"slope": 0.01})
        env.unwrapped.set_state(env.unwrapped.get_state())
gpw.stride("C", np.float32(0.03), np.full((3, 6), -0.1, np.float32))
gpw.stride("C", 0, [[0, 0, 0, -1, 0, 0]] * 2)
gpw.stride("lab", 0.036, np.asfortranarray(np.full((4, 6), -0.2)))
gpw.rough(0.01).ground(3, [1, 2])
gpw.parameter_family("lab", "gravity", 9.8, 9.82, slope=0.036)
kernels = {name for name in used if not name.startswith("own-")}  # systems are traced where used
assert len(kernels) > 40, kernels
assert kernels <= there.keys(), kernels - there.keys()
"""


@pytest.mark.slow
def test_whatever_scenes_and_analyses_load_is_in_a_wheel():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]


PREPARED = """
import subprocess
import gymnasium as gym
from gym_passive_walker.apps import build
from gym_passive_walker.engine import cache
from gym_passive_walker.gaits.scenes.scene import make_scene

scene = make_scene("level")
build.compile_for(scene)
before = {file.name for file in cache.cache_directory().iterdir()}
for make in (gym.make, gym.make_vec):
    env = make("PassiveWalker-v0", scene=scene)
    env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    dict(info)
assert not {file.name for file in cache.cache_directory().iterdir()} - before
assert {name.split("-")[0] for name in before} >= {"kneed", "ticks.kernels_for.step"}
subprocess.Popen = None
build.compile_for(scene)
"""


@pytest.mark.slow
def test_what_is_compiled_before_a_training_is_all_that_its_scene_needs(tmp_path):
    inherited = {name: x for name, x in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    subprocess.run(
        [sys.executable, "-c", PREPARED],
        cwd=ROOT, env=inherited | {"XDG_CACHE_HOME": str(tmp_path)}, check=True,
    )  # fmt: skip
