"""A walker in motion: frames for a window or for a film, drawn with pygame."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.extras import extra
from gym_passive_walker.render import look
from gym_passive_walker.render.brush import Brush
from gym_passive_walker.render.ground import between, height
from gym_passive_walker.render.pose import Leg, Pose, legs_by_identity, pose
from gym_passive_walker.walkers import WalkerLike, as_walker

if TYPE_CHECKING:
    from types import ModuleType

MODES = ("human", "rgb_array")

_OVERSAMPLING = 2  # frames are drawn this much larger, then shrunk: smooth edges everywhere
_LEG_SHARE = 0.62  # of the frame's height
_GROUND_SHARE = 0.17  # of the frame's height, under the hip
_MARKS = 4  # on the ground, to a leg length
_GHOSTS, _GHOST_APART = 5, 0.22  # how many, and how far the hip is from one to the next
_LEVEL = np.array([[-1.0, 0.0], [1.0, 0.0]])  # ground that is the slope itself
_VIEW = np.linspace(-0.75, 0.75, 31)  # leg lengths: the camera keeps to the mean height of these
_PUSH, _FRAMES = 0.45, 8  # leg lengths of the largest push's arrow; frames until it has faded
_SCUFF = 1e-3  # depth in leg lengths from which on a foot is seen to scuff


def load_pygame() -> ModuleType:
    """The pygame module, without its greeting.

    Raises:
        ImportError: if pygame is not installed.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "hide")
    with extra("render"):
        import pygame
    return pygame


def open_window(pygame: ModuleType, size: tuple[int, int]) -> Any:
    """Open a window on the machine's display, and return its surface.

    Raises:
        OSError: if the machine has no display.
    """
    try:
        pygame.display.init()
        if pygame.display.get_driver() == "offscreen" and "SDL_VIDEODRIVER" not in os.environ:
            raise pygame.error("SDL would draw off the screen")
    except pygame.error as error:
        pygame.display.quit()
        raise OSError(
            None,
            f"this machine has no display for a window ({error}): `passive-walker video` and "
            "RecordVideo need none; SDL_VIDEODRIVER=dummy draws without one",
        ) from None
    window = pygame.display.set_mode(size)
    pygame.display.set_caption("passive walker")
    return window


