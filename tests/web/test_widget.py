"""The widget of notebooks, by its traits."""

import json
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.envs.policies import policy_folder

pytest.importorskip("anywidget")

from gym_passive_walker.apps.widget import PlayerWidget


@pytest.fixture
def notebook(monkeypatch):
    """Let the process be a kernel of Jupyter."""
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))


def test_a_gait_is_shown_as_it_is(notebook):
    gait = gpw.find_gait("C", 0.02)
    widget = gpw.play(gait)
    assert (widget.given["walker"], widget.given["changes"]) == ("C", {})
    assert widget.given["start"] == pytest.approx(gait.walker.units.to_dimensionless(gait.state))
    assert (widget.slope, widget.hip_torque, widget.policy) == (0.02, 0.0, "")
    assert widget.walker == gait.walker
    assert (widget.state, widget.strides, widget.outcome) == ([], 0, "")


def test_a_walker_is_its_preset_and_the_changes(notebook):
    walker = gpw.as_walker({"preset": "B", "hip_mass": 0.25, "gravity": 1.62})
    widget = gpw.play(walker, 0.03)
    assert widget.given["walker"] == "B"
    assert widget.given["changes"] == {"hip_mass": 0.25, "gravity": 1.62}
    assert widget.walker == walker and "start" not in widget.given


def test_a_gait_under_a_torque_keeps_it(notebook):
    walker = gpw.WALKERS["C"]
    torque = 0.001 * walker.units.torque
    strides = gpw.stride_map(walker, 0.02, controller=gpw.Actuation(hip_torque=torque))
    assert gpw.play(gpw.find_gait(strides)).hip_torque == pytest.approx(0.001, rel=1e-12)


def test_a_system_of_ones_own_goes_with_the_widget(notebook):
    gait = gpw.find_gait(TORSO.vary(torso=0.08), 0.03)
    widget = gpw.play(gait)
    assert widget is not None and list(widget.files) == ["systems/own.wasm"]
    assert widget.given == {"system": "own", "start": gait.state.tolist()}
    assert (widget.slope, widget.parameters["torso"]) == (0.03, 0.08)
    widget.set_state({"parameters": widget.parameters | {"torso": 0.09}})
    assert isinstance(widget.walker, gpw.System) and widget.walker.body.torso == 0.09
    assert "start" not in gpw.play(TORSO, 0.03).given


@pytest.mark.parametrize("form", ["name", "gait"])
def test_a_policy_works_the_motors(notebook, form):
    policy = gpw.load_policy("level-ppo")
    given = {"policy": "level-ppo"} if form == "name" else {"walker": gpw.closed_loop_gait(policy)}
    widget = gpw.play(**given)
    assert (widget.given["policy"], widget.policy) == ("level-ppo", "level-ppo")
    assert widget.slope == policy.scene.slope and widget.walker == policy.scene.walker


def test_a_policy_from_a_folder_goes_with_the_widget(notebook, tmp_path):
    shutil.copytree(policy_folder("steep-ppo"), tmp_path / "mine")
    widget = gpw.play(policy=tmp_path / "mine")
    policies = json.loads(widget.files["data.json"])["policies"]
    assert policies["mine"] == policies["steep-ppo"]
    assert (
        widget.files["policies/mine.safetensors"]
        == (widget.files["policies/steep-ppo.safetensors"])
    )


@pytest.mark.parametrize(
    "controller", [gpw.Actuation(push_off=0.05), lambda seen: 0.01 * seen[:, :1]]
)
def test_a_gait_under_another_controller_is_refused(notebook, controller):
    strides = gpw.stride_map("D", 0.009, controller=controller)
    with pytest.raises(ValueError, match="constant hip torque or a trained policy"):
        gpw.play(gpw.find_gait(strides))


def test_where_a_picture_is_asked_for_there_is_no_widget(notebook, tmp_path):
    pytest.importorskip("pygame")
    assert gpw.play(gpw.find_gait("C", 0.02), picture=tmp_path / "last.png", seconds=0.1) is None
    assert (tmp_path / "last.png").exists()


def test_without_the_extra_the_error_names_it(notebook, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "gym_passive_walker.apps.widget")
    with pytest.raises(ImportError, match=r"anywidget.*gym-passive-walker\[notebook\]"):
        gpw.play("C", 0.02)


