"""Resets of some walkers, and the order of actuators and of strides, change no other result."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.gaits.control.maps import stride_map
from gym_passive_walker.gaits.control.ticks import ticked_strides
from gym_passive_walker.gaits.flow import Walkers
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.conformance.scenes import DISTURBED

COUNT = 7
OTHER = {"preset": "C", "hip_mass": 0.3}
WALKERS = ["C", "lab", "C", OTHER, "lab", "C", OTHER]
SLOPES = [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
KINDS = {
    "plain": {},
    "range of slopes": {"slope": (0.0, 0.06)},
    "one action a stride": {"scene": "steep"},
    "varied walkers": {"domain_randomization": {"foot_radius": 0.1, "thigh_mass": 0.1}},
    "everything": DISTURBED,
    "everything varied": {
        **DISTURBED,
        "domain_randomization": {"foot_radius": 0.1},
        "slope": (0.0, 0.04),
    },
    "two motors": {"actions": ("push_off", "hip"), "walker": "E", "slope": 0.02},
    "walkers and slopes": {"walkers": WALKERS, "slopes": SLOPES},
}


SOME = np.array([False, True, False, True, True, False, True])


@pytest.mark.parametrize("kind", KINDS)
def test_a_reset_of_some_takes_each_one_s_own_seed_state_and_slope(kind):
    """The seed belongs to the environment, not to its place among those that are reset."""
    arguments = KINDS[kind]
    env = PassiveWalkerVectorEnv(COUNT, autoreset_mode="Disabled", **arguments)
    whole = PassiveWalkerVectorEnv(COUNT, autoreset_mode="Disabled", **arguments)
    first, _ = env.reset(seed=1000)
    later = [None if i % 3 == 0 else 50 + 7 * i for i in range(COUNT)]
    later = [seed if SOME[i] else 12345 for i, seed in enumerate(later)]
    found, _ = env.reset(seed=later, options={"reset_mask": SOME})
    np.testing.assert_array_equal(found[~SOME], first[~SOME])
    whole.reset(seed=1000)  # those without a seed go on with the numbers that they have
    expected, _ = whole.reset(seed=later)
    np.testing.assert_array_equal(found[SOME], expected[SOME])
    assert not np.array_equal(found[SOME], first[SOME])
    slopes = np.linspace(0.01, 0.03, COUNT)
    states = np.tile([0.3, -0.3, -0.3, -1.2, -0.8, -0.8], (COUNT, 1))
    states[:, 0] += 0.01 * np.arange(COUNT)
    asked = {"state": states, "slope": slopes}
    before = env.states
    env.reset(options={"reset_mask": SOME, **asked})
    np.testing.assert_array_equal(env.states[~SOME], before[~SOME])
    np.testing.assert_allclose(env.states[SOME, 0], states[SOME, 0], rtol=1e-12)
    tilted = env.batch.disturbances.states["tilt"] if env.batch.disturbances else 0.0
    np.testing.assert_allclose(env.slopes[SOME], (slopes + tilted)[SOME], rtol=1e-12)


def test_new_slopes_for_some_are_each_one_s_own():
    env = PassiveWalkerVectorEnv(COUNT, slope=0.01)
    env.reset(seed=0)
    slopes = np.linspace(0.02, 0.05, COUNT)
    seen = env.set_slopes(slopes, SOME)
    np.testing.assert_array_equal(env.slopes, np.where(SOME, slopes, 0.01))
    np.testing.assert_array_equal(seen[:, 7], np.where(SOME, slopes, 0.01).astype(np.float32))


@pytest.mark.parametrize(
    "actions",
    [("push_off", "hip"), ("push_off", "ankle", "hip"), ("ankle", "hip"), ("hip", "push_off")],
)
@pytest.mark.parametrize("disturbed", [False, True])
def test_motors_may_be_named_in_any_order(actions, disturbed):
    """Each number of an action goes to the motor that stands at its place."""
    usual = tuple(name for name in ("hip", "ankle", "push_off") if name in actions)
    place = [usual.index(name) for name in actions]
    scene = {
        "walker": "E",
        "slope": 0.02,
        "max_hip_torque": 0.02,
        "max_ankle_torque": 0.003,
        "max_push_off": 0.01,
        "tick": 0.5,
    } | ({"action_delay": 2, "command": 0.1} if disturbed else {})
    walks = []
    for names, order in ((usual, np.arange(len(usual))), (actions, place)):
        env = PassiveWalkerVectorEnv(3, actions=names, **scene)
        steps = [env.reset(seed=4)[0]]
        draws = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3, len(usual)))
        for draw in draws.astype(np.float32):
            *shown, infos = env.step(draw[:, order])
            steps.append([*shown, *(infos[name] for name in sorted(infos))])
        walks.append(steps)
    for one, other in zip(*walks, strict=True):
        for x, y in zip(one, other, strict=True):
            np.testing.assert_array_equal(x, y)


def test_each_motor_works_by_its_own_number():
    """Each action drives one motor, and only the work of that motor is reported."""
    names = ("push_off", "ankle", "hip")
    for place, name in enumerate(names):
        env = PassiveWalkerVectorEnv(
            1,
            walker="E",
            slope=0.02,
            control="stride",
            actions=names,
            reset_noise_scale=0.0,
            max_hip_torque=0.003,
            max_ankle_torque=0.003,
            max_push_off=0.01,
        )
        env.reset(seed=0)
        action = np.zeros((1, 3), np.float32)
        action[0, place] = 1.0
        infos = env.step(action)[-1]
        assert infos["outcome"][0] == "heelstrike"
        shown = {each for each in ("hip", "ankle", "push_off") if infos[f"{each}_cost"][0] != 0.0}
        assert shown == {name}


# Strides.


def tables(walker, count=9):
    """States and everything else that a stride may take, each walker's own."""
    rng = np.random.default_rng(5)
    gait = gpw.find_gait(walker, 0.02)
    point = gpw.WALKERS[walker].foot_radius == 0.0
    return {
        "state": gait.state * (1.0 + 0.02 * rng.uniform(-1.0, 1.0, (count, 6))),
        "slope": rng.uniform(0.015, 0.025, count),
        "hip_torque": 0.01 * rng.uniform(-1.0, 1.0, count),
        "push_off": 0.01 * rng.uniform(0.0, 1.0, count),
        "height_change": 0.001 * rng.uniform(-1.0, 1.0, count),
        "slope_change": 0.002 * rng.uniform(-1.0, 1.0, count),
    } | ({"ankle_torque": 0.003 * rng.uniform(-1.0, 1.0, count)} if point else {})


