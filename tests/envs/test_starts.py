"""Episodes start near the passive gait."""

from dataclasses import replace
from zlib import crc32

import numpy as np
import pytest

from gym_passive_walker import WALKERS, WalkerError, find_gait
from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes import rules, starts
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, SceneError, make_scene
from gym_passive_walker.gaits.scenes.starts import (
    REFERENCE_SLOPES,
    gait_near,
    known_gaits,
    searched_gait,
)
from tests.own.statements import DRIVEN


def begun(scene, count=200, seed=0):
    """Walkers at the start of their episodes."""
    batch = Batch(scene, count)
    batch.randoms = [np.random.default_rng((seed, i)) for i in range(count)]
    batch.start(range(count), np.empty(count * rules.SIZE, np.float32))
    return batch


def draws(scene, count=200, seed=0):
    """Slopes and dimensionless states at the start of episodes."""
    batch = begun(scene, count, seed)
    return np.column_stack([batch.ledger["slope"], batch.records["state"][:, 0]])


@pytest.mark.parametrize("name", ["A", "C", "D", "lab"])
def test_without_perturbation_the_start_is_the_passive_gait(name):
    walker, slope = WALKERS[name], 0.036 if name == "lab" else 0.009
    (start,) = draws(Scene(walker=name, slope=slope, reset_noise_scale=0.0), 1)
    gait = find_gait(walker, slope).state.copy()
    gait[3:] *= walker.time_unit
    assert start[0] == slope
    np.testing.assert_allclose(start[1:], gait, rtol=1e-14)


def test_where_no_gait_exists_the_start_is_that_of_a_gentle_slope():
    gentle = gait_near(WALKERS["C"], REFERENCE_SLOPES[0])
    assert gait_near(WALKERS["C"], 0.0) == gait_near(WALKERS["C"], -0.2) == gentle
    assert gait_near(WALKERS["lab"], 0.11) == gait_near(WALKERS["lab"], 0.09)


def test_the_knee_of_every_start_opens():
    states = draws(Scene(slope=0.001, reset_noise_scale=0.5))[:, 1:]
    assert np.all(states[:, 2] == states[:, 1]) and np.all(states[:, 5] <= states[:, 4])


def test_slopes_are_drawn_from_their_range_and_gaits_go_with_them():
    scene = Scene(slope=(0.01, 0.06), reset_noise_scale=0.0)
    slopes, angles = draws(scene)[:, :2].T
    assert 0.01 <= slopes.min() < 0.011 and 0.059 < slopes.max() <= 0.06
    order = np.argsort(slopes)
    assert np.all(np.diff(angles[order]) > 0.0)  # the steeper, the longer the step
    middle = np.argmin(abs(slopes - 0.04))
    exact = find_gait("C", slopes[middle]).state[0]
    assert angles[middle] == pytest.approx(exact, rel=5e-3)


def test_a_start_may_be_given_instead():
    start = (0.2, -0.2, -0.2, -0.3, -0.1, -0.4)
    (drawn,) = draws(Scene(start=start, reset_noise_scale=0.0), 1)
    assert tuple(drawn[1:]) == start


def test_a_walker_without_any_gait_says_so(monkeypatch):
    monkeypatch.setattr(starts, "known_gaits", dict)
    monkeypatch.setattr(starts, "searched_gait", lambda *_: None)
    with pytest.raises(SceneError, match="give the scene a start"):
        gait_near(WALKERS["C"], 0.0)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ([0.2, -0.2, -0.2], "6 finite numbers"),
        ([0.2, -0.2, -0.2, -1.0, float("nan"), 0.0], "6 finite numbers"),
        ([1.6, -0.2, -0.2, -1.0, 0.0, 0.0], "has fallen"),
        ([0.2, -0.2, -0.1, -1.0, 0.0, 0.0], "bends the knee backwards"),
    ],
)
def test_what_is_no_upright_walker_is_refused(state, message):
    with pytest.raises(ValueError, match=message):
        WALKERS["C"].checked_state(state)


@pytest.mark.parametrize("name", [name for name, walker in WALKERS.items() if walker.knees])
def test_a_state_just_after_heelstrike_is_a_start_though_its_knee_would_bend_too_far(name):
    state = find_gait(name, 0.036).state.copy()
    state[5] = state[4] + 0.1
    assert WALKERS[name].checked_state(state.tolist())[:3] == tuple(state[:3])


def test_a_start_is_given_in_the_walkers_units_and_kept_dimensionless():
    walker, state = WALKERS["lab"], find_gait("lab", 0.036).state
    own = walker.units.to_dimensionless(state)
    np.testing.assert_allclose(walker.checked_state(state), own, rtol=1e-14)
    assert not np.allclose(own[3:], state[3:])


def test_the_shank_of_a_straight_leg_is_ignored():
    state = WALKERS["A"].checked_state([0.2, -0.2, 9.0, -1.0, 0.5, 9.0])
    assert state[2] == state[1] and state[5] == state[4]


