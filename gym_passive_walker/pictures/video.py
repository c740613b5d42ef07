"""Videos of a walk, in real time or in slow motion."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import number
from gym_passive_walker._tools.extras import extra, need
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.gaits.given import GaitLike
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.gaits.terrain import Terrain
from gym_passive_walker.pictures.ground import ground_under
from gym_passive_walker.pictures.screen import Screen

FPS = 30
"""Frames per second of a video."""

SAMPLES = 200
"""Samples of a stride, from which frames are taken."""

_KINDS = (".mp4", ".gif")
_GIF_FPS = 30  # few browsers show more frames per second


def video_path(path: str | Path) -> Path:
    """Check a path that a video is to be written to, and create its folder if needed.

    Raises:
        ValueError: if the suffix is neither .mp4 nor .gif.
        OSError: if no file can be written there.
    """
    path = Path(path)
    if path.suffix.lower() not in _KINDS:
        raise ValueError(f"a video's name must end in {' or '.join(_KINDS)}, not {path}")
    return prepare(path)


class Video:
    """A video that is written frame by frame; a context manager, or closed by `close`.

    Args:
        path: The file, .mp4 or .gif.
        size: Width and height of a frame in pixels, even numbers.
        fps: Frames per second.
        shrink: Whole number by which the width and height of a GIF are divided.

    Raises:
        ValueError: if the suffix of `path` is neither .mp4 nor .gif.
        ImportError: if moviepy is not installed.
        OSError: if the file cannot be written.
    """

    def __init__(
        self, path: str | Path, size: tuple[int, int], fps: int, *, shrink: int = 1
    ) -> None:
        self.path = video_path(path)
        with extra("render"):
            from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
        gif = self.path.suffix.lower() == ".gif"
        # Pictures have few colours: more of them, or dots between them, double the file.
        palette = "split[a][b];[a]palettegen=max_colors=32[p];[b][p]paletteuse=dither=none"
        shrunk = f"fps={min(fps, _GIF_FPS)},scale=iw/{shrink}:-1:flags=lanczos,{palette}"
        with ExitStack() as files:
            aside = files.enter_context(replacing(self.path))
            self._writer = FFMPEG_VideoWriter(
                str(aside),
                size,
                fps,
                codec="gif" if gif else "libx264",
                preset="veryfast",
                ffmpeg_params=["-vf", shrunk] if gif else None,
            )
            self._files = files.pop_all()

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Add a frame, uint8 of shape (height, width, 3)."""
        self._writer.write_frame(frame)

    def close(self) -> None:
        """Finish the file and move it to its final path.

        Raises:
            OSError: if it could not be written; an existing file stays unchanged.
        """
        with self._files:
            process = self._writer.proc
            self._writer.close()
            if process is not None and process.returncode:
                raise OSError(None, "the video could not be written; is the disk full?")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        if error is None:
            self.close()
            return
        with self._files:  # an unfinished video is discarded
            self._writer.close()
            raise error


def video(
    walker: GaitLike,
    slope: float,
    state: ArrayLike,
    path: str | Path,
    *,
    strides: int = 10,
    hip_torque: ArrayLike | None = None,
    terrain: Terrain | None = None,
    terrain_seed: int = 0,
    slower: float = 1.0,
    shrink: int = 1,
) -> int:
    """Write a video of a walk.

    Args:
        walker: The walker, in a form that `as_walker` takes; or a stride map or a `Gait`, with its
            actuation.
        slope: Slope in rad, positive downhill.
        state: [stance, thigh, shank] angles in rad, then their angular velocities in rad per unit
            of time, just after heelstrike, shape (6,).
        path: The video file, .mp4 or .gif.
        strides: Number of strides.
        hip_torque: Torque held through each stride: a number, or shape (strides,).
        terrain: Terrain of the footholds; smooth ground when None.
        terrain_seed: Seed of a random terrain.
        slower: Factor of slow motion; at 1, a second shows one unit of time of the walker.
        shrink: Whole number by which the width and height of a GIF are divided.

    Returns:
        Number of frames.

    Raises:
        ValueError: if a number is out of its range, or the suffix is neither .mp4 nor .gif.
        ImportError: if pygame or moviepy is not installed.
    """
    path, slower = video_path(path), number(slower, "slower", above=0.0)
    need("pygame", "render")
    need("moviepy", "render")
    walk = simulate(
        walker, slope, state, strides=strides, samples=SAMPLES, hip_torque=hip_torque,
        terrain=terrain, terrain_seed=terrain_seed,
    )  # fmt: skip
    instants = np.arange(0.0, walk.times[-1], 1.0 / (FPS * slower))
    screen = Screen(walk.walker)
    with (
        Video(path, screen.size, FPS, shrink=shrink) as written,
        progress("frames", len(instants)) as drawn,
    ):
        for frame in frames_of(walk, screen, instants):
            written.write(frame)
            drawn()
    return len(instants)


def frames_of(
    walk: Trajectory, screen: Screen, instants: NDArray[np.float64]
) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a walk, uint8 of shape (height, width, 3).

    Args:
        walk: The walk.
        screen: Draws the frames.
        instants: Times in the walker's unit of time, (frames,); each shows the sample that follows.
    """
    ground = ground_under(walk, screen.seen + walk.walker.leg_length)
    for i in np.searchsorted(walk.times, instants):
        yield screen.draw(
            walk.states[i], walk.slope, float(walk.contact_x[i]), int(walk.stride_index[i]),
            contact_y=float(walk.contact_y[i]), tilt=float(walk.tilts[i]), profile=ground,
        )  # type: ignore[misc]  # fmt: skip
