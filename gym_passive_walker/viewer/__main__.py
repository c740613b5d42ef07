"""``python -m gym_passive_walker.viewer``: the viewer from the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gym_passive_walker.policies import shipped_policies
from gym_passive_walker.viewer.play import play
from gym_passive_walker.walkers import WALKERS


def parser() -> argparse.ArgumentParser:
    """What the viewer understands."""
    words = argparse.ArgumentParser(
        prog="python -m gym_passive_walker.viewer",
        description=play.__doc__.splitlines()[0] if play.__doc__ else None,
        epilog="example: python -m gym_passive_walker.viewer C 0.03",
    )
    words.add_argument("walker", nargs="?", help=f"one of {', '.join(WALKERS)}")
    words.add_argument("slope", nargs="?", type=float, help="slope in rad, downhill")
    policies = f"who works the hip: {', '.join(shipped_policies())}, or an exported policy's folder"
    words.add_argument("--policy", help=policies)
    words.add_argument("--seconds", type=float, help="close the window after so long")
    words.add_argument("--film", help="record everything in this file: .mp4 or .gif")
    words.add_argument("--picture", help="write the last frame to this file, such as a .png")
    return words


def main(words: Sequence[str] | None = None) -> int:
    """Run the viewer; bad input ends with a sentence, not a traceback."""
    try:
        play(**vars(parser().parse_args(words)))
    except (ValueError, ImportError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
