"""The command `warmup`, which compiles all kernels ahead of their first use."""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor

from gym_passive_walker._tools.progress import progress
from gym_passive_walker.apps.build import compile_piece, pieces
from gym_passive_walker.apps.cli.report import Report
from gym_passive_walker.engine.machine import is_built


def warmup() -> Report:
    """Compile all kernels once and cache them, so that later starts are quick.

    A package that was installed from a wheel has its kernels already.

    passive-walker warmup
    """
    if is_built():
        said = "there is nothing to compile: the package has machine code for this CPU"
        return Report(said, {"seconds": 0.0})
    begun, every = time.monotonic(), range(len(list(pieces())))
    with ProcessPoolExecutor() as pool, progress("pieces compiled", len(every)) as compiled_one:
        for _each in pool.map(compile_piece, every):
            compiled_one()
    took = time.monotonic() - begun
    return Report(f"everything is compiled, after {took:.1f} s", {"seconds": took})
