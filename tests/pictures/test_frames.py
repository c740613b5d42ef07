"""Frames, videos and grounds: places, texts, sizes and rates."""

from __future__ import annotations

import math
import re
import sys

import numpy as np
import pytest

pygame = pytest.importorskip("pygame")

from gym_passive_walker import find_gait, footholds, simulate, stairs  # noqa: E402
from gym_passive_walker.models.walkers import WALKERS  # noqa: E402
from gym_passive_walker.pictures import colours, pose  # noqa: E402
from gym_passive_walker.pictures.brush import Brush  # noqa: E402
from gym_passive_walker.pictures.ground import height, part_between, profile  # noqa: E402
from gym_passive_walker.pictures.screen import Screen  # noqa: E402
from gym_passive_walker.pictures.tiles import tile_columns, tile_size, tiled  # noqa: E402
from gym_passive_walker.pictures.video import Video, video, video_path  # noqa: E402

GAIT = np.array([0.24395, -0.24395, -0.24395, -1.0491, -0.3015, -1.4831])
LEG = 0.62 * 450  # pixels of a leg length in a frame


@pytest.fixture
def written(monkeypatch):
    """Texts that are written, with their places, anchors and colours."""
    texts, write = [], Brush.write

    def record(self, text, place, anchor="midtop", colour=colours.GROUND_LINE, **more):
        texts.append((text, np.asarray(place, dtype=float), anchor, colour))
        return write(self, text, place, anchor, colour, **more)

    monkeypatch.setattr(Brush, "write", record)
    return texts


# The ground of a frame


@pytest.mark.parametrize("slope", [0.0, 0.1])
@pytest.mark.parametrize("walked", [0.0, 2.3])
def test_numbers_on_the_ground_are_leg_lengths_from_the_start(slope, walked, written):
    screen = Screen("lab")
    length = screen.walker.leg_length
    screen.draw(GAIT, slope, walked * length)
    hip = pose("lab", GAIT, walked * length).hip[0] / length
    numbers = {int(text.removesuffix(" l")): place for text, place, *_ in written
               if re.fullmatch(r"-?\d+ l", text)}  # fmt: skip
    assert len(numbers) > 3 and round(hip) in numbers
    assert min(numbers) < hip < max(numbers)
    for number, (right, down) in numbers.items():
        # Twice as large as the frame; below the mark, which is 0.07 leg lengths deep.
        x, y = number - hip, -0.07
        turned = (
            x * math.cos(slope) + y * math.sin(slope),
            y * math.cos(slope) - x * math.sin(slope),
        )
        expected = 800 + 2 * LEG * turned[0], 2 * 0.83 * 450 - 2 * LEG * turned[1] + 0.012 * 900
        np.testing.assert_allclose((right, down), expected, atol=1e-6)


def test_notes_stand_in_lines_on_their_sides_and_the_warning_below_the_left_ones(written):
    Screen("lab").draw(GAIT, 0.0, notes=(["one", "two"], ["three", "four"]), warning="fell")
    found = {text: (place, anchor, colour) for text, place, anchor, colour in written}
    edge = 0.03 * 900
    for text, (right, line), anchor, colour in (
        ("one", (edge, 0), "topleft", colours.HIP),
        ("two", (edge, 1), "topleft", colours.HIP),
        ("fell", (edge, 2), "topleft", colours.WARNING),
        ("three", (1600 - edge, 0), "topright", colours.HIP),
        ("four", (1600 - edge, 1), "topright", colours.HIP),
    ):
        place, at, painted = found[text]
        assert (place[0], at, painted) == (right, anchor, colour), text
        pitch = (found["two"][0] - found["one"][0])[1]
        assert pitch > 30 and place[1] == pytest.approx(edge + line * pitch)


def test_all_ground_of_a_frame_lies_within_the_distance_that_is_seen():
    for name in ("lab", "D"):
        screen = Screen(name)
        reach = screen.seen / screen.walker.leg_length * LEG
        assert math.hypot(400, 0.83 * 450) < reach < 1.5 * math.hypot(800, 450)


@pytest.mark.parametrize("tilt", [-0.3, 0.3])
def test_a_push_points_along_the_tilted_ground(tilt):
    angles = []
    for slope in (0.0, 0.2):
        screen = Screen("lab")
        frame = screen.draw(GAIT, slope, tilt=tilt, push=1.0).astype(int)
        rows, columns = np.nonzero((np.abs(frame - colours.PUSH) < 12).all(axis=-1))
        steep = np.polyfit(columns, rows, 1)[0]
        angles.append(math.atan(steep))
    np.testing.assert_allclose(angles, [tilt, tilt + 0.2], atol=0.05)


