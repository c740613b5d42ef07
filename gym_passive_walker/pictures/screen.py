"""Frames of a walker in motion, for a window or a video, drawn with pygame."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.extras import extra
from gym_passive_walker.models.walkers import WalkerLike, as_walker
from gym_passive_walker.pictures import colours
from gym_passive_walker.pictures.brush import Brush
from gym_passive_walker.pictures.ground import height, part_between
from gym_passive_walker.pictures.pose import Leg, Pose, legs_by_identity, pose

if TYPE_CHECKING:
    from types import ModuleType

MODES = ("human", "rgb_array")

_OVERSAMPLING = 2  # frames are drawn this much larger, then shrunk, for smooth edges
_LEG_SHARE = 0.62  # leg length as a share of the frame's height
_TALLEST = 0.76  # the same of a system, which may be taller than its legs, as it starts
_GROUND_SHARE = 0.17  # height of the ground in the frame, as a share, under the hip
_MARKS = 4  # on the ground, per leg length
_GHOSTS, _GHOST_APART = 5, 0.22  # number, and distance of their hips in leg lengths
_LEVEL = np.array([[-1.0, 0.0], [1.0, 0.0]])  # smooth ground: the slope itself
_VIEW = np.linspace(-0.75, 0.75, 31)  # leg lengths: range that gives the camera's mean height
_PUSH, _FRAMES = 0.45, 8  # length of the largest push's arrow in leg lengths; frames it lasts
_SCUFF = 1e-3  # smallest depth in leg lengths that is drawn as scuffing


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
    """Draws one walker, frame by frame; the camera follows the hip.

    The slope has its true angle. Marks on the ground are a quarter of a leg length apart; long
    marks with a number are one leg length l apart. Each leg keeps its colour through heelstrikes if
    `draw` receives their number. Pale ghosts show earlier postures. An arrow around the hip shows
    the hip torque, longer for a larger torque. The part of the swing foot below the ground, which
    the model permits, is drawn in the warning colour. A push is an arrow from the hip that fades
    over some frames. A `System` has no ghosts, no arrow of a torque and no mark of scuffing, and a
    push of it is an arrow from its centre of mass.

    With "rgb_array" no display is needed and no window opens. With "human" a window opens and shows
    `fps` frames per second; after the user has closed it, frames are no longer drawn.

    Args:
        walker: The walker, in a form that `as_walker` takes, or a `System`.
        mode: "human" or "rgb_array".
        fps: Frames per second of a window; 0 shows frames without delay.
        size: Width and height of a frame in pixels; a video requires even numbers.

    Raises:
        ValueError: if the mode is unknown, the size is not positive or `fps` is not finite.
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
        self.walker: Any = as_walker(walker)
        self.mode, self.fps, self.size = mode, fps, size
        self._pygame = pygame = load_pygame()
        self._canvas = pygame.Surface((_OVERSAMPLING * size[0], _OVERSAMPLING * size[1]), depth=32)
        share = _LEG_SHARE
        if "legs" not in self.walker.supports:
            start = self.walker.start or np.zeros(self.walker.size)
            places = np.concatenate(self.walker.drawn(start))
            share = min(share, _TALLEST / max(float(places[:, 1].max()), 1e-3))
        scale = share * self._canvas.get_height()
        self._brush = Brush(pygame, self._canvas, scale, self.walker.leg_length)
        self._trail: deque[tuple[Pose, int]] = deque(maxlen=_GHOSTS)
        self._push, self._since = np.zeros(2), _FRAMES
        self._last = 0.0, 0  # place and heelstrikes of the last frame
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
            state: [stance, thigh, shank] angles in rad and their angular velocities, shape (6,);
                of a `System` its coordinates and their rates.
            slope: Slope in rad, positive downhill.
            contact_x: Contact point of the stance foot along the slope, in the walker's units.
            strides: Number of heelstrikes so far; the legs change roles, not colours.
            contact_y: Height of the contact point over the slope, in the walker's units.
            tilt: Slope of the ground at the contact beyond the slope that is walked, in rad; angles
                are measured from the normal of that ground. A `System` has none.
            torque: Hip torque as a share of the largest, from -1 to 1; ignored for a `System`.
            push: Impulse on the hip, of a `System` on its centre of mass, that has just acted along
                the ground, as a share of the largest, from -1 to 1; positive downhill.
            notes: Lines of text for the upper left and the upper right corner.
            warning: A line in the warning colour below those on the left.
            profile: The ground as points (x, y) along and off the slope, shape (n, 2), with x
                increasing; None is the slope itself.

        Returns:
            The frame, uint8 of shape (height, width, 3), with "rgb_array"; None with "human".

        Raises:
            ValueError: if the state has another shape or is not finite.
            OSError: if the machine has no display for a window.
        """
        if not self._open:
            return None
        if np.shape(state) != (size := (self.walker.size,)):
            raise ValueError(f"a frame shows one state of shape {size}, not {np.shape(state)}")
        ground = _LEVEL if profile is None else np.asarray(profile, dtype=float)
        foot, walker = np.array([contact_x, contact_y]), self.walker.in_stride(strides)
        posture = None
        if "legs" in walker.supports:
            posture = pose(walker, state, contact_x, contact_y, tilt)
            centre = posture.hip
        else:
            centre = foot + walker.centre_of_mass(np.asarray(state))
        self._look_at(centre, slope, ground)
        self._begin(centre[0], strides)
        if posture is not None:
            self._draw_legs(posture, strides, torque)
        else:
            self._draw_lines([foot + line for line in walker.drawn(state)])
        self._pushed(centre, push, tilt)
        self._ground(ground)
        if posture is not None:
            self._scuff(posture.swing, ground)
        self._write(notes, warning)
        frame = self._pygame.transform.smoothscale(self._canvas, self.size)
        if self.mode == "rgb_array":
            pixels = bytearray(self._pygame.image.tobytes(frame, "RGB"))
            return np.frombuffer(pixels, np.uint8).reshape(self.size[1], self.size[0], 3)
        self._show(frame)
        return None

    def _draw_legs(self, posture: Pose, strides: int, torque: float) -> None:
        """Draw a walker by its legs and hip, with the hip torque and the ghosts of its walk."""
        self._follow(posture, strides)
        brush, hip = self._brush, self._brush.at(posture.hip)
        near, far = legs_by_identity(posture, strides)
        self._leg(hip, far, colours.LEGS[1])
        self._leg(hip, near, colours.LEGS[0])
        brush.disc(hip, 0.050, colours.HIP)
        brush.disc(hip, 0.018, colours.SKY)
        brush.turn(hip, 0.17, 1.9 * torque, colours.TORQUE)

    def _draw_lines(self, lines: list[NDArray]) -> None:
        """Draw a system by its lines of points."""
        brush = self._brush
        for number, line in enumerate(lines):
            places = brush.at(line)
            brush.line(places, 0.026, colours.LEGS[number % len(colours.LEGS)])
            for place in places:
                brush.disc(place, 0.034, colours.HIP)

    @property
    def seen(self) -> float:
        """Distance from a frame's middle to its farthest visible ground, in the walker's units."""
        pixels = 0.6 * math.hypot(*self._canvas.get_size())
        return pixels / self._brush.scale * self.walker.leg_length

    def close(self) -> None:
        """Close the window, if there is one. A closed screen draws nothing."""
        if self._window is not None:
            self._pygame.display.quit()
        self._window, self._open = None, False

    def _show(self, frame: Any) -> None:
        """Show a frame in the window, and wait so that `fps` is not exceeded."""
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

    def _look_at(self, place: NDArray, slope: float, ground: NDArray) -> None:
        """Move the camera to a place, at the mean height of the ground around; clear the frame."""
        wide, high = self._canvas.get_size()
        around = place[0] + self.walker.leg_length * _VIEW
        camera = np.array([place[0], height(ground, around).mean()])
        self._brush.look_at(camera, slope, (0.5 * wide, (1.0 - _GROUND_SHARE) * high))
        self._canvas.fill(colours.SKY)

    def _begin(self, x: float, strides: int) -> None:
        """Remove ghosts and the arrow of a push if the walker jumps, as at a reset."""
        before, struck = self._last
        if strides < struck or not -_GHOST_APART < (x - before) / self.walker.leg_length < 2.0:
            self._trail.clear()
            self._since = _FRAMES
        self._last = x, strides

    def _follow(self, posture: Pose, strides: int) -> None:
        """Draw the ghosts of a walk, and record the posture as one if it is far enough ahead."""
        apart = _GHOST_APART * self.walker.leg_length
        for age, (ghost, struck) in enumerate(reversed(self._trail)):
            paleness = 0.62 + 0.30 * age / _GHOSTS
            if posture.hip[0] - ghost.hip[0] < 0.5 * apart:
                continue  # the walker would cover it
            near, far = legs_by_identity(ghost, struck)
            for leg, colour in ((far, colours.LEGS[1]), (near, colours.LEGS[0])):
                places = self._brush.at(np.array([ghost.hip, leg.knee, leg.tip]))
                self._brush.line(places, 0.010, colours.shaded(colour, colours.SKY, paleness))
        if not self._trail or posture.hip[0] - self._trail[-1][0].hip[0] > apart:
            self._trail.append((posture, strides))

    def _pushed(self, place: NDArray, push: float, tilt: float) -> None:
        """Draw the last push at a place, until it has faded."""
        if push:
            along = push * np.array([math.cos(tilt), -math.sin(tilt)])
            self._push, self._since = along * _PUSH * self.walker.leg_length, 0
        if self._since < _FRAMES:
            start = self._brush.at(place)
            colour = colours.shaded(colours.PUSH, colours.SKY, self._since / _FRAMES)
            self._brush.arrow(start, self._brush.at(place + self._push) - start, colour)
            self._since += 1

    def _leg(self, hip: NDArray, leg: Leg, colour: colours.Colour) -> None:
        """Draw thigh, shank and foot."""
        brush = self._brush
        instep = leg.foot + 0.45 * (leg.tip - leg.foot)
        knee, instep, tip = (brush.at(place) for place in (leg.knee, instep, leg.tip))
        dark = colours.shaded(colour, colours.HIP, 0.45)
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
        """Draw the ground, with marks and numbers that show the scale.

        Args:
            profile: Points (x, y) along and off the slope, shape (n, 2); level beyond both ends.
        """
        brush, length, seen = self._brush, self.walker.leg_length, self.seen
        middle, floor = brush.camera
        ends = middle + seen * np.array([-1.0, 1.0])
        surface = brush.at(part_between(profile, *ends))
        deep = brush.at(np.column_stack([ends[::-1], [floor - seen] * 2]))
        brush.polygon([*surface, *deep], colours.GROUND)
        pitch = length / _MARKS
        for index in range(math.ceil(ends[0] / pitch), math.ceil(ends[1] / pitch)):
            numbered = index % _MARKS == 0
            top = np.array([index * pitch, height(profile, index * pitch)])
            mark = brush.at([top, top - [0.0, (0.07 if numbered else 0.035) * length]])
            brush.line(mark, 0.003, colours.GROUND_LINE)
            if numbered:
                brush.write(
                    f"{index // _MARKS} l", mark[1] + [0.0, 0.012 * self._canvas.get_height()]
                )
        brush.line(surface, 0.005, colours.GROUND_LINE)

    def _scuff(self, leg: Leg, profile: NDArray) -> None:
        """Mark the part of the swing foot below the ground, which the model permits."""
        depth = height(profile, leg.sole[:, 0]) - leg.sole[:, 1]
        if depth.max() > _SCUFF * self.walker.leg_length:
            below = self._brush.at(leg.sole[depth > 0.0])
            self._brush.line(np.atleast_2d(below), 0.008, colours.WARNING)
            self._brush.disc(self._brush.at(leg.sole[np.argmax(depth)]), 0.012, colours.WARNING)
            right, down = below.mean(axis=0)
            place = right, down + 0.15 * self._brush.scale  # below the marks
            self._brush.write("foot scuffs", place, "midtop", colours.WARNING)

    def _write(self, notes: tuple[Sequence[str], Sequence[str]], warning: str) -> None:
        """Write the text in the upper corners."""
        width, edge = self._canvas.get_width(), 0.03 * self._canvas.get_height()
        for lines, across, anchor in (
            (notes[0], edge, "topleft"),
            (notes[1], width - edge, "topright"),
        ):
            down = edge
            for line in lines:
                down += 1.15 * self._brush.write(line, (across, down), anchor, colours.HIP)
            if anchor == "topleft" and warning:
                self._brush.write(warning, (across, down), anchor, colours.WARNING)
