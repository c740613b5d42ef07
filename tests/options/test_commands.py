"""Each option of each command has an effect: `passive-walker`, `train.py`."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.apps.cli import COMMANDS, main, parser
from gym_passive_walker.apps.cli.arguments import call_with
from gym_passive_walker.apps.cli.report import plain

pytestmark = pytest.mark.filterwarnings("ignore:.*:ResourceWarning")

BUMPY = "--terrain rough:height_std=0.02"
NEAR = "--state 0.3 -0.3 -0.3 -1.2 -0.8 -1.0"
WALKED = {"tune": ("C 0.03", "C 0.03 --tune"), "kind": ("C 0.03", "C 0.03 --kind short")}


def motors(before, after="", walker="E", at="0.01"):
    """Options for the actuators of a command, for point feet and for the lab walker."""
    base, lab = f"{walker} {at} {after}".strip(), f"lab {before} {after}".strip()
    return {
        "torque": (base, f"{base} --torque 0.001"),
        "ankle_torque": (base, f"{base} --ankle-torque 0.001"),
        "push_off": (base, f"{base} --push-off 0.01"),
        "dimensionless": (f"{base} --torque 1e-3", f"{base} --torque 1e-3 --dimensionless"),
        "controller": (lab, f"{lab} --controller lab-ppo"),
        "scene": (f"{lab} --controller lab-ppo", f"{lab} --controller lab-ppo --scene steep"),
    }


def with_rest(rest, base, other):
    """Words of a command and of its options; all have the same rest."""
    pairs = {option: (base, words) if isinstance(words, str) else words
             for option, words in other.items()}  # fmt: skip
    return (
        f"{rest} {base}",
        {option: (f"{rest} {one}", f"{rest} {two}") for option, (one, two) in pairs.items()},
    )


TABLE: dict[str, tuple[str, dict[str, str | tuple[str, str]]]] = {
    "walkers": ("", {}),
    "scene": ("level", {"scene": "rough"}),
    "gauntlet": (
        "steep-ppo --walkers 2",
        {
            "controller": "steep-sac --walkers 2",
            "scene": ("lqr --scene steep --walkers 2", "lqr --scene level --walkers 2"),
            "walkers": "steep-ppo --walkers 3",
        },
    ),
    "gait": (
        "C 0.03",
        {
            "walker": "lab 0.03",
            "slope": "C 0.04",
            "tune": "C 0.03 --tune",
            "period": ("D 0.016", "D 0.016 --period 2"),
            **motors("0.036"),
        },
    ),
    "family": (
        "D 0.008 0.01",
        {
            "walker": "E 0.008 0.01",
            "low": "D 0.009 0.01",
            "high": "D 0.008 0.012",
            "tune": ("C 0.02 0.03", "C 0.02 0.03 --tune"),
            "kind": "D 0.008 0.01 --kind short",
            **motors("0.0359 0.0361", at="0.008 0.01"),
        },
    ),
    "bifurcation": with_rest(
        "--slopes 2 --n-transient 9 --n-recorded 33",
        "D 0.012 0.0155",
        {
            "walker": "E 0.012 0.0155",
            "low": "D 0.013 0.0155",
            "high": "D 0.012 0.016",
            "tune": ("C 0.02 0.03", "C 0.02 0.03 --tune"),
            "slopes": "D 0.012 0.0155 --slopes 3",
            "n_transient": "D 0.012 0.0155 --n-transient 10",
            "n_recorded": "D 0.012 0.0155 --n-recorded 34",
            "kind": "D 0.012 0.0155 --kind short",
            **motors("0.035 0.036", walker="D", at="0.008 0.01"),
        },
    ),
    "basin": with_rest(
        "--resolution 5 --strides 30",
        "D 0.009",
        {
            "walker": "E 0.009",
            "slope": "D 0.01",
            "tune": ("C 0.018", "C 0.018 --tune"),
            "resolution": "D 0.009 --resolution 6",
            "strides": "D 0.009 --strides 3",
            **motors("0.036", "--strides 20"),
        },
    ),
    "check": (
        "C 0.03",
        {
            "walker": "lab 0.03",
            "slope": "C 0.04",
            "tune": "C 0.03 --tune",
            "kind": "C 0.03 --kind short",
            "friction": "C 0.03 --friction 0.01",
            **motors("0.036"),
        },
    ),
    "robustness": with_rest(
        "--walkers 4 --strides 9 --roughness 2e-4",
        "D --slope 0.009",
        {
            "controller": "lab --slope 0.036",
            "scene": ("lab --slope 0.036", "lab --scene lab --slope 0.036"),
            "slope": "D --slope 0.01",
            "roughness": "D --slope 0.009 --roughness 1e-3",
            "first_passage": "D --slope 0.009 --first-passage mesh",
            "strides": "D --slope 0.009 --strides 19",
            "walkers": "D --slope 0.009 --walkers 9",
            "seed": "D --slope 0.009 --seed 1",
            "out": "D --slope 0.009 --out r.png",
        },
    ),
    "simulate": with_rest(
        "--strides 2 --out w.csv",
        "lab 0.036",
        {
            "walker": "C 0.036",
            "slope": "lab 0.037",
            **WALKED,
            "strides": "lab 0.036 --strides 3",
            "state": f"lab 0.036 {NEAR}",
            **motors("0.036"),
            "terrain": "lab 0.036 --terrain stairs:rise=-0.001",
            "terrain_seed": (
                "lab 0.036 --terrain rough:height_std=1e-3",
                "lab 0.036 --terrain rough:height_std=1e-3 --terrain-seed 1",
            ),
            "samples": "lab 0.036 --samples 9",
            "out": "lab 0.036 --out other.csv",
        },
    ),
    "strobe": with_rest(
        "--strides 1 --out w.png",
        "lab 0.036",
        {
            "walker": "C 0.036",
            "slope": "lab 0.05",
            **WALKED,
            "strides": "lab 0.036 --strides 2",
            "state": f"lab 0.036 {NEAR}",
            **motors("0.036", "--strides 2", "D"),
            "terrain": "lab 0.036 --terrain stairs:rise=-0.02",
            "terrain_seed": (f"lab 0.036 {BUMPY}", f"lab 0.036 {BUMPY} --terrain-seed 1"),
            "out": "lab 0.036 --out other.png",
        },
    ),
    "video": with_rest(
        "--strides 1 --slower 0.1 --out w.gif",
        "D 0.009",
        {
            "walker": "E 0.009",
            "slope": "D 0.018",
            **WALKED,
            "strides": "D 0.009 --strides 2",
            "state": f"D 0.009 {NEAR}",
            **motors("0.036", "--strides 2", "D"),
            "terrain": "D 0.009 --terrain stairs:rise=-0.02",
            "terrain_seed": (f"D 0.009 {BUMPY}", f"D 0.009 {BUMPY} --terrain-seed 1"),
            "out": "D 0.009 --out other.gif",
            "slower": "D 0.009 --slower 0.2",
        },
    ),
    "figures": (
        "4.6",
        {
            "names": "4.10",
            "list": "4.6 --list",
            "out": "4.6 --out there.pdf",
            "size": "4.6 --size 8.5 6",
        },
    ),
    "table": ("4.1", {"number": "4.2"}),
    "evaluate": (
        "steep-ppo --episodes 1",
        {
            "policy": "steep-sac --episodes 1",
            "scene": "steep-ppo --scene level --episodes 1",
            "walker": "steep-ppo --episodes 1 --walker B",
            "slope": "steep-ppo --episodes 1 --slope 0.1",
            "terrain": "steep-ppo --episodes 1 --terrain rough:height_std=0.002",
            "episodes": "steep-ppo --episodes 2",
            "seed": "steep-ppo --episodes 1 --seed 7",
            "time_limit": (
                "lqr --scene steep --slope 0.02 --episodes 1 --time-limit 0",
                "lqr --scene steep --slope 0.02 --episodes 1",
            ),
        },
    ),
    "compare": (
        "passive --walker lab --slope 0.036 --timesteps 0.008 --strides 2",
        {
            "controller": "constant --walker lab --slope 0.036 --timesteps 0.008 --strides 2",
            "scene": "passive --scene lab --walker A --slope 0.02 --timesteps 0.008 --strides 2",
            "walker": "passive --walker A --slope 0.036 --timesteps 0.008 --strides 2",
            "slope": "passive --walker lab --slope 0.04 --timesteps 0.008 --strides 2",
            "timesteps": "passive --walker lab --slope 0.036 --timesteps 0.004 --strides 2",
            "softness": (
                "passive --walker lab --slope 0.036 --timesteps 0.008 --strides 2 --softness 0"
            ),
            "strides": "passive --walker lab --slope 0.036 --timesteps 0.008 --strides 3",
        },
    ),
    "export": (
        "lab walker.xml",
        {
            "name": "C walker.xml",
            "out": "lab walker.urdf",
            "slope": "lab walker.xml --slope 0.036",
            "timestep": "lab walker.xml --timestep 0.0001",
            "unit_length": (
                "examples.torso:TORSO t.xml --unit-length 1 --unit-mass 2",
                "examples.torso:TORSO t.xml --unit-length 2 --unit-mass 2",
            ),
            "unit_mass": (
                "examples.torso:TORSO t.xml --unit-length 1 --unit-mass 2",
                "examples.torso:TORSO t.xml --unit-length 1 --unit-mass 3",
            ),
        },
    ),
    "play": with_rest(
        "--seconds 0.1 --video f.gif",
        "lab 0.036",
        {
            "walker": "C 0.036",
            "slope": "lab 0.02",
            "policy": "lab 0.036 --policy lab-ppo",
            "seconds": "lab 0.036 --seconds 0.2",
            "video": "lab 0.036 --video g.gif",
            "picture": "lab 0.036 --picture q.png",
        },
    ),
    "warmup": ("", {}),
}
"""For each command: words, and for each of its options other words; or a pair of both."""


def options(command: argparse.ArgumentParser) -> set[str]:
    """Names of a command's options; --trust is tested where there is code to trust."""
    return {action.dest for action in command._actions} - {"help", "json", "trust"}


