"""Tables, files and pictures of a benchmark against plain arithmetic over invented scores."""

import csv
import json
import math
import subprocess
from datetime import date
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from agents import benchmark, results
from agents.benchmark import AGENTS, SCORES, Unit
from agents.config import ALGORITHMS, configure
from agents.files import ConfigError
from gym_passive_walker import GaitNotFound
from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, Walks
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.scenes.scene import SCENES


def invented(unit, number):
    """A score with another value for each of its entries and each number."""
    values = {name: 0.1 + 0.013 * i + 0.37 * number for i, name in enumerate(SCORES)}
    ends = {TIME_LIMIT: 3 + number, "fell forward": 2, "stalled": 1 + 4 * number}
    return {**unit._asdict(), **values, "reached_time_limit": 1.0, "endings": ends}


UNITS = [
    Unit("steep", "sac", 1), Unit("level", "sac", 0), Unit("steep", "lqr", 0),
    Unit("level", "ppo", 10), Unit("level", "ppo", 9), Unit("level", "passive", 0),
    Unit("steep", "sac", 0), Unit("level", "ppo", 0),
]  # fmt: skip
INVENTED = [invented(unit, i) for i, unit in enumerate(UNITS)]


def plain_middle(values):
    """Mean of the middle half of some numbers: a quarter of them is dropped at each end."""
    values = sorted(values)
    dropped = len(values) // 4
    kept = values[dropped : len(values) - dropped]
    return sum(kept) / len(kept)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 8, 10, 25])
def test_the_interquartile_mean_is_the_mean_of_the_middle_half(count):
    values = np.random.default_rng(count).standard_cauchy(count)
    assert results.middle(values) == pytest.approx(plain_middle(values), rel=1e-12)


def test_the_interquartile_mean_of_a_matrix_is_along_its_axis():
    values = np.random.default_rng(0).standard_cauchy((5, 8))
    by_row, by_column = results.middle(values), results.middle(values, axis=0)
    assert by_row == pytest.approx([plain_middle(row) for row in values])
    assert by_column == pytest.approx([plain_middle(column) for column in values.T])


def test_the_interval_is_the_95_percent_bootstrap_of_the_interquartile_mean():
    shares = []
    for seed in range(8):
        values = np.random.default_rng(seed).gamma(2.0, 3.0, 30)
        drawn = np.sort(np.random.default_rng(9).choice(values, (20_000, 30)))
        low, high = np.percentile(drawn[:, 7:-7].mean(axis=1), [2.5, 97.5])
        found = results.interval(values)
        assert found == results.interval(values)  # a fixed seed
        assert found == pytest.approx((low, high), abs=0.1 * (high - low))
        shares.append((found[1] - found[0]) / (high - low))
    assert np.mean(shares) == pytest.approx(1.0, abs=0.05)  # of 90 %, it would be 0.84


def test_three_seeds_have_an_interval_and_two_have_none():
    low, high = results.interval(np.array([1.0, 2.0, 4.0]))
    assert 1.0 <= low < high <= 4.0
    assert all(map(math.isnan, results.interval(np.array([1.0, 2.0]))))
    assert all(map(math.isnan, results.interval(np.array([1.0, 1.0]))))
    assert results.interval(np.array([5.0, 5.0, 5.0])) == (5.0, 5.0)


@pytest.mark.parametrize(
    ("values", "form", "shown"),
    [
        ([0.5], ".0%", "50%"), ([math.nan, None], ".1f", "–"),
        ([1.0, 1.0, 1.0], ".1f", "1.0 [1.0, 1.0]"),
        ([None, math.inf, 2.0, math.nan, 4.0], ".2f", "3.00"),
        ([-0.001], ".0%", "0%"), ([-0.01], ".0%", "-1%"),
        ([-1e-6, -2e-6, -3e-6], ".4f", "0.0000 [0.0000, 0.0000]"),
    ],
)  # fmt: skip
def test_a_cell_shows_what_is_known_in_its_form_and_a_zero_without_sign(values, form, shown):
    assert results.cell(values, form) == shown


def test_a_cell_of_three_seeds_has_their_interval():
    low, high = results.interval(np.array([1.0, 2.0, 4.0]))
    shown = results.cell([1.0, math.nan, 2.0, None, 4.0], ".3f")
    assert shown == f"{7 / 3:.3f} [{low:.3f}, {high:.3f}]"


