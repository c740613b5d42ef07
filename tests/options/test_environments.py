"""Each argument of each environment has an effect, or none where it must not.

The arguments of a scene reach single and vector environments, the ones of stable-baselines3, of
tensors and of trainers, each in a different way.
"""

from __future__ import annotations

import inspect
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import SCENES, Scene, make_scene
from tests.options.effects import Call, To, cases, check, missing, plain
from tests.own.statements import DRIVEN

START = (0.3, -0.3, -0.4, -0.4, -0.3, -0.3)
ROUGH = {"rough": {"height_std": 0.01, "slope_std": 0.02}}
PUSHED = {"rate": 2.0, "impulse": 0.05}
POINT = {"walker": "E", "slope": 0.02}


def halved(step):
    """A reward of the user's own."""
    return 0.5 * step.distance


def rates(step):
    """An observation."""
    return step.state.stance_rate, step.action[0]


def late(step):
    """A termination function."""
    return step.steps > 10.5


def ends(*checks):
    return dict(constraints=dict.fromkeys(checks, "end"), slope=0.03)


OTHER = {
    "scene": "steep",
    "walker": To("lab", dict(slope=0.02)),
    "slope": 0.02,
    "control": "stride",
    "tick": 0.2,
    "actions": ("hip", "push_off"),
    "max_hip_torque": 0.01,
    "max_ankle_torque": To(0.01, dict(actions=("hip", "ankle"), **POINT)),
    "max_push_off": To(0.01, dict(actions=("push_off",))),
    "energy_weight": 0.0,
    "energy": "net",
    "end_on_toe_stub": To(False, dict(start=(0.3, -0.3, -0.31, -1.2, -0.3, 0.3))),
    "reset_noise_scale": 0.01,
    "domain_randomization": {"foot_radius": 0.1},
    "randomization_pool": To(3, dict(domain_randomization={"foot_radius": 0.1})),
    "observe_body": ("foot_radius",),
    "start": START,
    "max_stride_time": 1.0,
    "tolerance": To(1e-4, dict(control="stride")),
    "pushes": PUSHED,
    "observation_noise": 0.01,
    "action_noise": 0.5,
    "action_delay": 2,
    "command": (0.1, 0.2),
    "command_weight": To(1.0, dict(command=0.1)),
    "constraints": {"friction": "report"},
    "terrain": To(ROUGH, dict(slope=0.05)),
    "terrain_lookahead": To(2, dict(terrain=ROUGH)),
    "friction": To(0.01, ends("friction")),
    "knee_latch": To(1.0, ends("knee lock")),
    "reward": halved,
    "observation": rates,
    "terminated": late,
    "reward_terms": True,
    "scuff_depth": To(1.0, dict(scuff_depth=1e-6, max_hip_torque=0.0, **ends("scuffing"))),
}
"""Another value of each argument of a scene."""

STEPS = 90


def pushing(count, of):
    """Actions that differ between steps, walkers and actuators."""
    draws = np.random.default_rng(0).uniform(-0.7, 1.0, (STEPS, count, of))
    return draws.astype(np.float32)


def alone(*, scene="level", render_mode=None, seed=3, steps=STEPS, limit=None, **changes):
    """Results of a single environment."""
    env = gym.make(
        "PassiveWalker-v0",
        max_episode_steps=limit,
        scene=scene,
        disable_env_checker=True,
        render_mode=render_mode,
        **changes,
    )
    reported = [env.reset(seed=seed)[0]]
    for actions in pushing(1, env.action_space.shape[0])[:steps]:
        reported.append(env.step(actions[0]))
        if reported[-1][2] or reported[-1][3]:
            break
    reported.append(env.unwrapped.state)
    reported.append(None if render_mode is None else env.render())
    env.close()
    return reported


