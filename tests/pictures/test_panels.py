"""Panels show each multiplier and each leg at its numerical position."""

from __future__ import annotations

import numpy as np
import pytest

pygame = pytest.importorskip("pygame")

from gym_passive_walker.pictures import colours  # noqa: E402
from gym_passive_walker.pictures.brush import Brush  # noqa: E402
from gym_passive_walker.pictures.panels import draw_multipliers, draw_portrait  # noqa: E402

BOX = pygame.Rect(20, 20, 400, 300)
SQUARE = pygame.Rect(20, 20, 200, 200)


@pytest.fixture
def brush():
    brush = Brush(pygame, pygame.Surface((450, 350)), lettering=18)
    brush.open_fonts()
    brush.canvas.fill(colours.SKY)
    return brush


def places(brush: Brush, colour: colours.Colour) -> np.ndarray:
    """Pixels (right, down) that nearly have a colour, (n, 2)."""
    pixels = pygame.surfarray.array3d(brush.canvas).astype(int)
    return np.argwhere(np.abs(pixels - colour).max(axis=-1) < 60)


def test_a_multiplier_inside_the_unit_circle_is_a_dot_at_its_place(brush):
    draw_multipliers(brush, SQUARE, np.array([0.5 - 0.5j]))
    dot = places(brush, colours.LEGS[0])
    scale = 100.0 / 1.15
    expected = np.add(SQUARE.center, [0.5 * scale, 0.5 * scale])
    np.testing.assert_allclose(dot.mean(axis=0), expected, atol=1.0)
    assert np.hypot(*(dot - expected).T).min() < 1.5


def test_a_multiplier_outside_is_a_ring_and_the_circle_shrinks_to_show_it(brush):
    draw_multipliers(brush, SQUARE, np.array([-2.0 + 0.0j]))
    ring = places(brush, colours.WARNING)
    expected = np.add(SQUARE.center, [-100.0 / 1.15, 0.0])
    np.testing.assert_allclose(ring.mean(axis=0), expected, atol=1.0)
    assert np.hypot(*(ring - expected).T).min() > 2.0


def test_multipliers_of_another_gait_are_pale(brush):
    draw_multipliers(brush, SQUARE, np.array([0.5, 2.0 + 0.0j]), pale=True)
    assert len(places(brush, colours.LEGS[0])) == len(places(brush, colours.WARNING)) == 0


@pytest.mark.parametrize("strides", [0, 1])
def test_a_dot_is_where_each_leg_is_and_legs_keep_their_colours(brush, strides):
    """Axes end at 0.4 rad and 0.4; the panel keeps 44 and 34 pixels at its left and top."""
    state = np.array([-0.2, 0.3, 0.1, -0.3, 0.1, 0.2])
    draw_portrait(brush, BOX, [state, state], [strides] * 2, [True] * 2)
    half, centre = np.array([170.0, 118.0]), np.array([64 + 170.0, 54 + 118.0])
    for leg, link in ((strides, 0), (1 - strides, 1)):
        dot = places(brush, colours.LEGS[leg])
        expected = centre + half * [state[link], -state[3 + link]] / np.array([0.4, 0.4])
        np.testing.assert_allclose(np.median(dot, axis=0), expected, atol=2.0)


def test_an_impact_leaves_a_gap_in_the_phase_portrait(brush):
    angles = np.linspace(0.3, -0.3, 41)
    states = np.zeros((41, 6))
    states[:, 0], states[:, 1], states[:, 3:] = angles, 0.35, -0.3
    states[20:, 3] = 0.3
    drawn = []
    for struck in (False, True):
        brush.canvas.fill(colours.SKY)
        strides = [0] * 20 + [2 * struck] * 21  # two on: the same leg stands
        draw_portrait(brush, BOX, states, strides, [False] * 41)
        drawn.append(len(places(brush, colours.LEGS[0])))
    assert drawn[1] < drawn[0] - 50


def test_text_is_broken_at_a_width(brush):
    text = "a message that is longer than a line"
    assert brush.write(text, (0, 0), width=80) > 1.5 * brush.write(text, (0, 0))
    assert brush.write(text, (0, 0), size=36) > 1.5 * brush.write(text, (0, 0))
