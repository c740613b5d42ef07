"""What acts on a walker."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import NDArray


class Policy(Protocol):
    """Whatever acts: stable-baselines3's algorithms, learned policies, baselines."""

    def predict(
        self,
        observation: NDArray,
        state: tuple[NDArray, ...] | None = None,
        episode_start: NDArray | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray, tuple[NDArray, ...] | None]:
        """Choose actions for a batch of observations."""
        ...
