"""`PassiveWalker-v0` as an environment among Gymnasium's."""

import copy
import json
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from gym_passive_walker.envs import task
from gym_passive_walker.envs.registration import (
    EASY_ID,
    EASY_SCENE,
    ID,
    MAX_EPISODE_STEPS,
    register,
)
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import SCENES, make_scene

EVERY_SCENE = [{"scene": name} for name in SCENES] + [{"walker": "A"}, {"walker": "D"}]


def wavy(k, _):
    """An action that keeps changing."""
    return 0.3 * np.sin(0.37 * k)


@pytest.mark.parametrize("arguments", EVERY_SCENE, ids=str)
def test_gymnasium_finds_no_fault(arguments):
    pytest.importorskip("pygame")
    check_env(gymnasium.make(ID, render_mode="rgb_array", **arguments).unwrapped)


@pytest.mark.filterwarnings("ignore:We recommend you to use a symmetric")  # push-offs have one sign
@pytest.mark.parametrize("arguments", EVERY_SCENE, ids=str)
def test_stable_baselines3_finds_no_fault(arguments):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make(ID, **arguments))


def test_registration_is_done_once_and_names_its_modules():
    spec = gymnasium.spec(ID)
    register()
    assert gymnasium.spec(ID) is spec
    assert isinstance(spec.entry_point, str) and isinstance(spec.vector_entry_point, str)
    assert spec.max_episode_steps == MAX_EPISODE_STEPS == 4000


def test_the_easy_task_has_nearer_initial_states_and_ten_times_the_reward():
    easy, usual = gymnasium.make(EASY_ID), gymnasium.make(ID)
    assert usual.unwrapped.scene == make_scene("level")
    assert easy.unwrapped.scene == make_scene("level", **EASY_SCENE)
    assert gymnasium.make_vec(EASY_ID, num_envs=2).scene == easy.unwrapped.scene
    assert gymnasium.make(EASY_ID, scene="lab").unwrapped.scene == make_scene("lab")
    near = gymnasium.make(ID, reset_noise_scale=0.05)
    assert np.array_equal(easy.reset(seed=3)[0], near.reset(seed=3)[0])
    for _ in range(40):
        rewards = [env.step(np.array([0.5]))[1] for env in (easy, near)]
        assert rewards[0] == pytest.approx(10.0 * rewards[1], rel=1e-12) != 0.0
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(easy.spec.to_json()))
    assert again.unwrapped.scene == easy.unwrapped.scene


def test_a_spec_survives_json():
    env = gymnasium.make(ID, scene="lab", walker={"preset": "lab", "foot_radius": 0.21})
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.scene == env.unwrapped.scene
    assert json.loads(env.spec.to_json())["kwargs"]["scene"] == "lab"


def test_a_module_id_imports_by_itself_and_nothing_heavy():
    program = """
import sys, gymnasium
env = gymnasium.make("gym_passive_walker:PassiveWalker-v0")
env.reset(seed=0); env.step(env.action_space.sample())
heavy = {"torch", "stable_baselines3", "pygame", "matplotlib"} & set(sys.modules)
assert not heavy, heavy
"""
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


@pytest.mark.parametrize("arguments", EVERY_SCENE, ids=str)
def test_same_seed_and_actions_give_the_same_bits(make, play, assert_same, arguments):
    env = make(**arguments)
    first = play(env, wavy, steps=300, seed=7)
    assert_same(play(env, wavy, steps=300, seed=7), first)
    assert_same(play(make(**arguments), wavy, steps=300, seed=7), first)
    assert not np.array_equal(play(env, wavy, steps=1, seed=8)[0][0], first[0][0])


def test_later_episodes_follow_from_the_seed(make, assert_same):
    a, b = make(), make()
    a.reset(seed=1), b.reset(seed=1)
    assert_same([a.reset() for _ in range(3)], [b.reset() for _ in range(3)])
    assert not np.array_equal(a.reset()[0], a.reset()[0])


def test_observations_lie_in_their_box_and_are_the_callers_to_keep(make, play):
    env = make(walker="lab", slope=0.05)
    walk = play(env, lambda k, _: np.sign(np.sin(k)), seed=0)
    seen = [observation for observation, *_ in walk]
    assert all(env.observation_space.contains(observation) for observation in seen)
    assert len({id(observation) for observation in seen}) == len(seen)
    kept = [observation.copy() for observation in seen]
    env.reset(seed=1)
    np.testing.assert_array_equal(seen, kept)


def test_numbers_in_info_are_numpys(make, play):
    for *_, info in play(make(scene="lab"), steps=100, seed=0):
        assert {type(value) for value in info.values()} == {np.float64, np.int64, str}
        json.dumps(info, default=int)


