"""Public names of `devices.gpu`: strides and environments on a CUDA GPU."""

from typing import TYPE_CHECKING, Any

from gym_passive_walker.devices.gpu import DeviceBatch, NoDevice, advance, stride

if TYPE_CHECKING:
    from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv

__all__ = ["DeviceBatch", "NoDevice", "PassiveWalkerGpuEnv", "advance", "stride"]


def __getattr__(name: str) -> Any:
    if name != "PassiveWalkerGpuEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gym_passive_walker.devices.gpu import environment  # needs torch

    return environment.PassiveWalkerGpuEnv
