"""Figures of a gait need no display, and show the walk."""

import subprocess
import sys

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker.gaits.look.trajectory import simulate
from gym_passive_walker.gaits.terrain import footholds
from gym_passive_walker.models.equations.hybrid import Stage
from gym_passive_walker.models.walkers import WALKERS
from gym_passive_walker.pictures import phase_portrait, pose, strobe, strobe_of
from gym_passive_walker.pictures.axes import OWN
from gym_passive_walker.pictures.pose import level

pytest.importorskip("matplotlib")

SLOPE = 0.036
GAIT = np.array([0.24395, -0.24395, -0.24395, -1.0491, -0.3015, -1.4831])
SHORT = [0.20031, -0.20031, -0.20031, -0.62589, -0.57633, -0.57633]


def hips(ax):
    """Places of the hips in a stroboscopic picture."""
    return next(line.get_xydata() for line in ax.lines if line.get_marker() == "o")


def test_a_strobe_picture_has_one_posture_for_each_flash():
    ax = strobe("lab", SLOPE, GAIT, strides=2, flashes=5)
    assert len(hips(ax)) == 2 * 5 - 1  # the heelstrike between them is one posture


def test_both_legs_are_heavy_at_heelstrikes_and_at_both_ends():
    ax = strobe("lab", SLOPE, GAIT, strides=2, flashes=4)
    legs = [line for line in ax.lines if line.get_ls() == "-" and len(line.get_xdata()) == 3]
    widths = [[x.get_lw() for x in legs if np.allclose(x.get_xydata()[0], hip)] for hip in hips(ax)]
    heavy, light = [2.0, 2.0], [1.0, 1.0]
    assert widths == [heavy, light, light, heavy, light, light, heavy]


GROUNDS = {"smooth": {}, "tilted": {"terrain": footholds([0.0, 0.0, 0.002], [0.0, 0.02, -0.02])}}


@pytest.mark.parametrize("ground", GROUNDS.values(), ids=GROUNDS)
def test_a_strobe_picture_stands_on_its_slope_and_footholds(ground):
    ax = strobe("lab", SLOPE, GAIT, strides=3, flashes=3, ax=OWN, **ground)
    walk = simulate("lab", SLOPE, GAIT, strides=3, samples=3, **ground)
    assert (np.ptp(walk.tilts) > 0.01) == bool(ground)
    once = np.append(np.diff(walk.stride_index) == 0, True)
    posture = pose("lab", walk.states, walk.contact_x, walk.contact_y, walk.tilts)
    np.testing.assert_allclose(hips(ax), level(posture.hip[once], SLOPE))


def test_a_recorded_walk_gives_the_same_picture_but_for_its_kneestrikes():
    walk = simulate("lab", SLOPE, GAIT, samples=6)
    recorded = strobe_of("lab", walk.states, walk.contact_x, SLOPE, ax=OWN).lines
    simulated = strobe("lab", SLOPE, GAIT, strides=1, flashes=6, ax=OWN).lines
    simulated = [line for line in simulated if line.get_marker() != "D" and line.get_ls() != ":"]
    for one, other in zip(recorded, simulated, strict=True):
        np.testing.assert_array_equal(one.get_xydata(), other.get_xydata())
        assert one.get_color() == other.get_color()


@pytest.mark.parametrize("ground", GROUNDS.values(), ids=GROUNDS)
def test_kneestrikes_are_marked_on_the_legs_where_thigh_and_shank_meet(ground):
    ax = strobe("lab", SLOPE, GAIT, strides=3, ax=OWN, **ground)
    (marked,) = [line.get_xydata() for line in ax.lines if line.get_marker() == "D"]
    legs = [line.get_xydata() for line in ax.lines if line.get_ls() == ":"]
    np.testing.assert_array_equal([leg[1] for leg in legs], marked)
    walk = simulate("lab", SLOPE, GAIT, strides=3, samples=20_001, **ground)
    assert len(marked) == len(walk.outcomes) == 3
    for stride, mark in enumerate(marked):
        struck = np.argmax((walk.stride_index == stride) & (walk.phases == Stage.LOCKED))
        contact = walk.contact_x[struck], walk.contact_y[struck], walk.tilts[struck]
        knee = pose("lab", walk.states[struck], *contact).swing.knee
        np.testing.assert_allclose(mark, level(knee, SLOPE), atol=1e-4)


def test_kneestrikes_of_a_controller_that_looks_ahead_are_those_of_its_walk():
    strides = gpw.stride_map("lab", SLOPE, controller=gpw.load_policy("rough-ppo"), scene="rough")
    ground = {"terrain": gpw.rough(0.003), "terrain_seed": 3}
    ax = strobe(strides, state=GAIT, strides=3, ax=OWN, **ground)
    (marked,) = [line.get_xydata() for line in ax.lines if line.get_marker() == "D"]
    walk = simulate(strides, state=GAIT, strides=3, samples=2001, **ground)
    struck = walk.struck[np.diff(walk.stride_index)[walk.struck - 1] == 0]
    assert len(struck) == 3
    there = (values[struck] for values in (walk.states, walk.contact_x, walk.contact_y, walk.tilts))
    np.testing.assert_allclose(marked, level(pose("lab", *there).swing.knee, SLOPE), atol=1e-3)


