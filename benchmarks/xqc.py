"""XQC (arXiv:2509.25174) as a learner of SBX: its critics in place of those of CrossQ.

Critics have batch normalization after each layer, weights of unit norm, and return a distribution
over `ATOMS` returns, which is fitted by cross-entropy. There are no target networks. The sizes of
networks and numbers of updates are those that the caller gives, not those of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import flax.linen as nn  # type: ignore[import-not-found]
import jax  # type: ignore[import-not-found]
import jax.numpy as jnp  # type: ignore[import-not-found]
import optax  # type: ignore[import-not-found]
from sbx import CrossQ  # type: ignore[import-not-found]
from sbx.common.jax_layers import BatchRenorm  # type: ignore[import-not-found]
from sbx.crossq.policies import CrossQPolicy  # type: ignore[import-not-found]

ATOMS = jnp.linspace(-1.0, 1.0, 101)
"""Returns of the critics' distributions; those of `level`, discounted by 0.98, are within them."""

POLICY_DELAY = 3
"""Updates of the critics to one of the actor, as in CrossQ and XQC."""


class Critic(nn.Module):
    """One critic: logits of `ATOMS` in training, shape (n, 101), otherwise the mean, (n, 1)."""

    net_arch: Sequence[int]
    batch_norm_momentum: float
    renorm_warmup_steps: int
    activation_fn: Callable[[jax.Array], jax.Array]

    @nn.compact
    def __call__(self, seen: jax.Array, actions: jax.Array, train: bool = False) -> jax.Array:
        """Evaluate the critic."""

        def norm(x: jax.Array) -> jax.Array:
            return BatchRenorm(
                use_running_average=not train, momentum=self.batch_norm_momentum,
                warmup_steps=self.renorm_warmup_steps,
            )(x)  # fmt: skip

        x = norm(jnp.concatenate([seen, actions], -1))
        for units in self.net_arch:
            x = self.activation_fn(norm(nn.Dense(units, use_bias=False)(x)))
        logits = nn.Dense(len(ATOMS), name="last")(x)
        return logits if train else nn.softmax(logits) @ ATOMS[:, None]


class Critics(nn.Module):
    """Independent critics, with the arguments that `CrossQPolicy` gives."""

    net_arch: Sequence[int]
    n_critics: int
    batch_norm_momentum: float
    renorm_warmup_steps: int
    activation_fn: Callable[[jax.Array], jax.Array]
    use_layer_norm: bool = False
    use_batch_norm: bool = True
    dropout_rate: float | None = None

    @nn.compact
    def __call__(self, seen: jax.Array, actions: jax.Array, train: bool = False) -> jax.Array:
        """Evaluate all critics; the first axis of the result is theirs."""
        many = nn.vmap(
            Critic, variable_axes={"params": 0, "batch_stats": 0}, in_axes=None, out_axes=0,
            split_rngs={"params": True, "batch_stats": True}, axis_size=self.n_critics,
        )  # fmt: skip
        return many(
            self.net_arch, self.batch_norm_momentum, self.renorm_warmup_steps, self.activation_fn
        )(seen, actions, train)


def projected(returns: jax.Array, shares: jax.Array) -> jax.Array:
    """Distribution on `ATOMS`, (n, 101), of returns with probabilities, both of shape (n, 101).

    Each probability is split between the two nearest atoms (Bellemare et al. 2017), so the mean
    is kept.
    """
    last = len(ATOMS) - 1
    places = (jnp.clip(returns, ATOMS[0], ATOMS[-1]) - ATOMS[0]) / (ATOMS[1] - ATOMS[0])
    below = jnp.minimum(places.astype(int), last - 1)
    upper, rows = places - below, jnp.arange(len(returns))[:, None]
    split = jnp.zeros_like(shares).at[rows, below].add(shares * (1.0 - upper))
    return split.at[rows, below + 1].add(shares * upper)


def unit_norm(path: Any, kernel: jax.Array) -> jax.Array:
    """Weights with unit norm for each unit, where batch normalization follows."""
    names = [part.key for part in path]
    if names[-1] != "kernel" or "last" in names:
        return kernel
    return kernel / jnp.linalg.norm(kernel, axis=-2, keepdims=True)


class Policy(CrossQPolicy):
    """The networks: the actor of CrossQ, and `Critics`.

    Their learning rates decrease to 0 over `updates` of the critics.
    """

    def __init__(self, *args: Any, updates: int, **named: Any) -> None:
        self.updates = updates
        super().__init__(*args, **named, vector_critic_class=Critics)

    def build(self, key: jax.Array, lr_schedule: Any, qf_learning_rate: float) -> jax.Array:
        """Build networks and optimizers."""
        key = super().build(key, lr_schedule, qf_learning_rate)
        for name, each in (("actor_state", POLICY_DELAY), ("qf_state", 1)):
            state = getattr(self, name)
            rate = optax.linear_schedule(lr_schedule(1), 0.0, self.updates // each)
            optimizer = self.optimizer_class(rate, **self.optimizer_kwargs)
            begun = optimizer.init(state.params)
            setattr(self, name, state.replace(tx=optimizer, opt_state=begun))
        return key


class XQC(CrossQ):
    """CrossQ with categorical critics of normalized weights."""

    policy_aliases = {"MlpPolicy": Policy}  # noqa: RUF012

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named, policy_delay=POLICY_DELAY)

    @staticmethod
    @jax.jit
    def update_critic(
        actor_state: Any, qf_state: Any, ent_coef_state: Any, observations: jax.Array,
        actions: jax.Array, next_observations: jax.Array, rewards: jax.Array, dones: jax.Array,
        discounts: jax.Array, key: jax.Array,
    ) -> Any:  # fmt: skip
        """Fit the critics to one batch; arguments and results are those of CrossQ."""
        key, noise = jax.random.split(key)
        actor = {"params": actor_state.params, "batch_stats": actor_state.batch_stats}
        chosen = actor_state.apply_fn(actor, next_observations, train=False)
        next_actions = chosen.sample(seed=noise)
        weight = ent_coef_state.apply_fn({"params": ent_coef_state.params})
        entropy = weight * chosen.log_prob(next_actions)[:, None]

        def loss(params: Any) -> tuple[jax.Array, Any]:
            logits, updated = qf_state.apply_fn(
                {"params": params, "batch_stats": qf_state.batch_stats},
                jnp.concatenate([observations, next_observations]),
                jnp.concatenate([actions, next_actions]),
                mutable=["batch_stats"], train=True,
            )  # fmt: skip
            now, later = jnp.split(logits, 2, axis=1)
            shares = nn.softmax(later)
            lowest = jnp.argmin(shares @ ATOMS, axis=0)
            shares = jnp.take_along_axis(shares, lowest[None, :, None], axis=0)[0]
            kept = ((1.0 - dones) * discounts)[:, None]
            target = projected(rewards[:, None] + kept * (ATOMS - entropy), shares)
            target = jax.lax.stop_gradient(target)
            return -jnp.sum(target * nn.log_softmax(now), axis=-1).mean(axis=1).sum(), updated

        (value, updated), slopes = jax.value_and_grad(loss, has_aux=True)(qf_state.params)
        qf_state = qf_state.apply_gradients(grads=slopes)
        qf_state = qf_state.replace(
            params=jax.tree_util.tree_map_with_path(unit_norm, qf_state.params),
            batch_stats=updated["batch_stats"],
        )
        return qf_state, (value, weight), key
