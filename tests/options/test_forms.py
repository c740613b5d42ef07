"""Each public function accepts a walker, ground and a controller in every allowed form."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache

import gymnasium as gym
import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools.loading import read_content
from gym_passive_walker.apps.sweeps.description import Description
from gym_passive_walker.apps.sweeps.tasks import task
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.gaits.terrain import terrain_from
from gym_passive_walker.models.walkers import as_walker, describe, name_of
from tests.options.effects import plain
from tests.options.test_functions import OF_D, OPTIONS, Later

WALKERS = ("walker", "a", "b")
BESIDE = {"robustness": ("controller",)}
"""Further arguments that may be walkers."""
NO_WALKERS = {"play"}  # its frames take long to draw
TAKING = [
    name
    for name, call in OPTIONS.items()
    if name not in NO_WALKERS
    and any(
        isinstance(call.base.get(x), str | gpw.Walker) for x in (*WALKERS, *BESIDE.get(name, ()))
    )
]
"""Calls of every public function that takes a walker: `test_functions` has all of them."""

FORMS = ("Walker", "mapping", "JSON", "YAML", "TOML")
GROUND = gpw.rough(height_std=0.001)
GROUNDS = {
    "Terrain": GROUND,
    "mapping": {"rough": {"height_std": 0.001}},
    "text": "rough:height_std=0.001",
    "JSON text": '{"rough": {"height_std": 0.001}}',
    "file": "ground.yaml",
    "TOML": "ground.toml",
}
SLOW = {"tune_to_walk", "optimize_walker", "robustness"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ground.yaml").write_text("rough: {height_std: 1e-3}")
    (tmp_path / "ground.toml").write_text("[rough]\nheight_std = 0.001")
    return tmp_path


def formed(walker, form, folder, name="mine"):
    """A walker in one of `FORMS`."""
    parameters = asdict(as_walker(walker))
    if form == "Walker":
        return as_walker(walker)
    if form == "mapping":
        return parameters
    path = folder / f"{name}.{form.lower()}"
    lines = {"YAML": "{}: {}\n", "TOML": "{} = {}\n"}.get(form)
    text = json.dumps(parameters)
    if lines:
        text = "".join(lines.format(x, json.dumps(value)) for x, value in parameters.items())
    path.write_text(text)
    return path if form == "TOML" else str(path)


def now(arguments):
    return {x: v.value() if isinstance(v, Later) else v for x, v in arguments.items()}


@cache
def usual(name):
    return plain(OPTIONS[name].function(**now(OPTIONS[name].base)))


@pytest.mark.parametrize("form", ["mapping", "TOML"])  # an object and a file stand for the others
@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.slow] * (x in SLOW)) for x in TAKING]
)
def test_every_public_function_takes_a_walker_as_an_object_and_as_a_file(name, form, folder):
    call = OPTIONS[name]
    given = {
        x: formed(value, form, folder, name=x)
        if x in WALKERS and isinstance(value, str | gpw.Walker)
        else value
        for x, value in call.base.items()
    }
    assert plain(call.function(**now(given))) == usual(name)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "walker_in",
    [
        lambda walker: make_scene("level", walker=walker).walker,
        lambda walker: gym.make("PassiveWalker-v0", walker=walker).unwrapped.scene.walker,
        lambda walker: gym.make_vec("PassiveWalker-v0", 2, walker=walker).unwrapped.scene.walker,
        lambda walker: (
            gym.make_vec("PassiveWalker-v0", 2, walkers=[walker, walker]).unwrapped.scene.walker
        ),
        lambda walker: task("gait", {"walker": walker, "slope": 0.01}).keywords["walker"],
        lambda walker: as_walker(
            Description(analysis="gait", over={"slope": [0.01]}, given={"walker": walker}).tasks[0][
                "walker"
            ]
        ),
    ],
    ids=["make_scene", "make", "make_vec", "walkers", "task", "sweep"],
)
def test_environments_and_sweeps_take_a_walker_in_each_form(walker_in, form, folder):
    assert walker_in(formed("E", form, folder)) == gpw.WALKERS["E"]


@pytest.mark.parametrize("given", GROUNDS.values(), ids=GROUNDS)
def test_walks_environments_and_sweeps_take_ground_in_each_form(given):
    assert terrain_from(given) == GROUND
    assert gpw.simulate("D", 0.009, OF_D.value(), terrain=given).terrain == GROUND
    assert gym.make("PassiveWalker-v0", terrain=given).unwrapped.scene.terrain == GROUND
    swept = Description(analysis="evaluation", over={"terrain": [given]})
    assert terrain_from(swept.tasks[0]["terrain"]) == GROUND


@pytest.mark.parametrize(
    "slope", [0.01, np.float64(0.01), np.array(0.01)], ids=["float", "64", "0d"]
)
def test_a_slope_is_any_number(slope):
    assert gpw.find_gait("D", slope).slope == 0.01
    assert gym.make("PassiveWalker-v0", slope=slope).unwrapped.scene.slope == 0.01


def test_a_gait_is_a_walker_on_its_slope_in_its_state():
    gait = gpw.find_gait("D", 0.012)
    apart = (gait.walker, gait.slope, gait.state)
    for analysis in (gpw.stride, gpw.simulate, gpw.reality_check, gpw.stride_jacobian):
        assert plain(analysis(gait)) == plain(analysis(*apart))
    assert gpw.stride(gait, 0.013).duration == gpw.stride(apart[0], 0.013, apart[2]).duration


def test_a_gait_keeps_its_period_and_its_motors():
    driven = gpw.find_gait(gpw.stride_map("E", 0.01, controller=gpw.Actuation(hip_torque=0.001)))
    assert gpw.stride(driven).hip_work == pytest.approx(driven.stride.hip_work, rel=1e-9) != 0.0
    assert gpw.stride(driven, hip_torque=0.0).hip_work == 0.0
    pushed = gpw.find_gait(gpw.stride_map("D", 0.009, controller=gpw.Actuation(push_off=0.01)))
    assert gpw.simulate(pushed, strides=2).ending == "heelstrike"
    assert gpw.reality_check(pushed).push_off_impulse.normal_impulse > 0.0
    assert gpw.reality_check(gpw.find_gait("D", 0.016, period=2)).strides == 2


def test_a_walker_of_a_file_is_called_by_the_file_or_its_title(folder):
    mine = as_walker(formed("E", "JSON", folder))
    assert name_of(mine) == "mine" and describe(mine) == "walker 'mine'"
    assert name_of(gpw.tune(mine)) == "mine (tuned)"
    assert mine == gpw.WALKERS["E"] and hash(mine) == hash(gpw.WALKERS["E"])
    assert "mine" in repr(gpw.find_gait(mine, 0.01))
    assert name_of(as_walker({"preset": "E", "title": "biped"})) == "biped"
    with pytest.raises(gpw.WalkerError, match="title must be text"):
        as_walker({"preset": "E", "title": 3})


def test_a_sweep_keeps_what_a_file_held(folder):
    (folder / "sweep.toml").write_text(
        'analysis = "gait"\n[over]\nslope = [0.01]\n[given]\nwalker = "mine.json"'
    )
    formed("E", "JSON", folder)
    before = Description.of(read_content("sweep.toml"))
    formed("D", "JSON", folder)
    assert before.tasks[0]["walker"]["title"] == "mine"
    assert as_walker(before.tasks[0]["walker"]) == gpw.WALKERS["E"]
    assert Description.of(read_content("sweep.toml")).digest != before.digest


def test_a_sweep_is_given_by_its_file(folder):
    pytest.importorskip("pyarrow")
    (folder / "mine.yaml").write_text("analysis: gait\nover: {slope: [0.009]}\ngiven: {walker: D}")
    found = gpw.sweep("mine.yaml", workers=1)
    assert found.folder.name == "mine" and found.columns()["found"].all()


@pytest.mark.parametrize("name", ["mine.txt", "missing.json", "list.json"])
def test_a_file_that_holds_no_walker_is_named(name, folder):
    (folder / "mine.txt").write_text("{}")
    (folder / "list.json").write_text("[1]")
    with pytest.raises(gpw.WalkerError, match=name):
        as_walker(folder / name)
