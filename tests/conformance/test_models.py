"""What works of one model works of every model."""

from __future__ import annotations

import math
import pickle
import warnings
from dataclasses import replace
from functools import lru_cache
from tempfile import TemporaryDirectory

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from matplotlib import pyplot

import gym_passive_walker as gpw
import gym_passive_walker.torch as walks
from examples.driven_torso import DRIVEN_TORSO
from examples.five_links import FIVE_LINKS
from examples.rimless_wheel import RIMLESS_WHEEL
from examples.unequal_legs import PROSTHESIS
from gym_passive_walker.apps.shown import Setup, content_of
from gym_passive_walker.control.baselines import LinearFeedback
from gym_passive_walker.devices.gpu.batch import DeviceBatch
from gym_passive_walker.envs.explain import as_rows, as_text
from gym_passive_walker.envs.saved import StateError
from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from gym_passive_walker.models.units import observed_numbers
from gym_passive_walker.pictures import strobe

ADDRESSES = {
    "driven torso": "examples.driven_torso:DRIVEN_TORSO",
    "rimless wheel": "examples.rimless_wheel:RIMLESS_WHEEL",
    "five links": "examples.five_links:FIVE_LINKS",
    "unequal legs": "examples.unequal_legs:PROSTHESIS",
}
"""Names of the systems in a sweep."""

MODELS = {
    "kneed": ("lab", 0.036),
    "held": (replace(gpw.WALKERS["lab"], knees="held"), 0.036),
    "straight": ("A", 0.01),
    "simplest": ("D", 0.009),
    "torso": (DRIVEN_TORSO, 0.03),
    "wheel": (RIMLESS_WHEEL, 0.08),
    "five links": (FIVE_LINKS, 0.05),
    "unequal legs": (PROSTHESIS, math.radians(3.0)),
}


class Known:
    """A model with its slope and its gait, and what cells of the table do with them."""

    def __init__(self, name):
        self.name, (self.walker, self.slope) = name, MODELS[name]
        self.model = gpw.as_walker(self.walker)
        self.gait = gpw.find_gait(self.walker, self.slope)
        numbers = self.model.parameters
        self.varied = "gravity" if "gravity" in numbers else next(iter(numbers))
        self.drawn = next((name for name in numbers if self.may_draw(name)), None)
        self.stated = isinstance(self.model, gpw.System)
        self.names = self.walker.State._fields if self.stated else self.model.state_names

    def may_draw(self, name):
        """Whether a tolerance of a parameter changes the model."""
        try:
            return bool(self.scene(domain_randomization={name: 0.05}))
        except SceneError:
            return False

    def scene(self, **changes):
        """A scene of the model that starts near the gait."""
        return make_scene(walker=self.walker, slope=self.slope, **changes)

    def made(self, **changes):
        """An environment of the model."""
        return gym.make("PassiveWalker-v0", scene=self.scene(**changes)).unwrapped

    def many(self, count, **changes):
        """Several of them."""
        return gym.make_vec("PassiveWalker-v0", num_envs=count, scene=self.scene(**changes))

    def disturbances(self):
        """All of them, as a scene's arguments."""
        return {
            "pushes": {"rate": 0.5, "impulse": (-0.01, 0.01)}, "terrain": "rough:height_std=0.0005",
            "observation_noise": 0.01, "action_noise": 0.1, "action_delay": 1,
            "command": (0.1, 0.2), "domain_randomization": {self.drawn or "slope": 0.05},
        }  # fmt: skip

    def act(self, env):
        """Rewards of some steps of an environment."""
        env.reset(seed=0)
        env.action_space.seed(0)
        return [np.sum(env.step(0.1 * env.action_space.sample())[1]) for _ in range(5)]


known = lru_cache(Known)


