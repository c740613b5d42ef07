"""A user's own system walks in every environment, by the equations that it was stated with."""

import math
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.envs.saved import StateError
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from gym_passive_walker.models.walkers import Walker
from tests.own.oracle import Independent
from tests.own.statements import COMPASS, DRIVEN, Hip, Legs

SLOPE = 0.03
# One system with room in a walker's record, and one that needs a larger one.
SCENES = {
    "compass": {"system": DRIVEN, "slope": SLOPE},
    "five links": {"system": FIVE_LINKS, "slope": 0.05, "reset_noise_scale": 0.01},
}


DISTURBANCES = {
    "pushes": {"rate": 0.5, "impulse": (-0.01, 0.01)}, "terrain": "rough:height_std=0.0005",
    "observation_noise": 0.01, "action_noise": 0.1, "action_delay": 1, "command": (0.1, 0.2),
}  # fmt: skip
DISTURBED = {
    f"{name}, disturbed": {
        **scene, **DISTURBANCES, "domain_randomization": {scene["system"].body._fields[0]: 0.05}
    }
    for name, scene in SCENES.items()
}  # fmt: skip


@pytest.fixture(params=SCENES)
def arguments(request):
    """The arguments of a scene in which a user's system walks."""
    return SCENES[request.param]


@pytest.fixture(params=[*SCENES, *DISTURBED])
def any_arguments(request):
    """The same, disturbed scenes among them."""
    return (SCENES | DISTURBED)[request.param]


def made(**arguments):
    return gym.make("PassiveWalker-v0", **arguments).unwrapped


def walked(env, actions, seed=0):
    """Observations, rewards and infos of an episode under actions, until it ends."""
    steps = []
    env.reset(seed=seed)
    for action in actions:
        observation, reward, terminated, _, info = env.step(action)
        steps.append((observation, reward, info))
        if terminated:
            break
    return steps


def actions_of(env, count=40):
    rng = np.random.default_rng(5)
    return rng.uniform(-0.2, 0.2, (count, *env.action_space.shape))


def test_a_tick_is_what_scipy_integrates_from_lagrange_s_equations(arguments):
    env = made(**arguments, tolerance=1e-12)
    system, independent = arguments["system"], Independent(arguments["system"], arguments["slope"])
    largest = np.array([env.scene.largest(name) for name in env.scene.actions])
    env.reset(seed=1)
    for action in actions_of(env, 3):
        expected, _ = independent.stride(env.state, largest * action, env.scene.tick)
        observation, *_ = env.step(action)
        np.testing.assert_allclose(env.state, expected, atol=1e-9)
        np.testing.assert_allclose(observation, [*expected, arguments["slope"]], atol=1e-6)
    assert env.state.shape == (2 * system.coordinates,)


def test_a_heelstrike_in_a_tick_is_that_of_a_free_mechanism():
    env = made(**SCENES["compass"], tolerance=1e-12, control="stride", max_hip_torque=0.02)
    independent = Independent(DRIVEN, SLOPE)
    env.reset(seed=3)
    expected, duration = independent.stride(env.state, np.array([0.5 * 0.02]))
    *_, info = env.step(np.array([0.5]))
    assert info["outcome"] == "heelstrike" and info["strides"] == 1
    np.testing.assert_allclose(env.state, expected, atol=1e-9)
    assert info["step_period"] == pytest.approx(duration, abs=1e-9)


def test_without_torque_strides_are_those_of_the_stride_map(arguments):
    env = made(**arguments, control="stride")
    gait = gpw.find_gait(arguments["system"], arguments["slope"])
    env.reset(seed=0, options={"state": gait.state})
    *_, info = env.step(np.zeros(env.action_space.shape))
    np.testing.assert_allclose(env.state, gait.state, atol=1e-6)
    assert info["step_period"] == pytest.approx(gait.step_period, abs=1e-6)
    assert info["step_length"] == pytest.approx(gait.step_length, abs=1e-6)
    assert info["speed"] == pytest.approx(info["step_length"] / info["step_period"])
    assert info["gravity_cost"] == pytest.approx(math.sin(arguments["slope"]), abs=1e-6)
    assert info["cost_of_transport"] == info["gravity_cost"]


