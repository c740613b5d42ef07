"""Threads that share the steps of a batch."""

from __future__ import annotations

import gc
import os
import pickle
import subprocess
import sys
import threading
import weakref

import numpy as np
import pytest

from gym_passive_walker.engine import team
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv

COUNT = 1100
ACTIONS = np.random.default_rng(1).uniform(-1.0, 1.0, (20, COUNT, 1)).astype(np.float32)


def begun(threads, **changes):
    """A batch after its reset."""
    envs = PassiveWalkerVectorEnv(COUNT, threads=threads, **changes)
    envs.reset(seed=0)
    return envs


def walked(envs, pause=lambda: None):
    """Bytes of what twenty steps return."""
    found = []
    for actions in ACTIONS:
        pause()
        *arrays, infos = envs.step(actions)
        arrays += [infos[name] for name in ("distance", "strides", "step_period")]
        found += [array.tobytes() for array in arrays]
    return found


@pytest.fixture(scope="module")
def alone():
    """The walks of one thread."""
    return walked(begun(1))


def test_walks_on_threads_that_wait_or_sleep_are_those_of_one_thread(alone):
    for pause in (lambda: None, lambda: threading.Event().wait(0.005)):
        assert walked(begun(3), pause) == alone


def test_walks_without_the_threads_that_were_asked_are_the_same(alone, monkeypatch):
    monkeypatch.setattr(team._Team, "gather", lambda *given: None)
    assert walked(begun(2)) == alone


def test_where_no_more_threads_may_start_a_batch_walks_on_one(alone, monkeypatch):
    def refused():
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(team, "_Helper", refused)
    monkeypatch.setattr(team, "_TEAM", team._Team())
    assert walked(begun(2)) == alone


def test_batches_that_step_by_turns_and_at_once_do_not_mix(alone):
    first, second = begun(2), begun(2)
    for _ in range(2):
        for envs in (first, second):
            envs.reset(seed=0)
        pairs = [(first.step(x)[0].tobytes(), second.step(x)[0].tobytes()) for x in ACTIONS]
        assert all(a == b for a, b in pairs)
    found = {}
    works = [threading.Thread(target=lambda i=i: found.update({i: walked(begun(2))}))
             for i in range(3)]  # fmt: skip
    for each in works:
        each.start()
    for each in works:
        each.join()
    assert all(found[i] == alone for i in range(3))


def test_an_action_that_is_no_number_is_refused_before_any_walker_steps(alone):
    envs = begun(2)
    wrong = ACTIONS[0].copy()
    wrong[-1] = np.nan
    with pytest.raises(ValueError, match=f"environment {COUNT - 1}"):
        envs.step(wrong)
    assert walked(envs) == alone


def test_a_batch_that_nobody_has_is_freed():
    envs = begun(2)
    walked(envs)
    place = weakref.ref(envs.batch.entry_point)
    del envs
    for _ in range(200):  # the other thread looks for another step meanwhile, long on a busy CPU
        if place() is None:
            return
        threading.Event().wait(0.05)
        gc.collect()
    pytest.fail("the batch is still there")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system copies no processes")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded")
def test_a_copy_of_the_process_has_threads_of_its_own(alone):
    envs = begun(2)
    walked(envs)
    envs.reset(seed=0)
    reads, writes = os.pipe()
    if not (child := os.fork()):
        with os.fdopen(writes, "wb") as file:
            pickle.dump(walked(envs), file)
        os._exit(0)
    os.close(writes)
    with os.fdopen(reads, "rb") as file:
        found = pickle.load(file)
    os.waitpid(child, 0)
    assert found == alone == walked(envs)


def test_walkers_step_on_alone_when_the_threads_have_ended(alone, monkeypatch):
    crew = team._Team()
    monkeypatch.setattr(team, "_TEAM", crew)
    envs = begun(2)
    walked(envs)
    crew.end()
    assert not any(helper.is_alive() for helper in crew._helpers)
    envs.reset(seed=0)
    assert walked(envs) == alone
    assert crew._helpers[0]._work is team._nothing  # else a thread that is to end may wait again


def test_a_program_ends_while_threads_wait():
    code = (
        "import gymnasium, numpy, gym_passive_walker\n"
        f"envs = gymnasium.make_vec('PassiveWalker-v0', num_envs={COUNT}, threads=4)\n"
        "envs.reset(seed=0)\n"
        f"envs.step(numpy.zeros(({COUNT}, 1), numpy.float32))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], timeout=60, capture_output=True)
    assert done.returncode == 0 and not done.stderr
