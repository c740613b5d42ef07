"""Walkers of a batch of tensors do not depend on each other, in values, gradients or options."""

import numpy as np
import pytest
import torch

import gym_passive_walker as gpw
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.torch import (
    PassiveWalkerTorchEnv,
    Stride,
    Tick,
    initial_state,
    rollout,
    stride,
    tick,
)

COUNT = 4


def numbers(*values):
    return torch.tensor(values, dtype=torch.float64, requires_grad=True)


@pytest.fixture(scope="module")
def state():
    """A state on the gait of the laboratory's walker."""
    return torch.tensor(gpw.find_gait("lab", 0.036).state)


def batch(state):
    """Arguments that all differ from walker to walker, for strides and control steps."""
    shares = torch.linspace(0.995, 1.005, COUNT, dtype=torch.float64)
    given = {
        "slope": numbers(0.035, 0.036, 0.037, 0.038), "hip_torque": numbers(0.0, 0.01, -0.02, 0.03),
        "push_off": numbers(0.0, 0.01, 0.02, 0.005),
        "height_change": numbers(0.0, 1e-3, -1e-3, 5e-4),
        "slope_change": numbers(0.0, -1e-3, 1e-3, 2e-3),
    }  # fmt: skip
    return given | {"state": (shares[:, None] * state).requires_grad_()}


@pytest.mark.parametrize("kind", [stride, tick])
def test_each_walker_is_as_it_would_be_alone_in_values_and_gradients(kind, state):
    given = batch(state)
    if kind is tick:
        given |= {"duration": numbers(0.1, 5.0, 0.3, 5.0), "push": numbers(0.0, 1e-3, -1e-3, 2e-3)}
    given["parameters"] = {"gravity": numbers(9.81, 9.7, 9.9, 9.8)}

    def lane(value, i):
        return (
            {n: x[i] for n, x in value.items()} if isinstance(value, dict) else value[i]
        )  # fmt: skip

    together = kind("lab", **given)
    assert type(together) is (Stride if kind is stride else Tick)
    inputs = [*given["parameters"].values(), *(x for n, x in given.items() if n != "parameters")]
    for i in range(COUNT):
        alone = kind("lab", **{name: lane(value, i) for name, value in given.items()})
        for name, a, b in zip(together._fields, together, alone, strict=True):
            assert torch.equal(a[i], b), name
            assert b.shape == ((6,) if name == "state" else ())
            kinds = {"outcome": torch.int64, "phase": torch.int64, "walks": torch.bool}
            assert a.dtype == b.dtype == kinds.get(name, torch.float64)
        for name in ("duration", "hip_work", "push_off_work", "friction_loss"):
            ours, theirs = getattr(together, name), getattr(alone, name)
            if not ours.requires_grad:
                continue
            found = torch.autograd.grad(ours[i], inputs, retain_graph=True, allow_unused=True)
            wanted = torch.autograd.grad(theirs, inputs, retain_graph=True, allow_unused=True)
            for a, b in zip(found, wanted, strict=True):
                if b is None:
                    assert a is None or not a.any()
                else:
                    torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-14)
                    assert not a[[j for j in range(COUNT) if j != i]].any()


def test_a_number_stands_for_every_walker(state):
    """One state and several slopes are several walkers."""
    states = torch.stack([state] * 3)
    for kind, given in ((stride, {}), (tick, {"duration": 0.4})):
        plain = {"slope": 0.036, "hip_torque": 0.01, "push_off": 0.02, **given}
        every = {name: torch.full((3,), value).double() for name, value in plain.items()}
        for a, b in zip(kind("lab", state=states, **plain), kind("lab", state=states, **every),
                        strict=True):  # fmt: skip
            torch.testing.assert_close(a, b, rtol=1e-6, atol=1e-6)
        for a, b in zip(kind("lab", state=state, **every), kind("lab", state=states, **plain),
                        strict=True):  # fmt: skip
            torch.testing.assert_close(a, b, rtol=1e-6, atol=1e-6)