def subparsers() -> dict[str, argparse.ArgumentParser]:
    (found,) = (each for each in parser()._actions if isinstance(each, argparse._SubParsersAction))
    return dict(found.choices)


def test_every_option_of_every_command_is_tested():
    commands = subparsers()
    assert set(commands) == {each.__name__ for each in COMMANDS} == {*TABLE, "sweep"}
    for name, (_, other) in TABLE.items():
        assert options(commands[name]) == set(other), name


KNOWN: dict[tuple[str, str], tuple] = {}
"""Answers of commands that were given already."""


def answer(name: str, words: str, folder: Path, monkeypatch) -> tuple:
    """Output of a command for people and for programs, and its files."""
    if (name, words) not in KNOWN:
        folder.mkdir()
        monkeypatch.chdir(folder)
        arguments = parser().parse_args([name, *shlex.split(words)])
        said = call_with(arguments.command, arguments)
        for path, write in said.files.items():
            write(path)
        there = (path for path in sorted(folder.rglob("*")) if path.is_file())
        files = {str(path.relative_to(folder)): path.read_bytes() for path in there}
        KNOWN[name, words] = said.text, json.dumps(plain(said.data)), files
    return KNOWN[name, words]


CASES = [(name, option) for name, (_, other) in TABLE.items() for option in other]


