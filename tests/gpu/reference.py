"""A batch on the CPU with the random numbers of a GPU's."""

from types import SimpleNamespace

import numpy as np

from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.scenes.starts import DRAWS


class Drawn:
    """The random numbers of a walker on a GPU, as its generator gives them to a batch."""

    def __init__(self, key):
        self.key, self.episode = np.uint64(key), 0
        sequence = SimpleNamespace(entropy=key, spawn_key=())
        self.bit_generator = SimpleNamespace(seed_seq=sequence)

    def random(self, size):
        """Return the numbers of a start, which come first in an episode."""
        self.now = np.uint64(word(self.key, np.uint64(self.episode)))
        self.episode += 1
        return [uniform(self.now, k, 200) for k in range(size)]

    def integers(self, end, dtype):
        """Return the key of its disturbances."""
        return self.now


class Drawing(Batch):
    """A batch that draws its initial states from these generators."""

    starts_alike = False  # type: ignore[assignment]

    def drawn(self, where):
        """Return the numbers of each walker, (lanes, DRAWS)."""
        return np.array([self.randoms[i].random(DRAWS) for i in where])


class Reference:
    """Walkers on the CPU that start as on a GPU, and again where an episode ends."""

    def __init__(self, scene, count, seed, limit):
        self.batch = Drawing(make_scene(scene), count, step_limit=limit)
        self.batch.randoms = [Drawn(seed + i) for i in range(count)]  # type: ignore[assignment]
        self.observations = np.zeros((count, self.batch.observation_size), np.float32)
        self.batch.start(np.arange(count), self.observations.reshape(-1))

    def step(self, actions):
        """Return rewards, endings, last observations of episodes, and the ledger."""
        count = self.batch.count
        rewards, terminated, truncated = np.zeros(count), *np.zeros((2, count), bool)
        flat = self.observations.reshape(-1)
        self.batch.step(actions, flat, rewards, terminated, truncated)
        last, results = self.observations.copy(), self.batch.ledger.copy()
        if (terminated | truncated).any():
            self.batch.start(np.flatnonzero(terminated | truncated), flat)
        return rewards, terminated, truncated, last, results
