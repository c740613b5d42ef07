"""Many walkers at once are each what they would be alone."""

import copy
import inspect
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

from gym_passive_walker import WALKERS
from gym_passive_walker.envs import interface
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import SceneError
from tests.own.statements import DRIVEN

MODES = [mode.value for mode in AutoresetMode]
ROUND = {"uniform": (0.0, 0.1), "operation": "abs"}


@pytest.fixture
def make_vec():
    """Makes a native vector environment."""

    def native(num_envs, **arguments):
        return gymnasium.make_vec(ID, num_envs=num_envs, **arguments)

    return native


def actions(count, seed=0, size=1.2):
    """Actions without end, some of them beyond the box."""
    rng = np.random.default_rng(seed)
    while True:
        yield rng.uniform(-size, size, (count, 1)).astype(np.float32)


def zeros(count):
    return np.zeros((count, 1), np.float32)


def test_modes_are_in_the_metadata_of_each(make_vec):
    for mode in AutoresetMode:
        assert make_vec(2, autoreset_mode=mode).metadata["autoreset_mode"] is mode
        assert make_vec(2, autoreset_mode=mode.value).metadata["autoreset_mode"] is mode
    assert make_vec(2).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


@pytest.mark.parametrize("limit", [-1, None])
def test_there_may_be_no_time_limit(make_vec, limit):
    env = make_vec(2, max_episode_steps=limit, scene="lab", reset_noise_scale=0.0)
    env.reset(seed=0)
    assert not any(env.step(zeros(2))[3].any() for _ in range(4100))


def test_the_time_limit_is_4000_steps(make_vec):
    env = make_vec(2, scene="lab", reset_noise_scale=0.0)
    env.reset(seed=0)
    truncated = [env.step(zeros(2))[3].all() for _ in range(4000)]
    assert truncated.index(True) == 3999


@pytest.mark.parametrize(
    "given",
    [
        {"walkers": ["C", "A"]},
        {"walker": "C", "walkers": ["A", "B"]},
        {"system": DRIVEN, "walkers": ["E", "E"]},
    ],
)
def test_walkers_of_different_kinds_do_not_mix(make_vec, given):
    with pytest.raises(SceneError, match="of one kind"):
        make_vec(2, **given)


def test_systems_of_different_weight_do_not_mix(make_vec):
    heavy = DRIVEN.with_body({"leg": 1.0})
    with pytest.raises(SceneError, match="must have one weight"):
        make_vec(2, walkers=[DRIVEN, heavy])


@pytest.mark.parametrize(
    "given",
    [
        {"walkers": ["E", "B"]},
        {"walker": "E", "domain_randomization": {"foot_radius": ROUND}},
    ],
)
def test_each_walker_with_an_ankle_torque_has_point_feet(make_vec, given):
    with pytest.raises(SceneError, match="the action 'ankle' needs point feet"):
        make_vec(2, actions=("ankle",), **given)


@pytest.mark.parametrize("given", [{"walkers": ["C"]}, {"slopes": [0.1]}])
def test_there_is_one_for_each_or_none(make_vec, given):
    with pytest.raises(SceneError, match="each of 2 environments, not 1 of them"):
        make_vec(2, **given)


def test_resets_start_where_they_are_asked_to(make_vec):
    env = make_vec(3)
    state = np.array([0.2, -0.2, -0.25, -1.0, -0.5, -1.0])
    env.reset(seed=0, options={"state": state, "slope": 0.03})
    np.testing.assert_allclose(env.states, [state] * 3)
    np.testing.assert_array_equal(env.slopes, [0.03] * 3)
    states, slopes = state * [[1.0], [1.1], [1.2]], [0.01, 0.02, 0.03]
    env.reset(options={"state": states, "slope": slopes})
    np.testing.assert_allclose(env.states, states)
    np.testing.assert_array_equal(env.slopes, slopes)


