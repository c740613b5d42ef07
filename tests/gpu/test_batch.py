"""Episodes on a device are those of the vector environment, for the same starts and keys."""

import time

import numpy as np
import pytest

from gym_passive_walker._tools import progress
from gym_passive_walker.devices.gpu import batch as device_batch
from gym_passive_walker.devices.gpu import device
from gym_passive_walker.devices.gpu.batch import DeviceBatch
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.views import Shape
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from gym_passive_walker.gaits.scenes.starts import Starts
from gym_passive_walker.models.model import bodies
from tests.envs.forms import COMPILED, function, plain_values, several
from tests.gpu.reference import Reference


def test_the_first_launch_says_what_is_compiled(monkeypatch, capfd):
    """A compilation for a GPU takes tens of seconds; later launches are silent."""

    def step_kernel(): ...

    class Kernel:
        py_func, overloads = step_kernel, {}

        def __getitem__(self, _):
            return lambda: (time.sleep(0.1), self.overloads.update({"types": None}))

    monkeypatch.setattr(device, "SIMULATED", False)
    monkeypatch.setattr(progress, "_UNSAID", 0.01)
    device.launch(Kernel(), 1)
    assert "compiles step_kernel for the GPU" in capfd.readouterr().err
    device.launch(Kernel(), 1)
    assert not capfd.readouterr().err


def same(found, known):
    """Whether numbers, of one kind, are the same to the last bit."""
    found = np.ascontiguousarray(found).view(np.ndarray)
    return found.tobytes() == np.ascontiguousarray(known, found.dtype).tobytes()


def rows(scene, count, *, seed=0, steps=20, limit=15):
    """Observations, rewards and endings of a batch over some steps by random actions."""
    there = DeviceBatch(count, scene, seed=seed, step_limit=limit)
    there.reset()
    random, found = np.random.default_rng(0).uniform(-1.2, 1.2, (steps, 50, 3)), []
    for actions in random:
        there.arrays.actions[:] = actions[seed : seed + count, : len(there.scene.actions)].T
        there.step()
        here = there.arrays
        results = here.shown.T, here.rewards, here.terminated
        found.append([np.array(part) for part in results])
    return found


def test_random_walkers_are_drawn_and_walk_as_they_would_alone(monkeypatch):
    monkeypatch.setattr(device_batch, "DRAWN", 16)
    scene = {
        "slope": 0.03,
        "domain_randomization": {"foot_radius": 0.2, "thigh_mass": 0.1},
        "observe_body": ("thigh_mass", "foot_radius"),
        "tick": 0.5,
    }
    there = DeviceBatch(6, scene, seed=3, step_limit=8)
    assert there.scene.randomization_pool == 16
    pool = [Starts(there.scene).randomization.member(k).walker for k in range(16)]
    here, random = Reference(there.scene, 6, 3, 8), np.random.default_rng(0)
    there.reset()
    for _ in range(10):
        actions = random.uniform(-1.0, 1.0, 6)
        there.arrays.actions[:] = actions
        there.step()
        assert same(there.arrays.rewards, here.step(actions)[0])
        assert same(there.arrays.shown.T, here.observations)
    assert len(np.unique(there.arrays.bodies[0])) > 3
    assert set(there.arrays.bodies[0]) <= set(bodies(*pool)[:, 0, 0])


DRAWN = {
    "foot_radius": 0.2,
    "thigh_mass, shank_mass": (0.8, 1.25),
    "max_hip_torque": {"log_uniform": (0.5, 2.0)},
    "action_delay": {"choices": (0, 1, 3), "operation": "abs"},
    "friction": {"uniform": (0.1, 0.5), "operation": "abs"},
    "reset_noise_scale": (0.1, 1.0),
    "slope": {"normal": (0.02, 0.005), "clip": (0.01, 0.03), "operation": "abs"},
}


@pytest.mark.parametrize("curriculum", [{}, {"curriculum": 3}], ids=["at once", "by and by"])
def test_draws_and_walks_are_those_of_the_cpu(curriculum, monkeypatch):
    """All draws but those of the random start; delay, friction and strength act in each step."""
    monkeypatch.setattr(device_batch, "DRAWN", 8)
    scene = {
        "domain_randomization": DRAWN | curriculum, "tick": 0.5, "start": (0.2,) + (-0.2,) * 5,
        "constraints": {"friction": "end"}, "action_noise": 0.1,
    }  # fmt: skip
    there = DeviceBatch(5, scene, seed=7, step_limit=4)
    here, random = Reference(there.scene, 5, 7, 4), np.random.default_rng(0)
    there.reset()
    found = []
    for _ in range(14):
        drawn = {name: x[there.arrays.drawn] for name, x in there.drawn.items()}
        found.append(drawn)
        for name, column in here.batch.randomized.info_values().items():
            assert np.array_equal(drawn[name], column), name
        actions = random.uniform(-1.0, 1.0, 5)
        there.arrays.actions[:] = actions
        there.step()
        assert same(there.arrays.rewards, here.step(actions)[0])
        assert same(there.arrays.shown.T, here.observations)
    for name in there.drawn:
        assert len(np.unique([each[name] for each in found])) > 1, name
    slipped = np.array([each["friction"] for each in found])
    if curriculum:  # the first episode is of the scene's own values
        assert np.all(slipped[0] == 0.8) and np.all(slipped[-1] <= 0.5)


