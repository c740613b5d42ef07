"""What the commands of `train.py` print and pass on, against plain arithmetic."""

import csv
import dataclasses
import math
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
import train
from agents import commands, envs, evaluation, files
from agents.config import configure, presets
from agents.evaluation import evaluate_policy, write_evaluation, write_rows
from gym_passive_walker.envs.evaluation.walks import score_table, simulate_episodes
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import Passive
from gym_passive_walker.gaits.scenes.scene import make_scene


def test_the_table_of_optima_has_each_gait_s_numbers_in_its_columns():
    gaits = optimal.load("steep")
    head, *lines = commands.optimal_table(gaits).splitlines()
    assert head.split("  ")[0] == "speed/√(gl)" and len(lines) == len(gaits)
    for line, gait in zip(lines, gaits, strict=True):
        shown = [float(word) for word in line.split()]
        wanted = [
            gait.froude_speed, gait.cost_of_transport, gait.hip_cost,
            gait.dimensionless.step_period, abs(gait.multipliers[0]), gait.optimality,
        ]  # fmt: skip
        digits = [5e-4, 5e-6, 5e-6, 5e-4, 5e-4, None]
        for value, real, half in zip(shown, wanted, digits, strict=True):
            assert value == pytest.approx(real, abs=half, rel=0.06 if half is None else 1e-12)
        assert len(line) == len(lines[0])


@pytest.mark.parametrize("slope", [0.036, 0.05])
def test_a_gait_is_described_in_dimensionless_numbers(slope):
    gait = gpw.find_gait("lab", slope)
    units = gait.walker.units
    rows = dict(
        (line[:26].strip(), line[26:]) for line in commands._described(gait, 0.02).splitlines()
    )
    assert rows["speed / √(g l)"] == f"{gait.speed / math.sqrt(units.length * 9.81):.4f}"
    assert rows["step period / √(l/g)"] == f"{gait.step_period / units.time:.4f}"
    assert rows["step length / l"] == f"{gait.step_length / units.length:.4f}"
    assert rows["cost of transport"] == rows["gravity's"] == f"{math.sin(slope):.5f}"
    for name in ("positive hip work", "absolute hip work", "net hip work", "push-off"):
        assert float(rows[name]) == 0.0
    assert rows["multipliers' moduli"] == ", ".join(f"{abs(m):.3f}" for m in gait.multipliers)
    assert rows["stable"] == ("yes" if max(abs(gait.multipliers)) < 1.0 else "no")
    above = math.sin(slope) / 0.02 - 1.0
    assert rows["optimum at that speed"] == f"0.02000; this is {above:.0%} above"
    assert "optimum" not in commands._described(gait, math.nan)


def test_works_of_a_gait_are_each_in_their_line():
    names = (
        "cost_of_transport", "gravity_cost", "positive_hip_cost", "hip_cost", "net_hip_cost",
        "ankle_cost", "push_off_cost",
    )  # fmt: skip
    gait = SimpleNamespace(
        walker=make_scene("lab").walker, froude_speed=0.9, step_period=1.0, step_length=1.0,
        multipliers=np.array([0.5, -2.0]), stable=False,
        **{name: (i + 1) / 100 for i, name in enumerate(names)},
    )  # fmt: skip
    lines = commands._described(gait, math.nan).splitlines()
    found = [line[26:] for line in lines[3:10]]
    assert found == [f"{(i + 1) / 100:.5f}" for i in range(7)]
    assert lines[-2:] == [f"{'multipliers’ moduli'.replace('’', chr(39)):<26}0.500, 2.000",
                          f"{'stable':<26}no"]  # fmt: skip


def test_optima_that_are_found_again_are_stored_at_the_grid_and_their_costs_between(
    tmp_path, monkeypatch, capsys
):
    found, costs, kept = [], [], []

    def gaits(name, speeds):
        found.append((name, speeds))
        return [SimpleNamespace(froude_speed=v) for v in [*speeds, 0.123456789]]

    monkeypatch.setattr(commands, "GRIDS", {"lab": (0.1, 0.3, 0.1)})
    monkeypatch.setattr(optimal, "STORE", tmp_path)
    monkeypatch.setattr(optimal, "optimal_gaits", gaits)
    monkeypatch.setattr(optimal, "save_costs", lambda name, gaits: costs.append((name, gaits)))
    monkeypatch.setattr(
        optimal, "save_gaits", lambda path, gaits: (kept.extend(gaits), path.write_text("new"))
    )
    monkeypatch.setattr(optimal, "load", lambda name: [])
    assert train.main("optimal --scene lab --again".split()) == 0
    ((name, speeds),) = found
    assert name == "lab" and speeds == [round(0.1 + 0.0125 * i, 6) for i in range(17)]
    assert [gait.froude_speed for gait in kept] == [0.1, 0.2, 0.3, 0.123456789]
    ((name, all_gaits),) = costs
    assert name == "lab" and len(all_gaits) == 18
    assert [path.name for path in tmp_path.iterdir()] == ["lab.json"]


