"""Proximal policy optimization (PPO; Schulman et al., 2017) on tensors, in one file.

This is the PPO of stable-baselines3, arranged for speed. There, most of the time goes into ten
passes over each rollout, and most of the rest into calls for few walkers at a time. The simulation
takes almost none. Therefore:

- Walkers are tensors, and a step evaluates the actor only. The critic is evaluated once for all
  steps of a rollout.
- The scales of observations and rewards are updated once per rollout, not at each step.
- Gradients are computed without autograd, in memory that every batch reuses
  (`networks.Perceptron`). Autograd allocates memory for each batch, which takes longer than the
  arithmetic. Those of actor and critic are computed at the same time, in two threads.

One thing is not in that PPO. A fall is rare, and its advantage is a hundred times the usual one. So
that falls do not set the scale of all other advantages, and of the critic's errors, both are
clipped at some medians (`farthest`).

Rollouts, advantages and updates are below in the order in which they happen. The networks, the
callbacks and the files are those of stable-baselines3, so that a run has the usual format. With
`device="cuda"` everything runs on a GPU, including the walkers (`carried`).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from gymnasium.spaces import Box, Dict
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import Tensor, nn

from agents.networks import Perceptron, columns
from gym_passive_walker.envs.privileged import PrivilegedCriticPolicy
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.gaits.scenes.rewards import OBSERVERS
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv


class Rollout(NamedTuple):
    """T steps of n walkers, as tensors with the first axes (T, n)."""

    seen: Tensor  # normalized observations, (T, n, 8), of groups one after another
    actions: Tensor  # (T, n, actions)
    chances: Tensor  # logarithm of the density with which the actions were drawn, (T, n)
    advantages: Tensor  # (T, n)
    returns: Tensor  # (T, n)


def chances(actions: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Logarithm of a Gaussian's density up to a constant, (...), from arrays (..., k)."""
    return (-0.5 * ((actions - mean) * torch.exp(-log_std)).square() - log_std).sum(-1)


def advantages(
    rewards: Tensor,
    values: Tensor,
    after: Tensor,
    ended: Tensor,
    *,
    gamma: float,
    gae_lambda: float,
) -> Tensor:
    """Generalized advantage estimates (Schulman et al., 2016), shape (T, n).

    Args:
        rewards: Rewards of the steps, shape (T, n).
        values: Critic's values before each step, shape (T, n).
        after: Critic's values after each step, in the same episode, shape (T, n); 0 after falls.
        ended: Whether the episode ended with the step, shape (T, n).
        gamma: Discount factor.
        gae_lambda: Weight of the later steps relative to the critic.
    """
    surprises = rewards + gamma * after - values
    going, found = gamma * gae_lambda * ~ended, torch.empty_like(rewards)
    later = torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        found[t] = later = surprises[t] + going[t] * later
    return found


