"""Scenes say what is simulated, and refuse what cannot be."""

import dataclasses
import json

import pytest

from gym_passive_walker import WALKERS, WalkerError
from gym_passive_walker.envs.scene import SCENES, Scene, SceneError, make_scene


def test_the_default_is_walker_c_on_level_ground_by_ticks():
    scene = make_scene()
    assert scene == make_scene("level") == Scene()
    assert (scene.walker, scene.slope, scene.control) == (WALKERS["C"], 0.0, "tick")


@pytest.mark.parametrize(
    ("control", "torque", "reset_noise_scale"), [("tick", 0.05, 0.10), ("stride", 0.03, 0.05)]
)
def test_torque_and_perturbation_suit_the_control(control, torque, reset_noise_scale):
    scene = Scene(control=control)
    assert (scene.max_hip_torque, scene.reset_noise_scale) == (torque, reset_noise_scale)
    assert Scene(control=control, max_hip_torque=0.01).max_hip_torque == 0.01


@pytest.mark.parametrize("name", WALKERS)
def test_only_walkers_with_knees_stub_their_toes(name):
    assert Scene(walker=name).end_on_toe_stub is WALKERS[name].knees


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_made_of_what_json_can_hold(name):
    described = json.loads(json.dumps(dataclasses.asdict(make_scene(name))))
    assert make_scene(described) == make_scene(name)


def test_arguments_change_a_named_scene():
    scene = make_scene("steep", control="tick")
    assert (scene.slope, scene.control, scene.max_hip_torque) == (0.11, "tick", 0.05)
    assert make_scene(scene, slope=0.1).slope == 0.1
    given = {"control": "tick", "slope": 0.02}
    assert make_scene(given, slope=0.1).slope == 0.1
    assert given == {"control": "tick", "slope": 0.02}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"slope": float("nan")}, "slope must be an angle"),
        ({"slope": (0.05, 0.01)}, "as \\(low, high\\)"),
        ({"slope": (0.0, 0.1, 0.2)}, "slope must be"),
        ({"slope": "steep"}, "slope must be"),
        ({"control": "foot"}, "control must be 'tick' or 'stride'"),
        ({"energy": "none"}, "energy must be"),
        ({"tick": 0.0}, "tick must be a number from"),
        ({"max_hip_torque": -1.0}, "max_hip_torque must be"),
        ({"max_hip_torque": "big"}, "max_hip_torque must be a number"),
        ({"reset_noise_scale": 1.0}, "reset_noise_scale must be"),
        ({"max_stride_time": float("inf")}, "max_stride_time must be"),
        ({"tolerance": 1.0}, "tolerance must be "),
        ({"walker": "A", "end_on_toe_stub": True}, "straight legs always scuff"),
        ({"end_on_toe_stub": 1}, "end_on_toe_stub must be"),
        ({"domain_randomization": {"knee_mass": 0.1}}, "no knee_mass"),
        (
            {"domain_randomization": {"foot_radius": 0.9}},
            "domain_randomization\\['foot_radius'\\] must be",
        ),
        ({"domain_randomization": 0.1}, "domain_randomization must map"),
        ({"start": [0.2, -0.2]}, "start must be 6"),
        ({"gravity": 1.6}, "a scene has no gravity.*; it has walker"),
        ({"pushes": 3}, "pushes must have a rate"),
        ({"pushes": {"rate": 1.0}}, "pushes must have a rate"),
        ({"pushes": {"rate": -1.0, "impulse": 0.1}}, "pushes\\[.rate.\\] must be"),
        ({"pushes": {"rate": 1.0, "impulse": (1, 0)}}, "as \\(low, high\\)"),
        ({"observation_noise": "much"}, "observation_noise must be a number from"),
        ({"observation_noise": (0.1, 0.1)}, "or 8 of them"),
        ({"observation_noise": (0.1,) * 7 + (-1.0,)}, "observation_noise\\[7\\] must be"),
        ({"action_noise": 2.0}, "action_noise must be a number from 0 to 1"),
        ({"action_delay": 0.5}, "action_delay must be a whole number .* \\(of steps\\)"),
        ({"command": 1.5}, "command must be a number from 0 to 1, or a range"),
        ({"command": (0.1, 0.2, 0.3)}, "command must be"),
        ({"command": "fast"}, "command must be"),
        ({"command_weight": -1.0}, "command_weight must be"),
        ({"constraints": "end"}, "constraints must map checks"),
        ({"constraints": {"slipping": "end"}}, "constraints has no slipping"),
        ({"constraints": {"friction": True}}, "must be one of .ignore., .report., .end."),
        ({"friction": -1.0}, "friction must be"),
        ({"scene": "moon"}, "no scene .moon."),
    ],
)
def test_what_is_no_scene_is_refused_in_words(arguments, message):
    with pytest.raises(SceneError, match=message):
        make_scene(**arguments)


@pytest.mark.parametrize(
    ("walker", "message"),
    [
        ("Z", "no walker 'Z'"),
        ({"knee": 1}, "a walker has no knee"),
        ({"thigh_length": 0.5}, "missing 3 required"),
        ({"preset": "C", "gravity": -1.0}, "gravity must be positive"),
    ],
)
def test_what_is_no_walker_is_refused_in_words(walker, message):
    with pytest.raises(WalkerError, match=message):
        make_scene(walker=walker)
