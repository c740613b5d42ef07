"""Check that a training that is killed and resumed ends as an uninterrupted one.

    python -m benchmarks.kills --kills 5 --write

One training of SAC runs without interruption. Another with this configuration is killed at random
times and resumed. Their final checkpoints are compared bit by bit: weights, optimizers, replay
buffer, normalizer, walkers and all random generators.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3.common.save_util import load_from_zip_file

import train
from agents import files
from benchmarks.report import machine, table
from benchmarks.tables import DOCS, keep
from gym_passive_walker._tools import console

PAGE = DOCS / "stability.md"
STEPS, EVERY, ENVS = 8192, 512, 8  # SAC learns in half of the steps
_SLOWEST = 2.0  # largest delay in seconds between a checkpoint and the kill after it


class Kills(NamedTuple):
    """Results of killing a training.

    Attributes:
        kills: Number of kills.
        steps: Steps of the newest checkpoint at each kill.
        compared: Number of values in the final checkpoints.
        differ: Number of values that differ.
    """

    kills: int
    steps: list[int]
    compared: int
    differ: int


def begin(folder: Path, *, resume: bool) -> subprocess.Popen:
    """Start a training, or resume it."""
    place = ["--resume", str(folder)] if resume else ["--out", str(folder), "--algo", "sac"]
    size = ["--steps", str(STEPS), "--every", str(EVERY)]
    envs = [] if resume else ["--envs", str(ENVS)]
    command = [sys.executable, train.__file__, *place, *size, *envs, "--quiet"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def reached(folder: Path) -> int:
    """Steps of a run's newest checkpoint."""
    newest = files.newest_checkpoint(folder)
    return 0 if newest is None else int(newest.name)


def finish(training: subprocess.Popen) -> None:
    """Wait for a training's end."""
    if training.wait() != 0:
        raise SystemExit(f"a training ended with {training.returncode}")


def remembered(folder: Path) -> Iterator[np.ndarray]:
    """All values of a run's newest checkpoint, in a fixed order."""

    def leaves(value: Any) -> Iterator[np.ndarray]:
        if isinstance(value, dict):
            for name in sorted(value, key=str):
                yield from leaves(value[name])
        elif isinstance(value, list | tuple):
            for entry in value:
                yield from leaves(entry)
        elif hasattr(value, "detach"):
            yield value.detach().numpy()
        else:
            yield np.array([str(value)])

    newest = files.newest_checkpoint(folder)
    assert newest is not None
    yield from leaves(load_from_zip_file(newest / "model.zip", load_data=False)[1:])
    for path in sorted(newest.glob("*.npz")):
        with np.load(path) as arrays:
            yield from (arrays[name] for name in sorted(arrays.files))
    yield from leaves(json.loads((newest / "envs.json").read_text("utf-8")))
    notes = json.loads((newest / "notes.json").read_text("utf-8"))
    yield from leaves([notes[name] for name in ("counters", "numpy", "action_space")])


def kill(folder: Path, times: int, *, seed: int = 0) -> Kills:
    """Train twice, once without interruption and once with kills, and compare.

    Args:
        folder: An empty folder.
        times: Number of kills.
        seed: Seed of the times of the kills.
    """
    rng, steps = np.random.default_rng(seed), []
    whole, killed = folder / "whole", folder / "killed"
    finish(begin(whole, resume=False))
    training = begin(killed, resume=False)
    while len(steps) < times:
        while reached(killed) < STEPS * (len(steps) + 1) / (times + 1):
            if training.poll() is not None:
                raise SystemExit("a training ended before it was killed often enough")
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, _SLOWEST))
        training.kill()
        training.wait()
        steps.append(reached(killed))
        training = begin(killed, resume=True)
    finish(training)
    pairs = list(zip(remembered(whole), remembered(killed), strict=True))
    compared = sum(ours.size for ours, _ in pairs)
    differ = sum(int(np.count_nonzero(ours != theirs)) for ours, theirs in pairs)
    return Kills(times, steps, compared, differ)


def main() -> int:
    """Run from the command line; the exit status is 0 if nothing differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--kills", type=int, default=5, help="how often (%(default)s)")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = kill(Path(folder), options.kills)
    heads = ["kills", "with a newest checkpoint of", "of steps", "numbers compared", "differ"]
    row = [found.kills, ", ".join(map(str, found.steps)), STEPS, found.compared, found.differ]
    text = f"{table(heads, [row])}\n\n{machine('torch', 'stable-baselines3')}."
    if options.write:
        keep("kills", text, PAGE)
    else:
        print(f"\n{text}")
    return 1 if found.differ else 0


if __name__ == "__main__":
    raise SystemExit(console.run(main))
