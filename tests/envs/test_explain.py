"""What is said of a scene is what its environment does; scenes of environments change."""

import dataclasses
import re

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

import gym_passive_walker as gpw
from gym_passive_walker.envs.explain import as_rows, as_text
from gym_passive_walker.envs.interface import OUTCOMES, REASONS
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.checks import SceneError
from gym_passive_walker.gaits.scenes.rewards import ABOUT_TERMS
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, make_scene
from tests.own.statements import DRIVEN

WEIGHTS = {"distance": 1.0, "alive": 0.1, "action": -0.2}


def far(step):
    return step.distance > 10.0


@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_is_explained_as_its_spaces_are(scene):
    env, found = gymnasium.make(ID, scene=scene), as_rows(scene)
    seen, acts = found["observation"], found["action"]
    np.testing.assert_array_equal([row["min"] for row in seen], env.observation_space.low)
    np.testing.assert_array_equal([row["max"] for row in seen], env.observation_space.high)
    np.testing.assert_array_equal([row["min"] for row in acts], env.action_space.low)
    assert as_rows(env) == found == as_rows(make_scene(scene)) == as_rows(SCENES[scene] | {})
    for rows in found.values():
        for row in rows:
            assert all(str(cell) in as_text(scene) for cell in row.values() if cell == str(cell))


@pytest.mark.parametrize("make", [PassiveWalkerVectorEnv, PassiveWalkerVecEnv])
def test_what_is_seen_and_paid_now_is_part_of_it(make):
    env = make(3, "commanded", reward_terms=True)
    assert "now" not in as_rows(env)["observation"][0]
    env.reset()
    observations, rewards, *_ = env.step(np.full((3, 1), 0.3))
    found = as_rows(env)
    np.testing.assert_allclose([row["now"] for row in found["observation"]], observations[0])
    assert sum(row["last"] for row in found["reward"]) == pytest.approx(rewards[0])


def test_explain_prints_the_tables(capsys):
    gpw.explain(make_scene(reward=WEIGHTS, terminated=far, constraints={"friction": "end"}))
    said = capsys.readouterr().out
    assert re.search(r"action +-0.2 times sum of the squares of the actions", said)
    assert re.search(r"stopped +far holds", said) and re.search(r"slipped .* 0.8 ", said)
    assert re.search(r"4000 steps +truncated", said)
    gpw.explain(make_scene(observation=lambda step: (step.time, step.slope)))
    assert re.findall(r"<lambda>\[(\d)\]", capsys.readouterr().out) == ["0", "1"]


def test_every_outcome_that_ends_an_episode_is_explained():
    rules = dict.fromkeys(("contact", "friction", "knee lock", "scuffing"), "end")
    rows = as_rows(make_scene(constraints=rules, terminated=far))["episode end"]
    reported = {row["outcome"] for row in rows if row["outcome"]}
    assert reported == {*OUTCOMES} - {"", "heelstrike", "kneestrike", "time_limit"}


def test_what_is_no_environment_of_this_package_is_refused():
    with pytest.raises(TypeError, match="explain takes an environment of this package or a scene"):
        gpw.explain(gymnasium.make("CartPole-v1"))
    with pytest.raises(SceneError, match="no scene"):
        gpw.explain("moon")


def test_the_terms_of_a_reward_are_in_info_on_request():
    stairs = {"terrain": "stairs:rise=-0.001", "energy_weight": 3.0}
    for scene in ({}, {"command": 0.15}, {"reward": WEIGHTS}, stairs):
        env = gymnasium.make(ID, reward_terms=True, **scene)
        env.reset(seed=0)
        for _ in range(30):
            _, reward, _, _, info = env.step(np.array([0.2], np.float32))
            terms = {name: x for name, x in info.items() if name.startswith("reward_")}
            assert sum(terms.values()) == pytest.approx(reward, abs=1e-15)
            own = env.unwrapped.reward_terms
            assert terms == {f"reward_{name}": x for name, x in own.items()}
    with pytest.raises(SceneError, match="reward_terms must be True or False"):
        make_scene(reward_terms=1)


