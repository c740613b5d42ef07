"""Gradients through walks of a user's own system in PyTorch."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.own.statements import COMPASS, DRIVEN, SCENES, STRAIGHT, Legs

torch = pytest.importorskip("torch")
gt = pytest.importorskip("gym_passive_walker.torch")

SLOPE = 0.03
BODY = {DRIVEN.body._fields[0]: DRIVEN.body[0]}


def inputs():
    """What a stride depends on, as tensors that want gradients."""
    (value,) = BODY.values()
    given = (gpw.find_gait(DRIVEN, SLOPE).state, SLOPE, value, 0.001, 0.01, 0.005)
    return [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in given]


def strode(state, slope, body, rise, torque, push):
    """A whole stride; without the push."""
    (name,) = BODY
    return gt.stride(
        DRIVEN, slope, state, controls={"hip": torque}, height_change=rise, parameters={name: body}
    )


def ticked(state, slope, body, rise, torque, push, duration=0.9):
    """A control step after a push; without heelstrike if it is short."""
    (name,) = BODY
    return gt.tick(
        DRIVEN, slope, state, duration=duration, controls={"hip": torque}, height_change=rise,
        push=push, parameters={name: body},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("walk", "names"),
    [
        (strode, ("state", "duration", "hip_work", "step_length", "gravity_work")),
        (ticked, ("state", "distance", "hip_work")),
        (partial(ticked, duration=9.0), ("state", "distance", "duration", "collision_loss")),
    ],
)
def test_gradients_are_those_of_differences(walk, names):
    def results(*given):
        walked = walk(*given)
        return tuple(getattr(walked, name) for name in names)

    assert torch.autograd.gradcheck(results, inputs(), atol=1e-6, rtol=1e-5)


def test_a_compass_stated_by_its_masses_has_the_gradients_of_the_package_s_own():
    state = gpw.find_gait(COMPASS, SLOPE).state
    whole = state[[0, 1, 1, 2, 3, 3]]
    found, expected = (torch.tensor(x, requires_grad=True) for x in (state, whole))
    own, known = gt.stride(COMPASS, SLOPE, found), gt.stride(STRAIGHT, SLOPE, expected)
    for name in ("duration", "step_length", "heelstrike_loss", "gravity_work"):
        pair = getattr(own, name), getattr(known, name)
        assert pair[0].item() == pytest.approx(pair[1].item(), rel=1e-9)
        (by_own,) = torch.autograd.grad(pair[0], found, retain_graph=True)
        (by_known,) = torch.autograd.grad(pair[1], expected, retain_graph=True)
        np.testing.assert_allclose(by_own, by_known[[0, 1, 3, 4]], rtol=1e-6, atol=1e-8)
    assert own.margin.item() > 0.0


OWN = {
    "compass": SCENES["compass"],
    "five links": {**SCENES["five links"], "control": "stride", "reset_noise_scale": 0.0},
    "rough ground": {
        "system": DRIVEN, "slope": (0.02, 0.03), "command": 0.3,
        "terrain": gpw.rough(height_std=0.0005), "domain_randomization": dict.fromkeys(BODY, 0.05),
    },
    "twice the mass": {
        "system": replace(DRIVEN, name="heavy compass", body=Legs(*(2.0 * x for x in DRIVEN.body))),
        "slope": SLOPE, "reward": lambda step: step.distance - 3.0 * step.collision_loss,
    },
    "own reward": {
        "system": DRIVEN, "slope": SLOPE, "terminated": lambda step: step.state.stance > 0.3,
        "reward": lambda step: step.distance - 10.0 * step.hip_work_absolute - step.state.stance**2,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", OWN)
def test_a_rollout_has_the_environment_s_rewards_and_exact_gradients(name):
    scene = make_scene(OWN[name], tolerance=1e-10)
    actions = len(scene.actions)
    seen = 2 * scene.walker.coordinates + 1 + (scene.command is not None)
    steps, scale = (2, 0.002) if scene.control == "stride" else (50, 0.2)
    rng = np.random.default_rng(0)
    way = torch.tensor(rng.normal(size=(seen, actions)))
    weights = torch.tensor(scale * rng.uniform(-1.0, 1.0, (seen, actions)), requires_grad=True)

    def walked(weights):
        return gt.rollout(lambda seen: seen @ weights, scene, steps, count=4, seed=1)

    found = walked(weights)
    env = PassiveWalkerVectorEnv(4, scene)
    observations, _ = env.reset(seed=1)
    for k in range(steps):
        np.testing.assert_allclose(found.observations[k].detach(), observations, atol=2e-6)
        observations, rewards, ended, *_ = env.step(observations @ weights.detach().numpy())
        np.testing.assert_allclose(found.rewards[k].detach(), rewards, atol=1e-6)
        if ended.any():
            break
    assert k > 0
    (exact,) = torch.autograd.grad(found.returns.sum(), weights)
    returns = [float(walked(weights.detach() + step * way).returns.sum()) for step in (1e-6, -1e-6)]
    expected = (returns[0] - returns[1]) / 2e-6
    assert float((exact * way).sum()) == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_a_push_changes_the_momentum_by_its_impulse_whatever_the_mass():
    """Those of rollouts are in m sqrt(g l), those of control steps in the system's own units."""
    heavy = OWN["twice the mass"]["system"]
    scene = make_scene(system=heavy, slope=SLOPE, reset_noise_scale=0.0)
    state = gt.initial_state(scene, 1).states[0]
    walked = gt.rollout(lambda seen: 0.0 * seen[:, :1], scene, 1, count=1, pushes=0.05)
    pushed, light = (
        gt.tick(system, SLOPE, state, duration=scene.tick, push=push).state
        for system, push in ((heavy, 0.1), (DRIVEN, 0.05))
    )
    np.testing.assert_allclose(pushed, walked.end.states[0], atol=1e-7)
    np.testing.assert_allclose(pushed, light, atol=1e-7)


def test_what_a_system_does_not_have_is_refused():
    state = DRIVEN.start
    with pytest.raises(ValueError, match=r"takes no hip_torque: give its controls by name"):
        gt.stride(DRIVEN, SLOPE, state, hip_torque=0.1)
    with pytest.raises(ValueError, match="takes no slope_change"):
        gt.stride(DRIVEN, SLOPE, state, slope_change=0.1)
    with pytest.raises(ValueError, match=r"has no knee.*; it has hip"):
        gt.stride(DRIVEN, SLOPE, state, controls={"knee": 0.1})
    with pytest.raises(ValueError, match="controls are those of a System"):
        gt.stride("lab", SLOPE, np.zeros(6), controls={"hip": 0.1})
    with pytest.raises(ValueError, match=r"this walker has no hip_mass.*; it has "):
        gt.stride(DRIVEN, SLOPE, state, parameters={"hip_mass": 1.0})
    with pytest.raises(ValueError, match=r"state must have shape \(4,\)"):
        gt.stride(DRIVEN, SLOPE, np.zeros(6))
    (name,) = BODY
    with pytest.raises(ValueError, match="links"):
        gt.stride(DRIVEN, SLOPE, state, parameters={name: -5.0})
