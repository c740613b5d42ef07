"""Evaluations and their reports."""

import csv
import math

import gymnasium
import numpy as np
import pytest

from agents import envs
from agents.config import configure
from agents.envs import training_envs
from agents.evaluation import in_words, write_rows
from agents.learner import LearnedPolicy, build, moments
from gym_passive_walker.envs.evaluation.comparison import Evaluation
from gym_passive_walker.envs.evaluation.walks import (
    TIME_LIMIT,
    Walks,
    score_table,
    simulate_episodes,
)
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.scenes.scene import make_scene


def made_up(**changes):
    """Three invented walks."""
    values = {
        "seeds": np.arange(3),
        "slopes": np.zeros(3),
        "reward": np.array([1.0, 2.0, 3.0]),
        "distance": np.array([10.0, 20.0, 0.2]),
        "strides": np.array([100, 200, 0]),
        "length": np.array([10.0, 20.0, 0.0]),
        "duration": np.array([100.0, 100.0, 0.0]),
        "motor_work": np.array([0.1, 0.1, 0.0]),
        "net_work": np.array([0.05, 0.1, 0.0]),
        "gravity_work": np.array([0.1, 0.2, 0.0]),
        "endings": [TIME_LIMIT, "fell forward", "fell forward"],
    }
    return Walks(**(values | changes))


def test_speed_and_cost_are_over_whole_strides():
    walks = made_up()
    assert walks.speed.tolist() == [0.1, 0.2, 0.0]
    assert walks.cost_of_transport[:2] == pytest.approx([0.02, 0.015])
    assert np.isnan(walks.cost_of_transport[2])
    assert walks.motor_cost[:2] == pytest.approx([0.01, 0.005])
    assert walks.gravity_cost[:2] == pytest.approx([0.01, 0.01])


def test_a_summary_has_medians_and_shares():
    summary = made_up().summary()
    assert summary["reward"] == 2.0 and summary["distance"] == 10.0
    assert made_up(reward=np.array([0.0, 1.0, 5.0])).summary()["reward"] == 2.0  # the mean
    assert summary["hundred_strides"] == pytest.approx(2 / 3)
    assert summary["reached_time_limit"] == pytest.approx(1 / 3)


def test_agents_that_never_step_can_be_summed_up():
    none = {name: np.zeros(3) for name in ("length", "duration", "motor_work", "gravity_work")}
    assert np.isnan(made_up(**none).summary()["cost_of_transport"])


def test_the_table_puts_agents_side_by_side():
    """A cost is that of walks to the time limit."""
    text = score_table("a title", {"PPO": made_up(), "passive": made_up(endings=["stalled"] * 3)})
    lines = text.splitlines()
    assert lines[0] == "a title" and "PPO" in lines[2] and "passive" in lines[2]
    assert any("fell forward" in line and "2 of 3" in line and "0 of 3" in line for line in lines)
    assert len({len(line) for line in lines[1:]}) == 1
    (line,) = (line for line in lines if line.startswith("cost of transport"))
    assert line.split()[-2:] == ["0.0200", "–"]


def test_an_evaluation_is_summed_up_in_words():
    lasting, way = {"endings": [TIME_LIMIT] * 3}, np.full(3, 10.0)
    least = optimal.least_cost("level", 0.1)
    paid = {"gravity_work": np.zeros(3), "motor_work": 1.25 * least * way}
    walks = made_up(**lasting, **paid, length=way, duration=10.0 * way)

    def said(walks, reasons=None):
        both = {"PPO": walks, "passive": made_up()}
        return in_words(
            Evaluation(
                make_scene("level"), both, {"PPO": least, "passive": math.nan}, reasons or {}
            )
        )

    with_it, cost, without = said(walks)
    assert "3 of 3 walks reach the time limit. The median walk has 100 strides" in with_it
    assert "0.100 √(g l)" in cost and "25.0% above" in cost and f"{least:.4f}" in cost
    assert "1 of 3 walks reach the time limit (fell forward: 2)" in without
    some = dict(paid)
    some |= {"endings": [TIME_LIMIT] * 2 + ["fell forward"], "length": way, "duration": 10.0 * way}
    some["motor_work"] = np.array([1.25, 1.35, 9.0]) * least * way
    assert "30.0% above" in said(made_up(**some))[1]  # without the fall
    cheap = made_up(
        **lasting, **(paid | {"motor_work": least * way}), length=way, duration=10 * way
    )
    assert "no more than" in said(cheap)[1]
    assert said(walks, {"PPO": "Its walks end in a fall."})[1] == "Its walks end in a fall."