def crowded(env, seed=3, steps=STEPS):
    """Results of a vector environment."""
    reported = [env.reset(seed=seed)[0]]
    for actions in pushing(env.num_envs, env.single_action_space.shape[0])[:steps]:
        *rest, infos = env.step(actions)
        reported.append([*rest, dict(infos)])
    reported.append(env.states)
    reported.append(env.render())
    env.close()
    return reported


def together(*, num_envs=3, seed=3, steps=STEPS, **arguments):
    """The walkers of `gymnasium.make_vec`."""
    return crowded(gym.make_vec("PassiveWalker-v0", num_envs=num_envs, **arguments), seed, steps)


def for_sb3(*, num_envs=2, seed=3, steps=STEPS, **arguments):
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    env = PassiveWalkerVecEnv(num_envs, seed=seed, **arguments)
    reported = [env.reset()]
    for actions in pushing(num_envs, env.action_space.shape[0])[:steps]:
        observations, rewards, dones, infos = env.step(actions)
        for info in infos:
            info.get("episode", {}).pop("t", None)
        reported.append((observations, rewards, dones, infos))
    reported.append(env.envs.states)
    reported.append(env.get_images() if env.render_mode else None)
    env.close()
    return reported


def on_tensors(*, num_envs=2, seed=3, steps=STEPS, **arguments):
    import torch

    from gym_passive_walker.torch import PassiveWalkerTorchEnv

    env = PassiveWalkerTorchEnv(num_envs, **arguments)
    reported = [env.reset(seed=seed)[0]]
    for actions in pushing(num_envs, env.action_space.shape[0])[:steps]:
        reported.append(env.step(torch.from_numpy(actions)))
    reported.append(env.envs.states)
    return reported


WAYS = {"make": alone, "make_vec": together, "sb3": for_sb3, "torch": on_tensors}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("argument", OTHER)
def test_an_argument_of_a_scene_is_heard_in_every_environment(argument, way):
    if way in ("sb3", "torch"):
        pytest.importorskip("stable_baselines3")
    check(Call(WAYS[way], {}, OTHER), argument)


def test_every_argument_of_a_scene_is_tested():
    assert set(OTHER) == {"scene", *(field.name for field in fields(Scene))}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_by_name_is_its_arguments(name):
    for way in WAYS.values():
        by_name = plain(way(scene=name))
        assert by_name == plain(way(scene=make_scene(name))) == plain(way(scene=SCENES[name]))


def rest(table, of):
    """Arguments of an environment besides its scene."""
    return {
        name: value for name, value in table.items() if name in inspect.signature(of).parameters
    }


LATE = dict(max_episode_steps=20)
BESIDES = {
    "num_envs": To(4, expect=lambda a, b: len(b[0]) == 4),
    "max_episode_steps": 20,
    "autoreset_mode": To("SameStep", LATE),
    "walkers": ["C", "lab", "C"],
    "slopes": [0.0, 0.01, 0.02],
    "threads": To(1, same=True),
    "render_mode": "rgb_array",
    "seed": 4,
}
TWO = {"walkers": ["C", "lab"], "slopes": [0.0, 0.02]}
ENVIRONMENTS = {
    "PassiveWalkerEnv": (alone, {"render_mode": "rgb_array"}, PassiveWalkerEnv),
    "PassiveWalkerVectorEnv": (together, BESIDES, PassiveWalkerVectorEnv),
}


@pytest.mark.parametrize("option", BESIDES)
@pytest.mark.parametrize("way", ["make_vec", "sb3", "torch"])
def test_arguments_of_a_batch_besides_its_scene_are_used(option, way):
    if way != "make_vec":
        pytest.importorskip("stable_baselines3")
    if (way, option) in (("sb3", "autoreset_mode"), ("torch", "render_mode")):
        return  # there is no such argument; nothing that is compared
    table = BESIDES if way == "make_vec" else {**BESIDES, **TWO}
    if way == "torch":
        table = {**table, "autoreset_mode": To("NextStep", LATE)}
    check(Call(WAYS[way], {}, table), option)