def test_the_compass_earns_what_the_package_s_own_earns():
    walker = Walker(
        thigh_length=0.5, thigh_mass=1.0 / 6.0, thigh_com=0.5, shank_length=0.5, shank_mass=0.0,
        hip_mass=2.0 / 3.0, knees=False, gravity=1.0,
    )  # fmt: skip
    own = made(system=DRIVEN, slope=SLOPE, control="stride", max_hip_torque=0.003)
    packaged = made(walker=walker, slope=SLOPE, control="stride", max_hip_torque=0.003)
    gait = gpw.find_gait(COMPASS, SLOPE)
    stance, swing, stance_rate, swing_rate = gait.state
    own.reset(seed=0, options={"state": gait.state})
    packaged.reset(
        seed=0, options={"state": [stance, swing, swing, stance_rate, swing_rate, swing_rate]}
    )
    for action in (0.3, -0.2, 0.1):
        _, ours, _, _, here = own.step(np.array([action]))
        _, theirs, _, _, there = packaged.step(np.array([action]))
        # Distances are of the centre of mass here and of the hip there: compare what is paid.
        assert here["energy"] == pytest.approx(there["energy"], abs=1e-8)
        assert here["step_length"] == pytest.approx(there["step_length"], abs=1e-8)
        assert here["hip_cost"] == pytest.approx(there["hip_cost"], abs=1e-7)
        assert here["collision_cost"] == pytest.approx(there["collision_cost"], abs=1e-7)
        assert ours == pytest.approx(here["distance"] - 10.0 * here["energy"])
        assert theirs == pytest.approx(there["distance"] - 10.0 * there["energy"])


def test_costs_do_not_depend_on_the_unit_of_mass():
    heavy = replace(DRIVEN, body=Legs(*(7.0 * mass for mass in DRIVEN.body)))
    actions = np.full((40, 1), 0.3)
    ours, theirs = (
        walked(made(**SCENES["compass"] | {"system": s}), actions) for s in (heavy, DRIVEN)
    )
    assert len(ours) == len(theirs) and ours[-1][2]["strides"] > 0
    for (_, here, first), (_, there, second) in zip(ours, theirs, strict=True):
        assert here == pytest.approx(there, rel=1e-7)
        assert first.pop("outcome") == second.pop("outcome")
        assert first == pytest.approx(second, rel=1e-6, abs=1e-12)


def test_energy_is_torque_times_how_far_each_control_has_moved():
    env = made(**SCENES["five links"], energy="net")
    env.reset(seed=0)
    before = np.array(FIVE_LINKS.travel(FIVE_LINKS.State(*env.state)))
    action = np.array([0.5, -0.5, 0.25, 1.0])
    *_, info = env.step(action)
    after = np.array(FIVE_LINKS.travel(FIVE_LINKS.State(*env.state)))
    torques = action * 0.05 * FIVE_LINKS.total_mass
    assert info["energy"] == pytest.approx(torques @ (after - before), abs=1e-9)


def test_walkers_of_a_vector_environment_are_those_of_single_ones(any_arguments):
    many = gym.make_vec("PassiveWalker-v0", num_envs=5, **any_arguments)
    singles = [made(**any_arguments) for _ in range(5)]
    first, _ = many.reset(seed=7)
    starts = [env.reset(seed=7 + i)[0] for i, env in enumerate(singles)]
    np.testing.assert_array_equal(first, starts)
    over = np.zeros(5, bool)
    for action in actions_of(many, 25):
        observations, rewards, terminated, _, _ = many.step(action)
        for i in np.flatnonzero(~over):
            observation, reward, ended, _, _ = singles[i].step(action[i])
            np.testing.assert_array_equal(observation, observations[i])
            assert (reward, ended) == (rewards[i], terminated[i])
        over |= terminated
    assert not over.all()


