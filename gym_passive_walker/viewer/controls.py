"""Keys and the mouse: events in, what the viewer does out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pygame
from pygame.event import Event

from gym_passive_walker.viewer.player import Player
from gym_passive_walker.viewer.view import SIZE, View

KEYS = (
    ("Space", "pause, go on"),
    ("N", "next frame"),
    ("- / +", "slower, faster"),
    ("R", "begin anew"),
    ("Up / Down", "choose a slider"),
    ("Left / Right", "move it (Shift: more)"),
    ("Home", "put it back"),
    ("W", "another walker"),
    ("P", "another policy"),
    ("F", "film on, off"),
    ("Q", "quit"),
    ("drag scene", "push the hip"),
)
"""What a user can press, and what it does."""

_COARSE = 20.0  # times what a key moves otherwise


class Controls:
    """Turns events into what the player does.

    Args:
        player: Does it.
        view: Knows what lies where.
    """

    def __init__(self, player: Player, view: View) -> None:
        self.player, self.view = player, view
        self._held: int | None = None  # the slider that the mouse holds
        self._pointer = (-1, -1)  # where the mouse was last seen
        self._keys: dict[int, Callable[[bool], Any]] = {
            pygame.K_SPACE: lambda shift: player.pause(),
            pygame.K_n: lambda shift: player.step(),
            pygame.K_MINUS: lambda shift: player.change_pace(-1),
            pygame.K_KP_MINUS: lambda shift: player.change_pace(-1),
            pygame.K_PLUS: lambda shift: player.change_pace(1),
            pygame.K_EQUALS: lambda shift: player.change_pace(1),
            pygame.K_KP_PLUS: lambda shift: player.change_pace(1),
            pygame.K_r: lambda shift: player.reset(),
            pygame.K_UP: lambda shift: player.select(-1),
            pygame.K_DOWN: lambda shift: player.select(1),
            pygame.K_LEFT: lambda shift: player.nudge(-_COARSE if shift else -1.0),
            pygame.K_RIGHT: lambda shift: player.nudge(_COARSE if shift else 1.0),
            pygame.K_HOME: lambda shift: player.restore(),
            pygame.K_w: lambda shift: player.next_walker(-1 if shift else 1),
            pygame.K_p: lambda shift: player.hand_over(-1 if shift else 1),
            pygame.K_f: lambda shift: self._film(),
            pygame.K_q: lambda shift: self._quit(),
            pygame.K_ESCAPE: lambda shift: self._quit(),
        }

    def handle(self, event: Event) -> None:
        """Do what an event asks for; others do nothing."""
        if event.type == pygame.QUIT:
            self._quit()
        elif event.type == pygame.KEYDOWN and event.key in self._keys:
            self._keys[event.key](bool(event.mod & pygame.KMOD_SHIFT))
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == pygame.BUTTON_LEFT:
            self._press(event.pos)
        elif event.type == pygame.MOUSEMOTION:
            self._pointer = event.pos
            self._move(event.pos, event.rel)
        elif event.type == pygame.MOUSEBUTTONUP and event.button == pygame.BUTTON_LEFT:
            self._release()
        elif event.type == pygame.MOUSEWHEEL:
            self._turn(float(event.y))

    def _press(self, place: tuple[int, int]) -> None:
        self._held = self.view.slider_at(place)
        if self._held is not None:
            self.player.set(self._held, self.view.value_at(self.player, self._held, place[0]))
        elif self.view.in_scene(place):
            self.player.begin_drag()

    def _move(self, place: tuple[int, int], moved: tuple[int, int]) -> None:
        if self._held is not None:
            self.player.set(self._held, self.view.value_at(self.player, self._held, place[0]))
        self.player.drag_by(*moved)

    def _turn(self, shares: float) -> None:
        """Move the slider whose row is below the pointer; elsewhere the wheel does nothing."""
        row = self.view.row_at(self._pointer)
        if row is not None:
            self.player.selected = row
            self.player.nudge(shares)

    def _release(self) -> None:
        self._held = None
        self.player.push()

    def _film(self) -> None:
        """Begin a film in the first file that is not there yet, or end it."""
        if self.player.film is not None:
            self.player.stop_film()
            return
        number = 1
        while (path := Path(f"walk-{number}.mp4")).exists():
            number += 1
        self.player.film_to(path, SIZE)

    def _quit(self) -> None:
        self.player.running = False
