"""Frames of a walk show the walker, on its slope, without a display."""

import os
import subprocess
import sys

import numpy as np
import pytest

from gym_passive_walker import rough
from gym_passive_walker.gaits.look.trajectory import simulate
from gym_passive_walker.pictures import colours, level, pose, tiled
from gym_passive_walker.pictures.screen import Screen
from gym_passive_walker.pictures.video import FPS, SAMPLES, video

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
    for colour in (*colours.LEGS, colours.HIP, colours.SKY, colours.GROUND):
        assert mask(frame, colour).sum() > 50


def test_frames_open_no_window(no_display):
    Screen("lab").draw(GAIT, SLOPE)
    assert not pygame.display.get_init()


def test_the_hip_stays_in_the_middle_while_the_ground_passes(no_display):
    screen = Screen("lab")
    frames = [screen.draw(GAIT, 0.0, x) for x in (0.0, 0.05)]
    for frame in frames:
        columns = np.flatnonzero(mask(frame, colours.HIP)[:200].any(axis=0))
        assert 0.5 * (columns[0] + columns[-1]) == pytest.approx(399.5, abs=1.5)
    assert (frames[0] != frames[1])[380:].any()
    np.testing.assert_array_equal(frames[0][:360], frames[1][:360])


def test_the_slope_is_as_steep_as_it_is(no_display):
    frame = Screen("lab").draw(GAIT, 0.2)
    left, right = (int(np.argmax(mask(frame, colours.GROUND_LINE)[:, x])) for x in (100, 700))
    assert (right - left) / 600 == pytest.approx(np.tan(0.2), abs=0.005)


def test_the_first_leg_stands_in_front_just_after_a_heelstrike(no_display):
    frame = Screen("lab").draw(GAIT, SLOPE)
    first, other = (np.nonzero(mask(frame, colour))[1].mean() for colour in colours.LEGS)
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


