"""Inference of stable-baselines3's MlpPolicy in NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import number, shown

Layer = tuple[NDArray[np.float32], NDArray[np.float32]]

ACTIVATIONS: dict[str, Callable[[NDArray], NDArray]] = {
    "ReLU": lambda x: np.maximum(x, np.float32(0.0)),
    "Tanh": np.tanh,
    "ELU": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, np.float32(0.0)))),
    "SiLU": lambda x: x * (np.float32(0.5) * (np.float32(1.0) + np.tanh(np.float32(0.5) * x))),
}
"""Activation functions by torch's names."""

_SLOPES: dict[str, Callable[[NDArray], NDArray]] = {
    "ReLU": lambda x: (x > 0.0).astype(float),
    "Tanh": lambda x: 1.0 - np.tanh(x) ** 2,
    "ELU": lambda x: np.where(x > 0.0, 1.0, np.exp(np.minimum(x, 0.0))),
    "SiLU": lambda x: (s := 0.5 * (1.0 + np.tanh(0.5 * x))) * (1.0 + x * (1.0 - s)),
}
"""Derivatives of the activation functions."""

PLACES = {
    "ppo": ("mlp_extractor.policy_net", "action_net"),
    "ppo-fast": ("mlp_extractor.policy_net", "action_net"),
    "sac": ("actor.latent_pi", "actor.mu"),
    "shac": ("mlp_extractor.policy_net", "action_net"),
    "shac-learned": ("mlp_extractor.policy_net", "action_net"),
}
"""Names of the hidden layers and of the layer of the mean action, by algorithm."""
_LARGEST = float(np.finfo(np.float32).max)
_LOG_STD = (-20.0, 2.0)  # SAC clips the output of its network to this range


