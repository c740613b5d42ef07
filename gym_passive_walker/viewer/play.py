"""The viewer's window, from its opening until it is closed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gym_passive_walker.files import prepare, replacing
from gym_passive_walker.policies import TrainedPolicy, load_policy
from gym_passive_walker.render.film import film_path
from gym_passive_walker.render.screen import load_pygame, open_window
from gym_passive_walker.viewer.walk import LiveWalk, Setup
from gym_passive_walker.walkers import WalkerLike, as_walker

_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tga")  # formats that pygame writes
_LONGEST_FRAME = 0.1  # seconds: after a longer pause of the machine time stands still


def play(
    walker: WalkerLike | None = None,
    slope: float | None = None,
    *,
    policy: TrainedPolicy | str | Path | None = None,
    start: ArrayLike | None = None,
    seconds: float | None = None,
    film: str | Path | None = None,
    picture: str | Path | None = None,
) -> None:
    """Show a walker in an interactive window with pushes and changes of its parameters.

    The ground is smooth. A scene is no argument: pass its walker and slope, or a policy, which has
    the walker, the mean slope and the actuators of its own scene, without terrain and disturbances.

    The engine computes the motion as exactly as elsewhere; a change takes effect in the next frame.
    The window requires the extra "render", and a display unless SDL_VIDEODRIVER=dummy.

    Args:
        walker: The walker (see `as_walker`); None is the policy's own, or the laboratory's.
        slope: Slope in rad; None is the policy's own, or a gentle one.
        policy: A trained policy that works the motors, or what `load_policy` takes.
        start: State on the Poincaré section to start from, in the walker's own units, (6,); None is
            a periodic gait.
        seconds: Seconds after which the window closes; None leaves that to the user.
        film: File to record all frames in, MP4 or GIF.
        picture: File to write the last frame to, PNG, JPEG, BMP or TGA.

    Raises:
        ValueError: if an argument is out of its range; subclasses say which (`WalkerError`,
            `SceneError`, `PolicyError`).
        ImportError: if pygame is not installed, or moviepy for a video.
        OSError: if the machine has no display, or the video or picture cannot be written.
    """
    pygame = load_pygame()
    from gym_passive_walker.viewer.player import FPS, SIZE, Player, gentle_slope
    from gym_passive_walker.viewer.view import View

    if isinstance(policy, str | Path):
        policy = load_policy(policy)
    if walker is None:
        walker = "lab" if policy is None else policy.scene.walker
    walker = as_walker(walker)
    if slope is None:
        slope = gentle_slope(walker) if policy is None else float(np.mean(policy.scene.slope))
    film = None if film is None else film_path(film)
    if picture is not None and Path(picture).suffix.lower() not in _PICTURES:
        raise ValueError(f"a picture's name must end in one of {', '.join(_PICTURES)}: {picture}")
    picture = None if picture is None else prepare(picture)
    walk = LiveWalk(Setup(walker, slope, 0.0 if policy is None else policy), start)
    window, player, view = open_window(pygame, SIZE), Player(walk), View()
    player.record(film)
    try:
        clock, shown = pygame.time.Clock(), 0.0
        while player.running and (seconds is None or shown < seconds):
            elapsed = min(clock.tick(FPS) / 1000.0, _LONGEST_FRAME)
            if player.film is not None:
                elapsed = 1.0 / FPS  # frames of a video are evenly spaced, however slow drawing is
            for event in pygame.event.get():
                player.handle(event)
            player.frame(elapsed)
            shown += elapsed
            surface = view.draw(player)
            if player.film is not None:
                pixels = pygame.image.tobytes(surface, "RGB")
                player.film.write(np.frombuffer(pixels, np.uint8))
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
