"""The viewer obeys its user: events in, and what is seen and what walks follows."""

from __future__ import annotations

import re
import runpy
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome, closed_loop_gait, find_gait, load_policy
from gym_passive_walker.apps.cli import main
from gym_passive_walker.apps.viewer import play
from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup
from gym_passive_walker.pictures import colours

pygame = pytest.importorskip("pygame")

from gym_passive_walker.apps.viewer.player import (  # noqa: E402
    FRAME_RATE,
    PUSH_A_PIXEL,
    SCENE,
    WINDOW_SIZE,
    Player,
    gentle_slope,
    offered_policies,
)
from gym_passive_walker.apps.viewer.view import GAIT, PORTRAIT, View  # noqa: E402

SLOPE = 0.036


@pytest.fixture(autouse=True)
def headless(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.delenv("DISPLAY", raising=False)


class Session:
    """A viewer with simulated keys and mouse."""

    def __init__(self, walk: LiveWalk) -> None:
        self.player = Player(walk)
        self.view = View()
        self.frames(1)

    @property
    def walk(self) -> LiveWalk:
        """What walks."""
        return self.player.walk

    def frames(self, count: int) -> np.ndarray:
        """Let some frames pass; the last one, (height, width, 3)."""
        for _ in range(count):
            self.player.frame(1 / FRAME_RATE)
        surface = self.view.draw(self.player)
        return pygame.surfarray.array3d(surface).swapaxes(0, 1).astype(int)

    def key(self, key: int, *, shift: bool = False) -> None:
        """Press a key."""
        mod = pygame.KMOD_SHIFT if shift else 0
        self.player.handle(pygame.event.Event(pygame.KEYDOWN, key=key, mod=mod))

    def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Drag the mouse from one place to another, and let go."""
        self.press(start)
        self.move(start, end)
        self.player.handle(pygame.event.Event(pygame.MOUSEBUTTONUP, pos=end, button=1))

    def press(self, place: tuple[int, int]) -> None:
        """Press the mouse."""
        self.player.handle(pygame.event.Event(pygame.MOUSEBUTTONDOWN, pos=place, button=1))

    def move(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Move the mouse, its button held."""
        rel = end[0] - start[0], end[1] - start[1]
        event = pygame.event.Event(pygame.MOUSEMOTION, pos=end, rel=rel, buttons=(1, 0, 0))
        self.player.handle(event)

    def gait(self):
        """The gait of what is set, once it is found."""
        deadline = time.monotonic() + 60.0
        while not self.player.gait[1]:
            assert time.monotonic() < deadline
            time.sleep(0.005)
        return self.player.gait[0]


@pytest.fixture
def session():
    session = Session(LiveWalk(Setup(WALKERS["lab"], SLOPE)))
    yield session
    session.player.close()


def shows(frame: np.ndarray, box, colour) -> bool:
    part = frame[box.top : box.bottom, box.left : box.right]
    return int((np.abs(part - colour) < 12).all(axis=-1).sum()) > 20


def test_a_walker_walks_in_real_time(session):
    session.frames(2 * FRAME_RATE - 1)
    gait = find_gait("lab", SLOPE)
    assert session.walk.strides == int(2.0 / gait.step_period)


def test_space_stops_time_and_n_lets_one_frame_pass(session):
    session.key(pygame.K_SPACE)
    before = session.walk.state
    session.frames(5)
    np.testing.assert_array_equal(session.walk.state, before)
    session.key(pygame.K_n)
    apart = session.walk.state[0] - before[0]
    assert apart == pytest.approx(before[3] / FRAME_RATE, rel=0.2)
    session.key(pygame.K_SPACE)
    session.frames(1)
    assert session.walk.state[0] != before[0] + apart


def test_slow_motion_passes_the_same_postures_more_slowly(session):
    other = LiveWalk(Setup(WALKERS["lab"], SLOPE))
    other.advance(1 / FRAME_RATE)
    session.key(pygame.K_MINUS)
    session.key(pygame.K_MINUS)
    session.frames(40)
    other.advance(10 / FRAME_RATE)
    np.testing.assert_allclose(session.walk.state, other.state, rtol=0.0, atol=1e-9)
    session.key(pygame.K_PLUS)
    assert session.player.pace == 0.5
    for key in (pygame.K_MINUS, pygame.K_PLUS):  # beyond the last pace there is none
        paces = []
        for _ in range(10):
            session.key(key)
            paces.append(session.player.pace)
        assert paces[-1] == paces[-2] == (min(paces) if key == pygame.K_MINUS else max(paces))


def test_a_slider_sets_what_it_says_while_the_walker_walks(session):
    for slider in session.player.sliders:
        knob = slider.knob(session.walk)
        state = session.walk.state
        session.press(knob)
        session.move(knob, (knob[0] + 3, knob[1]))
        value = slider.value_at(knob[0] + 3)
        assert session.player.message == "" or slider.read(session.walk) == slider.home
        if session.player.message == "":
            assert slider.read(session.walk) == pytest.approx(value, rel=1e-12)
        np.testing.assert_allclose(session.walk.state, state, rtol=1e-12)
        session.key(pygame.K_HOME)
        assert slider.read(session.walk) == slider.home


def test_keys_choose_a_setting_and_move_it(session):
    session.key(pygame.K_RIGHT)
    assert session.walk.setup.slope == pytest.approx(SLOPE + 0.0002)
    session.key(pygame.K_LEFT, shift=True)
    assert session.walk.setup.slope == pytest.approx(SLOPE - 0.0038)
    session.key(pygame.K_DOWN)
    session.key(pygame.K_DOWN)
    session.key(pygame.K_RIGHT)
    assert session.walk.setup.walker.gravity > 9.81


def test_the_wheel_moves_the_slider_below_the_pointer_and_no_other(session):
    turn = pygame.event.Event(pygame.MOUSEWHEEL, x=0, y=-1)
    before = session.walk.setup.slope, session.walk.setup.walker.gravity
    session.player.handle(turn)  # the pointer has not been seen yet
    session.move((0, 0), (SCENE.centerx, SCENE.centery))
    session.player.handle(turn)
    assert (session.walk.setup.slope, session.walk.setup.walker.gravity) == before
    session.move((0, 0), session.player.sliders[2].knob(session.walk))
    session.player.handle(turn)
    assert session.walk.setup.slope == SLOPE
    assert session.walk.setup.walker.gravity < before[1]
    assert session.player.selected == 2


def test_a_walker_that_cannot_be_is_refused_in_words(session):
    labels = [slider.label for slider in session.player.sliders]
    session.player.set(labels.index("shank mass"), 0.0)
    assert "moment of inertia" in session.player.message
    assert session.walk.setup.walker == WALKERS["lab"]


def test_dragging_the_scene_pushes_the_hip_where_it_is_dragged(session):
    before = session.walk.state
    session.press(SCENE.center)
    session.move((0, 0), (60, 0))
    assert session.player.impulse[0] == pytest.approx(60 * PUSH_A_PIXEL * np.cos(SLOPE))
    assert session.player.impulse[1] == pytest.approx(60 * PUSH_A_PIXEL * np.sin(SLOPE))
    session.move((0, 0), (-60, -40))  # up, on the screen
    assert session.player.impulse == pytest.approx(
        40 * PUSH_A_PIXEL * np.array([-np.sin(SLOPE), np.cos(SLOPE)])
    )
    session.move((0, 0), (60, 40))
    session.drag(SCENE.center, (SCENE.centerx + 60, SCENE.centery))
    assert session.walk.state[3] < before[3]
    np.testing.assert_array_equal(session.walk.state[:3], before[:3])


def test_r_begins_at_the_gait_of_what_is_set(session):
    session.player.set(0, 0.04)
    session.gait()
    session.key(pygame.K_r)
    expected = find_gait("lab", 0.04)
    np.testing.assert_allclose(session.walk.state, expected.state, rtol=1e-12)


def test_multipliers_follow_the_slope(session):
    for slope in (0.03, 0.04):
        session.player.set(0, slope)
        expected = find_gait("lab", slope).multipliers
        np.testing.assert_allclose(session.gait().multipliers, expected, rtol=0.0, atol=1e-9)
    session.player.set(0, -0.05)
    assert session.gait() is None


def test_multipliers_of_a_torque_and_of_a_policy_are_those_of_their_own_gaits():
    policy = load_policy("lab-ppo")
    session = Session(LiveWalk(Setup(WALKERS["lab"], SLOPE, policy)))
    assert session.gait().stable
    session.player.set(1, 1e-7)
    assert session.walk.setup.controller == 1e-7
    passive = find_gait("lab", SLOPE).multipliers
    np.testing.assert_allclose(session.gait().multipliers, passive, rtol=0.0, atol=2e-3)
    session.key(pygame.K_p)
    assert session.walk.setup.controller is policy
    session.player.close()


def test_the_picture_shows_both_legs_everywhere_they_belong(session):
    session.gait()
    frame = session.frames(FRAME_RATE)
    assert frame.shape == (WINDOW_SIZE[1], WINDOW_SIZE[0], 3)
    for colour in colours.LEGS:
        assert shows(frame, SCENE, colour) and shows(frame, PORTRAIT, colour)
    assert shows(frame, GAIT, colours.LEGS[0])


def test_a_push_is_drawn_from_the_hip(session):
    session.key(pygame.K_SPACE)
    frame = session.frames(1)
    session.press(SCENE.center)
    session.move((0, 0), (100, 0))
    changed = np.abs(session.frames(1) - frame).sum(axis=-1) > 60
    hip = session.view._screen.hip_on_frame(session.walk.state, SLOPE)  # type: ignore[union-attr]
    row = changed[round(hip[1]), : SCENE.right]
    assert row[round(hip[0]) + 30 : round(hip[0]) + 95].all()
    assert not row[round(hip[0]) + 110 :].any()


def test_a_fall_is_shown(session):
    session.walk.push(-0.5, 0.0)
    session.frames(10 * FRAME_RATE)
    assert len(session.walk.trail) < 200  # how it fell, not how it lies there
    assert session.walk.outcome == Outcome.FELL_BACKWARD
    assert session.player.ended == "fell backward (R begins again)"


def test_w_goes_through_all_walkers_and_back(session):
    walkers = []
    for _ in WALKERS:
        session.key(pygame.K_w)
        walkers.append(session.walk.setup.walker)
        session.frames(2)
    assert len(walkers) == len(set(walkers)) and set(walkers) == set(WALKERS.values())
    session.key(pygame.K_w, shift=True)
    assert session.walk.setup.walker == walkers[-2]


@pytest.mark.parametrize("turns", [1, 2, 3, 4, 5, 6, 7, 8])
def test_another_walker_after_a_fall_begins_again_where_it_walks(session, turns):
    session.player.set(0, -0.05)
    session.frames(3 * FRAME_RATE)
    assert session.walk.outcome != Outcome.RUNNING
    session.player.next_walker(turns)
    session.frames(2 * FRAME_RATE)
    assert session.walk.outcome == Outcome.RUNNING
    assert session.walk.strides >= 1
    assert session.player.sliders[0].home == session.walk.setup.slope > 0.0


def test_p_gives_the_hip_to_each_shipped_policy_in_turn_and_then_to_none(session):
    seen, gaits = [], []
    for _ in offered_policies():
        session.key(pygame.K_p)
        policy = session.walk.setup.controller
        assert not isinstance(policy, float)
        session.frames(1)
        gaits.append(session.gait())
        assert gaits[-1] is None or gaits[-1].controller is policy
        seen.append(session.player.message.removesuffix(" at the motors"))
    assert seen == list(offered_policies()) and any(gaits)
    assert {"level-ppo", "steep-sac", "lab-ppo"} <= set(seen)
    session.key(pygame.K_p)
    assert session.walk.setup.controller == 0.0
    session.key(pygame.K_p, shift=True)
    assert session.walk.setup.controller is offered_policies()[seen[-1]]


def test_q_and_a_closed_window_end_it(session):
    session.key(pygame.K_q)
    assert not session.player.running
    session.player.running = True
    session.player.handle(pygame.event.Event(pygame.QUIT))
    assert not session.player.running


def test_the_window_does_what_was_asked_and_writes_its_last_picture(tmp_path):
    pygame.display.init()
    for key in (pygame.K_RIGHT, pygame.K_SPACE):
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key, mod=0))
    play("lab", SLOPE, seconds=0.2, picture=tmp_path / "seen.png")
    seen = pygame.surfarray.array3d(pygame.image.load(tmp_path / "seen.png")).swapaxes(0, 1)
    assert shows(seen.astype(int), SCENE, colours.LEGS[0])
    assert not pygame.display.get_init()


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_film_has_a_frame_for_each_instant(tmp_path, ending):
    moviepy = pytest.importorskip("moviepy")
    path = tmp_path / f"walk{ending}"
    play("lab", SLOPE, seconds=0.5, video=path)
    with moviepy.VideoFileClip(str(path)) as clip:
        assert clip.duration == pytest.approx(0.5, abs=0.06)
        frame = clip.get_frame(0.4).astype(int)
    shrunk = WINDOW_SIZE[0] // frame.shape[1]
    assert frame.shape == (WINDOW_SIZE[1] // shrunk, WINDOW_SIZE[0] // shrunk, 3)
    assert int((np.abs(frame - colours.LEGS[1]) < 40).all(axis=-1).sum()) > 100


def test_f_records_until_the_end_and_never_over_another_video(tmp_path, monkeypatch):
    pytest.importorskip("moviepy")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk-1.mp4").write_text("another video")
    pygame.display.init()
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_f, mod=0))
    play("lab", SLOPE, seconds=0.1)
    assert (tmp_path / "walk-1.mp4").read_text() == "another video"
    assert (tmp_path / "walk-2.mp4").stat().st_size > 1000