class Network:
    """A Gaussian policy, or a squashed one (SAC), with its observation normalizer.

    Args:
        tensors: Weights and moments, by stable-baselines3's names.
        algo: "ppo", "ppo-fast", "sac", "shac" or "shac-learned".
        activation: One of `ACTIVATIONS`.
        normalizer: "epsilon" and "clip" of VecNormalize; None without normalization.
        least: Smallest actions, (actions,) or one for all: tanh is scaled from them to 1, as
            stable-baselines3 does. Clipped actions are from -1, and the environment clips them.

    Attributes:
        activation: Name of the activation function.
        squashed: Whether tanh limits actions; else they are clipped to [-1, 1].
        scale: Middle and half of the range of squashed actions, each (actions,).
        moments: Mean and standard deviation of observations, (size,), and to how many of these
            deviations they are clipped; None without normalization.
        random: Generator of the noise of stochastic actions.

    Raises:
        KeyError: if a tensor is missing.
        ValueError: if the algorithm or the activation is unknown, a number is not finite, or the
            shapes of tensors do not match.
    """

    def __init__(
        self,
        tensors: Mapping[str, NDArray],
        *,
        algo: str,
        activation: str,
        normalizer: Mapping[str, float] | None,
        least: ArrayLike = -1.0,
    ) -> None:
        for what, name, known in (
            ("algorithm", algo, PLACES),
            ("activation", activation, ACTIVATIONS),
        ):
            if not isinstance(name, str) or name not in known:
                raise ValueError(f"no {what} {shown(name)}: choose from {', '.join(known)}")
        for name, tensor in tensors.items():
            real = np.asarray(tensor).dtype.kind in "fiu"
            if not real or not np.all(np.abs(np.asarray(tensor, float)) <= _LARGEST):
                raise ValueError(f"tensor {name} must be finite numbers of single precision")
        self.activation, self.squashed = activation, algo == "sac"
        hidden, mean = PLACES[algo]
        places = {name.rsplit(".", 1)[0] for name in tensors if name.startswith(f"{hidden}.")}
        in_order = sorted(places, key=lambda place: int(place.rsplit(".", 1)[1]))
        self._hidden = [_layer(tensors, place) for place in in_order]
        self._mean = _layer(tensors, mean)
        # SAC's noise depends on the observation; that of other algorithms is constant.
        layers = [*self._hidden, self._mean]
        self._log_std: Layer | NDArray[np.float32]
        if self.squashed:
            self._log_std = _layer(tensors, "actor.log_std")
            sizes = [weight.shape for weight, _ in (self._mean, self._log_std)]
        else:
            self._log_std = np.asarray(tensors["log_std"], np.float32)
            sizes = [self._mean[1].shape, self._log_std.shape]
        if sizes[0] != sizes[1]:
            raise ValueError("the size of its noise differs from that of its actions")
        for (_, before), (weight, _) in pairwise(layers):
            if weight.shape[1] != len(before):
                raise ValueError("the sizes of consecutive layers do not match")
        self._size = layers[0][0].shape[1]
        ends = np.broadcast_to(np.asarray(least, np.float32), self._mean[1].shape)
        self.scale = 0.5 * (1.0 + ends), 0.5 * (1.0 - ends)
        self.moments: tuple[NDArray, NDArray, float] | None = None
        if normalizer is not None:
            mean_seen, variance = (
                np.asarray(tensors[f"normalizer.obs_rms.{name}"]) for name in ("mean", "var")
            )
            if mean_seen.shape != (self._size,) or variance.shape != (self._size,):
                raise ValueError("the size of its normalizer differs from that of its observations")
            if not isinstance(normalizer, Mapping):
                raise ValueError(f"normalizer must have epsilon and clip, not {shown(normalizer)}")
            epsilon = number(normalizer["epsilon"], "epsilon", least=0.0)
            clip = number(normalizer["clip"], "clip", above=0.0, most=math.inf)
            if not np.all(variance + epsilon > 0.0):
                raise ValueError("its normalizer's variances must be above 0")
            self.moments = mean_seen, np.sqrt(variance + epsilon), clip
        self.random = np.random.default_rng()

    @property
    def layers(self) -> list[Layer]:
        """Weight (outputs, inputs) and bias (outputs,) of each layer; the last returns actions."""
        return [*self._hidden, self._mean]

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions, as stable-baselines3's `predict` does.

        Args:
            observation: Observations of the environment, (k,) or (n, k).
            state: Returned unchanged: the policy has no memory.
            episode_start: Ignored.
            deterministic: Whether to return the mean actions, without noise.

        Returns:
            Actions, (actions,) or (n, actions), and the state.

        Raises:
            ValueError: if the observations have another shape.
        """
        seen = np.asarray(observation)
        if seen.ndim not in (1, 2) or seen.shape[-1] != self._size:
            raise ValueError(
                f"observations must have shape ({self._size},) or (n, {self._size}), "
                f"not {seen.shape}"
            )
        if self.moments is not None:
            mean, spread, clip = self.moments
            seen = np.clip((seen - mean) / spread, -clip, clip)
        x, activate = seen.astype(np.float32), ACTIVATIONS[self.activation]
        for weight, bias in self._hidden:
            x = activate(x @ weight.T + bias)
        torque = x @ self._mean[0].T + self._mean[1]
        if not deterministic:
            draws = self.random.standard_normal(torque.shape, np.float32)
            torque = torque + np.exp(self._noise(x)) * draws
        middle, half = self.scale
        action = middle + half * np.tanh(torque) if self.squashed else np.clip(torque, -1.0, 1.0)
        return action, state

    def linearize(self, observation: NDArray) -> tuple[NDArray, NDArray]:
        """Return the mean actions for observations (n, size), and their derivatives, in float64.

        `predict` computes in float32, so actions agree to a few of its roundings. Where an action
        or a normalized observation is clipped, its derivative is 0.

        Returns:
            Actions (n, actions), and their derivatives (n, actions, size).
        """
        return self._mean_of(observation, derivatives=True)

    def mean_actions(self, observation: NDArray) -> NDArray[np.float64]:
        """Return the mean actions (n, actions) for observations (n, size), in float64."""
        return self._mean_of(observation, derivatives=False)[0]

    def _mean_of(self, observation: NDArray, *, derivatives: bool) -> tuple[NDArray, Any]:
        """Return the mean actions, and their derivatives or None."""
        x, change = np.asarray(observation, dtype=float), None
        slope = np.ones_like(x)
        if self.moments is not None:
            mean, spread, clip = self.moments
            x = (x - mean) / spread
            slope = (np.abs(x) < clip) / spread
            x = np.clip(x, -clip, clip)
        if derivatives:
            change = slope[:, None, :] * np.eye(self._size)
        for weight, bias in self._hidden:
            x = x @ weight.T.astype(float) + bias
            if change is not None:
                rates = _SLOPES[self.activation](x)[:, :, None]
                change = rates * (weight.astype(float) @ change)
            x = ACTIVATIONS[self.activation](x)
        weight, bias = self._mean
        action = x @ weight.T.astype(float) + bias
        if change is not None:
            change = weight.astype(float) @ change
        if self.squashed:
            (middle, half), action = self.scale, np.tanh(action)
            if change is not None:
                change = (half * (1.0 - action**2))[:, :, None] * change
            return middle + half * action, change
        inside = (np.abs(action) < 1.0)[:, :, None]
        return np.clip(action, -1.0, 1.0), None if change is None else inside * change

    def _noise(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the logarithm of the noise's standard deviation."""
        if isinstance(self._log_std, tuple):
            weight, bias = self._log_std
            return np.clip(x @ weight.T + bias, *_LOG_STD)
        return self._log_std


def _layer(tensors: Mapping[str, NDArray], place: str) -> Layer:
    """Return the weight and the bias of a layer."""
    weight, bias = (
        np.asarray(tensors[f"{place}.{name}"], np.float32) for name in ("weight", "bias")
    )
    if weight.ndim != 2 or bias.shape != weight.shape[:1]:
        raise ValueError(f"weight and bias of {place} do not fit together")
    return weight, bias
