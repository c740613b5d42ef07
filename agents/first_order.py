"""A short-horizon actor-critic (SHAC) that learns from exact gradients of the environment's steps.

As in SHAC, many walkers make some steps, and their rewards are differentiated backwards through
these steps. A critic stands for all later rewards. There are four differences:

- Each action is moved along its own gradient, and the network is fitted to the new actions. The
  policy's weights do not follow the gradient directly: a push and the pause after it are one
  control step apart, which shared weights are slow to distinguish.
- The critic also learns the derivatives of its value by the state. The backward sweep computes
  these six numbers for every step, and the actor needs them.
- Falls have no gradient: rewards do not change until a walker falls. With `FallCriticPolicy`, a
  second critic learns the discounted probability of a fall from falls alone. Its derivative, times
  the return that a fall costs, is subtracted from each action's gradient.
- Noise smooths the corners of the return, and decreases during training (`exploration.Schedule`).

Collecting steps, values by TD(lambda), time limits and files are those of stable-baselines3.

References:
    J. Xu et al., "Accelerated policy learning with parallel differentiable simulation", 2022.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, Schedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from torch import Tensor, nn

from agents.networks import FallCriticPolicy
from agents.ppo_fast import advantages, wrapped
from gym_passive_walker.envs.interface import REASONS
from gym_passive_walker.torch.linearization import Linear, StepRecorder

_LISTENING = 10
"""Horizons over which the steps of the actions grow to their full size. At first the critic is
untrained, and once all walkers have learned to fall, the gradient is zero."""

_BEYOND = 0.2
"""How far beyond its bounds an action is learned, so that it can return."""

_LIKELY = 0.3
"""Least probability of a fall that changes an action's gradient."""

_VIOLATED = frozenset(REASONS.values())  # outcomes of episodes that constraints end

_BOLDEST, _STEEPEST = 5.0, 10.0
"""Bounds of the gradients by actions, in root mean squares, and of the derivatives of values.
Near a grazing impact both grow without bound."""


class Taped(VecEnvWrapper):
    """Environments that record their steps and the results, for differentiation.

    Args:
        venv: The environments.
        recorder: Record of the steps; None is a new `StepRecorder` for learning.

    Attributes:
        recorder: The recorded steps.
        seen: Observations after each step, before a reset; one array (n, k) for each step.
        ended: Whether the episode ended with the step; one boolean array (n,) for each step.
        fell: Whether it ended by a fall, with no later rewards; a boolean array (n,) for each step.
        violated: Whether a violated constraint was that fall; a boolean array (n,) for each step.
    """

    def __init__(self, venv: VecEnv, recorder: Any = None) -> None:
        super().__init__(venv)
        if recorder is None:
            recorder = StepRecorder(venv.unwrapped, learning=True)
        self.recorder = recorder
        self.clear()

    def clear(self) -> None:
        """Delete all recorded steps."""
        self.recorder.clear()
        self.seen: list[NDArray] = []
        self.ended: list[NDArray] = []
        self.fell: list[NDArray] = []
        self.violated: list[NDArray] = []

    def reset(self) -> VecEnvObs:
        """Reset every environment."""
        return self.venv.reset()

    def step_async(self, actions: NDArray) -> None:
        """Record a step, and start it."""
        self.recorder.record(actions)
        self.venv.step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Finish a step, and record its results."""
        observations, rewards, dones, infos = self.venv.step_wait()
        seen, fell, violated = np.array(observations), dones.copy(), np.zeros_like(dones)
        for i in np.flatnonzero(dones):
            seen[i] = infos[i]["terminal_observation"]
            fell[i] = not infos[i]["TimeLimit.truncated"]
            violated[i] = infos[i]["outcome"] in _VIOLATED
        for name, new in {"seen": seen, "ended": dones, "fell": fell, "violated": violated}.items():
            getattr(self, name).append(new)
        return observations, rewards, dones, infos


def backwards(
    linear: Linear,
    policy: NDArray,
    critic: NDArray,
    ended: NDArray,
    *,
    gamma: float,
    gae_lambda: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of the returns of T steps of n walkers by actions and states, swept backwards.

    This is the chain rule with the weights of TD(lambda), which mix in the critic after each step.
    Along an episode that neither ends nor leaves the horizon, the costate before a step is

        rewards_by_state + gamma A' m + policy' (rewards_by_action + gamma B' m),

    where A and B are the derivatives of the step's end by its initial state and its actions. The
    vector m mixes the costate after the step with the critic's derivative there. The critic does
    not know what is not observed: there, m is the costate.

    Args:
        linear: Derivatives of the steps, by states of s numbers, the first m of which are observed.
        policy: Derivative of the k actions by the state before each step, shape (T, n, k, m).
        critic: Derivative of the value by the state after each step, shape (T, n, m); 0 at falls.
        ended: Whether the episode ended with the step, shape (T, n).
        gamma: Discount factor.
        gae_lambda: Weight of the later steps relative to the critic.

    Returns:
        Derivative of the return from each step by its actions, shape (T, n, k); and by the state
        before it, shape (T, n, m), the costate.
    """
    gains, costates = np.empty(linear.rewards_by_action.shape), np.empty(critic.shape)
    size, costate = critic.shape[-1], linear.ahead.copy()
    costate[:, :size] = critic[-1]
    for t in reversed(range(len(ended))):
        over = ended[t][:, None]
        mixed = (1.0 - gae_lambda) * critic[t] + gae_lambda * costate[:, :size]
        after = np.where(over, 0.0, costate)
        after[:, :size] = np.where(over, critic[t], mixed)
        after *= gamma
        gains[t] = linear.rewards_by_action[t]
        gains[t] += np.einsum("nik,ni->nk", linear.states_by_action[t], after)
        costate = linear.rewards_by_state[t] + np.einsum(
            "nij,ni->nj", linear.states_by_state[t], after
        )
        costate[:, :size] += np.einsum("nkj,nk->nj", policy[t], gains[t])
        costates[t] = costate[:, :size]
    return gains, costates


