"""How an algorithm keeps trying what it does not do yet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import ActionNoise, NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.preprocessing import get_action_dim

from agents.config import ConfigError, reason
from gym_passive_walker.arguments import number
from gym_passive_walker.envs.scene import make_scene


class Schedule(BaseCallback):
    """Keeps PPO and SHAC from settling for the first gait that it finds.

    Left to itself, PPO's noise shrinks as soon as it walks, and what takes several ticks together
    is not found any more: to hold the swing leg before it lands costs work until it is held in
    full. So the noise follows a schedule; and while braking is free, a little of a hold costs
    nothing. To SHAC noise is also what makes corners smooth, and gradients tell of them.

    All of it follows from the steps made and asked for, so a resumed run needs no memory of it.

    Args:
        log_std: Logarithm of the noise's standard deviation at shares of the steps asked for;
            linear between them.
        energy: What the motor is charged for at first, as of `Scene`; None is the scene's own.
        until: Share of the steps after which it is the scene's own.
    """

    def __init__(
        self, log_std: Mapping[float, float], energy: str | None = None, until: float = 0.0
    ) -> None:
        super().__init__()
        shares = sorted(log_std)
        if not shares:
            raise ValueError("log_std must say the noise at one share of the steps or more")
        if energy is not None:
            make_scene(energy=energy)  # refuses what is none
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
    """Lets SAC's walkers stray from its policy, each more boldly than the one before.

    SAC learns from what others do as well: so its policy may have as little noise as a motor that
    is paid by work should, while the critics still see what other torques lead to.

    Args:
        lowest: Standard deviation of the first walker's noise, in shares of the largest torque.
        highest: That of the last one; those between are in geometric progression.
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


_EXPLORERS: dict[str, type[BaseCallback]] = {
    "ppo": Schedule,
    "ppo-fast": Schedule,
    "sac": Ladder,
    "shac": Schedule,
}


def explorers(algo: str, arguments: Mapping[str, Any] | None) -> list[BaseCallback]:
    """The callback by which an algorithm explores; none if it is told no arguments of it.

    Raises:
        ConfigError: if the callback has no such arguments.
    """
    try:
        return [] if arguments is None else [_EXPLORERS[algo](**arguments)]
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(f"{algo.upper()} cannot explore so: {reason(error)}") from None
