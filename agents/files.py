"""Files of a run, each written whole or not at all by `gym_passive_walker.files.replacing`.

What was damaged all the same is read to a sentence that names the file.

A run's folder holds:

    config.yml            what was asked for
    checkpoints/<steps>/  everything to go on from; the newest one stays
    model.zip             the kept policy, in stable-baselines3's own format
    normalizer.npz        its VecNormalize's moments
    learning_curve.csv    one row an evaluation; learning_curve.png draws it
    evaluation.csv        the final evaluation, one row an episode; evaluation.txt is its table
    gait.png              strobe picture of the learned gait
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.config import ConfigError, reason
from gym_passive_walker.files import remove

CONFIG = "config.yml"
RUNS = Path("runs")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever a damaged file does to its reader into a sentence.

    Raises:
        ConfigError: if it is not there, or does not hold what belongs there.
    """
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:  # random bytes raise anything
        raise ConfigError(
            f"{path} is damaged, or does not fit the run's {CONFIG} ({reason(error)}): put back a "
            "whole copy, or begin anew elsewhere"
        ) from None


def read_arrays(path: Path) -> dict[str, NDArray]:
    """All arrays of an NPZ file; nothing is unpickled.

    Raises:
        ConfigError: if it is damaged.
    """
    with reading(path), path.open("rb") as file:
        if not zipfile.is_zipfile(file):  # numpy would take it for a pickle, and say so
            raise ValueError("it is no NPZ file")
        with np.load(file) as arrays:
            return dict(arrays)


def read_json(path: Path) -> Any:
    """What a JSON file says.

    Raises:
        ConfigError: if it is damaged.
    """
    with reading(path):
        return json.loads(path.read_text(encoding="utf-8"))


def new_run(folder: Path | None, name: str) -> Path:
    """A folder for a new run: the one asked for, or the first free number under `runs`.

    Raises:
        ConfigError: if the folder asked for is taken.
    """
    if folder is None:
        free = (RUNS / f"{name}-{number}" for number in count(1))
        folder = next(path for path in free if not path.exists())
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(
            f"{folder} is taken: go on with it by --resume {folder}, or choose another --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def latest_run() -> Path:
    """The run under `runs` that was written last."""
    found = [path for path in RUNS.glob("*") if (path / CONFIG).is_file()]
    if not found:
        raise ConfigError(f"there is no run to go on with under {RUNS.resolve()}")
    return max(found, key=lambda path: max(p.stat().st_mtime for p in [path, *path.iterdir()]))


def checkpoint_path(run: Path, steps: int) -> Path:
    """Where the checkpoint after that many steps belongs."""
    return run / "checkpoints" / f"{steps:012d}"


def newest_checkpoint(run: Path) -> Path | None:
    """The newest whole checkpoint of a run; None if there is none yet."""
    return max((p for p in (run / "checkpoints").glob("[0-9]*") if p.is_dir()), default=None)


def drop_older_checkpoints(newest: Path) -> None:
    """Remove the checkpoints before `newest`, and what a kill left unfinished."""
    for path in newest.parent.iterdir():
        if path != newest and (path.name.startswith(".") or path.name < newest.name):
            remove(path)
