"""Scenes say what is simulated, and refuse what cannot be."""

import dataclasses
import json
import re

import gymnasium
import numpy as np
import pytest

from gym_passive_walker import WALKERS, WalkerError
from gym_passive_walker._tools.arguments import shown
from gym_passive_walker.gaits.scenes.scene import (
    CALM,
    SCENES,
    UNDISTURBED,
    Scene,
    SceneError,
    kept_argument,
    make_scene,
    undisturbed,
)
from gym_passive_walker.models.walkers import PARAMETERS, as_walker
from tests.own.statements import DRIVEN


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
        ({"slope": "steep"}, "slope must be"),
        ({"max_hip_torque": "big"}, "max_hip_torque must be a number"),
        ({"tolerance": 1.0}, "tolerance must be "),
        ({"walker": "A", "end_on_toe_stub": True}, "straight legs always scuff"),
        ({"end_on_toe_stub": 1}, "end_on_toe_stub must be"),
        ({"domain_randomization": {"knee_mass": 0.1}}, "no knee_mass"),
        ({"domain_randomization": 0.1}, "domain_randomization must map"),
        ({"observe_body": ("gravity",)}, "observe_body must be some of"),
        ({"gravity": 1.6}, "a scene has no gravity.*; it has walker"),
        ({"action_delay": 0.5}, "action_delay must be a whole number .* \\(of steps\\)"),
        ({"command": (0.1, 0.2, 0.3)}, "command must be"),
        ({"command": "fast"}, "command must be"),
        ({"reward": {"command": -1.0}}, "weight of 'command', and this scene commands no speed"),
        ({"reward": {"push_off_work": -1.0}}, "'push_off_work', and no action of this scene"),
        ({"constraints": "end"}, "constraints must map checks"),
        ({"constraints": {"slipping": "end"}}, "constraints has no slipping"),
        ({"constraints": {"friction": True}}, "must be one of .ignore., .report., .end."),
        ({"scene": "moon"}, "no scene .moon."),
        ({"terrain": "hills"}, "terrain has no hills"),
        ({"terrain": 0.01}, "a terrain is a Terrain"),
        ({"terrain": {"hills": {}}}, "hills"),
        ({"terrain": {"rough": {"height_std": -1.0}}}, "height_std"),
        ({"terrain": "rough"}, "rough ground needs height_std in leg lengths, slope_std in rad"),
        ({"terrain": {"rough": {}}}, "rough ground needs height_std"),
        ({"terrain": {"rough": {"height_std": None}}}, "rough ground needs height_std"),
        ({"terrain": {"footholds": {}}}, "footholds need heights in leg lengths, slopes in rad"),
        ({"terrain": {"footholds": {"heights": []}}}, "at least one"),
        ({"terrain": {"stairs": {}}}, "rise"),
        ({"terrain": {"waves": {"height": 0.1}}}, "strides"),
        ({"terrain": {}}, "a mapping of one of rough, stairs, waves and"),
        ({"terrain": "rough:slope_std=0.1,slope_std=0.2"}, "'slope_std' is given twice"),
        ({"reward": {}}, "reward must have weights"),
    ],
)
def test_what_is_no_scene_is_refused_in_words(arguments, message):
    with pytest.raises(SceneError, match=message):
        make_scene(**arguments)


TAKING = {
    "make": lambda **given: gymnasium.make("PassiveWalker-v0", **given),
    "make_vec": lambda **given: gymnasium.make_vec("PassiveWalker-v0", num_envs=2, **given),
    "set_scene": lambda **given: gymnasium.make("PassiveWalker-v0").unwrapped.set_scene(**given),
    "make_scene": make_scene,
}


@pytest.mark.parametrize("of", TAKING)
def test_an_unknown_argument_is_refused_in_the_words_by_which_libraries_drop_it(of):
    given = {"slop": 0.1, "frameskip": 1}
    with pytest.raises(SceneError, match=r"a scene has no slop \(slope\?\), frameskip;") as refused:
        TAKING[of](**given)
    assert isinstance(refused.value, TypeError)
    for name in given:
        assert f"unexpected keyword argument '{name}'" in str(refused.value)


def test_an_unknown_entry_of_a_mapping_is_no_argument():
    with pytest.raises(SceneError, match=r"^a scene has no frameskip;") as refused:
        make_scene({"frameskip": 4})
    assert not isinstance(refused.value, TypeError)


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


LIMITS = {
    "tick": (1e-3, 1e3),
    "max_hip_torque": (0.0, 1e3),
    "max_ankle_torque": (0.0, 1e3),
    "max_push_off": (0.0, 1e3),
    "energy_weight": (0.0, 1e6),
    "reset_noise_scale": (0.0, 0.9),
    "max_stride_time": (0.1, 1e3),
    "observation_noise": (0.0, 10.0),
    "action_noise": (0.0, 1.0),
    "command": (0.0, 1.0),
    "command_weight": (0.0, 1e3),
    "friction": (0.0, 1e3),
    "knee_latch": (0.0, 1e3),
    "scuff_depth": (0.0, 1.0),
}
"""Smallest and largest value of each argument that is a real number."""


