"""Observations, rewards, endings and infos of every environment are those of single environments.

Single environments run in Gymnasium's `SyncVectorEnv`. Each walker has a seed, and in some scenes a
shape and a slope of its own: results do not depend on its place in the batch.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import cycle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from gym_passive_walker.envs.interface import OUTCOMES
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.envs.task import EVERY_STEP, EVERY_STRIDE
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import SCENES as NAMED
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from tests.conformance.pairs import PAIRS, ROWS, accepted, left, ways
from tests.conformance.scenes import COUNT, SEEDS, name_time_limits
from tests.conformance.scenes import SCENES as WRITTEN
from tests.gpu.reference import Reference

LIMIT, STEPS = 25, 60
LATER = [5, None, 7, 8, None]
MODES = ("NextStep", "SameStep", "Disabled")
SCENES = WRITTEN | PAIRS
EVERY = [*WRITTEN, *(pytest.param(name, marks=pytest.mark.slow) for name in PAIRS)]
IN_MODES = [
    *((name, mode) for name in WRITTEN for mode in MODES),
    *(
        pytest.param(name, mode, marks=pytest.mark.slow)
        for name, mode in zip(PAIRS, cycle(MODES), strict=False)
    ),
]


def fewer(cases):
    """All written scenes and every fourth one with pairs, for what another environment contains."""
    return [x for i, x in enumerate(cases) if i % 4 == 0 or not hasattr(x, "marks")]


def scene_of(name):
    """The arguments of a scene, without those that are one for each walker."""
    return {key: value for key, value in SCENES[name].items() if key not in ("walkers", "slopes")}


def vars_of(name):
    """Names of the arguments that differ from the default scene's."""
    own = scene_of(name)
    return {*own, *NAMED.get(own.get("scene"), {}), *SCENES[name]}


@lru_cache
def actions(name):
    """Actions of all steps, some of them beyond the bounds."""
    size = len(make_scene(**{"scene": "level", **scene_of(name)}).actions)
    draws = np.random.default_rng(0).uniform(-1.2, 1.2, (STEPS, COUNT, size))
    return draws.astype(np.float32)


def played(env, name, reset):
    """Observations of the first reset, and the results of all steps; see `reset`."""
    results = [env.reset(seed=list(SEEDS))[0]]
    for act in actions(name):
        results.append(env.step(act))
        ended = results[-1][2] | results[-1][3]
        if reset and ended.any():
            options = {"reset_mask": ended}
            results.append(env.reset(options=options)[0])
            assert options or isinstance(env, SyncVectorEnv)  # which empties them
    return results


@lru_cache
def expected(name, mode):
    """The results of single environments, their state then, and a reset with seeds for some."""
    own = [
        {arg[:-1]: SCENES[name][arg][i] for arg in ("walkers", "slopes") if arg in SCENES[name]}
        for i in range(COUNT)
    ]
    singles = SyncVectorEnv(
        [
            lambda each=each: gymnasium.make(ID, max_episode_steps=LIMIT, **scene_of(name), **each)
            for each in own
        ],
        autoreset_mode=mode,
    )
    results = [name_time_limits(result) for result in played(singles, name, mode == "Disabled")]
    each = [env.unwrapped for env in singles.envs]
    last = [[env.state, env.slope, env.contact, env.walker] for env in each]
    return results, last, singles.reset(seed=LATER)


def ends(name):
    """Number of episodes that end."""
    return sum(int((step[2] | step[3]).sum()) for step in expected(name, "SameStep")[0][1:])


@pytest.mark.slow
def test_each_two_options_that_can_be_together_are_in_a_scene():
    assert not [way for pair in left(ROWS) for way in ways(pair, 1) if accepted(way)]


@pytest.mark.parametrize(("name", "mode"), IN_MODES)
def test_vector_environment(name, mode, assert_same):
    envs = PassiveWalkerVectorEnv(
        COUNT, max_episode_steps=LIMIT, autoreset_mode=mode, **SCENES[name]
    )
    results, last, again = expected(name, mode)
    assert_same(played(envs, name, mode == "Disabled"), results)
    for i, (state, slope, contact, walker) in enumerate(last):
        np.testing.assert_array_equal(envs.states[i], state)
        assert (envs.slopes[i], envs.batch.contact(i).x) == (slope, contact)
        here = envs.walkers[i]
        assert (here.kind, here.parameters) == (walker.kind, walker.parameters)
    assert_same(envs.reset(seed=LATER), again)
    assert ends(name) > COUNT


