"""Domain randomization: what is drawn, from which distribution, and what it changes."""

import copy
import json
import pickle

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.explain import as_rows
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import Scene, SceneError, make_scene
from gym_passive_walker.gaits.scenes.starts import Starts
from tests.own.statements import DRIVEN

C = gpw.WALKERS["C"]
SLIPPERY = {"constraints": {"friction": "end"}}
ALL = {
    "foot_radius": 0.1,
    "shank_com": (0.8, 1.1),
    "thigh_mass, shank_mass": {"log_uniform": (0.5, 2.0)},
    "thigh_com": {"normal": (0.0, 0.01), "clip": (-0.02, 0.02), "operation": "add"},
    "max_hip_torque": (0.5, 1.5),
    "action_delay": {"choices": (0, 1, 3), "operation": "abs"},
    "friction": {"uniform": (0.3, 1.0), "operation": "abs"},
    "reset_noise_scale": (0.1, 2.0),
    "slope": {"uniform": (0.0, 0.03), "operation": "abs"},
}


def draws(given, count=2000, **scene):
    """Values of one parameter by many keys."""
    drawing = Starts(Scene(domain_randomization=given, **scene)).randomization
    return np.array([drawing.draw(key).values for key in range(count)])


@pytest.mark.parametrize(
    ("given", "quantiles"),
    [
        (0.1, [0.9, 0.95, 1.0, 1.05, 1.1]),
        ((0.8, 1.6), [0.8, 1.0, 1.2, 1.4, 1.6]),
        ({"log_uniform": (0.25, 4.0)}, [0.25, 0.5, 1.0, 2.0, 4.0]),
        ({"normal": (1.0, 0.1), "clip": (0.9, 1.2)}, [0.9, 0.93255, 1.0, 1.06745, 1.2]),
        ({"uniform": (-0.01, 0.03), "operation": "add"}, None),
        ({"uniform": (0.1, 0.3), "operation": "abs"}, None),
    ],
    ids=str,
)
def test_values_are_of_their_distribution(given, quantiles):
    nominal = C.thigh_com
    if quantiles is None:
        (low, high), add = given["uniform"], given["operation"] == "add"
        quantiles = [(add * nominal + low + (high - low) * k / 4.0) / nominal for k in range(5)]
    found = np.quantile(draws({"thigh_com": given}), [0.0, 0.25, 0.5, 0.75, 1.0]) / nominal
    spread = quantiles[-1] - quantiles[0]
    np.testing.assert_allclose(found, quantiles, atol=0.06 * spread)
    assert found[0] >= quantiles[0] - 1e-12 and found[-1] <= quantiles[-1] + 1e-12


def test_choices_and_whole_numbers_are_equally_likely():
    for given in ({"choices": (0, 1, 2)}, {"uniform": (0, 2)}):
        found = draws({"action_delay": given | {"operation": "abs"}})[:, 0]
        values, counts = np.unique(found, return_counts=True)
        assert values.tolist() == [0.0, 1.0, 2.0]
        assert np.all(np.abs(counts - 2000 / 3) < 4.0 * np.sqrt(2000 * 2 / 9))


def test_parameters_of_one_key_share_a_draw_and_others_do_not():
    found = draws({"thigh_mass, shank_mass": (0.8, 1.2), "thigh_com": (0.8, 1.2)}, 500)
    drawing = Starts(Scene(domain_randomization={"thigh_mass, shank_mass": 0.1})).randomization
    assert drawing.names == ("thigh_mass", "shank_mass")
    com, thigh, shank = (found / [C.thigh_com, C.thigh_mass, C.shank_mass]).T
    np.testing.assert_allclose(thigh, shank, rtol=1e-14)
    assert abs(np.corrcoef(thigh, com)[0, 1]) < 0.15


def test_a_draw_does_not_depend_on_what_else_is_drawn():
    alone = draws({"shank_mass": 0.1}, 50)[:, 0]
    assert np.array_equal(draws({"shank_mass": 0.1, "foot_radius": 0.2}, 50)[:, 1], alone)


