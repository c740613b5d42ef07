"""The adapter for stable-baselines3 answers its whole interface as monitored single environments.

The single environments are those of `make_vec_env`: a `DummyVecEnv`, each in a `Monitor`.
"""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from gymnasium.error import ResetNeeded
from gymnasium.wrappers import OrderEnforcing, RecordVideo, TimeLimit
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import Scene

COUNT, LIMIT = 3, 12
SCENE = {"slope": (0.0, 0.06), "command": (0.1, 0.2), "reward_terms": True}


def both(**changes):
    """The adapter, and monitored single environments, of equal scenes and seeds."""
    given = {**SCENE, "max_episode_steps": LIMIT, "render_mode": None, **changes}
    native = PassiveWalkerVecEnv(COUNT, **given)
    singles = make_vec_env(f"gym_passive_walker:{ID}", COUNT, env_kwargs=given)
    for envs in (native, singles):
        envs.seed(3)
    return native, singles


def begun(**changes):
    """Both, after a reset and some steps that end episodes."""
    native, singles = both(**changes)
    np.testing.assert_array_equal(native.reset(), singles.reset())
    for action in actions(LIMIT + 5):
        same_step(native.step(action), singles.step(action))
    return native, singles


def actions(steps):
    return np.random.default_rng(0).uniform(-1.2, 1.2, (steps, COUNT, 1)).astype(np.float32)


