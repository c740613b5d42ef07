"""Networks that stable-baselines3 has not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor, nn


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


_UNITS: dict[type[nn.Module], tuple[Callable[..., Any], Callable[..., Any]]] = {
    nn.ReLU: (torch.relu_, lambda slope, out: slope.mul_(out.sign())),
    nn.Tanh: (torch.tanh_, lambda slope, out: slope.mul_(1.0 - out * out)),
}
"""What units say, and how a slope by that becomes one by what they are told; both in place."""


class Perceptron:
    """A network's outputs, and its gradient, in memory that serves every batch.

    Args:
        layers: Those of a torch network: linear ones, and between them all ReLU or all Tanh.
        rows: Of a batch.

    Raises:
        ValueError: if units are of another kind.
    """

    def __init__(self, layers: Iterable[nn.Module], rows: int) -> None:
        layers = list(layers)
        self.linear = [x for x in layers if isinstance(x, nn.Linear)]
        kinds = {type(x) for x in layers} - {nn.Linear} or {nn.ReLU}
        if not kinds < {nn.ReLU, nn.Tanh}:
            said = ", ".join(sorted(x.__name__ for x in kinds))
            raise ValueError(f"units of ppo-fast are ReLU or Tanh, not {said}")
        self.activate, self.lead_back = _UNITS[kinds.pop()]
        where = self.linear[0].weight.device
        self.outputs = [torch.empty(rows, x.out_features, device=where) for x in self.linear]
        self.slopes = [torch.empty_like(x) for x in self.outputs[:-1]]

    def forward(self, seen: Tensor) -> Tensor:
        """Outputs of a batch, (rows, seen) to (rows, outputs); the next batch overwrites them."""
        self.inputs = [seen, *self.outputs[:-1]]
        for layer, below, found in zip(self.linear, self.inputs, self.outputs, strict=True):
            torch.addmm(layer.bias, below, layer.weight.t(), out=found)
            if layer is not self.linear[-1]:
                self.activate(found)
        return self.outputs[-1]

    def backward(self, slope: Tensor) -> None:
        """Fill the gradients of weights, from the slope of a sum by the last outputs."""
        for k in reversed(range(len(self.linear))):
            layer, below = self.linear[k], self.inputs[k]
            # In this order of factors: a narrow first layer takes a fifth of the time.
            layer.weight.grad.copy_((below.t() @ slope).t())  # type: ignore[union-attr]
            torch.sum(slope, 0, out=layer.bias.grad)
            if k:
                slope = torch.mm(slope, layer.weight, out=self.slopes[k - 1])
                self.lead_back(slope, below)


POLICIES = {"agents.networks.NormedCriticPolicy": NormedCriticPolicy}
"""What a preset may name besides the library's own policies."""
