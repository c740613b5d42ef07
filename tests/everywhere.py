"""Walks that have the same bytes on every CPU, and gaits, which are close.

    python -m tests.everywhere

prints a line for each: a digest of its bytes, or numbers. It takes what a wheel takes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import sha256

import gymnasium
import numpy as np

import gym_passive_walker as gpw
from gym_passive_walker.gaits.scenes.scene import SCENES as NAMED
from tests.conformance.scenes import SCENES
from tests.equations.examples import LONG_GAITS

STEPS = 60


def digest(*arrays: object) -> str:
    """Digest of the bytes of arrays of numbers.

    Raises:
        TypeError: if one has objects, of which the bytes are addresses.
    """
    found = sha256()
    for array in map(np.ascontiguousarray, arrays):
        if array.dtype.hasobject:
            raise TypeError("the bytes of objects are addresses")
        found.update(array.tobytes())
    return found.hexdigest()[:16]


def strides(name: str) -> str:
    """Digest of strides of a walker: steps, falls and wild states, one by one and together."""
    rng, gait = np.random.default_rng(0), LONG_GAITS[name]
    states = gait.state * (1.0 + 0.1 * rng.normal(size=(64, 6)))
    states[:, 1] = states[:, 2] = -states[:, 0]
    states[::7] = rng.normal(scale=3.0, size=states[::7].shape)
    walked = [gpw.stride(name, gait.slope, given) for given in (states, states[0])]
    return digest(*(x for of in walked for key, x in of._asdict().items() if key != "walker"))


def episodes(arguments: dict, count: int = 0) -> str:
    """Digest of what a scene's walkers observe and gain under random actions."""
    make = gymnasium.make_vec if count else gymnasium.make
    env = make("PassiveWalker-v0", **({"num_envs": count} if count else {}), **arguments)
    found = [env.reset(seed=5)[0]]
    env.action_space.seed(1)
    for _ in range(STEPS):
        *results, _ = env.step(env.action_space.sample())
        found += results
        if not count and (results[2] or results[3]):
            found.append(env.reset()[0])
    return digest(*found)


def each() -> Iterator[tuple[str, str | list[float]]]:
    """Yield names, and digests or numbers."""
    for name in gpw.WALKERS:
        yield f"strides of {name}", strides(name)
    for name in NAMED:
        yield f"64 walkers: {name}", episodes({"scene": name}, 64)
    for name, arguments in SCENES.items():
        alone = {key: value for key, value in arguments.items() if key not in ("walkers", "slopes")}
        yield f"a walker: {name}", episodes(alone)
    for name, gait in LONG_GAITS.items():
        found = gpw.find_gait(name, gait.slope)
        yield f"gait of {name}", [*found.state, *np.abs(found.multipliers)]


if __name__ == "__main__":
    for line in each():
        print(json.dumps(line), flush=True)