class SHAC(OnPolicyAlgorithm):
    """A short-horizon actor-critic on exact gradients.

    `env.recorder.left_out` has a sentence on each part of the scene without a derivative.

    Args:
        policy: "MlpPolicy", or `FallCriticPolicy`.
        env: A `PassiveWalkerVecEnv`, alone or in a VecNormalize that does not normalize rewards.
        learning_rate: Learning rate of the networks, or its schedule.
        n_steps: Steps in a horizon.
        batch_size: States in a batch that the networks are fitted to.
        n_epochs: How often the networks are fitted to the states of a horizon.
        gamma: Discount factor.
        gae_lambda: Weight of the later steps in `backwards`, and in the values.
        reach: Distance, in largest torques, by which an action with a gradient of root mean square
            size is moved.
        max_grad_norm: Norm at which the gradient of the networks' weights is clipped.
        stats_window_size: Episodes in the statistics of stable-baselines3.
        tensorboard_log: Folder of logs.
        policy_kwargs: Arguments of the policy.
        verbose: 0 prints nothing.
        seed: Seed of weights, noise and walkers.
        device: Device of the networks.
        _init_setup_model: Whether to build the networks at once.

    Raises:
        TypeError: if rewards are normalized, because the gradients are those of the raw rewards;
            or if `env` is something else.
    """

    policy_aliases: dict[str, type[BasePolicy]] = {"MlpPolicy": ActorCriticPolicy}  # noqa: RUF012

    def __init__(
        self,
        policy: str | type[ActorCriticPolicy],
        env: GymEnv,
        learning_rate: float | Schedule = 2e-3,
        n_steps: int = 32,
        batch_size: int = 256,
        n_epochs: int = 4,
        gamma: float = 0.995,
        gae_lambda: float = 0.95,
        reach: float = 0.1,
        max_grad_norm: float = 1.0,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        _init_setup_model: bool = True,
    ) -> None:
        self.batch_size, self.n_epochs, self.reach = batch_size, n_epochs, reach
        super().__init__(
            policy, env, learning_rate, n_steps=n_steps, gamma=gamma, gae_lambda=gae_lambda,
            ent_coef=0.0, vf_coef=1.0, max_grad_norm=max_grad_norm, use_sde=False,
            sde_sample_freq=-1, stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log, policy_kwargs=policy_kwargs, verbose=verbose,
            seed=seed, device=device, _init_setup_model=_init_setup_model,
        )  # fmt: skip
        normalizer = self.get_vec_normalize_env()
        if normalizer is not None and normalizer.norm_reward:
            raise TypeError("rewards must be left as they are: normalize with norm_reward=False")

    @staticmethod
    def _wrap_env(env: GymEnv, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        return Taped(wrapped(env, verbose, monitor_wrapper))

    def collect_rollouts(self, env: VecEnv, *args: Any, **kwargs: Any) -> bool:
        """Collect a rollout as stable-baselines3 does, with newly recorded steps."""
        assert isinstance(env, Taped)
        env.clear()
        return super().collect_rollouts(env, *args, **kwargs)

    def action(self, seen: Tensor) -> Tensor:
        """The policy's actions without noise, (..., actions), from observations (..., k)."""
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(seen))

    def value(self, seen: Tensor) -> Tensor:
        """The critic's value, (...), from observations (..., k)."""
        return self.policy.value_net(self.policy.mlp_extractor.forward_critic(seen))[..., 0]

    def falls(self, seen: Tensor) -> Tensor:
        """The discounted probability of a fall, (...), from observations (..., k).

        It is 0 without a critic of falls.
        """
        if not isinstance(self.policy, FallCriticPolicy):
            return 0.0 * seen[..., 0]
        return torch.sigmoid(self.policy.fall_critic(seen)[..., 0])

    def train(self) -> None:
        """Fit policy and critics to the last horizon."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        seen = torch.as_tensor(self.rollout_buffer.observations)
        gains, slopes, shown = self._gradients(seen.numpy())
        rows = seen.reshape(-1, seen.shape[-1])
        reach = self.reach * min(1.0, self._n_updates / (self.n_epochs * _LISTENING))
        with torch.no_grad():
            actions = self.action(rows) + reach * _single(gains).flatten(0, 1)
            low, high = map(torch.as_tensor, self._bounds())
            actions = actions.clamp(low - _BEYOND, high + _BEYOND)
        values = _single(self.rollout_buffer.returns).reshape(-1)
        slopes, shown = _single(slopes).flatten(0, 1), _single(shown).flatten(0, 1)
        falls = self._falls_to_come(seen).reshape(-1)
        for _ in range(self.n_epochs):
            for batch in torch.randperm(len(rows)).split(self.batch_size):
                learned = rows, actions, values, slopes, shown, falls
                self._fit(*(each[batch] for each in learned))
        self._n_updates += self.n_epochs

    @torch.no_grad()
    def _falls_to_come(self, seen: Tensor) -> Tensor:
        """Discounted probabilities of a fall, by TD(lambda), before each step of a horizon, (T, n).

        A step that ends with a fall counts 1.
        """
        assert isinstance(self.env, Taped)
        fell, ended = (torch.as_tensor(np.stack(x)) for x in (self.env.fell, self.env.ended))
        now, after = self.falls(seen), self.falls(_single(np.stack(self.env.seen))) * ~fell
        return now + advantages(
            fell.float(), now, after, ended, gamma=self.gamma, gae_lambda=self.gae_lambda
        )

    def _bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The smallest and the largest actions, (k,) each."""
        assert isinstance(self.action_space, Box)
        return self.action_space.low, self.action_space.high

    def _gradients(self, seen: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Gradients by actions, over the root mean square of each, and slopes that critics learn.

        Returns:
            Gradients, (T, n, k). Slopes of the return by each number of the state, (T, n, m); each
            is scaled as what is observed of it. And the directions of these slopes in observations,
            (T, n, numbers, m).
        """
        env, actions = self.env, self.rollout_buffer.actions
        assert isinstance(env, Taped)
        normalizer, spread = self.get_vec_normalize_env(), np.ones(seen.shape[-1])
        if normalizer is not None and normalizer.norm_obs:
            spread = np.sqrt(normalizer.obs_rms.var + normalizer.epsilon)  # type: ignore[union-attr]
        linear = env.recorder.linearize(np.stack(env.violated))
        before, after = (x / spread[:, None] for x in (linear.seen_by_state, linear.shown_by_state))
        low, high = self._bounds()
        below, above, fell = actions <= low, actions >= high, np.stack(env.fell)
        policy = np.stack(
            [
                _by_seen(lambda x, k=k: self.action(x)[..., k], seen, before)
                for k in range(actions.shape[-1])
            ],
            axis=2,
        )
        policy[below | above] = 0.0
        critic = _by_seen(self.value, np.stack(env.seen), after)
        critic[fell] = 0.0
        gains, costates = backwards(
            linear, policy, critic, np.stack(env.ended),
            gamma=self.gamma, gae_lambda=self.gae_lambda,
        )  # fmt: skip
        by_action = linear.states_by_action[:, :, : critic.shape[-1]]
        gains -= np.einsum("tnik,tni->tnk", by_action, self._price_of_falls(after))
        # An action beyond its bounds is moved back towards them, but not further away.
        gains[(below & (gains < 0.0)) | (above & (gains > 0.0))] = 0.0
        typical = np.sqrt(np.mean(gains**2, axis=(0, 1)))
        typical[typical == 0.0] = 1.0
        sizes = np.sqrt(np.mean(np.sum(before**2, axis=2), axis=(0, 1)))
        scales = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
        scales *= env.recorder.rewarded  # slopes without a reward's would be wrong
        return (
            np.clip(gains / typical, -_BOLDEST, _BOLDEST),
            np.clip(costates * scales, -_STEEPEST, _STEEPEST),
            before * scales,
        )

    def _price_of_falls(self, shown: NDArray) -> NDArray[np.float64]:
        """Derivative by the state after each step of the return that falls cost, (T, n, m).

        `shown` has the derivatives of the observations there, (T, n, numbers, m). A fall costs the
        mean return. Where it is unlikely the derivative is 0: there it is mostly
        an error of the critic, and larger than the effect of a torque on the work.
        """
        assert isinstance(self.env, Taped)
        after = np.stack(self.env.seen)
        with torch.no_grad():
            unlikely = self.falls(torch.as_tensor(after)).numpy() < _LIKELY
        slopes = _by_seen(self.falls, after, shown)
        slopes[unlikely | np.stack(self.env.fell)] = 0.0  # after a fall, none is to come
        return self.gamma * max(0.0, float(self.rollout_buffer.returns.mean())) * slopes

    def _fit(
        self,
        seen: Tensor,
        actions: Tensor,
        values: Tensor,
        slopes: Tensor,
        shown: Tensor,
        falls: Tensor,
    ) -> None:
        """Make one step of fitting to actions, values, their slopes (b, m), and falls.

        `shown` has the direction of each slope in observations, (b, numbers, m).
        """
        leaf = seen.clone().requires_grad_()
        expected = self.value(leaf)
        (by_seen,) = torch.autograd.grad(expected.sum(), leaf, create_graph=True)
        loss = nn.functional.mse_loss(self.action(seen), actions)
        loss = loss + nn.functional.mse_loss(expected, values)
        found = (by_seen[:, None] @ shown)[:, 0]
        loss = loss + (found - slopes).square().sum(1).mean()
        if isinstance(self.policy, FallCriticPolicy):
            loss = loss + nn.functional.binary_cross_entropy(self.falls(seen), falls)
        self.policy.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()


def _single(array: NDArray) -> Tensor:
    return torch.as_tensor(array, dtype=torch.float32)


def _by_seen(
    function: Callable[[Tensor], Tensor], seen: NDArray, shown: NDArray
) -> NDArray[np.float64]:
    """Derivative of a function of observations (T, n, numbers) by the states, (T, n, m).

    `shown` has the derivatives of the observations by the states, (T, n, numbers, m).
    """
    leaf = torch.tensor(seen, requires_grad=True)
    (gradient,) = torch.autograd.grad(function(leaf).sum(), leaf)
    return (gradient.double().numpy()[..., None, :] @ shown)[..., 0, :]
