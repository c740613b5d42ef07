"""Walkers that all differ, side by side, keep to themselves: nobody's numbers become another's."""

import copy

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import SyncVectorEnv

from gym_passive_walker import WALKERS, interpolate, rough
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

START = (0.3, -0.3, -0.3, -0.42, -0.25, -0.4)
VARIED = {"foot_radius": 0.2, "thigh_length": 0.2, "shank_mass": 0.3}


def shape(place):
    """A walker for a place: next to each other they differ in size, feet and masses."""
    walker = interpolate(WALKERS["C"], WALKERS["lab"], (place % 37) / 36.0)
    return {**vars(walker), "gravity": 1.0 + place % 11}


def ground(place):
    """A slope for a place."""
    return 0.01 + 0.002 * (place % 23)


def mixed(count, **arguments):
    """A crowd in which everyone differs from the neighbours."""
    places = range(count)
    return PassiveWalkerVectorEnv(
        count, walkers=[shape(i) for i in places], slopes=[ground(i) for i in places],
        start=START, **arguments,
    )  # fmt: skip


def some(count, size=1.0, seed=0):
    """Actions of a step, (count, 1)."""
    return np.random.default_rng(seed).uniform(-size, size, (count, 1))


@pytest.mark.parametrize(
    ("count", "threads", "befalls"),
    [(60, 1, {}), (2304, 1, {}), (4608, 2, {}), (4608, 2, {"terrain": rough(0.002)})],
)
def test_walkers_that_all_differ_walk_in_a_crowd_as_each_does_alone(
    count, threads, befalls, assert_same
):
    crowd = mixed(count, threads=threads, max_episode_steps=35, reset_noise_scale=0.3, **befalls)
    places = [*range(0, count, count // 6 + 1), count // 2, count - 1]

    def single(place):
        return lambda: gymnasium.make(
            ID, walker=shape(place), slope=ground(place), start=START,
            max_episode_steps=35, reset_noise_scale=0.3, **befalls,
        )  # fmt: skip

    alone = SyncVectorEnv([single(place) for place in places])
    seen, _ = crowd.reset(seed=5)
    assert_same(seen[places], alone.reset(seed=[5 + place for place in places])[0])
    ended = 0
    for k in range(80):
        act = some(count, seed=k)
        *mine, infos = crowd.step(act)
        *theirs, their_infos = alone.step(act[places])
        assert_same([x[places] for x in mine], theirs)
        for name, told in their_infos.items():
            if name.startswith("_"):
                assert_same(infos[name][places], told)
            else:
                who = their_infos["_" + name]
                assert list(infos[name][places][who]) == list(told[who])
        ended += int((theirs[2] | theirs[3]).sum())
        for place, env in zip(places, alone.envs, strict=True):
            walker = env.unwrapped
            np.testing.assert_array_equal(crowd.states[place], walker.state)
            assert crowd.slopes[place] == walker.slope
            assert crowd.batch.contact(place).x == walker.contact
    assert ended > len(places)


def test_a_crowd_tells_of_every_fall_wherever_it_happens():
    """Who falls is the same for each walker, whatever piece of the crowd it is in."""
    crowd = PassiveWalkerVectorEnv(4096, "level", threads=2, reset_noise_scale=0.0)
    standing = [0.3, -0.3, -0.3, -1.3, -0.75, -1.2]
    lying = [0.01, -0.01, -0.01, -0.1, 0.0, 0.0]
    for fallen in (3, 2047, 4095):
        states = np.array([standing] * 4096)
        states[fallen] = lying
        crowd.reset(seed=0, options={"state": states, "slope": 0.03})
        for _ in range(60):
            _, _, terminated, _, infos = crowd.step(np.zeros((4096, 1)))
            if terminated.any():
                break
        assert np.flatnonzero(terminated).tolist() == [fallen]
        assert infos["outcome"][fallen] is not None and infos["_outcome"][fallen]
        act = np.zeros((4096, 1))
        act[fallen] = np.nan  # it is being reset: its action is nobody's
        crowd.step(act)


def test_where_some_are_asked_to_start_is_where_they_start():
    """Options have an entry for each environment, whoever is reset by them."""
    crowd = mixed(5, autoreset_mode="Disabled", reset_noise_scale=0.0)
    crowd.reset(seed=1)
    before, slopes = crowd.states, np.array([0.06, 0.07, 0.08, 0.09, 0.1])
    states = np.array(START) * np.linspace(0.8, 1.0, 5)[:, None]
    mask = np.array([False, True, False, True, True])
    crowd.reset(options={"reset_mask": mask, "slope": slopes, "state": states})
    np.testing.assert_array_equal(crowd.slopes[mask], slopes[mask])
    np.testing.assert_allclose(crowd.states[mask], states[mask], rtol=1e-14)
    np.testing.assert_array_equal(crowd.states[~mask], before[~mask])
    np.testing.assert_array_equal(crowd.slopes[~mask], [ground(0), ground(2)])


def test_each_starts_with_its_own_gait_at_a_slope_that_it_is_asked_for():
    walkers = ["C", "lab", "C"]
    crowd = PassiveWalkerVectorEnv(3, walkers=walkers, slope=0.036, reset_noise_scale=0.0)
    crowd.reset(seed=0, options={"slope": [0.03, 0.04, 0.05]})
    for i, slope in enumerate((0.03, 0.04, 0.05)):
        alone = PassiveWalkerVectorEnv(1, walker=walkers[i], slope=slope, reset_noise_scale=0.0)
        alone.reset(seed=0)
        np.testing.assert_array_equal(crowd.states[i], alone.states[0])


def test_a_state_that_is_given_is_that_of_the_walker_that_is_drawn():
    """A varied walker has time units of its own."""
    crowd = PassiveWalkerVectorEnv(4, "level", domain_randomization=VARIED)
    crowd.reset(seed=0)
    for _ in range(3):
        state = [0.2, -0.2, -0.25, -1.0, -0.5, -1.0]
        crowd.reset(options={"state": state})
        np.testing.assert_allclose(crowd.states, [state] * 4, rtol=1e-14)


def test_only_the_walkers_of_a_mask_walk_on_other_ground():
    still, moved = (PassiveWalkerVectorEnv(3, "lab", control="stride") for _ in range(2))
    for crowd in (still, moved):
        crowd.reset(seed=3)
    moved.set_slopes([0.05, 0.02, 0.03], np.array([False, True, False]))
    expected, found = (crowd.step(np.zeros((3, 1)))[0] for crowd in (still, moved))
    np.testing.assert_array_equal(found[[0, 2]], expected[[0, 2]])
    assert np.abs(found[1, :6] - expected[1, :6]).max() > 1e-3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_varied_walkers_go_on_where_they_were_saved(mode, assert_same):
    """Into a crowd of other walkers, their shapes are put back with their motion."""

    def crowd(seed):
        made = PassiveWalkerVectorEnv(
            6, "lab", domain_randomization=VARIED, max_episode_steps=12, autoreset_mode=mode
        )
        made.reset(seed=seed)
        return made

    def rest(walkers):
        course = []
        for k in range(40):
            course.append(walkers.step(some(6, seed=k)))
            course.append((walkers.states, [walkers.batch.contact(i) for i in range(6)]))
        return course

    first, other = crowd(0), crowd(100)
    for k in range(12):  # the time limit has just come, and NextStep waits for its resets
        first.step(some(6, seed=100 + k))
    saved = first.get_state()
    kept = copy.deepcopy(saved)
    expected = rest(first)
    assert_same(saved, kept)  # what was saved is the caller's
    other.set_state(saved)
    assert other.walkers == kept["walkers"]
    assert_same(rest(other), expected)
    assert_same(saved, kept)  # ... and stays so when it was put back


def test_a_saved_single_walker_is_the_callers_to_keep(make, assert_same):
    env = make(scene="lab", domain_randomization=VARIED)
    env.reset(seed=0)
    env.step(np.zeros(1))
    saved = env.get_state()
    kept = copy.deepcopy(saved)
    env.step(np.ones(1))
    env.reset()
    assert_same(saved, kept)


def test_an_episode_that_had_ended_when_it_was_saved_has_ended_when_it_is_put_back(make):
    env = make(scene="lab")
    env.reset(seed=0, options={"state": [0.01, -0.01, -0.01, -0.1, 0.0, 0.0]})
    while not env.step(np.ones(1))[2]:
        pass
    saved, other = env.get_state(), make(scene="lab")
    other.reset(seed=1)
    other.set_state(saved)
    with pytest.raises(ResetNeeded):
        other.step(np.zeros(1))


def test_who_waits_for_a_reset_is_waited_for_though_others_are_reset():
    crowd = PassiveWalkerVectorEnv(3, autoreset_mode="Disabled", max_episode_steps=2)
    crowd.reset(seed=0)
    for _ in range(2):
        _, _, _, truncated, _ = crowd.step(np.zeros((3, 1)))
    assert truncated.all()
    saved = crowd.get_state()
    for _ in range(2):  # when that was saved and put back, too
        crowd.reset(options={"reset_mask": np.array([True, False, True])})
        with pytest.raises(ResetNeeded):
            crowd.step(np.zeros((3, 1)))
        crowd.reset(options={"reset_mask": np.array([False, True, False])})
        crowd.step(np.zeros((3, 1)))
        assert saved["ended"].all()
        crowd.set_state(saved)


def test_what_was_told_of_walkers_and_slopes_does_not_change_afterwards():
    crowd = PassiveWalkerVectorEnv(3, "rolling", domain_randomization=VARIED)
    crowd.reset(seed=0)
    told = crowd.slopes, crowd.walkers, crowd.states
    kept = copy.deepcopy(told)
    crowd.reset()
    np.testing.assert_array_equal(told[0], kept[0])
    assert told[1] == kept[1] != crowd.walkers
    np.testing.assert_array_equal(told[2], kept[2])


def test_each_lane_of_a_learner_tells_its_own_walker():
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    env = PassiveWalkerVecEnv(3, "rolling", seed=2)
    env.reset()
    states, slopes = env.get_attr("state"), env.get_attr("slope")
    np.testing.assert_array_equal(states, env.batch.states)
    np.testing.assert_array_equal(slopes, env.batch.ledger["slope"])
    assert len({tuple(state) for state in states}) == len(set(slopes)) == 3


def test_pictures_show_each_walker_on_its_own_slope():
    pytest.importorskip("pygame")
    crowd = PassiveWalkerVectorEnv(3, "lab", render_mode="rgb_array", reset_noise_scale=0.0)
    state = [0.2, -0.2, -0.25, -1.0, -0.5, -1.0]
    crowd.reset(seed=0, options={"state": state, "slope": [0.02, 0.3, 0.02]})
    first, steep, third = (frame[40:] for frame in crowd.render())  # below the walker's number
    assert np.array_equal(first, third) and not np.array_equal(first, steep)
    crowd.close()


def test_pictures_show_the_walker_of_the_episode(make):
    pytest.importorskip("pygame")
    env = make(scene="lab", render_mode="rgb_array", domain_randomization={"foot_radius": 0.5})
    for seed in (1, 2):
        env.reset(seed=seed)
        shown = env.render()
        own = make(scene="lab", walker=vars(env.walker), render_mode="rgb_array")
        own.reset(seed=0, options={"state": env.state})
        assert np.array_equal(own.render(), shown)
        own.close()
    env.close()