def test_no_frame_is_black_where_there_is_no_display():
    code = (
        "import gymnasium as gym, gym_passive_walker\n"
        "env = gym.make('PassiveWalker-v0', scene='lab', render_mode='rgb_array')\n"
        "env.reset(seed=0)\n"
        "assert env.render().mean() > 200\n"
    )
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "SDL_VIDEODRIVER")}
    done = subprocess.run([sys.executable, "-c", code], env=bare, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_hip_is_drawn_where_the_geometry_has_it(no_display):
    for name in ("lab", "D"):
        screen = Screen(name)
        walk = simulate(name, SLOPE, GAIT, samples=9)
        for state in walk.states[:5]:
            rows, columns = np.nonzero(mask(screen.draw(state, SLOPE)[: 450 * 4 // 5], colours.HIP))
            drawn = columns.mean(), rows.mean()
            # A leg length is 0.62 of a frame, and the ground 0.17 from below.
            scale = 0.62 * 450 / screen.walker.leg_length
            x, y = level([0.0, pose(name, state).hip[1]], SLOPE)
            assert drawn == pytest.approx((400 + scale * x, 0.83 * 450 - scale * y), abs=1.5)


@pytest.mark.parametrize("torque", [-0.8, 0.8])
def test_the_torque_is_an_arrow_that_turns_as_the_swing_leg_is_driven(torque, no_display):
    assert not mask(Screen("lab").draw(GAIT, SLOPE), colours.TORQUE).any()
    arrow = mask(Screen("lab").draw(GAIT, SLOPE, torque=torque), colours.TORQUE)
    # The head is the broad end: on the side to which the free leg is swung.
    columns = np.flatnonzero(arrow.any(axis=0))
    middle = 0.5 * (columns[0] + columns[-1])
    across = np.nonzero(arrow)[1]
    assert np.sign((across > middle).sum() - (across < middle).sum()) == np.sign(torque)


def test_a_longer_arrow_is_a_larger_torque(no_display):
    drawn = [
        mask(Screen("lab").draw(GAIT, 0.0, torque=t), colours.TORQUE).sum() for t in (0.2, 0.9)
    ]
    assert drawn[1] > 1.3 * drawn[0] > 0


@pytest.mark.parametrize("push", [-0.8, 0.8])
def test_a_push_is_an_arrow_from_the_hip_that_fades(push, no_display):
    screen, calm = Screen("lab"), Screen("lab").draw(GAIT, SLOPE)
    shown = mask(screen.draw(GAIT, SLOPE, push=push), colours.PUSH)
    hip = 400  # the middle of a frame
    columns = np.flatnonzero(shown.any(axis=0))
    assert np.sign(0.5 * (columns[0] + columns[-1]) - hip) == np.sign(push)
    assert columns[-1] - columns[0] > 0.6 * 0.8 * 0.45 * 0.62 * 450
    frames = [screen.draw(GAIT, SLOPE) for _ in range(10)]
    assert (frames[0] != calm).any() and not mask(frames[3], colours.PUSH).any()
    np.testing.assert_array_equal(frames[-1], calm)


def test_a_foot_below_the_ground_is_marked_and_one_above_is_not(no_display):
    above, below = [0.1, -0.1, -0.7, 0.0, 0.0, 0.0], [0.2, 0.05, 0.05, 0.0, 0.0, 0.0]
    assert (
        pose("lab", above).swing.sole[:, 1].min() > 0.0 > pose("lab", below).swing.sole[:, 1].min()
    )
    assert not mask(Screen("lab").draw(above, SLOPE), colours.WARNING).any()
    assert mask(Screen("lab").draw(below, SLOPE), colours.WARNING).sum() > 20


def test_ghosts_stand_where_the_walker_was_and_vanish_at_the_next_episode(no_display):
    screen = Screen("lab")
    alone = screen.draw(GAIT, 0.0)
    length = screen.walker.leg_length
    followed = screen.draw(GAIT, 0.0, 0.5 * length)
    again = screen.draw(GAIT, 0.0)
    ghost = np.abs(followed.astype(int) - Screen("lab").draw(GAIT, 0.0, 0.5 * length)).sum(axis=-1)
    columns = np.flatnonzero(ghost.any(axis=0))
    # The same posture, half a leg length to the left: 0.62 of a frame's height is a leg length.
    legs = np.flatnonzero((mask(alone, colours.LEGS[0]) | mask(alone, colours.LEGS[1])).any(axis=0))
    assert columns[0] == pytest.approx(legs[0] - 0.5 * 0.62 * 450, abs=35)
    np.testing.assert_array_equal(again, alone)
    ahead = screen.draw(GAIT, 0.0, 0.5 * length, 2)
    begun = screen.draw(GAIT, 0.0, 0.9 * length, 0)  # another episode that begins further on
    np.testing.assert_array_equal(begun, Screen("lab").draw(GAIT, 0.0, 0.9 * length, 0))
    assert np.any(ahead != begun)


def test_rough_ground_is_drawn_where_its_profile_is(no_display):
    screen = Screen("lab")
    length = screen.walker.leg_length
    step = np.array([[-9.0, 0.0], [0.5, 0.0], [0.501, -0.1], [9.0, -0.1]]) * length
    frame = screen.draw(GAIT, 0.0, profile=step)
    line = mask(frame, colours.GROUND_LINE)
    left, right = (int(np.argmax(line[:, x])) for x in (60, 740))
    assert right - left == pytest.approx(0.1 * 0.62 * 450, abs=2)


def test_a_system_taller_than_its_legs_is_drawn_whole(no_display):
    from examples.five_links import FIVE_LINKS

    frame = Screen(FIVE_LINKS).draw(FIVE_LINKS.start, 0.0)
    top = np.nonzero((frame != frame[0, 0]).any(axis=2).any(axis=1))[0][0]
    assert 10 < top < 60  # the torso's end, of 450 rows


def test_a_system_stands_on_its_ground(no_display):
    from examples.torso import TORSO

    screen = Screen(TORSO)
    step = np.array([[-9.0, 0.0], [0.5, 0.0], [0.501, -0.1], [9.0, -0.1]])
    first, second = (
        screen.draw(TORSO.start, 0.0, x, contact_y=y, profile=step)
        for x, y in ((0.0, 0.0), (1.0, -0.1))
    )
    for frame, x, rise in ((first, 740, 0.1), (second, 60, -0.1)):
        line = mask(frame, colours.GROUND_LINE)
        legs = mask(frame, colours.LEGS[0]) | mask(frame, colours.LEGS[1])
        here, there = (int(np.argmax(line[:, column])) for column in (400, x))
        assert there - here == pytest.approx(rise * 0.62 * 450, abs=2)
        assert legs.any(axis=1).nonzero()[0][-1] == pytest.approx(here, abs=8)


def test_a_push_of_a_system_is_an_arrow_that_fades_and_that_a_new_walk_has_not(no_display):
    from examples.torso import TORSO

    screen = Screen(TORSO)
    shown = [screen.draw(TORSO.start, 0.0, 0.01 * i, push=float(i == 1)) for i in range(3)]
    seen = [mask(frame, colours.PUSH).sum() for frame in shown]
    assert seen[0] == 0 < seen[1] and (shown[2] != shown[0])[100:300].any()
    begun = screen.draw(TORSO.start, 0.0, -1.0)
    np.testing.assert_array_equal(begun[:360], shown[0][:360])


def test_nothing_and_frames_of_two_shapes_are_no_picture():
    for frames in ([], [np.zeros((2, 4, 3), np.uint8), np.zeros((2, 2, 3), np.uint8)]):
        with pytest.raises(ValueError, match="one shape"):
            tiled(frames)


def test_frames_survive_another_user_of_pygame(no_display):
    screen = Screen("lab")
    before = screen.draw(GAIT, SLOPE)
    pygame.quit()
    np.testing.assert_array_equal(screen.draw(GAIT, SLOPE), before)


def test_a_batch_is_refused(no_display):
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


def test_a_machine_without_a_display_is_named(no_display, monkeypatch):
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
    monkeypatch.delenv("SDL_VIDEODRIVER")
    with pytest.raises(OSError, match="no display"):
        Screen("lab", "human").draw(GAIT, SLOPE)
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


@pytest.mark.parametrize(
    "changes",
    [
        {"hip_torque": 0.2},
        {"hip_torque": [0.0, -0.2]},
        {"terrain": rough(height_std=0.01), "terrain_seed": 3},
    ],
    ids=["torque", "torque of the second stride", "terrain"],
)
def test_a_video_shows_the_walk_that_is_asked_for(changes, tmp_path, monkeypatch, no_display):
    pytest.importorskip("moviepy")
    shown, draw = [], Screen.draw

    def drawn(self, state, *rest, **more):
        shown.append(state)
        return draw(self, state, *rest, **more)

    monkeypatch.setattr(Screen, "draw", drawn)
    frames = video("lab", SLOPE, GAIT, tmp_path / "walk.gif", strides=2, **changes)
    walk, plain = (
        simulate("lab", SLOPE, GAIT, 2, samples=SAMPLES, **options) for options in (changes, {})
    )
    assert frames == len(shown) > 0
    at = np.searchsorted(walk.times, np.arange(frames) / FPS)
    np.testing.assert_array_equal(shown, walk.states[at])
    assert np.abs(walk.states[-1] - plain.states[-1]).max() > 0.01