def strides(m):
    walked = gpw.stride(m.walker, m.slope, m.gait.state)
    if not m.model.legs_alike:
        assert np.abs(walked.state - m.gait.state).max() > 1e-3
        walked = gpw.stride(m.model.swapped, m.slope, walked.state)
    np.testing.assert_allclose(walked.state, m.gait.state, atol=1e-7)
    for size in (m.model.size - 1, m.model.size + 1):
        with pytest.raises(ValueError, match=rf"\({m.model.size},\)"):
            gpw.stride(m.walker, m.slope, np.zeros(size))


def jacobian(m):
    by = gpw.stride_jacobian(m.gait, wrt="state")
    assert np.abs(np.linalg.eigvals(by)).max() == pytest.approx(abs(m.gait.multipliers[0]), 1e-5)


def slopes(m):
    family = gpw.gait_family(m.walker, 0.98 * m.slope, m.slope)
    on_section = {*m.names} if m.stated else {*m.names} - {"thigh_angle", "shank_angle"}
    assert len(family) >= 2 and on_section < {*family.columns()}


def parameters(m):
    value = m.model.parameters[m.varied]
    family = gpw.parameter_family(m.walker, m.varied, 0.99 * value, 1.01 * value, slope=m.slope)
    assert len(family) >= 2 and family.value.min() == pytest.approx(0.99 * value)
    assert family.stable.all() == m.gait.stable


def diagrams(m):
    found = gpw.bifurcation_diagram(m.walker, [m.slope], n_transient=100, n_recorded=33)
    assert found.stance_angle.shape[-1] == 33
    assert (found.period == 1).all() == m.gait.stable


def exponents(m):
    found = gpw.lyapunov_exponents(m.walker, [m.slope], strides=40, n_transient=10)
    assert found.shape == (1, 1) and (found < 0.0).all() == m.gait.stable


def velocity_perturbations(m):
    push = gpw.largest_push(m.gait, strides=20, accuracy=1e-2)
    assert (min(push.forward, push.backward) > 0.005) == m.gait.stable


def robust(m):
    if not m.gait.stable:
        with pytest.raises(ValueError, match="there is no gait of which robustness"):
            gpw.robustness(m.walker, slope=m.slope)
        return
    found = gpw.robustness(m.walker, slope=m.slope, walkers=8, strides=4, starts=8)
    assert np.isfinite(found.sensitivity)
    gait = m.gait.dimensionless
    assert found.step_period == pytest.approx(gait.step_period, rel=1e-6)
    assert found.step_length == pytest.approx(gait.step_length, rel=1e-6)
    assert 0.0 <= found.recovered < 1.0 and 0.0 < found.step_up < 0.1 and found.step_down > 0.0
    assert found.push_forward.min() > 0.0


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
    walk = gpw.simulate(m.gait, strides=2, samples=20)
    assert walk.states.shape == (40, m.model.size) == (len(walk.times), len(m.names))
    np.testing.assert_allclose(walk.states[0], m.gait.state, atol=1e-12)
    assert walk.ending == "heelstrike"


def rough_ground(m):
    rough = gpw.rough(0.0005)
    assert gpw.simulate(m.gait, strides=2, terrain=rough).stride_index.max() >= 1


def pictures(m):
    assert len(m.gait.plot()) == 4
    course, portrait = gpw.simulate(m.gait, strides=2).plot()
    coordinates, drawn_in = {*m.model.parts}, [portrait]
    if m.stated:
        coordinates = {name.replace("_", " ") for name in m.names[: m.model.coordinates]}
        drawn_in.append(course)
    for axes in drawn_in:
        assert coordinates <= {text.get_text() for text in axes.get_legend().get_texts()}
    pyplot.close("all")
    if m.stated:
        shown = strobe(m.gait, strides=1, flashes=5).get_lines()
        poses = 5 * len(m.model.drawn(m.gait.state.tolist()))
        assert sum(line.get_linewidth() in (1.0, 2.0) for line in shown) >= poses
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
    found = gpw.find_gait(controlled, guess=m.gait.state)
    assert found.speed == pytest.approx(m.gait.speed, 1e-6)
    np.testing.assert_allclose(found.state, m.gait.state, atol=1e-8)
    largest = [np.sort(np.abs(gait.multipliers))[-3:] for gait in (found, m.gait)]
    np.testing.assert_allclose(*largest, atol=1e-5)
    walked = gpw.stride(controlled, m.slope, m.gait.state)
    np.testing.assert_allclose(walked.state, m.gait.cycle.state[0], atol=1e-7)
    assert walked.state.shape == (m.model.size,)
    assert [*walked.columns()][: m.model.size] == [*m.names]
    with pytest.raises(ValueError, match=r"state must be \[.*rate.*\]: shape"):
        gpw.stride(controlled, m.slope, m.gait.state[:-1])


