"""Every entry point of the environments validates its arguments."""

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.scenes.scene import make_scene

ID = "PassiveWalker-v0"
LAB = {
    "thigh_length": 0.35, "thigh_mass": 2.345, "thigh_com": 0.091, "thigh_gyration": 0.099,
    "shank_length": 0.46, "shank_mass": 1.013, "shank_com": 0.17, "shank_gyration": 0.197,
}  # fmt: skip


def for_learners(**given):
    """A batch for stable-baselines3, where that is installed."""
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    return PassiveWalkerVecEnv(**{"num_envs": 2, **given})


SINGLE = {"make": lambda **given: gym.make(ID, **given)}
BATCHES = {
    "make_vec": lambda **given: gym.make_vec(ID, **{"num_envs": 2, **given}),
    "stable-baselines3": for_learners,
}
ENTRY_POINTS = SINGLE | BATCHES


@pytest.mark.parametrize("count", [-1, 0, 1.5, "3", None, True, np.nan, [2]], ids=repr)
@pytest.mark.parametrize("entry_point", BATCHES)
def test_a_batch_is_a_whole_number_of_walkers(entry_point, count):
    with pytest.raises(ValueError, match="num_envs must be a whole number from 1 on, not"):
        BATCHES[entry_point](num_envs=count)


@pytest.mark.parametrize("limit", ["a", 2.5, 0, -2, True, np.nan], ids=repr)
@pytest.mark.parametrize("entry_point", BATCHES)
def test_episodes_end_after_a_whole_number_of_steps_or_never(entry_point, limit):
    with pytest.raises(ValueError, match=r"max_episode_steps must be a whole .* None or -1"):
        BATCHES[entry_point](max_episode_steps=limit)


@pytest.mark.parametrize("threads", ["a", 0, 1.5], ids=repr)
@pytest.mark.parametrize("entry_point", BATCHES)
def test_threads_are_a_whole_number(entry_point, threads):
    with pytest.raises(ValueError, match="threads must be a whole number"):
        BATCHES[entry_point](threads=threads)


@pytest.mark.parametrize("name", ["walkers", "slopes"])
@pytest.mark.parametrize("row", [3, [], ["lab"]], ids=repr)
@pytest.mark.parametrize("entry_point", BATCHES)
def test_arguments_of_each_environment_come_in_a_row(entry_point, name, row):
    with pytest.raises(ValueError, match=f"{name} must be in a row, one for each of 2"):
        BATCHES[entry_point](**{name: row})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shank_mass": "3"}, "shank_mass must be a number, not '3'"),
        ({"thigh_len": 0.4}, r"a walker has no thigh_len \(thigh_length\?\)"),
        ({1: 2}, "a walker has no 1|keywords must be strings"),
        ({"shank_com": 17.0}, "shank_com must be at most two leg lengths, 1.62"),
    ],
)
@pytest.mark.parametrize("entry_point", ENTRY_POINTS)
def test_invalid_walkers_are_refused(entry_point, change, message):
    for walker in (LAB | change, {"preset": "lab"} | change):
        with pytest.raises(gpw.WalkerError, match=message):
            ENTRY_POINTS[entry_point](walker=walker)


@pytest.mark.parametrize("walker", [None, 3, "Lab", []], ids=repr)
@pytest.mark.parametrize("entry_point", ENTRY_POINTS)
def test_an_unknown_walker_is_answered_with_the_known_ones(entry_point, walker):
    with pytest.raises(gpw.WalkerError, match=r"no walker .* lab-straight"):
        ENTRY_POINTS[entry_point](walker=walker)


@pytest.mark.parametrize("entry_point", ["make", "make_vec"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"states": [0.0] * 6}, r"reset has no states \(state\?\); it has state, slope"),
        ({1: 2, "a": 3}, "reset has no 1, a; it has state, slope"),
        ({"slop": 0.1}, r"reset has no slop \(slope\?\)"),
        (5, "options must map names to values, not 5"),
        ("state", "options must map names to values"),
        ({"state": np.zeros((3, 6))}, r"options\['state'\] must have shape \(6,\)"),
        ({"state": [0.0] * 5}, r"options\['state'\]:? .*must "),
        ({"state": "upright"}, "state must be .* not 'upright'"),
        ({"state": 0.2}, r"shape \(6,\)"),
        ({"state": [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]}, "has fallen"),
        ({"slope": [0.1, 0.1, 0.1]}, r"options\['slope'\] must have shape \(\)"),
        ({"slope": 2.0}, "slope must be an angle"),
    ],
)
def test_impossible_resets_are_refused_and_change_nothing(entry_point, options, message):
    env = ENTRY_POINTS[entry_point]().unwrapped
    env.reset(seed=0)
    states = env.batch.states
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    np.testing.assert_array_equal(env.batch.states, states)
    env.step(np.zeros(env.action_space.shape))


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        ("a", "seed must be a whole number from 0 on, a row of them, or None"),
        (1.5, "seed must be a whole number from 0 on, a row of them, or None"),
        ([1, 2, 3], "3 seeds for 2"),
        ([-1, 2], r"seed\[0\]"),
        ([1, 2.5], r"seed\[1\]"),
        ([None, "a"], r"seed\[1\]"),
    ],
)
def test_a_batch_is_seeded_by_whole_numbers(seed, message):
    with pytest.raises(ValueError, match=message):
        BATCHES["make_vec"]().reset(seed=seed)


