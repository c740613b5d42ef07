"""Learning by exact gradients: the backward sweep, and its use."""

import inspect

import numpy as np
import pytest
import torch

from agents import envs
from agents.config import ConfigError, configure
from agents.first_order import SHAC, backwards
from agents.learner import LearnedPolicy, _tensors, build
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.torch import rollout
from gym_passive_walker.torch.linearization import Linear, StepRecorder

SIZE, HIDDEN = 6, 2  # numbers of a state that are observed, and that are not


def drawn(steps=12, count=3, actions=2, seed=0):
    """Random steps, a policy and a critic, stable enough for a dozen steps."""
    rng, whole = np.random.default_rng(seed), SIZE + HIDDEN
    linear = Linear(
        states_by_state=0.3 * rng.normal(size=(steps, count, whole, whole)),
        states_by_action=rng.normal(size=(steps, count, whole, actions)),
        rewards_by_state=rng.normal(size=(steps, count, whole)),
        rewards_by_action=rng.normal(size=(steps, count, actions)),
        seen_by_state=np.empty(0),
        shown_by_state=np.empty(0),
        ahead=np.pad(rng.normal(size=(count, HIDDEN)), ((0, 0), (SIZE, 0))),
    )
    policy = 0.3 * rng.normal(size=(steps, count, actions, SIZE))
    return linear, policy, 0.3 * rng.normal(size=(steps, count, SIZE))


def returned(linear, policy, critic, start, extra, gamma):
    """Returns of linear walkers under a linear policy, by the definition."""
    state, total = start, 0.0
    for t in range(len(extra)):
        action = torch.einsum("nkj,nj->nk", policy[t], state[:, :SIZE]) + extra[t]
        reward = (linear.rewards_by_state[t] * state).sum(1)
        reward = reward + (linear.rewards_by_action[t] * action).sum(1)
        total = total + gamma**t * reward
        state = torch.einsum("nij,nj->ni", linear.states_by_state[t], state)
        state = state + torch.einsum("nik,nk->ni", linear.states_by_action[t], action)
    after = (critic[-1] * state[:, :SIZE]).sum(1) + (linear.ahead * state).sum(1)
    return total + gamma ** len(extra) * after


def test_without_the_critic_on_the_way_the_sweep_is_the_gradient_of_the_discounted_return():
    linear, policy, critic = drawn()
    nobody = np.zeros(policy.shape[:2], bool)
    gains, costates = backwards(linear, policy, critic, nobody, gamma=0.9, gae_lambda=1.0)
    start = torch.zeros((3, SIZE + HIDDEN), dtype=torch.float64, requires_grad=True)
    extra = torch.zeros((12, 3, 2), dtype=torch.float64, requires_grad=True)
    tensors = Linear(*map(torch.from_numpy, linear)), *map(torch.from_numpy, (policy, critic))
    returned(*tensors, start, extra, 0.9).sum().backward()
    np.testing.assert_allclose(costates[0], start.grad[:, :SIZE], rtol=1e-12)
    discounts = 0.9 ** np.arange(12)[:, None, None]
    np.testing.assert_allclose(discounts * gains, extra.grad, rtol=1e-10)


def test_the_critic_alone_speaks_at_lambda_zero_and_where_an_episode_ends():
    """Of what it observes: nothing is known of the rest at the end of an episode."""
    linear, policy, critic = drawn()
    ended = np.random.default_rng(1).random(critic.shape[:2]) < 0.3
    by_action = linear.states_by_action[:, :, :SIZE]
    alone = linear.rewards_by_action + 0.9 * np.einsum("tnik,tni->tnk", by_action, critic)
    observed = linear._replace(
        states_by_state=linear.states_by_state * (np.arange(SIZE + HIDDEN) < SIZE)[:, None],
        states_by_action=linear.states_by_action * (np.arange(SIZE + HIDDEN) < SIZE)[:, None],
    )
    gains, _ = backwards(observed, policy, critic, np.zeros_like(ended), gamma=0.9, gae_lambda=0.0)
    np.testing.assert_allclose(gains, alone, rtol=1e-12)
    gains, _ = backwards(linear, policy, critic, ended, gamma=0.9, gae_lambda=0.7)
    np.testing.assert_allclose(gains[ended], alone[ended], rtol=1e-12)
    assert not np.isclose(gains[:-1][~ended[:-1]], alone[:-1][~ended[:-1]]).any()


