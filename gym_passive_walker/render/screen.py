"""A walker in motion: frames for a window or for a film, drawn with pygame."""

from __future__ import annotations

import math
import os
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.extras import extra
from gym_passive_walker.render import look
from gym_passive_walker.render.pose import Leg, legs_by_identity, level, pose
from gym_passive_walker.walkers import Walker, as_walker

if TYPE_CHECKING:
    from types import ModuleType

MODES = ("human", "rgb_array")

_OVERSAMPLING = 2  # frames are drawn this much larger, then shrunk: smooth edges everywhere
_LEG_SHARE = 0.62  # of the frame's height
_GROUND_SHARE = 0.17  # of the frame's height, under the hip
_MARKS = 4  # on the ground, to a leg length


def _pygame() -> ModuleType:
    """The pygame module, without its greeting."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "hide")
    with extra("render"):
        import pygame
    return pygame


class Screen:
    """Draws one walker, frame by frame; the camera goes along with the hip.

    The slope is as steep as it is. Marks on the ground stand a quarter of a leg length apart, and
    long ones with a number (the distance in leg lengths) one leg length. Each leg keeps its colour
    through heelstrikes if `draw` is told how many there were.

    As "rgb_array" it needs no display and opens no window. As "human" it opens one, and keeps the
    pace of `fps`; once its user has closed it, frames are no longer drawn.

    Args:
        walker: The walker, or a preset's name.
        mode: "human" or "rgb_array".
        fps: Frames per second of a window; 0 shows frames as fast as they come.
        size: Width and height of a frame in pixels; even numbers, for films.

    Raises:
        ValueError: if the mode is not known, or the size is not positive.
        ImportError: if pygame is not installed.
    """

    def __init__(
        self,
        walker: Walker | str,
        mode: str = "rgb_array",
        fps: float = 30.0,
        *,
        size: tuple[int, int] = (800, 450),
    ) -> None:
        if mode not in MODES:
            raise ValueError(f"mode must be one of {MODES}, not {mode!r}")
        if min(size) < 1 or not 0.0 <= fps < math.inf:
            raise ValueError(f"size and fps must be positive, not {size} and {fps}")
        self.walker = as_walker(walker)
        self.mode, self.fps, self.size = mode, fps, size
        self._pygame = pygame = _pygame()
        self._canvas = pygame.Surface((_OVERSAMPLING * size[0], _OVERSAMPLING * size[1]), depth=32)
        self._scale = _LEG_SHARE * self._canvas.get_height() / self.walker.leg_length
        self._window: Any = None
        self._clock: Any = None
        self._open = True

    def draw(
        self, state: ArrayLike, slope: float, contact_x: float = 0.0, strides: int = 0
    ) -> NDArray[np.uint8] | None:
        """Draw one frame.

        Args:
            state: [stance, thigh, shank] angles in rad and their rates, shape (6,).
            slope: Slope in rad, positive downhill.
            contact_x: Where the stance foot touches the ground, along the slope.
            strides: Heelstrikes so far: the legs change roles, not colours.

        Returns:
            The frame, uint8 of shape (height, width, 3), as "rgb_array"; nothing as "human".

        Raises:
            ValueError: if the state has another shape or is not finite.
        """
        if not self._open:
            return None
        if np.shape(state) != (6,):
            raise ValueError(f"a frame shows one state of shape (6,), not {np.shape(state)}")
        posture = pose(self.walker, state, contact_x)
        camera = np.array([posture.hip[0], 0.0])
        self._canvas.fill(look.SKY)
        self._ground(camera, slope)
        near, far = legs_by_identity(posture, strides)
        hip = self._pixel(posture.hip, camera, slope)
        self._leg(hip, far, look.LEGS[1], camera, slope)
        self._leg(hip, near, look.LEGS[0], camera, slope)
        self._disc(hip, 0.050, look.HIP)
        self._disc(hip, 0.018, look.SKY)
        frame = self._pygame.transform.smoothscale(self._canvas, self.size)
        if self.mode == "rgb_array":
            pixels = bytearray(self._pygame.image.tobytes(frame, "RGB"))
            return np.frombuffer(pixels, np.uint8).reshape(self.size[1], self.size[0], 3)
        self._show(frame)
        return None

    def hip_on_frame(self, state: ArrayLike, slope: float) -> tuple[float, float]:
        """Where a frame shows the hip, in pixels from its upper left corner."""
        hip = pose(self.walker, state).hip
        x, y = self._pixel(hip, np.array([hip[0], 0.0]), slope) / _OVERSAMPLING
        return float(x), float(y)

    def close(self) -> None:
        """Close the window, if there is one. A closed screen draws nothing."""
        if self._window is not None:
            self._pygame.display.quit()
        self._window, self._open = None, False

    def _show(self, frame: Any) -> None:
        """Put a frame on the window, and wait for its time."""
        pygame = self._pygame
        if self._window is None:
            pygame.display.init()
            self._window = pygame.display.set_mode(self.size)
            pygame.display.set_caption("passive walker")
            self._clock = pygame.time.Clock()
        self._window.blit(frame, (0, 0))
        pygame.display.flip()
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
        elif self.fps:
            self._clock.tick(self.fps)

    def _pixel(self, points: NDArray, camera: NDArray, slope: float) -> NDArray:
        """Pixels on the canvas of points along the slope, shape (..., 2)."""
        width, height = self._canvas.get_size()
        right_up = self._scale * level(points - camera, slope)
        origin = np.array([0.5 * width, (1.0 - _GROUND_SHARE) * height])
        return origin + right_up * np.array([1.0, -1.0])

    def _disc(self, centre: NDArray, radius: float, colour: look.Colour) -> None:
        """A disc of a radius in leg lengths."""
        pixels = radius * self.walker.leg_length * self._scale
        self._pygame.draw.circle(self._canvas, colour, tuple(centre), pixels)

    def _polygon(self, corners: list[NDArray] | NDArray, colour: look.Colour) -> None:
        """A filled polygon."""
        self._pygame.draw.polygon(self._canvas, colour, [tuple(corner) for corner in corners])

    def _limb(
        self, start: NDArray, end: NDArray, wide: float, narrow: float, colour: look.Colour
    ) -> None:
        """A limb with round ends, its half-widths in leg lengths."""
        along = end - start
        length = math.hypot(*along)
        if length > 0.0:
            across = np.array([-along[1], along[0]]) / length * self.walker.leg_length * self._scale
            first, last = wide * across, narrow * across
            self._polygon([start + first, end + last, end - last, start - first], colour)
        self._disc(start, wide, colour)
        self._disc(end, narrow, colour)

    def _leg(
        self, hip: NDArray, leg: Leg, colour: look.Colour, camera: NDArray, slope: float
    ) -> None:
        """Thigh, shank and foot."""
        instep = leg.foot + 0.45 * (leg.tip - leg.foot)
        knee, instep, tip = (self._pixel(p, camera, slope) for p in (leg.knee, instep, leg.tip))
        dark = look.shaded(colour, look.HIP, 0.45)
        self._limb(hip, knee, 0.034, 0.026, colour)
        self._limb(knee, instep + 0.5 * (tip - instep), 0.026, 0.017, colour)
        if self.walker.foot_radius > 0.0:
            sole = self._pixel(leg.sole, camera, slope)
            self._polygon([*sole, instep], colour)
            for start, end in pairwise(sole):
                self._limb(start, end, 0.006, 0.006, dark)
        else:
            self._disc(tip, 0.024, dark)
        if self.walker.knees:
            self._disc(knee, 0.016, dark)

    def _ground(self, camera: NDArray, slope: float) -> None:
        """The slope, with marks that pass by as the walker goes."""
        length, (width, height) = self.walker.leg_length, self._canvas.get_size()
        seen = 0.6 * math.hypot(width, height) / self._scale  # to beyond every corner
        box = camera + seen * np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, -1.0], [-1.0, -1.0]])
        corners = self._pixel(box, camera, slope)
        self._polygon(corners, look.GROUND)
        pitch = length / _MARKS
        first, last = (math.ceil((camera[0] + side * seen) / pitch) for side in (-1.0, 1.0))
        for index in range(first, last):
            numbered = index % _MARKS == 0
            depth = (0.07 if numbered else 0.035) * length
            top, bottom = self._pixel(
                np.array([[index * pitch, 0.0], [index * pitch, -depth]]), camera, slope
            )
            self._limb(top, bottom, 0.003, 0.003, look.GROUND_LINE)
            if numbered:
                text = self._text(str(index // _MARKS))
                middle = float(bottom[0]), float(bottom[1]) + 0.012 * height
                self._canvas.blit(text, text.get_rect(midtop=middle))
        self._limb(corners[0], corners[1], 0.005, 0.005, look.GROUND_LINE)

    def _text(self, text: str) -> Any:
        """A piece of lettering; its font is not kept, for others may shut pygame down meanwhile."""
        self._pygame.font.init()
        font = self._pygame.font.Font(None, round(0.05 * self._canvas.get_height()))
        return font.render(text, True, look.GROUND_LINE)
