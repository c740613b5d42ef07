"""Strides of a user's system on a device are those of the CPU."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker.devices import gpu
from tests.own.statements import PROGRESSIVE

SYSTEMS = [(TORSO, 0.03), (FIVE_LINKS, 0.05), (PROGRESSIVE, 0.03)]


@pytest.mark.parametrize(("system", "slope"), SYSTEMS, ids=[each.name for each, _ in SYSTEMS])
def test_strides_of_a_system_on_a_device_are_the_cpus(system, slope):
    rng, start = np.random.default_rng(0), np.array(system.start)
    states = start * (1.0 + 0.05 * rng.normal(size=(6, len(start))))
    there, usual = gpu.stride(system, slope, states), gpw.stride(system, slope, states)
    assert there.outcome.tolist() == usual.outcome.tolist()
    assert gpw.Outcome.HEELSTRIKE in usual.outcome
    for name in ("state", "duration", "step_length", "gravity_work", "friction_loss"):
        assert getattr(there, name).tobytes() == getattr(usual, name).tobytes()
