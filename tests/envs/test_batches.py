"""Walkers that all differ, side by side, keep to themselves: nobody's numbers become another's."""

import copy
import threading

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from gym_passive_walker import WALKERS, interpolate
from gym_passive_walker.engine import run
from gym_passive_walker.engine.layout import NARROW, history_for, record_for
from gym_passive_walker.envs import ticks
from gym_passive_walker.envs.task import ledger_for, rules_for
from gym_passive_walker.envs.transitions import note_for
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
    """A batch in which each walker differs from its neighbours."""
    places = range(count)
    return PassiveWalkerVectorEnv(
        count, walkers=[shape(i) for i in places], slopes=[ground(i) for i in places],
        start=START, **arguments,
    )  # fmt: skip


def some(count, size=1.0, seed=0):
    """Actions of a step, (count, 1)."""
    return np.random.default_rng(seed).uniform(-size, size, (count, 1))


def test_a_batch_reports_every_fall_wherever_it_happens():
    """Falls are the same in whatever piece of the batch a walker is."""
    many = PassiveWalkerVectorEnv(4096, "level", threads=2, reset_noise_scale=0.0)
    standing = [0.3, -0.3, -0.3, -1.3, -0.75, -1.2]
    lying = [0.01, -0.01, -0.01, -0.1, 0.0, 0.0]
    for fallen in (3, 2047, 4095):
        states = np.array([standing] * 4096)
        states[fallen] = lying
        many.reset(seed=0, options={"state": states, "slope": 0.03})
        for _ in range(60):
            _, _, terminated, _, infos = many.step(np.zeros((4096, 1)))
            if terminated.any():
                break
        assert np.flatnonzero(terminated).tolist() == [fallen]
        assert infos["outcome"][fallen] not in ("", "heelstrike")
        act = np.zeros((4096, 1))
        act[fallen] = np.nan  # it is being reset: its action is nobody's
        many.step(act)


def test_a_thread_sets_up_its_working_memory_once(monkeypatch):
    """Set up for each piece of a batch, it took longer than the step."""
    many, threads = PassiveWalkerVectorEnv(4096, "level", threads=2), []
    many.reset(seed=0)

    def counted(*arguments, **options):
        threads.append(threading.get_ident())
        return usual(*arguments, **options)

    usual = run.workspace
    for module in (run, ticks):
        monkeypatch.setattr(module, "workspace", counted)
    for _ in range(5):
        many.step(some(4096))
    assert len(threads) == len(set(threads))


def test_where_some_are_asked_to_start_is_where_they_start():
    """Options have an entry for each environment, also for those that are not reset."""
    many = mixed(5, autoreset_mode="Disabled", reset_noise_scale=0.0)
    many.reset(seed=1)
    before, slopes = many.states, np.array([0.06, 0.07, 0.08, 0.09, 0.1])
    states = np.array(START) * np.linspace(0.8, 1.0, 5)[:, None]
    mask = np.array([False, True, False, True, True])
    many.reset(options={"reset_mask": mask, "slope": slopes, "state": states})
    np.testing.assert_array_equal(many.slopes[mask], slopes[mask])
    np.testing.assert_allclose(many.states[mask], states[mask], rtol=1e-14)
    np.testing.assert_array_equal(many.states[~mask], before[~mask])
    np.testing.assert_array_equal(many.slopes[~mask], [ground(0), ground(2)])


def test_each_starts_with_its_own_gait_at_a_slope_that_it_is_asked_for():
    walkers = ["C", "lab", "C"]
    many = PassiveWalkerVectorEnv(3, walkers=walkers, slope=0.036, reset_noise_scale=0.0)
    many.reset(seed=0, options={"slope": [0.03, 0.04, 0.05]})
    for i, slope in enumerate((0.03, 0.04, 0.05)):
        alone = PassiveWalkerVectorEnv(1, walker=walkers[i], slope=slope, reset_noise_scale=0.0)
        alone.reset(seed=0)
        np.testing.assert_array_equal(many.states[i], alone.states[0])


