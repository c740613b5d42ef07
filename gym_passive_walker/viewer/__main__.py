"""``python -m gym_passive_walker.viewer``: the viewer from the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from gym_passive_walker import console
from gym_passive_walker.policies import shipped_policies
from gym_passive_walker.viewer.play import play
from gym_passive_walker.walkers import WALKERS, Walker


def add_arguments(
    command: argparse.ArgumentParser,
    a_walker: Callable[[str], Walker | str] = str,
    walkers: str = f"one of {', '.join(WALKERS)}",
) -> None:
    """Ask for what `play` takes.

    Args:
        command: The parser.
        a_walker: Reads a walker.
        walkers: What it reads, in words.
    """
    policies = (
        f"what works the motors: {', '.join(shipped_policies())}, or an exported policy's folder"
    )
    add = command.add_argument
    add("walker", nargs="?", type=a_walker, metavar="WALKER", help=walkers)
    add("slope", nargs="?", type=float, metavar="SLOPE", help="in rad, downhill")
    add("--policy", metavar="POLICY", help=policies)
    add("--seconds", type=float, metavar="TIME", help="close the window after so long")
    add("--film", metavar="FILE", help="record everything in this file, .mp4 or .gif")
    add("--picture", metavar="FILE", help="write the last frame to this file, such as a .png")


def main(words: Sequence[str] | None = None) -> int:
    """Run the viewer; bad input ends with a sentence, not a traceback."""
    parser = argparse.ArgumentParser(
        prog="python -m gym_passive_walker.viewer",
        description="Watch a walker in a window; push it, and change it while it walks.",
        epilog="example: python -m gym_passive_walker.viewer C 0.03",
    )
    add_arguments(parser)
    refusals = {ValueError: 2, ImportError: 2, OSError: 2}
    return console.run(lambda: play(**vars(parser.parse_args(words))), refusals=refusals)


if __name__ == "__main__":
    sys.exit(main())
