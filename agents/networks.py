"""Networks that stable-baselines3 does not provide."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Dict
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy, ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor, nn

from gym_passive_walker.gaits.scenes.rewards import OBSERVERS


class NormedCriticPolicy(SACPolicy):
    """SAC's policy with layer normalization in its critics.

    A fall removes all later rewards, and the effect of one torque on the return is a thousandth of
    that. Critics without normalization take their scale from the falls. Normalization keeps the
    scale bounded, also for torques that were seldom tried (Ba, Kiros, Hinton: Layer Normalization,
    2016).
    """

    def make_critic(
        self, features_extractor: BaseFeaturesExtractor | None = None
    ) -> ContinuousCritic:
        """Build the critics of `SACPolicy`, with a layer normalization before each activation."""
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


class FallCriticPolicy(ActorCriticPolicy):
    """PPO's policy with a second critic, which estimates how likely a fall is.

    Its output is the logit of the discounted probability of a fall in the episode. It has the size
    of the other critic, and smooth units, since its derivative is used.
    """

    def _build(self, lr_schedule: Schedule) -> None:
        sizes = self.net_arch["vf"] if isinstance(self.net_arch, dict) else self.net_arch
        *hidden, last = create_mlp(self.features_dim, 1, sizes, nn.SiLU)
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        nn.init.constant_(last.bias, _RARE)
        self.fall_critic = nn.Sequential(*hidden, last)
        super()._build(lr_schedule)


def columns(seen: Any) -> Any:
    """Observations in one tensor or array, (..., k), of groups one after another."""
    if not isinstance(seen, dict):
        return seen
    join = torch.cat if isinstance(seen["policy"], Tensor) else np.concatenate
    return join([seen[name] for name in OBSERVERS], -1)


def in_groups(rows: NDArray, space: Any) -> Any:
    """Observations in one array, (n, k), as an environment of this space has them."""
    if not isinstance(space, Dict):
        return rows
    first = space["policy"].shape[0]  # type: ignore[index]
    return dict(zip(OBSERVERS, (rows[:, :first], rows[:, first:]), strict=True))


_RARE = -3.0
"""First estimate of a fall critic: a probability of 5 %."""

_UNITS: dict[type[nn.Module], tuple[Callable[[Tensor], Tensor], Callable[..., Tensor]]] = {
    nn.ReLU: (torch.relu_, lambda before, after: after.sign()),
    nn.Tanh: (torch.tanh_, lambda before, after: 1.0 - after * after),
    nn.ELU: (nn.functional.elu_, lambda before, after: after.clamp(max=0.0) + 1.0),
    nn.SiLU: (nn.functional.silu, lambda before, after: before.sigmoid() * (1.0 + before - after)),
}
"""Activation functions and their derivatives.

A function works in place if its output alone gives its derivative.
"""


class Perceptron:
    """Outputs and gradients of a network, without autograd, in memory that every batch reuses.

    Autograd allocates memory for each batch, which takes most of the time of networks this small.

    Args:
        layers: Layers of a torch network with one kind of activation, a key of `_UNITS`. The
            `grad` of each weight must be allocated.
        rows: Rows of a batch.

    Raises:
        ValueError: if the activation is another one.
    """

    def __init__(self, layers: Iterable[nn.Module], rows: int) -> None:
        layers = list(layers)
        self.linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
        between = (type(layer) for layer in layers if not isinstance(layer, nn.Linear))
        kind = next(between, nn.ReLU)
        if kind not in _UNITS:
            known = ", ".join(each.__name__ for each in _UNITS)
            raise ValueError(
                f"no derivative of the activation {kind.__name__}: choose from {known}"
            )
        self.unit, self.slope_of = _UNITS[kind]
        where = self.linear[0].weight.device
        self.before = [torch.empty(rows, x.out_features, device=where) for x in self.linear]
        self.slopes = [torch.empty_like(before) for before in self.before[:-1]]

    def forward(self, seen: Tensor) -> Tensor:
        """Outputs (rows, outputs) of a batch (rows, inputs); the next batch overwrites them."""
        self.inputs = [seen]
        for layer, before in zip(self.linear, self.before, strict=True):
            torch.addmm(layer.bias, self.inputs[-1], layer.weight.t(), out=before)
            if layer is not self.linear[-1]:
                self.inputs.append(self.unit(before))
        return self.before[-1]

    def backward(self, slope: Tensor) -> None:
        """Fill the gradients of the weights, from a loss's gradient by the last outputs."""
        for k in reversed(range(len(self.linear))):
            layer, below = self.linear[k], self.inputs[k]
            # With this order of factors, a narrow first layer takes a fifth of the time.
            layer.weight.grad.copy_((below.t() @ slope).t())  # type: ignore[union-attr]
            torch.sum(slope, 0, out=layer.bias.grad)
            if k:
                slope = torch.mm(slope, layer.weight, out=self.slopes[k - 1])
                slope *= self.slope_of(self.before[k - 1], below)


POLICIES: dict[str, type[BasePolicy]] = {
    f"agents.networks.{policy.__name__}": policy
    for policy in (NormedCriticPolicy, FallCriticPolicy)
}
"""Policies that a preset may name besides those of stable-baselines3."""
