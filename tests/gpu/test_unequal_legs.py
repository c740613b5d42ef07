"""Walkers with unequal legs in environments on a GPU."""

import math

import gymnasium as gym
import numpy as np

from examples.unequal_legs import PROSTHESIS
from gym_passive_walker.devices.gpu.batch import DeviceBatch


def test_legs_exchange_at_each_heelstrike_as_on_a_cpu():
    """The second episode begins on the first leg, after a reset on the other."""
    given = {"system": PROSTHESIS, "slope": math.radians(3.0), "reset_noise_scale": 0.0}
    there = DeviceBatch(2, **given)
    here = gym.make("PassiveWalker-v0", **given, max_episode_steps=-1)
    for _ in range(2):
        there.reset()
        here.reset(seed=0)
        strides = 0
        while strides < 3:
            there.step()
            paid = here.step(np.zeros(1))[1]
            np.testing.assert_array_equal(np.asarray(there.arrays.rewards), paid)
            strides = int(there.arrays.ledger["strides"][0])
