"""Arguments of `train.py`."""

import csv
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from matplotlib import figure

import train
from agents import commands, envs, files
from agents.config import Config, configure
from agents.learner import load_policy
from gym_passive_walker import WALKERS, Gait
from gym_passive_walker.envs.evaluation.walks import simulate_episodes
from gym_passive_walker.gaits.control import optimal
from gym_passive_walker.gaits.control.baselines import Passive
from tests.agents.runs import TINY, short_arena


def test_a_run_leaves_everything_in_its_folder(steep_run):
    names = {path.name for path in steep_run.iterdir()}
    assert names == {
        "config.yml", "checkpoints", "model.zip", "normalizer.npz", "evaluation.csv",
        "evaluation.txt", "learning_curve.csv", "learning_curve.png", "gait.png",
    }  # fmt: skip
    for name in ("learning_curve.png", "gait.png"):
        assert (steep_run / name).read_bytes().startswith(b"\x89PNG")
    assert "passive" in (steep_run / "evaluation.txt").read_text()
    assert len((steep_run / "evaluation.csv").read_text().splitlines()) == 1 + 2 * 20


def seen(step):
    """Two angles."""
    return step.state.stance, step.state.thigh


def test_the_end_of_a_training_says_where_pictures_are_and_what_to_try_next(steep_run):
    said = train.outlook(steep_run, Config.load(steep_run / files.CONFIG))
    assert str(steep_run / "gait.png") in said and f"train.py gait {steep_run} " in said
    assert "--algo shac --scene steep" in said and "--scene rolling" in said
    for algo, scene, absent in (("shac", "level", "shac"), ("ppo", "push-off", "shac")):
        assert absent not in train.outlook(Path("run"), configure(algo, scene))
    assert "slopes from" not in train.outlook(Path("run"), configure("ppo", "rolling"))
    assert "shac    learn" in train.outlook(Path("run"), configure("ppo", "level"))
    own = configure("ppo", "level", env={"observation": f"{__name__}:seen"})
    assert "train.py gait" not in train.outlook(Path("run"), own)  # it needs a stride map


def test_without_an_algorithm_it_is_the_fast_one():
    assert train.asked_for(train.train_parser().parse_args([])).algo == "ppo-fast"
    of_seven = train.asked_for(train.train_parser().parse_args(["--seed", "7", "--algo", "sac"]))
    assert (of_seven.algo, of_seven.seed) == ("sac", 7)


def test_a_run_that_is_continued_keeps_what_is_not_asked_for():
    kept = configure("ppo", "lab", seed=5, steps=3000, n_envs=3, every=1000)
    nothing = train.asked_for(train.train_parser().parse_args([]), kept)
    assert nothing == kept
    more = train.asked_for(train.train_parser().parse_args(["--steps", "9000"]), kept)
    assert (more.steps, more.seed, more.n_envs, more.every) == (9000, 5, 3, 1000)


