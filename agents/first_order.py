"""Learning by the exact gradients of steps: an actor and a critic over short horizons.

As in SHAC (Xu et al.: Accelerated Policy Learning with Parallel Differentiable Simulation, 2022),
many walkers walk for some steps, what they earn is differentiated backwards through these steps,
and a critic stands for all that comes after. Other than there,

- the policy does not follow the gradient by its weights: each action is moved up its own gradient,
  and the network is fitted to the actions that come of it. A push and the pause after it differ
  by a tick, which weights that all actions share are slow to tell apart;
- the critic learns slopes beside values: the backward sweep knows, for each state, how what is to
  come changes with it. Six numbers more from every step, and it is these that the actor needs;
- noise smooths what has corners, and goes as training does (`exploration.Schedule`).

Collecting steps, values by TD(lambda), time limits and files are those of stable-baselines3.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, Schedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from torch import Tensor, nn

from gym_passive_walker.evaluation.tape import Linear, Tape

_STATE = slice(0, 6)  # of an observation: what moves
_LISTENING = 10
"""Horizons in which the policy comes to move as far as it is told to: a critic that has seen
nothing tells nothing, and where all walkers have learned to fall no gradient helps them up."""

_FARTHEST = 1.2
"""Largest action that a policy learns: beyond the bound, yet not a long way back from it."""

_BOLDEST, _STEEPEST = 5.0, 10.0
"""Largest gradient by an action, in typical ones, and slope of a value that are learned from:
beside a strike that grazes they grow beyond all bounds."""


class Taped(VecEnvWrapper):
    """Walkers whose steps are noted, with where each step has led.

    Attributes:
        tape: The steps.
        seen: What each walker saw after each step, before the next episode began.
        ended: Whose episode ended with it.
        fell: Whose did so by a fall, so that nothing comes after.
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        self.tape = Tape(venv.unwrapped)
        self.clear()

    def clear(self) -> None:
        """Forget all steps."""
        self.tape.clear()
        self.seen: list[NDArray] = []
        self.ended: list[NDArray] = []
        self.fell: list[NDArray] = []

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment."""
        return self.venv.reset()

    def step_async(self, actions: NDArray) -> None:
        """Take note of the step, and let it be made."""
        self.tape.note(actions)
        self.venv.step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """The step, and note of where it has led."""
        observations, rewards, dones, infos = self.venv.step_wait()
        seen, fell = np.array(observations), dones.copy()
        for i in np.flatnonzero(dones):
            seen[i] = infos[i]["terminal_observation"]
            fell[i] = not infos[i]["TimeLimit.truncated"]
        for kept, new in ((self.seen, seen), (self.ended, dones), (self.fell, fell)):
            kept.append(new)
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
    """Sweep backwards through T steps of n walkers: what they earn, by actions and by states.

    The chain rule, with TD(lambda)'s weights: after each step the critic's word counts as well.
    Along an episode that neither ends nor leaves the horizon, the costate before a step is

        rewards_by_state + gamma A' m + policy (rewards_by_action + gamma B' m),

    where A and B are what the step does to states and m mixes the costate after it with the
    critic's slope there.

    Args:
        linear: The steps.
        policy: How each action changes with the state that it answers, (T, n, 6).
        critic: How the value changes with the state in which each step ends, (T, n, 6); 0 at falls.
        ended: Whose episode ended with each step, (T, n).
        gamma: The discount.
        gae_lambda: The weight of what follows over what the critic says of it.

    Returns:
        How the return from each step on changes with its action, (T, n); and with the state in
        which it begins, (T, n, 6), the costate.
    """
    gains, costates = np.empty(ended.shape), np.empty(critic.shape)
    costate = critic[-1]
    for t in reversed(range(len(ended))):
        mixed = (1.0 - gae_lambda) * critic[t] + gae_lambda * costate
        after = gamma * np.where(ended[t][:, None], critic[t], mixed)
        gains[t] = linear.rewards_by_action[t]
        gains[t] += np.einsum("ni,ni->n", linear.states_by_action[t], after)
        costate = linear.rewards_by_state[t] + gains[t][:, None] * policy[t]
        costate += np.einsum("nij,ni->nj", linear.states_by_state[t], after)
        costates[t] = costate
    return gains, costates


class SHAC(OnPolicyAlgorithm):
    """A short-horizon actor-critic on exact gradients, for walkers driven by the hip.

    Args:
        policy: "MlpPolicy".
        env: A `PassiveWalkerVecEnv`, in VecNormalize or not; one that leaves rewards as they are.
        learning_rate: Of the networks, or its schedule.
        n_steps: The horizon.
        batch_size: States that networks are fitted to at once.
        n_epochs: How often they are fitted to the states of a horizon.
        gamma: The discount.
        gae_lambda: As of `backwards`; of the values too.
        reach: How far an action is moved whose gradient is a typical one, in largest torques.
        max_grad_norm: At which the gradient of the networks' weights is clipped.
        stats_window_size: As of stable-baselines3, as is what follows.
        tensorboard_log: Folder of logs.
        policy_kwargs: Arguments of the policy.
        verbose: 0 for silence.
        seed: Of weights, noise and walkers.
        device: Where networks are.
        _init_setup_model: Whether to build them at once.

    Raises:
        TypeError: if rewards are normalised: their gradients are those of what walkers earn.
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
        return Taped(BaseAlgorithm._wrap_env(env, verbose, monitor_wrapper))

    def collect_rollouts(self, env: VecEnv, *args: Any, **kwargs: Any) -> bool:
        """As of stable-baselines3, on a tape of its own."""
        assert isinstance(env, Taped)
        env.clear()
        return super().collect_rollouts(env, *args, **kwargs)

    def action(self, seen: Tensor) -> Tensor:
        """What the policy does without noise, (..., 8) to (...)."""
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(seen))[..., 0]

    def value(self, seen: Tensor) -> Tensor:
        """What the critic expects, (..., 8) to (...)."""
        return self.policy.value_net(self.policy.mlp_extractor.forward_critic(seen))[..., 0]

    def train(self) -> None:
        """Fit policy and critic to the horizon that has just been walked."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        seen = torch.as_tensor(self.rollout_buffer.observations)
        gains, costates = self._gradients(seen.numpy())
        rows = seen.reshape(-1, seen.shape[-1])
        reach = self.reach * min(1.0, self._n_updates / (self.n_epochs * _LISTENING))
        with torch.no_grad():
            actions = self.action(rows) + reach * _single(gains).reshape(-1)
            actions.clamp_(-_FARTHEST, _FARTHEST)
        values = _single(self.rollout_buffer.returns).reshape(-1)
        slopes = _single(costates).reshape(len(rows), -1)
        for _ in range(self.n_epochs):
            for batch in torch.randperm(len(rows)).split(self.batch_size):
                self._fit(rows[batch], actions[batch], values[batch], slopes[batch])
        self._n_updates += self.n_epochs

    def _gradients(self, seen: NDArray) -> tuple[NDArray, NDArray]:
        """Gradients by actions, in typical ones, (T, n); by states as the networks see them."""
        env, actions = self.env, self.rollout_buffer.actions[..., 0]
        assert isinstance(env, Taped)
        normalizer, spread = self.get_vec_normalize_env(), np.ones(seen.shape[-1])
        if normalizer is not None and normalizer.norm_obs:
            spread = np.sqrt(normalizer.obs_rms.var + normalizer.epsilon)  # type: ignore[union-attr]
        spread = spread[_STATE]
        beyond = np.abs(actions) >= 1.0
        policy = _by_state(self.action, seen) / spread
        policy[beyond] = 0.0
        critic = _by_state(self.value, np.stack(env.seen)) / spread
        critic[np.stack(env.fell)] = 0.0
        gains, costates = backwards(
            env.tape.linearize(), policy, critic, np.stack(env.ended),
            gamma=self.gamma, gae_lambda=self.gae_lambda,
        )  # fmt: skip
        # An action beyond its bounds may come back, and need not go on.
        gains[beyond & (actions * gains > 0.0)] = 0.0
        typical = np.sqrt(np.mean(gains**2)) or 1.0
        return (
            np.clip(gains / typical, -_BOLDEST, _BOLDEST),
            np.clip(costates * spread, -_STEEPEST, _STEEPEST),
        )

    def _fit(self, seen: Tensor, actions: Tensor, values: Tensor, slopes: Tensor) -> None:
        """Bring the networks nearer to actions (k,), values (k,) and slopes (k, 6) for states."""
        leaf = seen.clone().requires_grad_()
        expected = self.value(leaf)
        (by_state,) = torch.autograd.grad(expected.sum(), leaf, create_graph=True)
        loss = nn.functional.mse_loss(self.action(seen), actions)
        loss = loss + nn.functional.mse_loss(expected, values)
        loss = loss + (by_state[:, _STATE] - slopes).square().sum(1).mean()
        self.policy.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()


def _single(array: NDArray) -> Tensor:
    return torch.as_tensor(array, dtype=torch.float32)


def _by_state(function: Callable[[Tensor], Tensor], seen: NDArray) -> NDArray[np.float64]:
    """How a function of observations (T, n, 8) changes with the state in each, (T, n, 6)."""
    leaf = torch.tensor(seen, requires_grad=True)
    (gradient,) = torch.autograd.grad(function(leaf).sum(), leaf)
    return gradient[..., _STATE].double().numpy()
