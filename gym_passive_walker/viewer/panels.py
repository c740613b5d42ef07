"""What is drawn beside the walker: its motion as a curve, and the gait behind it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pygame
from numpy.typing import NDArray
from pygame import Rect

from gym_passive_walker.render import look
from gym_passive_walker.viewer.seeker import Answer, Question
from gym_passive_walker.viewer.sheet import LINE, Sheet
from gym_passive_walker.viewer.walk import LiveWalk, Sample

_SPANS = (0.2, 0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0)  # of an axis
_FADED = 0.45  # share of the background in the colour of a shank
_UNSTABLE: look.Colour = (190, 50, 30)


def portrait(sheet: Sheet, box: Rect, walk: LiveWalk) -> None:
    """Rates over angles, each leg in its own colour; strikes leave gaps.

    Args:
        sheet: Where to draw.
        box: Where on it.
        walk: Whose trail is drawn.
    """
    trail = list(walk.trail)
    plot = Rect(box.left + 44, box.top + 34, box.width - 60, box.height - 64)
    states = np.array([sample.state for sample in trail]).reshape(-1, 2, 3)  # angles and rates
    spans = np.array([_span(states[:, 0]), _span(states[:, 1])])
    shanks = " (thin: free shank)" if walk.walker.knees else ""
    sheet.write(f"phase portrait{shanks}", (box.left + 10, box.top + 9))
    _axes(sheet, plot, spans)
    shares = states.swapaxes(1, 2) / spans  # of each link, (n, 3, 2)
    pixels = plot.center + 0.5 * np.array([plot.width, -plot.height]) * shares
    motions = [(sample.strides, sample.phase) for sample in trail]
    new = [i for i in range(1, len(trail)) if motions[i] != motions[i - 1]]
    for first, last in pairwise([0, *new, len(trail)]):
        for link, colour in _links(walk, trail[first]):
            if last - first > 1:
                line = pixels[first:last, link]
                pygame.draw.aalines(sheet.surface, colour, False, line)
                if link != 2:  # shanks are thin
                    pygame.draw.aalines(sheet.surface, colour, False, line + 0.7)
    for link, colour in _links(walk, trail[-1]):
        pygame.draw.aacircle(sheet.surface, colour, pixels[-1, link], 5, 2 * (link == 2))


def _links(walk: LiveWalk, sample: Sample) -> Iterator[tuple[int, look.Colour]]:
    """The links that move by themselves, and their colours: legs keep theirs at heelstrike."""
    standing, swinging = look.LEGS[sample.strides % 2], look.LEGS[1 - sample.strides % 2]
    if walk.walker.knees and sample.phase == 0:
        yield 2, look.shaded(swinging, look.SKY, _FADED)
    yield 1, swinging
    yield 0, standing


def _span(values: NDArray) -> float:
    """A round number that all values are below, either way."""
    largest = float(np.abs(values).max())
    return next((span for span in _SPANS if span >= largest), largest)


def _axes(sheet: Sheet, plot: Rect, spans: NDArray) -> None:
    """Axes through zero, with their ends' values."""
    pygame.draw.rect(sheet.surface, look.GROUND, plot, 1)
    pygame.draw.line(sheet.surface, look.GROUND, plot.midtop, plot.midbottom)
    pygame.draw.line(sheet.surface, look.GROUND, plot.midleft, plot.midright)
    angle, rate = spans
    for text, place, at in (
        (f"−{angle:g}", plot.bottomleft, "midtop"),
        ("angle (rad)", plot.midbottom, "midtop"),
        (f"{angle:g}", plot.bottomright, "midtop"),
    ):
        sheet.write(text, (place[0], place[1] + 6), at=at, colour=look.GROUND_LINE)
    for text, place in ((f"−{rate:g}", plot.bottomleft), (f"{rate:g}", plot.topleft)):
        sheet.write(text, (place[0] - 6, place[1]), at="midright", colour=look.GROUND_LINE)
    sheet.write(
        "rate × √(l/g)", (plot.right, plot.top - 6), at="bottomright", colour=look.GROUND_LINE
    )


def multipliers(sheet: Sheet, box: Rect, walk: LiveWalk, gait: Answer | None) -> None:
    """The multipliers of the gait behind a walk, in the complex plane, and its last stride.

    Args:
        sheet: Where to draw.
        box: Where on it.
        walk: The walk.
        gait: Its gait, or the last one found; None before the first is.
    """
    question = Question.of(walk)
    sheet.write(f"multipliers of {_which(question)}", (box.left + 10, box.top + 9))
    values = np.empty(0, complex) if gait is None else gait.multipliers
    settled = gait is not None and gait.question == question
    circle = Rect(box.left + 12, box.top + 38, 190, 190)
    largest = float(np.abs(values).max(initial=1.0))
    scale = 0.5 * circle.width / (1.15 * largest)
    pygame.draw.line(sheet.surface, look.GROUND, circle.midtop, circle.midbottom)
    pygame.draw.line(sheet.surface, look.GROUND, circle.midleft, circle.midright)
    pygame.draw.aacircle(sheet.surface, look.GROUND_LINE, circle.center, scale, 1)
    for value in values:
        place = circle.centerx + scale * value.real, circle.centery - scale * value.imag
        out = abs(value) >= 1.0
        colour = look.GROUND if not settled else _UNSTABLE if out else look.LEGS[0]
        pygame.draw.aacircle(sheet.surface, colour, place, 6, 2 * out)
    sheet.write(
        "unit circle", (circle.centerx, circle.bottom + 6), at="midtop", colour=look.GROUND_LINE
    )
    words, colour = _verdict(gait, settled)
    x, y = circle.right + 16, circle.top
    sheet.write(words, (x, y), colour=colour)
    shown = _in_words(values) if settled else []
    for line, text in enumerate(shown, start=1):
        sheet.write(text, (x, y + LINE * line))
    told = ["last stride", *_measures(walk)]
    for line, text in enumerate(told):
        colour = look.HIP if line == 0 else look.GROUND_LINE
        sheet.write(text, (x, circle.bottom + LINE * (line - len(told) + 1)), colour=colour)


def _which(question: Question) -> str:
    if question.policy is not None:
        return f"the gait under {question.policy.name}"
    return "the gait under this torque" if question.torque else "the passive gait"


def _verdict(gait: Answer | None, settled: bool) -> tuple[str, look.Colour]:
    if gait is None or not settled:
        return "searching", look.GROUND_LINE
    if gait.state is None:
        return "no gait found", _UNSTABLE
    return ("stable", look.LEGS[0]) if gait.stable else ("unstable (ring)", _UNSTABLE)


def _in_words(values: NDArray) -> list[str]:
    """Multipliers, pairs in one line."""
    return [
        f"{value.real:z.3f}".replace("-", "−") + (f" ± {value.imag:.3f} i" if value.imag else "")
        for value in values
        if value.imag >= 0.0
    ]


def _measures(walk: LiveWalk) -> list[str]:
    if walk.last is None:
        return ["was disturbed" if walk.strides else "none yet"]
    length, period, speed, cost = walk.last
    return [
        f"speed {speed:.4f} √(g l)",
        f"length {length:.4f} l",
        f"period {period:.4f} √(l/g)",
        f"cost of transport {cost:.4f}",
    ]
