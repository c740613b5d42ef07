"""Text and plots of objects show the results of the analysis."""

import csv
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest

import gym_passive_walker as gpw
from gym_passive_walker._tools.shown import Table
from gym_passive_walker.gaits.control.baselines import LinearFeedback
from gym_passive_walker.pictures import phase_portrait, plots, strobe
from gym_passive_walker.pictures.axes import OWN
from tests.own.statements import DRIVEN

plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(scope="module")
def gait():
    return gpw.find_gait("lab", 0.036)


@pytest.fixture(scope="module")
def family():
    return gpw.gait_family("lab", 0.005, 0.1)


@pytest.fixture(scope="module")
def shown(gait, family):
    lab, slope = gait.walker, gait.slope
    strides = gpw.stride(lab, slope, gait.state * np.array([[0.99], [1.0], [1.3]]))
    return [
        lab,
        gait,
        family,
        gait.stride,
        strides,
        gpw.simulate(lab, slope, gait.state, 3, samples=20),
        gpw.reality_check(lab, slope, gait.state),
        gpw.bifurcation_diagram("C", [0.07, 0.075], n_transient=50, n_recorded=40),
        gpw.basin_of_attraction(lab, slope, resolution=12),
        gpw.closed_loop_gait(LinearFeedback("steep"), "steep"),
        gpw.optimal_gait("level", 0.1),
        gpw.optimal_gait({"system": DRIVEN, "slope": 0.02, "control": "stride"}, 0.185),
    ]


def drawn(one):
    """The numbers in a plot: its lines, and the cells of meshes."""
    axes = np.ravel(one.plot(OWN))
    meshes = [mesh for ax in axes for mesh in ax.collections if hasattr(mesh, "get_coordinates")]
    return [
        *(line.get_xydata() for ax in axes for line in ax.lines),
        *(mesh.get_coordinates().reshape(-1, 2) for mesh in meshes),
    ]


ANALYSES = {
    "check": lambda gait: gpw.reality_check(gait, strides=2),
    "basin": lambda gait: gpw.basin_of_attraction(gait.walker, gait.slope, resolution=12),
    "walk": lambda gait: gpw.simulate(gait, strides=2, samples=20),
    "diagram": lambda gait: gpw.bifurcation_diagram(
        gait.walker, [0.03, 0.036], n_transient=20, n_recorded=34
    ),
}


@pytest.mark.parametrize("analysis", ANALYSES.values(), ids=ANALYSES)
def test_pictures_are_the_same_whatever_the_size_of_the_walker(gait, analysis):
    """Plots are dimensionless: over leg length, total mass and gravity."""
    lengths = ("length", "offset", "gyration", "com", "radius")
    factors = {**dict.fromkeys(lengths, 20.0), "mass": 3.0}
    changed = {
        name: factors[end] * value
        for name, value in asdict(gait.walker).items()
        for end in factors
        if name.endswith(end)
    }
    giant = gpw.find_gait(replace(gait.walker, **changed, gravity=1.6), gait.slope)
    ours, theirs = (drawn(analysis(one)) for one in (gait, giant))
    assert len(ours) == len(theirs) > 0
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)


def test_each_says_in_a_short_line_what_it_is(shown):
    for one in shown:
        assert "\n" not in repr(one) and len(repr(one)) < 420


def test_each_is_a_small_table_in_a_notebook(shown):
    for one in shown:
        html = one._repr_html_()
        assert html.startswith("<table>") and html.count("<tr>") == len(one.facts())


def test_pictures_of_walks_are_figures_of_their_own(gait):
    _, current = plt.subplots()
    figures = {strobe(gait).figure, phase_portrait(gait, samples=9)[0].figure, current.figure}
    assert len(figures) == 3 and not current.has_data()


def test_two_pictures_on_given_axes_share_a_legend(family):
    _, ax = plt.subplots()
    family.plot(ax)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    family.plot(ax)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == labels


def test_a_picture_that_is_written_leaves_nothing_open(gait, family, tmp_path):
    strobe("lab", gait.slope, gait.state, path=tmp_path / "walk.png")
    phase_portrait("lab", gait.slope, gait.state, path=tmp_path / "portrait.png")
    assert family.plot(OWN).has_data() and gait.plot(OWN)[0].has_data()
    assert plt.get_fignums() == []