def test_costates_mix_as_lambda_returns_do():
    """A reward for position alone, which each step halves: a geometric series."""
    halved = np.broadcast_to(0.5 * np.eye(6), (40, 1, 6, 6))
    ones, none = np.ones((40, 1, 6)), np.zeros((40, 1, 6, 1))
    empty = np.empty(0)
    linear = Linear(halved, none, ones, np.zeros((40, 1, 1)), empty, empty, np.zeros((1, 6)))
    for share in (0.0, 0.5, 1.0):
        _, costates = backwards(
            linear, np.zeros((40, 1, 1, 6)), 3.0 * ones, np.zeros((40, 1), bool), gamma=0.8,
            gae_lambda=share,
        )  # fmt: skip
        settled = (1.0 + 0.4 * (1.0 - share) * 3.0) / (1.0 - 0.4 * share)
        np.testing.assert_allclose(costates[0], settled, rtol=1e-12)


@pytest.mark.parametrize("scene", ["level", "rolling", "steep", "lab", "rough", "pushed"])
def test_the_sweep_over_walkers_is_what_autograd_says_of_their_walk(scene):
    """Recorded steps of the environment, each by itself, and one walk with all of them."""
    torch.manual_seed(1)
    policy = torch.nn.Sequential(
        torch.nn.Linear(12 if scene == "rough" else 8, 16),
        torch.nn.Tanh(),
        torch.nn.Linear(16, 1),
    ).double()
    scene, count = make_scene(scene, tolerance=1e-12), 5
    steps = 3 if scene.control == "stride" else 70
    walked = rollout(policy, scene, steps, count=count, seed=4)
    walked.returns.sum().backward()
    env = PassiveWalkerVectorEnv(count, scene, autoreset_mode="SameStep")
    env.reset(seed=4)
    recorder, seen = StepRecorder(env), walked.observations.detach().requires_grad_()
    for actions in policy(seen).detach().numpy():
        recorder.record(actions)
        env.step(actions)
    actions = policy(seen)[..., 0]
    (by_seen,) = torch.autograd.grad(actions.sum(), seen, retain_graph=True)
    going = walked.going.numpy()
    ended = np.concatenate([going[:-1] & ~going[1:], going[-1:]])
    critic = np.zeros((steps, count, 6))
    gains, _ = backwards(
        recorder.linearize(), by_seen.numpy()[..., None, :6], critic, ended, gamma=1.0,
        gae_lambda=1.0,
    )  # fmt: skip
    first = np.cumsum(ended, axis=0) - ended == 0  # the environment begins another episode
    ours = torch.autograd.grad(
        (actions * torch.from_numpy(gains[..., 0] * first)).sum(), policy.parameters()
    )
    assert first.sum() > 0.4 * steps * count
    for gradient, parameter in zip(ours, policy.parameters(), strict=True):
        assert parameter.grad.abs().max() > 1e-3
        torch.testing.assert_close(gradient, parameter.grad, rtol=1e-6, atol=1e-7)


def test_rewards_that_are_normalised_are_refused():
    config = configure("shac", "level", n_envs=2)
    config.normalize.update(norm_reward=True)
    with pytest.raises(ConfigError, match="norm_reward=False"):
        build(config, envs.training_envs(config))


def test_an_update_moves_actions_up_their_gradients():
    config = configure("shac", "level", n_envs=16)
    model = build(config, envs.training_envs(config), learning_rate=1e-3)
    reported = {}

    class Watched(SHAC):
        """SHAC that records what it learns from."""

        def _gradients(self, seen):
            found = super()._gradients(seen)
            reported["gains"], reported["seen"] = found[0], torch.as_tensor(seen)
            reported["before"] = self.action(reported["seen"]).detach()
            return found

    model.__class__ = Watched
    model._n_updates = 1000  # it has listened to its critic for long
    model.learn(16 * config.hyperparams["n_steps"])
    moved = (model.action(reported["seen"]) - reported["before"]).detach().numpy()
    found = np.corrcoef(moved.reshape(-1), reported["gains"].reshape(-1))[0, 1]
    assert found > 5.0 / np.sqrt(moved.size)  # standard deviations of numbers without a relation


class Ended:
    """What a horizon of SHAC's environments recorded."""

    def __init__(self, seen, ended, fell):
        self.seen, self.ended, self.fell = seen, ended, fell


