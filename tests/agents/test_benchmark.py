"""The benchmark of agents: scores, tables, perturbations and rough ground."""

import json
import math
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import scipy.stats

import train
from agents import benchmark, evaluation, files, results
from agents.benchmark import Unit
from agents.commands import run_benchmark
from agents.config import ConfigError, configure
from agents.training import Run
from gym_passive_walker import closed_loop_gait, find_gait
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import LinearFeedback, Optimal, Passive
from gym_passive_walker.gaits.scenes.scene import make_scene
from tests.control.in_environment import walked


def score(agent="ppo", seed=0, scene="level", **changes):
    """An invented score."""
    values = {name: 0.1 for name in benchmark.SCORES}
    values |= {"reached_time_limit": 0.9, "endings": {"reached the time limit": 9, "stalled": 1}}
    return {"scene": scene, "agent": agent, "seed": seed} | values | changes


def test_agents_that_learn_have_seeds_and_a_range_of_slopes_has_no_optimum():
    todo = benchmark.units(["level", "rolling"], ["passive", "optimal", "sac"], 2)
    assert todo == [
        Unit("level", "passive", 0), Unit("level", "optimal", 0), Unit("level", "sac", 0),
        Unit("rolling", "passive", 0), Unit("rolling", "sac", 0),
        Unit("level", "sac", 1), Unit("rolling", "sac", 1),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("scenes", "agents", "seeds", "words"),
    [(["moon"], ["sac"], 1, "level"), (["lab"], ["dqn"], 1, "deadbeat"), ([], [], 0, "seed")],
)
def test_nonsense_is_refused(scenes, agents, seeds, words):
    with pytest.raises(ConfigError, match=words):
        benchmark.units(scenes, agents, seeds)


def test_what_is_done_is_not_done_again(tmp_path, monkeypatch):
    measured = []

    def measure(folder, unit, budget):
        measured.append(unit)
        if len(measured) == 2:
            raise KeyboardInterrupt
        return score(unit.agent, unit.seed, unit.scene)

    monkeypatch.setattr(benchmark, "measure", measure)
    todo = benchmark.units(["lab"], ["passive", "lqr", "constant"], 1)
    with pytest.raises(KeyboardInterrupt):
        benchmark.run(tmp_path, todo, progress=False)
    benchmark.run(tmp_path, todo, progress=False)
    assert measured == [todo[0], todo[1], todo[1], todo[2]]
    assert len(benchmark.load_scores(tmp_path)) == 3


