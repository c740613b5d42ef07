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

from gym_passive_walker import WALKERS
from gym_passive_walker.envs.registration import EASY_ID, ID, MAX_EPISODE_STEPS, register
from gym_passive_walker.envs.scene import SCENES, make_scene

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


def test_the_easy_task_differs_in_its_initial_states_alone():
    easy, usual = gymnasium.make(EASY_ID), gymnasium.make(ID)
    assert usual.unwrapped.scene == make_scene("level")
    assert easy.unwrapped.scene == make_scene("level", reset_noise_scale=0.05)
    assert gymnasium.make_vec(EASY_ID, num_envs=2).scene == easy.unwrapped.scene
    assert gymnasium.make(EASY_ID, scene="lab").unwrapped.scene == make_scene("lab")
    near = gymnasium.make(ID, reset_noise_scale=0.05)
    assert np.array_equal(easy.reset(seed=3)[0], near.reset(seed=3)[0])
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


def test_numbers_in_info_are_pythons_own(make, play):
    for *_, info in play(make(scene="lab"), steps=100, seed=0):
        assert {type(value) for value in info.values()} <= {float, int, str}
        json.dumps(info)


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


def test_a_state_of_another_environment_is_refused(make):
    env, other = make(walker="C"), make(walker="lab", slope=0.036)
    env.reset(seed=0), other.reset(seed=0)
    with pytest.raises(ValueError, match="of another walker"):
        env.set_state(other.get_state())


def test_wrapped_environments_can_be_pickled():
    env = gymnasium.make(ID)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    again = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(env.step(np.zeros(1))[0], again.step(np.zeros(1))[0])


def test_reset_starts_where_it_is_asked_to(make):
    env = make(scene="rolling")
    state = np.array([0.2, -0.2, -0.25, -1.0, -0.5, -1.0])
    options = {"state": state, "slope": 0.03}
    before = copy.deepcopy(options)
    observation, _ = env.reset(seed=0, options=options)
    np.testing.assert_allclose(env.state, state, rtol=1e-15)
    assert env.slope == 0.03 and observation[7] == np.float32(0.03)
    np.testing.assert_array_equal(options.pop("state"), before.pop("state"))
    assert options == before


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"states": [0.0] * 6}, r"reset has no states \(state\?\); it has state, slope"),
        ({"state": [0.0] * 5}, r"options\['state'\]: state must be"),
        ({"state": "upright"}, "state must be .* not 'upright'"),
        ({"state": 0.2}, r"shape \(6,\)"),
        ({"state": [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]}, "has fallen"),
        ({"slope": 2.0}, "slope must be an angle"),
        ({1: 2, "a": 3}, "reset has no 1, a; it has state, slope"),
        ("state", "options must map names to values"),
        ({"slope": [0.1, 0.2]}, r"options\['slope'\] must have shape \(\)"),
    ],
)
def test_impossible_resets_are_refused_and_change_nothing(make, options, message):
    env = make()
    env.reset(seed=0)
    state = env.state
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    np.testing.assert_array_equal(env.state, state)
    env.step(np.zeros(1))


@pytest.mark.parametrize(
    "action", [np.array([np.nan]), np.array([np.inf]), np.array([-np.inf], np.float32)]
)
def test_an_action_that_is_no_number_is_refused_and_changes_nothing(make, assert_same, action):
    env = make()
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(ValueError, match="finite number"):
        env.step(action)
    assert_same(env.get_state(), before)


@pytest.mark.parametrize("action", [0.0, np.zeros(2), np.zeros((1, 1)), np.zeros(0)])
def test_an_action_of_another_shape_is_refused(make, action):
    env = make()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(1,\)"):
        env.step(action)


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


def test_an_episode_draws_its_own_walker(make):
    env = make(domain_randomization={"foot_radius": 0.2}, slope=0.02)
    radii = set()
    for seed in range(3):
        env.reset(seed=seed)
        radii.add(env.walker.foot_radius)
    assert len(radii) == 3
    assert env.scene.walker == WALKERS["C"]


def test_an_unknown_render_mode_is_refused(make):
    with pytest.raises(ValueError, match="render_mode must be"):
        from gym_passive_walker.envs.walker_env import PassiveWalkerEnv

        PassiveWalkerEnv(render_mode="ascii")


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_pictures_that_cannot_be_drawn_are_refused_before_the_first_step(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    monkeypatch.setattr("gym_passive_walker.envs.batch.compiled", lambda *_: pytest.fail("late"))
    with pytest.raises(ImportError, match=r'pip install "gym-passive-walker\[render\]"'):
        make(ID, render_mode="rgb_array")


def test_pictures_follow_the_walker(play):
    pytest.importorskip("pygame")
    env = gymnasium.make(ID, scene="lab", render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    first = env.render()
    for _ in range(5):
        env.step(np.zeros(1))
    second = env.render()
    assert first.dtype == np.uint8 and first.shape == second.shape and first.shape[-1] == 3
    assert first.std() > 0 and not np.array_equal(first, second)
    env.close()
    assert env.metadata["render_fps"] == round(10 / WALKERS["lab"].time_unit)


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