def test_a_seed_draws_alike_on_every_device():
    scene = {"domain_randomization": DRAWN, "constraints": {"friction": "end"}}
    scene |= {"randomization_pool": 50}
    there = DeviceBatch(3, scene, seed=11)
    many, alone = PassiveWalkerVectorEnv(3, scene), PassiveWalkerEnv(scene)
    for episode in range(3):
        seed = {} if episode else {"seed": 11}
        there.reset()
        _, infos = many.reset(**seed)
        _, info = alone.reset(**seed)
        for name, known in there.drawn.items():
            drawn = known[there.arrays.drawn]
            assert np.array_equal(infos["randomized"][name], drawn)
            assert info["randomized"][name] == drawn[0]


def test_the_same_seed_is_the_same_walk_whatever_the_batch():
    scene = {"slope": 0.03, "tick": 0.6}
    together, part = rows(scene, 6), rows(scene, 2, seed=3)
    for all_of_them, some in zip(together, part, strict=True):
        for whole, own in zip(all_of_them, some, strict=True):
            np.testing.assert_array_equal(whole[3 : 3 + len(own)], own)


def test_a_walk_does_not_depend_on_the_blocks_of_threads(monkeypatch):
    """Threads of a block part its walkers by phase; the last block has a thread to spare."""
    scene = {"slope": 0.03, "tick": 0.6}
    apart = rows(scene, 7, steps=6)
    monkeypatch.setattr(device, "THREADS_IN_BLOCK", 4)
    for one, other in zip(apart, rows(scene, 7, steps=6), strict=True):
        assert all(map(same, one, other))


def test_the_second_kernel_steps_the_walkers_with_events_alone():
    there = DeviceBatch(5, {"slope": 0.03, "tick": 0.3}, step_limit=9)
    there.reset()
    steps, listed = there.arrays.ledger["steps"], []
    for k in range(12):
        before = steps.copy()
        there._launch(there._plain, 0)
        first, others, _ = there.arrays.counts
        over = np.zeros(5, bool)
        over[there.arrays.listed[[*range(first), *range(5 - others, 5)]]] = True
        assert (steps == before + ~over).all()
        listed.append(over)
        there._launch(there._events, 0)
        assert (steps[over] == 0 if k == 8 else steps == before + 1).all()
        assert not there.arrays.counts.any()
    assert listed[8].all()  # their episodes end
    assert 0 < np.sum(listed[:8]) < 40


def test_an_action_that_is_no_number_stops_its_walker_alone():
    there = DeviceBatch(3, "level")
    there.reset()
    there.arrays.actions[:] = [0.1, np.nan, 0.2]
    before, reported = there.arrays.shown.copy(), there.arrays.reported.words.copy()
    there.step()
    assert same(there.arrays.reported.words[:, 1], reported[:, 1])
    moved = (there.arrays.shown != before).any(axis=0)
    assert moved.tolist() == [True, False, True]
    assert np.isnan(there.arrays.rewards).tolist() == [False, True, False]
    there.arrays.actions[:] = 0.0
    there.step()
    assert there.arrays.ledger["steps"].tolist() == [2, 1, 2]


def test_a_step_moves_nothing_to_or_from_the_device(monkeypatch):
    there = DeviceBatch(4, "level")
    there.reset()
    there.step()

    def refuse(*_, **__):
        raise AssertionError("something is moved")

    for name in ("upload", "to_host", "write", "placed"):
        monkeypatch.setattr(device, name, refuse)
    there.step()
    assert there.arrays.ledger["steps"].tolist() == [2] * 4


def test_another_seed_is_another_walk():
    there = DeviceBatch(2, "level", seed=0)
    there.reset()
    first = there.arrays.shown.copy()
    there.reset()
    assert not same(there.arrays.shown, first)
    there.seed(0)
    there.reset()
    assert same(there.arrays.shown, first)
    there.seed(1)
    there.reset()
    assert same(there.arrays.shown[:, 0], first[:, 1])


def test_functions_of_ones_own_are_those_of_plain_python():
    """Every form, as an observation; a reward and a termination of conditions."""
    ends = function("(s.time > 0.35) * (s.steps != 2)")
    paid = function("s.distance - 5 * s.fell + 0.1 * ~s.heelstrike - (s.steps == 2)")
    scene = make_scene(observation=several(COMPILED), reward=paid, terminated=ends)
    there = DeviceBatch(2, scene)
    there.reset()
    over = np.zeros(2, bool)
    for k in range(5):
        there.arrays.actions[:] = [0.3, 0.9]
        there.step()
        seen, notes = np.array(there.arrays.numbers), there.arrays.notes.to_host()
        assert notes.shape == (2,)
        expected = plain_values(COMPILED, notes, Shape(1))
        np.testing.assert_allclose(seen, expected, rtol=1e-12, atol=1e-14)
        over = np.array(there.arrays.terminated)
        assert over.all() == (k == 3)
        if k < 3:
            found = plain_values(["s.distance + 0.1 * (not s.heelstrike) - (s.steps == 2)"], notes,
                                 Shape(1))  # fmt: skip
            np.testing.assert_allclose(there.arrays.rewards, found[:, 0], rtol=1e-12, atol=1e-14)


def test_a_function_that_cannot_be_compiled_is_refused():
    def slow(step):
        return float(np.asarray(step.distance).sum())

    with pytest.warns(UserWarning), pytest.raises(SceneError, match="reward cannot be compiled"):
        DeviceBatch(2, "level", reward=slow)