@pytest.mark.parametrize(("copies", "threads"), [(12, 1), (461, 1), (922, 2)])
@pytest.mark.parametrize(
    "name", ["level", "all actuators", "disturbed", "own functions, disturbed",
             "system, disturbed and varied", "walkers and slopes", "walkers and slopes, rough"],
)  # fmt: skip
def test_large_batch_on_any_number_of_threads(name, copies, threads):
    given = {
        arg: [*SCENES[name][arg]] * copies for arg in ("walkers", "slopes") if arg in SCENES[name]
    }
    envs = PassiveWalkerVectorEnv(
        COUNT * copies, max_episode_steps=LIMIT, threads=threads, **SCENES[name] | given
    )
    results, last, _ = expected(name, "NextStep")
    seen, _ = envs.reset(seed=[*SEEDS] * copies)
    np.testing.assert_array_equal(seen, np.tile(results[0], (copies, 1)))
    for act, (*parts, infos) in zip(actions(name), results[1:], strict=True):
        *found, reported = envs.step(np.tile(act, (copies, 1)))
        reported, infos = flat(reported), flat(infos)
        for a, b in zip(
            [*found, *map(reported.get, infos)], [*parts, *infos.values()], strict=True
        ):
            each = a.reshape(copies, COUNT, -1)
            assert (each == b.reshape(COUNT, -1)).all()
    states = envs.states.reshape(copies, COUNT, -1)
    np.testing.assert_array_equal(states, np.broadcast_to([x[0] for x in last], states.shape))


@pytest.mark.parametrize(("name", "mode"), fewer(IN_MODES))
def test_tensors(name, mode):
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import PassiveWalkerTorchEnv

    envs = PassiveWalkerTorchEnv(
        COUNT, max_episode_steps=LIMIT, autoreset_mode=mode, **SCENES[name]
    )
    results = iter(expected(name, mode)[0])
    seen, infos = envs.reset(seed=list(SEEDS))
    np.testing.assert_array_equal(seen, next(results))
    for act in actions(name):
        *found, reported = envs.step(torch.from_numpy(act))
        *parts, infos = next(results)
        for a, b in zip(found, parts, strict=True):
            np.testing.assert_array_equal(a, b)
        over = parts[2] | parts[3]
        if mode == "SameStep":
            last = reported.pop("final_obs").numpy()
            np.testing.assert_array_equal(last[~over], parts[0][~over])
            if over.any():
                np.testing.assert_array_equal(last[over], np.stack(infos["final_obs"][over]))
        names = check_infos(reported, infos, infos.get("final_info", {}))
        assert names == reported.keys()
        if mode == "Disabled" and over.any():
            again, _ = envs.reset(options={"reset_mask": torch.from_numpy(over)})
            np.testing.assert_array_equal(again, next(results))


def check_infos(reported, *parts):
    """Compare infos without masks with infos of Gymnasium; return their names."""
    outer = {name.partition(".")[0] for part in parts for name in flat(part)}
    reported, parts = flat(reported), [flat(part) for part in parts]
    names = {n for part in parts for n in part if not n.startswith("_")} - {
        "final_obs",
        "final_info",
    }
    for name in names:
        wanted = np.zeros(COUNT)
        for part in parts:
            if name in part:
                mask, values = part["_" + name], part[name]
                if name == "outcome":
                    values = np.array([OUTCOMES.index(value or "") for value in values])
                wanted[mask] = values[mask]
        np.testing.assert_array_equal(reported[name], wanted, err_msg=name)
    return {name for name in outer if name[0] != "_"} - {"final_obs", "final_info"}


def flat(infos):
    """Infos in which the draws of domain randomization have entries of their own, with masks."""
    found = {name: values for name, values in infos.items() if "randomized" not in name}
    for name, values in infos.get("randomized", {}).items():
        hidden, plain = ("_", name[1:]) if name[0] == "_" else ("", name)
        found[f"{hidden}randomized.{plain}"] = values
    return found


def of_one(infos, i):
    """Infos of a single environment among those of Gymnasium."""
    return {
        name: of_one(values, i) if isinstance(values, dict) else values[i]
        for name, values in infos.items()
        if name[0] != "_" and name[:5] != "final"
    }