@pytest.mark.parametrize("arguments", EVERY_SCENE, ids=str)
def test_an_episode_goes_on_where_it_was_saved(make, play, assert_same, arguments):
    env = make(**arguments)
    play(env, wavy, steps=12, seed=3)
    if not env._ready:
        env.reset(seed=4)

    def rest(walker_env):
        walk = [walker_env.step(np.array([0.1]))]
        while not walk[-1][2] and len(walk) < 60:
            walk.append(walker_env.step(np.array([0.1])))
        return walk, [walker_env.reset() for _ in range(2)]

    saved = env.get_state()
    twins = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
    fresh = make(**arguments)
    fresh.set_state(saved)
    expected = rest(env)
    for other in (*twins, fresh):
        assert_same(rest(other), expected)
    env.set_state(saved)
    assert_same(rest(env), expected)


def test_wrapped_environments_can_be_pickled():
    env = gymnasium.make(ID)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    again = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(env.step(np.zeros(1))[0], again.step(np.zeros(1))[0])


def test_a_slope_alone_brings_its_own_gait(make):
    env = make(scene="rolling", reset_noise_scale=0.0)
    env.reset(seed=0, options={"slope": 0.05})
    steep = env.state
    env.reset(seed=0, options={"slope": 0.01})
    assert env.slope == 0.01 and env.state[0] < 0.7 * steep[0]


def test_options_take_as_many_random_numbers_as_none(make, assert_same):
    a, b = make(), make()
    a.reset(seed=0), b.reset(seed=0, options={"state": [0.2, -0.2, -0.2, -1.0, -0.5, -1.0]})
    assert_same(a.reset(), b.reset())


def test_there_is_no_step_before_a_reset_or_after_a_fall(make, play):
    env = make(max_stride_time=0.5)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(1))
    play(env, seed=0)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(1))
    env.reset()
    env.step(np.zeros(1))


def test_the_time_limit_truncates_and_a_fall_terminates():
    env = gymnasium.make(ID, max_episode_steps=10)
    env.reset(seed=0)
    ends = [env.step(np.zeros(1))[2:4] for _ in range(10)]
    assert ends == [(False, False)] * 9 + [(False, True)]


