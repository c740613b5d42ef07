"""The viewer's window, from its opening until it is closed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker._tools.arguments import number, one_slope
from gym_passive_walker._tools.files import prepare, replacing
from gym_passive_walker.apps.viewer.walk import LiveWalk, Setup, gentle_slope
from gym_passive_walker.envs.policies import TrainedPolicy, load_policy
from gym_passive_walker.gaits.actuation import PASSIVE
from gym_passive_walker.gaits.given import GaitLike, walk_of
from gym_passive_walker.models.walkers import as_any
from gym_passive_walker.pictures.screen import load_pygame, open_window
from gym_passive_walker.pictures.video import video_path

if TYPE_CHECKING:
    from gym_passive_walker.apps.widget import PlayerWidget

_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga")  # formats that pygame writes
_LONGEST_FRAME = 0.1  # seconds: after a longer pause of the machine time stands still


def _in_notebook() -> bool:
    """Return whether a kernel of Jupyter runs this process."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def _asked(
    walker: GaitLike | None,
    slope: float | None,
    policy: TrainedPolicy | str | Path | None,
    start: ArrayLike | None,
) -> tuple[Setup, ArrayLike | None]:
    """Return the setup and the start that arguments of `play` mean; None is a periodic gait."""
    if isinstance(policy, str | Path):
        loaded = load_policy(policy)
        if not isinstance(loaded, TrainedPolicy):
            raise ValueError(
                "play shows policies of the package and exported folders, and gpw.simulate those "
                f"of other files, not {policy}"
            )
        policy = loaded
    if walker is None:
        walker = "lab" if policy is None else policy.scene.walker
    walker, given, start, motors, _, strides = walk_of(walker, slope, start)
    walker, slope = as_any(walker), given
    controller: Any = policy
    if policy is None:
        held = motors.hip_torque / walker.units.torque
        controller = held if strides is None else strides.controller
        smooth = strides is None or strides.terrain is None
        shown = smooth and isinstance(controller, TrainedPolicy | float)
        if not shown or motors[1:] != PASSIVE[1:]:
            raise ValueError(
                "play shows gaits on smooth ground that are passive, or under a constant hip "
                "torque or a trained policy"
            )
    if slope is None:
        slope = gentle_slope(walker) if policy is None else float(np.mean(policy.scene.slope))
    return Setup(walker, one_slope(slope), controller), start


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
    """Show a walker with pushes and changes of its parameters, in a window or in a notebook.

    A scene is no argument: pass its walker and slope, or a policy, which has the walker, the mean
    slope and the actuators of its own scene, without terrain and disturbances. The window's ground
    is smooth; the player of web pages offers rough ground too.

    The engine computes the motion as exactly as elsewhere; a change takes effect in the next frame.
    The window requires the extra "render", and a display unless SDL_VIDEODRIVER=dummy. In a
    notebook the player of web pages is shown instead, which requires the extra "notebook".

    Args:
        walker: A gait, which also gives slope, controller and start; a walker (see `as_walker`); or
            a `System`. None is the policy's own, or the laboratory's.
        slope: Slope in rad; None is the gait's or the policy's own, or a gentle one.
        policy: A trained policy that works the motors, or what `load_policy` takes.
        start: State on the Poincaré section to start from, in the walker's own units, (6,), or
            (2 m,) of a `System`; None is a periodic gait.
        seconds: Seconds after which the window closes; None leaves that to the user. This argument
            and the next two open the window also in a notebook.
        video: File to record all frames in, MP4 or GIF.
        picture: File to write the last frame to, PNG, JPEG, BMP or TGA.

    Returns:
        In a notebook, the widget, which a cell displays as its last expression; see
        `web.widget.PlayerWidget`. Otherwise None, when the window is closed.

    Raises:
        ValueError: if an argument is out of its range, or the gait has another controller;
            subclasses say which (`WalkerError`, `SceneError`, `PolicyError`).
        ImportError: if pygame is not installed, moviepy for a video, or anywidget in a notebook.
        OSError: if the machine has no display, or the video or picture cannot be written.
    """
    if seconds is None and video is None and picture is None and _in_notebook():
        from gym_passive_walker.apps.widget import PlayerWidget

        setup, start = _asked(walker, slope, policy, start)
        return PlayerWidget(*setup, start=start)
    seconds = None if seconds is None else number(seconds, "seconds", above=0.0)
    pygame = load_pygame()
    from gym_passive_walker.apps.viewer.player import FRAME_RATE, WINDOW_SIZE, Player
    from gym_passive_walker.apps.viewer.view import View

    setup, start = _asked(walker, slope, policy, start)
    video = None if video is None else video_path(video)
    if picture is not None and Path(picture).suffix.lower() not in _PICTURES:
        raise ValueError(f"a picture's name must end in one of {', '.join(_PICTURES)}: {picture}")
    picture = None if picture is None else prepare(picture)
    walk = LiveWalk(setup, start)
    window, player, view = open_window(pygame, WINDOW_SIZE), Player(walk), View()
    player.record(video)
    try:
        clock, shown = pygame.time.Clock(), 0.0
        while player.running and (seconds is None or shown < seconds):
            elapsed = min(clock.tick(FRAME_RATE) / 1000.0, _LONGEST_FRAME)
            if player.video is not None:
                elapsed = (
                    1.0 / FRAME_RATE
                )  # frames of a video are evenly spaced, however slow drawing is
            for event in pygame.event.get():
                player.handle(event)
            player.frame(elapsed)
            shown += elapsed
            surface = view.draw(player)
            if player.video is not None:
                pixels = pygame.image.tobytes(surface, "RGB")
                player.video.write(np.frombuffer(pixels, np.uint8))
            window.blit(surface, (0, 0))
            pygame.display.flip()
        if picture is not None:
            with replacing(picture) as aside:
                try:
                    pygame.image.save(view.draw(player), str(aside))
                except pygame.error as error:
                    raise OSError(None, f"the picture cannot be written ({error})") from None
    finally:
        player.close()
        pygame.display.quit()
    return None