def seeded(kind, count, seed, resets):
    """Draws of some episodes, one after another."""
    scene = make_scene(domain_randomization=ALL, **SLIPPERY)
    env = kind(scene) if kind is PassiveWalkerEnv else kind(count, scene)
    found = []
    for k in range(resets):
        _, info = env.reset(**({} if k else {"seed": seed}))
        found.append(copy.deepcopy(info["randomized"]))
    return env, found


def test_equal_seeds_draw_alike_in_single_and_vector_environments():
    _, alone = seeded(PassiveWalkerEnv, 1, 12, 3)
    _, many = seeded(PassiveWalkerVectorEnv, 4, 10, 3)
    _, more = seeded(PassiveWalkerVectorEnv, 9, 10, 3)
    for single, one, other in zip(alone, many, more, strict=True):
        assert {*single} == {name for key in ALL for name in key.split(", ")}
        for name, value in single.items():
            assert value == one[name][2] == other[name][2]
            assert np.array_equal(one[name], other[name][:4])
            assert one["_" + name].all()
    assert alone[0] != alone[1] != alone[2]


def test_draws_go_with_each_walker_and_its_slope():
    env, (*_, last) = seeded(PassiveWalkerVectorEnv, 5, 3, 2)
    for i, walker in enumerate(env.walkers):
        for name in ("foot_radius", "shank_com", "thigh_mass", "thigh_com"):
            assert getattr(walker, name) == last[name][i]
    assert np.array_equal(env.slopes, last["slope"])
    _, infos = env.reset(options={"slope": 0.015})
    assert np.all(infos["randomized"]["slope"] == 0.015)


def test_every_step_and_every_learner_sees_the_draws():
    scene = {"domain_randomization": {"foot_radius": 0.1, "max_hip_torque": (0.5, 1.0)}}
    alone, many = PassiveWalkerEnv(scene), PassiveWalkerVecEnv(2, scene, seed=4)
    _, begun = alone.reset(seed=4)
    many.reset()
    assert many.reset_infos[0]["randomized"] == begun["randomized"]
    *_, info = alone.step(np.zeros(1, np.float32))
    *_, infos = many.step(np.zeros((2, 1)))
    assert infos[0]["randomized"] == info["randomized"] == begun["randomized"]
    assert infos[1]["randomized"] != infos[0]["randomized"]
    vector = gym.make_vec("PassiveWalker-v0", 2, scene=scene, autoreset_mode="SameStep",
                          max_episode_steps=1)  # fmt: skip
    _, before = vector.reset(seed=4)
    *_, infos = vector.step(np.zeros((2, 1)))
    last, now = infos["final_info"]["randomized"], infos["randomized"]
    assert np.array_equal(last["foot_radius"], before["randomized"]["foot_radius"])
    alone.reset(seed=4)
    _, following = alone.reset()
    assert now["foot_radius"][0] == following["randomized"]["foot_radius"]


@pytest.mark.parametrize(
    ("name", "drawn"),
    [
        ("max_hip_torque", {"choices": (0.01, 0.02), "operation": "abs"}),
        ("action_delay", {"uniform": (1, 3), "operation": "abs"}),
        ("friction", {"choices": (0.05, 0.9), "operation": "abs"}),
        ("reset_noise_scale", (0.1, 3.0)),
        ("slope", {"uniform": (0.01, 0.04), "operation": "abs"}),
        ("foot_radius", (0.5, 1.5)),
    ],
)
def test_a_drawn_value_acts_as_an_argument_of_the_scene(name, drawn):
    """An episode is that of a scene with the drawn value as its argument."""
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 1)).astype(np.float32)
    common = {"tick": 0.3, "start": (0.2,) + (-0.2,) * 5, "action_noise": 0.2, **SLIPPERY}
    values = set()
    for seed in range(6):
        env = PassiveWalkerEnv(domain_randomization={name: drawn}, **common)
        begun, info = env.reset(seed=seed)
        value = float(info["randomized"][name])
        values.add(value)
        changed = {name: int(value) if name == "action_delay" else value}
        if name in vars(C):
            changed = {"walker": env.walker}
        other = PassiveWalkerEnv(**common, **changed)
        np.testing.assert_allclose(other.reset(seed=seed)[0], begun, rtol=1e-6)
        for action in actions:
            here, there = env.step(action), other.step(action)
            np.testing.assert_allclose(here[0], there[0], rtol=2e-6, atol=2e-6)
            assert here[1] == pytest.approx(there[1], abs=1e-9)
            assert here[4]["outcome"] == there[4]["outcome"]
            if here[2]:
                break
    assert len(values) > 1


