"""Each kind of controller acts alike in all that takes a controller."""

import sys
from collections.abc import Mapping
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, simulate_episodes
from gym_passive_walker.gaits.actuation import to_own
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.gaits.control.controllers import acting
from gym_passive_walker.gaits.control.policy import FunctionPolicy, ModulePolicy, is_module
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.pictures.strobe import strobe
from tests.own.statements import DRIVEN

SCENE = {"slope": 0.11, "control": "stride"}
ROWS = np.array([-0.2, 0.1, 0.0, -0.3, 0.05, 0.0, 0.0, 1.0])
STEPS = {"control": "tick", "tick": 1.0}
LAB = {"walker": "lab", "slope": 0.036, "control": "stride"}
SYSTEM = {"system": DRIVEN, "slope": 0.03, "control": "stride"}
GENTLE = 1e-3 * np.array([3.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0])
HELD = to_own(gpw.WALKERS["lab"].units, gpw.Actuation(hip_torque=2e-4))


def linear(observation):
    return observation @ ROWS[:, None]


def gentle(observation):
    return observation @ GENTLE[: observation.shape[1], None]


def module(dtype="float32", size=8, rows=ROWS):
    torch = pytest.importorskip("torch")
    layer = torch.nn.Linear(size, 1, bias=False).to(getattr(torch, dtype))
    with torch.no_grad():
        layer.weight.copy_(torch.tensor(rows[:size])[None])
    return torch.nn.Sequential(layer)


def gentle_too(observation, state=None, episode_start=None, deterministic=True):
    return gentle(observation), state


def counting(observation, state=None, episode_start=None, deterministic=True):
    """A memory that counts control steps, and a torque that alternates with them."""
    count = np.zeros(len(observation)) if state is None else state
    return np.where(count % 2.0, 4e-3, 3e-3)[:, None], count + 1.0


def planned(points, slopes):
    return 1e-3 * (3.0 * points[:, :1, None] + 2.0 * points[:, 1:2, None])


CONTROLLERS = {
    "Actuation": (lambda: HELD, LAB),
    "mapping": (lambda: {"hip_torque": HELD.hip_torque}, LAB),
    "optimal gait": (lambda: optimal.optimal_gait(LAB, 0.185), LAB),
    "name of a feedback": (lambda: "lqr", "steep"),
    "feedback": (lambda: LinearFeedback(LAB), LAB),
    "name of a policy": (lambda: "steep-sac", "steep"),
    "policy": (lambda: gpw.load_policy("steep-ppo"), "steep"),
    "path": (lambda: gpw.load_policy("steep-sac").folder, "steep"),
    "function": (lambda: gentle, LAB),
    "torch module": (lambda: module(rows=GENTLE), LAB),
    "object that predicts": (lambda: SimpleNamespace(predict=gentle_too), LAB),
    "object with a memory": (lambda: SimpleNamespace(predict=counting), LAB | STEPS),
    "object that plans": (lambda: SimpleNamespace(plan=planned), LAB | STEPS),
    "system: mapping": (lambda: {"hip": 2e-4}, SYSTEM),
    "system: function": (lambda: gentle, SYSTEM),
    "system: object that plans": (lambda: SimpleNamespace(plan=planned), SYSTEM),
}  # fmt: skip
"""A controller of each kind, and a scene in which it walks on."""


@pytest.fixture(scope="module", params=CONTROLLERS)
def walk(request):
    """The controller, its scene, and its gait."""
    make, scene = CONTROLLERS[request.param]
    controller = make()
    return controller, make_scene(scene), gpw.closed_loop_gait(controller, scene)