def test_a_batch_s_threads_change_nothing_where_they_share_the_work():
    few, many = (
        together(num_envs=2100, threads=threads, steps=3, pushes=PUSHED) for threads in (1, 2)
    )
    assert plain(few) == plain(many)


def test_everything_that_environments_take_is_tested():
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
    from gym_passive_walker.torch import PassiveWalkerTorchEnv

    for of, also in (
        (PassiveWalkerEnv, set()),
        (PassiveWalkerVectorEnv, set()),
        (PassiveWalkerVecEnv, set()),
        (PassiveWalkerTorchEnv, {"device"}),
    ):
        found = inspect.signature(of).parameters.values()
        names = {each.name for each in found if each.kind is not each.VAR_KEYWORD}
        assert names - {"scene"} <= {*BESIDES, *also}, of


# Methods.


def begun(env):
    env.reset(seed=0)
    return env


def single(scene="level", **changes):
    return begun(gym.make("PassiveWalker-v0", scene=scene, **changes).unwrapped)


def vector(count=3, **changes):
    return begun(gym.make_vec("PassiveWalker-v0", num_envs=count, **changes))


def resets_alone(**asked):
    return single().reset(**asked)[0]


def resets(**asked):
    return vector().reset(**asked)[0]


def resets_on_tensors(**asked):
    from gym_passive_walker.torch import PassiveWalkerTorchEnv

    return PassiveWalkerTorchEnv(3).reset(**asked)[0]


def slopes_alone(slope):
    env = single()
    return env.set_slope(slope), env.step(np.zeros(1, np.float32))


def slopes_together(slopes, mask=None):
    env = vector()
    return env.set_slopes(slopes, mask), env.step(np.zeros((3, 1), np.float32))[:2]


def truncated_after(steps):
    env = PassiveWalkerVectorEnv(3, max_episode_steps=4)
    env.reset(seed=0)
    env.set_elapsed_steps(steps)
    return [env.step(np.zeros((3, 1), np.float32))[3] for _ in range(3)]


def slopes_in_sb3(slopes, mask=None):
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    env = PassiveWalkerVecEnv(3, seed=0)
    env.reset()
    return env.set_slopes(slopes, mask), env.step(np.zeros((3, 1), np.float32))[:2]


def charges(env, energy):
    env.set_energy_cost(energy)
    act = np.full(env.action_space.shape, -1.0, np.float32)
    return [env.step(act)[1] for _ in range(20)]


def renewed(env, scene=None, **changes):
    """Steps after a change of scene."""
    env.set_scene(scene, **changes)
    env.reset(seed=1)
    act = np.full(env.action_space.shape, 0.5, np.float32)
    return [env.step(act)[:2] for _ in range(2)]


def steps(make, action):
    env = make()
    act = np.full(env.action_space.shape, action, np.float32)
    return env.step(act)


def goes_on(make, state):
    env = make()
    env.set_state(state)
    return env.step(np.zeros(env.action_space.shape, np.float32))


def seeds(seed, of):
    env = of()
    env.seed(seed)
    return env.reset()


def refusal(call):
    """The error of a call that is refused."""
    with pytest.raises(AttributeError) as refused:
        call()
    return refused.value


MASK = np.array([True, False, True])
FROM = {"state": np.array([0.3, -0.3, -0.3, -1.2, -0.8, -1.0])}
OTHER_STATE = {"state": np.array([0.2, -0.2, -0.2, -1.2, -0.8, -1.0]), "slope": 0.02}


def a_later_state(make):
    env = make()
    env.step(np.ones(env.action_space.shape, np.float32))
    return env.get_state()


