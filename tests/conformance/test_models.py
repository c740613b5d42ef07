"""What works of one model works of every model."""

from __future__ import annotations

from functools import lru_cache
from tempfile import TemporaryDirectory

import gymnasium as gym
import numpy as np
import pytest
import torch
from matplotlib import pyplot

import gym_passive_walker as gpw
import gym_passive_walker.torch as walks
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL
from gym_passive_walker.apps.shown import Setup, content_of
from gym_passive_walker.control.baselines import LinearFeedback
from gym_passive_walker.devices.gpu.batch import DeviceBatch
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.units import observed_numbers

ADDRESSES = {
    "driven torso": "examples.driven_torso:DRIVEN_TORSO",
    "rimless wheel": "examples.rimless_wheel:RIMLESS_WHEEL",
    "five links": "examples.five_links:FIVE_LINKS",
}
"""Names of the systems in a sweep."""

MODELS = {
    "kneed": ("lab", 0.036),
    "straight": ("A", 0.01),
    "simplest": ("D", 0.009),
    "torso": (DRIVEN_TORSO, 0.03),
    "wheel": (RIMLESS_WHEEL, 0.08),
    "five links": (FIVE_LINKS, 0.05),
}


class Known:
    """A model with its slope and its gait, and what cells of the table do with them."""

    def __init__(self, name):
        self.walker, self.slope = MODELS[name]
        self.model = gpw.as_walker(self.walker)
        self.gait = gpw.find_gait(self.walker, self.slope)
        numbers = self.model.parameters
        self.varied = "gravity" if "gravity" in numbers else next(iter(numbers))

    def scene(self, **changes):
        """A scene of the model that starts near the gait."""
        return make_scene(walker=self.walker, slope=self.slope, **changes)

    def act(self, env):
        """Rewards of some steps of an environment."""
        env.reset(seed=0)
        env.action_space.seed(0)
        return [np.sum(env.step(0.1 * env.action_space.sample())[1]) for _ in range(5)]


known = lru_cache(Known)


def strides(m):
    walked = gpw.stride(m.walker, m.slope, m.gait.state)
    np.testing.assert_allclose(walked.state, m.gait.state, atol=1e-7)


def jacobian(m):
    by = gpw.stride_jacobian(m.gait, wrt="state")
    assert np.abs(np.linalg.eigvals(by)).max() == pytest.approx(abs(m.gait.multipliers[0]), 1e-5)


def slopes(m):
    assert len(gpw.gait_family(m.walker, 0.98 * m.slope, m.slope)) >= 2


def parameters(m):
    value = m.model.parameters[m.varied]
    low, high = sorted((0.99 * value, 1.01 * value))
    assert len(gpw.parameter_family(m.walker, m.varied, low, high, slope=m.slope)) >= 2


def diagrams(m):
    found = gpw.bifurcation_diagram(m.walker, [m.slope], n_transient=20, n_recorded=33)
    assert found.stance_angle.shape[-1] == 33


def exponents(m):
    found = gpw.lyapunov_exponents(m.walker, [m.slope], strides=40, n_transient=10)
    assert found.shape == (1, 1)


def velocity_perturbations(m):
    assert gpw.largest_push(m.gait, strides=20, accuracy=1e-2).forward >= 0.0


def robust(m):
    if not m.gait.stable:
        with pytest.raises(ValueError, match="there is no gait of which robustness"):
            gpw.robustness(m.walker, slope=m.slope)
        return
    found = gpw.robustness(m.walker, slope=m.slope, walkers=8, strides=4, starts=8)
    assert np.isfinite(found.sensitivity)


def basins(m):
    if m.model.size < 4:
        with pytest.raises(ValueError, match="needs a system of two coordinates"):
            gpw.basin_of_attraction(m.walker, m.slope)
        return
    assert gpw.basin_of_attraction(m.walker, m.slope, resolution=6, strides=6).settled.shape == (
        6,
        6,
    )


def trajectories(m):
    walk = gpw.simulate(m.gait, strides=2)
    assert walk.states.shape == (len(walk.times), m.model.size)


def rough_ground(m):
    rough = gpw.rough(0.0005)
    assert gpw.simulate(m.gait, strides=2, terrain=rough).stride_index.max() >= 1


def pictures(m):
    assert len(m.gait.plot()) > 1
    pyplot.close("all")


