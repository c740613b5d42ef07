"""The fixed tests of a controller."""

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.evaluation.gauntlet import TESTS
from gym_passive_walker.envs.policies import shipped_policies
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene


@pytest.mark.parametrize("name", shipped_policies())
def test_every_trained_policy_can_be_tested_and_each_test_changes_its_walks(name):
    found = gpw.gauntlet(name, walkers=2)
    assert tuple(found.episodes) == tuple(TESTS)
    distances = {test: walks.distance for test, walks in found.episodes.items()}
    own = distances.pop("own scene")
    same = [test for test, others in distances.items() if np.array_equal(others, own)]
    massless = ["bodies, 5 %", "bodies, 20 %"]  # the simplest walker has nothing to vary
    known = found.scene.walker.massless_legs
    assert set(same) <= {*(massless * known), "rough, 0.002 l", "pushes, 0.02"}


def test_a_walk_has_as_many_strides_if_control_steps_are_longer_than_these():
    ticks, strides = make_scene("lab", tick=100.0), make_scene("lab", control="stride")
    same = {"reset_noise_scale": 0.1, "max_hip_torque": 0.05}
    one, other = (gpw.gauntlet("passive", make_scene(scene, **same), walkers=2).episodes
                  for scene in (ticks, strides))  # fmt: skip
    name = "pushes, 0.02"
    assert one[name].strides.tolist() == other[name].strides.tolist() == [33, 33]


def test_the_result_depends_on_the_controller_alone():
    first, again = (gpw.gauntlet("steep-ppo", walkers=4) for _ in range(2))
    np.testing.assert_array_equal(first.columns()["distance"], again.columns()["distance"])
    more = gpw.gauntlet("steep-ppo", walkers=6)
    for test, walks in first.episodes.items():
        np.testing.assert_array_equal(more.episodes[test].distance[:4], walks.distance)
    policy = gpw.gauntlet(gpw.load_policy("steep-ppo"), walkers=4)
    np.testing.assert_array_equal(policy.survival, first.survival)


def test_the_score_is_the_mean_survival_within_its_interval():
    found = gpw.gauntlet("steep-sac", walkers=8)
    ended = [walks.endings.count("reached the time limit") / 8 for walks in found.episodes.values()]
    np.testing.assert_array_equal(found.survival, ended)
    low, high = found.score_interval
    assert 0.0 < low < found.score < high < 1.0
    assert found.score == pytest.approx(np.mean(ended))
    inside = (found.survival_interval[:, 0] <= found.survival) & (
        found.survival <= found.survival_interval[:, 1]
    )
    assert inside.all()
    said = str(found)
    assert said.startswith("steep-sac, walker 'C': 8 walks of 100 sqrt(l/g) in each test")
    assert f"score {found.score:.3f}" in repr(found) and all(test in said for test in TESTS)


def test_a_walker_without_a_motor_and_a_controller_of_one_s_own_can_be_tested():
    lab = make_scene("lab")
    passive = gpw.gauntlet(Passive(), lab, walkers=4)
    assert passive.controller_name == "passive" and passive.survival[0] > 0.0
    assert passive.episodes["own scene"].motor_work.max() == 0.0
    with pytest.raises(ValueError, match="say in which scene"):
        gpw.gauntlet(Passive())
    with pytest.raises(ValueError, match="walkers"):
        gpw.gauntlet("steep-ppo", walkers=0)
    with pytest.raises(SceneError, match="no scene"):
        gpw.gauntlet("steep-ppo", "moon")


def angles(step):
    """An observation of the user's own."""
    return step.state


def test_noise_that_an_observation_of_one_s_own_does_not_have_is_no_test():
    found = gpw.gauntlet("passive", make_scene("lab", observation=angles), walkers=1)
    assert [test for test in TESTS if test not in found.episodes] == [
        "observation noise, 0.01", "observation noise, 0.03",
    ]  # fmt: skip
