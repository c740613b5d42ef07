"""Run the command line `passive-walker` by `python -m gym_passive_walker`."""

import sys

from gym_passive_walker.apps.cli import main

if __name__ == "__main__":
    sys.exit(main())
