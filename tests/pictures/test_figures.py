"""Every computed figure of Garcia (1999), chapter 4, is drawn, with its data beside it."""

import csv
import re
from dataclasses import fields

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from gym_passive_walker.models.walkers import WALKERS, Walker, interpolate, tune
from gym_passive_walker.pictures import figures
from gym_passive_walker.pictures.axes import legend_below, resize
from gym_passive_walker.pictures.diagram import (
    approach,
    heelstrike_diagram,
    standing_diagram,
    walker_diagram,
)
from gym_passive_walker.pictures.figures import FIGURES, draw, families
from gym_passive_walker.pictures.pose import leg_line
from gym_passive_walker.pictures.strobe import LEG_COLOURS


def rows_of(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_figure_is_drawn_to_a_file_with_the_gaits_that_it_shows_beside_it(tmp_path):
    picture, data = draw("4.5", tmp_path / "new" / "f.png")
    assert picture.read_bytes().startswith(b"\x89PNG") and data.name == "f.csv"
    rows, shown = rows_of(data), figures.point_feet()
    assert {row["curve"] for row in rows} == {*shown}
    for curve, family in shown.items():
        own = [row for row in rows if row["curve"] == curve]
        for name in ("slope", "stance_angle", "froude_speed"):
            np.testing.assert_array_equal([float(row[name]) for row in own], family.columns()[name])


def test_tables_of_several_kinds_share_a_file_and_what_one_lacks_is_empty(tmp_path, monkeypatch):
    plate = FIGURES["4.10"]
    few = plate._replace(tables=lambda: figures.doublings(slopes=4))
    monkeypatch.setitem(FIGURES, "4.10", few)
    rows = rows_of(draw("4.10", tmp_path / "f.png")[1])
    settled, gait, doubling = (
        [row for row in rows if row["curve"] == curve] for curve in few.tables()
    )
    assert len(settled) == 400 and len(doubling) == 3
    assert {row["stable"] for row in settled} == {""} != {row["stable"] for row in gait}
    assert float(doubling[0]["slope"]) == pytest.approx(0.076853365, abs=1e-8)


def test_a_sketch_has_no_data(tmp_path):
    (picture,) = draw("4.7", tmp_path / "f.svg")
    assert [*tmp_path.iterdir()] == [picture]


def test_an_unknown_figure_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match=r"no figure '4.2'.*4.10"):
        draw("4.2", tmp_path / "f.png")


