"""Episodes on a device are those of the vector environment, for the same starts and keys."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.engine.counter_rng import uniform, word
from gym_passive_walker.envs import task
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.scene import SceneError, make_scene
from gym_passive_walker.envs.starts import DRAWS, Starts
from gym_passive_walker.gpu import batch as device_batch
from gym_passive_walker.gpu import device
from gym_passive_walker.gpu.batch import DeviceBatch
from gym_passive_walker.physics.systems import bodies


def own_reward(step):
    """Speed close to 0.15, smooth actions, a small charge."""
    change = (step.action[0] - step.last_action[0]) ** 2
    speed = step.distance / step.duration
    return gpw.math.exp(-((speed - 0.15) ** 2) / 0.01) - 0.1 * change - step.hip_work_absolute


def own_observation(step):
    """Swing leg, its rate before and after, the command and the last push."""
    state = step.state
    rates = step.before.thigh_rate, gpw.math.tanh(state.thigh_rate)
    return state.thigh - state.stance, *rates, step.command, step.push, step.steps


def too_fast(step):
    """A limit of the stance leg's angular velocity."""
    return abs(step.state.stance_rate) > 0.45


OWN = {"reward": own_reward, "observation": own_observation, "terminated": too_fast}
SCENES = {
    "own functions": {**OWN, "tick": 0.4},
    "own functions, pushed": {
        **OWN, "pushes": {"rate": 0.5, "impulse": (-0.05, 0.05)}, "command": (0.1, 0.2),
    },
    "own reward alone": {"reward": {"distance": 1.0, "energy": -2.0, "alive": 0.1}},
    "level": {},
    "one torque a stride": {"slope": 0.11, "control": "stride"},
    "random slopes": {"slope": (0.0, 0.06), "tick": 0.4},
    "all channels": {
        "walker": "E", "slope": 0.02, "actions": ("hip", "push_off"), "tick": 0.5,
        "energy": "positive",
    },
    "simplest": {"walker": "D", "slope": 0.009, "actions": ("push_off", "ankle"), "tick": 0.7},
    "rough ground": {
        "slope": 0.03, "terrain": {"rough": {"height_std": 0.003, "slope_std": 0.01}},
        "terrain_lookahead": 2, "tick": 0.5,
    },
    "pushes": {"pushes": {"rate": 0.5, "impulse": (-0.05, 0.05)}, "tick": 0.5},
    "everything": {
        "slope": (0.01, 0.06), "terrain": {"stairs": {"rise": -0.002}}, "tick": 0.3,
        "terrain_lookahead": 1,
        "pushes": {"rate": 0.5, "impulse": (-0.05, 0.05)}, "observation_noise": 0.01,
        "action_noise": 0.1, "action_delay": 2, "command": (0.1, 0.2),
        "constraints": {"friction": "end", "contact": "report", "knee lock": "report"},
    },
}  # fmt: skip


class Drawn:
    """A device's random numbers as a walker's generator gives them to the vector environment."""

    def __init__(self, key):
        self.key, self.episode = np.uint64(key), 0

    def random(self, size):
        """What a start takes, which comes first in an episode."""
        self.now = np.uint64(word(self.key, np.uint64(self.episode)))
        self.episode += 1
        return [uniform(self.now, k, 200) for k in range(size)]

    def integers(self, end, dtype):
        """The key of its disturbance."""
        return self.now


class Drawing(Batch):
    """A batch that draws its initial states from these generators."""

    starts_alike = False  # type: ignore[assignment]

    def drawn(self, where):
        """What they take of each walker, (lanes, DRAWS)."""
        return np.array([self.randoms[i].random(DRAWS) for i in where])


class Reference:
    """The processor's walkers, that start as a device's do, and again where an episode ends."""

    def __init__(self, scene, count, seed, limit):
        self.batch = Drawing(make_scene(scene), count, step_limit=limit)
        self.batch.randoms = [Drawn(seed + i) for i in range(count)]  # type: ignore[assignment]
        self.observations = np.zeros((count, self.batch.observation_size), np.float32)
        self.batch.start(np.arange(count), self.observations.reshape(-1))

    def step(self, actions):
        """Rewards, endings, and observations before others begin."""
        count = self.batch.count
        rewards, terminated, truncated = np.zeros(count), *np.zeros((2, count), bool)
        flat = self.observations.reshape(-1)
        self.batch.step(actions, flat, rewards, terminated, truncated)
        last, results = self.observations.copy(), self.batch.ledger.copy()
        if (terminated | truncated).any():
            self.batch.start(np.flatnonzero(terminated | truncated), flat)
        return rewards, terminated, truncated, last, results


def same(found, known):
    """Whether numbers, of one kind, are the same to the last bit."""
    found = np.asarray(found).view(np.ndarray)
    return found.tobytes() == np.ascontiguousarray(known, found.dtype).tobytes()


