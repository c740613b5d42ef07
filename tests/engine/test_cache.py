"""Compiled kernels that different processes have cached work together in a third."""

import os
import subprocess
import sys

import pytest

STRIDE = """
import gym_passive_walker as gpw
for name in {names!r}:
    gait = gpw.find_gait(name, 0.03)
    print(name, gait.state.tolist(), abs(gait.multipliers[0]))
"""


def run(names: str, cache: object) -> dict[str, str]:
    """Gaits of some walkers as a fresh process with that kernel cache finds them."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", STRIDE.format(names=names)],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


@pytest.mark.slow
def test_kernels_cached_by_different_processes_are_not_mistaken_for_each_other(tmp_path):
    alone = {name: run(name, tmp_path)[name] for name in "DEC"}
    together = run("DEC", tmp_path)
    assert together == alone
