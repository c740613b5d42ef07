"""A controller beside the passive walker, the best feedback and the optimum at its speed."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.envs.evaluation import comparison
from gym_passive_walker.envs.evaluation.comparison import Evaluation
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, Walks
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import ConstantTorque
from gym_passive_walker.gaits.scenes.scene import make_scene


def walks(endings, *, speed=0.15, cost=0.02):
    """Invented walks of ten leg lengths at one speed and cost."""
    n = len(endings)
    length = np.full(n, 10.0)
    return Walks(
        seeds=np.arange(n), slopes=np.zeros(n), reward=np.arange(n) * 1.0, distance=length + 0.5,
        strides=np.full(n, 20), length=length, duration=length / speed, motor_work=cost * length,
        net_work=cost * length, gravity_work=np.zeros(n), endings=endings,
    )  # fmt: skip


LASTING = [TIME_LIMIT] * 3 + ["stubbed toe"]
FALLING = ["fell forward"] * 4


def card(**least):
    """An evaluation of one controller that walks and one that falls."""
    each = {"mine": walks(LASTING), "passive": walks(FALLING)}
    costs = {"mine": 0.016, "passive": math.nan} | least
    return Evaluation(make_scene("level"), each, costs, {})


def swift(controller="steep-ppo", scene=None, **options):
    """An evaluation of few and short walks, with no search for an optimum."""
    usual = {"episodes": 2, "max_episode_steps": 20, "time_limit": 0}
    return gpw.evaluate(controller, scene, **usual | options)


def test_a_summary_counts_walks_and_falls_by_kind_with_intervals():
    mine, passive = card().summary().values()
    assert mine["walks"] == 4 and mine["reached_time_limit"].value == 0.75
    assert list(mine["falls"]) == ["stubbed toe"] and mine["falls"]["stubbed toe"].value == 0.25
    for share in (mine["reached_time_limit"], mine["falls"]["stubbed toe"]):
        assert 0.0 < share.low < share.value < share.high < 1.0
    assert passive["falls"]["fell forward"][::2] == (1.0, 1.0)
    assert passive["reached_time_limit"][:2] == (0.0, 0.0)
    assert (mine["speed"], mine["distance"], mine["strides"]) == pytest.approx((0.15, 10.5, 20))


def test_a_walk_to_the_time_limit_without_a_stride_has_no_cost_and_hides_no_other():
    mine = walks(LASTING)
    mine.length[0] = 0.0
    assert np.isnan(mine.cost_of_transport).sum() == 1
    found = Evaluation(make_scene("level"), {"mine": mine}, {"mine": 0.016}, {}).summary()["mine"]
    assert found["cost_of_transport"] == pytest.approx(0.02)


def test_a_cost_is_above_the_optimum_by_a_share_of_the_optimum():
    mine, passive = card().summary().values()
    assert mine["above_optimum"] == pytest.approx(0.02 / 0.016 - 1.0)
    assert math.isnan(passive["above_optimum"]) and math.isnan(passive["cost_of_transport"])
    assert "25.0% above that of the optimal gait" in card().in_words()
    assert "20.0% below" in card(mine=0.025).in_words()
    assert "no more than that" in card(mine=0.02).in_words()


def test_a_table_has_a_row_for_each_controller_and_intervals_of_shares(tmp_path):
    found = card()
    found.to_csv(tmp_path / "card.csv")
    with (tmp_path / "card.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["controller"] for row in rows] == ["mine", "passive"]
    assert [float(row["stubbed_toe"]) for row in rows] == [0.25, 0.0]
    assert [float(row["fell_forward"]) for row in rows] == [0.0, 1.0]
    assert float(rows[0]["reached_time_limit_low"]) == found.summary()["mine"][
        "reached_time_limit"
    ].low  # fmt: skip
    assert float(rows[0]["speed (sqrt(g l))"]) == pytest.approx(0.15)
    text = str(found)
    assert text.startswith("mine, walker 'C', slope 0 rad; 4 episodes") and "25.0%" in text
    assert "walks to the time limit 75% (30% to 95%) of 4" in repr(found)


def test_a_controller_is_compared_with_the_passive_walker_and_the_best_feedback(monkeypatch):
    """Of some constant torques in place of feedback, the one with the highest mean return."""
    torques = dict(zip(comparison.FEEDBACKS, (-0.01, 0.001, 0.02), strict=True))
    for name, torque in torques.items():
        monkeypatch.setitem(
            comparison.BASELINES, name, lambda scene, torque=torque: ConstantTorque(torque, scene)
        )
    found = swift(episodes=4)
    evaluated, passive, feedback = found.walks
    assert (evaluated, passive) == ("steep-ppo", "passive")
    rewards = {
        name: made.reward.mean()
        for name, made in swift(beside=comparison.FEEDBACKS, episodes=4).walks.items()
    }
    del rewards["steep-ppo"]
    assert feedback == max(rewards, key=rewards.get) and len({*rewards.values()}) == 3
    assert {tuple(each.seeds) for each in found.walks.values()} == {(1000, 1001, 1002, 1003)}


def test_a_scene_in_which_no_feedback_acts_has_none(monkeypatch):
    def refuses(scene):
        raise gpw.GaitNotFound("none")

    for name in comparison.FEEDBACKS:
        monkeypatch.setitem(comparison.BASELINES, name, refuses)
    assert [*swift().walks] == ["steep-ppo", "passive"]
    # Those after one that cannot act are tried.
    *_, last = comparison.FEEDBACKS
    monkeypatch.setitem(comparison.BASELINES, last, comparison.BASELINES["passive"])
    assert last in swift().walks


def test_the_optimum_is_the_stored_one_at_the_median_speed_of_walks_to_the_time_limit():
    found = swift(episodes=4)
    made = found.walks["steep-ppo"]
    speed = np.median(made.speed[made.reached_limit])
    assert found.least_cost["steep-ppo"] == optimal.least_cost("steep", speed)
    assert found.scene == make_scene("steep")
    assert "most of its walks end before the time limit" in found.no_optimum["passive"]


def test_an_optimum_that_is_not_stored_is_searched_for_once(tmp_path, monkeypatch):
    monkeypatch.setattr(optimal.cached, "cache_directory", lambda: tmp_path)
    scene, searched = make_scene(slope=0.01, control="stride"), []
    gait = optimal.load("steep")[0]  # any
    monkeypatch.setattr(
        optimal, "optimal_gait", lambda *a, **options: (searched.append(options), gait)[1]
    )
    costs = [optimal.least_cost(scene, 0.17, time_limit=7.0) for _ in range(3)]
    assert costs == [optimal.charged(gait)] * 3 and searched == [{"time_limit": 7.0}]
    held = replace(scene.walker, knees="held")
    for n, changes in enumerate(({"slope": 0.011}, {"energy": "net"}, {"walker": held}), 2):
        optimal.least_cost(make_scene(scene, **changes), 0.17)
        assert len(searched) == n
    with pytest.raises(TimeoutError, match="with time_limit=0 none is searched for"):
        optimal.least_cost(scene, 0.17, time_limit=0)


def test_an_optimum_of_a_reward_is_that_of_its_command(tmp_path, monkeypatch):
    monkeypatch.setattr(optimal.cached, "cache_directory", lambda: tmp_path)
    searched, gait = [], optimal.load("level")[0]
    monkeypatch.setattr(optimal, "optimal_gait", lambda *a, **b: (searched.append(a), gait)[1])
    monkeypatch.setattr(optimal, "_cost", lambda gait: -float(len(searched)))
    reward = {"distance": 1.0, "command": -2.0}
    scenes = [make_scene("level", reward=reward, command=command) for command in (0.1, 0.2, 0.1)]
    assert [optimal.most_reward(scene) for scene in scenes] == [1.0, 2.0, 1.0]


def test_the_least_cost_without_the_rule_of_the_toe_is_not_the_stored_one(monkeypatch):
    monkeypatch.setattr(optimal, "_searched_cost", lambda *_: 0.001)
    assert optimal.least_cost(make_scene("level"), 0.1) == optimal.least_cost("level", 0.1)
    assert optimal.least_cost(make_scene("level", end_on_toe_stub=False), 0.1) == 0.001


def test_that_there_is_no_gait_is_remembered_with_its_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(optimal.cached, "cache_directory", lambda: tmp_path)
    searched = []

    def fails(*_, **options):
        searched.append(options)
        raise gpw.GaitNotFound("no gait at that speed")

    monkeypatch.setattr(optimal, "optimal_gait", fails)
    for _ in range(2):
        with pytest.raises(gpw.GaitNotFound, match="no gait at that speed"):
            optimal.least_cost(make_scene(slope=0.01), 0.9)
    assert len(searched) == 1


def test_a_search_that_takes_too_long_is_given_up():
    with pytest.raises(TimeoutError, match=r"no optimal gait at speed .* was found in 1e-06 s"):
        gpw.optimal_gait({"slope": 0.01}, 0.15, time_limit=1e-6)
    for limit in (0, -1.0):
        with pytest.raises(ValueError, match="time_limit must be a number"):
            gpw.optimal_gait("level", 0.15, time_limit=limit)


@pytest.mark.parametrize(
    ("scene", "name"),
    [({"slope": (0.1, 0.12)}, "slope"), ({"command": (0.3, 0.35)}, "command"),
     ({"domain_randomization": {"foot_radius": 0.01}}, "domain_randomization")],
)  # fmt: skip
def test_walks_that_differ_from_each_other_have_no_one_optimum(scene, name):
    there = make_scene("steep", **scene)
    with pytest.raises(ValueError, match=f"one of a single walk, and {name} has a range"):
        comparison._least_cost(there, walks(LASTING), 0.0)


def test_a_walk_on_rough_ground_is_compared_with_the_optimum_of_smooth_ground():
    rough = make_scene("level", terrain={"rough": {"height_std": 0.001}}, action_noise=0.1)
    found = comparison._least_cost(rough, walks(LASTING), 0.0)
    assert found == optimal.least_cost("level", 0.15)


def test_feedback_walks_also_where_the_controller_observes_something_else():
    def observe(step):
        return [step.slope]

    scene, held = make_scene("steep", observation=observe), {"hip_torque": 0.01}
    own, plain = (swift(held, each, beside=["passive"]) for each in (scene, "steep"))
    for one, other in zip(own.walks.values(), plain.walks.values(), strict=True):
        np.testing.assert_array_equal(one.distance, other.distance)
    with pytest.raises(ValueError, match="this scene has another"):
        gpw.gauntlet(held, scene, walkers=1)


def test_controllers_of_one_name_are_told_apart():
    def still(observation):
        return np.zeros((len(observation), 1))

    def other(observation):
        return np.full((len(observation), 1), 0.5)

    other.__name__ = "still"
    found = swift(still, "steep", beside=[other, "passive", "passive"])
    assert [*found.walks] == ["still", "still (2)", "passive"]
    made = {name: walks.distance.tolist() for name, walks in found.walks.items()}
    assert made["still"] == made["passive"] != made["still (2)"]
    other.__name__ = "passive"  # which does not take the place of the passive walker
    found = swift(other, "steep", beside=["passive"])
    assert [*found.walks] == ["passive", "passive (2)"]
    assert found.walks["passive (2)"].distance.tolist() == made["passive"]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"episodes": 0}, "episodes must be a whole number from 1 on"),
     ({"seed": -1}, "seed must be a whole number from 0"),
     ({"max_episode_steps": 0}, "max_episode_steps must be a whole number from 1"),
     ({"time_limit": -1}, "time_limit must be a number from 0 on"),
     ({"beside": "lqr"}, 'beside must be a list of controllers, as \\["passive", "feedback"\\]'),
     ({"beside": gpw.Actuation(0.1)}, "beside must be a list of controllers"),
     ({"beside": ["lqqr"]}, r"no controller 'lqqr' \(lqr\?\)"),
     ({"controller": "nobody"}, "no policy 'nobody'"),
     ({"controller": lambda seen: seen}, "in which scene this policy acts"),
     ({"scene": "stepe"}, r"no scene 'stepe' \(steep\?\)")],
)  # fmt: skip
def test_what_cannot_be_evaluated_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        swift(**wrong)


def earning(step):
    """Distance less twice the work."""
    return step.distance - 2.0 * step.energy


def test_a_reward_of_ones_own_is_compared_with_the_most_that_a_gait_earns(tmp_path, monkeypatch):
    monkeypatch.setattr(optimal.cached, "cache_directory", lambda: tmp_path)
    scene = make_scene("steep", reward=earning)
    most = gpw.optimal_gait(scene).reward
    found = swift("steep-ppo", scene, time_limit=30.0, beside=("passive",))
    assert found.most_reward == 20 * most
    row = found.summary()["steep-ppo"]
    earned = found.walks["steep-ppo"].reward.mean()
    assert row["below_most_reward"] == pytest.approx(1.0 - earned / (20 * most))
    assert 0.0 < row["below_most_reward"] < found.below_most_reward["passive"]
    assert "below that of the gait of most reward" in found.in_words()
    monkeypatch.setattr(optimal, "optimal_gait", None)  # the result is kept
    assert optimal.most_reward(scene, time_limit=1.0) == most
    other = make_scene(scene, reward=lambda step: step.distance - 2.5 * step.energy)
    with pytest.raises(TypeError):
        optimal.most_reward(other)


def test_a_reward_without_an_optimum_says_why():
    found = swift("steep-ppo", make_scene("steep", reward=lambda step: step.time))
    assert math.isnan(found.summary()["steep-ppo"]["below_most_reward"])
    assert "not compared with the optimum: with time_limit=0" in found.in_words()
    found = swift(
        "steep-ppo", make_scene("steep", reward=lambda step: step.time), time_limit=9.0, beside=()
    )
    assert "step.time, which grows" in found.in_words()
    ends = make_scene("steep", reward=earning, terminated=lambda step: step.strides > 3)
    assert "own `terminated` may end" in swift("steep-ppo", ends, beside=()).in_words()
    assert "most_reward" not in swift().summary()["steep-ppo"]