def test_marks_on_the_ground_count_leg_lengths():
    ax = strobe("lab", SLOPE, GAIT, strides=3, ax=OWN)
    values = np.array([float(text.get_text().strip("$").split("\\")[0]) for text in ax.texts])
    places = np.array([text.get_position() for text in ax.texts])
    apart = np.linalg.norm(places - places[0], axis=1) / WALKERS["lab"].leg_length
    assert len(values) > 3
    np.testing.assert_allclose(values - values[0], apart, atol=1e-9)


def test_a_fall_can_be_pictured():
    ax = strobe("lab", SLOPE, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0], flashes=4)
    assert len(hips(ax)) == 4


def test_a_strobe_picture_goes_into_given_axes():
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots(1, 2)
    assert strobe("D", 0.009, SHORT, flashes=3, ax=axes[1]) is axes[1]
    assert axes[1].lines and not axes[0].lines


@pytest.mark.parametrize(("name", "slope", "start"), [("lab", SLOPE, GAIT), ("D", 0.009, SHORT)])
def test_pictures_are_written_to_files(name, slope, start, tmp_path):
    strobe(name, slope, start, flashes=3, path=tmp_path / "strobe.png")
    phase_portrait(name, slope, start, samples=20, path=tmp_path / "portrait.svg")
    assert (tmp_path / "strobe.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "portrait.svg").read_text()


def test_angles_over_time_follow_each_leg_through_both_its_roles():
    over_time, _ = phase_portrait("lab", SLOPE, GAIT, strides=2, samples=50)
    curves = {line.get_label(): line for line in over_time.lines}
    walk = simulate("lab", SLOPE, GAIT, strides=2, samples=50)
    np.testing.assert_array_equal(
        curves["first stance leg, thigh"].get_ydata(),
        np.append(walk.states[:50, 0], walk.states[50:, 1]),
    )
    np.testing.assert_array_equal(
        curves["other leg, shank"].get_ydata(), np.append(walk.states[:50, 2], walk.states[50:, 0])
    )
    np.testing.assert_allclose(
        curves["other leg, shank"].get_xdata(), walk.times / WALKERS["lab"].time_unit
    )


def test_a_portrait_is_lifted_at_strikes_and_dots_join_what_they_part():
    _, portrait = phase_portrait("lab", SLOPE, GAIT, strides=2, samples=50)
    curves = {line.get_label(): line.get_xydata() for line in portrait.lines}
    assert np.isnan(curves["swing shank"][:, 1]).sum() == 3  # two kneestrikes, one heelstrike
    jumps = [
        line
        for line in portrait.lines
        if line.get_linestyle() == ":" and len(line.get_xdata()) == 2
    ]
    assert len(jumps) == 3 * 3


def test_a_straight_leg_has_one_curve():
    over_time, portrait = phase_portrait("D", 0.009, SHORT)
    labels = [line.get_label() for ax in (over_time, portrait) for line in ax.lines]
    assert {"first stance leg", "other leg", "stance leg", "swing leg"} <= set(labels)
    assert not any("shank" in label for label in labels)


def test_states_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"shape \(n, 6\)"):
        strobe_of("lab", GAIT, 0.0, SLOPE)


def test_without_matplotlib_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r'pip install "gym-passive-walker\[figures\]"'):
        strobe("lab", SLOPE, GAIT)


def test_pictures_load_no_more_than_they_need(tmp_path):
    code = (
        "import sys, gym_passive_walker.pictures as render\n"
        "assert not {'pygame', 'matplotlib'} & set(sys.modules), 'loaded by the import'\n"
        f"render.phase_portrait('lab', {SLOPE}, {GAIT.tolist()}, samples=9, path=sys.argv[1])\n"
        "assert not {'pygame', 'matplotlib.pyplot'} & set(sys.modules), 'loaded by a figure'\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "portrait.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("drawn", [strobe, phase_portrait])
def test_a_picture_s_name_is_refused_before_the_walk_is_computed(drawn, monkeypatch, tmp_path):
    for module in ("strobe", "portrait"):
        drawing = sys.modules[f"gym_passive_walker.pictures.{module}"]
        monkeypatch.setattr(drawing, "simulate", lambda *_, **__: pytest.fail("it walks"))
    with pytest.raises(ValueError, match="must end in one of"):
        drawn("lab", SLOPE, GAIT, path=tmp_path / "walk.doc")
