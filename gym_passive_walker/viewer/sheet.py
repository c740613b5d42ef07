"""A surface to draw on, with words and arrows."""

from __future__ import annotations

import pygame
from pygame import Rect, Surface, Vector2

from gym_passive_walker.render import look

LINE = 20
"""Pixels from line to line."""


class Sheet:
    """A surface that can be written on.

    Args:
        size: Width and height in pixels.

    Attributes:
        surface: The surface.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        pygame.font.init()
        self.surface = Surface(size)
        self._fonts = {size: pygame.font.Font(None, size) for size in (18, 22, 28)}

    def write(
        self,
        text: str,
        place: tuple[float, float],
        *,
        size: int = 18,
        at: str = "topleft",
        colour: look.Colour = look.HIP,
        wide: int = 0,
    ) -> None:
        """Write words.

        Args:
            text: The words.
            place: Where, in pixels.
            size: 18, 22 or 28.
            at: Which point of the words is there, as pygame's rectangles call it.
            colour: Of the words.
            wide: Pixels after which a line is broken; 0 for never.
        """
        words = self._fonts[size].render(text, True, colour, None, wide)
        box = words.get_rect()
        setattr(box, at, place)
        self.surface.blit(words, box)

    def arrow(self, start: Vector2, along: Vector2) -> None:
        """An arrow from a point, unless it is too short to have a direction."""
        if along.length() < 1.0:
            return
        end, forward = start + along, along.normalize()
        across, head = Vector2(-forward.y, forward.x), min(14.0, along.length())
        neck = end - head * forward
        pygame.draw.line(self.surface, look.HIP, start, neck, 4)
        corners = [end, neck + 0.5 * head * across, neck - 0.5 * head * across]
        pygame.draw.polygon(self.surface, look.HIP, corners)

    def frame(self, box: Rect) -> None:
        """A thin frame."""
        pygame.draw.rect(self.surface, look.GROUND, box, 1)
