"""Pushes, noise, delay and commands: exact, seeded, and each walker's own."""

from __future__ import annotations

import math
import pickle

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.engine.run import advance, new_records
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes import rules
from gym_passive_walker.gaits.scenes.scene import UNDISTURBED, SceneError, make_scene, undisturbed
from gym_passive_walker.models.equations.hybrid import Outcome, State
from gym_passive_walker.models.model import bodies

SLOPES = {"lab": 0.036, "A": 0.03, "D": 0.009}
"""A walker with knees, one with straight legs, the simplest; and slopes that they walk on."""

EVERYTHING = {
    "pushes": {"rate": 0.7, "impulse": (-0.02, 0.03)}, "observation_noise": 0.01,
    "action_noise": 0.1,
    "action_delay": 2, "command": (0.1, 0.3),
    "constraints": {"contact": "report", "friction": "end", "scuffing": "report"},
}  # fmt: skip


def one(walker="lab", **changes):
    """One walker, without a wrapper."""
    return gym.make(ID, walker=walker, slope=SLOPES[walker], **changes).unwrapped


def some(count, steps=1, seed=0):
    """Actions of some steps, (steps, count, 1)."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, count, 1)).astype("f4")


def carried(system, body, record, end):
    """A record carried to its stride's end, or to a time."""
    record["end"] = end
    return advance(system, body, record, tolerance=1e-12, from_section=False)


# Pushes


@pytest.mark.parametrize("walker", SLOPES)
def test_a_pushed_stride_is_one_carried_to_the_push_pushed_and_carried_on(walker):
    pushes = {"rate": 0.8, "impulse": (-0.01, 0.02)}
    env = one(walker, control="stride", pushes=pushes, tolerance=1e-12, max_hip_torque=0.0)
    system, body = env.walker.equations(), bodies(env.walker)
    tried = 0
    for seed in range(30):
        env.reset(seed=seed)
        record = new_records(env.batch.records["state"][:, 0], env.slope)
        due = float(env.batch.disturbances.states["due"][0])
        *_, info = env.step(np.zeros(1))
        if info["pushes"] != 1 or info["outcome"] != "heelstrike":
            continue
        tried += 1
        carried(system, body, record, due)
        phase, state = system.phases[record[0, 0]["phase"]], State(*record[0, 0]["state"])
        energy = system.kinetic_energy(env.walker.body, state)
        # Rates are linear in the impulse and energy is quadratic: its work gives the impulse.
        unit = np.array(phase.push(env.walker.body, state, -1.0, 0.0))[[0, 1, -1]]

        def gained(impulse, state=state, unit=unit, energy=energy):
            rates = np.array(state[3:]) + impulse * unit
            after = State(*state[:3], *rates)
            return system.kinetic_energy(env.walker.body, after) - energy, rates

        low, high = pushes["impulse"]
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if gained(middle)[0] < info["push_work"] else (low, middle)
        assert gained(low)[0] == pytest.approx(info["push_work"], rel=1e-9)
        record[0, 0]["state"][3:] = gained(low)[1]
        carried(system, body, record, 100.0)
        assert record[0, 0]["outcome"] == Outcome.HEELSTRIKE
        expected = record[0, 0]["state"]
        np.testing.assert_allclose(env.batch.records[0, 0]["state"], expected, rtol=1e-8)
    assert tried >= 3


@pytest.mark.parametrize("walker", SLOPES)
def test_a_stride_gains_what_gravity_and_pushes_give_less_what_strikes_take(walker):
    pushes = {"rate": 1.0, "impulse": (-0.003, 0.004)}
    env = one(walker, control="stride", pushes=pushes, tolerance=1e-12)
    env.reset(seed=4)
    system, body = env.walker.equations(), env.walker.body
    works, pushes_before = [], 0
    for _ in range(6):
        before = system.kinetic_energy(body, State(*env.batch.records[0, 0]["state"]))
        *_, info = env.step(np.zeros(1))
        if info["outcome"] != "heelstrike":
            break
        after = system.kinetic_energy(body, State(*env.batch.records[0, 0]["state"]))
        given = (info["gravity_cost"] - info["collision_cost"]) * info["step_length"]
        assert after - before == pytest.approx(given + info["push_work"], abs=1e-12)
        works.append(info["push_work"])
        assert info["episode_push_work"] == pytest.approx(sum(works), rel=1e-12)
        assert (works[-1] != 0.0) == (info["pushes"] > pushes_before)
        pushes_before = info["pushes"]
    assert np.count_nonzero(works) >= 2


