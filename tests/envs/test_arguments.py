"""What makes no sense is refused with a sentence, whichever door it comes in by."""

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw

ID = "PassiveWalker-v0"
LAB = {
    "thigh_length": 0.35, "thigh_mass": 2.345, "thigh_com": 0.091, "thigh_gyration": 0.099,
    "shank_length": 0.46, "shank_mass": 1.013, "shank_com": 0.17, "shank_gyration": 0.197,
}  # fmt: skip


def for_learners(**told):
    """A crowd for stable-baselines3, where that is installed."""
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    return PassiveWalkerVecEnv(**{"num_envs": 2, **told})


SINGLE = {"make": lambda **told: gym.make(ID, **told)}
CROWDS = {
    "make_vec": lambda **told: gym.make_vec(ID, **{"num_envs": 2, **told}),
    "stable-baselines3": for_learners,
}
DOORS = SINGLE | CROWDS


@pytest.mark.parametrize("count", [-1, 0, 1.5, "3", None, True, np.nan, [2]], ids=repr)
@pytest.mark.parametrize("door", CROWDS)
def test_a_crowd_is_a_whole_number_of_walkers(door, count):
    with pytest.raises(ValueError, match="num_envs must be a whole number from 1 on, not"):
        CROWDS[door](num_envs=count)


@pytest.mark.parametrize("limit", ["a", 2.5, 0, -2, True, np.nan], ids=repr)
@pytest.mark.parametrize("door", CROWDS)
def test_episodes_end_after_a_whole_number_of_steps_or_never(door, limit):
    with pytest.raises(ValueError, match=r"max_episode_steps must be a whole .* None or -1"):
        CROWDS[door](max_episode_steps=limit)


@pytest.mark.parametrize("threads", ["a", 0, 1.5], ids=repr)
@pytest.mark.parametrize("door", CROWDS)
def test_threads_are_a_whole_number(door, threads):
    with pytest.raises(ValueError, match="threads must be a whole number"):
        CROWDS[door](threads=threads)


@pytest.mark.parametrize("name", ["walkers", "slopes"])
@pytest.mark.parametrize("row", [3, [], ["lab"]], ids=repr)
@pytest.mark.parametrize("door", CROWDS)
def test_what_each_has_of_its_own_comes_in_a_row(door, name, row):
    with pytest.raises(ValueError, match=f"{name} must be in a row, one for each of 2"):
        CROWDS[door](**{name: row})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shank_mass": "3"}, "shank_mass must be a number, not '3'"),
        ({"thigh_len": 0.4}, r"a walker has no thigh_len \(thigh_length\?\)"),
        ({1: 2}, "a walker has no 1|keywords must be strings"),
        ({"shank_com": 17.0}, "shank_com must be at most two leg lengths, 1.62"),
    ],
)
@pytest.mark.parametrize("door", DOORS)
def test_what_is_no_walker_does_not_come_in(door, change, message):
    for walker in (LAB | change, {"preset": "lab"} | change):
        with pytest.raises(gpw.WalkerError, match=message):
            DOORS[door](walker=walker)


@pytest.mark.parametrize("walker", [None, 3, "Lab", []], ids=repr)
@pytest.mark.parametrize("door", DOORS)
def test_an_unknown_walker_is_answered_with_the_known_ones(door, walker):
    with pytest.raises(gpw.WalkerError, match=r"no walker .* lab-straight"):
        DOORS[door](walker=walker)


@pytest.mark.parametrize("door", ["make", "make_vec"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({1: 2, "a": 3}, "reset has no 1, a; it has state, slope"),
        ({"slop": 0.1}, r"reset has no slop \(slope\?\)"),
        (5, "options must map names to values, not 5"),
        ({"state": np.zeros((3, 6))}, r"options\['state'\] must have shape \(6,\)"),
        ({"slope": [0.1, 0.1, 0.1]}, r"options\['slope'\] must have shape \(\)"),
    ],
)
def test_a_reset_says_what_it_can_be_asked_for(door, options, message):
    with pytest.raises(ValueError, match=message):
        DOORS[door]().reset(options=options)


@pytest.mark.parametrize("seed", ["a", 1.5])
def test_a_crowd_is_seeded_by_whole_numbers(seed):
    with pytest.raises(
        ValueError, match="seed must be a whole number from 0 on, a row of them, or None"
    ):
        CROWDS["make_vec"]().reset(seed=seed)


@pytest.mark.parametrize("door", ["make", "make_vec"])
def test_an_action_that_is_no_number_is_told_what_becomes_of_large_ones(door):
    env = DOORS[door]()
    env.reset(seed=0)
    for wrong in (np.nan, np.inf, "right"):
        with pytest.raises(
            ValueError, match=r"one finite number \(beyond -1 and 1 it is clipped\)"
        ):
            env.unwrapped.step(np.full(env.action_space.shape, wrong))


@pytest.mark.parametrize("door", ["make", "make_vec"])
def test_actions_beyond_the_bounds_are_clipped(door):
    most, more = DOORS[door](), DOORS[door]()
    for env in (most, more):
        env.reset(seed=0)
    full = np.ones(most.action_space.shape)
    for sign in (1.0, -1.0):
        np.testing.assert_array_equal(most.step(sign * full)[0], more.step(7.0 * sign * full)[0])
