"""Every learner on every task: all scenes of the package, and tasks of one's own."""

import math

import numpy as np
import pytest

import train
from agents import envs
from agents.config import configure
from agents.learner import build
from agents.training import Run
from gym_passive_walker.gaits.scenes.scene import SCENES
from tests.agents.runs import PPO, SAC, short_arena, weights

LEARNERS = ("ppo", "ppo-fast", "sac", "shac")


def upright(step):
    """A reward that has a derivative."""
    return step.distance - step.state.thigh**2 - 0.1 * (step.action[0] - step.last_action[0]) ** 2


def plain(step):
    """One that has none."""
    return math.sin(float(step.distance))


def observe(step):
    """An observation of which one number is not of the state."""
    return [step.state.stance, step.state.thigh, step.time]


def leans(step):
    """A termination."""
    return step.state.stance > 0.5


HERE = "tests.agents.test_tasks"
OWN = {
    "ankle and push-off": {
        "walker": "E", "slope": 0.009, "actions": ("hip", "ankle", "push_off"),
        "observation_noise": 0.01, "action_noise": 0.05, "action_delay": 3,
    },
    "an own reward on rough ground with pushes": {
        "reward": f"{HERE}:upright", "command": (0.1, 0.2), "terrain_lookahead": 1,
        "terrain": {"rough": {"slope_std": 0.01}}, "pushes": {"rate": 0.5, "impulse": 0.01},
        "domain_randomization": {"foot_radius": 0.2},
    },
    "own observations and ends": {
        "observation": f"{HERE}:observe",
        "terminated": f"{HERE}:leans",
        "constraints": {"friction": "end"}, "friction": 0.3,
    },
    "a reward of numbers": {"reward": f"{HERE}:plain", "control": "stride"},
}  # fmt: skip


def tiny(algo, scene, steps=128, **changes):
    """A configuration of two small updates."""
    config = configure(algo, scene, steps=steps, n_envs=8, every=steps, **changes)
    config.hyperparams.update(SAC if algo == "sac" else PPO)
    return config


def learns(algo, config, folder, monkeypatch):
    """Check that a training changes the weights, to finite ones."""
    monkeypatch.setattr(envs, "arena", short_arena)
    run = Run(config, folder)
    before = weights(run.model)
    assert run.train(progress=False)
    after = weights(run.model)
    assert np.isfinite(after).all() and (after != before).any()
    return run


@pytest.mark.parametrize("algo", LEARNERS)
@pytest.mark.parametrize("scene", SCENES)
def test_every_learner_trains_every_scene(scene, algo, tmp_path, monkeypatch):
    learns(algo, tiny(algo, scene), tmp_path, monkeypatch)


@pytest.mark.filterwarnings("ignore:reward cannot be compiled")
@pytest.mark.parametrize("algo", LEARNERS)
@pytest.mark.parametrize("name", OWN)
def test_every_learner_trains_tasks_of_ones_own(name, algo, tmp_path, monkeypatch):
    control = OWN[name].get("control", "tick")
    learns(algo, tiny(algo, "level", env=OWN[name] | {"control": control}), tmp_path, monkeypatch)


def test_a_system_is_trained_by_its_derivatives(tmp_path, monkeypatch):
    config = tiny("shac", "examples.five_links:downhill")
    run = learns("shac", config, tmp_path, monkeypatch)
    assert run.left_out == []


def test_a_training_by_gradients_says_what_it_leaves_out(tmp_path, capsys):
    (tmp_path / "task.yaml").write_text("command: 0.15\nconstraints: {friction: end}\n")
    words = ["--scene", str(tmp_path / "task.yaml"), "--steps", "64", "--envs", "2", "--quiet"]
    for algo, count in (("shac", 2), ("ppo", 0)):
        assert train.main([*words, "--algo", algo, "--out", str(tmp_path / algo)]) == 0
        said = capsys.readouterr().out
        assert said.count("Left out: ") == count
    model = build(configure("shac", "rough", n_envs=2), envs.training_envs(tiny("shac", "rough")))
    assert list(model.env.recorder.left_out) == []