@pytest.mark.parametrize(
    ("mask", "error"),
    [
        ([True, False], TypeError),
        (np.array([1, 0]), TypeError),
        (np.array([True]), ValueError),
        (np.array([False, False]), ValueError),
    ],
)
def test_a_mask_that_is_none_is_refused(make_vec, mask, error):
    env = make_vec(2)
    env.reset(seed=0)
    with pytest.raises(error, match="reset_mask"):
        env.reset(options={"reset_mask": mask})


@pytest.mark.parametrize("seed", [7, [7, 8, 9, 10], [7, None, 9, None], np.array(7)])
def test_of_environments_that_are_reset_each_has_its_own_seed(make_vec, seed):
    """Those between them that are not reset go on, and take no seed from the others."""
    env, other = (make_vec(4, autoreset_mode="Disabled", scene="rolling") for _ in range(2))
    mask = np.array([True, False, True, False])
    expected, _ = other.reset(seed=7)
    before, _ = env.reset(seed=30)
    seen, _ = env.reset(seed=seed, options={"reset_mask": mask})
    np.testing.assert_array_equal(seen, np.where(mask[:, None], expected, before))


def test_all_are_reset_before_some_of_them(make_vec):
    env = make_vec(2)
    with pytest.raises(ResetNeeded):
        env.step(zeros(2))
    with pytest.raises(ResetNeeded):
        env.reset(options={"reset_mask": np.array([True, False])})


def test_the_action_of_a_reset_step_is_ignored(make_vec):
    env = make_vec(2, max_stride_time=0.2)
    env.reset(seed=0)
    while not env.step(zeros(2))[2].all():
        pass
    act = np.full((2, 1), np.nan, np.float32)
    _, rewards, terminated, truncated, infos = env.step(act)
    assert not (rewards.any() or terminated.any() or truncated.any())
    assert not any(infos[name].any() for name in infos if not name.startswith("_"))


@pytest.mark.parametrize("mode", MODES)
def test_a_batch_goes_on_where_it_was_saved(make_vec, assert_same, mode):
    def rest(env):
        walk = []
        for act, _ in zip(actions(4, seed=1), range(60), strict=False):
            walk.append(env.step(act))
            ended = walk[-1][2] | walk[-1][3]
            if mode == "Disabled" and ended.any():
                walk.append(env.reset(options={"reset_mask": ended}))
        return walk

    arguments = {"max_episode_steps": 25, "autoreset_mode": mode, "scene": "rolling"}
    env = make_vec(4, **arguments)
    env.reset(seed=0)
    for act, _ in zip(actions(4), range(10), strict=False):
        env.step(act)
    saved, fresh = env.get_state(), make_vec(4, **arguments)
    fresh.reset(seed=9)
    fresh.set_state(saved)
    unborn = make_vec(4, **arguments)
    unborn.set_state(saved)
    others = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env), fresh, unborn]
    expected = rest(env)
    for other in others:
        assert_same(rest(other), expected)
    with pytest.raises(ValueError, match="of 4 walkers, and here are 3"):
        make_vec(3, **arguments).set_state(saved)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_episode_statistics_are_those_of_the_ledger(make_vec, mode):
    env = wrappers.RecordEpisodeStatistics(make_vec(4, max_episode_steps=30, autoreset_mode=mode))
    if mode == "SameStep" and "SAME_STEP" not in inspect.getsource(type(env).step):
        pytest.skip("this Gymnasium counts only what resets at the next step")
    env.reset(seed=0)
    returns, lengths, returned = np.zeros(4), np.zeros(4, int), []
    skip = np.zeros(4, bool)
    for act, _ in zip(actions(4), range(120), strict=False):
        _, rewards, terminated, truncated, infos = env.step(act)
        returns, lengths = returns + rewards, lengths + ~skip
        ended = terminated | truncated
        for i in np.flatnonzero(ended):
            assert infos["episode"]["r"][i] == pytest.approx(returns[i])
            assert infos["episode"]["l"][i] == lengths[i] <= 30
            returned.append(returns[i])
        returns[ended], lengths[ended] = 0.0, 0
        skip = ended if mode == "NextStep" else skip
    assert len(returned) > 8
    np.testing.assert_allclose(env.return_queue, returned)