ONE = r"one finite number \(beyond -1 and 1 it is clipped\)"
TWO = r"finite numbers of push_off, hip \(beyond -1 and 1 it is clipped\)"


def but(count, place, value):
    """Actions of a batch, of which one is a value."""
    acts = np.zeros((count, 1), np.float32)
    acts[place] = value
    return acts


@pytest.mark.parametrize(
    ("count", "actions", "given", "said"),
    [
        (0, ("hip",), np.array([np.nan]), f"^the action must be {ONE}, not nan$"),
        (0, ("hip",), np.array([-np.inf], np.float32), f"^the action must be {ONE}, not -inf$"),
        (0, ("hip",), "right", f"^the action must be {ONE}, not right$"),
        (0, ("hip",), 0.0, r"shape \(1,\)"),
        (0, ("hip",), np.zeros(2), r"shape \(1,\)"),
        (0, ("hip",), np.zeros((1, 1)), r"shape \(1,\)"),
        (0, ("hip",), np.zeros(0), r"shape \(1,\)"),
        (0, ("push_off", "hip"), np.array([0.5, np.nan]),
         rf"^the action must be {TWO}, not \[0.5 nan\]$"),
        (0, ("push_off", "hip"), np.array([0.1]), r"shape \(2,\)"),
        (3, ("hip",), but(3, 1, np.inf), f"^the action of environment 1 must be {ONE}, not inf$"),
        (3, ("hip",), but(3, 2, -np.inf), f"^the action of environment 2 must be {ONE}, not -inf$"),
        (2000, ("hip",), but(2000, 2, np.nan), "of environment 2 must be"),
        (2100, ("hip",), but(2100, 2, np.nan), "of environment 2 must be"),
        (3, ("hip",), np.full((3, 1), "right"), ONE),
        (3, ("hip",), np.zeros(3), "must have shape"),
    ],
)  # fmt: skip
def test_a_wrong_action_is_named_and_changes_nothing(count, actions, given, said, assert_same):
    make = (lambda **scene: gym.make_vec(ID, num_envs=count, **scene)) if count else SINGLE["make"]
    env = make(actions=actions).unwrapped
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(ValueError, match=said):
        env.step(given)
    assert_same(env.get_state(), before)


@pytest.mark.parametrize("entry_point", ["make", "make_vec"])
def test_actions_beyond_the_bounds_are_clipped(entry_point):
    most, more = ENTRY_POINTS[entry_point](), ENTRY_POINTS[entry_point]()
    for env in (most, more):
        env.reset(seed=0)
    full = np.ones(most.action_space.shape)
    for sign in (1.0, -1.0):
        np.testing.assert_array_equal(most.step(sign * full)[0], more.step(7.0 * sign * full)[0])


@pytest.mark.parametrize("limit", [1, 2, np.int64(3)])
@pytest.mark.parametrize("entry_point", BATCHES)
def test_episodes_have_as_many_steps_as_their_limit(entry_point, limit):
    env = BATCHES[entry_point](max_episode_steps=limit)
    env.reset()
    inner = getattr(env, "envs", env)
    assert inner.batch.step_limit == float(limit)
    for k in range(limit):
        assert not inner.batch.ledger["truncated"].any()
        done = env.step(np.zeros((2, 1)))[2 if entry_point == "stable-baselines3" else 3]
        assert done.all() == (k + 1 == limit)


def eight(step):
    """As many numbers as the environment's own observation has, which none bounds."""
    return [step.distance] * 8


@pytest.mark.parametrize("entry_point", ["make", "make_vec"])
def test_a_scene_changes_by_name_by_arguments_and_by_both(entry_point):
    env = ENTRY_POINTS[entry_point]().unwrapped
    for given, changes, expected in (
        (None, {"slope": 0.02}, make_scene("level", slope=0.02)),
        (None, {"friction": 0.5}, make_scene("level", slope=0.02, friction=0.5)),
        ("lab", {}, make_scene("lab")),
        ({"slope": 0.01}, {"tick": 0.2}, make_scene(slope=0.01, tick=0.2)),
        (make_scene("lab"), {"slope": 0.03}, make_scene("lab", slope=0.03)),
    ):
        env.set_scene(given, **changes)
        if entry_point == "make_vec":
            assert env.scene != expected  # until the next reset
        seen, _ = env.reset(seed=0)
        assert env.scene == expected == env.batch.scene
        assert env.metadata["render_fps"] == expected.frames_per_second
        assert np.atleast_2d(seen)[0, 7] == np.float32(expected.slope)
    before = env.scene
    for changes, said in (
        ({"command": 0.1}, "keeps its 8 numbers of observation .* has 9 and"),
        ({"actions": ("hip", "push_off")}, r"its actions \('hip',\), and .*\('hip', 'push_off'\)"),
        ({"observation": eight}, "8 numbers .* has 8 within other bounds"),
        ({"tick": -1.0}, "tick must be"),
    ):
        with pytest.raises(ValueError, match=said):
            env.set_scene(**changes)
        assert env.scene is before
        env.step(np.zeros(env.action_space.shape))