def constants(m):
    held = dict.fromkeys(m.model.controls[:1], 1e-4)
    if "actuation" in m.model.supports:
        held = gpw.Actuation(hip_torque=1e-4 * float(m.model.units.torque))
    assert gpw.find_gait(gpw.stride_map(m.walker, m.slope, controller=held)).speed > 0.0


def single(m):
    """Without actions, strides are those of the stride map."""
    env, gait = m.made(control="stride"), m.gait.dimensionless
    env.reset(seed=0, options={"state": m.gait.state})
    infos = [env.step(np.zeros(env.action_space.shape))[-1] for _ in m.gait.cycle.duration]
    steps = {name: np.array([info[name] for info in infos]) for name in infos[0]}
    np.testing.assert_allclose(env.state, m.gait.state, atol=1e-6)
    lengths, periods = steps["step_length"], steps["step_period"]
    np.testing.assert_allclose(periods, gait.cycle.duration, atol=1e-6)
    np.testing.assert_allclose(lengths, gait.cycle.step_length, atol=1e-6)
    np.testing.assert_allclose(steps["speed"], lengths / periods)
    work = (steps["gravity_cost"] * lengths).sum()
    assert work == pytest.approx(np.sin(m.slope) * lengths.sum(), abs=1e-6)
    np.testing.assert_array_equal(steps["cost_of_transport"], steps["gravity_cost"])


def checker(m):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*infinity")  # a system's state has no known bounds
        check_env(m.made(), skip_render_check=True)


def starts(m):
    envs = m.many(99, reset_noise_scale=0.2)
    there = m.gait.dimensionless.state
    seen = envs.reset(seed=0)[0][:, : m.model.size] / np.float32(there)
    angles, rates = np.split(seen, 2, axis=1)
    # An impact has just been: legs mirror each other, a system's coordinates are those of its gait.
    on_section = angles[:, :1] if m.model.chart.trailing_leg_follows else 1.0
    np.testing.assert_allclose(angles, on_section + 0.0 * angles, rtol=1e-6)
    assert 0.8 <= rates.min() < 0.85 < 1.15 < rates.max() <= 1.2


def given_starts(m):
    env, start = m.made(), 1.01 * m.gait.state
    given = {"state": start.copy(), "slope": 0.5 * m.slope}
    seen, _ = env.reset(options=given)
    np.testing.assert_array_equal(given["state"], start)
    np.testing.assert_allclose(env.state, start, rtol=1e-12)
    expected = [*m.model.units.to_dimensionless(start), 0.5 * m.slope]
    np.testing.assert_allclose(seen[[*range(m.model.size), -1]], expected, rtol=1e-6)
    with pytest.raises(ValueError, match=rf"\({m.model.size},\)"):
        env.reset(options={"state": np.zeros(m.model.size + 2)})
    with pytest.raises(ValueError, match="fallen"):
        env.reset(options={"state": [2.0, *start[1:]]})


def vector(m):
    assert np.isfinite(m.act(m.many(3))).all()


