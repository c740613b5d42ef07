"""Proximal policy optimisation (Schulman et al., 2017) on tensors, all of it in this file.

It is the PPO of stable-baselines3, arranged for speed. There most of the time goes into ten passes
over each rollout, and most of the rest into calls for few walkers at a time; next to none into
walking. So here

- walkers are tensors, and a step of theirs is one pass through the actor alone: the critic is asked
  for all steps at once when they have been made;
- what scales observations and rewards is found once a rollout and not at each step;
- the gradient is written out, into memory that serves every batch (`networks.Perceptron`): where
  autograd takes new memory for each, sums wait for it.

Rollouts, advantages and updates are below in the order in which they happen. Only the networks, the
loop's callbacks and the files come from stable-baselines3, so that a run is like every other. Where
there is a GPU, all of it is there, walkers as well (`carried`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule
from torch import Tensor, nn

from agents.networks import Perceptron
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv


class Rollout(NamedTuple):
    """What T steps of n walkers have been: tensors whose first axes are (T, n)."""

    seen: Tensor  # normalised, (T, n, 8)
    actions: Tensor  # (T, n, actions)
    chances: Tensor  # logarithm of the density with which they were drawn
    advantages: Tensor
    returns: Tensor


def chances(actions: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Logarithm of a Gaussian's density, but for a constant: (..., k) to (...)."""
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
    """Generalised advantages (Schulman et al., 2016): how much better than expected it went.

    Args:
        rewards: Of each step, (T, n).
        values: What the critic expects before it, (T, n).
        after: What it expects after it, in the same episode, (T, n); 0 after falls.
        ended: Whose episode ended with the step, (T, n).
        gamma: The discount.
        gae_lambda: The weight of what follows over what the critic says of it.
    """
    surprises = rewards + gamma * after - values
    going, found = gamma * gae_lambda * ~ended, torch.empty_like(rewards)
    later = torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        found[t] = later = surprises[t] + going[t] * later
    return found


def carried(walkers: PassiveWalkerVecEnv, device: torch.device) -> Any:
    """Walkers on tensors: themselves, or as many more of their scene on a GPU that can carry them.

    Without the extra `gpu` the processor carries them, and tensors go to the device and back.

    Args:
        walkers: What the processor carries.
        device: Where tensors are wanted.
    """
    here = PassiveWalkerTorchEnv.around(walkers.envs, device)
    if device.type == "cuda":
        try:
            from gym_passive_walker.gpu.device import cuda
            from gym_passive_walker.gpu.environment import PassiveWalkerGpuEnv
        except ImportError:
            return here
        if cuda.is_available():
            limit = walkers.batch.rules["step_limit"][0]
            steps = int(limit) if np.isfinite(limit) else None
            return PassiveWalkerGpuEnv(walkers.num_envs, walkers.scene, max_episode_steps=steps)
    return here


def _bring_up(moments: RunningMeanStd, rows: Tensor) -> None:
    """Add rows to moments; what leaves the device is a number for each column."""
    var, mean = torch.var_mean(rows.double(), 0, correction=0)
    moments.update_from_moments(mean.cpu().numpy(), var.cpu().numpy(), len(rows))


