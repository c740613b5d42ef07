"""The command that compiles everything ahead, so that nothing else ever waits for it."""

from __future__ import annotations

import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable

from gym_passive_walker.cli.report import Report
from gym_passive_walker.progress import progress
from gym_passive_walker.sweeps.node import pieces


def warmup(command: ArgumentParser) -> Callable[[Namespace], Report]:
    """Compile everything that walks, once; from then on every start is a quick one.

    passive-walker warmup
    """

    def run(_: Namespace) -> Report:
        begun, every = time.monotonic(), list(pieces())
        with progress("pieces compiled", len(every)) as compiled_one:
            for compile_it in every:
                compile_it()
                compiled_one()
        took = time.monotonic() - begun
        return Report(f"everything is compiled, after {took:.1f} s", {"seconds": took})

    return run