def test_pushes_come_as_often_as_they_should_and_apart():
    envs = PassiveWalkerVectorEnv(
        400, walker="D", slope=0.009, pushes={"rate": 0.25, "impulse": 0.0}, reset_noise_scale=0.0
    )
    envs.reset(seed=0)
    for _ in range(200):  # no impulse at all: nobody falls
        *_, infos = envs.step(np.zeros((400, 1)))
    ledger, records = envs.batch.ledger, envs.batch.records
    mean = 0.25 * (ledger["clock"] + records["time"][:, 0])
    count = infos["pushes"]
    assert mean.min() > 3.0
    assert count.sum() == pytest.approx(mean.sum(), abs=3.0 * np.sqrt(mean.sum()))
    assert np.var(count - mean) == pytest.approx(mean.mean(), rel=0.25)


def test_pushes_without_impulse_change_no_walk():
    pushed = one(pushes={"rate": 2.0, "impulse": 0.0}, reset_noise_scale=0.0, tolerance=1e-11)
    left = one(reset_noise_scale=0.0, tolerance=1e-11)
    pushed.reset(seed=0), left.reset(seed=0)
    for _ in range(120):
        *_, info = pushed.step(np.zeros(1))
        left.step(np.zeros(1))
    assert info["pushes"] > 10 and info["episode_push_work"] == 0.0
    np.testing.assert_allclose(pushed.state, left.state, rtol=1e-7)


# Each walker's own


# Noise and delay


def test_sensors_err_by_as_much_as_they_should_and_the_walk_does_not_notice(assert_same):
    kinds = [
        {"observation_noise": 0.02}, {"observation_noise": (0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0,
        0.01)}, {}
    ]  # fmt: skip
    even, single, none = (
        PassiveWalkerVectorEnv(300, "lab", reset_noise_scale=0.0, **noise) for noise in kinds
    )
    first = [envs.reset(seed=0)[0] for envs in (even, single, none)]
    errors = [[first[0] - first[2]], [first[1] - first[2]]]
    for _ in range(20):
        seen = [envs.step(np.zeros((300, 1)))[0] for envs in (even, single, none)]
        errors[0].append(seen[0] - seen[2])
        errors[1].append(seen[1] - seen[2])
    assert_same(even.states, none.states)
    every, of_some = (np.array(each).reshape(-1, 8) for each in errors)
    expected = [0.02] * 6 + [0.0] * 2
    np.testing.assert_allclose(every.std(0), expected, atol=4e-4)
    np.testing.assert_allclose(every.mean(0), 0.0, atol=1.2e-3)
    correlation = np.corrcoef(every[:, :6].T) - np.eye(6)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(len(every))
    assert abs(np.corrcoef(every[:300, 0], every[300:600, 0])[0, 1]) < 0.25
    np.testing.assert_allclose(of_some.std(0), [0, 0.1, 0, 0, 0, 0, 0, 0.01], rtol=0.03)


def test_an_observation_asked_for_again_errs_in_the_same_way(assert_same):
    env = one(observation_noise=0.1)
    env.reset(seed=0)
    seen, *_ = env.step(np.zeros(1))
    assert_same(env.batch.observe()[0], seen)
    assert np.all(seen >= rules.LOWEST) and np.all(seen <= rules.BOUNDS)