def test_a_changed_scene_is_the_one_of_the_next_episode():
    env, fresh = (gymnasium.make(ID, **of).unwrapped for of in ({}, {"slope": 0.03}))
    env.reset(seed=3)
    env.step(np.zeros(1, np.float32))
    env.set_scene(slope=0.03)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(1, np.float32))
    for one in (env, fresh):
        one.reset(seed=4)
    for action in np.random.default_rng(0).uniform(-0.1, 0.1, (20, 1)):
        for found, expected in zip(env.step(action), fresh.step(action), strict=True):
            np.testing.assert_equal(found, expected)
    with pytest.raises(SceneError, match="cannot change"):
        env.set_scene(command=0.1)
    assert env.scene.slope == 0.03 and env.step(np.zeros(1))[1] != 0.0


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_the_walkers_of_a_vector_environment_go_over_to_a_changed_scene_together(mode):
    env = PassiveWalkerVectorEnv(4, autoreset_mode=mode, slope=0.02, max_episode_steps=500)
    fresh = PassiveWalkerVectorEnv(4, autoreset_mode=mode, slope=0.04, max_episode_steps=500)
    env.reset(seed=0)
    for _ in range(200):  # until some walkers, not all, have just ended
        _, _, terminated, truncated, _ = env.step(np.tile([[0.9], [0.0]], (2, 1)))
        if (terminated | truncated).any():
            break
    assert not terminated.all()
    env.set_scene(slope=0.03)
    env.set_scene(slope=0.04)
    assert env.scene.slope == 0.02
    if mode == "Disabled":
        with pytest.raises(gymnasium.error.ResetNeeded, match="reset all"):
            env.reset(options={"reset_mask": terminated})
    else:
        observations, _, terminated, truncated, _ = env.step(np.zeros((4, 1)))
        assert truncated.all() and not terminated.any()
        if mode == "NextStep":
            assert not np.allclose(observations[:, 7], 0.04)
            observations, rewards, terminated, truncated, _ = env.step(np.ones((4, 1)))
            assert not (rewards.any() or terminated.any() or truncated.any())
        np.testing.assert_allclose(observations[:, 7], 0.04)
    assert env.scene.slope == (0.04 if mode != "Disabled" else 0.02)
    for one in (env, fresh):
        one.reset(seed=5)
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (60, 4, 1)):
        (*found, _), (*expected, _) = env.step(actions), fresh.step(actions)
        for part, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(part, other)
        if mode == "Disabled" and (found[2] | found[3]).any():
            break
    assert env.scene.slope == 0.04
    assert env.get_state()["scene"] == fresh.get_state()["scene"]


def test_episodes_of_a_changed_scene_are_truncated_after_the_same_number_of_steps():
    envs = PassiveWalkerVectorEnv(2, max_episode_steps=5, autoreset_mode="SameStep")
    envs.reset(seed=0)
    envs.set_scene(energy_weight=2.0)
    truncated = [envs.step(np.zeros((2, 1)))[3].tolist() for _ in range(11)]
    ends = [True, False, False, False, False, True, False, False, False, False, True]
    assert truncated == [[end] * 2 for end in ends]


def test_learners_of_stable_baselines3_go_over_to_a_changed_scene():
    env = PassiveWalkerVecEnv(3, "pushed", seed=0)
    env.reset()
    env.env_method("set_scene", energy_weight=2.0)
    *_, dones, infos = env.step(np.zeros((3, 1)))
    assert dones.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert env.scene.energy_weight == 2.0 == env.get_attr("scene")[0].energy_weight
    *_, dones, _ = env.step(np.zeros((3, 1)))
    assert not dones.any()


def test_footholds_ahead_are_numbered_from_the_next_one():
    names = [row["observation"] for row in as_rows(make_scene("rough"))["observation"]]
    ahead = [name for name in names if "foothold" in name]
    assert [int(re.search(r"foothold (\d+) ahead", name)[1]) for name in ahead] == [1, 2]


MANY = {
    "slope": (0.01, 0.03), "tick": 0.25, "actions": ("push_off", "hip"), "max_push_off": 0.11,
    "max_hip_torque": 0.07, "energy": "net", "energy_weight": 4.0, "max_stride_time": 12.5,
    "command": (0.1, 0.15), "command_weight": 3.0, "terrain": {"rough": {"height_std": 0.01}},
    "terrain_lookahead": 2, "observe_body": ("hip_mass", "foot_radius"), "friction": 0.6,
    "knee_latch": 0.3, "scuff_depth": 0.02, "terminated": far,
    "constraints": dict.fromkeys(("contact", "friction", "knee lock", "scuffing"), "end"),
}  # fmt: skip
"""A scene with another value of each number that the tables name."""