def test_an_unknown_render_mode_is_refused(make):
    with pytest.raises(ValueError, match="render_mode must be"):
        PassiveWalkerEnv(render_mode="ascii")


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_pictures_that_cannot_be_drawn_are_refused_before_the_first_step(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    monkeypatch.setattr("gym_passive_walker.envs.batch.compiled", lambda *_: pytest.fail("late"))
    with pytest.raises(ImportError, match=r'pip install "gym-passive-walker\[render\]"'):
        make(ID, render_mode="rgb_array")


def test_the_contact_goes_along_with_the_steps(make):
    env = make(scene="lab", reset_noise_scale=0.0)
    env.reset(seed=0)
    assert env.batch.contact(0).x == 0.0
    length = 0.0
    for _ in range(100):
        *_, info = env.step(np.zeros(1))
        if info.get("outcome") == "heelstrike":
            length += info["step_length"] * env.walker.leg_length
            assert env.batch.contact(0).x == pytest.approx(length)


@pytest.mark.parametrize(
    ("name", "threshold", "scene"), [(ID, 47.3, {}), (EASY_ID, 476.0, EASY_SCENE)]
)
def test_each_registered_task_has_its_own_threshold_and_scene(name, threshold, scene):
    spec = gymnasium.spec(name)
    assert spec.reward_threshold == threshold and spec.max_episode_steps == 4000
    env, envs = gymnasium.make(name), gymnasium.make_vec(name, num_envs=2)
    assert isinstance(env.unwrapped, PassiveWalkerEnv) and isinstance(envs, PassiveWalkerVectorEnv)
    for made in (env.unwrapped, envs):
        assert made.scene == make_scene("level", **scene)
    assert envs.batch.step_limit == 4000.0


def test_spaces_have_the_bounds_of_every_option():
    scene = {
        "command": (0.1, 0.2), "terrain": {"rough": {"height_std": 0.01}}, "terrain_lookahead": 2,
        "observe_body": ("hip_mass",), "actions": ("hip", "push_off"),
    }  # fmt: skip
    right = np.pi / 2
    high = [right, np.pi, np.pi, 10.0, 10.0, 10.0, 1.0, right]
    low = [-right, -np.pi, -np.pi, -10.0, -10.0, -10.0, 0.0, -right]
    more_high, more_low = [1.0, *[1.0, right] * 2, 100.0], [0.0, *[-1.0, -right] * 2, -100.0]
    for given, above, below in (({}, high, low), (scene, high + more_high, low + more_low)):
        space = gymnasium.make(ID, **given).observation_space
        assert space.dtype == np.float32
        np.testing.assert_array_equal(space.high, np.float32(above))
        np.testing.assert_array_equal(space.low, np.float32(below))
    acts = gymnasium.make(ID, **scene).action_space
    assert acts == gymnasium.spaces.Box(np.float32([-1.0, 0.0]), np.float32([1.0, 1.0]))


@pytest.mark.parametrize(
    ("scene", "more"),
    [
        ({}, ()),
        ({"reward_terms": True}, ("reward_distance", "reward_energy")),
        ({"command": 0.1, "reward_terms": True},
         ("command", "reward_distance", "reward_energy", "reward_command")),
        ({"pushes": {"rate": 0.1, "impulse": 0.001}},
         ("pushes", "push_work", "episode_push_work")),
        ({"constraints": {"friction": "report"}}, ("friction",)),
        ({"constraints": {"scuffing": "report", "contact": "report"}},
         ("normal_force", "normal_impulse", "clearance")),
        ({"constraints": {"knee lock": "report"}}, ("stance_knee_torque", "stance_knee_impulse")),
        ({"observation_noise": 0.01, "action_delay": 1}, ()),
        ({"reward": {"alive": 1.0}, "reward_terms": True}, ("reward_alive",)),
    ],
)  # fmt: skip
def test_info_has_the_documented_entries_and_no_others(make, play, scene, more):
    late = lambda k, _: float(k > 90)  # noqa: E731
    walk = play(make(scene="lab", reset_noise_scale=0.01, **scene), late, seed=2)
    names, kinds = [*task.EVERY_STEP, *task.EVERY_STRIDE, *more, "outcome"], set()
    for _, reward, terminated, truncated, info in walk:
        outcome = info["outcome"]
        kinds.add(outcome)
        assert type(info) is dict  # JAX and torch take a subclass for a single value
        assert list(info) == names and (outcome == "heelstrike" or terminated) == bool(outcome)
        stride = [info[name] for name in task.EVERY_STRIDE]
        assert all(np.isfinite(stride)) and any(stride) == (outcome == "heelstrike")
        assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
        numbers = {name: type(x) for name, x in info.items() if name != "outcome"}
        whole = {"strides", "pushes"} & info.keys()
        for name, kind in numbers.items():
            assert kind is (np.int64 if name in whole else np.float64)
    assert {"", "heelstrike"} < kinds


def test_the_info_of_a_reset_has_the_entries_of_a_step(make):
    env = make(command=(0.1, 0.2), pushes={"rate": 2.0, "impulse": 0.01}, reward_terms=True,
               constraints={"contact": "report", "scuffing": "report"})  # fmt: skip
    for seed in range(3):
        _, first = env.reset(seed=seed)
        assert not any(first[name] for name in (*task.EVERY_STEP, *task.EVERY_STRIDE, "push_work"))
        assert not any(first[f"reward_{name}"] for name in ("distance", "energy", "command"))
        assert first["clearance"] == first["normal_force"] == np.inf and first["outcome"] == ""
        for _ in range(10):
            *_, info = env.step(np.ones(1))
            assert list(info) == list(first) and info["command"] == first["command"]


def test_infos_that_are_read_later_are_those_of_their_step(make):
    prompt, late = make(scene="lab"), make(scene="lab")
    found = []
    for env, look in ((prompt, dict), (late, lambda info: info)):
        infos = [look(env.reset(seed=0)[1])]
        infos += [look(env.step(np.zeros(1))[-1]) for _ in range(80)]
        found.append(infos)
    assert [dict(info) for info in found[1]] == found[0]
    assert sum(info["outcome"] == "heelstrike" for info in found[1]) >= 2


def test_infos_of_a_stride_agree_with_each_other(make, play):
    env = make(**POINT_FEET, actions=("hip", "ankle", "push_off"), max_push_off=0.02)
    scene, walk, origin, strides = env.scene, [], 0.0, 0
    env.reset(seed=1)
    for k in range(200):
        before = env.contact
        act = np.array([0.05 * np.cos(k), 0.02 * np.sin(k), 0.05])
        *_, ended, _, info = env.step(act)
        walk.append(info)
        if info.get("outcome") != "heelstrike":
            if ended:
                break
            assert env.contact == before  # a point foot does not roll
            continue
        strides += 1
        origin += info["step_length"] * env.walker.leg_length
        assert env.contact == pytest.approx(origin, rel=1e-12)
        assert info["strides"] == strides
        assert info["speed"] == pytest.approx(info["step_length"] / info["step_period"])
        costs = ("gravity_cost", "hip_cost", "ankle_cost", "push_off_cost")
        assert info["cost_of_transport"] == pytest.approx(sum(info[name] for name in costs))
        energy = sum(each["energy"] for each in walk)
        charged = sum(info[name] for name in costs[1:]) * info["step_length"]
        assert charged == pytest.approx(energy, rel=1e-9)
        assert info["push_off_cost"] > 0.0 and info["hip_cost"] >= abs(info["net_hip_cost"])
        walk = []
    assert strides >= 3 and scene.walker.foot_radius == 0.0


POINT_FEET = {"walker": "E", "slope": 0.012, "reset_noise_scale": 0.0}


@pytest.mark.parametrize("given", [[0], [0.5], np.array([1]), np.array([True]), (0.25,)], ids=repr)
def test_actions_may_be_lists_and_whole_numbers(make, assert_same, given):
    one, other = make(), make()
    one.reset(seed=0), other.reset(seed=0)
    assert_same(one.step(given), other.step(np.array(given, float)))
    many, same = (PassiveWalkerVectorEnv(2) for _ in range(2))
    many.reset(seed=0), same.reset(seed=0)
    rows = [given, given]
    assert_same(many.step(rows)[:4], same.step(np.array(rows, float))[:4])


def test_the_energy_cost_is_reported_as_it_is_set(make):
    for env in (make(energy="net"), PassiveWalkerVectorEnv(2, energy="net")):
        assert env.energy_cost == "net"
        for energy in ("absolute", "positive", "net"):
            env.set_energy_cost(energy)
            assert env.energy_cost == energy and env.scene.energy == "net"
        env.set_energy_cost("absolute")
        env.set_energy_cost(None)
        assert env.energy_cost == "net"


def test_a_slope_is_set_during_an_episode_alone(make):
    env = make(max_stride_time=0.5)
    with pytest.raises(ResetNeeded, match="no episode is under way"):
        env.set_slope(0.01)
    env.reset(seed=0)
    assert env.set_slope(0.01)[7] == np.float32(0.01) and env.slope == 0.01
    while not env.step(np.zeros(1))[2]:
        pass
    with pytest.raises(ResetNeeded, match="no episode is under way"):
        env.set_slope(0.01)


def test_a_window_shows_the_reset_and_each_step():
    pygame = pytest.importorskip("pygame")
    env = PassiveWalkerEnv("lab", render_mode="human")
    seen = []
    env.reset(seed=0)
    seen.append(pygame.surfarray.array3d(pygame.display.get_surface()))
    for _ in range(2):
        env.step(np.ones(1))
        seen.append(pygame.surfarray.array3d(pygame.display.get_surface()))
    env.reset(seed=0)
    seen.append(pygame.surfarray.array3d(pygame.display.get_surface()))
    assert seen[0].std() > 0.0 and not np.array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[1], seen[2]) and np.array_equal(seen[0], seen[3])
    env.close()
    env.close()