METHODS = {
    "PassiveWalkerEnv.reset": Call(
        resets_alone, dict(seed=0), dict(seed=1, options=FROM), of=PassiveWalkerEnv.reset
    ),
    "PassiveWalkerEnv.set_slope": Call(
        slopes_alone, dict(slope=0.01), dict(slope=0.02), of=PassiveWalkerEnv.set_slope
    ),
    "PassiveWalkerVectorEnv.reset": Call(
        resets, dict(seed=0), dict(seed=1, options=FROM), of=PassiveWalkerVectorEnv.reset
    ),
    "PassiveWalkerVectorEnv.set_slopes": Call(
        slopes_together,
        dict(slopes=[0.01, 0.02, 0.03]),
        dict(slopes=0.02, mask=MASK),
        of=PassiveWalkerVectorEnv.set_slopes,
    ),
    "PassiveWalkerVectorEnv.set_elapsed_steps": Call(
        truncated_after,
        dict(steps=[0, 0, 0]),
        dict(steps=[1, 0, 2]),
        of=PassiveWalkerVectorEnv.set_elapsed_steps,
    ),
    "PassiveWalkerVectorEnv.set_attr": Call(
        lambda name, values: str(refusal(lambda: vector().set_attr(name, values))),
        dict(name="slope", values=0.1),
        dict(name="scene", values=To(0.2, same=True)),
        of=PassiveWalkerVectorEnv.set_attr,
    ),
    **{
        f"PassiveWalkerVectorEnv.{name}": Call(
            lambda name, method=name: getattr(vector(slope=(0.0, 0.1)), method)(name),
            dict(name="slope"),
            dict(name="render_mode"),
            of=getattr(PassiveWalkerVectorEnv, name),
        )
        for name in ("call", "get_attr")
    },
}
for of, make, action in (
    (PassiveWalkerEnv, single, "action"), (PassiveWalkerVectorEnv, vector, "actions"),
):  # fmt: skip
    METHODS |= {
        f"{of.__name__}.step": Call(
            lambda make=make, **given: steps(make, *given.values()),
            {action: 0.0},
            {action: 1.0},
            of=of.step,
        ),
        f"{of.__name__}.set_energy_cost": Call(
            lambda energy, make=make: charges(make(energy="net"), energy),
            dict(energy=None),
            dict(energy="absolute"),
            of=of.set_energy_cost,
        ),
        f"{of.__name__}.set_scene": Call(
            lambda make=make, **given: renewed(make(), **given),
            {},
            dict(scene="steep"),
            of=of.set_scene,
        ),
        f"{of.__name__}.set_state": Call(
            lambda state, make=make: goes_on(make, state),
            dict(state=make().get_state()),
            dict(state=a_later_state(make)),
            of=of.set_state,
        ),
    }


@pytest.mark.parametrize("name, option", cases(METHODS))
def test_an_argument_of_a_method_is_heard(name, option):
    check(METHODS[name], option)


def test_every_argument_of_every_method_is_tested():
    found = set()
    for of in (PassiveWalkerEnv, PassiveWalkerVectorEnv):
        for name, function in inspect.getmembers(of, inspect.isfunction):
            ours = function.__module__.startswith("gym_passive_walker")
            if not name.startswith("_") and ours:
                given = inspect.signature(function).parameters.values()
                kinds = [p for p in given if p.kind is not p.VAR_KEYWORD]
                found |= {f"{of.__name__}.{name}"} if len(kinds) > 1 else set()
    assert not missing(METHODS, found)


@pytest.mark.parametrize("make", [resets, resets_on_tensors], ids=["vector", "tensors"])
@pytest.mark.parametrize("option", ["state", "slope"])
def test_what_a_reset_is_asked_for_is_heard(make, option):
    if make is resets_on_tensors:
        pytest.importorskip("torch")
    one, other = (
        make(seed=0, options={**FROM, "slope": 0.01, option: value})
        for value in (FROM.get(option, 0.01), OTHER_STATE[option])
    )
    assert plain(one) != plain(other)