def test_a_curriculum_begins_with_the_scene_and_reaches_the_whole_range():
    given = {"foot_radius": 0.5, "action_delay": {"choices": (1, 2), "operation": "abs"}}
    envs = PassiveWalkerVectorEnv(40, domain_randomization=given | {"curriculum": 20})
    whole = PassiveWalkerVectorEnv(40, domain_randomization=given)
    widths, delays = [], []
    for k in range(21):
        seed = {} if k else {"seed": 0}
        drawn, full = (e.reset(**seed)[1]["randomized"] for e in (envs, whole))
        off = drawn["foot_radius"] / C.foot_radius - 1.0
        np.testing.assert_allclose(
            off, (k // 2) / 10 * (full["foot_radius"] / C.foot_radius - 1.0), atol=1e-14
        )
        widths.append(np.abs(off).max())
        delays.append(drawn["action_delay"])
    assert widths[0] == 0.0 and 0.4 < widths[20] <= 0.5
    assert not delays[0].any() and 0.1 < np.mean(delays[10] > 0) < 0.9 and delays[20].all()
    drawn = envs.reset(seed=0)[1]["randomized"]  # a seed begins again
    assert np.all(drawn["foot_radius"] == C.foot_radius)


def test_a_curriculum_goes_on_where_the_scene_changes_or_a_copy_is_made():
    given = {"foot_radius": 0.5, "curriculum": 10}
    envs = PassiveWalkerVectorEnv(3, domain_randomization=given)
    envs.reset(seed=0)
    for _ in range(4):
        envs.reset()
    for copied in (copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))):
        twin = copied(envs)
        state = envs.get_state()
        one, other = (e.reset()[1]["randomized"]["foot_radius"] for e in (envs, twin))
        assert np.array_equal(one, other)
        fresh = PassiveWalkerVectorEnv(3, domain_randomization=given)
        fresh.set_state(state)
        assert np.array_equal(fresh.reset()[1]["randomized"]["foot_radius"], one)
    before = envs.batch.randomized.episodes.copy()
    envs.set_scene(slope=0.01)
    envs.reset()
    assert np.array_equal(envs.batch.randomized.episodes, before + 1)


def test_draws_go_on_after_a_scene_without_draws():
    """They began again: the walkers of the first episodes came a second time."""
    drawn = {"domain_randomization": {"foot_radius": 0.1, "curriculum": 4}}
    one, other = (PassiveWalkerVectorEnv(2, **drawn) for _ in range(2))
    for envs in (one, other):
        envs.reset(seed=1)
        envs.reset()
    one.set_scene(domain_randomization={})
    one.reset()
    one.set_scene(**drawn)
    for envs in (one, other):
        envs.reset()
    assert one.walkers == other.walkers and len({*one.walkers}) == 2


