"""Walkers of which the trailing knee stays locked during the heelstrike, and is free after it."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.batch import Batch, SceneError
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.equations import kneed, straight
from gym_passive_walker.models.equations.hybrid import State
from gym_passive_walker.models.walkers import WalkerError

FREE = gpw.WALKERS["lab"]
HELD = replace(FREE, knees="held")
SLOPE = 0.036


@pytest.fixture(scope="module")
def gait():
    return gpw.find_gait(HELD, SLOPE)


def test_the_impact_that_frees_the_knee_loses_less_by_the_energy_of_the_difference():
    """Both are projections in the metric of the mass matrix, and one is within the other."""
    rng, body = np.random.default_rng(3), FREE.body
    for _ in range(20):
        angle, rates = rng.uniform(0.1, 0.4), -rng.uniform(0.3, 1.5, 2)
        before = State(-angle, angle, angle, rates[0], rates[1], rates[1])
        held, free = straight.heelstrike(body, before), kneed.heelstrike(body, before)
        assert held.after[5] == held.after[4] and held.after[:3] == free.after[:3]
        apart = np.subtract(free.after[3:], held.after[3:])
        matrix = np.zeros((3, 3))
        matrix[np.triu_indices(3)] = kneed.mass_matrix(body, free.after)
        matrix += np.triu(matrix, 1).T
        assert held.lost - free.lost == pytest.approx(0.5 * apart @ matrix @ apart, rel=1e-9)


def test_a_gait_begins_with_a_straight_leg_and_bends_it_afterwards(gait):
    walk = gpw.simulate(HELD, SLOPE, strides=1, samples=200)
    assert gait.state[5] == gait.state[4] and gait.stable
    angles = walk.states[:, 1] - walk.states[:, 2]
    assert angles.max() > 0.1 and angles.min() > -1e-12
    free = gpw.find_gait(FREE, SLOPE)
    assert abs(free.state[5] / free.state[4]) > 4.0


def test_the_shank_of_a_light_leg_begins_at_another_rate():
    light = gpw.Walker(
        thigh_length=0.5, shank_length=0.5, thigh_mass=0.5, shank_mass=0.05, thigh_com=0.325,
        shank_com=0.125, hip_mass=0.5, knees="held",
    )  # fmt: skip
    held, free = (gpw.find_gait(replace(light, knees=knees), 0.0504) for knees in ("held", True))
    assert held.state[5] == pytest.approx(-0.057, abs=5e-4)
    assert free.state[5] == pytest.approx(-3.716, abs=5e-4)
    assert held.stable and free.stable


def test_its_energy_is_in_balance_and_the_collision_matrix_has_its_loss(gait):
    lost = gait.collision_loss
    assert gait.cost_of_transport == pytest.approx(np.sin(SLOPE), rel=1e-11)
    assert lost == pytest.approx(gait.weight * gait.step_length * np.sin(SLOPE), rel=1e-11)
    velocity = np.array(gpw.foot_velocity(gait))
    matrix = gpw.collision_matrix(gait)
    assert 0.5 * velocity @ matrix @ velocity == pytest.approx(gait.mean.heelstrike_loss, rel=1e-9)
    more = matrix - gpw.collision_matrix(FREE, gait.stance_angle)
    assert np.linalg.eigvalsh(more).min() > -1e-12  # more of it stops


def test_its_derivatives_are_those_of_its_strides(gait):
    strides, shift = gait.stride_map, 1e-6
    point = gait.point.values
    _, change = strides.linearize(point)
    for i, way in enumerate(np.eye(4)):
        ends = strides.apply(point + np.outer([shift, -shift], way)).ends
        difference = (ends[0] - ends[1]) / (2 * shift)
        np.testing.assert_allclose(difference, change.ends[0, :, i], atol=1e-8)


def test_environments_walk_as_the_stride_map_does(gait):
    given = {"walker": HELD, "slope": SLOPE, "control": "stride", "reset_noise_scale": 0.0}
    env = gymnasium.make("PassiveWalker-v0", **given)
    first, _ = env.reset(seed=1)
    again, _, terminated, _, info = env.step(np.zeros(1))
    np.testing.assert_allclose(again, first, atol=1e-6)
    assert not terminated and info["speed"] == pytest.approx(gait.froude_speed, rel=1e-6)
    ticks = gymnasium.make("PassiveWalker-v0", **given | {"control": "tick"})
    ticks.reset(seed=1)
    while "step_length" not in (info := ticks.step(np.zeros(1))[-1]) or not info["step_length"]:
        pass
    assert info["speed"] == pytest.approx(gait.froude_speed, rel=1e-6)
    with pytest.raises(SceneError, match="must be of one kind"):
        Batch(make_scene("lab"), 2, walkers=[FREE, HELD])


def test_it_is_another_kind_of_walker():
    with pytest.raises(WalkerError, match="knees must be True, False or 'held', not 'locked'"):
        replace(FREE, knees="locked")
    with pytest.raises(WalkerError, match="of which `knees` differs"):
        gpw.interpolate(FREE, HELD, 0.5)
    assert eval(repr(HELD), {"Walker": gpw.Walker}) == HELD != FREE
