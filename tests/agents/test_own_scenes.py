"""A scene of one's own, "module:function": trained, evaluated, drawn, exported and resumed."""

import json
import linecache
import shutil
import sys
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pytest

import gym_passive_walker as gpw
import train
from agents import envs, sweep
from agents.config import Config, ConfigError, configure
from agents.training import Run
from gym_passive_walker.apps import cli
from gym_passive_walker.apps.cli import main as passive_walker
from tests.agents.runs import TINY, short_arena, small, weights

TASK = '''
"""Tasks."""
from examples.five_links import FIVE_LINKS

WEIGHT = 2.0


def reward(step):
    return step.distance - WEIGHT * step.energy


def short():
    return {"slope": 0.02, "reward": reward}


def level():
    return "level"


def five():
    return {"system": FIVE_LINKS, "slope": 0.05, "control": "stride", "reset_noise_scale": 0.01}


def torqueless():
    return {"slope": 0.11, "control": "stride", "max_hip_torque": 0.0}


def loop():
    return "mytask:level"


def broken():
    return 1 / 0


number = 3
'''


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """The present folder has a module of the user's."""
    (tmp_path / "mytask.py").write_text(TASK)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("mytask", None)


@pytest.fixture(scope="module")
def own_run(tmp_path_factory):
    """The folder of a run of two small updates with an own reward."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "mytask.py").write_text(TASK)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said:
        patch.chdir(folder)
        assert train.main(["--scene", "mytask:short", "--out", "run", *TINY]) == 0
    sys.modules.pop("mytask")
    assert said.getvalue().startswith("mytask:short: walker C, slope 0.02 rad")
    assert "train.py gait run --trust" in said.getvalue()
    return folder / "run"


@pytest.fixture
def run(own_folder, own_run):
    """A copy of it."""
    return shutil.copytree(own_run, own_folder / "run")


def test_a_run_evaluates_draws_and_exports_its_own_scene(run):
    assert {"gait.png", "learning_curve.png", "evaluation.txt"} <= {p.name for p in run.iterdir()}
    assert train.main(["evaluate", "run", "--trust", "--episodes", "2"]) == 0
    assert train.main(["export", "run", "kept", "--trust"]) == 0
    policy = gpw.load_policy("kept", trust=True)
    assert policy.scene.reward.__name__ == "reward"
    policy.to_onnx("kept.onnx")
    assert gpw.load_policy("kept.onnx", trust=True).scene == policy.scene


def test_a_file_that_names_a_function_is_refused_without_trust(run, capsys):
    assert train.main(["export", "run", "kept", "--trust"]) == 0
    gpw.load_policy("kept", trust=True).to_onnx("kept.onnx")
    sys.modules.pop("mytask")
    capsys.readouterr()
    for line in (["evaluate", "run"], ["gait", "run"], ["--resume", "run"], ["export", "run", "x"],
                 ["evaluate", "kept"], ["--from", "run", *TINY]):  # fmt: skip
        assert train.main(line) == 2
        assert "if you trust it, add --trust" in capsys.readouterr().err
    assert passive_walker(["evaluate", "kept", "--episodes", "1"]) == 2
    assert "if you trust it, add --trust" in capsys.readouterr().err
    assert train.main(["gait", "kept.onnx"]) == 2
    assert "if you trust it, add --trust" in capsys.readouterr().err
    for name in ("kept", "kept.onnx"):
        with pytest.raises(ValueError, match="could do anything"):
            gpw.load_policy(name)
    assert "mytask" not in sys.modules
    train.main(["gait", "kept.onnx", "--trust"])  # the policy of two updates need not walk
    assert "mytask" in sys.modules and "--trust" not in capsys.readouterr().err
    assert passive_walker(["evaluate", "kept", "--episodes", "1", "--trust"]) == 0


def test_a_run_goes_on_with_its_own_scene_and_refuses_one_that_changed(run, own_folder, capsys):
    more = ["--resume", "run", "--trust", "--steps", "256", "--quiet"]
    file = own_folder / "mytask.py"

    def write(old, new):
        file.write_text(file.read_text().replace(old, new))
        sys.modules.pop("mytask", None)
        linecache.checkcache()

    write('"""Tasks."""', '"""Tasks."""  # of one walker')
    assert train.main(more) == 0
    assert Config.load(run / "config.yml", trust=True).steps == 256
    write("WEIGHT = 2.0", "WEIGHT = 3.0")
    capsys.readouterr()
    for line in (more, ["evaluate", "run", "--trust"]):
        assert train.main(line) == 2
        said = capsys.readouterr().err
        assert "has the line 'WEIGHT = 3.0' where it had 'WEIGHT = 2.0'" in said


def test_a_file_that_is_edited_while_a_training_runs_does_not_disturb_it(own_folder):
    config = configure("ppo", "mytask:short")
    file = own_folder / "mytask.py"
    file.write_text(file.read_text().replace("WEIGHT = 2.0", "WEIGHT = 3.0"))
    linecache.checkcache()
    assert envs.scene_of(config).slope == 0.02


def test_a_scene_without_a_file_is_refused(own_folder):
    with pytest.raises(ConfigError, match="has no source: write its module as a file"):
        configure("ppo", "builtins:dict")


def test_an_own_scene_trains_as_the_same_scene_by_name(tmp_path, monkeypatch):
    """Both runs have the same weights, bit for bit."""
    monkeypatch.setattr(envs, "arena", short_arena)
    found = []
    for name, scene in (("own", "mytask:level"), ("named", "level")):
        run = Run(small(scene=scene), tmp_path / name)
        assert run.train(progress=False)
        found.append(weights(run.model))
    np.testing.assert_array_equal(*found)


def test_a_system_trains_and_its_run_goes_on(own_folder, monkeypatch, capsys):
    monkeypatch.setattr(envs, "arena", short_arena)
    assert train.main(["--scene", "mytask:five", "--out", "five", *TINY]) == 0
    said = capsys.readouterr().out
    assert "stance-knee up to 0.03, stance-hip" in said and "gait.png" in said
    more = ["--resume", "five", "--trust", "--steps", "256", "--quiet"]
    assert train.main(more) == 0
    assert train.main(["export", "five", "kept", "--trust"]) == 0
    assert json.loads((own_folder / "kept" / "policy.json").read_text())["scene"] == "mytask:five"
    assert gpw.load_policy("kept", trust=True).scene.walker.title == "five links"


def test_an_own_scene_has_the_preset_of_its_control():
    assert configure("ppo", "mytask:torqueless").n_envs == configure("ppo", "steep").n_envs
    changed = configure("ppo", "mytask:torqueless", env={"control": "tick"})
    assert changed.n_envs == configure("ppo", "level").n_envs


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ("mytask:nothing", "'mytask:nothing' cannot be found: module 'mytask' has no attribute"),
        ("nowhere:level", "'nowhere:level' cannot be found: No module named 'nowhere'"),
        ("mytask:number", "'mytask:number' is not a function"),
        ("mytask:broken", "'mytask:broken' fails: ZeroDivisionError: division by zero"),
        ("mytask:loop", "must return a Scene, its arguments or the name of one of the package"),
        ("mytask:reward", "'mytask:reward' fails: TypeError"),
        (":", "':' cannot be found: Empty module name"),
    ],
)
def test_a_scene_that_cannot_be_made_is_refused_in_one_sentence(scene, said, capsys):
    assert train.main(["--scene", scene, *TINY]) == 2
    wrong = capsys.readouterr().err
    assert said in wrong and wrong.count("\n") == 1
    with pytest.raises(ConfigError, match=r"cannot|not a|fails|must return"):
        configure("ppo", scene)


def test_commands_take_an_own_scene(capsys):
    assert passive_walker(["scene", "mytask:five"]) == 0
    assert "five links" in capsys.readouterr().out
    given = ["evaluate", "constant", "--scene", "mytask:short", "--episodes", "2"]
    assert passive_walker(given) == 0
    assert "slope 0.02 rad" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        passive_walker(["scene", "mytask:nothing"])
    assert "cannot be found" in capsys.readouterr().err


def test_a_policy_with_an_own_scene_is_tested_by_the_command_if_it_is_trusted(run, capsys):
    assert train.main(["export", "run", "kept", "--trust"]) == 0
    few = ["--walkers", "2"]
    for line in (["evaluate", "kept", "--episodes", "2"], ["gauntlet", "kept", *few],
                 ["export", "kept", "again.onnx"],
                 ["robustness", "kept", *few, "--strides", "3"]):  # fmt: skip
        assert cli.main(line) == 2
        assert "if you trust it, add --trust" in capsys.readouterr().err
        assert cli.main([*line, "--trust"]) in (0, 2)
        assert "if you trust it" not in capsys.readouterr().err
    with pytest.raises(ValueError, match="trust must be True or False, not 'yes'"):
        gpw.load_policy("kept", trust="yes")


@pytest.mark.learning
def test_a_biped_of_five_links_learns_to_walk(own_folder, capsys):
    assert train.main(["--scene", "examples.five_links:downhill", "--steps", "4000000",
                       "--out", "five"]) == 0  # fmt: skip
    assert "20 of 20 walks reach the time limit" in capsys.readouterr().out


def test_a_training_does_not_go_on_in_the_folder_of_another_code(own_folder, monkeypatch):
    monkeypatch.setattr(envs, "arena", short_arena)
    given = {"algo": "ppo", "scene": "mytask:short", "steps": 64, "n_envs": 2, "folder": "runs"}
    monkeypatch.setattr(sweep, "configure", lambda *_, **__: small(scene="mytask:short", steps=64))
    assert sweep.train(**given) == pytest.approx(sweep.train(**given), nan_ok=True)
    file = own_folder / "mytask.py"
    file.write_text(file.read_text().replace("WEIGHT = 2.0", "WEIGHT = 3.0"))
    sys.modules.pop("mytask")
    linecache.checkcache()
    with pytest.raises(ConfigError, match=r"is another run: .* has the line 'WEIGHT = 3.0'"):
        sweep.train(**given)
