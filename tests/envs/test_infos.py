"""Infos of many walkers are made when someone looks, and are a dictionary like any other."""

import copy
import json
import pickle

import numpy as np
import pytest

from gym_passive_walker.envs import ticks
from gym_passive_walker.envs.batch import Batch
from gym_passive_walker.envs.infos import Infos
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.scenes.scene import Scene
from gym_passive_walker.gaits.scenes.starts import DRAWS

CONTENT = {"distance": 0.25, "strides": 3}

LOOKS = {
    "dict": dict,
    "a copy": lambda infos: infos.copy(),
    "copy.copy": copy.copy,
    "copy.deepcopy": copy.deepcopy,
    "pickle": lambda infos: pickle.loads(pickle.dumps(infos)),
    "json": lambda infos: json.loads(json.dumps(infos)),
    "double star": lambda infos: {**infos},
    "or": lambda infos: infos | {},
    "or from the right": lambda infos: {} | infos,
    "items": lambda infos: dict(infos.items()),
    "keys": lambda infos: {name: infos[name] for name in infos.keys()},
    "values": lambda infos: dict(zip(CONTENT, infos.values(), strict=True)),
    "iter": lambda infos: {name: infos.get(name) for name in infos},
    "reversed": lambda infos: {name: infos[name] for name in reversed(infos)},
    "update": lambda infos: (found := {}, found.update(infos))[0],
    "pop": lambda infos: {name: infos.pop(name) for name in CONTENT},
    "setdefault": lambda infos: {name: infos.setdefault(name, None) for name in CONTENT},
    "repr": lambda infos: eval(repr(infos)),
}


def lazy(make):
    """Infos that `make` returns when they are read."""
    infos = Infos(distance=0.25)
    infos.make = make
    return infos


def test_a_wrapper_may_make_another_of_converted_values():
    infos = lazy(lambda: CONTENT)
    converted = type(infos)(**{name: str(value) for name, value in infos.items()})
    assert converted == {"distance": "0.25", "strides": "3"}


@pytest.mark.parametrize("look", LOOKS)
def test_infos_are_filled_by_whichever_method_is_called_first(look):
    made = []
    infos = lazy(lambda: made.append(1) or CONTENT)
    assert isinstance(infos, dict) and not made
    assert LOOKS[look](infos) == CONTENT
    assert made == [1]


@pytest.mark.parametrize(
    "reported",
    [len, bool, lambda x: "strides" in x, lambda x: dict(CONTENT) == x, lambda x: x == CONTENT],
)
def test_it_is_never_taken_for_empty(reported):
    assert reported(lazy(lambda: CONTENT)) not in (False, 0, NotImplemented)


def test_what_is_written_first_is_not_lost():
    infos = lazy(lambda: CONTENT)
    infos["strides"], infos["episode"] = 4, "mine"
    assert infos == CONTENT | {"strides": 4, "episode": "mine"}


@pytest.mark.parametrize("kind", ["PCG64", "MT19937", "Philox", "SFC64"])
def test_compiled_code_draws_what_numpy_would(kind):
    def randoms():
        return [np.random.Generator(getattr(np.random, kind)(i)) for i in range(3)]

    batch, here = Batch(Scene(), 3), randoms()
    batch.randoms = randoms()
    for lanes in ([0, 1, 2], [2, 0], [1]):
        expected = [here[i].random(DRAWS) for i in lanes]
        np.testing.assert_array_equal(batch.drawn(np.array(lanes)), expected)
    later = pickle.loads(pickle.dumps(batch))  # elsewhere, and at the same place in the stream
    expected = [random.random(DRAWS) for random in here]
    np.testing.assert_array_equal(later.drawn(np.arange(3)), expected)


def test_a_walker_that_has_fallen_rests_until_the_next_episode():
    envs = PassiveWalkerVectorEnv(4, autoreset_mode="Disabled", reset_noise_scale=0.3)
    envs.reset(seed=0)
    ended = np.zeros(4, bool)
    while not ended.any():
        _, _, ended, *_ = envs.step(np.ones((4, 1)))
    batch, before = envs.batch, envs.batch.states[ended]
    results = np.empty(4 * batch.observation_size, np.float32), np.ones(4), *np.ones((2, 4), bool)
    batch.step(np.ones(4), *results)
    np.testing.assert_array_equal(batch.states[ended], before)
    assert not results[1][ended].any() and not results[2][ended].any()
    assert ticks.RESTING in batch.records["outcome"]