@pytest.mark.parametrize("name", commands.GRIDS)
def test_stored_gaits_and_costs_have_the_speeds_of_the_scene_s_grid(name):
    first, last, apart = commands.GRIDS[name]
    grid = np.linspace(first, last, round((last - first) / apart) + 1)
    speeds = np.array([gait.froude_speed for gait in optimal.load(name)])
    missing = [speed for speed in grid if np.abs(speeds - speed).min() > 1e-9]
    assert missing in ([], [first])  # the slowest may have no gait
    others = [speed for speed in speeds if np.abs(grid - speed).min() > 1e-9]
    assert len(others) == (name != "level")  # the passive gait's, where the walker has one
    known = np.array(optimal.stored_costs(name))[:, 0]
    assert first - 1e-9 <= known[0] < first + apart and known[-1] == pytest.approx(last)
    assert np.median(np.diff(known)) == pytest.approx(apart / commands.FINER, rel=1e-6)


def test_rows_of_former_evaluations_may_lack_columns(tmp_path):
    path = tmp_path / "rows.csv"
    write_rows(path, [{"a": 1}, {"a": 2, "b": "x, ü"}])
    with path.open(newline="", encoding="utf-8") as file:
        assert list(csv.DictReader(file)) == [{"a": "1", "b": ""}, {"a": "2", "b": "x, ü"}]


