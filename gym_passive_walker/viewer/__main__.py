"""``python -m gym_passive_walker.viewer`` is ``passive-walker play``."""

import sys

from gym_passive_walker.cli import main

if __name__ == "__main__":
    sys.exit(main(["play", *sys.argv[1:]]))