def stable_baselines(m):
    envs = PassiveWalkerVecEnv(2, m.scene())
    envs.reset()
    assert np.isfinite(envs.step(np.zeros((2, *envs.action_space.shape)))[1]).all()


def disturbed(m):
    assert np.isfinite(m.act(m.many(2, **m.disturbances()))).all()


def noise(m):
    """Sensors err in the state, and in the slope where they are asked to."""
    size, exact = m.model.size, m.many(400).reset(seed=0)[0]
    errors = m.many(400, observation_noise=0.01).reset(seed=0)[0] - exact
    assert np.std(errors[:, :size]) == pytest.approx(0.01, rel=0.1)
    assert np.abs(np.mean(errors[:, :size])) < 0.002 and not errors[:, size:].any()
    of_slope = (0.0,) * (len(m.model.observed) - 1) + (0.02,)
    errors = m.many(400, observation_noise=of_slope).reset(seed=0)[0] - exact
    assert not errors[:, :-1].any() and np.std(errors[:, -1]) == pytest.approx(0.02, rel=0.1)


def previews(m):
    env = m.made(terrain={"rough": {"height_std": 0.0005}}, terrain_lookahead=2)
    assert env.observation_space.shape == (len(m.model.observed) + 4,)
    assert np.isfinite(m.act(env)).all()


def commands(m):
    """A command is observed, and a step that misses it earns less."""
    env, free = (
        m.made(control="stride", reset_noise_scale=0.0, command=command) for command in (0.3, None)
    )
    seen, _ = env.reset(seed=0)
    assert seen.shape == (len(m.model.observed) + 1,) and seen[-1] == pytest.approx(0.3)
    free.reset(seed=0)
    rest = np.zeros(env.action_space.shape)
    (_, reward, _, _, info), (_, unpaid, *_) = env.step(rest), free.step(rest)
    missed = abs(info["step_length"] - 0.3 * info["step_period"])
    lost = min(env.scene.command_weight * missed, info["step_length"])
    assert reward == pytest.approx(unpaid - lost, abs=1e-9)
    shown = []

    def idle(observations):
        shown.append(observations)
        return np.zeros((len(observations), *env.action_space.shape))

    strides = gpw.stride_map(controller=idle, scene=env.scene)
    strides.apply(strides.beginning([m.slope]))
    assert shown[0].shape[1:] == env.observation_space.shape
    assert (shown[0][:, -2:] == (m.slope, 0.3)).all()


def constraints(m):
    assert np.isfinite(m.act(m.made(constraints={"friction": "report"}))).all()


def bodies(m):
    """Bodies vary within their share, and each walks by its own equations."""
    if m.drawn is None:  # up to its units, there is one simplest walker
        with pytest.raises(SceneError, match=r"hip_mass.* changes nothing"):
            m.scene(domain_randomization={"hip_mass": 0.05})
        return
    scene = m.scene(control="stride", domain_randomization={m.drawn: 0.05}, reset_noise_scale=0.0)
    envs = gym.make_vec("PassiveWalker-v0", num_envs=50, scene=scene).unwrapped
    envs.reset(seed=0)
    values = np.array([walker.parameters[m.drawn] for walker in envs.batch.walkers])
    nominal = m.model.parameters[m.drawn]
    assert np.all(np.abs(values / nominal - 1.0) <= 0.05) and np.std(values) > 0.01 * nominal
    before = envs.batch.states
    envs.step(np.zeros((50, *envs.single_action_space.shape)))
    for lane in (0, 31):
        walked = gpw.stride(envs.batch.walkers[lane], m.slope, before[lane], tolerance=1e-8)
        np.testing.assert_allclose(envs.batch.states[lane], walked.state, atol=1e-6)


def bodies_seen(m):
    name = "hip_mass" if "hip_mass" in m.model.parameters else m.varied
    env = m.made(observe_body=(name,))
    assert env.reset(seed=0)[0][-1] == pytest.approx(observed_numbers(m.model, [name])[0])
    assert np.isfinite(m.act(env)).all()