OBSERVATIONS = {
    "NormalizeObservation": wrappers.NormalizeObservation,
    "TransformObservation": lambda envs: wrappers.TransformObservation(envs, lambda x: 2.0 * x),
    "RescaleObservation": lambda envs: wrappers.RescaleObservation(envs, 0.0, 1.0),
    "FlattenObservation": wrappers.FlattenObservation,
    "DtypeObservation": lambda envs: wrappers.DtypeObservation(envs, np.float64),
}


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::RuntimeWarning")  # of their bounds
@pytest.mark.parametrize("name", OBSERVATIONS)
@pytest.mark.parametrize("mode", MODES)
def test_gymnasium_s_wrappers_of_observations_need_the_reset_at_the_next_step(make_vec, name, mode):
    envs = make_vec(3, autoreset_mode=mode, max_episode_steps=5)
    if mode == "SameStep":
        with pytest.raises((ValueError, AssertionError), match="NEXT_STEP"):
            OBSERVATIONS[name](envs)
    elif mode == "NextStep":
        wrapped = OBSERVATIONS[name](envs)
        wrapped.reset(seed=0)
        seen = [wrapped.step(zeros(3))[0] for _ in range(12)]
        assert all(each in wrapped.observation_space for each in seen)


def alike(a, b):
    """Whether two attributes are equal; generators by their states, arrays by their numbers."""
    if isinstance(a, np.random.Generator):
        return a.bit_generator.state == b.bit_generator.state
    if np.ndim(a) == 3:  # a batch has smaller pictures
        return np.ndim(b) == 3
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


@pytest.mark.parametrize("name", interface.OF_EACH | interface.OF_ALL)
def test_each_environment_is_called_as_gymnasium_calls_its_own(make_vec, name):
    if name == "render":
        pytest.importorskip("pygame")
    arguments = {"slope": (0.0, 0.02), "render_mode": "rgb_array" if name == "render" else None}
    calls = {"set_slope": (0.03,), "set_scene": ("steep",), "set_energy_cost": ("net",)}
    results = []
    for kind in ("vector_entry_point", "sync"):
        envs = make_vec(3, vectorization_mode=kind, **arguments)
        envs.reset(seed=4)
        steps = 0 if name == "set_slope" else 3
        for act, _ in zip(actions(3), range(steps), strict=False):
            envs.step(act)
        results += [envs.call(name, *calls.get(name, ()))]
        if name == "set_scene":
            results[-1] += tuple(envs.reset(seed=1)[0])
        elif name == "set_energy_cost":
            results[-1] += (*envs.get_attr("energy_cost"), *envs.step(np.ones((3, 1)))[1])
    native, sync = results
    assert len(native) == len(sync) >= 3
    assert all(alike(a, b) for a, b in zip(native, sync, strict=True))


@pytest.mark.parametrize("kind", ["vector_entry_point", "sync"])
def test_before_the_first_reset_there_are_generators_and_no_pictures(make_vec, kind):
    envs = make_vec(2, vectorization_mode=kind, render_mode="rgb_array")
    first, second = envs.call("np_random")
    assert first.random() != second.random() and len({*envs.call("np_random_seed")}) == 2
    state = first.bit_generator.state
    with pytest.raises(ResetNeeded):
        envs.call("render")
    assert envs.call("np_random")[0].bit_generator.state == state
    lanes = PassiveWalkerVecEnv(2).get_attr("np_random")
    assert lanes[0].random() != lanes[1].random()


def test_an_environment_without_pictures_is_called_for_none(make_vec):
    envs = make_vec(2)
    envs.reset(seed=0)
    assert envs.call("render") == (None, None)