def rows(scene, count, *, seed=0, steps=20, limit=15):
    """Observations, rewards and endings of a batch over some steps by random actions."""
    there = DeviceBatch(count, scene, seed=seed, step_limit=limit)
    there.reset()
    random, found = np.random.default_rng(0).uniform(-1.2, 1.2, (steps, 50, 3)), []
    for actions in random:
        there.play.actions[:] = actions[seed : seed + count, : len(there.scene.actions)].ravel()
        there.step()
        play = there.play
        results = play.observations.reshape(count, -1), play.rewards, play.terminated
        found.append([np.array(part) for part in results])
    return found


@pytest.mark.parametrize("name", SCENES)
def test_an_episode_on_a_device_is_the_vector_environments(name):
    scene, count = SCENES[name], 5
    there, here = DeviceBatch(count, scene, seed=7, step_limit=12), Reference(scene, count, 7, 12)
    there.reset()
    assert same(there.play.observations, here.observations)
    random, endings = np.random.default_rng(0), 0
    for _ in range(25):
        actions = random.uniform(-1.2, 1.2, len(there.play.actions))
        there.play.actions[:] = actions
        there.step()
        rewards, terminated, truncated, last, results = here.step(actions)
        assert same(there.play.rewards, rewards)
        assert same(there.play.terminated, terminated)
        assert same(there.play.truncated, truncated)
        assert same(there.play.last, last)
        assert same(there.play.observations, here.observations)
        assert same(there.walkers.reported, results)
        endings += np.sum(terminated | truncated)
    assert endings >= count
    assert there.walkers.episodes.sum() == count + endings


def test_random_walkers_are_drawn_and_walk_as_they_would_alone(monkeypatch):
    monkeypatch.setattr(device_batch, "DRAWN", 16)
    scene = {
        "slope": 0.03,
        "domain_randomization": {"foot_radius": 0.2, "hip_mass": 0.1},
        "tick": 0.5,
    }
    there = DeviceBatch(6, scene, seed=3, step_limit=8)
    starts, random = Starts(make_scene(scene)), np.random.default_rng(0)
    drawn = [starts.varied(random) for _ in range(16)]

    def varied(self, own):
        return drawn[int(uniform(own.now, 0, 201) * 16)]

    monkeypatch.setattr(Starts, "varied", varied)
    here = Reference(scene, 6, 3, 8)
    there.reset()
    for _ in range(10):
        actions = random.uniform(-1.0, 1.0, 6)
        there.play.actions[:] = actions
        there.step()
        assert same(there.play.rewards, here.step(actions)[0])
    assert len(np.unique(there.walkers.bodies[:, 0, 0])) > 3
    assert set(there.walkers.bodies[:, 0, 0]) <= set(bodies(*drawn)[:, 0, 0])


def test_the_same_seed_is_the_same_walk_whatever_the_batch():
    scene = {"slope": 0.03, "tick": 0.6}
    together, part = rows(scene, 6), rows(scene, 2, seed=3)
    for all_of_them, some in zip(together, part, strict=True):
        for whole, own in zip(all_of_them, some, strict=True):
            np.testing.assert_array_equal(whole[3 : 3 + len(own)], own)


def test_an_action_that_is_no_number_stops_its_walker_alone():
    there = DeviceBatch(3, "level")
    there.reset()
    there.play.actions[:] = [0.1, np.nan, 0.2]
    before = there.play.observations.copy()
    there.step()
    moved = (there.play.observations != before).reshape(3, -1).any(axis=1)
    assert moved.tolist() == [True, False, True]
    assert np.isnan(there.play.rewards).tolist() == [False, True, False]
    there.play.actions[:] = 0.0
    there.step()
    assert there.walkers.ledger["steps"].tolist() == [2, 1, 2]


def test_a_step_moves_nothing_to_or_from_the_device(monkeypatch):
    there = DeviceBatch(4, "level")
    there.reset()
    there.step()

    def refuse(*_, **__):
        raise AssertionError("something is moved")

    for name in ("put", "back", "room"):
        monkeypatch.setattr(device, name, refuse)
    there.step()
    assert there.walkers.ledger["steps"].tolist() == [2] * 4


def test_another_seed_is_another_walk():
    there = DeviceBatch(2, "level", seed=0)
    there.reset()
    first = there.play.observations.copy()
    there.reset()
    assert not same(there.play.observations, first)
    there.seed(0)
    there.reset()
    assert same(there.play.observations, first)
    there.seed(1)
    there.reset()
    assert same(there.play.observations[: task.SIZE], first[task.SIZE :])


def test_a_function_that_cannot_be_compiled_is_refused():
    def slow(step):
        return float(np.asarray(step.distance).sum())

    with pytest.warns(UserWarning), pytest.raises(SceneError, match="reward cannot be compiled"):
        DeviceBatch(2, "level", reward=slow)