def test_a_control_step_has_the_units_of_its_walker(state):
    """A step until heelstrike is the stride. Both are in the walker's own units."""
    for name, slope in (("lab", 0.036), ("C", 0.03)):
        here = torch.tensor(gpw.find_gait(name, slope).state)
        whole = stride(name, slope, here, hip_torque=0.01, push_off=0.01)
        ticked = tick(name, slope, here, 0.01, duration=1e3, push_off=0.01)
        shared = set(Stride._fields) & set(Tick._fields)
        for field in shared - {"margin"}:
            a, b = getattr(whole, field), getattr(ticked, field)
            torch.testing.assert_close(a, b, rtol=1e-8, atol=1e-8, msg=field)
        own = tick(name, slope, here, duration=1e3)  # the hip goes as far as the feet in a gait
        torch.testing.assert_close(own.distance, stride(name, slope, here).step_length)
        lost = whole.kneestrike_loss + whole.heelstrike_loss
        torch.testing.assert_close(ticked.collision_loss, lost, rtol=1e-8, atol=1e-8)
        short = tick(name, slope, here, duration=0.05)
        assert short.outcome == Outcome.RUNNING and short.duration.item() == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"controls": {"hip": 0.1}}, ValueError, "controls are those of a System"),
        ({"phase": torch.zeros(3, dtype=torch.int64)}, ValueError, "state must have shape"),
        ({"duration": torch.zeros(2)}, TypeError, "duration is torch.float32"),
        ({"push": torch.zeros(2)}, TypeError, "push is torch.float32"),
        ({"ankle_torque": torch.zeros(2)}, TypeError, "ankle_torque is torch.float32"),
        ({"slope_change": torch.zeros(2)}, TypeError, "slope_change is torch.float32"),
        ({"ankle_torque": 0.1}, ValueError, "ankle"),
    ],
)
def test_an_argument_that_does_not_fit_is_refused_by_its_name(arguments, error, words, state):
    states = torch.stack([state] * 2)
    with pytest.raises(error, match=words):
        tick("lab", 0.036, states, **{"duration": 0.1, **arguments})


# Episodes.

GROUND = {"terrain": {"rough": {"height_std": 0.002, "slope_std": 0.002}}, "terrain_lookahead": 2}
SCENES = {
    "disturbed": {
        "pushes": {"rate": 0.7, "impulse": (-0.003, 0.005)}, "observation_noise": 0.01,
        "action_noise": 0.05, "action_delay": 2,
    },
    "level": {}, "uneven": GROUND, "commanded": {"command": (0.1, 0.2), "command_weight": 1.0},
    "bodies": {"domain_randomization": {"foot_radius": 0.1}, "observe_body": ("foot_radius",)},
    "slopes": {"slope": (0.0, 0.03)}, "strides": {"control": "stride", "slope": 0.03},
}  # fmt: skip


SHORT = {"steps": 6, "scale": 0.125}


def scene(name):
    return make_scene("level", reset_noise_scale=0.15, **SCENES[name])


def actions(seed=0, count=COUNT, steps=60, scale=1.0):
    """A plan of small torques, (steps, count, 1)."""
    drawn = np.random.default_rng(seed).uniform(-0.3, 0.6, (steps, 16, 1))[:, :count]
    return scale * torch.from_numpy(drawn.astype(np.float32).astype(float))


def played(plan):
    """A policy that plays a plan."""
    left = iter(plan)
    return lambda seen: next(left)


def ends(found):
    """Tensors of the final state."""
    return [*found.end[:10], *found.end.parameters.values(), found.end.outcome]


