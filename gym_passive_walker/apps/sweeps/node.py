"""Work that one process on each machine does for all: compilation, while the others wait."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np

from gym_passive_walker.engine.cache import cache_directory
from gym_passive_walker.engine.compiled import compiled
from gym_passive_walker.envs.constraints import hooks
from gym_passive_walker.envs.registration import ID
from gym_passive_walker.gaits.find.fixed_point import find_gait
from gym_passive_walker.models.equations.systems import SYSTEMS


@contextmanager
def locked(path: Path, *, wait: bool = True) -> Iterator[None]:
    """Hold an exclusive lock on a file, which is created if necessary.

    The operating system releases the lock when a process ends. On Windows there is no lock.

    Raises:
        BlockingIOError: if another process holds the lock and `wait` is False.
    """
    with path.open("a", encoding="utf-8") as file:
        try:
            import fcntl
        except ImportError:  # Windows: no lock
            pass
        else:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield


def compile_once() -> None:
    """Compile all equations and kernels, unless this machine has done so before."""
    folder = cache_directory()
    if folder is None or (folder / "swept").exists():
        return
    with locked(folder / "sweeping"):
        if not (folder / "swept").exists():
            for piece in pieces():
                piece()
            (folder / "swept").touch()


def pieces() -> Iterator[Callable[[], object]]:
    """Yield functions, each of which compiles a part of the package when called."""
    for name in SYSTEMS:
        yield partial(compiled, name)
        yield partial(compiled, name, derived=True)
        yield partial(compiled, name, derived=True, still=True)
        yield partial(hooks, name, pushed=True, watched=True)
    yield lambda: find_gait("C", 0.03)
    yield lambda: _act(gym.make_vec(ID, num_envs=2))
    yield lambda: _act(gym.make(ID))
    yield lambda: _act(gym.make(ID, action_delay=1))


def _act(world: gym.Env | gym.vector.VectorEnv) -> None:
    """Reset an environment, also with options, take one step, and close it."""
    world.reset(seed=0)
    world.reset(options={"slope": 0.0})
    world.step(np.zeros(world.action_space.shape))  # type: ignore[arg-type]
    world.close()
