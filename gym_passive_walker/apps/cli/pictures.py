"""Commands that draw: stroboscopic pictures, videos, and the figures of Garcia (1999)."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path

from gym_passive_walker._tools.arguments import near
from gym_passive_walker._tools.extras import need
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.apps.cli.arguments import A_WALKER, a_walker, add_walk, chosen_map, start_of
from gym_passive_walker.apps.cli.report import Report
from gym_passive_walker.envs.policies import shipped_policies


def strobe(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Draw a walk as a stroboscopic picture.

    passive-walker strobe lab 0.036 --strides 3 --out walk.png
    passive-walker strobe C 0.036 --terrain stairs:rise=-0.01 --out stairs.png
    """
    add_walk(command, strides=3)
    _add_out(command, "strobe.png", "a picture: .png, .pdf, .svg")

    def run(arguments: Namespace) -> Report:
        need("matplotlib", "figures")
        from gym_passive_walker.pictures.axes import picture_path
        from gym_passive_walker.pictures.strobe import strobe as drawn

        out = picture_path(arguments.out)
        drawn(
            chosen_map(arguments, arguments.slope), arguments.slope, start_of(arguments),
            strides=arguments.strides, terrain=arguments.terrain,
            terrain_seed=arguments.terrain_seed, path=out,
        )  # fmt: skip
        return _saved([out])

    return run


def video(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Write a video of a walk, in real time or in slow motion.

    passive-walker video lab 0.036 --strides 10 --out walk.mp4
    passive-walker video D 0.009 --slower 4 --out walk.gif
    passive-walker video C 0.05 --terrain rough:height_std=0.002 --terrain-seed 1 --out rough.mp4
    """
    add_walk(command, strides=10)
    _add_out(command, "walk.mp4", "video file, .mp4 or .gif")
    command.add_argument(
        "--slower",
        type=float,
        default=1.0,
        metavar="TIMES",
        help="factor of slow motion (%(default)s)",
    )

    def run(arguments: Namespace) -> Report:
        need("pygame", "render")
        need("moviepy", "render")
        from gym_passive_walker.pictures.video import video, video_path

        video_path(arguments.out)
        video(
            chosen_map(arguments, arguments.slope), arguments.slope, start_of(arguments),
            arguments.out, strides=arguments.strides, terrain=arguments.terrain,
            terrain_seed=arguments.terrain_seed, slower=arguments.slower,
        )  # fmt: skip
        return _saved([arguments.out])

    return run


def play(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Show a walker in the browser; push it, and change its parameters while it walks.

    passive-walker play
    passive-walker play C 0.03
    passive-walker play --policy level-ppo --video walk.mp4 --seconds 10
    """
    policies = f"controller: {', '.join(shipped_policies())}, or an exported policy's folder"
    add = command.add_argument
    add("walker", nargs="?", type=a_walker, metavar="WALKER", help=A_WALKER)
    add("slope", nargs="?", type=float, metavar="SLOPE", help="slope in rad, positive downhill")
    add("--policy", metavar="POLICY", help=policies)
    add(
        "--seconds",
        type=float,
        metavar="TIME",
        help="time in seconds after which the page ends (Ctrl-C), or length of the walk in a file "
        "(5)",
    )
    add("--video", metavar="FILE", help="open no page: write a video, .mp4 or .gif")
    add("--picture", metavar="FILE", help="open no page: write the last frame, such as a .png")

    def run(arguments: Namespace) -> Report:
        from gym_passive_walker.apps.play import announcement, draw_walk, server_of
        from gym_passive_walker.apps.shown import Setup
        from gym_passive_walker.devices.web.build import WebError

        setup = Setup.of(arguments.walker, arguments.slope, arguments.policy, None)
        seconds, paths = arguments.seconds, (arguments.video, arguments.picture)
        if any(path is not None for path in paths):
            draw_walk(setup, seconds, *paths)
            return _saved([Path(path) for path in paths if path is not None])
        try:
            server = server_of(setup, seconds)
        except WebError as error:
            raise OSError(None, str(error)) from None
        data = {"address": server.address, "files": []}
        return Report(announcement(server, seconds), data, then=partial(server.serve, seconds))

    return run


def figures(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Recompute and draw figures of Garcia (1999), chapter 4; all of them if none is named.

    passive-walker figures 4.6 4.10 --out figures
    """
    add = command.add_argument
    add("names", nargs="*", metavar="NUMBER", help="number of a figure, such as 4.6")
    add(
        "--out",
        type=Path,
        default=Path("figures"),
        metavar="FOLDER",
        help="output folder (%(default)s)",
    )

    def run(arguments: Namespace) -> Report:
        from gym_passive_walker.pictures.figures import FIGURES, draw

        need("matplotlib", "figures")
        paths, names = [], arguments.names or list(FIGURES)
        for name in names:
            if name not in FIGURES:
                like = near(name, FIGURES)
                raise ValueError(f"no figure {name!r}{like}: choose from {', '.join(FIGURES)}")
        arguments.out.mkdir(parents=True, exist_ok=True)
        with progress("figures", len(names)) as drawn:
            for name in names:
                paths.append(draw(name, arguments.out))
                drawn()
        return _saved(paths)

    return run


def _add_out(command: ArgumentParser, default: str, about: str) -> None:
    """Add the argument --out for a picture or a video."""
    command.add_argument(
        "--out", type=Path, default=Path(default), metavar="FILE", help=f"{about} (%(default)s)"
    )


def _saved(paths: list[Path]) -> Report:
    return Report("\n".join(f"saved {path}" for path in paths), {"files": [*map(str, paths)]})
