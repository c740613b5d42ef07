"""Films of a walk, at its own pace."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker.arguments import number
from gym_passive_walker.extras import extra, need
from gym_passive_walker.gaits.trajectory import simulate
from gym_passive_walker.progress import progress
from gym_passive_walker.render.screen import Screen
from gym_passive_walker.walkers import Walker, as_walker

FPS = 30
"""Frames of a film's second."""

_SAMPLES = 200  # of a stride, from which frames are taken
_KINDS = (".mp4", ".gif")


def film(
    walker: Walker | str,
    slope: float,
    state: ArrayLike,
    path: str | Path,
    *,
    strides: int = 10,
    hip_torque: ArrayLike = 0.0,
    slower: float = 1.0,
) -> int:
    """Film a walk.

    Args:
        walker: The walker, or a preset's name.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad, then their rates, just after heelstrike, (6,).
        path: The film's file, .mp4 or .gif.
        strides: How many strides to follow.
        hip_torque: Torque held through a stride: a number, or one for each.
        slower: How many times slower than the walk; a second is the walker's unit of time.

    Returns:
        How many frames it has.

    Raises:
        ValueError: if a number is out of its range, or a film of no such kind can be written.
        ImportError: if pygame or moviepy is not installed.
    """
    path, slower = Path(path), number(slower, "slower", above=0.0)
    if path.suffix not in _KINDS:
        raise ValueError(f"a film's name must end in {' or '.join(_KINDS)}, not {path}")
    need("pygame", "render")
    with extra("render"):
        from moviepy import ImageSequenceClip

    walk = simulate(walker, slope, state, strides, samples=_SAMPLES, hip_torque=hip_torque)
    instants = np.arange(0.0, walk.times[-1], 1.0 / (FPS * slower))
    screen, frames = Screen(as_walker(walker)), []
    with progress("frames", len(instants)) as drawn:
        for i in np.searchsorted(walk.times, instants):
            frames.append(
                screen.draw(walk.states[i], slope, float(walk.contact_x[i]), int(walk.strides[i]))
            )
            drawn()
    clip = ImageSequenceClip(frames, fps=FPS)
    if path.suffix == ".gif":
        clip.write_gif(str(path), logger=None)
    else:
        clip.write_videofile(str(path), audio=False, logger=None)
    return len(frames)
