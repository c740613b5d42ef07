"""Each option of a sweep has an effect, in Python and on the command line."""

from __future__ import annotations

import argparse
import inspect
import json
from dataclasses import fields

import numpy as np
import pytest

pytest.importorskip("pyarrow")

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import main, parser
from gym_passive_walker.apps.sweeps.description import Description
from tests.sweeps.odd import odd_sweep

SQUARES = {"analysis": "odd_tasks:square", "over": {"x": [1, 2, 3]}}
HANGS = {"analysis": "odd_tasks:hangs", "over": {"x": [0, 2]}}
SAMPLE = {**SQUARES, "over": {"x": [0.0, 1.0]}, "how": "sobol", "samples": 4}
DESCRIBED = {
    "analysis": ({**SQUARES, "analysis": "odd_tasks:changeable"}, SQUARES),
    "over": (SQUARES, {**SQUARES, "over": {"x": [1, 2, 4]}}),
    "how": (SAMPLE, {**SAMPLE, "how": "latin-hypercube"}),
    "given": (SQUARES, {**SQUARES, "given": {"seed": 3}}),
    "samples": (SAMPLE, {**SAMPLE, "samples": 8}),
    "seed": (SQUARES, {**SQUARES, "seed": 5}),
    "time_out": ({**HANGS, "time_out": 0.3}, {**HANGS, "time_out": 0.6}),
}
"""Of each entry of a description, two sweeps that differ in it alone."""

HEARD_IN_PYTHON = {"analysis", "out", "workers", "branch", "retry", "trust", "described"}
HEARD_AS_WORDS = {"description", "out", "workers", "branch", "retry", "trust"}
ON_RAY = {"ray"}  # `test_ray`


def rows(found) -> dict[str, list[str]]:
    """Results of a sweep, without durations."""
    columns = found.columns()
    return {name: [*map(str, values)] for name, values in columns.items() if name != "seconds"}


def test_every_option_stands_in_a_test():
    assert set(inspect.signature(gpw.sweep).parameters) == HEARD_IN_PYTHON | ON_RAY
    assert {entry.name for entry in fields(Description)} == set(DESCRIBED)
    (commands,) = (
        action for action in parser()._actions if isinstance(action, argparse._SubParsersAction)
    )
    words = {action.dest for action in commands.choices["sweep"]._actions}
    assert words - {"help", "json"} == HEARD_AS_WORDS | ON_RAY


@pytest.mark.parametrize("entry", DESCRIBED)
def test_an_entry_of_a_description_is_heard(entry, odd):
    found = [
        gpw.sweep(each, odd / str(i), trust=True, workers=1)
        for i, each in enumerate(DESCRIBED[entry])
    ]
    assert rows(found[0]) != rows(found[1])


def test_as_many_processes_work_as_are_asked_for(odd):
    for count in (1, 2):
        (odd / str(count)).mkdir()
        given = {"folder": str(odd / str(count)), "processes": count}
        odd_sweep("noted", odd / f"out {count}", 8, given=given, workers=count)
        lines = (odd / str(count) / "noted").read_text().splitlines()
        assert len({line.split()[1] for line in lines}) == count


def test_words_of_the_command_are_the_options_of_python(odd, capsys, monkeypatch):
    """Each is passed on: by what the command calls."""
    asked = {}

    def noted(content, out, **options):
        asked.update(options, content=content, out=out)
        return gpw.sweep(SQUARES, odd / "done", trust=True, workers=1)

    monkeypatch.setattr("gym_passive_walker.apps.cli.sweeps.swept", noted)
    file = odd / "squares.json"
    file.write_text(json.dumps(SQUARES))
    usual = {"workers": None, "ray": None, "branch": False, "retry": False, "trust": False}
    changes = {
        "": {},
        "--workers 2": {"workers": 2},
        "--ray": {"ray": "here"},
        "--branch": {"branch": True},
        "--retry": {"retry": True},
        "--trust": {"trust": True},
        f"--out {odd / 'elsewhere'}": {"out": odd / "elsewhere"},
    }
    for words, change in changes.items():
        assert main(["sweep", str(file), *words.split(), "--json"]) == 0
        assert asked == {**usual, "content": file, "out": None} | change
        said = json.loads(capsys.readouterr().out)
        assert said["tasks"] == 3 and np.isfinite(said["failures"])


def test_a_function_that_no_other_process_finds_is_refused(tmp_path):
    def within(x):
        return x

    for function in (within, lambda x: x):
        with pytest.raises(ValueError, match="cannot be found by other processes"):
            gpw.sweep(function, tmp_path / "out", over={"x": [1]})
    with pytest.raises(ValueError, match="out must be a folder"):
        gpw.sweep("gait", over={"slope": [0.1]})
    assert not [*tmp_path.iterdir()]
