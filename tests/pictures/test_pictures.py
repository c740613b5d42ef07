"""Numbers, units, labels and files of plots are those of the objects that they show."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib import colors
from matplotlib.figure import Figure

import gym_passive_walker as gpw
from gym_passive_walker.gaits.branches.bifurcation import BifurcationDiagram
from gym_passive_walker.gaits.branches.doubling import Cascade
from gym_passive_walker.gaits.robust.basin import FELL, UNSETTLED, Basin
from gym_passive_walker.models.walkers import WALKERS
from gym_passive_walker.pictures import axes, diagram, plots, portrait
from gym_passive_walker.pictures.axes import OWN
from gym_passive_walker.pictures.pose import level, pose

WIDE = replace(WALKERS["lab"], gravity=1.6, hip_mass=3.0)
"""A walker with units of time, mass and length that all differ from 1."""


@pytest.fixture(scope="module")
def gait():
    return gpw.find_gait(WIDE, 0.036)


@pytest.fixture(scope="module")
def family():
    return gpw.gait_family("D", 0.012, 0.016)


def lines(ax):
    """Points of the lines that have a label, by label."""
    return {
        line.get_label(): line.get_xydata()
        for line in ax.lines
        if not line.get_label().startswith("_")
    }


def said(ax):
    """Labels of both axes, and the title."""
    title = ax.get_title() or ax.get_title(loc="right")
    return ax.get_xlabel(), ax.get_ylabel(), title


# Style, legends and files


def test_the_first_eight_curves_differ_in_colour_and_marker_and_go_on_from_the_first():
    styles = [axes.series(index) for index in range(9)]
    for key in ("color", "marker"):
        assert len({style[key] for style in styles[:8]}) == 8 and styles[8][key] == styles[0][key]
    assert len({(style["color"], str(style["linestyle"])) for style in styles}) == 9
    assert all(style["markersize"] == 4.0 for style in styles)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 3), (3, 2)])
def test_panels_stand_row_by_row_in_a_figure_of_the_size_asked_for(rows, columns):
    figure, found = axes.panels(rows, columns, (4.0, 3.0))
    assert tuple(figure.get_size_inches()) == (4.0, 3.0)
    places = [ax.get_subplotspec() for ax in found]
    assert [(place.rowspan.start, place.colspan.start) for place in places] == [
        (row, column) for row in range(rows) for column in range(columns)
    ]
    for ax in found:
        shown = {side: ax.spines[side].get_visible() for side in ax.spines}
        assert shown == {"left": True, "bottom": True, "top": False, "right": False}


def test_a_line_is_interrupted_before_each_index():
    np.testing.assert_array_equal(
        axes.broken(np.arange(5), np.array([1, 4])), [0, np.nan, 1, 2, 3, np.nan, 4]
    )
    np.testing.assert_array_equal(axes.broken(np.arange(3), np.array([], int)), [0, 1, 2])


@pytest.mark.parametrize(("columns", "expected"), [(1, 1), (2, 2), (3, 3), (9, 5)])
def test_a_legend_has_no_more_columns_than_asked_for_or_than_fit_and_each_label_once(
    columns, expected
):
    figure = Figure(figsize=(10.0, 4.0))
    ax = figure.subplots()
    ax.set_position((0.1, 0.3, 0.85, 0.6))  # 8.5 inches: five columns of 1.6
    for index in range(10):
        ax.plot([0, 1], [index, 1], label=f"curve {index % 5}")
    axes.legend(ax, columns=columns)
    legend = ax.get_legend()
    assert legend._ncols == expected
    assert [text.get_text() for text in legend.get_texts()] == [f"curve {i}" for i in range(5)]


@pytest.mark.parametrize("gap", [4.0, 40.0, 90.0])
def test_a_legend_begins_below_the_axes_by_the_gap_in_points(gap):
    figure = Figure(figsize=(4.0, 4.0), dpi=100.0)
    ax = figure.subplots()
    ax.plot([0, 1], label="a")
    axes.legend(ax, gap=gap)
    figure.draw_without_rendering()
    top = ax.get_legend().get_window_extent().y1
    assert ax.get_window_extent().y0 - top == pytest.approx(gap / 72.0 * 100.0, abs=1.0)


@pytest.mark.parametrize(("kind", "place"), [("png", b"Description"), ("svg", b"description"),
                                             ("pdf", b"Subject")])  # fmt: skip
def test_a_caption_is_in_the_metadata_of_each_kind_of_file(kind, place, tmp_path):
    figure, _ = axes.panels(size=(1.5, 1.0))
    for name, caption in (("with", "what is shown"), ("without", "")):
        assert axes.save(figure, tmp_path / "deep" / f"{name}.{kind}", caption) is figure
    kept, bare = ((tmp_path / "deep" / f"{name}.{kind}").read_bytes() for name in
                  ("with", "without"))  # fmt: skip
    assert place in kept and b"what is shown" in kept and b"what is shown" not in bare


def test_a_picture_of_pixels_has_200_to_an_inch_and_no_path_writes_nothing(tmp_path, monkeypatch):
    from matplotlib.image import imread

    monkeypatch.chdir(tmp_path)
    figure, _ = axes.panels(size=(1.5, 1.0))
    assert axes.save(figure, None) is figure and not list(tmp_path.iterdir())
    axes.save(figure, "walk")
    assert imread("walk.png").shape[:2] == (200, 300)
    assert axes.picture_path(tmp_path / "Walk.PNG") == tmp_path / "Walk.PNG"
    axes.save(figure, tmp_path / "Walk.PNG", "caption")
    assert b"caption" in (tmp_path / "Walk.PNG").read_bytes()
    for name in ("walk.gif.doc", "a.xyz"):
        with pytest.raises(ValueError, match=rf"\.png.*\.svg.*{re.escape(name)}"):
            axes.picture_path(tmp_path / name)


# Gaits and their branches


@pytest.mark.parametrize("by", plots.PLOTTED)
def test_a_branch_is_drawn_by_each_measure_over_its_parameter(by, family):
    ax = family.plot(OWN, by=by, color="#123456")
    value = {
        "stance_angle": family.stance_angle,
        "froude_speed": family.froude_speed,
        "largest_multiplier": np.abs(family.multipliers).max(axis=1),
    }[by]
    light, heavy = ax.lines[:2]
    np.testing.assert_allclose(light.get_xydata(), np.column_stack([family.slope, value]))
    assert said(ax)[:2] == ("slope γ (rad)", plots.PLOTTED[by])
    assert heavy.get_linewidth() == 2.6 and light.get_linewidth() == 0.9
    assert {line.get_color() for line in ax.lines[:4]} == {"#123456"}
    # Bifurcations lie on the curve.
    for line in ax.lines:
        if line.get_marker() in "dhs" and len(line.get_xdata()):
            on_it = np.interp(line.get_xdata(), family.slope, value)
            np.testing.assert_allclose(line.get_ydata(), on_it, rtol=1e-9)


@pytest.mark.parametrize("first", [True, False])
def test_a_branch_that_passes_a_slope_twice_is_marked_where_the_period_doubles(family, first):
    """Of two gaits at the slope, only one has a multiplier of -1."""
    other = 1.5 * family.multipliers
    order = slice(None, None, 1 if first else -1)

    def both(here, there):
        return np.concatenate([here, there[::-1]][order])

    angle = both(family.stance_angle, family.stance_angle + 1.0)
    folded = replace(
        family, value=both(family.value, family.value), stance_angle=angle,
        multipliers=both(family.multipliers, other),
    )  # fmt: skip
    ax = Figure().subplots()
    plots.draw_family(ax, folded)
    (doublings,) = (line for line in ax.lines if line.get_marker() == "d")
    assert len(doublings.get_ydata()) == len(family.period_doublings) > 0
    assert max(doublings.get_ydata()) < 1.0 < max(angle)


def test_measures_are_labelled_by_what_they_are():
    assert plots.PLOTTED == {
        "stance_angle": "stance angle θ (rad)",
        "froude_speed": "speed v / √(g l)",
        "largest_multiplier": "modulus of the largest multiplier",
    }


def test_a_legend_names_widths_and_marks_only_where_they_occur(family):
    stable = gpw.gait_family("D", 0.005, 0.01)
    marked = {text.get_text() for text in family.plot(OWN).get_legend().get_texts()}
    assert {"heavy: stable", "light: unstable", "period doubling"} <= marked
    calm = {text.get_text() for text in stable.plot(OWN).get_legend().get_texts()}
    assert "heavy: stable" in calm and not {"light: unstable", "period doubling"} & calm
    both = Figure().subplots()
    plots.family_key(both, stable, family)
    assert {"heavy: stable", "light: unstable", "period doubling"} <= set(lines(both))
    assert family.plot(OWN).get_title() == "gaits of walker D"


def test_every_parameter_has_the_unit_of_its_kind():
    from gym_passive_walker.models.units import KINDS

    words = {"friction": "torque and time", "gravity": "acceleration"}
    for name, kind in {"slope": "angle", **KINDS}.items():
        if name in ("hip_torque", "ankle_torque"):
            continue
        label = plots.varied_label(name)
        expected = "(rad)" if kind == "angle" else f"unit of {words.get(kind, kind)})"
        assert label.endswith(expected), name
        assert label.startswith(name.replace("_", " "))
    assert plots.varied_label("gain") == "gain"


@pytest.mark.parametrize("controlled", [False, True])
def test_a_gait_s_four_panels_are_named_and_say_whether_it_is_stable(controlled, gait):
    if controlled:
        found = gpw.closed_loop_gait("lqr", "steep")
    else:
        found = gait
    panels = found.plot(OWN)
    title = panels[0].figure.get_suptitle()
    assert f"slope {found.slope:.4g} rad: the long-step gait" in title
    assert title.endswith(", stable" if found.stable else ", unstable")
    assert ("under" in title) == controlled
    np.testing.assert_allclose(
        np.concatenate([points for name, points in lines(panels[3]).items() if "stable" in name]),
        np.column_stack([found.multipliers.real, found.multipliers.imag]),
    )
    assert said(panels[3]) == (
        "real part", "imaginary part", "Floquet multipliers and unit circle",
    )  # fmt: skip
    if controlled:
        assert said(panels[0])[:2] == ("time t / √(l/g)", "hip torque τ / (m g l)")
        (torque,) = [line for line in panels[0].lines if line.get_label().lower().startswith("lqr")]
        walk = gpw.simulate(found, strides=2, samples=400)
        first, units = walk.stride_index == 0, walk.walker.units
        np.testing.assert_allclose(torque.get_xdata(), walk.times[first] / units.time)
        np.testing.assert_allclose(torque.get_ydata(), walk.torques[first, 0] / units.torque)
        assert "stance angular velocity" in panels[2].get_ylabel()
    else:
        assert said(panels[0])[:2] == ("time t / √(l/g)", "angle θ (rad)")


def test_the_portrait_and_the_angles_of_a_walk_are_dimensionless(gait):
    over_time, phases = portrait.phase_portrait(gait, strides=2, samples=30)
    walk = gpw.simulate(gait, strides=2, samples=30)
    unit = math.sqrt(WIDE.leg_length / 1.6)
    curves = lines(phases)
    for part, name in enumerate(("stance leg", "swing thigh", "swing shank")):
        points = curves[name]
        kept = points[np.isfinite(points[:, 1])]
        expected = np.column_stack([walk.states[:, part], walk.states[:, 3 + part] * unit])
        np.testing.assert_allclose(kept, expected)
        starts = [line.get_xydata()[0] for line in phases.lines if line.get_marker() == "o"
                  and len(line.get_xdata()) == 1]  # fmt: skip
        assert np.isclose(starts, expected[0]).all(axis=1).any()
    assert said(phases)[:2] == ("angle θ (rad)", "rate dθ/dt / √(g/l)")
    upright = {line.get_linestyle(): [] for line in over_time.lines if len(line.get_xdata()) == 2}
    for line in over_time.lines:
        if len(line.get_xdata()) == 2:
            upright[line.get_linestyle()].append(line.get_xdata()[0] * unit)
    (heel,) = upright["-"]
    assert heel == pytest.approx(gait.step_period, rel=1e-9)
    knees = np.array([0.0, gait.step_period]) + gait.kneestrike_time
    late = np.array(upright[":"]) - knees  # the line is at the next sample
    assert ((0.0 <= late) & (late <= gait.step_period / 29)).all()
    assert over_time.figure.get_suptitle().endswith("slope 0.036 rad, strides: 2")


def test_a_gait_shows_all_torques_that_act():
    def pulled(seen):
        return np.stack([0.1 + 0.1 * seen[:, 0], -0.2 * seen[:, 0]], axis=1)

    asked = {"walker": "F", "slope": 0.02, "control": "stride", "actions": ("hip", "ankle")}
    gait = gpw.closed_loop_gait(pulled, {**asked, "max_ankle_torque": 0.005})
    ax = Figure().subplots()
    plots._torques(ax, (walk := gpw.simulate(gait, samples=9)), gait, None)
    found = {line.get_label(): line.get_ydata() for line in ax.lines[:-1]}
    for name, torque in zip(("hip torque", "ankle torque"), walk.torques.T, strict=True):
        assert np.all(torque != 0.0)
        np.testing.assert_allclose(found[name], torque / walk.units.energy)
    assert ax.get_ylabel() == "torque τ / (m g l)"


def test_each_coordinate_has_a_line_of_its_own():
    parts = portrait.parts_of("abcdefghi")
    assert [name for name, _, _ in parts] == list("abcdefghi")
    assert len({(colour, dash) for _, colour, dash in parts}) == 9
    assert len({colour for _, colour, _ in parts}) == 3


@pytest.mark.parametrize(("strides", "drawn"), [(12, True), (13, False)])
def test_impacts_are_marked_in_walks_of_up_to_twelve_strides(strides, drawn):
    walk = gpw.simulate(gpw.find_gait("D", 0.009), strides=strides, samples=3)
    ax = Figure().subplots()
    portrait.angles_over_time(ax, walk)
    assert sum(len(line.get_xdata()) == 2 for line in ax.lines) == (strides - 1) * drawn
    assert ("heelstrike" in lines(ax)) == drawn


# Results of analyses, made by hand


def made_diagram(fallen):
    angle = np.array([[0.2, 0.2, 0.2], [0.21, 0.19, 0.21], [0.3, np.nan, np.nan]])
    slopes, angle = np.array([0.07, 0.08, 0.0912345]), angle if fallen else angle[[0, 1, 0]]
    return BifurcationDiagram(
        WALKERS["C"],
        "slope",
        slopes,
        slopes,
        angle,
        np.array([1, 2, 0]),
        np.zeros((3, 6)),
        WALKERS["C"].units,
    )


@pytest.mark.parametrize("fallen", [False, True])
def test_a_bifurcation_diagram_has_all_angles_and_a_line_at_the_last_slope_of_a_walk(fallen):
    one = made_diagram(fallen)
    ax = one.plot(OWN)
    columns = np.array([line.get_xydata() for line in ax.lines[:3]])
    np.testing.assert_array_equal(columns[..., 1], one.stance_angle.T)
    np.testing.assert_array_equal(columns[..., 0], np.tile(one.slope, (3, 1)))
    assert said(ax) == (
        "slope γ (rad)", "stance angle θ (rad)", "bifurcation diagram of walker C",
    )  # fmt: skip
    assert [line.get_xdata()[0] for line in ax.lines[3:]] == [0.08] * fallen
    assert [text.get_text().split("\n")[0] for text in ax.texts] == ["beyond 0.08 rad"] * fallen


def test_a_cascade_shows_the_distance_of_each_doubling_to_the_limit():
    cascade = Cascade(WALKERS["C"], "slope", (1, 2, 4), (0.08, 0.09, 0.0921), ())
    ax = cascade.plot(OWN)
    (line,) = ax.lines
    np.testing.assert_array_equal(line.get_xdata(), [1, 2, 4])
    np.testing.assert_allclose(line.get_ydata(), cascade.limit - np.array([0.08, 0.09, 0.0921]))
    assert (line.get_ydata() > 0.0).all() and ax.get_yscale() == ax.get_xscale() == "log"
    assert ax.xaxis.get_transform().base == 2
    assert said(ax)[:2] == ("period before the doubling (strides)", "limit minus slope γ (rad)")
    assert f"limit {cascade.limit:.6g} rad" in ax.get_title()


def test_a_basin_s_cells_have_the_colour_of_the_legend_and_stars_are_at_the_gaits(gait):
    settled = np.array([[FELL, 0, 0], [UNSETTLED, FELL, 1]], np.int8)
    double = replace(gait, period=2)
    basin = Basin(
        WIDE, 0.036, np.array([0.1, 0.2, 0.3]), np.array([-1.0, -0.5]), (gait, double), settled,
        np.zeros((2, 3), np.int8), np.zeros((2, 3), np.int32),
    )  # fmt: skip
    ax = basin.plot(OWN)
    named = {text.get_text(): colors.to_rgba(handle.get_color()) for text, handle in zip(
        ax.get_legend().get_texts(), ax.get_legend().legend_handles, strict=True)}  # fmt: skip
    (mesh,) = ax.collections
    mesh.update_scalarmappable()
    shown = mesh.to_rgba(mesh.get_array()).reshape(2, 3, 4)
    words = {
        FELL: "falls", UNSETTLED: "walks, without convergence",
        0: f"converges to the {gait.kind}-step gait",
        1: f"converges to the {gait.kind}-step gait of period 2",
    }  # fmt: skip
    for cell, kind in np.ndenumerate(settled):
        np.testing.assert_allclose(shown[cell], named[words[int(kind)]], err_msg=str(cell))
    unit = math.sqrt(WIDE.leg_length / 1.6)
    corners = mesh.get_coordinates()
    np.testing.assert_allclose(corners[0, :, 0], [0.05, 0.15, 0.25, 0.35])
    np.testing.assert_allclose(corners[:, 0, 1], np.array([-1.25, -0.75, -0.25]) * unit)
    stars = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "*"]
    np.testing.assert_allclose(stars, [[gait.stance_angle, gait.state[3] * unit]] * 2)
    assert said(ax)[:2] == ("stance angle θ (rad)", "stance angular velocity dθ/dt / √(g/l)")
    assert ax.get_title().endswith("slope 0.036 rad")


@pytest.mark.parametrize("friction", [0.2, 0.7])
def test_a_check_s_rows_have_the_dimensionless_value_of_each_reading(friction, gait):
    check = gpw.reality_check(gait, friction=friction)
    ax = check.plot(OWN)
    readings = [r for r in check.readings if np.isfinite(r.extreme.value)]
    names = [label.get_text() for label in ax.get_yticklabels()]
    curves = lines(ax)
    points = np.concatenate([curves.get(name, np.zeros((0, 2))) for name in
                             ("satisfied", "violated")])  # fmt: skip
    for row, reading in enumerate(readings):
        assert names[row].startswith(f"{reading.item}: {reading.quantity.strip()}")
        assert reading.unit_name in names[row]
        ((value, _),) = points[points[:, 1] == -row]
        assert value == pytest.approx(reading.extreme.value / reading.unit, rel=1e-12)
    assert list(ax.get_yticks()) == [-row for row in range(len(readings))]
    (limit,) = [c for c in ax.collections if f"friction, {friction:g}" in str(c.get_label())]
    (segment,) = limit.get_segments()
    assert segment[0, 0] == segment[1, 0] == friction
    rows = [-row for row, reading in enumerate(readings) if reading.item == "friction"]
    assert sorted(segment[:, 1]) == [min(rows) - 0.4, max(rows) + 0.4]
    assert ax.get_xscale() == "symlog" and "slope 0.036 rad" in ax.get_title(loc="right")


def test_strides_energies_are_stacked_income_above_losses_below():
    gait = gpw.find_gait("lab", 0.036)
    starts = gait.state * np.array([[0.99], [1.0], [1.01]])
    strides = gpw.stride("lab", 0.036, starts, hip_torque=np.array([0.1, -0.1, 0.0]))
    ax = strides.plot(OWN)
    parts = {patch.get_label(): patch.get_data() for patch in ax.patches}
    signs = {
        "gravity's work": strides.gravity_work, "hip's work": strides.hip_work,
        "lost at kneestrike": -strides.kneestrike_loss,
        "lost at heelstrike": -strides.heelstrike_loss,
    }  # fmt: skip
    assert list(parts) == list(signs)
    above = below = np.zeros(3)
    for label, value in signs.items():
        top, edges, base = parts[label]
        np.testing.assert_allclose(edges, [-0.5, 0.5, 1.5, 2.5])
        np.testing.assert_allclose(top - base, value, atol=1e-15)
        np.testing.assert_allclose(base, np.where(value >= 0.0, above, below), atol=1e-15)
        above, below = above + np.maximum(value, 0.0), below + np.minimum(value, 0.0)
    assert strides.hip_work.min() < 0.0 < strides.hip_work.max()
    assert said(ax)[:2] == ("stride", "energy (in the walker's own units)")


def test_all_energies_of_strides_with_motors_springs_and_friction_are_drawn():
    walker = gpw.WALKERS["E"].with_parameters(hip_stiffness=0.02, hip_friction=0.001)
    start = gpw.find_gait("E", 0.02).state
    strides = gpw.stride(walker, 0.02, start, ankle_torque=1e-3, push_off=1e-3, hip_torque=1e-3)
    ax = strides.plot(OWN)
    drawn = {patch.get_label(): np.subtract(*patch.get_data()[::2]) for patch in ax.patches}
    others = {"ankle's work": strides.ankle_work, "push-off's work": strides.push_off_work,
              "springs' work": strides.spring_work,
              "lost to friction": -strides.friction_loss}  # fmt: skip
    assert {name: drawn[name].item() for name in others} == pytest.approx(others, abs=1e-15)
    assert all(others.values())
    system, units = walker.equations(), walker.units
    before, after = (
        system.kinetic_energy(walker.body, system.State(*units.to_dimensionless(state)))
        for state in (start, strides.state)
    )
    assert sum(drawn.values()) == pytest.approx((after - before) * units.energy, abs=1e-8)


def test_a_gait_on_footholds_is_drawn_until_its_ground_repeats():
    strides = gpw.stride_map("C", 0.036, terrain=gpw.waves(0.002, 6))
    axes_of = gpw.find_gait(strides).plot()
    hips = next(line for line in axes_of[2].lines if line.get_marker() == "o")
    assert len(hips.get_xdata()) == 6 * 6 + 1  # six new postures in a stride, and the first


# Sketches


def masses(ax):
    """Centres and squared diameters of the black discs of a sketch."""
    discs = [
        line
        for line in ax.lines
        if line.get_marker() == "o"
        and len(line.get_xdata())
        and line.get_markerfacecolor() == axes.BLACK
        and line.get_fillstyle() == "full"
    ]
    return np.array([[*line.get_xydata()[0], line.get_markersize() ** 2] for line in discs])


@pytest.mark.parametrize("name", WALKERS)
def test_a_sketch_has_each_mass_at_its_place_with_an_area_in_proportion(name):
    walker = WALKERS[name]
    ax = walker.plot(OWN)
    found = masses(ax)
    assert found[:, 2].sum() == pytest.approx(16.0**2)
    # The centre of all masses is that of the equations.
    weights = found[:, 2] / found[:, 2].sum()
    expected = np.zeros(2)
    posture = pose(walker, [-0.15, 0.5, 0.05, 0.0, 0.0, 0.0])
    for leg in (posture.stance, posture.swing):
        for top, bottom, part in (
            (posture.hip, leg.knee, "thigh"), (leg.knee, leg.tip, "shank"),
        ):  # fmt: skip
            mass, com, offset = (getattr(walker, f"{part}_{x}") for x in ("mass", "com", "offset"))
            angle = math.atan2(*(bottom - top)[::-1])
            along = np.array([math.cos(angle), math.sin(angle)])
            behind = np.array([math.sin(angle), -math.cos(angle)])
            expected += mass * (top + com * along + offset * behind)
    expected += walker.hip_mass * posture.hip
    np.testing.assert_allclose(weights @ found[:, :2], expected / walker.total_mass, atol=1e-12)
    assert f"l = {walker.leg_length:.4g}, m = {walker.total_mass:.4g}" in ax.get_title()
    rings = [line for line in ax.lines if line.get_linestyle() == "--" and len(line.get_xdata())]
    radii = sorted(0.5 * np.ptp(line.get_xdata()) for line in rings)
    spans = sorted(getattr(walker, f"{part}_gyration") for part in ("thigh", "shank")
                   if getattr(walker, f"{part}_mass"))  # fmt: skip
    np.testing.assert_allclose(radii, spans, rtol=1e-3)


def test_names_in_the_diagram_stand_at_what_they_name():
    (ax,) = diagram.walker_diagram().axes
    at = {text.get_text().split("\n")[0]: np.array(text.xy) for text in ax.texts
          if hasattr(text, "xy") and text.get_text()}  # fmt: skip
    shown = diagram.SHOWN
    posture = pose(shown, [diagram._STANCE, diagram._THIGH, diagram._SHANK, 0.0, 0.0, 0.0])
    hip, knee, tip = (
        level(part, diagram._SLOPE) for part in (posture.hip, posture.swing.knee, posture.swing.tip)
    )
    np.testing.assert_allclose(at["hip_mass"], hip)
    for top, bottom, part in ((hip, knee, "thigh"), (knee, tip, "shank")):
        length, com, offset, gyration = (
            getattr(shown, f"{part}_{what}") for what in ("length", "com", "offset", "gyration")
        )
        along = (bottom - top) / np.linalg.norm(bottom - top)
        centre = at[f"{part}_mass"]
        assert np.linalg.norm(bottom - top) == pytest.approx(length)
        assert (centre - top) @ along == pytest.approx(com)
        assert abs(np.cross(np.append(along, 0), np.append(centre - top, 0))[2]) == pytest.approx(
            offset
        )
        assert np.linalg.norm(at[f"{part}_gyration"] - centre) == pytest.approx(gyration)
        assert (at[f"{part}_com"] - top) @ along == pytest.approx(0.5 * com)
        assert (at[f"{part}_length"] - top) @ along == pytest.approx(0.6 * length)


def test_the_arcs_of_the_diagram_are_its_angles():
    (ax,) = diagram.walker_diagram().axes
    arcs = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 40]
    turned = [math.atan2(a[0] * b[1] - a[1] * b[0], a @ b) for a, b in (
        (arc[1] - arc[0], arc[-1] - arc[-2]) for arc in arcs)]  # fmt: skip
    expected = [-diagram._STANCE, diagram._THIGH, -diagram.SHOWN.foot_angle, diagram._SHANK,
                -diagram._SLOPE]  # fmt: skip
    np.testing.assert_allclose(np.abs(turned), np.abs(expected), rtol=0.06)