def test_a_state_with_values_that_are_not_drawn_is_refused():
    envs = PassiveWalkerVectorEnv(2, domain_randomization={"max_hip_torque": (0.5, 1.0)})
    envs.reset(seed=0)
    state = envs.get_state()
    state["draws"][1] = 0.051
    with pytest.raises(ValueError, match=r"draws of environment 1 must be values that domain_"):
        envs.set_state(state)
    state = envs.get_state()
    state["draw_episodes"][0] = -1
    with pytest.raises(ValueError, match="draw_episodes of environment 0"):
        envs.set_state(state)
    state = envs.get_state()
    state["disturbances"]["delay"][0] = 1
    with pytest.raises(ValueError, match="delay"):
        envs.set_state(state)


def test_a_file_has_the_same_notation(tmp_path):
    scene = Scene(domain_randomization=ALL | {"curriculum": 30}, **SLIPPERY)
    file = tmp_path / "task.json"
    kept = {"domain_randomization": scene.domain_randomization, **SLIPPERY}
    file.write_text(json.dumps(kept), encoding="utf-8")
    assert make_scene(file, trust=False) == scene
    yaml = tmp_path / "task.yaml"
    yaml.write_text(
        "domain_randomization:\n  foot_radius: 0.1\n  thigh_mass, shank_mass: [0.8, 1.2]\n"
        "  action_delay: {choices: [0, 1], operation: abs}\n  curriculum: 100\n",
        encoding="utf-8",
    )
    found = make_scene(yaml, trust=False).domain_randomization
    assert found["thigh_mass, shank_mass"] == (0.8, 1.2) and found["curriculum"] == 100