def test_without_a_render_mode_there_is_a_warning_and_no_picture(make):
    env = make()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="needs a render_mode"):
        assert env.render() is None
    many = PassiveWalkerVectorEnv(2)
    many.reset(seed=0)
    assert many.render() is None


def test_environments_with_pictures_are_copied_without_their_screens(assert_same):
    pytest.importorskip("pygame")
    for env in (PassiveWalkerEnv("lab", render_mode="rgb_array"),
                PassiveWalkerVectorEnv(2, "lab", render_mode="rgb_array")):  # fmt: skip
        env.reset(seed=0)
        shown = env.render()
        for other in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
            assert_same(other.render(), shown)
            other.close()
        assert_same(env.render(), shown)
        env.close()


def test_frames_per_second_are_those_of_the_scene():
    for scene in ({"scene": "lab"}, {"tick": 0.5}, {"control": "stride"}):
        expected = make_scene(**{"scene": "level", **scene}).frames_per_second
        for env in (PassiveWalkerEnv(**scene), PassiveWalkerVectorEnv(2, **scene)):
            assert env.metadata["render_fps"] == expected
    assert PassiveWalkerEnv.metadata["render_fps"] == 30  # of the class: unchanged


def test_a_window_has_the_speed_of_the_scene_that_is_set(make):
    pytest.importorskip("pygame")
    env = make(render_mode="human")
    for tick, speed in ((0.1, 35), (0.5, 7)):
        env.set_scene(tick=tick)
        env.reset(seed=0)
        assert env._screen.fps == env.metadata["render_fps"] == speed
    env.close()
