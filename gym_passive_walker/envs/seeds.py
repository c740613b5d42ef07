"""Seeds of the environments of a training."""

from __future__ import annotations

import numpy as np

from gym_passive_walker._tools.arguments import seed_number


def training_seeds(seed: int | None, count: int) -> list[int] | None:
    """Return a seed for each environment of a training.

    A vector environment with `seed` has the seeds seed, seed + 1, ..., so those of trainings with
    the seeds 1 and 2 would be nearly equal. These are drawn instead, from 2^63 on. Evaluations have
    small seeds, so no training meets their episodes.

    Args:
        seed: Seed of the training; None seeds no environment.
        count: Number of environments. The first ones have equal seeds for any number.

    Raises:
        ValueError: if the seed is not a whole number from 0 on.
    """
    if seed is None:
        return None
    drawn = np.random.SeedSequence(seed_number(seed)).generate_state(count, np.uint64)
    return (drawn | np.uint64(2**63)).tolist()