def test_the_gaits_that_scenes_start_with_are_those_that_a_search_finds():
    known = known_gaits()
    assert len(known) > 10
    for (walker, slope), state in known.items():
        found = searched_gait(walker, slope)
        assert (found is None) == (state is None)
        if state is not None:
            assert state == pytest.approx(found, rel=1e-11, abs=1e-12)


def test_a_named_scene_starts_without_a_search(monkeypatch):
    def search(*_):
        raise AssertionError("a search")

    monkeypatch.setattr(starts, "searched_gait", search)
    for name in SCENES:
        starts.Starts(make_scene(name)).states(np.array([0.0]))


def drawn_by_hand(scene, key):
    """The first valid walker of a key's streams, one for each parameter."""
    for attempt in range(100):
        changed = {}
        for name, share in scene.domain_randomization.items():
            draw = uniform(key, attempt, crc32(name.encode()))
            low, high = 1.0 - share, 1.0 + share
            changed[name] = getattr(scene.walker, name) * (low + (high - low) * draw)
        try:
            return replace(scene.walker, **changed)
        except WalkerError:
            continue


LARGE_FEET = {
    "preset": "C", "foot_angle": 0.0, "foot_radius": 0.95 * WALKERS["C"].shank_length,
}  # fmt: skip


@pytest.mark.parametrize("walker", ["C", LARGE_FEET], ids=["C", "large feet"])
def test_a_walker_that_cannot_be_is_drawn_again(walker):
    """A foot as large as the shank is invalid: every third draw."""
    shares = {"thigh_mass": 0.2, "foot_radius": 0.5}
    scene = Scene(walker=walker, start=(0.2, -0.2, -0.2, -0.3, -0.1, -0.4),
                  domain_randomization=shares)  # fmt: skip
    own = starts.Starts(scene)
    for key in range(30):
        assert own.randomization.draw(key).walker == drawn_by_hand(scene, key)
    assert own.walker == scene.walker  # the nominal one


def test_a_pool_is_of_walkers_drawn_by_their_numbers():
    shares = {"foot_radius": 0.2, "shank_mass": 0.1}
    scene = Scene(slope=0.02, domain_randomization=shares, randomization_pool=3)
    pool = [drawn_by_hand(scene, word(word(1999, 201), k)) for k in range(3)]
    drawing = starts.Starts(scene).randomization
    assert [drawing.member(k).walker for k in range(3)] == pool
    walkers = begun(scene, 60).walkers
    counts = [walkers.count(each) for each in pool]
    assert sum(counts) == 60 and min(counts) > 8
    alone = Scene(slope=0.02, domain_randomization=shares, randomization_pool=1)
    assert {*begun(alone, 5).walkers} == {pool[0]}


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_shares_of_zero_draw_the_nominal_walker(share):
    scene = Scene(slope=0.02, domain_randomization={"foot_radius": 0.0, "shank_mass": share})
    walkers = begun(scene, 4).walkers
    assert {walker.foot_radius for walker in walkers} == {WALKERS["C"].foot_radius}
    assert len({walker.shank_mass for walker in walkers}) == (1 if share == 0.0 else 4)


def test_nodes_of_a_range_are_its_gaits_at_equal_distances():
    own = starts.Starts(Scene(slope=(0.01, 0.04)))
    np.testing.assert_allclose(own.node_slopes, [0.01 + 0.0025 * k for k in range(13)], rtol=1e-14)
    slopes, states = own.nodes
    assert slopes.tolist() == own.node_slopes and states.shape == (13, 6)
    for k in (0, 5, 12):
        gait = WALKERS["C"].units.to_dimensionless(find_gait("C", slopes[k]).state)
        np.testing.assert_allclose(states[k], gait, rtol=1e-9, atol=1e-10)
    asked = np.array([0.04, 0.011, 0.0333, 0.01, 0.0225])
    expected = [np.interp(asked, slopes, column) for column in states.T]
    np.testing.assert_allclose(own.states(asked), np.transpose(expected), rtol=1e-13)
    np.testing.assert_allclose(own.slopes(np.array([0.0, 0.25, 1.0])), [0.01, 0.0175, 0.04])


@pytest.mark.parametrize("slope", [0.02, (0.02, 0.02)])
def test_a_single_slope_is_drawn_whatever_the_share(slope):
    own = starts.Starts(Scene(slope=slope))
    assert own.slopes(np.array([0.0, 0.5, 1.0])).tolist() == [0.02] == own.node_slopes
    assert own.states(np.array([0.02] * 3)).shape == (1, 6)
    other = starts.Starts(Scene(slope=slope), WALKERS["lab"], 0.036)
    assert other.walker == WALKERS["lab"] and other.node_slopes == [0.036]
    np.testing.assert_array_equal(other.states(np.zeros(1))[0], gait_near(WALKERS["lab"], 0.036))