def same_step(found, expected):
    """Compare results of a step, infos included."""
    for ours, theirs in zip(found[:3], expected[:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)
        assert ours.dtype == theirs.dtype
    for done, ours, theirs in zip(found[2], found[3], expected[3], strict=True):
        assert ours.keys() == theirs.keys() and ("episode" in ours) == done
        for name in ours.keys() - {"episode", "outcome"}:
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
        if done:
            assert ours["episode"]["r"] == pytest.approx(theirs["episode"]["r"], abs=2e-6)
            assert ours["episode"]["l"] == theirs["episode"]["l"]


def steps():
    native, singles = both()
    np.testing.assert_array_equal(native.reset(), singles.reset())
    last = []
    for action in actions(40):
        found = native.step(action)
        same_step(found, singles.step(action))
        ends = [info["terminal_observation"] for info in found[3] if "episode" in info]
        last += [(seen, seen.copy()) for seen in ends]
    assert len(last) >= 3 * COUNT
    for seen, then in last:  # they are copies, which later steps do not change
        np.testing.assert_array_equal(seen, then)


def a_step_in_two_calls():
    native, singles = begun()
    for first, then in zip(actions(4), actions(8)[4:], strict=True):
        for envs in (native, singles):
            envs.step_async(first)
            envs.step_async(then)  # in place of the first
        same_step(native.step_wait(), singles.step_wait())


def a_step_before_a_reset():
    native, singles = both()
    with pytest.raises(RuntimeError, match="needs reset"):
        singles.step(actions(1)[0])
    with pytest.raises(ResetNeeded, match="no episode has begun"):
        native.step(actions(1)[0])
    for envs in both():
        envs.reset()
        with pytest.raises(AttributeError, match="actions"):
            envs.step_wait()


def resets():
    native, singles = begun()
    for envs in (native, singles):
        envs.set_options({"slope": 0.03, "state": [0.2, -0.2, -0.25, -1.0, -0.5, -1.0]})
    for _ in range(2):  # options and seeds are of one reset
        np.testing.assert_array_equal(native.reset(), singles.reset())
        assert native.get_attr("slope") == singles.get_attr("slope")
    assert native.reset_infos == singles.reset_infos and len(native.reset_infos) == COUNT
    options = [{"slope": 0.01 * (i + 1)} for i in range(COUNT)]
    for envs in (native, singles):
        envs.set_options(options)
    np.testing.assert_array_equal(native.reset(), singles.reset())
    assert native.get_attr("slope") == singles.get_attr("slope") == [0.01, 0.02, 0.03]
    native.set_options([{"slope": 0.03}, {}, {}])
    with pytest.raises(ValueError, match="for all environments or for none"):
        native.reset()


def seeds():
    native, singles = begun()
    assert native.seed(5) == singles.seed(5) == [5, 6, 7]
    np.testing.assert_array_equal(native.reset(), singles.reset())
    np.testing.assert_array_equal(native.reset(), singles.reset())  # the generators go on
    assert len({*native.seed()}) == COUNT
    assert native.seed([9, None, 2]) == [9, None, 2]
    singles._seeds = [9, None, 2]
    np.testing.assert_array_equal(native.reset(), singles.reset())
    with pytest.raises(ValueError, match="2 seeds for 3 environments"):
        native.seed([1, 2])


NONE_OF_ITS_OWN = {
    "EXT", "allow_early_resets", "batch", "checked_data_reuse", "checked_render", "checked_reset",
    "checked_step", "class_name", "close_called", "current_reset_info", "env", "get_state",
    "has_reset", "info_keywords", "np_random_seed", "reset", "reset_keywords", "results_writer",
    "rewards", "set_state", "set_wrapper_attr", "step", "t_start", "token", "wrapper_spec",
}  # fmt: skip
"""Attributes of wrappers, and those that a batch has for all walkers together: refused."""


def names_of_single_environments(env):
    """Public attributes of an environment and its wrappers."""
    names = {name for name in dir(env) if not name.startswith("_")}
    return names | (names_of_single_environments(env.env) if hasattr(env, "env") else set())


def attributes():
    native, singles = begun()
    for name in sorted(names_of_single_environments(singles.envs[0])):
        assert singles.has_attr(name)
        assert native.has_attr(name) == (name not in NONE_OF_ITS_OWN), name
        if name in NONE_OF_ITS_OWN:
            with pytest.raises(AttributeError, match=f"a walker of a batch has no '{name}'"):
                native.get_attr(name)
            continue
        for indices in (None, 1, [2, 0]):
            found, expected = native.get_attr(name, indices), singles.get_attr(name, indices)
            assert len(found) == len(expected)
            for ours, theirs in zip(found, expected, strict=True):
                same_attribute(name, ours, theirs)
    assert not native.has_attr("wings") and not singles.has_attr("wings")
    with pytest.raises(AttributeError, match="no 'num_envs' of its own: use that of all"):
        native.get_attr("num_envs", indices=0)


def same_attribute(name, ours, theirs):
    if callable(theirs):
        assert callable(ours)
    elif name == "unwrapped":
        assert ours.slope == theirs.slope
    elif name == "spec":
        limits = [(each.id, each.max_episode_steps) for each in (ours, theirs)]
        assert limits[0] == limits[1] == (ID, LIMIT)
        assert gymnasium.make(ours).unwrapped.scene == Scene(**SCENE)
    elif name == "np_random":
        assert ours.bit_generator.state == theirs.bit_generator.state
    elif name == "episode_times":
        assert len(ours) == len(theirs)
    elif name in ("reward_terms", "episode_returns"):
        ours, theirs = ([*x.values()] if isinstance(x, dict) else x for x in (ours, theirs))
        assert len(theirs) > 0 and ours == pytest.approx(theirs, abs=1e-12)
    else:
        np.testing.assert_equal(ours, theirs, err_msg=name)


ARGUMENTS = list(Scene.__dataclass_fields__)


def set_attributes():
    """Single environments let an attribute hide that of the simulation; here it is refused."""
    native, singles = begun()
    for envs in (native, singles):
        envs.set_attr("note", [1], indices=[0, 2])
        assert envs.get_attr("note", [0, 2]) == [[1], [1]] and not envs.has_attr("note")
        envs.set_attr("note", 2)
        assert envs.get_attr("note") == [2] * COUNT
    for name in ARGUMENTS:
        said = f"{name} cannot be set: it is an argument of the scene"
        with pytest.raises(AttributeError, match=said):
            native.set_attr(name, 0.1, indices=[1])
    of_the_simulation = {name for name in dir(PassiveWalkerEnv()) if not name.startswith("_")}
    for name in of_the_simulation | {"episode_returns", "num_envs", "_max_episode_steps"}:
        with pytest.raises(AttributeError, match=f"{name} cannot be set"):
            native.set_attr(name, 1)
    np.testing.assert_array_equal(native.reset(), singles.reset())


def methods():
    native, singles = begun()
    for name in ("get_total_steps", "get_episode_rewards", "get_episode_lengths"):
        found, expected = native.env_method(name), singles.env_method(name)
        np.testing.assert_allclose(found, expected, atol=1e-12)
    for name, given in (("get_wrapper_attr", "slope"), ("has_wrapper_attr", "wings")):
        found = [envs.env_method(name, given, indices=[2, 0]) for envs in (native, singles)]
        assert found[0] == found[1]
    for envs in (native, singles):
        envs.reset()
    found = [envs.env_method("set_slope", 0.05, indices=[1]) for envs in (native, singles)]
    np.testing.assert_array_equal(*found)
    assert native.get_attr("slope") == singles.get_attr("slope")
    assert native.get_attr("slope")[1] == 0.05
    for envs in (native, singles):
        assert envs.env_method("set_energy_cost", "net") == [None] * COUNT
    assert native.get_attr("energy_cost") == singles.get_attr("energy_cost") == ["net"] * COUNT
    for action in actions(5):
        same_step(native.step(action), singles.step(action))
    with pytest.raises(AttributeError):
        native.env_method("fly")
    for envs in (native, singles):
        envs.env_method("set_scene", slope=0.04)
    np.testing.assert_array_equal(native.reset(), singles.reset())
    assert native.get_attr("slope") == singles.get_attr("slope") == [0.04] * COUNT


def wrappers():
    for limit in (LIMIT, -1):
        native, singles = both(max_episode_steps=limit)
        for each in (Monitor, OrderEnforcing, TimeLimit, gymnasium.Wrapper, RecordVideo):
            for indices in (None, 1, [2, 0]):
                expected = singles.env_is_wrapped(each, indices)
                assert native.env_is_wrapped(each, indices) == expected


def pictures():
    pytest.importorskip("pygame")
    native, singles = begun(render_mode="rgb_array")
    assert native.metadata == singles.metadata and native.render_mode == singles.render_mode
    assert len(native.get_images()) == len(singles.get_images()) == COUNT
    assert native.render().ndim == singles.render().ndim == 3
    assert native.render().shape[0] == 2 * native.get_images()[0].shape[0]  # two rows of pictures
    native, singles = begun()
    assert native.metadata == singles.metadata and native.render_mode is singles.render_mode
    for envs in (native, singles):
        with pytest.warns(UserWarning, match="render_?mode|render mode"):
            assert envs.get_images() == [None] * COUNT
        with pytest.warns(UserWarning, match="render_mode"):
            assert envs.render() is None
    with pytest.warns(UserWarning, match="render_mode"):
        assert native.env_method("render", indices=[2, 0]) == [None, None]


def closing():
    native, singles = begun()
    assert native.close() is None and singles.close() is None
    assert native.env_method("close", indices=1) == [None]


def unwrapped():
    native, singles = both()
    for envs in (native, singles):
        assert VecNormalize(envs).unwrapped is envs.unwrapped is envs
        assert envs.getattr_depth_check("get_attr", False) is None
        assert envs.getattr_depth_check("get_attr", True).endswith(type(envs).__name__)
    assert (native.observation_space, native.action_space, native.num_envs) == (
        singles.observation_space, singles.action_space, singles.num_envs
    )  # fmt: skip


INTERFACE = {
    "step": (steps, a_step_before_a_reset), "step_async": (a_step_in_two_calls,),
    "step_wait": (a_step_in_two_calls,), "reset": (resets,), "set_options": (resets,),
    "seed": (seeds,), "get_attr": (attributes,), "has_attr": (attributes,),
    "set_attr": (set_attributes,), "env_method": (methods,), "env_is_wrapped": (wrappers,),
    "get_images": (pictures,), "render": (pictures,), "close": (closing,),
    "unwrapped": (unwrapped,), "getattr_depth_check": (unwrapped,),
}  # fmt: skip
"""What tries each part of the interface."""

TRIALS = {trial.__name__: trial for trials in INTERFACE.values() for trial in trials}


@pytest.mark.parametrize("trial", TRIALS)
def test_it_answers_as_monitored_single_environments(trial):
    TRIALS[trial]()


def test_every_part_of_the_interface_is_tried():
    assert {name for name in dir(VecEnv) if not name.startswith("_")} == INTERFACE.keys()


@pytest.mark.parametrize("method", [("set_scene", {"slope": 0.02}), ("set_energy_cost", "net")])
@pytest.mark.parametrize("indices", [0, [0], [1, 2], [0, 0, 0], []])
def test_what_acts_on_all_environments_is_refused_for_some_of_them(method, indices):
    native, singles = begun()
    name, argument = method
    with pytest.raises(ValueError, match=f"{name} acts on all 3 environments"):
        native.env_method(name, argument, indices=indices)
    with pytest.raises(ValueError, match=f"{name} acts on all 3 environments"):
        native.get_attr(name)[0](argument)
    for action in actions(5):
        same_step(native.step(action), singles.step(action))
    if name == "set_scene":
        argument = argument | {"command": 0.15}  # the observation keeps its size
    native.env_method(name, argument, indices=[2, 0, 1])


def test_a_batch_of_one_is_all_of_it():
    env = PassiveWalkerVecEnv(1)
    env.env_method("set_scene", slope=0.02, tick=0.5, indices=[0])
    env.get_attr("set_energy_cost")[0]("net")
    env.reset()
    assert env.metadata["render_fps"] == env.scene.frames_per_second == 7
    env.env_method("set_scene", tick=0.1)
    env.step(np.zeros((1, 1)))
    assert env.metadata["render_fps"] == env.scene.frames_per_second == 35
    assert env.get_attr("slope") == [0.02] and env.get_attr("energy_cost") == ["net"]


def test_an_evaluation_of_normalized_environments_has_the_rewards_of_the_episodes():
    found = []
    for envs in both():
        normalized = VecNormalize(envs)
        normalized.training = False
        normalized.ret_rms.var = np.array(1e-6)  # rewards are magnified
        model = PPO("MlpPolicy", normalized, n_steps=8, batch_size=8, seed=0, device="cpu")
        found.append(evaluate_policy(model, normalized, 6, return_episode_rewards=True))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=2e-6)
    assert found[0][1] == found[1][1]
    assert np.abs(found[0][0]).max() < 1.0


def test_a_second_monitor_is_reported_as_one_too_many():
    for envs in both():
        with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
            VecMonitor(envs)


def test_a_single_environment_has_no_attribute_that_the_batch_leaves_out():
    env = PassiveWalkerEnv()
    own = {name for name in {*dir(env)} - {*dir(gymnasium.Env)} if not name.startswith("_")}
    native, _ = both()
    native.reset()
    assert {name for name in own if not native.has_attr(name)} == own & NONE_OF_ITS_OWN