def test_every_name_of_one_environment_is_answered_or_refused(make_vec):
    envs = make_vec(2)
    envs.reset(seed=0)
    known = interface.OF_EACH | interface.OF_ALL
    single = [name for name in dir(gymnasium.make(ID).unwrapped) if not name.startswith("_")]
    assert known.keys() <= set(single)
    for name in {*single, "slop"} - known.keys():
        with pytest.raises(AttributeError, match=f"no '{name}', because .* choose walker, slope"):
            envs.get_attr(name)


def test_an_attribute_takes_no_arguments_and_no_value(make_vec):
    envs = make_vec(2)
    with pytest.raises(TypeError, match="slope is an attribute"):
        envs.call("slope", 0.1)
    for name in ("slope", "scene", "colour"):
        with pytest.raises(AttributeError, match=f"{name} of a batch is read-only: use set_scene"):
            envs.set_attr(name, 0.1)


def test_infos_become_lists(make_vec):
    env = wrappers.DictInfoToList(make_vec(3))
    env.reset(seed=0)
    infos = env.step(zeros(3))[-1]
    assert [set(info) for info in infos] == [set(infos[0])] * 3 and "distance" in infos[0]


def test_pictures_show_every_walker(make_vec):
    pytest.importorskip("pygame")
    env = make_vec(2, render_mode="rgb_array", scene="lab")
    env.reset(seed=0)
    frames = env.render()
    assert len(frames) == 2 and not np.array_equal(*frames)
    env.close()
    assert env.closed
    with pytest.raises(ValueError, match="render_mode must be"):
        make_vec(2, render_mode="human")


def test_the_single_environment_makes_sync_and_async_batch(assert_same):
    sync = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="sync")
    native = gymnasium.make_vec(ID, num_envs=2)
    assert_same(sync.reset(seed=0), native.reset(seed=0))
    assert sync.single_observation_space == native.single_observation_space
    assert sync.observation_space == native.observation_space
    assert sync.action_space == native.action_space


def test_the_first_of_the_walkers_makes_the_scene(make_vec):
    env = make_vec(2, walkers=["A", "B"])
    assert env.scene.walker == WALKERS["A"] and env.scene.end_on_toe_stub is False
    assert env.walkers == [WALKERS["A"], WALKERS["B"]]
    given = make_vec(2, walkers=["lab", "C"], walker="C")
    assert given.scene.walker == WALKERS["C"] and given.walkers[0] == WALKERS["lab"]


def test_one_state_in_a_row_is_that_of_all(make_vec):
    env = make_vec(3)
    state = [[0.2, -0.2, -0.25, -1.0, -0.5, -1.0]]
    env.reset(seed=0, options={"state": state, "slope": [0.03] * 3})
    np.testing.assert_allclose(env.states, state * 3)
    with pytest.raises(ValueError, match=r"must have shape \(6,\), or \(3, 6\) .* not \(2, 6\)"):
        env.reset(options={"state": state * 2})
    with pytest.raises(ValueError, match=r"must have shape \(\), or \(3,\) .* not \(2,\)"):
        env.reset(options={"slope": [0.03] * 2})