def test_a_stride_of_the_map_is_that_of_the_environment(walk):
    """Single and vector; the environment takes observations and actions in single precision."""
    controller, scene, gait = walk
    policy, _ = acting(controller, scene)
    calm = make_scene(scene, reset_noise_scale=0.0, slope=gait.slope)
    env = gym.make("PassiveWalker-v0", scene=calm).unwrapped
    start = 1.001 * gait.state if "actuation" in scene.walker.supports else gait.state
    seen, _ = env.reset(seed=0, options={"state": start})
    memory, struck, begun = None, 0.0, np.ones(1, bool)
    while not struck:
        action, memory = policy.predict(seen[None], memory, begun, deterministic=True)
        seen, _, ended, _, info = env.step(np.asarray(action[0], np.float32))
        assert not ended
        struck, begun = info["step_period"], np.zeros(1, bool)
    strides = gpw.stride_map(None, gait.slope, controller=controller, scene=scene)
    found = strides.stride(start, gait.slope)
    np.testing.assert_allclose(found.state, env.state, rtol=1e-5, atol=1e-5)
    many = gym.make_vec("PassiveWalker-v0", num_envs=2, scene=calm, max_episode_steps=100)
    assert simulate_episodes(controller, many, seed=0).endings == [TIME_LIMIT] * 2


def test_its_gait_repeats_and_is_drawn(walk):
    controller, scene, gait = walk
    strides = gpw.stride_map(None, gait.slope, controller=controller, scene=scene)
    assert strides.exact == gait.stride_map.exact and not strides.passive
    end = strides.stride(gait.state, gait.slope).state
    np.testing.assert_allclose(end, gait.state, atol=1e-4 * np.abs(gait.state).max())
    simulated = gpw.simulate(gait, strides=2, samples=5)
    np.testing.assert_allclose(simulated.states[5], gait.state, atol=1e-3)
    assert strobe(gait, strides=1).get_lines()


def test_robustness_takes_it_and_its_gait(walk):
    controller, scene, gait = walk
    few, length = dict(walkers=2, strides=2, starts=2), gait.step_length / gait.walker.units.length
    if isinstance(controller, Mapping):  # of a mapping it takes a passive walker's parameters
        with pytest.raises(ValueError, match=r"has no hip|a walker is"):
            gpw.robustness(controller, scene, **few)
        controller, scene = gait, None
    found = gpw.robustness(controller, scene, **few)
    assert found.step_length == pytest.approx(length, rel=1e-3) and found.step_down > 0.0


def test_a_gauntlet_takes_it_or_says_why_not(walk):
    controller, scene, _ = walk
    if "gauntlet" not in scene.walker.supports:
        with pytest.raises(ValueError, match="the gauntlet needs a walker with two legs"):
            gpw.gauntlet(controller, scene, walkers=2)
        return
    found = gpw.gauntlet(controller, scene, walkers=2)
    assert found.controller_name and found.episodes["own scene"].distance.min() > 10.0


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
    idle = torch.nn.Linear(8, 1)
    idle.forward = lambda seen: seen[:, :0]  # of a walker without motors
    for each in (policy, ModulePolicy(idle)):
        assert each.linearize(seen)[1].shape == (len(seen), each.predict(seen)[0].shape[1], 8)
    constant = torch.nn.Sequential(torch.nn.Linear(8, 1))
    with torch.no_grad():
        constant[0].weight.zero_()
    assert not ModulePolicy(constant).linearize(seen)[1].any()


def test_modules_that_cannot_act_are_refused():
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import rollout

    with pytest.raises(ValueError, match="say in which scene"):
        gpw.gauntlet(linear)
    with pytest.raises(ValueError, match="rollout needs a function or a module from tensors"):
        rollout("lqr", SCENE, 1)
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
    for nothing in (3, None, [1.0]):
        with pytest.raises(ValueError, match=r"function or a torch module .*ONNX"):
            acting(nothing, "level")
    for name in ("nobody", "no/folder"):
        with pytest.raises(gpw.PolicyError, match=r"level-ppo.*\.onnx.*\.zip"):
            gpw.gauntlet(name, "level")
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    assert not is_module(linear) and "torch" not in sys.modules
    policy, _ = acting(linear, "level")
    assert isinstance(policy, FunctionPolicy) and policy.name == "linear"