@pytest.mark.parametrize("name", SCENES)
def test_a_rollout_in_parts_and_walkers_apart_are_the_rollout(name):
    here, plan = scene(name), actions(**(SHORT if name == "strides" else {}))
    whole = rollout(played(plan), here, len(plan), count=COUNT, seed=5)
    cut = len(plan) // 2 - 1
    first = rollout(played(plan[:cut]), here, cut, count=COUNT, seed=5)
    second = rollout(played(plan[cut:]), here, len(plan) - cut, start=first.end)
    for field in whole._fields[1:-1]:
        parts = torch.cat([getattr(first, field), getattr(second, field)])
        np.testing.assert_array_equal(parts, getattr(whole, field), err_msg=field)
    for a, b in zip(ends(whole), ends(second), strict=True):
        np.testing.assert_array_equal(a, b)
    torch.testing.assert_close(whole.returns, first.returns + second.returns)
    for i in (1, 3):
        alone = rollout(played(plan[:, i : i + 1]), here, len(plan), count=1, seed=5 + i)
        for field in whole._fields[1:-1]:
            ours, theirs = getattr(whole, field)[:, i], getattr(alone, field)[:, 0]
            np.testing.assert_array_equal(ours, theirs, err_msg=field)
        for a, b in zip(ends(whole), ends(alone), strict=True):
            assert np.array_equal(a[:, i] if a is whole.end.footholds else a[i], b[:, 0] if a is
                                  whole.end.footholds else b[0])  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_the_state_after_a_rollout_is_the_environment_s(name):
    here, plan = scene(name), actions(**(SHORT if name == "strides" else {"steps": 45}))
    walked = rollout(played(plan), here, len(plan), count=COUNT, seed=5)
    envs = PassiveWalkerVectorEnv(COUNT, here, max_episode_steps=-1)
    envs.reset(seed=5)
    begun = initial_state(here, COUNT, seed=5)
    np.testing.assert_array_equal(begun.slopes, envs.slopes)
    for field in ("times", "progress", "strides", "phases", "outcome"):
        assert not getattr(begun, field).any()
    going, strides = np.ones(COUNT, bool), np.zeros(COUNT, int)
    for act in plan:
        _, _, ended, _, infos = envs.step(act.numpy().astype(np.float32))
        strides += (infos["step_period"] > 0.0) & going
        going &= ~ended
    assert going.sum() >= 2
    np.testing.assert_array_equal(walked.end.going, going)
    np.testing.assert_array_equal(walked.end.strides[going], strides[going])
    times = envs.batch.records["time"][:, 0]
    np.testing.assert_allclose(walked.end.times[going], times[going], atol=1e-9)
    bodies = envs.batch.walkers
    for i in np.flatnonzero(going):
        state = bodies[i].units.to_dimensionless(envs.batch.states[i])
        np.testing.assert_allclose(walked.end.states[i], state, atol=1e-8)
        for parameter, values in walked.end.parameters.items():
            assert values[i] == getattr(bodies[i], parameter)
    assert (walked.end.commands > 0.0).all() == (name == "commanded")


def test_walkers_that_have_fallen_stay_as_they_are():
    here = make_scene("level", max_hip_torque=0.5)
    push = [torch.tensor([[-1.0], [0.0]], dtype=torch.float64)] * 40
    walked = rollout(played(push), here, 40, count=2, seed=0)
    assert walked.end.going.tolist()[0] is False
    fell = int((~walked.going[:, 0]).nonzero()[0])
    short = rollout(played(push), here, fell, count=2, seed=0)
    assert torch.equal(short.end.states[0], walked.end.states[0])
    assert walked.end.outcome[0] == walked.outcomes[fell - 1, 0] > Outcome.HEELSTRIKE
    for field in ("rewards", "distances", "energies"):
        assert not getattr(walked, field)[fell:, 0].any()
    assert (
        torch.isinf(walked.margins[fell:, 0]).all() or torch.isnan(walked.margins[fell:, 0]).all()
    )


def test_pushes_may_be_one_number_one_a_step_or_one_for_each_walker():
    here, plan = scene("level"), actions(steps=6)
    full = torch.full((6, COUNT), 2e-4, dtype=torch.float64)
    given = (2e-4, full[:, :1], full[:1], full, full[0])
    found = [
        rollout(played(plan), here, 6, count=COUNT, seed=1, pushes=x).end.states for x in given
    ]
    for states in found[1:]:
        assert torch.equal(states, found[0])
    own = full.clone()
    own[2, 1] = -1e-3
    other = rollout(played(plan), here, 6, count=COUNT, seed=1, pushes=own).end.states
    assert (other != found[0]).any(dim=1).tolist() == [False, True, False, False]
    for wrong in (np.zeros((6, 3)), np.zeros((5, 1)), np.zeros(3), np.zeros((1, 6, COUNT))):
        with pytest.raises(
            ValueError, match=rf"pushes must be a number or of shape \(6, {COUNT}\)"
        ):
            rollout(played(plan), here, 6, count=COUNT, pushes=wrong)


