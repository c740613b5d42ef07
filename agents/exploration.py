"""Callbacks that control how an algorithm explores."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import ActionNoise, NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.preprocessing import get_action_dim

from agents.config import ConfigError
from gym_passive_walker._tools.arguments import number
from gym_passive_walker._tools.loading import reason
from gym_passive_walker.gaits.scenes.scene import make_scene


class Schedule(BaseCallback):
    """Schedules the noise of PPO and SHAC, so that they do not stay with the first gait they find.

    PPO by itself reduces its noise as soon as the walker walks. Then it no longer finds actions
    that pay only over several control steps. One is to hold the swing leg before it lands, which
    costs work until the leg is held completely. So the noise follows a schedule. While braking is
    free, a partial hold costs nothing. For SHAC, noise also smooths the corners of the return, so
    that gradients account for them.

    The schedule depends only on the steps made and requested, so a resumed run needs no more state.

    Args:
        log_std: Logarithm of the noise's standard deviation at shares of the requested steps;
            linear between them.
        energy: Actuator work that costs energy at first: "absolute", "positive" or "net"; None is
            the scene's own.
        until: Share of the steps after which the scene's own `energy` applies.
    """

    def __init__(
        self, log_std: Mapping[float, float], energy: str | None = None, until: float = 0.0
    ) -> None:
        super().__init__()
        shares = sorted(log_std)
        if not shares:
            raise ValueError("log_std must have the noise at one share of the steps or more")
        if energy is not None:
            make_scene(energy=energy)  # raises an error for an unknown value
        self.shares, self.values = np.array([shares, [log_std[share] for share in shares]], float)
        self.energy, self.until = energy, number(until, "until")

    def _on_rollout_start(self) -> None:
        share = self.model.num_timesteps / self.model._total_timesteps
        policy: Any = self.model.policy
        policy.log_std.data.fill_(np.interp(share, self.shares, self.values))
        self.training_env.env_method("set_energy_cost", self.energy if share < self.until else None)

    def _on_step(self) -> bool:
        return True


class Ladder(BaseCallback):
    """Adds noise to SAC's actions, with a standard deviation that increases from walker to walker.

    SAC is off-policy: it also learns from actions that its policy would not choose. So the policy
    can have the small noise that an energy cost requires, and the critics still see other torques.

    Args:
        lowest: Standard deviation of the first walker's noise, in shares of the largest torque.
        highest: Standard deviation of the last walker's noise, in shares of the largest torque; the
            walkers between are in geometric progression.
    """

    def __init__(self, lowest: float, highest: float) -> None:
        super().__init__()
        self.lowest = number(lowest, "lowest", above=0.0)
        self.highest = number(highest, "highest", above=0.0)

    def _init_callback(self) -> None:
        count = self.training_env.num_envs
        shape = get_action_dim(self.training_env.action_space)
        noises: list[ActionNoise] = [
            NormalActionNoise(np.zeros(shape), np.full(shape, deviation))
            for deviation in np.geomspace(self.lowest, self.highest, count)
        ]
        ladder = VectorizedActionNoise(noises[0], count)
        ladder.noises = noises
        self.model.action_noise = ladder  # type: ignore[attr-defined]  # SAC has it

    def _on_step(self) -> bool:
        return True


def explorers(algo: str, arguments: Mapping[str, Any] | None) -> list[BaseCallback]:
    """The callbacks by which an algorithm explores; an empty list if `arguments` is None.

    Raises:
        ConfigError: if the arguments are invalid.
    """
    explorer = Ladder if algo == "sac" else Schedule
    try:
        return [] if arguments is None else [explorer(**arguments)]
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(f"{algo.upper()} cannot explore in this way: {reason(error)}") from None
