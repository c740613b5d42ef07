"""The task of `PassiveWalker-v0` in MuJoCo."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gym_passive_walker as gpw
from gym_passive_walker.bridge import loop
from gym_passive_walker.bridge.mujoco import PassiveWalkerMujocoEnv
from gym_passive_walker.envs.registration import ID, MUJOCO_ID
from gym_passive_walker.gaits.control.optimal import load
from gym_passive_walker.gaits.scenes.scene import SceneError

mujoco = pytest.importorskip("mujoco")

SCENES = {
    "level": {},
    "lab": {"scene": "lab"},
    "steep": {"scene": "steep"},
    "straight legs": {"walker": "A", "slope": (0.01, 0.03), "observe_body": ["foot_radius"]},
    "random bodies": {"domain_randomization": {"foot_radius": 0.1}},
    "own rules": {"reward": {"distance": 1.0, "energy": -5.0},
                  "observation": lambda step: (step.state[0], step.state[3]),
                  "terminated": lambda step: step.strides > 3},
}  # fmt: skip


def both(name, **more):
    """An exact environment and one in MuJoCo, in a scene."""
    arguments = SCENES[name]
    made = gymnasium.make(ID, **arguments), gymnasium.make(MUJOCO_ID, **arguments, **more)
    return [env.unwrapped for env in made]


@pytest.mark.parametrize("name", SCENES)
def test_spaces_starts_and_infos_are_those_of_the_exact_environment(name):
    exact, soft = both(name, timestep=1e-3)
    assert exact.observation_space == soft.observation_space
    assert exact.action_space == soft.action_space
    (first, info), (other, other_info) = (env.reset(seed=3) for env in (exact, soft))
    np.testing.assert_array_equal(first, other)
    assert exact.walker == soft.walker and exact.slope == soft.slope
    assert info.keys() == other_info.keys()
    for _ in range(2):
        step, again = (env.step(np.zeros(1, np.float32)) for env in (exact, soft))
        assert step[4].keys() == again[4].keys()
        assert {k: type(v) for k, v in step[4].items()} == {k: type(v) for k, v in again[4].items()}
        assert again[1] == pytest.approx(step[1], abs=1e-3)
        np.testing.assert_allclose(step[0], again[0], atol=2e-2)


def test_the_environment_is_one_of_gymnasium_s():
    check_env(gymnasium.make(MUJOCO_ID, timestep=1e-2).unwrapped, skip_render_check=True)


def test_one_seed_is_one_walk():
    walks = []
    for _ in range(2):
        env = gymnasium.make(MUJOCO_ID, scene="rolling", timestep=1e-2)
        env.reset(seed=1)
        walks.append([env.step(np.full(1, 0.2, np.float32))[:2] for _ in range(20)])
    for (seen, reward), (again, other) in zip(*walks, strict=True):
        assert np.array_equal(seen, again) and reward == other


def test_a_policy_walks_in_both():
    policy = gpw.load_policy("level-ppo")
    rewards, works = [], []
    for env in both("level", timestep=2e-3):
        observation, _ = env.reset(seed=0)
        total, strides = 0.0, {}
        for _ in range(130):
            action, _ = policy.predict(observation, deterministic=True)
            observation, reward, ended, _, info = env.step(action)
            assert not ended
            total += reward
            strides.setdefault(info["strides"], [info["hip_cost"], info["net_hip_cost"]])
        rewards.append(total)
        works.append([strides[i] for i in range(1, 5)])
        assert info["strides"] == 4
    assert rewards[1] == pytest.approx(rewards[0], rel=0.02)
    np.testing.assert_allclose(works[1], works[0], rtol=0.1)


def test_a_saved_state_continues_bit_for_bit():
    env = gymnasium.make(MUJOCO_ID, scene="lab", timestep=4e-3).unwrapped
    env.reset(seed=0)
    for _ in range(40):
        env.step(np.zeros(1, np.float32))
    saved, copied = env.get_state(), copy.deepcopy(env)
    loaded = pickle.loads(pickle.dumps(env))
    on = [env.step(np.zeros(1, np.float32)) for _ in range(40)]
    env.set_state(saved)
    for other in (env, copied, loaded):
        again = [other.step(np.zeros(1, np.float32)) for _ in range(40)]
        for step, repeated in zip(on, again, strict=True):
            assert np.array_equal(step[0], repeated[0]) and step[1] == repeated[1]
    with pytest.raises(ValueError, match="'mujoco' must be"):
        env.set_state({**saved, "mujoco": np.zeros(3)})


@pytest.mark.parametrize(
    ("angles", "outcome"),
    [
        ((-1.6, 0.0, 0.0), "FELL_FORWARD"),
        ((1.6, 3.2, 0.0), "FELL_BACKWARD"),
        ((0.2, 3.2, 0.0), "SWING_OVERROTATION"),
        ((0.2, 0.0, -3.2), "SWING_OVERROTATION"),
        ((-1.5, 3.1, -3.1), "RUNNING"),
    ],
)
def test_a_walker_has_fallen_where_its_leg_is_level_or_its_swing_leg_upside_down(angles, outcome):
    assert loop._fall(angles) == gpw.Outcome[outcome]


def test_the_energy_balance_of_a_stride_closes():
    """What gravity and the hip spend on a gait is lost in collisions."""
    gait = gpw.find_gait("lab", 0.036)
    start = tuple(gait.dimensionless.state.tolist())
    env = gymnasium.make(MUJOCO_ID, scene="lab", start=start, reset_noise_scale=0.0).unwrapped
    env.reset(seed=0)
    info = {"strides": 0}
    while info["strides"] < 1:
        *_, info = env.step(np.zeros(1, np.float32))
    assert info["gravity_cost"] == pytest.approx(gait.cost_of_transport, rel=1e-3)
    assert info["collision_cost"] == pytest.approx(gait.cost_of_transport, rel=2e-2)
    assert info["step_period"] == pytest.approx(gait.dimensionless.step_period, rel=1e-3)
    assert info["kneestrike_time"] == pytest.approx(gait.dimensionless.kneestrike_time, rel=1e-2)


def test_the_passive_gait_has_its_period_and_angle_at_a_tenth_of_a_millisecond():
    found = gpw.compare(gpw.find_gait("lab", 0.036), timesteps=[1e-4], strides=12)
    assert abs(found.error["step_period"][0]) < 5e-4
    assert abs(found.error["stance_angle"][0]) < 5e-4
    assert found.outcome == ["no fall"] and found.penetration[0] < 1e-6


def test_the_optimal_gait_has_its_cost_at_a_tenth_of_a_millisecond():
    optimum = gpw.optimal_gait("level", 0.10)
    found = gpw.compare(optimum, "level", timesteps=[1e-4], strides=8)
    assert abs(found.error["cost_of_transport"][0]) < 2e-3


def test_an_optimal_gait_is_compared_in_the_scene_that_is_named():
    with pytest.raises(ValueError, match="say in which scene this policy acts, by scene="):
        gpw.compare(load("level")[0])


def test_a_gait_of_two_strides_is_compared_over_both():
    gait = gpw.find_gait("C", 0.0796, period=2)
    odd, even = gait.cycle.state[:, 0]
    found = gpw.compare(gait, timesteps=[1e-3], strides=6)  # 3 strides later, and a period is 2
    assert found.exact["stance_angle"] == pytest.approx(0.5 * (odd + even), abs=1e-12)
    assert abs(found.error["stance_angle"][0]) < 0.1 * abs(odd - even) / odd


def test_contacts_of_mujoco_s_own_softness_walk_another_gait():
    gait = gpw.find_gait("lab", 0.036)
    found = gpw.compare(gait, timesteps=[2e-3], softness=[2.0, None], strides=10)
    tied, own = np.abs(found.error["speed"])
    assert tied < 5e-3 < 1e-2 < own
    assert found.penetration[1] > 10.0 * found.penetration[0]
    assert "its own" in str(found) and "stance angle error" in repr(found)
    assert {*found.column_units()} <= {*found.columns()}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"pushes": {"rate": 0.1, "impulse": 0.01}}, "does not have pushes: leave out"),
        ({"observation_noise": 0.1}, "does not have observation_noise"),
        ({"action_delay": 1}, "does not have action_delay"),
        ({"command": 0.15}, "does not have command"),
        ({"constraints": {"contact": "end"}}, "does not have constraints"),
        ({"terrain": {"rough": {"height_std": 0.01}}}, "does not have terrain"),
        ({"actions": ["hip", "push_off"]}, "does not have push_off"),
        ({"walker": "E", "actions": ["ankle"]}, "does not have ankle"),
        ({"tolerance": 1e-9}, "does not have tolerance"),
        ({"domain_randomization": {"max_hip_torque": 0.2}}, "of max_hip_torque: leave out"),
    ],
)
def test_features_that_it_lacks_are_refused_in_a_sentence(arguments, said):
    with pytest.raises(SceneError, match=said) as refused:
        PassiveWalkerMujocoEnv(**arguments)
    assert "\n" not in str(refused.value)
    env = gymnasium.make(MUJOCO_ID, timestep=1e-2, walker=arguments.get("walker", "C")).unwrapped
    with pytest.raises(SceneError):
        env.set_scene(**arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"walker": "D"}, SceneError, "legs without mass"),
        ({"timestep": 0.0}, ValueError, "timestep must be a number above 0 up to 0.1, not 0.0"),
        ({"softness": 1.0}, ValueError, "softness must be a number from 2 to"),
        ({"render_mode": "human"}, ValueError, r"render_mode must be one of \['rgb_array'\]"),
    ],
)
def test_arguments_out_of_range_are_refused(arguments, error, said):
    with pytest.raises(error, match=said):
        PassiveWalkerMujocoEnv(**arguments)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"simulator": "gazebo"}, "simulator must be 'mujoco', not 'gazebo'"),
        ({"timesteps": []}, "timesteps must be a list of numbers"),
        ({"timesteps": 1e-3}, "timesteps must be a list of numbers"),
        ({"timesteps": np.array(1e-3)}, "timesteps must be a list of numbers"),
        ({"softness": np.array(2.0)}, "softness must be a list of numbers"),
        ({"timesteps": [-1.0]}, "timestep must be a number above 0"),
        ({"strides": 1}, "strides must be"),
        ({"scene": "lab"}, "leave out scene"),
    ],
)
def test_a_comparison_that_cannot_be_made_is_refused(arguments, said):
    with pytest.raises(ValueError, match=said):
        gpw.compare(gpw.find_gait("lab", 0.036), **arguments)


def test_a_slope_changes_where_a_stride_begins():
    env = gymnasium.make(MUJOCO_ID, scene="lab", timestep=4e-3).unwrapped
    env.reset(seed=0)
    env.set_slope(0.05)
    assert env.batch.loop.depth == pytest.approx(0.0, abs=1e-12)
    normal = env.batch.loop.data.geom("ground").xmat
    env.step(np.zeros(1, np.float32))
    assert normal.reshape(3, 3)[0, 2] == pytest.approx(np.sin(0.05))


def test_without_mujoco_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(ImportError, match=r'pip install "gym-passive-walker\[mujoco\]"'):
        gymnasium.make(MUJOCO_ID)


def test_an_opengl_that_is_not_there_is_named(monkeypatch):
    def fails(name):
        raise AttributeError("no glGetError")

    monkeypatch.setattr("gym_passive_walker.bridge.loop.import_module", fails)
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(ImportError, match=r"the OpenGL of MUJOCO_GL=osmesa: install"):
        gymnasium.make(MUJOCO_ID)


def test_a_renderer_without_opengl_is_tried_once(monkeypatch):
    import mujoco

    from gym_passive_walker.bridge import mujoco as bridge

    tried = []

    def fails(*size):
        tried.append(size)
        raise RuntimeError("no library")

    monkeypatch.setattr(mujoco, "Renderer", fails)
    monkeypatch.setattr(bridge, "_NO_SCREEN", [])
    env = bridge.PassiveWalkerMujocoEnv(timestep=1e-2, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(2):
        with pytest.raises(RuntimeError, match=r"no OpenGL here \(no library\): set MUJOCO_GL"):
            env.render()
    assert len(tried) == 1


def test_a_frame_is_seen_from_the_side_with_the_ground_below_the_feet(monkeypatch):
    class Eye:
        """MuJoCo's renderer without OpenGL."""

        def __init__(self, model, *size):
            self.model, self.size, self.scene = model, size, mujoco.MjvScene(model, 100)

        def update_scene(self, data, camera):
            all_kinds, self.camera = mujoco.mjtCatBit.mjCAT_ALL, camera
            mujoco.mjv_updateScene(
                self.model, data, mujoco.MjvOption(), None, camera, all_kinds, self.scene
            )

        def render(self):
            return self

    monkeypatch.setattr(mujoco, "Renderer", Eye)
    env = PassiveWalkerMujocoEnv(scene="lab", slope=0.1, render_mode="rgb_array")
    env.reset(seed=0)
    seen, length, data = env.render(), env.walker.leg_length, env.batch.loop.data
    ground = seen.scene.geoms[seen.scene.ngeom - 1]
    along, normal = np.array([[np.cos(0.1), 0.0, -np.sin(0.1)], [np.sin(0.1), 0.0, np.cos(0.1)]])
    assert ground.mat == pytest.approx(np.stack([along, [0.0, 1.0, 0.0], normal], axis=1), abs=1e-6)
    top = ground.pos + ground.size[2] * normal  # the middle of its upper side
    hip = np.array([data.qpos[0], 0.0, data.qpos[1]])
    assert (top @ normal, top @ along) == pytest.approx((0.0, hip @ along), abs=1e-6)
    assert ground.size == pytest.approx(length * np.array([2.0, 0.5, 0.5]))
    assert ground.rgba == pytest.approx([0.8, 0.8, 0.8, 1.0])
    camera, high = seen.camera, seen.model.vis.global_.fovy
    assert (camera.azimuth, camera.elevation, camera.orthographic) == (90.0, 0.0, 1)
    assert camera.lookat == pytest.approx(hip - [0.0, 0.0, 0.4 * length])
    assert high == pytest.approx(1.8 * length)  # in which a leg is, with the hip 0.4 above
    assert seen.size[0] < seen.size[1] and camera.distance > length
    assert env.render() is seen  # with one renderer
