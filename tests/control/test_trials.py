"""Kicks and rough ground."""

from gym_passive_walker.control.baselines import LinearFeedback, Optimal, Passive
from gym_passive_walker.control.closed_loop import closed_loop_gait
from gym_passive_walker.control.trials import kicks, rough_strides
from gym_passive_walker.envs.scene import make_scene


def test_feedback_survives_harder_kicks_than_nothing():
    nothing, held = (
        kicks(closed_loop_gait(p, "steep")) for p in (Passive(), LinearFeedback("steep"))
    )
    assert nothing.forward < held.forward and nothing.backward < held.backward


def test_feedback_over_all_torques_goes_farther_on_rough_ground():
    scene = make_scene("level")
    nothing, optimal = (rough_strides(p, scene, walkers=30) for p in (Passive(), Optimal("level")))
    assert nothing < 10 < 100 < optimal


def test_rough_ground_is_the_same_for_everyone():
    first, again = (rough_strides(Passive(), make_scene("lab"), walkers=10) for _ in range(2))
    assert first == again