def test_what_erring_sensors_tell_lies_in_the_space_of_observations():
    """Errors as large as what is observed, of every entry: of the knee and of the slope too."""
    noise = tuple(np.array(rules.BOUNDS, float).clip(max=5.0).tolist())
    env = PassiveWalkerVectorEnv(200, "commanded", observation_noise=noise)
    seen, _ = env.reset(seed=0)
    for _ in range(20):
        assert env.observation_space.contains(seen)
        seen, *_ = env.step(np.zeros((200, 1)))
    assert seen[:, 6].min() == 0.0 and seen[:, 6].max() == 1.0


def test_nothing_that_befell_a_walker_outlasts_its_episode(assert_same):
    """An episode and its infos do not depend on the one before."""
    used, fresh = (one(**EVERYTHING | {"observation_noise": 0.0}) for _ in range(2))
    reported = []
    for env, actions in ((used, 0), (used, 1), (fresh, 1)):
        seen, _ = env.reset(seed=5)
        reported.append([(seen, env.state, {})])
        for action in some(1, 15, seed=actions)[:, 0]:
            seen, reward, *_, info = env.step(action)
            reported[-1].append((seen, reward, env.state, info))
    assert reported[0][-1][-1]["pushes"] > 0
    for again, fresh in zip(reported[1], reported[2], strict=True):
        for found, expected in zip(again, fresh, strict=True):
            assert_same(found, expected)


def test_delayed_actions_come_as_many_steps_late(assert_same):
    late, prompt = one(action_delay=3), one()
    late.reset(seed=0), prompt.reset(seed=0)
    actions = some(1, 40)[:, 0]
    for action, sooner in zip(actions, [*np.zeros((3, 1)), *actions], strict=False):
        reported, expected = late.step(action), prompt.step(sooner)
        assert_same(reported, expected)


def test_a_motor_errs_by_a_share_of_its_torque_and_never_exceeds_it():
    envs = PassiveWalkerVectorEnv(500, "lab", action_noise=0.2)
    envs.reset(seed=0)
    for action, mean, spread in ((0.1, 0.1, 0.2), (5.0, 0.9202, 0.1168)):  # one side is cut off
        envs.step(np.full((500, 1), action))
        shares = envs.batch.records["control"][:, 0, 0] / envs.scene.max_hip_torque
        assert np.abs(shares).max() <= 1.0
        assert shares.mean() == pytest.approx(mean, abs=0.03)
        assert shares.std() == pytest.approx(spread, abs=0.02)


def test_a_push_off_below_none_is_none_before_it_errs():
    """An action is clipped to its bounds first, as one of a torque is."""
    below, none = (PassiveWalkerVectorEnv(300, "push-off", action_noise=0.2) for _ in range(2))
    for envs, action in ((below, -0.7), (none, 0.0)):
        envs.reset(seed=0)
        envs.step(np.full((300, 1), action))
    shares, expected = (
        e.batch.records["push_off"][:, 0] / e.scene.max_push_off for e in (below, none)
    )
    np.testing.assert_array_equal(shares, expected)
    assert shares.mean() == pytest.approx(0.2 / math.sqrt(2.0 * math.pi), abs=0.02)


# Commands


