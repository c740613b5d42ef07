"""A walk in the viewer, controlled by keys and the mouse."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np
import pygame
from numpy.typing import NDArray

from gym_passive_walker.apps.viewer.sliders import sliders_of
from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup, gentle_slope
from gym_passive_walker.envs.policies import TrainedPolicy, policy_folder, shipped_policies
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.models.walkers import WALKERS
from gym_passive_walker.pictures.pose import level
from gym_passive_walker.pictures.video import Video

KEYS = (
    ("Space", "pause, continue"),
    ("N", "next frame"),
    ("- / +", "slower, faster"),
    ("R", "begin again"),
    ("Up / Down", "choose a slider"),
    ("Left / Right", "move it (Shift: more)"),
    ("Home", "put it back"),
    ("W", "another walker"),
    ("P", "another policy"),
    ("F", "video on, off"),
    ("Q", "quit"),
    ("drag scene", "push the hip"),
)
"""Keys, and their effects."""

FRAME_RATE = 60
"""Frames per second."""

WINDOW_SIZE = 1280, 720
"""Width and height of the window in pixels."""

SCENE = pygame.Rect(0, 0, 800, 450)
"""Area of the window that shows the walker; dragging there pushes it."""

PUSH_A_PIXEL = 0.0005
"""Impulse of a drag by one pixel, in units of m sqrt(g l); a walker's own momentum is about 0.2."""

_SLOWEST, _FASTEST = 2.0**-6, 4.0
_FINE = 1e-3  # of a slider's range: what a key moves
_COARSE = 20  # times as much, with Shift


@cache
def offered_policies() -> dict[str, TrainedPolicy]:
    """The shipped policies by name."""
    return {name: TrainedPolicy(policy_folder(name)) for name in shipped_policies()}