def checks(m):
    assert gpw.reality_check(m.gait).least_normal_force.value > 0.0


def collisions(m):
    there = m.gait.state if isinstance(m.model, gpw.System) else m.gait.stance_angle
    assert np.linalg.eigvalsh(gpw.collision_matrix(m.walker, there)).min() > -1e-12


def tables(m):
    assert np.isfinite(gpw.measures(m.gait).speed)


def tunings(m):
    value = m.model.parameters[m.varied]
    assert gpw.optimize_walker(
        m.walker, "speed", (m.varied,), [(0.9 * value, 1.1 * value)], slope=m.slope, iterations=2
    )


def optima(m):
    if not m.scene().actions:
        with pytest.raises(ValueError, match="has none: give it a control"):
            gpw.optimal_gait(m.scene(), m.gait.froude_speed)
        return
    gait = gpw.optimal_gait(m.scene(), m.gait.froude_speed)
    np.testing.assert_allclose(gait.state, m.gait.state, atol=1e-7)
    assert gait.motor_cost < 1e-9


def feedback(m):
    scene = m.scene(control="stride")
    if not scene.actions:
        with pytest.raises(ValueError, match="needs a control, and the scene a largest torque"):
            LinearFeedback(scene)
        return
    controller = LinearFeedback(scene)
    gait = gpw.find_gait(gpw.stride_map(controller=controller, scene=scene))
    expected = np.abs(np.linalg.eigvals(controller.closed_loop)).max()
    assert abs(gait.multipliers[0]) == pytest.approx(expected, rel=1e-4) and expected < 1.0


def functions(m):
    size = len(m.scene().actions)
    controlled = gpw.stride_map(
        scene=m.scene(), controller=lambda seen: np.zeros((len(seen), size))
    )
    assert gpw.find_gait(controlled, guess=m.gait.state).speed == pytest.approx(m.gait.speed, 1e-6)


def constants(m):
    held = dict.fromkeys(m.model.controls[:1], 1e-4)
    if "actuation" in m.model.supports:
        held = gpw.Actuation(hip_torque=1e-4 * float(m.model.units.torque))
    assert gpw.find_gait(gpw.stride_map(m.walker, m.slope, controller=held)).speed > 0.0


def single(m):
    assert np.isfinite(m.act(gym.make("PassiveWalker-v0", scene=m.scene()))).all()


def starts(m):
    envs = gym.make_vec("PassiveWalker-v0", num_envs=99, scene=m.scene(reset_noise_scale=0.2))
    there = m.gait.dimensionless.state
    seen = envs.reset(seed=0)[0][:, : m.model.size] / np.float32(there)
    angles, rates = np.split(seen, 2, axis=1)
    # An impact has just been: legs mirror each other, a system's coordinates are those of its gait.
    on_section = angles[:, :1] if m.model.chart.trailing_leg_follows else 1.0
    np.testing.assert_allclose(angles, on_section + 0.0 * angles, rtol=1e-6)
    assert 0.8 <= rates.min() < 0.85 < 1.15 < rates.max() <= 1.2


def vector(m):
    envs = gym.make_vec("PassiveWalker-v0", num_envs=3, scene=m.scene())
    assert np.isfinite(m.act(envs)).all()


def stable_baselines(m):
    envs = PassiveWalkerVecEnv(2, m.scene())
    envs.reset()
    assert np.isfinite(envs.step(np.zeros((2, *envs.action_space.shape)))[1]).all()


def disturbed(m):
    scene = m.scene(pushes={"rate": 0.1, "impulse": 0.01}, observation_noise=0.01, action_delay=1)
    assert np.isfinite(m.act(gym.make_vec("PassiveWalker-v0", num_envs=2, scene=scene))).all()


def terrains(m):
    scene = m.scene(terrain={"rough": {"height_std": 0.0005}})
    assert np.isfinite(m.act(gym.make_vec("PassiveWalker-v0", num_envs=2, scene=scene))).all()


def previews(m):
    scene = m.scene(terrain={"rough": {"height_std": 0.0005}}, terrain_lookahead=2)
    env = gym.make("PassiveWalker-v0", scene=scene)
    assert env.observation_space.shape == (len(m.model.observed) + 4,)
    assert np.isfinite(m.act(env)).all()


def commands(m):
    env = gym.make("PassiveWalker-v0", scene=m.scene(command=0.1))
    assert env.observation_space.shape == (len(m.model.observed) + 1,)
    assert np.isfinite(m.act(env)).all()


