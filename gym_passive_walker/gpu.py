"""Door to `devices.gpu`: strides and environments on a CUDA GPU."""

from typing import Any

from gym_passive_walker.devices.gpu import DeviceBatch, NoDevice, advance, stride

__all__ = ["DeviceBatch", "NoDevice", "PassiveWalkerGpuEnv", "advance", "stride"]  # noqa: F822


def __getattr__(name: str) -> Any:
    if name != "PassiveWalkerGpuEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gym_passive_walker.devices.gpu.environment import PassiveWalkerGpuEnv  # needs torch

    return PassiveWalkerGpuEnv