def test_footholds_of_each_walker_are_its_own_and_come_one_a_stride():
    here = make_scene("level", reset_noise_scale=0.05)
    changes = torch.zeros((3, COUNT, 2), dtype=torch.float64)
    changes[0, 1, 0], changes[1, 2, 1] = 1e-3, 2e-3
    plan = actions(steps=70)
    plain = rollout(played(plan), here, 70, count=COUNT, seed=3)
    start = initial_state(here, COUNT, seed=3, footholds=changes)
    walked = rollout(played(plan), here, 70, start=start)
    struck = (plain.outcomes == Outcome.HEELSTRIKE).cumsum(0)
    for i, stride_number in ((0, None), (1, 1), (2, 2), (3, None)):
        differs = (walked.distances[:, i] != plain.distances[:, i]).nonzero()
        if stride_number is None:
            assert len(differs) == 0
        elif len(differs):
            assert struck[int(differs[0]), i] >= stride_number - 1
    assert (walked.distances[:, 1] != plain.distances[:, 1]).any()


# The environment on tensors.


def test_it_has_the_spaces_and_the_number_of_the_vector_environment():
    envs = PassiveWalkerTorchEnv(3, "rough", actions=("hip", "push_off"))
    arrays = PassiveWalkerVectorEnv(3, "rough", actions=("hip", "push_off"))
    assert envs.num_envs == 3 and envs.device == torch.device("cpu")
    assert envs.observation_space == arrays.single_observation_space
    assert envs.action_space == arrays.single_action_space
    assert envs.render() is None
    envs.close()


def test_around_an_environment_both_advance_the_same_walkers():
    arrays, twin = (PassiveWalkerVectorEnv(3, "level", autoreset_mode="Disabled") for _ in "ab")
    tensors = PassiveWalkerTorchEnv.around(arrays)
    assert tensors.envs is arrays and tensors.device.type == "cpu"
    tensors.reset(seed=4), twin.reset(seed=4)
    act = np.full((3, 1), 0.2, np.float32)
    for envs in (tensors, arrays, tensors):
        given = torch.from_numpy(act).requires_grad_() if envs is tensors else act
        found, wanted = envs.step(given), twin.step(act)
        for a, b in zip(found[:4], wanted[:4], strict=True):
            np.testing.assert_array_equal(a, b)
    assert PassiveWalkerTorchEnv.around(arrays, "meta").device.type == "meta"


def test_seeds_may_be_one_or_one_for_each():
    envs, arrays = PassiveWalkerTorchEnv(3), PassiveWalkerVectorEnv(3)
    for seed in (7, [3, 1, 2]):
        found, infos = envs.reset(seed=seed)
        np.testing.assert_array_equal(found, arrays.reset(seed=seed)[0])
        assert not any(each.any() for each in infos.values()) and found.dtype == torch.float32
    state = gpw.find_gait("lab", 0.036).state
    envs, arrays = (kind(3, "lab") for kind in (PassiveWalkerTorchEnv, PassiveWalkerVectorEnv))
    for each in (envs, arrays):
        each.reset(seed=0)
    mask = np.array([True, False, True])
    given = {"state": state, "reset_mask": torch.from_numpy(mask)}
    found = envs.reset(options=given)[0]
    np.testing.assert_array_equal(found, arrays.reset(options=given | {"reset_mask": mask})[0])
    assert isinstance(given["reset_mask"], torch.Tensor)  # the caller's own stays


def test_final_observations_are_of_ended_walkers_and_the_present_of_others():
    tensors = PassiveWalkerTorchEnv(6, slope=0.1, max_episode_steps=30)
    arrays = PassiveWalkerVectorEnv(6, slope=0.1, max_episode_steps=30, autoreset_mode="SameStep")
    tensors.reset(seed=1), arrays.reset(seed=1)
    ended = np.zeros(6, bool)
    for _ in range(30):
        seen, rewards, fell, late, infos = tensors.step(torch.zeros(6, 1))
        wanted = arrays.step(np.zeros((6, 1), np.float32))
        over = (fell | late).numpy()
        assert rewards.dtype == torch.float64
        np.testing.assert_array_equal(infos["final_obs"][~over], seen[~over])
        if over.any():
            last = np.stack(wanted[4]["final_obs"][over])
            np.testing.assert_array_equal(infos["final_obs"][over], last)
            assert not np.array_equal(infos["final_obs"][over], seen[over])
            assert (infos["outcome"][fell] > Outcome.HEELSTRIKE).all()
            assert not any(name.startswith("_") for name in infos)
            assert all(isinstance(value, torch.Tensor) for value in infos.values())
            assert infos["outcome"].dtype == torch.int8
        ended |= over
    assert ended.all()