@pytest.fixture(scope="module")
def widget():
    return PlayerWidget(gpw.WALKERS["C"], 0.02)


def test_what_the_page_reports_is_read(widget):
    widget.set_state({"state": [0.1, -0.1, -0.2, 1.0, 2.0, 3.0], "strides": 7, "outcome": ""})
    assert np.shape(widget.state) == (6,) and widget.strides == 7


@pytest.mark.parametrize(("trait", "value"), [("slope", 2.0), ("speed", 0.0), ("running", "no")])
def test_a_setting_out_of_range_is_refused(widget, trait, value):
    before = getattr(widget, trait)
    with pytest.raises(Exception, match=trait):
        setattr(widget, trait, value)
    assert getattr(widget, trait) == before


def test_a_torque_is_held_where_nothing_else_works_the_motor(widget, notebook):
    widget.hip_torque = 0.08
    policy = gpw.play(policy="level-ppo")
    for other, why in (
        (policy, "the policy level-ppo works it"),
        (gpw.play(TORSO, 0.03), "has none"),
    ):
        with pytest.raises(Exception, match=f"hip_torque is that of a held motor, and .*{why}"):
            other.hip_torque = 0.01
        assert other.hip_torque == 0.0
    policy.set_state({"policy": "", "hip_torque": 0.002})  # as the page reports
    assert policy.hip_torque == 0.002


def test_a_push_is_sent_to_the_page(widget, monkeypatch):
    sent = []
    monkeypatch.setattr(widget, "send", sent.append)
    widget.push(0.01)
    widget.begin()
    assert sent == [{"push": 0.01}, {"again": True}]
    with pytest.raises(ValueError, match="impulse must be a number from -10 to 10"):
        widget.push(np.nan)


def test_the_widget_is_one_module(node, tmp_path):
    module = tmp_path / "widget.mjs"
    module.write_text(PlayerWidget._esm, encoding="utf-8")
    code = f"import({json.dumps(module.as_uri())}).then((m) => console.log(Object.keys(m.default)))"
    done = subprocess.run([node, "-e", code], capture_output=True, text=True, check=True)
    assert "render" in done.stdout


@pytest.mark.parametrize("impulse", [-10.0, 10.0])
def test_a_push_may_be_as_hard_as_in_an_environment(widget, impulse, monkeypatch):
    sent = []
    monkeypatch.setattr(widget, "send", sent.append)
    widget.push(impulse)
    widget.begin()
    assert sent == [{"push": impulse}, {"again": True}]
    for wrong in (1.01 * impulse, np.nan, "hard", None):
        with pytest.raises(ValueError, match="impulse"):
            widget.push(wrong)
    assert len(sent) == 2


@pytest.mark.parametrize("speed", [2.0**-6, 4.0])
def test_a_picture_may_be_as_slow_and_as_fast_as_its_limits(widget, speed):
    widget.speed = speed
    assert widget.speed == speed
    with pytest.raises(Exception, match="speed"):
        widget.speed = 1.01 * speed if speed > 1.0 else 0.99 * speed


@pytest.mark.parametrize("preset", gpw.WALKERS)
def test_any_walker_is_its_own_preset_and_a_slight_change_is_one(preset, notebook):
    widget = PlayerWidget(gpw.WALKERS[preset], 0.02, 0.25)
    assert (widget.given, widget.hip_torque) == ({"walker": preset, "changes": {}}, 0.25)
    heavier = gpw.as_walker({"preset": preset, "gravity": 5.0})
    assert PlayerWidget(heavier, 0.02).given == {"walker": preset, "changes": {"gravity": 5.0}}
    assert PlayerWidget(heavier, 0.02).walker == heavier


@pytest.mark.parametrize("wrong", [[0.1] * 5, [np.nan] * 6, "no"])
@pytest.mark.parametrize("walker", ["C", TORSO])
def test_a_start_that_is_none_is_refused(walker, wrong, notebook):
    walker = gpw.WALKERS[walker] if walker == "C" else walker
    with pytest.raises(ValueError):
        PlayerWidget(walker, 0.02, start=wrong)
