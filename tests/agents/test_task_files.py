"""A scene in a file of its arguments: explained, trained and resumed as the same scene by name."""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
import train
from agents import envs
from agents.config import Config, ConfigError, configure
from agents.training import Run
from gym_passive_walker.apps.cli import main as passive_walker
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.tasks import task
from gym_passive_walker.envs.scene import make_scene
from tests.agents.runs import short_arena, small, weights

CODE = """
from examples.five_links import FIVE_LINKS

WEIGHT = 2.0


def reward(step):
    return step.distance - WEIGHT * step.energy


def plain():
    return {"slope": (0.01, 0.02), "walker": {"preset": "C", "hip_mass": 0.4}}
"""
TASKS = {
    "plain.yaml": "slope: [0.01, 0.02]\nwalker: {preset: C, hip_mass: 0.4}\n",
    "plain.toml": 'slope = [0.01, 0.02]\n[walker]\npreset = "C"\nhip_mass = 0.4\n',
    "own.yaml": "slope: 0.02\nreward: mytask:reward\n",
    "system.yaml": "system: mytask:FIVE_LINKS\nslope: 0.05\ncontrol: stride\n",
    "level.yaml": "slope: 0.0\n",
    "list.yaml": "- slope\n",
    "wrong.yaml": "slop: 0.02\n",
    "far.yaml": "slope: 9\n",
    "nowhere.yaml": "reward: mytask:nothing\n",
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The present folder has tasks and a module of the user's."""
    for name, text in TASKS.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "mytask.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("mytask", None)


@pytest.mark.parametrize("name", ["plain.yaml", "plain.toml"])
def test_a_file_of_arguments_is_the_scene_of_these_arguments(name):
    same = make_scene(walker={"preset": "C", "hip_mass": 0.4}, slope=(0.01, 0.02))
    assert make_scene(name, trust=False) == same
    assert make_scene(name, trust=False, tick=0.2) == make_scene(same, tick=0.2)


def test_functions_and_systems_are_named_by_their_modules():
    scene = make_scene("own.yaml", trust=True)
    assert scene.reward is sys.modules["mytask"].reward and scene.slope == 0.02
    assert make_scene("system.yaml", trust=True).walker is sys.modules["mytask"].FIVE_LINKS


@pytest.mark.parametrize("name", ["own.yaml", "system.yaml"])
def test_a_file_that_names_code_is_refused_without_trust(name, capsys):
    with pytest.raises(ValueError, match=r"'mytask:.*' is code .* add --trust"):
        make_scene(name, trust=False)
    for line in (["scene", name], ["evaluate", "passive", "--scene", name]):
        with pytest.raises(SystemExit):
            passive_walker(line)
        assert "add --trust" in capsys.readouterr().err
    assert train.main(["--scene", name]) == 2
    assert "add --trust" in capsys.readouterr().err
    assert "mytask" not in sys.modules
    assert passive_walker(["scene", name, "--trust"]) == 0 and "mytask" in sys.modules


@pytest.mark.parametrize(
    ("name", "said"),
    [("list.yaml", "list.yaml must map arguments of a scene to values"),
     ("wrong.yaml", r"wrong.yaml: a scene has no slop \(slope\?\)"),
     ("far.yaml", "far.yaml: slope must be an angle"),
     ("absent.yaml", "absent.yaml cannot be read"),
     ("nowhere.yaml", "the reward 'mytask:nothing' cannot be found")],
)  # fmt: skip
def test_a_file_that_is_no_scene_is_refused_in_one_sentence(name, said):
    with pytest.raises(ValueError, match=said):
        make_scene(name, trust=True)


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast"])
def test_a_file_trains_as_the_same_scene_by_name(tmp_path, monkeypatch, algo):
    """Both runs have the same weights, bit for bit."""
    monkeypatch.setattr(envs, "arena", short_arena)
    found = []
    for scene in ("level.yaml", "level"):
        run = Run(small(algo, scene=scene), tmp_path / scene.replace(".", ""))
        assert run.train(progress=False)
        found.append(weights(run.model))
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("slope: 0.01\nwalker: lab\n", None),
        ("slope: 0.02\nwalker: lab\n", "env.slope: 0.01 here, 0.02 asked for"),
        ("slope: 0.01\n", "env.walker: 'lab' here, None asked for"),
    ],
)
def test_a_run_resumes_with_its_file_only_as_it_was(folder, text, said):
    (folder / "run").mkdir()
    asked = folder / "asked.yaml"
    asked.write_text("slope: 0.01\nwalker: lab\n")
    configure("ppo", str(asked)).save(folder / "run" / "config.yml")
    asked.write_text(text)
    line = ["--resume", "run", "--algo", "ppo", "--scene", "asked.yaml"]
    args = train.train_parser().parse_args(line)
    if said is None:
        train.run_to_resume(args)
    else:
        with pytest.raises(ConfigError, match=said):
            train.run_to_resume(args)