def test_ghosts_are_at_most_five_and_no_nearer_than_a_fifth_of_a_leg():
    screen = Screen("lab")
    length = screen.walker.leg_length
    for x in np.arange(0.0, 3.0, 0.02):
        screen.draw(GAIT, 0.0, x * length)
    hips = np.array([posture.hip[0] for posture, _ in screen._trail]) / length
    assert len(hips) == 5
    apart = np.diff(hips)
    assert (apart > 0.22 - 1e-9).all() and (apart < 0.24 + 1e-9).all()


def test_a_surface_is_level_beyond_its_ends_and_its_parts_are_it():
    surface = np.array([[0.0, 1.0], [1.0, 2.0], [2.0, 0.0]])
    np.testing.assert_allclose(height(surface, np.array([-5.0, 0.5, 1.5, 9.0])), [1, 1.5, 1, 0])
    np.testing.assert_allclose(
        part_between(surface, 0.5, 1.5), [[0.5, 1.5], [1.0, 2.0], [1.5, 1.0]]
    )
    np.testing.assert_allclose(part_between(surface, 1.0, 3.0), [[1, 2], [2, 0], [3, 0]])


@pytest.mark.parametrize("name", ["lab", "D"])
def test_a_profile_passes_all_known_footholds_and_covers_what_is_asked_for(name):
    walker, terrain = WALKERS[name], stairs(-0.02)
    length = walker.leg_length
    x = np.array([3.0, 3.4, 3.9]) * length
    known = np.column_stack([x, -0.02 * length * np.array([6.0, 7.0, 8.0])])
    reach = (1.0 * length, 7.0 * length)
    found = profile(walker, terrain, 0, 6, known, reach, length)
    np.testing.assert_allclose(height(found, x), known[:, 1], atol=1e-12)
    assert found[0, 0] <= reach[0] and found[-1, 0] >= reach[1]
    assert (np.diff(found[:, 0]) >= 0.0).all()
    # The steps before and ahead have the mean length of those known, 0.45 leg lengths.
    for k in (-3, -2, -1, 1, 2, 3):
        start, steps = (known[0], 6 + k) if k < 0 else (known[-1], 8 + k)
        place = start[0] + 0.45 * length * k
        assert height(found, place) == pytest.approx(-0.02 * length * steps, abs=1e-9)
    # No foothold lies before the first one of the walk.
    begun = profile(walker, terrain, 0, 0, known, reach, length)
    assert height(begun, reach[0]) == height(begun, x[0])
    alone = profile(walker, terrain, 0, 6, known[:1], reach, 0.6 * length)
    assert height(alone, x[0] + 0.6 * length) == pytest.approx(known[1, 1], abs=1e-9)


# Brush


def test_lines_limbs_and_texts_are_drawn_where_they_are_asked_for():
    brush = Brush(pygame, pygame.Surface((200, 100)), 10.0, 2.0)
    brush.look_at(np.array([1.0, 0.5]), 0.0, (100.0, 50.0))
    # 10 pixels to a leg length, which is 2 units; up is less.
    np.testing.assert_allclose(brush.at([[1.0, 0.5], [3.0, 0.5], [1.0, 2.5]]),
                               [[100, 50], [110, 50], [100, 40]])  # fmt: skip
    brush.look_at(np.array([0.0, 0.0]), 0.3, (0.0, 0.0))
    np.testing.assert_allclose(
        brush.at([2.0, 0.0]), [10 * math.cos(0.3), 10 * math.sin(0.3)]
    )  # downhill is right and down
    large = Brush(pygame, pygame.Surface((200, 400)), 10.0, 2.0)
    large.look_at(np.zeros(2), 0.0, (0.0, 0.0))
    assert 2.0 * brush.write("walker", (0, 0)) < large.write("walker", (0, 0))


# Pictures of several frames


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9, 10, 64, 100, 101, 400])
def test_tiles_are_as_large_as_fit_and_even_and_wide_as_a_video(count):
    columns = math.ceil(math.sqrt(count))
    assert tile_columns(count) == columns
    width, tall = tile_size(count)
    assert width % 2 == tall % 2 == 0
    exact = min(800.0, max(160.0, 1600 / columns))
    assert exact - 2 < width <= exact
    assert tall == pytest.approx(width * 9 / 16, abs=2)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 7, 12])
def test_each_frame_is_found_at_its_row_and_column(count):
    frames = [np.full((4, 6, 3), (i, 2 * i, 3 * i), np.uint8) for i in range(count)]
    columns = math.ceil(math.sqrt(count))
    picture = tiled(frames)
    assert picture.dtype == np.uint8 and picture.shape[1] == 6 * columns
    cells = picture.reshape(-1, 4, columns, 6, 3).swapaxes(1, 2).reshape(-1, 4, 6, 3)
    assert count <= len(cells) < count + columns
    np.testing.assert_array_equal(cells[:count], frames)
    assert (cells[count:] == colours.SKY).all()


