"""Panels beside a walker in motion, drawn with pygame: phase portrait and Floquet multipliers.

`plots` draws both with matplotlib, at rest; these are drawn in each frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker.pictures import colours
from gym_passive_walker.pictures.brush import Brush

_SPANS = (0.2, 0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0)  # of an axis
_FADED = 0.45  # share of the background in the colour of a shank


def draw_portrait(
    brush: Brush,
    box: Any,
    states: ArrayLike,
    strides: Sequence[int],
    free: Sequence[bool],
    *,
    legs: bool = True,
) -> None:
    """Draw angular velocities over angles, each leg in its own colour; impacts leave gaps.

    A dot marks where a leg is at the end, a ring where a free shank is.

    Args:
        brush: Draws in pixels.
        box: The panel, a rectangle of pygame.
        states: Angles in rad, then dimensionless angular velocities, (n, 6) or (n, 2 m).
        strides: Heelstrikes before each state, (n,).
        free: Whether the swing shank moves independently, (n,).
        legs: Whether the coordinates are stance leg, thigh and shank, and not a `System`'s.
    """
    draw, canvas = brush.pygame.draw, brush.canvas
    title = "phase portrait" + " (thin: free shank)" * any(free)
    brush.write(title, (box.left + 10, box.top + 9), "topleft", colours.HIP)
    plot = brush.pygame.Rect(box.left + 44, box.top + 34, box.width - 60, box.height - 64)
    size = np.shape(states)[-1] // 2
    links = np.reshape(states, (-1, 2, size)).swapaxes(1, 2)  # angle and velocity, (n, size, 2)
    angle, rate = map(_rounded_up, np.abs(links).max(axis=(0, 1)).tolist())
    _draw_axes(brush, plot)
    draw.rect(canvas, colours.GROUND, plot, 1)
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
    pixels = plot.center + half * (links / [angle, rate])
    motions = list(zip(strides, free, strict=True))
    new = [i for i, (before, after) in enumerate(pairwise(motions), 1) if before != after]
    for first, last in pairwise([0, *new, len(motions)]):
        for link, colour in _links(size, legs, *motions[first]):
            if last - first > 1:
                line = pixels[first:last, link]
                draw.aalines(canvas, colour, False, line)
                if link != 2:  # a shank's line is thin
                    draw.aalines(canvas, colour, False, line + 0.7)
    for link, colour in _links(size, legs, *motions[-1]):
        draw.aacircle(canvas, colour, pixels[-1, link], 5, 2 * (link == 2))


def _links(size: int, legs: bool, strides: int, free: bool) -> Iterator[tuple[int, colours.Colour]]:
    """The coordinates that move independently, and their colours.

    Legs keep theirs at heelstrike; coordinates of a `System` have theirs by number.
    """
    if not legs:
        yield from ((i, colours.LEGS[i % 2] if i < 2 else colours.HIP) for i in range(size))
        return
    stance, swing = colours.LEGS[strides % 2], colours.LEGS[1 - strides % 2]
    if free:
        yield 2, colours.shaded(swing, colours.SKY, _FADED)
    yield 1, swing
    yield 0, stance


def _rounded_up(value: float) -> float:
    """The next round number for the end of an axis."""
    return next((span for span in _SPANS if span >= value), value)


def _draw_axes(brush: Brush, box: Any) -> None:
    """Draw axes through the centre of a box."""
    brush.pygame.draw.line(brush.canvas, colours.GROUND, box.midtop, box.midbottom)
    brush.pygame.draw.line(brush.canvas, colours.GROUND, box.midleft, box.midright)


def draw_multipliers(brush: Brush, box: Any, values: NDArray, *, pale: bool = False) -> None:
    """Draw Floquet multipliers and the unit circle: dots inside it, rings outside.

    Args:
        brush: Draws in pixels.
        box: A square, as a rectangle of pygame.
        values: The multipliers, complex, (k,).
        pale: Whether they are drawn in the ground's colour.
    """
    draw, canvas = brush.pygame.draw, brush.canvas
    scale = 0.5 * box.width / (1.15 * float(np.abs(values).max(initial=1.0)))
    _draw_axes(brush, box)
    draw.aacircle(canvas, colours.GROUND_LINE, box.center, scale, 1)
    for value in values:
        outside = abs(value) >= 1.0
        colour = colours.GROUND if pale else colours.WARNING if outside else colours.LEGS[0]
        place = box.centerx + scale * value.real, box.centery - scale * value.imag
        draw.aacircle(canvas, colour, place, 6, 2 * outside)
    brush.write("unit circle", (box.centerx, box.bottom + 6))
