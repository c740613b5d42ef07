"""Rollouts of disturbed walkers: the environment's walks, and their derivatives."""

import numpy as np
import pytest
import torch

from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.torch import initial_state, rollout

COUNT, HORIZON = 5, 60
NEAR = {"slope": 0.01, "tolerance": 1e-12, "reset_noise_scale": 0.02}
ROUGH = {"terrain": {"rough": {"height_std": 0.001, "slope_std": 0.002}}, "terrain_lookahead": 2}
OFTEN = {"pushes": {"rate": 0.7, "impulse": (-0.003, 0.005)}}
NOISY = {"observation_noise": 0.01, "action_noise": 0.05, "action_delay": 2}

DISTURBED = {
    "rough ground": ROUGH,
    "pushes": OFTEN,
    "pushes at every instant": {"pushes": {"rate": 25.0, "impulse": (-0.001, 0.001)}},
    "noise and delay": NOISY,
    "everything": ROUGH | OFTEN | NOISY | {"domain_randomization": {"foot_radius": 0.05}},
    "drawn delays and strengths": OFTEN | {"action_noise": 0.05, "domain_randomization": {
        "action_delay": {"choices": [0, 1, 3], "operation": "abs"},
        "max_hip_torque": (0.5, 1.0), "thigh_mass": 0.1,
    }},
    "torques of a stride": OFTEN | ROUGH | {"control": "stride", "max_hip_torque": 0.003},
    "three actuators": OFTEN | NOISY | {
        "walker": "E", "actions": ("hip", "ankle", "push_off"), "max_push_off": 0.01,
        "slope": 0.009, "max_hip_torque": 0.005, "max_ankle_torque": 0.005,
    },
    "a commanded speed": OFTEN | ROUGH | {"command": (0.1, 0.2)},
    "readings of constraints": OFTEN | {"constraints": {"friction": "report"}},
    "an own reward": OFTEN | NOISY | {
        "reward": lambda step: step.distance - 3.0 * step.push * step.state.stance_rate
        - 0.1 * (step.action[0] - step.last_action[0]) ** 2 + 0.01 * step.time,
    },
}  # fmt: skip


def plan(scene, steps, seed=0):
    """Actions of single precision, (steps, COUNT, actions)."""
    size = steps, COUNT, len(scene.actions)
    return np.random.default_rng(seed).uniform(-0.1, 0.3, size).astype(np.float32)


@pytest.mark.parametrize("name", DISTURBED)
def test_a_disturbed_rollout_is_the_walk_of_the_environment(name):
    scene = make_scene(NEAR | DISTURBED[name])
    steps = 6 if scene.control == "stride" else HORIZON
    actions = plan(scene, steps)
    envs = PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="Disabled")
    seen, _ = envs.reset(seed=3)
    given = iter(torch.from_numpy(actions.astype(float)))
    walked = rollout(lambda _: next(given), scene, steps, count=COUNT, seed=3)
    for k in range(steps):
        np.testing.assert_allclose(walked.observations[k], seen, rtol=1e-6, atol=1e-6)
        seen, rewards, terminated, _, infos = envs.step(actions[k])
        np.testing.assert_allclose(walked.rewards[k], rewards, rtol=0.0, atol=1e-10)
        assert not terminated.any()
    assert (walked.end.strides.numpy() == infos["strides"]).all() and walked.end.strides.min() > 0
    if scene.pushes:
        np.testing.assert_array_equal(walked.end.pushes, infos["pushes"])
        assert walked.end.pushes.sum() > COUNT


@pytest.mark.parametrize("name", DISTURBED)
def test_the_derivative_of_a_disturbed_walk_is_its_change_with_the_same_draws(name):
    """Pushes come at times of the walk: a stride that ends earlier meets its push later."""
    scene = make_scene(NEAR | DISTURBED[name])
    steps = 6 if scene.control == "stride" else HORIZON
    start = initial_state(scene, COUNT, seed=3)
    chosen = torch.from_numpy(plan(scene, steps).astype(float))
    torch.manual_seed(0)
    gain = 0.05 * torch.randn((8, len(scene.actions)), dtype=torch.float64)

    def returned(actions, gain, states):
        given, here = iter(actions), start._replace(states=states, starts=states[:, :1])
        policy = lambda seen: next(given) + seen[:, :8] @ gain  # noqa: E731
        return rollout(policy, scene, steps, start=here).rewards

    leaves = [x.clone().requires_grad_() for x in (chosen, gain, start.states)]
    weights = torch.rand((steps, COUNT), dtype=torch.float64)  # of each step's reward
    walked = returned(*leaves)
    gradients = torch.autograd.grad((weights * walked).sum(), leaves)
    for part in range(3):
        along = [torch.randn_like(x) * (i == part) for i, x in enumerate(leaves)]
        along[2][:, [0, 1, 2, 5]] = 0.0  # the rates of stance leg and thigh alone
        with torch.no_grad():
            ahead, behind = (
                returned(*(x + side * 1e-6 * way for x, way in zip(leaves, along, strict=True)))
                for side in (1.0, -1.0)
            )
        difference = float((weights * (ahead - behind)).sum()) / 2e-6
        exact = float((gradients[part] * along[part]).sum())
        assert difference == pytest.approx(exact, rel=1e-5, abs=1e-7), part
