"""Functions, torch modules and objects act in every analysis that takes a controller."""

import sys

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.control.controllers import acting
from gym_passive_walker.gaits.control.policy import FunctionPolicy, ModulePolicy, is_module

SCENE = {"slope": 0.11, "control": "stride"}
ROWS = np.array([-0.2, 0.1, 0.0, -0.3, 0.05, 0.0, 0.0, 1.0])


def linear(observation):
    return observation @ ROWS[:, None]


class Linear:
    """The same as an object."""

    name = "linear"

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Its actions."""
        return linear(np.asarray(observation)), state


def module(dtype="float32", size=8):
    torch = pytest.importorskip("torch")
    layer = torch.nn.Linear(size, 1, bias=False).to(getattr(torch, dtype))
    with torch.no_grad():
        layer.weight.copy_(torch.tensor(ROWS[:size])[None])
    return torch.nn.Sequential(layer)


FORMS = {"function": lambda: linear, "object": Linear, "torch module": module}


@pytest.fixture(scope="module")
def expected():
    return gpw.gauntlet(linear, SCENE, walkers=3), gpw.stride_map(controller=linear, scene=SCENE)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_acts_alike_everywhere(form, expected):
    score, strides = expected
    controller = FORMS[form]()
    found = gpw.gauntlet(controller, SCENE, walkers=3)
    assert found.episodes["own scene"].distance == pytest.approx(
        score.episodes["own scene"].distance, rel=1e-4
    )
    assert 0.0 < np.mean(found.episodes["own scene"].distance)
    own = gpw.stride_map(controller=controller, scene=SCENE)
    point = own.points_at(gpw.find_gait("C", 0.11).state)
    assert own.apply(point).ends == pytest.approx(strides.apply(point).ends, abs=1e-5)
    (_, change), (_, known) = own.linearize(point), strides.linearize(point)
    assert change.ends == pytest.approx(known.ends, abs=5e-3)
    walk = gpw.simulate(own, None, own.state(point)[0], strides=2)
    assert walk.columns()["stance_angle"].size > 0
    with pytest.raises(ValueError, match="say in which scene"):
        gpw.gauntlet(controller)


def test_robustness_takes_a_function_of_the_observation():
    steep = gpw.load_policy("steep-sac")

    def imitate(observation):
        return steep.predict(observation)[0]

    options = dict(walkers=8, strides=5, starts=8)
    found, own = (gpw.robustness(which, "steep", **options) for which in (imitate, "steep-sac"))
    assert found.controller == "imitate"
    assert found.step_length == pytest.approx(own.step_length, abs=1e-4)
    np.testing.assert_array_equal(found.survivors, own.survivors)


def test_a_module_s_map_has_exact_derivatives_in_double_precision():
    torch = pytest.importorskip("torch")
    layers = torch.nn.Linear(8, 6), torch.nn.Tanh(), torch.nn.Dropout(0.5), torch.nn.Linear(6, 2)
    torch.manual_seed(0)
    net = torch.nn.Sequential(*layers)
    policy, seen = ModulePolicy(net), np.random.default_rng(0).normal(size=(5, 8))
    actions, change = policy.linearize(seen)
    assert actions.shape == (5, 2) and change.shape == (5, 2, 8)
    assert np.array_equal(actions, policy.mean_actions(seen))
    assert policy.predict(seen)[0] == pytest.approx(actions, abs=1e-6)
    step = 1e-6
    for i in range(8):
        way = step * np.eye(8)[i]
        ends = [policy.mean_actions(seen + sign * way) for sign in (1.0, -1.0)]
        assert (ends[0] - ends[1]) / (2.0 * step) == pytest.approx(change[:, :, i], abs=1e-8)
    # The user's own module has not changed.
    assert net.training and all(x.requires_grad for x in net.parameters())
    assert policy.predict(seen[0])[0].shape == (2,)
    constant = torch.nn.Sequential(torch.nn.Linear(8, 1))
    with torch.no_grad():
        constant[0].weight.zero_()
    assert not ModulePolicy(constant).linearize(seen)[1].any()


def test_modules_that_cannot_act_are_refused():
    torch = pytest.importorskip("torch")
    with pytest.raises(ValueError, match=r"module Sequential does not take .*\(64, 8\)"):
        gpw.gauntlet(module(size=7), SCENE)
    flat, pair = torch.nn.Flatten(0), torch.nn.LSTM(8, 1)
    for net, words in ((flat, r"not \(16,\)"), (pair, r"not \(tensor")):
        with pytest.raises(ValueError, match=rf"must return a tensor of actions.*{words}"):
            ModulePolicy(net).predict(np.zeros((2, 8)))
    with pytest.raises(ValueError, match=r"must return actions of shape \(1, 1\)"):
        strides = gpw.stride_map(controller=torch.nn.Linear(8, 2), scene=SCENE)
        strides.apply(strides.points_at(gpw.find_gait("C", 0.11).state))


def test_a_module_may_have_any_precision_or_no_parameters():
    torch = pytest.importorskip("torch")
    seen = np.random.default_rng(0).normal(size=(4, 8)).astype(np.float32)
    for dtype in ("float32", "float64"):
        actions, _ = ModulePolicy(module(dtype)).predict(seen)
        assert actions.dtype == np.float32
        assert actions == pytest.approx(linear(seen), abs=1e-6)
    assert ModulePolicy(torch.nn.Tanh()).predict(seen)[0] == pytest.approx(np.tanh(seen), abs=1e-6)


def test_what_cannot_act_is_refused_and_torch_is_not_loaded(monkeypatch):
    for nothing in (3, None, [1.0], {"hip": 0.1}):
        with pytest.raises(ValueError, match=r"function or a torch module .*ONNX"):
            acting(nothing, "level")
    for name in ("nobody", "no/folder"):
        with pytest.raises(gpw.PolicyError, match=r"level-ppo.*\.onnx.*\.zip"):
            gpw.gauntlet(name, "level")
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    assert not is_module(linear) and "torch" not in sys.modules
    policy, _ = acting(linear, "level")
    assert isinstance(policy, FunctionPolicy) and policy.name == "linear"