class Player:
    """A walk, its display, and the user's changes.

    Args:
        walk: The walk. If a policy drives it, P offers that policy too.

    Attributes:
        walk: The walk.
        sliders: Sliders of the quantities that can be changed.
        selected: Number of the slider that keys move.
        paused: Whether time stands still.
        pace: The walk's time over that of the window.
        drag: Drag of the scene by the mouse, right and up in pixels, (2,); None without one.
        video: The video that is being recorded, if there is one.
        message: A line for the user.
        running: Whether the window stays open.
    """

    def __init__(self, walk: LiveWalk) -> None:
        self.walk, self._first = walk, walk.setup.controller
        self.sliders, self.selected = sliders_of(walk.setup), 0
        self.paused, self.pace, self.running, self.message = False, 1.0, True, ""
        self.drag: NDArray[np.float64] | None = None
        self.video: Video | None = None
        self._held: int | None = None  # the slider that the mouse holds
        self._pointer = (-1, -1)  # where the mouse was last seen
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="gaits")
        self._sought, self._search = walk.setup, self._thread.submit(walk.setup.gait)
        self._found: tuple[Gait | None, Setup | None] = None, None

    @property
    def gait(self) -> tuple[Gait | None, bool]:
        """The periodic gait found last, and whether it is that of the setup now; never waits.

        After a change of the setup, a search in the background begins.
        """
        if self._search.done():
            self._found = self._search.result(), self._sought
            if self._sought != self.walk.setup:
                self._sought = self.walk.setup
                self._search = self._thread.submit(self._sought.gait)
        gait, setup = self._found
        return gait, setup == self.walk.setup

    @property
    def ended(self) -> str:
        """Ending of the walk; empty while it continues."""
        if self.walk.outcome == Outcome.RUNNING:
            return ""
        return f"{self.walk.outcome} (R begins again)"

    @property
    def impulse(self) -> NDArray[np.float64]:
        """The push that is being drawn: downhill and off the ground, in m sqrt(g l), (2,)."""
        drag = np.zeros(2) if self.drag is None else self.drag
        return PUSH_A_PIXEL * level(drag, -self.walk.setup.slope)

    def frame(self, elapsed: float) -> None:
        """Continue for some of the window's time, in seconds."""
        if not self.paused:
            self.walk.advance(self.pace * elapsed)

    def handle(self, event: pygame.event.Event) -> None:
        """Do what an event asks for; others do nothing."""
        if event.type == pygame.QUIT:
            self.running = False
        elif event.type == pygame.KEYDOWN:
            self._press(event.key, bool(event.mod & pygame.KMOD_SHIFT))
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == pygame.BUTTON_LEFT:
            for index, slider in enumerate(self.sliders):
                if slider.grabbed_at(event.pos):
                    self._held = index
                    self.set(index, slider.value_at(event.pos[0]))
            if SCENE.collidepoint(event.pos):
                self.drag = np.zeros(2)
        elif event.type == pygame.MOUSEMOTION:
            self._pointer, (right, down) = event.pos, event.rel
            if self._held is not None:
                self.set(self._held, self.sliders[self._held].value_at(event.pos[0]))
            if self.drag is not None:
                self.drag = self.drag + np.array([right, -down])
        elif event.type == pygame.MOUSEBUTTONUP and event.button == pygame.BUTTON_LEFT:
            if self.drag is not None:
                self.walk.push(*self.impulse.tolist())
            self._held = self.drag = None
        elif event.type == pygame.MOUSEWHEEL:
            for index, slider in enumerate(self.sliders):
                if slider.row.collidepoint(self._pointer):
                    self.selected = index
                    self.nudge(event.y)

    def _press(self, key: int, shift: bool) -> None:
        """Do what a key is for; others do nothing."""
        match key:
            case pygame.K_SPACE:
                self.paused = not self.paused
            case pygame.K_n:
                self.paused = True
                self.walk.advance(self.pace / FRAME_RATE)
            case pygame.K_MINUS | pygame.K_KP_MINUS:
                self.pace = max(0.5 * self.pace, _SLOWEST)
            case pygame.K_PLUS | pygame.K_EQUALS | pygame.K_KP_PLUS:
                self.pace = min(2.0 * self.pace, _FASTEST)
            case pygame.K_r:
                self.begin_again()
            case pygame.K_UP | pygame.K_DOWN:
                further = 1 if key == pygame.K_DOWN else -1
                self.selected = (self.selected + further) % len(self.sliders)
            case pygame.K_LEFT | pygame.K_RIGHT:
                steps = _COARSE if shift else 1
                self.nudge(steps if key == pygame.K_RIGHT else -steps)
            case pygame.K_HOME:
                self.set(self.selected, self.sliders[self.selected].home)
            case pygame.K_w:
                self.next_walker(-1 if shift else 1)
            case pygame.K_p:
                self.next_policy(-1 if shift else 1)
            case pygame.K_f:
                paths = (Path(f"walk-{number}.mp4") for number in count(1))
                unused = next(path for path in paths if not path.exists())
                self.record(unused if self.video is None else None)
            case pygame.K_q | pygame.K_ESCAPE:
                self.running = False

    def begin_again(self) -> None:
        """Begin at the gait of the setup if it is known, else at the nearest passive gait."""
        gait, known = self.gait
        start = gait.state if known and gait is not None else None
        self._try(lambda: self.walk.begin(self.walk.setup, start))

    def nudge(self, steps: int) -> None:
        """Move the selected slider by thousandths of its range."""
        slider = self.sliders[self.selected]
        change = steps * _FINE * (slider.high - slider.low)
        self.set(self.selected, slider.read(self.walk) + change)

    def set(self, index: int, value: float) -> None:
        """Select a slider, and set it to the nearest value of its range."""
        self.selected = index
        self._try(lambda: self.sliders[index].write(self.walk, value))

    def next_walker(self, further: int) -> None:
        """Continue as another preset; after a fall, begin again on a slope where it walks."""
        presets, setup = list(WALKERS.values()), self.walk.setup
        place = presets.index(setup.walker) if setup.walker in presets else -1
        walker = presets[(place + further) % len(presets)]
        if self.walk.outcome == Outcome.RUNNING:
            self._try(lambda: self.walk.change(setup._replace(walker=walker)))
        else:
            slope = gentle_slope(walker, setup.slope)
            self._try(lambda: self.walk.begin(setup._replace(walker=walker, slope=slope)))
        self.sliders = sliders_of(self.walk.setup)

    def next_policy(self, further: int) -> None:
        """Continue under another policy: that of the beginning, a shipped one, or none."""
        first = {} if isinstance(self._first, float) else {"the loaded policy": self._first}
        offers = {"no policy": 0.0, **first, **offered_policies()}
        names, controllers, setup = list(offers), list(offers.values()), self.walk.setup
        now = 0.0 if isinstance(setup.controller, float) else setup.controller
        name = names[(controllers.index(now) + further) % len(names)]
        setup = setup._replace(controller=offers[name])
        self._try(lambda: self.walk.change(setup), f"{name} at the motors")

    def record(self, path: Path | None) -> None:
        """Finish the video, if there is one, and record the following frames; not if None."""
        if self.video is not None:
            video, self.video = self.video, None
            video.close()
            self.message = f"recorded {video.path}"
        if path is not None:
            try:
                self.video = Video(path, WINDOW_SIZE, FRAME_RATE, shrink=2)
            except (ImportError, OSError) as error:
                self.message = str(error)

    def close(self) -> None:
        """Finish the video and the search for gaits."""
        self.record(None)
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _try(self, change: Callable[[], object], message: str = "") -> None:
        """Change something and show a message, or show why it is not possible."""
        try:
            change()
            self.message = message
        except ValueError as error:
            self.message = str(error)