def test_pushes_and_steps_in_the_ground_can_be_scheduled_for_each_walker(make_vec):
    def strides(**events):
        env = make_vec(
            4, scene="lab", control="stride", terrain={"rough": {"height_std": 0.0005}},
            pushes={"rate": 0.3, "impulse": (-0.001, 0.001)}, reset_noise_scale=0.0,
        )  # fmt: skip
        env.reset(seed=2)
        env.batch.schedule_events(**events)
        infos = env.step(zeros(4))[-1]
        return env.states, dict(infos), [env.batch.contact(i).y for i in range(4)]

    states, infos, heights = strides()
    found, pushed, _ = strides(impulses=[0.0, 0.004, 0.0, -0.002], times=0.25)
    np.testing.assert_array_equal(found[[0, 2]], states[[0, 2]])
    assert (np.abs(found - states)[[1, 3]].max(axis=1) > 1e-3).all()
    for name in ("pushes", "push_work"):
        np.testing.assert_array_equal(pushed[name][[0, 2]], infos[name][[0, 2]])
    assert (pushed["pushes"][[1, 3]] >= 1).all()
    assert not np.array_equal(pushed["push_work"], infos["push_work"])
    found, _, raised = strides(height_changes=[0.0, 0.002, -0.001, 0.0])
    np.testing.assert_array_equal(found[[0, 3]], states[[0, 3]])
    length = WALKERS["lab"].leg_length
    changes = np.subtract(raised, heights)
    np.testing.assert_allclose(changes, length * np.array([0.0, 0.002, -0.001, 0.0]), atol=3e-4)
    assert changes[1] > 0.0 > changes[2]
    earlier, *_ = strides(impulses=0.004, times=[0.25, 0.25, 0.9, 0.9])
    later, *_ = strides(impulses=0.004, times=[0.25, 0.9, 0.25, 0.9])
    same = (earlier == later).all(axis=1)
    np.testing.assert_array_equal(same, [True, False, False, True])


@pytest.mark.parametrize("name", ["height_changes", "impulses"])
def test_events_need_a_scene_that_can_have_them(make_vec, name):
    other = {"height_changes": {"pushes": {"rate": 0.0, "impulse": 0.0}},
             "impulses": {"terrain": {"rough": {"height_std": 0.0}}}}[name]  # fmt: skip
    for scene in ({}, other):
        env = make_vec(2, **scene)
        env.reset(seed=0)
        env.batch.schedule_events(**{name: [0.0, 0.0]})
        with pytest.raises(ValueError, match=f"{name} need a scene with (terrain|pushes)"):
            env.batch.schedule_events(**{name: [0.0, 0.001]})


def test_steps_that_have_elapsed_are_set_and_counted_by_the_time_limit():
    envs = PassiveWalkerVectorEnv(3, max_episode_steps=10, autoreset_mode="SameStep")
    with pytest.raises(ResetNeeded):
        envs.set_elapsed_steps([0, 0, 0])
    envs.reset(seed=0)
    assert envs.elapsed_steps.tolist() == [0, 0, 0]
    envs.set_elapsed_steps(np.array([0, 7, 9]))
    late = [envs.step(np.zeros((3, 1)))[3].tolist() for _ in range(4)]
    assert late == [[False, False, True], [False] * 3, [False, True, False], [False] * 3]
    assert envs.elapsed_steps.tolist() == [4, 1, 3]
    before = envs.get_state()
    for wrong in ([0, 1], [0, 1, 10], [-1, 0, 0], [0.5, 0, 0], 3, "abc", [True, False, True]):
        with pytest.raises(ValueError, match="steps must be"):
            envs.set_elapsed_steps(wrong)
    np.testing.assert_equal(envs.get_state(), before)
    envs.set_state(before)


def test_steps_of_an_episode_that_has_ended_are_not_set():
    envs = PassiveWalkerVectorEnv(2, max_episode_steps=5)
    envs.reset(seed=0)
    envs.set_elapsed_steps([4, 0])
    envs.step(np.zeros((2, 1)))
    with pytest.raises(ResetNeeded, match="ended"):
        envs.set_elapsed_steps([0, 0])
    envs.step(np.zeros((2, 1)))
    envs.set_elapsed_steps([3, 3])
    assert envs.step(np.zeros((2, 1)))[3].tolist() == [False, False]
    assert envs.step(np.zeros((2, 1)))[3].tolist() == [True, True]


def test_a_walker_with_more_strides_than_steps_has_a_state_that_is_restored():
    envs = PassiveWalkerVectorEnv(1, "lab", control="stride", reset_noise_scale=0.0)
    envs.reset(seed=0)
    for _ in range(3):
        envs.step(np.zeros((1, 1)))
    envs.set_elapsed_steps([0])
    envs.set_state(envs.get_state())
    assert envs.elapsed_steps.tolist() == [0]
