"""Vectorized environments for trainers that use PyTorch tensors: rsl_rl, skrl, torchrl."""

from __future__ import annotations

from collections.abc import Iterable


def check_arguments(given: Iterable[str]) -> None:
    """Check the names of an environment's further arguments.

    Raises:
        ValueError: if "autoreset_mode" is among them.
    """
    if "autoreset_mode" in given:
        raise ValueError(
            "autoreset_mode is the one that the trainer expects: leave it out, or choose "
            "PassiveWalkerTorchEnv"
        )
