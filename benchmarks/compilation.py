"""CPU time to compile the equations of a system of one's own.

python -m benchmarks.compilation
"""

from __future__ import annotations

import argparse
from time import process_time

from examples.five_links import FIVE_LINKS
from examples.torso import TORSO
from gym_passive_walker._tools import console
from gym_passive_walker.engine import compiled


def main() -> None:
    """Print seconds of CPU time to trace and to compile, with and without derivatives."""
    argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0]).parse_args()
    console.print_in_any_encoding()
    print(f"{'system':<12} {'derivatives':<12} traced compiled together")
    for system in (TORSO, FIVE_LINKS):
        stated = system.hybrid
        for derived in (False, True):
            began = process_time()
            text = compiled.written(stated, derived=derived)
            traced = process_time()
            compiled.object_code(text)
            ended = process_time()
            results = f"{traced - began:6.2f} {ended - traced:8.2f} {ended - began:8.2f}"
            print(f"{system.name:<12} {'yes' if derived else 'no':<12} {results}")


if __name__ == "__main__":
    main()
