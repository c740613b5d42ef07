"""Both learners against a plain reference: the value at a time limit, and clipping of gradients.

The reference loops over steps and walkers. The value after a fall is zero. A walker at its time
limit would have continued, so the critic gives the value of the rest.
"""

import dataclasses

import numpy as np
import pytest
import torch

from agents import envs
from agents.config import configure
from agents.learner import build
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.envs.seeds import training_seeds

GAMMA, LAMBDA = 0.9, 0.8
WALKERS, STEPS, LIMIT = 8, 48, 14


def untrained(algo, **hyperparams):
    """An agent with short episodes, which end by falls and by the time limit."""
    config = dataclasses.replace(
        configure(algo, "level", n_envs=WALKERS),
        episode_steps=LIMIT, normalize=None, exploration=None,
        training={"reset_noise_scale": 0.8, "max_hip_torque": 0.3},
    )  # fmt: skip
    sizes = {"n_steps": STEPS, "batch_size": STEPS * WALKERS, "gamma": GAMMA, "gae_lambda": LAMBDA}
    model = build(config, envs.training_envs(config), **sizes | hyperparams)
    return model, model._setup_learn(1, None)[1]


def walked(actions, seed):
    """Observations before and after each step, rewards, falls and time limits of walkers."""
    env = PassiveWalkerVecEnv(
        WALKERS, "level", max_episode_steps=LIMIT, reset_noise_scale=0.8, max_hip_torque=0.3
    )
    env.seed(training_seeds(seed, WALKERS))
    before, callback = env.reset(), []
    for acts in actions:
        seen, rewards, dones, infos = env.step(acts.clip(-1.0, 1.0))
        after, fell, late = seen.copy(), np.zeros(WALKERS, bool), np.zeros(WALKERS, bool)
        for i in range(WALKERS):
            if dones[i]:
                after[i] = infos[i]["terminal_observation"]
                late[i] = infos[i]["outcome"] == "time_limit"
                fell[i] = not late[i]
        callback.append((before, after, rewards, fell, late))
        before = seen
    found = [np.stack(column) for column in zip(*callback, strict=True)]
    fell, late = found[3:]
    assert fell.sum() > 3 and late.sum() > 3, "this reference needs both endings"
    return found


def returns(rewards, values, after, fell, late):
    """Advantages and lambda-returns, step by step from the definition."""
    gains = np.zeros(rewards.shape)
    for i in range(rewards.shape[1]):
        later = 0.0
        for t in reversed(range(len(rewards))):
            worth = 0.0 if fell[t, i] else after[t, i]
            surprise = rewards[t, i] + GAMMA * worth - values[t, i]
            goes_on = not (fell[t, i] or late[t, i])
            later = surprise + (GAMMA * LAMBDA * later if goes_on else 0.0)
            gains[t, i] = later
    return gains, gains + values


def worth(model, seen):
    """Values of the critic for observations, (..., 8) to (...)."""
    net = model.policy
    with torch.no_grad():
        said = net.value_net(net.mlp_extractor.value_net(torch.as_tensor(seen)))
    return said[..., 0].numpy().astype(float)