def test_a_gentle_slope_lets_its_walker_walk():
    for name in ("lab", "C", "D"):
        assert find_gait(name, gentle_slope(WALKERS[name])).stable


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ({"walker": "Z"}, "no walker"),
        ({"slope": 2.0}, "slope"),
        ({"policy": "none"}, "no policy"),
        ({"video": "walk.txt"}, ".mp4"),
    ],
)
def test_bad_arguments_are_refused_in_a_sentence(arguments, reported):
    with pytest.raises(ValueError, match=reported):
        play(**{"walker": "lab", "slope": SLOPE, "seconds": 0.1, **arguments})


def test_a_machine_without_a_display_is_named(monkeypatch, capsys):
    def refuse():
        raise pygame.error("no available video device")

    monkeypatch.setattr(pygame.display, "init", refuse)
    assert main(["play", "lab", "0.036", "--seconds", "0.05"]) == 2
    assert "no display" in capsys.readouterr().err
    monkeypatch.undo()
    monkeypatch.setattr(pygame.display, "init", lambda: None)
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    with pytest.raises(OSError, match="no display"):
        play("lab", SLOPE, seconds=0.05)


def test_the_module_shows_a_walker_and_refuses_others_in_a_sentence(tmp_path, monkeypatch, capsys):
    seen = tmp_path / "seen.png"
    for words, status in ((f"lab 0.036 --seconds 0.05 --picture {seen}", 0), ("Z", 2)):
        monkeypatch.setattr(sys, "argv", ["viewer", *words.split()])
        with pytest.raises(SystemExit) as ended:
            runpy.run_module("gym_passive_walker.apps.viewer", run_name="__main__")
        assert ended.value.code == status
    assert seen.stat().st_size > 0
    assert "no walker 'Z'" in capsys.readouterr().err