@pytest.mark.parametrize("name", LIMITS)
def test_a_number_is_valid_up_to_its_limits_and_not_beyond(name):
    low, high = LIMITS[name]
    for value in (low, 0.5 * (low + high), high):
        assert getattr(Scene(**{name: value}), name) == value
        assert isinstance(getattr(Scene(**{name: np.float32(1.0) * high}), name), float)
    said = f"^{name} must be a number from {low:g} to " + re.escape(f"{high:g}")
    for value in (np.nextafter(low, -9.0), np.nextafter(high, 9e9), np.nan, np.inf, True, [high]):
        if name == "command" and value == [high]:
            continue  # a range
        if name == "observation_noise" and value == [high]:
            continue  # one for each entry
        with pytest.raises(SceneError, match=f"{said}.*not {re.escape(shown(value))}"):
            Scene(**{name: value})


@pytest.mark.parametrize("name", ["control", "energy"])
def test_one_of_several_names_is_required(name):
    for value in {"control": ("tick", "stride"), "energy": ("absolute", "positive", "net")}[name]:
        assert getattr(Scene(**{name: value}), name) == value
        with pytest.raises(SceneError, match=f"^{name} must be .*{value}.*not 'other'"):
            Scene(**{name: "other"})


@pytest.mark.parametrize(
    ("name", "low", "high", "more"),
    [
        ("randomization_pool", 1, 2**31, {"domain_randomization": {"foot_radius": 0.1}}),
        ("terrain_lookahead", 0, 1000, {"terrain": {"rough": {"height_std": 0.01}}}),
        ("action_delay", 0, 10_000, {}),
    ],
)
def test_a_whole_number_is_valid_up_to_its_limits_and_not_beyond(name, low, high, more):
    for value in (low, np.int64(high)):
        found = getattr(Scene(**{name: value}, **more), name)
        assert found == value and type(found) is int
    for value in (low - 1, high + 1, 1.5, True):
        with pytest.raises(SceneError, match=f"^{name} must be .*not {value}"):
            Scene(**{name: value}, **more)


def test_slopes_are_angles_or_ranges_and_equal_bounds_remain_a_range():
    steepest = np.nextafter(np.pi / 2, 0.0)
    for value in (0.0, -steepest, steepest):
        assert Scene(slope=value).slope == value and isinstance(Scene(slope=value).slope, float)
    assert Scene(slope=[-0.1, 0.2]).slope == (-0.1, 0.2)
    assert Scene(slope=np.array([0.1, 0.1])).slope == (0.1, 0.1)
    for value in (np.pi / 2, -np.pi / 2, (0.0, 2.0), (-2.0, 0.0), (0.1, 0.0), (), [[0.1, 0.2]]):
        with pytest.raises(SceneError, match=f"slope must .*not {re.escape(shown(value))}"):
            Scene(slope=value)


def test_commands_are_speeds_or_ranges_and_equal_bounds_are_one_speed():
    assert Scene(command=(0.1, 0.2)).command == (0.1, 0.2)
    assert Scene(command=[0.1, 0.1]).command == 0.1 == Scene(command=[0.1]).command
    assert Scene().command is None and Scene(command=0).command == 0.0
    for value in ((0.2, 0.1), (0.0, 1.1), (-0.1, 0.5), ()):
        with pytest.raises(SceneError, match=f"command must .*not {re.escape(shown(value))}"):
            Scene(command=value)


def test_pushes_have_a_rate_and_a_range_within_limits():
    for rate, impulse in ((0.0, (-10.0, 10.0)), (100.0, (0.0, 0.0))):
        found = Scene(pushes={"impulse": impulse, "rate": rate}).pushes
        assert found == {"rate": rate, "impulse": impulse}
    assert Scene(pushes={"rate": 1, "impulse": -2}).pushes["impulse"] == (-2.0, -2.0)
    assert Scene(pushes={}).pushes == {} == Scene(pushes=None).pushes
    for rate in (-1e-9, 100.1, "1", None):
        with pytest.raises(SceneError, match=r"^pushes\['rate'\] must be a number from 0 to 100,"):
            Scene(pushes={"rate": rate, "impulse": 0.1})
    for impulse in (10.1, (-10.1, 0.0), (0.1, -0.1), (0.0, 0.1, 0.2), "hard", None):
        with pytest.raises(SceneError, match=r"^pushes\['impulse'\] must be .* from -10 to 10, or"):
            Scene(pushes={"rate": 0.1, "impulse": impulse})
    for more in ({"rate": 1, "impulse": 0, "when": 2}, {"impulse": 0.1}, {"rate": 1}, [], 3):
        with pytest.raises(SceneError, match=r"^pushes must have a rate"):
            Scene(pushes=more)


