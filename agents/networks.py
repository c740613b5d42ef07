"""Networks that stable-baselines3 has not."""

from __future__ import annotations

from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.sac.policies import SACPolicy
from torch import nn


class NormedCriticPolicy(SACPolicy):
    """SAC's policy with critics that normalise what each of their layers says.

    A fall takes all that was to come at once, and what a torque is worth is a thousandth of it.
    Plain critics get their scale from the falls; normalised ones keep it in bounds, also for
    torques that were seldom tried (Ba, Kiros, Hinton: Layer Normalization, 2016).
    """

    def make_critic(
        self, features_extractor: BaseFeaturesExtractor | None = None
    ) -> ContinuousCritic:
        """Critics as of `SACPolicy`, with a normalisation before each activation."""
        critic = super().make_critic(features_extractor)
        for i, plain in enumerate(critic.q_networks):
            layers: list[nn.Module] = []
            *hidden, last = plain.children()
            for layer in hidden:
                layers.append(layer)
                if isinstance(layer, nn.Linear):
                    layers.append(nn.LayerNorm(layer.out_features))
            critic.q_networks[i] = nn.Sequential(*layers, last).to(self.device)
            critic.add_module(f"qf{i}", critic.q_networks[i])
        return critic


POLICIES = {"agents.networks.NormedCriticPolicy": NormedCriticPolicy}
"""What a preset may name besides the library's own policies."""
