"""Domain randomization of a batch: the draws of each walker's episode.

The key of an episode is a function of the walker's seed and of the number of episodes since it was
seeded, as on a GPU. Equal seeds therefore have equal draws in all environments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.engine.counter_rng import word
from gym_passive_walker.engine.layout import WIDE
from gym_passive_walker.envs import saved
from gym_passive_walker.envs.memory import COUNTER
from gym_passive_walker.envs.saved import ROUNDING
from gym_passive_walker.gaits.scenes.randomization import (
    DELAY,
    FRICTION,
    NOISE,
    SCENE_PARAMETERS,
    SLOPE,
)
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.models.walkers import Walker

SETTLED = np.dtype([
    ("slope", "f8"),  # in rad; NaN if it is not drawn
    ("noise", "f8"),  # reset_noise_scale over its largest value
    ("delay", "i8"),  # in control steps
    ("friction", "f8"),
    ("strength", "f8", (WIDE.controls + 1,)),  # of each action, over its largest value
])  # fmt: skip
"""What an episode draws besides its walker, as kernels read it."""


def settled(scene: Scene, names: Sequence[str], values: NDArray[np.float64]) -> NDArray:
    """Return drawn values in the form of kernels, (n,) of SETTLED.

    Args:
        scene: The scene.
        names: Names of the drawn parameters.
        values: Values, (n, names).
    """
    column = dict(zip(names, values.T, strict=True))
    found = np.zeros(len(values), SETTLED)
    found["slope"] = column.get(SLOPE, np.nan)
    largest = scene.ends(NOISE)[1]
    found["noise"] = column[NOISE] / largest if NOISE in column else 1.0
    found["delay"] = column.get(DELAY, scene.action_delay)
    found["friction"] = column.get(FRICTION, scene.friction)
    found["strength"] = 1.0
    for i, name in enumerate(scene.actions):
        limit: Any = scene.actuator(name).limit
        if limit in column:
            found["strength"][:, i] = column[limit] / scene.ends(limit)[1]
    return found


class Randomized:
    """The draws of walkers in a scene with `domain_randomization`.

    Args:
        starts: Starts of each walker in a scene with it, (count,).

    Attributes:
        names: Names of the drawn parameters.
        keys: Seed of each walker, (count,).
        episodes: Number of episodes with draws that each walker has begun since it was seeded,
            (count,).
        values: Drawn values of each walker's episode, (count, names).
        low: Smallest value of each walker's parameters, (count, names).
        high: Largest value of each walker's parameters, (count, names).
    """

    def __init__(self, starts: Sequence[Starts]) -> None:
        self._of = [drawing for each in starts if (drawing := each.randomization)]
        self.names: tuple[str, ...] = self._of[0].names
        count = len(starts)
        self.keys, self.episodes = np.zeros(count, np.uint64), np.zeros(count, np.int64)
        self.values = np.zeros((count, len(self.names)))
        each = [[of.ends(name) for name in self.names] for of in self._of]
        ends = np.array(each, dtype=float).reshape(*self.values.shape, 2)
        self.low, self.high = ends[..., 0], ends[..., 1]
        self._seeded: list[np.random.Generator | None] = [None] * count

    def draw(
        self,
        lanes: NDArray[np.int64],
        randoms: Sequence[np.random.Generator],
        slopes: NDArray[np.float64] | None,
    ) -> tuple[list[Walker], NDArray[np.float64]]:
        """Return the walkers and the values (lanes, names) of some walkers' next episodes.

        Slopes (count,) that a reset has been given replace those that are drawn.
        """
        walkers, values = [], np.empty((len(lanes), len(self.names)))
        for j, i in enumerate(lanes.tolist()):
            if randoms[i] is not self._seeded[i]:
                self._seeded[i] = randoms[i]
                self.keys[i], self.episodes[i] = _seed_of(randoms[i]), 0
            episode = int(self.episodes[i])
            drawn = self._of[i].drawn(word(int(self.keys[i]), episode), episode)
            values[j] = drawn.values
            walkers.append(drawn.walker)
        if slopes is not None and SLOPE in self.names:
            values[:, self.names.index(SLOPE)] = slopes[lanes]
        return walkers, values

    def begin(self, lanes: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """Begin the episodes of some walkers with values that `draw` has returned."""
        self.values[lanes] = values
        self.episodes[lanes] += 1

    def follow(self, before: Randomized | None) -> None:
        """Go on counting the episodes of a batch in another scene."""
        if before is not None:
            self.keys, self.episodes = before.keys, before.episodes
            self._seeded = before._seeded

    def info_values(self) -> dict[str, NDArray[np.float64]]:
        """Return copies of the drawn values by name, each (count,)."""
        return {name: column.copy() for name, column in zip(self.names, self.values.T, strict=True)}

    @property
    def scaled(self) -> NDArray[np.float64]:
        """Values from -1 at the smallest to 1 at the largest, (count, names); 0 if there is one."""
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        off = (self.values - middle) / np.where(half > 0.0, half, 1.0)
        return np.clip(off, -1.0, 1.0)

    @property
    def saved_arrays(self) -> dict[str, NDArray]:
        """Arrays of a saved state, by name."""
        return {"draw_keys": self.keys, "draw_episodes": self.episodes, "draws": self.values}

    def check(self, found: Mapping[str, NDArray], *, begun: bool) -> None:
        """Check the arrays of a state, by their names in `saved_arrays`; see `saved`."""
        counts, values, low, high = found["draw_episodes"], found["draws"], self.low, self.high
        if SLOPE in self.names:  # a reset may have been given another one
            (_, least, most), given = SCENE_PARAMETERS[SLOPE], np.array(self.names) == SLOPE
            low, high = np.where(given, least, low), np.where(given, most, high)
        fits = (COUNTER[0] <= counts) & (counts <= COUNTER[1])
        saved.require("draw_episodes", fits, f"from {COUNTER[0]} to {COUNTER[1]}")
        room = ROUNDING * np.maximum(np.abs(low), np.abs(high))
        fits = (low - room <= values) & (values <= high + room) | (not begun)
        saved.require("draws", fits, "values that domain_randomization draws")

    def put_back(self, randoms: Sequence[np.random.Generator]) -> None:
        """Keep the seeds of a state that has been put back, with its generators, if it has any."""
        seeded = (self.keys != 0) | (self.episodes != 0)
        self._seeded = [r if has else None for r, has in zip(randoms, seeded, strict=True)]


def _seed_of(random: np.random.Generator) -> int:
    """Return the seed of a generator, 64 bits: the number that the user gave, if it is one."""
    sequence: Any = random.bit_generator.seed_seq
    if isinstance(sequence.entropy, int | np.integer) and not sequence.spawn_key:
        return int(sequence.entropy) % 2**64
    return int(sequence.generate_state(1, np.uint64)[0])