def test_a_state_that_is_given_is_that_of_the_walker_that_is_drawn():
    """A varied walker has time units of its own."""
    many = PassiveWalkerVectorEnv(4, "level", domain_randomization=VARIED)
    many.reset(seed=0)
    for _ in range(3):
        state = [0.2, -0.2, -0.25, -1.0, -0.5, -1.0]
        many.reset(options={"state": state})
        np.testing.assert_allclose(many.states, [state] * 4, rtol=1e-14)


def test_only_the_walkers_of_a_mask_walk_on_other_ground():
    still, moved = (PassiveWalkerVectorEnv(3, "lab", control="stride") for _ in range(2))
    for many in (still, moved):
        many.reset(seed=3)
    moved.set_slopes([0.05, 0.02, 0.03], np.array([False, True, False]))
    expected, found = (many.step(np.zeros((3, 1)))[0] for many in (still, moved))
    np.testing.assert_array_equal(found[[0, 2]], expected[[0, 2]])
    assert np.abs(found[1, :6] - expected[1, :6]).max() > 1e-3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_varied_walkers_go_on_where_they_were_saved(mode, assert_same):
    """A state that is restored into a batch of other walkers has their shapes too."""

    def many(seed):
        made = PassiveWalkerVectorEnv(
            6, "lab", domain_randomization=VARIED, max_episode_steps=12, autoreset_mode=mode
        )
        made.reset(seed=seed)
        return made

    def rest(walkers):
        walk = []
        for k in range(40):
            walk.append(walkers.step(some(6, seed=k)))
            walk.append((walkers.states, [walkers.batch.contact(i) for i in range(6)]))
        return walk

    first, other = many(0), many(100)
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


def test_environments_that_need_a_reset_are_waited_for_though_others_are_reset():
    many = PassiveWalkerVectorEnv(3, autoreset_mode="Disabled", max_episode_steps=2)
    many.reset(seed=0)
    for _ in range(2):
        _, _, _, truncated, _ = many.step(np.zeros((3, 1)))
    assert truncated.all()
    saved = many.get_state()
    for _ in range(2):  # when that was saved and put back, too
        many.reset(options={"reset_mask": np.array([True, False, True])})
        with pytest.raises(ResetNeeded):
            many.step(np.zeros((3, 1)))
        many.reset(options={"reset_mask": np.array([False, True, False])})
        many.step(np.zeros((3, 1)))
        assert saved["ended"].all()
        many.set_state(saved)


def test_walkers_and_slopes_that_were_returned_do_not_change_afterwards():
    many = PassiveWalkerVectorEnv(3, "rolling", domain_randomization=VARIED)
    many.reset(seed=0)
    reported = many.slopes, many.walkers, many.states
    kept = copy.deepcopy(reported)
    many.reset()
    np.testing.assert_array_equal(reported[0], kept[0])
    assert reported[1] == kept[1] != many.walkers
    np.testing.assert_array_equal(reported[2], kept[2])


def test_pictures_show_each_walker_on_its_own_slope():
    pytest.importorskip("pygame")
    many = PassiveWalkerVectorEnv(3, "lab", render_mode="rgb_array", reset_noise_scale=0.0)
    state = [0.2, -0.2, -0.25, -1.0, -0.5, -1.0]
    many.reset(seed=0, options={"state": state, "slope": [0.02, 0.3, 0.02]})
    first, steep, third = (frame[40:] for frame in many.render())  # below the walker's number
    assert np.array_equal(first, third) and not np.array_equal(first, steep)
    many.close()


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


@pytest.mark.parametrize("made", [record_for, history_for, ledger_for, rules_for, note_for])
def test_the_type_of_a_layout_s_arrays_is_made_once(made):
    """Compiled code would be looked up again for each new one."""
    assert made(NARROW) is made(NARROW)
