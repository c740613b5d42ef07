"""Evaluations, and what is said of them."""

import csv

import numpy as np
import pytest

from agents import worlds
from agents.config import configure
from agents.evaluation import write_rows
from gym_passive_walker.control.baselines import Passive
from gym_passive_walker.control.walks import WALKED_ON, Walks, evaluate, table


def made_up(**changes):
    """Three walks."""
    values = {
        "seeds": np.arange(3),
        "slopes": np.zeros(3),
        "reward": np.array([1.0, 2.0, 3.0]),
        "distance": np.array([10.0, 20.0, 0.2]),
        "strides": np.array([100, 200, 0]),
        "length": np.array([10.0, 20.0, 0.0]),
        "duration": np.array([100.0, 100.0, 0.0]),
        "hip_work": np.array([0.1, 0.1, 0.0]),
        "net_work": np.array([0.05, 0.1, 0.0]),
        "gravity_work": np.array([0.1, 0.2, 0.0]),
        "endings": [WALKED_ON, "fell forward", "fell forward"],
    }
    return Walks(**(values | changes))


def test_speed_and_cost_are_over_whole_strides():
    walks = made_up()
    assert walks.speed.tolist() == [0.1, 0.2, 0.0]
    assert walks.cost_of_transport[:2] == pytest.approx([0.02, 0.015])
    assert np.isnan(walks.cost_of_transport[2])
    assert walks.hip_cost[:2] == pytest.approx([0.01, 0.005])
    assert walks.net_hip_cost[:2] == pytest.approx([0.005, 0.005])
    assert walks.gravity_cost[:2] == pytest.approx([0.01, 0.01])


def test_a_summary_has_medians_and_shares():
    summary = made_up().summary()
    assert summary["reward"] == 2.0 and summary["distance"] == 10.0
    assert summary["hundred_strides"] == pytest.approx(2 / 3)
    assert summary["walked_on"] == pytest.approx(1 / 3)


def test_agents_that_never_step_can_be_summed_up():
    none = {name: np.zeros(3) for name in ("length", "duration", "hip_work", "gravity_work")}
    assert np.isnan(made_up(**none).summary()["cost_of_transport"])


def test_the_table_puts_agents_side_by_side():
    text = table("a title", {"PPO": made_up(), "passive": made_up(endings=["stalled"] * 3)})
    lines = text.splitlines()
    assert lines[0] == "a title" and "PPO" in lines[2] and "passive" in lines[2]
    assert any("fell forward" in line and "2 of 3" in line and "0 of 3" in line for line in lines)
    assert len({len(line) for line in lines[1:]}) == 1


def test_rows_hold_every_episode(tmp_path):
    write_rows(tmp_path / "rows.csv", made_up().rows("PPO"))
    with (tmp_path / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["ending"] for row in rows] == made_up().endings
    assert [float(row["distance"]) for row in rows] == [10.0, 20.0, 0.2]


def test_episodes_are_the_same_for_every_agent_and_every_crowd():
    config = configure(env={"slope": [0.02, 0.04]})
    few, many = (evaluate(Passive(), worlds.arena(config, n), seed=3) for n in (2, 5))
    for name in ("slopes", "distance", "strides", "reward", "duration"):
        assert np.array_equal(getattr(few, name), getattr(many, name)[:2])
    assert few.endings == many.endings[:2]


def test_a_passive_walk_costs_the_sine_of_its_slope():
    config = configure(scene="lab", env={"perturbation": 0.02})
    walks = evaluate(Passive(), worlds.arena(config, 2), seed=0)
    assert walks.endings == [WALKED_ON] * 2
    assert walks.cost_of_transport == pytest.approx(np.sin(0.036), rel=1e-3)
    assert walks.hip_work.tolist() == [0.0, 0.0]
    # Distance counts the stride under way, the strides only what they completed.
    assert np.all(np.abs(walks.distance - walks.length) < 1.0)
