"""Trained policies that come with the package."""

import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from benchmarks.anywhere import HELD_OUT
from gym_passive_walker.envs.evaluation.steps import steps
from gym_passive_walker.envs.policies import policy_folder, shipped_policies

SCENES = ("level", "steep", "rolling", "commanded", "rough", "pushed", "push-off", "anywhere")


def test_each_scene_that_needs_a_motor_has_one():
    assert {name.rpartition("-")[0] for name in shipped_policies()} >= set(SCENES)


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_is_numbers_and_text(name):
    files = sorted(policy_folder(name).iterdir())
    assert [path.name for path in files] == ["policy.json", "policy.safetensors"]
    assert sum(path.stat().st_size for path in files) < 100_000


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_walks_in_its_scene(name):
    policy = gpw.load_policy(name)
    assert policy.name == name and repr(policy) == f"<TrainedPolicy {name}>"
    assert policy.algorithm.lower().startswith(name.rpartition("-")[2])
    arena = gymnasium.make_vec("PassiveWalker-v0", num_envs=10, scene=name.rpartition("-")[0])
    assert arena.scene == policy.scene
    observations, _ = arena.reset(seed=77)
    strides, under_way = np.zeros(10), np.ones(10, bool)
    for step in steps(policy, arena, observations):
        strides[under_way] = step.infos["strides"][under_way]
        under_way &= ~(step.terminated | step.truncated)
        if not under_way.any():
            break
    assert np.mean(strides >= 100) >= 0.9


def test_an_unknown_name_is_answered_with_the_known_ones():
    with pytest.raises(gpw.PolicyError, match=r"level-ppo.*export"):
        gpw.load_policy("moon-ppo")


def test_a_folder_of_the_user_s_does_not_hide_the_policy_of_that_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(policy_folder("rough-ppo"), "level-ppo")
    assert policy_folder("level-ppo") not in (Path("level-ppo"), Path("level-ppo").resolve())
    assert gpw.load_policy("level-ppo").scene != gpw.load_policy("rough-ppo").scene
    assert gpw.load_policy(Path("level-ppo").resolve()).scene == gpw.load_policy("rough-ppo").scene


def test_a_policy_has_a_gait_of_its_own():
    policy = gpw.load_policy("level-ppo")
    gait = gpw.closed_loop_gait(policy, "level")
    assert gait.stable
    assert gait.froude_speed == pytest.approx(0.151, abs=0.001)
    assert gait.cost_of_transport == pytest.approx(0.0139, abs=0.0002)


ACT = """
import sys

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in HEAVY:
            raise ImportError(name + " is not to be had")

HEAVY = {"torch", "stable_baselines3", "pygame", "matplotlib", "yaml", "safetensors", "agents"}
sys.meta_path.insert(0, Refused())
import gym_passive_walker as gpw
from benchmarks.anywhere import HELD_OUT
policy = gpw.load_policy("steep-sac")
action, _ = policy.predict([0.3, -0.3, -0.3, -1.0, -0.5, -0.5, 0.0, 0.11])
assert action.shape == (1,) and abs(action[0]) <= 1.0
gait = gpw.closed_loop_gait(policy, "steep")
assert gait.stable
assert not HEAVY & set(sys.modules)
"""


def test_a_policy_acts_where_there_is_numpy_and_nothing_that_learns(tmp_path):
    root = Path(gpw.__file__).parents[1]
    code = f"import sys; sys.path.insert(0, {str(root)!r})\n{ACT}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_one_policy_walks_with_bodies_that_no_training_has_drawn():
    policy, count = gpw.load_policy("anywhere-ppo"), 20
    arena = gymnasium.make_vec(
        "PassiveWalker-v0", num_envs=count, scene="anywhere", max_episode_steps=1000
    )
    observations, _ = arena.reset(seed=HELD_OUT)
    assert len(set(arena.batch.walkers)) == count
    fell = np.zeros(count, bool)
    for k, step in enumerate(steps(policy, arena, observations), start=1):
        fell |= step.terminated
        if k == 1000:
            assert (step.truncated | fell).all()
            break
    assert not fell.any()


def test_a_policy_is_shown_by_its_name():
    assert repr(gpw.load_policy("level-ppo")) == "<TrainedPolicy level-ppo>"