@pytest.mark.parametrize(
    ("entry", "limit", "name"),
    [(0, np.pi / 2, "A"), (0, np.pi / 2, "C"), (1, np.pi, "A"), (1, np.pi, "C"), (2, np.pi, "C")],
)
def test_angles_of_a_start_are_below_their_limits(entry, limit, name):
    state = [0.1, -0.1, -0.2, -1.0, 0.0, 0.0]
    for sign in (-1.0, 1.0):
        for value, valid in ((np.nextafter(limit, 0.0), True), (limit, False)):
            given = [*state]
            given[entry] = sign * value
            if entry == 1 and sign < 0.0:
                given[2] = min(given[2], np.nextafter(-np.pi, 0.0))
            if entry == 2 and sign > 0.0:
                given[1] = np.nextafter(np.pi, 0.0)
            if valid:
                assert WALKERS[name].checked_state(given)[entry] == given[entry]
            else:
                with pytest.raises(ValueError, match="has fallen"):
                    WALKERS[name].checked_state(given)
    equal = [0.1, -0.1, -0.1, -1.0, 0.5, 0.6]
    assert WALKERS["C"].checked_state(equal)[:3] == (0.1, -0.1, -0.1)


def test_a_search_finds_long_gaits_in_dimensionless_units():
    """From a guess far away too; a walker without a long gait has none."""
    for name, slope in (("lab", 0.036), ("A", 0.02)):
        expected = WALKERS[name].units.to_dimensionless(find_gait(name, slope).state)
        for guess in (None, tuple(expected), (0.9, -0.9, -0.9, 1.0, 1.0, 1.0)):
            found = searched_gait(WALKERS[name], slope, guess)
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)
    short = find_gait("A", 0.02, kind="short")
    guess = tuple(WALKERS["A"].units.to_dimensionless(short.state).tolist())
    assert searched_gait(WALKERS["A"], 0.02, guess)[0] == pytest.approx(
        searched_gait(WALKERS["A"], 0.02)[0], rel=1e-8
    )


def test_the_nearest_reference_slope_with_a_gait_is_used(monkeypatch):
    monkeypatch.setattr(starts, "known_gaits", dict)
    for slope, order in (
        (0.05, [0.05, 0.06, 0.036, 0.02]),
        (-0.3, [-0.3, 0.01, 0.005, 0.0025]),
        (0.0, [0.0, 0.01, 0.005, 0.0025]),
        (0.3, [0.3, 0.09, 0.06, 0.036]),
    ):
        for tried in range(1, len(order)):
            asked = []

            def search(walker, slope, guess=None, asked=asked, wanted=order[tried]):
                asked.append((slope, guess))
                return (slope,) if slope == wanted else None

            monkeypatch.setattr(starts, "searched_gait", search)
            assert gait_near(WALKERS["C"], slope, (1.0,)) == (order[tried],)
            expected = [(order[0], (1.0,)), *((each, None) for each in order[1 : tried + 1])]
            assert asked == expected


def test_states_of_a_system_are_its_coordinates_and_their_rates():
    env = PassiveWalkerVectorEnv(2, system=DRIVEN, slope=0.02, reset_noise_scale=0.0)
    states = [[0.2, -0.21, -0.3, -0.1], [0.15, -0.16, -0.25, -0.12]]
    seen, _ = env.reset(seed=0, options={"state": states, "slope": [0.01, 0.03]})
    np.testing.assert_array_equal(env.states, states)
    expected = np.column_stack([states, [0.01, 0.03]])
    np.testing.assert_array_equal(seen, expected.astype(np.float32))
    with pytest.raises(ValueError, match="of a walker that has fallen"):
        env.reset(options={"state": [2.0, 0.0, 0.0, 0.0]})
    with pytest.raises(ValueError, match=r"shape \(4,\)"):
        env.reset(options={"state": [0.2, -0.2, -0.2, -1.0, -0.5, -1.0]})
    start = (0.22, -0.22, -0.3, -0.15)
    given = PassiveWalkerVectorEnv(2, system=DRIVEN, start=start, reset_noise_scale=0.0)
    given.reset(seed=0)
    np.testing.assert_array_equal(given.states, [start] * 2)


@pytest.mark.parametrize("count", [1, 70])
def test_deviations_are_the_generator_s_own_numbers(count):
    """Of each walker: the slope's share, then three factors; in blocks of any size."""
    scene = Scene(slope=(0.01, 0.04), reset_noise_scale=0.1)
    found = draws(scene, count)
    own = starts.Starts(scene)
    for i in (0, count // 2, count - 1):
        share, *factors = np.random.default_rng((0, i)).random(4)
        slope = 0.01 + 0.03 * share
        assert found[i, 0] == pytest.approx(slope, rel=1e-14)
        angle, first, others = (1.0 + 0.1 * (2.0 * u - 1.0) for u in factors)
        gait = own.states(np.array([slope]))[0]
        np.testing.assert_allclose(
            found[i, 1:], gait * [angle, angle, angle, first, others, others], rtol=1e-12
        )