# Videos


def read(path):
    """Facts of a video, and its frames."""
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    frames = imageio_ffmpeg.read_frames(str(path))
    facts = next(frames)
    width, tall = facts["size"]
    return facts, [np.frombuffer(frame, np.uint8).reshape(tall, width, 3) for frame in frames]


# The reader of videos leaves its pipes open.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("name", "fps", "shrink", "size", "rate"),
    [
        ("walk.mp4", 25, 1, (64, 48), 25),
        ("walk.MP4", 60, 2, (64, 48), 60),  # only a GIF is shrunk
        ("walk.gif", 20, 1, (64, 48), 20),
        ("walk.GIF", 50, 2, (32, 24), 30),
    ],
)
def test_a_video_has_its_size_rate_and_colours(name, fps, shrink, size, rate, tmp_path):
    pytest.importorskip("moviepy")
    shades = [(200, 40, 40), (40, 40, 200)]
    with Video(tmp_path / "deep" / name, (64, 48), fps, shrink=shrink) as file:
        for colour in shades:
            for _ in range(fps):
                file.write(np.full((48, 64, 3), colour, np.uint8))
    assert [path.name for path in (tmp_path / "deep").iterdir()] == [name]
    facts, frames = read(tmp_path / "deep" / name)
    assert facts["size"] == size
    # A GIF's rate is a whole number of hundredths of a second to a frame.
    assert facts["fps"] == pytest.approx(rate, rel=0.12)
    assert facts["duration"] == pytest.approx(2.0, abs=0.1)
    assert len(frames) == pytest.approx(2 * rate, rel=0.12)
    for frame, colour in ((frames[1], shades[0]), (frames[-2], shades[1])):
        np.testing.assert_allclose(frame.reshape(-1, 3).mean(axis=0), colour, atol=25)


@pytest.mark.parametrize("name", ["walk.avi", "walk", "mp4", "walk.mp4.txt"])
def test_a_video_of_another_ending_is_refused_by_its_name(name, tmp_path):
    with pytest.raises(ValueError, match=rf"\.mp4 or \.gif, not .*{name}$"):
        video_path(tmp_path / name)


class Recorder:
    """A video that records its arguments and counts its frames."""

    def __init__(self, path, size, fps, **more):
        type(self).made = self
        self.path, self.size, self.fps, self.more, self.frames = path, size, fps, more, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def write(self, frame):
        """Count a frame."""
        self.frames.append(frame)


@pytest.mark.parametrize("slower", [0.25, 1.0, 3.0])
def test_frames_of_a_walk_are_evenly_spaced_in_the_walker_s_time(slower, tmp_path, monkeypatch):
    pytest.importorskip("moviepy")
    shown = []

    def draw(self, state, slope, contact_x, strides, **more):
        shown.append((state, slope, contact_x, strides, more["contact_y"], more["tilt"]))
        return np.zeros((1, 1, 3), np.uint8)

    monkeypatch.setattr(sys.modules[video_path.__module__], "Video", Recorder)
    monkeypatch.setattr(Screen, "draw", draw)
    gait = find_gait("C", 0.05)
    ground = {"terrain": footholds([0.0, 0.0, -0.005], [0.0, 0.01, -0.01])}
    count = video("C", 0.05, gait.state, tmp_path / "w.gif", strides=3, slower=slower, shrink=4,
                   **ground)  # fmt: skip
    made = Recorder.made
    assert (made.fps, made.size, made.more) == (30, (800, 450), {"shrink": 4})
    walk = simulate("C", 0.05, gait.state, 3, samples=2001, **ground)
    assert count == len(shown) == len(made.frames) == math.ceil(walk.times[-1] * 30 * slower)
    for index, (state, slope, x, strides, y, tilt) in enumerate(shown):
        at = np.argmin(np.abs(walk.times - index / (30 * slower)))
        near = max(at - 12, 0), at + 24  # a frame shows the next of 200 samples of a stride
        apart = np.abs(walk.states[slice(*near)] - state).max(axis=1)
        best = near[0] + int(np.argmin(apart))
        assert apart.min() < 0.01 and slope == 0.05
        assert (strides, y, tilt) == (
            walk.stride_index[best], pytest.approx(walk.contact_y[best], abs=1e-3),
            walk.tilts[best],
        )  # fmt: skip
        assert x == pytest.approx(walk.contact_x[best], abs=2e-3)
