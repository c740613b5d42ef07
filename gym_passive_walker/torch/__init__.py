"""Walkers for torch: strides, ticks and whole walks with exact gradients, and an environment.

    from gym_passive_walker.torch import stride, tick, rollout

Gradients come out of `backward`, forward mode and `torch.func` alike; `docs/derivatives.md` says
what is exact and what happens at strikes, at grazing and at falls.
"""

try:
    import torch  # noqa: F401 - the real one: it is only asked for
except ImportError as error:
    raise ImportError(
        'gradients for torch need torch, which is not installed: pip install "gym-passive-walker'
        '[train]"; gaits.flow has the same derivatives for NumPy',
        name="torch",
    ) from error

from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv
from gym_passive_walker.torch.rollouts import Rollout, Standing, rollout, standing
from gym_passive_walker.torch.walks import Stride, Tick, stride, tick

__all__ = [
    "PassiveWalkerTorchEnv",
    "Rollout",
    "Standing",
    "Stride",
    "Tick",
    "rollout",
    "standing",
    "stride",
    "tick",
]