def test_a_policy_of_the_package_is_evaluated_by_its_name_and_writes_nothing(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    text, _ = evaluate_policy("steep-ppo", episodes=2, seed=7)
    for name in (["steep-ppo"], ["--policy", "steep-ppo"]):
        assert train.main(["evaluate", *name, "--episodes", "2", "--seed", "7"]) == 0
        assert capsys.readouterr().out == f"{text}\n"
    assert not list(tmp_path.iterdir())


def test_an_evaluation_compares_the_policy_with_the_passive_walker_on_the_same_episodes(tmp_path):
    text, rows = evaluate_policy("steep-ppo", episodes=3, seed=7)
    config, policy = evaluation.learned("steep-ppo")
    walks, passive = (
        simulate_episodes(agent, envs.arena(config, 3), seed=7) for agent in (policy, Passive())
    )
    assert rows == [*walks.rows("PPO"), *passive.rows("passive")]
    assert [row["seeds"] for row in rows] == [7, 8, 9] * 2
    title = f"{envs.describe(config)}; 3 episodes"
    found = gpw.evaluate(policy, envs.scene_of(config), episodes=3, seed=7, beside=("passive",))
    above = dict(zip(("PPO", "passive"), found.above_optimum.values(), strict=True))
    said = evaluation.in_words(found)
    assert text == "\n".join([score_table(title, {"PPO": walks, "passive": passive}, above), *said])
    assert said[0].startswith("With the policy, ")
    assert said[2].startswith("Without an actuator, ")
    write_evaluation(tmp_path, text, rows)
    assert (tmp_path / "evaluation.txt").read_text(encoding="utf-8") == text + "\n"
    assert len((tmp_path / "evaluation.csv").read_text().splitlines()) == 7
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [({"episodes": 0}, "episodes"), ({"episodes": 1.5}, "episodes"), ({"seed": -1}, "seed")],
)
def test_an_evaluation_without_episodes_or_seed_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        evaluate_policy("steep-ppo", **options)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A folder with the configuration of a run alone."""
    folder = tmp_path_factory.mktemp("run")
    config = configure("ppo", "lab", env={"slope": 0.03}, seed=5, steps=3000, n_envs=4, every=900)
    own = {**config.hyperparams, "gamma": 0.875}
    config = dataclasses.replace(
        config, hyperparams=own, normalize={"clip_obs": 7.0}, exploration=None,
        training={"reset_noise_scale": 0.25},
    )  # fmt: skip
    config.save(folder / files.CONFIG)
    return folder, config


def resumed(*words):
    """The folder and the configuration of a run that goes on."""
    return train.run_to_resume(train.train_parser().parse_args(list(words)))


def test_a_run_that_goes_on_keeps_what_presets_have_changed_since(kept, tmp_path, monkeypatch):
    folder, config = kept
    assert resumed("--resume", str(folder)) == (folder, config)
    assert resumed("--resume", "--out", str(folder)) == (folder, config)
    more = resumed("--resume", str(folder), "--steps", "1e5", "--every", "7")[1]
    assert more == dataclasses.replace(config, steps=100_000, every=7)
    assert resumed("--resume", str(folder), "--seed", "5", "--envs", "4")[1] == config
    monkeypatch.chdir(tmp_path)
    shutil.copytree(folder, tmp_path / "runs" / "lab-ppo-1")
    assert resumed("--resume") == (files.RUNS / "lab-ppo-1", config)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--seed 6", "seed: 5 here, 6 asked for"),
        ("--envs 5", "n_envs: 4 here, 5 asked for"),
        ("--slope 0.04", "env.slope: 0.03 here, 0.04 asked for"),
        ("--walker C", "env.walker: None here, 'C' asked for"),
        ("--algo sac --scene level", "algo: 'ppo' here, 'sac' asked for"),
    ],
)
def test_a_run_does_not_go_on_as_another(words, said, kept, capsys):
    assert train.main(["--resume", str(kept[0]), *words.split()]) == 2
    error = capsys.readouterr().err
    assert "is another run" in error and said in error
    assert ("scene: 'lab' here, 'level' asked for" in error) == ("level" in words)


@pytest.mark.parametrize(
    ("text", "number"), [("250000", 250_000), ("2.5e5", 250_000), ("1e0", 1), ("7.0", 7)]
)
def test_whole_numbers_are_read_in_each_notation(text, number):
    found = train.whole(text)
    assert found == number and type(found) is int


def test_a_slope_is_one_number_or_the_ends_of_a_range():
    parse = train.train_parser().parse_args
    assert train.asked_for(parse(["--slope", "0.01"])).env == {"slope": 0.01}
    assert train.asked_for(parse(["--slope", "0", "0.01"])).env == {"slope": [0.0, 0.01]}
    own = configure("ppo", "level", env={"walker": "C", "slope": 0.02})
    assert train.asked_for(parse(["--walker", "E"]), own).env == {"walker": "E", "slope": 0.02}


def test_a_search_prints_the_best_and_where_it_is(tmp_path, monkeypatch, capsys):
    pytest.importorskip("optuna")
    asked = []

    def search(config, folder, trials, *, ray, progress, trust):
        asked.append((folder, trials, trust))
        return {"gamma": 0.9, "n_epochs": 7}

    monkeypatch.setattr("agents.search.search", search)
    monkeypatch.chdir(tmp_path)
    assert train.main("--search 4 --algo sac --scene steep --trust".split()) == 0
    assert asked == [(files.RUNS / "search-steep-sac", 4, True)]
    said = capsys.readouterr().out.splitlines()
    assert said[:2] == ["gamma: 0.9", "n_epochs: 7"] and "best.yml" in said[2]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("finished", [True, False])
def test_a_training_says_what_it_is_about_and_whether_it_ended(
    finished, tmp_path, monkeypatch, capsys
):
    made, drawn = [], []

    class Made:
        """A training without steps."""

        steps, notes, left_out = 1234, {"curve": ["row"]}, ()

        def __init__(self, config, folder, *, tensorboard, trust):
            made.append(config)

        def train(self, *, progress):
            return finished

        def first_walks(self):
            return "the first walks"

    monkeypatch.setattr(train, "Run", Made)
    monkeypatch.setattr(
        evaluation, "evaluate_policy", lambda folder, trust: ("a table", [{"a": 1}])
    )
    monkeypatch.setattr(train.pictures, "draw_run", lambda *given, trust: drawn.append(given))
    folder = tmp_path / "run"
    words = ["--scene", "lab", "--algo", "sac", "--steps", "70000", "--out", str(folder)]
    assert train.main(words) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert first == f"{envs.describe(made[0])}: SAC, 70,000 steps, in {folder}"
    stop = [f"Stopped after 1,234 steps; continue with: python train.py --resume {folder}"]
    assert rest[: 2 + (not finished)] == stop * (not finished) + ["a table", "the first walks"]
    assert drawn == [(folder, ["row"])]
    assert (folder / "evaluation.txt").read_text() == "a table\n"
    tried = "\n".join(rest)
    assert ("--algo shac --scene lab" in tried) == ("lab" in presets("shac"))


@pytest.mark.parametrize("asked", ["steep", None])
def test_a_baseline_acts_in_the_scene_that_is_asked_for_or_on_level_ground(asked):
    policy, found = commands._policy_and_scene("lqr", asked and make_scene(asked))
    scene = make_scene(asked or "level")
    assert (found.walker, found.slope, policy.name) == (scene.walker, scene.slope, "LQR")


@pytest.mark.parametrize("asked", ["lab", None])
def test_a_policy_acts_in_the_scene_that_is_asked_for_or_its_own(asked):
    _, found = commands._policy_and_scene("steep-ppo", asked and make_scene(asked))
    assert found == (make_scene(asked) if asked else gpw.load_policy("steep-ppo").scene)


@pytest.mark.parametrize(("slope", "known"), [([], True), (["--slope", "0.04"], False)])
def test_a_gait_is_compared_with_the_optimum_of_its_own_slope(slope, known, capsys):
    assert train.main(["gait", "lab-ppo", *slope]) == 0
    assert ("optimum at that speed" in capsys.readouterr().out) == known