def test_scores_are_grouped_by_agent_in_the_order_of_the_agents():
    found = results.by_agent(INVENTED)
    assert list(found) == [agent for agent in AGENTS if agent in {u.agent for u in UNITS}]
    for agent, own in found.items():
        assert own == [score for score in INVENTED if score["agent"] == agent]


def rows_of(table):
    """Cells of a Markdown table, as rows."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]


def test_every_row_of_every_table_shows_its_own_score_of_each_agent():
    """Scenes in the package's order, and a column for each agent that has scores there."""
    *found, _ = results.tables(INVENTED).split("\n\n")
    scenes = [scene for scene in SCENES if scene in {unit.scene for unit in UNITS}]
    assert len(found) == len(scenes) == 2
    for table, scene in zip(found, scenes, strict=True):
        head, rule, *lines = rows_of(table)
        own = results.by_agent([s for s in INVENTED if s["scene"] == scene])
        seeds = {agent: f" ({len(s)} seed{'' if len(s) == 1 else 's'})" for agent, s in own.items()}
        assert head[0] == f"`{scene}`" and rule == ["---"] * len(head)
        assert head[1:] == [a + seeds[a] if a in ALGORITHMS else a for a in own]
        assert [line[0] for line in lines] == [label.strip() for _, label, _ in results.ROWS] + [
            "falls"
        ]
        for (name, _, form), line in zip(results.ROWS, lines, strict=False):
            means = [f"{plain_middle([s[name] for s in each]):{form}}" for each in own.values()]
            assert [cell.split(" [")[0] for cell in line[1:]] == means, name
        assert lines[-1][1:] == [results.falls(each) for each in own.values()]


def test_a_row_that_no_agent_has_is_left_out_and_one_that_some_have_is_not():
    without = [
        {k: v for k, v in s.items() if k != "distance"} | {"strides": math.nan} for s in INVENTED
    ]
    without[0]["strides"] = 7.0  # in `steep` alone
    level, steep, _ = (rows_of(t) for t in results.tables(without).split("\n\n"))
    for table in (level, steep):
        assert "distance / l" not in [line[0] for line in table]
    assert "strides" not in [line[0] for line in level]
    (line,) = (line for line in steep if line[0] == "strides")
    assert sorted(line[1:]) == ["7", "–"]


def test_falls_are_shares_of_all_walks_of_an_agent_most_frequent_first():
    ends = [{TIME_LIMIT: 5, "stalled": 1}, {"fell forward": 3, TIME_LIMIT: 1}]
    assert results.falls([{"endings": each} for each in ends]) == "fell forward 30%, stalled 10%"
    assert results.falls([{"endings": {TIME_LIMIT: 4}}]) == "none"
    assert results.falls([{"endings": {"stalled": 4}}]) == "stalled 100%"


def test_costs_at_equal_speeds_are_for_the_middle_speed_of_the_seeds_that_walked():
    speeds, costs = [0.08, 0.1, 0.12, 0.4], [0.01, 0.02, 0.04, 0.9]
    changes = [{"speed": v, "cost_of_transport": c} for v, c in zip(speeds, costs, strict=True)]
    scores = [invented(Unit("level", "ppo", i), 0) | each for i, each in enumerate(changes)]
    scores.append(invented(Unit("level", "ppo", 9), 0) | {"reached_time_limit": 0.0, "speed": 9.0})
    head, rule, line = rows_of(results.equal_speeds(scores))
    assert len(head) == len(rule) == len(line) == 5
    assert line[:3] == ["ppo", "0.110", "0.0300"]
    assert line[3] == f"{optimal.least_cost('level', 0.11):.4f}"
    assert line[4] == f"{results._cost_at(results._passive(), 0.11):.4f}"
    assert results.equal_speeds(scores[-1:]) == ""