def test_ppo_s_walkers_are_worth_what_comes_after_the_time_limit_and_nothing_after_a_fall():
    model, callback = untrained("ppo-fast")
    rollout = model.walk(callback)
    before, after, rewards, fell, late = walked(rollout.actions.numpy(), model.seed)
    np.testing.assert_array_equal(rollout.seen, before)
    gains, expected = returns(rewards, worth(model, before), worth(model, after), fell, late)
    np.testing.assert_allclose(rollout.returns, expected, rtol=1e-4, atol=1e-5)
    # The lower of two in the middle, as torch takes it.
    most = model.farthest * np.percentile(np.abs(gains), 50, method="lower")
    gains = np.clip(gains, -most, most)
    gains = (gains - gains.mean()) / gains.std(ddof=1)
    np.testing.assert_allclose(rollout.advantages, gains, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("algo", ["shac", "shac-learned"])
def test_shac_s_walkers_are_worth_what_comes_after_the_time_limit_and_nothing_after_a_fall(algo):
    model, callback = untrained(algo)
    model.collect_rollouts(model.env, callback, model.rollout_buffer, STEPS)
    buffer = model.rollout_buffer
    before, after, rewards, fell, late = walked(buffer.actions, model.seed)
    np.testing.assert_array_equal(buffer.observations, before)
    _, expected = returns(rewards, worth(model, before), worth(model, after), fell, late)
    np.testing.assert_allclose(buffer.returns, expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(np.stack(model.env.fell), fell)
    np.testing.assert_array_equal(np.stack(model.env.ended), fell | late)
    np.testing.assert_array_equal(np.stack(model.env.seen), after)


def test_steps_are_learned_from_the_rewards_of_the_environment_without_values():
    """At a time limit, stable-baselines3 adds the critic's value to the reward, in place."""
    model, callback = untrained("shac-learned")
    model.collect_rollouts(model.env, callback, model.rollout_buffer, STEPS)
    before, after, rewards, fell, late = walked(model.rollout_buffer.actions, model.seed)
    steps = [np.stack(column) for column in zip(*model.env.recorder._steps, strict=True)]
    assert not np.array_equal(model.rollout_buffer.rewards[late], rewards[late])
    for found, expected in zip(
        steps[:1] + steps[3:5] + steps[6:], (before, after, rewards, fell), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def slopes(function, seen):
    """Derivatives of a network's output by the six state variables, one observation at a time."""
    found = np.zeros((*seen.shape[:2], 6))
    for t, i in np.ndindex(seen.shape[:2]):
        leaf = torch.tensor(seen[t, i], requires_grad=True)
        function(leaf).sum().backward()
        found[t, i] = leaf.grad[:6].numpy()
    return found


def test_shac_s_gradients_go_through_the_time_limit_to_the_critic_and_through_a_fall_to_nothing():
    model, callback = untrained("shac")
    model.policy.log_std.data.fill_(0.0)  # many actions lie beyond their bounds
    model.collect_rollouts(model.env, callback, model.rollout_buffer, STEPS)
    actions, seen = model.rollout_buffer.actions[..., 0], model.rollout_buffer.observations
    _, after, _, fell, late = walked(model.rollout_buffer.actions, model.seed)
    beyond = np.abs(actions) >= 1.0
    policy, critic = slopes(model.action, seen), slopes(model.value, after)
    linear = model.env.recorder.linearize()
    assert linear.ahead.shape == (WALKERS, 7)  # the distance in the stride is not observed
    gains, costates = np.zeros(actions.shape), np.zeros((*actions.shape, 6))
    for i in range(WALKERS):
        later = None
        for t in reversed(range(STEPS)):
            by_next = np.append(critic[t, i], 0.0)
            if fell[t, i]:
                by_next = np.zeros(7)
            elif not late[t, i] and later is not None:
                by_next[:6] = (1.0 - LAMBDA) * critic[t, i] + LAMBDA * later[:6]
                by_next[6] = later[6]
            gains[t, i] = linear.rewards_by_action[t, i, 0]
            gains[t, i] += GAMMA * linear.states_by_action[t, i, :, 0] @ by_next
            later = linear.rewards_by_state[t, i].copy()
            later += GAMMA * linear.states_by_state[t, i].T @ by_next
            if not beyond[t, i]:
                later[:6] += gains[t, i] * policy[t, i]
            costates[t, i] = later[:6]
    outwards = beyond & (actions * gains > 0.0)
    assert np.any(outwards & (actions * gains < 1.0)) and np.any(beyond & ~outwards)
    gains[outwards] = 0.0
    gains = np.clip(gains / np.sqrt(np.mean(gains**2)), -5.0, 5.0)
    found = model._gradients(seen)
    np.testing.assert_allclose(found[0][..., 0], gains, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(found[1], np.clip(costates, -10.0, 10.0), rtol=1e-4, atol=1e-5)


def clipped(gradient, norm):
    """The gradient, shortened to a norm if it is longer."""
    size = float(np.sqrt(np.sum(gradient**2)))
    return gradient if size <= norm else gradient * (norm / size)


def flat(parameters):
    return np.concatenate([x.grad.detach().numpy().ravel().astype(float) for x in parameters])


@pytest.mark.parametrize("share", [0.01, 0.9, 1.1, 100.0])
def test_ppo_s_gradients_are_only_ever_made_smaller(share, monkeypatch):
    """The norm at which they are clipped is a share of their own norm."""
    model, callback = untrained("ppo-fast", n_epochs=1)
    rollout = model.walk(callback)
    differentiate, kept = type(model).differentiate, {}

    def noted(*batch):
        answer = differentiate(model, *batch)
        kept["before"] = model.gradient.numpy().astype(float)
        model.max_grad_norm = share * float(np.linalg.norm(kept["before"]))
        return answer

    def step():
        kept["after"] = flat(model.policy.parameters())

    monkeypatch.setattr(model, "differentiate", noted)
    monkeypatch.setattr(model.policy.optimizer, "step", step)
    model.update(rollout)
    expected = clipped(kept["before"], model.max_grad_norm)
    np.testing.assert_allclose(kept["after"], expected, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("share", [0.01, 0.9, 1.1, 100.0])
def test_shac_s_gradients_are_only_ever_made_smaller(share, monkeypatch):
    model, _ = untrained("shac")
    draws = torch.Generator().manual_seed(0)
    seen, actions, values, by_state = (
        torch.randn(size, generator=draws) for size in ((20, 8), (20, 1), (20,), (20, 6))
    )
    leaf = seen.clone().requires_grad_()
    expected = model.value(leaf)
    (found,) = torch.autograd.grad(expected.sum(), leaf, create_graph=True)
    loss = (model.action(seen) - actions).square().mean() + (expected - values).square().mean()
    loss = loss + (found[:, :6] - by_state).square().sum() / len(seen)
    model.policy.optimizer.zero_grad()
    loss.backward()
    parameters = [x for x in model.policy.parameters() if x.grad is not None]
    before, kept = flat(parameters), []
    model.max_grad_norm = share * float(np.linalg.norm(before))
    monkeypatch.setattr(model.policy.optimizer, "step", lambda: kept.append(flat(parameters)))
    model._fit(seen, actions, values, by_state, torch.eye(8, 6).expand(20, 8, 6), torch.zeros(20))
    np.testing.assert_allclose(kept[0], clipped(before, model.max_grad_norm), rtol=1e-4, atol=1e-7)
