"""Objects of other libraries are recognized by their origin, not by a name that others may have."""

import sys
from types import ModuleType

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.engine.device_linker import python_function
from gym_passive_walker.models import math

ELEMENTARY = ("exp", "tanh", "sqrt", "sin", "cos")


class Mine(np.ndarray):
    """An array of a class in a user's module, with a name that begins as torch's."""

    __module__ = "torch_utils"


@pytest.mark.parametrize("name", ELEMENTARY)
@pytest.mark.parametrize("loaded", [False, True])
def test_an_array_of_a_module_named_like_torch_is_one_of_numpy(name, loaded, monkeypatch):
    if not loaded:
        monkeypatch.delitem(sys.modules, "torch", raising=False)
    else:
        monkeypatch.setitem(sys.modules, "torch", ModuleType("torch"))  # a user's own one
    x = np.array([0.5, 0.75])
    found = getattr(math, name)(x.view(Mine))
    np.testing.assert_array_equal(np.asarray(found), getattr(np, name)(x))
    chosen = math.where(x.view(Mine) > 0.6, 1.0, 0.0)
    np.testing.assert_array_equal(np.asarray(chosen), [0.0, 1.0])


@pytest.mark.parametrize("name", ELEMENTARY)
def test_a_tensor_of_a_user_s_class_is_one_of_torch(name):
    torch = pytest.importorskip("torch")

    class Kept(torch.Tensor):
        """A tensor of a user's class."""

    x = torch.tensor([0.5, 0.75], dtype=torch.float64)
    found = getattr(math, name)(x.as_subclass(Kept))
    assert isinstance(found, Kept) and torch.equal(found.as_subclass(torch.Tensor),
                                                   getattr(torch, name)(x))  # fmt: skip


def test_a_function_of_a_module_named_like_the_package_is_not_the_package_s():
    def mine():
        """A function of a user's."""

    for module, ours in (
        ("gym_passive_walker.models.math", True),
        ("gym_passive_walker_mine", False),
    ):
        mine.__module__ = module
        assert (python_function(mine) is mine) == ours


def test_a_controller_s_attributes_are_not_taken_for_methods_of_the_package():
    torch = pytest.importorskip("torch")

    class Own(torch.nn.Module):  # which has a method `double`
        """A controller with a plan of its own."""

        plan = "the fastest"
        seen = None

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            self.seen = observation.dtype
            return np.zeros((len(observation), 1)), None

    own = Own()
    strides = gpw.stride_map(controller=own, scene="steep")
    gait = gpw.find_gait(gpw.WALKERS["C"], 0.0361)
    strides.apply(strides.points_at(gait.state), 0.0361)
    assert own.seen == np.float32
