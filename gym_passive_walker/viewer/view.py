"""The window's picture: the walker, its portrait and multipliers, sliders and keys."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pygame
from numpy.typing import NDArray
from pygame import Rect, Surface

from gym_passive_walker.render import look
from gym_passive_walker.render.screen import Screen
from gym_passive_walker.viewer import panels
from gym_passive_walker.viewer.player import Player
from gym_passive_walker.viewer.sheet import LINE, Sheet

SIZE = 1280, 720
"""Width and height in pixels."""

SCENE = Rect(0, 0, 800, 450)
PORTRAIT = Rect(0, 450, 420, 270)
MULTIPLIERS = Rect(420, 450, 380, 270)
SLIDERS = Rect(800, 0, 480, 560)
LEGEND = Rect(800, 560, 480, 160)

_TRACK_LEFT, _TRACK_WIDTH = SLIDERS.left + 170, 200
_KNOB = 7  # its radius
_TOP = SLIDERS.top + 34  # of the first slider
_MESSAGE = 64  # pixels kept for it below the last one


class View:
    """Draws what a player shows.

    Args:
        legend: What can be pressed, and what it does.
    """

    def __init__(self, legend: Sequence[tuple[str, str]]) -> None:
        self._sheet, self._legend, self._sliders = Sheet(SIZE), legend, 1
        self._screen: Screen | None = None

    def draw(self, player: Player) -> Surface:
        """Draw what the player shows now, and return the picture."""
        self._sliders = len(player.settings)
        self._sheet.surface.fill(look.SKY)
        self._scene(player)
        panels.portrait(self._sheet, PORTRAIT, player.walk)
        panels.multipliers(self._sheet, MULTIPLIERS, player.walk, player.gait)
        self._settings(player)
        self._keys()
        for box in (PORTRAIT, MULTIPLIERS, SLIDERS, LEGEND):
            self._sheet.frame(box)
        return self._sheet.surface

    def in_scene(self, place: tuple[int, int]) -> bool:
        """Whether a place is in the walker's picture."""
        return bool(SCENE.collidepoint(place))

    def slider_at(self, place: tuple[int, int]) -> int | None:
        """Which slider's track or knob is at a place, if there is one."""
        if not _TRACK_LEFT - _KNOB <= place[0] <= _TRACK_LEFT + _TRACK_WIDTH + _KNOB:
            return None
        return self.row_at(place)

    def row_at(self, place: tuple[int, int]) -> int | None:
        """Which slider's row, with its label and value, is at a place, if there is one."""
        return next((i for i in range(self._sliders) if self._row(i).collidepoint(place)), None)

    def value_at(self, player: Player, index: int, x: float) -> float:
        """What a slider says when it is moved to x."""
        setting, share = player.settings[index], (x - _TRACK_LEFT) / _TRACK_WIDTH
        return setting.low + share * (setting.high - setting.low)

    def knob(self, player: Player, index: int) -> tuple[int, int]:
        """Where the knob of a slider is."""
        setting = player.settings[index]
        value = setting.clipped(setting.read(player.walk))
        share = (value - setting.low) / (setting.high - setting.low)
        return round(_TRACK_LEFT + share * _TRACK_WIDTH), self._row(index).centery

    def _row(self, index: int) -> Rect:
        height = min(28, (SLIDERS.bottom - _MESSAGE - _TOP) // self._sliders)
        return Rect(SLIDERS.left, _TOP + index * height, SLIDERS.width, height)

    def _scene(self, player: Player) -> None:
        """The walker on its slope, the push that is being drawn, and what must be known."""
        walk = player.walk
        if self._screen is None or self._screen.walker != walk.walker:
            self._screen = Screen(walk.walker, size=SCENE.size)
        frame = self._screen.draw(walk.state, walk.slope, walk.contact, walk.strides)
        picture = pygame.image.frombuffer(frame, SCENE.size, "RGB")  # type: ignore[arg-type]
        self._sheet.surface.blit(picture, SCENE)
        if player.drag is not None:
            self._push(player, player.drag)
        self._sheet.write(player.state_of_walk, (SCENE.centerx, 24), size=28, at="midtop")
        if player.film is not None:
            pygame.draw.circle(self._sheet.surface, look.LEGS[1], (24, 28), 7)
            self._sheet.write(f"recording {player.film.path.name}", (38, 20))
        elif player.pace != 1.0:
            self._sheet.write(f"pace {_fraction(player.pace)}", (20, 20))

    def _push(self, player: Player, drag: NDArray) -> None:
        """An arrow from the hip, as long as the mouse was dragged."""
        if self._screen is None:
            return
        start = pygame.Vector2(self._screen.hip_on_frame(player.walk.state, player.walk.slope))
        along = pygame.Vector2(float(drag[0]), -float(drag[1]))
        self._sheet.arrow(start, along)
        downhill, up = player.impulse
        words = f"push {downhill:+.3f} downhill, {up:+.3f} up, in m √(g l)"
        self._sheet.write(words, (20, 44))

    def _settings(self, player: Player) -> None:
        """The sliders; the one that keys move is marked."""
        walk = player.walk
        actor = "" if walk.policy is None else f", {walk.policy.name} at the motors"
        self._sheet.write(f"walker {player.name}{actor}", (SLIDERS.left + 12, 8), size=22)
        for index, setting in enumerate(player.settings):
            row, knob = self._row(index), self.knob(player, index)
            if index == player.selected:
                pygame.draw.rect(
                    self._sheet.surface, look.GROUND, row.inflate(-8, -2), border_radius=4
                )
            track = Rect(_TRACK_LEFT, row.centery - 2, _TRACK_WIDTH, 4)
            colour = look.SKY if index == player.selected else look.GROUND
            pygame.draw.rect(self._sheet.surface, colour, track, border_radius=2)
            pygame.draw.circle(self._sheet.surface, look.LEGS[0], knob, _KNOB)
            self._sheet.write(setting.label, (row.left + 12, row.centery), at="midleft")
            value = f"{setting.read(walk):.5g}".replace("-", "−")
            self._sheet.write(value, (row.right - 14, row.centery), at="midright")
        place = SLIDERS.left + 12, SLIDERS.bottom - 10
        self._sheet.write(player.message, place, at="bottomleft", wide=SLIDERS.width - 24)

    def _keys(self) -> None:
        """What can be pressed, in two columns."""
        half = math.ceil(len(self._legend) / 2)
        for index, (key, does) in enumerate(self._legend):
            column, line = divmod(index, half)
            x, y = LEGEND.left + 12 + 240 * column, LEGEND.top + 12 + LINE * line
            self._sheet.write(key, (x, y))
            self._sheet.write(does, (x + 96, y), colour=look.GROUND_LINE)


def _fraction(pace: float) -> str:
    """A pace that is a power of two."""
    return f"{pace:g}" if pace >= 1.0 else f"1/{1.0 / pace:g}"
