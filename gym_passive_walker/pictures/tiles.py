"""Frames of many walkers in one picture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gym_passive_walker.pictures import colours

_WIDTH = 1600  # of a picture with many tiles
_LARGEST, _SMALLEST = 800, 160  # widths in pixels of tiles, which have the aspect ratio 16:9


def tile_size(count: int) -> tuple[int, int]:
    """Width and height in pixels, both even, of each of `count` frames in one picture."""
    width = min(_LARGEST, max(_SMALLEST, _WIDTH // tile_columns(count)))
    return width // 2 * 2, width * 9 // 32 * 2


def tile_columns(count: int) -> int:
    """Number of columns in a picture of `count` frames; about the number of rows."""
    return math.ceil(math.sqrt(count))


def tiled(frames: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Arrange frames in one picture, row by row.

    Args:
        frames: Frames as a vector environment's `render` returns them: one or more, uint8, all of
            shape (height, width, 3).

    Returns:
        The picture, uint8 of shape (rows * height, columns * width, 3). Unused tiles have the sky's
        colour.

    Raises:
        ValueError: if there are no frames, or they differ in shape.
    """
    shapes = {np.shape(frame) for frame in frames}
    if len(shapes) != 1:
        raise ValueError(f"frames must be one or more of one shape, not of shapes {shapes}")
    height, width, _ = shapes.pop()
    columns = tile_columns(len(frames))
    rows = math.ceil(len(frames) / columns)
    picture = np.full((rows * height, columns * width, 3), colours.SKY, np.uint8)
    for index, frame in enumerate(frames):
        top, left = index // columns * height, index % columns * width
        picture[top : top + height, left : left + width] = frame
    return picture