def test_the_code_on_the_viewers_page_opens_a_window_until_it_is_closed():
    page = (Path(__file__).parents[2] / "docs" / "viewer.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, re.S)
    pygame.display.init()
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    exec(compile(code, "viewer.md", "exec"), {})
    assert not pygame.display.get_init()


def test_the_viewer_is_refused_in_a_sentence_without_pygame(monkeypatch):
    for name in [
        name for name in sys.modules if name.startswith("gym_passive_walker.apps.viewer.")
    ]:
        if name.rpartition(".")[2] in ("view", "player", "sliders"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ImportError, match=r"gym-passive-walker\[render\]"):
        play("lab", SLOPE)


@pytest.mark.parametrize("kept", [{"video": "walk.avi"}, {"picture": "seen.webp"}])
def test_a_file_that_cannot_be_written_is_refused_before_a_window_opens(kept, tmp_path):
    [(option, name)] = kept.items()
    what = {"video": "video"}.get(option, option)
    with pytest.raises(ValueError, match=f"{what}'s name must end in"):
        play("lab", SLOPE, **{option: tmp_path / name})
    (tmp_path / "folder.mp4").mkdir()
    (tmp_path / "folder.png").mkdir()
    ending = {"video": ".mp4", "picture": ".png"}[option]
    with pytest.raises(IsADirectoryError, match="folder"):
        play("lab", SLOPE, **{option: tmp_path / f"folder{ending}"})
    assert not pygame.display.get_init()


def test_the_gait_of_a_policy_is_sought_on_the_slope_that_is_set():
    policy = load_policy("steep-ppo")
    slope = policy.scene.slope - 0.003
    found = Setup(policy.scene.walker, slope, policy).gait()
    expected, other = (closed_loop_gait(policy, slope=x) for x in (slope, policy.scene.slope))
    assert found is not None and found.stable
    np.testing.assert_allclose(found.multipliers, expected.multipliers, atol=1e-9)
    assert not np.array_equal(found.multipliers, other.multipliers)


def test_a_slider_stays_in_its_range(session):
    slope = session.player.sliders[0]
    for value, end in ((9.0, slope.high), (-9.0, slope.low)):
        slope.write(session.walk, value)
        assert slope.read(session.walk) == end
