"""`python -m gym_passive_walker` is `passive-walker`."""

import sys

from gym_passive_walker.cli import main

if __name__ == "__main__":
    sys.exit(main())
