"""Frames of a walk show the walker, on its slope, without a display."""

import sys

import numpy as np
import pytest

from gym_passive_walker.gaits.trajectory import simulate
from gym_passive_walker.render import look
from gym_passive_walker.render.screen import Screen

pygame = pytest.importorskip("pygame")

SLOPE = 0.036
GAIT = np.array([0.24395, -0.24395, -0.24395, -1.0491, -0.3015, -1.4831])


def mask(frame, colour):
    """Where a frame has this colour."""
    return (np.abs(frame.astype(int) - colour) < 12).all(axis=-1)


@pytest.fixture
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.mark.parametrize("name", ["lab", "C", "A", "B", "D"])
def test_a_frame_shows_both_legs_the_hip_and_the_ground(name, no_display):
    frame = Screen(name).draw(GAIT, SLOPE)
    assert frame.shape == (450, 800, 3) and frame.dtype == np.uint8
    assert frame.flags.c_contiguous and frame.flags.writeable
    for colour in (*look.LEGS, look.HIP, look.SKY, look.GROUND):
        assert mask(frame, colour).sum() > 50


def test_frames_open_no_window(no_display):
    Screen("lab").draw(GAIT, SLOPE)
    assert not pygame.display.get_init()


def test_the_hip_stays_in_the_middle_while_the_ground_passes(no_display):
    screen = Screen("lab")
    frames = [screen.draw(GAIT, 0.0, x) for x in (0.0, 0.05)]
    for frame in frames:
        columns = np.flatnonzero(mask(frame, look.HIP)[:200].any(axis=0))
        assert 0.5 * (columns[0] + columns[-1]) == pytest.approx(399.5, abs=1.5)
    assert (frames[0] != frames[1])[380:].any()
    np.testing.assert_array_equal(frames[0][:360], frames[1][:360])


def test_the_slope_is_as_steep_as_it_is(no_display):
    frame = Screen("lab").draw(GAIT, 0.2)
    left, right = (int(np.argmax(mask(frame, look.GROUND_LINE)[:, x])) for x in (100, 700))
    assert (right - left) / 600 == pytest.approx(np.tan(0.2), abs=0.005)


def test_the_first_leg_stands_in_front_just_after_a_heelstrike(no_display):
    frame = Screen("lab").draw(GAIT, SLOPE)
    first, other = (np.nonzero(mask(frame, colour))[1].mean() for colour in look.LEGS)
    assert first > other + 50.0


def test_legs_keep_their_colours_through_a_heelstrike(no_display):
    walk = simulate("lab", SLOPE, GAIT, strides=2, samples=2)
    screen = Screen("lab")
    before, after, swapped = (
        screen.draw(walk.states[i], SLOPE, walk.contact_x[i], strides).astype(int)
        for i, strides in ((1, 0), (2, 1), (2, 0))
    )
    assert np.abs(after - before).mean() < 0.01
    assert np.abs(swapped - before).mean() > 1.0


def test_frames_survive_another_user_of_pygame(no_display):
    screen = Screen("lab")
    before = screen.draw(GAIT, SLOPE)
    pygame.quit()
    np.testing.assert_array_equal(screen.draw(GAIT, SLOPE), before)


def test_a_crowd_is_refused(no_display):
    with pytest.raises(ValueError, match="one state"):
        Screen("lab").draw(np.tile(GAIT, (2, 1)), SLOPE)


def test_a_frame_has_the_size_asked_for(no_display):
    assert Screen("D", size=(320, 200)).draw(GAIT, SLOPE).shape == (200, 320, 3)


def test_a_window_shows_frames_and_keeps_pace(no_display):
    screen = Screen("lab", "human", fps=50.0)
    start = pygame.time.get_ticks()
    assert all(screen.draw(GAIT, SLOPE) is None for _ in range(6))
    assert pygame.time.get_ticks() - start >= 80  # the first frame need not wait
    assert pygame.display.get_surface().get_size() == (800, 450)
    screen.close()
    assert not pygame.display.get_init()


def test_a_window_closed_by_its_user_stays_closed(no_display):
    screen = Screen("lab", "human", fps=0.0)
    screen.draw(GAIT, SLOPE)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    screen.draw(GAIT, SLOPE)
    assert not pygame.display.get_init()
    screen.draw(GAIT, SLOPE)
    assert not pygame.display.get_init()
    screen.close()


@pytest.mark.parametrize("wrong", [{"mode": "ansi"}, {"size": (0, 10)}, {"fps": -1.0}])
def test_what_is_no_screen_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        Screen("lab", **wrong)


def test_without_pygame_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ImportError, match=r'pip install "gym-passive-walker\[render\]"'):
        Screen("lab")