@pytest.mark.parametrize(
    ("table", "key", "of", "value"),
    [
        ("action", "action 1 is", "push-off impulse at the next heelstrike", "0.11 m sqrt(g l)"),
        ("action", "action 1 is", "hip torque, positive swings the free leg forward", "0.07 m g l"),
        ("reward", "what", "energy", "-4 times the net work of the actuators / (m g l)"),
        ("reward", "what", "command", "-3 times | step length - command * step period | / l"),
        ("episode end", "when", "stalled", "no heelstrike within 12.5 sqrt(l/g)"),
        ("episode end", "when", "lost_contact", "the ground would have to pull at the foot"),
        ("episode end", "when", "slipped", "the foot needs more friction than 0.6"),
        ("episode end", "when", "stance_knee_gave_way", "more than 0.3 m g l"),
        ("episode end", "when", "scuffed", "the swing foot is more than 0.02 l below the ground"),
        ("episode end", "when", "stopped", "far holds"),
    ],
)
def test_the_tables_have_the_scene_s_own_numbers(table, key, of, value):
    rows = {next(v for k, v in row.items() if k != "number"): row for row in as_rows(MANY)[table]}
    assert value in rows[of][key]
    for name in ("push_off", "hip"):
        assert f"{make_scene(MANY).largest(name):g} " in as_text(MANY)


def test_rows_come_in_the_order_of_the_numbers():
    found = as_rows(MANY)
    seen = [row["observation"] for row in found["observation"]]
    for rows in (found["observation"], found["action"]):
        assert [row["number"] for row in rows] == [*range(len(rows))]
    assert seen[6:9] == ["knee locked", "slope, positive downhill", "commanded speed"]
    assert seen[-2:] == ["the walker's hip_mass", "the walker's foot_radius"]
    assert [row["min"] for row in found["action"]] == [0.0, -1.0]
    assert [row["term"] for row in found["reward"]] == ["distance", "energy", "command"]
    kinds = [(row["outcome"] == "", row["kind"]) for row in found["episode end"]]
    assert kinds == [(False, "terminated")] * (len(kinds) - 1) + [(True, "truncated")]


def test_each_number_of_an_observation_has_its_name_and_unit():
    env = gymnasium.make(ID, scene="lab", actions=("hip", "push_off"))
    env.reset(seed=3, options={"state": [0.2, -0.15, -0.3, -1.2, -0.5, -0.9], "slope": 0.03})
    unit = env.unwrapped.walker.time_unit
    expected = {
        "stance leg angle": (0.2, "rad"),
        "swing thigh angle": (-0.15, "rad"),
        "swing shank angle": (-0.3, "rad"),
        "stance leg angular velocity": (-1.2 * unit, "sqrt(g/l)"),
        "swing thigh angular velocity": (-0.5 * unit, "sqrt(g/l)"),
        "swing shank angular velocity": (-0.9 * unit, "sqrt(g/l)"),
        "knee locked": (0.0, "1 or 0"),
        "slope, positive downhill": (0.03, "rad"),
    }
    rows = as_rows(env)["observation"]
    assert [row["observation"] for row in rows] == [*expected]
    for row, (value, of) in zip(rows, expected.values(), strict=True):
        assert row["now"] == pytest.approx(value, rel=1e-6) and row["unit"] == of


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ({}, "an action is chosen every 0.1 sqrt(l/g) and after a heelstrike."),
        ({"tick": 0.25}, "an action is chosen every 0.25 sqrt(l/g) and after a heelstrike."),
        ({"control": "stride"}, "an action is chosen only after a heelstrike."),
        ({"slope": 0.036}, "slope 0.036 rad;"),
        ({"slope": (0.01, 0.03)}, "slope 0.01 to 0.03 rad;"),
        ({"walker": "lab"}, "walker 'lab', slope 0 rad"),
    ],
)
def test_the_first_line_has_walker_slope_and_control_step(scene, said):
    assert said in as_text(scene).splitlines()[0]


def test_the_columns_of_a_table_are_aligned():
    lines = as_text(MANY).splitlines()
    for title, rows in as_rows(MANY).items():
        first = lines.index(title) + 1
        heads = lines[first]
        places = [heads.index(f" {head}") for head in list(rows[0])[1:]]
        for line, row in zip(lines[first + 1 :], rows, strict=False):
            for place, value in zip(places, list(row.values())[1:], strict=True):
                cell = f"{value:.4g}" if isinstance(value, float) else str(value)
                assert line[place + 1 :].startswith(cell)


