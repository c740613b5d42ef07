"""What the viewer does, whoever asks for it: keys, the mouse, or a test."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.envs.starts import REFERENCE_SLOPES
from gym_passive_walker.gaits.fixed_point import find_gait
from gym_passive_walker.gaits.gait import GaitNotFound
from gym_passive_walker.physics.hybrid import Outcome
from gym_passive_walker.policies import TrainedPolicy, load_policy, shipped_policies
from gym_passive_walker.render.film import Film
from gym_passive_walker.render.pose import level
from gym_passive_walker.viewer.seeker import Answer, Question, Seeker
from gym_passive_walker.viewer.settings import settings_of
from gym_passive_walker.viewer.walk import LiveWalk
from gym_passive_walker.walkers import WALKERS, Walker

FPS = 60
"""Frames a second."""

PUSH = 0.0005
"""Impulse of a drag by one pixel, in units of m sqrt(g l); a walker's own momentum is about 0.2."""

_PACES = tuple(2.0**power for power in range(-6, 3))
_FINE = 1e-3  # of a setting's range: what a key moves


def gentle_slope(walker: Walker, *wanted: float) -> float:
    """A slope in rad on which a walker walks stably, if one is found.

    Args:
        walker: The walker.
        *wanted: Slopes in rad that are tried first; then come gentle ones.
    """
    for slope in (*wanted, *REFERENCE_SLOPES):
        try:
            if find_gait(walker, slope).stable:
                return slope
        except GaitNotFound:
            continue
    return REFERENCE_SLOPES[0]


@cache
def offered_policies() -> dict[str, TrainedPolicy]:
    """Shipped policies."""
    return {name: load_policy(name) for name in shipped_policies()}


class Player:
    """A walk, and how it is shown.

    Args:
        walk: The walk.

    Attributes:
        walk: The walk.
        policy: The policy that the viewer began with, if there was one.
        settings: What may be changed.
        selected: Which of the settings keys change.
        paused: Whether time stands still.
        pace: Of the walk's time to that of the window.
        drag: What the mouse has dragged so far, right and up in pixels; None if it does not.
        film: Where frames are recorded, if they are.
        message: What the user should know now.
        running: Whether the window stays open.
    """

    def __init__(self, walk: LiveWalk) -> None:
        self.walk, self.policy = walk, walk.policy
        self.settings, self.selected = settings_of(walk), 0
        self.paused, self.pace, self.running, self.message = False, 1.0, True, ""
        self.drag: NDArray[np.float64] | None = None
        self.film: Film | None = None
        self._seeker = Seeker()

    @property
    def gait(self) -> Answer | None:
        """The gait of what is set now, or the last one found while the search goes on."""
        return self._seeker.look(Question.of(self.walk))

    def frame(self, elapsed: float) -> None:
        """Let the walk go on for as much of the window's time, in seconds."""
        if not self.paused:
            self.walk.advance(self.pace * elapsed)

    def close(self) -> None:
        """End the film and the search for gaits."""
        self.stop_film()
        self._seeker.close()

    def pause(self) -> None:
        """Let time stand still, or go on."""
        self.paused = not self.paused

    def step(self) -> None:
        """Go on by one frame, and stand still."""
        self.paused = True
        self.walk.advance(self.pace / FPS)

    def change_pace(self, faster: int) -> None:
        """Go to the next slower (-1) or faster (+1) pace."""
        place = _PACES.index(self.pace) + faster
        self.pace = _PACES[min(max(place, 0), len(_PACES) - 1)]

    def reset(self) -> None:
        """Begin anew: at the gait of what is set now, or at the nearest passive one."""
        gait = self.gait
        known = gait is not None and gait.question == Question.of(self.walk)
        self._try(lambda: self.walk.begin(gait.state if gait and known else None))

    def select(self, further: int) -> None:
        """Go to another setting."""
        self.selected = (self.selected + further) % len(self.settings)

    def nudge(self, shares: float) -> None:
        """Move the selected setting by thousandths of its range."""
        setting = self.settings[self.selected]
        change = shares * _FINE * (setting.high - setting.low)
        self.set(self.selected, setting.read(self.walk) + change)

    def set(self, index: int, value: float) -> None:
        """Set a setting to the nearest value within its bounds."""
        setting = self.settings[index]
        self.selected = index
        self._try(lambda: setting.write(self.walk, setting.clipped(value)))

    def restore(self) -> None:
        """Put the selected setting back to what the walker began with."""
        self.set(self.selected, self.settings[self.selected].home)

    def next_walker(self, further: int) -> None:
        """Go on as another preset; after a fall, begin again on a slope where it walks."""
        names = list(WALKERS)
        place = names.index(self.name) if self.name in names else -1
        walker = WALKERS[names[(place + further) % len(names)]]
        if self.walk.outcome == Outcome.RUNNING:
            self._try(lambda: self.walk.change_walker(walker))
        else:
            slope = gentle_slope(walker, self.walk.slope)
            self._try(lambda: self.walk.begin_as(walker, slope))
        self.settings = settings_of(self.walk)

    @property
    def name(self) -> str:
        """What the walker is called, if it is a preset."""
        known = (name for name, walker in WALKERS.items() if walker == self.walk.walker)
        return next(known, "changed")

    def hand_over(self, further: int = 1) -> None:
        """Give the hip to another policy: the loaded one, the shipped ones, and then none.

        Args:
            further: 1 for the next policy, -1 for the one before.
        """
        loaded = {} if self.policy is None else {"the loaded policy": self.policy}
        offers = {"no policy": None, **loaded, **offered_policies()}
        names, policies = list(offers), list(offers.values())
        place = (policies.index(self.walk.policy) + further) % len(policies)
        self.walk.hand_over(policies[place])
        self.message = f"{names[place]} at the hip"

    def begin_drag(self) -> None:
        """Begin to draw a push."""
        self.drag = np.zeros(2)

    def drag_by(self, right: float, down: float) -> None:
        """Draw a push further."""
        if self.drag is not None:
            self.drag = self.drag + np.array([right, -down])

    @property
    def impulse(self) -> NDArray[np.float64]:
        """The push that is being drawn: downhill and off the ground, in m sqrt(g l), (2,)."""
        drag = np.zeros(2) if self.drag is None else self.drag
        return PUSH * level(drag, -self.walk.slope)

    def push(self) -> None:
        """Push the hip by what was drawn, if anything was."""
        if self.drag is not None:
            self.walk.push(*self.impulse.tolist())
            self.drag = None

    def film_to(self, path: Path, size: tuple[int, int]) -> None:
        """Record frames of this size from now on."""
        self.stop_film()
        try:
            self.film = Film(path, size, FPS, shrink=2)
        except (ImportError, OSError) as error:
            self.message = str(error)

    def stop_film(self) -> None:
        """Finish the film, if there is one."""
        if self.film is not None:
            film, self.film = self.film, None
            film.close()
            self.message = f"recorded {film.path}"

    @property
    def state_of_walk(self) -> str:
        """What the walk is doing, in words."""
        if self.walk.outcome != Outcome.RUNNING:
            return f"{self.walk.outcome.name.replace('_', ' ').lower()} (R begins anew)"
        return "paused" if self.paused else ""

    def _try(self, change: Callable[[], object]) -> None:
        """Change something, or say why it cannot be."""
        try:
            change()
            self.message = ""
        except ValueError as error:
            self.message = str(error)
