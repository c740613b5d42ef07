"""Colours of a walker, in frames and in plots; colour-blind people can distinguish them."""

from __future__ import annotations

Colour = tuple[int, int, int]

# Blue and orange of Okabe and Ito's palette, for the stance leg of stride 0 and the other leg.
LEGS: tuple[Colour, Colour] = ((0, 96, 160), (224, 138, 22))
HIP: Colour = (38, 42, 50)
SKY: Colour = (250, 250, 247)
GROUND: Colour = (226, 222, 212)
GROUND_LINE: Colour = (92, 88, 80)
TORQUE: Colour = (0, 128, 94)
PUSH: Colour = (150, 40, 130)
WARNING: Colour = (200, 30, 30)


def unit(colour: Colour) -> tuple[float, float, float]:
    """A colour with components from 0 to 1, as matplotlib requires."""
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def shaded(colour: Colour, towards: Colour, share: float) -> Colour:
    """A colour mixed with a share, from 0 to 1, of another."""
    red, green, blue = (round(a + share * (b - a)) for a, b in zip(colour, towards, strict=True))
    return red, green, blue