@pytest.mark.parametrize("weights", [{"fell": -2.0}, {"action": 0.5, "alive": 1.5}])
def test_weights_of_a_reward_are_explained_by_their_terms(weights):
    rows = as_rows(make_scene(reward=weights))["reward"]
    found = {row["term"]: row["what"] for row in rows}
    assert found == {name: f"{w:g} times {ABOUT_TERMS[name]}" for name, w in weights.items()}
    (row,) = as_rows(make_scene(reward=far))["reward"]
    assert row == {"term": "function", "what": "result of far"}


def test_outcomes_are_those_that_the_walker_can_come_to():
    def outcomes(**scene):
        return [row["outcome"] for row in as_rows(scene)["episode end"]]

    assert {"knee_not_locked", "stubbed_toe"} <= {*outcomes()}
    assert "stubbed_toe" not in outcomes(end_on_toe_stub=False)
    for walker in ("A", "D"):
        assert not {"knee_not_locked", "stubbed_toe"} & {*outcomes(walker=walker)}
    assert not {*REASONS.values()} & {*outcomes(constraints=dict.fromkeys(REASONS, "report"))}
    for check, reason in REASONS.items():
        assert {*REASONS.values()} & {*outcomes(constraints={check: "end"})} == {reason}


def test_an_environment_of_a_system_is_explained_by_its_own_names():
    env = gymnasium.make(ID, system=DRIVEN, start=(0.2, -0.2, -0.2, -0.1), max_hip_torque=0.03)
    env.reset(seed=0)
    found, text = as_rows(env), as_text(env)
    names = [row["observation"] for row in found["observation"]]
    assert names == [*DRIVEN.State._fields, "slope, positive downhill"]
    largest = env.unwrapped.scene.largest("hip")
    assert found["action"][0]["action"] == "control 'hip'"
    assert found["action"][0]["action 1 is"] == f"{largest:g}"
    outcomes = [row["outcome"] for row in found["episode end"] if row["outcome"]]
    assert outcomes == [*DRIVEN.falls, "stalled", "diverged"]
    assert text.startswith("system 'compass', ") and "those of the system" in text
    now = [row["now"] for row in found["observation"]]
    np.testing.assert_allclose(now[:4], env.unwrapped.state, rtol=1e-6)


@pytest.mark.parametrize(("limit", "said"), [(7, "7 steps"), (None, None)])
def test_the_limit_of_an_environment_is_its_own(limit, said):
    made = {"max_episode_steps": limit}
    envs = [PassiveWalkerVectorEnv(2, **made), PassiveWalkerVecEnv(2, **made)]
    envs += [gymnasium.make(ID, **made)] * (limit is not None)
    envs += [gymnasium.make(ID).unwrapped.__class__()] * (limit is None)
    for env in envs:
        last = as_rows(env)["episode end"][-1]
        assert (last["when"] if last["kind"] == "truncated" else None) == said


def test_of_several_walkers_the_first_one_is_shown():
    env = PassiveWalkerVectorEnv(3, "lab", walkers=["lab", "C", "C"], slopes=[0.01, 0.02, 0.03])
    env.reset(seed=0)
    _, rewards, *_ = env.step(np.array([[0.9], [0.1], [0.5]]))
    found = as_rows(env)
    assert found["observation"][7]["now"] == pytest.approx(0.01)
    assert sum(row["last"] for row in found["reward"]) == pytest.approx(rewards[0], abs=1e-12)
    assert as_text(env).startswith("walker 'lab', slope 0.01 rad")
    given = {"walkers": ["C", "lab"], "domain_randomization": {"foot_radius": 0.1}}
    radius = as_rows(PassiveWalkerVectorEnv(2, "lab", walker="lab", **given))[
        "domain randomization"
    ]
    assert radius[0]["scene"] == gpw.WALKERS["C"].foot_radius


@pytest.mark.parametrize("make", [
    lambda: gymnasium.make(ID), lambda: PassiveWalkerVecEnv(2),
    lambda: gymnasium.make_vec(ID, 2, vectorization_mode="sync"),
    lambda: gymnasium.make_vec(ID, 2, max_episode_steps=-1),
])  # fmt: skip
def test_the_reward_is_explained_with_the_work_that_it_charges_now(make):
    env = make()
    assert "-10 times the absolute work" in as_text(env)
    for each in getattr(env, "envs", [env]) if isinstance(env, SyncVectorEnv) else [env]:
        getattr(each, "unwrapped", each).set_energy_cost("net")
    assert "-10 times the net work" in as_text(env)


