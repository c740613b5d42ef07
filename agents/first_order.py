"""First-order learning: a critic, short horizons, and the exact gradients of walking over them."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import GymEnv, Schedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from torch import Tensor, nn

from gym_passive_walker.control.tape import Linear, Tape

_STATE = 6


class Taped(VecEnvWrapper):
    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        self.tape = Tape(venv.unwrapped)
        self.clear()

    def clear(self) -> None:
        self.tape.clear()
        self.seen: list[NDArray] = []
        self.ended: list[NDArray] = []
        self.fell: list[NDArray] = []

    def reset(self) -> Any:
        return self.venv.reset()

    def step_async(self, actions: NDArray) -> None:
        self.tape.note(actions)
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = self.venv.step_wait()
        seen, fell = observations.copy(), dones.copy()
        for i in np.flatnonzero(dones):
            seen[i] = infos[i]["terminal_observation"]
            fell[i] = not infos[i]["TimeLimit.truncated"]
        self.seen.append(seen)
        self.ended.append(dones)
        self.fell.append(fell)
        return observations, rewards, dones, infos


def backwards(linear, by_state, ahead, ended, gamma, lam):
    gains, costates = np.empty(ended.shape), np.empty_like(ahead)
    costate = ahead[-1]
    for t in reversed(range(len(ended))):
        follows = np.where(ended[t][:, None], ahead[t], (1 - lam) * ahead[t] + lam * costate)
        gains[t] = linear.rewards_by_action[t] + gamma * (linear.states_by_action[t] * follows).sum(1)
        costate = (
            linear.rewards_by_state[t]
            + gamma * np.einsum("nij,ni->nj", linear.states_by_state[t], follows)
            + gains[t][:, None] * by_state[t]
        )
        costates[t] = costate
    return gains, costates


class SHAC(OnPolicyAlgorithm):
    policy_aliases = {"MlpPolicy": ActorCriticPolicy}

    def __init__(
        self,
        policy: str | type[ActorCriticPolicy],
        env: GymEnv,
        learning_rate: float | Schedule = 1e-3,
        n_steps: int = 32,
        batch_size: int = 256,
        n_epochs: int = 4,
        gamma: float = 0.99,
        gae_lambda: float = 0.95,
        max_grad_norm: float = 1.0,
        actor: str = "adam",
        reach: float = 0.1,
        critic_rate: float = 1.0,
        slopes: float = 1.0,
        cap: float = 5.0,
        anneal: bool = False,
        beyond: float = 1e9,
        prox: bool = False,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: torch.device | str = "cpu",
        _init_setup_model: bool = True,
    ) -> None:
        self.batch_size, self.n_epochs = batch_size, n_epochs
        self.actor, self.reach, self.critic_rate, self.slopes = actor, reach, critic_rate, slopes
        self.cap, self.anneal, self.beyond, self.prox = cap, anneal, beyond, prox
        super().__init__(
            policy, env, learning_rate=learning_rate, n_steps=n_steps, gamma=gamma,
            gae_lambda=gae_lambda, ent_coef=0.0, vf_coef=1.0, max_grad_norm=max_grad_norm,
            use_sde=False, sde_sample_freq=-1, stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log, policy_kwargs=policy_kwargs, verbose=verbose,
            seed=seed, device=device, _init_setup_model=_init_setup_model,
        )  # fmt: skip

    @staticmethod
    def _wrap_env(env, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        return Taped(BaseAlgorithm._wrap_env(env, verbose, monitor_wrapper))

    def collect_rollouts(self, env, *rest, **named) -> bool:
        env.clear()
        return super().collect_rollouts(env, *rest, **named)

    def _mean(self, seen: Tensor) -> Tensor:
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(seen))[..., 0]

    def _value(self, seen: Tensor) -> Tensor:
        return self.policy.value_net(self.policy.mlp_extractor.forward_critic(seen))[..., 0]

    def _by_state(self, of, seen: NDArray, spread: NDArray) -> NDArray:
        leaf = torch.as_tensor(seen).requires_grad_()
        (gradient,) = torch.autograd.grad(of(leaf).sum(), leaf)
        return gradient.numpy()[..., :_STATE] / spread

    def train(self) -> None:
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        env, buffer = self.env, self.rollout_buffer
        linear = env.tape.linearise()
        ended, fell = np.stack(env.ended), np.stack(env.fell)
        normalizer = self.get_vec_normalize_env()
        spread = np.ones(_STATE)
        if normalizer is not None:
            spread = np.sqrt(normalizer.obs_rms.var + normalizer.epsilon)[:_STATE]
        seen, actions = buffer.observations, buffer.actions[..., 0]
        by_state = self._by_state(self._mean, seen, spread)
        by_state[np.abs(actions) >= 1.0] = 0.0
        ahead = self._by_state(self._value, np.stack(env.seen), spread)
        ahead[fell] = 0.0
        gains, costates = backwards(linear, by_state, ahead, ended, self.gamma, self.gae_lambda)
        raw = gains.copy()
        gains[(np.abs(actions) >= 1.0) & (actions * gains > 0.0)] = 0.0
        # normalised, capped
        size = np.sqrt(np.mean(gains**2)) + 1e-12
        gains = np.clip(gains / size, -self.cap, self.cap)
        self.stats = dict(size=size, costate=np.abs(costates * spread).mean(), costate_max=np.abs(costates*spread).max())
        flat = torch.as_tensor(seen.reshape(-1, seen.shape[-1]))
        gains_t = torch.as_tensor(gains.reshape(-1), dtype=torch.float32)
        if self.actor == "adam":
            self._step(-(gains_t * self._mean(flat)).mean())
        slopes = np.clip(costates * spread, -10, 10)
        slopes_t = torch.as_tensor(slopes.reshape(-1, _STATE), dtype=torch.float32)
        returns = torch.as_tensor(buffer.returns.reshape(-1))
        if self.actor == "regress":
            with torch.no_grad():
                old = self._mean(flat)
            reach = self.reach * (self._current_progress_remaining if self.anneal else 1.0)
            if self.prox:
                sign = np.where(actions < 0, -1.0, 1.0)
                smooth = np.clip((raw + sign * linear.tolls) / size, -self.cap, self.cap)
                toll = reach * torch.as_tensor((linear.tolls / size).reshape(-1), dtype=torch.float32)
                aim = old + reach * torch.as_tensor(smooth.reshape(-1), dtype=torch.float32)
                target = aim.sign() * (aim.abs() - toll).clamp(min=0.0)
            else:
                target = old + reach * gains_t
            target = target.clamp(-self.beyond, self.beyond)
        errors = []
        for _ in range(self.n_epochs):
            for rows in torch.randperm(len(flat)).split(self.batch_size):
                part = flat[rows].requires_grad_()
                values = self._value(part)
                (by,) = torch.autograd.grad(values.sum(), part, create_graph=True)
                loss = ((values - returns[rows]) ** 2).mean()
                loss_s = ((by[:, :_STATE] - slopes_t[rows]) ** 2).sum(1).mean()
                errors.append((loss.item(), loss_s.item()))
                total = self.critic_rate * (loss + self.slopes * loss_s)
                if self.actor == "regress":
                    total = total + ((self._mean(flat[rows]) - target[rows]) ** 2).mean()
                self._step(total)
        self.stats["errors"] = np.mean(errors, axis=0)
        self._n_updates += 1

    def _step(self, loss: Tensor) -> None:
        self.policy.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()
