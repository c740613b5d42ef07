"""How a policy acts in a vector environment."""

from __future__ import annotations

from itertools import islice

import gymnasium
import numpy as np

from gym_passive_walker.envs.evaluation.steps import steps


class Listener:
    """A policy that rests, and remembers which episodes it was said to be new."""

    def __init__(self) -> None:
        self.first: list[list[bool]] = []

    def predict(self, observations, state=None, episode_start=None, deterministic=False):
        """No torque; the state counts the calls."""
        self.first.append(np.array(episode_start).tolist())
        assert deterministic and state == (None if len(self.first) == 1 else len(self.first) - 1)
        return np.zeros((len(observations), 1), np.float32), len(self.first)


def test_a_policy_hears_of_each_episode_that_begins():
    """After a fall as after the time limit; and gets back what it remembers."""
    for limit, options in ((3, {}), (-1, {"slope": 0.1})):
        envs = gymnasium.make_vec("PassiveWalker-v0", 4, max_episode_steps=limit, **options)
        listener = Listener()
        observations, _ = envs.reset(seed=0)
        made = [*islice(steps(listener, envs, observations), 60)]
        over = [step.terminated | step.truncated for step in made]
        assert any(step.truncated.any() for step in made) == (limit == 3)
        assert limit == 3 or any(step.terminated.any() for step in made)
        expected = [np.ones(4, bool), *over[:-1]]
        assert listener.first == [each.tolist() for each in expected]
