"""Observed bodies, and pools of bodies."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from gym_passive_walker.envs.explain import as_rows
from gym_passive_walker.gaits.control.maps import map_in
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.units import PROPORTIONS, proportions
from gym_passive_walker.models.walkers import PARAMETERS, WALKERS

NAMES = make_scene("anywhere").observe_body


def vector(count, **changes):
    return gym.make_vec("PassiveWalker-v0", num_envs=count, scene="anywhere", **changes)


def test_observation_ends_with_the_body():
    envs = vector(4)
    for seen in (envs.reset(seed=0)[0], envs.step(np.full((4, 1), 0.2))[0]):
        for row, walker in zip(seen, envs.batch.walkers, strict=True):
            length, mass = walker.leg_length, walker.total_mass
            expected = {
                "foot_radius": walker.foot_radius / length,
                "shank_mass": walker.shank_mass / mass,
                "shank_length": walker.shank_length / length,
            }
            told = dict(zip(NAMES, row[-len(NAMES) :].tolist(), strict=True))
            for name, value in expected.items():
                assert told[name] == pytest.approx(value, rel=1e-6)
    assert len({row[-len(NAMES) :].tobytes() for row in seen}) == 4


def test_every_parameter_but_gravity_has_a_dimensionless_value():
    assert {*PROPORTIONS} == {*PARAMETERS} - {"gravity"}


@pytest.mark.parametrize("name", ["lab", "B"])
def test_proportions_do_not_depend_on_units(name):
    walker, factor = WALKERS[name], 3.0
    lengths = {
        each: factor * getattr(walker, each)
        for each in PARAMETERS
        if each.partition("_")[2] in ("length", "offset", "com", "gyration", "radius")
    }
    masses = {each: 7.0 * getattr(walker, each) for each in PARAMETERS if each.endswith("mass")}
    stiff = replace(walker, hip_stiffness=0.1 * walker.units.torque)
    large = replace(walker, **lengths, **masses, gravity=2.0)
    large = replace(large, hip_stiffness=0.1 * large.units.torque)
    assert proportions(large, PROPORTIONS) == pytest.approx(proportions(stiff, PROPORTIONS))


@pytest.mark.parametrize("changes", [{"command": None}, {"reward": {"distance": 1.0}}])
def test_other_ways_to_step_show_the_body_too(changes):
    envs = vector(3, **changes)
    begun, _ = envs.reset(seed=1)
    seen, *_ = envs.step(np.zeros((3, 1)))
    assert np.array_equal(begun[:, -len(NAMES) :], seen[:, -len(NAMES) :])
    assert np.all(begun[:, -len(NAMES) :] > 0.0)


def test_walkers_without_randomization_are_observed():
    walkers = ["C", "lab"]
    envs = gym.make_vec(
        "PassiveWalker-v0", num_envs=2, walkers=walkers, observe_body=("foot_radius",),
        slope=0.036, max_episode_steps=2,
    )  # fmt: skip
    expected = [WALKERS[w].foot_radius / WALKERS[w].leg_length for w in walkers]
    seen = [envs.reset(seed=0)[0], *(envs.step(np.zeros((2, 1)))[0] for _ in range(4))]
    for each in seen:
        assert each[:, -1] == pytest.approx(expected)


def test_a_pool_is_the_same_everywhere_and_has_its_size():
    drawn = []
    for seed, count in ((0, 64), (1000, 7)):
        envs = vector(count, randomization_pool=5)
        for turn in range(3):
            envs.reset(seed=seed + 77 * turn)
            drawn.append({*envs.batch.walkers})
    assert len(set.union(*drawn)) == 5
    assert drawn[0] == set.union(*drawn)  # 64 draws of five
    larger = vector(256, randomization_pool=8)
    larger.reset(seed=3)
    assert {*larger.batch.walkers} > drawn[0]


def test_a_stride_map_shows_a_policy_the_same_as_the_environment():
    scene = make_scene("anywhere", slope=0.01, command=0.15, domain_randomization={})
    heard = []

    class Agent:
        def predict(self, observation, state=None, *_, **__):
            heard.append(np.array(observation))
            return np.zeros((len(np.atleast_2d(observation)), 1)), state

    env = gym.make("PassiveWalker-v0", scene=scene, reset_noise_scale=0.0)
    begun, _ = env.reset(seed=0)
    map_in(scene, Agent()).stride(env.unwrapped.state)
    assert np.atleast_2d(heard[0])[0] == pytest.approx(begun, rel=1e-6, abs=1e-7)


def test_explain_names_each_number():
    rows = as_rows("anywhere")["observation"]
    assert [row["observation"] for row in rows[-len(NAMES) :]] == [
        f"the walker's {name}" for name in NAMES
    ]