def rewards(m):
    """Functions of the user's own read the numbers of the model's own state."""
    half = m.model.size // 2

    def own(step):
        return step.state[half] - step.before[half] + sum(step.action)

    env = m.made(
        reward=own, terminated=lambda step: step.steps > 4, observation=lambda step: step.state[-1]
    )
    env.reset(seed=2)
    env.action_space.seed(5)
    for number in range(1, 6):
        before, action = env.state, 0.2 * env.action_space.sample().astype(float)
        seen, paid, ended, _, info = env.step(action)
        before, state = map(m.model.units.to_dimensionless, (before, env.state))
        assert paid == pytest.approx(state[half] - before[half] + sum(action), abs=1e-12)
        assert seen.shape == (1,) and seen[0] == pytest.approx(state[-1], rel=1e-6)
        assert ended == (number > 4)
    assert info["outcome"] == "stopped"


def saved_states(m):
    for scene in ({}, m.disturbances()):
        env, other = (m.made(**scene) for _ in range(2))
        m.act(env)
        other.reset(seed=5)
        saved = pickle.loads(pickle.dumps(env.get_state()))
        other.set_state(saved)
        for _ in range(6):
            action = 0.1 * env.action_space.sample()
            found, expected = other.step(action), env.step(action)
            assert (found[0].tobytes(), found[1]) == (expected[0].tobytes(), expected[1])
        another = m.model.with_parameters(**{m.varied: 1.1 * m.model.parameters[m.varied]})
        with pytest.raises(StateError, match=r"system|walker"):
            gym.make(
                "PassiveWalker-v0", scene=m.scene(**scene), walker=another
            ).unwrapped.set_state(saved)


def explanations(m):
    rows, text = as_rows(m.scene()), as_text(m.scene())
    assert len(rows["observation"]) == len(m.model.observed)
    if m.stated:
        assert text.startswith(f"system '{m.model.title}'")
        assert all(name in text for name in (*m.names, *m.model.controls, *m.model.falls))
        assert ("action 1 is" in text) == bool(m.model.controls)


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
    if m.name == "held":
        with pytest.raises(ValueError, match="a page has no walkers with held knees"):
            content_of(Setup(m.model, m.slope, 0.0, None))
        return
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
    env = gym.make("PassiveWalker-v0", scene=m.scene(), render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    m.act(env)
    after = env.render()
    assert before.shape == after.shape == (450, 800, 3) and np.any(before != after)
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 20
    many = gym.make_vec("PassiveWalker-v0", num_envs=2, scene=m.scene(), render_mode="rgb_array")
    many.reset(seed=0)
    assert len(many.render()) == 2


CELLS = [
    strides, jacobian, slopes, parameters, diagrams, exponents, velocity_perturbations, robust,
    basins, trajectories, rough_ground, pictures, checks, collisions, tables, tunings, optima,
    feedback, functions, constants, single, checker, starts, given_starts, vector,
    stable_baselines, disturbed, noise, previews, commands, constraints, bodies,
    bodies_seen, rewards, saved_states, explanations, gradients, rollouts, gpu_strides,
    gpu_episodes, pages, sweeps, videos,
]  # fmt: skip


OF_LEGS_ALIKE = robust, optima, feedback, constraints, pages


PAIRS = [
    pytest.param(cell, name, marks=[pytest.mark.slow] * (cell in (optima, pages, sweeps)))
    for cell in CELLS
    for name in MODELS
]


@pytest.mark.parametrize(("cell", "name"), PAIRS, ids=lambda x: getattr(x, "__name__", x))
def test_every_capability_is_one_of_every_model(cell, name):
    model = known(name)
    if cell in OF_LEGS_ALIKE and not model.model.legs_alike:
        with pytest.raises(ValueError, match="needs legs that are alike: those of the system"):
            cell(model)
    else:
        cell(model)
