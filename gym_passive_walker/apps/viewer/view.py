"""The window's picture: the walker, its phase portrait and Floquet multipliers, sliders, keys."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pygame
from pygame import Rect, Surface

from gym_passive_walker.apps.viewer.player import KEYS, SCENE, WINDOW_SIZE, Player
from gym_passive_walker.apps.viewer.sliders import KNOB, PANEL
from gym_passive_walker.apps.viewer.walk import LiveWalk
from gym_passive_walker.gaits.gait import Gait
from gym_passive_walker.models.walkers import WALKERS, Mechanism
from gym_passive_walker.pictures import colours
from gym_passive_walker.pictures.brush import Brush
from gym_passive_walker.pictures.panels import draw_multipliers, draw_portrait
from gym_passive_walker.pictures.screen import Screen

PORTRAIT = Rect(0, 450, 420, 270)
GAIT = Rect(420, 450, 380, 270)
LEGEND = Rect(800, 560, 480, 160)

_LINE = 20  # pixels from line to line


class View:
    """Draws what a player shows."""

    def __init__(self) -> None:
        self._brush = Brush(pygame, Surface(WINDOW_SIZE), lettering=18)
        self._brush.open_fonts()
        self._screen: Screen | None = None

    def draw(self, player: Player) -> Surface:
        """Draw what the player shows now, and return the picture."""
        brush, walk = self._brush, player.walk
        brush.canvas.fill(colours.SKY)
        self._draw_scene(player)
        strides, free, states = zip(*walk.trail, strict=True)
        legs = not isinstance(walk.setup.walker, Mechanism)
        draw_portrait(brush, PORTRAIT, states, strides, free, legs=legs)
        _draw_gait(brush, walk, *player.gait)
        _draw_sliders(brush, player)
        for index, (key, does) in enumerate(KEYS):
            column, line = divmod(index, 6)
            x, y = LEGEND.left + 12 + 240 * column, LEGEND.top + 12 + _LINE * line
            brush.write(key, (x, y), "topleft", colours.HIP)
            brush.write(does, (x + 96, y), "topleft")
        for box in (PORTRAIT, GAIT, PANEL, LEGEND):
            pygame.draw.rect(brush.canvas, colours.GROUND, box, 1)
        return brush.canvas

    def _draw_scene(self, player: Player) -> None:
        """Draw the walker on its slope, the push that is being drawn, and the state of the walk."""
        brush, walk, setup = self._brush, player.walk, player.walk.setup
        if self._screen is None or self._screen.walker != setup.walker:
            self._screen = Screen(setup.walker, size=SCENE.size)
        notes = ["paused"] * player.paused
        if player.pace != 1.0:
            notes.append(f"pace {Fraction(player.pace)}")
        if player.video is not None:
            notes.append(f"recording {player.video.path.name}")
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
            brush.arrow(hip, player.drag * [1.0, -1.0], colours.HIP, 2.5)


def _draw_sliders(brush: Brush, player: Player) -> None:
    """Draw the sliders, marking the one that keys move, and the message below them."""
    names, walker = {preset: name for name, preset in WALKERS.items()}, player.walk.setup.walker
    title = f"walker {names.get(walker, 'changed')}"
    if isinstance(walker, Mechanism):
        title = f"system {walker.title}"
    if player.walk.map.controlled:
        title += f", controller {player.walk.map.controller_name}"
    brush.write(title, (PANEL.left + 12, 8), "topleft", colours.HIP, size=22)
    for slider in player.sliders:
        row, selected = slider.row, slider is player.sliders[player.selected]
        if selected:
            pygame.draw.rect(brush.canvas, colours.GROUND, row.inflate(-8, -2), border_radius=4)
        colour = colours.SKY if selected else colours.GROUND
        pygame.draw.rect(brush.canvas, colour, slider.track, border_radius=2)
        brush.disc(np.array(slider.knob(player.walk)), KNOB, colours.LEGS[0])
        brush.write(slider.label, (row.left + 12, row.centery), "midleft", colours.HIP)
        value = f"{slider.read(player.walk):.5g}".replace("-", "−")
        brush.write(value, (row.right - 14, row.centery), "midright", colours.HIP)
    place, width = (PANEL.left + 12, PANEL.bottom - 10), PANEL.width - 24
    brush.write(player.message, place, "bottomleft", colours.HIP, width=width)


def _draw_gait(brush: Brush, walk: LiveWalk, gait: Gait | None, known: bool) -> None:
    """Draw the Floquet multipliers of a walk's periodic gait, and the measures of its last stride.

    While the search continues, the multipliers are those of the gait before, and pale.
    """
    square, strides = Rect(GAIT.left + 12, GAIT.top + 38, 190, 190), walk.map
    owner = "the passive gait" if strides.passive else "the gait under this torque"
    if strides.controlled:
        owner = f"the gait under {strides.controller_name}"
    title, corner = f"Floquet multipliers of {owner}", (GAIT.left + 10, GAIT.top + 9)
    brush.write(title, corner, "topleft", colours.HIP)
    values = np.empty(0, complex) if gait is None else np.asarray(gait.multipliers)
    draw_multipliers(brush, square, values, pale=not known)
    if not known:
        verdict, colour = "searching", colours.GROUND_LINE
    elif gait is None:
        verdict, colour = "no gait found", colours.WARNING
    elif gait.stable:
        verdict, colour = "stable", colours.LEGS[0]
    else:
        verdict, colour = "unstable (ring)", colours.WARNING
    x = square.right + 16
    brush.write(verdict, (x, square.top), "topleft", colour)
    pairs = [value for value in values if value.imag >= 0.0] if known else []
    for line, value in enumerate(pairs, 1):
        text = f"{value.real:z.3f}".replace("-", "−") + f" ± {value.imag:.3f} i" * bool(value.imag)
        brush.write(text, (x, square.top + _LINE * line), "topleft", colours.HIP)
    measures = ["was disturbed" if walk.strides else "none yet"]
    if walk.last is not None:
        length, period, cost = walk.last
        measures = [
            f"speed {length / period:.4f} √(g l)",
            f"length {length:.4f} l",
            f"period {period:.4f} √(l/g)",
            f"cost of transport {cost:.4f}",
        ]
    for line, text in enumerate(["last stride", *measures]):
        place = x, square.bottom + _LINE * (line - len(measures))
        brush.write(text, place, "topleft", colours.GROUND_LINE if line else colours.HIP)