def test_raw_scores_are_a_row_for_each_unit_in_order_with_six_digits(tmp_path):
    scores = [dict(score) for score in INVENTED]
    scores[0]["distance"] = 123456.789
    del scores[1]["rough_strides"]
    results.write_csv(tmp_path / "scores.csv", scores)
    with (tmp_path / "scores.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["scene", "agent", "seed", *SCORES]
    places = [(r["scene"], AGENTS.index(r["agent"]), int(r["seed"])) for r in rows]
    assert places == sorted(places) and len(rows) == len(UNITS)
    by_unit = {Unit(s["scene"], s["agent"], s["seed"]): s for s in scores}
    for row in rows:
        own = by_unit[Unit(row["scene"], row["agent"], int(row["seed"]))]
        for name in SCORES:
            assert row[name] == (f"{own[name]:.6g}" if name in own else "")
    assert [path.name for path in tmp_path.iterdir()] == ["scores.csv"]


def test_a_document_keeps_what_stands_around_the_tables(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(f"before\n{results.BEGIN}\nold\n{results.END}\nafter\n")
    results.write_document(path, "new")
    assert path.read_text() == f"before\n{results.BEGIN}\nnew\n{results.END}\nafter\n"


@pytest.mark.parametrize("marks", ["", results.BEGIN, results.END])
def test_a_document_that_lacks_one_of_its_two_marks_is_refused(marks, tmp_path):
    path = tmp_path / "page.md"
    path.write_text(f"a\n{marks}\nb\n")
    for write in (results.around_tables, lambda page: results.write_document(page, "new")):
        with pytest.raises(ValueError, match=r"page\.md has no lines"):
            write(path)
    assert path.read_text() == f"a\n{marks}\nb\n"


def test_a_result_carries_its_command_the_day_and_the_commit():
    words = ["git", "-C", str(Path(results.__file__).parent), "rev-parse", "HEAD"]
    done = subprocess.run(words, capture_output=True, text=True)
    commit = done.stdout.strip()[:7]
    said = results.provenance("python train.py benchmark")
    assert said == f"*`python train.py benchmark`, {date.today()}, commit `{commit}`*"


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are saved, with their paths."""
    found = []
    monkeypatch.setattr(results, "save", lambda figure, path: found.append((figure, path)))
    return found


def lines_of(ax):
    """Points of the labelled lines of a plot."""
    return {str(line.get_label()): line.get_xydata() for line in ax.lines}


LEVEL = [score for score in INVENTED if score["scene"] == "level"]


def test_the_picture_of_costs_shows_each_seed_at_its_speed_and_both_curves(drawn, tmp_path):
    fallen = invented(Unit("level", "lqr", 0), 2) | {"reached_time_limit": 0.0}
    results.draw(tmp_path / "costs.svg", [*INVENTED, fallen])
    (figure, path), lines = drawn[0], {}
    assert path == tmp_path / "costs.svg"
    (ax,) = figure.axes
    lines = lines_of(ax)
    own = results.by_agent(LEVEL)
    curves = {"passive, slope", "optimal gaits, level ground"}
    assert set(lines) == curves | {f"{agent}, level ground" for agent in own}
    for agent, scores in own.items():
        points = [[s["speed"], s["cost_of_transport"]] for s in scores]
        np.testing.assert_allclose(lines[f"{agent}, level ground"], points)
    gaits = [[g.froude_speed, g.cost_of_transport] for g in optimal.load("level")]
    np.testing.assert_allclose(lines["optimal gaits, level ground"], gaits)
    for speed, cost in lines["passive, slope"][::7]:
        assert results._cost_at(results._passive(), speed) == pytest.approx(cost)
    assert ax.get_yscale() == "log" and "speed" in ax.get_xlabel() and "cost" in ax.get_ylabel()


def test_the_picture_of_learning_draws_each_run_and_a_mark_for_its_final_policy(drawn, tmp_path):
    curves = {Unit("level", "ppo", 9): 0.3, Unit("level", "sac", 0): 0.6}
    for unit, offset in curves.items():
        folder = tmp_path / "runs" / str(unit)
        folder.mkdir(parents=True)
        names = "seconds,steps,reward,speed,cost_of_transport\n"
        rows = [[1, 1, -9, 0.01, 9], [2, 100, offset, 0.1, 0.02], [3, 200, 5.0, 0.12, 0.03]]
        text = names + "\n".join(",".join(map(str, row)) for row in rows) + "\n"
        (folder / "learning_curve.csv").write_text(text)
    results.draw_learning(tmp_path / "learning.svg", tmp_path / "runs", INVENTED)
    figure, path = drawn[0]
    left, right = figure.axes
    assert path.name == "learning.svg"
    learners = [s for s in LEVEL if s["agent"] in ALGORITHMS]
    above = [cost / optimal.least_cost("level", v) - 1.0 for v, cost in [(0.1, 0.02), (0.12, 0.03)]]
    runs = {}
    for ax, values in ((left, lambda first: [first, 5.0]), (right, lambda first: above)):
        points = [line.get_xydata().tolist() for line in ax.lines]
        runs[ax] = [x for x in points if len(x) == 2 and x[0][0] == 100.0]
        wanted = [[[100.0, values(o)[0]], [200.0, values(o)[1]]] for o in curves.values()]
        np.testing.assert_allclose(runs[ax], wanted)  # without the row of the untrained policy
    for ax, name in ((left, "reward"), (right, "above_optimum")):
        marks = [line.get_xydata() for line in ax.lines if line.get_linestyle() == "None"]
        marks = np.concatenate([each for each in marks if len(each)])
        wanted = [[s["learning_steps"], s[name]] for s in learners]
        np.testing.assert_allclose(sorted(marks.tolist()), sorted(wanted))
    labels = [text.get_text() for text in left.get_legend().get_texts()]
    assert labels == ["ppo", "sac"]
    assert left.get_xscale() == "log" and right.get_xlabel() == "steps of training"
    assert right.yaxis.get_major_formatter()(0.5) == "50%"


# The scores themselves.


def walks_of(count=5):
    """Invented walks, all numbers different; the last has no stride."""
    rng = np.random.default_rng(8)
    names = ("reward", "distance", "length", "duration", "motor_work", "net_work", "gravity_work")
    values = {name: rng.uniform(1.0, 2.0, count) for name in names}
    strides = np.array([99, 100, 101, 300, 0])
    for name in ("length", "duration", "motor_work", "net_work", "gravity_work"):
        values[name] = values[name] * (strides > 0)
    ends = [TIME_LIMIT, TIME_LIMIT, "stalled", TIME_LIMIT, "fell forward"]
    return Walks(
        seeds=np.arange(count), slopes=np.zeros(count), strides=strides, endings=ends, **values
    )


def scored(monkeypatch, walks, scene="level", gait=None):
    """Scores of a policy that walks so, and what its evaluation was asked."""
    asked = {}

    def evaluate(policy, arena, *, seed):
        asked.update(policy=policy, count=arena.num_envs, seed=seed, scene=arena.unwrapped.scene)
        return walks

    def closed(policy, scene):
        if gait is None:
            raise GaitNotFound("none")
        return gait

    monkeypatch.setattr(benchmark, "EPISODES", 3)
    monkeypatch.setattr(benchmark, "simulate_episodes", evaluate)
    monkeypatch.setattr(benchmark, "closed_loop_gait", closed)
    monkeypatch.setattr(benchmark, "rough_strides", lambda *_: 17.0)
    monkeypatch.setattr(benchmark, "largest_perturbations", lambda gait: (0.25, 0.125))
    return benchmark.scores_of("policy", scene), asked


def test_scores_are_means_over_walks_and_costs_over_the_whole_distance(monkeypatch):
    walks = walks_of()
    found, asked = scored(monkeypatch, walks)
    assert (asked["policy"], asked["count"], asked["seed"]) == ("policy", 3, 1000)
    assert asked["scene"].slope == 0.0
    way = sum(walks.length)
    hip, net = sum(walks.motor_work) / way, sum(walks.net_work) / way
    gravity, speed = sum(walks.gravity_work) / way, way / sum(walks.duration)
    wanted = {
        "distance": np.mean(walks.distance), "strides": 120.0, "speed": speed,
        "cost_of_transport": gravity + hip, "gravity_cost": gravity, "hip_cost": hip,
        "positive_hip_cost": (hip + net) / 2.0, "net_hip_cost": net,
        "reward": np.mean(walks.reward), "reached_time_limit": 0.6, "hundred_strides": 0.6,
        "above_optimum": math.nan, "rough_strides": 17.0, "perturbation_forward": math.nan,
        "perturbation_backward": math.nan,
    }  # fmt: skip
    assert found.pop("endings") == {TIME_LIMIT: 3, "stalled": 1, "fell forward": 1}
    assert set(found) == set(wanted)
    for name, value in wanted.items():
        if name != "above_optimum":
            assert found[name] == pytest.approx(value, nan_ok=True), name
    assert {*found} <= {*SCORES}


@pytest.mark.parametrize(("reached", "known"), [(1, False), (2, True), (4, True)])
def test_the_cost_above_the_optimum_needs_half_of_the_walks_and_a_known_speed(reached, known):
    ends = [TIME_LIMIT] * reached + ["stalled"] * (4 - reached)
    walks = _ended(ends)
    found = benchmark._above_optimum("level", walks, 0.1, 2.5 * optimal.least_cost("level", 0.1))
    assert found == pytest.approx(1.5) if known else math.isnan(found)
    assert math.isnan(benchmark._above_optimum("rolling", walks, 0.1, 0.01))


def _ended(ends):
    zeros = {name: np.zeros(len(ends)) for name in Walks.__dataclass_fields__ if name != "endings"}
    return Walks(**zeros, endings=ends)


def test_an_agent_without_a_stride_has_no_speed_and_a_gait_brings_its_own_scores(monkeypatch):
    walks = _ended(["stalled"] * 3)
    gait = SimpleNamespace(multipliers=np.array([-0.75, 0.5j]))
    found, _ = scored(monkeypatch, walks, "lab", gait)
    assert found["speed"] == 0.0 and found["cost_of_transport"] == 0.0
    assert (found["perturbation_forward"], found["perturbation_backward"]) == (0.25, 0.125)
    assert found["largest_multiplier"] == 0.75


def test_a_score_has_its_unit_and_what_its_training_took(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "scores_of", lambda policy, scene: {"of": scene})
    monkeypatch.setattr(benchmark, "load_policy", lambda folder: folder)
    made = []

    class Made:
        """A training that took some steps and seconds."""

        def __init__(self, config, folder):
            made.append((config, folder))
            self.steps, self.notes = 4096, {"seconds": 12.5}
            self.first_to_walk = first[0]

        def train(self, *, progress):
            assert progress is False
            return finished[0]

    monkeypatch.setattr(benchmark, "Run", Made)
    unit = Unit("steep", "sac", 3)
    first, finished = [{"steps": 512, "seconds": 2.5}], [True]
    found = benchmark.measure(tmp_path, unit, 0.5)
    assert found == {
        "scene": "steep", "agent": "sac", "seed": 3, "of": "steep", "budget": 0.5,
        "learning_steps": 4096, "learning_seconds": 12.5, "steps_to_hundred": 512,
        "seconds_to_hundred": 2.5,
    }  # fmt: skip
    config, folder = made[0]
    whole = configure("sac", "steep", seed=3)
    assert folder == tmp_path / "runs" / "steep-sac-3"
    assert config.steps == round(0.5 * whole.steps) and config.every == config.steps // 4
    names = ("hyperparams", "n_envs", "seed")
    assert all(getattr(config, name) == getattr(whole, name) for name in names)
    first[0] = None
    found = benchmark.measure(tmp_path, unit, 1e-9)
    assert math.isnan(found["steps_to_hundred"]) and math.isnan(found["seconds_to_hundred"])
    assert made[1][0].steps == made[1][0].every == 1
    passive = benchmark.measure(tmp_path, Unit("lab", "passive", 0), 1.0)
    assert passive == {"scene": "lab", "agent": "passive", "seed": 0, "of": "lab"}
    finished[0] = False
    with pytest.raises(KeyboardInterrupt):
        benchmark.measure(tmp_path, unit, 0.5)


def test_scores_are_read_in_the_order_of_their_names_and_a_damaged_one_is_named(tmp_path):
    for name in ("level-sac-1", "lab-ppo-0", "level-sac-0"):
        path = benchmark.score_path(tmp_path, Unit(*name.split("-")))
        assert path == tmp_path / "scores" / f"{name}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps({"name": name}))
    found = [score["name"] for score in benchmark.load_scores(tmp_path)]
    assert found == ["lab-ppo-0", "level-sac-0", "level-sac-1"]
    path.write_text("{")
    with pytest.raises(ConfigError, match=r"level-sac-0\.json"):
        benchmark.load_scores(tmp_path)
    assert benchmark.load_scores(tmp_path / "none") == []


@pytest.mark.parametrize("scene", SCENES)
def test_every_agent_of_a_unit_can_act_in_its_scene(scene):
    """Algorithms act where they have a preset; an optimal gait is for one slope."""
    assert [a for a in ALGORITHMS if benchmark.suits(a, scene)] == [
        a for a in ALGORITHMS if scene in benchmark.presets(a)
    ]
    assert benchmark.suits("passive", scene)
    one_slope = not isinstance(benchmark.make_scene(scene).slope, tuple)
    assert one_slope or not benchmark.suits("optimal", scene)