def test_an_evaluation_tells_each_agents_own_episodes(steep_run):
    with (steep_run / "evaluation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    config = Config.load(steep_run / files.CONFIG)
    for name, agent in (("SAC", load_policy(steep_run)), ("passive", Passive())):
        walks = simulate_episodes(agent, envs.arena(config, 20), seed=1000)
        reported = [float(row["reward"]) for row in rows if row["agent"] == name]
        assert reported == pytest.approx(walks.reward, abs=1e-6)


def test_a_gait_is_drawn_beside_the_optimal_gait_of_about_its_speed(tmp_path, monkeypatch):
    drawn = []

    def draw(gait, ax, *, optimum):
        drawn.append((gait, optimum))
        return figure.Figure().subplots()

    monkeypatch.setattr(Gait, "plot", draw)
    line = ["gait", "constant", "--scene", "level", "--out", str(tmp_path / "gait.png")]
    assert train.main(line) == 0
    ((gait, beside),) = drawn
    apart = [abs(other.froude_speed - gait.froude_speed) for other in optimal.load("level")]
    assert abs(beside.froude_speed - gait.froude_speed) == min(apart) < 0.01


def test_an_evaluation_can_be_repeated(steep_run, capsys):
    before = (steep_run / "evaluation.txt").read_text()
    assert train.main(["evaluate", str(steep_run)]) == 0
    assert capsys.readouterr().out == before


def test_a_run_can_be_resumed_for_more(steep_run, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(steep_run, folder)
    assert train.main(["--resume", str(folder), "--steps", "256", "--quiet"]) == 0
    kept, before = (Config.load(where / files.CONFIG) for where in (folder, steep_run))
    assert kept.steps == 256 and kept.every == before.every
    assert files.newest_checkpoint(folder) == files.checkpoint_path(folder, 256)


FILES = {
    "mine.json": '{"preset": "C", "hip_mass": 1.0}',
    "mine.yaml": "preset: C\nhip_mass: 1e0",
    "mine.toml": 'preset = "C"\nhip_mass = 1.0',
}
HEAVY = replace(WALKERS["C"], hip_mass=1.0)


@pytest.mark.parametrize("name", FILES)
def test_a_configuration_keeps_the_walker_of_a_file_by_its_parameters(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(FILES[name])
    config = train.asked_for(train.train_parser().parse_args(["--walker", name]))
    config.save(tmp_path / files.CONFIG)
    (tmp_path / name).unlink()
    assert envs.scene_of(Config.load(tmp_path / files.CONFIG)).walker == HEAVY
    assert "walker mine," in envs.describe(config)


def test_a_run_goes_on_without_the_file_of_its_walker(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(envs, "arena", short_arena)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text(FILES["mine.json"])
    line = ["--walker", "mine.json", "--scene", "steep", "--algo", "sac", "--out", "run", *TINY]
    assert train.main(line) == 0
    assert "walker mine," in capsys.readouterr().out
    (tmp_path / "mine.json").unlink()
    assert train.main(["--resume", "run", "--steps", "256", "--quiet"]) == 0
    assert envs.scene_of(Config.load(tmp_path / "run" / files.CONFIG)).walker == HEAVY


def test_where_a_picture_goes_is_checked_before_a_gait_is_sought(tmp_path, monkeypatch, capsys):
    def never(*_, **__):
        pytest.fail("a gait was sought")

    monkeypatch.setattr("agents.commands.closed_loop_gait", never)
    assert train.main(["gait", "constant", "--out", str(tmp_path / "gait.doc")]) == 2
    (tmp_path / "gait.png").mkdir()
    assert train.main(["gait", "constant", "--out", str(tmp_path / "gait.png")]) == 2
    assert capsys.readouterr().err.count("error: ") == 2


def test_what_a_run_draws_with_is_looked_for_before_it_learns(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert train.main(["--out", str(tmp_path / "run"), *TINY]) == 2
    assert "needs matplotlib" in capsys.readouterr().err and not (tmp_path / "run").exists()


def test_arguments_reach_the_configuration():
    text = (
        "--algo sac --scene lab --walker C --slope 0 0.05 --control stride --steps 2.5e4 --seed 9"
    )
    config = train.asked_for(train.train_parser().parse_args([*text.split(), "--seed", "9"]))
    assert (config.algo, config.scene, config.steps, config.seed) == ("sac", "lab", 25_000, 9)
    assert config.env == {"walker": "C", "control": "stride", "slope": [0.0, 0.05]}


REFUSED = {
    "--walker Z": "no walker 'Z'",
    "--walker missing.json": "missing.json",
    "--slope 2": "slope",
    "--slope 0.1 0.05": "slope",
    "--slope 0 1 2": "--slope takes",
    "--scene moon": "no preset for 'moon' in ppo-fast.yml: it has tick, stride, level",
    "--steps 0": "steps",
    "--envs 0": "envs",
    "--seed -4": "seed",
    "--resume nowhere": "nowhere",
    "--from nowhere": "no policy 'nowhere'",
    "--resume": "no run",
    "--search 0": "from 1 on, not 0",
    "--ray": "--ray goes with --search",
    "--resume run --search 2": "--resume continues a training: leave out --search and --ray",
    "--resume --ray": "--resume continues a training: leave out --search and --ray",
    "--resume run --out other": "continues run in its own folder: leave out --out other",
    "--search 2 --tensorboard": "a search writes no logs of tensorboard",
    "evaluate nowhere": "nowhere is not the folder of a run",
    "evaluate --policy nobody": "not the folder of a run, and the package has no nobody",
    "evaluate levle-ppo": "the package has no levle-ppo (level-ppo?); it has anywhere-p",
    "evaluate level-ppo --episodes 0": "--episodes must be a whole number from 1 on",
    "evaluate --policy level-ppo --seed -1": "--seed must be a whole number from 0 on",
    "export nobody there": "nobody",
    "export level-ppo there": "level-ppo was exported before: its folder can be copied",
    "gait nobody": "nobody",
    "gait passive --scene level": "under passive",
    "gait passive --slope 9": "slope must be an angle",
    "gait passive --period 0": "period must be a whole number from 1 on",
    "benchmark --budget 0": "--budget",
    "benchmark --tables": "no scores",
    "benchmark --tables --scenes lab --seeds 2": "that there are: leave out --scenes, --seeds",
    "benchmark --agents dqn": "dqn",
}


@pytest.mark.parametrize("line", REFUSED)
def test_nonsense_is_refused_before_anything_is_written(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert train.main(line.split()) == 2
    said = capsys.readouterr().err
    assert said.startswith("train.py: error: ") and said.count("\n") == 1
    assert REFUSED[line] in said
    assert list(tmp_path.iterdir()) == []


NUMBERS = ["many", "1.5", "1e-3", "inf", "nan"]


@pytest.mark.parametrize(
    "line", ["--algo dqn", "--control never", *(f"--steps {number}" for number in NUMBERS)]
)
def test_words_that_are_not_known_end_with_the_usage(line, capsys):
    with pytest.raises(SystemExit):
        train.main(line.split())
    assert "usage" in capsys.readouterr().err


def test_a_run_is_not_written_over(steep_run, capsys):
    assert train.main(["--out", str(steep_run)]) == 2
    assert "--resume" in capsys.readouterr().err


def test_stored_optima_are_printed_by_one_thread_and_not_sought(monkeypatch, capsys):
    monkeypatch.setattr(optimal, "optimal_gaits", lambda *_: pytest.fail("gaits are sought"))
    torch.set_num_threads(2)
    for words, scene in (("optimal --scene steep", "steep"), ("optimal", "level")):
        assert train.main(words.split()) == 0
        assert capsys.readouterr().out == commands.optimal_table(optimal.load(scene)) + "\n"
    assert torch.get_num_threads() == 1


@pytest.mark.parametrize("arguments", [["--help"], ["evaluate", "--help"]])
def test_help_helps(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        train.main(arguments)
    assert ended.value.code == 0 and "usage" in capsys.readouterr().out
