"""How large disturbances a user's own system withstands."""

import dataclasses

import numpy as np

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.envs.evaluation.robustness import _Tries
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.own.statements import COMPASS, DRIVEN, STRAIGHT

SLOPE = 0.03
FEW = {"slope": SLOPE, "walkers": 100, "strides": 20, "roughness": 0.001, "starts": 64}


def test_a_compass_stated_by_its_masses_is_as_robust_as_the_package_s_own():
    found, expected = (gpw.robustness(walker, **FEW) for walker in (COMPASS, STRAIGHT))
    for name in ("step_length", "step_period", "sensitivity", "period_response"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-7, atol=1e-7, err_msg=name
        )
    # The two differ in which feet that pass each other near the ground touch it.
    np.testing.assert_allclose(found.survivors, expected.survivors, atol=0.02)
    assert found.step_up == expected.step_up and found.step_down == expected.step_down


def test_starts_off_the_gait_have_both_feet_down():
    tries = _Tries(None, make_scene({"system": TORSO}))
    tries.gait = gpw.find_gait(TORSO, SLOPE).state
    near = tries.near(0.3, 50, seed=1)
    half = TORSO.coordinates
    foot = [float(TORSO.landing(TORSO.body, TORSO.State(*state))[1]) for state in near]
    np.testing.assert_allclose(foot, 0.0, atol=1e-9)
    share = near[:, half:] / tries.gait[half:]
    assert share.min() >= 0.7 and share.max() <= 1.3 and np.std(share) > 0.1


def test_a_feedback_changes_what_a_system_withstands():
    def held(seen):
        return 0.02 * np.ones((len(seen), 1))

    scene = {"system": DRIVEN, "slope": SLOPE, "control": "stride"}
    driven = gpw.robustness(gpw.stride_map(controller=held, scene=scene), **FEW)
    passive = gpw.robustness(DRIVEN, **FEW)
    assert driven.controller_name == "held" and passive.controller_name == "passive"
    assert driven.step_length > passive.step_length
    assert driven.step_down != passive.step_down
    names = {field.name for field in dataclasses.fields(gpw.Robustness)}
    assert names == set(vars(driven))
