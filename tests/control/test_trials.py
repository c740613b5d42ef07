"""Kicks and rough ground."""

import gymnasium
import numpy as np
import pytest

from gym_passive_walker.control.baselines import LinearFeedback, Optimal, Passive
from gym_passive_walker.control.closed_loop import closed_loop_gait, policy_strides
from gym_passive_walker.control.trials import ROUGHNESS, kicks, rough_strides
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


def test_the_largest_kick_is_survived_and_a_larger_one_is_not():
    """A kick forward makes the stance leg faster; one in a hundred is as finely as is looked."""
    gait = closed_loop_gait(LinearFeedback("steep"), "steep")
    found = kicks(gait)
    assert 0.0 < found.backward < found.forward < 1.0

    def walks_on(share):
        points = gait.point.copy()[None]
        points[0, 1] *= 1.0 + share
        return np.isfinite(
            policy_strides(gait.policy, gait.scene, gait.slope, points, 20).ends
        ).all()

    for way, largest in ((1.0, found.forward), (-1.0, found.backward)):
        survived = [walks_on(way * share) for share in np.arange(0.01, largest + 0.015, 0.01)]
        assert survived == [True] * (len(survived) - 1) + [False]


class Looking:
    """A policy that pushes by the slope that it sees, and a little by chance of where it is."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Brake downhill, drive uphill."""
        return np.clip(1.5 - 40.0 * observation[..., 7:], -1.0, 1.0), state


@pytest.mark.parametrize(("policy", "name"), [(Passive(), "steep"), (Looking(), "lab")])
def test_over_rough_ground_each_walker_goes_as_it_would_alone(policy, name):
    """Each meets its own slopes, sees them, and makes no more strides once it has fallen."""
    scene, walkers, seed = make_scene(name, control="stride"), 5, 3
    rng, made = np.random.default_rng(seed), []
    slopes = rng.normal(scene.slope, ROUGHNESS, (400, walkers))
    for i in range(walkers):
        world = gymnasium.make("PassiveWalker-v0", scene=scene, max_episode_steps=-1).unwrapped
        seen, _ = world.reset(seed=seed + i)
        strides, fallen = 0, False
        while not fallen and strides < 300:
            seen, _, fallen, _, info = world.step(policy.predict(seen)[0])
            if info.get("outcome") == "heelstrike":
                seen = world.set_slope(slopes[strides, i])
                strides += 1
        made.append(strides)
    assert rough_strides(policy, scene, walkers=walkers, seed=seed) == np.mean(made)
    assert len(set(made)) > 2


def test_rough_ground_is_the_same_for_everyone():
    first, again = (rough_strides(Passive(), make_scene("lab"), walkers=10) for _ in range(2))
    assert first == again