def test_rows_hold_every_episode(tmp_path):
    write_rows(tmp_path / "rows.csv", made_up().rows("PPO"))
    with (tmp_path / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["ending"] for row in rows] == made_up().endings
    assert [float(row["distance"]) for row in rows] == [10.0, 20.0, 0.2]


class Wavering:
    """Torques that depend on the observation alone."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Torque by the angles, less by the angular velocities."""
        return 0.3 * np.sin(20.0 * observation[..., :1] + observation[..., 3:4]), state


def test_an_evaluation_tells_what_each_episode_would_be_alone():
    """Episodes end at different times; a following episode of a walker is not counted."""
    arguments = {"scene": "rolling", "energy": "positive", "max_episode_steps": 150}
    walks = simulate_episodes(
        Wavering(), gymnasium.make_vec(envs.ID, num_envs=8, **arguments), seed=40
    )
    world = gymnasium.make(envs.ID, **arguments)
    lasted = []
    for i in range(8):
        seen, _ = world.reset(seed=40 + i)
        slope, sums, over = world.unwrapped.slope, np.zeros(6), False
        steps = 0
        while not over:
            seen, reward, terminated, truncated, info = world.step(Wavering().predict(seen)[0])
            sums[0] += reward
            if info.get("outcome") == "heelstrike":
                length = info["step_length"]
                costs = (info[name] for name in ("hip_cost", "net_hip_cost", "gravity_cost"))
                sums[1:] += [length, info["step_period"], *(cost * length for cost in costs)]
            over, steps = terminated or truncated, steps + 1
        names = ("reward", "length", "duration", "motor_work", "net_work", "gravity_work")
        reported = [getattr(walks, name)[i] for name in names]
        assert reported == pytest.approx(sums, rel=1e-12, abs=1e-15)
        assert (walks.slopes[i], walks.seeds[i]) == (slope, 40 + i)
        assert walks.distance[i] == info["episode_distance"]
        assert walks.strides[i] == info["strides"]
        assert walks.endings[i] == (info["outcome"].replace("_", " ") if terminated else TIME_LIMIT)
        lasted.append(steps)
    assert min(lasted) < 75 < max(lasted) == 150


@pytest.mark.parametrize("algo", ["ppo", "ppo-fast", "sac", "shac", "shac-learned"])
def test_evaluation_changes_nothing_in_an_agent(algo):
    config = configure(algo, "level", n_envs=2)
    model = build(config, training_envs(config))
    normalizer = model.get_vec_normalize_env()
    normalizer.obs_rms.mean += 0.1
    agent, before = LearnedPolicy(model, algo), dict(moments(normalizer))
    scene = envs.scene_of(config)
    arena = gymnasium.make_vec(envs.ID, num_envs=3, scene=scene, max_episode_steps=200)
    first, again = (simulate_episodes(agent, arena, seed=0) for _ in range(2))
    assert np.array_equal(first.reward, again.reward) and first.endings == again.endings
    for name, value in moments(normalizer).items():
        assert np.array_equal(value, before[name]), name


def test_walks_are_shown_by_their_endings_and_medians():
    vectors = gymnasium.make_vec(envs.ID, num_envs=8, scene="rolling", max_episode_steps=150)
    walks = simulate_episodes(Wavering(), vectors, seed=40)
    said = repr(walks)
    assert said.startswith("<Walks: episodes 8: ") and len(said) < 250 and "\n" not in said
    for ending in set(walks.endings):
        assert f"{ending} {walks.endings.count(ending)}" in said
    assert f"distance {np.median(walks.distance):.4g}" in said and "array" not in said