@pytest.mark.parametrize("name", WRITTEN)
def test_stable_baselines3(name):
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    envs = PassiveWalkerVecEnv(COUNT, max_episode_steps=LIMIT, **SCENES[name])
    envs._seeds = list(SEEDS)
    results = expected(name, "SameStep")[0]
    np.testing.assert_array_equal(envs.reset(), results[0])
    returns, lengths = np.zeros(COUNT), np.zeros(COUNT, int)
    for act, (seen, rewards, fell, late, infos) in zip(actions(name), results[1:], strict=True):
        found, paid, done, reported = envs.step(act)
        np.testing.assert_array_equal(found, seen)
        np.testing.assert_array_equal(paid, rewards.astype(np.float32))
        np.testing.assert_array_equal(done, fell | late)
        assert (found.dtype, paid.dtype, done.dtype) == (np.float32, np.float32, bool)
        returns, lengths = returns + rewards, lengths + 1
        for i in range(COUNT):
            info = reported[i]
            if not done[i]:
                assert info.pop("TimeLimit.truncated") is False
                assert info == of_one(infos, i)
                continue
            last = infos["final_info"]
            np.testing.assert_array_equal(info["terminal_observation"], infos["final_obs"][i])
            assert info["TimeLimit.truncated"] is bool(late[i] and not fell[i])
            assert info["episode"]["r"] == pytest.approx(returns[i], abs=1e-6)
            assert info["episode"]["l"] == lengths[i]
            ended = of_one(last, i)
            for entry in info.keys() & ended.keys():
                assert info[entry] == ended[entry], entry
            assert {*EVERY_STEP, *EVERY_STRIDE, "outcome"} < info.keys()
        returns[done], lengths[done] = 0.0, 0


def same_spaces(envs, name):
    """Check the spaces of an adapter: those of one walker in its scene."""
    env = gymnasium.make(ID, **scene_of(name))
    assert envs.action_space == env.action_space
    assert envs.observation_space == env.observation_space


@pytest.mark.parametrize("name", WRITTEN)
def test_rsl_rl(name):
    torch = pytest.importorskip("torch")
    pytest.importorskip("rsl_rl")
    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(COUNT, max_episode_steps=LIMIT, **SCENES[name])
    same_spaces(envs, name)
    assert envs.num_actions == envs.action_space.shape[0]
    seen, _ = envs.walkers.reset(seed=list(SEEDS))
    results = expected(name, "SameStep")[0]
    np.testing.assert_array_equal(seen, results[0])
    for act, (seen, rewards, fell, late, _) in zip(actions(name), results[1:], strict=True):
        found, paid, done, extras = envs.step(torch.from_numpy(act))
        np.testing.assert_array_equal(found["policy"], seen)
        np.testing.assert_array_equal(paid, rewards.astype(np.float32))
        np.testing.assert_array_equal(done.bool(), fell | late)
        np.testing.assert_array_equal(extras["time_outs"], late & ~fell)


@pytest.mark.parametrize("name", WRITTEN)
def test_skrl(name):
    torch = pytest.importorskip("torch")
    pytest.importorskip("skrl")
    from gym_passive_walker.torch.trainers.skrl import SkrlWalkers

    envs = SkrlWalkers(COUNT, max_episode_steps=LIMIT, **SCENES[name])
    same_spaces(envs, name)
    envs._seeds = list(SEEDS)
    results = expected(name, "SameStep")[0]
    np.testing.assert_array_equal(envs.reset()[0], results[0])
    for act, parts in zip(actions(name), results[1:], strict=True):
        found = envs.step(torch.from_numpy(act))
        np.testing.assert_array_equal(found[0], parts[0])
        for column, values in zip(found[1:4], parts[1:4], strict=True):
            assert column.shape == (COUNT, 1)
            np.testing.assert_array_equal(column[:, 0], values.astype(column.numpy().dtype))


@pytest.mark.parametrize("name", WRITTEN)
def test_torchrl(name):
    torch = pytest.importorskip("torch")
    pytest.importorskip("torchrl")
    from tensordict import TensorDict
    from torchrl.envs.utils import check_env_specs

    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    envs = TorchRlWalkers(COUNT, max_episode_steps=LIMIT, **SCENES[name])
    env = gymnasium.make(ID, **scene_of(name))
    for spec, space in (
        (envs.action_spec, env.action_space),
        (envs.observation_spec["observation"], env.observation_space),
    ):
        assert spec.shape == (COUNT, *space.shape) and spec.dtype == torch.float32
        for i in range(COUNT):
            np.testing.assert_array_equal(spec.space.low[i], space.low)
            np.testing.assert_array_equal(spec.space.high[i], space.high)
    assert all(env.action_space.contains(row.numpy()) for row in envs.rand_action()["action"])
    check_env_specs(envs)
    envs._next_seeds = list(SEEDS)
    results = iter(expected(name, "Disabled")[0])
    np.testing.assert_array_equal(envs.reset()["observation"], next(results))
    for act in actions(name):
        found = envs.step(TensorDict({"action": torch.from_numpy(act)}, batch_size=[COUNT]))["next"]
        seen, rewards, fell, late, _ = next(results)
        np.testing.assert_array_equal(found["observation"], seen)
        np.testing.assert_array_equal(found["reward"][:, 0], rewards.astype(np.float32))
        np.testing.assert_array_equal(found["terminated"][:, 0], fell)
        np.testing.assert_array_equal(found["truncated"][:, 0], late)
        if (over := fell | late).any():
            mask = TensorDict({"_reset": torch.from_numpy(over)[:, None]}, batch_size=[COUNT])
            again = envs.reset(mask)["observation"]  # torchrl clears the other rows
            np.testing.assert_array_equal(again[over], next(results)[over])


