"""A policy of stable-baselines3 of which the actor sees "policy", and the critic "critic"."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Dict

from gym_passive_walker._tools.extras import extra

with extra("train"):
    from stable_baselines3.common.policies import ActorCriticPolicy
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
    from torch import Tensor


class _Group(BaseFeaturesExtractor):
    """One group of an observation."""

    def __init__(self, observation_space: Dict, name: str) -> None:
        super().__init__(observation_space, observation_space[name].shape[0])  # type: ignore[index]
        self.name = name

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Return the group, (n, features_dim)."""
        return observations[self.name]


class PrivilegedCriticPolicy(ActorCriticPolicy):
    """Actor and critic that see different groups of an observation (Pinto et al., 2017).

    `MultiInputPolicy` of stable-baselines3 shows both groups to both. The weights of the actor have
    the names of `MlpPolicy`, so that its files are read as those of `MlpPolicy` are.

        PPO(PrivilegedCriticPolicy, PassiveWalkerVecEnv(64, observation={"policy": ..., ...}))

    Args:
        observation_space: A `Dict` of "policy" and "critic".
        *rest: Further arguments of `ActorCriticPolicy`.
        **options: Further options of `ActorCriticPolicy`; networks without shared layers.

    Raises:
        ValueError: if the observation has no such groups.
    """

    def __init__(self, observation_space: Any, *rest: Any, **options: Any) -> None:
        if not isinstance(observation_space, Dict) or {*observation_space} != {"policy", "critic"}:
            raise ValueError(
                "PrivilegedCriticPolicy needs an observation with the groups policy and critic: "
                'give the scene observation={"policy": ..., "critic": ...}, or choose MlpPolicy'
            )
        super().__init__(observation_space, *rest, **options | {"share_features_extractor": False})

    def _build_mlp_extractor(self) -> None:
        """Build the hidden layers of each group, in place of those of all observations."""
        made = []
        for name in ("policy", "critic"):
            group = _Group(self.observation_space, name)  # type: ignore[arg-type]
            layers = MlpExtractor(
                group.features_dim, self.net_arch, self.activation_fn, device=self.device
            )
            made.append((group, layers))
        (self.pi_features_extractor, self.mlp_extractor), (self.vf_features_extractor, critic) = (
            made
        )
        self.features_extractor = self.pi_features_extractor
        self.mlp_extractor.value_net = critic.value_net