def test_a_run_keeps_the_content_of_its_file(folder):
    config = configure("ppo", "plain.yaml")
    config.save(folder / "config.yml")
    before = envs.scene_of(config)
    (folder / "plain.yaml").unlink()
    assert envs.scene_of(Config.load(folder / "config.yml")) == before


def test_a_run_refuses_a_file_and_a_function_that_changed(folder):
    config = configure("ppo", "own.yaml")
    config.save(folder / "config.yml")
    (folder / "own.yaml").write_text("slope: 0.03\nreward: mytask:reward\n")
    changed = config.differences(configure("ppo", "own.yaml"))
    assert changed == ["env.slope: 0.02 here, 0.03 asked for"]
    with pytest.raises(ConfigError, match="add --trust"):
        Config.load(folder / "config.yml")
    kept = Config.load(folder / "config.yml", trust=True)
    assert envs.scene_of(kept).slope == 0.02
    (folder / "mytask.py").write_text(CODE.replace("WEIGHT = 2.0", "WEIGHT = 3.25"))
    sys.modules.pop("mytask")
    with pytest.raises(ConfigError, match=r"has the line 'WEIGHT = 3.25' where it had"):
        envs.scene_of(kept)


def test_a_sweep_keeps_the_content_of_a_scene_s_file_and_asks_for_trust():
    def described(scene):
        given = {"controller": "passive", "scene": scene, "episodes": 1}
        return Description(analysis="evaluation", over={"slope": [0.02]}, given=given)

    plain, own = described("plain.yaml"), described("own.yaml")
    assert plain.given["scene"]["slope"] == [0.01, 0.02] and not plain.outside
    assert own.outside == {"mytask:reward": "reward"}
    row = task("evaluation", {**plain.tasks[0], "seed": 0})()
    assert row["strides"] == task("evaluation", {
        "controller": "passive", "episodes": 1, "slope": 0.02, "seed": 0,
        "scene": {"walker": {"preset": "C", "hip_mass": 0.4}},
    })()["strides"]  # fmt: skip


@pytest.mark.parametrize("name", ["plain.yaml", Path("plain.toml"), "mytask:plain"])
def test_a_scene_is_named_alike_wherever_python_takes_one(name):
    same, brief = make_scene("plain.yaml"), {"episodes": 1, "max_episode_steps": 9, "beside": ()}
    assert make_scene(name) == same
    assert gym.make("PassiveWalker-v0", scene=name).unwrapped.scene == same
    assert gym.make_vec("PassiveWalker-v0", num_envs=2, scene=name).scene == same
    assert gpw.evaluate("passive", name, time_limit=0, **brief).scene == same
    assert gpw.gauntlet("passive", name, walkers=1).scene == same
    assert str(gpw.explain(name)) == str(gpw.explain(same))


def test_code_that_a_file_names_needs_trust_in_python_too():
    for call in (make_scene, lambda name: gpw.evaluate("passive", name),
                 lambda name: gym.make("PassiveWalker-v0", scene=name)):  # fmt: skip
        with pytest.raises(
            ValueError, match=r"'mytask:reward' is code .* make_scene\(file, trust=True\)"
        ):
            call("own.yaml")
    with pytest.raises(ValueError, match="is code"):
        make_scene({"reward": "mytask:reward"})
    with pytest.raises(ValueError, match="is code"):
        make_scene("mytask:plain", trust=False)
    assert "mytask" not in sys.modules
    env = gym.make("PassiveWalker-v0", scene="own.yaml", trust=True)
    assert env.unwrapped.scene.reward is sys.modules["mytask"].reward
