"""Files of a run: written aside and renamed, so that a kill never leaves half of one.

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

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from agents.config import ConfigError

CONFIG = "config.yml"
RUNS = Path("runs")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write a file or a folder at, which then takes the place of `path` at once.

    A folder takes the place of none: its name has to be new.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # The ending stays last: writers tell formats by it.
    aside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield aside
        os.replace(aside, path)
    finally:
        if aside.is_dir():
            shutil.rmtree(aside)
        else:
            aside.unlink(missing_ok=True)


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
            shutil.rmtree(path)
