"""Seeds of the environments of trainings."""

from __future__ import annotations

import pytest

from gym_passive_walker.envs.seeds import training_seeds


def test_environments_of_all_trainings_have_other_seeds():
    found = [seed for training in range(300) for seed in training_seeds(training, 128)]
    assert len({*found}) == len(found) == 300 * 128
    assert min(found) >= 2**63 > 1000 + 100  # those of evaluations are small
    assert max(found) < 2**64


def test_the_same_training_has_the_same_seeds_and_more_environments_have_them_too():
    assert training_seeds(3, 64) == training_seeds(3, 64) == training_seeds(3, 100)[:64]
    assert training_seeds(None, 64) is None
    assert training_seeds(2**128 - 1, 2) != training_seeds(2**128 - 2, 2)


@pytest.mark.parametrize("wrong", [-1, 0.5, "1", 2**128, True])
def test_a_seed_that_is_none_is_refused(wrong):
    with pytest.raises(ValueError, match="seed"):
        training_seeds(wrong, 3)