def constraints(m):
    env = gym.make("PassiveWalker-v0", scene=m.scene(constraints={"friction": "report"}))
    assert np.isfinite(m.act(env)).all()


def bodies(m):
    scene = m.scene(domain_randomization={m.varied: 0.01})
    assert np.isfinite(m.act(gym.make_vec("PassiveWalker-v0", num_envs=3, scene=scene))).all()


def bodies_seen(m):
    name = "hip_mass" if "hip_mass" in m.model.parameters else m.varied
    env = gym.make("PassiveWalker-v0", scene=m.scene(observe_body=(name,)))
    assert env.reset(seed=0)[0][-1] == pytest.approx(observed_numbers(m.model, [name])[0])
    assert np.isfinite(m.act(env)).all()


def rewards(m):
    scene = m.scene(reward=lambda s: s.distance - s.state[0] ** 2, terminated=lambda s: s.steps > 3)
    assert np.isfinite(m.act(gym.make_vec("PassiveWalker-v0", num_envs=2, scene=scene))).all()


def saved_states(m):
    env, other = (gym.make("PassiveWalker-v0", scene=m.scene()).unwrapped for _ in range(2))
    m.act(env)
    other.reset(seed=5)
    other.set_state(env.get_state())
    action = np.zeros(env.action_space.shape, np.float32)
    assert env.step(action)[0].tobytes() == other.step(action)[0].tobytes()


def explanations(m):
    from gym_passive_walker.envs.explain import as_rows

    assert len(as_rows(m.scene())["observation"]) == len(m.model.observed)


def gradients(m):
    state = torch.tensor(np.array(m.gait.state), requires_grad=True)
    walked = walks.stride(m.walker, m.slope, state)
    (by,) = torch.autograd.grad(walked.duration.sum(), state)
    assert by.abs().max() > 0.0


def rollouts(m):
    size = len(m.scene().actions)
    gain = torch.zeros((), dtype=torch.float64, requires_grad=True)
    found = walks.rollout(
        lambda seen: gain + torch.zeros(len(seen), size).double(), m.scene(), 5, count=2
    )
    assert torch.isfinite(found.returns).all()


def gpu_strides(m):
    from gym_passive_walker.devices import gpu

    states = np.tile(m.gait.state, (2, 1))
    there, here = gpu.stride(m.walker, m.slope, states), gpw.stride(m.walker, m.slope, states)
    assert there.state.tobytes() == here.state.tobytes()


def gpu_episodes(m):
    there = DeviceBatch(2, m.scene())
    there.reset()
    there.step()
    assert np.isfinite(np.asarray(there.arrays.rewards)).all()


def pages(m):
    content, given = content_of(Setup(m.model, m.slope, 0.0, None))
    assert content and given


def sweeps(m):
    walker = ADDRESSES.get(m.model.title, m.walker)
    over = {"slope": [m.slope], m.varied: [m.model.parameters[m.varied]]}
    with TemporaryDirectory() as folder:
        found = gpw.sweep(
            "gait", f"{folder}/sweep", over=over, given={"walker": walker}, trust=True
        )
        assert found.columns()["stance_angle"] == pytest.approx([m.gait.stance_angle])


def videos(m):
    frames = gym.make("PassiveWalker-v0", scene=m.scene(), render_mode="rgb_array")
    frames.reset(seed=0)
    assert frames.render().std() > 1.0


CELLS = [
    strides, jacobian, slopes, parameters, diagrams, exponents, velocity_perturbations, robust,
    basins, trajectories, rough_ground, pictures, checks, collisions, tables, tunings, optima,
    feedback, functions, constants, single, starts, vector, stable_baselines, disturbed,
    terrains, previews, commands, constraints, bodies, bodies_seen, rewards, saved_states,
    explanations, gradients, rollouts, gpu_strides, gpu_episodes, pages, sweeps, videos,
]  # fmt: skip


PAIRS = [
    pytest.param(cell, name, marks=[pytest.mark.slow] * (cell in (optima, pages, sweeps)))
    for cell in CELLS
    for name in MODELS
]


@pytest.mark.parametrize(("cell", "name"), PAIRS, ids=lambda x: getattr(x, "__name__", x))
def test_every_capability_is_one_of_every_model(cell, name):
    cell(known(name))
