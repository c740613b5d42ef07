"""A user's own system in the viewer's window."""

import os

import numpy as np
import pytest

import gym_passive_walker as gpw
from examples.torso import TORSO
from gym_passive_walker.models.equations.hybrid import Outcome
from tests.own.statements import DRIVEN
from tests.own.test_derived import STRAIGHT

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
pygame = pytest.importorskip("pygame")

from gym_passive_walker.apps.viewer.player import WINDOW_SIZE, Player  # noqa: E402
from gym_passive_walker.apps.viewer.view import View  # noqa: E402
from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup  # noqa: E402
from gym_passive_walker.pictures.screen import open_window  # noqa: E402

SLOPE = 0.03


@pytest.fixture
def player():
    """A torso that walks in the viewer."""
    open_window(pygame, WINDOW_SIZE)
    shown = Player(LiveWalk(Setup(TORSO, SLOPE)))
    yield shown
    shown.close()
    pygame.display.quit()


def test_a_system_walks_in_frames_as_its_gait_does():
    gait = gpw.find_gait(TORSO, SLOPE)
    walk = LiveWalk(Setup(TORSO, SLOPE), gait.state)
    for _ in range(300):
        walk.advance(0.03)
    assert walk.outcome == Outcome.RUNNING and walk.strides == 3
    assert walk.last.step_length == pytest.approx(gait.strides.step_length[0], rel=1e-6)
    assert walk.last.cost_of_transport == pytest.approx(np.sin(SLOPE), rel=1e-6)
    assert walk.contact == pytest.approx(3 * gait.strides.step_length[0], rel=1e-6)


def test_a_compass_walks_as_the_package_s_own_after_a_held_torque():
    state = gpw.find_gait(DRIVEN, SLOPE).state
    own = LiveWalk(Setup(DRIVEN, SLOPE, 0.004), state)
    known = LiveWalk(Setup(STRAIGHT, SLOPE, 0.004), state[[0, 1, 1, 2, 3, 3]])
    for walk in (own, known):
        walk.advance(1.0)
    np.testing.assert_allclose(own.state, known.state[[0, 1, 3, 4]], atol=1e-8)
    assert own.torque == known.torque == 0.004
    for walk in (own, known):
        walk.advance(3.0)
    assert own.contact == pytest.approx(known.contact, abs=1e-7) and own.contact > 0.3


def test_a_push_acts_at_the_centre_of_mass():
    walk = LiveWalk(Setup(TORSO, SLOPE))
    walk.advance(0.5)
    before = walk.state
    walk.push(0.01, 0.0)
    jump = walk.state - before
    half = TORSO.coordinates
    np.testing.assert_array_equal(jump[:half], 0.0)
    step = 1e-6
    ahead, behind = (
        TORSO.centre_of_mass(before + sign * step * np.append(jump[half:], np.zeros(half)))
        for sign in (1.0, -1.0)
    )
    assert (ahead - behind)[0] > 0.0


def test_sliders_change_fields_of_the_body_while_it_walks(player):
    names = [slider.name for slider in player.sliders]
    assert names == ["slope", *TORSO.body._fields]
    place = names.index("stiffness")
    player.frame(0.5)
    before = player.walk.state
    player.set(place, 1.1 * TORSO.body.stiffness)
    assert player.message == ""
    np.testing.assert_allclose(player.walk.state, before)
    assert player.walk.setup.walker.body.stiffness == pytest.approx(1.1 * TORSO.body.stiffness)
    for _ in range(60):
        player.frame(0.05)
    assert player.walk.strides >= 1


def test_the_picture_shows_the_system_and_the_next_walker_begins_again(player):
    view = View()
    empty = pygame.image.tobytes(view.draw(player), "RGB")
    player.frame(1.0)
    player.drag = np.array([40.0, 10.0])
    assert pygame.image.tobytes(view.draw(player), "RGB") != empty
    player.next_walker(1)
    assert player.message == "" and player.walk.setup.walker in gpw.WALKERS.values()
    player.frame(0.1)
    view.draw(player)


def test_held_controls_are_a_controller_of_a_system():
    strides = gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.01})
    gait = gpw.find_gait(strides)
    half = 0.004 * DRIVEN.total_mass
    assert strides.exact and gait.strides.hip_work[0] > 0.0
    free = gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.0})
    assert free.passive
    with pytest.raises(ValueError, match="has no knee; it has hip"):
        gpw.stride_map(DRIVEN, SLOPE, controller={"knee": half})
    with pytest.raises(ValueError, match="hip must be one number"):
        gpw.stride_map(DRIVEN, SLOPE, controller={"hip": "much"})
    for others in ({}, {"slope": SLOPE, "scene": "level"}):
        with pytest.raises(ValueError, match="needs a slope, no scene"):
            gpw.stride_map(DRIVEN, controller={"hip": 0.01}, **others)
    with pytest.raises(ValueError, match="a controller of a System"):
        gpw.stride_map("lab", SLOPE, controller={"hip": 0.01})


def test_play_opens_a_window_for_a_system_and_for_its_gait(tmp_path):
    gait = gpw.find_gait(TORSO, SLOPE)
    for number, shown in enumerate((gait, TORSO)):
        picture = tmp_path / f"{number}.png"
        gpw.play(shown, None if number == 0 else SLOPE, seconds=0.1, picture=picture)
        assert picture.stat().st_size > 10_000
    held = gpw.find_gait(gpw.stride_map(DRIVEN, SLOPE, controller={"hip": 0.01}))
    with pytest.raises(ValueError, match="play shows gaits"):
        gpw.play(held, seconds=0.1)
