"""The window's picture: the walker, its phase portrait and Floquet multipliers, sliders, keys."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pygame
from pygame import Rect, Surface

from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.render import look
from gym_passive_walker.render.brush import Brush
from gym_passive_walker.render.screen import Screen
from gym_passive_walker.viewer.gait_search import Found
from gym_passive_walker.viewer.player import KEYS, SCENE, SIZE, Player
from gym_passive_walker.viewer.sliders import KNOB, PANEL
from gym_passive_walker.viewer.walk import LiveWalk, Sample

PORTRAIT = Rect(0, 450, 420, 270)
MULTIPLIERS = Rect(420, 450, 380, 270)
LEGEND = Rect(800, 560, 480, 160)

_LINE = 20  # pixels from line to line
_SPANS = (0.2, 0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0)  # of an axis
_FADED = 0.45  # share of the background in the colour of a shank


class View:
    """Draws what a player shows."""

    def __init__(self) -> None:
        self._brush = Brush(pygame, Surface(SIZE), lettering=18)
        self._screen: Screen | None = None

    def draw(self, player: Player) -> Surface:
        """Draw what the player shows now, and return the picture."""
        brush, walk = self._brush, player.walk
        brush.begin()
        brush.canvas.fill(look.SKY)
        self._draw_scene(player)
        _draw_portrait(brush, walk)
        _draw_multipliers(brush, walk, player.found)
        _draw_sliders(brush, player)
        for index, (key, does) in enumerate(KEYS):
            column, line = divmod(index, 6)
            x, y = LEGEND.left + 12 + 240 * column, LEGEND.top + 12 + _LINE * line
            brush.write(key, (x, y), "topleft", look.HIP)
            brush.write(does, (x + 96, y), "topleft")
        for box in (PORTRAIT, MULTIPLIERS, PANEL, LEGEND):
            pygame.draw.rect(brush.canvas, look.GROUND, box, 1)
        return brush.canvas

    def _draw_scene(self, player: Player) -> None:
        """Draw the walker on its slope, the push that is being drawn, and the state of the walk."""
        brush, walk, setup = self._brush, player.walk, player.walk.setup
        if self._screen is None or self._screen.walker != setup.walker:
            self._screen = Screen(setup.walker, size=SCENE.size)
        notes = ["paused"] * player.paused
        if player.pace != 1.0:
            notes.append(f"pace {Fraction(player.pace)}")
        if player.film is not None:
            notes.append(f"recording {player.film.path.name}")
        if player.drag is not None:
            downhill, up = player.impulse
            notes.append(f"push {downhill:+.3f} downhill, {up:+.3f} up, in m √(g l)")
        frame = self._screen.draw(
            walk.state, setup.slope, walk.contact, walk.strides,
            notes=(notes, ()), warning=player.ended,
        )  # fmt: skip
        brush.canvas.blit(pygame.image.frombuffer(frame, SCENE.size, "RGB"), SCENE)  # type: ignore[arg-type]
        if player.drag is not None:
            hip = np.array(self._screen.hip_on_frame(walk.state, setup.slope))
            brush.arrow(hip, player.drag * [1.0, -1.0], look.HIP, 2.5)


def _draw_sliders(brush: Brush, player: Player) -> None:
    """Draw the sliders, marking the one that keys move, and the message below them."""
    policy = player.walk.map.controller_name if player.walk.map.controlled else ""
    title = f"walker {player.name}" + f", {policy} at the motors" * bool(policy)
    brush.write(title, (PANEL.left + 12, 8), "topleft", look.HIP, size=22)
    for slider in player.sliders:
        row, selected = slider.row, slider is player.sliders[player.selected]
        if selected:
            pygame.draw.rect(brush.canvas, look.GROUND, row.inflate(-8, -2), border_radius=4)
        colour = look.SKY if selected else look.GROUND
        pygame.draw.rect(brush.canvas, colour, slider.track, border_radius=2)
        brush.disc(np.array(slider.knob(player.walk)), KNOB, look.LEGS[0])
        brush.write(slider.label, (row.left + 12, row.centery), "midleft", look.HIP)
        value = f"{slider.read(player.walk):.5g}".replace("-", "−")
        brush.write(value, (row.right - 14, row.centery), "midright", look.HIP)
    place, width = (PANEL.left + 12, PANEL.bottom - 10), PANEL.width - 24
    brush.write(player.message, place, "bottomleft", look.HIP, width=width)


def _draw_portrait(brush: Brush, walk: LiveWalk) -> None:
    """Draw angular velocities over angles, each leg in its colour; impacts leave gaps."""
    box, trail, knees = PORTRAIT, list(walk.trail), walk.setup.walker.knees
    title = "phase portrait" + " (thin: free shank)" * knees
    brush.write(title, (box.left + 10, box.top + 9), "topleft", look.HIP)
    plot = Rect(box.left + 44, box.top + 34, box.width - 60, box.height - 64)
    states = np.array([sample.state for sample in trail]).reshape(-1, 2, 3)
    angle, rate = (_rounded_up(float(np.abs(part).max())) for part in states.swapaxes(0, 1))
    _draw_cross(brush, plot)
    pygame.draw.rect(brush.canvas, look.GROUND, plot, 1)
    for text, place, anchor in (
        (f"−{angle:g}", (plot.left, plot.bottom + 6), "midtop"),
        ("angle (rad)", (plot.centerx, plot.bottom + 6), "midtop"),
        (f"{angle:g}", (plot.right, plot.bottom + 6), "midtop"),
        (f"−{rate:g}", (plot.left - 6, plot.bottom), "midright"),
        (f"{rate:g}", (plot.left - 6, plot.top), "midright"),
        ("angular velocity × √(l/g)", (plot.right, plot.top - 6), "bottomright"),
    ):
        brush.write(text, place, anchor)
    half = 0.5 * np.array([plot.width, -plot.height])
    pixels = plot.center + half * (states.swapaxes(1, 2) / [angle, rate])  # of each link, (n, 3, 2)
    new = [i for i, (before, after) in enumerate(pairwise(trail), 1) if before[:2] != after[:2]]
    for first, last in pairwise([0, *new, len(trail)]):
        for link, colour in _links(trail[first], knees):
            if last - first > 1:
                line = pixels[first:last, link]
                pygame.draw.aalines(brush.canvas, colour, False, line)
                if link != 2:  # a shank's line is thin
                    pygame.draw.aalines(brush.canvas, colour, False, line + 0.7)
    for link, colour in _links(trail[-1], knees):
        pygame.draw.aacircle(brush.canvas, colour, pixels[-1, link], 5, 2 * (link == 2))


def _links(sample: Sample, knees: bool) -> Iterator[tuple[int, look.Colour]]:
    """The links that move independently, and their colours: legs keep theirs at heelstrike."""
    stance, swing = look.LEGS[sample.strides % 2], look.LEGS[1 - sample.strides % 2]
    if knees and sample.phase == 0:
        yield 2, look.shaded(swing, look.SKY, _FADED)
    yield 1, swing
    yield 0, stance


def _rounded_up(value: float) -> float:
    """The next round number for the end of an axis."""
    return next((span for span in _SPANS if span >= value), value)


def _draw_cross(brush: Brush, box: Rect) -> None:
    """Draw axes through the centre of a box."""
    pygame.draw.line(brush.canvas, look.GROUND, box.midtop, box.midbottom)
    pygame.draw.line(brush.canvas, look.GROUND, box.midleft, box.midright)


def _draw_multipliers(brush: Brush, walk: LiveWalk, found: Found | None) -> None:
    """Draw the Floquet multipliers of the walk's gait, and write the measures of its last stride.

    While the search continues, the multipliers of the gait before are drawn in the ground's colour.
    """
    box, setup, values = MULTIPLIERS, walk.setup, np.empty(0, complex)
    gait, known = (None, False) if found is None else (found.gait, found.setup == setup)
    owner = "the passive gait" if setup.controller == 0.0 else "the gait under this torque"
    if walk.map.controlled:
        owner = f"the gait under {walk.map.controller_name}"
    brush.write(
        f"Floquet multipliers of {owner}", (box.left + 10, box.top + 9), "topleft", look.HIP
    )
    if gait is not None:
        values = gait.multipliers
    circle = Rect(box.left + 12, box.top + 38, 190, 190)
    scale = 0.5 * circle.width / (1.15 * float(np.abs(values).max(initial=1.0)))
    _draw_cross(brush, circle)
    pygame.draw.aacircle(brush.canvas, look.GROUND_LINE, circle.center, scale, 1)
    for value in values:
        outside = abs(value) >= 1.0
        colour = look.GROUND if not known else look.WARNING if outside else look.LEGS[0]
        place = circle.centerx + scale * value.real, circle.centery - scale * value.imag
        pygame.draw.aacircle(brush.canvas, colour, place, 6, 2 * outside)
    brush.write("unit circle", (circle.centerx, circle.bottom + 6))
    x, (verdict, colour) = circle.right + 16, _verdict(gait, known)
    brush.write(verdict, (x, circle.top), "topleft", colour)
    upper = [value for value in values if value.imag >= 0.0] if known else []
    for line, value in enumerate(upper, 1):
        pair = f" ± {value.imag:.3f} i" if value.imag else ""
        text = f"{value.real:z.3f}".replace("-", "−") + pair
        brush.write(text, (x, circle.top + _LINE * line), "topleft", look.HIP)
    measures = _measures(walk)
    for line, text in enumerate(["last stride", *measures]):
        place = x, circle.bottom + _LINE * (line - len(measures))
        brush.write(text, place, "topleft", look.GROUND_LINE if line else look.HIP)


def _verdict(gait: Gait | None, known: bool) -> tuple[str, look.Colour]:
    """What the search says of the gait, and in which colour."""
    if not known:
        return "searching", look.GROUND_LINE
    if gait is None:
        return "no gait found", look.WARNING
    return ("stable", look.LEGS[0]) if gait.stable else ("unstable (ring)", look.WARNING)


def _measures(walk: LiveWalk) -> list[str]:
    """The measures of the last stride, a line each."""
    if walk.last is None:
        return ["was disturbed" if walk.strides else "none yet"]
    length, period, cost = walk.last
    return [
        f"speed {length / period:.4f} √(g l)",
        f"length {length:.4f} l",
        f"period {period:.4f} √(l/g)",
        f"cost of transport {cost:.4f}",
    ]