class Screen:
    """Draws one walker, frame by frame; the camera goes along with the hip.

    The slope is as steep as it is. Marks on the ground stand a quarter of a leg length apart, and
    long ones with a number one leg length l. Each leg keeps its colour through heelstrikes if
    `draw` is told how many there were. Pale ghosts stand where the walker was; an arrow about the
    hip is the motor's torque, longer as it is larger; what of the swing foot is below the ground,
    where the model lets it pass, is drawn in the colour of warnings; a push is an arrow from the
    hip that fades over some frames.

    As "rgb_array" it needs no display and opens no window. As "human" it opens one, and keeps the
    pace of `fps`; once its user has closed it, frames are no longer drawn.

    Args:
        walker: The walker, in a form that `as_walker` takes.
        mode: "human" or "rgb_array".
        fps: Frames per second of a window; 0 shows frames as fast as they come.
        size: Width and height of a frame in pixels; even numbers, for films.

    Raises:
        ValueError: if the mode is not known, or the size is not positive.
        ImportError: if pygame is not installed.
    """

    def __init__(
        self,
        walker: WalkerLike,
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
        self._pygame = pygame = load_pygame()
        self._canvas = pygame.Surface((_OVERSAMPLING * size[0], _OVERSAMPLING * size[1]), depth=32)
        scale = _LEG_SHARE * self._canvas.get_height()
        self._brush = Brush(pygame, self._canvas, scale, self.walker.leg_length)
        self._trail: deque[tuple[Pose, int]] = deque(maxlen=_GHOSTS)
        self._push, self._since = np.zeros(2), _FRAMES
        self._window: Any = None
        self._clock: Any = None
        self._open = True

    def draw(
        self,
        state: ArrayLike,
        slope: float,
        contact_x: float = 0.0,
        strides: int = 0,
        *,
        contact_y: float = 0.0,
        tilt: float = 0.0,
        torque: float = 0.0,
        push: float = 0.0,
        notes: tuple[Sequence[str], Sequence[str]] = ((), ()),
        warning: str = "",
        profile: ArrayLike | None = None,
    ) -> NDArray[np.uint8] | None:
        """Draw one frame.

        Args:
            state: [stance, thigh, shank] angles in rad and their rates, shape (6,).
            slope: Slope in rad, positive downhill.
            contact_x: Where the stance foot touches the ground, along the slope.
            strides: Heelstrikes so far: the legs change roles, not colours.
            contact_y: Height of the contact over the slope.
            tilt: By how much the ground there slopes more steeply; angles are from its normal.
            torque: Hip torque as a share of the largest, from -1 to 1.
            push: What has just pushed the hip along the ground, downhill, as a share of the
                largest, from -1 to 1.
            notes: Lines of text for the upper left and the upper right corner.
            warning: A line below those on the left that is not to be overlooked.
            profile: The ground as points (x, y) along and off the slope, shape (n, 2), x rising;
                None is the slope itself.

        Returns:
            The frame, uint8 of shape (height, width, 3), as "rgb_array"; nothing as "human".

        Raises:
            ValueError: if the state has another shape or is not finite.
            OSError: if the machine has no display for a window.
        """
        if not self._open:
            return None
        if np.shape(state) != (6,):
            raise ValueError(f"a frame shows one state of shape (6,), not {np.shape(state)}")
        brush, posture = self._brush, pose(self.walker, state, contact_x, contact_y, tilt)
        ground = _LEVEL if profile is None else np.asarray(profile, dtype=float)
        self._look_at(posture, slope, ground)
        self._canvas.fill(look.SKY)
        self._follow(posture, strides)
        hip = brush.at(posture.hip)
        near, far = legs_by_identity(posture, strides)
        self._leg(hip, far, look.LEGS[1])
        self._leg(hip, near, look.LEGS[0])
        brush.disc(hip, 0.050, look.HIP)
        brush.disc(hip, 0.018, look.SKY)
        brush.turn(hip, 0.17, 1.9 * torque, look.TORQUE)
        if push:
            along = push * np.array([math.cos(tilt), -math.sin(tilt)])
            self._push, self._since = along * _PUSH * self.walker.leg_length, 0
        self._pushed(posture.hip)
        self._ground(ground)
        self._scuff(posture.swing, ground)
        self._write(notes, warning)
        frame = self._pygame.transform.smoothscale(self._canvas, self.size)
        if self.mode == "rgb_array":
            pixels = bytearray(self._pygame.image.tobytes(frame, "RGB"))
            return np.frombuffer(pixels, np.uint8).reshape(self.size[1], self.size[0], 3)
        self._show(frame)
        return None

    @property
    def seen(self) -> float:
        """How far from its middle a frame shows the ground, corners and all, in lengths of x."""
        pixels = 0.6 * math.hypot(*self._canvas.get_size())
        return pixels / self._brush.scale * self.walker.leg_length

    def hip_on_frame(self, state: ArrayLike, slope: float) -> tuple[float, float]:
        """Where a frame shows the hip, in pixels from its upper left corner."""
        posture = pose(self.walker, state)
        self._look_at(posture, slope, _LEVEL)
        x, y = self._brush.at(posture.hip) / _OVERSAMPLING
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
            self._window = open_window(pygame, self.size)
            self._clock = pygame.time.Clock()
        self._window.blit(frame, (0, 0))
        pygame.display.flip()
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
        elif self.fps:
            self._clock.tick(self.fps)

    def _look_at(self, posture: Pose, slope: float, ground: NDArray) -> None:
        """Let the camera go along with the hip, at the height of the ground around."""
        wide, high = self._canvas.get_size()
        around = posture.hip[0] + self.walker.leg_length * _VIEW
        camera = np.array([posture.hip[0], height(ground, around).mean()])
        self._brush.look_at(camera, slope, (0.5 * wide, (1.0 - _GROUND_SHARE) * high))

    def _follow(self, posture: Pose, strides: int) -> None:
        """Draw the ghosts of a walk, and keep the posture as one of them if it is far enough on.

        Where the walker jumps, as at a reset, another walk begins.
        """
        length = self.walker.leg_length
        if self._trail:
            last, before = self._trail[-1]
            ahead = (posture.hip[0] - last.hip[0]) / length
            if strides < before or not -_GHOST_APART < ahead < 2.0:
                self._trail.clear()
                self._since = _FRAMES
        for age, (ghost, struck) in enumerate(reversed(self._trail)):
            paleness = 0.62 + 0.30 * age / _GHOSTS
            if posture.hip[0] - ghost.hip[0] < 0.5 * _GHOST_APART * length:
                continue  # as good as the walker itself
            near, far = legs_by_identity(ghost, struck)
            for leg, colour in ((far, look.LEGS[1]), (near, look.LEGS[0])):
                places = self._brush.at(np.array([ghost.hip, leg.knee, leg.tip]))
                self._brush.line(places, 0.010, look.shaded(colour, look.SKY, paleness))
        if not self._trail or ahead > _GHOST_APART:
            self._trail.append((posture, strides))

    def _pushed(self, hip: NDArray) -> None:
        """The last push, until it has faded."""
        if self._since < _FRAMES:
            start = self._brush.at(hip)
            colour = look.shaded(look.PUSH, look.SKY, self._since / _FRAMES)
            self._brush.arrow(start, self._brush.at(hip + self._push) - start, colour)
            self._since += 1

    def _leg(self, hip: NDArray, leg: Leg, colour: look.Colour) -> None:
        """Thigh, shank and foot."""
        brush = self._brush
        instep = leg.foot + 0.45 * (leg.tip - leg.foot)
        knee, instep, tip = (brush.at(place) for place in (leg.knee, instep, leg.tip))
        dark = look.shaded(colour, look.HIP, 0.45)
        brush.limb(hip, knee, 0.034, 0.026, colour)
        brush.limb(knee, instep + 0.5 * (tip - instep), 0.026, 0.017, colour)
        if self.walker.foot_radius > 0.0:
            sole = brush.at(leg.sole)
            brush.polygon([*sole, instep], colour)
            brush.line(sole, 0.006, dark)
        else:
            brush.disc(tip, 0.024, dark)
        if self.walker.knees:
            brush.disc(knee, 0.016, dark)

    def _ground(self, profile: NDArray) -> None:
        """The ground, with marks that pass by as the walker goes, and numbers: the scale.

        Args:
            profile: Points (x, y) along and off the slope, (n, 2); level beyond both ends.
        """
        brush, length, seen = self._brush, self.walker.leg_length, self.seen
        middle, floor = brush.camera
        ends = middle + seen * np.array([-1.0, 1.0])
        surface = brush.at(between(profile, *ends))
        deep = brush.at(np.column_stack([ends[::-1], [floor - seen] * 2]))
        brush.polygon([*surface, *deep], look.GROUND)
        pitch = length / _MARKS
        for index in range(math.ceil(ends[0] / pitch), math.ceil(ends[1] / pitch)):
            numbered = index % _MARKS == 0
            top = np.array([index * pitch, height(profile, index * pitch)])
            mark = brush.at([top, top - [0.0, (0.07 if numbered else 0.035) * length]])
            brush.line(mark, 0.003, look.GROUND_LINE)
            if numbered:
                brush.write(
                    f"{index // _MARKS} l", mark[1] + [0.0, 0.012 * self._canvas.get_height()]
                )
        brush.line(surface, 0.005, look.GROUND_LINE)

    def _scuff(self, leg: Leg, profile: NDArray) -> None:
        """Mark what of the swing foot is below the ground, where the model lets it pass."""
        depth = height(profile, leg.sole[:, 0]) - leg.sole[:, 1]
        if depth.max() > _SCUFF * self.walker.leg_length:
            below = self._brush.at(leg.sole[depth > 0.0])
            self._brush.line(np.atleast_2d(below), 0.008, look.WARNING)
            self._brush.disc(self._brush.at(leg.sole[np.argmax(depth)]), 0.012, look.WARNING)
            right, down = below.mean(axis=0)
            place = right, down + 0.15 * self._brush.scale  # below the marks
            self._brush.write("foot scuffs", place, "midtop", look.WARNING)

    def _write(self, notes: tuple[Sequence[str], Sequence[str]], warning: str) -> None:
        """Lettering in the upper corners."""
        width, edge = self._canvas.get_width(), 0.03 * self._canvas.get_height()
        for lines, across, anchor in (
            (notes[0], edge, "topleft"),
            (notes[1], width - edge, "topright"),
        ):
            down = edge
            for line in lines:
                down += 1.15 * self._brush.write(line, (across, down), anchor, look.HIP)
            if anchor == "topleft" and warning:
                self._brush.write(warning, (across, down), anchor, look.WARNING)