class FastPPO(BaseAlgorithm):
    """PPO for walkers on tensors.

    Args:
        policy: "MlpPolicy".
        env: A `PassiveWalkerVecEnv`, in VecNormalize or not.
        learning_rate: Of the networks, or its schedule.
        n_steps: Steps of each walker in a rollout.
        batch_size: Steps that a gradient is taken of.
        n_epochs: How often the networks see each step.
        gamma: The discount.
        gae_lambda: As of `advantages`.
        clip_range: How far a chance may go from what it was, as a share, for some gain.
        vf_coef: The weight of the critic's errors.
        max_grad_norm: At which the gradient is clipped.
        stats_window_size: As of stable-baselines3, as is what follows.
        tensorboard_log: Folder of logs.
        policy_kwargs: Arguments of the policy.
        verbose: 0 for silence.
        seed: Of weights, noise and walkers.
        device: Where networks and what they learn from are; "auto" is a GPU where there is one.
        _init_setup_model: Whether to build the networks at once.

    Raises:
        ValueError: if rollouts do not fall into whole batches.
    """

    policy_aliases: dict[str, type[BasePolicy]] = {"MlpPolicy": ActorCriticPolicy}  # noqa: RUF012
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
        if batch_size < 1 or n_steps * self.n_envs % batch_size:
            raise ValueError(
                f"batch_size must divide the {n_steps * self.n_envs} steps of a rollout, which "
                f"{batch_size} does not"
            )
        self.n_steps, self.batch_size, self.n_epochs = n_steps, batch_size, n_epochs
        self.gamma, self.gae_lambda, self.clip_range = gamma, gae_lambda, clip_range
        self.vf_coef, self.max_grad_norm = vf_coef, max_grad_norm
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        made = self.policy_class(
            self.observation_space, self.action_space, self.lr_schedule, **self.policy_kwargs
        )
        net: Any = made.to(self.device)
        self.policy, inner = net, net.mlp_extractor
        self.actor = Perceptron([*inner.policy_net, net.action_net], self.batch_size)
        self.critic = Perceptron([*inner.value_net, net.value_net], self.batch_size)
        # All weights are views of one vector, and their gradients of another: Adam steps once.
        each = list(net.parameters())
        self.weights = nn.Parameter(nn.utils.parameters_to_vector(each).detach())
        nn.utils.vector_to_parameters(self.weights, each)
        self.gradient = self.weights.grad = torch.zeros_like(self.weights)
        for part, slope in zip(each, self.gradient.split([x.numel() for x in each]), strict=True):
            part.grad = slope.view_as(part)
        net.optimizer = net.optimizer_class(
            [self.weights], lr=self.lr_schedule(1.0), **net.optimizer_kwargs
        )

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def _excluded_save_params(self) -> list[str]:
        return [
            *super()._excluded_save_params(),
            "actor",
            "critic",
            "weights",
            "gradient",
            "walkers",
        ]

    def _setup_learn(self, *arguments: Any, **named: Any) -> tuple[int, BaseCallback]:
        prepared = super()._setup_learn(*arguments, **named)
        native: Any = self.env.unwrapped  # type: ignore[union-attr]
        self.walkers = carried(native, self.device)
        if not isinstance(self.walkers, PassiveWalkerTorchEnv):
            # Those on a device begin anew, with keys that no seed and no part of a training shares.
            begun, _ = self.walkers.reset(seed=((self.seed or 0) << 32) + self.num_timesteps)
            self._last_obs = self._last_original_obs = begun.cpu().numpy()
        return prepared

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int | None = 1,
        tb_log_name: str = "FastPPO",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Walk and learn by turns, as stable-baselines3's algorithms do."""
        total, told = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        told.on_training_start(locals(), globals())
        while self.num_timesteps < total:
            rollout = self.walk(told)
            if rollout is None:
                break
            self._update_current_progress_remaining(self.num_timesteps, total)
            self.update(rollout)
            if log_interval is not None:
                self.logger.dump(self.num_timesteps)
        told.on_training_end()
        return self

    @torch.no_grad()
    def walk(self, callback: BaseCallback) -> Rollout | None:
        """Let all walkers walk on, and look back at it; None if a callback stops it.

        Where they are on a device, nothing comes from there before the last step is made.
        """
        callback.on_rollout_start()
        native: Any = self.env.unwrapped  # type: ignore[union-attr]
        self.walkers.set_energy_cost(native.envs.energy_cost)
        net, scaled = self.policy, self._scaling()
        noise = torch.randn(self.n_steps, self.n_envs, len(net.log_std), device=self.device)
        noise *= net.log_std.exp()
        begun: Any = self._last_obs if self._last_original_obs is None else self._last_original_obs
        raw, seen, steps = torch.as_tensor(begun).to(self.device), [], []
        for strayed in noise:
            seen.append(scaled(raw))
            mean = net.action_net(net.mlp_extractor.policy_net(seen[-1]))
            raw, paid, fell, late, info = self.walkers.step((mean + strayed).clamp(-1.0, 1.0))
            steps.append((mean, raw, info.get("final_obs", raw), paid.float(), fell, late))
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
        gains = (gains - gains.mean()) / (gains.std() + 1e-8)
        return Rollout(seen, drawn, chances(drawn, means, net.log_std), gains, returns)

    def value(self, seen: Tensor) -> Tensor:
        """What the critic expects in all steps of a rollout, (T, n, 8) to (T, n)."""
        batches = seen.flatten(0, 1).split(self.batch_size)
        said = [self.critic.forward(batch).clone() for batch in batches]
        return torch.cat(said).view(seen.shape[:-1])

    def _scaling(self) -> Callable[[Tensor], Tensor]:
        """How observations are scaled in this rollout."""
        normalizer = self._vec_normalize_env
        if normalizer is None or not normalizer.norm_obs:
            return lambda raw: raw
        moments: Any = normalizer.obs_rms
        mean, spread = (
            torch.tensor(x, dtype=torch.float32, device=self.device)
            for x in (moments.mean, np.sqrt(moments.var + normalizer.epsilon))
        )
        return lambda raw: ((raw - mean) / spread).clamp(-normalizer.clip_obs, normalizer.clip_obs)

    def _learn_scales(self, raw: Tensor, rewards: Tensor, ended: Tensor) -> Tensor:
        """Let VecNormalize see a rollout, and return the rewards as it scales them."""
        normalizer: Any = self._vec_normalize_env
        if normalizer is None:
            return rewards
        if normalizer.norm_obs:
            _bring_up(normalizer.obs_rms, raw.flatten(0, 1))
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
        """Let actor and critic learn from a rollout, in batches drawn anew for each epoch."""
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
        """Make `gradient` that of PPO's loss over a batch; the rows' gains and squared errors."""
        log_std, rows = self.policy.log_std, len(seen)
        mean = self.actor.forward(seen)
        ratio = torch.exp(chances(actions, mean, log_std)[:, None] - before)
        gain = gains * ratio
        clipped = gains * ratio.clamp(1.0 - self.clip_range, 1.0 + self.clip_range)
        # By the logarithm of a chance: where it went too far already, nothing is to be gained.
        slope = torch.where(gain <= clipped, gain, 0.0) / -rows
        strayed = (actions - mean) * torch.exp(-log_std)
        torch.sum(slope * (strayed.square() - 1.0), 0, out=log_std.grad)
        self.actor.backward(slope * strayed * torch.exp(-log_std))
        errors = self.critic.forward(seen) - returns
        self.critic.backward(errors * (2.0 * self.vf_coef / rows))
        return torch.min(gain, clipped), errors.square()