def test_each_table_reads_back_the_same(shown, tmp_path):
    for one in shown:
        if not isinstance(one, Table):
            continue
        one.to_csv(tmp_path / "table.csv")
        with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        for name, column in one.columns().items():
            assert len(rows) == len(column)
            if column.dtype.kind == "f":
                head = next(head for head in rows[0] if head.partition(" (")[0] == name)
                np.testing.assert_array_equal([float(row[head]) for row in rows], column)


def test_a_table_goes_to_pandas(family):
    pandas = pytest.importorskip("pandas")
    frame = family.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    np.testing.assert_array_equal(frame["stance_angle"], family.stance_angle)


def test_without_pandas_the_error_says_what_to_install(family, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r'pip install "gym-passive-walker\[tables\]"'):
        family.to_dataframe()


def test_a_walker_s_line_makes_it_again():
    for walker in gpw.WALKERS.values():
        assert eval(repr(walker), {"Walker": gpw.Walker}) == walker


def test_a_family_is_heavy_exactly_where_it_is_stable_and_has_its_doublings_marked(family):
    ax = family.plot()
    light, heavy = ax.lines[:2]
    np.testing.assert_array_equal(light.get_ydata(), family.stance_angle)
    drawn = heavy.get_ydata()[np.isfinite(heavy.get_ydata())]
    assert np.isin(family.stance_angle[family.stable], drawn).all()
    assert not np.isin(family.stance_angle[~family.stable], drawn).any()
    marks = [line for line in ax.lines if line.get_marker() == "d" and len(line.get_xdata())]
    np.testing.assert_allclose(marks[0].get_xdata(), family.period_doublings, rtol=1e-12)


def test_a_family_is_drawn_by_what_it_has(family):
    with pytest.raises(ValueError, match="froude_speed"):
        family.plot(by="colour")


def test_legends_cover_nothing(gait, family):
    for ax in [*gait.plot(), family.plot(OWN)]:
        if ax.get_legend():
            ax.get_figure().draw_without_rendering()
            assert not ax.get_legend().get_window_extent().overlaps(ax.get_window_extent())


@pytest.mark.parametrize("friction", [10.0, 0.3, 0.0])
def test_a_check_marks_readings_beyond_what_is_allowed_as_violated(gait, friction):
    check = gpw.reality_check(gait, friction=friction)
    ax = check.plot(OWN)
    names = [label.get_text().partition(": ")[0] for label in ax.get_yticklabels()]
    marks = {line.get_label(): line.get_xydata() for line in ax.lines}
    violated = {names[int(-row)] for _, row in marks.get("violated", [])}
    assert violated == {item for item, holds in check.passed.items() if not holds}
    needed = [
        (value, label) for label, points in marks.items() if label in ("satisfied", "violated")
        for value, row in points if names[int(-row)] == "friction"
    ]  # fmt: skip
    assert len(needed) == 3
    assert all((value > friction) == (label == "violated") for value, label in needed)


def test_a_walk_that_ends_says_how():
    walk = gpw.simulate("lab", 0.036, [0.3, -0.3, -0.3, -0.1, 0.0, 0.0], 4, samples=7)
    assert walk.ending == "fell backward" and "fell backward" in repr(walk)


def test_drawing_leaves_matplotlib_s_settings_alone(gait):
    import matplotlib

    before = dict(matplotlib.rcParams)
    gait.plot()
    assert dict(matplotlib.rcParams) == before


def test_each_end_of_a_family_is_marked_for_its_own_reason(family):
    """By the legend's label of the marker that stands there."""
    figure, ax = plt.subplots()
    family.plot(ax)
    for end, at in zip(family.ends, (0, -1), strict=True):
        place = family.value[at], family.columns()["stance_angle"][at]
        markers = {
            line.get_marker()
            for line in ax.lines
            if len(line.get_xdata()) == 1 and (line.get_xdata()[0], line.get_ydata()[0]) == place
        }
        assert markers == {plots._ENDS[end.reason.split(";")[0]]}, end.reason
        said = [text.get_text() for text in ax.get_legend().get_texts()]
        assert f"end: {end.reason.split(';')[0]}" in said
    assert family.ends[0].reason != family.ends[1].reason
    plt.close(figure)


def test_multipliers_outside_the_unit_circle_are_marked_unstable():
    _, ax = plt.subplots()
    plots.multipliers(ax, np.array([0.5, 0.6 + 0.9j, 0.6 - 0.9j, -1.2]))
    drawn = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert drawn["stable"] == [[0.5, 0.0]]
    assert drawn["unstable"] == [[0.6, 0.9], [0.6, -0.9], [-1.2, 0.0]]
    plt.close()