def test_a_batch_on_threads_is_the_batch_on_one(any_arguments):
    one, several = (
        gym.make_vec("PassiveWalker-v0", num_envs=4096, threads=n, **any_arguments) for n in (1, 2)
    )
    for env in (one, several):
        env.reset(seed=0)
    for action in actions_of(one, 3):
        for ours, theirs in zip(one.step(action)[:4], several.step(action)[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_an_environment_goes_on_from_its_saved_state(any_arguments):
    env = made(**any_arguments)
    actions = actions_of(env, 12)
    env.reset(seed=4)
    for action in actions[:6]:
        env.step(action)
    saved = pickle.loads(pickle.dumps(env.get_state()))
    expected = [env.step(action)[:2] for action in actions[6:]]
    other = made(**any_arguments)
    other.set_state(saved)
    for action, (observation, reward) in zip(actions[6:], expected, strict=True):
        found = other.step(action)
        np.testing.assert_array_equal(found[0], observation)
        assert found[1] == reward
    with pytest.raises(StateError, match=r"system|walker"):
        heavy = any_arguments["system"].vary(**heavier(any_arguments))
        made(**any_arguments | {"system": heavy}).set_state(saved)


def heavier(arguments):
    """Another value of the first constant of a scene's system."""
    body = arguments["system"].body
    return {body._fields[0]: 1.1 * body[0]}


def test_an_environment_of_functions_that_modules_hold_pickles():
    env = made(system=HELD, slope=SLOPE)
    env.reset(seed=0)
    env.step(np.array([0.1]))
    other = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(other.step(np.array([0.2]))[0], env.step(np.array([0.2]))[0])


def hip_angle(state):
    """What the torque turns."""
    return Hip(state.swing - state.stance)


def foot(body, state):
    """The swing foot."""
    return COMPASS.landing(body, state)


def exchanged(body, state):
    """The legs exchange their roles."""
    return state.swing, state.stance


def leaning(body, state):
    """Positive while it stands."""
    return state.stance + 1.5


def ahead(body, state):
    """Positive where the swing foot is in front."""
    return state.swing - state.stance - 0.02


HELD = replace(
    DRIVEN, landing=foot, relabel=exchanged, falls={"fell_forward": leaning}, counts=(ahead,),
    travel=hip_angle,
)  # fmt: skip


def test_users_rewards_and_endings_read_the_system_s_own_state(arguments):
    fields = arguments["system"].State._fields
    rate = fields[len(fields) // 2]

    def reward(step):
        return getattr(step.state, rate) - getattr(step.before, rate) + step.action[-1]

    env = made(
        **arguments, reward=reward, terminated=lambda step: step.steps > 4, observation=last_rate
    )
    observation, _ = env.reset(seed=2)
    assert observation.shape == (1,)
    for number, action in enumerate(actions_of(env, 5), 1):
        before = env.state
        observation, paid, ended, _, info = env.step(action)
        half = len(before) // 2
        assert paid == pytest.approx(env.state[half] - before[half] + action[-1], abs=1e-12)
        assert observation[0] == pytest.approx(env.state[-1], rel=1e-6)
        assert ended == (number > 4)
    assert info["outcome"] == "stopped"


def last_rate(step):
    """The last number of a state."""
    return step.state[-1]


def test_a_state_or_a_slope_may_be_asked_for(arguments):
    env = made(**arguments)
    size = 2 * arguments["system"].coordinates
    start = np.array(arguments["system"].start)
    observation, _ = env.reset(options={"state": start, "slope": 0.01})
    np.testing.assert_allclose(observation, [*start, 0.01], rtol=1e-6)
    with pytest.raises(ValueError, match=rf"\({size},\)"):
        env.reset(options={"state": np.zeros(size + 2)})
    with pytest.raises(ValueError, match="fallen"):
        env.reset(options={"state": [-2.0, *start[1:]]})


def test_the_action_1_is_a_control_s_limit_or_the_hip_s_in_its_weight():
    limited = replace(FIVE_LINKS, limits={"swing_hip": 0.3})
    scene = make_scene(system=limited, max_hip_torque=0.1)
    assert scene.actions == FIVE_LINKS.controls
    weight = FIVE_LINKS.total_mass
    assert [scene.largest(name) for name in scene.actions] == pytest.approx(
        [0.1 * weight, 0.1 * weight, 0.3, 0.1 * weight]
    )
    for limits in ({"tail": 1.0}, {"swing_hip": 0.0}, {"swing_hip": math.nan}):
        with pytest.raises(gpw.StatementError, match="limits"):
            replace(FIVE_LINKS, limits=limits)


def test_actions_may_be_some_of_the_controls_in_any_order():
    chosen = {"actions": ("swing_knee", "stance_hip")}
    some, every = made(**SCENES["five links"], **chosen), made(**SCENES["five links"])
    for env in (some, every):
        env.reset(seed=0)
    some.step(np.array([0.4, -0.6]))
    every.step(np.array([0.0, -0.6, 0.0, 0.4]))
    np.testing.assert_array_equal(some.state, every.state)


REFUSED = {
    "a walker and a system": {"system": COMPASS, "walker": "C"},
    "no system": {"system": "C"},
    "differ in height, not in slope": {"system": COMPASS, "terrain": {"rough": {"slope_std": 0.1}}},
    "'knee lock' is a check of": {"system": COMPASS, "constraints": {"knee lock": "end"}},
    "observe_body must be some of": {"system": COMPASS, "observe_body": ("knee",)},
    "5 of them": {"system": COMPASS, "observation_noise": (0.1,) * 8},
    "has no knee": {"system": COMPASS, "domain_randomization": {"knee": 0.1}},
    "end_on_toe_stub": {"system": COMPASS, "end_on_toe_stub": True},
    "start must be 4": {"system": COMPASS, "start": (0.1,) * 6},
    "actions must be some of 'hip'": {"system": DRIVEN, "actions": ("ankle",)},
    "actions must be ()": {"system": COMPASS, "actions": ("hip",)},
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_a_system_does_not_have_is_refused(said):
    with pytest.raises(SceneError) as error:
        make_scene(**REFUSED[said])
    assert said in str(error.value) or "system" in str(error.value)


def test_systems_of_other_equations_are_not_of_one_batch():
    with pytest.raises(SceneError, match="one system"):
        gym.make_vec("PassiveWalker-v0", num_envs=2, walkers=[COMPASS, TORSO])
    bodies = [DRIVEN, DRIVEN.vary(hip=0.8)]
    env = gym.make_vec("PassiveWalker-v0", num_envs=2, walkers=bodies, slope=SLOPE)
    env.reset(seed=0, options={"state": np.array(DRIVEN.start)})
    env.step(np.zeros((2, 1)))
    first, second = env.unwrapped.states
    assert not np.array_equal(first, second)


def test_a_system_without_a_gait_begins_at_its_start():
    climbing = made(system=DRIVEN, slope=-0.2, reset_noise_scale=0.0)
    observation, _ = climbing.reset(seed=0)
    gait = gpw.find_gait(DRIVEN, 0.01)  # of the nearest slope that has one
    np.testing.assert_allclose(observation[:4], gait.state, rtol=1e-6)
    with pytest.raises(SceneError, match="give the scene a start"):
        made(system=replace(DRIVEN, start=None), slope=SLOPE).reset()
    given = made(system=replace(DRIVEN, start=None), start=DRIVEN.start, reset_noise_scale=0.0)
    np.testing.assert_allclose(given.reset()[0][:4], DRIVEN.start, rtol=1e-6)


@pytest.mark.filterwarnings("ignore:.*infinity")  # the state of a system has no known bounds
def test_gymnasium_s_checker_finds_nothing(arguments):
    check_env(made(**arguments), skip_render_check=True)


def test_stable_baselines_trains_on_a_system():
    sb3 = pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    model = sb3.PPO(
        "MlpPolicy", PassiveWalkerVecEnv(8, **SCENES["five links"]), n_steps=16, batch_size=64
    )
    model.learn(256)
    action, _ = model.predict(np.zeros((8, 11), np.float32))
    assert action.shape == (8, 4)


@pytest.mark.parametrize("system", [COMPASS, TORSO, FIVE_LINKS], ids=lambda s: s.name)
def test_a_picture_shows_a_system(system):
    pytest.importorskip("pygame")
    env = made(system=system, slope=SLOPE, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for _ in range(5):
        env.step(np.zeros(env.action_space.shape))
    after = env.render()
    assert before.shape == after.shape == (450, 800, 3)
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 20
    assert np.any(before != after)
    many = gym.make_vec(
        "PassiveWalker-v0", num_envs=2, system=system, slope=SLOPE, render_mode="rgb_array"
    )
    many.reset(seed=0)
    assert len(many.render()) == 2


def test_a_pose_of_other_than_points_is_refused():
    for pose in (lambda b, s: [[1.0, 2.0]], lambda b, s: [[(0.0, math.nan), (1.0, 1.0)]]):
        with pytest.raises(gpw.StatementError, match="pose"):
            replace(COMPASS, pose=pose)


def test_explain_names_the_system_s_coordinates_and_controls(capsys):
    env = made(**SCENES["five links"])
    env.reset(seed=0)
    gpw.explain(env)
    printed = capsys.readouterr().out
    assert "system 'five links'" in printed
    for name in (*FIVE_LINKS.State._fields, *FIVE_LINKS.controls, *FIVE_LINKS.falls):
        assert name in printed
    gpw.explain({"walker": COMPASS})
    assert "action 1 is" not in capsys.readouterr().out
