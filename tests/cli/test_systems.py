"""A system of one's own, "module:NAME", is a walker in every command."""

import json

import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import main
from tests.own.statements import DRIVEN

NAME = "tests.own.statements:DRIVEN"


def answer(capsys, *words):
    """What a command prints for programs."""
    assert main([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_gait_of_a_system_is_that_of_find_gait_in_its_own_units(capsys):
    (found, *_) = answer(capsys, "gait", NAME, "0.02")
    gait = gpw.find_gait(DRIVEN, 0.02)
    assert found["step_period"] == pytest.approx(gait.step_period)
    assert found["state"] == pytest.approx(gait.state.tolist(), abs=1e-9)
    assert main(["gait", NAME, "0.02"]) == 0
    said = capsys.readouterr().out
    assert "gait of system 'compass'" in said and "step period (√(l/g))" in said
    assert " s)" not in said and "rad/s" not in said


@pytest.mark.parametrize(
    "words",
    [
        "family {} 0.02 0.021",
        "bifurcation {} 0.02 0.021 --slopes 2 --n-transient 9 --n-recorded 33",
        "basin {} 0.02 --resolution 5 --strides 5",
        "check {} 0.02",
        "simulate {} 0.02 --strides 2",
        "simulate {} 0.02 --strides 2 --state 0.2 -0.2 -0.3 -0.2",
        "strobe {} 0.02 --strides 1 --out walk.png",
        "robustness {} --slope 0.02 --walkers 8 --strides 4",
        "evaluate passive --walker {} --slope 0.02 --episodes 1",
    ],
)
def test_every_command_takes_a_system(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert answer(capsys, *words.format(NAME).split())
    assert main(words.format(NAME).split()) == 0
    assert "rad/s" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere:DRIVEN", "'nowhere:DRIVEN' cannot be found: No module named 'nowhere'"),
        ("tests.own.statements:NONE", "has no attribute 'NONE'"),
        ("tests.own.statements:links", "must be a System, not <function links"),
        ("C:\\walkers\\mine", "no walker"),
    ],
)
def test_what_is_no_system_is_refused(name, said, capsys):
    with pytest.raises(SystemExit):
        main(["gait", name, "0.02"])
    assert said in capsys.readouterr().err


def test_what_a_system_lacks_is_refused_by_one_sentence(capsys):
    for words in (("--tune",), ("--torque", "0.1"), ("--trust",)):
        assert main(["gait", NAME, "0.02", *words]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert main(["robustness", NAME, "--slope", "0.02", "--trust"]) == 2
    assert "--trust permits a controller" in capsys.readouterr().err