REFUSED = {
    "low after high": ({"foot_radius": (1.2, 0.8)}, "low before high, not (1.2, 0.8)"),
    "one value": ({"foot_radius": (1.1, 1.1)}, "draws one number alone, 1.1"),
    "three numbers": ({"foot_radius": (1, 2, 3)}, "must be 2 numbers"),
    "text": ({"foot_radius": "wide"}, "must be a number from 0 to 0.5"),
    "not finite": ({"foot_radius": (0.5, np.inf)}, "['uniform'][1] must be"),
    "negative log-uniform": ({"foot_radius": {"log_uniform": (-1, 2)}}, "must be above 0"),
    "negative factor": ({"foot_radius": (-0.5, 0.5)}, "factors from 0 on"),
    "unknown parameter": ({"foot_radios": 0.1}, "foot_radius"),
    "unknown distribution": ({"foot_radius": {"unifrom": (1, 2)}}, "uniform"),
    "two distributions": ({"foot_radius": {"uniform": (1, 2), "choices": (1,)}}, "must have one"),
    "unknown operation": (
        {"foot_radius": {"uniform": (1, 2), "operation": "times"}}, "'scale', 'add', 'abs'"
    ),
    "no choices": ({"foot_radius": {"choices": ()}}, "must be one or more numbers"),
    "no clip": ({"foot_radius": {"normal": (1.0, 0.1)}}, 'needs "clip"'),
    "no spread": ({"foot_radius": {"normal": (1.0, 0.0), "clip": (0, 2)}}, "std above 0"),
    "clipped uniform": ({"foot_radius": {"uniform": (1, 2), "clip": (1, 2)}}, "has none"),
    "twice": ({"foot_radius": 0.1, "foot_radius, thigh_com": 0.1}, "draws foot_radius twice"),
    "key": ({3: 0.1}, "names of parameters as keys, not 3"),
    "units": (
        {"thigh_mass, thigh_com": {"uniform": (0.1, 0.2), "operation": "abs"}}, "different units"
    ),
    "group with a delay": (
        {"action_delay, foot_radius": {"choices": (1, 2), "operation": "abs"}}, "this parameter al"
    ),
    "half a step": (
        {"action_delay": {"choices": (0.5, 1), "operation": "abs"}}, "whole numbers of control st"
    ),
    "delay by a factor": ({"action_delay": (1, 2)}, "whole number of control steps"),
    "tolerance of a delay": ({"action_delay": 0.1}, "whole number of control steps"),
    "curriculum of none": ({"foot_radius": 0.1, "curriculum": 0}, "['curriculum'] must be"),
    "curriculum alone": ({"curriculum": 10}, "nothing is drawn"),
    "no such walker": (
        {"foot_radius": {"uniform": (0.1, 2.0), "operation": "abs"}}, "draws foot_radius=2 too"
    ),
    "factor of zero": ({"hip_mass": (0.5, 2.0)}, "hip_mass is 0 in this scene"),
    "no effect": ({"gravity": (0.5, 2.0)}, "changes nothing"),
    "no such actuator": ({"max_push_off": (0.5, 2.0)}, "its actions are hip"),
    "friction of no effect": ({"friction": (0.5, 2.0)}, 'constraints={"friction": "end"}'),
    "slope by a factor": ({"slope": (0.5, 2.0)}, "slope is 0 in this scene"),
    "share of a torque that is not there": ({"max_push_off": 0.0}, "its actions are hip"),
    "share of a slope of zero": ({"slope": 0.0}, "slope is 0 in this scene"),
    "too steep": ({"slope": {"uniform": (0, 2), "operation": "abs"}}, "between -pi/2 and pi/2"),
    "too much noise": ({"reset_noise_scale": (0.5, 20.0)}, "must be from 0 to 0.9"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_or_act_is_refused(name):
    given, said = REFUSED[name]
    with pytest.raises(SceneError) as caught:
        Scene(domain_randomization=given)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_factors_are_a_row_of_any_kind():
    for row in ((0.9, 1.1), [0.9, 1.1], np.array([0.9, 1.1])):
        found = Scene(domain_randomization={"foot_radius": row}).domain_randomization
        assert found == {"foot_radius": (0.9, 1.1)}


def test_a_range_of_slopes_is_given_once():
    drawn = {"slope": {"uniform": (0.0, 0.02), "operation": "abs"}}
    with pytest.raises(SceneError, match="is a range already"):
        Scene(slope=(0.0, 0.02), domain_randomization=drawn)


def test_bodies_of_a_system_are_drawn():
    scene = Scene(walker=DRIVEN, slope=0.02, domain_randomization={"hip": (0.9, 1.1)})
    envs = PassiveWalkerVectorEnv(3, scene)
    _, infos = envs.reset(seed=0)
    found = [walker.body.hip for walker in envs.walkers]
    assert infos["randomized"]["hip"].tolist() == found and len({*found}) == 3


def test_explain_names_what_is_drawn_and_its_value_now():
    env = PassiveWalkerEnv(domain_randomization=ALL | {"curriculum": 5}, **SLIPPERY)
    before = as_rows(env.scene)
    rows = {row["parameter"]: row for row in before["domain randomization"]}
    assert {*rows} == {name for key in ALL for name in key.split(", ")}
    assert rows["thigh_mass"]["drawn"].endswith("times its value, with shank_mass")
    assert (rows["action_delay"]["min"], rows["action_delay"]["max"]) == (0.0, 3.0)
    assert "all grow over 5 episodes" in before["domain randomization"][0]["drawn"]
    assert before["action"][0]["action 1 is"] == "0.025 to 0.075 m g l"
    _, info = env.reset(seed=2)
    now = {row["parameter"]: row["now"] for row in as_rows(env)["domain randomization"]}
    assert now == info["randomized"]


def test_a_reset_that_is_refused_begins_no_episode():
    given = {"foot_radius": 0.5, "curriculum": 10}
    envs, twin = (PassiveWalkerVectorEnv(2, domain_randomization=given) for _ in range(2))
    _, before = envs.reset(seed=0)
    twin.reset(seed=0)
    with pytest.raises(ValueError, match="fallen"):
        envs.reset(options={"state": [2.0, -0.2, -0.2, -0.3, -0.1, -0.4]})
    now = envs.batch.info_values()["randomized"]["foot_radius"]
    assert np.array_equal(now, before["randomized"]["foot_radius"])
    assert np.array_equal(envs.batch.randomized.episodes, twin.batch.randomized.episodes)
