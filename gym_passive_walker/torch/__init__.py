"""Walkers for torch: strides, control steps and episodes with exact gradients; an environment.

    from gym_passive_walker.torch import stride, tick, rollout

`backward`, forward mode and `torch.func` return the gradients. `docs/derivatives.md` describes
their accuracy, and how they behave at impacts, at grazing and at falls.
"""

try:
    import torch  # noqa: F401 - the real one: it is only asked for
except ModuleNotFoundError as error:
    raise ImportError(
        'gradients for torch need torch, which is not installed: pip install "gym-passive-walker'
        '[train]"; gaits.flow has the same derivatives for NumPy',
        name="torch",
    ) from error

from gym_passive_walker.torch.environment import PassiveWalkerTorchEnv
from gym_passive_walker.torch.linearization import Linear, StepRecorder, left_out
from gym_passive_walker.torch.rollouts import Rollout, initial_state, rollout
from gym_passive_walker.torch.steps import RolloutState
from gym_passive_walker.torch.walks import Stride, Tick, stride, tick

__all__ = [
    "Linear",
    "PassiveWalkerTorchEnv",
    "Rollout",
    "RolloutState",
    "StepRecorder",
    "Stride",
    "Tick",
    "initial_state",
    "left_out",
    "rollout",
    "stride",
    "tick",
]
