"""``python -m gym_passive_walker.apps.viewer`` is ``passive-walker play``."""

import sys

from gym_passive_walker.apps.cli import main

if __name__ == "__main__":
    sys.exit(main(["play", *sys.argv[1:]]))