def test_a_batch_without_a_limit_has_none_whatever_its_registration_says():
    env = gymnasium.make_vec(ID, 2, max_episode_steps=-1)
    assert as_rows(env)["episode end"][-1]["kind"] == "terminated"


CHANGED = {
    "walker": ({"walker": "lab"}, "walker 'lab'"),
    "slope": ({"slope": (0.0123456, 0.03)}, "(0.0123456, 0.03)"),
    "control": ({"control": "stride"}, "'stride'"),
    "tick": ({"tick": 0.2}, "0.2"),
    "actions": ({"actions": ("push_off", "hip")}, "('push_off', 'hip')"),
    "max_hip_torque": ({"max_hip_torque": 0.01}, "0.01"),
    "max_ankle_torque": ({"max_ankle_torque": 0.01}, "0.01"),
    "max_push_off": ({"max_push_off": 0.3}, "0.3"),
    "energy_weight": ({"energy_weight": 5.0}, "5.0"),
    "energy": ({"energy": "net"}, "'net'"),
    "end_on_toe_stub": ({"end_on_toe_stub": False}, "False"),
    "reset_noise_scale": ({"reset_noise_scale": 0.2}, "0.2"),
    "domain_randomization": ({"domain_randomization": {"thigh_mass": 0.1}}, "{'thigh_mass': 0.1}"),
    "randomization_pool": (
        {"domain_randomization": {"thigh_mass": 0.1}, "randomization_pool": 7}, "7"
    ),
    "observe_body": ({"observe_body": ("hip_mass",)}, "('hip_mass',)"),
    "start": ({"start": [0.2, -0.2, -0.2, -0.2, -0.1, -0.1]},
              "(0.2, -0.2, -0.2, -0.2, -0.1, -0.1)"),
    "max_stride_time": ({"max_stride_time": 12.5}, "12.5"),
    "tolerance": ({"tolerance": 1e-6}, "1e-06"),
    "pushes": (
        {"pushes": {"rate": 0.1, "impulse": 0.02}}, "{'rate': 0.1, 'impulse': (0.02, 0.02)}"
    ),
    "observation_noise": ({"observation_noise": 0.01}, "0.01"),
    "action_noise": ({"action_noise": 0.2}, "0.2"),
    "action_delay": ({"action_delay": 3}, "3"),
    "command": ({"command": 0.15}, "0.15"),
    "command_weight": ({"command_weight": 1.0}, "1.0"),
    "constraints": ({"constraints": {"contact": "report"}}, "{'contact': 'report'}"),
    "terrain": ({"terrain": "rough:height_std=0.002"}, "Terrain(height_std=0.002)"),
    "terrain_lookahead": ({"terrain": "stairs:rise=0.001", "terrain_lookahead": 2}, "2"),
    "friction": ({"friction": 0.6}, "0.6"),
    "knee_latch": ({"knee_latch": 0.3}, "0.3"),
    "scuff_depth": ({"scuff_depth": 0.02}, "0.02"),
    "reward": ({"reward": WEIGHTS}, "{'distance': 1.0, 'alive': 0.1, 'action': -0.2}"),
    "observation": ({"observation": far}, "far"),
    "terminated": ({"terminated": far}, "far"),
    "reward_terms": ({"reward_terms": True}, "True"),
}  # fmt: skip
"""Another value of each argument of a scene, and its text."""


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Scene)])
def test_every_argument_in_which_a_scene_differs_from_the_default_one_is_explained(name):
    arguments, text = CHANGED[name]
    for scene in (arguments, gymnasium.make(ID, **arguments)):
        rows = {row["argument"]: row for row in as_rows(scene)["scene"]}
        assert rows[name]["value"] == text and arguments.keys() <= rows.keys()
        line = rf"^  {name} +{re.escape(rows[name]['default'])} +{re.escape(text)}$"
        assert re.search(line, as_text(scene), re.MULTILINE)


def test_the_default_scene_differs_in_nothing_and_a_long_terrain_is_shortened():
    assert "scene" not in as_rows("level")
    (row,) = as_rows({"terrain": gpw.footholds(np.linspace(0.0, 0.1, 1000))})["scene"]
    assert row["default"] == "None" and len(row["value"]) < 400