def test_slopes_and_charges_reach_walkers_of_stable_baselines3():
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    check(
        Call(slopes_in_sb3, dict(slopes=[0.01, 0.02, 0.03]), dict(slopes=0.02, mask=MASK)), "mask"
    )
    check(Call(slopes_in_sb3, dict(slopes=[0.01, 0.02, 0.03]), dict(slopes=0.02)), "slopes")
    check(Call(seeds, dict(seed=0, of=lambda: PassiveWalkerVecEnv(2)), dict(seed=1)), "seed")

    def charged(energy):
        env = PassiveWalkerVecEnv(2, seed=0, energy="net")
        env.reset()
        env.set_energy_cost(energy)
        return [env.step(np.full((2, 1), -1.0, np.float32))[1] for _ in range(20)]

    check(Call(charged, dict(energy=None), dict(energy="absolute")), "energy")


# Tensors.


def test_every_option_of_torch_is_heard():
    pytest.importorskip("torch")
    from gym_passive_walker import torch as doors

    state = gpw.find_gait("lab", 0.036).state
    near, of_lab = 1.01 * state, dict(walker="lab", slope=0.036, state=state)
    of_d = dict(walker="D", slope=0.009, state=gpw.find_gait("D", 0.009).state)
    of_own = dict(walker=DRIVEN, slope=0.03, state=DRIVEN.start)
    per_tick = dict(**of_lab, hip_torque=0.1, duration=0.1)
    later = doors.tick(**{**per_tick, "duration": 0.05})
    table = {
        "stride": Call(
            doors.stride,
            of_lab,
            dict(
                walker="lab-straight",
                slope=0.04,
                state=near,
                hip_torque=0.1,
                ankle_torque=To(0.003, of_d),
                push_off=0.2,
                height_change=-0.002,
                slope_change=0.004,
                controls=To({"hip": 0.01}, of_own),
                parameters={"hip_mass": 0.5},
                tolerance=1e-5,
                max_stride_time=To(0.5, look=lambda reported: reported.outcome),
                end_on_toe_stub=To(
                    True, dict(hip_torque=-0.04 * 7.0 * 9.81), look=lambda found: found.outcome
                ),
            ),
        ),
        "tick": Call(
            doors.tick,
            per_tick,
            dict(
                walker="lab-straight",
                slope=0.04,
                state=near,
                hip_torque=0.2,
                duration=0.2,
                phase=To(1, dict(walker="lab", state=later.state)),
                ankle_torque=To(0.003, of_d),
                push_off=To(0.2, dict(duration=5.0)),
                height_change=To(-0.002, dict(duration=5.0)),
                slope_change=To(0.004, dict(duration=5.0)),
                push=0.1,
                controls=To({"hip": 0.01}, dict(**of_own, hip_torque=0.0, duration=0.1)),
                parameters={"hip_mass": 0.5},
                tolerance=1e-5,
                end_on_toe_stub=To(
                    True,
                    dict(hip_torque=-0.04 * 7.0 * 9.81, duration=5.0),
                    look=lambda reported: reported.outcome,
                ),
            ),
        ),
        "left_out": Call(doors.left_out, dict(scene="level"), dict(scene="commanded")),
        "initial_state": Call(
            doors.initial_state,
            dict(scene="level", seed=0),
            dict(
                scene="steep",
                count=3,
                seed=1,
                parameters={"hip_mass": 0.5},
                footholds=[(0.001, 0.0)],
            ),
        ),
        "rollout": Call(
            doors.rollout,
            dict(policy=lambda seen: seen[:, 0], scene="level", horizon=3, count=2, seed=0),
            dict(
                policy=lambda seen: seen[:, 1],
                scene=make_scene("level", tick=0.2),
                horizon=4,
                count=3,
                seed=1,
                start=doors.initial_state("level", 2, seed=5),
                pushes=0.01,
            ),
        ),
    }
    functions = {x for x in doors.__all__ if inspect.isfunction(getattr(doors, x))}
    assert not missing(table, functions)
    for name, option in cases(table):
        check(table[name], option)
