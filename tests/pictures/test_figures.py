"""Every computed figure of Garcia (1999), chapter 4, is drawn."""

from dataclasses import fields

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from gym_passive_walker.models.walkers import WALKERS, Walker, interpolate, tune
from gym_passive_walker.pictures import figures
from gym_passive_walker.pictures.diagram import walker_diagram
from gym_passive_walker.pictures.figures import FIGURES, draw, families
from gym_passive_walker.pictures.strobe import LEG_COLOURS


def test_a_figure_is_drawn_to_a_file(tmp_path):
    path = draw("4.5", tmp_path / "new")
    assert path.read_bytes().startswith(b"\x89PNG")


def test_an_unknown_figure_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(ValueError, match=r"no figure '4.2'.*4.10"):
        draw("4.2", tmp_path)


@pytest.mark.parametrize(("kind", "sign"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_a_figure_is_drawn_as_vectors_too_and_carries_its_caption(kind, sign, tmp_path):
    found = draw("4.3-strobe", tmp_path, kind).read_bytes()
    assert found.startswith(sign) and b"leg lengths l" in found.replace(b"\n", b" ")


def test_an_unknown_kind_of_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match="png, svg, pdf"):
        draw("4.5", tmp_path, "gif")


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
    (ax,) = figures.lab_families().axes
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
    assert draw(name, tmp_path).stat().st_size > 10_000


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