def test_terrain_of_given_zeros_is_smooth():
    for ground in ({"rough": {"height_std": 0}}, "footholds:slopes=[0]", "stairs:rise=0"):
        assert make_scene(terrain=ground).terrain.smooth


def test_noise_of_each_entry_is_checked_by_its_index():
    assert Scene(observation_noise=range(8)).observation_noise == tuple(map(float, range(8)))
    for i in range(8):
        noise = [0.1] * 8
        noise[i] = 10.01
        with pytest.raises(SceneError, match=rf"^observation_noise\[{i}\] must .*not 10.01"):
            Scene(observation_noise=noise)
    for size in (0, 7, 9):
        with pytest.raises(SceneError, match="or 8 of them"):
            Scene(observation_noise=[0.1] * size)


def test_shares_of_every_parameter_are_kept_in_order_of_their_names():
    kneed = as_walker("lab").with_body({"hip_mass": 0.5, "hip_friction": 1e-3})
    for name in PARAMETERS:
        assert Scene(domain_randomization={name: 0.0}).domain_randomization == {name: 0.0}
        for share in (-1e-9, 0.51, None):
            said = (
                rf"^domain_randomization\['{name}'\] must be a number from 0 to 0.5.*; not {share}"
            )
            with pytest.raises(SceneError, match=said):
                Scene(domain_randomization={name: share})
    acting = sorted(name for name, value in kneed.parameters.items() if value and name != "gravity")
    shares = {name: 0.01 * i for i, name in enumerate(reversed(acting))}
    found = Scene(walker=kneed, domain_randomization=shares).domain_randomization
    assert list(found) == sorted(shares) and found == shares and len(found) > 7
    assert Scene(domain_randomization={}).domain_randomization == {}
    with pytest.raises(SceneError, match=r"randomization_pool is .*: give both"):
        Scene(randomization_pool=2)


def test_names_in_a_row_are_allowed_names_each_once():
    assert Scene(observe_body="hip_mass").observe_body == ("hip_mass",)
    assert Scene(observe_body=[]).observe_body == ()
    assert Scene(actions=["push_off", "hip"]).actions == ("push_off", "hip")
    assert Scene(actions="push_off").actions == ("push_off",)
    assert Scene(walker="E", actions=["ankle"]).actions == ("ankle",)
    for name, given in (
        ("observe_body", ["foot_radius", "foot_radius"]),
        ("observe_body", ["knees"]),
        ("observe_body", 3),
        ("actions", ["hip", "hip"]),
        ("actions", []),
        ("actions", ["knee"]),
    ):
        with pytest.raises(SceneError, match=f"^{name} must be some of '.*, each once, not "):
            Scene(**{name: given})
    with pytest.raises(SceneError, match="the action 'ankle' needs point feet"):
        Scene(walker="C", actions=["hip", "ankle"])


def test_constraints_are_kept_by_severity_without_ignored_ones():
    every = {"scuffing": "report", "friction": "ignore", "knee lock": "end", "contact": "end"}
    found = Scene(constraints=every).constraints
    assert list(found.items()) == [("contact", "end"), ("knee lock", "end"), ("scuffing", "report")]
    assert Scene(constraints={}).constraints == {}
    assert Scene(walker="A", constraints={"knee lock": "ignore"}).constraints == {}
    for answer in ("report", "end"):
        with pytest.raises(SceneError, match="'knee lock' is a check of walkers with knees"):
            Scene(walker="A", constraints={"knee lock": answer})


def test_starts_are_six_numbers():
    assert Scene(start=np.arange(6)).start == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert Scene().start is None
    for start in ([0.1] * 5, [0.1] * 7, [0.1] * 5 + [np.nan], [[0.1] * 6], "here"):
        with pytest.raises(SceneError, match=f"start must be 6 .*not {re.escape(shown(start))}"):
            Scene(start=start)


def test_lookahead_needs_a_terrain():
    with pytest.raises(SceneError, match="terrain_lookahead shows footholds of a terrain"):
        Scene(terrain_lookahead=1)


@pytest.mark.parametrize(
    ("given", "name", "none"),
    [
        ({"observe_body": "foot_radius"}, "observe_body", ()),
        ({"observation_noise": 0.1}, "observation_noise", 0.0),
        ({"scene": "rough"}, "terrain_lookahead", 0),
    ],
)
def test_an_observation_of_one_s_own_refuses_changes_of_the_default_one(given, name, none):
    said = re.escape(f"leave out observation, or choose {name}={none!r}")
    with pytest.raises(SceneError, match=said):
        make_scene(**given, observation=elapsed)
    make_scene(**given | {name: none}, observation=elapsed)
    make_scene(**given, observation={"policy": elapsed, "critic": "default"})