@pytest.fixture
def faller(monkeypatch):
    """SHAC after a horizon of two walkers, of which the first falls in the third of four steps."""
    config = configure("shac", "commanded", n_envs=2)
    model = build(config, envs.training_envs(config), gae_lambda=1.0)
    seen = np.random.default_rng(0).normal(size=(4, 2, 9)).astype(np.float32)
    ended = np.zeros((4, 2), bool)
    ended[2, 0] = True
    monkeypatch.setattr("agents.first_order.Taped", Ended)
    model.env, model.rollout_buffer.returns = Ended(seen, ended, ended), np.full((4, 2), 2.5)
    return model


def test_steps_before_a_fall_have_its_discounted_probability(faller):
    """Before the fall it is certain; the other walker may fall after the horizon."""
    falls = faller._falls_to_come(torch.zeros(4, 2, 9)).numpy()
    gamma, rare = faller.gamma, 1.0 / (1.0 + np.exp(3.0))
    np.testing.assert_allclose(falls[:3, 0], [gamma**2, gamma, 1.0], rtol=1e-5)
    np.testing.assert_allclose(falls[:, 1], rare * gamma ** np.arange(4, 0, -1), rtol=1e-5)


def test_a_probable_fall_costs_the_mean_return_and_an_improbable_one_nothing(faller):
    shown = np.broadcast_to(np.eye(9, 6), (4, 2, 9, 6))
    assert (faller._price_of_falls(shown) == 0.0).all()  # all falls are rare
    last = faller.policy.fall_critic[-1]
    torch.nn.init.normal_(last.weight)
    torch.nn.init.constant_(last.bias, 1.0)
    seen = torch.from_numpy(faller.env.seen)
    price, falls = faller._price_of_falls(shown), faller.falls(seen).detach().numpy()
    likely = (falls > 0.3) & ~faller.env.fell
    assert likely.any() and (price[~likely] == 0.0).all()
    for k in range(6):
        step = 1e-2 * torch.eye(9)[k]
        there, here = (faller.falls(seen + side * step).detach().numpy() for side in (1.0, -1.0))
        expected = faller.gamma * 2.5 * (there - here) / 2e-2
        np.testing.assert_allclose(price[..., k][likely], expected[likely], atol=1e-3)


def test_the_fall_critic_learns_which_walkers_fall_and_is_not_exported():
    config = configure("shac", "commanded", n_envs=64, seed=3)
    config.training.update(reset_noise_scale=0.3)
    model = build(config, envs.training_envs(config))
    model.learn(20 * 64 * config.hyperparams["n_steps"])
    seen, fell = np.stack(model.env.seen), np.stack(model.env.fell)
    soon = np.array([fell[t : t + 8].any(0) for t in range(len(fell) - 8)])
    falls = model.falls(torch.from_numpy(seen)).detach().numpy()[: len(soon)]
    assert soon.any() and np.mean(falls[soon][:, None] > falls[~soon]) > 0.8  # of all pairs
    assert not any("fall" in name for name in _tensors(LearnedPolicy(model, "SHAC")))


def test_without_a_critic_of_falls_they_change_no_gradient():
    config = configure("shac", "level", n_envs=2)
    model = build(config, envs.training_envs(config))
    model.learn(2 * config.hyperparams["n_steps"])
    shown = np.eye(model.observation_space.shape[0], 6)
    assert (model._price_of_falls(shown) == 0.0).all()


def test_without_arguments_it_has_the_numbers_of_its_preset():
    preset = configure("shac", "lab").hyperparams
    given = {name: x.default for name, x in inspect.signature(SHAC).parameters.items()}
    shared = set(given) & set(preset) - {"policy", "policy_kwargs", "learning_rate"}
    assert {name: given[name] for name in shared} == {name: preset[name] for name in shared}
    assert preset["learning_rate"] == f"lin_{given['learning_rate']:.0e}".replace("e-0", "e-")


def test_a_violated_constraint_is_recorded_as_a_fall_of_its_own():
    changes = {"constraints": {"friction": "end"}, "friction": 0.3}
    config = configure("shac", "level", n_envs=16, env=changes)
    model = build(config, envs.training_envs(config))
    model.learn(16 * config.hyperparams["n_steps"])
    violated, fell = np.stack(model.env.violated), np.stack(model.env.fell)
    assert violated.any() and (violated <= fell).all()