def wrapped(env: Any, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
    """Environments as stable-baselines3 wraps them, after a check that they are walkers.

    Raises:
        TypeError: if they are no `PassiveWalkerVecEnv`, alone or in VecNormalize.
    """
    found = BaseAlgorithm._wrap_env(env, verbose, monitor_wrapper)
    inner = found.venv if isinstance(found, VecNormalize) else found
    if not isinstance(inner, PassiveWalkerVecEnv):
        raise TypeError(
            "this algorithm takes a PassiveWalkerVecEnv, alone or in VecNormalize, not "
            f"{type(inner).__name__}: it steps the walkers themselves"
        )
    return found


def carried(walkers: PassiveWalkerVecEnv, device: torch.device) -> Any:
    """A tensor environment of the walkers; on a GPU, a new one of equal size and scene.

    Without the extra `gpu`, and in scenes that it does not support, the CPU simulates the walkers,
    and tensors are copied to the device and back.

    Args:
        walkers: Environments on the CPU.
        device: Device of the tensors.
    """
    here = PassiveWalkerTorchEnv.around(walkers.envs, device)
    if device.type == "cuda":
        try:
            from gym_passive_walker.devices.gpu.device import cuda
            from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv
        except ImportError:
            return here
        scene, batch = walkers.scene, walkers.batch
        on_gpu = cuda.is_available() and not scene.observe_body and not scene.groups
        if on_gpu and not batch.has_own:  # a GPU has the scene's walkers and slopes
            steps = int(batch.step_limit) if np.isfinite(batch.step_limit) else None
            return PassiveWalkerGpuEnv(walkers.num_envs, scene, max_episode_steps=steps)
    return here


def _each_moments(normalizer: Any) -> list[RunningMeanStd]:
    """Running moments of the observations, of each group in the order of the columns."""
    moments = normalizer.obs_rms
    return [moments[name] for name in OBSERVERS] if isinstance(moments, dict) else [moments]


def _bring_up(moments: RunningMeanStd, rows: Tensor) -> None:
    """Add rows to running moments; only one mean and variance per column leave the device."""
    var, mean = torch.var_mean(rows.double(), 0, correction=0)
    moments.update_from_moments(mean.cpu().numpy(), var.cpu().numpy(), len(rows))


class FastPPO(BaseAlgorithm):
    """PPO for walkers on tensors.

    Args:
        policy: "MlpPolicy"; or "MultiInputPolicy" where the scene's observation has the groups
            "policy" and "critic": the actor sees the one, the critic the other.
        env: A `PassiveWalkerVecEnv`, alone or in VecNormalize.
        learning_rate: Learning rate of the networks, or its schedule.
        n_steps: Steps of each walker in a rollout.
        batch_size: Steps in a batch, from which a gradient is computed.
        n_epochs: How often the networks learn from each step.
        gamma: Discount factor.
        gae_lambda: Weight of the later steps relative to the critic, in `advantages`.
        clip_range: Largest relative change of an action's probability density that still increases
            the objective.
        farthest: Largest advantage, and largest error of the critic, that count in full; in medians
            of the magnitudes of a rollout's advantages.
        vf_coef: Weight of the critic's errors.
        max_grad_norm: Norm at which the gradient is clipped.
        stats_window_size: Episodes in the statistics of stable-baselines3.
        tensorboard_log: Folder of logs.
        policy_kwargs: Arguments of the policy.
        verbose: 0 prints nothing.
        seed: Seed of weights, noise and walkers.
        device: Device of networks and rollouts; "auto" is a GPU if there is one.
        _init_setup_model: Whether to build the networks at once.

    Raises:
        TypeError: if `env` is something else.
        ValueError: if the steps of a rollout are not a multiple of `batch_size`, or the activation
            function of `policy_kwargs` is none of ReLU, Tanh, ELU and SiLU.
    """

    policy_aliases: dict[str, type[BasePolicy]] = {  # noqa: RUF012
        "MlpPolicy": ActorCriticPolicy, "MultiInputPolicy": PrivilegedCriticPolicy,
    }  # fmt: skip
    policy: ActorCriticPolicy

    def __init__(
        self,
        policy: str | type[ActorCriticPolicy],
        env: GymEnv,
        learning_rate: float | Schedule = 3e-3,
        n_steps: int = 64,
        batch_size: int = 1024,
        n_epochs: int = 5,
        gamma: float = 0.995,
        gae_lambda: float = 0.99,
        clip_range: float = 0.2,
        farthest: float = 5.0,
        vf_coef: float = 0.5,
        max_grad_norm: float = 0.5,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: torch.device | str = "auto",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy, env, learning_rate, policy_kwargs, stats_window_size, tensorboard_log,
            verbose, device, support_multi_env=True, seed=seed, supported_action_spaces=(Box,),
        )  # fmt: skip
        self.n_steps, self.batch_size, self.n_epochs = n_steps, batch_size, n_epochs
        self.gamma, self.gae_lambda, self.clip_range = gamma, gae_lambda, clip_range
        self.farthest, self.vf_coef, self.max_grad_norm = farthest, vf_coef, max_grad_norm
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        steps = self.n_steps * self.n_envs
        if self.batch_size < 1 or steps % self.batch_size:
            raise ValueError(
                f"batch_size must divide the {steps} steps of a rollout, which {self.batch_size} "
                "does not"
            )
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        made = self.policy_class(
            self.observation_space, self.action_space, self.lr_schedule, **self.policy_kwargs
        )
        self.acts_on = self.judges_by = slice(None)  # columns that actor and critic see
        if isinstance(self.observation_space, Dict):
            size = self.observation_space["policy"].shape[0]  # type: ignore[index]
            self.acts_on, self.judges_by = slice(0, size), slice(size, None)
        # Actor and critic share no weights, so a second thread computes the critic's gradient.
        self.helper = ThreadPoolExecutor(1, "critic", torch.set_num_threads, (1,))
        net: Any = made.to(self.device)
        self.policy, inner = net, net.mlp_extractor
        self.actor = Perceptron([*inner.policy_net, net.action_net], self.batch_size)
        self.critic = Perceptron([*inner.value_net, net.value_net], self.batch_size)
        # All weights are views of one vector, and all gradients of another, so that the optimizer
        # updates a single parameter.
        each = list(net.parameters())
        self.weights = nn.Parameter(nn.utils.parameters_to_vector(each).detach())
        nn.utils.vector_to_parameters(self.weights, each)
        self.most = torch.tensor(np.inf)
        self.gradient = self.weights.grad = torch.zeros_like(self.weights)
        for part, slope in zip(each, self.gradient.split([x.numel() for x in each]), strict=True):
            part.grad = slope.view_as(part)
        net.optimizer = net.optimizer_class(
            [self.weights], lr=self.lr_schedule(1.0), **net.optimizer_kwargs
        )

    _wrap_env = staticmethod(wrapped)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def _excluded_save_params(self) -> list[str]:
        own = ("actor", "critic", "most", "weights", "gradient", "helper", "walkers")
        return [*super()._excluded_save_params(), *own]

    def _setup_learn(self, *arguments: Any, **named: Any) -> tuple[int, BaseCallback]:
        prepared = super()._setup_learn(*arguments, **named)
        self._carry()
        if isinstance(self._last_obs, dict):
            self._last_original_obs = columns(self._last_original_obs)
            self._last_obs = columns(self._last_obs)
        return prepared

    def _carry(self) -> None:
        """Make the walkers of the rollouts, in the scene of the environments."""
        native: Any = self.env.unwrapped  # type: ignore[union-attr]
        self.walkers = carried(native, self.device)
        if not isinstance(self.walkers, PassiveWalkerTorchEnv):
            # Walkers on a GPU are reset, with a seed that no other seed or resumption shares.
            begun, _ = self.walkers.reset(seed=((self.seed or 0) << 32) + self.num_timesteps)
            self._last_obs = self._last_original_obs = begun.cpu().numpy()

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int | None = 1,
        tb_log_name: str = "FastPPO",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Alternate rollouts and updates, as stable-baselines3's algorithms do."""
        total, callback = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        callback.on_training_start(locals(), globals())
        iteration = 0
        while self.num_timesteps < total:
            rollout = self.walk(callback)
            if rollout is None:
                break
            iteration += 1
            self._update_current_progress_remaining(self.num_timesteps, total)
            self.update(rollout)
            if log_interval is not None and iteration % log_interval == 0:
                self.logger.dump(self.num_timesteps)
        callback.on_training_end()
        return self

    @torch.no_grad()
    def walk(self, callback: BaseCallback) -> Rollout | None:
        """Collect a rollout and its advantages; returns None if a callback stops the training.

        On a GPU, no data is copied to the CPU before the last step.
        """
        callback.on_rollout_start()
        if not isinstance(self.walkers, PassiveWalkerTorchEnv):  # others are the environments' own
            native: Any = self.env.unwrapped  # type: ignore[union-attr]
            if native.envs.scene_changes:
                native.envs.renew()
                self._carry()
            self.walkers.set_energy_cost(native.envs.energy_cost)
        net, scaled = self.policy, self._scaling()
        noise = torch.randn(self.n_steps, self.n_envs, len(net.log_std), device=self.device)
        noise *= net.log_std.exp()
        begun: Any = self._last_obs if self._last_original_obs is None else self._last_original_obs
        raw, seen, steps = torch.as_tensor(begun).to(self.device), [], []
        for strayed in noise:
            seen.append(scaled(raw))
            mean = net.action_net(net.mlp_extractor.policy_net(seen[-1][:, self.acts_on]))
            raw, paid, fell, late, info = self.walkers.step((mean + strayed).clamp(-1.0, 1.0))
            last, raw = columns(info.get("final_obs", raw)), columns(raw)
            steps.append((mean, raw, last, paid.float(), fell, late))
            self.num_timesteps += self.n_envs
            if not callback.on_step():
                return None
        callback.on_rollout_end()
        self._last_obs = self._last_original_obs = raw.cpu().numpy()

        means, reached, last, rewards, fell, late = map(torch.stack, zip(*steps, strict=True))
        seen = torch.stack(seen)
        values, after = self.value(seen), self.value(scaled(last)) * ~fell
        self.logger.record("rollout/reward", rewards.mean().item())
        rewards = self._learn_scales(reached, rewards, fell | late)
        gains = advantages(
            rewards, values, after, fell | late, gamma=self.gamma, gae_lambda=self.gae_lambda
        )
        drawn, returns = means + noise, gains + values
        self.most = self.farthest * gains.abs().median()
        gains = gains.clamp(-self.most, self.most)
        gains = (gains - gains.mean()) / (gains.std() + 1e-8)
        return Rollout(seen, drawn, chances(drawn, means, net.log_std), gains, returns)

    def value(self, seen: Tensor) -> Tensor:
        """Critic's values (T, n) of the observations (T, n, 8) of a rollout."""
        batches = seen[..., self.judges_by].flatten(0, 1).split(self.batch_size)
        said = [self.critic.forward(batch).clone() for batch in batches]
        return torch.cat(said).view(seen.shape[:-1])

    def _scaling(self) -> Callable[[Tensor], Tensor]:
        """A function that normalizes observations, with the scales of this rollout."""
        normalizer = self._vec_normalize_env
        if normalizer is None or not normalizer.norm_obs:
            return lambda raw: raw
        moments = _each_moments(normalizer)
        variance = np.concatenate([x.var for x in moments])
        mean, spread = (
            torch.tensor(x, dtype=torch.float32, device=self.device)
            for x in (np.concatenate([x.mean for x in moments]),
                      np.sqrt(variance + normalizer.epsilon))
        )  # fmt: skip
        return lambda raw: ((raw - mean) / spread).clamp(-normalizer.clip_obs, normalizer.clip_obs)

    def _learn_scales(self, raw: Tensor, rewards: Tensor, ended: Tensor) -> Tensor:
        """Update VecNormalize's moments with a rollout; returns the rewards as it scales them."""
        normalizer: Any = self._vec_normalize_env
        if normalizer is None:
            return rewards
        if normalizer.norm_obs:
            moments = _each_moments(normalizer)
            parts = raw.flatten(0, 1).split([len(x.mean) for x in moments], -1)
            for each, rows in zip(moments, parts, strict=True):
                _bring_up(each, rows)
        if not normalizer.norm_reward:
            return rewards
        returned, totals = torch.as_tensor(normalizer.returns).to(rewards), []
        for paid, over in zip(rewards, ended, strict=True):
            totals.append(normalizer.gamma * returned + paid)
            returned = totals[-1] * ~over
        normalizer.returns = returned.cpu().numpy()
        _bring_up(normalizer.ret_rms, torch.cat(totals))
        scale = float(np.sqrt(normalizer.ret_rms.var + normalizer.epsilon))
        return (rewards / scale).clamp(-normalizer.clip_reward, normalizer.clip_reward)

    @torch.no_grad()
    def update(self, rollout: Rollout) -> None:
        """Train actor and critic on a rollout, in batches that are shuffled for each epoch."""
        net = self.policy
        self._update_learning_rate(net.optimizer)
        columns = [x.flatten(0, 1).view(self.n_steps * self.n_envs, -1) for x in rollout]
        rows, widths = torch.cat(columns, -1), [x.shape[1] for x in columns]
        for _ in range(self.n_epochs):
            order = torch.randperm(len(rows), device=self.device)
            for batch in rows[order].split(self.batch_size):
                gain, error = self.differentiate(*batch.split(widths, -1))
                self.gradient *= (self.max_grad_norm / self.gradient.norm()).clamp(max=1.0)
                net.optimizer.step()
        self._n_updates += self.n_epochs
        for name, last in (("gain", gain), ("value_loss", error), ("std", net.log_std.exp())):
            self.logger.record(f"train/{name}", last.mean().item())

    def differentiate(
        self, seen: Tensor, actions: Tensor, before: Tensor, gains: Tensor, returns: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Compute the gradient of PPO's loss over a batch, in `gradient`.

        Returns the clipped objective and the square of the critic's clipped error of each row.
        """
        log_std, rows = self.policy.log_std, len(seen)
        critic = self.helper.submit(self._differentiate_critic, seen[:, self.judges_by], returns)
        mean = self.actor.forward(seen[:, self.acts_on])
        ratio = torch.exp(chances(actions, mean, log_std)[:, None] - before)
        gain = gains * ratio
        clipped = gains * ratio.clamp(1.0 - self.clip_range, 1.0 + self.clip_range)
        # Derivative by the logarithm of the density; it is 0 where the objective is clipped.
        slope = torch.where(gain <= clipped, gain, 0.0) / -rows
        strayed = (actions - mean) * torch.exp(-log_std)
        torch.sum(slope * (strayed.square() - 1.0), 0, out=log_std.grad)
        self.actor.backward(slope * strayed * torch.exp(-log_std))
        return torch.min(gain, clipped), critic.result()

    @torch.no_grad()
    def _differentiate_critic(self, seen: Tensor, returns: Tensor) -> Tensor:
        """Compute the gradient of the critic's loss; returns the square of each clipped error."""
        errors = (self.critic.forward(seen) - returns).clamp(-self.most, self.most)
        self.critic.backward(errors * (2.0 * self.vf_coef / len(seen)))
        return errors.square()
