"""Films of what the viewer shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pygame
from pygame import Surface

from gym_passive_walker.extras import extra

ENDINGS = (".mp4", ".gif")
_GIF = "fps=20,scale=iw/2:-1:flags=lanczos,split[a][b];[a]palettegen[p];[b][p]paletteuse"


def film_path(path: Path) -> Path:
    """A path that films may be written to.

    Raises:
        ValueError: if its ending is of no film.
    """
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(
            f"a film is written to a file in {' or '.join(ENDINGS)}, not {str(path)!r}"
        )
    return path


class Film:
    """A film that is written as it is shown: MP4, or half as large, GIF.

    Args:
        path: The file.
        size: Width and height in pixels, even numbers.
        fps: Frames a second.

    Raises:
        ValueError: if the file's ending is of no film.
        ImportError: if moviepy is not installed.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: int) -> None:
        self.path = film_path(path)
        with extra("render"):
            from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter
        gif = path.suffix.lower() == ".gif"
        self._writer = FFMPEG_VideoWriter(
            str(path),
            size,
            fps,
            codec="gif" if gif else "libx264",
            preset="veryfast",
            ffmpeg_params=["-vf", _GIF] if gif else None,
        )

    def write(self, frame: Surface) -> None:
        """Add a frame."""
        self._writer.write_frame(np.frombuffer(pygame.image.tobytes(frame, "RGB"), np.uint8))

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()
