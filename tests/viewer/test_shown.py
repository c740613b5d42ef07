"""Texts and ranges of the viewer's window, and the effects of each key and of the mouse."""

from __future__ import annotations

import re
from concurrent.futures import wait
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from gym_passive_walker import WALKERS, Outcome
from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup
from gym_passive_walker.pictures import colours
from gym_passive_walker.pictures.brush import Brush

pygame = pytest.importorskip("pygame")

from gym_passive_walker.apps.viewer.player import (  # noqa: E402
    FRAME_RATE,
    KEYS,
    PUSH_A_PIXEL,
    SCENE,
    WINDOW_SIZE,
    Player,
)
from gym_passive_walker.apps.viewer.sliders import PANEL, sliders_of  # noqa: E402
from gym_passive_walker.apps.viewer.view import GAIT, LEGEND, PORTRAIT, View  # noqa: E402

SLOPE = 0.036
LAB = WALKERS["lab"]


@pytest.fixture(autouse=True)
def headless(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.fixture
def player():
    player = Player(LiveWalk(Setup(LAB, SLOPE)))
    yield player
    player.close()


@pytest.fixture
def shown(player, monkeypatch):
    """Texts of the picture, with place and colour, by text."""
    write = Brush.write
    found = {}

    def record(self, text, place, anchor="midtop", colour=colours.GROUND_LINE, **more):
        found[text] = (tuple(np.asarray(place, dtype=float)), anchor, colour)
        return write(self, text, place, anchor, colour, **more)

    monkeypatch.setattr(Brush, "write", record)
    view = View()

    def look_at(searched=True):
        while searched and not player.gait[1]:
            wait([player._search], timeout=60.0)
        found.clear()
        view.draw(player)
        return dict(found)

    return look_at


def press(player, key, *, shift=False):
    mod = pygame.KMOD_SHIFT if shift else 0
    player.handle(pygame.event.Event(pygame.KEYDOWN, key=key, mod=mod))


def mouse(player, kind, pos, button=1, rel=(0, 0)):
    player.handle(pygame.event.Event(kind, pos=pos, button=button, rel=rel))


def test_every_key_of_the_list_is_written_with_its_effect_beside_it(shown):
    texts = shown()
    places = []
    for key, does in KEYS:
        (x, y), anchor, colour = texts[key]
        assert LEGEND.collidepoint(x, y) and (anchor, colour) == ("topleft", colours.HIP)
        assert texts[does][0] == (x + 96, y)
        places.append((x, y))
    assert len(set(places)) == len(KEYS) == 12
    assert places == sorted(places)  # column by column, from above


def test_each_slider_shows_its_name_and_its_present_value(player, shown):
    press(player, pygame.K_RIGHT, shift=True)
    texts = shown()
    for slider in player.sliders:
        (x, y), anchor, _ = texts[slider.label]
        assert (x, y, anchor) == (slider.row.left + 12, slider.row.centery, "midleft")
    values = {place[1]: float(text.replace("−", "-")) for text, (place, anchor, _) in texts.items()
              if anchor == "midright" and place[0] == PANEL.right - 14}  # fmt: skip
    rows = {slider.row.centery: slider.read(player.walk) for slider in player.sliders}
    for y, value in values.items():  # equal values are one text
        assert value == pytest.approx(rows[y], rel=1e-4)
    assert values[player.sliders[0].row.centery] == pytest.approx(SLOPE + 20 * 1e-3 * 0.2)
    assert "walker lab" in texts
    player.set(2, 5.0)
    assert "walker changed" in shown()


def test_the_gait_s_multipliers_and_the_last_stride_s_measures_are_written(player, shown):
    texts = shown()
    assert "Floquet multipliers of the passive gait" in texts
    gait, _ = player.gait
    assert texts["stable" if gait.stable else "unstable (ring)"][2] == colours.LEGS[0]
    said = sorted(
        (place[1], text) for text, (place, _, colour) in texts.items()
        if GAIT.collidepoint(place) and re.match(r"−?\d", text)
    )  # fmt: skip
    pairs = [value for value in gait.multipliers if value.imag >= 0.0]
    assert len(said) == len({f"{v.real:.3f}" for v in pairs})
    for (_, text), value in zip(said, pairs, strict=False):
        real, _, imaginary = text.replace("−", "-").partition(" ± ")
        assert float(real) == pytest.approx(value.real, abs=6e-4)
        assert float(imaginary.removesuffix(" i") or 0.0) == pytest.approx(value.imag, abs=6e-4)
    assert "none yet" in texts and "was disturbed" not in texts
    while player.walk.strides < 1:
        player.frame(1 / FRAME_RATE)
    texts, unit = shown(), LAB.units
    speed = gait.step_length / gait.step_period / unit.speed
    for text in (
        f"speed {speed:.4f} √(g l)", f"length {gait.step_length / unit.length:.4f} l",
        f"period {gait.step_period / unit.time:.4f} √(l/g)",
        f"cost of transport {gait.cost_of_transport:.4f}",
    ):  # fmt: skip
        assert text in texts
    player.walk.push(0.001, 0.0)
    while player.walk.strides < 2:
        player.frame(1 / FRAME_RATE)
    assert "was disturbed" in shown()


def test_a_torque_and_a_search_are_named(player, shown):
    player.set(1, 0.01)
    texts = shown(searched=False)
    assert "searching" in texts or player.gait[1]
    assert "Floquet multipliers of the gait under this torque" in shown()
    player.set(1, 0.0)
    player.set(0, 0.15)
    texts = shown()
    gait, known = player.gait
    verdict = "no gait found" if gait is None else "stable" if gait.stable else "unstable (ring)"
    assert known and verdict in texts


def test_the_parts_of_the_window_fill_it_side_by_side():
    parts = [SCENE, PORTRAIT, GAIT, PANEL, LEGEND]
    assert pygame.Rect(0, 0, 0, 0).unionall(parts).size == WINDOW_SIZE
    assert sum(part.width * part.height for part in parts) == WINDOW_SIZE[0] * WINDOW_SIZE[1]
    assert not any(part.collidelistall(parts[:i]) for i, part in enumerate(parts))
    assert min(part.left for part in parts) == min(part.top for part in parts) == 0


def test_notes_say_whether_time_stands_still_how_fast_it_passes_and_what_is_drawn(player, shown):
    assert "paused" not in shown() and not any(text.startswith("pace ") for text in shown())
    press(player, pygame.K_SPACE)
    press(player, pygame.K_MINUS)
    press(player, pygame.K_MINUS)
    mouse(player, pygame.MOUSEBUTTONDOWN, SCENE.center)
    mouse(player, pygame.MOUSEMOTION, (0, 0), rel=(30, -40))
    player.video = SimpleNamespace(path=SimpleNamespace(name="walk-7.mp4"), close=lambda: None)
    texts = shown()
    cosine, sine = np.cos(SLOPE), np.sin(SLOPE)
    along, off = PUSH_A_PIXEL * (30 * cosine - 40 * sine), PUSH_A_PIXEL * (40 * cosine + 30 * sine)
    for text in (
        "paused", "pace 1/4", "recording walk-7.mp4",
        f"push {along:+.3f} downhill, {off:+.3f} up, in m √(g l)",
    ):  # fmt: skip
        assert text in texts
    player.video = None
    player.walk.outcome = Outcome.FELL_BACKWARD
    assert shown()["fell backward (R begins again)"][2] == colours.WARNING


@pytest.mark.parametrize(
    ("keys", "factor", "end"),
    [
        ((pygame.K_MINUS, pygame.K_KP_MINUS), 0.5, 1 / 64),
        ((pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS), 2.0, 4.0),
    ],
)
def test_the_pace_is_halved_or_doubled_up_to_its_bounds(keys, factor, end, player):
    for key in keys:
        player.pace = 1.0
        press(player, key)
        assert player.pace == factor
        for _ in range(20):
            press(player, key)
        assert player.pace == end


def test_arrows_choose_sliders_in_a_circle_and_move_them_by_thousandths(player):
    count = len(player.sliders)
    for key, places in ((pygame.K_DOWN, [1, 2]), (pygame.K_UP, [1, 0, count - 1])):
        for place in places:
            press(player, key)
            assert player.selected == place
    press(player, pygame.K_DOWN)
    slider = player.sliders[0]
    for key, shift, steps in (
        (pygame.K_RIGHT, False, 1), (pygame.K_LEFT, False, -1), (pygame.K_RIGHT, True, 20),
        (pygame.K_LEFT, True, -20),
    ):  # fmt: skip
        before = slider.read(player.walk)
        press(player, key, shift=shift)
        change = slider.read(player.walk) - before
        assert change == pytest.approx(steps * 1e-3 * (slider.high - slider.low))
    player.nudge(7)
    press(player, pygame.K_HOME)
    assert slider.read(player.walk) == slider.home == SLOPE


def test_only_the_left_button_pushes_and_only_from_the_scene_on(player):
    for pos, button in (((SCENE.centerx, SCENE.centery), 3), ((SCENE.right + 5, 30), 1)):
        mouse(player, pygame.MOUSEBUTTONDOWN, pos, button)
        assert player.drag is None
    mouse(player, pygame.MOUSEBUTTONDOWN, SCENE.center)
    mouse(player, pygame.MOUSEMOTION, SCENE.center, rel=(3, 4))
    mouse(player, pygame.MOUSEMOTION, SCENE.center, rel=(10, -20))
    np.testing.assert_array_equal(player.drag, [13, 16])
    mouse(player, pygame.MOUSEBUTTONUP, SCENE.center, 3)
    assert player.drag is not None
    before = player.walk.state
    mouse(player, pygame.MOUSEBUTTONUP, SCENE.center)
    assert player.drag is None and np.any(player.walk.state != before)


def test_a_knob_follows_the_mouse_until_it_is_let_go(player):
    slider = player.sliders[0]
    track = slider.track
    mouse(player, pygame.MOUSEBUTTONDOWN, (track.left + track.width // 2, track.centery))
    assert slider.read(player.walk) == pytest.approx(0.5 * (slider.low + slider.high))
    mouse(player, pygame.MOUSEMOTION, (track.left + track.width // 4, 500))
    assert slider.read(player.walk) == pytest.approx(slider.low + 0.25 * (slider.high - slider.low))
    assert slider.knob(player.walk) == (track.left + track.width // 4, slider.row.centery)
    mouse(player, pygame.MOUSEBUTTONUP, (0, 0))
    mouse(player, pygame.MOUSEMOTION, (track.right, 500))
    assert slider.read(player.walk) == pytest.approx(slider.low + 0.25 * (slider.high - slider.low))


@pytest.mark.parametrize("name", WALKERS)
def test_sliders_have_the_range_of_their_kind_and_rows_below_each_other(name):
    walker = WALKERS[name]
    sliders = sliders_of(Setup(walker, 0.02, 0.01))
    length, mass = walker.leg_length, walker.total_mass
    felt = 0.2 * walker.units.torque
    assert [slider.name for slider in sliders[:3]] == ["slope", "controller", "gravity"]
    for slider in sliders:
        home = {"slope": 0.02, "controller": 0.0}.get(slider.name)
        home = getattr(walker, slider.name) if home is None else home
        expected = {
            "slope": (-0.05, 0.15), "controller": (-0.05, 0.05), "angle": (-0.4, 0.4),
            "length": (0.25 * home, 2.0 * home), "gravity": (0.25 * home, 2.0 * home),
            "mass": (0.0, max(2.0 * home, 0.5 * mass)), "offset": (-0.1 * length, 0.1 * length),
            "gyration": (0.0, 0.6 * length), "com": (0.0, 0.6 * length),
            "radius": (0.0, 0.6 * length),
        }.get(slider.name.rsplit("_")[-1])  # fmt: skip
        assert slider.home == home, slider.name
        if expected is not None:
            assert (slider.low, slider.high) == pytest.approx(expected), slider.name
        else:
            assert slider.high - slider.low >= felt * 0.99, slider.name
        assert slider.low < slider.high and PANEL.contains(slider.row)
    rows = [slider.row for slider in sliders]
    assert all(one.bottom == other.top for one, other in pairwise(rows))
    assert len({slider.label for slider in sliders}) == len(sliders)


def test_the_trail_holds_evenly_spaced_samples_of_the_latest_strides():
    walk = LiveWalk(Setup(WALKERS["D"], 0.009))
    for _ in range(60):
        walk.advance(0.5)
    assert len(walk.trail) <= 800
    free = {sample.free for sample in walk.trail}
    assert free == {False} and walk.trail[-1].strides == walk.strides
    expected = WALKERS["D"].units.to_dimensionless(walk.state)
    np.testing.assert_allclose(walk.trail[-1].state, expected)
    kneed = LiveWalk(Setup(LAB, SLOPE))
    for _ in range(40):
        kneed.advance(0.05)
    assert {sample.free for sample in kneed.trail} == {True, False}


def test_the_window_has_its_size(player):
    assert View().draw(player).get_size() == WINDOW_SIZE == (1280, 720)


@pytest.mark.parametrize("name", ["lab", "E"])
def test_sliders_lie_one_below_the_other_between_the_head_and_the_message(name):
    rows = [slider.row for slider in sliders_of(Setup(WALKERS[name], 0.01))]
    assert rows[0].top == PANEL.top + 34 and rows[-1].bottom <= PANEL.bottom - 64
    for above, below in pairwise(rows):
        assert below.top == above.bottom and below.left == PANEL.left