def elapsed(step):
    """Time of the episode."""
    return step.time


@pytest.mark.parametrize("term", ["energy", "command"])
def test_weights_of_a_reward_leave_no_second_weight(term):
    with pytest.raises(SceneError, match=f"give the weight of '{term}' there"):
        Scene(reward={"distance": 1.0}, **{f"{term}_weight": 5.0})
    with pytest.raises(SceneError, match="energy_weight=5 has no effect"):
        gymnasium.make("PassiveWalkerEasy-v0", energy_weight=5.0)
    assert Scene(reward=lambda step: step.distance, energy_weight=5.0).energy_weight == 5.0


@pytest.mark.parametrize(
    ("tick", "gravity", "frames"), [(0.1, 1.0, 10), (0.1, 9.0, 30), (50.0, 1.0, 1), (0.3, 1.0, 3)]
)
def test_frames_per_second_are_control_steps_in_the_walkers_time(tick, gravity, frames):
    walker = {"preset": "C", "gravity": gravity * WALKERS["C"].leg_length}
    assert Scene(walker=walker, tick=tick).frames_per_second == frames
    assert Scene(walker=walker, tick=tick, control="stride").frames_per_second == 2


def test_a_disturbed_scene_is_refused_with_the_change_that_calms_it():
    other = {
        "pushes": {"rate": 1.0, "impulse": 0.1},
        "observation_noise": 0.1,
        "action_noise": 0.1,
        "action_delay": 1,
        "constraints": {"friction": "report"},
        "terrain": {"rough": {"height_std": 0.01}},
        "command": 0.1,
    }
    assert {*CALM} == {*other, "terrain_lookahead"}
    for name, value in other.items():
        with pytest.raises(SceneError, match=f"^It walks without {name}, .*{name}=") as caught:
            undisturbed(make_scene(**{name: value}), "It walks")
        assert str(caught.value).endswith(f"{name}={CALM[name]!r})")
        calm = make_scene("level", **{name: value})
        assert undisturbed(make_scene(calm, **CALM), "It walks") == make_scene()
    commanded = make_scene(command=0.1)
    assert undisturbed(commanded, "It walks", UNDISTURBED) is commanded
    with pytest.raises(SceneError, match="without action_noise and action_delay, which"):
        undisturbed(make_scene(action_noise=0.1, action_delay=2), "It walks")


def test_walkers_and_terrains_are_kept_by_their_content(tmp_path):
    walker = dataclasses.replace(WALKERS["C"], foot_radius=0.17)
    kept = kept_argument("walker", walker)
    assert make_scene(walker=json.loads(json.dumps(kept))).walker == walker
    assert "title" not in kept
    titled = json.loads(json.dumps(kept_argument("walker", walker.titled("mine"))))
    assert make_scene(walker=titled).walker.title == "mine"
    terrain = make_scene("rough").terrain
    kept = kept_argument("terrain", terrain)
    assert make_scene(terrain=json.loads(json.dumps(kept))).terrain == terrain
    for name, given in (("walker", walker), ("terrain", terrain)):
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps(kept_argument(name, given)))
        content = kept_argument(name, str(path))
        path.unlink()
        assert getattr(make_scene(**{name: content}), name) == given
    for name, given in (("walker", "C"), ("terrain", None), ("slope", 0.1), ("start", (1, 2))):
        assert kept_argument(name, given) is given


def test_a_system_is_another_name_of_the_walker():
    for scene, changes in (
        ({"walker": "C", "system": DRIVEN}, {}),
        ({}, {"walker": "C", "system": DRIVEN}),
    ):
        with pytest.raises(SceneError, match="give a scene a walker or a system, not both"):
            make_scene(scene, **changes)
    assert make_scene(system=DRIVEN).walker is DRIVEN is make_scene({"system": DRIVEN}).walker
    straight = make_scene(end_on_toe_stub=False)
    assert make_scene(straight, system=DRIVEN).walker is DRIVEN
    assert make_scene(make_scene(system=DRIVEN), walker="C").walker == WALKERS["C"]
    with pytest.raises(SceneError, match=r"system must be a gpw.System, not 'C'"):
        make_scene(system="C")
    with pytest.raises(SceneError, match="is no scene: give its arguments"):
        make_scene(DRIVEN)
    for name, value, said in (
        ("constraints", {"knee lock": "end"}, "is a check of walkers with knees"),
        ("observe_body", "foot_radius", "must be some of 'hip', 'leg'"),
    ):
        with pytest.raises(SceneError, match=said):
            make_scene(system=DRIVEN, **{name: value})
