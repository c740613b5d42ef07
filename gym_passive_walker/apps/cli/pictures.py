"""Commands that draw: stroboscopic pictures, videos, and the figures of Garcia (1999)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from gym_passive_walker._tools.arguments import near, number
from gym_passive_walker._tools.extras import need
from gym_passive_walker._tools.progress import progress
from gym_passive_walker.apps.cli.arguments import AWalker, Strides, Walk
from gym_passive_walker.apps.cli.report import Report, table
from gym_passive_walker.envs.policies import shipped_policies


@dataclass(frozen=True)
class _ShortWalk(Walk):
    _: KW_ONLY
    strides: Strides = 3


def strobe(
    walk: _ShortWalk, *, out: Annotated[Path, "a picture: .png, .pdf, .svg"] = Path("strobe.png")
) -> Report:
    """Draw a walk as a stroboscopic picture.

    passive-walker strobe lab 0.036 --strides 3 --out walk.png
    passive-walker strobe C 0.036 --terrain stairs:rise=-0.01 --out stairs.png
    """
    need("matplotlib", "figures")
    from gym_passive_walker.pictures.axes import picture_path
    from gym_passive_walker.pictures.strobe import strobe as drawn

    path = picture_path(out)
    drawn(
        walk.map, walk.slope, walk.start, strides=walk.strides, terrain=walk.terrain,
        terrain_seed=walk.terrain_seed, path=path,
    )  # fmt: skip
    return _saved([path])


def video(
    walk: Walk,
    *,
    out: Annotated[Path, "video file, .mp4 or .gif"] = Path("walk.mp4"),
    slower: Annotated[float, "factor of slow motion", {"metavar": "TIMES"}] = 1.0,
) -> Report:
    """Write a video of a walk, in real time or in slow motion.

    passive-walker video lab 0.036 --strides 10 --out walk.mp4
    passive-walker video D 0.009 --slower 4 --out walk.gif
    passive-walker video C 0.05 --terrain rough:height_std=0.002 --terrain-seed 1 --out rough.mp4
    """
    need("pygame", "render")
    need("moviepy", "render")
    from gym_passive_walker.pictures.video import video as written
    from gym_passive_walker.pictures.video import video_path

    video_path(out)
    written(
        walk.map, walk.slope, walk.start, out, strides=walk.strides, terrain=walk.terrain,
        terrain_seed=walk.terrain_seed, slower=slower,
    )  # fmt: skip
    return _saved([out])


def play(
    walker: AWalker = None,
    slope: Annotated[float | None, "slope in rad, positive downhill"] = None,
    *,
    policy: Annotated[
        str | None,
        f"controller: {', '.join(shipped_policies())}, or an exported policy's folder",
        {"metavar": "POLICY"},
    ] = None,
    seconds: Annotated[
        float | None,
        "time in seconds after which the page ends (Ctrl-C), or length of the walk in a file (5)",
        {"metavar": "TIME"},
    ] = None,
    video: Annotated[
        str | None, "open no page: write a video, .mp4 or .gif", {"metavar": "FILE"}
    ] = None,
    picture: Annotated[
        str | None, "open no page: write the last frame, such as a .png", {"metavar": "FILE"}
    ] = None,
) -> Report:
    """Show a walker in the browser; push it, and change its parameters while it walks.

    passive-walker play
    passive-walker play C 0.03
    passive-walker play --policy level-ppo --video walk.mp4 --seconds 10
    """
    from gym_passive_walker.apps.play import announcement, draw_walk, server_of
    from gym_passive_walker.apps.shown import Setup
    from gym_passive_walker.devices.web.build import WebError

    setup, paths = Setup.of(walker, slope, policy, None), (video, picture)
    if any(path is not None for path in paths):
        draw_walk(setup, seconds, *paths)
        return _saved([Path(path) for path in paths if path is not None])
    try:
        server = server_of(setup, seconds)
    except WebError as error:
        raise OSError(None, str(error)) from None
    data = {"address": server.address, "files": []}
    return Report(announcement(server, seconds), data, then=partial(server.serve, seconds))


def figures(
    *names: Annotated[str, "number of a figure, such as 4.6", {"metavar": "NUMBER"}],
    list: Annotated[bool, "list the figures, and draw none"] = False,
    out: Annotated[
        Path, "output folder, or the file of one figure, such as f.pdf", {"metavar": "PATH"}
    ] = Path("figures"),
    size: Annotated[
        tuple[float, ...] | None,
        "width and height in cm (the figure's own)",
        {"nargs": 2, "type": float, "metavar": "CM"},
    ] = None,
) -> Report:
    """Recompute and draw figures of Garcia (1999), chapter 4; all of them if none is named.

    The data of a figure are written beside it, as CSV.

    passive-walker figures --list
    passive-walker figures 4.6 4.10 --out figures
    passive-walker figures 4.6 --out f.pdf --size 8.5 8
    """
    from gym_passive_walker.pictures.axes import picture_path
    from gym_passive_walker.pictures.figures import FIGURES, draw

    if list:
        shown = [
            {"figure": name, "shows": plate.caption.partition(". ")[0]}
            for name, plate in FIGURES.items()
        ]
        return Report(table(shown), shown)
    need("matplotlib", "figures")
    asked = names or tuple(FIGURES)
    for name in asked:
        if name not in FIGURES:
            like = near(name, FIGURES)
            raise ValueError(f"no figure {name!r}{like}: choose from {', '.join(FIGURES)}")
    width_height = None
    if size is not None:
        width, height = (number(length, "--size", above=0.0) for length in size)
        width_height = width, height
    file = out.suffix and not out.is_dir()
    if file and len(asked) > 1:
        raise ValueError(f"--out {out} is one file, for one figure: name a folder for several")
    if file:
        picture_path(out)
    else:
        out.mkdir(parents=True, exist_ok=True)
    paths = []
    with progress("figures", len(asked)) as drawn:
        for name in asked:
            paths += draw(name, out if file else out / f"figure-{name}.png", width_height)
            drawn()
    return _saved(paths)


def _saved(paths: list[Path]) -> Report:
    return Report("\n".join(f"saved {path}" for path in paths), {"files": [*map(str, paths)]})