def test_scores_of_another_budget_are_not_mixed_with_these(tmp_path, monkeypatch):
    """Nor is a training that was interrupted continued with it."""
    monkeypatch.setattr(
        benchmark, "measure", lambda folder, unit, budget: score("ppo") | {"budget": budget}
    )
    (ppo,) = benchmark.units(["lab"], ["ppo"], 1)
    run = partial(benchmark.run, tmp_path, [ppo], progress=False)
    run(budget=0.5)
    run(budget=0.5)
    with pytest.raises(ConfigError, match=r"another --budget \(0.5\) than 1: give that one"):
        run()
    monkeypatch.undo()
    path = benchmark.score_path(tmp_path, ppo)
    path.write_text(json.dumps(score("ppo")))
    with pytest.raises(ConfigError, match="one not known"):
        run(budget=0.5)
    path.unlink()
    half = configure("ppo", "lab", steps=configure("ppo", "lab").steps // 2)
    (tmp_path / "runs" / str(ppo)).mkdir(parents=True)
    half.save(tmp_path / "runs" / str(ppo) / files.CONFIG)
    with pytest.raises(ConfigError, match="is another run:\n  steps"):
        run()


@pytest.mark.parametrize("progress", [True, False])
def test_a_benchmark_shows_its_progress_unless_it_is_quiet(progress, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "measure", lambda folder, unit, budget: score(unit.agent))
    benchmark.run(tmp_path, [Unit("lab", "passive", 0)], progress=progress)
    assert ("lab-passive-0" in capsys.readouterr().err) == progress


@pytest.fixture(scope="module")
def optimal_score():
    """The score of the optimal gait's policy on level ground, over few episodes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(benchmark, "EPISODES", 6)
        return benchmark.scores_of(Optimal("level"), "level")


def test_the_policy_of_the_optimal_gait_costs_about_as_much(optimal_score):
    assert optimal_score["reached_time_limit"] == 1.0
    assert 0.0 < optimal_score["above_optimum"] < 0.1


def test_work_is_driving_and_braking(optimal_score):
    hip, net = optimal_score["hip_cost"], optimal_score["net_hip_cost"]
    drives = optimal_score["positive_hip_cost"]
    assert net == pytest.approx(drives - (hip - drives), rel=1e-12)
    assert 0.0 < net < drives < hip
    assert optimal_score["cost_of_transport"] == hip + optimal_score["gravity_cost"]


def test_velocity_perturbations_are_reported_forward_and_backward(optimal_score):
    gait = closed_loop_gait(Optimal("level"), "level")
    reported = optimal_score["perturbation_forward"], optimal_score["perturbation_backward"]
    assert reported == benchmark.largest_perturbations(gait) and reported[0] != reported[1]


def test_a_passive_walker_costs_at_a_speed_what_its_slope_pays_whichever_gait_was_found_first():
    slopes, speeds = np.array([0.02, 0.01, 0.03]), np.array([0.2, 0.15, 0.25])
    family = SimpleNamespace(slope=slopes, froude_speed=speeds)
    assert results._cost_at(family, 0.175) == pytest.approx(math.sin(0.015))
    assert results._cost_at(family, 0.25) == pytest.approx(math.sin(0.03))
    assert math.isnan(results._cost_at(family, 0.1))


def test_a_walk_on_level_ground_is_compared_with_the_passive_walker_at_its_speed():
    gait = find_gait("C", 0.01)
    walks = {"speed": gait.froude_speed, "cost_of_transport": 0.02}
    scores = [
        score("passive", reached_time_limit=0.0), score("lqr", **walks), score("lqr", scene="lab"),
    ]  # fmt: skip
    assert list(results.walking_on_level_ground(scores)) == ["lqr"]
    *_, line = results.equal_speeds(scores).splitlines()
    least = optimal.least_cost(optimal.load("level"), gait.froude_speed)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == [
        "lqr", f"{gait.froude_speed:.3f}", "0.0200", f"{least:.4f}", f"{math.sin(0.01):.4f}"
    ]  # fmt: skip


def test_walks_that_mostly_end_in_a_fall_have_no_cost():
    """Their strides use up the energy of the initial state: costs can be negative."""
    energy = {"cost_of_transport": -0.0012, "gravity_cost": -0.0012, "speed": 0.0383}
    for share, cost in ((0.0, "–"), (0.49, "–"), (0.5, "-0.0012")):
        scores = [score("passive", reached_time_limit=share, **energy)]
        rows = dict(line.split(" | ") for line in results.tables(scores).splitlines()[2:7])
        assert rows["| speed / √(gl)"] == "0.038 |"
        assert rows.get("| cost of transport, absolute work", "– |") == f"{cost} |"
        assert bool(results.walking_on_level_ground(scores)) == (cost != "–")


def test_rank_tests_are_those_of_scipy_for_each_pair_of_trained_agents():
    draws = np.random.default_rng(0).normal(size=(2, 2, 6))
    scores = [
        score(agent, seed, reward=draws[0, i, seed], above_optimum=draws[1, i, seed])
        for i, agent in enumerate(("ppo", "shac"))
        for seed in range(6)
    ]
    *_, row = results.rank_tests([*scores, score("lqr")]).splitlines()
    p, beside = (scipy.stats.mannwhitneyu(*draws[i]).pvalue for i in (0, 1))
    assert row == f"| `level` | ppo and shac | {p:.2g} | {beside:.2g} |"
    assert p != beside and row in results.tables(scores)
    for each in scores[:4]:
        each["above_optimum"] = math.nan  # two are left
    assert results.rank_tests(scores).endswith(f"| {p:.2g} | – |")
    assert results.rank_tests([s for s in scores if s["seed"] < 2]) == ""


def test_raw_scores_are_read_as_they_were_written(tmp_path, capsys):
    scores = [score("passive"), score("ppo", 3, reward=1.23456, above_optimum=math.nan)]
    results.write_csv(tmp_path / "scores.csv", scores)
    first, second = results.read_csv(tmp_path / "scores.csv")
    assert (second["scene"], second["agent"], second["seed"]) == ("level", "ppo", 3)
    assert second["reward"] == 1.23456 and math.isnan(second["above_optimum"])
    assert first.keys() == scores[0].keys() - {"endings"}
    line = ["benchmark", "--tables", str(tmp_path / "scores.csv")]
    assert train.main(line) == 0
    assert capsys.readouterr().out == results.tables([first, second]) + "\n"
    page = tmp_path / "page.md"
    page.write_text(f"{results.BEGIN}\n{results.END}\n")
    assert train.main([*line, "--document", str(page)]) == 2
    assert "--document requires" in capsys.readouterr().err
    (tmp_path / "scores.csv").write_text("scene,agent\nlevel,ppo\n")
    assert train.main(line) == 2 and "scores.csv is damaged" in capsys.readouterr().err


def test_the_published_tables_are_those_of_the_published_scores():
    docs = Path(__file__).parents[2] / "docs"
    page = (docs / "agents.md").read_text(encoding="utf-8").partition(results.BEGIN)[2]
    scores = results.read_csv(docs / "agents-scores.csv")
    for text in (results.rank_tests(scores), results.equal_speeds(scores)):
        assert text in page
    page = page.partition(results.END)[0]
    assert "-0.0000" not in page and "-0%" not in page


def test_the_command_compares_and_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark, "EPISODES", 6)
    line = ["benchmark", "--quiet", "--out", str(tmp_path)]
    assert train.main([*line, *"--scenes lab --agents passive".split()]) == 0
    said = capsys.readouterr().out
    assert "| `lab` | passive |" in said
    kept = json.loads((tmp_path / "scores" / "lab-passive-0.json").read_text())
    assert kept["hundred_strides"] > 0.5
    assert (tmp_path / "scores.csv").read_text().startswith("scene,agent,seed,distance")
    assert train.main([*line, "--tables"]) == 0
    assert capsys.readouterr().out == said


@pytest.mark.learning
def test_an_agent_learns_and_is_evaluated(tmp_path, capsys):
    line = "benchmark --scenes steep --agents ppo --seeds 1 --budget 0.01 --quiet --out"
    assert train.main([*line.split(), str(tmp_path)]) == 0
    kept = json.loads((tmp_path / "scores" / "steep-ppo-0.json").read_text())
    assert kept["learning_steps"] >= 8192 and kept["learning_seconds"] > 0.0


@pytest.mark.learning
@pytest.mark.parametrize(
    ("algo", "steps", "best", "walks"),
    [("ppo-fast", 200_000, 35.0, 16), ("shac", 100_000, 45.0, 20),
     ("shac-learned", 100_000, 45.0, 18)],
)  # fmt: skip
def test_an_algorithm_learns_to_walk_on_the_level(algo, steps, best, walks, tmp_path):
    """In a thirtieth of PPO's steps; passive walkers return 5, a constant torque 27, PPO 51."""
    run = Run(configure(algo, "level", steps=steps, every=steps), tmp_path)
    assert run.train(progress=False)
    assert run.notes["best"] > best
    _, rows = evaluation.evaluate_policy(tmp_path)
    own = [row for row in rows if row["agent"] == algo.upper()]
    assert len(own) == 20 and sum(row["ending"] == TIME_LIMIT for row in own) >= walks


def test_a_document_without_marks_is_refused_before_anything_is_computed(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "run", lambda *_, **__: pytest.fail("it computes"))
    page = tmp_path / "page.md"
    page.write_text("no marks")
    for document in (page, tmp_path / "none.md"):
        with pytest.raises(ConfigError, match=document.name):
            run_benchmark(["--out", str(tmp_path), "--document", str(document)])


def test_feedback_survives_larger_perturbations_than_nothing():
    nothing, held = (
        benchmark.largest_perturbations(closed_loop_gait(p, "steep"))
        for p in (Passive(), LinearFeedback("steep"))
    )
    assert nothing.forward < held.forward and nothing.backward < held.backward


def test_the_largest_perturbation_is_survived_and_a_larger_one_is_not():
    """A forward perturbation accelerates the stance leg; perturbations differ by 1 %."""
    gait = closed_loop_gait(LinearFeedback("steep"), "steep")
    found = benchmark.largest_perturbations(gait)
    assert 0.0 < found.backward < found.forward < 1.0

    def walks_on(share):
        points = gait.stride_map.points_at(gait.state)
        points[0, 1] *= 1.0 + share
        return bool(np.isfinite(walked(gait.stride_map, points, 20).ends).all())

    for way, largest in ((1.0, found.forward), (-1.0, found.backward)):
        survived = [walks_on(way * share) for share in np.arange(0.01, largest + 0.015, 0.01)]
        assert survived == [True] * (len(survived) - 1) + [False]


def test_feedback_over_all_torques_goes_farther_on_rough_ground():
    scene = make_scene("level")
    nothing, optimal = (
        benchmark.rough_strides(p, scene, walkers=30) for p in (Passive(), Optimal("level"))
    )
    assert nothing < 10 < 100 < optimal


class Looking:
    """A policy with torques by the observed slope, and a little by the state."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Brake downhill, drive uphill."""
        return np.clip(1.5 - 40.0 * observation[..., 7:], -1.0, 1.0), state


@pytest.mark.parametrize(
    ("policy", "name", "asked"), [(Passive(), "steep", {"seed": 3}), (Looking(), "lab", {})]
)
def test_over_rough_ground_each_walker_goes_as_it_would_alone(policy, name, asked):
    """Each walker has its own slopes and observes them; after a fall it makes no more strides."""
    scene, walkers, seed = make_scene(name, control="stride"), 5, asked.get("seed", 0)
    rng, made = np.random.default_rng(seed), []
    slopes = rng.normal(scene.slope, benchmark.ROUGHNESS, (400, walkers))
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
    assert benchmark.rough_strides(policy, scene, walkers=walkers, **asked) == np.mean(made)
    assert len(set(made)) > 2
