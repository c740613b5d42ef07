"""The command that compiles everything ahead, so that nothing else ever waits for it."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator
from functools import partial

import gymnasium as gym
import numpy as np

from gym_passive_walker.cli.report import Report
from gym_passive_walker.engine.compiled import compiled
from gym_passive_walker.envs.reality import natives
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.physics.systems import SYSTEMS
from gym_passive_walker.progress import progress


def warmup(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Compile everything that walks, once; from then on every start is a quick one.

    passive-walker warmup
    """

    def run(_: Namespace) -> Report:
        begun, pieces = time.monotonic(), list(_pieces())
        with progress("pieces compiled", len(pieces)) as compiled_one:
            for compile_it in pieces:
                compile_it()
                compiled_one()
        took = time.monotonic() - begun
        return Report(f"everything is compiled, after {took:.1f} s", {"seconds": took})

    return run


def _pieces() -> Iterator[Callable[[], object]]:
    """All that is compiled, as what compiles it."""
    for name in SYSTEMS:
        yield partial(compiled, name)
        yield partial(compiled, name, derived=True)
        yield partial(natives, name, pushed=True, watched=True)
    yield lambda: find_gait("C", 0.03)
    yield lambda: _act(gym.make_vec(ID, num_envs=2))
    yield lambda: _act(gym.make(ID))
    yield lambda: _act(gym.make(ID, motor_delay=1))


def _act(world: gym.Env | gym.vector.VectorEnv) -> None:
    """A step of an environment."""
    world.reset(seed=0)
    world.step(np.zeros(world.action_space.shape))  # type: ignore[arg-type]
    world.close()