@pytest.mark.parametrize("walker", ["C", "lab-straight", "E", "lab"])
def test_strides_of_arrays_are_each_walker_s_own_in_any_order(walker):
    shown = tables(walker)
    count = len(shown["slope"])
    order = np.random.default_rng(1).permutation(count)
    whole = gpw.stride(walker, **shown)
    mixed = gpw.stride(walker, **{name: values[order] for name, values in shown.items()})
    alone = [gpw.stride(walker, **{name: x[i] for name, x in shown.items()}) for i in range(count)]
    for name in whole._fields:
        values = np.asarray(getattr(whole, name))
        if values.ndim:
            np.testing.assert_array_equal(getattr(mixed, name), values[order], err_msg=name)
            np.testing.assert_array_equal([getattr(x, name) for x in alone], values, err_msg=name)


def test_torch_strides_are_each_walker_s_own_in_any_order():
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import stride, tick

    shown = {
        x: torch.from_numpy(y)
        for x, y in tables("lab").items()
        if x in ("state", "slope", "hip_torque")
    }
    order = torch.randperm(9, generator=torch.Generator().manual_seed(0))
    masses = torch.linspace(0.1, 0.5, 9, dtype=torch.float64)
    spans = torch.linspace(0.1, 1.2, 9, dtype=torch.float64)
    for function, each in ((stride, {}), (tick, {"duration": spans})):
        whole = function("lab", **shown, parameters={"hip_mass": masses}, **each)
        mixed = function(
            "lab",
            **{x: y[order] for x, y in (shown | each).items()},
            parameters={"hip_mass": masses[order]},
        )
        for name in whole._fields:
            expected, found = getattr(whole, name)[order], getattr(mixed, name)
            assert torch.equal(torch.nan_to_num(found), torch.nan_to_num(expected)), name


def test_strides_under_a_policy_and_of_ticks_are_each_walker_s_own_in_any_order():
    policy, scene = LinearFeedback("steep"), make_scene("steep")
    starts = policy.gait.state[[0, 3, 4, 5]] * [1.0, *[scene.walker.time_unit] * 3]
    points = starts * (1.0 + 0.01 * np.random.default_rng(0).uniform(-1.0, 1.0, (6, 4)))
    order = np.array([2, 5, 0, 1, 4, 3])
    strides = stride_map(controller=policy)
    whole, mixed = (strides.apply(x, strides=3) for x in (points, points[order]))
    for name in ("ends", "lengths", "durations"):
        np.testing.assert_array_equal(getattr(mixed, name), getattr(whole, name)[order])
    torques = 0.003 * np.random.default_rng(1).uniform(-1.0, 1.0, (6, 8))
    walkers, slopes = Walkers(walker=scene.walker), np.linspace(0.1, 0.11, 6)
    whole = ticked_strides(walkers, slopes, points, torques, tick=0.5)
    mixed = ticked_strides(walkers, slopes[order], points[order], torques[order], tick=0.5)
    for name in whole._fields[:-1]:
        np.testing.assert_array_equal(
            getattr(mixed, name), np.asarray(getattr(whole, name))[order], err_msg=name
        )
