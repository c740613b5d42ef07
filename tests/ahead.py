"""Compile what tests share, before they begin: in two processes, each would compile it again.

python -m tests.ahead
"""

from concurrent.futures import ProcessPoolExecutor

from gym_passive_walker.apps.build import compile_piece, pieces
from gym_passive_walker.devices.web.build import bookkeeping, modules
from gym_passive_walker.devices.web.code import BOOKKEEPING


def main() -> None:
    """Compile all kernels, and the modules of web pages, into the cache."""
    with ProcessPoolExecutor() as pool:
        shared = [pool.submit(bookkeeping, name) for name in BOOKKEEPING]  # the longest first
        compiled = [pool.submit(compile_piece, number) for number in range(len(list(pieces())))]
        for each in shared:
            each.result()
        modules()
        for each in compiled:
            each.result()


if __name__ == "__main__":
    main()
