"""The player: a walker in a page of the browser, in a notebook, in a video or in a picture."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gym_passive_walker._tools.arguments import number
from gym_passive_walker._tools.extras import need
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.apps.serve import PageServer
from gym_passive_walker.apps.shown import Setup, page_of
from gym_passive_walker.envs.policies import TrainedPolicy
from gym_passive_walker.gaits.given import GaitLike
from gym_passive_walker.gaits.look.trajectory import Trajectory, simulate
from gym_passive_walker.gaits.scenes.starts import Starts, gait_near
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.pictures.screen import Screen, load_pygame
from gym_passive_walker.pictures.video import FPS, SAMPLES, Video, frames_of, video_path

if TYPE_CHECKING:
    from gym_passive_walker.apps.widget import PlayerWidget

__all__ = ["play"]

SECONDS = 5.0
"""Duration of a video, and time of a picture, in the walker's unit of time."""

_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga")  # formats that pygame writes


def _in_notebook() -> bool:
    """Return whether a kernel of Jupyter runs this process."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def play(
    walker: GaitLike | None = None,
    slope: float | None = None,
    *,
    policy: TrainedPolicy | str | Path | None = None,
    start: ArrayLike | None = None,
    seconds: float | None = None,
    video: str | Path | None = None,
    picture: str | Path | None = None,
) -> PlayerWidget | None:
    """Show a walker with pushes and changes of its parameters, in a page or in a notebook.

    The page opens in the user's browser. This process serves its files at an address of this
    machine, which it prints, until Ctrl-C. Nothing is loaded from elsewhere. In a notebook the same
    player is a widget, which requires the extra "notebook". With `video` or `picture` no page
    opens: the walk is drawn to these files, which requires the extra "render".

    A scene is no argument: pass its walker and slope, or a policy, which has the walker, the mean
    slope and the actuators of its own scene, without terrain. A page walks as the engine does.

    Args:
        walker: A gait, which also gives slope, controller and start; a walker (see `as_walker`); or
            a `System`. None is the policy's own, or the laboratory's.
        slope: Slope in rad; None is the gait's or the policy's own, or a gentle one.
        policy: A trained policy that works the motors, or what `load_policy` takes.
        start: State on the Poincaré section to start from, in the walker's own units, (6,), or
            (2 m,) of a `System`; None is a periodic gait.
        seconds: Seconds after which the page is no longer served; None is until Ctrl-C. Of a video
            or a picture: how long the walk is, in the walker's unit of time; None is 5. This
            argument and the next two prevent the widget in a notebook.
        video: File to write the walk to, MP4 or GIF.
        picture: File to write the last frame of the walk to, PNG, JPEG, BMP or TGA.

    Returns:
        In a notebook, the widget, which a cell displays as its last expression; see
        `apps.widget.PlayerWidget`. Otherwise None.

    Raises:
        ValueError: if an argument is out of its range, or the gait has another controller;
            subclasses say which (`WalkerError`, `SceneError`, `PolicyError`).
        ImportError: if anywidget is not installed in a notebook, pygame for a picture, or moviepy
            for a video.
        OSError: if the video or the picture cannot be written.
        WebError: if the WebAssembly modules cannot be compiled here.
    """
    if video is not None or picture is not None:
        draw_walk(Setup.of(walker, slope, policy, start), seconds, video, picture)
    elif seconds is None and _in_notebook():
        from gym_passive_walker.apps.widget import PlayerWidget

        return PlayerWidget(*Setup.of(walker, slope, policy, start))
    else:
        server = server_of(Setup.of(walker, slope, policy, start), seconds)
        print(announcement(server, seconds), flush=True)
        with suppress(KeyboardInterrupt):
            server.serve(seconds)
    return None


def server_of(setup: Setup, seconds: float | None) -> PageServer:
    """Return a server of the page of a setup, which will serve for `seconds`.

    Raises:
        ValueError: if a page cannot show the setup, or `seconds` is out of its range.
        WebError: if the WebAssembly modules cannot be compiled here.
    """
    if seconds is not None:
        number(seconds, "seconds", above=0.0)
    return PageServer(page_of(setup))


def announcement(server: PageServer, seconds: float | None = None) -> str:
    """Return the line that `play` prints."""
    end = "until Ctrl-C" if seconds is None else f"for {seconds:g} s, or until Ctrl-C"
    return f"the walker is on {server.address} {end}"


def draw_walk(
    setup: Setup, seconds: float | None, video: str | Path | None, picture: str | Path | None
) -> None:
    """Write a walk's video and the picture of its last frame; see `play` for the arguments."""
    seconds = SECONDS if seconds is None else number(seconds, "seconds", above=0.0)
    need("pygame", "render")
    if video is not None:
        video = video_path(video)
        need("moviepy", "render")
    if picture is not None:
        if Path(picture).suffix.lower() not in _PICTURES:
            allowed = ", ".join(_PICTURES)
            raise ValueError(f"a picture's name must end in one of {allowed}, not {picture}")
        picture = prepare(picture)
    walk = _walk(setup, seconds)
    screen, instants = Screen(walk.walker), np.arange(0.0, min(seconds, walk.times[-1]), 1.0 / FPS)
    with ExitStack() as files:
        film = None if video is None else files.enter_context(Video(video, screen.size, FPS))
        drawn = files.enter_context(progress("frames", len(instants)))
        for frame in frames_of(walk, screen, instants):
            if film is not None:
                film.write(frame)
            drawn()
    if picture is not None:
        _save(frame, picture)


def _walk(setup: Setup, seconds: float) -> Trajectory:
    """Simulate a walk of some units of time, or until the walker falls."""
    strides, start = setup.stride_map(), setup.first_state()
    if start is None and isinstance(setup.controller, TrainedPolicy):
        start = Starts(setup.controller.scene, setup.walker).state(setup.slope)
    elif start is None:
        start = gait_near(setup.walker, setup.slope)
    state, count = setup.walker.units.to_own(np.array(start)), 1
    while True:
        walk = simulate(strides, setup.slope, state, count, samples=SAMPLES)
        if walk.outcomes[-1] != Outcome.HEELSTRIKE or walk.times[-1] >= seconds:
            return walk
        count = math.ceil(1.1 * count * seconds / walk.times[-1])


def _save(frame: NDArray[np.uint8], path: Path) -> None:
    """Write a frame, (height, width, 3), as a picture."""
    pygame = load_pygame()
    height, width, _ = frame.shape
    surface = pygame.image.frombuffer(frame.tobytes(), (width, height), "RGB")
    with replacing(path) as aside:
        try:
            pygame.image.save(surface, str(aside))
        except pygame.error as error:
            raise OSError(None, f"the picture cannot be written ({error})") from None
