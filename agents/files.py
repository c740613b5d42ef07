"""Files of a run: written aside and renamed, so that a kill never leaves half of one.

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

import glob
import json
import os
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.config import ConfigError, reason

CONFIG = "config.yml"
RUNS = Path("runs")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write a file or a folder at, which then takes the place of `path` at once.

    A folder takes the place of none: its name has to be new. What writers of the same path left
    aside when they were killed is removed.

    Raises:
        OSError: if it cannot be written; it names `path`, which is as it was.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # The ending stays last: writers tell formats by it.
        aside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
        for left in path.parent.glob(f".{glob.escape(path.stem)}.*{glob.escape(path.suffix)}"):
            if _abandoned(left.name.removeprefix(f".{path.stem}.").removesuffix(path.suffix)):
                remove(left)
        try:
            yield aside
            os.replace(aside, path)
        finally:
            remove(aside)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None


def _abandoned(writer: str) -> bool:
    """Whether a writer, by the number of its process, writes no more."""
    if not writer.isdecimal():
        return False  # a file of someone else's
    if int(writer) == os.getpid():
        return True
    if os.name == "nt":
        return False  # to ask would end it
    try:
        os.kill(int(writer), 0)
    except ProcessLookupError:
        return True
    except OSError:  # someone else's
        return False
    return False


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


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