def differentiable(name):
    """Whether a scene's episodes have gradients."""
    from gym_passive_walker.torch import initial_state

    try:
        initial_state(make_scene(**{"scene": "level", **scene_of(name)}), 1, seed=0)
    except SceneError as error:
        assert "rollouts check no constraints" in str(error)
        return False
    return "walkers" not in SCENES[name]


@pytest.mark.parametrize("name", EVERY)
def test_rollout_with_gradients(name):
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import rollout

    if not differentiable(name):
        pytest.skip("a scene without gradients, or with walkers of its own")
    scene = make_scene(**{"scene": "level", **scene_of(name)})
    envs = PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="Disabled", max_episode_steps=None)
    plan = actions(name).astype(float)
    given = iter(torch.from_numpy(plan))
    walked = rollout(lambda seen: next(given), scene, STEPS, count=COUNT, seed=SEEDS[0])
    seen, _ = envs.reset(seed=SEEDS[0])
    going = np.ones(COUNT, bool)
    for k, act in enumerate(plan):
        np.testing.assert_array_equal(walked.going[k], going)
        np.testing.assert_allclose(walked.observations[k][going], seen[going], atol=1e-6)
        seen, rewards, ended, _, infos = envs.step(act)
        np.testing.assert_allclose(walked.rewards[k][going], rewards[going], rtol=0.0, atol=1e-7)
        for ours, theirs in ((walked.distances, "distance"), (walked.energies, "energy")):
            np.testing.assert_allclose(ours[k][going], infos[theirs][going], atol=1e-7)
        outcomes = np.array([OUTCOMES.index(each) for each in infos["outcome"]])
        np.testing.assert_array_equal(walked.outcomes[k][going], outcomes[going])
        assert not walked.rewards[k][~going].any()
        going &= ~ended
        if ended.any():  # the environment must be reset where an episode has ended
            envs.reset(options={"reset_mask": ended})
    np.testing.assert_array_equal(walked.end.going, going)


@pytest.mark.parametrize("name", fewer(EVERY))
def test_gpu(name):
    """In numba's simulator, which is slow; the reference draws the random numbers of the GPU."""
    torch = pytest.importorskip("torch")
    from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv

    if {"walkers", "domain_randomization"} & vars_of(name):
        pytest.skip("a GPU draws other walkers")
    scene = make_scene(**{"scene": "level", "tick": 0.5, **scene_of(name)})
    envs = PassiveWalkerGpuEnv(COUNT, scene, seed=7, max_episode_steps=12)
    reference = Reference(scene, COUNT, 7, 12)
    seen, infos = envs.reset()
    np.testing.assert_array_equal(seen, reference.observations)
    np.testing.assert_array_equal(infos.pop("final_obs"), seen)
    assert not any(values.any() for values in infos.values())
    endings = 0
    for act in actions(name)[:20]:
        *found, infos = envs.step(torch.from_numpy(act))
        *parts, last, ledger = reference.step(act.reshape(-1))
        for a, b in zip(found, (reference.observations, *parts), strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(infos.pop("final_obs"), last)
        assert infos.keys() == {*EVERY_STEP, *EVERY_STRIDE, "outcome"}
        late = parts[2] & ~parts[1]
        ledger_outcomes = np.where(late, OUTCOMES.index("time_limit"), ledger["outcome"])
        np.testing.assert_array_equal(infos.pop("outcome"), ledger_outcomes)
        for entry, values in infos.items():
            np.testing.assert_array_equal(values, ledger[entry], err_msg=entry)
        assert envs.batch.arrays.reported.to_host().tobytes() == ledger.tobytes()
        endings += int((parts[1] | parts[2]).sum())
    assert endings >= COUNT
    assert envs.batch.arrays.episodes.sum() == COUNT + endings
