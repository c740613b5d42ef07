"""Drawing of frames: shapes and lettering at places along a slope and off it."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.pictures import colours
from gym_passive_walker.pictures.pose import level

_LETTERING = 0.05  # size of the font as a share of the canvas's height


class Brush:
    """Draws on a canvas; widths are in leg lengths, places in pixels or, by `at`, on the slope.

    Args:
        pygame: The module.
        canvas: Its surface.
        scale: Pixels to a leg length.
        length: The leg length, in the walker's own units.
    """

    def __init__(self, pygame: Any, canvas: Any, scale: float, length: float) -> None:
        self.pygame, self.canvas, self.scale, self.length = pygame, canvas, scale, length
        self.camera, self._slope, self._origin = np.zeros(2), 0.0, np.zeros(2)
        self._font: Any = None

    def look_at(self, camera: NDArray, slope: float, origin: tuple[float, float]) -> None:
        """Begin a frame, with a place on the slope at a pixel, gravity down."""
        self.pygame.font.init()  # other code may have shut pygame down
        self._font = self.pygame.font.Font(None, round(_LETTERING * self.canvas.get_height()))
        self.camera, self._slope, self._origin = camera, slope, np.array(origin)

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Pixels of places (x, y) along and off the slope, shape (..., 2)."""
        away = level(np.asarray(points) - self.camera, self._slope)
        return self._origin + self.scale / self.length * away * [1.0, -1.0]

    def disc(self, centre: NDArray, radius: float, colour: colours.Colour) -> None:
        """A disc."""
        self.pygame.draw.circle(self.canvas, colour, tuple(centre), radius * self.scale)

    def polygon(self, corners: list[NDArray] | NDArray, colour: colours.Colour) -> None:
        """A filled polygon."""
        self.pygame.draw.polygon(self.canvas, colour, [tuple(corner) for corner in corners])

    def limb(
        self, start: NDArray, end: NDArray, wide: float, narrow: float, colour: colours.Colour
    ) -> None:
        """A limb with round ends and these half-widths."""
        along = end - start
        length = math.hypot(*along)
        if length > 0.0:
            across = np.array([-along[1], along[0]]) / length * self.scale
            first, last = wide * across, narrow * across
            self.polygon([start + first, end + last, end - last, start - first], colour)
        self.disc(start, wide, colour)
        self.disc(end, narrow, colour)

    def line(self, places: NDArray, width: float, colour: colours.Colour) -> None:
        """A line through pixels, of this half-width."""
        for start, end in pairwise(places):
            self.limb(start, end, width, width, colour)

    def turn(self, centre: NDArray, radius: float, angle: float, colour: colours.Colour) -> None:
        """An arrow along an arc below a centre, by an angle in rad, positive anticlockwise."""
        if abs(angle) < 1e-3:
            return
        turns = np.linspace(-0.5 * angle, 0.5 * angle, 16)
        reach = radius * self.scale
        arc = centre + reach * np.column_stack([np.sin(turns), np.cos(turns)])
        self.line(arc, 0.010, colour)
        ahead = math.copysign(1.0, angle) * np.array([np.cos(turns[-1]), -np.sin(turns[-1])])
        out = np.array([np.sin(turns[-1]), np.cos(turns[-1])])
        head = 0.040 * self.scale
        self.polygon(
            [arc[-1] + 1.4 * head * ahead, arc[-1] + head * out, arc[-1] - head * out], colour
        )

    def arrow(self, start: NDArray, along: NDArray, colour: colours.Colour) -> None:
        """A straight arrow from a pixel on, by so many pixels."""
        length, width = math.hypot(*along), 0.012
        if length == 0.0:
            return
        ahead = along / length
        aside = np.array([-ahead[1], ahead[0]])
        head = min(4.0 * width * self.scale, length)
        neck = start + along - head * ahead
        self.limb(start, neck, width, width, colour)
        self.polygon([start + along, neck + 0.7 * head * aside, neck - 0.7 * head * aside], colour)

    def write(
        self,
        text: str,
        place: ArrayLike,
        anchor: str = "midtop",
        colour: colours.Colour = colours.GROUND_LINE,
    ) -> float:
        """Write text, and return its height in pixels.

        Args:
            text: The text.
            place: A pixel, (right, down).
            anchor: The point of the text that lies there, by pygame's name of it.
            colour: The text's colour.
        """
        drawn = self._font.render(text, True, colour)
        right, down = np.asarray(place, dtype=float)
        self.canvas.blit(drawn, drawn.get_rect(**{anchor: (float(right), float(down))}))
        return float(drawn.get_height())