def noted(name: str, path: Path, size: tuple[float, float] | None) -> list[Path]:
    """A replacement of a figure: its name and size."""
    path.write_text(f"{name} {size}")
    return [path]


@pytest.mark.parametrize("name, option", CASES)
def test_an_option_of_a_command_is_heard(name, option, tmp_path, monkeypatch):
    drawn = {"strobe": "matplotlib", "figures": "matplotlib"}
    needed = {**drawn, "video": "moviepy", "play": "moviepy", "compare": "mujoco"}
    if name in needed:
        pytest.importorskip(needed[name])
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    if name == "figures":  # which are drawn in `tests/pictures`
        from gym_passive_walker.pictures import figures

        monkeypatch.setattr(figures, "draw", noted)
    if name == "evaluate":  # of short episodes
        monkeypatch.setitem(gpw.evaluate.__kwdefaults__, "max_episode_steps", 300)
    base, other = TABLE[name]
    base, changed = other[option] if isinstance(other[option], tuple) else (base, other[option])
    before, after = (
        answer(name, words, tmp_path / place, monkeypatch)
        for place, words in (("before", base), ("after", changed))
    )
    if option in ("out", "video", "picture"):  # which is the same elsewhere, or is there besides
        assert set(before[2]) != set(after[2])
    elif name in ("strobe", "video", "play", "figures"):
        assert list(before[2].values()) != list(after[2].values())
    else:  # in all that the command has to say
        assert (before[0] != after[0] and before[1] != after[1]) or option == "samples"
        assert list(before[2].values()) != list(after[2].values()) or not before[2]


def test_a_walk_is_simulated_as_the_words_say(capsys):
    """For each option, against the same computation in Python."""
    words = (
        f"lab 0.03 --strides 3 {NEAR} --torque 0.1 --terrain rough:height_std=1e-3 --terrain-seed 5"
    )
    assert main(["simulate", *shlex.split(words), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    state = np.array([float(x) for x in NEAR.split()[1:]])
    walk = gpw.simulate(
        "lab", 0.03, state, 3, samples=2, hip_torque=0.1, terrain=gpw.rough(1e-3), terrain_seed=5
    )
    assert [row["stance_angle"] for row in rows] == walk.states[::2, 0].tolist()