def test_commands_are_drawn_from_their_range_and_seen():
    envs = PassiveWalkerVectorEnv(500, "lab", command=(0.1, 0.3))
    seen, _ = envs.reset(seed=0)
    assert envs.single_observation_space.shape == (9,)
    *_, infos = envs.step(np.zeros((500, 1)))
    np.testing.assert_array_equal(seen[:, 8], infos["command"].astype(np.float32))
    assert infos["command"].min() == pytest.approx(0.1, abs=3e-3)
    assert infos["command"].max() == pytest.approx(0.3, abs=3e-3)
    assert infos["command"].mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("weight", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("share", [0.2, 0.8, 1.0, 1.2, 3.0])
def test_a_stride_is_worth_its_length_less_what_it_misses_its_command_by(weight, share):
    gait = gpw.find_gait("lab", 0.036)
    env = one(command=share * gait.froude_speed, command_weight=weight, control="stride")
    env.reset(seed=0, options={"state": gait.state})
    _, reward, *_, info = env.step(np.zeros(1))
    length = info["step_length"]
    worth = max(0.0, length - weight * abs(1.0 - share) * length)
    assert reward == pytest.approx(worth, abs=1e-7)
    assert env.batch.ledger["total"][0] == reward


def test_every_action_comes_late_and_errs_by_itself():
    channels = ("push_off", "ankle", "hip")
    arguments = {"walker": "D", "slope": 0.009, "actions": channels, "reset_noise_scale": 0.0}
    late, prompt = (
        PassiveWalkerVectorEnv(300, **arguments, action_delay=delay, action_noise=0.05)
        for delay in (2, 0)
    )
    late.reset(seed=0), prompt.reset(seed=0)
    actions = np.tile([0.5, -0.5, 0.2], (300, 1))
    held = []
    for step in range(3):
        reported = [envs.step(actions) and envs.batch.records[:, 0] for envs in (late, prompt)]
        held.append([np.column_stack([r["push_off"], r["control"][:, ::-1]]) for r in reported])
        if step < 2:
            assert abs(np.mean(held[-1][0][:, 1:])) < 1e-3
    sizes = [late.scene.largest(name) for name in channels]
    np.testing.assert_array_equal(held[2][0], held[2][1])
    np.testing.assert_allclose(held[2][0].mean(0) / sizes, [0.5, -0.5, 0.2], atol=0.01)
    assert np.abs(np.corrcoef((held[2][0] / sizes).T) - np.eye(3)).max() < 0.25


def test_a_policy_s_gait_is_that_of_the_calm_scene_at_the_middle_of_its_command():
    class Obedient:
        """A torque that grows with the speed commanded."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            assert observation.shape[-1] == 9
            return 0.1 * observation[:, 8:], state

    rough = {**EVERYTHING, "command": (0.1, 0.3)}
    gait = gpw.closed_loop_gait(Obedient(), {"walker": "lab", "slope": 0.036, **rough})
    calm = {"walker": "lab", "slope": 0.036, "command": 0.2}
    np.testing.assert_array_equal(gait.state, gpw.closed_loop_gait(Obedient(), calm).state)


@pytest.mark.parametrize("name", [*EVERYTHING, "terrain"])
def test_a_method_that_needs_a_calm_scene_says_how_to_get_it(name):
    value = EVERYTHING.get(name, {"stairs": {"rise": 0.01}})
    scene = make_scene("lab", **{name: value})
    with pytest.raises(SceneError, match=f"walks are made without {name}, .* choose"):
        undisturbed(scene, "walks are made")
    calm = make_scene(scene, **UNDISTURBED, command=None)
    assert undisturbed(calm, "walks are made") == make_scene("lab")


def test_what_befalls_walkers_goes_with_them_to_another_process(assert_same):
    here = PassiveWalkerVectorEnv(3, "lab", **EVERYTHING)
    here.reset(seed=0)
    there = pickle.loads(pickle.dumps(here))
    for action in some(3, 60):
        assert_same(here.step(action), there.step(action))


@pytest.mark.parametrize("index", range(8))
def test_noise_of_each_entry_errs_in_that_entry_alone(index):
    noise = [0.0] * 8
    noise[index] = 0.05
    noisy, calm = (
        PassiveWalkerVectorEnv(50, "lab", **more) for more in ({"observation_noise": noise}, {})
    )
    errors = [noisy.reset(seed=0)[0] - calm.reset(seed=0)[0]]
    for actions in 0.1 * some(50, 6):
        errors.append(noisy.step(actions)[0] - calm.step(actions)[0])
    spread = np.std(np.concatenate(errors), axis=0)
    if index == 6:  # cut off at 0 and 1
        assert 0.0 < spread[6] < 0.05
    else:
        assert spread[index] == pytest.approx(0.05, rel=0.15)
    assert not np.delete(spread, index).any()