@pytest.mark.parametrize(("kind", "sign"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_a_figure_is_drawn_as_vectors_too_and_carries_its_caption(kind, sign, tmp_path):
    found = draw("4.3-strobe", tmp_path / f"f.{kind}")[0].read_bytes()
    assert found.startswith(sign) and b"leg lengths l" in found.replace(b"\n", b" ")


def test_a_pdf_has_the_size_in_cm_that_was_asked_for_and_embeds_its_fonts(tmp_path):
    found = draw("4.7", tmp_path / "f.pdf", (8.5, 7.0))[0].read_bytes()
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", found)
    assert [float(x) / 72.0 * 2.54 for x in box] == pytest.approx([8.5, 7.0])
    assert b"/FontFile2" in found and b"/CIDFontType2" in found and b"/Type3" not in found


@pytest.mark.parametrize("width", [9.0, 24.0])
def test_a_legend_has_the_columns_for_which_a_figure_has_room(width):
    figure = figures.transition(figures.point_feet())
    resize(figure, (width, 12.0))
    figure.draw_without_rendering()
    (ax,) = figure.axes
    assert ax.get_legend().get_window_extent().width <= figure.bbox.width
    legend_below(figure, ax)
    resize(figure, (width, 14.0))
    (below,) = figure.legends
    assert below.get_window_extent().width <= figure.bbox.width


def test_an_unknown_kind_of_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match="must end in one of"):
        draw("4.5", tmp_path / "f.doc")


def test_the_foot_lands_with_the_velocity_of_equation_4_10():
    """Along the slope, the equation's sign is that of an x up the slope."""
    found = approach()
    walk, state = found.walk, found.walk.states[-1]
    assert found.x[-1] == 0.0 and abs(found.y[-1]) < 1e-9
    length, radius = leg_line(walk.walker), walk.walker.foot_radius
    stance, thigh = state[3:5]
    expected = (
        -(radius + length * np.cos(state[0])) * (stance - thigh),
        -length * np.sin(state[0]) * (stance + thigh),
    )
    times = walk.times[-5:] - walk.times[-1]
    for path, rate in zip((found.x, found.y), expected, strict=True):
        assert np.polyfit(times, path[-5:], 4)[-2] == pytest.approx(rate, rel=1e-5)


def test_the_heelstrike_s_coordinates_lead_from_the_ground_to_the_foot_at_its_height():
    found = approach()
    (ax,) = heelstrike_diagram(found).axes
    texts = {text.get_text() for text in ax.texts}
    assert {"x", "y", "hip to\nfoot centre"} <= texts
    (path,) = (line for line in ax.lines if line.get_linestyle() == ":")
    count = len(path.get_xdata())
    start, end = path.get_xydata()[[0, -1]]
    apart = np.hypot(found.x[-count], found.y[-count])
    np.testing.assert_allclose(np.hypot(*(start - end)), apart, rtol=1e-6)


def test_a_tuned_walker_stands_with_its_mass_over_the_contact_and_its_shank_s_below_the_knee():
    straight, kneed = standing_diagram().axes
    for ax in (straight, kneed):
        (whole,) = (line for line in ax.lines if line.get_marker() == "D")
        assert abs(float(whole.get_xdata()[0])) < 1e-12
    discs = [line for line in kneed.lines if line.get_marker() == "o"]
    (shank,) = (line for line in discs if line.get_markersize() == 8.0)
    knee = next(line for line in discs if line.get_color() == "white")
    assert float(shank.get_xdata()[0]) == pytest.approx(float(knee.get_xdata()[0]), abs=1e-12)


def test_each_length_mass_and_angle_of_a_walker_is_named_in_the_diagram():
    (ax,) = walker_diagram().axes
    named = {text.get_text().split("\n")[0] for text in ax.texts}
    of_shape = {
        field.name
        for field in fields(Walker)
        if field.name.startswith(("thigh", "shank", "foot")) or field.name == "hip_mass"
    }
    assert of_shape | {"stance angle", "thigh angle", "shank angle", "slope"} <= named


@pytest.mark.slow
def test_the_stable_part_of_the_laboratory_s_curve_is_heavy():
    (ax,) = figures.lab_families(figures.laboratory()).axes
    heavy = [line for line in ax.lines if line.get_linewidth() > 2.0]
    slopes = np.concatenate([line.get_xdata()[np.isfinite(line.get_ydata())] for line in heavy])
    # Between its two folds.
    assert 0.01912 < slopes.min() < 0.0192 and 0.0529 < slopes.max() < 0.05304


@pytest.mark.slow
def test_de_tuning_s_upper_curve_is_found_beside_the_lower_one():
    found = families(interpolate(tune(WALKERS["C"]), WALKERS["lab"], 0.75), 1e-3, 0.15)
    lower, upper = sorted(found, key=lambda family: family.slope.min())
    assert lower.slope.max() < 0.09 < 0.12 < upper.slope.min()


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FIGURES if name != "4.5"])
def test_every_figure_is_drawn(name, tmp_path):
    for path in draw(name, tmp_path / "f.png"):
        assert path.stat().st_size > 3_000


def test_the_legs_of_the_diagram_have_the_colours_of_legs():
    """The stance leg is drawn first; each leg is a line from the hip over the knee to its tip."""
    (ax,) = walker_diagram().axes
    legs = [line for line in ax.lines if line.get_linewidth() == 2.5]
    assert [line.get_color() for line in legs] == list(LEG_COLOURS) and LEG_COLOURS[
        0
    ] != LEG_COLOURS[1]
    stance, swing = (line.get_xydata() for line in legs)
    np.testing.assert_array_equal(stance[0], swing[0])
    assert stance[2, 1] < swing[2, 1]  # the swing foot is in the air
